"""What an effect looks like: one experiment per effect, simulated with it and without it on the shipped heavy rig g_a.

Numbers only; ``docs/make.py`` draws them.  No noise, so that nothing but the effect differs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from beltcomm.effects import effect_named
from beltcomm.excitation.binary import prbs
from beltcomm.linear import Oscillation, operating_point, sampled_response
from beltcomm.model import Model, build_model, load_plant
from beltcomm.response import estimate_response, log_spaced_lines
from beltcomm.simulate.forward import simulate_torque
from beltcomm.simulate.inverse import FineMotion, torque_residual

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
        reported = reported + torque_residual(model, moved, reported)
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


def by_angle(base: Model, changed: Model, cases: Mapping[str, tuple[float, float]], words: str) -> Symptom:
    """Torque over turns of the motor.   cases : by label, (speed m/s, acceleration m/s²) at the start."""
    panels = []
    for label, (speed, acceleration) in cases.items():
        t = fine_time(math.sqrt(0.6 / acceleration) if acceleration else min(0.42 / speed, 4.0))
        x = 0.02 + speed * t + 0.5 * acceleration * t * t
        turns = (x - x[0])[::FINE] / RATIO / (2.0 * math.pi)
        lines = [
            line(WITH if effect else WITHOUT, effect, turns, needed(model, x / RATIO)) for effect, model in ((False, base), (True, changed))
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


@cache
def shaft_rig(*effects: str) -> Model:
    """A motor that turns a load through a shaft."""
    values = {
        "motor.inertia": 7.2e-5,
        "transmission.ratio": RATIO,
        "viscous.damping": 2.53e-3,
        "coulomb.level": 0.06,
        "elastic_shaft.stiffness": 6.0,
        "elastic_shaft.damping": 0.01 if effects == ("elastic_shaft",) else 0.03,
        "load.inertia": 1.2e-4,
        "viscous_load.damping": 4e-3,
        "coulomb_load.level": 0.05,
    }
    names = ("viscous", "coulomb", *effects)
    chosen = {key: value for key, value in values.items() if key.split(".")[0] in ("motor", "transmission", *names)}
    if "elastic_shaft" in names:
        chosen["load.inertia"] = values["load.inertia"]
    else:
        chosen["motor.inertia"] += values["load.inertia"]
    return build_model("shaft", names, chosen, base_bodies=("motor",))


def in_sections(with_coupling: bool) -> Model:
    """The three masses of the data sheets; without the coupling the pulley turns with the motor."""
    model = load_plant("egc_70").model
    if with_coupling:
        return model
    inertia = model["motor.inertia"] + model["driving_pulley.inertia"]
    return model.without_effect("coupling").with_values({"motor.inertia": inertia})


def calm_sections() -> Model:
    """The same with a belt that damps strongly, without the coupling."""
    return in_sections(False).with_values({"belt_sections.specific_damping": 500.0})


def with_spans(model: Model) -> Model:
    """The rig with the lengths of its belt."""
    return having("belt_spans", model.without_effect("belt_stiffness"), specific_stiffness=5.2e4, pulley_distance=0.79, offset=0.05)


def all_at_motor() -> Model:
    """The rig with the friction of its carriage at the motor."""
    model = without("cart_friction")
    return model.with_values({"coulomb.level": model["coulomb.level"] + RATIO * rig()["cart_friction.level"]})


#: By effect; effects that share law and parameters with another share its picture.
SYMPTOMS: Mapping[str, Callable[[], Symptom]] = {
    "belt_stiffness": lambda: response(rig().with_values({"belt_stiffness.stiffness": 1e8, "belt_damping.damping": 2000.0}), rig()),
    "belt_spans": lambda: response_by_place(rig(), with_spans(rig())),
    "stiffness_position": lambda: response_by_place(
        rig(), having("stiffness_position", share=0.8, offset=0.05, pulley_distance=0.79, middle=0.25)
    ),
    "belt_sections": lambda: response(
        with_spans(rig()),
        having(
            "belt_sections",
            without("belt_stiffness", "belt_damping"),
            specific_stiffness=5.2e4,
            pulley_distance=0.79,
            offset=0.05,
            specific_damping=5.0,
            mass=0.3,
        ),
    ),
    "end_pulley": lambda: response(rig(), having("end_pulley", share=0.3, mass=0.4)),
    "coupling": lambda: response(in_sections(False), in_sections(True).with_values({"coupling.stiffness": 40.0})),
    "elastic_shaft": lambda: response(shaft_rig(), shaft_rig("elastic_shaft")),
    "payload_mode": lambda: response(
        rig(),
        having("payload_mode", rig().with_values({"cart.mass": 9.44}), mass=4.0, stiffness=4.0 * (2 * math.pi * 9.0) ** 2, damping=25.0),
    ),
    "belt_damping": lambda: response(rig().with_values({"belt_damping.damping": 5.0}), rig().with_values({"belt_damping.damping": 60.0})),
    "backlash": lambda: response_by_amplitude(slippery(), having("backlash", slippery(), gap=2e-4), 0.4, 1.5),
    "belt_slack": lambda: response_by_amplitude(slippery(), having("belt_slack", slippery(), limit=4e-4, share=0.5), 0.2, 1.5),
    "viscous": lambda: sweep(calm().without_effect("viscous"), calm()),
    "viscous_cart": lambda: sweep(calm(), having("viscous_cart", calm(), damping=12.0)),
    "viscous_end_pulley": lambda: sweep(calm_sections(), having("viscous_end_pulley", calm_sections(), damping=12.0)),
    "viscous_load": lambda: sweep(shaft_rig("elastic_shaft"), shaft_rig("elastic_shaft", "viscous_load")),
    "viscous_asymmetry": lambda: sweep(calm(), having("viscous_asymmetry", calm(), share=0.3)),
    "warmup": lambda: session(calm(), having("warmup", calm(), amount=0.5, time=60.0)),
    "quadratic_drag": lambda: sweep(calm(), having("quadratic_drag", calm(), factor=8.0)),
    "coulomb": lambda: sweep(calm().without_effect("coulomb"), calm()),
    "cart_friction": lambda: response_by_swing(all_at_motor(), rig()),
    "coulomb_end_pulley": lambda: sweep(calm_sections(), having("coulomb_end_pulley", calm_sections(), level=3.0)),
    "coulomb_load": lambda: sweep(shaft_rig("elastic_shaft"), shaft_rig("elastic_shaft", "coulomb_load")),
    "stribeck": lambda: sweep(calm(), having("stribeck", calm(), amount=0.04, speed_scale=2.5), 200),
    "friction_dip": lambda: sweep(
        calm().with_values({"coulomb.level": 0.0875}),
        having("friction_dip", calm().with_values({"coulomb.level": 0.0475}), amount=0.04, speed_scale=2.5),
        200,
    ),
    "friction_freeform": lambda: sweep(
        calm(),
        having(
            "friction_freeform",
            calm(),
            fastest=80.0,
            forward_1=0.03,
            forward_2=0.01,
            forward_3=-0.01,
            forward_4=0.02,
            forward_5=0.05,
            backward_1=0.02,
            backward_2=0.02,
            backward_3=0.0,
            backward_4=-0.02,
            backward_5=0.02,
        ),
    ),
    "holding_brake": lambda: strokes(calm(), having("holding_brake", calm(), sine=0.015, cosine=0.01)),
    "load_friction": lambda: move(calm(), having("load_friction", calm(), share=0.12)),
    "friction_position": lambda: strokes(calm(), having("friction_position", calm(), amount=0.04, place=0.27, width=0.03)),
    "presliding": lambda: reversals(calm(), having("presliding", calm(), length=4e-5)),
    "presliding_cart": lambda: reversals(
        calm().with_values({"coulomb.level": 0.02, "cart_friction.level": 8.0}),
        having("presliding_cart", calm().with_values({"coulomb.level": 0.02, "cart_friction.level": 8.0}), length=6e-5),
    ),
    "tilt": lambda: strokes(calm(), having("tilt", calm(), angle=0.03)),
    "constant_offset": lambda: strokes(calm(), having("constant_offset", calm(), torque=0.04)),
    "cable_chain": lambda: strokes(calm(), having("cable_chain", calm(), rate=15.0, offset=-3.0)),
    "cogging": lambda: strokes(calm(), having("cogging", calm(), order=12.0, sine=0.012, cosine=0.009), 0.02, 0.2, 0.3),
    "tooth_ripple": lambda: strokes(calm(), having("tooth_ripple", calm(), teeth=26.0, sine=0.01, cosine=0.006), 0.02, 0.2, 0.26),
    "travel_ripple": lambda: strokes(calm(), having("travel_ripple", calm(), period=0.01, sine=0.8, cosine=0.5), 0.02, 0.2, 0.3),
    "torque_ripple": lambda: by_angle(
        calm(),
        having("torque_ripple", calm(), order=6.0, sine=0.06, cosine=0.03),
        {"at 50 mm/s": (0.05, 0.0), "at 6 m/s²": (0.0, 6.0)},
        "torque over the motor angle, with little torque and with much",
    ),
    "torque_saturation": lambda: move(calm(), having("torque_saturation", calm(), loss=0.12, peak=3.2)),
    "dead_time": lambda: response(rig(), having("dead_time", time=1.5e-3)),
    "current_lag": lambda: response(rig(), having("current_lag", time=1.5e-3)),
    "measurement_lag": lambda: move(calm(), having("measurement_lag", calm(), time=8e-3)),
    "pulley_eccentricity": lambda: by_angle(
        calm(),
        having("pulley_eccentricity", calm(), sine=0.02, cosine=0.01),
        {"at 50 mm/s": (0.05, 0.0), "at 6 m/s²": (0.0, 6.0)},
        "torque over the motor angle, with little load and with much",
    ),
    "pulley_eccentricity_2": lambda: by_angle(
        calm(),
        having("pulley_eccentricity_2", calm(), sine=0.01, cosine=0.005),
        {"at 50 mm/s": (0.05, 0.0), "at 6 m/s²": (0.0, 6.0)},
        "torque over the motor angle, with little load and with much",
    ),
    "feed_constant": lambda: scale(having("feed_constant", error=0.004)),
    "encoder_eccentricity": lambda: by_angle(
        calm(),
        having("encoder_eccentricity", calm(), sine=0.004, cosine=0.002),
        {"at 0.5 m/s": (0.5, 0.0), "at 1 m/s": (1.0, 0.0)},
        "torque over the motor angle at two speeds",
    ),
    "encoder_eccentricity_2": lambda: by_angle(
        calm(),
        having("encoder_eccentricity_2", calm(), sine=0.001, cosine=0.0005),
        {"at 0.5 m/s": (0.5, 0.0), "at 1 m/s": (1.0, 0.0)},
        "torque over the motor angle at two speeds",
    ),
}
