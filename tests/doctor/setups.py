"""Broken set-ups for ``beltcomm doctor``, each with what is broken and the command its user types.

As a program it writes docs/doctor.md anew from what the command prints: ``python -m doctor.setups`` in the folder ``tests``.
"""

from __future__ import annotations

import errno
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import can
from click.testing import CliRunner, Result

from beltcomm.cli.main import cli
from beltcomm.drive import Adapter, FoundAdapter, find_adapters
from beltcomm.drive.finding import Finding
from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.device import VirtualDrive
from beltcomm.virtual.faults import Faults
from beltcomm_adapters.buses import _is_socketcan
from beltcomm_adapters.examination.can import examine_can
from beltcomm_adapters.examination.host import Host, SerialPortInfo
from beltcomm_adapters.examination.line import examine_line
from beltcomm_adapters.examination.surroundings import surroundings
from virtual.host import RigidPlant

PAGE = Path(__file__).parents[2] / "docs" / "doctor.md"
RATIO_M_RAD = 0.01242  # of the shipped axis egc-70-600
ACK_ERROR = can.Message(arbitration_id=0x20, is_error_frame=True, is_extended_id=False, dlc=8, data=bytes(8))

#: What ``ip -details -json link show`` prints of a CAN interface, cut to what matters.
LINK = {"ifname": "can0", "linkinfo": {"info_kind": "can", "info_data": {"state": "ERROR-ACTIVE", "bittiming": {"bitrate": 1000000}}}}


class SickBus(LockstepBus):
    """A bus on which nobody acknowledges: every frame sent comes back as an error frame."""

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._errors = [*getattr(self, "_errors", []), ACK_ERROR]

    def recv(self, timeout: float | None = None) -> can.Message | None:
        errors = getattr(self, "_errors", [])
        return errors.pop() if errors else super().recv(timeout)


@dataclass
class CurrentClock:
    """Virtual time of whichever bus was opened last."""

    bus: LockstepBus | None = None

    def now(self) -> float:
        assert self.bus is not None
        return self.bus.clock.now()

    def sleep_until(self, t_s: float) -> None:
        assert self.bus is not None
        self.bus.clock.sleep_until(t_s)


@dataclass
class Bench:
    """Drives on a bus behind can0 or slcan, as one test wants them.

    nodes : node numbers, each with a drive of ``profile``.     bitrate : of the drives.     before : is done on the bus beforehand.
    interface : the entry of ``ip`` for can0, None where there is no interface.     more : arguments of the virtual drive.
    """

    profile: str = "reference"
    faults: Faults = field(default_factory=Faults)
    nodes: tuple[int, ...] = (1,)
    bitrate: int = 1_000_000
    position_m: float = 0.25
    up: bool = True
    link: Mapping[str, Any] | None = field(default_factory=lambda: LINK)
    before: Callable[[LockstepBus], None] = lambda _bus: None
    more: Mapping[str, Any] = field(default_factory=dict)

    def bus(self, channel: str) -> LockstepBus:
        """A fresh bus with fresh drives, which have booted."""
        bus = LockstepBus()
        bus.channel_info = channel
        for node in self.nodes:
            settings = {"referenced": True, "zero_rad": -self.position_m / RATIO_M_RAD, "torque_noise_nm": 0.0, **self.more}
            VirtualDrive(bus, RigidPlant(), self.profile, node_id=node, faults=replace(self.faults), **settings)
        while bus.recv(0.1) is not None:  # boot-up messages
            pass
        self.before(bus)
        return bus

    def found(self, folder: Path) -> list[FoundAdapter]:
        """The adapter whose interface leads to this bench."""
        clock = CurrentClock()

        def examine(address: str, options: Mapping[str, object]) -> Iterator[Finding]:
            slcan = not _is_socketcan(address)
            channel = f"Serial interface: {address}" if slcan else f"socketcan channel '{address}'"

            def opener(bitrate: int, _listen_only: bool) -> can.BusABC:
                if slcan and bitrate != self.bitrate:
                    clock.bus = SickBus()
                    clock.bus.channel_info = channel
                else:
                    clock.bus = self.bus(channel)
                return clock.bus

            node, bitrate, profile = (options.get(name) for name in ("node", "bitrate", "profile"))
            return examine_can(address, node, bitrate, profile, options, host=self.host(folder), opener=opener, clock=clock)

        return [FoundAdapter("canopen", Adapter("canopen", "CAN", ("can", "slcan"), _no_drive, _is_socketcan, examine))]

    def host(self, folder: Path) -> Host:
        """A machine with can0, or without."""
        net = folder / "class" / "net"
        (net / "lo").mkdir(parents=True, exist_ok=True)
        (net / "lo" / "type").write_text("772\n", encoding="ascii")
        if self.link is not None:
            (net / "can0").mkdir(exist_ok=True)
            (net / "can0" / "type").write_text("280\n", encoding="ascii")
            (net / "can0" / "flags").write_text("0x40081\n" if self.up else "0x40080\n", encoding="ascii")
        return Host(folder, lambda: json.dumps([self.link] if self.link else []), lambda: True)


