"""A drive through its objects, whatever carries them: named values, parameters, saving, and giving back."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Self

from beltcomm.drive import Capabilities, Clock, KnownMotor
from beltcomm.drive.objects import ObjectValue
from beltcomm.drive.parameters import gain_access
from beltcomm.errors import BeltcommError, BusError, DriveError, UsageError
from beltcomm_adapters.cia402 import StateMachine, Wire
from beltcomm_adapters.gains import Parameters, structure_of
from beltcomm_adapters.interrupts import deferred_interrupt
from beltcomm_adapters.profiles import Profile
from beltcomm_adapters.scaling import read_scaling
from beltcomm_adapters.sdo import RECOVERY_S, RETRY_S, Objects


class ObjectDrive:
    """The part of :class:`beltcomm.drive.Drive` that needs no motion.

    Attributes
    ----------
    clock
        Its time. objects : its dictionary. release : called once by :meth:`close`, last.
    """

    capabilities: Capabilities

    def __init__(self, clock: Clock, objects: Objects, release: Callable[[], None]) -> None:
        self.clock = clock
        self._objects = objects
        self._session = objects.lend()
        self._release = release
        self._open = True
        self._homed = False

    def _take_over(self, wire: Wire, profile: Profile, nameplate: KnownMotor | None = None) -> None:
        """Axis disabled, units and parameters known.  On failure nothing stays lent.   nameplate : see :func:`read_scaling`."""
        self._profile, self._nameplate = profile, nameplate
        self._objects.locks.add(profile.never_write)
        self._machine = StateMachine(wire, self._objects, profile.emergency)
        self._machine.disable()
        try:
            self._borrow()
            self._parameters = Parameters(self._objects, profile, self._scaling, self._session)
        except BaseException:
            self._session.give_back()
            raise

    def _units(self) -> dict[str, str]:
        """For the identity: a run is not gone on with when these have changed."""
        return {
            "units_per_turn": f"{math.tau / abs(self._scaling.position_rad):g}",
            "rated_torque_nm": f"{self._scaling.rated_torque_nm:g}",
        }

    def read(self, names: Sequence[str]) -> dict[str, float]:
        """Read parameters by name; ``state`` is a :class:`beltcomm_adapters.cia402.State`.

        Returns
        -------
        dict of str to float
            SI, motor shaft.

        Raises
        ------
        UsageError
            For an unknown name.
        """
        objects, scaling, actual = self._objects, self._scaling, self._profile.actual_torque
        measured: dict[str, Callable[[], float]] = {
            "position_rad": self._here_rad,
            "velocity_rad_s": lambda: objects.read(0x606C, 0, "int32") * scaling.speed_rad_s,
            "torque_nm": lambda: objects.read(actual.index, actual.subindex, actual.type) * scaling.reading_nm,
            "state": lambda: float(self._machine.state()),
            "referenced": lambda: float(self._referenced()),
        }
        if unknown := [name for name in names if name not in measured and name not in self._parameters.names]:
            known = ", ".join((*measured, *self._parameters.names))
            raise UsageError(f"this drive has no quantity {', '.join(unknown)}; it has {known}")
        return {name: measured[name]() if name in measured else self._parameters.read([name])[name] for name in names}

    def write(self, values: Mapping[str, float]) -> dict[str, float]:
        """Write parameters by name; the stage is taken off first."""
        self._machine.disable()
        return self._parameters.write(values)

    def backup(self) -> dict[str, float]:
        """Read all parameters that can be written back."""
        return self._parameters.read(self._parameters.names)

    def objects(self) -> tuple[ObjectValue, ...]:
        """List the objects of the drive."""
        return self._parameters.objects()

    def read_objects(self, places: Sequence[tuple[int, int, str]]) -> list[float | None]:
        """Read raw objects."""
        return self._parameters.read_objects(places)

    def write_objects(self, values: Sequence[ObjectValue]) -> None:
        """Write raw objects; the stage is taken off first."""
        self._machine.disable()
        self._parameters.write_objects(values)

    def calibrate(self, units: Mapping[str, float]) -> None:
        """Take over what the gains of the drive mean in SI.

        Parameters
        ----------
        units : mapping of str to float
            N m s/rad of K_P, 1/s of K_PP, s of an integral time.
        """
        self._parameters.calibrate(units)
        before = self.capabilities.structure
        self.capabilities = dataclasses.replace(
            self.capabilities,
            structure=structure_of(
                self._profile, before.period_s, before.output_limit_rad_s, before.dead_zone_rad, parameters=self._parameters.table
            ),
            parameters=dict(self._parameters.table),
            uncalibrated=self._parameters.uncalibrated,
            gains=gain_access(self._parameters.table, self._parameters.uncalibrated),
        )

    def save(self) -> None:
        """Save the parameters in the drive for good; what is lent to this session is saved as it was found."""
        self._machine.disable()
        if failures := self._session.give_back():
            raise DriveError(f"nothing was saved: {'; '.join(failures)}")
        try:
            by = self._profile.save
            self._objects.save((by.index, by.subindex, by.type), by.value, by.seconds)
        finally:
            self._borrow()

    def stop(self) -> None:
        """Stop the axis."""
        if not self._open:
            return
        give_up_s = self.clock.now() + RECOVERY_S
        with contextlib.suppress(BeltcommError):
            while True:
                try:
                    self._machine.disable()
                    return
                except BusError:
                    if self.clock.now() >= give_up_s:
                        raise
                    self.clock.sleep_until(self.clock.now() + RETRY_S)

    def close(self) -> None:
        """Stop the axis and let go of the drive."""
        if not self._open:
            return
        with deferred_interrupt():
            self.stop()
            self._open = False
            try:
                self._session.give_back()
            finally:
                self._release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_exc: object) -> None:
        self.close()

    def _borrow(self) -> None:
        """Values lent to this session: control of the drive first, then the speed unit."""
        if self._profile.enable_logic:
            self._session.set(*self._profile.enable_logic, keep=True)
        self._scaling = read_scaling(self._objects, self._profile, self._session, self._nameplate)

    def _here_rad(self) -> float:
        return self._objects.read(0x6064, 0, "int32") * self._scaling.position_rad

    def _referenced(self) -> bool:
        """True if the drive has a zero: by its own word, or where it tells nothing because we homed it."""
        if self._profile.referenced is None:
            return self._homed
        index, subindex, bit = self._profile.referenced
        return bool(int.from_bytes(self._objects.read_bytes(index, subindex), "little") >> bit & 1)
