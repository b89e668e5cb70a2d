"""From sliders to gains, curves and errors: what the knobs promise holds, what is possible is told rightly, presets are in order."""

from __future__ import annotations

import json
import re
import time
from dataclasses import asdict, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from beltcomm.axis.entries import AxisTargets
from beltcomm.design.knobs import OutOfReach
from beltcomm.design.margins import margins, worst_of
from beltcomm.errors import UsageError
from beltcomm.sentences.screens import _loop_lines
from beltcomm.tuning.bench import DISTURBANCE_NM, Bench, open_loop_curves, responses
from beltcomm.tuning.changes import changes, error_changes, sentence
from beltcomm.tuning.ground import SliderSetting, setting_from
from beltcomm.tuning.presets import PACES, Preset, preset
from design.closed_loop import PERIOD, run


@pytest.mark.parametrize(
    "turned", [{}, {"phase_margin_deg": 35.0, "position_phase_margin_deg": 60.0}, {"payload_kg": 1.0, "suppression_db": -20.0}]
)
def test_knobs_hold_on_every_variant(bench: Bench, setting: SliderSetting, turned: dict[str, Any]) -> None:
    """Judged on the fine grid of a proof, on all variants, twins too; the suppression is met and not only kept."""
    asked = replace(setting, **turned)
    design = bench.design(asked)
    loads = [0.0, asked.payload_kg] if asked.payload_kg else [0.0]
    worst = worst_of(margins(design.cascade, bench.ground.plants(bench.ground.ends_m, loads), bench.ground.structure.period_s))
    assert worst.stable
    assert worst.phase_margin_deg >= asked.phase_margin_deg
    assert worst.position_phase_margin_deg >= asked.position_phase_margin_deg
    assert asked.suppression_db - 0.2 < worst.suppression_db <= asked.suppression_db
    assert worst.sensitivity_db <= 6.0


def test_each_knob_does_what_its_name_says(bench: Bench, setting: SliderSetting) -> None:
    """6 dB more at the resonance is twice K_P; less margin asked for never costs stiffness (to the search's 3 %)."""
    first = bench.design(setting)
    quiet = bench.design(replace(setting, suppression_db=setting.suppression_db - 6.0206))
    assert quiet.cascade.kp_nm_s_rad == pytest.approx(0.5 * first.cascade.kp_nm_s_rad, rel=0.02)
    for name in ("phase_margin_deg", "position_phase_margin_deg"):
        values = np.arange(getattr(setting, name), 31.0, -5.0)
        stiffness = [bench.design(replace(setting, **{name: float(value)})).stiffness for value in values]
        assert all(later > 0.97 * earlier for earlier, later in pairwise(stiffness)), (name, stiffness)
        assert name == "phase_margin_deg" or stiffness[-1] > 1.05 * stiffness[0]


def test_reach_ends_where_designs_end(heavy: Bench, setting: SliderSetting) -> None:
    """Inside each piece there are designs, a little beyond its end there are none."""
    reach = heavy.reach(setting)
    assert reach.advice == ""
    for name, beyond in (("phase_margin_deg", 3.0), ("suppression_db", 1.0), ("position_phase_margin_deg", 1.0)):
        ((low, high),) = reach.pieces[name]
        assert low < getattr(setting, name) < high
        heavy.design(replace(setting, **{name: high - 1.5}))
        with pytest.raises(OutOfReach):
            heavy.design(replace(setting, **{name: high + beyond}))


def test_advice_leads_to_a_design(heavy: Bench, impossible: SliderSetting) -> None:
    with pytest.raises(OutOfReach, match=r"no integral time leaves the velocity loop 60\.1 degrees"):
        heavy.design(impossible)
    reach = heavy.reach(impossible)
    assert "the suppression at most" in reach.advice
    ((_, high),) = reach.pieces["suppression_db"]
    heavy.design(replace(impossible, suppression_db=high - 0.5))


@pytest.fixture(scope="module")
def made() -> dict[tuple[str, str], list[Preset]]:
    """Both kinds of belt on both rigs, from robust to fast."""
    from tuning.conftest import APPARENT, bench_of

    start = SliderSetting(45.0, 70.0, -14.0, "butterworth", 0.004, 0.0, False, 0.3)
    return {(rig, kind): [preset(bench_of(rig), start, kind, pace.key) for pace in PACES] for rig in APPARENT for kind in ("short", "long")}


