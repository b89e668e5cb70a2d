"""One axis behind one drive, in carriage coordinates, with everything recorded and everything put back.

:class:`Machine` is the only place that calls ``Drive.record`` and ``Drive.write``.  Leaving it, whatever the reason, leaves a
stopped axis and the parameters found at the start, unless new gains were to be kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from types import TracebackType

import numpy as np

from beltcomm.arrays import Array
from beltcomm.axis import Axis
from beltcomm.control import Cascade, Feedforward, feedforward_torque
from beltcomm.drive import COLUMNS, Drive, Guarding, Limits, LoopKind, Motion, Row
from beltcomm.drive.parameters import GAIN_NAMES, cascade_to_parameters, parameters_to_cascade
from beltcomm.errors import BeltcommError, DamagedRecord, DataError, Refused, SafetyStop, UsageError
from beltcomm.excitation import AS_CHOSEN
from beltcomm.given import ExcitationKind
from beltcomm.machine.closed_loop_watch import foreseen as foreseen_of
from beltcomm.machine.closed_loop_watch import unwatched, within
from beltcomm.machine.envelope import Envelope as Envelope
from beltcomm.machine.envelope import stroking as stroking
from beltcomm.machine.load import Load
from beltcomm.machine.ratings import check_ratings
from beltcomm.machine.restore_drive import leave
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import Sidecar
from beltcomm.rundata.backups import keep_first
from beltcomm.rundata.calibration import recall
from beltcomm.runfolder import RunFolder
from beltcomm.simulate.stopping import Braking, first_deceleration
from beltcomm.talk import CarriagePosition, Gauge, Talk, detail, found
from beltcomm.trajectory import Trajectory

RowWatch = Callable[[Row], None]

#: The drive's parameter that holds a tilted axis in each of its own loops, the quick stop included.
OFFSET = "ff_offset_nm"
#: s: 20 swings of a heavy carriage, after which its friction has stopped it.
SETTLE_S = 1.0
#: s, in which a brake opens whose time axis.yaml does not state: slow ones of this size.
UNKNOWN_BRAKE_S = 0.1
#: Share by which a deceleration that the drive rounds may be off.
SAME_STOP = 0.02
#: Share by which an acceleration that is drawn from rounded speeds may be off.
SAME_ACCELERATION = 1e-3
#: s: a run that goes on later than this may have cooled down.
LONG_AGO_S = 300.0


class Machine:
    """The connected axis.  Use as a context manager.

    Attributes
    ----------
    position_m : float
        Carriage position; the zero of the axis is known after :meth:`reference_at` or when the drive is referenced, else
        (``place_known`` False) positions count from where the carriage stood in :meth:`stand_anywhere`.
    friction
        Coulomb, N m, and viscous, N m s/rad, of the whole axis at the motor, as far as it is known.
    holding_nm
        What keeps the axis where it is beside friction, N m; every open-loop record holds it, or the carriage would drift.
    remarks
        Sentences for the result.
    titles
        Of the phases to come, so that :meth:`begin` can number them.
    keep_gains
        Set by the sequence when the user wants to keep the new gains in the drive (not saved).
    over_belt
        The user lets the belt carry more than its feed force; virtual drives only.
    deceleration_m_s2
        Of a quick stop, lent to the drive with every motion.
    braking
        What brakes the axis with the loop that is in the drive; None as long as only friction can be counted with.
    guarding
        How the drive took the silence of its host, once seen.
    cascade
        What was written last.
    closed
        Model and delay, s, that loops are counted with.
    family
        Models that the axis may be as far as anyone knows, that one among them.
    free_share
        Of the travel, that strokes of a weak loop leave free at either end.
    planned_s
        The agreed plan's, s.
    loop_tried
        A loop whose gains nobody knows has followed a slow stroke.
    stop_tried
        A slow stop has shown what the drive's decelerations count in.
    wanderings
        Stops of a carriage that went too far, after which the session went on, see :mod:`beltcomm.experiments.recentre`.
    """

    def __init__(self, drive: Drive, axis: Axis, folder: RunFolder, talk: Talk) -> None:
        self.drive, self.axis, self.folder, self.talk = drive, axis, folder, talk
        self.ratio = axis.transmission_m_rad
        self.origin_rad = 0.0
        self.place_known = True
        self._window_m = (-math.inf, math.inf)
        self.keep_gains = self.over_belt = False
        self.titles: tuple[str, ...] = ()
        self.friction = (0.0, 0.0)
        self.holding_nm = 0.0
        self.excitation: ExcitationKind = "prbs"
        self.asked = AS_CHOSEN
        self.deceleration_m_s2 = first_deceleration(axis, drive.capabilities.peak_torque_nm).value_m_s2
        self.braking: Braking | None = None
        self.guarding: Guarding | None = None
        self.closed: tuple[Model, float] | None = None
        self.family: tuple[Model, ...] = ()
        self.free_share = 0.0
        self.cascade: Cascade | None = None
        self.feedforward: Feedforward | None = None  # sent with every reference, where the drive holds none itself
        self.loop_tried = self.stop_tried = False
        self.machine_seconds = 0.0
        self.wanderings = 0
        self.planned_s: float | None = None
        self.remarks: list[str] = []
        self._started = drive.clock.now()
        recall(drive, folder)
        self._backup = drive.backup()
        with folder.occupy(talk) as held:
            keep_first(folder, drive)
            folder.stamp = self._stamp
            folder.journal(f"connected to {drive.capabilities.name}; parameters saved as backup", "connected")
            self._occupied = held.pop_all()
        if folder.elapsed_s > LONG_AGO_S:
            talk.say(
                f"This run began {folder.elapsed_s / 60.0:.0f} min ago, its clock goes on. Whether the axis stayed warm since then nobody "
                "knows: where friction falls with warmth, records of today and of then may differ."
            )

    def __enter__(self) -> Machine:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if isinstance(error, SafetyStop):
            with suppress(BeltcommError):  # what cannot be written must not keep the drive from being restored
                self.folder.journal(f"safety stop ({error.reason}): {error}")
        keep = self.keep_gains and kind is None
        wanted = {n: v for n, v in self._backup.items() if not (keep and n in GAIN_NAMES)}
        with self._occupied:
            interrupted = leave(self.drive, self.folder, self.talk, wanted, keep, error)
        if interrupted is not None and kind is None:
            raise interrupted

    def _stamp(self) -> str:
        """Time of a line of the journal: s since the session began, by the drive's clock."""
        return f"{self.drive.clock.now() - self._started:9.3f} s"

    def meaning_changed(self) -> None:
        """Take over the meaning of raw gains, which is known now: they stand in the drive under other values."""
        self._backup = self.drive.backup()

    def remark(self, sentence: str) -> None:
        """Say something of a record that belongs into the result too."""
        self.talk.say(sentence)
        self.folder.journal(sentence)
        self.remarks.append(sentence)

    def detail(self, sentence: str) -> None:
        """Tell a detail, which only some want to read while it happens."""
        detail(self.talk, sentence)
        self.folder.journal(sentence)

    def found(self, name: str, value: str) -> None:
        """A number that was found on the way."""
        found(self.talk, name, value)

    def begin(self, title: str) -> None:
        """Tell that a phase begins, numbered among those to come."""
        number = self.titles.index(title) + 1 if title in self.titles else 1
        self.talk.phase(number, max(len(self.titles), 1), title)
        self.folder.journal(f"phase {number} of {max(len(self.titles), 1)}: {title}", "phase")

    @property
    def weight_n(self) -> float:
        """Share of the belt's force that holds a tilted carriage, N."""
        return abs(self.holding_nm) / self.ratio

    @property
    def belt_left_n(self) -> float:
        """Share of the belt's force that is left for motions, N."""
        return self.axis.belt_force_limit_n - self.weight_n

    @property
    def holds_in_loops(self) -> bool:
        """True if the drive sends the holding torque along in its own loops, the quick stop included."""
        return OFFSET in self._backup

    def hold_with(self, torque_nm: float) -> None:
        """From now on open-loop records, and the drive's own loops where it can, begin and end with this torque."""
        self.holding_nm = torque_nm
        if self.holds_in_loops:
            self.drive.write({OFFSET: torque_nm})

    def let_settle(self) -> None:
        """Wait until a carriage that hangs on its belt from a closed brake has swung out: a brake that opens before lets it kick."""
        if self.axis.mounting.tilted:
            self.drive.clock.sleep_until(self.drive.clock.now() + SETTLE_S)

    @property
    def position_m(self) -> float:
        """Carriage position now, m, from the motor encoder."""
        return self.ratio * (self.drive.read(["position_rad"])["position_rad"] - self.origin_rad)

    @property
    def session_time_s(self) -> float:
        """Seconds since the run began, s: by the drive's clock, and between the sessions of a run by date and time."""
        return self.folder.elapsed_s + self.drive.clock.now() - self._started

    def check_scaling(self) -> None:
        """Compare what the drive says of its motor with axis.yaml, see :mod:`beltcomm.machine.ratings`.   Raises UsageError."""
        for line in check_ratings(self.axis, self.drive.capabilities):
            self.talk.say(line)

    def reference_at(self, position_m: float) -> None:
        """The carriage stands at ``position_m`` now, as the operator says; raises UsageError outside the travel."""
        low, high = self.envelope().window_m
        if not low <= position_m <= high:
            raise UsageError(f"position {position_m:.4g} m is outside the travel {low:g}..{high:g} m of axis.yaml")
        self.origin_rad = self.drive.read(["position_rad"])["position_rad"] - position_m / self.ratio

    def stand_anywhere(self) -> None:
        """Nobody knows where along its travel the carriage stands: positions count from here."""
        self.origin_rad = self.drive.read(["position_rad"])["position_rad"]
        self.place_known = False

    def keep_to(self, window_m: tuple[float, float]) -> None:
        """From now on the carriage stays within ``window_m`` of where it stands.

        Parameters
        ----------
        window_m : tuple[float, float], carriage
            Lowest and highest, from where it stands.

        Raises
        ------
        UsageError
            For one longer than the travel.
        """
        low, high = window_m
        travel = float(self.axis.travel.max_m or 0.0) - float(self.axis.travel.min_m or 0.0)
        if high - low > travel:
            raise UsageError(
                f"the window of {1e3 * (high - low):.0f} mm is longer than the travel of {1e3 * travel:.0f} mm; give what is free"
            )
        self._window_m = (self.position_m + low, self.position_m + high)

    @property
    def room_word(self) -> str:
        """Bound of the carriage's way, in a word."""
        return "travel" if math.isinf(self._window_m[0]) else "window"

    @property
    def more_room(self) -> str:
        """Advice where the way is too short."""
        further = "move the carriage further in"
        return f"{further} or correct travel in axis.yaml" if self.room_word == "travel" else f"give a wider --window or {further}"

    def where(self, position_m: float) -> str:
        """A position in words."""
        return f"{position_m:.4f} m" if self.place_known else f"{1e3 * position_m:+.1f} mm from where it stood"

    def place_m(self, position_m: float) -> float | None:
        """A position from the zero of the session on the axis, None when the zero of the axis is not known."""
        return position_m if self.place_known else None

    def envelope(self) -> Envelope:
        """The travel and the window that must be kept, the speed that axis and drive allow, the torque that motor and drive allow."""
        travel, limits = self.axis.travel, self.axis.limits
        torque = min(self.axis.motor.peak_torque_nm or math.inf, self.drive.capabilities.peak_torque_nm)
        self.axis.require("any motion", "travel.min_m", "travel.max_m", "limits.speed_m_s", "limits.feed_force_n")
        speed = min(limits.speed_m_s or math.inf, self.drive.capabilities.max_speed_rad_s * self.ratio)
        low, high = self._window_m
        if self.place_known:
            low, high = max(low, float(travel.min_m or 0.0)), min(high, float(travel.max_m or 0.0))
        return Envelope((low, high), speed, torque)

    def drive_limits(self, envelope: Envelope) -> Limits:
        """Limits of the envelope at the motor shaft, in the drive's zero."""
        low, high = sorted(self.origin_rad + x / self.ratio for x in envelope.window_m)
        speed = min(envelope.speed_m_s / self.ratio, self.drive.capabilities.max_speed_rad_s)
        lag = None if envelope.lag_m is None else envelope.lag_m / self.ratio
        deceleration = self.deceleration_m_s2 / self.ratio
        place = self.ratio, self.origin_rad
        return Limits(low, high, speed, envelope.torque_nm, deceleration, lag, *place, brake_s=self.brake_s, guard_s=envelope.guard_s)

    @property
    def brake_s(self) -> float:
        """Time that a holding brake needs to open or to close, s; 0 without one."""
        motor = self.axis.motor
        return (UNKNOWN_BRAKE_S if motor.brake_time_s is None else motor.brake_time_s) if motor.brake_torque_nm else 0.0

    def brake_with(self, braking: Braking) -> None:
        """From now on a stop is counted with, and set in the drive to, what a loop can do."""
        self.braking, self.deceleration_m_s2 = braking, braking.deceleration_m_s2
        own_m_s2 = self._own_deceleration_m_s2()
        if own_m_s2 is None or abs(own_m_s2 / braking.deceleration_m_s2 - 1.0) < SAME_STOP:
            return
        softer = own_m_s2 < braking.deceleration_m_s2
        self.braking = replace(braking, deceleration_m_s2=own_m_s2) if softer else braking
        self.remark(
            f"a quick stop of this drive brakes with {own_m_s2:.3g} m/s² (6085h), not with the {braking.deceleration_m_s2:.3g} m/s² "
            f"that it is asked for: {'stops are counted with its own way' if softer else 'it may load the belt more than planned'}"
        )

    def _own_deceleration_m_s2(self) -> float | None:
        """Deceleration that the drive makes of the one asked for; None where it does not tell, or makes no quick stop that could be told.

        An adapter may offer ``quick_stop_rad_s2(limits) -> float | None``, which tries it with the stage off and puts it back.
        """
        tell: Callable[[Limits], float | None] | None = getattr(self.drive, "quick_stop_rad_s2", None)
        found = tell(self.drive_limits(self.envelope())) if tell is not None else None
        return None if found is None else self.ratio * found

    def torque_motion(self, torque_nm: Array) -> Motion:
        """An open-loop record, one torque per sampling period of the drive, with what holds the axis added."""
        zero, step = np.zeros(len(torque_nm)), self.drive.capabilities.torque_step_nm
        holding = round(self.holding_nm / step) * step if step else self.holding_nm
        return Motion("torque", self.drive.capabilities.sample_period_s, zero, zero, np.asarray(torque_nm) + holding, holding)

    def follow(self, trajectory: Trajectory, kind: LoopKind, torque_nm: Array | None = None, lead_m: Array | None = None) -> Motion:
        """A motion of the carriage for the drive's own position or velocity loop.

        Parameters
        ----------
        trajectory : Trajectory, carriage
        kind : LoopKind
        torque_nm : ndarray (n,)
            Sent along with it.
        lead_m : ndarray (n,)
            By which the drive's reference is ahead.

        Returns
        -------
        Motion
            Motor shaft.
        """
        speed = trajectory.velocity_m_s / self.ratio
        return Motion(
            kind,
            self.drive.capabilities.sample_period_s,
            self.origin_rad + trajectory.position_m / self.ratio,
            speed,
            self._along(speed, kind, torque_nm),
            lead_rad=None if lead_m is None else lead_m / self.ratio,
        )

    def stops_badly(self, position_m: Array, speed_m_s: Array, spare_m: float = 0.0) -> str:
        """Sentence on a stop at some moment of a motion that would load the belt beyond its force or end outside the travel; "" for none.

        Parameters
        ----------
        position_m, speed_m_s : ndarray (n,), carriage side
        spare_m : float, m
            At the ends of the travel, which stays free.
        """
        return self._stops_too_hard(speed_m_s) or self._stops_beyond(position_m, speed_m_s, spare_m)

    def _stops_too_hard(self, speed_m_s: Array) -> str:
        if self.braking is None or self.over_belt or len(speed_m_s) < 2:
            return ""
        most = float(np.max(np.abs(np.diff(speed_m_s)))) / self.drive.capabilities.sample_period_s
        if most <= self.braking.acceleration_m_s2 * (1.0 + SAME_ACCELERATION):
            return ""
        return (
            f"a stop out of {most:.3g} m/s² would make the belt swing beyond its force; with this loop it bears one out of "
            f"{self.braking.acceleration_m_s2:.3g} m/s² at most"
        )

    def _stops_beyond(self, position_m: Array, speed_m_s: Array, spare_m: float = 0.0) -> str:
        if self.braking is None or self.over_belt:
            return ""
        low, high = self.envelope().window_m
        reached = self.braking.span_m(position_m, speed_m_s, self.drive.capabilities.sample_period_s)
        if low + spare_m <= reached[0] and reached[1] <= high - spare_m:
            return ""
        end = reached[0] if reached[0] < low + spare_m else reached[1]
        return (
            f"a stop with {self.braking.deceleration_m_s2:.3g} m/s², which the belt bears, would end at {end:.4g} m, the travel is "
            f"{low:g}..{high:g} m" + (f" and {1e3 * spare_m:g} mm at its ends stay free" if spare_m else "")
        )

    def _check_stops(self, motion: Motion, foreseen: tuple[Array, Array] | None = None) -> None:
        """Raise Refused for a closed-loop motion of which :meth:`stops_badly` tells something.   foreseen : of :meth:`record`."""
        if motion.kind == "torque":
            return
        asked = self.ratio * (motion.position_rad - self.origin_rad), self.ratio * motion.velocity_rad_s
        # What an excitation beside a speed puts into the belt is bounded by its own prediction; steps of its setpoint are no acceleration.
        bad = self._stops_beyond(*foreseen) if foreseen else self.stops_badly(*asked)
        if bad:
            raise Refused(f"the motion is refused: {bad}; plan it slower or further away from the ends")

    def record(
        self,
        name: str,
        motion: Motion,
        envelope: Envelope,
        sidecar: Sidecar,
        watch: RowWatch = unwatched,
        foreseen: tuple[Array, Array] | None = None,
    ) -> Recording:
        """Run a motion and keep it as ``recordings/NAME``; a record already finished in a resumed run is read instead.

        Rows stream to disk while the axis moves; an interrupted record stays, marked as unfinished.

        Parameters
        ----------
        name : str
        motion : Motion, motor shaft
        envelope : Envelope, carriage
        sidecar : Sidecar
            What is noted beside the rows.
        watch : RowWatch
            Is called with every row as the drive gives it, and may raise; that stops the axis.
        foreseen : tuple[ndarray, ndarray] or None
            Carriage position and speed, m and m/s, (n,), where they are not what is asked for: from them a stop must be possible.

        Raises
        ------
        Refused, SafetyStop, DriveError, DataError
        """
        if self.folder.finished(name) is not None:
            self.detail(f"{name}: kept from the earlier run")
            return self.folder.recording(name)
        self._check_stops(motion, foreseen)
        self.let_settle()
        writer = self.folder.new_recording(name, sidecar, COLUMNS)
        closed = foreseen_of(self, motion)
        zero, begun, total = self.origin_rad, self.drive.clock.now(), len(motion.torque_nm)
        rows, load = 0, Load(self.axis, envelope.torque_nm, envelope.speed_m_s)

        def sink(row: Row) -> None:
            nonlocal rows
            t, torque, setpoint, position, velocity, reference, *others = row
            writer.write((t, torque, setpoint, position - zero, velocity, reference - zero, *others))
            closed.watch(row)
            watch(row)
            load.see(row)
            rows += 1
            if rows % 200 == 0 and rows < total:  # a drive that makes its strokes by itself takes longer than planned
                self.talk.moving(self._place(name, position, begun, load.gauges()))
                self.talk.progress(rows / total, (total - rows) * motion.period_s)

        try:
            report = self.drive.record(motion, self.drive_limits(within(envelope, closed)), sink)
        except BaseException:
            writer.close(finished=False)
            self.folder.journal(f"{name}: interrupted after {rows} of {total} samples; what was recorded is kept")
            raise
        finally:
            self.machine_seconds += self.drive.clock.now() - begun
        writer.close(finished=True)
        self.folder.journal(
            f"{name}: {report.rows} samples, {report.lost_cycles} lost cycles, worst period error {1e6 * report.worst_jitter_s:.0f} us"
            + (f", a limit of the drive was active in {report.limited_cycles} of them" if report.limited_cycles else "")
        )
        for remark in report.remarks:
            self.folder.journal(f"{name}: {remark}")
            self.talk.say(f"{name}: {remark}.")
        try:
            return self.folder.recording(name)
        except DataError:
            self.folder.withdraw(name)  # what cannot be used is no finished record: --resume makes it again
            raise

    def _place(self, record: str, position_rad: float, begun_s: float, gauges: tuple[Gauge, ...]) -> CarriagePosition:
        """Position of the carriage in a record that began at ``begun_s`` of the drive's clock."""
        gone = self.machine_seconds + self.drive.clock.now() - begun_s
        left = None if self.planned_s is None else max(0.0, self.planned_s - gone)
        return CarriagePosition(
            record, self.ratio * (position_rad - self.origin_rad), self.envelope().window_m, self.place_known, left, gauges
        )

    @contextmanager
    def withdrawing(self) -> Iterator[None]:
        """A recording that an analysis calls damaged is no finished record: it is kept aside, and --resume makes it again."""
        try:
            yield
        except DamagedRecord as damage:
            self.folder.withdraw(damage.record)
            self.folder.journal(f"{damage.record}: kept as unfinished, because {damage}")
            raise

    def run(self, motion: Motion, envelope: Envelope, watch: RowWatch = unwatched) -> None:
        """Run a motion that is only a means (positioning, creeping), watched row by row; nothing is kept.

        What ``watch`` raises stops the axis.
        """
        self._check_stops(motion)
        self.let_settle()
        closed, begun = foreseen_of(self, motion), self.drive.clock.now()

        def sink(row: Row) -> None:
            closed.watch(row)
            watch(row)

        try:
            self.drive.record(motion, self.drive_limits(within(envelope, closed)), sink)
        finally:
            self.machine_seconds += self.drive.clock.now() - begun

    def stroking(self) -> LoopKind:
        """Loop of the drive that follows strokes, as :func:`stroking` has it."""
        return stroking(self.drive.capabilities)

    def write_cascade(self, cascade: Cascade) -> Cascade:
        """Put a controller into the drive, as far as it has the parts.   Where nobody knows its
        gains nothing is written: what stands in it is what a person has set.

        Parameters
        ----------
        cascade : Cascade, motor side

        Returns
        -------
        Cascade
            The one it now runs, quantised.
        """
        if self.drive.capabilities.gains == "unknown":
            return cascade
        offered = self.drive.backup()
        values = {n: v for n, v in cascade_to_parameters(cascade).items() if n in offered}
        stored = self.drive.write(values)
        self.folder.journal("wrote " + ", ".join(f"{n}={v:.6g}" for n, v in stored.items()))
        by_host = {"ff_velocity": cascade.feedforward.velocity} if self.sends_feedforward else {}
        self.cascade = parameters_to_cascade({"velocity_filter_s": 0.0, **by_host, **offered, **stored})
        if not self.sends_feedforward:
            return self.cascade
        self.feedforward = cascade.feedforward
        return replace(self.cascade, feedforward=cascade.feedforward)

    @property
    def sends_feedforward(self) -> bool:
        """True if the drive takes a torque along with a reference and holds no feedforward of its own: the host computes and sends it."""
        own = self.drive.capabilities
        return own.structure.torque_feedforward and bool(own.torque_along) and "ff_coulomb_nm" not in self._backup

    def _along(self, motion_rad_s: Array, kind: LoopKind, torque_nm: Array | None) -> Array:
        """Torque sent along with a reference, N m."""
        along = np.zeros(len(motion_rad_s)) if torque_nm is None else torque_nm
        if self.feedforward is None or kind not in self.drive.capabilities.torque_along:
            return along
        return along + feedforward_torque(self.feedforward, motion_rad_s, self.drive.capabilities.sample_period_s)
