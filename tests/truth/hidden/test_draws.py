"""Draws, sessions and run folders: every effect acts and vanishes with its strength, same seed same bytes, contract obeyed."""

from __future__ import annotations

import ast
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from beltcomm.axis import load_axis
from beltcomm.recording import load_recording
from truth.hidden import draw, recorder, write_session
from truth.hidden import layout as at
from truth.hidden.catalogue import EFFECTS
from truth.hidden.layout import Array
from truth.hidden.machines import Machine, set_spans
from truth.hidden.outside import OUTSIDE
from truth.hidden.plant import HiddenPlant
from truth.hidden.recorder import PERIOD_S
from truth.hidden.session import Session, Task, abilities, plan
from truth.hidden.signals import multisine
from truth.hidden.visibility import LEAST_INFORMATION, PER_SAMPLE, information_in, spectra_of

CATALOGUE = [
    "belt_damping",
    "end_pulley",
    "stiffness_position",
    "stribeck",
    "coulomb_asymmetry",
    "tilt",
    "quadratic_drag",
    "friction_position",
    "presliding",
    "warmup",
    "cable_chain",
    "cogging",
    "torque_ripple",
    "tooth_ripple",
    "pulley_eccentricity",
    "encoder_eccentricity",
    "encoder_interpolation",
    "backlash",
    "belt_slack",
    "payload_mode",
    "torque_saturation",
    "dead_time",
    "current_lag",
    "cart_friction",
]


def test_judge_and_judged_share_no_code() -> None:
    files = [file for file in Path(__file__).parent.glob("*.py") if not file.name.startswith("test_")]
    assert len(files) >= 15
    for file in files:
        assert len(file.read_text(encoding="utf-8").splitlines()) < 400
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any(name.startswith("beltcomm") for name in names), f"{file.name} imports the product"


def test_the_catalogue_is_the_method_sheets() -> None:
    assert list(EFFECTS) == CATALOGUE
    assert len(OUTSIDE) >= 8
    assert not set(OUTSIDE) & set(EFFECTS)


def test_refuses_what_cannot_be() -> None:
    with pytest.raises(ValueError, match="no effect is called coging"):
        draw(1, ("coging",))
    with pytest.raises(ValueError, match=r"strength 1\.5"):
        draw(1, ("cogging",), 1.5)
    with pytest.raises(ValueError, match="family 'heavy'"):
        draw(1, family="heavy")
    with pytest.raises(ValueError, match="cannot be in one machine"):
        draw(1, ("payload_mode", "payload_impact"))
    with pytest.raises(ValueError, match="plan 'long'"):
        list(plan(draw(1), "long"))


def driven(machine: Machine) -> Array:
    """Angle every millisecond under a torque that shakes, reverses and travels, on the way through the middle of the stroke."""
    place = machine.hidden.get("friction_position", {}).get("place_m", 0.45)
    plant = HiddenPlant(machine, place - 0.03)
    n = np.arange(500)
    torque = 1.6 * np.sin(2e-4 * n * n) + 0.4 * np.sin(0.6 * n) + 0.25
    rows = []
    for value in torque:
        plant.step(float(value), PERIOD_S)
        rows.append(plant.position_rad)
    return np.array(rows)


@pytest.mark.parametrize("name", [name for name in (*EFFECTS, *OUTSIDE) if name != "belt_damping"])
def test_every_effect_acts_and_vanishes_with_its_strength(name: str) -> None:
    count = draw(4).base.quantum_rad
    healthy, full, faint, none = (driven(draw(4, (name,), strength)) for strength in (0.0, 1.0, 1e-4, 0.0))
    healthy = driven(draw(4))
    least = 0.5 if name == "encoder_interpolation" else 5.0  # seen over thousands of lines, each of a few counts
    assert np.abs(full - healthy).max() > least * count
    assert np.abs(none - healthy).max() < 1e-6 * count
    assert np.abs(faint - healthy).max() < 0.1 * np.abs(full - healthy).max()


@pytest.mark.parametrize("family", ["sheet", "rig"])
def test_machines_lie_in_their_ranges(family: str) -> None:
    machines = [draw(seed, family=family) for seed in range(200)]
    masses = np.array([machine.base.mass_kg for machine in machines])
    assert 0.95 < masses.min() < 1.2
    assert 11.0 < masses.max() < 13.5
    assert abs(np.log(masses).mean() - 0.5 * math.log(13.0)) < 0.2
    for machine in machines:
        base, sheet = machine.base, machine.sheet
        stated = sheet["motor"]["inertia_kg_m2"] + sheet["coupling"]["inertia_kg_m2"] + sheet["pulley"]["inertia_kg_m2"]
        assert 0.9 < stated / base.inertia_kg_m2 < 1.1
        assert sheet["pulley"]["effective_radius_m"] == pytest.approx(base.radius_m, rel=1e-5)
        assert 0.06 < machine.p[at.COULOMB] < 0.17


def test_seed_gives_the_machine_and_the_effect_changes_nothing_else() -> None:
    healthy, cogging, pair = draw(8), draw(8, ("cogging",), 0.4), draw(8, ("cogging", "tilt"), 0.4)
    assert healthy.base == cogging.base == pair.base
    assert healthy.sheet == pair.sheet
    assert pair.hidden["cogging"] == cogging.hidden["cogging"]
    changed = np.flatnonzero(cogging.p != healthy.p)
    assert set(changed) <= set(range(at.COG, at.COG_SECOND_PHASE + 1))
    assert draw(8, outside=True).effects[0] in OUTSIDE
    assert draw(9).base != healthy.base


