"""Models from rows that come more seldom than the motor swings: the torque is known between them, the motion is not.

The axis is simulated under the torque that was asked for, which is held from row to row whatever lies between; its parameters p are those
with which the simulated motor goes from row to row as the recorded one did:

    r[n] = (theta[n+1] - theta[n]) - (theta_m[n+1] - theta_m[n]),     min  |r|²/s² + Σ ((ln p - ln p_0)/σ)²

Differences, for what friction does once is not to be carried to the end of the record.  s is the scatter that is left, so that the data
sheets p_0 count where rows say little.  Intervals: sandwich form over blocks of time, for what is left is not white.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from beltcomm.arrays import Array
from beltcomm.errors import DataError
from beltcomm.model import Model
from beltcomm.model.covariance import Covariance
from beltcomm.model.linear import fastest_rate, operating_point
from beltcomm.model.value import NORMAL_95
from beltcomm.recording import Recording
from beltcomm.simulate.forward import integrate_torque
from beltcomm.simulate.stopping import total_friction, total_viscous

#: How far each parameter may be from what is known before, standard deviation of its logarithm; others stay as they are.
BEFORE: Mapping[str, float] = {
    "motor.inertia": 0.05,
    "cart.mass": 10.0,
    "belt_stiffness.stiffness": 0.7,
    "belt_damping.damping": 1.0,
    "viscous.damping": 1.5,
    "coulomb.level": 1.5,
    "cart_friction.level": 1.5,
}
#: The same for what has a sign, in its unit.
SIGNED: Mapping[str, float] = {"constant_offset.torque": 0.1}
#: Friction where nothing is known of it before.
USUAL: Mapping[str, float] = {"coulomb.level": 0.05, "cart_friction.level": 2.0, "viscous.damping": 2e-3, "belt_damping.damping": 15.0}
#: Of them those that a first estimate looks for, from these carriages on, kg.
FIRST = ("cart.mass", "belt_stiffness.stiffness", "viscous.damping", "coulomb.level")
MASSES_KG = (1.0, 6.0, 30.0)
#: Eigenvalue times step of the simulation, in a search and at its end (a resonance is seen too fast by a 24th of its square); steps a
#: cell of held torque, longest cell, s; difference quotients, iterations at most.
STEP, FINE, SUBSTEPS, CELL_S, DIFFERENCE, MOST = 0.3, 0.1, 2, 2.5e-4, 1e-3, 25
#: Relative fall of the cost that ends a search: the last one begins beside its end.
ENOUGH: Mapping[float, float] = {STEP: 1e-5, FINE: 1e-4}
#: What no parameter differs from its first value by, as a factor; s, blocks of time that are taken as independent.
FARTHEST, BLOCK_S = math.log(1e3), 0.5
#: Dampings of the belt that are tried, over the one thought of before.
DAMPINGS = (1.0, 0.2, 3.0)
#: s: rows that come more seldom do not show how a motor swings on its belt.
SELDOM_S = 1.5e-3
#: Shares of the sampling rate: up to the first a resonance is sampled well enough, beyond it the motion between the samples is a guess
#: (1.03 times the noise at 0.18, 1.5 at 0.29); beyond the second no short record shows it.
SWING_SAMPLED, UNSEEN = 0.2, 0.35
#: Rows that must show a motion, and the steps of the encoder that are one.
FEWEST_ROWS, CLEAR_STEPS = 40, 20.0
#: What counts as nothing; rad a row, of a model that flies off; s, how far the torque's delay may be from what is thought of before.
LEAST, ABSURD_RAD, LATE_S = 1e-9, 1e3, 1e-3
#: Standard deviation of what is thought before of the lag in the torque path, none, over LATE_S.
LAG_WIDTH = 0.5
#: How well the laws can mean a machine, relative to each parameter: added to its interval.
LAW = 0.003
#: Share by which friction differs from pass to pass beyond what a pass itself shows, and the one that passes count with: rows that hide
#: how the motor swings mistake friction by more than they show, and what moves on is what a controller sends ahead for.
PASSES_DIFFER, PASSES_COUNT = 0.02, 0.002


def comes_seldom(recording: Recording, start: Model, share: float = UNSEEN) -> bool:
    """True if the rows of a record do not show how the motor swings between them, and it tells the torque that was asked for.

    Parameters
    ----------
    recording : Recording
        Of any kind.
    start : Model
        By the data sheets, whose resonance may be too fast for the rows.
    share : float
        Of the sampling rate, up to which it is not.

    Returns
    -------
    bool
        False in closed loop.
    """
    if recording.torque_setpoint is None or recording.sidecar.closed_loop:
        return False
    return recording.sample_period_s > min(SELDOM_S, share / max(_resonance_hz(start), LEAST))


def _resonance_hz(model: Model) -> float:
    """Frequency at which motor and carriage swing on one spring, Hz; 0 where nothing is known of that.

    w² = k (1/m + r²/J)
    """
    known = [name in model.parameters for name in ("belt_stiffness.stiffness", "cart.mass")]
    if not all(known):
        return 0.0
    mass_per_kg = 1.0 / model["cart.mass"] + model["transmission.ratio"] ** 2 / model["motor.inertia"]
    return math.sqrt(model["belt_stiffness.stiffness"] * mass_per_kg) / math.tau


def clearly_moves(recording: Recording, counts_per_rev: int) -> bool:
    """True if enough rows of a record show a motion.

    Parameters
    ----------
    recording : Recording
        Of any kind.
    counts_per_rev : int

    Returns
    -------
    bool
        By steps from row to row.
    """
    step = 2.0 * math.pi / counts_per_rev
    return int(np.sum(np.abs(np.diff(recording.position)) > CLEAR_STEPS * step)) >= FEWEST_ROWS


@dataclass(frozen=True, eq=False)
class SeldomEstimate:
    """A model whose simulated rows are most like the recorded ones.

    Attributes
    ----------
    names : tuple of str
        Of what was fitted.
    late_s, late_half_s : float
        Torque setpoint to acting torque, dead time and time constant of a lag together, s, and half their 95 % interval.
    left_nm : float
        Torque, N m rms, that would make what is left from row to row.
    samples : int
        How many rows.
    """

    model: Model
    names: tuple[str, ...]
    late_s: float
    late_half_s: float
    left_nm: float
    samples: int


class _OpenLoop:
    """One record in open loop."""

    def __init__(self, recording: Recording) -> None:
        assert recording.torque_setpoint is not None
        self._asked = recording.torque_setpoint
        self.sample_s = recording.sample_period_s
        self.measured = np.diff(recording.position)
        self._place_m = recording.sidecar.start_position_m or 0.0
        self._time_s = recording.sidecar.session_time_s or 0.0

    def left(self, model: Model, late_s: float, lag_s: float, step: float) -> Array:
        """From row to row, measured motion less simulated, rad, (n - 1,), with dead time and time constant from torque setpoint to acting
        torque.

        ``step``: fastest eigenvalue times step of the simulation, at most.
        """
        rate = fastest_rate(model, operating_point(model, self._place_m))
        cells = math.ceil(self.sample_s * max(rate / (step * SUBSTEPS), 1.0 / CELL_S))
        held = np.repeat(self._asked, cells)
        whole, share = divmod(max(late_s, 0.0) * cells / self.sample_s, 1.0)
        before = np.concatenate((np.full(int(whole) + 1, self._asked[0]), held))
        acting = (1.0 - share) * before[1 : len(held) + 1] + share * before[: len(held)]  # the mean over each cell
        if lag_s > 0.0:
            share = cells * lag_s / self.sample_s
            pole = math.exp(-1.0 / share)
            behind, _ = lfilter([1.0 - pole], [1.0, -pole], acting, zi=[pole * acting[0]])
            begun = np.append(acting[0], behind[:-1])
            acting = acting + share * (1.0 - pole) * (begun - acting)  # the mean over each cell
        moved = integrate_torque(model, acting, self.sample_s / cells, self._place_m, SUBSTEPS, self._time_s)
        rows = np.diff(moved.position_rad[::cells])
        return np.nan_to_num(self.measured - rows, nan=ABSURD_RAD, posinf=ABSURD_RAD, neginf=-ABSURD_RAD)


@dataclass(frozen=True, eq=False)
class SteadyPasses:
    """Passes at constant speed, motor side: friction that no row needs to be differentiated for.

    Attributes
    ----------
    speed_rad_s, torque_nm, error_nm : ndarray (n,)
        Means, and the standard deviation of that torque.
    """

    speed_rad_s: Array
    torque_nm: Array
    error_nm: Array

    def left(self, model: Model) -> Array:
        """Torque that the friction of a model leaves, over what it counts with:  (τ - τ_C sign ω - d ω - τ_0)/σ, (n,)."""
        friction = total_friction(model) * np.sign(self.speed_rad_s) + total_viscous(model) * self.speed_rad_s
        return np.asarray((self.torque_nm - friction - model.get("constant_offset.torque")) / self._apart(PASSES_COUNT))

    @property
    def scatter(self) -> Array:
        """Standard deviation of :meth:`left`, (n,)."""
        return self._apart(PASSES_DIFFER) / self._apart(PASSES_COUNT)

    def _apart(self, share: float) -> Array:
        return np.asarray(np.hypot(self.error_nm, share * np.abs(self.torque_nm)))


#: None.
NO_PASSES = SteadyPasses(*np.empty((3, 0)))


def estimate(
    recordings: Sequence[Recording],
    start: Model,
    late_s: float,
    names: Sequence[str] = tuple(BEFORE),
    passes: SteadyPasses = NO_PASSES,
) -> SeldomEstimate:
    """The parameters ``names`` of a model that begins at ``start``, but those that it holds, from records in open loop.

    Parameters
    ----------
    recordings : sequence of Recording
    start : Model
        Model that the search begins from.
    late_s : float
        Torque setpoint to acting torque, s, as thought of before.
    names : sequence of str
        Full names of the parameters.
    passes : SteadyPasses
        At constant speed, of which friction is known beside the rows.

    Raises
    ------
    DataError
        When no row moves.
    """
    start = start.with_values({n: usual for n, usual in USUAL.items() if n in start.parameters and start[n] < LEAST})
    names = tuple(n for n in (*names, *SIGNED) if n in start.parameters and start.parameters[n].low < start.parameters[n].high)
    logarithms = [n for n in names if n not in SIGNED]
    k = len(logarithms)
    names = (*logarithms, *names[k:])
    before = np.array([*(math.log(start[n]) for n in logarithms), *(start[n] / SIGNED[n] for n in names[k:]), late_s / LATE_S, 0.0])
    width = np.array([*(BEFORE[n] for n in logarithms), *(1.0 for _ in names[k:]), 1.0, LAG_WIDTH])
    rows = [_OpenLoop(recording) for recording in recordings]
    scatter = float(np.std(np.concatenate([one.measured for one in rows])))
    if scatter == 0.0:
        raise DataError("the motor does not move in these records; raise the excitation or look for a brake")

    def values_of(x: Array) -> Array:
        return np.append(np.exp(x[:k]), [SIGNED[n] * v for n, v in zip(names[k:], x[k:-2], strict=True)])

    def model_of(x: Array) -> Model:
        return start.with_values(dict(zip(names, map(float, values_of(x)), strict=True)), "final fit")

    def left(x: Array, step: float = FINE) -> Array:
        model = model_of(x)
        return np.concatenate([one.left(model, LATE_S * float(x[-2]), LATE_S * float(x[-1]), step) for one in rows])

    def beside(x: Array) -> Array:
        return np.append((x - before) / width, passes.left(model_of(x)))

    def cost(x: Array, scatter: float, step: float) -> Array:
        return np.append(left(x, step) / scatter, beside(x))

    # what the model allows, and in it room for a step of the differences
    least, most = np.array([(start.parameters[n].low, start.parameters[n].high) for n in names]).T
    least[:k], most[:k] = np.log(np.maximum(least[:k], LEAST)), np.log(most[:k])
    least[k:], most[k:] = (end[k:] / [SIGNED[n] for n in names[k:]] for end in (least, most))
    low = np.maximum(before - FARTHEST, np.append(least, [-math.inf, -DIFFERENCE]) + DIFFERENCE)
    high = np.minimum(before + FARTHEST, np.append(most, [math.inf, math.inf]) - 2.0 * DIFFERENCE)

    def searched(at: Array, by: float, step: float = STEP) -> tuple[Array, float]:
        """The best values where what is left scatters by so much, and how much that is; a first search says it for a second one."""
        at = np.clip(at, low + DIFFERENCE, high - DIFFERENCE)
        at = least_squares(cost, at, bounds=(low, high), diff_step=[DIFFERENCE], max_nfev=MOST, ftol=ENOUGH[step], args=(by, step)).x
        return at, max(float(np.sqrt(np.mean(left(at, step) ** 2))), LEAST)

    found = []
    for factor in DAMPINGS if "belt_damping.damping" in names else (1.0,):  # a swing that the rows hide may be damped as it likes
        at = before.copy()
        if factor != 1.0:
            at[names.index("belt_damping.damping")] += math.log(factor)
        found.append(searched(at, scatter))
    at, scatter = searched(min(found, key=lambda one: one[1])[0], min(by for _, by in found), FINE)
    rest = left(at)
    slopes, known = (
        np.stack([(of(at + DIFFERENCE * axis) - of(at)) / DIFFERENCE for axis in np.eye(len(at))], axis=1) for of in (left, beside)
    )
    scattered = np.append(np.ones(len(at)), passes.scatter)
    spread = _sandwich(rest, slopes, known, scattered, scatter, [(len(one.measured), one.sample_s) for one in rows])
    late_half_s, spread = NORMAL_95 * LATE_S * math.sqrt(spread[-2:, -2:].sum()), spread[:-2, :-2]
    model = model_of(at)
    scale = np.append(values_of(at)[:k], [SIGNED[n] for n in names[k:]])
    covariance = spread * np.outer(scale, scale) + np.diag((LAW / NORMAL_95 * values_of(at)) ** 2)
    half = NORMAL_95 * np.sqrt(np.diag(covariance))
    told = {n: replace(model.parameters[n], interval=float(h)) for n, h in zip(names, half, strict=True)}
    inertia = model["motor.inertia"] + model["transmission.ratio"] ** 2 * model["cart.mass"]
    parts = np.split(rest, np.cumsum([len(one.measured) for one in rows])[:-1])
    torque = np.concatenate([np.diff(part) * inertia / one.sample_s**2 for part, one in zip(parts, rows, strict=True)])
    return SeldomEstimate(
        replace(model, parameters={**model.parameters, **told}, covariance=Covariance(names, covariance, math.inf)),
        names,
        LATE_S * float(at[-2:].sum()),
        late_half_s,
        float(np.sqrt(np.mean(torque**2))),
        len(rest),
    )


def _sandwich(rest: Array, slopes: Array, known: Array, scattered: Array, scatter: float, records: Sequence[tuple[int, float]]) -> Array:
    """Covariance of the logarithms, (k, k):  A⁻¹ (Σ_b g_b g_bᵀ + KᵀSK) A⁻¹,  A = JᵀJ/s² + KᵀK,  g_b the gradient of a block, K the slopes
    of what is known beside the rows, S its variance."""
    inverse = np.linalg.inv(slopes.T @ slopes / scatter**2 + known.T @ known)
    gradients, first = [*(known * scattered[:, np.newaxis])], 0
    for count, sample_s in records:
        for block in np.array_split(np.arange(first, first + count), max(1, round(count * sample_s / BLOCK_S))):
            gradients.append(slopes[block].T @ rest[block] / scatter**2)
        first += count
    all_of_them = np.array(gradients)
    return np.asarray(inverse @ (all_of_them.T @ all_of_them) @ inverse)


def first_of_seldom(recordings: Sequence[Recording], start: Model) -> Model:
    """A first estimate of mass, stiffness and friction from short records, whatever carriage it is.

    Parameters
    ----------
    recordings : sequence of Recording
        Short, in open loop.
    start : Model
        By the data sheets.

    Returns
    -------
    Model
        The motor's inertia as it was.
    """
    mass = start.parameters["cart.mass"]
    masses = sorted({min(max(mass_kg, mass.low), mass.high) for mass_kg in (*MASSES_KG, mass.value)})
    tries = [estimate(recordings, start.with_values({"cart.mass": one}), LATE_S, FIRST) for one in masses]
    best = min(tries, key=lambda one: one.left_nm).model
    return start.with_values({name: best[name] for name in FIRST}, "first estimate")
