"""Torque paths that are tried: every split of a chain between drive and reading, laws of a drive, and families without a setpoint."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from beltcomm.fit.torque.lag import Lag
from beltcomm.fit.torque.laws import DriveLaw, ReadingLaw
from beltcomm.fit.torque.path import TorquePath
from beltcomm.fit.torque.reading_fit import WHOLE

#: Time constants of a reading without setpoint, s, that are tried.
TIMES_S = (2e-4, 5e-4, 1e-3, 2e-3, 4e-3, 8e-3)
#: Time constants of a drive whose reading is its command that are tried, in sampling periods, and the longest, s.
DRIVE_SHARES, LONGEST_S = (0.03, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0), 8e-3
#: Time constants of a current loop without setpoint that are tried, in sampling periods.
LOOP_SHARES = (0.03, 0.1, 0.25, 0.5, 1.0)
#: Lateness of a reading without setpoint that is tried, in sampling periods; between the last two neighbours cancel.
LATE_SHARES = (0.08, 0.2, 0.35, 0.65, 0.8, 1.0)
#: Shares of the period at which the command may change where no setpoint was recorded.
SWITCHING = (0.1, 0.3, 0.5, 0.7, 0.9)
#: Damping ratios of a current loop that are tried.
DAMPING_RATIOS = (0.35, 0.5, 0.7, 1.0)
#: Damping ratio from which on a filter of second order may be two of first.
DAMPED = 0.9


def ways_of(laws: Sequence[tuple[DriveLaw, bool]], sample_s: float, beside: Sequence[TorquePath] = ()) -> list[TorquePath]:
    """All :func:`splits` of chains, and of those with two filters of first order in place of a damped one of second, each once.

    Parameters
    ----------
    laws : sequence of tuple of DriveLaw and bool
        From setpoint to reading, and as of :func:`splits`.
    sample_s : float, s
    beside : sequence of TorquePath
        Ways that are known.
    """

    def key(path: TorquePath) -> tuple[object, ...]:
        return (*kind_of(path, sample_s), path.drive.delay if path.drive is not None else 0.0, path.reading.late)

    found, known = dict[tuple[object, ...], TorquePath](), {key(path) for path in beside}
    for path in (path for law, at_end in laws for one in _split_second_order(law) for path in splits(one, at_end)):
        if key(path) not in known:
            found.setdefault(key(path), path)
    return list(found.values())


def kind_of(path: TorquePath, sample_s: float) -> tuple[object, ...]:
    """Equal for paths whose filters stand on the same side; two of first order are a damped one of second.

    Parameters
    ----------
    path : TorquePath
    sample_s : float, s

    Returns
    -------
    tuple
        Delays of the filters on both sides, in :data:`~beltcomm.fit.torque.reading_fit.WHOLE` of a sample, and what is read.
    """

    def lags_s(law: DriveLaw | ReadingLaw | None) -> int:
        return round(sum(lag.delay_s(sample_s) for lag in law.lags) / (WHOLE * sample_s)) if law is not None else 0

    return lags_s(path.drive), lags_s(path.reading), path.reading.at_end, path.commanded, path.instantaneous


def _split_second_order(law: DriveLaw) -> list[DriveLaw]:
    """The law, and the same with two filters of first order in place of a damped one of second: one of them may be the reading's."""
    found = [law]
    for place, lag in enumerate(law.lags):
        if lag.kind == "second order" and lag.values[1] > DAMPED:
            root = math.sqrt(max(lag.values[1] ** 2 - 1.0, 0.0))
            two = tuple(Lag("first order", ((lag.values[1] + way * root) / (math.tau * lag.values[0]),)) for way in (1.0, -1.0))
            found.append(replace(law, lags=(*law.lags[:place], *two, *law.lags[place + 1 :])))
    return found


def splits(law: DriveLaw, at_end: bool = False) -> Iterator[TorquePath]:
    """Every way to divide a chain between drive and reading; first the one that leaves the reading faithful, if it can be.

    Parameters
    ----------
    at_end : bool
        Whether the reading is the torque at the end of the period.
    """
    whole = math.floor(law.delay + WHOLE)
    part = max(law.delay - whole, 0.0)
    delays = [(law.delay, 0.0)]
    if part > WHOLE:
        delays.append((float(whole), part))
    if whole >= 1:
        delays.append((max(law.delay - 1.0, 0.0), 1.0))
    for before, late in delays:
        # A limit of the slew rate is the drive's, and so is what it is given.
        limited = max((place for place, lag in enumerate(law.lags) if lag.kind == "slew rate"), default=-1)
        for chosen in itertools.product(*(((True,) if place <= limited else (True, False)) for place in range(len(law.lags)))):
            drive = tuple(lag for lag, own in zip(law.lags, chosen, strict=True) if own)
            reading = tuple(lag for lag, own in zip(law.lags, chosen, strict=True) if not own)
            yield TorquePath(DriveLaw(before, drive, law.gain), ReadingLaw(late, reading, at_end))


