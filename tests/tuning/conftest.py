"""Both rigs of the thesis on the bench, as their plant files have them, with the thesis's cascade at 1 kHz."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.control import Cascade, Prefilter
from beltcomm.model import load_plant
from beltcomm.rundata import analyse
from beltcomm.rundata.offline import THESIS_STRUCTURE
from beltcomm.trajectory import plan_trajectory, with_dwell
from beltcomm.tuning.bench import Bench
from beltcomm.tuning.ground import DesignInput, SliderSetting
from beltcomm.verify import Loop

DELAY_S = 1e-3
#: N m s/rad at the motor, as frequency responses around standstill show it there.
APPARENT = {"g_a": 0.063, "g_b": 0.03}
PRESENT = Cascade(0.03, 0.05, 3.0, 0.004, Prefilter())


@cache
def bench_of(rig: str) -> Bench:
    model = load_plant(rig).model
    limits = TrajectoryLimits(speed_m_s=0.5, acceleration_m_s2=2.0, jerk_m_s3=40.0)
    return Bench(
        DesignInput(
            model,
            THESIS_STRUCTURE,
            lambda places, loads: analyse.design_plants(
                model, places, [model["cart.mass"] + load for load in loads], DELAY_S, APPARENT[rig]
            ),
            lambda cascade: analyse.with_feedforward(cascade, model, THESIS_STRUCTURE, DELAY_S),
            (0.05, 0.55),
            with_dwell(plan_trajectory(0.1, 0.3, limits, 1e-3), 1.6),
            Loop(THESIS_STRUCTURE, DELAY_S, 10.0, 65536),
            PRESENT,
            (0.002, 0.004, 0.008),
        )
    )


@pytest.fixture(params=sorted(APPARENT))
def bench(request: pytest.FixtureRequest) -> Bench:
    return bench_of(request.param)


@pytest.fixture
def heavy() -> Bench:
    return bench_of("g_a")


@pytest.fixture
def setting() -> SliderSetting:
    """Balanced, behind a low-pass."""
    return SliderSetting(45.0, 70.0, -14.0, "butterworth", 0.004, 0.0, False, 0.3)


@pytest.fixture
def impossible(setting: SliderSetting) -> SliderSetting:
    """More gain at the resonance than any phase margin of 60 degrees allows."""
    return replace(setting, phase_margin_deg=60.0, suppression_db=-2.0)
