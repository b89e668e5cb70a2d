"""The commonest belt, several models in lock step: a carriage on one spring and damper, with viscous and Coulomb friction of its own.

The same steps as the masked kernel of ``compose``, without switches and with the models side by side: a step of one model waits for the
step before it, a step of eight in four registers takes no longer.  The triangular mean is taken on the way.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from beltcomm.compiled import in_lanes
from beltcomm.simulate.mean import ABSURD_NM
from beltcomm.simulate.observer import lanes_for

Array = NDArray[np.float64]

#: Effects beyond the motor that this file knows; each is off where its parameter is 0.
PLAIN = ("belt_stiffness", "belt_damping", "viscous_cart", "cart_friction")


def plain_belt(theta: Array, omega: Array, step_s: float, substeps: int, ratio: float, first: float, values: Array) -> Array:
    """Triangular mean of the belt's load at the motor shaft, N m, (n, models), ends 0.

    theta, omega : (fine,), true motion.   step_s : s, fine step.   first : rad/s, speed at which all begins.
    values : (6, models): stiffness N/m, damping N s/m, carriage's mass kg, its viscous N s/m and Coulomb friction N, offset m at the start.
    """
    models = values.shape[1]
    mean = np.zeros(((theta.shape[0] - 1) // substeps + 1, models))
    _plain_belt(theta, omega, step_s, substeps, ratio, first, values, lanes_for(models), mean)
    return mean


@in_lanes
def _plain_belt(
    theta: Array, omega: Array, h: float, substeps: int, ratio: float, first: float, values: Array, lanes: int, mean: Array
) -> None:
    # Places in one block of memory, so that the compiler sees that none overlap.
    v, w, o, q, k, d, n, b, g, now, ahead = 0, 16, 32, 48, 64, 80, 96, 112, 128, 144, 160
    s = np.zeros(176)
    scale = ratio / (3.0 * substeps * substeps)
    for begin in range(0, values.shape[1], lanes):
        width = min(lanes, values.shape[1] - begin)
        rubs = False
        for c in range(lanes):
            at = begin + min(c, width - 1)
            s[k + c], s[d + c], s[n + c], s[b + c] = values[0, at], values[1, at], 1.0 / values[2, at], values[3, at]
            s[g + c] = max(values[4, at], 0.0) / values[2, at]
            rubs = rubs or s[g + c] > 0.0
            s[q + c] = ratio * theta[0] + values[5, at]
            s[v + c] = s[o + c] = ratio * first
            s[now + c] = s[ahead + c] = 0.0
        j, sample = 0, 0
        for i in range(theta.shape[0]):
            u, du = ratio * theta[i], ratio * omega[i]
            simpson = scale * (4.0 if j % 2 else 2.0)  # see ``mean.weighted``
            falling, rising = simpson * (substeps - j), simpson * j
            for c in range(lanes):
                s[w + c] = 1.5 * s[v + c] - 0.5 * s[o + c]
                s[o + c] = s[v + c]
                force = s[k + c] * (u - s[q + c]) + s[d + c] * (du - s[w + c])
                s[w + c] = (force - s[b + c] * s[w + c]) * s[n + c]
                s[now + c] += falling * force
                s[ahead + c] += rising * force
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
                    s[now + c] = s[ahead + c]
                    s[ahead + c] = 0.0
                j, sample = 0, sample + 1
