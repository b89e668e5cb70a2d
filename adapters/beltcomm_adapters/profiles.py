"""What a kind of drive is like: ``configs/drives/*.yaml`` as checked values, and the choice among them.

A quirk of a drive is a line in its file, never a branch on its name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Final, Literal

from beltcomm.configfiles import config_names, find_config, named_file, read_yaml
from beltcomm.drive.objects import ParameterObject, name_of
from beltcomm.drive.parameters import GAIN_NAMES, PREFILTER_KINDS, GainTerm
from beltcomm.errors import UsageError
from beltcomm_adapters.locks import ALWAYS, Lock

CONFIDENCES: Final = ("read", "inferred", "unconfirmed", "simulated")
#: Keys of a file that state no fact about the drive; every other one has its source.
SOURCE_KEYS: Final = ("source", "confidence")
UNSOURCED: Final = frozenset({"name", "title", "known_gains", "never_write"})


#: Modes of CiA 402 by kind of motion: those whose setpoints are sent.
MODES: Final[Mapping[str, tuple[int, ...]]] = {"torque": (4, 10), "position": (7, 8), "velocity": (3, 9), "profile": (1,)}
#: Where drives keep settings of their controllers: the maker's own objects, and those of CiA 402 (60F6h, current control, is locked).
CONTROLLERS: Final = (range(0x2000, 0x6000), range(0x60F6, 0x60FC))
CHOICES: Final = {
    "units": ("cia402", "factor_group"),
    "guarding": ("heartbeat", "node_guarding"),
    "torque_sampling": ("over", "after"),
    "sync_change": ("at_once", "after_reset"),
    "gain_meaning": ("documented", "unconfirmed", "none"),
}
#: What a structure has or has not, beside its prefilters.
PARTS: Final = ("velocity_feedforward", "torque_feedforward", "reference_filter", "roll_off")
RATED_PERMILLE: Final = 1000
#: ms of a SYNC's period.
SYNC_MS: Final = (0.05, 100.0)


@dataclass(frozen=True)
class TorqueScale:
    """What the drive's torques count in thousandths of.   of : "rated_torque" (6076h), "rated_current", "drive_peak" or "unknown".

    confidence : of that.   check : what tells whether it is right, in words.
    """

    of: Literal["rated_torque", "rated_current", "drive_peak", "unknown"]
    confidence: str
    check: str


@dataclass(frozen=True)
class Profile:
    """A kind of drive.

    match : of its identity; None is chosen by name only.
    modes : CiA 402 mode of operation by kind of motion.    supported_modes : asked when the drive has no 6502h.
    units : "cia402" (608Fh, 6091h, 6092h) or "factor_group" (6093h, 6094h, 6097h of the Metronix family).
    offsets : 60B1h and 60B2h exist.    guarding : how the drive notices that its host is gone.
    torque_sampling : see :class:`beltcomm.drive.Capabilities`.
    bus : "canopen", or what the drive has in place of such a port; then it cannot be opened here.
    shortest_sync_ms, sync_step_ms, sync_change : smallest period of SYNC and its step, and whether a new one (60C2h) acts at once or
        after save and reset.
    torque_scale : see :class:`TorqueScale`.
    gain_meaning : "documented", "unconfirmed" (a step test finds it before a gain is written), or "none": no gain is writable.
    known_gains : what is said of gains that are not writable.     never_write : locked beside those of every drive.
    enable_logic : (index, subindex, type, value) that hands control to the bus, None when there is no such switch.
    torque_slope_permille_s : 6087h that makes mode 4 follow a setpoint at once.
    torque_exit : what brakes an axis out of torque mode: its quick stop, or, where that only takes the torque away, profile velocity
    (mode 3) at no speed before it.
    torque_limit_lowest_permille : smallest 6072h the drive takes.
    loop_period : (index, subindex) of the velocity loop's period in us.    referenced : (index, subindex, bit).
    overload_time : (index, subindex) of the motor's I²t time in ms.
    output_limit, dead_zone : (index, subindex) of the position controller's, in speed and position units, where it has them.
    emergency : text of an EMCY code, beside those of CiA 301.
    signals : places that only this kind of drive has, read by ``beltcomm doctor``: ready_for_enable, enable_inputs, ...
    """

    name: str
    title: str
    match: Mapping[str, Any] | None
    modes: Mapping[str, int]
    supported_modes: tuple[int, ...]
    units: Literal["cia402", "factor_group"]
    offsets: bool
    guarding: Literal["heartbeat", "node_guarding"]
    torque_sampling: Literal["over", "after"]
    shortest_sync_ms: float
    sync_step_ms: float
    sync_change: Literal["at_once", "after_reset"]
    structure: Mapping[str, Any]
    parameters: Mapping[str, ParameterObject]
    torque_scale: TorqueScale
    gain_meaning: Literal["documented", "unconfirmed", "none"]
    sources: Mapping[str, Mapping[str, str]]
    bus: str = "canopen"
    known_gains: tuple[GainTerm, ...] = ()
    never_write: tuple[Lock, ...] = ()
    enable_logic: tuple[int, int, str, int] | None = None
    torque_slope_permille_s: int | None = None
    torque_exit: Literal["quick_stop", "velocity"] = "quick_stop"
    torque_limit_lowest_permille: int = 0
    loop_period: tuple[int, int] | None = None
    referenced: tuple[int, int, int] | None = None
    overload_time: tuple[int, int] | None = None
    output_limit: tuple[int, int] | None = None
    dead_zone: tuple[int, int] | None = None
    emergency: Mapping[int, str] = field(default_factory=dict)
    signals: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


@cache
def load_profile(name: str) -> Profile:
    """The profile called ``name``.  Raises UsageError when there is none, or when its file is not as it must be."""
    path = find_config("drives", name)
    raw = read_yaml(path)
    try:
        found = _profile(raw)
        _check_words(found)
        _check_writes(found, shipped=not named_file(name))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise UsageError(f"the drive profile {path.name} cannot be used: {type(error).__name__}: {error}") from error
    return found


def choose_profile(identity: Mapping[str, str], wanted: str | None) -> Profile:
    """The profile of the drive with this ``identity`` (keys vendor_id, product_code, device_name), or the ``wanted`` one.

    A profile fits when everything under its ``match`` is equal; an empty ``match`` fits every drive and is tried last.
    """
    if wanted is not None:
        chosen = load_profile(wanted)
    else:  # the one that asks for most first
        profiles = sorted(map(load_profile, config_names("drives")), key=lambda profile: -len(profile.match or {}))
        chosen = next(profile for profile in profiles if profile.match is not None and _fits(profile.match, identity))
    if chosen.bus != "canopen":
        raise UsageError(f"{chosen.title} cannot be opened here: it has {chosen.bus}; beltcomm speaks CANopen and RS-232 only")
    return chosen


def _fits(match: Mapping[str, Any], identity: Mapping[str, str]) -> bool:
    numbers = all(identity.get(key) == str(match[key]) for key in ("vendor_id", "product_code") if key in match)
    name = identity.get("device_name", "")
    return numbers and (any(name.startswith(known) for known in match["device_names"]) if "device_names" in match else True)


def _place(entry: Mapping[str, int] | None) -> tuple[int, int] | None:
    return (entry["index"], entry["subindex"]) if entry else None


def _profile(raw: dict[str, Any]) -> Profile:
    """Checked values from the file's mapping; a key that nothing reads, or an entry without source, is a ValueError."""
    sync = raw.pop("sync")
    parameters = {name: ParameterObject(**entry) for name, entry in raw.pop("parameters").items()}
    if unknown := set(parameters) - set(GAIN_NAMES):
        raise ValueError(f"unknown parameters {sorted(unknown)}")
    sources = raw.pop("sources")
    locks, gains = raw.pop("never_write", []), raw.pop("known_gains", [])
    told = [*sources.items(), *((str(entry), entry) for entry in (*locks, *gains))]
    if wrong := [key for key, entry in told if not entry["source"] or entry["confidence"] not in CONFIDENCES]:
        raise ValueError(f"no source or no confidence for {wrong}")
    given = {key for key in raw if key not in UNSOURCED} | {"sync"} | ({"parameters"} if parameters else set())
    if missing := sorted(given - set(sources)):
        raise ValueError(f"no source for {missing}")
    if bool(parameters) is (raw["gain_meaning"] == "none"):
        raise ValueError("gain_meaning is none exactly where no gain is writable")
    if raw.get("torque_exit", "quick_stop") not in ("quick_stop", "velocity"):
        raise ValueError(f"torque_exit is {raw['torque_exit']!r}, not quick_stop or velocity")
    logic, referenced = raw.pop("enable_logic", None), raw.pop("referenced", None)
    return Profile(
        shortest_sync_ms=float(sync["shortest_ms"]),
        sync_step_ms=float(sync["step_ms"]),
        sync_change=sync["change"],
        parameters=parameters,
        torque_scale=TorqueScale(**raw.pop("torque_scale"), confidence=sources["torque_scale"]["confidence"]),
        never_write=tuple(_lock(entry) for entry in locks),
        known_gains=tuple(GainTerm(**{key: value for key, value in entry.items() if key not in SOURCE_KEYS}) for entry in gains),
        sources=sources,
        supported_modes=tuple(raw.pop("supported_modes")),
        enable_logic=(logic["index"], logic["subindex"], logic["type"], logic["value"]) if logic else None,
        referenced=(referenced["index"], referenced["subindex"], referenced["bit"]) if referenced else None,
        loop_period=_place(raw.pop("loop_period", None)),
        overload_time=_place(raw.pop("overload_time", None)),
        output_limit=_place(raw.pop("output_limit", None)),
        dead_zone=_place(raw.pop("dead_zone", None)),
        **raw,
    )


