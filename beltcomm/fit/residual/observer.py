"""A segment whose carriage is free at times: innovations of an observer that follows it by the torque (``simulate.observer``)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from beltcomm.arrays import Array, BoolArray
from beltcomm.fit.noise.propagation import path_of, stiffness_levels
from beltcomm.fit.noise.whitening import noises
from beltcomm.model import Model
from beltcomm.model.linear import matrices, operating_point
from beltcomm.model.mounted import loaded_model
from beltcomm.simulate.inverse import FineMotion, acting_torque, follow_bodies, linear_innovations, motor_load, true_motion
from beltcomm.simulate.kernels.observer import ObserverState, filter_columns, reset
from beltcomm.simulate.kernels.writer import catalogue_bodies

#: s without a sample that counts, after which a carriage may be anywhere in its gap.
FORGOTTEN_S = 0.04


class Perturbation(NamedTuple):
    """A small step of one unknown.

    Attributes
    ----------
    vector : ndarray
        Of the model at its end.
    moves : bool
        Whether the motor's angle, or what the torque leaves for the bodies, is another there.
    """

    length: float
    vector: Array
    moves: bool


@dataclass(frozen=True)
class Observer:
    """The observer of one segment.

    Attributes
    ----------
    watch : ObserverState
        Its filter, with gains, deviations and shares as worked out near the right model.
    model, motion, torque
        Those it was worked out with; what it found on the way stands in ``watch`` as well.
    """

    watch: ObserverState
    model: Model
    motion: FineMotion
    torque: Array

    def white(self, torque: Array, keep: BoolArray) -> Array:
        """First-order change of the innovations, over their deviation, by changes of the residual, N m, (n,) or (n, k), at the samples to
        keep.
        """
        w = self.watch
        columns = np.ascontiguousarray(torque if torque.ndim == 2 else torque[:, None])
        out = filter_columns(columns, keep, w.F, w.H, w.gains, w.deviations, w.shares)
        return out if torque.ndim == 2 else out[:, 0]

    def knows(self, seen: Observation, model: Model, vector: Array) -> bool:
        """True if this is what it was worked out with; ``seen`` is compared by identity."""
        same = seen.motion is self.motion and seen.torque is self.torque and model.effects == self.model.effects
        return same and np.allclose(vector, self.model.vector(), rtol=1e-12, atol=0.0)


class Observation(NamedTuple):
    """A motion and a torque judged behind an observer.

    Attributes
    ----------
    torque : ndarray (n,), N m
        As reported.
    """

    observer: Observer
    motion: FineMotion
    torque: Array


def innovations(seen: Sequence[Observation], model: Model, vectors: Sequence[Array]) -> list[tuple[Array, Array]]:
    """ν over its deviation, 0 where nothing is kept, and e, N m at the motor shaft, of a model behind each observer; (n,) each.

    Parameters
    ----------
    seen : sequence of Observation
        One for each vector.
    model : Model
        With an observer.
    vectors : sequence of ndarray (p,) each
        Values of the parameters.
    """
    watches = [one.observer.watch for one in seen]
    others = [i for i, (one, vector) in enumerate(zip(seen, vectors, strict=True)) if not one.observer.knows(one, model, vector)]
    motions = [true_motion(model, seen[i].motion, vectors[i]) for i in others]
    for i, motion in zip(others, motions, strict=True):
        watches[i] = reset(watches[i], _load_beyond_motor(model, motion, seen[i].torque, vectors[i]))
    if others:
        follow_bodies(model, motions, [vectors[i] for i in others], [watches[i] for i in others])
    return [(watch.white, watch.left) for watch in watches]


def slopes(seen: Sequence[Observation], model: Model, vector: Array, steps: Sequence[Perturbation]) -> list[Array]:
    """By how much ν over its deviation changes with each step, over its length, behind each observer; (n, steps) each.

    Parameters
    ----------
    seen : sequence of Observation
        Of several segments.
    model : Model
        With an observer.
    vector : ndarray (p,)
        Values of the parameters.
    steps : sequence of Perturbation
        Changes of the vector.
    """
    still, moving = ([number for number, step in enumerate(steps) if step.moves == moves] for moves in (False, True))
    found = []
    for one in seen:
        true = true_motion(model, one.motion, vector)
        watch = one.observer.watch._replace(wanted=_load_beyond_motor(model, true, one.torque, vector))
        white = linear_innovations(model, true, [vector, *(steps[number].vector for number in still)], watch)
        found.append(np.column_stack((white, np.empty((len(white), len(moving))))))
    for place, number in enumerate(moving, start=1 + len(still)):
        for white, (other, _) in zip(found, innovations(seen, model, [steps[number].vector] * len(seen)), strict=True):
            white[:, place] = other
    lengths, order = np.array([steps[number].length for number in (*still, *moving)]), np.argsort((*still, *moving))
    return [((white[:, 1:] - white[:, :1]) / lengths)[:, order] for white in found]


def needs_observer(model: Model) -> bool:
    """True if the model's bodies are to be followed: a carriage, a gap, and no lag between what the motor needs and what is read.

    Parameters
    ----------
    model : Model
        With any effects.

    Returns
    -------
    bool
        False for a rigid axis.
    """
    effects = model.effect_list()
    loose = "cart" in model.base_bodies and any(e.rattles for e in effects)
    return loose and not any(e.slot == "torque_reading" for e in effects)


def _load_beyond_motor(model: Model, motion: FineMotion, torque: Array, vector: Array) -> Array:
    """Load that the torque leaves for everything beyond the motor in its true motion, N m, (n,)."""
    left = acting_torque(model, motion, torque, vector) - motor_load(model, motion, vector)
    left[1:-1] -= vector[model.index("motor.inertia")] * np.diff(motion.theta[:: motion.substeps], 2) / motion.sample_s**2
    return left


def _settling_samples(keep: BoolArray, sample_s: float) -> BoolArray:
    """Last samples of spans so long without one that counts that the carriage may be anywhere in its gap when the next one does; (n,)."""
    number = np.arange(len(keep))
    since = number - np.maximum.accumulate(np.where(keep, number, -1))
    ends: BoolArray = ~keep & np.append(keep[1:], False)
    return ends & (since * sample_s >= FORGOTTEN_S)


def _stiffest(model: Model, low_m: float, high_m: float, places_m: Array) -> tuple[float, Array]:
    """Place of a way where the carriage is held stiffest, m, and the stiffness at ``places_m`` over the one there, (n,).

    A filter whose gains are worked out for a belt less than half as stiff as it is overshoots and flies off.
    """
    at, logarithms = stiffness_levels(model, low_m, high_m)
    return float(at[np.argmax(logarithms)]), np.exp(np.interp(places_m, at, logarithms) - logarithms.max())


def untuned_observer(
    model: Model,
    motion: FineMotion,
    torque: Array,
    keep: BoolArray,
    step_rad: float,
    noise_nm: float,
    rounding: tuple[float, float],
    start_m: float,
    process_noise: float,
    freedom_m: float = 0.0,
) -> Observer:
    """The observer of a segment for a model, before it is :func:`tuned_observers`.

    Parameters
    ----------
    model : Model
    motion : FineMotion
    torque : ndarray (n,), N m, motor shaft
        That acts.
    keep : ndarray of bool (n,)
        Samples that count.
    step_rad : float, rad
    noise_nm : float, N m rms
        Of the torque.
    rounding : tuple of float
        Shares of the rounding's variance, as of :func:`beltcomm.fit.noise.whitening.whitener`.
    start_m : float
        rms stretch of the belt at first, m.
    process_noise : float
        By how much the speed of the carriage changes in each sample as no model tells, rms, as a share of that at which it would swing
        through half the gap on its belt: in its gap it strikes rough ends at an angle, and rubs.
    freedom_m : float
        Width of the gap, m, whose freedom the carriage is given, whatever the model's; 0 for the model's own.
    """
    ratio, own = model["transmission.ratio"], loaded_model(model, motion.mounted)
    low, high = (float(end) * ratio for end in (motion.theta.min(), motion.theta.max()))
    place, held = _stiffest(model, low, high, motion.theta[:: motion.substeps][: motion.samples] * ratio)
    apart, there = (matrices(own, operating_point(own, place, 1.0), closed=closed) for closed in (0.0, 1.0))
    sides = [noises(path_of(own, linear, motion.sample_s), step_rad, noise_nm, rounding, alike=True) for linear in (apart, there)]
    (opened, variances, start), (shut, _, _) = sides
    names = [body.name for _, body in model.bodies()]
    first = len(shut.H) - 2 * (len(names) - 1) - 5
    places = np.array([first + names.index(b.name) - 1 if b.name in names[1:] else -1 for _, b in catalogue_bodies()], dtype=np.int64)
    covariance = start.copy()
    cart = first + names.index("cart") - 1
    half = 0.5 * sum(model[e.full_names()[0]] for e in model.effect_list() if e.rattles)  # the gap comes first
    stiffness, mass = (float(m[names.index("cart"), names.index("cart")]) for m in (there.K, there.M))
    free = 0.5 * freedom_m or half
    covariance[cart, cart] += start_m**2 + free**2
    swing = free * math.sqrt(stiffness / mass)
    n, size = motion.samples, len(shut.H)
    by_chance = np.zeros((2, size, 1))
    by_chance[:, cart + len(names) - 1] = 1.0
    vector = model.vector()
    true = true_motion(model, motion, vector)
    watch = ObserverState(
        wanted=_load_beyond_motor(model, true, torque, vector),
        keep=keep,
        places=places,
        behind=len(names) - 1,
        substeps=motion.substeps,
        cart=cart,
        half_gap_m=half,
        stiffness=stiffness,
        held=held,
        spread=np.array([(0.5 * free) ** 2, swing**2]),
        lost=np.zeros(motion.samples, dtype=np.bool_),
        forgets=_settling_samples(keep, motion.sample_s),
        learning=True,
        F=np.stack([opened.F, shut.F]),
        G=np.concatenate([np.stack([opened.G, shut.G]), by_chance], axis=2),
        H=np.stack([opened.H, shut.H]),
        D=np.concatenate([np.stack([opened.D, shut.D]), np.zeros((2, 1))], axis=1),
        variances=np.append(variances, (process_noise * swing) ** 2),
        P=covariance,
        s=np.zeros(size),
        ahead=np.zeros(size),
        gains=np.zeros((n, size)),
        deviations=np.ones(n),
        shares=np.zeros(n),
        left=np.zeros(n),
        white=np.zeros(n),
        room=np.zeros(0),
    )
    return Observer(watch, model, motion, torque)


def tuned_observers(followers: Sequence[Observer]) -> list[Observer]:
    """Observers of models with the same effects, each with the gains, deviations and shares that its model finds on its segment.

    Parameters
    ----------
    followers : sequence of Observer
        One for each segment.
    """
    vectors = [observer.model.vector() for observer in followers]
    motions = [true_motion(observer.model, observer.motion, vector) for observer, vector in zip(followers, vectors, strict=True)]
    if followers:
        follow_bodies(followers[0].model, motions, vectors, [observer.watch for observer in followers])
    return [replace(observer, watch=observer.watch._replace(learning=False)) for observer in followers]
