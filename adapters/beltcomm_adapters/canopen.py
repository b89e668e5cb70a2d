"""A CiA 402 servo drive over CANopen, on any CAN bus that python-can opens and on the virtual one."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final

import can
import numpy as np

from beltcomm.drive import Adapter, Clock, Drive, ExchangeReport, Guarding, KnownMotor, Limits, Listening, Motion, ObservedStop, Sink
from beltcomm.drive.finding import Finding
from beltcomm.drive.objects import DictionaryEntry
from beltcomm.errors import BusError, DriveError, Refused, UsageError
from beltcomm_adapters import host_reaction
from beltcomm_adapters.buses import DEFAULT_BITRATE, Address, LoggedBus, MonotonicClock, is_can_bus, open_bus
from beltcomm_adapters.cia402 import State
from beltcomm_adapters.consistency import Odometer, SpeedUnit
from beltcomm_adapters.examination.can import examine_can
from beltcomm_adapters.examination.surroundings import surroundings
from beltcomm_adapters.exchange import Exchange
from beltcomm_adapters.identification import (
    HOMING_MODE,
    as_the_drive_is,
    read_capabilities,
    read_identity,
    supported_modes,
    sync_period_s,
)
from beltcomm_adapters.interrupts import deferred_interrupt
from beltcomm_adapters.link import NMT_PRE_OPERATIONAL, Link, find_nodes
from beltcomm_adapters.listening import BusListening, HeardBus
from beltcomm_adapters.motion import Run
from beltcomm_adapters.new_profile import facts_of_bus, facts_of_file, text_of
from beltcomm_adapters.object_drive import ObjectDrive
from beltcomm_adapters.options import number, profile_name, whole_number
from beltcomm_adapters.preparation import check_motion, guard, homing_method, homing_speeds_rad_s, prepare, quick_stop_rad_s2
from beltcomm_adapters.profile_schema import json_schema
from beltcomm_adapters.profiles import choose_profile, load_profile
from beltcomm_adapters.sdo import SdoObjects
from beltcomm_adapters.setpoints import Layout, Setpoints, layout_of
from beltcomm_adapters.synctime import SyncTimeBus, keeps_time_by_sync
from beltcomm_adapters.trial import tried
from beltcomm_adapters.watch import LimitWatch

_PROFILE_VELOCITY: Final = 3
_HOMING_PERIOD_S: Final = 0.010  # homing is watched, not sampled
_OPTIONS: Final = ("node", "bitrate", "profile", "sample_period", "log", "nameplate")
#: Of an examination only, see :class:`beltcomm.drive.Adapter`.
EXAMINATION_OPTIONS: Final = ("try_bitrates", "sync_test")
#: s beyond the guard time within which a drive must have reacted to the silence of its host.
GUARD_TOLERANCE_S: Final = 0.05
#: rad: of a motor whose units nobody tells, a third of a millimetre of an ordinary carriage; were they 16 times as long, 5 mm.
FEEL_RAD: Final = 0.025
_COMMUNICATION_ERRORS: Final = 0x81  # first byte of the EMCY codes for life guarding, heartbeat and the bus


class CanopenDrive(ObjectDrive):
    """A drive behind a CAN bus; see :class:`beltcomm.drive.Drive`.

    While it is open, the speed unit and the enable logic (cmmp-as) are as the adapter needs them; mode of operation, PDOs, limits and
    guarding are changed during a recording only.

    Attributes
    ----------
    last_stop : ObservedStop or None
        Quick stop that ended the record before; None where none did.

    Parameters
    ----------
    bus, clock
        Open bus and its time.
    node : int
        Number on the bus.
    profile : str or None
        Name, None to choose by identity.
    bitrate : int or None
        Of the bus, None when it carries any load.
    release : callable
        Called once by :meth:`close`, last.
    sample_period_s : float or None
        Asked for, None for the shortest that the bus carries.

    Raises
    ------
    BusError
        When nobody answers.
    DriveError
    DriveFault
    UsageError
        For an unknown profile.
    """

    def __init__(
        self,
        bus: can.BusABC,
        clock: Clock,
        node: int,
        profile: str | None,
        bitrate: int | None,
        release: Callable[[], None],
        sample_period_s: float | None = None,
        nameplate: KnownMotor | None = None,
    ) -> None:
        self._guarding: Guarding | None = None
        self._arrangement = 0  # of the drive's answers: what it has refused once is not asked for again
        self._learnt, self._told = tuple[str, ...](), set[str]()
        self._speed_rad_s: float | None = None
        self.last_stop: ObservedStop | None = None
        self._link = Link(bus, clock, node)
        super().__init__(clock, SdoObjects(self._link), release)
        where = f"{bus.channel_info}, node {node}" + (f", {bitrate // 1000} kbit/s" if bitrate else "")
        identity = read_identity(self._objects, where)
        self._link.restarted = False  # it may just have been switched on; from here on it must stay so
        self._take_over(self._link, as_the_drive_is(self._objects, choose_profile(identity, profile)), nameplate)
        self._speed_unit = None if self._scaling.speed_told else SpeedUnit(self._scaling.position_rad)
        self._odometer = self._new_odometer()
        try:
            self.capabilities = read_capabilities(
                self._objects,
                self._profile,
                self._scaling,
                {**identity, **self._units()},
                bitrate,
                self._referenced(),
                self._parameters.table,
                self._parameters.uncalibrated,
                sample_period_s,
                nameplate,
            )
            if self._speed_unit is not None and not self._scaling.position_told:
                self.capabilities = dataclasses.replace(self.capabilities, feel_rad=FEEL_RAD)
        except BaseException:
            self._session.give_back()
            raise

    def record(self, motion: Motion, limits: Limits, sink: Sink) -> ExchangeReport:
        """Carry out a motion and record it.  Returns a :class:`beltcomm_adapters.motion.Report`."""
        self._learn()
        self._check(motion, limits)
        if motion.kind == "torque" and not limits.release:  # the loop that would brake it is not to be trusted yet
            self.prove_guarding(limits, motion.rest_nm)
        # a speed loop gets 60B2h only when something is to be added: not every drive lets it be mapped there
        offsets = self._profile.offsets and (motion.kind != "velocity" or bool(motion.torque_nm.any()))
        layout = layout_of(self._profile.modes[motion.kind], offsets)
        with self._enabled(layout, motion.kind, motion.period_s, limits, motion) as run:
            report = run.follow(Setpoints.of(motion, self._scaling), self._profile.torque_sampling, sink)
        learnt, self._learnt = self._learnt, ()
        return dataclasses.replace(report, remarks=(*report.remarks, *learnt)) if learnt else report

    def _new_odometer(self) -> Odometer:
        return Odometer(self._scaling.position_rad, self._scaling.speed_rad_s)

    def _learn(self) -> None:
        """Take the unit of speeds from the motions so far, if nobody tells it and they have shown it."""
        unit_rad_s = self._speed_unit.found_rad_s() if self._speed_unit is not None else None
        if unit_rad_s is None:
            return
        before, self._speed_unit, self._speed_rad_s = self._scaling, None, unit_rad_s
        self.capabilities = dataclasses.replace(self.capabilities, feel_rad=0.0)
        self._scaling = before.with_speed(unit_rad_s)
        self._odometer = self._new_odometer()
        if abs(unit_rad_s / before.speed_rad_s - 1.0) > 1e-6:
            self._learnt += (
                f"one unit of the drive's speeds (606Ch) is {unit_rad_s:.4g} rad/s by what its position does, not "
                f"{before.speed_rad_s:.4g} rad/s as where no 60A9h is; accelerations are taken in "
                + ("their own unit" if before.acceleration_told else "it per second"),
            )

    def _borrow(self) -> None:
        super()._borrow()
        if self._speed_rad_s is not None:
            self._scaling = self._scaling.with_speed(self._speed_rad_s)

    def trial(self) -> list[Finding]:
        """Prepare for a kind of record: its PDOs and limits, tried with the stage off and put back."""
        modes = supported_modes(self._objects, self._profile)
        own = self.capabilities
        found = list(tried(self._objects, self._profile, self._scaling, modes, own.sample_period_s, own.max_speed_rad_s))
        self._told |= {one.text for one in found} | set(own.cautions)
        return found

    def quick_stop_rad_s2(self, limits: Limits) -> float | None:
        """Deceleration that a quick stop really has under these limits, motor shaft.   Nothing moves.

        Parameters
        ----------
        limits : Limits, motor shaft

        Returns
        -------
        float or None
            None where nobody can tell.
        """
        return quick_stop_rad_s2(self._objects, self._scaling, limits)

    def _tell(self, sentences: Sequence[str]) -> None:
        """Remember for the next record how a drive takes a setting, once."""
        new = [text for text in sentences if text not in self._told]
        self._told |= set(new)
        self._learnt += tuple(new)

    def prove_guarding(self, limits: Limits, rest_nm: float = 0.0) -> Guarding:
        """Withhold the sign of life at standstill and measure the reaction.

        Only the sign of life is withheld: SYNC and setpoints go on, so that the statusword tells when and how the drive reacts.  A brake
        is not waited for: it has hardly begun to open when the drive reacts.
        """
        if self._guarding is not None:
            return self._guarding
        zero = np.zeros(1)
        motion = Motion("torque", self.capabilities.sample_period_s, zero, zero, zero + rest_nm, rest_nm)
        self._check(motion, limits)
        layout, now = layout_of(self._profile.modes["torque"], False), self.clock.now
        limit_s = limits.guard_s + GUARD_TOLERANCE_S
        with self._enabled(layout, "torque", motion.period_s, dataclasses.replace(limits, brake_s=0.0), motion) as run:
            self._link.guard(None)
            since_s = self._link.last_life_s
            seen = run.outlive(now, since_s, since_s + limit_s, self._asked_word, lambda: self._link.emergency_s)
            code = self._link.emergency.code if self._link.emergency else 0
            if seen is None:
                raise DriveError(
                    f"the drive did not react within {1e3 * limit_s:.0f} ms when the computer fell silent (guard time "
                    f"{1e3 * limits.guard_s:.0f} ms): it would go on holding its torque if the computer died, so it gets none; "
                    f"set its reaction to a lost master to a stop with the maker's tool{self._settings_words()}"
                )
            if code and code >> 8 != _COMMUNICATION_ERRORS:
                raise self._machine.fault("its guarding was tried")
        self.clock.sleep_until(self.clock.now() + limits.brake_s)
        self._machine.reset_fault()
        self._guarding = Guarding(limits.guard_s, *seen)
        return self._guarding

    def _asked_word(self) -> int:
        """6041h by SDO, of a node that exchanges no PDOs any more; one that is Stopped is first called to pre-operational, without which
        it answers none."""
        try:
            return self._machine.statusword()
        except BusError:
            self._link.send_nmt(NMT_PRE_OPERATIONAL)
            return self._machine.statusword()

    def _stopped_by_sdo(self) -> bool:
        """Stop and disable a node that exchanges no PDOs any more; whether it did."""
        with contextlib.suppress(BusError, DriveError):
            self._asked_word()
            self._machine.disable()
            return True
        return False

    def _settings_words(self) -> str:
        """Setting of its reaction, as a sentence's end."""
        said = host_reaction.words(self._objects)
        return f"; now {said}" if said else ""

    def _check(self, motion: Motion, limits: Limits) -> None:
        limit = self._objects.read_if_there(0x6072, 0, "uint16")
        drive_torque_nm = self.capabilities.peak_torque_nm if limit is None else limit * self._scaling.torque_nm
        check_motion(motion, limits, self.capabilities, self._profile, self._here_rad(), drive_torque_nm)

    def home(self, limits: Limits) -> None:
        """Let the drive find its zero: mode 6 with the method of the profile, or that the drive is set to (6098h).

        The zero is not known before, so the width of the window is what the axis may travel from where it stands.
        """
        if not self.capabilities.can_home:
            raise Refused("this drive has no homing; state where the carriage is with --position instead")
        speeds = homing_speeds_rad_s(self._objects, self._scaling, limits)
        width_rad = limits.position_max_rad - limits.position_min_rad
        free = dataclasses.replace(limits, position_min_rad=-math.inf, position_max_rad=math.inf)
        period_s = _HOMING_PERIOD_S
        if self._profile.sync_change == "after_reset":
            period_s = sync_period_s(self._objects) or period_s
        with (
            homing_method(self._objects, self._profile),
            self._enabled(layout_of(HOMING_MODE, False), "homing", period_s, free, None) as run,
        ):
            slowest = max(min(speeds), self._scaling.speed_rad_s)
            run.home(width_rad / self._scaling.position_rad, 10.0 + 2.0 * width_rad / slowest)
        self._homed = True
        self.capabilities = dataclasses.replace(self.capabilities, referenced=True)

    @contextlib.contextmanager
    def _enabled(self, layout: Layout, kind: str, period_s: float, limits: Limits, motion: Motion | None) -> Iterator[Run]:
        """The axis enabled and guarded inside the block; stopped, disabled and set back after it, however it ends."""
        objects, scaling, link, self.last_stop = self._objects, self._scaling, self._link, None
        faulted = self._machine.state() in (State.FAULT, State.FAULT_REACTION_ACTIVE)
        if link.restarted or (faulted and link.emergency is not None):  # what has come in this session is not acknowledged on the way
            raise self._machine.fault("standing between two motions")
        self._machine.reset_fault()
        self._machine.disable()
        link.forget_emergency()
        exchange: Exchange | None = None
        try:
            with objects.lend() as lending:
                prepare(objects, lending, self._machine, self._profile, scaling, layout, period_s, limits, motion)
                self._tell(tuple(lending.altered))
                unit_s = scaling.speed_rad_s / scaling.position_rad
                exchange = Exchange(
                    link, objects, lending, period_s, layout.received, self._arrangement, unit_s, self._profile.mapped_torque,
                    scaling.reading_nm / scaling.torque_nm,
                )  # fmt: skip
                self._arrangement = exchange.arrangement
                run = Run(
                    exchange,
                    layout,
                    kind,
                    LimitWatch(
                        limits, scaling, period_s, motion is not None, self._speed_unit if motion is not None else None, self._odometer
                    ),
                    scaling,
                    period_s,
                    self._machine.fault,
                    lambda: link.restarted or link.emergency is not None,
                    objects.read_int(0x6064, 0, "int32"),
                    round(motion.rest_nm / scaling.torque_nm) if motion is not None else 0,
                    self.capabilities.structure.period_s,
                )
                link.guard(guard(objects, lending, self._profile, limits.guard_s), limits.guard_s)
                exchange.start()
                try:
                    run.enable(limits.brake_s)
                    self._machine.confirm_mode(layout.mode)
                    yield run
                except BaseException as error:
                    self._odometer = self._new_odometer()  # a jump of the encoder must not be counted later
                    self._halt(run, exchange, error, limits.release and not getattr(error, "answered", False))
                    link.forget_emergency()  # the error has told of it, or it came of the stop
                    if self._link.restarted and isinstance(error, BusError):  # its boot-up message came after its silence was noticed
                        raise self._machine.fault("moving") from error
                    raise
                self._halt(run, exchange, None)
        finally:
            if exchange is not None:
                exchange.stop_sync()
            link.guard(None)
            self.clock.sleep_until(self.clock.now() + limits.brake_s)  # it is over when a brake has had its time to close

    def _halt(self, run: Run, exchange: Exchange, error: BaseException | None, release: bool = False) -> None:
        """Stop and disable; a failure to do so is raised, or noted on the ``error`` that is already under way."""
        try:
            with deferred_interrupt():
                if run.torque_mode and self._profile.torque_exit == "velocity" and not release:
                    with contextlib.suppress(DriveError):  # the quick stop comes all the same
                        self._objects.write(0x6060, 0, "int8", _PROFILE_VELOCITY)
                        run.stand_by_speed()
                if not (run.left_alone() and self._stopped_by_sdo()):
                    run.halt(release)
                    self.last_stop = run.stop
                exchange.end()
        except BusError as failure:
            self._link.guard(None)  # the drive's guarding is what stops the axis now
            if self._stopped_by_sdo():
                failure.add_note("the drive answered without PDOs and was stopped that way; its stage is off")
            if error is None:
                raise (self._machine.fault("being stopped") if self._link.restarted else failure) from None
            error.add_note(str(failure))
        except DriveError as failure:
            if error is None:
                raise
            error.add_note(str(failure))


