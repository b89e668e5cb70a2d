"""What CiA 301 and CiA 402 ask of a servo drive, asked with random values: each check returns what deviates, in words.

A drive may lack what is optional: then there is nothing to check.  ``draw`` gives every choice.
"""

from __future__ import annotations

import struct
from functools import partial

import numpy as np

from independent.asking import Check, Draw, refusal_of, wrong_code
from independent.checks402 import factors, machine, modes
from independent.master import Master, Refusal, Silence

PRE_OPERATIONAL, OPERATIONAL, STOPPED = 0x7F, 0x05, 0x04
START, STOP, PREPARE, RESET_NODE, RESET_COMMUNICATION = 0x01, 0x02, 0x80, 0x81, 0x82
_AFTER = {START: OPERATIONAL, STOP: STOPPED, PREPARE: PRE_OPERATIONAL}
#: Objects that every node has, and how many bytes.
MANDATORY = ((0x1000, 0, 4), (0x1001, 0, 1), (0x1018, 0, 1), (0x1018, 1, 4))
#: Of a servo drive, readable at any time: index, bytes.  What is missing is the drive's business.
READABLE = ((0x6041, 2), (0x6061, 1), (0x6064, 4), (0x606C, 4), (0x6077, 2), (0x6062, 4), (0x60F4, 4), (0x603F, 2), (0x6078, 2))


def to_state(master: Master, specifier: int) -> None:
    master.command(specifier)
    master.wait(0.01)


def boot_up(master: Master, draw: Draw) -> list[str]:
    """A reset ends in the boot-up message and Pre-operational."""
    wrong = []
    specifier = int(draw.choice([RESET_NODE, RESET_COMMUNICATION]))
    master.wait(0.01)
    master.command(specifier, int(draw.choice([0, master.node])))
    frames = [(i, data) for _, i, data in master.wait(0.5)]
    if (0x700 + master.node, b"\x00") not in frames:
        wrong.append("no boot-up message")
    if frames and frames[0] != (0x700 + master.node, b"\x00"):
        wrong.append(f"a frame {frames[0][0]:03X}h before the boot-up message")
    if master.guard() & 0x7F != PRE_OPERATIONAL:
        wrong.append("not pre-operational after the boot-up")
    return wrong


def states(master: Master, draw: Draw) -> list[str]:
    """A random walk of NMT commands: the state follows, the toggle bit alternates, SDO is served but in Stopped."""
    wrong: list[str] = []
    state, toggle = master.guard() & 0x7F, None
    for _ in range(12):
        specifier = int(draw.choice([START, STOP, PREPARE, 0x03, 0x7E]))
        other = int(draw.integers(2, 127))
        node = int(draw.choice([0, master.node, other]))
        master.command(specifier, node)
        if node != other:
            state = _AFTER.get(specifier, state)
        told = master.guard()
        if told & 0x7F != state:
            wrong.append(f"after NMT {specifier:02X}h to node {node} it is {told & 0x7F:02X}h, not {state:02X}h")
            state = told & 0x7F
        if toggle is not None and told & 0x80 == toggle:
            wrong.append("the toggle bit stays")
        toggle = told & 0x80
        try:
            master.upload(0x1000)
            served = True
        except Silence:
            served = False
        if served != (state != STOPPED):
            wrong.append(f"SDO is {'served' if served else 'not served'} in {state:02X}h")
    to_state(master, PREPARE)
    return wrong


def addresses(master: Master, draw: Draw) -> list[str]:
    """What is not there is refused with its own code, and the abort names what was asked for."""
    wrong: list[str] = []
    for index, subindex, length in MANDATORY:
        found = master.upload(index, subindex)
        if len(found) != length:
            wrong.append(f"{index:04X}h:{subindex} has {len(found)} bytes")
    index, subindex = int(draw.integers(0x5000, 0x5FFF)), int(draw.integers(0, 256))
    wrong += wrong_code("an index that is not there", lambda: master.upload(index, subindex), 0x06020000, at=(index, subindex))
    subindex = int(draw.integers(5, 255))
    wrong += wrong_code("a subindex that is not there", lambda: master.upload(0x1018, subindex), 0x06090011, at=(0x1018, subindex))
    wrong += wrong_code("a write to 1018h:1", lambda: master.write(0x1018, 1, 5, 4), 0x06010002, at=(0x1018, 1))
    wrong += wrong_code("a write to 6041h", lambda: master.write(0x6041, 0, 0, 2), 0x06010002, at=(0x6041, 0))
    wrong += wrong_code("four bytes to 6040h", lambda: master.write(0x6040, 0, 0, 4), 0x06070010, 0x06070012, at=(0x6040, 0))
    wrong += wrong_code("one byte to 6040h", lambda: master.write(0x6040, 0, 0, 1), 0x06070010, 0x06070013, at=(0x6040, 0))
    return wrong


