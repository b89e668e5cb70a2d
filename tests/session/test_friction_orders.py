"""Sweeps in the orders of 3.6 on the virtual drive, and what runs say side by side; machines are the independent simulator's."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from beltcomm import api
from beltcomm.axis import load_axis
from beltcomm.axis.entries import TrajectoryLimits, Travel
from beltcomm.cli.main import cli
from beltcomm.errors import DataError, Refused, UsageError
from beltcomm.identify.standstill import _standstill_of
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import Sidecar
from beltcomm.rundata import analyse
from beltcomm.runfolder import RunFolder
from beltcomm.schedule import orders
from beltcomm.sentences import friction
from session.bench import RATIO, Bench
from session.conftest import Complete
from truth import TruthPlant
from truth import kernel as truth_kernel
from truth.rigs import RIGS, nominal

MakeBench = Callable[..., Bench]
Copy = Callable[..., Path]
DRIVE = ("--drive", "virtual:g_a", "--seed", "1")
RIG = load_axis("egc-70-600")
#: m/s: few enough to be short.
FEW = (0.4, 0.02, 0.6, 0.1, 0.005, 0.2)
HEAVY = TrajectoryLimits(50.0, 2.5, 4.75)


def call(*words: object) -> Result:
    return CliRunner().invoke(cli, [str(word) for word in words])


def json_of(outcome: Result, code: int = 0) -> dict[str, Any]:
    assert outcome.exit_code == code, outcome.output
    parsed = json.loads(outcome.stdout.splitlines()[-1])
    assert isinstance(parsed, dict)
    return parsed


class Warming(TruthPlant):
    """Viscous friction that falls with time:  d (1 + amount exp(-t/time_s)),  set anew before every step."""

    def __init__(self, amount: float, time_s: float) -> None:
        base = nominal("g_a")
        self.truth, self.amount, self.time_s, self.now_s = base.truth, amount, time_s, 0.0
        super().__init__(base.axis, truth=base.truth)

    def viscous_at(self, t_s: Any) -> Any:
        return self.truth["viscous_nm_s_rad"] * (1.0 + self.amount * np.exp(-np.asarray(t_s) / self.time_s))

    def step(self, torque_nm: float, duration_s: float) -> None:
        self._parameters[truth_kernel.VISCOUS + truth_kernel.MOTOR] = self.viscous_at(self.now_s)
        super().step(torque_nm, duration_s)
        self.now_s += duration_s


def test_each_order_drives_all_speeds_of_the_table() -> None:
    table = sorted(orders.SHUFFLED)
    assert list(orders.speeds_of("I", 1)) == list(orders.speeds_of("V", 1)) == list(orders.speeds_of("VI", 1)) == table
    assert list(orders.speeds_of("II", 1)) == table[::-1]
    assert sorted(orders.speeds_of("III", 1)) == table
    assert orders.speeds_of("III", 1)[:3] == (2, 0.1, 0.01)
    assert list(orders.speeds_of("IV", 10)) == [v for v in table for _ in range(10)]
    assert [order for order, _ in orders.sweep_orders("all", 2, None).sweeps] == ["I", "I", "II", "II", "III", "III", "IV"]
    assert orders.sweep_orders("IV", None, None).often == 10
    assert orders.sweep_orders(None, None, None).plain
    assert not orders.sweep_orders(None, 2, None).plain


def test_plateaus_hold_whole_turns_where_they_can_and_whole_teeth_else() -> None:
    """2π 12.42 mm = 78.04 mm a turn, 3 mm a tooth; every stroke fits into its way, and lasts as long as the plan says to 2 %."""
    room = 0.5
    strokes, left_out = orders.strokes_for(orders.speeds_of("I", 1), room, HEAVY, RIG)
    turn = 2.0 * math.pi * RATIO
    for stroke in strokes:
        unit = turn if "turn" in stroke.way else 3e-3
        count = stroke.plateau_s * stroke.speed_m_s / unit
        assert count == pytest.approx(round(count), abs=1e-6)
        assert round(count) >= 1
        assert ("turn" in stroke.way) == (stroke.speed_m_s >= turn / orders.TURN_S)
        assert stroke.length_m <= room
        path = orders.path_of([stroke], 0.0, room, HEAVY, 1e-3)
        assert np.max(path.position_m) == pytest.approx(stroke.length_m, abs=1e-9)
        assert path.duration_s == pytest.approx(orders.seconds_of(stroke, HEAVY), rel=0.02)
    assert strokes[0].way == "1 tooth of the belt"
    assert strokes[0].plateau_s == pytest.approx(3.0)
    assert sorted([*left_out, *(s.speed_m_s for s in strokes)]) == sorted(orders.SHUFFLED)
    # v²/a + a v/j·... : the fastest that fits has v (v/a + a/j + run-in + 0.1 s) at most 0.5 m
    top = max(s.speed_m_s for s in strokes)
    for v, fits in ((top, True), (min(left_out), False)):
        assert (v * (v / 2.5 + 2.5 / 50.0 + 0.3) <= room) == fits
    records = orders.records_of(strokes * 3, HEAVY, 60.0)
    assert [s for r in records for s in r] == list(strokes * 3)
    assert max(sum(orders.seconds_of(s, HEAVY) for s in r) for r in records) <= 60.0


@pytest.mark.parametrize(
    ("given", "hint"),
    [
        (("VII", None, None), "no order 'VII'"),
        (("I", 0, None), "0 times"),
        (("I", -1, None), "-1 times"),
        ((None, 1000, None), "1000 times"),
        (("VI", None, None), "--payload-mounted"),
        (("VI", None, 0.0), "--payload-mounted"),
        (("I", None, -2.0), "-2 kg"),
        (("I", None, math.nan), "nan kg"),
    ],
)
def test_what_cannot_be_measured_is_refused_with_words(given: tuple[Any, Any, Any], hint: str) -> None:
    with pytest.raises(UsageError, match=hint):
        orders.sweep_orders(*given)


def test_an_axis_too_short_for_two_speeds_is_refused() -> None:
    with pytest.raises(Refused, match=r"no sweep is possible: of 38 speeds [01] fit into a way of 0 mm"):
        orders.strokes_for(orders.speeds_of("I", 1), 4e-4, HEAVY, RIG)


@pytest.mark.usefixtures("fitted")
def test_bad_calls_move_nothing(make_bench: MakeBench, copy_of_complete: Copy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    run, bench = copy_of_complete(), make_bench()
    for words, code, hint in (
        (("--order", "VII"), 2, "VII"),
        (("--order", "I", "--repeat", "0"), 2, "0 times"),
        (("--order", "VI"), 2, "--payload-mounted"),
        (("--order", "VI", "--payload-mounted", "40"), 1, "moves 13.4 kg in all"),
        (("other-run",), 2, "--compare"),
        (("--compare",), 2, "needs no machine"),
    ):
        outcome = call("friction", *DRIVE, "--yes", "--run", run, *words)
        assert outcome.exit_code == code, outcome.output
        assert hint in outcome.stderr
    assert "no run is named" in call("friction", "--drive", "virtual").stderr
    assert bench.plant.cart_position_m == 0.0


def test_without_a_run_the_newest_goes_on_and_with_its_drive(
    make_bench: MakeBench, copy_of_complete: Copy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_bench()
    (tmp_path / "runs").mkdir()
    copy_of_complete(name="runs/first")
    monkeypatch.chdir(tmp_path)
    outcome = call("friction", "--dry-run")
    assert outcome.exit_code == 0, outcome.output
    assert "Run: runs/first (the newest of 1" in outcome.stderr
    assert "(that of the run)" in outcome.stderr


def test_the_plan_says_the_seconds_of_each_order(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    bench = make_bench()
    plan = json_of(call("friction", *DRIVE, "--run", copy_of_complete(), "--order", "all", "--repeat", "2", "--dry-run", "--json"))["plan"]
    titles = [item["title"][:9] for item in plan["experiments"]]
    assert titles == ["order I, ", "order I, ", "order II,", "order II,", "order III", "order III", "order IV,"]
    seconds = [item["seconds"] for item in plan["experiments"]]
    assert seconds[6] == pytest.approx(2.0 * seconds[0], rel=0.05)
    assert max(item["speed_m_s"] for item in plan["experiments"]) == 0.7
    assert any("1 tooth of the belt" in line for line in plan["notes"])
    assert bench.plant.cart_position_m == 0.0


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(orders, "SHUFFLED", FEW)
    monkeypatch.setattr(orders, "RECORD_S", 8.0)


@pytest.mark.examination
@pytest.mark.usefixtures("few", "fitted")
def test_a_warming_axis_is_found_to_drift_as_built_in(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    """35 % more when cold, 30 s; the truth at the same instants, its slope weighted as torque at a speed weighs it: ω.

    The exponential is not straight, so the interval is wide: the slope within it, Coulomb friction at rest within its own.
    """
    plant = Warming(0.35, 30.0)
    run, bench = copy_of_complete("sweep*"), make_bench(plant=plant, start_m=0.4)
    data = json_of(
        call(
            "friction",
            *DRIVE,
            "--yes",
            "--run",
            run,
            "--order",
            "III",
            "--repeat",
            "3",
            "--payload-mounted",
            "11.2kg",
            "--no-pictures",
            "--json",
        )
    )
    assert bench.parameters() == bench.initial
    assert [s["name"] for s in data["sweeps"]] == ["III, 1.", "III, 2.", "III, 3."]
    drift = data["drift"]["1"]
    times, weights = [], []
    for sweep in data["sweeps"]:
        assert sweep["payload_kg"] == 11.2
        for name in sweep["records"]:
            recording = RunFolder.open(run).recording(name)
            reference = np.asarray(recording.reference_velocity)
            steady = (np.abs(np.gradient(reference)) == 0.0) & (reference != 0.0)
            times.append(recording.t_s[steady] - recording.t_s[0] + float(recording.sidecar.session_time_s or 0.0))
            weights.append(np.abs(reference[steady]))
    t, w = np.concatenate(times), np.concatenate(weights)
    true = float(np.polyfit(t / 60.0, plant.viscous_at(t), 1, w=w)[0])
    assert drift["viscous"]["value"] == pytest.approx(true, abs=1.5 * drift["viscous"]["interval"])
    assert drift["viscous"]["interval"] < 0.4 * abs(true)
    assert abs(drift["coulomb"]["value"]) < 1.5 * drift["coulomb"]["interval"]
    last = data["sweeps"][-1]
    middle = 0.5 * (last["from_s"] + last["to_s"])
    assert last["fit"]["viscous"]["value"] == pytest.approx(float(plant.viscous_at(middle)), rel=0.04)
    sidecars = [RunFolder.open(run).recording(name).sidecar for name in data["recordings"]]
    assert [s.held_out for s in sidecars][:1] == [False]
    assert all(s.held_out for s in sidecars[1:])
    assert len(sidecars) > 3, "a sweep of more than RECORD_S is cut"


def test_a_payload_of_another_run_is_refused(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench(start_m=0.4)
    note = run / "recordings" / "sweep.yaml"
    note.write_text(note.read_text(encoding="utf-8") + "payload_kg: 11.2\n", encoding="utf-8")
    outcome = call("friction", *DRIVE, "--yes", "--run", run, "--order", "VI", "--payload-mounted", "5kg", "--json")
    assert json_of(outcome, 1)["error"].startswith("this run's records were made with 11.2 kg")
    assert bench.plant.cart_position_m == 0.0


def test_both_dampings_of_a_run_and_why(complete: Complete) -> None:
    """Seen: what the design counts with.  Predicted from friction and the record's own motion within a third (one gain for all
    frequencies); the model under the record's torque shows it to 15 %, without Coulomb friction a tenth of it."""
    found = complete.result.to_json()["standstill"]
    assert found["seen"]["value"] == pytest.approx(complete.result.to_json()["design"]["apparent_damping_nm_s_rad"])
    assert found["seen"]["value"] > 10.0 * found["sweep"]["value"]
    assert found["predicted"]["value"] == pytest.approx(found["seen"]["value"], rel=0.35)
    assert found["modelled"] == pytest.approx(found["seen"]["value"], rel=0.15)
    assert found["without_coulomb"] < 0.15 * found["seen"]["value"]
    truth = complete.bench.plant.truth
    assert found["coulomb_nm"][0] == pytest.approx(truth["coulomb_motor_nm"], rel=0.05)
    assert found["coulomb_nm"][1] == pytest.approx(RATIO * truth["coulomb_cart_n"], rel=0.1)
    told = (complete.path / "verdict.txt").read_text(encoding="utf-8").splitlines()
    (line,) = [line for line in told if line.startswith("Damping, two answers")]
    assert "d = 4 M_C/(π Ω)" in line
    assert "proves its margins for every damping" in line


