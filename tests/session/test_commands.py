"""Every command on the machine or on a run folder: results, exit codes, what stands on stdout and what on stderr."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from beltcomm.cli.main import cli
from beltcomm.drive.parameters import GAIN_NAMES
from beltcomm.recording import load_recording
from beltcomm.runfolder import RunFolder
from marks import quick
from session.bench import RATIO, Bench
from session.conftest import Complete

MakeBench = Callable[..., Bench]
Copy = Callable[..., Path]
DRIVE = ("--drive", "virtual:g_a", "--seed", "1")


def call(*words: object, answer: str | None = None) -> Result:
    return CliRunner().invoke(cli, [str(word) for word in words], input=answer)


def json_of(outcome: Result, code: int = 0) -> dict[str, Any]:
    """The one JSON object on stdout; NaN and Infinity are no JSON."""
    assert outcome.exit_code == code, outcome.output

    def no_json(word: str) -> None:
        raise AssertionError(f"{word} in the JSON output")

    lines = outcome.stdout.splitlines()
    assert len(lines) == 1
    parsed = json.loads(lines[0], parse_constant=no_json)
    assert isinstance(parsed, dict)
    return parsed


def test_fit_finds_the_model_in_the_recordings(copy_of_complete: Copy, complete: Complete) -> None:
    """Of three records at one place: less exact than the whole run, as true as its intervals say."""
    run = copy_of_complete("frf_[2-9]", "sweep*", "move*")
    (run / "models" / "final.yaml").unlink()
    data = json_of(call("fit", run, "--json"))
    truth = complete.bench.plant.truth
    for name, true in (("cart.mass", "mass_kg"), ("belt_stiffness.stiffness", "stiffness_n_m"), ("motor.inertia", "inertia_kg_m2")):
        item = data["model"]["parameters"][name]
        assert item["value"] == pytest.approx(truth[true], rel=0.03)
        assert abs(item["value"] - truth[true]) < 2.0 * item["interval"]
    assert (run / "models" / "final.yaml").is_file()
    assert data["fit"]["dead_time"]["value_s"] == pytest.approx(1e-3, abs=50e-6)
    assert set(data["fit"]["log_magnitude"]) == {"frf_1"}


@pytest.mark.usefixtures("fitted")
@pytest.mark.parametrize("solver", ["lm", "trf", "nelder-mead"])
def test_fit_takes_the_solver_that_is_asked_for(copy_of_complete: Copy, complete: Complete, solver: str) -> None:
    """The thesis's fit is biased by friction (some per cent), but no solver finds another minimum."""
    outcome = call("fit", copy_of_complete("frf_[2-9]"), "--solver", solver, "--json")
    fitted = json_of(outcome)["fit"]["log_magnitude"]["frf_1"]
    first = complete.result.data["fit"]["log_magnitude"]["frf_1"]
    for name, item in first.items():
        value = item["value"] if isinstance(item, dict) else item
        again = fitted[name]["value"] if isinstance(fitted[name], dict) else fitted[name]
        assert again == pytest.approx(value, rel=0.01, abs=1e-9), name


@pytest.mark.usefixtures("fitted")
def test_fit_speaks_to_people_too(copy_of_complete: Copy) -> None:
    run = copy_of_complete("frf_2", "frf_3")
    outcome = call("fit", run, "--details")
    assert outcome.exit_code == 0
    assert outcome.stdout.strip().startswith("FITTED")
    assert f"    beltcomm design {run}\n" in outcome.stdout
    assert "carriage mass" in outcome.stdout
    assert outcome.stderr.startswith("[1/1] fit\n")


def test_design_finds_the_gains_of_the_run_again(copy_of_complete: Copy, complete: Complete) -> None:
    run = copy_of_complete()
    (run / "designs" / "final.yaml").unlink()
    data = json_of(call("design", run, "--json"))
    first = complete.folder.load("designs", "final")["parameters"]
    assert data["parameters"] == pytest.approx(first, rel=1e-6)
    assert RunFolder.open(run).load("designs", "final")["parameters"] == pytest.approx(first, rel=1e-6)


