"""From the recordings of a run to its final model: start values, the belt's law, the fit over everything at once."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from beltcomm.axis import Axis
from beltcomm.axis.kinds import KINDS
from beltcomm.effects import effect_named
from beltcomm.effects.belt_spans import stiffness as stiffness_at
from beltcomm.errors import DataError
from beltcomm.fit.model_fit import FEWEST_SAMPLES, SUSPECT_MISFIT, ModelFit, fit_model
from beltcomm.fit.residual.encoder_jumps import proven_jumps, refuse
from beltcomm.fit.residual.segment import Segment, segments
from beltcomm.fit.residual.whitened import OUTLIER, whitened_residual
from beltcomm.fit.start.first_estimate import NEEDED
from beltcomm.fit.start.model import belt_start, correct_by_slow_motion, data_sheet
from beltcomm.fit.start.undersampled import SELDOM_S, comes_seldom
from beltcomm.fit.torque.acting_torque import acting_recording
from beltcomm.fit.torque.path import FAITHFUL, TorquePath
from beltcomm.fit.undersampled_fit import SeldomFit, fit_seldom
from beltcomm.identify.sweeps import steady_passes
from beltcomm.model import Model
from beltcomm.recording import Recording

#: A stiffness that differs by more than this between places calls for a belt law by position; the law itself is then judged
#: by the misfit it leaves.
STIFFNESS_SPREAD = 0.02
#: A difference between places counts from this many standard deviations on; step in ln(stiffness) for them.
CLEAR = 4.0
CURVATURE_STEP = 0.01
#: m; records nearer to each other than this cannot tell a law of the stiffness along the travel.
PLACES_APART_M = 0.05
#: Error over the noise from which on a fit explains nothing, factor by which its inertia may leave the data sheet's nevertheless, and
#: factor by which the error may grow with the data sheet's.
FAR_OFF, STRAYED, HARDLY = 3.0, 1.5, 1.5
#: Error over the noise up to which nothing is missing.
NEAR = 1.1
RIGID = "nothing is known to swing between motor and load: both move as one"
#: How much more one of two fits may keep to be compared by its objective.
OTHER_SAMPLES = 1.5
ONE_PLACE = "rows come too seldom to compare places: stiffness taken as constant"
#: s, from where a dead time is looked for; evidence that it must have.
LATE_S, CLEAR_EVIDENCE = 5e-4, 150.0


@dataclass(frozen=True)
class FinalModel:
    """The chosen fit, the one it was compared with, and in words why it was chosen."""

    fit: ModelFit
    rejected: ModelFit | None
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

    Parameters
    ----------
    recordings : sequence of Recording
        Of a run; those held out only judge.
    axis : Axis
    counts_per_rev : int
    start : Model or None
        In place of the start values found from the excited records.
    progress : callable
        Told the share that is done, 0 to 1.

    Returns
    -------
    FinalModel
        The better fit, and the other one.

    Raises
    ------
    DataError
        When there is no excited record to start from, or none is usable.
    DamagedRecord
        When the angle of one jumps.
    """
    excited = [r for r in recordings if r.sidecar.experiment == "frf" and not r.sidecar.held_out]
    if start is None:
        if not excited:
            raise DataError(
                "no recording with an excitation (experiment: frf); record one with `beltcomm identify`, or if one of the recordings "
                "is excited, say so in its sidecar"
            )
        axis.require("identify", *NEEDED)
        start = belt_start(axis, excited, counts_per_rev)
    placed = [r for r in excited if not r.sidecar.moving]
    at = [place for r in placed if (place := r.sidecar.start_position_m) is not None]
    apart = max(at) - min(at) >= PLACES_APART_M if at else False
    if apart and len(at) < len(placed):  # a record that does not say where it was made can only disturb a law along the travel
        nowhere = [r.name for r in placed if r.sidecar.start_position_m is None]
        told = [r for r in recordings if r.name not in nowhere]
        found = final_model(told, axis, counts_per_rev, start=start, progress=progress)
        return replace(found, reason=f"{found.reason}; left out, because nobody knows where it was made: {', '.join(nowhere)}")
    start = _as_constant(start, float(np.median(at)) if at else 0.0)
    if start.rigid:
        fit = fit_model(recordings, start, counts_per_rev=counts_per_rev, sheet=data_sheet(axis, recordings), progress=progress)
        _refuse_jumps(recordings, fit, counts_per_rev)
        return FinalModel(fit, None, RIGID)

    def simulated() -> SeldomFit | None:
        sheet = data_sheet(axis, recordings)  # a first estimate of such rows may have half or twice the inertia
        known = start if sheet is None else start.with_values({"motor.inertia": sheet["motor.inertia"]})
        return fit_seldom(recordings, known, counts_per_rev=counts_per_rev, passes=steady_passes(recordings, start))

    unseen = axis.kind in KINDS and any(comes_seldom(r, start) for r in recordings)  # a belt has a law of its stiffness
    slow = unseen or max(r.sample_period_s for r in recordings) > SELDOM_S
    seldom = simulated() if slow else None
    if seldom is not None and not seldom.suspect:
        progress(1.0)
        return FinalModel(seldom, None, ONE_PLACE)
    try:
        found = _final_belt(recordings, axis, start, counts_per_rev, progress, apart=apart, known=bool(at))
    except DataError:
        if seldom is None:
            raise
        return FinalModel(seldom, None, ONE_PLACE)
    one_stiffness = "belt_stiffness.stiffness" in found.fit.model.parameters  # what is simulated has no other
    if not slow and one_stiffness and found.fit.misfit > NEAR**2:  # it may swing too fast for rows that show how the motor moves
        fast = simulated()
        seldom = None if fast is None or fast.suspect else fast
    return found if seldom is None or seldom.misfit >= found.fit.misfit else FinalModel(seldom, found.fit, ONE_PLACE)


