"""MATLAB files as nested mappings: version 5 to 7 by SciPy, version 7.3 and plain HDF5 by h5py (imported when such a file comes).

Objects (tables, timetables, timeseries, Simulink's) are read by mat-io, as nested mappings.

Layout: "MAT-File Format", The MathWorks, chapter 1 (level 5): a data element is a tag (type, bytes) and its data, padded to 8 bytes.

The sizes in a file of version 5 are checked by its bytes: SciPy's reader would work for minutes through the cells of a damaged one.
"""

from __future__ import annotations

import importlib.util
import math
import struct
import warnings
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltcomm.errors import DataError
from beltcomm.foreign.table import words_of
from beltcomm.outside import check_count, opened

#: Stands among the variables for objects that were not opened; and what a file of version 7.3 keeps them in.
OBJECTS_LEFT = "objects of MATLAB (pip install 'beltcomm[matlab]' reads them; or save a structure of vectors)"
_OBJECTS = "#subsystem#"
_HDF5 = b"\x89HDF\r\n\x1a\n"
#: Structures nest no deeper in any measurement; a file that refers to itself would go on for ever.
_DEEPEST = 12
#: More members than this no measurement has; a damaged file can claim any number.
_MOST_MEMBERS = 100_000


def read_matlab(path: Path) -> dict[str, Any]:
    """Variables by name, structures as mappings, cells and structure arrays as lists, char as text.

    Parameters
    ----------
    path : Path

    Raises
    ------
    DataError
        For a file that is damaged or none.
    """
    from scipy.io import loadmat

    try:
        with opened(path) as file:
            if _is_hdf5(file.read(4096)):
                return _with_objects(path, read_hdf5(path))
            file.seek(0)
            _check_sizes(file.read())
            file.seek(0)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of objects, which come next
                return _with_objects(path, dict(loadmat(path, simplify_cells=True)))
    except (DataError, MemoryError):
        raise
    except NotImplementedError:  # what SciPy says of version 7.3
        return read_hdf5(path)
    except Exception as error:  # on damaged bytes these readers raise whatever they stumble over
        raise DataError(f"{path} cannot be read as a MATLAB file ({words_of(error)}); is it cut off?") from error


def _with_objects(path: Path, found: dict[str, Any]) -> dict[str, Any]:
    """The variables with the objects among them opened, where mat-io is there to do it; else objects stay what nobody reads."""
    if not any(name in found for name in (_OBJECTS, "None", "__function_workspace__")):
        return found
    found.pop("None", None)
    there = found.pop(_OBJECTS, True)
    if there and importlib.util.find_spec("matio") is not None:
        return {**found, **_read_objects(path)}
    return {**found, OBJECTS_LEFT: "objects"}


def _is_hdf5(head: bytes) -> bool:
    return any(head[place : place + 8] == _HDF5 for place in (0, 512, 1024, 2048))


def read_hdf5(path: Path) -> dict[str, Any]:
    """All columns of an HDF5 file, of MATLAB 7.3 or of another program.

    Parameters
    ----------
    path : Path

    Raises
    ------
    DataError
        For a file that is damaged or none.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:
            found = _Reader(file, str(path)).group(file, 0)
            return found | ({_OBJECTS: True} if _OBJECTS in file else {})
    except (DataError, MemoryError):
        raise
    except Exception as error:  # as above
        raise DataError(f"{path} cannot be read as a MATLAB 7.3 or HDF5 file ({words_of(error)}); is it cut off?") from error


class _Reader:
    """Walks through an open HDF5 file: https://www.mathworks.com/help/matlab/import_export/mat-file-versions.html says no more
    than that version 7.3 is HDF5; attributes and layout are as MATLAB writes them."""

    def __init__(self, file: Any, name: str) -> None:
        self._file, self._name = file, name
        self._members, self._values = 0, 0

    def _member(self, group: Any, key: str) -> Any:
        """A member of a group; None where nothing is behind a link.   Raises DataError for a link into another file, and for too many."""
        import h5py

        self._members += 1
        if self._members > _MOST_MEMBERS:
            raise DataError(f"{self._name} has more than {_MOST_MEMBERS} members, which no measurement has; export the signals as CSV")
        link = group.get(key, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            raise DataError(f"{self._name}: {key} is a link into another file, {link.filename}; save this file with the data in it")
        return group.get(key)

    def _content(self, item: Any) -> Any:
        """Content of a data set.   Raises DataError for one that lies in other files, and for more than any measurement."""
        if item.is_virtual or item.external:
            raise DataError(f"{self._name}: the data of {item.name} lie in another file; save this file with the data in it")
        self._values += int(item.size or 0)
        check_count(self._name, self._values, 1)
        return item[()]

    def group(self, group: Any, depth: int) -> dict[str, Any]:
        """The members of a group; those of a structure array become a list of structures."""
        import h5py

        found: dict[str, Any] = {}
        for key in group:
            if key.startswith("#") or depth > _DEEPEST:
                continue
            item = self._member(group, key)
            if isinstance(item, h5py.Group):
                found[key] = self._structure(item, depth + 1)
            elif isinstance(item, h5py.Dataset):
                found[key] = self.dataset(item, depth + 1)
                unit = _attribute(item, "unit", "units", "Unit", "Units")
                if unit:
                    found.setdefault(f"{key}_unit", unit)
        return found

    def _structure(self, group: Any, depth: int) -> Any:
        members = [self._member(group, key) for key in group]
        arrays = [member for member in members if _is_reference(member) and "MATLAB_class" not in member.attrs]
        if not arrays or len(arrays) != len(members) or len({member.size for member in members}) != 1:
            return self.group(group, depth)
        columns = {
            key: [self._referred(ref, depth) for ref in np.ravel(self._content(member).T)]
            for key, member in zip(group, members, strict=True)
        }
        return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]

    def dataset(self, item: Any, depth: int) -> Any:
        """An array in MATLAB's orientation, text of a char array, the elements of a cell."""
        kind = _attribute(item, "MATLAB_class")
        if "MATLAB_empty" in item.attrs and int(item.attrs["MATLAB_empty"]):
            return "" if kind == "char" else np.zeros(0)
        if item.shape is None:
            return np.zeros(0)
        if _is_reference(item):
            return [self._referred(ref, depth) for ref in np.ravel(self._content(item).T)]
        values = self._content(item)
        if kind == "char":
            return "".join(chr(code) for code in np.ravel(np.asarray(values).T))
        if isinstance(values, bytes):
            return values.decode("utf-8", "replace")
        return values.T if isinstance(values, np.ndarray) else np.asarray(values)

    def _referred(self, reference: Any, depth: int) -> Any:
        import h5py

        self._members += 1
        if not reference or depth > _DEEPEST or self._members > _MOST_MEMBERS:  # a file that refers to itself
            return None
        item = self._file[reference]
        return self._structure(item, depth + 1) if isinstance(item, h5py.Group) else self.dataset(item, depth + 1)


