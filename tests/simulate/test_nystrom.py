"""Nyström's steps against an independent integrator, the laws, and the composer's steps where friction changes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from beltcomm.effects import EFFECTS, effect_named
from beltcomm.model import Model, build_model
from beltcomm.simulate import forward
from beltcomm.simulate.forward import BodyStates, integrate_torque, simulate_torque
from beltcomm.simulate.kernels import nystrom
from beltcomm.simulate.kernels.fast_math import cos, exp, fast, power, sin, waves

Array = NDArray[np.float64]
IT, INERTIA, MASS, C, D, DRAG = 0.01242, 71.73e-6, 13.44, 203740.0, 20.0, 3.0
#: Drag and ripple keep it from being solved exactly; both kinds of friction are there.
EFFECTS_ON = ("belt_stiffness", "belt_damping", "viscous", "coulomb", "cart_friction", "presliding_cart", "quadratic_drag", "cogging",
              "torque_ripple", "dead_time", "current_lag")  # fmt: skip


def axis(**values: float) -> Model:
    numbers = {"motor.inertia": INERTIA, "cart.mass": MASS, "transmission.ratio": IT, "belt_stiffness.stiffness": C,
               "belt_damping.damping": D, "viscous.damping": 2e-3, "coulomb.level": 0.08, "cart_friction.level": 3.0,
               "quadratic_drag.factor": DRAG, "cogging.order": 12.0, "cogging.sine": 0.02, "cogging.cosine": -0.01,
               "torque_ripple.order": 6.0, "torque_ripple.sine": 0.03, "torque_ripple.cosine": 0.01}  # fmt: skip
    return build_model("axis", EFFECTS_ON, numbers | {name.replace("__", "."): value for name, value in values.items()})


def sliding(speed: float = 0.5) -> BodyStates:
    """Both bodies in steady motion, the carriage's elastic friction turned round."""
    return BodyStates(np.array([0.2 / IT, 0.2, 1.0]), np.array([speed / IT, speed]))


def slope(t: float, y: Array, torque: float) -> list[float]:
    """Both bodies while they slide forwards, written from Newton's law."""
    force = C * (IT * y[0] - y[1]) + D * (IT * y[2] - y[3])
    push = torque * (1.0 + 0.03 * math.sin(6.0 * y[0]) + 0.01 * math.cos(6.0 * y[0]))
    cogging = 0.02 * math.sin(12.0 * y[0]) - 0.01 * math.cos(12.0 * y[0])
    return [y[2], y[3], (push - cogging - 2e-3 * y[2] - 0.08 - IT * force) / INERTIA, (force - 3.0 - DRAG * y[3] ** 2) / MASS]


def moved(start: BodyStates, torque: Array, late_s: float = 0.0, lag_s: float = 0.0) -> Array:
    """Motor angle, carriage and their speeds after the record, by DOP853 begun anew at every jump of the acting torque."""
    y, acting, before = np.concatenate([start.positions[:2], start.speeds]), torque[0], torque[0]
    for held in torque:
        for begin, end, target in ((0.0, late_s, before), (late_s, 1e-3, held)):
            if end > begin:

                def f(t: float, y: Array, target: float = target, was: float = acting) -> list[float]:
                    return slope(t, y, target + (was - target) * math.exp(-t / lag_s) if lag_s else target)

                y = solve_ivp(f, (0.0, end - begin), y, method="DOP853", rtol=1e-10, atol=1e-13).y[:, -1]
                acting = target + (acting - target) * math.exp(-(end - begin) / lag_s) if lag_s else target
        before = held
    assert y[2:].min() > 0.0, "the case must slide"
    return np.asarray(y)


def ends(model: Model, torque: Array, substeps: int) -> Array:
    end = simulate_torque(model, torque, 1e-3, 0.2, substeps, state=sliding()).end
    return np.concatenate([end.positions[:2], end.speeds])


def test_of_fourth_order_or_better_against_an_independent_integrator() -> None:
    """A step twice as long: sixteen times the error or more; and the usual step is within 1e-4 of how far the speed moves."""
    torque = np.array([0.6, 0.2, 0.8, 0.4, 0.3, 0.7])
    true = moved(sliding(), torque)
    errors = np.array([np.abs(ends(axis(), torque, substeps) - true)[2] for substeps in (10, 20, 40)])
    assert np.all(errors[:-1] / errors[1:] > 14.0), errors
    assert errors[1] < 1e-4 * abs(true[2] - 0.5 / IT)


@pytest.mark.parametrize(("late_s", "lag_s"), [(2.5e-4, 2.5e-4), (1.7e-4, 0.0)])
def test_late_torque_within_a_ten_thousandth(late_s: float, lag_s: float) -> None:
    torque = np.array([0.6, 0.2, 0.8, 0.4, 0.3, 0.7])
    true = moved(sliding(), torque, late_s, lag_s)
    model = axis(dead_time__time=late_s, current_lag__time=lag_s)
    np.testing.assert_allclose(ends(model, torque, 20)[2:], true[2:], rtol=0, atol=1e-4 * abs(true[2] - 0.5 / IT))


