"""A log of frames as candump writes it, of moves that the adapter made with the virtual drive, and the adapter's own rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from beltcomm.drive import COLUMNS, Limits, Motion, Row, open_drive
from beltcomm.virtual.bus import Frame

PERIOD_S = 1e-3
#: s since 1970 at which the log begins.
EPOCH_S = 1_436_509_052


@dataclass
class Logged:
    """frames : everything on the bus.   own : columns of each recording that the adapter made, NaN columns left out."""

    frames: list[Frame]
    own: list[dict[str, NDArray[np.float64]]]


def candump(frames: Sequence[Frame], path: Path) -> Path:
    """As ``candump -L can0`` writes it."""
    lines = [f"({EPOCH_S + t:.6f}) can0 {i:03X}#{'R' if 'rtr' in source else data.hex().upper()}" for t, i, data, source in frames]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def prbs(amplitude_nm: float, chips: int = 256, periods: int = 8, seed: int = 1) -> NDArray[np.float64]:
    """Torque of two levels, mean zero, 2 ms a chip, between rests."""
    half = np.repeat([-1.0, 1.0], chips // 2)
    block = np.repeat(np.random.default_rng(seed).permutation(half), 2)
    return amplitude_nm * np.concatenate((np.zeros(50), np.tile(block, periods), np.zeros(50)))


def motions(here_rad: float) -> list[Motion]:
    """Torque, position, velocity."""
    torque = prbs(0.25)
    phase = np.linspace(0.0, np.pi, 600)
    path = here_rad + 2.0 * np.sin(phase) ** 2
    speed = 5.0 * np.sin(phase)
    zero = np.zeros(600)
    return [
        Motion("torque", PERIOD_S, np.zeros(len(torque)), np.zeros(len(torque)), torque),
        Motion("position", PERIOD_S, path, np.gradient(path, PERIOD_S), zero),
        Motion("velocity", PERIOD_S, zero, speed, zero),
    ]


def logged(profile: str = "reference", kinds: Sequence[str] = ("torque", "position", "velocity")) -> Logged:
    """Moves of these kinds on rig g_a."""
    frames: list[Frame] = []
    own = []
    with open_drive("virtual:g_a", {"profile": profile, "seed": 1, "log": frames.append}) as drive:
        drive.calibrate({name: drive.capabilities.parameters[name].scale for name in drive.capabilities.uncalibrated})
        drive.write({"kp_nm_s_rad": 0.02, "ki_nm_rad": 0.8, "kpp_1_s": 5.0})
        here = drive.read(["position_rad"])["position_rad"]
        for motion in motions(here):
            if motion.kind in kinds:
                here = drive.read(["position_rad"])["position_rad"]
                shifted = Motion(
                    motion.kind, PERIOD_S, motion.position_rad + (here - motion.position_rad[0]), motion.velocity_rad_s, motion.torque_nm
                )
                rows: list[Row] = []
                drive.record(shifted, Limits(here - 15.0, here + 15.0, 100.0, 1.2, 2000.0), rows.append)
                table = np.array(rows)
                own.append({name: column for name, column in zip(COLUMNS, table.T, strict=True) if not np.isnan(column).any()})
    return Logged(frames, own)
