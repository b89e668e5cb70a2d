"""Projected score test: how far would the error fall if one more effect were there, judged without refitting anything.

At the fitted model, A is the Jacobian of the whitened residual r with respect to everything that was fitted.  An effect switched on at a
typical size changes the residual by the column c; what A could do as well is taken out, c⊥ = c - A (AᵀA)⁻¹ Aᵀ c.  The drop of the
objective is (c⊥ᵀ r)²/(c⊥ᵀ c⊥), several columns together as usual.  Finite changes and not derivatives: right for gap and slack, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from beltcomm.effects import Effect, Ground, Trial
from beltcomm.identify.problem import OFFSET_M, Parts, Problem
from beltcomm.identify.residual import Stretch, in_noise
from beltcomm.laboratory.fitting import Fitted
from beltcomm.laboratory.harmonics import gain_means, load_means
from beltcomm.model import Model, on_side
from beltcomm.simulate.inverse import acting_torque, acts_on_motor, load_of, part_of_load, true_motion

Array = NDArray[np.float64]

#: A column that the base model can imitate to this share says nothing about the effect.
IMITATED = 1e-4


@dataclass(frozen=True)
class Scored:
    """One way to switch an effect on, and what it promises.

    drop : of the objective, first order.   share : of the drop that is left when it is measured by the best amplitude.
    values : own parameters with the amplitudes that the score test wants, to start a refit from.
    """

    effect: Effect
    trial: Trial
    drop: float
    values: Mapping[str, float]


class Scorer:
    """The score test at one fitted model."""

    def __init__(self, fitted: Fitted) -> None:
        self.fitted = fitted
        self.problem: Problem = fitted.problem
        self.model: Model = fitted.model
        self.vector = fitted.problem.full(fitted.x)
        self.weights = fitted.problem.weights(fitted.residual)
        self.offsets = OFFSET_M * fitted.offsets if fitted.problem.movable else np.zeros(len(fitted.problem.pieces))
        self.parts: list[Parts] = [fitted.problem.balance(i, fitted.x, float(o)) for i, o in enumerate(self.offsets)]
        jacobian = fitted.problem.jacobian(fitted.x, fitted.residual) * self.weights[:, None]
        norms = np.linalg.norm(jacobian, axis=0)
        self.basis = np.linalg.qr(jacobian[:, norms > 0.0] / norms[norms > 0.0])[0]
        rest = fitted.residual * self.weights
        self.rest = rest - self.basis @ (self.basis.T @ rest)

    def score(self, effect: Effect, ground: Ground) -> list[Scored]:
        """All trials of an effect that the model can take, best first."""
        if effect.trials is None:
            return []
        trials = [self.bounded(effect, trial) for trial in effect.trials(ground)]
        if effect.harmonic and len(trials) > 3:
            scored = self.harmonics(effect, trials)
        else:
            scored = [self.judged(effect, trial, [self.column(effect, v) for v in switched_on(effect, trial)]) for trial in trials]
        return sorted((s for s in scored if s.drop > 0.0), key=lambda s: -s.drop)

    def bounded(self, effect: Effect, trial: Trial) -> Trial:
        """The trial with its values inside the bounds of this model's side."""
        limits = self.model.parameters_of(effect)
        values = {}
        for name, value in trial.values.items():
            limit = limits.get(f"{effect.name}.{name}") or limits[name]
            values[name] = float(np.clip(value, limit.low, limit.high))
        return replace(trial, values=values)

    def harmonics(self, effect: Effect, trials: Sequence[Trial]) -> list[Scored]:
        """All orders of an effect that repeats with the motor angle."""
        key = effect.parameters[0].name
        wanted = {round(trial.values[key]): trial for trial in trials}
        highest = max(wanted)
        scans = [
            load_means(piece, highest) if effect.harmonic == "load" else gain_means(piece, piece.torque, highest)
            for piece in self.problem.pieces
        ]
        side = 1.0 if effect.harmonic == "load" else -1.0
        scored = []
        for order in range(1, highest + 1):
            means = [next(scan) for scan in scans]
            if order not in wanted:
                continue
            trial = wanted[order]
            columns = [
                np.concatenate(
                    [
                        in_noise(piece, self.model, self.vector, side * trial.values[name] * mean[k])
                        for piece, mean in zip(self.problem.pieces, means, strict=True)
                    ]
                )
                * self.weights
                for k, name in enumerate(("sine", "cosine"))
            ]
            scored.append(self.judged(effect, trial, columns))
        return scored

    def judged(self, effect: Effect, trial: Trial, steps: Sequence[Array]) -> Scored:
        """One trial by its columns."""
        columns = np.stack(steps, axis=1)
        sizes = np.linalg.norm(columns, axis=0)
        free = columns - self.basis @ (self.basis.T @ columns)
        usable = np.linalg.norm(free, axis=0) > IMITATED * np.maximum(sizes, 1e-300)
        if not usable.any():
            return Scored(effect, trial, 0.0, trial.values)
        solution = np.linalg.lstsq(free[:, usable], -self.rest, rcond=1e-10)[0]
        amounts = np.zeros(len(steps))
        amounts[usable] = solution
        if not trial.signed and not trial.amplitudes and amounts[0] <= 0.0:
            return Scored(effect, trial, 0.0, trial.values)
        explained = free @ amounts
        drop = float(-(explained @ self.rest) * 2.0 - explained @ explained)
        return Scored(effect, trial, drop, self.start_values(effect, trial, amounts))

    def start_values(self, effect: Effect, trial: Trial, amounts: Array) -> dict[str, float]:
        """Values of the effect with its amplitudes as the score test wants them, inside the bounds."""
        values = dict(trial.values)
        limits = {p.name: on_side(p, self.model.side) for p in effect.parameters}
        if trial.amplitudes:
            for name, amount in zip(trial.amplitudes, amounts, strict=True):
                values[name] = float(np.clip(values[name] * amount, limits[name].low, limits[name].high))
        elif trial.signed:
            first = effect.parameters[0]
            values[first.name] = float(np.clip(values[first.name] * np.clip(amounts[0], -3.0, 3.0), first.low, first.high))
        return values

    def column(self, effect: Effect, values: Mapping[str, float]) -> Array:
        """Change of the weighted residual of all pieces when the effect is switched on, (n,)."""
        extended = self.model.with_effect(effect.name, values)
        vector = extended.vector()
        out = [self.change(effect, extended, vector, i, piece) for i, piece in enumerate(self.problem.pieces)]
        return np.concatenate(out) * self.weights

    def change(self, effect: Effect, extended: Model, vector: Array, i: int, piece: Stretch) -> Array:
        """The same for one piece, not weighted."""
        old, offset = self.parts[i], float(self.offsets[i])
        if effect.slot == "sensor":
            problem = Problem([piece], extended, (), 1.0)
            new = problem.balance(0, np.zeros(1), offset)
            torque = (new.inertia + new.motor + new.belt - new.acting) - (old.inertia + old.motor + old.belt - old.acting)
            return in_noise(piece, self.model, self.vector, torque)
        motion = true_motion(self.model, piece.motion, self.vector)
        if acts_on_motor(effect) and effect.slot != "friction_onset":
            torque = load_of(extended, motion, vector, effect.name)
        elif acts_on_motor(effect):
            torque = part_of_load(extended, motion, vector, offset, "motor") - old.motor
        elif effect.slot in ("torque_path", "torque_delay"):
            torque = old.acting - acting_torque(extended, motion, piece.torque, vector)
        else:
            torque = part_of_load(extended, motion, vector, offset, "belt") - old.belt
        return in_noise(piece, self.model, self.vector, torque)


