"""Machine time of a whole commissioning, and what it is worth, on axes of 0.3 m to 3 m with carriages of 0.4 kg to 40 kg.

Two build sizes: the belt and motor of the shipped rig, and one with eight times the feed force, a direct drive without a coupling.  The
belt's stiffness follows from its length,  k = EA (1/l1 + 1/(2 l3 - l1));  friction is a share of the feed force: the rig's for the small
size, a twentieth for the large one.  The truth goes into the virtual drive only; errors are told beside it.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from beltcomm import api
from beltcomm.api import Options
from beltcomm.axis import load_axis
from beltcomm.configfiles import to_yaml, write_text
from beltcomm.errors import BeltcommError
from beltcomm.model import load_plant
from benchmarks.speeds.measure import Figure

#: Travel, m, and carriage, kg, of the small and of the large build size.
SMALL = ((0.3, 0.4), (0.3, 5.0), (0.58, 13.4), (1.5, 1.0), (1.5, 8.0), (3.0, 0.4), (3.0, 10.0), (3.0, 13.4))
LARGE = ((0.3, 40.0), (1.0, 20.0), (3.0, 5.0), (3.0, 40.0))
QUICK_AIM_S = 20.0
#: What is asked of the whole job: mass, stiffness and inertia to a hundredth.
ACCURACY = 0.01
ASKED = ("cart.mass", "belt_stiffness.stiffness", "motor.inertia")


@dataclass(frozen=True)
class Size:
    """A build size.   radius_m : pulley.   inertia_kg_m2 : motor and pulley.   ea_n : belt.   force_n : feed force.

    friction : Coulomb friction over feed force.
    """

    name: str
    radius_m: float
    inertia_kg_m2: float
    ea_n: float
    force_n: float
    rated_nm: float
    peak_nm: float
    friction: float


SIZES = {
    "small": Size("small", 0.01242, 7.173e-5, 106250.0, 100.0, 1.43, 3.10, 0.093),
    "large": Size("large", 0.02865, 3.0e-3, 580000.0, 800.0, 22.0, 60.0, 0.05),
}


def written(size: Size, travel_m: float, mass_kg: float, folder: Path) -> tuple[Path, Path]:
    """Plant and axis file of one axis."""
    base, axis = load_plant("g_b").model, load_axis("egc-70-600").to_dict()
    distance = travel_m + 0.2
    l1 = 0.05 + 0.5 * travel_m
    stiffness = size.ea_n * (1.0 / l1 + 1.0 / (2.0 * distance - l1))
    values = {
        "motor.inertia": size.inertia_kg_m2,
        "cart.mass": mass_kg,
        "transmission.ratio": size.radius_m,
        "belt_stiffness.stiffness": stiffness,
        "belt_damping.damping": 0.02 * (stiffness * mass_kg) ** 0.5,
        "viscous.damping": base["viscous.damping"] * size.force_n * size.radius_m**2 / (100.0 * SIZES["small"].radius_m ** 2),
        "coulomb.level": 0.7 * size.friction * size.force_n * size.radius_m,
        "cart_friction.level": 0.3 * size.friction * size.force_n,
    }
    nameplate = {"rated_torque_nm": size.rated_nm, "peak_torque_nm": size.peak_nm, "rated_current_a": size.rated_nm / 0.65}
    drive = {"setpoint_delay_s": 0.001, "torque_noise_nm": 0.006 * size.rated_nm / 1.43, "counts_per_rev": 65536, **nameplate}
    plant, sheet = folder / "plant.yaml", folder / "axis.yaml"
    write_text(plant, to_yaml({**base.with_values(values, "benchmark").to_dict(), "drive": drive}))
    made: dict[str, Any] = axis | {
        "name": f"{size.name} {travel_m:g} m, {mass_kg:g} kg",
        "motor": axis["motor"]
        | {"inertia_kg_m2": 0.7 * size.inertia_kg_m2, "rated_torque_nm": size.rated_nm, "peak_torque_nm": size.peak_nm},
        "coupling": axis["coupling"] | {"inertia_kg_m2": 0.0} | ({"stiffness_nm_rad": None} if size.name == "large" else {}),
        "pulley": axis["pulley"] | {"effective_radius_m": size.radius_m, "inertia_kg_m2": 0.3 * size.inertia_kg_m2, "teeth": None},
        "belt": axis["belt"] | {"specific_stiffness_n": size.ea_n, "pulley_distance_m": distance, "preload_n": 1.05 * size.force_n},
        "travel": {"min_m": 0.0, "max_m": travel_m, "driven_side_offset_m": 0.05},
        "payload": {"mass_kg": mass_kg if size.name == "large" else None},
        "limits": axis["limits"] | {"feed_force_n": size.force_n, "pulley_torque_nm": size.force_n * size.radius_m},
    }
    write_text(sheet, to_yaml(made))
    return plant, sheet


def commissioned(size: Size, travel_m: float, mass_kg: float, **extent: Any) -> tuple[float, float, bool, str]:
    """Seconds on the machine, worst relative error of what is asked, whether the targets were met, and in words."""
    with tempfile.TemporaryDirectory() as place:
        plant, sheet = written(size, travel_m, mass_kg, Path(place))
        truth = load_plant(str(plant)).model
        options = Options(yes=True, seed=1, drive={"start_position": 0.5 * travel_m}, **extent)
        try:
            found = api.commission(f"virtual:{plant}", load_axis(str(sheet)), Path(place) / "run", options=options).to_json()
        except BeltcommError as error:
            return float("nan"), float("nan"), False, f"{type(error).__name__}: {str(error)[:300]}"
    model = {name: entry["value"] for name, entry in found["model"]["parameters"].items()}
    errors = {name: model[name] / truth[name] - 1.0 for name in ASKED}
    verdict = found["verdict"] or {}
    good = bool(verdict.get("passed")) and not found.get("reservations") and max(map(abs, errors.values())) <= ACCURACY
    words = ", ".join(f"{name.split('.')[1]} {100.0 * e:+.2f} %" for name, e in errors.items())
    return found["machine_seconds"], max(map(abs, errors.values())), good, f"{words}, {'meets its targets' if good else 'NOT good'}"


def run(_rounds: int = 1) -> Iterator[Figure]:
    """Every axis once with --quick."""
    for name, axes in (("small", SMALL), ("large", LARGE)):
        for travel_m, mass_kg in axes:
            taken, _, good, words = commissioned(SIZES[name], travel_m, mass_kg, quick=True)
            aim = QUICK_AIM_S if good else 0.0
            yield Figure("machine", f"--quick, {name}, {travel_m:g} m, {mass_kg:g} kg", taken, "s", aim, False, note=words)
