"""Linearisation: against the thesis's matrices, closed forms, and one form against the other."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from beltcomm import effects
from beltcomm.effects import Point, effect_named
from beltcomm.errors import Refused, UsageError
from beltcomm.model import Model, build_model
from beltcomm.model.linear import (
    Oscillation,
    _equivalent_damping,
    fastest_rate,
    matrices,
    modes,
    operating_point,
    sampled_response,
    state_space,
)
from beltcomm.model.statics import _smooth_forces, equilibrium
from beltcomm.model.transfer import two_mass

IT, INERTIA, MASS, C, D, DM, DC = 0.01242, 71.73e-6, 13.44, 203740.0, 20.0, 33.17, 226.42
FREQ_HZ = np.geomspace(0.5, 2000.0, 200)
RIGID = build_model("rigid", (), {"motor.inertia": 2e-3}, base_bodies=("motor",))


def belt_axis(*more: str, **values: float) -> Model:
    effects = ("belt_stiffness", "belt_damping", "viscous", "viscous_cart", *more)
    numbers = {
        "motor.inertia": INERTIA, "cart.mass": MASS, "transmission.ratio": IT, "belt_stiffness.stiffness": C,
        "belt_damping.damping": D, "viscous.damping": IT**2 * DM, "viscous_cart.damping": DC,
    }  # fmt: skip
    return build_model("axis", effects, numbers | {name.replace("__", "."): value for name, value in values.items()})


def full_rig() -> Model:
    values = {"belt_sections.specific_stiffness": 106250.0, "belt_sections.pulley_distance": 0.79, "belt_sections.offset": 0.05,
              "transmission.ratio": IT, "cart.mass": 11.57, "tilt.angle": 0.4}  # fmt: skip
    return build_model("rig", ("belt_sections", "coupling", "viscous", "viscous_end_pulley", "tilt"), values)


def test_two_mass_state_space_is_that_of_the_thesis() -> None:
    """(2.34), (2.35), (2.37) with d_m in N m s/rad at the motor."""
    dm = IT**2 * DM
    A = [
        [0, 1, 0, 0],
        [-(IT**2) * C / INERTIA, -(IT**2 * D + dm) / INERTIA, IT * C / INERTIA, IT * D / INERTIA],
        [0, 0, 0, 1],
        [IT * C / MASS, IT * D / MASS, -C / MASS, -(D + DC) / MASS],
    ]
    model = belt_axis()
    system = state_space(model, operating_point(model, 0.1))
    np.testing.assert_allclose(system.A, A, rtol=1e-12)
    np.testing.assert_allclose(system.B[:, 0], [0, 1 / INERTIA, 0, 0], rtol=1e-12)
    np.testing.assert_array_equal(system.C, [[1, 0, 0, 0], [0, 0, 1, 0]])
    assert system.states == ("motor.position", "motor.velocity", "cart.position", "cart.velocity")


def test_three_mass_matrices_are_those_of_the_thesis() -> None:
    """(2.12), (2.14), (2.15) with the end pulley's angle as travel r φ_2, and a gearbox in i_t = r/i_g."""
    r, gear, ea, da, l3, offset, x = 0.02, 5.0, 90000.0, 6.0, 0.8, 0.07, 0.31
    it, l1 = r / gear, offset + x
    c1, c2, c3 = ea / l1, ea / (l3 - l1), ea / l3
    d1, d2, d3 = da / l1, da / (l3 - l1), da / l3
    values = {"belt_sections.specific_stiffness": ea, "belt_sections.specific_damping": da, "belt_sections.pulley_distance": l3,
              "belt_sections.offset": offset, "transmission.ratio": it}  # fmt: skip
    model = build_model("three", ("belt_sections",), values)
    m = matrices(model, operating_point(model, x))
    assert m.bodies == ("motor", "cart", "end_pulley")

    def thesis(c1: float, c2: float, c3: float) -> np.ndarray:
        return np.array([[it**2 * (c1 + c3), -it * c1, -it * c3], [-it * c1, c1 + c2, -c2], [-it * c3, -c2, c2 + c3]])

    np.testing.assert_allclose(m.K, thesis(c1, c2, c3), rtol=1e-12)
    np.testing.assert_allclose(m.D, thesis(d1, d2, d3), rtol=1e-12)


