"""The frame of the command line: exit codes, JSON, errors, suggestions, start-up time; a stand-in replaces the API."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from click.testing import CliRunner, Result

from beltcomm.cli.main import VERBS, cli
from beltcomm.design.specification import PRODUCT_SPECIFICATION
from beltcomm.errors import DataError, DriveError, DriveFault, Refused, SafetyStop, UsageError
from beltcomm.journal import Event, append


@dataclass
class Outcome:
    """A result as an API function returns it."""

    exit_code: int = 0

    def to_json(self) -> Mapping[str, Any]:
        return {"verdict": "pass", "error_m": float("nan"), "path": Path("a")}

    def lines(self) -> Iterable[str]:
        return ["Verdict: pass"]


@dataclass(frozen=True)
class Options:
    """Every option that a verb may pass on."""

    yes: bool = False
    seed: int = 0
    dry_run: bool = False
    resume: bool = False
    position_m: float | None = None
    window_m: tuple[float, float] | None = None
    home: bool = False
    payload_kg: float | None = None
    apply: str = "restore"
    quick: bool = False
    thorough: bool = False
    visible: bool = False
    excitation: str = "prbs"
    loop: str = "open"
    base_speed_m_s: float | None = None
    pictures: bool = True
    report: bool = True
    search: bool = False
    force: bool = False
    prefilter: str | None = None
    feedforward: str | None = None
    order: str | None = None
    repeat: int | None = None
    mounted_kg: float | None = None
    profile: str | None = None
    node: int | None = None
    bitrate: int | None = None
    realtime: bool = False
    sample_period_s: float | None = None
    first_motion: str | None = None
    hold: object = field(default=None, compare=False)
    simulate_first: bool = False
    wall_clock: object = field(default=None, compare=False)
    drive: dict[str, Any] = field(default_factory=dict, compare=False)


class StandIn(ModuleType):
    """``beltcomm.api`` that remembers its calls, does what ``during`` says, and answers with ``answer``, or raises it."""

    Options = Options

    def __init__(self) -> None:
        super().__init__("beltcomm.api")
        self.calls: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = []
        self.answer: Outcome | BaseException = Outcome()
        self.during: Callable[[], object] = lambda: None

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)

        def function(*args: Any, **kwargs: Any) -> Outcome:
            self.calls.append((name, args, kwargs))
            self.during()
            if isinstance(self.answer, BaseException):
                raise self.answer
            return self.answer

        return function


@pytest.fixture
def api(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> StandIn:
    stand_in = StandIn()
    for name in (
        "beltcomm.api", "beltcomm.pages", "beltcomm.experiments.options", "beltcomm.jobs.laboratory", "beltcomm.jobs.fit",
        "beltcomm.jobs.friction_compare", "beltcomm.jobs.convert", "beltcomm.jobs.export", "beltcomm.jobs.watch", "beltcomm.jobs.bundle",
        "beltcomm.thesis.topics", "beltcomm.jobs.trajectory", "beltcomm.foreign.job", "beltcomm.jobs.change",
    ):  # fmt: skip
        monkeypatch.setitem(sys.modules, name, stand_in)
    monkeypatch.chdir(tmp_path)
    return stand_in


def call(*words: str, answer: str | None = None) -> Result:
    return CliRunner().invoke(cli, list(words), input=answer)


def test_options_reach_the_api(api: StandIn) -> None:
    words = "--drive virtual:g_a --run R --yes --seed 7 --dry-run --home --position 250mm --payload 11.2 --apply save --quick --visible"
    drive_words = "--profile cmmp-as --node 3 --bitrate 500000 --realtime"
    outcome = call("commission", *words.split(), *drive_words.split())
    assert outcome.exit_code == 0, outcome.stderr
    name, (drive, axis, run), given = api.calls[0]
    assert (name, drive, axis.name, run) == ("commission", "virtual:g_a", "EGC-70-600", Path("R"))
    assert given["options"] == Options(
        yes=True, seed=7, dry_run=True, home=True, position_m=0.25, payload_kg=11.2, apply="save", quick=True, visible=True,
        profile="cmmp-as", node=3, bitrate=500000, realtime=True, search=True,
    )  # fmt: skip
    assert outcome.stdout == "Verdict: pass\n"


@pytest.mark.parametrize(
    ("words", "options"),
    [
        ("design R --prefilter notch --feedforward linear", Options(prefilter="notch", feedforward="linear")),
        ("verify --drive can0 --run R --feedforward none", Options(feedforward="none")),
        ("friction --drive can0 --run R --order iii --repeat 3 --payload-mounted 11200g", Options(order="III", repeat=3, mounted_kg=11.2)),
        ("commission --drive virtual --prefilter none", Options(prefilter="none", search=True)),
    ],
)
def test_the_parts_of_the_controller_can_be_chosen(api: StandIn, words: str, options: Options) -> None:
    assert call(*words.split()).exit_code == 0
    assert api.calls[0][2]["options"] == options


def test_sweeps_are_compared_without_a_machine(api: StandIn) -> None:
    assert call("friction", "--compare", "A", "B", "--no-pictures").exit_code == 0
    name, args, given = api.calls[0]
    assert (name, args, given["pictures"]) == ("friction_compare", ((Path("A"), Path("B")),), False)


def test_what_is_not_given_is_left_to_the_api(api: StandIn) -> None:
    call("friction", "--drive", "virtual", "--run", "R")
    assert api.calls[0][2]["options"] == Options()


@pytest.mark.parametrize(
    ("words", "name", "args", "given"),
    [
        (["fit", "R", "--solver", "trf"], "fit", (Path("R"),), {"solver": "trf", "model": "two-mass"}),
        (["fit", "R", "--model", "three-mass"], "fit", (Path("R"),), {"model": "three-mass"}),
        (["design", "R"], "design", (Path("R"),), {"specification": None}),
        (
            ["design", "R", "--phase-margin", "60", "--suppression", "-12", "--position-phase-margin", "75"],
            "design",
            (Path("R"),),
            {"specification": replace(PRODUCT_SPECIFICATION, phase_margin_deg=60.0, suppression_db=-12.0, position_phase_margin_deg=75.0)},
        ),
        (["verify", "--drive", "can0", "--run", "R", "--move", "m.csv"], "verify", ("can0", Path("R")), {"move": Path("m.csv")}),
        (["apply", "--drive", "can0", "--run", "R"], "apply", ("can0", Path("R")), {}),
        (["rollback", "--drive", "can0", "--run", "R"], "rollback", ("can0", Path("R")), {}),
    ],
)
def test_each_verb_calls_its_function(api: StandIn, words: list[str], name: str, args: tuple[Any, ...], given: dict[str, Any]) -> None:
    assert call(*words).exit_code == 0
    called, called_args, called_given = api.calls[0]
    assert (called, called_args) == (name, args)
    assert given.items() <= called_given.items()


@pytest.mark.parametrize(
    ("text", "window_m"),
    [("-20mm..30mm", (-0.02, 0.03)), ("-20..30 mm", (-0.02, 0.03)), ("25mm", (-0.025, 0.025)), ("-0.02..0.03", (-0.02, 0.03))],
)
def test_identify_takes_a_window(api: StandIn, text: str, window_m: tuple[float, float]) -> None:
    assert call("identify", "--drive", "virtual", "--window", text, "--run", "R").exit_code == 0
    assert api.calls[0][2]["options"].window_m == pytest.approx(window_m)


def test_move_and_simulate_take_quantities_and_plants(api: StandIn) -> None:
    assert call("move", "--drive", "virtual", "--by", "-5 mm").exit_code == 0
    assert api.calls[0][1][2] == pytest.approx(-0.005)
    assert call("simulate", "g_a", "--experiment", "friction_sweep", "--run", "R").exit_code == 0
    assert (api.calls[1][1][0], api.calls[1][1][2], api.calls[1][2]["experiment"]) == ("g_a", Path("R"), "friction_sweep")


def test_without_run_there_is_a_dated_folder(api: StandIn) -> None:
    call("identify", "--drive", "virtual")
    assert api.calls[0][1][2].match("runs/egc-70-600-[0-9]*-[0-9]*")


def test_a_real_drive_needs_an_axis_file(api: StandIn) -> None:
    outcome = call("commission", "--drive", "can0")
    assert outcome.exit_code == 2
    assert "--axis is needed" in outcome.stderr
    assert api.calls == []


def test_resume_takes_the_axis_of_the_run(api: StandIn, tmp_path: Path) -> None:
    (tmp_path / "R").mkdir()
    (tmp_path / "R" / "axis.yaml").write_text("name: mine\n", encoding="utf-8")
    assert call("commission", "--drive", "can0", "--run", "R", "--resume").exit_code == 0
    assert (api.calls[0][1][1].name, api.calls[0][2]["options"].resume) == ("mine", True)


def test_json_is_one_object_on_stdout(api: StandIn) -> None:
    outcome = call("commission", "--drive", "virtual", "--json")
    assert json.loads(outcome.stdout) == {"verdict": "pass", "error_m": None, "path": "a"}
    assert outcome.stdout.count("\n") == 1


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (Refused("the design is infeasible"), 1),
        (UsageError("the limit is wrong"), 2),
        (DataError("the record is clipped"), 3),
        (SafetyStop("the travel window was left"), 4),
        (DriveFault("overcurrent", 0x2310), 5),
    ],
)
def test_errors_are_a_sentence_and_a_code(api: StandIn, error: Exception, code: int) -> None:
    api.answer = error
    outcome = call("commission", "--drive", "virtual", "--json")
    assert outcome.exit_code == code
    assert json.loads(outcome.stdout) == {"error": str(error), "exit_code": code}
    assert outcome.stderr == f"beltcomm: {error}\n"
    assert call("commission", "--drive", "virtual").stdout == ""


def test_a_missed_target_is_exit_code_1(api: StandIn) -> None:
    api.answer = Outcome(exit_code=1)
    outcome = call("verify", "--drive", "virtual", "--run", "R")
    assert (outcome.exit_code, outcome.stdout) == (1, "Verdict: pass\n")


def test_ctrl_c_is_exit_code_4(api: StandIn, tmp_path: Path) -> None:
    api.answer = KeyboardInterrupt()
    (tmp_path / "R").mkdir()
    outcome = call("friction", "--drive", "virtual", "--run", "R")
    assert outcome.exit_code == 4
    assert "interrupted; what was recorded is kept in R" in outcome.stderr


@pytest.mark.parametrize(
    ("last", "words"),
    [
        ("restored", "interrupted; the axis is stopped and the drive's own gains are restored; what was recorded"),
        ("not restored", "gains are NOT restored: `beltcomm rollback` writes them again"),
    ],
)
def test_ctrl_c_says_how_the_drive_was_left(api: StandIn, tmp_path: Path, last: Event, words: str) -> None:
    api.answer = KeyboardInterrupt()
    (tmp_path / "R").mkdir()
    api.during = lambda: append(tmp_path / "R", "so it was left", last, "")
    outcome = call("friction", "--drive", "virtual", "--run", "R")
    assert outcome.exit_code == 4
    assert words in outcome.stderr


@pytest.mark.parametrize(
    ("error", "last", "drive", "following"),
    [
        (
            SafetyStop("too fast"),
            "restored",
            "stopped; everything in it is as it was found",
            ["    beltcomm commission --drive virtual --yes --run R --resume"],
        ),
        (
            DriveError("no answer"),
            "not restored",
            "NOT restored: `beltcomm rollback --drive virtual --run R` writes back what it had",
            ["    beltcomm doctor --drive virtual", "Then:   beltcomm commission --drive virtual --yes --run R --resume"],
        ),
        (Refused("no"), "note", "nothing was written to it", ["    beltcomm commission --drive virtual --yes --run R --resume"]),
    ],
)
def test_a_failed_commissioning_ends_with_folder_drive_and_next_command(
    api: StandIn, tmp_path: Path, error: Exception, last: Event, drive: str, following: list[str]
) -> None:
    api.answer = error
    (tmp_path / "R" / "recordings").mkdir(parents=True)
    (tmp_path / "R" / "recordings" / "frf_1.csv").touch()
    api.during = lambda: append(tmp_path / "R", "so it was left", last, "")
    outcome = call("commission", "--drive", "virtual", "--yes", "--run", "R")
    said = outcome.stderr.splitlines()
    at = said.index(f"Drive:  {drive}")
    assert said[at - 1] == "Folder: R (1 record kept)"
    assert said[at + 2 :] == following


@pytest.mark.parametrize(("number", "code"), [(errno.EROFS, 2), (errno.EACCES, 2), (errno.ENOSPC, 2), (errno.EIO, 1)])
def test_a_folder_that_cannot_be_written_is_a_wrong_use(api: StandIn, number: int, code: int) -> None:
    api.answer = OSError(number, os.strerror(number), "R/results")
    outcome = call("fit", "R")
    assert outcome.exit_code == code
    assert "R/results" in outcome.stderr
    assert ("choose a folder that can be written" in outcome.stderr) == (code == 2)


def test_an_unexpected_error_leaves_its_traceback_in_the_run_folder(api: StandIn, tmp_path: Path) -> None:
    api.answer = ZeroDivisionError("division by zero")
    (tmp_path / "R").mkdir()
    outcome = call("friction", "--drive", "virtual", "--run", "R", "--json")
    (log,) = (tmp_path / "R").glob("*.log")
    assert outcome.exit_code == 1
    assert "Traceback" not in outcome.stderr
    assert str(log.name) in json.loads(outcome.stdout)["error"]
    text = log.read_text(encoding="utf-8")
    assert "ZeroDivisionError" in text
    assert "friction --drive virtual" in text


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["comission", "--drive", "virtual"], "did you mean commission?"),
        (["commission", "--drve", "virtual"], "--drive"),
        (["commission", "--drive", "virtual", "--axis", "egc-70-60"], "did you mean egc-70-600?"),
        (["commission", "--drive", "virtual", "--apply", "kep"], "keep"),
        (["commission", "--drive", "virtual", "--position", "0.3 kg"], "'kg' is not a unit of it"),
        (["verify", "--drive", "virtual", "--run", "R", "--move", "m.csv", "--trajectory", "T_A"], "give one of them"),
        (["identify", "--drive", "virtual", "--window", "20mm..30mm"], "does not reach to both sides"),
        (["identify", "--drive", "virtual", "--window", "-20mm"], "does not reach to both sides"),
        (["identify", "--drive", "virtual", "--window", "-20mm..3 kg"], "'kg' is not a unit of it"),
        (["identify", "--drive", "virtual", "--window", "wide"], "give a number in m"),
        (["friction", "--drive", "virtual"], "--run"),
    ],
)
def test_wrong_usage_is_explained(api: StandIn, words: list[str], hint: str) -> None:
    outcome = call(*words, "--json")
    assert outcome.exit_code == 2
    assert hint in outcome.stderr
    assert hint in json.loads(outcome.stdout)["error"]
    assert api.calls == []


#: Words with which a verb does something.
WORDS = {
    "init": "axis.yaml --set name=mine", "move": "--drive virtual --by 5mm", "compare": "R", "diagnose": "R", "add": "cogging R",
    "remove": "cogging R", "report": "R", "ladder": "R", "fit": "R", "design": "R", "simulate": "g_a", "import": "data.csv",
    "export": "R --format c",
    "trajectory": "m.csv --from 0 --to 0.5 --speed 1 --acceleration 10 --jerk 200", "thesis": "", "convert": "R", "doctor": "",
    "serve": "--on slcan", "bundle": "R", "drives": "", "effects": "", "commission": "--drive virtual", "identify": "--drive virtual",
    "calibrate": "--drive virtual", "demo": "--seed 3", "open": "R", "trend": "R S", "study": "tolerances", "improve": "R", "runs": "",
}  # fmt: skip


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_prints_one_json_object(api: StandIn, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, verb: str) -> None:
    """And nothing else on stdout."""
    step = SimpleNamespace(command="beltcomm ladder R", why="All of it.", lines=["a"], data={"ratio": 1.0})
    monkeypatch.setitem(sys.modules, "beltcomm.demo", SimpleNamespace(demo=lambda *_args, **_options: [step]))
    monkeypatch.setitem(sys.modules, "beltcomm.improve", SimpleNamespace(improve=lambda *_args, **_options: Outcome()))
    outcome = call(verb, *WORDS.get(verb, "--drive virtual --run R").split(), "--json")
    assert outcome.exit_code == 0, outcome.output
    (line,) = outcome.stdout.splitlines()
    assert isinstance(json.loads(line), dict)
    assert "error" not in json.loads(line)


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help_json_and_verbosity(verb: str) -> None:
    outcome = call(verb, "--help-all")
    assert outcome.exit_code == 0
    assert "--json" in outcome.stdout
    assert "--verbose" in outcome.stdout


@pytest.mark.parametrize("verb", ["commission", "identify", "friction", "verify", "move"])
def test_every_verb_that_moves_can_be_asked_for_its_plan(verb: str) -> None:
    text = call(verb, "--help-all").stdout
    assert all(option in text for option in ("--drive", "--yes", "--dry-run", "--seed"))


def test_help_loads_nothing_slow() -> None:
    program = (
        "import sys; from beltcomm.cli.main import cli\n"
        "for words in (['--help'], ['commission', '--help']): cli.main(words, standalone_mode=False)\n"
        "print([name for name in ('numpy', 'scipy', 'numba', 'rich', 'yaml', 'can', 'canopen') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_version_and_no_words() -> None:
    assert call("--version").stdout.startswith("beltcomm, version ")
    assert call().stdout == call("--help").stdout, "with its line breaks"
    assert call().exit_code == 0
