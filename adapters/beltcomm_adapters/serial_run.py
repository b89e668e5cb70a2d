"""Strokes of a drive that is looked at now and then: handed over one by one, polled, watched, and stopped.

Nothing guards the drive over RS-232.  So it is never told to turn, only to go somewhere inside the window and rest there: when the host
or the cable is gone, it ends the stroke by itself and holds the axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from beltcomm.drive import Clock, Limits, Row, Sink
from beltcomm.errors import BusError, DriveError, SafetyStop
from beltcomm_adapters.cia402 import (
    ENABLE_OPERATION,
    FAULTED,
    INTERNAL_LIMIT,
    NEW_SETPOINT,
    SETPOINT_TAKEN,
    TARGET_REACHED,
    State,
    StateMachine,
    state_of,
)
from beltcomm_adapters.exchange import Sample
from beltcomm_adapters.motion import TOLERATED_LOSSES, Report
from beltcomm_adapters.preparation import lend_mode, lend_quick_stop, tighten_torque_and_speed, tighten_window
from beltcomm_adapters.profiles import Profile
from beltcomm_adapters.scaling import Scaling
from beltcomm_adapters.sdo import Lending
from beltcomm_adapters.serial_objects import SerialObjects
from beltcomm_adapters.serial_strokes import SerialStroke, Trapezoid
from beltcomm_adapters.watch import LimitWatch

PROFILE_POSITION: Final = 1
_INT32: Final = 2**31 - 1
#: Speed, acceleration and deceleration of a stroke.
_STROKE_PARAMETERS: Final = (0x6081, 0x6083, 0x6084)
#: What is asked for in every poll: statusword, position, torque, velocity.
_POLLED: Final = ((0x6041, "uint16"), (0x6064, "int32"), (0x6077, "int16"), (0x606C, "int32"))
#: A polling period is so many times as long as the slowest poll that was seen, and a multiple of the step, s.
_PERIOD_SHARE: Final = 1.25
_PERIOD_STEP_S: Final = 0.005
#: An answer that takes this many times as long as the slowest is lost.
_PATIENCE: Final = 2.0
_MEASURED: Final = 8
#: s after its time in which a stroke must have reached its target, and time constants of a position loop that follows late.
_ARRIVAL_TIME_S: Final = 2.0
_ARRIVAL_CONSTANTS: Final = 10.0


@dataclass(frozen=True)
class LineSpeed:
    """Speed of this line.

    Attributes
    ----------
    period_s : float
        Of polling.
    patience_s : float
        After which an answer is lost, beside its characters.
    """

    period_s: float
    patience_s: float


def measure_pace(objects: SerialObjects, clock: Clock) -> LineSpeed:
    """The polling period that this drive, cable and computer allow, from some reads.

    Parameters
    ----------
    objects : SerialObjects
        Over RS-232.
    clock : Clock

    Raises
    ------
    BusError
        When too few are answered.
    """
    times: list[float] = []
    for _ in range(2 * _MEASURED):
        begun_s = clock.now()
        if objects.poll(0x6064, "int32") is not None:
            times.append(clock.now() - begun_s)
        if len(times) == _MEASURED:
            slowest_s = max(times)
            steps = math.ceil(len(_POLLED) * slowest_s * _PERIOD_SHARE / _PERIOD_STEP_S - 1e-6)
            return LineSpeed(max(steps, 1) * _PERIOD_STEP_S, _PATIENCE * slowest_s)
    raise BusError(f"of {2 * _MEASURED} reads only {len(times)} were answered; check the cable and its shield")


def prepare(
    objects: SerialObjects, lending: Lending, machine: StateMachine, profile: Profile, scaling: Scaling, limits: Limits, period_s: float
) -> None:
    """Mode 1, the target where the axis stands, limits inside the drive, trapezoids; everything but the target is lent.

    Parameters
    ----------
    objects : SerialObjects
        Over RS-232.
    lending : Lending
    machine : StateMachine
        State machine of the drive.
    profile : Profile
    scaling : Scaling
    limits : Limits
    period_s : float, s
        Of polling.

    Raises
    ------
    DriveError
        For a drive whose unit of accelerations is not known.
    """
    lend_mode(objects, lending, machine, PROFILE_POSITION)
    lending.set_if_there(0x6086, 0, "int16", 0)
    if not lend_quick_stop(objects, lending, scaling, limits):
        raise DriveError(
            "the drive does not tell what its accelerations count in (60AAh), and its own quick stop (6085h) makes no sense in the usual "
            "unit, so no stroke can be told to it; state acceleration_unit in a profile (--profile)"
        )
    tighten_torque_and_speed(objects, lending, profile, scaling, limits)
    tighten_window(objects, lending, scaling, limits, period_s)
    if limits.lag_rad is not None:
        lending.set_if_there(0x6065, 0, "uint32", min(math.ceil(limits.lag_rad / scaling.position_rad), _INT32))
    for index in _STROKE_PARAMETERS:
        lending.keep(index, 0, "uint32")
    objects.write(0x607A, 0, "int32", objects.read_int(0x6064, 0, "int32"))


class PolledRun:
    """One enabled stretch.

    Parameters
    ----------
    limits : Limits
        Watched on the host in every poll.
    sink : Sink
        Gets a row of every poll.
    lag_1_s : float
        Gain of a position loop that follows late because it has no velocity feedforward, 1/s; infinite for one that has.
    """

    def __init__(
        self,
        objects: SerialObjects,
        machine: StateMachine,
        scaling: Scaling,
        limits: Limits,
        clock: Clock,
        pace: LineSpeed,
        sink: Sink,
        lag_1_s: float = math.inf,
    ) -> None:
        self._objects, self._machine, self._scaling = objects, machine, scaling
        self._clock, self._pace, self._sink = clock, pace, sink
        self._limits = limits
        self._watch = self._new_watch()
        self._arrival_s = _ARRIVAL_TIME_S + (_ARRIVAL_CONSTANTS / lag_1_s if lag_1_s > 0.0 else 0.0)
        self._next_s = clock.now()
        self._start_s = self._before_s = math.nan
        self._rows = self._lost = self._lost_in_a_row = self._limited = 0
        self._jitter_s = 0.0
        self._told: dict[int, int] = {}
        #: Where the stroke under way ends, rad; where the axis stands when there is none.
        self.end_rad = math.nan

    def follow(self, strokes: list[SerialStroke], rest_s: float) -> Report:
        """One stroke after the other.

        Parameters
        ----------
        strokes : list of SerialStroke
        rest_s : float
            After the last.

        Raises
        ------
        SafetyStop, DriveFault, DriveError, BusError
        """
        for stroke in strokes:
            self._hand_over(stroke)
            self._drive(stroke)
        self._rest(strokes[-1].path.end_rad, rest_s)
        return Report(self._rows, self._lost, self._jitter_s, self._limited)

    def _hand_over(self, stroke: SerialStroke) -> None:
        """Tell the drive a stroke while the axis rests, a part after each poll, and rest as long as it shall."""
        end_s = self._clock.now() + stroke.rest_s
        values = (stroke.end, stroke.speed, stroke.acceleration, stroke.acceleration)
        parts = zip((0x607A, *_STROKE_PARAMETERS), ("int32", "uint32", "uint32", "uint32"), values, strict=True)
        for index, kind, value in ((0x6040, "uint16", ENABLE_OPERATION), *parts):
            if self._told.get(index) != value:
                self._told[index] = value
                self._objects.write(index, 0, kind, value)
                self._rest(stroke.path.start_rad, 0.0)
        self._rest(stroke.path.start_rad, end_s - self._clock.now())

    def _rest(self, at_rad: float, seconds: float) -> None:
        """Poll the axis where it stands, at least once."""
        self.end_rad = at_rad
        resting, end_s = Trapezoid(at_rad, at_rad, 1.0, 1.0), self._clock.now() + seconds
        self._cycle(resting, 0.0, 0.0)
        while self._clock.now() < end_s:
            self._cycle(resting, 0.0, 0.0)

    def _drive(self, stroke: SerialStroke) -> None:
        """Let the drive begin, and look on until it has arrived."""
        path, begun_s = stroke.path, self._clock.now()
        self.end_rad = path.end_rad
        self._told[0x6040] = ENABLE_OPERATION | NEW_SETPOINT
        self._objects.write(0x6040, 0, "uint16", ENABLE_OPERATION | NEW_SETPOINT)
        told_s = self._clock.now()
        start_s, doubt_s = 0.5 * (begun_s + told_s), 0.5 * (told_s - begun_s) + self._pace.patience_s / _PATIENCE
        taken = False
        while True:
            sample = self._cycle(path, start_s, doubt_s)
            if sample is None:
                continue
            if not (taken or sample.statusword & SETPOINT_TAKEN):
                raise DriveError(
                    "the drive did not take its target (statusword bit 12 is 0); the axis was stopped; check its mode and limits"
                )
            taken = True
            late_s = sample.stamp_s - start_s - doubt_s - path.duration_s
            if late_s > 0.0 and sample.statusword & TARGET_REACHED:
                return
            if late_s > self._arrival_s:
                off = path.end_rad - sample.position * self._scaling.position_rad
                raise SafetyStop(
                    f"the drive is {self._watch.in_words(abs(off))} away from its target {self._arrival_s:.2g} s after it should have "
                    "arrived; the axis was stopped; it sticks, or the gains in the drive are too weak for its friction",
                    "lag",
                )

    def _cycle(self, path: Trapezoid, start_s: float, doubt_s: float) -> Sample | None:
        """One poll at its time: watched, and a row made.   doubt_s : of the time at which the path began.   None: an answer was lost."""
        self._clock.sleep_until(self._next_s)
        self._next_s = max(self._next_s, self._clock.now() - self._pace.period_s) + self._pace.period_s
        sample = self._poll()
        if sample is None:
            self._lost += 1
            self._lost_in_a_row += 1
            if self._lost_in_a_row > TOLERATED_LOSSES:
                raise BusError(f"the drive has not answered {self._lost_in_a_row} times in a row while moving; check the cable")
            return None
        self._lost_in_a_row = 0
        t_s = sample.stamp_s - start_s
        try:
            self._judge(sample, path, t_s, doubt_s)
        except (SafetyStop, DriveError):  # a digit may have been spoilt, which nothing on the line shows: a second look must say the same
            again = self._poll()
            if again is None:
                raise
            sample, t_s = again, again.stamp_s - start_s
            self._watch = self._new_watch()
            self._judge(sample, path, t_s, doubt_s)
            self._lost += 1
        self._limited += bool(sample.statusword & INTERNAL_LIMIT)
        slow, fast = path.at(t_s - doubt_s)[1], path.at(t_s + doubt_s)[1]
        self._row(sample, path.at(t_s)[0], 0.5 * (slow + fast))
        return sample

    def _judge(self, sample: Sample, path: Trapezoid, t_s: float, doubt_s: float) -> None:
        """Raises what a sample gives reason for.   t_s : since the path began, known to ``doubt_s``."""
        if sample.statusword & FAULTED:
            raise self._machine.fault("moving")
        if (state := state_of(sample.statusword)) is not State.OPERATION_ENABLED:
            raise DriveError(
                f"the drive left Operation Enabled while moving and is in {state.words}; the axis was stopped; check STO, the enable "
                "inputs and the limit switches"
            )
        self._watch.check(sample)
        early, late = path.at(t_s - doubt_s)[0], path.at(t_s + doubt_s)[0]
        unit = self._scaling.position_rad
        near = min(max(sample.position * unit, min(early, late)), max(early, late))
        self._watch.follow(sample, round(near / unit))

    def _new_watch(self) -> LimitWatch:
        return LimitWatch(self._limits, self._scaling, self._pace.period_s)

    def _row(self, sample: Sample, reference_rad: float, reference_rad_s: float) -> None:
        """Pass on a row of :data:`beltcomm.drive.COLUMNS`; the reference's speed is the plateau's only where that is sure."""
        scaling = self._scaling
        if self._rows == 0:
            self._start_s = sample.stamp_s
        else:
            self._jitter_s = max(self._jitter_s, abs(sample.stamp_s - self._before_s - self._pace.period_s))
        self._before_s = sample.stamp_s
        row: Row = (
            sample.stamp_s - self._start_s,
            sample.torque * scaling.torque_nm,
            math.nan,
            sample.position * scaling.position_rad,
            sample.velocity * scaling.speed_rad_s,
            reference_rad,
            reference_rad_s,
            math.nan,
        )
        self._rows += 1
        self._sink(row)

    def _poll(self) -> Sample | None:
        found: list[int] = []
        stamp_s = 0.0
        for index, kind in _POLLED:
            answer = self._objects.poll(index, kind)
            if answer is None:
                return None
            found.append(answer[0])
            if index == 0x6064:
                stamp_s = answer[1]
        statusword, position, torque, velocity = found
        return Sample(stamp_s, position, torque, statusword, velocity, None)
