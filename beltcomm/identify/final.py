"""From the recordings of a run to its final model: start values, the belt's law, the fit over everything at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from beltcomm.axis import Axis
from beltcomm.effects import effect_named
from beltcomm.effects.belt_spans import stiffness as stiffness_at
from beltcomm.errors import DataError
from beltcomm.identify.first_estimate import data_sheet_model, first_estimate
from beltcomm.identify.inverse_fit import OUTLIER, InverseFit, fit_inverse
from beltcomm.identify.residual import Stretch, stretches, whitened
from beltcomm.model import Model
from beltcomm.recording import Recording

#: A stiffness that differs by more than this between places calls for a belt law by position; the law itself is then judged
#: by the misfit it leaves.
STIFFNESS_SPREAD = 0.02
#: m; records nearer to each other than this cannot tell a law of the stiffness along the travel.
PLACES_APART_M = 0.05
#: N m; the residuals of single records are only compared with each other, so any usual torque noise will do.
USUAL_NOISE_NM = 6e-3


@dataclass(frozen=True)
class FinalModel:
    """The chosen fit, the one it was compared with, and in words why it was chosen."""

    fit: InverseFit
    rejected: InverseFit | None
    reason: str


def final_model(
    recordings: Sequence[Recording],
    axis: Axis,
    counts_per_rev: int,
    *,
    start: Model | None = None,
    progress: Callable[[float], None] = lambda _fraction: None,
) -> FinalModel:
    """Fit all recordings with a constant belt stiffness, and by position where the places disagree; keep the better.

    ``start`` replaces the start values found from the excited records.
    Raises DataError when there is no excited record to start from, or none is usable.
    """
    if start is None:
        excited = [r for r in recordings if r.sidecar.experiment == "frf" and not r.sidecar.held_out]
        if not excited:
            raise DataError(
                "no recording with an excitation (experiment: frf); record one with `beltcomm identify`, or if one of the recordings "
                "is excited, say so in its sidecar"
            )
        longest = max(excited, key=lambda r: len(r.t_s))
        place = longest.sidecar.start_position_m or 0.0
        # Twice, because the share of the carriage in the friction is assumed and not found: first its level must be known.
        level = first_estimate([longest], data_sheet_model(axis, place, 0.0), counts_per_rev)["coulomb.level"]
        start = first_estimate([longest], data_sheet_model(axis, place, level), counts_per_rev)
    start = as_constant(start, float(np.median([r.sidecar.start_position_m or 0.0 for r in recordings])))
    constant = fit_inverse(recordings, start, counts_per_rev=counts_per_rev, progress=lambda f: progress(0.5 * f))
    places = stiffness_by_record(recordings, constant.model, counts_per_rev)
    spread = max(places.values()) / min(places.values()) - 1.0 if places else 0.0
    at = [r.sidecar.start_position_m or 0.0 for r in recordings if r.name in places]
    if spread < STIFFNESS_SPREAD or max(at) - min(at) < PLACES_APART_M:
        progress(1.0)
        equal = f"stiffness is equal at all places within {100 * spread:.1f} %: taken as constant"
        return FinalModel(constant, None, equal if spread < STIFFNESS_SPREAD else "measured at one place: stiffness taken as constant")
    varying_start = by_position(constant.model, axis, recordings, places)
    varying = fit_inverse(
        recordings,
        varying_start,
        counts_per_rev=counts_per_rev,
        fixed=("transmission.ratio", "belt_spans.pulley_distance"),
        progress=lambda f: progress(0.5 + 0.5 * f),
    )
    better, other = (varying, constant) if varying.misfit < constant.misfit else (constant, varying)
    law = "by position (2.26)" if better is varying else "constant"
    return FinalModel(
        better,
        other,
        f"stiffness differs by {100 * spread:.0f} % between places; {law} fits better: "
        f"misfit {better.misfit:.3g} against {other.misfit:.3g}",
    )


def stiffness_by_record(recordings: Sequence[Recording], model: Model, counts_per_rev: int) -> dict[str, float]:
    """Belt stiffness that each excited record wants for itself, all else as in ``model``, N/m; held-out records are not asked."""
    found = {}
    place = model.index("belt_stiffness.stiffness")
    for recording in recordings:
        if recording.sidecar.experiment != "frf" or recording.sidecar.held_out:
            continue
        pieces = stretches(recording, model, 2.0 * np.pi / counts_per_rev, USUAL_NOISE_NM, fitted=True)
        if not sum(int(p.keep.sum()) for p in pieces):
            continue

        def cost(logarithm: float, pieces: Sequence[Stretch] = pieces) -> float:
            vector = model.vector()
            vector[place] *= np.exp(logarithm)
            return float(sum(np.sum(np.minimum(whitened(p, model, vector) ** 2, OUTLIER)) for p in pieces))

        coarse = np.log(np.geomspace(0.25, 6.0, 30))
        best = coarse[int(np.argmin([cost(float(c)) for c in coarse]))]
        step = coarse[1] - coarse[0]
        refined = minimize_scalar(cost, bounds=(best - step, best + step), method="bounded", options={"xatol": 1e-3})
        found[recording.name] = float(np.exp(refined.x)) * model["belt_stiffness.stiffness"]
    return found


def as_constant(model: Model, position_m: float) -> Model:
    """A model with the belt law by position, as one with the constant stiffness that the law has at a place."""
    if "belt_spans" not in model.effects:
        return model
    names = ("specific_stiffness", "pulley_distance", "offset")
    stiffness = stiffness_at(position_m, *(model[f"belt_spans.{name}"] for name in names))
    constant = model.without_effect("belt_spans").with_effect("belt_stiffness", {"stiffness": stiffness}, "final fit")
    order = ("belt_stiffness", *(e for e in constant.effects if e != "belt_stiffness"))
    return Model(model.name, order, constant.parameters, model.base_bodies, model.source)


def by_position(model: Model, axis: Axis, recordings: Sequence[Recording], places: dict[str, float]) -> Model:
    """The model with the belt law (2.26) instead of a constant stiffness, started from the stiffness of each place."""
    distance = float(axis.get("belt.pulley_distance_m") or 0.0)
    offset = axis.travel.driven_side_offset_m
    at = {r.name: r.sidecar.start_position_m or 0.0 for r in recordings}
    shares = [value / stiffness_at(at[name], 1.0, distance, offset) for name, value in places.items()]
    values = {"specific_stiffness": float(np.median(shares)), "pulley_distance": distance, "offset": offset}
    position = effect_named("belt_spans")
    without = model.without_effect("belt_stiffness").with_effect(position.name, values, "final fit")
    order = (position.name, *(e for e in without.effects if e != position.name))
    return Model(model.name, order, without.parameters, model.base_bodies, model.source)
