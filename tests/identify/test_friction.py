"""Friction that is put in is found again; table A.10 through an own closed-loop simulation."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm.errors import DataError, UsageError
from beltcomm.identify.friction import FrictionFit, Plateau, find_plateaus, fit_friction

Array = NDArray[np.float64]
I_T = 0.01242
T_S = 1e-3
VISCOUS, COULOMB = 2.530e-3, 0.125  # table A.10, G_A


def pass_at(speed: float, torque: float, error: float = 1e-4) -> Plateau:
    return Plateau(speed, speed, torque, error, 0.0, 1.0)


def law(speed: float) -> float:
    return VISCOUS * speed + COULOMB * float(np.sign(speed))


SPEEDS = (4.0, 8.0, 20.0, 40.0, 80.0, 120.0)


def sweep(rng: np.random.Generator, repeats: int = 3, scatter: float = 2e-3, offset: float = 0.0) -> list[Plateau]:
    return [pass_at(s * v, law(s * v) + offset + scatter * rng.normal()) for _ in range(repeats) for v in SPEEDS for s in (1.0, -1.0)]


def half(fit: FrictionFit, name: str) -> float:
    width = getattr(fit, name).interval
    assert isinstance(width, float)
    return width


def simulated_sweep(seed: int = 1, tau_offset: float = 0.0) -> tuple[Array, Array, Array, Array]:
    """Rigid G_A (0.002145 kg m²: erratum 6) under a velocity PI controller, 0.05 to 1.5 m/s both ways, 6 mN m torque noise."""
    inertia, dt, per_sample = 0.002145, 1e-4, 10
    rng = np.random.default_rng(seed)
    legs = []
    for v in (0.05, 0.2, 0.6, 1.0, 1.5, 0.2, 1.0):
        for sign in (1.0, -1.0):
            ramp = np.linspace(0.0, sign * v / I_T, 150)
            legs += [ramp, np.full(700, sign * v / I_T), ramp[::-1], np.zeros(50)]
    reference = np.concatenate(legs)
    torque, position = np.empty(len(reference)), np.empty(len(reference))
    angle, speed, integral = 0.0, 0.0, 0.0
    for k, wanted in enumerate(reference.tolist()):
        error = wanted - speed
        integral += T_S * error
        tau = 0.15 * error + 3.0 * integral
        torque[k], position[k] = tau, angle
        for _ in range(per_sample):
            speed += dt * (tau - VISCOUS * speed - tau_offset) / inertia
            speed = max(abs(speed) - dt * COULOMB / inertia, 0.0) * (1.0 if speed > 0 else -1.0)
            angle += dt * speed
    count = 2 * np.pi / 65536
    return (
        np.arange(len(reference), dtype=np.float64) * T_S,
        torque + rng.normal(0, 6e-3, len(torque)),
        count * np.floor(position / count),
        reference,
    )


def test_table_a10_is_found_through_a_closed_loop() -> None:
    fit = fit_friction(find_plateaus(*simulated_sweep()))
    assert fit.viscous.value == pytest.approx(VISCOUS, abs=2 * half(fit, "viscous"))
    assert fit.coulomb.value == pytest.approx(COULOMB, abs=2 * half(fit, "coulomb"))
    assert fit.offset.value == pytest.approx(0.0, abs=2 * half(fit, "offset"))
    assert half(fit, "viscous") < 0.02 * VISCOUS
    assert half(fit, "coulomb") < 0.01 * COULOMB
    assert [p.n for p in fit.points] == [1, 2, 1, 2, 1, 1, 2, 1, 2, 1]
    assert fit.points[0].speed_rad_s == pytest.approx(-1.5 / I_T, rel=1e-3)
    assert not any("offset" in remark for remark in fit.remarks)
    assert (fit.viscous.unit, fit.viscous.side) == ("N m s/rad", "motor")


def test_gravity_is_the_half_sum_of_both_directions() -> None:
    """Torque that holds a tilted axis: + i_t m_c g sin α, here 1° of 13.44 kg: 28.6 mN m (errata 11)."""
    gravity = I_T * 13.44 * 9.81 * np.sin(np.radians(1.0))
    fit = fit_friction(find_plateaus(*simulated_sweep(tau_offset=gravity)))
    assert fit.offset.value == pytest.approx(gravity, abs=2 * half(fit, "offset"))
    assert fit.coulomb.value == pytest.approx(COULOMB, abs=2 * half(fit, "coulomb"))
    assert fit.forward is not None
    assert fit.backward is not None
    assert fit.forward[1].value - fit.backward[1].value == pytest.approx(2 * gravity, rel=0.05)
    assert any("gravity" in remark for remark in fit.remarks)


def test_without_noise_the_law_is_exact() -> None:
    fit = fit_friction([pass_at(s * v, law(s * v) + 0.01, error=0.0) for v in SPEEDS for s in (1.0, -1.0)])
    assert fit.viscous.value == pytest.approx(VISCOUS, rel=1e-9)
    assert fit.coulomb.value == pytest.approx(COULOMB, rel=1e-9)
    assert fit.offset.value == pytest.approx(0.01, rel=1e-9)
    assert fit.rms_nm < 1e-12
    np.testing.assert_allclose(fit.torque_nm(np.array([10.0, -10.0])), [law(10.0) + 0.01, law(-10.0) + 0.01], rtol=1e-9)
    assert any("no speed was repeated" in remark for remark in fit.remarks)


def test_each_direction_has_its_own_friction() -> None:
    rng = np.random.default_rng(2)
    plateaus = [
        pass_at(s * v, s * ((0.002 if s > 0 else 0.003) * v + (0.10 if s > 0 else 0.14)) + 5e-4 * rng.normal())
        for _ in range(4)
        for v in SPEEDS
        for s in (1.0, -1.0)
    ]
    fit = fit_friction(plateaus)
    for found, (viscous, coulomb) in ((fit.forward, (0.002, 0.10)), (fit.backward, (0.003, 0.14))):
        assert found is not None
        assert found[0].interval is not None
        assert found[1].interval is not None
        assert found[0].value == pytest.approx(viscous, abs=2 * found[0].interval)
        assert found[1].value == pytest.approx(coulomb, abs=2 * found[1].interval)
        assert found[1].interval < 2e-3


def test_intervals_cover() -> None:
    rng = np.random.default_rng(3)
    inside = []
    for _ in range(200):
        fit = fit_friction(sweep(rng, offset=0.02))
        inside += [
            abs(fit.viscous.value - VISCOUS) <= half(fit, "viscous"),
            abs(fit.coulomb.value - COULOMB) <= half(fit, "coulomb"),
            abs(fit.offset.value - 0.02) <= half(fit, "offset"),
        ]
    # If the three intervals of a sweep missed together: 0.95 ± 3 √(0.95 0.05/200).
    assert 0.95 - 0.046 <= np.mean(inside) <= 0.95 + 0.046


def test_repeat_scatter_is_what_the_passes_differ_by_beyond_their_own_error() -> None:
    rng = np.random.default_rng(4)
    own, between = 1e-3, 3e-3
    total = float(np.hypot(own, between))
    plateaus = [pass_at(s * v, law(s * v) + total * rng.normal(), own) for _ in range(40) for v in SPEEDS for s in (1.0, -1.0)]
    fit = fit_friction(plateaus)
    # 468 degrees of freedom: a standard deviation is known to 1/√936.
    assert fit.repeat_scatter_nm == pytest.approx(between, rel=3 * 0.033 * total**2 / between**2)
    assert all(point.n == 40 for point in fit.points)
    assert np.mean([point.scatter_nm or 0.0 for point in fit.points]) == pytest.approx(total, rel=0.1)


def test_a_long_quiet_pass_does_not_outvote_the_others() -> None:
    """Ten-fold own error at high speed, but all passes scatter by 3 mN m: then all must count nearly alike."""
    rng = np.random.default_rng(5)
    errors, plain = [], []
    for _ in range(100):
        plateaus = [
            pass_at(s * v, law(s * v) + 3e-3 * rng.normal(), 1e-5 if v < 10 else 1e-4)
            for _ in range(3)
            for v in SPEEDS
            for s in (1.0, -1.0)
        ]
        errors.append(fit_friction(plateaus).coulomb.value - COULOMB)
        speed = np.array([p.speed_rad_s for p in plateaus])
        regressor = np.stack([speed, np.sign(speed), np.ones(len(speed))], axis=1)
        plain.append(np.linalg.lstsq(regressor, np.array([p.torque_nm for p in plateaus]), rcond=None)[0][1] - COULOMB)
    assert np.std(errors) == pytest.approx(np.std(plain), rel=0.02)


def test_stribeck_effect_is_named_and_can_be_left_out() -> None:
    rng = np.random.default_rng(6)
    plateaus = [
        pass_at(s * v, law(s * v) + s * 0.05 * np.exp(-((v / 5.0) ** 2)) + 5e-4 * rng.normal())
        for _ in range(3)
        for v in (1.0, *SPEEDS)
        for s in (1.0, -1.0)
    ]
    fit = fit_friction(plateaus)
    assert any("Stribeck" in remark and "above" in remark for remark in fit.remarks)
    fast = fit_friction(plateaus, slowest_rad_s=15.0)
    assert not any("Stribeck" in remark for remark in fast.remarks)
    assert fast.coulomb.value == pytest.approx(COULOMB, abs=2 * half(fast, "coulomb"))
    assert len(fast.points) == len(fit.points)  # shown all the same


def test_passes_that_do_not_follow_are_left_out_and_named() -> None:
    plateaus = sweep(np.random.default_rng(7))
    stuck = Plateau(2.0, 0.5, 0.3, 1e-4, 0.0, 1.0)
    fit = fit_friction([*plateaus, stuck])
    assert any("2 rad/s left out" in remark for remark in fit.remarks)
    assert fit.coulomb.value == pytest.approx(fit_friction(plateaus).coulomb.value, rel=1e-12)


def test_what_the_sweep_does_not_determine_is_named() -> None:
    rng = np.random.default_rng(8)
    close = [pass_at(s * v, law(s * v) + 5e-3 * rng.normal()) for _ in range(3) for v in (10.0, 12.0) for s in (1.0, -1.0)]
    assert any("viscous friction is not determined" in remark for remark in fit_friction(close).remarks)


def test_plateaus_are_constant_without_run_in() -> None:
    t_s, torque, position, reference = simulated_sweep()
    plateaus = find_plateaus(t_s, torque, position, reference, run_in_s=0.25)
    assert [round(p.reference_rad_s * I_T, 6) for p in plateaus[:4]] == [0.05, -0.05, 0.2, -0.2]
    assert len(plateaus) == 14
    for p in plateaus:
        assert p.duration_s == pytest.approx(0.45, abs=0.005)
        inside = (t_s >= p.start_s - 0.25 + T_S) & (t_s <= p.start_s + p.duration_s)
        np.testing.assert_allclose(reference[inside], p.reference_rad_s, rtol=1e-12)
        # Loop and noise: 6 mN m over 450 samples.
        assert p.error_nm == pytest.approx(6e-3 / np.sqrt(450), rel=1.0)
        assert p.torque_nm == pytest.approx(law(p.reference_rad_s), abs=2e-3)
    # Lost rows and rows without a value are no end of a plateau.
    torque[300:310] = np.nan
    keep = np.delete(np.arange(len(t_s)), range(400, 420))
    again = find_plateaus(t_s[keep], torque[keep], position[keep], reference[keep], run_in_s=0.25)
    assert len(again) == 14
    assert again[0].torque_nm == pytest.approx(plateaus[0].torque_nm, abs=2e-3)


def test_unusable_sweeps_are_refused() -> None:
    forward = [pass_at(v, law(v)) for v in SPEEDS]
    with pytest.raises(DataError, match=r"1 direction\(s\)"):
        fit_friction(forward)
    with pytest.raises(DataError, match=r"0 passes"):
        fit_friction([])
    t_s: Array = np.arange(1000, dtype=np.float64) * T_S
    assert find_plateaus(t_s, np.zeros(1000), np.zeros(1000), np.zeros(1000)) == ()
    with pytest.raises(DataError, match="equal length"):
        find_plateaus(t_s, np.zeros(999), np.zeros(1000), np.zeros(1000))
    with pytest.raises(UsageError, match="run-in"):
        find_plateaus(t_s, np.zeros(1000), np.zeros(1000), np.zeros(1000), run_in_s=-1.0)


@pytest.mark.parametrize("seed", range(4))
def test_passes_of_a_loop_that_swings_count_at_their_mean_speed(seed: int) -> None:
    """Speeds that swing about a plateau and miss it: the inertia tells what swings them; what stands still shows nothing."""
    random, inertia, rows = np.random.default_rng(seed), 0.002145, []
    for wanted in (6.0, 20.0, 60.0, 6.0, 20.0, 60.0):
        for sign in (1.0, -1.0):
            t = np.arange(800) * T_S
            swing, hertz, phase = random.uniform(0.2, 0.5), random.uniform(0.6, 1.4), random.uniform(0.0, 2 * np.pi)
            off = random.uniform(1.2, 1.4)
            speed = sign * wanted * (off + swing * np.sin(2 * np.pi * hertz * t + phase))
            pushing = inertia * sign * wanted * swing * 2 * np.pi * hertz * np.cos(2 * np.pi * hertz * t + phase)
            rows.append((speed, VISCOUS * speed + COULOMB * np.sign(speed) + pushing, np.full(800, sign * wanted)))
            rows.append((np.zeros(100), np.zeros(100), np.zeros(100)))
    stuck = (np.where(np.arange(800) < 500, 0.0, 9.0), np.full(800, 0.05), np.full(800, 3.0))
    speed, torque, reference = (np.concatenate(parts) for parts in zip(*rows, stuck, strict=True))
    count = 2 * np.pi / 65536
    angle = count * np.round(np.cumsum(speed) * T_S / count)
    t_s, torque = np.arange(len(speed)) * T_S, torque + random.normal(0.0, 6e-3, len(torque))
    passes = find_plateaus(t_s, torque, angle, reference, inertia_kg_m2=inertia)
    assert [p.shows_friction for p in passes] == [True] * 12 + [False]
    fit = fit_friction(passes)
    assert fit.viscous.value == pytest.approx(VISCOUS, rel=0.03)
    assert fit.coulomb.value == pytest.approx(COULOMB, rel=0.02)
    assert any("swung" in remark for remark in fit.remarks)
    assert not any(p.shows_friction for p in find_plateaus(t_s, torque, angle, reference) if not p.reached_speed)
