"""Every parser of this package with a good file for it, and one case of a fuzz: a damaged file is read, or refused with a sentence."""

from __future__ import annotations

import gzip
import json
import random
import traceback
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from beltcomm.axis import Axis, load_axis
from beltcomm.configfiles import find_config, read_yaml, to_yaml
from beltcomm.errors import BeltcommError, DataError
from beltcomm.foreign.apart import Kind
from beltcomm.foreign.apart_reader import _table_in
from beltcomm.foreign.convert import Reading
from beltcomm.foreign.eds import load_object_file
from beltcomm.foreign.files import parts_of
from beltcomm.foreign.guess import mappings_in
from beltcomm.foreign.signals import by_hand, of_dbc
from beltcomm.journal import events_of, lines_of
from beltcomm.model import load_model, load_plant
from beltcomm.outside import read_json, read_text
from beltcomm.recording import load_recording
from beltcomm.recording.sidecar import load_sidecar
from beltcomm.response import FrequencyResponse
from beltcomm.rundata import backups
from beltcomm.rundata.calibration import _calibration_from_dict
from beltcomm.rundata.kept import kept_or_new
from beltcomm.rundata.revisions import revisions
from beltcomm.rundata.store import cascade_from_dict, structure_from_dict
from beltcomm.runfolder import RunFolder
from beltcomm.schedule.next_plan import load_plan
from beltcomm.study.file import load_study
from beltcomm.study.job import _read_members
from beltcomm.trajectory import load_move
from beltcomm.watching import store
from beltcomm_adapters.profiles import load_profile
from foreign.matfiles import write_v5, write_v73
from foreign.test_damaged_files import bus
from fuzz.mutation import mutated

#: What a case can end with.
OUTCOMES = ("fine", "refused", "unnamed", "traceback")


@dataclass(frozen=True)
class Parser:
    """name : of the file that it reads.   good : bytes that it reads.   load : reads the file.   apart : in a process of its own.
    within : in a run, where the file has another name."""

    name: str
    good: bytes
    load: Callable[[Path], object]
    apart: bool = False
    within: bool = False


def recording_text(separator: str = ",") -> str:
    """A recording of 300 rows."""
    t = np.arange(300) * 1e-3
    rows = zip(t, 0.1 * np.sin(40.0 * t), 0.01 * np.cos(40.0 * t), strict=True)
    return (
        separator.join(("t_s", "torque_nm", "position_rad"))
        + "\n"
        + "".join(f"{a:.3f}{separator}{b:.6f}{separator}{c:.6f}\n" for a, b, c in rows)
    )


#: Of two parameters of the plant.
COVARIANCE = b"covariance: {names: [cart.mass, motor.inertia], rows: [[0.0001], [-0.0000001, 0.000000001]], freedom: 40.0}\n"
SIDECAR = """experiment: frf
start_position_m: 0.25
session_time_s: 12.3
closed_loop: false
payload_kg: 11.2
excitation: {kind: multisine, amplitude_nm: 0.3, period_samples: 128, first_sample: 10}
import: {original: originals/a.csv, sha256: 00, columns: {torque_nm: Iq}, reading: {mapping: ["torque_nm=Iq*0.65"]}}
"""
PLAN = """reasons: {cogging: r}
steps:
- {kind: strokes, place: 0.2, speeds_m_s: [0.02, 0.05], held_out: true}
- {kind: moves, share: 0.5, seconds: 8.0, seed: 2}
"""
BACKUP = {"drive": {"device_name": "x"}, "parameters": {"kp_nm_s_rad": 0.05, "ki_nm_rad": 0.2}}
GAINS = {"kp_nm_s_rad": 0.05, "ki_nm_rad": 0.2, "kpp_1_s": 10.0, "velocity_filter_s": 0.004}
STRUCTURE = {"name": "x", "velocity_feedforward": True, "period_s": 0.001, "prefilters": ["none"]}
DESIGN = {"parameters": GAINS, "dead_time_s": 1e-3, "structure": STRUCTURE, "specification": {"phase_margin_deg": 45.0}, "margins": []}
CALIBRATION = """kind: x
rated_torque_nm: 1.43
rated_current_a: 2.0
units: {kp_nm_s_rad: {unit: 0.01, interval: 0.001, assumed: 0.01, object: 60F9h}}
"""
MEMBERS = '{"member": 0, "key": "k", "values": {"a": 1.5}, "exit_code": 0, "found": {"error_mm": 0.2}}\n' * 3
REVISIONS = """revisions:
- {name: r1, parent: '', change: base, effects: [viscous], ratio: 1.5, held_out: null, confirmed: null, command: c, when: w, data: {a: x}}
"""
#: Of results that commands read: what is read of each.
RESULTS: dict[str, dict[str, Any]] = {
    "fit": {
        **{"misfit": 1.02, "suspect": False, "free": ["cart.mass"], "records": ["frf_1"]},
        "characteristics": {"resonance_hz": {"value": 41.2, "interval": 0.1, "unit": "Hz"}},
        "dead_time": {"value_s": 1e-3, "interval_s": 1e-5},
        "torque_path": {
            "drive": {"delay": 1.0, "delay_interval": 0.1, "gain": 1.0, "lags": [{"kind": "first", "values": [5e-4], "intervals": [1e-5]}]},
            **{"reading": {"late": 0.0, "lags": []}, "commanded": False, "acts": 0.0, "rivals": []},
        },
    },
    "verify": {
        **{"passed": True, "measured": {"dynamic_m": 1e-4, "static_m": 1e-6}, "predicted": {"dynamic_m": 1e-4, "static_m": 1e-6}},
        **{"targets": {"following_error_m": 1e-3, "at": "motor"}, "verified": {"gains": "a", "model": "b"}},
    },
    "diagnosis": {
        "named": ["cogging"],
        "after": {"effects": ["cogging"], "parameters": {"cogging.sine": {"value": 0.1, "interval": 0.01}}},
    },
    "plan": {
        **{"text": "x", "points": [["travel", "0.2 m"]], "seconds": 3.0},
        "experiments": [{"title": "a"} | dict.fromkeys(("travel_m", "reach_m", "speed_m_s", "torque_nm", "belt_force_n", "seconds"), 0.1)],
    },
    "led_gains": {"kp": 0.05, "kpp": 20.0, "kp_interval": 0.001, "kpp_interval": 0.1},
    "breakaway": {"coulomb_nm": 0.1},
}
DBC = """VERSION ""
BU_: A
BO_ 385 Motion: 8 A
 SG_ Position : 0|32@1- (0.001,0) [0|0] "rad" A
 SG_ Torque : 32|16@1- (0.01,0) [0|0] "Nm" A
"""


