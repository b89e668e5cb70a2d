"""What the records of a run cannot bear: names and verdicts that the drive or the encoder may as well stand for."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from beltcomm.fit.estimate import Fitted
from beltcomm.fit.records import Data
from beltcomm.fit.torque.lag import Lag
from beltcomm.fit.torque.laws import DriveLaw
from beltcomm.fit.torque.path import TorquePath
from beltcomm.laboratory.diagnosis import NONE_EXPLAINS, Diagnosis, Stage, Verdict
from beltcomm.laboratory.scope import (
    OF_DRIVE,
    _changes_within_rows,
    _contact_that_opens,
    _current_loop_within_sample,
    _speed_alone,
    _structure_of_rounding,
    _unknown_delivery,
    _without_names,
)
from beltcomm.laboratory.score import Scorer
from beltcomm.model import Model, build_model, load_plant
from beltcomm.recording import Recording

BASE = build_model("axis", ("belt_stiffness", "belt_damping", "viscous", "viscous_cart", "coulomb"), {})


@pytest.mark.parametrize(("period_s", "lags", "told"), [(2e-3, (), True), (5e-4, (), False), (2e-3, (Lag("first order", (1e-3,)),), False)])
def test_a_lag_as_short_as_a_settled_current_loop_s_may_be_the_drive_s(period_s: float, lags: tuple[Lag, ...], told: bool) -> None:
    """0.2 ms, read at the end of 2 ms: nothing of it is left in the reading."""
    base, lagging = (cast(Fitted, SimpleNamespace(model=m, ratio=2.0)) for m in (BASE, BASE.with_effect("current_lag", {"time": 2e-4})))
    data = cast(Data, SimpleNamespace(path=TorquePath(DriveLaw(1.0, lags)), recordings=[SimpleNamespace(sample_period_s=period_s)]))
    found = Diagnosis(base, data, (Stage(base, (), "current_lag", (), lagging),), "explained", (), cast(Scorer, None), data)
    assert ("0.2 ms" in _current_loop_within_sample(found)) == told


@pytest.mark.parametrize(("step_rad", "level", "told"), [(6e-3, 1.0, True), (1e-6, 1.0, False), (6e-3, 1.5, False)])
def test_what_a_coarse_encoder_leaves_in_step_with_the_motion_is_no_finding(step_rad: float, level: float, told: bool) -> None:
    piece = SimpleNamespace(step_rad=step_rad, motion=SimpleNamespace(sample_s=1e-3), noise_nm=0.01)
    problem = SimpleNamespace(pieces=[piece], samples=1000)
    base = cast(Fitted, SimpleNamespace(model=BASE, ratio=1.0, objective=1000.0 * level, problem=problem))
    found = Diagnosis(base, cast(Data, None), (Stage(base, (), "", (), base),), NONE_EXPLAINS, (), cast(Scorer, None), cast(Data, None))
    assert ("rounding" in _structure_of_rounding(found)) == told


def test_without_a_setpoint_no_effect_that_a_drive_has_is_named_behind_another_name() -> None:
    """Cogging stands; that what it leaves is a dead time, and not the drive's own delay, nothing tells."""
    cogging = BASE.with_effect("cogging", {})
    base, first, second = (cast(Fitted, SimpleNamespace(model=m, ratio=2.0)) for m in (BASE, cogging, cogging.with_effect("dead_time", {})))
    steps = (Stage(base, (), "cogging", (), first), Stage(first, (), "dead_time", (), second))
    found = Diagnosis(base, cast(Data, None), steps, "explained", (), cast(Scorer, None), cast(Data, None))
    read = cast(list[Recording], [SimpleNamespace(torque_setpoint=None, side="motor")])
    asked = cast(list[Recording], [SimpleNamespace(torque_setpoint=np.zeros(1), side="motor")])
    assert "dead_time fits best" in _unknown_delivery(found, read)
    assert _unknown_delivery(found, asked) == ""
    assert _unknown_delivery(replace(found, steps=steps[:1]), read) == ""
    left = _without_names(found, OF_DRIVE)
    assert left.added_effects == ["cogging"]
    assert left.verdict == "cannot tell"
    assert _without_names(found).added_effects == []


@pytest.mark.parametrize(
    ("model", "ratio", "verdict", "told"),
    [
        (BASE, 51.0, NONE_EXPLAINS, True),
        (BASE, 4.0, NONE_EXPLAINS, False),
        (BASE, 51.0, "cannot tell", False),
        (load_plant("torque_table").model, 51.0, NONE_EXPLAINS, False),
    ],
)
def test_far_above_the_noise_play_is_to_be_felt_for_where_no_effect_explains_anything(
    model: Model, ratio: float, verdict: Verdict, told: bool
) -> None:
    """As on a screw whose nut has 50 µm of play."""
    base = cast(Fitted, SimpleNamespace(model=model, ratio=ratio))
    found = Diagnosis(base, cast(Data, None), (Stage(base, (), "", (), base),), verdict, (), cast(Scorer, None), cast(Data, None))
    assert ("dial gauge" in _contact_that_opens(found)) == told


@pytest.mark.parametrize(
    ("within", "slowly", "after", "told"),
    [(20.0, 1.0, 5.0, True), (20.0, 20.0, 5.0, False), (0.5, 1.0, 2.0, False), (20.0, 1.0, 1.1, False)],
)
def test_a_torque_that_jumps_within_the_rows_is_told_by_its_sign(within: float, slowly: float, after: float, told: bool) -> None:
    """What a row lacks was too much in the row before; not where most of the error is slow, or an effect explains it."""
    random = np.random.default_rng(6)
    jumps, slow = np.diff(random.normal(size=401)), np.sin(np.linspace(0.0, 20.0, 400))
    white = [within * jumps + random.normal(size=400), slowly * slow + random.normal(size=400)]
    pieces = [SimpleNamespace(record=name) for name in ("prbs", "stroke")]
    problem = SimpleNamespace(pieces=pieces, ends=[0, 400, 800])
    base, left = (cast(Fitted, SimpleNamespace(model=BASE, ratio=r, problem=problem, residual=np.concatenate(white))) for r in (9.0, after))
    steps = (Stage(base, (), "elastic_shaft", (), left),)
    found = Diagnosis(base, cast(Data, None), steps, "partly explained", (), cast(Scorer, None), cast(Data, None))
    assert ("in prbs changes its sign" in _changes_within_rows(found)) == told


@pytest.mark.parametrize(
    ("integrated", "name", "verdict", "told"),
    [
        (True, "dead_time", "explained", True),
        (True, "cogging", "explained", False),
        (True, "", NONE_EXPLAINS, True),
        (True, "", "nothing missing", False),
        (False, "dead_time", "explained", False),
    ],
)
def test_a_filter_of_the_speed_is_no_lag_of_the_torque(integrated: bool, name: str, verdict: Verdict, told: bool) -> None:
    """A speed behind 4 ms was a dead time of 3.8 ms at 2.5 times the noise; that cogging explains nearly all stands."""
    after = BASE.with_effect(name, {}) if name else BASE
    base, left = (cast(Fitted, SimpleNamespace(model=m, ratio=2.5)) for m in (BASE, after))
    found = Diagnosis(base, cast(Data, None), (Stage(base, (), name, (), left),), verdict, (), cast(Scorer, None), cast(Data, None))
    records = cast(list[Recording], [SimpleNamespace(sidecar=SimpleNamespace(position_integrated=integrated))])
    assert ("Record the position" in _speed_alone(found, records)) == told
