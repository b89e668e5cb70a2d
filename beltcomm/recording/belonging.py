"""Torque and motion of one axis at one time: the share of the torque that the motion explains, beside chance.

    torque = inertia acceleration + damping speed + level sign(speed) + stiffness position + constant,   and a law of the place,

each as a mean under triangles of many widths, judged on parts of the record that did not make the numbers.  Chance is the same torque,
shifted in time: it has the same course and the same spectrum, and belongs to this motion no more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz

from beltcomm.arrays import Array, BoolArray, rms
from beltcomm.recording.checks import triangle_mean, usual_step
from beltcomm.recording.sampling import finest

#: Explained share of the torque from which it belongs beyond doubt, and below which it does not: of the real records at hand 30 to 100 %
#: are explained, of shuffled ones and those of other records seldom a tenth.
SURE, NOTHING = 0.3, 0.15
#: Share of the shifted torques of which a true one is explained better.
BEYOND = 0.95
#: Share that all rows of a record explain together where its parts do not tell, and what it leaves over what chance leaves, at most.
_WHOLE, _FAR_BETTER = 0.9, 0.2
#: Shifts of the torque, as shares of the record: none is a fraction of small numbers, for excitations repeat.
_SHIFTS = tuple(((0.618033988749895 * k) % 0.8) + 0.1 for k in range(1, 30))
#: Rows that are looked at, windows that a width needs, parts of the record that judge in turn, and bins of the place.
_MOST_ROWS, _FEWEST_WINDOWS, _PARTS, _BINS = 20_000, 64, 8, 120
#: Columns of a rigid body with friction; rad, part of a turn from which a law of the angle is told from one of the place.
_PLAIN, _TURNS = 4, 1.0
#: Steps of its encoder that a motion spans at least: one of two or three of them hardly follows any torque.
_FEWEST_STEPS = 6
#: Deviation of a position over that of its own noise, 1 for noise alone, that shows a motion at least.
_ABOVE_NOISE = 1.5
#: Variance of a third difference over that of its white noise.
_THIRD = 20.0
#: By how much a position may be rougher than a torque, and be one.
_ROUGHER = 2.0
#: s of torques, past or to come, that an acceleration is explained by, and of late readings that both may use; rows, at least and at
#: most, and of the record for each; share of the spectrum's mean that is added, for excitations leave frequencies out.
_RINGS_S, _LATE_S, _FEWEST_LAGS, _MOST_LAGS, _ROWS_A_LAG, _FLOOR = 0.15, 0.01, 60, 400, 20, 1e-6
#: What past torques leave of an acceleration over what those to come leave, from which the effect stands before its cause (of 156 drawn
#: records none is above 1.02, of the real ones at hand none above 1.06); share that those to come explain at least.
_BEFORE, _EXPLAINED = 1.5, 0.1


@dataclass(frozen=True)
class Belonging:
    """Share of a record's torque that belongs to its motion.

    Attributes
    ----------
    explained : float
        Largest share of the torque, under any width, that the motion explains.
    chance : float
        The same of shifted torques, the share BEYOND of them lies below it; 0 where it was not needed.
    swapped : bool
        The torque and the position changed places.
    """

    explained: float
    chance: float = 0.0
    swapped: bool = False

    @property
    def consistent(self) -> bool:
        """True if they may belong together: refused only where the motion explains no more than chance."""
        return not self.swapped and (self.explained >= SURE or self.explained > max(self.chance, NOTHING))


def belonging(t_s: Array, torque: Array, position: Array) -> Belonging | None:
    """Evidence that a torque and a motion belong together.

    Parameters
    ----------
    t_s, torque, position : ndarray, (n,)
        s, and any units.

    Returns
    -------
    Belonging or None
        None for a record that is too short to tell, or moves by a few steps of its encoder or within its noise only.
    """
    t_s, torque, position = t_s[:_MOST_ROWS], torque[:_MOST_ROWS], position[:_MOST_ROWS]
    if len(position) < _FEWEST_WINDOWS or np.ptp(position) < _FEWEST_STEPS * finest(position):
        return None
    if np.std(position) < _ABOVE_NOISE * float(np.std(np.diff(position, 3))) / np.sqrt(_THIRD):
        return None
    even = np.arange(t_s[0], t_s[-1], usual_step(t_s))
    torque, position = np.interp(even, t_s, torque), np.interp(even, t_s, position)
    if len(even) < 2 * _FEWEST_WINDOWS or np.ptp(position) == 0.0 or np.ptp(torque) == 0.0:
        return None
    laws = _laws(position)
    if not laws:
        return None
    explained = _best(laws, torque)
    if roughness(position) > _ROUGHER * roughness(torque):
        turned = _laws(torque)
        if turned and (other := _best(turned, position)) > max(SURE, explained):
            return Belonging(explained, other, swapped=True)
    if explained < NOTHING:
        return _of_one_stroke(laws, torque) or Belonging(explained)
    if explained >= SURE:
        return Belonging(explained)
    chances = sorted(_best(laws, np.roll(torque, round(shift * len(torque)))) for shift in _SHIFTS)
    return Belonging(explained, chances[min(round(BEYOND * len(chances)), len(chances) - 1)])


def _of_one_stroke(laws: list[_Law], torque: Array) -> Belonging | None:
    """Evidence of a record that moves too seldom to be judged by its own parts; None where there is none.

    Of one stroke no part may hold an acceleration, and it foretells nothing of the others.  All rows together may be explained by
    chance, too: by the same torque at other times, far worse.
    """
    whole = max(_fitted(law, torque) for law in laws)
    if whole < _WHOLE:
        return None
    chance = max(max(_fitted(law, np.roll(torque, round(shift * len(torque)))) for law in laws) for shift in _SHIFTS)
    return Belonging(whole, chance) if 1.0 - whole < _FAR_BETTER * (1.0 - chance) else None


def _unexplained_by(t_s: Array, torque: Array, position: Array) -> tuple[float, float] | None:
    """Shares of the acceleration, 0 to 1, that past torques, and torques to come, leave unexplained; None for a record that is too short.

    A finite impulse response by least squares, where nothing feeds the motion back.  A load that swings goes on after its torque, so the
    past leaves less; beside a rigid body both leave alike.
    """
    period = usual_step(t_s)
    lags = min(max(round(_RINGS_S / period), _FEWEST_LAGS), _MOST_LAGS)
    late = min(max(round(_LATE_S / period), 2), lags // 4)
    even = np.arange(t_s[0], t_s[min(len(t_s), _MOST_ROWS) - 1], period)
    if len(even) < _ROWS_A_LAG * lags:
        return None
    cause, effect = np.interp(even, t_s, torque)[1:-1], np.diff(np.interp(even, t_s, position), 2)
    cause, effect = cause - cause.mean(), effect - effect.mean()
    spectra = [np.fft.rfft(signal, 2 * len(signal)) for signal in (cause, effect)]
    own = np.fft.irfft(np.abs(spectra[0]) ** 2)[: lags + late + 1]
    power = float(effect @ effect)
    if own[0] <= 0.0 or power <= 0.0:
        return None
    own[0] *= 1.0 + _FLOOR
    shared = np.fft.irfft(spectra[1] * spectra[0].conj())
    past, ahead = (np.roll(one, late)[: lags + late + 1] for one in (shared, np.roll(shared[::-1], 1)))
    left = [max(1.0 - float(one @ solve_toeplitz(own, one)) / power, 0.0) for one in (past, ahead)]
    return left[0], left[1]


def moves_before_torque(t_s: Array, torque: Array, position: Array) -> bool:
    """True if torques to come explain the acceleration, and past ones do not: time runs backwards, where nothing feeds the motion back.

    Parameters
    ----------
    t_s, torque, position : ndarray, (n,)
        s, and any units.

    Returns
    -------
    bool
        False for a record that is too short to tell.
    """
    left = _unexplained_by(t_s, torque, position)
    return left is not None and left[1] < 1.0 - _EXPLAINED and left[0] > _BEFORE * left[1]


@dataclass(frozen=True, eq=False)
class _Law:
    """The regression under one width.   columns : ndarray (n, 9).   bins : (n,), place and direction of each window: a law of the place.

    parts : of each half that judges, which windows make the numbers, and what makes them: pseudo-inverses of the first columns, and of all.
    """

    width: int
    columns: Array
    bins: NDArray[np.intp]
    parts: tuple[tuple[BoolArray, tuple[Array, ...]], ...]


def _laws(position: Array) -> list[_Law]:
    found = []
    width = 1
    # over a small part of a turn sine and cosine are a parabola, which goes astray beyond the rows that made it
    rotary = (np.sin(position), np.cos(position)) if np.ptp(position) > _TURNS else ()
    while len(position) // max(1, width // 2) >= _FEWEST_WINDOWS and len(position) > 8 * width:
        every = max(1, width // 2)
        before, middle, after = position[: -2 * width], position[width:-width], position[2 * width :]
        acceleration, speed = (after - 2.0 * middle + before)[::every], (after - before)[::every]
        direction = triangle_mean(np.sign(np.gradient(position)), width)[::every][: len(speed)]
        later, earlier = np.roll(acceleration, -1), np.roll(acceleration, 1)
        place = [middle[::every], *(triangle_mean(part, width)[::every][: len(speed)] for part in rotary)]
        columns = np.column_stack([np.ones(len(speed)), acceleration, speed, direction, earlier, later, *place])
        scale = np.maximum(np.abs(columns).max(axis=0), 1e-300)
        bins = np.floor((middle[::every] - position.min()) / max(float(np.ptp(position)), 1e-300) * (_BINS - 1e-9)).astype(np.intp)
        columns /= scale
        half = (np.arange(len(columns)) * _PARTS // len(columns)) % 2
        parts = tuple((made, _inverses(columns[made])) for made in (half == 0, half == 1))
        found.append(_Law(width, columns, 2 * bins + (direction > 0.0), parts))
        width *= 2
    return found


def _inverses(columns: Array) -> tuple[Array, ...]:
    """Pseudo-inverses of the first columns, and of all; by one QR, whose triangle is small."""
    q, r = np.linalg.qr(columns)
    return tuple(np.linalg.pinv(r[:few, :few], rcond=1e-8) @ q[:, :few].T for few in (_PLAIN, columns.shape[1]))


def _fitted(law: _Law, torque: Array) -> float:
    """Share of the torque's means that a rigid body with friction explains, of the rows that made its numbers."""
    force = triangle_mean(torque, law.width)[:: max(1, law.width // 2)][: len(law.columns)]
    columns = law.columns[: len(force), :_PLAIN]
    rest = force - columns @ np.linalg.lstsq(columns, force, rcond=1e-8)[0]
    there = float(np.sum((force - force.mean()) ** 2))
    return 1.0 - float(rest @ rest) / there if there > 0.0 else 0.0


def _best(laws: list[_Law], torque: Array) -> float:
    return max(_explained(law, torque) for law in laws)


def _explained(law: _Law, torque: Array) -> float:
    """Share of the torque's means that is explained, in parts that others made the numbers for."""
    force = triangle_mean(torque, law.width)[:: max(1, law.width // 2)][: len(law.columns)]
    if len(force) < len(law.columns):
        force = np.append(force, np.full(len(law.columns) - len(force), force[-1]))
    left, there = np.zeros(3), 0.0
    for made, inverses in law.parts:
        seen = ~made
        there += float(np.sum((force[seen] - force[made].mean()) ** 2))
        rest = force
        for k, inverse in enumerate(inverses):
            rest = force - law.columns[:, : len(inverse)] @ (inverse @ force[made])
            left[k] += float(rest[seen] @ rest[seen])
        count = np.bincount(law.bins[made], minlength=2 * _BINS)
        means = np.bincount(law.bins[made], rest[made], minlength=2 * _BINS) / np.maximum(count, 1)
        placed = rest[seen] - means[law.bins[seen]]
        left[2] += float(placed @ placed)
    return 1.0 - float(left.min()) / there if there > 0.0 else 0.0


def roughness(signal: Array) -> float:
    """Roughness of a signal: rms of its steps over its standard deviation.

    Parameters
    ----------
    signal : ndarray, (n,)
        Any unit.

    Returns
    -------
    float
        √2 for white noise.
    """
    return rms(np.diff(signal)) / max(float(signal.std()), 1e-300)
