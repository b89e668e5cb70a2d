"""A fitted base model kept beside a run, so that what was found once is evaluated again and not searched for again."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from beltcomm.arrays import Array
from beltcomm.axis import Axis
from beltcomm.caches import source_hash
from beltcomm.fit.estimate import Fitted, evaluate_at, problem_of
from beltcomm.fit.likelihood.problem import Problem
from beltcomm.fit.records import Data, prepare_records
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.fit.torque.path import path_from_dict, path_to_dict
from beltcomm.fit.uncertainty.nuisance import with_nuisance
from beltcomm.model import Model, model_from_dict
from beltcomm.recording import Recording

#: Fine steps of a sample, at most: a file may ask for a day of computing.
_MOST_SUBSTEPS = 1000


def key_of(records: Mapping[str, str], axis: Axis) -> str:
    """Equal only where the same programs would fit a model to the same records.

    Parameters
    ----------
    records : dict of str to str
        Name -> SHA-256, sidecars too.
    """
    return _hash([dict(sorted(records.items())), axis.fingerprint(), source_hash()])


def key_of_model(start: Model | None) -> str:
    """Equal only for the same model; None where it follows from records and axis.

    Parameters
    ----------
    start : Model or None
        With which a fit begins.

    Returns
    -------
    str
        A hash.
    """
    return _hash(start.to_dict() if start is not None else None)


def _hash(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def store_fit(data: Data, fitted: Fitted) -> dict[str, Any] | None:
    """Mapping for :func:`restore_fit`; None for a model with an observer, whose gains go with the way of the search.

    Parameters
    ----------
    data : Data
        The records, with path and noise.
    fitted : Fitted
        The fit to them.

    Returns
    -------
    dict or None
        For JSON.
    """
    if needs_observer(fitted.model):
        return None
    return {
        "made_by": fitted.problem.model.to_dict(),
        "fixed": [name for name in fitted.model.parameters if name not in fitted.problem.free],
        "path": path_to_dict(data.path),
        "substeps": data.substeps,
        "reversals": data.reversals,
        "colour": float(data.colour),
        "single": data.single,
        "unknowns": [float(x) for x in fitted.x],
        "likeliest": [float(x) for x in fitted.likeliest.x] if fitted.likeliest is not None else None,
        "shares": {piece.record: [float(share) for share in piece.rounding] for piece in (*data.fitted, *data.held_out)},
        "noise_nm": float(data.noise_nm),
        "step_rad": float(data.step_rad),
    }


def restore_fit(recordings: Sequence[Recording], found: Mapping[str, Any]) -> tuple[Data, Fitted]:
    """The fit at its minimum: one evaluation, no search.

    Raises
    ------
    BeltcommError
        Or what Python says of damaged values.
    """
    model = model_from_dict(found["made_by"])
    shares = {str(name): (float(white), float(slow)) for name, (white, slow) in found["shares"].items()}
    timed = [r for r in recordings if not r.is_static_map]
    path, substeps = path_from_dict(found["path"]), int(found["substeps"])
    if not 1 <= substeps <= _MOST_SUBSTEPS:
        raise ValueError(f"{substeps} fine steps a sample")
    data = prepare_records(
        timed,
        model,
        float(found["noise_nm"]),
        float(found["step_rad"]),
        shares,
        substeps,
        path,
        bool(found["reversals"]),
        float(found["colour"]),
        bool(found["single"]),
    )
    problem = problem_of(data, model, found["fixed"])
    fitted = evaluate_at(data, problem, _unknowns(found["unknowns"], problem))
    if found["likeliest"] is not None:
        fitted = replace(fitted, likeliest=evaluate_at(data, problem, _unknowns(found["likeliest"], problem)))
    return data, with_nuisance(data, fitted)


def _unknowns(kept: Sequence[float], problem: Problem) -> Array:
    x = np.array(kept, dtype=np.float64)
    if x.shape != problem.scale.shape:
        raise ValueError(f"{len(x)} unknowns kept, {len(problem.scale)} needed")
    return x
