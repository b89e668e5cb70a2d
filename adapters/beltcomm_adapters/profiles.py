"""What a kind of drive is like: ``configs/drives/*.yaml`` as checked values, and the choice among them.

A quirk of a drive is a line in its file, never a branch on its name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Final, Literal

from beltcomm.configfiles import config_names, find_config, read_yaml
from beltcomm.errors import UsageError
from beltcomm.parameters import GAIN_NAMES

CONFIDENCES: Final = ("read", "inferred", "unconfirmed", "simulated")


@dataclass(frozen=True)
class ParameterObject:
    """One gain as an object of the drive:  SI value = scale * raw value.

    type : an integer type or ``real32``.    lowest, highest : raw values the drive takes, None when unknown.
    law : "linear", or "integral_time": the object is T_n = K_P / K_I in units of ``scale`` seconds.
    """

    index: int
    subindex: int
    type: str
    scale: float = 1.0
    lowest: int | None = None
    highest: int | None = None
    law: Literal["linear", "integral_time"] = "linear"


@dataclass(frozen=True)
class Profile:
    """A kind of drive.

    modes : CiA 402 mode of operation by kind of motion.    supported_modes : asked when the drive has no 6502h.
    units : "cia402" (608Fh, 6091h, 6092h) or "factor_group" (6093h, 6094h, 6097h of the Metronix family).
    offsets : 60B1h and 60B2h exist.    guarding : how the drive notices that its host is gone.
    torque_sampling : see :class:`beltcomm.drive.Capabilities`.
    shortest_sync_ms, sync_change : smallest 60C2h, and whether a new value acts at once or after save and reset.
    enable_logic : (index, subindex, type, value) that hands control to the bus, None when there is no such switch.
    torque_slope_permille_s : 6087h that makes mode 4 follow a setpoint at once.
    torque_limit_lowest_permille : smallest 6072h the drive takes.
    loop_period : (index, subindex) of the velocity loop's period in us.    referenced : (index, subindex, bit).
    output_limit, dead_zone : (index, subindex) of the position controller's, in speed and position units, where it has them.
    emergency : text of an EMCY code, beside those of CiA 301.
    """

    name: str
    title: str
    match: Mapping[str, Any]
    modes: Mapping[str, int]
    supported_modes: tuple[int, ...]
    units: Literal["cia402", "factor_group"]
    offsets: bool
    guarding: Literal["heartbeat", "node_guarding"]
    torque_sampling: Literal["over", "after"]
    shortest_sync_ms: int
    sync_change: Literal["at_once", "after_reset"]
    structure: Mapping[str, Any]
    parameters: Mapping[str, ParameterObject]
    sources: Mapping[str, Mapping[str, str]]
    enable_logic: tuple[int, int, str, int] | None = None
    torque_slope_permille_s: int | None = None
    torque_limit_lowest_permille: int = 0
    loop_period: tuple[int, int] | None = None
    referenced: tuple[int, int, int] | None = None
    output_limit: tuple[int, int] | None = None
    dead_zone: tuple[int, int] | None = None
    emergency: Mapping[int, str] = field(default_factory=dict)


@cache
def load_profile(name: str) -> Profile:
    """The profile called ``name``.  Raises UsageError when there is none, or when its file is not as it must be."""
    path = find_config("drives", name)
    raw = read_yaml(path)
    try:
        return _profile(raw)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise UsageError(f"the drive profile {path.name} cannot be used: {type(error).__name__}: {error}") from error


def choose_profile(identity: Mapping[str, str], wanted: str | None) -> Profile:
    """The profile of the drive with this ``identity`` (keys vendor_id, product_code, device_name), or the ``wanted`` one.

    A profile fits when everything under its ``match`` is equal; an empty ``match`` fits every drive and is tried last.
    """
    if wanted is not None:
        return load_profile(wanted)
    profiles = sorted(map(load_profile, config_names("drives")), key=lambda profile: not profile.match)
    return next(profile for profile in profiles if _fits(profile.match, identity))


def _fits(match: Mapping[str, Any], identity: Mapping[str, str]) -> bool:
    numbers = all(identity.get(key) == str(match[key]) for key in ("vendor_id", "product_code") if key in match)
    name = identity.get("device_name", "")
    return numbers and (any(name.startswith(known) for known in match["device_names"]) if "device_names" in match else True)


def _place(entry: Mapping[str, int] | None) -> tuple[int, int] | None:
    return (entry["index"], entry["subindex"]) if entry else None


def _profile(raw: dict[str, Any]) -> Profile:
    """Checked values from the file's mapping; a key that nothing reads is a ValueError."""
    sync = raw.pop("sync")
    parameters = {name: ParameterObject(**entry) for name, entry in raw.pop("parameters").items()}
    if unknown := set(parameters) - set(GAIN_NAMES):
        raise ValueError(f"unknown parameters {sorted(unknown)}")
    sources = raw.pop("sources")
    if wrong := [key for key, entry in sources.items() if not entry["source"] or entry["confidence"] not in CONFIDENCES]:
        raise ValueError(f"no source or no confidence for {wrong}")
    logic, referenced = raw.pop("enable_logic", None), raw.pop("referenced", None)
    return Profile(
        shortest_sync_ms=sync["shortest_ms"],
        sync_change=sync["change"],
        parameters=parameters,
        sources=sources,
        supported_modes=tuple(raw.pop("supported_modes")),
        enable_logic=(logic["index"], logic["subindex"], logic["type"], logic["value"]) if logic else None,
        referenced=(referenced["index"], referenced["subindex"], referenced["bit"]) if referenced else None,
        loop_period=_place(raw.pop("loop_period", None)),
        output_limit=_place(raw.pop("output_limit", None)),
        dead_zone=_place(raw.pop("dead_zone", None)),
        **raw,
    )
