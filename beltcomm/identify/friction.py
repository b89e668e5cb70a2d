"""Viscous and Coulomb friction from a sweep of constant speeds, both directions, loop closed.

At constant speed the motor's torque is the friction of the whole axis, referred to the motor shaft: inertia and belt do not act.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from beltcomm.arrays import Array, rms
from beltcomm.errors import DataError, UsageError
from beltcomm.model.value import Value

#: Change of the reference velocity from row to row that is rounding and not acceleration, over the largest reference velocity.
CONSTANT_WITHIN = 1e-6
#: Parts into which a plateau is cut for the error of its mean: successive samples of a loop are not independent.
N_BATCHES = 8
#: Rows from which an acceleration can be told.
CURVED_ROWS = 8
#: A mean speed further from the reference than this part of it is no constant speed: the axis sticks or is limited, or its loop swings.
LARGEST_SPEED_ERROR = 0.1
#: A loop that swings turns the motor one way all the time where no batch is slower than this part of the reference.
ONE_WAY_SHARE = 0.25


#: m/s: slowest speed of a friction sweep.
SWEEP_SLOWEST_M_S = 0.01
#: Share of the slowest speed that is still fitted, so that rounding does not leave it out.
JUST_BELOW = 0.99


def slowest_fitted_rad_s(ratio_m_rad: float) -> float:
    """Sweeps below this are shown and not fitted, rad/s at the motor: the Stribeck effect acts there (3.6).

    Parameters
    ----------
    ratio_m_rad : float, m/rad
        i_t, of the transmission.
    """
    return JUST_BELOW * SWEEP_SLOWEST_M_S / ratio_m_rad


@dataclass(frozen=True)
class Plateau:
    """One pass at constant reference velocity, run-in discarded, motor side.

    Attributes
    ----------
    reference_rad_s : float, rad/s
    speed_rad_s : float, rad/s
        Slope of the measured angle.
    torque_nm : float, N m
        Mean.
    error_nm : float, N m
        Standard deviation of that mean, from its batches.
    start_s, duration_s : float, s
        Of what was used.
    one_way : bool
        It missed its speed, and turned one way all the time: what accelerates it is taken off the torque batch by batch, so that its mean
        is the friction at its mean speed.
    """

    reference_rad_s: float
    speed_rad_s: float
    torque_nm: float
    error_nm: float
    start_s: float
    duration_s: float
    one_way: bool = False

    @property
    def reached_speed(self) -> bool:
        """True if the motor turned about as fast as it was asked to."""
        return _reached(self.speed_rad_s, self.reference_rad_s)

    @property
    def shows_friction(self) -> bool:
        """True if its torque is the friction at its speed."""
        return self.reached_speed or self.one_way


@dataclass(frozen=True)
class FrictionPoint:
    """All passes at one reference velocity: means, and the standard deviation between the n passes (None for one)."""

    speed_rad_s: float
    torque_nm: float
    scatter_nm: float | None
    n: int


@dataclass(frozen=True)
class FrictionFit:
    """Friction of the whole axis referred to the motor shaft; every ``interval`` is a half width at 95 %.

    Attributes
    ----------
    viscous : Value
        d̃_v, N m s/rad.
    coulomb : Value
        τ̃_c, N m.
    offset : Value, N m
        What does not change sign with direction.
    forward, backward : tuple of Value or None
        (viscous, coulomb) of each direction alone, both positive for friction; None with fewer than two speeds.
    points : tuple of FrictionPoint
        Per reference velocity, rising.
    repeat_scatter_nm : float or None, N m
        Standard deviation of one pass beyond its own noise, None without repeats.
    rms_nm : float, N m
        Root mean square of what (3.36) leaves.
    remarks : tuple of str
        Sentences.
    """

    viscous: Value
    coulomb: Value
    offset: Value
    forward: tuple[Value, Value] | None
    backward: tuple[Value, Value] | None
    points: tuple[FrictionPoint, ...]
    repeat_scatter_nm: float | None
    rms_nm: float
    remarks: tuple[str, ...]

    def torque_nm(self, speed_rad_s: Array) -> Array:
        """d̃_v ω + τ̃_c sign(ω) + offset, N m.

        Raises nothing.

        Parameters
        ----------
        speed_rad_s : ndarray (n,)

        References
        ----------
        Thesis (3.36).
        """
        return np.asarray(
            self.viscous.value * speed_rad_s + self.coulomb.value * np.sign(speed_rad_s) + self.offset.value, dtype=np.float64
        )


def find_plateaus(
    t_s: Array,
    torque_nm: Array,
    position_rad: Array,
    reference_velocity_rad_s: Array,
    *,
    run_in_s: float = 0.2,
    shortest_s: float = 0.1,
    inertia_kg_m2: float = 0.0,
) -> tuple[Plateau, ...]:
    """Stretches of constant, non-zero reference velocity, without their first ``run_in_s``.

    Parameters
    ----------
    t_s : ndarray (n,), s
    torque_nm, position_rad, reference_velocity_rad_s : ndarray (n,), motor shaft
        Rows that are not finite are skipped.
    run_in_s : float, s
        Discarded at the start of each.
    shortest_s : float, s
        Least that must be left.
    inertia_kg_m2 : float
        Of all that moves, at the motor: what still accelerates is taken off the torque, J Δω/Δt; 0 leaves it in, which makes the viscous
        friction of a loop that settles slowly some permille too large.

    Raises
    ------
    DataError
        When arrays do not match.
    UsageError
        For times that are not positive.

    References
    ----------
    Thesis 3.6.
    """
    arrays = (t_s, torque_nm, position_rad, reference_velocity_rad_s)
    if any(a.shape != t_s.shape for a in arrays) or t_s.ndim != 1:
        raise DataError(f"the arrays of a friction sweep must have one equal length, not {', '.join(str(len(a)) for a in arrays)}")
    if run_in_s < 0 or not shortest_s > 0:
        raise UsageError(f"run-in {run_in_s} s must not be negative, shortest plateau {shortest_s} s must be positive")
    good = np.isfinite(np.stack(arrays)).all(axis=0)
    t, torque, angle, reference = (a[good] for a in arrays)
    fastest = float(np.max(np.abs(reference), initial=0.0))
    changes = np.flatnonzero(np.abs(np.diff(reference)) > CONSTANT_WITHIN * fastest) + 1
    plateaus = []
    for first, stop in zip([0, *changes], [*changes, len(reference)], strict=True):
        rows = slice(first, stop)
        if stop - first < 2 * N_BATCHES or abs(reference[first]) <= CONSTANT_WITHIN * fastest:
            continue
        used = t[rows] >= t[first] + run_in_s
        if used.sum() < 2 * N_BATCHES or t[rows][-1] - t[first] - run_in_s < shortest_s:
            continue
        plateaus.append(_plateau(t[rows][used], torque[rows][used], angle[rows][used], float(np.mean(reference[rows])), inertia_kg_m2))
    return tuple(plateaus)


def fit_friction(plateaus: Sequence[Plateau], *, slowest_rad_s: float = 0.0) -> FrictionFit:
    """Weighted least squares of the friction law over all passes, and over each direction alone.

    τ = d̃_v ω + τ̃_c sign(ω) + τ_0,     weight of a pass 1/(error² + s_r²)

    s_r is the scatter between passes at one speed beyond their own error, the same for all: friction does not repeat exactly, and
    without it the long slow passes would outvote all others.  τ_0 is half the sum of both directions: gravity, an offset of
    the current, or friction that differs by direction, which this sweep cannot tell apart.  Intervals: scatter about the law.

    Passes whose speed misses the reference by over 10 % are left out and named, unless they turn one way with a known inertia.

    Parameters
    ----------
    plateaus : sequence of Plateau
        From :func:`find_plateaus`, of one or more records.
    slowest_rad_s : float, rad/s
        Slower passes are shown but not fitted (Stribeck effect).

    Raises
    ------
    DataError
        With fewer than two speeds, or only one direction.

    References
    ----------
    Thesis (3.36), 3.6.
    """
    followed = [p for p in plateaus if p.shows_friction]
    used = [p for p in followed if abs(p.speed_rad_s) >= slowest_rad_s]
    speeds = {round(abs(p.reference_rad_s), 6) for p in used}
    directions = {p.reference_rad_s > 0 for p in used}
    if len(speeds) < 2 or len(directions) < 2 or len(used) < 4:
        raise DataError(
            f"{len(used)} passes at {len(speeds)} speed(s) in {len(directions)} direction(s) are left of {len(plateaus)}; at "
            "least 4 passes at two speeds, both directions, are needed: repeat the sweep, with a longer travel or a shorter run-in"
        )
    repeat_scatter_nm = _repeat_scatter([p for p in used if p.reached_speed])
    speed = np.array([p.speed_rad_s for p in used])
    torque = np.array([p.torque_nm for p in used])
    variance = np.array([p.error_nm for p in used]) ** 2 + (repeat_scatter_nm or 0.0) ** 2
    # An error of nothing, as a simulation without noise has, is no infinite weight.
    weight = 1.0 / np.maximum(variance, max(1e-6 * float(variance.max()), 1e-30))
    regressor = np.stack([speed, np.sign(speed), np.ones(len(speed))], axis=1)
    estimate, half = _weighted_estimate(regressor, torque, weight)
    fit = FrictionFit(
        viscous=_viscous(estimate[0], half[0]),
        coulomb=_coulomb(estimate[1], half[1]),
        offset=Value(float(estimate[2]), "N m", "motor", -np.inf, np.inf, float(half[2]), "friction sweep"),
        forward=_one_direction(1.0, speed, torque, weight),
        backward=_one_direction(-1.0, speed, torque, weight),
        points=_points(followed),
        repeat_scatter_nm=repeat_scatter_nm,
        rms_nm=rms(torque - regressor @ estimate),
        remarks=(),
    )
    left_out = sorted({p.reference_rad_s for p in plateaus if p not in followed})
    swung = sum(p.one_way for p in used)
    return replace(fit, remarks=_remarks(fit, left_out, swung / len(used), speed, torque, variance))


def _plateau(t: Array, torque: Array, angle: Array, reference_rad_s: float, inertia_kg_m2: float) -> Plateau:
    if inertia_kg_m2 > 0.0 and not _reached(_speed(t, angle)[1], reference_rad_s):
        swinging = _swinging(t, torque, angle, reference_rad_s, inertia_kg_m2)
        if swinging is not None:
            return swinging
    (begin_s, begin), (end_s, end) = (_speed(part, angle[rows]) for part, rows in _ends(t))
    torque = torque - inertia_kg_m2 * (end - begin) / (end_s - begin_s)
    batches = np.array([part.mean() for part in np.array_split(torque, N_BATCHES)])
    return Plateau(
        reference_rad_s=reference_rad_s,
        speed_rad_s=_speed(t, angle)[1],
        torque_nm=float(torque.mean()),
        error_nm=float(batches.std(ddof=1) / np.sqrt(N_BATCHES)),
        start_s=float(t[0]),
        duration_s=float(t[-1] - t[0]),
    )


def _swinging(t: Array, torque: Array, angle: Array, reference_rad_s: float, inertia_kg_m2: float) -> Plateau | None:
    """A pass that swings about its speed and turns one way all the time; None for another."""
    count = min(N_BATCHES, len(t) // CURVED_ROWS)
    parts = [slice(rows[0], rows[-1] + 1) for rows in np.array_split(np.arange(len(t)), count)]
    curves = np.array([np.polyfit(t[rows] - t[rows].mean(), angle[rows], 2) for rows in parts])
    speeds, accelerations = curves[:, 1], 2.0 * curves[:, 0]
    if np.any(speeds * np.sign(reference_rad_s) < ONE_WAY_SHARE * abs(reference_rad_s)):
        return None
    batches = np.array([torque[rows].mean() for rows in parts]) - inertia_kg_m2 * accelerations
    error_nm = float(batches.std(ddof=1) / np.sqrt(count))
    mean, duration_s = float(batches.mean()), float(t[-1] - t[0])
    return Plateau(reference_rad_s, float(speeds.mean()), mean, error_nm, float(t[0]), duration_s, one_way=True)


def _reached(speed_rad_s: float, reference_rad_s: float) -> bool:
    return abs(speed_rad_s - reference_rad_s) <= LARGEST_SPEED_ERROR * abs(reference_rad_s)


def _ends(t: Array) -> list[tuple[Array, slice]]:
    """First and last batch of times, and their rows."""
    size = len(t) // N_BATCHES
    return [(t[:size], slice(0, size)), (t[-size:], slice(len(t) - size, len(t)))]


def _speed(t: Array, angle: Array) -> tuple[float, float]:
    """Middle of a batch, s, and the slope of its angle, rad/s."""
    since = t - t.mean()
    return float(t.mean()), float(since @ angle / (since @ since))


def _groups(plateaus: Sequence[Plateau]) -> list[list[Plateau]]:
    """Passes by reference velocity, rising."""
    by_reference: dict[float, list[Plateau]] = {}
    for plateau in plateaus:
        by_reference.setdefault(round(plateau.reference_rad_s, 6), []).append(plateau)
    return [by_reference[key] for key in sorted(by_reference)]


def _points(plateaus: Sequence[Plateau]) -> tuple[FrictionPoint, ...]:
    points = []
    for group in _groups(plateaus):
        torque = np.array([p.torque_nm for p in group])
        scatter = float(torque.std(ddof=1)) if len(group) > 1 else None
        speed = float(np.mean([p.speed_rad_s for p in group]))
        points.append(FrictionPoint(speed, float(torque.mean()), scatter, len(group)))
    return tuple(points)


def _repeat_scatter(plateaus: Sequence[Plateau]) -> float | None:
    """Pooled standard deviation between passes at one reference velocity beyond the passes' own error; None without repeats."""
    squares, freedom, own = 0.0, 0, 0.0
    for group in _groups(plateaus):
        torque = np.array([p.torque_nm for p in group])
        squares += float(np.sum((torque - torque.mean()) ** 2))
        freedom += len(group) - 1
        own += (len(group) - 1) * float(np.mean([p.error_nm**2 for p in group]))
    return float(np.sqrt(max(squares - own, 0.0) / freedom)) if freedom else None


