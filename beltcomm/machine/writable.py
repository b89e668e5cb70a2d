"""Closed list of what may be written to a drive, whoever asks: a backup, a design, a file, a calibration, an unfinished session.

A closed list: the objects that this drive's adapter keeps in a backup, each once; no command, no setpoint, no mode; limits no higher than
motor and drive are rated.  All of it is asked where files are compared with the drive, so that a dry run says what is refused; the list
without the limits once more in :class:`beltcomm.experiments.supervised.Supervised`, behind which nothing else writes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from beltcomm.axis import Motor
from beltcomm.drive import Capabilities, Drive
from beltcomm.drive.objects import MODE, ObjectValue, bounds_of, is_command, name_of, packed
from beltcomm.drive.parameters import GAIN_NAMES, LIMIT_NAMES
from beltcomm.errors import DataError, ObjectLocked, Refused
from beltcomm.machine.ratings import RATED_TOLERANCE
from beltcomm.rundata.store import MOST
from beltcomm.runfolder import RunFolder

#: A servo motor's peak torque over its rated one: 2 to 5, hollow-shaft and linear motors up to 8.
MOST_OVERLOAD = 10.0
#: rad/s at a motor's shaft: 95 000 r/min, a spindle; no belt axis comes near it.
MOST_SPEED_RAD_S = 1e4
#: Objects that are listed one by one.
LISTED = 5


@dataclass(frozen=True)
class Writable:
    """The closed list of one drive.

    Attributes
    ----------
    kinds : Mapping[tuple[int, int], str]
        Data types of what its adapter backs up, by index and subindex.
    limits : Mapping[tuple[int, int], tuple[str, float, float, str]]
        Those that hold a limit or a gain, by place: name, SI value of one raw unit, the most that it may be, and by whose word.
    """

    kinds: Mapping[tuple[int, int], str]
    limits: Mapping[tuple[int, int], tuple[str, float, float, str]]

    @classmethod
    def of(cls, drive: Drive, folder: RunFolder | None = None, found: Sequence[ObjectValue] = ()) -> Writable:
        """Of a connected drive.

        Parameters
        ----------
        drive : Drive
        folder : RunFolder or None
            Of the run whose ratings count, None for none.
        found : sequence of ObjectValue
            :meth:`Drive.objects`, if read.
        """
        own = drive.capabilities
        kinds = {item.place: item.kind for item in found or drive.objects()}
        kinds |= {(entry.index, entry.subindex): entry.type for entry in own.parameters.values()}
        rated = {} if folder is None else _most_of(own, folder) | {name: (MOST[name], "what drives have") for name in GAIN_NAMES[:4]}
        held = {n: own.parameters[n] for n in rated if n in own.parameters and own.parameters[n].law == "linear"}
        limits = {(entry.index, entry.subindex): (name, entry.scale, *rated[name]) for name, entry in held.items()}
        return cls({place: kind for place, kind in kinds.items() if place == MODE or not is_command(*place)}, limits)

    def check(self, values: Sequence[ObjectValue], *, mode: bool = False) -> None:
        """Check that objects may be written, before anything is.

        Parameters
        ----------
        values : sequence of ObjectValue
        mode : bool
            The mode of operation may go back, too.

        Raises
        ------
        ObjectLocked
            For what is none of the settings of a backup.
        Refused
            For an object twice, another type, or a value beyond its rating.
        """
        wrong = [item for item in values if item.place not in self.kinds or (item.place == MODE and not mode)]
        if wrong:
            first = wrong[0]
            what = "a command or a setpoint" if is_command(*first.place) else "none of the settings that beltcomm backs up in this drive"
            raise ObjectLocked(
                f"nothing was written: {titles(item.title for item in wrong)} {'are' if len(wrong) > 1 else 'is'} never written, for "
                f"{first.title} is {what}; look at who made this file, and take another",
                *first.place,
            )
        places = [item.place for item in values]
        if twice := sorted({place for place in places if places.count(place) > 1}):
            raise Refused(
                f"nothing was written: {titles(name_of(*place) for place in twice)} stands more than once, and a backup holds each object "
                "once; look at who made this file, and take another"
            )
        for item in values:
            self._check_value(item)

    def _check_value(self, item: ObjectValue) -> None:
        kind = self.kinds[item.place]
        least, most = bounds_of(kind)
        if not least <= item.raw <= most or len(packed(item.kind, item.raw)) != len(packed(kind, item.raw)):
            raise Refused(
                f"nothing was written: {item.title} holds one {kind} in this drive, not {item.raw:g} as {item.kind}; take another file"
            )
        if item.place not in self.limits:
            return
        name, unit, highest, by = self.limits[item.place]
        if not 0.0 <= unit * item.raw <= highest or (name in LIMIT_NAMES and not item.raw):
            raise Refused(
                f"nothing was written: {name} ({item.title}) would be {unit * item.raw:.4g}, and is possible above 0 and up to "
                f"{highest:.4g}, by {by}; look at who made this file, and at axis.yaml"
            )

    def check_named(self, names: Iterable[str], capabilities: Capabilities) -> None:
        """Check the objects behind named parameters, whatever a profile calls so.

        Raises
        ------
        ObjectLocked
            For a command or a setpoint.
        """
        for name in names:
            entry = capabilities.parameters.get(name)
            if entry is not None and is_command(entry.index, entry.subindex):
                raise ObjectLocked(
                    f"nothing was written: the drive's profile puts {name} into {name_of(entry.index, entry.subindex)}, which is a "
                    "command or a setpoint; correct the profile",
                    entry.index,
                    entry.subindex,
                )


def _most_of(capabilities: Capabilities, folder: RunFolder) -> dict[str, tuple[float, str]]:
    """The most that each limit may be, SI, and by whose word: axis.yaml's, else what the drive has, or had when the run began: a session
    that was cut off leaves it lower.  Never more than motors do."""
    motor = folder.axis.motor if folder.has_axis else Motor()
    begun, unread = begun_with(folder)
    rated = capabilities.rated_torque_nm
    found: dict[str, tuple[float, str]] = {}
    for name, key, most, bounded in (
        (LIMIT_NAMES[0], "peak_torque_nm", MOST_OVERLOAD * rated, f"{MOST_OVERLOAD:g} times the drive's rated torque of {rated:.4g} N m"),
        (LIMIT_NAMES[1], "max_speed_rad_s", MOST_SPEED_RAD_S, "what motors do"),
    ):
        file, before = getattr(motor, key), begun.get(key)
        told = max(getattr(capabilities, key), before if isinstance(before, float) and math.isfinite(before) else 0.0)
        by = (
            f"what the drive has, or had when the run began (axis.yaml does not state motor.{key}){unread and f'; {unread}'}"
            if file is None
            else f"motor.{key}"
        )
        found[name] = min(((1.0 + RATED_TOLERANCE) * (told if file is None else file), by), (most, bounded))
    return found


def begun_with(folder: RunFolder) -> tuple[Mapping[str, Any], str]:
    """Ratings that the drive had when the run began, by name, and in words why nothing is known of it.

    Parameters
    ----------
    folder : RunFolder

    Returns
    -------
    tuple of mapping of str to Any and str
        Empty where nothing is known: values must come back from a run whose ``results/drive.yaml`` is damaged, too.
    """
    try:
        noted = folder.load_result("drive") or {}
    except DataError as error:
        return {}, f"what the drive had when the run began is not known ({error})"
    return noted.get("begun_with") or noted, ""


def titles(found: Iterable[str]) -> str:
    """Objects in words, the first few by name.

    Parameters
    ----------
    found : iterable of str
        Titles of objects, any of them more than once.
    """
    named = list(dict.fromkeys(found))
    return ", ".join(named[:LISTED]) + (f" and {len(named) - LISTED} more" if len(named) > LISTED else "")
