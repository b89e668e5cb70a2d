"""Residual of a segment under a model, and the same in units of its own noise: whitened, behind an observer where a carriage is free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np
from scipy.optimize import minimize_scalar

from beltcomm.arrays import Array
from beltcomm.fit.noise.propagation import NoiseSchedule, noise_schedule
from beltcomm.fit.noise.whitening import Whitener, whitener
from beltcomm.fit.residual.observer import innovations, needs_observer, tuned_observers, untuned_observer
from beltcomm.fit.residual.reversals import LEVEL
from beltcomm.fit.residual.segment import Segment
from beltcomm.model import Model
from beltcomm.model.linear import belt_at, values_of
from beltcomm.model.mounted import loaded_model
from beltcomm.simulate.inverse import (
    FineMotion,
    belt_load,
    torque_residuals,
    true_motion,
)

#: Stretches at which the laws are looked up, and how often their range is doubled until it holds the largest force.
STRETCHES, DOUBLED = 2001, 8
#: Squared whitened residual beyond which a sample has no more weight when a start offset is looked for: five deviations.
OUTLIER = 25.0
#: Whiteners that are kept with a segment.
KNOWN = 2


def _stiffness_left(model: Model, motion: FineMotion) -> Array | None:
    """Share of the belt's stiffness that holds the carriage at each sample, (n,): 1 with both strands tight; None where no strand goes
    slack.

    It is the slope of the belt's law at the stretch that carries the load.  A gap is no such law: its carriage is followed (``observer``).
    The belt is taken to be as stiff everywhere as in the middle of the way, and its damping to carry nothing: only the noise asks for it.
    """
    laws = [e for e in model.effect_list() if e.slot == "belt_law" and not e.rattles]
    if not laws or "cart" not in model.base_bodies:
        return None
    vector, ratio = model.vector(), model["transmission.ratio"]
    true = true_motion(model, motion, vector)
    middle = 0.5 * ratio * float(true.theta.min() + true.theta.max())
    wanted = belt_load(model, true, vector, 0.0) / (ratio * belt_at(model, middle)[0])  # m, stretch of a belt with both strands tight
    wanted[[0, -1]] = wanted[[1, -2]]  # the mean has no ends
    reach = max(float(np.abs(wanted).max()), 1e-9)
    for _ in range(DOUBLED):
        segment = np.linspace(-reach, reach, STRETCHES)
        loading, slope = segment, np.ones(STRETCHES)
        for effect in laws:
            law, slope_of, values = effect.law, effect.slope, values_of(model, effect, middle)
            assert law is not None
            assert slope_of is not None
            slope = slope * [cast(float, slope_of(x, *values)) for x in loading]
            loading = np.array([law(x, *values) for x in loading])
        if loading[0] <= wanted.min() and wanted.max() <= loading[-1]:
            break
        reach *= 2.0
    return np.interp(wanted, loading, slope)


def with_observer(segment: Segment, model: Model) -> Segment:
    """The segment with the observer that a model with a gap needs, or without one.

    Parameters
    ----------
    segment : Segment
        With its noise.
    model : Model
        That it is made for.
    """
    return with_observers([segment], [model])[0]


def with_observers(segments: Sequence[Segment], models: Sequence[Model]) -> list[Segment]:
    """Several segments with the observers that their models need, each for a model of its own; the effects of all are the same.

    Parameters
    ----------
    segments : sequence of Segment
        With their noise.
    models : sequence of Model
        One for each.
    """
    if not models or not needs_observer(models[0]):
        return [segment if segment.observer is None else replace(segment, observer=None) for segment in segments]
    observers = []
    for segment, model in zip(segments, models, strict=True):
        noise = (segment.step_rad, segment.noise_nm, segment.rounding, segment.offset_m, segment.process_noise, segment.freedom_m)
        observers.append(untuned_observer(model, segment.motion, segment.torque, segment.keep, *noise))
    return [replace(segment, observer=observer) for segment, observer in zip(segments, tuned_observers(observers), strict=True)]


def evaluate(segment: Segment, model: Model, vector: Array, offset_m: float = 0.0) -> Array:
    """Residual e[n], N m at the motor shaft, (n,): all samples, also those not kept.

    Parameters
    ----------
    segment : Segment
        Of a record.
    model : Model
    vector : ndarray (k,)
        Values of the parameters.
    offset_m : float
        See ``fine_load``.
    """
    if segment.observer is not None:
        return innovations(segment.observations, model, [vector])[0][1]
    return evaluate_each(segment, model, [vector], [offset_m])[0]


def evaluate_each(segment: Segment, model: Model, vectors: Sequence[Array], offsets_m: Sequence[float]) -> list[Array]:
    """Residual e[n] of a segment without an observer for several vectors of parameters side by side.

    Parameters
    ----------
    segment : Segment
        Without an observer.
    model : Model
        For effects and bodies.
    vectors : sequence of ndarray, (k,)
        Values of the parameters.
    offsets_m : sequence of float, m
        Stretch of the belt at the start, for each.

    Returns
    -------
    list of ndarray, (n,)
        N m at the motor shaft.
    """
    left = torque_residuals(model, segment.motion, segment.torque, vectors, offsets_m)
    if segment.turns is None:
        return left
    level = model.index(LEVEL)
    return [e + p[level] * segment.turns for e, p in zip(left, vectors, strict=True)]


def whitened_residual(segment: Segment, model: Model, vector: Array, offset_m: float = 0.0) -> Array:
    """Residual of the kept samples in units of its own noise: independent, variance 1 where the model is right.

    Parameters
    ----------
    segment : Segment
        With or without an observer.
    model : Model
        For effects and bodies.
    vector : ndarray, (k,)
        Values of the parameters.
    offset_m : float, m
        Stretch of the belt at the start; unused with an observer.

    Returns
    -------
    ndarray, (values,)
        In units of its noise.
    """
    if segment.observer is not None:
        return observed_residuals([segment], model, [vector])[0]
    return in_noise(segment, model, vector, evaluate(segment, model, vector, offset_m))


def squares_left(piece: Segment, model: Model, vector: Array) -> Array:
    """Squared whitened residual of a segment that the model was not fitted to; only where its carriage stuck at the start is.

    Parameters
    ----------
    piece : Segment
        Of a record that is not fitted.
    model : Model
        For effects and bodies.
    vector : ndarray, (k,)
        Values of the parameters.

    Returns
    -------
    ndarray, (values,)
        1 in the mean where the model is right.
    """

    def cost(offset_m: float) -> float:
        return float(np.sum(np.minimum(whitened_residual(piece, model, vector, offset_m) ** 2, OUTLIER)))

    best = minimize_scalar(cost, bounds=(-piece.offset_m, piece.offset_m), method="bounded", options={"xatol": 1e-7})
    return whitened_residual(piece, model, vector, float(best.x)) ** 2


def observed_residuals(segments: Sequence[Segment], model: Model, vectors: Sequence[Array]) -> list[Array]:
    """Whitened residuals of segments with observers, each with a vector of its own.

    Parameters
    ----------
    segments : sequence of Segment
        All with observers.
    model : Model
        For effects and bodies.
    vectors : sequence of ndarray, (k,)
        Values of the parameters, one for each observation.

    Returns
    -------
    list of ndarray, (values,)
        In units of their noise.
    """
    whites = innovations([one for segment in segments for one in segment.observations], model, vectors)
    return [segment.group_sums(white[segment.keep]) for segment, (white, _) in zip(segments, whites, strict=True)]


def in_noise(segment: Segment, model: Model, vector: Array, torque: Array) -> Array:
    """A torque in units of the residual's noise; linear in the torque.

    Parameters
    ----------
    segment : Segment
        For its samples and noise.
    model : Model
        By which the noise is passed on.
    vector : ndarray, (k,)
        Values of its parameters.
    torque : ndarray, (n,) or (n, m), N m
        Several at once with a whitener worked out beforehand alone.

    Returns
    -------
    ndarray, (values,) or (values, m)
        Of the kept samples.
    """
    if segment.observer is not None or not (segment.own_noise or segment.whitener is None):
        return segment.white(torque)
    key = (model.effects, vector.tobytes())
    if key not in segment.known:
        while len(segment.known) >= KNOWN:
            del segment.known[next(iter(segment.known))]
        segment.known[key] = whitener_of(segment, model.with_vector(vector))
    return segment.group_sums(segment.known[key](torque, segment.keep))


def whitener_of(segment: Segment, model: Model) -> Whitener:
    """The filter of a segment for the noise that a model passes on.

    Parameters
    ----------
    segment : Segment
        For its samples and noise.
    model : Model
        By which the noise is passed on.

    Returns
    -------
    Whitener
        Kalman filter with the gains of the segment.
    """
    return whitener(segment.keep, noise_paths_of(segment, model), segment.step_rad, segment.noise_nm, segment.rounding, segment.colour)


def noise_paths_of(segment: Segment, model: Model) -> NoiseSchedule:
    """Paths of torque noise and rounding to the residual of a segment.

    Parameters
    ----------
    segment : Segment
        For its places and load.
    model : Model
        By which the noise is passed on.

    Returns
    -------
    NoiseSchedule
        Which path holds at each sample.
    """
    motion, model = segment.motion, loaded_model(model, segment.motion.mounted)
    places = motion.theta[:: motion.substeps] * model["transmission.ratio"]
    return noise_schedule(model, places, motion.sample_s, _stiffness_left(model, motion))
