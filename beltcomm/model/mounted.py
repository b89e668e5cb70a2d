"""Load of a record beside the others: its mass stands in place of the model's, or is added to it."""

from __future__ import annotations

from dataclasses import dataclass

from beltcomm.arrays import Array
from beltcomm.effects.other_load import mass_in_record, other_load
from beltcomm.model import Model

MASS = "cart.mass"


@dataclass(frozen=True)
class Mounted:
    """Load of one record.

    Attributes
    ----------
    number : int
        0 for the load whose mass the model's own is; from 1 for those of ``other_load``.
    more : float
        Stated beyond that, kg (kg m² of an axis that knows no carriage).
    """

    number: int = 0
    more: float = 0.0


def carrying(model: Model) -> str:
    """Name of the mass that goes with the load: the carriage's, or that of all that turns where no carriage is known.

    Parameters
    ----------
    model : Model
        Of any kind of axis.

    Returns
    -------
    str
        Full name of the parameter.
    """
    return MASS if MASS in model.parameters else model.bodies()[0][0]


def of_load(model: Model, number: int) -> str:
    """Name of the mass of a load, from 0.

    Parameters
    ----------
    model : Model
        Of any kind of axis.
    number : int
        0 is the load of the base model.

    Returns
    -------
    str
        Full name of the parameter.
    """
    return carrying(model) if number == 0 else other_load(number, at_motor=carrying(model) != MASS).full_names()[0]


def loaded(model: Model, vector: Array, mounted: Mounted | None) -> Array:
    """Values of a model, in the order of its vector, in a record with such a load; the same array without any.

    Parameters
    ----------
    model : Model
        With the masses of all loads.
    vector : ndarray, (n,)
        Values of its parameters.
    mounted : Mounted or None
        Load of the record.

    Returns
    -------
    ndarray, (n,)
        A new array, or ``vector``.
    """
    if mounted is None:
        return vector
    found = vector.copy()
    found[model.index(carrying(model))] = mass_in_record(vector[model.index(of_load(model, mounted.number))], mounted.more)
    return found


def loaded_model(model: Model, mounted: Mounted | None) -> Model:
    """The model in a record with such a load.

    Parameters
    ----------
    model : Model
        With the masses of all loads.
    mounted : Mounted or None
        Load of the record.

    Returns
    -------
    Model
        ``model`` itself without one.
    """
    return model if mounted is None else model.with_vector(loaded(model, model.vector(), mounted))