def connect(
    bus: can.BusABC,
    clock: Clock,
    node: int | None,
    profile: str | None,
    bitrate: int | None,
    release: Callable[[], None],
    sample_period_s: float | None = None,
    nameplate: KnownMotor | None = None,
) -> CanopenDrive:
    """The drive on an open bus; without ``node``, the only one there.  On failure the bus is released.

    Parameters
    ----------
    bus : BusABC
        Open.
    clock : Clock
    node : int or None
        Its number; None for the only one.
    profile : str or None
        Name or path; None chooses by identity.
    bitrate : int or None, bit/s
        None where time is not the bus's own.
    release : callable
        Closes the bus.
    sample_period_s : float or None, s
        None for the usual one.
    nameplate : KnownMotor or None
        Motor by axis.yaml; None where it is not known.

    Raises
    ------
    BusError
        When nobody answers.
    UsageError
        When several do.
    DriveError
        As :class:`CanopenDrive`.
    """
    try:
        if node is None:
            nodes = find_nodes(bus, clock)
            rate = f" at {bitrate // 1000} kbit/s" if bitrate else ""
            if not nodes:
                raise BusError(
                    f"no node answers on {bus.channel_info}{rate}; check that the drive is on, its bit rate, the cable and both terminators"
                )
            if len(nodes) > 1:
                found = ", ".join(map(str, nodes))
                raise UsageError(f"several nodes answer on {bus.channel_info}: {found}; say which one is the drive with --node")
            node = nodes[0]
        if bitrate is not None and keeps_time_by_sync(bus, clock, node):
            timed = SyncTimeBus(bus, node, release)
            # where time stands, a bus carries any load
            return CanopenDrive(timed, timed.clock, node, profile, None, timed.shutdown, sample_period_s, nameplate)
        return CanopenDrive(bus, clock, node, profile, bitrate, release, sample_period_s, nameplate)
    except BaseException:
        release()
        raise


