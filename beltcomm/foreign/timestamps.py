"""Time stamps as loggers write them: dates, stamps that repeat or go back; a sentence for each fault."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beltcomm.errors import DataError
from beltcomm.recording import LONGEST_STEP_S

Column = NDArray[Any]
_ZONE = re.compile(r"(?<=\d)\s*(Z|[+-]\d\d:?\d\d)$")
_STAMP = re.compile(r"\d{4}-\d\d-\d\d[ T]\d\d:\d\d:\d\d(\.\d*)?$")


def seconds_of(file: str, name: str, stamps: Column) -> Column:
    """Seconds since the first row of stamps such as ``2024-05-03 14:02:11.204`` or ``14:02:11.204``.

    Raises DataError for text that is neither.
    """
    texts = [_ZONE.sub("", str(stamp).strip().replace(",", ".").replace("/", "-")) for stamp in stamps]
    if not any("-" in text for text in texts):
        texts = [f"1970-01-01T{text:0>8}" for text in texts]
    try:
        if not all(_STAMP.match(text) for text in texts):
            raise ValueError
        times = np.array(texts, dtype="datetime64[ns]")
    except ValueError as error:
        raise DataError(
            f"{file}: {name} holds text such as {str(stamps[0])[:30]!r}, no time that is understood; give --rate instead"
        ) from error
    seconds: Column = (times - times[0]).astype(np.int64) * 1e-9
    return seconds


def checked_time(file: str, t_s: Column, rows: NDArray[np.intp]) -> None:
    """Raise DataError when time stands still or goes back, or when it is in another unit than seconds.   rows : numbers from 0."""
    if len(t_s) < 2:
        return
    steps = np.diff(t_s)
    back = np.flatnonzero(steps < 0.0)
    if len(back):
        at = int(back[0])
        many = f" and {len(back) - 1} times more" if len(back) > 1 else ""
        raise DataError(
            f"{file}: time goes back by {-steps[at]:.6g} s in row {rows[at + 1] + 1}{many}; another record begins there: "
            f"take one part, --rows :{rows[at] + 1} or --rows {rows[at + 1] + 1}:, or do without the stamps with --rate"
        )
    still = np.flatnonzero(steps == 0.0)
    if len(still):
        rate = (len(t_s) - 1) / float(t_s[-1] - t_s[0]) if t_s[-1] > t_s[0] else 0.0
        resolution = float(steps[steps > 0.0].min()) if np.any(steps > 0.0) else 0.0
        why = (
            f"the stamps have a resolution of {resolution:.4g} s, coarser than the sampling: if it was even, give --rate {rate:.6g}Hz "
            "instead of the stamps"
            if len(still) > 0.05 * len(steps)
            else "rows were written twice; leave one of each out"
        )
        raise DataError(f"{file}: {len(still)} time stamps repeat, the first in row {rows[int(still[0]) + 1] + 1}; {why}")
    median = float(np.median(steps))
    if median > LONGEST_STEP_S:
        unit = "us" if median > 50.0 else "ms"
        raise DataError(
            f"{file}: time rises by {median:.4g} s per row, which is no sampling of a drive; "
            f"if it is in {unit} write --map t_s=NAME*{unit}, if it counts the rows give --rate"
        )
