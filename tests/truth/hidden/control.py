"""Gains of the drive's cascade: as fast as the linear machine allows, effects included, found on its frequency response."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from truth.hidden import laws, recorder
from truth.hidden import layout as at
from truth.hidden.instruments import Instruments
from truth.hidden.layout import Array
from truth.hidden.machines import Machine

Complex = NDArray[np.complex128]

#: Hz, low-pass on the speed that the controller forms of the angle.
SPEED_LOWPASS_HZ = 250.0
#: Largest sensitivity that the loop may have anywhere.
LARGEST_SENSITIVITY = 2.0
#: Share of the peak torque that one count of the encoder may ask for through the speed; coarse encoders have softer loops.
MOST_COUNT = 0.05
#: Multiples of the sample rate, on either side, whose modes are folded back into the sampled response.
IMAGES = 4
#: Hz, the speed loop is no faster than this on the motor alone.
FASTEST_HZ = 60.0


def dynamic_stiffness(freq_hz: Array, place_m: float, p: Array) -> tuple[Complex, Complex]:
    """Torque per motor angle of the machine without friction (N m/rad), and belt force at the motor pulley per angle (N/rad).

    freq_hz : (n,).   place_m : of the carriage.   Closed form of the linear parts of :mod:`truth.hidden.kernel`.
    """
    s = 2j * math.pi * freq_hz
    k1, k2, k3, d1, d2, d3 = laws.spans(place_m, p)
    z1, z2, z3 = k1 + d1 * s, k2 + d2 * s, k3 + d3 * s
    if p[at.K_CREEP] > 0.0:
        z1 = z1 + p[at.K_CREEP] * s * p[at.CREEP_TIME] / (1.0 + s * p[at.CREEP_TIME])
    cart = p[at.M] * s**2 + p[at.DRAG] * s
    if p[at.M2] > 0.0 and p[at.K_PAYLOAD] > 0.0:
        spring, own = p[at.K_PAYLOAD] + p[at.D_PAYLOAD] * s, p[at.M2] * s**2
        cart = cart + spring * own / (spring + own)
    elif p[at.M2] > 0.0:
        cart = cart + p[at.M2] * s**2
    idler = np.zeros_like(s)
    if p[at.TOPOLOGY] == at.HEAVY_IDLER:
        idler = p[at.ME] * s**2
    if p[at.TOPOLOGY] != at.TWO_STRANDS:
        idler = idler + p[at.IDLER_DRAG] * s
    # (z1 + z2 + cart) x - z2 e = z1 u ;  -z2 x + (z2 + z3 + idler) e = z3 u, for u = 1
    a, b = z1 + z2 + cart, z2 + z3 + idler
    x = (z1 * b + z2 * z3) / (a * b - z2**2)
    e = (z3 + z2 * x) / b
    r = p[at.LEVER]
    force = (z1 * (1.0 - x) + z3 * (1.0 - e)) * r
    return p[at.J] * s**2 + p[at.VISCOUS] * s + r * force, force


def torque_path(freq_hz: Array, p: Array, instruments: Instruments | None = None) -> Complex:
    """Setpoint to torque at the shaft: delay (1 ms) and filters of the drive, hold, the hidden dead time and lag."""
    instruments = instruments or Instruments.ideal()
    s = 2j * math.pi * freq_hz
    path = np.exp(-s * (instruments.delay_s + 0.5 * instruments.period_s + p[at.DEAD_TIME])) * np.sinc(freq_hz * instruments.period_s)
    if instruments.shaped:
        path = path * instruments.filtering(freq_hz)
    return path / ((1.0 + s * p[at.LAG]) * (1.0 + s * p[at.LAG_SECOND]))


def notch_at(freq_hz: float, period_s: float) -> Array:
    """Coefficients B0, B1, B2, A1, A2 of a wide notch by Tustin's rule with prewarping."""
    w = math.tau * freq_hz
    g = w / math.tan(0.5 * w * period_s)
    narrow, wide = 2.0 * 0.08 * w * g, 2.0 * 0.9 * w * g
    a0 = g * g + wide + w * w
    return np.array([g * g + narrow + w * w, 2 * (w * w - g * g), g * g - narrow + w * w, 2 * (w * w - g * g), g * g - wide + w * w]) / a0


