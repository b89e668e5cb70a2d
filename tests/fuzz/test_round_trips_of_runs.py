"""What grows beside the records of a run, and what leaves it, is read back the same: kept fits and answers, journals, studies, bundles."""

from __future__ import annotations

import json
import os
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from beltcomm import caches, journal
from beltcomm.axis import load_axis
from beltcomm.configfiles import read_yaml, to_yaml, write_text
from beltcomm.fit.estimate import evaluate_at, problem_of
from beltcomm.fit.records import Data, prepare_records
from beltcomm.fit.torque.laws import ReadingLaw
from beltcomm.fit.torque.path import TorquePath
from beltcomm.fit.uncertainty.nuisance import with_nuisance
from beltcomm.jobs.bundle import VERSIONS, bundle
from beltcomm.model import load_plant
from beltcomm.recording import Recording, load_recording, recording_from_columns, save_recording
from beltcomm.recording.sidecar import Sidecar
from beltcomm.result import plain
from beltcomm.rundata.kept import _restore_fit, _store_fit
from beltcomm.runfolder import RunFolder
from beltcomm.study.file import load_study
from beltcomm.study.job import _line_text, _read_members
from beltcomm.study.population import nominal_of, population_from
from beltcomm.watching import store
from beltcomm.watching.estimates import ERROR, MoveEstimate
from fuzz.test_round_trips import any_text, finite, names, plain_values, words

AXIS, MODEL = load_axis("egc-70-600"), load_plant("g_a").model
NOMINAL = nominal_of(MODEL, 1e-3, 0.0)
#: Halves of characters too, as in the name of a folder that is no UTF-8.
every_text = st.text(st.characters(), max_size=20)


def shaken(name: str, seed: int, held_out: bool) -> Recording:
    """A rigid motor under noise: what is fitted to it does not matter here."""
    draw, t_s = np.random.default_rng(seed), 1e-3 * np.arange(500)
    torque = np.repeat(draw.normal(0.0, 0.3, 50), 10)
    speed = np.cumsum(torque) * 1e-3 / 2e-3
    columns = {"t_s": t_s, "torque_nm": torque + draw.normal(0.0, 1e-2, 500), "position_rad": np.cumsum(speed) * 1e-3}
    return recording_from_columns(name, columns, Sidecar("free", held_out=held_out))


RECORDS = (shaken("a", 1, False), shaken("b", 2, False), shaken("c", 3, True))


@st.composite
def prepared(draw: st.DrawFn) -> Data:
    shares = {one.name: (draw(st.floats(0.0, 1.0)), draw(st.floats(0.0, 1.0))) for one in RECORDS}
    path = TorquePath(reading=ReadingLaw(draw(st.integers(0, 3)) + draw(st.sampled_from([0.0, 0.2, 0.75]))))
    noise, step = draw(st.floats(1e-4, 1e-1)), draw(st.floats(1e-6, 1e-3))
    return prepare_records(
        RECORDS,
        MODEL,
        noise,
        step,
        shares,
        draw(st.sampled_from([2, 4, 8])),
        path,
        draw(st.booleans()),
        draw(st.floats(0.0, 0.9)),
        draw(st.booleans()),
    )


@given(prepared(), st.lists(st.sampled_from(["cart.mass", "motor.inertia"]), max_size=2, unique=True), st.integers(0, 1 << 30))
@settings(max_examples=12)
def test_kept_fits(data: Data, fixed: list[str], seed: int) -> None:
    problem = problem_of(data, MODEL, fixed)
    start = problem.start()
    x = start + np.random.default_rng(seed).uniform(-0.05, 0.05, len(start))
    fitted = with_nuisance(data, evaluate_at(data, problem, x))
    made = _store_fit(data, fitted)
    assert made is not None
    with TemporaryDirectory() as folder:
        caches.keep(Path(folder) / "fit.json", "key", {"fit": made})
        kept = caches.found(Path(folder) / "fit.json", "key")
    assert kept is not None
    again = _restore_fit(RECORDS, kept["fit"])
    assert _store_fit(*again) == made
    assert again[1].x.tobytes() == fitted.x.tobytes()
    assert again[1].residual.tobytes() == fitted.residual.tobytes()
    assert (again[1].objective, again[1].held_out_objective) == (fitted.objective, fitted.held_out_objective)


