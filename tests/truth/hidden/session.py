"""The session: which records a plan holds, and running them one after the other on one machine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from truth.hidden import control, laws, readings, recorder
from truth.hidden import layout as at
from truth.hidden.layout import Array
from truth.hidden.machines import Machine
from truth.hidden.signals import Path, Reference, multisine, samples_per_period, sweep

#: s, sub-step of the integration: 25 kHz.
SUBSTEP_S = 40e-6
PLANS = ("thorough", "default")
#: s at rest before and after an excitation.
LEAD_S, TAIL_S = 0.25, 0.45


@dataclass(frozen=True)
class Task:
    """One record to make.   reference : for a closed loop.   excitation : (n,), N m, for an open one."""

    name: str
    experiment: str
    start_m: float
    reference: Reference | None = None
    excitation: Array | None = None
    integral: bool = True
    held_out: bool = False
    note: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Record:
    """What was recorded, each (n,), and its start on the session's clock.

    t_s : time stamps from 0.   acting_nm : mean torque before the machine's dead time.   bristle_nm : friction at the start.
    fine, fine_torque : shown angle at many instants and mean torque from each to the next, or (0,).
    """

    task: Task
    session_time_s: float
    position_rad: Array
    torque_nm: Array
    setpoint_nm: Array
    acting_nm: Array
    fine: Array
    bristle_nm: float
    t_s: Array
    fine_torque: Array


@dataclass(frozen=True)
class Abilities:
    """What the axis may do.   acceleration_m_s2 : gentle and full.   speed_m_s : gentle and full."""

    gentle_m_s2: float
    full_m_s2: float
    gentle_m_s: float
    full_m_s: float


def abilities(machine: Machine) -> Abilities:
    """From torque (1.2 and 2.3 N m of a peak of 3.1 for acceleration) and belt force (40 and 80 % of the limit)."""
    base = machine.base
    per_torque, per_force = base.radius_m / machine.rigid_inertia_kg_m2, base.belt_force_limit_n / machine.moved_mass_kg
    scale = base.scale
    gentle = min(1.2 * scale.torque * per_torque, 0.4 * per_force, 20.0 * scale.acceleration)
    full = min(2.3 * scale.torque * per_torque, 0.8 * per_force, 50.0 * scale.acceleration)
    return Abilities(gentle, full, 1.5 * scale.speed, 2.0 * scale.speed)


@dataclass(frozen=True)
class Amplitudes:
    """Multisine amplitudes, N m, small to large, of the held-out record, and the relative size of the lines, None for equal."""

    steps_nm: tuple[float, float, float]
    held_out_nm: float
    weights: Array | None


def belt_force_per_torque(machine: Machine) -> Array:
    """Predicted belt force of the healthy linear machine on the lines of a multisine, complex, N per N m; 0 at 0 Hz."""
    period = machine.instruments.period_s
    freq = np.fft.rfftfreq(samples_per_period(period), period)
    stiffness, force = control.dynamic_stiffness(freq[1:], 0.5 * machine.base.stroke_m, machine.base.vector())
    return np.concatenate(([0.0], force / stiffness))


def amplitudes(machine: Machine) -> Amplitudes:
    """0.4, 0.75, 2.5 N m of a peak of 3.1 as the method sheet; less where the predicted belt force would pass 80 % of its limit.

    Then the lines around the resonance are made smaller, so that more torque is left to overcome friction, and the small
    amplitudes stay above it.
    """
    base, period = machine.base, machine.instruments.period_s
    size = base.scale.torque
    usual = Amplitudes((0.4 * size, 0.75 * size, 2.5 * size), 1.6 * size, None)
    if base.rigid:
        return usual
    force = belt_force_per_torque(machine)
    largest = largest_torque(machine, force, multisine(machine.rng(3), period_s=period)[0])
    if largest > 2.5 * size:
        return usual
    static = base.mass_kg * base.radius_m / base.rigid_inertia_kg_m2
    weights = 1.0 / np.maximum(1.0, np.abs(force) / static)
    large = min(2.5 * size, 0.9 * largest_torque(machine, force, multisine(machine.rng(3), weights, period)[0]))
    small = max(0.3 * large, min(2.0 * base.coulomb_nm, 0.6 * large))
    return Amplitudes((0.7 * small, small, large), 0.5 * (small + large), weights)


def largest_torque(machine: Machine, force: Array, period: Array) -> float:
    """Torque of a multisine, N m, at which the predicted belt force reaches 80 % of its limit."""
    predicted = np.fft.irfft(np.fft.rfft(period) * force, len(period))
    return 0.8 * machine.base.belt_force_limit_n / float(np.abs(predicted).max())


def frf(machine: Machine, rng: np.random.Generator, name: str, place: float, level: tuple[float, Array | None], periods: int) -> Task:
    """A multisine record: one period to settle and then ``periods``.   level : amplitude, N m, and weights of the lines."""
    amplitude, weights = level
    step = machine.instruments.period_s
    samples, lead, tail = samples_per_period(step), round(LEAD_S / step), round(TAIL_S / step)
    period, excited, empty = multisine(rng, weights, step)
    fade = np.clip(np.arange(samples) / round(0.2 / step), 0.0, 1.0)
    signal = amplitude * np.concatenate((np.zeros(lead), period * fade, np.tile(period, periods), np.zeros(tail)))
    note = {
        "kind": "multisine",
        "amplitude_nm": round(amplitude, 6),
        "period_samples": samples,
        "first_sample": lead + samples + 1,  # the setpoint acts one sample later
        "excited_lines": excited,
        "detection_lines": empty,
    }
    held_out = name.startswith("holdout")
    return Task(name, "frf", place * machine.base.stroke_m, excitation=signal, held_out=held_out, note=note)


def plan(machine: Machine, name: str) -> Iterator[Task]:
    """The records of a plan in their order.   Raises ValueError for an unknown plan."""
    if name not in PLANS:
        raise ValueError(f"plan {name!r} is not one of {', '.join(PLANS)}")
    base, able, rng, period = machine.base, abilities(machine), machine.rng(2), machine.instruments.period_s
    thorough = name == "thorough"
    stroke, scale = base.stroke_m, base.scale
    low, high = 0.07 * stroke, 0.93 * stroke

    def swept(label: str, speeds: tuple[float, ...]) -> Task:
        asked, end = [scale.speed * speed for speed in speeds], min(high, low + scale.sweep_m)
        return Task(label, "friction_sweep", low, sweep(low, low, end, asked, able.gentle_m_s2, period).reference(), integral=False)

    yield swept("sweep_fast_1", (1.5, 1.0, 0.6) if thorough else (1.5, 0.8))
    places: tuple[float, ...] = (0.2, 0.5, 0.8)
    level = amplitudes(machine)
    steps = [(a, i) for i in range(3) for a in (1, 2)] + [(0, 1)] if thorough else [(2, 0), (2, 1), (2, 2), (1, 1)]
    if base.rigid:  # the place tells nothing new
        places, steps = (0.5,), [(1, 0), (2, 0), (0, 0)] if thorough else [(2, 0), (1, 0)]
    for a, i in steps:
        periods = 3 if thorough else 2 if (a, i) == (2, 1) else 1
        yield frf(machine, rng, f"frf_p{i}_a{a}", places[i], (level.steps_nm[a], level.weights), periods)
    yield swept("sweep_slow", (0.25, 0.11) if thorough else (0.5,))
    for i, place in enumerate(places):
        strokes = ((0.05, 0.06), (0.036, 0.03), (0.022, 0.01)) if thorough else ((0.018, 0.04), (0.010, 0.01))
        path, ramp = Path(place * stroke, period).rest(0.25), 2.0 * scale.length
        for way, speed in [(scale.length * way, scale.length * speed) for way, speed in strokes]:
            path.move(path.now_m + way, speed, ramp).rest(0.08).move(path.now_m - way, speed, ramp).rest(0.08)
        yield Task(f"slow_p{i}", "friction_sweep", place * stroke, path.rest(0.37).reference())
    path = Path(0.5 * stroke, period).rest(0.25)
    for amplitude, cycles in ((2e-3, 1), (1e-3, 2), (0.4e-3, 3), (0.2e-3, 5)) if thorough else ((1e-3, 1), (0.4e-3, 2), (0.2e-3, 3)):
        path.triangle(scale.length * amplitude, scale.length * 4e-3, cycles).rest(0.05)
    yield Task("reversal", "reversal", 0.5 * stroke, path.rest(0.40).reference())
    path = Path(low, period).rest(0.25)
    for target in (0.9, 0.3, 0.7, 0.1) if thorough else (0.9, 0.1):
        path.move(target * stroke, able.full_m_s, able.full_m_s2).rest(0.15)
    yield Task("fast", "trajectory", low, path.rest(0.30).reference(), integral=False)
    yield random_moves(machine, rng, able, 11.0 if thorough else 3.5)
    yield frf(machine, rng, "holdout_frf", 0.65, (level.held_out_nm, level.weights), 2 if thorough else 1)
    yield swept("sweep_fast_2", (1.5, 0.8, 0.4) if thorough else (1.5,))


def random_moves(machine: Machine, rng: np.random.Generator, able: Abilities, seconds: float) -> Task:
    """Held-out moves: random targets, speeds from 0.7 to 100 % of the gentle one (0.01 to 1.5 m/s), slow ones short."""
    start = float(rng.uniform(0.3, 0.7)) * machine.base.stroke_m
    path, scale = Path(start, machine.instruments.period_s).rest(0.25), machine.base.scale
    while path.duration_s < seconds - 1.5:
        speed = scale.speed * float(0.01 * 150.0 ** rng.uniform(0.0, 1.0))
        reach = min(2.0 * speed, 0.86 * machine.base.stroke_m)
        target = path.now_m + float(rng.uniform(0.4, 1.0)) * reach * rng.choice([-1.0, 1.0])
        low, high = 0.07 * machine.base.stroke_m, 0.93 * machine.base.stroke_m
        target = min(max(target, low), high)
        if abs(target - path.now_m) < 0.3 * reach:
            continue
        path.move(target, speed, able.gentle_m_s2 * float(rng.uniform(0.3, 1.0))).rest(float(rng.uniform(0.05, 0.2)))
    return Task("holdout_moves", "trajectory", start, path.rest(0.40).reference(), held_out=True)


class Session:
    """One machine through one session; its state goes on from record to record, positioning moves in between included.

    fine : instants per sample at which the shown angle is kept for the examiner, 0 for none.
    """

    def __init__(self, machine: Machine, substep_s: float = SUBSTEP_S, fine: int = 0) -> None:
        self.machine, self.substep_s, self.per_sample = machine, substep_s, fine
        self.state, self.memory = np.zeros(at.STATES), np.zeros(recorder.MEMORY)
        self._noise, self._unsteady, self._stamps = machine.rng(4), machine.rng(6), machine.rng(7)
        self._drive = machine.instruments.vector(machine.base.rated_torque_nm)
        self._fast, self._tracking = control.gains_for(machine, integral=False), control.gains_for(machine, integral=True)
        self._centring = control.centring_for(machine)

    def place(self, position_m: float) -> None:
        """Put the carriage somewhere at rest, belt and friction without force, and hold it for half a second."""
        base, state = self.machine.base, self.state
        angle = position_m / base.radius_m
        state[at.ANGLE] = angle
        cart = laws.pulley(angle, self.machine.p)[0]
        state[at.CART] = state[at.IDLER] = state[at.PAYLOAD] = cart
        self.memory[recorder.LAST_ANGLE] = recorder.reading(angle, base.quantum_rad, self.machine.p)
        self._target_m = position_m
        self.follow(Path(position_m, self.machine.instruments.period_s).rest(0.5).reference(), self._tracking)

    @property
    def time_s(self) -> float:
        """Session clock."""
        return float(self.state[at.TIME])

    def follow(self, reference: Reference, gains: Array, fine: int = 0) -> tuple[Array, ...]:
        """Run a reference in closed loop with the feedforward of the healthy machine."""
        base = self.machine.base
        scale = 1.0 / base.radius_m
        speed = reference.speed_m_s * scale
        forward = self.machine.rigid_inertia_kg_m2 * scale * reference.acceleration_m_s2
        forward += (base.viscous_nm_s_rad + base.drag_n_s_m * base.radius_m**2) * speed
        forward += base.coulomb_nm * np.tanh(reference.speed_m_s / (1e-3 * base.scale.length))
        target = np.column_stack((reference.position_m * scale, speed))
        return self._run(gains, target, forward, fine)

    def _run(self, gains: Array, target: Array, forward: Array, fine: int) -> tuple[Array, ...]:
        """Position, setpoint, reported and acting torque, lengths of the samples, fine angle and fine torque."""
        shown, fine_torque = np.zeros(len(forward) * fine), np.zeros(len(forward) * fine)
        self.memory[recorder.INTEGRAL] = self.memory[recorder.NOTCH_1] = self.memory[recorder.NOTCH_2] = 0.0
        machine = self.machine
        unsteady = readings.unsteady(self._unsteady, len(forward), machine.instruments, machine.base.rated_torque_nm)
        system, asked = (self.state, machine.p, machine.bursts), (np.ascontiguousarray(target), forward)
        out = recorder.run(*system, gains, self.memory, self._drive, *asked, unsteady, shown, fine_torque, self.substep_s)
        travel = machine.base.stroke_m
        if not (np.isfinite(self.state).all() and -0.05 * travel < out[0].min() * machine.base.radius_m):
            raise RuntimeError("the machine left its travel or its state is no longer finite")
        if out[0].max() * machine.base.radius_m > 1.05 * travel:
            raise RuntimeError("the machine left its travel")
        return (*out, unsteady[:, 0], shown, fine_torque)

    def record(self, task: Task) -> Record:
        """Go to the start of a record (not recorded), then make it."""
        base, instruments = self.machine.base, self.machine.instruments
        here = self.state[at.ANGLE] * base.radius_m
        able = abilities(self.machine)
        gentle = min(able.gentle_m_s2, 4.0 * base.scale.acceleration)
        there = Path(float(here), instruments.period_s).move(task.start_m, 0.8 * base.scale.speed, gentle).rest(0.2)
        self.follow(there.reference(), self._tracking)
        for _ in range(10):  # as an operator would, wait for a payload that swings
            waiting = Path(task.start_m, instruments.period_s).rest(0.1).reference()
            if np.ptp(self.follow(waiting, self._tracking)[0]) < 5.0 * base.quantum_rad:
                break
        began, bristle = self.time_s, float(self.state[at.Z_MOTOR])
        if task.reference is not None:
            gains = self._tracking if task.integral else self._fast
            made = self.follow(task.reference, gains, self.per_sample)
        else:
            assert task.excitation is not None
            hold = recorder.reading(self.state[at.ANGLE], base.quantum_rad, self.machine.p)
            self.memory[recorder.FILTERED_SPEED] = 0.0
            target = np.column_stack((np.full(len(task.excitation), hold), np.zeros(len(task.excitation))))
            made = self._run(self._centring, target, task.excitation, self.per_sample)
        position, setpoint, torque, acting, lengths, fine, fine_torque = made
        noise = readings.coloured(self._noise, len(torque), base.torque_noise_nm, instruments.noise_colour)
        read = readings.torque_reading(torque, noise, instruments, base.rated_torque_nm)
        stamps = readings.time_stamps(self._stamps, lengths, instruments)
        return Record(task, began, position, read, setpoint, acting, fine, bristle, stamps, fine_torque)


def run_session(machine: Machine, plan_name: str, substep_s: float = SUBSTEP_S, fine: int = 0) -> Iterator[Record]:
    """All records of a plan, one after the other."""
    session = Session(machine, substep_s, fine)
    tasks = list(plan(machine, plan_name))
    session.place(tasks[0].start_m)
    for task in tasks:
        yield session.record(task)
