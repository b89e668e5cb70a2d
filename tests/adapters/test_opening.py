"""From a drive's name to a connected drive: addresses, profiles, units, and the sentences when it fails."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from adapters.stub_node import COUNTS_PER_RAD, StubBus, StubNode
from beltcomm.configfiles import find_config, read_yaml, to_yaml, write_text
from beltcomm.drive import find_adapters, open_drive
from beltcomm.errors import BusError, DriveError, UsageError
from beltcomm_adapters.buses import Address
from beltcomm_adapters.canopen import connect
from beltcomm_adapters.link import Link
from beltcomm_adapters.profiles import choose_profile, load_profile
from beltcomm_adapters.scaling import read_scaling
from beltcomm_adapters.sdo import Lending, SdoObjects


@pytest.mark.parametrize(
    ("text", "interface", "channel"),
    [
        ("can0", "socketcan", "can0"),
        ("vcan1", "socketcan", "vcan1"),
        ("/dev/ttyACM0", "slcan", "/dev/ttyACM0"),
        ("COM3", "slcan", "COM3"),
        ("socket://host:2000", "slcan", "socket://host:2000"),
        ("pcan:PCAN_USBBUS1", "pcan", "PCAN_USBBUS1"),
    ],
)
def test_addresses(text, interface, channel):
    assert Address.parse(text) == Address(interface, channel)


@pytest.mark.parametrize("text", ["", "can", "cannon:1", "pcan:", "ttyACM0"])
def test_what_is_no_address_says_what_is(text):
    with pytest.raises(UsageError, match="write can0"):
        Address.parse(text)


def test_adapters_register_their_schemes():
    schemes = {scheme for item in find_adapters() if item.adapter for scheme in item.adapter.schemes}
    assert {"can", "slcan", "serial"} <= schemes


def test_an_interface_that_is_missing_says_how_to_bring_it_up():
    with pytest.raises(BusError, match=r"vcan97 cannot be opened.*(ip link set vcan97 up|kernel has no CAN)"):
        open_drive("vcan97")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"colour": 1}, "no option colour; it has node, bitrate, profile, sample_period"),
        ({"node": 200}, "node must be a whole number from 1 to 126"),
        ({"node": "one"}, "node must be"),
        ({"bitrate": 5}, "bitrate must be"),
    ],
)
def test_options_are_checked(options, words):
    with pytest.raises(UsageError, match=words):
        open_drive("can0", options)


def _connect(*nodes: StubNode, node: int | None = None, profile: str | None = None):
    bus = StubBus(*nodes)
    return connect(bus, bus.clock, node, profile, 1_000_000, bus.shutdown)


def test_an_empty_bus_says_so_with_its_bit_rate():
    with pytest.raises(BusError, match="no node answers on stub bus at 1000 kbit/s"):
        _connect()


def test_a_missing_node_is_named():
    with pytest.raises(BusError, match="no drive answers on stub bus, node 7, 1000 kbit/s"):
        _connect(StubNode(), node=7)


def test_a_connected_drive_tells_what_it_is():
    with _connect(StubNode()) as drive:
        capabilities = drive.capabilities
        assert capabilities.kinds == {"torque", "position", "velocity"}  # 6502h = 3A0h: 6, 8, 9, 10
        assert capabilities.rated_torque_nm == 1.0
        assert capabilities.peak_torque_nm == 3.0
        assert capabilities.max_speed_rad_s == pytest.approx(6000 * 2 * math.pi / 60)
        assert capabilities.identity["vendor_id"] == str(0x99)
        assert not capabilities.referenced
        with pytest.raises(UsageError, match="no quantity x; it has position_rad"):
            drive.read(["x"])


def test_a_plant_file_may_state_another_motor(tmp_path):
    path = tmp_path / "large.yaml"
    plant = read_yaml(find_config("plants", "g_b"))
    nameplate = {"rated_torque_nm": 22.0, "peak_torque_nm": 60.0, "rated_current_a": 30.0}
    write_text(path, to_yaml({**plant, "drive": {**plant["drive"], **nameplate}}))
    with open_drive(f"virtual:{path}") as drive:
        found = drive.capabilities
    assert (found.rated_torque_nm, found.rated_current_a) == (22.0, 30.0)
    assert found.peak_torque_nm == pytest.approx(60.0, rel=1e-3)
    write_text(path, to_yaml({**plant, "drive": {"rated_torque_nm": -1.0}}))
    with pytest.raises(UsageError, match=r"rated_torque_nm is -1 \(rated torque of the motor\); it must be above 0"):
        open_drive(f"virtual:{path}")


def test_a_failing_connect_releases_the_bus_and_gives_back_what_it_took():
    node = StubNode()
    node.put(0x6076, 0, 0)
    bus, released = StubBus(node), []
    with pytest.raises(DriveError, match="no rated torque \\(6076h is 0\\)"):
        connect(bus, bus.clock, 1, None, None, lambda: released.append(bus.shutdown()))
    assert released == [None]


def test_profiles_are_chosen_by_identity():
    assert choose_profile({"vendor_id": "29", "device_name": "CMMP-AS-C5-11A"}, None).name == "cmmp-as"
    assert choose_profile({"vendor_id": "0", "product_code": "1", "device_name": "beltcomm reference drive"}, None).name == "reference"
    assert choose_profile({"vendor_id": "29", "device_name": "CMMT"}, None).name == "cia402"
    assert choose_profile({}, None).name == "cia402"
    assert choose_profile({}, "cmmp-as").name == "cmmp-as"
    with pytest.raises(UsageError, match="cmmpas"):
        choose_profile({}, "cmmpas")


def _units(**values: int) -> StubNode:
    node = StubNode()
    for key, value in values.items():
        index, _, sub = key[1:].partition("_")
        node.objects[int(index, 16), int(sub or 0)] = ("<I", value)
    return node


def _scaling(node: StubNode, profile: str):
    with StubBus(node) as bus:
        objects = SdoObjects(Link(bus, bus.clock, 1))
        with objects.lend() as lending:
            return read_scaling(objects, load_profile(profile), lending)


def test_cia402_units_follow_feed_and_gear():
    # 131072 counts, 3:1 gear, 3600 units per turn of the output: 1200 units per motor turn
    node = _units(x608F_1=131072, x608F_2=1, x6091_1=3, x6091_2=1, x6092_1=3600, x6092_2=1)
    scaling = _scaling(node, "cia402")
    assert scaling.counts_per_rev == 131072
    assert scaling.position_rad == pytest.approx(2 * math.pi / 1200)
    assert scaling.speed_rad_s == scaling.position_rad
    node.objects[0x60A9, 0] = ("<I", 0x00B44700)
    assert _scaling(node, "cia402").speed_rad_s == pytest.approx(2 * math.pi / 60)
    node.put(0x60A9, 0, 0x12345678)
    with pytest.raises(DriveError, match="60A9h = 12345678h"):
        _scaling(node, "cia402")


def test_the_factor_group_is_read_and_the_speed_unit_refined_for_a_while():
    node = _units(x6093_1=1, x6093_2=2, x6094_1=0x1000, x6094_2=1, x6097_1=0x100, x6097_2=1)
    scaling = _scaling(node, "cmmp-as")
    assert scaling.position_rad == pytest.approx(math.pi / 65536)
    assert scaling.speed_rad_s == pytest.approx(2 * math.pi / 60 / 4096)
    assert scaling.acceleration_rad_s2 == pytest.approx(2 * math.pi / 60)
    assert node.written == [(0x6094, 1, 1), (0x6094, 1, 0x1000)]
    node.put(0x6093, 2, 0)
    with pytest.raises(DriveError, match="6093h is 1/0"):
        _scaling(node, "cmmp-as")


def test_what_is_lent_unchanged_is_given_back_where_it_changed_later_or_is_owed_otherwise():
    """By another change, by whoever writes it afterwards, or by a promise; and not written where nothing happened to it."""
    held = {(0x6510, 0x10): 2.0, (0x6094, 1): 1.0, (0x6072, 0): 7.0, (0x6080, 0): 5.0}
    written: list[tuple[int, int, float]] = []

    def write(index: int, subindex: int, _kind: str, value: float) -> None:
        held[index, subindex] = value
        written.append((index, subindex, value))

    objects = SimpleNamespace(read=lambda index, subindex, _kind: held[index, subindex], write=write)
    with Lending(objects) as lending:
        for place in list(held):
            lending.set(*place, "uint16", held[place], keep=True)
        lending.set(0x6094, 1, "uint16", 9.0)
        lending.keep(0x6072, 0, "uint16")
        objects.write(0x6072, 0, "uint16", 3.0)
        assert lending.promise(0x6080, 0, 6.0)
    assert held == {(0x6510, 0x10): 2.0, (0x6094, 1): 1.0, (0x6072, 0): 7.0, (0x6080, 0): 6.0}
    assert not [index for index, *_ in written if index == 0x6510]


def test_two_drives_with_one_number_are_not_opened():
    """Both would move; each answers every question.  An adapter that doubles a frame now and then is none."""
    nodes = StubNode(), StubNode()
    nodes[1].put(0x6064, 0, 4711)
    bus = StubBus(*nodes)
    with pytest.raises(DriveError, match=r"two drives have this node number.*give it another number"):
        connect(bus, bus.clock, 1, None, None, bus.shutdown)


def test_frames_that_come_twice_now_and_then_are_no_second_drive():
    class Doubling(StubNode):
        def receive(self, frame, now_s):
            before = len(self.out)
            super().receive(frame, now_s)
            self.heard = getattr(self, "heard", 0) + 1
            if self.heard % 4 == 0:
                self.out.extend(list(self.out)[before:])

    node = Doubling()
    node.put(0x6064, 0, 4711)
    bus = StubBus(node)
    with connect(bus, bus.clock, 1, None, None, bus.shutdown) as drive:
        assert drive.read(["position_rad"])["position_rad"] == pytest.approx(4711 / COUNTS_PER_RAD)
    assert node.heard >= 8, "at least two of them came twice"
