"""A move taught by its repetitions, on an independent machine; what was learnt is driven again from its file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from beltcomm import api
from beltcomm.configfiles import read_yaml, to_yaml, write_text
from beltcomm.errors import Refused
from beltcomm.recording.signalfile import read_columns
from session.bench import Bench


def test_repetitions_teach_the_move(copy_of_complete: Callable[..., Path], make_bench: Callable[..., Bench]) -> None:
    run, bench = copy_of_complete(), make_bench("g_a")
    before = bench.name
    found = api.verify(before, run, learn=3, options=api.Options(yes=True, seed=1)).to_json()
    rms = [one["rms_m"] for one in found["repetitions"]]
    assert len(rms) == 4
    assert rms[2] < 0.45 * rms[0]
    assert rms[-1] == pytest.approx(rms[2], rel=0.05)  # the last one drives the best torque once more
    assert found["noise_limit_m"] < 0.1 * rms[2]
    assert found["ended"] == ""
    assert 20.0 < found["band_hz"] < 400.0

    columns = read_columns(Path(found["file"]), {"t_s"})
    assert set(columns) == {"t_s", "position_m", "velocity_m_s", "torque_along_nm"}
    assert 0.0 < np.max(np.abs(columns["torque_along_nm"])) < 0.5
    again = api.verify(before, run, move=found["file"], options=api.Options(yes=True, seed=1, force=True)).to_json()
    assert again["measured"]["dynamic_m"] < 0.7 * found["repetitions"][0]["largest_m"]
    assert np.max(np.abs(bench.plant.belt_force_n)) < 110.0


def test_what_cannot_be_sent_is_not_learnt(copy_of_complete: Callable[..., Path], make_bench: Callable[..., Bench]) -> None:
    """On a run that knows no drive yet: another one than its own is refused for that."""
    run = copy_of_complete()
    about = read_yaml(run / "run.yaml")
    assert about.pop("drive")
    write_text(run / "run.yaml", to_yaml(about))
    make_bench("g_a", profile="cmmp-as")
    with pytest.raises(Refused, match="takes no torque along with a reference"):
        api.verify("virtual:g_a", run, learn=2, options=api.Options(yes=True, seed=1))
