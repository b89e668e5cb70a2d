"""Share of the belt's stiffness that holds the carriage at each sample, where a strand goes slack at large force."""

from __future__ import annotations

from typing import cast

import numpy as np

from beltcomm.arrays import Array
from beltcomm.model import Model
from beltcomm.model.linear import belt_at, values_of
from beltcomm.simulate.inverse import FineMotion, belt_load, true_motion

#: Stretches at which the laws are looked up, and how often their range is doubled until it holds the largest force.
STRETCHES, DOUBLED = 2001, 8


def stiffness_left(model: Model, motion: FineMotion) -> Array | None:
    """Share of the belt's stiffness that holds the carriage at each sample: 1 with both strands tight.

    It is the slope of the belt's law at the stretch that carries the load.  A gap is no such law: its carriage is followed (``observer``).
    The belt is taken to be as stiff everywhere as in the middle of the way, and its damping to carry nothing: only the noise asks for it.

    Parameters
    ----------
    model : Model
        With any effects.
    motion : FineMotion
        Of a segment.

    Returns
    -------
    ndarray (n,) or None
        None where no strand goes slack.
    """
    laws = [e for e in model.effect_list() if e.slot == "belt_law" and not e.rattles]
    if not laws or "cart" not in model.base_bodies:
        return None
    vector, ratio = model.vector(), model["transmission.ratio"]
    true = true_motion(model, motion, vector)
    middle = 0.5 * ratio * float(true.theta.min() + true.theta.max())
    wanted = belt_load(model, true, vector, 0.0) / (ratio * belt_at(model, middle)[0])  # m, stretch of a belt with both strands tight
    wanted[[0, -1]] = wanted[[1, -2]]  # the mean has no ends
    reach = max(float(np.abs(wanted).max()), 1e-9)
    for _ in range(DOUBLED):
        segment = np.linspace(-reach, reach, STRETCHES)
        loading, slope = segment, np.ones(STRETCHES)
        for effect in laws:
            law, slope_of, values = effect.law, effect.slope, values_of(model, effect, middle)
            assert law is not None
            assert slope_of is not None
            slope = slope * [cast(float, slope_of(x, *values)) for x in loading]
            loading = np.array([law(x, *values) for x in loading])
        if loading[0] <= wanted.min() and wanted.max() <= loading[-1]:
            break
        reach *= 2.0
    return np.interp(wanted, loading, slope)
