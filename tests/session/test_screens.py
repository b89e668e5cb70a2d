"""One screen to ask, one to watch, one to answer: 80 x 24, for every shipped axis and drive, and for runs that fail or end early."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from beltcomm import language
from beltcomm.axis import load_axis
from beltcomm.axis.entries import AxisTargets
from beltcomm.cli.display import Display, Pace
from beltcomm.cli.frame import Invocation, _left_lines
from beltcomm.cli.terminal import console_of, echo
from beltcomm.configfiles import config_names
from beltcomm.drive import open_drive
from beltcomm.errors import SafetyStop
from beltcomm.experiments.commission import identify_here
from beltcomm.experiments.plan import commission_plan, identify_plan
from beltcomm.experiments.plan_screen import plan_screen
from beltcomm.machine.heat import Thermal
from beltcomm.result import plain
from beltcomm.rundata.first_motions import Breakaway
from beltcomm.rundata.headline import headline_of
from beltcomm.rundata.store import cascade_from_dict
from beltcomm.runfolder import RunFolder
from beltcomm.sentences import outcome, screens
from beltcomm.sentences.words import SHOWN
from beltcomm.talk import CarriagePosition, Gauge
from session.conftest import Complete

WIDE, HIGH = 80, 24
CONTROL = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def shown(lines: list[str], monkeypatch: pytest.MonkeyPatch, columns: int = WIDE) -> list[str]:
    """What stands on a terminal."""
    monkeypatch.setenv("COLUMNS", str(columns))
    monkeypatch.setenv("TERM", "xterm-256color")
    stream = Terminal()
    echo(lines, stream)
    return CONTROL.sub("", stream.getvalue()).splitlines()


@pytest.mark.parametrize("profile", ["", "cmmp-as"])
@pytest.mark.parametrize("name", config_names("axes"))
def test_the_plan_is_a_screen_with_its_question(name: str, profile: str, monkeypatch: pytest.MonkeyPatch) -> None:
    axis = load_axis(name)
    with open_drive("virtual:g_a", {"seed": 1, **({"profile": profile} if profile else {})}) as drive:
        for plan in (commission_plan(axis, drive.capabilities), identify_plan(axis, drive.capabilities, (-0.02, 0.03))):
            plan = replace(plan, thermal=Thermal.of(axis, drive.capabilities))
            told = plan_screen(plan, axis, drive.capabilities)
            assert max(map(len, told)) <= WIDE
            lines = shown([*told, "  the question"], monkeypatch)
            assert len(lines) <= HIGH
            assert max(map(len, lines)) <= WIDE
            text = "\n".join(lines)
            most = max(e.speed_m_s for e in plan.experiments)
            for word in ("WILL MOVE", f"up to {most:.3g} m/s", "belt force", "Ctrl-C", "bus or PC lost", f"{plan.seconds:.0f} s in motion"):
                assert word in text


@pytest.mark.parametrize("name", config_names("axes"))
def test_screen_and_details_of_a_plan_have_one_belt_force(name: str) -> None:
    axis = load_axis(name)
    with open_drive("virtual:g_a", {"seed": 1}) as drive:
        plan = commission_plan(axis, drive.capabilities)
        screen, details = "\n".join(map(str, plan_screen(plan, axis, drive.capabilities))), "\n".join(map(str, plan.lines()))
    (up_to,) = re.findall(r"belt force +up to ([\d.]+) N", screen) or [""]
    assert re.findall(r"([\d.]+) N in the belt", details)[:1] == [up_to]
    assert f"{up_to} N" in details.replace(f"{up_to} N in the belt", "", 1), "the row of the experiment that loads it most"
    limit = re.findall(r"belt force .*(?:axis|pulley) limit ([\d.]+) N", screen)
    assert float(up_to) <= float(limit[0])


@pytest.mark.parametrize("columns", [100, 80, 40])
def test_the_live_display_is_a_screen(columns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """With everything that can be told at once."""
    monkeypatch.setenv("COLUMNS", str(columns))
    found = {"direction": "ok", "breakaway": "142 mN m (11.4 N)", "mass": "13.4 kg", "resonance": "107 Hz", "following error": "0.136 mm"}
    display = Display("6/9", "strokes, responses, moves", Pace(lambda: 0.0), lambda: 0.0, found)
    gauges = (Gauge("torque", -3.0, 3.1, "N m"), Gauge("belt", 99.0, 99.8, "N"), Gauge("speed", 0.2, 0.5, "m/s"))
    display.moving(CarriagePosition("friction_sweep_12", 0.281, (-0.01, 0.57), left_s=41.0, gauges=gauges))
    display.progress(0.5, 3.0)
    stream = Terminal()
    console_of(stream).print(display)
    lines = CONTROL.sub("", stream.getvalue()).splitlines()
    assert len(lines) <= (10 if columns >= WIDE else HIGH)
    assert max(map(len, lines)) <= columns
    text = " ".join(" ".join(lines).split())
    for word in ("6/9", "281 mm", "99", "Ctrl-C", "142 mN m", "13.4 kg"):
        assert word in text


class _Enough(Exception):
    """The first of what is found was told."""


@pytest.mark.parametrize(
    ("torque_nm", "told"), [(0.1424, "142 mN m (11.5 N)"), (0.00731, "7.31 mN m (0.589 N)"), (1.3, "1300 mN m (105 N)")]
)
def test_breakaway_is_told_in_the_unit_of_friction(torque_nm: float, told: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It stood in N m alone, beside tables of friction in mN m and a verdict in N."""

    def enough(*_: object) -> None:
        raise _Enough

    monkeypatch.setattr("beltcomm.experiments.phases.sign_and_scale", lambda _: Breakaway(torque_nm, torque_nm))
    monkeypatch.setattr("beltcomm.experiments.sameness.check_breakaway", enough)
    found: dict[str, str] = {}
    machine = SimpleNamespace(axis=load_axis("egc-70-600"), begin=lambda _: None, found=found.__setitem__)
    with pytest.raises(_Enough):
        identify_here(machine, SimpleNamespace())  # type: ignore[arg-type]
    assert found["breakaway"] == told
    assert f" {SHOWN['coulomb.level'][1]} (" in told


