"""Scope of a set of records: which kinds it holds, and which effects it must not name.

Belt, delays and lags act at frequencies near the antiresonance and above.  Strokes and moves hardly contain them: there a few per cent of
wrong noise look like a delay, a lag or a second pulley.  Without an excited record such effects stay hints.
"""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import replace

import numpy as np

from beltcomm.arrays import Array
from beltcomm.effects import EFFECTS
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.noise.level import correlation, noise_doubt
from beltcomm.fit.start.undersampled import SWING_SAMPLED, UNSEEN
from beltcomm.fit.uncertainty.intervals import rounded_share
from beltcomm.identify.landmarks import shape_of
from beltcomm.laboratory.acceptance import EVIDENCE
from beltcomm.laboratory.compare import NOISE_KNOWN, Comparison, compare, unexplained_words
from beltcomm.laboratory.diagnosis import NONE_EXPLAINS, Diagnosis, Stage
from beltcomm.laboratory.samples import units_of
from beltcomm.model import Model
from beltcomm.recording import Recording

#: Slots of effects that show near the antiresonance and above.
FAST_SLOTS = ("torque_delay", "torque_reading", "belt_law", "body", "element")
#: Slot of every effect of the catalogue.
SLOTS = {effect.name: effect.slot for effect in EFFECTS}
#: Slots of effects that a drive has as well, between setpoint, torque and reading; error over the noise up to which it may be all of it.
DRIVE_SLOTS, FAR_OFF_BASE = ("torque_delay", "torque_reading"), 10.0
OF_DRIVE = frozenset(name for name, slot in SLOTS.items() if slot in DRIVE_SLOTS)
#: Time constant of a current loop over the sampling period of which no more than e⁻⁴ is left when the torque is read at the period's end.
WITHIN_SAMPLE = 0.25
#: Share of the noise's power from which on it is mostly rounding.
MOSTLY_ROUNDING = 0.5
#: Error over the noise that no healthy axis has for being sampled too seldom (2 at most), and share of it that an effect may leave, above
#: the noise, of the fitted records and of those held out, to stand all the same.
TOO_FAR_OFF, HARDLY_LEFT = 3.0, 0.05
#: Error over the noise up to which the noise of strokes alone explains it: simulated healthy machines read 0.93 to 1.17 there.
UNDECIDED = 1.2
#: Error over the noise of a record, and correlation of neighbours, from which on its error changes sign from row to row; share of the
#: squared error that such records must have.  Interpolated rows leave -0.31 to -0.35, unexplained effects 0.66 and more.
FAR_OFF_RECORD, ALTERNATES, MOST_OF_IT = 2.0, -0.25, 0.9
#: m/s; strokes below it are slow.   m; records further apart are at two places.
SLOW_M_S, APART_M = 0.08, 0.1


def restrict_to_scope(found: Diagnosis, recordings: Sequence[Recording]) -> tuple[Diagnosis, list[str]]:
    """The diagnosis without names or a verdict that these records cannot bear, and sentences on it.

    Parameters
    ----------
    found : Diagnosis
        As it was searched.
    recordings : sequence of Recording
        That it was searched in.

    Returns
    -------
    tuple of Diagnosis and list of str
        No sentence where nothing is taken back.
    """
    doubt = noise_doubt(found.final_fit.ratio, recordings)
    if doubt and found.verdict != "partly explained":
        left = unexplained_words({one.name: one.plain for one in compare(found.data, found.final_fit).records})
        return replace(found, verdict="cannot tell"), [doubt, *([left] if left else [])]
    if sentence := _speed_alone(found, recordings):
        return _without_names(found, OF_DRIVE), [sentence]
    if found.data.path.commanded and _ends_at_drive(found):
        return _without_names(found, OF_DRIVE), [_commanded_only_words(found)]
    stands = found.verdict == "explained" or _acts_slowly(found) or _explains_nearly_all(found)
    sentence = "" if stands else _undersampling_remark(found.base.model, recordings)
    if sentence and found.verdict != "nothing missing":
        return _without_names(found), [sentence]
    sentence = _unknown_delivery(found, recordings)
    if sentence and found.verdict != "nothing missing":
        return _without_names(found, OF_DRIVE), [sentence]
    if sentence := _changes_within_rows(found):
        return _without_names(found, {name for name, slot in SLOTS.items() if slot in FAST_SLOTS}), [sentence]
    if sentence := _current_loop_within_sample(found) or _structure_of_rounding(found) or _delay_of_path(found):
        return replace(found, verdict="cannot tell"), [sentence]
    unnamed = not_named(found.base.model, recordings)
    if name := next((step.added for step in found.steps if step.added in unnamed), ""):
        sentence = (
            f"{name} fits best, but no record is excited: strokes and moves hardly contain the frequencies at which it acts, so "
            "it is not named. Record an excitation (frf) and ask again."
        )
        return _without_names(found, unnamed), [sentence]
    if unnamed and found.verdict == NONE_EXPLAINS and found.final_fit.ratio < UNDECIDED:
        sentence = (
            f"An error of {found.final_fit.ratio:.2f} times the noise may be the noise itself: it is known to some "
            f"{100.0 * (UNDECIDED - 1.0):.0f} % "
            "where no record is excited. Record an excitation (frf) and ask again."
        )
        return replace(found, verdict="cannot tell"), [sentence]
    return found, [sentence] if (sentence := _contact_that_opens(found)) else []


