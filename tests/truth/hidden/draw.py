"""Draws: a machine and what is hidden in it, from a seed."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from truth.hidden.catalogue import EFFECTS
from truth.hidden.families import data_sheet, draw_base
from truth.hidden.instruments import Instruments, draw_instruments
from truth.hidden.machines import Machine
from truth.hidden.outside import OUTSIDE

ALL: Final = {**EFFECTS, **OUTSIDE}
#: Effects that share a body or a slot of the kernel, so that a machine has only one of them.
EXCLUSIVE: Final = ({"payload_mode", "payload_impact"}, {"cable_hysteresis"})


def draw(
    seed: int,
    effects: Sequence[str] = (),
    strength: float = 1.0,
    family: str = "sheet",
    outside: bool = False,
    instruments: Instruments | None = None,
    drawn_instruments: bool = False,
) -> Machine:
    """A machine with hidden effects; none for a healthy one.

    The healthy part depends on seed and family only, each effect on seed and its name: the same seed gives the same machine
    with other things hidden in it.   strength : 0 to 1, of every effect.   outside : one effect that the catalogue does not
    hold is drawn in addition, unless ``effects`` names one.
    instruments : given; None for ideal ones, or, with ``drawn_instruments``, drawn from random numbers of their own.
    Raises ValueError for an unknown effect or family, a strength outside 0..1, or two effects that exclude each other.
    """
    names = list(effects)
    if outside and not any(name in OUTSIDE for name in names):
        names.append(str(np.random.default_rng((seed, 5)).choice(sorted(OUTSIDE))))
    unknown = [name for name in names if name not in ALL]
    if unknown:
        raise ValueError(f"no effect is called {', '.join(unknown)}; there are {', '.join(ALL)}")
    if not 0.0 <= strength <= 1.0:
        raise ValueError(f"strength {strength} is not within 0 to 1")
    if family == "rigid" and names:
        raise ValueError(f"{', '.join(names)} cannot be hidden in an axis without a belt: only healthy ones are made")
    if any(len(group & set(names)) > 1 for group in EXCLUSIVE):
        raise ValueError(f"{', '.join(names)} cannot be in one machine")
    base = draw_base(np.random.default_rng((seed, 0)), family)
    if instruments is None:
        instruments = draw_instruments(seed, base) if drawn_instruments else Instruments.ideal()
    if instruments.counts_per_rev is not None:
        base = replace(base, counts_per_rev=instruments.counts_per_rev)
    sheet = data_sheet(base, np.random.default_rng((seed, 1)))
    p = base.vector()
    hidden: dict[str, dict[str, Any]] = {}
    for name in [known for known in ALL if known in names]:  # in the catalogue's order: later ones look at earlier ones
        rng = np.random.default_rng((seed, 10, zlib.crc32(name.encode())))
        hidden[name] = dict(ALL[name](rng, base, strength, p))
    bursts = np.array(hidden.get("load_bursts", {}).get("bursts", []), dtype=float).reshape(-1, 3)
    return Machine(seed, base, tuple(hidden), strength, hidden, p, sheet, bursts, instruments)
