"""Other axes than belts: their files, words and units, and a load that moves with the motor rigidly."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from beltcomm.axis import Axis, axis_from_dict, load_axis
from beltcomm.axis.kinds import ARC_M, KINDS
from beltcomm.axis.targets import with_targets
from beltcomm.axis.terms import pictures_in, terms, terms_of
from beltcomm.configfiles import config_names
from beltcomm.errors import UsageError
from beltcomm.fit.start.model import start_model
from beltcomm.model import build_model
from beltcomm.pages.quantities import quantities_of
from beltcomm.recording import Recording, Sidecar
from beltcomm.report.page import _svg_of
from beltcomm.result import Line, Result, table
from beltcomm.runfolder import RunFolder
from beltcomm.sentences.own_words import _aligned, lines_in, own_words, text_in
from beltcomm.sentences.watch import COLUMNS, head_line, summary_lines
from beltcomm.simulate.forward import rigid_force_n, simulate_torque
from beltcomm.watching.drift import AxisDrift
from beltcomm.watching.estimates import MoveEstimate
from beltcomm.watching.limits import Limit

OTHERS = [name for name in config_names("axes") if load_axis(name).kind in KINDS]
BELT_WORDS = re.compile(r"(?i)\b(belts?|pulleys?|carts?)\b")
ROTARY = {
    "name": "table", "transmission": {"kind": "rotary", "stiffness_nm_rad": 2000.0},
    "motor": {"inertia_kg_m2": 1e-3, "peak_torque_nm": 20.0}, "gearbox": {"ratio": 4.0},
    "travel": {"min_deg": -180.0, "max_deg": 180.0}, "limits": {"speed_deg_s": 720.0, "load_torque_nm": 15.0},
    "payload": {"inertia_kg_m2": 0.01}, "targets": {"at": "load", "following_error_deg": 0.1},
}  # fmt: skip


@pytest.mark.parametrize("name", OTHERS)
def test_a_file_of_another_kind_comes_back_and_names_no_belt(name: str) -> None:
    axis = load_axis(name)
    assert axis_from_dict(axis.to_dict()) == axis
    assert not BELT_WORDS.search(str(axis.to_dict()))
    axis.require("commission", *axis.needs)


def test_every_kind_ships_an_axis() -> None:
    assert {load_axis(name).kind for name in OTHERS} == set(KINDS)


def test_a_load_that_turns_is_its_arc() -> None:
    axis = axis_from_dict(ROTARY)
    assert (axis.travel.max_m, axis.limits.speed_m_s, axis.targets.at) == (0.18, 0.72, "carriage")
    assert axis.transmission_m_rad * 4.0 == pytest.approx(math.radians(1.0) ** -1 * 1e-3)  # one degree of the load is 1 mm
    assert axis.limits.feed_force_n * ARC_M == pytest.approx(15.0)
    # energy does not ask for the coordinate: m v² = J ω², c s² = k φ²
    speed = 3.0
    assert axis.payload.mass_kg * (speed * ARC_M) ** 2 == pytest.approx(0.01 * speed**2)
    assert axis.belt_stiffness_n_m(0.0) * (0.02 * ARC_M) ** 2 == pytest.approx(2000.0 * 0.02**2)


def test_a_linear_motor_turns_once_a_pole_pair() -> None:
    axis = load_axis("linear-motor")
    radius = 0.032 / math.tau
    assert axis.transmission_m_rad == pytest.approx(radius)
    assert axis.motor.inertia_kg_m2 == pytest.approx(2.1 * radius**2)
    assert axis.torque_limit_nm / radius == pytest.approx(480.0)
    assert axis.belt_force_limit_n == pytest.approx(480.0)  # where nothing else is stated
    assert axis.rigid


def test_a_coupling_alone_makes_an_axis_swing() -> None:
    axis = axis_from_dict({"transmission": {"kind": "screw", "lead_m": 0.01}, "coupling": {"stiffness_nm_rad": 900.0}})
    assert not axis.rigid
    assert axis.belt_stiffness_n_m(0.3) == pytest.approx(900.0 * (math.tau / 0.01) ** 2)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"transmission": {"kind": "spindel"}}, r"transmission\.kind is 'spindel'; it is one of belt, screw, rack, rotary, linear"),
        ({"transmission": {"lead_m": 1}}, r"transmission\.kind is not stated"),
        ({"belt": {"pitch_m": 0.003}}, "unknown key 'belt' of rotary axis"),
        ({"travel": {"min_m": 1.0}}, r"unknown key 'min_m' in travel, did you mean min_deg\?"),
        ({"limits": {"speed_deg_s": 0.0}}, r"limits\.speed_deg_s is 0\.0 °/s; it must be above 0"),
        ({"limits": {"speed_deg_s": "fast"}}, "is 'fast'; give a number in °/s"),
        ({"travel": {"min_deg": 200.0, "max_deg": 180.0}}, r"travel\.min_deg is 200°; it must be below travel\.max_deg, 180°"),
    ],
)
def test_a_wrong_entry_is_named_as_the_file_has_it(change: dict[str, object], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        axis_from_dict({**ROTARY, **change})


def test_a_quantity_means_the_same_in_the_units_of_a_load_that_turns() -> None:
    """Numbers at random, by the laws of the arc and not by the table of factors."""
    said, random = terms("rotary").said, np.random.default_rng(1)
    per_unit = {"N": ARC_M, "kg": ARC_M**2, "N s/m": ARC_M**2, "mm": 1.0, "m/s": 1e3, "m": 1e3}
    into = {"N": "N m", "kg": "kg m²", "N s/m": "N m s/rad", "mm": "°", "m/s": "°/s", "m": "°"}
    for unit, factor in per_unit.items():
        for value in 10.0 ** random.uniform(0.0, 4.0, 20):
            text = said(f"up to {value:.4g} {unit} at the load")
            number, shown = re.fullmatch(r"up to ([\d.e+-]+) ?(\S.*) at the load", text).groups()
            assert float(number) * (1e-4 if shown == "kg cm²" else 1.0) == pytest.approx(value * factor, rel=2e-3)
            assert shown in (into[unit], "kg cm²")
            assert said(text) == text


@pytest.mark.parametrize("text", ["3.1 N m", "2 mN m", "0.4 N m s/rad", "5 N m/rad", "4 kg m²", "4 kg cm²", "45 deg", "20 Hz", "3 ms"])
def test_what_the_motor_has_stays_as_it_is(text: str) -> None:
    assert terms("rotary").said(f"takes {text}, and more") == f"takes {text}, and more"


def test_a_list_of_numbers_has_one_unit() -> None:
    said = terms("rotary").said
    assert said("between -10 and 20 mm, ±1, ±0.4 mm, 55 to 89 N") == "between -10 and 20°, ±1, ±0.4°, 3.15 to 5.1 N m"
    assert said("force in N") == "force in N at r 57.3 mm"  # of a picture: right for its numbers as they are


@pytest.mark.parametrize("kind", KINDS)
def test_no_sentence_speaks_of_a_belt(kind: str) -> None:
    text = "Belt force up to 90 N in the belt; the carriage of a belt axis, its driving pulley and belt_stiffness.stiffness"
    assert not re.search(r"(?i)belt|pulley", terms(kind, 0.005).said(text))


def test_a_belt_axis_keeps_every_word() -> None:
    assert not terms_of(load_axis("egc-70-600"))
    assert not terms_of(Axis())


def test_columns_stay_below_each_other() -> None:
    own = terms("rotary")
    rows = lines_in(own, [*table(["move", ">belt", "time"], [["a", "1000 N", "5 s"], ["b", "80 N", "12 s"]])])
    assert [row.rindex("  ") for row in rows] == [rows[0].rindex("  ")] * 3
    assert _aligned(own, "speed    up to 2 m/s      axis").index("axis") == "speed    up to 2 m/s      axis".index("axis")
    line = Line(("carriage".ljust(12), ""), ("1 mm".ljust(8), ""), "ok")
    assert lines_in(own, [line])[0].index("ok") == line.index("ok")


def rigid_record(seed: int) -> tuple[Recording, dict[str, float]]:
    """A loud record of a random load on the motor of the torque table, simulated by Newton's law alone."""
    random = np.random.default_rng(seed)
    inertia, coulomb, viscous = random.uniform(0.012, 0.05), random.uniform(0.1, 0.5), random.uniform(0.0, 0.05)
    period, fine, n = 1e-3, 50, 6000
    torque = np.repeat(random.choice([-4.0, 4.0], n // 10), 10)
    angle, speed, seen = 0.0, 0.0, np.empty(n)
    for k in range(n):
        seen[k] = angle
        for _ in range(fine):
            free = torque[k] - viscous * speed
            slowed = speed + period / fine * (free - coulomb * np.sign(speed)) / inertia
            speed = 0.0 if speed * slowed < 0.0 and abs(free) < coulomb else slowed if speed else speed + period / fine * free / inertia
            angle += period / fine * speed
    step = math.tau / 4194304
    noisy = torque + random.normal(0.0, 0.01, n)
    sidecar = Sidecar(experiment="frf", start_position_m=0.1)
    record = Recording("frf_1", period * np.arange(n), noisy, step * np.floor(seen / step), torque, sidecar=sidecar)
    return record, {"inertia": inertia, "coulomb": coulomb, "viscous": viscous}


@pytest.mark.parametrize("seed", [1, 2])
def test_a_rigid_load_is_found_beside_the_motor_of_the_data_sheet(seed: int) -> None:
    record, truth = rigid_record(seed)
    axis = load_axis("torque-table")
    model = start_model(axis, [record])
    assert model["motor.inertia"] == axis.motor_side_inertia_kg_m2
    assert model.driven_inertia() == pytest.approx(truth["inertia"], rel=0.02)
    assert model["cart.mass"] * ARC_M**2 == pytest.approx(truth["inertia"] - 9.2e-3, rel=0.05)
    assert model["coulomb.level"] == pytest.approx(truth["coulomb"], rel=0.1)


def test_a_rigid_axis_moves_as_one_and_its_load_is_pushed_by_its_own_mass() -> None:
    values = {"motor.inertia": 2e-4, "cart.mass": 5.0, "transmission.ratio": 0.01, "viscous.damping": 0.0, "coulomb.level": 0.0}
    model = build_model("m", ("rigid_load", "viscous", "coulomb"), values, base_bodies=("motor",))
    result = simulate_torque(model, np.full(100, 0.7), 1e-3)
    acceleration = 0.7 / (2e-4 + 5.0 * 0.01**2)
    assert result.velocity_rad_s[-1] == pytest.approx(acceleration * 0.099)
    assert result.belt_force_n == pytest.approx(5.0 * 0.01 * acceleration)
    lifted = build_model("m", ("rigid_load", "tilt"), {**dict(list(values.items())[:3]), "tilt.angle": math.pi / 2}, base_bodies=("motor",))
    assert rigid_force_n(lifted, np.zeros(2), 1e-3) == pytest.approx(5.0 * 9.80665)


def test_a_line_that_became_too_wide_goes_on_below() -> None:
    told = "mass 13.4 kg   belt 204 kN/m   friction 10.1 N + 16.4 N s/m   and more of it"
    lines = lines_in(terms("rotary"), [Line("   ", ("axis     ", "title"), told[:66])])
    assert max(map(len, lines)) <= 80
    assert len(lines) == 2
    assert lines[1].startswith(" " * 12 + "friction")


def test_targets_asked_for_are_those_of_any_kind() -> None:
    axis = axis_from_dict(ROTARY)
    asked = with_targets(axis, {"following_error_m": 2e-4, "at": "load"})
    assert (asked.targets.following_m, asked.targets.at, asked.trajectories) == (2e-4, "carriage", axis.trajectories)
    assert with_targets(load_axis("ball-screw"), {"at": "table"}).targets.at == "carriage"
    for name in (*OTHERS, "egc-70-600"):
        with pytest.raises(UsageError, match="it must be above 0"):
            with_targets(load_axis(name), {"following_error_m": -1e-3})


def test_a_watch_is_told_in_the_words_of_the_axis() -> None:
    axis = axis_from_dict(ROTARY)
    far = Limit(None, None, "")
    drift = AxisDrift({key: MoveEstimate(1.0, 0.01) for key in COLUMNS}, dict.fromkeys(COLUMNS, far))
    standings = [one for _ in range(5) for one in drift.add_told({key: MoveEstimate(1.0, 0.01) for key in COLUMNS})][-len(COLUMNS) :]
    told = lines_in(terms_of(axis), [head_line(standings), *summary_lines(5, 0, "", 5.0, standings, [], [])])
    assert not BELT_WORDS.search("\n".join(told))
    assert not re.search(r"\bmm\b|carriage|\bkg$|kN", "\n".join(told))


def test_a_table_without_a_first_title_keeps_its_edge() -> None:
    told = lines_in(terms_of(axis_from_dict(ROTARY)), table(["", ">carriage"], [["following error", "1.5 mm"]]))
    assert [str(line) for line in told][-1].startswith(str(table(["", ">x"], [["following error", "1"]])[-1])[:10])


def test_an_axis_is_that_of_the_first_of_several_runs(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "run", axis_from_dict(ROTARY))
    told = own_words(lambda runs: Result({}, [f"the carriage stands in {len(runs)}"]))([folder.path, tmp_path / "none"])
    assert told.text == ["the load stands in 2"]


def test_a_unit_in_a_title_or_beside_a_quantity_goes_with_its_numbers() -> None:
    """A column of N m at a linear motor is one of N, and a load that turns has an inertia: no page shows `kg at r 57.3 mm`."""
    axis = load_axis("linear-motor")
    head, row = lines_in(terms_of(axis), table(["record", ">error N m", ">%"], [["frf_1", "0.01", "2"]]))
    assert str(head).split() == ["record", "error", "N", "%"]
    assert (terms("rotary").shown("kg m2").symbol, terms("rotary").said("kg m2")) == ("kg m²", "kg m2")
    assert (terms_of(axis).shown("kg m2").symbol, terms_of(axis).shown("N m").symbol) == ("kg", "N")
    assert float(row.cells[1]) == pytest.approx(0.01 / axis.transmission_m_rad, rel=5e-3)
    model = build_model("m", ("belt_stiffness",), {"cart.mass": 0.1, "belt_stiffness.stiffness": 4e4}, base_bodies=("motor", "cart"))
    model = replace(model, parameters={name: replace(one, interval=0.01 * one.value) for name, one in model.parameters.items()})
    found = quantities_of(model, {}, terms("rotary"))
    for name, unit in (("cart.mass", "kg m²"), ("belt_stiffness.stiffness", "N m/rad")):
        own = found[name]
        assert own.unit == terms("rotary").said(own.unit) == unit
        assert own.scale == pytest.approx(ARC_M**2, rel=1e-9)


@pytest.mark.parametrize(
    ("kind", "label", "said", "last"),
    [
        ("rotary", "speed in m/s", "speed in °/s", 1500.0),
        ("rotary", "belt force in N", "load torque in N m", 1.5 * ARC_M),
        ("linear", "torque in N m", "force in N", 1.5 / 0.02),
    ],
)
def test_numbers_along_a_picture_go_with_its_unit(kind: str, label: str, said: str, last: float) -> None:
    """No picture of a report says `1000°/s` or `N m per turn of 2π`."""
    drawn = Figure()
    axes = drawn.subplots()
    axes.plot([0.0, 1.0], [0.0, 1.5])
    axes.set(xlabel="time in s", ylabel=label, ylim=(-0.1, 1.6))
    axes.set_yticks([0.0, 0.5, 1.0, 1.5])
    with pictures_in(terms(kind, 0.02)):
        texts = re.findall(r">([^<>]+)<", text_in(terms(kind, 0.02), _svg_of(drawn)))
    assert said in texts
    assert "time in s" in texts
    assert {"0", f"{last:.4g}"} <= set(texts)
    assert not any("per turn of" in text or "1000°" in text or " at r " in text for text in texts)


def test_a_rigid_axis_is_told_of_no_resonance() -> None:
    """Its suppression is that of the upper half of what the loop samples; an elastic axis keeps its resonance."""
    for told in ("open loop at the resonance", "resonance at -10.0 dB", "resonance suppression", "resonance dB"):
        assert "resonance" not in terms_of(load_axis("torque-table")).said(told)
        assert "resonance" in terms_of(load_axis("coupled-load")).said(told)


@pytest.mark.parametrize(
    ("motor", "told"),
    [
        ({"rated_force_n": 500.0, "peak_force_n": 100.0}, "motor.rated_force_n is 500 N; it must not exceed motor.peak_force_n, 100 N"),
        ({"rated_force_n": 50.0, "peak_force_n": 100.0, "mass_kg": 500.0}, "motor.mass_kg is 500 kg: a motor of 50 N rated force would"),
    ],
)
def test_a_linear_motor_is_refused_in_newtons_and_kilograms(motor: dict[str, float], told: str) -> None:
    """It was in N m and kg m² of a radian that nobody had typed in."""
    with pytest.raises(UsageError) as refused:
        axis_from_dict({"transmission": {"kind": "linear", "pole_pair_m": 0.03}, "motor": motor})
    assert told in str(refused.value)
    assert not re.search(r"N m|kg [mc]m?²|rad", str(refused.value))
