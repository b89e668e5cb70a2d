"""Findings of a session: into the run folder, as a mapping for programs, as text for people."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from beltcomm.configfiles import write_text
from beltcomm.experiments import holding
from beltcomm.given import pasted
from beltcomm.identify.final import FinalModel
from beltcomm.language import tr
from beltcomm.result import Line, plain
from beltcomm.rundata import analyse
from beltcomm.rundata.delays import delay
from beltcomm.rundata.findings import Findings
from beltcomm.rundata.headline import NOTED, OF, OWN, hashes_of, headline_of, next_command
from beltcomm.rundata.kept import KEY, keep_fit
from beltcomm.rundata.revisions import RECORDS
from beltcomm.rundata.store import design_to_dict, fit_to_dict
from beltcomm.runfolder import RunFolder
from beltcomm.sentences import friction, screens, typed_gains, words
from beltcomm.sentences.own_words import lines_in
from beltcomm.sentences.torque_path import path_data, path_lines, period_of, process_lines

if TYPE_CHECKING:
    from beltcomm.laboratory.compare import Missing


def save(folder: RunFolder, findings: Findings) -> None:
    """Keep everything that was found in the run folder: models, designs, results.

    Parameters
    ----------
    folder : RunFolder
    findings : Findings
    """
    model = findings.final.fit.model if findings.final is not None else None
    if findings.final is not None:
        folder.save("models", "final", findings.final.fit.model.to_dict())
        folder.save("results", "fit", {**_fit_dict(findings.final, findings), RECORDS: folder.finished_names(), NOTED: findings.remarks})
        keep_fit(folder, findings.final.fit.data, findings.final.fit.fitted, findings.final.fit.model)
    if findings.friction is not None:
        folder.save("results", "friction", plain(findings.friction))
    if findings.standstill is not None:
        folder.save("results", "standstill", plain(findings.standstill))
    if findings.design is not None:
        folder.save("designs", "final", {**design_dict(findings), OF: hashes_of(findings.cascade, model) if findings.cascade else {}})
    if findings.verdict is not None:
        driven = findings.proof.get("gains") if isinstance(findings.proof, Mapping) else None
        proven = {"proof": plain(findings.proof), OF: hashes_of(driven or {}, model), **({OWN: True} if findings.own_loop else {})}
        verdict = {**plain(findings.verdict), **proven, "reservations": findings.reservations, NOTED: findings.remarks}
        folder.save("results", f"verify_{findings.move_name}", verdict)


def _fit_dict(final: FinalModel, findings: Findings) -> dict[str, Any]:
    """``results/fit.yaml``: the fit, what it was compared with, and what follows from it."""
    return {
        **fit_to_dict(final.fit),
        KEY: path_data(final.fit.path, period_of(final.fit.data.recordings)),
        "reason": final.reason,
        "rejected": fit_to_dict(final.rejected) if final.rejected else None,
        "characteristics": plain(findings.characteristics),
        "log_magnitude": {name: plain(one.parameters) for name, one in findings.thesis.items()},
        "dead_time": {"value_s": findings.dead_time.value_s, "interval_s": findings.dead_time.interval_s} if findings.dead_time else None,
    }


def design_dict(findings: Findings) -> dict[str, Any]:
    """A design as ``designs/final.yaml`` has it; empty without one.

    Parameters
    ----------
    findings : Findings
    """
    if findings.design is None or findings.cascade is None:
        return {}
    apparent = analyse.apparent_damping(findings.thesis)
    return design_to_dict(findings.design, findings.cascade, delay(findings), apparent)


def data(folder: RunFolder, findings: Findings) -> dict[str, Any]:
    """Everything that was found, for ``--json``.

    Parameters
    ----------
    folder : RunFolder
    findings : Findings
    """
    found: dict[str, Any] = {
        "run": str(folder.path),
        "headline": headline_of(folder).to_dict(),
        "machine_seconds": findings.machine_seconds,
        "remarks": findings.remarks,
        "reservations": findings.reservations,
    }
    if findings.holding is not None:
        found["gravity"] = findings.holding.to_dict()
    if findings.final is not None:
        found["model"] = findings.final.fit.model.to_dict()
        found["fit"] = _fit_dict(findings.final, findings)
    if findings.friction is not None:
        found["friction"] = findings.friction
    if findings.standstill is not None:
        found["standstill"] = findings.standstill
    if findings.design is not None:
        found["design"] = design_dict(findings)
    if findings.verdict is not None:
        found["verdict"] = findings.verdict
    return found


def model_text(findings: Findings, *, error: float | None = None, compared: bool = True) -> list[str]:
    """The model with intervals, why it was chosen, the delay, and the log-magnitude fits beside it.

    Parameters
    ----------
    findings : Findings
    error : float or None
        Over the noise, as the laboratory has it; the fit's own where nothing is given.
    compared : bool
        With those fits.
    """
    if findings.final is None:
        return []
    lines = words.model_lines(findings.final.fit, findings.characteristics, error)
    lines.append(f"  {findings.final.reason}")
    late = ""
    if findings.dead_time is not None:
        late = words.number(1e3 * findings.dead_time.value_s, 1e3 * findings.dead_time.interval_s, "ms")
    fit = findings.final.fit
    told = path_lines(fit.path, period_of(fit.data.recordings))
    if told and late:
        told[0] += f"; delay {late}"
    elif late:
        told = [f"delay from torque setpoint to torque: {late}", *told]
    lines += [f"  {line}" for line in (*told, *process_lines(fit.path))]
    return lines + (words.thesis_lines(findings.thesis) if compared else [])


def _gravity_text(folder: RunFolder, findings: Findings) -> list[str]:
    """The torque that holds a tilted axis, by all ways, and whether mass and tilt say the same; nothing of a level one."""
    if findings.holding is None:
        return []
    fits = holding.plausibility(findings.holding, findings.final.fit.model, folder.axis) if findings.final else []
    return [*holding.lines(findings.holding), *fits]


def model_screen(folder: RunFolder, findings: Findings) -> list[Line]:
    """Axis as known so far, on a screen: axis, model, friction, and what to look at.

    Parameters
    ----------
    folder : RunFolder
    findings : Findings
    """
    final = findings.final
    if final is None:
        return screens.warning_lines(findings.remarks)
    delay_s = findings.dead_time.value_s if findings.dead_time is not None else None
    return [
        *screens.axis_lines(final.fit.model, folder.axis.travel.middle_m, delay_s),
        *([screens.friction_line(findings.friction)] if findings.friction is not None else []),
        screens.model_line(math.sqrt(final.fit.misfit), final.fit.suspect, final.fit.judged),
        *screens.warning_lines([*screens.sheet_words(plain(list(findings.sheets))), *final.fit.remarks, *findings.remarks]),
    ]


def identify_text(folder: RunFolder, findings: Findings, drive: str, place_known: bool) -> tuple[list[str], list[str]]:
    """The first model on a screen, with what to do next; and everything behind it.

    Parameters
    ----------
    folder : RunFolder
    findings : Findings
    drive : str
        As for ``--drive``.
    place_known : bool
        True if a record says where the carriage stands.

    Returns
    -------
    tuple of list of str
        Lines of the screen, and details.
    """
    details = [*model_text(findings), *_gravity_text(folder, findings), *words.remarks_lines(findings.remarks)]
    name = folder.axis.name or tr("the axis")
    shown = [
        Line(""),
        Line("  ", (tr("MEASURED"), "good"), "   ", (tr("{name}: a first model, from where the carriage stands", name=name), "title")),
        Line(""),
        *model_screen(folder, findings),
        Line("  ", tr("Recordings are in {folder}", folder=folder.recordings_folder)),
    ]
    run = f"beltcomm friction --drive {pasted(drive)} --run {pasted(folder.path)}"
    if place_known:
        return [*shown, f"Next: {run}   (strokes over the whole travel)"], details
    return [
        *shown,
        "  Not possible yet: other places, the friction sweep, the verification move. They need to know",
        "  where the carriage stands: measure it (--position), or let the drive find its zero (--home).",
        f"Next: {run} --position METRES   (strokes over the whole travel)",
    ], details


def keep_text(folder: RunFolder, text: list[str]) -> None:
    """Keep the text shown at the end as ``verdict.txt`` in the run folder.

    Parameters
    ----------
    folder : RunFolder
    text : list of str
        Lines.
    """
    write_text(folder.path / "verdict.txt", "\n".join(lines_in(folder.terms, text)) + "\n")


class ReportWords(Protocol):
    """Words of a report on a run that was just commissioned: :class:`beltcomm.pages.Ended`."""

    @property
    def error(self) -> float | None:
        """Of the model over the noise."""
        ...

    @property
    def missing(self) -> Missing | None:
        """By what it is seen that something is left that is not noise."""
        ...

    @property
    def doubts(self) -> Sequence[str]:
        """Contradictions between data sheets and model, in sentences."""
        ...

    @property
    def sheets(self) -> Sequence[Mapping[str, Any]]:
        """Contradictions between data sheets and model, as numbers."""
        ...


@dataclass(frozen=True)
class Ending:
    """Last words of a commissioning.

    Attributes
    ----------
    screen : list of Line
        The answer.
    details : list of str
        For whoever checks. warnings : of the report.
    """

    screen: list[Line]
    details: list[str]

    def whole(self, closing: Sequence[str]) -> list[str]:
        """Lines of ``verdict.txt``, with ``closing`` between screen and details."""
        return [*self.screen, *closing, "", "Details:", *self.details]


def commission_text(folder: RunFolder, findings: Findings, ended: ReportWords | None = None) -> Ending:
    """The answer on a screen, and everything behind it.

    Parameters
    ----------
    folder : RunFolder
    findings : Findings
    ended : ReportWords or None
        What the report says of the run; None where there is none yet.
    """
    final = findings.final
    error = ended.error if ended is not None and (final is None or final.fit.judged) else None
    typed = typed_gains.of_run(folder, findings.cascade) if findings.own_loop and findings.cascade else []
    told = {"reservations": findings.reservations, NOTED: findings.remarks}
    answer = [Line(""), *screens.headline_lines(headline_of(folder)), Line("")]
    if findings.verdict is not None:
        answer += [*screens.tracking_lines(findings.verdict), Line("")]
    if final is not None:
        delay_s = findings.dead_time.value_s if findings.dead_time is not None else None
        level, missing = (math.sqrt(final.fit.misfit), None) if ended is None or error is None else (error, ended.missing)
        answer += [
            *screens.axis_lines(final.fit.model, folder.axis.travel.middle_m, delay_s),
            screens.model_line(level, final.fit.suspect, final.fit.judged, missing),
        ]
    if findings.design is not None and findings.cascade is not None:
        answer += screens.design_screen(findings.design, findings.cascade)
    answer += [Line(" " * 12, (tr("this drive's gains can only be typed in: --details has them"), "note"))] if typed else []
    answer += screens.warning_lines(screens.warnings(told, ended.sheets if ended is not None else plain(list(findings.sheets))))
    details = [
        *(words.verdict_lines(findings.verdict, findings.demand) if findings.verdict else []),
        *model_text(findings, error=error, compared=False),
        *(f"  {doubt}" for doubt in (ended.doubts if ended is not None else ())),
        *_gravity_text(folder, findings),
        *(words.design_lines(findings.design, findings.cascade) if findings.design and findings.cascade else []),
        *typed,
        *(words.friction_lines(findings.friction) if findings.friction else []),
        *friction.standstill_lines(findings.standstill),
        *words.thesis_lines(findings.thesis),
        *words.remarks_lines(findings.remarks),
        f"{findings.machine_seconds:.0f} s on the machine.",
    ]
    return Ending(answer, details)


def closing(folder: RunFolder, findings: Findings, drive: str, page: str = "") -> list[str]:
    """Path of the report, fate of the gains, and the command to type next.

    Parameters
    ----------
    folder : RunFolder
    findings : Findings
    drive : str
        As for ``--drive``.
    page : str
        Line on the report; "" for none.
    """
    state = {
        "restore": tr("old gains restored"),
        "keep": tr("new gains kept until power-off"),
        "save": tr("new gains saved in the drive"),
    }[findings.applied]
    if findings.own_loop:
        state = tr("the gains that a person has set stand in the drive")
    step = next_command(folder, headline_of(folder), drive, applied=findings.applied)
    where = page or tr("Run {run}", run=folder.path)
    return [Line("  ", where, "   ", (f"({state})", "soft")), *screens.next_lines(step)]
