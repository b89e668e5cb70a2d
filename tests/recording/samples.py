"""A swinging motor as signals, as a recording, as a file and as the rows of a drive."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.recording import Recording

PERIOD_S = 1e-3


def signals(samples: int = 2000, seed: int = 0) -> dict[str, Any]:
    """A motor that swings by 5 rad under a noisy torque."""
    rng = np.random.default_rng(seed)
    t = PERIOD_S * np.arange(samples)
    return {
        "t_s": t,
        "torque": 0.3 * np.sin(7 * t) + rng.normal(0.0, 6e-3, samples),
        "position": 5.0 * np.sin(3 * t),
    }


def recording(**changes: Any) -> Recording:
    return Recording(**({"name": "a"} | signals() | changes))


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def csv_text(samples: int = 50, **columns: Any) -> str:
    """A valid file, with some columns replaced or, when None, left out; cells as they stand."""
    made = signals(samples)
    table = {"t_s": made["t_s"], "torque_nm": made["torque"], "position_rad": made["position"]} | columns
    kept = {name: [str(cell) for cell in values] for name, values in table.items() if values is not None}
    return "\n".join([",".join(kept), *map(",".join, zip(*kept.values(), strict=True))]) + "\n"


def rows(samples: int) -> list[tuple[float, ...]]:
    made = signals(samples)
    return [(t, q, math.nan, x, math.nan, math.nan, math.nan, math.nan) for t, q, x in zip(*(made[n].tolist() for n in made), strict=True)]
