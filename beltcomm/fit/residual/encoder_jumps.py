"""Jumps of the motor angle: an encoder that slips, loses counts or has a bad cable, found and named by record and time.

At a jump one step of the angle differs from the mean of its neighbours by all of the jump; torque alone can make no more than

    Δθ[n] - (Δθ[n-1] + Δθ[n+1])/2 = T²/(4 J) (torque[n-1] - torque[n+1] - change of the load),    Δθ[n] = θ[n+1] - θ[n].

In the trace of a loop that is faster than the record the torque changes within a sample n, unseen but for its end: then the steps
behind and before it are too long and too short by the same, and the others are not.  (Of a glitch of two samples all neighbours are off.)

A step that stands out is a suspicion; it is proven when the record without the jump is explained by the model and with it is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from beltcomm.arrays import Array, IntArray
from beltcomm.errors import DamagedRecord
from beltcomm.fit.residual.segment import segments
from beltcomm.fit.residual.whitened import whitened_residual
from beltcomm.model import Model
from beltcomm.recording import Recording

#: How far a step must stand out: times the 99th percentile of the record's steps, plus encoder steps.  On simulated axes the largest
#: regular step is 1.4 times the percentile in excited records and 4 times in strokes, where it is 3 encoder steps.
SUSPICIOUS = 2.5
CERTAIN = 5.0
BEYOND_ROUNDING = 10.0
#: Times the 99th percentile of its changes from which on one of the torque is sudden; share by which the two steps around it may differ.
SUDDEN, ALIKE = 3.0, 0.5
#: Share of a record's misfit that taking a jump out must remove, and how many are looked for.
SHARE_REMOVED = 0.2
MOST_JUMPS = 5


@dataclass(frozen=True)
class Jump:
    """The angle of a record is larger by ``size_rad`` from ``t_s`` on."""

    record: str
    t_s: float
    size_rad: float


def largest_step(recording: Recording, inertia_kg_m2: float, step_rad: float, striking: float) -> tuple[int, float] | None:
    """(first sample after it, rad) of the step that stands out most, None when none stands out.

    Parameters
    ----------
    recording : Recording
    inertia_kg_m2 : float, kg m², motor side
        Of what follows the torque at once.
    step_rad : float, rad
    striking : float
        See ``CERTAIN``.
    """
    torque, steps = recording.torque, np.diff(recording.position)
    if len(steps) < 4:
        return None
    by_torque = recording.sample_period_s**2 / (4.0 * inertia_kg_m2) * (torque[:-3] - torque[2:-1])
    odd = steps[1:-1] - 0.5 * (steps[:-2] + steps[2:]) - by_torque
    odd[_beside_sudden_torque(torque, odd)] = 0.0
    lost = recording.gaps
    for near in (lost - 2, lost - 1, lost):  # a step over lost samples is longer, and so do its neighbours see it
        odd[near[(near >= 0) & (near < len(odd))]] = 0.0
    at = int(np.argmax(np.abs(odd)))
    if abs(odd[at]) <= striking * float(np.percentile(np.abs(odd), 99.0)) + BEYOND_ROUNDING * step_rad:
        return None
    return at + 2, float(odd[at])


def _beside_sudden_torque(torque: Array, odd: Array) -> IntArray:
    """Places of the steps behind and before a sudden change of the torque, which are off by the same the other way.

    torque : (n,) N m.   odd : (n - 3,) rad, of the steps from the second on.
    """
    change = np.diff(torque)
    at = np.flatnonzero(np.abs(change) > SUDDEN * float(np.percentile(np.abs(change), 99.0)))
    at = at[(at >= 2) & (at < len(odd))]  # the change in row n; behind it odd[n], before it odd[n - 2]
    behind, before = odd[at], odd[at - 2]
    alike = (np.abs(behind + before) <= ALIKE * np.abs(behind)) & (behind * change[at] > 0.0)
    return np.concatenate((at[alike], at[alike] - 2))


def proven_jumps(recording: Recording, model: Model, step_rad: float, noise_nm: float) -> tuple[Jump, ...]:
    """The jumps whose removal lets the model explain the record, in the order in which they were found.

    Parameters
    ----------
    recording : Recording
        Of a motor's angle.
    model : Model
        To explain it.
    step_rad : float, rad
    noise_nm : float, N m rms
        Of the torque.

    Returns
    -------
    tuple of Jump
        At most ``MOST_JUMPS``, each with time, s, and size, rad.
    """
    found: list[Jump] = []
    remaining = recording
    before = _squares(remaining, model, step_rad, noise_nm)
    while before is not None and len(found) < MOST_JUMPS:
        step = largest_step(remaining, model.driven_inertia(), step_rad, SUSPICIOUS)
        if step is None:
            break
        first, size = step

        def cost(trial: float, whole: Recording = remaining, first: int = first) -> float:
            squares = _squares(_without_jump(whole, first, trial), model, step_rad, noise_nm)
            return float(np.mean(np.log1p(squares))) if squares is not None else np.inf

        around = 0.5 * abs(size) + BEYOND_ROUNDING * step_rad
        best = minimize_scalar(cost, bounds=(size - around, size + around), method="bounded", options={"xatol": 0.3 * step_rad})
        trial = _without_jump(remaining, first, float(best.x))
        after = _squares(trial, model, step_rad, noise_nm)
        if after is None or np.mean(before) - np.mean(after) < SHARE_REMOVED * (np.mean(before) - 1.0):
            break
        found.append(Jump(recording.name, float(recording.t_s[first]), float(best.x)))
        remaining, before = trial, after
    return tuple(found)


def _without_jump(recording: Recording, first: int, size_rad: float) -> Recording:
    """The record with the angle from sample ``first`` on put back by ``size_rad``."""
    return replace(recording, position=recording.position - np.where(np.arange(len(recording.position)) >= first, size_rad, 0.0))


def refuse(jumps: Sequence[Jump], step_rad: float) -> None:
    """Refuse a record with jumps, naming record, size and time.

    Parameters
    ----------
    jumps : sequence of Jump
        As :func:`proven_jumps` found them.
    step_rad : float, rad

    Raises
    ------
    DamagedRecord
        When there is one.
    """
    if not jumps:
        return
    first = jumps[0]
    more = f", and {len(jumps) - 1} times more" if len(jumps) > 1 else ""
    raise DamagedRecord(
        f"{first.record}: the motor angle jumps by {first.size_rad / step_rad:+.0f} counts ({first.size_rad:+.4f} rad) at "
        f"t = {first.t_s:.3f} s{more}, and no torque explains it: look at the encoder, its coupling and its cable, and whether the bus "
        "delays frames, then record it again",
        first.record,
    )


def _squares(recording: Recording, model: Model, step_rad: float, noise_nm: float) -> Array | None:
    pieces = segments(recording, model, step_rad, noise_nm, fitted=True)
    squares = [whitened_residual(piece, model, model.vector()) ** 2 for piece in pieces]
    return np.concatenate(squares) if sum(map(len, squares)) else None