def _is_reference(item: Any) -> bool:
    import h5py

    return isinstance(item, h5py.Dataset) and h5py.check_ref_dtype(item.dtype) is h5py.Reference


def _attribute(item: Any, *names: str) -> str:
    """Text of the first of these attributes that there is."""
    for name in names:
        if name in item.attrs:
            value = item.attrs[name]
            value = value.ravel()[0] if isinstance(value, np.ndarray) and value.size else value
            return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
    return ""


def _read_objects(path: Path) -> dict[str, Any]:
    """All variables by name, objects as mappings of what they hold.   Raises whatever the reader raises."""
    from matio import load_from_mat

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = load_from_mat(str(path), add_table_attrs=True)
        return {name: _plain(value, 0) for name, value in found.items() if not name.startswith("__")}


def _plain(value: Any, depth: int) -> Any:
    if depth > _DEEPEST:
        return None
    if hasattr(value, "properties") and isinstance(value.properties, Mapping):
        return {name.rstrip("_"): _plain(item, depth + 1) for name, item in value.properties.items()}
    if hasattr(value, "columns") and hasattr(value, "index"):
        return _of_frame(value)
    if isinstance(value, Mapping):
        return {str(name): _plain(item, depth + 1) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item, depth + 1) for item in value]
    if not isinstance(value, np.ndarray):
        return value
    if value.dtype.names:
        parts = [{name: _plain(part[name], depth + 1) for name in value.dtype.names} for part in value.ravel()]
        return parts[0] if len(parts) == 1 else parts
    if value.dtype == object:
        parts = [_plain(item, depth + 1) for item in value.ravel()]
        return parts[0] if len(parts) == 1 else parts
    if value.dtype.kind in "mM":
        return _seconds(value.ravel())
    if value.dtype.kind == "U":
        return str(value.ravel()[0]) if value.size == 1 else [str(item) for item in value.ravel()]
    return value


def _of_frame(frame: Any) -> dict[str, Any]:
    """A table or timetable: its variables, its time, its units."""
    found: dict[str, Any] = {}
    index = np.asarray(frame.index)
    if index.dtype.kind in "mM":
        found["Time"], found["Time_unit"] = _seconds(index), "s"
    units = frame.attrs.get("VariableUnits", frame.attrs.get("varUnits")) or []
    for k, name in enumerate(frame.columns):
        values = np.asarray(frame[name])
        if values.dtype.kind in "mM":
            found[str(name)], found[f"{name}_unit"] = _seconds(values), "s"
            continue
        found[str(name)] = np.stack(list(values)) if values.dtype == object and len(values) and np.ndim(values[0]) else values
        if k < len(units) and str(units[k]).strip():
            found[f"{name}_unit"] = str(units[k]).strip()
    return found


def _seconds(stamps: Any) -> Any:
    """Since the first for dates, as they are for durations."""
    values = stamps - stamps[0] if stamps.dtype.kind == "M" and len(stamps) else stamps
    return values.astype("timedelta64[ns]").astype(np.int64) * 1e-9


_HEADER: Final = 128
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _OBJECT, _SPARSE = 1, 2, 3, 5
_NUMBERS: Final = (4, *range(6, 16))
_TAG: Final = 8
_DEEPEST_HEADER: Final = 20
#: Bytes of one variable, unpacked, beyond which no measurement goes.
_LARGEST: Final = 1 << 31


class SizesDoNotFit(Exception):
    """A number of elements that the bytes of the file cannot hold."""


def _check_sizes(content: bytes) -> None:
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
    if depth > _DEEPEST_HEADER:
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
