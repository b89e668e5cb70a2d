"""``axis.yaml`` for people: every entry with its unit and meaning, what is not known commented out; and its JSON schema for editors."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import MISSING, fields
from typing import Any

from beltcomm.axis import Axis
from beltcomm.axis.entries import AT, SECTIONS, AxisEntry, TrajectoryLimits, entries_of
from beltcomm.axis.kinds import BELT, KINDS
from beltcomm.axis.kinds import WORDS as WORDS_OF
from beltcomm.axis.terms import terms
from beltcomm.quantities import unit_of

#: Column of the remarks; titles of the sections; meaning of the entries that are words.
COLUMN = 44
TITLES = {
    "motor": "Motor, all at its shaft",
    "gearbox": "Gearbox: ratio 1 when there is none",
    "coupling": "Coupling between motor and axis",
    "pulley": "Driving pulley",
    "belt": "Toothed belt",
    "travel": "Travel of the carriage, from the axis zero",
    "limits": "Limits of the mechanics",
    "mounting": "Mounting",
    "payload": "Payload",
    "targets": "Targets: what the axis must reach; left out, the defaults hold",
}
WORDS = {
    ("transmission", "kind"): "what moves the load: screw, rack, rotary or linear",
    ("motor", "name"): "type of the motor",
    ("targets", "at"): "where the targets count: motor, carriage or both; what nothing measures is judged as predicted",
    ("targets", "move"): "limits of the move that is judged, a name under trajectories",
}


def commented(axis: Axis) -> str:
    """The text of ``axis.yaml``, every entry with its unit and meaning, those not known commented out.

    Parameters
    ----------
    axis : Axis
        Of any kind, in the words of its kind.
    """
    lines = ["# SI units, the unit in each name; what is not known is commented out. Made by `beltcomm init`."]
    lines += [f"name: {_scalar(axis.name)}"]
    own, data = KINDS.get(axis.kind), axis.to_dict()
    sections = own.sections() if own is not None else {name: entries_of(kind) for name, kind in SECTIONS.items()}
    titles = {**TITLES, **(own.titles if own is not None else {})}
    for section, known in sections.items():
        held = data.get(section) if own is not None else getattr(axis, section)
        if held is None and not axis.has_transmission:
            continue
        values = held if isinstance(held, dict) else {} if held is None else vars(held)
        lines += ["", _remarked(f"{section}:", titles[section])]
        names = _names(section) if own is None else _names_of_kind(section, known)
        any_known = False
        for name in names:
            value, unit = values.get(name), unit_of(name)
            entry = known.get(name)
            meaning = entry.meaning if entry is not None else WORDS.get((section, name), "")
            if own is not None and f"{section}.{name}" not in own.renamed:  # what a kind calls otherwise is in its words already
                meaning = terms(axis.kind).said(meaning)
            remark = f"{unit}, {meaning}" if unit else meaning
            if value in (None, ""):
                lines.append(_remarked(f"  # {name}:", remark))
            else:
                any_known = True
                lines.append(_remarked(f"  {name}: {_scalar(value)}", remark))
        if not any_known:  # a section of comments alone would be read as nothing, which a pulley or belt is not
            lines[-len(names) - 1] = _remarked(f"{section}: {{}}" if held is not None else f"# {section}:", titles[section])
        if section == "limits" and axis.trajectories:
            load = "carriage" if own is None else own.load
            lines += ["", _remarked("trajectories:", f"Limits of named reference motions, at the {load}")]
            for name, limits in data["trajectories"].items():
                inner = ", ".join(f"{key}: {_scalar(value)}" for key, value in limits.items())
                lines.append(f"  {_scalar(name)}: {{{inner}}}")
    return "\n".join(lines) + "\n"


def _names(section: str) -> list[str]:
    """Entries of a section of a belt axis, words too, in their order."""
    return [item.name for item in fields(SECTIONS[section])]


def _names_of_kind(section: str, known: Iterable[str]) -> list[str]:
    """Entries of a section of another kind: what is a word and comes first, numbers, other words."""
    words = WORDS_OF.get(section, ())
    return [*(name for name in words if name in ("kind", "name")), *known, *(name for name in words if name not in ("kind", "name"))]


def _remarked(text: str, remark: str) -> str:
    return f"{text:<{COLUMN}} # {remark}" if remark else text


def _scalar(value: Any) -> str:
    """A value as YAML writes it."""
    import yaml

    if isinstance(value, float):
        value = float(value)
    text: str = yaml.safe_dump(value, allow_unicode=True, width=10**6).strip()
    return text.removesuffix("...").strip()


def axis_schema() -> dict[str, Any]:
    """JSON schema of axis.yaml."""
    sections: dict[str, Any] = {"name": {"type": "string", "description": "name of the axis, for plans and reports"}}
    for section, kind in SECTIONS.items():
        sections[section] = {**_object(section, kind), "description": TITLES[section]}
    for own in KINDS.values():
        for section, entries in own.sections().items():
            known = sections.setdefault(section, {"type": ["object", "null"], "additionalProperties": False, "properties": {}})
            known.setdefault("description", own.titles.get(section, TITLES.get(section, section)))
            for key, entry in entries.items():
                known["properties"].setdefault(key, _number(entry, unit_of(key)))
    sections["transmission"]["properties"]["kind"] = {
        "type": "string",
        "description": WORDS["transmission", "kind"],
        "enum": [BELT, *KINDS],
    }
    sections["trajectories"] = {
        "type": "object",
        "description": "limits of named reference motions, at the carriage",
        "additionalProperties": {"anyOf": [_object("", TrajectoryLimits), _turning()]},
    }
    return _schema("beltcomm axis.yaml", {"type": "object", "additionalProperties": False, "properties": sections})


def _turning() -> dict[str, Any]:
    """Limits of a reference motion of a load that turns."""
    entries = KINDS["rotary"].trajectory_entries()
    return {
        "type": ["object", "null"],
        "additionalProperties": False,
        "properties": {name: _number(AxisEntry(entry.meaning, above=0.0), unit_of(name)) for name, entry in entries.items()},
        "required": [*entries],
    }


def _object(section: str, kind: type[Any]) -> dict[str, Any]:
    known = entries_of(kind)
    properties: dict[str, Any] = {}
    for item in fields(kind):
        entry = known.get(item.name)
        if entry is not None:
            properties[item.name] = _number(entry, unit_of(item.name))
        else:
            words: dict[str, Any] = {"type": ["string", "null"], "description": WORDS.get((section, item.name), item.name)}
            properties[item.name] = {**words, "enum": [*AT, None]} if item.name == "at" else words
    needed = [item.name for item in fields(kind) if item.default is MISSING and item.default_factory is MISSING]
    return {
        "type": ["object", "null"],
        "additionalProperties": False,
        "properties": properties,
        **({"required": needed} if needed else {}),
    }


def _number(entry: AxisEntry, unit: str) -> dict[str, Any]:
    found: dict[str, Any] = {
        "type": ["integer" if entry.whole else "number", "null"],
        "description": f"{entry.meaning}{f', {unit}' if unit else ''}",
    }
    if math.isfinite(entry.above):
        found["exclusiveMinimum"] = entry.above
    if math.isfinite(entry.at_least):
        found["minimum"] = entry.at_least
    if math.isfinite(entry.at_most):
        found["maximum"] = entry.at_most
    return found


def _schema(title: str, body: dict[str, Any]) -> dict[str, Any]:
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": title, **body}
