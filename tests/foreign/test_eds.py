"""Data sheets and configuration files: read beside canopen's own reader, repaired in words, and never a traceback."""

from __future__ import annotations

import io
import random
from collections.abc import Callable
from pathlib import Path

import canopen
import pytest
from click.testing import CliRunner

from beltcomm.cli.main import cli
from beltcomm.drive.objects import ObjectValue
from beltcomm.errors import DataError
from beltcomm.export.dcf import dcf_text
from beltcomm.foreign.eds import _parse, load_object_file

HERE = Path("file.eds")
GOOD = """[FileInfo]
FileName=drive.eds
[DeviceInfo]
VendorName=Somebody
VendorNumber=0x1D
ProductName=Drive
[MandatoryObjects]
SupportedObjects=2
1=0x1000
2=0x1018
[OptionalObjects]
SupportedObjects=3
1=0x1800
2=0x6072
3=0x607C
[ManufacturerObjects]
SupportedObjects=2
1=0x2100
2=0x2200
[1000]
ParameterName=Device type
ObjectType=0x7
DataType=0x0007
AccessType=ro
DefaultValue=0x20192
[1018]
ParameterName=Identity
ObjectType=0x9
SubNumber=2
[1018sub0]
ParameterName=Highest
DataType=0x5
AccessType=ro
[1018sub1]
ParameterName=Vendor
DataType=0x7
AccessType=ro
DefaultValue=29
[1800]
ParameterName=TPDO
ObjectType=0x9
SubNumber=1
[1800sub1]
ParameterName=COB-ID
DataType=0x7
AccessType=rw
DefaultValue=$NODEID+0x180
[6072]
ParameterName=Max torque
ObjectType=0x7
DataType=0x6
AccessType=rw
LowLimit=0
HighLimit=5000
ParameterValue=1000
[607C]
ParameterName=Home offset
ObjectType=0x7
DataType=0x4
AccessType=rw
ParameterValue=0xFFFFFFFE
[2100]
ParameterName=Gains
ObjectType=0x9
SubNumber=2
[2100sub0]
ParameterName=Highest
DataType=0x5
AccessType=const
[2100sub1]
ParameterName=Gain
DataType=0x8
AccessType=rw
ParameterValue=0.0125
[2200]
ParameterName=Program
ObjectType=0x2
DataType=0xF
AccessType=wo
"""
VALUES = [
    ObjectValue(0x60F9, 1, "uint16", 300, "kp_nm_s_rad"),
    ObjectValue(0x60F9, 2, "uint16", 32000, "ki_nm_rad"),
    ObjectValue(0x2100, 3, "real32", 0.0123456789, "kpp_1_s"),
    ObjectValue(0x607C, 0, "int32", -5),
    ObjectValue(0x6098, 0, "int8", -1),
]


