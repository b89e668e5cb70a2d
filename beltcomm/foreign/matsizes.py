"""Check of the sizes in a MATLAB file of version 5 by its bytes: SciPy's reader would work for minutes through the cells of a damaged one.

Layout: "MAT-File Format", The MathWorks, chapter 1 (level 5): a data element is a tag (type, bytes) and its data, padded to 8 bytes.
"""

from __future__ import annotations

import math
import struct
import zlib
from typing import Final

_HEADER: Final = 128
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _OBJECT, _SPARSE = 1, 2, 3, 5
_NUMBERS: Final = (4, *range(6, 16))
_TAG: Final = 8
_DEEPEST: Final = 20
#: Bytes of one variable, unpacked, beyond which no measurement goes.
_LARGEST: Final = 1 << 31


class SizesDoNotFit(Exception):
    """A number of elements that the bytes of the file cannot hold."""


def check_sizes(content: bytes) -> None:
    """Walk through all elements of a version 5 file; others are left to the reader.   Raises SizesDoNotFit, struct.error, zlib.error."""
    if len(content) < _HEADER or content[126:128] not in (b"IM", b"MI") or 0 in content[:4]:
        return
    order = "<" if content[126:128] == b"IM" else ">"
    place = _HEADER
    while place + _TAG <= len(content):
        kind, size = struct.unpack_from(order + "II", content, place)
        data = content[place + _TAG : place + _TAG + size]
        place += _TAG + size
        if kind == _COMPRESSED:
            data = zlib.decompressobj().decompress(data, _LARGEST)
            if len(data) < _TAG:
                raise SizesDoNotFit("a compressed variable is empty")
            kind, size = struct.unpack_from(order + "II", data)
            data = data[_TAG : _TAG + size]
        if kind == _MATRIX:
            _matrix(memoryview(data), order, 0)


def _element(data: memoryview, order: str) -> tuple[int, memoryview, memoryview]:
    """Type and data of the first element, and what is behind it."""
    word = struct.unpack_from(order + "I", data)[0]
    if word >> 16:  # up to four bytes stand inside the tag
        return word & 0xFFFF, data[4 : 4 + (word >> 16)], data[_TAG:]
    size = struct.unpack_from(order + "I", data, 4)[0]
    if size > len(data) - _TAG:
        raise SizesDoNotFit(f"an element of {size} bytes stands where {len(data) - _TAG} are left")
    return word, data[_TAG : _TAG + size], data[_TAG + size + (-size) % 8 :]


def _matrix(data: memoryview, order: str, depth: int) -> None:
    """The inside of one array: flags, dimensions, name, and what its class holds."""
    if not len(data):
        return
    if depth > _DEEPEST:
        raise SizesDoNotFit("structures nest too deeply")
    _, flags, data = _element(data, order)
    kind = struct.unpack_from(order + "I", flags)[0] & 0xFF
    _, sizes, data = _element(data, order)
    dims = struct.unpack(f"{order}{len(sizes) // 4}i", sizes[: len(sizes) // 4 * 4])
    if any(size < 0 for size in dims):
        raise SizesDoNotFit(f"an array has the dimensions {dims}")
    count = math.prod(dims)
    _, _, data = _element(data, order)
    if kind in _NUMBERS:
        _, values, _ = _element(data, order)
        if count > len(values):
            raise SizesDoNotFit(f"an array of {count} numbers stands in {len(values)} bytes")
    elif kind in (_CELL, _STRUCT, _OBJECT):
        _members(data, order, kind, count, depth)
    elif kind == _SPARSE and count > _LARGEST:
        raise SizesDoNotFit(f"a sparse array has {count} elements")


def _members(data: memoryview, order: str, kind: int, count: int, depth: int) -> None:
    """The arrays inside a cell or a structure."""
    if kind == _OBJECT:
        _, _, data = _element(data, order)
    if kind != _CELL:
        _, length, data = _element(data, order)
        _, names, data = _element(data, order)
        width = struct.unpack_from(order + "i", length)[0]
        if width <= 0:
            raise SizesDoNotFit(f"names of fields have {width} letters")
        fields = len(names) // width
        if fields == 0 and count > 1:
            raise SizesDoNotFit(f"{count} structures have no field")
        count *= fields
    if count * _TAG > len(data):
        raise SizesDoNotFit(f"{count} members stand in {len(data)} bytes")
    for _ in range(count):
        _, inside, data = _element(data, order)
        _matrix(inside, order, depth + 1)
