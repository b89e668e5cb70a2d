"""Laws of force, compiled: belt, friction, ripple, torque path.  Each is a plain function of the motion and the vector p."""

from __future__ import annotations

import math

from truth.hidden import layout as at
from truth.hidden.compilation import compiled
from truth.hidden.layout import Array

Two = tuple[float, float]


#: Half the way over which contact builds up, in units of the softness.
CONTACT = 4.0 * math.log(2.0)


@compiled
def contact(x: float) -> Two:
    """Force of a rough contact and its slope: ever more asperities touch, (x + w)²/(4 w) for |x| < w = ``CONTACT``; 0 before, x after."""
    if x <= -CONTACT:
        return 0.0, 0.0
    if x >= CONTACT:
        return x, 1.0
    return (x + CONTACT) ** 2 / (4.0 * CONTACT), (x + CONTACT) / (2.0 * CONTACT)


@compiled
def sagging(x: float) -> Two:
    """What a sagging span gives up and its slope: a hyperbola, (x + √(x² + 4 c²))/2, c = ln 2; sag fades with a power of the tension."""
    root = math.sqrt(x * x + 4.0 * math.log(2.0) ** 2)
    return 0.5 * (x + root), 0.5 * (1.0 + x / root)


@compiled
def play(y: float, p: Array) -> Two:
    """What the loose clamp takes of the deflection y, m, and its slope: y minus a dead zone with smooth contact.

    transmitted = e contact((y - g/2)/e) - e contact((-y - g/2)/e),   g : gap, e : softness.   Without a gap 0, 0.
    """
    gap = 0.5 * p[at.GAP]
    if gap <= 0.0:
        return 0.0, 0.0
    soft = p[at.GAP_SOFT]
    right, left = contact((y - gap) / soft), contact((-y - gap) / soft)
    return y - soft * (right[0] - left[0]), 1.0 - right[1] - left[1]


@compiled
def tension(force: float, p: Array) -> Two:
    """Change of tension of one span that would change it by ``force`` while taut, N, and the share of its stiffness left.

    A span that has lost its preload sags and keeps 1 - share of its stiffness; the corner is a hyperbola.
    """
    share = p[at.SLACK_SHARE]
    if share <= 0.0:
        return force, 1.0
    soft = p[at.SLACK_SOFT]
    lost, slope = sagging(-(force + p[at.PRELOAD]) / soft)
    return force + share * soft * lost, 1.0 - share * slope


@compiled
def spans(x: float, p: Array) -> tuple[float, float, float, float, float, float]:
    """Stiffness (N/m) and damping (N s/m) of the three spans: carriage to motor pulley, to idler, return.

    Where the spans follow the carriage:  k_i = EA/l_i,  d_i = DA/l_i,  l_1 and l_2 changing with share * (x - middle).
    """
    if p[at.SPANS_MOVE] == 0.0:
        return p[at.K1], p[at.K2], p[at.K3], p[at.D1], p[at.D2], p[at.D3]
    moved = p[at.LENGTH_SHARE] * (x - p[at.MIDDLE])
    l1, l2, l3 = p[at.LENGTH1] + moved, p[at.LENGTH2] - moved, p[at.LENGTH3]
    ea, da = p[at.EA], p[at.DA]
    return ea / l1, ea / l2, ea / l3, da / l1, da / l2, da / l3


@compiled
def belt(u: Two, x: Two, e: Two, p: Array) -> tuple[float, float, float, float]:
    """Forces of the belt: back on the motor pulley, on the carriage, on the idler (N), and the speed of a massless idler.

    u, x, e : coordinate (m) and speed (m/s) at the motor pulley, of the carriage and of the idler, along the belt.
    The clamp between belt and carriage may be loose: it rests at the balance of its spans, held off by the gap.
    """
    k1, k2, k3, d1, d2, d3 = spans(x[0], p)
    if p[at.TOPOLOGY] == at.TWO_STRANDS:
        k_return, d_return = k2 * k3 / (k2 + k3), d2 * d3 / (d2 + d3)
        y, rate = u[0] - x[0], u[1] - x[1]
        taken, slope = play(y, p)
        y, rate = y - taken, (1.0 - slope) * rate
        direct, taut_1 = tension(-k1 * y, p)
        back, taut_2 = tension(k_return * y, p)
        force = back - direct + (d1 * taut_1 + d_return * taut_2) * rate
        return force, force, 0.0, 0.0
    clamp, clamp_speed = x
    if p[at.GAP] > 0.0:
        free = (k1 * u[0] + k2 * e[0]) / (k1 + k2)
        free_speed = (d1 * u[1] + d2 * e[1]) / (d1 + d2)
        taken, slope = play(free - x[0], p)
        clamp, clamp_speed = x[0] + taken, x[1] + slope * (free_speed - x[1])
    elastic_1, taut_1 = tension(-k1 * (u[0] - clamp), p)
    elastic_2, taut_2 = tension(k2 * (e[0] - clamp), p)
    elastic_3, taut_3 = tension(k3 * (u[0] - e[0]), p)
    idler_speed = e[1]
    if p[at.TOPOLOGY] == at.LIGHT_IDLER:
        pull = elastic_3 - elastic_2 + d3 * taut_3 * u[1] + d2 * taut_2 * clamp_speed
        idler_speed = pull / (d2 * taut_2 + d3 * taut_3 + p[at.IDLER_DRAG])
    f1 = -elastic_1 + d1 * taut_1 * (u[1] - clamp_speed)
    f2 = elastic_2 + d2 * taut_2 * (idler_speed - clamp_speed)
    f3 = elastic_3 + d3 * taut_3 * (u[1] - idler_speed)
    return f1 + f3, f1 + f2, f3 - f2 - p[at.IDLER_DRAG] * idler_speed, idler_speed


