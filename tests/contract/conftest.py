"""Every contract test runs on both profiles of the virtual drive, on its bus and on its RS-232 port, on the adapter that
docs/adapter-guide.md shows, and on the drive of ``--drive``."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from beltcomm.drive import Drive, Limits, open_drive


class RigidPlant:
    """An inertia with viscous friction, solved exactly:  J dω/dt = τ - d ω.

    A :class:`beltcomm.plant.Plant`.   inertia_kg_m2 : J.   viscous_nm_s_rad : d, so that J/d is 0.4 s.
    """

    def __init__(self, inertia_kg_m2: float = 2e-3) -> None:
        self.inertia_kg_m2 = inertia_kg_m2
        self.viscous_nm_s_rad = inertia_kg_m2 / 0.4
        self.position_rad = self.velocity_rad_s = self.cart_position_m = self.belt_force_n = 0.0

    def step(self, torque_nm: float, duration_s: float) -> None:
        decay = math.exp(-self.viscous_nm_s_rad / self.inertia_kg_m2 * duration_s)
        end_rad_s = torque_nm / self.viscous_nm_s_rad
        before = self.velocity_rad_s
        self.velocity_rad_s = end_rad_s + (before - end_rad_s) * decay
        self.position_rad += end_rad_s * duration_s + (before - end_rad_s) * (1 - decay) * self.inertia_kg_m2 / self.viscous_nm_s_rad


@dataclass
class Machine:
    """A drive under test, and what it may do.   plant : the machine behind a virtual drive, None on hardware."""

    drive: Drive
    limits: Limits
    plant: RigidPlant | None

    @property
    def period_s(self) -> float:
        return self.drive.capabilities.sample_period_s


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "machine" in metafunc.fixturenames:
        names = ["virtual-reference", "virtual-cmmp-as", "serial:virtual-reference", "serial:virtual-cmmp-as", "example"]
        if real := metafunc.config.getoption("--drive"):
            names.append(real)
        metafunc.parametrize("machine", names, indirect=True)


def open_virtual(profile: str, plant: RigidPlant | None = None, name: str = "virtual", **options: Any) -> Machine:
    plant = plant or RigidPlant()
    drive = open_drive(name, {"profile": profile, "plant": plant, "seed": 1, "referenced": False, **options})
    drive.calibrate({name: drive.capabilities.parameters[name].scale for name in drive.capabilities.uncalibrated})  # as the profile says
    # velocity loop of 100 rad/s: the factory's gains could neither follow with this inertia nor brake it
    kp = 100.0 * plant.inertia_kg_m2
    drive.write({"kp_nm_s_rad": kp, "ki_nm_rad": 32.0 * kp, "kpp_1_s": 20.0})
    here = drive.read(["position_rad"])["position_rad"]
    return Machine(drive, Limits(here - 30.0, here + 30.0, 100.0, 1.5), plant)


def _open_example() -> Machine:
    """The drive of the adapter guide, found in the guide's own file: it belongs to no installed package."""
    spec = importlib.util.spec_from_file_location("example_drive", Path(__file__).parents[2] / "docs" / "example_drive.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    plant = RigidPlant()
    drive = module.ADAPTER.open("", {"plant": plant})
    kp = 100.0 * plant.inertia_kg_m2
    drive.write({"kp_nm_s_rad": kp, "ki_nm_rad": 32.0 * kp, "kpp_1_s": 20.0})
    return Machine(drive, Limits(-30.0, 30.0, 100.0, 1.5), plant)


def _open_real(config: pytest.Config, name: str) -> Machine:
    window = config.getoption("--drive-window-rad")
    speed, torque = config.getoption("--drive-speed-rad-s"), config.getoption("--drive-torque-nm")
    if None in (window, speed, torque):
        pytest.exit("--drive needs --drive-window-rad, --drive-speed-rad-s and --drive-torque-nm", returncode=2)
    options = dict(item.split("=", 1) for item in config.getoption("--drive-option"))
    return Machine(open_drive(name, options), Limits(*window, speed, torque), None)


@pytest.fixture
def machine(request: pytest.FixtureRequest) -> Iterator[Machine]:
    name: str = request.param
    drive, virtual, profile = name.partition("virtual-")
    if name == "example":
        machine = _open_example()
    else:
        machine = open_virtual(profile, name=f"{drive}virtual") if virtual else _open_real(request.config, name)
    with machine.drive:
        yield machine
