"""Second sensor, at the load, as a witness of the compliance before it, which no fit uses.

    motor angle = i (load + (J / k) load acceleration + (d / k) load speed + friction / k) + zero,      each behind one low-pass

i : gear ratio, whatever the two sensors count in.   J / k : 1 / (2 pi f)² of the load on a held motor, the antiresonance of the motor's
response.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Array
from beltcomm.fit.noise.decimation import smallest_step
from beltcomm.fit.start.low_pass import REACH, legible, smooth
from beltcomm.recording import Recording

#: Deviations beyond which J / k is known; s, length of a block whose sums are independent, fewest of them; share to be explained.
CERTAIN, BLOCK_S, FEWEST_BLOCKS, EXPLAINED = 4.0, 0.2, 10, 0.5
#: Share by which the model's antiresonance may be another one.
SAME = 0.05


@dataclass(frozen=True)
class SecondSensor:
    """The load's own oscillation by its sensor.

    Attributes
    ----------
    column : str
        Of the sensor.
    antiresonance_hz : float, Hz
        Of the load on a held motor.
    interval_hz : float, Hz
        Half its 95 % interval.
    explained : float
        Share of what no rigid gear explains of the motor angle, 0 to 1.
    model_hz : float or None, Hz
        The model's, nearest to it; None of one rigid body.
    """

    column: str
    antiresonance_hz: float
    interval_hz: float
    explained: float
    model_hz: float | None = None

    @property
    def confirms(self) -> bool:
        """True if the model has it, too."""
        room = max(SAME * self.antiresonance_hz, self.interval_hz)
        return self.model_hz is not None and abs(self.model_hz - self.antiresonance_hz) < room


def second_sensor(recordings: Sequence[Recording], model_hz: Sequence[float] = ()) -> SecondSensor | None:
    """By all records with one; None where it shows no compliance, or hardly any.

    Parameters
    ----------
    recordings : sequence of Recording
        Those without a sensor at the load tell nothing.
    model_hz : sequence of float, Hz
        Antiresonances of the model.

    Returns
    -------
    SecondSensor or None
    """
    for column in ("load_position_rad", "cart_position_m"):
        parts = [part for r in recordings if (part := _rows(r, getattr(r, column))) is not None]
        if not parts:
            continue
        rows, motor, blocks = (np.concatenate([part[k] for part in parts]) for k in (0, 1, 2))
        first = np.cumsum([0, *(int(part[2][-1]) + 1 for part in parts)])
        blocks += np.repeat(first[:-1], [len(part[2]) for part in parts])
        found = np.linalg.lstsq(rows, motor, rcond=None)[0]
        left, rigid = motor - rows @ found, motor - rows[:, 1:] @ np.linalg.lstsq(rows[:, 1:], motor, rcond=None)[0]
        explained = 1.0 - float(left @ left) / float(rigid @ rigid)
        # of neighbouring rows only the sums over a block are independent
        scores = np.column_stack([np.bincount(blocks, weights=row * left) for row in rows.T])
        inverse = np.linalg.pinv(rows.T @ rows)
        error = math.sqrt(max(float((inverse @ (scores.T @ scores) @ inverse)[0, 0]), 0.0)) / abs(float(found[1]))
        own = float(found[0] / found[1])
        if len(scores) < FEWEST_BLOCKS or explained < EXPLAINED or not own > CERTAIN * error:
            continue
        hertz = 1.0 / (math.tau * math.sqrt(own))
        near = min(model_hz, key=lambda one: abs(math.log(one / hertz)), default=None)
        return SecondSensor(column, hertz, hertz * error / own, explained, near)
    return None


def _rows(record: Recording, sensor: Array | None) -> tuple[Array, Array, NDArray[np.intp]] | None:
    """Regressors (n, 4), motor angle (n,) and numbers of the blocks (n,) of a record, all of mean 0; None where it moves too little."""
    if sensor is None or record.is_static_map or len(record.gaps) or np.ptp(sensor) == 0.0 or record.side == "load":
        return None
    sample = record.sample_period_s
    width = max(legible(values, sample, smallest_step(values))[0] for values in (record.position, sensor))
    motor, load = smooth(record.position, width), smooth(sensor, width)
    speed = np.gradient(load, sample)
    inside = slice(round(REACH * width), len(load) - round(REACH * width))
    columns = np.column_stack([np.gradient(speed, sample), load, speed, smooth(np.sign(speed), width)])[inside]
    motor = motor[inside]
    if len(motor) * sample < FEWEST_BLOCKS * BLOCK_S:
        return None
    blocks = (np.arange(len(motor)) * sample / BLOCK_S).astype(np.intp)
    return columns - columns.mean(axis=0), motor - motor.mean(), blocks