@given(st.dictionaries(any_text.filter(lambda key: key != "key"), plain_values), any_text, any_text)
def test_kept_answers(content: dict[str, Any], key: str, other: str) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.json"
        caches.keep(path, key, content)
        assert caches.found(path, key) == {"key": key, **content}
        assert (caches.found(path, other) is None) is (other != key)


@given(
    st.lists(st.tuples(every_text, st.sampled_from(["note", "phase", "connected", "restored", "left at once"]), st.booleans()), max_size=8),
    st.floats(0.0, 1.0),
)
def test_journals(lines: list[tuple[str, Any, bool]], torn: float) -> None:
    """Whatever is written: a line is a line of both files; of a file that a power cut has torn all but the last is as before."""
    with TemporaryDirectory() as made:
        folder, at = Path(made), "2026-01-01 00:00:00"
        for text, event, timed in lines:
            journal.append(folder, text, event, at if timed else "")
        shown = [" ".join(text.split()).encode("utf-8", "backslashreplace").decode() for text, _, _ in lines]
        expected = [f"{at}  {text}" if timed else text for text, (_, _, timed) in zip(shown, lines, strict=True)]
        events = [event for _, event, _ in lines]
        assert journal.lines_of(folder) == expected
        assert journal.events_of(folder) == events
        for name in (journal.TEXT, journal.EVENTS) if lines else ():
            file = folder / name
            os.truncate(file, int(torn * file.stat().st_size))
        whole = max(len(journal.lines_of(folder)) - 1, 0)
        assert journal.lines_of(folder)[:whole] == expected[:whole]
        found = len(journal.events_of(folder))
        assert journal.events_of(folder) in (events[:found], [*events[: found - 1], "note"])
        journal.append(folder, "goes on", "not restored", at)
        assert journal.lines_of(folder)[-1] == f"{at}  goes on"
        assert journal.events_of(folder)[-1] == "not restored"


sizes = st.floats(1e-20, 1e20)
moves = st.lists(
    st.tuples(st.floats(-1e9, 1e10), sizes, sizes, st.dictionaries(names, st.tuples(sizes, sizes), max_size=3)), min_size=1, max_size=6
)


@given(moves, st.integers(1, 60))
def test_watched_moves(drawn: list[tuple[float, float, float, dict[str, tuple[float, float]]]], torn: int) -> None:
    """Each move as it was written; where a power cut has torn the last one, the next is whole all the same."""
    written = [
        {
            "date_s": date_s,
            "error_over_noise": error,
            "error_interval": interval,
            "quantities": {key: {"value": value, "interval": within} for key, (value, within) in told.items()},
        }
        for date_s, error, interval, told in drawn
    ]
    with TemporaryDirectory() as made:
        run = Path(made)
        for entry in written:
            store.append(run, entry)
        assert list(store.entries(run)) == written
        file = run / store.FOLDER / store.FILE
        os.truncate(file, file.stat().st_size - torn)
        store.append(run, written[0])
        assert list(store.entries(run)) in ([*written[:-1], written[0]], [*written, written[0]])
    for entry, (_, error, interval, told) in zip(written, drawn, strict=True):
        assert store.told_by(entry) == {key: MoveEstimate(*one) for key, one in (told | {ERROR: (error, interval)}).items()}


@st.composite
def member_lines(draw: st.DrawFn) -> dict[str, Any]:
    """As a worker makes it: with a result or with an error."""
    ended = (
        {"found": draw(st.dictionaries(every_text, plain_values | every_text, max_size=3))}
        if draw(st.booleans())
        else {"error": draw(every_text)}
    )
    values = draw(st.dictionaries(names, finite | every_text, max_size=3))
    return {
        "member": draw(st.integers(0, 10**6)),
        "key": draw(words),
        "values": values,
        "program": "p",
        "exit_code": draw(st.integers(0, 5)),
        **ended,
    }


