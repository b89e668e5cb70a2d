"""Power stage, motor with its nameplate, its current, and encoder: all that touches the machine."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import expm

from beltcomm.arrays import Array
from beltcomm.errors import UsageError
from beltcomm.plant import IDEAL, BrakedPlant, Instruments, Plant
from beltcomm.virtual.faults import Faults

Pieces = list[tuple[float, float]]

#: Pieces per tick in which the machine meets a torque that a filter shapes: 0.1 ms; the hold takes 0.8 % of 500 Hz and no time.
PIECES_PER_TICK = 10
_NOISE_BLOCK = 4096
_ROUNDING = 1e-9


class Noise:
    """Gaussian noise of a given rms, one value a tick:  n[k] = a n[k-1] + sqrt(1 - a²) w[k],  a = exp(-T/time).

    Parameters
    ----------
    rms_nm : float
        Standard deviation, N m.
    time_s : float
        Correlation time, s; 0: white.
    generator : numpy.random.Generator
        Source of w.
    """

    def __init__(self, rms_nm: float, time_s: float, generator: np.random.Generator, tick_s: float) -> None:
        self._rms_nm, self._generator = rms_nm, generator
        self._white: list[float] = []
        self._pole = math.exp(-tick_s / time_s) if time_s > 0.0 else 0.0
        self._share = math.sqrt(1.0 - self._pole**2)
        self._last: float | None = None

    def draw(self) -> float:
        """Value of the next tick, N m."""
        if not self._white:
            self._white = (self._rms_nm * self._generator.standard_normal(_NOISE_BLOCK)).tolist()
        white = self._white.pop()
        if self._pole == 0.0:
            return white
        self._last = white if self._last is None else self._pole * self._last + self._share * white
        return self._last


class TorqueDelivery:
    """Slope limit, setpoint filter and current loop, solved exactly for setpoints that are held.

    x' = A x + B u,  y = C x;  u follows the setpoint with a limited slope s.  Mean torques of pieces are exact: y is integrated as one
    more state of the matrix exponential.

    Parameters
    ----------
    instruments : Instruments
        Slope limit, filter and current loop are used.
    current_loop : bool
        False ends the path in front of the current loop: the torque that is asked of it.
    """

    def __init__(self, instruments: Instruments, tick_s: float, current_loop: bool = True) -> None:
        self._slew_nm_tick = instruments.torque_slew_nm_s * tick_s
        self._rates = _rate_matrix(instruments, tick_s, current_loop)
        self._order = len(self._rates) - 3
        self._response = lru_cache(maxsize=64)(self._solve)
        self.reset()

    @property
    def acts(self) -> bool:
        """True if the path changes a held setpoint at all."""
        return self._order > 0 or self._slew_nm_tick > 0.0

    def reset(self) -> None:
        """No torque, no current."""
        self._state = np.zeros(self._order + 1)

    def shape(self, setpoints: Pieces) -> Pieces:
        """Mean torques, N m, of pieces of a tick of at most 1/``PIECES_PER_TICK``, fewer where nothing changes, by setpoints, N m, and
        their shares of it.
        """
        pieces: Pieces = []
        for setpoint_nm, share in setpoints:
            ramp, slope = self._ramp(setpoint_nm, share)
            if ramp > 0.0:
                pieces += self._pass(ramp, slope)
            if share - ramp > 0.0:
                self._state[-1] = setpoint_nm
                pieces += self._pass(share - ramp, 0.0)
        return pieces

    def _ramp(self, setpoint_nm: float, share: float) -> tuple[float, float]:
        """Time for which the slope limit acts, in ticks, and the slope, N m per tick."""
        gap = setpoint_nm - self._state.item(-1)
        left = abs(gap) / self._slew_nm_tick if self._slew_nm_tick > 0.0 else 0.0
        if left <= _ROUNDING:
            return 0.0, 0.0
        return left if left < share - _ROUNDING else share, math.copysign(self._slew_nm_tick, gap)

    def _pass(self, share: float, slope: float) -> Pieces:
        state = self._state
        if slope == 0.0 and self._rests():
            return [(state.item(-1), share)]
        count = max(1, math.ceil(share * PIECES_PER_TICK - _ROUNDING))
        solved = (self._response(share, count) @ np.append(state, slope)).tolist()
        self._state = np.array(solved[count:])
        return [(torque, share / count) for torque in solved[:count]]

    def _rests(self) -> bool:
        """True if every filter has arrived at its input."""
        *inner, asked = self._state.tolist()
        return all(value == asked for value in inner)

    def _solve(self, share: float, count: int) -> Array:
        """Means of ``count`` equal pieces and the state at their end, linear in (x, u, slope).   (count + order + 1, order + 2)."""
        size = self._order + 2
        step = expm(self._rates * (share / count))
        advance = np.eye(size)
        rows = []
        for _ in range(count):
            rows.append(step[size, :size] @ advance * (count / share))
            advance = step[:size, :size] @ advance
        return np.vstack([*rows, advance[:-1]])


def _rate_matrix(instruments: Instruments, tick_s: float, current_loop: bool) -> Array:
    """d/dt of (x, u, slope of u, integral of y), time in ticks."""
    stages: list[tuple[float, ...]] = []  # rate; damping of the second order; of a notch, by how much that at its bottom is less
    if instruments.setpoint_filter_s > 0.0:
        stages.append((tick_s / instruments.setpoint_filter_s,))
    if instruments.setpoint_low_pass_hz > 0.0:
        stages.append((math.tau * instruments.setpoint_low_pass_hz * tick_s, math.sqrt(0.5)))
    if instruments.setpoint_notch_hz > 0.0:
        damping = 0.5 * instruments.setpoint_notch_width_hz / instruments.setpoint_notch_hz
        stages.append(
            (math.tau * instruments.setpoint_notch_hz * tick_s, damping, damping * (1.0 - 10.0 ** (-0.05 * instruments.setpoint_notch_db)))
        )
    if current_loop and instruments.current_loop_s > 0.0:
        stages.append((tick_s / instruments.current_loop_s,))
    if current_loop and instruments.current_loop_hz > 0.0:
        stages.append((math.tau * instruments.current_loop_hz * tick_s, instruments.current_loop_damping))
    order = sum(min(len(stage), 2) for stage in stages)
    matrix = np.zeros((order + 3, order + 3))
    matrix[order, order + 1] = 1.0
    source = np.eye(order + 3)[order]  # what the next stage takes in, as a sum of the states
    at = 0
    for stage in stages:
        rate = stage[0]
        if len(stage) == 1:
            matrix[at] = rate * source
            matrix[at, at] -= rate
            source = np.eye(order + 3)[at]
            at += 1
            continue
        # y' = w (z - y),  z' = w (in - y) - (2 d - 1) w (z - y): z is where y goes, and in when the loop rests.
        damping = stage[1]
        matrix[at, at], matrix[at, at + 1] = -rate, rate
        matrix[at + 1] = rate * source
        matrix[at + 1, at + 1] += -(2.0 * damping - 1.0) * rate
        matrix[at + 1, at] += (2.0 * damping - 2.0) * rate
        if len(stage) == 3:  # in - 2 (d - d0) (z - y), for 2 d (z - y) is the band that a notch of no depth left would let pass alone
            source = source.copy()
            source[at + 1] -= 2.0 * stage[2]
            source[at] += 2.0 * stage[2]
        else:
            source = np.eye(order + 3)[at]
        at += 2
    matrix[order + 2] = source
    return matrix


class TorqueReading:
    """From the torque of a tick to what stands in 6077h at its end: mean, late, filter and noise, steps.

    r[k] = a r[k-1] + (1 - a) m[k],  a = exp(-T/``reading_filter_s``);  m : mean over a tick that ended ``reading_late_ticks`` ago.

    Parameters
    ----------
    instruments : Instruments
        What belongs to the reading is used.
    noise : Noise or None
        Of the sensor.
    """

    def __init__(self, instruments: Instruments, noise: Noise | None, tick_s: float) -> None:
        self._noise = noise
        self._pole = math.exp(-tick_s / instruments.reading_filter_s) if instruments.reading_filter_s > 0.0 else 0.0
        self._inside = instruments.reading_filters_noise
        self._step_nm = instruments.reading_step_nm
        late_ticks = instruments.reading_late_ticks * (1e-3 / tick_s)
        whole = math.floor(late_ticks + _ROUNDING)
        late = late_ticks - whole
        self._late = late if late > _ROUNDING else 0.0
        self._parts = deque([(0.0, 0.0)] * (whole + 2), maxlen=whole + 2)
        self._is_late = instruments.reading_late_ticks > 0.0
        self._filtered = 0.0

    def sample(self, pieces: Pieces) -> float:
        """The reading at the end of a tick, N m, by pieces of its torque, N m, and their shares."""
        value = self._mean(pieces)
        noise = self._noise.draw() if self._noise is not None else 0.0
        if self._inside:
            value += noise
        if self._pole > 0.0:
            value = self._filtered = self._pole * self._filtered + (1.0 - self._pole) * value
        if not self._inside:
            value += noise
        return self._step_nm * math.floor(value / self._step_nm + 0.5) if self._step_nm > 0.0 else value

    def _mean(self, pieces: Pieces) -> float:
        if not self._is_late:
            return _mean_torque(pieces)
        begin = _mean_torque(_cut(pieces, 1.0 - self._late))
        self._parts.append((begin, _mean_torque(pieces) - begin))
        return self._parts[0][1] + self._parts[1][0]


def _mean_torque(pieces: Iterable[tuple[float, float]]) -> float:
    """Mean over the tick, N m:  Σ torque · share, for pieces of torque, N m, and share of the tick."""
    total = 0.0
    for torque_nm, share in pieces:
        total += share * torque_nm
    return total


def _cut(pieces: Pieces, end: float) -> Pieces:
    """Pieces in front of ``end``, a share of the tick."""
    found, begin = [], 0.0
    for torque_nm, share in pieces:
        if begin >= end:
            break
        found.append((torque_nm, min(share, end - begin)))
        begin += share
    return found


@dataclass(frozen=True)
class Nameplate:
    """Nameplate of a servo motor.

    Attributes
    ----------
    rated_torque_nm, peak_torque_nm : float, N m
    rated_current_a : float
        A rms.
    max_speed_rpm : float
        1/min.
    """

    rated_torque_nm: float
    peak_torque_nm: float
    rated_current_a: float
    max_speed_rpm: float

    @property
    def torque_constant_nm_a(self) -> float:
        """Torque per current, N m/A."""
        return self.rated_torque_nm / self.rated_current_a

    @property
    def peak_permille(self) -> int:
        """Peak torque in 0.1 % of the rated torque; equally the peak current."""
        return round(1000.0 * self.peak_torque_nm / self.rated_torque_nm)


#: EMMS-AS-70-S-LS-RMB of the thesis's rig (table A.1).
EMMS_AS_70 = Nameplate(rated_torque_nm=1.43, peak_torque_nm=3.10, rated_current_a=2.2, max_speed_rpm=6300.0)


# The motor carries its peak torque from cold for this long (6410h:3 of the CMMP-AS, default 2000 ms).
I2T_TIME_S = 2.0

# A switch of the torque this close to a tick falls on it: below the rounding of delay / tick.
_SWITCH_ROUNDING = 1e-9


class Brake:
    """The motor's holding brake, which the drive opens with the stage and closes without being asked; both take ``time_s``.

    A stop that ends in the stage off keeps the torque until the brake has closed, as drives do; a stage that is cut off, by a command or
    a fault, leaves the axis free as long.   Without ``torque_nm`` there is none.   Raises UsageError for a plant that has none.
    """

    def __init__(self, plant: Plant, torque_nm: float, time_s: float, tick_s: float) -> None:
        if torque_nm and not isinstance(plant, BrakedPlant):
            raise UsageError("this machine has no brake that the drive could close; leave brake_torque_nm out")
        self._plant = plant
        self._torque_nm = torque_nm
        self._ticks = round(time_s / tick_s)
        self._left, self._next_nm = 0, torque_nm
        self._press(torque_nm)

    def open(self) -> None:
        """The stage is on."""
        self._left, self._next_nm = 1 + self._ticks, 0.0

    def close(self, held: bool) -> None:
        """The stage goes off; ``held``: the torque stays until the brake has closed."""
        self._left, self._next_nm = 1 if held else 1 + self._ticks, self._torque_nm

    def pass_tick(self) -> None:
        """One tick begins."""
        if self._left:
            self._left -= 1
            if not self._left:
                self._press(self._next_nm)

    def _press(self, torque_nm: float) -> None:
        if self._torque_nm and isinstance(self._plant, BrakedPlant):
            self._plant.brake(torque_nm)


class PowerStage:
    """Turns torque setpoints into acting torque and lets the machine move on, one tick at a time.

    A setpoint decided at t_k acts from t_k + ``setpoint_delay_s`` on, until the next one does; within a tick the machine is stepped in
    two pieces when the switch falls inside, and in more where ``instruments`` filter the torque.

    Attributes
    ----------
    torque_sample_nm
        Reading at the end of the tick, N m: mean acting torque with sensor noise, or what the instruments make of it.
    i2t_exceeded
        The I²t reserve (peak current for 2 s) is used up; False again at half of it.
    """

    def __init__(
        self,
        plant: Plant,
        motor: Nameplate,
        setpoint_delay_s: float,
        torque_noise_nm: float,
        seed: int,
        faults: Faults,
        brake: tuple[float, float],
        instruments: Instruments,
        tick_s: float,
    ) -> None:
        self._plant = plant
        self._tick_s = tick_s
        self._brake = Brake(plant, *brake, tick_s)
        self._motor = motor
        self._faults = faults
        delay = setpoint_delay_s / tick_s
        self._delay_ticks = math.floor(delay + _SWITCH_ROUNDING)
        share = delay - self._delay_ticks
        self._old_share = share if share > _SWITCH_ROUNDING else 0.0
        self._delivery = TorqueDelivery(instruments, tick_s)
        self._command = TorqueDelivery(instruments, tick_s, current_loop=False) if instruments.reading_is_command else None
        process, time_s = instruments.process_torque_nm, instruments.process_torque_time_s
        # A source of its own: what acts by itself does not change what the sensor adds.
        self._process = Noise(process, time_s, np.random.default_rng((seed, 1)), tick_s) if process > 0.0 else None
        quiet = torque_noise_nm <= 0.0 or instruments.reading_is_command
        noise = None if quiet else Noise(torque_noise_nm, instruments.torque_noise_time_s, np.random.default_rng(seed), tick_s)
        self._reading = TorqueReading(instruments, noise, tick_s)
        self._i2t_reserve = ((motor.peak_torque_nm / motor.rated_torque_nm) ** 2 - 1.0) * I2T_TIME_S
        self._i2t = 0.0
        self.i2t_exceeded = False
        self.torque_sample_nm = 0.0
        self.switch_off()

    def switch_on(self) -> None:
        """The motor carries torque, the brake begins to open."""
        self._on = True
        self._brake.open()

    def switch_off(self, held: bool = False) -> None:
        """No current from now on, with ``held`` once the brake has closed; setpoints on their way are lost."""
        self._on = False
        self._brake.close(held)
        self._on_the_way = deque([0.0] * self._delay_ticks)
        self._acting_nm = 0.0
        self._delivery.reset()
        if self._command is not None:
            self._command.reset()

    def run(self, setpoint_nm: float, now_s: float) -> None:
        """Let one tick pass that begins at ``now_s`` with the setpoint decided there."""
        self._brake.pass_tick()
        self._on_the_way.append(setpoint_nm)
        old, new = self._acting_nm, self._on_the_way.popleft()
        self._acting_nm = new
        share = self._old_share
        setpoints = [(new, 1.0)] if share == 0.0 else [(old, share), (new, 1.0 - share)]
        acting = self._delivery.shape(setpoints) if self._delivery.acts else setpoints
        if self._process is not None:
            process = self._process.draw() if self._on else 0.0
            acting = [(torque + process, part) for torque, part in acting]
        faults = self._faults
        blocked = faults.stuck_from_s is not None and now_s >= faults.stuck_from_s
        acts = faults.weak_share if faults.weak_from_s is not None and now_s >= faults.weak_from_s else 1.0
        if not blocked:
            for torque, part in acting:
                self._plant.step(acts * torque, part * self._tick_s)
        self.torque_sample_nm = self._reading.sample(acting if self._command is None else self._command.shape(setpoints))
        load = _mean_torque(acting) / self._motor.rated_torque_nm
        used = self._i2t + (load * load - 1.0) * self._tick_s
        self._i2t = used if used > 0.0 else 0.0
        if used >= self._i2t_reserve:
            self.i2t_exceeded = True
        elif self.i2t_exceeded and used <= 0.5 * self._i2t_reserve:
            self.i2t_exceeded = False


class Encoder:
    """Counts of an incremental encoder on the motor shaft.

    counts = round(φ · counts_per_rev / 2π): a count stands for the angles half a count to either side, so that readings have no
    systematic error.  The tracks of a sin/cos encoder may err:  φ + a sin(Lφ) + b sin(2Lφ),  L lines per turn.

    Parameters
    ----------
    zero_rad : float
        Motor angle of count 0, rad. rad_per_count : size of one count, rad. counts, angle_rad : the sample latched last; the angle in
        whole counts.
    """

    def __init__(self, plant: Plant, counts_per_rev: int, zero_rad: float, faults: Faults, instruments: Instruments = IDEAL) -> None:
        self._plant = plant
        self._per_rad = counts_per_rev / math.tau
        self.rad_per_count = math.tau / counts_per_rev
        self._zero_rad = zero_rad
        self._faults = faults
        self._lines = instruments.lines_per_rev
        self._once_rad, self._twice_rad = instruments.interpolation_error_rad, instruments.interpolation_error_twice_rad
        self._jumped = 0
        self.counts = 0
        self.angle_rad = 0.0

    def latch(self, now_s: float) -> float:
        """Take a sample: whole counts, rad, motor shaft."""
        faults = self._faults
        if faults.encoder_step_at_s is not None and now_s >= faults.encoder_step_at_s:
            self._jumped += faults.encoder_step_counts
            faults.encoder_step_at_s = None
        angle = self._plant.position_rad - self._zero_rad
        if self._once_rad or self._twice_rad:
            phase = self._lines * angle
            angle += self._once_rad * math.sin(phase) + self._twice_rad * math.sin(2.0 * phase)
        counts = math.floor(angle * self._per_rad * faults.encoder_sign + 0.5)
        self.counts = counts = counts + self._jumped
        self.angle_rad = angle = counts * self.rad_per_count
        return angle
