"""Names of foreign columns and what they mean, and the mappings that a unit, or the numbers themselves, allow."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from typing import Literal

import numpy as np

from beltcomm.axis import Axis
from beltcomm.foreign.spellings import COUNTS, PER_CENT, PER_MILLE, plain_unit
from beltcomm.foreign.table import Table
from beltcomm.quantities import UNITS

Quantity = Literal["time", "torque", "current", "force", "position", "velocity", "temperature"]
Role = Literal["actual", "setpoint", "none"]

#: Words of a name by the quantity that they mean.  A word is a run of letters as in "act_trq", "ActTorque" or "ISTPOSITION"; German
#: compounds are found by their parts.
_WORDS: tuple[tuple[Quantity, str], ...] = (
    ("temperature", r"temp(erature?|eratur)?|celsius"),
    ("time", r"t|ts|tt|tout|time(stamps?)?|zeit(stempel)?|uhrzeit|elapsed|stamp|clock|seconds?|sekunden|millis|micros|temps|tempo|tiempo"),
    ("force", r"force|kraft|vorschubkraft|f|frc|forza|fuerza"),
    ("torque", r"torque|trq|tq|tau|effort|(dreh)?moment|motormoment|mom|m|tor|couple|coppia|par"),
    ("velocity", r"vel|velo|velocity|speed|spd|drehzahl|geschw(indigkeit)?|omega|rpm|v|n|dq|qd|qdot|vitesse|velocita|velocidad"),
    ("current", r"current|curr|cur|strom|motorstrom|i|iq|iqact|isq|ampere|amps?|courant|corrente|corriente"),
    (
        "position",
        r"pos|posn|position|lage|angle|ang|winkel|theta|phi|enc|encoder|geber|counts?|weg|travel|displacement|x|q|rotor|posizione|posicion|"
        r"angolo|angulo|codeur",
    ),
)
_ROLES: tuple[tuple[Role, str], ...] = (
    (
        "setpoint",
        r"soll(wert)?|set|setpoint|setp|sp|cmd|command(ed)?|demand|dem|target|tgt|ref|reference|des(ired)?|vorgabe|sw|consigne|consigna",
    ),
    ("actual", r"act|actual|ist(wert)?|fbk?|feedback|meas(ured)?|mess(wert)?|gemessen|real|iw|value"),
)
#: Second sensors: of the carriage, or on the load side of a rotary drive.
_LOAD = r"cart|carriage|load(side)?|last(seite)?|schlitten|linear|tcp|table|tisch|extern(al)?|second(ary)?|slide|abtrieb"
#: Words that make it another thing than the quantity itself.
_OTHERS = (
    r"err|error|fehler|dev|deviation|abw(eichung)?|lag|schlepp(fehler|abstand)?|limit|lim|max|min|grenz(e|wert)?|offset|status|state|"
    r"mode|gain|kp|ki|kd|flag|valid|quality|window|add|ff|feedforward|vorsteuerung|raw2|cnt|counter|index|no|nr|acc|accel|acceleration|"
    r"beschleunigung|jerk|ruck|id|power|leistung|friction|reibung|voltage|spannung|dc|bus|link|abs(olute)?"
)
#: Compounds in one word: parts that are looked for when no word fits as a whole.
_PARTS: tuple[tuple[Quantity, str], ...] = (
    ("temperature", "temperat"),
    ("torque", "torque|moment(?!um)|trq"),
    ("velocity", "velocity|geschwind|drehzahl|speed"),
    ("current", "current|strom"),
    ("position", "position|winkel|angle|lage|encoder|geber"),
    ("force", "force|kraft"),
    ("time", "timestamp|zeitstempel|zeit"),
)

#: "no" and "nr" count something, unless they number the axis.
_NUMBERED = re.compile(r"(?<![A-Za-z])(no|nr|number|nummer)\.?[_ ]*(?=\d)", re.IGNORECASE)
_COUNTS_OF_BITS = r"counts?(\d{1,2})bit"
#: Positions that are angles: a letter m behind them is the motor's, no metre.
_ANGLES = r"angle|ang|winkel|theta|phi|rotor"
#: Units by the quantity and the suffix of our column.
_SUFFIXES: tuple[tuple[str, Quantity], ...] = (
    ("s", "time"), ("nm", "torque"), ("a", "current"), ("n", "force"), ("rad", "position"), ("m", "position"), ("rad_s", "velocity"),
    ("m_s", "velocity"), ("c", "temperature"),
)  # fmt: skip


#: Objects of CiA 402 by number, as logs and vendors' scopes name them.
_OBJECTS: dict[str, tuple[Quantity, Role, str]] = {
    "6064": ("position", "actual", "counts"),
    "606C": ("velocity", "actual", "counts"),
    "6077": ("torque", "actual", "per mille"),
    "6078": ("current", "actual", "per mille"),
    "6071": ("torque", "setpoint", "per mille"),
    "6074": ("torque", "setpoint", "per mille"),
    "607A": ("position", "setpoint", "counts"),
    "60FF": ("velocity", "setpoint", "counts"),
}


@dataclass(frozen=True)
class Meaning:
    """Quantity and unit that a column seems to hold.

    Attributes
    ----------
    by_name : bool
        Whether its words say the quantity, not the unit alone.
    suffix : str
        Of our columns with that unit ("rad", "m_s"), "" when the unit is not known.
    unit : str
        As a mapping writes it.
    special : str
        "counts", "per cent" or "per mille", which need a data sheet.
    load : bool
        A second sensor.
    """

    name: str
    quantity: Quantity
    role: Role
    by_name: bool
    suffix: str = ""
    unit: str = ""
    special: str = ""
    load: bool = False


def meaning_of(table: Table, name: str) -> Meaning | None:
    """Meaning of a table's column by its name and unit; None when neither says anything, or that it is something else.

    Parameters
    ----------
    table : Table
    name : str
        Of the column.
    """
    stated = plain_unit(table.unit(name))
    number = re.fullmatch(r"(?:0x)?(60[0-9A-F]{2})(?:h|_?h?:0|_0)?", Table.bare(name).strip(), re.I)
    if number and number[1].upper() in _OBJECTS:
        known = _OBJECTS[number[1].upper()]
        return Meaning(name, known[0], known[1], True, special=known[2])
    words, ending = _words(re.sub(r"[_ .]\d+$", "", _NUMBERED.sub(" ", Table.bare(name))))
    if not stated and ending:
        stated = ending
    if any(_fits(word, _OTHERS) or word.endswith(_OTHER_ENDS) for word in words):
        return None
    role = _role(words)
    load = any(_fits(word, _LOAD) or word.startswith(_LOAD_BEGINS) for word in words)
    suffix, by_unit = _suffix(stated)
    by_name = _quantity(words)
    special = "counts" if stated in COUNTS else "per cent" if stated in PER_CENT else "per mille" if stated in PER_MILLE else ""
    if re.fullmatch(_COUNTS_OF_BITS, stated):
        special = "counts"
    if special == "counts" and by_name is None:
        by_name = "position"
    if by_name is None and (by_unit is None or by_unit in {"time", "force"}):
        return None  # "x [s]" and "y [N]" alone are settings as often as signals
    if by_name is not None and by_unit is not None and by_name != by_unit:
        if (by_name, suffix) not in {("torque", "a"), ("velocity", "rad"), ("position", "s")}:
            return Meaning(name, by_unit, role, False, suffix, stated, special, load)
        return None
    quantity = by_name or by_unit
    assert quantity is not None
    return Meaning(name, quantity, role, by_name is not None, suffix, stated if suffix else "", special, load)


def _counts_per_turn(unit: str) -> int | None:
    """Of a unit of counts that states it, as Kollmorgen's ``Counts16Bit``; None for any other."""
    match = re.fullmatch(_COUNTS_OF_BITS, plain_unit(unit))
    return 2 ** int(match[1]) if match else None


