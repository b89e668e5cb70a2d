"""Transfer functions of the two-mass model against each other and against the thesis's numbers."""

from __future__ import annotations

import numpy as np
import pytest

from beltcomm.errors import UsageError
from beltcomm.model import build_model
from beltcomm.model.linear import Oscillation, operating_point
from beltcomm.model.transfer import TransferFunction, TwoMass, two_mass

#: Table A.4 (G_A) with the belt damping of A.11, and A.11 (S_A).
G_A = TwoMass(71.73e-6, 13.44, 203740.0, 33.17, 226.42, 20.0, 0.01242)
S_A = TwoMass(44.9e-6, 10.0, 200000.0, 100.0, 100.0, 20.0, 0.01242)
FREQ_HZ = np.geomspace(0.1, 5000.0, 300)
both = pytest.mark.parametrize("plant", [G_A, S_A], ids=["G_A", "S_A"])


@both
def test_full_form_solves_the_equations_of_motion(plant: TwoMass) -> None:
    """(2.25) in the Laplace domain: two equations with d_m at the motor shaft, solved for φ and ξ; (2.38), (2.48), (2.49)."""
    i, c, d = plant.transmission_m_rad, plant.stiffness_n_m, plant.belt_damping_n_s_m
    dm = i**2 * plant.motor_damping_n_s_m
    for freq in (0.3, 19.0, 107.0, 900.0):
        s = 2j * np.pi * freq
        belt = c + d * s
        left = [
            [plant.inertia_kg_m2 * s**2 + dm * s + i**2 * belt, -i * belt],
            [-i * belt, plant.mass_kg * s**2 + plant.cart_damping_n_s_m * s + belt],
        ]
        angle, cart = np.linalg.solve(left, [1.0, 0.0])
        assert plant.torque_to_angle().response(freq)[0] == pytest.approx(angle, rel=1e-9)
        assert plant.torque_to_cart().response(freq)[0] == pytest.approx(cart, rel=1e-9)
        assert plant.angle_to_cart().response(freq)[0] == pytest.approx(cart / angle, rel=1e-9)


@both
def test_product_form_is_low_times_high_times_chi(plant: TwoMass) -> None:
    """(2.42) = (2.40) (2.41) χ with χ = c (Θ_e + i_t² m_c)/m_c."""
    total = plant.inertia_kg_m2 + plant.transmission_m_rad**2 * plant.mass_kg
    chi = plant.stiffness_n_m * total / plant.mass_kg
    product = plant.low_frequency().response(FREQ_HZ) * plant.high_frequency().response(FREQ_HZ) * chi
    np.testing.assert_allclose(plant.product_form().response(FREQ_HZ), product, rtol=1e-10)


def product_error(plant: TwoMass) -> tuple[float, float]:
    """(ã_2e, ã_3e): what the denominator of (2.42) has more than that of (2.39).

    ã_2e = i_t² (i_t² m_c d_m² + Θ_e d_c²)/(Θ_e + i_t² m_c),   ã_3e = i_t² (d_m + d_c) Θ_e m_c/(Θ_e + i_t² m_c)

    Source: (2.43).  The thesis prints ã_2e as i_t² (d_m + d_c)(i_t² m_c d_m + Θ_e d_c)/(Θ_e + i_t² m_c), which contains
    the i_t² d_m d_c that (2.39f) has already.
    """
    it2, dm, dc, m, j = plant.transmission_m_rad**2, plant.motor_damping_n_s_m, plant.cart_damping_n_s_m, plant.mass_kg, plant.inertia_kg_m2
    total = j + it2 * m
    return it2 * (it2 * m * dm**2 + j * dc**2) / total, it2 * (dm + dc) * j * m / total


@both
def test_product_form_differs_from_the_undamped_belt_by_exactly_its_error_terms(plant: TwoMass) -> None:
    """Denominator of (2.42) minus that of (2.39) is ã_3e s³ + ã_2e s²  (2.43); the numerators are the same."""
    product, plain = plant.product_form(), plant.torque_to_angle_without_belt_damper()
    second, third = product_error(plant)
    assert product.num == plain.num
    difference = np.subtract(product.den, plain.den)
    np.testing.assert_allclose(difference, [0.0, third, second, 0.0, 0.0], rtol=1e-9, atol=1e-13)


