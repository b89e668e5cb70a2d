"""``beltcomm doctor``: what stands in the way of commissioning, in words; nothing moves, and what is tried is put back."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Final

from beltcomm.axis import Axis, load_axis
from beltcomm.configfiles import named_file
from beltcomm.drive import Adapter, FoundAdapter, adapter_for, find_adapters
from beltcomm.drive.finding import Finding, State
from beltcomm.errors import BeltcommError, DriveError, UsageError
from beltcomm.experiments.options import Options
from beltcomm.experiments.referencing import suitable
from beltcomm.given import pasted
from beltcomm.jobs.virtual_axis import axis_behind
from beltcomm.language import told, tr
from beltcomm.machine.ratings import counts_rating, limit_ratings, own_machine
from beltcomm.result import Line, Result, plain
from beltcomm.sentences.own_words import own_words
from beltcomm.sentences.screens import state_lines
from beltcomm.talk import Silence, Talk

AREA: Final = "axis.yaml"
#: Ratings of drive and axis file may differ by this share: nameplates are rounded.
RATING_TOLERANCE: Final = 0.05
#: Feed constants are entered with four digits and more.
_FEED_TOLERANCE: Final = 5e-3
_REMEDY: Final = "correct the drive's data with the maker's tool, or axis.yaml: one of them belongs to another axis"


def _compared(findings: Sequence[Finding], axis: Axis) -> list[Finding]:
    """One finding per entry that both know; entries that one of them lacks are left out."""
    said = {name: value for finding in findings for name, value in finding.values.items()}
    seen = {name: float(value) for name, value in said.items() if isinstance(value, (int, float))}
    if not seen:  # nothing was read
        return []
    gear = list(_gear(seen, axis))
    if any(finding.state == "wrong" for finding in gear):  # feed and position follow from it
        return [*_entries(axis), *_ratings(seen, axis), *_limits(seen, axis), *_encoder(seen, axis), *gear]
    rest = (*_encoder(seen, axis), *gear, *_feed(seen, axis), *_position(seen, axis))
    return [*_entries(axis), *_ratings(seen, axis), *_limits(seen, axis), *rest]


def _entries(axis: Axis) -> Iterator[Finding]:
    """Findings on entries that commissioning needs; silent where the file has them."""
    try:
        suitable(axis)
    except BeltcommError as error:
        text, remedy = error.fault_and_remedy
        yield Finding(AREA, "entries", "wrong", text, remedy)


def _ratings(seen: dict[str, float], axis: Axis) -> Iterator[Finding]:
    motor = axis.motor
    constant = motor.torque_constant_nm_a
    pairs = [
        ("rated torque", "6076h", "rated_torque_nm", seen.get("rated_torque_nm"), motor.rated_torque_nm, "N m"),
        (
            "torque per current",
            "6076h / 6075h",
            "torque_constant_nm_a",
            seen["rated_torque_nm"] / seen["rated_current_a"] if seen.get("rated_torque_nm") and seen.get("rated_current_a") else None,
            constant,
            "N m/A",
        ),
    ]
    for what, objects, entry, drive_value, file_value, unit in pairs:
        if not drive_value or not file_value:
            continue
        share = drive_value / file_value
        text = f"{what} {drive_value:.4g} {unit} ({objects}), axis.yaml says {file_value:.4g} {unit} (motor.{entry})"
        if abs(share - 1.0) <= RATING_TOLERANCE:
            yield Finding(AREA, what, "ok", text, "", {"share": share})
        else:
            words = f"{text}: every torque, mass and gain would be wrong by the factor {share:.2f}"
            yield Finding(AREA, what, "wrong", words, _REMEDY, {"share": share})


def _limits(seen: dict[str, float], axis: Axis) -> Iterator[Finding]:
    """Only a limit above what the motor bears is worth a line."""
    if {"peak_torque_nm", "max_speed_rad_s"} <= set(seen):
        for rating in limit_ratings(axis, seen["peak_torque_nm"], seen["max_speed_rad_s"]):
            if rating.wrong:
                text, _, remedy = rating.words().partition("; ")
                yield Finding(AREA, rating.what, "wrong", text, remedy)


def _encoder(seen: dict[str, float], axis: Axis) -> Iterator[Finding]:
    counts, expected = seen.get("counts_per_rev"), axis.motor.encoder_counts_per_rev
    if not counts or not expected:
        return
    text = f"the drive counts {counts:.10g} increments per motor revolution, axis.yaml says {expected:.10g} (motor.encoder_counts_per_rev)"
    rating = counts_rating(axis, counts)
    if counts == expected:
        yield Finding(AREA, "encoder", "ok", text)
    else:
        yield Finding(AREA, "encoder", "wrong" if rating.wrong else "warning", text, rating.remedy)


def _gear(seen: dict[str, float], axis: Axis) -> Iterator[Finding]:
    """6091h: 1 when the drive counts at the motor, else it must be the axis's gear."""
    gear, expected = seen.get("gear_ratio"), axis.gearbox.ratio
    if gear is None or (gear == 1.0 and expected == 1.0):
        return
    text = f"the drive's gear ratio is {gear:g} (6091h), axis.yaml says {expected:g} (gearbox.ratio)"
    if gear == 1.0:
        yield Finding(AREA, "gear", "ok", f"{text}; the drive counts at the motor, beltcomm takes the gear into account")
    elif abs(gear / expected - 1.0) <= _FEED_TOLERANCE:
        yield Finding(AREA, "gear", "ok", text)
    else:
        yield Finding(AREA, "gear", "wrong", f"{text}: positions would be wrong by the factor {gear / expected:.3g}", _REMEDY)


