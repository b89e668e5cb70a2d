"""Open loop, direct and indirect closed loop, and injection at the speed setpoint, on the same axis (3.3, 3.4)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from beltcomm.arrays import Array, ComplexArray, decibels
from beltcomm.control import Cascade, Feedforward, Prefilter, discrete_coefficients, new_state, reset_state, velocity_step
from beltcomm.errors import Refused
from beltcomm.excitation import Excitation, prbs
from beltcomm.identify.dead_time import DeadTime, dead_time_between
from beltcomm.identify.magnitude_fit import fit_magnitude
from beltcomm.model import Model, load_plant
from beltcomm.model.linear import modes, operating_point, sampled_response
from beltcomm.model.transfer import TwoMass
from beltcomm.response import FrequencyResponse, estimate_response
from beltcomm.response.closed_loop import feedback, from_setpoint_excitation, from_torque_excitation, setpoint_path
from beltcomm.simulate.forward import simulate_torque
from beltcomm.simulate.plant import SimulatedPlant
from beltcomm.simulate.stopping import total_friction, total_inertia, total_viscous

Inject = Literal["torque", "setpoint"]

PLANT = "g_a"
PERIOD_S, DELAY = 1e-3, 1
COUNTS, NOISE_NM, SEED = 65536, 6e-3, 3
#: m/s, speed of the carriage in the closed loop, from where to where, and the torque of the excitation, ± N m (3.4).
SPEED_M_S, FROM_M, STANDS_M = 0.1, 0.05, 0.30
AMPLITUDE_NM = 0.15
#: Factor by which the excitation of the moving axis is lowered until the motor never reverses; the setpoint's first, over the speed.
CALMER, SETPOINT_SHARE, QUIETEST = 0.8, 1.0, 0.01
ORDER, CLOCK, PERIODS = 9, 2, 4
#: PRBS of the source: order, clock, s (erratum 9), periods, and 0.3 N m peak to peak or to either side (3.4).
FINE_ORDER, FINE_CLOCK, FINE_S, FINE_PERIODS, READINGS_NM = 7, 128, 62.5e-6, 4, (0.15, 0.3)
#: A controller that is not what one believes: gains in other units, a torque constant from a data sheet.
WRONG = 0.8
#: The weak velocity controller: crossover below 1 Hz (figure 3.6).
WEAK = Cascade(kp_nm_s_rad=0.009, ki_nm_rad=0.012, kpp_1_s=0.0, velocity_filter_s=0.002, feedforward=Feedforward(), filter_reference=False)
#: Hz; a band below the antiresonance where the loop acts, and one above.
LOW_HZ, HIGH_HZ = (0.9, 3.0), (3.0, 150.0)
#: The same with a crossover of some 4 Hz.
STRONG = replace(WEAK, kp_nm_s_rad=0.05, ki_nm_rad=0.6, prefilter=Prefilter("butterworth", 123.24))
#: Periods of the record that shows what averaging gains.
AVERAGED = (1, 2, 4, 8)
#: Share of the largest line below which one is not excited.
EXCITED = 0.02


@dataclass(frozen=True)
class LoopRig:
    """An axis on which the ways are compared, by default the source's.

    Attributes
    ----------
    amplitude_nm : float
        Of the excitation, ± N m.
    from_m, stands_m : float
        Where the moving and the standing record begin, m.
    speed_m_s : float
        Of the carriage in the closed loop.
    weak, strong : Cascade
        Velocity controllers with a crossover below 1 Hz and of some 4 Hz.
    """

    name: str
    model: Model
    amplitude_nm: float = AMPLITUDE_NM
    from_m: float = FROM_M
    stands_m: float = STANDS_M
    speed_m_s: float = SPEED_M_S
    counts: int = COUNTS
    weak: Cascade = WEAK
    strong: Cascade = STRONG


def _source_rig() -> LoopRig:
    """G_A of the source."""
    return LoopRig(PLANT, load_plant(PLANT).model)


def own_rig(model: Model, antiresonance_rad_s: float, amplitude_nm: float, low_m: float, high_m: float, counts: int) -> LoopRig:
    """An axis of one's own: the source's loops at the same crossover, and its speed where the travel has room for the record.

    Parameters
    ----------
    model : Model
    antiresonance_rad_s : float, rad/s
        Of the belt, for the prefilter.
    amplitude_nm : float, N m, motor shaft
        Of the excitation.
    low_m, high_m : float, m
        Ends of the travel.
    counts : int
        Encoder counts per turn of the motor.
    """
    share = total_inertia(model) / total_inertia(_source_rig().model)
    weak, strong = (replace(one, kp_nm_s_rad=share * one.kp_nm_s_rad, ki_nm_rad=share * one.ki_nm_rad) for one in (WEAK, STRONG))
    strong = replace(strong, prefilter=Prefilter("butterworth", antiresonance_rad_s))
    room, seconds = high_m - low_m, prbs(ORDER, CLOCK, 1.0, PERIOD_S, PERIODS).duration_s
    speed = min(SPEED_M_S, 0.8 * room / seconds)
    return LoopRig("own axis", model, amplitude_nm, low_m + 0.1 * room, low_m + 0.5 * room, speed, counts, weak, strong)


@dataclass(frozen=True)
class Way:
    """One way to the frequency response.

    Attributes
    ----------
    amplitude_nm : float
        Half the span of the torque setpoint.
    low_db, high_db : float
        Mean of 20 lg |Ĝ/G| below and above 3 Hz, G of the moving axis.
    scatter_db : float
        rms about it above 3 Hz.
    mass_kg, viscous_nm_s_rad : float
        Of the thesis's log-magnitude fit, i_t² (d_m + d_c) for the latter.
    crosses_zero : bool
        The motor reversed.
    """

    name: str
    amplitude_nm: float
    response: FrequencyResponse
    low_db: float
    high_db: float
    scatter_db: float
    mass_kg: float
    viscous_nm_s_rad: float
    crosses_zero: bool


@dataclass(frozen=True)
class IdentificationStudy:
    """Comparison of the identification methods of the source.

    Attributes
    ----------
    ways : tuple of Way
        By what was done.
    true : ComplexArray
        |G| at the lines of the first.
    controller : ComplexArray
        |C_ω| there.
    dead_time : DeadTime
        Figure 3.5.
    averaging : dict of int to float
        Periods averaged and rms difference of two independent means over √2, relative to one period's.
    readings : dict of float to TwoMass
        By ± N m, the source's own procedure, PRBS of order 7 and clock 128 at 62.5 µs.
    by_setpoint, by_torque : FrequencyResponse
        The direct one from the setpoint, with the current loop in it, and from the acting torque (figure 3.5).
    """

    ways: tuple[Way, ...]
    freq_hz: Array
    true: ComplexArray
    controller: ComplexArray
    dead_time: DeadTime
    averaging: Mapping[int, float]
    mass_kg: float
    viscous_nm_s_rad: float
    by_setpoint: FrequencyResponse
    by_torque: FrequencyResponse
    name: str
    speed_m_s: float
    readings: Mapping[float, TwoMass]


@dataclass(frozen=True)
class Record:
    """A drive's record.

    Attributes
    ----------
    torque : ndarray
        Acting, with noise.
    setpoint : ndarray
        Asked for.
    excitation : ndarray
        N m or rad/s.
    reversed : bool
        Motor.
    """

    torque: Array
    setpoint: Array
    position: Array
    excitation: Array
    signal: Excitation
    reversed: bool


def compare(rig: LoopRig | None = None) -> IdentificationStudy:
    """All ways to identify in closed loop on one axis.

    Parameters
    ----------
    rig : LoopRig or None
        None for the source's.
    """
    rig = rig or _source_rig()
    model, weak, strong = rig.model, rig.weak, rig.strong
    signal = prbs(ORDER, CLOCK, 2.0 * rig.amplitude_nm, PERIOD_S, PERIODS)
    stands = _open_loop(rig, prbs(ORDER, CLOCK, 2.0 * rig.amplitude_nm, PERIOD_S, 2 * max(AVERAGED)))
    loud = _closed_loop(rig, signal, "torque", 1.0, weak)
    moves, asked = _without_reversal(rig, signal, "torque", weak), _without_reversal(rig, signal, "setpoint", weak)
    held = _without_reversal(rig, signal, "torque", strong)
    at = operating_point(model, rig.stands_m, 1.0)

    def judge(name: str, found: FrequencyResponse, record: Record) -> Way:
        true = sampled_response(model, at, found.freq_hz, PERIOD_S)
        off = decibels(found.h / true)
        low, high = ((found.freq_hz >= a) & (found.freq_hz < b) for a, b in (LOW_HZ, HIGH_HZ))
        fit = fit_magnitude(found, model["transmission.ratio"], model["motor.inertia"]).two_mass
        mean = float(np.mean(off[high]))
        start = record.signal.first_sample
        loudness = float(np.ptp(record.setpoint[start:])) / 2.0
        return Way(
            name, loudness, found, float(np.mean(off[low])), mean, float(np.std(off[high])), fit.mass_kg, _friction(fit), record.reversed
        )

    direct = _angle_response(moves, moves.torque)
    through, by_setpoint = _angle_response(moves, moves.excitation), _angle_response(asked, asked.excitation)
    controller = feedback(weak, through.freq_hz, PERIOD_S, "velocity")
    stronger = _angle_response(held, held.excitation)
    hold = feedback(strong, stronger.freq_hz, PERIOD_S, "velocity")
    path = setpoint_path(weak, by_setpoint.freq_hz, PERIOD_S)
    ways = (
        judge("open loop, standing", _angle_response(stands, stands.torque), stands),
        judge("direct, as loud", _angle_response(loud, loud.torque), loud),
        judge("direct", direct, moves),
        judge("indirect, C as it runs", _without_dead_time(from_torque_excitation(through, controller)), moves),
        judge("indirect, C continuous", _without_dead_time(from_torque_excitation(through, _continuous(weak, through.freq_hz))), moves),
        judge("indirect, C 20 % off", _without_dead_time(from_torque_excitation(through, WRONG * controller)), moves),
        judge("strong loop, direct", _angle_response(held, held.torque), held),
        judge("strong loop, indirect", _without_dead_time(from_torque_excitation(stronger, hold)), held),
        judge("strong, C 20 % off", _without_dead_time(from_torque_excitation(stronger, WRONG * hold)), held),
        judge(
            "speed setpoint",
            _without_dead_time(from_setpoint_excitation(by_setpoint, feedback(weak, by_setpoint.freq_hz, PERIOD_S, "velocity"), path)),
            asked,
        ),
    )
    freq = ways[0].response.freq_hz
    resonance = min(m.freq_hz for m in modes(model, at))
    lag = dead_time_between(
        _angle_response(stands, stands.setpoint), _angle_response(stands, stands.torque), lowest_hz=2.0, highest_hz=resonance
    )
    return IdentificationStudy(
        ways,
        freq,
        sampled_response(model, at, freq, PERIOD_S),
        feedback(weak, freq, PERIOD_S, "velocity"),
        lag,
        _averaging_differences(stands),
        model["cart.mass"],
        total_viscous(model),
        _angle_response(moves, moves.setpoint),
        direct,
        rig.name,
        rig.speed_m_s,
        {amplitude: _source_fit(rig, amplitude) for amplitude in READINGS_NM},
    )


def _source_fit(rig: LoopRig, amplitude_nm: float) -> TwoMass:
    """Log-magnitude fit of the source to its own PRBS of ±amplitude on the standing axis: what (3.4) is read as decides."""
    signal = prbs(FINE_ORDER, FINE_CLOCK, 2.0 * amplitude_nm, FINE_S, FINE_PERIODS)
    moved = simulate_torque(rig.model, signal.torque, FINE_S, rig.stands_m)
    step = math.tau / rig.counts
    torque = signal.torque + NOISE_NM * np.random.default_rng(SEED).normal(size=len(signal.torque))
    angle = step * np.floor(moved.position_rad / step + 0.5)
    found = estimate_response(torque, angle, FINE_S, signal.period_samples, signal.first_sample)
    return fit_magnitude(found, rig.model["transmission.ratio"], rig.model["motor.inertia"]).two_mass


def _friction(two: TwoMass) -> float:
    """i_t² (d_m + d_c), N m s/rad."""
    return two.transmission_m_rad**2 * (two.motor_damping_n_s_m + two.cart_damping_n_s_m)


def _open_loop(rig: LoopRig, signal: Excitation) -> Record:
    """The axis at rest under an excitation alone."""
    return _record_run(rig, signal.torque, lambda n, _angle: float(signal.torque[n]), signal, moving=False)


def _without_reversal(rig: LoopRig, signal: Excitation, inject: Inject, cascade: Cascade) -> Record:
    """The loudest record in which the motor turns one way only: what the closed loop is for."""
    share = 1.0
    while (found := _closed_loop(rig, signal, inject, share, cascade)).reversed:
        share *= CALMER
        if share < QUIETEST:
            raise Refused(f"the motor reverses however quiet the excitation is at {rig.speed_m_s:g} m/s: the loop swings; lower its gains")
    return found


def _closed_loop(rig: LoopRig, signal: Excitation, inject: Inject, share: float, cascade: Cascade) -> Record:
    """A velocity loop at constant speed, begun in motion with the integrator where friction needs it."""
    speed = rig.speed_m_s / rig.model["transmission.ratio"]
    friction = total_friction(rig.model) + total_viscous(rig.model) * speed
    excitation = share * signal.torque * (1.0 if inject == "torque" else SETPOINT_SHARE * speed / signal.amplitude_nm)
    coefficients, state = discrete_coefficients(cascade, PERIOD_S, 3.1), new_state()
    reset_state(state, 0.0, speed)
    state[6] = friction / cascade.ki_nm_rad  # integrator: the state of a loop that has moved for long

    def control(n: int, angle: float) -> float:
        added = (float(excitation[n]), 0.0) if inject == "torque" else (0.0, float(excitation[n]))
        return float(velocity_step(coefficients, state, speed + added[1], 0.0, angle, added[0]))

    return _record_run(rig, excitation, control, signal, moving=True)


def _record_run(rig: LoopRig, excitation: Array, control: Callable[[int, float], float], signal: Excitation, *, moving: bool) -> Record:
    """Record of a run as a drive shows it: counted angle, acting torque with noise; a setpoint acts one period after it was worked out."""
    at_m, speed_m_s = (rig.from_m, rig.speed_m_s) if moving else (rig.stands_m, 0.0)
    plant = SimulatedPlant(rig.model, at_m, speed_m_s=speed_m_s)
    n = len(excitation)
    step = 2.0 * math.pi / rig.counts
    torque, setpoint, position = np.zeros(n), np.zeros(n), np.zeros(n)
    waiting = [0.0] * DELAY
    turned = False
    for k in range(n):
        position[k] = math.floor(plant.position_rad / step + 0.5) * step
        setpoint[k] = control(k, float(position[k]))
        waiting.append(float(setpoint[k]))
        torque[k] = waiting.pop(0)
        plant.step(float(torque[k]), PERIOD_S)
        turned = turned or plant.velocity_rad_s <= 0.0
    noise = NOISE_NM * np.random.default_rng(SEED).normal(size=n)
    return Record(torque + noise, setpoint, position, excitation, signal, turned)


def _angle_response(record: Record, torque: Array) -> FrequencyResponse:
    """The response of the angle to one of the record's signals."""
    return estimate_response(torque, record.position, PERIOD_S, record.signal.period_samples, record.signal.first_sample)


