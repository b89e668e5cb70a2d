"""The frequency responses of a run side by side: places, amplitudes, directions, and what differs between them beyond the noise."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from beltcomm.errors import DataError, Refused, UsageError
from beltcomm.identify.landmarks import Landmark, Landmarks, find_landmarks
from beltcomm.language import told, tr
from beltcomm.model import Model
from beltcomm.model.value import NORMAL_95
from beltcomm.recording import Recording
from beltcomm.response import FrequencyResponse
from beltcomm.result import table
from beltcomm.rundata import analyse
from beltcomm.rundata.conditions import Condition, condition_of
from beltcomm.sentences.words import number

#: A difference is told from this many times its own 95 % interval on: by chance once in 300 comparisons.
CLEAR = 1.5
#: Records nearer than this are at one place; amplitudes within this ratio are one.
SAME_PLACE_M, SAME_AMPLITUDE = 0.05, 1.2
#: Both frequencies move together when the sum of their changes is this many times the difference.
SHARED = 4.0
#: The gain is compared up to this share of the antiresonance, where all bodies move together.
RIGID_SHARE = 0.7


@dataclass(frozen=True)
class ResponseRow:
    """One response.

    Attributes
    ----------
    gain_db : float
        Mean of |h| ω² up to ``RIGID_SHARE`` of the antiresonance over that of the reference, with the half width of its 95 % interval;
        0 and 0 for the reference itself, nan without a common band.
    """

    condition: Condition
    response: FrequencyResponse
    landmarks: Landmarks | None
    gain_db: float
    gain_interval_db: float

    def to_dict(self) -> dict[str, Any]:
        """For ``--json``."""
        c, found = self.condition, self.landmarks
        marks = {"antiresonance": found.antiresonance, "resonance": found.resonance} if found else {}
        return {
            "record": c.record,
            "place_m": c.place_m,
            "amplitude_nm": c.amplitude_nm,
            "direction": c.direction,
            "base_speed_m_s": c.base_speed_m_s,
            "held_out": c.held_out,
            **{
                name: None if mark is None else {"freq_hz": mark.freq_hz, "interval_hz": mark.interval_hz, "damping": mark.damping}
                for name, mark in marks.items()
            },
            "gain_db": self.gain_db,
            "gain_interval_db": self.gain_interval_db,
        }


@dataclass(frozen=True)
class Difference:
    """Two records that differ beyond the noise.

    Attributes
    ----------
    cause : str
        "place", "amplitude" or "direction".
    text : str
        What differs, what it hints at.
    """

    cause: str
    first: str
    second: str
    text: str


@dataclass(frozen=True)
class ResponseTable:
    """All responses, and what differs.

    Attributes
    ----------
    remarks : tuple of str
        Records that could not be read, and comparisons without a difference.
    """

    rows: tuple[ResponseRow, ...]
    differences: tuple[Difference, ...]
    remarks: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """``responses`` of ``--json``."""
        return {
            "records": [row.to_dict() for row in self.rows],
            "differences": [{"cause": d.cause, "records": [d.first, d.second], "text": d.text} for d in self.differences],
            "remarks": list(self.remarks),
        }


def table_of(recordings: Sequence[Recording], model: Model) -> ResponseTable:
    """Every response of a belt axis; empty for an axis without a belt.

    Parameters
    ----------
    recordings : sequence of Recording
    model : Model
        Says where about antiresonance and resonance are.
    """
    used = [r for r in recordings if not r.is_static_map and r.side == "motor"]
    if "cart" not in model.base_bodies or "motor" not in model.base_bodies:
        return ResponseTable((), (), ())
    found = analyse.responses(used)
    rows, remarks = [], []
    for recording in used:
        if (response := found.get(recording.name)) is None:
            continue
        condition = condition_of(recording, model["transmission.ratio"])
        marks: Landmarks | None = None
        try:
            shape = analyse.resonance_shape(model, condition.place_m or 0.0)
            marks = find_landmarks(response, shape.belt, shape.beside)
        except (DataError, UsageError, Refused, ValueError) as problem:
            remarks.append(f"{recording.name}: no antiresonance or resonance ({problem})")
        rows.append(ResponseRow(condition, response, marks, math.nan, math.nan))
    if not rows:
        return ResponseTable((), (), tuple(remarks))
    reference = _reference(rows)
    rows = [_with_gain(row, reference) for row in rows]
    differences, none = _differences(rows)
    return ResponseTable(tuple(rows), tuple(differences), (*remarks, *none))


def _reference(rows: Sequence[ResponseRow]) -> ResponseRow:
    """The loudest that stands; of several the longest."""
    standing = [r for r in rows if r.condition.direction == "standing"] or list(rows)
    return max(standing, key=lambda r: (round(r.condition.amplitude_nm, 3), r.response.n_periods))


def _with_gain(row: ResponseRow, reference: ResponseRow) -> ResponseRow:
    if row is reference:
        return replace(row, gain_db=0.0, gain_interval_db=0.0)
    mark = reference.landmarks.antiresonance if reference.landmarks else None
    if mark is None:
        return row
    (here, width), (there, other) = (_rigid_db(r.response, RIGID_SHARE * mark.freq_hz) for r in (row, reference))
    return replace(row, gain_db=here - there, gain_interval_db=math.hypot(width, other))


def _rigid_db(response: FrequencyResponse, highest_hz: float) -> tuple[float, float]:
    """Mean of |h| ω² over the lines up to a frequency, dB, and its 95 % half width from their scatter; nan below three lines."""
    low = response.freq_hz <= highest_hz
    levels = 20.0 * np.log10(np.abs(response.h[low]) * (2.0 * math.pi * response.freq_hz[low]) ** 2)
    if len(levels) < 3:
        return math.nan, math.nan
    # A slope over the band is common to all records, what is left about it is not.
    left = levels - np.polyval(np.polyfit(np.log(response.freq_hz[low]), levels, 1), np.log(response.freq_hz[low]))
    return float(np.mean(levels)), float(NORMAL_95 * np.sqrt(np.sum(left**2) / (len(levels) - 2) / len(levels)))


def _differences(rows: Sequence[ResponseRow]) -> tuple[list[Difference], list[str]]:
    """The clearest pair by place, by amplitude and by direction; sentences on those without any."""
    pairs = list(itertools.combinations(rows, 2))
    kinds = {
        "place": [(a, b) for a, b in pairs if _alike(a, b, "amplitude", "direction") and not _alike(a, b, "place")],
        "amplitude": [(a, b) for a, b in pairs if _alike(a, b, "place", "direction") and not _alike(a, b, "amplitude")],
        "direction": [(a, b) for a, b in pairs if _alike(a, b, "amplitude", "place") and not _alike(a, b, "direction")],
    }
    found, none = [], []
    for cause, candidates in kinds.items():
        scored = [(max((size for size, _ in _what(a, b)), default=0.0), a, b) for a, b in candidates]
        if not scored:
            continue
        size, a, b = max(scored, key=lambda one: one[0])
        if size > CLEAR:
            found.append(_told(cause, a, b))
        else:
            none.append(f"by {cause}: no difference beyond the noise ({len(scored)} pairs of records)")
    return found, none


def _alike(a: ResponseRow, b: ResponseRow, *what: str) -> bool:
    """True if two records have these conditions in common."""
    one, other = a.condition, b.condition
    if "place" in what and (one.place_m is None or other.place_m is None or abs(one.place_m - other.place_m) > SAME_PLACE_M):
        return False
    if "direction" in what and one.direction != other.direction:
        return False
    loud, quiet = max(one.amplitude_nm, other.amplitude_nm), min(one.amplitude_nm, other.amplitude_nm)
    return "amplitude" not in what or loud <= SAME_AMPLITUDE * quiet


def _marks(row: ResponseRow) -> dict[str, Landmark]:
    found = row.landmarks
    named = {"antiresonance": found.antiresonance, "resonance": found.resonance} if found else {}
    return {name: mark for name, mark in named.items() if mark is not None}


def _what(a: ResponseRow, b: ResponseRow) -> list[tuple[float, str]]:
    """Differences: size over its 95 % interval, and name, largest first."""
    one, other = _marks(a), _marks(b)
    sizes = []
    for name in one.keys() & other.keys():
        width = math.hypot(one[name].interval_hz, other[name].interval_hz)
        sizes.append((abs(one[name].freq_hz - other[name].freq_hz) / width, name))
    width = math.hypot(a.gain_interval_db, b.gain_interval_db)
    if width > 0.0 and math.isfinite(a.gain_db - b.gain_db):
        sizes.append((abs(a.gain_db - b.gain_db) / width, "gain"))
    return sorted(sizes, reverse=True)


def _shown(mark: Landmark) -> str:
    return number(mark.freq_hz, mark.interval_hz, "Hz")


def _told(cause: str, a: ResponseRow, b: ResponseRow) -> Difference:
    """Two records that differ, in words.   The one named first is nearer to the pulley, louder, or forward."""
    if cause == "place" and (a.condition.place_m or 0.0) > (b.condition.place_m or 0.0):
        a, b = b, a
    if cause == "amplitude" and a.condition.amplitude_nm < b.condition.amplitude_nm:
        a, b = b, a
    one, other = _marks(a), _marks(b)
    clear = [name for size, name in _what(a, b) if size > CLEAR]
    parts = [f"{name} {_shown(one[name])} against {_shown(other[name])}" for name in clear if name != "gain"]
    if "gain" in clear:
        fall = a.gain_db - b.gain_db
        parts.append(f"{abs(fall):.1f} dB {'more' if fall > 0.0 else 'less'} motion below the antiresonance")
    text = f"{a.condition.record} ({a.condition.words()}) against {b.condition.record} ({b.condition.words()}): {', '.join(parts)}; "
    return Difference(cause, a.condition.record, b.condition.record, text + _hint(cause, a, b, clear))


def _hint(cause: str, a: ResponseRow, b: ResponseRow, clear: Sequence[str]) -> str:
    """Probable cause of a difference."""
    one, other = _marks(a), _marks(b)
    if cause == "amplitude":
        return "friction takes more of the quieter excitation and poses as damping and as another mass: trust the larger amplitude"
    if cause == "direction":
        return "something acts that knows its direction: friction that differs each way, a tilt, a cable"
    ratios = {name: one[name].freq_hz / other[name].freq_hz for name in clear if name != "gain"}
    if not ratios:
        return "friction differs along the travel"
    both = one.keys() & other.keys() >= {"antiresonance", "resonance"}
    apart = ""
    if both and _moved_apart(one, other):
        moved = [math.log(one[name].freq_hz / other[name].freq_hz) for name in ("antiresonance", "resonance")]
        apart = f"; that their ratio changes by {100.0 * abs(math.expm1(moved[1] - moved[0])):.0f} % no single spring does: further bodies"
        apart += ", another load or friction"
    if apart and abs(sum(moved)) < SHARED * abs(moved[1] - moved[0]):
        return (
            "the ratio of resonance to antiresonance differs too, which no stiffness does: another load, or friction that differs by place"
        )
    stiffer = 100.0 * (next(iter(ratios.values())) ** 2 - 1.0)
    place = f"{abs(stiffer):.0f} % {'stiffer' if stiffer > 0.0 else 'softer'} nearer the driven pulley"
    law = "as (2.26) has it" if stiffer > 0.0 else "against (2.26): a slack strand, or position 0 at the other end"
    return f"the belt is {place}, {law}{apart}"


def _moved_apart(one: dict[str, Landmark], other: dict[str, Landmark]) -> bool:
    """True if f_r/f_z differs between two records beyond the noise."""
    ratios = [math.log(m["resonance"].freq_hz / m["antiresonance"].freq_hz) for m in (one, other)]
    width = math.sqrt(sum((mark.interval_hz / mark.freq_hz) ** 2 for m in (one, other) for mark in m.values()))
    return abs(ratios[0] - ratios[1]) > CLEAR * width


def table_lines(found: ResponseTable) -> list[str]:
    """Responses of a run side by side, and what they differ by.

    Parameters
    ----------
    found : ResponseTable
        Nothing is said of one without rows.
    """
    if not found.rows:
        return []
    rows = []
    for row in found.rows:
        c, marks = row.condition, _marks(row)
        place = "?" if c.place_m is None else f"{c.place_m:.2f} m"
        shown = [_shown(m) if (m := marks.get(n)) else tr("cannot tell") for n in ("antiresonance", "resonance")]
        gain = told("reference") if row.gain_interval_db == 0.0 else f"{row.gain_db:+.1f} ± {row.gain_interval_db:.1f} dB"
        gain = tr("cannot tell") if math.isnan(row.gain_db) else gain
        rows.append([c.record, place, f"±{c.amplitude_nm:.3f} N m", told(c.direction), *shown, gain, tr("held out") if c.held_out else ""])
    columns = ["response", ">place", ">amplitude", "travel", "antiresonance", "resonance", "rigid gain", ""]
    lines = ["", *table(columns, rows)]
    lines.append(
        "  95 % of what lines scatter; friction around standstill biases all of it, which the model's own numbers do not suffer from"
    )
    lines += [f"  by {d.cause}: {d.text}" for d in found.differences]
    return lines + [f"  {remark}" for remark in found.remarks]
