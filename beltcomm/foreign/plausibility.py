"""Doubts that a foreign recording is of this axis: each with the value found, what was expected, and what to do.

Nothing here refuses a record: what cannot be at all is :mod:`beltcomm.foreign.checks`' and :mod:`beltcomm.recording`'s.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array
from beltcomm.axis import Axis
from beltcomm.recording import Recording
from beltcomm.recording.checks import RigidInertia, rigid_inertia
from beltcomm.recording.columns import CHANNELS
from beltcomm.recording.sampling import uneven_rows

#: kg: heavier carriages with payload belong to no toothed-belt axis.
_HEAVIEST_KG = 200.0
#: Share of the motor-side inertia by the data sheets below which a measured total is impossible.
_LIGHTEST_SHARE = 0.7
#: Standard deviations beyond which an inertia is certain; and the share of the friction that must accelerate.
_CERTAIN, _DYNAMIC = 4.0, 0.05
#: Times the motor's inertia, of all that it turns, that no servo axis is built with.
_APART = 100.0
#: Times its rated torque, that no servo motor gives for a moment.
_MOST_RATED = 10.0
#: From which a torque in tenths may be per cent of a rated one.
_PER_CENT = 3.0
#: Two measures of one motion agree to this; where their likeness is smaller, filters and noise part them too.
_AGREE, _ALIKE = 0.05, 0.995
#: Rows that a slower torque stays the same in, changes and levels that it needs to be one, and share of those that may follow at once.
_HELD_ROWS, _FEWEST_CHANGES, _SELDOM = 3, 40, 0.2
#: Parts of a record by which it goes one way, share of its path from which it does, and share of the work that no friction gives.
_LOOKS, _ONE_WAY, _HELD_BACK = 200, 0.95, 0.1
#: Rows of a long record on which that is judged.
_MOST_JUDGED = 200_000
#: Share of the rate at which rows that a logger read twice or not at all are no more seen.
_EASILY = 0.1
#: s; slower sampling shows no resonance of a belt, faster stamps come from no drive.
_SLOWEST_S, _FASTEST_S = 0.01, 2e-5
#: Factors between what a column holds and what it should hold, and how it is mapped then.
_TORQUE_UNITS = {1e-3: "mN m or thousandths", 1e-2: "per cent or N cm", 1e3: "kN m"}
_POSITION_UNITS = {math.pi / 180.0: "degrees (*deg)", math.tau: "revolutions (*rev)", 1e-3: "mrad or mm"}


@dataclass(frozen=True)
class Doubt:
    """One doubt.

    Attributes
    ----------
    what : str
        In words.
    value, expected : str
        With units.
    remedy : str
        What to do next.
    """

    what: str
    value: str
    expected: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.what} is {self.value}, expected {self.expected}; {self.remedy}"


def findings(recording: Recording, axis: Axis) -> tuple[Doubt, ...]:
    """All doubts about a recording that has passed the checks.

    Parameters
    ----------
    recording : Recording
    axis : Axis
        What is not known of it is not asked.
    """
    if recording.is_static_map:
        return ()
    ratio = axis.transmission_m_rad if axis.get("pulley.effective_radius_m") is not None and recording.side != "load" else None
    return (
        *_sampling(recording),
        *_inertia(recording, axis, ratio),
        *_feed_constant(recording, axis, ratio),
        *_travel(recording, axis, 1.0 if recording.side == "load" else ratio),
        *_velocity(recording),
        *_one_way(recording),
        *_torque_levels(recording, axis),
    )


def _sampling(recording: Recording) -> Iterator[Doubt]:
    period = recording.sample_period_s
    if period > _SLOWEST_S:
        yield Doubt(
            "the time between rows", f"{1e3 * period:.4g} ms", f"at most {1e3 * _SLOWEST_S:g} ms to see a belt's resonance",
            "friction and mass may still be told; record faster for the rest, or correct the unit of time: --map t_s=NAME*ms",
        )  # fmt: skip
    if period < _FASTEST_S:
        yield Doubt(
            "the time between rows", f"{1e6 * period:.4g} us", f"at least {1e6 * _FASTEST_S:g} us",
            "correct the unit of time: --map t_s=NAME*FACTOR",
        )  # fmt: skip
    position, torque = (CHANNELS[recording.side][signal] for signal in ("position", "torque"))
    uneven = uneven_rows(recording.t_s[:_MOST_JUDGED], recording.position[:_MOST_JUDGED])
    slower = f"--resample {_EASILY / period:.2g}Hz takes even rows, slow enough to hold each; or record again with true time stamps"
    for rows, what in ((uneven.repeated, "stand still between steps"), (uneven.missing, "are twice those beside them")):
        if len(rows) > 1:
            yield Doubt(
                f"the number of steps of {position} that {what}", f"{len(rows)}, the first in row {rows[0] + 1}",
                "1 at most: no analysis takes such a record as it is", slower,
            )  # fmt: skip
    held = _held_rows(recording)
    if held >= _HELD_ROWS:
        yield Doubt(
            f"the time in which {torque} gets a new value", f"{1e3 * held * period:.3g} ms, {held} rows",
            "each row", f"what happens faster cannot be told; --resample {0.7 / (held * period):.2g}Hz takes its mean over even rows",
        )  # fmt: skip


def _held_rows(recording: Recording) -> int:
    """In how many rows a torque of many levels changes once while the axis moves; 1 where each is measured."""
    changes = np.flatnonzero(np.diff(recording.torque))
    if len(changes) < _FEWEST_CHANGES or len(np.unique(recording.torque)) < _FEWEST_CHANGES:
        return 1
    rows = np.diff(changes)
    moved = np.abs(np.diff(recording.position[changes])) > 0.0
    return int(np.median(rows[moved])) if np.any(moved) and float(np.mean(rows[moved] == 1)) < _SELDOM else 1


def _inertia(recording: Recording, axis: Axis, ratio: float | None) -> Iterator[Doubt]:
    """Torque against acceleration: the sum of everything that is moved must be positive, and of this axis's size."""
    weight = ratio is None and recording.side != "load"
    found = rigid_inertia(recording.t_s, recording.torque, recording.position, weight=weight)
    if found is not None and found.inertia < 0.0 and ratio is None:  # a spring turns it, too; no belt draws its axis to a place
        found = rigid_inertia(recording.t_s, recording.torque, recording.position, weight=weight, spring=True)
    if found is None or abs(found.inertia) < _CERTAIN * found.error or found.dynamic < _DYNAMIC:
        return
    motor = axis.motor.inertia_kg_m2
    unit, torque = recording.inertia_unit, CHANNELS[recording.side]["torque"]
    name = "the mass" if recording.side == "load" else "the inertia"
    value = f"{found.inertia:.3g} ± {2.0 * found.error:.1g} {unit}"
    if found.inertia < 0.0:
        yield Doubt(
            f"{name} by the regression of {torque} on acceleration", value, "a positive one",
            "one of the two has the wrong sign: --flip torque or --flip position (whichever the drive counts the other way)",
        )  # fmt: skip
        return
    if recording.side == "motor" and ratio is None and motor is not None and found.inertia > _APART * motor:
        apart = found.inertia / motor
        yield Doubt(
            f"{name} by the regression of {torque} on acceleration", value, f"at most {_APART:g} times the motor's {motor:.3g} {unit}",
            f"torque and angle look {apart:.3g} apart: a torque behind the gearbox beside the angle of the motor? Divide it by the gear "
            "ratio in --map, or correct its unit",
        )  # fmt: skip
    gear = axis.gearbox.ratio
    if recording.side == "motor" and motor is None and gear > 1.0:
        yield Doubt(
            f"the shaft at which {torque} was taken", f"not said ({name} comes out as {value})",
            f"the motor's, {gear:g} times as fast as the load's",
            f"one behind the gearbox is {torque}=NAME*{1.0 / gear:.6g} in --map; motor.inertia_kg_m2 in the axis file would tell it",
        )  # fmt: skip
    if recording.side != "motor" or ratio is None or motor is None:
        return
    least = _LIGHTEST_SHARE * axis.motor_side_inertia_kg_m2
    most = axis.motor_side_inertia_kg_m2 + ratio**2 * _HEAVIEST_KG
    if not least <= found.inertia <= most:
        yield Doubt(
            f"{name} by the regression of {torque} on acceleration", value,
            f"{least:.3g} to {most:.3g} {unit}, the motor's side by the data sheets and up to {_HEAVIEST_KG:g} kg behind it",
            _unit_remedy(found, least, most, axis),
        )  # fmt: skip