def lookalikes(law: DriveLaw, sample_s: float) -> list[DriveLaw]:
    """Laws of the drive with the same delay, for the motion to tell from this one where the reading hardly does.

    The part of the delay that is no whole sample may be a step inside the period, a filter of first order, or one of second order with
    more or less damping.

    Parameters
    ----------
    law : DriveLaw
        As found.
    sample_s : float, s
    """
    if len(law.lags) > 1 or any(lag.kind in ("sampled", "slew rate") for lag in law.lags):
        return []
    whole = math.floor(law.delay + WHOLE)
    late_s = law.delay_s(sample_s) - whole * sample_s
    if late_s <= WHOLE * sample_s:
        return []
    second = [Lag("second order", (ratio / (math.pi * late_s), ratio)) for ratio in DAMPING_RATIOS]
    return [DriveLaw(float(whole), (lag,), law.gain) for lag in (Lag("first order", (late_s,)), *second)]


def times_tried(sample_s: float) -> list[float]:
    """Time constants of a drive that are tried, s, rising.

    Parameters
    ----------
    sample_s : float, s
    """
    return [share * sample_s for share in DRIVE_SHARES if share * sample_s <= LONGEST_S]


def instantaneous_paths() -> list[TorquePath]:
    """Paths under a loop that is faster than the record: the reading is the torque at an instant, more or less late."""
    return [TorquePath(None, ReadingLaw(late), instantaneous=True) for late in (0.0, *LATE_SHARES)]


def families_without_setpoint(sample_s: float) -> tuple[Callable[[TorquePath], list[TorquePath]], ...]:
    """Paths without setpoint that have one thing more than another one, for each kind of thing; none where it has that already.

    A reading behind a filter, at the end of the period; a late one; a current loop; one whose reading is the torque at the end of the
    period; a command that changes inside the period; a current loop of second order in place of one of first; one that is faster than the
    record, which has nothing else.

    Parameters
    ----------
    sample_s : float, s
    """

    def drive_of(path: TorquePath) -> DriveLaw:
        return path.drive or DriveLaw(0.0)

    def possible(paths: Iterator[TorquePath]) -> list[TorquePath]:
        return [path for path in paths if path.can_be_undone(sample_s)]

    def filtered(path: TorquePath) -> list[TorquePath]:
        lags = [Lag("first order", (time_s,)) for time_s in TIMES_S]
        return (
            [] if path.reading.lags else possible(replace(path, reading=ReadingLaw(path.reading.late, (lag,), at_end=True)) for lag in lags)
        )

    def late(path: TorquePath) -> list[TorquePath]:
        return [] if path.reading.late else possible(replace(path, reading=replace(path.reading, late=late)) for late in LATE_SHARES)

    def behind_loop(path: TorquePath) -> list[TorquePath]:
        """At the same delay where the command changes inside the period."""
        drive = drive_of(path)
        shares = [share for share in LOOP_SHARES if not drive.delay or share < drive.delay]
        laws = [DriveLaw(max(drive.delay - share, 0.0), (Lag("first order", (share * sample_s,)),)) for share in shares]
        return [] if drive.lags else possible(replace(path, drive=law) for law in laws)

    def read_at_end(path: TorquePath) -> list[TorquePath]:
        if path.reading.at_end:
            return []
        at_end = [replace(path, reading=replace(path.reading, at_end=True, late=late)) for late in (0.0, *LATE_SHARES[1:-1])]
        return possible(iter(at_end)) if drive_of(path).lags else [behind for one in at_end for behind in behind_loop(one)]

    def switched(path: TorquePath) -> list[TorquePath]:
        return [] if drive_of(path).delay else possible(replace(path, drive=replace(drive_of(path), delay=part)) for part in SWITCHING)

    def of_second_order(path: TorquePath) -> list[TorquePath]:
        lags = drive_of(path).lags
        if len(lags) != 1 or lags[0].kind != "first order":
            return []
        others = [Lag("second order", (ratio / (math.pi * lags[0].values[0]), ratio)) for ratio in DAMPING_RATIOS]
        return possible(replace(path, drive=replace(drive_of(path), lags=(lag,))) for lag in others)

    def instantaneous(path: TorquePath) -> list[TorquePath]:
        plain = path.reading.faithful and path.drive is None
        return [replace(one, without_setpoint=True) for one in instantaneous_paths()] if plain else []

    held = (filtered, late, behind_loop, read_at_end, switched, of_second_order)
    return instantaneous, *((lambda path, family=family: [] if path.instantaneous else family(path)) for family in held)
