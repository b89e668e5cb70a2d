"""Drive against axis.yaml: the numbers of the shipped axis, by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from beltcomm.axis import Axis, load_axis
from beltcomm.drive.finding import Finding, Values
from beltcomm.jobs.doctor import _compared

AXIS = load_axis("egc-70-600")  # 1.43 N m, 0.65 N m/A, 65536 counts, r = 12.42 mm, no gear, -10 to 570 mm
FEED_M = 2.0 * math.pi * 0.01242
SOUND: Values = {
    "rated_torque_nm": 1.43, "rated_current_a": 2.2, "counts_per_rev": 65536, "gear_ratio": 1.0, "units_per_rev": 65536.0,
    "position_rad": 0.25 / 0.01242, "referenced": True,
}  # fmt: skip


def states(values: Values, ratio: float = 1.0) -> dict[str, str]:
    axis = replace(AXIS, gearbox=replace(AXIS.gearbox, ratio=ratio))
    return {finding.name: finding.state for finding in _compared([Finding("a", "b", "ok", "", "", {**SOUND, **values})], axis)}


def test_a_sound_drive() -> None:
    assert set(states({}).values()) == {"ok"}
    assert len(states({})) == 5


@pytest.mark.parametrize(("share", "state"), [(0.94, "wrong"), (0.96, "ok"), (1.04, "ok"), (1.06, "wrong")])
def test_ratings_may_differ_by_five_percent(share: float, state: str) -> None:
    """The bound of the project's text: rated values that differ by more than 5 % are refused."""
    assert states({"rated_torque_nm": 1.43 * share, "rated_current_a": 2.2 * share})["rated torque"] == state
    assert states({"rated_current_a": 2.2 / share})["torque per current"] == state


@pytest.mark.parametrize(
    ("units", "state"),
    [
        (65536.0, "ok"),
        (-65536.0, "ok"),  # polarity 607Eh
        (1e6 * FEED_M, "ok"),  # um
        (1e4 * FEED_M, "ok"),  # 0.1 mm
        (1e6 * FEED_M * 1.01, "warning"),  # feed constant of another pulley
        (3600.0, "ok"),  # 0.1 degree
        (10000.0, "ok"),
        (131072.0, "warning"),
        (32768.0, "warning"),
    ],
)
def test_position_units_of_a_revolution(units: float, state: str) -> None:
    assert states({"units_per_rev": units})["feed"] == state


@pytest.mark.parametrize(("drive", "axis", "state"), [(1.0, 3.0, "ok"), (3.0, 3.0, "ok"), (3.0, 1.0, "wrong"), (2.0, 3.0, "wrong")])
def test_gears(drive: float, axis: float, state: str) -> None:
    told = states({"gear_ratio": drive}, axis)
    assert told["gear"] == state
    assert ("feed" in told) == (state == "ok")


@pytest.mark.parametrize(("position_m", "state"), [(-0.0101, "wrong"), (-0.0099, "ok"), (0.5699, "ok"), (0.5701, "wrong")])
def test_the_travel(position_m: float, state: str) -> None:
    assert states({"position_rad": position_m / 0.01242})["position"] == state
    assert states({"position_rad": position_m / 0.01242, "referenced": False})["position"] == "unknown"


def test_what_the_drive_did_not_tell_is_left_out() -> None:
    assert _compared([Finding("bus", "interface", "wrong", "", "")], AXIS) == []
    assert _compared([Finding("a", "b", "ok", "", "", {"rated_torque_nm": 0.0})], AXIS) == []


def test_a_file_that_commissioning_would_refuse_is_told_at_once() -> None:
    told = _compared([Finding("a", "b", "ok", "", "", SOUND)], Axis(name="new"))
    (entries,) = [finding for finding in told if finding.state == "wrong"]
    assert (entries.name, entries.remedy) == ("entries", "add it from the data sheet")
    assert "commission needs motor.inertia_kg_m2" in entries.text