def _final_belt(
    recordings: Sequence[Recording],
    axis: Axis,
    start: Model,
    counts_per_rev: int,
    progress: Callable[[float], None],
    *,
    apart: bool,
    known: bool,
) -> FinalModel:
    """The fit with a constant stiffness, and by position where places disagree.

    apart : records were made at several places.   known : at least one says where.
    """
    share = 0.5 if apart else 1.0
    sheet = data_sheet(axis, recordings)
    constant = fit_model(recordings, start, counts_per_rev=counts_per_rev, sheet=sheet, progress=lambda f: progress(share * f))
    _refuse_jumps(recordings, constant, counts_per_rev)
    constant = _or_with_sheet_inertia(constant, axis, recordings, counts_per_rev)
    places = _stiffness_by_record(recordings, constant.model, counts_per_rev, constant.noise_nm, constant.path)
    spread = _clear_spread(places)
    if spread < STIFFNESS_SPREAD or not apart:
        progress(1.0)
        reason = f"stiffness differs by {100 * spread:.1f} % between places at most: taken as constant"
        if len(places) < 2 or not apart:
            reason = "measured at one place: stiffness taken as constant"
        if not known:
            reason = "nobody knows where along the travel this was measured: the stiffness holds for that place alone"
        return FinalModel(constant, None, reason)
    if axis.kind in KINDS:  # (2.26) is a belt's; of a gap or a soft bearing a stiffness by record differs as well
        progress(1.0)
        reason = f"stiffness differs by {100 * spread:.0f} % between places; taken as constant: this kind of axis has no law for it"
        return FinalModel(constant, None, reason)
    varying_start = by_position(constant.model, axis, recordings, places)
    varying = fit_model(
        recordings,
        varying_start,
        counts_per_rev=counts_per_rev,
        path=constant.path,
        progress=lambda f: progress(0.5 + 0.5 * f),
    )
    gain = evidence(varying, constant)
    better, other = (varying, constant) if gain > 0.0 else (constant, varying)
    law = "by position (2.26)" if better is varying else "constant"
    return FinalModel(
        better,
        other,
        f"stiffness differs by {100 * spread:.0f} % between places; taken as {law}: evidence {gain:+.3g} for a law by position, "
        f"misfit {varying.misfit:.3g} with it and {constant.misfit:.3g} without",
    )


def _or_with_sheet_inertia(fit: ModelFit, axis: Axis, recordings: Sequence[Recording], counts_per_rev: int) -> ModelFit:
    """A fit far above the noise whose inertia left the data sheet's, with that inertia instead, where this explains hardly less.

    In a gap the motor swings alone: excited records show masses that are not there, as many as one likes, and a stiffness to each.  Strokes
    and moves carry the whole load, so that with the motor's inertia as it is stated the load is what slow motion says.
    """
    sheet, name = data_sheet(axis, recordings), "motor.inertia"
    if sheet is None or fit.misfit < FAR_OFF**2 or abs(math.log(fit.model[name] / sheet[name])) < math.log(STRAYED):
        return fit
    usable = [r for r in recordings if not (r.is_static_map or r.sidecar.held_out)]
    empty = fit.model.with_values({"cart.mass": fit.model.parameters["cart.mass"].low})
    begun = correct_by_slow_motion(empty, sheet, usable)
    if begun is empty:  # no slow motion tells what moves
        return fit
    try:
        held = fit_model(recordings, begun.with_values({name: sheet[name]}), counts_per_rev=counts_per_rev, fixed=(name,), sheet=sheet)
    except DataError:
        return fit
    return held if held.misfit < HARDLY**2 * fit.misfit else fit