def _feed(seen: dict[str, float], axis: Axis) -> Iterator[Finding]:
    """Position units of one motor revolution: encoder increments, degrees, or the feed in some decimal unit of length.

    Other numbers are no proof of a mistake: a drive may count as it likes.  What is told is what to compare.
    """
    units, counts = seen.get("units_per_rev"), seen.get("counts_per_rev")
    if not units or not counts or axis.get("pulley.effective_radius_m") is None:
        return
    units = abs(units)
    feed_m = 2.0 * math.pi * axis.transmission_m_rad
    if abs(units / counts - 1.0) <= _FEED_TOLERANCE:
        yield Finding(
            AREA, "feed", "ok", f"one motor revolution is {units:g} position units, the encoder's increments, and {1e3 * feed_m:.2f} mm"
        )
    elif _decimal_of(units, feed_m):
        yield Finding(AREA, "feed", "ok", f"one motor revolution is {units:g} position units, the {1e3 * feed_m:.2f} mm of axis.yaml")
    elif _decimal_of(units, 360.0) or _decimal_of(units, 1.0):
        yield Finding(
            AREA, "feed", "ok", f"one motor revolution is {units:g} position units, a decimal part of a turn, and {1e3 * feed_m:.2f} mm"
        )
    else:
        yield Finding(
            AREA, "feed", "warning",
            f"one motor revolution is {units:g} position units: neither the encoder's {counts:g} increments ({units / counts:.4g} times) "
            f"nor the {1e3 * feed_m:.2f} mm of axis.yaml in any decimal unit",
            "with the power off, push the carriage 100 mm by hand between two runs of doctor: the position below must change by 100 mm; "
            "else correct 6092h, 6091h or 6093h with the maker's tool",
            {"factor": units / counts},
        )  # fmt: skip


def _decimal_of(value: float, base: float) -> bool:
    """True if ``value`` is ``base`` times a power of ten."""
    exponent = math.log10(value / base)
    return math.isclose(10.0 ** (exponent - round(exponent)), 1.0, rel_tol=_FEED_TOLERANCE)


def _position(seen: dict[str, float], axis: Axis) -> Iterator[Finding]:
    """Position of the carriage when the drive knows its zero; else counted from the drive's own."""
    angle, low, high = seen.get("position_rad"), axis.travel.min_m, axis.travel.max_m
    if angle is None or axis.get("pulley.effective_radius_m") is None:
        return
    position_m = angle * axis.transmission_m_rad
    if not seen.get("referenced"):
        text = f"by the drive's counter the carriage is at {1e3 * position_m:.1f} mm, but its zero is not known"
        yield Finding(AREA, "position", "unknown", text, "", {"position_m": position_m})
        return
    if low is None or high is None:
        return
    text = f"the carriage stands at {1e3 * position_m:.1f} mm, the travel is {1e3 * low:g} to {1e3 * high:g} mm"
    if low <= position_m <= high:
        yield Finding(AREA, "position", "ok", text, "", {"position_m": position_m})
    else:
        remedy = "push the carriage inside by hand, with the power off; if it is inside, home the drive anew or correct travel in axis.yaml"
        yield Finding(AREA, "position", "wrong", f"{text}: outside", remedy, {"position_m": position_m})


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
        findings += [_of_another_machine(finding, drive, file) for finding in _compared(findings, known)]
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


def _of_another_machine(finding: Finding, drive: str, file: str) -> Finding:
    """Where data of a virtual drive differ from axis.yaml, its remedy is the machine of that file; any other finding stays."""
    differs = finding.state in ("wrong", "warning") and finding.name != "entries"
    if not differs or drive.partition(":")[0] != "virtual" or axis_behind(drive):
        return finding
    if not named_file(file):
        return replace(finding, remedy=own_machine())
    return replace(finding, remedy=own_machine(file), values={**finding.values, "own_machine": f"virtual:{file}"})


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
    wrong = [finding for finding in findings if finding.state == "wrong"]
    own = {finding.values.get("own_machine") for finding in wrong}
    if file and len(own) == 1 and (machine := own.pop()):
        return f"next: `beltcomm doctor --drive {pasted(str(machine))} --axis {pasted(file)}`"
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