def test_a_good_file_needs_no_repair() -> None:
    found = _parse(GOOD.encode(), HERE)
    assert found.repairs == ()
    assert {one.title: one.value for one in found.objects if one.value is not None} == {"6072h": 1000, "607Ch": -2, "2100h:1": 0.0125}
    assert {one.title: one.default for one in found.objects if one.default is not None} == {
        "1000h": 0x20192,
        "1018h:1": 29,
        "1800h:1": 0x181,
    }
    assert [(one.title, one.kind, one.raw) for one in found.values] == [
        ("2100h:1", "real32", 0.0125),
        ("6072h", "uint16", 1000),
        ("607Ch", "int32", -2),
    ]
    assert found.device == {"vendor": "Somebody", "product": "Drive", "vendor number": "0x1D"}
    assert next(one for one in found.objects if one.title == "2200h").kind is None  # a domain


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda t: b"\xef\xbb\xbf" + t.encode(), "byte order mark taken off: utf-8"),
        (lambda t: t.replace("Somebody", "Grün").encode("latin-1"), "not UTF-8, read as: Latin-1"),
        (lambda t: b"\xff\xfe" + t.encode("utf-16-le"), "byte order mark taken off: utf-16-le"),
        (lambda t: t.replace("[FileInfo]\nFileName=drive.eds\n", "").encode(), "sections that are missing: [FileInfo]"),
        (
            lambda t: t.replace("SupportedObjects=3", "SupportedObjects=9").encode(),
            "SupportedObjects wrong: [OptionalObjects] says 9, lists 3",
        ),
        (lambda t: t.replace("SubNumber=2", "SubNumber=7", 1).encode(), "SubNumber wrong, the sections hold: 1018h says 7, there are 2"),
        (lambda t: t.replace("DefaultValue=0x20192", "DefaultValue=2019A").encode(), "hexadecimal without 0x: defaultvalue of 1000h 2019A"),
        (
            lambda t: t.replace("HighLimit=5000", "HighLimit=5000\nHighLimit=7").encode(),
            "keys that stand twice, the first holds: highlimit in line",
        ),
        (lambda t: t.replace("ObjectType=0x7\nDataType=0x6\n", "ObjectType=0x7\n").encode(), "no DataType, its value is not used: 6072h"),
        (lambda t: t.replace("[607C]", "[607C").encode(), "section heads mended: line"),
        (lambda t: t.replace("[607C]", "[0x607C]").encode(), ""),
        (lambda t: t.replace("2=0x6072\n", "").encode(), "objects that no list names: 6072h"),
        (lambda t: t.replace("3=0x607C", "3=0x607D").encode(), "listed without a section: 607Dh"),
        (lambda t: t.replace("LowLimit=0\n", "LowLimit=9000\n").encode(), "limits the wrong way round, not used: 6072h"),
        (
            lambda t: t.replace("AccessType=ro\nDefaultValue=0x20192", "AccessType=readonly\nDefaultValue=0x20192").encode(),
            "AccessType unknown, taken as rw: 1000h",
        ),
        (
            lambda t: t.replace("ParameterValue=1000", "ParameterValue=70000").encode(),
            "does not fit its data type, not used: parametervalue of 6072h",
        ),
        (lambda t: t.replace("ParameterValue=1000", "ParameterValue=one").encode(), "no number, not used: parametervalue of 6072h 'one'"),
        (lambda t: (t + "\nwhat is this\n").encode(), "lines without meaning left out: line"),
        (lambda t: (t + "[6072]\nDenotation=x\n").encode(), "sections that stand twice, taken together: [6072]"),
        (lambda t: t.replace("Somebody", "Some\0body").encode(), "bytes of value 0 left out: 1"),
    ],
)
def test_what_is_repaired_is_said(damage: Callable[[str], bytes], said: str) -> None:
    found = _parse(damage(GOOD), HERE)
    assert any(said in one for one in found.repairs) if said else found.repairs == ()
    rest = {one.title: one.value for one in found.objects if one.value is not None}
    assert rest.get("607Ch") == -2  # the rest is read all the same
    assert rest.get("2100h:1") == 0.0125


def test_compact_arrays_are_spread() -> None:
    found = _parse(b"[1003]\nObjectType=0x8\nDataType=7\nAccessType=rw\nCompactSubObj=3\n[1003Value]\nNrOfEntries=1\n2=0x77\n", HERE)
    assert {one.title: one.value for one in found.objects} == {"1003h:1": None, "1003h:2": 0x77, "1003h:3": None}


