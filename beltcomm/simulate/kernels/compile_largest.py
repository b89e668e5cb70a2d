"""``python -m beltcomm.simulate.kernels.compile_largest``: what :mod:`beltcomm.simulate.kernels.ahead` has compiled beside a process."""

from __future__ import annotations

import gc

import numpy as np

from beltcomm.effects import EFFECTS
from beltcomm.simulate.kernels import ahead, compose
from beltcomm.simulate.kernels.belt_lanes import belt_loads_in_lanes, lane_values
from beltcomm.simulate.kernels.observer import NOTHING
from beltcomm.simulate.kernels.writer import catalogue_parameters


def main() -> None:
    """Compile the masked load and the belt with what may stand beside it, by calls with the types of every other call."""
    p, on = np.ones(len(catalogue_parameters())), np.zeros(len(EFFECTS), dtype=np.bool_)
    motion, rest, load, cart = np.zeros((4, 3))
    compose.load_module().load(motion, rest, p, on, 0.0, 1.0, 1.0, 0.0, load, cart, NOTHING)
    richest = lane_values(1, lambda name: 1.0 if name.endswith("distance") else 0.5, np.zeros(1))
    belt_loads_in_lanes(motion, rest, 1.0, 2, 1.0, 0.0, richest)
    note = ahead.note_file()
    if note is not None:
        ahead.write_note(note)
        ahead.prune(note)


if __name__ == "__main__":
    gc.disable()  # a compiler drops little
    main()