def commands(master: Master, draw: Draw) -> list[str]:
    """Odd requests: unknown commands, segments of no transfer, wrong toggle bits, aborts of the client."""
    wrong: list[str] = []
    index, subindex = int(draw.integers(0x1000, 0x7000)), int(draw.integers(0, 255))
    unknown = struct.pack("<BHB4x", 0xE0, index, subindex)
    wrong += wrong_code("an unknown command", lambda: master.request(unknown), 0x05040001, at=(index, subindex))
    segment = bytes((int(draw.choice([0x60, 0x70, 0x00, 0x10])), *(0,) * 7))
    wrong += wrong_code("a segment of no transfer", lambda: master.request(segment), 0x05040001)
    begun = master.request(struct.pack("<BHB4x", 0x40, 0x1008, 0))
    if not begun[0] & 2:
        wrong += wrong_code("a wrong toggle bit", lambda: master.request(bytes((0x70, *(0,) * 7))), 0x05030000, at=(0x1008, 0))
        master.request(struct.pack("<BHB4x", 0x40, 0x1008, 0))
        master.abort(0x1008, 0)
        if [frame for frame in master.wait(0.05) if frame[1] == 0x580 + master.node]:
            wrong.append("an abort of the client is answered")
        wrong += wrong_code("a segment after an abort", lambda: master.request(bytes((0x60, *(0,) * 7))), 0x05040001)
    master.put(0x600 + master.node, bytes(int(draw.integers(0, 8))))
    if [frame for frame in master.wait(0.4) if frame[1] == 0x580 + master.node and frame[2][0] != 0x80]:
        wrong.append("a request of less than eight bytes is served")
    try:
        master.upload(0x1000)
    except (Refusal, Silence) as error:
        wrong.append(f"after odd requests 1000h is not read: {error!r}")
    return wrong