@dataclass
class Machine:
    """A machine on which doctor is called without a drive.   ports : its serial ports.   broken : of an adapter that cannot be loaded."""

    ports: list[SerialPortInfo] = field(default_factory=list)
    broken: tuple[str, str] | None = None
    detected: list[dict[str, Any]] | None = field(default_factory=list)
    has_can: bool = True
    usb: tuple[int, int] | None = None
    bench: Bench = field(default_factory=lambda: Bench(link=None))

    def found(self, folder: Path) -> list[FoundAdapter]:
        def look() -> Iterator[Finding]:
            host = self.bench.host(folder)
            if self.usb:
                device = folder / "bus" / "usb" / "devices" / "1-1"
                device.mkdir(parents=True, exist_ok=True)
                (device / "idVendor").write_text(f"{self.usb[0]:04x}\n", encoding="ascii")
                (device / "idProduct").write_text(f"{self.usb[1]:04x}\n", encoding="ascii")
            backends = {"socketcan": "", "slcan": "", "pcan": "", "kvaser": "Kvaser canlib is unavailable."}
            return surroundings(
                Host(folder, host.ip_link, lambda: self.has_can), lambda: self.ports, lambda: backends, lambda _n: self.detected
            )

        found = [FoundAdapter("canopen", Adapter("canopen", "CiA 402 drive over CANopen", ("can", "slcan"), _no_drive, surroundings=look))]
        return [*found, FoundAdapter(self.broken[0], None, self.broken[1])] if self.broken else found


@dataclass
class SerialBench:
    """A serial port that cannot be opened."""

    error: OSError

    def found(self, _folder: Path) -> list[FoundAdapter]:
        def examine(address: str, options: Mapping[str, object]) -> Iterator[Finding]:
            return examine_line(address, options, opener=self._open, group=lambda _device: "dialout")

        return [FoundAdapter("serial", Adapter("serial", "RS-232", ("serial",), _no_drive, examine=examine))]

    def _open(self, *_: object) -> Any:
        raise self.error


class Installed:
    """The installed adapters, with the virtual drive."""

    def found(self, _folder: Path) -> Sequence[FoundAdapter]:
        return find_adapters()


def _no_drive(*_: object) -> Any:
    raise AssertionError("doctor must not open a drive")


@dataclass(frozen=True)
class Setup:
    """One broken set-up.   what : is broken, in words.   words : of the command line behind ``beltcomm``.   bench : behind it all."""

    what: str
    words: str
    bench: Bench | Machine | SerialBench | Installed


def _nmt_stop(bus: LockstepBus) -> None:
    bus.send(can.Message(arbitration_id=0, data=b"\x02\x01", is_extended_id=False))


def _other_master(bus: LockstepBus) -> None:
    """A controller on the same bus: SYNC and a setpoint, as another node's frames arrive."""
    for identifier in (0x080, 0x201):
        bus._queue.append((bus.clock.now(), identifier, b""))


