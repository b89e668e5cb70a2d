"""Power stage, motor with its nameplate, its current, and encoder: all that touches the machine."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from beltcomm.errors import UsageError
from beltcomm.plant import BrakedPlant, Plant
from beltcomm.plant.drive_section import IDEAL, Instruments
from beltcomm.virtual.faults import Faults
from beltcomm.virtual.torque_path import Noise, TorqueDelivery, TorqueReading, mean_torque


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
        """The stage goes off.

        Parameters
        ----------
        held : bool
            The torque stays until the brake has closed.
        """
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
        """No current from now on; setpoints on their way are lost.

        Parameters
        ----------
        held : bool
            But not before the brake has closed.
        """
        self._on = False
        self._brake.close(held)
        self._on_the_way = deque([0.0] * self._delay_ticks)
        self._acting_nm = 0.0
        self._delivery.reset()
        if self._command is not None:
            self._command.reset()

    def run(self, setpoint_nm: float, now_s: float) -> None:
        """Let one tick pass that began at ``now_s`` with this setpoint decided."""
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
        load = mean_torque(acting) / self._motor.rated_torque_nm
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
        """Take a sample; returns its angle."""
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
