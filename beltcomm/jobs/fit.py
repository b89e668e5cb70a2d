"""``beltcomm fit RUN``: the model from the recordings of a run."""

from __future__ import annotations

from typing import Literal

from beltcomm.experiments.options import Options
from beltcomm.given import Place, pasted, place
from beltcomm.identify.magnitude_fit import Solver
from beltcomm.jobs.third_mass import fit_three_masses
from beltcomm.language import tr
from beltcomm.locks import changes_run
from beltcomm.result import Line, Result, plain
from beltcomm.rundata import offline
from beltcomm.runfolder import RunFolder
from beltcomm.sentences import friction as friction_words
from beltcomm.sentences import outcome, words
from beltcomm.sentences.cross_checks import sheet_lines
from beltcomm.sentences.own_words import own_words
from beltcomm.talk import Silence, Talk

#: How a fit ends that leaves many times the noise.
SUSPECT = (
    "The model does not explain what was measured: it is kept to look at, and nothing should be designed with it. Add the effect that "
    "`beltcomm diagnose` names, or mend the records."
)


@own_words
@changes_run()
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
    """Fit the model to all recordings of a run; no machine needed.

    Parameters
    ----------
    run : Place
        Run folder.
    solver : Solver or None
        How the fit is minimised; None for the usual one.
    model : {'two-mass', 'three-mass'}
        "three-mass" fits the end pulley too, and saves it as a revision (noted with command, when) where the records hold it.
    command : str
        Command line, kept as provenance.
    when : str
        Date and time, kept as provenance.
    options : Options or None
        Settings beside the main arguments; None for the safe defaults.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        Values with 95 % intervals; exit code 1 for a model that does not explain the records.

    Raises
    ------
    DataError
        Without usable recordings.
    """
    del options
    run, talk = place(run), talk or Silence()
    if model == "three-mass":
        return fit_three_masses(run, command=command, when=when, talk=talk)
    folder = RunFolder.open(run)
    talk.phase(1, 1, "fit")
    findings = offline.fit_run(folder, solver or "lm", talk)
    outcome.save(folder, findings)
    friction = words.friction_lines(findings.friction) if findings.friction else []
    friction += friction_words.standstill_lines(findings.standstill)
    suspect = findings.final is None or findings.final.fit.suspect
    sheets = sheet_lines(findings.sheets)
    state = (tr("DOES NOT EXPLAIN"), "bad") if suspect else (tr("FITTED"), "good")
    said = tr("what was measured: nothing should be designed with this model") if suspect else tr("a model of all records of this run")
    text = [
        Line(""),
        Line("  ", state, "   ", (said, "title")),
        Line(""),
        *outcome.model_screen(folder, findings),
        f"Next: beltcomm improve {pasted(run)}   (names what the model lacks, adds it, designs again)"
        if suspect
        else f"Next: beltcomm design {pasted(run)}   (gains with margins)",
    ]
    details = [
        *outcome.model_text(findings),
        *sheets,
        *friction,
        *words.remarks_lines(findings.remarks),
        *([SUSPECT] if suspect else []),
    ]
    return Result({**outcome.data(folder, findings), "data_sheet": plain(findings.sheets)}, text, 1 if suspect else 0, details=details)
