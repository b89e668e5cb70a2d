"""The cheapest commissioning there is: stands in for the whole one in a study, in whatever process."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from beltcomm import api
from beltcomm.result import Result


def commission(drive: str, axis: Any, run: Path, *, options: Any) -> Result:
    """As :func:`beltcomm.api.commission`, at one place, without pictures."""
    return api.commission(drive, axis, run, options=replace(options, quick=True, pictures=False))
