"""Axis as known beforehand: data sheets and limits (``axis.yaml``), checked once.

Every entry may be missing; a job names what it needs with :meth:`Axis.require`.  An axis with neither ``belt``, ``pulley`` nor
``transmission`` is one rigid mass on the load side.  SI units, the unit in the name; the side of the gearbox stands at each entry.  A kind
of axis without a belt calls its entries by its own names in the file: :mod:`beltcomm.axis.kinds`.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any, NamedTuple

from beltcomm.axis.entries import (
    COMMISSION_NEEDS,
    SECTIONS,
    AxisEntry,
    AxisLimits,
    AxisTargets,
    Belt,
    Coupling,
    Gearbox,
    Motor,
    Mounting,
    Payload,
    Pulley,
    TrajectoryLimits,
    Travel,
    entries_of,
    meaning_of,
)
from beltcomm.axis.impossible import ImpossibleEntry, check_together
from beltcomm.axis.kinds import BELT, KINDS, Transmission, faults_of, likely_place, shown, to_file, to_inside
from beltcomm.configfiles import did_you_mean, find_config, line_of, read_yaml, to_yaml, write_text
from beltcomm.errors import UsageError
from beltcomm.given import pasted
from beltcomm.quantities import unit_of

__all__ = [
    "SECTIONS",
    "Axis",
    "AxisLimits",
    "AxisTargets",
    "Belt",
    "Coupling",
    "Gearbox",
    "ImpossibleEntry",
    "Motor",
    "Mounting",
    "Payload",
    "Pulley",
    "TorqueLimit",
    "TrajectoryLimits",
    "Transmission",
    "Travel",
    "axis_from_dict",
    "load_axis",
    "save_axis",
]


class TorqueLimit(NamedTuple):
    """The smallest of the limits of an axis's torque.

    Attributes
    ----------
    torque_nm : float, N m, motor shaft
    binds : str
        In words, what sets it.
    """

    torque_nm: float
    binds: str


@dataclass(frozen=True)
class Axis:
    """One axis as its data sheets describe it.

    Attributes
    ----------
    source : str
        The file it came from, for messages.
    """

    name: str = ""
    motor: Motor = field(default_factory=Motor)
    gearbox: Gearbox = field(default_factory=Gearbox)
    coupling: Coupling = field(default_factory=Coupling)
    pulley: Pulley | None = None
    belt: Belt | None = None
    travel: Travel = field(default_factory=Travel)
    limits: AxisLimits = field(default_factory=AxisLimits)
    trajectories: Mapping[str, TrajectoryLimits] = field(default_factory=dict)
    mounting: Mounting = field(default_factory=Mounting)
    payload: Payload = field(default_factory=Payload)
    targets: AxisTargets = field(default_factory=AxisTargets)
    transmission: Transmission | None = None
    source: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        own = KINDS.get(self.kind)
        by_kind = set() if own is None else {entry.inside for entry in own.renamed.values()}
        for key in SECTIONS:
            _check_section(key, getattr(self, key), by_kind)
        for key, limits in self.trajectories.items():
            _check_section(f"trajectories.{key}", limits, set())
        check_together(
            self.motor, self.pulley, self.belt, self.travel, self.targets, self.trajectories,
            driven_by_belt=self.has_transmission and self.transmission is None,
            linear_m_rad=self.known_transmission_m_rad if self.kind == "linear" else None,
        )  # fmt: skip

    def __str__(self) -> str:
        return (f"axis {self.name!r}" if self.name else "axis without a name") + (f" ({self.source})" if self.source else "")

    def get(self, entry: str) -> Any:
        """Value of an entry.

        Parameters
        ----------
        entry : str
            Dotted name such as ``"motor.inertia_kg_m2"``.

        Returns
        -------
        Any
            None when it is not known.
        """
        section, _, key = entry.partition(".")
        return getattr(getattr(self, section), key, None)

    @property
    def needs(self) -> dict[str, str]:
        """Entries that commissioning cannot do without, by dotted name, and what for."""
        own = KINDS.get(self.kind)
        if own is None:
            return dict(COMMISSION_NEEDS)
        return {own.renamed[name].inside if name in own.renamed else name: purpose for name, purpose in own.needs.items()}

    def require(self, job: str, *entries: str) -> None:
        """Make sure that entries are known.

        Parameters
        ----------
        job : str
            The job that needs them, in words.
        *entries : str
            Dotted names.

        Raises
        ------
        UsageError
            Unless all are known, naming those that are missing and the job.
        """
        own = KINDS.get(self.kind)
        if own is not None:  # what a belt axis needs to know of pulley and belt, this one needs of its transmission
            entries = tuple(entry for entry in entries if entry.partition(".")[0] != "belt")
            if self.motor.peak_torque_nm is not None:  # which bounds the force where nothing else does
                entries = tuple(entry for entry in entries if entry != "limits.feed_force_n")
        missing = [entry for entry in entries if self.get(entry) is None]
        if missing:
            named = ", ".join(f"{entry if own is None else own.in_file(entry)} ({self._meaning_of(entry)})" for entry in missing)
            verb = "is" if len(missing) == 1 else "are"
            raise UsageError(f"{job} needs {named}, which {verb} not in {self}; add it from the data sheet")

    def _meaning_of(self, entry: str) -> str:
        own = KINDS.get(self.kind)
        renamed = None if own is None else own.renamed.get(own.in_file(entry))
        return meaning_of(entry) if renamed is None else renamed.entry.meaning

    def trajectory(self, name: str) -> TrajectoryLimits:
        """Limits of a named reference motion.

        Parameters
        ----------
        name : str
            As in ``axis.yaml``.

        Returns
        -------
        TrajectoryLimits
            Speed, acceleration and jerk, m along the axis.

        Raises
        ------
        UsageError
            For an unknown name.
        """
        if name not in self.trajectories:
            known = ", ".join(self.trajectories) or "none"
            raise UsageError(f"{self} has no trajectory {name!r}{did_you_mean(name, self.trajectories)}; known are {known}")
        return self.trajectories[name]

    @property
    def kind(self) -> str:
        """Kind of the transmission: "belt", a word of :data:`beltcomm.axis.kinds.KINDS`, "" for an axis that does not say."""
        return self.transmission.kind if self.transmission is not None else BELT if self.has_transmission else ""

    @property
    def has_transmission(self) -> bool:
        """True if it is known what moves the load; otherwise the axis is one rigid mass on the load side, whatever its records are in.

        Those of a linear motor hold N and m, those of a motor alone N m or A and rad: :attr:`beltcomm.recording.Recording.side`.
        """
        return self.belt is not None or self.pulley is not None or self.transmission is not None

    @property
    def rigid(self) -> bool:
        """True if nothing is known to swing between motor and load of an axis without a belt."""
        return self.transmission is not None and math.isinf(self.belt_stiffness_n_m(0.0))

    @property
    def transmission_m_rad(self) -> float:
        """Carriage travel per radian of the motor:  i_t = r/i_g  (2.16), m/rad.

        1 for an axis without transmission, whose load side is all there is.

        Raises
        ------
        UsageError
            Without a radius.
        """
        if not self.has_transmission:
            return 1.0
        self.require("the transmission", "pulley.effective_radius_m")
        return float(self.get("pulley.effective_radius_m")) / self.gearbox.ratio

    @property
    def known_transmission_m_rad(self) -> float | None:
        """Way of the carriage per angle of the motor, m/rad; None where no radius tells it."""
        return self.transmission_m_rad if self.get("pulley.effective_radius_m") is not None else None

    @property
    def motor_side_inertia_kg_m2(self) -> float:
        """Inertia at the motor shaft:  Θ_e = Θ_m + Θ_coupling + (Θ_r + Θ_g)/i_g²  (2.8), kg m².

        Of an axis without transmission only what is known; the rest is in its rigid mass.

        Raises
        ------
        UsageError
            For an axis with transmission and no motor inertia.
        """
        if self.has_transmission:
            self.require("the motor-side inertia", "motor.inertia_kg_m2")
        driven = (self.get("pulley.inertia_kg_m2") or 0.0) + self.gearbox.inertia_kg_m2
        return float((self.motor.inertia_kg_m2 or 0.0) + self.coupling.inertia_kg_m2 + driven / self.gearbox.ratio**2)

    @property
    def belt_force_limit_n(self) -> float:
        """Largest force of the transmission:  min(feed force, pulley torque/r), N; infinite when neither is known.

        Without a belt and without either, what the motor's peak torque is at the load: nothing else bounds it.
        """
        known = [self.limits.feed_force_n or math.inf]
        if self.limits.pulley_torque_nm is not None and self.get("pulley.effective_radius_m") is not None:
            known.append(self.limits.pulley_torque_nm / float(self.get("pulley.effective_radius_m")))
        if self.transmission is not None and not self.states_force and self.motor.peak_torque_nm is not None:
            known.append(self.motor.peak_torque_nm / self.transmission_m_rad)
        return min(known)

    @property
    def states_force(self) -> bool:
        """True if a limit of what the transmission bears is stated."""
        return self.limits.feed_force_n is not None or self.limits.pulley_torque_nm is not None

    def torque_limit(self) -> TorqueLimit:
        """The smallest of the torque limits, at the motor shaft, and which one it is; without a belt, the feed force in N counts as it is.

        min(motor peak, pulley torque/i_g, i_t · feed force).

        Raises
        ------
        UsageError
            When none of them is known.
        """
        known = []
        if (peak := self.motor.peak_torque_nm) is not None:
            known.append(TorqueLimit(peak, f"the motor's peak torque of {peak:g} N m"))
        if (torque := self.limits.pulley_torque_nm) is not None:
            known.append(TorqueLimit(torque / self.gearbox.ratio, f"the axis limit of {torque:g} N m at the driving pulley"))
        if (force := self.limits.feed_force_n) is not None and (not self.has_transmission or self.known_transmission_m_rad is not None):
            known.append(TorqueLimit(force * self.transmission_m_rad, f"the axis limit of {force:g} N feed force"))
        if not known:
            self.require("a torque limit", "motor.peak_torque_nm", "limits.pulley_torque_nm")
        return min(known)

    @property
    def torque_limit_nm(self) -> float:
        """Torque of :meth:`torque_limit`, N m, motor shaft."""
        return self.torque_limit().torque_nm

    def belt_stiffness_n_m(self, position_m: float) -> float:
        """Stiffness between motor and load, along the line of the load, N/m; infinite for a rigid one.

        Of a belt  c = EA/l1 + EA/(2 l3 − l1)  (2.26),  l1 = offset + position;  coupling in series: 1/c_total = 1/c + i_t²/k.

        Parameters
        ----------
        position_m : float, m
            Carriage on the axis.

        Returns
        -------
        float
            N/m at the belt line.

        Raises
        ------
        UsageError
            When the belt's data are not known or the position lies outside the belt.
        """
        if not self.has_transmission:
            return math.inf
        if self.transmission is not None:
            own = self.transmission.stiffness_n_m
            return self._with_coupling(0.0 if own is None else 1.0 / own)
        self.require("the belt stiffness", "belt.specific_stiffness_n", "belt.pulley_distance_m")
        ea, l3 = float(self.get("belt.specific_stiffness_n")), float(self.get("belt.pulley_distance_m"))
        l1 = self.travel.driven_side_offset_m + position_m
        if not 0.0 < l1 < l3:
            raise UsageError(
                f"at {position_m:g} m the carriage of {self} is {l1:g} m from the driving pulley, outside 0..{l3:g} m; "
                "check travel.driven_side_offset_m and belt.pulley_distance_m"
            )
        return self._with_coupling(1.0 / (ea / l1 + ea / (2.0 * l3 - l1)))

    def _with_coupling(self, compliance_m_n: float) -> float:
        """Stiffness, N/m, of this compliance with that of the coupling behind it."""
        if self.coupling.stiffness_nm_rad is not None:
            compliance_m_n += self.transmission_m_rad**2 / self.coupling.stiffness_nm_rad
        return 1.0 / compliance_m_n if compliance_m_n > 0.0 else math.inf

    def to_dict(self) -> dict[str, Any]:
        """The entries that are known, in the order and shape of ``axis.yaml``."""
        data: dict[str, Any] = {"name": self.name}
        for key in SECTIONS:
            section = getattr(self, key)
            known = {item.name: getattr(section, item.name) for item in fields(section)} if section is not None else {}
            data[key] = {name: value for name, value in known.items() if value is not None and value != ""}
            if key == "limits":
                data["trajectories"] = {
                    name: {item.name: getattr(limits, item.name) for item in fields(limits)} for name, limits in self.trajectories.items()
                }
        if self.transmission is not None:
            own = self.transmission
            stated = {"kind": own.kind, **({} if own.stiffness_n_m is None else {"stiffness_n_m": own.stiffness_n_m})}
            return to_file(KINDS[own.kind], {**data, "transmission": stated})
        # an empty pulley or belt still says that this is a belt axis
        return {key: value for key, value in data.items() if value or (key in {"pulley", "belt"} and getattr(self, key))}

    def fingerprint(self) -> str:
        """Short hash of all entries that describe the machine: equal for equal axes, whatever file they came from and whatever is asked."""
        text = json.dumps(_flat({key: value for key, value in self.to_dict().items() if key != "targets"}), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def changes(self, other: Axis) -> list[str]:
        """The entries in which two axes differ.

        Parameters
        ----------
        other : Axis
            The axis to compare with.

        Returns
        -------
        list of str
            Dotted names, each with both values in words.
        """
        mine, theirs = _flat(self.to_dict()), _flat(other.to_dict())
        names = [*mine, *(name for name in theirs if name not in mine)]
        return [
            f"{name} {mine.get(name, 'not known')} -> {theirs.get(name, 'not known')}"
            for name in names
            if mine.get(name) != theirs.get(name)
        ]


def load_axis(path_or_name: str | Path) -> Axis:
    """Load ``axis.yaml`` from a path, or a shipped axis by its name.

    Parameters
    ----------
    path_or_name : str or Path
        Path of an ``axis.yaml``, or the name of a shipped axis.

    Returns
    -------
    Axis
        All entries checked; SI units.

    Raises
    ------
    UsageError
        For a file that is not there, empty or not YAML, an unknown key (with the line and the key that was probably meant), a value that is
        no number or cannot be.
    """
    path = find_config("axes", str(path_or_name))
    if not (data := read_yaml(path)):
        raise UsageError(
            f"{path} is empty: nothing is known of the axis; bring the file back, or write it with `beltcomm init {pasted(path)}`"
        )
    return axis_from_dict(data, path)


def axis_from_dict(data: Mapping[str, Any], path: Path | None = None) -> Axis:
    """Make an axis of a mapping in the shape of ``axis.yaml``.

    Parameters
    ----------
    data : dict of str to Any
        The mapping.
    path : Path or None
        For messages.

    Returns
    -------
    Axis
        Checked as by :func:`load_axis`.

    Raises
    ------
    UsageError
        As :func:`load_axis`.
    """

    def fault(text: str, *keys: str) -> UsageError:
        line = line_of(path, keys) if path else 0
        place = f"{path}, line {line}: " if line else f"{path}: " if path else ""
        return UsageError(f"{place}{text}")

    def mapping(value: Any, *keys: str) -> Mapping[Any, Any]:
        if value is None:
            return {}
        if not isinstance(value, Mapping):
            raise fault(f"{'.'.join(keys)} is {shown(value)}; it must hold names and values", *keys)
        return value

    def section(kind: type[Any], value: Any, *keys: str) -> Any:
        value = mapping(value, *keys)
        known = entries_of(kind)
        names = [item.name for item in fields(kind)]
        read = {}
        for key, item in value.items():
            if key not in names:
                raise fault(f"unknown key {shown(key)} in {'.'.join(keys)}{did_you_mean(key, names)}", *keys, key)
            if item is None:
                continue
            if key in known and (isinstance(item, bool) or not isinstance(item, (int, float))):
                unit = unit_of(key)
                raise fault(f"{'.'.join(keys)}.{key} is {shown(item)}; give a number{unit and f' in {unit}'}", *keys, key)
            number = known.get(key)
            read[key] = str(item) if number is None else int(item) if number.whole and float(item).is_integer() else float(item)
        missing = [item.name for item in fields(kind) if item.default is MISSING and item.name not in read]
        if missing:
            raise fault(f"{'.'.join(keys)} lacks {', '.join(missing)}; a reference motion needs all its limits", *keys)
        return kind(**read)

    read: dict[str, Any] = {"source": str(path) if path else ""}
    stated = mapping(data.get("transmission"), "transmission")
    named: Any = stated.get("kind")
    if "transmission" in data and named != BELT:
        if named not in KINDS:
            words = f"is {shown(named)}{did_you_mean(str(named), KINDS)}" if named is not None else "is not stated"
            raise fault(f"transmission.kind {words}; it is one of {BELT}, {', '.join(KINDS)}", "transmission", "kind")
        for text, keys in faults_of(KINDS[named], data):
            raise fault(text, *keys)
        data = to_inside(KINDS[named], data)
        read["transmission"] = Transmission(**data.pop("transmission"))
    elif named == BELT:
        if len(stated) > 1:
            raise fault("a belt axis states its transmission under pulley and belt; leave all but kind out", "transmission")
        data = {"pulley": {}, **{key: value for key, value in data.items() if key != "transmission"}}
    names = ["name", "trajectories", *SECTIONS]
    for key, value in data.items():
        if key not in names:
            meant = likely_place(str(key)) or did_you_mean(key, names)
            raise fault(f"unknown key {shown(key)}{meant}; known are {', '.join((*names, 'transmission'))}", key)
        if key == "name":
            read[key] = "" if value is None else str(value)
        elif key in SECTIONS:
            read[key] = section(SECTIONS[key], value, key)
        elif isinstance(value, Mapping):
            read[key] = {str(name): section(TrajectoryLimits, item, key, str(name)) for name, item in value.items()}
        elif value is not None:
            raise fault(f"trajectories is {shown(value)}; it must hold names and their limits", key)
    try:
        return Axis(**read)
    except ImpossibleEntry as error:
        if "transmission" not in read:
            raise fault(str(error), *error.entry.split(".")) from error
        own = KINDS[read["transmission"].kind]
        from beltcomm.axis.terms import terms  # which is made of what stands here

        way = read["pulley"].effective_radius_m if "pulley" in read else None  # a linear motor's entries are in N and kg
        text = terms(read["transmission"].kind, way or 0.0).said(str(error))
        raise fault(text, *own.in_file(error.entry).split(".")) from error


def save_axis(axis: Axis, path: Path) -> None:
    """Write ``axis.yaml``, whole or not at all; floats come back exactly.

    Parameters
    ----------
    axis : Axis
        The axis to be written.
    path : Path
        Of the file.

    Raises
    ------
    UsageError
        When it cannot be written.
    """
    write_text(path, to_yaml(axis.to_dict()))


def _check_section(name: str, section: Any, by_kind: set[str]) -> None:
    """Raise ImpossibleEntry for a number outside its bounds; those that the kind of the axis bounds itself must be finite."""
    if section is None:
        return
    for key, entry in entries_of(type(section)).items():
        value = getattr(section, key)
        if f"{name}.{key}" in by_kind:
            entry = AxisEntry(entry.meaning)
        fault = entry.fault(value) if value is not None else ""
        if fault:
            raise ImpossibleEntry(f"{name}.{key} is {value:g} {unit_of(key)}".rstrip() + f"; {fault}", f"{name}.{key}")


def _flat(data: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested mappings as one with dotted names."""
    flat: dict[str, Any] = {}
    for key, value in data.items():
        flat |= _flat(value, f"{prefix}{key}.") if isinstance(value, Mapping) else {f"{prefix}{key}": value}
    return flat