def test_matrices_are_the_derivatives_of_the_forces() -> None:
    """Finite differences of the laws themselves around an unstretched belt; the carriage position of the elements is held."""
    model = full_rig()
    point = Point(0.3, 2.0, IT)
    m = matrices(model, point)
    rest = np.array([0.3 / IT if body.rotary else 0.3 for _, body in model.bodies()])
    rotary = np.array([body.rotary for _, body in model.bodies()])
    speeds = np.where(rotary, 2.0, 2.0 * IT)
    step = np.where(rotary, 1e-4, 1e-6)
    for i, h in enumerate(step):
        e = h * np.eye(len(step))[i]
        stiffness = -(_smooth_forces(model, rest + e, speeds) - _smooth_forces(model, rest - e, speeds)) / (2 * h)
        damping = -(_smooth_forces(model, rest, speeds + e) - _smooth_forces(model, rest, speeds - e)) / (2 * h)
        np.testing.assert_allclose(m.K[:, i], stiffness, rtol=1e-6, atol=1e-6 * np.abs(m.K).max())
        np.testing.assert_allclose(m.D[:, i], damping, rtol=1e-6, atol=1e-6 * np.abs(m.D).max())


def test_state_space_and_transfer_functions_agree() -> None:
    """(2.33) against (2.38) and (2.48)."""
    model = belt_axis()
    point = operating_point(model, 0.1)
    response = state_space(model, point).response(FREQ_HZ)
    parameters = two_mass(model, point)
    np.testing.assert_allclose(response[:, 0], parameters.torque_to_angle().response(FREQ_HZ), rtol=1e-9)
    np.testing.assert_allclose(response[:, 1], parameters.torque_to_cart().response(FREQ_HZ), rtol=1e-9)


def test_response_of_the_full_rig_solves_its_equations_of_motion() -> None:
    """(-ω² M + jω D + K) q = input."""
    model = full_rig()
    point = operating_point(model, 0.2)
    m = matrices(model, point)
    response = state_space(model, point).response(FREQ_HZ)
    for freq, row in zip(FREQ_HZ, response, strict=True):
        w = 2 * math.pi * freq
        q = np.linalg.solve(-(w**2) * m.M + 1j * w * m.D + m.K, m.input)
        np.testing.assert_allclose(row, [q[0], q[m.bodies.index("cart")]], rtol=1e-8)


def test_sampled_response_of_an_inertia_is_its_closed_form() -> None:
    """T²/(2 J) (z + 1)/(z - 1)² (effects-and-diagnosis.md, section 4), and z^-m for whole periods of delay."""
    period, freq = 1e-3, np.array([0.7, 20.0, 250.0, 480.0, 730.0])
    z = np.exp(2j * np.pi * freq * period)
    closed = period**2 / (2 * RIGID["motor.inertia"]) * (z + 1) / (z - 1) ** 2
    point = operating_point(RIGID, 0.0)
    np.testing.assert_allclose(sampled_response(RIGID, point, freq, period), closed, rtol=1e-9)
    np.testing.assert_allclose(state_space(RIGID, point).sampled(freq, period, 3 * period)[:, 0], closed * z**-3, rtol=1e-9)


