"""A CiA 402 servo drive at the other end of an RS-232 line: parameters, states and strokes; no exchange in step with anything."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Final

from beltcomm.configfiles import config_names
from beltcomm.drive import Clock, ExchangeReport, Guarding, Limits, Motion, Sink
from beltcomm.errors import BeltcommError, BusError, DriveError, Refused, UsageError
from beltcomm_adapters.cia402 import DISABLE_VOLTAGE
from beltcomm_adapters.identification import read_capabilities, read_identity, supported_modes
from beltcomm_adapters.interrupts import deferred_interrupt
from beltcomm_adapters.object_drive import ObjectDrive
from beltcomm_adapters.profiles import Profile, load_profile
from beltcomm_adapters.serial_line import BITRATES, BITS_PER_CHARACTER, Port, SerialLine
from beltcomm_adapters.serial_objects import SerialObjects
from beltcomm_adapters.serial_run import PROFILE_POSITION, PolledRun, measure_pace, prepare
from beltcomm_adapters.serial_strokes import check_limits, strokes_of
from beltcomm_adapters.watch import STOP_TIME_S

#: Characters of a cycle of torque control: write of 6071h with its echo, reads of 6064h and 6077h.
_CYCLE_CHARACTERS: Final = 2 * 13 + 8 + 17 + 8 + 13
_UNTOLD: Final = ("device_name", "hardware", "firmware")
_POSITION_GAIN: Final = "kpp_1_s"
_NUMBERS: Final = ("vendor_id", "product_code")


class SerialDrive(ObjectDrive):
    """A drive on a serial port; see :class:`beltcomm.drive.Drive`.

    Parameters
    ----------
    port, clock
        Open port and its time.
    bitrate : int
        Wanted, for the time of the session.
    profile : str or None
        Name, None to choose by identity.
    release : callable
        Called once by :meth:`close`, last.

    Raises
    ------
    BusError
        When nobody answers.
    DriveError
    DriveFault
    UsageError
        For a drive whose profile must be named.
    """

    def __init__(self, port: Port, clock: Clock, bitrate: int, profile: str | None, release: Callable[[], None]) -> None:
        self._line = SerialLine(port, clock)
        self._serial = SerialObjects(self._line)
        super().__init__(clock, self._serial, release)
        self._serial.find()
        self._serial.change_bitrate(bitrate)
        try:
            identity = read_identity(self._serial, port.name)
            self._take_over(self._line, _choose_serial_profile(identity, profile))
            self._pace = measure_pace(self._serial, clock)
            known = read_capabilities(
                self._serial,
                self._profile,
                self._scaling,
                {**identity, **self._units()},
                None,
                self._referenced(),
                self._parameters.table,
                self._parameters.uncalibrated,
            )
            modes = supported_modes(self._serial, self._profile)
            self.capabilities = dataclasses.replace(
                known,
                name=f"{self._profile.title} on {port.name}",
                kinds=frozenset({"profile"} if PROFILE_POSITION in modes else ()),
                sample_period_s=self._pace.period_s,
                torque_along=frozenset(),
                can_home=False,
                identity={**known.identity, **dict.fromkeys(_UNTOLD, "")},
                refused=_refused(),
                shortest_guard_s=None,
            )
        except BaseException:
            self._session.give_back()
            self._leave()
            raise

    @property
    def version(self) -> str:
        """Name that the firmware gives itself."""
        return self._serial.version()

    def backup(self) -> dict[str, float]:
        """Read all parameters that can be written back; read twice, because nothing on the line shows a digit that was spoilt."""
        first, second = super().backup(), super().backup()
        if first != second:
            differ = ", ".join(name for name in first if first[name] != second[name])
            raise BusError(
                f"two readings of {differ} differ: the line is disturbed, and no backup is certain; check the cable and its shield"
            )
        return first

    def prove_guarding(self, limits: Limits, rest_nm: float = 0.0) -> Guarding:
        """Refuse the proof of guarding; always a DriveError, for nothing on this line watches the computer."""
        raise DriveError(
            "nothing on RS-232 watches the computer: an axis under torque would outlive it, so it gets none; connect the drive's CAN port"
        )

    def record(self, motion: Motion, limits: Limits, sink: Sink) -> ExchangeReport:
        """Carry out strokes and record them; kind "profile" only."""
        here = self._serial.read_int(0x6064, 0, "int32")
        check_limits(motion, limits, self.capabilities, here * self._scaling.position_rad)
        strokes, rest_s = strokes_of(motion, here, self._scaling)
        self._machine.reset_fault()
        self._machine.disable()
        run = PolledRun(self._serial, self._machine, self._scaling, limits, self.clock, self._pace, sink, self._lag_1_s())
        try:
            with self._serial.lend() as lending:
                prepare(self._serial, lending, self._machine, self._profile, self._scaling, limits, self._pace.period_s)
                try:
                    self._machine.enable()
                    self.clock.sleep_until(self.clock.now() + limits.brake_s)
                    with self._serial.impatient(self._pace.patience_s):
                        report = run.follow(strokes, rest_s)
                except BaseException as error:
                    self._halt(limits, run, error)
                    raise
                self._halt(limits, run, None)
                return report
        finally:
            self.clock.sleep_until(self.clock.now() + limits.brake_s)  # it is over when a brake has had its time to close

    def _lag_1_s(self) -> float:
        """Gain of a position loop without velocity feedforward; infinite where there is one, or no such gain."""
        known = not self.capabilities.structure.velocity_feedforward and _POSITION_GAIN in self._parameters.names
        return self._parameters.read([_POSITION_GAIN])[_POSITION_GAIN] if known else math.inf

    def _halt(self, limits: Limits, run: PolledRun, error: BaseException | None) -> None:
        """Quick stop and disable; a failure to do so is raised, or noted on the ``error`` that is already under way."""
        ramp_s = limits.speed_rad_s / limits.deceleration_rad_s2
        try:
            with deferred_interrupt():
                if limits.release:
                    self._serial.write(0x6040, 0, "uint16", DISABLE_VOLTAGE)
                self._machine.disable(STOP_TIME_S + ramp_s)
        except BusError as failure:
            words = f"{failure}; {_left_alone(limits, run.end_rad)}"
            if error is None:
                raise BusError(words) from failure
            error.add_note(words)
        except DriveError as failure:
            if error is None:
                raise
            error.add_note(str(failure))

    def home(self, limits: Limits) -> None:
        """Refused: a search of the zero has no end that is known beforehand."""
        raise Refused(
            "no homing is started over RS-232, because nothing stops it at the end of the window when the cable is pulled; home with the "
            "maker's tool or over CAN, or state where the carriage is with --position"
        )

    def _leave(self) -> None:
        """The line as a drive has it after a reset."""
        with contextlib.suppress(BeltcommError):
            self._serial.change_bitrate(BITRATES[0])

    def close(self) -> None:
        """Stop the axis and let go of the port; the drive's bit rate goes back to 9600."""
        if self._open:
            release = self._release
            self._release = lambda: None
            try:
                super().close()
                with deferred_interrupt():
                    self._leave()
            finally:
                release()


