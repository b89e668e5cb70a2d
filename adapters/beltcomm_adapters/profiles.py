"""Kinds of drives: ``configs/drives/*.yaml`` as checked values, and the choice among them.

A quirk of a drive is a line in its file, never a branch on its name.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, Final, Literal

from beltcomm.configfiles import config_names, find_config, line_of, named_file, read_yaml
from beltcomm.drive.objects import ParameterObject, name_of
from beltcomm.drive.parameters import GAIN_NAMES, GainTerm
from beltcomm.errors import UsageError
from beltcomm_adapters.locks import ALWAYS, Lock
from beltcomm_adapters.profile_schema import CONFIDENCES, faults
from beltcomm_adapters.sdo import SAVE, SAVE_PLACE

#: Keys of a file that state no fact about the drive; every other one has its source.
SOURCE_KEYS: Final = ("source", "confidence")
UNSOURCED: Final = frozenset({"name", "title", "like", "known_gains", "never_write"})
#: The profile whose entries hold where one of a user's own has none; of an entry there, where it says nothing of its source.
LIKE: Final = "cia402"
OWN: Final = {"source": "this file", "confidence": "read"}
#: Faults of a file that are told at once.
TOLD: Final = 5


#: Where drives keep settings of their controllers: the maker's own objects, and those of CiA 402 (60F6h, current control, is locked).
CONTROLLERS: Final = (range(0x2000, 0x6000), range(0x60F6, 0x60FC))


@dataclass(frozen=True)
class TorqueScale:
    """Torque of which the drive's torques are thousandths.

    Attributes
    ----------
    of : Literal
        "rated_torque" (6076h), "rated_current", "drive_peak" or "unknown".
    confidence : str
        Of that.
    check : str
        What tells whether it is right, in words.
    nm : float or None
        N m that a thousand are; None is the rated torque.
    """

    of: Literal["rated_torque", "rated_current", "drive_peak", "unknown"]
    confidence: str
    check: str
    nm: float | None = None


@dataclass(frozen=True)
class ActualTorque:
    """Object of the torque that acts.   type : "int16" or "int32".   nm : N m in one of its units; None is the unit of setpoints.

    late_ms, filter_ms, command : what is stated of it, None where nothing is: how much older it is than the position beside it, the time
    constant of its filter, and whether it is only the command.
    """

    index: int = 0x6077
    subindex: int = 0
    type: str = "int16"
    nm: float | None = None
    late_ms: float | None = None
    filter_ms: float | None = None
    command: bool | None = None


@dataclass(frozen=True)
class Save:
    """Object that makes parameters permanent: what is written there, and s that it may take."""

    index: int = SAVE_PLACE[0]
    subindex: int = SAVE_PLACE[1]
    type: str = SAVE_PLACE[2]
    value: int = SAVE
    seconds: float | None = None


@dataclass(frozen=True)
class Profile:
    """A kind of drive.

    Attributes
    ----------
    match : Mapping[str, Any] or None
        Of its identity; None is chosen by name only.
    modes : Mapping[str, int]
        CiA 402 mode of operation by kind of motion.
    choices : Mapping[str, tuple[int, ...]]
        All that may serve, the best first; see :meth:`with_modes`.
    supported_modes : tuple of int
        Asked when the drive has no 6502h.
    units : Literal['cia402', 'factor_group']
        "cia402" (608Fh, 6091h, 6092h, 60A8h to 60AAh) or "factor_group" (6093h, 6094h, 6097h of the Metronix family).
    position_unit, velocity_unit, acceleration_unit : str or None
        By name, where the drive does not tell them ("0.1 rpm", "10 counts/s2").
    rated_torque_unit_nm : float or None
        N m in one unit of 6076h; None is mN m, or what agrees with axis.yaml.
    offsets : bool
        60B1h and 60B2h exist.
    guarding : Literal['heartbeat', 'node_guarding']
        How the drive notices that its host is gone.
    torque_sampling : Literal['over', 'after']
        See :class:`beltcomm.drive.Capabilities`.
    bus : str
        "canopen", or what the drive has in place of such a port; then it cannot be opened here.
    shortest_sync_ms, sync_step_ms, sync_change
        Smallest period of SYNC and its step, and whether a new one (60C2h) acts at once or after save and reset.
    torque_scale : TorqueScale
        See :class:`TorqueScale`.
    actual_torque : ActualTorque
        See :class:`ActualTorque`.
    error_behaviour : Mapping[str, int]
        Values of 1029h:1 (``node``) and 6007h (``axis``) while beltcomm works; {} leaves a reaction that stops it.
    save : Save
        See :class:`Save`.
    homing_method : int or None
        6098h that this drive is homed with; None is the one that stands there.
    gain_meaning : Literal['documented', 'unconfirmed', 'none']
        "documented", "unconfirmed" (a step test finds it before a gain is written), or "none": no gain is writable.
    known_gains : tuple of GainTerm
        What is said of gains that are not writable.
    never_write : tuple of Lock
        Locked beside those of every drive.
    enable_logic : tuple[int, int, str, int] or None
        (index, subindex, type, value) that hands control to the bus, None when there is no such switch.
    torque_slope_permille_s : int or None
        6087h that makes mode 4 follow a setpoint at once.
    torque_exit : Literal['quick_stop', 'velocity']
        What brakes an axis out of torque mode: its quick stop, or, where that only takes the torque away, profile velocity (mode 3) at
        no speed before it.
    following_error : Literal['stops', 'reported', 'unknown']
        What a following error beyond 6065h does in the drive: a fault that stops it (8611h), or only bit 13 of 6041h.
    torque_limit_lowest_permille : int
        Smallest 6072h the drive takes.
    loop_period : tuple[int, int] or None
        (index, subindex) of the velocity loop's period in us.
    referenced : tuple[int, int, int] or None
        (index, subindex, bit).
    overload_time : tuple[int, int] or None
        (index, subindex) of the motor's I²t time in ms.
    output_limit, dead_zone : tuple[int, int] or None
        (index, subindex) of the position controller's, in speed and position units, where it has them.
    emergency : Mapping[int, str]
        Text of an EMCY code, beside those of CiA 301.
    signals : Mapping[str, Mapping[str, Any]]
        Places that only this kind of drive has, read by ``beltcomm doctor``: ready_for_enable, enable_inputs, ...
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
    following_error: Literal["stops", "reported", "unknown"] = "unknown"
    torque_limit_lowest_permille: int = 0
    loop_period: tuple[int, int] | None = None
    referenced: tuple[int, int, int] | None = None
    overload_time: tuple[int, int] | None = None
    output_limit: tuple[int, int] | None = None
    dead_zone: tuple[int, int] | None = None
    position_unit: str | None = None
    velocity_unit: str | None = None
    acceleration_unit: str | None = None
    rated_torque_unit_nm: float | None = None
    actual_torque: ActualTorque = ActualTorque()
    error_behaviour: Mapping[str, int] = field(default_factory=dict)
    save: Save = Save()
    homing_method: int | None = None
    emergency: Mapping[int, str] = field(default_factory=dict)
    signals: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    choices: Mapping[str, tuple[int, ...]] = field(default_factory=dict)

    @property
    def mapped_torque(self) -> tuple[int, int, int]:
        """Object of the torque that acts as a PDO maps it: index, subindex, bits."""
        return self.actual_torque.index, self.actual_torque.subindex, 32 if self.actual_torque.type == "int32" else 16

    def with_modes(self, available: Collection[int]) -> Profile:
        """The profile with the modes 6502h that a drive has: of each kind the first that is available; the first of all where none is."""
        best = {kind: next((mode for mode in modes if mode in available), modes[0]) for kind, modes in self.choices.items()}
        return replace(self, modes=best)


