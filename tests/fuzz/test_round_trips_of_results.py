"""What a run keeps of its results, and what goes to other programs, is read back the same: on drawn values."""

from __future__ import annotations

import importlib.util
import json
import math
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from beltcomm.axis import load_axis
from beltcomm.configfiles import read_yaml, to_yaml, write_text
from beltcomm.control import Cascade, CascadeStructure, Feedforward, Prefilter
from beltcomm.drive.objects import COMMANDS, TYPES, ObjectValue, bounds_of, object_from_dict, packed
from beltcomm.drive.parameters import PREFILTER_KINDS, cascade_to_parameters
from beltcomm.experiments.first_motion import ConfirmedBounds
from beltcomm.export.dcf import dcf_text
from beltcomm.fit.torque.lag import VALUES, Lag
from beltcomm.fit.torque.laws import DriveLaw, ReadingLaw
from beltcomm.fit.torque.path import TorquePath, path_from_dict, path_to_dict
from beltcomm.foreign.apart_reader import _table_in
from beltcomm.foreign.eds import load_object_file
from beltcomm.foreign.guess import _guesses_for, _template, completed, mappings_in
from beltcomm.foreign.jsonfile import read_json
from beltcomm.foreign.mapping import parse_source, sources_for
from beltcomm.foreign.table import Table
from beltcomm.jobs.export import _write_mcap
from beltcomm.recording import Recording
from beltcomm.recording.columns import CHANNELS, Side
from beltcomm.recording.sidecar import Sidecar
from beltcomm.result import plain
from beltcomm.rundata.calibration import Calibration, GainUnit, _calibration_from_dict
from beltcomm.rundata.store import MOST, cascade_from_dict, structure_from_dict
from fuzz.test_round_trips import any_text, finite, names, words

AXIS = load_axis("egc-70-600")
positive = st.floats(1e-12, 1e12)
#: What stands between two texts: a file of settings, or of JSON.
homes = st.sampled_from(["yaml", "json"])


def through_a_file(data: Any, home: str) -> Any:
    if home == "json":
        return json.loads(json.dumps(data))
    with TemporaryDirectory() as folder:
        write_text(Path(folder) / "a.yaml", to_yaml({"data": data}))
        return read_yaml(Path(folder) / "a.yaml")["data"]


@st.composite
def lags(draw: st.DrawFn) -> tuple[Lag, ...]:
    kinds = draw(st.lists(st.sampled_from(list(VALUES)), max_size=2))
    return tuple(Lag(kind, tuple(draw(positive) for _ in VALUES[kind]), tuple(draw(st.lists(positive, max_size=2)))) for kind in kinds)


@st.composite
def paths(draw: st.DrawFn, deep: int = 2) -> TorquePath:
    drive = DriveLaw(draw(st.floats(0, 20)), draw(lags()), draw(positive), draw(st.floats(0, 1))) if draw(st.booleans()) else None
    reading = ReadingLaw(draw(st.floats(0, 20)), draw(lags()), draw(st.booleans()))
    rivals = tuple(draw(st.lists(paths(deep - 1), max_size=2))) if deep else ()
    return TorquePath(drive, reading, draw(st.booleans()), draw(st.floats(0, 1)), without_setpoint=draw(st.booleans()), rivals=rivals)


@given(paths(), homes)
def test_torque_paths(path: TorquePath, home: str) -> None:
    found = path_from_dict(through_a_file(path_to_dict(path), home))
    assert asdict(found) == asdict(path)


def share(name: str) -> st.SearchStrategy[float]:
    return st.floats(0.0, MOST[name])


@given(
    st.builds(
        Cascade,
        share("kp_nm_s_rad"),
        share("ki_nm_rad"),
        share("kpp_1_s"),
        share("velocity_filter_s"),
        st.builds(Prefilter, st.sampled_from(PREFILTER_KINDS), share("prefilter_omega_rad_s"), share("prefilter_d_n"), st.floats(0, 1e6)),
        st.builds(Feedforward, share("ff_inertia_kg_m2"), share("ff_viscous_nm_s_rad"), share("ff_coulomb_nm"), share("ff_offset_nm")),
        st.booleans(),
    ),
    homes,
)
def test_controllers(cascade: Cascade, home: str) -> None:
    assert cascade_from_dict(through_a_file({"parameters": cascade_to_parameters(cascade)}, home)) == cascade


gains = st.dictionaries(st.sampled_from(["kp_nm_s_rad", "ki_nm_rad", "kpp_1_s"]), positive)


@given(
    st.builds(
        CascadeStructure,
        words,
        st.floats(1e-6, 1.0),
        st.lists(st.sampled_from(PREFILTER_KINDS), unique=True).map(tuple),
        *[st.booleans()] * 4,
        gains,
        gains,
        gains,
    )
)
def test_structures_of_drives(structure: CascadeStructure) -> None:
    assert structure_from_dict(through_a_file({"structure": plain(structure)}, "yaml")) == structure


@given(
    st.builds(
        Calibration, words, positive, positive, st.dictionaries(names, st.builds(GainUnit, positive, st.floats(0, 1e9), positive, words))
    ),
    homes,
)
def test_calibrations(calibration: Calibration, home: str) -> None:
    assert _calibration_from_dict(through_a_file(calibration.to_dict(), home), home) == calibration


