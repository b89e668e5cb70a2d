"""Measured units of a drive's gains: kept in the run, told to the drive, and held against what is known of its kind.

``results/calibration.yaml`` of a run holds the measurement; every command that connects to that run's drive tells it to the drive.  Of real
drives the constants are kept per kind of drive too, in the user's data folder (``beltcomm/calibration/KIND.yaml``): they stand for nobody's
drive but are what the next measurement must agree with.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from platformdirs import user_data_path

from beltcomm.configfiles import read_yaml, to_yaml, write_text
from beltcomm.contents import check_content
from beltcomm.control import Cascade
from beltcomm.drive import Drive
from beltcomm.errors import DataError, Refused, UsageError
from beltcomm.runfolder import RunFolder

#: A measurement that differs by more than this factor from what is known is not believed.
DISAGREEMENT = 2.0
#: Rated torque or current of two drives that differ by less belong to the same motor.
SAME_MOTOR = 0.05
RESULT = "calibration"


@dataclass(frozen=True)
class GainUnit:
    """Value of one raw unit of a gain, SI at the motor shaft.

    Attributes
    ----------
    interval : float
        95 %, 0 where it was not measured but is documented.
    assumed : float
        By the profile.
    place : str
        The object, in words.
    """

    value: float
    interval: float
    assumed: float
    place: str

    @property
    def factor(self) -> float:
        """Times what the profile assumes."""
        return self.value / self.assumed


@dataclass(frozen=True)
class Calibration:
    """The units of a drive's gains by name, and the drive that they were measured on."""

    kind: str
    rated_torque_nm: float
    rated_current_a: float
    units: Mapping[str, GainUnit]

    def to_dict(self) -> dict[str, Any]:
        """For a file."""
        units = {
            name: {"unit": one.value, "interval": one.interval, "assumed": one.assumed, "object": one.place}
            for name, one in self.units.items()
        }
        return {"kind": self.kind, "rated_torque_nm": self.rated_torque_nm, "rated_current_a": self.rated_current_a, "units": units}

    def lines(self) -> list[str]:
        """For people."""
        words = {"kp_nm_s_rad": ("velocity gain", "N m s/rad"), "ki_nm_rad": ("integral time", "s"), "kpp_1_s": ("position gain", "1/s")}
        lines = []
        for name, one in self.units.items():
            what, unit = words.get(name, (name, ""))
            if one.interval:
                said = (
                    f"{one.value:.4g} ± {one.interval:.2g} {unit} for each unit of {one.place}, {one.factor:.3g} times what its profile has"
                )
            else:
                said = f"{one.value:.4g} {unit} for each unit of {one.place}, as its profile has it; the steps do not contradict"
            lines.append(f"  {what:14} {said}")
        return lines


def _calibration_from_dict(data: Mapping[str, Any], where: Path) -> Calibration:
    """The inverse of :meth:`Calibration.to_dict`; raises DataError."""
    check_content(RESULT, data, where)
    units = {name: GainUnit(one["unit"], one["interval"], one["assumed"], one["object"]) for name, one in data["units"].items()}
    if not all(0.0 < one.value < math.inf and one.assumed > 0.0 for one in units.values()):
        raise DataError(f"{where} is damaged: a unit is no positive number; remove it and calibrate again")
    return Calibration(data["kind"], data["rated_torque_nm"], data["rated_current_a"], units)


def recall(drive: Drive, folder: RunFolder) -> None:
    """Tell a drive what its gains mean, where the run knows it and the drive's profile does not.

    Parameters
    ----------
    drive : Drive
    folder : RunFolder

    Raises
    ------
    DataError
        For a damaged file.
    """
    if not drive.capabilities.uncalibrated:
        return
    data = folder.load_result(RESULT)
    if data is None:
        return
    known = _calibration_from_dict(data, folder.file("results", RESULT))
    drive.calibrate({name: one.value for name, one in known.units.items() if name in drive.capabilities.uncalibrated})


def unsure(folder: RunFolder) -> float:
    """Largest relative half interval of the units that a run has measured; 0 where it has measured none.

    Parameters
    ----------
    folder : RunFolder

    Raises
    ------
    DataError
        For a damaged result.
    """
    return max(_shares(folder).values(), default=0.0)


