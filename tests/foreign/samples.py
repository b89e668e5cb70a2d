"""A motor that swings, as foreign loggers write it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

PERIOD_S = 1e-3
CONSTANT_NM_A = 0.65
COUNTS = 65536


def swing(samples: int = 1500) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Time in s, current in A, position in encoder counts: inertia 1e-3 kg m², friction 0.2 N m, 1 mN m s/rad."""
    t = PERIOD_S * np.arange(samples)
    speed = 20.0 * math.pi * np.sin(1.4 * math.pi * t)
    acceleration = np.gradient(speed, PERIOD_S)
    noise = np.random.default_rng(1).normal(0.0, 5e-3, samples)
    torque = 1e-3 * acceleration + 0.2 * np.sign(speed) + 1e-3 * speed + noise
    position = np.cumsum(speed) * PERIOD_S
    return t, np.round(torque / CONSTANT_NM_A, 5), np.round(position / math.tau * COUNTS)


def text(header: str = "time,Iq,enc", *, separator: str = ",", comma: bool = False, time_scale: float = 1.0, samples: int = 1500) -> str:
    """The swing as a text table."""
    lines = [separator.join((f"{a * time_scale:.4f}", f"{b:.5f}", f"{c:.0f}")) for a, b, c in zip(*swing(samples), strict=True)]
    body = "\n".join(lines) + "\n"
    return (header + "\n" if header else "") + (body.replace(".", ",") if comma else body)


def write(path: Path, content: str, encoding: str = "utf-8") -> Path:
    path.write_bytes(content.encode(encoding))
    return path


MAPPING = ("t_s=time", "torque_nm=Iq*0.65", "position_rad=enc*rev/65536")


def options(mapping: Sequence[str] = MAPPING) -> list[str]:
    """The mapping as words of a command line."""
    return [word for text in mapping for word in ("--map", text)]
