"""Checks of the records of a run together: sampling, signs, places, one axis.  Before anything is fitted.

What no analysis can mend raises DataError with the remedy; the rest are sentences, and what can be put right beyond doubt is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from beltcomm.arrays import Array
from beltcomm.axis import Axis
from beltcomm.errors import DataError
from beltcomm.fit.noise.level import torque_noise
from beltcomm.foreign.checks import DrivesItsMotor, check
from beltcomm.laboratory.extracts import extract_long
from beltcomm.laboratory.gap_checks import before_gaps, check_whole, gap_remarks
from beltcomm.laboratory.place_checks import checked_positions, names_of, sensor_remarks
from beltcomm.recording import Recording
from beltcomm.recording.checks import clipped_share, long_steps, rigid_inertia, unit_words
from beltcomm.recording.columns import CHANNELS
from beltcomm.recording.sampling import EVEN, SIGMAS, Jitter, Uneven, encoder_grid, finest, stamp_jitter, uneven_rows
from beltcomm.recording.sidecar import Sidecar

#: s; no record shorter than this shows a motion, its start and its end left aside.
SHORTEST_S = 1.0
#: rad/s; below this the motor may be sticking, and the model's equation says nothing (``identify.residual``).
SLOWEST_RAD_S = 0.5
#: s; for so long at least it must not.
LEAST_MOVING_S = 0.5
#: Rows amiss in one record from which on it is no single slip of the encoder.
SEVERAL = 2
#: Share of the period by which samples may be off even ones and still be put right, and how far the motion's unevenness may be from that
#: of the stamps, beside its own deviations.
MOST_MOVED, TRUE_STAMPS = 0.03, 0.2
#: Share of the position's unevenness that may come from uneven sampling.
MOST_UNEVEN = 0.5
#: Relative difference of two records' inertia, beside four standard deviations, that payload mode, saturation and eccentricity do not
#: make; share of the friction that the torque of acceleration must reach to be judged; largest standard deviation.
INERTIA, DYNAMIC, VAGUE = 0.25, 0.5, 0.1
#: Standard deviations by which an inertia must be below nothing.
NEGATIVE = 6.0
#: By how much a data sheet's inertia may be too large, as a share.
LIGHT = 0.3
#: Relative difference of the encoder's step between two records of one encoder.
SAME_STEP = 1e-3
#: Times an encoder's step that a record may show, read or rounded coarser.
MOST_COARSE = 16


@dataclass(frozen=True)
class Checked:
    """The records of a run after all checks.

    Attributes
    ----------
    recordings : tuple of Recording
        Fit to be analysed together.
    remarks : tuple of str
        Sentences on what is odd, and on what was put right.
    """

    recordings: tuple[Recording, ...]
    remarks: tuple[str, ...]


def check_run(recordings: Sequence[Recording], axis: Axis, *, foreign: bool) -> Checked:
    """The recordings of a run, put right where that is beyond doubt.

    Parameters
    ----------
    recordings : sequence of Recording
    axis : Axis
    foreign : bool
        Not made by a drive of the tool's own.

    Raises
    ------
    DataError
        For records that cannot be analysed, naming them, with what to do.
    """
    timed = [r for r in recordings if not r.is_static_map]
    if not timed:
        raise DataError("all records are static maps, which hold no motion; a model needs records with t_s")
    remarks: list[str] = []
    _refuse_short(timed, axis)
    check_whole(timed)
    evened = _check_sampling(timed, axis, remarks)
    if axis.get("pulley.effective_radius_m") is not None:
        evened = before_gaps(evened, remarks)
    else:
        remarks += gap_remarks(evened)
    if foreign:
        _check_each(evened, axis)
    _refuse_two_axes(evened, axis)
    known = checked_positions(evened, axis, remarks)
    remarks += sensor_remarks(known, axis)
    parts = {record.name: [record] for record in known} | extract_long(known, axis, remarks)
    return Checked(tuple(part for r in recordings for part in parts.get(r.name, [r] if r.is_static_map else [])), tuple(remarks))


def _check_each(timed: Sequence[Recording], axis: Axis) -> None:
    """Raise DataError for a record that is odd by itself; that its axis drives its motor is told sharper by the others, where they can."""
    for record in timed:
        try:
            check(record)
        except DrivesItsMotor:
            _refuse_two_axes(timed, axis)
            raise


def _refuse_short(timed: Sequence[Recording], axis: Axis) -> None:
    to_fit = [r for r in timed if not r.sidecar.held_out]
    if not to_fit:
        raise DataError("all recordings are held out or static maps; nothing is left to fit: set held_out: false in the sidecar of one")
    longest = max(to_fit, key=lambda record: record.duration_s)
    if longest.duration_s < SHORTEST_S:
        raise DataError(
            f"the records are too short: the longest that may be fitted, {longest.name}, lasts {longest.duration_s:.2g} s, at least "
            f"{SHORTEST_S:g} s of motion are needed (a stroke or an excitation of several seconds tells more); record longer"
        )
    if longest.side == "motor" and axis.get("pulley.effective_radius_m") is not None:
        moving = sum(_moving_s(r) for r in to_fit)
        if moving < LEAST_MOVING_S:
            raise DataError(
                f"the motor turns faster than {SLOWEST_RAD_S:g} rad/s in only {moving:.2g} s of {names_of(to_fit)}; at least "
                f"{LEAST_MOVING_S:g} s "
                "are needed, for a motor that creeps or sticks shows its friction and nothing else; record strokes or an excitation"
            )


def _moving_s(record: Recording) -> float:
    """s for which the motor turns, its speed taken over 10 ms."""
    span = max(1, round(0.01 / record.sample_period_s))
    if len(record.position) <= span:
        return 0.0
    speed = np.abs(record.position[span:] - record.position[:-span]) / (record.t_s[span:] - record.t_s[:-span])
    return float(np.count_nonzero(speed > SLOWEST_RAD_S)) * record.sample_period_s


def _check_sampling(timed: Sequence[Recording], axis: Axis, remarks: list[str]) -> list[Recording]:
    """Rows that are missing, repeated or uneven."""
    amiss = [(r, uneven_rows(r.t_s, r.position)) for r in timed]
    twice = sum(len(u.repeated) for _, u in amiss) > sum(len(u.missing) for _, u in amiss)
    for faults in (_refuse_repeated, _refuse_missing) if twice else (_refuse_missing, _refuse_repeated):
        faults(amiss)
    for record, uneven in amiss:
        if uneven.share > 0.0:
            row = int(np.concatenate((uneven.missing, uneven.repeated))[0])
            remarks.append(
                f"{record.name}: near t = {record.t_s[row]:.4g} s the position makes one step that its motion before and after does not "
                "allow: a lost sample without a gap in t_s, or a slip of the encoder"
            )
    stamps = {r.name: stamp_jitter(r.t_s, r.position, long_steps(r.t_s)) for r in timed}
    uneven_ones = [
        (r, j) for r in timed if (j := stamps[r.name]) is not None and j.real and (j.share > MOST_UNEVEN or _poses(r, j, axis) > 1.0)
    ]
    beyond = [(r, j) for r, j in uneven_ones if j.largest > MOST_MOVED or abs(j.slope - 1.0) > SIGMAS * j.error + TRUE_STAMPS]
    if beyond:
        raise _jitter_fault(beyond, axis)
    false_stamps = [r for r in timed if (j := stamps[r.name]) is not None and j.only_stamps]
    real_stamps = [r for r in timed if (j := stamps[r.name]) is not None and j.real]
    evened = []
    worst = 0.0
    for record in timed:
        found = stamps[record.name]
        # one clock stamps all records: where one shows that the samples were even, those that cannot tell are taken to be, too
        if found is not None and (found.only_stamps or (false_stamps and not real_stamps)):
            worst = max(worst, found.largest)
            record = replace(record, t_s=record.t_s[0] + found.period_s * _whole(record, found.period_s), notes=())
        elif uneven_ones and found is not None and found.largest <= MOST_MOVED:  # again, one clock stamps all
            record = _resample(record, found.period_s)
        evened.append(record)
    if worst > 1e-3:
        remarks.append(
            f"the time stamps jitter by up to {100.0 * worst:.2g} % of the sample period, but the motion shows that the samples were taken "
            "evenly: the stamps were set even"
        )
    if uneven_ones:
        largest = max(float(j.largest) for _, j in uneven_ones)
        remarks.append(
            f"the samples were taken unevenly, by up to {100.0 * largest:.2g} % of the period, at the times that t_s says "
            f"({names_of(r for r, _ in uneven_ones)} show it): the angle was interpolated to even ones"
        )
    elif real_stamps:
        largest = max(float(j.largest) for r in real_stamps if (j := stamps[r.name]) is not None)
        remarks.append(
            f"{names_of(real_stamps)}: the samples were taken unevenly, by up to {100.0 * largest:.2g} % of the period; the motion is slow "
            "enough that this is less than the noise of torque and encoder"
        )
    remarks += _clip_remarks(evened)
    return evened


def _clip_remarks(timed: Sequence[Recording]) -> list[str]:
    shares = [(r, clipped_share(r.torque, r.torque_setpoint, None)) for r in timed]
    found = [(r, share) for r, share in shares if share > 0.0]
    if not found:
        return []
    record, share = max(found, key=lambda one: one[1])
    return [
        f"{names_of(r for r, _ in found)}: {CHANNELS[record.side]['torque']} stands at the end of its range, in {record.name} at "
        f"{np.abs(record.torque).max():.4g} {record.torque_unit} in {100.0 * share:.2g} % of the rows: cut off there; take "
        "torque_saturation in what follows for that"
    ]


def _whole(record: Recording, period_s: float) -> Array:
    """Number of each sample on an even clock: lost ones stay lost."""
    steps = np.diff(record.t_s) / period_s
    whole = np.abs(steps - np.round(steps)) < EVEN
    largest = float(np.abs(steps - 1.0)[~whole].max(initial=0.0))  # jitter alone makes steps of that size
    counts = np.where(whole & (np.round(steps) > 1.5 + largest), np.round(steps), 1.0)
    for gap in long_steps(record.t_s):  # a stamp that came late makes a long step and a short one beside it, and nothing is lost
        around = steps[max(gap - 1, 0) : gap + 2]
        counts[gap] = max(1.0, round(float(around.sum())) - len(around) + 1.0)
    return np.concatenate(([0.0], np.cumsum(counts)))


def _resample(record: Recording, period_s: float) -> Recording:
    """The record with its angle at even times, by a cubic between the samples; lost ones stay lost.

    By far less than a period: the rounding of the angle stays what it was, and what acted over an interval stays the torque of its sample.
    """
    even = period_s * _whole(record, period_s)
    even = even + float(np.mean(record.t_s - even))
    return replace(record, t_s=even, position=CubicSpline(record.t_s, record.position)(even), notes=())


def _refuse_missing(amiss: Sequence[tuple[Recording, Uneven]]) -> None:
    found = [(r, uneven) for r, uneven in amiss if len(uneven.missing) >= SEVERAL]
    if not found:
        return
    worst, uneven = max(found, key=lambda one: one[1].share)
    row = int(uneven.missing[0])
    raise DataError(
        f"{names_of(r for r, _ in found)}: samples are missing although t_s goes on evenly: in {worst.name} {len(uneven.missing)} steps of "
        f"{CHANNELS[worst.side]['position']} are twice as long as those before and after ({100.0 * uneven.share:.2g} % of the steps that "
        f"show it, the first before row {row + 1}, t = {worst.t_s[row]:.4g} s; at most 1 is allowed per record). Keep the true time "
        "stamps, so that the gaps can be seen, or record again with a shorter bus load or a lower rate"
    )


def _refuse_repeated(amiss: Sequence[tuple[Recording, Uneven]]) -> None:
    found = [(r, uneven) for r, uneven in amiss if len(uneven.repeated) >= SEVERAL]
    if not found:
        return
    worst, uneven = max(found, key=lambda one: one[1].share)
    row = int(uneven.repeated[0])
    alike = [np.any(np.isin([worst.torque[i]], worst.torque[[i - 1, min(i + 1, len(worst.torque) - 1)]])) for i in uneven.repeated]
    if np.mean(alike) > 0.5:
        what = "rows were written twice although t_s goes on"
        remedy = "leave one of each out and keep the true time stamps, or record again: the logger reads faster than the drive answers "
        remedy += f"(a file from elsewhere may be imported again with --resample {0.1 / worst.sample_period_s:.2g}Hz)"
    else:
        what = "the angle stands still for single samples while the motor turns"
        remedy = "look at the encoder, its cable and its coupling (codes that stick), then record again"
    raise DataError(
        f"{names_of(r for r, _ in found)}: {what}: in {worst.name} {len(uneven.repeated)} steps of {CHANNELS[worst.side]['position']} are "
        f"nothing between equal ones ({100.0 * uneven.share:.2g} % of the steps that show it, the first in row {row + 1}, "
        f"t = {worst.t_s[row]:.4g} s; at most 1 is allowed per record); {remedy}"
    )


def _poses(record: Recording, jitter: Jitter, axis: Axis) -> float:
    """Torque that uneven samples pose as, over the noise of torque and rounding as the motor's equation has them; 0 where nobody knows."""
    inertia = axis.motor_side_inertia_kg_m2 if record.side == "motor" and axis.get("motor.inertia_kg_m2") is not None else None
    if inertia is None:
        found = rigid_inertia(record.t_s, record.torque, record.position)
        inertia = 0.0 if found is None else abs(found.inertia)
    per_bend = inertia / jitter.period_s**2
    # the torque of two rows acts on one bend of the angle, the rounding of three angles makes one
    noise = math.hypot(math.sqrt(0.5) * torque_noise([record], 0.0), per_bend * math.sqrt(6.0 / 12.0) * finest(record.position))
    return per_bend * jitter.bend / noise if noise > 0.0 else 0.0


