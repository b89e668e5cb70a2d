"""Recordings of truth machines as a drive's recorder would write them, made without a bus.

The machine is the independent simulator of ``tests/truth``, stepped at 1 kHz with a held torque; encoder counts, torque noise and
the delay of the torque loop are added here.  Rows are aligned as ``run-folder.md`` demands: ``torque[n]`` acts from t[n] to t[n+1].
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltcomm.excitation import prbs
from beltcomm.model import Model, build_model
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import ExcitationNote, Sidecar
from truth import ConstantBelt, TruthPlant

Array = NDArray[np.float64]

PERIOD_S = 1e-3
COUNTS = 65536
STEP_RAD = 2.0 * math.pi / COUNTS
NOISE_NM = 6e-3
EFFECTS = ("belt_stiffness", "belt_damping", "viscous", "coulomb", "cart_friction")


@dataclass(frozen=True)
class Recorder:
    """One record's imperfections.

    seed : of the torque noise.   delay_s : s, torque setpoint to acting torque.   noise_nm : N m rms on the reported torque.
    counts : per revolution.   disturbance : (n,), N m, acts on the shaft besides and is not reported.   share : of what is new that
    a filter of the samples lets through in each, between setpoint and delay.   lag_s : s, of first order, between the delayed setpoint and
    the acting torque; stepped in pieces of a twentieth of a sample.
    """

    seed: int = 0
    delay_s: float = 1e-3
    noise_nm: float = NOISE_NM
    counts: int = COUNTS
    disturbance: Array | None = None
    share: float = 1.0
    lag_s: float = 0.0

    def record(
        self, plant: TruthPlant, command: Callable[[int, float], float], samples: int, sidecar: Sidecar, name: str = "record"
    ) -> Recording:
        """Let ``command(n, counted angle) -> torque setpoint`` drive the plant; what it asks at t[n] acts from t[n] + delay on."""
        step = 2.0 * math.pi / self.counts
        whole = math.floor(self.delay_s / PERIOD_S + 1e-9)
        late = self.delay_s - whole * PERIOD_S
        waiting = [0.0] * (whole + 1)
        setpoint, torque, position, cart = (np.empty(samples) for _ in range(4))
        extra = np.zeros(samples) if self.disturbance is None else self.disturbance
        zero, smooth, lagging = plant.position_rad, 0.0, 0.0

        def held(asked: float, duration: float, more: float) -> float:
            """The plant moved on while a setpoint is held; integral of the torque, N m s."""
            nonlocal lagging
            if self.lag_s == 0.0:
                plant.step(asked + more, duration)
                return asked * duration
            total, pieces = 0.0, math.ceil(20.0 * duration / PERIOD_S)
            for _ in range(pieces):
                h = duration / pieces
                left = (lagging - asked) * math.exp(-h / self.lag_s)
                mean = asked + (lagging - asked - left) * self.lag_s / h
                lagging = asked + left
                plant.step(mean + more, h)
                total += mean * h
            return total

        for n in range(samples):
            position[n] = math.floor((plant.position_rad - zero) / step) * step
            cart[n] = plant.cart_position_m
            setpoint[n] = command(n, float(position[n]))
            smooth += self.share * (float(setpoint[n]) - smooth)
            waiting.append(smooth)
            old = waiting.pop(0)
            acted = held(old, late, float(extra[n])) if late > 1e-9 else 0.0
            acted += held(waiting[0], PERIOD_S - late, float(extra[n]))
            torque[n] = acted / PERIOD_S
        return Recording(
            name=name,
            t_s=PERIOD_S * np.arange(samples, dtype=np.float64),
            torque=torque + np.random.default_rng(self.seed).normal(0.0, self.noise_nm, samples),
            torque_setpoint=setpoint,
            position=position,
            cart_position_m=cart,
            sidecar=sidecar,
        )

    def shaken(
        self, plant: TruthPlant, amplitude_nm: float, periods: int, name: str = "shaken", *, at_m: float = 0.0, held_out: bool = False
    ) -> Recording:
        """Open loop: a PRBS of 1022 samples per period between rests, one period of run-in."""
        signal = prbs(9, 2, 2.0 * amplitude_nm, PERIOD_S, periods)
        note = ExcitationNote("prbs", signal.amplitude_nm, signal.period_samples, signal.first_sample)
        sidecar = Sidecar("frf", start_position_m=at_m, held_out=held_out, excitation=note)
        return self.record(plant, lambda n, _: float(signal.torque[n]), len(signal.torque), sidecar, name)

    def stroked(
        self,
        plant: TruthPlant,
        speeds_m_s: Sequence[float],
        plateau_s: float,
        name: str = "strokes",
        *,
        at_m: float = 0.0,
        ramp_m_s2: float = 3.0,
        held_out: bool = False,
    ) -> Recording:
        """Closed loop: to and fro at each speed between raised-cosine ramps, rests of 0.15 s between.

        Rigid feedforward from the machine's own numbers and a weak loop on the counted angle: only the motion matters here.
        """
        axis, lever = plant.axis, plant.axis.transmission_m_rad
        legs = [np.zeros(150)]
        for speed in speeds_m_s:
            ramp = max(round(speed / ramp_m_s2 / PERIOD_S), 30)
            rise = 0.5 - 0.5 * np.cos(math.pi * (np.arange(ramp) + 0.5) / ramp)
            leg = speed / lever * np.concatenate([rise, np.ones(round(plateau_s / PERIOD_S)), rise[::-1], np.zeros(150)])
            legs += [leg, -leg]
        omega = np.concatenate(legs)
        angle = PERIOD_S * np.cumsum(omega)
        inertia = axis.inertia_kg_m2 + lever**2 * axis.mass_kg
        friction = axis.coulomb_motor_nm + lever * axis.coulomb_cart_n
        ahead = inertia * np.gradient(omega, PERIOD_S) + axis.viscous_motor_nm_s_rad * omega + friction * np.sign(omega)
        last, filtered = 0.0, 0.0

        def command(n: int, measured: float) -> float:
            nonlocal last, filtered
            filtered += ((measured - last) / PERIOD_S - filtered) / 3.0
            last = measured
            return float(ahead[n] + 0.004 * (omega[n] - filtered) + 0.02 * (angle[n] - measured))

        sidecar = Sidecar("trajectory", start_position_m=at_m, closed_loop=True, held_out=held_out)
        return self.record(plant, command, len(omega), sidecar, name)


def true_model(plant: TruthPlant) -> Model:
    """The product's model with the machine's own numbers."""
    axis = plant.axis
    assert isinstance(axis.belt, ConstantBelt)
    values = {
        "motor.inertia": axis.inertia_kg_m2,
        "cart.mass": axis.mass_kg,
        "transmission.ratio": axis.transmission_m_rad,
        "belt_stiffness.stiffness": axis.belt.stiffness_n_m,
        "belt_damping.damping": axis.belt.damping_n_s_m,
        "viscous.damping": axis.viscous_motor_nm_s_rad,
        "coulomb.level": axis.coulomb_motor_nm,
        "cart_friction.level": axis.coulomb_cart_n,
    }
    return build_model("truth", EFFECTS, values)
