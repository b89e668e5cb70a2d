"""Experiments that show an effect: from two models, one with it and one without, to lines over speed, place, frequency or time.

On the shipped heavy rig g_a; numbers only.  No noise, so that nothing but the effect differs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from beltcomm.effects import effect_named
from beltcomm.excitation.binary import prbs
from beltcomm.model import Model, load_plant
from beltcomm.model.linear import Oscillation, operating_point, sampled_response
from beltcomm.response import estimate_response, log_spaced_lines
from beltcomm.simulate.forward import simulate_torque
from beltcomm.simulate.inverse import FineMotion, torque_residuals

Array = NDArray[np.float64]

#: s, sampling period; fine steps in it; m/rad; rad/s at which friction slides in a linearised response.
T, FINE, RATIO, SLIDING = 1e-3, 16, 0.01242, 5.0
FREQUENCIES_HZ = np.geomspace(3.0, 300.0, 160)
#: mm/s of the strokes that show friction over speed.
SPEEDS_MM_S = (2, 5, 10, 15, 20, 30, 50, 80, 120, 200, 350, 500, 700, 1000)
WITHOUT, WITH = "without", "with"


@dataclass(frozen=True)
class Line:
    """One line of a panel.   effect : drawn in the colour of the effect.   second : dashed, the second of its colour."""

    label: str
    x: Array
    y: Array
    effect: bool
    second: bool = False


@dataclass(frozen=True)
class Panel:
    """One diagram: labels with units, its lines, and whether x is logarithmic."""

    x: str
    y: str
    lines: tuple[Line, ...]
    logarithmic: bool = False


@dataclass(frozen=True)
class Symptom:
    """experiment : what is done, one sentence.   panels : what it shows, one or two."""

    experiment: str
    panels: tuple[Panel, ...]


@cache
def rig() -> Model:
    """The heavy rig of the thesis, as shipped."""
    return load_plant("g_a").model


@cache
def calm() -> Model:
    """The same with a belt that damps strongly: a carriage that swings on for seconds would cover what the effect does."""
    return rig().with_values({"belt_damping.damping": 1500.0})


@cache
def slippery() -> Model:
    """The same with little friction, which would otherwise change with the amplitude, too."""
    return rig().with_values({"coulomb.level": 0.02, "cart_friction.level": 0.5})


def without(*names: str) -> Model:
    """The rig without some of its effects."""
    model = rig()
    for name in names:
        model = model.without_effect(name)
    return model


def having(name: str, base: Model | None = None, /, **values: float) -> Model:
    """The rig, or ``base``, with one more effect."""
    return (base or rig()).with_effect(name, values)


def motion(theta: Array, time_s: float = 0.0) -> FineMotion:
    """Of a motor angle on the fine grid."""
    return FineMotion(theta, np.gradient(theta, T / FINE), (len(theta) - 1) // FINE + 1, T, FINE, time_s)


def needed(model: Model, theta: Array, time_s: float = 0.0) -> Array:
    """Torque that a drive reports while its loop makes the motor follow ``theta``, (n,), mN m: the model's equation, solved for it."""
    moved = motion(theta, time_s)
    reported = np.zeros(moved.samples)
    for _ in range(8 if any(e.slot == "torque_path" for e in model.effect_list()) else 1):
        reported = reported + torque_residuals(model, moved, reported, [model.vector()], [0.0])[0]
    return np.asarray(1e3 * reported)


def fine_time(seconds: float) -> Array:
    """The fine grid."""
    return np.asarray(np.arange(round(seconds / T) * FINE + 1) * T / FINE)


