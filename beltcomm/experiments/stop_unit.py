"""A quick stop out of slow travel: how long the drive's ramp takes tells what its decelerations count in, where the drive does not.

Two strokes, forth and back, are each broken off by a quick stop that is to take ``RAMP_S``.  They are so slow that the belt bears even a
motor that stands at once,

    v √(c m) + F_c  ≤  the share of the belt's force that excitations have,

and a stop that takes no end is watched for ``WATCHED_S`` only, then the stage is taken off.  The drive ends a quick stop by itself when its
ramp has ended, so the time until then tells the ramp, however weak the loop is that follows it, and wherever friction stops the carriage.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from beltcomm.axis import Axis
from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.drive import Capabilities, Limits, ObservedStop, Row
from beltcomm.errors import DriveError, Refused, SafetyStop
from beltcomm.experiments import phases
from beltcomm.experiments.bounds import Experiment, stroking_nm
from beltcomm.experiments.recentre import stands
from beltcomm.machine.closed_loop_watch import foreseen, within
from beltcomm.machine.creep import Enough
from beltcomm.machine.machine import Envelope, Machine, stroking
from beltcomm.model import Model
from beltcomm.trajectory import at_rest, plan_trajectory

#: s: a stop that is as meant takes so long; so long it is watched.
RAMP_S, WATCHED_S = 0.5, 2.3
#: A ramp so many times shorter or longer contradicts what its deceleration counts in; s that a drive may need beside it to see standstill.
FACTOR, BESIDE_S = 3.0, 0.25
#: s: ramp to the speed, longest travel at it, travel at it from which it counts and over which it is a mean.
RISE_S, STEADY_S, SETTLE_S, MEAN_S = 0.2, 0.8, 0.3, 0.1
#: m/s: fastest and slowest such stroke.   Shares of the speed asked for between which the speed reached is taken.
FASTEST_M_S, SLOWEST_M_S, REACHED = 0.05, 4e-3, (0.6, 1.2)
#: Encoder counts in the mean of the speed without which it is none.
FEWEST_COUNTS = 20
#: s from a stage that was taken off to an axis that is held.
HELD_S = 0.5
#: m beside the ways that are counted with.
SPARE_M = 2e-3
#: m: off its reference by more than this and by ``LAG_S`` of its way the loop does not follow.
SLACK_M, LAG_S = 2e-3, 0.5
#: m/s: less is standstill.
STILL_M_S = 1e-3
#: Reasons of a stop that a loop gives which does not follow.
LOOP = ("lag", "position", "speed")
#: Quick stop option code.
_OPTION = 0x605A

Kind = Literal["as meant", "steeper", "flatter", "untold"]


@dataclass(frozen=True)
class SlowStop:
    """Outcome of one stop.

    Attributes
    ----------
    kind : Kind
        What its ramp was.
    why : str
        In words, why it tells nothing.
    speed_m_s, meant_m_s2 : float
        From which, and with which deceleration it was to brake.
    took_s : float
        Until the drive ended it, or for how long it was watched.
    """

    kind: Kind
    why: str = ""
    speed_m_s: float = 0.0
    meant_m_s2: float = 0.0
    took_s: float = 0.0

    @property
    def meant_s(self) -> float:
        """Length of the ramp that was meant, s."""
        return self.speed_m_s / self.meant_m_s2


def _judge(stop: ObservedStop, speed_m_s: float, meant_m_s2: float, ratio: float, brake_s: float = 0.0, *, ends: bool = True) -> SlowStop:
    """Hold the course of a stop from a positive speed against the ramp that was meant; a holding brake may take ``brake_s`` before the
    drive ends it.

    ``ends``: the drive ends a stop by itself; else only a carriage that goes on tells anything.
    """
    t_s, place = np.array(stop.t_s), ratio * np.array(stop.position_rad)
    meant_s = speed_m_s / meant_m_s2
    late = t_s > t_s[-1] - MEAN_S
    last_m_s = float(np.ptp(place[late]) / np.ptp(t_s[late])) if np.count_nonzero(late) > 1 else 0.0
    longest_s = FACTOR * meant_s + BESIDE_S + brake_s

    def seen(kind: Kind, took_s: float, why: str = "") -> SlowStop:
        return SlowStop(kind, why, speed_m_s, meant_m_s2, took_s)

    if stop.ended_s is None:
        if t_s[-1] < longest_s:
            return seen("untold", float(t_s[-1]), "the stop was not watched for long enough")
        if last_m_s > max(STILL_M_S, 0.1 * speed_m_s) or ends:
            return seen("flatter", float(t_s[-1]))
        return seen("untold", float(t_s[-1]), "the drive does not end its quick stop by itself (605Ah)")
    if stop.ended_s > longest_s:
        return seen("flatter", stop.ended_s)
    if meant_s < 0.5 * RAMP_S:
        return seen("untold", stop.ended_s, f"the flattest ramp that the unit allows, {meant_s:.2g} s, is hardly told from a stop at once")
    if stop.ended_s < meant_s / FACTOR:
        return seen("steeper", stop.ended_s)
    if stop.ended_s - brake_s < meant_s / FACTOR:
        return seen("untold", stop.ended_s, f"the drive may have waited for its brake, {1e3 * brake_s:.0f} ms")
    if stop.ended_s - brake_s > meant_s + 2.0 * BESIDE_S:
        return seen("untold", stop.ended_s, "the loop in the drive follows so late that its own lag hides the ramp")
    return seen("as meant", stop.ended_s)


def is_tried(capabilities: Capabilities) -> bool:
    """True if such a stop could tell something that the drive does not.

    Parameters
    ----------
    capabilities : Capabilities
    """
    return bool(capabilities.stop_unit) and stroking(capabilities) != "profile"


def _ways_m(speed_m_s: float) -> tuple[float, float]:
    """Way of a stroke whose stop is as meant, and of one whose stop has no end, m."""
    before = speed_m_s * (0.5 * RISE_S + STEADY_S)
    return before + 0.5 * RAMP_S * speed_m_s, before + (WATCHED_S + HELD_S) * speed_m_s + SPARE_M


def line(axis: Axis, capabilities: Capabilities, window_m: tuple[float, float] | None = None) -> tuple[Experiment, ...]:
    """Line of the plan for slow stops; empty where the drive tells its unit.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    window_m : tuple of float or None, m
        To be kept, from where the carriage stands; None for the whole travel.
    """
    if not is_tried(capabilities):
        return ()
    widest = max(-window_m[0], window_m[1]) if window_m is not None else math.inf
    way, reach = (min(one, widest) for one in _ways_m(FASTEST_M_S))
    torque, force = min(axis.torque_limit_nm, capabilities.peak_torque_nm), phases.BELT_SHARE * axis.belt_force_limit_n
    title, seconds = "slow stops: what 6085h counts in", 2.0 * (RISE_S + STEADY_S + WATCHED_S)
    return (Experiment(title, way, reach, FASTEST_M_S, torque, force, seconds, stroking_nm(axis, capabilities)),)


def _speed_m_s(machine: Machine, model: Model, forth: float) -> float:
    """Speed from which even a motor that stands at once leaves the belt within its force, and which has room that way, m/s."""
    at, (low, high) = machine.position_m, machine.envelope().window_m
    room = (high - at if forth > 0.0 else at - low) - phases.END_MARGIN_M - SLACK_M - SPARE_M
    fits = (room - SPARE_M) / (_ways_m(1.0)[1] - SPARE_M + LAG_S)
    return min(FASTEST_M_S, fits, machine.envelope().speed_m_s / 4.0, _borne_m_s(machine, model))


def _borne_m_s(machine: Machine, model: Model) -> float:
    """Speed out of which a motor may stand at once, m/s; infinite where nothing gives way, for then no belt swings."""
    if model.rigid:
        return math.inf
    axis, at, (first, last) = machine.axis, machine.place_m(machine.position_m), machine.axis.travel.ends_m
    around = _ways_m(FASTEST_M_S)[1]
    places = (first, last) if at is None else (max(at - around, first), min(at + around, last))
    stiffest = max(model.get("belt_stiffness.stiffness"), *map(axis.belt_stiffness_n_m, places))
    left_n = phases.BELT_SHARE * machine.belt_left_n - model.get("cart_friction.level")
    return max(left_n, 0.0) / math.sqrt(stiffest * model["cart.mass"])


def ensure(machine: Machine, model: Model, *, again: bool = False) -> None:
    """Try two slow stops, unless the drive tells its unit or they were tried before; the carriage is about where it was.

    Parameters
    ----------
    machine : Machine
    model : Model
    again : bool
        They are tried again with a later loop where they tell nothing with this one.

    Raises
    ------
    DriveError
        When the ramp contradicts what its deceleration counts in; the axis stands.
    """
    if machine.stop_tried or not is_tried(machine.drive.capabilities) or not hasattr(machine.drive, "last_stop"):
        return
    found: list[tuple[float, SlowStop]] = []
    for _ in range(2):
        forth = -1.0 if found and found[0][0] > 0.0 else 1.0 if found else _towards_room(machine)
        try:
            seen = _stroke(machine, model, forth)
        except (SafetyStop, Refused) as problem:
            if isinstance(problem, SafetyStop) and not stands(machine):
                raise
            why = str(problem)
            if isinstance(problem, SafetyStop) and problem.reason in LOOP:
                why = f"the loop in the drive does not follow so slow a stroke ({problem.reason})"
            seen = SlowStop("untold", why)
        found.append((forth, seen))
        machine.folder.journal(_told(seen))
        if seen.kind == "untold":
            break
    kinds = {seen.kind for _, seen in found}
    seen = found[-1][1]
    if kinds in ({"steeper"}, {"flatter"}):
        raise DriveError(_contradiction(seen, machine.drive.capabilities.stop_unit))
    if kinds == {"as meant"}:
        machine.stop_tried = True
        machine.detail(f"what 6085h counts in is as meant: {_told(seen)}")
        return
    if not again:
        tell_untold(machine, seen.why or "of two stops one contradicted the other")


def tell_untold(machine: Machine, why: str) -> None:
    """Tell why no stop has shown what the drive's decelerations count in, where the drive does not tell either.

    Parameters
    ----------
    machine : Machine
    why : str
        Behind the colon of the sentence.
    """
    if is_tried(machine.drive.capabilities):
        machine.remark(
            f"no stop has shown what the quick stop (6085h) counts in, and {machine.drive.capabilities.stop_unit}: {why}; compare it with "
            "the maker's tool, for every stop is planned with it"
        )


def _towards_room(machine: Machine) -> float:
    low, high = machine.envelope().window_m
    return 1.0 if high - machine.position_m > machine.position_m - low else -1.0


def _stroke(machine: Machine, model: Model, forth: float) -> SlowStop:
    """One stroke and its stop.   Raises SafetyStop, Refused as any motion."""
    speed = _speed_m_s(machine, model, forth)
    capabilities, period = machine.drive.capabilities, machine.drive.capabilities.sample_period_s
    counts = speed / machine.ratio * capabilities.counts_per_rev / math.tau * MEAN_S
    if speed < SLOWEST_M_S or counts < FEWEST_COUNTS:
        return SlowStop("untold", f"room, belt or encoder allow no more than {1e3 * speed:.2g} mm/s, too slow to tell a ramp")
    at = machine.position_m
    rising = TrajectoryLimits(jerk_m_s3=20.0 * speed / RISE_S, acceleration_m_s2=1.2 * speed / RISE_S, speed_m_s=speed)
    way = _ways_m(speed)[1]
    path = plan_trajectory(at, at + forth * way, rising, period)
    motion, envelope = machine.follow(path, machine.stroking()), _envelope(machine, at, forth, speed)
    closed = foreseen(machine, motion)
    limits = _limits(machine, machine.drive_limits(within(envelope, closed)), speed / RAMP_S)
    meant = _meant_m_s2(machine, limits)
    if meant is None:
        return SlowStop("untold", "the drive has no quick stop that could be set (6085h)")
    if speed / meant > 1.5 * RAMP_S:
        return SlowStop("untold", f"the quick stop of the drive is set to {meant:.3g} m/s², too little for a stroke of some cm")
    rows: list[tuple[float, float]] = []
    reached: list[float] = []

    def watch(row: Row) -> None:
        closed.watch(row)
        rows.append((row[0], machine.ratio * (row[3] - machine.origin_rad)))
        begun_s = rows[0][0]
        if row[0] - begun_s < RISE_S + SETTLE_S:
            return
        lately = [one for one in rows[-2 - round(MEAN_S / period) :] if row[0] - one[0] <= MEAN_S + 0.5 * period]
        now = forth * (lately[-1][1] - lately[0][1]) / (lately[-1][0] - lately[0][0])
        if REACHED[0] < now / speed < REACHED[1]:
            reached.append(now)
            raise Enough(answered=True)
        if row[0] - begun_s > RISE_S + STEADY_S:
            raise Enough(answered=True)

    begun = machine.drive.clock.now()
    machine.let_settle()
    try:
        machine.drive.record(motion, limits, watch)
    except Enough:
        pass
    finally:
        machine.machine_seconds += machine.drive.clock.now() - begun
    stop: ObservedStop | None = getattr(machine.drive, "last_stop", None)
    _hold(machine, limits)
    if not reached:
        return SlowStop("untold", f"the loop in the drive does not bring the carriage to {1e3 * speed:.2g} mm/s")
    if stop is None:
        return SlowStop("untold", "the course of the stop was not seen")
    return _judge(stop, reached[0], meant, machine.ratio, machine.brake_s, ends=_OPTION not in capabilities.not_taken)


def _envelope(machine: Machine, at: float, forth: float, speed: float) -> Envelope:
    """Room of a stroke and of a stop that has no end, and the speed beyond which the host stops it."""
    full, (_, reach) = machine.envelope(), _ways_m(speed)
    ends = sorted((at - forth * (SLACK_M + SPARE_M), at + forth * (reach + SLACK_M + LAG_S * speed)))
    window = max(ends[0], full.window_m[0]), min(ends[1], full.window_m[1])
    lag = SLACK_M + LAG_S * speed if machine.stroking() == "position" else None
    return replace(full, window_m=window, speed_m_s=min(4.0 * speed, full.speed_m_s), lag_m=lag)


def _limits(machine: Machine, limits: Limits, deceleration_m_s2: float) -> Limits:
    return replace(limits, deceleration_rad_s2=deceleration_m_s2 / machine.ratio, stop_s=WATCHED_S + machine.brake_s)


def _meant_m_s2(machine: Machine, limits: Limits) -> float | None:
    """Deceleration that the drive is believed to make of the limits'; None where it has none that could be set, Refused where it makes a
    steeper one.
    """
    tell: Callable[[Limits], float | None] | None = getattr(machine.drive, "quick_stop_rad_s2", None)
    try:
        found = None if tell is None else tell(limits)
    except DriveError as problem:
        raise Refused(str(problem)) from problem
    return None if found is None else machine.ratio * found


def _hold(machine: Machine, limits: Limits) -> None:
    """Stop a carriage that still glides after its stage was taken off: hold it where it is, which its speed allows."""
    before = machine.position_m
    machine.drive.clock.sleep_until(machine.drive.clock.now() + MEAN_S)
    if abs(machine.position_m - before) < STILL_M_S * MEAN_S:
        return
    path = at_rest(machine.position_m, 2.0 * RAMP_S, machine.drive.capabilities.sample_period_s)
    machine.drive.record(machine.follow(path, machine.stroking()), replace(limits, stop_s=None, lag_rad=None), lambda _row: None)


def _told(seen: SlowStop) -> str:
    if seen.kind == "untold":
        return f"slow stop: {seen.why}"
    return (
        f"slow stop from {1e3 * seen.speed_m_s:.3g} mm/s with {seen.meant_m_s2:.3g} m/s² (6085h): {seen.meant_s:.2f} s were meant, the "
        f"drive took {seen.took_s:.2f} s"
    )


def _contradiction(seen: SlowStop, unit: str) -> str:
    """Sentence for a ramp that is another one than was meant."""
    steeper = seen.kind == "steeper"
    times = seen.meant_s / seen.took_s if steeper else seen.took_s / seen.meant_s
    took = f"the drive ended it after {seen.took_s:.2g} s" if steeper else f"the drive takes {seen.took_s:.2g} s or more"
    how = "harder" if steeper else "more softly"
    return (
        f"a quick stop from {1e3 * seen.speed_m_s:.3g} mm/s with {seen.meant_m_s2:.3g} m/s² (6085h) was to take {seen.meant_s:.2g} s, "
        f"{took}, so it brakes at least {times:.2g} times {how} than meant, and nothing faster is tried; {unit}: state the unit of "
        "6083h to 6085h by the maker's manual as acceleration_unit in the profile (or 60AAh in the drive), and look with the maker's tool "
        "which ramp its quick stop has (605Ah)"
    )
