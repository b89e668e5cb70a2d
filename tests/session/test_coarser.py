"""An angle that was recorded coarser than the encoder of the axis file is taken as it is, and that is said."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from beltcomm.given import pasted
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import Sidecar
from beltcomm.rundata.offline import _coarser


def turned(counts: int, speed_rad_s: float = 20.0) -> Recording:
    times = 1e-3 * np.arange(4000)
    step = math.tau / counts
    angle = step * np.floor(speed_rad_s * np.sin(3.0 * times) / step)
    return Recording(name="turned", t_s=times, torque=np.sin(times), position=angle, sidecar=Sidecar("free"))


@pytest.mark.parametrize(
    ("recorded", "stated", "taken"), [(16384, 65536, 16384), (65536, 65536, 0), (65536, 16384, 0), (10000, 65536, 10000)]
)
def test_whole_steps_tell_the_counts(recorded: int, stated: int, taken: int) -> None:
    assert _coarser([turned(recorded)], stated) == taken


def test_a_fast_motion_with_few_neighbours_says_nothing() -> None:
    fast = turned(65536, 4000.0)
    assert _coarser([replace(fast, position=fast.position[:400], t_s=fast.t_s[:400], torque=fast.torque[:400])], 65536) == 0


def test_a_folder_that_begins_with_a_dash_is_no_option() -> None:
    assert pasted("-weird") == "./-weird"
    assert pasted("a b") == "'a b'"
