"""The border between a virtual drive and the machine behind it: an object with a step method.

The product's default is :class:`beltcomm.simulate.plant.SimulatedPlant`; the accuracy figures of the tests use an
independent simulator that implements the same protocol.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable


class Plant(Protocol):
    """A machine seen from the motor shaft.

    Attributes
    ----------
    position_rad : float, rad
        True motor angle.
    velocity_rad_s : float, rad/s
    cart_position_m : float, m
        True carriage position relative to where the run began (for judging only).
    belt_force_n : float, N
        Force in the driving belt strand (for judging only).
    """

    position_rad: float
    velocity_rad_s: float
    cart_position_m: float
    belt_force_n: float

    def step(self, torque_nm: float, duration_s: float) -> None:
        """Let a torque act; deterministic.

        Parameters
        ----------
        torque_nm : float, N m, motor shaft
            Held all the time.
        duration_s : float, s
            How long.
        """
        ...


@runtime_checkable
class BrakedPlant(Protocol):
    """A machine whose motor has a holding brake, beside :class:`Plant`."""

    def brake(self, torque_nm: float) -> None:
        """Close or open the holding brake from now on.

        Parameters
        ----------
        torque_nm : float, N m, motor shaft
            With up to which it holds; 0: it is open.
        """
        ...
