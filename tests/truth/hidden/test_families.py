"""Families wide and rigid: inside their ranges, inside their travel, and what a data sheet says of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from marks import quick
from truth.hidden import draw, laws
from truth.hidden import layout as at
from truth.hidden.catalogue import EFFECTS
from truth.hidden.instruments import Instruments
from truth.hidden.plant import HiddenPlant
from truth.hidden.session import Session, plan, run_session
from truth.hidden.visibility import LEAST_INFORMATION, information_in, instants, spectra_of


def test_wide_machines_fill_their_ranges() -> None:
    bases = [draw(seed, family="wide").base for seed in range(400)]
    ranges = {
        "pulley radius": ([b.radius_m * b.gear for b in bases], 7.8e-3, 25.2e-3),
        "carriage": ([b.mass_kg for b in bases], 0.4, 40.0),
        "travel": ([b.stroke_m for b in bases], 0.3, 3.0),
        "resonance": ([b.resonance_hz for b in bases], 14.99, 150.01),
        "gear": ([b.gear for b in bases], 1.0, 10.0),
    }
    for name, (values, low, high) in ranges.items():
        assert low <= min(values) <= max(values) <= high, name
        assert math.log(max(values) / min(values)) > 0.85 * math.log(high / low), name
    for base in bases:
        assert base.mass_kg * base.radius_m**2 / base.inertia_kg_m2 < 12.001
        assert base.peak_torque_nm * base.radius_m / base.rigid_inertia_kg_m2 > 1.5 * 5.9  # m/s2
        assert 0.04 * base.rated_torque_nm < base.coulomb_nm < 0.13 * base.rated_torque_nm
        assert 1e2 < base.rated_torque_nm / base.inertia_kg_m2 < 1e6
    pulleys = [draw(seed, ("end_pulley",), family="wide") for seed in range(60)]
    shares = [machine.hidden["end_pulley"]["mass_kg"] / machine.base.mass_kg for machine in pulleys]
    assert 0.03 <= min(shares) < 0.04 < 0.09 < max(shares) <= 0.1


def test_rigid_machines_fill_their_ranges() -> None:
    machines = [draw(seed, family="rigid", drawn_instruments=True) for seed in range(300)]
    inertias = [machine.base.inertia_kg_m2 for machine in machines]
    assert 1e-5 <= min(inertias) < 2e-5 < 5e-3 < max(inertias) <= 1e-2
    counts = [machine.instruments.counts_per_rev or 0 for machine in machines]
    assert 500 <= min(counts) < 700 < 50_000 < max(counts) <= 65536
    for machine in machines:
        assert set(machine.sheet) == {"name", "motor"}
        assert machine.sheet["motor"]["inertia_kg_m2"] == pytest.approx(machine.base.inertia_kg_m2, rel=0.101)
    with pytest.raises(ValueError, match="without a belt"):
        draw(1, ("cogging",), family="rigid")


def test_an_axis_without_a_belt_is_one_inertia_with_friction() -> None:
    base = draw(5, family="rigid").base
    plant = HiddenPlant(draw(5, family="rigid"), 0.5 * base.stroke_m)
    torque = 3.0 * base.coulomb_nm
    for _ in range(400):
        plant.step(torque, 1e-3)
    rest, rate = (torque - base.coulomb_nm) / base.viscous_nm_s_rad, base.viscous_nm_s_rad / base.inertia_kg_m2
    assert plant.velocity_rad_s == pytest.approx(rest * (1.0 - math.exp(-rate * 0.4)), rel=2e-3)
    assert plant.cart_position_m == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("family", "seed"),
    quick([("wide", 109), ("rigid", 101), ("sheet", 101), ("wide", 114), ("wide", 123), ("rigid", 109), ("rigid", 119)], 3),
)
def test_no_record_leaves_its_travel(family: str, seed: int) -> None:
    machine = draw(seed, family=family, drawn_instruments=True)
    base, names = machine.base, []
    for record in run_session(machine, "default"):
        place = record.position_rad * base.radius_m / base.stroke_m
        assert 0.0 < place.min() <= place.max() < 1.0, record.task.name
        assert np.abs(record.setpoint_nm).max() <= base.peak_torque_nm
        assert np.ptp(record.position_rad) > 5 * base.quantum_rad
        resting = record.position_rad[-round(0.1 / machine.instruments.period_s) :]
        assert np.ptp(resting) * base.radius_m < 0.01 * base.stroke_m, record.task.name
        if record.task.note:
            highest = record.task.note["excited_lines"][-1] / (record.task.note["period_samples"] * machine.instruments.period_s)
            assert highest <= min(250.0, 0.4 / machine.instruments.period_s) + 1e-9
        names.append(record.task.name)
    assert {"fast", "reversal", "holdout_moves", "holdout_frf"} <= set(names)


@pytest.mark.parametrize("name", [name for name in EFFECTS if name != "belt_damping"])
def test_effects_of_a_wide_machine_change_its_vector_within_reason(name: str) -> None:
    for seed in range(20):
        healthy, machine = draw(seed, family="wide"), draw(seed, (name,), family="wide")
        changed = np.flatnonzero(healthy.p != machine.p)
        assert len(changed) > 0
        assert np.isfinite(machine.p).all()
        assert abs(machine.p[at.GRAVITY]) <= 0.51 * 9.81


def test_run_out_turns_with_the_pulley_behind_the_gear() -> None:
    machine = next(m for m in (draw(s, ("pulley_eccentricity",), family="wide") for s in range(50)) if m.base.gear > 2.0)
    angle = np.linspace(0.0, math.tau * machine.base.gear, 400, endpoint=False)  # one turn of the pulley
    off = np.array([laws.pulley(float(a), machine.p)[0] for a in angle]) - machine.base.radius_m * angle
    lines = np.abs(np.fft.rfft(off - off.mean()))
    assert np.argmax(lines) == 1
    run_out = 2.0 * lines[1] / len(angle)
    assert run_out == pytest.approx(machine.hidden["pulley_eccentricity"]["run_out_m"] * machine.base.gear, rel=1e-3)


@pytest.mark.parametrize("period", [0.5e-3, 2e-3])
def test_the_examiner_sees_a_healthy_machine_as_healthy_through_any_instruments(period: float) -> None:
    kind = Instruments(period_s=period, setpoint_filter_s=0.4e-3, inner_phase=0.3, loop_order=1, loop_s=0.2e-3, counts_per_rev=65536)
    seen = []
    for names in ((), ("cogging",)):
        machine = draw(14, names, family="sheet", instruments=kind)
        session = Session(machine, fine=instants(machine))
        session.place(0.5)
        records = [session.record(next(task for task in plan(machine, "default") if task.name == "frf_p1_a2"))]
        seen.append(information_in(spectra_of(records, machine), machine)[0])
    assert seen[0] < 0.3 * LEAST_INFORMATION
    assert seen[1] > 3.0 * LEAST_INFORMATION
