"""The decoder of the wire: nothing is wrong with what beltcomm sends, and every rule finds the log that breaks it.

The rules are those of CiA 301 (SDO 7.2.4, PDO 7.2.2 and 7.5.2.36, life guarding 7.2.8) and CiA 402 (statusword, controlword, state
machine), and what an axis needs to be safe; the decoder shares no code with either end of the bus.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from beltcomm.drive import Limits, Motion, open_drive
from wire.broadcast import judged as broadcast_judged
from wire.decoder import Decoder, Frame, candump, lockstep
from wire.rules import Judge, Report

LIMITS = Limits(0.0, 40.0, 60.0, 0.5)
Break = Callable[[list[Frame]], list[Frame]]


def log_of(profile: str) -> list[Frame]:
    """A torque record, a motion in the position loop and gains written and put back, on the virtual bus."""
    seen: list[tuple[float, int, bytes, str]] = []
    with open_drive("virtual", {"profile": profile, "log": seen.append}) as drive:
        drive.calibrate({name: drive.capabilities.parameters[name].scale for name in drive.capabilities.uncalibrated})
        period_s, n = drive.capabilities.sample_period_s, 150
        zero = np.zeros(n)
        torque = np.where(np.arange(n) // 10 % 2, 0.1, -0.1)
        drive.record(Motion("torque", period_s, zero, zero, torque), LIMITS, lambda _row: None)
        here_rad = drive.read(["position_rad"])["position_rad"]
        drive.record(Motion("position", period_s, np.full(n, here_rad), zero, zero), LIMITS, lambda _row: None)
        before = drive.backup()
        drive.write({"kpp_1_s": 2 * before["kpp_1_s"]})
        drive.write(before)
    return list(lockstep(seen))


@pytest.fixture(scope="module")
def good() -> list[Frame]:
    return log_of("reference")


@pytest.fixture(scope="module")
def guarded() -> list[Frame]:
    return log_of("cmmp-as")


def judged(frames: list[Frame], **options: object) -> Report:
    return Judge(**options).of(frames)  # type: ignore[arg-type]


@pytest.mark.parametrize("profile", ["good", "guarded"])
@pytest.mark.parametrize("by_sync", [False, True])
def test_nothing_is_wrong_with_our_own(profile, by_sync, request):
    report = judged(request.getfixturevalue(profile), by_sync=by_sync)
    assert report.findings == []
    enabling = ["switch on disabled", "ready", "switched on", "enabled", "quick stop"]
    proof = [*enabling[:4], "fault reaction", "fault"]  # of guarding, at standstill, before the first torque
    assert report.states == proof + enabling + enabling + ["switch on disabled"]
    assert report.counts["proof of guarding"] == 1
    assert report.counts["sync"] > 300
    assert report.counts["sent"] == 2 * report.counts["sync"]
    assert report.counts["received"] >= report.counts["sync"]
    assert 0.014 < report.longest_silence_s <= 0.02  # signs of life every 15 ms


def test_pdo_values_are_those_of_the_mapping(good):
    decoder = Decoder()
    sent = [dict(event.values) for event in decoder.events(good) if event.what == "sent"]
    torques = [dict(e.values)[0x6071, 0] for e in Decoder().events(good) if e.what == "received" and (0x6071, 0) in dict(e.values)]
    assert {key for values in sent for key in values} == {(0x6064, 0), (0x6077, 0), (0x6041, 0), (0x606C, 0), (0x6074, 0)}
    assert set(torques) == {0, 70, -70}  # 0.1 N m in thousandths of 1.43 N m
    assert decoder.number(0x6076, 0) == 1430


def test_candump_is_read_and_a_cut_line_only_at_the_end():
    text = ["(1.5) can0 601#4000100000000000\n", "(1.6) can0 701#R1\n", "(1.7) can0 080#\n"]
    assert list(candump([*text, "(1.8) ca"])) == [
        Frame(1.5, 0x601, bytes.fromhex("4000100000000000")),
        Frame(1.6, 0x701, remote=True),
        Frame(1.7, 0x80),
    ]
    with pytest.raises(ValueError, match="no line of candump"):
        list(candump(["(1.8) ca", *text]))


# -- one log per rule ---------------------------------------------------------------------------------------------------


def at(frames: list[Frame], identifier: int, wanted: Callable[[bytes], bool] = lambda _data: True, skip: int = 0) -> int:
    """Place of a frame."""
    return [i for i, frame in enumerate(frames) if frame.identifier == identifier and wanted(frame.data)][skip]


def drop(frames: list[Frame], *places: int) -> list[Frame]:
    return [frame for i, frame in enumerate(frames) if i not in places]


def put(frames: list[Frame], place: int, *new: tuple[int, bytes]) -> list[Frame]:
    """New frames before a place."""
    return [*frames[:place], *(Frame(frames[place].stamp_s, i, data) for i, data in new), *frames[place:]]


def altered(frames: list[Frame], place: int, data: bytes) -> list[Frame]:
    return [*frames[:place], replace(frames[place], data=data), *frames[place + 1 :]]


def write(index: int, part: int, value: int, size: int) -> tuple[tuple[int, bytes], tuple[int, bytes]]:
    """An expedited download and its confirmation."""
    request = struct.pack("<BHB", 0x23 | (4 - size) << 2, index, part) + value.to_bytes(4, "little")
    return (0x601, request), (0x581, struct.pack("<BHB4x", 0x60, index, part))


def first_torque(frames: list[Frame]) -> int:
    return at(frames, 0x201, lambda data: data[:2] == b"\x0f\x00" and data[2:] != b"\0\0")


def shutdown_asked(frames: list[Frame]) -> int:
    return at(frames, 0x201, lambda data: data[:2] == b"\x06\x00")


def heartbeat_set(frames: list[Frame]) -> int:
    return at(frames, 0x601, lambda data: data[:4] == struct.pack("<BHB", 0x23, 0x1016, 1) and any(data[4:]))


BROKEN: dict[str, tuple[str, Break]] = {
    "an answer is lost": ("sdo", lambda f: drop(f, at(f, 0x581, skip=5))),
    "the last answer is lost": ("sdo", lambda f: drop(f, at(f, 0x581, skip=-1))),
    "an answer too many": ("sdo", lambda f: put(f, at(f, 0x80), (0x581, b"\x60\x60\x60" + bytes(5)))),
    "an answer about another object": ("sdo", lambda f: altered(f, at(f, 0x581), b"\x43\x01\x10\x00\x92\x01\x02\x00")),
    "an upload confirmed as a download": ("sdo", lambda f: altered(f, at(f, 0x581), b"\x60\x00\x10\x00" + bytes(4))),
    "a segment with the old toggle bit": ("sdo", lambda f: (lambda i: altered(f, i, bytes((f[i].data[0] ^ 0x10,)) + f[i].data[1:]))(
        at(f, 0x581, lambda data: data[0] >> 5 == 0, 1))),
    "a mapping changed while it is valid": ("pdo valid", lambda f: put(f, at(f, 0), *write(0x1A00, 0, 0, 1))),
    "a transmission type changed while it is valid": ("pdo valid", lambda f: put(f, at(f, 0), *write(0x1800, 2, 3, 1))),
    "an entry written before the count is 0": ("pdo mapping", lambda f: put(
        f, at(f, 0), *write(0x1800, 1, 0x80000181, 4), *write(0x1A00, 1, 0x60640020, 4))),
    "made valid with nothing in it": ("pdo mapping", lambda f: put(
        f, at(f, 0), *write(0x1800, 1, 0x80000181, 4), *write(0x1A00, 0, 0, 1), *write(0x1800, 1, 0x181, 4))),
    "a PDO of another length than mapped": ("pdo mapping", lambda f: altered(f, at(f, 0x181), b"\0" * 7)),
    "PDOs without the node being started": ("pdo state", lambda f: drop(f, at(f, 0))),
    "a SYNC that nobody answers": ("tpdo", lambda f: drop(f, at(f, 0x281, skip=40))),
    "an answer to no SYNC": ("tpdo", lambda f: put(f, at(f, 0x80, skip=40), (0x181, f[at(f, 0x181)].data))),
    "enable before switch on": ("controlword", lambda f: altered(f, shutdown_asked(f), b"\x0f\x00\x00\x00")),
    "the next command before the state is shown": ("controlword", lambda f: altered(f, shutdown_asked(f), b"\x07\x00\x00\x00")),
    "a state that nobody asked for": ("statusword", lambda f: (lambda i: altered(f, i, f[i].data[:6] + b"\x37\x92"))(at(f, 0x181, skip=1))),
    "a torque before the stage is on": ("setpoint", lambda f: altered(f, at(f, 0x201, lambda d: d[:2] == b"\x0f\0"), b"\x0f\0\x46\0")),
    "a target far off where the axis stands": ("setpoint", lambda f: (lambda i: altered(f, i, b"\x0f\0" + bytes(4)))(
        at(f, 0x201, lambda data: len(data) == 6 and data[:2] == b"\x0f\0"))),
    "no signs of life": ("guarding", lambda f: [frame for frame in f if frame.identifier != 0x77F]),
    "four signs of life lost": ("guarding", lambda f: drop(f, *(at(f, 0x77F, skip=i) for i in range(4, 8)))),
    "the drive was not told to watch": ("guarding", lambda f: drop(f, heartbeat_set(f), heartbeat_set(f) + 1)),
    "ends while the axis moves": ("off at the end", lambda f: f[: first_torque(f) + 40]),
    "a mode of operation is left behind": ("restored", lambda f: put(f, len(f) - 1, *write(0x6060, 0, 8, 1))),
    "gains are left behind": ("restored", lambda f: [*f, *(Frame(9.0, *one) for one in write(0x2100, 1, 0x3F800000, 4))]),
    "written without having been read": ("restored", lambda f: [*f, *(Frame(9.0, *one) for one in write(0x6083, 0, 1, 4))]),
    "an emergency": ("emergency", lambda f: put(f, first_torque(f), (0x81, b"\x11\x86\x21" + bytes(5)))),
    "a stranger": ("frame", lambda f: put(f, 10, (0x3A5, b"\0"))),
    "a network command of one byte": ("frame", lambda f: put(f, 10, (0, b"\x01"))),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_every_rule_finds_the_log_that_breaks_it(name, good):
    rule, break_it = BROKEN[name]
    assert rule in judged(break_it(good)).rules


def test_guarding_that_does_not_alternate_and_a_node_in_another_state(guarded):
    place = at(guarded, 0x701, lambda data: len(data) == 1 and data[0] & 0x7F == 5, 3)
    same = bytes((guarded[place].data[0] ^ 0x80,))
    assert judged(altered(guarded, place, same)).rules == {"toggle"}
    stopped = bytes((guarded[place].data[0] & 0x80 | 4,))
    assert judged(altered(guarded, place, stopped)).rules == {"nmt state"}


def test_requests_for_guarding_that_stop_are_found(guarded):
    remote = [i for i, frame in enumerate(guarded) if frame.remote]
    assert len(remote) > 10
    assert "guarding" in judged(drop(guarded, *remote[3:7])).rules


def test_a_holding_torque_is_no_torque_before_the_stage(good):
    name, break_it = BROKEN["a torque before the stage is on"]
    assert judged(break_it(good), holding=[70]).rules == set(), name


def test_the_broadcast_managers_cycles_are_counted():
    on_time = [0.01 * k for k in range(1001)]
    lines, right = broadcast_judged(on_time)
    assert right
    assert "1001 SYNCs in 10.000 s" in lines[0]
    assert "0 cycles lost in gaps, 0 by a timer" in lines[0]
    lines, right = broadcast_judged(drop(on_time, 5, 6, 40))  # type: ignore[type-var]
    assert right
    assert "3 cycles lost" in lines[0]
    assert not broadcast_judged(sorted(on_time * 2))[1]  # each twice
    assert not broadcast_judged([0.02 * k for k in range(500)])[1]  # another period
    assert not broadcast_judged([0.0])[1]