def _check_words(profile: Profile) -> None:
    """Raise ValueError for a word or a number that no profile has: nothing of it is to be found out on a connected drive."""
    for key, known in CHOICES.items():
        if getattr(profile, key) not in known:
            raise ValueError(f"{key} is {getattr(profile, key)!r}; choose one of {', '.join(known)}")
    own = profile.structure
    if unknown := sorted(set(own) - {"prefilters", *PARTS}):
        raise ValueError(f"structure has no {', '.join(unknown)}")
    if not set(own["prefilters"]) <= set(PREFILTER_KINDS) or not all(isinstance(own.get(part, False), bool) for part in PARTS):
        raise ValueError(f"structure is {dict(own)}; prefilters are some of {', '.join(PREFILTER_KINDS)}, the rest true or false")
    logic, zero = profile.enable_logic, profile.referenced
    places = [profile.loop_period, profile.overload_time, profile.output_limit, profile.dead_zone, logic and logic[:2], zero and zero[:2]]
    places += [(entry["index"], entry.get("subindex", 0)) for entry in profile.signals.values()]
    numbers = [zero[2] if zero else 0, profile.torque_slope_permille_s or 0, *profile.supported_modes, *profile.emergency]
    numbers += [n for entry in profile.signals.values() for n in (entry.get("bit", 0), *entry.get("bits", {}).values())]
    whole = all(isinstance(n, int) and 0 <= n <= 0xFFFFFFFF for n in numbers)
    if not whole or not all(0 <= index <= 0xFFFF and 0 <= sub <= 0xFF for index, sub in filter(None, places)):
        raise ValueError("an index, a subindex, a bit, a mode or a code that cannot be")
    if not 0 <= profile.torque_limit_lowest_permille <= RATED_PERMILLE:
        raise ValueError(f"torque_limit_lowest_permille is {profile.torque_limit_lowest_permille}; rated torque, {RATED_PERMILLE}, at most")