def _weighted_estimate(regressor: Array, torque: Array, weight: Array) -> tuple[Array, Array]:
    """Estimate and half widths at 95 % from the scatter about it; infinite when no pass is left over to judge by."""
    root = np.sqrt(weight)
    estimate = np.asarray(np.linalg.lstsq(regressor * root[:, None], torque * root, rcond=None)[0], dtype=np.float64)
    freedom = len(torque) - regressor.shape[1]
    if freedom < 1:
        return estimate, np.full(len(estimate), np.inf)
    spread = float(np.sum(weight * (torque - regressor @ estimate) ** 2)) / freedom
    covariance = spread * np.linalg.inv(regressor.T @ (regressor * weight[:, None]))
    return estimate, np.asarray(stdtrit(freedom, 0.975) * np.sqrt(np.diag(covariance)), dtype=np.float64)


def _one_direction(sign: float, speed: Array, torque: Array, weight: Array) -> tuple[Value, Value] | None:
    rows = np.sign(speed) == sign
    if rows.sum() < 2 or np.ptp(speed[rows]) < LARGEST_SPEED_ERROR * np.max(np.abs(speed[rows])):
        return None
    regressor = np.stack([np.abs(speed[rows]), np.ones(int(rows.sum()))], axis=1)
    estimate, half = _weighted_estimate(regressor, sign * torque[rows], weight[rows])
    return _viscous(estimate[0], half[0]), _coulomb(estimate[1], half[1])


