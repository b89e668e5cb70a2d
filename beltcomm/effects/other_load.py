"""Loads that differ by record: what moves with the motor in records that state another load than the first ones do."""

from __future__ import annotations

from beltcomm.effects._effect import Effect, Parameter

#: Loads beside the first that the records of a run may have.
COUNT = 3
_ORDINAL = ("second", "third", "fourth")


def mass_in_record(own: float, stated: float) -> float:
    """Mass that moves with the motor in a record, in place of the model's own:  m + stated, kg (kg m² without a carriage).

    Parameters
    ----------
    own : float, kg
        Of the load that the record names.
    stated : float, kg
        Beyond that, in the record's sidecar.

    References
    ----------
    (2.25) with another m_c.
    """
    return own + stated


def other_load(number: int, *, at_motor: bool = False) -> Effect:
    """The load of a number, from 1, as the mass of the carriage; of an axis that knows no carriage, as the inertia of all that turns.

    Parameters
    ----------
    number : int
        From 1; the order of the records' loads.
    at_motor : bool
        True for an axis whose model has no carriage.

    Returns
    -------
    Effect
        With one parameter: a mass, kg at the carriage, or an inertia, kg m² at the motor.
    """
    name = ("other_inertia" if at_motor else "other_load") + (f"_{number}" if number > 1 else "")
    which = f"in records with the {_ORDINAL[number - 1]} load"
    title = "all that turns" if at_motor else "carriage with payload"
    mass = Parameter("mass", "kg", "cart", 1.0, 1e-3, 1e4, f"{title}, {which}")
    inertia = Parameter("inertia", "kg m2", "motor", 5e-5, 1e-8, 10.0, f"{title}, {which}")
    return Effect(
        name=name,
        slot="load_of_record",
        title=f"{title}, in records with another load",
        law=mass_in_record,
        parameters=(inertia if at_motor else mass,),
        uses=() if at_motor else ("cart.mass",),
        seen="some records need more torque to accelerate than others, at the same speeds and places",
        causes="a workpiece, a gripper or a tool that was put on or taken off between two records",
        check="weigh what was mounted, and state it with the records: `beltcomm import --payload`",
        remedy="name the load of each record: `beltcomm import --load NAME`, or `load: NAME` in its sidecar",
        alike={
            "warmup": "record both loads again in the other order: what goes with the load stays with it, what goes with time does not",
        },
        linear=True,
        source="(2.25)",
    )


EFFECTS = tuple(other_load(number, at_motor=at_motor) for at_motor in (False, True) for number in range(1, COUNT + 1))