@pytest.mark.parametrize("delay_s", [0.0, 0.37e-3, 1e-3, 1.62e-3])
def test_sampled_response_is_the_sum_of_the_images(delay_s: float) -> None:
    """H(e^{jωT}) = Σ_k G(jω_k) e^{-jω_k τ} (1 - e^{-jω_k T})/(jω_k T),  ω_k = ω + 2πk/T: hold, delay, plant, then sampling."""
    period, freq = 1e-3, np.array([3.0, 19.6, 107.2, 260.0, 499.0])
    model = belt_axis()
    point = operating_point(model, 0.1)
    images = freq[:, None] + np.arange(-4000, 4001) / period
    s = 2j * np.pi * images
    hold = -np.expm1(-s * period) / (s * period)
    plant = two_mass(model, point).torque_to_angle().response(images.ravel()).reshape(images.shape)
    expected = np.sum(plant * np.exp(-s * delay_s) * hold, axis=1)
    got = state_space(model, point).sampled(freq, period, delay_s)[:, 0]
    np.testing.assert_allclose(got, expected, rtol=1e-7)  # the images left out fall off with the third power of frequency


def test_modes_of_two_masses_are_their_closed_form() -> None:
    """Free masses on a spring-damper: ω² = c/μ, ζ = d/(2 √(c μ)), μ the reduced mass; motor held: ω² = c/m, ζ = d/(2 √(c m))."""
    model = belt_axis(viscous__damping=0.0, viscous_cart__damping=0.0)
    point = operating_point(model, 0.1)
    motor_mass = INERTIA / IT**2
    reduced = motor_mass * MASS / (motor_mass + MASS)
    for held, mass in (((), reduced), (("motor",), MASS)):
        (mode,) = modes(model, point, held=held)
        assert mode.freq_hz == pytest.approx(math.sqrt(C / mass) / (2 * math.pi), rel=1e-9)
        assert mode.damping_ratio == pytest.approx(D / (2 * math.sqrt(C * mass)), rel=1e-9)


def test_antiresonances_are_the_modes_with_the_motor_held() -> None:
    """Zeros of the motor's undamped response."""
    model = full_rig().with_values({"belt_sections.specific_damping": 0.0, "coupling.damping": 0.0, "viscous.damping": 0.0,
                                    "viscous_end_pulley.damping": 0.0})  # fmt: skip
    point = operating_point(model, 0.3)
    system = state_space(model, point)
    for mode in modes(model, point, held=("motor",)):
        below, above = system.response(np.array([0.999, 1.001]) * mode.freq_hz)[:, 0].real
        assert below * above < 0.0
        assert abs(system.response(mode.freq_hz)[0, 0]) < 1e-6 * abs(below)


def test_coulomb_friction_slides_without_damping() -> None:
    plain, with_friction = belt_axis(), belt_axis("coulomb", "cart_friction")
    sliding = operating_point(plain, 0.1, 1.0)
    np.testing.assert_array_equal(matrices(with_friction, sliding).D, matrices(plain, sliding).D)


@pytest.mark.parametrize("speed", [2.0, -2.0])
def test_a_level_that_falls_with_speed_is_negative_damping(monkeypatch: pytest.MonkeyPatch, speed: float) -> None:
    """force = -level sign(v), so the damping is d level/d|v|, here -0.003 N m s/rad, in both directions."""
    falling = replace(
        effect_named("coulomb"),
        law=lambda v, x, t, level: level - 0.003 * abs(v),
        slope=lambda v, x, t, level: -0.003 * math.copysign(1.0, v),
    )
    plain = belt_axis()
    expected = matrices(plain, operating_point(plain, 0.1)).D[0, 0] - 0.003
    monkeypatch.setitem(effects._BY_NAME, "coulomb", falling)
    model = belt_axis("coulomb")
    assert matrices(model, operating_point(model, 0.1, speed)).D[0, 0] == pytest.approx(expected, rel=1e-12)


