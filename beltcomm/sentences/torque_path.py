"""The torque path as a property of the drive: a sentence where it is not ideal, and ``torque_path`` of ``--json``.

"the current loop takes 0.50 ± 0.01 ms"
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from beltcomm.fit.torque.lag import Lag
from beltcomm.fit.torque.laws import DriveLaw, ReadingLaw
from beltcomm.fit.torque.path import TorquePath, path_to_dict
from beltcomm.fit.torque.reading_fit import WHOLE
from beltcomm.recording import Recording

#: Periods by which a reading is late, in words.
_NUMBERS = {1: "one sample", 2: "two samples", 3: "three samples"}
#: Rivals of a path that are named.
MOST_RIVALS = 2
#: Share of a number below which its interval says nothing to a reader.
FINEST = 1e-4
#: A share of a filter of samples from which on nothing is left of it after a sample.
_AT_ONCE = 1.0 - 1e-9


def period_of(recordings: Sequence[Recording]) -> float:
    """Sampling period that the path of some records is told in, s; 0 without any over time.

    Parameters
    ----------
    recordings : sequence of Recording
        Static maps do not count.
    """
    return next((r.sample_period_s for r in recordings if not r.is_static_map), 0.0)


def path_data(path: TorquePath, sample_s: float) -> dict[str, Any]:
    """``torque_path`` of files and ``--json``.

    Parameters
    ----------
    path : TorquePath
        From setpoint and reading to the torque that acts.
    sample_s : float
        Sampling period, s.

    Returns
    -------
    dict
        drive: delay and delay_interval in periods, lags, gain; reading: late in periods, lags, at_end (of the period, else its mean);
        commanded; unseen, without a setpoint; instantaneous, read at instants; rivals of the same shape; process, where a torque that acts
        beside the setpoint has a correlation time, or is not all read: rms_nm, time_s (0: white) and their intervals;
        sample_period_s; delay_s from setpoint to acting torque, None where the path has no setpoint; words, a list of sentences, empty for
        a whole delay and a faithful reading.
    """
    delay_s = None if path.drive is None or path.without_setpoint else path.drive.delay_s(sample_s)
    return {
        **path_to_dict(path),
        "sample_period_s": sample_s,
        "delay_s": delay_s,
        "words": [*path_lines(path, sample_s), *process_lines(path)],
    }


def path_lines(path: TorquePath | None, sample_s: float) -> list[str]:
    """Torque path of the drive, one line, and a second where the records do not tell it; empty for an ideal drive.

    Parameters
    ----------
    path : TorquePath or None
        None for an ideal drive.
    sample_s : float, s
        Sampling period of the records.
    """
    if path is None:
        return []
    said = _words_of(path, sample_s)
    lines = [said] if said else []
    if path.rivals:
        every = dict.fromkeys(words for rival in path.rivals if (words := _words_of(rival, sample_s)) != said)
        if others := " or ".join([words or "a plain delay" for words in every][:MOST_RIVALS]):
            lines.append(f"just as likely by these records: {others}; one excited louder, at a higher frequency, would tell")
    return lines


def path_sentences(path: TorquePath, recordings: Sequence[Recording]) -> list[str]:
    """Torque path of the drive that made some records, and what acts beside its setpoint, as whole sentences.

    Parameters
    ----------
    path : TorquePath
    recordings : sequence of Recording
        Made by that drive.
    """
    return whole_sentences([*path_lines(path, period_of(recordings)), *process_lines(path)])


def whole_sentences(lines: Sequence[str]) -> list[str]:
    """Lines with a capital and a full stop.

    Parameters
    ----------
    lines : sequence of str
        Without either; none is empty.
    """
    return [f"{line[0].upper()}{line[1:]}." for line in lines]


def _words_of(path: TorquePath, sample_s: float) -> str:
    """Parts of a path that are not ideal; "" for none."""
    drive = [] if path.drive is None else _drive_words(path.drive, sample_s)
    if path.commanded:
        told = "the reported torque is the command: what acts is told by the motion alone"
        return "; ".join([told, *drive])
    if path.instantaneous:
        early = path.reading.late < 0.0
        instant = f", read {abs(path.reading.late):.2f} samples {'early' if early else 'late'}" if abs(path.reading.late) > WHOLE else ""
        return f"the torque changes between the samples, as under a loop that is faster than the record{instant}"
    return "; ".join([*drive, *_reading_words(path.reading, sample_s)])


def process_lines(path: TorquePath | None) -> list[str]:
    """Torque that acts beside the setpoint, one line; empty where next to nothing does.

    Parameters
    ----------
    path : TorquePath or None
        None for an ideal drive.
    """
    process = None if path is None else path.process
    if process is None or process.rms_nm <= process.rms_interval:
        return []
    size = f"process torque of {_number(1e3 * process.rms_nm, 1e3 * process.rms_interval)} mN m rms"
    if process.time_s == 0.0:
        return [f"{size}, another one in every sample"]
    return [f"{size}, correlation time {_number(1e3 * process.time_s, 1e3 * process.time_interval)} ms"]


def _drive_words(drive: DriveLaw, sample_s: float) -> list[str]:
    part, said = drive.delay - math.floor(drive.delay), []
    if min(part, 1.0 - part) > WHOLE:
        said.append(f"the torque switches at {_number(part, drive.delay_interval)} of the sample")
    for lag in drive.lags:
        if lag.kind == "second order":
            said.append(
                f"the current loop has {_number(lag.values[0], _interval(lag, 0))} Hz, damping {_number(lag.values[1], _interval(lag, 1))}"
            )
        elif lag.kind == "slew rate":
            said.append(f"the drive changes the torque by at most {_number(lag.values[0], _interval(lag, 0))} N m/s")
        elif _may_be_none(lag):
            continue
        elif lag.kind == "first order":
            said.append(f"the current loop takes {_time(lag, sample_s)}")
        else:
            said.append(f"the drive filters the torque setpoint with {_time(lag, sample_s)}")
    return said


def _reading_words(reading: ReadingLaw, sample_s: float) -> list[str]:
    said = []
    if reading.late:
        amount = _NUMBERS.get(round(reading.late), "") if abs(reading.late - round(reading.late)) <= WHOLE else ""
        said.append(f"the torque reading is {amount or f'{reading.late:.2f} samples'} late")
    for lag in reading.lags:
        if lag.kind == "second order":
            said.append(f"the torque reading is filtered at {_number(lag.values[0], _interval(lag, 0))} Hz")
        elif not _may_be_none(lag):
            said.append(f"the torque reading lags {_time(lag, sample_s)}")
    return said


def _may_be_none(lag: Lag) -> bool:
    """Whether within its interval a filter of first order, or of samples, lets everything through at once."""
    value, interval = lag.values[0], _interval(lag, 0)
    return value <= interval if lag.kind == "first order" else value + interval >= _AT_ONCE


def _time(lag: Lag, sample_s: float) -> str:
    """Time constant with its interval, in ms; of a filter of samples that which falls as fast."""
    value, interval = lag.values[0], _interval(lag, 0)
    if lag.kind == "sampled":
        time_s = -sample_s / math.log1p(-value)
        value, interval = time_s, time_s**2 / sample_s / (1.0 - value) * interval
    return f"{_number(1e3 * value, 1e3 * interval)} ms"


def _interval(lag: Lag, place: int) -> float:
    return lag.intervals[place] if lag.intervals else 0.0


def _number(value: float, interval: float) -> str:
    """Value with its interval, rounded to the interval's first digit; to three digits where it is not known, to four where it is less."""
    if not 0.0 < interval < math.inf:
        return f"{value:.3g}"
    digits = max(0, -math.floor(math.log10(interval)))
    return f"{value:.4g}" if interval < FINEST * abs(value) else f"{value:.{digits}f} ± {interval:.{digits}f}"
