"""Settings files: numbers of YAML 1.2, exact floats, whole files or none, both places of shipped files; units."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from beltcomm import configfiles
from beltcomm.configfiles import did_you_mean, find_config, line_of, read_yaml, to_yaml, write_text
from beltcomm.errors import DataError, UsageError
from beltcomm.quantities import UNITS, in_other_unit, parse_quantity, unit_of


def test_numbers_are_those_of_yaml_1_2_and_texts_stay_texts(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("a: 1e-6\nb: 010\nc: 0x1A\nd: 1.\ne: .inf\nf: 2020-01-01\ng: 1:30\nh: '1e3'\ni: ~\nj: -3\nk: true\n")
    expected = {"a": 1e-6, "b": 10, "c": 26, "d": 1.0, "e": math.inf, "f": "2020-01-01", "g": "1:30", "h": "1e3", "i": None}
    assert read_yaml(path) == expected | {"j": -3, "k": True}


def test_floats_and_texts_come_back_exactly(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    values = [0.1 + 0.2, 5e-324, 1.7976931348623157e308, -0.0, 1e-17, 1e22, *np.exp(rng.normal(0, 50, 200)).tolist()]
    data = {"numbers": values, "texts": ["1e-6", "010", "yes", "2020-01-01", "1:30", "", "Θ²", "a: b"], "none": None}
    path = tmp_path / "a.yaml"
    write_text(path, to_yaml(data | {"array": np.array(values), "scalar": np.float64(0.1)}))
    assert read_yaml(path) == data | {"array": values, "scalar": 0.1}


def test_what_yaml_cannot_hold_is_an_error() -> None:
    with pytest.raises(TypeError, match="complex"):
        to_yaml({"h": 1j})


def test_a_failed_write_leaves_the_old_file_and_no_rest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("old")

    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(configfiles.os, "fsync", full)
    with pytest.raises(UsageError, match="cannot be written: No space left on device"):
        write_text(path, "new")
    assert [(item.name, item.read_text()) for item in tmp_path.iterdir()] == [("a.yaml", "old")]


def test_broken_files_raise_what_is_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    with pytest.raises(DataError, match="cannot be read: No such file"):
        read_yaml(path, DataError)
    path.write_bytes(b"name: \xff\xfe")
    with pytest.raises(UsageError, match="is not UTF-8 text"):
        read_yaml(path)
    path.write_text("[" * 3000)
    with pytest.raises(UsageError, match="is not valid YAML"):
        read_yaml(path)
    path.write_text("")
    assert read_yaml(path) == {}


def test_line_of_a_nested_key(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("# note\na:\n  b: 1\n  c: {d: 2,\n      e: 3}\n")
    assert [line_of(path, keys) for keys in (("a",), ("a", "c"), ("a", "c", "e"), ("z",))] == [2, 4, 5, 0]


def test_the_package_comes_before_the_checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wheel, checkout = tmp_path / "wheel", tmp_path / "checkout"
    for folder, names in ((wheel, ["a"]), (checkout, ["a", "b"])):
        (folder / "axes").mkdir(parents=True)
        for name in names:
            (folder / "axes" / f"{name}.yaml").touch()
    monkeypatch.setattr(configfiles, "CONFIG_FOLDERS", (wheel, checkout))
    assert find_config("axes", "a") == wheel / "axes" / "a.yaml"
    assert find_config("axes", "b") == checkout / "axes" / "b.yaml"
    with pytest.raises(UsageError, match="known are a, b"):
        find_config("axes", "zz")


def test_shipped_files_are_found_from_another_folder(tmp_path: Path) -> None:
    program = "from beltcomm.configfiles import find_config; print(find_config('axes', 'egc-70-600').is_file())"
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"


def test_a_shipped_name_given_as_a_file_is_recognised() -> None:
    with pytest.raises(UsageError, match="the shipped axis of that name is called egc-70-600"):
        find_config("axes", "egc-70-600.yaml")


def test_suggestions() -> None:
    assert did_you_mean("inertia", ["inertia_kg_m2", "name"]) == ", did you mean inertia_kg_m2?"
    assert did_you_mean("zzz", ["inertia_kg_m2"]) == ""
    assert did_you_mean("emms", ["festo-emms-as-70-s", "yaskawa-sgmah-01a"]) == ", did you mean festo-emms-as-70-s?"
    assert did_you_mean("sgmah", ["yaskawa-sgmah-01a", "yaskawa-sgmah-02a"]) == "", "of two that hold it neither"


@pytest.mark.parametrize(
    ("text", "name", "value"),
    [
        ("0.3", "position_m", 0.3),
        ("-5 mm", "position_m", -0.005),
        ("570mm", "travel_m", 0.57),
        ("0.449 kg cm²", "inertia_kg_m2", 44.9e-6),
        ("44.9 kg·mm2", "inertia_kg_m2", 44.9e-6),
        ("3000 1/min", "speed_rad_s", 314.159265358979),
        ("90°", "angle_rad", math.pi / 2),
        ("430 mN m", "torque_nm", 0.43),
        ("0.65 nm/a", "torque_constant_nm_a", 0.65),
        ("0.65 Nm/Arms", "torque_constant_nm_a", 0.65),
        ("5 KN", "force_n", 5000.0),
        ("0.449 KG CM^2", "inertia_kg_m2", 44.9e-6),
        ("3000 min⁻¹", "speed_rad_s", 314.159265358979),
        ("1e-3", "ratio", 1e-3),
        ("0,3", "position_m", 0.3),
    ],
)
def test_quantities_with_their_unit(text: str, name: str, value: float) -> None:
    assert parse_quantity(text, name) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "name", "words"),
    [
        ("3,000", "position_m", "decimal point"),
        ("three", "position_m", "give a number in m"),
        ("3 kg", "position_m", "'kg' is not a unit of it; understood are m, cm, mm, µm"),
        ("3 m", "ratio", "'m' is not a unit"),
        ("3 MN", "force_n", "'MN' is not a unit of it; is it mN"),
        ("3 MNm", "torque_nm", "'MNm' is not a unit of it; is it mN m"),
        ("3 Mm", "position_m", "'Mm' is not a unit of it; is it mm"),
        ("3 S", "time_s", "'S' is not a unit of it; is it s"),
        ("3 Ms", "time_s", "'Ms' is not a unit of it; is it ms"),
        ("3 nm", "torque_nm_a", "understood are N m/A, N cm/A, mN m/A"),
        ("", "position_m", "give a number"),
    ],
)
def test_what_is_no_quantity_is_refused(text: str, name: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        parse_quantity(text, name)


@pytest.mark.parametrize(("suffix", "unit"), [(suffix, unit) for suffix in UNITS for unit in UNITS[suffix].spellings])
def test_every_unit_is_read_as_it_is_shown(suffix: str, unit: str) -> None:
    wanted = UNITS[suffix].spellings[unit]
    assert parse_quantity(f"1 {unit}", f"x_{suffix}") == pytest.approx(wanted, rel=1e-14)
    assert parse_quantity(f"1 {unit.replace(' ', '').lower()}", f"x_{suffix}") == pytest.approx(wanted, rel=1e-14)


def test_units_by_suffix() -> None:
    assert unit_of("motor.inertia_kg_m2") == "kg m²"
    assert unit_of("stiffness_nm_rad") == "N m/rad"
    assert unit_of("reference_velocity_rad_s") == "rad/s"
    assert unit_of("ratio") == ""
    assert in_other_unit("position_deg", "position_rad") == pytest.approx(math.pi / 180)
    assert in_other_unit("t_ms", "t_s") == 1e-3
    assert in_other_unit("torque_mNm", "torque_nm") == 1e-3
    assert in_other_unit("velocity_mm_s", "velocity_m_s") == 1e-3
    assert in_other_unit("position_rad", "position_rad") is None
    assert in_other_unit("current_a", "torque_nm") is None