def _without_dead_time(found: FrequencyResponse) -> FrequencyResponse:
    """A response from the setpoint as one from the acting torque: the known dead time taken into the prefilter V_1 = z⁻ⁿ (3.4)."""
    return replace(found, h=found.h * np.exp(2j * np.pi * found.freq_hz * DELAY * PERIOD_S))


def _continuous(cascade: Cascade, freq_hz: Array) -> ComplexArray:
    """C of (3.21) as it is printed, G_R = s/(1 + T_R s) and C_ω = K_P + K_I/s: not what a sampled loop does."""
    s = 2j * np.pi * freq_hz
    return np.asarray(s / (1.0 + cascade.velocity_filter_s * s) * (cascade.kp_nm_s_rad + cascade.ki_nm_rad / s))


def _averaging_differences(record: Record) -> dict[int, float]:
    """Scatter of the mean over n periods, relative to one period's; 1/√n for noise alone."""
    signal = record.signal
    found = scatter_of_mean(
        record.torque, record.position, PERIOD_S, (signal.first_sample, signal.period_samples, signal.repeats), HIGH_HZ[0], 2 * HIGH_HZ[1]
    )
    return {n: value / found[1] for n, value in found.items()}


def scatter_of_mean(
    torque: Array, position: Array, period_s: float, periods: tuple[int, int, int], low_hz: float, high_hz: float
) -> dict[int, float]:
    """Rms difference of independent means of Ĝ over n periods each, over √2, relative to |Ĝ|: median over the excited lines of a band.

    Parameters
    ----------
    torque : ndarray (n,), N m, motor shaft
        Of the record.
    position : ndarray (n,), rad, motor shaft
        Of the record.
    period_s : float, s
        Sampling period.
    periods : tuple of int
        First sample, samples of a period, periods; n goes as far as two means of n periods are there.
    low_hz, high_hz : float, Hz
        Ends of the band.
    """
    first, period, repeats = periods
    speed = np.diff(position, prepend=position[0])
    blocks = [slice(first + i * period, first + (i + 1) * period) for i in range(repeats)]
    driven = np.array([np.fft.rfft(torque[b])[1:] for b in blocks])
    size = np.abs(driven).min(axis=0)
    freq = np.fft.rfftfreq(period, period_s)[1:]
    band = (freq > low_hz) & (freq < high_hz) & (size > EXCITED * size.max())
    each = np.array([np.fft.rfft(speed[b])[1:] for b in blocks])[:, band] / driven[:, band]
    found = {}
    for n in AVERAGED:
        pairs = [(each[i : i + n].mean(axis=0), each[i + n : i + 2 * n].mean(axis=0)) for i in range(0, len(each) - 2 * n + 1, 2 * n)]
        if pairs:
            found[n] = float(np.sqrt(np.mean([np.median(np.abs(a - b) / np.abs(a)) ** 2 for a, b in pairs]) / 2.0))
    return found


