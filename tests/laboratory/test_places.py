"""Places where a model fails: the words must say what was put into the residual, and nothing else."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm.fit.residual.segment import Segment
from beltcomm.laboratory.compare import Comparison, worst
from beltcomm.laboratory.place_words import in_words
from beltcomm.laboratory.places import worst_places
from beltcomm.laboratory.samples import Judged, Units
from beltcomm.simulate.inverse import FineMotion

Array = NDArray[np.float64]
RATIO, SAMPLE_S, NOISE = 0.0125, 1e-3, 0.01


class Plain:
    """Whitening of white noise."""

    def __call__(self, torque: Array, keep: NDArray[np.bool_]) -> Array:
        return np.asarray(torque[keep] / NOISE)


def judged(missing: Any, seconds: float = 40.0, units: Units | None = None) -> list[Judged]:
    """Strokes of 0.4 m at rising speeds; ``missing(place m, speed m/s, time s, angle rad)`` is measured torque beyond the model's."""
    random = np.random.default_rng(7)
    n = round(seconds / SAMPLE_S)
    time = SAMPLE_S * np.arange(n)
    speed = 0.004 * np.exp(time / seconds * 5.0) * np.where(np.sin(time * 2.0 * np.pi / 4.0) >= 0.0, 1.0, -1.0)
    place = 0.3 + np.cumsum(speed) * SAMPLE_S
    place = 0.1 + np.abs((place - 0.1 + 0.4) % 0.8 - 0.4)
    angle = place / RATIO
    more = missing(place, speed, time, angle)
    white = random.standard_normal(n)
    torque = NOISE * white - more
    motion = FineMotion(angle, speed / RATIO, n, SAMPLE_S, 1, 0.0)
    load = 0.1 * np.sign(speed) + 0.05 * np.sin(time)
    white_noise: Any = Plain()
    piece = Segment("sweep", False, angle, load, motion, np.ones(n, dtype=bool), NOISE, 0.0, 0.0, white_noise)
    return [Judged(piece, torque / NOISE, torque, RATIO, torque, units or Units())]


def told(missing: Any, **options: Any) -> list[str]:
    found = judged(missing, **options)
    white = found[0].white
    comparison = Comparison(float(np.sqrt(np.mean(white**2))), None, "size", (), tuple(worst_places(found)), tuple(found))
    return [in_words(place) for place in worst(comparison)]


def test_a_healthy_machine_has_no_place() -> None:
    assert told(lambda x, v, t, a: 0.0 * x) == []


def test_slow_friction_is_said_with_its_torque_and_both_directions() -> None:
    words = told(lambda x, v, t, a: 0.031 * np.sign(v) * (np.abs(v) < 0.02))
    assert words[0].startswith("speeds below 0.02 m/s: ")
    assert "both directions: measured torque 31 mN m higher" in words[0]


def test_a_tight_spot_is_said_with_its_place() -> None:
    words = told(lambda x, v, t, a: 0.05 * np.sign(v) * np.exp(-(((x - 0.36) / 0.02) ** 2)))
    assert words[0].startswith("carriage between 0.32 and 0.40 m")
    assert "higher" in words[0]


def test_an_offset_is_to_one_side_and_not_friction() -> None:
    words = told(lambda x, v, t, a: -0.02 + 0.0 * x)
    assert words[0].startswith("both directions: measured torque 20 mN m to the negative side; without that 1.0")


def test_a_force_is_small_against_that_of_its_axis_alone() -> None:
    """Of a light axis: a fifth of all force was told as "no force is missing on average"."""
    words = told(lambda x, v, t, a: -0.02 + 0.0 * x, units=Units("N", "m"))
    assert words[0].startswith("both directions: measured force 0.02 N to the negative side; without that 1.0")


def test_one_direction_alone_is_named() -> None:
    words = told(lambda x, v, t, a: 0.03 * (v > 0.0))
    assert any("in positive direction measured torque 30 mN m higher" in text or "to the positive side, beside" in text for text in words)


def test_a_ripple_is_said_with_its_order_and_amplitude() -> None:
    words = told(lambda x, v, t, a: 0.008 * np.sin(17.0 * a + 0.4))
    assert words[0].startswith("17 times per turn of the motor: the torque swings by 8 mN m")
    assert "without it 1.0" in words[0]


def test_what_warms_up_is_said_with_its_time() -> None:
    words = told(lambda x, v, t, a: 0.04 * np.sign(v) * (t < 10.0))
    assert any(text.startswith("0 to 10 s on the session's clock") for text in words)


@pytest.mark.parametrize(("units", "text"), [(Units("N", "m"), "measured force 31 N higher"), (Units("A", "rad"), "measured current 31 A")])
def test_units_are_those_of_the_axis(units: Units, text: str) -> None:
    words = told(lambda x, v, t, a: 31.0 * np.sign(v) * (x < 0.2), units=units)
    assert any(text in line for line in words)
