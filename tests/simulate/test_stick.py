"""One body with set-valued friction over one step."""

from __future__ import annotations

import itertools

import pytest

from beltcomm.simulate.kernels.pieces import stick_or_slide

CASES = list(itertools.product((-1.3, -0.02, 0.0, 0.4), (-9.0, -3.9, 0.0, 4.0, 6.5), (0.0, 4.0)))


@pytest.mark.parametrize(
    ("speed", "push", "grip", "h", "after"),
    [
        (1.0, 0.0, 4.0, 0.1, 0.6),  # slides on
        (1.0, 0.0, 4.0, 0.5, 0.0),  # stops after 0.25 s and holds
        (1.0, -10.0, 4.0, 0.5, -6.0 * (0.5 - 1.0 / 14.0)),  # stops after 1/14 s and is pulled back
        (0.0, 4.0, 4.0, 0.5, 0.0),  # holds up to its level
        (0.0, -5.0, 4.0, 0.5, -0.5),  # breaks away
        (-1.0, 2.0, 0.0, 1.0, 1.0),  # without friction
    ],
)
def test_closed_forms(speed: float, push: float, grip: float, h: float, after: float) -> None:
    assert stick_or_slide(speed, push, grip, h) == pytest.approx(after, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize(("speed", "push", "grip"), CASES)
def test_two_steps_are_one_of_both_lengths(speed: float, push: float, grip: float) -> None:
    """An exact solution cannot depend on where it is cut."""
    whole = stick_or_slide(speed, push, grip, 0.35)
    assert stick_or_slide(stick_or_slide(speed, push, grip, 0.12), push, grip, 0.23) == pytest.approx(whole, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(("speed", "push", "grip"), CASES)
def test_both_directions_are_alike(speed: float, push: float, grip: float) -> None:
    assert stick_or_slide(-speed, -push, grip, 0.3) == -stick_or_slide(speed, push, grip, 0.3)
