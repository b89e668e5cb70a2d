"""95 % intervals of a fitted model, from how its records disagree: over time and among each other, whichever says more.

    over time       V = A⁻¹ (Σ_g s_g s_gᵀ) A⁻¹ G/(G - n)              sandwich form, groups g of :data:`GROUP_S`; never below A⁻¹
    among records   V = (G - 1)/G Σ_r d_r d_rᵀ,  d_r = A⁻¹ B (B - B_r)⁻¹ s_r   what leaving out a record would move (jackknife)

A : information, B = Σ B_r less that of the rounding (``residual.rounding_bias``).   s : gradient.

A law that is not quite the machine's makes long segments pull the same way, each kind of record another one; the scatter over time is
blind to that.  What all records share of it no record can tell: so much is added (:data:`LAW`) to the parameters of every effect that is
not one of :data:`EXACT`, and to all of them together what the sampling of the motion leaves (:data:`SCALE`).  No friction is below 0: what
that leaves of the intervals is worked out by draws.

Where every model is judged in its own noise, each column of a Jacobian holds noise of its own; its share of the squares is

    A = Σ ∂ν ∂νᵀ - E Σ ∂(W T ε) ∂(W T ε)ᵀ

W, T as in ``residual.rounding_bias``.  The expectation hangs on which samples are kept, so it is taken by one draw of the noises ε
on the samples as they are; thousands of samples make its scatter small.   Source: method sheet, section 3, "not JᵀJ".
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np
from scipy.special import stdtrit

from beltcomm.arrays import Array, BoolArray, IntArray
from beltcomm.compiled import compiled
from beltcomm.effects import other_load
from beltcomm.errors import DataError
from beltcomm.fit.estimate import INERTIA, Fitted
from beltcomm.fit.likelihood.problem import Nuisance, Problem, time_blocks
from beltcomm.fit.noise.whitening import noises
from beltcomm.fit.records import rounding_torque
from beltcomm.fit.residual.segment import Segment
from beltcomm.fit.residual.whitened import noise_paths_of, whitener_of
from beltcomm.fit.uncertainty.draws import share_within_bounds
from beltcomm.model import Model
from beltcomm.model.covariance import Covariance

#: Share of the variance that the noise alone gives, below which the groups' scatter says nothing.
FAINT = 1e-12
#: s; groups between which the gradient is taken as independent.
GROUP_S = 2.0
#: Share of a record that is left out: a parameter that one record alone tells would else have nothing left to be told by.
LEFT_OUT = 0.99
#: How well a law can mean a machine, relative to its parameter: gaps end in rough surfaces, lags have a second pole.  On simulated machines
#: of other laws gaps were 0.1 to 0.9 % off, lags 0.2 to 0.5 %.
LAW = 0.005
#: How far the scale of all torques, inertias and stiffnesses together, and friction beside it, which turns round between two samples, may
#: be off by what rounding and the instants of the samples leave.  On 60 simulated axes the fine ones were off by up to 0.07 and 0.15 %.
SCALE, FRICTION = 0.0007, 0.001
#: The same of the motor's inertia, where all of the noise is the rounding of a coarse encoder, and of the scale where the torque that acts
#: is worked out from filters of drive and reading.  On 54 simulated axes with drawn instruments inertias were off by 0.1 to 0.3 and 0.2 %.
ROUNDED, FILTERED = 0.002, 0.001
#: Information in a direction, as a share of the largest, columns of length 1, below which it is rounding.
NOTHING = 1e-14
#: Share of the information that rounding, which is no white noise where the motor hardly moves, leaves in any direction.
LEAST_LEFT = 0.05
#: How much wider an interval is where every model is judged in its own noise: rounding follows the motion and says which samples
#: count, so it is not as white as it is taken for.  On 60 simulated axes inertias were off by up to 1.9 times what 1.5 would say.
NOT_WHITE = 2.5
#: The same for dampings that are told apart where all models are judged in one noise: above 1, for the share of it that is rounding.  On 17
#: simulated axes with 3000 to 6000 counts they were off by up to 1.8 times what 1 would say.
NEARLY_WHITE = 0.8
#: How far the dampings of motor, carriage and belt may each be off for how they are told apart, relative to them: by what the belt's swing
#: loses, where the motion between the samples is a likeness.  On 44 simulated axes with fine encoders they were off by up to 1.2 %.
DAMPED, DAMPINGS = 0.01, ("viscous.", "viscous_cart.", "belt_damping.")
#: Frictions, of which the torque is a linear function: below none of one there is none.
RUBBING = ("viscous.", "viscous_cart.", "coulomb.", "cart_friction.")
#: Least degrees of freedom of a comparison among records.
LEAST_FREEDOM = 2.0
#: Effects whose law is the machine's own, not a likeness of it; error over the noise from which on something else is at work.
EXACT = (
    *("belt_stiffness", "belt_damping", "belt_spans", "viscous", "viscous_cart", "coulomb", "cart_friction", "tilt", "constant_offset"),
    *(effect.name for effect in other_load.EFFECTS),
)
UNEXPLAINED = 1.1
#: Effect behind which the motion between the samples is the model's own guess, which the fitted records take up: those held out show what
#: that leaves.  On the data-sheet rig, in three runs, its pulley was off by 12 to 14 %, 1.2 to 2 of the intervals without it.
SWINGS_UNSEEN = "coupling"
#: What has the scale of the torque.
SCALED = ("motor.inertia", "cart.mass", *(f"{effect}." for effect in EXACT))


@dataclass(frozen=True)
class ParameterSpread:
    """Covariance of the parameters of a fit, in their units.

    Attributes
    ----------
    names : tuple of str
        Of those that the data see.
    bound : frozenset of str
        Of those of them at a bound.
    covariance, freedom
        Over time, (n, n).
    moved : ndarray
        By leaving out each record, (records, n).
    shares : ndarray
        Information of each record, carried to the parameters, A⁻¹ A_r A⁻¹, (records, n, n).
    systematic : ndarray
        What no record tells, half a 95 % interval of every independent cause in each parameter, (causes, n).
    unexplained : float
        Factor on all of it, the error over the noise where something is left that is no noise: what pulls everywhere the same way shows
        neither over time nor among records.
    """

    names: tuple[str, ...]
    covariance: Array
    freedom: int
    moved: Array
    shares: Array
    systematic: Array
    bound: frozenset[str] = frozenset()
    unexplained: float = 1.0

    def half_width(self, combination: Mapping[str, float]) -> float | None:
        """Half the 95 % interval of a sum of parameters with these factors, by name; None where one of them sits at a bound."""
        if any(name not in self.names or name in self.bound for name in combination):
            return None
        c = np.array([combination.get(name, 0.0) for name in self.names])
        over_time = np.sqrt(max(float(c @ self.covariance @ c), 0.0)) * float(stdtrit(self.freedom, 0.975))
        records, told = len(self.moved), np.einsum("i,rij,j->r", c, self.shares, c)
        beside = float(np.linalg.norm(self.systematic @ c))
        if records < 2 or not np.any(told > 0.0):
            return self.unexplained * float(np.hypot(over_time, beside))
        freedom = max(float(np.sum(told) ** 2 / np.sum(told**2)), LEAST_FREEDOM)  # Satterthwaite
        among = np.sqrt(float(np.sum((self.moved @ c) ** 2)) * (records - 1) / records)
        return self.unexplained * float(np.hypot(max(over_time, among * float(stdtrit(freedom, 0.975))), beside))

    def joint(self) -> Covariance:
        """Covariance in the parameters' units, correlated as over time, its deviations those of :meth:`half_width` without bounds."""
        free = replace(self, bound=frozenset())
        deviation = np.array([float(free.half_width({name: 1.0}) or 0.0) for name in self.names]) / float(stdtrit(self.freedom, 0.975))
        over_time = Covariance(self.names, self.covariance, self.freedom)
        return replace(over_time, matrix=over_time.correlation(self.names) * np.outer(deviation, deviation))

    def share_within_bounds(self, model: Model) -> dict[str, float]:
        """Share of the half width of each parameter that is left where no friction is below its bound."""
        low = np.array([model.parameters[name].low if name.startswith(RUBBING) else -np.inf for name in self.names])
        mean = np.array([model[name] for name in self.names])
        return dict(zip(self.names, map(float, share_within_bounds(mean, self.covariance, low, self.freedom)), strict=True))


