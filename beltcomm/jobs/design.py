"""What ``design`` and ``tune`` share: what a design rests on in a run, its proof on the run's own data, and keeping it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from beltcomm.control import CascadeStructure
from beltcomm.errors import UsageError
from beltcomm.experiments import referencing
from beltcomm.given import pasted
from beltcomm.laboratory.cross_checks import sheet_doubts
from beltcomm.model import Model
from beltcomm.pages import pictures as drawn
from beltcomm.recording import Recording
from beltcomm.result import Result, plain
from beltcomm.rundata import offline
from beltcomm.rundata.delays import measure_delay_and_damping
from beltcomm.rundata.design_proof import grounds_of, prove
from beltcomm.rundata.findings import Findings
from beltcomm.rundata.fitted_run import records_of
from beltcomm.rundata.kept_path import kept_path
from beltcomm.rundata.proof import SUSPECT, doubts, error_of, suspect, thin_margins
from beltcomm.runfolder import RunFolder
from beltcomm.sentences import outcome, typed_gains, words
from beltcomm.sentences.cross_checks import sheet_lines
from beltcomm.sentences.design_proof import proof_lines


@dataclass(frozen=True)
class Basis:
    """What a design of a run rests on.   which : a sentence on the model's ``revision``.   findings : delay and damping, no design yet."""

    folder: RunFolder
    model: Model
    revision: str
    which: str
    findings: Findings
    structure: CascadeStructure
    recordings: Sequence[Recording]


def basis_of(run: Path) -> Basis:
    """The trusted model of a run, its drive, delay and damping.   Raises DataError."""
    folder = RunFolder.open(run)
    if not folder.axis.has_belt:
        raise UsageError(
            f"{folder.axis} has neither belt nor pulley; the controller is designed for a motor that drives a carriage by a belt. What the "
            f"laboratory knows of this axis: `beltcomm report {pasted(run)}`"
        )
    model, revision, which = offline.trusted_revision(folder)
    findings = Findings(kept_path=kept_path(folder))
    records = records_of(folder)
    recordings = records.recordings
    findings.remarks += records.remarks
    measure_delay_and_damping(findings, [r for r in recordings if r.sidecar.experiment == "frf"], model)
    return Basis(folder, model, revision, which, findings, offline.structure_of(folder, findings), recordings)


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

    along : effects that ``verify`` compensates.   payload_kg : heaviest further load.   seed : of the draws.   noted : what else is kept.
    """
    folder, findings = basis.folder, basis.findings
    assert findings.design is not None
    assert findings.cascade is not None
    if not offline.place_known(basis.recordings):
        findings.design = replace(findings.design, remarks=(*findings.design.remarks, offline.ONE_PLACE))
    if (remark := referencing.slow_payload(folder.axis, basis.model["cart.mass"], payload_kg)) is not None:
        findings.remarks.append(remark)
    grounds = grounds_of(folder, basis.model, basis.revision, findings, (payload_kg,) if payload_kg else ())
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
        **(noted or {}),
    }
    sound = "final" in folder.names("designs") and not doubts(folder)
    folder.save_design("final", mapping)
    if sound and doubts(folder):
        findings.remarks.append("the gains before were proven by a move and are replaced; these are not proven yet, verify them")
    unexplained = [SUSPECT] if suspect(folder) else []
    sheets = sheet_doubts(basis.model, error_of(folder, basis.revision), folder.axis, basis.recordings)
    text = [
        *words.design_lines(findings.design, findings.cascade),
        *typed_gains.of_run(folder, findings.cascade),
        *words.knowledge_lines(basis.model, along, basis.which),
        *lines,
        *sheet_lines(sheets),
        *words.remarks_lines(findings.remarks),
        *(f"This design is in doubt: {why}." for why in (*unexplained, *thin_margins(findings.design.margins), *proof.doubts)),
        f"Next: beltcomm verify --drive DRIVE --run {pasted(folder.path)}",
    ]
    unfit = findings.design.relaxed or proof.has_failed or unexplained
    return Result({"run": str(folder.path), **mapping, "data_sheet": plain(sheets), "pictures": made}, text, 1 if unfit else 0)
