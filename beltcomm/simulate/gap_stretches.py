"""The commonest belt behind a gap, several stretches in lock step, each with a model and an observer of its own, which may learn.

The same steps as the masked kernel of ``compose`` with its ``observer``; see ``plain_belt`` for why side by side.  The stretches may have
any length: a lane that is through lets the others go on.   Several models on one stretch: ``plain_gap``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltcomm.compiled import in_lanes
from beltcomm.effects.tilt import GRAVITY_M_S2
from beltcomm.simulate.addresses import address, flag_at, number_at, set_flag, set_number
from beltcomm.simulate.mean import ABSURD_NM
from beltcomm.simulate.observer import LOST, OPEN, REGISTER, Watch
from beltcomm.simulate.observer_lanes import WIDTH, Observers, expected_eight, learn_eight, observe_eight, observers
from beltcomm.simulate.plain_gap import corner_of, pressed, slid
from beltcomm.simulate.vectors import LANES, aligned, at, put

Array = NDArray[np.float64]

#: Fine steps of each motion that are brought beside the others' at a time: enough to read memory in rows.
AHEAD = 64


class Lane(NamedTuple):
    """What runs in one lane.

    theta, omega : (fine,), true motion.   first : rad/s, speed at which all begins.   values : (8,): stiffness, damping, carriage's mass,
    its viscous and Coulomb friction, gap, m, its rounding, and the axis's tilt, rad.
    watch : of a carriage alone; the results stand in it.
    """

    theta: Array
    omega: Array
    first: float
    values: Array
    watch: Watch


def gap_stretches(lanes: Sequence[Lane], step_s: float, ratio: float) -> None:
    """All lanes, which have one number of fine steps a sample and one transmission.   step_s : s, fine step.

    Whether the observers learn is the same in all of them.
    """
    order = sorted(lanes, key=lambda lane: -len(lane.theta))
    for begin in range(0, len(order), WIDTH):
        _together(order[begin : begin + WIDTH], step_s, ratio)


def _together(lanes: Sequence[Lane], step_s: float, ratio: float) -> None:
    """As many as there is room for, the longest first."""
    padded = [*lanes, *(lanes[-1],) * (-len(lanes) % REGISTER)]
    watch = lanes[0].watch
    lengths = np.array([len(lane.theta) for lane in lanes])
    where = np.array([_addresses(lane) for lane in padded], dtype=np.int64).T.copy()
    numbers = np.array([_numbers(lane) for lane in padded]).T.copy()
    memory = aligned(_STEPS + len(numbers), WIDTH)
    memory[_STEPS:, : len(padded)] = numbers
    carriage = (watch.cart, watch.cart + watch.behind)
    course = np.zeros((2, AHEAD, WIDTH))
    following = observers([lane.watch for lane in padded])
    _gap_stretches(where, lengths, step_s, ratio, watch.substeps, carriage, watch.learning, following, course, memory.ravel())


def _addresses(lane: Lane) -> list[int]:
    """Of everything that a lane has for each step or sample.   Raises ValueError where one of them is too short: nothing else would."""
    w = lane.watch
    samples = (w.wanted, w.keep, w.held, w.lost, w.forgets, w.gains, w.deviations, w.shares, w.left, w.white)
    if len(lane.omega) != len(lane.theta) or any(len(array) <= (len(lane.theta) - 1) // w.substeps for array in samples):
        raise ValueError("a motion and its observer must have one length")
    return [address(array) for array in (lane.theta, lane.omega, *samples)]


def _numbers(lane: Lane) -> tuple[float, ...]:
    """What a lane's steps need, once."""
    stiffness, damping, mass, viscous, coulomb, gap, rounding, tilt = lane.values
    watch = lane.watch
    belt = (stiffness, damping, 1.0 / mass, viscous, max(coulomb, 0.0) / mass, gap, rounding, lane.first)
    return (*belt, watch.half_gap_m, watch.stiffness, *watch.spread, -GRAVITY_M_S2 * math.sin(tilt))


#: Rows of memory for the steps.
_STEPS = 15