@cache
def load_profile(name: str) -> Profile:
    """A profile by its name.

    Parameters
    ----------
    name : str
        Of a shipped one, or a path.

    Raises
    ------
    UsageError
        When there is none, or when its file is not as it must be.
    """
    path = find_config("drives", name)
    raw = read_yaml(path)
    if wrong := list(faults(raw)):
        said = [f"line {line_of(path, where)}: {sentence}" for where, sentence in wrong[:TOLD]]
        more = f"; and {len(wrong) - TOLD} more" if len(wrong) > TOLD else ""
        raise UsageError(f"the drive profile {path.name} cannot be used: {'; '.join(said)}{more}")
    if named_file(name):
        raw = _completed(raw)
    try:
        found = _profile(raw)
        _check_writes(found, shipped=not named_file(name))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise UsageError(f"the drive profile {path.name} cannot be used: {type(error).__name__}: {error}") from error
    return found


def _completed(raw: Mapping[str, Any]) -> dict[str, Any]:
    """Each entry of a user's own file with its source, completed by the shipped profile that it is ``like``; chosen by name only.

    Raises UsageError when no shipped profile has that name.
    """
    like = str(raw.get("like", LIKE))
    base = read_yaml(find_config("drives", like)) if like in config_names("drives") else None
    if base is None:
        raise UsageError(f"no shipped profile is called {like!r}; known are {', '.join(config_names('drives'))}")
    base["match"] = None
    told = {**base["sources"], **{key: OWN for key in raw if key not in UNSOURCED | {"sources"}}, **raw.get("sources", {})}
    parts = {key: {**base[key], **raw[key]} for key in ("modes", "sync", "structure") if key in raw}
    own = {**base, **raw, **parts, "sources": told}
    own.pop("like", None)
    if "gain_meaning" not in raw and "parameters" in raw:
        own["gain_meaning"] = "unconfirmed" if raw["parameters"] else "none"  # a slip of a factor shows when they are measured
    return own


