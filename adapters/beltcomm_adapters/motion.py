"""A :class:`beltcomm.drive.Motion` on the wire: frames per period, watched samples, aligned rows, and the stop at the end."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from beltcomm.drive import ExchangeReport, ObservedStop, Sink
from beltcomm.errors import BusError, DriveError, DriveFault, SafetyStop
from beltcomm_adapters.cia402 import (
    DISABLE_VOLTAGE,
    ENABLE_OPERATION,
    FAULTED,
    FOLLOWING_ERROR,
    FOLLOWS,
    HOMING_ERROR,
    INTERNAL_LIMIT,
    QUICK_STOP,
    START_HOMING,
    TARGET_REACHED,
    WARNING,
    State,
    state_of,
    step_to_enabled,
)
from beltcomm_adapters.exchange import Exchange, Sample
from beltcomm_adapters.scaling import Scaling
from beltcomm_adapters.setpoints import INTERPOLATED_MODES, POSITION_MODES, TORQUE_MODES, Frames, Layout, Setpoints, as_interpolated
from beltcomm_adapters.watch import STOP_TIME_S, LimitWatch

#: Cycles without an answer that a recording survives; each leaves a gap in ``t_s``.
TOLERATED_LOSSES: Final = 3
#: Share of a recording's cycles that may be lost in all; a sound bus loses none.
LOST_SHARE: Final = 0.005
ENABLE_TIME_S: Final = 3.0  # brake release included; 0.1 to 1 s are typical (G1)
#: s beyond the time of its brake in which a drive that stands must have disabled itself after a quick stop.
BRAKE_SLACK_S: Final = 0.1
#: A drive that is silent for so long while being stopped is left to its own guarding.
SILENCE_S: Final = 0.2
#: Share of a period by which one is off that the report tells of (drive-protocols 3: such periods are flagged).
IRREGULAR_SHARE: Final = 0.25
#: s, for which a torque may be cut in torque mode, and from how many of the drive's steps on it counts as cut.
CUT_S: Final = 0.05
CUT_STEPS: Final = 2
#: Standstill: less than this speed over this time, motor shaft.
_STILL_RAD_S: Final = 0.1
_STILL_TIME_S: Final = 0.02
#: Operation Enabled, as one comparison for every cycle.
_STATE_MASK: Final = 0x6F
#: Bits of which a row is told at all; hardly one has any.
_TELLING: Final = WARNING | INTERNAL_LIMIT | FOLLOWING_ERROR
_ENABLED_PATTERN: Final = 0x27


@dataclass(frozen=True)
class Report(ExchangeReport):
    """As :class:`beltcomm.drive.ExchangeReport`; ``limited_cycles`` counts samples in which the drive clipped (bit 11)."""

    limited_cycles: int = 0


class Tally:
    """Statements of a drive beside its samples; those that contradict the motion end it.

    Parameters
    ----------
    mode : int
        Of operation.
    """

    def __init__(self, period_s: float, setpoints: Setpoints, mode: int) -> None:
        self._period_s, self._setpoints, self._mode = period_s, setpoints, mode
        self.limited = self.irregular = self._warned = self._cut = 0

    def note(self, sample: Sample, k: int) -> None:
        """Count a row.

        Parameters
        ----------
        sample : Sample
        k : int
            Number of the row.

        Raises
        ------
        SafetyStop
            For a following error (bit 13), and for torque that is cut (bit 11) for longer than ``CUT_S``.
        """
        word = sample.statusword
        if not word & _TELLING:
            self._cut = 0
            return
        self._warned += bool(word & WARNING)
        self.limited += bool(word & INTERNAL_LIMIT)
        if word & FOLLOWING_ERROR and self._mode in POSITION_MODES:
            raise SafetyStop(
                "the drive reports a following error (statusword bit 13); the axis was stopped; its gains do not hold it, or something "
                "blocks it",
                "lag",
            )
        if self._mode not in TORQUE_MODES or k == 0 or sample.demand is None:
            return
        cut = word & INTERNAL_LIMIT and abs(sample.demand - self._setpoints.torque[k - 1]) > CUT_STEPS
        self._cut = self._cut + 1 if cut else 0
        if self._cut * self._period_s > CUT_S:
            asked = self._setpoints.torque[k - 1]
            raise SafetyStop(
                f"the drive cuts the torque (statusword bit 11): it takes {sample.demand} of its units where {asked} were asked, for "
                f"{1e3 * CUT_S:.0f} ms; the axis was stopped; look at its limits (6072h, 6073h, I2t) or reduce the amplitude",
                "limit",
            )

    def remarks(self) -> tuple[str, ...]:
        """Remarks on a motion that went to its end."""
        found = []
        if self._warned:
            found.append(f"the drive warns (statusword bit 7 in {self._warned} rows): look at its temperature, I2t and supply")
        if self.irregular:
            found.append(f"{self.irregular} periods were off by more than {100 * IRREGULAR_SHARE:.0f} %: their true times are recorded")
        return tuple(found)


class Run:
    """One enabled stretch on an exchange: :meth:`enable`, :meth:`follow`, :meth:`halt`.

    Parameters
    ----------
    fault : callable
        Makes the exception for a drive in fault, from what it was doing.
    emergency : callable
        Whether an EMCY has come.
    position : int
        Where the axis is now, counts.
    rest : int
        Torque that holds it in torque mode, in the drive's unit.
    loop_s : float
        Period of the drive's loop, which interpolates the setpoints where they come more seldom.
    """

    def __init__(
        self,
        exchange: Exchange,
        layout: Layout,
        kind: str,
        watch: LimitWatch,
        scaling: Scaling,
        period_s: float,
        fault: Callable[[str], DriveFault],
        emergency: Callable[[], bool],
        position: int,
        rest: int = 0,
        loop_s: float = math.inf,
    ) -> None:
        self._exchange = exchange
        self._layout = layout
        self._frames = Frames(layout, kind, rest)
        self._watch = watch
        self._scaling = scaling
        self._period_s = period_s
        self._fault = fault
        self._emergency = emergency
        self._position, self._stamp_s = position, 0.0
        self._brake_s = 0.0
        #: Of the quick stop that ended it.
        self.stop: ObservedStop | None = None
        self._loop_share = min(loop_s / period_s, 1.0) if layout.mode in INTERPOLATED_MODES else 1.0
        self._silenced = False

    @property
    def torque_mode(self) -> bool:
        """True if torque is commanded, with all loops open."""
        return self._layout.mode in TORQUE_MODES

    def cycle(self, frames: Sequence[bytes], doing: str) -> Sample | None:
        """One period; None when its answer was lost.

        Parameters
        ----------
        frames : sequence of bytes
            One per receive PDO.
        doing : str
            For messages.

        Raises
        ------
        DriveFault
            For bit 3 or an EMCY.
        SafetyStop
            For a broken limit.
        BusError
            After more than :data:`TOLERATED_LOSSES` losses in a row.
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
        self._position, self._stamp_s = sample.position, sample.stamp_s
        self._watch.check(sample)
        return sample

    def enable(self, brake_s: float = 0.0) -> None:
        """Lead the drive to Operation Enabled, each state confirmed; where positions are commanded it holds the last one.

        Parameters
        ----------
        brake_s : float, s
            For which the axis is then held while its brake opens.

        Raises
        ------
        DriveError
            When a state does not come in time.
        DriveFault
        SafetyStop
        BusError
        """
        self._brake_s = brake_s
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

    def outlive(
        self, now: Callable[[], float], silent_since_s: float, until_s: float, ask: Callable[[], int], noticed_s: Callable[[], float]
    ) -> tuple[float, bool] | None:
        """Go on without signs of life until the drive leaves Operation Enabled.

        Parameters
        ----------
        now : callable
        silent_since_s : float
            Last sign of life.
        until_s : float
            When it is given up.
        ask : callable
            6041h without PDOs, for a node that leaves Operational with its host's silence (1029h = 0).
        noticed_s : callable
            When its EMCY came. None when it has not by ``until_s``. A drive that shows another state between Operation Enabled and Fault
            brakes; one that is in Fault at once, or whose fault cannot be told from its reaction (0Fh for both), counts as one that lets
            the axis coast.

        Returns
        -------
        tuple[float, bool] or None
            Reaction time, s, and True if it was seen to brake; None without a reaction.
        """
        reacted_s: float | None = None
        braking, self._silenced = False, True
        while reacted_s is not None or now() < until_s:
            sample = self._exchange.cycle(self._frames.at_rest(self._layout.running, self._position))
            if sample is not None:
                self._position = sample.position
                self._watch.check(sample)
                state = state_of(sample.statusword)
            elif self._emergency() or self._exchange.lost_in_a_row > TOLERATED_LOSSES:
                state = state_of(ask())
            else:
                continue
            if state is State.OPERATION_ENABLED:
                continue
            reacted_s = min(now(), max(noticed_s(), silent_since_s)) if reacted_s is None else reacted_s
            if state not in (State.FAULT_REACTION_ACTIVE, State.QUICK_STOP_ACTIVE):
                return reacted_s - silent_since_s, braking
            braking = True
            if now() > reacted_s + self._watch.longest_stop_s:
                return reacted_s - silent_since_s, False
        return None

    def follow(self, setpoints: Setpoints, torque_is_of: Literal["over", "after"], sink: Sink) -> Report:
        """Run the motion and hand aligned rows to ``sink``: row n goes out when the sample of row n+1 has come.

        Parameters
        ----------
        setpoints : Setpoints
        torque_is_of : Literal['over', 'after']
            See :class:`beltcomm.drive.Capabilities`. A lost sample costs its own row and the one before, whose torque it held.
        sink : Sink

        Raises
        ------
        BusError
            When more answers are lost than a record can do without, and as :meth:`cycle`.
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
        asked = as_interpolated(setpoints.path, self._loop_share)
        required = _STATE_MASK | (FOLLOWS if self._layout.follows else 0)
        moving = _ENABLED_PATTERN | (required & FOLLOWS)
        tally = Tally(self._period_s, setpoints, self._layout.mode)
        before: Sample | None = None
        start_s: float | None = None
        rows = 0
        jitter_s = 0.0
        for k in range(count + 1):
            sample = self.cycle(frames[k + 1], "moving")
            if sample is not None:
                if sample.statusword & required != moving:
                    raise self._left(sample.statusword)
                tally.note(sample, k)
                if start_s is None:
                    start_s = sample.stamp_s
                if before is not None:
                    if setpoints.kind == "position":
                        self._watch.follow(before, asked[k - 1])
                    off_s = abs(sample.stamp_s - before.stamp_s - self._period_s)
                    tally.irregular += off_s > IRREGULAR_SHARE * self._period_s
                    if off_s > jitter_s:
                        jitter_s = off_s
                    sink(make_row(k - 1, start_s, before, sample))
                    rows += 1
            before = sample
        lost = self._exchange.lost - lost_before
        if lost > max(TOLERATED_LOSSES, LOST_SHARE * count):
            raise BusError(
                f"{lost} of {count} answers of the drive were lost or came late: what is left of this record is in pieces; check the "
                "cabling, both terminators and the bus load, or choose a longer sample period"
            )
        return Report(rows, lost, jitter_s, tally.irregular, tally.remarks(), tally.limited)

    def home(self, width: float, time_s: float) -> None:
        """Start the drive's homing and watch it to its end: bit 12 attained, bit 13 failed.

        Parameters
        ----------
        width : float
            Counts the axis may travel in one direction.
        time_s : float

        Raises
        ------
        SafetyStop
            When it travels further.
        DriveError
            When the drive gives up or takes longer than ``time_s``.
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
                    f"homing has travelled {self._watch.in_words(abs(travel) * self._scaling.position_rad)} without finding "
                    "its reference; the axis was stopped; check the homing method (6098h) and the switch",
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
        share = self._loop_share
        positions = [value * rad for value in as_interpolated(setpoints.path, share)] if setpoints.kind == "position" else None
        velocities = None if torque_mode else [value * rad_s for value in as_interpolated(setpoints.velocity, share)]
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

        Parameters
        ----------
        release : bool
            Without the quick stop.

        Raises
        ------
        BusError
            When the drive does not answer: then its guarding stops the axis, because the host falls silent.
        DriveError
            When the stage stays on.
        """
        live = (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE)
        standing = self._standing()
        # a drive whose quick stop ends disabled closes its brake before it takes the torque away: it is given the time
        patience = math.ceil((self._brake_s + BRAKE_SLACK_S) / self._period_s) if self._brake_s else 0
        longest = math.ceil(self._watch.longest_stop_s / self._period_s)
        if self._watch.watches_stop:
            patience = longest
        seen, ended_s = [(self._stamp_s, self._position)], None
        for _ in range(0 if release else longest):
            sample = self._halting(QUICK_STOP)
            if sample is None:
                continue
            seen.append((sample.stamp_s, sample.position))
            state = state_of(sample.statusword)
            if state not in live and ended_s is None:
                ended_s = sample.stamp_s - seen[0][0]
            if not standing(sample.position):
                continue
            # some drives end a quick stop disabled, some hold the axis
            if state not in live or (state is State.QUICK_STOP_ACTIVE and patience <= 0):
                break
            patience -= 1
        begun_s, rad = seen[0][0], self._scaling.position_rad
        self.stop = ObservedStop(tuple(at - begun_s for at, _ in seen), tuple(rad * one for _, one in seen), ended_s)
        for _ in range(math.ceil(STOP_TIME_S / self._period_s)):
            sample = self._halting(DISABLE_VOLTAGE)
            if sample is not None and state_of(sample.statusword) not in (*live, State.SWITCHED_ON):
                return
        raise DriveError("the drive does not confirm that its stage is off; switch its power off before touching the axis")

    def left_alone(self) -> bool:
        """True if the node ended its PDOs with its host's silence, which was tried: a quick stop in them is not answered."""
        return self._silenced and self._halting(QUICK_STOP) is None

    def stand_by_speed(self) -> None:
        """After a change to profile velocity: wait until the axis stands.  The stop that follows tells what is wrong."""
        standing = self._standing()
        for _ in range(math.ceil(self._watch.longest_stop_s / self._period_s)):
            sample = self._halting(ENABLE_OPERATION)
            if sample is not None and (standing(sample.position) or state_of(sample.statusword) is not State.OPERATION_ENABLED):
                return

    def _standing(self) -> Callable[[int], bool]:
        """True if the axis stands, asked with every position from now on."""
        cycles = max(2, math.ceil(_STILL_TIME_S / self._period_s))
        counts = _STILL_RAD_S * cycles * self._period_s / self._scaling.position_rad
        positions: deque[int] = deque(maxlen=cycles + 1)

        def standing(position: int) -> bool:
            positions.append(position)
            return len(positions) > cycles and max(positions) - min(positions) <= counts

        return standing

    def _halting(self, controlword: int) -> Sample | None:
        sample = self._exchange.cycle(self._frames.at_rest(controlword, self._position))
        if sample is not None:
            self._position = sample.position
            self._watch.learn(sample)
        elif self._exchange.lost_in_a_row * self._period_s > SILENCE_S:
            raise BusError(
                f"the drive has not answered for {SILENCE_S:g} s while being stopped; its guarding stops the axis now that the "
                "host falls silent; check that it stands still before going near"
            )
        return sample
