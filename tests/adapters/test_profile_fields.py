"""What a profile of one's own says of a drive beside its units: actual torque, error behaviour, homing, saving."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from adapters.stub_node import RATED_NM, StubNode
from adapters.test_record import LIMITS, torque
from adapters.test_trial import FixedMapping, objects_with_four
from beltcomm.drive import StatedReading
from beltcomm.drive.access import able
from beltcomm.errors import Refused, UsageError
from beltcomm.fit.torque.acting_torque import stated_remarks
from beltcomm.fit.torque.lag import Lag
from beltcomm.fit.torque.laws import DriveLaw, ReadingLaw
from beltcomm.fit.torque.path import TorquePath
from beltcomm_adapters.locks import ALWAYS
from beltcomm_adapters.profiles import load_profile

#: N m in one unit of the torque that stands in the maker's own object.
UNIT_NM = 2.5e-5


class OwnTorque(FixedMapping):
    """Its acting torque stands in 2077h:3, 32 bits."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.objects |= objects_with_four() | {(0x2077, 3): ("<i", 1200)}

    def further(self, mean_nm: float) -> dict[int, bytes]:
        return {0x2077: struct.pack("<i", round(mean_nm / UNIT_NM))}


def profile(folder: Path, **fields: Any) -> str:
    file = folder / "mine.yaml"
    file.write_text(yaml.safe_dump({"name": "mine", "title": "mine", **fields}))
    load_profile.cache_clear()
    return str(file)


def test_the_actual_torque_is_read_where_the_profile_says(opened, tmp_path):
    node = OwnTorque()
    stands = {"index": 0x2077, "subindex": 3, "type": "int32", "nm": UNIT_NM}
    drive = able(opened(node, profile(tmp_path, actual_torque=stands)), "torque")
    assert drive.read(["torque_nm"])["torque_nm"] == pytest.approx(1200 * UNIT_NM)
    rows: list[tuple[float, ...]] = []
    drive.record(torque([0.2] * 60), LIMITS, rows.append)
    assert [row[1] for row in rows[10:50]] == pytest.approx([round(0.2 / RATED_NM * 1000) * RATED_NM / 1000] * 40, abs=UNIT_NM)


def test_the_error_behaviour_is_lent(opened, tmp_path):
    node = StubNode()
    node.objects |= {(0x1029, 1): ("<B", 0), (0x6007, 0): ("<h", 1)}
    opened(node, profile(tmp_path, error_behaviour={"node": 1, "axis": 3})).record(torque([0.01] * 20), LIMITS, lambda row: None)
    assert (0x1029, 1, 1) in node.written
    assert (0x6007, 0, 3) in node.written
    assert (node.get(0x1029, 1), node.get(0x6007)) == (0, 1)


@pytest.mark.parametrize("wrong", [{"node": 2}, {"axis": 0}])
def test_no_error_behaviour_that_leaves_the_axis_alone(tmp_path, wrong):
    with pytest.raises(UsageError, match=f"error_behaviour.{next(iter(wrong))} is"):
        load_profile(profile(tmp_path, error_behaviour=wrong))


def test_parameters_are_kept_by_the_object_of_the_profile(opened, tmp_path):
    node = StubNode()
    node.objects[0x2FF0, 1] = ("<H", 0)
    drive = opened(node, profile(tmp_path, save={"index": 0x2FF0, "subindex": 1, "type": "uint16", "value": 7}))
    drive.save()
    assert (0x2FF0, 1, 7) in node.written


@pytest.mark.parametrize("place", [(0x607A, 0), (0x6040, 0), (0x6076, 0), (0x1011, 1), (0x2022, 1)])
def test_saving_writes_nothing_else(tmp_path, place):
    with pytest.raises(UsageError, match="save writes"):
        load_profile(profile(tmp_path, save={"index": place[0], "subindex": place[1]}))


