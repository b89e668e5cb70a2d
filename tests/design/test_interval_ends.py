"""Ends of the intervals that a loop must hold at: where the fit says, with what it cannot tell apart, and never beyond what can be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from beltcomm.model import Model
from beltcomm.model.covariance import Covariance
from beltcomm.rundata.interval_margins import _interval_ends
from identify.records import true_model
from truth.rigs import nominal

J, M, C = "motor.inertia", "cart.mass", "belt_stiffness.stiffness"


def known_to(**half: float) -> Model:
    """Rig g_a with half widths of intervals, of what is named alone."""
    model = true_model(nominal("g_a"))
    names = {"inertia": J, "mass": M, "stiffness": C}
    told = {names[short]: width for short, width in half.items()}
    return replace(model, parameters={n: replace(v, interval=told.get(n)) for n, v in model.parameters.items()}, covariance=None)


def test_a_model_that_nobody_estimated_has_no_ends() -> None:
    assert _interval_ends(known_to()) == []


def test_both_ends_of_what_was_estimated() -> None:
    model = known_to(mass=0.5, stiffness=1e3)
    found = [(end.name, end.model[end.name] - model[end.name]) for end in _interval_ends(model)]
    assert [name for name, _ in found] == [M, M, C, C]
    assert [way for _, way in found] == pytest.approx([-0.5, 0.5, -1e3, 1e3])
    assert all(end.model[J] == model[J] for end in _interval_ends(model))


def test_a_sum_that_is_known_stays() -> None:
    """Inertia and mass that only their sum J + i² m is known of: a heavier carriage goes with a lighter motor."""
    model = known_to(inertia=1e-5, mass=1e-5 / 0.01242**2)
    ratio = model["transmission.ratio"]
    along = np.array([ratio**2, -1.0])  # of J and m: the sum stays
    deviation = 1e-5 / 1.96 / ratio**2
    model = replace(model, covariance=Covariance((J, M), deviation**2 * np.outer(along, along), np.inf))
    whole = model[J] + ratio**2 * model[M]
    ends = _interval_ends(model)
    assert len(ends) == 4
    for end in ends:
        assert end.model[J] + ratio**2 * end.model[M] == pytest.approx(whole, rel=1e-9)
        assert end.model[J] != model[J]


def test_no_end_is_beyond_a_bound() -> None:
    """Seen on a drive whose torque path was mistaken: 16 kg ± 1672 kg."""
    low, high = _interval_ends(known_to(mass=1672.0))
    assert low.model[M] == low.model.parameters[M].low > 0.0
    assert high.model[M] == pytest.approx(true_model(nominal("g_a"))[M] + 1672.0)


def test_what_goes_along_stays_at_its_bound_and_stops_no_other() -> None:
    """A mass that hardly anything is known of does not keep the inertia from its own end."""
    model = known_to(inertia=2e-5, mass=20.0)
    covariance = np.array([[1e-10, -0.5e-5 * 10.0], [-0.5e-5 * 10.0, 100.0]])
    model = replace(model, covariance=Covariance((J, M), covariance, np.inf))
    low, high = _interval_ends(model)[:2]
    assert (low.model[J] - model[J], high.model[J] - model[J]) == pytest.approx((-2e-5, 2e-5))
    assert high.model[M] == pytest.approx(model[M] - 10.0)
    wide = replace(model, covariance=Covariance((J, M), covariance * np.array([[1.0, 4.0], [4.0, 16.0]]), np.inf))
    assert _interval_ends(wide)[1].model[M] == wide.parameters[M].low
    assert _interval_ends(wide)[1].model[J] == pytest.approx(model[J] + 2e-5)


def test_the_belt_s_stiffness_counts_by_any_law() -> None:
    model = known_to().without_effect("belt_stiffness").with_effect("belt_spans")
    name = "belt_spans.specific_stiffness"
    model = replace(model, parameters={n: replace(v, interval=1e3 if n == name else None) for n, v in model.parameters.items()})
    assert [end.name for end in _interval_ends(model)] == [name, name]