def choose_profile(identity: Mapping[str, str], wanted: str | None) -> Profile:
    """The profile of a drive.

    A profile fits when everything under its ``match`` is equal; an empty ``match`` fits every drive and is tried last.

    Parameters
    ----------
    identity : Mapping[str, str]
        What it says of itself: vendor_id, product_code, device_name.
    wanted : str or None
        Profile that was asked for.

    Returns
    -------
    Profile
        The one wanted, else that whose ``match`` asks for most of what fits.

    Raises
    ------
    UsageError
        For a drive that is not on CANopen.
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
    logic, referenced = raw.pop("enable_logic", None), raw.pop("referenced", None)
    choices = {str(kind): tuple(wanted) if isinstance(wanted, list) else (wanted,) for kind, wanted in raw.pop("modes").items()}
    return Profile(
        modes={kind: wanted[0] for kind, wanted in choices.items()},
        choices=choices,
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
        actual_torque=ActualTorque(**raw.pop("actual_torque", {})),
        save=Save(**raw.pop("save", {})),
        homing_method=raw.pop("homing", {}).get("method"),
        **raw,
    )


def _check_writes(profile: Profile, *, shipped: bool) -> None:
    """Refuse a profile that would have anything written but settings of controllers and modes that fit, by a ValueError.

    shipped : it came with this package; any other one may hand control to the bus by an object only that a shipped one does it by.
    """
    places = [(entry.index, entry.subindex) for entry in profile.parameters.values()]

    def locked(index: int, subindex: int) -> Lock | None:
        return next((lock for lock in (*ALWAYS, *profile.never_write) if lock.holds(index, subindex)), None)

    for name, entry in profile.parameters.items():
        place = entry.index, entry.subindex
        if not any(entry.index in known for known in CONTROLLERS):
            raise ValueError(f"{name} in {name_of(*place)}, where no drive has a setting of its controllers")
        if lock := locked(*place):
            raise ValueError(f"{name} in {name_of(*place)}, which holds {lock.what}")
        if places.count(place) > 1:
            raise ValueError(f"{name} in {name_of(*place)} as another parameter")
    save = profile.save
    if save.index != SAVE_PLACE[0] and not any(save.index in known for known in CONTROLLERS[:1]):
        raise ValueError(f"save writes {name_of(save.index, save.subindex)}; give 1010h, or an object of the maker's own (2000h to 5FFFh)")
    if lock := locked(save.index, save.subindex):
        raise ValueError(f"save writes {name_of(save.index, save.subindex)}, which holds {lock.what}")
    if (save.index, save.subindex) in places:
        raise ValueError(f"save writes {name_of(save.index, save.subindex)}, which is a parameter too")
    logic = profile.enable_logic
    if logic is not None and not shipped and logic not in {load_profile(name).enable_logic for name in config_names("drives")}:
        raise ValueError(f"enable_logic writes {name_of(*logic[:2])} before anybody is asked; a shipped profile may do so")


def _lock(entry: Mapping[str, Any]) -> Lock:
    """Objects ``index``, or ``first`` to ``last``; of one ``subindex`` only where it is given."""
    first, last = (entry["index"], entry["index"]) if "index" in entry else (entry["first"], entry["last"])
    return Lock(first, last, entry["what"], entry.get("subindex"))
