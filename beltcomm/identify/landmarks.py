"""Antiresonance and resonance of the belt: those of a model, chosen by their shape, and of one measured response, with intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from scipy.optimize import least_squares
from scipy.special import stdtrit

from beltcomm.arrays import Array, ComplexArray
from beltcomm.errors import DataError
from beltcomm.model import Model
from beltcomm.model.linear import Matrices, matrices, operating_point
from beltcomm.response import FrequencyResponse

#: Band of the fit over the antiresonance expected and the resonance expected; how far either may be from what is expected.
BELOW, ABOVE, FARTHEST = 0.5, 1.5, 1.7
#: Lines with noise above this share of the response say nothing; as many as this are needed.
LARGEST_NOISE, FEWEST_LINES = 0.3, 16
#: An interval larger than this share of its frequency says that there is nothing to see.
LOST = 0.25
#: Hz: what swings more slowly is no resonance of a belt.
LOWEST_HZ = 0.5
#: Damping ratios beyond this are no resonance.
MOST_DAMPING = 1.0


@dataclass(frozen=True)
class Landmark:
    """A frequency, Hz, with the half width of its 95 % interval, and its damping ratio."""

    freq_hz: float
    interval_hz: float
    damping: float


@dataclass(frozen=True)
class Landmarks:
    """Of one response.   None where it cannot be told.

    Attributes
    ----------
    scatter : float
        Of the lines about the fit, relative, standard deviation.
    """

    antiresonance: Landmark | None
    resonance: Landmark | None
    scatter: float


@dataclass(frozen=True)
class Pair:
    """An antiresonance and a resonance of the motor's response, undamped, Hz, and their damping ratios.   Near each other they cancel."""

    antiresonance_hz: float
    resonance_hz: float
    damping: tuple[float, float]

    @property
    def width(self) -> float:
        """|log(f_r/f_z)|: what the pair changes of the response."""
        return abs(math.log(self.resonance_hz / self.antiresonance_hz))

    def response(self, freq_hz: Array) -> ComplexArray:
        """The pair's factor of the motor's response: (f_z² - f² + 2j ζ_z f_z f)/(f_r² - f² + 2j ζ_r f_r f).

        Parameters
        ----------
        freq_hz : ndarray, (m,)
            Hz.

        Returns
        -------
        ndarray, (m,) complex
            Without unit.
        """
        (z, r), (d_z, d_r) = (self.antiresonance_hz, self.resonance_hz), self.damping
        return np.asarray((z**2 - freq_hz**2 + 2j * d_z * z * freq_hz) / (r**2 - freq_hz**2 + 2j * d_r * r * freq_hz))


@dataclass(frozen=True)
class Shape:
    """The motor's response as  rigid axis · Π pairs.

    Attributes
    ----------
    belt : Pair
        In which the carriage swings on the belt.
    beside : tuple of Pair
        What else swings.
    """

    belt: Pair
    beside: tuple[Pair, ...]

    @property
    def lowest_hz(self) -> float:
        """The lowest resonance of all."""
        return min(pair.resonance_hz for pair in (self.belt, *self.beside))


def shape_of(model: Model, position_m: float) -> Shape | None:
    """Swinging of a model's sliding axis with the carriage at a place, m; None where nothing does, as on a belt that is too soft.

    K v = λ M v of all bodies, and with the motor held:  λ_1 <= μ_1 <= λ_2 <= μ_2 ... <= λ_n  (Cauchy).  λ_1 is the axis as a whole, free
    or on what depends on its place (cogging, a cable).  To the belt belong the μ_a and the λ_b above it with the largest

        s_a log(f_b/f_a) - 2 Σ widths of the pairs that the others make,   s : share of the carriage in the kinetic energy of mode a

    Payload, coupling or end pulley take less inertia along than the carriage, or move in its place.

    Parameters
    ----------
    model : Model
    position_m : float, m
        Carriage on the axis.

    Raises
    ------
    UsageError
    Refused
        As :func:`beltcomm.model.linear.matrices`.

    References
    ----------
    Golub, Van Loan, Matrix Computations, 4th ed., 8.1.7.
    """
    m = matrices(model, operating_point(model, position_m, 1.0))
    if "motor" not in m.bodies or len(m.bodies) < 2:
        return None
    held = m.hold(("motor",))
    (mu, low, vectors), (lam, high, _) = _undamped_modes(held), _undamped_modes(m)
    shares = vectors[held.bodies.index("cart")] ** 2 if "cart" in held.bodies else np.ones(len(mu))
    kept = [i for i in range(len(mu)) if mu[i] > 0.0]

    def pair(zero: int, pole: int) -> Pair:
        z, r = math.sqrt(mu[zero]), math.sqrt(lam[pole + 1])
        return Pair(z / math.tau, r / math.tau, (float(low[zero]) / (2.0 * z), float(high[pole + 1]) / (2.0 * r)))

    best, most = None, -math.inf
    for a, b in combinations_with_replacement(kept, 2):
        beside = [pair(i, i) for i in kept if i < a or i > b] + [pair(i + 1, i) for i in range(a, b)]
        belt = pair(a, b)
        score = float(shares[a]) * belt.width - 2.0 * sum(one.width for one in beside)
        if score > most:
            best, most = Shape(belt, tuple(beside)), score
    return best if best is not None and best.belt.antiresonance_hz > LOWEST_HZ and max(best.belt.damping) < MOST_DAMPING else None


