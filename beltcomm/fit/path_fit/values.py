"""The values of a torque path by what the motion says of them, beside what setpoint and reading said.

    (H + P) δ = H δ_m + p,     δ_m : what the motion alone asks for, H its information beside everything fitted;
                               P, p : information and pull of the reading, r = reading - prediction

A current loop's shape inside the sampling period hardly shows in the means that are read, and much in the inertia.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from beltcomm.arrays import Array
from beltcomm.fit.estimate import Fitted, fit
from beltcomm.fit.likelihood.problem import Nuisance
from beltcomm.fit.noise.decimation import decimate_torque
from beltcomm.fit.noise.level import robust_rms, torque_step
from beltcomm.fit.records import Data, grouped_like, prepare_records
from beltcomm.fit.torque.lag import Lag
from beltcomm.fit.torque.path import TorquePath
from beltcomm.fit.torque.reading_fit import TAPS, WHOLE, colour_of, lively_pairs, whitened_row
from beltcomm.model import Model
from beltcomm.model.value import NORMAL_95
from beltcomm.simulate.inverse import acting_torque, true_motion

#: Rounds at most; relative step of a difference; largest relative change at a time; fall of O worth a round, nats; iterations of its fit.
ROUNDS, STEP, MOST, WORTH, ITERATIONS = 8, 0.02, 0.4, 10.0, 6
#: Share of a delay by which it may fall at a time.
NEARLY_ALL = 0.9
#: N m, noise of a reading without any.
LEAST_NOISE_NM = 1e-9
#: Share of a value that it is known to at least.
UNKNOWN = 1.0


def refine_path(data: Data, fitted: Fitted) -> tuple[Data, Fitted]:
    """Records and fit with the path's values as motion and reading together have them; as they were where nothing is gained.

    Parameters
    ----------
    data : Data
        With their torque path.
    fitted : Fitted
        To these records.

    Returns
    -------
    tuple of Data and Fitted
        Path with half widths.
    """
    for _ in range(ROUNDS):
        values = _values(data.path)
        if not len(values):
            break
        columns = columns_of(data, fitted)
        if columns is None:
            break
        near, told = fitted.local_quadratic.best(columns=columns), _by_reading(data, values)
        known = fitted.local_quadratic.information(columns)
        step = np.linalg.solve(known + told.information, known @ near.amounts + told.pull)
        step *= min(1.0, float(np.min(_most(data.path, values) / np.maximum(np.abs(step), 1e-300))))  # what one loses another gains
        path = _with_values(data.path, values + step)
        if not path.can_be_undone(data.recordings[0].sample_period_s):
            break
        ahead = by_path(data, fitted.model, path)
        held = [name for name in fitted.model.parameters if name not in fitted.problem.free]
        better = fit(ahead, fitted.model, ITERATIONS, offsets=fitted.offsets, fixed=held)
        gain = (_level(fitted) - _level(better)) * fitted.problem.samples
        if gain + told.squares - _by_reading(ahead, values + step).squares < WORTH:
            break
        data, fitted = ahead, better
    return _with_half_widths(data, fitted), fitted


def _with_half_widths(data: Data, fitted: Fitted) -> Data:
    """The records by a path whose values have their intervals, from motion and reading beside everything fitted."""
    values = _values(data.path)
    columns = columns_of(data, fitted) if len(values) else None
    if columns is None:
        return data
    known = fitted.local_quadratic.information(columns) + _by_reading(data, values).information
    halves = NORMAL_95 * np.sqrt(np.maximum(np.diag(np.linalg.pinv(known, hermitian=True)), 0.0))
    return replace(data, path=_with_values(data.path, values, halves))


def path_nuisance(data: Data, fitted: Fitted) -> Nuisance | None:
    """Nuisance of the path's values, which the reading tells, and of its rivals, which nothing tells; None without any.

    Parameters
    ----------
    data : Data
    fitted : Fitted
    """
    values, rivals = _values(data.path), data.path.rivals
    columns = columns_of(data, fitted) if len(values) else None
    if columns is None or not np.any(columns):
        columns, values = np.zeros((fitted.problem.samples, 0)), values[:0]
    other = _changes(data, fitted, rivals, [1.0] * len(rivals)) if rivals else None
    if other is not None:  # half an interval is how far one of them is off, in the mean of all
        columns = np.hstack([columns, other])
    if not columns.shape[1]:
        return None
    own, unknown = len(values), columns.shape[1] - len(values)
    information = block_diag(_by_reading(data, values).information if own else np.zeros((0, 0)), NORMAL_95**2 * unknown * np.eye(unknown))
    return Nuisance(columns, information, np.arange(own + unknown) < own)


@dataclass(frozen=True)
class ByReading:
    """Information of setpoint and reading on a path's values, (k, k), their pull, (k,), and the squares left, in units of the noise."""

    information: Array
    pull: Array
    squares: float


