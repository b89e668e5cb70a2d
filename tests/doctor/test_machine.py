"""What of this machine is told: interfaces, ports, permissions, drivers, searches that hang; error frames in words."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import can
import pytest

from beltcomm.drive.finding import Finding
from beltcomm_adapters.buses import Address
from beltcomm_adapters.examination import surroundings as module
from beltcomm_adapters.examination.host import Host, SerialPortInfo
from beltcomm_adapters.examination.host import ports as real_ports
from beltcomm_adapters.examination.surroundings import _detected, _importable, surroundings
from beltcomm_adapters.examination.wire import _trouble_of, _worst, bit_rates, socketcan
from doctor.setups import LINK, Bench, CurrentClock, SickBus


def found(tmp_path: Path, bench: Bench | None = None, **given: Any) -> dict[str, Finding]:
    host = (bench or Bench()).host(tmp_path)
    given = {"list_ports": lambda: [], "backends": lambda: {"socketcan": ""}, "detect": lambda _names: [], **given}
    return {finding.name: finding for finding in surroundings(host, **given)}


def test_an_interface_that_is_up_says_what_to_type_next(tmp_path: Path) -> None:
    one = found(tmp_path)["can0"]
    assert (one.state, one.text, one.remedy) == ("ok", "can0 is up at 1000 kbit/s, error-active", "`beltcomm doctor --drive can0`")
    assert one.values == {"up": True, "kind": "can", "controller": "ERROR-ACTIVE", "bitrate": 1_000_000}


def test_without_the_program_ip_the_rate_is_just_not_told(tmp_path: Path) -> None:
    bench = Bench(up=False)
    host = Host(bench.host(tmp_path).sys, lambda: "")
    (one,) = host.interfaces()
    assert (one.name, one.up, one.bitrate, one.state) == ("can0", False, None, "")
    assert Host(host.sys, lambda: "no JSON").interfaces() == [one]


@pytest.mark.parametrize(
    ("asked", "state", "text"),
    [
        (None, "ok", "can0 is up at 1000 kbit/s, error-active"),
        (1_000_000, "ok", "can0 is up at 1000 kbit/s, error-active"),
        (500_000, "wrong", "can0 runs at 1000 kbit/s, --bitrate says 500 kbit/s"),
    ],
)
def test_a_bit_rate_that_is_asked_for_must_be_the_interfaces(tmp_path: Path, asked: int | None, state: str, text: str) -> None:
    (finding,) = socketcan(Bench().host(tmp_path), "can0", asked)
    assert (finding.state, finding.text) == (state, text)


def test_an_error_passive_interface_is_a_warning(tmp_path: Path) -> None:
    link = {**LINK, "linkinfo": {"info_kind": "can", "info_data": {"state": "ERROR-PASSIVE", "bittiming": {"bitrate": 500000}}}}
    (finding,) = socketcan(Bench(link=link).host(tmp_path), "can0", None)
    assert (finding.state, finding.text) == ("warning", "can0 is up at 500 kbit/s, error-passive")


def test_a_kernel_without_can(tmp_path: Path) -> None:
    host = Host(tmp_path, lambda: "", lambda: False)
    (finding,) = socketcan(host, "can0", None)
    assert finding.unreachable
    assert "modprobe can can_raw" in finding.remedy
    told = {one.name: one for one in surroundings(host, lambda: [], lambda: {"slcan": ""}, lambda _names: [])}
    assert told["socketcan"].text == "the kernel of this machine opens no CAN sockets, so there can be no can0"


def test_ports_are_named_with_what_hangs_on_them(tmp_path: Path) -> None:
    ports = [
        SerialPortInfo("/dev/ttyACM0", "CANable", (0xAD50, 0x60C4), True, "dialout"),
        SerialPortInfo("/dev/ttyUSB0", "FT232R USB UART", (0x0403, 0x6001), True, "dialout"),
        SerialPortInfo("/dev/ttyUSB1", "", (0x04D8, 0x000A), False, "root"),
    ]
    told = found(tmp_path, list_ports=lambda: ports)
    assert told["/dev/ttyACM0"].text == "/dev/ttyACM0 (CANable with slcan firmware, USB ad50:60c4) is a serial CAN adapter"
    assert told["/dev/ttyACM0"].remedy == "`beltcomm doctor --drive slcan:/dev/ttyACM0`"
    assert told["/dev/ttyUSB0"].text == "/dev/ttyUSB0 (FT232R USB UART, USB 0403:6001)"
    assert told["/dev/ttyUSB1"].text == "/dev/ttyUSB1 (USBtin, USB 04d8:000a): you may not open it"
    assert "udev" in told["/dev/ttyUSB1"].remedy  # nobody is told to join the group root


def test_makers_interfaces_and_a_search_that_does_not_end(tmp_path: Path) -> None:
    backends = {"socketcan": "", "pcan": "", "kvaser": "Kvaser canlib is unavailable."}
    told = found(tmp_path, backends=lambda: backends, detect=lambda _names: None)
    assert "can use pcan, socketcan; 1 more need" in told["python-can"].text
    assert told["python-can"].values["kvaser"] == "Kvaser canlib is unavailable."
    assert told["search"].state == "unknown"
    assert "did not end within 5 s" in told["search"].text
    there = found(tmp_path, backends=lambda: backends, detect=lambda _names: [{"interface": "pcan", "channel": "PCAN_USBBUS1"}])
    assert there["can:pcan:PCAN_USBBUS1"].remedy == "`beltcomm doctor --drive can:pcan:PCAN_USBBUS1`"


def test_a_search_that_hangs_or_fails_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    import threading

    release = threading.Event()
    monkeypatch.setattr(module, "_SEARCH_S", -0.9)
    monkeypatch.setattr(can, "detect_available_configs", lambda *_args, **_more: release.wait(10.0) and [])
    assert _detected(["pcan"]) is None
    release.set()

    def fails(*_args: object, **_more: object) -> None:
        raise OSError("driver")

    monkeypatch.setattr(can, "detect_available_configs", fails)
    assert _detected(["pcan"]) == []


def test_no_address_is_listened_on_unasked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """socketcand finds its servers by what they send to everybody on the network, which takes an open port on every address."""
    bound: list[object] = []
    monkeypatch.setattr("socket.socket.bind", lambda _, address: bound.append(address))
    found(tmp_path, backends=_importable, detect=_detected)
    assert bound == []


def test_this_very_machine_can_be_looked_at() -> None:
    reasons = _importable()
    assert reasons["virtual"] == reasons["slcan"] == ""
    assert all(port.device for port in real_ports())
    assert isinstance(Host().interfaces(), list)


@pytest.mark.parametrize(
    ("identifier", "data", "trouble"),
    [  # linux/can/error.h: class in the identifier, details in the data
        (0x020, bytes(8), "no_ack"),
        (0x001, bytes(8), "no_ack"),
        (0x040, bytes(8), "bus_off"),
        (0x004, b"\x00\x20" + bytes(6), "passive"),
        (0x004, b"\x00\x08" + bytes(6), "other"),
        (0x088, b"\x00\x00\x04" + bytes(5), "bit_errors"),
        (0x0A8, bytes(8), "no_ack"),
        (0x000, b"", "other"),
    ],
)
def test_error_frames_in_words(identifier: int, data: bytes, trouble: str) -> None:
    frame = can.Message(arbitration_id=identifier, is_error_frame=True, is_extended_id=False, data=data, dlc=len(data))
    assert _trouble_of(frame) == trouble


def test_the_worst_error_is_told() -> None:
    frames = [can.Message(arbitration_id=bits, is_error_frame=True) for bits in (0x080, 0x040, 0x020)]
    assert _worst(frames) == "bus_off"
    assert _worst([]) is None


def test_bit_rates_are_listened_for_before_anything_is_asked() -> None:
    """A bus at 250 kbit/s whose drive sends heartbeats: found without a single frame sent."""
    clock, sent = CurrentClock(), list[object]()

    def heartbeat(bus: Any) -> None:
        bus.send(can.Message(arbitration_id=0x601, data=bytes.fromhex("2b17100064000000"), is_extended_id=False))  # 1017h = 100 ms

    def opener(rate: int, _listen_only: bool) -> can.BusABC:
        clock.bus = Bench(before=heartbeat).bus("slcan") if rate == 250_000 else SickBus()
        clock.bus.on_frame = lambda frame: sent.append(frame) if frame[3].startswith("host") else None
        return clock.bus

    (finding,) = bit_rates(Address("slcan", "/dev/ttyACM0"), opener, clock)
    assert (finding.text, finding.values) == ("frames are heard at 250 kbit/s", {"found_bitrate": 250_000})
    assert sent == []


def test_bit_rates_of_socketcan_are_not_ours_to_set() -> None:
    def opener(_rate: int, _listen_only: bool) -> can.BusABC:
        raise AssertionError("nothing is opened")

    (finding,) = bit_rates(Address("socketcan", "can0"), opener, CurrentClock())
    assert finding.state == "unknown"
    assert "sudo ip link set can0 up type can bitrate RATE" in finding.remedy


def test_the_json_of_ip_as_it_is_printed(tmp_path: Path) -> None:
    """Cut from ``ip -details -json link show`` of iproute2 6.1 with a candleLight adapter."""
    net = tmp_path / "class" / "net" / "can1"
    net.mkdir(parents=True)
    (net / "type").write_text("280\n", encoding="ascii")
    (net / "flags").write_text("0x40081\n", encoding="ascii")
    entry = {
        "ifname": "can1", "flags": ["NOARP", "UP", "LOWER_UP", "ECHO"], "txqlen": 10, "link_type": "can",
        "linkinfo": {
            "info_kind": "can",
            "info_data": {
                "state": "ERROR-ACTIVE", "restart_ms": 100,
                "bittiming": {"bitrate": 500000, "sample_point": "0.875", "tq": 125}, "clock": 48000000,
            },
        },
    }  # fmt: skip
    (one,) = Host(tmp_path, lambda: json.dumps([{}, entry])).interfaces()
    assert (one.name, one.up, one.bitrate, one.state) == ("can1", True, 500_000, "ERROR-ACTIVE")