def _jitter_fault(found: Sequence[tuple[Recording, Jitter]], axis: Axis) -> DataError:
    worst, jitter = max(found, key=lambda one: one[1].rms)
    poses = _poses(worst, jitter, axis)
    rough = f"{100.0 * jitter.share:.0f} % of the position's roughness (allowed: {100.0 * MOST_UNEVEN:.0f} %)"
    loud = f"{poses:.2g} times the noise of torque and encoder (allowed: 1)"
    return DataError(
        f"{names_of(r for r, _ in found)}: the samples were taken unevenly: in {worst.name} the steps of t_s deviate by up to "
        f"{100.0 * jitter.largest:.2g} % from {1e3 * jitter.period_s:.4g} ms, the motion follows them, and this makes "
        f"{rough if jitter.share > MOST_UNEVEN else loud}: it would pose as torque. "
        "Let the drive sample by its own clock (trace, SYNC) and record again, or import with --resample, which evens the rows out"
    )


def _refuse_two_axes(timed: Sequence[Recording], axis: Axis) -> None:
    """Raise DataError for records of an axis with another inertia, or another encoder."""
    weight = axis.get("pulley.effective_radius_m") is None and timed[0].side != "load"
    told = [(r, found) for r in timed if (found := rigid_inertia(r.t_s, r.torque, r.position, weight=weight)) is not None]
    sure = [(r, found) for r, found in told if found.inertia > 0.0 and found.error < VAGUE * found.inertia]
    # A record that hardly slides tells its own friction too low: that of the surest record counts as well.
    # And where cogging holds a slow motion up, the torque that it takes poses as that of an inertia many times too large: how much a record
    # accelerates counts with the inertia of the surest.
    best = min((found for _, found in sure), key=lambda found: found.error / found.inertia, default=None)
    own = [
        (r, found.inertia, found.error)
        for r, found in sure
        if best is not None and found.accelerating * min(1.0, best.inertia / found.inertia) > DYNAMIC * max(found.friction, best.friction)
    ]
    # A reading that is filtered or late shows the friction of a short stroke late, which poses as a negative inertia; but it brakes on.
    _refuse_negative([r for r, found in told if found.inertia < -NEGATIVE * found.error and found.dissipated <= 0.0 and own])
    _refuse_light(own, axis)
    for load in dict.fromkeys(_load_key(r.sidecar) for r, _, _ in own):
        _refuse_apart([one for one in own if _load_key(one[0].sidecar) == load])
    if timed[0].side == "motor":
        _refuse_two_encoders(timed)


