"""The virtual axis: a simulated drive and machine on a virtual CAN bus, driven by the same adapter as a real one.

Other processes meet it on SocketCAN, a pseudo-terminal, or TCP on this computer.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from beltcomm.drive import Adapter, Drive, Heard, Listening, Service
from beltcomm.drive.finding import Finding
from beltcomm.drive.objects import DictionaryEntry
from beltcomm.errors import BusError, UsageError
from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.serving import Pump
from beltcomm.virtual.slcan import LocalSocket, SlcanAdapter, SlcanTerminal
from beltcomm_adapters.buses import DEFAULT_BITRATE, Address, MonotonicClock, is_can_bus, open_bus
from beltcomm_adapters.canopen import EXAMINATION_OPTIONS, connect
from beltcomm_adapters.examination.can import examine_bus
from beltcomm_adapters.link import INTERFACE_ERRORS
from beltcomm_adapters.listening import PlayedListening
from beltcomm_adapters.new_profile import facts_of_bus, text_of
from beltcomm_adapters.options import number, whole_number
from beltcomm_adapters.synctime import TIME_BY_SYNC
from beltcomm_adapters.virtual_node import NODE, OPTIONS, attached, played, ticks_per_second


class ServedDrive:
    """The virtual drive on a CAN interface for other processes; see :class:`beltcomm.drive.Service`.

    Parameters
    ----------
    on : str
        ``slcan`` (a pseudo-terminal), ``socket:PORT`` (TCP on this computer), or an interface of
        :class:`beltcomm_adapters.buses.Address`.
    options : Mapping[str, object]
        As of the adapter ``virtual``, with ``node`` (1). Without ``realtime`` each SYNC is one period of the drive.

    Raises
    ------
    UsageError, BusError
    """

    def __init__(self, address: str, on: str, options: Mapping[str, object]) -> None:
        if unknown := sorted(set(options) - {*OPTIONS, "node"}):
            raise UsageError(f"a served drive has no option {', '.join(unknown)}; leave it out")
        self._realtime = bool(options.get("realtime"))
        node = whole_number(options, "node", NODE, 1, 126) or NODE
        given: Mapping[str, Any] = options
        self._bus = LockstepBus(ticks_per_second=ticks_per_second(options))
        self._bus.on_frame = given.get("log")
        self._wire: Any = None
        try:
            hardware = "virtual" if self._realtime else f"virtual, {TIME_BY_SYNC}"
            drive, plant = attached(self._bus, address, options, node, hardware)
            self._wire, self.reached_as = _wire(on)
        except BaseException:
            self._bus.shutdown()
            raise
        time = "at the wall clock" if self._realtime else "each SYNC is one of its periods"
        profile, _ = played(options)
        self.title = f"virtual:{plant}, profile {profile}, node {node}, {time}"
        self._pump = Pump(self._wire, self._bus, drive, MonotonicClock())

    def run(self) -> Mapping[str, int]:
        """Serve the drive until it is stopped."""
        pump = self._pump
        try:
            (pump.by_wall_clock if self._realtime else pump.by_sync)()
        except KeyboardInterrupt:
            pass
        except INTERFACE_ERRORS as error:
            raise BusError(f"the interface {self.reached_as} does not take or give frames any more ({error}); serve again") from error
        counted = {"frames": pump.frames, "syncs": pump.syncs}
        return {**counted, "missed_ticks": pump.missed_ticks} if self._realtime else counted

    def __enter__(self) -> Service:
        return self

    def __exit__(self, *_exc: object) -> None:
        self._wire.shutdown()
        self._bus.shutdown()


def _wire(on: str) -> tuple[Any, str]:
    """The interface called ``on``, and how another process on this computer calls it."""
    kind, _, port = on.partition(":")
    if on == "slcan":
        line: SlcanTerminal | LocalSocket = SlcanTerminal()
    elif kind == "socket":
        if not (port.isdecimal() and int(port) < 1 << 16):
            raise UsageError(f"{on} names no TCP port; write socket:29536, or socket:0 for any free one")
        line = LocalSocket(int(port))
    else:
        return open_bus(Address.parse(on), DEFAULT_BITRATE), on if is_can_bus(on) else f"can:{on}"
    return SlcanAdapter(line), f"slcan:{line.address}"


def _playing(address: str, options: Mapping[str, object]) -> tuple[LockstepBus, str]:
    """The bus with the drive on it, and the machine's name.   ``address``: a plant's name or path, "" for g_a.  Options:

    seed : whole number, of the torque noise (0).     profile : "reference" or "cmmp-as".     as : another drive to be
    played, by name or file; ``profile`` is then the one that it is spoken to with.     realtime : run at the wall clock.
    start_position : m, where the carriage stands (0.25).     referenced : the encoder knows the carriage's zero (yes).
    bitrate : that its exchange is planned for, None for a bus that carries any load.     sample_period : s, asked for.
    gain_units : (velocity, position, integral time): what one unit of the drive's gains means, in those of docs/reference-drive.md.
    plant : a :class:`beltcomm.plant.Plant` in place of the plant file's model; its delay and noise stay.
    any key of a plant file's drive section (docs/simulated.md): in place of the file's.
    faults, bus_faults : ``Faults`` and ``BusFaults`` of :mod:`beltcomm.virtual.faults`.     log : called with every frame.
    """
    given: Mapping[str, Any] = options  # objects are handed over by programs only, of the types named above
    bus = LockstepBus(MonotonicClock() if options.get("realtime") else None, given.get("bus_faults"), ticks_per_second(options))
    bus.on_frame = given.get("log")
    try:
        _, machine = attached(bus, address, options)
    except BaseException:
        bus.shutdown()
        raise
    return bus, machine


def _open(address: str, options: Mapping[str, object]) -> Drive:
    bus, machine = _playing(address, options)
    bitrate = whole_number(options, "bitrate", None, 10_000, 1_000_000)
    given: Mapping[str, Any] = options
    period_s = number(options, "sample_period", None)
    drive = connect(bus, bus.clock, NODE, played(options)[1], bitrate, bus.shutdown, period_s, given.get("nameplate"))
    identity = {**drive.capabilities.identity, "plant": machine}  # the machine behind it is part of what a run was made on
    drive.capabilities = replace(drive.capabilities, identity=identity)
    return drive


def _listen(address: str, options: Mapping[str, object]) -> Listening:
    """Options: those of :func:`_playing`; ``silent``; ``production``: made of a drive, an iterator that drives one move for each step, for
    a virtual machine has no master of its own."""
    given: Mapping[str, Any] = options
    production = given.get("production")
    bus, _ = _playing(address, {name: value for name, value in options.items() if name not in ("silent", "production", "node")})
    heard: list[Heard] = []

    def hear(frame: tuple[float, int, bytes, str]) -> None:
        heard.append((*frame[:3], frame[3].endswith("rtr")))

    bus.on_frame = hear
    master = iter(()) if production is None else production(connect(bus, bus.clock, NODE, played(options)[1], None, lambda: None))
    return PlayedListening(master, bus, heard, bus.clock, NODE, bus.shutdown, ask=not options.get("silent"))


def _examine(address: str, options: Mapping[str, object]) -> Iterator[Finding]:
    own = {name: value for name, value in options.items() if name not in EXAMINATION_OPTIONS}
    bus, _ = _playing(address, own)
    try:
        yield from examine_bus(bus, bus.clock, NODE, None, played(own)[1], options)
    finally:
        bus.shutdown()


def _new_profile(address: str | None, options: Mapping[str, object], _device: Mapping[str, str], entries: Sequence[DictionaryEntry]) -> str:
    bus, _ = _playing(address or "", options)
    try:
        return text_of(facts_of_bus(bus, bus.clock, NODE, entries))
    finally:
        bus.shutdown()


def _serve(address: str, on: str, options: Mapping[str, object]) -> Service:
    if on == "rs232":
        from beltcomm_adapters.virtual_serial import ServedSerial

        return ServedSerial(address, options)

    return ServedDrive(address, on, options)


ADAPTER = Adapter(
    name="virtual",
    summary="simulated drive and axis: virtual, virtual:PLANT (a shipped plant's name, or a path to a plant file)",
    schemes=("virtual",),
    open=_open,
    examine=_examine,
    serve=_serve,
    logs=True,
    nameplates=True,
    new_profile=_new_profile,
    listen=_listen,
)
