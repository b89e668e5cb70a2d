"""Watch of every row of a closed loop, whatever it is for: the force in the belt, and swings around the resonance."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from beltcomm.arrays import Array
from beltcomm.axis import Axis
from beltcomm.control import Cascade
from beltcomm.drive import Drive, Motion, Row
from beltcomm.drive.parameters import LIMIT_NAMES
from beltcomm.errors import SafetyStop
from beltcomm.identify.landmarks import shape_of
from beltcomm.machine.envelope import Envelope
from beltcomm.machine.prediction_watch import BeltWatch
from beltcomm.model import Model
from beltcomm.simulate.stopping import total_friction, total_inertia, total_viscous
from beltcomm.trajectory import Trajectory
from beltcomm.verify import Loop, predict_move

#: The band: from this share of the lowest first resonance along the travel, but at most from that share of the sampling rate, up to what
#: rows can show: a loop that is too stiff or too late swings above the resonance as well, where no motion has a part.
BELOW, LOWEST_OF_RATE, HIGHEST_OF_RATE = 0.35, 0.2, 0.45
#: Order of the band-pass (each edge), and s over which its output's power is a mean.
ORDER, WINDOW_S = 2, 0.06
#: How much finer than their spacing the lines of a spectrum are drawn to read a frequency.
FINE = 8
#: What is allowed: so many times the predicted amplitude, and this share of the largest torque predicted, for what no model knows.
FACTOR, UNKNOWN_SHARE = 2.5, 0.05
#: Torque noise as a share of the rated torque (6077h is computed from a current), and how many times its mean power it may show.
NOISE_OF_RATED, NOISE_PEAK = 0.006, 2.0


@dataclass(frozen=True)
class Swing:
    """The band that is watched, Hz, and the amplitude of torque in it that is allowed, N m at the motor.

    Attributes
    ----------
    predicted_nm : float
        Of the motion.
    """

    band_hz: tuple[float, float]
    allowed_nm: float
    predicted_nm: float


def _band_of(model: Model, window_m: tuple[float, float], period_s: float) -> tuple[float, float]:
    """Around the first resonance at both ends of a window and above, Hz, as far as rows with this period can show it."""
    lowest = math.inf
    for place in window_m:
        shape = shape_of(model, place)
        lowest = min(lowest, math.inf if shape is None else shape.lowest_hz)
    return min(BELOW * lowest, LOWEST_OF_RATE / period_s), HIGHEST_OF_RATE / period_s


def _amplitude_nm(torque_nm: Array, period_s: float, band_hz: tuple[float, float]) -> Array:
    """Amplitude of a torque in a band over the last ``WINDOW_S``:  √(2 mean(τ_b²)),  (n,).   The first value counts as one held before."""
    from scipy.signal import sosfilt  # takes longer to import than a page of a report to draw

    filtered = sosfilt(_filter(period_s, band_hz), torque_nm - torque_nm[0])
    rows = _rows(period_s)
    power = np.cumsum(np.concatenate([np.zeros(rows), filtered**2]))
    return np.asarray(np.sqrt(2.0 * np.maximum(power[rows:] - power[:-rows], 0.0) / rows))


def _predicted_torque(model: Model, cascade: Cascade, motion: Motion, drive: Loop, ratio: float, origin_rad: float) -> Array:
    """Torque setpoint of the drive's loop along a motion that is asked for, N m, one entry per row; the carriage stands at 0 at the angle
    ``origin_rad``.
    """
    if motion.kind == "velocity":  # the same cascade without its position loop
        cascade = replace(cascade, kpp_1_s=0.0, feedforward=replace(cascade.feedforward, velocity=1.0))
        drive = replace(drive, structure=replace(drive.structure, output_limit_rad_s=math.inf, dead_zone_rad=0.0))
    times: Array = motion.period_s * np.arange(len(motion.torque_nm), dtype=np.float64)
    lead: Array | float = 0.0 if motion.lead_rad is None else motion.lead_rad
    position, speed = ratio * (motion.position_rad + lead - origin_rad), ratio * motion.velocity_rad_s
    path = Trajectory(times, position, speed, np.zeros(len(times)))
    along = motion.torque_nm if motion.torque_nm.any() else None
    return predict_move(model, cascade, path, drive, extra_torque_nm=along).torque_nm


def _allowed(torque_nm: Array, period_s: float, band_hz: tuple[float, float], rated_nm: float) -> Swing:
    """Part of a predicted torque that lies in a band, and what is allowed there."""
    within = float(np.max(_amplitude_nm(torque_nm, period_s, band_hz)))
    share = 2.0 * period_s * (band_hz[1] - band_hz[0])
    noise = NOISE_PEAK * math.sqrt(2.0 * share) * NOISE_OF_RATED * rated_nm
    return Swing(band_hz, FACTOR * within + UNKNOWN_SHARE * float(np.max(np.abs(torque_nm))) + noise, within)


class ResonanceWatch:
    """Call it with every row of a closed loop; some 3 us each.   Raises SafetyStop with amplitude and frequency."""

    def __init__(self, swing: Swing, period_s: float) -> None:
        self.swing, self.period_s = swing, period_s
        self._sections = [tuple(float(x) for x in (b0, b1, b2, a1, a2)) for b0, b1, b2, _, a1, a2 in _filter(period_s, swing.band_hz)]
        self._rows = _rows(period_s)
        self._limit = 0.5 * swing.allowed_nm**2 * self._rows
        self._first: float | None = None
        self._states = [[0.0, 0.0] for _ in self._sections]
        self._band: deque[float] = deque([0.0] * self._rows, self._rows)
        self._longer: deque[float] = deque(maxlen=3 * self._rows)  # to tell a frequency from
        self._power = 0.0

    def __call__(self, row: Row) -> None:
        """One row as the drive gives it."""
        if self._first is None:
            self._first = row[1]
        value = row[1] - self._first
        for (b0, b1, b2, a1, a2), state in zip(self._sections, self._states, strict=True):
            out = b0 * value + state[0]
            state[0] = b1 * value - a1 * out + state[1]
            state[1] = b2 * value - a2 * out
            value = out
        oldest = self._band[0]
        self._band.append(value)
        self._longer.append(value)
        self._power += value * value - oldest * oldest
        if self._power > self._limit:
            self._stop()

    def _stop(self) -> None:
        swing, band = self.swing, np.array(self._longer)
        lines = np.abs(np.fft.rfft(band * np.hanning(len(band)), FINE * len(band)))
        hertz = float(np.argmax(lines)) / (FINE * len(band) * self.period_s)
        raise SafetyStop(
            f"the motor torque swings with {math.sqrt(2.0 * self._power / self._rows):.3g} N m at about {hertz:.0f} Hz, in the band of the "
            f"belt's resonance; predicted were {swing.predicted_nm:.2g} N m, {swing.allowed_nm:.2g} N m are allowed; the axis was stopped: "
            "the loop in the drive does not fit this axis (another load, a later torque, a gain that is not what it "
            "says), so identify it again, or frames to the drive got lost, so check the cabling",
            "resonance",
        )


def _filter(period_s: float, band_hz: tuple[float, float]) -> Array:
    from scipy.signal import butter

    return np.asarray(butter(ORDER, band_hz, "bandpass", fs=1.0 / period_s, output="sos"))


def _rows(period_s: float) -> int:
    return max(4, round(WINDOW_S / period_s))


#: The drive may use so many times the planned torque, and that of a rigid axis where nobody knows the loop that is in it.
OVER_PLAN, OVER_RIGID = 1.5, 3.0


class Watched(Protocol):
    """Part of :class:`beltcomm.machine.machine.Machine` that the watch of a closed loop rests on, named as there."""

    axis: Axis
    drive: Drive
    ratio: float
    origin_rad: float
    friction: tuple[float, float]
    holding_nm: float
    deceleration_m_s2: float
    closed: tuple[Model, float] | None
    cascade: Cascade | None

    def envelope(self) -> Envelope:
        """The travel and all that axis and drive allow."""
        ...


def _rigid_torque(model: Model, motion: Motion, holding_nm: float) -> Array:
    """Torque of a rigid axis along a motion:  J φ̈ + τ_C sign φ̇ + d φ̇ + τ_g, N m, (n,)."""
    speed = motion.velocity_rad_s
    acceleration = np.gradient(speed, motion.period_s)
    return np.asarray(
        total_inertia(model) * acceleration + total_friction(model) * np.sign(speed) + total_viscous(model) * speed + holding_nm
    )


def _planned_torque_nm(machine: Watched, model: Model, torque_nm: Array) -> float:
    """Largest torque that a motion, with its predicted torque, or a stop out of it takes, N m."""
    stop_nm = total_inertia(model) * machine.deceleration_m_s2 / machine.ratio + total_friction(model)
    return max(float(np.max(np.abs(torque_nm))), stop_nm) + abs(machine.holding_nm)


def lent_torque_nm(machine: Watched, model: Model, torque_nm: Array) -> float:
    """Torque beyond which a drive with a known loop does not go while it makes a motion: its limit 6072h is lent for that.

    Parameters
    ----------
    machine : Watched
        The axis behind its drive.
    model : Model
        For which a stop out of the motion is predicted.
    torque_nm : ndarray (n,), N m, motor shaft
        As of :func:`_planned_torque_nm`.

    Returns
    -------
    float, N m
        Motor shaft; the drive's peak torque where it takes no limit.
    """
    own = machine.drive.capabilities
    limit = own.parameters.get(LIMIT_NAMES[0])
    if limit is None or limit.index in own.not_taken:
        return own.peak_torque_nm
    return min(own.peak_torque_nm, machine.envelope().torque_nm, OVER_PLAN * _planned_torque_nm(machine, model, torque_nm))


def unwatched(_row: Row) -> None:
    """A record that nobody but the drive's limits watches.

    Parameters
    ----------
    _row : Row
        Of the record.
    """


@dataclass(frozen=True)
class Foreseen:
    """Prediction of a motion in the drive's own loops.

    Attributes
    ----------
    watch : callable
        Called with every row.
    torque_nm : float
        Limit in the drive.
    """

    watch: Callable[[Row], None]
    torque_nm: float = math.inf


def within(envelope: Envelope, found: Foreseen) -> Envelope:
    """The envelope with the torque that was foreseen, where that is lower.

    Parameters
    ----------
    envelope : Envelope
        Before.
    found : Foreseen
        As :func:`foreseen` returned it.
    """
    return replace(envelope, torque_nm=min(envelope.torque_nm, found.torque_nm))


def foreseen(machine: Watched, motion: Motion) -> Foreseen:
    """The watch of a motion in the drive's own loops; what an excitation may do is watched by its own prediction.

    As soon as there is a model to predict the motion with (a rigid axis where the loop is unknown), swings around the resonance are
    watched, and the drive gets a torque limit of ``OVER_PLAN`` times what the motion or a stop out of it takes: a loop that swings does
    so during its quick stop as well.

    Parameters
    ----------
    machine : Watched
        The axis behind its drive.
    motion : Motion
        That the drive will make.

    Returns
    -------
    Foreseen
        Watch of its rows and largest torque, N m at the motor shaft.
    """
    if motion.kind == "torque":
        return Foreseen(unwatched)
    belt = BeltWatch(machine.ratio, machine.axis.motor_side_inertia_kg_m2, machine.axis.belt_force_limit_n, machine.friction)
    if machine.closed is None or len(motion.torque_nm) < 2:
        return Foreseen(belt)
    (model, delay_s), capabilities = machine.closed, machine.drive.capabilities
    if machine.cascade is None:
        torque, over = _rigid_torque(model, motion, machine.holding_nm), OVER_RIGID
    else:
        drive = Loop(capabilities.structure, delay_s, capabilities.peak_torque_nm, capabilities.counts_per_rev)
        torque, over = _predicted_torque(model, machine.cascade, motion, drive, machine.ratio, machine.origin_rad), OVER_PLAN
    swing = _allowed(torque, motion.period_s, _band_of(model, machine.envelope().window_m, motion.period_s), capabilities.rated_torque_nm)
    resonance = ResonanceWatch(swing, motion.period_s)

    def watch(row: Row) -> None:
        resonance(row)
        belt(row)

    return Foreseen(watch, over * _planned_torque_nm(machine, model, torque))