def _refuse_apart(own: Sequence[tuple[Recording, float, float]]) -> None:
    """Raise DataError where records of one load, as far as they say, show different inertias."""
    if len(own) < 2:
        return
    values, errors = np.array([[i, e] for _, i, e in own]).T
    apart = np.abs(values[:, None] - values[None, :]) - 4.0 * np.hypot(errors[:, None], errors[None, :])
    far = apart > INERTIA * np.minimum(values[:, None], values[None, :])
    if far.any():
        # of those that contradict somebody the one that contradicts the fewest
        kept = int(np.argmin(np.where(far.any(axis=1), far.sum(axis=1), len(own))))
        _, first, error = own[kept]
        like = [r for (r, _, _), other in zip(own, far[kept], strict=True) if not other]
        unit, others, rest = own[0][0].inertia_unit, list[str](), np.flatnonzero(far[kept])
        while len(rest):
            (_, value, width), alike = own[rest[0]], ~far[rest[0], rest]
            others.append(f"{names_of(own[n][0] for n in rest[alike])} {value:.3g} ± {2.0 * width:.1g} {unit}")
            rest = rest[~alike]
        raise DataError(
            f"the records are not of one axis, or not with one payload: {names_of(like)} show an inertia of {first:.3g} ± "
            f"{2.0 * error:.1g} {unit} in all, {', '.join(others)} "
            f"(allowed: {100.0 * INERTIA:.0f} % apart). If another load was mounted, say so in their sidecars: payload_kg (or "
            "payload_inertia_kg_m2) where it is known, else `load: NAME`, and the fit finds it (import: --payload, --load). Keep those of "
            "another axis in a run of their own; if nothing was changed, a column of one of them is in another unit"
        )