def test_design_holds_for_the_payload_stated(copy_of_complete: Copy, complete: Complete) -> None:
    """13.4 kg more: every margin is proven with it and without it, and a notch was asked for."""
    data = json_of(call("design", copy_of_complete(), "--payload", "13.4", "--prefilter", "notch", "--json"))
    plants = [margins["plant"] for margins in data["margins"]]
    alone = complete.final.fit.model["cart.mass"]
    for place in ("-0.01 m", "0.57 m"):
        for mass in (f"{alone:.2f} kg", f"{alone + 13.4:.2f} kg"):
            assert sum(place in plant and mass in plant for plant in plants) >= 3  # damping from none to the apparent one
    assert min(margins["phase_margin_deg"] for margins in data["margins"]) >= data["specification"]["phase_margin_deg"]
    assert data["parameters"]["prefilter_kind"] == 1.0
    assert len(plants) == 2 * len(complete.folder.load("designs", "final")["margins"])


def test_a_payload_cannot_be_negative(make_bench: MakeBench, copy_of_complete: Copy, tmp_path: Path) -> None:
    bench = make_bench()
    assert json_of(call("design", copy_of_complete(), "--payload", "-1", "--json"), 2)["exit_code"] == 2
    assert call("commission", *DRIVE, "--yes", "--run", tmp_path / "new", "--payload", "-1 kg").exit_code == 2
    assert bench.plant.cart_position_m == 0.0


