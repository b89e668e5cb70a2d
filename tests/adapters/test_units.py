"""Units of a drive: whatever factor group it tells, a value that is written and read back means the same to within its resolution."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest

from beltcomm.drive import KnownMotor, Limits, Motion
from beltcomm.errors import DriveError
from beltcomm_adapters.consistency import SpeedUnit
from beltcomm_adapters.link import Link
from beltcomm_adapters.preparation import lend_settings, quick_stop_rad_s2, tighten_window
from beltcomm_adapters.profiles import load_profile
from beltcomm_adapters.scaling import Scaling, read_scaling
from beltcomm_adapters.sdo import SdoObjects
from beltcomm_adapters.serial_run import prepare
from beltcomm_adapters.units import coded, named
from tests.adapters.stub_node import StubBus, StubNode

TURN = 2.0 * math.pi
PLATE = KnownMotor(rated_torque_nm=1.43, peak_torque_nm=3.1, torque_constant_nm_a=0.65, max_speed_rad_s=400.0, counts_per_rev=65536)
#: Unit objects as makers have them, and one raw number of each in SI, by hand.
SPEEDS = {0x00B44700: TURN / 60, 0xFDB44700: 1e-3 * TURN / 60, 0x00B40300: TURN, 0xFF410300: 0.1 * TURN / 360, 0x00C00000: TURN / 60}
ACCELERATIONS = {0x00C00300: TURN / 60, 0x00B44703: TURN / 60, 0x00B45700: TURN, 0x00105700: 1.0, 0xFD105700: 1e-3}


def scaling_of(node: StubNode, plate: KnownMotor | None = None, profile: str = "cia402") -> Scaling:
    with StubBus(node) as bus:
        return read_scaling(SdoObjects(Link(bus, bus.clock, 1)), load_profile(profile), None, plate)


def drawn(random: np.random.Generator) -> tuple[StubNode, float, float, float]:
    """A drive with factors of its own; rad, rad/s and rad/s² of one raw number, worked out here."""
    node = StubNode()
    counts, gear = int(random.integers(1000, 2**22)), (int(random.integers(1, 12)), int(random.integers(1, 12)))
    feed = (int(random.integers(100, 10**6)), int(random.integers(1, 9)))
    for index, (a, b) in {0x608F: (counts, 1), 0x6091: gear, 0x6092: feed}.items():
        node.objects[index, 1], node.objects[index, 2] = ("<I", a), ("<I", b)
    position = TURN * gear[0] / gear[1] / (feed[0] / feed[1])
    speed = acceleration = position
    if random.random() < 0.7:
        code = int(random.choice(list(SPEEDS)))
        node.objects[0x60A9, 0] = ("<I", code)
        speed = acceleration = SPEEDS[code]
    if random.random() < 0.7:
        code = int(random.choice(list(ACCELERATIONS)))
        node.objects[0x60AA, 0] = ("<I", code)
        acceleration = ACCELERATIONS[code]
    return node, position, speed, acceleration


@pytest.mark.parametrize("seed", range(12))
def test_a_drawn_factor_group_is_decoded_and_a_stop_is_as_steep_as_meant(seed: int) -> None:
    random = np.random.default_rng(seed)
    node, position, speed, acceleration = drawn(random)
    own = max(1, round(300.0 / acceleration))
    node.objects |= {(0x6085, 0): ("<I", own), (0x6065, 0): ("<I", 2000)}
    found = scaling_of(node)
    assert found.position_rad == pytest.approx(position, rel=1e-12)
    assert found.speed_rad_s == pytest.approx(speed, rel=1e-12)
    assert found.acceleration_rad_s2 == pytest.approx(acceleration, rel=1e-12)
    meant = float(random.uniform(50.0, 3000.0))
    limits = Limits(-1e3, 1e3, 100.0, 0.5, meant, 1.0)
    with StubBus(node) as bus:
        objects = SdoObjects(Link(bus, bus.clock, 1))
        with objects.lend() as lending:
            lend_settings(objects, lending, load_profile("cia402"), found, 8, 1e-3, limits)
            written = node.get(0x6085) * acceleration
            assert written <= meant * (1.0 + 1e-9)  # never steeper
            assert written > meant - 1.001 * acceleration or node.get(0x6085) == 1
            assert abs(node.get(0x607D, 1) * position + 1e3) < 1e3  # around the window, and the way of a stop
            assert not lending.altered
        assert node.get(0x6085) == own


def test_a_quick_stop_in_a_unit_that_nobody_tells_and_that_makes_no_sense_is_left_alone() -> None:
    """250 ms to 3000 rpm, read as counts/s²: a stop from 100 rad/s would take hours, so that cannot be the unit."""
    node = StubNode()
    node.objects[0x6085, 0] = ("<I", 250)
    found = scaling_of(node)
    assert not found.acceleration_told
    with StubBus(node) as bus:
        objects = SdoObjects(Link(bus, bus.clock, 1))
        with objects.lend() as lending:
            lend_settings(objects, lending, load_profile("cia402"), found, 8, 1e-3, Limits(-1e3, 1e3, 100.0, 0.5, 500.0, 1.0))
            assert node.get(0x6085) == 250
            assert any("6085h (quick stop) stays as it is set there, 250" in text for text in lending.altered)


@pytest.mark.parametrize(("mode", "leaving", "ramp"), [(4, "velocity", 0x6084), (3, "quick_stop", 0x6083)])
def test_no_ramp_is_written_in_a_unit_that_makes_no_sense(mode: int, leaving: Literal["quick_stop", "velocity"], ramp: int) -> None:
    """An axis that leaves torque mode along 6084h would brake for hours, too, and one that follows a speed would not follow it."""
    node = StubNode()
    node.objects |= {(0x6085, 0): ("<I", 250), (ramp, 0): ("<I", 300)}
    found, profile = scaling_of(node), replace(load_profile("cia402"), torque_exit=leaving)
    with StubBus(node) as bus:
        objects = SdoObjects(Link(bus, bus.clock, 1))
        with objects.lend() as lending:
            motion = Motion("velocity", 1e-3, np.zeros(3), np.array([0.0, 1.0, 0.0]), np.zeros(3))
            lend_settings(objects, lending, profile, found, mode, 1e-3, Limits(-1e3, 1e3, 100.0, 0.5, 500.0, 1.0), motion)
            assert node.get(ramp) == 300


@pytest.mark.parametrize("own", [0, 5_000_000])
def test_a_lead_that_the_drive_would_cut_is_refused(own: int) -> None:
    """Its software limits stand 1 rad outside the window; also where it has no quick stop's deceleration to count with."""
    node = StubNode()
    found = scaling_of(node)
    ends = [round(at / found.position_rad) for at in (-11.0, 11.0)]
    node.objects |= {(0x6085, 0): ("<I", own), (0x607D, 1): ("<i", ends[0]), (0x607D, 2): ("<i", ends[1])}
    limits = Limits(-10.0, 10.0, 100.0, 0.5, math.inf, 1.0)
    with StubBus(node) as bus:
        objects = SdoObjects(Link(bus, bus.clock, 1))
        with objects.lend() as lending:
            tighten_window(objects, lending, found, limits, 1e-3, (-10.9, 2.0))
            assert (node.get(0x607D, 1), node.get(0x607D, 2)) == tuple(ends)
            with pytest.raises(DriveError, match="would cut it"):
                tighten_window(objects, lending, found, limits, 1e-3, (-2.0, 11.1))