#: Models with their intervals, and the nuisance they count with, as long as the fits live that they are of.
_KNOWN: WeakKeyDictionary[Fitted, tuple[Nuisance | None, Model]] = WeakKeyDictionary()


@dataclass(frozen=True)
class Information:
    """Gradients and information of some parameters around a minimum, in units of ``scale``.

    Attributes
    ----------
    names : tuple of str
        Of the parameters.
    scores : ndarray
        Gradient of each group, (groups, n).
    pulls, parts : ndarray
        Gradient, (records, n), and information, (records, n, n), of each record.
    inverse : ndarray
        Of the information of all, (n, n).
    unknown : ndarray
        Variance of what is told by nothing, (n, n).
    level : float
        Mean square of what is left, weighted.
    elsewhere : ndarray
        Variance by what comes from there, (n, n).
    """

    names: tuple[str, ...]
    scale: Array
    scores: Array
    pulls: Array
    parts: Array
    inverse: Array
    unknown: Array
    level: float
    elsewhere: Array

    @property
    def freedom(self) -> int:
        """Degrees of freedom over time."""
        return max(len(self.scores) - len(self.names), 3)

    @property
    def covariance(self) -> Array:
        """Over time, (n, n), in units of ``scale``."""
        scatter = self.inverse @ (self.scores.T @ self.scores) @ self.inverse * (len(self.scores) / self.freedom)
        # Between few groups the scatter falls below what the noise alone gives, by chance, or where they are fewer than the parameters.
        least, own = np.diag(self.inverse) * max(self.level, 1.0), np.diag(scatter)
        told = own > FAINT * least
        wider = np.sqrt(np.maximum(np.divide(least, own, out=np.ones_like(own), where=told), 1.0))
        return np.asarray(scatter * np.outer(wider, wider) + np.diag(np.where(told, 0.0, least)) + self.unknown) + self.elsewhere


