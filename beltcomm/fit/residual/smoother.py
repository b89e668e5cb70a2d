"""The likeliest motion of a motor whose angle is coarsely rounded: what friction acts against, where the encoder's steps hide it.

    x[k+1] = F x[k] + G (u[k] + w[k]) + friction,   z[k] = motor angle + q[k],   var q = step²/12

x : coordinates and speeds of all bodies, friction against the speeds of the motion found before.   Kalman filter forwards and Rauch's
smoother backwards, both with the gains of the steady state.

Source: Rauch, Tung, Striebel, Maximum likelihood estimates of linear dynamic systems, AIAA Journal 3 (1965).
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import LinAlgError, LinAlgWarning, expm, solve_discrete_are, solve_discrete_lyapunov

from beltcomm.arrays import Array
from beltcomm.compiled import compiled
from beltcomm.errors import Refused
from beltcomm.model import Model
from beltcomm.model.linear import matrices, operating_point
from beltcomm.simulate.inverse import FineMotion

#: Share of the torque's rms by which the model is off at least, first and once friction's direction is known.
SHARES = (0.3, 0.05, 0.05)
#: Noise of a speed over that of the motor's, so that every state is reached by some: share of the step a sample.
LEAST = 1e-6


@dataclass(frozen=True)
class Smoothed:
    """Motor angle, rad, and speed, rad/s, on the fine grid, (fine,) each, and what the speed is off by, one deviation, rad/s."""

    theta: Array
    omega: Array
    off_rad_s: float


def smooth_motion(model: Model, motion: FineMotion, torque: Array, step_rad: float, noise_nm: float) -> Smoothed | None:
    """The likeliest motion of the motor; None where no filter settles on the model.

    Parameters
    ----------
    model : Model
        Near enough to say how the motor moves between two steps of the encoder.
    motion : FineMotion
        As measured, (n samples).
    torque : ndarray (n,)
        That acts, mean over each period, N m at the motor.
    step_rad : float
        Of the encoder, rad at the motor.
    noise_nm : float
        Of the torque, N m rms.

    Returns
    -------
    Smoothed or None
    """
    shown, sample = motion.theta[:: motion.substeps], motion.sample_s
    point = operating_point(model, 0.5 * float(shown.min() + shown.max()) * model["transmission.ratio"], 1.0)
    try:
        linear = matrices(model, point)
    except Refused:
        return None
    n, inverse = len(linear.M), np.linalg.inv(linear.M)
    A, B = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, n))
    A[:n, n:], A[n:, :n], A[n:, n:], B[n:] = np.eye(n), -inverse @ linear.K, -inverse @ linear.D, inverse
    block = expm(np.block([[A, B], [np.zeros((n, 3 * n))]]) * sample)
    # In units in which all bodies are as heavy, and the sample lasts 1: the filter's equations are well conditioned there.
    own = np.sqrt(linear.M[0, 0] / np.diag(linear.M))
    units = np.concatenate((own, own / sample))
    F, each = block[: 2 * n, : 2 * n] * units / units[:, None], block[: 2 * n, 2 * n :] / units[:, None]
    G = each @ linear.input
    levels = np.array([model.get("coulomb.level") if i == 0 else 0.0 for i in range(n)])
    if "cart" in linear.bodies:
        levels[linear.bodies.index("cart")] = model.get("cart_friction.level")
    H, r = np.eye(2 * n)[0], step_rad**2 / 12.0
    speeds = np.zeros((len(shown), n))
    x, off = np.zeros((len(shown), 2 * n)), math.inf
    for share in SHARES:
        loads = max(share * float(np.std(torque)), noise_nm)
        Q = loads**2 * np.outer(G, G) + np.diag(np.diag(F @ F.T)) * (LEAST * step_rad) ** 2
        try:
            with warnings.catch_warnings():  # what is ill-conditioned shows in the motion, which is looked at below
                warnings.simplefilter("ignore", LinAlgWarning)
                P = solve_discrete_are(F.T, H[:, None], Q, np.array([[r]]))
                gain = P @ H / (P[0, 0] + r)
                after = P - np.outer(gain, P[0])
                back = after @ F.T @ np.linalg.inv(P)
                rest = solve_discrete_lyapunov(back, after - back @ P @ back.T)
            off = math.sqrt(max(float(rest[n, n]), 0.0)) / sample
        except (LinAlgError, ValueError):
            return None
        push = torque[:, None] * G - (_direction(speeds) * levels) @ each.T
        x = _smooth_states(np.ascontiguousarray(F), np.ascontiguousarray(push), gain, np.ascontiguousarray(back), shown - shown[0])
        if not np.all(np.isfinite(x)):
            return None
        speeds = x[:, n:] * units[n:]
    numbers = np.arange(len(shown))
    spline = CubicHermiteSpline(numbers, x[:, 0] + shown[0], speeds[:, 0] * sample)
    place = np.arange(len(motion.theta)) / motion.substeps
    return Smoothed(spline(place), spline(place, 1) / sample, off)


def _direction(speeds: Array) -> Array:
    """Mean direction over the period from each sample to the next, of speeds that change evenly, (n, k); 0 of none at all."""
    ahead = np.vstack((speeds[1:], speeds[-1:]))
    size = np.abs(speeds) + np.abs(ahead)
    biggest = np.maximum(np.abs(speeds), np.abs(ahead))
    return np.asarray((speeds * np.abs(speeds) + ahead * np.abs(ahead)) / np.maximum(size * biggest, 1e-300))


@compiled
def _smooth_states(F: Array, push: Array, gain: Array, back: Array, shown: Array) -> Array:
    """States from angles, (n,), with constant gains, forwards and backwards; (n, states)."""
    n, size = push.shape
    found, ahead = np.zeros((n, size)), np.zeros((n, size))
    for k in range(n):
        if k:
            ahead[k] = F @ found[k - 1] + push[k - 1]
        found[k] = ahead[k] + gain * (shown[k] - ahead[k, 0])
    for k in range(n - 2, -1, -1):
        found[k] += back @ (found[k + 1] - ahead[k + 1])
    return found