def switched_on(effect: Effect, trial: Trial) -> Iterator[dict[str, float]]:
    """Values of each column: the whole trial, or each of its amplitudes alone."""
    if not trial.amplitudes:
        yield dict(trial.values)
        return
    for name in trial.amplitudes:
        yield {key: (0.0 if key in trial.amplitudes and key != name else value) for key, value in trial.values.items()}


def ground_of(fitted: Fitted, pieces: Sequence[Stretch], teeth: int, offset_m: float, pulley_distance_m: float) -> Ground:
    """What the trials need to know of an axis."""
    model = fitted.model
    ratio = model["transmission.ratio"]
    places = np.concatenate([piece.motion.theta * ratio for piece in pieces])
    stiffness, mass = model.get("belt_stiffness.stiffness", 1e6), model.get("cart.mass", 1.0)
    pieces = [piece for piece in pieces if piece.motion.samples > 2]
    acceleration = max(float(np.percentile(np.abs(np.diff(p.position, 2)), 99.5)) / p.motion.sample_s**2 for p in pieces)
    return Ground(
        inertia=model["motor.inertia"],
        mass=mass,
        stiffness=stiffness,
        damping=model.get("belt_damping.damping"),
        coulomb=max(model.get("coulomb.level"), 1e-3),
        ratio=ratio,
        low_m=float(places.min()),
        high_m=float(places.max()),
        antiresonance_hz=float(np.sqrt(stiffness / mass) / (2.0 * np.pi)),
        teeth=teeth,
        peak_nm=max(float(np.abs(piece.torque).max()) for piece in pieces),
        peak_force_n=min(stiffness * 2e-3, max(1.0, mass * ratio * acceleration)),
        offset_m=offset_m,
        pulley_distance_m=pulley_distance_m,
    )
