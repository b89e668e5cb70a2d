"""The state machine against the text of 6.1, and against a reference that samples both channels in every tick."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm.encoder.edges import Edges, Flaws, count_increments, edges_of
from beltcomm.encoder.kernel import COUNT, GAP, INCREMENTS, INVALID, PREVIOUS, STATE, STEPS, new_decoder, take_edge, take_stretch
from beltcomm.errors import DataError

FORWARD = [(0, 0), (1, 0), (1, 1), (0, 1)]  # S1 to S4; A leads


def walk(levels: list[tuple[int, int]], *, debounce: bool = True) -> tuple[list[tuple[int, int]], list[int]]:
    """States with their "previous", and increments, for a sequence of levels, one channel at a time."""
    registers = new_decoder(*levels[0], debounce=debounce)
    states, steps = [(int(registers[STATE]), int(registers[PREVIOUS]))], []
    for tick, (old, new) in enumerate(itertools.pairwise(levels), 1):
        channel = 0 if old[0] != new[0] else 1
        steps.append(take_edge(registers, tick, channel, new[channel]))
        states.append((int(registers[STATE]), int(registers[PREVIOUS])))
    return states, steps


def test_forward_runs_through_s1_to_s4_and_reverse_through_s5_to_s8() -> None:
    states, steps = walk([FORWARD[k % 4] for k in range(9)])
    assert [state for state, _ in states] == [1, 2, 3, 4, 1, 2, 3, 4, 1]
    assert steps == [1] * 8
    states, steps = walk([FORWARD[-k % 4] for k in range(10)])
    # The first edge may be a bounce; from the second on the motion is known to go back.
    assert [state for state, _ in states] == [1, 1, 6, 7, 8, 5, 6, 7, 8, 5]
    assert steps == [0] + [-1] * 8


def test_the_bounce_of_the_text_is_no_increment() -> None:
    # "prevents a switching from S3 to S7, if the previous state has been S2.  ... the previous state is then set to be S7 ...
    # if the next state is S3, the previous state is again set to be S2."
    s1, s2, s3, s4 = FORWARD
    states, steps = walk([s1, s2, s3, s2, s3, s2, s3, s4])
    assert states[2:7] == [(3, 2), (3, 7), (3, 2), (3, 7), (3, 2)]
    assert steps == [1, 1, 0, 0, 0, 0, 1]


def test_the_reversal_of_the_text_costs_one_increment() -> None:
    # "... if the next state is S8, a sign reversal of the velocity occured."
    s1, s2, s3, _ = FORWARD
    states, steps = walk([s1, s2, s3, s2, s1])
    assert states[2:] == [(3, 2), (3, 7), (8, 7)]
    assert steps == [1, 1, 0, -1]


def test_without_debouncing_every_edge_counts() -> None:
    s1, s2, s3, s4 = FORWARD
    _, steps = walk([s1, s2, s3, s2, s3, s4, s3, s2, s1], debounce=False)
    assert steps == [1, 1, -1, 1, 1, -1, -1, -1]


def sampled(motion: NDArray[np.float64], increment: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Reference: what a plain counter with a play of one increment makes of the position in every tick: ticks and steps.

    The plain count n is ⌊x/Δ⌋; the count with play follows only where n leaves the interval [d − 1, d].
    """
    plain = np.floor(motion / increment).astype(int)
    d, ticks, steps = plain[0], [], []
    for tick in np.flatnonzero(np.diff(plain)) + 1:
        new = min(max(d, plain[tick]), plain[tick] + 1)
        if new != d:
            ticks.append(tick)
            steps.append(new - d)
            d = new
    return np.array(ticks), np.array(steps)


@pytest.mark.parametrize("seed", range(8))
def test_the_state_machine_counts_what_a_reference_on_samples_counts(seed: int) -> None:
    rng = np.random.default_rng(seed)
    size, rate, phase = 1e-6 * rng.uniform(2.0, 40.0, 4), rng.uniform(200.0, 3000.0, 4), rng.uniform(0.0, 6.0, 4)
    drift = rng.uniform(-0.02, 0.02)

    def motion(t: NDArray[np.float64]) -> NDArray[np.float64]:
        wave = size[:, None] * np.sin(2.0 * np.pi * rate[:, None] * t.ravel() + phase[:, None])
        return np.asarray(wave.sum(axis=0).reshape(t.shape) + drift * t)

    duration = 2e-3
    edges = edges_of(motion, duration, scan_s=2e-5)
    found, plain = count_increments(edges), count_increments(edges, debounce=False)
    positions = motion(1e-8 * np.arange(round(duration / 1e-8) + 1))
    ticks, steps = sampled(positions, 2.5e-6)
    assert len(ticks) > 20, "the motion of this seed must pass lines and turn"
    assert len(set(steps)) == 2
    assert found.invalid == 0
    np.testing.assert_array_equal(found.tick, ticks)
    np.testing.assert_array_equal(found.step, steps)
    changes = np.diff(np.floor(positions / 2.5e-6).astype(int))
    np.testing.assert_array_equal(plain.tick, np.flatnonzero(changes) + 1)
    np.testing.assert_array_equal(plain.step, changes[changes != 0])


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize("lost", range(3, 9))
def test_a_lost_edge_is_noticed(sense: float, lost: int) -> None:
    edges = edges_of(lambda t: 1.3e-6 + sense * 0.1 * t, 1e-3)
    kept = np.arange(len(edges.tick)) != lost
    cut = Edges(edges.tick[kept], edges.channel[kept], edges.level[kept], edges.level_a, edges.level_b)
    assert count_increments(edges).invalid == 0
    assert count_increments(cut).invalid >= 1
    # Noticed at the next edge of the same channel, two edges later: not only at the end of the record.
    registers = new_decoder(cut.level_a, cut.level_b)
    for i in range(lost + 2):
        take_edge(registers, cut.tick[i], cut.channel[i], cut.level[i])
    assert registers[INVALID] == 1


