"""The drives of other makers: each file, its units against the machine, what it refuses; by bare frames."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from beltcomm.configfiles import config_names
from beltcomm.errors import UsageError
from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.cia402 import DriveState
from beltcomm.virtual.foreign import profile_named
from virtual.host import Abort, Host, RigidPlant

MakeHost = Callable[..., Host]
NAMES = config_names("slaves")
PATIENCE_S = 0.5


class PatientHost(Host):
    """Waits for slow answers."""

    def ask(self, request: bytes) -> bytes:
        self.frames()
        self.send(0x601, request)
        end = self.bus.clock.now() + PATIENCE_S
        while self.bus.clock.now() < end:
            if answers := self.of(0x581):
                return answers[0]
            self.run(0.001)
        raise AssertionError("no answer")

    def switch_on(self) -> None:
        if self.drive.objects.has(0x6510, 0x10):
            self.write(0x6510, 0x10, 2, "H")
        for word in (0x06, 0x0F):
            self.write(0x6040, 0, word, "H")
            self.run(0.4)


def played(name: str, **options: object) -> PatientHost:
    cycle_s = profile_named(name).cycle_s
    one = PatientHost(profile=name, bus=LockstepBus(ticks_per_second=round(1 / cycle_s)), **options)
    one.run(0.1)
    return one


def test_there_are_many_and_each_says_where_its_facts_are_from() -> None:
    from beltcomm.configfiles import find_config, read_yaml

    assert len(NAMES) >= 10
    for name in NAMES:
        facts = read_yaml(find_config("slaves", name))
        assert all(source[:3] in ("[R]", "[S]", "[M]") for source in facts["sources"]), name


@pytest.mark.parametrize("name", NAMES)
def test_it_is_a_node_that_can_be_switched_on(name: str) -> None:
    one = played(name)
    assert one.read(0x1000) == 0x00020192
    one.switch_on()
    assert one.state() == DriveState.OPERATION_ENABLED
    one.close()


@pytest.mark.parametrize("name", [n for n in NAMES if 3 in profile_named(n).modes])
def test_its_units_are_those_of_its_file(name: str) -> None:
    """Speed, place and acceleration that the machine really has, against what the objects say."""
    plant = RigidPlant(inertia_kg_m2=1e-3)
    one = played(name, plant=plant)
    units = profile_named(name).scaling(one.drive.objects, 65536)
    speed = float(np.random.default_rng(len(name)).uniform(4.0, 9.0))
    one.write(0x6060, 0, 3, "b")
    one.switch_on()
    one.write(0x60FF, 0, round(speed * units.velocity), "i")
    one.run(4.0)
    before, start = one.read(0x6064, code="i"), plant.position_rad
    one.run(0.2)
    told = one.read(0x606C, code="i") / units.velocity
    assert told == pytest.approx(plant.velocity_rad_s, rel=0.05, abs=1.5 / abs(units.velocity))
    moved = (one.read(0x6064, code="i") - before) / units.position
    assert moved == pytest.approx(plant.position_rad - start, abs=3.0 / abs(units.position) + 1e-3)
    one.close()


def test_an_acceleration_told_as_a_time() -> None:
    one = played("asda-a2")
    units = profile_named("asda-a2").scaling(one.drive.objects, 65536)
    assert units.acceleration_of(one.read(0x6083)) == pytest.approx(100 * math.tau)
    assert units.acceleration_of(one.read(0x6085)) == pytest.approx(200 * math.tau)


def test_a_fixed_mapping_is_refused_and_cannot_be_switched_off() -> None:
    one = played("faulhaber-mcbl")
    for index, subindex, code in ((0x1600, 0, "B"), (0x1600, 1, "I"), (0x1400, 1, "I")):
        with pytest.raises(Abort, match=str(0x06010002)):
            one.write(index, subindex, 0, code)
    one.write(0x1800, 2, 1, "B")  # the type can be set while it is valid
    one.operational()
    one.send(0x80)
    assert one.of(0x181) == [struct.pack("<H", one.status)]


def test_what_a_drive_has_not_is_no_object() -> None:
    one = played("epos4")
    for index in (0x6072, 0x6075, 0x608F, 0x6092):
        with pytest.raises(Abort, match=str(0x06020000)):
            one.read(index)
    with pytest.raises(Abort, match=str(0x06020000)):
        one.write(0x1A00, 0, 0, "B") if one.write(0x1800, 1, 0xC0000181, "I") else one.map(1, False, [0x60740010])


def test_a_rated_torque_in_micro_newton_metres() -> None:
    assert played("epos4").read(0x6076) == 1_430_000


def test_a_finer_velocity_by_the_prefix_of_its_unit() -> None:
    one = played("epos4")
    coarse = profile_named("epos4").scaling(one.drive.objects, 65536).velocity
    one.write(0x60A9, 0, 0xFDB44700, "I")
    assert profile_named("epos4").scaling(one.drive.objects, 65536).velocity == pytest.approx(1000 * coarse)


def test_slow_answers() -> None:
    one = played("bare")
    begun = one.bus.clock.now()
    one.read(0x1000)
    assert one.bus.clock.now() - begun == pytest.approx(0.3, abs=0.01)


def test_the_cycle_of_a_cmms_as() -> None:
    one = played("cmms-as")
    assert (one.read(0x60C2, 1), one.read(0x60C2, 2, "b"), one.read(0x6510, 0xB0)) == (64, -4, 400)
    assert one.drive.sync_ticks == 2.5, "a millisecond, until PDOs are exchanged"
    one.operational()
    assert one.drive.sync_ticks == 16


@pytest.mark.parametrize(
    "text",
    [
        "modes: 3",
        "name: x\nvendor: 1\nproduct: 1\nunits: {velocity: knots}",
        "colour: red",
        "name: x\nvendor: 1\nproduct: 1\nloop: {kp: 3}",
    ],
)
def test_a_file_that_describes_no_drive(tmp_path: Path, text: str) -> None:
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(UsageError, match=r"mine\.yaml"):
        Host(profile=str(tmp_path / "mine.yaml"))
