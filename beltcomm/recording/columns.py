"""The columns of a recording: which signal each holds, on which side of the drive train, in which unit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal

from beltcomm.configfiles import did_you_mean
from beltcomm.errors import MissingColumn
from beltcomm.quantities import in_other_unit

Side = Literal["motor", "load", "ampere", "volt"]

#: Column of each signal, by side.  ``force_setpoint_n``, ``current_setpoint_a`` and ``reference_velocity_m_s`` follow the
#: pattern of the others; an offset is what was added to a controller's torque (60B2h).
CHANNELS: Final[Mapping[Side, Mapping[str, str]]] = {
    "motor": {
        "torque": "torque_nm",
        "torque_setpoint": "torque_setpoint_nm",
        "position": "position_rad",
        "velocity": "velocity_rad_s",
        "reference_position": "reference_position_rad",
        "reference_velocity": "reference_velocity_rad_s",
        "torque_offset": "torque_offset_nm",
    },
    "load": {
        "torque": "force_n",
        "torque_setpoint": "force_setpoint_n",
        "position": "position_m",
        "velocity": "velocity_m_s",
        "reference_position": "reference_position_m",
        "reference_velocity": "reference_velocity_m_s",
        "torque_offset": "force_offset_n",
    },
    "ampere": {
        "torque": "current_a",
        "torque_setpoint": "current_setpoint_a",
        "position": "position_rad",
        "velocity": "velocity_rad_s",
        "reference_position": "reference_position_rad",
        "reference_velocity": "reference_velocity_rad_s",
        "torque_offset": "current_offset_a",
    },
    "volt": {
        "torque": "motor_voltage_v",
        "torque_setpoint": "motor_voltage_setpoint_v",
        "position": "position_rad",
        "velocity": "velocity_rad_s",
        "reference_position": "reference_position_rad",
        "reference_velocity": "reference_velocity_rad_s",
        "torque_offset": "motor_voltage_offset_v",
    },
}
#: What a drive reports, in this order.
MOTOR_COLUMNS: Final = ("t_s", *CHANNELS["motor"].values())
#: Signals with the same column on every side.
COMMON: Final = ("temperature_c", "cart_position_m", "load_position_rad")
#: Every column that means something, in the order of the sides.
KNOWN_COLUMNS: Final = tuple(dict.fromkeys(("t_s", *(name for channels in CHANNELS.values() for name in channels.values()), *COMMON)))
#: Unit of what resists acceleration, by side: inertia, mass, or inertia over an unknown torque per ampere or volt.
INERTIA_UNIT: Final[Mapping[Side, str]] = {"motor": "kg m²", "load": "kg", "ampere": "A s²/rad", "volt": "V s²/rad"}


def side_of(file: str, columns: Mapping[str, object], *, timed: bool) -> Side:
    """Side that the columns are from.

    Parameters
    ----------
    file : str
        Name, for the sentence.
    columns : mapping of str to object
        By name.
    timed : bool
        t_s is needed.

    Raises
    ------
    MissingColumn
    """
    if "t_s" not in columns and timed:
        hint = _hint("t_s", columns)
        still = "" if hint else "; a static map of position and torque needs a sidecar with experiment: static_map"
        raise MissingColumn(f"{file} has no column t_s{hint}{still}", "t_s")
    for side, channels in CHANNELS.items():
        if channels["torque"] in columns and channels["position"] in columns:
            return side
    torque = next((side for side, channels in CHANNELS.items() if channels["torque"] in columns), None)
    if torque is not None:
        missing = CHANNELS[torque]["position"]
        beside = f" beside {CHANNELS[torque]['torque']}"
    else:
        missing, beside = ("force_n", "") if "position_m" in columns else ("torque_nm", " (or current_a, motor_voltage_v, force_n)")
    raise MissingColumn(f"{file} has no column {missing}{beside}{_hint(missing, columns)}; it has {', '.join(columns)}", missing)


def _hint(wanted: str, columns: Mapping[str, object]) -> str:
    """Probable meaning of another column."""
    for name in columns:
        factor = in_other_unit(name, wanted)
        if factor is not None:
            return f"; multiply {name} by {factor:.6g} and call it {wanted}"
    return did_you_mean(wanted, [name for name in columns if name not in KNOWN_COLUMNS])
