"""Parameters that a fit moves, and the part of the torque balance, and of its noise, that goes with each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from beltcomm.effects import effect_named
from beltcomm.model import Model
from beltcomm.model.mounted import carrying
from beltcomm.simulate.kernels.writer import acts_on_motor

#: What a parameter touches: the inertia's torque and the noise, the motor's own load, everything beyond the motor, the torque path,
#: or all of them.
Touch = Literal["inertia", "motor", "belt", "path", "all"]


def part_touched(model: Model, name: str) -> Touch:
    """Part of the equation of motion in which a parameter stands.

    Parameters
    ----------
    model : Model
        That has the parameter.
    name : str
        Full name.

    Returns
    -------
    Touch
        "all" where it stands in more than one.
    """
    of_load = any(name in e.full_names() for e in model.effect_list() if e.slot == "load_of_record")
    name = carrying(model) if of_load else name
    if name == "motor.inertia" or (name == "cart.mass" and model.rigid):
        return "all" if any(name in effect.uses for effect in model.effect_list() if effect.slot != "load_of_record") else "inertia"
    kinds: set[Touch] = set()
    for effect in model.effect_list():
        if name not in (*effect.full_names(), *effect.uses) or effect.slot == "load_of_record":
            continue
        if effect.slot in ("sensor", "kinematics"):
            kinds.add("all" if effect.slot == "sensor" else "belt")
        elif effect.slot in ("torque_path", "torque_delay", "torque_reading"):
            kinds.add("path")
        else:
            kinds.add("motor" if acts_on_motor(effect) else "belt")
    if name.split(".")[0] in {body.name for _, body in model.bodies()}:
        kinds.add("belt")
    return kinds.pop() if len(kinds) == 1 else "all"


def touches_noise(model: Model, name: str) -> bool:
    """True if the noise's path to the residual goes with a parameter: all but those of friction that has one level while it slides.

    Parameters
    ----------
    model : Model
        That has the parameter.
    name : str
        Full name.

    Returns
    -------
    bool
        True for a parameter of no effect.
    """
    slots = {effect.slot for effect in model.effect_list() if name in (*effect.full_names(), *effect.uses)}
    return not slots or not slots <= {"friction_level", "sensor", "external"}


def free_parameters(model: Model, fixed: Sequence[str] = ("transmission.ratio",)) -> tuple[str, ...]:
    """Names of the parameters that a fit moves: not those fixed, known beforehand or without room between their bounds.

    Parameters
    ----------
    model : Model
        With bounds.
    fixed : sequence of str
        That do not move.

    Returns
    -------
    tuple of str
        In the order of the model.
    """
    known = set(fixed)
    for name in model.effects:
        effect = effect_named(name)
        known |= {f"{name}.{parameter.name}" for parameter in effect.parameters if not (parameter.fitted or parameter.form)}
    return tuple(name for name, item in model.parameters.items() if name not in known and item.low < item.high)
