"""The inside of the drive: samples, state machine, modes, loops and limits, once per tick.

In tick k: :meth:`Servo.latch` samples at t_k (encoder at t_k, torque of the tick just ended), watches the limits and makes
the statusword; :meth:`Servo.run` decides the torque with the setpoints in force and lets the machine move to t_k+1.
Demand values (6062h, 6074h, 60F4h, 60FAh) are those of the last loop, one tick older than the samples beside them.
"""

from __future__ import annotations

from collections.abc import Callable
from math import floor

from beltcomm.plant import Plant
from beltcomm.virtual.cia402 import DriveState, DriveStateMachine, Guidance
from beltcomm.virtual.dictionary import ObjectDictionary, SdoAbort
from beltcomm.virtual.emcy import Code, ErrorRegister
from beltcomm.virtual.faults import Faults
from beltcomm.virtual.homing import Homing
from beltcomm.virtual.loops import STANDSTILL_RAD_S, Loops
from beltcomm.virtual.modes import (
    BIT_13,
    CyclicPosition,
    CyclicTorque,
    CyclicVelocity,
    InterpolatedPosition,
    NoMode,
    OperationMode,
    ProfilePosition,
    ProfileTorque,
    ProfileVelocity,
    StopKind,
    StopMode,
)
from beltcomm.virtual.profiles import VirtualProfile
from beltcomm.virtual.stage import Encoder, PowerStage
from beltcomm.virtual.supervision import Supervision

_FAULT_RESET = 1 << 7
_VOLTAGE_ENABLED, _WARNING, _MOVING, _REMOTE = 1 << 4, 1 << 7, 1 << 8, 1 << 9
_INTERNAL_LIMIT, _REFERENCED = 1 << 11, 1 << 15
_WITH_POSITION_REFERENCE = frozenset({1, 7, 8})
_TORQUE_MODES = (4, 10)
_MODES: dict[int, type[OperationMode]] = {
    1: ProfilePosition,
    3: ProfileVelocity,
    4: ProfileTorque,
    7: InterpolatedPosition,
    8: CyclicPosition,
    9: CyclicVelocity,
    10: CyclicTorque,
}
_BUS_CONTROL = 2
_NOTHING, _FAULT, _OFF, _QUICK_STOP = range(4)  # 6007h
_QUICK_STOP_WORD = 0x0002
#: 605Ah: how the axis stops; from 5 on it is held then.
_QUICK_STOP_KINDS = {0: 0, 1: 1, 2: 2, 3: 3, 5: 1, 6: 2, 7: 3}
_FIRST_THAT_HOLDS = 5
_DISABLE_VOLTAGE = 0x0000
_CONTROLLER_ENABLE = 1 << 21  # DIN5 in 60FDh of the cmmp-as


def _int16(value: float) -> int:
    """Rounded, and cut to what the object can hold."""
    number = floor(value + 0.5)
    return number if -0x8000 <= number <= 0x7FFF else min(max(number, -0x8000), 0x7FFF)


def _int32(value: float) -> int:
    """Rounded; wrapped round like a position counter."""
    number = floor(value + 0.5)
    return number if -0x80000000 <= number <= 0x7FFFFFFF else (number + 0x80000000 & 0xFFFFFFFF) - 0x80000000