def reservation(comparison: Comparison, fitted: Fitted, recordings: Sequence[Recording]) -> str:
    """Why the records do not tell whether something is missing, as :func:`restrict_to_scope` says of a diagnosis; "" where they do.

    Parameters
    ----------
    comparison : Comparison
        Of a model with them.
    fitted : Fitted
        Its fit.
    recordings : sequence of Recording
    """
    if (doubt := noise_doubt(comparison.ratio, recordings)) or not comparison.missing:
        return doubt
    rounding = _rounding_words(fitted) if comparison.missing == "structure" else ""
    return _sampling_doubt(comparison.ratio, fitted.model, recordings) or rounding


def _contact_that_opens(found: Diagnosis) -> str:
    """That a gap is likelier than any wrong number where nothing explains an error far above the noise, in words; "" where it is not."""
    unexplained = found.verdict == NONE_EXPLAINS and not found.added_effects
    if not unexplained or found.base.ratio <= FAR_OFF_BASE or "cart" not in found.base.model.base_bodies:
        return ""
    return (
        f"An error of {found.published_base[1].ratio:.3g} times the noise is rather no wrong mass, stiffness, friction or scale, which "
        "a fit would take up: something hits and lets go, as in a gap (backlash) that is wide for these records. Hold the motor and push "
        "the carriage both ways against a dial gauge; then look for a collision, and for what else is loose."
    )


def _acts_slowly(found: Diagnosis) -> bool:
    """True where the effect that was named first shows far below the antiresonance, too."""
    return bool(found.added_effects) and SLOTS.get(found.added_effects[0], FAST_SLOTS[0]) not in FAST_SLOTS


def _explains_nearly_all(found: Diagnosis) -> bool:
    """True where what was named takes an error that no sampling makes nearly to the noise, on records held out as well."""
    base, after = found.base, found.final_fit
    pairs = ((base.ratio, after.ratio), (base.held_out_ratio, after.held_out_ratio))
    return base.ratio > TOO_FAR_OFF and all(
        then is not None and now is not None and now**2 - 1.0 < HARDLY_LEFT * (then**2 - 1.0) for then, now in pairs
    )


def _speed_alone(found: Diagnosis, recordings: Sequence[Recording]) -> str:
    """That a reported speed is filtered and tells no place, in words; "" where a position was recorded or nothing rests on that."""
    named = next((name for name in found.added_effects if name in OF_DRIVE), "")
    if not any(r.sidecar.position_integrated for r in recordings) or not (named or found.verdict == NONE_EXPLAINS):
        return ""
    hint = f"; {named} fits best" if named else ""
    return (
        "The position is the integral of a reported speed, which drives filter: a delay or lag of the torque cannot be told from that "
        f"filter, nor what goes with the place from a place that is off{hint}. Record the position and ask again."
    )


def _ends_at_drive(found: Diagnosis) -> bool:
    """True where nothing is named, or something that a drive has as well."""
    return not found.added_effects or not OF_DRIVE.isdisjoint(found.added_effects)


