"""The strokes of a friction sweep, which speeds over which way, and the six orders of the measurement (3.6): in which order and records."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from beltcomm.axis import Axis
from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.errors import Refused, UsageError
from beltcomm.identify.friction import SWEEP_SLOWEST_M_S
from beltcomm.thesis.friction import REPEATS, SHUFFLED
from beltcomm.trajectory import Strokes, Trajectory, constant_speed_strokes, join, ramp_length_m

#: Name of the sweep without an order.
DEFAULT = "default"
Which = Literal["twice", "once", "again"]

#: Friction sweep: number of speeds, run-in left out, shortest and longest plateau that counts.
SWEEP_SPEEDS = 7
SWEEP_RUN_IN_S = 0.2
SWEEP_SHORTEST_S = 0.1
SWEEP_LONGEST_S = 0.6
#: Rows a plateau must hold behind its run-in, for the mean of each of its batches; slowly polled drives need longer ones for that.
PLATEAU_ROWS = 20


def fastest_stroke_m_s(limits: TrajectoryLimits, window_m: float, plateau_s: float = SWEEP_SHORTEST_S) -> float:
    """Fastest stroke of a sweep, m/s, that still has a plateau:  v²/a + v (a/j + plateau) = window,  at most a share of the top speed.

    Two ramps of v (v/a + a/j)/2 each and a plateau with its run-in fill the window.

    Parameters
    ----------
    limits : TrajectoryLimits
        Of the carriage.
    window_m : float, m
        Way there is.
    plateau_s : float, s
        At constant speed, behind the run-in.
    """
    acceleration = limits.acceleration_m_s2
    wait = acceleration / limits.jerk_m_s3 + SWEEP_RUN_IN_S + plateau_s
    filled = 0.5 * acceleration * (np.sqrt(wait**2 + 4.0 * window_m / acceleration) - wait)
    return min(0.8 * limits.speed_m_s, float(filled))


def sweep_strokes(
    at_m: float,
    far_m: float,
    limits: TrajectoryLimits,
    period_s: float,
    which: Which = "twice",
    speeds_m_s: Sequence[float] = (),
    settle_s: float = 0.0,
    longest_s: float = SWEEP_LONGEST_S,
) -> Strokes:
    """Strokes both ways at seven speeds, from a slow creep to the fastest that still has a plateau within the travel.

    Parameters
    ----------
    at_m, far_m : float, m
        Ends of the strokes, the first one's start first.
    limits : TrajectoryLimits
        Of the carriage.
    period_s : float, s
        Of the drive.
    which : Which
        Three of the seven twice, each once, or two of them again, for how well friction repeats.
    speeds_m_s : sequence of float
        Instead of the seven; all slower in proportion where the fastest cannot be had.
    settle_s : float, s
        That the axis takes beside the run-in until it is as fast as its reference.
    longest_s : float, s
        Plateau that counts.
    """
    shortest_s = max(SWEEP_SHORTEST_S, PLATEAU_ROWS * period_s)
    fastest = fastest_stroke_m_s(limits, abs(far_m - at_m), shortest_s + settle_s)
    digit = 10.0 ** (np.floor(np.log10(fastest)) - 1.0)
    fastest = float(np.floor(fastest / digit) * digit)  # the carriage never begins at quite the same place, repeats need equal speeds
    speeds = [float(v) for v in np.geomspace(SWEEP_SLOWEST_M_S, fastest, SWEEP_SPEEDS)]
    speeds = {"twice": speeds + speeds[1::2], "once": speeds, "again": speeds[3::2]}[which]
    if speeds_m_s:
        speeds = [v * min(1.0, fastest / max(speeds_m_s)) for v in speeds_m_s]
    run_in_s = SWEEP_RUN_IN_S + settle_s
    given = {"run_in_s": run_in_s, "rest_s": 0.15, "longest_plateau_s": run_in_s + max(longest_s, 1.5 * shortest_s)}
    return constant_speed_strokes(at_m, far_m, speeds, limits, period_s, **given)


Order = Literal["I", "II", "III", "IV", "V", "VI", "all"]
ORDERS = get_args(Order)
#: What ``all`` drives: V and VI are order I on another day and with a payload.
ALL: tuple[Order, ...] = ("I", "II", "III", "IV")
WORDS = {
    "I": "slowest first",
    "II": "fastest first",
    "III": "in the sequence of table A.1",
    "IV": "slowest first, each speed several times before the next",
    "V": "as I, on an axis in use for long",
    "VI": "as I, with a payload mounted",
    "default": "seven speeds, three of them twice",
}
#: s of a plateau behind its run-in, at least where the way is there; a whole turn of the pulley may take as long as the second.
PLATEAU_S, TURN_S = 0.6, 1.6
REST_S = 0.15
#: s: longest record.  A file of a quarter of an hour helps nobody, and what is recorded when something breaks off is kept.
RECORD_S = 120.0
#: Repetitions beyond which somebody has mistyped.
MOST_REPEATS = 100


@dataclass(frozen=True)
class Wanted:
    """Sweeps of a call.

    Attributes
    ----------
    sweeps : tuple of tuple[str, int]
        Order and repetition of each, in the order in which they are driven.
    often : int
        Of each speed in IV.
    mounted_kg : float or None
        Payload that the records state, None when nobody said.
    """

    sweeps: tuple[tuple[str, int], ...]
    often: int
    mounted_kg: float | None = None

    @property
    def plain(self) -> bool:
        """The one sweep of before, with nothing to say about it."""
        return self.sweeps == ((DEFAULT, 1),)


@dataclass(frozen=True)
class Stroke:
    """Stroke driven at a speed.

    Attributes
    ----------
    way : str
        In words.
    plateau_s : float
        Behind the run-in.
    length_m : float
        From turn to turn.
    """

    speed_m_s: float
    way: str
    plateau_s: float
    length_m: float


def sweep_orders(order: str | None, repeat: int | None, mounted_kg: float | None) -> Wanted:
    """Sweeps that options ask for.

    Parameters
    ----------
    order : str or None
        "I" to "VI"; None for the usual sweep.
    repeat : int or None
        Times that each is driven; None for once.
    mounted_kg : float or None, kg
        Payload; None where nothing is stated.

    Raises
    ------
    UsageError
        For an order that is none, no repetition, or VI without a payload.
    """
    if order is not None and order not in ORDERS:
        raise UsageError(f"there is no order {order!r}; the orders are {', '.join(ORDERS)} (thesis 3.6)")
    if repeat is not None and not 1 <= repeat <= MOST_REPEATS:
        raise UsageError(f"the sweep cannot be driven {repeat} times; give 1 to {MOST_REPEATS}")
    if mounted_kg is not None and not (0.0 <= mounted_kg < math.inf):
        raise UsageError(f"a payload of {mounted_kg:g} kg cannot be mounted; give 0 or more")
    if order == "VI" and not mounted_kg:
        raise UsageError("order VI is order I with a payload on the carriage: mount it and say how heavy it is, --payload-mounted KG")
    times = repeat or 1
    orders: Sequence[str] = ALL if order == "all" else (order or DEFAULT,)
    sweeps = [(o, k) for o in orders for k in range(1, 1 + (1 if o == "IV" else times))]
    return Wanted(tuple(sweeps), repeat or REPEATS, mounted_kg)


def speeds_of(order: str, often: int) -> tuple[float, ...]:
    """Speeds of table A.1, m/s, as an order drives them.

    Parameters
    ----------
    order : str
        "I" to "IV".
    often : int
        Times that order IV repeats each speed.
    """
    up = sorted(SHUFFLED)
    if order == "II":
        return tuple(up[::-1])
    if order == "III":
        return tuple(SHUFFLED)
    return tuple(v for v in up for _ in range(often if order == "IV" else 1))


def _stroke_at(speed_m_s: float, room_m: float, limits: TrajectoryLimits, axis: Axis) -> Stroke | None:
    """The stroke at a speed; None where the way does not even hold the shortest plateau.

    A plateau holds whole turns of the pulley where one fits into the way and lasts no longer than ``TURN_S``, so that its runout is
    averaged away; else whole teeth of the belt; else it is just long enough.
    """
    ramps = 2.0 * ramp_length_m(speed_m_s, limits) + speed_m_s * SWEEP_RUN_IN_S
    free = room_m - ramps
    if speed_m_s > limits.speed_m_s or free < speed_m_s * SWEEP_SHORTEST_S:
        return None
    turn = 2.0 * math.pi * (axis.pulley.effective_radius_m or math.inf) if axis.pulley is not None else math.inf
    pitch = (axis.belt.pitch_m if axis.belt is not None else None) or math.inf
    for unit, word, longest_s in ((turn, "turn of the pulley", TURN_S), (pitch, "tooth of the belt", math.inf)):
        if math.isinf(unit) or unit > min(free, longest_s * speed_m_s):
            continue
        count = min(math.ceil(PLATEAU_S * speed_m_s / unit - 1e-9), math.floor(free / unit + 1e-9))
        length = count * unit
        if length >= speed_m_s * SWEEP_SHORTEST_S:
            words = word if count == 1 else word.replace("turn", "turns").replace("tooth", "teeth")
            return Stroke(speed_m_s, f"{count} {words}", length / speed_m_s, ramps + length)
    length = min(free, PLATEAU_S * speed_m_s)
    return Stroke(speed_m_s, f"{1e3 * length:.3g} mm", length / speed_m_s, ramps + length)


def strokes_for(
    speeds_m_s: Sequence[float], room_m: float, limits: TrajectoryLimits, axis: Axis
) -> tuple[tuple[Stroke, ...], tuple[float, ...]]:
    """Strokes in the order of the speeds, and the speeds for which there is no way.

    Parameters
    ----------
    speeds_m_s : sequence of float, m/s
        Of the carriage.
    room_m : float, m
        Way there is.
    limits : TrajectoryLimits
        Of the carriage.
    axis : Axis

    Raises
    ------
    Refused
        Where there is none for any two.
    """
    found = [_stroke_at(v, room_m, limits, axis) for v in speeds_m_s]
    left_out = tuple(sorted({v for v, s in zip(speeds_m_s, found, strict=True) if s is None}))
    strokes = tuple(s for s in found if s is not None)
    if len({s.speed_m_s for s in strokes}) < 2:
        raise Refused(
            f"no sweep is possible: of {len(set(speeds_m_s))} speeds {len({s.speed_m_s for s in strokes})} fit into a way of "
            f"{1e3 * room_m:.0f} mm with {limits.acceleration_m_s2:.3g} m/s² and at most {limits.speed_m_s:.3g} m/s; check travel and "
            "limits in axis.yaml"
        )
    return strokes, left_out


def path_of(strokes: Sequence[Stroke], at_m: float, far_m: float, limits: TrajectoryLimits, period_s: float) -> Trajectory:
    """One stroke forth and one back at each speed, from where the carriage stands.

    Parameters
    ----------
    strokes : sequence of Stroke
        Of one record.
    at_m : float, m
        Where the carriage stands.
    far_m : float, m
        Other end of the longest stroke.
    limits : TrajectoryLimits
        Of the carriage.
    period_s : float, s
        Of the drive.
    """
    parts = []
    for stroke in strokes:
        given = {"run_in_s": SWEEP_RUN_IN_S, "rest_s": REST_S, "longest_plateau_s": SWEEP_RUN_IN_S + stroke.plateau_s}
        parts.append(constant_speed_strokes(at_m, far_m, [stroke.speed_m_s], limits, period_s, **given).trajectory)
    return join(parts)


def seconds_of(stroke: Stroke, limits: TrajectoryLimits) -> float:
    """Duration of a stroke forth and back, s, to a few per cent on the long side.

    Parameters
    ----------
    stroke : Stroke
        With its plateau.
    limits : TrajectoryLimits
        Of the carriage.
    """
    v, a, j = stroke.speed_m_s, limits.acceleration_m_s2, limits.jerk_m_s3
    ramp = 2.0 * math.sqrt(v / j) if a * a >= v * j else v / a + a / j
    return 2.0 * (2.0 * ramp + SWEEP_RUN_IN_S + stroke.plateau_s + REST_S) + REST_S


def records_of(strokes: Sequence[Stroke], limits: TrajectoryLimits, longest_s: float = RECORD_S) -> list[tuple[Stroke, ...]]:
    """The strokes of a sweep, cut into records of at most ``longest_s``.

    Parameters
    ----------
    strokes : sequence of Stroke
        In their order.
    limits : TrajectoryLimits
        Of the carriage.
    longest_s : float, s
        Of a record with more than one stroke.
    """
    records: list[list[Stroke]] = [[]]
    seconds = 0.0
    for stroke in strokes:
        seconds += seconds_of(stroke, limits)
        if seconds > longest_s and records[-1]:
            records.append([])
            seconds = seconds_of(stroke, limits)
        records[-1].append(stroke)
    return [tuple(record) for record in records]