class Servo:
    """Everything of the drive that is not communication.

    Parameters
    ----------
    end_switches_rad : tuple[float, float] or None
        Motor angles (lower, upper) at and beyond which the switches close; None: not wired.
    referenced : bool
        The drive knows its zero when it is switched on.
    """

    def __init__(
        self,
        dictionary: ObjectDictionary,
        profile: VirtualProfile,
        loops: Loops,
        stage: PowerStage,
        encoder: Encoder,
        plant: Plant,
        errors: ErrorRegister,
        faults: Faults,
        end_switches_rad: tuple[float, float] | None,
        referenced: bool,
        fault_bits: int,
    ) -> None:
        self._dictionary, self._profile, self._loops = dictionary, profile, loops
        self._stage, self._encoder, self._plant = stage, encoder, plant
        self._errors, self._faults = errors, faults
        self._end_switches_rad = end_switches_rad
        self._absolute = referenced
        self.referenced = referenced
        self.machine = DriveStateMachine(self._entered, fault_bits)
        self._supervision = Supervision(loops, self.fault)
        self._homing = Homing(loops, self._wired_switches, self._set_home, lambda: errors.report(Code.HOMING))
        self._modes: dict[int, OperationMode] = {n: make(loops) for n, make in _MODES.items() if n in profile.modes}
        self._modes[0] = NoMode(loops)
        self._modes[6] = self._homing
        self._mode_number = 0
        self._mode = self._modes[0]
        self._stop = StopMode(loops)
        self._guidance = Guidance(self.machine, self._stop, dictionary, 1e-3 * profile.enable_ms, self._resume)
        self._switches = (False, False)
        self._warm = False
        self._now_s = 0.0
        self._last_controlword = 0
        self._unsettled = True
        self._current_factor_written = False
        self._ticks_per_second = round(1.0 / loops.tick_s)
        self._bind_objects()

    def _bind_objects(self) -> None:
        entry = self._dictionary.entry
        self._controlword, self._statusword = entry(0x6040), entry(0x6041)
        self._controlword.changed = self._on_controlword
        self._asked_mode, self._shown_mode = entry(0x6060), entry(0x6061)
        self._asked_mode.check, self._asked_mode.changed = self._check_mode, self._on_mode
        entry(0x605A).check = self._one_of(self._profile.quick_stops)
        entry(0x6098).check = self._one_of(self._profile.homing)
        self._quick_stop_code = entry(0x605A)
        has = self._dictionary.has
        self._loss, self._reaction = (entry(index) if has(index) else None for index in (0x6007, 0x605E))
        self._position_demand, self._position = entry(0x6062), entry(0x6064)
        self._velocity, self._following_error = entry(0x606C), entry(0x60F4)
        self._torque_demand, self._torque, self._current = entry(0x6074), entry(0x6077), entry(0x6078)
        self._inputs = entry(0x60FD)
        self._enable_logic = entry(0x6510, 0x10) if self._dictionary.has(0x6510, 0x10) else None
        if self._enable_logic is not None:
            self._enable_logic.changed = self._settle_anew
        self._vendor_status = entry(0x2000, 1) if self._dictionary.has(0x2000, 1) else None
        self._output = entry(0x60FA) if self._dictionary.has(0x60FA) else None
        rated_current = entry(0x6075)
        if rated_current.row.access == "rw":
            # F1 p97: 6073h is taken only after 6075h was written.
            entry(0x6073).check = self._check_max_current
            rated_current.changed = self._on_rated_current

    def restart(self) -> None:
        """Power-on, or the end of a node reset: stage off, everything from the objects."""
        self._stage.switch_off()
        self._warm = False
        self._last_controlword = 0
        self._current_factor_written = False
        self.referenced = self._absolute
        self._loops.set_zero(0)
        if self._faults.rated_torque_nm is not None:
            self._dictionary.entry(0x6076).value = round(1000 * self._faults.rated_torque_nm)
        if self._faults.dc_link_v is not None:
            self._dictionary.entry(0x6079).value = round(1000 * self._faults.dc_link_v)
        for place, value in self._faults.readings.items():
            self._dictionary.entry(*place).value = value
        self._encoder.latch(self._now_s)
        self._loops.angle_rad, self._loops.speed_rad_s = self._encoder.angle_rad, 0.0
        self._loops.restart()
        self.machine.power_on()
        self._mode_number, self._mode = 0, self._modes[0]
        self._shown_mode.value = 0
        self._on_mode()

    def latch(self, tick: int) -> None:
        """t_k: sample, supervise, publish."""
        now_s = self._now_s = tick / self._ticks_per_second
        loops, stage, encoder, dictionary = self._loops, self._stage, self._encoder, self._dictionary
        before = encoder.angle_rad
        angle = loops.angle_rad = encoder.latch(now_s)
        pole = loops.filter_pole
        speed = loops.speed_rad_s = pole * loops.speed_rad_s + (1.0 - pole) * (angle - before) / loops.tick_s
        scaling = loops.scaling
        position = _int32((encoder.counts + loops.shift_counts) * loops.units_per_count)
        self._position.value = position
        self._velocity.value = _int32(speed * scaling.velocity)
        # In 0.1 % torque and current are one number: 6077h is computed from the current.
        self._torque.value = self._current.value = _int16(stage.torque_sample_nm / loops.nm_per_unit)
        dictionary.moving = abs(speed) >= STANDSTILL_RAD_S
        if self._end_switches_rad is not None:
            angle = self._plant.position_rad
            self._switches = (angle <= self._end_switches_rad[0], angle >= self._end_switches_rad[1])
        faults = self._faults
        if faults.end_switch_from_s is not None:
            pressed = now_s >= faults.end_switch_from_s
            lower, upper = self._switches if self._end_switches_rad is not None else (False, False)
            self._switches = (lower or pressed, upper) if faults.end_switch == 0 else (lower, upper or pressed)
        low = _CONTROLLER_ENABLE if faults.enable_input_low else 0
        self._inputs.value = self._switches[0] | self._switches[1] << 1 | self._profile.enable_inputs & ~low
        if faults.stage_blocked:
            self.machine.control(_DISABLE_VOLTAGE)
        if faults.emergency_at_s is not None or faults.warm_from_s is not None or faults.rewritten_at_s is not None:
            self._suffer(now_s)
        self._guidance.pass_tick(self._controlword.value, now_s)
        if dictionary.stage_on:
            follows_position = self._mode_number in _WITH_POSITION_REFERENCE
            self._publish_demand(position, follows_position)
            self._supervision.check(position, self._switches, self._mode is self._homing, follows_position)
        if stage.i2t_exceeded != loops.i2t_limited:
            self._on_i2t(stage.i2t_exceeded)
        if self._unsettled and self._remote:
            self._unsettled = False
            self._lead(self._controlword.value)
        self._publish_status()

    def _suffer(self, now_s: float) -> None:
        """The drive's faults that come by themselves."""
        faults = self._faults
        if faults.emergency_at_s is not None and now_s >= faults.emergency_at_s:
            faults.emergency_at_s = None
            if faults.emergency_effect == "report":
                self._errors.report(faults.emergency_code)
            else:
                self.fault(faults.emergency_code, faults.emergency_effect == "off")
        if faults.rewritten_at_s is not None and now_s >= faults.rewritten_at_s:
            faults.rewritten_at_s = None
            for key, (factor, summand) in faults.rewritten.items():
                if self._dictionary.has(*key):
                    entry = self._dictionary.entry(*key)
                    entry.value = type(entry.value)(factor * entry.value + summand)
                    if entry.changed is not None:
                        entry.changed()
        if faults.warm_from_s is not None and now_s >= faults.warm_from_s:
            self._warm = True
            if now_s >= faults.warm_from_s + faults.warm_for_s:
                faults.warm_from_s = None
                self.fault(Code.MOTOR_TEMPERATURE, False)

    def run(self) -> None:
        """The loop of the tick, then the tick itself."""
        self._loops.begin()
        torque_nm = 0.0
        if self.machine.operates:
            torque_nm = self._guidance.brake(self._controlword.value) if self._guidance.ramping else self._mode.step()
        elif self._dictionary.stage_on:
            torque_nm = self._stop.step()
            if self._stop.done:
                self.machine.ramp_done()
        self._stage.run(torque_nm, self._now_s)

    def fault(self, code: int, coast: bool) -> None:
        """Go into fault with this EMCY code; with ``coast`` the stage does not brake."""
        self._errors.raise_error(code)
        self.machine.fault(coast)
        self._publish_status()

    def communication_lost(self, code: int) -> None:
        """The master is gone or has stopped the node: a fault while the motor carries torque, else only a message."""
        if self._faults.guarding_ignored and code == Code.LIFE_GUARD:
            return
        option = _FAULT if self._loss is None else self._loss.value
        if not self.machine.powered or option == _NOTHING:
            self._errors.report(code)
        elif option == _FAULT:
            self.fault(code, self._faults.guarding_coasts)
        else:
            self._errors.report(code)
            self._controlword.value = _DISABLE_VOLTAGE if option == _OFF else _QUICK_STOP_WORD
            self._lead(self._controlword.value)
            self._publish_status()

    @property
    def _remote(self) -> bool:
        return not self._faults.local_control and (self._enable_logic is None or self._enable_logic.value == _BUS_CONTROL)

    def _lead(self, controlword: int) -> None:
        """The state machine along the controlword, as far as the inputs let it."""
        self._guidance.follow(_DISABLE_VOLTAGE if self._faults.stage_blocked else controlword, self._now_s)

    def _resume(self) -> None:
        self._mode.start()

    def _settle_anew(self) -> None:
        self._unsettled = True
        self._publish_status()

    def _on_controlword(self) -> None:
        before, now = self._last_controlword, self._controlword.value
        self._last_controlword = now
        if not self._remote:
            return
        if now & ~before & _FAULT_RESET and self.machine.state == DriveState.FAULT:
            self._errors.clear()
            self.machine.reset_fault()
        self._mode.controlword = before
        self._lead(now)
        if self.machine.state == DriveState.OPERATION_ENABLED:
            self._mode.control(now)
        self._mode.controlword = now
        self._publish_status()

    def _on_mode(self) -> None:
        number = self._asked_mode.value
        if number == 0 and self._mode_number:
            return  # no change
        if number not in self._modes or number in self._faults.refused_modes:
            return
        self._shown_mode.value = self._mode_number = number
        self._mode = self._modes[number]
        self._mode.controlword = self._controlword.value
        self._mode.start()
        self._publish_status()

    def _entered(self, number: int, state: DriveState) -> None:
        """After a transition of the state machine."""
        self._guidance.forget()
        self._unsettled = True  # the controlword may lead further: its level counts, not only its writing
        self._dictionary.stage_on = self.machine.powered
        if state == DriveState.OPERATION_ENABLED:
            self._stage.switch_on()
            self._stop.done = False
            self._supervision.begin()
            self._loops.open()
            self._mode.start()
        elif state in (DriveState.QUICK_STOP_ACTIVE, DriveState.FAULT_REACTION_ACTIVE):
            self.machine.quick_stop_holds = self._quick_stop_code.value >= _FIRST_THAT_HOLDS
            if state == DriveState.QUICK_STOP_ACTIVE:
                kind = StopKind(_QUICK_STOP_KINDS[self._quick_stop_code.value])
                kind = StopKind.COAST if self._faults.torque_stop_coasts and self._mode_number in _TORQUE_MODES else kind
            else:
                kind = StopKind.QUICK if self._reaction is None else StopKind(self._reaction.value)
            self._stop.start(kind)
        else:
            self._stage.switch_off(held=self._stop.done)
            self._loops.open()

    def _on_i2t(self, exceeded: bool) -> None:
        if exceeded and self._profile.i2t_faults:
            if self.machine.powered:
                self.fault(Code.I2T, False)
        else:
            self._loops.i2t_limited = exceeded
            self._loops.reload_limit()

    def _publish_demand(self, position: int, follows_position: bool) -> None:
        loops = self._loops
        if follows_position:
            self._position_demand.value = _int32(loops.position_of(loops.demand_rad))
            self._following_error.value = _int32(loops.following_error_rad * loops.scaling.position)
        else:
            self._position_demand.value = position
            self._following_error.value = 0
        self._torque_demand.value = _int16(loops.demand_nm / loops.nm_per_unit)
        if self._output is not None:
            self._output.value = _int32(loops.output_rad_s * loops.scaling.velocity)

    def _publish_status(self) -> None:
        machine, loops, profile, faults = self.machine, self._loops, self._profile, self._faults
        word = machine.status_bits
        if faults.dc_link_v is None or faults.has_power:
            word |= _VOLTAGE_ENABLED
        if self._remote:
            word |= _REMOTE
        if machine.operates:
            word |= self._mode.status()
        if self._supervision.following_error and self._mode_number in _WITH_POSITION_REFERENCE:
            word |= BIT_13
        if loops.limited:
            word |= _INTERNAL_LIMIT
        if loops.i2t_limited:
            word |= _WARNING | _INTERNAL_LIMIT
        if self._warm:
            word |= _WARNING
        if self.referenced and profile.tells_zero:
            word |= _REFERENCED
        if profile.vendor_bits and self._dictionary.moving:
            word |= _MOVING
        self._statusword.value = word
        if self._vendor_status is not None:
            faulted = machine.state in (DriveState.FAULT, DriveState.FAULT_REACTION_ACTIVE)
            ready = not faulted and self._faults.has_power and not self._faults.sto_open  # the enable input is not asked (F1 p164)
            self._vendor_status.value = self.referenced | 2 | ready << 2

    def _wired_switches(self) -> tuple[bool, bool] | None:
        return None if self._end_switches_rad is None else self._switches

    def _set_home(self, angle_rad: float) -> None:
        offset = self._dictionary.entry(0x607C).value / self._loops.units_per_count
        self._loops.set_zero(round(-offset) - round(angle_rad / self._encoder.rad_per_count))
        self.referenced = True

    def _check_mode(self, value: int) -> int:
        if value not in self._modes:
            raise SdoAbort(SdoAbort.BAD_VALUE)
        return value

    @staticmethod
    def _one_of(allowed: frozenset[int]) -> Callable[[int], int]:
        def check(value: int) -> int:
            if value not in allowed:
                raise SdoAbort(SdoAbort.BAD_VALUE)
            return value

        return check

    def _check_max_current(self, value: int) -> int:
        if not self._current_factor_written:
            raise SdoAbort(SdoAbort.WRONG_STATE)
        return value

    def _on_rated_current(self) -> None:
        self._current_factor_written = True
        self._loops.reload_limit()
