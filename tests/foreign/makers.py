"""One measurement as loggers, scopes, drives and programs write it: each maker gives the file's name and its bytes.

Formats are those of the makers' descriptions; the numbers are :func:`motion`'s.  Nothing here is copied from a file of anybody's.
"""

from __future__ import annotations

import io
import json
import math
import sqlite3
import warnings
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ROWS, PERIOD_S = 1200, 1e-3


def motion(rows: int = ROWS, period: float = PERIOD_S) -> tuple[Array, Array, Array, Array]:
    """Time, torque (N m), angle (rad), speed (rad/s) of a motor that swings: inertia 1e-3 kg m², friction 0.2 N m."""
    t = period * np.arange(rows)
    speed = 20.0 * math.pi * np.sin(1.4 * math.pi * t)
    torque = 1e-3 * np.gradient(speed, period) + 0.2 * np.sign(speed) + np.random.default_rng(1).normal(0.0, 5e-3, rows)
    return t, np.round(torque, 6), np.round(np.cumsum(speed) * period, 6), np.round(speed, 6)


T, TORQUE, ANGLE, SPEED = motion()


@dataclass(frozen=True)
class Kind:
    """One kind of file.   make : writes it into a folder and gives its path.   words : options of ``beltcomm import``.

    says : a sentence that must stand in the refusal, "" when it must be read.   tolerance : of torque and angle, beside the digits written.
    moves : of a log of frames, how many.   shown : what the output must hold.
    """

    name: str
    make: Callable[[Path], Path]
    words: tuple[str, ...] = ()
    says: str = ""
    tolerance: float = 2e-6
    shown: str = ""
    rows: slice = field(default_factory=lambda: slice(None))


def put(name: str, content: str | bytes, encoding: str = "utf-8") -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode(encoding))
        return folder / name

    return make


def table(
    header: str, columns: Sequence[Sequence[object]], mark: str = ",", *, comma: bool = False, digits: int = 6, end: str = "\n"
) -> str:
    """Rows of numbers below a header; whole numbers stay whole."""

    def cell(value: object) -> str:
        if isinstance(value, str):
            return value
        text = f"{value}" if isinstance(value, (int, np.integer)) else f"{value:.{digits}f}"
        return text.replace(".", ",") if comma else text

    rows = [mark.join(cell(value) for value in row) for row in zip(*columns, strict=True)]
    return header + ("\n" if header else "") + end.join(rows) + end


def grouped(value: float, thousands: str, decimal: str, digits: int = 3) -> str:
    return f"{value:,.{digits}f}".replace(",", "T").replace(".", decimal).replace("T", thousands)


def twincat(channels: Sequence[tuple[str, str, Array, float]], *, comma: bool, filetime: bool = False, old: bool = False) -> str:
    """TwinCAT Scope: each channel's properties in a block, one time column per sample time (old: per channel)."""
    blocks: list[list[tuple[str, str, Array, float]]] = []
    for channel in channels:
        if blocks and not old and blocks[-1][0][3] == channel[3]:
            blocks[-1].append(channel)
        else:
            blocks.append([channel])

    def number(value: float, digits: int = 6) -> str:
        text = f"{value:.{digits}f}".rstrip("0").rstrip(".")
        return text.replace(".", ",") if comma else text

    def line(key: str, value: Callable[[tuple[str, str, Array, float]], str]) -> str:
        return "\t".join("\t".join([key, *(value(channel) for channel in block)]) for block in blocks)

    first = 132959733843760000
    head = [
        "Name\tscope_axis_1", "File\tscope_axis_1.csv", f"Starttime of export\t{first}\tMontag, 2. Mai 2022\t15:56:24.376",
        f"Endtime of export\t{first + 12000000}\tMontag, 2. Mai 2022\t15:56:25.576", "", "",
        line("Name", lambda c: c[0]), line("SymbolComment", lambda c: ""), line("Data-Type", lambda c: "REAL64"),
        line("SampleTime[ms]", lambda c: number(1e3 * c[3])), line("VariableSize", lambda c: "8"), line("SymbolBased", lambda c: "True"),
        line("IndexGroup", lambda c: "16448"), line("IndexOffset", lambda c: "385000"), line("SymbolName", lambda c: f"MAIN.{c[0]}"),
        line("NetID", lambda c: "192.168.178.20.1.1"), line("Port", lambda c: "851"), line("Offset", lambda c: "0"),
        line("ScaleFactor", lambda c: "1"), line("BitMask", lambda c: "0xFFFFFFFFFFFFFFFF"), line("Unit", lambda c: c[1]), "",
    ]  # fmt: skip
    rows = []
    for k in range(max(len(channel[2]) for channel in channels)):
        cells = []
        for block in blocks:
            there = k < len(block[0][2])
            stamp = str(first + round(k * block[0][3] * 1e7)) if filetime else number(k * 1e3 * block[0][3])
            cells += [stamp if there else "", *(number(channel[2][k]) if there else "" for channel in block)]
        rows.append("\t".join(cells))
    return "\n".join([*head, *rows, "EOF"]) + "\n"


