"""Findings of the laboratory, for ``--json``."""

from __future__ import annotations

import math
from typing import Any

from beltcomm.fit.estimate import Fitted
from beltcomm.fit.uncertainty.intervals import with_intervals
from beltcomm.laboratory.diagnosis import Diagnosis
from beltcomm.laboratory.figures import Plain
from beltcomm.laboratory.selection import Candidate
from beltcomm.laboratory.visible import DetectionLimit
from beltcomm.model import Model
from beltcomm.result import plain
from beltcomm.schedule.next_plan import by_hand_of


def diagnosis_data(found: Diagnosis, before: Plain, after: Plain) -> dict[str, Any]:
    """Everything of a diagnosis for ``--json``.

    Parameters
    ----------
    found : Diagnosis
    before, after : Plain
        Errors in plain units, fitted and held out.
    """
    first = found.steps[0].candidates if found.steps else ()
    return {
        "verdict": found.verdict,
        "named": list(found.added_effects),
        "base": {
            "effects": list(found.base.model.effects),
            **error_data(found.published_base[1], before),
            "parameters": values_of(with_intervals(found.published_base[1])),
        },
        "ranking": [_ranked(c) for c in first],
        "twins": list(found.twins),
        "by_hand": [entry for name in found.added_effects for entry in by_hand_of(name)],
        "steps": [
            {
                "added": step.added,
                "removed": list(step.removed),
                "detour": list(step.detour),
                "forms": list(step.forms),
                "ratio": step.after.ratio,
                "held_out": step.after.held_out_ratio,
                "ranking": [_ranked(c) for c in step.candidates],
            }
            for step in found.steps
        ],
        "after": {
            "effects": list(found.final_fit.model.effects),
            **error_data(found.published_model, after),
            "parameters": values_of(with_intervals(found.published_model)),
        },
    }


def error_data(fitted: Fitted, both: Plain) -> dict[str, Any]:
    """Error of a model, over the noise and in plain units, on the fitted records and on those held out.

    Parameters
    ----------
    fitted : Fitted
        The model.
    both : Plain
        Plain errors of the fitted records and of those held out.
    """
    return {
        "ratio": fitted.ratio,
        "held_out": fitted.held_out_ratio,
        "plain": {"overall": plain(both[0]), "held_out": plain(both[1])},
    }


def _ranked(candidate: Candidate) -> dict[str, Any]:
    """One line of the ranking."""
    return {
        "effect": candidate.effect.name,
        "evidence": candidate.evidence,
        "explained": max(0.0, candidate.explained),
        "held_out_gain": candidate.held_out_gain if candidate.fitted is not None and candidate.fitted.held_out_residuals else None,
        "accepted": candidate.accepted,
        "against": candidate.against,
        "beside": candidate.beside,
        "refitted": candidate.fitted is not None,
        "twin_of": list(candidate.effect.twins),
    }


def values_of(model: Model) -> dict[str, Any]:
    """Parameters of a model for ``--json``: value, unit and interval.

    Parameters
    ----------
    model : Model
    """
    return {name: {"value": v.value, "unit": v.unit, "interval": v.interval} for name, v in model.parameters.items()}


def seen_as(one: DetectionLimit) -> dict[str, Any]:
    """One limit of detection for ``--json``; null for an effect that is never seen.

    Parameters
    ----------
    one : DetectionLimit
        In the unit of its parameter.
    """
    weakest, hardest = (None if math.isinf(v) else v for v in (one.weakest, one.hardest))
    known = {"parameter": one.parameter, "typical": one.size, "unit": one.unit, "seen": one.is_detectable}
    return {"effect": one.effect.name, "weakest": weakest, "usual": hardest, **known}