def test_late_torque_in_blocks_is_that_of_the_whole_record(monkeypatch: pytest.MonkeyPatch) -> None:
    model, torque = axis(dead_time__time=1.3e-3, current_lag__time=2e-4), 0.5 + 0.2 * np.sin(np.arange(1200.0) ** 2)
    heard: list[int] = []
    late = forward.late_torque
    monkeypatch.setattr(forward, "late_torque", lambda model, cells, h: (heard.append(len(cells)), late(model, cells, h))[1])
    found = []
    for size in (9999, 1):
        monkeypatch.setattr(forward, "BLOCK", size)
        found.append(simulate_torque(model, torque, 1e-3, 0.2, state=sliding()))
    assert len(heard) > 3, "one whole record, and several blocks"
    whole, blocks = found
    np.testing.assert_allclose(blocks.velocity_rad_s, whole.velocity_rad_s, rtol=0, atol=1e-12 * np.ptp(whole.velocity_rad_s))


def test_changes_of_friction_are_those_of_small_verlet_steps() -> None:
    """From rest, through reversals, to rest again: where bodies stick, turn round and let go is left to the composer's steps."""
    torque = np.concatenate([np.zeros(3), 0.5 * np.sign(np.sin(np.arange(120) / 9.0)), np.zeros(60)])
    fine = integrate_torque(axis(), torque, 1e-3, 0.2, 160)
    assert np.ptp(np.sign(fine.velocity_rad_s)) == 2.0
    assert not fine.velocity_rad_s[:3].any()
    steps = [integrate_torque(axis(), torque, 1e-3, 0.2, 20), simulate_torque(axis(), torque, 1e-3, 0.2, 20)]
    by_verlet, gliding = (np.max(np.abs(each.velocity_rad_s - fine.velocity_rad_s)) for each in steps)
    assert gliding < by_verlet
    assert gliding < 2e-3 * np.max(np.abs(fine.velocity_rad_s))
    assert not steps[1].velocity_rad_s[:3].any()


def test_the_largest_belt_force_is_seen_within_a_percent() -> None:
    torque = 0.5 + 0.2 * np.sin(np.arange(60) / 3.0)
    fine, coarse = (
        f(axis(), torque, 1e-3, 0.2, n, state=sliding()).belt_force_n for f, n in ((integrate_torque, 160), (simulate_torque, 20))
    )
    np.testing.assert_allclose(coarse, fine, rtol=0, atol=0.01 * np.max(fine))


def test_a_record_can_be_continued_and_turned_round() -> None:
    model, torque = axis(), 0.5 * np.sign(np.sin(np.arange(60) / 7.0))
    whole = simulate_torque(model, torque, 1e-3, 0.2)
    first = simulate_torque(model, torque[:25], 1e-3, 0.2)
    second = simulate_torque(model, torque[25:], 1e-3, 0.2, time_s=0.025, state=first.end)
    np.testing.assert_array_equal(np.concatenate([first.velocity_rad_s, second.velocity_rad_s]), whole.velocity_rad_s)


def test_the_fast_functions_are_those_of_math() -> None:
    x = np.random.default_rng(1).uniform(-1.0, 1.0, 2000)
    for own, other, reach in ((sin, np.sin, 1e6), (cos, np.cos, 1e6)):
        assert np.max(np.abs([own(reach * each) for each in x] - other(reach * x))) < 1e-15
    assert np.max(np.abs([exp(700.0 * each) for each in x] / np.exp(700.0 * x) - 1.0)) < 1e-15
    bases, powers = np.exp(20.0 * x), np.abs(x[::-1]) + 0.5
    assert np.max(np.abs([power(*each) for each in zip(bases, powers, strict=True)] / bases**powers - 1.0)) < 1e-14
    assert power(0.0, 0.5) < 1e-150
    assert exp(-1e6) < 1e-300
    assert exp(0.0) == cos(0.0) == 1.0


def test_what_is_declared_harmonic_is_a_sine_and_a_cosine() -> None:
    """The kernel does not call these laws: order, sine and cosine must be their parameters, in this order."""
    for effect in EFFECTS:
        if effect.harmonic not in ("load", "gain") or effect.law is None:
            continue
        assert len(effect.parameters) == 3
        law = effect.law(0.7, 0.0, 0.0, 12.0, 0.3, -0.4) if effect.harmonic == "load" else 1.0 - effect.law(1.0, 0.7, 0.0, 12.0, 0.3, -0.4)
        wave = waves(0.7, np.array([12.0]), np.array([0.5]), np.array([math.atan2(-0.4, 0.3)]))
        assert -wave == pytest.approx(law, abs=1e-14), effect.name


def test_a_law_on_fast_functions_says_the_same() -> None:
    """Also where it calls another one."""
    for name, given in (("stribeck", (1.3, 0.0, 0.0, 0.02, 2.5, 1.7)), ("presliding_cart", (2e-6, -0.3, 5e-6, 3.0))):
        law = effect_named(name).law
        assert law is not None
        assert fast(law)(*given) == pytest.approx(law(*given), rel=1e-14)


def test_a_new_effect_needs_nothing_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every effect that can be simulated stands in the source by its law or as a wave."""
    combination = ("belt_stiffness", "cart_friction", "cogging")
    renamed = replace(effect_named("travel_ripple"), name="new")
    monkeypatch.setitem(effect_named.__globals__["_BY_NAME"], "new", renamed)
    assert "travel_ripple___force(q1, w1" in nystrom._nystrom_source(("motor", "cart"), (*combination, "new"))
