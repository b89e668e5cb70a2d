"""Healthy motors of the examination, behind drives and encoders that are drawn: nothing is named, and the error is the noise.

Draws that were wrong once: rounding that goes with a steady speed, a path of which a part of the records tells too little, a filter read
at the end of a period, noise behind the reading's filter taken for torque, a delay that is whole in all and divided within a sample.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from hidden_effects import examined


@pytest.mark.examination
@pytest.mark.parametrize(
    ("family", "seed"),
    [("rigid", 990031), ("rigid", 990045), ("rigid", 970019), ("rigid", 1200506), ("rigid", 1200516), ("instruments", 1200016)],
)
def test_a_healthy_machine_behind_a_drawn_drive_misses_nothing(family: str, seed: int) -> None:
    """The last one has torque of which a filtered reading misses most."""
    line = examined(family, seed, (), 1.0)
    assert line["verdict"] == "nothing missing"
    assert line["kept"] == []
    assert line["ratio"][0] == pytest.approx(1.0, abs=0.05)
    for name, (truth, found, half) in line["base"].items():
        assert half is not None, name
        assert abs(found - truth) < 1.5 * half, name


@pytest.mark.examination
@pytest.mark.parametrize(
    ("family", "seed", "kept"),
    [
        ("rigid", 1200840, []),  # the command behind a filter of its samples, every 5 ms: no lag of 40 ms is tried
        ("rigid", 1200842, []),  # a loop whose shape the reading hides behind its own filter, refitted before it is judged
        ("rigid", 1200875, []),  # a filter of the command every 10 ms, hidden in the noise of a reading with a filter of its own
        ("instruments", 1200418, []),  # a slew rate behind an inner cycle out of step, read through 1.8 ms
        ("instruments", 1200428, []),  # few values of a coarse encoder, grouped alike for all paths
        ("instruments", 1200408, []),  # a command whose loop is of second order
        ("instruments", 1200399, ["encoder_interpolation"]),  # lines counted from one angle in all records
        ("instruments", 1200407, ["encoder_interpolation"]),  # all instruments at once
    ],
)
def test_a_path_of_several_filters_is_no_effect_of_the_machine(family: str, seed: int, kept: list[str]) -> None:
    """Draws that were told effects or 0.5 to 5 times the noise once; an interpolation error that is there may hide in the rounding."""
    line = examined(family, seed, (), 1.0)
    assert set(line["kept"]) <= set(kept)
    assert line["ratio"][-1] == pytest.approx(1.0, abs=0.1)


@pytest.mark.examination
def test_without_a_setpoint_no_delay_of_the_drive_is_a_name() -> None:
    """Its encoder errs within its lines, which stands."""
    line = examined("rigid", 1200512, (), 1.0)
    assert line["verdict"] == "cannot tell"
    assert line["kept"] == ["encoder_interpolation"]


@pytest.mark.examination
@pytest.mark.parametrize(
    ("family", "seed", "within"), [("instruments", 1200001, 0.05), ("instruments", 1100003, 0.05), ("rigid", 1200509, 0.2)]
)
def test_the_error_is_the_noise_where_the_setpoint_tells_little_of_it(family: str, seed: int, within: float) -> None:
    """A reading that is the command, whose noise was found too large (0.6, 0.7); a setpoint that goes with it behind a slow filter only."""
    line = examined(family, seed, (), 1.0)
    assert line["ratio"][0] == pytest.approx(1.0, abs=within)
    assert set(line["kept"]) <= {"encoder_interpolation"}


@pytest.mark.examination
@pytest.mark.parametrize(
    ("family", "seed", "hidden", "strength", "named"),
    [
        ("effects_instruments", 1200661, "dead_time", 0.4, "dead_time"),
        ("effects_instruments", 1200662, "current_lag", 1.0, "current_lag"),
        ("rigid", 1200770, "", 1.0, "encoder_interpolation"),
    ],
)
def test_a_filter_is_told_from_the_effect_that_hid_whose_it_is(family: str, seed: int, hidden: str, strength: float, named: str) -> None:
    """Without the effect the filter passed for the other one, the drive's or the reading's, and for effects that are not there."""
    line = examined(family, seed, (hidden,) if hidden else (), strength)
    assert line["kept"] == [named]
    assert line["ratio"][1] == pytest.approx(1.0, abs=0.05)


@pytest.mark.examination
def test_records_held_out_that_miss_nothing_do_not_contradict() -> None:
    """Warm after the session: friction that fell while it ran is not in them, and the plain error there is what it was."""
    line = examined("effects_instruments", 1200679, ("warmup",), 0.4)
    assert line["kept"] == ["warmup"]