@pytest.mark.parametrize(("name", "longest"), [("thorough", 180.0), ("default", 75.0)])
@pytest.mark.parametrize("family", ["sheet", "rig"])
def test_plan_has_what_the_method_needs(family: str, name: str, longest: float) -> None:
    machine = draw(12, family=family)
    tasks = list(plan(machine, name))
    lengths = [
        len(t.excitation) if t.excitation is not None else len(t.reference.position_m)
        for t in tasks
        if t.excitation is not None or t.reference
    ]
    assert sum(lengths) * PERIOD_S < longest
    frf = [task for task in tasks if task.experiment == "frf"]
    assert len({task.start_m for task in frf if not task.held_out}) == 3
    assert {task.name for task in tasks if task.held_out} == {"holdout_moves", "holdout_frf"}
    assert [task.name for task in tasks][0 :: len(tasks) - 1] == ["sweep_fast_1", "sweep_fast_2"]
    lines = frf[0].note
    assert all(k % 2 == 1 for k in (*lines["excited_lines"], *lines["detection_lines"]))
    assert len(lines["excited_lines"]) == pytest.approx(3 * len(lines["detection_lines"]), abs=3)
    for task in tasks:
        if task.reference is not None:
            reached = task.reference.position_m
            assert reached[0] == reached[249] == pytest.approx(task.start_m)
            assert reached[-1] == reached[-401]
            assert np.abs(task.reference.acceleration_m_s2).max() < 1.01 * max(abilities(machine).full_m_s2, 2.0)
            assert np.abs(np.diff(reached)).max() < 2.01 * PERIOD_S


def test_folder_obeys_the_contract_and_hides_the_answer(tmp_path: Path) -> None:
    machine = draw(21, ("backlash",), 0.7)
    names = write_session(machine, tmp_path / "run", "default")
    assert sorted(p.name for p in (tmp_path / "run").iterdir()) == ["axis.yaml", "recordings"]
    axis = load_axis(tmp_path / "run" / "axis.yaml")
    assert sorted(p.stem for p in (tmp_path / "run" / "recordings").glob("*.csv")) == names
    clock = 0.0
    for name in names:
        recording = load_recording(tmp_path / "run" / "recordings" / f"{name}.csv", axis)
        assert recording.notes == ("the sidecar's key excited_lines means nothing here",)[:0]
        assert recording.sample_period_s == pytest.approx(PERIOD_S)
        assert len(recording.gaps) == 0
        assert recording.sidecar.session_time_s >= clock
        clock = recording.sidecar.session_time_s + recording.t_s[-1]
        assert recording.sidecar.held_out == ("holdout" in name)
        assert recording.torque_setpoint is not None
        off = recording.torque[1:] - recording.torque_setpoint[:-1]
        assert np.std(off) == pytest.approx(machine.base.torque_noise_nm, rel=0.06)
        steps = np.diff(np.unique(recording.position)) / machine.base.quantum_rad
        assert steps == pytest.approx(np.round(steps), abs=2e-3)
    assert clock < 75.0
    text = "".join(p.read_text(encoding="utf-8") for p in (tmp_path / "run").rglob("*.yaml"))
    assert "backlash" not in text
    assert f"{machine.base.mass_kg:.3f}" not in text
    with pytest.raises(FileExistsError):
        write_session(machine, tmp_path / "run", "default")


def test_same_seed_same_bytes(tmp_path: Path) -> None:
    def record() -> tuple[bytes, bytes]:
        session = Session(draw(33, ("stribeck", "missing_codes"), 0.5))
        session.place(0.4)
        done = session.record(next(iter(plan(session.machine, "default"))))
        return done.position_rad.tobytes(), done.torque_nm.tobytes()

    assert record() == record()
    assert yaml.safe_dump(dict(draw(33).sheet)) == yaml.safe_dump(dict(draw(33, ("tilt",)).sheet))


def test_missing_codes_are_never_read() -> None:
    machine = draw(2, ("missing_codes",))
    q, hidden = machine.base.quantum_rad, machine.hidden["missing_codes"]
    codes = {round(recorder.reading(angle, q, machine.p) / q) for angle in np.arange(0.0, 1.0, 0.3 * q)}
    assert len(codes) == pytest.approx(1.0 / q * (1.0 - (hidden["width_counts"] - 1) / hidden["period_counts"]), rel=0.05)


def seen(machine: Machine) -> float:
    """Information of one strong multisine record on what no healthy machine explains."""
    session = Session(machine, fine=PER_SAMPLE)
    session.place(0.5)
    signal = 2.0 * np.tile(multisine(np.random.default_rng(1))[0], 2)
    record = session.record(Task("frf", "frf", 0.5, excitation=np.concatenate((np.zeros(400), signal, np.zeros(600)))))
    return information_in(spectra_of([record], machine), machine)[0]


def test_the_motor_sees_an_end_pulley_but_not_one_in_unison_with_the_carriage() -> None:
    assert seen(draw(14)) < 1.0
    machine = draw(14, ("end_pulley",))
    assert seen(machine) > 100.0 * LEAST_INFORMATION
    # me/m = 2 alpha/(1 - alpha): both masses hang on the motor like one, if their dampers and drags do too
    p, base = machine.p.copy(), machine.base
    alpha = machine.hidden["end_pulley"]["alpha"]
    set_spans(p, base.stiffness_n_m, base.belt_damping_n_s_m, alpha)
    ratio = 2.0 * alpha / (1.0 - alpha)
    p[at.M], p[at.ME], p[at.IDLER_DRAG] = base.mass_kg, ratio * base.mass_kg, ratio * base.drag_n_s_m
    in_unison = replace(machine, p=p, hidden={"end_pulley": {"alpha": alpha, "mass_kg": float(p[at.ME])}})
    assert seen(in_unison) < 1.0