@compiled
def bristle(before: float, way: float, level: float, stiffness: float) -> float:
    """Force of a bristle after a way in one direction:  dF/d(way) = stiffness (1 - F sign(way)/level), solved exactly."""
    end = math.copysign(level, way)
    return end + (before - end) * math.exp(-abs(way) * stiffness / level)


@compiled
def bristle_between(before: float, way: float, begin: float, end: float, stiffness: float) -> float:
    """As :func:`bristle` while the level goes from ``begin`` to ``end`` in proportion to the way."""
    if begin == end:
        return bristle(before, way, end, stiffness)
    sign, ratio = math.copysign(1.0, way), abs(way) * stiffness * 2.0 / (begin + end)
    if ratio < 1e-9:
        return before
    fading = math.exp(-ratio)
    return sign * (end - (end - begin) * (1.0 - fading) / ratio) + (before - sign * begin) * fading


@compiled
def stribeck(speed: float, p: Array) -> float:
    """Share by which the level is higher at low speed, m/s: exponential of any exponent, rational, or hyperbolic secant."""
    ratio = abs(speed) / p[at.STRIBECK_SPEED]
    if ratio > 300.0:
        return 0.0
    if p[at.STRIBECK_SHAPE] == at.EXPONENTIAL:
        return float(p[at.STRIBECK] * math.exp(-(ratio ** p[at.STRIBECK_EXPONENT])))
    if p[at.STRIBECK_SHAPE] == at.RATIONAL:
        return float(p[at.STRIBECK] / (1.0 + ratio ** p[at.STRIBECK_EXPONENT]))
    return float(p[at.STRIBECK] / math.cosh(min(ratio, 50.0)))


@compiled
def tight_spot(x: float, p: Array) -> float:
    """Extra level at a place, N m: a flat top with raised-cosine flanks; without a flat top a raised cosine."""
    off = abs(x - p[at.TIGHT_PLACE])
    if off >= p[at.TIGHT_WIDTH]:
        return 0.0
    top = p[at.TIGHT_WIDTH] - p[at.TIGHT_FLANK]
    if off <= top:
        return float(p[at.TIGHT])
    return float(0.5 * p[at.TIGHT] * (1.0 + math.cos(math.pi * (off - top) / p[at.TIGHT_FLANK])))


@compiled
def motor_level(speed: float, x: float, factor: float, p: Array) -> float:
    """Level of the motor's friction, N m, alike in both directions.   speed : rad/s.   factor : of this sub-step (drift, ageing)."""
    share = 1.0
    if p[at.STRIBECK] > 0.0:
        share += stribeck(p[at.LEVER] * speed, p)
    if p[at.RAIL] != 0.0:
        share += p[at.RAIL] * math.sin(math.tau * x / p[at.RAIL_PITCH] + p[at.RAIL_PHASE])
    level = p[at.COULOMB] * share
    if p[at.TIGHT] > 0.0:
        level += tight_spot(x, p)
    return level * factor


@compiled
def motor_bristle(before: float, way: float, begin: float, end: float, p: Array) -> float:
    """Force of the motor's bristle, N m, after a way in rad.   begin, end : :func:`motor_level` there; each direction has its share."""
    share = 1.0 + p[at.ASYMMETRY] * math.copysign(1.0, way)
    return bristle_between(before, way, begin * share, end * share, p[at.BRISTLE])


@compiled
def warm_factor(t: float, p: Array) -> float:
    """Factor on the viscous friction at session time t: 1 + A times a stretched exponential or a hyperbola."""
    if p[at.WARM] <= 0.0:
        return 1.0
    ratio = t / p[at.WARM_TIME]
    if p[at.WARM_SHAPE] == at.STRETCHED:
        return float(1.0 + p[at.WARM] * math.exp(-(ratio ** p[at.WARM_EXPONENT])))
    return float(1.0 + p[at.WARM] / (1.0 + ratio) ** p[at.WARM_EXPONENT])


