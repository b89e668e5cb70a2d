"""The six orders of the friction measurement (3.6, figure 3.10) on a simulated axis that warms up, wears in and is loaded."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.control import Cascade, CascadeStructure, Feedforward
from beltcomm.identify.friction import FrictionFit, Plateau, find_plateaus, fit_friction
from beltcomm.model import Model, load_plant
from beltcomm.thesis.closed_loop import COUNTS, DELAY_S, PEAK_NM, PERIOD_S, gains
from beltcomm.trajectory import Trajectory, constant_speed_strokes, ramp_length_m
from beltcomm.verify import Loop, predict_move

#: (A.1), m/s: the arbitrary sequence of order III; sorted it is that of I, backwards that of II.
SHUFFLED = (
    2, 0.1, 0.01, 0.5, 1.9, 1, 0.001, 0.03, 0.7, 0.002, 0.4, 1.8, 0.02, 0.09, 1.7, 1.1, 0.003, 0.009, 0.8, 1.6, 0.04, 0.004, 0.9, 1.2,
    0.005, 1.4, 0.07, 0.6, 0.008, 0.3, 1.5, 0.006, 1.3, 0.06, 0.007, 0.2, 0.08, 0.05,
)  # fmt: skip
REPEATS = 10
FROM_M, TO_M, REST_S, RUN_IN_S, LONGEST_S = 0.03, 0.57, 0.1, 0.2, 0.6
#: Ramps that the belt bears, bare and with 11.2 kg: 45 m/s² times 0.96 kg, 7 m/s² times 13.44 kg.
BARE, LOADED = TrajectoryLimits(2000.0, 45.0, 5.0), TrajectoryLimits(200.0, 7.0, 5.0)
NOISE_NM, SEED = 6e-3, 5
#: What the simulated axis has beside table A.10's friction: viscous friction that is higher when cold, and a Stribeck effect; assumed.
COLD_SHARE, WARM_S, STRIBECK_NM, STRIBECK_RAD_S = 0.35, 120.0, 0.012, 2.5
#: What nine months of use make of it, and what the added mass adds to the friction of the carriage, A.10; the first is assumed.
WORN: Mapping[str, float] = {"coulomb.level": 0.9, "cart_friction.level": 0.9, "viscous.damping": 0.85}


@dataclass(frozen=True)
class Order:
    """One order of the measurement.

    Attributes
    ----------
    speeds : int
        How many could be driven.
    minutes : float
        On the axis.
    fit : FrictionFit
        (3.36).
    slow_nm : float
        Mean torque of the speeds below 10 mm/s against the fitted law, N m: the Stribeck effect.
    viscous_then : float
        True viscous friction when the fast half was measured, N m s/rad.
    """

    name: str
    what: str
    speeds: int
    minutes: float
    fit: FrictionFit
    slow_nm: float
    viscous_then: float


@dataclass(frozen=True)
class FrictionComparison:
    """Comparison of the friction measurements of the source.

    Attributes
    ----------
    orders : tuple of Order
        I to VI.
    warm : tuple of float
        True viscous (N m s/rad) and Coulomb friction (N m) at the motor of the new axis once warm.
    """

    orders: tuple[Order, ...]
    warm: tuple[float, float]
    cold_viscous: float


def compare() -> FrictionComparison:
    """All six orders, each begun with a cold axis."""
    new = _axis("g_b", worn=False)
    up = sorted(SHUFFLED)
    tenfold = [speed for speed in up for _ in range(REPEATS)]
    orders = (
        _measure_order("I", "slowest first", new, up, BARE),
        _measure_order("II", "fastest first", new, up[::-1], BARE),
        _measure_order("III", "sequence (A.1)", new, SHUFFLED, BARE),
        _measure_order("IV", f"as I, each {REPEATS} times", new, tenfold, BARE),
        _measure_order("V", "as I, after nine months", _axis("g_b", worn=True), up, BARE),
        _measure_order("VI", "as V, with 11.2 kg", _axis("g_a", worn=True), up, LOADED),
    )
    viscous = new["viscous.damping"]
    return FrictionComparison(orders, (viscous, _total_coulomb(new)), viscous * (1.0 + COLD_SHARE))


def _axis(rig: str, worn: bool) -> Model:
    """A rig with warm-up and Stribeck effect, new or after nine months."""
    model = load_plant(rig).model
    if worn:
        model = model.with_values({name: share * model[name] for name, share in WORN.items()}, "worn in")
    model = model.with_effect("warmup", {"amount": COLD_SHARE, "time": WARM_S})
    return model.with_effect("stribeck", {"amount": STRIBECK_NM, "speed_scale": STRIBECK_RAD_S})


def _total_coulomb(model: Model) -> float:
    """Coulomb friction of motor and carriage at the motor, N m."""
    return model["coulomb.level"] + model["transmission.ratio"] * model["cart_friction.level"]


def _measure_order(name: str, what: str, model: Model, speeds: Sequence[float], limits: TrajectoryLimits) -> Order:
    """Strokes both ways at each speed in position control, short ones where a whole stroke would take minutes; (3.36) fitted."""
    room = TO_M - FROM_M
    driven = [v for v in speeds if 2.0 * ramp_length_m(v, limits) + v * (RUN_IN_S + 0.11) <= room]
    ratio, plateaus, clock = model["transmission.ratio"], list[Plateau](), 0.0
    noise = np.random.default_rng(SEED)
    at: dict[float, list[float]] = {}
    for speed in driven:
        strokes = constant_speed_strokes(
            FROM_M, TO_M, [speed], limits, PERIOD_S, run_in_s=RUN_IN_S, rest_s=REST_S, longest_plateau_s=RUN_IN_S + LONGEST_S
        )
        passes = _plateaus_at_speed(model, strokes.trajectory, clock, noise)
        plateaus += passes
        at.setdefault(speed, []).append(clock)
        clock += strokes.trajectory.duration_s
    fit = fit_friction(plateaus, slowest_rad_s=0.01 / ratio)
    slow = [p for p in plateaus if abs(p.speed_rad_s) < 0.01 / ratio]
    left = [math.copysign(1.0, p.speed_rad_s) * (p.torque_nm - float(fit.torque_nm(np.array([p.speed_rad_s]))[0])) for p in slow]
    fast = float(np.mean([t for v, times in at.items() if v >= 0.5 for t in times]))
    then = model["viscous.damping"] * (1.0 + COLD_SHARE * math.exp(-fast / WARM_S))
    return Order(name, what, len(set(driven)), clock / 60.0, fit, float(np.mean(left)), then)


def _plateaus_at_speed(model: Model, path: Trajectory, time_s: float, noise: np.random.Generator) -> tuple[Plateau, ...]:
    """Plateaus of one speed as the drive would record them."""
    moved = predict_move(model, _loop(model), path, Loop(CascadeStructure("simulated", PERIOD_S), DELAY_S, PEAK_NM, COUNTS), time_s=time_s)
    ratio = model["transmission.ratio"]
    torque = np.concatenate(([0.0], moved.torque_nm[:-1])) + noise.normal(0.0, NOISE_NM, len(moved.torque_nm))
    found = find_plateaus(moved.t_s, torque, moved.motor_m / ratio, path.velocity_m_s / ratio, run_in_s=RUN_IN_S)
    return tuple(replace(p, start_s=p.start_s + time_s) for p in found)


def _loop(model: Model) -> Cascade:
    """The source's Butterworth gains with the reference behind the same lag, and a feedforward of inertia and Coulomb friction."""
    rig = model.name.lower()
    ratio = model["transmission.ratio"]
    forward = Feedforward(model["motor.inertia"] + ratio**2 * model["cart.mass"], 0.0, _total_coulomb(model))
    return replace(gains(rig, "butterworth"), feedforward=forward, filter_reference=True)