def labview(x_columns: str, *, comma: bool = False, remark: bool = False) -> str:
    """LabVIEW .lvm: two headers, names with a comment column that rows seldom have."""
    names = ["Torque", "Position"]
    data = [TORQUE, ANGLE]
    head = [
        "LabVIEW Measurement\t", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab", f"Decimal_Separator\t{',' if comma else '.'}",
        "Multi_Headings\tNo", f"X_Columns\t{x_columns}", "Time_Pref\tRelative", "Operator\tnobody", "Date\t2024/05/03",
        "Time\t14:02:11.204", "***End_of_Header***\t", "\t", "Channels\t2\t\t", f"Samples\t{ROWS}\t{ROWS}\t",
        "Date\t2024/05/03\t2024/05/03\t",
        "Time\t14:02:11.204\t14:02:11.204\t", "Y_Unit_Label\tN*m\trad\t", "X_Dimension\tTime\tTime\t",
        "X0\t0.0000000000000000E+0\t0.0000000000000000E+0\t", "Delta_X\t0.001000\t0.001000\t", "***End_of_Header***\t\t\t",
    ]  # fmt: skip
    if x_columns == "Multi":
        head.append("X_Value\tTorque\tX_Value\tPosition\tComment")
        rows = [f"{t:.6f}\t{a:.6f}\t{t:.6f}\t{b:.6f}" for t, a, b in zip(T, *data, strict=True)]
    else:
        head.append("X_Value\t" + "\t".join(names) + "\tComment")
        rows = [f"{f'{t:.6f}' if x_columns == 'One' else ''}\t{a:.6f}\t{b:.6f}" for t, a, b in zip(T, *data, strict=True)]
    if remark:
        rows[300] += "\tthe axis was touched"
    text = "\n".join([*head, *rows]) + "\n"
    return text.replace(".", ",") if comma else text


def dates(pattern: str, start: str) -> list[str]:
    """Stamps of the rows as text: strftime with %f in microseconds, %L milliseconds."""
    first = np.datetime64(start, "us")
    found = []
    for k in range(ROWS):
        stamp = (first + np.timedelta64(1000 * k, "us")).item()
        found.append(stamp.strftime(pattern.replace("%L", f"{stamp.microsecond // 1000:03d}")))
    return found


def long_rows() -> list[tuple[float, str, float, str]]:
    """Each signal with its own raster, torque every 1 ms, angle every 2 ms, mixed as they come."""
    rows = [(t, "axis.torque", v, "Nm") for t, v in zip(T, TORQUE, strict=True)]
    rows += [(t, "axis.position", v, "rad") for t, v in zip(T[::2], ANGLE[::2], strict=True)]
    rows += [(t, "temperature", 31.5 + 0.01 * k, "degC") for k, t in enumerate(T[::100])]
    return sorted(rows, key=lambda row: row[0])


def wincc() -> str:
    """Values below each other; the date has whole seconds, and the time in millionths of a day tells the rest."""
    lines = ['"VarName";"TimeString";"VarValue";"Validity";"Time_ms"']
    for t, name, value, _ in long_rows():
        stamp = (np.datetime64("2024-05-03T23:59:59.500000") + np.timedelta64(round(1e6 * t), "us")).item()
        day = f"{(45415.0 + (86399.5 + t) / 86400.0) * 1e6:.4f}".replace(".", ",")
        number = f"{value:.6f}".replace(".", ",")
        lines.append(f'"{name}";"{stamp:%d.%m.%Y %H:%M:%S}";{number};1;{day}')
    return "\n".join(lines) + "\n"