def _suffix(unit: str) -> tuple[str, Quantity | None]:
    for suffix, quantity in _SUFFIXES:
        if unit and unit in UNITS[suffix].others:
            return suffix, quantity
    return "", None


def _words(name: str) -> tuple[list[str], str]:
    """The words of a name in small letters, and a unit that ends it ("time_ms"), which is no word then."""
    plain = name.replace("ä", "ae").replace("ö", "oe").replace("ü", "ue").replace("ß", "ss").replace("·", "")
    plain = "".join(c for c in unicodedata.normalize("NFD", plain) if not unicodedata.combining(c))
    behind_in = re.search(r"[_ ]in[_ ]+(\S.*)$", plain)
    if behind_in and (_suffix(plain_unit(behind_in[1]))[0] or plain_unit(behind_in[1]) in COUNTS):
        return _words(plain[: behind_in.start()])[0], plain_unit(behind_in[1])
    plain = re.sub(r"(?<![A-Za-z])([Ii])[_ ]([qQdD])(?![A-Za-z])", r"\1\2", plain)  # i_q is one word
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])|[^A-Za-z°%‰/]+|(?<=[A-Za-z])(?=\d)", " ", plain)
    parts = [word.lower() for word in spaced.split() if word]
    ending = ""
    tail = re.search(r"[_ ]([A-Za-z°%‰]+(?:_s)?)$", plain)
    if tail and len(parts) > 1:
        candidate = plain_unit(tail[1].replace("_s", "/s") if tail[1].endswith("_s") else tail[1])
        if len(candidate) > 1 and (_suffix(candidate)[0] or candidate in COUNTS):
            ending = candidate
            parts = [word for word in parts if word not in tail[1].lower().split("_")]
        elif candidate == "m" and any(_fits(word, _ANGLES) for word in parts):
            parts = parts[:-1]
        elif candidate and _suffix(candidate)[1] == _quantity(parts[:-1]) is not None:  # one letter counts where the name agrees
            ending, parts = candidate, parts[:-1]
    return parts, ending


