"""Rounds of the checks on a played drive: random order, random values."""

from __future__ import annotations

import numpy as np

from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.device import VirtualDrive
from beltcomm.virtual.foreign import profile_named
from independent.checks import CHECKS
from independent.master import Master, Refusal, Silence
from virtual.host import RigidPlant

#: What is left, by drive: nothing.
LISTED: dict[str, set[str]] = {}


def rounds(name: str, seed: int, count: int = 1) -> list[str]:
    """Deviations of this drive, each with the check that found it."""
    draw = np.random.default_rng((seed, len(name)))
    bus = LockstepBus(ticks_per_second=round(1.0 / profile_named(name).cycle_s))
    VirtualDrive(bus, RigidPlant(), name, node_id=1)
    master = Master(bus)
    master.wait(0.1)
    found: list[str] = []
    for _ in range(count):
        for check in draw.permutation(sorted(CHECKS)):
            try:
                found += [f"{check}: {text}" for text in CHECKS[str(check)](master, draw)]
            except (Refusal, Silence, AssertionError) as error:
                found.append(f"{check}: {error!r}")
    bus.shutdown()
    return found
