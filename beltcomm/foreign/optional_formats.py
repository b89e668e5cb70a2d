"""Formats that need a package of their own, as tables: ASAM MDF (asammdf), National Instruments' TDMS (npTDMS), MCAP (mcap).

Of an MDF file (version 3 and 4) each channel group has its raster, and none is resampled here; a TDMS channel's time is its waveform's, or
a column of its group; each topic of an MCAP file's JSON messages has the time at which they were logged.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.arrays import Array, Column
from beltcomm.errors import DataError
from beltcomm.foreign.jsonfile import as_columns
from beltcomm.foreign.table import Table, damage_as_data_error
from beltcomm.outside import check_columns, check_count, from_json, opened

#: Times its size that a packed file can hold at most (deflate).
_PACKED = 1032


def read_mdf(path: Path) -> Table:
    """All channels of an MDF file in physical units; two channels of one name get the number of their group.

    Parameters
    ----------
    path : Path

    Raises
    ------
    DataError
        For a file that is damaged or holds no channel of numbers.
    """
    from asammdf import MDF

    with damage_as_data_error(path, "an MDF file"), MDF(path) as file:
        return _mdf_channels(path, file)


def _mdf_channels(path: Path, file: Any) -> Table:
    found: dict[str, Array] = {}
    units: dict[str, str] = {}
    clocks: dict[str, str] = {}
    left_out: list[str] = []
    groups: dict[int, list[Any]] = {}
    for group in file.groups:  # before anything is made of numbers that a damaged file says
        head = group.channel_group
        rows, record = int(head.cycles_nr), max(int(getattr(head, "samples_byte_nr", 1)), 1)
        check_count(str(path), rows, len(group.channels))
        if rows * record > _PACKED * path.stat().st_size:
            raise DataError(f"{path} says that it holds {rows} rows of {record} bytes, more than a file of its size can; it is damaged")
    for signal in file.iter_channels(copy_master=False):
        groups.setdefault(int(signal.group_index), []).append(signal)
    several = len(groups) > 1
    for index, signals in groups.items():
        stamps = np.asarray(signals[0].timestamps, dtype=np.float64)
        clock = f"time of group {index}" if several else "time"
        if len(stamps) < 2:
            left_out += [signal.name for signal in signals]
            continue
        found[clock], units[clock] = stamps, "s"
        for signal in signals:
            values = np.asarray(signal.samples)
            if values.dtype.kind not in "buif" or values.ndim != 1 or len(values) != len(stamps):
                left_out.append(signal.name)
                continue
            name = signal.name if signal.name not in found else f"{signal.name} of group {index}"
            column = values.astype(np.float64)
            if signal.invalidation_bits is not None:
                column[np.asarray(signal.invalidation_bits, dtype=bool)] = np.nan
            column[~np.isfinite(column)] = np.nan
            found[name], clocks[name] = column, clock
            check_columns(str(path), len(found))
            if signal.unit:
                units[name] = str(signal.unit).strip()
    notes = [f"{len(groups)} channel groups, each with time stamps of its own"] if several else []
    notes += [f"not read, because they are no channels of numbers: {', '.join(left_out)}"] if left_out else []
    if not clocks:
        raise DataError(f"{path} holds no channels of numbers; {', '.join(left_out[:10]) or 'it is empty'}")
    return Table(str(path), found, units, tuple(notes), clocks)


def read_tdms(path: Path) -> Table:
    """All channels of numbers and dates of a TDMS file.

    Parameters
    ----------
    path : Path

    Raises
    ------
    DataError
        For a file that is damaged or holds none.
    """
    from nptdms import TdmsFile

    with damage_as_data_error(path, "a TDMS file"), opened(path) as file:
        return _tdms_channels(path, TdmsFile.read(file))


def _tdms_channels(path: Path, file: Any) -> Table:
    columns: dict[str, Column] = {}
    units: dict[str, str] = {}
    clocks: dict[str, str] = {}
    made: dict[tuple[float, float, int], str] = {}
    left_out: list[str] = []
    groups = file.groups()
    for group in groups:
        for channel in group.channels():
            name = channel.name if len(groups) == 1 or channel.name not in columns else f"{group.name}/{channel.name}"
            values = np.asarray(channel[:])
            if values.dtype.kind == "M":
                values, units[name] = (
                    (values - values[0]).astype("timedelta64[ns]").astype(np.float64) * 1e-9 if len(values) else values,
                    "s",
                )
            if values.dtype.kind not in "buif" or values.ndim != 1 or len(values) < 2:
                left_out.append(name)
                units.pop(name, None)
                continue
            columns[name] = values.astype(np.float64)
            check_columns(str(path), len(columns))
            unit = channel.properties.get("unit_string") or channel.properties.get("NI_UnitDescription")
            if unit:
                units[name] = str(unit).strip()
            step, start = _number(channel.properties.get("wf_increment")), _number(channel.properties.get("wf_start_offset"))
            if step > 0.0 and len(values) > 1:
                key = (step, start, len(values))
                if key not in made:
                    made[key] = f"time at {1.0 / step:.6g} Hz" + (f" ({len(made) + 1})" if any(k[0] == step for k in made) else "")
                clocks[name] = made[key]
    for (step, start, length), clock in made.items():
        columns[clock], units[clock] = start + step * np.arange(length), "s"
    notes = [f"not read, because they are no channels of numbers: {', '.join(left_out)}"] if left_out else []
    if not columns:
        raise DataError(f"{path} holds no channels of numbers; {', '.join(left_out[:10]) or 'it is empty'}")
    return Table(str(path), columns, units, tuple(notes), clocks)


def _number(value: Any) -> float:
    return float(value) if isinstance(value, (int, float, np.number)) and np.isfinite(value) else 0.0


_FEWEST = 3


def read_mcap(path: Path) -> Table:
    """Numbers in the JSON messages of all topics of an MCAP file.

    Parameters
    ----------
    path : Path

    Raises
    ------
    DataError
        For a file that is damaged, or holds messages of another kind.
    """
    from mcap.reader import make_reader

    messages: dict[str, list[dict[str, Any]]] = {}
    stamps: dict[str, list[int]] = {}
    others: dict[str, str] = {}
    count = 0
    with damage_as_data_error(path, "an MCAP file"), opened(path) as file:
        for _, channel, message in make_reader(file).iter_messages():
            if channel.message_encoding != "json":
                others[channel.topic] = channel.message_encoding or "no encoding"
                continue
            content = from_json(message.data)
            if isinstance(content, dict):
                messages.setdefault(channel.topic, []).append(content)
                stamps.setdefault(channel.topic, []).append(message.publish_time or message.log_time)
            count += 1
            check_count(str(path), count, 4)
    told = ", ".join(f"{topic} ({encoding})" for topic, encoding in list(others.items())[:5])
    if not messages:
        raise DataError(
            f"{path} holds no JSON messages, and others need their schemas: {told or 'it is empty'}; open it in PlotJuggler or "
            "Foxglove and export the topics as CSV"
        )
    return _topics(path, messages, stamps, (f"topics that are not JSON were left out: {told}",) if others else ())


def _topics(path: Path, messages: dict[str, list[dict[str, Any]]], stamps: dict[str, list[int]], notes: tuple[str, ...]) -> Table:
    columns: dict[str, Column] = {}
    clocks: dict[str, str] = {}
    units: dict[str, str] = {}
    first = min(min(values) for values in stamps.values())
    for topic, records in messages.items():
        if len(records) < _FEWEST:
            continue
        name = topic.strip("/")
        clock = f"time of {name}" if len(messages) > 1 else "time"
        columns[clock] = (np.array(stamps[topic], dtype=np.int64) - first) * 1e-9
        units[clock] = "s"
        for key, values in as_columns(records).items():
            if isinstance(values, np.ndarray) and values.dtype.kind == "f" and len(values) == len(records):
                column = f"{name}.{key}" if len(messages) > 1 else key
                columns[column], clocks[column] = values, clock
                check_columns(str(path), len(columns))
    if not clocks:
        raise DataError(f"{path} holds no numbers that come again and again; its topics are {', '.join(messages)}")
    return Table(str(path), columns, units, notes, clocks)
