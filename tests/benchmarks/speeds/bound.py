"""The Cramér-Rao bound of a record: how small the standard deviations of estimated parameters can be at best.

The measured torque has white noise w and nobody is told the acting one; the counted angle has the rounding q of a count as white noise:

    x[k+1] = f(x[k], τ_measured[k] - w[k], p),    y[k] = x₁[k] + q[k].

Linearised along the motion without noise, by central differences of one sampling period each:   Φ = ∂f/∂x,  Γ = ∂f/∂τ,  g = ∂f/∂p.
Friction that turns or holds within a period is in Φ and Γ too: what w or p do to a motor is gone once it has stuck.

    F = Σ e eᵀ / S,    e[k] = first row of d[k],    d[k+1] = Φ (d[k] - K e[k]ᵀ) + g,    K, S of the Kalman filter of w and q, begun at rest;

the bound of a standard deviation is  sqrt((F⁻¹)_ii),  all parameters of the model free.   Source: Ljung, System Identification, 2nd ed.,
sections 7.2 and 7.4.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from beltcomm.excitation import Excitation
from beltcomm.model import Model
from beltcomm.simulate.forward import BodyStates, at_rest, simulate_torque
from beltcomm.thesis.excitations import COUNTS, NOISE_NM, PERIOD_S, PLACE_M

Array = NDArray[np.float64]
#: Steps of the differences: rad or m, rad/s or m/s, N m, share of a parameter.
POSITION, SPEED, TORQUE_NM, SHARE = 1e-7, 1e-5, 1e-4, 1e-4


def bound(model: Model, signal: Excitation, names: Sequence[str]) -> Mapping[str, float]:
    """Least relative standard deviation of each parameter in ``names``."""
    white = innovations(*linearised(model, signal, names), NOISE_NM, 2.0 * math.pi / COUNTS)
    return dict(zip(names, np.sqrt(np.diag(np.linalg.inv(white.T @ white))).tolist(), strict=True))


def linearised(model: Model, signal: Excitation, names: Sequence[str]) -> tuple[Array, Array, Array]:
    """Φ (n, s, s), Γ (n, s) and g (n, s, k) along the motion under the signal; g for relative changes."""
    start = at_rest(model, PLACE_M)
    x, bodies = np.concatenate([start.positions, start.speeds]), len(start.speeds)
    assert len(start.positions) == bodies, "elastic friction has states of its own"

    def moved(by: Model, x: Array, torque_nm: float) -> Array:
        end = simulate_torque(by, np.array([torque_nm]), PERIOD_S, state=BodyStates(x[:bodies].copy(), x[bodies:].copy())).end
        return np.concatenate([end.positions, end.speeds])

    def slope(f: Callable[[float], Array], step: float) -> Array:
        return (f(step) - f(-step)) / (2.0 * step)

    changed = {(n, s): model.with_values({n: (1.0 + s) * model[n]}) for n in names for s in (SHARE, -SHARE)}
    axes = [(way, POSITION if i < bodies else SPEED) for i, way in enumerate(np.eye(2 * bodies))]
    Phi, Gamma, g = [], [], []
    for torque in signal.torque.tolist():
        Phi.append(np.column_stack([slope(lambda h, x=x, way=way, u=torque: moved(model, x + h * way, u), step) for way, step in axes]))
        Gamma.append(slope(lambda h, x=x, u=torque: moved(model, x, u + h), TORQUE_NM))
        g.append(np.column_stack([slope(lambda h, x=x, n=n, u=torque: moved(changed[n, h], x, u), SHARE) for n in names]))
        x = moved(model, x, torque)
    return np.array(Phi), np.array(Gamma), np.array(g)


def innovations(Phi: Array, Gamma: Array, g: Array, noise_nm: float, count_rad: float) -> Array:
    """e/sqrt(S) of the module's head, (n, k)."""
    K, S = gains(Phi, Gamma, noise_nm, count_rad)
    d = np.zeros(g.shape[1:])
    white = np.empty((len(g), g.shape[2]))
    for k in range(len(g)):
        white[k] = d[0] / math.sqrt(S[k])
        d = Phi[k] @ (d - np.outer(K[k], d[0])) + g[k]
    return white


def gains(Phi: Array, Gamma: Array, noise_nm: float, count_rad: float) -> tuple[Array, Array]:
    """K (n, s) and S (n,) of the module's head; S in rad²."""
    P, rounding = np.zeros(Phi.shape[1:]), count_rad**2 / 12.0
    K, S = np.empty(Gamma.shape), np.empty(len(Phi))
    for k in range(len(Phi)):
        S[k] = P[0, 0] + rounding
        K[k] = P[:, 0] / S[k]
        P = Phi[k] @ (P - np.outer(K[k], P[0])) @ Phi[k].T + noise_nm**2 * np.outer(Gamma[k], Gamma[k])
    return K, S
