"""Stops of an axis: along which deceleration, on which way, with how much force in the belt.

A drive's quick stop ramps its speed down with a constant deceleration d (6085h) and drops the torque that accelerated the axis.  The force
of the belt is then to go from F_a = m a to -F_d = -m d at once.  An undamped belt swings around where it is to go by all that it has to go,

    |F|  ≤  F_d + (F_a + F_d)  =  F_a + 2 F_d,

twice the force of a rigid one out of constant speed.  A speed controller that is slower than the belt rounds the step off, so that

    |F|  ≤  F_0 + r F_a,    F_0 ≤ 2 F_d,  r ≤ 1,

with what the loop makes of F_0 and r; the simulation of a stop finds both.  Carriage side, SI.

Out of a closed position loop the drive ramps down at once where the stop is asked for; when the host is lost, as soon as it notices.

Until then the setpoint stands still. Setpoint, speed and torque that were sent along stay as they were last. The acceleration that the
drive feeds forward, the difference of its speeds, ends with them, so that the torque which accelerated the axis falls away at once, and
the position controller pulls back harder with each millisecond. A following error beyond 6065h for longer than 6066h ends that, or the
guard time; then the drive stops along its ramp, from the speed that its loop was last asked for, which the filter of its reference holds.
Carriage side, SI.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from beltcomm.arrays import Array
from beltcomm.axis import Axis
from beltcomm.control import Cascade, begin_ramp, measured_speed, new_state, reset_state
from beltcomm.model import Model
from beltcomm.simulate.loop import LoopDrive, close_loop, waiting_torque
from beltcomm.simulate.plant import SimulatedPlant

#: Force of a suddenly pulled undamped spring over that of a rigid one.
SWING = 2.0
#: kg: the heaviest carriage that is thought of before it is weighed.
HEAVIEST_KG = 30.0
#: Carriages of a belt axis that stand for an unknown payload before anything was measured, kg; of any other axis, its load over the
#: inertia at its motor.
UNKNOWN_MASSES_KG = (0.3, 1.0, 3.0, 10.0, HEAVIEST_KG)
UNKNOWN_SHARES = (0.1, 0.3, 1.0, 3.0, 10.0)
#: Periods from what makes a stop necessary to the drive's ramp: three lost answers, one to notice, one until the command is active.
REACTION_PERIODS = 5
#: s: constant speed before a simulated stop, rise of the acceleration out of which it may come, and rest after its ramp.
SETTLE_S, RISE_S, REST_S = 0.15, 0.1, 0.4
#: Largest acceleration over the deceleration of a stop: an undamped belt then bears F_a + 2 F_d with half of its force for either.
ACCELERATED_OVER_BRAKED = 2.0
#: Parts of the speed from which a stop is simulated.
SPEED_PARTS = (0.03, 0.1, 0.3, 1.0)
#: Shares of the rigid deceleration that are tried, largest first.
SHARES = tuple(float(share) for share in np.geomspace(1.0, 0.2, 25))


class Deceleration(NamedTuple):
    """A deceleration, and what limits it.

    Attributes
    ----------
    value_m_s2 : float, m/s²
        Carriage.
    binds : str
        In words, what sets it.
    """

    value_m_s2: float
    binds: str


@dataclass(frozen=True)
class Braking:
    """Braking that a stop can count on:  way = v lag + v²/2a.

    An acceleration goes on for the lag; a drive that is slowing down begins its ramp at the higher speed of a reaction ago.

    Attributes
    ----------
    deceleration_m_s2 : float
        A.
    lag_s : float, s
        Until the stop is asked for, and until the axis follows its ramp.
    reaction_s : float
        The first part of it.
    besides : Braking or None
        What else brakes; the shorter way counts.
    acceleration_m_s2 : float
        Largest one out of which a stop loads the belt no more than it bears.
    """

    deceleration_m_s2: float
    lag_s: float
    reaction_s: float = 0.0
    besides: Braking | None = None
    acceleration_m_s2: float = math.inf

    def way_m(self, speed_m_s: float, acceleration_m_s2: float = 0.0) -> float:
        """Way to rest from a speed.

        Parameters
        ----------
        speed_m_s : float, carriage
        acceleration_m_s2 : float, carriage
            At the moment of the stop.

        Returns
        -------
        float, m
            inf when nothing brakes.
        """
        if speed_m_s == 0.0:
            return 0.0
        speed = abs(speed_m_s) + abs(acceleration_m_s2) * (self.lag_s if acceleration_m_s2 * speed_m_s > 0.0 else self.reaction_s)
        way = speed * self.lag_s + speed**2 / (2.0 * self.deceleration_m_s2) if self.deceleration_m_s2 > 0.0 else math.inf
        return min(way, self.besides.way_m(speed_m_s, acceleration_m_s2)) if self.besides else way

    def ways_m(self, speed_m_s: Array) -> Array:
        """:meth:`way_m` of many speeds at once, without acceleration."""
        speed = np.abs(speed_m_s)
        if self.deceleration_m_s2 > 0.0:
            ways = speed * self.lag_s + speed**2 / (2.0 * self.deceleration_m_s2)
        else:
            ways = np.where(speed > 0.0, np.inf, 0.0)
        return np.minimum(ways, self.besides.ways_m(speed)) if self.besides else ways

    @property
    def by_the_drive(self) -> Braking:
        """Braking when the drive itself begins the stop: nothing is lost for the host's reaction."""
        besides = self.besides.by_the_drive if self.besides else None
        return replace(self, lag_s=max(self.lag_s - self.reaction_s, 0.0), reaction_s=0.0, besides=besides)

    def span_m(self, position_m: Array, speed_m_s: Array, sample_s: float) -> tuple[float, float]:
        """Lowest and highest carriage position that a motion, (n,), reaches with a stop at any moment."""
        accelerations = np.gradient(speed_m_s, sample_s)
        ways = [self.way_m(float(v), float(a)) for v, a in zip(speed_m_s, accelerations, strict=True)]
        ends = position_m + np.sign(speed_m_s) * np.array(ways)
        return float(np.min([ends, position_m])), float(np.max([ends, position_m]))


