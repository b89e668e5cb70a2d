"""Values into a drive without moving it: differences first, then a question, a backup, the writing with read-back."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from beltcomm.drive import Drive
from beltcomm.drive.objects import ObjectValue, object_values
from beltcomm.drive.parameters import PREFILTER_KINDS
from beltcomm.errors import Declined, Refused
from beltcomm.machine.writable import Writable
from beltcomm.result import table
from beltcomm.rundata import backups
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Talk

#: Units of named parameters, as shown.
UNITS = {
    "kp_nm_s_rad": "N m s/rad",
    "ki_nm_rad": "N m/rad",
    "kpp_1_s": "1/s",
    "velocity_filter_s": "s",
    "prefilter_omega_rad_s": "rad/s",
    "ff_inertia_kg_m2": "kg m²",
    "ff_viscous_nm_s_rad": "N m s/rad",
    "ff_coulomb_nm": "N m",
    "ff_offset_nm": "N m",
    "ff_advance_s": "s",
    "prefilter_roll_off_rad_s": "rad/s",
    "torque_limit_nm": "N m",
    "speed_limit_rad_s": "rad/s",
}


#: Those that people read in another unit than programs do, and the factor.
READ_AS = {
    "prefilter_omega_rad_s": ("Hz", 0.5 / math.pi),
    "prefilter_roll_off_rad_s": ("Hz", 0.5 / math.pi),
    "speed_limit_rad_s": ("r/min", 30.0 / math.pi),
    "ff_inertia_kg_m2": ("kg cm²", 1e4),
}


@dataclass(frozen=True)
class ParameterChange:
    """One object that is to hold another value.

    Attributes
    ----------
    before : float
        Its raw value now.
    before_si : float or None
        Its parameter's value now, None for none.
    """

    wanted: ObjectValue
    before: float
    before_si: float | None

    def to_dict(self) -> dict[str, Any]:
        """For ``--json``."""
        wanted = self.wanted
        return {
            "object": wanted.title,
            "type": wanted.kind,
            "name": wanted.name,
            "raw_before": self.before,
            "raw": wanted.raw,
            "before": self.before_si,
            "value": wanted.value,
            "unit": UNITS.get(wanted.name, ""),
        }


@dataclass(frozen=True)
class Differences:
    """Differences between the wanted and the present values, and in words what is wanted but not in this drive, or left alone."""

    changes: tuple[ParameterChange, ...]
    left_out: tuple[str, ...] = ()

    def table(self) -> list[str]:
        """Differences as plain text: object, raw values, and SI values where the object holds a parameter."""
        rows = []
        for one in self.changes:
            name = one.wanted.name
            unit = unit_of(name)
            meant = f"{_shown(name, one.before_si)} -> {_shown(name, one.wanted.value)} {unit}".rstrip() if name else ""
            rows.append([one.wanted.title, _raw(one.before), "->", _raw(one.wanted.raw), name, meant])
        shown = table(["object", ">raw, now", "->", "then", "parameter", "now -> then"], rows, "  ") if rows else ["  nothing differs"]
        return [*shown, *(f"  {line}" for line in self.left_out)]


def _raw(value: float) -> str:
    return f"{value:.6g}" if value != int(value) or abs(value) >= 1e10 else f"{int(value)}"


def unit_of(name: str) -> str:
    """The unit in which people read a parameter.

    Parameters
    ----------
    name : str
        Of a drive's parameter.

    Returns
    -------
    str
        "" for none.
    """
    return READ_AS[name][0] if name in READ_AS else UNITS.get(name, "")


def read_as(name: str, value: float) -> str:
    """A parameter in the unit in which people read it, in words where its number is a code.

    Parameters
    ----------
    name : str
        Of a drive's parameter.
    value : float, SI
        Of the parameter.

    Returns
    -------
    str
        Without its unit.
    """
    if name == "prefilter_kind" and value in range(len(PREFILTER_KINDS)):
        return PREFILTER_KINDS[int(value)]
    return f"{READ_AS[name][1] * value if name in READ_AS else value:.6g}"


def _shown(name: str, value: float | None) -> str:
    return "?" if value is None else read_as(name, value)


def named_differences(drive: Drive, folder: RunFolder, wanted: Mapping[str, float]) -> Differences:
    """Differences of a drive's parameters to wanted values.

    Parameters
    ----------
    drive : Drive
    folder : RunFolder
    wanted : mapping of str to float, SI
        By name of the parameter.

    Returns
    -------
    Differences
        With the parameters that the drive does not have, in words.

    Raises
    ------
    Refused
        Where the meaning of a gain is not known yet.
    UsageError
        For a value out of range.
    """
    offered = drive.capabilities.parameters
    values = object_values(offered, {name: value for name, value in wanted.items() if name in offered})
    found = differences(drive, folder, values)
    if unknown := sorted(drive.capabilities.uncalibrated & {one.wanted.name for one in found.changes}):
        raise Refused(
            f"nothing was written: what one unit of {', '.join(unknown)} means in this kind of drive is not known; measure it with "
            "`beltcomm calibrate --drive DRIVE --run RUN`, a few small steps of its setpoints"
        )
    missing = [name for name in wanted if name not in offered and wanted[name]]
    return replace(found, left_out=(f"the drive has no {', '.join(missing)}",)) if missing else found


def differences(drive: Drive, folder: RunFolder | None, wanted: Sequence[ObjectValue], left_out: Sequence[str] = ()) -> Differences:
    """Differences to these raw values.

    Parameters
    ----------
    drive : Drive
    folder : RunFolder or None
        Of the run, None for what this computer itself noted of the drive.
    wanted : sequence of ObjectValue
        Objects with their raw values.
    left_out : sequence of str
        Sentences on what is wanted and not in this drive.

    Raises
    ------
    Refused
        For what is never written, see :mod:`beltcomm.machine.writable`; what the drive has not, or holds already, is not.
    """
    known = {(one.index, one.subindex): name for name, one in drive.capabilities.parameters.items()}
    meant = drive.backup() if any(item.place in known for item in wanted) else {}
    changes, absent = [], []
    for item, before in zip(wanted, drive.read_objects([(o.index, o.subindex, o.kind) for o in wanted]), strict=True):
        if before is None:
            absent.append(item.title)
        elif not _same(item, before):
            name = known.get(item.place, item.name)
            changes.append(ParameterChange(replace(item, name=name, value=_si(drive, item, wanted, name)), before, meant.get(name)))
    # This computer's own note is believed: a mode or a profile of today may not know all that the session before had lent.
    Writable.of(drive, folder, found=wanted if folder is None else ()).check([one.wanted for one in changes], mode=folder is None)
    words = [f"the drive has no {', '.join(absent)}"] if absent else []
    return Differences(tuple(changes), (*words, *left_out))


def _same(item: ObjectValue, before: float) -> bool:
    return math.isclose(item.raw, before, rel_tol=1e-6, abs_tol=1e-12) if item.kind == "real32" else item.raw == before


def _si(drive: Drive, item: ObjectValue, wanted: Sequence[ObjectValue], name: str) -> float | None:
    """SI value of a raw one beside the others that are wanted."""
    offered = drive.capabilities.parameters
    entry = offered.get(name)
    if entry is None:
        return item.value

    def gain() -> float:
        held = offered["kp_nm_s_rad"]
        place = held.index, held.subindex
        asked = [other.raw for other in wanted if other.place == place]
        stored = asked or drive.read_objects([(*place, held.type)])
        return float(stored[0] or 0.0) * held.scale

    return entry.value(item.raw, gain)


def write(
    drive: Drive, folder: RunFolder, found: Differences, talk: Talk, *, yes: bool, verb: str, question: str = "Nothing moves."
) -> None:
    """Show, ask, back up, write, read back.

    Parameters
    ----------
    drive : Drive
    folder : RunFolder
    found : Differences
        As :func:`named_differences` returned them.
    talk : Talk
    yes : bool
        True for a consent given before.
    verb : str
        Of the command, for journal and backup.
    question : str
        Words behind the question.

    Raises
    ------
    Refused
        For a no.
    ObjectLocked, ObjectRefused, DriveError
        As the drive raises them.
    """
    talk.say("The drive's objects, now -> then:", *found.table())
    if found.changes and not yes and not talk.confirm(f"Write these to the drive? {question}"):
        raise Declined("nothing was written, as you said")
    taken = backups.take(folder, drive, verb) if found.changes or folder.load_result(backups.FIRST) is None else None
    # a folder that cannot be written stops it here, before the drive
    folder.journal(f"{verb}: writing {len(found.changes)} objects" + (f"; what stands there now is kept in {taken.name}" if taken else ""))
    drive.write_objects([one.wanted for one in found.changes])
    done = ", ".join(f"{one.wanted.title} {_raw(one.before)} -> {_raw(one.wanted.raw)}" for one in found.changes)
    folder.journal(f"{verb}: {done or 'nothing differed'}")


def put_back(drive: Drive, found: Differences) -> None:
    """Restore the values from before :func:`write`.

    Parameters
    ----------
    drive : Drive
    found : Differences
        That were written.

    Raises
    ------
    DriveError
        When they cannot be written.
    """
    drive.write_objects([replace(one.wanted, raw=one.before) for one in found.changes])
