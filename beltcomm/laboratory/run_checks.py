"""Whether the records of a run can be analysed together: sampling, signs, places, one axis.  Before anything is fitted.

What no analysis can mend raises DataError with the remedy; the rest are sentences, and what can be put right beyond doubt is.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from beltcomm.axis import Axis
from beltcomm.errors import DataError
from beltcomm.foreign.checks import check
from beltcomm.recording import Recording
from beltcomm.recording_checks import rigid_inertia
from beltcomm.recording_columns import CHANNELS
from beltcomm.sampling_checks import Jitter, Uneven, encoder_grid, stamp_jitter, uneven_rows

Array = NDArray[np.float64]

#: s; no record shorter than this shows a motion, its start and its end left aside.
SHORTEST_S = 1.0
#: Rows amiss in one record from which on it is no single slip of the encoder.
SEVERAL = 2
#: Share of the position's unevenness that may come from uneven sampling.
MOST_UNEVEN = 0.5
#: m; places by a ruler and by the angle may differ by this.
PLACE_M = 2e-3
#: Share of the records that must agree before the others are called wrong; relative difference of two ways to measure the radius.
MAJORITY, RADIUS = 0.6, 0.02
#: Relative difference of two records' inertia, beside four standard deviations, that payload mode, saturation and eccentricity do not
#: make; share of the friction that the torque of acceleration must reach to be judged; largest standard deviation.
INERTIA, DYNAMIC, VAGUE = 0.25, 0.5, 0.1
#: Relative difference of the encoder's step between two records of one encoder.
SAME_STEP = 1e-3


@dataclass(frozen=True)
class Checked:
    """recordings : fit to be analysed together.   remarks : sentences on what is odd, and on what was put right."""

    recordings: tuple[Recording, ...]
    remarks: tuple[str, ...]


def checked(recordings: Sequence[Recording], axis: Axis, *, foreign: bool) -> Checked:
    """The recordings of a run, put right where that is beyond doubt.   foreign : not made by a drive of the tool's own.

    Raises DataError for records that cannot be analysed, naming them, with what to do.
    """
    timed = [r for r in recordings if not r.is_static_map]
    if not timed:
        raise DataError("all records are static maps, which hold no motion; a model needs records with t_s")
    remarks: list[str] = []
    _refuse_short(timed)
    evened = _sampled(timed, remarks)
    if foreign:
        for record in evened:
            check(record)
    _refuse_two_axes(evened)
    placed = _placed(evened, axis, remarks)
    remarks += _sensor_remarks(placed, axis)
    by_name = {record.name: record for record in placed}
    return Checked(tuple(by_name.get(r.name, r) for r in recordings), tuple(remarks))


def _names(records: Iterable[Recording]) -> str:
    names = [r.name for r in records]
    return ", ".join(names) if len(names) <= 4 else f"{', '.join(names[:3])} and {len(names) - 3} more"


def _duration(record: Recording) -> float:
    return float(record.t_s[-1] - record.t_s[0])


def _refuse_short(timed: Sequence[Recording]) -> None:
    to_fit = [r for r in timed if not r.sidecar.held_out]
    if not to_fit:
        raise DataError("all recordings are held out or static maps; nothing is left to fit: set held_out: false in the sidecar of one")
    longest = max(to_fit, key=_duration)
    if _duration(longest) < SHORTEST_S:
        raise DataError(
            f"the records are too short: the longest that may be fitted, {longest.name}, lasts {_duration(longest):.2g} s, at least "
            f"{SHORTEST_S:g} s of motion are needed (a stroke or an excitation of several seconds tells more); record longer"
        )


def _sampled(timed: Sequence[Recording], remarks: list[str]) -> list[Recording]:
    """Rows that are missing, repeated or uneven."""
    amiss = [(r, uneven_rows(r.t_s, r.position)) for r in timed]
    _refuse_missing([(r, u) for r, u in amiss if len(u.missing) >= SEVERAL])
    _refuse_repeated([(r, u) for r, u in amiss if len(u.repeated) >= SEVERAL])
    for record, uneven in amiss:
        if uneven.share > 0.0:
            row = int(np.concatenate((uneven.missing, uneven.repeated))[0])
            remarks.append(
                f"{record.name}: near t = {record.t_s[row]:.4g} s the position makes one step that its motion before and after does not "
                "allow: a lost sample without a gap in t_s, or a slip of the encoder"
            )
    stamps = {r.name: stamp_jitter(r.t_s, r.position) for r in timed}
    uneven_ones = [(r, j) for r in timed if (j := stamps[r.name]) is not None and j.real and j.share > MOST_UNEVEN]
    if uneven_ones:
        raise _jitter_fault(uneven_ones)
    false_stamps = [r for r in timed if (j := stamps[r.name]) is not None and j.only_stamps]
    real_stamps = [r for r in timed if (j := stamps[r.name]) is not None and j.real]
    evened = []
    worst = 0.0
    for record in timed:
        found = stamps[record.name]
        # one clock stamps all records: where one shows that the samples were even, those that cannot tell are taken to be, too
        if found is not None and (found.only_stamps or (false_stamps and not real_stamps)):
            worst = max(worst, found.largest)
            record = replace(record, t_s=record.t_s[0] + found.period_s * _whole(record.t_s, found.period_s), notes=())
        evened.append(record)
    if worst > 1e-3:
        remarks.append(
            f"the time stamps jitter by up to {100.0 * worst:.2g} % of the sample period, but the motion shows that the samples were taken "
            "evenly: the stamps were set even"
        )
    if real_stamps:
        largest = max(float(j.largest) for r in real_stamps if (j := stamps[r.name]) is not None)
        remarks.append(
            f"{_names(real_stamps)}: the samples were taken unevenly, by up to {100.0 * largest:.2g} % of the period; the motion is slow "
            "enough that this is less than the position's own noise"
        )
    remarks += _gap_remarks(evened)
    return evened


def _whole(t_s: Array, period_s: float) -> Array:
    """Number of each sample on an even clock: lost ones, whole periods long, stay lost."""
    steps = np.diff(t_s) / period_s
    lost = (np.round(steps) >= 2.0) & (np.abs(steps - np.round(steps)) < 0.02)
    return np.concatenate(([0.0], np.cumsum(np.where(lost, np.round(steps), 1.0))))


def _refuse_missing(found: Sequence[tuple[Recording, Uneven]]) -> None:
    if not found:
        return
    worst, uneven = max(found, key=lambda one: one[1].share)
    row = int(uneven.missing[0])
    raise DataError(
        f"{_names(r for r, _ in found)}: samples are missing although t_s goes on evenly: in {worst.name} {len(uneven.missing)} steps of "
        f"{CHANNELS[worst.side]['position']} are twice as long as those before and after ({100.0 * uneven.share:.2g} % of the steps that "
        f"show it, the first before row {row + 1}, t = {worst.t_s[row]:.4g} s; at most 1 is allowed per record). Keep the true time "
        "stamps, so that the gaps can be seen, or record again with a shorter bus load or a lower rate"
    )


def _refuse_repeated(found: Sequence[tuple[Recording, Uneven]]) -> None:
    if not found:
        return
    worst, uneven = max(found, key=lambda one: one[1].share)
    row = int(uneven.repeated[0])
    alike = [np.any(np.isin([worst.torque[i]], worst.torque[[i - 1, min(i + 1, len(worst.torque) - 1)]])) for i in uneven.repeated]
    if np.mean(alike) > 0.5:
        what = "rows were written twice although t_s goes on"
        remedy = "leave one of each out and keep the true time stamps, or record again: the logger reads faster than the drive answers"
    else:
        what = "the angle stands still for single samples while the motor turns"
        remedy = "look at the encoder, its cable and its coupling (codes that stick), then record again"
    raise DataError(
        f"{_names(r for r, _ in found)}: {what}: in {worst.name} {len(uneven.repeated)} steps of {CHANNELS[worst.side]['position']} are "
        f"nothing between equal ones ({100.0 * uneven.share:.2g} % of the steps that show it, the first in row {row + 1}, "
        f"t = {worst.t_s[row]:.4g} s; at most 1 is allowed per record); {remedy}"
    )


def _jitter_fault(found: Sequence[tuple[Recording, Jitter]]) -> DataError:
    worst, jitter = max(found, key=lambda one: one[1].rms)
    return DataError(
        f"{_names(r for r, _ in found)}: the samples were taken unevenly: in {worst.name} the steps of t_s deviate by up to "
        f"{100.0 * jitter.largest:.2g} % from {1e3 * jitter.period_s:.4g} ms, the motion follows them, and this makes "
        f"{100.0 * jitter.share:.0f} % of the position's roughness (allowed: {100.0 * MOST_UNEVEN:.0f} %): it would pose as torque. "
        "Let the drive sample by its own clock (trace, SYNC) and record again"
    )


def _gap_remarks(timed: Sequence[Recording]) -> list[str]:
    with_gaps = [(r, gaps) for r in timed if len(gaps := r.gaps())]
    if not with_gaps:
        return []
    count, rows = sum(len(gaps) for _, gaps in with_gaps), sum(len(r.t_s) for r, _ in with_gaps)
    longest = max(float(np.diff(r.t_s)[gaps].max()) for r, gaps in with_gaps)
    return [
        f"samples were lost at {count} places of {_names(r for r, _ in with_gaps)} ({100.0 * count / rows:.2g} % of the rows, the longest "
        f"gap is {1e3 * longest:.3g} ms): the model is judged on the pieces between them"
    ]


def _ratio(axis: Axis) -> float | None:
    return axis.transmission_m_rad if axis.get("pulley.effective_radius_m") is not None else None


def _refuse_two_axes(timed: Sequence[Recording]) -> None:
    """Raise DataError for records of an axis with another inertia, or another encoder."""
    own: list[tuple[Recording, float, float]] = []
    for record in timed:
        found = rigid_inertia(record.t_s, record.torque, record.position)
        if found is not None and found.inertia > 0.0 and found.dynamic > DYNAMIC and found.error < VAGUE * found.inertia:
            own.append((record, found.inertia, found.error))
    payloads = {r.sidecar.payload_kg for r, _, _ in own}
    if len(own) > 1 and len(payloads) == 1:
        values, errors = np.array([[i, e] for _, i, e in own]).T
        apart = np.abs(values[:, None] - values[None, :]) - 4.0 * np.hypot(errors[:, None], errors[None, :])
        far = apart > INERTIA * np.minimum(values[:, None], values[None, :])
        if far.any():
            kept = int(np.argmin(far.sum(axis=1)))
            _, first, error = own[kept]
            like = [r for (r, _, _), other in zip(own, far[kept], strict=True) if not other]
            unlike = [one for one, other in zip(own, far[kept], strict=True) if other]
            unit = timed[0].inertia_unit
            raise DataError(
                f"the records are not of one axis, or not with one payload: {_names(like)} show an inertia of {first:.3g} ± "
                f"{2.0 * error:.1g} {unit} in all, {_names(r for r, _, _ in unlike)} {unlike[0][1]:.3g} ± {2.0 * unlike[0][2]:.1g} {unit} "
                f"(allowed: {100.0 * INERTIA:.0f} % apart). Keep those of each axis and payload in a run of its own, or state payload_kg in "
                "the sidecars and fit one payload at a time; if it is one axis, a column of one of them is in another unit"
            )
    if timed[0].side == "motor":
        _refuse_two_encoders(timed)


def _refuse_two_encoders(timed: Sequence[Recording]) -> None:
    steps = [(r, step) for r in timed if (step := encoder_grid(r.position)) is not None]
    if not steps:
        return
    known = float(np.median([step for _, step in steps]))
    unlike = [(r, step) for r, step in steps if abs(step / known - 1.0) > SAME_STEP and abs(known / step - round(known / step)) > SAME_STEP]
    unlike = [(r, step) for r, step in unlike if abs(step / known - round(step / known)) > SAME_STEP]
    if unlike:
        like = [r for r, _ in steps if r not in [other for other, _ in unlike]]
        raise DataError(
            f"the records are not of one axis: the angles of {_names(like)} are whole steps of {math.tau / known:.0f} counts per turn, those "
            f"of {_names(r for r, _ in unlike)} of {math.tau / unlike[0][1]:.0f}: they were made with another encoder. Keep those of each "
            "axis in a run of its own"
        )


@dataclass(frozen=True)
class _Line:
    """Start position over angle.   slope : m/rad.   zero_m : m, position at angle 0.   far : (n,) m, distance of each record."""

    slope: float
    zero_m: float
    far: Array

    @property
    def agree(self) -> NDArray[np.bool_]:
        """Records that lie on it."""
        return np.abs(self.far) <= PLACE_M


def _line(angle: Array, place: Array, slope: float | None = None) -> _Line:
    """The line that most records agree with: through pairs of them, or with a known slope."""
    if slope is not None:
        zeros = place - slope * angle
        lines = [_Line(slope, float(zero), zeros - zero) for zero in zeros]
    else:
        lines = []
        for i in range(len(angle)):
            for j in range(i):
                if abs(angle[i] - angle[j]) > 1e-9:
                    through = float((place[i] - place[j]) / (angle[i] - angle[j]))
                    zero = float(place[i] - through * angle[i])
                    lines.append(_Line(through, zero, place - zero - through * angle))
    return max(lines, key=lambda line: (int(line.agree.sum()), -float(np.sum(np.minimum(np.abs(line.far), PLACE_M)))))


def _placed(timed: Sequence[Recording], axis: Axis, remarks: list[str]) -> list[Recording]:
    """Start positions against the angles, which go on from record to record where the drive was not switched off."""
    ratio = _ratio(axis)
    known = [r for r in timed if r.sidecar.start_position_m is not None]
    if ratio is None or timed[0].side != "motor" or not known:
        return list(timed)
    unknown = [r for r in timed if r.sidecar.start_position_m is None]
    angle = np.array([r.position[0] for r in known])
    place = np.array([float(r.sidecar.start_position_m or 0.0) for r in known])
    if len(known) < 3 or np.ptp(angle) * ratio < 10.0 * PLACE_M:
        if unknown:
            remarks.append(_unplaced(unknown))
        return list(timed)
    line = _line(angle, place, ratio)
    if line.agree.mean() < MAJORITY:
        other = _line(angle, place)
        if other.agree.sum() >= max(3, MAJORITY * len(known)) and np.ptp(place[other.agree]) > 10.0 * PLACE_M:
            raise _radius_fault(axis, ratio, other.slope, int(other.agree.sum()))
        if unknown:
            remarks.append(_unplaced(unknown))
        return list(timed)  # the angle began anew now and then: nothing to compare
    wrong = [(r, float(far)) for r, far, good in zip(known, line.far, line.agree, strict=True) if not good]
    if wrong:
        record, far = max(wrong, key=lambda one: abs(one[1]))
        start = float(record.sidecar.start_position_m or 0.0)
        raise DataError(
            f"{_names(r for r, _ in wrong)}: start_position_m contradicts the motor angle: {record.name} begins at {start:.4g} m by its "
            f"sidecar and at {start - far:.4g} m by its angle, as the other {int(line.agree.sum())} records count it (allowed: "
            f"{1e3 * PLACE_M:g} mm). Correct the sidecar; if the carriage was moved by hand or the angle set to zero in between, put these "
            "records into a run of their own"
        )
    if not unknown:
        return list(timed)
    remarks.append(f"{_names(unknown)}: no start_position_m; the place was taken from the motor angle, as the other records count it")
    return [
        r
        if r.sidecar.start_position_m is not None
        else replace(r, sidecar=replace(r.sidecar, start_position_m=float(line.zero_m + ratio * r.position[0])), notes=())
        for r in timed
    ]


def _unplaced(unknown: Sequence[Recording]) -> str:
    return (
        f"{_names(unknown)}: no start_position_m; where along the travel they were made is guessed from the motor angle, so what depends on "
        "the position (belt stiffness, tight spots, springs) may be told at a wrong place"
    )


def _radius_fault(axis: Axis, ratio: float, slope: float, count: int) -> DataError:
    if abs(slope / ratio + 1.0) < RADIUS:
        return DataError(
            f"the motor angle counts against start_position_m: by {count} records the carriage moves {1e3 * slope:.4g} mm per rad, by "
            f"{axis} {1e3 * ratio:.4g} mm per rad. Turn the signs of position_rad and torque_nm, or give the places as 'travel minus place'"
        )
    return DataError(
        f"{axis} is contradicted by the records: by start_position_m and position_rad of {count} records the carriage moves "
        f"{1e3 * slope:.4g} mm per rad of the motor, by the axis file {1e3 * ratio:.4g} mm (allowed: {100.0 * RADIUS:.0f} % apart). Look at "
        f"pulley.effective_radius_m (with gearbox.ratio {axis.get('gearbox.ratio') or 1.0:g} it would be "
        f"{1e3 * slope * float(axis.get('gearbox.ratio') or 1.0):.4g} mm) and at the unit of position_rad"
    )


def _sensor_remarks(timed: Sequence[Recording], axis: Axis) -> list[str]:
    """The carriage's own sensor against the motor angle: it is never used to fit, so nothing of this stands in the way."""
    ratio = _ratio(axis)
    remarks: list[str] = []
    if ratio is None:
        return remarks
    slopes, offsets = [], []
    for record in timed:
        sensor = record.cart_position_m
        if sensor is None or record.side != "motor" or np.ptp(record.position) * ratio < 5.0 * PLACE_M:
            continue
        slope, zero = np.polyfit(record.position - record.position[0], sensor, 1)
        slopes.append((record, float(slope)))
        if record.sidecar.start_position_m is not None:
            offsets.append((record, float(zero) - record.sidecar.start_position_m))
    odd = [(r, s) for r, s in slopes if abs(s / ratio - 1.0) > RADIUS]
    if odd:
        median = float(np.median([s for _, s in odd]))
        remarks.append(
            f"{_names(r for r, _ in odd)}: cart_position_m moves {1e3 * median:.4g} mm per rad of the motor, by {axis} it should be "
            f"{1e3 * ratio:.4g} mm: {'the sensor counts the other way' if median < 0.0 else 'look at pulley.effective_radius_m'} and at the "
            "sensor's scale. The sensor is not used for the model; mass and stiffness go with the square of the radius"
        )
    far = [(r, o) for r, o in offsets if abs(o) > PLACE_M and r not in [other for other, _ in odd]]
    if far:
        worst = max(far, key=lambda one: abs(one[1]))
        remarks.append(
            f"{_names(r for r, _ in far)}: cart_position_m stands {1e3 * worst[1]:+.3g} mm from start_position_m: its zero is elsewhere, or a "
            "start position is wrong. The sensor is not used for the model, so this changes nothing"
        )
    return remarks