@dataclass(frozen=True)
class HostLoss:
    """The end of an axis in torque mode when its host dies.

    Attributes
    ----------
    held_s : float, s
        The last torque is held so long at worst.
    braking : Braking
        What brakes the axis then.
    least_nm : float
        What pulls at least, N m: the weight of an axis that nothing holds.
    """

    held_s: float
    braking: Braking
    least_nm: float = 0.0


def run_on_distance(speed_m_s: Array, torque_nm: float, friction_nm: float, inertia_kg_m2: float, ratio: float, loss: HostLoss) -> Array:
    """Run-on of a rigid axis in one direction when its host dies under the worst torque in that direction, m, (n,):

        a = i_t (τ - τ_C)/J,    s = v T + a T²/2 + way(v + a T)

    Infinite when nothing brakes.

    Parameters
    ----------
    speed_m_s : ndarray (n,)
        In that direction; one that moves away counts as one at rest, which it must first come to.
    torque_nm : float
        Largest, N m.
    friction_nm, inertia_kg_m2 : float
        Of the whole axis at the motor.
    ratio : float
        i_t, m/rad.
    loss : HostLoss
        Time for which the torque is held, and braking.
    """
    speed, held_s = np.maximum(speed_m_s, 0.0), loss.held_s
    acceleration = max(ratio * (max(torque_nm, loss.least_nm) - friction_nm) / inertia_kg_m2, 0.0)
    return speed * held_s + 0.5 * acceleration * held_s**2 + loss.braking.ways_m(speed + acceleration * held_s)


@dataclass(frozen=True)
class Stop:
    """A simulated quick stop.

    Attributes
    ----------
    way_m : float
        Furthest carriage position after it was asked for, m.
    belt_force_n : float
        Largest since the carriage was fastest, N.
    """

    way_m: float
    belt_force_n: float


