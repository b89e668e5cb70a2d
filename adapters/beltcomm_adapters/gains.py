"""Named parameters of a drive and the objects that hold them: written, read back, and put back when one fails."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable, Mapping
from typing import Final

from beltcomm.control import CascadeStructure
from beltcomm.errors import BeltcommError, DriveError, ObjectRefused, UsageError
from beltcomm.parameters import LIMIT_NAMES
from beltcomm_adapters.profiles import ParameterObject, Profile
from beltcomm_adapters.scaling import Scaling
from beltcomm_adapters.sdo import Objects, name_of

#: The gain that an integral time rests on:  T_n = K_P / K_I.
_GAIN: Final = "kp_nm_s_rad"
_BOUNDS: Final = {"uint8": (0, 255), "uint16": (0, 65535), "uint32": (0, 2**32 - 1)}


class Parameters:
    """The parameters beltcomm may write, by name, SI at the motor shaft."""

    def __init__(self, objects: Objects, profile: Profile, scaling: Scaling) -> None:
        self._objects = objects
        wide = len(objects.read_bytes(0x6080)) == 4  # UINT32 in CiA 402, UINT16 on older drives
        self._table: dict[str, ParameterObject] = {
            **profile.parameters,
            LIMIT_NAMES[0]: ParameterObject(0x6072, 0, "uint16", scaling.torque_nm, profile.torque_limit_lowest_permille),
            LIMIT_NAMES[1]: ParameterObject(0x6080, 0, "uint32" if wide else "uint16", 2.0 * math.pi / 60.0),  # min⁻¹
        }

    @property
    def names(self) -> tuple[str, ...]:
        """Every name this drive has."""
        return tuple(self._table)

    def read(self, names: Iterable[str]) -> dict[str, float]:
        """Values as they stand in the drive.  Raises UsageError for an unknown name."""
        wanted = list(names)
        self._known(wanted)
        return {name: self._value(name, self._read_raw(name), self._stored_gain) for name in wanted}

    def write(self, values: Mapping[str, float]) -> dict[str, float]:
        """Write, read back, compare; on any failure put back what this call has changed.  Returns what is stored.

        Raises UsageError (unknown name, value out of range), ObjectRefused, DriveError (another value came back), BusError.
        """
        raws: dict[str, float] = {}

        def gain() -> float:
            return raws[_GAIN] * self._table[_GAIN].scale if _GAIN in raws else self._stored_gain()

        for name, value in self._in_order(values).items():
            raws[name] = self._raw(name, value, gain)
        before = {name: self._read_raw(name) for name in raws}
        try:
            for name, raw in raws.items():
                self._write_raw(name, raw)
                if (stored := self._read_raw(name)) != raw:
                    entry = self._table[name]
                    raise DriveError(
                        f"the drive stored {stored:g} instead of {raw:g} for {name} (object "
                        f"{name_of(entry.index, entry.subindex)}, raw values); its profile may not fit"
                    )
        except BaseException as error:
            self._put_back(before, error)
            raise
        return {name: self._value(name, raws[name], gain) for name in values}

    def _put_back(self, before: Mapping[str, float], error: BaseException) -> None:
        for name, raw in reversed(list(before.items())):
            try:
                self._write_raw(name, raw)
            except BeltcommError as failure:
                error.add_note(f"{name} could not be put back: {failure}")

    def _in_order(self, values: Mapping[str, float]) -> dict[str, float]:
        """``values`` in the table's order; K_I joins when K_P is written alone, for the drive holds their quotient."""
        self._known(values)
        tied = [name for name, entry in self._table.items() if entry.law == "integral_time" and _GAIN in values]
        asked = {**self.read(name for name in tied if name not in values), **values}
        return {name: asked[name] for name in self._table if name in asked}

    def _raw(self, name: str, value: float, gain: Callable[[], float]) -> float:
        entry = self._table[name]
        if not math.isfinite(value):
            raise UsageError(f"{name} must be a number, not {value}")
        if entry.type == "real32":
            single: float = struct.unpack("<f", struct.pack("<f", value))[0]
            return single
        exact = math.inf  # the integral time of an integral part that is off
        if entry.law == "linear":
            exact = value / entry.scale
        elif value > 0:
            exact = gain() / (value * entry.scale)
        least, most = _range_of(entry)
        if not least - 0.5 <= exact <= most + 0.5:
            ends = sorted(self._value(name, end, gain) for end in (max(least, 1) if entry.law != "linear" else least, most))
            raise UsageError(f"{name} = {value:g} is outside what this drive takes, {ends[0]:.4g} to {ends[1]:.4g}; design with its limits")
        return round(exact)

    def _value(self, name: str, raw: float, gain: Callable[[], float]) -> float:
        entry = self._table[name]
        if entry.law == "linear":
            return raw * entry.scale
        return gain() / (raw * entry.scale) if raw else math.inf

    def _stored_gain(self) -> float:
        return self._read_raw(_GAIN) * self._table[_GAIN].scale

    def _known(self, names: Iterable[str]) -> None:
        if unknown := [name for name in names if name not in self._table]:
            raise UsageError(f"this drive has no parameter {', '.join(unknown)}; it has {', '.join(self._table)}")

    def _read_raw(self, name: str) -> float:
        entry = self._table[name]
        return self._objects.read(entry.index, entry.subindex, entry.type)

    def _write_raw(self, name: str, raw: float) -> None:
        entry = self._table[name]
        try:
            self._objects.write(entry.index, entry.subindex, entry.type, raw)
        except ObjectRefused as error:
            raise ObjectRefused(f"{name}: {error}", error.abort_code, error.index, error.subindex) from error


def _range_of(entry: ParameterObject) -> tuple[int, int]:
    """Smallest and largest raw value of an integer object."""
    least, most = _BOUNDS[entry.type]
    return entry.lowest if entry.lowest is not None else least, entry.highest if entry.highest is not None else most


def structure_of(profile: Profile, period_s: float, output_limit_rad_s: float = math.inf, dead_zone_rad: float = 0.0) -> CascadeStructure:
    """The cascade inside a drive of this kind, its gains as the objects quantise them.

    Where the integral part is an integral time, its step and bounds stand under ``integral_time_s`` (K_I = K_P / T_n).
    """
    steps: dict[str, float] = {}
    lowest: dict[str, float] = {}
    highest: dict[str, float] = {}
    for name, entry in profile.parameters.items():
        if entry.type == "real32" or name in ("prefilter_kind", "filter_reference"):
            continue
        key = "integral_time_s" if entry.law == "integral_time" else name
        steps[key] = entry.scale
        lowest[key], highest[key] = (bound * entry.scale for bound in _range_of(entry))
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
