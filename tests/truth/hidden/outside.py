"""Effects that real machines have and the catalogue does not hold, drawn at random.

Same shape as in :mod:`truth.hidden.catalogue`; the ranges are such that strength 1 is plainly visible.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from truth.hidden import layout as at
from truth.hidden.catalogue import Draw, phase
from truth.hidden.layout import Array
from truth.hidden.machines import Base

#: s, longest session for which bursts are drawn.
SESSION_S = 240.0


def iwan_belt(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """Frictional belt damping: four springs with sliders beside the belt, slipping between 2 and 60 % of the largest force."""
    largest = min(base.peak_torque_nm / base.radius_m, base.belt_force_limit_n)
    share = strength * rng.uniform(0.15, 0.35)
    limits = np.geomspace(rng.uniform(0.02, 0.05), rng.uniform(0.3, 0.6), at.SLIDERS) * largest * share
    p[at.SLIDER_STIFFNESS : at.SLIDER_STIFFNESS + at.SLIDERS] = share * base.stiffness_n_m / at.SLIDERS
    p[at.SLIDER_FORCE : at.SLIDER_FORCE + at.SLIDERS] = limits / at.SLIDERS
    return {"stiffness_share": share, "slip_n": [float(x) for x in limits / at.SLIDERS]}


def friction_drift(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """The friction level wanders: six sines with periods of 4 to 40 s, together 15 to 30 % rms."""
    rms = strength * rng.uniform(0.15, 0.30)
    for i in range(at.DRIFT_SINES):
        p[at.DRIFT + i] = rms * math.sqrt(2.0 / at.DRIFT_SINES)
        p[at.DRIFT_RATE + i] = math.tau / (4.0 * 10.0 ** rng.uniform(0.0, 1.0))
        p[at.DRIFT_PHASE + i] = phase(rng)
    return {"rms_share": rms}


def viscous_position(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """Drag of the guide grows with the square of the distance from a place: 15 to 40 N s/m more half a stroke away."""
    p[at.GREASE], p[at.GREASE_PLACE] = strength * rng.uniform(15.0, 40.0), base.stroke_m * rng.uniform(0.2, 0.8)
    p[at.GREASE_LENGTH] = 0.5 * base.stroke_m
    return {"drag_n_s_m": float(p[at.GREASE]), "place_m": float(p[at.GREASE_PLACE])}


def cable_hysteresis(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """Hose with a cubic spring (4 to 10 N half a stroke away) and hysteresis of 2 to 6 N over 15 to 50 mm."""
    edge = strength * rng.uniform(4.0, 10.0)
    p[at.CUBIC], p[at.CUBIC_PLACE] = edge / (0.5 * base.stroke_m) ** 3, base.stroke_m * rng.uniform(0.3, 0.7)
    p[at.HYSTERESIS], p[at.HYSTERESIS_LENGTH] = strength * rng.uniform(2.0, 6.0), rng.uniform(0.015, 0.050)
    return {"edge_n": edge, "hysteresis_n": float(p[at.HYSTERESIS]), "length_m": float(p[at.HYSTERESIS_LENGTH])}


def torque_dead_band(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """The current loop gives torque in steps of 40 to 100 mN m and nothing below 30 to 80 mN m."""
    p[at.TORQUE_STEP], p[at.DEAD_BAND] = strength * rng.uniform(0.04, 0.10), strength * rng.uniform(0.03, 0.08)
    return {"step_nm": float(p[at.TORQUE_STEP]), "dead_band_nm": float(p[at.DEAD_BAND])}


def payload_impact(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """A loose part of 15 to 40 % of the mass hits its stops after +-0.3 to 2 mm."""
    mass, gap = strength * rng.uniform(0.15, 0.40) * base.mass_kg, rng.uniform(0.3e-3, 2e-3)
    p[at.M2], p[at.LOOSE], p[at.D_LOOSE] = mass, gap, 0.3 * mass
    p[at.K_IMPACT], p[at.LOSS_IMPACT] = mass * (math.tau * rng.uniform(60.0, 150.0)) ** 2, rng.uniform(0.5, 3.0)
    return {"mass_kg": mass, "gap_m": gap, "contact_n_m": float(p[at.K_IMPACT])}


def rail_pitch(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """Friction level goes by 25 to 60 % with the pitch of the rail's screws, no whole fraction of a motor revolution."""
    turn = math.tau * base.radius_m
    orders = int(rng.integers(1, 4)) + rng.uniform(0.3, 0.7)
    p[at.RAIL], p[at.RAIL_PITCH], p[at.RAIL_PHASE] = strength * rng.uniform(0.25, 0.60), turn / orders, phase(rng)
    return {"share": float(p[at.RAIL]), "pitch_m": turn / orders}


