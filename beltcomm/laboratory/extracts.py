"""Extracts of long records: the stretches that tell most, where all of it would take hours and add next to nothing.

A record of an hour repeats itself.  It is divided into windows that begin where the axis is slowest, and each window says how much it tells
of a rigid axis with friction: the matrix Σ φφᵀ of the regression

    torque = φ·parameters,   φ = (acceleration, speed, speed|speed|, constant, fast torque; direction by place, by speed and by time).

Those in which the regression over all leaves most torque are taken, for there something happens that it does not know.  Then, one by one,
the window that raises ln det of the sum most per row (D-optimal design), so that every place, speed and time of the record is seen.
Source: Fedorov, Theory of Optimal Experiments, 1972, the gain in ln det of one more measurement.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from beltcomm.arrays import Array
from beltcomm.axis import Axis
from beltcomm.errors import DataError
from beltcomm.laboratory.gap_checks import first_rows
from beltcomm.laboratory.place_checks import names_of
from beltcomm.recording import Recording
from beltcomm.recording.columns import COMMON

#: Rows of a record above which an extract stands for it, and of all extracts together.
LONG_ROWS, EXTRACT_ROWS = 120_000, 72_000
#: s; shortest window, how many times as long one may be so that the next begins at rest, and how long it must have rested: behind a belt
#: the carriage swings on, and nobody knows how.
SHORTEST_S, REACHES, REST_S = 3.0, (2, 5), 0.1
#: s over which acceleration and speed are taken: the belt's resonance is left to the fast torque.
SPAN_S = 0.016
#: Share of the rows that go to the windows which a rigid axis explains least.
ODD_SHARE = 0.35
#: Bins of place, speed and time, in each of which friction is told apart; speed over its rms below which the axis has no direction.
PLACES, SPEEDS, TIMES, SLOW = 8, 5, 4, 0.02
_FAST, _FIRST_BIN = 4, 5
_NAMES = ("torque_setpoint", "velocity", "reference_position", "reference_velocity", "torque_offset", *COMMON)


@dataclass(frozen=True, eq=False)
class Extract:
    """Rows ``first`` to ``last`` of a record.

    Attributes
    ----------
    told : ndarray (k, k)
        Σ φφᵀ.
    moment : ndarray (k,)
        Σ φ torque.
    power : float
        Σ torque².
    """

    record: int
    first: int
    last: int
    told: Array
    moment: Array
    power: float
    count: int

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.last - self.first


def extract_long(records: Sequence[Recording], axis: Axis, remarks: list[str]) -> dict[str, list[Recording]]:
    """Extracts that stand for each long record, by its name: stretches of it, each a record of its own, called ``NAME@SECONDSs``.

    Records to fit and those held out are chosen among themselves.

    Parameters
    ----------
    records : sequence of Recording
        Of the run.
    axis : Axis
    remarks : list of str
        Gets further ones.
    """
    long = [r for r in records if len(r.t_s) > LONG_ROWS]
    chosen: dict[str, list[Recording]] = {}
    for held_out in (False, True):
        alike = [r for r in long if r.sidecar.held_out is held_out]
        excited = [r for r in alike if r.sidecar.excitation is not None]
        chosen |= {r.name: [_periods(r)] for r in excited}
        chosen |= _stretches([r for r in alike if r.sidecar.excitation is None], axis, remarks)
    if any(r.name in chosen for r in long if r.sidecar.excitation is not None):
        some = [r for r in long if r.sidecar.excitation is not None]
        rows = max(len(chosen[r.name][0].t_s) for r in some)
        remarks.append(f"{names_of(some)}: long and excited all along; the first periods count, up to {rows} rows of each")
    return chosen


def _periods(record: Recording) -> Recording:
    """The first whole periods of an excited record: the others repeat them."""
    note = record.sidecar.excitation
    assert note is not None
    size, first = note.period_samples or EXTRACT_ROWS, note.first_sample
    rows = first + size * max(2 if note.period_samples else 1, (EXTRACT_ROWS - first) // size)
    starts = note.period_starts
    if starts is not None:
        starts = tuple(start for start in starts if start + size <= rows) or starts[:1]
        rows = max(rows, starts[-1] + size)
    cut = first_rows(record, min(rows, len(record.t_s)))
    return record if cut is None else replace(cut, notes=(), sidecar=replace(cut.sidecar, excitation=replace(note, period_starts=starts)))


def _stretches(records: Sequence[Recording], axis: Axis, remarks: list[str]) -> dict[str, list[Recording]]:
    """The stretches of these records that tell most, by record."""
    if not records:
        return {}
    windows = _windows_of(records)
    taken = _best_windows(windows, EXTRACT_ROWS)
    found: dict[str, list[Recording]] = {}
    for number, record in enumerate(records):
        own = sorted((w for w in taken if w.record == number), key=lambda w: w.first)
        spans: list[list[int]] = []
        for window in own:
            if spans and spans[-1][1] == window.first:
                spans[-1][1] = window.last
            else:
                spans.append([window.first, window.last])
        parts = [part for first, last in spans if (part := _cut_out(record, first, last, axis)) is not None]
        found[record.name] = parts
    parts = [part for each in found.values() for part in each]
    if not parts:
        return {}
    seconds, whole = (sum(r.duration_s for r in some) for some in (parts, records))
    remarks.append(
        f"{names_of(records)}: of {whole:.0f} s, {seconds:.0f} s in {len(parts)} stretches count, those that tell most of inertia and of "
        f"friction by place, speed and time, and those that a rigid axis explains least; all of it would tell the inertia "
        f"{_certainty(windows, taken):.2g} times as exactly and take {whole / max(seconds, 1e-9):.0f} times as long"
    )
    return found


def _windows_of(records: Sequence[Recording]) -> list[Extract]:
    """All windows of some records, with what they tell in units that are the same for all."""
    signals = [_Signals(r) for r in records]
    every = [np.concatenate(column) for column in zip(*(s.seen() for s in signals), strict=True)]
    scale = np.array([max(float(np.sqrt(np.mean(column**2))), 1e-300) for column in every[:4]])
    speeds = np.quantile(np.abs(every[1]), np.linspace(0.0, 1.0, SPEEDS + 1)[1:-1])
    low = min(float(r.position.min()) for r in records)
    high = max(float(r.position.max()) for r in records)
    windows = []
    for number, one in enumerate(signals):
        for first, last in itertools.pairwise(one.cuts()):
            found = _window_information(one, first, last, scale, speeds, (low, high), number / len(signals), 1.0 / len(signals))
            if found is not None:
                windows.append(Extract(number, first, last, *found))
    return windows


class _Signals:
    """A record as the regression sees it, every half span.   step : rows between two of its samples."""

    def __init__(self, record: Recording) -> None:
        period = record.sample_period_s
        self.record, self.width = record, max(2, 2 * round(0.5 * SPAN_S / period))
        self.step, self.shortest, self.hold = self.width // 2, round(SHORTEST_S / period), round(REST_S / period)
        width, position = self.width, record.position
        before, middle, after = position[: -2 * width], position[width:-width], position[2 * width :]
        span = width * period
        self.acceleration = ((after - 2.0 * middle + before) / span**2)[:: self.step]
        self.speed = ((after - before) / (2.0 * span))[:: self.step]
        total = np.concatenate(([0.0], np.cumsum(record.torque)))
        mean = (total[width:] - total[:-width]) / width
        total = np.concatenate(([0.0], np.cumsum(mean)))
        smooth = (total[width:] - total[:-width]) / width  # under a triangle, as the second difference has the acceleration
        length = len(middle)
        self.torque = smooth[1:][:length][:: self.step]
        fast = record.torque[width : width + length] - smooth[1:][:length]
        self.fast = fast[:: self.step]
        self.place = middle[:: self.step]

    def seen(self, part: slice = slice(None)) -> tuple[Array, Array, Array, Array]:
        """Acceleration, speed, speed squared with its sign, fast torque."""
        speed = self.speed[part]
        return self.acceleration[part], speed, speed * np.abs(speed), self.fast[part]

    def cuts(self) -> list[int]:
        """Rows at which the windows begin: at rest, where there is one within reach, else where the axis is slowest."""
        rows, hold = len(self.record.t_s), max(1, self.hold // self.step)
        way = np.concatenate(([0.0], np.cumsum(np.abs(self.speed))))
        moved = way[hold:] - way[:-hold]  # before, over the time that it must rest
        rest = SLOW * hold * float(np.sqrt(np.mean(self.speed**2)))
        cuts = [0]
        while rows - cuts[-1] > 2 * self.shortest:
            last = cuts[-1]
            for reach in REACHES:
                first, end = ((last + times * self.shortest - self.width) // self.step - hold for times in (1, reach))
                near = moved[max(first, 0) : max(end, 0)]
                if len(near) and (near.min() <= rest or reach == REACHES[-1]):
                    break
            if not len(near):
                break
            cuts.append(self.width + self.step * (max(first, 0) + int(np.argmin(near)) + hold))
        return [*cuts, rows]


def _window_information(
    one: _Signals, first: int, last: int, scale: Array, speeds: Array, places: tuple[float, float], begin: float, share: float
) -> tuple[Array, Array, float, int] | None:
    """Information of a window, see :class:`Extract`; None where it is too short."""
    part = slice(max(first - one.width, 0) // one.step + 1, max((last - one.width) // one.step, 0))
    speed, torque = one.speed[part], one.torque[part]
    if len(speed) < 8:
        return None
    columns = [column / s for column, s in zip(one.seen(part), scale, strict=True)]
    direction = np.sign(speed) * (np.abs(speed) > SLOW * scale[1])
    at = np.minimum(PLACES * (one.place[part] - places[0]) / max(places[1] - places[0], 1e-300), PLACES - 1).astype(int)
    fast = np.searchsorted(speeds, np.abs(speed))
    when = int(TIMES * (begin + share * 0.5 * (first + last) / len(one.record.t_s)))
    phi = np.zeros((len(speed), _FIRST_BIN + PLACES + SPEEDS + TIMES))
    phi[:, :3], phi[:, 3], phi[:, _FAST] = np.column_stack(columns[:3]), 1.0, columns[3]
    rows = np.arange(len(speed))
    phi[rows, _FIRST_BIN + at] = direction
    phi[rows, _FIRST_BIN + PLACES + fast] = direction
    phi[:, _FIRST_BIN + PLACES + SPEEDS + min(when, TIMES - 1)] = direction
    known = phi.copy()
    known[:, _FAST] = 0.0  # of the torque itself
    return phi.T @ phi, known.T @ torque, float(torque @ torque), len(speed)


def _best_windows(windows: Sequence[Extract], most_rows: int) -> list[Extract]:
    """Windows of so many rows: the oddest, in which the regression over all leaves most, at least one; then those that tell most."""
    told = np.array([w.told for w in windows])
    rows = np.array([w.rows for w in windows], dtype=np.float64)
    total = told.sum(axis=0)
    present = np.eye(len(total)) * (1e-3 * np.trace(total) / len(total) / len(windows))
    free, taken, used = np.ones(len(windows), dtype=bool), [], 0.0

    def take(number: int) -> None:
        nonlocal present, used
        present, used, free[number] = present + told[number], used + rows[number], False
        taken.append(windows[number])

    for number in np.argsort(-_regression_residual(windows), kind="stable"):
        if not taken or used + rows[number] <= ODD_SHARE * most_rows:
            take(int(number))
    while free.any() and used < most_rows:
        gain = (np.linalg.slogdet(present + told)[1] - np.linalg.slogdet(present)[1]) / rows
        take(int(np.argmax(np.where(free, gain, -math.inf))))
    return taken


def _regression_residual(windows: Sequence[Extract]) -> Array:
    """Mean squared torque that the regression over all windows leaves in each."""
    known = np.arange(len(windows[0].moment)) != _FAST
    told = np.array([w.told for w in windows])[:, known][:, :, known]
    moment = np.array([w.moment for w in windows])[:, known]
    found = np.linalg.lstsq(told.sum(axis=0), moment.sum(axis=0), rcond=1e-10)[0]
    power = np.array([w.power for w in windows]) - 2.0 * moment @ found + np.einsum("i,nij,j->n", found, told, found)
    return np.asarray(power / np.array([w.count for w in windows]))


def _certainty(windows: Sequence[Extract], taken: Sequence[Extract]) -> float:
    """Ratio of the deviations of the inertia by the windows taken and by all windows."""
    whole, chosen = (np.linalg.pinv(np.sum([w.told for w in some], axis=0), rcond=1e-10, hermitian=True) for some in (windows, taken))
    return math.sqrt(max(float(chosen[0, 0] / whole[0, 0]), 1.0))


def _cut_out(record: Recording, first: int, last: int, axis: Axis) -> Recording | None:
    """Rows of a record as one of their own, at their place and time; None where nothing moves in them."""
    part = slice(first, last)
    cut: dict[str, Any] = {name: values[part] for name in _NAMES if (values := getattr(record, name)) is not None}
    since, ratio = float(record.t_s[first] - record.t_s[0]), axis.known_transmission_m_rad if record.side != "load" else 1.0
    start = record.sidecar.start_position_m
    moved = None if start is None or ratio is None else start + ratio * float(record.position[first] - record.position[0])
    note = replace(record.sidecar, start_position_m=moved, session_time_s=(record.sidecar.session_time_s or 0.0) + since)
    extra = {name: column[part] for name, column in record.extra.items()}
    try:
        return replace(
            record,
            name=f"{record.name}@{since:.0f}s",
            t_s=record.t_s[part],
            torque=record.torque[part],
            position=record.position[part],
            sidecar=note,
            notes=(),
            extra=extra,
            **cut,
        )
    except DataError:  # nothing moves there, or its torque rests at an end of its range by chance
        return None
