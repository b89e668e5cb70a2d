"""Structures of MATLAB, Simulink and dSPACE, in version 5 and in version 7.3: the same columns, times and units."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from beltcomm.errors import DataError
from beltcomm.foreign.files import read_table
from beltcomm.foreign.table import Table
from foreign.matfiles import write_v5, write_v73
from foreign.samples import swing

T, CURRENT, ENCODER = swing(300)
SLOW = T[::2]
Write = Callable[[Path, dict[str, Any]], Path]


@pytest.fixture(params=[write_v5, write_v73], ids=["v5", "v7.3"])
def table_of(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[dict[str, Any]], Table]:
    return lambda value: read_table(request.param(tmp_path / "a.mat", value))


def check(table: Table, columns: dict[str, Any], units: dict[str, str] | None = None) -> None:
    """columns : name -> (values, clock's name or None)."""
    assert units is None or dict(table.units) == units
    for name, (values, clock) in columns.items():
        np.testing.assert_allclose(table.columns[name], values, atol=1e-12, err_msg=name)
        assert table.clocks.get(name) == clock, name


def test_vectors_in_rows_and_columns_and_matrices(table_of: Callable[[dict[str, Any]], Table]) -> None:
    table = table_of({"t": T, "I": CURRENT[None, :], "M": np.column_stack((T, ENCODER)), "gain": 3.0, "who": "me"})
    check(table, {"t": (T, None), "I": (CURRENT, None), "M1": (T, None), "M2": (ENCODER, None)})
    assert table.notes == ("not read, because they are no vectors of numbers: gain, who",)


def test_a_structure_with_time_and_units(table_of: Callable[[dict[str, Any]], Table]) -> None:
    log = {"time": T, "torque": CURRENT, "pos": ENCODER[None, :], "pos_unit": "inc", "units": {"torque": "Nm"}}
    table = table_of({"log": log})
    check(table, {"log.torque": (CURRENT, "log.time"), "log.pos": (ENCODER, "log.time")}, {"log.torque": "Nm", "log.pos": "inc"})
    assert set(table.columns) == {"log.time", "log.torque", "log.pos"}


def test_time_series_each_with_its_time(table_of: Callable[[dict[str, Any]], Table]) -> None:
    series = {
        "trq": {"Time": T, "Data": CURRENT, "DataInfo": {"Units": "Nm"}},
        "pos": {"Time": T, "Data": ENCODER, "Unit": "deg"},
        "temp": {"Time": SLOW, "Data": np.column_stack((SLOW, 2.0 * SLOW))},
    }
    table = table_of({"out": series})
    shared = table.clocks["out.trq"]  # equal times are kept once
    np.testing.assert_array_equal(table.columns[shared], T)
    check(table, {"out.trq": (CURRENT, shared), "out.pos": (ENCODER, shared)}, {"out.trq": "Nm", "out.pos": "deg"})
    check(table, {"out.temp1": (SLOW, "out.temp.Time"), "out.temp2": (2.0 * SLOW, "out.temp.Time")})


def test_simulinks_structure_with_time(table_of: Callable[[dict[str, Any]], Table]) -> None:
    signals = [{"values": CURRENT, "label": "M_ist"}, {"values": np.vstack((ENCODER, T)), "label": "phi"}]
    table = table_of({"scope": {"time": T, "signals": signals}})
    check(table, {"M_ist": (CURRENT, "scope.time"), "phi1": (ENCODER, "scope.time"), "phi2": (T, "scope.time")})
    assert set(table.columns) == {"scope.time", "M_ist", "phi1", "phi2"}


def test_dspace_recordings(table_of: Callable[[dict[str, Any]], Table]) -> None:
    axes = [{"Name": "HostService", "Data": T[None, :], "Unit": "s"}, {"Name": "Slow", "Data": SLOW[None, :], "Unit": "s"}]
    signals = [
        {"Name": "ActTorque", "Data": CURRENT[None, :], "Unit": "Nm", "XIndex": 1.0},
        {"Name": "ActPos", "Data": SLOW[None, :], "Unit": "mm", "XIndex": 2.0},
    ]
    table = table_of({"exp1": {"X": axes, "Y": signals}})
    check(table, {"ActTorque": (CURRENT, "exp1.HostService"), "ActPos": (SLOW, "exp1.Slow2")})
    assert (table.unit("ActTorque"), table.unit("ActPos")) == ("Nm", "mm")


def test_cells(table_of: Callable[[dict[str, Any]], Table]) -> None:
    table = table_of({"c": [T, CURRENT, "text"]})
    check(table, {"c1": (T, None), "c2": (CURRENT, None)})
    assert set(table.columns) == {"c1", "c2"}


def test_other_hdf5_files_with_units_as_attributes(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        group = file.create_group("run")
        group["time"], group["torque"] = T, CURRENT
        group["torque"].attrs["unit"] = "Nm"
    table = read_table(tmp_path / "a.h5")
    check(table, {"run.torque": (CURRENT, "run.time")}, {"run.torque": "Nm"})
    assert set(table.columns) == {"run.time", "run.torque"}


def test_a_structure_that_holds_itself_ends(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"] = T
        file.create_group("g")["self"] = file["/"]
    assert "t" in read_table(tmp_path / "a.h5").columns


def test_objects_cannot_be_read_and_are_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"holds no vectors of numbers.*not read: gain"):
        read_table(write_v73(tmp_path / "a.mat", {"gain": 3.0}))