def missing_codes(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """The encoder sticks at a code for the next 10 to 30 counts, 30 to 60 times per revolution."""
    counts = math.tau / base.quantum_rad
    period, width = round(counts / rng.uniform(30.0, 60.0)), round(strength * rng.uniform(10.0, 30.0))
    width = min(width, period // 3)  # of a coarse encoder
    p[at.CODE_PERIOD], p[at.CODE_WIDTH], p[at.CODE_PLACE] = period if width else 0, width, int(rng.integers(0, period))
    return {"period_counts": period, "width_counts": width}


def supply_ripple(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """Torque at 50 and 100 Hz from the supply, 30 to 80 mN m, swelling with a period of 3 to 10 s."""
    size = strength * rng.uniform(0.03, 0.08)
    p[at.SUPPLY], p[at.SUPPLY_SECOND] = size, size * rng.uniform(0.2, 0.6)
    p[at.SUPPLY_RATE], p[at.SUPPLY_PHASE] = math.tau / rng.uniform(3.0, 10.0), phase(rng)
    return {"amplitude_nm": size, "second_nm": float(p[at.SUPPLY_SECOND])}


def load_bursts(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """Half sines of load torque, 100 to 300 mN m high, 20 to 120 ms long, every 0.5 to 2.5 s."""
    rows = []
    height, t = strength * rng.uniform(0.1, 0.3), rng.uniform(0.0, 1.0)
    while t < SESSION_S:
        rows.append([float(t), float(rng.uniform(0.02, 0.12)), float(height * rng.uniform(0.5, 1.5) * rng.choice([-1.0, 1.0]))])
        t += rng.uniform(0.5, 2.5)
    return {"height_nm": height, "bursts": rows}


def creeping_belt(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """Viscoelastic belt: a spring of 15 to 40 % behind a dashpot beside the belt, relaxing in 3 to 30 ms."""
    share, time = strength * rng.uniform(0.15, 0.40), 3e-3 * 10.0 ** rng.uniform(0.0, 1.0)
    p[at.K_CREEP], p[at.CREEP_TIME] = share * base.stiffness_n_m, time
    return {"stiffness_share": share, "time_s": time}


def ageing_contact(rng: np.random.Generator, base: Base, strength: float, p: Array) -> Mapping[str, Any]:
    """Rate-and-state friction (Dieterich, Ruina): 4 to 8 % more per e-fold of rest, renewed over 0.2 to 1 mm."""
    p[at.AGEING], p[at.AGEING_LENGTH] = strength * rng.uniform(0.04, 0.08), rng.uniform(0.2e-3, 1e-3)
    p[at.AGEING_TIME] = 1e-4
    return {"share_per_e": float(p[at.AGEING]), "length_m": float(p[at.AGEING_LENGTH])}


OUTSIDE: Final[Mapping[str, Draw]] = {
    draw.__name__: draw
    for draw in (
        iwan_belt,
        friction_drift,
        viscous_position,
        cable_hysteresis,
        torque_dead_band,
        payload_impact,
        rail_pitch,
        missing_codes,
        supply_ripple,
        load_bursts,
        creeping_belt,
        ageing_contact,
    )
}
