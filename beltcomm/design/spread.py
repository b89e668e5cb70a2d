"""Spread of the margins by what is not known exactly: every closed loop of every draw of the parameters, all at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from beltcomm.arrays import Array, BoolArray, ComplexArray, IntArray
from beltcomm.control import Cascade, pi_response, prefilter_response, velocity_filter_response
from beltcomm.design.design_plant import DesignPlant, sample_plants
from beltcomm.design.loops import closed_loop_matrix, frequencies
from beltcomm.design.margins import margins
from beltcomm.errors import UsageError

#: Base points of the frequency grid per plant: neighbours 9 % apart, and finer around ω_r and ω_z; a margin is off by 0.2 deg or dB.
GRID_POINTS = 100
#: Share of draws that are worse than what is called the worst.
WORST_SHARE = 0.025


@dataclass(frozen=True)
class MarginSpread:
    """Of every draw the smallest margin over its plants, (draws,): velocity loop, position loop, both.

    phase_margin_deg, position_phase_margin_deg, gain_margin_db, sensitivity_db (the largest).

    Attributes
    ----------
    plants : int
        Per draw.
    unstable : int
        Closed loops with a pole on or outside the unit circle, of draws × plants.
    worst_values : dict of str to float
        What 97.5 % of the draws exceed, and the sensitivity that they stay below, on the grid of a proof.
    worst : DesignPlant
        Plant of that sensitivity; ``worst_at`` its number in its draw.
    """

    phase_margin_deg: Array
    position_phase_margin_deg: Array
    gain_margin_db: Array
    sensitivity_db: Array
    plants: int
    unstable: int
    worst_values: dict[str, float]
    worst: DesignPlant
    worst_at: int

    @property
    def draws(self) -> int:
        """Number of sets of parameters."""
        return len(self.sensitivity_db)


def margin_spread(draws: Sequence[Sequence[DesignPlant]], cascade: Cascade, period_s: float) -> MarginSpread:
    """Margins and stability of a cascade on every plant of every draw.

    Parameters
    ----------
    draws : sequence of sequence of DesignPlant
        Equally many plants each, equally many bodies.
    cascade : Cascade
    period_s : float
        Of the drive's loops.

    Raises
    ------
    UsageError
        Without plants.
    """
    plants = [plant for draw in draws for plant in draw]
    if not plants or len({len(draw) for draw in draws}) != 1:
        raise UsageError("margins spread over draws with equally many plants each, at least one")
    advance, new, old, whole = sample_plants(plants, period_s)
    omega = frequencies(plants, period_s, GRID_POINTS)
    response = _responses_together(advance, new, old, whole, omega, period_s)
    estimator = velocity_filter_response(omega, cascade.velocity_filter_s, period_s)
    controller = prefilter_response(omega, cascade.prefilter, period_s) * pi_response(
        omega, cascade.kp_nm_s_rad, cascade.ki_nm_rad, period_s
    )
    velocity = controller * response * estimator
    position = cascade.kpp_1_s * velocity / ((1.0 + velocity) * estimator)
    nearest = np.minimum(np.min(np.abs(1.0 + velocity), axis=1), np.min(np.abs(1.0 + position), axis=1))
    stable = _stable(advance, new, old, whole, cascade, period_s)
    gains = np.minimum(_gain_margins_db(velocity), _gain_margins_db(position))
    # By plant of each draw; the sensitivity negative, so that the least is the worst of all four.
    found = {
        "phase_margin_deg": _smallest_phase_margins_deg(velocity),
        "position_phase_margin_deg": _smallest_phase_margins_deg(position),
        "gain_margin_db": gains,
        "sensitivity_db": 20.0 * np.log10(nearest),
    }
    by_draw = {name: every.reshape(len(draws), -1) for name, every in found.items()}
    # The draw is found on the coarse grid; the number printed is that of a proof.
    worst: dict[str, float] = {}
    for name, table in by_draw.items():
        at = int(np.argsort(table.min(axis=1), kind="stable")[math.floor(WORST_SHARE * (len(draws) - 1))])
        plant = int(np.argmin(table[at]))
        (one,) = margins(cascade, [draws[at][plant]], period_s)
        both = {
            "gain_margin_db": one.least_gain_margin_db,
            "sensitivity_db": one.most_sensitivity_db,
        }
        worst[name] = both[name] if name in both else float(getattr(one, name))
    least = {name: table.min(axis=1) for name, table in by_draw.items()}
    stable = _stable(advance, new, old, whole, cascade, period_s)
    return MarginSpread(
        least["phase_margin_deg"],
        least["position_phase_margin_deg"],
        least["gain_margin_db"],
        -least["sensitivity_db"],
        len(draws[0]),
        int(np.sum(~stable)),
        worst,
        draws[at][plant],  # of the sensitivity, which was the last
        plant,
    )


def _responses_together(advance: Array, new: Array, old: Array, whole: IntArray, omega_rad_s: Array, period_s: float) -> ComplexArray:
    """Sampled responses of p plants at once, (p, k), rad/(N m), as :meth:`DesignPlant.sampled_response` of each at (p, k) frequencies up to
    π/T.

    G(z) = N(z)/Π(z - λ_i) z^(-n-1),  λ the eigenvalues of Φ;  N, of degree n, from its values on the circle |z| = 2.

    Plants as :func:`beltcomm.design.design_plant.sample_plants` gives them.
    """
    n = advance.shape[-1]
    poles = np.linalg.eigvals(advance)
    points = 2.0 * np.exp(2j * np.pi * np.arange(n + 1) / (n + 1))
    states = np.linalg.solve(
        points[:, None, None, None] * np.eye(n) - advance, (points[:, None, None] * new + old).astype(np.complex128)[..., None]
    )
    values = states[..., 0, 0] * np.prod(points[:, None, None] - poles, axis=-1)
    numerator = np.fft.fft(values, axis=0) / (n + 1) / 2.0 ** np.arange(n + 1)[:, None]
    z = np.exp(1j * omega_rad_s * period_s)
    top = np.zeros_like(z)
    for coefficient in numerator[::-1]:
        top = top * z + coefficient[:, None]
    for i in range(n):
        top /= z - poles[:, i, None]
    return np.asarray(top * z ** -(whole[:, None] + 1.0))


def _smallest_phase_margins_deg(loop: ComplexArray) -> Array:
    """Phase margin of every row of open loops over rising frequencies, (p,), as ``margins.phase_margin``; inf where none crosses over."""
    level = np.log(np.maximum(np.abs(loop), 1e-300))
    row, at = np.nonzero((level[:, :-1] > 0.0) != (level[:, 1:] > 0.0))
    share = level[row, at] / (level[row, at] - level[row, at + 1])
    angle = np.angle(-loop[row, at]) + share * np.angle(loop[row, at + 1] / loop[row, at])
    found = np.full(len(loop), math.inf)
    np.minimum.at(found, row, np.degrees(np.abs((angle + math.pi) % (2.0 * math.pi) - math.pi)))
    return found


def _gain_margins_db(loop: ComplexArray) -> Array:
    """``margins.gain_margin_db`` of every row, (p,)."""
    left = (loop.real[:, :-1] < 0.0) & (loop.real[:, 1:] < 0.0)
    row, at = np.nonzero(left & ((loop.imag[:, :-1] > 0.0) != (loop.imag[:, 1:] > 0.0)))
    share = loop.imag[row, at] / (loop.imag[row, at] - loop.imag[row, at + 1])
    crossing = np.abs(loop.real[row, at] + share * (loop.real[row, at + 1] - loop.real[row, at]))
    largest = np.full(len(loop), 1e-300)
    inside = crossing < 1.0
    np.maximum.at(largest, row[inside], crossing[inside])
    return np.where(largest > 1e-300, -20.0 * np.log10(largest), math.inf)


def _stable(advance: Array, new: Array, old: Array, whole: IntArray, cascade: Cascade, period_s: float) -> BoolArray:
    """True where cascade and velocity loop have all poles inside the unit circle, (p,) bool; the velocity loop's free angle aside."""
    found = np.zeros(len(advance), dtype=bool)
    for delay in np.unique(whole):
        k = np.flatnonzero(whole == delay)
        outer = np.linalg.eigvals(closed_loop_matrix(advance[k], new[k], old[k], int(delay), cascade, period_s))
        inner = np.linalg.eigvals(closed_loop_matrix(advance[k], new[k], old[k], int(delay), replace(cascade, kpp_1_s=0.0), period_s))
        free = np.argmin(np.abs(inner - 1.0), axis=1)
        inner[np.arange(len(k)), free] = 0.0
        found[k] = (np.max(np.abs(outer), axis=1) < 1.0) & (np.max(np.abs(inner), axis=1) < 1.0)
    return found
