"""``beltcomm doctor``: what stands in the way of commissioning, in words; nothing moves, and what is tried is put back."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Final

from beltcomm.axis import Axis, load_axis
from beltcomm.drive import Adapter, FoundAdapter, adapter_for, find_adapters
from beltcomm.drive.finding import Finding, State
from beltcomm.errors import BeltcommError, DriveError, UsageError
from beltcomm.experiments.options import Options
from beltcomm.given import pasted
from beltcomm.jobs.axis_findings import compared
from beltcomm.language import told, tr
from beltcomm.result import Line, Result, plain
from beltcomm.sentences.own_words import own_words
from beltcomm.sentences.screens import state_lines
from beltcomm.talk import Silence, Talk

#: How a state is printed before its sentence.
MARKS: Final[dict[State, str]] = {"ok": "ok", "warning": "warning", "wrong": "WRONG", "unknown": "cannot tell"}
_WIDTH: Final = max(map(len, MARKS.values())) + 2


@own_words
def doctor(
    drive: str | None,
    axis: Axis | str | None = None,
    *,
    try_bitrates: bool = False,
    sync_test: bool = False,
    options: Options | None = None,
    talk: Talk | None = None,
    found: Sequence[FoundAdapter] | None = None,
) -> Result:
    """Examine a drive, or this machine.

    Parameters
    ----------
    drive : str or None
        Name of the drive; None examines this machine.
    axis : Axis or str, or None
        Compared with what the drive says.
    try_bitrates : bool
        Look for the bus's bit rate when nobody answers.
    sync_test : bool
        Map two PDOs for a second and count the answers to SYNC.
    options : Options or None
        Settings beside the main arguments; None for the safe defaults.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.
    found : sequence of FoundAdapter or None
        The adapters, those installed when left out.

    Returns
    -------
    Result
        The findings; exit code 0 when nothing is wrong, 1 when something hinders commissioning, 5 when the drive cannot be reached.

    Raises
    ------
    UsageError
        For a drive that no adapter understands, or an option it does not have.
    """
    options, talk = options or Options(), talk or Silence()
    found = find_adapters() if found is None else found
    if drive is None:
        if axis is not None or try_bitrates or sync_test or options.for_drive():
            raise UsageError("say which drive is to be examined: --drive; without it, `beltcomm doctor` takes no further option")
        talk.say(tr("Looking for adapters and ports, a few seconds ..."))
        findings = list(_machine(found))
        return _result(None, findings, _next_machine(findings))
    adapter, address = adapter_for(drive, found)
    if adapter.examine is None:
        raise UsageError(f"the adapter {adapter.name} examines no drive; `beltcomm doctor` alone shows what this machine has")
    sent = tr(", SYNC is sent for a second") if sync_test else ""
    talk.say(tr("Examining {drive}: nothing moves, what is tried is put back{sent} ...", drive=drive, sent=sent))
    asked = {name: True for name, wanted in (("try_bitrates", try_bitrates), ("sync_test", sync_test)) if wanted}
    known = load_axis(axis) if isinstance(axis, str) else axis
    findings = list(_examined(adapter, address, adapter.taken({**options.for_drive(known), **asked})))
    findings = [replace(finding, remedy=_here(finding.remedy, options.reached(drive))) for finding in findings]
    file = axis if isinstance(axis, str) else axis.source if axis else ""
    if known is not None:
        findings += compared(findings, known)
    return _result(drive, findings, _next_drive(options.reached(drive), file, findings))


def _examined(adapter: Adapter, address: str, options: dict[str, object]) -> Iterator[Finding]:
    """The findings of an adapter; what it raises instead is one more."""
    assert adapter.examine is not None
    try:
        yield from adapter.examine(address, options)
    except UsageError:
        raise
    except DriveError as error:
        text, remedy = error.fault_and_remedy
        yield Finding("bus", "drive", "wrong", text, remedy, unreachable=True)


def _machine(found: Sequence[FoundAdapter]) -> Iterator[Finding]:
    """Adapters that load or do not, and what each finds here."""
    area = "adapters of beltcomm"
    if not found:
        yield Finding(area, "adapters", "wrong", "no drive adapters are installed", "`pip install -e .` in the beltcomm folder")
    for item in found:
        if item.adapter is None:
            yield Finding(
                area, item.entry_point, "wrong", f"the adapter {item.entry_point} cannot be loaded: {item.reason}",
                "install what is missing (`pip install PACKAGE`), or uninstall the package that brings it; the others work without",
            )  # fmt: skip
        else:
            schemes = ", ".join(f"{scheme}:" for scheme in item.adapter.schemes)
            yield Finding(area, item.adapter.name, "ok", f"{item.adapter.name} ({schemes}) loads: {item.adapter.summary}")
    for item in found:
        if item.adapter is None or item.adapter.surroundings is None:
            continue
        try:
            yield from item.adapter.surroundings()
        except (BeltcommError, OSError) as error:
            yield Finding("this machine", item.adapter.name, "unknown", f"{item.adapter.name} could not look at this machine: {error}")


def _here(remedy: str, drive: str) -> str:
    """A remedy with the drive's name in place of the word that stands for it."""
    return remedy.replace("--drive D ", f"--drive {pasted(drive)} ")


