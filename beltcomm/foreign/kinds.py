"""Kind of a file by its content: the reader that it takes, or what it is called and how to get the signals out of it."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from typing import Final, Literal

from beltcomm.errors import DataError, UsageError
from beltcomm.foreign.textformat import wide_encoding
from beltcomm.outside import blocks, opened, unreadable

TableKind = Literal["text", "matlab", "hdf5", "mdf", "numpy", "tdms", "mcap", "json"]

#: Beginnings of files with a reader here.
_READ: Final[tuple[tuple[bytes, TableKind], ...]] = (
    (b"MATLAB 5.0 MAT-file", "matlab"),
    (b"MATLAB 7.3 MAT-file", "matlab"),
    (b"\x89HDF\r\n\x1a\n", "hdf5"),
    (b"MDF     ", "mdf"),
    (b"UnFinMF ", "mdf"),
    (b"\x93NUMPY", "numpy"),
    (b"TDSm", "tdms"),
    (b"\x89MCAP0\r\n", "mcap"),
)
_CSV = "export the signals as CSV"
_CAPTURE = "of CAN frames export text by candump; EtherCAT is not decoded: log in the control"
#: Beginnings of all others that people have: what it is, and what to do.
_OTHERS: Final[tuple[tuple[bytes, str, str], ...]] = (
    (b"\xd0\xcf\x11\xe0", "an Office document of the old kind (.xls)", "save its sheet as CSV"),
    (b"PAR1", "a Parquet file", "write it as CSV (pandas: read_parquet(...).to_csv(..., index=False))"),
    (b"ARROW1", "an Arrow file", "write it as CSV (pandas: read_feather(...).to_csv(..., index=False))"),
    (b"FEA1", "a Feather file", "write it as CSV (pandas: read_feather(...).to_csv(..., index=False))"),
    (b"TDSh", "the index of a TDMS file", "give the .tdms beside it"),
    (b"#ROSBAG V", "a ROS 1 bag", f"open it in PlotJuggler and {_CSV}, or convert it to MCAP with JSON messages"),
    (b"SQLite format 3\0", "a database (SQLite)", f"{_CSV}; of CAN frames only python-can's table 'messages' is read, ROS 2 bags are not"),
    (b"%PDF", "a PDF document", "give the measurement itself, not a report of it"),
    (b"\x89PNG", "a picture", "give the numbers behind it, as CSV"),
    (b"\xff\xd8\xff", "a picture", "give the numbers behind it, as CSV"),
    (b"GIF8", "a picture", "give the numbers behind it, as CSV"),
    (b"7z\xbc\xaf\x27\x1c", "an archive (7z)", "unpack it first"),
    (b"Rar!", "an archive (RAR)", "unpack it first"),
    (b"\xfd7zXZ\0", "packed (xz)", "unpack it first"),
    (b"BZh", "packed (bzip2)", "unpack it first"),
    (b"\x28\xb5\x2f\xfd", "packed (zstd)", "unpack it first"),
    (b"\xd4\xc3\xb2\xa1", "a capture of a network (pcap)", _CAPTURE),
    (b"\xa1\xb2\xc3\xd4", "a capture of a network (pcap)", _CAPTURE),
    (b"\x0a\x0d\x0d\x0a", "a capture of a network (pcapng)", _CAPTURE),
    (b"RIFF", "a sound file (WAV)", "its samples have no units: export time, torque and position as CSV"),
    (b"\x80\x02", "a Python pickle", "it could run any program, so it is not opened: save the arrays with numpy.savez"),
    (b"\x80\x03", "a Python pickle", "it could run any program, so it is not opened: save the arrays with numpy.savez"),
    (b"\x80\x04", "a Python pickle", "it could run any program, so it is not opened: save the arrays with numpy.savez"),
    (b"\x80\x05", "a Python pickle", "it could run any program, so it is not opened: save the arrays with numpy.savez"),
    (b"|CF,", "an imc FAMOS file", f"{_CSV} in FAMOS"),
    (b":WFM#", "a Tektronix waveform (.wfm)", "save the waveform as CSV on the instrument"),
    (b":WFMP", "a Tektronix waveform (.isf)", "save the waveform as CSV on the instrument"),
    (b"WAVEDESC", "a LeCroy waveform (.trc)", "save the waveform as CSV on the instrument"),
    (b"#9", "a waveform of an oscilloscope", "save the waveform as CSV on the instrument"),
    (b"<!DOCTYPE html", "a web page", f"{_CSV} where it came from"),
    (b"<html", "a web page", f"{_CSV} where it came from"),
    (b"<?xml", "an XML document", f"it is a project or a settings file more often than a measurement: {_CSV} in the program that made it"),
    (b"<", "an XML document", f"it is a project or a settings file more often than a measurement: {_CSV} in the program that made it"),
    (b"VERSION \"", "a DBC file, which says what frames carry", "give the log itself, and this with --dbc"),
    (b"\x7fELF", "a program", "give a file with measurements"),
    (b"MZ", "a program", "give a file with measurements"),
)  # fmt: skip
#: What no beginning tells, by ending.
_BY_ENDING: Final = {
    **dict.fromkeys((".dxd", ".d7d", ".dxz"), ("a Dewesoft file", f"{_CSV} in DewesoftX")),
    **dict.fromkeys((".svdx", ".svbx", ".svb", ".tcscopex"), ("a TwinCAT Scope file", "export it as CSV in the Scope: Data Export")),
    ".tdx": ("the data of a DIAdem pair", f"{_CSV} in DIAdem, or save it as TDMS"),
    ".psdata": ("a PicoScope file", "save it as CSV or MATLAB in PicoScope"),
    ".wfm": ("a waveform of an oscilloscope", "save the waveform as CSV on the instrument"),
    ".bag": ("a ROS bag", f"open it in PlotJuggler and {_CSV}"),
    ".ulg": ("a PX4 log", "convert it with ulog2csv"),
    ".fig": ("a figure of MATLAB", "give the numbers behind it: save the vectors in a .mat file"),
}
_READ_BY_ENDING: Final[dict[str, TableKind]] = {
    ".mat": "matlab", ".h5": "hdf5", ".hdf5": "hdf5", ".mf4": "mdf", ".mdf": "mdf", ".npz": "numpy", ".npy": "numpy", ".tdms": "tdms",
    ".mcap": "mcap", ".json": "json", ".jsonl": "json", ".ndjson": "json",
}  # fmt: skip
_HEAD = 4096


def kind_of_table(path: Path) -> TableKind:
    """The reader that a file takes, by its first bytes.

    Parameters
    ----------
    path : Path
        Of the file, packed or not.

    Raises
    ------
    UsageError
        For what is known and has no reader.
    DataError
        For what is no text and no kind that is known.
    OSError
        When it cannot be opened.
    """
    with opened(path) as file:
        begin = file.read(_HEAD)
    if begin.startswith(b"\x1f\x8b"):
        return _of_packed(path)
    ending = path.suffix.lower()
    if begin.startswith(b"PK\x03\x04"):
        return _of_archive(path)
    for mark, kind in _READ:
        if begin.startswith(mark) or (mark == b"\x89HDF\r\n\x1a\n" and begin[512:520] == mark):
            return "matlab" if kind == "hdf5" and ending == ".mat" else kind
    text = begin.removeprefix(b"\xef\xbb\xbf").lstrip()
    for mark, what, remedy in _OTHERS:
        if mark == b"MZ" and b"\0" not in begin:
            continue  # a name of a column
        if begin.startswith(mark) or (mark == b"WAVEDESC" and mark in begin[:64]) or (mark[:1] == b"<" and text.startswith(mark)):
            raise UsageError(f"{path} is {what}; {remedy}")
    if ending in _BY_ENDING and b"\0" in begin:
        what, remedy = _BY_ENDING[ending]
        raise UsageError(f"{path} is {what}; {remedy}")
    if text[:1] in (b"{", b"[") and b"\0" not in begin and _begins_json(text):
        return "json"
    if ending in _READ_BY_ENDING and (b"\0" in begin or ending != ".mat" or begin.startswith(b"MATLAB")):
        return _READ_BY_ENDING[ending]
    if b"\0" in begin and not wide_encoding(begin):
        raise DataError(
            f"{path} is not a text file (it holds zero bytes, and begins with {begin[:4].hex(' ')}), and no kind that is known; export the "
            "signals as CSV, a row of names and one row for each sample, or as .mat or .npz"
        )
    return "text"


def _of_packed(path: Path) -> TableKind:
    """Text is read packed, everything else has to be unpacked."""
    try:
        begin = next(blocks(path), b"")[:_HEAD]
    except (OSError, EOFError, zlib.error) as error:
        raise DataError(f"{path} cannot be read: {unreadable(error)}") from error
    if b"\0" in begin and not wide_encoding(begin):
        raise UsageError(f"{path} is packed (gzip) and holds no text; unpack it first")
    return "text"


def _begins_json(text: bytes) -> bool:
    """True if a text that begins with a bracket goes on as JSON does; "[s]" is a unit, "[Settings]" a section."""
    inner = text[1:].lstrip()
    return inner[:1] in b'"{[]}' if text[:1] == b"{" else inner[:1] in b'{["' or inner[:1].isdigit() or inner[:1] == b"-"


def _of_archive(path: Path) -> TableKind:
    try:
        with opened(path) as file, zipfile.ZipFile(file) as archive:
            names = archive.namelist()[:1000]
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
        if path.suffix.lower() == ".npz":
            return "numpy"
        raise DataError(f"{path} is an archive that is damaged or cut off; unpack it first") from error
    if names and all(name.endswith(".npy") for name in names):
        return "numpy"
    what, remedy = "an archive", "unpack it first"
    if any(name.startswith("xl/") for name in names) or "content.xml" in names:
        what, remedy = "a spreadsheet", "save its sheet as CSV"
    elif any(name.startswith("word/") for name in names):
        what, remedy = "a text document", "give the measurement itself"
    elif any(name.startswith(("simulink/", "metadata/")) for name in names) or path.suffix.lower() in {".mldatx", ".slx", ".mlx"}:
        what, remedy = "a file of Simulink or MATLAB", "export the signals to a .mat file: save them as a structure with time"
    elif path.suffix.lower() in _BY_ENDING:
        what, remedy = _BY_ENDING[path.suffix.lower()]
    raise UsageError(f"{path} is {what}; {remedy}")
