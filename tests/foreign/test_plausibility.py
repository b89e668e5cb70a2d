"""Doubts about units, signs and scales: value, expectation, remedy; and none about a good record."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from beltcomm.axis import load_axis
from beltcomm.cli.main import cli
from beltcomm.foreign.plausibility import findings
from beltcomm.recording import Recording
from foreign.samples import CONSTANT_NM_A, COUNTS, options, swing, text, write

AXIS = load_axis("egc-70-600")
RATIO = AXIS.transmission_m_rad
T, CURRENT, ENCODER = swing(3000)
#: 1e-3 kg m², within what the axis file allows; a swing of 14 rad, 0.18 m, at 0.78 m/s.
TORQUE, ANGLE = CONSTANT_NM_A * CURRENT, math.tau / COUNTS * ENCODER
SPEED = 20.0 * math.pi * np.sin(1.4 * math.pi * T)


def said(**changes: Any) -> list[str]:
    record = Recording(**({"name": "a", "t_s": T, "torque": TORQUE, "position": ANGLE} | changes))
    return [str(finding) for finding in findings(record, AXIS)]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_motion_one_way_that_does_work_on_its_torque_is_doubted(sign: float) -> None:
    t_s = 1e-3 * np.arange(2000)
    doubts = said(t_s=t_s, position=5.0 * t_s, torque=sign * (0.3 + 0.1 * np.sin(40.0 * t_s)))
    assert any("in a motion that goes one way" in doubt for doubt in doubts) is (sign < 0.0), doubts


def test_a_good_record_raises_no_doubt() -> None:
    assert said(velocity=SPEED, cart_position_m=RATIO * ANGLE, load_position_rad=ANGLE) == []


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"torque": 1e3 * TORQUE}, ("the inertia by the", "expected 5.02e-05 to 0.0309 kg m²", "torque_nm in mN m or thousandths")),
        ({"torque": 1e-3 * TORQUE}, ("the inertia by the regression", "kN m")),
        ({"position": np.degrees(ANGLE)}, ("the inertia by the regression", "position_rad in degrees")),
        ({"position": 20.0 * ANGLE}, ("the carriage's speed is 15.6 m/s, expected at most 5 m/s",)),
        ({"torque": -TORQUE}, ("is -0.00", "expected a positive one", "--flip torque or --flip position")),
        ({"cart_position_m": 1e3 * RATIO * ANGLE}, ("the feed constant", "expected 78.037 mm", "cart_position_m is in mm")),
        ({"cart_position_m": 1.2 * RATIO * ANGLE}, ("is 93.645 mm per revolution, expected 78.037 mm", "correct the axis file")),
        ({"cart_position_m": -RATIO * ANGLE}, ("is -78.037 mm per revolution", "--map cart_position_m=-NAME")),
        ({"load_position_rad": ANGLE / 3.0}, ("is 1:3, expected 1:1 by gearbox.ratio",)),
        ({"velocity": 1.3 * SPEED}, ("velocity_rad_s over the change of position_rad is 1.3, expected 1",)),
        ({"velocity": np.cos(3.0 * T)}, ("the likeness of velocity_rad_s to the change of position_rad", "another signal")),
        ({"t_s": 20.0 * T}, ("the time between rows is 20 ms, expected at most 10 ms",)),
        ({"t_s": 1e-2 * T}, ("the time between rows is 10 us, expected at least 20 us",)),
        ({"torque": 1e-3 * TORQUE}, ("the torque's range is 0.00", "more than two thousandths of the rated 1.43 N m")),
        ({"position": 1e-6 * ANGLE}, ("the travel is 0.000", "look at the unit of position_rad")),
    ],
)  # fmt: skip
def test_each_doubt_has_value_expectation_and_remedy(changes: dict[str, Any], words: tuple[str, ...]) -> None:
    found = said(**changes)
    assert any(all(word in line for word in words) for line in found), found


def test_torque_in_ampere_is_thought_of_where_that_alone_would_fit() -> None:
    axis = replace(AXIS, motor=replace(AXIS.motor, torque_constant_nm_a=0.02))
    line = next(str(found) for found in findings(Recording("a", T, TORQUE / 0.02, ANGLE), axis) if "inertia" in found.what)
    assert "torque_nm is in ampere (--map current_a=NAME)" in line


@pytest.mark.parametrize(("factor", "peak", "doubted"), [(1e3, None, True), (1.0, None, False), (1.0, 0.5, False)])
def test_a_torque_far_above_the_rating_alone_is_doubted(factor: float, peak: float | None, doubted: bool) -> None:
    motor = replace(AXIS.motor, inertia_kg_m2=None, peak_torque_nm=peak, rated_torque_nm=0.3)
    axis = replace(AXIS, motor=motor, pulley=replace(AXIS.pulley, effective_radius_m=None))
    lines = [str(found) for found in findings(Recording("a", T, factor * TORQUE, ANGLE), axis)]
    assert any("expected at most 10 times the rated 0.3 N m" in line for line in lines) is doubted, lines


@pytest.mark.parametrize(("sign", "stiffness", "doubted"), [(1.0, 0.3, False), (-1.0, 0.0, True)])
def test_a_spring_is_no_wrong_sign(sign: float, stiffness: float, doubted: bool) -> None:
    """At a few Hz it takes more than the inertia, against it; a sign that is wrong in truth is told all the same."""
    angle = 2.0 * np.sin(2.6 * math.pi * T) + 0.8 * np.sin(6.2 * math.pi * T + 0.4)
    speed = np.gradient(angle, T)
    torque = 2.5e-4 * np.gradient(speed, T) + 1e-3 * speed + stiffness * angle + np.random.default_rng(1).normal(0.0, 4e-3, len(T))
    axis = replace(AXIS, motor=replace(AXIS.motor, inertia_kg_m2=None), pulley=replace(AXIS.pulley, effective_radius_m=None))
    lines = [str(found) for found in findings(Recording("a", T, sign * torque, angle), axis)]
    assert any("--flip torque" in line for line in lines) is doubted, lines


@pytest.mark.parametrize(("ratio", "inertia", "asked"), [(20.0, None, True), (20.0, 7e-5, False), (1.0, None, False)])
def test_behind_a_gearbox_nobody_knows_at_which_shaft_a_torque_was_taken(ratio: float, inertia: float | None, asked: bool) -> None:
    """Where the motor's inertia is known, that tells it."""
    motor = replace(AXIS.motor, inertia_kg_m2=inertia)
    axis = replace(AXIS, motor=motor, gearbox=replace(AXIS.gearbox, ratio=ratio), pulley=replace(AXIS.pulley, effective_radius_m=None))
    lines = [str(found) for found in findings(Recording("a", T, TORQUE, ANGLE), axis)]
    assert any("the shaft at which" in line and "torque_nm=NAME*0.05" in line for line in lines) is asked, lines