def _unit_remedy(found: RigidInertia, least: float, most: float, axis: Axis) -> str:
    """The units with which the inertia would be possible."""
    fits = [f"torque_nm in {words}" for factor, words in _TORQUE_UNITS.items() if least <= found.inertia * factor <= most]
    gear = axis.gearbox.ratio
    fits += (
        [f"torque_nm is that behind the gearbox (divide it by {gear:g})"] if gear > 1.0 and least <= found.inertia / gear <= most else []
    )
    constant = axis.motor.torque_constant_nm_a
    if constant is not None and least <= found.inertia * constant <= most:
        fits.append("torque_nm is in ampere (--map current_a=NAME)")
    fits += [f"position_rad in {words}" for factor, words in _POSITION_UNITS.items() if least <= found.inertia / factor <= most]
    return f"it would fit if {' or '.join(fits)}: correct the factor in --map" if fits else "look at the units of torque, position and time"


def _feed_constant(recording: Recording, axis: Axis, ratio: float | None) -> Iterator[Doubt]:
    """A second sensor against the motor: feed constant, gearbox ratio."""
    if recording.side == "load":
        return
    if recording.cart_position_m is not None:
        measured = _slope(recording.position, recording.cart_position_m)
        if ratio is not None and measured is not None and abs(measured / ratio - 1.0) > _AGREE:
            yield Doubt(
                "the feed constant, carriage against motor", f"{1e3 * math.tau * measured:.5g} mm per revolution",
                f"{1e3 * math.tau * ratio:.5g} mm by pulley.effective_radius_m and gearbox.ratio of {axis}",
                _ratio_words(measured / ratio, "cart_position_m"),
            )  # fmt: skip
    if recording.load_position_rad is not None:
        measured, expected = _slope(recording.position, recording.load_position_rad), 1.0 / axis.gearbox.ratio
        if measured is not None and abs(measured / expected - 1.0) > _AGREE:
            yield Doubt(
                "the angle of the load against the motor's", f"1:{1.0 / measured:.5g}", f"1:{axis.gearbox.ratio:g} by gearbox.ratio",
                _ratio_words(measured / expected, "load_position_rad"),
            )  # fmt: skip


