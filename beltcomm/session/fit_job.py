"""``beltcomm fit RUN``: the model from the recordings of a run."""

from __future__ import annotations

from typing import Literal

from beltcomm.given import Place, pasted, place
from beltcomm.identify.magnitude_fit import Solver
from beltcomm.result import Result
from beltcomm.runfolder import RunFolder
from beltcomm.session import friction_words, offline, outcome, words
from beltcomm.session.options import Options
from beltcomm.session.third_mass import fit_three_masses
from beltcomm.talk import Silence, Talk


def fit(
    run: Place,
    *,
    solver: Solver | None = None,
    model: Literal["two-mass", "three-mass"] = "two-mass",
    command: str = "",
    when: str = "",
    options: Options | None = None,
    talk: Talk | None = None,
) -> Result:
    """The model from all recordings of a run; no machine needed.   Raises DataError.

    model : "three-mass" fits the end pulley too, and saves it as a revision (noted with command, when) where the records hold it.
    """
    del options
    run, talk = place(run), talk or Silence()
    if model == "three-mass":
        return fit_three_masses(run, command=command, when=when, talk=talk)
    folder = RunFolder.open(run)
    talk.phase(1, 1, "fit")
    findings = offline.fitted(folder, solver or "lm", talk)
    outcome.save(folder, findings)
    friction = words.friction_lines(findings.friction) if findings.friction else []
    friction += friction_words.standstill_lines(findings.standstill)
    following = "diagnose" if findings.final is None or findings.final.fit.suspect else "design"
    text = [*outcome.model_text(findings), *friction, *words.remarks_lines(findings.remarks), f"Next: beltcomm {following} {pasted(run)}"]
    return Result(outcome.data(folder, findings), text)
