"""Kernels that a search compiles last, for the time in which it waits for what another process compiles (``simulate.kernels.ahead``)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from beltcomm.effects import EFFECTS
from beltcomm.laboratory.harmonics import gain_kernel, load_kernel
from beltcomm.simulate.kernels.compose import inverse_kernel
from beltcomm.simulate.kernels.observer import idle
from beltcomm.simulate.kernels.writer import catalogue_parameters
from beltcomm.simulate.lock_step import Lane, lock_step


def last_compiled() -> list[Callable[[], object]]:
    """Calls on next to nothing, with the types of every other call, in the order in which a search makes them."""
    a, b, c, d, out, torque = np.zeros((6, 3))
    torque.flags.writeable = False  # as a recorded one
    means, p, on = np.zeros((2, 1)), np.ones(len(catalogue_parameters())), np.zeros(len(EFFECTS), dtype=np.bool_)
    kernel, delays = inverse_kernel(), [e.law for e in EFFECTS if e.slot == "torque_delay" and e.law is not None]
    readings = [e.law for e in EFFECTS if e.slot == "torque_reading" and e.law is not None]
    return [
        lambda: load_kernel(a, b, c, d, 2, means),
        lambda: gain_kernel(a, b, c, d, torque, 2, means),
        lambda: kernel.torque(a[:2], b, p, on, 0.0, 1.0, out),
        *(lambda law=law: law(a, 1.0, 1.0) for law in delays),
        *(lambda law=law: law(a, 0.0, 1.0, 1.0) for law in readings),
        lambda: kernel.angle(a, b, p, on),
        lambda: lock_step([Lane(np.zeros(1), np.zeros(1), 0.0, 0.0, 1.0, p, idle())], on, 1.0),
    ]
