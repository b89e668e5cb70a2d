"""Draws of the parameters judged all at once: against the single calculation, against what a simulation does, against the law asked for."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.special import stdtrit
from threadpoolctl import ThreadpoolController

from beltcomm.control import Cascade, Prefilter
from beltcomm.design import design_plant
from beltcomm.design.design_plant import DesignPlant, sample_plants
from beltcomm.design.margins import Margins, margins
from beltcomm.design.spread import _responses_together, margin_spread
from beltcomm.design.structure import Bodies
from beltcomm.errors import UsageError
from beltcomm.fit.uncertainty.draws import joint_draws, share_within_bounds
from design.closed_loop import PERIOD, growth_per_second, run

RATIO = 0.01242
G_A = DesignPlant(71.73e-6, RATIO, 13.44, 203.74e3, 2.53e-3, 0.0, 20.0, 1e-3, "G_A")
LOOP_A = Cascade(0.085, 0.44, 14.2, 0.004, Prefilter("butterworth", 123.27))
#: Motor, carriage and end pulley of the rig, belt sections beside each other.
THREE = replace(
    G_A,
    bodies=Bodies(
        ("motor", "cart", "end_pulley"),
        (71.73e-6, 13.44, 0.153),
        ((20.0 * RATIO**2, -20.0 * RATIO, 0.0), (-20.0 * RATIO, 25.0, -5.0), (0.0, -5.0, 5.0)),
        (
            (0.45e6 * RATIO**2, -0.3e6 * RATIO, -0.15e6 * RATIO),
            (-0.3e6 * RATIO, 0.5e6, -0.2e6),
            (-0.15e6 * RATIO, -0.2e6, 0.35e6),
        ),
    ),
)


@pytest.mark.parametrize("plant", [G_A, replace(G_A, motor_damping_nm_s_rad=0.0, dead_time_s=1.4e-3), THREE], ids=["two", "free", "three"])
def test_responses_together_are_the_single_ones(plant: DesignPlant) -> None:
    """Through poles and a numerator instead of a matrix inverse, also with a double pole at 1: to 1e-8 from 0.3 rad/s up to π/T."""
    omega = np.geomspace(0.3, 0.999 * math.pi / PERIOD, 60)
    together = _responses_together(*sample_plants([plant, plant], PERIOD), np.array([omega, omega[::-1]]), PERIOD)
    alone = plant.sampled_response(omega, PERIOD)
    np.testing.assert_allclose(together[0], alone, rtol=1e-8)
    np.testing.assert_allclose(together[1][::-1], alone, rtol=1e-8)


def test_plants_are_sampled_in_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two for a matrix of five rows wait for each other where other processes work too: a hundred times as long."""
    pools, threads = ThreadpoolController().select(user_api="blas"), set()

    def seen(matrices: np.ndarray) -> np.ndarray:
        threads.update(pool["num_threads"] for pool in pools.info())
        return expm(matrices)

    monkeypatch.setattr(design_plant, "expm", seen)
    with pools.limit(limits=2):
        assert {pool["num_threads"] for pool in pools.info()} == {2}
        sample_plants([G_A, G_A], PERIOD)
    assert threads == {1}


def uncertain(count: int, deviation: float, seed: int = 1) -> list[list[DesignPlant]]:
    """Mass, stiffness and dead time off by so many per cent, normal; two dampings each."""
    random = np.random.default_rng(seed)
    draws = []
    for mass, stiffness, late in np.exp(deviation * random.standard_normal((count, 3))):
        plant = replace(G_A, mass_kg=13.44 * mass, stiffness_n_m=203.74e3 * stiffness, dead_time_s=1e-3 * late)
        draws.append([plant, replace(plant, motor_damping_nm_s_rad=0.0)])
    return draws


def test_the_spread_is_that_of_the_single_margins() -> None:
    """On the coarse grid each draw is within 0.2 deg and 0.2 dB of its proof; the quantiles are those of the proof."""
    draws = uncertain(41, 0.1)
    spread = margin_spread(draws, LOOP_A, PERIOD)
    exact = [margins(LOOP_A, plants, PERIOD) for plants in draws]

    def worst(of: tuple[Margins, ...]) -> tuple[float, float, float, float]:
        return (
            min(m.phase_margin_deg for m in of),
            min(m.position_phase_margin_deg for m in of),
            min(min(m.gain_margin_db, m.position_gain_margin_db) for m in of),
            max(max(m.sensitivity_db, m.position_sensitivity_db) for m in of),
        )

    table = np.array([worst(of) for of in exact]).T
    found = (spread.phase_margin_deg, spread.position_phase_margin_deg, spread.gain_margin_db, spread.sensitivity_db)
    for coarse, fine in zip(found, table, strict=True):
        np.testing.assert_allclose(coarse, fine, atol=0.2)
    assert spread.unstable == sum(not (m.stable and m.velocity_stable) for of in exact for m in of) == 0
    # The second of 41 sorted values: 2.5 % of 40 steps.
    assert spread.worst_values["phase_margin_deg"] == pytest.approx(np.sort(table[0])[1], abs=0.2)
    assert spread.worst_values["sensitivity_db"] == pytest.approx(np.sort(table[3])[-2], abs=0.05)
    assert spread.worst.name == "G_A"
    assert (spread.draws, spread.plants) == (41, 2)