def test_nothing_is_measured_across_an_invalid_edge() -> None:
    registers = new_decoder(0, 0)
    for tick, channel, level in ((10, 0, 1), (20, 1, 1), (30, 0, 0)):
        take_edge(registers, tick, channel, level)
    assert (registers[GAP], registers[INCREMENTS], registers[STEPS]) == (10, 3, 2)
    take_edge(registers, 40, 0, 0)  # A falls, but it is low: its rise and the edge of B before were missed
    assert (registers[INVALID], registers[GAP], registers[INCREMENTS], registers[STEPS]) == (1, 0, 0, 0)
    take_edge(registers, 50, 1, 0)
    assert (registers[GAP], registers[INCREMENTS], registers[STEPS]) == (0, 1, 0), "one increment alone has no time"
    take_edge(registers, 65, 0, 1)
    assert (registers[GAP], registers[INCREMENTS], registers[STEPS]) == (15, 2, 1)


def test_both_channels_in_one_tick_are_invalid_and_move_nothing() -> None:
    registers = new_decoder(0, 0)
    assert take_edge(registers, 10, 0, 1) == 1
    before = registers[COUNT]
    assert take_edge(registers, 20, 1, 1) == 1
    assert take_edge(registers, 20, 0, 0) == -1, "the first edge of the tick is taken back"
    assert (registers[COUNT], registers[INVALID]) == (before, 1)
    # From (0, 1) it goes on as if it had come there forward.
    assert registers[STATE] == 4
    assert take_edge(registers, 30, 1, 0) == 1


def test_an_axis_too_fast_for_the_clock_is_noticed() -> None:
    # Above one increment per tick, 250 m/s, both channels change in one tick sooner or later.
    slow = count_increments(edges_of(lambda t: 240.0 * t, 2e-5))
    fast = count_increments(edges_of(lambda t: 300.0 * t, 2e-5))
    assert (slow.invalid, slow.count) == (0, 1920)
    assert fast.invalid > 100
    assert len(fast.tick) == len(fast.step)
    assert np.all(np.diff(fast.tick) > 0)


def test_bounces_do_not_move_the_count() -> None:
    def motion(t: NDArray[np.float64]) -> NDArray[np.float64]:
        return 100e-6 * np.sin(2.0 * np.pi * 20.0 * t)

    clean = edges_of(motion, 0.1)
    rough = edges_of(motion, 0.1, flaws=Flaws(bounces=3, bounce_s=20e-6, seed=5))
    assert len(rough.tick) > 1.5 * len(clean.tick)
    expected, found = count_increments(clean), count_increments(rough)
    assert found.invalid == 0
    np.testing.assert_array_equal(found.step, expected.step)
    # A line counts when it is first reached, so bounces after it shift no increment in time.
    np.testing.assert_array_equal(found.tick, expected.tick)
    # Not so where every edge counts, although the sum is right again after each bounce.
    plain = count_increments(rough, debounce=False)
    assert len(plain.tick) == len(rough.tick)
    assert plain.invalid == 0


def test_standing_and_shaking_across_a_line_is_no_motion() -> None:
    edges = edges_of(lambda t: 10e-6 + 1.0e-6 * np.sin(2.0 * np.pi * 200.0 * t), 0.1)
    assert len(edges.tick) == 40, "200 Hz for 0.1 s passes one line twice per turn"
    assert count_increments(edges, debounce=False).tick.size == 40
    # It stands just above the line and comes back to it.
    assert count_increments(edges).tick.size == 0


def test_edges_out_of_order_are_refused() -> None:
    edges = Edges(np.array([5, 3]), np.array([0, 1]), np.array([1, 1]), 0, 0)
    with pytest.raises(DataError, match="edge 1 lies at tick 3, before edge 0 at tick 5; sort"):
        count_increments(edges)


def test_a_stretch_makes_the_edges_of_its_motion() -> None:
    # Straight stretches of 0.1 ms through a motion that turns, against the generator on the same broken line.
    t = 1e-4 * np.arange(201)
    nodes = 0.4e-6 + 40e-6 * np.sin(2.0 * np.pi * 90.0 * t)
    edges = edges_of(lambda at: np.interp(at, t, nodes), 0.02)
    registers, plain = new_decoder(0, 0), new_decoder(0, 0)
    for k in range(200):
        take_stretch(registers, nodes[k], nodes[k + 1], 10_000 * k, 10_000, 2.5e-6)
    for tick, channel, level in zip(edges.tick, edges.channel, edges.level, strict=True):
        take_edge(plain, tick, channel, level)
    assert len(edges.tick) > 100
    assert registers[INVALID] == 0
    # Ticks may differ by one where a passage falls on a tick.
    np.testing.assert_allclose(registers, plain, atol=2)
    assert registers[COUNT] == plain[COUNT]