def answer(complete: Complete, findings: object, folder: RunFolder) -> list[str]:
    """The screen of a run that ended so."""
    return [*outcome.commission_text(folder, findings).screen, *outcome.closing(folder, findings, "can0", "Report: runs/x/report.html")]  # type: ignore[arg-type]


def test_the_verdict_is_a_screen_and_the_rest_in_details(complete: Complete, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = shown(list(complete.result.lines()), monkeypatch)
    assert len(lines) <= HIGH
    text = "\n".join(lines)
    for word in ("PASS", "bandwidth", "overshoot", "phase margin", "default target", "carriage", "its error is", "x the noise"):
        assert word in text
    assert "95 % intervals" not in text
    assert "95 % intervals" in "\n".join(complete.result.details)  # type: ignore[attr-defined]
    assert lines[-1].strip() == f"beltcomm open {complete.path}"


@pytest.mark.parametrize("spoken", ["en", "de"])
def test_everything_that_can_be_sent_along_fits_a_line(complete: Complete, spoken: str) -> None:
    """An offset beside inertia, friction and velocity ran over the edge."""
    cascade = cascade_from_dict(complete.folder.load("designs", "final"))
    language.use(spoken)
    lines = screens._gain_lines(replace(cascade, feedforward=replace(cascade.feedforward, offset_nm=0.02, velocity=1.0)))
    assert max(map(len, lines)) <= WIDE


@pytest.mark.parametrize("at", ["motor", "both"])
def test_a_failed_run_with_many_remarks_is_a_screen(complete: Complete, tmp_path: Path, at: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A missed target is named with value and limit, in the headline and in its row; nothing runs over the screen."""
    folder = RunFolder.create(tmp_path / "run", load_axis("egc-70-600"))
    for name in ("fit", "drive"):
        folder.save("results", name, RunFolder.open(complete.path).load("results", name))
    design = RunFolder.open(complete.path).load("designs", "final")
    folder.save("designs", "final", design)
    folder.save("models", "final", complete.final.fit.model.to_dict())
    verdict = complete.result.data["verdict"]
    verdict = replace(verdict, passed=False, targets=AxisTargets(following_error_m=1e-5, at=at))
    proof = {"proof": {"gains": design["parameters"], "further_payloads_kg": [], "path": [0.0, 0.5, 0.7]}}
    folder.save("results", "verify_move_1", {**plain(verdict), **proof})
    said = headline_of(folder)
    assert said.state == "fail"
    remarks = [f"the move was slowed down, because something long and winding number {k} happened on the way to it" for k in range(9)]
    text = [*screens.headline_lines(said), *screens.tracking_lines(verdict), *screens.warning_lines(remarks)]
    lines = shown(text, monkeypatch)
    assert len(lines) <= HIGH - 9  # axis, model, gains, loop, report and what is next come to 9 at most
    assert max(map(len, lines)) <= WIDE
    joined = " ".join(" ".join(lines).split())
    assert "allowed 0.01 mm" in joined
    assert "MISSED" in joined
    assert "your target" in joined
    assert "6 more notes" in joined


def test_an_aborted_run_is_a_screen_and_its_command_alone_on_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "recordings").mkdir()
    (tmp_path / "recordings" / "frf_1.csv").touch()
    frame = Invocation(["commission", "--drive", "can0", "--run", str(tmp_path)])
    frame.run, frame.drive = tmp_path, "can0"
    problem = SafetyStop("the carriage is at 0.571 m, beyond 0.57 m; look at the travel in axis.yaml, and `beltcomm diagnose RUN`")
    left = frame._aftermath(problem)
    lines = shown([f"beltcomm: {problem}", *_left_lines(left)], monkeypatch, columns=200)
    assert len(lines) <= HIGH
    commands = [line.strip() for line in lines if line.strip().startswith("beltcomm ") and "safety" not in line]
    assert commands[-1] == f"beltcomm diagnose {tmp_path}"


@pytest.mark.parametrize("columns", [40, 60])
def test_narrow_screens_lose_no_number(complete: Complete, columns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    wide = shown(list(complete.result.lines())[:-1], monkeypatch)
    narrow = shown(list(complete.result.lines())[:-1], monkeypatch, columns)
    assert max(len(line) for line in narrow if str(complete.path) not in line) <= columns
    numbers = re.compile(r"\d+\.?\d*")
    assert sorted(numbers.findall(" ".join(narrow))) == sorted(numbers.findall(" ".join(wide)))
