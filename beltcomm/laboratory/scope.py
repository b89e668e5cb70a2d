"""What a set of records can decide at all: which kinds it holds, and which effects it must not name.

Belt, delays and lags act at frequencies near the antiresonance and above.  Strokes and moves hardly contain them: there a few per cent of
wrong noise look like a delay, a lag or a second pulley.  Without an excited record such effects stay hints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from beltcomm.effects import EFFECTS
from beltcomm.fit.noise_level import noise_doubt
from beltcomm.laboratory.diagnosis import NONE_EXPLAINS, Diagnosis, Step
from beltcomm.model import Model
from beltcomm.recording import Recording

#: Slots of effects that show near the antiresonance and above.
FAST_SLOTS = ("torque_delay", "torque_reading", "belt_law", "body", "element")
#: Error over the noise up to which the noise of strokes alone explains it: simulated healthy machines read 0.93 to 1.17 there.
UNDECIDED = 1.2
#: m/s; strokes below it are slow.   m; records further apart are at two places.
SLOW_M_S, APART_M = 0.08, 0.1


def within_scope(found: Diagnosis, recordings: Sequence[Recording]) -> tuple[Diagnosis, list[str]]:
    """The diagnosis without names or a verdict that these records cannot bear, and sentences on it."""
    doubt = noise_doubt(found.after.ratio, recordings)
    if doubt and found.verdict != "partly explained":
        return replace(found, verdict="cannot tell"), [doubt]
    unnamed = not_named(found.base.model, recordings)
    if not unnamed:
        return found, []
    for number, step in enumerate(found.steps):
        if step.added in unnamed:
            kept = (*found.steps[:number], Step(step.before, step.candidates, "", (), step.before))
            sentence = (
                f"{step.added} fits best, but no record is excited: strokes and moves hardly contain the frequencies at which it acts, so "
                "it is not named. Record an excitation (frf) and ask again."
            )
            return replace(found, steps=kept, verdict="cannot tell", twins=()), [sentence]
    if found.verdict == NONE_EXPLAINS and found.after.ratio < UNDECIDED:
        sentence = (
            f"An error of {found.after.ratio:.2f} times the noise may be the noise itself: it is known to some "
            f"{100.0 * (UNDECIDED - 1.0):.0f} % "
            "where no record is excited. Record an excitation (frf) and ask again."
        )
        return replace(found, verdict="cannot tell"), [sentence]
    return found, []


def not_named(model: Model, recordings: Sequence[Recording]) -> set[str]:
    """Effects that these records cannot bear a name of."""
    if "cart" not in model.base_bodies or excited(recordings):
        return set()
    return {effect.name for effect in EFFECTS if effect.slot in FAST_SLOTS}


def excited(recordings: Sequence[Recording]) -> bool:
    """Whether a record to fit is excited."""
    return any(r.sidecar.experiment == "frf" and not r.sidecar.held_out for r in recordings)


def lacking(recordings: Sequence[Recording], ratio_m_rad: float) -> list[str]:
    """Kinds of records that a belt axis' data set lacks, as sentences.   ratio_m_rad : carriage travel per radian of the motor."""
    to_fit = [r for r in recordings if not (r.sidecar.held_out or r.is_static_map)]
    lines = []
    if not excited(to_fit):
        lines.append("no excited record (frf): nothing about belt, delays, lags and payloads on springs is named")
    speeds = [float(np.percentile(np.abs(np.gradient(r.position, r.t_s)), 90.0)) * ratio_m_rad for r in to_fit]
    strokes = [speed for r, speed in zip(to_fit, speeds, strict=True) if r.sidecar.experiment != "frf"]
    if not any(speed < SLOW_M_S for speed in strokes):
        lines.append(
            f"no fitted record stays below {SLOW_M_S:g} m/s for nine tenths of its time: friction at low speed, cogging and ripple "
            "are hardly seen"
        )
    if not any(speed > 0.5 for speed in strokes):
        lines.append("no fitted record is faster than 0.5 m/s for a tenth of its time: drag and saturation are hardly seen")
    places = [r.sidecar.start_position_m for r in to_fit if r.sidecar.start_position_m is not None]
    ways = [float(np.ptp(r.position)) * ratio_m_rad for r in to_fit]
    if max(ways, default=0.0) < APART_M and (len(places) < 2 or np.ptp(places) < APART_M):
        lines.append("one place only: nothing that depends on the place is seen")
    if not any(r.sidecar.held_out for r in recordings):
        lines.append("no record is held out (held_out: true in a sidecar): nothing can contradict what was found")
    return lines