def _load_key(sidecar: Sidecar) -> tuple[object, ...]:
    """Key of the records that carry the same load, as far as they say."""
    return sidecar.load, sidecar.payload_kg, sidecar.payload_inertia_kg_m2


def _refuse_negative(negative: Sequence[Recording]) -> None:
    if negative:
        channels = CHANNELS[negative[0].side]
        raise DataError(
            f"{names_of(negative)}: the torque drives against its motion there (the inertia would be negative), in the other records with "
            f"it: the sign of {channels['torque']} or of {channels['position']} is turned in these; turn it back"
        )


def _refuse_light(own: Sequence[tuple[Recording, float, float]], axis: Axis) -> None:
    """Raise DataError when everything that the motor turns weighs less than the motor alone by its data sheet."""
    if not own or own[0][0].side != "motor" or axis.get("motor.inertia_kg_m2") is None:
        return
    sheet = axis.motor_side_inertia_kg_m2
    record, inertia, error = min(own, key=lambda one: one[2] / one[1])
    if (inertia + 4.0 * error) * (1.0 + LIGHT) < sheet:
        raise DataError(
            f"{record.name} shows an inertia of {inertia:.3g} kg m² of everything that the motor turns, carriage included; by {axis} the "
            f"motor's side alone has {sheet:.3g} kg m². Look at the unit of {CHANNELS['motor']['torque']} (N m wanted), at that of "
            f"{CHANNELS['motor']['position']} (rad wanted) and at motor.inertia_kg_m2"
        )


