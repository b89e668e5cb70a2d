"""Contents of the files that the tool keeps in a run: the types of what commands read of them.

One door: whoever opens such a file asks :func:`check_content`, and behind it no value is looked at again for what type it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from beltcomm.errors import DataError

#: No quantity of an axis is larger, and its square is still a number.
LARGEST = 1e100
#: Letters of a value that are shown.
SHOWN = 40


@dataclass(frozen=True)
class Size:
    """A number that cannot be below zero.   above : nor zero, nor no number.   whole : of int.   most : the largest."""

    above: bool = False
    whole: bool = False
    most: float = math.inf


# A type is float, int, str, bool or object (any value), SIZE or POSITIVE; [T] a list, (T, T) a list of this length, {str: T} names to
# values, a set of words one of them; else names to types.  A name with "*" may be missing, with "?" also be null.  Further
# names may stand beside them, but not where "" is one.
SIZE, POSITIVE, COUNT, GAIN = Size(), Size(above=True), Size(above=True, whole=True), Size(above=True, most=1e3)
_ERROR = {"dynamic_m": SIZE, "static_m": SIZE}
_HASHES = {"gains?": str, "model?": str}
_TARGETS = {
    **dict.fromkeys(("following_error_m?", "settled_error_m?", "settled_after_s?", "distance_m?"), SIZE),
    **dict.fromkeys(("at?", "move?"), str),
}
_DRIVEN = {
    **{"gains?": {str: float}, "further_payloads_kg?": [SIZE], "path?": (float, float, float), "led_by?": str},
    "limits?": dict.fromkeys(("speed_m_s", "acceleration_m_s2", "jerk_m_s3"), SIZE),
}
_STRUCTURE: dict[str, Any] = {
    "": None,
    "name": str,
    "period_s": POSITIVE,
    "prefilters": [frozenset(("none", "notch", "butterworth"))],  # beltcomm.control.PrefilterKind, which knows this module from above
    **dict.fromkeys(("velocity_feedforward*", "torque_feedforward*", "reference_filter*", "anti_windup*", "roll_off*"), bool),
    **{name: {str: float} for name in ("steps*", "lowest*", "highest*")},
    **dict.fromkeys(("output_limit_rad_s*", "dead_zone_rad*"), SIZE),
}
_PLACE = {
    **{"": None, "index": int, "subindex": int, "type": str, "scale*": float, "lowest?": int, "highest?": int},
    "law*": frozenset(("linear", "integral_time")),
}
_TERM: dict[str, Any] = {
    "": None,
    "place": str,
    "what": str,
    "scale*": float,
    "current*": bool,
    **dict.fromkeys(("missing*", "parameter*", "unit*"), str),
}
_RATINGS = {"peak_torque_nm?": POSITIVE, "max_speed_rad_s?": POSITIVE}
_MARGINS = {"plant": str} | dict.fromkeys(
    (
        *("phase_margin_deg", "gain_margin_db", "suppression_db", "sensitivity_db"),
        *("position_phase_margin_deg", "position_sensitivity_db"),
    ),
    float,
)
_SPECIFICATION = dict.fromkeys(
    (
        *("phase_margin_deg", "suppression_db*", "gain_margin_db*", "sensitivity_db*"),
        *("position_phase_margin_deg*", "notch_db*", "butterworth_db*"),
    ),
    float,
) | {"": None, "velocity_filters_s*": [SIZE], "prefilters?": [str]}
_KNOWN = {"value": float, "interval?": SIZE, "unit?": str}
_LAGS = [{"kind": str, "values": [SIZE], "intervals": [SIZE]}]
_TORQUE_PATH: dict[str, Any] = {
    "drive?": {"delay": SIZE, "delay_interval": SIZE, "gain": GAIN, "lags": _LAGS},
    "reading": {"late": float, "lags": _LAGS, "at_end?": bool},
    "commanded": bool,
    "acts": float,
    "unseen?": bool,
    "instantaneous?": bool,
    "process?": dict.fromkeys(("rms_nm", "time_s", "rms_interval", "time_interval"), SIZE),
}
_TORQUE_PATH["rivals"] = [_TORQUE_PATH]
_PLAIN = {"": None, "error": SIZE, "noise": SIZE, "torque": SIZE, "percent": SIZE, "unit": str, "band_hz": SIZE}
_COST = {
    **{"of": str, "move": str, "unaware": _ERROR, "aware": _ERROR, "unaware_cart": _ERROR, "aware_cart": _ERROR},
    **{"unaware_range?": (_ERROR, _ERROR), "aware_range?": (_ERROR, _ERROR), "unaware_margins?": str},
}
_REVISION = {
    **{"": None, **dict.fromkeys(("name", "parent", "change", "command", "when"), str)},
    **{"effects": [str], "data": {str: str}, "ratio": SIZE, "held_out?": SIZE, "confirmed?": bool},
    **{"cost?": _COST, "plain?": _PLAIN, "plain_held_out?": _PLAIN},
    **{"bands?": [_PLAIN], "bands_held_out?": [_PLAIN]},
}
_EXPERIMENT = {"title": str, "rms_nm?": SIZE} | dict.fromkeys(
    ("travel_m", "reach_m", "speed_m_s", "torque_nm", "belt_force_n", "seconds"), SIZE
)
_UNIT = {"unit": float, "interval": SIZE, "assumed": float, "object": str}

#: By what a file is: ``run.yaml``, one of designs, or a result by its name without its number.  Results that no command reads are not here.
TYPES: Mapping[str, Any] = {
    "backup": {
        **{"parameters": {str: float}, "drive?": {str: str}, "before?": str},
        "objects?": [{"object": str, "type": str, "raw": float, "name?": str, "value?": float}],
    },
    "breakaway": {"coulomb_nm": SIZE},
    "calibration": {"kind": str, "rated_torque_nm": POSITIVE, "rated_current_a": POSITIVE, "units": {str: _UNIT}},
    "designs": {
        **{"parameters": {str: float}, "dead_time_s": SIZE, "apparent_damping_nm_s_rad?": float, "structure": _STRUCTURE},
        **{"specification": _SPECIFICATION, "margins": [_MARGINS], "revision?": str, "verified?": _HASHES},
        **{"compensated?": [str], "binding?": [str], "remarks?": [str], "proof?": {"doubts?": [str]}},
    },
    "diagnosis": {"named?": [str], "after?": {"effects": [str], "parameters": {str: _KNOWN}}},
    "drive": {
        **{"structure": _STRUCTURE, "counts_per_rev": COUNT, "peak_torque_nm": POSITIVE, "begun_with?": _RATINGS},
        **dict.fromkeys(("max_speed_rad_s?", "rated_torque_nm?", "rated_current_a?"), POSITIVE),
        **{"name?": str, "identity?": {str: str}, "parameters?": {str: _PLACE}},
        **{"uncalibrated?": [str], "gains?": str, "gain_terms?": [_TERM], "reached_as?": str, "reached_by?": str},
        "torque_reading?": {"late_s?": SIZE, "filter_s?": SIZE, "command?": bool},
        "units?": {str: float},
    },
    "fit": {
        **{
            "misfit?": SIZE,
            "suspect?": bool,
            "free?": [str],
            "remarks?": [str],
            "records?": [str],
            "noted?": [str],
        },
        **{"characteristics?": {str: _KNOWN}, "dead_time?": {"value_s": float, "interval_s?": SIZE}, "torque_path?": _TORQUE_PATH},
    },
    "ladder": {"revisions": [_REVISION]},
    "led_gains": {"kp": POSITIVE, "kpp": POSITIVE, "kp_interval": SIZE, "kpp_interval": SIZE},
    "plan": {
        **{"text": str, "points?": [(str, str)], "experiments": [_EXPERIMENT], "seconds?": SIZE},
        "heat?": {"continuous": SIZE, "fullest": SIZE, "hottest": SIZE, "pauses_s": [SIZE]},
        "thermal?": {"rated_nm": POSITIVE, "peak_nm": POSITIVE, "overload_s": SIZE, "source": str},
    },
    "run.yaml": {"beltcomm?": str, "axis_fingerprint?": str, "drive?": {str: str}, "began_s?": float},
    "verify": {
        **{"passed": bool, "measured": _ERROR, "predicted": _ERROR, "measured_cart?": _ERROR, "predicted_cart?": _ERROR},
        **{"predicted_range?": (_ERROR, _ERROR), "reasons?": [str], "reservations?": [str], "noted?": [str], "targets?": _TARGETS},
        "driven?": {"gains": {str: float}, "sending": str, "time_s": float},
        **{"proof?": _DRIVEN, "verified?": _HASHES, "own_loop?": bool},
    },
}
_WORDS = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}


def check_content(what: str, content: Mapping[str, Any], path: Path) -> None:
    """Check that a file holds what is read of it.

    Parameters
    ----------
    what : str
        A name in :data:`TYPES`, of a result with or without its number; a file of another name may hold anything.
    content : mapping of str to Any
        As it was read.
    path : Path
        Of the file, for the sentence.

    Raises
    ------
    DataError
        With the value and the type it must have.
    """
    if wrong := next(faults(content, TYPES.get(what) or TYPES.get(what.partition("_")[0], object), ""), ""):
        again = "run `beltcomm design` again" if what == "designs" else "bring it back, or delete it and make it again"
        raise DataError(f"{path} is damaged: {wrong}; {again}")


def faults(value: Any, kind: Any, at: str) -> Iterator[str]:
    """Faults of a value against its type, in words, one after the other.

    Parameters
    ----------
    value : Any
    kind : Any
        A type as in :data:`TYPES`.
    at : str
        Where the value stands, "" for the whole.
    """
    if isinstance(kind, Mapping):
        right, must = isinstance(value, Mapping), "a mapping of names to values"
    elif isinstance(kind, (list, tuple)):
        free = isinstance(kind, list)
        right, must = isinstance(value, list) and (free or len(value) == len(kind)), "a list" if free else f"a list of {len(kind)}"
    elif isinstance(kind, frozenset):
        right, must = isinstance(value, str) and value in kind, f"one of {', '.join(sorted(kind))}"
    else:
        bound = kind if isinstance(kind, Size) else None
        kind = (int if bound.whole else float) if bound else kind
        right, must = isinstance(value, (int, float) if kind is float else kind), _WORDS.get(kind, "")
        right = right and (kind in (bool, object) or not isinstance(value, bool))
        if right and kind in (int, float) and not abs(value) <= LARGEST and math.isfinite(value):
            right, must = False, "a quantity of an axis"
        if right and bound and (value < 0 or value > bound.most or (bound.above and not value > 0)):
            right, must = False, ("above 0" if bound.above else "0 or more") + f", at most {bound.most:g}" * math.isfinite(bound.most)
    if not right:
        yield f"{at or 'it'} is {str(value)[:SHOWN]!r}; it must be {must}"
    elif isinstance(kind, (list, tuple)):
        for number, one in enumerate(value):
            yield from faults(one, kind[number % len(kind)], f"{at}[{number + 1}]")
    elif isinstance(kind, Mapping) and str in kind:
        for name, one in value.items():
            yield from faults(name, str, f"a name in {at or 'it'}")
            yield from faults(one, kind[str], f"{at}.{name}")
    elif isinstance(kind, Mapping):
        before = f"{at}." if at else ""
        named = {key.rstrip("?*"): key for key in kind if key}
        for name, key in named.items():
            if name in value and not (value[name] is None and key.endswith("?")):
                yield from faults(value[name], kind[key], f"{before}{name}")
            elif name == key:
                yield f"{before}{name} is missing"
        if "" in kind:
            yield from (f"{before}{name} is known to no command" for name in value if name not in named)
