"""The commonest belt behind a gap, several models in lock step, all followed by one observer whose gains are known.

The same steps as the masked kernel of ``compose`` with an ``observer`` that does not learn; see ``plain_belt`` for why side by side.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from beltcomm.compiled import in_lanes, within_lanes
from beltcomm.effects._corner import REACH
from beltcomm.effects.backlash import LEAST_WIDTH_M
from beltcomm.effects.tilt import GRAVITY_M_S2
from beltcomm.simulate.mean import ABSURD_NM
from beltcomm.simulate.observer import LOST, OPEN, Watch, lanes_for

Array = NDArray[np.float64]


def plain_gap(theta: Array, omega: Array, step_s: float, ratio: float, first: float, values: Array, watch: Watch) -> Array:
    """Innovations over their deviation, 0 where nothing is kept, (n, models).

    theta, omega : (fine,), true motion.   step_s : s, fine step.   first : rad/s, speed at which all begins.   watch : of a carriage alone.
    values : (9, models): those of ``plain_belt``, the offset last, with gap, m, its rounding and the axis's tilt, rad, before it.
    """
    models = values.shape[1]
    white = np.zeros((len(watch.wanted), models))
    carriage = (int(watch.places[1]), int(watch.places[1]) + watch.behind)
    _plain_gap(theta, omega, step_s, ratio, first, values, lanes_for(models), watch, carriage, np.zeros(240 + 32 * len(watch.s)), white)
    return white


@within_lanes
def corner_of(gap: float, rounding: float) -> float:
    """Half the width of the rounded corner of a gap, m.   rounding : share of the gap."""
    return REACH * max(rounding * gap, LEAST_WIDTH_M)


@within_lanes
def pressed(stretch: float, rate: float, stiffness: float, damping: float, half_gap: float, corner: float) -> tuple[float, float]:
    """Force of the belt, N, and the share of it that is closed: ``backlash``, a rounded ramp on either side of the gap, m, N/m, N s/m."""
    above, below = stretch - half_gap, -stretch - half_gap
    up, down = min(1.0, max(-1.0, above / corner)), min(1.0, max(-1.0, below / corner))
    rise = above if above >= corner else corner * (1.0 + up) * (1.0 + up) * (1.0 + up) * (3.0 - up) / 16.0
    fall = below if below >= corner else corner * (1.0 + down) * (1.0 + down) * (1.0 + down) * (3.0 - down) / 16.0
    share = 0.25 * ((1.0 + up) * (1.0 + up) * (2.0 - up) + (1.0 + down) * (1.0 + down) * (2.0 - down))
    return stiffness * (rise - fall) + damping * rate * share, share


@within_lanes
def slid(speed: float, push: float, grip: float, h: float) -> float:
    """``stick_or_slide`` without branches: a body at rest starts to where it is pushed."""
    direction = 1.0 if (speed if speed != 0.0 else push) > 0.0 else -1.0
    forward = direction * push
    left = direction * speed + h * (forward - grip)
    back = forward + grip
    stopped = direction * speed / (grip - forward if back < 0.0 else 1.0)
    turned = 0.0 if back >= 0.0 else (h - stopped) * back
    return direction * (left if left >= 0.0 else turned)


@in_lanes
def _plain_gap(
    theta: Array,
    omega: Array,
    h: float,
    ratio: float,
    first: float,
    values: Array,
    lanes: int,
    watch: Watch,
    carriage: tuple[int, int],
    s: Array,
    white: Array,
) -> None:
    # Places in one block of memory, so that the compiler sees that none overlap; the observer's states and what they become stand last.
    v, w, o, q, k, d, n, b, g, now, ahead, gap, corner, new, lean, states = (
        0, 16, 32, 48, 64, 80, 96, 112, 128, 144, 160, 176, 192, 208, 224, 240
    )  # fmt: skip
    substeps, size = watch.substeps, watch.s.shape[0]
    own, become = size - 2, states + 16 * size
    scale = ratio / (3.0 * substeps * substeps)
    place, speed_place = states + 16 * carriage[0], states + 16 * carriage[1]
    for begin in range(0, values.shape[1], lanes):
        width = min(lanes, values.shape[1] - begin)
        for c in range(s.shape[0]):
            s[c] = 0.0
        for c in range(lanes):
            at = begin + min(c, width - 1)
            s[k + c], s[d + c], s[n + c], s[b + c] = values[0, at], values[1, at], 1.0 / values[2, at], values[3, at]
            s[g + c] = max(values[4, at], 0.0) / values[2, at]
            s[gap + c] = 0.5 * values[5, at]
            s[corner + c] = corner_of(values[5, at], values[6, at])
            s[lean + c] = -GRAVITY_M_S2 * math.sin(values[7, at])
            s[q + c] = ratio * theta[0] + values[8, at]
            s[v + c] = s[o + c] = ratio * first
        j = 0
        for i in range(theta.shape[0]):
            u, du = ratio * theta[i], ratio * omega[i]
            simpson = scale * (4.0 if j % 2 else 2.0)  # see ``mean.weighted``
            falling, rising = simpson * (substeps - j), simpson * j
            for c in range(lanes):
                s[w + c] = 1.5 * s[v + c] - 0.5 * s[o + c]
                s[o + c] = s[v + c]
                force, _ = pressed(u - s[q + c], du - s[w + c], s[k + c], s[d + c], s[gap + c], s[corner + c])
                s[w + c] = (force - s[b + c] * s[w + c]) * s[n + c] + s[lean + c]
                s[now + c] += falling * force
                s[ahead + c] += rising * force
            for c in range(lanes):
                s[v + c] = slid(s[v + c], s[w + c], s[g + c], h)
            if j == 0 and i > 0:
                before = i // substeps - 1
                share = watch.shares[before]
                for c in range(lanes):
                    value = s[new + c]
                    value = value if abs(value) < ABSURD_NM else ABSURD_NM
                    s[new + c] = value - watch.wanted[before] if before > 0 else 0.0
                for a in range(size):
                    factor = watch.H[0, a] + share * (watch.H[1, a] - watch.H[0, a])
                    for c in range(lanes):
                        s[new + c] -= factor * s[states + 16 * a + c]
                kept = 1.0 if watch.keep[before] else 0.0
                if watch.keep[before]:
                    for c in range(width):
                        white[before, begin + c] = s[new + c] / watch.deviations[before]
                for a in range(size):
                    gain = kept * watch.gains[before, a]
                    for c in range(lanes):
                        s[become + 16 * a + c] = gain * s[new + c]
                    for m in range(own):
                        factor = watch.F[0, a, m] + share * (watch.F[1, a, m] - watch.F[0, a, m])
                        if factor != 0.0:
                            for c in range(lanes):
                                s[become + 16 * a + c] += factor * s[states + 16 * m + c]
                for c in range(16 * size):
                    s[states + c] = s[become + c]
                for c in range(lanes):
                    s[q + c] -= s[place + c]
                    s[v + c] -= s[speed_place + c]
                    s[o + c] -= s[speed_place + c]
                    s[place + c] = s[speed_place + c] = 0.0
                found = abs(watch.wanted[before]) >= LOST * watch.deviations[before]
                if watch.keep[before] and watch.lost[before] and share <= OPEN and found:  # ``contact``
                    pull = watch.wanted[before] / ratio
                    for c in range(lanes):
                        s[q + c] = u - math.copysign(watch.half_gap_m, pull) - pull / (watch.held[before] * watch.stiffness)
            for c in range(lanes):
                s[q + c] += h * s[v + c]
            j += 1
            if j == substeps:
                j = 0
                for c in range(lanes):
                    s[new + c] = s[now + c]
                    s[now + c] = s[ahead + c]
                    s[ahead + c] = 0.0