def _refuse_two_encoders(timed: Sequence[Recording]) -> None:
    steps = [(r, step) for r in timed if (step := encoder_grid(r.position)) is not None]
    if not steps:
        return
    # the step that most records share; a multiple of it is a coarser reading of the same encoder
    known = max((step for _, step in steps), key=lambda one: sum(_same_step(one, other) for _, other in steps))
    unlike = [(r, step) for r, step in steps if not _same_step(known, step)]
    if not unlike:
        return
    like = [r for r, step in steps if _same_step(known, step)]
    unit = unit_words(unlike[0][1] / known, "angle", "angle of the others")
    if unit:
        raise DataError(
            f"{names_of(r for r, _ in unlike)}: {unit}: its steps are {unlike[0][1] / known:.4g} times those of "
            f"{names_of(like)}; convert the "
            "column, so that all records have one unit"
        )
    raise DataError(
        f"the records are not of one axis: the angles of {names_of(like)} are whole steps of {math.tau / known:.0f} "
        "counts per turn, those of "
        f"{names_of(r for r, _ in unlike)} of {math.tau / unlike[0][1]:.0f}: they were made with another encoder. Keep "
        "those of each axis in "
        "a run of its own"
    )


def _same_step(one: float, other: float) -> bool:
    quotient = max(one, other) / min(one, other)
    return round(quotient) <= MOST_COARSE and abs(quotient - round(quotient)) < SAME_STEP