def lines(study: IdentificationStudy) -> list[str]:
    """The table and what it says."""
    said = [
        f"{study.name}, closed loop at {1e3 * study.speed_m_s:.0f} mm/s with a crossover below 1 Hz; errors of |G| against the moving axis",
        f"{'':24} {'torque':>9} {'below 3 Hz':>11} {'above':>8} {'scatter':>8} {'m_c':>9} {'i_t²(d_m+d_c)':>20}  motor reverses",
    ]
    for way in study.ways:
        said.append(
            f"{way.name:24} ±{way.amplitude_nm:.3f} N m {way.low_db:+8.2f} dB {way.high_db:+5.2f} dB {way.scatter_db:5.2f} dB "
            f"{way.mass_kg:6.2f} kg {1e3 * way.viscous_nm_s_rad:9.2f} mN m s/rad  {'yes' if way.crosses_zero else 'no'}"
        )
    said += [
        f"{'true':24} {'':>38} {study.mass_kg:10.2f} kg {1e3 * study.viscous_nm_s_rad:9.2f} mN m s/rad",
        f"dead time from the phases of setpoint and acting torque (3.27): {1e3 * study.dead_time.value_s:.4f} ± "
        f"{1e3 * study.dead_time.interval_s:.4f} ms (built in {1e3 * DELAY * PERIOD_S:g} ms; thesis 1 ms)",
        "averaging n periods leaves of the scatter: "
        + ", ".join(f"n = {n}: {v:.2f} (1/√n {1 / math.sqrt(n):.2f})" for n, v in study.averaging.items()),
        "Standing, Coulomb friction is taken for damping (erratum 7); moving, where the motor never reverses, it is not: what is left "
        "is the belt's own damping, which (2.42) does not have.",
        *(
            f"Standing, PRBS of order {FINE_ORDER}, clock {FINE_CLOCK} at {1e6 * FINE_S:g} µs, ±{amplitude:g} N m: {two.mass_kg:.2f} kg, "
            f"{1e-3 * two.stiffness_n_m:.1f} kN/m, {1e3 * _friction(two):.1f} mN m s/rad"
            for amplitude, two in study.readings.items()
        ),
        "  (3.4) prints 0.3 N m peak to peak, the rig probably ran ±0.3. So open loop and direct differ (3.4: not significantly), the less "
        "the louder, at ±0.3 nearly in the damping alone.",
        "C continuous is (3.21) as printed: a sampled loop does something else.",
        "Indirect against direct (3.4): the thesis saw a bias of the indirect gain at low frequency, and with it of mass and damping.  It "
        "comes with a controller that is not exactly known, ΔG/G = -G C ΔC/C: nothing in a weak loop, much below the crossover of a "
        "strong one; with the loop as it runs there is none.",
    ]
    return said
