"""The kinds of file that an import meets, each made by :mod:`foreign.makers`: read, or refused with a sentence."""

from __future__ import annotations

import gzip
import json
import math

import numpy as np

from foreign.makers import (
    ANGLE,
    ROWS,
    TORQUE,
    Kind,
    T,
    binary,
    dates,
    grouped,
    hdf5_file,
    influx,
    labview,
    long_rows,
    mat_file,
    mat_table_file,
    mat_timeseries_file,
    mcap_file,
    mdf_file,
    numpy_bytes,
    plain,
    put,
    r_table,
    records,
    table,
    tdms_file,
    twincat,
    wincc,
)
from foreign.refused_kinds import REFUSED

SURE = ("--map", "torque_nm=c2", "--map", "position_rad=c3")
SLOW = ANGLE[::5]
EPOCH_NS = 1_714_737_600_000_000_000
KINDS: list[Kind] = [
    *REFUSED,
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
        "UTF-16 without its mark, bars, Swiss thousands, a printed minus",
        put(
            "a.txt",
            "Zeit [s]|Drehmoment [mNm]|Lage [rad]\n"
            + "".join(
                f"{t:.3f}|{grouped(1e3 * a, chr(39), '.')}|{b:.6f}\n".replace("-", chr(0x2212))
                for t, a, b in zip(T, TORQUE, ANGLE, strict=True)
            ),
            "utf-16-le",
        ),
        shown="separated by bar",
    ),
    Kind(
        "DIN names, a temperature with holes",
        put(
            "a.csv",
            table(
                "t / s;Drehmoment / N·m;Lage / rad;Temperatur / °C",
                (T, TORQUE, ANGLE, [f"{20 + 0.001 * k:.3f}" if k % 7 else "" for k in range(ROWS)]),
                ";",
            ).replace(".", ","),
        ),
        shown="temperature_c has no value in 172 of 1200 rows and is left out",
    ),
    Kind(
        "US CSV, pounds and inches",
        put("a.csv", table("Time (s),Torque (lbf-in),Position (deg)", (T, TORQUE / 0.112984829, np.degrees(ANGLE)), digits=8)),
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
        "US CSV, whole counts with thousands in quotes",
        put(
            "a.csv",
            "Time [ms],Torque [mNm],Position [inc]\n"
            + "".join(
                f'"{1e3 * t:,.1f}","{grouped(1e3 * a, ",", ".")}","{round(b / math.tau * 2**24):,d}"\n'
                for t, a, b in zip(T, TORQUE, ANGLE, strict=True)
            ),
        ),
        ("--map", "position_rad=Position*rev/16777216"),
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
        "Excel's sep=, German units below the names",
        put("a.csv", table("sep=;\nZeit;Ist-Moment;Ist-Position\ns;Nm;Grad", (T, TORQUE, np.degrees(ANGLE)), ";", comma=True), "cp1252"),
        tolerance=1e-5,
    ),
    Kind(
        "psql, a line below the names, a count at the end",
        put("a.txt", table(" t_s | torque_nm | position_rad \n-----+-----------+-----", (T, TORQUE, ANGLE), " | ") + "(1200 rows)\n"),
    ),
    Kind(
        "a microcontroller's counter of 32 bits",
        put(
            "a.csv",
            table("micros,torque [Nm],angle [rad]", ((np.round(1e6 * T).astype(np.int64) + 4_294_500_000) % 2**32, TORQUE, ANGLE)),
        ),
        ("--map", "t_s=micros*us"),
        shown="a counter of 32 bits that began anew 1 times: joined",
    ),
    Kind(
        "Kollmorgen WorkBench, Counts16Bit",
        put(
            "a.csv",
            table(
                "Kollmorgen WorkBench,2.22\nRecorder gap:,16,points:,1200\n\nTime (ms),IL.CMD (Arms),IL.FB (Arms),PL.FB (Counts16Bit)",
                (1e3 * T, 2.0 * TORQUE + 0.01, 2.0 * TORQUE, ANGLE / math.tau * 65536),
            ),
        ),
        ("--map", "torque_nm=IL.FB (Arms)*0.5"),
    ),
    Kind(
        "Fortran's doubles",
        put("a.dat", table("", (T, TORQUE, ANGLE), " ", digits=9).replace(" ", "D+00 ").replace("\n", "D+00\n")),
        (*SURE, "--map", "t_s=c1*s"),
    ),
    Kind(
        "a topic of ROS 1 as rostopic writes it",
        put(
            "a.csv",
            table(
                "%time,field.header.stamp,field.position0,field.effort0",
                (
                    1_714_737_600_000_000_000 + np.round(1e9 * T).astype(np.int64),
                    np.arange(ROWS) + 1_714_737_600_000_000_000,
                    ANGLE,
                    TORQUE,
                ),
            ),
        ),
        ("--map", "t_s=time*ns", "--map", "torque_nm=field.effort0*1", "--map", "position_rad=field.position0*1"),
    ),
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
        "TwinCAT 3 Scope, a signal ten times slower beside",
        put(
            "scope.csv",
            twincat(
                [("fTorque", "Nm", TORQUE, 1e-3), ("fActPos", "rad", ANGLE, 1e-3), ("Temp", "°C", 30.0 + 0.01 * T[::10], 1e-2)], comma=True
            ),
        ),
        shown="temperature_c is of another raster",
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
        "a long table, its time in ms by the name",
        put(
            "a.csv",
            table(
                "timestamp_ms;tag;value",
                tuple(zip(*((round(1e3 * t), name, value) for t, name, value, _ in long_rows()), strict=True)),
                ";",
            ),
        ),
        ("--map", "torque_nm=axis.torque*1", "--map", "position_rad=axis.position*1"),
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
    Kind("MATLAB, a structure", binary("a.mat", mat_file), shown="--set motor.inertia_kg_m2=0.000123"),
    Kind("MATLAB, a structure, named .dat", binary("a.dat", mat_file)),
    Kind("MATLAB 7, a timetable", binary("a.mat", lambda path: mat_table_file(path, "v7", timed=True))),
    Kind("MATLAB 7.3, a table", binary("a.mat", lambda path: mat_table_file(path, "v7.3", timed=False))),
    Kind("MATLAB, objects timeseries", binary("a.mat", mat_timeseries_file)),
    Kind("HDF5", binary("a.h5", hdf5_file)),
    Kind("NumPy .npz", put("a.npz", numpy_bytes(t_s=T, torque_nm=TORQUE, position_rad=ANGLE))),
    Kind("MDF 4", binary("a.mf4", mdf_file)),
    Kind("TDMS", binary("a.tdms", tdms_file)),
    Kind("MCAP with JSON messages", binary("a.mcap", mcap_file)),
    Kind("JSON, columns", put("a.json", json.dumps({"t_s": T.tolist(), "torque_nm": TORQUE.tolist(), "position_rad": ANGLE.tolist()}))),
    Kind(
        "JSON, signals with their units",
        put(
            "a.json",
            json.dumps(
                {
                    "t": T.tolist(),
                    "signals": [
                        {"name": "Torque", "unit": "mNm", "values": (1e3 * TORQUE).tolist()},
                        {"name": "Angle", "unit": "deg", "values": np.degrees(ANGLE).tolist()},
                    ],
                }
            ),
        ),
    ),
    Kind("JSON, records", put("a.txt", json.dumps({"device": "x", "data": records()}))),
    Kind("JSON, a record on each line", put("a.jsonl", "\n".join(json.dumps(record) for record in records()))),
    # refused with what they are
]