def test_a_large_lead_inside_the_window_is_no_reason_to_refuse() -> None:
    """Only where the reference goes counts: one that leads by 5 rad in the middle of the travel is never cut."""
    node = StubNode()
    found = scaling_of(node)
    ends = [round(at / found.position_rad) for at in (-11.0, 11.0)]
    node.objects |= {(0x6085, 0): ("<I", 5_000_000), (0x607D, 1): ("<i", ends[0]), (0x607D, 2): ("<i", ends[1])}
    path = np.linspace(-3.0, 3.0, 100)
    motion = Motion("position", 1e-3, path, np.zeros(100), np.zeros(100), lead_rad=5.0 * np.sin(np.pi * np.linspace(0.0, 1.0, 100)))
    with StubBus(node) as bus:
        objects = SdoObjects(Link(bus, bus.clock, 1))
        with objects.lend() as lending:
            tighten_window(objects, lending, found, Limits(-10.0, 10.0, 100.0, 0.5, math.inf, 1.0), 1e-3, motion.reach_rad)
            low, high = node.get(0x607D, 1) * found.position_rad, node.get(0x607D, 2) * found.position_rad
            assert -11.0 <= low < -10.0
            assert 10.0 < high <= 11.0


@pytest.mark.parametrize(("takes", "rad_s2"), [(True, 500.0), (False, 120.0)])
def test_the_quick_stop_that_a_drive_really_has_is_told(takes: bool, rad_s2: float) -> None:
    """Refused, it stays as it is set there; nothing stays lent."""
    node = StubNode()
    found = scaling_of(node)
    own = round(120.0 / found.acceleration_rad_s2)
    node.objects[0x6085, 0] = ("<I", own)
    if not takes:
        node.refuse[0x6085, 0] = 0x06090030
    with StubBus(node) as bus:
        objects = SdoObjects(Link(bus, bus.clock, 1))
        told = quick_stop_rad_s2(objects, found, Limits(-1e3, 1e3, 100.0, 0.5, 500.0, 1.0))
    assert told == pytest.approx(rad_s2, rel=0.01)
    assert node.get(0x6085) == own


