"""What ``beltcomm design`` adds to a design: its proof on the run's own data, in words, numbers and pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from beltcomm.model import Model
from beltcomm.runfolder import RunFolder
from beltcomm.session import pictures as drawn
from beltcomm.session.commission import Findings
from beltcomm.session.design_proof import grounds_of, prove
from beltcomm.session.design_proof_words import proof_lines


@dataclass(frozen=True)
class Examined:
    """data : for programs.   lines : for people.   doubts : what speaks against the gains, ``failed`` when they are not to be used.

    pictures : paths in the run folder.
    """

    data: dict[str, Any]
    lines: list[str]
    doubts: tuple[str, ...]
    failed: bool
    pictures: list[str]


def examined(
    folder: RunFolder,
    model: Model,
    revision: str,
    findings: Findings,
    payloads_kg: Sequence[float],
    seed: int,
    pictures: bool,
    command: str,
) -> Examined:
    """The proof of the design in ``findings`` on the records of its run.   revision : of the model.   seed : of the draws."""
    assert findings.design is not None
    assert findings.cascade is not None
    recordings = folder.recordings()
    grounds = grounds_of(folder, model, revision, findings, payloads_kg)
    proof = prove(grounds, findings.design, findings.cascade, recordings, seed=seed)
    lines = proof_lines(proof, grounds, findings.design.specification)
    made: list[str] = []
    if pictures:
        made, remarks = drawn.proof_picture(folder, findings.design, findings.cascade, proof, recordings, grounds.delay_s, command)
        lines += [f"  {line}" for line in drawn.lines(folder, made, remarks)]
    return Examined(proof.to_dict(), lines, proof.doubts, proof.failed, made)