@in_lanes
def _gap_stretches(
    where: NDArray[np.int64],
    lengths: NDArray[np.int64],
    h: float,
    ratio: float,
    substeps: int,
    carriage: tuple[int, int],
    learning: bool,
    following: Observers,
    course: Array,
    s: Array,
) -> None:
    # Places in one block of memory, a lane behind the other in each, so that the compiler sees that none overlap.
    v, w, o, q, now, later, new = 0, 16, 32, 48, 64, 80, 96
    shut, share, kept, deviation, variance = 144, 160, 176, 192, 208
    k, d, n, b, g, gap, corner, first = 240, 256, 272, 288, 304, 320, 336, 352
    half, stiffness, wander, hurry, lean = 368, 384, 400, 416, 432
    rows, memory, passes, reaches = following
    size, P, states, gains_of = rows.size, WIDTH * rows.P, WIDTH * rows.states, WIDTH * rows.gains
    cart, speed_of = carriage
    position, speed = states + WIDTH * cart, states + WIDTH * speed_of
    scale = ratio / (3.0 * substeps * substeps)
    active = lengths.shape[0]
    wide = where.shape[1]
    for c in range(wide):
        s[corner + c], s[gap + c] = corner_of(s[gap + c], s[corner + c]), 0.5 * s[gap + c]
        s[q + c] = ratio * number_at(where[0, c], 0)
        s[v + c] = s[o + c] = ratio * s[first + c]
    block = course.shape[1]
    j, here = 0, block - 1
    for i in range(lengths[0]):
        while i >= lengths[active - 1]:
            active -= 1
        wide = (active + 3) // 4 * 4
        simpson = scale * (4.0 if j % 2 else 2.0)  # see ``mean.weighted``
        falling, rising = simpson * (substeps - j), simpson * j
        here += 1
        if here == block:  # what comes next of each motion, a lane beside the other
            here = 0
            for c in range(active):
                for kind in range(2):
                    first_of = where[kind, c]
                    for e in range(min(block, lengths[c] - i)):
                        course[kind, e, c] = ratio * number_at(first_of, i + e)
        for c in range(wide):
            s[w + c] = 1.5 * s[v + c] - 0.5 * s[o + c]
            s[o + c] = s[v + c]
            stretch, rate = course[0, here, c] - s[q + c], course[1, here, c] - s[w + c]
            force, part = pressed(stretch, rate, s[k + c], s[d + c], s[gap + c], s[corner + c])
            s[shut + c] += part
            s[w + c] = (force - s[b + c] * s[w + c]) * s[n + c] + s[lean + c]
            s[now + c] += falling * force
            s[later + c] += rising * force
        for c in range(wide):
            s[v + c] = slid(s[v + c], s[w + c], s[g + c], h)
        if i == 0:
            for c in range(wide):
                s[shut + c] = 0.0  # the share of a sample is that of the steps up to its end
        elif j == 0:
            sample = i // substeps - 1
            for c in range(wide):
                place = sample if c < active else 0  # a lane beside those that go on
                value = s[new + c]
                value = value if abs(value) < ABSURD_NM else ABSURD_NM
                s[new + c] = value - number_at(where[2, c], place) if sample > 0 else 0.0
                s[kept + c] = 1.0 if flag_at(where[3, c], place) else 0.0
                s[share + c] = number_at(where[4, c], place) * (s[shut + c] / substeps) if learning else number_at(where[9, c], place)
                s[shut + c] = 0.0
            for c in range(active):
                set_number(where[10, c], sample, s[new + c])
            for base in range(0, active, LANES):
                put(s, new + base, expected_eight(rows, memory, base, at(s, share + base), at(s, new + base), carriage))
                if learning:
                    put(s, variance + base, learn_eight(rows, memory, passes, reaches, base, at(s, share + base), at(s, kept + base)))
            if learning:
                for c in range(active):
                    set_number(where[9, c], sample, s[share + c])
                    if s[kept + c] > 0.0:
                        s[deviation + c] = math.sqrt(s[variance + c])
                        set_number(where[8, c], sample, s[deviation + c])
                        set_flag(where[5, c], sample, 1 if abs(s[new + c]) > LOST * s[deviation + c] else 0)
                        for a in range(size):
                            set_number(where[7, c], sample * size + a, memory[gains_of + WIDTH * a + c])
                    if flag_at(where[5, c], sample) or flag_at(where[6, c], sample):
                        memory[P + WIDTH * cart * (size + 1) + c] += s[wander + c]
                        memory[P + WIDTH * speed_of * (size + 1) + c] += s[hurry + c]
            else:
                for c in range(active):
                    for a in range(size):
                        memory[gains_of + WIDTH * a + c] = number_at(where[7, c], sample * size + a)
            for c in range(active):
                s[deviation + c] = number_at(where[8, c], sample)
                if s[kept + c] > 0.0:
                    set_number(where[11, c], sample, s[new + c] / s[deviation + c])
            for base in range(0, active, LANES):
                innovation = at(s, kept + base) * at(s, new + base)
                observe_eight(rows, memory, passes, base, at(s, share + base), innovation, carriage)
            for c in range(wide):
                s[q + c] -= memory[position + c]
                s[v + c] -= memory[speed + c]
                s[o + c] -= memory[speed + c]
                memory[position + c] = memory[speed + c] = 0.0
            for c in range(active):  # ``contact``
                wanted = number_at(where[2, c], sample)
                astray = s[kept + c] > 0.0 and flag_at(where[5, c], sample) > 0
                if astray and s[share + c] <= OPEN and abs(wanted) >= LOST * s[deviation + c]:
                    pulled = wanted / ratio
                    give = pulled / (number_at(where[4, c], sample) * s[stiffness + c])
                    s[q + c] = course[0, here, c] - math.copysign(s[half + c], pulled) - give
        for c in range(wide):
            s[q + c] += h * s[v + c]
        j += 1
        if j == substeps:
            j = 0
            for c in range(wide):
                s[new + c] = s[now + c]
                s[now + c] = s[later + c]
                s[later + c] = 0.0