@given(st.lists(member_lines(), min_size=1, max_size=5), st.floats(0.0, 1.0, exclude_max=True))
@example([{"member": 0, "key": "run-\udc80", "values": {}, "program": "p", "exit_code": 0, "error": "\ud800"}], 0.5)
def test_members_of_studies(lines: list[dict[str, Any]], torn: float) -> None:
    """Also names of folders that are no text; of a file that was cut off, the whole lines."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "members.jsonl"
        texts = [_line_text(line).encode() for line in lines]
        path.write_bytes(b"".join(texts))
        assert _read_members(path) == [plain(line) for line in lines]
        path.write_bytes(b"".join(texts[:-1]) + texts[-1][: int(torn * len(texts[-1]))])
        assert _read_members(path) == [plain(line) for line in lines[:-1]]


@st.composite
def distributions(draw: st.DrawFn) -> dict[str, Any]:
    positive = st.floats(1e-3, 1e3)
    low = draw(positive)
    return draw(
        st.sampled_from(
            [
                {"uniform": [low, low + draw(positive)]},
                {"normal": [low, draw(positive)]},
                {"choice": draw(st.lists(positive, min_size=1, max_size=4))},
                {"tolerance": f"{draw(st.floats(0.01, 99.0)):.6f} %"},
            ]
        )
    )


@given(
    st.dictionaries(st.sampled_from(["cart.mass", "coulomb.level", "belt_stiffness.stiffness"]), distributions(), min_size=1),
    st.dictionaries(
        st.sampled_from(["coulomb.level", "cart.mass"]), st.floats(-50.0, 50.0).map(lambda share: f"{share:.6f} %"), min_size=1
    ),
    st.integers(0, 1 << 60),
)
def test_files_of_studies(population: dict[str, Any], older: dict[str, str], seed: int) -> None:
    """The file that a study copies into its folder draws the same axes."""
    data = {"population": population, "ageing": {"age": {"uniform": [0.0, 1.0]}, "when_old": older}, "seed": seed}
    with TemporaryDirectory() as folder:
        write_text(Path(folder) / "a.yaml", to_yaml(data))
        read = read_yaml(Path(folder) / "a.yaml")
    asked, found = population_from(data, MODEL, seed), population_from(read, MODEL, read["seed"])
    assert found == asked
    assert [found.member(k, NOMINAL) for k in range(3)] == [asked.member(k, NOMINAL) for k in range(3)]


def test_a_shipped_study_copied_is_the_same_study() -> None:
    first = load_study("tolerances")
    with TemporaryDirectory() as folder:
        write_text(Path(folder) / "study.yaml", (Path(__file__).parents[2] / "configs/studies/tolerances.yaml").read_text(encoding="utf-8"))
        again = load_study(Path(folder) / "study.yaml")
    assert (again.fingerprint, [again.key(k) for k in range(3)]) == (first.fingerprint, [first.key(k) for k in range(3)])


#: What a file system takes, other than letters too; no slash and no zero.
file_names = (
    st.binary(min_size=1, max_size=20)
    .map(lambda raw: os.fsdecode(raw.replace(b"/", b"-").replace(b"\0", b"-")))
    .filter(lambda name: not name.startswith("."))
)


@given(st.dictionaries(file_names, every_text, max_size=4), st.integers(12, 40), st.data())
@settings(max_examples=20)
def test_bundles(texts: dict[str, str], rows: int, data: st.DataObject) -> None:
    """Records to the digit, texts in which nothing is private as they are, whatever a file is called; and over the zip of before."""
    column = st.lists(st.floats(-1e9, 1e9), min_size=rows, max_size=rows).map(np.array).filter(lambda one: np.ptp(one) > 0.0)
    record = recording_from_columns(
        "a", {"t_s": 1e-3 * np.arange(rows), "torque_nm": data.draw(column), "position_rad": data.draw(column)}, Sidecar("free")
    )
    with TemporaryDirectory() as made:
        run, out, unpacked = Path(made) / "run", Path(made) / "b.zip", Path(made) / "unpacked"
        save_recording(record, RunFolder.create(run, AXIS).path / "recordings")
        for name, text in texts.items():
            (run / f"{name}.txt").write_bytes(text.encode("utf-8", "replace"))
        for _ in range(2):
            told = bundle(run, out, recordings=True).data["files"]
            with zipfile.ZipFile(out) as archive:
                assert archive.testzip() is None
                assert archive.namelist() == list(told)
                archive.extractall(unpacked)
                packed = {archive.read(name) for name in told}
        json.dumps(plain(told)).encode()
        assert VERSIONS in told
        assert len(told) == len({*told}) == 5 + len(texts)  # versions, axis, drive, record and sidecar
        again = load_recording(unpacked / "recordings" / "a.csv")
        for name, values in record.columns().items():
            assert again.columns()[name].tobytes() == values.tobytes(), name
        assert RunFolder.open(unpacked).axis == RunFolder.open(run).axis
        for text in texts.values():
            assert "/" in text or "\\" in text or text.encode("utf-8", "replace") in packed