def _open(address: str, options: Mapping[str, object]) -> Drive:
    _check_known(options, _OPTIONS)
    node, bitrate = _node_and_bitrate(options)
    profile, period_s = profile_name(options), number(options, "sample_period", None)
    clock = MonotonicClock()
    bus = open_bus(Address.parse(address), bitrate)
    given: Mapping[str, Any] = options  # a function to be called with every frame is handed over by programs only
    if (log := given.get("log")) is not None:
        bus = LoggedBus(bus, clock, log)
    return connect(bus, clock, node, profile, bitrate, bus.shutdown, period_s, given.get("nameplate"))


def _listen(address: str, options: Mapping[str, object]) -> Listening:
    _check_known(options, ("node", "bitrate", "silent"))
    node, bitrate = _node_and_bitrate(options)
    clock = MonotonicClock()
    bus = HeardBus(open_bus(Address.parse(address), bitrate), clock)
    return BusListening(bus, bus.heard, clock, node, bus.shutdown, ask=not options.get("silent"))


def _node_and_bitrate(options: Mapping[str, object]) -> tuple[int | None, int]:
    return whole_number(options, "node", None, 1, 126), whole_number(
        options, "bitrate", DEFAULT_BITRATE, 10_000, 1_000_000
    ) or DEFAULT_BITRATE


