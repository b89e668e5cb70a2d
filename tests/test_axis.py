"""The axis: derived numbers against the thesis's tables, refusals with value, limit and line."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from beltcomm.axis import SECTIONS, Axis, AxisLimits, Belt, Coupling, Gearbox, Motor, Pulley, Travel, axis_from_dict, load_axis, save_axis
from beltcomm.axis.entries import TrajectoryLimits, entries_of
from beltcomm.configfiles import config_names
from beltcomm.errors import UsageError

RIG = load_axis("egc-70-600")


def test_every_shipped_axis_loads() -> None:
    names = config_names("axes")
    assert "egc-70-600" in names
    for name in names:
        assert load_axis(name).name


def test_motor_side_inertia_is_that_of_the_thesis() -> None:
    # thesis.md, 1: Theta_e = 71.73 kg mm² = 44.90 + 23.63 + 3.20
    assert pytest.approx(71.73e-6, rel=1e-12) == RIG.motor_side_inertia_kg_m2


def test_inertia_behind_the_gearbox_counts_by_the_square_of_its_ratio() -> None:
    # (2.8): Θ_m + (Θ_r + Θ_g)/i_g², the coupling on the motor shaft
    geared = replace(RIG, gearbox=Gearbox(ratio=3.0, inertia_kg_m2=9e-6))
    assert geared.motor_side_inertia_kg_m2 == pytest.approx(44.9e-6 + 3.2e-6 + (23.63e-6 + 9e-6) / 9.0, rel=1e-12)
    assert geared.transmission_m_rad == pytest.approx(0.01242 / 3.0, rel=1e-12)  # (2.16)


def test_belt_stiffness_is_that_of_the_sheet() -> None:
    # thesis.md, 1: 296 kN/m at l1 = 0.55 m and never less than 269; the coupling, 1.09 MN/m at the belt, in series gives 233
    sheet = replace(RIG, belt=replace(RIG.belt, specific_stiffness_n=106250.0))
    bare = replace(sheet, coupling=Coupling())
    assert bare.belt_stiffness_n_m(0.50) == pytest.approx(296e3, abs=0.5e3)
    assert bare.belt_stiffness_n_m(0.79 - 0.05 - 1e-9) == pytest.approx(269e3, abs=0.5e3)
    assert sheet.belt_stiffness_n_m(0.50) == pytest.approx(233e3, abs=0.5e3)
    soft = replace(bare, coupling=Coupling(stiffness_nm_rad=168.75))
    alone = 1.0 / (1.0 / soft.belt_stiffness_n_m(0.3) - 1.0 / bare.belt_stiffness_n_m(0.3))
    assert alone == pytest.approx(1.09e6, abs=0.005e6)


def test_position_outside_the_belt_is_refused() -> None:
    with pytest.raises(UsageError, match=r"outside 0\.\.0\.79 m"):
        RIG.belt_stiffness_n_m(0.75)


def test_the_belt_carries_the_smaller_of_feed_force_and_pulley_torque() -> None:
    """At the pulley, so a gearbox does not change it: 1.24 N m over 12.42 mm are 99.84 N."""
    geared = replace(RIG, gearbox=Gearbox(ratio=3.0))
    assert geared.belt_force_limit_n == RIG.belt_force_limit_n == pytest.approx(1.24 / 0.01242)
    limits = replace(RIG.limits, feed_force_n=80.0)
    assert replace(RIG, limits=limits).belt_force_limit_n == 80.0
    assert replace(RIG, limits=replace(limits, pulley_torque_nm=None)).belt_force_limit_n == 80.0
    assert Axis(name="bare").belt_force_limit_n == math.inf


def test_torque_limit_names_what_binds() -> None:
    assert RIG.torque_limit() == (1.24, "the axis limit of 1.24 N m at the driving pulley")
    weak = replace(RIG, motor=replace(RIG.motor, rated_torque_nm=0.5, peak_torque_nm=1.0))
    assert weak.torque_limit() == (1.0, "the motor's peak torque of 1 N m")
    geared = replace(RIG, gearbox=Gearbox(ratio=2.0))
    assert geared.torque_limit_nm == pytest.approx(0.62)
    belt = replace(RIG, limits=replace(RIG.limits, feed_force_n=50.0))
    assert belt.torque_limit_nm == pytest.approx(50.0 * 0.01242)
    assert "50 N feed force" in belt.torque_limit().binds
    with pytest.raises(UsageError, match=r"a torque limit needs motor\.peak_torque_nm"):
        Axis(name="bare").torque_limit()


def test_missing_entries_are_named_with_their_job() -> None:
    axis = Axis(name="x", motor=Motor(inertia_kg_m2=1e-4), pulley=Pulley())
    with pytest.raises(UsageError, match=r"identify needs pulley\.effective_radius_m \(effective radius .* not in axis 'x'"):
        axis.require("identify", "motor.inertia_kg_m2", "pulley.effective_radius_m")
    with pytest.raises(UsageError, match=r"the transmission needs pulley\.effective_radius_m"):
        _ = axis.transmission_m_rad
    axis.require("identify", "motor.inertia_kg_m2")


def test_an_axis_without_belt_and_pulley_is_a_rigid_mass_on_the_load_side() -> None:
    axis = Axis(travel=Travel(min_m=0.0, max_m=0.3))
    assert not axis.has_transmission
    assert axis.transmission_m_rad == 1.0
    assert axis.motor_side_inertia_kg_m2 == 0.0
    assert axis.belt_stiffness_n_m(0.1) == math.inf
    assert Axis(belt=Belt()).has_transmission


def test_save_and_load_are_exact(tmp_path: Path) -> None:
    axis = replace(RIG, motor=replace(RIG.motor, inertia_kg_m2=(0.1 + 0.2) * 1e-4), name="1e-6")  # a name that looks like a number
    save_axis(axis, tmp_path / "axis.yaml")
    again = load_axis(tmp_path / "axis.yaml")
    assert again == axis
    assert again.fingerprint() == axis.fingerprint()
    save_axis(Axis(pulley=Pulley()), tmp_path / "bare.yaml")
    assert load_axis(tmp_path / "bare.yaml").has_transmission


def test_fingerprint_sees_every_change_and_nothing_else() -> None:
    assert replace(RIG, source="elsewhere").fingerprint() == RIG.fingerprint()
    heavier = replace(RIG, coupling=Coupling(inertia_kg_m2=3.3e-6, stiffness_nm_rad=168.75))
    assert heavier.fingerprint() != RIG.fingerprint()
    assert RIG.changes(heavier) == ["coupling.inertia_kg_m2 3.2e-06 -> 3.3e-06"]
    assert replace(RIG, trajectories={}).fingerprint() != RIG.fingerprint()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name: x\nmotr: {}", r"line 2: unknown key 'motr', did you mean motor\?"),
        ("motor:\n  inertia_kgm2: 1", r"line 2: unknown key 'inertia_kgm2' in motor, did you mean inertia_kg_m2\?"),
        ("trajectories:\n  T_A: {jerk: 1}", r"line 2: unknown key 'jerk' in trajectories\.T_A, did you mean jerk_m_s3\?"),
        ("motor:\n  inertia_kg_m2: -1e-5", r"line 2: motor\.inertia_kg_m2 is -1e-05 kg m²; it must be above 0"),
        ("motor: {inertia_kg_m2: 44.9}", "it must be at most 1, so look at the unit"),
        ("motor: {inertia_kg_m2: 44.9 kgmm2}", "is '44.9 kgmm2'; give a number in kg m²"),
        ("motor: {inertia_kg_m2: true}", "is True; give a number"),
        ("motor: {inertia_kg_m2: .nan}", "must be a finite number"),
        ("motor: {rated_torque_nm: 4, peak_torque_nm: 3}", "4 N m; it must not exceed motor.peak_torque_nm, 3 N m"),
        ("motor: 3", "motor is 3; it must hold names and values"),
        ("gearbox: {ratio: 0}", r"gearbox\.ratio is 0; it must be above 0"),
        ("pulley: {teeth: 2.5}", "it must be a whole number"),
        ("pulley: {effective_radius_m: 0.02484, teeth: 26}\nbelt: {pitch_m: 0.003}", "make a radius of 0.012414 m"),
        ("travel:\n  min_m: 0.5\n  max_m: 0.5", r"line 2: travel\.min_m is 0\.5 m; it must be below travel\.max_m, 0\.5 m"),
        ("belt: {pulley_distance_m: 0.6}\ntravel: {max_m: 0.57, driven_side_offset_m: 0.05}", r"must exceed .* 0\.62 m"),
        ("mounting: {tilt_deg: 100}", "at most 90"),
        ("trajectories: {T_A: {jerk_m_s3: 3}}", r"lacks acceleration_m_s2, speed_m_s"),
        ("trajectories: 3", "must hold names and their limits"),
        ("motor: {}\nmotor: {}", "stands twice, again in line 2"),
        ("- 1", "holds a list"),
        ("a: [", "is not valid YAML"),
    ],
)
def test_wrong_axis_files_are_explained(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "axis.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match=words) as caught:
        load_axis(path)
    assert str(path) in str(caught.value)


def test_wrong_values_in_python_are_refused_too() -> None:
    with pytest.raises(UsageError, match=r"motor\.peak_torque_nm is -3"):
        Axis(motor=Motor(peak_torque_nm=-3.0))


def test_unknown_axes_and_trajectories_are_named_with_the_nearest() -> None:
    with pytest.raises(UsageError, match=r"no axis is called 'egc-70', did you mean egc-70-600\?"):
        load_axis("egc-70")
    with pytest.raises(UsageError, match=r"the axis file nowhere/axis\.yaml does not exist"):
        load_axis("nowhere/axis.yaml")
    with pytest.raises(UsageError, match=r"no trajectory 'T_C'.*known are T_A, T_B"):
        RIG.trajectory("T_C")


def test_an_axis_without_belt_is_limited_by_its_force() -> None:
    linear = Axis(name="linear motor", limits=AxisLimits(feed_force_n=300.0))
    assert not linear.has_transmission
    assert linear.torque_limit() == (300.0, "the axis limit of 300 N feed force")


@pytest.mark.parametrize("inertia", [0.449, 44.9e-9])
def test_a_rotor_that_no_motor_of_that_torque_has_is_a_wrong_unit(inertia: float) -> None:
    with pytest.raises(UsageError, match=r"motor\.inertia_kg_m2 is .* a motor of 1\.43 N m .* look at its unit"):
        replace(RIG, motor=replace(RIG.motor, inertia_kg_m2=inertia))
    assert replace(RIG, motor=replace(RIG.motor, inertia_kg_m2=2e-3)).motor.inertia_kg_m2 == 2e-3  # with a flywheel


def quantities() -> list[tuple[str, str]]:
    """All numbers of axis.yaml: section and key; of a reference motion, too."""
    sections = {**SECTIONS, "trajectories": TrajectoryLimits}
    return [(section, key) for section, kind in sections.items() for key in entries_of(kind)]


ODD = ["1e308", "-1e308", ".inf", ".nan", "9" * 400, "-" + "9" * 400, "9" * 5000, "true", "[1]", "{a: 1}", "!!binary aGk=", "text"]


def of(section: str, key: str, value: str) -> str:
    """An axis file with this entry, and what must stand beside it."""
    if section != "trajectories":
        return f"{section}: {{{key}: {value}}}\n"
    limits = {"jerk_m_s3": "40", "acceleration_m_s2": "4", "speed_m_s": "1", key: value}
    return "trajectories: {T: {" + ", ".join(f"{name}: {one}" for name, one in limits.items()) + "}}\n"


@pytest.mark.parametrize(("section", "key"), quantities())
def test_every_quantity_has_bounds_of_its_kind(tmp_path: Path, section: str, key: str) -> None:
    path = tmp_path / "axis.yaml"
    for value in ODD:
        path.write_text(of(section, key, value), encoding="utf-8")
        with pytest.raises(UsageError) as refused:
            load_axis(path)
        assert str(path) in str(refused.value), value
        assert len(str(refused.value)) < 1000, value
    entry = entries_of({**SECTIONS, "trajectories": TrajectoryLimits}[section])[key]
    path.write_text(of(section, key, "1e-308"), encoding="utf-8")
    if entry.fault(0.0):  # what is divided by has a smallest value
        with pytest.raises(UsageError):
            load_axis(path)
    else:
        assert load_axis(path)


@pytest.mark.parametrize(
    ("key", "meant"),
    [
        ("kind", "transmission.kind=screw"),
        ("rack", "transmission.kind=rack"),
        ("rated_torque_nm", "motor.rated_torque_nm"),
        ("moter", "motor"),
    ],
)
def test_a_key_without_its_section_is_told_where_it_stands(key: str, meant: str) -> None:
    with pytest.raises(UsageError, match=rf"unknown key '{key}', did you mean {re.escape(meant)}\?"):
        axis_from_dict({key: "screw"})
