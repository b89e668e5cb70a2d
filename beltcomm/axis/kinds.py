"""Kinds of axes: what lies between motor and load, as entries of ``axis.yaml``.

Inside there is one axis: a motor that moves a mass along a line, rigidly or by a spring.  A belt axis says so by its pulley and belt; any
other kind states ``transmission.kind`` and calls its entries by its own names: :data:`KINDS` says what each of them is inside, and by which
factor.  A load that turns moves along its arc at ``ARC_M``, the radius at which one degree is one millimetre: travel, speed and errors keep
their digits, a torque at the load is a force at that radius, an inertia a mass there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from beltcomm.axis.entries import AT, SECTIONS, AxisEntry, TrajectoryLimits, entries_of
from beltcomm.configfiles import did_you_mean
from beltcomm.quantities import unit_of


@dataclass(frozen=True)
class Transmission:
    """Transmission between motor and load of an axis without a belt.

    Attributes
    ----------
    kind : str
        One of :data:`KINDS`.
    stiffness_n_m : float or None
        Beside that of the coupling, along the line of the load, N/m; None for a rigid one.
    """

    kind: str = ""
    stiffness_n_m: float | None = None


#: m; radius at which an arc of 1 mm is 1 degree, and that arc.
ARC_M = 0.18 / math.pi
DEGREE_M = 1e-3
#: Kind of a belt axis, which needs no entry.
BELT = "belt"
#: Sections of a file as they stand in it and are asked for: from the motor on to the load.
_TO_LOAD = ("name", "motor", "gearbox", "coupling", "transmission", "pulley", "belt")
ORDER = (*_TO_LOAD, "travel", "limits", "trajectories", "mounting", "payload", "targets")
#: Entries that are words, by section.
WORDS: Mapping[str, tuple[str, ...]] = {"motor": ("name",), "targets": ("at", "move"), "transmission": ("kind",)}
#: Characters of a wrong value that are shown.
LONGEST_SHOWN = 60
RADIUS = "pulley.effective_radius_m"


@dataclass(frozen=True)
class FileEntry:
    """An entry of ``axis.yaml`` under the name that a kind gives it.

    Attributes
    ----------
    inside : str
        Dotted name inside.
    entry : AxisEntry
        Meaning and bounds, in the unit of the file.
    factor : float
        Inside over file.
    power : int
        Of the travel per radian of the motor, m/rad, by which inside over file is multiplied further.
    usual : tuple of float or None
        Range in the unit of the file outside which an answer is asked for again.
    """

    inside: str
    entry: AxisEntry
    factor: float = 1.0
    power: int = 0
    usual: tuple[float, float] | None = None


@dataclass(frozen=True)
class AxisKind:
    """One kind of axis.

    Attributes
    ----------
    title : str
        As a person calls it.
    renamed : dict of str to FileEntry
        By dotted name in the file: entries that are called or measured otherwise than inside.
    without : frozenset of str
        Sections, or dotted names, inside that it does not have.
    titles : dict of str to str
        Of the sections.
    needs : dict of str to str
        By dotted name in the file, what commissioning cannot do without, and what for.
    rotary : bool
        Its load turns.
    load : str
        What moves is called.
    """

    title: str
    renamed: Mapping[str, FileEntry] = field(default_factory=dict)
    without: frozenset[str] = frozenset()
    titles: Mapping[str, str] = field(default_factory=dict)
    needs: Mapping[str, str] = field(default_factory=dict)
    rotary: bool = False
    load: str = "carriage"

    def in_file(self, inside: str) -> str:
        """Dotted name in the file of one inside, as of a belt axis."""
        return next((name for name, entry in self.renamed.items() if entry.inside == inside), inside)

    def sections(self) -> dict[str, dict[str, AxisEntry]]:
        """The numbers of each section of the file, in the order in which they are asked for."""
        found: dict[str, dict[str, AxisEntry]] = {}
        for section, kind in SECTIONS.items():
            if section in self.without:
                continue
            found[section] = {}
            for name, entry in entries_of(kind).items():
                named, _, key = self.in_file(f"{section}.{name}").partition(".")
                if f"{section}.{name}" not in self.without and named == section:
                    found[section][key] = entry
        for name, own in self.renamed.items():
            section, _, key = name.partition(".")
            found.setdefault(section, {})[key] = own.entry
        return {section: found[section] for section in sorted(found, key=ORDER.index) if found[section]}

    def trajectory_entries(self) -> dict[str, AxisEntry]:
        """The numbers of a reference motion in the file."""
        own = entries_of(TrajectoryLimits)
        return {_turned(name): entry for name, entry in own.items()} if self.rotary else own


def _turned(name: str) -> str:
    """``speed_m_s`` as ``speed_deg_s``."""
    return name.replace("_m_s", "_deg_s")


def _known(inside: str, meaning: str, low: float, high: float, factor: float = 1.0, power: int = 0, **more: Any) -> FileEntry:
    """An entry above zero."""
    return FileEntry(inside, AxisEntry(meaning, above=0.0, at_least=low, at_most=high), factor, power, **more)


def _axial(what: str) -> dict[str, FileEntry]:
    """Transmission of a screw or a rack beside its feed."""
    return {
        "transmission.inertia_kg_m2": FileEntry(
            "pulley.inertia_kg_m2", AxisEntry(f"inertia of the {what} about its own axis", at_least=0.0, at_most=10.0), usual=(1e-7, 0.5)
        ),
        "transmission.stiffness_n_m": _known(
            "transmission.stiffness_n_m",
            f"stiffness between {what} and load, with bearings, along the axis; none: it counts as rigid",
            1e3, 1e12, usual=(1e6, 1e10),
        ),
    }  # fmt: skip


_LINEAR_NEEDS = {
    "travel.min_m": "the travel window",
    "travel.max_m": "the travel window",
    "limits.speed_m_s": "the speed limit",
}
_MOTOR_NEEDS = {"motor.inertia_kg_m2": "start values and the plausibility of the model", "motor.peak_torque_nm": "the torque limit"}
_NO_BELT = frozenset({"pulley", "belt", "travel.driven_side_offset_m"})
#: What a motor that does not turn has none of.
_TURNS = frozenset(
    {"gearbox", "coupling", "motor.max_speed_rad_s", "motor.brake_torque_nm", "motor.brake_time_s", "limits.pulley_torque_nm"}
)
_SCREW = AxisKind(
    title="ball screw or spindle",
    renamed={
        "transmission.lead_m": _known(RADIUS, "lead: travel per turn of the screw", 1e-4, 1.0, 1.0 / math.tau, usual=(1e-3, 0.1)),
        **_axial("screw"),
        "limits.screw_torque_nm": _known("limits.pulley_torque_nm", "largest torque at the screw", 1e-3, 1e5),
    },
    without=_NO_BELT,
    load="table",
    titles={
        "transmission": "Screw",
        "coupling": "Coupling between motor and screw",
        "travel": "Travel of the table, from the axis zero",
        "payload": "Load",
    },
    needs={**_MOTOR_NEEDS, "transmission.lead_m": "travel per motor revolution", **_LINEAR_NEEDS},
)
_RACK = AxisKind(
    title="rack and pinion",
    renamed={
        "transmission.pinion_radius_m": _known(RADIUS, "pitch radius of the pinion: travel per radian", 1e-3, 1.0, usual=(5e-3, 0.2)),
        **_axial("pinion"),
        "limits.pinion_torque_nm": _known("limits.pulley_torque_nm", "largest torque at the pinion", 1e-3, 1e5),
    },
    without=_NO_BELT,
    titles={
        "transmission": "Rack and pinion",
        "coupling": "Coupling between motor and pinion",
        "travel": "Travel of the carriage, from the axis zero",
    },
    needs={**_MOTOR_NEEDS, "transmission.pinion_radius_m": "travel per motor revolution", **_LINEAR_NEEDS},
)
_ROTARY = AxisKind(
    title="rotary axis: table, direct drive, or a motor with a load that turns",
    renamed={
        "transmission.inertia_kg_m2": FileEntry(
            "pulley.inertia_kg_m2", AxisEntry("inertia of what turns rigidly with the output", at_least=0.0, at_most=1e3), usual=(1e-7, 1.0)
        ),
        "transmission.stiffness_nm_rad": _known(
            "transmission.stiffness_n_m",
            "torsional stiffness between output and load, beside that of the coupling; none: it counts as rigid",
            1e-2,
            1e10,
            ARC_M**-2,
            usual=(10.0, 1e8),
        ),
        "travel.min_deg": FileEntry("travel.min_m", AxisEntry("lowest angle of the load", at_least=-1e5, at_most=1e5), DEGREE_M),
        "travel.max_deg": FileEntry("travel.max_m", AxisEntry("highest angle of the load", at_least=-1e5, at_most=1e5), DEGREE_M),
        "limits.speed_deg_s": _known("limits.speed_m_s", "largest speed of the load", 1e-1, 1e5, DEGREE_M, usual=(5.0, 2e4)),
        "limits.acceleration_deg_s2": _known("limits.acceleration_m_s2", "largest acceleration of the load", 1.0, 1e7, DEGREE_M),
        "limits.load_torque_nm": _known("limits.feed_force_n", "largest torque that reaches the load", 1e-3, 1e6, 1.0 / ARC_M),
        "payload.inertia_kg_m2": FileEntry(
            "payload.mass_kg", AxisEntry("inertia of the load, when known", at_least=0.0, at_most=1e5), ARC_M**-2, usual=(0.0, 1e3)
        ),
        "targets.following_error_deg": _known("targets.following_error_m", "largest following error while it moves", 1e-4, 360.0, DEGREE_M),
        "targets.settled_error_deg": _known("targets.settled_error_m", "largest error once settled", 1e-4, 90.0, DEGREE_M),
        "targets.distance_deg": _known("targets.distance_m", "length of the move that is judged", 1.0, 1e5, DEGREE_M),
    },
    without=_NO_BELT | {"mounting", "limits.pulley_torque_nm"},
    titles={
        "transmission": "Output shaft",
        "coupling": "Coupling between motor and load",
        "travel": "Angles of the load, from the axis zero",
        "payload": "Load",
    },
    needs={
        **_MOTOR_NEEDS,
        "travel.min_deg": "the window of angles",
        "travel.max_deg": "the window of angles",
        "limits.speed_deg_s": "the speed limit",
    },
    rotary=True,
    load="load",
)
_LINEAR = AxisKind(
    title="linear motor",
    renamed={
        "transmission.pole_pair_m": _known(
            RADIUS, "length of a pole pair, N to N: what the drive counts as one turn of its motor", 1e-3, 1.0, 1.0 / math.tau,
            usual=(0.01, 0.2),
        ),
        "motor.mass_kg": _known("motor.inertia_kg_m2", "mass of the moving part of the motor", 1e-3, 1e4, power=2),
        "motor.force_constant_n_a": _known("motor.torque_constant_nm_a", "force per ampere (rms)", 1e-2, 1e5, power=1),
        "motor.rated_force_n": _known("motor.rated_torque_nm", "continuous rating (S1): force it holds all the time", 1e-2, 1e6, power=1),
        "motor.peak_force_n": _known("motor.peak_torque_nm", "largest force of the motor", 1e-2, 1e7, power=1),
        "motor.counts_per_pole_pair": FileEntry(
            "motor.encoder_counts_per_rev", AxisEntry("encoder counts per pole pair", above=0.0, at_most=2.0**32, whole=True)
        ),
        "motor.overload_time_s": _known("motor.overload_time_s", "time for which it bears its peak force from cold (I²t)", 1e-3, 60.0),
    },
    without=_NO_BELT | _TURNS,
    titles={"motor": "Motor", "transmission": "Pole pairs", "travel": "Travel of the carriage, from the axis zero"},
    needs={
        "transmission.pole_pair_m": "travel per turn that the drive counts",
        "motor.mass_kg": "start values and the plausibility of the model",
        "motor.peak_force_n": "the force limit",
        **_LINEAR_NEEDS,
    },
)  # fmt: skip
#: By the word in ``transmission.kind``.
KINDS: Mapping[str, AxisKind] = {"screw": _SCREW, "rack": _RACK, "rotary": _ROTARY, "linear": _LINEAR}


def _factor(entry: FileEntry, radius_m: float | None) -> float | None:
    """Inside over file; None where it needs the travel per radian and that is not known."""
    if entry.power == 0:
        return entry.factor
    return None if radius_m is None else entry.factor * radius_m**entry.power


#: Digits of a number that goes back into a file: one fewer than inside, so that what was typed comes back.
WRITTEN = 14


def _times(value: Any, factor: float, digits: int = 15) -> Any:
    """A number by a factor, to the 15 digits that a decimal text determines; whole numbers by one stay whole."""
    if factor == 1.0 or isinstance(value, bool) or not isinstance(value, (int, float)):
        return value
    return float(f"{value * factor:.{digits}g}")


def to_inside(kind: AxisKind, data: Mapping[str, Any]) -> dict[str, Any]:
    """The sections of a file of this kind as they are inside; what is unknown to it is left as it stands.

    Parameters
    ----------
    kind : AxisKind
    data : mapping of str to Any
        As read from its file.
    """
    radius = _radius(kind, data)
    found: dict[str, Any] = {key: dict(value) if isinstance(value, Mapping) else value for key, value in data.items()}
    moved: dict[str, Any] = {RADIUS: ARC_M} if kind.rotary else {}
    for name, entry in kind.renamed.items():
        section, _, key = name.partition(".")
        held: Any = found.get(section)
        if isinstance(held, dict) and key in held:
            factor = _factor(entry, radius)
            value = held.pop(key)
            moved[entry.inside] = None if factor is None else _times(value, factor)
    for inside, value in moved.items():
        section, _, key = inside.partition(".")
        found.setdefault(section, {})[key] = value
    _rename_place(found, kind.load, AT[1])
    motions = found.get("trajectories")
    if kind.rotary and isinstance(motions, Mapping):
        found["trajectories"] = {
            name: {key.replace("_deg_s", "_m_s"): _times(one, DEGREE_M) for key, one in each.items()} if isinstance(each, Mapping) else each
            for name, each in motions.items()
        }
    return found


def to_file(kind: AxisKind, data: Mapping[str, Any]) -> dict[str, Any]:
    """Inverse of :func:`to_inside`: sections as they are inside, in the shape of the file.

    Parameters
    ----------
    kind : AxisKind
    data : mapping of str to Any
        Sections as they are inside.
    """
    radius = dict(data.get("pulley") or {}).get("effective_radius_m")
    found: dict[str, Any] = {key: dict(value) if isinstance(value, Mapping) else value for key, value in data.items()}
    for name, entry in kind.renamed.items():
        (section, _, key), (own, _, last) = name.partition("."), entry.inside.partition(".")
        held, factor = found.get(own), _factor(entry, radius)
        if isinstance(held, dict) and last in held and factor is not None:
            found.setdefault(section, {})[key] = _times(held.pop(last), 1.0 / factor, WRITTEN)
    if kind.rotary and "trajectories" in found:
        found["trajectories"] = {
            name: {_turned(key): _times(one, 1.0 / DEGREE_M, WRITTEN) for key, one in each.items()}
            for name, each in found["trajectories"].items()
        }
    if kind.rotary:
        found.get("pulley", {}).pop("effective_radius_m", None)
    _rename_place(found, AT[1], kind.load)
    sections = kind.sections()
    for section, values in found.items():
        if isinstance(values, dict) and section != "trajectories":
            known = {*sections.get(section, ()), *WORDS.get(section, ())}
            found[section] = {key: value for key, value in values.items() if key in known}
    return {key: found[key] for key in sorted(found, key=ORDER.index) if found[key]}


def _rename_place(data: Mapping[str, Any], word: str, other: str) -> None:
    """Say otherwise where targets count."""
    targets = data.get("targets")
    if isinstance(targets, dict) and targets.get("at") == word:
        targets["at"] = other


def _radius(kind: AxisKind, data: Mapping[str, Any]) -> float | None:
    """Travel per radian of the transmission in a file, m/rad, where it says it as a number."""
    name = kind.in_file(RADIUS)
    section, _, key = name.partition(".")
    held = data.get(section)
    value = held.get(key) if isinstance(held, Mapping) else None
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    return float(value) * kind.renamed[name].factor


def likely_place(key: str) -> str:
    """The words ``, did you mean SECTION.KEY?`` for a kind of axis, or for a key that stands in one section; "" for none.

    Parameters
    ----------
    key : str
        That stands in no section.
    """
    if key == "kind" or key in KINDS:
        return f", did you mean transmission.kind={key if key in KINDS else 'screw'}?"
    places = [section for section, kind in SECTIONS.items() if key in entries_of(kind)]
    return f", did you mean {places[0]}.{key}?" if len(places) == 1 else ""


def faults_of(kind: AxisKind, data: Mapping[str, Any]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Entries of a file that this kind of axis does not have, and numbers out of its bounds, in words, with the keys that lead there.

    Parameters
    ----------
    kind : AxisKind
    data : mapping of str to Any
        As read from its file.
    """
    sections = kind.sections()
    for key, value in data.items():
        if key not in (*sections, "name", "trajectories"):
            belongs = f" of {kind.title}" if key in SECTIONS else ""
            yield f"unknown key {shown(key)}{belongs}{did_you_mean(key, sections)}; known are {', '.join(sections)}", (str(key),)
        if key == "trajectories" and isinstance(value, Mapping):
            for name, one in value.items():
                yield from _faults_in(kind, (key, str(name)), kind.trajectory_entries(), one)
        elif key in sections:
            yield from _faults_in(kind, (key,), sections[key], value)


def _faults_in(kind: AxisKind, at: tuple[str, ...], entries: Mapping[str, AxisEntry], held: Any) -> Iterator[tuple[str, tuple[str, ...]]]:
    if not isinstance(held, Mapping):
        if held is not None:
            yield f"{'.'.join(at)} is {shown(held)}; it must hold names and values", at
        return
    known = [*WORDS.get(at[0], ()), *entries]
    for name, number in held.items():
        place, unit = ".".join((*at, str(name))), unit_of(str(name))
        if name not in known:
            yield f"unknown key {shown(name)} in {'.'.join(at)}{did_you_mean(name, known)}", (*at, str(name))
        elif name in entries and number is not None:
            if isinstance(number, bool) or not isinstance(number, (int, float)):
                yield f"{place} is {shown(number)}; give a number{unit and f' in {unit}'}", (*at, name)
            elif place in kind.renamed and (wrong := entries[name].fault(number)):
                yield f"{place} is {shown(number)} {unit}".rstrip() + f"; {wrong}", (*at, name)


def shown(value: Any) -> str:
    """A wrong value, as far as it is short.

    Parameters
    ----------
    value : Any
        Of any type.
    """
    return text if len(text := repr(value)) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]} ..."
