"""Controllers, a sequence of calls for them, and what the drive's own compiled cascade makes of it."""

from __future__ import annotations

import numpy as np

from beltcomm.control import Cascade, Feedforward, Prefilter, discrete_coefficients
from beltcomm.control.cascade_kernel import cascade_step, new_state, reset_state, velocity_step
from beltcomm.export.program import controller_of
from beltcomm.export.texts import text_of

Calls = list[tuple[str, tuple[float, ...]]]

STEPS, PERIOD_S, LIMIT_NM = 10_000, 1e-3, 1.24

FEEDFORWARD = Feedforward(2.145e-3, 2.53e-3, 0.125, 0.01, 1.0, 1.5e-3)
CASCADES = {
    "butterworth": Cascade(0.104, 1.67, 8.2, 2e-3, Prefilter("butterworth", 123.27), FEEDFORWARD),
    "notch, no advance": Cascade(0.073, 1.63, 7.3, 2e-3, Prefilter("notch", 123.1, 4.6, 700.0), Feedforward(2e-3, 2e-3, 0.1, 0.0, 0.8)),
    "plain, no integrator": Cascade(0.05, 0.0, 5.0, 0.0, filter_reference=False),
}


def sequence(seed: int = 7) -> Calls:
    """Random references and positions: strokes with noise that drive the torque in and out of its limits, resets, both loops."""
    rng = np.random.default_rng(seed)
    t = PERIOD_S * np.arange(STEPS)
    acceleration = 60.0 * np.sin(2 * np.pi * 1.3 * t) + rng.normal(0.0, 20.0, STEPS)
    acceleration[3000:3400] = 0.0
    velocity = np.cumsum(acceleration) * PERIOD_S
    velocity[3100:3300] = 0.0  # where the sign of the friction is zero
    reference = np.cumsum(velocity) * PERIOD_S
    reference -= reference.mean()
    position = reference + 1.5 * np.sin(2 * np.pi * 0.7 * t + 1.0) + np.cumsum(rng.normal(0.0, 2e-4, STEPS))
    extra = np.where(rng.random(STEPS) < 0.05, rng.normal(0.0, 1.5, STEPS), 0.0)
    calls: Calls = []
    for k in range(STEPS):
        if k % 2500 == 2400:
            calls.append(("reset", (position[k], velocity[k])))
        inputs = (reference[k], velocity[k], acceleration[k], position[k], extra[k])
        calls.append(("velocity", inputs) if 5000 <= k < 6000 else ("position", inputs))
    return [(kind, tuple(map(float, values))) for kind, values in calls]


def by_kernel(cascade: Cascade, calls: Calls) -> np.ndarray:
    """What the drive's own compiled step gives."""
    coefficients, state, torque = discrete_coefficients(cascade, PERIOD_S, LIMIT_NM), new_state(), []
    for kind, values in calls:
        if kind == "reset":
            reset_state(state, *values)
        elif kind == "position":
            torque.append(cascade_step(coefficients, state, *values))
        else:
            torque.append(velocity_step(coefficients, state, *values[1:]))
    return np.array(torque)


def text(cascade: Cascade, format_: str) -> str:
    return text_of(controller_of(cascade, PERIOD_S, LIMIT_NM, {"model": "g_a"}, ["Größe: 5 µm */ (* ??/ \\"]), format_)
