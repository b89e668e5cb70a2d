"""Seconds simulated per second with every effect of the catalogue that goes together, at the accuracy asked of all."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator

import numpy as np

from beltcomm.effects import EFFECTS
from beltcomm.errors import BeltcommError
from beltcomm.model import Model, load_plant
from beltcomm.model.linear import describes
from beltcomm.simulate.forward import BodyStates, Simulated, at_rest, integrate_torque, simulate_torque
from benchmarks.speeds.compared import LONGER, PERIOD_S, SAMPLES, SPEED_M_S, Array, error
from benchmarks.speeds.measure import Figure, in_turn, ratio, spread


def everything() -> Model:
    """The rig with every effect of the catalogue that can be added and simulated with the others."""
    model = load_plant("g_b").model
    for effect in EFFECTS:
        if effect.name in model.effects:
            continue
        try:
            more = model.with_effect(effect.name)
            if describes(more, 0.25):
                model = more
        except BeltcommError:
            continue
    return model


def sized() -> Model:
    """The same with every effect at a size that is seen: harmonics of twelve orders, run-out, ripple, late torque."""
    model = everything()
    values = {"tooth_ripple.sine": 0.01, "tooth_ripple.cosine": 0.01, "travel_ripple.sine": 1.0, "travel_ripple.cosine": 1.0,
              "torque_ripple.sine": 0.01, "torque_ripple.cosine": 0.02, "pulley_eccentricity.sine": 3e-3,
              "pulley_eccentricity.cosine": 2e-3,
              "pulley_eccentricity_2.sine": 1e-3, "pulley_eccentricity_2.cosine": 1e-3, "holding_brake.sine": 5e-3,
              "holding_brake.cosine": 5e-3, "viscous_asymmetry.share": 0.1, "constant_offset.torque": 0.02, "cable_chain.rate": 5.0,
              "cable_chain.offset": 2.0, "feed_constant.error": 1e-3, "tilt.angle": 0.02}  # fmt: skip
    for k, order in enumerate((1, 2, 4, 6, 8, 12, 16, 24, 36, 48, 72, 96), start=1):
        name = "cogging" if k == 1 else f"cogging_{k}"
        values |= {f"{name}.order": float(order), f"{name}.sine": 0.01 * np.sin(k), f"{name}.cosine": 0.01 * np.cos(k)}
    for k in range(1, 6):
        values |= {f"friction_freeform.forward_{k}": 2e-3 * k, f"friction_freeform.backward_{k}": 3e-3 * k}
    return model.with_values(values)


def to_and_fro() -> Array:
    """10 s of torque: a quarter of a second each way, 5 to 150 Hz on it; 39 changes of direction."""
    t, rng = PERIOD_S * np.arange(SAMPLES), np.random.default_rng(11)
    tones = sum(np.cos(2.0 * np.pi * f * t + rng.uniform(0.0, 2.0 * np.pi)) for f in range(5, 151, 5))
    side = np.where(np.arange(LONGER * SAMPLES) // SAMPLES % 2 == 0, 0.5, -0.5)
    return np.asarray(side + 0.075 + 0.02 * np.tile(tones, LONGER))


def figures(rounds: int) -> Iterator[Figure]:
    """The rig with everything on it, and what it costs by the composer's steps at the same accuracy.

    Accuracy: 120 ms of sliding at 1 m/s against steps of 1/640 ms extrapolated from those of 1/320 ms.
    """
    model, torque = sized(), to_and_fro()
    late = model.with_values({"dead_time.time": 2.5e-4, "current_lag.time": 2.5e-4})
    ratio_m, rest = model["transmission.ratio"], at_rest(model, 0.25)
    levers = np.array([1.0 / ratio_m if body.rotary else 1.0 for _, body in model.bodies()])
    elastic = np.ones(rest.positions.size - rest.speeds.size)
    moving = BodyStates(np.concatenate([rest.positions[: rest.speeds.size], elastic]), SPEED_M_S * levers)
    short = torque[:120] + 0.05

    def rows(simulate: Callable[..., Simulated], substeps: int) -> Array:
        found = simulate(model, short, PERIOD_S, 0.25, substeps, state=moving)
        assert found.velocity_rad_s.min() > 0.0
        return np.column_stack([found.velocity_rad_s, ratio_m * found.position_rad - found.cart_position_m])

    true = (4.0 * rows(integrate_torque, 640) - rows(integrate_torque, 320)) / 3.0
    wrong = {name: error(rows(f, n), true) for name, f, n in (("", simulate_torque, 20), ("48", integrate_torque, 48))}
    start = at_rest(model, 0.45)
    actions = [
        functools.partial(simulate_torque, model, torque, PERIOD_S, 0.45, 20, state=start),
        functools.partial(simulate_torque, late, torque, PERIOD_S, 0.45, 20, state=start),
        functools.partial(integrate_torque, model, torque[:1000], PERIOD_S, 0.45, 48, state=start),
        functools.partial(integrate_torque, model, torque[:1000], PERIOD_S, 0.45, 10, state=start),
    ]
    taken = in_turn(actions, rounds)
    seconds = PERIOD_S * np.array([torque.size, torque.size, 1000, 1000])
    names = ("all effects on", "all effects on, torque late", "all effects on, by 48 steps per ms", "all effects on, by 10 steps per ms")
    notes = (f"error {wrong['']:.1e}", "", f"error {wrong['48']:.1e}", "what stood here before, no accuracy asked")
    for name, note, span, values, aim in zip(names, notes, seconds, taken, (300.0, 300.0, None, None), strict=True):
        s = spread([span / v for v in values])
        note = f"{len(model.effects)} effects, {len(model.bodies())} bodies; {note}"
        yield Figure("simulation", name, s.median, "x real time", aim, True, s.low, s.high, note)
    s = ratio([seconds[0] / seconds[2] * v for v in taken[2]], taken[0])
    yield Figure("simulation", "all effects on: times the composer's steps at equal accuracy", s.median, "x", None, True, s.low, s.high)
