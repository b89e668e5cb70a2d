"""Objects with their values as a device configuration file (DCF, CiA 306), which other CANopen tools load into a drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from beltcomm.borders import for_comment
from beltcomm.drive.objects import TYPES, ObjectValue, bounds_of

#: What every device has, listed because CiA 306 asks for it; no value is set.
_MANDATORY: Sequence[tuple[int, int, str, str]] = (
    (0x1000, 0, "uint32", "Device type"),
    (0x1001, 0, "uint8", "Error register"),
    (0x1018, 0, "uint8", "Highest subindex"),
    (0x1018, 1, "uint32", "Vendor ID"),
)
_VAR, _RECORD = 0x7, 0x9


def dcf_text(values: Sequence[ObjectValue], about: Mapping[str, str], notes: Sequence[str] = ()) -> str:
    """The file's text, CR LF.

    Parameters
    ----------
    values : sequence of ObjectValue
        Objects with their raw values.
    about : Mapping[str, str]
        vendor_id, product_code, device_name, node, bitrate (kbit/s), when: what is known of them.
    notes : sequence of str
        Into [Comments]. Raises nothing: values fit their types.
    """
    by_index: dict[int, dict[int, ObjectValue]] = {}
    for item in values:
        by_index.setdefault(item.index, {})[item.subindex] = item
    day, _, clock = about.get("when", "").partition("T")
    lines = [
        *_section("FileInfo", FileName="drive.dcf", FileVersion=1, FileRevision=0, EDSVersion="4.0", Description="controller of a run"),
        *([f"CreationDate={day[5:7]}-{day[8:10]}-{day[:4]}", f"CreationTime={_clock(clock)}"] if len(day) == 10 else []),
        "CreatedBy=beltcomm",
        "",
        *_section(
            "DeviceInfo",
            VendorNumber=about.get("vendor_id", "0"),
            ProductName=about.get("device_name", ""),
            ProductNumber=about.get("product_code", "0"),
            Granularity=8,
            NrOfRxPDO=4,
            NrOfTxPDO=4,
            LSS_Supported=0,
        ),
        "",
        *_section("DummyUsage", **{f"Dummy{number:04X}": 0 for number in range(1, 8)}),
        "",
        *_section("Comments", Lines=len(notes), **{f"Line{number}": note for number, note in enumerate(notes, start=1)}),
        "",
        *_section("DeviceComissioning", NodeID=about.get("node", "1"), Baudrate=about.get("bitrate", "1000")),
        "",
        *_listed("MandatoryObjects", sorted({index for index, *_ in _MANDATORY})),
        *_listed("OptionalObjects", [i for i in sorted(by_index) if not 0x2000 <= i < 0x6000]),
        *_listed("ManufacturerObjects", [i for i in sorted(by_index) if 0x2000 <= i < 0x6000]),
        *_entry("1000", "Device type", "uint32", "ro"),
        *_entry("1001", "Error register", "uint8", "ro"),
        *_record(
            0x1018, "Identity", [_entry(f"1018sub{sub}", name, kind, "ro") for index, sub, kind, name in _MANDATORY if index == 0x1018]
        ),
    ]
    for index in sorted(by_index):
        parts = by_index[index]
        if set(parts) == {0}:
            lines += _of(parts[0], f"{index:04X}")
            continue
        own = [_of(parts[sub], f"{index:04X}sub{sub:X}") for sub in sorted(parts) if sub]
        count = _entry(f"{index:04X}sub0", "Highest subindex", "uint8", "const", DefaultValue=max(parts))
        lines += _record(index, _title(parts[max(parts)], "parameters"), [count, *own])
    return "\r\n".join(lines) + "\r\n"


def _clock(text: str) -> str:
    """hh:mm[AM|PM], as CiA 306 writes a time."""
    try:
        hour, minute = int(text[:2]), text[3:5]
    except ValueError:
        return "12:00AM"
    return f"{hour % 12 or 12:02d}:{minute}{'AM' if hour < 12 else 'PM'}"


def _section(name: str, **entries: Any) -> list[str]:
    return [f"[{name}]", *(f"{key}={for_comment(str(value))}" for key, value in entries.items())]


def _listed(name: str, indices: Sequence[int]) -> list[str]:
    return [f"[{name}]", f"SupportedObjects={len(indices)}", *(f"{n}=0x{index:04X}" for n, index in enumerate(indices, start=1)), ""]


def _record(index: int, name: str, entries: Sequence[Sequence[str]]) -> list[str]:
    head = _section(f"{index:04X}", ParameterName=name, ObjectType=f"0x{_RECORD:X}", SubNumber=len(entries))
    return [*head, "", *(line for entry in entries for line in entry)]


def _entry(section: str, name: str, kind: str, access: str, **more: Any) -> list[str]:
    entries = {"ParameterName": name, "ObjectType": f"0x{_VAR:X}", "DataType": f"0x{TYPES[kind][1]:04X}", "AccessType": access}
    return [*_section(section, **entries, PDOMapping=0, **more), ""]


def _of(item: ObjectValue, section: str) -> list[str]:
    return _entry(section, _title(item, section), item.kind, "rw", ParameterValue=_written(item))


def _title(item: ObjectValue, otherwise: str) -> str:
    return item.name or otherwise


def _written(item: ObjectValue) -> str:
    """The value: a real number with all its digits, an integer in hexadecimal, a negative one as its two's complement."""
    if item.kind == "real32":
        return f"{item.raw:.9g}"
    least, most = bounds_of(item.kind)
    digits = len(f"{int(most - least):X}")
    return f"0x{int(item.raw) % int(most - least + 1):0{digits}X}"
