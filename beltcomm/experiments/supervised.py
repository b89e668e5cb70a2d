"""A connected drive as a command may use it: nothing moves before it was agreed to, a key must stay held, the motor stays cool enough.

Wraps any :class:`beltcomm.drive.Drive`; every command opens its drive through :func:`supervise`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import scipy.signal  # noqa: F401  what is loaded when it is first needed must not be loaded while an axis waits for it

from beltcomm.drive import Capabilities, Clock, Drive, ExchangeReport, Guarding, Limits, Motion, Row, Sink
from beltcomm.drive.objects import ObjectValue
from beltcomm.errors import BeltcommError, Refused, SafetyStop
from beltcomm.experiments.options import Options
from beltcomm.machine import unrestored
from beltcomm.machine.hardware import Hardware
from beltcomm.machine.heat import HeatStore
from beltcomm.machine.writable import Writable
from beltcomm.talk import Talk

#: Rows between two looks at a held key.
HOLD_ROWS = 8
#: s of excess heat that a motion may begin with; share of the overload store at which the host stops, before the drive clips.
WARM_S, FULL = 0.05, 0.9


class Supervised:
    """The drive behind a command.   Use as a context manager, inside that of the drive.

    Parameters
    ----------
    hardware : Hardware
        Which drive it is.
    run : Path or None
        Folder of the command, for the note on what is not restored.
    settles : bool
        An earlier session's debt is offered first.
    moved
        Whether anything moved.
    """

    def __init__(self, drive: Drive, hardware: Hardware, run: Path | None, options: Options, talk: Talk, *, settles: bool = True) -> None:
        self.hardware, self.moved = hardware, False
        self._drive, self._run, self._talk, self._settles = drive, run, talk, settles
        self.clock: Clock = drive.clock
        self._yes, self._dry_run, self._hold = options.yes, options.dry_run, options.hold
        self._allowed = self._failed = self._noted = False
        self._initial: tuple[ObjectValue, ...] = ()
        self._note = None if hardware.forgetful else unrestored.Note(hardware)
        self._heat = HeatStore(drive.capabilities.rated_torque_nm, drive.clock.now())

    def __enter__(self) -> Supervised:
        if self._note is not None:
            if self._settles:
                unrestored.settle(self._drive, self._note, self._talk, yes=self._yes, dry_run=self._dry_run)
            self._initial = self._drive.objects()
        return self

    def __exit__(self, *exc: object) -> None:
        well = exc[0] is None
        if well and self.moved:
            self._drive_is_known()
        if self._note is None:
            return
        paid = well and not self._failed and not self._dry_run
        # What a rollback finds is what the session before has left: unchanged is then not as it should be.
        if (self._noted or not self._settles) and (paid or (self._settles and self._as_found())):
            self._note.remove()
        self._note.release()

    # -- as the drive itself ----------------------------------------------------------------------------------------------

    @property
    def capabilities(self) -> Capabilities:
        """Capabilities of the supervised drive."""
        return self._drive.capabilities

    @capabilities.setter
    def capabilities(self, found: Capabilities) -> None:
        self._drive.capabilities = found

    def read(self, names: Sequence[str]) -> dict[str, float]:
        """Read parameters."""
        return self._drive.read(names)

    def backup(self) -> dict[str, float]:
        """Read all parameters that can be written back."""
        return self._drive.backup()

    def write(self, values: Mapping[str, float]) -> dict[str, float]:
        """Write parameters; from now on a killed session leaves a note.

        Raises
        ------
        ObjectLocked
            Too.
        """
        self._writable.check_named(values, self.capabilities)
        self._put_note()
        self._failed = True
        stored = self._drive.write(values)
        self._failed = False
        return stored

    def objects(self) -> tuple[ObjectValue, ...]:
        """List the objects of the drive."""
        return self._drive.objects()

    def read_objects(self, places: Sequence[tuple[int, int, str]]) -> list[float | None]:
        """Read raw objects."""
        return self._drive.read_objects(places)

    def write_objects(self, values: Sequence[ObjectValue]) -> None:
        """Write raw objects; as :meth:`write`, and Refused for what is not on the closed list."""
        self._writable.check(values)
        self._put_note()
        self._failed = True
        self._drive.write_objects(values)
        self._failed = False

    def calibrate(self, units: Mapping[str, float]) -> None:
        """Tell the drive what its gains mean in SI."""
        self._drive.calibrate(units)

    def save(self) -> None:
        """Save the parameters in the drive for good."""
        self._drive.save()

    def stop(self) -> None:
        """Stop the axis."""
        self._drive.stop()

    def close(self) -> None:
        """Stop the axis and let go of the drive."""
        self._drive.close()

    def __getattr__(self, name: str) -> Any:
        """Attributes that only this adapter has."""
        return getattr(self._drive, name)

    # -- motion -----------------------------------------------------------------------------------------------------------

    def allow_motion(self) -> None:
        """The plan was agreed to, and the first motion of this drive confirmed."""
        self._allowed = True

    def home(self, limits: Limits) -> None:
        """Let the drive find its reference by itself; raises Refused while a key is to be held, which cannot stop that."""
        self._check_allowed()
        if self._hold is not None:
            raise Refused("the drive homes by itself and asks nobody whether a key is held; leave --hold-to-run or --home out")
        self._put_note()
        self.moved = True
        self._drive.home(limits)

    def prove_guarding(self, limits: Limits, rest_nm: float = 0.0) -> Guarding:
        """Prove that the drive notices a dead host: its stage is on for it."""
        self._check_allowed()
        self._put_note()
        return self._drive.prove_guarding(limits, rest_nm)

    def record(self, motion: Motion, limits: Limits, sink: Sink) -> ExchangeReport:
        """Carry out a motion and record it.   Waits until the motor has given off what it was overloaded with.

        Raises
        ------
        SafetyStop
            With the reason "released" when the key is let go, "heat" when the motor's overload store is full.
        """
        self._check_allowed()
        self._cool()
        self._put_note()
        self.moved = True
        hold, heat, own = self._hold, self._heat, self.capabilities
        store = ((own.peak_torque_nm / own.rated_torque_nm) ** 2 - 1.0) * own.overload_time_s if own.overload_time_s else None
        rows = 0

        def watched(row: Row) -> None:
            nonlocal rows
            sink(row)
            heat.add(row[0], row[1])
            if store is not None and heat.excess_s > FULL * store:
                raise SafetyStop(
                    f"the motor's overload store of {store:.3g} s is used by {100 * FULL:.0f} % (I²t over {own.rated_torque_nm:.3g} N m); "
                    "the axis was stopped; let it cool, then move it slower or with less load",
                    "heat",
                )
            rows += 1
            if hold is not None and rows % HOLD_ROWS == 0 and not hold.pressed():
                raise _released_stop()

        if hold is None:
            return self._recorded(motion, limits, watched)
        if not hold.begin():
            raise _released_stop()
        try:
            return self._recorded(motion, limits, watched)
        finally:
            hold.end()

    def _recorded(self, motion: Motion, limits: Limits, sink: Sink) -> ExchangeReport:
        try:
            return self._drive.record(motion, limits, sink)
        finally:
            self._heat.moved_until(self.clock.now())

    # -- inside -----------------------------------------------------------------------------------------------------------

    @cached_property
    def _writable(self) -> Writable:
        return Writable.of(self._drive, found=self._initial)

    def _check_allowed(self) -> None:
        if not self._allowed:
            raise Refused("nothing moves before its plan was agreed to")

    def _cool(self) -> None:
        excess = self._heat.rest_until(self.clock.now())
        if excess > WARM_S:
            self._talk.say(f"The motor rests for {excess:.1f} s: it was loaded beyond its rated torque.")
            self.clock.sleep_until(self.clock.now() + excess)
            self._heat.rest_until(self.clock.now())

    def _put_note(self) -> None:
        if self._note is not None and not self._noted:
            self._note.write_locked(self._run, self._initial)
            self._noted = True

    def _as_found(self) -> bool:
        """True if the drive has the settings that it had at the beginning.

        What is told since then only, as the mode of a drive that began in none, had no value that a rollback could write back.
        """
        try:
            now = {item.place: item.raw for item in self._drive.objects()}
        except BeltcommError:
            return False
        return all(now.get(item.place) == item.raw for item in self._initial)

    def _drive_is_known(self) -> None:
        """A command that moved the axis has ended well."""
        if self.hardware.unique and not self.hardware.remember(moved=True, run=str(self._run or "")):
            self._talk.say("This drive could not be remembered: its first motion will be asked for again.")


def _released_stop() -> SafetyStop:
    return SafetyStop("the key was let go; the axis was stopped; hold it as long as the axis may move, --resume goes on", "released")


def supervise(drive: Drive, name: str, run: Path | None, options: Options, talk: Talk, *, settles: bool = True) -> Supervised:
    """The drive called ``name`` as a command on ``run`` may use it.

    Parameters
    ----------
    drive : Drive
    name : str
        As for ``--drive``.
    run : Path or None
        Of the run folder; None without one.
    options : Options
    talk : Talk
    settles : bool
        As in :class:`Supervised`.
    """
    return Supervised(drive, Hardware.of(name, drive.capabilities), run, options, talk, settles=settles)
