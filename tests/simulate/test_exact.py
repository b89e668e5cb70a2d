"""Exact steps through stick and slip: against an independent simulator, event times, and what must hold without any reference."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from beltcomm.effects import EFFECTS, Effect, Parameter
from beltcomm.errors import UsageError
from beltcomm.model import Model, build_model, load_plant
from beltcomm.simulate.exact import _linear_axis, is_exact
from beltcomm.simulate.forward import BodyStates, integrate_torque, simulate_torque
from beltcomm.simulate.kernels.first_root import DEGREE, NEVER, first_root
from truth import Axis, ConstantBelt, Coupling, TruthPlant

Array = NDArray[np.float64]

BELT = ("belt_stiffness", "belt_damping", "viscous", "viscous_cart", "coulomb", "cart_friction", "tilt")


def drawn(seed: int, coupled: bool = False) -> tuple[Axis, Model, float]:
    """A random axis, for the independent simulator and as a model, and its whole friction, N m."""
    rng = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(math.log(low), math.log(high))))

    ratio, inertia, mass = between(0.004, 0.03), between(2e-5, 1e-3), between(0.3, 40.0)
    stiffness, damping, viscous, viscous_cart = between(2e4, 1e6), between(1.0, 300.0), between(1e-4, 1e-2), between(0.1, 50.0)
    total, share = between(0.03, 0.5), (0.0, 1.0, 0.3, 0.7)[seed % 4]
    motor, cart = total * share, total * (1.0 - share) / ratio
    tilt = math.asin(0.5 * total / ratio / mass / 9.80665) if seed % 3 == 0 and total < ratio * mass else 0.0
    coupling = Coupling(between(30.0, 400.0), 0.5 * inertia, 2e-3) if coupled else None
    axis = Axis(
        inertia, mass, ratio, ConstantBelt(stiffness, damping), viscous, motor, viscous_cart, cart, tilt_rad=tilt, coupling=coupling
    )
    values = {
        "motor.inertia": inertia, "cart.mass": mass, "transmission.ratio": ratio, "belt_stiffness.stiffness": stiffness,
        "belt_damping.damping": damping, "viscous.damping": viscous, "viscous_cart.damping": viscous_cart,
        "coulomb.level": motor, "cart_friction.level": cart, "tilt.angle": tilt,
    }  # fmt: skip
    if coupling is not None:
        values |= {
            "driving_pulley.inertia": coupling.pulley_inertia_kg_m2,
            "coupling.stiffness": coupling.stiffness_nm_rad, "coupling.damping": coupling.damping_nm_s_rad,
        }  # fmt: skip
    return axis, build_model("drawn", (*BELT, "coupling") if coupled else BELT, values), total


def torques(kind: str, n: int, size: float, seed: int = 0) -> Array:
    """Signs near what friction holds, a sine, ramps with stands, noise."""
    rng, t = np.random.default_rng(seed), np.arange(n)
    if kind == "signs":
        return np.asarray(1.2 * size * np.repeat(np.sign(rng.standard_normal((n + 1) // 2)), 2)[:n])
    if kind == "sine":
        return np.asarray(1.8 * size * np.sin(2.0 * np.pi * 17e-3 * t))
    if kind == "ramps":
        return np.interp(t, np.linspace(0, n, 9), size * rng.uniform(-2.0, 2.0, 9))
    return np.asarray(1.5 * size * np.repeat(rng.standard_normal(n), 3)[:n])


def at_zero(model: Model) -> BodyStates:
    n = len(model.bodies())
    return BodyStates(np.zeros(n), np.zeros(n))


CASES = [(seed, kind, False) for seed, kind in enumerate(("signs", "sine", "ramps", "noise") * 3)]
CASES += [(seed, kind, True) for seed, kind in enumerate(("signs", "sine", "ramps", "noise"))]


@pytest.mark.parametrize(("seed", "kind", "coupled"), CASES)
def test_agrees_with_the_independent_simulator_through_stick_and_slip(seed: int, kind: str, coupled: bool) -> None:
    axis, model, total = drawn(seed, coupled)
    torque = torques(kind, 120, total, seed)
    out = simulate_torque(model, np.append(torque, 0.0), 1e-3, state=at_zero(model))
    plant = TruthPlant(axis, longest_substep_s=1e-3 / 256)
    rows, stuck = [], []
    for held in torque:
        plant.step(float(held), 1e-3)
        rows.append([plant.position_rad, plant.velocity_rad_s, plant.cart_position_m])
        stuck.append(plant.stuck[0])
    expected = np.array(rows)
    found = np.column_stack([out.position_rad, out.velocity_rad_s, out.cart_position_m])[1:]
    scale = np.abs(expected).max(axis=0) + 1e-9
    np.testing.assert_allclose(found / scale, expected / scale, rtol=0.0, atol=1e-8)
    if axis.coulomb_motor_nm > 0.0:
        np.testing.assert_array_equal(found[:, 1] == 0.0, stuck)
        assert np.count_nonzero(np.diff(np.sign(found[:, 1]))) >= 4, "the stretch must stick and slip"


def test_how_a_record_is_cut_changes_nothing() -> None:
    _, model, total = drawn(2)
    torque = torques("signs", 200, total)
    whole = simulate_torque(model, torque, 1e-3, state=at_zero(model))
    cut = simulate_torque(model, np.repeat(torque, 7), 1e-3 / 7, state=at_zero(model))
    again = simulate_torque(model, torque, 1e-3, substeps=3, state=at_zero(model))
    for name in ("position_rad", "velocity_rad_s", "cart_position_m"):
        scale = np.max(np.abs(getattr(whole, name)))
        np.testing.assert_allclose(getattr(cut, name)[::7], getattr(whole, name), rtol=0.0, atol=1e-11 * scale)
        np.testing.assert_array_equal(getattr(again, name), getattr(whole, name))
    largest = cut.belt_force_n.reshape(200, 7).max(axis=1)
    np.testing.assert_allclose(largest, whole.belt_force_n, rtol=1e-9)


def test_the_other_direction_is_the_mirror_image() -> None:
    _, model, total = drawn(2)
    torque = torques("noise", 300, total)
    one, other = (simulate_torque(model, sign * torque, 1e-3, state=at_zero(model)) for sign in (1.0, -1.0))
    np.testing.assert_allclose(other.position_rad, -one.position_rad, rtol=0.0, atol=1e-12 * np.max(np.abs(one.position_rad)))
    np.testing.assert_allclose(other.belt_force_n, one.belt_force_n, rtol=1e-9)


def test_work_is_motion_stretch_and_friction() -> None:
    """sum tau dtheta = J w²/2 + m v²/2 + c s²/2 + grip |dtheta| + F |dx|, sampled so finely that no reversal hides way (but 1e-6)."""
    model = build_model("axis", BELT, {"belt_damping.damping": 0.0, "viscous.damping": 0.0, "viscous_cart.damping": 0.0, "tilt.angle": 0.0})
    torque = np.repeat(torques("signs", 100, 0.09), 100)
    out = simulate_torque(model, torque, 1e-5, state=at_zero(model))
    angle, cart = np.append(out.position_rad, out.end.positions[0]), np.append(out.cart_position_m, out.end.positions[1])
    work = np.sum(torque * np.diff(angle))
    lost = model["coulomb.level"] * np.sum(np.abs(np.diff(angle))) + model["cart_friction.level"] * np.sum(np.abs(np.diff(cart)))
    stretch = model["transmission.ratio"] * angle[-1] - cart[-1]
    speeds = out.end.speeds
    kept = 0.5 * (model["motor.inertia"] * speeds[0] ** 2 + model["cart.mass"] * speeds[1] ** 2)
    kept += 0.5 * model["belt_stiffness.stiffness"] * stretch**2
    assert work == pytest.approx(lost + kept, rel=1e-5)
    assert lost > 0.1 * work


def test_stands_for_seconds_where_it_stopped() -> None:
    model = load_plant("g_b").model
    grip = model["coulomb.level"]
    out = simulate_torque(model, np.concatenate([np.full(20, 0.4), np.full(5000, 0.999 * grip)]), 1e-3, position_m=0.2)
    still = out.velocity_rad_s == 0.0
    assert np.count_nonzero(still) > 4000
    assert np.ptp(out.position_rad[-4000:]) == 0.0
    assert np.ptp(out.cart_position_m[-1000:]) == 0.0


@pytest.mark.parametrize("dip", [1e-3, 1e-7, -1e-7], ids=["sticks", "sticks shortly", "passes"])
def test_a_speed_that_only_grazes_zero_is_seen(dip: float) -> None:
    """The torque balances the motor's friction, so motor and carriage swing about one speed:  w = V + A cos(W t),  A = V + dip.

    At cos(W t) = -V/A the motor stops.  The belt, by then at F = J A W sin(W t)/i_t, holds it until the carriage, which runs on at
    i_t V + J A/(i_t m), has let it go slack.
    """
    inertia, mass, ratio, stiffness, grip, mean = 71.73e-6, 0.96, 0.01242, 222.39e3, 0.05, 10.0
    values = {"motor.inertia": inertia, "cart.mass": mass, "transmission.ratio": ratio, "belt_stiffness.stiffness": stiffness}
    model = build_model("swing", ("belt_stiffness", "coulomb"), values | {"coulomb.level": grip})
    swing, omega = mean + dip, math.sqrt(stiffness * (ratio**2 / inertia + 1.0 / mass))
    lag = inertia * swing / ratio / mass
    start = BodyStates(np.zeros(2), np.array([mean + swing, ratio * mean - lag]))

    def speed(t: float) -> float:
        return float(simulate_torque(model, np.full(2, grip), t, state=start).velocity_rad_s[1])

    if dip < 0.0:
        for t in (0.9 * math.pi / omega, math.pi / omega, 1.5 * math.pi / omega):
            assert speed(t) == pytest.approx(mean + swing * math.cos(omega * t), abs=1e-12 * mean)
        return
    stops = math.acos(-mean / swing) / omega
    held = inertia * swing * omega * math.sin(omega * stops) / ratio / (stiffness * (ratio * mean + lag))
    assert speed(stops - 0.01 * held) > 0.0
    assert speed(stops + 0.01 * held) == 0.0
    assert speed(stops + 0.99 * held) == 0.0
    assert speed(stops + 1.01 * held) > 0.0


@pytest.mark.parametrize("held", [0.0, -0.12, -0.15])
def test_events_are_where_an_event_finder_puts_them(held: float) -> None:
    """From 0.1 m/s against a torque, through standstill and back: DOP853 at 1e-12 with its event location, to a nanosecond."""
    model = load_plant("g_b").model
    a, _ = _linear_axis(model)
    start = BodyStates(np.zeros(2), 0.1 * np.array([1.0 / model["transmission.ratio"], 1.0]))
    t, y, slide, expected = 0.0, np.concatenate([start.positions, start.speeds]), np.ones(2), []

    def forces(y: Array) -> Array:
        return np.asarray(a.smooth @ y + np.array([held, 0.0]))

    while True:

        def rate(_: float, y: Array) -> Array:
            return np.concatenate([y[2:], np.where(slide == 0.0, 0.0, (forces(y) - slide * a.level) * a.lightness)])

        def event(i: int, y: Array) -> float:
            return float(slide[i] * y[2 + i] if slide[i] else a.level[i] * (1.0 + 1e-12) - abs(forces(y)[i]))

        watched = [lambda _, y, i=i: event(i, y) for i in range(2)]
        for function in watched:
            function.terminal, function.direction = True, -1.0  # type: ignore[attr-defined]
        found = solve_ivp(rate, (t, 0.05), y, method="DOP853", rtol=1e-12, atol=1e-14, first_step=1e-7, max_step=5e-3, events=watched)
        t, y = float(found.t[-1]), found.y[:, -1].copy()
        if found.status == 0:
            break
        i = int(np.argmax([len(times) for times in found.t_events]))
        if slide[i]:
            y[2 + i] = 0.0
            slide[i] = 0.0 if abs(forces(y)[i]) <= a.level[i] else math.copysign(1.0, forces(y)[i])
        else:
            slide[i] = math.copysign(1.0, forces(y)[i])
        expected.append(t)
    assert len(expected) >= 2
    for when in expected:
        before, after = (simulate_torque(model, np.full(1, held), when + late, state=start).end.speeds for late in (-1e-9, 1e-9))
        assert np.any(np.sign(before) != np.sign(after)), "one of the bodies stops, lets go or turns here"


def test_first_root_is_the_first_one() -> None:
    """Against all roots by eigenvalues, for polynomials with up to four roots in 0..1."""
    rng, moved = np.random.default_rng(3), np.empty(DEGREE + 1)
    for _ in range(300):
        roots = np.sort(np.append(rng.uniform(-0.5, 1.5, 4), 2.0 + rng.uniform(size=2)))
        shape = np.polynomial.polynomial.polyfromroots(roots)
        p = np.zeros(DEGREE + 1)
        p[:7] = shape * math.copysign(1.0, shape[0])
        inside = roots[(roots > 0.0) & (roots < 1.0)]
        assert first_root(p, moved) == pytest.approx(inside[0] if len(inside) else NEVER, rel=1e-9)


@pytest.mark.parametrize(
    ("shape", "root"),
    [
        ([-1e-20, 1.0], 0.0), ([0.0, -1.0], 0.0), ([0.0, 0.0, -1.0], 0.0),   # at once
        ([0.0, 1.0, -2.0], 0.5), ([0.0, 0.0, 1.0, -4.0], 0.25),              # away from zero and back
        ([0.0], NEVER), ([0.0, 1.0], NEVER), ([0.25 + 1e-9, -1.0, 1.0], NEVER),
        ([0.25 - 1e-10, -1.0, 1.0], 0.5 - 1e-5),                             # two roots that are close
    ],
)  # fmt: skip
def test_first_root_at_the_borders(shape: list[float], root: float) -> None:
    p = np.zeros(DEGREE + 1)
    p[: len(shape)] = shape
    assert first_root(p, np.empty(DEGREE + 1)) == pytest.approx(root, rel=1e-9)


def _usual(parameter: Parameter, rng: np.random.Generator) -> float:
    """A value of the parameter, beside its start: a law may be linear where it is off."""
    value = parameter.start + rng.uniform(0.1, 0.4) * (abs(parameter.start) or 1.0)
    return float(min(max(value, parameter.low), parameter.high))


def _adds_up(model: Model, rng: np.random.Generator) -> bool:
    """Whether the answers to two torques, in steps of time that ask for no linearity, are together that to their sum."""
    one, other = rng.uniform(-0.5, 0.5, (2, 60))
    answers = [integrate_torque(model, torque, 1e-3).velocity_rad_s for torque in (one, other, one + other)]
    assert np.ptp(answers[2]) > 0.1
    return np.allclose(answers[0] + answers[1], answers[2], rtol=0.0, atol=1e-9 * np.ptp(answers[2]))


def _is_linear(effect: Effect) -> bool:
    """Whether the laws of an effect are affine and the same everywhere, by their values at random points."""
    rng = np.random.default_rng(1)
    if effect.slot == "rigid":
        return _adds_up(build_model("m", (effect.name,), {"cart.mass": 3.0, "motor.inertia": 2e-4}, base_bodies=("motor",)), rng)
    own = [_usual(parameter, rng) for parameter in effect.parameters] + [float(rng.uniform(1.0, 2.0)) for _ in effect.uses]
    points = rng.uniform(-0.5, 0.5, (60, 2))
    places, times = rng.uniform(0.1, 0.2, 60), rng.uniform(0.0, 1e3, 60)
    columns = []
    if effect.slot == "force" and effect.law is not None:
        columns.append([effect.law(*point, t, *own) for point, t in zip(points, times, strict=True)])
    elif effect.slot == "friction_level" and effect.law is not None:
        levels = [effect.law(*point, t, *own) for point, t in zip(points, times, strict=True)]
        if np.ptp(levels) > 1e-12:
            return False
    elif effect.law is not None:
        return False
    for element in effect.elements:
        columns.append([element.law(*point, x, *own) for point, x in zip(points, places, strict=True)])
    grounds = np.column_stack([np.ones(60), points])
    for column in columns:
        left = np.asarray(column) - grounds @ np.linalg.lstsq(grounds, column, rcond=None)[0]
        if np.max(np.abs(left)) > 1e-9 * max(np.max(np.abs(column)), 1e-12):
            return False
    return bool(columns) or effect.slot == "friction_level"


@pytest.mark.parametrize("effect", [e for e in EFFECTS if e.slot != "load_of_record"], ids=lambda e: e.name)  # a mass, no law
def test_an_effect_is_declared_linear_when_it_is(effect: Effect) -> None:
    assert effect.linear == _is_linear(effect)


def test_which_models_are_solved_exactly() -> None:
    model = load_plant("g_b").model
    assert is_exact(model)
    assert is_exact(model.with_effect("dead_time"))
    for name in ("stribeck", "backlash", "torque_ripple", "presliding", "pulley_eccentricity"):
        changed = model.with_effect(name)
        assert not is_exact(changed)
        with pytest.raises(UsageError, match="are too few"):
            simulate_torque(changed, np.zeros(3), 1e-3, substeps=1)


def test_a_torque_that_acts_late_is_the_same_by_both_ways() -> None:
    model = load_plant("g_b").model.with_effect("dead_time", {"time": 0.35e-3})
    torque = torques("signs", 100, 0.2)
    solved, integrated = (f(model, torque, 1e-3, substeps=100) for f in (simulate_torque, integrate_torque))
    swing = np.ptp(integrated.velocity_rad_s)
    np.testing.assert_allclose(solved.velocity_rad_s, integrated.velocity_rad_s, rtol=0.0, atol=2e-3 * swing)
