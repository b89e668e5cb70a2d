"""Path of a record's noises to the residual of a model: the encoder's rounding through inertia and belt, the torque's own.

With x the displacements and speeds of the bodies behind the motor, q the rounding and w the torque's noise,

    x[n+1] = Φ x[n] + Γ (c[n-1], c[n], c[n+1], c[n+2]),
    e[n] = <load(x, c)>[n] + J (q[n+1] - 2 q[n] + q[n-1])/T² - (w[n-1] + w[n])/2,

linearised around sliding.  Between the samples the angle is a cubic spline (``beltcomm.simulate.inverse``), so q is one, too:

    q(t) = Σ c[k] B(t/T - k),    q[n] = (c[n-1] + 4 c[n] + c[n+1])/6.

q white of variance σ², c has the spectrum σ² 36/(4 + 2 cos ωT)², that of the causal

    c[n+2] = -2 a c[n+1] - a² c[n] + 6 a ε[n],    a = 2 - √3,  ε white of variance σ².

(A q linear between the samples makes the load of a stiff belt, and with it what rounding adds, a fifth smaller near half the sampling
rate.)  Lags of the reading smooth what q does, delays of the acting torque what w does.
Source: Unser, Splines, IEEE Signal Processing Magazine 16 (1999), for B and the poles.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from beltcomm.arrays import Array, ComplexArray, IntArray
from beltcomm.model import Model
from beltcomm.model.linear import Matrices, carriage_of, matrices, operating_point, stretch_of, values_of

#: What makes the covariance at the first sample.
MOTION, ROUNDING, SLOW, TORQUE = range(4)
#: Of c[n-1], c[n], c[n+1], c[n+2] between two samples: the angle and its first three rates per sample at the first of them.
SPLINE = np.array([[1.0, 4.0, 1.0, 0.0], [-3.0, 0.0, 3.0, 0.0], [6.0, -12.0, 6.0, 0.0], [-6.0, 18.0, -18.0, 6.0]]) / 6.0
#: c[n+2] of c[n] and c[n+1], and of ε[n]; covariance of three c in a row in units of the variance of ε.
POLE = 2.0 - math.sqrt(3.0)
FURTHER, NEW = np.array([-(POLE**2), -2.0 * POLE]), 6.0 * POLE
TOGETHER = 2.0 * math.sqrt(3.0) * np.array([1.0, -0.5, POLE - POLE**2])[np.abs(np.subtract.outer(range(3), range(3)))]
#: Relative change of the stiffness within a level: at its ends 2 % are left out of account, half a Hz of an antiresonance at 50 Hz.
LEVEL = 0.04
#: Places on a way at which the stiffness is worked out, and at which it is looked up.
PLACES, FINE_PLACES = 25, 601
#: Share of a period and s below which torque acts when it is reported.
LEAST_PART, LEAST_LAG_S = 1e-6, 1e-9
#: Terms of Taylor's series for a norm below one half: 0.5^15/15! is below the machine precision.
TERMS = 14
#: Frequencies around the circle, and z at those of its upper half, its ends left out.
POINTS = 1024
AROUND = np.exp(2j * np.pi * np.arange(1, POINTS // 2) / POINTS)
#: Paths that are kept: the segments of a record set ask for the same one wherever nothing goes with the place.
KEPT = 512


@dataclass(frozen=True, eq=False)  # known by itself: one path is kept for each model
class NoisePath:
    """Path of the noises to the residual:  s[n+1] = F s[n] + G (ε[n], w[n]),   e[n] = H s[n] + D (ε[n], w[n]).

    s = (x[n], c[n-1], c[n], c[n+1], what x and c of the period before leave of e[n], w[n-1]).

    Attributes
    ----------
    F : ndarray (k, k)
        Zero in its last two columns.
    G : ndarray (k, 2)
    H : ndarray (k,)
    D : ndarray (2,)
    begins : ndarray (k, k, 4)
        Covariance of s at the first sample: by motion that the record does not show, and in units of the variances of a rounding that is
        white, of one that is slow, and of w. e in N m, c and ε in rad, both at the motor shaft, w in N m.
    sample_s : float, s
    """

    F: Array
    G: Array
    H: Array
    D: Array
    begins: Array
    sample_s: float

    @cached_property
    def transfer(self) -> ComplexArray:
        """From ε to e at :data:`AROUND`."""
        zeros = np.linalg.eigvals(self.F - np.outer(self.G[:, 0], self.H) / self.D[0])
        return np.asarray(self.D[0] * at_roots(zeros) / at_roots(np.linalg.eigvals(self.F)))


def at_roots(roots: NDArray[Any]) -> ComplexArray:
    """Π (1 - root/z) at :data:`AROUND`.

    Parameters
    ----------
    roots : ndarray (k,)
        Of a polynomial in 1/z.
    """
    return np.asarray(np.prod(1.0 - roots[:, None] / AROUND, axis=0))


@dataclass(frozen=True)
class NoiseSchedule:
    """Noise paths along the way of a segment.

    Attributes
    ----------
    paths : tuple of NoisePath
        Of all levels.
    level : ndarray (n,) of int
        Which of them holds at each sample.
    """

    paths: tuple[NoisePath, ...]
    level: IntArray


def noise_schedule(model: Model, places_m: Array, sample_s: float, left: Array | None = None) -> NoiseSchedule:
    """The paths at the places of the carriage, (n,), m: one in the middle of the way, several where the belt's stiffness changes on it
    and is known everywhere, or where a strand goes slack.

    Levels are even in the logarithm of the stiffness that holds the carriage, :data:`LEVEL` apart at most.

    Parameters
    ----------
    model : Model
    places_m : ndarray (n,), m
        Carriage on the axis.
    sample_s : float, s
    left : ndarray (n,) or None
        Share of the belt's stiffness at each sample; all of it without.
    """
    low, high = float(places_m.min()), float(places_m.max())
    at, stiffness = stiffness_levels(model, low, high)
    own, shares = np.interp(places_m, at, stiffness), np.ones(len(at))
    if left is not None:
        at, stiffness, shares = places_m, own + np.log(left), left
        own = stiffness
    if np.ptp(stiffness) < LEVEL:
        return NoiseSchedule((noise_path(model, 0.5 * (low + high), sample_s),), np.zeros(len(places_m), dtype=np.int64))
    number = math.ceil(np.ptp(stiffness) / LEVEL)
    edges = np.linspace(stiffness.min(), stiffness.max(), number + 1)
    shown = [np.argmin(np.abs(stiffness - 0.5 * (a + b))) for a, b in itertools.pairwise(edges)]
    paths = tuple(noise_path(model, float(at[i]), sample_s, float(shares[i])) for i in shown)
    return NoiseSchedule(paths, np.searchsorted(edges[1:-1], own))


def stiffness_levels(model: Model, low_m: float, high_m: float) -> tuple[Array, Array]:
    """Logarithm of :func:`_stiffness_to_ground` along the travel.

    Parameters
    ----------
    model : Model
        With or without a belt.
    low_m, high_m : float, m
        Ends of the way.

    Returns
    -------
    tuple of ndarray, (k,)
        Places, m, and ln there; one place and 0 where it hardly changes, or is not known everywhere.
    """
    ends, places, at = (np.linspace(low_m, high_m, number) for number in (3, PLACES, FINE_PLACES))
    rough = _stiffnesses(model, ends) if "cart" in model.base_bodies else None
    if rough is None or np.ptp(rough) < LEVEL or (known := _stiffnesses(model, places)) is None:
        return ends[1:2], np.zeros(1)
    return at, PchipInterpolator(places, known)(at)


def _stiffnesses(model: Model, places_m: Array) -> Array | None:
    """Logarithm of :func:`_stiffness_to_ground`, N/m, at places, (n,); None where a law, as a search has it, holds nothing at one."""
    try:
        found = np.array([_stiffness_to_ground(model, float(x)) for x in places_m])
    except ZeroDivisionError:
        return None
    return np.asarray(np.log(found)) if np.all(np.isfinite(found)) and found.min() > 0.0 else None


def _stiffness_to_ground(model: Model, position_m: float) -> float:
    """Stiffness of all that holds the carriage at a place while the other bodies stand, N/m."""
    total, cart = 0.0, carriage_of([body.name for _, body in model.bodies()])
    for effect in model.effect_list():
        if effect.elements:
            values = values_of(model, effect, position_m)
            total += sum(e.slope(position_m, *values)[0] * float(stretch_of(model, e)[cart]) ** 2 for e in effect.elements)
    return total


def noise_path(model: Model, position_m: float, sample_s: float, closed: float = 1.0) -> NoisePath:
    """The path of a model linearised with the carriage sliding at a place, m; ``sample_s`` : s.

    The load's triangular mean is exact for rounding linear between the samples:  ∫_0^1 u load du before and ∫_0^1 (1-u) load du after
    a sample, from the first and the second integral of the load.

    Parameters
    ----------
    model : Model
    position_m : float, m
        Carriage on the axis.
    sample_s : float, s
    closed : float
        See ``matrices``.
    """
    return path_of(model, matrices(model, operating_point(model, position_m, 1.0), closed=closed), sample_s)


def path_of(model: Model, linear: Matrices, sample_s: float) -> NoisePath:
    """Noise path of a model linearised already.

    Parameters
    ----------
    model : Model
        For its lags and dead time.
    linear : Matrices
        Of the model at a place.
    sample_s : float, s

    Returns
    -------
    NoisePath
        Of torque noise and rounding.
    """
    lags = [(e, model[f"{e.name}.time"]) for e in model.effect_list() if e.slot in ("torque_reading", "torque_delay")]
    reading = sum(time for e, time in lags if e.slot == "torque_reading")
    dead, lag = (sum(time for e, time in lags if e.name == name) for name in ("dead_time", "current_lag"))
    bodies = model.bodies()
    swings = tuple(body.swings for _, body in bodies)
    known = np.stack((linear.M, linear.D, linear.K)).tobytes()
    return _path(known, swings, model.driven_inertia(), sample_s, reading, dead, lag)


@lru_cache(maxsize=KEPT)
def _path(
    known: bytes, swings: tuple[float, ...], inertia: float, sample_s: float, reading_s: float, dead_s: float, lag_s: float
) -> NoisePath:
    mass, damping, stiffness = np.frombuffer(known).reshape(3, len(swings), len(swings))
    motor, behind = 0, np.arange(1, len(swings))
    n = 2 * len(behind)  # states; then the angle and its three rates, the load's integral and that one's integral
    inverse = np.diag(1.0 / np.diag(mass)[behind])
    a = np.zeros((n + 6, n + 6))
    a[: n // 2, n // 2 : n] = np.eye(n // 2)
    a[n // 2 : n, : n // 2] = -inverse @ stiffness[np.ix_(behind, behind)]
    a[n // 2 : n, n // 2 : n] = -inverse @ damping[np.ix_(behind, behind)]
    a[n // 2 : n, n] = -inverse @ stiffness[behind, motor]
    a[n // 2 : n, n + 1] = -inverse @ damping[behind, motor]
    a[n, n + 1] = a[n + 1, n + 2] = a[n + 2, n + 3] = 1.0
    a[n + 4, : n // 2], a[n + 4, n // 2 : n] = stiffness[motor, behind], damping[motor, behind]
    a[n + 4, n], a[n + 4, n + 1] = stiffness[motor, motor], damping[motor, motor]
    a[n + 5, n + 4] = 1.0
    moved = _exponential(a * sample_s)
    # from (x, angle and rates) to (x, c before, here, after, one further), of which the last one comes from those two before it and ε
    spline = moved[:, n : n + 4] @ (SPLINE / sample_s ** np.arange(4)[:, None])
    spline[:, 1:3] += spline[:, 3:] * FURTHER
    moved = np.concatenate([moved[:, :n], spline[:, :3], NEW * spline[:, 3:]], axis=1)
    first, second = moved[n + 4] / sample_s, moved[n + 5] / sample_s**2
    after, before = second, first - second
    g = inertia / (6.0 * sample_s**2)
    f, gain, h = np.zeros((n + 5, n + 5)), np.zeros((n + 5, 2)), np.zeros(n + 5)
    f[:n, : n + 3], gain[:n, 0] = moved[:n, : n + 3], moved[:n, n + 3]
    f[n, n + 1] = f[n + 1, n + 2] = 1.0
    f[n + 2, n + 1 : n + 3], gain[n + 2, 0] = FURTHER, NEW
    f[n + 3, : n + 3], gain[n + 3, 0] = before[: n + 3], before[n + 3]
    f[n + 3, n] += g
    gain[n + 4, 1] = 1.0
    h[: n + 3] = after[: n + 3]
    h[n : n + 3] += g * np.array([2.0, -6.0 + FURTHER[0], 2.0 + FURTHER[1]])
    h[n + 3], h[n + 4] = 1.0, -0.5
    begins, splined = np.zeros((n + 5, n + 5, 4)), slice(n, n + 3)
    begins[splined, splined, ROUNDING], begins[splined, splined, SLOW], begins[n + 4, n + 4, TORQUE] = TOGETHER, 1.0, 1.0
    for i in behind:
        begins[i - 1, i - 1, MOTION] = swings[i] ** 2
        # Free in a gap, a force that goes with the place may push it away from where it is.
        begins[n // 2 + i - 1, n // 2 + i - 1, MOTION] = swings[i] ** 2 * max(stiffness[i, i], 0.0) / mass[i, i]
    path = NoisePath(f, gain, h, np.array([after[n + 3] + NEW * g, -0.5]), begins, sample_s)
    return _with_dead_time(_read_late(path, reading_s), dead_s, lag_s)


def _read_late(path: NoisePath, time_s: float) -> NoisePath:
    """The path where the torque is read behind a lag: rounding reaches the residual smoothed, noise of the torque as before.

    y[n] = a y[n-1] + b e[n-1] + c e[n]  with  e = h s + d q,  one more state z[n] = a y[n-1] + b e[n-1]:
    z[n+1] = a z[n] + (a c + b) e[n],   y[n] = z[n] + c e[n]      (straight between the samples, as ``measurement_lag``)

    ``path`` is the one without that lag, and comes back as it is for hardly any.
    """
    if time_s < LEAST_LAG_S:
        return path
    size = len(path.H)
    decay = np.exp(-path.sample_s / time_s)
    share = (1.0 - decay) * time_s / path.sample_s
    c, b = 1.0 - share, share - decay
    needed, torque = path.H.copy(), size - 1  # the torque's own noise, the last state, is read as it is
    needed[torque] = 0.0
    # One state that is always 0 keeps the last two columns empty.
    old, place = np.r_[:torque, torque], np.r_[1 : torque + 1, size + 1]
    f, gain, h = np.zeros((size + 2, size + 2)), np.zeros((size + 2, 2)), np.zeros(size + 2)
    f[np.ix_(place, place)], gain[place] = path.F[np.ix_(old, old)], path.G[old]
    begins = np.zeros((size + 2, size + 2, path.begins.shape[2]))
    begins[np.ix_(place, place)] = path.begins[np.ix_(old, old)]
    f[0, 0], gain[0, 0] = decay, (decay * c + b) * path.D[0]
    f[0, place] = (decay * c + b) * needed[old]
    h[0], h[place] = 1.0, c * needed[old]
    h[size + 1] = path.H[torque]
    return NoisePath(f, gain, h, np.array([c * path.D[0], path.D[1]]), begins, path.sample_s)


def _with_dead_time(path: NoisePath, dead_s: float, lag_s: float) -> NoisePath:
    """The path where the reported torque acts ``dead_s`` later, behind a lag ``lag_s``: its noise is smoothed, rounding as before.

    The noise w[n] of a period acts from its share f = dead_s/T - floor(dead_s/T) on; whole periods make no other noise.  With y what acts,
    lag_s y' = w - y, the residual has the mean of y with the triangular weight:  e[n] = … - ∫_0^1 u y[n-1+u] du - ∫_0^1 (1-u) y[n+u] du.
    Two more states, y[n] and w[n-1]; the last one is what the period before leaves of e[n].

    ``path`` comes back as it is for hardly any of both.
    """
    part = dead_s / path.sample_s - math.floor(dead_s / path.sample_s)
    if part < LEAST_PART and lag_s < LEAST_LAG_S:
        return path
    moved = np.eye(5)  # of (y, w[n-1], w[n], first, second integral of what acts)
    for source, share in ((1, part), (2, 1.0 - part)):
        a = np.zeros((5, 5))
        a[4, 3] = 1.0
        if lag_s < LEAST_LAG_S:
            a[3, source] = 1.0
        else:
            a[0, 0], a[0, source], a[3, 0] = -path.sample_s / lag_s, path.sample_s / lag_s, 1.0
        moved = _exponential(a * share) @ moved
    falling = moved[4]
    rising = moved[3] - falling
    size, own = len(path.H), len(path.H) - 1
    f, gain, h = np.zeros((size + 2, size + 2)), np.zeros((size + 2, 2)), np.zeros(size + 2)
    f[2 : own + 2, 2 : own + 2], gain[2 : own + 2], h[2 : own + 2] = path.F[:own, :own], path.G[:own], path.H[:own]
    f[0, :2], gain[0, 1] = moved[0, :2], moved[0, 2]
    gain[1, 1] = 1.0
    f[-1, :2], gain[-1, 1] = -rising[:2], -rising[2]
    h[:2], h[-1] = -falling[:2], 1.0
    begins = np.zeros((size + 2, size + 2, path.begins.shape[2]))
    begins[2:, 2:], begins[[0, 1], [0, 1]] = path.begins, path.begins[-1, -1]
    return NoisePath(f, gain, h, np.array([path.D[0], -falling[2]]), begins, path.sample_s)


def _exponential(a: Array) -> Array:
    """Exponential e^a of a small matrix: scaling, Taylor's series, squaring.

    Not scipy's ``expm``: its linear algebra runs in threads, which on a busy machine wait for each other, 20 ms instead of 0.04 ms.

    Moler, Van Loan, SIAM Review 45 (2003), method 3.
    """
    squarings = max(0, math.ceil(math.log2(max(float(np.abs(a).sum(axis=1).max()), 1e-300))) + 1)
    a = a / 2.0**squarings
    result = term = np.eye(len(a))
    for k in range(1, TERMS + 1):
        term = term @ a / k
        result = result + term
    for _ in range(squarings):
        result = result @ result
    return result