def _by_reading(data: Data, values: Array) -> ByReading:
    """Of the path of some records; next to nothing where its reading is the command, or without a setpoint."""
    path, hardly = data.path, np.diag(1.0 / (UNKNOWN * _units(data.path, values)) ** 2)
    pairs, sample_s = lively_pairs([r for r in data.recordings if not r.sidecar.held_out])
    if path.drive is None or path.commanded or not pairs:
        return ByReading(hardly, np.zeros(len(values)), 0.0)

    def rest_at(place: Array, colour: float = 0.0) -> Array:
        trial = _with_values(path, place)
        assert trial.drive is not None
        rests = [reading - trial.reading.read(trial.drive.cells(setpoint, sample_s), sample_s) for setpoint, reading in pairs]
        return np.concatenate([whitened_row(rest - rest.mean(), colour)[TAPS:] for rest in rests])

    colour = colour_of([rest_at(values)])
    rest = rest_at(values, colour)
    noise = max(robust_rms(rest, torque_step(np.concatenate([reading for _, reading in pairs]))), LEAST_NOISE_NM)
    steps = STEP * values
    slopes = np.column_stack([(rest_at(values + step, colour) - rest) / np.sum(step) for step in np.diag(steps)]) / noise
    free = _free_delays(path)
    if _is_divided(path) or free == (0, 1):  # the reading tells their sum; beside it only that a command may change within a cell
        slopes[:, -1] = 0.0 if _is_divided(path) else slopes[:, -2]
    return ByReading(slopes.T @ slopes + hardly, -slopes.T @ rest / noise, float(rest @ rest) / noise**2)


def _level(fitted: Fitted) -> float:
    return fitted.objective / max(fitted.problem.samples, 1)


def by_path(data: Data, model: Model, path: TorquePath) -> Data:
    """Records with the torque as another path has it, and the motion between the samples by a model.

    Parameters
    ----------
    data : Data
    model : Model
        That tells the motion between the samples.
    path : TorquePath
        In place of that of the records.
    """
    shares = {piece.record: piece.rounding for piece in (*data.fitted, *data.held_out)}
    same = (data.noise_nm, data.step_rad, shares, data.substeps, path, data.reversals, data.colour, data.single)
    return grouped_like(prepare_records(data.recordings, model, *same), data)


def _free_delays(path: TorquePath) -> tuple[int, ...]:
    """Delays that are fitted: the drive's where it is not whole, and both where the reading is late, for it hides a part of the drive's.

    Where nothing else is in the chain and both together are whole, the reading's, and what that loses the drive's gains.
    """
    before, late = _delays(path)
    if _is_divided(path):
        return (1,)
    own = before > WHOLE and (late > WHOLE or abs(before - round(before)) > WHOLE)
    return (*((0,) if own else ()), *((1,) if late > WHOLE or path.instantaneous else ()))


def _is_divided(path: TorquePath) -> bool:
    """True for a whole delay before and behind the torque together, of which the motion alone tells how it is divided."""
    before, late = _delays(path)
    return not _lags(path) and min(before, late) > WHOLE and abs(before + late - round(before + late)) <= WHOLE