def test_printed_error_term_counts_one_product_twice() -> None:
    """(2.43a) as printed is larger than the true error by i_t² d_m d_c."""
    it2, dm, dc = G_A.transmission_m_rad**2, G_A.motor_damping_n_s_m, G_A.cart_damping_n_s_m
    total = G_A.inertia_kg_m2 + it2 * G_A.mass_kg
    printed = it2 * (dm + dc) / total * (it2 * G_A.mass_kg * dm + G_A.inertia_kg_m2 * dc)
    assert printed - product_error(G_A)[0] == pytest.approx(it2 * dm * dc, rel=1e-9)


@both
def test_approximations_are_exact_in_their_limits(plant: TwoMass) -> None:
    """(2.40) and (2.41) against (2.39): the error vanishes with the first power of s and of 1/s."""
    full = plant.torque_to_angle_without_belt_damper()
    for approximation, near, far in ((plant.low_frequency(), 1e-3, 1e-2), (plant.high_frequency(), 1e6, 1e5)):
        small, large = np.abs(approximation.response([near, far]) / full.response([near, far]) - 1.0)
        assert large < 1e-3
        assert large / small == pytest.approx(10.0, rel=0.01)


def test_characteristic_numbers_of_g_a() -> None:
    """thesis.md, section 3; (2.46), (2.47) from table A.4: i_t² m_c + Θ_e = 0.002145 kg m² (errata 6)."""
    assert G_A.resonance_hz == pytest.approx(107.16, abs=0.005)
    assert G_A.antiresonance_hz == pytest.approx(19.60, abs=0.005)
    assert (1.0 + G_A.inertia_ratio) * 71.73e-6 == pytest.approx(0.002145, abs=5e-7)


def test_coefficients_stand_in_descending_powers() -> None:
    assert TransferFunction((2.0, 3.0), (1.0, 0.0)).response(1.0)[0] == pytest.approx(2.0 + 3.0 / (2j * np.pi))


def test_a_model_gives_its_parameters_back() -> None:
    """d_m: 33.17 N s/m at the belt is stored as i_t² 33.17 N m s/rad (errata 1)."""
    values = {"motor.inertia": 71.73e-6, "cart.mass": 13.44, "transmission.ratio": 0.01242, "belt_stiffness.stiffness": 203740.0,
              "belt_damping.damping": 20.0, "viscous.damping": 5.1167e-3, "viscous_cart.damping": 226.42}  # fmt: skip
    effects = ("belt_stiffness", "belt_damping", "viscous", "viscous_cart", "tilt")
    model = build_model("g_a", effects, values)
    got = two_mass(model, operating_point(model, 0.2))
    np.testing.assert_allclose(list(vars(got).values()), list(vars(G_A).values()), rtol=1e-5)


def test_position_dependent_stiffness_is_taken_at_the_point() -> None:
    """(2.26) at l1 = 0.55 m."""
    values = {"belt_spans.specific_stiffness": 106250.0, "belt_spans.pulley_distance": 0.79,
              "belt_spans.offset": 0.05}  # fmt: skip
    model = build_model("x", ("belt_spans",), values)
    c1, c2, c3 = 106250.0 / 0.55, 106250.0 / 0.24, 106250.0 / 0.79
    assert two_mass(model, operating_point(model, 0.5)).stiffness_n_m == pytest.approx(c1 + c2 * c3 / (c2 + c3), rel=1e-12)


def test_describing_function_shows_friction_as_damping() -> None:
    """Errata 7: an FRF around standstill sees Coulomb friction of 0.125 N m as 40 mN m s/rad, here at 4 rad/s peak speed."""
    model = build_model("g_a", ("belt_stiffness", "coulomb"), {"coulomb.level": 0.125, "transmission.ratio": 0.01242})
    got = two_mass(model, operating_point(model, 0.2), Oscillation(0.04, 100.0))
    assert 0.01242**2 * got.motor_damping_n_s_m == pytest.approx(4 * 0.125 / (np.pi * 4.0), rel=1e-9)


@pytest.mark.parametrize("effects", [("belt_sections",), ("belt_stiffness", "coupling"), ("belt_damping",)])
def test_other_structures_are_refused(effects: tuple[str, ...]) -> None:
    model = build_model("other", effects, {})
    with pytest.raises(UsageError, match="not a motor and a carriage on one belt spring"):
        two_mass(model, operating_point(model, 0.2))


def test_a_stuck_body_is_not_a_two_mass_axis() -> None:
    model = build_model("stuck", ("belt_stiffness", "coulomb"), {})
    with pytest.raises(UsageError, match="free bodies are cart"):
        two_mass(model, operating_point(model, 0.2), "stuck")
