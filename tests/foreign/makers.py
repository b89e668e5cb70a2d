"""One measurement as loggers, scopes, drives and programs write it: each maker gives the file's name and its bytes.

Formats are those of the makers' descriptions; the numbers are :func:`motion`'s.  Nothing here is copied from a file of anybody's.
"""

from __future__ import annotations

import gzip
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


def _mat(path: Path) -> None:
    from scipy.io import savemat

    inside = {"time": T, "torque": TORQUE, "position": ANGLE, "units": {"torque": "Nm", "position": "rad"}}
    savemat(path, {"log": inside, "J": 1.23e-4, "Kt": 0.065})


def _mat_table(path: Path, version: str, timed: bool) -> None:
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


def _mat_timeseries(path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from matio import save_to_mat
        from matio.utils import MatlabOpaque

        def series(values: Array) -> Any:
            return MatlabOpaque(properties={"Data_": values[:, None], "Time_": T[:, None], "Name": "x"}, classname="timeseries")

        save_to_mat(str(path), {"torque_nm": series(TORQUE), "position_rad": series(ANGLE)}, version="v7")


def _hdf5(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name, values, unit in (("time", T, "s"), ("torque", TORQUE, "Nm"), ("position", ANGLE, "rad")):
            file.create_dataset(name, data=values).attrs["unit"] = unit


def _tdms(path: Path) -> None:
    from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter

    with TdmsWriter(str(path)) as writer:
        channels = [
            ChannelObject("Axis", name, values, properties={"unit_string": unit, "wf_increment": PERIOD_S, "wf_start_offset": 0.0})
            for name, values, unit in (("Torque", TORQUE, "Nm"), ("Position", ANGLE, "rad"))
        ]
        writer.write_segment([RootObject(properties={"name": "bench"}), GroupObject("Axis"), *channels])


def _mcap(path: Path) -> None:
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


def _mdf(path: Path) -> None:
    import asammdf

    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(TORQUE, T, unit="Nm", name="Torque"), asammdf.Signal(ANGLE, T, unit="rad", name="Position")])
        file.save(path, overwrite=True)


def _zip(path: Path, names: Sequence[str]) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        for name in names:
            archive.writestr(name, "<x/>")


def _database(path: Path) -> None:
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


