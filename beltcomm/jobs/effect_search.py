"""The search for effects that are missing in the present model of a run.

What a search compiles last it compiles while it waits for what another process compiles (``simulate.kernels.ahead``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from beltcomm.effects import EFFECTS
from beltcomm.fit.start.model import start_model
from beltcomm.laboratory.diagnosis import MOST_EFFECTS, Diagnosis, diagnose
from beltcomm.laboratory.run_checks import Checked
from beltcomm.laboratory.scope import restrict_to_scope
from beltcomm.laboratory.score import gain_kernel, load_kernel
from beltcomm.laboratory.selection import MISSING
from beltcomm.recording import Recording
from beltcomm.rundata.fitted_run import explainable, foretell, records_of, with_remarks_on_loads
from beltcomm.rundata.kept import fit_base
from beltcomm.rundata.revisions import current_model
from beltcomm.runfolder import RunFolder
from beltcomm.sentences import ladder as words
from beltcomm.sentences.torque_path import period_of
from beltcomm.simulate.kernels import ahead
from beltcomm.simulate.kernels.compose import inverse_kernel
from beltcomm.simulate.kernels.observer import idle
from beltcomm.simulate.kernels.writer import catalogue_parameters
from beltcomm.simulate.lock_step import Lane, lock_step
from beltcomm.talk import Talk, detail

#: Share of a row by which a dead time may differ from one, and still be one.
LIKE_ONE_ROW = 0.2


def search_of(folder: RunFolder, talk: Talk, most: int = MOST_EFFECTS) -> tuple[Checked, Diagnosis, list[str]]:
    """The records of a run, what is missing in its present model, at most so many effects, and what these records cannot bear.

    Parameters
    ----------
    folder : RunFolder
    talk : Talk
    most : int
        Effects that are named.

    Returns
    -------
    tuple of Checked, Diagnosis and list of str
        Records, diagnosis, and sentences.

    Raises
    ------
    DataError
        For records that nothing can be said of.
    """
    ahead.begin(_last_compiled())
    foretell(folder, talk)
    records = records_of(folder)
    talk.phase(1, 0, "search for missing effects")
    start, seen_so, base = fit_base(folder, records.recordings, current_model(folder))
    if base.objective > MISSING * base.problem.samples:  # a model that made up for what is missing is no place to look from
        start = start_model(folder.axis, records.recordings)
    found = diagnose(
        records.recordings,
        folder.axis,
        start,
        begun=(seen_so, base),
        most=most,
        progress=_staged(talk),
        trying=lambda candidate: detail(talk, words.trial_line(candidate)),
    )
    explainable(found.base.ratio, folder.path)
    restricted, doubts = restrict_to_scope(found, records.recordings)
    doubts += _one_row_early(restricted, records.recordings)
    return with_remarks_on_loads(folder, records, restricted.final_fit), restricted, doubts


def _one_row_early(found: Diagnosis, recordings: Sequence[Recording]) -> list[str]:
    """Sentence on a torque and setpoint that act a row before their time stamp, as no drive makes them; none where they do not."""
    name, period_s = "dead_time.time", period_of(recordings)
    model = found.final_fit.model
    if name not in model.parameters or abs(model[name] / period_s + 1.0) > LIKE_ONE_ROW:
        return []
    return [
        f"A dead time of {1e3 * model[name]:.3g} ms is one row of {1e3 * period_s:.3g} ms the wrong way: no drive acts before it is asked, "
        "but a recorder may write a period's torque beside the angle at its end. Where it does, import the records again with "
        "--torque-acts before."
    ]


def _staged(talk: Talk) -> Callable[[int, float], None]:
    """Progress of a search, each stage after the first a phase of its own."""
    last = 1

    def progress(stage: int, fraction: float) -> None:
        nonlocal last
        if stage > last:
            last = stage
            talk.phase(stage, 0, "search for what is still missing")
        talk.progress(fraction, None)

    return progress


def _last_compiled() -> list[Callable[[], object]]:
    """Calls on next to nothing, with the types of every other call, in the order in which a search makes them."""
    a, b, c, d, out, torque = np.zeros((6, 3))
    torque.flags.writeable = False  # as a recorded one
    means, p, on = np.zeros((2, 1)), np.ones(len(catalogue_parameters())), np.zeros(len(EFFECTS), dtype=np.bool_)
    kernel, delays = inverse_kernel(), [e.law for e in EFFECTS if e.slot == "torque_delay" and e.law is not None]
    readings = [e.law for e in EFFECTS if e.slot == "torque_reading" and e.law is not None]
    return [
        lambda: load_kernel(a, b, c, d, 2, means),
        lambda: gain_kernel(a, b, c, d, torque, 2, means),
        lambda: kernel.torque(a[:2], b, p, on, 0.0, 1.0, out),
        *(lambda law=law: law(a, 1.0, 1.0) for law in delays),
        *(lambda law=law: law(a, 0.0, 1.0, 1.0) for law in readings),
        lambda: kernel.angle(a, b, p, on),
        lambda: lock_step([Lane(np.zeros(1), np.zeros(1), 0.0, 0.0, 1.0, p, idle())], on, 1.0),
    ]
