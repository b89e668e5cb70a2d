"""The values of a torque path by what the motion says of them, beside what setpoint and reading said.

    δ = (H + P⁻¹)⁻¹ H δ_m,     δ_m : what the motion alone asks for, H its information beside everything fitted, P from the reading

A current loop's shape inside the sampling period hardly shows in the means that are read, and much in the inertia.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from beltcomm.fit.estimate import Fitted, fit
from beltcomm.fit.records import Data, made
from beltcomm.fit.torque_path import Lag, TorquePath
from beltcomm.simulate.inverse import acting_torque, true_motion

Array = NDArray[np.float64]

#: Rounds; relative step of a difference; largest relative change at a time; fall of O that is worth a round, nats; iterations of its fit.
ROUNDS, STEP, MOST, WORTH, ITERATIONS = 3, 0.02, 0.4, 10.0, 6
#: What the reading's interval is taken for beyond itself, and share of a value that it is known to at least where there is none.
DOUBT, UNKNOWN = 3.0, 1.0


def refine_path(data: Data, fitted: Fitted) -> tuple[Data, Fitted]:
    """Records and fit with the path's values as motion and reading together have them; as they were where nothing is gained."""
    for _ in range(ROUNDS):
        values = _values(data.path)
        if not len(values):
            break
        columns = _columns(data, fitted, values)
        if columns is None:
            break
        near = fitted.nearby.best(columns=columns)
        known = fitted.nearby.information(columns)
        prior = np.diag(1.0 / np.maximum(_deviations(data.path, values), 1e-12) ** 2)
        step = np.linalg.solve(known + prior + 1e-12 * np.diag(np.diag(known + prior)), known @ near.amounts)
        step = np.clip(step, -MOST * values, MOST * values)
        path = _with_values(data.path, values + step)
        same = (data.noise_nm, data.step_rad, _shares(data), data.substeps, path, data.reversals, data.colour)
        ahead = made(data.recordings, fitted.model, *same)
        better = fit(ahead, fitted.model, ITERATIONS, offsets=fitted.offsets)
        gain = _level(fitted) - _level(better)
        if gain * fitted.problem.samples < WORTH:
            break
        data, fitted = ahead, better
    return data, fitted


def with_doubt(data: Data, fitted: Fitted) -> Fitted:
    """The fit, whose intervals count with what the torque path's values leave open."""
    values = _values(data.path)
    columns = _columns(data, fitted, values) if len(values) else None
    if columns is not None and np.any(columns):
        fitted.problem.path_doubt = columns, np.diag(1.0 / np.maximum(_deviations(data.path, values), 1e-12) ** 2)
    return fitted


def _level(fitted: Fitted) -> float:
    return fitted.objective / max(fitted.problem.samples, 1)


def _shares(data: Data) -> dict[str, tuple[float, float]]:
    return {piece.record: piece.rounding for piece in (*data.fitted, *data.held_out)}


def _lags(path: TorquePath) -> tuple[Lag, ...]:
    return (*(path.drive.lags if path.drive is not None else ()), *path.reading.lags)


def _values(path: TorquePath) -> Array:
    """Values of all filters of the drive, then of the reading, then the loop's that no setpoint shows, (k,)."""
    own = [value for lag in _lags(path) for value in lag.values]
    return np.array([*own, *([path.loop_s] if path.loop_s > 0.0 else [])])


def _deviations(path: TorquePath, values: Array) -> Array:
    """How well the reading knows them, one standard deviation, (k,)."""
    own = [half for lag in _lags(path) for half in (lag.intervals or (0.0,) * len(lag.values))]
    half = np.array([*own, *([0.0] if path.loop_s > 0.0 else [])])
    return np.where(half > 0.0, DOUBT * half / 2.0, UNKNOWN * values)


def _with_values(path: TorquePath, values: Array) -> TorquePath:
    """The path with other values."""
    place = 0

    def lags(of: tuple[Lag, ...]) -> tuple[Lag, ...]:
        nonlocal place
        found = []
        for lag in of:
            own = tuple(float(v) for v in values[place : place + len(lag.values)])
            place += len(lag.values)
            found.append(replace(lag, values=(min(own[0], 1.0),) if lag.kind == "sampled" else own))
        return tuple(found)

    drive = None if path.drive is None else replace(path.drive, lags=lags(path.drive.lags))
    reading = replace(path.reading, lags=lags(path.reading.lags))
    return replace(path, drive=drive, reading=reading, loop_s=float(values[place]) if path.loop_s > 0.0 else 0.0)


def _columns(data: Data, fitted: Fitted, values: Array) -> Array | None:
    """Change of the whitened residual with each value, (n, k); None behind observers."""
    by_name = {r.name: r for r in data.recordings}
    vector, parts = fitted.problem.full(fitted.x), []
    for piece in fitted.problem.pieces:
        if piece.whitener is None:
            return None
        recording = by_name[piece.record]
        changes = np.zeros((piece.motion.samples, len(values)))
        if len(recording.t_s) == piece.motion.samples:  # of a record with gaps this would be another piece
            motion = true_motion(fitted.model, piece.motion, vector)
            here = acting_torque(fitted.model, motion, piece.torque, vector)
            for k, value in enumerate(values):
                ahead = values.copy()
                ahead[k] += STEP * value
                path = _with_values(data.path, ahead)
                torque, within = path.acting(recording.torque, recording.torque_setpoint, recording.sample_period_s)
                changes[:, k] = -(acting_torque(fitted.model, replace(motion, within=within), torque, vector) - here) / (STEP * value)
        parts.append(piece.white(changes))
    return np.concatenate(parts)
