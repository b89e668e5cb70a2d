"""The control loops of the drive: scaling, gains and limits from the objects, and the compiled cascade on top of them.

SI at the motor shaft.  Angles are the encoder's, whole counts; the zero of the user's positions is kept apart, so that
homing moves no reference.
"""

from __future__ import annotations

import math
from dataclasses import replace

from beltcomm.control import begin_ramp, cascade_step, discrete_coefficients, new_state, reset_state, velocity_step
from beltcomm.virtual.dictionary import ObjectDictionary, ObjectEntry
from beltcomm.virtual.faults import Faults
from beltcomm.virtual.profiles import VirtualProfile
from beltcomm.virtual.stage import Nameplate

#: Below this speed the axis counts as standing: five encoder counts per tick at 65536 counts per revolution.
STANDSTILL_RAD_S = 0.5

# The compiled cascade wants a positive limit; this one moves nothing.
_NO_TORQUE_NM = 1e-9


class Loops:
    """Loops with which the modes of operation drive the axis.

    Attributes
    ----------
    angle_rad, speed_rad_s
        The present sample.
    limit_nm
        Bound of the torque setpoint.
    demand_rad, following_error_rad, output_rad_s, demand_nm
        Position reference, error and output of the position controller, and torque setpoint of the last loop.
    limited
        A setpoint was cut to a limit.
    tick_s, ticks_per_ms
        The cycle.
    asked_rad_s
        Speed that the velocity controller was asked for last; None while it does not run.
    """

    def __init__(
        self,
        dictionary: ObjectDictionary,
        profile: VirtualProfile,
        motor: Nameplate,
        counts_per_rev: int,
        faults: Faults,
        tick_s: float,
    ) -> None:
        self.dictionary = dictionary
        self.tick_s, self.ticks_per_ms = tick_s, 1e-3 / tick_s
        self._faults = faults
        self.profile = profile
        self._motor = motor
        self._counts_per_rev = counts_per_rev
        self.set_zero(0)
        self.angle_rad = 0.0
        self.speed_rad_s = 0.0
        self._state = new_state()
        self._limits = dictionary.entry(0x607D, 1), dictionary.entry(0x607D, 2)
        self._period = dictionary.entry(0x60C2, 1), dictionary.entry(0x60C2, 2)
        self.restart()
        for index in profile.gain_objects:
            for subindex in range(256):
                if dictionary.has(index, subindex):
                    dictionary.entry(index, subindex).changed = self._mark_gains
        for index in (0x6072, 0x6073, 0x6075):
            dictionary.entry(index).changed = self.reload_limit
        for index, subindex in ((0x607E, 0), (0x60A9, 0), (0x6093, 1), (0x6093, 2), (0x6094, 1), (0x6094, 2), (0x6097, 1), (0x6097, 2)):
            if dictionary.has(index, subindex):
                dictionary.entry(index, subindex).changed = self._on_factor

    def restart(self) -> None:
        """Take over all objects after power-on."""
        self.i2t_limited = False
        self.reload_scaling()
        self.reload_gains()
        self._period_at_reset_s = self._period_s()
        self.begin()

    def reload_scaling(self) -> None:
        """607Eh and the factor group."""
        self.scaling = self.profile.scaling(self.dictionary, self._counts_per_rev)
        self.units_per_count = self.scaling.position * math.tau / self._counts_per_rev
        self._rad_per_unit = 1.0 / self.scaling.position
        self._output_limit, self._dead_zone = self.profile.output_limit(self.dictionary, self.scaling)

    def reload_gains(self) -> None:
        """Gains, filters and feedforward; the controller starts from rest with them."""
        self._gains_stale = False
        told = self.profile.cascade(self.dictionary, self._motor)
        factor = self._faults.gain_factor
        self._cascade = replace(told, kp_nm_s_rad=factor * told.kp_nm_s_rad, ki_nm_rad=factor * told.ki_nm_rad)
        self._output_limit, self._dead_zone = self.profile.output_limit(self.dictionary, self.scaling)
        self._plain_position_error = math.isinf(self._output_limit) and self._dead_zone == 0.0
        self.filter_pole = self._cascade.velocity_filter_s / (self._cascade.velocity_filter_s + self.tick_s)
        self.reload_limit()
        self.open()

    def reload_limit(self) -> None:
        """6072h, 6073h, the motor's peak and I²t make one bound of the torque."""
        entry = self.dictionary.entry
        rated_ma = entry(0x6075).value or 1e3 * self._motor.rated_current_a  # a played drive may not tell it
        current_unit_nm = self._motor.torque_constant_nm_a * rated_ma * 1e-6  # 0.1 % of rated in mA
        of_peak = self.profile.peak_torque_units
        self.nm_per_unit = self._motor.peak_torque_nm / of_peak if of_peak else current_unit_nm
        limit = min(self.nm_per_unit * entry(0x6072).value, current_unit_nm * entry(0x6073).value, self._motor.peak_torque_nm)
        if self.i2t_limited:
            limit = min(limit, self._motor.rated_torque_nm)
        self.limit_nm = max(limit, _NO_TORQUE_NM)
        self._coefficients = discrete_coefficients(self._cascade, self.tick_s, self.limit_nm)

    @property
    def interpolation_ticks(self) -> int:
        """60C2h in force; 1 while it is 0, unused."""
        period_s = self._period_at_reset_s if self.profile.period_at_reset else self._period_s()
        return max(1, round(period_s / self.tick_s))

    def _period_s(self) -> float:
        value, power = self._period
        return float(value.value * 10.0**power.value)

    def set_zero(self, shift_counts: int) -> None:
        """The user's position is the encoder's count plus this, times units per count."""
        self.shift_counts = shift_counts
        self._shift_rad = shift_counts * math.tau / self._counts_per_rev

    def angle_of(self, position: float) -> float:
        """Encoder angle, rad, motor shaft, of a user position."""
        return position * self._rad_per_unit - self._shift_rad

    def position_of(self, angle_rad: float) -> float:
        """User position of an encoder angle, motor shaft."""
        return (angle_rad + self._shift_rad) * self.scaling.position

    def acceleration(self, entry: ObjectEntry) -> float:
        """Value of an acceleration object, rad/s², motor shaft."""
        return self.scaling.acceleration_of(entry.value)

    def halt_deceleration(self) -> float:
        """605Dh: along 6084h or along 6085h."""
        entry = self.dictionary.entry
        quick = self.dictionary.has(0x605D) and entry(0x605D).value == 2
        return self.acceleration(entry(0x6085 if quick else 0x6084))

    def within_limits(self, position: float) -> float:
        """A user position, cut to the software limits 607Dh while they are on."""
        lower, upper = self._limits[0].value, self._limits[1].value
        if lower <= position <= upper or lower >= upper:
            return position
        self.limited = True
        return float(min(max(position, lower), upper))

    def begin(self) -> None:
        """Start of a tick: take over gains written since the last one, forget what the last loop decided."""
        if self._gains_stale:
            self.reload_gains()
        self.limited = False
        self.demand_rad = self.angle_rad
        self.following_error_rad = 0.0
        self.output_rad_s = 0.0
        self.demand_nm = 0.0

    def open(self) -> None:
        """No controller runs; the next one starts from rest."""
        self._closed = False
        self.asked_rad_s: float | None = None

    def torque(self, torque_nm: float) -> float:
        """Torque that acts with all loops open, N m: the torque itself, limited."""
        self._closed, self.asked_rad_s = False, None
        if abs(torque_nm) >= self.limit_nm:
            torque_nm = math.copysign(self.limit_nm, torque_nm)
            self.limited = True
        self.demand_nm = torque_nm
        return torque_nm

    def velocity(self, speed_rad_s: float, acceleration_rad_s2: float, extra_nm: float = 0.0) -> float:
        """Torque setpoint, N m, of the velocity loop on a reference; ``extra_nm`` is added behind the controller."""
        self._close()
        self.asked_rad_s = speed_rad_s
        return self._decide(velocity_step(self._coefficients, self._state, speed_rad_s, acceleration_rad_s2, self.angle_rad, extra_nm))

    def position(self, angle_rad: float, speed_rad_s: float, acceleration_rad_s2: float, extra_nm: float = 0.0) -> float:
        """Torque setpoint, N m, of the position cascade on a reference in angles of the encoder, not from the user's zero.

        ``extra_nm`` is added behind the controller.
        """
        self._close()
        self.demand_rad = angle_rad
        error = angle_rad - self.angle_rad
        self.following_error_rad = error
        if not self._plain_position_error:
            error = math.copysign(max(0.0, abs(error) - self._dead_zone), error)
            bound = self._output_limit / max(self._cascade.kpp_1_s, 1e-9)
            error = min(max(error, -bound), bound)
            angle_rad = self.angle_rad + error
        self.output_rad_s = self._cascade.kpp_1_s * error
        self.asked_rad_s = self.output_rad_s + self._cascade.feedforward.velocity * speed_rad_s
        return self._decide(
            cascade_step(self._coefficients, self._state, angle_rad, speed_rad_s, acceleration_rad_s2, self.angle_rad, extra_nm)
        )

    def begin_ramp(self, speed_rad_s: float) -> None:
        """Begin a reference without feedforward of its acceleration: the end of the one before is none either."""
        begin_ramp(self._state, speed_rad_s)

    def _on_factor(self) -> None:
        old = self.scaling
        self.reload_scaling()
        new = self.scaling
        self.dictionary.rescale("position", abs(new.position / old.position))
        self.dictionary.rescale("velocity", abs(new.velocity / old.velocity))
        self.dictionary.rescale("acceleration", new.acceleration / old.acceleration)

    def _mark_gains(self) -> None:
        self._gains_stale = True

    def _close(self) -> None:
        if not self._closed:  # a drive measures its speed all the time, not only since the loop is closed
            reset_state(self._state, self.angle_rad - self.speed_rad_s * self.tick_s, self.speed_rad_s)
            self._closed = True

    def _decide(self, torque_nm: float) -> float:
        self.demand_nm = torque_nm
        if abs(torque_nm) >= self.limit_nm:
            self.limited = True
        return torque_nm
