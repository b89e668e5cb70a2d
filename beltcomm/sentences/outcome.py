"""What a session has found out: into the run folder, as a mapping for programs, as text for people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from beltcomm.configfiles import write_text
from beltcomm.drive import simulated
from beltcomm.experiments import holding
from beltcomm.given import pasted
from beltcomm.identify.final import FinalModel
from beltcomm.result import plain
from beltcomm.rundata import analyse
from beltcomm.rundata.delays import delay
from beltcomm.rundata.findings import Findings
from beltcomm.rundata.kept_fit import keep_fit
from beltcomm.rundata.kept_path import KEY
from beltcomm.rundata.store import design_to_dict, fit_to_dict, verdict_to_dict
from beltcomm.runfolder import RunFolder
from beltcomm.sentences import friction, typed_gains, words
from beltcomm.sentences.torque_path import path_data, path_lines, period_of


def save(folder: RunFolder, findings: Findings) -> None:
    """Everything known into the run folder: models, designs, results."""
    if findings.final is not None:
        folder.save_model("final", findings.final.fit.model.to_dict())
        folder.save_result("fit", fit_dict(findings.final, findings))
        keep_fit(folder, findings.final.fit.data, findings.final.fit.fitted, findings.final.fit.model)
    if findings.friction is not None:
        folder.save_result("friction", plain(findings.friction))
    if findings.standstill is not None:
        folder.save_result("standstill", plain(findings.standstill))
    if findings.design is not None:
        folder.save_design("final", design_dict(findings))
    if findings.verdict is not None:
        verdict = {**verdict_to_dict(findings.verdict), "proof": plain(findings.proof), "reservations": findings.reservations}
        folder.save_result(f"verify_{findings.move_name}", verdict)


def fit_dict(final: FinalModel, findings: Findings) -> dict[str, Any]:
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
    """``designs/final.yaml``; empty without a design."""
    if findings.design is None or findings.cascade is None:
        return {}
    apparent = analyse.apparent_damping(findings.thesis)
    return design_to_dict(findings.design, findings.cascade, delay(findings), apparent)


def data(folder: RunFolder, findings: Findings) -> dict[str, Any]:
    """Everything that was found, for ``--json``."""
    found: dict[str, Any] = {
        "run": str(folder.path),
        "machine_seconds": findings.machine_seconds,
        "remarks": findings.remarks,
        "reservations": findings.reservations,
    }
    if findings.holding is not None:
        found["gravity"] = findings.holding.to_dict()
    if findings.final is not None:
        found["model"] = findings.final.fit.model.to_dict()
        found["fit"] = fit_dict(findings.final, findings)
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

    error : over the noise, as the laboratory has it; the fit's own where nothing is given.   compared : with those fits.
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
    lines += [f"  {line}" for line in told]
    return lines + (words.thesis_lines(findings.thesis) if compared else [])


def gravity_text(folder: RunFolder, findings: Findings) -> list[str]:
    """The torque that holds a tilted axis, by all ways, and whether mass and tilt say the same; nothing of a level one."""
    if findings.holding is None:
        return []
    fits = holding.plausibility(findings.holding, findings.final.fit.model, folder.axis) if findings.final else []
    return [*holding.lines(findings.holding), *fits]


def identify_text(folder: RunFolder, findings: Findings, drive: str, place_known: bool) -> list[str]:
    """The first model, where the recordings are, and what to do next: with a reference, or to get one."""
    text = [
        *model_text(findings),
        *gravity_text(folder, findings),
        *words.remarks_lines(findings.remarks),
        f"Recordings are in {folder.recordings_folder}.",
    ]
    if place_known:
        return [*text, f"Next: beltcomm friction --drive {pasted(drive)} --run {pasted(folder.path)}"]
    return [
        *text,
        "Not possible as long as nobody knows where the carriage stands: other places, the friction sweep, the move that verifies.",
        f"Next: measure where the carriage stands, or let the drive find its zero: "
        f"beltcomm commission --drive {pasted(drive)} --position METRES (or --home); or go on with this run: "
        f"beltcomm friction --drive {pasted(drive)} --run {pasted(folder.path)} --position METRES",
    ]


def keep_text(folder: RunFolder, text: list[str]) -> None:
    """What is shown at the end, as ``verdict.txt`` in the run folder."""
    write_text(folder.path / "verdict.txt", "\n".join(text) + "\n")


@dataclass(frozen=True)
class Ending:
    """What a commissioning says at its end.   top : verdict, next command, what was proven, model, gains.   details : for whoever checks.

    bottom : notes, where the files are, and the next command once more, above which a terminal may have scrolled.
    """

    top: list[str]
    details: list[str]
    bottom: list[str]

    def whole(self) -> list[str]:
        """For ``verdict.txt``."""
        return [*self.top, *(["", "Details:", *self.details] if self.details else []), *self.bottom]

    def short(self) -> list[str]:
        """For the terminal."""
        return [*self.top, *self.bottom]


def commission_text(
    folder: RunFolder, findings: Findings, drive: str, *, page: str = "", error: float | None = None, doubts: Sequence[str] = ()
) -> Ending:
    """The verdict first, then what to do next, everything behind it, and where the files are.

    page : a line on the report.   error : of the model over the noise, as the report has it.   doubts : of the data sheets, likewise.
    """
    passed = findings.verdict is not None and findings.verdict.passed
    suspect = findings.final is None or findings.final.fit.suspect
    typed = typed_gains.of_run(folder, findings.cascade) if findings.own_loop and findings.cascade else []
    state = {
        "restore": "The drive has its old gains again",
        "keep": "The new gains are in the drive until power-off",
        "save": "The new gains are saved in the drive",
    }[findings.applied]
    headline = {
        (True, False): "The axis meets its targets.",
        (False, False): "The axis misses its targets.",
        (True, True): "The move met its targets, but the model does not explain what was measured: do not trust its numbers yet.",
        (False, True): "The axis misses its targets, and the model does not explain what was measured.",
    }[passed, suspect]
    if findings.own_loop and not suspect:
        headline = _own_headline(findings)
    elif passed and not suspect and findings.reservations:
        headline = f"The move that was driven met its targets, but the axis does not: {'; '.join(findings.reservations)}."
    following = _following(folder, findings, drive)
    top = [
        headline,
        f"Next: {following}",
        "",
        *(words.verdict_lines(findings.verdict, findings.demand) if findings.verdict else []),
        *model_text(findings, error=error, compared=False),
        *(f"  {doubt}" for doubt in doubts),
        *gravity_text(folder, findings),
        *(words.design_lines(findings.design, findings.cascade) if findings.design and findings.cascade else []),
        *typed,
    ]
    details = [
        *(words.friction_lines(findings.friction) if findings.friction else []),
        *friction.standstill_lines(findings.standstill),
        *words.thesis_lines(findings.thesis),
    ]
    bottom = [
        *words.remarks_lines(findings.remarks),
        "",
        f"{findings.machine_seconds:.0f} s on the machine. Everything is in {folder.path}, this and the details in verdict.txt.",
        *([page] if page else []),
        f"{'The drive has the gains that a person has set in it' if findings.own_loop else state}. Next: {following}",
    ]
    return Ending(top, details, bottom)


def _own_headline(findings: Findings) -> str:
    """Of a drive whose gains only a person sets."""
    known = "The axis is identified and gains are designed; this drive's gains can only be typed in."
    if findings.verdict is None:
        return f"{known} No move was driven."
    met = "meets" if findings.verdict.passed else "misses"
    return f"{known} With those that stand in it now, the axis {met} its targets."


def _following(folder: RunFolder, findings: Findings, drive: str) -> str:
    """The command after a commissioning."""
    run = pasted(folder.path)
    if findings.final is None or findings.final.fit.suspect:
        return f"beltcomm diagnose {run}"
    if findings.own_loop and findings.meets_targets:
        return f"nothing has to be typed in: the loop in the drive does; gains for another one: beltcomm design {run}"
    if findings.own_loop:
        return f"type these gains in with the maker's tool, then beltcomm verify --drive {pasted(drive)} --run {run}"
    if findings.meets_targets and simulated(drive) and findings.applied == "restore":
        return f"beltcomm tune {run}   (other gains on a page; a virtual drive keeps none)"
    if not findings.meets_targets:
        return (
            "what would help stands above: other parts of the drive's controller, a drive that has them, or slower moves "
            f"(beltcomm verify --drive {pasted(drive)} --run {run} --move FILE)"
            if findings.reservations
            else f"look at the remarks above, then beltcomm design {run} and beltcomm verify --drive {pasted(drive)} --run {run}"
        )
    if findings.applied == "restore":
        return f"beltcomm apply --drive {pasted(drive)} --run {run}   (--save keeps them beyond power-off)"
    undo = " --save" if findings.applied == "save" else ""
    return f"beltcomm rollback --drive {pasted(drive)} --run {run}{undo} undoes it" + words.lasting(drive)