def transfers(master: Master, draw: Draw) -> list[str]:
    """Segmented and block transfers give and take what expedited ones do."""
    wrong: list[str] = []
    text = master.upload(0x1008)
    block = int(draw.integers(1, 128))
    lose = int(draw.integers(0, 3))
    try:
        if master.block_upload(0x1008, 0, block, lose if lose <= -(-len(text) // 7) else 0) != text:
            wrong.append("a block upload of 1008h gives something else")
    except Refusal as refusal:
        wrong.append(f"block upload: {refusal.code:08X}h")
    except (AssertionError, Silence) as error:
        wrong.append(f"block upload in blocks of {block}: {error!r}")
    here = next((index for index in (0x6081, 0x607A, 0x6067) if master.has(index)), None)
    if here is None:
        return wrong
    before = master.upload(here)
    for way in ("expedited", "segmented", "block"):
        value = int(draw.integers(1, 20000)).to_bytes(4, "little")
        try:
            if way == "block":
                master.block_download(here, 0, value)
            else:
                master.download(here, 0, value, segmented=way == "segmented")
            if master.upload(here) != value:
                wrong.append(f"{here:04X}h written {way} reads back otherwise")
        except (Refusal, Silence, AssertionError) as error:
            wrong.append(f"{here:04X}h written {way}: {error!r}")
    master.download(here, 0, before)
    return wrong


def mappings(master: Master, draw: Draw) -> list[str]:
    """A transmit PDO mapped at random carries what SDO reads, once for every n-th SYNC."""
    wrong: list[str] = []
    communication, mapping = 0x1800, 0x1A00
    to_state(master, PREPARE)
    cob_id = master.read(communication, 1)
    if refusal_of(lambda: master.write(communication, 1, cob_id | 1 << 31, 4)):
        return wrong  # the maker has fixed it
    master.read(communication, 1) & 1 << 31 or wrong.append("bit 31 of the COB-ID does not stay")
    old = [master.read(mapping, sub) for sub in range(1, master.read(mapping, 0) + 1)]
    chosen: list[tuple[int, int]] = []
    room = 8
    for place in draw.permutation(len(READABLE)):
        index, length = READABLE[int(place)]
        if length <= room and len(chosen) < int(draw.integers(1, 5)) and master.has(index):
            chosen.append((index, length))
            room -= length
    wrong += wrong_code(
        "an entry while their number is not 0", lambda: master.write(mapping, 1, 0x60410010, 4), 0x06010000, 0x08000022, 0x06010002
    )
    master.write(mapping, 0, 0, 1)
    mapped = []
    for index, length in chosen:
        entry = index << 16 | 8 * length
        if refusal := refusal_of(partial(master.write, mapping, len(mapped) + 1, entry, 4)):
            if refusal.code not in (0x06040041, 0x06090011, 0x06020000):
                wrong.append(f"mapping {index:04X}h is refused with {refusal.code:08X}h")
        else:
            mapped.append((index, length))
    master.write(mapping, 0, len(mapped), 1)
    every = int(draw.integers(1, 4))
    if refusal_of(lambda: master.write(communication, 2, every, 1)):
        every = 1
        master.write(communication, 2, 1, 1)
    identifier = int(draw.choice([0x181, 0x1F0, 0x29A, 0x3AB]))
    master.write(communication, 1, identifier | cob_id & 1 << 30, 4)
    wrong += wrong_code("a mapping of a valid PDO", lambda: master.write(mapping, 0, 0, 1), 0x06010000, 0x08000022, 0x06010002)
    master.put(0x080)
    if [frame for frame in master.wait(0.01) if frame[1] == identifier]:
        wrong.append("a PDO before the node is operational")
    to_state(master, START)
    expected = [(index, master.upload(index)) for index, _ in mapped]
    for number in range(1, 7):
        master.put(0x080)
        frames = [data for _, i, data in master.wait(0.005) if i == identifier]
        if len(frames) != (number % every == 0):
            wrong.append(f"type {every}: {len(frames)} PDOs with SYNC {number}")
        for data in frames:
            if len(data) != sum(len(value) for _, value in expected):
                wrong.append(f"a PDO of {len(data)} bytes")
            at = 0
            for index, value in expected:
                if data[at : at + len(value)] != value and index in (0x6041, 0x6061, 0x603F):
                    wrong.append(f"{index:04X}h in a PDO is {data[at : at + len(value)].hex()}, by SDO {value.hex()}")
                at += len(value)
    to_state(master, PREPARE)
    master.write(communication, 1, identifier | 1 << 31, 4)
    master.write(mapping, 0, 0, 1)
    for number, entry in enumerate(old):
        master.write(mapping, number + 1, entry, 4)
    master.write(mapping, 0, len(old), 1)
    master.write(communication, 1, cob_id, 4)
    return wrong


def received(master: Master, draw: Draw) -> list[str]:
    """A receive PDO: at once or with the next SYNC; too short a frame is an emergency and does nothing."""
    wrong: list[str] = []
    communication, mapping = 0x1400, 0x1600
    target = next((index for index in (0x607A, 0x60FF) if master.has(index)), None)
    to_state(master, PREPARE)
    cob_id = master.read(communication, 1)
    if target is None or refusal_of(lambda: master.write(communication, 1, cob_id | 1 << 31, 4)):
        return wrong
    old = [master.read(mapping, sub) for sub in range(1, master.read(mapping, 0) + 1)]
    kind = master.read(communication, 2)
    master.write(mapping, 0, 0, 1)
    if refusal_of(lambda: master.write(mapping, 1, target << 16 | 32, 4)):
        return wrong
    master.write(mapping, 0, 1, 1)
    synchronous = bool(draw.integers(0, 2))
    master.write(communication, 2, 1 if synchronous else 255, 1)
    identifier = 0x200 + master.node
    master.write(communication, 1, identifier, 4)
    to_state(master, START)
    before, value = master.upload(target), int(draw.integers(1, 9999)).to_bytes(4, "little")
    master.wait(0.01)
    master.put(identifier, value)
    if synchronous and master.upload(target) != before:
        wrong.append("a synchronous receive PDO acts before the SYNC")
    master.put(0x080)
    if master.upload(target) != value:
        wrong.append("a receive PDO does not act")
    master.wait(0.01)
    master.put(identifier, bytes(int(draw.integers(0, 4))))
    frames = [data for _, i, data in master.wait(0.02) if i == 0x080 + master.node]
    if not any(data[:2] == b"\x10\x82" for data in frames):
        wrong.append("no emergency 8210h for a PDO that is too short")
    master.put(0x080)
    if master.upload(target) != value:
        wrong.append("a PDO that is too short acts")
    to_state(master, PREPARE)
    master.write(communication, 1, identifier | 1 << 31, 4)
    master.write(mapping, 0, 0, 1)
    for number, entry in enumerate(old):
        master.write(mapping, number + 1, entry, 4)
    master.write(mapping, 0, len(old), 1)
    master.write(communication, 2, kind, 1)
    master.write(communication, 1, cob_id, 4)
    master.write(target, 0, int.from_bytes(before, "little"), 4)
    return wrong


def heartbeats(master: Master, draw: Draw) -> list[str]:
    """Its own comes in time with its state; another's that ends is an emergency, and 1029h says what then."""
    wrong: list[str] = []
    if not refusal_of(lambda: master.upload(0x1017)):
        period = int(draw.integers(5, 60))
        master.write(0x1017, 0, period, 2)
        state = int(draw.choice([START, PREPARE]))
        to_state(master, state)
        beats = [(t, data) for t, i, data in master.wait(0.5) if i == 0x700 + master.node]
        gaps = np.diff([t for t, _ in beats])
        if len(gaps) < 3 or abs(gaps - 1e-3 * period).max() > 2e-3:
            wrong.append(f"heartbeats of {period} ms come every {1e3 * gaps.max() if len(gaps) else 0:.0f} ms")
        if any(data != bytes((_AFTER[state],)) for _, data in beats[1:]):
            wrong.append("a heartbeat tells another state")
        master.write(0x1017, 0, 0, 2)
    if refusal_of(lambda: master.write(0x1016, 1, 0x640000 | 30, 4)):
        return wrong
    behaviour = master.read(0x1029, 1) if master.has(0x1029, 1) else 0
    to_state(master, START)
    master.put(0x764, b"\x05")
    master.wait(0.02)
    master.put(0x764, b"\x05")
    frames = master.wait(0.02)
    if any(i == 0x080 + master.node for _, i, _ in frames):
        wrong.append("an emergency although the heartbeat came in time")
    frames = master.wait(0.05)
    if not any(i == 0x080 + master.node and data[:2] == b"\x30\x81" for _, i, data in frames):
        wrong.append("no emergency 8130h for a heartbeat that ended")
    expected = {0: PRE_OPERATIONAL, 1: OPERATIONAL, 2: STOPPED}.get(behaviour, OPERATIONAL)
    told = master.guard() & 0x7F
    if told != expected:
        wrong.append(f"1029h:1 is {behaviour}{'' if master.has(0x1029, 1) else ' (not there)'}, after the loss it is {told:02X}h")
    to_state(master, PREPARE)
    master.write(0x1016, 1, 0, 4)
    return wrong


def errors(master: Master, draw: Draw) -> list[str]:
    """1003h counts, is cleared by 0 and by nothing else."""
    if not master.has(0x1003):
        return []
    wrong = []
    if master.read(0x1003, 0):
        before = master.read(0x1003, 1)
        if not before:
            wrong.append("1003h counts an error that is not there")
    wrong += wrong_code("a number in 1003h:0", lambda: master.write(0x1003, 0, int(draw.integers(1, 255)), 1), 0x06090030)
    master.write(0x1003, 0, 0, 1)
    if master.read(0x1003, 0):
        wrong.append("1003h is not cleared")
    return wrong


def signatures(master: Master, draw: Draw) -> list[str]:
    """1010h and 1011h want their words."""
    wrong = []
    for index in (0x1010, 0x1011):
        if master.has(index, 1):
            number = int(draw.integers(1, 2**31))
            wrong += wrong_code(
                f"a wrong signature in {index:04X}h", lambda i=index, n=number: master.write(i, 1, n, 4), 0x08000020, 0x08000021
            )
    return wrong


CHECKS: dict[str, Check] = {
    check.__name__: check
    for check in (
        boot_up,
        states,
        addresses,
        commands,
        transfers,
        mappings,
        received,
        heartbeats,
        errors,
        signatures,
        machine,
        modes,
        factors,
    )
}
