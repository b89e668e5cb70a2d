"""Published plants are found again; the transfer functions are compared with scipy's, the intervals with repetition."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm.errors import DataError, UsageError
from beltcomm.identify.magnitude_fit import FRICTION_BIAS, Solver, _product_form, fit_magnitude
from beltcomm.response import FrequencyResponse

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
I_T = 0.01242
T_S = 1e-3
#: Lines of a PRBS of order 9, clock 2 at 1 kHz below the spectrum zero.
FREQ: Array = np.arange(1, 480, dtype=np.float64) / 1.022


def theta(inertia: float, mass: float, stiffness: float, d_m: float, d_c: float) -> dict[str, float]:
    return {
        "inertia_kg_m2": inertia,
        "mass_kg": mass,
        "stiffness_n_m": stiffness,
        "motor_damping_n_s_m": d_m,
        "cart_damping_n_s_m": d_c,
    }


G_A = theta(71.73e-6, 13.44, 203.74e3, 33.17, 226.42)  # table A.4
G_B = theta(71.73e-6, 0.96, 222.39e3, 0.01, 53.70)  # table A.5
S_A = theta(44.9e-6, 10.0, 200e3, 100.0, 100.0)  # table A.11
S_B = theta(44.9e-6, 1.0, 200e3, 100.0, 100.0)  # table A.12
#: f_r, f_z recomputed from the published parameters: thesis.md, section 3.
NUMBERS = [(G_A, 107.16, 19.60), (G_B, 134.10, 76.60), (S_A, 133.83, 22.51)]


def response(h: ComplexArray, noise: Array | float = 0.0, freq_hz: Array = FREQ) -> FrequencyResponse:
    return FrequencyResponse(freq_hz, h, np.full(len(h), noise) + 0.0, np.ones(len(h)), 8, T_S)


def two_factors(p: Mapping[str, float]) -> tuple[Array, Array]:
    """Numerator and denominator of (2.42) as χ (2.40) (2.41), multiplied out by numpy."""
    j, m, c, d_m, d_c = (p[name] for name in theta(0, 0, 0, 0, 0))
    total = j + I_T**2 * m
    low = np.array([m, d_c, c]) / c, np.array([total, I_T**2 * (d_m + d_c), 0.0])
    high = np.array([m]), np.array([m * j, I_T**2 * m * d_m + j * d_c, c * total])
    chi = c * total / m
    return chi * np.polymul(low[0], high[0]), np.polymul(low[1], high[1])


@pytest.mark.parametrize("p", [G_A, G_B, S_A, S_B])
def test_product_form_is_the_product_of_its_two_approximations(p: dict[str, float]) -> None:
    num, den = two_factors(p)
    s = 2j * np.pi * FREQ
    np.testing.assert_allclose(_product_form(FREQ, p, I_T), np.polyval(num, s) / np.polyval(den, s), rtol=1e-12)


@pytest.mark.parametrize("solver", ["lm", "trf", "nelder-mead"])
@pytest.mark.parametrize(("p", "f_r", "f_z"), NUMBERS)
def test_published_plants_are_found_again(p: dict[str, float], f_r: float, f_z: float, solver: Solver) -> None:
    fit = fit_magnitude(response(_product_form(FREQ, p, I_T)), I_T, p["inertia_kg_m2"], solver=solver)
    for name, value in p.items():
        assert fit.parameters[name].value == pytest.approx(value, rel=1e-5), name
    assert fit.two_mass.resonance_hz == pytest.approx(f_r, abs=0.006)
    assert fit.two_mass.antiresonance_hz == pytest.approx(f_z, abs=0.006)
    assert fit.names == ("mass_kg", "stiffness_n_m", "motor_damping_n_s_m", "cart_damping_n_s_m")
    assert fit.parameters["inertia_kg_m2"].interval is None
    assert fit.solver == solver
    assert fit.rms_db < 1e-6


@pytest.mark.parametrize("solver", ["lm", "trf"])
@pytest.mark.parametrize("p", [G_A, S_B])
def test_inertia_is_found_as_well(p: dict[str, float], solver: Solver) -> None:
    fit = fit_magnitude(response(_product_form(FREQ, p, I_T)), I_T, None, solver=solver)
    for name, value in p.items():
        assert fit.parameters[name].value == pytest.approx(value, rel=1e-5), name
    assert fit.freq_hz[-1] == pytest.approx(200.0, abs=1.0)


def test_start_values_do_not_depend_on_the_rig() -> None:
    """Axes drawn over decades of size; noise-free, so every miss is a wrong start."""
    rng = np.random.default_rng(11)
    missed = []
    for _ in range(40):
        inertia = 10 ** rng.uniform(-5, -2)
        ratio = 10 ** rng.uniform(-2.5, -1)
        f_z = 10 ** rng.uniform(np.log10(5), np.log10(90))
        kappa = rng.uniform(1.3, min(8.0, 170.0 / f_z)) ** 2 - 1
        mass = kappa * inertia / ratio**2
        stiffness = mass * (2 * np.pi * f_z) ** 2
        d_c = 2 * 10 ** rng.uniform(-2.3, -0.7) * np.sqrt(mass * stiffness)
        p = theta(inertia, mass, stiffness, d_c * rng.uniform(0.05, 1.0), d_c)
        fit = fit_magnitude(response(_product_form(FREQ, p, ratio)), ratio, inertia)
        inside = all(fit.parameters[n].low < p[n] < fit.parameters[n].high for n in fit.names)
        if inside and abs(fit.parameters["mass_kg"].value / mass - 1) > 1e-4:
            missed.append(p)
    assert not missed


def test_a_parameter_at_its_bound_is_named() -> None:
    """Thesis.md, erratum 8: d_m = 0.01 N s/m of table A.5 is its lower bound."""
    rng = np.random.default_rng(12)
    h = _product_form(FREQ, G_B, I_T)
    noise = 0.03 * np.abs(h)
    h = h + noise * (rng.normal(size=len(h)) + 1j * rng.normal(size=len(h))) / np.sqrt(2)
    for solver in ("lm", "trf", "nelder-mead"):
        fit = fit_magnitude(response(h, noise), I_T, G_B["inertia_kg_m2"], solver=solver)
        d_m = fit.parameters["motor_damping_n_s_m"]
        assert any("motor_damping_n_s_m" in remark and "not determined" in remark for remark in fit.remarks)
        assert d_m.interval is not None
        assert d_m.value - d_m.interval <= 0.01 <= d_m.value + d_m.interval
        # The others are told apart from it all the same.
        for name in ("mass_kg", "stiffness_n_m", "cart_damping_n_s_m"):
            item = fit.parameters[name]
            assert item.interval is not None
            assert 0 < item.interval < 0.1 * item.value
            assert abs(item.value - G_B[name]) < 2 * item.interval


def test_intervals_cover_and_all_solvers_agree() -> None:
    rng = np.random.default_rng(13)
    h = _product_form(FREQ, S_B, I_T)
    noise = 0.05 * np.abs(h)
    inside = []
    for k in range(100):
        noisy = h + noise * (rng.normal(size=len(h)) + 1j * rng.normal(size=len(h))) / np.sqrt(2)
        fit = fit_magnitude(response(noisy, noise), I_T, S_B["inertia_kg_m2"])
        for name in fit.names:
            item = fit.parameters[name]
            assert item.interval is not None
            inside.append(abs(item.value - S_B[name]) <= item.interval)
        assert fit.rms_db == pytest.approx(fit.noise_db, rel=0.4)
        if k == 0:
            other = fit_magnitude(response(noisy, noise), I_T, S_B["inertia_kg_m2"], solver="nelder-mead")
            for name in fit.names:
                assert other.parameters[name].value == pytest.approx(fit.parameters[name].value, rel=1e-4)
    # If the four intervals of one fit missed together, 100 fits would still give 0.95 ± 3 √(0.95 0.05/100).
    assert 0.95 - 0.065 <= np.mean(inside) < 1.0


def test_friction_bias_is_always_said_and_a_misfit_widens_the_intervals() -> None:
    h = _product_form(FREQ, S_B, I_T)
    clean = fit_magnitude(response(h, 1e-3 * np.abs(h)), I_T, S_B["inertia_kg_m2"])
    assert FRICTION_BIAS in clean.remarks
    # A mode that the model does not have: 20 % at 60 Hz.
    bent = h * (1 + 0.2 / (1 + ((FREQ - 60.0) / 10.0) ** 2))
    fit = fit_magnitude(response(bent, 1e-3 * np.abs(h)), I_T, S_B["inertia_kg_m2"])
    assert any("misses the response" in remark for remark in fit.remarks)
    wide, narrow = fit.parameters["mass_kg"].interval, clean.parameters["mass_kg"].interval
    assert wide is not None
    assert narrow is not None
    assert wide > 100 * max(narrow, 1e-12)


def test_a_record_below_the_resonance_does_not_determine_the_stiffness() -> None:
    """Up to 18 Hz G_B is one rigid mass: its antiresonance lies at 76.6 Hz."""
    low = FREQ[FREQ < 18.0]
    rng = np.random.default_rng(14)
    h = _product_form(low, G_B, I_T)
    noise = 0.03 * np.abs(h)
    h = h + noise * (rng.normal(size=len(h)) + 1j * rng.normal(size=len(h))) / np.sqrt(2)
    fit = fit_magnitude(response(h, noise, low), I_T, G_B["inertia_kg_m2"])
    words = " ".join(fit.remarks)
    assert "antiresonance of the fit" in words
    assert "stiffness_n_m is a guess" in words
    mass = fit.parameters["mass_kg"]
    assert mass.interval is not None
    assert mass.interval < 0.3 * mass.value
    # Without the motor's inertia only the sum of both is seen.
    free = fit_magnitude(response(h, noise, low), I_T, None)
    assert any("inertia_kg_m2 is not determined" in remark or "inertia_kg_m2 is a guess" in remark for remark in free.remarks)
    total = free.two_mass.inertia_kg_m2 + I_T**2 * free.two_mass.mass_kg
    assert total == pytest.approx(G_B["inertia_kg_m2"] + I_T**2 * G_B["mass_kg"], rel=0.1)


@pytest.mark.examination
def test_correlations_are_those_of_repetition() -> None:
    rng = np.random.default_rng(15)
    h = _product_form(FREQ, S_A, I_T)
    noise = 0.05 * np.abs(h)
    values = []
    for _ in range(80):
        noisy = h + noise * (rng.normal(size=len(h)) + 1j * rng.normal(size=len(h))) / np.sqrt(2)
        fit = fit_magnitude(response(noisy, noise), I_T, None)
        values.append([fit.parameters[name].value for name in fit.names])
    seen = np.corrcoef(np.log(np.array(values)).T)
    # Fisher: the correlation of 80 repetitions is known to ± 3/√77 of its z.
    np.testing.assert_allclose(np.arctanh(seen - np.eye(5)), np.arctanh(fit.correlation - np.eye(5)), atol=3 / np.sqrt(77))


def test_unusable_requests_are_refused() -> None:
    good = response(_product_form(FREQ, S_B, I_T))
    with pytest.raises(DataError, match=r"lines with noise below 50% .* 10 are needed"):
        fit_magnitude(good.lines(np.flatnonzero((FREQ >= 20.0) & (FREQ <= 25.0))), I_T, 44.9e-6)
    with pytest.raises(DataError, match="0 lines"):
        fit_magnitude(good.lines(np.flatnonzero(FREQ > 200.5)), I_T, 44.9e-6)
    with pytest.raises(UsageError, match="positive"):
        fit_magnitude(good, -I_T, 44.9e-6)
    with pytest.raises(UsageError, match="solver"):
        fit_magnitude(good, I_T, 44.9e-6, solver="simplex")  # type: ignore[arg-type]


def standing_axis_response(peak_to_peak_nm: float) -> FrequencyResponse:
    """G_A with its real friction excited around standstill, own simulation at 20 kHz and own estimate.

    Friction of A.10 shared as in run-folder.md; friction as an impulse that stops but never reverses a body.
    """
    j, m, c, d = 71.73e-6, 13.44, 203.74e3, 20.0
    level_m, viscous, level_c = 0.7 * 0.125, 2.53e-3, 0.3 * 0.125 / I_T
    dt, per_sample, n_periods, n = 5e-5, 20, 4, 1020
    bits = np.random.default_rng(16).permutation(np.repeat([0.0, 1.0], n // 4))
    torque = np.tile(peak_to_peak_nm * (np.repeat(bits, 2) - 0.5), n_periods + 1)  # clock 2, mean zero, one period of run-in
    angle, speed, x, v = 0.0, 0.0, 0.0, 0.0
    position = np.empty(len(torque))
    for k, tau in enumerate(torque.tolist()):
        position[k] = angle
        for _ in range(per_sample):
            force = c * (I_T * angle - x) + d * (I_T * speed - v)
            speed += dt * (tau - viscous * speed - I_T * force) / j
            v += dt * force / m
            speed = max(abs(speed) - dt * level_m / j, 0.0) * (1.0 if speed > 0 else -1.0)
            v = max(abs(v) - dt * level_c / m, 0.0) * (1.0 if v > 0 else -1.0)
            angle += dt * speed
            x += dt * v
    freq: Array = np.fft.rfftfreq(n, T_S).astype(np.float64)
    u = np.fft.rfft(torque[n:].reshape(n_periods, n), axis=1)
    y = np.fft.rfft(np.diff(position)[n - 1 :].reshape(n_periods, n), axis=1)
    lines = np.flatnonzero(np.abs(u[0]) > 0.1 * np.abs(u[0]).max())
    z = np.exp(2j * np.pi * freq[lines] * T_S)
    per_period = (y[:, lines] / u[:, lines]) * z / (z - 1)
    noise = per_period.std(axis=0, ddof=1) / np.sqrt(n_periods)
    return FrequencyResponse(freq[lines], per_period.mean(axis=0), noise, np.ones(len(lines)), n_periods, T_S)


def test_standstill_friction_poses_as_damping() -> None:
    """Thesis.md, erratum 7: 2.53 mN m s/rad on the moving axis, 16 times as much in the response around standstill.

    How much depends on the excitation: Coulomb friction is an ever smaller damping to a larger motion.
    """
    apparent = []
    for peak_to_peak_nm in (0.3, 0.6):
        fit = fit_magnitude(standing_axis_response(peak_to_peak_nm), I_T, 71.73e-6)
        model = fit.two_mass
        apparent.append(I_T**2 * (model.motor_damping_n_s_m + model.cart_damping_n_s_m))
        assert model.resonance_hz == pytest.approx(107.16, rel=0.05)
        assert any("misses the response" in remark for remark in fit.remarks)
    assert apparent[0] > 10 * 2.53e-3
    assert apparent[1] < 0.5 * apparent[0]
