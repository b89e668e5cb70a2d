"""The virtual axis: a simulated drive and machine on a virtual CAN bus, driven by the same adapter as a real one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from beltcomm.drive import Adapter, Drive, Heard, Listening, Service
from beltcomm.drive.finding import Finding
from beltcomm.drive.objects import DictionaryEntry
from beltcomm.virtual.bus import LockstepBus
from beltcomm_adapters.buses import MonotonicClock
from beltcomm_adapters.canopen import EXAMINATION_OPTIONS, connect
from beltcomm_adapters.examination.can import examine_bus
from beltcomm_adapters.listening import PlayedListening
from beltcomm_adapters.new_profile import facts_of_bus, text_of
from beltcomm_adapters.options import number, whole_number
from beltcomm_adapters.virtual_node import NODE, attached, played, ticks_per_second


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
    from beltcomm_adapters.virtual_service import ServedDrive

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