def _refuse_jumps(recordings: Sequence[Recording], fit: ModelFit, counts_per_rev: int) -> None:
    """Raise DamagedRecord when a record that the fit does not explain is explained without a jump of its angle."""
    step = 2.0 * np.pi / counts_per_rev
    for recording in recordings:
        if fit.record_misfit.get(recording.name, 0.0) > SUSPECT_MISFIT:
            refuse(proven_jumps(acting_recording(recording, fit.path), fit.model, step, fit.noise_nm), step)


def evidence(richer: ModelFit, plainer: ModelFit) -> float:
    """By how much a model with more parameters is the better one: fall of the objective beyond ln n for each parameter more (BIC).

    The two keep slightly different samples, so the objective is compared per sample; where one keeps ``OTHER_SAMPLES`` times as many, which
    are samples of another kind (a carriage that hardly slides), the mean squares are.

    Parameters
    ----------
    richer, plainer : ModelFit
        Of the same records, with more and with fewer parameters.

    Returns
    -------
    float
        Above 0 for the richer one.
    """
    samples = 0.5 * (richer.samples + plainer.samples)
    fall = samples * (plainer.objective / plainer.samples - richer.objective / richer.samples)
    fewer, more = sorted((richer.samples, plainer.samples))
    if more > OTHER_SAMPLES * fewer:
        samples, fall = fewer, fewer * (plainer.misfit - richer.misfit)
    return float(fall - (len(richer.free) - len(plainer.free)) * np.log(samples))


@dataclass(frozen=True)
class PlaceStiffness:
    """Belt stiffness that one record wants for itself, N/m, and the relative standard deviation of it."""

    stiffness_n_m: float
    deviation: float


def _clear_spread(places: Mapping[str, PlaceStiffness]) -> float:
    """Largest relative difference between two places that is beyond chance (``CLEAR`` deviations); 0 without any."""
    pairs = itertools.combinations(places.values(), 2)
    differences = [(abs(np.log(a.stiffness_n_m / b.stiffness_n_m)), float(np.hypot(a.deviation, b.deviation))) for a, b in pairs]
    return max((float(np.expm1(d)) for d, deviation in differences if d > CLEAR * deviation), default=0.0)


def with_late_torque(found: FinalModel, recordings: Sequence[Recording], axis: Axis, counts_per_rev: int) -> FinalModel:
    """The fit with torque that acts later than it is reported, where that explains clearly more; else the fit as it is.

    A loop designed without knowing a dead time of a millisecond, from inertia and mass that it has biased, cannot be closed.

    Parameters
    ----------
    found : FinalModel
        Without it.
    recordings : sequence of Recording
        That it was fitted to.
    axis : Axis
    counts_per_rev : int
    """
    late = found.fit.model.with_effect("dead_time", {"time": LATE_S})
    other = _fitted(recordings, axis, counts_per_rev, late)
    return other if other is not None and evidence(other.fit, found.fit) > CLEAR_EVIDENCE else found


def from_records_alone(found: FinalModel, recordings: Sequence[Recording], axis: Axis, counts_per_rev: int) -> FinalModel:
    """The fit begun anew from its own records, where it is doubtful as it is and that explains them; else the fit as it is.

    The estimate it began from is kept near the data sheets, which may be far from the machine: the fit can end beside it, or where hardly
    a sample counts.

    Parameters
    ----------
    found : FinalModel
        Begun from an estimate.
    recordings : sequence of Recording
        That it was fitted to.
    axis : Axis
    counts_per_rev : int
    """
    other = _fitted(recordings, axis, counts_per_rev) if _is_doubtful(found.fit) else None
    return found if other is None or _is_doubtful(other.fit) else other


def begun_best(
    recordings: Sequence[Recording], axis: Axis, counts_per_rev: int, first: Model | None, progress: Callable[[float], None]
) -> FinalModel:
    """The fit that `beltcomm fit` makes of these records; begun from a first model where that is none or explains them better.

    Parameters
    ----------
    recordings : sequence of Recording
        Of the run.
    axis : Axis
    counts_per_rev : int
    first : Model or None
        Of a part of the records.
    progress : callable
        Told the share that is done, 0 to 1.

    Raises
    ------
    DataError
        When no record can be fitted.
    """
    try:
        found = final_model(recordings, axis, counts_per_rev, progress=progress)
    except DataError:
        if first is None:
            raise
        return final_model(recordings, axis, counts_per_rev, start=first)
    if first is None or not _is_doubtful(found.fit):
        return found
    other = _fitted(recordings, axis, counts_per_rev, first)
    if other is None or (_few_values(other.fit) and not _few_values(found.fit)):
        return found
    return other if _few_values(found.fit) or other.fit.misfit < found.fit.misfit else found


