"""Generated edges against both channels sampled in every tick, and against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm.encoder.edges import Flaws, edges_of
from beltcomm.errors import UsageError


def test_edges_are_the_changes_of_the_sampled_channels() -> None:
    def motion(t: NDArray[np.float64]) -> NDArray[np.float64]:
        return 0.7e-6 + 30e-6 * np.cos(2.0 * np.pi * 700.0 * t) + 4e-6 * np.sin(2.0 * np.pi * 5000.0 * t)

    edges = edges_of(motion, 2e-3, scan_s=1e-5)
    # Independent: two square waves a quarter of four increments apart, A ahead.
    turn = motion(1e-8 * np.arange(200_001)) / 10e-6
    channels = np.array([(turn - 0.25) % 1.0 < 0.5, (turn - 0.5) % 1.0 < 0.5]).astype(int)
    for which in (0, 1):
        changes = np.flatnonzero(np.diff(channels[which])) + 1
        mine = edges.channel == which
        np.testing.assert_array_equal(edges.tick[mine], changes)
        np.testing.assert_array_equal(edges.level[mine], channels[which][changes])
    assert (edges.level_a, edges.level_b) == tuple(channels[:, 0])
    assert len(edges.tick) > 50


@pytest.mark.parametrize("speed", [1e-4, 0.0371, 4.9])
def test_a_steady_motion_passes_its_lines_on_time(speed: float) -> None:
    duration = 100 * 2.5e-6 / speed
    edges = edges_of(lambda t: speed * t, duration)
    exact = 2.5e-6 / speed * np.arange(1, len(edges.tick) + 1) / 1e-8
    late = edges.tick - exact
    assert len(edges.tick) in (99, 100)  # the last one lies on the end
    assert np.all(late > -1e-3)
    assert np.all(late < 1.0 + 1e-3), "seen in the tick that follows the passage"


def test_a_turning_point_between_scans_is_not_missed() -> None:
    # The peak lies midway between two scans, so both see the same position; it passes a line for 80 us.
    def motion(t: NDArray[np.float64]) -> NDArray[np.float64]:
        from_peak = np.round(t / 1e-8) - 550_000.0  # whole ticks, so that both scans see exactly the same
        return np.asarray(2.5e-6 + 1e-9 - (from_peak / 100_000.0) ** 2 * 1e-6)

    edges = edges_of(motion, 1e-2, scan_s=1e-3)
    near = edges.tick[(edges.tick > 530_000) & (edges.tick < 570_000)]
    half_width = 1e-3 * np.sqrt(1e-3) / 1e-8
    np.testing.assert_allclose(near, [550_000 - half_width, 550_000 + half_width], atol=1.01)


def test_lines_off_their_place_are_off_at_every_passage_and_by_seed() -> None:
    flaws = Flaws(line_rms=0.1, seed=3)
    forth = edges_of(lambda t: 0.02 * t, 0.05, flaws=flaws)
    again = edges_of(lambda t: 0.02 * t, 0.05, flaws=flaws)
    back = edges_of(lambda t: 0.001 - 0.02 * t, 0.05, flaws=flaws)
    other = edges_of(lambda t: 0.02 * t, 0.05, flaws=Flaws(line_rms=0.1, seed=4))
    np.testing.assert_array_equal(forth.tick, again.tick)
    assert not np.array_equal(forth.tick, other.tick)
    lines_forth, lines_back = 0.02 * forth.tick * 1e-8, (0.001 - 0.02 * back.tick * 1e-8)[::-1]
    np.testing.assert_allclose(lines_forth[1:398], lines_back[np.argmin(np.abs(lines_back - lines_forth[1])) :][:397], atol=4e-10)
    off = np.diff(lines_forth) / 2.5e-6 - 1.0
    assert 0.1 < np.std(off) < 0.18, "differences of two places, each 0.1 increments rms: 0.141"


def test_bounces_come_in_pairs_before_the_next_edge_and_by_seed() -> None:
    clean = edges_of(lambda t: 0.05 * t, 0.05)
    made = [edges_of(lambda t: 0.05 * t, 0.05, flaws=Flaws(bounces=2, bounce_s=1e-3, seed=s)) for s in (1, 1, 2)]
    np.testing.assert_array_equal(made[0].tick, made[1].tick)
    assert not np.array_equal(made[0].tick, made[2].tick)
    assert (len(made[0].tick) - len(clean.tick)) % 2 == 0
    assert len(made[0].tick) > len(clean.tick)
    slots = np.searchsorted(clean.tick, made[0].tick, side="right")
    half = 0.5 * 2.5e-6 / 0.05 / 1e-8
    since = made[0].tick - clean.tick[slots - 1]
    assert np.all(since[slots < len(clean.tick)] <= half), "after the last edge there is none to keep clear of"
    for which in (0, 1):
        levels = made[0].level[made[0].channel == which]
        assert np.all(np.diff(levels) != 0), "a channel changes at each of its edges"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"increment_m": 0.0}, "both must be above 0"),
        ({"tick_s": -1e-8}, "both must be above 0"),
        ({"duration_s": 0.0}, "less than two ticks"),
        ({"scan_s": 1e-9}, "less than a tick"),
        ({"flaws": Flaws(line_rms=0.3)}, "would change places"),
        ({"flaws": Flaws(bounces=-1)}, "must not be negative"),
        ({"motion": lambda t: t / 0.0 if t.size == 1 else np.full(t.shape, np.nan)}, "not finite"),
    ],
)
def test_what_makes_no_sense_is_refused(change: dict[str, object], words: str) -> None:
    call: dict[str, object] = {"motion": lambda t: 0.1 * t, "duration_s": 1e-3, **change}
    with pytest.raises(UsageError, match=words):
        edges_of(call.pop("motion"), call.pop("duration_s"), **call)  # type: ignore[arg-type]