SURE = ("--map", "torque_nm=c2", "--map", "position_rad=c3")
SLOW = ANGLE[::5]
KINDS: list[Kind] = [
    Kind("CSV", put("a.csv", plain())),
    Kind("CSV, packed", put("a.csv.gz", gzip.compress(plain().encode()))),
    Kind(
        "German CSV, semicolon, decimal comma",
        put("a.csv", table("Zeit [s];Drehmoment [Nm];Lage [rad]", (T, TORQUE, ANGLE), ";", comma=True), "cp1252"),
    ),
    Kind(
        "Unicode text of a spreadsheet (UTF-16, tabs)",
        put("a.txt", table("Time [s]\tTorque [Nm]\tPosition [°]", (T, TORQUE, np.degrees(ANGLE)), "\t"), "utf-16"),
        tolerance=1e-5,
    ),
    Kind(
        "decimal comma, thousands points",
        put(
            "a.csv",
            "Zeit [s];Drehmoment [mNm];Lage [°]\n"
            + "".join(
                f"{t:.3f};{grouped(1e3 * a, '.', ',')};{grouped(1e2 * math.degrees(b), '.', ',', 4)}\n".replace(
                    f"{t:.3f}", f"{t:.3f}".replace(".", ",")
                )
                for t, a, b in zip(T, TORQUE, ANGLE, strict=True)
            ),
        ),
        ("--map", "position_rad=Lage*0.01deg"),
        shown="thousands parted",
    ),
    Kind(
        "US CSV, thousands in quotes",
        put(
            "a.csv",
            "Time [s],Torque [mNm],Position [deg]\n"
            + "".join(
                f'{t:.3f},"{grouped(1e3 * a, ",", ".")}","{grouped(1e2 * math.degrees(b), ",", ".", 4)}"\n'
                for t, a, b in zip(T, TORQUE, ANGLE, strict=True)
            ),
        ),
        ("--map", "position_rad=Position*0.01deg"),
    ),
    Kind(
        "a remark beside a row and one between",
        put(
            "a.csv",
            plain()
            .replace("\n0.300000", "\nthe axis was touched\n0.300000")
            .replace("\n0.500", "\n0.500", 1)
            .replace(f"{ANGLE[700]:.6f}\n0.701", f"{ANGLE[700]:.6f},noise outside\n0.701"),
        ),
        shown="2 remarks in the rows",
    ),
    Kind("a table by R, rows begin with their number", put("a.txt", r_table())),
    Kind("pandas with an index", put("a.csv", table(",t_s,torque_nm,position_rad", (np.arange(ROWS), T, TORQUE, ANGLE)))),
    Kind(
        "TwinCAT 2 Scope, a time for each channel",
        put("scope.csv", twincat([("fTorque", "Nm", TORQUE, 1e-3), ("fActPos", "rad", ANGLE, 1e-3)], comma=True, old=True)),
    ),
    Kind(
        "TwinCAT 3 Scope, one sample time",
        put("scope.csv", twincat([("fTorque", "Nm", TORQUE, 1e-3), ("fActPos", "rad", ANGLE, 1e-3)], comma=False)),
    ),
    Kind(
        "TwinCAT 3 Scope, two sample times",
        put("scope.csv", twincat([("fTorque", "Nm", TORQUE, 1e-3), ("fActPos", "rad", ANGLE[::2], 2e-3)], comma=True)),
        rows=slice(None, None, 2),
        tolerance=1e-2,
    ),
    Kind(
        "TwinCAT 3 Scope, full time stamps",
        put("scope.csv", twincat([("fTorque", "Nm", TORQUE, 1e-3), ("fActPos", "rad", ANGLE, 1e-3)], comma=False, filetime=True)),
    ),
    Kind("LabVIEW .lvm without a time column", put("a.lvm", labview("No"))),
    Kind("LabVIEW .lvm, one time column, a remark", put("a.lvm", labview("One", remark=True)), shown="the axis was touched"),
    Kind("LabVIEW .lvm, a time for each, decimal comma", put("a.lvm", labview("Multi", comma=True))),
    Kind(
        "Tektronix MSO CSV",
        put(
            "tek000.csv",
            "Model,MSO54\nFirmware Version,1.44.3\n\nPoint Format,Y\nHorizontal Units,s\nHorizontal Scale,0.12\nSample Interval,0.001\n"
            f"Record Length,{ROWS}\nZero Index,0\nVertical Units,Nm,rad\nLabels,,\n" + table("TIME,CH1,CH2", (T, TORQUE, ANGLE)),
        ),
        SURE,
    ),
    Kind(
        "Rigol CSV, start and increment in the header",
        put(
            "a.csv",
            table(
                "X,CH1,CH2,Start,Increment\nSequence,Volt,Volt,0.000000e+00,1.000000e-03",
                (np.arange(ROWS), TORQUE, ANGLE, [""] * ROWS, [""] * ROWS),
            ),
        ),
        SURE,
    ),
    Kind(
        "PicoScope CSV",
        put("a.csv", table("Time,Channel A,Channel B\n(ms),(V),(V)\n", (1e3 * T, TORQUE, ANGLE))),
        ("--map", "torque_nm=c2*1", "--map", "position_rad=c3*1"),
    ),
    Kind(
        "Keysight CSV",
        put("a.csv", table("x-axis,1,2\nsecond,Volt,Volt", (T, TORQUE, ANGLE))),
        ("--map", "t_s=c1*1", "--map", "torque_nm=c2*1", "--map", "position_rad=c3*1"),
    ),
    Kind(
        "Yokogawa CSV, resolution in a block",
        put(
            "a.csv",
            f'"Model","DL850"\n"BlockNumber",1\n"TraceName","Torque","Position"\n"BlockSize",{ROWS},{ROWS}\n"VUnit","Nm","rad"\n"HResolution",0.001,0.001\n"HOffset",0,0\n"HUnit","s","s"\n\n'
            + table("", ([""] * ROWS, TORQUE, ANGLE)),
        ),
    ),
    Kind(
        "a drive's trace, sample time above",
        put(
            "trace.csv",
            "Drive trace 7\nDevice;S120\nSampling period [ms];1\nTrigger;none\n\n"
            + table("r80 Torque actual value [Nm];r482 Position actual value [rad]", (TORQUE, ANGLE), ";", comma=True),
        ),
    ),
    Kind(
        "a drive's trace, names and units in a block",
        put(
            "trace.txt",
            table("Signal\tTorque\tPosition\nUnit\tNm\trad\n", (1e3 * T, TORQUE, ANGLE), "\t").replace("Signal\t", "Signal\t", 1),
        ),
        ("--map", "t_s=c1*ms"),
    ),
    Kind(
        "German dates",
        put(
            "a.csv",
            table(
                "Datum;Drehmoment [Nm];Lage [rad]",
                (dates("%d.%m.%Y %H:%M:%S,%L", "2024-05-03T14:02:11.204"), TORQUE, ANGLE),
                ";",
                comma=True,
            ),
        ),
        ("--map", "t_s=Datum"),
    ),
    Kind(
        "US dates, past midnight",
        put(
            "a.csv", table("Time,Torque [Nm],Position [rad]", (dates("%m/%d/%Y %I:%M:%S.%L %p", "2024-05-03T23:59:59.500"), TORQUE, ANGLE))
        ),
    ),
    Kind(
        "times of day, past midnight",
        put("a.csv", table("Time,Torque [Nm],Position [rad]", (dates("%H:%M:%S.%f", "2024-05-03T23:59:59.500"), TORQUE, ANGLE))),
        shown="passes midnight 1 times",
    ),
    Kind(
        "ISO dates in nanoseconds",
        put(
            "a.csv",
            table(
                "timestamp,Torque [Nm],Position [rad]",
                (
                    [str(np.datetime64("2024-05-03T14:02:11", "ns") + np.timedelta64(1_000_000 * k, "ns")) for k in range(ROWS)],
                    TORQUE,
                    ANGLE,
                ),
            ),
        ),
    ),
    Kind(
        "nanoseconds since 1970",
        put(
            "a.csv",
            table(
                "time [ns],Torque [Nm],Position [rad]", ([1_714_737_600_000_000_000 + 1_000_000 * k for k in range(ROWS)], TORQUE, ANGLE)
            ),
        ),
    ),
    Kind(
        "stamps in single precision",
        put("a.npz", numpy_bytes(t_s=np.float32(2000.0 + T), torque_nm=TORQUE, position_rad=ANGLE)),
        shown="single-precision numbers",
        tolerance=1e-3,
    ),
    Kind(
        "a position in every fifth row",
        put(
            "a.csv",
            table("time [s],Torque [Nm],Position [rad]", (T, TORQUE, [f"{ANGLE[k]:.6f}" if k % 5 == 0 else "" for k in range(ROWS)])),
        ),
        rows=slice(None, None, 5),
        tolerance=5e-2,
    ),
    Kind(
        "a long table",
        put("a.csv", table("time [s];signal;value;unit", tuple(zip(*long_rows(), strict=True)), ";")),
        rows=slice(None, None, 2),
        tolerance=1e-2,
    ),
    Kind(
        "a long table by WinCC",
        put("log0.csv", wincc()),
        ("--map", "torque_nm=axis.torque*1", "--map", "position_rad=axis.position*1"),
        rows=slice(None, None, 2),
        tolerance=1e-2,
    ),
    Kind(
        "a long table by InfluxDB",
        put("a.csv", influx()),
        ("--map", "torque_nm=torque*1", "--map", "position_rad=position*1"),
        rows=slice(None, None, 2),
        tolerance=1e-2,
    ),
    Kind("MATLAB, a structure", binary("a.mat", _mat), shown="--set motor.inertia_kg_m2=0.000123"),
    Kind("MATLAB, a structure, named .dat", binary("a.dat", _mat)),
    Kind("MATLAB 7, a timetable", binary("a.mat", lambda path: _mat_table(path, "v7", timed=True))),
    Kind("MATLAB 7.3, a table", binary("a.mat", lambda path: _mat_table(path, "v7.3", timed=False))),
    Kind("MATLAB, objects timeseries", binary("a.mat", _mat_timeseries)),
    Kind("HDF5", binary("a.h5", _hdf5)),
    Kind("NumPy .npz", put("a.npz", numpy_bytes(t_s=T, torque_nm=TORQUE, position_rad=ANGLE))),
    Kind("MDF 4", binary("a.mf4", _mdf)),
    Kind("TDMS", binary("a.tdms", _tdms)),
    Kind("MCAP with JSON messages", binary("a.mcap", _mcap)),
    Kind("JSON, columns", put("a.json", json.dumps({"t_s": T.tolist(), "torque_nm": TORQUE.tolist(), "position_rad": ANGLE.tolist()}))),
    Kind("JSON, records", put("a.txt", json.dumps({"device": "x", "data": records()}))),
    Kind("JSON, a record on each line", put("a.jsonl", "\n".join(json.dumps(record) for record in records()))),
    # refused with what they are
    Kind(
        "a spreadsheet",
        binary("a.xlsx", lambda path: _zip(path, ["[Content_Types].xml", "xl/workbook.xml"])),
        says="is a spreadsheet; save its sheet as CSV",
    ),
    Kind(
        "a spreadsheet named .csv",
        binary("a.csv", lambda path: _zip(path, ["xl/workbook.xml"])),
        says="is a spreadsheet; save its sheet as CSV",
    ),
    Kind(
        "an old spreadsheet", put("a.xls", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600)), says="is an Office document of the old kind"
    ),
    Kind("an archive", binary("a.zip", lambda path: _zip(path, ["a.csv"])), says="is an archive; unpack it first"),
    Kind("Parquet", put("a.parquet", b"PAR1" + bytes(100) + b"PAR1"), says="is a Parquet file; write it as CSV"),
    Kind("a ROS 2 bag", binary("a.db3", _database), says="is a database (SQLite); export the signals as CSV"),
    Kind("a ROS 1 bag", put("a.bag", b"#ROSBAG V2.0\n" + bytes(100)), says="is a ROS 1 bag; open it in PlotJuggler"),
    Kind("a capture of EtherCAT", put("a.pcapng", b"\x0a\x0d\x0d\x0a" + bytes(100)), says="EtherCAT is not decoded"),
    Kind("a pickle", put("a.pkl", b"\x80\x04\x95" + bytes(20)), says="save the arrays with numpy.savez"),
    Kind("a PDF", put("a.pdf", b"%PDF-1.7\n1 0 obj\n"), says="is a PDF document"),
    Kind("a picture named .csv", put("a.csv", b"\x89PNG\r\n\x1a\n" + bytes(50)), says="is a picture"),
    Kind("a LeCroy waveform", put("C1.trc", b"#9000001234WAVEDESC" + bytes(100)), says="save the waveform as CSV on the instrument"),
    Kind("an XML document", put("a.xml", '<?xml version="1.0"?>\n<Scope><Channel/></Scope>\n'), says="is an XML document"),
    Kind("a Dewesoft file", put("a.dxd", b"DEWE\0\0\0\0" + bytes(100)), says="is a Dewesoft file; export the signals as CSV in DewesoftX"),
    Kind(
        "a DBC file",
        put("a.dbc", 'VERSION "1"\n\nBO_ 385 TPDO1: 8 Drive\n SG_ pos : 0|32@1- (1,0) [0|0] "" X\n'),
        says="give the log itself, and this with --dbc",
    ),
    Kind(
        "a letter",
        put("a.txt", "Dear colleague,\n\nthe axis squeaks since Monday, please have a look.\nIt does so at night as well.\n\nYours\n"),
        says="is no table of numbers",
    ),
]
