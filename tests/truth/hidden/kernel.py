"""Equations of motion and their integration: Runge-Kutta of order four in equal sub-steps.

What has a memory of the path (bristles, sliders) is an exact function of the way since the start of the sub-step, so it can
stand inside the Runge-Kutta stages although its own rate is far beyond the step.  The torque path (dead time, lag) is
solved exactly in time.
"""

from __future__ import annotations

import math

from truth.hidden import laws
from truth.hidden import layout as at
from truth.hidden.compilation import compiled
from truth.hidden.layout import Array

#: What holds over a sub-step: factor on the viscous friction, factor on the friction level, that level at the start, N m.
Slow = tuple[float, float, float]
Nine = tuple[float, float, float, float, float, float, float, float, float]


@compiled
def payload_force(way: float, rate: float, p: Array) -> float:
    """Force of the second mass on the carriage, N.   way, rate : of the second mass from the carriage, m and m/s.

    On a spring that is stretched sideways, too, and hardens a little, y √(1 + 2 h y²); or loose between two stops (Hunt-Crossley
    contact) on a greasy plate.
    """
    if p[at.LOOSE] > 0.0:
        force = p[at.D_LOOSE] * rate
        depth = abs(way) - p[at.LOOSE]
        if depth > 0.0:
            inward = math.copysign(rate, rate * way)
            force += math.copysign(max(0.0, p[at.K_IMPACT] * depth * (1.0 + p[at.LOSS_IMPACT] * inward)), way)
        return force
    return p[at.K_PAYLOAD] * way * math.sqrt(1.0 + 2.0 * p[at.HARDENING] * way * way) + p[at.D_PAYLOAD] * rate


@compiled
def cart_forces(x: float, v: float, way: float, s: Array, p: Array) -> float:
    """Forces on the carriage other than belt and second mass, N.   way : m, since the start of the sub-step."""
    force = p[at.M] * p[at.GRAVITY] - p[at.DRAG] * v
    if p[at.AIR] > 0.0:
        force -= math.copysign(p[at.AIR] * abs(v) ** p[at.AIR_EXPONENT], v)
    if p[at.CABLE] > 0.0:
        force -= p[at.CABLE] * p[at.CABLE_LENGTH] * math.tanh((x - p[at.CABLE_PLACE]) / p[at.CABLE_LENGTH])
    if p[at.COULOMB_CART] > 0.0:
        force -= laws.bristle(s[at.Z_CART], way, p[at.COULOMB_CART], p[at.BRISTLE_CART])
    if p[at.GREASE] > 0.0:
        force -= p[at.GREASE] * ((x - p[at.GREASE_PLACE]) / p[at.GREASE_LENGTH]) ** 2 * v
    if p[at.HYSTERESIS] > 0.0:
        force -= p[at.CUBIC] * (x - p[at.CUBIC_PLACE]) ** 3
        force -= laws.bristle(s[at.Z_CABLE], way, p[at.HYSTERESIS], p[at.HYSTERESIS] / p[at.HYSTERESIS_LENGTH])
    return force


@compiled
def parallel_belt(y: float, creep: float, y_start: float, s: Array, p: Array) -> float:
    """Force of what lies beside the belt's springs, N: sliders that slip, and a spring behind a dashpot."""
    force = p[at.K_CREEP] * (y - creep)
    if p[at.SLIDER_FORCE] > 0.0:
        for i in range(at.SLIDERS):
            limit = p[at.SLIDER_FORCE + i]
            force += min(max(s[at.Z_SLIDER + i] + p[at.SLIDER_STIFFNESS + i] * (y - y_start), -limit), limit)
    return force


