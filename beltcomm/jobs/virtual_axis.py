"""A virtual machine made of one's own axis.yaml: the exercise before the hardware arrives."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from beltcomm.axis import Axis, load_axis
from beltcomm.configfiles import read_yaml, to_yaml, write_text
from beltcomm.errors import UsageError
from beltcomm.experiments.rehearsal import sheet_twin

#: How a drive is called that plays the machine of a file, and how the plant made of ``NAME.yaml`` ends.
SCHEME, PLANT = "virtual:", ".plant.yaml"
#: Share of the rated torque that a drive's reading is noisy by.
NOISE_SHARE = 0.004


def machine_of(drive: str) -> tuple[str, str]:
    """The drive as it is opened, and a sentence on the machine behind it.

    ``virtual:my_axis.yaml`` becomes ``virtual:my_axis.plant.yaml``, which is written beside the axis file where it is not there; every
    other drive stays as it is.

    Parameters
    ----------
    drive : str
        As for ``--drive``.

    Returns
    -------
    tuple of str
        "" for the sentence where there is nothing to say.

    Raises
    ------
    UsageError
        For an axis file that cannot be a machine.
    """
    path = Path(drive.removeprefix(SCHEME))
    if not drive.startswith(SCHEME) or not path.is_file() or not _is_axis(path):
        return drive, ""
    plant = path.with_name(f"{path.stem}{PLANT}")
    if plant.is_file():
        return f"{SCHEME}{plant}", f"The machine is that of {plant}, as it is; remove the file to have it made of {path} anew."
    axis = load_axis(path)
    model, assumed = sheet_twin(axis)
    write_text(plant, to_yaml({**model.to_dict(), "name": axis.name or path.stem, "drive": _drive_of(axis)}))
    return f"{SCHEME}{plant}", (
        f"{plant} is written: a machine as {path} describes it. Assumed, for no sheet tells: {assumed}. Edit it to try others."
    )


def axis_behind(drive: str) -> Path | None:
    """The axis file that a virtual machine was made of; None for any other drive.

    Parameters
    ----------
    drive : str
        As for ``--drive``.

    Returns
    -------
    Path or None
        Beside the plant file.
    """
    path = Path(drive.removeprefix(SCHEME))
    own = path.with_name(path.name.removesuffix(PLANT) + ".yaml")
    return own if drive.startswith(SCHEME) and path.name.endswith(PLANT) and own.is_file() and _is_axis(own) else None


def _drive_of(axis: Axis) -> dict[str, Any]:
    """The drive section of a machine by its axis file: the motor's nameplate, the carriage in the middle."""
    motor = axis.motor
    current = motor.rated_torque_nm / motor.torque_constant_nm_a if motor.rated_torque_nm and motor.torque_constant_nm_a else None
    told = {
        "rated_torque_nm": motor.rated_torque_nm,
        "peak_torque_nm": motor.peak_torque_nm,
        "rated_current_a": current,
        "max_speed_rpm": motor.max_speed_rad_s and motor.max_speed_rad_s * 30.0 / math.pi,
        "counts_per_rev": motor.encoder_counts_per_rev and int(motor.encoder_counts_per_rev),
        "torque_noise_nm": motor.rated_torque_nm and NOISE_SHARE * motor.rated_torque_nm,
        "start_position_m": axis.travel.middle_m,
        "brake_torque_nm": motor.brake_torque_nm,
        "brake_time_s": motor.brake_time_s,
    }
    return {key: value for key, value in told.items() if value}


def _is_axis(path: Path) -> bool:
    try:
        data = read_yaml(path)
    except UsageError:
        return False
    return isinstance(data, dict) and "motor" in data and "effects" not in data
