"""Braking of the axis during a session: friction at first, then a loop designed from the first estimate, then each loop in turn."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from beltcomm.control import Cascade
from beltcomm.errors import Refused
from beltcomm.identify.amplitude import family_around
from beltcomm.machine.machine import Machine
from beltcomm.machine.prediction_watch import BELT_BEYOND
from beltcomm.model import Model
from beltcomm.rundata import analyse
from beltcomm.simulate.stopping import (
    REACTION_PERIODS,
    Braking,
    braked_by_friction,
    braked_by_loop,
    braked_by_unknown_gains,
    rigid_deceleration,
    total_friction,
    total_inertia,
    total_viscous,
)

#: Share of the travel that a rigid stop takes from the speed at which stops are simulated.
SIMULATED_SHARE = 0.25
#: Gains without which a drive has no velocity loop that could be set.
VELOCITY_GAINS = ("kp_nm_s_rad", "ki_nm_rad")


@dataclass(frozen=True)
class PassiveBraking:
    """Braking of an axis whose drive is as it was found: friction, or the velocity loop in it, whichever needs less way.

    Attributes
    ----------
    sliding_nm : callable
        Friction at least, N m, by inertia and transmission; None takes the model's own.
    """

    kp_nm_s_rad: float
    ki_nm_rad: float
    deceleration_m_s2: float
    reaction_s: float
    sliding_nm: Callable[[float, float], float] | None = None

    def __call__(self, model: Model) -> Braking:
        """Braking that a stop of this model is counted with."""
        friction = total_friction(model)
        if self.sliding_nm is not None:
            friction = self.sliding_nm(total_inertia(model), model["transmission.ratio"])
        loop = braked_by_unknown_gains(model, self.kp_nm_s_rad, self.ki_nm_rad, self.deceleration_m_s2, self.reaction_s)
        return replace(braked_by_friction(model, friction, self.reaction_s), besides=loop)


@dataclass(frozen=True)
class Designed:
    """The loop in the drive was designed for this axis."""

    braking: Braking

    def __call__(self, _model: Model) -> Braking:
        """Braking that a stop is counted with."""
        return self.braking


def braking_of(machine: Machine, sliding_nm: Callable[[float, float], float] | None = None) -> PassiveBraking | Designed:
    """Braking that a stop is counted with now.

    Parameters
    ----------
    machine : Machine
    sliding_nm : callable
        As in :class:`PassiveBraking`.
    """
    if machine.braking is not None:
        return Designed(machine.braking)
    gains = machine.drive.backup()
    kp, ki = (gains.get(name, 0.0) for name in VELOCITY_GAINS)
    return PassiveBraking(kp, ki, machine.deceleration_m_s2, REACTION_PERIODS * machine.drive.capabilities.sample_period_s, sliding_nm)


def count_on_loop(machine: Machine, family: Sequence[Model], cascade: Cascade, delay_s: float) -> Braking:
    """Set the quick stop to the hardest one that a loop makes without loading the belt too much; returns what is counted with.

    Parameters
    ----------
    machine : Machine
    family : sequence of Model
        Models that the axis may be, the likeliest first.
    cascade : Cascade
    delay_s : float, s
        Of the torque path.

    Raises
    ------
    Refused
        When even the softest one loads the belt so much that a motion would be stopped for it.
    """
    capabilities, envelope = machine.drive.capabilities, machine.envelope()
    if machine.sends_feedforward and machine.cascade is not None:
        cascade = machine.cascade  # a quick stop has what stands in the drive
    low, high = envelope.window_m
    if machine.axis.mounting.tilted:
        machine.holding_nm = analyse.holding_nm(family[0])
    left_n = max(machine.belt_left_n, 1.0)
    limits = replace(machine.axis.limits, feed_force_n=left_n)
    rigid = rigid_deceleration(machine.axis, family[0]["cart.mass"], envelope.torque_nm).value_m_s2
    speed = min(envelope.speed_m_s, math.sqrt(2.0 * rigid * SIMULATED_SHARE * (high - low)))
    braking, stop = braked_by_loop(
        family,
        cascade,
        replace(machine.axis, limits=limits),
        speed,
        position_m=low,
        period_s=capabilities.structure.period_s,
        reaction_s=REACTION_PERIODS * capabilities.sample_period_s,
        delay_s=delay_s,
        torque_limit_nm=envelope.torque_nm,
        counts_per_rev=capabilities.counts_per_rev,
    )
    if stop.belt_force_n > BELT_BEYOND * left_n:
        raise Refused(
            f"even a stop with {braking.deceleration_m_s2:.3g} m/s² out of {braking.acceleration_m_s2:.3g} m/s² would load the belt with "
            f"{stop.belt_force_n:.0f} N by this loop, its limit leaves {left_n:.0f} N for that; look at the gains, "
            "or at what is loose on the axis"
        )
    machine.brake_with(braking)
    machine.closed, machine.family = (family[0], delay_s), tuple(family)
    machine.friction = max(map(total_friction, family)), max(map(total_viscous, family))
    machine.folder.journal(
        f"a stop brakes with {braking.deceleration_m_s2:.4g} m/s² after {1e3 * braking.lag_s:.1f} ms: {1e3 * braking.way_m(speed):.0f} mm "
        f"from {speed:.3g} m/s, out of {braking.acceleration_m_s2:.3g} m/s² at most: {stop.belt_force_n:.0f} N in the belt"
    )
    return braking


def lend_brake(machine: Machine, model: Model, position_m: float) -> None:
    """A cautious loop for the next open-loop record, which only a quick stop closes; a drive without gains keeps to friction.

    Parameters
    ----------
    machine : Machine
    model : Model
        For which the loop is designed.
    position_m : float, m
        Carriage on the axis.
    """
    if not set(VELOCITY_GAINS) <= set(machine.drive.backup()):
        return
    structure = machine.drive.capabilities.structure
    delay_s = machine.drive.capabilities.sample_period_s  # not measured yet
    try:
        result = analyse.first_loop(model, structure, position_m, delay_s, 0.0)
    except Refused as problem:
        machine.folder.journal(f"only friction stops an open-loop record: {problem}")
        return
    cascade = analyse.with_feedforward(result.cascade, model, structure, delay_s)
    count_on_loop(machine, family_around(model), machine.write_cascade(cascade), delay_s)
