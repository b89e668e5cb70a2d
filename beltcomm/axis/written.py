"""``axis.yaml`` for people: every entry with its unit and meaning, what is not known commented out; and its JSON schema for editors."""

from __future__ import annotations

import math
from dataclasses import MISSING, fields
from typing import Any

from beltcomm.axis import Axis
from beltcomm.axis.entries import AT, SECTIONS, AxisEntry, TrajectoryLimits, entries_of
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
    ("motor", "name"): "type of the motor",
    ("targets", "at"): "where the targets count: motor, carriage or both; what nothing measures is judged as predicted",
    ("targets", "move"): "limits of the move that is judged, a name under trajectories",
}


def commented(axis: Axis, source: str = "") -> str:
    """The text of a file.

    Parameters
    ----------
    source : str
        A line on where the numbers are from.
    """
    lines = ["# SI units, the unit in each name; what is not known is commented out. Made by `beltcomm init`."]
    lines += [f"# {source}"] if source else []
    lines += [f"name: {_scalar(axis.name)}"]
    for section, kind in SECTIONS.items():
        held = getattr(axis, section)
        if held is None and not axis.has_transmission:
            continue
        lines += ["", _remarked(f"{section}:", TITLES[section])]
        known = entries_of(kind)
        any_known = False
        for item in fields(kind):
            value = None if held is None else getattr(held, item.name)
            entry, unit = known.get(item.name), unit_of(item.name)
            meaning = entry.meaning if entry is not None else WORDS.get((section, item.name), "")
            remark = f"{unit}, {meaning}" if unit else meaning
            if value in (None, ""):
                lines.append(_remarked(f"  # {item.name}:", remark))
            else:
                any_known = True
                lines.append(_remarked(f"  {item.name}: {_scalar(value)}", remark))
        if not any_known:  # a section of comments alone would be read as nothing, which a pulley or belt is not
            lines[-len(fields(kind)) - 1] = _remarked(f"{section}: {{}}" if held is not None else f"# {section}:", TITLES[section])
        if section == "limits" and axis.trajectories:
            lines += ["", _remarked("trajectories:", "Limits of named reference motions, at the carriage")]
            for name, limits in axis.trajectories.items():
                inner = ", ".join(f"{one.name}: {_scalar(getattr(limits, one.name))}" for one in fields(limits))
                lines.append(f"  {_scalar(name)}: {{{inner}}}")
    return "\n".join(lines) + "\n"


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
    sections["trajectories"] = {
        "type": "object",
        "description": "limits of named reference motions, at the carriage",
        "additionalProperties": _object("", TrajectoryLimits),
    }
    return _schema("beltcomm axis.yaml", {"type": "object", "additionalProperties": False, "properties": sections})


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
