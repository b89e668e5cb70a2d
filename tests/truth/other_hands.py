"""Belt axes as other hands would make and measure them, drawn at random: nothing is shared with ``truth.hidden``.

Two bodies by small steps of explicit Euler, Coulomb friction by impulses on motor and carriage; a drive that switches inside the period and
filters its setpoint, torque that acts beside it, a reading that is a mean, late, filtered and in steps; PRBS in open loop or beside a slow
controller, strokes and moves under a cascade.   One law may be hidden: cogging, a narrow tight spot, friction by direction, drag.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
HIDDEN = ("none", "none", "none", "none", "cogging", "tight spot", "direction", "drag")
STEP_S = 2.5e-5


@dataclass(frozen=True)
class Machine:
    """SI, motor side where it is not the carriage's; cogging: N m, per turn, phase; spot: N, m, m."""

    inertia: float
    mass: float
    stiffness: float
    damping: float
    viscous: float
    viscous_cart: float
    coulomb: float
    coulomb_cart: float
    ratio: float
    cogging: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spot: tuple[float, float, float] = (0.0, 0.0, 1.0)
    direction: float = 0.0
    drag: float = 0.0


@dataclass(frozen=True)
class Instruments:
    """Delay in periods, time constants in s, torques in N m."""

    period_s: float
    counts: int
    delay: float
    lag_s: float
    process_nm: float
    process_colour: float
    noise_nm: float
    step_nm: float
    reading_lag_s: float


@dataclass(frozen=True)
class Drawn:
    """A machine with its drive, and what is hidden."""

    machine: Machine
    instruments: Instruments
    hidden: str
    rated_nm: float
    travel_m: float
    resonance_hz: float


def draw(seed: int, hidden: str | None = None) -> Drawn:
    g = np.random.default_rng((77, seed))
    ratio, inertia = g.uniform(0.008, 0.025), 10.0 ** g.uniform(-4.3, -3.0)
    mass = min(max(inertia / ratio**2 * 10.0 ** g.uniform(-0.6, 0.9), 0.4), 40.0)
    resonance_hz, relative = g.uniform(20.0, 120.0), 1.0 / (1.0 / mass + ratio**2 / inertia)
    stiffness = (math.tau * resonance_hz) ** 2 * relative
    coulomb, coulomb_cart = g.uniform(0.01, 0.06), g.uniform(2.0, 20.0)
    friction, travel_m = coulomb + ratio * coulomb_cart, g.uniform(0.6, 1.8)
    rated = friction * g.uniform(4.0, 10.0)
    kind = hidden if hidden is not None else str(g.choice(HIDDEN))
    cogging = g.uniform(0.03, 0.1) * rated, float(g.choice([4, 6, 12, 24])), g.uniform(0.0, 6.0)
    spot = g.uniform(0.5, 1.5) * friction / ratio, g.uniform(0.3, 0.7) * travel_m, g.uniform(0.01, 0.04)
    direction, drag = g.uniform(0.15, 0.35), g.uniform(0.4, 1.0) * friction / (0.7 * min(1.5 / ratio, 300.0)) ** 2
    machine = Machine(
        inertia,
        mass,
        stiffness,
        2.0 * g.uniform(0.01, 0.06) * math.sqrt(stiffness * relative),
        g.uniform(0.02, 0.3) * friction / 100.0,
        g.uniform(1.0, 15.0),
        coulomb,
        coulomb_cart,
        ratio,
        cogging=cogging if kind == "cogging" else Machine.cogging,
        spot=spot if kind == "tight spot" else Machine.spot,
        direction=direction if kind == "direction" else 0.0,
        drag=drag if kind == "drag" else 0.0,
    )
    instruments = Instruments(
        period_s=float(g.choice([1e-3, 1e-3, 1e-3, 2e-3])),
        counts=int(g.choice([4096, 10000, 16384, 65536, 131072, 1048576])),
        delay=float(g.choice([0.0, 0.25, 0.5, 1.0])),
        lag_s=float(g.choice([0.0, 0.0, g.uniform(3e-4, 1.5e-3)])),
        process_nm=float(g.choice([0.0, 0.0, 0.003, 0.008])) * rated,
        process_colour=float(g.choice([0.0, 0.0, 0.9])),
        noise_nm=g.uniform(0.001, 0.006) * rated,
        step_nm=float(g.choice([0.0, 0.001, 0.004])) * rated,
        reading_lag_s=float(g.choice([0.0, 0.0, 5e-4, 1e-3])),
    )
    return Drawn(machine, instruments, kind, rated, travel_m, resonance_hz)