def _ratio_words(quotient: float, column: str) -> str:
    if quotient < 0.0:
        return f"turn the sign of {column}, --map {column}=-NAME, or of the motor's angle, --flip position"
    for factor, words in ((1e3, "is in mm"), (1e-3, "is 1000 times too small"), (180.0 / math.pi, "is in degrees")):
        if abs(quotient / factor - 1.0) < 0.2:
            return f"{column} {words}: correct its factor in --map"
    return "correct the axis file, or the factor of the column in --map"


def _slope(cause: Array, effect: Array) -> float | None:
    """Slope of a line through two signals; None when they are no line."""
    x, y = cause - cause.mean(), effect - effect.mean()
    power = float(x @ x), float(y @ y)
    if min(power) <= 0.0 or (x @ y) ** 2 < 0.9 * power[0] * power[1]:
        return None
    return float(x @ y) / power[0]


def _travel(recording: Recording, axis: Axis, ratio: float | None) -> Iterator[Doubt]:
    low, high, limit = axis.travel.min_m, axis.travel.max_m, axis.limits.speed_m_s
    if ratio is None:
        return
    moved = ratio * float(np.ptp(recording.position))
    column = CHANNELS[recording.side]["position"]
    if low is not None and high is not None and moved < 1e-4 * (high - low):
        yield Doubt(
            "the travel", f"{1e3 * moved:.3g} mm", f"more than a ten-thousandth of the axis's {high - low:g} m",
            f"look at the unit of {column} (revolutions? m?)",
        )  # fmt: skip
    fastest = ratio * float(np.percentile(np.abs(np.diff(recording.position) / np.diff(recording.t_s)), 99.0))
    if limit is not None and fastest > 1.5 * limit:
        yield Doubt(
            "the carriage's speed", f"{fastest:.4g} m/s", f"at most {limit:g} m/s by limits.speed_m_s of {axis}",
            f"look at the units of {column} (degrees? counts?) and of time",
        )  # fmt: skip


