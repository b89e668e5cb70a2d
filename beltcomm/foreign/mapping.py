"""Mapping of a column as the user states it: ``torque_nm=Iq*0.65`` reads "our torque_nm is their Iq times 0.65".

    ours = [-][factor*]theirs {*factor | /number} [+offset | -offset]

A factor is a number, a unit of the quantity (``position_rad=angle*deg``, ``t_s=time*ms``) or both (``t_s=tick*0.1ms``).  Units of other
quantities may stand there where all of them together make the column's: a feed constant of 60 mm per turn, ``position_rad=x*mm*rev/60mm``,
a lead of 10 mm, ``force_n=M*nm*rev/10mm``.
An offset is added after scaling, in SI or with its unit.  A name that holds ``*``, ``/``, ``+`` or ``-`` is taken as it stands
in the file; quotation marks around a name do no harm.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from beltcomm.configfiles import did_you_mean, without_halves
from beltcomm.errors import UsageError
from beltcomm.foreign.table import Table
from beltcomm.quantities import UNITS, in_other_unit, parse_quantity, plain_spelling, suffix_of, unit_of
from beltcomm.recording.columns import KNOWN_COLUMNS

#: What units are made of; an angle is a number.
_DIMENSIONS: Mapping[str, Mapping[str, int]] = {
    "m": {"m": 1}, "rad": {}, "s": {"s": 1}, "a": {"a": 1}, "n": {"n": 1}, "nm": {"n": 1, "m": 1}, "m_s": {"m": 1, "s": -1},
    "rad_s": {"s": -1}, "nm_a": {"n": 1, "m": 1, "a": -1}, "kg": {"kg": 1}, "m_s2": {"m": 1, "s": -2},
}  # fmt: skip
_NUMBER = re.compile(r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


@dataclass(frozen=True)
class Source:
    """Origin of one of our columns:  ours = scale · theirs + offset.

    Attributes
    ----------
    column : str
        Our name.
    theirs : str
        The name in the foreign file.
    scale, offset : float
        To SI.
    written : str
        As the user wrote it.
    scaled : bool
        Whether any factor was written.
    """

    column: str
    theirs: str
    scale: float = 1.0
    offset: float = 0.0
    written: str = ""
    scaled: bool = False


def sources_for(table: Table, written: Sequence[str]) -> dict[str, Source]:
    """Origin of each column: what the user wrote, then columns of the file that already have one of our names.

    Parameters
    ----------
    table : Table
    written : sequence of str
        One ``column=name*scale`` each.

    Raises
    ------
    UsageError
        For text that is no such mapping, an unknown name on either side, a column mapped twice, or a unit stated in the file that the
        mapping forgets.
    """
    sources: dict[str, Source] = {}
    for text in written:
        source = parse_source(text, table)
        if source.column in sources:
            raise UsageError(f"--map {text}: {source.column} is already {sources[source.column].written}; map each column once")
        _check_stated_unit(text, source, table)
        sources[source.column] = source
    for name in KNOWN_COLUMNS:
        if name in table.columns and name not in sources:
            sources[name] = Source(name, name, written=name)
    return sources


def parse_source(text: str, table: Table) -> Source:
    """One mapping, its name found in the table.

    Parameters
    ----------
    text : str
        ``OURS=THEIRS*SCALE``.
    table : Table

    Raises
    ------
    UsageError
        For one that is none.
    """
    column, equals, expression = (part.strip() for part in text.partition("="))
    if not equals or not expression:
        raise UsageError(f"--map {text} is no mapping; write OURS=THEIRS*SCALE, such as torque_nm=Iq*0.65")
    if column not in KNOWN_COLUMNS:
        raise UsageError(f"--map {text}: {_no_column_of_ours(column, expression)}")
    for theirs, before, rest in _readings(expression, table):
        factors = _factors(before, rest, column)
        if factors is not None:
            scale, offset, scaled = factors
            return Source(column, theirs, scale, offset, expression, scaled)
    raise UsageError(f"--map {text}: {_not_understood(expression, column, table)}")


def _readings(expression: str, table: Table) -> Iterator[tuple[str, str, str]]:
    """Every way in which a column's name stands in the expression: (column, text before, text behind); longest names first."""
    names = {spelled: name for name in table.columns for spelled in (Table.bare(name), name) if table.find(spelled) == name}
    names |= {f"c{i}": name for i, name in enumerate(table.columns, start=1) if table.find(f"c{i}") == name}
    spelled_names = sorted(names | {f'"{name}"': column for name, column in names.items()}, key=len, reverse=True)
    lowered = expression.lower()
    for spelled in spelled_names:
        at = lowered.find(spelled.lower())
        while at >= 0:
            seen = expression[at : at + len(spelled)]
            found = table.find(seen[1:-1] if spelled not in names else seen)  # with quotation marks around it, or without
            if found is not None:
                yield found, expression[:at].strip(), expression[at + len(spelled) :].strip()
            at = lowered.find(spelled.lower(), at + 1)