CAN0, CAN0_AXIS = "doctor --drive can0", "doctor --drive can0 --axis egc-70-600"
DENIED = SerialPortInfo("/dev/ttyACM0", "CANable", (0xAD50, 0x60C4), False, "dialout")
SETUPS: dict[str, Setup] = {
    "no_interface": Setup("the interface has another name", "doctor --drive can7", Bench()),
    "interface_down": Setup("the interface is down", CAN0, Bench(up=False)),
    "bus_off": Setup(
        "the interface went bus-off", CAN0, Bench(link={**LINK, "linkinfo": {"info_kind": "can", "info_data": {"state": "BUS-OFF"}}})
    ),
    "wrong_bitrate": Setup(
        "the drive has another bit rate, nobody acknowledges", "doctor --drive slcan:/dev/ttyACM0 --try-bitrates", Bench(bitrate=250_000)
    ),
    "drive_off": Setup("the drive is off, another node acknowledges", CAN0, Bench(faults=Faults(silent_from_s=0.0))),
    "two_nodes": Setup("two drives on the bus", CAN0, Bench(nodes=(1, 5))),
    "nmt_stopped": Setup("the node is in the NMT state stopped", CAN0, Bench(before=_nmt_stop)),
    "other_master": Setup("a controller commands the drive", CAN0, Bench(before=_other_master)),
    "fault": Setup("an undervoltage fault is active", CAN0, Bench(faults=Faults(emergency_at_s=0.0))),
    "no_dc_link": Setup("the motor supply is off", CAN0, Bench(faults=Faults(dc_link_v=0.4))),
    "sto_open": Setup("the emergency stop is pressed (STO open), CMMP-AS", CAN0, Bench("cmmp-as", Faults(sto_open=True))),
    "enable_input_low": Setup("the enable input is low, CMMP-AS", CAN0, Bench("cmmp-as", Faults(enable_input_low=True))),
    "enable_logic": Setup("the enable logic is not set for the bus, CMMP-AS as delivered", CAN0, Bench("cmmp-as")),
    "local_control": Setup("the maker's tool holds the control", CAN0, Bench(faults=Faults(local_control=True))),
    "gear": Setup("the drive's gear belongs to another axis", CAN0_AXIS, Bench(faults=Faults(readings={(0x6091, 1): 3}))),
    "feed": Setup("the feed constant is doubled", CAN0_AXIS, Bench(faults=Faults(readings={(0x6092, 1): 131072}))),
    "rated_torque": Setup("the rated torque 6076h is doubled", CAN0_AXIS, Bench(faults=Faults(rated_torque_nm=2.86))),
    "another_machine": Setup("a virtual drive plays another axis", "doctor --drive virtual --axis ball-screw", Installed()),
    "guarding": Setup("remote frames do not get through, CMMP-AS", CAN0, Bench("cmmp-as", Faults(remote_frames_blocked=True))),
    "lost_sync": Setup(
        "every 20th SYNC is not answered",
        "doctor --drive can0 --sync-test",
        Bench(faults=Faults(ignore_sync=frozenset(range(20, 2000, 20)))),
    ),
    "window_off": Setup("the following error window is off", CAN0, Bench(faults=Faults(readings={(0x6065, 0): 0xFFFFFFFF}))),
    "unreferenced": Setup("the drive was not homed", CAN0_AXIS, Bench(more={"referenced": False, "zero_rad": 0.0})),
    "outside": Setup("the carriage stands outside the travel", CAN0_AXIS, Bench(position_m=0.62)),
    "end_switch": Setup("the carriage stands on the lower end switch", CAN0, Bench(more={"end_switches_rad": (0.0, 40.0)})),
    "not_a_drive": Setup("the node is an I/O module", CAN0, Bench(faults=Faults(readings={(0x1000, 0): 0x00030191}))),
    "cut_off": Setup("a run was killed", CAN0, Bench("cmmp-as", Faults(readings={(0x100C, 0): 50, (0x100D, 0): 1}))),
    "adapter_broken": Setup(
        "an adapter package cannot be loaded",
        "doctor",
        Machine(broken=("acme_drives:ADAPTER", "ModuleNotFoundError: No module named 'acme_lib'")),
    ),
    "no_permission": Setup("the user may not open the port of the CAN adapter", "doctor", Machine(ports=[DENIED])),
    "no_driver": Setup("a USB CAN adapter without its kernel module", "doctor", Machine(usb=(0x0C72, 0x000C))),
    "port_denied": Setup(
        "a serial port without permission",
        "doctor --drive serial:/dev/ttyUSB0",
        SerialBench(PermissionError(errno.EACCES, "Permission denied")),
    ),
}


def called(setup: Setup, *more: str) -> Result:
    """The command line run on a set-up."""
    with TemporaryDirectory() as folder, patch("beltcomm.jobs.doctor.find_adapters", lambda: setup.bench.found(Path(folder))):
        return CliRunner().invoke(cli, [*setup.words.split(), *more])


def shown(setup: Setup) -> str:
    """What is printed, and the exit code."""
    outcome = called(setup)
    return f"$ beltcomm {setup.words}\n{outcome.stdout}exit code {outcome.exit_code}"


def page() -> str:
    """The text of docs/doctor.md."""
    begin, marker, _ = PAGE.read_text(encoding="utf-8").partition("<!-- from here on written by tests/doctor/setups.py -->\n")
    parts = [f"\n### {setup.what[0].upper()}{setup.what[1:]}\n\n```\n{shown(setup)}\n```\n" for setup in SETUPS.values()]
    return begin + marker + "".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
