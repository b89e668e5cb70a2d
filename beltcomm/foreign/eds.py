"""Electronic data sheets (EDS) and device configuration files (DCF) of CiA 306, read tolerantly: what had to be repaired is listed.

Makers' files are full of slips: sections that are missing or listed wrongly, counts that do not fit, hexadecimal numbers without 0x, keys
that stand twice, entries without a data type, odd encodings.  None of them keeps the rest from being read; a file in which no object stands
is refused.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from beltcomm.drive.objects import DictionaryEntry, ObjectValue, bounds_of, kind_of, name_of
from beltcomm.errors import DataError
from beltcomm.outside import read_bytes

#: Bytes; the largest data sheets have one.
LARGEST_FILE: Final = 8_000_000
#: Repairs of one kind that are listed one by one.
LISTED: Final = 5
_SECTION: Final = re.compile(r"\[\s*([^\]]*?)\s*\]?\s*(?:[;#].*)?")
_OBJECT: Final = re.compile(r"(?:0x)?([0-9a-f]{4})h?(?:\s*sub\s*(?:0x)?([0-9a-f]{1,2})|\s*(value))?", re.IGNORECASE)
#: A value that counts from the node's address is read for this one.
_NODE_ID: Final = 1
_NODE: Final = re.compile(r"\$?\s*nodeid\s*\+?|\+\s*\$?\s*nodeid", re.IGNORECASE)
_LISTS: Final = ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects")
_ACCESS: Final = ("ro", "wo", "rw", "rwr", "rww", "const")
_DOMAIN, _STRUCTURED = 0x2, (0x8, 0x9)


@dataclass(frozen=True)
class FileObject(DictionaryEntry):
    """One entry of a file; its value is what the file wants to stand there."""

    default: float | None = None
    low: float | None = None
    high: float | None = None

    @property
    def title(self) -> str:
        """The object as the standards write it."""
        return name_of(self.index, self.subindex)


@dataclass(frozen=True)
class ObjectFile:
    """Content of an EDS or DCF.

    Attributes
    ----------
    device : Mapping[str, str]
        Its [DeviceInfo].
    repairs : tuple of str
        In words, what was wrong and how it was taken.
    """

    path: Path
    device: Mapping[str, str]
    objects: tuple[FileObject, ...]
    repairs: tuple[str, ...]

    @property
    def values(self) -> list[ObjectValue]:
        """Values that the file wants to be written: objects with a value, a known type, and write access."""
        return [
            ObjectValue(o.index, o.subindex, o.kind, o.value)
            for o in self.objects
            if o.value is not None and o.kind is not None and o.access not in ("ro", "const")
        ]

    def lines(self) -> list[str]:
        """For people: what stands in it, and what was repaired."""
        named = ", ".join(f"{key} {value}" for key, value in self.device.items() if value)
        values = len(self.values)
        repaired = [f"  {one}" for one in self.repairs] or ["  nothing had to be repaired"]
        return [
            f"{self.path}: {len(self.objects)} objects, {values} with a value to be written; {named or 'it does not say of which device'}",
            "Repaired:",
            *repaired,
        ]


@dataclass
class _Repairs:
    """Repairs by kind, so that a file with a thousand equal slips is told in one line."""

    by_kind: dict[str, list[str]] = field(default_factory=dict)

    def add(self, kind: str, where: str) -> None:
        self.by_kind.setdefault(kind, []).append(where)

    def lines(self) -> tuple[str, ...]:
        found = []
        for kind, places in self.by_kind.items():
            more = f" and {len(places) - LISTED} more" if len(places) > LISTED else ""
            found.append(f"{kind}: {', '.join(places[:LISTED])}{more}")
        return tuple(found)


def load_object_file(path: Path) -> ObjectFile:
    """Read an EDS or DCF.

    Parameters
    ----------
    path : Path

    Raises
    ------
    DataError
        For a file that cannot be read or holds no object.
    """
    try:
        content = read_bytes(path, LARGEST_FILE)
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}") from error
    return _parse(content, path)


def _parse(content: bytes, path: Path) -> ObjectFile:
    """Read an EDS or DCF from its bytes."""
    repairs = _Repairs()
    sections = _sections(_text(content, repairs), repairs)
    objects = _objects(sections, repairs)
    if not objects:
        raise DataError(f"{path} holds no object; it is no EDS or DCF (CiA 306)")
    _check_lists(sections, {item.index for item in objects}, repairs)
    about = sections.get("deviceinfo", {})
    wanted = {"vendorname": "vendor", "productname": "product", "vendornumber": "vendor number", "productnumber": "product number"}
    device = {word: about[key] for key, word in wanted.items() if about.get(key)}
    return ObjectFile(path, device, tuple(objects), repairs.lines())


def _text(content: bytes, repairs: _Repairs) -> str:
    for mark, encoding in ((b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be")):
        if content.startswith(mark):
            repairs.add("byte order mark taken off", encoding)
            return content[len(mark) :].decode(encoding, "replace")
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError:
        repairs.add("not UTF-8, read as", "Latin-1")
        text = content.decode("latin-1")
    if "\0" in text:
        repairs.add("bytes of value 0 left out", str(text.count("\0")))
        text = text.replace("\0", "")
    return text


def _sections(text: str, repairs: _Repairs) -> dict[str, dict[str, str]]:
    """Section -> key -> value, both in small letters; the first of two equal keys holds."""
    sections: dict[str, dict[str, str]] = {}
    here: dict[str, str] | None = None
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.strip()
        if not line or line[0] in ";#":
            continue
        if line[0] == "[":
            found = _SECTION.fullmatch(line)
            name = (found[1] if found else line.strip("[] \t")).lower()
            if "]" not in line or found is None:
                repairs.add("section heads mended", f"line {number}")
            if name in sections:
                repairs.add("sections that stand twice, taken together", f"[{name}] in line {number}")
            here = sections.setdefault(name, {})
            continue
        key, equals, value = line.partition("=")
        key = key.strip().lower()
        if not equals or not key or here is None:
            repairs.add("lines without meaning left out", f"line {number}")
            continue
        if key in here:
            repairs.add("keys that stand twice, the first holds", f"{key} in line {number}")
            continue
        here[key] = value.split(";")[0].strip()
    return sections


def _objects(sections: Mapping[str, Mapping[str, str]], repairs: _Repairs) -> list[FileObject]:
    found: dict[tuple[int, int], FileObject] = {}
    subs: dict[int, set[int]] = {}
    heads: dict[int, Mapping[str, str]] = {}
    for name, entries in sections.items():
        match = _OBJECT.fullmatch(name)
        if match is None or match[3]:
            continue
        index = int(match[1], 16)
        if match[2] is None:
            heads.setdefault(index, entries)
            if not _structured(entries):
                found.setdefault((index, 0), _entry(index, 0, entries, repairs))
        else:
            sub = int(match[2], 16)
            subs.setdefault(index, set()).add(sub)
            found[index, sub] = _entry(index, sub, entries, repairs)
    for index, entries in heads.items():
        compact = _number(entries.get("compactsubobj", ""), "uint8", "", _Repairs())
        if compact:
            values = sections.get(f"{index:04x}value", {})
            for sub in range(1, int(min(compact, 254)) + 1):
                own = {**entries, "parametervalue": values.get(str(sub), entries.get("parametervalue", ""))}
                found.setdefault((index, sub), _entry(index, sub, own, repairs))
            continue
        said = _number(entries.get("subnumber", ""), "uint8", "", _Repairs())
        there = len(subs.get(index, ()))
        if _structured(entries) and said is not None and int(said) != there:
            repairs.add("SubNumber wrong, the sections hold", f"{index:04X}h says {int(said)}, there are {there}")
    for index in sorted(set(subs) - set(heads)):
        repairs.add("objects without a section of their own", f"{index:04X}h")
    return [found[place] for place in sorted(found)]


def _structured(entries: Mapping[str, str]) -> bool:
    """True if a section is the head of an array or record: its values stand under subindices."""
    code = _number(entries.get("objecttype", ""), "uint8", "", _Repairs())
    return code in _STRUCTURED or (code is None and ("subnumber" in entries or "compactsubobj" in entries) and "datatype" not in entries)


def _entry(index: int, sub: int, entries: Mapping[str, str], repairs: _Repairs) -> FileObject:
    title = name_of(index, sub)
    data_type = _number(entries.get("datatype", ""), "uint16", f"DataType of {title}", repairs)
    if data_type is None and _number(entries.get("objecttype", ""), "uint8", "", _Repairs()) != _DOMAIN:
        repairs.add("no DataType, its value is not used", title)
    kind = None if data_type is None else kind_of(int(data_type))
    access = entries.get("accesstype", "").lower()
    if access not in _ACCESS:
        repairs.add("no known AccessType, taken as rw" if not access else "AccessType unknown, taken as rw", title)
        access = "rw"
    numbers = {
        key: _number(entries.get(key, ""), kind, f"{key} of {title}", repairs) if kind else None
        for key in ("parametervalue", "defaultvalue", "lowlimit", "highlimit")
    }
    low, high = numbers["lowlimit"], numbers["highlimit"]
    if low is not None and high is not None and low > high:
        repairs.add("limits the wrong way round, not used", title)
        low = high = None
    return FileObject(
        index, sub, entries.get("parametername", ""), kind, access, numbers["parametervalue"], numbers["defaultvalue"], low, high
    )


def _number(text: str, kind: str | None, what: str, repairs: _Repairs) -> float | None:
    """A number of a type; None for none, with a repair where something stands there.   what : it is, "" not to tell."""
    plain = text.strip().strip('"').replace("_", "")
    if not plain or kind is None:
        return None
    base, count = _NODE.subn("", plain)
    base = base.strip().lower() or "0"
    try:
        if kind == "real32":
            value = _real(base)
        elif re.fullmatch(r"[-+]?0x[0-9a-f]+|[-+]?\d+", base):
            value = float(int(base, 16) if "x" in base else int(base))
        elif re.fullmatch(r"[0-9a-f]+h?", base):
            value = float(int(base.removesuffix("h"), 16))
            repairs.add("hexadecimal without 0x", f"{what} {plain}")
        else:
            raise ValueError(plain)
    except (ValueError, OverflowError):
        if what:
            repairs.add("no number, not used", f"{what} {plain[:20]!r}")
        return None
    value += _NODE_ID if count else 0
    least, most = bounds_of(kind)
    if kind.startswith("int") and most < value <= 2 * most + 1:  # 0xFFFF is how a file writes -1
        value -= 2 * (most + 1)
    if not least <= value <= most:
        if what:
            repairs.add("does not fit its data type, not used", f"{what} {plain[:20]}")
        return None
    return value


def _real(text: str) -> float:
    """A floating-point number, written as one or as its bits."""

    if re.fullmatch(r"0x[0-9a-f]{1,8}", text):
        value: float = struct.unpack("<f", int(text, 16).to_bytes(4, "little"))[0]
    else:
        value = float(text.replace(",", "."))
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def _check_lists(sections: Mapping[str, Mapping[str, str]], there: set[int], repairs: _Repairs) -> None:
    listed: set[int] = set()
    for title in ("FileInfo", "DeviceInfo", *_LISTS):
        if title.lower() not in sections:
            repairs.add("sections that are missing", f"[{title}]")
    for title in _LISTS:
        entries = sections.get(title.lower(), {})
        indices = {key: _number(value, "uint16", f"[{title}] {key}", repairs) for key, value in entries.items() if key.isdecimal()}
        said = _number(entries.get("supportedobjects", ""), "uint16", f"[{title}] SupportedObjects", repairs)
        if entries and (said is None or int(said) != len(indices)):
            repairs.add("SupportedObjects wrong", f"[{title}] says {'nothing' if said is None else int(said)}, lists {len(indices)}")
        listed |= {int(index) for index in indices.values() if index is not None}
    for index in sorted(listed - there):
        repairs.add("listed without a section", f"{index:04X}h")
    if listed:
        for index in sorted(there - listed):
            repairs.add("objects that no list names", f"{index:04X}h")