def test_unstable_draws_are_counted_as_the_simulation_counts_them() -> None:
    """A loop near its edge, on plants 30 % off: some of them are unstable, exactly those whose simulated angle grows."""
    edgy = replace(LOOP_A, kpp_1_s=2.6 * LOOP_A.kpp_1_s)
    draws = uncertain(4, 0.3, seed=5)
    growing = 0
    for plant in (plant for draw in draws for plant in draw):
        late = round(plant.dead_time_s / PERIOD * 10) * PERIOD / 10  # the simulation has tenths of a period
        growing += growth_per_second(run(plant, edgy, 1000, late), 1.0) > 0.0
    tenths = [[replace(p, dead_time_s=round(p.dead_time_s / PERIOD * 10) * PERIOD / 10) for p in draw] for draw in draws]
    spread = margin_spread(tenths, edgy, PERIOD)
    assert 0 < growing < 8
    assert spread.unstable == growing


def test_draws_have_the_law_asked_for_and_keep_the_bounds() -> None:
    """Mean and covariance of 20 000 draws within five standard errors; heavier tails with few degrees of freedom; same seed, same draws."""
    mean, covariance = np.array([13.4, 2.0]), np.array([[0.04, 0.018], [0.018, 0.01]])
    free = np.full(2, np.inf)
    drawn = joint_draws(mean, covariance, -free, free, 20000, seed=3)
    error = np.sqrt(np.diag(covariance) / 20000)
    assert np.all(np.abs(drawn.mean(axis=0) - mean) < 5.0 * error)
    np.testing.assert_allclose(np.cov(drawn.T), covariance, rtol=5.0 * math.sqrt(2.0 / 20000))
    student = joint_draws(mean, covariance, -free, free, 20000, freedom=5.0, seed=3)
    assert np.cov(student.T)[0, 0] == pytest.approx(0.04 * 5.0 / 3.0, rel=0.15)  # ν/(ν - 2); its own variance is large
    np.testing.assert_array_equal(drawn, joint_draws(mean, covariance, -free, free, 20000, seed=3))
    bounded = joint_draws(mean, covariance, np.array([13.3, 0.0]), np.array([13.5, 2.0]), 500, seed=1)
    assert bounded[:, 0].min() == 13.3
    assert bounded[:, 1].max() == 2.0


def test_two_of_which_only_the_sum_is_known_keep_it_at_their_bounds() -> None:
    """Frictions at motor and carriage, each anything from 0 on, together 0.13 ± 0.002: a draw below 0 is no more of the other."""
    mean, apart = np.array([0.07, 0.06]), np.array([1.0, -1.0])
    covariance = 0.8**2 * np.outer(apart, apart) + 0.001**2 * np.eye(2)
    free, bounded = (
        joint_draws(mean, covariance, low, np.full(2, 50.0), 500, freedom=3.0, seed=2) for low in (np.full(2, -50.0), np.zeros(2))
    )
    below = free.min(axis=1) < 0.0
    assert 0.5 < below.mean() < 1.0
    assert bounded.min() == 0.0
    np.testing.assert_array_equal(bounded[~below], free[~below])
    np.testing.assert_allclose(bounded.sum(axis=1), free.sum(axis=1), atol=2e-6 * 50.0)


def test_the_bounds_of_two_frictions_leave_each_no_more_than_their_sum() -> None:
    """And nothing of a third parameter that has nothing to do with them; without a bound in reach every interval stays."""
    mean, covariance, low = np.array([0.07, 0.06, 5.0]), np.diag([1e-6, 1e-6, 0.25]), np.array([0.0, 0.0, -np.inf])
    covariance[:2, :2] += 0.64 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    shares = share_within_bounds(mean, covariance, low, freedom=3.0)
    unbounded = 0.8 * stdtrit(3.0, 0.975)
    np.testing.assert_allclose(shares[:2] * unbounded, [0.07, 0.07], rtol=0.1)  # of one the other is left, 0.13 - 0.06
    assert shares[2] == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_array_equal(share_within_bounds(mean, covariance, np.full(3, -np.inf), freedom=3.0), 1.0)


def test_draws_without_plants_are_no_draws() -> None:
    for wrong in ([], [[]], [[G_A], [G_A, G_A]]):
        with pytest.raises(UsageError, match="equally many plants"):
            margin_spread(wrong, LOOP_A, PERIOD)
