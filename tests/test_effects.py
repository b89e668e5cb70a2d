"""Every effect of the catalogue: complete, bounded, and its law agrees with its slope."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import numpy as np
import pytest

from beltcomm.effects import EFFECTS, Effect, Parameter, effect_named
from beltcomm.errors import UsageError
from beltcomm.model import build_model
from beltcomm.model.mounted import Mounted, carrying, loaded_model

UNITS = {
    "1",
    "1/m2",
    "s",
    "rad/s",
    "N s2/m2",
    "kg",
    "kg m2",
    "N",
    "N m",
    "N/m",
    "N/m2",
    "N/m3",
    "N s/m",
    "N s",
    "N m/rad",
    "N m s/rad",
    "m",
    "rad",
}
POSITIONS_M = (0.02, 0.31, 0.57)
each_effect = pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)


def parameters_of(effect: Effect) -> list[Parameter]:
    return [*effect.parameters, *(body.inertia for body in effect.bodies)]


def typical_values(effect: Effect) -> list[float]:
    """Values of a law's arguments away from zero, so that no slope hides behind a zero parameter."""
    own = [p.start or 0.05 * min(p.high, 1.0) for p in effect.parameters]
    return [*own, *(7.0 for _ in effect.uses)]


def difference(function, at: float, step: float) -> float:
    return (function(at + step) - function(at - step)) / (2.0 * step)


def delays_as_its_response(effect: Effect) -> int:
    """The law on a sine, averaged over cells, against the frequency response that the effect states."""
    h, freq_hz, value = 5e-5, 70.0, 4.3e-4
    edges = 2.0 * np.pi * freq_hz * h * np.arange(20001)
    cells = np.diff(-np.cos(edges)) / np.diff(edges)
    out = effect.law(cells, h, value)
    steady = slice(6000, 20000)  # 49 whole periods
    phase = np.exp(-1j * 0.5 * (edges[1:] + edges[:-1]))[steady]
    ratio = (out[steady] @ phase) / (cells[steady] @ phase)
    assert ratio == pytest.approx(complex(effect.slope(np.array([2.0 * np.pi * freq_hz]), value)[0]), rel=2e-4)
    return 1


def reads_as_its_response(effect: Effect) -> int:
    """The law on samples of a sine against the frequency response that the effect states."""
    h, freq_hz, value = 5e-5, 70.0, 4.3e-4
    angles = 2.0 * np.pi * freq_hz * h * np.arange(20000)
    out = effect.law(np.sin(angles), 0.0, h, value)
    phase = np.exp(-1j * angles)[6000:]
    ratio = (out[6000:] @ phase) / (np.sin(angles)[6000:] @ phase)
    assert ratio == pytest.approx(complex(effect.slope(np.array([2.0 * np.pi * freq_hz]), value)[0]), rel=2e-4)
    return 1


def dissipates_in_every_cycle(effect: Effect) -> int:
    """Friction that builds up over a distance takes energy in every closed cycle, small or large, and never exceeds its level."""
    for amplitude in (1e-6, 3e-5, 1e-3):
        x = amplitude * np.sin(np.linspace(0.0, 4.0 * np.pi, 2001))
        z, shares = 0.0, []
        for step in np.diff(x):
            z = effect.law(float(step), z, effect.parameters[0].start, *(1.0 for _ in effect.uses))
            shares.append(z)
        assert max(map(abs, shares)) <= 1.0
        assert np.sum(np.array(shares)[1000:] * np.diff(x)[1000:]) > 0.0
    return 1


def test_names_are_unique() -> None:
    names = [effect.name for effect in EFFECTS]
    assert len(set(names)) == len(names)


@each_effect
def test_is_complete(effect: Effect) -> None:
    assert effect.title
    assert effect.seen
    assert effect.check
    known = re.search(r"\([23]\.\d+\)|table A\.\d|data sheet|\w+ \(?(19|20)\d\d", effect.source)
    assert known, f"source is {effect.source!r}; name an equation or table of the thesis, a data sheet, or author and year"
    for parameter in parameters_of(effect):
        assert parameter.unit in UNITS
        assert parameter.side in ("motor", "cart", "belt", "drive")
        assert parameter.meaning
        assert parameter.low < parameter.high
        assert parameter.low <= parameter.start <= parameter.high


@each_effect
def test_stands_in_a_documented_slot(effect: Effect) -> None:
    page = (Path(__file__).parent.parent / "docs" / "slots.md").read_text(encoding="utf-8")
    assert f"\n| `{effect.slot}` | " in page.split("## Slots")[1]


@each_effect
def test_motor_side_units_belong_to_rotary_bodies(effect: Effect) -> None:
    angular = {"N m", "N m s/rad", "N m/rad", "kg m2"}
    neutral = {"1", "s", "m", "rad", "rad/s"}
    for parameter in parameters_of(effect):
        if parameter.side == "motor":
            assert parameter.unit in angular | neutral
        elif parameter.side in ("cart", "belt"):
            assert parameter.unit not in angular


