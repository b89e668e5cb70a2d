"""A CiA 402 servo drive over CANopen, on any CAN bus that python-can opens and on the virtual one."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final

import can

from beltcomm.drive import Adapter, Clock, Drive, ExchangeReport, Limits, Motion, Sink
from beltcomm.errors import BusError, DriveError, Refused, UsageError
from beltcomm_adapters.buses import DEFAULT_BITRATE, Address, MonotonicClock, is_socketcan, open_bus
from beltcomm_adapters.cia402 import State, StateMachine
from beltcomm_adapters.exchange import Exchange
from beltcomm_adapters.gains import Parameters
from beltcomm_adapters.identification import HOMING_MODE, read_capabilities, read_identity, sync_period_s
from beltcomm_adapters.interrupts import deferred_interrupt
from beltcomm_adapters.link import Link, find_nodes
from beltcomm_adapters.logged import LoggedBus
from beltcomm_adapters.motion import Run, Watch
from beltcomm_adapters.preparation import check_motion, guard, homing_speeds_rad_s, prepare
from beltcomm_adapters.profiles import choose_profile, load_profile
from beltcomm_adapters.scaling import read_scaling
from beltcomm_adapters.sdo import RECOVERY_S, RETRY_S, Objects
from beltcomm_adapters.setpoints import Layout, Setpoints, layout_of

_HOMING_PERIOD_S: Final = 0.010  # homing is watched, not sampled
_OPTIONS: Final = ("node", "bitrate", "profile", "log")


class CanopenDrive:
    """A drive behind a CAN bus; see :class:`beltcomm.drive.Drive`.

    While it is open, the speed unit and the enable logic (cmmp-as) are as the adapter needs them; mode of operation, PDOs,
    limits and guarding are changed during a recording only.

    bus, clock : open bus and its time.    node : number on the bus.    profile : name, None to choose by identity.
    bitrate : of the bus, None when it carries any load.    release : called once by :meth:`close`, last.
    Raises BusError when nobody answers, DriveError, DriveFault, UsageError for an unknown profile.
    """

    def __init__(
        self, bus: can.BusABC, clock: Clock, node: int, profile: str | None, bitrate: int | None, release: Callable[[], None]
    ) -> None:
        self.clock = clock
        self._release = release
        self._open = True
        self._homed = False
        self._link = Link(bus, clock, node)
        self._objects = Objects(self._link)
        self._session = self._objects.lend()
        where = f"{bus.channel_info}, node {node}" + (f", {bitrate // 1000} kbit/s" if bitrate else "")
        identity = read_identity(self._objects, where)
        self._link.restarted = False  # it may just have been switched on; from here on it must stay so
        self._profile = choose_profile(identity, profile)
        self._machine = StateMachine(self._link, self._objects, self._profile.emergency)
        self._machine.disable()
        try:
            self._borrow()
            self._parameters = Parameters(self._objects, self._profile, self._scaling)
            units = {
                "units_per_turn": f"{math.tau / abs(self._scaling.position_rad):g}",
                "rated_torque_nm": f"{self._scaling.rated_torque_nm:g}",
            }
            identity = {**identity, **units}  # a run is not gone on with when these have changed
            self.capabilities = read_capabilities(self._objects, self._profile, self._scaling, identity, bitrate, self._referenced())
        except BaseException:
            self._session.give_back()
            raise

    # -- values ---------------------------------------------------------------------------------------------------------

    def read(self, names: Sequence[str]) -> dict[str, float]:
        """See :meth:`beltcomm.drive.Drive.read`; ``state`` is a :class:`beltcomm_adapters.cia402.State`."""
        objects, scaling = self._objects, self._scaling
        measured: dict[str, Callable[[], float]] = {
            "position_rad": lambda: objects.read(0x6064, 0, "int32") * scaling.position_rad,
            "velocity_rad_s": lambda: objects.read(0x606C, 0, "int32") * scaling.speed_rad_s,
            "torque_nm": lambda: objects.read(0x6077, 0, "int16") * scaling.torque_nm,
            "state": lambda: float(self._machine.state()),
            "referenced": lambda: float(self._referenced()),
        }
        if unknown := [name for name in names if name not in measured and name not in self._parameters.names]:
            known = ", ".join((*measured, *self._parameters.names))
            raise UsageError(f"this drive has no quantity {', '.join(unknown)}; it has {known}")
        return {name: measured[name]() if name in measured else self._parameters.read([name])[name] for name in names}

    def write(self, values: Mapping[str, float]) -> dict[str, float]:
        """See :meth:`beltcomm.drive.Drive.write`; the stage is taken off first."""
        self._machine.disable()
        return self._parameters.write(values)

    def backup(self) -> dict[str, float]:
        """See :meth:`beltcomm.drive.Drive.backup`."""
        return self._parameters.read(self._parameters.names)

    def save(self) -> None:
        """See :meth:`beltcomm.drive.Drive.save`; what is lent to this session is saved as it was found."""
        self._machine.disable()
        if failures := self._session.give_back():
            raise DriveError(f"nothing was saved: {'; '.join(failures)}")
        try:
            self._objects.save()
        finally:
            self._borrow()

    # -- motion ---------------------------------------------------------------------------------------------------------

    def record(self, motion: Motion, limits: Limits, sink: Sink) -> ExchangeReport:
        """See :meth:`beltcomm.drive.Drive.record`.  Returns a :class:`beltcomm_adapters.motion.Report`."""
        here_rad = self._here_rad()
        drive_torque_nm = self._objects.read_int(0x6072, 0, "uint16") * self._scaling.torque_nm
        check_motion(motion, limits, self.capabilities, self._profile, here_rad, drive_torque_nm)
        # a speed loop gets 60B2h only when something is to be added: not every drive lets it be mapped there
        offsets = self._profile.offsets and (motion.kind != "velocity" or bool(motion.torque_nm.any()))
        layout = layout_of(self._profile.modes[motion.kind], offsets)
        with self._enabled(layout, motion.kind, motion.period_s, limits, motion) as run:
            return run.follow(Setpoints.of(motion, self._scaling), self._profile.torque_sampling, sink)

    def home(self, limits: Limits) -> None:
        """See :meth:`beltcomm.drive.Drive.home`: mode 6 with the method the drive is set to (6098h).

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
        with self._enabled(layout_of(HOMING_MODE, False), "homing", period_s, free, None) as run:
            slowest = max(min(speeds), self._scaling.speed_rad_s)
            run.home(width_rad / self._scaling.position_rad, 10.0 + 2.0 * width_rad / slowest)
        self._homed = True
        self.capabilities = dataclasses.replace(self.capabilities, referenced=True)

    @contextlib.contextmanager
    def _enabled(self, layout: Layout, kind: str, period_s: float, limits: Limits, motion: Motion | None) -> Iterator[Run]:
        """The axis enabled and guarded inside the block; stopped, disabled and set back after it, however it ends."""
        objects, scaling, link = self._objects, self._scaling, self._link
        faulted = self._machine.state() in (State.FAULT, State.FAULT_REACTION_ACTIVE)
        if link.restarted or (faulted and link.emergency is not None):  # what has come in this session is not acknowledged on the way
            raise self._machine.fault("standing between two motions")
        self._machine.reset_fault()
        self._machine.disable()
        link.forget_emergency()
        try:
            with objects.lend() as lending:
                speeds = motion.velocity_rad_s if motion is not None else None
                prepare(objects, lending, self._machine, self._profile, scaling, layout, period_s, limits, speeds)
                exchange = Exchange(link, objects, lending, period_s, layout.received)
                run = Run(
                    exchange,
                    layout,
                    kind,
                    Watch(limits, scaling, period_s, differences=motion is not None),
                    scaling,
                    period_s,
                    self._machine.fault,
                    lambda: link.restarted or link.emergency is not None,
                    objects.read_int(0x6064, 0, "int32"),
                    round(motion.rest_nm / scaling.torque_nm) if motion is not None else 0,
                )
                link.guard(guard(objects, lending, self._profile))
                exchange.start()
                try:
                    run.enable(limits.brake_s)
                    yield run
                except BaseException as error:
                    self._halt(run, exchange, error, limits.release)
                    link.forget_emergency()  # the error has told of it, or it came of the stop
                    if self._link.restarted and isinstance(error, BusError):  # its boot-up message came after its silence was noticed
                        raise self._machine.fault("moving") from error
                    raise
                self._halt(run, exchange, None)
        finally:
            link.guard(None)
            self.clock.sleep_until(self.clock.now() + limits.brake_s)  # it is over when a brake has had its time to close

    def _halt(self, run: Run, exchange: Exchange, error: BaseException | None, release: bool = False) -> None:
        """Stop and disable; a failure to do so is raised, or noted on the ``error`` that is already under way."""
        try:
            with deferred_interrupt():
                run.halt(release)
                exchange.end()
        except BusError as failure:
            self._link.guard(None)  # the drive's guarding is what stops the axis now
            if error is None:
                raise (self._machine.fault("being stopped") if self._link.restarted else failure) from None
            error.add_note(str(failure))
        except DriveError as failure:
            if error is None:
                raise
            error.add_note(str(failure))

    def stop(self) -> None:
        """See :meth:`beltcomm.drive.Drive.stop`."""
        if not self._open:
            return
        give_up_s = self.clock.now() + RECOVERY_S
        with contextlib.suppress(DriveError):
            while True:
                try:
                    self._machine.disable()
                    return
                except BusError:
                    if self.clock.now() >= give_up_s:
                        raise
                    self.clock.sleep_until(self.clock.now() + RETRY_S)

    def close(self) -> None:
        """See :meth:`beltcomm.drive.Drive.close`."""
        if not self._open:
            return
        with deferred_interrupt():
            self.stop()
            self._open = False
            try:
                self._session.give_back()
            finally:
                self._release()

    def __enter__(self) -> Drive:
        return self

    def __exit__(self, *_exc: object) -> None:
        self.close()

    # -- inside -----------------------------------------------------------------------------------------------------------

    def _borrow(self) -> None:
        """What is lent to this session: bus control first, then the speed unit."""
        if self._profile.enable_logic:
            self._session.set(*self._profile.enable_logic)
        self._scaling = read_scaling(self._objects, self._profile, self._session)

    def _here_rad(self) -> float:
        return self._objects.read(0x6064, 0, "int32") * self._scaling.position_rad

    def _referenced(self) -> bool:
        """What the drive tells of its zero; where it tells nothing, whether it was homed by us."""
        if self._profile.referenced is None:
            return self._homed
        index, subindex, bit = self._profile.referenced
        return bool(int.from_bytes(self._objects.read_bytes(index, subindex), "little") >> bit & 1)


