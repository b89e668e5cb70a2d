"""An excitation on top of a travel at constant speed, there and back: the motor turns one way and friction is a constant (3.3.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array, BoolArray
from beltcomm.errors import UsageError
from beltcomm.excitation.record import Excitation

#: s: rest before, between and after strokes, and constant speed behind the last period of a stroke.
REST_S, TAIL_S = 0.15, 0.02


@dataclass(frozen=True, eq=False)
class MovingExcitation:
    """Strokes with an excitation in each; arrays (n,), read-only.

    Attributes
    ----------
    base_m, base_m_s : ndarray
        Where and how fast the carriage travels without the excitation, from where it begins.
    added : ndarray
        What is added, in the unit of the excitation.
    period_samples : int
        Of the excitation.
    starts : tuple of int
        First samples of the periods that count.
    excited : ndarray (n,) of bool
        Bool: the excitation's run-in and periods.
    """

    base_m: Array
    base_m_s: Array
    added: Array
    period_samples: int
    starts: tuple[int, ...]
    excited: BoolArray

    def __post_init__(self) -> None:
        for name in ("base_m", "base_m_s", "added", "excited"):
            getattr(self, name).setflags(write=False)

    def louder(self, factor: float) -> MovingExcitation:
        """Travel with a louder excitation: ``factor`` times what is added."""
        return MovingExcitation(self.base_m, self.base_m_s, factor * self.added, self.period_samples, self.starts, self.excited)


def ramp_s(speed_m_s: float, acceleration_m_s2: float) -> float:
    """Time of a raised cosine from rest to a speed:  π v/2a.

    Parameters
    ----------
    speed_m_s : float, m/s
        Of the carriage, either way.
    acceleration_m_s2 : float, m/s²
        Largest of the ramp.

    Returns
    -------
    float, s
    """
    return math.pi * abs(speed_m_s) / (2.0 * acceleration_m_s2)


def stroke_m(speed_m_s: float, ramp: float, settle: float, excited: float) -> float:
    """Way of one stroke:  |v| (ramp + settle + excited + tail).

    Parameters
    ----------
    speed_m_s : float, m/s
        Of the carriage, either way.
    ramp, settle, excited : float, s
        Of ramp, settling, and run-in with all periods.

    Returns
    -------
    float, m
    """
    return abs(speed_m_s) * (ramp + settle + excited + TAIL_S)


def moving_excitation(excitation: Excitation, speed_m_s: float, strokes: int, ramp: float, settle: float) -> MovingExcitation:
    """Strokes at ``speed_m_s`` (its sign: the first one's), each with the run-in and all periods of ``excitation``.

    Each stroke: rest, raised-cosine ramp, constant speed for ``settle``, lead-in, run-in and periods, tail, ramp.  With speed 0 the
    carriage stands.

    Parameters
    ----------
    excitation : Excitation
        That is added while the speed is constant.
    speed_m_s : float, m/s
        Of the carriage.
    strokes : int
        One after the other, there and back.
    ramp, settle : float, s

    Raises
    ------
    UsageError
        For less than one stroke.
    """
    if strokes < 1:
        raise UsageError(f"{strokes} strokes hold no excitation; at least one is needed")
    sample_s = excitation.sample_period_s
    period, first = excitation.period_samples, excitation.first_sample
    end = first + excitation.repeats * period
    lead = first - 1 - int(excitation.parameters["run_in_periods"]) * period  # one sample brings in the momentum
    burst = excitation.torque[lead : end + 1]
    rest, rise, steady, tail = (round(s / sample_s) for s in (REST_S, ramp, settle, TAIL_S))
    up = 0.5 * (1.0 - np.cos(np.pi * (np.arange(rise) + 0.5) / max(rise, 1)))
    speed = np.concatenate((np.zeros(rest), up, np.ones(steady + len(burst) + tail), up[::-1]))
    added = np.concatenate((np.zeros(rest + rise + steady), burst, np.zeros(tail + rise)))
    excited = np.zeros(len(added), dtype=bool)
    excited[rest + rise + steady : rest + rise + steady + len(burst)] = True
    signs = [1.0 if k % 2 == 0 else -1.0 for k in range(strokes)]
    after = np.zeros(rest)
    base = speed_m_s * np.concatenate([*(sign * speed for sign in signs), after])
    starts = tuple(
        k * len(speed) + rest + rise + steady + first - lead + i * period for k in range(strokes) for i in range(excitation.repeats)
    )
    return MovingExcitation(
        np.concatenate(([0.0], np.cumsum(base[:-1]))) * sample_s,
        base,
        np.concatenate((np.tile(added, strokes), after)),
        period,
        starts,
        np.concatenate((np.tile(excited, strokes), np.zeros(rest, dtype=bool))),
    )