def _counted(findings: Iterable[Finding]) -> dict[State, int]:
    states = [finding.state for finding in findings]
    return {state: states.count(state) for state in MARKS}


def _next_machine(findings: Sequence[Finding]) -> str:
    usable = [finding.remedy for finding in findings if finding.state == "ok" and finding.remedy.startswith("`beltcomm doctor --drive")]
    if _exit_code(findings):
        return "next: put right what is wrong, then `beltcomm doctor` again"
    if usable:
        return f"next: {usable[0]}"
    return "next: connect a CAN adapter; without hardware, `beltcomm doctor --drive virtual`"


def _next_drive(drive: str, file: str, findings: Sequence[Finding]) -> str:
    rates = [finding.values["found_bitrate"] for finding in findings if "found_bitrate" in finding.values]
    if rates:
        return f"next: `beltcomm doctor --drive {pasted(drive)} --bitrate {rates[0]}`"
    if _exit_code(findings):
        with_axis = f" --axis {pasted(file)}" if file else ""
        return f"next: put right what is wrong, then `beltcomm doctor --drive {pasted(drive)}{with_axis}` again"
    if not file:
        return "next: `beltcomm init my-axis.yaml`, then doctor again with --axis my-axis.yaml, which compares the two"
    # without a zero commissioning refuses to begin; who knows the place gives --position, as the finding says
    home = "" if all(finding.state == "ok" for finding in findings if (finding.area, finding.name) == ("place", "zero")) else " --home"
    return f"next: `beltcomm commission --drive {pasted(drive)} --axis {pasted(file)}{home} --dry-run` shows the plan and moves nothing"


def _exit_code(findings: Sequence[Finding]) -> int:
    if any(finding.unreachable for finding in findings):
        return DriveError.exit_code
    return int(any(finding.state == "wrong" for finding in findings))


def _result(drive: str | None, findings: Sequence[Finding], next_step: str) -> Result:
    counts, code = _counted(findings), _exit_code(findings)
    data = {"drive": drive, "findings": [plain(finding) for finding in findings], "counts": counts, "exit_code": code, "next": next_step}
    fine = [finding for finding in findings if finding.state == "ok" and not finding.remedy]
    rest = [finding for finding in findings if finding not in fine]
    also = [
        tr("As it must be: 1 thing (--details).") if len(fine) == 1 else tr("As it must be: {count} things (--details).", count=len(fine))
    ]
    lines = [*_headline(drive, counts, code), *_lines(rest), *(also if fine else []), told(next_step)]
    return Result(data, lines, code, details=list(_lines(fine)))


def _lines(findings: Sequence[Finding]) -> Iterator[str]:
    """Area by area: the mark, the sentence, and below it what to do."""
    for area, group in groupby(findings, key=lambda finding: finding.area):
        yield f"{told(area)}:"
        for finding in group:
            yield f"  {tr(MARKS[finding.state]):<{_WIDTH}}{told(finding.text)}"
            if finding.remedy:
                yield f"  {'':<{_WIDTH}}-> {told(finding.remedy)}"


def _headline(drive: str | None, counts: dict[State, int], code: int) -> list[Line]:
    """State of the drive or of this machine, in a word and a sentence."""
    wrong, warnings = counts["wrong"], counts["warning"]
    also = ", " + (tr("1 warning") if warnings == 1 else tr("{count} warnings", count=warnings)) if warnings else ""
    if code == DriveError.exit_code:
        return state_lines(tr("NOT REACHED"), tr("The drive {drive} cannot be reached{also}.", drive=drive, also=also), "bad")
    if wrong:
        fails = tr(": commissioning would fail") if drive else ""
        many = tr("1 thing is wrong") if wrong == 1 else tr("{count} things are wrong", count=wrong)
        return state_lines(tr("WRONG"), f"{many}{also}{fails}.", "bad")
    sentence = tr("Nothing is wrong{also}.", also=also) if drive else tr("This machine is ready{also}.", also=also)
    return state_lines(tr("READY"), sentence, "good")