def information_of(fitted: Fitted) -> Information:
    """Information of the parameters of a fit; start offsets of its records are taken along and then left out.

    One at its bound may as well be a little off it, and the intervals of the others must bear that.

    Parameters
    ----------
    fitted : Fitted
        At its minimum.

    Returns
    -------
    Information
        In scaled unknowns; those that nothing tells are left out.

    Raises
    ------
    DataError
        When no sample counts.
    """
    problem = fitted.problem
    weights, own = problem.weights(fitted.residual), len(problem.free)
    jacobian, left = problem.jacobian(fitted.x).weighted_rows(weights), fitted.residual * weights
    # What a start offset can take up says nothing.
    columns = jacobian.columns[:, :own]
    for here in jacobian.segments():
        offset = jacobian.columns[here, own]
        size = float(offset @ offset)
        if size > 0.0:
            columns[here] -= np.outer(offset, offset @ columns[here] / size)
            left[here] -= offset * float(offset @ left[here]) / size
    seen = np.linalg.norm(columns, axis=0) > 0.0
    free = np.flatnonzero(seen)
    norms = np.linalg.norm(columns[:, free], axis=0)
    columns, scale = columns[:, free] / norms, problem.scale[free] / norms
    slope, curvature = problem.rounding_derivatives(fitted.x)
    of_block = np.zeros(len(problem.count))
    of_block[problem.blocks] = weights**2
    pulled = (of_block / problem.count)[:, None] * slope[:, free] / norms
    gradient = columns * left[:, None] - 0.5 * pulled[problem.blocks]
    records = _records_of(problem)
    if not len(records):
        raise DataError("no sample of the records counts in this fit; record again, longer or at a shorter period")
    alike = of_block * np.array([not piece.own_noise for piece in problem.pieces])[problem.piece_of_block]
    turned = np.tensordot(alike, curvature, 1) + _noise_information(problem, fitted.x, weights)
    turned = turned[free[:, None], free] / np.outer(norms, norms)
    parts = np.array([columns[records == r].T @ columns[records == r] for r in range(int(records.max()) + 1)])
    whole = parts.sum(axis=0)
    inverse, unknown = _inverse_of(whole - turned * _least_left(whole, turned))
    names = tuple(problem.free[i] for i in free)
    scores, pulls = _sum_by_label(gradient, time_blocks(problem.pieces, GROUP_S)), _sum_by_label(gradient, records)
    elsewhere = np.zeros_like(inverse)
    if problem.nuisance is not None:
        others, known = problem.nuisance.columns * weights[:, None], problem.nuisance.information
        cross = columns.T @ others
        moved = inverse @ cross
        told = np.outer(problem.nuisance.told, problem.nuisance.told)
        values, vectors = np.linalg.eigh(told * (others.T @ others - cross.T @ moved))
        beside = (vectors * np.maximum(values, 0.0)) @ vectors.T  # nothing is told less than not at all
        elsewhere = moved @ np.linalg.pinv(beside + known, hermitian=True) @ moved.T
    if any(piece.own_noise for piece in problem.pieces):
        scores, pulls = NOT_WHITE * scores, NOT_WHITE * pulls
    return Information(names, scale, scores, pulls, parts, inverse, unknown, float(np.mean(left**2)), elsewhere)


