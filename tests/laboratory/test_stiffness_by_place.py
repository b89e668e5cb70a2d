"""Where the search for a belt that softens by place begins: at the strands through what each place says of the stiffness."""

from __future__ import annotations

import pytest

from beltcomm.effects import AxisSummary, effect_named

FIXED, DISTANCE_M, FREE_M, MIDDLE_M = 2e-7, 1.25, 0.12, 0.5


def stiffness_n_m(place_m: float) -> float:
    """Clamps of compliance FIXED m/N in series with two strands of 500 kN side by side that share the loop."""
    short = FREE_M + place_m
    return 1.0 / (FIXED + short * (2.0 * DISTANCE_M - short) / (2.0 * DISTANCE_M) / 5e5)


def ground(*places: float) -> AxisSummary:
    return AxisSummary(
        inertia=7e-5,
        mass=4.0,
        stiffness=stiffness_n_m(MIDDLE_M),
        damping=25.0,
        coulomb=0.1,
        ratio=0.0124,
        low_m=0.0,
        high_m=2.0 * MIDDLE_M,
        antiresonance_hz=35.6,
        teeth=26,
        peak_nm=2.0,
        peak_force_n=150.0,
        offset_m=FREE_M,
        pulley_distance_m=DISTANCE_M,
        stiffness_at=tuple((place, 0.5, stiffness_n_m(place)) for place in places),
    )


@pytest.mark.parametrize("places", [(0.2, 0.5, 0.8), (0.2, 0.8), (0.2, 0.5, 0.5, 0.8, 0.8)])
def test_two_or_three_places_tell_where_to_begin(places: tuple[float, ...]) -> None:
    effect = effect_named("stiffness_position")
    assert effect.trials is not None
    first = effect.trials(ground(*places))[0]
    assert first.base["belt_stiffness.stiffness"] == pytest.approx(stiffness_n_m(MIDDLE_M), rel=1e-6)
    assert first.values["offset"] == pytest.approx(FREE_M, abs=1e-6)
    assert first.values["share"] == pytest.approx(1.0 - FIXED * stiffness_n_m(MIDDLE_M), rel=1e-6)


@pytest.mark.parametrize("places", [(), (0.5,), (0.49, 0.51), (0.449, 0.451), (1.02, 1.24)])  # the last on both sides of the softest place
def test_one_place_says_nothing_of_another(places: tuple[float, ...]) -> None:
    effect = effect_named("stiffness_position")
    assert effect.trials is not None
    assert all(not trial.base for trial in effect.trials(ground(*places)))