def _left_alone(limits: Limits, end_rad: float) -> str:
    """Reaction of an axis that nobody can tell anything any more, in words."""
    where = "" if math.isnan(end_rad) else f" at {limits.where(end_rad)}"
    return (
        f"nothing guards a drive over RS-232: if it runs on, it ends the stroke it has by itself{where}, and holds the axis there with its "
        "stage on and the limits of this session; if it has restarted, the axis rolls out; switch its power off before going near"
    )


def _refused() -> Mapping[str, str]:
    """Why motions in step with the host are not made over this line."""
    slow, fast = (rate / BITS_PER_CHARACTER / _CYCLE_CHARACTERS for rate in (BITRATES[0], BITRATES[-1]))
    remedy = "connect the drive's CAN port (can0, slcan:/dev/ttyACM0)"
    limit = (
        f"RS-232 carries at most {slow:.0f} setpoints a second at {BITRATES[0]} bit/s and {fast:.0f} at {BITRATES[-1]}, unevenly, and the "
        "maker allows the port for tests only"
    )
    return {
        "torque": f"{limit}; an axis under torque would also outlive its host, for nothing guards it there. To identify, {remedy}",
        "position": f"{limit}. To follow a path, {remedy}",
        "velocity": f"{limit}; an axis that is told to turn would also outlive its host. For speeds that change, {remedy}",
    }


def _choose_serial_profile(identity: Mapping[str, str], wanted: str | None) -> Profile:
    """The profile of a drive that tells its numbers, but not its name.   Raises UsageError when that does not decide."""
    if wanted is not None:
        return load_profile(wanted)
    known = [(profile, profile.match) for profile in map(load_profile, config_names("drives")) if profile.match is not None]
    profiles = [profile for profile, match in known if set(_NUMBERS) & set(match)]
    fitting = [p for p, match in known if p in profiles and all(identity.get(key) == str(match[key]) for key in _NUMBERS if key in match)]
    if len(fitting) == 1:
        return fitting[0]
    which = ", ".join(profile.name for profile in fitting or profiles)
    told = ", ".join(f"{key} {identity[key]}" for key in _NUMBERS if key in identity) or "nothing of itself"
    raise UsageError(f"this port does not tell which drive it is ({told}); say so with --profile: {which}")
