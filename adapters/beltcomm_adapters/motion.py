"""A :class:`beltcomm.drive.Motion` on the wire: frames per period, watched samples, aligned rows, and the stop at the end."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from beltcomm.drive import ExchangeReport, Limits, Sink
from beltcomm.errors import BusError, DriveError, DriveFault, SafetyStop
from beltcomm_adapters.cia402 import (
    DISABLE_VOLTAGE,
    FAULTED,
    FOLLOWS,
    HOMING_ERROR,
    INTERNAL_LIMIT,
    QUICK_STOP,
    START_HOMING,
    TARGET_REACHED,
    State,
    state_of,
    step_to_enabled,
)
from beltcomm_adapters.consistency import Odometer
from beltcomm_adapters.exchange import Exchange, Sample
from beltcomm_adapters.scaling import Scaling
from beltcomm_adapters.setpoints import Frames, Layout, Setpoints

#: Cycles without an answer that a recording survives; each leaves a gap in ``t_s``.
TOLERATED_LOSSES: Final = 3
#: Share of a recording's cycles that may be lost in all; a sound bus loses none.
LOST_SHARE: Final = 0.005
ENABLE_TIME_S: Final = 3.0  # brake release included; 0.1 to 1 s are typical (G1)
STOP_TIME_S: Final = 3.0  # beyond the ramp of the quick stop
#: A drive that is silent for so long while being stopped is left to its own guarding.
SILENCE_S: Final = 0.2
#: Standstill: less than this speed over this time, motor shaft.
_STILL_RAD_S: Final = 0.1
_STILL_TIME_S: Final = 0.02
#: A reported torque may exceed the limit, at which the drive itself clamps, by its noise and its current ripple.
_TORQUE_SHARE: Final = 1.1
_TORQUE_NOISE_OF_RATED: Final = 0.02

#: Operation Enabled, as one comparison for every cycle.
_STATE_MASK: Final = 0x6F
_ENABLED_PATTERN: Final = 0x27


class Watch:
    """The limits in the drive's units; every sample is held against them.

    Speed is watched twice: as the drive reports it, and as the difference of positions.  A difference is divided by the
    elapsed time, but never by less than a period: stamps jitter, the drive's sampling does not.  ``differences`` False: only
    as reported, for homing, which moves the zero.
    """

    def __init__(self, limits: Limits, scaling: Scaling, period_s: float, differences: bool = True) -> None:
        self._limits = limits
        self._scaling = scaling
        self._differences = differences
        self._period_s = period_s
        self._lowest = limits.position_min_rad / scaling.position_rad
        self._highest = limits.position_max_rad / scaling.position_rad
        self._fastest = limits.speed_rad_s / scaling.speed_rad_s
        self._farthest = math.inf if limits.lag_rad is None else limits.lag_rad / scaling.position_rad
        self._travel_per_s = limits.speed_rad_s / scaling.position_rad
        self._strongest = (_TORQUE_SHARE * limits.torque_nm + _TORQUE_NOISE_OF_RATED * scaling.rated_torque_nm) / scaling.torque_nm
        self._before: Sample | None = None
        self._odometer = Odometer(scaling.position_rad, scaling.speed_rad_s)

    def check(self, sample: Sample) -> None:
        """Raises SafetyStop when ``sample`` breaks a limit."""
        before, self._before = self._before, sample
        if not self._lowest <= sample.position <= self._highest:
            self._stop("position", sample.position * self._scaling.position_rad, "shorten the motion; if it swings, look at the gains")
        if abs(sample.velocity) > self._fastest:
            self._stop("speed", sample.velocity * self._scaling.speed_rad_s, "reduce the amplitude; if the axis swings, look at the gains")
        if abs(sample.torque) > self._strongest:
            self._stop("torque", sample.torque * self._scaling.torque_nm, "reduce the amplitude or soften the gains")
        if before is not None and self._differences:
            travel = sample.position - before.position
            elapsed_s = max(sample.stamp_s - before.stamp_s, self._period_s)
            # one count of quantisation at either end is no speed
            if abs(travel) - 1 > self._travel_per_s * elapsed_s:
                speed = travel / elapsed_s * self._scaling.position_rad
                self._stop("speed", speed, "reduce the amplitude, or look at the encoder if its position jumped")
            self._odometer(travel, sample.velocity, elapsed_s)

    @property
    def longest_stop_s(self) -> float:
        """How long a quick stop may take, s: its ramp from the highest speed, and what a drive needs beside it."""
        return STOP_TIME_S + self._limits.speed_rad_s / self._limits.deceleration_rad_s2

    def way(self, angle_rad: float) -> str:
        """A way in words, of the carriage where its ratio is known."""
        ratio = self._limits.ratio_m_rad
        return f"{1e3 * ratio * angle_rad:.0f} mm" if ratio else f"{angle_rad:.4g} rad"

    def follow(self, sample: Sample, reference: int) -> None:
        """Raises SafetyStop when ``sample`` is too far off its reference position."""
        if abs(reference - sample.position) > self._farthest:
            off = (reference - sample.position) * self._scaling.position_rad
            self._stop("lag", off, "the axis is not the one that was counted with, or its gains do not hold it: identify again")

    def _stop(self, reason: str, value: float, remedy: str) -> None:
        """Raise SafetyStop, in terms of the carriage where its ratio is known."""
        limits = self._limits
        ratio, lag = limits.ratio_m_rad, limits.lag_rad or 0.0
        ends = (limits.position_min_rad, limits.position_max_rad)
        if reason == "torque":
            what = f"torque {value:.4g} N m at the motor is beyond the limit of {limits.torque_nm:.4g} N m"
        elif not ratio:
            limit = {
                "position": f"outside the window {ends[0]:.4g} to {ends[1]:.4g} rad",
                "speed": f"beyond the limit of {limits.speed_rad_s:.4g} rad/s",
                "lag": f"beyond the limit of {lag:.4g} rad off the reference",
            }[reason]
            what = f"{reason} {value:.4g} {'rad/s' if reason == 'speed' else 'rad'} at the motor is {limit}"
        elif reason == "position":
            at, low, high = (1e3 * ratio * (angle - limits.zero_rad) for angle in (value, *ends))
            what = f"the carriage at {at:.1f} mm is outside its window of {low:.1f} to {high:.1f} mm ({value:.4g} rad at the motor)"
        elif reason == "speed":
            what = f"the carriage's speed of {ratio * value:.3g} m/s is beyond the limit of {ratio * limits.speed_rad_s:.3g} m/s"
        else:
            what = f"the axis is {abs(1e3 * ratio * value):.3g} mm off its reference, {1e3 * ratio * lag:.3g} mm are allowed"
        raise SafetyStop(f"{what}; the axis was stopped; {remedy}", reason)


@dataclass(frozen=True)
class Report(ExchangeReport):
    """As :class:`beltcomm.drive.ExchangeReport`; ``limited_cycles`` counts samples in which the drive clipped (bit 11)."""

    limited_cycles: int = 0


class Run:
    """One enabled stretch on an exchange: :meth:`enable`, :meth:`follow`, :meth:`halt`.

    fault : makes the exception for a drive in fault, from what it was doing.     emergency : whether an EMCY has come.
    position : where the axis is now, counts.   rest : torque that holds it in torque mode, in the drive's unit.
    """

    def __init__(
        self,
        exchange: Exchange,
        layout: Layout,
        kind: str,
        watch: Watch,
        scaling: Scaling,
        period_s: float,
        fault: Callable[[str], DriveFault],
        emergency: Callable[[], bool],
        position: int,
        rest: int = 0,
    ) -> None:
        self._exchange = exchange
        self._layout = layout
        self._frames = Frames(layout, kind, rest)
        self._watch = watch
        self._scaling = scaling
        self._period_s = period_s
        self._fault = fault
        self._emergency = emergency
        self._position = position

    def cycle(self, frames: Sequence[bytes], doing: str) -> Sample | None:
        """One period; None when its answer was lost.

        Raises DriveFault (bit 3 or an EMCY), SafetyStop, BusError after more than :data:`TOLERATED_LOSSES` losses in a row.
        """
        sample = self._exchange.cycle(frames)
        if self._emergency() or (sample is not None and sample.statusword & FAULTED):
            raise self._fault(doing)
        if sample is None:
            if self._exchange.lost_in_a_row > TOLERATED_LOSSES:
                raise BusError(
                    f"the drive did not answer {self._exchange.lost_in_a_row} SYNCs in a row while {doing}; the axis was "
                    "stopped; check the cabling and the bus load, or choose a longer sample period"
                )
            return None
        self._position = sample.position
        self._watch.check(sample)
        return sample

    def enable(self, brake_s: float = 0.0) -> None:
        """Lead the drive to Operation Enabled, each state confirmed; where positions are commanded it holds the last one.

        brake_s : s, for which the axis is then held while its brake opens.
        Raises DriveError when a state does not come in time, DriveFault, SafetyStop, BusError.
        """
        controlword, target = DISABLE_VOLTAGE, self._position
        state = State.NOT_READY
        for _ in range(math.ceil(ENABLE_TIME_S / self._period_s)):
            sample = self.cycle(self._frames.at_rest(controlword, target), "being enabled")
            if sample is None:
                continue
            state = state_of(sample.statusword)
            if state is State.OPERATION_ENABLED:
                if not self._layout.follows or sample.statusword & FOLLOWS:
                    for _ in range(math.ceil(brake_s / self._period_s)):
                        self.cycle(self._frames.at_rest(self._layout.running, target), "opening its brake")
                    return
                controlword = self._layout.running
            else:
                target = sample.position
                controlword = step_to_enabled(state)
        if state is State.OPERATION_ENABLED:
            raise DriveError(
                f"the drive is enabled in mode {self._layout.mode} but ignores its target (statusword bit 12 stays 0); it may "
                "need another sample period (60C2h)"
            )
        raise DriveError(f"the drive stays in {state.words} instead of Operation Enabled; check STO, the enable inputs and the DC link")

    def follow(self, setpoints: Setpoints, torque_is_of: Literal["over", "after"], sink: Sink) -> Report:
        """Run the motion and hand aligned rows to ``sink``: row n goes out when the sample of row n+1 has come.

        torque_is_of : see :class:`beltcomm.drive.Capabilities`.  A lost sample costs its own row and the one before, whose
        torque it held.
        """
        frames = [
            self._frames.of(self._layout.running, *values)
            for values in zip(setpoints.position, setpoints.velocity, setpoints.torque, strict=True)
        ]
        # what is sent after SYNC k is active from SYNC k+1 on; at the end the axis is held where the motion ends
        rest = self._frames.at_rest(self._layout.running, setpoints.position[-1])
        self.cycle(frames[0], "moving")
        count, lost_before = len(frames), self._exchange.lost
        frames += [rest, rest]
        make_row = self._row_maker(setpoints, torque_is_of)
        required = _STATE_MASK | (FOLLOWS if self._layout.follows else 0)
        moving = _ENABLED_PATTERN | (required & FOLLOWS)
        before: Sample | None = None
        start_s: float | None = None
        rows = limited = 0
        jitter_s = 0.0
        for k in range(count + 1):
            sample = self.cycle(frames[k + 1], "moving")
            if sample is not None:
                if sample.statusword & required != moving:
                    raise self._left(sample.statusword)
                limited += bool(sample.statusword & INTERNAL_LIMIT)
                if start_s is None:
                    start_s = sample.stamp_s
                if before is not None:
                    if setpoints.kind == "position":
                        self._watch.follow(before, setpoints.position[k - 1])
                    jitter_s = max(jitter_s, abs(sample.stamp_s - before.stamp_s - self._period_s))
                    sink(make_row(k - 1, start_s, before, sample))
                    rows += 1
            before = sample
        lost = self._exchange.lost - lost_before
        if lost > max(TOLERATED_LOSSES, LOST_SHARE * count):
            raise BusError(
                f"{lost} of {count} answers of the drive were lost or came late: what is left of this record is in pieces; check the "
                "cabling, both terminators and the bus load, or choose a longer sample period"
            )
        return Report(rows, lost, jitter_s, limited)

    def home(self, width: float, time_s: float) -> None:
        """Start the drive's homing and watch it to its end: bit 12 attained, bit 13 failed.

        width : counts the axis may travel in one direction.  Raises SafetyStop when it travels further, DriveError when the
        drive gives up or takes longer than ``time_s``.
        """
        travel, before = 0, self._position
        for _ in range(math.ceil(time_s / self._period_s)):
            sample = self.cycle(self._frames.at_rest(START_HOMING, 0), "homing")
            if sample is None:
                continue
            step, before = sample.position - before, sample.position
            if abs(step) <= width / 10:  # a larger step is the new zero, not a movement
                travel += step
            if abs(travel) > width:
                raise SafetyStop(
                    f"homing has travelled {self._watch.way(abs(travel) * self._scaling.position_rad)} without finding its reference; the "
                    "axis was stopped; check the homing method (6098h) and the switch",
                    "position",
                )
            if sample.statusword & HOMING_ERROR:
                raise DriveError("the drive's homing failed (statusword bit 13); check its method (6098h) and the switches")
            if sample.statusword & FOLLOWS and sample.statusword & TARGET_REACHED:
                return
        raise DriveError(f"the drive's homing did not end within {time_s:.0f} s; check its method (6098h) and speeds (6099h)")

    def _row_maker(self, setpoints: Setpoints, torque_is_of: str) -> Callable[[int, float, Sample, Sample], tuple[float, ...]]:
        """Rows of :data:`beltcomm.drive.COLUMNS` from two neighbouring samples."""
        rad, rad_s, nm = self._scaling.position_rad, self._scaling.speed_rad_s, self._scaling.torque_nm
        after, torque_mode = torque_is_of == "after", setpoints.kind == "torque"
        nan = math.nan
        positions = [value * rad for value in setpoints.position] if setpoints.kind == "position" else None
        velocities = None if torque_mode else [value * rad_s for value in setpoints.velocity]
        torques = [value * nm for value in setpoints.torque] if torque_mode else None
        added = [value * nm for value in setpoints.torque] if not torque_mode and any(setpoints.torque) else None

        def row(n: int, start_s: float, now: Sample, following: Sample) -> tuple[float, ...]:
            setpoint = nan  # unless the drive reports it
            if torques is not None:
                setpoint = torques[n]
            elif following.demand is not None:
                setpoint = following.demand * nm
            return (
                now.stamp_s - start_s,
                (following if after else now).torque * nm,
                setpoint,
                now.position * rad,
                now.velocity * rad_s,
                nan if positions is None else positions[n],
                nan if velocities is None else velocities[n],
                nan if added is None else added[n],
            )

        return row

    def _left(self, statusword: int) -> DriveError:
        state = state_of(statusword)
        if state is not State.OPERATION_ENABLED:
            return DriveError(
                f"the drive left Operation Enabled while moving and is in {state.words}; the axis was stopped; check STO, the "
                "enable inputs, the limit switches, and that the host's frames do not come late"
            )
        return DriveError(
            f"the drive stopped following its target in mode {self._layout.mode} (statusword bit 12 is 0); the axis was "
            "stopped; check limits and sample period"
        )

    def halt(self, release: bool = False) -> None:
        """Quick stop, wait for standstill, take the stage off.  Faults and limits no longer interrupt.

        release : without the quick stop.
        Raises BusError when the drive does not answer: then its guarding stops the axis, because the host falls silent.
        Raises DriveError when the stage stays on.
        """
        live = (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE)
        still_cycles = max(2, math.ceil(_STILL_TIME_S / self._period_s))
        still_counts = _STILL_RAD_S * still_cycles * self._period_s / self._scaling.position_rad
        positions: list[int] = []
        for _ in range(0 if release else math.ceil(self._watch.longest_stop_s / self._period_s)):
            sample = self._halting(QUICK_STOP)
            if sample is None:
                continue
            positions = [*positions[-still_cycles:], sample.position]
            still = len(positions) > still_cycles and max(positions) - min(positions) <= still_counts
            # some drives end a quick stop disabled, some hold the axis
            if still and state_of(sample.statusword) is not State.OPERATION_ENABLED:
                break
        for _ in range(math.ceil(STOP_TIME_S / self._period_s)):
            sample = self._halting(DISABLE_VOLTAGE)
            if sample is not None and state_of(sample.statusword) not in (*live, State.SWITCHED_ON):
                return
        raise DriveError("the drive does not confirm that its stage is off; switch its power off before touching the axis")

    def _halting(self, controlword: int) -> Sample | None:
        sample = self._exchange.cycle(self._frames.at_rest(controlword, self._position))
        if sample is not None:
            self._position = sample.position
        elif self._exchange.lost_in_a_row * self._period_s > SILENCE_S:
            raise BusError(
                f"the drive has not answered for {SILENCE_S:g} s while being stopped; its guarding stops the axis now that the "
                "host falls silent; check that it stands still before going near"
            )
        return sample