def test_friction_at_standstill_refuses_sticks_or_becomes_its_describing_function() -> None:
    model = belt_axis("coulomb", "cart_friction", coulomb__level=0.0875, cart_friction__level=3.0)
    point = operating_point(model, 0.1)
    with pytest.raises(Refused, match="coulomb has no linearisation at standstill"):
        state_space(model, point)
    stuck = matrices(model, point, "stuck")
    assert stuck.bodies == ()
    assert not state_space(model, point, "stuck").response([10.0]).any()
    amplitude, omega = 0.01, 2 * math.pi * 5.0
    added = matrices(model, point, Oscillation(amplitude, omega)).D - matrices(model, operating_point(model, 0.1, 1.0)).D
    expected = [4 * 0.0875 / (math.pi * amplitude * omega), 4 * 3.0 / (math.pi * amplitude * IT * omega)]
    np.testing.assert_allclose(added, np.diag(expected), rtol=1e-9, atol=1e-12)


def test_only_bodies_with_friction_stick() -> None:
    model = belt_axis("coulomb")
    point = operating_point(model, 0.1)
    assert matrices(model, point, "stuck").bodies == ("cart",)
    assert modes(model, point, "stuck") == modes(model, operating_point(model, 0.1, 1.0), held=("motor",))


def test_equivalent_damping_dissipates_what_the_friction_dissipates() -> None:
    """Work of one period, ∮ level |v| dt = d π A² ω, for a level that falls with speed."""

    def level(speed: float) -> float:
        return 2.0 + 3.0 / (1.0 + (speed / 0.4) ** 2)

    amplitude, omega, n = 0.05, 20.0, 200_000
    speed = amplitude * omega * np.abs(np.cos(2 * math.pi * (np.arange(n) + 0.5) / n))
    work = np.mean((2.0 + 3.0 / (1.0 + (speed / 0.4) ** 2)) * speed) * 2 * math.pi / omega
    assert _equivalent_damping(level, amplitude, omega) * math.pi * amplitude**2 * omega == pytest.approx(work, rel=1e-6)


def test_equilibrium_holds_the_weight() -> None:
    """Holding torque + i_t m_c g sin α (errata 11); the belt is stretched by m_c g sin α / c towards the motor."""
    angle, weight = 0.3, MASS * 9.80665 * math.sin(0.3)
    model = belt_axis("tilt", tilt__angle=angle)
    rest = equilibrium(model, 0.25)
    assert rest.torque_nm == pytest.approx(IT * weight, rel=1e-12)
    assert rest.positions[1] == 0.25
    assert IT * rest.positions[0] - 0.25 == pytest.approx(weight / C, rel=1e-9)


def test_equilibrium_of_the_full_rig_leaves_no_force() -> None:
    model = full_rig()
    rest = equilibrium(model, 0.4)
    forces = _smooth_forces(model, rest.positions, np.zeros(4))
    forces[0] += rest.torque_nm
    np.testing.assert_allclose(forces, 0.0, atol=1e-8)
    assert rest.torque_nm == pytest.approx(IT * 11.57 * 9.80665 * math.sin(0.4), rel=1e-9)


def test_a_body_on_nothing_has_no_equilibrium() -> None:
    with pytest.raises(Refused, match="connected to nothing"):
        equilibrium(build_model("cut", ("belt_damping",), {}), 0.1)


def test_fastest_rate_is_the_resonance_of_a_lightly_damped_axis() -> None:
    model = belt_axis(viscous__damping=0.0, viscous_cart__damping=0.0)
    resonance = 2 * math.pi * two_mass(model, operating_point(model, 0.0)).resonance_hz
    assert fastest_rate(model, operating_point(model, 0.0)) == pytest.approx(resonance, rel=1e-9)


@pytest.mark.parametrize("freq_hz", [0.0, -1.0, 1000.0, math.nan])
def test_frequencies_outside_are_refused(freq_hz: float) -> None:
    with pytest.raises(UsageError, match="frequencies must be above 0 Hz"):
        sampled_response(RIGID, operating_point(RIGID, 0.0), [10.0, freq_hz], 1e-3)


def test_impossible_times_are_refused() -> None:
    with pytest.raises(UsageError, match="sampling period"):
        sampled_response(RIGID, operating_point(RIGID, 0.0), [10.0], 0.0)
    with pytest.raises(UsageError, match="amplitude and frequency above zero"):
        Oscillation(0.0, 1.0)