def _factors(before: str, rest: str, column: str) -> tuple[float, float, bool] | None:
    """Scale, offset and whether a factor was written; None when the text around the name is no arithmetic."""
    scale, offset, scaled = 1.0, 0.0, False
    units: list[tuple[str, int]] = []
    if before.startswith("-"):
        scale, before = -1.0, before[1:].strip()
    if before:
        if not before.endswith("*"):
            return None
        found = _quantity(before[:-1].strip(), column)
        if found is None or found[1]:
            return None
        scale, scaled = scale * found[0], True
        units.append((found[2], 1))
    while rest:
        operator = rest[0]
        if operator not in "*/+-":
            return None
        found = _quantity(rest[1:].strip(), column)
        if found is None or (operator == "/" and found[0] == 0.0):
            return None
        value, rest, unit = found
        units += [(unit, 1 if operator == "*" else -1)] * (operator in "*/")
        if operator in "+-" and unit and unit != suffix_of(column):
            return None
        if operator == "*":
            scale, scaled = scale * value, True
        elif operator == "/":
            scale, scaled = scale / value, True
        elif rest:  # the offset comes last
            return None
        else:
            offset = value if operator == "+" else -value
    return (scale, offset, scaled) if _make_one(units, column) else None


def _make_one(units: Sequence[tuple[str, int]], column: str) -> bool:
    """True if the units of all factors make that of the column; numbers alone may make anything.   units : suffix, and 1 or -1."""
    written = [(suffix, sign) for suffix, sign in units if suffix]
    total = Counter[str]()
    for suffix, sign in written:
        for base, power in _DIMENSIONS.get(suffix, {suffix: 1}).items():
            total[base] += sign * power
    own = suffix_of(column)
    wanted = _DIMENSIONS.get(own, {own: 1})
    return not written or {base: power for base, power in total.items() if power} == wanted


def _quantity(text: str, column: str) -> tuple[float, str, str] | None:
    """Value in SI of the number, unit, or number with unit at the beginning, the rest of the text, the unit's suffix; None for neither."""
    sign = -1.0 if text.startswith("-") else 1.0
    text = text[1:].strip() if sign < 0.0 else text
    # a unit may begin with a number itself: 1/min
    match = None if _unit_at(text, column)[0] else _NUMBER.match(text)
    value, rest = (float(match[0]), text[match.end() :].strip()) if match else (1.0, text)
    unit, suffix = _unit_at(rest, column)
    if not match and not unit:
        return None
    if unit:
        value, rest = value * parse_quantity(f"1 {unit}", f"x_{suffix}"), rest[len(unit) :].strip()
    return sign * value, rest, suffix


def _unit_at(text: str, column: str) -> tuple[str, str]:
    """The longest unit of the column's quantity that the text begins with, of another one where there is none, and its suffix; "" for
    none."""
    plain = text.lower().replace("µ", "u").replace("μ", "u")
    own = suffix_of(column)
    for suffix in (own, *(other for other in _DIMENSIONS if other != own)):
        for unit in sorted(UNITS[suffix].others if suffix else (), key=len, reverse=True):
            behind = plain[len(unit) : len(unit) + 1]
            if plain.startswith(unit) and not (behind.isalnum() or behind == "_"):
                return text[: len(unit)], suffix
    return "", ""


