"""Kinds of file that an import refuses, with the sentence."""

from __future__ import annotations

import numpy as np

from foreign.makers import ANGLE, TORQUE, Kind, T, binary, database_file, put, table, zip_file

REFUSED: list[Kind] = [
    Kind(
        "a spreadsheet",
        binary("a.xlsx", lambda path: zip_file(path, ["[Content_Types].xml", "xl/workbook.xml"])),
        says="is a spreadsheet; save its sheet as CSV",
    ),
    Kind(
        "a spreadsheet named .csv",
        binary("a.csv", lambda path: zip_file(path, ["xl/workbook.xml"])),
        says="is a spreadsheet; save its sheet as CSV",
    ),
    Kind(
        "an old spreadsheet", put("a.xls", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600)), says="is an Office document of the old kind"
    ),
    Kind("an archive", binary("a.zip", lambda path: zip_file(path, ["a.csv"])), says="is an archive; unpack it first"),
    Kind("Parquet", put("a.parquet", b"PAR1" + bytes(100) + b"PAR1"), says="is a Parquet file; write it as CSV"),
    Kind("a ROS 2 bag", binary("a.db3", database_file), says="is a database (SQLite); export the signals as CSV"),
    Kind("a ROS 1 bag", put("a.bag", b"#ROSBAG V2.0\n" + bytes(100)), says="is a ROS 1 bag; open it in PlotJuggler"),
    Kind("a capture of EtherCAT", put("a.pcapng", b"\x0a\x0d\x0d\x0a" + bytes(100)), says="EtherCAT is not decoded"),
    Kind("a pickle", put("a.pkl", b"\x80\x04\x95" + bytes(20)), says="save the arrays with numpy.savez"),
    Kind("a PDF", put("a.pdf", b"%PDF-1.7\n1 0 obj\n"), says="is a PDF document"),
    Kind("a picture named .csv", put("a.csv", b"\x89PNG\r\n\x1a\n" + bytes(50)), says="is a picture"),
    Kind("a LeCroy waveform", put("C1.trc", b"#9000001234WAVEDESC" + bytes(100)), says="save the waveform as CSV on the instrument"),
    Kind("an XML document", put("a.xml", '<?xml version="1.0"?>\n<Scope><Channel/></Scope>\n'), says="is an XML document"),
    Kind("a Dewesoft file", put("a.dxd", b"DEWE\0\0\0\0" + bytes(100)), says="is a Dewesoft file; export the signals as CSV in DewesoftX"),
    Kind(
        "signals in rows",
        put(
            "a.csv",
            "".join(f"{name},{','.join(f'{value:.6f}' for value in row)}\n" for name, row in (("t", T), ("M", TORQUE), ("x", ANGLE))),
        ),
        says="its signals lie in rows; transpose it",
    ),
    Kind(
        "units behind the numbers",
        put("a.csv", "t,M,x\n" + "".join(f"{t:.3f} s,{a:.6f} Nm,{b:.6f} rad\n" for t, a, b in zip(T, TORQUE, ANGLE, strict=True))),
        says="has units behind its numbers",
    ),
    Kind(
        "rows that changed places",
        put("a.csv", table("t_s,torque_nm,position_rad", (np.r_[T[:500], T[501], T[500], T[502:]], TORQUE, ANGLE))),
        says="1 rows stand out of their order, the first is row 502",
    ),
    Kind(
        "stamps in whole seconds, begun in the middle of one",
        put("a.csv", table("Time [s],Torque [Nm],Position [rad]", (np.floor(3.0 * T + 0.5), TORQUE, ANGLE))),
        says="if it was even, give --rate 333.333Hz",
    ),
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