@each_effect
def test_law_agrees_with_its_slope(effect: Effect) -> None:
    values = typical_values(effect)
    checked = 0
    for element, x in itertools.product(effect.elements, POSITIONS_M):
        stiffness, damping = element.slope(x, *values)
        # Around no stretch: a spring may harden.
        by_stretch = difference(lambda s: element.law(s, 0.02, x, *values), 0.0, 1e-6)  # noqa: B023 - used at once
        by_rate = difference(lambda r: element.law(1e-4, r, x, *values), 0.02, 1e-3)  # noqa: B023
        assert by_stretch == pytest.approx(stiffness, rel=1e-7, abs=1e-6)
        assert by_rate == pytest.approx(damping, rel=1e-7, abs=1e-6)
        checked += 1
    for speed, position in itertools.product((-1.3, 0.4), POSITIONS_M):
        if effect.slot == "force":
            by_position, by_speed = effect.slope(position, speed, 2.0, *values)
            near = pytest.approx(difference(lambda q: effect.law(q, speed, 2.0, *values), position, 1e-5), rel=1e-5, abs=1e-9)  # noqa: B023
            assert by_position == near
            assert difference(lambda v: effect.law(position, v, 2.0, *values), speed, 1e-4) == pytest.approx(by_speed)  # noqa: B023
            checked += 1
        elif effect.slot == "friction_level":
            by_speed = effect.slope(speed, position, 2.0, *values)
            assert difference(lambda v: effect.law(v, position, 2.0, *values), speed, 1e-4) == pytest.approx(by_speed)  # noqa: B023
            assert effect.law(speed, position, 2.0, *values) >= 0.0
            checked += 1
    for at in (-0.03, -1e-5, 2e-6, 0.02, 1.3):
        if effect.slot in ("belt_law", "kinematics", "sensor"):
            step = 1e-8  # small against the rounded corners of gap and slack
            assert difference(lambda q: effect.law(q, *values), at, step) == pytest.approx(effect.slope(at, *values), rel=1e-4, abs=1e-9)
            checked += 1
    if effect.slot == "torque_delay":
        checked += delays_as_its_response(effect)
    if effect.slot == "torque_reading":
        checked += reads_as_its_response(effect)
    if effect.slot == "load_friction":
        for load in (-3.0, 0.2):
            assert difference(lambda f: effect.law(f, *values), load, 1e-4) == pytest.approx(effect.slope(load, *values))
            assert effect.law(load, *values) >= 0.0
            checked += 1
    if effect.slot == "torque_path":
        for theta in (0.0, 0.3, 2.0):
            share = effect.law(0.1, theta, 0.0, *values) / 0.1
            assert 0.5 < share < 1.5
            assert effect.law(0.0, theta, 0.0, *values) == 0.0
        checked += 1
    if effect.slot == "rigid":
        model = build_model("m", (effect.name,), {"cart.mass": 3.0, "motor.inertia": 2e-4}, base_bodies=("motor",))
        assert model.driven_inertia() == pytest.approx(2e-4 + 3.0 * model["transmission.ratio"] ** 2)
        checked += 1
    if effect.slot == "load_of_record":
        model = build_model(
            "m", (effect.name,), {"cart.mass": 3.0} if effect.uses else {}, base_bodies=("motor", "cart")[: 1 + len(effect.uses)]
        )
        number = int(effect.name.rpartition("_")[2]) if effect.name[-1].isdigit() else 1
        record = loaded_model(model, Mounted(number, 0.25))
        assert record[carrying(model)] == pytest.approx(effect.parameters[0].start + 0.25)
        assert record.driven_inertia() == pytest.approx(model.driven_inertia() if effect.uses else effect.parameters[0].start + 0.25)
        checked += 1
    if effect.slot == "friction_onset":
        checked += dissipates_in_every_cycle(effect)
    assert checked, "an effect without any law does nothing"


def test_belt_stiffness_is_that_of_the_data_sheet() -> None:
    """EA = 106 250 N, l3 = 0.79 m: 296 kN/m at l1 = 0.55 m and never below 269 (thesis.md, section 1)."""
    effect = effect_named("belt_spans")
    slope = effect.elements[0].slope
    assert slope(0.5, 106250.0, 0.79, 0.05)[0] == pytest.approx(296e3, rel=2e-3)
    assert min(slope(0.001 * i, 106250.0, 0.79, 0.05)[0] for i in range(740)) == pytest.approx(269e3, rel=1e-3)


def test_unknown_effect_names_the_nearest() -> None:
    with pytest.raises(UsageError, match="did you mean cart_friction"):
        effect_named("cart_frction")
    with pytest.raises(UsageError, match="beltcomm effects"):
        effect_named("qqq")