@compiled
def level_factor(t: float, age: float, p: Array) -> float:
    """Factor on the friction level that changes slowly: random drift, and the age of the contact (rate and state)."""
    factor = 1.0
    if p[at.DRIFT] != 0.0:
        for i in range(at.DRIFT_SINES):
            factor += p[at.DRIFT + i] * math.sin(p[at.DRIFT_RATE + i] * t + p[at.DRIFT_PHASE + i])
    if p[at.AGEING] > 0.0:
        factor += p[at.AGEING] * math.log1p(age / p[at.AGEING_TIME])
    return max(factor, 0.05)


@compiled
def pulley(angle: float, p: Array) -> Two:
    """Belt position at the motor pulley, m, and its lever, m:  u = R (angle + run-out),  lever = du/dangle.

    R : carriage travel per radian of the motor; the run-out turns with the pulley, behind the gearbox.
    """
    r = p[at.LEVER]
    if p[at.RUNOUT] == 0.0:
        return r * angle, r
    turns = p[at.PULLEY_TURNS]
    one, two = turns * angle + p[at.RUNOUT_PHASE], 2.0 * turns * angle + p[at.RUNOUT_OVAL_PHASE]
    u = r * (angle + p[at.RUNOUT] * math.sin(one) / turns + p[at.RUNOUT_OVAL] * math.sin(two) / turns)
    return u, r * (1.0 + p[at.RUNOUT] * math.cos(one) + 2.0 * p[at.RUNOUT_OVAL] * math.cos(two))


@compiled
def encoder(angle: float, p: Array) -> float:
    """Angle that the encoder shows, rad: a disc that is eccentric and a little oval, read by its lines."""
    disc = angle
    if p[at.DISC] != 0.0:
        disc += p[at.DISC] * math.sin(angle + p[at.DISC_PHASE]) + p[at.DISC_OVAL] * math.sin(2.0 * angle + p[at.DISC_OVAL_PHASE])
    if p[at.LINES] == 0.0:
        return float(disc)
    within = p[at.LINES] * disc
    error = p[at.LINE] * math.sin(within + p[at.LINE_PHASE]) + p[at.LINE_SECOND] * math.sin(2.0 * within + p[at.LINE_SECOND_PHASE])
    return float(disc + error + p[at.LINE_THIRD] * math.sin(3.0 * within + p[at.LINE_THIRD_PHASE]))


@compiled
def shaft_torque(torque: float, angle: float, t: float, p: Array) -> float:
    """Torque at the shaft for the torque inside the motor: resolution, saturation, ripples, supply."""
    if p[at.TORQUE_STEP] > 0.0:
        torque = 0.0 if abs(torque) < p[at.DEAD_BAND] else p[at.TORQUE_STEP] * math.floor(torque / p[at.TORQUE_STEP] + 0.5)
    law = p[at.SATURATION_LAW]
    if law == at.TANH:
        torque = p[at.SATURATION] * math.tanh(torque / p[at.SATURATION])
    elif law == at.ARCTAN:
        torque = p[at.SATURATION] * math.atan(torque / p[at.SATURATION])
    elif law == at.KNEE:
        knee = p[at.SATURATION_KNEE]
        torque = torque / (1.0 + (abs(torque) / p[at.SATURATION]) ** knee) ** (1.0 / knee)
    if p[at.RIPPLE] > 0.0:
        size = p[at.RIPPLE] * (1.0 - p[at.RIPPLE_FADE] * abs(torque))
        torque *= 1.0 + size * math.sin(p[at.RIPPLE_ORDER] * angle + p[at.RIPPLE_PHASE])
    if p[at.COG] > 0.0:
        torque += p[at.COG] * math.sin(p[at.COG_ORDER] * angle + p[at.COG_PHASE])
        torque += p[at.COG_SECOND] * math.sin(p[at.COG_SECOND_ORDER] * angle + p[at.COG_SECOND_PHASE])
    if p[at.TOOTH] > 0.0:
        size = p[at.TOOTH] * (1.0 + p[at.TOOTH_WOBBLE] * math.sin(angle + p[at.TOOTH_WOBBLE_PHASE]))
        torque += size * math.sin(p[at.TOOTH_ORDER] * angle + p[at.TOOTH_PHASE])
    if p[at.SUPPLY] > 0.0:
        size = 1.0 + 0.6 * math.sin(p[at.SUPPLY_RATE] * t)
        torque += size * p[at.SUPPLY] * math.sin(math.tau * 50.0 * t + p[at.SUPPLY_PHASE])
        torque += size * p[at.SUPPLY_SECOND] * math.sin(math.tau * 100.0 * t)
    return torque
