"""Time that the recordings of a run will take, told before they are read."""

from __future__ import annotations

from beltcomm.laboratory.extracts import EXTRACT_ROWS
from beltcomm.outside import in_words
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Talk

#: Bytes of recordings above which it is told, of one row, and s: to read and check a byte, and to fit a row.
LONG_BYTES, ROW_BYTES, READ_S, FIT_S = 20_000_000, 30, 9e-8, 4e-4


def foretell(folder: RunFolder, talk: Talk) -> None:
    """Say it where it is long."""
    size = sum(path.stat().st_size for path in folder.recordings_folder.glob("*.csv"))
    if size > LONG_BYTES:
        rows = min(size / ROW_BYTES, EXTRACT_ROWS)
        talk.say(
            f"The recordings have {in_words(size)}: about {READ_S * size:.0f} s to read them, then about {FIT_S * rows:.0f} s for a fit."
        )
