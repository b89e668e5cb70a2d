"""The search for effects that are missing in the present model of a run."""

from __future__ import annotations

from collections.abc import Callable

from beltcomm.laboratory.diagnosis import MOST_EFFECTS, Diagnosis, diagnose
from beltcomm.laboratory.precompile import last_compiled
from beltcomm.laboratory.run_checks import Checked
from beltcomm.laboratory.scope import restrict_to_scope
from beltcomm.rundata.fitted_run import explainable, foretell, records_of, with_remarks_on_loads
from beltcomm.rundata.kept_fit import fit_base
from beltcomm.rundata.revisions import current_model
from beltcomm.runfolder import RunFolder
from beltcomm.sentences import ladder as words
from beltcomm.simulate.kernels import ahead
from beltcomm.talk import Talk, detail


def search_of(folder: RunFolder, talk: Talk, most: int = MOST_EFFECTS) -> tuple[Checked, Diagnosis, list[str]]:
    """The records of a run, what is missing in its present model, at most so many effects, and what these records cannot bear.

    Raises DataError for records that nothing can be said of.
    """
    ahead.begin(last_compiled())
    foretell(folder, talk)
    records = records_of(folder)
    talk.phase(1, 0, "search for missing effects")
    start, seen_so, base = fit_base(folder, records.recordings, current_model(folder))
    found = diagnose(
        records.recordings,
        folder.axis,
        start,
        begun=(seen_so, base),
        most=most,
        progress=staged(talk),
        trying=lambda candidate: detail(talk, words.trial_line(candidate)),
    )
    explainable(found.base.ratio, folder.path)
    restricted, doubts = restrict_to_scope(found, records.recordings)
    return with_remarks_on_loads(folder, records, restricted.final_fit), restricted, doubts


def staged(talk: Talk) -> Callable[[int, float], None]:
    """Progress of a search, each stage after the first a phase of its own."""
    last = 1

    def progress(stage: int, fraction: float) -> None:
        nonlocal last
        if stage > last:
            last = stage
            talk.phase(stage, 0, "search for what is still missing")
        talk.progress(fraction, None)

    return progress
