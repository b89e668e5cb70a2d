"""Inertia and friction of an axis that moves as one, by least squares."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import nnls

from beltcomm.arrays import Array
from beltcomm.errors import DataError
from beltcomm.fit.noise.decimation import smallest_step
from beltcomm.fit.start.low_pass import legible
from beltcomm.model import Model
from beltcomm.recording import Recording

#: Rows that a record needs for least squares.
SHORTEST = 20
#: rad of motion from which a weight that turns is told from an offset; share of the acceleration that it may not take along; and share
#: of the deviation left below which it counts.
TURNS_RAD, SEEN, WEIGHT_LEAVES = 1.0, 0.1, 0.84
#: Torque of an inertia that least squares do not see, over what they leave.
UNSEEN = 0.1
#: Share of a column that is nothing, once what an offset does as well is taken out of it.
NOTHING = 1e-6


def rigid_estimate(sheet: Model, recordings: Sequence[Recording]) -> Model:
    """A load that moves with the motor rigidly, and the friction of both, by least squares over all records.

    Parameters
    ----------
    sheet : Model
        By the data sheets.
    recordings : sequence of Recording
        All that are fitted.

    Returns
    -------
    Model
        Within its bounds.
    """
    inertia, viscous, coulomb = least_squares(recordings)
    found = {
        "cart.mass": (float(inertia) - sheet["motor.inertia"]) / sheet["transmission.ratio"] ** 2,
        "viscous.damping": float(viscous),
        "coulomb.level": float(coulomb),
    }
    bounds = sheet.parameters
    kept = {name: min(max(value, bounds[name].low), bounds[name].high) for name, value in found.items()}
    return sheet.with_values(kept, "first estimate")


def least_squares(recordings: Sequence[Recording], sheet: float | None = None) -> Array:
    """Inertia, viscous and Coulomb friction by least squares in the band in which the encoder shows the acceleration; none below zero.

    Torque, acceleration, speed and its sign behind one Gaussian low-pass each, so that the filter biases nothing; its cut-off as high as
    the rounding of the acceleration, σ² = q²/12 2 T (2π)⁴ f⁵/5, stays below a tenth of it.  A weight that turns with the motor bends all
    three: where it explains much, it and an offset of each record are taken out, as long as the motion tells them from the acceleration.

    Parameters
    ----------
    recordings : sequence of Recording
    sheet : float or None
        Inertia where the records show none; without it the largest that they would not show, for a motor of none would fly off.

    Returns
    -------
    ndarray (3,)
        kg m², N m s/rad and N m at the motor shaft; on another side in the units of that.

    Raises
    ------
    DataError
        When no recording is long enough.
    """
    left, right, still, pulled = [], [], [], []
    for record in recordings:
        step = smallest_step(record.position)
        for first, last in record.pieces:
            if last - first < SHORTEST:
                continue
            rows, torque, place = _low_passed_rows(record.position[first:last], record.torque[first:last], record.sample_period_s, step)
            left.append(rows)
            right.append(torque)
            turns = record.side != "load" and float(np.ptp(place)) > TURNS_RAD if len(place) else False
            level = np.column_stack([np.ones(len(place)), *((np.sin(place), np.cos(place)) if turns else ())])
            across = np.linalg.qr(level)[0]
            still.append(rows - across @ (across.T @ rows))
            pulled.append(torque - across @ (across.T @ torque))
    if not left:
        raise DataError(f"no recording holds {SHORTEST} samples without a gap; nothing can be fitted")
    sizes, clear = (np.linalg.norm(np.concatenate(rows), axis=0) for rows in (left, still))
    plain = _solved(np.concatenate(left), np.concatenate(right))
    free = _solved(np.where(clear > NOTHING * sizes, np.concatenate(still), 0.0), np.concatenate(pulled))
    seen = clear[0] ** 2 > SEEN * sizes[0] ** 2
    found, rest = free if seen and free[0][0] > 0.0 and free[1] < WEIGHT_LEAVES * plain[1] else plain
    if not found[0] > 0.0:
        found[0] = sheet or UNSEEN * rest / max(float(sizes[0]), 1e-9)
    return found


def _solved(rows: Array, torque: Array) -> tuple[Array, float]:
    """Least squares without a value below zero, and the root of the sum of squares left."""
    found, rest = nnls(rows, torque)
    return np.asarray(found), float(rest)


def _low_passed_rows(position: Array, torque: Array, sample_s: float, step_rad: float) -> tuple[Array, Array, Array]:
    """Rows of the rigid equation of motion behind one low-pass, without its ends: acceleration, speed, its sign, (m, 3); torque; place."""
    width, smooth_angle = legible(position, sample_s, step_rad)
    speed = np.gradient(smooth_angle, sample_s)
    acceleration = np.gradient(speed, sample_s)
    # the torque acts from its sample to the next: half a sample later than the angle
    shifted = np.append(torque[0], 0.5 * (torque[1:] + torque[:-1]))
    sign = gaussian_filter1d(np.sign(speed), width, mode="nearest")
    inside = slice(round(4.0 * width), max(len(position) - round(4.0 * width), round(4.0 * width) + 1))
    rows = np.stack([acceleration, speed, sign], axis=1)[inside]
    return rows, gaussian_filter1d(shifted, width, mode="nearest")[inside], smooth_angle[inside]
