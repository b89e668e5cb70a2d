"""The excitation that the drive delivered against the one it was asked for: clipped, slowed down, inverted, scaled, or with gaps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from beltcomm.arrays import Array
from beltcomm.errors import DriveError, Refused
from beltcomm.fit.torque.reading_fit import fit_reading
from beltcomm.recording import Recording

#: Samples by which a drive's torque may lag its setpoint.
MOST_LAG = 8
#: A delivered share outside these is said; outside the wider ones the record shows something else than was asked for.
SOUND, USABLE = (0.9, 1.1), (0.5, 2.0)
#: Correlation below which torque has nothing to do with its setpoint.
RELATED = 0.5
#: Share of the torque that a delay and filters of the setpoint leave, below which its gain counts.
EXPLAINED = 0.2
#: Share of a setpoint's step that a sound torque goes within one sample (half of it where the delay is no whole sample).
AT_ONCE = 0.4
#: Share of lost samples that is said.
LOST = 0.02
#: Share of the largest setpoint from where on it counts as large; switches without which no step is looked at.
LARGE, FEWEST_SWITCHES = 0.9, 8
#: Rows of a segment of the spectra; share of the loudest line from which on a line is asked; of the sampling rate, up to which they are.
ROWS, ASKED, HIGHEST = 256, 1e-3, 0.35
#: Share of what passes on either side, below which a line is in a notch; standard deviations of noise that go with it.
NOTCHED, SURE = 0.5, 3.0


@dataclass(frozen=True)
class Notch:
    """A band that the drive takes out of its torque.   hz : its middle.   share, beside : delivered there, and below it."""

    hz: float
    share: float
    beside: float


@dataclass(frozen=True)
class Delivered:
    """share : of the torque asked for, least squares at the best lag, or at two of them where it acts from between two samples on.

    correlation : there, with sign.   lag : samples.
    largest_asked_nm, largest_nm : mean torque where the setpoint is largest.   step_share : largest part of a switch that one sample
    brings, NaN where nothing switches.   slope_nm_s : the rate that this is.   lost : share of samples.   notch : None for none; share
    is then that below it.
    """

    share: float
    correlation: float
    lag: int
    largest_asked_nm: float
    largest_nm: float
    step_share: float
    slope_nm_s: float
    lost: float
    notch: Notch | None = None

    @property
    def sound(self) -> bool:
        """True if nothing is to be said."""
        return self.notch is None and SOUND[0] <= self.share <= SOUND[1] and self.correlation >= RELATED and self.lost <= LOST

    def words(self) -> str:
        """Delivered torque and its probable limit, in words."""
        parts = []
        if self.correlation <= -RELATED:
            parts.append(
                f"the drive delivered {100.0 * self.share:.0f} % of the torque asked for: with the wrong sign; look at its polarity (607Eh)"
            )
        elif self.correlation < RELATED:
            parts.append(
                f"the torque has little to do with what was asked for (correlation {self.correlation:.2f}): is another mode or another "
                "master at work in the drive?"
            )
        elif self.notch is not None:
            parts.append(
                f"the drive takes a band out of the torque asked for: near {self.notch.hz:.0f} Hz it delivers "
                f"{100.0 * self.notch.share:.0f} %, below {100.0 * self.notch.beside:.0f} %. A notch of its own against a resonance? The "
                "model has none in its torque path: switch it off with the maker's tool, and begin anew"
            )
        elif not SOUND[0] <= self.share <= SOUND[1]:
            parts.append(f"the drive delivered {100.0 * self.share:.0f} % of the torque asked for: {self._limit()}")
        if self.lost > LOST:
            parts.append(f"{100.0 * self.lost:.1f} % of its samples are missing: look at cabling and bus load")
        return "; ".join(parts)

    def _limit(self) -> str:
        """Probable cause of the difference."""
        if self.step_share < AT_ONCE:
            return (
                f"limited by its rate, {self.slope_nm_s:.3g} N m/s; a switch takes {1.0 / self.step_share:.0f} samples. Raise the torque "
                "slope (6087h) or look for a filter of the torque setpoint"
            )
        reached = f"{self.largest_nm:.3g} of {self.largest_asked_nm:.3g} N m where it was largest"
        if self.share > 1.0:
            return f"{reached}; the scale of its torque is in doubt (6076h, or thousandths of another value than the rated torque)"
        return (
            f"{reached}; limited by a bound in the drive (6072h, 6073h, I²t), or scaled (6076h, or thousandths of another value than the "
            "rated torque)"
        )


def _delivered(recording: Recording) -> Delivered | None:
    """Share of an open-loop record's setpoint that its torque shows; None for a record without one, or with a constant one."""
    asked = recording.torque_setpoint
    if asked is None or not np.all(np.isfinite(asked)) or np.ptp(asked) <= 0.0:
        return None
    torque = recording.torque
    _, lag = max((abs(_related(asked, torque, lag)[0]), -lag) for lag in range(MOST_LAG + 1))
    lag = -lag
    correlation, share = _related(asked, torque, lag)
    before, after = asked[: len(asked) - lag] - np.mean(asked), torque[lag:] - np.mean(torque)
    large = np.abs(before) >= LARGE * np.max(np.abs(before))
    level = float(np.mean(np.abs(before[large])))
    reached = float(abs(np.mean(after[large] * np.sign(before[large]))))
    step, slope = _steps(recording, asked, torque)
    period, chain = recording.sample_period_s, fit_reading([recording])
    # A filter, or a delay of no whole sample, takes nothing of a torque away; a limit of its rate does.
    filtered = chain is not None and chain.rest_nm < EXPLAINED * float(np.std(torque))
    if chain is not None and filtered and not (step < AT_ONCE and _limited_rest(asked, torque, slope * period) < chain.rest_nm):
        share = chain.law.gain
    samples = 1 + round(recording.duration_s / period)
    lost = max(0.0, 1.0 - len(recording.t_s) / samples)
    whole = len(recording.t_s) >= samples and not step < AT_ONCE  # ramps of a limited rate leave out bands, too
    notch = _notch(asked, torque, 1.0 / period) if whole and correlation > -RELATED else None
    if notch is not None:
        share, correlation = notch.beside, max(correlation, RELATED)
    return Delivered(share, correlation, lag, level, reached, step, slope, lost, notch)


