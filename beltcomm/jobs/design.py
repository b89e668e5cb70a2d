"""Parts that ``design`` and the page with sliders share: the basis of a design in a run, its proof on the run's data, and keeping it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from beltcomm.control import CascadeStructure
from beltcomm.errors import DataError, UsageError
from beltcomm.experiments import referencing
from beltcomm.given import pasted
from beltcomm.laboratory.cross_checks import sheet_doubts
from beltcomm.language import tr
from beltcomm.locks import at_work, occupied
from beltcomm.model import Model
from beltcomm.pages import pictures as drawn
from beltcomm.recording import Recording
from beltcomm.result import Line, Result, plain
from beltcomm.rundata import offline
from beltcomm.rundata.delays import measure_delay_and_damping
from beltcomm.rundata.design_proof import grounds_of, prove
from beltcomm.rundata.findings import Findings
from beltcomm.rundata.fitted_run import records_of
from beltcomm.rundata.headline import OF, hashes_of, headline_of, next_command
from beltcomm.rundata.kept import kept_path
from beltcomm.rundata.proof import SUSPECT, doubts, error_of, same_gains, suspect, thin_margins
from beltcomm.rundata.revisions import current_revision, unfitted
from beltcomm.rundata.store import saved_design
from beltcomm.runfolder import RunFolder, next_free
from beltcomm.sentences import outcome, screens, typed_gains, words
from beltcomm.sentences.cross_checks import sheet_lines
from beltcomm.sentences.design_proof import proof_lines
from beltcomm.talk import Talk


@dataclass(frozen=True)
class Basis:
    """Basis of a design in a run.

    Attributes
    ----------
    which : str
        A sentence on the model's ``revision``.
    findings : Findings
        Delay and damping, no design yet.
    """

    folder: RunFolder
    model: Model
    revision: str
    which: str
    findings: Findings
    structure: CascadeStructure
    recordings: Sequence[Recording]


def basis_of(run: Path, talk: Talk) -> Basis:
    """The trusted model of a run, its drive, delay and damping; fitted anew where the run has records since.

    Parameters
    ----------
    run : Path
    talk : Talk

    Raises
    ------
    UsageError
        For an axis without belt and pulley.
    DataError
        Without a model that can be trusted.
    """
    folder = RunFolder.open(run)
    if not folder.axis.has_transmission:
        raise UsageError(
            f"{folder.axis} has neither belt nor pulley; the controller is designed for a motor that drives a carriage by a belt. What the "
            f"laboratory knows of this axis: `beltcomm report {pasted(run)}`"
        )
    since = unfitted(folder)
    if since and current_revision(folder) is None:
        with occupied(folder.path, talk, refusal=lambda holder: at_work(folder.path, holder)):
            talk.phase(1, 1, "fit")
            outcome.save(folder, offline.fit_run(folder, "lm", talk))
    model, revision, which = offline.trusted_revision(folder)
    findings = Findings(kept_path=kept_path(folder))
    findings.remarks += [_since(folder, since)] if since else []
    records = records_of(folder)
    recordings = records.recordings
    findings.remarks += records.remarks
    measure_delay_and_damping(findings, [r for r in recordings if r.sidecar.experiment == "frf"], model)
    return Basis(folder, model, revision, which, findings, offline.structure_of(folder, findings), recordings)


def _since(folder: RunFolder, names: Sequence[str]) -> str:
    if unfitted(folder):
        return (
            f"{', '.join(names)} was recorded since the model's last revision, which was not fitted to it: `beltcomm compare "
            f"{pasted(folder.path)}` says whether the model holds there too"
        )
    return f"the model was fitted anew, for {', '.join(names)} was recorded since"


def delivered(
    basis: Basis,
    along: Sequence[str],
    payload_kg: float | None,
    *,
    seed: int = 0,
    pictures: bool = False,
    command: str = "",
    noted: Mapping[str, Any] | None = None,
) -> Result:
    """The design in the findings, proven on the run's own data and kept as ``designs/final.yaml``.   Exit code 1 for one not to be used.

    Parameters
    ----------
    basis : Basis
        Trusted model of the run, its drive and delay.
    along : sequence of str
        Effects that ``verify`` compensates.
    payload_kg : float or None
        Heaviest further load.
    seed : int
    pictures : bool
        True for pictures into the run.
    command : str
        Kept as provenance.
    noted : Mapping[str, Any] or None
        What else is kept.
    """
    folder, findings = basis.folder, basis.findings
    assert findings.design is not None
    assert findings.cascade is not None
    if not _place_known(basis.recordings):
        findings.design = replace(findings.design, remarks=(*findings.design.remarks, offline.ONE_PLACE))
    if (remark := referencing.slow_payload(folder.axis, basis.model["cart.mass"], payload_kg)) is not None:
        findings.remarks.append(remark)
    grounds = grounds_of(folder, basis.model, findings, (payload_kg,) if payload_kg else ())
    proof = prove(grounds, findings.design, findings.cascade, basis.recordings, seed=seed)
    lines = proof_lines(proof, grounds, findings.design.specification)
    made: list[str] = []
    if pictures:
        made, unmade = drawn.proof_picture(folder, findings.design, findings.cascade, proof, basis.recordings, grounds.delay_s, command)
        lines += [f"  {line}" for line in drawn.lines(folder, made, unmade)]
    mapping = {
        **outcome.design_dict(findings),
        "revision": basis.revision,
        "compensated": list(along),
        "proof": proof.to_dict(),
        OF: hashes_of(findings.cascade, basis.model),
        **(noted or {}),
    }
    kept = _keep_damaged(folder)
    sound = "final" in folder.names("designs") and not doubts(folder)
    kept = kept or _keep_replaced(folder, mapping)
    folder.save("designs", "final", mapping)
    if sound and doubts(folder):
        findings.remarks.append("the gains before were proven by a move and are replaced; these are not proven yet, verify them")
    unexplained = [SUSPECT] if suspect(folder) else []
    sheets = sheet_doubts(basis.model, error_of(folder, basis.revision), folder.axis, basis.recordings)
    doubted = [f"in doubt: {why}" for why in (*unexplained, *thin_margins(findings.design.margins), *proof.doubts)]
    warnings = [*doubted, *screens.sheet_words(plain(list(sheets))), *findings.remarks]
    text = [
        Line(""),
        _headline(basis, doubted),
        Line(""),
        screens.model_line(error_of(folder, basis.revision), bool(unexplained)),
        *screens.design_screen(findings.design, findings.cascade),
        *screens.proof_lines(proof),
        *([Line("   ", f"{tr('replaced'):<9}{kept}")] if kept else []),
        *screens.warning_lines(warnings),
        *screens.next_lines(next_command(folder, headline_of(folder))),
    ]
    details = [
        *words.design_lines(findings.design, findings.cascade),
        *typed_gains.of_run(folder, findings.cascade),
        *words.knowledge_lines(basis.model, along, basis.which),
        *lines,
        *sheet_lines(sheets),
        *words.remarks_lines(findings.remarks),
    ]
    unfit = findings.design.relaxed or proof.has_failed or unexplained
    return Result(
        {"run": str(folder.path), **mapping, "data_sheet": plain(sheets), "pictures": made, "replaced": kept},
        text,
        1 if unfit else 0,
        details=details,
    )


def _headline(basis: Basis, doubted: Sequence[str]) -> Line:
    """Headline on whether the gains may be used, before a move has proven them."""
    name = (basis.folder.axis.name if basis.folder.has_axis else "") or "the axis"
    word = (tr("IN DOUBT"), "bad") if doubted else (tr("DESIGNED"), "good")
    proven = headline_of(basis.folder).state in ("pass", "fail")
    said = "{name}: the gains that were verified before" if proven else "{name}: gains that no move has proven yet"
    return Line("  ", word, "   ", (tr(said, name=name), "title"))


def _keep_damaged(folder: RunFolder) -> str:
    """Before another design takes its place, one that cannot be read stays as ``designs/replaced_N.yaml``; its name, "" for a sound one."""
    kept = folder.names("designs")
    if "final" not in kept:
        return ""
    try:
        saved_design(folder)
    except DataError:
        name = next_free("replaced_", kept)
        folder.set_aside("designs", "final", name)
        return f"designs/{name}.yaml"
    return ""


def _keep_replaced(folder: RunFolder, other: Mapping[str, Any]) -> str:
    """Before another design takes its place, today's stays as ``designs/replaced_N.yaml``; its name, "" where none is lost."""
    if "final" not in folder.names("designs") or same_gains(folder.load("designs", "final").get("parameters"), other["parameters"]):
        return ""
    name = next_free("replaced_", folder.names("designs"))
    folder.save("designs", name, folder.load("designs", "final"))
    return f"designs/{name}.yaml"


def _place_known(recordings: Sequence[Recording]) -> bool:
    """True if some excited recording says where along the travel it was made."""
    return any(r.sidecar.start_position_m is not None for r in recordings if r.sidecar.experiment == "frf")