def _without_names(found: Diagnosis, untold: Container[str] = SLOTS) -> Diagnosis:
    """The diagnosis as it was before the first of some effects was added, with no verdict.

    What was added before stands, what came after was found beside a name that does not.
    """
    number = next((number for number, step in enumerate(found.steps) if not step.added or step.added in untold), len(found.steps))
    kept = tuple(Stage(step.before, step.candidates, "", (), step.before) for step in found.steps[number : number + 1])
    data = found.data if number else found.first
    return replace(found, steps=(*found.steps[:number], *kept), verdict="cannot tell", twins=(), data=data)


def _commanded_only_words(found: Diagnosis) -> str:
    """That nothing independent tells how noisy a torque is of which only the command was recorded, in words."""
    units = units_of(found.base.model)
    return (
        f"The reported {units.word} is only the command that comes back: the motion is consistent with a noise of "
        f"{units.factor * found.data.noise_nm:.3g} {units.small} rms of what acts, which nothing independent confirms. Record the drive's "
        f"actual {units.word} (6077h) and ask again."
    )


def _undersampling_remark(model: Model, recordings: Sequence[Recording]) -> str:
    """That an axis swings too fast for the sampling, in words; "" where it does not.

    Between two samples nothing but a model says how the motor moves; with less than four of them to a swing that decides the fit.
    """
    resonance_hz, rate_hz = _swing_and_rate(model, recordings)
    if resonance_hz < SWING_SAMPLED * rate_hz:
        return ""
    wanted_hz = math.ceil(resonance_hz / SWING_SAMPLED / 10.0) * 10
    return (
        f"The axis swings at {resonance_hz:.0f} Hz and was sampled with {rate_hz:.0f} Hz: what it does in between "
        f"these records do not show. Record with at least {wanted_hz} Hz and ask again."
    )


def _swing_and_rate(model: Model, recordings: Sequence[Recording]) -> tuple[float, float]:
    """Resonance where the records were made, Hz, 0 for what does not swing, and the lowest sampling rate, Hz."""
    rate_hz = 1.0 / max(r.sample_period_s for r in recordings)
    if "cart" not in model.base_bodies:
        return 0.0, rate_hz
    shape = shape_of(model, float(np.median([r.sidecar.start_position_m or 0.0 for r in recordings])))
    return (shape.belt.resonance_hz if shape is not None else 0.0), rate_hz


def _sampling_doubt(ratio: float, model: Model, recordings: Sequence[Recording]) -> str:
    """Reason in words why the ratio to the noise may be no more than what so seldom a sampling leaves; "" for none."""
    resonance_hz, rate_hz = _swing_and_rate(model, recordings)
    far_off = ratio >= TOO_FAR_OFF and resonance_hz < UNSEEN * rate_hz
    return "" if far_off else _undersampling_remark(model, recordings)


def _unknown_delivery(found: Diagnosis, recordings: Sequence[Recording]) -> str:
    """That an error may be how the drive delivers and reads its torque, in words; "" where setpoints tell or only other names stand."""
    told = any(r.torque_setpoint is not None for r in recordings) or recordings[0].side == "load"
    if told or not _ends_at_drive(found) or found.base.ratio > FAR_OFF_BASE:
        return ""
    error = f"an error of {found.published_base[1].ratio:.2f} times the noise"
    named = next((name for name in found.added_effects if name in OF_DRIVE), "")
    hint = f"; {named} fits best" if named else ""
    return (
        f"Without the torque setpoint {error} cannot be told from a delay or a filter in the drive or in its torque reading{hint}. Record "
        "torque_setpoint_nm too and ask again."
    )


def _changes_within_rows(found: Diagnosis) -> str:
    """That the torque changes faster than it was recorded, in words; "" where the error does not change its sign from row to row.

    A torque that jumps within a row moves the motor by how early it jumped, which its mean does not tell: what is missing in one row was
    too much in the row before.
    """
    fitted = found.published_base[1]
    if found.final_fit.ratio < FAR_OFF_RECORD:
        return ""
    parts: dict[str, list[Array]] = {}
    for piece, white in zip(fitted.problem.pieces, np.split(fitted.residual, fitted.problem.ends[1:-1]), strict=True):
        if len(white) > 1:
            parts.setdefault(piece.record, []).append(white)
    power = {name: (sum(float(w @ w) for w in whites), sum(map(len, whites))) for name, whites in parts.items()}
    fast = [
        name for name, whites in parts.items() if power[name][0] > FAR_OFF_RECORD**2 * power[name][1] and correlation(whites) < ALTERNATES
    ]
    if not fast or sum(power[name][0] for name in fast) < MOST_OF_IT * sum(squares for squares, _ in power.values()):
        return ""
    return (
        f"The error in {', '.join(fast)} changes its sign from row to row: the torque changes within the rows, or they are interpolated, "
        "or the angle is noisier than it is known to be. Record with a shorter sample period and without interpolation, and ask again."
    )