def _difference_words(base_worn: bool, rig: str) -> str:
    """Difference in construction between G_B and a worn axis, in words."""
    before, after = _axis("g_b", base_worn), _axis(rig, True)
    coulomb = _total_coulomb(after) / _total_coulomb(before) - 1.0
    return f"{100 * coulomb:+.1f} and {100 * (after['viscous.damping'] / before['viscous.damping'] - 1.0):+.1f} %"


def lines(study: FrictionComparison) -> list[str]:
    """The table and what it says."""
    head = f"{'':31} {'speeds':>6} {'min':>5} {'d_v, mN m s/rad':>17} {'tau_c, N m':>18} {'left':>10} {'below 10 mm/s':>14} {'true d_v':>8}"
    said = [
        f"Friction sweep in six orders, {len(SHUFFLED)} speeds of (A.1), simulated: table A.10 and, assumed, {100 * COLD_SHARE:.0f} % more "
        f"viscous friction when cold (time constant {WARM_S:.0f} s) and a Stribeck effect of {1e3 * STRIBECK_NM:.0f} mN m; each begun cold",
        head,
    ]
    for order in study.orders:
        viscous, coulomb = order.fit.viscous, order.fit.coulomb
        said.append(
            f"{order.name:4} {order.what:26} {order.speeds:6d} {order.minutes:5.1f} {1e3 * viscous.value:8.3f} ± "
            f"{1e3 * (viscous.interval or 0.0):6.3f} {coulomb.value:9.4f} ± {coulomb.interval or 0.0:6.4f} "
            f"{1e3 * order.fit.rms_nm:5.2f} mN m {1e3 * order.slow_nm:+9.1f} mN m {1e3 * order.viscous_then:9.3f}"
        )
    by = {order.name: order.fit for order in study.orders}

    def change(name: str, base: str) -> str:
        coulomb, viscous = (getattr(by[name], n).value / getattr(by[base], n).value - 1.0 for n in ("coulomb", "viscous"))
        return f"{100 * coulomb:+.1f} % Coulomb, {100 * viscous:+.1f} % viscous"

    return [
        *said,
        f"{'':4} {'true, warm':26} {'':12} {1e3 * study.warm[0]:8.3f} {'':8} {study.warm[1]:9.4f}; cold {1e3 * study.cold_viscous:.3f}",
        f"II against I: {change('II', 'I')} by the order alone: fast strokes meet a cold axis or a warm one.  Order (A.1) mixes both, so "
        "that the drift shows in what is left over and not in d_v alone",
        f"V against I, nine months: {change('V', 'I')} ({_difference_words(False, 'g_b')} built in)",
        f"VI against V, 11.2 kg more: {change('VI', 'V')} ({_difference_words(True, 'g_a')} built in, table A.10)",
        "(3.36) has no Stribeck effect, which still acts beyond 10 mm/s: it makes tau_c larger and d_v smaller in every order.  Without "
        "it order IV reads 2.236 of 2.241 mN m s/rad, and VI against V +8.6 % Coulomb, +13.8 % viscous",
        "Speeds whose ramps the belt does not bear are left out",
        "At the lowest speeds the strokes are short: one turn of the motor at 1 mm/s would take 78 s.  Below 10 mm/s the Stribeck effect "
        "shows; these speeds are not fitted",
        "A frequency response around standstill shows many times the viscous friction (beltcomm thesis identification says how many, "
        "beltcomm friction why on a run of your own): Coulomb friction seen as damping.  A sweep separates the two (erratum 7)",
    ]
