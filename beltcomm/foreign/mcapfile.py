"""MCAP files as a table, by the field's own reader: each topic of JSON messages has the time at which they were logged."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.arrays import Column
from beltcomm.errors import DataError
from beltcomm.foreign.jsonfile import as_columns
from beltcomm.foreign.table import Table, words_of
from beltcomm.outside import check_columns, check_count, from_json, opened

_FEWEST = 3


def read_mcap(path: Path) -> Table:
    """Numbers in the JSON messages of all topics.   Raises DataError for a file that is damaged, or holds messages of another kind."""
    from mcap.reader import make_reader

    messages: dict[str, list[dict[str, Any]]] = {}
    stamps: dict[str, list[int]] = {}
    others: dict[str, str] = {}
    count = 0
    try:
        with opened(path) as file:
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
    except (DataError, MemoryError):
        raise
    except Exception as error:  # on damaged bytes this reader raises whatever it stumbles over
        raise DataError(f"{path} cannot be read as an MCAP file ({words_of(error)}); is it cut off?") from error
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
