"""Every drive profile: loads, says where each entry is from, locks what must not be written, and offers nothing of that as writable."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import beltcomm_adapters
from adapters.stub_node import StubBus, StubNode
from beltcomm.configfiles import config_names, find_config, read_yaml
from beltcomm.drive.objects import ObjectValue
from beltcomm.errors import ObjectLocked, UsageError
from beltcomm_adapters.canopen import connect
from beltcomm_adapters.gains import Parameters
from beltcomm_adapters.link import Link
from beltcomm_adapters.locks import ALWAYS
from beltcomm_adapters.profiles import CONFIDENCES, UNSOURCED, choose_profile, load_profile
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
    assert {place for place in places if locks.lock_of(*place)} == set()


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


def test_a_profile_without_a_source_is_not_taken(tmp_path):
    text = find_config("drives", "cia402").read_text(encoding="utf-8")
    for name, broken in (
        ("no source", re.sub(r"  guarding: \{source.*\n", "", text)),
        ("no source or no confidence", text.replace("confidence: read}", "confidence: sure}", 1)),
        ("gain_meaning", text.replace("gain_meaning: none", "gain_meaning: documented")),
        ("unexpected keyword", text + "colour: red\n"),
    ):
        path = tmp_path / "broken.yaml"
        path.write_text(broken, encoding="utf-8")
        load_profile.cache_clear()
        with pytest.raises(UsageError, match="cannot be used"):
            load_profile(str(path))
        assert name


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
        ("index: 0x60F9, subindex: 1", "index: 0x60F9, subindex: 257", "there is no object 24825, 257"),
        ("highest: 16384}     # 0", "highest: 1638400}     # 0", "range"),
        ("scale: 7.8125e-5", "scale: .nan", "scale of nan"),
        ("enable_logic: {index: 0x6510, subindex: 0x10", "enable_logic: {index: 0x6060, subindex: 0", "6060h before anybody is asked"),
        ("torque: 4,", "torque: 3,", "mode 3 for motions of kind 'torque'"),
        ("velocity: 3}", "velocity: 3, sideways: 3}", "mode 3 for motions of kind 'sideways'"),
        ("shortest_ms: 1,", "shortest_ms: 1e-9,", "sync of 1e-09 ms"),
        ("guarding: node_guarding", "guarding: none_at_all", "guarding is 'none_at_all'"),
        ("reference_filter: false", "reference_filter: 7", "the rest true or false"),
        ("torque_limit_lowest_permille: 1000", "torque_limit_lowest_permille: 65535", "torque_limit_lowest_permille is 65535"),
        ("torque_slope_permille_s: 0x0E310F94", "torque_slope_permille_s: 0xFFFFFFFFFF", "cannot be"),
        ("overload_time: {index: 0x6410, subindex: 3}", "overload_time: {index: 0x16410, subindex: 3}", "cannot be"),
        ("{index: 0x60FD, bits", "{index: sixty, bits", "cannot be used"),
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
