"""What every effect says that it remembers, against the simulation and the fit: how it begins, and what one record leaves for the next."""

from __future__ import annotations

import numpy as np
import pytest

from beltcomm.effects import EFFECTS, Effect, effect_named
from beltcomm.fit.noise.propagation import MOTION, noise_path
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.model import Model, build_model, effect_parameters
from beltcomm.simulate.forward import BodyStates, Simulated, at_rest, simulate_torque
from beltcomm.simulate.imperfect import late_torque
from beltcomm.simulate.inverse import FineMotion, fine_load
from beltcomm.simulate.kernels.compose import states_of
from simulate.reading import torque_as_read
from simulate.test_round_trip import BASE, RATIO, VALUES, T
from test_energy import STANDS_ON, WITHOUT_BELT

SUBSTEPS, AT_M = 40, 0.4
FRICTION = ("viscous.damping", "viscous_cart.damping", "coulomb.level")
#: One of each kind of cogging is enough.
TRIED = [e for e in EFFECTS if not e.name.startswith("cogging_")]
each_effect = pytest.mark.parametrize("effect", TRIED, ids=lambda effect: effect.name)
#: Samples of the first record and of the second.
FIRST, SECOND = 40, 30
SIZES = {"dead_time.time": 3e-3, "current_lag.time": 2e-3, "cable_chain.rate": 50.0, "warmup.amount": 5.0, "backlash.gap": 2e-4}


def model_with(effect: Effect) -> Model:
    """Friction and damping beside it: those of a round trip, so that most kernels are the same."""
    belt = effect.name not in WITHOUT_BELT
    base = BASE if belt else ("viscous", "coulomb")
    other = (effect.name, "belt_stiffness") if effect.group == "belt spring" else (effect.name,)
    effects = tuple(dict.fromkeys((*(name for name in base if name not in other), *STANDS_ON.get(effect.name, ()), effect.name)))
    known = {name for one in effects for name in effect_parameters(effect_named(one))}
    bodies = ("motor", "cart") if belt else ("motor",)
    values = {n: v for n, v in {**VALUES, **SIZES}.items() if n in known or n.split(".")[0] in (*bodies, "transmission")}
    return build_model("remembers", effects, values, base_bodies=bodies)


def torques() -> tuple[np.ndarray, np.ndarray]:
    t = T * np.arange(FIRST + SECOND)
    both = 0.4 + 0.6 * np.sin(2.0 * np.pi * 17.0 * t) + 0.3 * np.sign(np.sin(2.0 * np.pi * 41.0 * t))
    return both[:FIRST], both[FIRST:]


def run(model: Model, torque: np.ndarray, state: BodyStates | None = None, time_s: float = 0.0) -> Simulated:
    return simulate_torque(model, torque, T, AT_M, SUBSTEPS, time_s, state)


def carried(effect: Effect, how: str) -> bool:
    return any(state.carried == how for state in effect.states)


@each_effect
def test_the_second_record_goes_on_where_the_first_ended(effect: Effect) -> None:
    """Two records by the end of the first are one record; unless something is not carried: then they are not."""
    if effect.slot == "torque_reading":
        first, second = torques()
        model = model_with(effect)
        split = np.concatenate([torque_as_read(model, part, T) for part in (first, second)])
        assert carried(effect, "no") != np.allclose(split, torque_as_read(model, np.concatenate([first, second]), T))
        return
    model, (first, second) = model_with(effect), torques()
    whole = run(model, np.concatenate([first, second]))
    ended = run(model, first)
    continued = run(model, second, ended.end, FIRST * T)
    apart = np.max(np.abs(continued.velocity_rad_s - whole.velocity_rad_s[FIRST:])) / np.max(np.abs(whole.velocity_rad_s))
    assert (apart > 1e-3) if carried(effect, "no") else (apart < 1e-9)


@each_effect
def test_only_what_is_carried_by_the_clock_depends_on_it(effect: Effect) -> None:
    model, (first, _) = model_with(effect), torques()
    early, late = run(model, first), run(model, first, time_s=500.0)
    assert np.array_equal(early.velocity_rad_s, late.velocity_rad_s) != carried(effect, "clock")


@each_effect
def test_every_state_of_the_end_counts_and_there_is_no_other(effect: Effect) -> None:
    """Bodies and elastic friction, each with a place in ``State``; the second record is another without any one of them."""
    model, (first, second) = model_with(effect), torques()
    own = [state for state in effect.states if state.carried == "end" and state.start != "estimated"]
    bodies = model.bodies()
    assert len(effect.bodies) + states_of(model) - len(bodies) == len(own)
    end = run(model, first).end
    usual = run(model, second, end)
    brought = range(len(bodies) - len(effect.bodies), len(bodies))
    for place in (*brought, *range(len(bodies), states_of(model))):
        positions, speeds = end.positions.copy(), end.speeds.copy()
        if place < len(bodies):
            speeds[place] = 0.0
        else:
            assert positions[place] != 0.0
            positions[place] = 0.0
        other = run(model, second, BodyStates(positions, speeds))
        assert not np.allclose(other.velocity_rad_s, usual.velocity_rad_s, rtol=1e-6)


@each_effect
def test_a_record_begins_as_it_says(effect: Effect) -> None:
    model, starts = model_with(effect), {state.start for state in effect.states}
    rest = at_rest(model, AT_M)
    assert not rest.speeds.any()
    assert not rest.positions[len(model.bodies()) :].any(), "unloaded"
    assert needs_observer(model) == ("estimated" in starts)
    if "unloaded" in starts:
        level = ("coulomb" if effect.body == "motor" else "cart_friction") + ".level"
        theta = AT_M / RATIO + 3.0 * T / 20 * np.arange(400.0) * np.minimum(1.0, np.arange(400.0) / 200.0)
        motion = FineMotion(theta, np.gradient(theta, T / 20), 20, T, 20, 0.0)
        loads = [fine_load(model.with_values({level: value}), motion)[0] for value in (0.0, model[level])]
        assert loads[1][0] == pytest.approx(loads[0][0], abs=1e-9)
        assert loads[1][-1] > loads[0][-1] + 1e-6, "and turns round on the way"
    if "first value" in starts:
        held = np.full(50, 0.7)
        assert late_torque(model, held, T) == pytest.approx(held)
        assert torque_as_read(model, held, T) == pytest.approx(held)
    if effect.bodies and "cart" in model.base_bodies:
        counted = np.count_nonzero(noise_path(model, AT_M, T).begins[:, :, MOTION])
        assert (counted > 2) == ("swings" in starts), "place and speed of the carriage always do"
    if effect.bodies:
        gliding = model.with_values({name: 0.0 for name in FRICTION if name in model.parameters})
        for speed, rest in ((2.0, True), (4.0, False)):  # rad/s, below and above what tells a record that begins in motion
            theta = AT_M / RATIO + speed * T / 20 * np.arange(400.0)
            load, _ = fine_load(gliding, FineMotion(theta, np.full(400, speed), 20, T, 20, 0.0))
            assert bool(np.max(np.abs(load)) > 1e-3) is rest
