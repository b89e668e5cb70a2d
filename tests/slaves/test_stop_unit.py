"""A unit of acceleration that only a profile states: a slow stop shows it, or it is said that none did."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from beltcomm.drive import ObservedStop
from beltcomm.experiments.stop_unit import _judge
from slaves.bench import BELT_N, TOLD, SlaveRig, sentence, words

LEXIUM = TOLD["lexium32"]
GAINS: dict[str, Any] = {
    "gain_meaning": "documented",
    "parameters": {
        "kp_nm_s_rad": {"index": 0x3012, "subindex": 3, "type": "uint16", "scale": 9.549e-4 * 0.65},
        "ki_nm_rad": {"index": 0x3012, "subindex": 4, "type": "uint16", "scale": 1.0e-5, "law": "integral_time"},
        "kpp_1_s": {"index": 0x3012, "subindex": 5, "type": "uint16", "scale": 0.1},
    },
}
PERIOD_S, RATIO = 2e-3, 0.0124


def stop_of(speed: float, deceleration: float, lag_s: float, until_s: float, ended_s: float | None) -> ObservedStop:
    """A carriage that follows a ramp through a first-order lag; m as if rad were m over the ratio."""
    t = np.arange(0.0, until_s + PERIOD_S, PERIOD_S)
    ramp = np.maximum(speed - deceleration * t, 0.0)
    v = np.empty_like(t)
    v[0] = speed
    for n in range(1, len(t)):
        v[n] = v[n - 1] + PERIOD_S / max(lag_s, PERIOD_S) * (ramp[n] - v[n - 1])
    return ObservedStop(tuple(t), tuple(np.cumsum(v) * PERIOD_S / RATIO), ended_s)


@pytest.mark.parametrize("seed", range(20))
def test_a_ramp_as_it_was_meant_is_none_that_contradicts(seed: int) -> None:
    draw = np.random.default_rng(seed)
    speed, lag_s = float(draw.uniform(0.005, 0.05)), float(draw.uniform(0.0, 0.06))
    meant = speed / 0.5
    ended = 0.5 + float(draw.uniform(0.0, 0.1)) + 3.0 * lag_s
    assert _judge(stop_of(speed, meant, lag_s, ended, ended), speed, meant, RATIO).kind == "as meant"


@pytest.mark.parametrize("factor", [10.0, 60.0, 1000.0])
@pytest.mark.parametrize("seed", range(5))
def test_a_steeper_and_a_flatter_ramp_contradict(factor: float, seed: int) -> None:
    draw = np.random.default_rng(seed)
    speed, lag_s = float(draw.uniform(0.005, 0.05)), float(draw.uniform(0.0, 0.02))
    meant = speed / 0.5
    ended = 0.5 / factor + 0.01 + 4.0 * lag_s
    assert _judge(stop_of(speed, factor * meant, lag_s, ended, ended), speed, meant, RATIO).kind == "steeper"
    assert _judge(stop_of(speed, meant / factor, lag_s, 2.3, None), speed, meant, RATIO).kind == "flatter"


def test_a_drive_that_does_not_end_its_stops_tells_by_a_carriage_that_goes_on_only() -> None:
    going, standing = stop_of(0.03, 0.006, 0.01, 2.3, None), stop_of(0.03, 0.6, 0.01, 2.3, None)
    assert _judge(going, 0.03, 0.06, RATIO, ends=False).kind == "flatter"
    assert _judge(standing, 0.03, 0.06, RATIO, ends=False).kind == "untold"
    assert _judge(standing, 0.03, 0.06, RATIO, brake_s=0.7).kind == "untold"  # the watch was too short for a brake


def test_a_stop_that_a_brake_or_a_late_loop_may_have_ended_tells_nothing() -> None:
    assert _judge(stop_of(0.03, 6.0, 0.01, 0.4, 0.4), 0.03, 0.06, RATIO, brake_s=0.3).kind == "untold"
    assert _judge(stop_of(0.03, 0.06, 0.5, 1.4, 1.4), 0.03, 0.06, RATIO).kind == "untold"


def test_a_ramp_that_no_unit_makes_flat_is_told_when_it_takes_too_long_only() -> None:
    assert _judge(stop_of(0.03, 1e-3, 0.01, 2.3, None), 0.03, 1.0, RATIO).kind == "flatter"
    for ended in (0.02, 0.05):
        assert _judge(stop_of(0.03, 1.0, 0.01, ended, ended), 0.03, 1.0, RATIO).kind == "untold"


def commissioned(unit: str, folder: Path, verb: str = "commission") -> tuple[SlaveRig, int | None, str, str]:
    """A played drive that tells no unit, with a profile: rig, exit code, all that was said, the journal."""
    profile = folder / "told.yaml"
    profile.write_text(yaml.safe_dump({"name": "told", "title": "as told", **LEXIUM, **GAINS, "acceleration_unit": unit}))
    rig = SlaveRig("lexium32")
    outcome = rig.call(*words(verb, folder / "run", ["--profile", str(profile)]), "--position", "250mm")
    journal = (folder / "run" / "journal.txt").read_text(encoding="utf-8")
    return rig, outcome.code, outcome.text, journal


@pytest.mark.parametrize(("unit", "how"), [("0.1 rpm/s", "harder"), pytest.param("10 rpm/s", "more softly", marks=pytest.mark.examination)])
def test_a_wrong_unit_ends_a_commissioning_at_a_slow_stop(unit: str, how: str, tmp_path: Path) -> None:
    rig, code, text, journal = commissioned(unit, tmp_path)
    said = sentence(text)
    assert code == 5
    assert re.search(rf"a quick stop from [\d.]+ mm/s with [\d.]+ m/s² \(6085h\) was to take .* {how} than meant", said), said
    assert f"count in {unit} by acceleration_unit of the profile alone" in said
    assert "605Ah" in said
    assert "sweep" not in journal  # nothing faster
    assert max(rig.examiner.belt_n) < BELT_N
    rig.run_on(0.5)
    assert not rig.examiner.powered[-1]
    assert max(map(abs, rig.examiner.speed_m_s[-50:])) < 1e-3
    assert not rig.changed()
    rig.close()


@pytest.mark.examination
def test_a_right_unit_is_shown_and_the_job_goes_on(tmp_path: Path) -> None:
    rig, code, text, journal = commissioned("1 rpm/s", tmp_path)
    assert code in (0, 1), text
    assert "what 6085h counts in is as meant" in journal
    assert "no stop has shown" not in text
    rig.close()


@pytest.mark.examination
def test_an_identification_tries_its_loop_by_a_slow_stop(tmp_path: Path) -> None:
    rig, code, text, journal = commissioned("0.1 rpm/s", tmp_path, "identify")
    assert (code == 5) == ("harder than meant" in text)
    assert code == 5 or "no stop has shown" in text, text
    assert "slow stop" in journal
    rig.close()
