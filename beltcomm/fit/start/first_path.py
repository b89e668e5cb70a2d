"""The torque path that a first excited record shows, before any model is known: the split with which a first estimate leaves least."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from beltcomm.fit.noise.level import torque_noise
from beltcomm.fit.path_fit.choice import EXPLAINED, TIMES_S, commands, splits
from beltcomm.fit.start.first_estimate import FirstEstimate, first_estimate
from beltcomm.fit.start.rigid import rigid_estimate
from beltcomm.fit.start.undersampled import comes_seldom, first_of_seldom
from beltcomm.fit.torque.path import FAITHFUL, DriveLaw, Lag, TorquePath
from beltcomm.fit.torque.reading_fit import CLEAR, fit_reading
from beltcomm.model import Model
from beltcomm.recording import Recording

#: Share of its inertia that a data sheet may be wrong by.
SHEET_RIGHT_TO = (0.9, 1.1)


@dataclass(frozen=True)
class FirstPath:
    """A first estimate, and the path to the torque that acts with which it was made."""

    path: TorquePath
    model: Model


def first_path(recording: Recording, start: Model, counts_per_rev: int) -> FirstPath:
    """The path with which the first estimate of a record leaves clearly less torque than with the reading; else the reading's.

    Parameters
    ----------
    recording : Recording
        Short, open loop, excited.
    start : Model
        By the data sheets.
    counts_per_rev : int
        Of the encoder.

    Returns
    -------
    FirstPath
        Path and first estimate.

    Raises
    ------
    DataError
        The axis hardly moved.
    DamagedRecord
        The motor angle jumps.
    """
    if start.rigid:
        return FirstPath(FAITHFUL, rigid_estimate(start, [recording]))
    if comes_seldom(recording):
        return FirstPath(FAITHFUL, first_of_seldom([recording], start))
    chain = fit_reading([recording])
    faithful = TorquePath(chain.law) if chain is not None else FAITHFUL
    first = first_estimate([recording], start, counts_per_rev, faithful)

    def told(path: TorquePath, found: FirstEstimate) -> FirstPath:
        return FirstPath(path, _by_the_sheet(recording, start, counts_per_rev, path, found))

    step = 2.0 * math.pi / counts_per_rev
    if chain is None or _least(recording, start["motor.inertia"], step) >= (1.0 - EXPLAINED) * first.rest:
        return told(faithful, first)
    others = _by_motion(chain.law) if commands(chain, [recording]) else splits(chain.law, chain.at_end)
    trials = [(path, first_estimate([recording], start, counts_per_rev, path)) for path in others if path != faithful]
    path, best = min(trials, key=lambda trial: trial[1].rest, default=(faithful, first))
    return told(path, best) if _is_clearly_better(first, best) else told(faithful, first)


def _by_the_sheet(recording: Recording, start: Model, counts_per_rev: int, path: TorquePath, found: FirstEstimate) -> Model:
    """Model of a first estimate, with an inertia that the data sheet may have unless the one found leaves clearly less torque.

    A short record behind a coarse encoder, or of a motor that swings faster than its rows show, fits nearly as well with half of it.
    """
    low, high = SHEET_RIGHT_TO
    if low <= found.model["motor.inertia"] / start["motor.inertia"] <= high:
        return found.model
    held = first_estimate([recording], start, counts_per_rev, path, SHEET_RIGHT_TO)
    return (found if _is_clearly_better(held, found) else held).model


def _least(recording: Recording, inertia_kg_m2: float, step_rad: float) -> float:
    """Least mean square that the right path leaves, (N m)² at the motor: noise of two neighbouring samples, rounded acceleration."""
    return 0.5 * (torque_noise([recording], 0.0) ** 2 + (inertia_kg_m2 * step_rad / recording.sample_period_s**2) ** 2)


def _is_clearly_better(first: FirstEstimate, other: FirstEstimate) -> bool:
    """True if another estimate leaves so much less torque that it is no chance, and no small part of what is left."""
    if not 0.0 < other.rest < (1.0 - EXPLAINED) * first.rest:
        return False
    return first.samples * math.log(first.rest / other.rest) > math.log(first.samples) + CLEAR


def _by_motion(law: DriveLaw) -> Iterator[TorquePath]:
    """Of a reading that is the command: the command that acts, and what a current loop of some time constants makes of it."""
    yield TorquePath(law, commanded=True)
    for time_s in TIMES_S:
        yield TorquePath(replace(law, lags=(*law.lags, Lag("first order", (time_s,)))), commanded=True)