def line(name: str, effect: bool, x: Array, y: Array, second: bool = False) -> Line:
    """A line of at most some 200 points, the ends of the record (where the carriage settles) left out."""
    keep = slice(len(x) // 12, -2, max(1, len(x) // 200))
    return Line(name, x[keep], y[keep], effect, second)


# Experiments: from two models to what they show.


def strokes(base: Model, changed: Model, speed: float = 0.05, low: float = 0.1, high: float = 0.4) -> Symptom:
    """Slow strokes both ways, torque over the place."""
    t = fine_time((high - low) / speed)
    lines = []
    for effect, model in ((False, base), (True, changed)):
        for back in (False, True):
            x = high - speed * t if back else low + speed * t
            label = WITH if effect else WITHOUT
            lines.append(line("" if back else label, effect, 1e3 * x[::FINE], needed(model, x / RATIO), back))
    return Symptom(
        f"strokes at {1e3 * speed:g} mm/s, forward (full lines) and backward (dashed): torque over the carriage's place",
        (Panel("carriage in mm", "torque in mN m", tuple(lines)),),
    )


def sweep(base: Model, changed: Model, top: int = 1000) -> Symptom:
    """Mean torque of constant-speed strokes over speed."""
    speeds = np.array([s for s in SPEEDS_MM_S if s <= top], dtype=float)
    signed = np.concatenate([-speeds[::-1], speeds])
    lines = []
    for effect, model in ((False, base), (True, changed)):
        torque = []
        for v in 1e-3 * signed:
            t = fine_time(0.3 if abs(v) >= 0.02 else 1.5)
            torque.append(float(np.mean(needed(model, (0.25 + v * (t - 0.5 * t[-1])) / RATIO)[100:-2])))
        for side in (signed < 0, signed > 0):
            lines.append(Line("" if side[0] else (WITH if effect else WITHOUT), signed[side], np.array(torque)[side], effect))
    return Symptom(
        "strokes at constant speeds, both ways: mean torque over speed",
        (Panel("carriage speed in mm/s", "torque in mN m", tuple(lines)),),
    )


def response_of(model: Model, place: float, amplitude_rad: float = 0.0) -> NDArray[np.complex128]:
    """Motor speed over torque, rad/s/(N m): friction slides, or swings with an amplitude; late torque included."""
    omega = 2.0 * np.pi * FREQUENCIES_HZ
    if amplitude_rad:
        h = [
            complex(
                sampled_response(model, operating_point(model, place), [f], T, standstill=Oscillation(amplitude_rad, 2.0 * math.pi * f))[0]
            )
            for f in FREQUENCIES_HZ
        ]
    else:
        h = list(sampled_response(model, operating_point(model, place, SLIDING), FREQUENCIES_HZ, T))
    found = np.array(h) * 1j * omega
    for effect in model.effect_list():
        if effect.slot == "torque_delay" and effect.slope is not None:
            found = found * effect.slope(omega, *(model[name] for name in effect.full_names()))  # type: ignore[operator]
    return np.asarray(found)


def two_panels(curves: list[tuple[str, bool, bool, Array, NDArray[np.complex128]]], *, unwrap: bool = True) -> tuple[Panel, Panel]:
    """Magnitude and phase of responses.   unwrap : the phase may run on below -180 degrees; not for estimates that scatter."""
    size = tuple(Line(n, f, 20.0 * np.log10(np.abs(h)), e, s) for n, e, s, f, h in curves)
    phase = tuple(Line(n, f, np.degrees(np.unwrap(np.angle(h)) if unwrap else np.angle(h)), e, s) for n, e, s, f, h in curves)
    return Panel("frequency in Hz", "speed/torque in dB", size, True), Panel("frequency in Hz", "phase in degrees", phase, True)


def response(base: Model, changed: Model, place: float = 0.25) -> Symptom:
    """Frequency response of the motor."""
    curves = [(n, e, False, FREQUENCIES_HZ, response_of(m, place)) for n, e, m in ((WITHOUT, False, base), (WITH, True, changed))]
    return Symptom("frequency response from torque to motor speed", two_panels(curves))


def response_by_place(base: Model, changed: Model) -> Symptom:
    """The same near both ends of the travel."""
    curves = [
        (f"{n}, {1e3 * x:g} mm", e, second, FREQUENCIES_HZ, response_of(m, x))
        for n, e, m in ((WITHOUT, False, base), (WITH, True, changed))
        for x, second in ((0.02, False), (0.48, True))
        if e or not second
    ]
    return Symptom("frequency response from torque to motor speed, with the carriage at two places", two_panels(curves))


def response_by_swing(base: Model, changed: Model) -> Symptom:
    """Friction as its describing function, at a small and a large amplitude of the motor."""
    curves = [
        (f"{n}, ±{1e3 * a:g} mrad", e, second, FREQUENCIES_HZ, response_of(m, 0.25, a))
        for n, e, m in ((WITHOUT, False, base), (WITH, True, changed))
        for a, second in ((1e-2, True), (0.1, False))
        if e or not second
    ]
    return Symptom(
        "frequency response around standstill at two amplitudes of the motor (describing function of the friction)", two_panels(curves)
    )


def response_by_amplitude(base: Model, changed: Model, small: float, large: float) -> Symptom:
    """Frequency response from a simulated PRBS at two amplitudes."""
    curves = []
    for effect, model in ((False, base), (True, changed)):
        for amplitude, second in ((small, True), (large, False)):
            if not effect and second:
                continue
            excited = prbs(9, 2, 2.0 * amplitude, T, 4)
            angle = simulate_torque(model, excited.torque, T, 0.25).position_rad
            found = estimate_response(excited.torque, angle, T, excited.period_samples, excited.first_sample)
            keep = log_spaced_lines(found.freq_hz, 70, 4.0, 200.0)
            h = found.h[keep] * 2j * np.pi * found.freq_hz[keep]
            curves.append((f"{WITH if effect else WITHOUT}, ±{amplitude:g} N m", effect, second, found.freq_hz[keep], h))
    return Symptom("frequency response from a PRBS at two amplitudes of the torque", two_panels(curves, unwrap=False))


def reversals(base: Model, changed: Model, amplitude: float = 3e-4, seconds: float = 1.0) -> Symptom:
    """Small, slow swings: torque over the way."""
    t = fine_time(2.0 * seconds)
    x = amplitude * np.sin(2.0 * np.pi * t / seconds)
    lines = []
    for effect, model in ((False, base), (True, changed)):
        torque = needed(model, (0.25 + x) / RATIO)
        half = slice(len(torque) // 2, len(torque) - 2)
        lines.append(Line(WITH if effect else WITHOUT, 1e6 * x[::FINE][half][::3], torque[half][::3], effect))
    return Symptom(
        f"the motor swings slowly by ±{1e6 * amplitude:g} µm at the belt: torque over the way",
        (Panel("way at the belt in µm", "torque in mN m", tuple(lines)),),
    )


def move(base: Model, changed: Model, acceleration: float = 12.0) -> Symptom:
    """Accelerate and brake: torque over time."""
    t = fine_time(0.36)
    ramp = (
        np.clip(np.minimum(t - 0.03, 0.33 - t) / 0.01, 0.0, 1.0)
        * np.where(t < 0.18, 1.0, -1.0)
        * np.clip(np.abs(t - 0.18) / 0.01, 0.0, 1.0)
    )
    speed = np.concatenate([[0.0], np.cumsum(0.5 * (ramp[1:] + ramp[:-1]))]) * acceleration * T / FINE
    x = 0.1 + np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))]) * T / FINE
    lines = [
        line(WITH if effect else WITHOUT, effect, 1e3 * t[::FINE], needed(model, x / RATIO))
        for effect, model in ((False, base), (True, changed))
    ]
    return Symptom(
        f"a move at ±{acceleration:g} m/s²: torque over time, acceleration first, braking then",
        (Panel("time in ms", "torque in mN m", tuple(lines)),),
    )