def test_no_stroke_is_told_in_a_unit_that_makes_no_sense() -> None:
    """Over RS-232 the drive makes the ramps of a stroke by itself, of a number that would mean something else."""
    node = StubNode()
    node.objects[0x6085, 0] = ("<I", 250)
    found = scaling_of(node)
    with StubBus(node) as bus:
        objects: Any = SdoObjects(Link(bus, bus.clock, 1))
        machine: Any = SimpleNamespace(confirm_mode=lambda mode: None)
        with objects.lend() as lending, pytest.raises(DriveError, match="state acceleration_unit"):
            prepare(objects, lending, machine, load_profile("cia402"), found, Limits(-1e3, 1e3, 100.0, 0.5, 500.0, 1.0), 0.02)


def test_codes_of_makers() -> None:
    for code, value in (SPEEDS | ACCELERATIONS).items():
        unit = coded(code)
        assert unit is not None
        assert unit.of == "rad"
        assert unit.value == pytest.approx(value)
    metre = coded(0xFD010300)
    assert metre is not None
    assert (metre.of, metre.per, metre.value) == ("m", 1, pytest.approx(1e-3))
    assert coded(0x12345678) is None


def test_units_by_name_are_read_as_they_are_written() -> None:
    assert named("0.1 rpm", 1).value == pytest.approx(0.1 * TURN / 60)
    assert named("10 counts/s2", 2) == named("10 counts/s/s", 2)
    assert named("16 units/ms", 1).value == pytest.approx(16e3)
    for text, per in (("rpm", 0), ("0.1 rpm", 2), ("furlongs/s", 1), ("rpm/x", 2), ("0 rpm", 1)):
        with pytest.raises(ValueError, match=r"is no|below the line"):
            named(text, per)


def test_lengths_rest_on_the_feed() -> None:
    node = StubNode()
    for index, sub, value in ((0x6091, 1, 1), (0x6091, 2, 1), (0x6092, 1, 78000), (0x6092, 2, 1)):
        node.objects[index, sub] = ("<I", value)
    node.objects |= {(0x60A8, 0): ("<I", 0xFA010000), (0x60A9, 0): ("<I", 0xFD010300), (0x60AA, 0): ("<I", 0xFD015700)}
    found = scaling_of(node)  # µm, mm/s, mm/s²; 78 mm a turn
    assert found.position_rad == pytest.approx(TURN / 78000)
    assert found.speed_rad_s == pytest.approx(TURN / 78)
    assert found.acceleration_rad_s2 == pytest.approx(TURN / 78)


def test_a_ramp_told_as_a_time_is_the_softer_the_larger() -> None:
    found = Scaling(1e-4, 1e-4, named("ms to 3000 rpm", 2).value, 1e-3, 65536, 1.0, 1.0, ramp=True)
    assert found.acceleration(100) == pytest.approx(3000 * TURN / 60 / 0.1)
    for meant in (50.0, 777.0, 3141.5):
        assert found.acceleration(found.raw_acceleration(meant)) <= meant * (1 + 1e-9)
        assert found.acceleration(found.raw_acceleration(meant, at_most=False)) >= meant * (1 - 1e-9)


def test_what_the_drive_does_not_tell_comes_from_the_axis_file_and_is_said() -> None:
    node = StubNode()
    for index in (0x6075, 0x6076, 0x608F):
        for sub in range(3):
            node.objects.pop((index, sub), None)
    with pytest.raises(DriveError, match=r"no rated torque \(6076h is missing\).*motor\.rated_torque_nm"):
        scaling_of(node)
    found = scaling_of(node, PLATE)
    assert (found.rated_torque_nm, found.counts_per_rev) == (1.43, 65536)
    assert found.rated_current_a == pytest.approx(2.2)
    assert [text.split(":")[0] for text in found.said] == [
        "the drive tells no rated torque (6076h)",
        "the drive tells no rated current (6075h)",
        "the drive has no 608Fh",
    ]


@pytest.mark.parametrize(("raw", "said"), [(1430, False), (1430000, True), (143, True), (1, True)])
def test_the_unit_of_the_rated_torque_is_told_by_the_axis_file(raw: int, said: bool) -> None:
    node = StubNode()
    node.put(0x6076, 0, raw)
    found = scaling_of(node, PLATE)
    assert found.rated_torque_nm == pytest.approx(1.43)
    assert any("6076h" in text for text in found.said) is said


