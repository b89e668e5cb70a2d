"""The numbers that a person at the machine agrees to."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import pytest

from beltcomm.axis import load_axis
from beltcomm.drive import open_drive
from beltcomm.drive.finding import Finding
from beltcomm.errors import UsageError
from beltcomm.experiments.agreement import plan_result
from beltcomm.experiments.options import Options
from beltcomm.experiments.plan import Experiment, Plan, commission_plan, move_plan
from beltcomm.experiments.plan_screen import plan_screen
from beltcomm.experiments.plan_words import commission_points
from beltcomm.jobs.doctor import _compared
from beltcomm.machine.ratings import check_ratings, counts_rating

RIG = load_axis("egc-70-600")


def experiments(speed_m_s: float) -> dict[str, Experiment]:
    axis = replace(RIG, limits=replace(RIG.limits, speed_m_s=speed_m_s))
    with open_drive("virtual:g_a", {"seed": 1}) as drive:
        return {item.title: item for item in commission_plan(axis, drive.capabilities).experiments}


def test_no_speed_in_the_plan_exceeds_that_of_the_axis() -> None:
    assert max(item.speed_m_s for item in experiments(0.05).values()) <= 0.05


def test_the_speeds_are_those_that_can_be_driven() -> None:
    """A move of 0.5 m bound by jerk alone takes T = (32 x/j)^(1/3), its top speed is 2x/T = 1.36 m/s."""
    planned = experiments(5.0)
    assert planned["verification move"].speed_m_s == pytest.approx(1.0 / (32.0 * 0.5 / 40.0) ** (1.0 / 3.0), rel=0.01)
    assert planned["constant-speed sweep"].speed_m_s < 2.0


def test_what_is_agreed_to_stands_in_short_labelled_lines() -> None:
    """Every label is there, how fast and how hard follow the table, and nothing is a block of words."""
    with open_drive("virtual:g_a", {"seed": 1}) as drive:
        plan = commission_plan(RIG, drive.capabilities)
    told = {row.cells[0]: row.cells[1] for row in plan.table() if not row.head}
    assert list(told) == [
        "what moves", "how far", "how fast", "how hard", "how long", "how heavy", "what stops it", "how it brakes",
        "PC or bus lost", "what is written",
    ]  # fmt: skip
    assert max(len(words.split()) for words in [plan.text, *told.values()]) <= 50
    assert told["how fast"] == f"up to {max(e.speed_m_s for e in plan.experiments):.3g} m/s"
    assert told["how long"].startswith("up to 75 s; what does not fit")
    assert "the plan assumes 0.3 kg (worst case for speed)" in told["how heavy"]
    (heavy,) = re.findall(r"with 30 kg its strokes and fast moves reach ([\d.]+) m/s", told["how heavy"])
    fastest = math.sqrt(RIG.belt_force_limit_n / 30.0 * max(e.travel_m for e in plan.experiments))  # half the way up, half down, no jerk
    assert 0.5 * fastest < float(heavy) < fastest
    loaded = replace(RIG, payload=replace(RIG.payload, mass_kg=8.0))
    assert "assumes 8 kg, the stated payload alone" in dict(commission_points(loaded, drive.capabilities, 8.0, (30.0, 1.0)))["how heavy"]
    *each, whole, kept = (int(line.split()[-2]) for line in plan.lines() if re.search(r"  \d+ s$", line))
    assert (sum(each), kept) == (whole, 75)


def test_doctor_plan_and_commissioning_say_one_thing_of_the_encoder() -> None:
    """Half the counts: the doctor calls it wrong, the plan says it will be refused, and it is refused, all with one sentence."""
    axis = replace(RIG, motor=replace(RIG.motor, encoder_counts_per_rev=32768))
    with open_drive("virtual:g_a", {"seed": 1}) as drive:
        with pytest.raises(UsageError, match=r"65536 counts/rev, axis\.yaml says 32768") as refused:
            check_ratings(axis, drive.capabilities)
        shown = plan_result(Plan("", ()), drive.capabilities, Options(), axis)
    assert shown.exit_code == 1
    assert f"This plan will be refused: {refused.value}." in shown.text
    (found,) = [
        one for one in _compared([Finding("drive", "encoder", "ok", "", values={"counts_per_rev": 65536})], axis) if one.name == "encoder"
    ]
    assert (found.state, found.remedy) == ("wrong", counts_rating(axis, 65536).remedy)
    assert found.remedy in str(refused.value)


def test_the_duration_on_the_screen_is_told_beside_what_its_entries_add_up_to() -> None:
    with open_drive("virtual:g_a", {"seed": 1}) as drive:
        lines = plan_screen(commission_plan(RIG, drive.capabilities), RIG, drive.capabilities)
    (whole,) = [int(found[1]) for line in lines if (found := re.search(r"of (\d+) s below", line))]
    entries = [int(seconds) for line in lines for seconds in re.findall(r" mm\s*(\d+) s", line)]
    assert abs(whole - sum(entries)) <= 0.5 * len(entries)  # each is rounded


def test_a_move_that_proves_gains_is_told_by_its_ends_and_its_stop_apart_from_the_limit_of_the_move() -> None:
    plan = replace(
        move_plan(RIG, 0.5, 0.547, 1.28, 1.4, 88.7, 7.0, "go", 0.1, "verify"), span_m=(0.0, 0.547), stop_n=108.0, host_loss_n=150.0
    )
    with open_drive("virtual:g_a", {"seed": 1}) as drive:
        text = "\n".join(plan_screen(plan, RIG, drive.capabilities))
    assert "0 ... 547 mm on the axis" in text
    assert "stop 108 N + friction" in text
    assert "up to 88.7 N" in text
    assert "where it stands" not in text