def _at_bound(fitted: Fitted) -> BoolArray:
    """Parameters of a fit that sit at a bound, (n,)."""
    problem, own = fitted.problem, len(fitted.problem.free)
    found: BoolArray = ((fitted.x <= problem.low + 1e-9) | (fitted.x >= problem.high - 1e-9))[:own]
    return found


def parameter_spread(fitted: Fitted) -> ParameterSpread:
    """Covariance of a fit's parameters, what records and systematic errors add to it, and which sit at a bound.

    Parameters
    ----------
    fitted : Fitted
        At its minimum.

    Returns
    -------
    ParameterSpread
        In the units of the parameters.
    """
    told, model = information_of(fitted), fitted.model
    moved, shares = _without_each(told)
    names, scale = told.names, told.scale
    loose = tuple(f"{effect}." for effect in model.effects if effect not in EXACT)
    values = np.array([model[name] for name in names])
    damping = np.array([name.startswith(DAMPINGS) for name in names]) & ("viscous_cart.damping" in names)
    own = DAMPED * damping + [LAW if name.startswith(loose) else FRICTION if name == "coulomb.level" else 0.0 for name in names]
    scale_off = SCALE if fitted.problem.nuisance is None else math.hypot(SCALE, FILTERED)
    scaled, inertia = (np.array([name.startswith(which) for name in names]) for which in (SCALED, INERTIA))
    rounded = rounded_share(fitted)
    common = np.vstack((scale_off * scaled, ROUNDED * rounded * inertia)) * values
    systematic = np.vstack((np.diag(own * np.abs(values)), common))
    one_noise = not any(piece.own_noise for piece in fitted.problem.pieces)
    wider = 1.0 + NEARLY_WHITE * rounded * damping * one_noise
    if not loose and fitted.ratio < UNEXPLAINED:  # nothing that pulls long segments one way: chance is told by time alone
        moved, shares = moved[:0], shares[:0]
    scale = scale * wider
    units, sits = np.outer(scale, scale), _at_bound(fitted)
    bound = frozenset(name for name, sat in zip(fitted.problem.free, sits, strict=True) if sat)
    left = fitted.ratio if fitted.ratio >= UNEXPLAINED else 1.0
    if SWINGS_UNSEEN in model.effects and fitted.held_out_ratio is not None:
        left = max(left, fitted.held_out_ratio)
    return ParameterSpread(names, told.covariance * units, told.freedom, moved * scale, shares * units, systematic, bound, left)


def rounded_share(fitted: Fitted) -> float:
    """Share of the noise's power, as torque of acceleration, that is rounding of the angle; the median of the segments.

    Parameters
    ----------
    fitted : Fitted
        To any records.

    Returns
    -------
    float
        0 to 1.
    """
    inertia, shares = fitted.model.driven_inertia(), []
    for piece in fitted.problem.pieces:
        rounding = rounding_torque(inertia, piece.step_rad, piece.motion.sample_s) ** 2
        shares.append(rounding / (rounding + piece.noise_nm**2))
    return float(np.median(shares))


def unbounded_estimates(fitted: Fitted) -> dict[str, tuple[float, float]]:
    """Unbounded estimate of each parameter at a bound, by the data alone, and its standard deviation, in its unit.

    One of which the residual does not depend is missing.

    Parameters
    ----------
    fitted : Fitted
    """
    if not _at_bound(fitted).any():
        return {}
    told = information_of(fitted)
    ahead, deviation = -told.inverse @ told.scores.sum(axis=0) * told.scale, np.sqrt(np.diag(told.covariance)) * told.scale
    return {name: (fitted.model[name] + float(a), float(d)) for name, a, d in zip(told.names, ahead, deviation, strict=True)}


def _least_left(information: Array, off: Array) -> float:
    """Share of what rounding takes off an information that leaves :data:`LEAST_LEFT` of it in every direction: 1 where it does anyway."""
    values, vectors = np.linalg.eigh(information)
    root = vectors / np.sqrt(np.maximum(values, NOTHING * values[-1]))
    most = float(np.linalg.eigvalsh(root.T @ off @ root)[-1])
    return min(1.0, (1.0 - LEAST_LEFT) / most) if most > 0.0 else 1.0


def _inverse_of(information: Array) -> tuple[Array, Array]:
    """Its inverse, and the variance, a huge one, in the directions of which the data say nothing: those are not known exactly."""
    values, vectors = np.linalg.eigh(information)
    least = NOTHING * values[-1]
    unseen = vectors[:, values < least]
    return (vectors / np.maximum(values, least)) @ vectors.T, unseen @ unseen.T / least


