"""What a shell completes: verbs, options, choices, effects by the run's model, drives, axes, run folders."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.shell_completion import ShellComplete

from beltcomm.cli import completion
from beltcomm.cli.completion import Bash
from beltcomm.cli.frame import Invocation
from beltcomm.cli.main import COMPLETING, cli


@pytest.fixture(autouse=True)
def here(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A folder with a run whose model has one effect."""
    for name in ("recordings", "models"):
        (tmp_path / "runs" / "first" / name).mkdir(parents=True)
    (tmp_path / "runs" / "first" / "models" / "final.yaml").write_text("effects: [belt_stiffness, stribeck]\n", encoding="utf-8")
    (tmp_path / "runs" / "first" / "axis.yaml").touch()
    (tmp_path / "my-axis.yaml").touch()
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("COMP_WORDS", raising=False)
    return tmp_path


def offered(*words: str) -> list[str]:
    """What is offered for the last word."""
    shell = ShellComplete(cli, {"obj": Invocation([])}, "beltcomm", COMPLETING)
    return [item.value for item in shell.get_completions(list(words[:-1]), words[-1]) if item.type == "plain"]


@pytest.mark.parametrize(
    ("words", "some"),
    [
        (["comm"], ["commission"]),
        (["commission", "--dry"], ["--dry-run"]),
        (["commission", "--apply", ""], ["keep", "restore", "save"]),
        (["commission", "--drive", "virtual:g_a"], ["virtual:g_a", "virtual:g_a_25deg"]),
        (["doctor", "--drive", "serial:v"], ["serial:virtual"]),
        (["commission", "--axis", "egc-70-600-v"], ["egc-70-600-vertical"]),
        (["commission", "--axis", "my"], ["my-axis.yaml"]),
        (["commission", "--axis", "runs/first/a"], ["runs/first/axis.yaml"]),
        (["commission", "--profile", "cmmp"], ["cmmp-as"]),
        (["simulate", "s_"], ["s_a", "s_b", "s_c"]),
        (["effects", "strib"], ["stribeck", "stribeck_cart"]),
        (["ladder", ""], ["runs/first"]),
        (["design", "runs/f"], ["runs/first"]),
        (["verify", "--run", "ru"], ["runs/first"]),
    ],
)
def test_words_are_completed(words: list[str], some: list[str]) -> None:
    assert offered(*words) == some


def test_interfaces_of_this_machine_are_offered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(completion, "_can_interfaces", lambda: ["can0"])
    monkeypatch.setattr(completion, "_serial_ports", lambda: ["slcan:/dev/ttyACM0"])
    assert {"virtual", "can0", "slcan:/dev/ttyACM0"} < set(offered("commission", "--drive", ""))


@pytest.mark.parametrize("verb", ["add", "remove"])
def test_effects_are_offered_by_the_model_of_the_run(monkeypatch: pytest.MonkeyPatch, verb: str) -> None:
    """The run may stand behind the cursor; before one is named the whole catalogue is offered."""
    everything = offered(verb, "")
    monkeypatch.setenv("COMP_WORDS", f"beltcomm\n{verb}\n\nruns/first")
    with_run = offered(verb, "")
    assert {"stribeck", "cogging"} < set(everything)
    assert ("stribeck" in with_run, "cogging" in with_run) == ((False, True) if verb == "add" else (True, False))
    (Path("runs/first/models/final.yaml")).write_text("effects: [", encoding="utf-8")
    assert offered(verb, "") == everything


@pytest.mark.parametrize(
    ("words", "at", "asked", "answer"),
    [
        ("beltcomm\ncommission\n--drive\nvirtual\n:\ng", 5, (["commission", "--drive"], "virtual:g"), "plain,g_a"),
        ("beltcomm\ncommission\n--drive\nvirtual\n:", 4, (["commission", "--drive"], "virtual:"), "plain,g_a"),
        ("beltcomm\ncommission\n--drive\nvirtual:g", 3, (["commission", "--drive"], "virtual:g"), "plain,virtual:g_a"),
        ("beltcomm\nmove\n--drive\nvirtual\n:\ng_a\n--by\n", 7, (["move", "--drive", "virtual:g_a", "--by"], ""), "plain,virtual:g_a"),
        ("beltcomm\nadd\n\nruns/first", 2, (["add"], ""), "plain,virtual:g_a"),
        ("beltcomm\nladder\n'my ru", 2, (["ladder"], "my ru"), "plain,virtual:g_a"),
    ],
)
def test_bash_gets_back_what_comes_after_the_colon(
    monkeypatch: pytest.MonkeyPatch, words: str, at: int, asked: tuple[list[str], str], answer: str
) -> None:
    from click.shell_completion import CompletionItem

    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(at))
    shell = Bash(cli, {}, "beltcomm", COMPLETING)
    assert shell.get_completion_args() == asked
    assert shell.format_completion(CompletionItem("virtual:g_a")) == answer
