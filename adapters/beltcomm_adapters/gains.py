"""Named parameters of a drive and the objects that hold them: written, read back, and put back when one fails.

Objects that records borrow beside the parameters are read before the first record, so that a killed session's can go back.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

from beltcomm.control import CascadeStructure
from beltcomm.drive.objects import GAIN, ObjectValue, ParameterObject, name_of, ordered, packed
from beltcomm.drive.parameters import LIMIT_NAMES
from beltcomm.errors import BeltcommError, DriveError, ObjectRefused, Refused, UsageError
from beltcomm_adapters.profiles import Profile
from beltcomm_adapters.scaling import Scaling
from beltcomm_adapters.sdo import Lending, Objects, Place

#: Mode of operation; 0, "no mode", is where a drive starts and cannot be gone back to.
MODE: Final = (0x6060, 0, "int8")
#: Method of homing, borrowed where a profile states one.
HOMING: Final = (0x6098, 0, "int8")
#: Borrowed by a record, a stroke or their guarding: index, subindex, type, in the order in which they go back.
LENT_TO_RECORDS: Final = (
    MODE,
    (0x605A, 0, "int16"),
    (0x6081, 0, "uint32"),
    (0x6083, 0, "uint32"),
    (0x6084, 0, "uint32"),
    (0x6085, 0, "uint32"),
    (0x6086, 0, "int16"),
    (0x6087, 0, "uint32"),
    (0x6065, 0, "uint32"),
    (0x6066, 0, "uint16"),
    (0x607D, 1, "int32"),
    (0x607D, 2, "int32"),
    (0x60C0, 0, "int16"),
    (0x60C1, 2, "uint8"),
    (0x60C2, 2, "int8"),
    (0x60C2, 1, "uint8"),
    (0x6007, 0, "int16"),
    (0x1029, 1, "uint8"),
    (0x1016, 1, "uint32"),
    (0x100D, 0, "uint8"),
    (0x100C, 0, "uint16"),
    (0x1017, 0, "uint16"),
)


#: The gains whose meaning a step test finds, where the profile does not know it.
MEASURED: Final = (GAIN, "ki_nm_rad", "kpp_1_s")


def _width(objects: Objects, index: int) -> int:
    """Bytes of an object, 0 where the drive has none."""
    return len(objects.bytes_if_there(index) or b"")


class Parameters:
    """The parameters beltcomm may write, by name, SI at the motor shaft; and any other object by number.

    Parameters
    ----------
    session : Lending or None
        What is lent while the drive is open; the drive's own values of these are what it will get back. table : the objects by name.
        uncalibrated : names whose meaning nobody knows yet; they are not written.
    """

    def __init__(self, objects: Objects, profile: Profile, scaling: Scaling, session: Lending | None = None) -> None:
        self._objects = objects
        self._session = session or Lending(objects)
        self.table: dict[str, ParameterObject] = dict(profile.parameters)
        if _width(objects, 0x6072):
            self.table[LIMIT_NAMES[0]] = ParameterObject(0x6072, 0, "uint16", scaling.torque_nm, profile.torque_limit_lowest_permille)
        if width := _width(objects, 0x6080):  # UINT32 in CiA 402, UINT16 on older drives; min⁻¹
            self.table[LIMIT_NAMES[1]] = ParameterObject(0x6080, 0, "uint32" if width == 4 else "uint16", 2.0 * math.pi / 60.0)
        unknown = MEASURED if profile.gain_meaning == "unconfirmed" else ()
        self.uncalibrated = frozenset(name for name in unknown if name in profile.parameters)
        self._found: dict[str, float] = {}
        self._homes = profile.homing_method is not None

    @property
    def names(self) -> tuple[str, ...]:
        """Every name this drive has."""
        return tuple(self.table)

    def calibrate(self, units: Mapping[str, float]) -> None:
        """From here on one raw unit of these gains means so much.

        Parameters
        ----------
        units : mapping of str to float
            N m s/rad of K_P, 1/s of K_PP, s of an integral time.

        Raises
        ------
        UsageError
            For a name without an object, or a unit that is no positive number.
        """
        self._known(units)
        for name, unit in units.items():
            if not (math.isfinite(unit) and unit > 0.0):
                raise UsageError(f"the unit of {name} must be a positive number, not {unit}; calibrate again")
            self.table[name] = replace(self.table[name], scale=unit)
        self.uncalibrated -= set(units)

    def read(self, names: Iterable[str]) -> dict[str, float]:
        """Values as they stand in the drive; raises UsageError for an unknown name."""
        wanted = list(names)
        self._known(wanted)
        return {name: self.table[name].value(self._read_raw(name), self._stored_gain) for name in wanted}

    def write(self, values: Mapping[str, float]) -> dict[str, float]:
        """Write, read back, compare; on any failure put back what this call has changed.

        Parameters
        ----------
        values : mapping of str to float, SI

        Returns
        -------
        dict of str to float
            What is stored, SI.

        Raises
        ------
        UsageError
            For an unknown name, or a value out of range.
        Refused
            When a gain of unknown meaning would change.
        ObjectLocked, ObjectRefused, BusError
        DriveError
            When another value came back.
        """
        raws: dict[str, float] = {}

        def gain() -> float:
            return raws[GAIN] * self.table[GAIN].scale if GAIN in raws else self._stored_gain()

        asked = self._with_tied(values)
        for name in ordered(self.table, asked):
            raws[name] = self.table[name].raw(name, asked[name], gain)
        before = {name: self._read_raw(name) for name in raws}
        self._check_known_meaning([name for name in raws if raws[name] not in (before[name], self._found[name])])
        self._exchange([self._value_of(name, raw) for name, raw in raws.items()], [self._value_of(name, before[name]) for name in raws])
        return {name: self.table[name].value(raws[name], gain) for name in values}

    def objects(self) -> tuple[ObjectValue, ...]:
        """Values that this drive had before the session, as far as it may be written for good: the parameters, what is lent to the session,
        and what single records borrow."""
        values = self.read(self.names)
        found = [replace(self._value_of(name, self._read_raw(name)), value=values[name]) for name in self.names]
        found += [ObjectValue(*entry) for entry in self._session.lent()]
        taken = {item.place for item in found}
        borrowed: list[Place] = [*LENT_TO_RECORDS, *([HOMING] if self._homes else [])]
        places = [place for place in borrowed if place[:2] not in taken]
        for place, raw in zip(places, self.read_objects(places), strict=True):
            if raw is not None and (place != MODE or raw):
                found.append(ObjectValue(*place, raw))
        return tuple(found)

    def read_objects(self, places: Sequence[Place]) -> list[float | None]:
        """Raw values of objects, as the drive had them before the session; None where it has none or does not tell.

        Parameters
        ----------
        places : sequence of Place
            Index, subindex, type.
        """
        lent = {(index, subindex): value for index, subindex, _, value in self._session.lent()}
        found: list[float | None] = []
        for index, subindex, kind in places:
            try:
                here = lent.get((index, subindex))
                found.append(self._objects.read(index, subindex, kind) if here is None else here)
            except ObjectRefused:
                found.append(None)
        return found

    def write_objects(self, values: Sequence[ObjectValue]) -> None:
        """Write raw values, read back, compare; all or none.  What is lent will be given back so.

        Raises
        ------
        ObjectLocked
            Before anything is written.
        ObjectRefused, BusError
        DriveError
            When another value came back.
        """
        for item in values:
            self._objects.locks.check(item.index, item.subindex)
        now = [item for item in values if not self._session.promise(item.index, item.subindex, item.raw)]
        before = [replace(item, raw=self._objects.read(item.index, item.subindex, item.kind)) for item in now]
        self._exchange(now, before)

    def _exchange(self, wanted: Sequence[ObjectValue], before: Sequence[ObjectValue]) -> None:
        try:
            for item in wanted:
                self._write_raw(item)
                stored = self._objects.read(item.index, item.subindex, item.kind)
                if packed(item.kind, stored) != packed(item.kind, item.raw):  # a real number of a file has digits that the drive has not
                    raise DriveError(
                        f"the drive stored {stored:g} instead of {item.raw:g} for {item.name or 'an object'} (object "
                        f"{item.title}, raw values); its profile may not fit"
                    )
        except BaseException as error:
            for item in reversed(before):
                try:
                    self._write_raw(item)
                except BeltcommError as failure:
                    error.add_note(f"{item.name or item.title} could not be put back: {failure}")
            raise

    def _check_known_meaning(self, names: Sequence[str]) -> None:
        if unknown := [name for name in names if name in self.uncalibrated]:
            held = ", ".join(f"{name} ({name_of(self.table[name].index, self.table[name].subindex)})" for name in unknown)
            raise Refused(
                f"nothing was written: what one unit of {held} means is not known of this kind of drive; measure it with "
                "`beltcomm calibrate --drive DRIVE --run RUN`, a few small steps of its speed setpoint"
            )

    def _with_tied(self, values: Mapping[str, float]) -> dict[str, float]:
        """``values``, and K_I where K_P is written alone, for the drive holds their quotient."""
        self._known(values)
        tied = [name for name, entry in self.table.items() if entry.law == "integral_time" and GAIN in values]
        return {**self.read(name for name in tied if name not in values), **values}

    def _stored_gain(self) -> float:
        return self._read_raw(GAIN) * self.table[GAIN].scale

    def _known(self, names: Iterable[str]) -> None:
        if unknown := [name for name in names if name not in self.table]:
            raise UsageError(f"this drive has no parameter {', '.join(unknown)}; it has {', '.join(self.table)}")

    def _value_of(self, name: str, raw: float) -> ObjectValue:
        entry = self.table[name]
        return ObjectValue(entry.index, entry.subindex, entry.type, raw, name)

    def _read_raw(self, name: str) -> float:
        entry = self.table[name]
        raw = self._objects.read(entry.index, entry.subindex, entry.type)
        self._found.setdefault(name, raw)  # what was there first may always go back, whatever it means
        return raw

    def _write_raw(self, item: ObjectValue) -> None:
        try:
            self._objects.write(item.index, item.subindex, item.kind, item.raw)
        except ObjectRefused as error:
            if not item.name:
                raise
            raise ObjectRefused(f"{item.name}: {error}", error.abort_code, error.index, error.subindex) from error


def structure_of(
    profile: Profile,
    period_s: float,
    output_limit_rad_s: float = math.inf,
    dead_zone_rad: float = 0.0,
    parameters: Mapping[str, ParameterObject] | None = None,
) -> CascadeStructure:
    """The cascade inside a drive of this kind, its gains as the objects quantise them.

    Where the integral part is an integral time, its step and bounds stand under ``integral_time_s`` (K_I = K_P / T_n).

    Parameters
    ----------
    profile : Profile
    period_s : float, s
        Of the drive's loops.
    output_limit_rad_s : float, rad/s, motor shaft
        Of the position controller.
    dead_zone_rad : float, rad, motor shaft
        Of the position error.
    parameters : Mapping[str, ParameterObject] or None
        Calibrated ones.
    """
    steps: dict[str, float] = {}
    lowest: dict[str, float] = {}
    highest: dict[str, float] = {}
    for name in profile.parameters:
        entry = (parameters or profile.parameters)[name]
        if entry.type == "real32" or name in ("prefilter_kind", "filter_reference"):
            continue
        key = "integral_time_s" if entry.law == "integral_time" else name
        steps[key] = entry.scale
        lowest[key], highest[key] = (bound * entry.scale for bound in entry.range)
    options = dict(profile.structure)
    return CascadeStructure(
        name=profile.name,
        period_s=period_s,
        prefilters=tuple(options.pop("prefilters")),
        steps=steps,
        lowest=lowest,
        highest=highest,
        output_limit_rad_s=output_limit_rad_s,
        dead_zone_rad=dead_zone_rad,
        **options,
    )
