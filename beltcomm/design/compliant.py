"""Feedforward through the compliant model: the motor leads the carriage by the stretch of the belt.

For a carriage that is to follow y(t), the belt has to pull with F and is stretched by s, so the motor has to be at u and give τ:

    F = m_c y'' + d_c y' + F_c sign y' + m_c g sin(tilt) - forces of the carriage's effects
    s = F/c - d_m F'/c²,      u = y + s,      τ = J u''/i_t + i_t (c s + d_m s') + d_v u'/i_t + τ_c sign u' + offset

(the inverse dynamics of an elastic transmission; (2.22), (2.25) solved for the motor).  The belt's stretch changes its slope where the jerk
steps and jumps where friction turns round; both are spread over ``WINDOW_SHARE`` of a period of the resonance, twice, so that the motor
needs no impulse.  At the end the motor keeps the stretch by which the carriage's friction holds it: the carriage, not the motor, is where
it should be.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array
from beltcomm.control import Feedforward, feedforward_torque
from beltcomm.design.feedforward import demand_of_effects, through_path
from beltcomm.effects.tilt import GRAVITY_M_S2
from beltcomm.errors import UsageError
from beltcomm.model import Model
from beltcomm.model.linear import matrices, modes, operating_point
from beltcomm.trajectory import Trajectory

#: Share of a period of the resonance over which the stretch is smoothed, and the fewest samples.
WINDOW_SHARE, FEWEST = 0.5, 3
#: m/s: a slower reference counts as rest; what a drive resolves (1 count/s of 65536 on 78 mm is 1.2 um/s) must not decide the sign.
REST_M_S = 2e-5
#: Hz: below it a mode is the axis moving as a whole.
LOWEST_HZ = 0.5
#: Places of the travel at which the compliance is worked out.
PLACES = 25


@dataclass(frozen=True)
class Leading:
    """Motion of the motor.

    Attributes
    ----------
    trajectory : Trajectory
        u of the module, m along the belt.
    carriage : Trajectory
        y on the same grid, with a rest before it.
    torque_nm : ndarray
        τ, N m at the motor shaft, (n,).
    held_m : float
        Stretch by which friction holds the carriage at the end.
    """

    trajectory: Trajectory
    carriage: Trajectory
    torque_nm: Array
    held_m: float

    @property
    def lead_m(self) -> float:
        """Largest distance of the motor from the carriage."""
        return float(np.max(np.abs(self.trajectory.position_m - self.carriage.position_m)))


def lead_motion(model: Model, carriage: Trajectory, advance_s: float = 0.0, *, friction: bool = True, time_s: float = 0.0) -> Leading:
    """The motor's reference and torque for a motion of the carriage that begins and ends at rest.

    Parameters
    ----------
    model : Model
    carriage : Trajectory
        Motion of the carriage.
    advance_s : float
        By which the torque will be sent ahead; there is as much more rest before the motion.
    friction : bool
        The carriage's Coulomb friction stretches the belt; False: it acts on the motor, as (4.16) has it.
    time_s : float
        Session's clock at the start.

    Raises
    ------
    UsageError
        For a model without a belt.
    """
    if "cart" not in model.base_bodies:
        raise UsageError("the model has no belt that could stretch, so a compliant feedforward says nothing; use nonlinear")
    period = carriage.sample_period_s
    window = _smoothing_window(model, carriage)
    y = with_rest_before(carriage, 2 * window + math.ceil(advance_s / period))
    ratio, inertia, mass = model["transmission.ratio"], _motor_side_inertia(model), _moved_mass(model)
    damping, level = model.get("belt_damping.damping"), model.get("cart_friction.level")
    speed = np.where(np.abs(y.velocity_m_s) > REST_M_S, y.velocity_m_s, 0.0)
    own, at_carriage = (np.array(part) for part in zip(*_effects(model, y, speed, time_s), strict=True))
    held = level * _lasting_sign(speed) if friction else np.zeros(len(speed))
    force = mass * (y.acceleration_m_s2 + GRAVITY_M_S2 * math.sin(model.get("tilt.angle")))
    force = force + model.get("viscous_cart.damping") * speed + held + at_carriage
    soft = _compliance(model, y.position_m)
    stretch = soft * (force - damping * soft * np.gradient(force, period))
    for _ in range(2):
        stretch = _centred_mean(stretch, window)
    place = y.position_m + stretch
    rate = np.gradient(place, period)
    rate = np.where(np.abs(rate) > REST_M_S, rate, 0.0)
    acceleration = np.gradient(rate, period)
    pull = stretch / soft + damping * np.gradient(stretch, period)
    torque = inertia * acceleration / ratio + ratio * pull + model.get("viscous.damping") * rate / ratio
    rubbing = model.get("coulomb.level") + (0.0 if friction else ratio * level)
    torque = torque + rubbing * np.sign(rate) + model.get("constant_offset.torque") + own
    ahead = time_s + y.t_s
    torque = np.array([through_path(model, float(q), float(x), float(t)) for q, x, t in zip(torque, place, ahead, strict=True)])
    return Leading(Trajectory(y.t_s, place, rate, acceleration), y, torque, float(abs(held[-1]) * soft[-1]))


def torque_along(led: Leading, feedforward: Feedforward, ratio: float) -> Array:
    """Torque that the host sends along with the motor's reference, N m at the motor shaft, (n,): τ less the drive's own feedforward (4.16).

    Both ``feedforward.advance_s`` ahead of the reference.

    Parameters
    ----------
    led : Leading
        As of :func:`lead_motion`.
    feedforward : Feedforward
        Of the drive, with its advance.
    ratio : float
        i_t, m/rad.
    """
    path = led.trajectory
    needed = np.interp(path.t_s + feedforward.advance_s, path.t_s, led.torque_nm)
    return np.asarray(needed - feedforward_torque(feedforward, path.velocity_m_s / ratio, path.sample_period_s))


def _compliance(model: Model, places_m: Array) -> Array:
    """Compliance of the carriage at places with the motor locked, 1/c, m/N, (n,), linear between ``PLACES`` places; gaps and slack strands
    are taken as closed.
    """
    low, high = float(np.min(places_m)), float(np.max(places_m))
    grid = np.linspace(low, high, PLACES) if high > low else np.array([low])
    soft = []
    for place in grid:
        held = matrices(model, operating_point(model, float(place), 1.0)).hold(("motor",))
        cart = held.bodies.index("cart")
        soft.append(float(np.linalg.inv(held.K)[cart, cart]))
    return np.interp(places_m, grid, soft)


def _smoothing_window(model: Model, carriage: Trajectory) -> int:
    """Samples over which the stretch is averaged, odd: near ``WINDOW_SHARE`` of a period of the lowest resonance in the middle of the
    motion.
    """
    middle = 0.5 * float(np.min(carriage.position_m) + np.max(carriage.position_m))
    lowest = min(m.freq_hz for m in modes(model, operating_point(model, middle, 1.0)) if m.freq_hz > LOWEST_HZ)
    half = round(0.5 * (WINDOW_SHARE / (lowest * carriage.sample_period_s) - 1.0))
    return max(FEWEST, 2 * half + 1)


def _centred_mean(values: Array, window: int) -> Array:
    """Centred mean over an odd window of samples, (n,); the ends are continued."""
    beside = window // 2
    return np.asarray(np.convolve(np.pad(values, beside, mode="edge"), np.ones(window) / window, "valid"))


def with_rest_before(path: Trajectory, samples: int) -> Trajectory:
    """The motion with so many samples of rest before it.

    Parameters
    ----------
    path : Trajectory
        Of the carriage.
    samples : int
        Of rest at its first place.

    Returns
    -------
    Trajectory
        Its times begin at 0.
    """
    still = np.zeros(samples)
    return Trajectory(
        path.sample_period_s * np.arange(len(path.t_s) + samples, dtype=np.float64),
        np.concatenate((np.full(samples, path.position_m[0]), path.position_m)),
        np.concatenate((still, path.velocity_m_s)),
        np.concatenate((still, path.acceleration_m_s2)),
    )


def _moved_mass(model: Model) -> float:
    """Mass of everything that moves along the belt, kg."""
    return sum(model[name] for name, body in model.bodies() if not body.rotary)


def _motor_side_inertia(model: Model) -> float:
    """Inertia of everything that turns with the motor, kg m² at the motor shaft."""
    return sum(model[name] for name, body in model.bodies() if body.rotary)


def _lasting_sign(speed: Array) -> Array:
    """Sign of the speed, at rest that of the motion before; 0 before the first."""
    moving = speed != 0.0
    last = np.maximum.accumulate(np.where(moving, np.arange(len(speed)), -1))
    return np.where(last >= 0, np.sign(speed[np.maximum(last, 0)]), 0.0)


def _effects(model: Model, path: Trajectory, speed: Array, time_s: float) -> list[tuple[float, float]]:
    """Per sample: torque at the motor, N m, and force at the carriage, N, that effects beyond (4.16) need."""
    return [
        demand_of_effects(model, float(x), float(v), time_s + float(t)) for x, v, t in zip(path.position_m, speed, path.t_s, strict=True)
    ]