def _current_loop_within_sample(found: Diagnosis) -> str:
    """That a lag may be the drive's own current loop, whose torque is read when it has settled, in words; "" where it is none."""
    path, time_s = found.data.path, found.final_fit.model.get("current_lag.time")
    shaped = path.drive is None or bool(path.drive.lags) or not path.read_as_acts
    if found.added_effects != ["current_lag"] or shaped or abs(time_s) > WITHIN_SAMPLE * found.data.recordings[0].sample_period_s:
        return ""
    return (
        f"A lag of {1e3 * time_s:.2g} ms explains it, and a current loop as fast as that has settled when the drive reads its torque: "
        "whether it is the drive's, or lies behind it, these records do not tell. The design counts it either way; a record at a shorter "
        "sample period would tell."
    )


def _structure_of_rounding(found: Diagnosis) -> str:
    """That what is left is no more than the noise, most of which is rounding that goes with the motion, in words; "" where it is not."""
    fitted = found.final_fit
    if found.verdict != NONE_EXPLAINS or found.added_effects or not fitted.problem.samples:
        return ""
    return "" if fitted.objective / fitted.problem.samples >= NOISE_KNOWN else _rounding_words(fitted)


def _rounding_words(fitted: Fitted) -> str:
    """That a structure may be that of the rounding, which is most of the noise, in words; "" where it is not most."""
    if rounded_share(fitted) < MOSTLY_ROUNDING:
        return ""
    return (
        f"What is left is no more than the noise ({fitted.ratio:.2f} times), but not random. Most of that noise is the rounding of the "
        "encoder, which goes with the motion, too: whether something is missing these records do not tell. A longer sample period, or a "
        "finer encoder, would tell."
    )


def _delay_of_path(found: Diagnosis) -> str:
    """That what is left may be a delay behind the drive or the rest of its torque path, in words; "" where no small delay explains it."""
    last = found.steps[-1].candidates if found.steps else ()
    delay = next((c for c in last if c.of_path and c.stands and c.evidence > EVIDENCE), None)
    if found.verdict not in (NONE_EXPLAINS, "partly explained") or delay is None or delay.fitted is None:
        return ""
    time_s = delay.fitted.model.parameters.get(f"{delay.effect.name}.time")
    named = f"A {delay.effect.name} of {1e3 * time_s.value:.2g} ms" if time_s else f"{delay.effect.title.capitalize()} that does not swing"
    return (
        f"{named} would explain some of it, and so would a filter in the drive or in its torque "
        f"reading that differs a little from the one found: {found.final_fit.ratio:.2f} times the noise do not tell them apart. A record "
        "at a shorter sample period, or with a finer encoder, would tell."
    )


def not_named(model: Model, recordings: Sequence[Recording]) -> set[str]:
    """Effects that these records cannot bear a name of.

    Parameters
    ----------
    model : Model
        The base model.
    recordings : sequence of Recording
        Of the diagnosis.

    Returns
    -------
    set of str
        Names; empty where a record is excited.
    """
    if "cart" not in model.base_bodies or _is_excited(recordings):
        return set()
    return {effect.name for effect in EFFECTS if effect.slot in FAST_SLOTS}


def _is_excited(recordings: Sequence[Recording]) -> bool:
    """True if a record to fit is excited."""
    return any(r.sidecar.experiment == "frf" and not r.sidecar.held_out for r in recordings)


def missing_records(recordings: Sequence[Recording], ratio_m_rad: float) -> list[str]:
    """Kinds of records that a belt axis' data set lacks, as sentences.

    Parameters
    ----------
    recordings : sequence of Recording
    ratio_m_rad : float
        Carriage travel per radian of the motor.
    """
    to_fit = [r for r in recordings if not (r.sidecar.held_out or r.is_static_map)]
    lines = []
    if not _is_excited(to_fit):
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