WATCHED = (
    """\
{"move": 1, "date_s": 1.7e9, "error_over_noise": 1.1, "error_interval": 0.1, "quantities": {"cart.mass": {"value": 1.4, "interval": 0.1}}}
{"anew": true}
"""
    * 2
)


def parsers(folder: Path) -> dict[str, Parser]:
    """All of them, by a word.   folder : for the good files."""
    import can

    axis = Axis(name="a")
    whole = load_axis("egc-70-600")
    run = RunFolder.create(folder / "run", whole)
    run.claim_drive({"device_name": "x", "vendor_id": "29"})
    value = {
        "t": np.arange(60) * 1e-3,
        "log": {"Time": np.arange(60.0), "Data": np.sin(np.arange(60)), "Unit": "A"},
        "c": [np.arange(9.0), "text"],
    }
    np.savez(folder / "a.npz", **{name: value["t"] for name in ("t", "torque")})
    np.save(folder / "a.npy", np.arange(40.0).reshape(20, 2))
    line = np.linspace(1.0, 90.0, 40)
    FrequencyResponse(line, line + 1j, line, np.clip(line, 0.0, 1.0), 4, 1e-3).save(folder / "response.npz")
    with h5py.File(folder / "a.h5", "w") as file:
        file["t"], file["deep/torque"] = value["t"], value["t"]
        file["deep/torque"].attrs["unit"] = "Nm"
        file.create_dataset("packed", data=np.arange(400.0), compression="gzip", shuffle=True, chunks=(50,))
    move = "t_s,position_m\n" + "".join(f"{a:.4f},{0.1 + 0.1 * (1.0 - np.cos(np.pi * a)):.9f}\n" for a in np.linspace(0.0, 1.0, 101))
    foreign = (
        recording_text(";")
        .replace("t_s;torque_nm;position_rad", "time [s];torque [Nm];angle [rad];state")
        .replace("\n", ";ok\n")
        .replace("state;ok", "state", 1)
    )
    frames: dict[str, bytes] = {}
    for ending, writer in {"log": can.CanutilsLogWriter, "asc": can.ASCWriter, "blf": can.BLFWriter, "trc": can.TRCWriter}.items():
        with writer(str(folder / f"a.{ending}")) as log:  # type: ignore[abstract]
            for message in bus():
                log.on_message_received(message)
        frames[ending] = (folder / f"a.{ending}").read_bytes()

    def foreign_file(path: Path) -> object:
        return parts_of(path, Reading(), axis)

    def inside(kind: Kind) -> Callable[[Path], object]:
        return lambda path: _table_in(kind, path)

    def in_run(place: str, use: Callable[[RunFolder], object]) -> Callable[[Path], object]:
        def load(path: Path) -> object:
            target = run.path / place
            target.parent.mkdir(exist_ok=True)
            before = target.read_bytes() if target.exists() else None
            target.write_bytes(path.read_bytes())
            try:
                return use(RunFolder.open(run.path))
            finally:
                target.unlink() if before is None else target.write_bytes(before)

        return load

    def claimed(opened: RunFolder) -> None:
        opened.claim_drive({"vendor_id": "29"})

    def design(opened: RunFolder) -> None:
        cascade_from_dict(opened.load("designs", "final"))

    def watched(opened: RunFolder) -> None:
        store.by_day(opened.path)
        {(entry["date_s"], entry["error_over_noise"]) for entry in store.entries(opened.path)}

    def yaml(data: Mapping[str, Any]) -> bytes:
        return to_yaml(data).encode()

    def shipped(kind: str, name: str) -> bytes:
        return find_config(kind, name).read_bytes()

    results = {
        f"result {name}": Parser(
            f"{name}.yaml",
            yaml(data),
            in_run(f"results/{name}.yaml", lambda o, name=name: o.load_result(name)),
            within=True,  # type: ignore[misc]
        )
        for name, data in RESULTS.items()
    }
    found = results | {
        "recording": Parser("frf_1.csv", recording_text().encode(), load_recording),
        "broken-off recording": Parser("frf_1.csv.part", recording_text().encode(), load_recording),
        "sidecar": Parser("frf_1.yaml", SIDECAR.encode(), load_sidecar),
        "axis": Parser("fuzzed.yaml", shipped("axes", "egc-70-600"), lambda p: load_axis(str(p))),
        "plant": Parser("fuzzed.yaml", shipped("plants", "egc_70"), lambda p: load_plant(str(p))),
        "model": Parser("fuzzed.yaml", shipped("plants", "g_a") + COVARIANCE, load_model),
        "drive profile": Parser("fuzzed.yaml", shipped("drives", "cmmp-as"), lambda p: load_profile.__wrapped__(str(p))),
        "study": Parser("fuzzed.yaml", shipped("studies", "tolerances"), load_study),
        "plan": Parser("fuzzed.yaml", PLAN.encode(), load_plan),
        "any settings": Parser("fuzzed.yaml", SIDECAR.encode() + PLAN.encode(), read_yaml),
        "move": Parser("move.csv", move.encode(), lambda p: load_move(p, 1e-3, whole)),
        "response": Parser("response.npz", (folder / "response.npz").read_bytes(), FrequencyResponse.load),
        "kept": Parser("fuzzed.json", json.dumps(DESIGN).encode(), valued(read_json)),
        "kept answer": Parser(
            "a.json",
            json.dumps({"key": "k", "data": {"pictures": []}, "text": ["x", ["a", ["b"], [0], True]], "exit_code": 0}).encode(),
            in_run("kept/a.json", lambda opened: kept_or_new(opened, "a", (), result)),
            within=True,
        ),
        "run": Parser("run.yaml", (run.path / "run.yaml").read_bytes(), in_run("run.yaml", claimed), within=True),
        "backup": Parser("backup.yaml", yaml(BACKUP), in_run("results/backup.yaml", lambda o: backups.choose_backup(o, None)), within=True),
        "design": Parser("final.yaml", yaml(DESIGN), in_run("designs/final.yaml", design), within=True),
        "drive": Parser(
            "drive.yaml",
            yaml({"name": "x", "structure": STRUCTURE, "counts_per_rev": 65536, "peak_torque_nm": 3.1}),
            in_run("results/drive.yaml", lambda o: structure_from_dict(o.load_result("drive") or {})),
            within=True,
        ),
        "calibration": Parser("fuzzed.yaml", CALIBRATION.encode(), lambda p: _calibration_from_dict(read_yaml(p, DataError), p)),
        "revisions": Parser("revisions.yaml", REVISIONS.encode(), in_run("results/ladder.yaml", revisions), within=True),
        "object file": Parser("fuzzed.eds", EDS.encode(), load_object_file),
        "dbc": Parser("fuzzed.dbc", DBC.encode(), of_dbc, apart=True),
        "mapping": Parser("fuzzed.map", b"# t_s\ntorque_nm=Iq*0.65\nposition_rad=enc*rev/65536+0.3\n", lambda p: mappings_in(read_text(p))),
        "foreign text": Parser("fuzzed.csv", foreign.encode(), foreign_file),
        "foreign text, packed": Parser("fuzzed.csv.gz", gzip.compress(foreign.encode()), foreign_file),
        "members": Parser("members.jsonl", MEMBERS.encode(), _read_members),
        "journal": Parser("journal.txt", b"2026-01-01 00:00:00  identify: begun\n", lambda p: lines_of(p.parent)),
        "events": Parser("events.jsonl", b'{"at": "", "event": "note"}\n' * 3, lambda p: events_of(p.parent)),
        "watched moves": Parser("moves.jsonl", WATCHED.encode(), in_run("watch/moves.jsonl", watched), within=True),
        "signal by hand": Parser("signal.txt", b"6064h=181:0:i32", lambda p: by_hand(p.read_text("utf-8", "replace")), within=True),
        **{
            f"frames {ending}": Parser(f"fuzzed.{ending}", frames[ending], foreign_file, apart=ending in {"blf", "trc"})
            for ending in frames
        },
        "matlab 5": Parser("fuzzed.mat", write_v5(folder / "5.mat", value).read_bytes(), foreign_file, apart=True),
        "matlab 7.3": Parser("fuzzed.mat", write_v73(folder / "7.mat", value).read_bytes(), foreign_file, apart=True),
        "hdf5": Parser("fuzzed.h5", (folder / "a.h5").read_bytes(), foreign_file, apart=True),
        "npz": Parser("fuzzed.npz", (folder / "a.npz").read_bytes(), foreign_file, apart=True),
        "npy": Parser("fuzzed.npy", (folder / "a.npy").read_bytes(), foreign_file, apart=True),
    }
    try:
        import asammdf

        with asammdf.MDF(version="4.10") as mdf:
            mdf.append(
                [asammdf.Signal(value["t"], value["t"], unit="Nm", name="Torque"), asammdf.Signal(value["t"], value["t"], name="Angle")]
            )
            mdf.save(folder / "a.mf4")
        found["mdf"] = Parser("fuzzed.mf4", (folder / "a.mf4").read_bytes(), foreign_file, apart=True)
        found["reader of mdf"] = Parser("fuzzed.mf4", found["mdf"].good, inside("mdf"))
    except ImportError:
        pass
    kinds: dict[str, Kind] = {
        "matlab 5": "matlab",
        "matlab 7.3": "matlab",
        "hdf5": "hdf5",
        "npz": "numpy",
        "npy": "numpy",
        "frames blf": "blf",
        "frames trc": "trc",
        "dbc": "dbc",
    }
    for word, kind in kinds.items():
        found[f"reader of {word}"] = Parser(found[word].name, found[word].good, inside(kind))
    return found