def test_a_record_in_motion_is_no_standstill(complete: Complete) -> None:
    folder = complete.folder
    recordings = folder.recordings()
    model = complete.final.fit.model
    excited = folder.recording("frf_1")
    ride = replace(excited, position=excited.position + 20.0 * excited.t_s, notes=())  # the same motion on a carriage that travels
    response = analyse.responses(recordings)["frf_1"]
    fit = analyse.thesis_fit(response, model)
    with pytest.raises(DataError, match="in motion"):
        _standstill_of(ride, fit, model, analyse.friction_of(recordings))
    assert friction.standstill_lines(None) == []


def run_of(path: Path, payload_kg: float | None, coulomb: float, sweeps: int = 3, axis: Any = RIG) -> Path:
    """A run made by hand: sweeps of a law at four speeds, each with friction of its own day (0.5 %), 0.1 mN m of noise."""
    folder = RunFolder.create(path, axis)
    rng = np.random.default_rng(round(1e6 * coulomb))
    speed = np.concatenate([np.full(350, s * v) for v in (2.0, 5.0, 10.0, 20.0) for s in (1.0, -1.0)])
    t = 1e-3 * np.arange(len(speed))
    angle = np.concatenate(([0.0], np.cumsum(speed[:-1]) * 1e-3))
    for k in range(1, 1 + sweeps):
        level = coulomb * (1.0 + 5e-3 * rng.normal())
        torque = level * np.sign(speed) + 2.3e-3 * speed + 1e-4 * rng.normal(size=len(t))
        note = Sidecar("friction_sweep", 0.1, 10.0 * k, True, payload_kg=payload_kg)
        folder.add_recording(Recording(f"sweep_{k}", t, torque, angle, reference_velocity=speed, sidecar=note))
    return path


