"""A profile begun from a drive or from its EDS: it loads as it is, and says what was read."""

from __future__ import annotations

from pathlib import Path

import pytest

from beltcomm import api
from beltcomm.configfiles import config_names
from beltcomm.errors import UsageError
from beltcomm.experiments.options import Options
from beltcomm.talk import Silence
from beltcomm_adapters.profiles import load_profile

EDS = """[DeviceInfo]
VendorName=Acme: "Drives" #1
VendorNumber=0x123
ProductName=X-Servo 7
ProductNumber=0x77
[OptionalObjects]
SupportedObjects=5
1=0x1016
2=0x6071
3=0x6077
4=0x6502
5=0x608F
[ManufacturerObjects]
SupportedObjects=2
1=0x2010
2=0x2020
[1016sub1]
ParameterName=Consumer heartbeat time
ObjectType=0x7
DataType=0x0007
AccessType=rw
[6071]
ParameterName=Target torque
ObjectType=0x7
DataType=0x0003
AccessType=rw
[6077]
ParameterName=Torque actual
ObjectType=0x7
DataType=0x0003
AccessType=ro
[6502]
ParameterName=Supported modes
ObjectType=0x7
DataType=0x0007
AccessType=ro
DefaultValue=0x288
[2010]
ParameterName=Velocity loop: proportional gain \t"Kp"
ObjectType=0x7
DataType=0x0006
AccessType=rw
[2020]
ParameterName=Current loop gain
ObjectType=0x7
DataType=0x0006
AccessType=rw
"""


def new(file: Path, **given: object) -> str:
    options = Options(yes=True, slave=given.pop("slave", None))  # type: ignore[arg-type]
    api.new_profile(file, given.get("drive"), given.get("eds"), options, Silence())  # type: ignore[arg-type]
    load_profile.cache_clear()
    return file.read_text(encoding="utf-8")


def test_from_an_eds(tmp_path: Path) -> None:
    eds = tmp_path / "x.eds"
    eds.write_text(EDS, encoding="latin-1")
    text = new(tmp_path / "mine.yaml", eds=eds)
    found = load_profile(str(tmp_path / "mine.yaml"))
    assert (found.modes["torque"], found.modes["position"]) == (10, 8)
    assert found.guarding == "heartbeat"
    assert not found.parameters
    assert [(one.place, one.missing) for one in found.known_gains] == [("2010h", "unit")]  # that of the current loop is nobody's business
    assert "6076h" in text
    assert "missing" in text


@pytest.mark.parametrize("slave", [None, *config_names("slaves")])
def test_from_any_drive(tmp_path: Path, slave: str | None) -> None:
    new(tmp_path / "mine.yaml", drive="virtual", slave=slave)
    assert load_profile(str(tmp_path / "mine.yaml")).gain_meaning == "none"


def test_from_nothing_is_no_profile(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--drive D, --eds FILE, or both"):
        new(tmp_path / "mine.yaml")