@pytest.mark.parametrize("rig", ["g_a", "g_b"])
@pytest.mark.parametrize("kind", ["short", "long"])
def test_presets_go_from_robust_to_fast(made: dict[tuple[str, str], list[Preset]], rig: str, kind: str) -> None:
    """Bandwidth and stiffness really rise, both phase margins really fall, by what the sliders then give; each keeps what it promises."""
    from tuning.conftest import bench_of

    ladder = made[rig, kind]
    assert [one.refusal for one in ladder] == ["", "", ""]
    designs = [bench_of(rig).design(one.setting) for one in ladder if one.setting]
    worst = [worst_of(design.margins) for design in designs]
    for slower, faster in pairwise(worst):
        assert faster.position_bandwidth_at_rest_hz > 1.05 * slower.position_bandwidth_at_rest_hz
        assert faster.bandwidth_at_rest_hz > slower.bandwidth_at_rest_hz
        assert faster.phase_margin_deg < slower.phase_margin_deg - 3.0
        assert faster.position_phase_margin_deg < slower.position_phase_margin_deg - 1.0
        assert faster.sensitivity_db > slower.sensitivity_db
    assert all(later.stiffness > 1.5 * earlier.stiffness for earlier, later in pairwise(designs))
    for pace, reached in zip(PACES, worst, strict=True):
        assert reached.phase_margin_deg >= pace.asked.phase_margin_deg - 0.5
        assert reached.position_phase_margin_deg >= pace.asked.position_phase_margin_deg - 0.5


def test_a_belt_axis_is_no_stiff_one(heavy: Bench, setting: SliderSetting) -> None:
    """Without a filter nothing is faster than behind one, and a pace that brings nothing is not offered."""
    found = [preset(heavy, setting, "stiff", pace.key) for pace in PACES]
    possible = [one.position_crossover_hz for one in found if one.setting]
    assert possible == sorted(possible)
    assert all(crossover < 0.5 for crossover in possible)
    assert all(one.refusal for one in found if one.setting is None)


