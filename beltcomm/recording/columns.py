"""The columns of a recording: which signal each holds, on which side of the drive train, in which unit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal

from beltcomm.configfiles import did_you_mean
from beltcomm.errors import MissingColumn
from beltcomm.quantities import in_other_unit

Side = Literal["motor", "load", "ampere", "volt"]


def _channels(effort: str, unit: str, way: str) -> Mapping[str, str]:
    """Column of each signal, of what drives in its unit, of a way in m or an angle in rad; an offset is what was added to a controller's
    torque (60B2h).
    """
    return {
        "torque": f"{effort}_{unit}",
        "torque_setpoint": f"{effort}_setpoint_{unit}",
        "position": f"position_{way}",
        "velocity": f"velocity_{way}_s",
        "reference_position": f"reference_position_{way}",
        "reference_velocity": f"reference_velocity_{way}_s",
        "torque_offset": f"{effort}_offset_{unit}",
    }


#: Column of each signal, by side.
CHANNELS: Final[Mapping[Side, Mapping[str, str]]] = {
    "motor": _channels("torque", "nm", "rad"),
    "load": _channels("force", "n", "m"),
    "ampere": _channels("current", "a", "rad"),
    "volt": _channels("motor_voltage", "v", "rad"),
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
