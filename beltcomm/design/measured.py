"""Margins straight from a measured frequency response: no model stands between the measurement and the loop.

Around the measured curve L(jω) lies a tube: between neighbouring lines log L runs straight in log ω, and its radius is that of the disc
that holds the response with 97.5 % (two neighbours together with 95 %), times |controller|.  A bound over the whole curve needs no
correction for the number of lines: the loop is nearest to -1 at *one* place, and there it lies inside the tube with 95 %.

The discs hold what differs between periods.  Friction also answers with wrong lines that repeat (``scatter``); they count as they stand.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array, BoolArray, ComplexArray
from beltcomm.control import Cascade, velocity_filter_response
from beltcomm.design.margins import gain_margin_db, phase_margin
from beltcomm.errors import DataError
from beltcomm.response import FrequencyResponse
from beltcomm.response.closed_loop import speed_controller
from beltcomm.response.distortion import line_scatter

#: Probability of one line's disc: neighbours, between which the loop is read, hold both with 95 %.
LINE_LEVEL = 0.975
#: A line is hidden where its disc is larger than this share of the response: its phase is then known to 30 degrees at best.
HIDDEN = 0.5
#: Points per interval between lines; intervals longer than this many usual ones are gaps, and named.
POINTS, GAP = 8, 3.0
FEWEST_LINES = 8
#: Hidden lines nearer to each other than this ratio are named as one range.
NEAR = 1.25
#: Recording and loop have one sampling period when they differ by less than this share of it.
SAME_PERIOD = 1e-3


@dataclass(frozen=True)
class LoopMargin:
    """One open loop over the measured band, read from the lines, and what holds with 95 %.

    Attributes
    ----------
    phase_margin_deg, crossover_hz : float
        As in ``margins.Margins``; inf and nan where no crossover lies in the band. gain_margin_db.
    sensitivity_db : float
        Max |1/(1 + L)|, met at ``nearest_hz``, where L is nearest to -1.
    least_phase_margin_deg, least_gain_margin_db, most_sensitivity_db : float
        The same at the edge of the tube; inf for the last where the tube reaches -1.
    """

    phase_margin_deg: float
    crossover_hz: float
    gain_margin_db: float
    sensitivity_db: float
    nearest_hz: float
    least_phase_margin_deg: float
    least_gain_margin_db: float
    most_sensitivity_db: float


@dataclass(frozen=True)
class MeasuredMargins:
    """A cascade on one measured response.

    Attributes
    ----------
    stable : bool or None
        Of the closed cascade, None where the tube reaches -1 or the band does not show it; velocity_stable : of its velocity loop.
    lowest_hz, highest_hz : float
        Lines used.
    hidden_hz : tuple of tuple of float
        Ranges in which noise hides ``hidden_lines`` of them.
    gaps_hz : tuple of tuple of float
        Without lines.
    hidden_gain_db : float
        The most that |velocity loop| can be at the hidden lines; -inf without any.
    scatter : float
        Median relative difference of a line from its neighbours, standard deviation.
    noise : float
        That of the noise between periods.
    """

    record: str
    velocity: LoopMargin
    position: LoopMargin
    stable: bool | None
    velocity_stable: bool | None
    lowest_hz: float
    highest_hz: float
    lines: int
    hidden_hz: tuple[tuple[float, float], ...]
    hidden_lines: int
    gaps_hz: tuple[tuple[float, float], ...]
    hidden_gain_db: float
    scatter: float
    noise: float


@dataclass(frozen=True)
class MeasuredLoop:
    """The open loops at the lines used, for margins and pictures.

    freq_hz (k,), Hz.

    Attributes
    ----------
    velocity, position : ComplexArray
        L, (k,).
    radius : ndarray
        Of the velocity loop's discs (k,).
    hidden : ndarray of bool
        FrequencyResponse's lines left out, (n,) bool, at ``all_hz``; all_gain : the most that |velocity loop| can be at every line, (n,).
    """

    freq_hz: Array
    velocity: ComplexArray
    position: ComplexArray
    radius: Array
    all_hz: Array
    hidden: BoolArray
    all_gain: Array


def measured_loop(response: FrequencyResponse, cascade: Cascade, period_s: float, dead_time_s: float) -> MeasuredLoop:
    """Open loops of a cascade on a measured response, torque setpoint to angle.

    L = C_ω G_R Ĝ e^{-jω t_T},   L_φ = K_PP L/((1 + L) G_R);   Ĝ held over the loop's period, where the record was held over another one.

    Parameters
    ----------
    response : FrequencyResponse, rad/(N m), motor shaft
    cascade : Cascade
    period_s : float
        Of the drive's loops.
    dead_time_s : float
        Where the response is that from the acting torque.

    Raises
    ------
    DataError
        When too few lines are left.

    References
    ----------
    Figure 4.1, (4.10).
    """
    below = response.freq_hz < 0.5 / period_s
    if not below.any():
        raise DataError(f"no line of the response lies below half the loop's rate of {1.0 / period_s:.4g} Hz")
    shown = response.lines(below)
    freq, omega = shown.freq_hz, 2.0 * np.pi * shown.freq_hz
    plant = shown.h * np.exp(-1j * omega * dead_time_s)
    if abs(response.sample_period_s / period_s - 1.0) > SAME_PERIOD:
        plant = plant * _hold(omega, period_s) / _hold(omega, response.sample_period_s)
    estimator = velocity_filter_response(omega, cascade.velocity_filter_s, period_s)
    velocity = speed_controller(cascade, freq, period_s) * estimator * plant
    level = np.abs(shown.h)
    share = shown.error_radius(LINE_LEVEL) / np.where(level > 0.0, level, np.nan)
    hidden = ~(share <= HIDDEN)
    if int(np.sum(~hidden)) < FEWEST_LINES:
        raise DataError(f"noise hides all but {int(np.sum(~hidden))} of {len(freq)} lines; raise the amplitude or repeat more periods")
    kept = velocity[~hidden]
    position = cascade.kpp_1_s * kept / ((1.0 + kept) * estimator[~hidden])
    most = np.abs(velocity) * (1.0 + np.nan_to_num(share, nan=math.inf))
    return MeasuredLoop(freq[~hidden], kept, position, share[~hidden] * np.abs(kept), freq, hidden, np.asarray(most))


def measured_margins(
    response: FrequencyResponse, cascade: Cascade, period_s: float, dead_time_s: float = 0.0, record: str = ""
) -> MeasuredMargins:
    """Margins and stability of a cascade on a measured response; errors as for :func:`measured_loop`.

    Stable is counted by how often 1 + L turns around the origin (Nyquist, with the phase unwrapped), so that a phase beyond a turn is no
    margin.  Below the lowest line the loop is taken to run between -180 and 0 degrees, as that of every axis that friction does not drive.

    Parameters
    ----------
    response : FrequencyResponse
        Torque to motor angle, rad/(N m).
    cascade : Cascade
    period_s : float, s
    dead_time_s : float, s
        Where the response is that from the acting torque.
    record : str
        Name of the response.

    Returns
    -------
    MeasuredMargins
        With the noise of the response counted against it.
    """
    loop = measured_loop(response, cascade, period_s, dead_time_s)
    freq, velocity, share = _between(loop)
    estimator = velocity_filter_response(2.0 * np.pi * freq, cascade.velocity_filter_s, period_s)
    position = cascade.kpp_1_s * velocity / ((1.0 + velocity) * estimator)
    tube = share * np.abs(velocity)
    room = np.abs(1.0 + velocity) - tube
    # Exact: ΔL_φ/L_φ = (ΔL/L)/(1 + L + ΔL).
    position_tube = np.where(room > 0.0, np.abs(position) * share / np.maximum(room, 1e-300), math.inf)
    hidden_gain = float(np.max(loop.all_gain[loop.hidden], initial=0.0))
    used = response.lines(np.isin(response.freq_hz, loop.freq_hz))
    whole = velocity * (1.0 + cascade.kpp_1_s / estimator)  # the cascade cut at its torque: 1 + this = (1 + L)(1 + L_φ)
    return MeasuredMargins(
        record,
        _margin(freq, velocity, tube, hidden_gain),
        _margin(freq, position, position_tube, 0.0),
        _stable(whole, share * np.abs(whole), integrators=3, hidden_gain=hidden_gain),
        _stable(velocity, tube, integrators=2, hidden_gain=hidden_gain),
        float(loop.freq_hz[0]),
        float(loop.freq_hz[-1]),
        len(loop.freq_hz),
        _ranges(loop.all_hz[loop.hidden]),
        int(np.sum(loop.hidden)),
        _gaps(loop.freq_hz, loop.all_hz, loop.hidden),
        20.0 * math.log10(hidden_gain) if hidden_gain > 0.0 else -math.inf,
        float(np.median(line_scatter(used) / np.abs(used.h))),
        float(np.median(used.noise / np.abs(used.h))),
    )


def _hold(omega: Array, period_s: float) -> ComplexArray:
    """A torque held over a period, as its mean."""
    return np.asarray(np.exp(-0.5j * omega * period_s) * np.sinc(omega * period_s / (2.0 * np.pi)))


def _between(loop: MeasuredLoop) -> tuple[Array, ComplexArray, Array]:
    """The velocity loop on ``POINTS`` points per interval, frequencies Hz, and the radius of its tube over |L|; log L straight between."""
    x = np.log(loop.freq_hz)
    logarithm = np.log(np.abs(loop.velocity)) + 1j * np.unwrap(np.angle(loop.velocity))
    share = loop.radius / np.abs(loop.velocity)
    places = np.append((np.arange(len(x) - 1)[:, None] + np.arange(POINTS) / POINTS).ravel(), len(x) - 1.0)
    lines = np.arange(len(x))
    fine = np.interp(places, lines, logarithm.real) + 1j * np.interp(places, lines, logarithm.imag)
    return np.exp(np.interp(places, lines, x)), np.exp(fine), np.interp(places, lines, share)


def _margin(freq_hz: Array, loop: ComplexArray, tube: Array, hidden_gain: float) -> LoopMargin:
    """Margins of a curve and of the tube around it.   hidden_gain : |L| is at most this where it is hidden."""
    margin, crossover = phase_margin(2.0 * np.pi * freq_hz, loop)
    distance = np.abs(1.0 + loop)
    least = min(float(np.min(distance - tube)), 1.0 - hidden_gain)
    nearest = int(np.argmin(distance))
    return LoopMargin(
        margin,
        crossover / (2.0 * np.pi),
        gain_margin_db(loop),
        -20.0 * math.log10(distance[nearest]),
        float(freq_hz[nearest]),
        min(margin, _least_angle_deg(loop, tube)),
        min(gain_margin_db(loop), _least_gain_db(loop, tube)),
        -20.0 * math.log10(least) if least > 0.0 else math.inf,
    )


def _least_angle_deg(loop: ComplexArray, tube: Array) -> float:
    """Smallest angle to -1 of any point of the discs on the unit circle, deg; inf when none of them reaches it.

    Two circles meet at ± β from the disc's own direction,  cos β = (1 + |L|² - ρ²)/(2 |L|).
    """
    loop, tube = _with_crossings(loop, tube, np.log(np.abs(loop)))
    size = np.abs(loop)
    meets = np.abs(size - 1.0) <= tube + 1e-12
    if not meets.any():
        return math.inf
    size, reach = size[meets], np.minimum(tube[meets], 1e6)
    cosine = np.clip((1.0 + size**2 - reach**2) / (2.0 * size), -1.0, 1.0)
    away = np.abs(np.angle(-loop[meets]))
    return math.degrees(float(np.min(np.maximum(away - np.arccos(cosine), 0.0))))


def _least_gain_db(loop: ComplexArray, tube: Array) -> float:
    """Smallest factor above 1 that brings any point of the discs on the negative real axis to -1, dB; 0 when a disc holds -1."""
    loop, tube = _with_crossings(loop, tube, loop.imag)
    meets = (np.abs(loop.imag) <= tube + 1e-12) & (loop.real - tube < 0.0)
    if not meets.any():
        return math.inf
    half = np.sqrt(np.maximum(np.minimum(tube[meets], 1e6) ** 2 - loop.imag[meets] ** 2, 0.0))
    left, right = loop.real[meets] - half, loop.real[meets] + half
    if np.any((left <= -1.0) & (right >= -1.0)):
        return 0.0
    largest = float(np.max(-left[left > -1.0], initial=0.0))
    return -20.0 * math.log10(largest) if largest > 0.0 else math.inf


def _with_crossings(loop: ComplexArray, tube: Array, height: Array) -> tuple[ComplexArray, Array]:
    """Curve and tube with the points added where ``height`` passes through zero: a thin tube may cross between two points."""
    at = np.flatnonzero((height[:-1] > 0.0) != (height[1:] > 0.0))
    share = height[at] / (height[at] - height[at + 1])
    turn = np.log(loop[at + 1] / loop[at])
    return np.append(loop, loop[at] * np.exp(share * turn)), np.append(tube, tube[at] + share * (tube[at + 1] - tube[at]))


def _stable(loop: ComplexArray, tube: Array, *, integrators: int, hidden_gain: float) -> bool | None:
    """True if 1 + L turns around the origin as often as a stable loop; None where the curve does not show it.

    The angle of 1 + L falls by 360 degrees for every pair of unstable poles.  L comes from infinity at -90 degrees times the number of
    ``integrators`` and is taken to stay between there and 0 degrees down to the lowest line; with three it passes -180 degrees on the way,
    which only a gain still above 1 at the lowest line shows to be harmless.
    """
    if np.any(np.abs(1.0 + loop) <= tube) or abs(loop[-1]) + tube[-1] >= 1.0 or hidden_gain >= 1.0:
        return None
    first = float(np.angle(loop[0]))
    below = -0.5 * math.pi * integrators
    first += 2.0 * math.pi * math.ceil((below - first) / (2.0 * math.pi))  # the branch in below .. below + 360 degrees
    if first > 0.0 or (integrators > 2 and abs(loop[0]) < 1.0):
        return None
    # From infinite gain down to that of the lowest line along one ray, 1 + L keeps to the side of the negative axis that L is on.
    turns = math.floor((first + math.pi) / (2.0 * math.pi))
    start = float(np.angle(1.0 + loop[0])) + 2.0 * math.pi * turns
    total = start + float(np.sum(np.angle((1.0 + loop[1:]) / (1.0 + loop[:-1]))))
    return round(total / (2.0 * math.pi)) == 0


def _ranges(freq_hz: Array) -> tuple[tuple[float, float], ...]:
    """Single frequencies as ranges (first, last), Hz: those nearer to each other than ``NEAR`` are one, whatever lies between."""
    if not len(freq_hz):
        return ()
    cuts = np.flatnonzero(freq_hz[1:] > NEAR * freq_hz[:-1]) + 1
    return tuple((float(part[0]), float(part[-1])) for part in np.split(freq_hz, cuts))


def _gaps(freq_hz: Array, all_hz: Array, hidden: BoolArray) -> tuple[tuple[float, float], ...]:
    """Intervals without lines that are long beside the usual one and hold no hidden line, which are named elsewhere."""
    usual, unseen = float(np.median(np.diff(all_hz))), all_hz[hidden]
    long = [(a, b) for a, b in itertools.pairwise(map(float, freq_hz)) if b - a > GAP * usual]
    return tuple((a, b) for a, b in long if not np.any((unseen > a) & (unseen < b)))