def test_verify_drives_the_design_and_restores_the_drive(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench(start_m=0.2)
    outcome = call("verify", *DRIVE, "--yes", "--run", run, "--json")
    data = json_of(outcome)
    assert (data["recording"], data["passed"]) == ("move_2", True)
    assert data["measured"]["dynamic_m"] < 1e-3
    assert data["measured"]["static_m"] < 100e-6
    assert data["measured"]["dynamic_m"] == pytest.approx(data["predicted"]["dynamic_m"], rel=0.2, abs=20e-6)
    assert "Ctrl-C" in outcome.stderr
    assert RunFolder.open(run).finished("move_2") is not None
    assert "verify_move_2" in RunFolder.open(run).names("results")
    assert bench.parameters() == bench.initial
    assert bench.stands_disabled()


def test_verify_drives_the_users_own_move(make_bench: MakeBench, copy_of_complete: Copy, tmp_path: Path) -> None:
    run, bench = copy_of_complete("move_1"), make_bench()
    t = np.linspace(0.0, 1.2, 121)
    x = 0.2 + 0.1 * (1.0 - np.cos(2.0 * np.pi * t / 1.2))  # there and back
    own = tmp_path / "own.csv"
    own.write_text("t_s,position_m\n" + "\n".join(f"{a:.6f},{b:.9f}" for a, b in zip(t, x, strict=True)), encoding="utf-8")
    outcome = call("verify", *DRIVE, "--yes", "--run", run, "--move", own, "--json")
    data = json_of(outcome, outcome.exit_code)
    assert outcome.exit_code == (0 if data["passed"] else 1)
    assert "200 mm" in outcome.stderr  # the travel of the plan, though it ends where it began
    move = RunFolder.open(run).recording(data["recording"])
    assert move.reference_position is not None
    reference = RATIO * move.reference_position
    # it begins where the carriage has come to rest after positioning, at most 1 mm beside
    assert (reference.min(), reference.max()) == (pytest.approx(0.2, abs=1e-3), pytest.approx(0.4, abs=1e-3))
    assert np.ptp(reference) == pytest.approx(0.2, abs=1e-3)
    assert bench.parameters() == bench.initial


@pytest.mark.examination
def test_verify_misses_a_target_with_exit_code_1(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    """Gains of another, much weaker design: the drive lags, and the verdict says so."""
    run, bench = copy_of_complete(), make_bench()
    path = run / "designs" / "final.yaml"
    lines = path.read_text(encoding="utf-8").splitlines()
    weak = ["  ff_inertia_kg_m2: 0.0" if line.startswith("  ff_inertia_kg_m2:") else line for line in lines]
    path.write_text("\n".join(weak), encoding="utf-8")
    outcome = call("verify", *DRIVE, "--yes", "--force", "--run", run)
    assert outcome.exit_code == 1, outcome.output
    assert "allowed" in outcome.stdout
    assert "MISSED" in outcome.stdout
    assert f"    beltcomm open {run}\n" in outcome.stdout
    assert bench.parameters() == bench.initial


@pytest.mark.examination
def test_friction_sweeps_with_a_loop_from_the_model(make_bench: MakeBench, copy_of_complete: Copy, complete: Complete) -> None:
    run, bench = copy_of_complete("sweep*"), make_bench(start_m=0.4)
    data = json_of(call("friction", *DRIVE, "--yes", "--run", run, "--json"))
    truth = complete.bench.plant.truth
    assert data["friction"]["coulomb"]["value"] == pytest.approx(truth["coulomb_total_nm"], rel=0.05)
    assert data["friction"]["viscous"]["value"] == pytest.approx(truth["viscous_nm_s_rad"], rel=0.05)
    assert RunFolder.open(run).finished("sweep") is not None
    assert bench.parameters() == bench.initial
    assert bench.stands_disabled()
    make_bench(start_m=0.4)
    json_of(call("friction", *DRIVE, "--yes", "--run", run, "--json"))
    held_out = [RunFolder.open(run).recording(name).sidecar.held_out for name in ("sweep", "sweep_2")]
    assert held_out == [False, True]  # the first one is fitted, the second one judges


def test_identify_goes_on_by_a_plan(make_bench: MakeBench, copy_of_complete: Copy, tmp_path: Path) -> None:
    run, bench, plan = copy_of_complete(), make_bench(start_m=0.4), tmp_path / "next.yaml"
    plan.write_text(
        "steps:\n- {kind: response, place: 0.6, share: 0.4}\n- {kind: strokes, place: 0.4, speeds_m_s: [0.02, 0.06], held_out: true}\n",
        encoding="utf-8",
    )
    words = ("identify", *DRIVE, "--yes", "--force", "--run", run, "--plan", plan, "--json")
    shown = json_of(call(*words, "--dry-run"))
    assert len(shown["plan"]["experiments"]) == 2
    assert bench.carriage_m == pytest.approx(0.4, abs=1e-6)
    data = json_of(call(*words))
    assert data["recordings"] == ["next_1_response", "next_2_strokes"]
    folder = RunFolder.open(run)
    assert folder.recording("next_2_strokes").sidecar.held_out
    assert folder.recording("next_1_response").sidecar.experiment == "frf"
    assert bench.parameters() == bench.initial
    assert bench.stands_disabled()


def test_apply_writes_the_gains_and_rollback_takes_them_back(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench()
    designed = RunFolder.open(run).load("designs", "final")["parameters"]

    no = call("apply", *DRIVE, "--run", run, answer="n\n")
    assert (no.exit_code, no.stdout) == (1, "")
    assert "kp_nm_s_rad" in no.stderr
    assert "nothing was written, as you said" in no.stderr
    assert bench.parameters() == bench.initial

    dry = call("apply", *DRIVE, "--run", run, "--dry-run")
    assert dry.exit_code == 0
    assert "Nothing was written (--dry-run)" in dry.stdout
    assert bench.parameters() == bench.initial

    yes = json_of(call("apply", *DRIVE, "--run", run, "--yes", "--json"))
    assert (yes["written"], yes["saved"]) == (True, False)
    now = bench.parameters()
    assert {name: now[name] for name in GAIN_NAMES} == pytest.approx({name: designed[name] for name in GAIN_NAMES}, rel=1e-6)
    assert call("apply", *DRIVE, "--run", run, "--yes").stdout.count("->") == 0  # nothing differs any more
    bench.power_cycle()
    assert bench.parameters() == bench.initial

    assert call("apply", *DRIVE, "--run", run, "--yes", "--save").exit_code == 0
    bench.power_cycle()
    assert bench.parameters() == now
    back = call("rollback", *DRIVE, "--run", run, "--yes", "--save")
    assert back.exit_code == 0
    bench.power_cycle()
    assert bench.parameters() == bench.initial
    assert bench.plant.cart_position_m == 0.0  # nothing has moved in all this


@pytest.mark.parametrize("doubt", ["model", "missed", "unproven"])
def test_gains_in_doubt_are_not_written_by_a_mere_yes(make_bench: MakeBench, copy_of_complete: Copy, doubt: str) -> None:
    run, bench = copy_of_complete(), make_bench()
    folder = RunFolder.open(run)
    fit, verdict = folder.load("results", "fit"), folder.load("results", "verify_move_1")
    assert (fit["suspect"], verdict["passed"]) == (False, True)
    if doubt == "model":
        folder.save("results", "fit", {**fit, "suspect": True})
        why = "the model does not explain what was measured"
    elif doubt == "missed":
        folder.save("results", "verify_move_1", {**verdict, "passed": False})
        why = "the verification move with these gains missed its target"
    else:
        design = folder.load("designs", "final")
        design["parameters"]["kp_nm_s_rad"] *= 1.01
        folder.save("designs", "final", design)
        why = "no verification move was driven with these gains"
    refused = call("apply", *DRIVE, "--run", run, "--yes")
    assert refused.exit_code == 1
    assert f"nothing was written: {why}; verify" in refused.stderr
    no = call("apply", *DRIVE, "--run", run, answer="n\n")
    assert (no.exit_code, "Write them all the same?" in no.stderr) == (1, True)
    assert bench.opened == 0
    assert call("apply", *DRIVE, "--run", run, "--yes", "--force").exit_code == 0


def test_apply_before_any_session_keeps_a_backup_first(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench()
    (run / "results" / "backup.yaml").unlink()
    assert call("apply", *DRIVE, "--run", run, "--yes").exit_code == 0
    assert call("rollback", *DRIVE, "--run", run, "--yes").exit_code == 0
    assert bench.parameters() == bench.initial


#: m: what beltcomm calls near enough for a small move.
NEAR_M = 2e-3


@pytest.mark.parametrize("tuned", [False, True])
def test_move_goes_as_far_as_it_is_told(make_bench: MakeBench, copy_of_complete: Copy, tuned: bool) -> None:
    """With the gains of a new drive, and with those of a design, which a quick stop uses too."""
    run, bench = copy_of_complete(), make_bench()
    if tuned:
        assert call("apply", *DRIVE, "--run", run, "--yes").exit_code == 0
    before = bench.parameters() if tuned else None
    data = json_of(call("move", *DRIVE, "--yes", "--by", "5mm", "--json"))
    assert bench.plant.cart_position_m == pytest.approx(5e-3, abs=NEAR_M)
    assert data["moved_m"] == pytest.approx(bench.plant.cart_position_m, abs=0.2e-3)
    assert bench.stands_disabled()
    there = bench.plant.cart_position_m
    back = call("move", *DRIVE, "--yes", "--by", "-0.005")
    assert back.exit_code == 0
    assert bench.plant.cart_position_m - there == pytest.approx(-5e-3, abs=NEAR_M)
    assert "-5.00 mm" in back.stdout
    assert bench.parameters() == (before or bench.initial)


def test_move_does_not_leave_the_travel_by_going_too_far(make_bench: MakeBench) -> None:
    """To 0.5 mm before the end: what it goes too far must not lead beyond it."""
    bench = make_bench(start_m=0.5645)
    outcome = call("move", *DRIVE, "--yes", "--by", "5mm")
    assert outcome.exit_code in (0, 1, 4)
    assert bench.start_m + bench.plant.cart_m(0, len(bench.plant.torque_nm)).max() <= 0.57
    assert bench.stands_disabled()
    assert bench.parameters() == bench.initial


@pytest.mark.parametrize(
    ("start_m", "by", "code", "words"),
    [
        (0.25, "101mm", 2, "cannot be crept"),
        (0.25, "0", 2, "cannot be crept"),
        (0.25, "5 kg", 2, "kg"),
        (0.568, "5mm", 1, "would leave the travel -0.01..0.57 m"),
        (-0.009, "-5mm", 1, "would leave the travel -0.01..0.57 m"),
    ],
)
def test_move_is_refused_beyond_what_is_small_and_free(make_bench: MakeBench, start_m: float, by: str, code: int, words: str) -> None:
    bench = make_bench(start_m=start_m)
    outcome = call("move", *DRIVE, "--yes", "--by", by)
    assert outcome.exit_code == code
    assert words in outcome.stderr
    assert outcome.stdout == ""
    assert bench.plant.cart_position_m == 0.0


@pytest.mark.parametrize(
    ("experiment", "name", "kind"),
    quick([("frf", "frf_1", "frf"), ("friction_sweep", "sweep", "friction_sweep"), ("trajectory", "move_1", "trajectory")], 1),
)
def test_simulate_records_an_experiment(tmp_path: Path, experiment: str, name: str, kind: str) -> None:
    run = tmp_path / "run"
    data = json_of(call("simulate", "g_b", "--run", run, "--experiment", experiment, "--seed", "4", "--json"))
    assert data["recording"] == name
    recording = load_recording(run / "recordings" / f"{name}.csv", RunFolder.open(run).axis)
    assert recording.sidecar.experiment == kind
    assert recording.sidecar.finished
    assert np.ptp(recording.position) * RATIO > 1e-3
    assert call("simulate", "g_b", "--run", run, "--experiment", experiment).exit_code == 2  # the folder exists


@pytest.mark.parametrize(
    "words",
    [("commission", "--run"), ("identify", "--run"), ("move", "--by"), ("friction", "--run"), ("verify", "--run"), ("rollback", "--run")],
)
def test_a_dry_run_moves_and_writes_nothing(make_bench: MakeBench, copy_of_complete: Copy, tmp_path: Path, words: tuple[str, str]) -> None:
    verb, option = words
    bench, old, new = make_bench(), copy_of_complete(), tmp_path / "new"
    before = {path: path.read_bytes() for path in old.rglob("*.*") if path.is_file()}
    argument = {"commission": new, "identify": new, "move": "5mm"}.get(verb, old)
    data = json_of(call(verb, *DRIVE, option, argument, "--dry-run", "--json"))
    assert verb == "rollback" or data["seconds"] > 0.0
    assert bench.plant.cart_position_m == 0.0
    assert not new.exists()
    told = ("journal.txt", "events.jsonl")
    assert {path: path.read_bytes() for path in before if path.name not in told} == {
        path: data for path, data in before.items() if path.name not in told
    }
    assert bench.parameters() == bench.initial


def test_nobody_can_be_asked(make_bench: MakeBench, tmp_path: Path) -> None:
    """Without --yes and with a closed stdin: usage, not a yes."""
    bench = make_bench()
    outcome = call("identify", *DRIVE, "--run", tmp_path / "run", "--json", answer="")
    assert json_of(outcome, 2)["exit_code"] == 2
    assert "use --yes" in outcome.stderr
    assert bench.plant.cart_position_m == 0.0


@pytest.mark.examination
@pytest.mark.usefixtures("fitted")
def test_a_design_that_replaces_proven_gains_says_so(copy_of_complete: Copy) -> None:
    run = copy_of_complete()
    said = "the gains before were proven by a move and are replaced"
    assert said not in call("design", run).stdout, "the same gains again"
    assert said in call("design", run, "--phase-margin", "60").stdout
    assert said not in call("design", run, "--phase-margin", "60").stdout, "those before were not proven either"
