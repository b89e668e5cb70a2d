"""What is written is read back the same: every writer with its reader, on drawn values."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from beltcomm.axis import axis_from_dict, load_axis, save_axis
from beltcomm.configfiles import read_yaml, sealed, to_yaml, write_text
from beltcomm.errors import BeltcommError, DataError
from beltcomm.foreign.apart_reader import _table_in
from beltcomm.foreign.convert import Reading, reading_from_dict
from beltcomm.foreign.files import read_table
from beltcomm.foreign.framelog import read_frames
from beltcomm.given import EXCITATION_KINDS, EXPERIMENTS
from beltcomm.model import load_model, load_plant
from beltcomm.recording import RecordingWriter, load_recording, recording_from_columns, save_recording
from beltcomm.recording.columns import MOTOR_COLUMNS
from beltcomm.recording.sidecar import ExcitationNote, Sidecar, load_sidecar
from beltcomm.recording.signalfile import read_columns, write_columns
from beltcomm.response import FrequencyResponse
from beltcomm.schedule.next_plan import NextPlan, load_plan
from beltcomm.schedule.steps import HIGHEST_HZ, KEYS, LONGEST_TRIANGLE_M, Step, checked_step
from foreign.matfiles import write_v5, write_v73

Array = NDArray[np.float64]
settings.register_profile("steady", derandomize=True, deadline=None, max_examples=50, database=None)
settings.load_profile("steady")

finite = st.floats(allow_nan=False, allow_infinity=False)
#: What people put into names and cells; no control characters, which end lines or are none.
words = st.text(st.characters(exclude_categories=("Cs", "Cc", "Zl", "Zp")), min_size=1, max_size=12)
names = st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,12}", fullmatch=True)


def columns_of(rows: int, least: int = 2) -> st.SearchStrategy[dict[str, Array]]:
    column = st.lists(finite, min_size=rows, max_size=rows).map(np.array)
    return st.dictionaries(names, column, min_size=least, max_size=5)


@given(st.integers(1, 40).flatmap(columns_of), st.lists(words, min_size=40, max_size=40), st.booleans())
def test_signal_files(columns: dict[str, Array], cells: list[str], text: bool) -> None:
    rows = len(next(iter(columns.values())))
    everything: dict[str, Any] = dict(columns)
    if text:
        everything["said"] = np.array([f"x{cell}" for cell in cells[:rows]], dtype=object)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.csv"
        write_columns(path, everything)
        found = read_columns(path, set(columns) - {"said"})
    assert list(found) == list(everything)
    for name, column in everything.items():
        assert found[name].tobytes() == column.tobytes() or np.array_equal(found[name], column)
        assert found[name].dtype.kind == column.dtype.kind


@st.composite
def recordings(draw: st.DrawFn) -> tuple[dict[str, Array], Sidecar]:
    rows = draw(st.integers(12, 25))
    small = st.floats(-50.0, 50.0)
    columns = {"t_s": draw(st.floats(-1e3, 1e3)) + 1e-3 * np.arange(rows)}
    for name in ("torque_nm", "position_rad", *draw(st.sets(st.sampled_from(["torque_offset_nm", "temperature_c", "other"])))):
        columns[name] = np.array(draw(st.lists(small, min_size=rows, max_size=rows)))
    return columns, draw(sidecars())


@st.composite
def sidecars(draw: st.DrawFn) -> Sidecar:
    maybe = st.none() | st.floats(-1e6, 1e6)
    note = None
    if draw(st.booleans()):
        starts = draw(st.none() | st.lists(st.integers(0, 10**6), min_size=1, max_size=4).map(tuple))
        note = ExcitationNote(
            draw(st.sampled_from(EXCITATION_KINDS)),
            draw(st.none() | st.floats(0.0, 1e6)),
            draw(st.none() | st.integers(2, 10**6)),
            draw(st.integers(0, 10**6)),
            starts,
            draw(maybe),
            draw(maybe),
        )
    known = {name for name in Sidecar.__dataclass_fields__}
    extra = draw(st.dictionaries(names.filter(lambda name: name not in known), plain_values, max_size=3))
    return Sidecar(
        draw(st.sampled_from([kind for kind in EXPERIMENTS if kind != "static_map"])),
        draw(maybe),
        draw(maybe),
        draw(st.booleans()),
        draw(st.booleans()),
        draw(st.none() | st.floats(0.0, 1e6)),
        note,
        draw(st.dictionaries(names, plain_values, max_size=2)),
        draw(st.text(st.characters(exclude_categories=("Cs",)), max_size=20)),
        extra=extra,
        payload_inertia_kg_m2=draw(st.none() | st.floats(0.0, 1e6)),
        load=draw(st.text(st.characters(exclude_categories=("Cs",)), max_size=20)),
    )


any_text = st.text(st.characters(exclude_categories=("Cs",)), max_size=12)
plain_values = st.recursive(
    st.none() | st.booleans() | st.integers(-(1 << 63), (1 << 64) - 1) | finite | any_text,
    lambda inside: st.lists(inside, max_size=4) | st.dictionaries(any_text, inside, max_size=4),
    max_leaves=8,
)


@given(st.dictionaries(st.text(st.characters(exclude_categories=("Cs",)), max_size=8), plain_values, max_size=5))
def test_settings_files(data: dict[str, Any]) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.yaml"
        write_text(path, to_yaml(data))
        assert read_yaml(path) == data


@given(sidecars())
def test_sidecars(note: Sidecar) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.yaml"
        write_text(path, to_yaml(note.to_dict()))
        assert load_sidecar(path)[0] == note


@given(recordings())
@settings(max_examples=25)
def test_recordings(drawn: tuple[dict[str, Array], Sidecar]) -> None:
    columns, note = drawn
    try:
        made = recording_from_columns("a", columns, note)
    except DataError:
        assume(False)
    with TemporaryDirectory() as folder:
        loaded = load_recording(save_recording(made, Path(folder)))
    assert loaded.sidecar == made.sidecar
    for name, column in made.columns().items():
        assert loaded.columns()[name].tobytes() == column.tobytes()


@given(st.lists(st.tuples(*[finite] * len(MOTOR_COLUMNS)), min_size=1, max_size=150), st.booleans())
def test_rows_written_while_the_axis_moves(rows: list[tuple[float, ...]], finished: bool) -> None:
    with TemporaryDirectory() as folder:
        writer = RecordingWriter(Path(folder) / "a.csv", Sidecar())
        for row in rows:
            writer.write(row)
        found = read_columns(writer.close(finished=finished), MOTOR_COLUMNS, torn=not finished)
    assert np.array_equal(np.column_stack(list(found.values())), np.array(rows))


@given(st.data(), words)
def test_axis_files(data: st.DataObject, name: str) -> None:
    """Every number of the shipped axis by up to a fifth more or less; what cannot be is refused before it is written."""
    shipped = load_axis("egc-70-600")
    drawn: dict[str, Any] = {**shipped.to_dict(), "name": name}
    for part, entries in drawn.items():
        for key, value in entries.items() if isinstance(entries, dict) else ():
            if type(value) is float:
                drawn[part] = {**drawn[part], key: value * data.draw(st.floats(0.8, 1.25) | st.just(1.0))}
    with TemporaryDirectory() as folder:
        path = Path(folder) / "axis.yaml"
        try:
            axis = axis_from_dict(drawn, path)
        except BeltcommError:
            assume(False)
        save_axis(axis, path)
        found = load_axis(str(path))
    assert (found.fingerprint(), found.to_dict()) == (axis.fingerprint(), axis.to_dict())


@given(st.sampled_from(["g_a", "g_b", "egc_70", "s_a"]), st.data())
def test_models(plant: str, data: st.DataObject) -> None:
    model = load_plant(plant).model
    factors = {name: data.draw(st.floats(0.5, 2.0)) for name in model.parameters}
    changed = model.with_values({name: factor * model[name] for name, factor in factors.items()})
    with TemporaryDirectory() as folder:
        path = Path(folder) / "m.yaml"
        write_text(path, to_yaml(changed.to_dict()))
        found = load_model(path)
    assert found.to_dict() == changed.to_dict()
    assert found.vector().tobytes() == changed.vector().tobytes()


@st.composite
def steps(draw: st.DrawFn) -> Step:
    kind = draw(st.sampled_from(sorted(KEYS)))
    some = st.lists(st.floats(1e-3, 0.1), min_size=1, max_size=3).map(tuple)
    drawn = {
        "place": st.floats(0.0, 1.0),
        "share": st.floats(1e-6, 1.0),
        "speeds_m_s": some,
        "amplitudes_m": st.lists(st.floats(1e-3, LONGEST_TRIANGLE_M), min_size=1, max_size=3).map(tuple),
        "seconds": st.floats(0.0, 60.0),
        "seed": st.integers(0, 1 << 30),
        "up_to_hz": st.floats(0.0, HIGHEST_HZ),
        "again": st.booleans(),
        "held_out": st.booleans(),
    }
    return checked_step({"kind": kind, **{key: draw(drawn[key]) for key in KEYS[kind]}}, "drawn")


@given(st.lists(steps(), min_size=1, max_size=5), st.dictionaries(names, words, max_size=3), st.lists(words, max_size=2))
def test_plans(listed: list[Step], reasons: dict[str, str], by_hand: list[str]) -> None:
    plan = NextPlan(reasons, tuple(by_hand), tuple(listed), ())
    with TemporaryDirectory() as folder:
        path = Path(folder) / "plan.yaml"
        write_text(path, to_yaml(sealed(plan.to_dict())))
        assert load_plan(path) == plan


@given(
    st.lists(st.tuples(st.floats(1e-3, 1e4), finite, finite), min_size=3, max_size=30, unique_by=lambda row: row[0]),
    st.lists(words, max_size=2),
)
def test_responses(rows: list[tuple[float, float, float]], remarks: list[str]) -> None:
    freq, real, imaginary = np.array(rows).T
    made = FrequencyResponse(np.sort(freq), real + 1j * imaginary, np.abs(real), np.ones(len(freq)), 4, 1e-3, tuple(remarks))
    with TemporaryDirectory() as folder:
        made.save(Path(folder) / "r.npz")
        found = FrequencyResponse.load(Path(folder) / "r.npz")
    assert (found.h.tobytes(), found.freq_hz.tobytes(), found.remarks) == (made.h.tobytes(), made.freq_hz.tobytes(), made.remarks)


readings = st.builds(
    Reading,
    mapping=st.lists(words, max_size=3).map(tuple),
    separator=st.sampled_from([None, "comma", "space"]),
    skip_lines=st.integers(0, 9),
    period_s=st.none() | st.floats(1e-6, 1.0),
    first_row=st.none() | st.integers(1, 9),
    last_row=st.none() | st.integers(10, 99),
    torque_acts=st.sampled_from([None, "after", "before"]),
    drop_incomplete=st.booleans(),
    flip=st.sampled_from([(), ("torque",), ("torque", "position")]),
    node=st.none() | st.integers(1, 127),
)


@given(readings)
def test_readings(reading: Reading) -> None:
    with TemporaryDirectory() as folder:
        write_text(Path(folder) / "a.yaml", to_yaml({"reading": reading.to_dict()}))
        assert reading_from_dict(read_yaml(Path(folder) / "a.yaml")["reading"]) == reading


@given(
    st.integers(8, 60).flatmap(lambda rows: columns_of(rows, least=3)),
    st.sampled_from([(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), (" ", ".")]),
    st.sampled_from(["\n", "\r\n", "\r"]),
    st.sampled_from(["utf-8", "utf-8-sig", "utf-16"]),
    st.integers(0, 3),
)
def test_foreign_text(columns: dict[str, Array], marks: tuple[str, str], end: str, encoding: str, comments: int) -> None:
    separator, decimal = marks
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    lines = ["# said"] * comments + [separator.join(columns)] + [separator.join(repr(v).replace(".", decimal) for v in row) for row in rows]
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.csv"
        path.write_bytes((end.join(lines) + end).encode(encoding))
        given_marks: dict[str, Any] = {"decimal": "comma" if decimal == "," else "point"}
        found = read_table(path, **given_marks).columns
    assert list(found) == list(columns)
    for name, column in columns.items():
        assert np.array_equal(found[name], column)


@pytest.mark.parametrize("kind", ["matlab 5", "matlab 7.3", "hdf5", "numpy"])
@given(st.integers(3, 30).flatmap(columns_of))
@settings(max_examples=25)
def test_binary_tables(kind: str, columns: dict[str, Array]) -> None:
    assume(not any(name.lower() in {"unit", "units", "einheit", "einheiten"} for name in columns))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a"
        if kind == "matlab 5":
            found = _table_in("matlab", write_v5(path, {name: column for name, column in columns.items()}))
        elif kind == "matlab 7.3":
            found = _table_in("matlab", write_v73(path, dict(columns)))
        elif kind == "hdf5":
            with h5py.File(path, "w") as file:
                for name, column in columns.items():
                    file.create_dataset(name, data=column, compression="gzip")
            found = _table_in("hdf5", path)
        else:
            np.savez(path.with_suffix(".npz"), **columns)  # type: ignore[arg-type]
            found = _table_in("numpy", path.with_suffix(".npz"))
    assert sorted(found.columns) == sorted(columns)
    for name, column in columns.items():
        assert np.array_equal(found.columns[name], column)


@pytest.mark.skipif(importlib.util.find_spec("asammdf") is None, reason="the extra mdf is not installed")
@given(st.lists(st.floats(-1e300, 1e300), min_size=3, max_size=30))
@settings(max_examples=8)
def test_measurement_data_files(values: list[float]) -> None:
    import asammdf

    column, stamps = np.array(values), np.arange(len(values)) * 1e-3
    with TemporaryDirectory() as folder, asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(column, stamps, unit="Nm", name="Torque")])
        found = _table_in("mdf", Path(file.save(Path(folder) / "a.mf4")))
    assert np.array_equal(found.columns["Torque"], column)
    assert np.array_equal(found.columns["time"], stamps)


@given(
    st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8), st.integers(0, 10**9)), min_size=1, max_size=40),
    st.sampled_from(["log", "asc", "blf"]),
)
@settings(max_examples=15)
def test_frames(drawn: list[tuple[int, bytes, int]], ending: str) -> None:
    import can

    writer = {"log": can.CanutilsLogWriter, "asc": can.ASCWriter, "blf": can.BLFWriter}[ending]
    stamps = 1e3 + np.cumsum([micro for _, _, micro in drawn]) * 1e-6
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"a.{ending}"
        with writer(str(path)) as file:  # type: ignore[abstract]
            for stamp, (identifier, data, _) in zip(stamps, drawn, strict=True):
                file.on_message_received(can.Message(float(stamp), identifier, False, data=data, channel=0))
        found = read_frames(path)
    assert found.identifier.tolist() == [identifier for identifier, _, _ in drawn]
    assert [bytes(row[:length]) for row, length in zip(found.data, found.length, strict=True)] == [data for _, data, _ in drawn]
    if not any("begins anew" in note or "added up" in note for note in found.notes):
        np.testing.assert_allclose(found.t_s, stamps - stamps[0], atol=2e-6, rtol=1e-9)
