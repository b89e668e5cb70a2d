"""``beltcomm design``: the proof on measured responses and on draws of the parameters, and records that contradict the model."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltcomm.configfiles import read_yaml, to_yaml, write_text
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.margins import margins
from beltcomm.errors import Refused, UsageError
from beltcomm.model import Model, load_model
from beltcomm.recording import Recording
from beltcomm.rundata import design_proof
from beltcomm.rundata.design_proof import Grounds, _on_draws
from beltcomm.rundata.offline import cascade_of
from beltcomm.rundata.proof import doubts
from beltcomm.rundata.store import cascade_from_dict, structure_from_dict
from beltcomm.runfolder import RunFolder
from beltcomm.simulate.forward import simulate_torque
from session.bench import RATIO, Bench
from session.conftest import Complete
from session.test_commands import call, json_of

Copy = Callable[..., Path]
MakeBench = Callable[..., Bench]
pytestmark = pytest.mark.usefixtures("fitted")


def test_a_healthy_run_is_proven_on_its_own_responses(copy_of_complete: Copy, complete: Complete) -> None:
    """Stable on all, none of the draws unstable, the worst of all below what was asked; and all of it stands in the run folder."""
    run = copy_of_complete()
    data = json_of(call("design", run, "--json"))
    proof = data["proof"]
    assert {one["record"] for one in proof["measured"]} == {"frf_1", "frf_2", "frf_3", "frf_5"}
    for one in proof["measured"]:
        assert one["stable"]
        assert one["velocity_stable"]
        assert one["direction"] == "standing"
        assert one["velocity"]["most_sensitivity_db"] >= one["velocity"]["sensitivity_db"]
        assert one["scatter"] > 5.0 * one["noise"]  # friction's wrong lines repeat
    # Friction poses as damping: what is measured has far more margin than the model counts without it, or crosses 0 dB nowhere.
    loud = [one["velocity"]["least_phase_margin_deg"] for one in proof["measured"] if one["record"] != "frf_3"]
    assert min(one for one in loud if one is not None) > 20.0 + min(m["phase_margin_deg"] for m in data["margins"])
    draws = proof["draws"]
    assert (draws["unstable"], draws["seed"]) == (0, 0)
    assert draws["loops"] == draws["count"] * draws["plants"] == 1280
    assert "covariance" in draws["source"]
    # Known to a tenth of a per cent, so the margins hardly move: less than a degree.
    assert draws["worst_2_5_percent"]["phase_margin_deg"] == pytest.approx(min(m["phase_margin_deg"] for m in data["margins"]), abs=1.0)
    assert proof["contradictions"] == proof["doubts"] == []
    assert proof["worst"]["sensitivity_db"] <= data["specification"]["sensitivity_db"]
    assert any("amplitude_1" in left for left in proof["left_out"])  # a single period
    assert RunFolder.open(run).load("designs", "final")["proof"]["draws"]["worst_2_5_percent"] == draws["worst_2_5_percent"]


def test_words_and_picture_of_the_proof(copy_of_complete: Copy) -> None:
    run = copy_of_complete()
    outcome = call("design", run, "--pictures", "--details")
    assert outcome.exit_code == 0
    assert "measured responses, no model between (4, with 95 %)" in outcome.stdout
    assert "friction shows as damping" in outcome.stdout
    assert "none of 1280 loops unstable" in outcome.stdout
    assert "worst of all, sensitivity" in outcome.stdout
    assert (run / "pictures" / "design_proof.png").stat().st_size > 50_000


def add_heavier(run: Path, model: Model, factor: float) -> None:
    """One more response of the run, as the same axis gives it with another mass at the carriage: torque of frf_1, noise, counts."""
    folder = RunFolder.open(run)
    first = folder.recording("frf_1")
    assert first.torque_setpoint is not None
    start = first.sidecar.start_position_m or 0.0
    torque = np.concatenate(([0.0], first.torque_setpoint[:-1]))  # the drive's delay is one sample
    moved = simulate_torque(model.with_values({"cart.mass": factor * model["cart.mass"]}), torque, 1e-3, start)
    step = 2.0 * math.pi / 65536
    position = np.floor((moved.position_rad - moved.position_rad[0]) / step + 0.5) * step + first.position[0]
    noise = 6e-3 * np.random.default_rng(4).standard_normal(len(torque))
    rows = {"t_s": first.t_s[: len(torque)], "torque": torque + noise, "position": position, "torque_setpoint": first.torque_setpoint}
    folder.add_recording(Recording("frf_9", **rows, sidecar=first.sidecar))  # type: ignore[arg-type]


@pytest.mark.examination
def test_a_record_with_another_load_is_noticed(copy_of_complete: Copy, complete: Complete) -> None:
    """20 % more mass in one record: named, its own mass within 1 %, and judged by the margins on it; a loop that bears it is no doubt."""
    run, model = copy_of_complete(), complete.final.fit.model
    add_heavier(run, model, 1.2)
    data = json_of(call("design", run, "--json"))
    (found,) = data["proof"]["contradictions"]
    assert found["record"] == "frf_9"
    assert found["misfit"] > 3.0
    assert found["own_mass_kg"] == pytest.approx(1.2 * model["cart.mass"], rel=0.01)
    assert found["own_misfit"] < 1.5
    assert found["holds"]
    # What the true load leaves, by the truth's own numbers without friction: the record's fit knows them to a per cent.
    truth, saved = complete.bench.plant.truth, complete.folder.load("designs", "final")
    mass = 1.2 * truth["mass_kg"]
    plant = DesignPlant(truth["inertia_kg_m2"], RATIO, mass, truth["stiffness_n_m"], 0.0, 0.0, truth["belt_damping_n_s_m"], 1e-3)
    (alone,) = margins(cascade_from_dict(saved), [plant], 1e-3)
    assert found["phase_margin_deg"] == pytest.approx(alone.phase_margin_deg, abs=1.0)


def test_a_load_that_the_gains_do_not_bear_is_a_doubt(copy_of_complete: Copy, complete: Complete) -> None:
    """Half the mass: the same gains cross over twice as high, beyond what notch and delay allow.  Exit code 1, and nothing is applied."""
    run, model = copy_of_complete(), complete.final.fit.model
    add_heavier(run, model, 0.4)
    outcome = call("design", run)
    assert outcome.exit_code == 1
    assert "in doubt: frf_9 was made with another load" in outcome.stdout
    assert any("frf_9" in doubt for doubt in doubts(RunFolder.open(run)))


def test_gains_that_do_not_hold_over_what_is_known_move_nothing_unasked(copy_of_complete: Copy, make_bench: MakeBench) -> None:
    """One sentence by one rule: `commission` would have refused such a design; `verify` asked nothing."""
    run, bench = copy_of_complete(), make_bench()
    path = run / "models" / "final.yaml"
    model = read_yaml(path)
    mass, known = model["parameters"]["cart.mass"], model["covariance"]
    mass["interval"], at = 300.0 * mass["value"], known["names"].index("cart.mass")  # for less there are gentler gains
    known["rows"][at][at] = (0.5 * mass["interval"]) ** 2  # its ties to the others stay as they were, and are next to nothing
    write_text(path, to_yaml(model))
    designed = json_of(call("design", run, "--json"), 1)
    short = r"the design does not hold over what is known of this axis: cart\.mass is .* kg, and at .* kg it is unstable"
    assert any(re.search(short, doubt) for doubt in designed["proof"]["doubts"])
    assert designed["proof"]["failed"]
    moves = ("verify", "--drive", "virtual", "--run", run)
    refused = call(*moves, "--yes")
    assert refused.exit_code == 1
    assert re.search(f"nothing was moved: .*{short}", refused.stderr.replace("\n", " "))
    no = call(*moves, answer="n\n")
    assert (no.exit_code, "Move with them all the same?" in no.stderr) == (1, True)
    assert bench.now_s == 0.0
    assert call(*moves, "--yes", "--force").exit_code in {0, 1}
    assert bench.now_s > 0.0


def test_parameters_known_too_badly_make_loops_unstable(copy_of_complete: Copy, complete: Complete) -> None:
    """The same design on a covariance a million times as large: some draws are unstable, and that is an exit code."""
    run = copy_of_complete()
    model_path = run / "models" / "final.yaml"
    model = read_yaml(model_path)
    model["covariance"]["rows"] = [[1e6 * value for value in row] for row in model["covariance"]["rows"]]
    for item in model["parameters"].values():
        if item["interval"]:
            item["interval"] *= 1e6**0.5
    write_text(model_path, to_yaml(model))
    outcome = call("design", run)
    assert outcome.exit_code == 1
    assert "IN DOUBT" in outcome.stdout
    assert "unstable" in outcome.stdout


@pytest.mark.parametrize(("every", "proven"), [(3, True), (1, False)])
def test_draws_that_are_no_machine_are_left_out_and_said(
    complete: Complete, monkeypatch: pytest.MonkeyPatch, every: int, proven: bool
) -> None:
    """A belt law that is hardly known leaves no stiffness at an end of the travel for some draws."""
    folder, asked, plants = complete.folder, count(), design_proof._plants

    def some(grounds: Grounds, model: Model, delay_s: float) -> Any:
        number = next(asked)
        if number and number % every == 0:  # the first is the model itself
            raise UsageError("the design plant's stiffness_n_m is -1")
        return plants(grounds, model, delay_s)

    monkeypatch.setattr(design_proof, "_plants", some)
    model = load_model(folder.file("models", "final"))
    cascade, delay_s = cascade_of(folder.load("designs", "final"), model, structure_from_dict(folder.load("results", "drive")))
    grounds = Grounds(model, (-0.01, 0.57), (0.0,), delay_s, None, 0.06, 65536)
    if proven:
        spread, source = _on_draws(grounds, cascade, 1e-3, 0)
        left, whole = (int(word) for word in re.findall(r"of which (\d+) of (\d+) draws make no machine", source)[0])
        assert left == whole // every
        assert spread.draws == whole - left
    else:
        with pytest.raises(Refused, match="50% are needed to prove a design"):
            _on_draws(grounds, cascade, 1e-3, 0)


def test_without_a_covariance_the_intervals_count(complete: Complete) -> None:
    """A model of an earlier version's run: intervals as if independent, which for these correlated parameters is the wider spread."""
    folder = complete.folder
    saved, model = folder.load("designs", "final"), load_model(folder.file("models", "final"))
    cascade, delay_s = cascade_of(saved, model, structure_from_dict(folder.load("results", "drive")))
    grounds = Grounds(model, (-0.01, 0.57), (0.0,), delay_s, None, 0.06, 65536)
    joint, _ = _on_draws(grounds, cascade, 1e-3, 0)
    apart, source = _on_draws(replace(grounds, model=replace(model, covariance=None)), cascade, 1e-3, 0)
    again, _ = _on_draws(grounds, cascade, 1e-3, 0)
    other, _ = _on_draws(grounds, cascade, 1e-3, 1)
    assert source == "the model's intervals, taken as independent; the delay is assumed"
    np.testing.assert_array_equal(joint.sensitivity_db, again.sensitivity_db)
    assert not np.array_equal(joint.sensitivity_db, other.sensitivity_db)
    assert np.std(apart.phase_margin_deg) > 0.0