def _is_doubtful(fit: ModelFit) -> bool:
    """Whether a fit explains its records badly, or hardly a value of them counts."""
    return fit.suspect or _few_values(fit)


def _few_values(fit: ModelFit) -> bool:
    return fit.samples < FEWEST_SAMPLES * len(fit.free)


def _fitted(recordings: Sequence[Recording], axis: Axis, counts_per_rev: int, start: Model | None = None) -> FinalModel | None:
    """:func:`final_model` begun elsewhere; None where no record can be fitted from there."""
    try:
        return final_model(recordings, axis, counts_per_rev, start=start)
    except DataError:
        return None


def _stiffness_by_record(
    recordings: Sequence[Recording], model: Model, counts_per_rev: int, noise_nm: float, path: TorquePath = FAITHFUL
) -> dict[str, PlaceStiffness]:
    """Belt stiffness, N/m, that each excited record wants for itself, all else as in ``model``; not of held-out records, nor of moving
    ones.

    Where the carriage stuck before is neglected: below 0.1 % of the stiffness (tests/identify/test_final.py).
    """
    found = {}
    place = model.index("belt_stiffness.stiffness")
    for recording in recordings:
        if recording.sidecar.experiment != "frf" or recording.sidecar.held_out or recording.sidecar.moving:
            continue
        pieces = segments(recording, model, 2.0 * np.pi / counts_per_rev, noise_nm, fitted=True, path=path)
        if not sum(int(p.keep.sum()) for p in pieces):
            continue

        def cost(logarithm: float, pieces: Sequence[Segment] = pieces) -> float:
            vector = model.vector()
            vector[place] *= np.exp(logarithm)
            return float(sum(np.sum(np.minimum(whitened_residual(p, model, vector) ** 2, OUTLIER)) for p in pieces))

        coarse = np.log(np.geomspace(0.25, 6.0, 30))
        best = coarse[int(np.argmin([cost(float(c)) for c in coarse]))]
        step = coarse[1] - coarse[0]
        refined = minimize_scalar(cost, bounds=(best - step, best + step), method="bounded", options={"xatol": 1e-3})
        near = float(refined.fun)
        samples = sum(int(p.keep.sum()) for p in pieces)
        curvature = (cost(refined.x + CURVATURE_STEP) + cost(refined.x - CURVATURE_STEP) - 2.0 * near) / CURVATURE_STEP**2
        deviation = float(np.sqrt(2.0 * max(near / samples, 1.0) / curvature)) if curvature > 0.0 else np.inf
        found[recording.name] = PlaceStiffness(float(np.exp(refined.x)) * model["belt_stiffness.stiffness"], deviation)
    return found


def _as_constant(model: Model, position_m: float) -> Model:
    """A model with the belt law by position, as one with the constant stiffness that the law has at a place of the carriage."""
    if "belt_spans" not in model.effects:
        return model
    names = ("specific_stiffness", "pulley_distance", "offset")
    stiffness = stiffness_at(position_m, *(model[f"belt_spans.{name}"] for name in names))
    constant = model.without_effect("belt_spans").with_effect("belt_stiffness", {"stiffness": stiffness}, "final fit")
    order = ("belt_stiffness", *(e for e in constant.effects if e != "belt_stiffness"))
    return Model(model.name, order, constant.parameters, model.base_bodies, model.source)


def by_position(model: Model, axis: Axis, recordings: Sequence[Recording], places: Mapping[str, PlaceStiffness]) -> Model:
    """The model with the belt law (2.26) instead of a constant stiffness, started from the stiffness of each place.

    The distance of the pulleys stays as in the axis file: beside stiffness and offset nothing is left to tell it by.

    Parameters
    ----------
    model : Model
        With one belt stiffness.
    axis : Axis
        With the distance of the pulleys.
    recordings : sequence of Recording
        For the places of their records.
    places : mapping of str to PlaceStiffness
        By record.

    Raises
    ------
    UsageError
        When the axis file does not say how far the pulleys are apart.
    """
    axis.require("the law of the belt's stiffness along the travel", "belt.pulley_distance_m")
    distance = float(axis.get("belt.pulley_distance_m") or 0.0)
    offset = axis.travel.driven_side_offset_m
    at = {r.name: r.sidecar.start_position_m or 0.0 for r in recordings}
    shares = [place.stiffness_n_m / stiffness_at(at[name], 1.0, distance, offset) for name, place in places.items()]
    values = {"specific_stiffness": float(np.median(shares)), "pulley_distance": distance, "offset": offset}
    position = effect_named("belt_spans")
    without = model.without_effect("belt_stiffness").with_effect(position.name, values, "final fit")
    order = (position.name, *(e for e in without.effects if e != position.name))
    return Model(model.name, order, without.parameters, model.base_bodies, model.source).with_fixed("belt_spans.pulley_distance")