@compiled
def rates(q: Nine, torque: float, t: float, slow: Slow, s: Array, p: Array) -> Nine:
    """Derivatives of the nine states.   s : state at the start of the sub-step, for what remembers the way since then."""
    warm, factor, begin = slow
    angle, w, x, v, e, ev, x2, v2, creep = q
    u, lever = laws.pulley(angle, p)
    on_pulley, on_cart, on_idler, idler_speed = laws.belt((u, lever * w), (x, v), (e, ev), p)
    if p[at.K_CREEP] > 0.0 or p[at.SLIDER_FORCE] > 0.0:
        extra = parallel_belt(u - x, creep, laws.pulley(s[at.ANGLE], p)[0] - s[at.CART], s, p)
        on_pulley += extra
        on_cart += extra
    way = angle - s[at.ANGLE]
    level = laws.motor_level(w, x, factor, p)
    z = laws.motor_bristle(s[at.Z_MOTOR], way, begin, level, p)
    friction = z + p[at.VISCOUS] * warm * w
    if p[at.MICRO] > 0.0 and abs(w) < 4.0 * p[at.MICRO_SPEED]:
        sided = level * (1.0 + p[at.ASYMMETRY] * math.copysign(1.0, w))
        friction += p[at.MICRO] * math.exp(-((w / p[at.MICRO_SPEED]) ** 2)) * w * (1.0 - z * math.copysign(1.0, w) / sided)
    acceleration = (laws.shaft_torque(torque, angle, t, p) - friction - lever * on_pulley) / p[at.J]
    force = on_cart + cart_forces(x, v, x - s[at.CART], s, p)
    second = 0.0
    if p[at.M2] > 0.0:
        between = payload_force(x2 - x, v2 - v, p)
        force += between
        second = p[at.GRAVITY] - between / p[at.M2]
    e_rate, idler = idler_speed, 0.0
    if p[at.TOPOLOGY] == at.HEAVY_IDLER:
        idler = on_idler / p[at.ME]
    creep_rate = (u - x - creep) / p[at.CREEP_TIME] if p[at.K_CREEP] > 0.0 else 0.0
    return w, acceleration, v, force / p[at.M], e_rate, idler, v2, second, creep_rate


@compiled
def along(q: Nine, h: float, r: Nine) -> Nine:
    """q + h r."""
    return (
        q[0] + h * r[0],
        q[1] + h * r[1],
        q[2] + h * r[2],
        q[3] + h * r[3],
        q[4] + h * r[4],
        q[5] + h * r[5],
        q[6] + h * r[6],
        q[7] + h * r[7],
        q[8] + h * r[8],
    )


@compiled
def lagged(drive: float, after: float, s: Array, p: Array) -> tuple[float, float]:
    """The two lags a time after the sub-step began while ``drive`` is held: exact for two different time constants."""
    slow, fast = p[at.LAG], p[at.LAG_SECOND]
    if slow <= 0.0:
        return drive, drive
    first = (s[at.LAG_1] - drive) * math.exp(-after / slow)
    coupling = (s[at.LAG_1] - drive) * slow / (slow - fast)
    second = (s[at.LAG_2] - drive - coupling) * math.exp(-after / fast) + coupling * math.exp(-after / slow)
    return drive + first, drive + second


@compiled
def burst(t: float, bursts: Array) -> float:
    """Load torque of the burst that acts at t, N m: a half sine.   bursts : (n, 3), start s, length s, height N m."""
    for i in range(bursts.shape[0]):
        since = t - bursts[i, 0]
        if 0.0 <= since < bursts[i, 1]:
            return float(bursts[i, 2] * math.sin(math.pi * since / bursts[i, 1]))
    return 0.0