def _check_stated_unit(text: str, source: Source, table: Table) -> None:
    """Raise UsageError when the file states a unit that is not ours and no factor was written."""
    stated = table.unit(source.theirs)
    suffix = suffix_of(source.column)
    if not suffix or source.scaled:
        return
    ending = source.theirs.rpartition("_")[2].lower()
    if not stated and len(ending) > 1 and ending in UNITS[suffix].others:  # one letter is an index more often than a unit
        stated = ending
    if not stated:
        return
    plain = plain_spelling(stated).lower()
    head, bare = f"--map {text}: {source.theirs!r} is in {stated} by the file itself", Table.bare(source.theirs)
    if plain in UNITS[suffix].others:
        if UNITS[suffix].others[plain] != 1.0:
            raise UsageError(f"{head}; write {source.column}={bare}*{stated}, or *1 if the file is wrong")
    elif any(plain in unit.others for unit in UNITS.values()):
        raise UsageError(
            f"{head}, and {source.column} in {unit_of(source.column)}; write the factor between them, "
            f"such as {source.column}={bare}*0.65, or map it to a column of its own quantity"
        )


def _no_column_of_ours(column: str, expression: str) -> str:
    theirs_first = re.split(r"[*/+-]", expression)[0].strip()
    if theirs_first in KNOWN_COLUMNS:
        return f"our column stands on the left: write --map {theirs_first}={column}{expression[len(theirs_first) :]}"
    for name in KNOWN_COLUMNS:
        factor = in_other_unit(column, name)
        if factor is not None:
            return f"columns here are in SI, so it is {name}; write --map {name}={expression}*{factor:.6g}"
    return f"there is no column {column!r} in a recording{did_you_mean(column, KNOWN_COLUMNS)}; there are {', '.join(KNOWN_COLUMNS)}"


def _not_understood(expression: str, column: str, table: Table) -> str:
    plain = expression.strip().strip('"').lstrip("-").strip()
    spelled = [name for column in table.columns for name in (column, Table.bare(column))]
    known = [name for name in spelled if re.match(re.escape(name) + r"(?!\w)", plain, re.I) and table.find(plain[: len(name)])]
    if not known:
        return table.no_such_column(re.split(r"[*/+]", plain)[0].strip())
    name = max(known, key=len)
    suffix = suffix_of(column)
    units = f" or a unit ({', '.join(unit.replace(' ', '') for unit in UNITS[suffix].spellings)})" if suffix else ""
    if suffix == "rad" and re.search(r"\*\s*(u|m|c)?m\b", plain):
        units += f", or a way with the way per turn, {column}={name}*mm*rev/60mm for 60 mm"
    decimal = "; write the decimal point as '.'" if re.search(r"\d,\d", expression) else ""
    return f"{plain[len(name) :].strip()!r} behind {name!r} is not understood: *, / and a number{units}, then + or - an offset{decimal}"


def kept_columns(table: Table, names: Sequence[str], sources: Mapping[str, Source]) -> dict[str, str]:
    """Further columns to keep under their own name: our name -> theirs.

    Parameters
    ----------
    table : Table
    names : sequence of str
        As the user wrote them, or "all".
    sources : mapping of str to Source
        By column of ours.

    Raises
    ------
    UsageError
        For an unknown name.
    """
    used = {source.theirs for source in sources.values()}
    wanted = [name for name in table.columns if name not in used] if list(names) == ["all"] else list(names)
    kept = {}
    for name in wanted:
        found = table.find(name)
        if found is None:
            raise UsageError(f"--keep {name}: {table.no_such_column(name)}")
        plain = " ".join(without_halves(found).split()) or f"c{list(table.columns).index(found) + 1}"
        kept[plain if plain not in KNOWN_COLUMNS else f"{plain} (as found)"] = found
    return kept
