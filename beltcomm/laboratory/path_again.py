"""The torque path once more, beside what a base lacked that it was told by; and without the delays that were named for its faults."""

from __future__ import annotations

from beltcomm.fit.base import NEXT_ITERATIONS, likeliest_path
from beltcomm.fit.estimate import Fitted, fit
from beltcomm.fit.path_fit.late_motion import BESIDE, BETWEEN
from beltcomm.fit.path_fit.values import refine_path
from beltcomm.fit.records import Data
from beltcomm.laboratory.acceptance import EVIDENCE
from beltcomm.laboratory.law_shape import without
from beltcomm.model import Model


def path_again(data: Data, fitted: Fitted, base: Model, newest: str) -> tuple[Data, Fitted, tuple[str, ...]]:
    """Records and fit by the path as a grown model has it, and the delays named before that it can do without.

    Parameters
    ----------
    data : Data
    fitted : Fitted
        With the newest effect.
    base : Model
        Model that the search began with.
    newest : str
        Name of the effect that was added last, which stays.
    """
    data, fitted = likeliest_path(*refine_path(data, fitted))
    removed = []
    for name in (*BETWEEN, *BESIDE):
        smaller = without(fitted.model, name) if name in fitted.model.effects and name not in (*base.effects, newest) else None
        if smaller is None:
            continue
        ahead, other = likeliest_path(*refine_path(data, fit(data, smaller, NEXT_ITERATIONS, offsets=fitted.offsets)))
        if fitted.problem.samples * (_level(other) - _level(fitted)) < EVIDENCE:
            data, fitted = ahead, other
            removed.append(name)
    return data, fitted, tuple(removed)


def _level(fitted: Fitted) -> float:
    return fitted.objective / max(fitted.problem.samples, 1)