def valued(load: Callable[[Path], object]) -> Callable[[Path], object]:
    """A reader that tells by ValueError, as one that refuses."""

    def loaded(path: Path) -> object:
        try:
            return load(path)
        except ValueError as error:
            raise BeltcommError(f"{path}: {error}") from error

    return loaded


def result() -> Any:
    from beltcomm.result import Result

    return Result({}, ["x"])


def damaged(draw: np.random.Generator, good: bytes, others: list[bytes]) -> bytes:
    """A file that somebody may give: damaged bytes, a piece many times, part of another kind of file, or noise."""
    if good[:2] == b"\x1f\x8b" and draw.random() < 0.7:  # what is packed, damaged before it was
        return gzip.compress(damaged(draw, gzip.decompress(good), others))
    kind = int(draw.integers(20))
    if kind == 0:
        return draw.bytes(int(draw.integers(0, 400)))
    if kind == 1:
        other = others[int(draw.integers(len(others)))]
        at, there = int(draw.integers(len(good) + 1)), int(draw.integers(len(other) + 1))
        return good[:at] + other[there : there + 4000]
    if kind == 2:
        at = int(draw.integers(len(good) + 1))
        piece = good[at : at + int(draw.integers(1, 60))] or b"["
        return good[:at] + piece * int(10 ** draw.uniform(1.0, 4.0)) + good[at:]
    if kind < 8:
        changed = bytearray(good)
        for place in draw.integers(0, max(len(good), 1), int(draw.integers(1, 9))):
            if len(changed):
                changed[place] = int(draw.integers(256))
        return bytes(changed)
    return mutated(draw, good)


def case(parser: Parser, content: bytes, folder: Path) -> tuple[str, str]:
    """What a parser does with a file: one of OUTCOMES, and the words."""
    path = folder / parser.name
    path.write_bytes(content)
    random.seed(0)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            parser.load(path)
    except BeltcommError as error:
        return ("refused" if parser.within or path.stem.split(".")[0] in str(error) else "unnamed"), str(error)
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)
        own = next((f for f in reversed(where) if "beltcomm" in f.filename), where[-1])
        return "traceback", f"{type(error).__name__}: {str(error)[:120]} in {Path(own.filename).name}:{own.lineno}"
    return "fine", ""


EDS = """[FileInfo]
FileName=a.eds
[DeviceInfo]
VendorName=x
VendorNumber=0x1D
[MandatoryObjects]
SupportedObjects=2
1=0x1000
2=0x6040
[1000]
ParameterName=Device type
ObjectType=0x7
DataType=0x0007
AccessType=ro
DefaultValue=0x20192
[6040]
ParameterName=Controlword
ObjectType=0x7
DataType=0x0006
AccessType=rww
DefaultValue=$NODEID+0x10
LowLimit=0
HighLimit=0xFFFF
"""
