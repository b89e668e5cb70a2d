"""Belt axes drawn at random whose commissioning ended wrongly once; others: ``benchmarks/drawn_axes.py``."""

from __future__ import annotations

from pathlib import Path

import pytest

from beltcomm.axis import load_axis
from beltcomm.experiments import phases
from beltcomm.machine.machine import Machine
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Silence
from session.drawn_axis import commissioned, in_its_middle
from truth.drawn_axes import draw_axis


@pytest.mark.examination
@pytest.mark.parametrize(
    "seed",
    [
        202,  # wandered out of what was foreseen in each of three responses
        204,  # swings so fast that position and speed seemed to contradict each other
        430,  # a coarse encoder told ten times the viscous friction: it went further than was foreseen, and its strokes left the travel
        441,  # wandered out of its first excitation
        446,  # soft belt: its breakaway told half of its friction, and a weak loop did not move it
        552,  # an antiresonance at 3 Hz: its periods did not fit into the seconds of a response
        902,  # 10:1, and a carriage of which the motor felt only the belt: 10 t, and a response too long to be made
        931,  # a belt as soft as its friction: the first loop got a fifth of the friction and lost the carriage
        947,  # 10:1 again: barely broken away, a carriage of 3.8 t
        210,  # its strokes did not fit into its travel, then it left that with a weak first loop
    ],
)
def test_a_drawn_axis_is_commissioned(seed: int, tmp_path: Path) -> None:
    row = commissioned(seed, tmp_path, 200.0)
    assert row["right"], row


def test_a_belt_that_the_first_way_left_stretched_is_no_weight(tmp_path: Path) -> None:
    """10:1 and most of the friction at the carriage: it broke away at 61 mN m forth and at 22 back, and 20 mN m passed for a weight."""
    drawn = draw_axis(902)
    file, bench = in_its_middle(drawn, tmp_path)
    axis = load_axis(str(file))
    with bench.open(bench.name) as drive, Machine(drive, axis, RunFolder.create(tmp_path / "run", axis), Silence()) as machine:
        breakaway = phases.sign_and_scale(machine)
    bench.close()
    assert abs(breakaway.holding_nm) < 2e-3
    assert breakaway.coulomb_nm > drawn.axis.coulomb_motor_nm
