"""Moves in rows: where they begin and end, whatever the encoder and the pause between two."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm.watching.moves import LEAD_S, LONGEST_S, SPAN_S, Move, StreamPart, moves_in

Array = NDArray[np.float64]
PERIOD_S = 1e-3


def rows(*ways_rad: float, rest_s: float = 0.4, counts: int = 65536, seed: int = 0, last_s: float = 0.4) -> dict[str, Array]:
    """Moves of half a second, each from rest to rest, as an encoder shows them that trembles by a count."""
    parts, here = [np.zeros(round(0.4 / PERIOD_S))], 0.0
    for number, way in enumerate(ways_rad):
        t = np.linspace(0.0, 1.0, 500)
        parts.append(here + way * t**3 * (10.0 - 15.0 * t + 6.0 * t**2))
        here += way
        parts.append(np.full(round((rest_s if number < len(ways_rad) - 1 else last_s) / PERIOD_S), here))
    angle, step = np.concatenate(parts), math.tau / counts
    trembling = np.random.default_rng(seed).integers(-1, 2, len(angle)) * (np.random.default_rng(seed + 1).random(len(angle)) < 0.2)
    return {"t_s": PERIOD_S * np.arange(len(angle)), "position_rad": (np.round(angle / step) + trembling) * step}


def found(columns: dict[str, Array], after_s: float = -math.inf, ended: bool = False, start_s: float = 0.0) -> list[Move]:
    return moves_in(StreamPart(columns, start_s), after_s, ended)[0]


@pytest.mark.parametrize("seed", range(4))
def test_each_motion_between_two_rests_is_one_move(seed: int) -> None:
    ways = np.random.default_rng(seed).uniform(5.0, 40.0, 5) * np.array([1, -1, 1, 1, -1])
    moves = found(rows(*ways, seed=seed))
    assert [round(float(np.ptp(move.columns["position_rad"]))) for move in moves] == [round(abs(way)) for way in ways]
    for number, move in enumerate(moves):
        begins = 0.4 + 0.9 * number
        assert begins - LEAD_S - SPAN_S <= move.start_s <= begins + 0.1
        assert move.end_s <= begins + 0.5 + LEAD_S + SPAN_S
        assert move.columns["t_s"][0] == 0.0


def test_a_move_is_told_once_it_is_over_and_only_once() -> None:
    columns = rows(20.0, -20.0, last_s=0.05)
    assert len(found(columns)) == 1  # nobody knows yet whether the second is over
    assert len(found(columns, ended=True)) == 2
    first = found(columns)[0]
    assert [move.start_s > first.end_s for move in found(columns, after_s=first.end_s, ended=True)] == [True]


def test_a_pause_too_short_for_a_rest_joins_two_motions() -> None:
    assert len(found(rows(20.0, -20.0, rest_s=0.05))) == 1


def test_an_axis_that_trembles_at_rest_makes_no_move() -> None:
    assert found(rows(seed=3), ended=True) == []
    columns = rows(0.02)  # a creep of two hundred counts in half a second is one; of ten it is none
    assert len(found(columns, ended=True)) == 1
    assert found(rows(0.001), ended=True) == []


def test_a_motion_without_a_rest_comes_in_pieces() -> None:
    t_s = PERIOD_S * np.arange(round(2.5 * LONGEST_S / PERIOD_S))
    columns = {"t_s": t_s, "position_rad": np.round(30.0 * np.sin(0.7 * t_s) / 1e-4) * 1e-4}
    moves = found(columns)
    assert len(moves) == 2
    assert all(move.end_s - move.start_s < LONGEST_S + 0.3 for move in moves)
    assert len(found(columns, ended=True)) == 3


def test_the_stream_s_clock_is_kept() -> None:
    (move,) = found(rows(20.0), start_s=1000.0)
    assert 1000.4 - LEAD_S - SPAN_S <= move.start_s < 1000.45