def test_the_unit_factors_found_are_those_that_were_made() -> None:
    """The regression finds 1e-3 kg m² in the good record; the doubt about thousandths names 1 kg m²."""
    line = next(line for line in said(torque=1e3 * TORQUE) if "inertia" in line)
    value = float(line.split(" is ")[1].split(" ")[0])
    assert value == pytest.approx(1.0, rel=0.02)


def test_flip_turns_what_the_doubt_says(tmp_path: Path) -> None:
    log = write(tmp_path / "log.csv", text())
    wrong = options(("t_s=time", "torque_nm=-Iq*0.65", "position_rad=enc*rev/65536"))
    refused = CliRunner().invoke(cli, ["import", str(log), "--run", str(tmp_path / "a"), *wrong])
    assert refused.exit_code == 3
    assert "--flip torque" in refused.stderr
    for flip in ("torque", "position"):
        run = tmp_path / flip
        done = CliRunner().invoke(cli, ["import", str(log), "--run", str(run), *wrong, "--flip", flip])
        assert done.exit_code == 0, done.output
        assert "doubt:" not in done.stdout
        assert "1 of 1 imports" in CliRunner().invoke(cli, ["import", "--check", "--run", str(run)]).stdout


def test_doubts_are_shown_and_are_in_the_json(tmp_path: Path) -> None:
    log = write(tmp_path / "log.csv", text())
    words = ["import", str(log), "--run", str(tmp_path / "a"), "--axis", "egc-70-600", "--dry-run"]
    mapping = options(("t_s=time", "torque_nm=Iq*0.65/1000", "position_rad=enc*rev/65536"))
    shown = CliRunner().invoke(cli, [*words, *mapping])
    assert "  doubt: the inertia by the regression of torque_nm on acceleration is" in shown.stdout
    assert '"expected": "5.02e-05 to 0.0309 kg m' in CliRunner().invoke(cli, [*words, *mapping, "--json"]).stdout


SHARES = {
    "thousandths": (np.round(1000.0 * TORQUE / 1.43), "it looks like thousandths"),
    "per cent": (np.round(100.0 * TORQUE / 1.43, 1), "per cent of"),
}


@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("header", ["t,Torque [Nm],Angle [rad]", "t_s,torque_nm,position_rad", "t,Drehmoment,Winkel [rad]"])
@pytest.mark.parametrize("axis", ["", "egc-70-600"])
def test_a_share_of_the_rated_torque_that_no_header_states_is_never_taken_in_silence(
    share: str, header: str, axis: str, tmp_path: Path
) -> None:
    """Asked for where the unit is open; refused where the motor cannot give as much; a doubt where nothing is known of the motor."""
    torque, doubt = SHARES[share]
    rows = "\n".join(f"{a:.4f},{b:g},{c:.6f}" for a, b, c in zip(T, torque, ANGLE, strict=True))
    path = write(tmp_path / "a.csv", f"{header}\n{rows}\n")
    outcome = CliRunner().invoke(cli, ["import", str(path), "--run", str(tmp_path / "run"), *(["--axis", axis] if axis else [])])
    told = " ".join(outcome.output.split())
    if header.startswith("t,Dreh"):
        assert outcome.exit_code == 1
        assert "torque_nm: its unit is not stated" in told
    elif axis:
        assert outcome.exit_code == 3
        assert "gives at most 3.1 N m; look at the column's unit (thousandths? per cent of rated?)" in told
    else:
        assert outcome.exit_code == 0
        assert doubt in told


def test_newton_metres_with_their_decimals_and_a_current_in_tenths_raise_no_doubt() -> None:
    bare = replace(AXIS, motor=replace(AXIS.motor, peak_torque_nm=None, rated_torque_nm=None))
    for record in (
        Recording("a", T, np.round(20.0 * TORQUE, 2), ANGLE),
        Recording("a", T, np.round(TORQUE, 1), ANGLE),
        Recording("a", T, np.round(20.0 * TORQUE, 1), ANGLE, side="ampere"),
    ):
        assert not [doubt for doubt in map(str, findings(record, bare)) if "in steps of 0.1" in doubt or "whole numbers" in doubt]