def _undamped_modes(m: Matrices) -> tuple[Array, Array, Array]:
    """Eigenvalues, (rad/s)², ascending, the damping of each, 2 ζ ω, rad/s, and the eigenvectors in mass-normalised coordinates."""
    scale = 1.0 / np.sqrt(np.diag(m.M))
    values, vectors = np.linalg.eigh(m.K * np.outer(scale, scale))
    return values, np.einsum("ji,jk,ki->i", vectors, m.D * np.outer(scale, scale), vectors), vectors


def find_landmarks(response: FrequencyResponse, expected: Pair, beside: Sequence[Pair] = ()) -> Landmarks:
    """Fit  ω^n a (f_z² - f² + 2j ζ_z f_z f)/(f_r² - f² + 2j ζ_r f_r f)  to log h, every line with the same weight.

    a complex and n real take up the rigid part, whose damping friction decides.  Friction's wrong lines scatter about the fit and widen the
    intervals (linearised, variance J*/(n - p)); a bias that all lines share they do not hold.

    Parameters
    ----------
    response : FrequencyResponse, rad/(N m), motor shaft
        Torque to motor angle.
    expected : Pair
        Where about.
    beside : sequence of Pair
        What else the model has, taken out of h first.

    Raises
    ------
    DataError
        When too few lines lie around it.

    References
    ----------
    (2.42), 3.5.
    """
    antiresonance_hz, resonance_hz = expected.antiresonance_hz, expected.resonance_hz
    if not antiresonance_hz < resonance_hz:
        raise DataError(f"the model's antiresonance, {antiresonance_hz:.3g} Hz, is not below its resonance, {resonance_hz:.3g} Hz")
    band = (response.freq_hz >= BELOW * antiresonance_hz) & (response.freq_hz <= ABOVE * resonance_hz)
    band &= (response.noise <= LARGEST_NOISE * np.abs(response.h)) & (np.abs(response.h) > 0.0)
    count = int(np.sum(band))
    if count < FEWEST_LINES:
        raise DataError(
            f"{count} clear lines lie between {BELOW * antiresonance_hz:.3g} and {ABOVE * resonance_hz:.3g} Hz, {FEWEST_LINES} are needed; "
            "raise the amplitude or lengthen the period"
        )
    freq = response.freq_hz[band]
    h = response.h[band] * np.exp(1j * np.pi * freq * response.sample_period_s)  # a torque held for a period acts half of it later
    for pair in beside:
        h = h / pair.response(freq)
    middle = math.sqrt(freq[0] * freq[-1])

    def flexible(x: Array) -> ComplexArray:
        f_z, f_r = np.exp(x[:2])
        return Pair(f_z, f_r, (x[2], x[3])).response(freq)

    def residual(x: Array) -> Array:
        left = h / (flexible(x) * np.exp(x[4] + 1j * x[5]) * (freq / middle) ** x[6])
        return np.concatenate([np.log(np.abs(left)), np.angle(left)])

    start = np.array([math.log(antiresonance_hz), math.log(resonance_hz), 0.1, 0.1, 0.0, 0.0, -2.0])
    rest = h / flexible(start) * (freq / middle) ** 2
    start[4], start[5] = np.median(np.log(np.abs(rest))), np.angle(np.mean(rest / np.abs(rest)))
    wide = math.log(FARTHEST)
    low = np.array([start[0] - wide, start[1] - wide, 1e-4, 1e-4, -np.inf, -np.inf, -6.0])
    high = np.array([start[0] + wide, start[1] + wide, MOST_DAMPING, MOST_DAMPING, np.inf, np.inf, 2.0])
    found = least_squares(residual, start, bounds=(low, high), loss="soft_l1", f_scale=0.3)
    freedom = 2 * count - len(start)
    variance = float(np.sum(residual(found.x) ** 2)) / freedom
    jacobian = np.asarray(found.jac, dtype=np.float64)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * variance
    half = float(stdtrit(freedom, 0.975)) * np.sqrt(np.diag(covariance))

    def landmark(i: int) -> Landmark | None:
        at_bound = min(found.x[i] - low[i], high[i] - found.x[i]) < 1e-3 or found.x[2 + i] > 0.99 * MOST_DAMPING
        value = math.exp(found.x[i])
        return None if at_bound or half[i] > LOST else Landmark(value, float(value * half[i]), float(found.x[2 + i]))

    return Landmarks(landmark(0), landmark(1), math.sqrt(variance))
