"""Every command of README.md and docs/ is one that the command line takes; those that need no machine and little time are run."""

from __future__ import annotations

import re
import shlex
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from beltcomm.cli.frame import Invocation
from beltcomm.cli.main import VERBS, cli

CHECKOUT = Path(__file__).parents[2]
PAGES = [CHECKOUT / "README.md", CHECKOUT / "CONTRIBUTING.md", *sorted((CHECKOUT / "docs").rglob("*.md"))]
#: What stands in the documents for something of the reader's.
PLACEHOLDERS = {
    "D": "virtual", "DRIVE": "virtual", "FILE": "file", "EFFECT": "cogging", "PLANT": "g_a", "TOPIC": "models", "INTERFACE": "slcan",
    "A": "0", "B": "0.5", "N": "2", "KG": "1", "K_P": "0.1", "K_I": "1", "K_PP": "10", "P": "1", "I": "1", "VERB": "fit", "NAME": "cogging",
    "SERIAL": "1", "FOLDER": "folder", "LOW..HIGH": "-1mm..1mm", "PROFILE": "cmmp-as", "FD": "0", "PORT": "29536", "LOG": "log",
}  # fmt: skip
#: Verbs that are run as they stand, and those that show their plan on the virtual drive; others ask questions, or take their time in tests
#: of their own.
RUN = {"effects", "drives", "export", "convert", "bundle", "trajectory", "design", "doctor"}
PLANNED = {"commission", "identify", "friction", "verify", "apply", "move"}
#: An option in the text that belongs to another tool.
FOREIGN = {
    "--sync",
    "--complete",
    "--cov",
    "--drive-window-rad",
    "--drive-speed-rad-s",
    "--drive-torque-nm",
    "--drive-option",
    "--pages",
    "--nthreads",
    "--draws",
    "--history",
    "--accesses",
}


def code_of(text: str) -> Iterator[str]:
    """Lines of code blocks, fenced or indented, and code within a line; a table's escaped bars as they are meant."""
    fenced = False
    for line in text.splitlines():
        if line.startswith("```"):
            fenced = not fenced
        elif fenced or line.startswith("    "):
            yield line.strip().removeprefix("$ ")
        else:
            yield from (code.replace("\\|", "|") for code in re.findall(r"`([^`]+)`", line))


def commands() -> list[tuple[str, str]]:
    """(page, command), each command once."""
    found: dict[str, str] = {}
    for page in PAGES:
        for code in code_of(page.read_text(encoding="utf-8")):
            code = re.sub(r"\s+#.*", "", re.sub(r"^.*&& \.venv/bin/beltcomm", "beltcomm", code))
            if re.match(r"beltcomm (-|[a-z])[^:]*( |$)", code) and code.split()[1] in (*VERBS, "--help", "--version", "VERB"):
                found.setdefault(code, page.relative_to(CHECKOUT).as_posix())
    return [(page, command) for command, page in found.items()]


def meant(command: str, run: str) -> list[str]:
    """The words of one command that somebody could type: the first of alternatives, what may be left out taken, placeholders filled."""
    text = re.sub(r"\[([^\]]*)\]", lambda m: "" if "..." in m[1] else m[1], command)
    text = (
        re.sub(r"(?<=\w)\|\S+", "", text)
        .replace("$DATA", "data")
        .replace("--axis FILE", "--axis egc-70-600")
        .replace("--profile NAME", "--profile cmmp-as")
        .replace(" ...", "")
    )
    words = [w.replace("RUN", run) for w in shlex.split(text)[1:]]
    return [PLACEHOLDERS.get(word, word) for word in words]


def parsed(words: list[str]) -> click.Context:
    """What click makes of them, up to the command's own function.  Raises click.ClickException."""
    if words[0].startswith("-"):
        return cli.make_context("beltcomm", [], obj=Invocation(words), resilient_parsing=True)
    command = cli.get_command(click.Context(cli), words[0])
    if command is None:
        raise click.UsageError(f"there is no verb {words[0]}")
    try:
        return command.make_context(words[0], words[1:], parent=click.Context(cli, obj=Invocation(words)))
    except click.exceptions.Exit:  # --help
        return click.Context(command)