def _notch(asked: Array, torque: Array, rate_hz: float) -> Notch | None:
    """The band that misses in the torque and not in what was asked, with more on either side of it; None where there is none.

    |H| = |S_uy|/S_uu by Welch's segments; its noise is what of the torque is not of the setpoint.
    """
    from scipy.signal import csd, welch  # takes longer to import than a record to check

    if len(asked) < 4 * ROWS:
        return None
    given: dict[str, Any] = {"fs": rate_hz, "window": "hann", "nperseg": ROWS}
    hz, asked_power = welch(asked, **given)
    power, both = welch(torque, **given)[1], csd(asked, torque, **given)[1]
    used = (hz > 0.0) & (hz <= HIGHEST * rate_hz) & (asked_power >= ASKED * asked_power.max())
    gain = np.abs(both[used]) / asked_power[used]
    rest = np.maximum(power[used] - gain**2 * asked_power[used], 0.0)
    noise = SURE * np.sqrt(rest / asked_power[used] / (2.0 * len(asked) / ROWS - 1.0))
    if len(gain) < FEWEST_SWITCHES:
        return None
    middle = 1 + int(np.argmin((gain + noise)[1:-1]))
    below, above = (float(np.max(side)) for side in ((gain - noise)[:middle], (gain - noise)[middle + 1 :]))
    if gain[middle] + noise[middle] >= NOTCHED * min(below, above):
        return None
    return Notch(float(hz[used][middle]), float(gain[middle]), float(np.median(gain[: max(1, middle // 2)])))


def _related(asked: Array, torque: Array, lag: int) -> tuple[float, float]:
    """Correlation and slope of the torque on the setpoint so many samples before."""
    u, y = asked[: len(asked) - lag], torque[lag:]
    u, y = u - u.mean(), y - y.mean()
    power = float(u @ u), float(y @ y)
    if min(power) <= 0.0:
        return 0.0, 0.0
    return float(u @ y) / float(np.sqrt(power[0] * power[1])), float(u @ y) / power[0]


def _steps(recording: Recording, asked: Array, torque: Array) -> tuple[float, float]:
    """Largest share of a switch that one sample brings, by the mean over all switches, and the rate that this is, N m/s."""
    jumps = np.diff(asked)
    size = 0.5 * float(np.ptp(asked))
    at = [int(k) for k in np.flatnonzero(np.abs(jumps) >= size) if k + 1 + 2 * MOST_LAG < len(torque)]
    if len(at) < FEWEST_SWITCHES:
        return float("nan"), float("nan")
    ways = np.array([np.sign(jumps[k]) * np.diff(torque[k : k + 2 * MOST_LAG]) for k in at])
    mean = float(np.mean([abs(jumps[k]) for k in at]))
    fastest = float(np.max(np.mean(ways, axis=0)))
    return max(fastest / mean, 1e-3), fastest / recording.sample_period_s


def _limited_rest(asked: Array, torque: Array, step_nm: float) -> float:
    """rms of what a setpoint leaves of the torque whose change from sample to sample is limited, N m, at the best lag."""
    limited, value = np.empty(len(asked)), float(asked[0])
    for n, wanted in enumerate(asked.tolist()):
        value += min(max(wanted - value, -step_nm), step_nm)
        limited[n] = value
    rests = []
    for lag in range(MOST_LAG):
        columns = np.column_stack((limited[1 : len(limited) - lag], limited[: len(limited) - lag - 1], np.ones(len(limited) - lag - 1)))
        read = torque[lag + 1 :]  # the mean over a period lies between its ends
        rests.append(float(np.std(read - columns @ np.linalg.lstsq(columns, read, rcond=None)[0])))
    return min(rests)


def check(recording: Recording) -> str:
    """Sentence on an excitation that was delivered otherwise than asked for; "" when it was not.

    Parameters
    ----------
    recording : Recording
        With its torque setpoint.

    Raises
    ------
    DriveError
        For a torque with the wrong sign.
    Refused
        For one that shows something else than was asked for.
    """
    found = _delivered(recording)
    if found is None or found.sound:
        return ""
    words = f"{recording.name}: {found.words()}"
    if found.correlation <= -RELATED:
        raise DriveError(words)
    if found.correlation < RELATED or not USABLE[0] <= found.share <= USABLE[1]:
        raise Refused(f"{words}; the record is not used")
    return words
