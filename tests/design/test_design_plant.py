"""The design plant against the thesis's polynomials, published frequencies and an independent sampling formula."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from beltcomm.design.design_plant import DesignPlant, with_friction_fractions
from beltcomm.errors import UsageError

PERIOD = 1e-3
RATIO = 0.01242
#: Tables A.4 and A.11; d_m is printed in N s/m at the belt (errata 1).
G_A = DesignPlant(71.73e-6, RATIO, 13.44, 203.74e3, 33.17 * RATIO**2, 226.42, 0.0, 1e-3)
S_A = DesignPlant(44.90e-6, RATIO, 10.0, 200e3, 100.0 * RATIO**2, 100.0, 20.0, 1e-3)
OMEGA = np.array([0.5, 5.0, 40.0, 123.0, 400.0, 673.0, 900.0, 2000.0, 3100.0])


def polynomials_2_38(plant: DesignPlant) -> tuple[list[float], list[float]]:
    """(2.38b-h), dampings in N s/m at the belt."""
    theta, i2, m, c = plant.inertia_kg_m2, plant.transmission_m_rad**2, plant.mass_kg, plant.stiffness_n_m
    d, dc, dm = plant.belt_damping_ns_m, plant.cart_damping_ns_m, plant.motor_damping_nm_s_rad / i2
    a1 = i2 * c * (dc + dm)
    a2 = c * (theta + i2 * m) + i2 * (d * dm + d * dc + dm * dc)
    a3 = i2 * m * (d + dm) + theta * (d + dc)
    return [m, d + dc, c], [m * theta, a3, a2, a1, 0.0]


@pytest.mark.parametrize(
    ("theta", "mass", "stiffness", "resonance_hz", "antiresonance_hz"),
    [
        (71.73e-6, 13.44, 203.74e3, 107.16, 19.60),
        (71.73e-6, 0.96, 222.39e3, 134.10, 76.60),
        (44.90e-6, 10.0, 200e3, 133.83, 22.51),
    ],
)
def test_frequencies_are_those_recomputed_in_the_thesis_sheet(
    theta: float, mass: float, stiffness: float, resonance_hz: float, antiresonance_hz: float
) -> None:
    plant = DesignPlant(theta, RATIO, mass, stiffness)
    assert plant.resonance_rad_s / (2.0 * np.pi) == pytest.approx(resonance_hz, abs=0.005)
    assert plant.antiresonance_rad_s / (2.0 * np.pi) == pytest.approx(antiresonance_hz, abs=0.005)


def test_effective_inertia_of_g_a_is_that_of_errata_6() -> None:
    assert G_A.total_inertia_kg_m2 == pytest.approx(0.002145, abs=5e-7)
    # Errata 7: i_t² (d_m + d_c) of the frequency response is 40 mN m s/rad.
    assert G_A.friction_damping_nm_s_rad == pytest.approx(0.040, abs=5e-4)


@pytest.mark.parametrize("plant", [G_A, S_A], ids=["G_A", "S_A"])
def test_state_space_is_2_38(plant: DesignPlant) -> None:
    A, B = plant.state_space()
    numerator, denominator = polynomials_2_38(plant)
    _, expected = signal.freqs(numerator, denominator, OMEGA)
    measured = [np.linalg.solve(1j * w * np.eye(4) - A, B)[0] for w in OMEGA]
    np.testing.assert_allclose(measured, expected, rtol=1e-8)


def test_continuous_response_is_2_42_with_the_error_terms_2_43_and_the_dead_time() -> None:
    theta, i2, m, c = G_A.inertia_kg_m2, RATIO**2, G_A.mass_kg, G_A.stiffness_n_m
    dm, dc = 33.17, 226.42
    total = theta + i2 * m
    a3_error = i2 * (dm + dc) * theta * m / total
    a2_error = i2 * (dm + dc) / total * (i2 * m * dm + theta * dc)
    # (2.39), d = 0, plus (2.43).
    denominator = [
        m * theta,
        i2 * m * dm + theta * dc + a3_error,
        c * total + i2 * dm * dc + (a2_error - i2 * dm * dc),
        i2 * c * (dm + dc),
        0.0,
    ]
    _, expected = signal.freqs([m, dc, c], denominator, OMEGA)
    np.testing.assert_allclose(G_A.continuous_response(OMEGA), expected * np.exp(-1j * OMEGA * 1e-3), rtol=1e-9)


@pytest.mark.parametrize("dead_time", [0.0, 0.4e-3, 1e-3, 2.7e-3])
@pytest.mark.parametrize("plant", [G_A, S_A], ids=["G_A", "S_A"])
def test_sampled_response_is_the_sum_over_the_aliases(plant: DesignPlant, dead_time: float) -> None:
    """G*(jω) = (1/T) Σ_k G(jω + jk 2π/T) (1 − exp(−sT))/s exp(−s dead time); terms fall as 1/k³."""
    numerator, denominator = polynomials_2_38(plant)
    k = np.arange(-4000, 4001)
    s = 1j * (OMEGA[:, None] + 2.0 * np.pi / PERIOD * k)
    plant_response = np.polyval(numerator, s) / np.polyval(denominator, s)
    terms = plant_response * (1.0 - np.exp(-s * PERIOD)) / s * np.exp(-s * dead_time)
    expected = terms.sum(axis=1) / PERIOD
    measured = replace(plant, dead_time_s=dead_time).sampled_response(OMEGA, PERIOD)
    np.testing.assert_allclose(measured, expected, rtol=2e-6)


def test_whole_periods_of_dead_time_are_pure_shifts() -> None:
    without = replace(G_A, dead_time_s=0.0).sampled_response(OMEGA, PERIOD)
    shifted = replace(G_A, dead_time_s=3e-3).sampled_response(OMEGA, PERIOD)
    np.testing.assert_allclose(shifted, without * np.exp(-3j * OMEGA * PERIOD), rtol=1e-8)


@pytest.mark.parametrize(
    "plant", [replace(G_A, cart_damping_ns_m=0.0, belt_damping_ns_m=20.0), replace(S_A, motor_damping_nm_s_rad=2e-3), G_A]
)
def test_resonance_damping_is_that_of_the_poles(plant: DesignPlant) -> None:
    """First order in the damping: within 2 % of the exact pole for ratios up to 6 %."""
    poles = np.roots(polynomials_2_38(plant)[1])
    pole = poles[np.argmax(np.abs(poles))]
    assert plant.resonance_damping == pytest.approx(-pole.real / abs(pole), rel=0.02)


def test_friction_fractions_scale_friction_and_leave_the_belt_damper() -> None:
    none, half = with_friction_fractions(replace(S_A, name="far end"), (0.0, 0.5))
    assert (none.motor_damping_nm_s_rad, none.cart_damping_ns_m, none.belt_damping_ns_m) == (0.0, 0.0, 20.0)
    assert half.friction_damping_nm_s_rad == pytest.approx(0.5 * S_A.friction_damping_nm_s_rad)
    assert half.name == "far end, 50 % of the damping seen at standstill"


@pytest.mark.parametrize(
    ("field", "value"), [("mass_kg", 0.0), ("stiffness_n_m", -1.0), ("inertia_kg_m2", float("nan")), ("dead_time_s", -1e-3)]
)
def test_impossible_plants_are_refused_by_name(field: str, value: float) -> None:
    with pytest.raises(UsageError, match=field):
        replace(G_A, **{field: value})  # type: ignore[arg-type]