def _velocity(recording: Recording) -> Iterator[Doubt]:
    """The velocity column against the difference quotient of the position, over a hundred windows."""
    if recording.velocity is None or np.ptp(recording.velocity) == 0.0:
        return
    cuts = np.unique(np.linspace(0, len(recording.t_s) - 1, 101).astype(int))
    steps = 0.5 * (recording.velocity[1:] + recording.velocity[:-1]) * np.diff(recording.t_s)
    travel, integral = np.diff(recording.position[cuts]), np.diff(np.concatenate(([0.0], np.cumsum(steps)))[cuts])
    power = float(travel @ travel), float(integral @ integral)
    channels = CHANNELS[recording.side]
    if min(power) <= 0.0:
        return
    likeness = float(travel @ integral) / math.sqrt(power[0] * power[1])
    if likeness < 0.5:
        yield Doubt(
            f"the likeness of {channels['velocity']} to the change of {channels['position']}", f"{likeness:.2f}", "nearly 1",
            "one of the two is another signal (a setpoint? another axis?): map the right one, or leave the velocity out",
        )  # fmt: skip
    elif abs(math.sqrt(power[1] / power[0]) - 1.0) > _AGREE and likeness > _ALIKE:
        yield Doubt(
            f"{channels['velocity']} over the change of {channels['position']}", f"{math.sqrt(power[1] / power[0]):.4g}", "1",
            "correct the factor of the one that is wrong (per minute? filtered?)",
        )  # fmt: skip


def _one_way(recording: Recording) -> Iterator[Doubt]:
    """A motion that goes one way all the time and does work on its torque: friction and a weight are not told apart there, nor is time."""
    steps = np.diff(recording.position[:: max(1, len(recording.position) // _LOOKS)])
    if abs(float(steps.sum())) < _ONE_WAY * float(np.abs(steps).sum()):
        return
    work = 0.5 * (recording.torque[1:] + recording.torque[:-1]) * np.diff(recording.position)
    share = float(work.sum()) / max(float(np.abs(work).sum()), 1e-300)
    if share < -_HELD_BACK:
        yield Doubt(
            f"the work of {CHANNELS[recording.side]['torque']} in a motion that goes one way",
            f"{100.0 * share:.0f} % of all that goes to and fro", "a positive one, which friction takes up",
            "a weight that drives does so, and so do a wrong sign and rows in the wrong order of time: turn what is wrong (--flip torque), "
            "or record the way back as well",
        )  # fmt: skip


def _in_tenths(torque: Array) -> bool:
    """True for numbers with one decimal."""
    return bool(np.all(np.abs(10.0 * torque - np.round(10.0 * torque)) < 1e-6))


def _torque_levels(recording: Recording, axis: Axis) -> Iterator[Doubt]:
    """A torque in whole numbers is in thousandths, per cent or counts; in tenths per cent, where no rating tells."""
    if recording.side == "load":
        return
    torque, column = recording.torque, CHANNELS[recording.side]["torque"]
    highest, levels = float(np.abs(torque).max()), len(np.unique(torque))
    unknown = axis.motor.peak_torque_nm is None
    if unknown and highest >= 10.0 and levels > 3 and bool(np.all(torque == np.round(torque))):
        yield Doubt(
            column, f"in whole numbers up to {highest:g}", "N m with decimals",
            f"it looks like thousandths of a rated torque or a converter's counts: --map {column}=NAME*RATED/1000",
        )  # fmt: skip
    elif (
        unknown
        and recording.side == "motor"
        and axis.motor.rated_torque_nm is None
        and highest >= _PER_CENT
        and levels > 3
        and _in_tenths(torque)
    ):
        yield Doubt(
            column, f"in steps of 0.1 up to {highest:.4g}", "N m with more decimals",
            f"per cent of a rated torque have such steps: --map {column}=NAME*RATED/100, and an axis file with motor.rated_torque_nm tells",
        )  # fmt: skip
    rated = axis.motor.rated_torque_nm
    if rated is not None and axis.motor.peak_torque_nm is None and recording.side == "motor" and highest > _MOST_RATED * rated:
        yield Doubt(
            "the largest torque_nm", f"{highest:.4g} N m", f"at most {_MOST_RATED:g} times the rated {rated:g} N m",
            "look at its unit (thousandths? per cent of rated?) and at motor.rated_torque_nm",
        )  # fmt: skip
    if rated is not None and recording.side == "motor" and float(np.ptp(torque)) < 2e-3 * rated:
        yield Doubt(
            "the torque's range", f"{np.ptp(torque):.3g} N m", f"more than two thousandths of the rated {rated:g} N m",
            "look at its factor (a share of rated instead of N m?)",
        )  # fmt: skip
