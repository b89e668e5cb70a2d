"""Can the motor see it?  What the hidden effect leaves in the torque of a noise-free session after the best healthy machine.

A healthy machine (seven parameters, set-valued belt axis without effects) explains the torque from the shown angle: the
linear part by its dynamic stiffness on the spectrum of the speed, the friction by its bristle.  What remains is divided by
the noise of torque and encoder on every line up to 250 Hz; its sum of squares is the information that any method has,
whatever it fits.  This is physics of the draw and of the plan, not a diagnosis: no noise, no candidate, no search.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
import scipy.fft
from scipy.optimize import least_squares

from truth.hidden import control, laws
from truth.hidden import layout as at
from truth.hidden.compilation import compiled
from truth.hidden.layout import Array
from truth.hidden.machines import Base, Machine
from truth.hidden.recorder import PERIOD_S
from truth.hidden.session import SUBSTEP_S, Record, run_session
from truth.hidden.signals import HIGHEST_SHARE

#: Instants per sample of 1 ms at which the angle is looked at.
PER_SAMPLE = round(PERIOD_S / SUBSTEP_S)
HIGHEST_HZ = 250.0
#: Sum of squares below which an effect counts as invisible: three parameters cost 3 ln(100 000) = 35, chance twice its root.
LEAST_INFORMATION = 100.0

Complex = np.ndarray[tuple[int, ...], np.dtype[np.complex128]]


@dataclass(frozen=True)
class Visibility:
    """information : sum of squares over the noise that no healthy machine explains.   beyond_twin : the same when the twin of
    the effect is fitted too, None without a twin.   visible : whether ``information`` suffices.   reason : in words.
    """

    information: float
    beyond_twin: float | None
    visible: bool
    reason: str


@dataclass(frozen=True)
class Spectra:
    """Lines up to 250 Hz of all records one after the other, (n,): frequency, speed, friction by unit level, micro-damping by
    unit coefficient, torque, constant torque, 1/noise.   starts : where each record begins, and n.
    """

    freq_hz: Array
    speed: Complex
    friction: Complex
    micro: Complex
    torque: Complex
    constant: Complex
    weight: Array
    starts: tuple[int, ...]


@compiled
def _bristle(angle: Array, step_s: float, level: float, stiffness: float, micro_speed: float, force: float) -> tuple[Array, Array]:
    """Bristle force over level, and its micro-damping per coefficient (rad/s), along an angle, (n,).   force : at first."""
    z, speeds = np.empty(angle.shape[0]), np.empty(angle.shape[0])
    z[0], speeds[0] = force / level, 0.0
    for i in range(1, angle.shape[0]):
        way = angle[i] - angle[i - 1]
        force = laws.bristle(force, way, level, stiffness)
        z[i] = force / level
        w = way / step_s
        speeds[i] = w * (1.0 - z[i] * math.copysign(1.0, w)) * math.exp(-min((w / micro_speed) ** 2, 50.0))
    return z, speeds


def instants(machine: Machine) -> int:
    """Instants per sample at which the angle of a machine is looked at: every 40 us, whatever its sample period."""
    return round(PER_SAMPLE * machine.instruments.period_s / PERIOD_S)


def _spectra(record: Record, machine: Machine) -> Spectra:
    """Transform a record; the angle goes from rest to rest, so its speed is periodic."""
    base, instruments, per_sample = machine.base, machine.instruments, instants(machine)
    period = instruments.period_s
    angle, samples = record.fine, len(record.acting_nm)
    n, step = len(angle), period / per_sample
    lines = math.floor(min(HIGHEST_HZ, HIGHEST_SHARE / period) * samples * period) + 1
    x = np.arange(n) / n
    rise = x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3)
    slope = 140.0 * x**3 * (1.0 - x) ** 3 / (n * step)
    whole = angle[-1] - angle[0]
    freq = np.arange(lines) / (n * step)
    speed = 2j * math.pi * freq * _lines(angle - angle[0] - whole * rise, lines, per_sample) + whole * _lines(slope, lines, per_sample)
    p = base.vector()
    start = min(max(record.bristle_nm, -base.coulomb_nm), base.coulomb_nm)
    z, micro = _bristle(angle, step, base.coulomb_nm, p[at.BRISTLE], p[at.MICRO_SPEED], start)
    held = np.exp(-1j * math.pi * freq * step)  # the torque acts on from each instant to the next
    torque, constant = held * _lines(record.fine_torque, lines, per_sample), np.zeros(lines, dtype=complex)
    constant[0] = samples
    stiffness = np.zeros(lines)
    stiffness[1:] = np.abs(control.dynamic_stiffness(freq[1:], 0.5 * base.stroke_m, p)[0])
    known = instruments.process_share * base.rated_torque_nm
    noise = samples * (known**2 + base.torque_noise_nm**2 + stiffness**2 * base.quantum_rad**2 / 12.0)
    spectra = speed, _lines(z, lines, per_sample), _lines(micro, lines, per_sample), torque, constant
    return Spectra(freq, *spectra, np.sqrt(2.0 / noise), (0, lines))


def spectra_of(records: Iterable[Record], machine: Machine) -> Spectra:
    """The lines of all records of a machine one after the other."""
    parts = [_spectra(record, machine) for record in records]
    starts = np.cumsum([0, *(len(part.freq_hz) for part in parts)])
    names = [item.name for item in fields(Spectra) if item.name != "starts"]
    columns = [np.concatenate([getattr(part, name) for part in parts]) for name in names]
    return Spectra(*columns, tuple(int(k) for k in starts))


def _lines(signal: Array, lines: int, per_sample: int) -> Complex:
    """The first lines of the spectrum, scaled to samples of the record."""
    return np.asarray(scipy.fft.rfft(signal)[:lines] / per_sample)


def _residual(factors: Array, one: Spectra, base: Base, twin: str, size: float) -> Array:
    """Whitened torque error of a healthy machine.

    factors : logarithms of the factors on J, m, b, drag, k, d, Fc, then the twin's own parameter over ``size``.
    """
    p = base.vector()
    for place, factor in zip((at.J, at.M, at.VISCOUS, at.DRAG), np.exp(factors[:4]), strict=True):
        p[place] *= factor
    p[[at.K1, at.K2, at.K3]] *= math.exp(factors[4])
    p[[at.D1, at.D2, at.D3]] *= math.exp(factors[5])
    p[at.COULOMB] *= math.exp(factors[6])
    torque = one.torque
    s = 2j * math.pi * one.freq_hz
    if twin == "dead_time":
        torque = torque * np.exp(-s * size * factors[7])
    elif twin == "current_lag":
        torque = torque / (1.0 + s * size * factors[7])
    elif twin == "constant_offset":
        torque = torque + one.constant * size * factors[7]
    return unexplained(p, torque, one, 0.5 * base.stroke_m)


def unexplained(p: Array, torque: Complex, one: Spectra, place_m: float) -> Array:
    """Torque error over the noise on all lines, real and imaginary parts, of the linear machine p with its bristle.

    torque : of the lines, (n,), N m, at the shaft.   place_m : of the carriage.
    """
    freq = np.maximum(one.freq_hz, 1e-3)  # at rest only the drag is left of the stiffness
    error = control.dynamic_stiffness(freq, place_m, p)[0] / (2j * math.pi * freq) * one.speed - torque
    error += p[at.COULOMB] * one.friction + p[at.MICRO] * one.micro
    white = error * one.weight
    # a carriage that still swings on its belt when a record begins or ends leaves two shapes with it
    s = 2j * math.pi * one.freq_hz
    k, d = p[at.K1] + p[at.K2] * p[at.K3] / (p[at.K2] + p[at.K3]), p[at.D1] + p[at.D2] * p[at.D3] / (p[at.D2] + p[at.D3])
    swing = one.weight * (k + d * s) / (p[at.M] * s**2 + p[at.DRAG] * s + k + d * s)
    for begin, end in pairwise(one.starts):
        part = slice(begin, end)
        shapes = np.column_stack((swing[part], swing[part] * s[part] / (math.tau * 100.0)))
        normal = np.real(shapes.conj().T @ shapes)
        white[part] -= shapes @ np.linalg.solve(normal, np.real(shapes.conj().T @ white[part]))
    return np.concatenate((white.real, white.imag))


#: What is nearly the same for the motor, and the size of its parameter: fitted in addition for ``beyond_twin``.
TWINS = {"cable_chain": ("constant_offset", 0.01), "dead_time": ("current_lag", 1e-3), "current_lag": ("dead_time", 1e-3)}


def _least(spectra: Spectra, base: Base, heavier: tuple[float, ...], twin: str = "", size: float = 0.0) -> float:
    """Smallest sum of squares that a healthy machine leaves, to a thousandth.

    heavier : logarithms of the carriage masses to start from, one after the other while the effect is not plainly visible.
    """
    best = math.inf
    for mass in heavier:
        if best > 1000.0 * LEAST_INFORMATION and math.isfinite(best):
            break
        start = np.zeros(8 if twin else 7)
        start[1] = mass
        found = least_squares(_residual, start, "2-point", (-3.0, 3.0), ftol=1e-3, max_nfev=15, args=(spectra, base, twin, size))
        best = min(best, 2.0 * float(found.cost))
    return best


def information_in(spectra: Spectra, machine: Machine) -> tuple[float, float | None]:
    """``information`` and ``beyond_twin`` of :class:`Visibility`."""
    more_mass = {"end_pulley", "payload_mode", "payload_impact"} & set(machine.effects)
    heavier = (0.0, 0.3, 0.8) if more_mass else (0.0,)
    information = _least(spectra, machine.base, heavier)
    beyond = None
    if len(machine.effects) == 1 and machine.effects[0] in TWINS:
        beyond = _least(spectra, machine.base, heavier, *TWINS[machine.effects[0]])
    return information, beyond


def visibility(machine: Machine, plan: str = "thorough") -> Visibility:
    """What the motor can see of the effects of a machine in a plan; takes a few seconds."""
    spectra = spectra_of(run_session(machine, plan, fine=instants(machine)), machine)
    information, beyond = information_in(spectra, machine)
    visible = information >= LEAST_INFORMATION or machine.effects == ("belt_damping",)
    if machine.effects == ("belt_damping",):
        reason = "every machine has belt damping; it is seen when the base model lacks it"
    elif not machine.effects:
        reason = "healthy machine"
    elif visible:
        reason = f"leaves {information:.0f} after the best healthy machine; {LEAST_INFORMATION:.0f} are needed"
    else:
        reason = f"leaves only {information:.1f} after the best healthy machine, below {LEAST_INFORMATION:.0f}: the motor cannot tell"
        hidden = machine.hidden.get("end_pulley")
        if hidden:
            unison = machine.base.mass_kg * 2.0 * hidden["alpha"] / (1.0 - hidden["alpha"])
            reason += f"; at an idler mass of about {unison:.2f} kg ({hidden['mass_kg']:.2f} drawn) idler and carriage swing in unison"
    return Visibility(information, beyond, visible, reason)