@pytest.mark.parametrize("content", [b"", b"\0\0\0", b"[FileInfo]\nFileName=x\n", b"\xff\xfe", b"PK\x03\x04 not a data sheet", b"[6072"])
def test_no_data_sheet(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "x.eds"
    path.write_bytes(content)
    if content == b"[6072":
        assert [one.title for one in load_object_file(path).objects] == ["6072h"]
        return
    with pytest.raises(DataError, match="holds no object"):
        load_object_file(path)
    outcome = CliRunner().invoke(cli, ["drives", "--eds", str(path)])
    assert (outcome.exit_code, "Traceback" in outcome.stderr) == (3, False)


def test_the_command_shows_a_file(tmp_path: Path) -> None:
    path = tmp_path / "x.eds"
    path.write_text(GOOD.replace("SupportedObjects=3", "SupportedObjects=4"), encoding="utf-8")
    outcome = CliRunner().invoke(cli, ["drives", "--eds", str(path)])
    assert outcome.exit_code == 0
    for words in ("9 objects, 3 with a value", "vendor Somebody", "SupportedObjects wrong", "6072h     = 1000"):
        assert words in outcome.stdout
    missing = CliRunner().invoke(cli, ["drives", "--eds", str(tmp_path / "none.eds")])
    assert (missing.exit_code, "cannot be read" in missing.stderr) == (3, True)


def test_what_is_exported_is_read_alike_by_canopen_and_by_us() -> None:
    """python-canopen's reader shares no code with ours."""
    about = {"device_name": "CMMP-AS", "vendor_id": "29", "product_code": "0", "when": "2026-11-22T14:05:00"}
    text = dcf_text(VALUES, about, ["one note"])
    ours = _parse(text.encode(), HERE)
    assert ours.repairs == ()
    assert {one.place: one.raw for one in ours.values} == pytest.approx({one.place: one.raw for one in VALUES})
    assert {one.place: one.kind for one in ours.values} == {one.place: one.kind for one in VALUES}
    dictionary = canopen.import_od(NamedText(text))
    for one in VALUES:
        entry = dictionary[one.index] if one.subindex == 0 else dictionary[one.index][one.subindex]
        raw = entry.value
        size = {"int32": 32, "int8": 8}.get(one.kind)
        assert (raw - 2**size if size and raw >= 2 ** (size - 1) else raw) == pytest.approx(one.raw), one.title
        assert entry.data_type == {"uint16": 6, "real32": 8, "int32": 4, "int8": 2}[one.kind]
    for words in ("CreationDate=11-22-2026", "CreationTime=02:05PM", "Line1=one note", "VendorNumber=29"):
        assert words in text


class NamedText(io.StringIO):
    """A text file with the name that canopen wants to see."""

    name = "drive.dcf"


def mutate(text: bytes, chance: random.Random) -> bytes:
    """One to six random slips: bytes changed, lines dropped, doubled, cut or swapped, numbers and keys replaced."""
    content = bytearray(text)
    for _ in range(chance.randint(1, 6)):
        kind, at = chance.randrange(7), chance.randrange(max(1, len(content)))
        if kind == 0:
            content[at : at + 1] = bytes([chance.randrange(256)])
        elif kind == 1:
            content[at:at] = bytes(chance.randrange(256) for _ in range(chance.randrange(1, 9)))
        elif kind == 2:
            del content[at : at + chance.randrange(1, 40)]
        elif kind == 3:
            lines = content.split(b"\n")
            chance.shuffle(lines)
            content = bytearray(b"\n".join(lines))
        elif kind == 4:
            content += content[at : at + 200]
        elif kind == 5:
            old, new = chance.choice(
                [(b"0x", b""), (b"=", b"=="), (b"sub", b"SUB "), (b"]", b""), (b"DataType", b"Type"), (b"7", b"99999999999999")]
            )
            content = content.replace(old, new, chance.randrange(1, 5))
        else:
            odd = [b"1e999", b"nan", b"-0x", b"0x", b"$NODEID", b"+", b"\xf0\x9f", b"9" * 5000, b"[", b"CompactSubObj=255", b"0b1"]
            content[at:at] = chance.choice(odd)
    return bytes(content)


@pytest.mark.parametrize("first", range(0, 1500, 300))
def test_no_mutation_raises_a_traceback(first: int) -> None:
    """1500 files, each with random slips: objects or a sentence, and every value fits its type."""
    good = [GOOD.encode(), dcf_text(VALUES, {}).encode()]
    read = 0
    for seed in range(first, first + 300):
        chance = random.Random(seed)
        try:
            found = _parse(mutate(chance.choice(good), chance), HERE)
        except DataError:
            continue
        read += 1
        assert found.lines()
        for one in found.values:
            ObjectValue(one.index, one.subindex, one.kind, one.raw).to_dict()
            assert 0 <= one.index <= 0xFFFF
            assert 0 <= one.subindex <= 0xFF
            assert len(packed_bytes(one)) in (1, 2, 4)
    assert read > 200


def packed_bytes(one: ObjectValue) -> bytes:
    from beltcomm.drive.objects import packed

    return packed(one.kind, one.raw)