@compiled
def remember(q: Nine, h: float, slow: Slow, s: Array, p: Array) -> None:
    """Move everything with a memory to the end of the sub-step, then the state itself."""
    way, cart_way = q[0] - s[at.ANGLE], q[2] - s[at.CART]
    level = laws.motor_level(q[1], q[2], slow[1], p)
    s[at.Z_MOTOR] = laws.motor_bristle(s[at.Z_MOTOR], way, slow[2], level, p)
    if p[at.COULOMB_CART] > 0.0:
        s[at.Z_CART] = laws.bristle(s[at.Z_CART], cart_way, p[at.COULOMB_CART], p[at.BRISTLE_CART])
    if p[at.HYSTERESIS] > 0.0:
        s[at.Z_CABLE] = laws.bristle(s[at.Z_CABLE], cart_way, p[at.HYSTERESIS], p[at.HYSTERESIS] / p[at.HYSTERESIS_LENGTH])
    if p[at.SLIDER_FORCE] > 0.0:
        stretched = laws.pulley(q[0], p)[0] - q[2] - laws.pulley(s[at.ANGLE], p)[0] + s[at.CART]
        for i in range(at.SLIDERS):
            limit = p[at.SLIDER_FORCE + i]
            s[at.Z_SLIDER + i] = min(max(s[at.Z_SLIDER + i] + p[at.SLIDER_STIFFNESS + i] * stretched, -limit), limit)
    if p[at.AGEING] > 0.0:
        speed = abs(cart_way) / h
        if speed * h < 1e-6 * p[at.AGEING_LENGTH]:
            s[at.AGE] += h
        else:
            steady = p[at.AGEING_LENGTH] / speed
            s[at.AGE] = steady + (s[at.AGE] - steady) * math.exp(-speed * h / p[at.AGEING_LENGTH])
    for i in range(9):
        s[i] = q[i]


@compiled
def attempt(s: Array, p: Array, bursts: Array, torque: float, slope: float, h: float, slow: Slow) -> tuple[Nine, float, float]:
    """One Runge-Kutta step of length h from the state s, which stays as it is.   Returns the nine states and the two lags.

    torque, slope : at the start of the step, N m, and N m/s.
    """
    t = s[at.TIME]
    start = (s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7], s[8])
    stage, end, lag_1, lag_2 = start, start, torque, torque
    for i in range(4):  # a loop, because it is compiled once and not four times
        after = 0.0 if i == 0 else h if i == 3 else 0.5 * h
        if p[at.LAG] > 0.0:
            lag_1, lag_2 = lagged(torque, after, s, p)
        else:
            lag_2 = torque + slope * after
        load = burst(t + after, bursts) if bursts.shape[0] > 0 else 0.0
        r = rates(stage, lag_2 + load, t + after, slow, s, p)
        end = along(end, h / 6.0 if i == 0 or i == 3 else h / 3.0, r)
        stage = along(start, h if i == 2 else 0.5 * h, r)
    return end, lag_1, lag_2


@compiled
def advance(s: Array, p: Array, bursts: Array, torque: float, slope: float, duration: float, longest: float) -> None:
    """Let a torque at the input of the torque path behind its dead time act for ``duration``; changes s in place.

    A sub-step in which the motor reverses (or the carriage, where it has a bristle) is cut there: the friction turns round.
    s : (STATES,).   p : (PARAMETERS,).   torque : N m, mean.   slope : N m/s, 0 for a torque that is held; the lags of
    the path see the mean of each sub-step.   duration, longest sub-step : s.
    """
    pieces = math.ceil(duration / longest - 1e-6)
    since = -0.5 * duration
    for _ in range(pieces):
        left, cuts = duration / pieces, 0
        while left > 0.0:
            h, body = left, at.SPEED
            low, high, v_low, v_high = 0.0, left, 0.0, 0.0
            factor = laws.level_factor(s[at.TIME], s[at.AGE], p)
            slow = (laws.warm_factor(s[at.TIME], p), factor, laws.motor_level(s[at.SPEED], s[at.CART], factor, p))
            for trial in range(4):  # the first over all that is left; the others close in on a reversal (false position)
                q, lag_1, lag_2 = attempt(s, p, bursts, torque + slope * since, slope, h, slow)
                if trial == 0:
                    if s[body] * q[body] >= 0.0 and (p[at.COULOMB_CART] > 0.0 or p[at.HYSTERESIS] > 0.0):
                        body = at.CART_SPEED
                    if s[body] * q[body] >= 0.0 or cuts == 2:
                        break
                    v_low, v_high = s[body], q[body]
                elif v_low * q[body] > 0.0:
                    low, v_low = h, q[body]
                else:
                    high, v_high = h, q[body]
                if trial < 3:
                    h = low + (high - low) * v_low / (v_low - v_high)
            remember(q, h, slow, s, p)
            s[at.LAG_1], s[at.LAG_2] = lag_1, lag_2
            s[at.TIME] += h
            since += h
            left -= h
            cuts += 1