def _sum_by_label(rows: Array, labels: IntArray) -> Array:
    """Sum over each group, (groups, n), of (values, n)."""
    sums = np.zeros((int(labels.max()) + 1, rows.shape[1]))
    np.add.at(sums, labels, rows)
    return sums


def _records_of(problem: Problem) -> IntArray:
    """Running number of the record of every value of the residual."""
    numbers = {name: i for i, name in enumerate(dict.fromkeys(piece.record for piece in problem.pieces))}
    return np.repeat([numbers[piece.record] for piece in problem.pieces], [len(piece.value_samples) for piece in problem.pieces])


def _without_each(told: Information) -> tuple[Array, Array]:
    """Shift of the parameters without each record, (records, n), in ``scale``, and its share of their variance, (records, n, n)."""
    whole = told.parts.sum(axis=0)
    pulls = [whole @ _inverse_of(whole - LEFT_OUT * part)[0] @ pull for part, pull in zip(told.parts, told.pulls, strict=True)]
    return np.array(pulls) @ told.inverse, told.inverse @ told.parts @ told.inverse


def with_intervals(fitted: Fitted) -> Model:
    """The model with half widths of 95 %, worked out once: several answers in a row ask for it; None where a parameter sits at a bound.

    Parameters
    ----------
    fitted : Fitted
        At its minimum.

    Returns
    -------
    Model
        Of its parameters, in their units.
    """
    nuisance, known = _KNOWN.get(fitted, (None, None))
    if known is None or nuisance is not fitted.problem.nuisance:
        spread = parameter_spread(fitted)
        parameters, share = dict(fitted.model.parameters), spread.share_within_bounds(fitted.model)
        for name in fitted.problem.free:
            half = spread.half_width({name: 1.0})
            parameters[name] = replace(parameters[name], interval=half if half is None else half * share[name])
        known = replace(fitted.model, parameters=parameters, covariance=spread.joint())
        _KNOWN[fitted] = fitted.problem.nuisance, known
    return known


def _noise_information(problem: Problem, x: Array, weights: Array) -> Array:
    """Expected sum of squares of the module, (p, p), in nats per scaled unknown squared; ``x`` are p unknowns that all segments share."""
    own = len(problem.free)
    found = np.zeros((own, own))
    moved = [j for j in range(own) if problem.touches_noise[j]]
    if not moved:
        return found
    ahead = [problem.perturb(x, j) for j in moved]
    here = problem.model.with_vector(problem.full(x))
    beside = [problem.model.with_vector(problem.full(other)) for _, other in ahead]
    at = np.array(moved, dtype=np.intp)
    for i, piece in enumerate(problem.pieces):
        if not piece.own_noise:
            continue
        weight = weights[problem.ends[i] : problem.ends[i + 1]]
        base = _draw_of_noise(piece, here, i)
        columns = np.stack(
            [weight * (_draw_of_noise(piece, other, i) - base) / step for other, (step, _) in zip(beside, ahead, strict=True)], 1
        )
        found[at[:, None], at] += columns.T @ columns
    return found


def _draw_of_noise(piece: Segment, model: Model, seed: int) -> Array:
    """One draw, by ``seed``, of the noises of a segment as a model passes them on, over the deviation that it expects; (values,)."""
    along = noise_paths_of(piece, model)
    levels = [noises(path, piece.step_rad, piece.noise_nm, piece.rounding, piece.colour) for path in along.paths]
    f, g, h, d = (np.stack([getattr(path, name) for path, _, _ in levels]) for name in "FGHD")
    variances = levels[0][1]
    drawn = np.random.default_rng(seed).standard_normal((len(piece.keep), len(variances))) * np.sqrt(variances)
    return piece.group_sums(whitener_of(piece, model)(_noise_response(f, g, h, d, along.level, drawn), piece.keep))


@compiled
def _noise_response(f: Array, g: Array, h: Array, d: Array, level: IntArray, drawn: Array) -> Array:
    """e[n], N m at the motor shaft, of drawn noises ε, rad, and w, N m; (n, m) -> (n,)."""
    size = h.shape[1]
    s, moved, out = np.zeros(size), np.zeros(size), np.zeros(drawn.shape[0])
    for n in range(drawn.shape[0]):
        at, total = level[n], 0.0
        for m in range(drawn.shape[1]):
            total += d[at, m] * drawn[n, m]
        for i in range(size):
            total += h[at, i] * s[i]
            value = 0.0
            for m in range(drawn.shape[1]):
                value += g[at, i, m] * drawn[n, m]
            for j in range(size):
                value += f[at, i, j] * s[j]
            moved[i] = value
        out[n] = total
        for i in range(size):
            s[i] = moved[i]
    return out