@pytest.mark.parametrize(
    ("raw", "found_a", "said"), [(2200, 2.2, 0), (220, 2.2, 1), (22, 2.2, 2), (2, 2.2, 2), (3111, 3.111, 0), (7000, 7.0, 0)]
)
def test_the_unit_of_the_rated_current_is_told_by_the_axis_file(raw: int, found_a: float, said: int) -> None:
    """mA, 0.01 A, 0.1 A and A; what agrees with none, and peak amperes, are left to the check of the ratings, which refuses them."""
    node = StubNode()
    node.put(0x6075, 0, raw)
    found = scaling_of(node, PLATE)
    assert found.rated_current_a == pytest.approx(found_a)
    assert sum("6075h" in text for text in found.said) == said


def test_a_rated_torque_that_agrees_in_no_unit_is_taken_as_cia_402_says() -> None:
    node = StubNode()
    node.put(0x6076, 0, 14300)  # ten times: it may be 0.1 mN m, or a motor that was entered wrongly
    found = scaling_of(node, PLATE)
    assert (found.rated_torque_nm, found.said) == (14.3, scaling_of(StubNode(), PLATE).said)


def test_factors_as_from_the_factory_are_named() -> None:
    node = StubNode()
    for index in (0x608F, 0x6091, 0x6092):
        node.objects |= {(index, 1): ("<I", 1), (index, 2): ("<I", 1)}
    with pytest.raises(DriveError, match="as from the factory"):
        scaling_of(node)
    assert scaling_of(node, PLATE).position_rad == pytest.approx(TURN / 65536)


def test_a_drive_that_makes_a_ramp_steeper_is_not_moved() -> None:
    node = StubNode(stuck_objects={(0x6085, 0)})
    node.objects[0x6085, 0] = ("<I", 2**31)
    with StubBus(node) as bus:
        objects = SdoObjects(Link(bus, bus.clock, 1))
        with objects.lend() as lending, pytest.raises(DriveError, match=r"6085h was set to .* a stop would load the belt more"):
            lend_settings(objects, lending, load_profile("cia402"), scaling_of(node), 8, 1e-3, Limits(-1.0, 1.0, 1.0, 0.5, 100.0))


@pytest.mark.parametrize("unit", [TURN / 60, 0.1 * TURN / 60, TURN / 65536, 0.1 * TURN / 65536])
@pytest.mark.parametrize("seed", range(4))
def test_a_speed_that_nobody_tells_the_unit_of_is_told_by_the_way(unit: float, seed: int) -> None:
    """A motor that rings on its belt, a speed that the drive filters: neither makes another unit of it."""
    step, learner, random = TURN / 65536, SpeedUnit(TURN / 65536), np.random.default_rng(seed)
    assert learner.found_rad_s() is None
    lag_s, ringing, hertz = random.uniform(0.0, 5e-3), random.uniform(0.0, 8.0), random.uniform(60.0, 200.0)
    place = shown = 0.0
    for k in range(1200):
        speed = 6.0 * math.sin(math.pi * k / 400) + ringing * math.sin(TURN * hertz * 1e-3 * k)
        before, place = place, place + speed * 1e-3
        shown += 1e-3 / (lag_s + 1e-3) * (speed - shown)
        learner(round(place / step) - round(before / step), round((shown + random.normal(0.0, 0.05)) / unit), 1e-3)
    assert learner.found_rad_s() == pytest.approx(unit)


@pytest.mark.parametrize("damaged", [(60, 3), (10**6, 1)])
def test_one_damaged_stretch_does_not_spoil_the_unit_of_a_speed(damaged: tuple[int, int]) -> None:
    """What was refused is forgotten: the next way alone decides."""
    step = TURN / 65536
    learner = SpeedUnit(step)
    for _ in range(400):
        learner(*damaged, 1e-3)
    with pytest.raises(DriveError):
        learner.found_rad_s()
    assert learner.found_rad_s() is None
    learner(0, 0, 1.0)
    for _ in range(400):
        learner(60, 60_000, 1e-3)
    assert learner.found_rad_s() == pytest.approx(step)


def test_a_speed_in_no_unit_at_all_is_refused() -> None:
    learner = SpeedUnit(TURN / 65536)
    for _ in range(400):
        learner(60, 3, 1e-3)
    with pytest.raises(
        DriveError,
        match=r'no maker uses: .* one turn is about 1200000 position units .* position_unit: "8.333333333e-07 rev" and velocity_unit',
    ):
        learner.found_rad_s()
