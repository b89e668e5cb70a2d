"""A drift in a further record is survived once; a run that goes on later knows how much later; what a stop leaves in the journal."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml

from beltcomm import api
from beltcomm.axis import load_axis
from beltcomm.errors import SafetyStop
from beltcomm.excitation.choice import AS_CHOSEN
from beltcomm.experiments import commission, execute_step, recentre, recording_steps
from beltcomm.experiments.options import claim
from beltcomm.experiments.raising import _as_made
from beltcomm.experiments.recentre import bring_back, may_not_excite, stands_after
from beltcomm.identify.amplitude import AmplitudeStep, Prediction
from beltcomm.machine.machine import Machine
from beltcomm.model import load_plant
from beltcomm.recording.sidecar import ExcitationNote, Sidecar
from beltcomm.rundata.first_motions import Breakaway, Excited
from beltcomm.runfolder import RunFolder
from beltcomm.schedule.steps import Step
from beltcomm.talk import Silence
from session.bench import Bench, Listener
from session.hardware import HardwareBench

MakeBench = Callable[..., Bench]
Copy = Callable[..., Path]
AXIS = "egc-70-600"
YES = api.Options(yes=True, seed=1, resume=True)
#: N m, of the drive's torque setpoint: a thousandth of 1.43 N m.
STEP_NM = 1.43e-3


def drifting(*names: str) -> tuple[Listener, Callable[[Path], None]]:
    """A listener that stops these records by a limit, as a watch in the sink would."""
    where: list[Path] = []
    stopped: list[str] = []

    def stop(_phase: int, _fraction: float) -> None:
        for name in names:
            if (where[0] / "recordings" / f"{name}.csv.part").exists() and name not in stopped:
                stopped.append(name)
                raise SafetyStop(f"the carriage left its window in {name}", "position")

    return Listener(at_progress=stop), where.append


@pytest.mark.examination
@pytest.mark.usefixtures("fitted")
def test_one_drift_in_a_further_record_is_survived(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    """The carriage is brought back, the record made again with less torque, and the session goes on to its fit, where this test ends it."""
    run, bench = copy_of_complete("frf_3"), make_bench(start_m=0.2)
    listener, at = drifting("frf_3")
    at(run)
    places: list[float] = []

    def end(phase: int) -> None:
        if phase == 7:
            places.append(bench.carriage_m)
            raise KeyboardInterrupt

    listener.at_phase = end
    with pytest.raises(KeyboardInterrupt):
        api.commission(bench.name, AXIS, run, options=YES, talk=listener)
    journal = (run / "journal.txt").read_text(encoding="utf-8")
    said = re.search(r"safety stop \(position\): the carriage left its window in frf_3; the carriage stands at ([\d.]+) m", journal)
    assert said is not None
    (place,) = places
    frf_3 = RunFolder.open(run).recordings_folder / "frf_3.yaml"
    again = yaml.safe_load(frf_3.read_text(encoding="utf-8"))
    assert place == pytest.approx(float(again["start_position_m"]), abs=5e-3)
    before = yaml.safe_load((frf_3.parent / "frf_3.unfinished1.yaml").read_text(encoding="utf-8"))
    asked = [float(nm) for nm in re.findall(r"frf_3: .*; ±([\d.]+) N m, limited by", journal)]
    assert asked[-1] == pytest.approx(0.7 * asked[-2], rel=0.01)
    made = [float(note["excitation"]["amplitude_nm"]) for note in (before, again)]
    assert made == pytest.approx(asked[-2:], abs=1.2 * STEP_NM + 5e-4), "a step of the drive more, the mean taken away, three digits"
    assert frf_3.with_suffix(".csv").is_file()
    assert bench.stands_disabled()
    assert bench.parameters() == bench.initial


class Standing:
    """What of a machine :mod:`beltcomm.experiments.recentre` looks at."""

    def __init__(self, *places_m: float) -> None:
        self.places, self.lines, self.wanderings, self.talk = list(places_m), list[str](), 0, Listener()
        self.drive = SimpleNamespace(clock=SimpleNamespace(now=lambda: 0.0, sleep_until=lambda _t: None))
        self.folder, self.asked = SimpleNamespace(journal=self.lines.append), AS_CHOSEN

    @property
    def position_m(self) -> float:
        return self.places.pop(0) if len(self.places) > 1 else self.places[0]

    def envelope(self) -> Any:
        return SimpleNamespace(window_m=(0.0, 0.5))


def test_what_a_session_goes_on_after(monkeypatch: pytest.MonkeyPatch) -> None:
    moved: list[tuple[float, float]] = []
    monkeypatch.setattr(recentre.phases, "move_to", lambda _machine, target, _model, speed: moved.append((target, speed)))
    monkeypatch.setattr(recentre.phases, "stroke_ends", lambda _machine: (0.03, 0.47))
    response, strokes = Step("response", place=0.5), Step("strokes", place=0.5)
    drift, model = SafetyStop("too far", "position"), load_plant("g_b").model

    def survived(step: Step, problem: Any, *places_m: float) -> bool:
        return bring_back(Standing(*places_m), model, step, problem)  # type: ignore[arg-type]

    assert survived(response, drift, 0.27, 0.27)
    assert moved == [(0.25, recentre.BACK_M_S)]
    assert not survived(response, drift, *(0.27 + 0.002 * number for number in range(6)))  # it does not stand
    assert not survived(response, drift, 0.51, 0.51)  # outside the travel
    assert not survived(strokes, drift, 0.27, 0.27)  # in closed loop
    for reason in ("torque", "speed", "belt force", "released", "heat", "lag"):
        assert not survived(response, SafetyStop("stopped", reason), 0.27, 0.27)


def test_stops_are_counted_and_said() -> None:
    machine: Any = Standing(*[0.27] * 6)
    seen = []
    for _ in range(3):
        assert stands_after(machine, SafetyStop("too far", "position"))
        seen.append(may_not_excite(machine))
    assert seen == [False, False, True]
    assert [re.findall(r"stop (\d) of (\d)", line) for line in machine.talk.said] == [[("1", "3")], [("2", "3")], [("3", "3")]]
    assert not stands_after(machine, SafetyStop("too fast", "speed"))
    assert machine.wanderings == 3, "of a carriage that went too far only"


def recorded(monkeypatch: pytest.MonkeyPatch, stopped: str, problem: SafetyStop, before: int = 0) -> tuple[list[str], list[str], Any]:
    """Records that a programme tries, its remarks and its machine, where one of them is stopped each time.   before : stops until then."""
    made: list[str] = []

    def make(_machine: Any, _loop: Any, _step: Step, name: str, *_: Any) -> None:
        made.append(name)
        if name == stopped:
            raise problem

    monkeypatch.setattr(recentre.phases, "move_to", lambda *_: None)
    monkeypatch.setattr(recentre.phases, "stroke_ends", lambda _machine: (0.03, 0.47))
    monkeypatch.setattr(execute_step, "make", make)
    monkeypatch.setattr(execute_step, "course_of", lambda *_: SimpleNamespace(place_m=lambda step: step.place))
    monkeypatch.setattr(execute_step, "is_measured", lambda *_: False)
    monkeypatch.setattr(recording_steps.bounds, "has_room", lambda *_: True)
    monkeypatch.setattr(recording_steps.bounds, "seconds_of", lambda *_: 1.0)
    monkeypatch.setattr(recording_steps, "delay", lambda _findings: 0.0)
    machine: Any = Standing(*[0.27] * 6)
    machine.begin, machine.stroking, machine.axis = (lambda _title: None), (lambda: "position"), SimpleNamespace(torque_limit_nm=1.0)
    machine.folder.finished_names = list
    machine.wanderings = before
    findings: Any = SimpleNamespace(remarks=[], calibrating_s=0.0, excited=None, final=None)
    model: Any = None
    recording_steps.record_steps(machine, findings, model, model, "standard")
    return made, findings.remarks, machine


@pytest.mark.parametrize(("before", "tries"), [(0, 3), (1, 2), (2, 1)], ids=["none before", "one before", "two before"])
def test_the_third_stop_of_a_session_leaves_its_place_out_with_all_responses_after_it(
    monkeypatch: pytest.MonkeyPatch, before: int, tries: int
) -> None:
    """What was measured at the first place makes a result; it says where nothing was measured.   before : stops of the first response."""
    made, remarks, machine = recorded(monkeypatch, "frf_2", SafetyStop("too far", "position"), before)
    assert made.count("frf_2") == tries
    assert machine.wanderings == 3
    assert not [name for name in made if name.startswith("frf_") and name != "frf_2"]
    assert "sweep" in made
    assert len([text for text in remarks if "left out" in text]) >= 3


@pytest.mark.parametrize("reason", ["lag", "position"])
def test_a_record_that_a_weak_loop_never_follows_is_left_out_where_nothing_rests_on_it(
    monkeypatch: pytest.MonkeyPatch, reason: str
) -> None:
    """As seen at 931: after ten records the way to the last of them ended the whole session."""
    made, remarks, _ = recorded(monkeypatch, "moves_1", SafetyStop("behind", reason))
    assert made.count("moves_1") == 4
    assert "sweep_2" in made
    assert [text for text in remarks if re.match(r"moves_1 .* was left out: behind", text)]
    with pytest.raises(SafetyStop, match="behind"):
        recorded(monkeypatch, "sweep", SafetyStop("behind", reason))
    with pytest.raises(SafetyStop, match="hot"):
        recorded(monkeypatch, "moves_1", SafetyStop("hot", "heat"))


@pytest.mark.parametrize(
    ("before", "stops", "reason", "friction_nm", "amplitudes_nm"),
    [
        (0, 1, "position", 0.05, [0.3, 0.21]),
        (0, 2, "position", 0.05, [0.3, 0.21, 0.147]),
        (0, 3, "position", 0.05, [0.3, 0.21, 0.147]),
        (1, 2, "position", 0.05, [0.3, 0.21]),  # the search was stopped before
        (0, 1, "speed", 0.05, [0.3]),
        (0, 2, "position", 0.3, [0.7, 0.3, 0.21]),  # held by friction: at first with a sequence that may be louder, then not any more
    ],
)
def test_a_first_response_that_wanders_is_made_again_with_less_torque(
    monkeypatch: pytest.MonkeyPatch, before: int, stops: int, reason: str, friction_nm: float, amplitudes_nm: list[float]
) -> None:
    made: list[float] = []

    def respond(_machine: Any, name: str, _model: Any, _choice: Any, step: AmplitudeStep) -> None:
        assert name == "frf_1"
        made.append(round(step.amplitude_nm, 6))
        if len(made) <= stops:
            raise SafetyStop("too far", reason)

    def loudest(_machine: Any, _model: Any, _choice: Any, at_most_nm: float, *_: Any) -> AmplitudeStep:
        bound = 0.3 if at_most_nm < 2.0 else 0.7  # of the usual sequence, and of the one without the resonance
        return AmplitudeStep(min(at_most_nm, bound), Prediction(0.0, 0.0, 0.0, 0.0), "belt force")

    phases = commission.phases
    monkeypatch.setattr(phases, "planned_response", respond)
    monkeypatch.setattr(phases, "_loudest", loudest)
    monkeypatch.setattr(phases, "motion_limits", lambda *_: None)
    monkeypatch.setattr(phases, "total_friction", lambda _model: friction_nm)
    monkeypatch.setattr(phases.analyse, "characteristic_hz", lambda *_: (40.0, 90.0))
    excited = Excited(AmplitudeStep(0.5, Prediction(0.0, 0.0, 0.0, 0.0), "belt force"), (), load_plant("g_b").model, 0.4)
    findings: Any = SimpleNamespace(remarks=[], excited=excited, breakaway=Breakaway(0.05, 0.05))
    machine: Any = Standing(*[0.27] * 20)
    machine.drive.capabilities = SimpleNamespace(sample_period_s=1e-3)
    machine.excitation, machine.axis, machine.wanderings = "prbs", SimpleNamespace(torque_limit_nm=2.0), before
    ends = reason != "position" or before + stops >= recentre.MOST_STOPS
    with pytest.raises(SafetyStop) if ends else nullcontext():
        commission._first_response(machine, findings, "frf_1", 5.0)
    assert made == amplitudes_nm
    assert len(findings.remarks) == len(amplitudes_nm) - 1
    if findings.remarks:
        assert findings.excited.step.amplitude_nm == pytest.approx(made[-1]), "no record after it is louder"


@pytest.mark.parametrize(("wanderings", "loud"), [(0, True), (1, False)])
def test_after_a_stop_there_is_no_other_sequence_that_is_louder(monkeypatch: pytest.MonkeyPatch, wanderings: int, loud: bool) -> None:
    asked: dict[str, Any] = {}
    monkeypatch.setattr(execute_step.phases, "move_to", lambda *_: None)
    monkeypatch.setattr(execute_step.phases, "frequency_response", lambda *at, **by: asked.update(by, amplitude_nm=at[3]))
    folder = SimpleNamespace(finished=lambda _name: None)
    machine: Any = SimpleNamespace(envelope=lambda: SimpleNamespace(window_m=(0.0, 1.0)), folder=folder, wanderings=wanderings)
    model: Any = None  # nobody asks it anything
    execute_step._respond(machine, model, Step("response", place=0.5, share=1.0), "frf_2", 0.4, 0.7)
    assert asked == {"amplitude_nm": 0.4, "share": 0.7, "held_out": False, "loud": loud, "up_to_hz": 0.0, "above_nm": 0.0}


def test_less_torque_is_less_than_what_the_place_allows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not less than what the loudest place did: where a limit binds already that would be as much as before."""
    made: list[float] = []

    def loudest(_machine: Any, _model: Any, amplitude_nm: float, **_: Any) -> tuple[None, AmplitudeStep]:
        return None, AmplitudeStep(min(amplitude_nm, 0.2), Prediction(0.0, 0.0, 0.0, 0.0), "belt force")

    phases = commission.phases
    monkeypatch.setattr(phases, "response_to_come", loudest)
    monkeypatch.setattr(phases, "planned_response", lambda *given, **_: made.append(given[4].amplitude_nm))
    machine: Any = None
    for share in (1.0, 0.7):
        phases.frequency_response(machine, "frf_2", load_plant("g_b").model, 0.4, 5.0, share=share)
    assert made == pytest.approx([0.2, 0.14])