def _viscous(value: float, half: float) -> Value:
    return Value(float(value), "N m s/rad", "motor", 0.0, np.inf, float(half), "friction sweep")


def _coulomb(value: float, half: float) -> Value:
    return Value(float(value), "N m", "motor", 0.0, np.inf, float(half), "friction sweep")


def _remarks(
    fit: FrictionFit, left_out_rad_s: Sequence[float], swung: float, speed: Array, torque: Array, variance: Array
) -> tuple[str, ...]:
    """Remarks: plateaus left out or swung, parameters that the sweep does not determine, and where the law does not hold.

    swung : share of the passes.
    """
    remarks = []
    if left_out_rad_s:
        named = ", ".join(f"{v:.3g}" for v in left_out_rad_s)
        remarks.append(
            f"passes at {named} rad/s left out: their mean speed misses the reference by more than {LARGEST_SPEED_ERROR:.0%} "
            "(the axis sticks, or a limit acts)"
        )
    if swung:
        remarks.append(
            f"{swung:.0%} of the passes swung about their speed (a loop that settles slowly): what accelerated the axis was taken off by "
            "the model's inertia, and each counts at its mean speed"
        )
    if fit.repeat_scatter_nm is None:
        remarks.append("no speed was repeated: how well friction repeats is not known; repeat the sweep for that")
    for name, item in (("viscous", fit.viscous), ("Coulomb", fit.coulomb)):
        if item.interval is not None and item.value <= item.interval:
            remarks.append(
                f"{name} friction is not determined by this sweep: {1e3 * item.value:.2g} ± {1e3 * item.interval:.2g} m{item.unit}; "
                "spread the speeds wider and repeat them"
            )
    if fit.offset.interval is not None and abs(fit.offset.value) > fit.offset.interval:
        remarks.append(
            f"an offset of {1e3 * fit.offset.value:.3g} ± {1e3 * fit.offset.interval:.2g} mN m: gravity, an offset of the current or "
            "friction that differs by direction; on a tilted axis most of it is gravity, elsewhere a sweep with another payload tells "
            "that apart"
        )
    slowest = float(np.min(np.abs(speed)))
    slow = np.abs(speed) <= slowest * (1.0 + 2.0 * LARGEST_SPEED_ERROR)
    above = float(np.mean(np.sign(speed[slow]) * (torque - fit.torque_nm(speed))[slow]))
    if fit.repeat_scatter_nm is not None and abs(above) > 3.0 * float(np.sqrt(np.sum(variance[slow]))) / int(slow.sum()):
        remarks.append(
            f"at {slowest:.3g} rad/s friction is {1e3 * abs(above):.2g} mN m {'above' if above > 0 else 'below'} the law: "
            "it is not straight at low speed (Stribeck effect); leave slow speeds out with slowest_rad_s if the move is fast"
        )
    return tuple(remarks)