def influx() -> str:
    lines = ["#group,false,false,true,true,false,false,true,true",
             "#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,dateTime:RFC3339,double,string,string",
             "#default,_result,,,,,,,", ",result,table,_start,_stop,_time,_value,_field,_measurement"]  # fmt: skip
    for number, signal in enumerate(("position", "torque")):
        for t, name, value, _ in long_rows():
            if name.endswith(signal):
                stamp = np.datetime_as_string(np.datetime64("2024-05-03T12:00:00", "ns") + np.timedelta64(round(1e9 * t), "ns"))
                lines.append(f",,{number},2024-05-03T00:00:00Z,2024-05-04T00:00:00Z,{stamp}Z,{value:.6f},{signal},axis")
    return "\n".join(lines) + "\n"


def r_table() -> str:
    rows = [f'"{k + 1}" {t:.6f} {a:.6f} {b:.6f}' for k, (t, a, b) in enumerate(zip(T, TORQUE, ANGLE, strict=True))]
    return "\n".join(['"time_s" "torque_nm" "position_rad"', *rows]) + "\n"


def binary(name: str, write: Callable[[Path], object]) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        write(folder / name)
        return folder / name

    return make


def mat_file(path: Path) -> None:
    from scipy.io import savemat

    inside = {"time": T, "torque": TORQUE, "position": ANGLE, "units": {"torque": "Nm", "position": "rad"}}
    savemat(path, {"log": inside, "J": 1.23e-4, "Kt": 0.065})


def mat_table_file(path: Path, version: str, timed: bool) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import pandas
        from matio import save_to_mat

        frame = pandas.DataFrame({"torque_nm": TORQUE, "position_rad": ANGLE})
        if timed:
            frame.index = pandas.Index(np.round(T * 1e6).astype("timedelta64[us]"), name="Time")
        else:
            frame.insert(0, "t_s", T)
        save_to_mat(str(path), {"measured": frame}, version=version)


def mat_timeseries_file(path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from matio import save_to_mat
        from matio.utils import MatlabOpaque

        def series(values: Array) -> Any:
            return MatlabOpaque(properties={"Data_": values[:, None], "Time_": T[:, None], "Name": "x"}, classname="timeseries")

        save_to_mat(str(path), {"torque_nm": series(TORQUE), "position_rad": series(ANGLE)}, version="v7")


def hdf5_file(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name, values, unit in (("time", T, "s"), ("torque", TORQUE, "Nm"), ("position", ANGLE, "rad")):
            file.create_dataset(name, data=values).attrs["unit"] = unit


def tdms_file(path: Path) -> None:
    from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter

    with TdmsWriter(str(path)) as writer:
        channels = [
            ChannelObject("Axis", name, values, properties={"unit_string": unit, "wf_increment": PERIOD_S, "wf_start_offset": 0.0})
            for name, values, unit in (("Torque", TORQUE, "Nm"), ("Position", ANGLE, "rad"))
        ]
        writer.write_segment([RootObject(properties={"name": "bench"}), GroupObject("Axis"), *channels])


def mcap_file(path: Path) -> None:
    from mcap.writer import Writer

    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("JointState", "jsonschema", json.dumps({"type": "object"}).encode())
        channel = writer.register_channel("/joint_states", "json", schema)
        for k, (a, b) in enumerate(zip(TORQUE, ANGLE, strict=True)):
            stamp = 1_714_737_600_000_000_000 + k * 1_000_000
            writer.add_message(channel, stamp, json.dumps({"torque_nm": a, "position_rad": b, "name": "x"}).encode(), stamp, k)
        writer.finish()


def mdf_file(path: Path) -> None:
    import asammdf

    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(TORQUE, T, unit="Nm", name="Torque"), asammdf.Signal(ANGLE, T, unit="rad", name="Position")])
        file.save(path, overwrite=True)


def zip_file(path: Path, names: Sequence[str]) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        for name in names:
            archive.writestr(name, "<x/>")


def database_file(path: Path) -> None:
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT)")


def records() -> list[dict[str, float]]:
    return [{"t_s": float(t), "torque_nm": float(a), "position_rad": float(b)} for t, a, b in zip(T, TORQUE, ANGLE, strict=True)]


def numpy_bytes(**arrays: Array) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def plain() -> str:
    return table("t_s,torque_nm,position_rad", (T, TORQUE, ANGLE))