def rigid_deceleration(axis: Axis, mass_kg: float, torque_nm: float, swing: float = 1.0) -> Deceleration:
    """Largest deceleration within the axis' limits:  a ≤ a_max,  swing m a ≤ F_max,  (Θ_e/i_t + i_t m) a ≤ τ.

    Infinite when the axis states none of the limits.

    Parameters
    ----------
    axis : Axis
    mass_kg : float
        Carriage and payload.
    torque_nm : float
        Of motor and drive, motor shaft; friction, which helps to brake, is left out.
    swing : float
        1 for a belt that is loaded gently, ``SWING`` for a step, ``SWING`` + 1 for one out of an acceleration as large.
    """
    limits, ratio = axis.limits, axis.transmission_m_rad
    force, inertia = limits.feed_force_n or math.inf, axis.motor_side_inertia_kg_m2 if axis.motor.inertia_kg_m2 else 0.0
    return min(
        Deceleration(limits.acceleration_m_s2 or math.inf, f"the axis limit of {limits.acceleration_m_s2 or math.inf:g} m/s²"),
        Deceleration(force / (swing * mass_kg), f"the axis limit of {force:g} N feed force on {mass_kg:.3g} kg"),
        Deceleration(torque_nm / (inertia / ratio + ratio * mass_kg), f"{torque_nm:.3g} N m of motor torque on {mass_kg:.3g} kg"),
    )


def unknown_loads_kg(axis: Axis) -> tuple[float, ...]:
    """Loads to count with until they are measured, kg, the lightest first.

    Parameters
    ----------
    axis : Axis
        Of any kind.

    Returns
    -------
    tuple of float, kg
        Without the motor side; behind a belt the same for every axis.
    """
    if axis.transmission is None:
        return UNKNOWN_MASSES_KG
    return tuple(share * axis.motor_side_inertia_kg_m2 / axis.transmission_m_rad**2 for share in UNKNOWN_SHARES)


