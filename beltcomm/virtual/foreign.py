"""Drives of other makers, played from facts: one file in ``configs/slaves`` each, over the one slave of this package.

The facts are those of public EDS and DCF files and manuals; each file says which it read and which it recalls.  What the files may say is
:data:`_KEYS`, explained in docs/slaves.md.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from beltcomm.configfiles import config_names, find_config, named_file, read_yaml
from beltcomm.control import Cascade, Feedforward
from beltcomm.errors import UsageError
from beltcomm.plant import IDEAL, Instruments
from beltcomm.virtual.dictionary import ObjectDictionary, ObjectRow
from beltcomm.virtual.objects import PDO_COUNT, PDO_INVALID, PDO_NO_RTR, parameter
from beltcomm.virtual.pdo import EVERY_TYPE, PdoRules
from beltcomm.virtual.profiles import PROFILES, UserUnits, VirtualProfile, generic_rows, signs
from beltcomm.virtual.stage import EMMS_AS_70, Nameplate

_RPM_PER_RAD_S = 30.0 / math.pi
_KEYS = frozenset(
    {"title", "sources", "base", "name", "vendor", "product", "modes", "homing", "quick_stops", "cycle_us", "units", "sdo_ms", "enable_ms"}
    | {"pdo", "without", "objects", "aliases", "loop", "instruments", "following_error_faults", "i2t_faults", "vendor_bits", "tells_zero"}
)
#: Gains of a drive that nobody has tuned, in SI: those of the reference drive.  ti: integral time in place of K_I.
_FACTORY = {"kp": 0.002, "ki": 0.02, "ti": 0.1, "kpp": 1.0, "filter": 2e-3}
_ALL_MODES = (1, 3, 4, 6, 7, 8, 9, 10)

Place = tuple[int, int]


def profile_named(name: str) -> VirtualProfile:
    """The virtual drive of a name, or of the file of a path.

    Parameters
    ----------
    name : str
        Of a shipped profile, or a path.

    Raises
    ------
    UsageError
        When there is none, or when the file is not right.
    """
    if name in PROFILES:
        return PROFILES[name]
    if not named_file(name) and name not in config_names("slaves"):
        known = ", ".join((*PROFILES, *config_names("slaves")))
        raise UsageError(f"there is no virtual drive with the profile {name!r}; there are {known}")
    return _from_file(str(find_config("slaves", name)), name)


@cache
def _from_file(path: str, name: str) -> VirtualProfile:
    try:
        found = _profile(name, read_yaml(Path(path)))
        _try(found)
        return found
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise UsageError(f"{path} does not describe a drive: {error!r}; docs/slaves.md says what it may hold") from error


def _try(profile: VirtualProfile) -> None:
    """Everything that is made of the facts, once: what is wrong with them is found out here."""
    dictionary = ObjectDictionary(profile.rows(1, EMMS_AS_70, 4096))
    profile.scaling(dictionary, 4096)
    profile.cascade(dictionary, EMMS_AS_70)


def _profile(name: str, facts: Mapping[str, Any]) -> VirtualProfile:
    if unknown := set(facts) - _KEYS:
        raise ValueError(f"unknown entries {', '.join(sorted(unknown))}")
    pdo = facts.get("pdo", {})
    modes = frozenset(facts.get("modes", _ALL_MODES))
    quick_stops = frozenset(facts.get("quick_stops", (0, 1, 2, 5, 6)))
    common = {
        "name": name,
        "cycle_s": facts.get("cycle_us", 1000) / 1e6,
        "sdo_delay_ms": facts.get("sdo_ms", 0),
        "enable_ms": facts.get("enable_ms", 0),
        "instruments": Instruments(**facts["instruments"]) if "instruments" in facts else IDEAL,
    }
    base = facts.get("base")
    if base is not None:
        known = PROFILES[base]
        return replace(known, **common, rows=lambda *drive: _changed(known.rows(*drive), facts, *drive))
    gains = _Loop(facts.get("loop", {}))
    units = facts.get("units", {})
    return VirtualProfile(
        **common,
        rows=lambda node_id, motor, counts: _rows(facts, node_id, motor, counts, modes, quick_stops),
        scaling=lambda dictionary, counts: _scaling(units, dictionary, counts),
        cascade=gains.cascade,
        output_limit=lambda _dictionary, _scaling: (math.inf, 0.0),
        gain_objects=gains.indices,
        modes=modes,
        pdos=PdoRules(
            frozenset(pdo["types"]) if "types" in pdo else EVERY_TYPE,
            dummies=pdo.get("dummies", False),
            remote=pdo.get("remote", False),
            type_254_is_cyclic=pdo.get("type_254_is_cyclic", False),
        ),
        homing=frozenset(facts.get("homing", (1, 2, 17, 18, 33, 34, 35, 37))),
        quick_stops=quick_stops,
        following_error_faults=facts.get("following_error_faults", True),
        i2t_faults=facts.get("i2t_faults", True),
        vendor_bits=facts.get("vendor_bits", False),
        tells_zero=facts.get("tells_zero", False),
        peak_torque_units=units.get("peak_torque", 0.0),
        aliases=tuple((_place(a), _place(b)) for a, b in facts.get("aliases", {}).items()),
    )


def _place(text: str) -> Place:
    """``30A2:1`` as index and subindex; a subindex that is not there is 0."""
    index, _, subindex = str(text).partition(":")
    return int(index, 16), int(subindex or "0", 16)


class _Loop:
    """The gains: where each stands and what one unit of it is in SI, times the torque constant where it is told per ampere."""

    def __init__(self, facts: Mapping[str, Mapping[str, Any]]) -> None:
        self._facts = facts
        self.places = {role: _place(fact["object"]) for role, fact in facts.items() if "object" in fact}
        self.indices = tuple({index for index, _ in self.places.values()})

    def unit(self, role: str, motor: Nameplate) -> float:
        """One unit of the object in SI."""
        fact = self._facts[role]
        return float(fact["unit"]) * (motor.torque_constant_nm_a if fact.get("per_ampere") else 1.0)

    def rows(self, motor: Nameplate) -> list[ObjectRow]:
        """Objects of the gains, at what an untuned drive has."""
        found = []
        for role, (index, subindex) in self.places.items():
            fact = self._facts[role]
            value = fact.get("value", _FACTORY[role] / self.unit(role, motor))
            kind = fact.get("type", "u32")
            number = float(value) if kind == "f32" else max(round(value), 1)
            when = fact.get("when", "any")
            found.append(parameter(index, subindex, kind, number, role, fact.get("low"), fact.get("high"), pdo="", when=when))
        return found

    def cascade(self, dictionary: ObjectDictionary, motor: Nameplate) -> Cascade:
        """Meaning of the objects."""
        value = dict(_FACTORY)
        for role, (index, subindex) in self.places.items():
            value[role] = dictionary.entry(index, subindex).value * self.unit(role, motor)
        ki = value["kp"] / max(value["ti"], 1e-6) if "ti" in self.places else value["ki"]
        return Cascade(
            kp_nm_s_rad=value["kp"],
            ki_nm_rad=ki,
            kpp_1_s=value["kpp"],
            velocity_filter_s=value["filter"],
            feedforward=Feedforward(velocity=1.0),
            filter_reference=False,
        )


#: How many of the unit are one count/s, or one rpm.
_VELOCITY: dict[str, tuple[str, float]] = {
    "counts/s": ("counts", 1.0),
    "0.1 counts/s": ("counts", 10.0),
    "counts/65536/ms": ("counts", 65.536),
    "rpm": ("rpm", 1.0),
    "0.1 rpm": ("rpm", 10.0),
    "0.001 rpm": ("rpm", 1000.0),
    "rev/s": ("rpm", 1.0 / 60.0),
}
_ACCELERATION: dict[str, tuple[str, float]] = {
    "counts/s2": ("counts", 1.0),
    "10 counts/s2": ("counts", 0.1),
    "counts/65536/ms2": ("counts", 0.065536),
    "rpm/s": ("rpm", 1.0),
    "0.1 rpm/s": ("rpm", 10.0),
    "rev/s2": ("rpm", 1.0 / 60.0),
    "ms to 3000 rpm": ("time", 3000.0),
}


def _unit(said: str | list[Any], known: Mapping[str, tuple[str, float]]) -> tuple[str, float]:
    """By name, or as a pair: units per count (or rpm) a second."""
    return known[said] if isinstance(said, str) else (said[0], float(said[1]))


def _scaling(units: Mapping[str, Any], dictionary: ObjectDictionary, counts: int) -> UserUnits:
    position_sign, velocity_sign = signs(dictionary)
    per_rev = units.get("position", "counts")
    if per_rev == "counts":
        per_rev = counts
    elif per_rev == "feed":  # CiA 402: feed constant times gear ratio
        value = {place: dictionary.entry(*place).value for place in ((0x6092, 1), (0x6092, 2), (0x6091, 1), (0x6091, 2))}
        per_rev = value[0x6092, 1] / value[0x6092, 2] * value[0x6091, 2] / value[0x6091, 1]
    per_rad = per_rev / math.tau
    of, factor = _unit(units.get("velocity", "counts/s"), _VELOCITY)
    velocity = factor * (per_rad if of == "counts" else _RPM_PER_RAD_S)
    if units.get("velocity_prefix") and dictionary.has(0x60A9):
        velocity *= 10.0 ** -_signed(dictionary.entry(0x60A9).value >> 24)
    of, factor = _unit(units.get("acceleration", "counts/s2"), _ACCELERATION)
    ramp_to = factor / _RPM_PER_RAD_S if of == "time" else 0.0
    acceleration = factor * (per_rad if of == "counts" else _RPM_PER_RAD_S)
    return UserUnits(position_sign * per_rad, velocity_sign * velocity, acceleration, ramp_to)


def _signed(byte: int) -> int:
    return byte - 256 if byte > 127 else byte


def _rows(
    facts: Mapping[str, Any], node_id: int, motor: Nameplate, counts: int, modes: frozenset[int], quick_stops: frozenset[int]
) -> list[ObjectRow]:
    units = facts.get("units", {})
    position = units.get("position", "counts")
    per_rev = counts if isinstance(position, str) else float(position)
    of, factor = _unit(units.get("velocity", "counts/s"), _VELOCITY)
    rev_per_s = factor * (per_rev if of == "counts" else 60.0)
    of, factor = _unit(units.get("acceleration", "counts/s2"), _ACCELERATION)
    rev_per_s2 = factor * (per_rev if of == "counts" else 60.0)
    rows = generic_rows(
        node_id,
        motor,
        counts,
        facts["name"],
        facts["vendor"],
        facts["product"],
        modes,
        quick_stops,
        rev_per_s,
        rev_per_s2,
        facts.get("pdo", {}).get("entries", 8),
    )
    if of == "time":
        ramps = {0x6083: 100.0, 0x6084: 100.0, 0x6085: 200.0, 0x609A: 20.0}
        rows = [replace(r, default=round(1e3 * factor / 60.0 / ramps[r.index])) if r.index in ramps else r for r in rows]
    return _changed(rows + _Loop(facts.get("loop", {})).rows(motor), facts, node_id, motor, counts)


def _changed(rows: list[ObjectRow], facts: Mapping[str, Any], node_id: int, motor: Nameplate, counts: int) -> list[ObjectRow]:
    """The rows as these facts want them."""
    found = {(row.index, row.subindex): row for row in rows}
    for text, change in facts.get("objects", {}).items():
        where = _place(text)
        fields = {key: change[key] for key in ("low", "high", "pdo", "access", "when") if key in change}
        if "type" in change:
            fields["kind"] = change["type"]
        if "value" in change:
            fields["default"] = _number(change["value"], motor, counts)
        old = found.get(where, ObjectRow(*where, change.get("type", "u32"), "rw", 0, "maker's", stored=True))
        found[where] = replace(old, **fields)
    for text in facts.get("without", ()):
        index, subindex = _place(text)
        for where in [w for w in found if w[0] == index and (":" not in str(text) or w[1] == subindex)]:
            found[where] = replace(found[where], access="none")
    _shape_pdos(found, facts.get("pdo", {}))
    return list(found.values())


def _number(value: float | str | list[Any], motor: Nameplate, counts: int) -> float | str:
    """A number, or ``[quantity, units per SI unit]``."""
    if not isinstance(value, list):
        return value
    known = {
        "rated_torque": motor.rated_torque_nm,
        "peak_torque": motor.peak_torque_nm,
        "rated_current": motor.rated_current_a,
        "torque_constant": motor.torque_constant_nm_a,
        "max_speed": motor.max_speed_rpm,
        "counts": counts,
    }
    return round(known[value[0]] * float(value[1]))


def _shape_pdos(found: dict[Place, ObjectRow], pdo: Mapping[str, Any]) -> None:
    """PDOs of the drive: their number, which are valid at boot, which of their parameters a master may write."""
    entries = pdo.get("entries", 8)
    valid = {str(text) for text in pdo.get("valid", ())}
    fixed = pdo.get("fixed", False)
    maps = {str(text): entries for text, entries in pdo.get("maps", {}).items()}
    for direction, communication, mapping in (("receive", 0x1400, 0x1600), ("transmit", 0x1800, 0x1A00)):
        for number in range(PDO_COUNT):
            one, its_map = communication + number, mapping + number
            if number >= pdo.get(direction, PDO_COUNT):
                for where in [w for w in found if w[0] in (one, its_map)]:
                    del found[where]
                continue
            cob_id = int(found[one, 1].default)
            if f"{one:04X}" in valid:
                cob_id &= ~PDO_INVALID
            if pdo.get("remote") and direction == "transmit":
                cob_id &= ~PDO_NO_RTR
            fixed_id = pdo.get("fixed_identifiers", False)
            found[one, 1] = replace(found[one, 1], default=cob_id, access="ro" if fixed_id else "rw")
            mapped = maps.get(f"{its_map:04X}")
            if mapped is not None:
                found[its_map, 0] = replace(found[its_map, 0], default=len(mapped))
                for slot in range(entries):
                    found[its_map, slot + 1] = replace(found[its_map, slot + 1], default=mapped[slot] if slot < len(mapped) else 0)
            if fixed is True or (fixed and f"{its_map:04X}" in map(str, fixed)):
                for slot in range(entries + 1):
                    found[its_map, slot] = replace(found[its_map, slot], access="ro")
            for sub, key in ((3, "inhibit"), (5, "event_timer")):
                if not pdo.get(key, True) and (one, sub) in found:
                    del found[one, sub]