def test_a_run_that_goes_on_later_knows_how_much_later(connect: Callable[[Bench], Bench], tmp_path: Path) -> None:
    bench, now = connect(HardwareBench()), [1_000_000.0]
    axis = load_axis(AXIS)
    with bench.open(bench.name) as drive:
        folder = RunFolder.create(tmp_path / "run", axis)
        claim(folder, drive.capabilities, api.Options(wall_clock=lambda: now[0]), Listener())
        with Machine(drive, axis, folder, Silence()) as machine:
            assert machine.session_time_s == pytest.approx(0.0, abs=0.1)
        now[0] += 3600.0
        later, talk = RunFolder.open(tmp_path / "run"), Listener()
        claim(later, drive.capabilities, api.Options(wall_clock=lambda: now[0]), Listener())
        with Machine(drive, axis, later, talk) as machine:
            assert machine.session_time_s == pytest.approx(3600.0, abs=0.1)
        assert any("This run began 60 min ago" in line and "nobody knows" in line for line in talk.said)
        now[0] -= 10_000.0  # set back
        claim(again := RunFolder.open(tmp_path / "run"), drive.capabilities, api.Options(wall_clock=lambda: now[0]), Listener())
        assert again.elapsed_s == 0.0


def test_a_virtual_drive_is_cold_at_every_command(make_bench: MakeBench, tmp_path: Path) -> None:
    bench, axis = make_bench(), load_axis(AXIS)
    with bench.open(bench.name) as drive:
        claim(RunFolder.create(tmp_path / "run", axis), drive.capabilities, api.Options(wall_clock=lambda: 5.0), Listener())
        claim(folder := RunFolder.open(tmp_path / "run"), drive.capabilities, api.Options(wall_clock=lambda: 5000.0), Listener())
    assert folder.elapsed_s == 0.0
    assert "began_s" not in (tmp_path / "run" / "run.yaml").read_text(encoding="utf-8")


def test_without_a_clock_nothing_is_claimed(connect: Callable[[Bench], Bench], tmp_path: Path) -> None:
    bench = connect(HardwareBench())
    with bench.open(bench.name) as drive:
        folder = RunFolder.create(tmp_path / "run", load_axis(AXIS))
        claim(folder, replace(drive.capabilities), api.Options(), Listener())
    assert folder.elapsed_s == 0.0


@pytest.mark.parametrize(("own_nm", "binds"), [(0.1, "step"), (0.17, "belt force")])
def test_a_kept_record_is_judged_by_the_amplitude_of_its_sidecar(own_nm: float, binds: str) -> None:
    """A quiet record of the first session, in which the motor hardly moved, is not taken for one as loud as is allowed today."""
    planned = AmplitudeStep(0.18, Prediction(0.01, 60.0, 0.2, 0.3, 0.01), "belt force")
    record = SimpleNamespace(sidecar=Sidecar("frf", excitation=ExcitationNote("prbs", own_nm)))
    found = _as_made(planned, record)  # type: ignore[arg-type]
    assert (found.amplitude_nm, found.binds) == (own_nm, binds)
    assert _as_made(planned, SimpleNamespace(sidecar=Sidecar("frf"))) is planned  # type: ignore[arg-type]