def usual_load_kg(axis: Axis, of_belt_kg: float) -> float:
    """Load that is thought of before anything tells, kg: the stated payload, or what an axis of this kind often has.

    Parameters
    ----------
    axis : Axis
        Of any kind.
    of_belt_kg : float, kg
        That an axis with a belt often has.
    """
    return axis.payload.mass_kg or (of_belt_kg if axis.transmission is None else unknown_loads_kg(axis)[len(UNKNOWN_SHARES) // 2])


def first_deceleration(axis: Axis, torque_nm: float) -> Deceleration:
    """Deceleration of a quick stop before the carriage is weighed: the heaviest one thought of, and a step that makes the belt swing.

    Parameters
    ----------
    axis : Axis
    torque_nm : float, N m, motor shaft
        Largest of the drive.
    """
    peak = min(torque_nm, axis.motor.peak_torque_nm or math.inf)
    return rigid_deceleration(axis, max(unknown_loads_kg(axis)[-1], axis.payload.mass_kg or 0.0), peak, SWING)


def total_inertia(model: Model) -> float:
    """Inertia of a rigid axis at the motor shaft:  Θ_e + i_t² m, kg m².

    Parameters
    ----------
    model : Model
        With a carriage.
    """
    return model["motor.inertia"] + model["transmission.ratio"] ** 2 * model["cart.mass"]


def total_friction(model: Model) -> float:
    """Coulomb friction of a rigid axis at the motor shaft:  τ_m + i_t F_c, N m.

    Parameters
    ----------
    model : Model
        Effects that it does not have count as 0.
    """
    return model.get("coulomb.level") + model["transmission.ratio"] * model.get("cart_friction.level")


def total_viscous(model: Model) -> float:
    """Viscous friction of a rigid axis at the motor shaft:  d_m + i_t² d_c, N m s/rad.

    Parameters
    ----------
    model : Model
        Effects that it does not have count as 0.
    """
    return model.get("viscous.damping") + model["transmission.ratio"] ** 2 * model.get("viscous_cart.damping")


def braked_by_friction(model: Model, friction_nm: float, reaction_s: float) -> Braking:
    """Braking by Coulomb friction alone, of a rigid axis without torque:  a = i_t τ_C/J.

    Parameters
    ----------
    model : Model
        For inertia and transmission.
    friction_nm : float, N m, motor shaft
        τ_C.
    reaction_s : float, s
        Until the torque is off.

    Returns
    -------
    Braking
        At the carriage.
    """
    return Braking(model["transmission.ratio"] * friction_nm / total_inertia(model), reaction_s, reaction_s)


def braked_by_unknown_gains(model: Model, kp_nm_s_rad: float, ki_nm_rad: float, deceleration_m_s2: float, reaction_s: float) -> Braking:
    """Braking by a velocity loop that was never designed for this axis, taken as rigid, along the ramp of a quick stop.

    J ω' + K_P ω + K_I φ = 0  swings out by less than  ω J/K_P  and  ω √(J/K_I).

    Parameters
    ----------
    model : Model
        For the inertia J.
    kp_nm_s_rad : float, N m s/rad, motor shaft
        K_P; 0 for none.
    ki_nm_rad : float, N m/rad, motor shaft
        K_I; 0 for none.
    deceleration_m_s2 : float, m/s²
        Of the ramp, at the carriage.
    reaction_s : float, s
        Until the stop begins.

    Returns
    -------
    Braking
        At the carriage.
    """
    inertia = total_inertia(model)
    lag = min(
        inertia / kp_nm_s_rad if kp_nm_s_rad > 0.0 else math.inf,
        math.sqrt(inertia / ki_nm_rad) if ki_nm_rad > 0.0 else math.inf,
    )
    return Braking(deceleration_m_s2, lag + reaction_s, reaction_s)


def _predict_stop(
    model: Model,
    cascade: Cascade,
    speed_m_s: float,
    deceleration_m_s2: float,
    *,
    acceleration_m_s2: float = 0.0,
    position_m: float,
    period_s: float,
    delay_s: float,
    torque_limit_nm: float,
    counts_per_rev: int,
) -> Stop:
    """A quick stop by the drive's own velocity loop, on the model.

    The ramp begins at the measured speed and has no feedforward of its acceleration.   The axis has reached an ``acceleration_m_s2``, out
    of which it comes, with a jerk of a/``RISE_S`` from constant speed, or what such a jerk makes of it from rest; the torque for it,
    J a/i_t, ends with the stop.   ``delay_s`` is from torque setpoint to acting torque.
    """
    ratio, way = model["transmission.ratio"], math.copysign(1.0, speed_m_s)
    jerk, top = acceleration_m_s2 / RISE_S, abs(speed_m_s)
    rise_s = min(RISE_S, math.sqrt(2.0 * top / jerk)) if jerk > 0.0 else 0.0
    rise = period_s * np.arange(round(rise_s / period_s), 0, -1)
    before = np.append(np.full(round(SETTLE_S / period_s), top - jerk * rise_s**2 / 2.0), top - jerk * rise * (rise_s - rise / 2.0))
    steps = math.ceil(top / (deceleration_m_s2 * period_s)) + round(REST_S / period_s)
    ramp = np.maximum(top - deceleration_m_s2 * period_s * np.arange(1, steps + 1), 0.0)
    speeds, asked = way / ratio * np.append(before, ramp), len(before)
    none = np.zeros(len(speeds))
    along = none.copy()
    along[asked - len(rise) : asked] = way / ratio * total_inertia(model) * jerk * (rise_s - rise)
    plant = SimulatedPlant(model, position_m, speed_m_s=ratio * float(speeds[0]))
    loop = LoopDrive(period_s, delay_s, torque_limit_nm, counts_per_rev)
    run = close_loop(plant, cascade, loop, "velocity", none, speeds, along, acceleration_rad_s2=none, speed_rad_s=float(speeds[0]))
    ways = way * (run.cart_m[asked:] - run.cart_m[asked])
    fastest = asked + int(np.argmax(np.diff(ways, prepend=0.0)))
    return Stop(float(ways.max()), float(run.belt_force_n[fastest:].max()))


def braked_by_loop(
    family: Sequence[Model],
    cascade: Cascade,
    axis: Axis,
    speed_m_s: float,
    *,
    position_m: float,
    period_s: float,
    reaction_s: float,
    delay_s: float,
    torque_limit_nm: float,
    counts_per_rev: int,
) -> tuple[Braking, Stop]:
    """The hardest quick stop of a loop that loads the belt of no model in the family beyond the axis' feed force, and its way.

    It comes out of constant speed, or out of the largest acceleration that a motion may have: all that the limits of the axis allow, as
    long as that is no more than ``ACCELERATED_OVER_BRAKED`` times the deceleration.  When even the softest stop tried loads the belt more,
    that one is returned with its force.

    Parameters
    ----------
    family : sequence of Model
        Models that the axis may be.
    cascade : Cascade
    axis : Axis
    speed_m_s : float
        From which it is simulated, and from parts of it: the step at the end of a short ramp comes while the belt still swings from the one
        at its beginning, and along a long ramp a loop has time to catch up.
    position_m : float, m
        Carriage on the axis.
    period_s : float, s
        T of the controller.
    reaction_s : float
        Until the stop is asked for.
    delay_s : float, s
        Of the torque path.
    torque_limit_nm : float, N m, motor shaft
        Of the drive.
    counts_per_rev : int
    """
    limit = axis.limits.feed_force_n or math.inf
    allowed = [rigid_deceleration(axis, model["cart.mass"], torque_limit_nm).value_m_s2 for model in family]

    def simulated(model: Model, speed: float, acceleration: float) -> Stop:
        return _predict_stop(
            model,
            cascade,
            speed,
            deceleration,
            acceleration_m_s2=acceleration,
            position_m=position_m,
            period_s=period_s,
            delay_s=delay_s,
            torque_limit_nm=torque_limit_nm,
            counts_per_rev=counts_per_rev,
        )

    def worst(speed: float) -> Stop:
        steady = [simulated(model, speed, 0.0) for model in family]
        out_of = [simulated(model, speed, min(most, accelerated)) for model, most in zip(family, allowed, strict=True)]
        return Stop(max(stop.way_m for stop in steady), max(stop.belt_force_n for stop in (*steady, *out_of)))

    speeds = [part * speed_m_s for part in SPEED_PARTS]
    for share in SHARES:
        deceleration = share * min(allowed)
        accelerated = min(max(allowed), ACCELERATED_OVER_BRAKED * deceleration)
        found = worst(speed_m_s)
        if found.belt_force_n <= limit:
            stops = {speed: worst(speed) for speed in speeds}
            found = Stop(found.way_m, max(stop.belt_force_n for stop in stops.values()))
            if found.belt_force_n <= limit:
                break
    else:
        stops = {speed: worst(speed) for speed in speeds}
    lag = max(stop.way_m / speed - speed / (2.0 * deceleration) for speed, stop in stops.items())
    return Braking(deceleration, max(lag, 0.0) + reaction_s, reaction_s, acceleration_m_s2=accelerated), found


@dataclass(frozen=True)
class StopReaction:
    """Reaction of a drive that ends in a stop along its ramp: to a stop that is asked for, or to setpoints that stand still.

    Attributes
    ----------
    window_rad, lasting_s : float, motor shaft
        Following error, and how long it must last, that is a fault of the drive; an infinite one is none.
    guard_s : float
        After which silence is noticed at the latest; 0 for a stop that is asked for.
    deceleration_m_s2 : float
        Of the stop that follows, carriage.
    """

    window_rad: float
    lasting_s: float
    guard_s: float
    deceleration_m_s2: float


@dataclass(frozen=True)
class StopOutOfMove:
    """The axis from the last setpoint to rest.

    Attributes
    ----------
    way_m : float
        Carriage, from where it was; infinite where it ran off what its model describes.
    low_m, high_m : float
        Between which the carriage stays meanwhile; infinite likewise.
    belt_force_n : float
        Largest, N; infinite likewise.
    """

    way_m: float
    low_m: float
    high_m: float
    belt_force_n: float

    def __or__(self, other: StopOutOfMove) -> StopOutOfMove:
        """The worse of both in each."""
        return StopOutOfMove(
            max(self.way_m, other.way_m),
            min(self.low_m, other.low_m),
            max(self.high_m, other.high_m),
            max(self.belt_force_n, other.belt_force_n),
        )


#: None, and one that ran off what its model describes.
NO_STOP, OFF_THE_MODEL = StopOutOfMove(0.0, math.inf, -math.inf, 0.0), StopOutOfMove(math.inf, -math.inf, math.inf, math.inf)


@dataclass(frozen=True)
class References:
    """References of a position loop, (n,), one per run of it.

    Attributes
    ----------
    position_rad, speed_rad_s, added_nm : ndarray (n,), motor shaft
    """

    position_rad: Array
    speed_rad_s: Array
    added_nm: Array

    def lost_at(self, at: int, runs: int) -> tuple[Array, Array, Array]:
        """Position, speed and torque added up to run ``at``, 1 or above; then the last stand still for ``runs`` runs."""

        def then_at_rest(values: Array, last: float) -> Array:
            return np.concatenate((values[:at], np.full(runs, last)))

        last = at - 1
        return (
            then_at_rest(self.position_rad, float(self.position_rad[last])),
            then_at_rest(self.speed_rad_s, float(self.speed_rad_s[last])),
            then_at_rest(self.added_nm, float(self.added_nm[last])),
        )


def predict_stop_out_of_move(
    resting: SimulatedPlant, cascade: Cascade, references: References, at: int, drive: LoopDrive, reaction: StopReaction
) -> StopOutOfMove:
    """The axis from the last setpoint to rest.

    Parameters
    ----------
    resting : SimulatedPlant
        Where the axis sets out; it stays there.
    cascade : Cascade
    references : References
        Of the move, for each run of the loop.
    at : int
        Run of the loop with which the setpoints end, at least 1.
    drive : LoopDrive
        Limits and steps of the drive.
    reaction : StopReaction
        Of the drive to setpoints that stay away.

    Raises
    ------
    Refused
        When the carriage leaves what the model describes.
    """
    guard = math.ceil(reaction.guard_s / drive.period_s)
    noticed = guard
    if math.isfinite(reaction.window_rad):
        run = close_loop(resting.copied(), cascade, drive, "position", *references.lost_at(at, guard))
        late = np.abs(references.position_rad[at - 1] - references.position_rad[0] - run.position_rad[at:]) > reaction.window_rad
        beyond = np.flatnonzero(late)
        if len(beyond):
            noticed = min(guard, int(beyond[0]) + math.ceil(reaction.lasting_s / drive.period_s) + 1)
    plant, state, lost = resting.copied(), new_state(), references.lost_at(at, noticed)
    start_rad = float(references.position_rad[0])
    reset_state(state, start_rad)
    waiting = waiting_torque(cascade, drive)
    run = close_loop(plant, cascade, drive, "position", *lost, state=state, waiting_nm=waiting)
    asked = cascade.kpp_1_s * (float(lost[0][-1]) - start_rad - plant.position_rad) + cascade.feedforward.velocity * float(lost[1][-1])
    speed = min(max(measured_speed(state), min(asked, 0.0)), max(asked, 0.0))
    slower = reaction.deceleration_m_s2 / resting.model["transmission.ratio"] * drive.period_s
    runs = math.ceil(abs(speed) / slower) + round(REST_S / drive.period_s)
    ramp = math.copysign(1.0, speed) * np.maximum(abs(speed) - slower * np.arange(1, runs + 1), 0.0)
    place, none = np.full(runs, start_rad + plant.position_rad), np.zeros(runs)
    begin_ramp(state, speed)
    rest = close_loop(plant, cascade, drive, "velocity", place, ramp, none, acceleration_rad_s2=none, state=state, waiting_nm=waiting)
    places = resting.start_m + np.concatenate((run.cart_m[at:], rest.cart_m))
    force = float(np.concatenate((run.belt_force_n[at:], rest.belt_force_n)).max())
    return StopOutOfMove(float(np.abs(places - places[0]).max()), float(places.min()), float(places.max()), force)