def folded(freq_hz: Array, place_m: float | None, machine: Machine) -> Complex:
    """Setpoint to angle at frequencies of either sign; ``None`` for the motor alone."""
    p, s = machine.p, 2j * math.pi * freq_hz
    stiffness = p[at.J] * s**2 + p[at.VISCOUS] * s if place_m is None else dynamic_stiffness(freq_hz, place_m, p)[0]
    return torque_path(freq_hz, p, machine.instruments) / stiffness


def gains_for(machine: Machine, integral: bool) -> Array:
    """Vector of gains for the recorder: the fastest cascade whose sensitivity stays below 2 at three places."""
    base, p, period = machine.base, machine.p, machine.instruments.period_s
    rate = recorder.PERIOD_S / period
    freq = np.concatenate((np.geomspace(0.05, 20.0, 1500), np.arange(20.1, 480.0 * rate, 0.1)))  # far finer than any mode is wide
    s = 2j * math.pi * freq
    z = np.exp(s * period)
    notch = np.array([1.0, 0.0, 0.0, 0.0, 0.0])
    if not base.rigid:
        peak = np.abs(1.0 / dynamic_stiffness(freq, 0.5 * base.stroke_m, p)[0]) * freq**2
        above = freq > 1.3 * base.antiresonance_hz
        notch = notch_at(min(float(freq[above][np.argmax(peak[above])]), 400.0 * rate), period)
    filtering = 1.0 - math.exp(-math.tau * SPEED_LOWPASS_HZ * period)
    speed = (1.0 - 1.0 / z) / period * filtering / (1.0 - (1.0 - filtering) / z)
    shape = (notch[0] + notch[1] / z + notch[2] / z**2) / (1.0 + notch[3] / z + notch[4] / z**2)
    if period > recorder.PERIOD_S:  # modes near half the rate: what the samples show of them is folded back
        images = [freq + k / period for k in range(-IMAGES, IMAGES + 1)]
        plants = [sum(folded(image, place * base.stroke_m, machine) for image in images) for place in (0.1, 0.5, 0.9)]
        if p[at.GAP] > 0.0 or p[at.SLACK_SHARE] > 0.0:
            plants.append(sum(folded(image, None, machine) for image in images))
    else:
        shape = shape * torque_path(freq, p, machine.instruments)
        plants = [1.0 / dynamic_stiffness(freq, place * base.stroke_m, p)[0] for place in (0.1, 0.5, 0.9)]
        if p[at.GAP] > 0.0 or p[at.SLACK_SHARE] > 0.0:
            plants.append(1.0 / (p[at.J] * s**2 + p[at.VISCOUS] * s))  # the motor alone, inside the gap

    def cascade(kd: float) -> tuple[float, float, float]:
        position_rate = kd / (2.5 * machine.rigid_inertia_kg_m2)
        return kd * position_rate, kd, kd * position_rate * 0.35 * position_rate if integral else 0.0

    best = cascade(1e-3 * p[at.J] * math.tau * FASTEST_HZ)
    for kd in np.geomspace(best[1], 1e3 * best[1], 120):
        kp, _, ki = cascade(float(kd))
        feedback = (kd * speed + kp + ki / s) * shape
        if max(float(np.max(np.abs(1.0 / (1.0 + feedback * plant)))) for plant in plants) > LARGEST_SENSITIVITY:
            break
        if kd * filtering * base.quantum_rad / period > MOST_COUNT * base.peak_torque_nm:
            break
        best = cascade(float(kd))
    gains = np.zeros(recorder.GAINS)
    gains[recorder.KP], gains[recorder.KD], gains[recorder.KI] = best
    gains[recorder.SPEED_FILTER], gains[recorder.LIMIT] = filtering, base.peak_torque_nm
    gains[recorder.B0 : recorder.A2 + 1] = notch
    gains[recorder.QUANTUM], gains[recorder.PERIOD] = base.quantum_rad, period
    return gains


def centring_for(machine: Machine) -> Array:
    """Weak centring of 0.6 Hz for records with an open-loop excitation."""
    period = machine.instruments.period_s
    gains = np.zeros(recorder.GAINS)
    w = math.tau * 0.6
    gains[recorder.KP] = machine.rigid_inertia_kg_m2 * w**2
    gains[recorder.KD] = 1.4 * machine.rigid_inertia_kg_m2 * w
    gains[recorder.SPEED_FILTER], gains[recorder.LIMIT] = 1.0 - math.exp(-math.tau * 10.0 * period), machine.base.peak_torque_nm
    gains[recorder.B0], gains[recorder.QUANTUM], gains[recorder.PERIOD] = 1.0, machine.base.quantum_rad, period
    return gains
