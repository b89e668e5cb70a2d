"""Load of the commonest belts, several models in SIMD lanes: a carriage on one spring and damper, with what is often found beside it.

The same steps as the masked kernel of ``compose``, without switches and with the models side by side: a step of one model waits for the
step before it, a step of eight in four registers takes no longer.  The triangular mean is taken on the way.  What a set of models has
besides the plain belt is asked once a step for all of them: friction of the carriage, strands that go slack, a stiffness that follows the
carriage, one more body on springs.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from beltcomm.arrays import Array
from beltcomm.compiled import in_lanes
from beltcomm.effects._corner import REACH
from beltcomm.effects.belt_slack import MOST_LOST
from beltcomm.effects.stiffness_position import LEAST_COMPLIANCE
from beltcomm.simulate.kernels import ahead
from beltcomm.simulate.kernels.observer import lanes_for
from beltcomm.simulate.kernels.pieces import ABSURD_NM

#: Effects beyond the motor that this file knows; each is off where its parameter is 0.
PLAIN = ("belt_stiffness", "belt_damping", "viscous_cart", "cart_friction")
#: Those that it knows besides, and of these the ones that bring a body: one of them at most.
BESIDE = ("belt_slack", "stiffness_position", "end_pulley", "viscous_end_pulley", "payload_mode")
BODIES = ("end_pulley", "payload_mode")
#: Rows of :func:`lane_values`, and those of them that are not 0 where there is more than a plain belt.
_ROWS, _MORE = 23, (7, 15, 16)


def covers(effects: set[str]) -> bool:
    """True if models with these effects beyond the motor, and no others, can be taken side by side.

    Parameters
    ----------
    effects : set of str
        Names.
    """
    return "belt_stiffness" in effects and effects <= {*PLAIN, *BESIDE} and not effects >= set(BODIES)


def lane_values(models: int, get: Callable[[str], Array | float], offsets_m: Array) -> Array:
    """Values that the kernel needs of every model, (_ROWS, models).

    0 to 6: stiffness N/m, damping N s/m, carriage's mass kg, its viscous N s/m and Coulomb friction N, offset m at the start, share of
    the belt in the direct span;  7 to 11: stretch at which either strand goes slack, m, share of the belt lost then, rounding;  12 to 15:
    share, 1/h(middle), offset and twice the distance of ``stiffness_position``;  16 to 22: the body's mass kg, its springs and dampers to
    the driving end and to the carriage, hardening 1/m² of the latter, viscous friction N s/m.

    Parameters
    ----------
    models : int
        Their number.
    get : callable
        Values of a parameter by its full name, 0 where there is none.
    offsets_m : ndarray (models,), m
        Of the carriage at the start.
    """
    rows = np.zeros((_ROWS, models))
    stiffness, damping = np.broadcast_to(get("belt_stiffness.stiffness"), models), np.broadcast_to(get("belt_damping.damping"), models)
    rows[0], rows[1], rows[2], rows[3] = stiffness, damping, get("cart.mass"), get("viscous_cart.damping")
    rows[4], rows[5], rows[6] = get("cart_friction.level"), offsets_m, 1.0
    if np.any(limit := get("belt_slack.limit")):
        balance, lost = get("belt_slack.balance"), 2.0 * (1.0 - get("belt_slack.share"))
        rows[7], rows[8] = 0.5 * limit / (1.0 - balance), 0.5 * limit / balance
        rows[9], rows[10] = np.minimum(lost * (1.0 - balance), MOST_LOST), np.minimum(lost * balance, MOST_LOST)
        rows[11] = REACH * get("belt_slack.rounding")
    if np.any(twice := 2.0 * get("stiffness_position.pulley_distance")):
        there = get("stiffness_position.offset") + get("stiffness_position.middle")
        rows[12], rows[13] = get("stiffness_position.share"), 1.0 / (there * (twice - there))
        rows[14], rows[15] = get("stiffness_position.offset"), twice
    if np.any(mass := get("end_pulley.mass")):
        share, split = get("end_pulley.share"), get("end_pulley.split")
        rows[6], rows[16] = 1.0 - share, mass
        rows[17], rows[18] = share / (1.0 - split) * stiffness, share / (1.0 - split) * damping
        rows[19], rows[20] = share / split * stiffness, share / split * damping
        rows[22] = get("viscous_end_pulley.damping")
    elif np.any(mass := get("payload.mass")):
        rows[16], rows[19], rows[20] = mass, get("payload_mode.stiffness"), get("payload_mode.damping")
        rows[21] = get("payload_mode.hardening")
    return rows


def belt_loads_in_lanes(theta: Array, omega: Array, step_s: float, substeps: int, ratio: float, first: float, values: Array) -> Array:
    """Triangular mean of the belt's load at the motor shaft, N m, (n, models), ends 0.

    Parameters
    ----------
    theta, omega : ndarray (fine,)
        True motion.
    step_s : float, s
        Fine step.
    substeps : int
        Fine steps per sample.
    ratio : float, m/rad
        i_t.
    first : float, rad/s
        Speed at which all begins.
    values : ndarray
        Of :func:`lane_values`, (_ROWS, models).
    """
    models = values.shape[1]
    mean = np.zeros(((theta.shape[0] - 1) // substeps + 1, models))
    more = values if values[list(_MORE)].any() else None
    if more is not None:
        ahead.wait()
    _belt_loads(theta, omega, step_s, substeps, ratio, first, values, more, lanes_for(models), np.zeros(592), mean)
    return mean


@in_lanes
def _belt_loads(
    theta: Array,
    omega: Array,
    h: float,
    substeps: int,
    ratio: float,
    first: float,
    values: Array,
    more: Array | None,
    lanes: int,
    s: Array,
    mean: Array,
) -> None:
    # ``more`` is None where there is nothing but the plain belt: compiled for that type, what stands behind it is left out.
    # Places in one block of memory, so that the compiler sees that none overlap.
    v, w, o, q, k, d, n, b, g, now, later = 0, 16, 32, 48, 64, 80, 96, 112, 128, 144, 160
    y, r, f, part = 176, 192, 208, 224
    plus, minus, above, below, wide, narrow = 240, 256, 272, 288, 304, 320
    share, scaled, at_0, twice = 336, 352, 368, 384
    ve, we, oe, qe, ne, ka, da, kb, db, hard, be, fe = 400, 416, 432, 448, 464, 480, 496, 512, 528, 544, 560, 576
    scale = ratio / (3.0 * substeps * substeps)
    for begin in range(0, values.shape[1], lanes):
        width = min(lanes, values.shape[1] - begin)
        rubs = slack = placed = chained = False
        for c in range(lanes):
            at = begin + min(c, width - 1)
            s[k + c], s[d + c], s[n + c], s[b + c] = values[0, at], values[1, at], 1.0 / values[2, at], values[3, at]
            s[g + c] = max(values[4, at], 0.0) / values[2, at]
            s[q + c] = ratio * theta[0] + values[5, at]
            if more is not None:
                s[part + c] = more[6, at]
                s[plus + c], s[minus + c], s[above + c], s[below + c] = more[7, at], more[8, at], more[9, at], more[10, at]
                s[wide + c], s[narrow + c] = more[11, at] * more[7, at], more[11, at] * more[8, at]
                s[share + c], s[scaled + c], s[at_0 + c], s[twice + c] = more[12, at], more[13, at], more[14, at], more[15, at]
                s[ne + c] = 1.0 / more[16, at] if more[16, at] > 0.0 else 0.0
                s[ka + c], s[da + c], s[kb + c], s[db + c] = more[17, at], more[18, at], more[19, at], more[20, at]
                s[hard + c], s[be + c] = more[21, at], more[22, at]
                slack, placed, chained = slack or s[plus + c] > 0.0, placed or s[twice + c] > 0.0, chained or s[ne + c] > 0.0
                s[qe + c] = ratio * theta[0]
                s[ve + c] = s[oe + c] = ratio * first
            rubs = rubs or s[g + c] > 0.0
            s[v + c] = s[o + c] = ratio * first
            s[now + c] = s[later + c] = 0.0
        j, sample = 0, 0
        for i in range(theta.shape[0]):
            u, du = ratio * theta[i], ratio * omega[i]
            simpson = scale * (4.0 if j % 2 else 2.0)  # see ``mean.weighted_mean``
            falling, rising = simpson * (substeps - j), simpson * j
            if more is not None:
                for c in range(lanes):
                    s[w + c] = 1.5 * s[v + c] - 0.5 * s[o + c]
                    s[o + c] = s[v + c]
                    s[y + c], s[r + c] = u - s[q + c], du - s[w + c]
                if slack:
                    for c in range(lanes):
                        # ``ramp`` of either strand without branches, and its slope.
                        x, z = s[y + c] - s[plus + c], -s[y + c] - s[minus + c]
                        e, p = x / s[wide + c], z / s[narrow + c]
                        e = -1.0 if e < -1.0 else (1.0 if e > 1.0 else e)
                        p = -1.0 if p < -1.0 else (1.0 if p > 1.0 else p)
                        bent = s[wide + c] * (1.0 + e) * (1.0 + e) * (1.0 + e) * (3.0 - e) / 16.0
                        sagged = s[narrow + c] * (1.0 + p) * (1.0 + p) * (1.0 + p) * (3.0 - p) / 16.0
                        bent += x - s[wide + c] if x > s[wide + c] else 0.0
                        sagged += z - s[narrow + c] if z > s[narrow + c] else 0.0
                        s[y + c] += s[below + c] * sagged - s[above + c] * bent
                        gone = s[above + c] * (1.0 + e) * (1.0 + e) * (2.0 - e) + s[below + c] * (1.0 + p) * (1.0 + p) * (2.0 - p)
                        s[r + c] *= 1.0 - 0.25 * gone
                if placed:
                    for c in range(lanes):
                        here = s[at_0 + c] + s[q + c]
                        soft = 1.0 - s[share + c] + s[share + c] * here * (s[twice + c] - here) * s[scaled + c]
                        soft = soft if soft > LEAST_COMPLIANCE else LEAST_COMPLIANCE
                        s[f + c] = (s[part + c] + 1.0 / soft - 1.0) * (s[k + c] * s[y + c] + s[d + c] * s[r + c])
                else:
                    for c in range(lanes):
                        s[f + c] = s[part + c] * (s[k + c] * s[y + c] + s[d + c] * s[r + c])
                if chained:
                    for c in range(lanes):
                        s[we + c] = 1.5 * s[ve + c] - 0.5 * s[oe + c]
                        s[oe + c] = s[ve + c]
                        far = s[ka + c] * (u - s[qe + c]) + s[da + c] * (du - s[we + c])
                        x = s[qe + c] - s[q + c]
                        near = s[kb + c] * x * (1.0 + s[hard + c] * x * x) + s[db + c] * (s[we + c] - s[w + c])
                        s[fe + c] = far - near - s[be + c] * s[we + c]
                        pull = s[f + c] + far
                        s[now + c] += falling * pull
                        s[later + c] += rising * pull
                        s[f + c] += near
                    for c in range(lanes):
                        s[ve + c] += h * s[fe + c] * s[ne + c]
                        s[qe + c] += h * s[ve + c]
                else:
                    for c in range(lanes):
                        s[now + c] += falling * s[f + c]
                        s[later + c] += rising * s[f + c]
                for c in range(lanes):
                    s[w + c] = (s[f + c] - s[b + c] * s[w + c]) * s[n + c]
            else:
                for c in range(lanes):
                    s[w + c] = 1.5 * s[v + c] - 0.5 * s[o + c]
                    s[o + c] = s[v + c]
                    force = s[k + c] * (u - s[q + c]) + s[d + c] * (du - s[w + c])
                    s[w + c] = (force - s[b + c] * s[w + c]) * s[n + c]
                    s[now + c] += falling * force
                    s[later + c] += rising * force
            if rubs:
                for c in range(lanes):
                    # ``stick_or_slide`` without branches: a body at rest starts to where it is pushed.
                    push, speed, grip = s[w + c], s[v + c], s[g + c]
                    direction = 1.0 if (speed if speed != 0.0 else push) > 0.0 else -1.0
                    forward = direction * push
                    left = direction * speed + h * (forward - grip)
                    back = forward + grip
                    stopped = direction * speed / (grip - forward if back < 0.0 else 1.0)
                    turned = 0.0 if back >= 0.0 else (h - stopped) * back
                    s[v + c] = direction * (left if left >= 0.0 else turned)
            else:
                for c in range(lanes):
                    s[v + c] += h * s[w + c]
            for c in range(lanes):
                s[q + c] += h * s[v + c]
            j += 1
            if j == substeps:
                if sample > 0:
                    for c in range(width):
                        value = s[now + c]
                        mean[sample, begin + c] = value if abs(value) < ABSURD_NM else ABSURD_NM
                for c in range(lanes):
                    s[now + c] = s[later + c]
                    s[later + c] = 0.0
                j, sample = 0, sample + 1