def record(drawn: Drawn, seed: int, folder: Path) -> None:
    """The records of a drawn axis and its axis.yaml, as ``run-folder`` has them: responses, strokes, moves, moves held out."""
    g, m, it = np.random.default_rng((78, seed)), drawn.machine, drawn.instruments
    rigid, wish = m.inertia + m.mass * m.ratio**2, math.tau * drawn.resonance_hz * 0.12
    dead_s = it.period_s * (1.0 + it.delay) + it.lag_s
    kv = min(wish * rigid, 0.15 * m.inertia / dead_s)
    loop = np.array([0.25 * kv / rigid, kv, 0.25 * kv**2 / rigid, 2.5 * drawn.rated_nm])
    friction, fastest = m.coulomb + m.ratio * m.coulomb_cart, min(1.5 / m.ratio, 300.0) * m.ratio
    most_m_s2 = 0.45 * drawn.rated_nm / rigid * m.ratio
    speed = min(0.5 * fastest, math.sqrt(most_m_s2 * drawn.travel_m * 0.4))
    (folder / "recordings").mkdir(parents=True)
    _write_axis(drawn, folder, fastest, most_m_s2, g)
    clock = 0.0

    def write(name: str, sidecar: dict[str, Any], added: Array, reference: Array, rate: Array) -> None:
        nonlocal clock
        rows = _measured(drawn, g, sidecar["start_position_m"] / m.ratio, loop, added, reference, rate, sidecar["closed_loop"])
        header, form = "t_s,torque_setpoint_nm,torque_nm,position_rad", ["%.4f", "%.6f", "%.6f", "%.8f"]
        np.savetxt(folder / "recordings" / f"{name}.csv", rows, delimiter=",", header=header, comments="", fmt=form)
        sidecar |= {"session_time_s": round(clock, 3)}
        (folder / "recordings" / f"{name}.yaml").write_text(yaml.safe_dump(sidecar, sort_keys=False), encoding="utf-8")
        clock += len(rows) * it.period_s + 1.0

    for number, (place, share) in enumerate([(0.3, 0.55), (0.5, 0.8), (0.7, 0.55)]):
        period, hold = 2046, 2 if it.period_s <= 1e-3 else 1
        amplitude = min(share * drawn.rated_nm, 3.0 * friction)
        bits = np.repeat(g.integers(0, 2, period // hold + 1) * 2.0 - 1.0, hold)[:period]
        added = np.concatenate([np.zeros(150), np.tile(amplitude * bits, 2)])
        at, still = round(place * drawn.travel_m, 4), np.zeros(len(added))
        excitation = {"kind": "prbs", "amplitude_nm": float(amplitude), "period_samples": period, "first_sample": 150}
        closed = bool(g.random() < 0.5)
        sidecar = {"experiment": "frf", "start_position_m": at, "closed_loop": closed, "held_out": False, "excitation": excitation}
        write(f"prbs{number}", sidecar, added, still + at / m.ratio, still)
    low, high = 0.15 * drawn.travel_m, 0.85 * drawn.travel_m
    kinds = [("slow", 0.1, "friction_sweep"), ("fast", 0.6, "friction_sweep"), ("moves", 0.9, "trajectory"), ("check", 0.8, "trajectory")]
    for name, share, experiment in kinds:
        v, a = share * speed, most_m_s2
        if experiment == "trajectory":
            turn = low + (high - low) * g.uniform(0.4, 0.8)
            ways = [(turn - low, v, a), (high - turn, v, 0.6 * a), (low - high, v, a)]
        else:
            v = max(v, 0.25 * (high - low))
            ways = [(high - low, v, 0.5 * a), (low - high, v, 0.5 * a)]
        rate = np.concatenate([_profile(*way, it.period_s) for way in ways])
        sidecar = {"experiment": experiment, "start_position_m": round(low, 4), "closed_loop": True, "held_out": name == "check"}
        write(name, sidecar, np.zeros(len(rate)), (low + np.cumsum(rate) * it.period_s) / m.ratio, rate / m.ratio)


def _profile(way_m: float, speed: float, acceleration: float, period_s: float) -> Array:
    """Speed of a trapezoidal move, with a pause behind it."""
    speed = min(speed, math.sqrt(abs(way_m) * acceleration))
    rise, level = speed / acceleration, abs(way_m) / speed - speed / acceleration
    t = np.arange(0.0, 2.0 * rise + level + 0.15, period_s)
    return np.asarray(np.sign(way_m) * np.interp(t, [0.0, rise, rise + level, 2.0 * rise + level], [0.0, speed, speed, 0.0], right=0.0))


def _measured(
    drawn: Drawn, g: np.random.Generator, start: float, loop: Array, added: Array, reference: Array, rate: Array, closed: bool
) -> Array:
    """Time, setpoint, reading and angle, (n, 4)."""
    m, it, n = drawn.machine, drawn.instruments, len(added)
    process = g.normal(0.0, 1.0, n)
    for k in range(1, n):
        process[k] = it.process_colour * process[k - 1] + math.sqrt(1.0 - it.process_colour**2) * process[k]
    steps = round(it.period_s / STEP_S)
    bodies = np.array([m.inertia, m.mass, m.stiffness, m.damping, m.viscous, m.viscous_cart, m.coulomb, m.coulomb_cart, m.ratio])
    laws = np.array([*m.cogging, *m.spot, m.direction, m.drag])
    driven = (round(it.delay * steps), it.lag_s, it.process_nm * process)
    angle, acting, setpoint = _simulated(added, steps, it.period_s, bodies, laws, start, loop, reference, rate, closed, *driven)
    reading = np.concatenate([[0.0], acting[:-1]])
    if it.reading_lag_s:
        new = 1.0 - math.exp(-it.period_s / it.reading_lag_s)
        for k in range(1, n):
            reading[k] = reading[k - 1] + new * (reading[k] - reading[k - 1])
    reading = reading + g.normal(0.0, it.noise_nm, n)
    if it.step_nm:
        reading = np.round(reading / it.step_nm) * it.step_nm
    count = math.tau / it.counts
    return np.column_stack([np.arange(n) * it.period_s, setpoint, reading, np.floor(angle / count) * count])


@njit(cache=True)
def _simulated(  # type: ignore[no-untyped-def]
    added, steps, period_s, bodies, laws, start, loop, reference, rate, closed, delay_steps, lag_s, process
):
    inertia, mass, stiffness, damping, viscous, viscous_cart, coulomb, coulomb_cart, ratio = bodies
    h, n = period_s / steps, len(added)
    angles, acting, setpoints = np.zeros(n), np.zeros(n), np.zeros(n)
    theta, omega, x, v = start, 0.0, start * ratio, 0.0
    integral, y, before, last = 0.0, 0.0, 0.0, start
    for i in range(n):
        angles[i] = theta
        setpoint = added[i]
        if closed:
            off = rate[i] + loop[0] * (reference[i] - theta) - (theta - last) / period_s
            integral += loop[2] * off * period_s
            setpoint = min(max(setpoint + loop[1] * off + integral, -loop[3]), loop[3])
        last, setpoints[i], total = theta, setpoint, 0.0
        for j in range(steps):
            towards = (before if j < delay_steps else setpoint) - y
            y += towards * (1.0 - np.exp(-h / lag_s)) if lag_s > 0.0 else towards
            total += y + process[i]
            torque = y + process[i] + laws[0] * np.sin(laws[1] * theta + laws[2])
            belt = stiffness * (ratio * theta - x) + damping * (ratio * omega - v)
            free = omega + h * (torque - viscous * omega - laws[7] * omega * abs(omega) - ratio * belt) / inertia
            most = h * coulomb * (1.0 + laws[6] * (1.0 if free > 0.0 else -1.0)) / inertia
            omega = free - most if free > most else (free + most if free < -most else 0.0)
            slides = v + h * (belt - viscous_cart * v) / mass
            most = h * (coulomb_cart + laws[3] * np.exp(-(((x - laws[4]) / laws[5]) ** 2))) / mass
            v = slides - most if slides > most else (slides + most if slides < -most else 0.0)
            theta += h * omega
            x += h * v
        before, acting[i] = setpoint, total / steps
    return angles, acting, setpoints


def _write_axis(drawn: Drawn, folder: Path, fastest: float, acceleration: float, g: np.random.Generator) -> None:
    m, length = drawn.machine, drawn.travel_m + 0.2
    motor, middle = m.inertia * g.uniform(0.5, 0.8), 0.1 + 0.5 * drawn.travel_m
    specific = m.stiffness / (1.0 / middle + 1.0 / (2.0 * length - middle)) * g.uniform(0.85, 1.15)
    sheet = {
        "name": "an axis of other hands",
        "motor": {
            "name": "servo motor",
            "inertia_kg_m2": float(motor),
            "torque_constant_nm_a": 0.5,
            "rated_torque_nm": float(drawn.rated_nm),
            "peak_torque_nm": float(3.0 * drawn.rated_nm),
            "encoder_counts_per_rev": drawn.instruments.counts,
        },
        "gearbox": {"ratio": 1.0, "inertia_kg_m2": 0.0},
        "coupling": {"inertia_kg_m2": 0.0},
        "pulley": {"effective_radius_m": float(m.ratio), "inertia_kg_m2": float(m.inertia - motor)},
        "belt": {"specific_stiffness_n": float(specific), "pulley_distance_m": float(length)},
        "travel": {"min_m": 0.0, "max_m": float(drawn.travel_m), "driven_side_offset_m": 0.1},
        "limits": {
            "speed_m_s": float(fastest),
            "acceleration_m_s2": float(3.0 * acceleration),
            "pulley_torque_nm": float(3.0 * drawn.rated_nm),
        },
    }
    (folder / "axis.yaml").write_text(yaml.safe_dump(sheet, sort_keys=False), encoding="utf-8")