def test_there_are_commands_to_look_at() -> None:
    verbs = {command.split()[1] for _, command in commands()}
    assert len(commands()) > 100
    assert set(VERBS) - verbs <= {"demo", "report", "open", "trend"}, "every verb is shown somewhere"


def test_every_command_is_taken(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "runs" / "first").mkdir(parents=True)
    (tmp_path / "runs" / "first" / "run.yaml").touch()  # the newest, where none is named
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("beltcomm.cli.hold.HeldKey", lambda *args, **kwargs: None)
    wrong = {}
    for page, command in commands():
        words = meant(command, "runs/first")
        try:
            parsed(words)
        except click.ClickException as error:
            if isinstance(error, click.MissingParameter) and len(words) == 1:
                continue  # a verb that a sentence names
            if isinstance(error, click.BadOptionUsage) and words[-1] == error.option_name and len(words) == 2:
                continue  # an option that a sentence names
            wrong[f"{page}: {command}"] = error.format_message()
    assert not wrong, "\n".join(f"{where}: {why}" for where, why in wrong.items())


def test_a_renamed_option_would_be_found() -> None:
    with pytest.raises(click.ClickException):
        parsed(meant("beltcomm fit RUN --modell three-mass", "runs/first"))
    with pytest.raises(click.ClickException):
        parsed(meant("beltcomm fitt RUN", "runs/first"))


def test_every_option_that_is_named_exists() -> None:
    known = FOREIGN | {"--help", "--version"}
    for verb in VERBS:
        command = cli.get_command(click.Context(cli), verb)
        assert command is not None
        known |= {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
    named = {
        (page.relative_to(CHECKOUT).as_posix(), option)
        for page in PAGES
        for code in code_of(page.read_text(encoding="utf-8"))
        if not re.match(r"(python|\S*pip|sudo|cd |pytest|ruff|cansend|ip |candump)", code)
        for option in re.findall(r"(?<![\w-])--[a-z][a-z-]+", code)
    }
    assert {one for one in named if one[1] not in known} == set()


def runnable() -> list[tuple[str, list[str]]]:
    """(command, words) on RUN, a virtual drive or on nothing, without files of the reader's; of those per effect only one.

    Set-ups of docs/doctor.md end as that page shows, which tests/doctor holds.
    """
    found = []
    for page, command in commands():
        verb = command.split()[1]
        if page == "docs/doctor.md":
            continue
        named = re.match(r"beltcomm effects (?!coulomb$|\[)", command)
        if (
            verb not in RUN | PLANNED
            or named
            or re.search(
                r"--eds|FOLDER|can|slcan:|serial:|my-axis|mine\.yaml|--new$|verify.* runs/acme|--plan|--move|--dcf|FILE RUN", command
            )
        ):
            continue
        words = [meant(alternative, "RUN") for alternative in alternatives(command)]
        for one in words:
            if (len(one) == 1 and verb in RUN - {"effects", "drives", "doctor"}) or (verb in PLANNED and "--drive" not in one):
                continue  # a verb that a sentence names
            dry = verb in PLANNED  # a new profile is written after a yes
            found.append((command, [*(w for w in one if not dry or w not in ("--yes", "--dry-run")), *(["--dry-run"] if dry else [])]))
    return [one for k, one in enumerate(found) if one[1] not in [words for _, words in found[:k]]]


def alternatives(command: str) -> list[str]:
    """Each of ``yaml|c|st``."""
    bars = re.search(r"\w+(\|\w+)+", command)
    return [command.replace(bars[0], one) for one in bars[0].split("|")] if bars else [command]


@pytest.mark.examination
def test_commands_that_need_no_machine_run(copy_of_complete: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    run = copy_of_complete()
    monkeypatch.chdir(run.parent)
    shutil.copy(run / "axis.yaml", "my_axis.yaml")
    assert {command.split()[1] for command, _ in runnable()} == RUN | PLANNED
    failed = {}
    for _, words in runnable():
        outcome = CliRunner().invoke(cli, [word.replace("RUN", str(run)) for word in words])
        if outcome.exit_code != 0:
            failed[" ".join(words)] = outcome.output
    assert failed == {}
