"""Every field of a drive profile: what is to be given, in words.  A file is held against it before anything else is made of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from beltcomm.configfiles import did_you_mean, is_number
from beltcomm.drive.objects import TYPES
from beltcomm.drive.parameters import GAIN_NAMES, PREFILTER_KINDS
from beltcomm_adapters.units import named

#: What is known of an entry: it stands in the source, follows from it, is recalled, nobody knows, or is what the virtual drive does.
CONFIDENCES: Final = ("read", "inferred", "recalled", "unknown", "simulated")
#: Modes of CiA 402 by kind of motion: those whose setpoints are sent.
MODES: Final[Mapping[str, tuple[int, ...]]] = {"torque": (4, 10), "position": (7, 8), "velocity": (3, 9), "profile": (1,)}
Path = tuple[str, ...]


@dataclass(frozen=True)
class FieldValue:
    """A single value.

    Attributes
    ----------
    give : str
        What is to be given, in words.
    fits : callable
        Whether a value is that.
    shape : Mapping[str, Any]
        In JSON Schema.
    """

    give: str
    fits: Callable[[Any], bool]
    shape: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class FieldGroup:
    """A mapping.

    Attributes
    ----------
    fields : Mapping[str, Any]
        By key, "*" for any.
    needed : tuple of str
        Keys that must be there.
    """

    fields: Mapping[str, Any]
    needed: tuple[str, ...] = ()


@dataclass(frozen=True)
class FieldRows:
    """A list.

    Attributes
    ----------
    row : FieldGroup
        Each of its entries.
    """

    row: FieldGroup


def _word(give: str) -> FieldValue:
    return FieldValue(give, lambda value: isinstance(value, str) and bool(value.strip()), {"type": "string"})


def _number(give: str, least: float, most: float) -> FieldValue:
    shape = {"type": "number", "minimum": least, "maximum": most}
    return FieldValue(f"{give}, {least:g} to {most:g}", lambda v: is_number(v) and least <= float(v) <= most, shape)


def _whole(give: str, least: int, most: int) -> FieldValue:
    span = f"{least:X}h to {most:X}h" if most > 9999 else f"{least} to {most}"
    shape = {"type": "integer", "minimum": least, "maximum": most}
    return FieldValue(f"{give}, {span}", lambda v: isinstance(v, int) and not isinstance(v, bool) and least <= v <= most, shape)


def _unit(per: int, example: str) -> FieldValue:
    def fits(value: Any) -> bool:
        try:
            return isinstance(value, str) and bool(named(value, per))
        except ValueError:
            return False

    return FieldValue(f"a number and a unit, such as {example}", fits, {"type": "string"})


def _choice(*words: str) -> FieldValue:
    return FieldValue(f"one of {', '.join(words)}", lambda value: value in words, {"enum": list(words)})


def _modes(kind: str) -> FieldValue:
    known = MODES[kind]
    words = f"mode {' or '.join(map(str, known))} of CiA 402, or a list of them, the best first"
    return FieldValue(words, lambda v: bool(v) and all(isinstance(m, int) and m in known for m in (v if isinstance(v, list) else [v])))


_YES: Final = FieldValue("true or false", lambda value: isinstance(value, bool), {"type": "boolean"})
_INDEX, _SUBINDEX = _whole("an index of the object dictionary", 0x1000, 0xFFFF), _whole("a subindex", 0, 0xFF)
_PLACE: Final = {"index": _INDEX, "subindex": _SUBINDEX}
_BIT: Final = _whole("a bit", 0, 31)
_TYPE: Final = _choice(*TYPES)
_SOURCE: Final = {"source": _word("where it is from, a text"), "confidence": _choice(*CONFIDENCES)}
_LOCK: Final = FieldGroup(
    {"index": _INDEX, "first": _INDEX, "last": _INDEX, "subindex": _SUBINDEX, "what": _word("what it holds, a text"), **_SOURCE},
    ("what", *_SOURCE),
)
_GAIN: Final = FieldGroup(
    {
        **_PLACE, "type": _TYPE, "scale": _number("SI at the motor shaft of one raw unit", 1e-30, 1e30),
        "lowest": _number("the smallest raw value", -1e12, 1e12), "highest": _number("the largest raw value", -1e12, 1e12),
        "law": _choice("linear", "integral_time"),
    },
    ("index", "subindex", "type"),
)  # fmt: skip
_TERM: Final = FieldGroup(
    {
        "place": _word("object or name in the maker's tool"), "what": _word("what it does"), "missing": _word("what is not known of it"),
        "parameter": _choice(*GAIN_NAMES, "integral_time_s"), "unit": _word("the unit that the tool shows"),
        "scale": _number("SI at the motor shaft of one such unit", 1e-30, 1e30), "current": _YES, **_SOURCE,
    },
    ("place", "what", *_SOURCE),
)  # fmt: skip

#: The whole file.
PROFILE: Final = FieldGroup(
    {
        "name": _word("a short name"),
        "title": _word("maker and series"),
        "like": _word("the name of a shipped profile whose entries hold where this file has none; cia402 when left out"),
        "match": FieldValue("null, or a mapping of vendor_id, product_code and device_names (a list)", lambda v: v is None or _matches(v)),
        "modes": FieldGroup({kind: _modes(kind) for kind in MODES}),
        "supported_modes": FieldValue(
            "a list of modes of CiA 402", lambda v: isinstance(v, list) and all(isinstance(m, int) and 0 <= m <= 10 for m in v)
        ),
        "units": _choice("cia402", "factor_group"),
        "position_unit": _unit(0, "1 counts, 0.1 deg, 1 um"),
        "velocity_unit": _unit(1, "rpm, 0.1 rpm, 10 counts/s"),
        "acceleration_unit": _unit(2, "rpm/s, 10 counts/s2, ms to 3000 rpm"),
        "rated_torque_unit_nm": _number("N m in one unit of 6076h", 1e-9, 1e3),
        "offsets": _YES,
        "guarding": _choice("heartbeat", "node_guarding"),
        "torque_sampling": _choice("over", "after"),
        "torque_scale": FieldGroup(
            {
                "of": _choice("rated_torque", "rated_current", "drive_peak", "unknown"), "check": _word("what tells whether it is right"),
                "nm": _number("N m that a thousand units are, where it is not the rated torque", 1e-6, 1e6),
            },
            ("of", "check"),
        ),
        "actual_torque": FieldGroup(
            {
                **_PLACE, "type": _choice("int16", "int32"), "nm": _number("N m in one of its units", 1e-9, 1e3),
                "late_ms": _number("ms by which it is older than the position beside it", 0.0, 100.0),
                "filter_ms": _number("ms, time constant of its filter", 0.0, 1000.0), "command": _YES,
            }
        ),
        "error_behaviour": FieldGroup(
            {"node": _whole("1029h:1: it leaves Operational, or stays", 0, 1), "axis": _whole("6007h: fault, no voltage, quick stop", 1, 3)}
        ),
        "save": FieldGroup(
            {
                **_PLACE, "type": _TYPE, "value": _whole("a value", 0, 0xFFFFFFFF),
                "seconds": _number("s that it may take", 0.1, 120.0),
            }
        ),
        "homing": FieldGroup({"method": _whole("6098h", -128, 127)}, ("method",)),
        "sync": FieldGroup(
            {
                "shortest_ms": _number("ms", 0.05, 100.0), "step_ms": _number("ms", 0.05, 100.0),
                "change": _choice("at_once", "after_reset"),
            }
        ),
        "structure": FieldGroup(
            {
                "prefilters": FieldValue(
                    f"a list of some of {', '.join(PREFILTER_KINDS)}",
                    lambda v: isinstance(v, list) and bool(v) and all(kind in PREFILTER_KINDS for kind in v),
                ),
                **{part: _YES for part in ("velocity_feedforward", "torque_feedforward", "reference_filter", "roll_off")},
            }
        ),
        "gain_meaning": _choice("documented", "unconfirmed", "none"),
        "parameters": FieldGroup({name: _GAIN for name in GAIN_NAMES}),
        "known_gains": FieldRows(_TERM),
        "never_write": FieldRows(_LOCK),
        "enable_logic": FieldGroup({**_PLACE, "type": _TYPE, "value": _whole("a value", 0, 0xFFFFFFFF)}, (*_PLACE, "type", "value")),
        "torque_slope_permille_s": _whole("6087h", 1, 0xFFFFFFFF),
        "torque_exit": _choice("quick_stop", "velocity"),
        "following_error": _choice("stops", "reported", "unknown"),
        "torque_limit_lowest_permille": _number("thousandths of rated torque", 0, 1000),
        "referenced": FieldGroup({**_PLACE, "bit": _BIT}, (*_PLACE, "bit")),
        **{name: FieldGroup(_PLACE, tuple(_PLACE)) for name in ("loop_period", "overload_time", "output_limit", "dead_zone")},
        "emergency": FieldValue(
            "a mapping of EMCY codes to texts",
            lambda v: isinstance(v, dict) and all(isinstance(k, int) and 0 <= k <= 0xFFFF and isinstance(t, str) for k, t in v.items()),
        ),
        "signals": FieldGroup({"*": FieldGroup({**_PLACE, "bit": _BIT, "bits": FieldGroup({"*": _BIT})}, ("index",))}),
        "bus": _word("canopen, or what it has in its place"),
        "sources": FieldGroup({"*": FieldGroup(_SOURCE, tuple(_SOURCE))}),
    },
    ("name", "title"),
)  # fmt: skip


def _matches(value: object) -> bool:
    if not isinstance(value, dict) or set(value) - {"vendor_id", "product_code", "device_names"}:
        return False
    numbers = [value[key] for key in ("vendor_id", "product_code") if key in value]
    names = value.get("device_names", [])
    whole = all(isinstance(n, int) and 0 <= n <= 0xFFFFFFFF for n in numbers)
    return whole and isinstance(names, list) and all(isinstance(name, str) and name for name in names)


def faults(raw: object, group: FieldGroup = PROFILE, path: Path = ()) -> Iterator[tuple[Path, str]]:
    """Faults of a file, with a sentence each, from the outermost field in.

    Parameters
    ----------
    raw : object
        Content of the file.
    group : FieldGroup
        Fields that it may have.
    path : Path
        Keys that lead to it.

    Yields
    ------
    tuple of Path and str
        Keys that lead there, and a sentence.
    """
    where = ".".join(path)
    if not isinstance(raw, Mapping):
        yield path, f"{where} is {_shown(raw)}; give a mapping of {', '.join(group.fields)}"
        return
    for key in group.needed:
        if key not in raw:
            yield path, f"{'.'.join((*path, key))} is missing; give {_give(group.fields[key])}"
    for key, value in raw.items():
        node = group.fields.get(str(key), group.fields.get("*"))
        here = (*path, str(key))
        name = ".".join(here)
        if node is None:
            yield here, f"{name} is no field of a profile{did_you_mean(str(key), group.fields)}"
        elif isinstance(node, FieldGroup):
            yield from faults(value, node, here)
        elif isinstance(node, FieldRows):
            if not isinstance(value, list):
                yield here, f"{name} is {_shown(value)}; give a list"
                continue
            for number, row in enumerate(value, start=1):
                for _, sentence in faults(row, node.row, (*path, f"{key}[{number}]")):
                    yield here, sentence
        elif not node.fits(value):
            yield here, f"{name} is {_shown(value)}; give {node.give}"


def json_schema(node: Any = PROFILE) -> dict[str, Any]:
    """JSON Schema of a profile, for editors that know it; what it cannot say stands in its descriptions.

    Parameters
    ----------
    node : Any
        Group, rows or value.
    """
    if isinstance(node, FieldValue):
        return {**node.shape, "description": node.give}
    if isinstance(node, FieldRows):
        return {"type": "array", "items": json_schema(node.row)}
    named = {key: json_schema(one) for key, one in node.fields.items() if key != "*"}
    found: dict[str, Any] = {"type": "object", "properties": named, "required": list(node.needed)}
    found["additionalProperties"] = json_schema(node.fields["*"]) if "*" in node.fields else False
    if node is PROFILE:
        found = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "beltcomm drive profile", **found}
    return found


def _give(node: Any) -> str:
    return (
        node.give
        if isinstance(node, FieldValue)
        else "it as a list"
        if isinstance(node, FieldRows)
        else f"a mapping of {', '.join(node.fields)}"
    )


def _shown(value: object) -> str:
    return "empty" if value is None else repr(value)[:60]
