"""Positions of records along the travel: start positions against the motor's angle, and the carriage's own sensor.  Before any fit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from beltcomm.arrays import Array, BoolArray
from beltcomm.axis import Axis
from beltcomm.errors import DataError
from beltcomm.recording import Recording

#: m; places by a ruler and by the angle may differ by this.
PLACE_M = 2e-3
#: Share of the records that must agree before the others are called wrong; relative difference of two ways to measure the radius.
MAJORITY, RADIUS = 0.6, 0.02


def names_of(records: Iterable[Recording]) -> str:
    """Names, the first three of many.

    Parameters
    ----------
    records : iterable of Recording
        In their order.
    """
    names = [r.name for r in records]
    return ", ".join(names) if len(names) <= 4 else f"{', '.join(names[:3])} and {len(names) - 3} more"


@dataclass(frozen=True)
class PositionLine:
    """Start position over angle.

    Attributes
    ----------
    slope : float, m/rad
    zero_m : float, m
        Position at angle 0.
    far : ndarray
        (n,) m, distance of each record.
    """

    slope: float
    zero_m: float
    far: Array

    @property
    def agree(self) -> BoolArray:
        """Records that lie on it."""
        return np.abs(self.far) <= PLACE_M


def _line_through(angle: Array, place: Array, slope: float | None = None) -> PositionLine:
    """The line that most records agree with: through pairs of them, or with a known slope."""
    if slope is not None:
        zeros = place - slope * angle
        lines = [PositionLine(slope, float(zero), zeros - zero) for zero in zeros]
    else:
        lines = []
        for i in range(len(angle)):
            for j in range(i):
                if abs(angle[i] - angle[j]) > 1e-9:
                    through = float((place[i] - place[j]) / (angle[i] - angle[j]))
                    zero = float(place[i] - through * angle[i])
                    lines.append(PositionLine(through, zero, place - zero - through * angle))
    return max(lines, key=lambda line: (int(line.agree.sum()), -float(np.sum(np.minimum(np.abs(line.far), PLACE_M)))))


def checked_positions(timed: Sequence[Recording], axis: Axis, remarks: list[str]) -> list[Recording]:
    """Start positions against the angles, which go on from record to record where the drive was not switched off.

    Parameters
    ----------
    timed : sequence of Recording
        Records over time.
    axis : Axis
    remarks : list of str
        Gets further ones.

    Returns
    -------
    list of Recording
        With start positions where they follow.

    Raises
    ------
    DataError
        For a start position that contradicts the others, or a wrong radius.
    """
    ratio = axis.known_transmission_m_rad
    known = [r for r in timed if r.sidecar.start_position_m is not None]
    if ratio is None or timed[0].side != "motor":
        return list(timed)
    unknown = [r for r in timed if r.sidecar.start_position_m is None]
    angle = np.array([r.position[0] for r in known])
    place = np.array([float(r.sidecar.start_position_m or 0.0) for r in known])
    line = _line_through(angle, place, ratio) if len(known) >= 3 and np.ptp(angle) * ratio >= 10.0 * PLACE_M else None
    if line is None or line.agree.mean() < MAJORITY:
        other = _line_through(angle, place) if line is not None else None
        if other is not None and other.agree.sum() >= max(3, MAJORITY * len(known)) and np.ptp(place[other.agree]) > 10.0 * PLACE_M:
            raise _radius_fault(axis, ratio, other.slope, int(other.agree.sum()))
        if unknown:
            remarks.append(_unplaced_words(unknown))
        return list(timed)  # too few, or the angle began anew now and then: nothing to compare
    wrong = [(r, float(far)) for r, far, good in zip(known, line.far, line.agree, strict=True) if not good]
    if wrong:
        record, far = max(wrong, key=lambda one: abs(one[1]))
        start = float(record.sidecar.start_position_m or 0.0)
        raise DataError(
            f"{names_of(r for r, _ in wrong)}: start_position_m contradicts the motor angle: {record.name} begins at {start:.4g} m by its "
            f"sidecar and at {start - far:.4g} m by its angle, as the other {int(line.agree.sum())} records count it (allowed: "
            f"{1e3 * PLACE_M:g} mm). Correct the sidecar; if the carriage was moved by hand or the angle set to zero in between, put these "
            "records into a run of their own"
        )
    if not unknown:
        return list(timed)
    remarks.append(f"{names_of(unknown)}: no start_position_m; the place was taken from the motor angle, as the other records count it")
    return [
        r
        if r.sidecar.start_position_m is not None
        else replace(r, sidecar=replace(r.sidecar, start_position_m=float(line.zero_m + ratio * r.position[0])), notes=())
        for r in timed
    ]


def _unplaced_words(unknown: Sequence[Recording]) -> str:
    return (
        f"{names_of(unknown)}: no start_position_m; where along the travel they were made is guessed from the motor "
        "angle, so what depends on "
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
        f"{1e3 * slope:.4g} mm per rad of the motor, by the axis file {1e3 * ratio:.4g} mm (allowed: "
        f"{100.0 * RADIUS:.0f} % apart). Look at "
        f"pulley.effective_radius_m (with gearbox.ratio {axis.get('gearbox.ratio') or 1.0:g} it would be "
        f"{1e3 * slope * float(axis.get('gearbox.ratio') or 1.0):.4g} mm) and at the unit of position_rad"
    )


def sensor_remarks(timed: Sequence[Recording], axis: Axis) -> list[str]:
    """The carriage's own sensor against the motor angle: it is never used to fit, so nothing of this stands in the way.

    Parameters
    ----------
    timed : sequence of Recording
        Records over time.
    axis : Axis
    """
    ratio = axis.known_transmission_m_rad
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
        why = "the sensor counts the other way" if median < 0.0 else "look at pulley.effective_radius_m and at the sensor's scale"
        remarks.append(
            f"{names_of(r for r, _ in odd)}: cart_position_m moves {1e3 * median:.4g} mm per rad of the motor, by {axis} it should be "
            f"{1e3 * ratio:.4g} mm: {why}. The sensor is not used for the model; mass and stiffness go with the square of the radius"
        )
    far = [(r, o) for r, o in offsets if abs(o) > PLACE_M and r not in [other for other, _ in odd]]
    if far:
        worst = max(far, key=lambda one: abs(one[1]))
        remarks.append(
            f"{names_of(r for r, _ in far)}: cart_position_m stands {1e3 * worst[1]:+.3g} mm from start_position_m: its "
            "zero is elsewhere, or a "
            "start position is wrong. The sensor is not used for the model, so this changes nothing"
        )
    return remarks
