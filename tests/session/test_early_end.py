"""A session that cannot go on tells what its records show, once per set of them, and never hides why it ended."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from beltcomm.axis import load_axis
from beltcomm.errors import BusError, DataError, Declined, NoMotion, Refused, SafetyStop
from beltcomm.excitation import prbs
from beltcomm.experiments import execute_step, payload_mode_in_first_fit
from beltcomm.experiments.options import Options
from beltcomm.jobs import early_end
from beltcomm.machine import scale
from beltcomm.model import load_plant
from beltcomm.recording import ExcitationNote, Recording, Sidecar
from beltcomm.result import Result
from beltcomm.runfolder import RunFolder
from beltcomm.schedule.steps import Step
from beltcomm.simulate.forward import simulate_torque
from beltcomm.talk import Silence

FOUND = {"found": "backlash", "check": "hold the motor", "verdict": "explained", "named": ["backlash"]}


def excited(name: str, amplitude_nm: float, gap_m: float, seed: int) -> Recording:
    """PRBS of rig G_A with a gap, counted angle, 6 mN m of noise."""
    model = load_plant("g_a").model.with_effect("backlash", {"gap": gap_m})
    signal = prbs(9, 2, 2.0 * amplitude_nm, 1e-3, 2)
    moved = simulate_torque(model, signal.torque, 1e-3, 0.25)
    step = math.tau / 65536
    angle = np.floor(moved.position_rad / step + 0.5) * step
    noise = 6e-3 * np.random.default_rng(seed).standard_normal(len(angle))
    note = ExcitationNote("prbs", amplitude_nm, signal.period_samples, signal.first_sample)
    return Recording(name, moved.t_s, signal.torque + noise, angle, sidecar=Sidecar("frf", 0.25, excitation=note))


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    made = RunFolder.create(tmp_path / "run", load_axis("egc-70-600"))
    made.add_recording(excited("amplitude_1", 0.3, 2e-4, 1))
    return made


@pytest.mark.examination
def test_the_gap_in_the_records_of_a_session_that_cannot_go_on_is_named(folder: RunFolder) -> None:
    folder.add_recording(excited("frf_1", 0.5, 2e-4, 2))
    told = early_end._early_end(folder, SafetyStop("50 mm off its reference", "lag"), Silence())
    assert told is not None
    assert told["named"][0] == "backlash"
    assert set(told["named"]) <= {"backlash", "cart_friction"}, "the rig has that, too"
    assert str(told["found"]).startswith("backlash (backlash.gap 0.0002")
    assert "by hand" in str(told["check"])
    kept = (folder.path / "verdict.txt").read_text(encoding="utf-8")
    assert kept.startswith("Not finished: 50 mm off its reference\nFound: backlash")
    assert f"Next: beltcomm diagnose {folder.path}" in kept


def test_searched_once_per_set_of_records(folder: RunFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    monkeypatch.setattr(early_end, "_search", lambda *_: asked.append(1) or dict(FOUND))
    ends = [early_end._early_end(folder, Refused("no"), Silence()) for _ in range(2)]
    assert [end["repeated"] for end in ends if end is not None] == [False, True]
    assert asked == [1]
    folder.add_recording(excited("amplitude_2", 0.4, 2e-4, 2))
    further = early_end._early_end(folder, Refused("no"), Silence())
    assert further is not None
    assert not further["repeated"]
    assert asked == [1, 1]


@pytest.mark.parametrize("trouble", [DataError("damaged"), ZeroDivisionError("oops")])
def test_a_search_that_fails_hides_nothing(folder: RunFolder, monkeypatch: pytest.MonkeyPatch, trouble: Exception) -> None:
    def broken(*_: object, **__: object) -> Any:
        raise trouble

    monkeypatch.setattr("beltcomm.jobs.effect_search.search_of", broken)
    told = early_end._early_end(folder, Refused("no"), Silence())
    assert told is not None
    assert str(told["found"]).startswith("cannot tell")
    assert told["command"] == f"beltcomm diagnose {folder.path}"


def test_whoever_does_not_wait_hears_why_the_session_ended(folder: RunFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken_off(*_: object) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr(early_end, "_search", broken_off)
    assert early_end._early_end(folder, Refused("no"), Silence()) is None


@pytest.mark.parametrize(
    ("problem", "told"),
    [
        (Refused("friction"), True),
        (SafetyStop("50 mm", "lag"), True),
        (SafetyStop("let go", "interrupted"), False),
        (Declined("no"), False),
        (BusError("nobody answers"), False),
    ],
)
@pytest.mark.parametrize("begun", [True, False])
def test_only_what_the_axis_did_is_searched(
    folder: RunFolder, monkeypatch: pytest.MonkeyPatch, problem: Any, told: bool, begun: bool
) -> None:
    """And only after its phases began: a drive without a reference says nothing of the records of yesterday."""
    monkeypatch.setattr(early_end, "_search", lambda *_: dict(FOUND))

    @early_end.searched
    def job(*, options: Options) -> Result:
        problem.run = folder.path if begun else None
        raise problem

    problem.diagnosis = None
    for search, expected in ((False, False), (True, told and begun)):
        with pytest.raises(type(problem)) as caught:
            job(options=Options(search=search))
        assert caught.value is problem
        assert (problem.diagnosis is not None) is expected


def test_a_record_without_motion_says_what_that_means() -> None:
    t_s = 1e-3 * np.arange(2000)
    torque = 0.18 * np.sign(np.sin(40.0 * t_s) + 0.1)
    with pytest.raises(NoMotion, match=r"did not move, 0\.18 N m at most in 2 s did not break it away: friction, a brake") as caught:
        Recording("frf_2", t_s, torque, np.full(2000, 15.18))
    assert caught.value.torque_nm == pytest.approx(0.18)


def asked_of(monkeypatch: pytest.MonkeyPatch, moves_from_nm: float, share: float = 1.0) -> list[float]:
    """Amplitudes that a step tries on an axis that moves from one on."""
    tried: list[float] = []

    def respond(*at: Any, above_nm: float, **_: Any) -> None:
        amplitude = min(at[3], 0.6)
        if amplitude <= 1.05 * above_nm:
            raise NoMotion("the limits allow no more", above_nm)
        tried.append(amplitude)
        if amplitude < moves_from_nm:
            raise NoMotion("nothing moved", amplitude)

    monkeypatch.setattr(execute_step.phases, "move_to", lambda *_: None)
    monkeypatch.setattr(execute_step.phases, "frequency_response", respond)
    here = SimpleNamespace(window_m=(0.0, 1.0))
    folder, talk = SimpleNamespace(finished=lambda _name: None), Silence()
    machine: Any = SimpleNamespace(envelope=lambda: here, folder=folder, wanderings=0, talk=talk)
    model: Any = None  # nobody asks it anything
    try:
        execute_step._respond(machine, model, Step("response", share=1.0), "frf_2", 0.2, share)
    except NoMotion:
        tried.append(math.inf)
    return tried


def test_an_excitation_that_does_not_move_the_axis_is_made_louder_within_the_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    assert asked_of(monkeypatch, 0.1) == [0.2]
    assert asked_of(monkeypatch, 0.3) == pytest.approx([0.2, 0.34])
    assert asked_of(monkeypatch, 0.7) == pytest.approx([0.2, 0.34, 0.578, math.inf])
    assert asked_of(monkeypatch, 0.3, share=0.7) == pytest.approx([0.2, math.inf]), "louder let the carriage go too far"


def test_no_loop_is_closed_on_a_carriage_that_weighs_nothing() -> None:
    """As a fit on a slack belt ends; nor is a payload looked for that swings on it."""
    model = load_plant("g_a").model.with_values({"cart.mass": 1.01e-3})
    with pytest.raises(Refused, match=r"by frf_1 the carriage weighs 1 g: the motor turns as if nothing hung on it"):
        scale.check_fitted(
            SimpleNamespace(more_room="more room", axis=load_axis("egc-70-600")),  # type: ignore[arg-type]
            model,
            model,
            SimpleNamespace(name="frf_1"),  # type: ignore[arg-type]
        )
    assert not list(payload_mode_in_first_fit._starts(model))
