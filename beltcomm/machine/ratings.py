"""Motor as the drive knows it against axis.yaml, before anything moves: identified masses and every limit rest on it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from beltcomm.axis import Axis
from beltcomm.drive import Capabilities, KnownMotor
from beltcomm.errors import DataError, UsageError
from beltcomm.given import pasted
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Talk

#: Units of a drive by name: in words, SI, and the objects that make them.
_UNITS = {
    "position": ("position", "rad", "608Fh, 6091h, 6092h, 6093h, 60A8h"),
    "speed": ("speed", "rad/s", "60A9h, 6094h, 6092h"),
    "acceleration": ("acceleration", "rad/s²", "60AAh, 6097h, 6092h"),
    "torque": ("torque", "N m", "6076h, the rated torque"),
    "rated_torque": ("rated torque", "N m", "6076h"),
}
#: Share by which a unit may differ and be the same: numbers of a file.
SAME_UNIT = 1e-6
#: Rated values of the drive may differ by this share from axis.yaml: rounding of data sheets.
RATED_TOLERANCE = 0.05


def nameplate_of(axis: Axis) -> KnownMotor:
    """Motor as the axis file knows it, for a drive that does not tell.

    Parameters
    ----------
    axis : Axis

    Returns
    -------
    KnownMotor
        SI, motor shaft; None for what is not stated.
    """
    motor, speed = axis.motor, axis.limits.speed_m_s
    fastest = speed / axis.transmission_m_rad if speed is not None and axis.get("pulley.effective_radius_m") is not None else None
    return KnownMotor(
        motor.rated_torque_nm,
        motor.peak_torque_nm,
        motor.torque_constant_nm_a,
        motor.max_speed_rad_s or fastest,
        None if motor.encoder_counts_per_rev is None else int(motor.encoder_counts_per_rev),
    )


@dataclass(frozen=True)
class Rating:
    """One value that drive and axis.yaml both tell.

    Attributes
    ----------
    what : str
        In words.
    remedy : str
        What to do.
    most : bool
        Only more is wrong in the drive.
    """

    what: str
    drive: float
    file: float | None
    unit: str
    remedy: str
    most: bool = False

    @property
    def share(self) -> float:
        """Drive over file; 1 where the file does not tell."""
        return self.drive / self.file if self.file else 1.0

    @property
    def wrong(self) -> bool:
        """True if they differ by more than rounding."""
        return self.share > 1.0 + RATED_TOLERANCE or (not self.most and self.share < 1.0 - RATED_TOLERANCE)

    def words(self) -> str:
        """Both values, and what to do."""
        shown = ".10g" if self.unit == "counts/rev" else ".3g"
        told = f"the drive's {self.what} is {self.drive:{shown}} {self.unit}, axis.yaml says {self.file or math.nan:{shown}} {self.unit}"
        return f"{told}: {self.remedy}"


def _ratings(axis: Axis, capabilities: Capabilities) -> tuple[Rating, ...]:
    """Ratings that can be compared; a limit may be set lower in a drive than the motor bears, not higher."""
    motor = axis.motor
    share = capabilities.rated_torque_nm / motor.rated_torque_nm if motor.rated_torque_nm else 1.0
    current = motor.rated_torque_nm / motor.torque_constant_nm_a if motor.rated_torque_nm and motor.torque_constant_nm_a else None
    return (
        Rating(
            "rated torque",
            capabilities.rated_torque_nm,
            motor.rated_torque_nm,
            "N m",
            f"every torque would be scaled by {share:.2f}; correct motor.rated_torque_nm or the drive's motor data (6076h)",
        ),
        Rating(
            "rated current",
            capabilities.rated_current_a,
            current,
            "A rms",
            "by motor.rated_torque_nm over motor.torque_constant_nm_a; every current, torque and I²t limit would be scaled by that "
            "(1.41 times or 0.71: peak amperes beside rms). Correct the motor data of the drive (6075h) or of axis.yaml",
        ),
        *limit_ratings(axis, capabilities.peak_torque_nm, capabilities.max_speed_rad_s),
        counts_rating(axis, capabilities.encoder_counts_per_rev or capabilities.counts_per_rev),
    )


def limit_ratings(axis: Axis, peak_torque_nm: float, max_speed_rad_s: float) -> tuple[Rating, Rating]:
    """The drive's limits against the motor's: lower than what the motor bears is right; for doctor and commissioning.

    Parameters
    ----------
    axis : Axis
    peak_torque_nm : float, N m, motor shaft
        Of the drive.
    max_speed_rad_s : float, rad/s, motor shaft
        Of the drive.

    Returns
    -------
    tuple of Rating
        Of torque and speed.
    """
    return (
        Rating(
            "largest torque",
            peak_torque_nm,
            axis.motor.peak_torque_nm,
            "N m",
            "a loop that rings would give the motor more than it bears; lower 6072h or 6073h in the drive, or correct motor.peak_torque_nm",
            most=True,
        ),
        Rating(
            "largest speed",
            max_speed_rad_s,
            axis.motor.max_speed_rad_s,
            "rad/s",
            "a motor that runs away would be stopped too late; lower 6080h in the drive, or correct motor.max_speed_rad_s",
            most=True,
        ),
    )


def own_machine(file: str = "AXIS.yaml") -> str:
    """Remedy where a virtual drive plays another machine than that of an axis file.

    Parameters
    ----------
    file : str
        The axis file.
    """
    return f"`--drive {pasted(f'virtual:{file}')}` simulates the axis that your axis.yaml describes"


def check_ratings(axis: Axis, capabilities: Capabilities) -> list[str]:
    """Refuse values of a drive that differ from the axis file's by more than ``RATED_TOLERANCE``.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities

    Returns
    -------
    list of str
        Smaller differences, in words.

    Raises
    ------
    UsageError
        With all of them.
    """
    found = _ratings(axis, capabilities)
    wrong = [rating.words() for rating in found if rating.wrong]
    if wrong:
        raise UsageError("; ".join(wrong) + (f". {own_machine()}" if "plant" in capabilities.identity else ""))
    counted = counts_rating(axis, capabilities.encoder_counts_per_rev or capabilities.counts_per_rev)
    return [counted.words()] if counted.share != 1.0 else []


def tell_ratings(axis: Axis, capabilities: Capabilities, talk: Talk) -> None:
    """Ask :func:`check_ratings` before a command writes or moves what is scaled by them, and say what is not the drive's own word.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    talk : Talk

    Raises
    ------
    UsageError
        For values that differ; nothing was written or moved.
    """
    try:
        told = check_ratings(axis, capabilities)
    except UsageError as error:
        raise UsageError(f"nothing was written or moved: {error}") from error
    talk.say(*(line for line in (*told, *capabilities.cautions) if line))


def check_units(folder: RunFolder, capabilities: Capabilities) -> None:
    """Compare the drive's units with those that a run was recorded in, before anything moves.

    Whoever changes them with a maker's tool leaves limits, zero and ramps in the old ones, and a drive that tells another unit than it
    counts in shows that to no sensor.

    Parameters
    ----------
    folder : RunFolder
    capabilities : Capabilities

    Raises
    ------
    UsageError
        With both values and what to look at.
    """
    try:
        before = (folder.load_result("drive") or {}).get("units") or {}
    except DataError:  # whoever reads more of it says so; values must come back all the same
        return
    changed = other_units_than(before, capabilities.units)
    if changed and folder.finished_names():
        raise UsageError(
            f"{folder.path} was recorded in other units than this drive has now: {'; '.join(changed)}. Nothing was moved. Set them back "
            "with the maker's tool; if they are meant so, compare a short move with a ruler (`beltcomm move --by 50mm`), look at the "
            "limits that stand in the drive, and begin a new run"
        )


def other_units_than(before: Mapping[str, float], now: Mapping[str, float]) -> list[str]:
    """Units that are other ones than before, in words; one that nobody told, then or now, is not compared.

    Parameters
    ----------
    before, now : mapping of str to float, SI
        Size of one unit of the drive, by name.

    Returns
    -------
    list of str
        Empty where they agree.
    """
    found = []
    for name, (what, unit, objects) in _UNITS.items():
        then, here = before.get(name), now.get(name)
        if then and here and not math.isclose(then, here, rel_tol=SAME_UNIT):
            found.append(f"one unit of {what} is {abs(here):.5g} {unit}, it was {abs(then):.5g} ({here / then:.4g} times; {objects})")
    return found


def fault_of(axis: Axis, capabilities: Capabilities) -> str:
    """Sentence with which :func:`check_ratings` would refuse; "" for nothing.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    """
    try:
        check_ratings(axis, capabilities)
    except UsageError as problem:
        return str(problem)
    return ""


def counts_rating(axis: Axis, counts_per_rev: float) -> Rating:
    """Encoder of the drive against the axis file: beyond rounding it is wrong, else the drive's number is used.

    Parameters
    ----------
    axis : Axis
    counts_per_rev : float
        Of the drive, per turn of the motor.
    """
    counts = axis.motor.encoder_counts_per_rev
    remedy = "every way would be scaled by that; correct motor.encoder_counts_per_rev, to what the drive counts in, or the drive's encoder"
    if counts and abs(counts_per_rev / counts - 1.0) <= RATED_TOLERANCE:
        remedy = "the drive's number is used"
    return Rating("encoder resolution", counts_per_rev, counts, "counts/rev", remedy)