def by_angle(base: Model, changed: Model, cases: Mapping[str, tuple[float, float]], words: str, most: int | None = None) -> Symptom:
    """Torque over turns of the motor.   cases : by label, (speed m/s, acceleration m/s²) at the start.   most : samples from the middle."""
    panels = []
    for label, (speed, acceleration) in cases.items():
        t = fine_time(math.sqrt(0.6 / acceleration) if acceleration else min(0.42 / speed, 4.0))
        x = 0.02 + speed * t + 0.5 * acceleration * t * t
        turns = (x - x[0])[::FINE] / RATIO / (2.0 * math.pi)
        first = (len(turns) - most) // 2 if most else 0
        part = slice(first, first + most if most else None)
        lines = [
            line(WITH if effect else WITHOUT, effect, turns[part], needed(model, x / RATIO)[part])
            for effect, model in ((False, base), (True, changed))
        ]
        panels.append(Panel(f"turns of the motor, {label}", "torque in mN m", tuple(lines)))
    return Symptom(words, tuple(panels))


def session(base: Model, changed: Model, minutes: float = 5.0, speed: float = 0.5) -> Symptom:
    """Fast strokes through a session: mean torque over time."""
    times = np.linspace(0.0, 60.0 * minutes, 31)
    t = fine_time(0.3)
    theta = (0.1 + speed * t) / RATIO
    lines = [
        Line(WITH if effect else WITHOUT, times, np.array([float(np.mean(needed(model, theta, s)[50:-2])) for s in times]), effect)
        for effect, model in ((False, base), (True, changed))
    ]
    return Symptom(
        f"a stroke at {1e3 * speed:g} mm/s every ten seconds: its mean torque over the session",
        (Panel("time since the start in s", "torque in mN m", tuple(lines)),),
    )


def scale(changed: Model) -> Symptom:
    """A ruler at the carriage against the motor angle."""
    theta = np.linspace(0.0, 0.5 / RATIO, 200)
    effect = effect_named("feed_constant")
    assert effect.law is not None
    ahead = np.array([effect.law(float(angle), changed["feed_constant.error"]) for angle in theta])
    lines = (
        Line(WITHOUT, 1e3 * RATIO * theta, 0.0 * theta, False),
        Line(WITH, 1e3 * RATIO * theta, 1e3 * RATIO * ahead, True),
    )
    return Symptom(
        "slow travel with a scale at the carriage: what the scale shows more than the motor angle says",
        (Panel("way by the motor angle in mm", "difference in mm", lines),),
    )
