"""Places of a model's parameters in the vectors of the kernels, and the effects that are on: one switchboard for each combination."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import cast

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Array, BoolArray
from beltcomm.effects import EFFECTS, Effect, effect_named
from beltcomm.model import expected_parameters
from beltcomm.simulate.kernels.belt_lanes import PLAIN, covers
from beltcomm.simulate.kernels.writer import acts_on_motor, catalogue_parameters

#: Slots of what changes angle or torque and no load.
BEFORE_THE_LOAD = ("sensor", "torque_path", "torque_delay", "torque_reading")
#: Slots of what only changes the mass of a body that is there anyway.
MASSES = ("rigid", "load_of_record")
_CATALOGUE_SIZE = len(catalogue_parameters())


@dataclass(frozen=True)
class Switchboard:
    """Places of a model's parameters in the vector of the masked kernel, and the effects that are on.

    Attributes
    ----------
    places : ndarray (k,) of int
        Place of each entry of ``Model.vector()``.
    on : ndarray of bool, (effects of the catalogue,) bool
    motor, belt : ndarray of bool
        The same for those that act on the motor alone, and for the others: the load is the sum of both.
    delays : tuple of tuple[Callable[..., ndarray], tuple[int, ...]]
        Effects between reported and acting torque, with their places in the model's vector.
    readings : tuple of tuple[Callable[..., ndarray], tuple[int, ...]]
        The same for those between the torque and its reading.
    bent : bool
        Whether the torque path is touched by an effect.
    sensor : tuple of int
        Places in the model's vector of the errors of the angle.
    bare : bool
        Nothing but ``PLAIN`` is beyond the motor.
    in_lanes : bool
        Nothing but what ``belt_loads_in_lanes`` covers is beyond the motor.
    rubs : tuple of int
        Places in the model's vector of what the effects that act on the motor alone ask for.
    """

    places: NDArray[np.intp]
    on: BoolArray
    motor: BoolArray
    belt: BoolArray
    delays: tuple[tuple[Callable[..., Array], tuple[int, ...]], ...]
    readings: tuple[tuple[Callable[..., Array], tuple[int, ...]], ...]
    bent: bool
    sensor: tuple[int, ...]
    bare: bool
    in_lanes: bool
    rubs: tuple[int, ...]

    def masked_vector(self, vector: Array) -> Array:
        """The vector of the masked kernel: parameters of the whole catalogue, SI, 0 for those that the model has not."""
        p = np.zeros(_CATALOGUE_SIZE)
        p[self.places] = vector
        return p


@lru_cache(maxsize=256)
def switchboard(base_bodies: tuple[str, ...], effects: tuple[str, ...]) -> Switchboard:
    """The switchboard of one combination of effects.

    Parameters
    ----------
    base_bodies : tuple of str
        The driven body first.
    effects : tuple of str
        Names.
    """
    catalogue = catalogue_parameters()
    own = list(expected_parameters(effects, base_bodies))
    chosen = [effect_named(name) for name in effects]
    laws: dict[str, list[tuple[Callable[..., Array], tuple[int, ...]]]] = {e.slot: [] for e in chosen}
    for e in chosen:
        laws[e.slot].append((cast("Callable[..., Array]", e.law), tuple(own.index(name) for name in e.full_names())))
    return Switchboard(
        np.array([catalogue[name] for name in own], dtype=np.intp),
        np.array([effect.name in effects for effect in EFFECTS]),
        np.array([effect.name in effects and acts_on_motor(effect) for effect in EFFECTS]),
        np.array([effect.name in effects and not acts_on_motor(effect) and effect.slot not in MASSES for effect in EFFECTS]),
        tuple(laws.get("torque_delay", ())),
        tuple(laws.get("torque_reading", ())),
        any(e.slot == "torque_path" for e in chosen),
        tuple(own.index(name) for e in chosen if e.slot == "sensor" for name in e.full_names()),
        base_bodies == ("motor", "cart") and _effects_beyond_motor(chosen) <= set(PLAIN),
        base_bodies == ("motor", "cart") and covers(_effects_beyond_motor(chosen)),
        tuple(own.index(name) for e in chosen if acts_on_motor(e) for name in (*e.full_names(), *e.uses) if name in own),
    )


def _effects_beyond_motor(chosen: Sequence[Effect]) -> set[str]:
    """Names of the effects beyond the motor."""
    return {e.name for e in chosen if not acts_on_motor(e) and e.slot not in (*BEFORE_THE_LOAD, *MASSES)}