def _fits(word: str, pattern: str) -> bool:
    return re.fullmatch(pattern, word) is not None


def _quantity(words: list[str]) -> Quantity | None:
    for quantity, pattern in _WORDS:
        if any(len(word) > 1 and _fits(word, pattern) for word in words):
            return quantity
    for quantity, pattern in _PARTS:
        if any(re.search(pattern, word) for word in words):
            return quantity
    if len([word for word in words if not any(_fits(word, role) for _, role in _ROLES)]) == 1:
        return next((quantity for quantity, pattern in _WORDS if any(len(w) == 1 and _fits(w, pattern) for w in words)), None)
    return None


#: Compounds that say that a value was asked for ("sollmoment", "positioncommand").
_SETPOINT_BEGINS = ("soll", "target", "command", "demand", "setpoint", "reference")
_SETPOINT_ENDS = ("soll", "sollwert", "setpoint", "command", "target", "demand", "reference")
#: Compounds that are another thing ("torquelimit", "schleppfehler"), and those of a second sensor ("loadposition", "lastwinkel").
_OTHER_ENDS = ("limit", "fehler", "error", "grenze", "offset", "deviation", "abweichung")
_LOAD_BEGINS = ("load", "carriage", "schlitten", "lastw", "lastp", "lastl", "abtrieb")


def _role(words: list[str]) -> Role:
    """By a word of its own, or as a part of a compound such as "istposition" or "sollmoment"."""
    for role, pattern in _ROLES:
        if any(_fits(word, pattern) for word in words):
            return role
    if any(word.startswith(_SETPOINT_BEGINS) or word.endswith(_SETPOINT_ENDS) for word in words):
        return "setpoint"
    return "actual" if any(word.startswith("ist") or word.endswith(("ist", "istwert", "feedback")) for word in words) else "none"


Confidence = Literal["sure", "likely", "unsure"]
#: A torque column without a unit is N m when its largest value lies between these shares of the motor's peak torque.
_SMALLEST_SHARE, _LARGEST_SHARE = 0.01, 1.1


def by_unit(table: Table, column: str, meaning: Meaning, axis: Axis, ratio: float | None) -> tuple[tuple[str, ...], Confidence, str]:
    """Mappings of one foreign column to ours, by its unit.

    Parameters
    ----------
    table : Table
    column : str
        Of ours.
    meaning : Meaning
        Of theirs.
    axis : Axis
    ratio : float or None, m/rad
        Of the transmission; None where it is not known.

    Returns
    -------
    tuple of tuple of str, Confidence and str
        Mappings, how sure they are, and why.
    """
    name, suffix = meaning.name, meaning.suffix
    own = column.removeprefix("reference_").split("_", 1)[1].removeprefix("setpoint_")
    if suffix == own and meaning.by_name:
        return (spelled(column, name, meaning.unit),), "sure", f"its name, and its unit {meaning.unit} by the file"
    if suffix == own:
        return (spelled(column, name, meaning.unit),), "likely", f"its unit {meaning.unit} alone"
    if suffix == "m" and own == "rad" and ratio is not None:
        why = (
            f"it is in {meaning.unit}: the motor's angle is that over the {ratio:.6g} m/rad of {axis}, if the drive's feed constant is that"
        )
        return (f"{column}={quoted(name)}*{UNITS['m'].others[meaning.unit]:g}/{ratio:.9g}",), "likely", why
    if suffix == "m" and own == "rad":
        why = f"it is in {meaning.unit}, the torque at the motor; a feed constant of 60 mm per revolution is only an example"
        return (f"{column}={quoted(name)}*{meaning.unit}*rev/60mm",), "unsure", why
    if own == "rad" and (stated := _counts_per_turn(table.unit(name))):
        return (f"{column}={quoted(name)}*rev/{stated}",), "sure", f"its unit by the file, {stated} to a turn"
    if meaning.special == "counts" and own == "rad":
        counts = axis.motor.encoder_counts_per_rev or 65536
        known = axis.motor.encoder_counts_per_rev is not None
        why = f"it is in counts, {counts} per revolution {'by the axis file' if known else 'is only an example'}"
        return (f"{column}={quoted(name)}*rev/{counts}",), "likely", why
    if own == "nm" and plain_unit(table.unit(name)) in UNITS["v"].others:
        return (
            (f"{column}={quoted(name)}*1",),
            "likely",
            "it is in volts; 1 N m per volt is only an example, the drive's analogue output has it",
        )
    if meaning.special.startswith("per") and own == "nm":
        rated, share = axis.motor.rated_torque_nm, 100 if meaning.special == "per cent" else 1000
        of = "torque" if meaning.quantity == "torque" else "current, taken as the same share of the rated torque"
        why = f"it is in {meaning.special} of a rated {of}, {'that of the axis file' if rated else '1.0 N m is only an example'}"
        return (f"{column}={quoted(name)}*{rated or 1.0:g}/{share}",), "likely", why
    return without_unit(table, column, meaning, axis, own)


