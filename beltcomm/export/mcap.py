"""Recordings as an MCAP file, for PlotJuggler, Foxglove and whoever reads it: a topic of JSON messages for each recording."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import IO

import numpy as np

from beltcomm.errors import UsageError
from beltcomm.recording import Recording
from beltcomm.version import __version__

_ROWS = 10_000


def write_mcap(stream: IO[bytes], recordings: Sequence[Recording]) -> None:
    """All columns of each recording as a message per row, stamped by the session's clock where one is known.

    Every number stands in the message as it is, t_s too: a stamp is whole nanoseconds.

    Raises
    ------
    UsageError
        Without the package that writes such files, or for stamps before the session's clock.
    """
    try:
        from mcap.writer import Writer
    except ImportError as error:
        raise UsageError("an MCAP file needs a further package: pip install 'beltcomm[mcap]'") from error
    writer = Writer(stream)
    writer.start(library=f"beltcomm {__version__}")
    for recording in recordings:
        columns = recording.columns()
        schema = {"type": "object", "properties": {name: {"type": "number"} for name in columns}}
        schema_id = writer.register_schema(f"beltcomm.{recording.side}", "jsonschema", json.dumps(schema).encode())
        told = {"held_out": str(recording.sidecar.held_out), "experiment": recording.sidecar.experiment}
        channel = writer.register_channel(f"/{recording.name}", "json", schema_id, metadata=told)
        times = columns.get("t_s")
        if times is None:
            times = np.arange(len(recording.torque), dtype=np.float64)
        stamps = np.round(1e9 * (times - min(float(times[0]), 0.0) + (recording.sidecar.session_time_s or 0.0))).astype(np.int64)
        for first in range(0, len(stamps), _ROWS):
            rows = zip(*(column[first : first + _ROWS].tolist() for column in columns.values()), strict=True)
            for number, row in enumerate(rows, start=first):
                message = json.dumps(dict(zip(columns, row, strict=True)), allow_nan=True).encode()
                writer.add_message(channel, int(stamps[number]), message, int(stamps[number]), number)
    writer.finish()