def test_a_hostile_profile_makes_nothing_written_beyond_the_closed_list(tmp_path):
    """Save, error behaviour and homing, drawn: what is loaded keeps to the maker's own settings, 1010h and the reactions that stop."""
    draw, kept = np.random.default_rng(38), 0
    for number in range(300):
        first = int(draw.choice([0x1000, 0x2000, 0x2020, 0x6000]))
        save = {"index": first + int(draw.integers(0x30)), "subindex": int(draw.integers(4)), "value": int(draw.integers(1, 9))}
        reaction = {"node": int(draw.integers(-1, 4)), "axis": int(draw.integers(-1, 6))}
        method = int(draw.integers(-300, 300))
        (tmp_path / str(number)).mkdir()
        try:
            loaded = load_profile(profile(tmp_path / str(number), save=save, error_behaviour=reaction, homing={"method": method}))
        except UsageError:
            continue
        kept += 1
        place = loaded.save.index, loaded.save.subindex
        assert place[0] == 0x1010 or 0x2000 <= place[0] < 0x6000
        assert not any(lock.holds(*place) for lock in ALWAYS)
        assert reaction["node"] in (0, 1)
        assert reaction["axis"] in (1, 2, 3)
        assert -128 <= method <= 127
    assert kept > 3


def test_gains_of_a_profile_of_ones_own_are_measured_unless_it_vouches_for_them(tmp_path):
    gains = {"kp_nm_s_rad": {"index": 0x2000, "subindex": 1, "type": "uint16", "scale": 1e-4}}
    assert load_profile(profile(tmp_path, parameters=gains)).gain_meaning == "unconfirmed"
    assert load_profile(profile(tmp_path, parameters=gains, gain_meaning="documented")).gain_meaning == "documented"


def homing() -> StubNode:
    node = StubNode()
    node.objects |= {(0x6098, 0): ("<b", 0), (0x6099, 1): ("<I", 100), (0x6099, 2): ("<I", 100), (0x6502, 0): ("<I", 0x3A0)}
    return node


def test_a_drive_without_a_method_of_homing_says_what_to_state(opened, tmp_path):
    node = homing()
    with pytest.raises(Refused, match=r"6098h is 0.*homing: \{method: 37\}"):
        opened(node, profile(tmp_path)).home(LIMITS)
    node.refuse[0x6098, 0] = 0x06090030
    with pytest.raises(Refused, match="refuses the homing method 99 of its profile"):
        opened(node, profile(tmp_path, homing={"method": 99})).home(LIMITS)
    assert 0x27 not in node.states, "its stage stayed off"


@pytest.mark.parametrize("seed", range(4))
def test_a_statement_on_the_reading_that_the_records_contradict_is_told(seed: int) -> None:
    random = np.random.default_rng(seed)
    time_s = float(random.uniform(1e-3, 4e-3))
    lag = Lag("first order", (time_s,), (0.02 * time_s,))
    path = TorquePath(DriveLaw(1.0), ReadingLaw(0.0, (lag,)))
    assert stated_remarks(path, None, 1e-3) == []
    assert stated_remarks(path, StatedReading(filter_s=1.1 * time_s), 1e-3) == []
    (said,) = stated_remarks(path, StatedReading(filter_s=2.0 * time_s + 1e-3), 1e-3)
    assert f"{2e3 * time_s + 1:.3g} ms" in said
    assert f"{1e3 * time_s:.2g}" in said
    assert "actual_torque.filter_ms" in said
    assert "actual_torque.late_ms" in " ".join(stated_remarks(path, StatedReading(late_s=2e-3), 1e-3))
    assert "actual_torque.command" in " ".join(stated_remarks(path, StatedReading(command=True), 1e-3))
    plain = TorquePath(DriveLaw(1.0), rivals=(path,))
    assert "do not tell the two apart" in " ".join(stated_remarks(plain, StatedReading(filter_s=time_s), 1e-3))
