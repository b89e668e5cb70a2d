"""Apparent damping at standstill: why a frequency response shows much more than a sweep at constant speed has viscous friction.

Coulomb friction M sign(ω) answers a motion that reverses with a force in phase with the speed.  Of all gains the one that is nearest to
it in the mean square is

    d = M E|ω| / E ω²,      for a sine of amplitude Ω:   d = 4 M / (π Ω)

so a response takes it for a damper, the stronger the smaller the motion (Krylov, Bogoliubov; thesis.md 2.7).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from beltcomm.arrays import Array, rms
from beltcomm.errors import BeltcommError, DataError
from beltcomm.fit.noise.level import torque_noise
from beltcomm.fit.residual.segment import segments
from beltcomm.identify.friction import FrictionFit
from beltcomm.identify.magnitude_fit import MagnitudeFit, fit_magnitude
from beltcomm.model import Model
from beltcomm.model.value import Value
from beltcomm.recording import Recording
from beltcomm.response import estimate_response
from beltcomm.simulate.forward import integrate_torque
from beltcomm.simulate.inverse import fine_load

#: A motion whose mean speed is above this share of its rms is not around standstill.
MOVING_SHARE = 0.5
#: Effects of a model that are Coulomb friction, as simulated without it.
COULOMB = ("coulomb.level", "cart_friction.level")


@dataclass(frozen=True)
class Standstill:
    """Damping of one record around standstill, seen and predicted, beside the viscous friction of a sweep; all N m s/rad at the motor.

    Attributes
    ----------
    seen : Value
        i_t² (d_m + d_c) of the log-magnitude fit.
    seen_parts : tuple of float
        Of motor and carriage.
    sweep : Value
        Viscous friction of (3.36).
    speed_rad_s : tuple of float
        Ω of motor and of carriage, at the motor: amplitude of the sine with the same E ω²/E|ω|.
    coulomb_nm : tuple of float
        Of both.
    predicted : Value
        Viscous friction and 4 M/(π Ω) of both parts; its interval knows the friction's, not how good one gain is.
    predicted_parts : tuple of float
        4 M/(π Ω) of motor and carriage.
    at_motor : float
        Viscous friction and 4 M/(π Ω) of all of it at the motor's speed.
    modelled, without_coulomb : float or None
        What the same fit shows of the model, under the record's torque, with and without its Coulomb friction; None where it could not be
        simulated.
    """

    record: str
    seen: Value
    seen_parts: tuple[float, float]
    sweep: Value
    speed_rad_s: tuple[float, float]
    coulomb_nm: tuple[float, float]
    predicted: Value
    predicted_parts: tuple[float, float]
    at_motor: float
    modelled: float | None
    without_coulomb: float | None

    @property
    def ratio(self) -> float:
        """Damping seen over viscous friction; infinite where the sweep found none."""
        return self.seen.value / self.sweep.value if self.sweep.value > 0.0 else np.inf

    @property
    def contradiction(self) -> bool:
        """True if the response shows more damping than the sweep, beyond both intervals."""
        return self.seen.value - (self.seen.interval or 0.0) > self.sweep.value + (self.sweep.interval or 0.0)


def _sine_amplitude(speed: Array) -> float:
    """Ω = (4/π) E ω²/E|ω| : the amplitude of the sine for which Coulomb friction is the same damper as for this motion.

    Raises DataError for no motion.
    """
    mean = float(np.mean(np.abs(speed)))
    if not mean > 0.0:
        raise DataError("nothing moves in this record, so friction has no gain; excite louder than friction")
    return 4.0 / np.pi * float(np.mean(speed**2)) / mean


def _friction_as_damping(level: float, amplitude: float) -> float:
    """d = 4 M/(π Ω), describing function of Coulomb friction M, N m or N, at the amplitude Ω of speed, rad/s or m/s."""
    return 4.0 * level / (np.pi * amplitude)


def _motion_of(recording: Recording, model: Model) -> tuple[Array, Array]:
    """Speed of motor and of carriage, both rad/s at the motor, on a fine grid, from the first measured period on.

    The carriage follows the measured motor angle through the model's belt.   Raises DataError for a record too short.
    """
    note = recording.sidecar.excitation
    first = float(recording.t_s[note.first_sample if note is not None else 0])
    step = float(np.min(np.abs(np.diff(recording.position)[np.diff(recording.position) != 0.0]), initial=np.inf))
    motor, cart = list[Array](), list[Array]()
    begun = (recording.sidecar.session_time_s or 0.0) - float(recording.t_s[0])
    for stretch in segments(recording, model, step, torque_noise([recording]), fitted=True):
        h = stretch.motion.sample_s / stretch.motion.substeps
        _, place = fine_load(model, stretch.motion)
        counted = stretch.motion.time_s - begun + h * np.arange(len(place)) >= first
        motor.append(stretch.motion.omega[counted])
        cart.append((np.gradient(place, h) / model["transmission.ratio"])[counted])
    if not motor:
        raise DataError(f"{recording.name} has no stretch without gaps that is long enough")
    return np.concatenate(motor), np.concatenate(cart)


def _standstill_of(recording: Recording, fit: MagnitudeFit, model: Model, sweep: FrictionFit) -> Standstill:
    """Both dampings of one record, and what Coulomb friction explains of their difference.

    ``model`` splits the friction between motor and carriage, as far as it knows it; its sum is that of the sweep.
    Raises DataError for a record that is not around standstill.
    """
    motor, cart = _motion_of(recording, model)
    if abs(float(np.mean(motor))) > MOVING_SHARE * rms(motor):
        raise DataError(f"{recording.name} was made in motion, not around standstill: friction does not reverse there")
    ratio = model["transmission.ratio"]
    levels = np.array([model.get(COULOMB[0]), ratio * model.get(COULOMB[1])])
    share = levels / levels.sum() if levels.sum() > 0.0 else np.array([1.0, 0.0])
    coulomb, viscous = sweep.coulomb, sweep.viscous
    amplitudes = _sine_amplitude(motor), _sine_amplitude(cart)
    gains = np.array([_friction_as_damping(part, omega) for part, omega in zip(share, amplitudes, strict=True)])
    uncertain = float(gains.sum()) * (coulomb.interval or 0.0) + (viscous.interval or 0.0)
    predicted = viscous.value + float(gains.sum()) * coulomb.value
    return Standstill(
        recording.name,
        _apparent(fit),
        _parts(fit),
        viscous,
        amplitudes,
        (float(share[0] * coulomb.value), float(share[1] * coulomb.value)),
        Value(predicted, "N m s/rad", "motor", 0.0, np.inf, uncertain, "describing function"),
        (float(gains[0] * coulomb.value), float(gains[1] * coulomb.value)),
        viscous.value + _friction_as_damping(coulomb.value, amplitudes[0]),
        _apparent_damping(model, recording, fit),
        _apparent_damping(model.with_values({name: 0.0 for name in COULOMB if name in model.parameters}), recording, fit),
    )


def _parts(fit: MagnitudeFit) -> tuple[float, float]:
    """i_t² d_m and i_t² d_c of a log-magnitude fit, N m s/rad at the motor."""
    two = fit.two_mass
    return two.transmission_m_rad**2 * two.motor_damping_n_s_m, two.transmission_m_rad**2 * two.cart_damping_n_s_m


def _apparent(fit: MagnitudeFit) -> Value:
    """i_t² (d_m + d_c), N m s/rad at the motor shaft, from both intervals and their correlation; infinite where one is not determined."""
    names = ("motor_damping_n_s_m", "cart_damping_n_s_m")
    half = np.array([fit.parameters[name].interval or 0.0 for name in names])
    both = [fit.names.index(name) for name in names if name in fit.names]
    correlation = float(fit.correlation[both[0], both[1]]) if len(both) == 2 else 0.0
    square = float(half @ half + 2.0 * correlation * half[0] * half[1]) if np.all(np.isfinite(half)) else np.inf
    interval = fit.transmission_m_rad**2 * float(np.sqrt(max(square, 0.0)))
    return Value(sum(_parts(fit)), "N m s/rad", "motor", 0.0, np.inf, interval, "log-magnitude fit")


def _apparent_damping(model: Model, recording: Recording, fit: MagnitudeFit) -> float | None:
    """The apparent damping of a model under the torque of a record; None where it cannot be simulated or fitted."""
    note = recording.sidecar.excitation
    if note is None or not note.period_samples or len(recording.gaps):
        return None
    still: dict[str, Any] = {name: 0.0 for name in ("constant_offset.torque", "tilt.angle") if name in model.parameters}
    period = recording.sample_period_s
    place = recording.sidecar.start_position_m or 0.0
    try:
        moved = integrate_torque(model.with_values(still), recording.torque - float(np.mean(recording.torque)), period, place)
        response = estimate_response(recording.torque, moved.position_rad, period, note.period_samples, note.first_sample)
        return sum(_parts(fit_magnitude(response, model["transmission.ratio"], model["motor.inertia"], solver=fit.solver)))
    except BeltcommError:
        return None


def largest(
    recordings: Sequence[Recording], fits: Mapping[str, MagnitudeFit], model: Model, sweep: FrictionFit | None
) -> Standstill | None:
    """Of the records with the largest apparent damping first, the first one around standstill.

    Parameters
    ----------
    recordings : sequence of Recording
    fits : mapping of str to MagnitudeFit
        By record.
    model : Model
        With a belt.
    sweep : FrictionFit or None
        Friction of the moving axis.

    Returns
    -------
    Standstill or None
        None without any, or without a sweep.
    """
    if sweep is None:
        return None
    by_name = {r.name: r for r in recordings}
    for name in sorted(fits, key=lambda n: -_apparent(fits[n]).value):
        try:
            return _standstill_of(by_name[name], fits[name], model, sweep)
        except DataError:
            continue
    return None