def connect(
    bus: can.BusABC, clock: Clock, node: int | None, profile: str | None, bitrate: int | None, release: Callable[[], None]
) -> CanopenDrive:
    """The drive on an open bus; without ``node``, the only one there.  On failure the bus is released.

    Raises BusError when nobody answers, UsageError when several do, and what :class:`CanopenDrive` raises.
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
        return CanopenDrive(bus, clock, node, profile, bitrate, release)
    except BaseException:
        release()
        raise


def _open(address: str, options: Mapping[str, object]) -> Drive:
    if unknown := sorted(set(options) - set(_OPTIONS)):
        raise UsageError(f"a CAN drive has no option {', '.join(unknown)}; it has {', '.join(_OPTIONS)}")
    node = whole_number(options, "node", None, 1, 126)
    bitrate = whole_number(options, "bitrate", DEFAULT_BITRATE, 10_000, 1_000_000)
    assert bitrate is not None
    clock = MonotonicClock()
    bus = open_bus(Address.parse(address), bitrate)
    given: Mapping[str, Any] = options  # a function to be called with every frame is handed over by programs only
    if (log := given.get("log")) is not None:
        bus = LoggedBus(bus, clock, log)
    return connect(bus, clock, node, profile_name(options), bitrate, bus.shutdown)


def whole_number(options: Mapping[str, object], name: str, default: int | None, least: int, most: int) -> int | None:
    """An option as a whole number.  Raises UsageError."""
    value = options.get(name)
    if value is None:
        return default
    try:
        number = int(str(value), 0)
    except ValueError:
        number = least - 1
    if not least <= number <= most:
        raise UsageError(f"the option {name} must be a whole number from {least} to {most}, not {value}")
    return number


def profile_name(options: Mapping[str, object]) -> str | None:
    """The option ``profile``, None to choose by identity.  Raises UsageError when there is none of this name."""
    value = options.get("profile")
    return None if value is None else load_profile(str(value)).name


ADAPTER = Adapter(
    name="canopen",
    summary="CiA 402 drive over CANopen: can0 (SocketCAN), slcan:/dev/ttyACM0 (serial CAN adapter), can:INTERFACE:CHANNEL",
    schemes=("can", "slcan"),
    open=_open,
    claims=is_socketcan,
)
