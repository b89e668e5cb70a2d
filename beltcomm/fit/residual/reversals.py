"""Reversals that the motor passes through: where dry friction turns round at one instant, and what a grid of time misses of it.

A motor that comes to standstill may stick, and then carries any torque up to its friction: nothing is known there.  One that goes on
the other way with more torque to spare than friction takes cannot have stuck.  Its friction is -level before the instant t₀ at which
the speed is zero and +level after it (or the reverse); with the accelerations a₁ before and a₂ after it, in a fine step of length h,

    t₀ - t_k = h t₁/(t₁ + t₂),    t₁ = |ω_k|/a₁,    t₂ = |ω_k+1|/a₂.

The kernel lets friction turn at a point of the grid, and Simpson's rule takes a jump for a curve: both together are off by a third of a
fine step, 20 us, and always to the same side.  Beside samples without a reversal that is nothing; in samples with one it would
be 0.5 % of the motor's inertia.

Samples in which the motor may have stuck say nothing, but how it moved there sets the carriage ringing, and that goes on in the samples
after them.  There friction follows from the torque N that is left for it:

    J ω' = N - level s,   s = sign(ω) while it moves,   N/level while it rests, until |N| > level.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from beltcomm.arrays import Array, BoolArray
from beltcomm.compiled import compiled
from beltcomm.model import Model
from beltcomm.simulate.inverse import FineMotion
from beltcomm.simulate.kernels.pieces import triangular_mean

#: Parameter of the friction that turns.
LEVEL = "coulomb.level"
#: Rounds in which instants, rests and motion find each other.
ROUNDS = 3
#: Torque that a motor has to spare after a reversal, over its friction, for it not to have stuck.
TO_SPARE = 1.0
#: An acceleration beside a reversal is taken as this share, at least, of the mean over the step in which it lies.
LEAST_SHARE = 0.2
#: Fine steps after which the kernel's friction has turned round.
TURNED = 4


def turns_at_once(model: Model) -> bool:
    """True if the motor's friction, as the model has it, has one level and turns round where the speed does.

    Parameters
    ----------
    model : Model
        With any effects.

    Returns
    -------
    bool
        False without a carriage.
    """
    rubbing = {e.name for e in model.effect_list() if e.body == "motor" and e.slot in ("friction_level", "friction_onset")}
    return "cart" in model.base_bodies and rubbing <= {"coulomb"}


def motion_through_reversals(
    motion: FineMotion, model: Model, slow_rad_s: float, rebuilt: Callable[..., FineMotion]
) -> tuple[FineMotion, BoolArray, Array | None]:
    """The motion with friction that turns at the right instants, samples that count, (n,), and what the kernel's friction of level 1 lacks.

    Parameters
    ----------
    motion : FineMotion
    model : Model
    slow_rad_s : float, rad/s, motor shaft
        Speed below which a reversal may hide.
    rebuilt : callable
        Motion between the samples made anew; ``lacking`` : a load more, N m, mean over each fine step.
    """
    level = model.get(LEVEL)
    if not level:  # nothing holds this motor anywhere
        keep = np.ones(motion.samples, dtype=np.bool_)
        keep[[0, -1]] = False
        return motion, keep, None
    ratio, slows = model["transmission.ratio"], level / model.driven_inertia()  # m/rad, and what friction alone does, rad/s²
    least, fine_s = TO_SPARE * slows, motion.sample_s / motion.substeps
    acted: Array | None = None
    for _ in range(ROUNDS):
        doubtful, instants = _find_passages(motion, slow_rad_s, least)
        lacking, acting = _reversal_correction(motion, instants, ratio)[0], _kernel_directions(motion, ratio)
        rubbed = acting + lacking
        if acted is not None:  # the motion is then that of a friction that is known
            left = np.diff(motion.omega) / (slows * fine_s) + acted
            _rest(motion.omega, left, doubtful, slows * fine_s, slow_rad_s, rubbed)
        motion, acted = rebuilt(motion, lacking=level * (rubbed - acting)), rubbed
    last, instants = _find_passages(motion, slow_rad_s, least)
    # Where it was made to rest it now may look as if it went through: a rest is short beside a fine step there.
    return motion, ~_samples_at(doubtful | last, motion.substeps), _reversal_correction(motion, instants, ratio)[1]


def _find_passages(motion: FineMotion, slow_rad_s: float, least_rad_s2: float) -> tuple[BoolArray, Array]:
    """Points of the fine grid, (fine,), at which the motor may have stuck; and instants at which it surely did not, in fine steps.

    Above ``slow_rad_s`` it surely moves; with ``least_rad_s2``, before and after, it goes through a reversal.
    """
    doubtful = np.zeros(len(motion.omega), dtype=np.bool_)
    instants = np.empty(len(motion.omega))
    count = _passages(motion.omega, slow_rad_s, least_rad_s2 * motion.sample_s / motion.substeps, doubtful, instants)
    return doubtful, instants[:count].copy()


@compiled
def _passages(omega: Array, slow: float, least: float, doubtful: BoolArray, instants: Array) -> int:
    """:func:`_find_passages` with ``least`` per fine step; number of instants."""
    n, count, i = omega.shape[0], 0, 0
    while i < n:
        turned = i > 0 and abs(omega[i]) >= slow and omega[i - 1] * omega[i] < 0.0
        if abs(omega[i]) >= slow and not turned:
            i += 1
            continue
        first = i - 1  # the last point that surely moves, or -1
        last = i
        while last < n and abs(omega[last]) < slow:
            last += 1
        crossed, at = 0, -1
        for k in range(max(first, 0), min(last, n - 1)):
            if omega[k] * omega[k + 1] <= 0.0:
                crossed, at = crossed + 1, k
        through = first >= 1 and last < n - 1 and crossed == 1 and omega[first] * omega[last] < 0.0
        if through:
            mean = abs(omega[at + 1] - omega[at])
            before = max(abs(omega[at] - omega[at - 1]), LEAST_SHARE * mean)
            after = max(abs(omega[at + 2] - omega[at + 1]), LEAST_SHARE * mean)
            one, two = abs(omega[at]) / before, abs(omega[at + 1]) / after
            instant = at + one / (one + two)
            through = min(abs(omega[first]) / (instant - first), abs(omega[last]) / (last - instant)) >= least
            if through:
                instants[count] = instant
                count += 1
        if not through:
            for k in range(max(first, 0), min(last + 1, n)):
                doubtful[k] = True
        i = max(last, i + 1)
    return count


def _samples_at(doubtful: BoolArray, substeps: int) -> BoolArray:
    """Samples, (n,), whose triangular weight touches a doubtful point of the fine grid; the ends too."""
    inside = np.any(np.lib.stride_tricks.sliding_window_view(doubtful, substeps + 1)[::substeps], axis=1)
    touched = np.ones(len(doubtful) // substeps + 1, dtype=np.bool_)
    touched[1:-1] = inside[:-1] | inside[1:]
    return touched


def _reversal_correction(motion: FineMotion, instants: Array, ratio: float) -> tuple[Array, Array]:
    """Friction that the kernel, at level 1 N m, lacks around these instants: mean over each fine step, (fine - 1,), and over each
    sample with its triangular weight, (n,), ends 0.
    """
    points = _directions(motion.theta, ratio / motion.bristle_m)
    kernel = _between(points)
    cells = kernel.copy()
    place = instants.astype(np.intp)
    for k, share in zip(place, instants - place, strict=True):
        side = 1.0 if motion.omega[k + 1] > 0.0 else -1.0
        cells[k] = side * (1.0 - 2.0 * share)
        cells[k + 1 : k + TURNED] = side
    rows = cells.reshape(motion.samples - 1, motion.substeps)
    ramp = (np.arange(motion.substeps) + 0.5) / motion.substeps**2  # the middle of a step weighs it exactly: the weight is linear within it
    mean = np.zeros(motion.samples)
    mean[1:-1] = rows[:-1] @ ramp + rows[1:] @ ramp[::-1]
    return cells - kernel, mean - triangular_mean(points, motion.substeps)


def _kernel_directions(motion: FineMotion, ratio: float) -> Array:
    """Direction of the motor's friction as the kernel has it, mean over each fine step, (fine - 1,)."""
    return _between(_directions(motion.theta, ratio / motion.bristle_m))


