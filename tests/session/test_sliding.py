"""Friction that a sweep has shown goes ahead instead of what a fit around standstill made of it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm.axis import load_axis
from beltcomm.control import Cascade, Feedforward
from beltcomm.experiments import execute_step, friction_feedforward
from beltcomm.fit.start.first_estimate import data_sheet_model
from beltcomm.machine import stops
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import Sidecar

Array = NDArray[np.float64]
MODEL = data_sheet_model(load_axis("egc-70-600"), 0.25, 0.1)
#: 884001: friction that needs a way posed as three times the viscous friction, and the axis ran 50 mm ahead of fast moves.
CASCADE = Cascade(0.012, 0.2, 17.9, 2e-3, feedforward=Feedforward(2.6e-4, 0.01256, 0.0229, 0.0, 1.0, 1.5e-3))


def swept(viscous: float, coulomb: float, speeds: tuple[float, ...] = (40.0, 65.0, 95.0)) -> Recording:
    """To and fro at constant speeds, rests between, by the torque that friction takes."""
    omega: Array = np.concatenate([np.concatenate([np.zeros(200), np.full(800, sign * v)]) for v in speeds for sign in (1.0, -1.0)])
    torque: Array = viscous * omega + coulomb * np.sign(omega) + np.random.default_rng(1).normal(0.0, 5e-3, len(omega))
    t_s = 1e-3 * np.arange(len(omega), dtype=np.float64)
    angle: Array = 1e-3 * np.concatenate([[0.0], np.cumsum(omega)[:-1]])
    return Recording("sweep", t_s, torque, angle, sidecar=Sidecar("friction_sweep", 0.25, closed_loop=True), reference_velocity=omega)


def test_the_friction_of_the_sweep_is_sent_ahead_and_nothing_else_changes() -> None:
    found = friction_feedforward._with_sliding_friction(CASCADE, MODEL, swept(0.00275, 0.095))
    sent = found.feedforward
    assert sent.viscous_nm_s_rad == pytest.approx(0.00275, rel=0.05)
    assert sent.coulomb_nm == pytest.approx(0.095, rel=0.05)
    assert replace(found, feedforward=replace(sent, viscous_nm_s_rad=0.01256, coulomb_nm=0.0229)) == CASCADE


def test_a_sweep_that_does_not_tell_the_friction_and_a_drive_that_sends_none_change_nothing() -> None:
    for sweep in (swept(0.00275, 0.095, (40.0,)), swept(-0.001, 0.2)):
        assert friction_feedforward._with_sliding_friction(CASCADE, MODEL, sweep) == CASCADE
    none = replace(CASCADE, feedforward=Feedforward())
    assert friction_feedforward._with_sliding_friction(none, MODEL, swept(0.00275, 0.095)) == none


@pytest.mark.parametrize("suspect", [True, False])
def test_only_a_fit_that_leaves_its_records_unexplained_gives_way_and_stops_are_counted_anew(
    monkeypatch: pytest.MonkeyPatch, suspect: bool
) -> None:
    counted: list[Cascade] = []
    monkeypatch.setattr(stops, "count_on_loop", lambda _machine, _family, cascade, _delay: counted.append(cascade))
    folder = SimpleNamespace(finished=lambda _name: object(), recording=lambda _name: swept(0.00275, 0.095))
    machine: Any = SimpleNamespace(folder=folder, write_cascade=lambda cascade: cascade)
    findings: Any = SimpleNamespace(final=SimpleNamespace(fit=SimpleNamespace(suspect=suspect)))
    loop = execute_step.Closed(MODEL, CASCADE, 1e-3)
    found = friction_feedforward.with_measured_friction(machine, findings, loop)
    assert counted == ([found.cascade] if suspect else [])
    assert (found != loop) == suspect