def test_a_preset_that_its_own_sliders_miss_is_none_with_the_reason(
    setting: SliderSetting, heavy: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A page that asks for it is answered, not refused."""

    def out_of_reach(_self: Bench, _setting: SliderSetting) -> None:
        raise OutOfReach("no Kv leaves the position loop 84.7 degrees of phase margin", "position")

    monkeypatch.setattr(Bench, "shown", out_of_reach)
    found = preset(Bench(heavy.ground), setting, "long", "robust")
    assert found.setting is None
    assert "84.7 degrees" in found.refusal


def test_curves_are_those_of_the_loop_that_runs(heavy: Bench, setting: SliderSetting) -> None:
    """Steps against a simulation that shares nothing with them; a torque is pushed back to nothing by the integrator."""
    cascade, plant = replace(heavy.design(setting).cascade, filter_reference=False), heavy.ground.plants([0.3], [0.0])[1]
    found = responses(plant, cascade, PERIOD, 1.0)
    rows = np.round(found.t_s / PERIOD).astype(int)
    for curve, velocity_loop in ((found.position, False), (found.velocity, True)):
        assert curve == pytest.approx(run(plant, cascade, rows[-1] + 1, plant.dead_time_s, velocity_loop=velocity_loop)[rows], abs=1e-6)
    far = responses(plant, cascade, PERIOD, 10.0)
    assert far.position[-1] == pytest.approx(1.0, abs=1e-3)
    assert abs(far.disturbance_m[-1]) < 0.01 * np.max(far.disturbance_m)
    # at first nothing but the motor's inertia, then all that moves, takes the torque
    moved = plant.transmission_m_rad * DISTURBANCE_NM * 0.5 * found.t_s[1] ** 2
    assert moved / plant.total_inertia_kg_m2 < found.disturbance_m[1] < 1.01 * moved / plant.inertia_kg_m2


def test_open_loop_shows_the_margin_that_is_told(heavy: Bench, setting: SliderSetting) -> None:
    cascade, plant = heavy.design(setting).cascade, heavy.ground.plants([0.3], [0.0])[1]
    (told,) = margins(cascade, [plant], PERIOD)
    curves = open_loop_curves(plant, cascade, PERIOD)
    hertz = told.crossover_rad_s / (2.0 * np.pi)
    assert np.interp(hertz, curves.freq_hz, curves.velocity_db) == pytest.approx(0.0, abs=0.1)
    assert 180.0 + np.interp(hertz, curves.freq_hz, curves.velocity_deg) == pytest.approx(told.phase_margin_deg, abs=0.5)


def test_payload_and_place_are_seen(heavy: Bench, setting: SliderSetting) -> None:
    """With a payload to hold for less gain is possible at the resonance; drawn with it, the antiresonance lies lower."""
    setting = replace(setting, suppression_db=-20.0)
    loaded = replace(setting, payload_kg=6.0, loaded=True)
    assert heavy.reach(loaded).pieces["suppression_db"][0][1] < heavy.reach(setting).pieces["suppression_db"][0][1]
    (_, empty, _), (_, full, _) = heavy.shown(setting), heavy.shown(loaded)
    notches = [one.open_loops.freq_hz[np.argmin(one.open_loops.velocity_db[one.open_loops.freq_hz < 60.0])] for one in (empty, full)]
    assert notches[1] < 0.95 * notches[0]


def test_a_change_is_told_in_one_line(heavy: Bench, setting: SliderSetting) -> None:
    _, slow, _ = heavy.shown(replace(setting, suppression_db=-20.0))
    _, fast, present = heavy.shown(setting)
    assert sentence(changes((slow.cascade, slow.worst), (slow.cascade, slow.worst))) == "Nothing changed against the present design."
    found = changes((slow.cascade, slow.worst), (fast.cascade, fast.worst))
    assert [one.better for one in found if one.name == "open loop at the resonance"] == [False]
    assert sentence(found).startswith("Against the present design: stiffness Ki Kv ")
    assert present.cascade == heavy.ground.present
    near, far = heavy.tracked(fast.cascade, 0.0), heavy.tracked(slow.cascade, 0.0)
    assert near.error.dynamic_m < far.error.dynamic_m
    assert "predicted following error" in sentence(error_changes(far.error, near.error))


def test_the_page_and_the_verdict_have_one_bandwidth_under_one_name(heavy: Bench, setting: SliderSetting) -> None:
    """On this rig the friction of a standstill makes the velocity loop slower by a large factor: both are told, each by its name."""
    design = heavy.design(setting)
    page = {one.name: one.new for one in changes((design.cascade, worst_of(design.margins)), (design.cascade, worst_of(design.margins)))}
    line = "".join(map(str, _loop_lines(design.margins, ())[0].parts))
    found = re.search(r"velocity ([\d.]+) Hz, position ([\d.]+) Hz \(at rest ([\d.]+), ([\d.]+)\)", line)
    assert found is not None
    names = ("velocity bandwidth", "position bandwidth", "velocity bandwidth at rest", "position bandwidth at rest")
    assert [float(value) for value in found.groups()] == pytest.approx([page[name] for name in names], rel=0.05)
    assert page["velocity bandwidth"] > 2.0 * page["velocity bandwidth at rest"]


def test_sliders_that_nobody_touched_mean_the_present_design(heavy: Bench, setting: SliderSetting) -> None:
    present = heavy.design(setting).cascade
    fresh = Bench(replace(heavy.ground, present=present))
    placed = fresh.start(0.0, fresh.ground.ends_m[0])
    assert fresh.design(placed).cascade == present
    design, new, old = fresh.shown(replace(placed, position_m=fresh.ground.ends_m[-1]))
    assert design.cascade == present
    assert all(change.same for change in changes((old.cascade, old.worst), (new.cascade, new.worst)))
    assert fresh.design(replace(placed, phase_margin_deg=placed.phase_margin_deg + 2.0)).cascade != present


def test_an_update_is_quick(heavy: Bench, setting: SliderSetting) -> None:
    """Gains, margins, curves and the predicted error of a move of 2 s, in CPU time of this process, whatever else the computer does."""
    heavy.tracked(heavy.shown(setting)[1].cascade, 0.0)
    spent = []
    for step in range(5):
        turned = replace(setting, phase_margin_deg=44.0 - step)
        began = time.process_time()
        _, new, _ = heavy.shown(turned)
        heavy.tracked(new.cascade, 0.0)
        spent.append(time.process_time() - began)
    assert sorted(spent)[2] < 0.2, spent


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"phase_margin_deg": 10.0}, "phase_margin_deg is 10.0; it must be a number from 30 to 88"),
        ({"suppression_db": float("nan")}, "suppression_db is nan"),
        ({"payload_kg": True}, "payload_kg is True"),
        ({"position_m": "0.3"}, "position_m is '0.3'; it must be a number from 0.05 to 0.55"),
        ({"loaded": 1}, "loaded must be true or false"),
        ({"more": 1}, "send these and no others"),
    ],
)
def test_controls_are_checked(heavy: Bench, setting: SliderSetting, wrong: dict[str, Any], words: str) -> None:
    assert setting_from(json.loads(json.dumps(asdict(setting))), heavy.ground) == setting
    with pytest.raises(UsageError, match=words.replace("(", r"\(")):
        setting_from(asdict(setting) | wrong, heavy.ground)
    with pytest.raises(UsageError, match="there is no prefilter 'comb' here; choose none or butterworth or notch"):
        heavy.design(replace(setting, prefilter="comb"))


def test_a_move_counts_as_settled_by_the_targets_of_the_axis(heavy: Bench) -> None:
    targets, present = AxisTargets(settled_error_m=1e-3), heavy.ground.present
    wide = Bench(replace(heavy.ground, targets=targets))
    told = wide.tracked(present, 0.0).error
    _, path = wide.path(present, 0.0)
    assert told == path.error_for(targets)
    assert (told.settling_s, heavy.tracked(present, 0.0).error.settling_s) == (0.0, None)
