"""Noise of a torque signal: from its setpoint, from an excitation that repeats, or from what is rough between its jumps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array, robust_deviation
from beltcomm.recording import Recording

#: Order of the differences that a smooth torque hardly has, and the higher ones that a fast but smooth excitation has less of.
ORDER, HIGHER = 4, (6, 8)
#: Values from which on a torque that comes in steps is read so: a switched excitation has two.
READ = 20
#: Share by which a higher order must be lower to count: the estimates of one white noise scatter by some per cent.
CLEARLY = 1.25
#: Quantile of |x| of a normal x that a quarter stays below; deviations from which on a step between two rows is a jump; share of the
#: rows that jumps must touch to be left out, for the median bears a few; rows that must be left.
QUARTER, JUMP, TOUCHED, FEWEST = 0.3186, 8.0, 0.1, 200
#: Times what is rough otherwise that what two periods differ by may have: more, and the torque does not repeat so.
REPEATING = 2.0
#: Share of the values that are the same a period later, and share of the torque that they differ by, of a command that comes back.
SAME, NO_NOISE = 0.3, 2e-3
#: Share of the rows in which a command in steps stays the same; one read in coarse steps changes more often.
HELD = 0.98
#: Correlations of neighbours from which on noise has a colour between periods, from which on beside a setpoint, and up to which;
#: distance of that two apart from its square.
COLOURED, LEAST_COLOUR, MOST_COLOUR, LIKE_FIRST_ORDER = 0.25, 0.1, 0.98, 0.08
#: Share of the torque's own deviation above which the roughness of a record that may be excited is the excitation, as far as anybody knows.
MOSTLY = 0.1
#: Error over the noise below which the noise is not what it was taken for: healthy machines leave 0.93 and more.
TOO_LITTLE = 0.8
#: Rows of a part whose power spectrum is taken, bands that it is divided into, and bands that must agree to be white noise: behind its
#: band a multisine leaves nothing else, however fast it is.
PART, BANDS, AGREEING = 512, 16, 3
#: Deviations beyond which a sample counts no more.
OUTLIER = 4.0
#: Kinds of records in which the torque may jump from row to row: of a free one nobody said what it is.
RESTLESS = ("frf", "free")

_REMEDY = (
    "Import the setpoint too (torque_setpoint_nm), state --excitation and --period-samples of a record of two periods, or add a stroke at "
    "constant speed."
)


@dataclass(frozen=True)
class Level:
    """Noise level of a torque signal.

    Attributes
    ----------
    nm : float
        N m rms.
    told : bool
        Whether it is surely noise, not excitation.
    colour : float
        Correlation of neighbours, 0 of white noise.
    """

    nm: float
    told: bool
    colour: float = 0.0


def torque_noise(recordings: Sequence[Recording], quiet_nm: float = 1e-3) -> float:
    """Noise of the torque signal: what a short filter of the setpoint does not explain; the median over the records.

    Where no record has a setpoint it is of the calmest records, by what periods or differences leave: ``_without_setpoint``.

    Parameters
    ----------
    recordings : sequence of Recording
        One at least.
    quiet_nm : float
        Least that is taken, N m rms.

    Returns
    -------
    float
        N m rms, motor shaft.
    """
    return max(_level(recordings).nm, quiet_nm)


def repeats_itself(recordings: Sequence[Recording]) -> bool:
    """True for a torque that repeats from period to period as no measured one does: most values the same, others a step or two apart.

    Parameters
    ----------
    recordings : sequence of Recording
        Those without periods do not count.

    Returns
    -------
    bool
        By one of them.
    """
    for recording in recordings:
        repeated, note = _period_difference(recording), recording.sidecar.excitation
        if repeated is None or note is None or len(repeated) < (note.period_samples or 0):
            continue
        if np.mean(repeated == 0.0) > SAME and float(np.std(repeated)) < NO_NOISE * float(np.std(recording.torque)):
            return True
    return False


def is_held(recordings: Sequence[Recording]) -> bool:
    """True for a torque that stays the same from row to row as no measured one does: a command in steps, logged as what acted.

    Parameters
    ----------
    recordings : sequence of Recording
        All must be so.

    Returns
    -------
    bool
        False without any.
    """
    shares = [float(np.mean(np.diff(r.torque) == 0.0)) for r in recordings if len(r.torque) > 1]
    return bool(shares) and min(shares) > HELD


def noise_colour(recordings: Sequence[Recording]) -> float:
    """Correlation of neighbours of the torque's noise where no record has a setpoint and periods show it; 0 of white noise.

    Parameters
    ----------
    recordings : sequence of Recording
        One at least.

    Returns
    -------
    float
        Pole of first order.
    """
    return _level(recordings).colour


def torque_step(torque: Array) -> float:
    """Step in which a torque is read, N m: the least difference of its values, what rounding of the file makes of them left aside.

    Parameters
    ----------
    torque : ndarray, (n,), N m
        As it was read.

    Returns
    -------
    float
        N m; 0 for one that never changes.
    """
    gaps = np.diff(np.unique(torque))
    real = gaps[gaps > 1e-9 * float(np.abs(torque).max())] if len(gaps) else gaps
    return float(np.percentile(real, 2)) if len(real) else 0.0


def correlation(rests: Sequence[Array], samples: int = 1) -> float:
    """Autocorrelation of rows of mean 0 at a lag.

    Parameters
    ----------
    rests : sequence of ndarray, (n,)
        In one unit.
    samples : int
        The lag, 1 and more.

    Returns
    -------
    float
        -1 to 1; 0 where all are 0.
    """
    power = sum(float(rest @ rest) for rest in rests)
    return sum(float(rest[samples:] @ rest[:-samples]) for rest in rests) / power if power > 0.0 else 0.0


def robust_rms(rest: Array, step_nm: float = 0.0) -> float:
    """rms of a normal bulk about 0, N m: what lies far outside is no noise.

    Parameters
    ----------
    rest : ndarray (n,), N m
        What a fit leaves.
    step_nm : float
        In which it was read, a bulk has one more of it.
    """
    size = robust_deviation(rest)
    inside = np.abs(rest) < OUTLIER * size + step_nm * (1.0 + 1e-9)
    return float(np.sqrt(np.mean(rest[inside] ** 2))) if inside.any() and size > 0.0 else float(np.std(rest))


def _noise_untold(recordings: Sequence[Recording]) -> str:
    """Reason in words why records over time do not tell the torque's noise, with what to do; "" where they do.

    Records held out and static maps do not count.
    """
    to_fit = [r for r in recordings if not (r.sidecar.held_out or r.is_static_map)]
    if not to_fit or _level(to_fit).told:
        return ""
    return (
        "The noise of the torque cannot be told from these records: the torque jumps, no part of it repeats, and there is no setpoint; an "
        f"error over it says nothing. {_REMEDY}"
    )


def error_floor_words(ratio: float) -> str:
    """Reason in words why a ratio to the noise means nothing; "" for one that noise can leave.

    Parameters
    ----------
    ratio : float
        Error over the noise.
    """
    if ratio >= TOO_LITTLE:
        return ""
    return (
        f"An error of {ratio:.2f} times the noise is less than noise can leave (at least {TOO_LITTLE:g}): what was taken for noise is "
        f"mostly excitation, and a fault may hide below it. {_REMEDY}"
    )


def noise_doubt(ratio: float, recordings: Sequence[Recording]) -> str:
    """Reason in words why the ratio to the noise says nothing of a model; "" where it does.

    Parameters
    ----------
    ratio : float
        Error over the noise.
    recordings : sequence of Recording
        That it is of.
    """
    return _noise_untold(recordings) or error_floor_words(ratio)


def _level(recordings: Sequence[Recording]) -> Level:
    levels = []
    for recording in recordings:
        if recording.torque_setpoint is None:
            continue
        lags = 4
        setpoint = recording.torque_setpoint
        columns = [np.roll(setpoint, k)[lags:] for k in range(lags + 1)]
        regressor = np.stack([*columns, np.ones(len(setpoint) - lags)], axis=1)
        rest = recording.torque[lags:] - regressor @ np.linalg.lstsq(regressor, recording.torque[lags:], rcond=None)[0]
        rest = rest - np.median(rest)
        size, step = robust_deviation(rest), torque_step(recording.torque)
        levels.append(robust_rms(rest, step) if step > size else size)
    if levels:
        return Level(float(np.median(levels)), True)
    coloured = [level for r in recordings if (level := _coloured_noise(r)) is not None]  # what differences of a high order hardly show
    found = coloured or [_without_setpoint(r) for r in recordings]
    if not found:
        return Level(0.0, True)
    least = min(found, key=lambda level: level.nm)
    alike = [level for level in found if level.nm <= CLEARLY * least.nm and level.told == least.told]  # the least of many is too low
    return Level(float(np.median([level.nm for level in alike])), least.told, float(np.median([level.colour for level in alike])))


def _coloured_noise(recording: Recording) -> Level | None:
    """Noise of first order, by what two whole periods of a record differ by; None where they differ by white noise or something else."""
    repeated, note = _period_difference(recording), recording.sidecar.excitation
    if repeated is None or note is None or len(repeated) < (note.period_samples or 0):
        return None
    number = np.arange(len(repeated))
    rest = repeated - np.polyval(np.polyfit(number, repeated, 1), number)
    first, second = correlation([rest], 1), correlation([rest], 2)
    if not COLOURED < first < MOST_COLOUR or abs(second - first**2) > LIKE_FIRST_ORDER:
        return None
    return Level(float(np.sqrt(np.mean(rest**2))), True, first)


def _without_setpoint(recording: Recording) -> Level:
    """From the difference of repeated periods, where a record holds any, else from what is rough between jumps or behind the excitation."""
    rough = [nm for nm in (_between_jumps(recording.torque), _floor(recording)) if nm is not None]
    repeated = _period_difference(recording)
    if repeated is not None:
        nm = white_noise_deviation(np.diff(repeated, ORDER), ORDER)
        if not rough or nm <= REPEATING * min(rough):
            return Level(nm, True)
    if not rough:
        return Level(white_noise_deviation(np.diff(recording.torque, ORDER), ORDER), False)
    restless = recording.sidecar.experiment in RESTLESS
    nm = max(min(rough), rounding_of_reading(recording))
    return Level(nm, not restless or nm < MOSTLY * float(np.std(recording.torque)))


def rounding_of_reading(recording: Recording) -> float:
    """Noise that a torque read in steps has at least, step/√12, N m rms: most differences of one in coarse steps are 0.

    Parameters
    ----------
    recording : Recording
        Of any kind.

    Returns
    -------
    float
        0 for a command that is held, and one that switches between a few values.
    """
    if len(np.unique(recording.torque)) < READ or is_held([recording]):
        return 0.0
    return torque_step(recording.torque) / math.sqrt(12.0)


def _period_difference(recording: Recording) -> Array | None:
    """Difference of samples one period apart, over √2; None where there are too few."""
    torque, note = recording.torque, recording.sidecar.excitation
    if note is None or note.period_samples is None:
        return None
    length = note.period_samples
    if note.period_starts:
        periods = [torque[start : start + length] for start in note.period_starts if start + length <= len(torque)]
        return np.concatenate(np.diff(periods, axis=0)) / np.sqrt(2.0) if len(periods) > 1 else None
    if len(recording.gaps):
        return _across_gaps(recording, length, note.first_sample)
    excited = torque[note.first_sample :]
    if len(excited) >= 2 * length:
        excited = excited[: len(excited) // length * length]  # without the rest behind
    different = (excited[length:] - excited[:-length]) / np.sqrt(2.0)
    return different if len(different) >= FEWEST else None


def _across_gaps(recording: Recording, length: int, first: int) -> Array | None:
    """Difference of samples one period apart in a record that lost samples: pairs by their time, not by their row."""
    number = np.round((recording.t_s - recording.t_s[0]) / recording.sample_period_s).astype(np.int64)
    later = np.minimum(np.searchsorted(number, number + length), len(number) - 1)
    whole = (int(number[-1]) + 1 - first) // length
    end = first + whole * length if whole >= 2 else number[-1] + 1
    pairs = (number >= first) & (number[later] == number + length) & (number[later] < end)
    different = (recording.torque[later] - recording.torque)[pairs] / np.sqrt(2.0)
    return different if len(different) >= FEWEST else None


def _between_jumps(torque: Array) -> float | None:
    """Roughness of the rows between which the torque does not jump, N m rms; None where too few are left.

    A switched excitation jumps from row to row and is quiet in between; one that is fast but smooth has less of the higher differences.
    """
    steps = np.abs(np.diff(torque))
    if not np.any(steps):
        return None
    # of a torque that hardly changes its number from row to row the finest difference counts
    usual = max(float(np.percentile(steps, 25.0)) / QUARTER, float(steps[steps > 0.0].min()))
    quiet = steps <= JUMP * usual
    found = []
    for order in (ORDER, *HIGHER):
        rough = np.diff(torque, order)
        if not len(rough):
            break
        sound = np.lib.stride_tricks.sliding_window_view(quiet, order).all(axis=1)
        if np.mean(sound) < 1.0 - TOUCHED:
            rough = rough[sound]
            if len(rough) < FEWEST:
                break
        found.append(white_noise_deviation(rough, order))
    if not found:
        return None
    return min(found) if found[0] > CLEARLY * min(found) else found[0]


def _floor(recording: Recording) -> float | None:
    """White noise behind the band of an excitation, N m rms: what the quietest bands of the spectrum agree on; None where they do not.

    The window's side lobes (-92 dB) keep what is excited out of bands that are not; the median over parts, what happens once.
    """
    if recording.sidecar.experiment not in RESTLESS or len(recording.torque) < 4 * PART or len(recording.gaps):
        return None
    from scipy.signal import welch  # takes longer to import than a page of a report to draw

    rate_hz = 1.0 / recording.sample_period_s
    _, power = welch(recording.torque, rate_hz, "blackmanharris", PART, average="median")
    lines = power[len(power) % BANDS :].reshape(BANDS, -1)
    bands = np.sort(np.sqrt(np.mean(lines, axis=1) * rate_hz / 2.0))
    agree = bands[bands < CLEARLY * bands[0]]
    return float(np.mean(agree)) if len(agree) >= AGREEING else None


def white_noise_deviation(differences: Array, order: int = ORDER) -> float:
    """Deviation of the white noise that differences of an order are of: binomial(2 order, order) times its variance is theirs.

    Parameters
    ----------
    differences : ndarray, (n,)
        Of a signal.
    order : int
        How often it was differenced.

    Returns
    -------
    float
        In the unit of the signal; by the median, which outliers do not move.
    """
    return robust_deviation(differences - np.median(differences)) / math.sqrt(math.comb(2 * order, order))