def _shares(folder: RunFolder) -> dict[str, float]:
    """Relative half interval of each unit that a run has measured."""
    data = folder.load_result(RESULT)
    if data is None:
        return {}
    known = _calibration_from_dict(data, folder.file("results", RESULT))
    return {name: one.interval / one.value for name, one in known.units.items()}


def at_interval_ends(folder: RunFolder, cascade: Cascade) -> list[Cascade]:
    """A cascade at both ends of the 95 % intervals of its gains' units, those of the velocity loop together.

    Parameters
    ----------
    folder : RunFolder
        With what was measured of the drive.
    cascade : Cascade
        As it was set.

    Returns
    -------
    list of Cascade
        Empty where no unit was measured.

    Raises
    ------
    DataError
        For a damaged result.
    """
    shares = _shares(folder)
    velocity, position = max(shares.get("kp_nm_s_rad", 0.0), shares.get("ki_nm_rad", 0.0)), shares.get("kpp_1_s", 0.0)
    factors = {
        (max(1.0 + one * velocity, 0.0), max(1.0 + other * position, 0.0) if cascade.kpp_1_s else 1.0)
        for one in (-1.0, 1.0)
        for other in (-1.0, 1.0)
    }
    return [
        replace(cascade, kp_nm_s_rad=kp * cascade.kp_nm_s_rad, ki_nm_rad=kp * cascade.ki_nm_rad, kpp_1_s=kpp * cascade.kpp_1_s)
        for kp, kpp in sorted(factors)
        if (kp, kpp) != (1.0, 1.0)
    ]


def _store_of(kind: str) -> Path:
    """File in which the constants of a kind of drive are kept for this user."""
    return user_data_path("beltcomm") / "calibration" / f"{kind}.yaml"


def calibration_of(kind: str) -> Calibration | None:
    """Calibration of a kind of drive by earlier runs; None without one.

    Parameters
    ----------
    kind : str
        Of the drive.

    Raises
    ------
    DataError
        For a damaged file.
    """
    path = _store_of(kind)
    return _calibration_from_dict(read_yaml(path, DataError), path) if path.is_file() else None


def keep_for_kind(found: Calibration) -> str:
    """Keep the constants for the next drive of this kind; returns what became of it, in words.

    Parameters
    ----------
    found : Calibration
        Constants of this drive.
    """
    path = _store_of(found.kind)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, to_yaml(found.to_dict()))
    except (OSError, UsageError) as problem:
        return f"the constants could not be kept for other drives of this kind: {problem}"
    return f"kept for drives of this kind in {path}"


def check(found: Calibration, documented: bool, before: Calibration | None) -> list[str]:
    """Remarks on a measurement beside what is known.

    Parameters
    ----------
    found : Calibration
        Constants of this drive.
    documented : bool
        The profile's meanings are no guesses.
    before : Calibration or None
        Measured on another drive of this kind; with another motor it is only remarked upon, for nobody knows whether such a gain counts
        torque or current.

    Raises
    ------
    Refused
        When it contradicts that by more than a factor of two.
    """
    remarks = []
    same = before is not None and all(
        abs(one / other - 1.0) < SAME_MOTOR
        for one, other in ((found.rated_torque_nm, before.rated_torque_nm), (found.rated_current_a, before.rated_current_a))
    )
    for name, one in found.units.items():
        for known, by, binding in (
            (one.assumed if documented else None, "its documents", True),
            (
                before.units[name].value if before is not None and name in before.units else None,
                "a drive of this kind measured before",
                same,
            ),
        ):
            if known is None:
                continue
            factor = one.value / known
            if 1.0 / DISAGREEMENT <= factor <= DISAGREEMENT:
                continue
            said = (
                f"one unit of {one.place} ({name}) was measured as {one.value:.3g} ± {one.interval:.2g}, which is {factor:.3g} times the "
                f"{known:.3g} of {by}"
            )
            if binding:
                raise Refused(
                    f"{said}; more than a factor of {DISAGREEMENT:g} is not believed and no gain is written. Check the profile, the "
                    "motor's data in the drive, and whether something holds or drives the axis; then calibrate again"
                )
            remarks.append(f"{said}, with another motor")
    return remarks