def _most(path: TorquePath, values: Array) -> Array:
    """Changes of the values that a first order bears: of a delay part of a period, not below 0; an instant of a reading may be."""
    if path.instantaneous:
        return np.full(len(values), MOST)
    most, first = MOST * values, sum(len(lag.values) for lag in _lags(path))
    delays = slice(first, first + len(_free_delays(path)))
    least = np.minimum(values[delays], path.drive.delay) if path.drive is not None and _is_divided(path) else values[delays]
    most[delays] = np.minimum(MOST, NEARLY_ALL * least)
    return most


def _lags(path: TorquePath) -> tuple[Lag, ...]:
    return (*(path.drive.lags if path.drive is not None else ()), *path.reading.lags)


def _values(path: TorquePath) -> Array:
    """Values of all filters of the drive, then of the reading, then delays that are not whole."""
    return np.array([value for lag in _lags(path) for value in lag.values] + [_delays(path)[place] for place in _free_delays(path)])


def _units(path: TorquePath, values: Array) -> Array:
    """Size of each value for differences; a period for the instant of a reading, which may be 0."""
    return np.ones(len(values)) if path.instantaneous else values


def _delays(path: TorquePath) -> tuple[float, float]:
    return path.drive.delay if path.drive is not None else 0.0, path.reading.late


def _with_values(path: TorquePath, values: Array, halves: Array | None = None) -> TorquePath:
    """The path with other values.   halves : of their intervals at 95 %; None leaves those that it has."""
    place = 0

    def lags(of: tuple[Lag, ...]) -> tuple[Lag, ...]:
        nonlocal place
        found = []
        for lag in of:
            own = tuple(float(v) for v in values[place : place + len(lag.values)])
            known = lag.intervals if halves is None else tuple(float(h) for h in halves[place : place + len(lag.values)])
            place += len(lag.values)
            found.append(replace(lag, values=(min(own[0], 1.0),) if lag.kind == "sampled" else own, intervals=known))
        return tuple(found)

    drive = None if path.drive is None else replace(path.drive, lags=lags(path.drive.lags))
    reading = replace(path.reading, lags=lags(path.reading.lags))
    free = _free_delays(path)
    if drive is not None and 0 in free:
        half = drive.delay_interval if halves is None else float(halves[place])
        drive, place = replace(drive, delay=float(values[place]), delay_interval=half), place + 1
    if 1 in free:
        if drive is not None and _is_divided(path):
            half = drive.delay_interval if halves is None else float(halves[place])
            drive = replace(drive, delay=drive.delay + reading.late - float(values[place]), delay_interval=half)
        reading, place = replace(reading, late=float(values[place])), place + 1
    return replace(path, drive=drive, reading=reading)


def columns_of(data: Data, fitted: Fitted) -> Array | None:
    """Change of the whitened residual with each value of the path, (n, k); None behind observers.

    Parameters
    ----------
    data : Data
    fitted : Fitted
    """
    values = _values(data.path)
    steps = STEP * _units(data.path, values)
    return _changes(data, fitted, [_with_values(data.path, values + step) for step in np.diag(steps)], steps)


def _changes(data: Data, fitted: Fitted, paths: Sequence[TorquePath], over: Sequence[float] | Array) -> Array | None:
    """Change of the whitened residual to each of some paths, over a step of each, (n, k); None behind observers."""
    by_name = {r.name: r for r in data.recordings}
    vector, parts = fitted.problem.full(fitted.x), []
    for piece in fitted.problem.pieces:
        if piece.whitener is None:
            return None
        recording = by_name[piece.record]
        changes = np.zeros((piece.motion.samples, len(paths)))
        every = round(piece.motion.sample_s / recording.sample_period_s)
        if len(recording.t_s) // every == piece.motion.samples:  # of a record with gaps this would be another piece
            motion = true_motion(fitted.model, piece.motion, vector)
            here = acting_torque(fitted.model, motion, piece.torque, vector)
            for k, (path, step) in enumerate(zip(paths, over, strict=True)):
                torque, within = path.acting_torque(recording.torque, recording.torque_setpoint, recording.sample_period_s)
                if every > 1:
                    torque, within = decimate_torque(torque, within, every)
                changes[:, k] = -(acting_torque(fitted.model, replace(motion, within=within), torque, vector) - here) / step
        parts.append(piece.white(changes))
    return np.concatenate(parts)
