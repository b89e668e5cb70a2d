"""A stretch whose carriage is free at times: innovations of an observer that follows it by the torque (``simulate.observer``)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltcomm.identify.noise_path import course, noise_path
from beltcomm.identify.whitening import noises
from beltcomm.linear import matrices, operating_point
from beltcomm.model import Model
from beltcomm.simulate.inverse import FineMotion, acting_torque, followed, followed_beside, motor_load, true_motion
from beltcomm.simulate.observer import Watch, filtered
from beltcomm.simulate.writer import catalogue_bodies

Array = NDArray[np.float64]

#: s without a sample that counts, after which a carriage may be anywhere in its gap.
FORGOTTEN_S = 0.04


@dataclass(frozen=True)
class Follower:
    """The observer of one stretch.   watch : its filter, with gains, deviations and shares as worked out near the right model.

    model, motion, torque : those it was worked out with; what it found on the way stands in ``watch`` as well.
    """

    watch: Watch
    model: Model
    motion: FineMotion
    torque: Array

    def white(self, torque: Array, keep: NDArray[np.bool_]) -> Array:
        """What changes of the residual, N m, (n,) or (n, k), change of the innovations to first order, over their deviation."""
        w = self.watch
        columns = np.ascontiguousarray(torque if torque.ndim == 2 else torque[:, None])
        out = filtered(columns, keep, w.F, w.H, w.gains, w.deviations, w.shares)
        return out if torque.ndim == 2 else out[:, 0]

    def innovations(
        self, model: Model, motion: FineMotion, torque: Array, vector: Array, wanted: Array | None = None
    ) -> tuple[Array, Array]:
        """ν over its deviation, 0 where nothing is kept, and e, N m at the motor shaft, of a model; (n,) each.

        wanted : :func:`left_for_bodies`, N m, (n,), where it is known.
        """
        same = wanted is None and motion is self.motion and torque is self.torque and model.effects == self.model.effects
        if same and np.allclose(vector, self.model.vector(), rtol=1e-12, atol=0.0):
            return self.watch.white, self.watch.left
        true = true_motion(model, motion, vector)
        n = motion.samples
        if wanted is None:
            wanted = left_for_bodies(model, true, torque, vector)
        watch = self.watch._replace(wanted=wanted, s=np.zeros_like(self.watch.s), left=np.zeros(n), white=np.zeros(n))
        followed(model, true, vector, watch)
        return watch.white, watch.left

    def beside(self, model: Model, motion: FineMotion, vectors: Sequence[Array], wanted: Array) -> Array:
        """ν over its deviation, (n, k), of several vectors that leave one load to the bodies.   motion : true."""
        return followed_beside(model, motion, vectors, self.watch._replace(wanted=wanted))


def follows(model: Model) -> bool:
    """Whether the model's bodies are to be followed: a carriage, a gap, and no lag between what the motor needs and what is read."""
    effects = model.effect_list()
    loose = "cart" in model.base_bodies and any(e.rattles for e in effects)
    return loose and not any(e.slot == "torque_reading" for e in effects)


def left_for_bodies(model: Model, motion: FineMotion, torque: Array, vector: Array) -> Array:
    """Load that the torque leaves for everything beyond the motor, N m, (n,).   motion : true."""
    left = acting_torque(model, motion, torque, vector) - motor_load(model, motion, vector)
    left[1:-1] -= vector[model.index("motor.inertia")] * np.diff(motion.theta[:: motion.substeps], 2) / motion.sample_s**2
    return left


def forgotten(keep: NDArray[np.bool_], sample_s: float) -> NDArray[np.bool_]:
    """Samples that do not count, behind so many of them that the carriage may be anywhere in its gap when the next one does; (n,)."""
    number = np.arange(len(keep))
    since = number - np.maximum.accumulate(np.where(keep, number, -1))
    ends: NDArray[np.bool_] = ~keep & np.append(keep[1:], False)
    return ends & (since * sample_s >= FORGOTTEN_S)


def stiffest(model: Model, low_m: float, high_m: float, places_m: Array) -> tuple[float, Array]:
    """Where between two places the carriage is held stiffest, m, and the stiffness at places over the one there, (n,).

    A filter whose gains are worked out for a belt less than half as stiff as it is overshoots and flies off.
    """
    at, logarithms = course(model, low_m, high_m)
    return float(at[np.argmax(logarithms)]), np.exp(np.interp(places_m, at, logarithms) - logarithms.max())


def follower_for(
    model: Model,
    motion: FineMotion,
    torque: Array,
    keep: NDArray[np.bool_],
    step_rad: float,
    noise_nm: float,
    rounding: tuple[float, float],
    start_m: float,
    agitation: float,
    freedom_m: float = 0.0,
) -> Follower:
    """The observer of a stretch for a model.   start_m : rms stretch of the belt at first, m.

    agitation : by how much the speed of the carriage changes in each sample as no model tells, rms, as a share of that at which it would
    swing through half the gap on its belt: in its gap it strikes rough ends at an angle, and rubs.   freedom_m : width of the gap, m, whose
    freedom the carriage is given, whatever the model's; 0 for the model's own.
    """
    ratio = model["transmission.ratio"]
    low, high = (float(end) * ratio for end in (motion.theta.min(), motion.theta.max()))
    place, held = stiffest(model, low, high, motion.theta[:: motion.substeps][: motion.samples] * ratio)
    sides = [noises(noise_path(model, place, motion.sample_s, closed), step_rad, noise_nm, rounding) for closed in (0.0, 1.0)]
    (opened, variances, start), (shut, _, _) = sides
    names = [body.name for _, body in model.bodies()]
    first = len(shut.H) - 2 * (len(names) - 1) - 3
    places = np.array([first + names.index(b.name) - 1 if b.name in names[1:] else -1 for _, b in catalogue_bodies()], dtype=np.int64)
    covariance = start.copy()
    cart = first + names.index("cart") - 1
    half = 0.5 * sum(model[e.full_names()[0]] for e in model.effect_list() if e.rattles)  # the gap comes first
    there = matrices(model, operating_point(model, place, 1.0))
    stiffness, mass = (float(m[names.index("cart"), names.index("cart")]) for m in (there.K, there.M))
    free = 0.5 * freedom_m or half
    covariance[cart, cart] += start_m**2 + free**2
    swing = free * math.sqrt(stiffness / mass)
    n, size = motion.samples, len(shut.H)
    by_chance = np.zeros((2, size, 1))
    by_chance[:, cart + len(names) - 1] = 1.0
    vector = model.vector()
    true = true_motion(model, motion, vector)
    watch = Watch(
        wanted=left_for_bodies(model, true, torque, vector),
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
        forgets=forgotten(keep, motion.sample_s),
        learning=True,
        F=np.stack([opened.F, shut.F]),
        G=np.concatenate([np.stack([opened.G, shut.G]), by_chance], axis=2),
        H=np.stack([opened.H, shut.H]),
        D=np.concatenate([np.stack([opened.D, shut.D]), np.zeros((2, 1))], axis=1),
        variances=np.append(variances, (agitation * swing) ** 2),
        P=covariance,
        s=np.zeros(size),
        ahead=np.zeros(size),
        gains=np.zeros((n, size)),
        deviations=np.ones(n),
        shares=np.zeros(n),
        left=np.zeros(n),
        white=np.zeros(n),
        room=np.zeros((4, size, size)),
    )
    followed(model, true, vector, watch)
    return Follower(watch._replace(learning=False), model, motion, torque)
