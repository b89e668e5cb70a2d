"""A run folder made by hand from CSV files: fitted like an own one, or refused with what is wrong."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from beltcomm import api
from beltcomm.configfiles import read_yaml, to_yaml, write_text
from beltcomm.errors import BeltcommError, DataError, UsageError
from beltcomm.recording.signalfile import read_columns, write_columns

Copy = Callable[..., Path]
CONSTANT_NM_A = 0.65


def by_hand(source: Path, run: Path, names: Sequence[str], scales: Mapping[str, tuple[str, float]], notes: bool = True) -> Path:
    """Only time and the columns given (new name, factor); axis.yaml; sidecars without what the tool itself added."""
    (run / "recordings").mkdir(parents=True)
    write_text(run / "axis.yaml", (source / "axis.yaml").read_text(encoding="utf-8"))
    for name in names:
        columns = read_columns(source / "recordings" / f"{name}.csv", ())
        chosen = {new: factor * columns[old] for old, (new, factor) in scales.items()}
        write_columns(run / "recordings" / f"{name}.csv", {"t_s": columns["t_s"], **chosen})
        if notes:
            write_text(run / "recordings" / f"{name}.yaml", (source / "recordings" / f"{name}.yaml").read_text(encoding="utf-8"))
    return run


def axis_without(run: Path, section: str, *keys: str) -> None:
    data = read_yaml(run / "axis.yaml")
    if keys:
        for key in keys:
            del data[section][key]
    else:
        del data[section]
    write_text(run / "axis.yaml", to_yaml(data))


CURRENT = {"torque_nm": ("current_a", 1.0 / CONSTANT_NM_A), "position_rad": ("position_rad", 1.0)}
MOTOR = {"torque_nm": ("torque_nm", 1.0), "position_rad": ("position_rad", 1.0)}


def test_current_and_angle_are_enough(copy_of_complete: Copy, tmp_path: Path) -> None:
    run = by_hand(copy_of_complete(), tmp_path / "hand", ("frf_1", "move_1"), CURRENT)
    data = api.fit(run).to_json()
    values = read_yaml(run / "models" / "final.yaml")["parameters"]
    assert values["cart.mass"]["value"] == pytest.approx(13.42, rel=0.02)
    assert values["motor.inertia"]["value"] == pytest.approx(7.17e-5, rel=0.02)
    assert data is not None


@pytest.mark.parametrize(
    ("scales", "notes", "error", "sentence"),
    [
        (MOTOR | {"torque_nm": ("torque_nm", -1.0)}, True, DataError, r"move_1\.csv: positive torque_nm drives to negative position_rad"),
        (MOTOR, False, DataError, r"no recording with an excitation \(experiment: frf\); .*say so in its sidecar"),
        ({"torque_nm": ("force_n", 50.0), "position_rad": ("position_m", 0.01242)}, True, DataError, "hold force and carriage position"),
        (MOTOR | {"position_rad": ("position_rad", 57.2958)}, True, DataError, "more than the 0.58 m of axis"),
        (MOTOR | {"torque_nm": ("torque_nm", 1e3)}, True, DataError, "look at the column's unit .*motor.peak_torque_nm"),
        (
            {"torque_nm": ("torque", 1.0), "position_rad": ("position_rad", 1.0)},
            True,
            DataError,
            r"has no column torque_nm.*did you mean torque",
        ),
    ],
)
def test_what_is_wrong_by_hand_is_said(
    copy_of_complete: Copy,
    tmp_path: Path,
    scales: Mapping[str, tuple[str, float]],
    notes: bool,
    error: type[BeltcommError],
    sentence: str,
) -> None:
    run = by_hand(copy_of_complete(), tmp_path / "hand", ("move_1",), scales, notes)
    with pytest.raises(error, match=sentence):
        api.fit(run)


def test_an_axis_without_belt_or_torque_constant_is_not_fitted_as_one_with(copy_of_complete: Copy, tmp_path: Path) -> None:
    run = by_hand(copy_of_complete(), tmp_path / "a", ("frf_1",), CURRENT)
    axis_without(run, "motor", "torque_constant_nm_a")
    with pytest.raises(UsageError, match=r"fit of records in ampere needs motor\.torque_constant_nm_a"):
        api.fit(run)
    for section in ("pulley", "belt"):
        axis_without(run, section)
    with pytest.raises(UsageError, match="has neither belt nor pulley"):
        api.fit(run)


def test_records_of_two_axes_in_one_folder(copy_of_complete: Copy, tmp_path: Path) -> None:
    run = by_hand(copy_of_complete(), tmp_path / "hand", ("frf_1",), MOTOR)
    t = 1e-3 * np.arange(100)
    write_columns(run / "recordings" / "linear.csv", {"t_s": t, "force_n": np.sin(t), "position_m": 0.1 * np.sin(9 * t)})
    with pytest.raises(DataError, match=r"not of one axis \(frf_1 in N m and rad, linear in N and m\)"):
        api.fit(run)
