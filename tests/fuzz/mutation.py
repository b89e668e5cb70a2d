"""Seeded damage to bytes."""

from __future__ import annotations

import numpy as np

#: What parsers stumble over: ends of ranges, separators, quotes, structure, half a character.
TOKENS = (
    *(b"nan", b"inf", b"-inf", b"1e400", b"-0", b"0x", b"9" * 40, b"1,5", b";", b",", b"\t", b'"', b"'", b"\x00", b"\xff\xfe", b"\xc3"),
    *(b"\n\n", b"\r", b": ", b"- ", b"[", b"]", b"{", b"}", b"&a ", b"*a", b"<<: ", b"!!python/object:os.system ", b"%", b"#", b"~"),
    *(b"true", b"null", b"[]", b"{}", b"[[[[[[[[", b"2020-01-01", b".inf", b".nan", b"1_000", b"\xe2\x80\xa8", b" " * 30, b"-1", b"0"),
)


def mutated(draw: np.random.Generator, data: bytes) -> bytes:
    """The bytes with one to four damages: a flipped, cut, doubled, exchanged or inserted piece."""
    found = bytearray(data)
    for _ in range(int(draw.integers(1, 5))):
        at = int(draw.integers(len(found) + 1))
        until = min(len(found), at + int(draw.integers(1, 24)))
        what = int(draw.integers(7))
        if what == 0 and at < len(found):
            found[at] ^= 1 << int(draw.integers(8))
        elif what == 1:
            del found[at:until]
        elif what == 2:
            found[at:at] = found[at:until]
        elif what == 3:
            found[at:until] = TOKENS[int(draw.integers(len(TOKENS)))]
        elif what == 4:
            found[at:at] = TOKENS[int(draw.integers(len(TOKENS)))]
        elif what == 5:
            del found[at:]
        else:  # a value: from a colon or comma to the end of the cell
            end = next((n for n in range(at, len(found)) if found[n] in b",\n}"), len(found))
            begin = next((n for n in range(end - 1, -1, -1) if found[n] in b":,\n{"), -1) + 1
            found[begin:end] = b" " + TOKENS[int(draw.integers(len(TOKENS)))]
    return bytes(found)


def mutated_frame(draw: np.random.Generator, data: bytes) -> bytes:
    """The data of a CAN frame with one damage; never longer than eight bytes."""
    what = int(draw.integers(5))
    if what == 0 and data:
        changed = bytearray(data)
        changed[int(draw.integers(len(data)))] ^= 1 << int(draw.integers(8))
        return bytes(changed)
    if what == 1:
        return data[: int(draw.integers(len(data) + 1))]
    if what == 2:
        return (data + draw.bytes(8))[: int(draw.integers(9))]
    if what == 3 and data:
        return draw.bytes(1) + data[1:]
    return draw.bytes(len(data))
