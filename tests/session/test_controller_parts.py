"""The parts of the controller that can be chosen, what they bring on the machine, and what is refused before it moves."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from beltcomm.drive.parameters import GAIN_NAMES
from beltcomm.runfolder import RunFolder
from session.bench import RATIO, Bench
from session.conftest import Complete
from session.test_commands import DRIVE, call, json_of

MakeBench = Callable[..., Bench]
Copy = Callable[..., Path]


@pytest.mark.parametrize("kind", ["linear", "none"])
def test_design_takes_the_feedforward_asked_for(copy_of_complete: Copy, complete: Complete, kind: str) -> None:
    """(4.16): what is fed forward follows the kind, nonlinear in the run's own design; the loop itself does not change."""
    data = json_of(call("design", copy_of_complete(), "--feedforward", kind, "--json"))
    parameters, first = data["parameters"], complete.folder.load("designs", "final")["parameters"]
    assert {n: parameters[n] for n in GAIN_NAMES if not n.startswith("ff_")} == pytest.approx(
        {n: first[n] for n in GAIN_NAMES if not n.startswith("ff_")}, rel=1e-6
    )
    fed = ("inertia_kg_m2", "viscous_nm_s_rad", "coulomb_nm", "velocity")
    inertia, viscous, coulomb, velocity = (parameters[f"ff_{name}"] for name in fed)
    truth = complete.bench.plant.truth
    whole = truth["inertia_kg_m2"] + RATIO**2 * truth["mass_kg"]
    if kind == "none":
        assert (inertia, viscous, coulomb, velocity, parameters["ff_advance_s"]) == (0.0, 0.0, 0.0, 0.0, 0.0)
        return
    assert first["ff_viscous_nm_s_rad"] == pytest.approx(truth["viscous_nm_s_rad"], rel=0.03)
    assert first["ff_coulomb_nm"] == pytest.approx(truth["coulomb_total_nm"], rel=0.03)
    for each in (inertia, first["ff_inertia_kg_m2"]):
        assert each == pytest.approx(whole, rel=0.01)
    assert velocity == first["ff_velocity"] == 1.0
    # friction around standstill poses as damping, far more than the moving axis has (thesis 5.2)
    assert 5.0 * truth["viscous_nm_s_rad"] < viscous == pytest.approx(data["apparent_damping_nm_s_rad"])
    assert coulomb == 0.0


def test_verify_without_feedforward_trails_by_speed_over_the_position_gain(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    """For this move only: 1.36 m/s and about a motor revolution behind, as predicted; the design of the run stays what it was."""
    run, bench = copy_of_complete(), make_bench()
    before = (run / "designs" / "final.yaml").read_bytes()
    outcome = call("verify", *DRIVE, "--yes", "--run", run, "--feedforward", "none")
    assert outcome.exit_code == 1
    assert outcome.stdout.split()[0] == "FAIL", "the word of this move, not of the run's own gains, which pass"
    folder = RunFolder.open(run)
    moves = [name for name in folder.names("results") if name.startswith("verify_move_")]
    data = folder.load("results", max(moves, key=lambda name: int(name.rpartition("_")[2])))
    kpp = RunFolder.open(run).load("designs", "final")["parameters"]["kpp_1_s"]
    assert data["measured"]["dynamic_m"] == pytest.approx(1.36 / kpp, rel=0.15)
    assert data["measured"]["dynamic_m"] == pytest.approx(data["predicted"]["dynamic_m"], rel=0.02)
    assert (run / "designs" / "final.yaml").read_bytes() == before
    assert bench.parameters() == bench.initial
    assert bench.stands_disabled()


@pytest.mark.examination
def test_a_controller_that_would_leave_the_travel_is_not_tried(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    """A ninth of K_P and no feedforward: the position swings far over its goal, in the prediction already."""
    run, bench = copy_of_complete(), make_bench()
    path = run / "designs" / "final.yaml"
    lines = path.read_text(encoding="utf-8").splitlines()
    weak = {"kp_nm_s_rad": 0.01, "ff_velocity": 0.0, "ff_inertia_kg_m2": 0.0}
    wild = [next((f"  {n}: {v}" for n, v in weak.items() if line.startswith(f"  {n}:")), line) for line in lines]
    path.write_text("\n".join(wild), encoding="utf-8")
    outcome = call("verify", *DRIVE, "--yes", "--force", "--run", run)
    assert outcome.exit_code == 1, outcome.stderr
    assert "the travel is -0.01..0.57 m; slow the move down or design other gains" in outcome.stderr
    assert abs(bench.plant.cart_position_m) < 0.01  # the creep that shows which way the encoder counts, nothing else
    assert bench.parameters() == bench.initial


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--prefilter", "notch"), "cmmp-as has no notch prefilter; choose none"),
        (("--feedforward", "linear"), "cmmp-as has no feedforward, so linear cannot be had"),
    ],
)
def test_what_the_drive_does_not_have_is_refused_before_anything_moves(
    make_bench: MakeBench, tmp_path: Path, words: tuple[str, str], sentence: str
) -> None:
    bench = make_bench()
    outcome = call("commission", *DRIVE, "--profile", "cmmp-as", "--yes", "--no-report", "--run", tmp_path / "run", *words)
    assert (outcome.exit_code, outcome.stdout) == (1, "")
    assert sentence in outcome.stderr
    assert bench.plant.cart_position_m == 0.0
    assert not (tmp_path / "run").exists()