def test_friction_of_two_loads(tmp_path: Path) -> None:
    """Table A.10's Coulomb friction grows by 0.893 mN m/kg, its viscous friction not at all here: one verdict each."""
    bare, loaded = run_of(tmp_path / "bare", 0.0, 0.115), run_of(tmp_path / "loaded", 11.2, 0.125)
    outcome = call("friction", "--compare", bare, loaded, "--json")
    load = json_of(outcome)["load"]
    assert load["by"] == "payload mounted"
    assert load["coulomb"]["value"] == pytest.approx(10e-3 / 11.2, abs=1.5 * load["coulomb"]["interval"])
    assert (bare / "pictures" / "friction_load.png").is_file()
    text = call("friction", "--compare", bare, loaded, "--no-pictures").stdout
    assert "per kg: depends on load" in text
    assert "per kg: cannot tell; if it does, by no more than" in text
    single = [run_of(tmp_path / f"one_{kg}", kg, level, sweeps=1) for kg, level in ((0.0, 0.115), (11.2, 0.125))]
    assert (
        "cannot tell; it differs between the runs, but no sweep was repeated"
        in call("friction", "--compare", *single, "--no-pictures").stdout
    )


def test_runs_that_cannot_be_compared(tmp_path: Path, complete: Complete) -> None:
    bare = run_of(tmp_path / "bare", 0.0, 0.115)
    other = run_of(tmp_path / "other", 5.0, 0.125, axis=replace(RIG, travel=Travel(0.0, 0.4, 0.05)))
    untold = run_of(tmp_path / "untold", None, 0.125)
    empty = tmp_path / "empty"
    RunFolder.create(empty, RIG)
    (empty / "recordings").mkdir(exist_ok=True)
    for words, code, hint in (
        ((bare, other), 2, "different axes"),
        ((bare, bare), 2, "given twice"),
        ((bare, untold), 3, "nobody knows its load"),
        ((bare, empty), 3, "no complete recording"),
        ((), 2, "nothing to compare"),
        ((bare, tmp_path / "nowhere"), 3, "does not exist"),
    ):
        outcome = call("friction", "--compare", *words, "--no-pictures")
        assert outcome.exit_code == code, outcome.output
        assert hint in outcome.stderr
    without = tmp_path / "without"
    RunFolder.create(without, RIG).add_recording(complete.folder.recording("frf_1"))
    with pytest.raises(DataError, match=r"without.*constant-speed sweep"):
        api.friction_compare([without])


def test_one_run_is_told_once_more_without_a_machine(copy_of_complete: Copy) -> None:
    outcome = call("friction", "--compare", copy_of_complete(), "--json")
    (told,) = json_of(outcome)["runs"].values()
    assert told["friction"]["coulomb"]["value"] == pytest.approx(RIGS["g_a"].coulomb_total_nm, rel=0.05)
    assert told["standstill"]["seen"]["value"] > 10.0 * told["standstill"]["sweep"]["value"]
    assert "pictures/friction_standstill.png" in told["pictures"]
