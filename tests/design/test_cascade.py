"""The design: it meets what it promises, nothing better exists, and what cannot be had is refused with the nearest request."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from beltcomm.control import Cascade, CascadeStructure, Prefilter
from beltcomm.design.cascade import DesignResult, design_cascade, meets
from beltcomm.design.design_plant import DesignPlant, with_friction_fractions
from beltcomm.design.loops import sample_plants
from beltcomm.design.margins import Margins, margins, margins_on
from beltcomm.design.specification import Infeasible, Specification
from beltcomm.errors import UsageError
from design.closed_loop import PERIOD, run

RATIO = 0.01242
REFERENCE = CascadeStructure("reference", PERIOD, ("none", "notch", "butterworth"), True, True, True)
#: The profile cmmp-as of docs/reference-drive.md.
CMMP = CascadeStructure(
    "cmmp-as",
    PERIOD,
    steps={"kp_nm_s_rad": 0.02 / 256, "integral_time_s": 1e-6, "kpp_1_s": 10 / 256, "velocity_filter_s": 1e-6},
    lowest={"kp_nm_s_rad": 0.02 * 20 / 256, "integral_time_s": 1e-6, "velocity_filter_s": 1e-6},
    highest={"kp_nm_s_rad": 1.28, "integral_time_s": 0.032, "kpp_1_s": 640.0, "velocity_filter_s": 0.032},
)
G_A = DesignPlant(71.73e-6, RATIO, 13.44, 203.74e3, 33.17 * RATIO**2, 226.42, 20.0, 1e-3, "G_A")
G_B = DesignPlant(71.73e-6, RATIO, 0.96, 222.39e3, 0.01 * RATIO**2, 53.70, 20.0, 1e-3, "G_B")
S_A = DesignPlant(44.90e-6, RATIO, 10.0, 200e3, 100.0 * RATIO**2, 100.0, 20.0, 1e-3, "S_A")
FRACTIONS = (0.0, 0.06, 0.3, 1.0)
BRISK = Specification(phase_margin_deg=45.0, position_phase_margin_deg=70.0)
LOOSE = Specification(phase_margin_deg=30.0, position_phase_margin_deg=60.0)


@pytest.fixture(scope="module", params=["G_A", "G_B"])
def plants(request: pytest.FixtureRequest) -> list[DesignPlant]:
    return with_friction_fractions({"G_A": G_A, "G_B": G_B}[request.param], FRACTIONS)


@pytest.fixture(scope="module")
def default_design(plants: list[DesignPlant]) -> DesignResult:
    return design_cascade(plants, REFERENCE)


@pytest.fixture(scope="module")
def brisk_design(plants: list[DesignPlant]) -> DesignResult:
    return design_cascade(plants, REFERENCE, BRISK)


@pytest.fixture(scope="module")
def cmmp_design() -> DesignResult:
    return design_cascade(with_friction_fractions(G_B, FRACTIONS), CMMP, LOOSE)


@pytest.mark.parametrize(("name", "margin"), [("default_design", (60.0, 80.0)), ("brisk_design", (45.0, 70.0))])
def test_every_condition_holds_on_every_plant(
    request: pytest.FixtureRequest, plants: list[DesignPlant], name: str, margin: tuple[float, float]
) -> None:
    result: DesignResult = request.getfixturevalue(name)
    assert len(result.margins) == len(plants)
    for one in margins(result.cascade, plants, PERIOD):
        assert one.stable
        assert one.velocity_stable
        assert one.phase_margin_deg >= margin[0]
        assert one.position_phase_margin_deg >= margin[1]
        assert one.suppression_db <= -10.0
        assert min(one.gain_margin_db, one.position_gain_margin_db) >= 6.0
        assert max(one.sensitivity_db, one.position_sensitivity_db) <= 6.0
    assert result.cascade.ki_nm_rad > 0.0
    assert result.stiffness == result.cascade.ki_nm_rad * result.cascade.kpp_1_s
    assert result.cascade.filter_reference
    assert result.binding
    assert result.remarks == ()


def test_margins_hold_between_the_damping_values_of_the_design(plants: list[DesignPlant], default_design: DesignResult) -> None:
    """The proof takes some fractions of the apparent damping; what lies between them loses at most a degree."""
    result = default_design
    between = with_friction_fractions(plants[-1], np.linspace(0.0, 1.0, 25).tolist())
    loose = replace(result.specification, phase_margin_deg=59.0, position_phase_margin_deg=79.0, suppression_db=-9.9)
    assert meets(margins(result.cascade, between, PERIOD), loose)


def test_no_loop_found_at_random_is_better(plants: list[DesignPlant], brisk_design: DesignResult) -> None:
    """300 random gains around the result, all with a larger K_I K_PP: none meets the specification.

    The search keeps 0.1 degrees and 0.05 dB in reserve and zooms to 1 %; 3 % more stiffness must not be on offer.
    """
    result = brisk_design
    sampled = sample_plants(plants, PERIOD, 300)
    rng = np.random.default_rng(7)
    tried = 0
    while tried < 300:
        kp, ki, kpp = np.exp(rng.uniform(-0.7, 0.7, 3)) * np.array(
            [result.cascade.kp_nm_s_rad, result.cascade.ki_nm_rad, result.cascade.kpp_1_s]
        )
        if ki * kpp > 1.03 * result.stiffness:
            tried += 1
            other = replace(result.cascade, kp_nm_s_rad=float(kp), ki_nm_rad=float(ki), kpp_1_s=float(kpp))
            assert not meets(margins_on(other, sampled), BRISK)


def test_the_designed_loop_settles_in_simulation(plants: list[DesignPlant], brisk_design: DesignResult) -> None:
    """The compiled cascade on an independent plant, step of the angle: little overshoot, settled after 30 time constants."""
    cascade = brisk_design.cascade
    for plant in (plants[0], plants[-1]):
        angle = run(plant, cascade, int(30.0 / cascade.kpp_1_s / PERIOD), plant.dead_time_s)
        assert angle.max() < 1.25
        assert angle[-1] == pytest.approx(1.0, abs=0.03)


def test_among_the_prefilters_the_one_with_the_largest_stiffness_is_taken() -> None:
    alone = {kind: design_cascade([S_A], REFERENCE, Specification(prefilters=(kind,))) for kind in ("none", "notch", "butterworth")}
    best = design_cascade([S_A], REFERENCE)
    assert {kind: one.cascade.prefilter.kind for kind, one in alone.items()} == {kind: kind for kind in alone}
    assert best.stiffness == max(one.stiffness for one in alone.values())


def test_s_a_with_the_butterworth_has_an_inequality_design_where_the_equations_have_none() -> None:
    result = design_cascade([S_A], REFERENCE, Specification(prefilters=("butterworth",)))
    assert result.margins[0].suppression_db < -18.0
    assert not any("suppression" in line for line in result.binding)
    assert any("phase margin" in line for line in result.binding)


def test_designed_on_apparent_damping_alone_the_loop_is_what_the_thesis_found_and_fails_on_the_moving_axis() -> None:
    """Thesis sheet, section 3: the published gains exist only because standstill friction posed as damping."""
    apparent = replace(G_A, belt_damping_ns_m=0.0)
    moving = replace(G_A, motor_damping_nm_s_rad=2.53e-3, cart_damping_ns_m=0.0)
    result = design_cascade([apparent], REFERENCE, Specification(prefilters=("butterworth",)))
    # The equations give K_I 1.67, K_PP 8.2 on the continuous plant; sampling costs half a period and a little gain.
    assert 10.0 < result.stiffness < 1.67 * 8.2
    assert margins(result.cascade, [moving], PERIOD)[0].phase_margin_deg < 45.0


def test_gains_lie_on_the_drives_steps_and_inside_its_bounds() -> None:
    coarse = replace(
        REFERENCE,
        steps={"kp_nm_s_rad": 0.002, "ki_nm_rad": 0.01, "kpp_1_s": 0.5, "velocity_filter_s": 1e-4},
        highest={"kp_nm_s_rad": 0.05, "velocity_filter_s": 0.00155},
    )
    plants = with_friction_fractions(G_A, FRACTIONS)
    result = design_cascade(plants, coarse, BRISK)
    cascade = result.cascade
    for value, step in (
        (cascade.kp_nm_s_rad, 0.002),
        (cascade.ki_nm_rad, 0.01),
        (cascade.kpp_1_s, 0.5),
        (cascade.velocity_filter_s, 1e-4),
    ):
        assert value / step == pytest.approx(round(value / step), abs=1e-6)
        assert value > 0.0
    assert cascade.kp_nm_s_rad <= 0.05
    assert cascade.velocity_filter_s == pytest.approx(0.0015)
    assert any("highest velocity gain Kp 0.05 N m s/rad" in line for line in result.binding)
    assert meets(margins(cascade, plants, PERIOD), result.specification)


def test_a_drive_that_stores_the_integral_time_gets_one_it_has(cmmp_design: DesignResult) -> None:
    result = cmmp_design
    integral_time = result.cascade.kp_nm_s_rad / result.cascade.ki_nm_rad
    assert integral_time <= 0.032
    assert integral_time * 1e6 == pytest.approx(round(integral_time * 1e6), abs=1e-3)
    assert result.cascade.kp_nm_s_rad * 256 / 0.02 == pytest.approx(round(result.cascade.kp_nm_s_rad * 256 / 0.02), abs=1e-6)
    assert result.cascade.feedforward.velocity == 0.0
    assert not result.cascade.filter_reference
    assert meets(margins(result.cascade, result.plants, PERIOD), LOOSE)


def test_what_the_rest_of_the_cascade_would_have_brought_is_said_with_its_factor(cmmp_design: DesignResult) -> None:
    result = cmmp_design
    with_butterworth = design_cascade(result.plants, replace(CMMP, prefilters=("butterworth",)), LOOSE)
    factor = with_butterworth.stiffness / result.stiffness
    assert any(f"butterworth prefilter the drive could have reached {factor:.1f} times" in line for line in result.remarks)
    assert any("velocity feedforward" in line for line in result.remarks)
    assert any("torque feedforward" in line for line in result.remarks)


def test_an_infeasible_request_names_what_binds_and_the_nearest_that_is_feasible() -> None:
    """cmmp-as on G_B: with T_N at most 32 ms the integrator takes more phase than 60 degrees of margin leave."""
    plants = with_friction_fractions(G_B, FRACTIONS)
    with pytest.raises(Infeasible, match=r"cmmp-as.*phase margin 60\.0 deg.*velocity loop's margins.*nearest request") as caught:
        design_cascade(plants, CMMP)
    nearest = caught.value.nearest
    assert nearest is not None
    assert caught.value.exit_code == 1
    assert nearest.phase_margin_deg < 59.0
    assert nearest.suppression_db == -10.0
    assert meets(design_cascade(plants, CMMP, nearest).margins, nearest)
    with pytest.raises(Infeasible):
        # Bisected to 2 % of the way from 60 to 5 degrees, found again in steps of 4 %.
        design_cascade(plants, CMMP, replace(nearest, phase_margin_deg=nearest.phase_margin_deg + 4.0))


def test_a_resonance_without_any_damping_is_refused_for_the_suppression() -> None:
    undamped = replace(S_A, motor_damping_nm_s_rad=0.0, cart_damping_ns_m=0.0, belt_damping_ns_m=0.0)
    bounded = replace(REFERENCE, prefilters=("none",), lowest={"kp_nm_s_rad": 0.01})
    with pytest.raises(Infeasible):
        design_cascade([undamped], bounded)


def test_a_prefilter_the_drive_lacks_is_refused_with_what_it_offers() -> None:
    with pytest.raises(Infeasible, match="cmmp-as, which offers none"):
        design_cascade([G_B], CMMP, Specification(prefilters=("notch",)))


def test_no_plant_is_a_usage_error() -> None:
    with pytest.raises(UsageError, match="no plant"):
        design_cascade([], REFERENCE)


@pytest.mark.parametrize(
    ("name", "value"),
    [("phase_margin_deg", 0.0), ("suppression_db", 3.0), ("sensitivity_db", float("nan")), ("velocity_filters_s", ())],
)
def test_impossible_requests_are_refused_by_name(name: str, value: object) -> None:
    with pytest.raises(UsageError, match=name):
        Specification(**{name: value})  # type: ignore[arg-type]


def test_open_loops_of_the_result_cross_one_where_the_margins_say() -> None:
    result = design_cascade([G_A], REFERENCE)
    velocity, position = result.open_loops(0, np.array([result.margins[0].crossover_rad_s, result.margins[0].position_crossover_rad_s]))
    assert abs(velocity[0]) == pytest.approx(1.0, abs=1e-4)
    assert abs(position[1]) == pytest.approx(1.0, abs=1e-4)
    assert math.degrees(np.angle(velocity[0])) + 180.0 == pytest.approx(result.margins[0].phase_margin_deg, abs=0.01)


def test_an_unstable_loop_never_meets_a_specification_however_its_margins_look() -> None:
    """K_P beyond the gain margin: distances to −1 are large again, the poles tell."""
    runaway = Cascade(5.0, 50.0, 8.0, 0.002, Prefilter("butterworth", 123.27))
    achieved = margins(runaway, [G_A], PERIOD)
    assert not achieved[0].velocity_stable
    generous = Margins(**{**achieved[0].__dict__, "phase_margin_deg": 90.0, "suppression_db": -60.0, "gain_margin_db": 20.0})
    assert not meets([replace(generous, sensitivity_db=1.0, position_sensitivity_db=1.0)], Specification())


def test_a_slow_resonance_gets_a_longer_velocity_filter() -> None:
    """A rig behind a 3:1 gearbox, resonance 44 Hz: with 8 ms at most it would be half as stiff.  G_A at 107 Hz is not asked."""
    geared = DesignPlant(57.39e-6, RATIO / 3.0, 13.44, 203.74e3, 0.38e-3, 0.0, 20.0, 1e-3, "geared")
    lags = (0.001, 0.002, 0.004, 0.008, 0.016, 0.032)
    notch = replace(BRISK, prefilters=("notch",))
    short, long = (design_cascade([geared], REFERENCE, replace(notch, velocity_filters_s=some)) for some in (lags[:4], lags))
    assert long.cascade.velocity_filter_s > 0.008
    assert long.stiffness > 2.0 * short.stiffness
    plants = with_friction_fractions(G_A, (0.0, 0.06))
    alike = [design_cascade(plants, REFERENCE, replace(notch, velocity_filters_s=some)) for some in (lags[:4], lags)]
    assert alike[0].cascade == alike[1].cascade