def _check_known(options: Mapping[str, object], known: tuple[str, ...]) -> None:
    if unknown := sorted(set(options) - set(known)):
        raise UsageError(f"a CAN drive has no option {', '.join(unknown)}; it has {', '.join(known)}")


def _examine(address: str, options: Mapping[str, object]) -> Iterator[Finding]:
    _check_known(options, (*_OPTIONS, *EXAMINATION_OPTIONS))
    node, bitrate = _node_and_bitrate(options)
    return examine_can(address, node, bitrate if options.get("bitrate") is not None else None, profile_name(options), options)


def _new_profile(address: str | None, options: Mapping[str, object], device: Mapping[str, str], entries: Sequence[DictionaryEntry]) -> str:
    if address is None:
        return text_of(facts_of_file(device, entries))
    node, bitrate = _node_and_bitrate(options)
    bus = open_bus(Address.parse(address), bitrate)
    try:
        return text_of(facts_of_bus(bus, MonotonicClock(), node, entries))
    finally:
        bus.shutdown()


ADAPTER = Adapter(
    name="canopen",
    summary="CiA 402 drive over CANopen: can0 (SocketCAN), slcan:/dev/ttyACM0 (serial CAN adapter), can:INTERFACE:CHANNEL",
    schemes=("can", "slcan"),
    open=_open,
    claims=is_can_bus,
    examine=_examine,
    surroundings=surroundings,
    logs=True,
    nameplates=True,
    new_profile=_new_profile,
    check_profile=load_profile,
    profile_schema=json_schema,
    listen=_listen,
)
