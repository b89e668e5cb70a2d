"""Extracts of long records: rows as they are, at their place and time, telling more than nearly all choices of as many."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from beltcomm.axis import Axis, load_axis
from beltcomm.laboratory import extracts
from beltcomm.laboratory.extracts import _best_windows, _windows_of, extract_long
from beltcomm.recording import Recording
from beltcomm.recording.checks import rigid_inertia
from beltcomm.recording.sidecar import ExcitationNote, Sidecar

PERIOD = 1e-3
STEP = math.tau / 65536


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Long is what has more than 20 s here."""
    monkeypatch.setattr(extracts, "LONG_ROWS", 20_000)
    monkeypatch.setattr(extracts, "EXTRACT_ROWS", 16_000)


def record(seed: int, seconds: float = 90.0, odd_at_s: float | None = None, **note: object) -> Recording:
    """A rigid axis that goes to random places and rests between; at one time something rubs."""
    draw = np.random.default_rng(seed)
    inertia, level, viscous = 10.0 ** draw.uniform(-4.0, -2.0), draw.uniform(0.02, 0.2), draw.uniform(1e-4, 3e-3)
    pieces, place = [np.zeros(300)], 0.0
    while sum(map(len, pieces)) < seconds / PERIOD:
        goal, lasts = draw.uniform(-20.0, 20.0), draw.uniform(0.4, 3.0)
        s = np.arange(1, round(lasts / PERIOD) + 1) / round(lasts / PERIOD)
        pieces += [place + (goal - place) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2), np.full(round(draw.uniform(0.2, 0.8) / PERIOD), goal)]
        place = goal
    angle = np.concatenate(pieces)[: round(seconds / PERIOD)]
    t, speed = PERIOD * np.arange(len(angle)), np.gradient(angle, PERIOD)
    torque = inertia * np.gradient(speed, PERIOD) + viscous * speed + level * np.sign(speed)
    torque += draw.normal(0.0, 0.01 * np.abs(torque).max(), len(t))
    if odd_at_s is not None:
        torque += 0.5 * np.abs(torque).max() * (np.abs(t - odd_at_s) < 1.0) * np.sin(40.0 * t)
    known = {"start_position_m": 0.3, "session_time_s": 7.0, **note}
    return Recording("long", 5.0 + t, torque, np.round(angle / STEP) * STEP, sidecar=Sidecar("trajectory", **known))  # type: ignore[arg-type]


AXIS = load_axis("egc-70-600")


@pytest.mark.parametrize("seed", range(4))
def test_stretches_are_rows_of_the_record(seed: int) -> None:
    whole, remarks = record(seed), list[str]()
    parts = extract_long([whole], AXIS, remarks)["long"]
    rows = sum(len(part.t_s) for part in parts)
    assert 0.5 * extracts.EXTRACT_ROWS < rows <= extracts.EXTRACT_ROWS + 15_000
    for part in parts:
        first = int(np.searchsorted(whole.t_s, part.t_s[0]))
        here = slice(first, first + len(part.t_s))
        assert np.array_equal(part.torque, whole.torque[here])
        assert np.array_equal(part.position, whole.position[here])
        since = whole.t_s[first] - whole.t_s[0]
        assert part.sidecar.session_time_s == pytest.approx(7.0 + since)
        assert part.sidecar.start_position_m == pytest.approx(0.3 + AXIS.transmission_m_rad * (whole.position[first] - whole.position[0]))
        assert part.name == f"long@{since:.0f}s"
        assert np.ptp(whole.position[max(first - 80, 0) : first + 1]) < 0.05  # it rested
    assert len({part.name for part in parts}) == len(parts)
    assert f"long: of 90 s, {sum(float(p.t_s[-1] - p.t_s[0]) for p in parts):.0f} s in {len(parts)} stretches count" in remarks[0]


@pytest.mark.parametrize("seed", range(4))
def test_they_tell_more_than_as_many_other_rows(seed: int) -> None:
    windows = _windows_of([record(seed)])
    taken = _best_windows(windows, extracts.EXTRACT_ROWS)
    draw = np.random.default_rng(seed)

    def told(some: list[extracts.Extract]) -> float:
        return float(np.linalg.slogdet(1e-6 * windows[0].told.max() * np.eye(len(windows[0].told)) + sum(w.told for w in some))[1])

    others = []
    for _ in range(100):
        chosen, rows = list[extracts.Extract](), 0
        for k in draw.permutation(len(windows)):
            if rows + windows[k].rows <= sum(w.rows for w in taken):
                chosen, rows = [*chosen, windows[k]], rows + windows[k].rows
        others.append(told(chosen))
    assert told(taken) > np.quantile(others, 0.95)


@pytest.mark.parametrize("seed", [0, 1, 2, 4])
def test_inertia_is_that_of_the_whole(seed: int) -> None:
    whole = record(seed)
    total = rigid_inertia(whole.t_s, whole.torque, whole.position)
    assert total is not None
    judged = 0
    for part in extract_long([whole], AXIS, [])["long"]:
        found = rigid_inertia(part.t_s, part.torque, part.position)
        if found is not None and found.dynamic > 0.3:
            assert abs(found.inertia - total.inertia) < 5.0 * math.hypot(found.error, total.error) + 0.05 * total.inertia
            judged += 1
    assert judged, "some part tells an inertia"


@pytest.mark.parametrize("seed", range(6))
def test_what_happens_once_is_seen(seed: int) -> None:
    at = float(np.random.default_rng(seed).uniform(5.0, 85.0))
    whole = record(seed, odd_at_s=at)
    assert any(part.t_s[0] - 6.0 < at < part.t_s[-1] - 4.0 for part in extract_long([whole], AXIS, [])["long"])


def test_short_records_stay_as_they_are() -> None:
    whole, remarks = record(1, 19.9), list[str]()
    assert extract_long([whole], AXIS, remarks) == {}
    assert remarks == []


def test_records_held_out_are_chosen_among_themselves() -> None:
    to_fit, held = record(1), replace(record(2, held_out=True), name="other", notes=())
    both = extract_long([to_fit, held], AXIS, [])
    assert set(both) == {"long", "other"}
    assert [p.t_s[0] for p in both["long"]] == [p.t_s[0] for p in extract_long([to_fit], AXIS, [])["long"]]
    assert all(part.sidecar.held_out for part in both["other"])


def test_an_excited_record_keeps_its_first_whole_periods() -> None:
    note = ExcitationNote("multisine", period_samples=1700, first_sample=900)
    whole, remarks = record(3, excitation=note), list[str]()
    (part,) = extract_long([whole], AXIS, remarks)["long"]
    assert part.name == "long"
    assert (len(part.t_s) - 900) % 1700 == 0
    assert extracts.EXTRACT_ROWS - 1700 < len(part.t_s) <= extracts.EXTRACT_ROWS
    assert part.sidecar == whole.sidecar
    assert "long and excited all along" in remarks[0]


def test_without_a_radius_nobody_knows_where_a_stretch_begins() -> None:
    parts = extract_long([record(2)], Axis(name="one mass"), [])["long"]
    assert parts
    assert all(part.sidecar.start_position_m is None for part in parts)


def test_a_record_that_hardly_moves() -> None:
    whole = record(4)
    still = np.where(np.arange(len(whole.position)) < 4000, whole.position, whole.position[4000])
    parts = extract_long([replace(whole, position=still, notes=())], AXIS, [])["long"]
    assert any(part.t_s[0] < 9.0 for part in parts)
