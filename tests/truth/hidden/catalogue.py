"""The 24 effects of the catalogue, drawn at random, in forms of their own.

Each function takes the random numbers, the healthy machine, the strength (1: the ranges of the method sheet, section 8) and
the vector p to change, and returns the parameters that were drawn.  Its docstring is the form.  At strength 0 every one is
the healthy machine.  Sizes are those of the method sheet's machine; ``Base.scale`` makes them suit another one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from truth.hidden import layout as at
from truth.hidden.layout import Array
from truth.hidden.machines import Base, set_micro_slip, set_spans

Draw = Callable[[np.random.Generator, Base, float, Array], Mapping[str, Any]]
STANDARD_GRAVITY_M_S2 = 9.80665


def phase(rng: np.random.Generator) -> float:
    """A random angle, rad."""
    return float(rng.uniform(0.0, math.tau))


def order(rng: np.random.Generator, base: Base) -> int:
    """A ripple order, 6 to 36, never that of the teeth."""
    drawn = int(rng.integers(6, 36))
    return drawn if drawn < base.teeth / base.gear - 0.5 else drawn + 1


def belt_damping(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """What every machine has; the examiner hides it by starting from a model without."""
    return {"damping_n_s_m": base.belt_damping_n_s_m}


def end_pulley(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """Idler with mass between two unlike springs (catalogue: equal ones), with a bearing that brakes it.

    Return share alpha of the stiffness; the spring at the carriage has 35 to 65 % of the compliance of the return.
    0.3 to 0.9 kg; in the family ``wide`` 3 to 10 % of the carriage.
    """
    low, high = (0.03 * base.mass_kg, 0.1 * base.mass_kg) if base.family == "wide" else (0.3, 0.9)
    mass, alpha, idler_at = strength * rng.uniform(low, high), rng.uniform(0.2, 0.35), rng.uniform(0.35, 0.65)
    drag = rng.uniform(0.5, 3.0) * base.scale.force / base.scale.speed
    set_spans(p, base.stiffness_n_m, base.belt_damping_n_s_m, alpha, idler_at)
    p[at.ME], p[at.IDLER_DRAG] = mass, drag * strength
    p[at.TOPOLOGY] = at.HEAVY_IDLER if mass > 1e-4 else at.LIGHT_IDLER
    return {"mass_kg": mass, "alpha": alpha, "idler_at": idler_at, "drag_n_s_m": drag * strength}


def stiffness_position(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """Three spans over an idler without mass but with a bearing (catalogue: one spring k(x)); damping follows the lengths too.

    Share c of the compliance of each span follows its length, the rest (teeth, clamp) does not: l = l_mid + c (x - x_mid).
    """
    share, distance = strength * rng.uniform(0.5, 1.0), base.pulley_distance_m * rng.uniform(0.97, 1.03)
    offset, drag = base.driven_side_offset_m * rng.uniform(0.8, 1.25), rng.uniform(0.5, 3.0)
    drag *= base.scale.force / base.scale.speed
    l1 = offset + 0.5 * base.stroke_m
    l2 = distance - l1
    whole = 1.0 / l1 + 1.0 / (l2 + distance)
    p[at.SPANS_MOVE], p[at.LENGTH_SHARE], p[at.MIDDLE] = 1.0, share, 0.5 * base.stroke_m
    p[at.LENGTH1], p[at.LENGTH2], p[at.LENGTH3] = l1, l2, distance
    p[at.EA], p[at.DA] = base.stiffness_n_m / whole, base.belt_damping_n_s_m / whole
    if p[at.GAP] == 0.0 and p[at.TOPOLOGY] != at.HEAVY_IDLER:
        p[at.TOPOLOGY], p[at.IDLER_DRAG] = at.LIGHT_IDLER, drag * strength
    return {"share": share, "pulley_distance_m": distance, "offset_m": offset, "drag_n_s_m": float(p[at.IDLER_DRAG])}


def stribeck(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """LuGre level with exp(-(v/vs)^n), n 0.8 to 2, or 1/(1 + (v/vs)^2), or sech(v/vs) (catalogue: exp(-(v/vs)^2))."""
    shape = int(rng.choice([at.EXPONENTIAL, at.EXPONENTIAL, at.RATIONAL, at.SECH]))
    exponent = rng.uniform(0.8, 2.0) if shape == at.EXPONENTIAL else 2.0
    rise, speed = strength * rng.uniform(0.3, 0.7), rng.uniform(0.01, 0.06) * base.scale.length
    p[at.STRIBECK], p[at.STRIBECK_SPEED], p[at.STRIBECK_EXPONENT], p[at.STRIBECK_SHAPE] = rise, speed, exponent, shape
    return {"rise_nm": rise * base.coulomb_nm, "speed_m_s": speed, "exponent": exponent, "shape": ["exp", "rational", "sech"][shape]}


def coulomb_asymmetry(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """Bristle levels (1 + a) Fc forward, (1 - a) Fc back (catalogue: a constant torque; same while sliding, not at rest)."""
    share = strength * rng.uniform(0.1, 0.3) * rng.choice([-1.0, 1.0])
    p[at.ASYMMETRY] = share
    return {"share": share, "offset_nm": share * base.coulomb_nm}


def tilt(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """Gravity on every mass on the carriage (catalogue: a constant torque at the motor)."""
    most = 0.5 * STANDARD_GRAVITY_M_S2 * base.mass_kg * base.radius_m  # 30 degrees
    torque = strength * min(rng.uniform(0.01, 0.05) * base.scale.torque, most) * rng.choice([-1.0, 1.0])
    p[at.GRAVITY] = -torque / (base.mass_kg * base.radius_m)
    return {"offset_nm": torque, "angle_rad": math.asin(-p[at.GRAVITY] / STANDARD_GRAVITY_M_S2)}


def quadratic_drag(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """c |v|^n on the carriage, n 1.8 to 2.2 (catalogue: n = 2 at the motor angle)."""
    p[at.AIR], p[at.AIR_EXPONENT] = strength * rng.uniform(1.5, 4.0), rng.uniform(1.8, 2.2)
    p[at.AIR] *= base.scale.force / base.scale.speed**2
    return {"drag_n_at_1_m_s": float(p[at.AIR]), "exponent": float(p[at.AIR_EXPONENT])}


def friction_position(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """Trapezoid with rounded flanks or a raised cosine (catalogue: Gaussian), by the place of the carriage."""
    width = rng.uniform(0.02, 0.08) * base.scale.width
    flat = rng.random() < 0.5
    half = width * (1.1 if flat else 1.7)  # base width of the shape that has the Gaussian's area
    flank = half * rng.uniform(0.25, 0.6) if flat else half
    place = base.stroke_m * rng.uniform(0.15, 0.85)
    p[at.TIGHT], p[at.TIGHT_PLACE] = strength * rng.uniform(0.25, 0.6) * base.coulomb_nm, place
    p[at.TIGHT_WIDTH], p[at.TIGHT_FLANK] = half, flank
    return {"rise_nm": float(p[at.TIGHT]), "place_m": place, "half_width_m": half, "flank_m": flank}


def presliding(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """LuGre bristle of 30 to 100 um with micro-damping (catalogue: Dahl).   At strength s the way is 1.3 um + (L - 1.3) s^0.4."""
    full, damping = rng.uniform(30e-6, 100e-6) * base.scale.length, rng.uniform(0.05, 0.3)
    way = base.micro_slip_m + (full - base.micro_slip_m) * strength**0.4
    damping = base.micro_damping + (damping - base.micro_damping) * strength**0.4
    set_micro_slip(p, base, way, damping)
    return {"way_m": way, "damping_ratio": damping}


def warmup(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """Stretched exponential exp(-(t/T)^0.75..0.95) or hyperbola (1 + t/T)^-1.5..2.5 (catalogue: exp(-t/T))."""
    shape = int(rng.integers(0, 2))
    exponent, time = (rng.uniform(0.75, 0.95), 1.0) if shape == at.STRETCHED else (rng.uniform(1.5, 2.5), 1.6)
    p[at.WARM], p[at.WARM_TIME] = strength * rng.uniform(0.5, 1.0), time * rng.uniform(25.0, 120.0)
    p[at.WARM_EXPONENT], p[at.WARM_SHAPE] = exponent, shape
    return {"rise": float(p[at.WARM]), "time_s": float(p[at.WARM_TIME]), "exponent": exponent, "shape": ["stretched", "hyperbolic"][shape]}


def cable_chain(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """c L tanh((x - x0)/L), L 0.8 to 1.5 strokes: a chain that softens (catalogue: straight line)."""
    p[at.CABLE], p[at.CABLE_PLACE] = strength * rng.uniform(5.0, 15.0), base.stroke_m * rng.uniform(0.2, 0.8)
    p[at.CABLE] *= base.scale.force / base.scale.width
    p[at.CABLE_LENGTH] = base.stroke_m * rng.uniform(0.8, 1.5)
    return {"stiffness_n_m": float(p[at.CABLE]), "place_m": float(p[at.CABLE_PLACE]), "length_m": float(p[at.CABLE_LENGTH])}


def cogging(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """A sin(N angle + p) with 5 to 15 % of its second harmonic (catalogue: one sine)."""
    n, size = order(rng, base), strength * rng.uniform(0.015, 0.040) * base.scale.torque
    p[at.COG], p[at.COG_ORDER], p[at.COG_PHASE] = size, n, phase(rng)
    p[at.COG_SECOND], p[at.COG_SECOND_ORDER], p[at.COG_SECOND_PHASE] = size * rng.uniform(0.05, 0.15), 2 * n, phase(rng)
    return {"amplitude_nm": size, "order": n, "second_harmonic_nm": float(p[at.COG_SECOND])}


def torque_ripple(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """torque (1 + A sin(N angle + p)), A falling by 2 to 5 % per N m (catalogue: A constant)."""
    n = order(rng, base)
    p[at.RIPPLE], p[at.RIPPLE_ORDER], p[at.RIPPLE_PHASE] = strength * rng.uniform(0.04, 0.10), n, phase(rng)
    p[at.RIPPLE_FADE] = rng.uniform(0.02, 0.05) / base.scale.torque
    return {"share": float(p[at.RIPPLE]), "order": n, "fade_per_nm": float(p[at.RIPPLE_FADE])}


def tooth_ripple(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """A sin(26 angle + p), 26 teeth over the gear, whose size goes by 5 to 12 % once per revolution (catalogue: A constant)."""
    p[at.TOOTH], p[at.TOOTH_ORDER], p[at.TOOTH_PHASE] = strength * rng.uniform(0.015, 0.040), base.teeth / base.gear, phase(rng)
    p[at.TOOTH] *= base.scale.torque
    p[at.TOOTH_WOBBLE], p[at.TOOTH_WOBBLE_PHASE] = rng.uniform(0.05, 0.12), phase(rng)
    return {"amplitude_nm": float(p[at.TOOTH]), "order": float(p[at.TOOTH_ORDER]), "wobble": float(p[at.TOOTH_WOBBLE])}


def pulley_eccentricity(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """u = R (angle + e sin(angle + p) + e2 sin(2 angle + p2)), e2 2 to 5 % of e: also a little oval (catalogue: e2 = 0)."""
    p[at.RUNOUT], p[at.RUNOUT_PHASE] = strength * rng.uniform(0.008, 0.025), phase(rng)
    p[at.RUNOUT_OVAL], p[at.RUNOUT_OVAL_PHASE] = p[at.RUNOUT] * rng.uniform(0.02, 0.05), phase(rng)
    return {"share": float(p[at.RUNOUT]), "run_out_m": float(p[at.RUNOUT]) * base.radius_m}


def encoder_eccentricity(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """shown = angle + e sin(angle + p) + e2 sin(2 angle + p2), e2 2 to 6 % of e (catalogue: of the shown angle, e2 = 0)."""
    p[at.DISC], p[at.DISC_PHASE] = strength * rng.uniform(2e-3, 8e-3), phase(rng)
    p[at.DISC_OVAL], p[at.DISC_OVAL_PHASE] = p[at.DISC] * rng.uniform(0.02, 0.06), phase(rng)
    return {"amplitude_rad": float(p[at.DISC])}


def encoder_interpolation(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """Error of the disc's true angle once, twice and three times per line (catalogue: of the shown angle, once and twice).

    512 to 2048 lines; once per line 20 to 60 urad + 3 to 6 % of a radian of the line, twice half of that or less, three times 3 to 10 %.
    """
    lines = int(rng.choice([512, 1000, 1024, 2000, 2048]))
    once = strength * (rng.uniform(2e-5, 6e-5) + rng.uniform(0.03, 0.06) / lines)
    second, third = once * rng.uniform(0.2, 0.5), once * rng.uniform(0.03, 0.1)
    p[at.LINES], p[at.LINE], p[at.LINE_PHASE] = lines, once, phase(rng)
    p[at.LINE_SECOND], p[at.LINE_SECOND_PHASE] = second, phase(rng)
    p[at.LINE_THIRD], p[at.LINE_THIRD_PHASE] = third, phase(rng)
    return {"lines": lines, "amplitude_rad": once, "second_rad": second, "third_rad": third}


def backlash(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """Loose clamp, rough contact whose force grows as a square at first (catalogue: ln(1 + e^x)), 2 to 5 % of the gap."""
    gap, soft = strength * rng.uniform(40e-6, 150e-6), rng.uniform(0.02, 0.05)
    p[at.GAP], p[at.GAP_SOFT] = gap, max(soft * gap, 1e-7)
    if p[at.TOPOLOGY] == at.LIGHT_IDLER:  # the pair with stiffness_position: one spring that follows the carriage
        p[at.TOPOLOGY] = at.TWO_STRANDS
    return {"gap_m": gap, "softness_m": float(p[at.GAP_SOFT])}


def belt_slack(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """A strand that lost its preload sags and keeps 1 - strength of its stiffness, over a hyperbola (catalogue: ln(1 + e^x)).

    Unlike strands: the two directions differ. The preload is such that the mean knee lies at
    25 to 55 % of the largest belt force.
    """
    largest = min(base.peak_torque_nm / base.radius_m, base.belt_force_limit_n)
    share_direct, knee = rng.uniform(0.42, 0.58), rng.uniform(0.25, 0.55) * largest
    if p[at.TOPOLOGY] == at.TWO_STRANDS and p[at.SPANS_MOVE] == 0.0:
        set_spans(p, base.stiffness_n_m, base.belt_damping_n_s_m, 1.0 - share_direct)
    p[at.PRELOAD], p[at.SLACK_SHARE] = 0.5 * knee, strength
    p[at.SLACK_SOFT] = rng.uniform(0.04, 0.10) * p[at.PRELOAD]
    return {"knee_n": knee, "preload_n": float(p[at.PRELOAD]), "stiffness_left": 1.0 - 0.5 * strength, "direct_share": share_direct}


def payload_mode(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """Second mass on a spring that hardens by 1 to 4 % at 1 mm, later less (catalogue: cubic), damping ratio 1 to 5 %."""
    mass = strength * rng.uniform(0.2, 0.8) * base.mass_kg
    slowest = min(5.0, 0.4 * base.antiresonance_hz)
    frequency = slowest * (0.75 * base.antiresonance_hz / slowest) ** rng.uniform(0.0, 1.0)
    ratio = rng.uniform(0.01, 0.05)
    stiffness = mass * (math.tau * frequency) ** 2
    p[at.M2], p[at.K_PAYLOAD], p[at.D_PAYLOAD] = mass, stiffness, 2.0 * ratio * mass * math.tau * frequency
    p[at.HARDENING] = rng.uniform(0.01, 0.04) / 1e-3**2 * min(1.0, (frequency / 25.0) ** 4)
    return {"mass_kg": mass, "frequency_hz": frequency, "damping_ratio": ratio, "stiffness_n_m": stiffness}


def torque_saturation(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """a tanh(torque/a), a atan(torque/a) or torque/(1 + (torque/a)^n)^(1/n), n 2.5 to 4 (catalogue: cubic), same loss at peak."""
    loss, law = strength * rng.uniform(0.08, 0.25), int(rng.integers(at.TANH, at.KNEE + 1))
    knee = rng.uniform(2.5, 4.0)
    if loss > 0.0:
        p[at.SATURATION_LAW], p[at.SATURATION_KNEE], p[at.SATURATION] = law, knee, saturation_scale(law, loss, knee, base.peak_torque_nm)
    return {"loss_at_peak": loss, "law": ["", "tanh", "arctan", "knee"][law], "knee": knee}


def saturation_scale(law: int, loss: float, knee: float, peak_nm: float) -> float:
    """The torque a at which a law of saturation loses ``loss`` of the peak torque, N m."""
    x = peak_nm
    if law == at.KNEE:
        return float(x / ((1.0 - loss) ** -knee - 1.0) ** (1.0 / knee))
    function = math.tanh if law == at.TANH else math.atan
    low, high = 1e-3 * x, 1e6 * x
    for _ in range(200):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if middle * function(x / middle) < (1.0 - loss) * x else (low, middle)
    return high


def dead_time(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """The torque acts later than reported, by any fraction of the sample (as in the catalogue: there is no other form)."""
    p[at.DEAD_TIME] = strength * rng.uniform(0.4e-3, 1.2e-3)
    return {"time_s": float(p[at.DEAD_TIME])}


def current_lag(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """Two lags in a row, 5 to 12 % of the time in the second (catalogue: one)."""
    time, second = strength * rng.uniform(0.4e-3, 1.2e-3), rng.uniform(0.05, 0.12)
    p[at.LAG], p[at.LAG_SECOND] = (1.0 - second) * time, second * time
    return {"time_s": time, "second_share": second}


def cart_friction(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """A share of the friction moves to a bristle at the carriage, 1 to 4 um long (catalogue: same bristle as the motor's)."""
    share, way = strength * rng.uniform(0.4, 0.8), rng.uniform(1e-6, 4e-6)
    p[at.COULOMB_CART] = share * base.coulomb_nm / base.radius_m
    p[at.BRISTLE_CART] = p[at.COULOMB_CART] / way
    p[at.COULOMB] *= 1.0 - share
    p[at.BRISTLE] *= 1.0 - share
    return {"share": share, "coulomb_cart_n": float(p[at.COULOMB_CART]), "way_m": way}


EFFECTS: Final[Mapping[str, Draw]] = {
    draw.__name__: draw
    for draw in (
        belt_damping,
        end_pulley,
        stiffness_position,
        stribeck,
        coulomb_asymmetry,
        tilt,
        quadratic_drag,
        friction_position,
        presliding,
        warmup,
        cable_chain,
        cogging,
        torque_ripple,
        tooth_ripple,
        pulley_eccentricity,
        encoder_eccentricity,
        encoder_interpolation,
        backlash,
        belt_slack,
        payload_mode,
        torque_saturation,
        dead_time,
        current_lag,
        cart_friction,
    )
}