def _check_writes(profile: Profile, *, shipped: bool) -> None:
    """What a profile makes beltcomm write: settings of controllers and modes that fit, whoever wrote it.   Raises ValueError.

    shipped : it came with this package; any other one may hand control to the bus by an object only that a shipped one does it by.
    """
    for kind, mode in profile.modes.items():
        if mode not in MODES.get(kind, ()):
            raise ValueError(f"mode {mode!r} for motions of kind {kind!r}; known are {', '.join(f'{k} {v}' for k, v in MODES.items())}")
    places = [(entry.index, entry.subindex) for entry in profile.parameters.values()]
    for name, entry in profile.parameters.items():
        place = entry.index, entry.subindex
        if not any(entry.index in known for known in CONTROLLERS):
            raise ValueError(f"{name} in {name_of(*place)}, where no drive has a setting of its controllers")
        if lock := next((lock for lock in (*ALWAYS, *profile.never_write) if lock.holds(*place)), None):
            raise ValueError(f"{name} in {name_of(*place)}, which holds {lock.what}")
        if places.count(place) > 1:
            raise ValueError(f"{name} in {name_of(*place)} as another parameter")
    logic = profile.enable_logic
    if logic is not None and not shipped and logic not in {load_profile(name).enable_logic for name in config_names("drives")}:
        raise ValueError(f"enable_logic writes {name_of(*logic[:2])} before anybody is asked; a shipped profile may do so")
    least_ms, most_ms = SYNC_MS
    if not (least_ms <= profile.shortest_sync_ms <= most_ms and least_ms <= profile.sync_step_ms <= most_ms):
        raise ValueError(f"sync of {profile.shortest_sync_ms} ms in steps of {profile.sync_step_ms} ms; {least_ms:g} to {most_ms:g} can be")


def _lock(entry: Mapping[str, Any]) -> Lock:
    """Objects ``index``, or ``first`` to ``last``; of one ``subindex`` only where it is given."""
    first, last = (entry["index"], entry["index"]) if "index" in entry else (entry["first"], entry["last"])
    return Lock(first, last, entry["what"], entry.get("subindex"))