@given(st.dictionaries(names, any_text), st.dictionaries(names, finite | st.sampled_from([math.inf, -math.inf])))
def test_confirmed_motions(machine: dict[str, str], most: dict[str, float]) -> None:
    assert ConfirmedBounds.from_dict(through_a_file(ConfirmedBounds(machine, most).to_dict(), "yaml")) == ConfirmedBounds(machine, most)


@st.composite
def objects(draw: st.DrawFn) -> ObjectValue:
    kind = draw(st.sampled_from(list(TYPES)))
    low, high = bounds_of(kind)
    raw = draw(st.floats(low, high, width=32)) if kind == "real32" else float(draw(st.integers(int(low), int(high))))
    index = draw(st.integers(0x2000, 0x67FF).filter(lambda one: one not in COMMANDS))
    return ObjectValue(index, draw(st.integers(0, 0xFE)), kind, raw)


@given(objects(), homes, words, st.none() | finite)
def test_objects_of_backups(drawn: ObjectValue, home: str, name: str, value: float | None) -> None:
    item = ObjectValue(drawn.index, drawn.subindex, drawn.kind, drawn.raw, name, value)
    assert object_from_dict(through_a_file(item.to_dict(), home)) == item


@given(st.lists(objects(), min_size=1, max_size=12, unique_by=lambda item: item.place), words, st.lists(words, max_size=3))
def test_device_configuration_files(listed: list[ObjectValue], device: str, notes: list[str]) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.dcf"
        path.write_text(dcf_text(listed, {"device_name": device, "when": "2024-05-03T12:00:00"}, notes), encoding="utf-8", newline="")
        found = {item.place: item for item in load_object_file(path).values}
    for item in listed:
        assert found[item.place].kind == item.kind
        assert packed(item.kind, found[item.place].raw) == packed(item.kind, item.raw + 0.0), item  # -0.0 is 0


@given(st.lists(words, min_size=3, max_size=6, unique_by=str.lower), st.data())
def test_files_of_mappings(columns: list[str], data: st.DataObject) -> None:
    """Whatever columns are called: a line that is opened in the file of mappings is read as the mapping that it shows."""
    rows = np.cumsum(np.ones((400, len(columns))), axis=0) + np.arange(len(columns))
    table = Table("a.csv", {name: rows[:, j].copy() for j, name in enumerate(columns)})
    guesses = _guesses_for(table, sources_for(table, ()), AXIS, timed=True)
    text = _template(table, (), guesses)
    offered = [choice for guess in guesses for choice in guess.choices]
    assert offered
    for choice in offered:
        opened = text.replace(f"\n# {choice}\n", f"\n{choice}\n")
        assert choice in mappings_in(opened)
        assert parse_source(choice, table).theirs in columns


@pytest.mark.skipif(importlib.util.find_spec("mcap") is None, reason="the extra mcap is not installed")
@given(st.sampled_from(list(CHANNELS)), st.integers(12, 40), st.data())
@settings(max_examples=15)
def test_recordings_as_mcap(side: Side, rows: int, data: st.DataObject) -> None:
    column = st.lists(st.floats(-1e9, 1e9), min_size=rows, max_size=rows).map(np.array).filter(lambda one: np.ptp(one) > 0.0)
    begin = data.draw(st.floats(-1e3, 1e3))
    recording = Recording(
        data.draw(names), begin + 1e-3 * np.arange(rows), data.draw(column), data.draw(column), side=side, sidecar=Sidecar("free")
    )
    with TemporaryDirectory() as folder:
        with (Path(folder) / "a.mcap").open("wb") as stream:
            _write_mcap(stream, [recording])
        found = _table_in("mcap", Path(folder) / "a.mcap")
    for name, values in recording.columns().items():
        assert np.array_equal(found.columns[name], values), name
    assert completed(found, (), AXIS, timed=True)[0] == ()  # our own names need no mapping


@given(st.integers(4, 30).flatmap(lambda rows: st.dictionaries(names, st.lists(finite, min_size=rows, max_size=rows), min_size=2)))
@pytest.mark.parametrize("form", ["columns", "records", "lines"])
def test_json_tables(form: str, columns: dict[str, list[float]]) -> None:
    records = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    text = {"columns": json.dumps(columns), "records": json.dumps(records), "lines": "\n".join(map(json.dumps, records))}[form]
    with TemporaryDirectory() as folder:
        (Path(folder) / "a.json").write_text(text, encoding="utf-8")
        found = read_json(Path(folder) / "a.json")
    for name, values in columns.items():
        assert np.array_equal(found.columns[name], np.array(values)), name


@pytest.mark.skipif(importlib.util.find_spec("nptdms") is None, reason="the extra tdms is not installed")
@given(st.lists(finite, min_size=4, max_size=30), words)
@settings(max_examples=15)
def test_tdms_channels(values: list[float], group: str) -> None:
    from nptdms import ChannelObject, TdmsWriter

    told = {"wf_increment": 1e-3, "wf_start_offset": 0.0, "wf_samples": 1, "unit_string": "Nm"}
    with TemporaryDirectory() as folder:
        with TdmsWriter(str(Path(folder) / "a.tdms")) as writer:
            writer.write_segment([ChannelObject(group, "Torque", np.array(values), properties=told)])
        found = _table_in("tdms", Path(folder) / "a.tdms")
    assert np.array_equal(found.columns["Torque"], np.array(values))
    assert found.units["Torque"] == "Nm"
    assert np.allclose(found.columns[found.clocks["Torque"]], 1e-3 * np.arange(len(values)), rtol=0.0, atol=1e-12)