def without_unit(table: Table, column: str, meaning: Meaning, axis: Axis, own: str) -> tuple[tuple[str, ...], Confidence, str]:
    """Units that the numbers allow, for a column that states none.

    Parameters
    ----------
    table : Table
    column : str
        Of ours.
    meaning : Meaning
        Of theirs.
    axis : Axis
    own : str
        Unit of our column, as its suffix has it.

    Returns
    -------
    tuple of tuple of str, Confidence and str
        Mappings, how sure they are, and why.
    """
    values = table.columns[meaning.name]
    known = values[np.isfinite(values)]
    largest = float(np.abs(known).max()) if len(known) else 0.0
    name = quoted(meaning.name)
    if own == "nm":
        rated = axis.motor.rated_torque_nm or 1.0
        choices = [f"{column}={name}*1", f"{column}={name}*{rated:g}/100", f"{column}={name}*{rated:g}/1000", f"{column}={name}*mNm"]
        peak = axis.motor.peak_torque_nm
        fits = [c for c, f in zip(choices, (1.0, rated / 100, rated / 1000, 1e-3), strict=True) if peak and _possible(largest * f, peak)]
        ordered = (*fits, *(c for c in choices if c not in fits))
        return tuple(ordered), "unsure", f"{_unknown(table, meaning.name)}; its largest value is {largest:.4g}"
    if own == "rad":
        span = float(np.ptp(known)) if len(known) else 0.0
        counts = axis.motor.encoder_counts_per_rev or 65536
        whole = bool(np.all(known == np.round(known))) and span > 1000.0
        choices = [f"{column}={name}*1", f"{column}={name}*deg", f"{column}={name}*rev", f"{column}={name}*rev/{counts}"]
        ordered = (choices[3], *choices[:3]) if whole else tuple(choices)
        return ordered, "unsure", f"{_unknown(table, meaning.name)}; it covers {span:.6g}{', in whole numbers' if whole else ''}"
    units = {"rad_s": ("1", "rpm", "deg/s"), "m": ("1", "mm"), "m_s": ("1", "mm/s"), "a": ("1", "ma"), "n": ("1", "kn")}.get(own, ("1",))
    return tuple(f"{column}={name}*{unit}" for unit in units), "unsure", _unknown(table, meaning.name)


def _unknown(table: Table, name: str) -> str:
    unit = table.unit(name)
    return f"its unit {unit!r} is not known for it, write the factor" if unit else "its unit is not stated"


def _possible(largest: float, peak: float) -> bool:
    return _SMALLEST_SHARE * peak <= largest <= _LARGEST_SHARE * peak


def spelled(column: str, name: str, unit: str) -> str:
    """A mapping as a user writes it.

    Parameters
    ----------
    column : str
        Of ours.
    name : str
        Of theirs.
    unit : str
        "" for none.
    """
    return f"{column}={quoted(name)}{f'*{unit}' if unit else ''}"


def quoted(name: str) -> str:
    """A foreign name as it stands in a mapping.

    Parameters
    ----------
    name : str
        Of theirs.
    """
    bare = Table.bare(name)
    return f'"{name}"' if bare != name or not name.replace("_", "").isalnum() else name
