"""Every drive profile: loads, says where each entry is from, locks what must not be written, and offers nothing of that as writable."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import beltcomm_adapters
from adapters.stub_node import StubBus, StubNode
from beltcomm.cli.main import cli
from beltcomm.configfiles import config_names, find_config, read_yaml, to_yaml
from beltcomm.drive.objects import ObjectValue
from beltcomm.drive.parameters import GAIN_NAMES
from beltcomm.errors import ObjectLocked, UsageError
from beltcomm_adapters.canopen import connect
from beltcomm_adapters.gains import Parameters
from beltcomm_adapters.link import Link
from beltcomm_adapters.locks import ALWAYS
from beltcomm_adapters.profile_schema import CONFIDENCES, PROFILE, FieldGroup, FieldRows, faults
from beltcomm_adapters.profiles import UNSOURCED, choose_profile, load_profile
from beltcomm_adapters.scaling import Scaling
from beltcomm_adapters.sdo import SdoObjects

NAMES = config_names("drives")
#: Objects that the adapter's own code writes for the tests and the communication, by number in its sources.
SOURCES = "".join(path.read_text(encoding="utf-8") for path in Path(beltcomm_adapters.__file__).parent.glob("*.py"))
WRITTEN = {int(number, 16) for number in re.findall(r"(?:lending\.set(?:_if_there)?|objects\.write)\(0x([0-9A-F]{4})", SOURCES)}
#: Section 2.6 of the fact sheet on drive protocols: never write.
SHEET = [0x60F6, 0x6410, *range(0x2021, 0x2027), 0x604D, 0x6075, 0x6076]


def locked_objects(name: str) -> SdoObjects:
    objects = SdoObjects(Link(StubBus(StubNode()), StubBus().clock, 1))
    objects.locks.add(load_profile(name).never_write)
    return objects


def test_the_drives_of_the_fact_sheet_are_there():
    vendors = {"nanotec", "epos4", "copley", "elmo", "kollmorgen-akd", "kollmorgen-s700", "delta-a2", "leadshine", "kinco", "cmmt"}
    assert {"cmmp-as", "cmms-as", "cia402", "reference", *vendors} == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_every_entry_has_source_and_confidence(name):
    raw = read_yaml(find_config("drives", name))
    stated = {key for key, value in raw.items() if key not in UNSOURCED and key != "sources" and not (key == "parameters" and not value)}
    assert stated <= set(raw["sources"]), name
    told = [*raw["sources"].values(), *raw.get("never_write", []), *raw.get("known_gains", [])]
    assert all(entry["source"] and entry["confidence"] in CONFIDENCES for entry in told)
    profile = load_profile(name)
    assert profile.torque_scale.check
    assert (profile.torque_scale.confidence == "simulated") is (name == "reference")
    # what is only recalled is said to be so, and a gain of which only that is known cannot be written
    if raw["sources"].get("parameters", {}).get("confidence") not in (None, "read") and name != "reference":
        assert profile.gain_meaning == "unconfirmed"
    if profile.gain_meaning == "none":
        assert not profile.parameters


@pytest.mark.parametrize("name", NAMES)
def test_nothing_that_is_never_written_is_among_what_is_written(name):
    profile, locks = load_profile(name), locked_objects(name).locks
    own = {(entry.index, entry.subindex) for entry in profile.parameters.values()}
    own |= {profile.enable_logic[:2]} if profile.enable_logic else set()
    factor_group = {(0x6094, 1), (0x6094, 2)}
    places = own | factor_group | {(index, sub) for index in WRITTEN for sub in (0, 1, 2)}
    assert len(WRITTEN) > 12  # the pattern still finds them
    assert {place for place in places if locks._lock_of(*place)} == set()


@pytest.mark.parametrize("name", NAMES)
def test_a_locked_object_is_refused_whoever_asks_and_no_frame_is_sent(name):
    objects = locked_objects(name)
    bus = objects._client._link.bus
    parameters = Parameters(objects, load_profile(name), Scaling(1e-4, 1e-4, 1e-4, 1e-3, 65536, 1.0, 2.0))
    bus.sent.clear()

    def write_object(objects: SdoObjects, index: int, sub: int) -> None:
        objects.write(index, sub, "uint16", 1)

    def download(objects: SdoObjects, index: int, sub: int) -> None:
        objects._client.download(index, sub, b"\1\0")

    def lend(objects: SdoObjects, index: int, sub: int) -> None:
        bus.nodes[0].objects[index, sub] = ("<H", 7)
        objects.lend().set(index, sub, "uint16", 1)

    def map_it(objects: SdoObjects, index: int, sub: int) -> None:
        objects.write(0x1600, 1, "uint32", index << 16 | sub << 8 | 16)

    def write_beside(_objects: SdoObjects, index: int, sub: int) -> None:
        parameters.write_objects([ObjectValue(0x6072, 0, "uint16", 7), ObjectValue(index, sub, "uint16", 1)])

    ranges = [(lock.first, lock.last, lock.subindex) for lock in (*ALWAYS, *load_profile(name).never_write)]
    for place in [(i, 1 if s is None else s) for first, last, s in ranges for i in {first, last}] + [(i, 0) for i in SHEET]:
        for write in (write_object, download, lend, map_it, write_beside):
            with pytest.raises(ObjectLocked, match=r"never written by beltcomm.*the maker's own tool") as caught:
                write(objects, *place)
            assert (caught.value.index, caught.value.subindex) == place
    written = [data for _, cob, data, _ in bus.sent if cob == 0x601 and data[0] & 0xE0 == 0x20]
    assert written == []  # not even the harmless object beside the locked one


def test_a_profile_with_a_word_that_none_has_is_not_taken(tmp_path):
    text = find_config("drives", "cia402").read_text(encoding="utf-8")
    for name, broken in (
        ("confidence is 'sure'; give one of read", text.replace("confidence: read}", "confidence: sure}", 1)),
        ("gain_meaning is none exactly where", text.replace("gain_meaning: none", "gain_meaning: documented")),
        ("colour is no field of a profile", text + "colour: red\n"),
    ):
        path = tmp_path / "broken.yaml"
        path.write_text(broken, encoding="utf-8")
        load_profile.cache_clear()
        with pytest.raises(UsageError, match=f"cannot be used.*{name}"):
            load_profile(str(path))


def test_a_profile_that_cannot_be_used_is_not_shown_as_if_it_could(tmp_path):
    path = tmp_path / "acme.yaml"
    path.write_text("name: acme\ntitle: Acme X-Servo 7\nmodse: {torque: 10}\n", encoding="utf-8")
    shown = CliRunner().invoke(cli, ["drives", "--profile", str(path)])
    assert shown.exit_code == 2
    assert "line 3: modse is no field of a profile, did you mean modes?" in shown.output


def test_a_drive_without_a_canopen_port_says_so():
    with pytest.raises(UsageError, match="no CANopen port"):
        choose_profile({}, "cmmt")


def test_the_slow_sync_of_the_cmms_is_the_period_and_the_claim():
    """F3 p152: 6.4 ms; 0.35 of 156 Hz are 55 Hz."""
    node = StubNode()
    node.objects |= {(0x6093, 1): ("<I", 1), (0x6093, 2): ("<I", 1), (0x6094, 1): ("<I", 0x1000), (0x6094, 2): ("<I", 1)}
    node.objects |= {(0x6097, 1): ("<I", 0x100), (0x6097, 2): ("<I", 1), (0x6510, 0x10): ("<H", 2), (0x6510, 0xB1): ("<I", 400)}
    node.objects |= {(0x2000, 1): ("<I", 1), (0x60FB, 4): ("<I", 500), (0x60FB, 5): ("<I", 2)}
    node.objects |= {(0x60F9, 1): ("<H", 256), (0x60F9, 2): ("<H", 2000), (0x60F9, 4): ("<H", 400), (0x60FB, 1): ("<H", 102)}
    del node.objects[0x60C2, 1]  # a drive that does not tell its period
    bus = StubBus(node)
    with connect(bus, bus.clock, 1, "cmms-as", 1_000_000, bus.shutdown) as drive:
        assert drive.capabilities.sample_period_s == pytest.approx(6.4e-3)
        assert drive.capabilities.uncalibrated == {"kp_nm_s_rad", "ki_nm_rad", "kpp_1_s"}
        assert "A SYNC every 6.4 ms" in drive.capabilities.exchange
        assert 0.35 / drive.capabilities.sample_period_s == pytest.approx(54.7, abs=0.1)
    assert (node.get(0x6094, 1), node.get(0x6510, 0x10)) == (0x1000, 2)  # the factor group is restored


def test_what_is_lent_is_backed_up_and_rolled_back_as_it_was_found():
    node = StubNode()
    node.objects |= {(0x6093, 1): ("<I", 1), (0x6093, 2): ("<I", 1), (0x6094, 1): ("<I", 0x1000), (0x6094, 2): ("<I", 1)}
    node.objects |= {(0x6097, 1): ("<I", 0x100), (0x6097, 2): ("<I", 1), (0x6510, 0x10): ("<H", 1), (0x6510, 0xB1): ("<I", 400)}
    node.objects |= {(0x2000, 1): ("<I", 1), (0x60FB, 4): ("<I", 500), (0x60FB, 5): ("<I", 2)}
    node.objects |= {(0x60F9, 1): ("<H", 256), (0x60F9, 2): ("<H", 2000), (0x60F9, 4): ("<H", 400), (0x60FB, 1): ("<H", 102)}
    bus = StubBus(node)
    with connect(bus, bus.clock, 1, "cmmp-as", None, bus.shutdown) as drive:
        kept = {item.title: item.raw for item in drive.objects()}
        assert (kept["6094h:1"], kept["6510h:10h"], kept["60F9h:1"]) == (0x1000, 1, 256)
        assert node.get(0x6094, 1) == 1
        drive.write_objects([ObjectValue(0x6094, 1, "uint32", 0x800)])
        assert node.get(0x6094, 1) == 1  # lent until the end
        assert drive.read_objects([(0x6094, 1, "uint32"), (0x5555, 0, "uint8")]) == [0x800, None]
    assert node.get(0x6094, 1) == 0x800


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("index: 0x60F9, subindex: 1", "index: 0x60FF, subindex: 0", "60FFh, where no drive has a setting"),
        ("index: 0x60F9, subindex: 1", "index: 0x6040, subindex: 0", "6040h, where no drive has a setting"),
        ("index: 0x60F9, subindex: 1", "index: 0x60F6, subindex: 1", "60F6h:1, which holds gains of the current controller"),
        ("index: 0x60F9, subindex: 1", "index: 0x60F9, subindex: 2", "as another parameter"),
        ("index: 0x60F9, subindex: 1", "index: 0x60F9, subindex: 257", "parameters.kp_nm_s_rad.subindex is 257; give a subindex"),
        ("highest: 16384}     # 0", "highest: 1638400}     # 0", "range"),
        ("scale: 7.8125e-5", "scale: .nan", "parameters.kp_nm_s_rad.scale is nan"),
        ("enable_logic: {index: 0x6510, subindex: 0x10", "enable_logic: {index: 0x6060, subindex: 0", "6060h before anybody is asked"),
        ("torque: 4,", "torque: 3,", "modes.torque is 3; give mode 4 or 10"),
        ("velocity: 3}", "velocity: 3, sideways: 3}", "modes.sideways is no field of a profile"),
        ("shortest_ms: 1,", "shortest_ms: 1e-9,", "sync.shortest_ms is 1e-09; give ms, 0.05 to 100"),
        ("guarding: node_guarding", "guarding: none_at_all", "guarding is 'none_at_all'"),
        ("reference_filter: false", "reference_filter: 7", "structure.reference_filter is 7; give true or false"),
        ("torque_limit_lowest_permille: 1000", "torque_limit_lowest_permille: 65535", "torque_limit_lowest_permille is 65535"),
        ("torque_slope_permille_s: 0x0E310F94", "torque_slope_permille_s: 0xFFFFFFFFFF", "torque_slope_permille_s is 1099511627775"),
        (
            "overload_time: {index: 0x6410, subindex: 3}",
            "overload_time: {index: 0x16410, subindex: 3}",
            "overload_time.index is 91152; give an index of the object dictionary",
        ),
        ("{index: 0x60FD, bits", "{index: sixty, bits", "signals.enable_inputs.index is 'sixty'"),
    ],
)
def test_a_stranger_s_profile_writes_settings_only(tmp_path, old, new, words):
    text = find_config("drives", "cmmp-as").read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "cmmp-as.yaml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    load_profile.cache_clear()
    with pytest.raises(UsageError, match=re.escape(words)):
        load_profile(str(path))
    path.write_text(text, encoding="utf-8")
    load_profile.cache_clear()
    assert load_profile(str(path)).enable_logic == load_profile("cmmp-as").enable_logic


def leaves(group: FieldGroup, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    for key, node in group.fields.items():
        if key in GAIN_NAMES[1:]:  # as the first
            continue
        here = (*path, "thing" if key == "*" else key)
        if isinstance(node, FieldGroup):
            yield from leaves(node, here)
        elif isinstance(node, FieldRows):
            yield from leaves(node.row, (*here, "0"))
        else:
            yield here


@pytest.mark.parametrize("path", list(leaves(PROFILE)), ids=".".join)
def test_each_field_of_a_profile_is_checked_with_a_sentence(tmp_path, path):
    """What no field can be: a mapping where a value stands, and a value of another kind."""
    for wrong in ({"a": 1}, [[1, 2]], math.inf):
        value: Any = wrong
        for key in reversed(path[1:]):
            value = [value] if key == "0" else {key: value}
        file = tmp_path / "mine.yaml"
        file.write_text(to_yaml({"name": "mine", "title": "mine", path[0]: value}), encoding="utf-8")
        load_profile.cache_clear()
        with pytest.raises(UsageError, match=rf"mine\.yaml cannot be used: line \d+: .*{re.escape(path[-1])} is .*; give "):
            load_profile(str(file))


def test_a_profile_of_one_s_own_needs_no_more_than_what_is_special(tmp_path):
    file = tmp_path / "acme.yaml"
    file.write_text("name: acme\ntitle: Acme X\nmodes: {torque: 4}\nstructure: {prefilters: [none, notch]}\n", encoding="utf-8")
    load_profile.cache_clear()
    found, like = load_profile(str(file)), load_profile("cia402")
    assert found.modes == {**like.modes, "torque": 4}
    assert found.structure["prefilters"] == ["none", "notch"]
    assert found.structure["velocity_feedforward"] is True
    assert found.sources["modes"]["source"] == "this file"
    assert found.match is None


@pytest.mark.parametrize("name", config_names("drives"))
def test_a_shipped_profile_says_field_by_field_where_it_is_from(name):
    raw = read_yaml(find_config("drives", name))
    assert not list(faults(raw))
    assert set(raw) - UNSOURCED - {"sources"} <= set(raw["sources"]) | ({"parameters"} if not raw["parameters"] else set())
