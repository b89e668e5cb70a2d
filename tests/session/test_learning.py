"""A move taught by its repetitions, on an independent machine; what was learnt is driven again from its file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from beltcomm import api
from beltcomm.configfiles import read_yaml, to_yaml, write_text
from beltcomm.errors import Refused, SafetyStop, UsageError
from beltcomm.experiments import learning
from beltcomm.experiments.learning import _repetition
from beltcomm.recording import Recording
from beltcomm.recording.signalfile import read_columns
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Silence
from beltcomm.verify import Verdict
from session.bench import Bench


@pytest.mark.examination
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


def test_a_stop_in_a_repetition_loses_none_before_it(
    copy_of_complete: Callable[..., Path], make_bench: Callable[..., Bench], monkeypatch: pytest.MonkeyPatch
) -> None:
    run, bench, told = copy_of_complete(), make_bench("g_a"), Heard()
    first = next(name for name in (f"move_{n}" for n in range(1, 9)) if RunFolder.open(run).finished(name) is None)
    drive_once, driven = learning.verify_move, []

    def stopped(*given: Any, **more: Any) -> Any:
        driven.append(given)
        if len(driven) == 3:
            raise SafetyStop("the motor torque reached its limit: the axis was stopped", "torque")
        return drive_once(*given, **more)

    monkeypatch.setattr(learning, "verify_move", stopped)
    with pytest.raises(SafetyStop):
        api.verify(bench.name, run, learn=4, options=api.Options(yes=True, seed=1), talk=told)
    folder = RunFolder.open(run)
    number = int(first.removeprefix("move_"))
    kept = [folder.load_result(f"verify_move_{n}") for n in (number, number + 1)]
    assert all(one is not None and one["proof"]["gains"] for one in kept)
    assert [one["proof"].get("led_by") for one in kept if one] == [None, "learnt"]
    said = "\n".join(told.lines)
    assert "learnt torque" in said
    columns = read_columns(run / "designs" / f"move_{number + 1}_learnt.csv", {"t_s"})
    assert np.max(np.abs(columns["torque_along_nm"])) > 0.0


class Heard(Silence):
    """Lines that were said."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def say(self, *texts: Any, **_: Any) -> None:
        self.lines += map(str, texts)


def test_what_cannot_be_sent_is_not_learnt(copy_of_complete: Callable[..., Path], make_bench: Callable[..., Bench]) -> None:
    """On a run that knows no drive yet: another one than its own is refused for that."""
    run = copy_of_complete()
    about = read_yaml(run / "run.yaml")
    assert about.pop("drive")
    write_text(run / "run.yaml", to_yaml(about))
    make_bench("g_a", profile="cmmp-as")
    with pytest.raises(Refused, match="takes no torque along with a reference"):
        api.verify("virtual:g_a", run, learn=2, options=api.Options(yes=True, seed=1))


def test_lost_rows_shift_no_error() -> None:
    """A record keeps gaps where answers were lost; the errors of two drives are still compared and learnt sample by sample."""
    t_s = 1e-3 * np.arange(400)
    reference, error = np.clip(10.0 * (t_s - 0.05), 0.0, 3.0), 1e-3 * np.sin(20.0 * t_s)
    whole = Recording("whole", t_s, np.sin(30.0 * t_s), reference - error, reference_position=reference)
    kept = np.delete(np.arange(400), [100, 101, 250])
    torn = Recording("torn", t_s[kept], whole.torque[kept], whole.position[kept], reference_position=reference[kept])
    found = [_repetition(one.name, one, 0.0124, np.zeros(400), cast(Verdict, None), 1e-3) for one in (whole, torn)]
    assert found[1].error_m == pytest.approx(found[0].error_m, abs=1e-8)


def test_how_often_is_asked_before_anything_is_opened(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="2 or more"):
        api.verify("nowhere", tmp_path, learn=1)
    with pytest.raises(UsageError, match="one of them"):
        api.verify("nowhere", tmp_path, learn=3, rungs=True)


def test_what_is_learnt_belongs_to_the_motion_of_the_motor(copy_of_complete: Callable[..., Path], make_bench: Callable[..., Bench]) -> None:
    """A compliant feedforward begins earlier than the move, so that a torque by the clock of the move would come too early."""
    run, bench = copy_of_complete(), make_bench("g_a")
    with pytest.raises(Refused, match="belongs to the move itself"):
        api.verify(bench.name, run, learn=2, options=api.Options(yes=True, seed=1, feedforward="compliant"))