def _between(points: Array) -> Array:
    return np.asarray(0.5 * (points[:-1] + points[1:]))


@compiled
def _rest(omega: Array, left: Array, doubtful: BoolArray, step: float, slow: float, rubbed: Array) -> None:
    """Direction of friction, mean over each fine step, written where the motor may have stuck.

    omega : rad/s, (fine,).   left : torque that is left for friction, over its level, (fine - 1,).   step : by which the level alone
    changes the speed in a fine step, rad/s.   slow : speed above which it surely moves.
    """
    speed = 0.0
    for k in range(rubbed.shape[0]):
        if not (doubtful[k] and doubtful[k + 1]):
            continue
        if k == 0 or not doubtful[k - 1] or abs(omega[k]) >= slow:
            speed = omega[k]  # here it surely moves
        side = 0.0 if speed == 0.0 else (1.0 if speed > 0.0 else -1.0)
        mean, rest = 0.0, 1.0
        if side != 0.0:
            change = (left[k] - side) * step
            if (speed + change) * side > 0.0:
                mean, rest, speed = side, 0.0, speed + change
            else:
                rest = 1.0 + speed / change  # it comes to standstill within the step
                mean, speed = side * (1.0 - rest), 0.0
        if rest > 0.0:
            if abs(left[k]) <= 1.0:
                mean += rest * left[k]
            else:
                on = 1.0 if left[k] > 0.0 else -1.0
                mean += rest * on
                speed = rest * (left[k] - on) * step
        if abs(omega[k + 1]) < slow:  # as is seen: a level a little off must not let it run away from its own path
            speed = min(max(speed, -slow), slow)
        rubbed[k] = mean


@compiled
def _directions(theta: Array, turning: float) -> Array:
    """Direction of the motor's friction as the kernel has it, -1 to 1, at each point of the fine grid."""
    z, out = 0.0, np.zeros(theta.shape[0])
    for k in range(1, theta.shape[0]):
        z = min(1.0, max(-1.0, z + turning * (theta[k] - theta[k - 1])))
        out[k] = z
    return out
