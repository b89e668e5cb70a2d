"""The drive's reading of a torque, by the laws of a model."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import numpy as np
from numpy.typing import NDArray

from beltcomm.model import Model

Array = NDArray[np.float64]


def torque_as_read(model: Model, torque: Array, sample_s: float) -> Array:
    """What the drive reports of a torque every ``sample_s`` seconds, (n,), N m; it begins at the first value."""
    for effect in model.effect_list():
        if effect.slot == "torque_reading":
            law = cast("Callable[..., Array]", effect.law)
            torque = law(torque, float(torque[0]), sample_s, *[model[name] for name in effect.full_names()])
    return torque
