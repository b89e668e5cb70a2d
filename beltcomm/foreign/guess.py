"""Guesses which column of a foreign table is which of ours, how sure that is, and what to ask where it is not.

A guess is **sure** when one column alone has the name of the quantity and a unit of it; such guesses are taken and said.  Everything else
is asked: at a terminal, or by a file of mappings that is edited and given back.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from beltcomm.axis import Axis
from beltcomm.errors import DataError, Refused, UsageError
from beltcomm.foreign.daystamps import are_days
from beltcomm.foreign.mapping import Source, parse_source, sources_for
from beltcomm.foreign.names import Confidence, Meaning, by_unit, meaning_of, quoted, spelled, without_unit
from beltcomm.foreign.relations import relations
from beltcomm.foreign.spellings import plain_unit
from beltcomm.foreign.table import Table
from beltcomm.quantities import UNITS
from beltcomm.recording.columns import CHANNELS, KNOWN_COLUMNS, Side

#: s between rows that a drive or logger has: what a time column without a unit is held against.
_SHORTEST_STEP_S, _LONGEST_STEP_S = 2e-5, 0.05
#: Letters of a cell that are shown.
SHOWN = 20
#: What tells columns of one name apart: an index behind it.
_INDEX = re.compile(r"[_ ]?\d+$")
#: Columns of ours without which there is no recording: an error in them is one of the whole model.
_NEEDED = frozenset(channels[signal] for channels in CHANNELS.values() for signal in ("torque", "position"))
#: Name of a column of dates.
_OF_DATE = re.compile(r"dat(e|um)|zeit|time|stamp", re.IGNORECASE)


@dataclass(frozen=True)
class Guess:
    """One of our columns and where it may come from.

    Attributes
    ----------
    column : str
        Ours.
    choices : tuple of str
        Mappings ``ours=theirs*scale``, the best first; () when nothing in the file looks like it.
    confidence : Confidence
        Of the first choice.
    why : str
        In words.
    needed : bool
        Without it there is no recording.
    """

    column: str
    choices: tuple[str, ...]
    confidence: Confidence
    why: str
    needed: bool = True


#: Names of a voltage or of the share of it that a motor gets.
_VOLTAGE = re.compile(r"volt|spannung|pwm|duty|(^|[_ .])u[aqm]?$", re.IGNORECASE)

#: Voltages that do not drive the motor.
_SUPPLY = re.compile(r"bus|link|supply|battery|dc|ref|max|min|limit|zwischenkreis|netz|versorgung", re.IGNORECASE)

Ask = Callable[[Sequence[Guess]], Sequence[str]]
"""Puts all guesses to a person at once: the mappings that hold."""


class NeedsAnswers(Refused):
    """Columns that must be mapped by a person.

    Parameters
    ----------
    template : str
        A file of mappings to be edited and given to --map.
    """

    def __init__(self, message: str, template: str) -> None:
        super().__init__(message)
        self.template = template


def completed(
    table: Table, written: Sequence[str], axis: Axis, *, timed: bool, ask: Ask | None = None
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The mappings with what was guessed added, and sentences on each guess.

    Parameters
    ----------
    table : Table
    written : sequence of str
        What the user mapped; nothing is guessed when that and columns with our own names make a recording.
    axis : Axis
    timed : bool
        A time column is needed.
    ask : Ask or None
        Asks a person; None asks nobody.

    Raises
    ------
    NeedsAnswers
        When a needed column is not sure and nobody can be asked.
    UsageError
    """
    sources = sources_for(table, written)
    twins = [_either(table, names) for names in _twins_of_ours(table, sources)]
    sources = {name: source for name, source in sources.items() if name not in {guess.column for guess in twins}}
    _refuse_mixed(sources)
    if not twins and _makes_a_recording(sources, timed):
        return tuple(written), ()
    asked = {guess.column for guess in twins}
    guesses = [*twins, *(g for g in _guesses_for(table, sources, axis, timed=timed) if g.column not in asked)]
    if ask is None and any(guess.needed and guess.confidence != "sure" for guess in guesses):
        raise NeedsAnswers(_open_words(table, guesses), _template(table, written, guesses))
    if ask is None or all(guess.confidence == "sure" for guess in guesses):
        sure = [guess for guess in guesses if guess.confidence == "sure"]
        return (*written, *(guess.choices[0] for guess in sure)), tuple(f"guessed {guess.choices[0]}: {guess.why}" for guess in sure)
    answers = ask([guess for guess in guesses if guess.needed or guess.choices])
    for answer in answers:
        parse_source(answer, table)
    why = {guess.choices[0]: guess.why for guess in guesses if guess.choices}
    return (*written, *answers), tuple(f"taken {answer}: {why.get(answer, 'as answered')}" for answer in answers)


def _makes_a_recording(sources: Mapping[str, Source], timed: bool) -> bool:
    """True if torque and position of one side are mapped; a speed stands for the position."""
    whole = any(c["torque"] in sources and any(c[signal] in sources for signal in ("position", "velocity")) for c in CHANNELS.values())
    return whole and ("t_s" in sources or not timed)


def _refuse_mixed(sources: Mapping[str, Source]) -> None:
    """Refuse torque or current at the motor with a motion along the axis alone: what lies between them is the user's to say."""
    at_motor = next((name for name in ("torque_nm", "current_a") if name in sources), "")
    linear = next((name for name in ("position_m", "velocity_m_s") if name in sources), "")
    if not at_motor or not linear or "force_n" in sources or {"position_rad", "velocity_rad_s"} & sources.keys():
        return
    turned, theirs = ("position_rad", "mm") if linear == "position_m" else ("velocity_rad_s", "mm/s"), sources[linear].theirs
    raise UsageError(
        f"{at_motor} is meant at the motor, {linear} along the axis: say how far the axis goes per turn, --map "
        f"{turned[0]}={quoted(theirs)}*{turned[1]}*rev/10mm (10 mm: its lead or feed constant); where nobody knows it, take the current "
        f"for the force, --map force_n={quoted(sources[at_motor].theirs)}: then everything is identified in its unit"
    )


def _twins_of_ours(table: Table, sources: Mapping[str, Source]) -> list[tuple[str, ...]]:
    """Columns that have a name of ours, each with the others that could be meant by it; what the user mapped is the user's word."""
    found = []
    for column, source in sources.items():
        if source.theirs != column or source.written != column:
            continue
        twins = [name for name in table.columns if name != column and _could_be_meant(table, column, name)]
        if twins:
            found.append((column, *twins))
    return found


def _could_be_meant(table: Table, column: str, name: str) -> bool:
    """By its name but for case and index; torque and position also by what stands around the name, or by the same quantity and unit."""
    if _INDEX.sub("", Table.bare(name)).lower() == column:
        return True
    if column not in _NEEDED or name in KNOWN_COLUMNS or table.columns[name].dtype.kind not in "fiu":
        return False
    ours, theirs = meaning_of(table, column), meaning_of(table, name)
    if ours is None or theirs is None or not theirs.by_name or theirs.quantity != ours.quantity or theirs.role == "setpoint" or theirs.load:
        return False
    around = re.search(rf"(?<![a-z]){re.escape(column)}(?![a-z])", name.lower()) is not None
    return around or (theirs.suffix == ours.suffix != "")


def _with_place(table: Table, name: str) -> str:
    """A column as a question names it: of two with one name the place tells which is which."""
    return f"{name!r} (c{list(table.columns).index(name) + 1})"


def _either(table: Table, names: Sequence[str]) -> Guess:
    """The question which of some columns is meant; the first has our name."""
    why = f"{', '.join(_with_place(table, name) for name in names[:4])} could be meant"
    return Guess(names[0], tuple(f"{names[0]}={quoted(name)}" for name in names), "likely", why)


def _guesses_for(table: Table, sources: Mapping[str, Source], axis: Axis, *, timed: bool) -> list[Guess]:
    """A guess for each column that is not mapped yet: those that are needed first, then what is sure beside them."""
    used = {source.theirs for source in sources.values()}
    clocks = set(table.clocks.values())
    meanings = [m for name in table.columns if name not in used and name not in clocks if (m := meaning_of(table, name)) is not None]
    texts = {m.quantity: m.name for m in reversed(meanings) if table.columns[m.name].dtype.kind not in "fiu"}
    meanings = [m for m in meanings if table.columns[m.name].dtype.kind in "fiu" or m.quantity == "time"]
    ratio = axis.known_transmission_m_rad
    found: list[Guess] = []
    side = _side(meanings, sources)
    channels = CHANNELS[side]
    if timed and "t_s" not in sources:
        found.append(_time(table, meanings))
    drives = "current" if _share_of_rated(meanings) else {"motor": "torque", "ampere": "current", "load": "force", "volt": "voltage"}[side]
    wanted = {"torque": drives, "position": "position"}
    for signal, quantity in wanted.items():
        if channels[signal] not in sources:
            guess = _signal(table, channels[signal], [m for m in meanings if m.quantity == quantity], axis, ratio)
            if not guess.choices and quantity in texts:
                cell = next(iter(table.columns[texts[quantity]]), "")
                guess = replace(guess, why=f"{texts[quantity]} holds no numbers but {str(cell)[:SHOWN]!r}: export it as numbers")
            found.append(guess)
    found = [_or_commanded(guess, table, channels, meanings, drives, axis, ratio) for guess in found]
    found = [_or_voltage(guess, table, used, channels) for guess in found]
    taken = used | {_theirs(guess, table) for guess in found if guess.choices}
    for signal, quantity, role in (
        ("velocity", "velocity", "actual"),
        ("torque_setpoint", wanted["torque"], "setpoint"),
        ("reference_position", "position", "setpoint"),
        ("reference_velocity", "velocity", "setpoint"),
    ):
        beside = [m for m in meanings if m.quantity == quantity and not m.load and (m.role == "setpoint") == (role == "setpoint")]
        column = channels[signal]
        guess = _signal(table, column, [m for m in beside if m.name not in taken], axis, ratio, role)
        if column not in sources and guess.confidence == "sure":
            found.append(replace(guess, needed=False))
        elif column == channels["velocity"] and column not in sources and guess.choices:
            found = [replace(guess, needed=True) if g.column == channels["position"] and not g.choices else g for g in found]
    found += [replace(g, needed=False) for g in _second_sensors(meanings, sources, taken)]
    return _by_numbers(table, _from_speed_alone(found, channels), sources, channels, axis)


def _or_commanded(
    guess: Guess, table: Table, channels: Mapping[str, str], meanings: Sequence[Meaning], quantity: str, axis: Axis, ratio: float | None
) -> Guess:
    """The commanded torque where no other is in the file."""
    if guess.column != channels["torque"] or guess.choices:
        return guess
    commanded = _signal(table, guess.column, [m for m in meanings if m.quantity == quantity], axis, ratio, "setpoint")
    if not commanded.choices:
        return guess
    why = f"{commanded.why}; it is what was commanded, not what acted: the delay of the current loop will look like dead time"
    return replace(commanded, confidence="likely" if commanded.confidence == "sure" else commanded.confidence, why=why)


def _or_voltage(guess: Guess, table: Table, used: set[str], channels: Mapping[str, str]) -> Guess:
    """The motor's voltage where a file names nothing else that drives it."""
    names = [
        name
        for name, column in table.columns.items()
        if column.dtype.kind in "fiu"
        and name not in used
        and _VOLTAGE.search(Table.bare(name))
        and not _SUPPLY.search(Table.bare(name))
        and plain_unit(table.unit(name)) in {"", *UNITS["v"].others}
    ]
    if guess.column != channels["torque"] or guess.choices or not names:
        return guess
    choices = tuple(spelled("motor_voltage_v", name, plain_unit(table.unit(name)) or "1") for name in names)
    why = "no torque, current or force is in the file, so the motor's voltage by its name: everything is identified in volt then"
    return Guess("motor_voltage_v", choices, "likely" if len(names) == 1 else "unsure", why)


def _by_numbers(table: Table, found: list[Guess], sources: Mapping[str, Source], channels: Mapping[str, str], axis: Axis) -> list[Guess]:
    """With what the numbers themselves say, where names say nothing."""
    if all(guess.choices or not guess.needed for guess in found):
        return found
    known = next((_theirs(guess, table) for guess in found if guess.column == "t_s" and guess.choices), "")
    seen = relations(table, sources["t_s"].theirs if "t_s" in sources else known)
    columns: dict[str, tuple[str, ...]] = {"t_s": (seen.time,), channels["torque"]: seen.torques, channels["position"]: (seen.position,)}
    made = []
    for guess in found:
        names = [name for name in columns.get(guess.column, ()) if name]
        if guess.choices or not guess.needed or not names:
            made.append(guess)
            continue
        if guess.column == "position_rad" and not table.unit(names[0]):
            choices = without_unit(table, guess.column, Meaning(names[0], "position", "none", False), axis, "rad")[0]
        else:
            days = guess.column == "t_s" and are_days(table.columns[names[0]])
            units = ("d",) if days else _units_of_time(_step(table, names[0])) if guess.column == "t_s" else ("1",)
            choices = tuple(spelled(_driving(guess.column, name), name, unit) for name in names for unit in units)
        made.append(replace(guess, choices=choices, why=f"by its numbers: {'; '.join(filter(None, map(seen.why, names)))}"))
    return made


def _driving(column: str, name: str) -> str:
    """The column of ours that a driver of the motion is: the motor's voltage where its name says so."""
    return "motor_voltage_v" if column == "torque_nm" and _VOLTAGE.search(name) else column


def _units_of_time(step: float) -> tuple[str, ...]:
    fitting = [
        unit
        for unit, factor in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))
        if _SHORTEST_STEP_S <= step * factor <= _LONGEST_STEP_S
    ]
    return tuple(dict.fromkeys((*fitting, "s")))


def _from_speed_alone(found: list[Guess], channels: Mapping[str, str]) -> list[Guess]:
    """Without the question for a position where a speed is sure, which is integrated."""
    speed = any(guess.column == channels["velocity"] and guess.confidence == "sure" for guess in found)
    return [guess for guess in found if not (speed and guess.column == channels["position"] and not guess.choices)]


def _theirs(guess: Guess, table: Table) -> str:
    return parse_source(guess.choices[0], table).theirs


def _side(meanings: Sequence[Meaning], sources: Mapping[str, Source]) -> Side:
    for side, channels in CHANNELS.items():
        if channels["torque"] in sources:
            return side
    if "position_m" in sources:
        return "load"
    actual = {m.quantity for m in meanings if m.role != "setpoint"}
    if "torque" in actual:
        return "motor"
    if "force" in actual and "current" not in actual:
        return "load"
    return "ampere" if "current" in actual and not _share_of_rated(meanings) else "motor"


def _share_of_rated(meanings: Sequence[Meaning]) -> bool:
    """True if the current stands in per cent of a rated one, and no torque beside it: no ampere, but the same share of the rated torque."""
    actual = [m for m in meanings if m.role != "setpoint"]
    current = [m for m in actual if m.quantity == "current"]
    return bool(current) and all(m.special.startswith("per") for m in current) and not any(m.quantity == "torque" for m in actual)


def _time(table: Table, meanings: Sequence[Meaning]) -> Guess:
    clocks = list(dict.fromkeys(table.clocks.values()))
    if clocks:
        name = clocks[0]
        unit = _time_unit(table, name)
        if unit:
            return Guess("t_s", (spelled("t_s", name, unit),), "sure", "the file says that it is the time of its signals")
        return Guess("t_s", tuple(spelled("t_s", name, unit) for unit in ("s", "ms", "us")), "unsure", "its unit cannot be told")
    rising = [m for m in meanings if m.quantity == "time" and _rises(table, m.name)]
    if not rising:
        back = next((m.name for m in meanings if m.quantity == "time" and _rises(table, m.name, -1.0)), "")
        dates = [name for name, column in table.columns.items() if not _stated(table, name) and are_days(column, named=False)]
        if len(dates) == 1:
            confidence: Confidence = "sure" if _OF_DATE.search(dates[0]) else "likely"
            return Guess("t_s", (spelled("t_s", dates[0], "d"),), confidence, "numbers of days as a spreadsheet has dates")
        if back:
            raise DataError(f"{table.file}: {back} falls from row to row, the last row was recorded first; turn the order of the rows")
        return Guess("t_s", (), "unsure", "no column is called time and rises; give --rate or --period, or map one")
    best = rising[0]
    step = _step(table, best.name)
    if len(rising) > 1 and not (rising[0].unit and not rising[1].unit):
        several = tuple(spelled("t_s", m.name, m.unit or _units_of_time(_step(table, m.name))[0]) for m in rising)
        return Guess("t_s", several, "unsure", "several columns look like time")
    if table.columns[best.name].dtype.kind not in "fiu":
        return Guess("t_s", (spelled("t_s", best.name, ""),), "sure", "dates or times of day")
    if best.unit in ("", "d") and are_days(table.columns[best.name]):
        return Guess("t_s", (spelled("t_s", best.name, "d"),), "sure", "its name, and numbers of days as a spreadsheet has dates")
    if best.unit:
        return Guess("t_s", (spelled("t_s", best.name, best.unit),), "sure", f"its name, and its unit {best.unit} by the file")
    if _SHORTEST_STEP_S <= step <= _LONGEST_STEP_S:
        return Guess("t_s", (spelled("t_s", best.name, "s"),), "sure", f"its name, and {step:.4g} s between rows")
    choices = tuple(spelled("t_s", best.name, unit) for unit in _units_of_time(step))
    return Guess("t_s", choices, "likely", f"its name; it rises by {step:.4g} per row, and its unit is not stated")


def _stated(table: Table, name: str) -> str:
    """Unit of a column by the file, "" for none."""
    meaning = meaning_of(table, name)
    return table.unit(name) or (meaning.unit if meaning is not None else "")


def _time_unit(table: Table, name: str) -> str:
    meaning = meaning_of(table, name)
    if meaning is not None and meaning.quantity == "time" and meaning.unit:
        return meaning.unit
    return "s" if _SHORTEST_STEP_S <= _step(table, name) <= _LONGEST_STEP_S else ""


def _rises(table: Table, name: str, way: float = 1.0) -> bool:
    values = table.columns[name]
    if values.dtype.kind not in "fiu":
        return way > 0.0 and name.lower() not in {"n", "m"}
    steps = way * np.diff(values[np.isfinite(values)])
    changes = steps[steps != 0.0]  # a coarse clock stands between
    return len(changes) > 1 and bool(np.mean(changes > 0.0) > 0.9)


def _step(table: Table, name: str) -> float:
    values = table.columns[name]
    known = values[np.isfinite(values)] if values.dtype.kind in "fiu" else np.zeros(0)
    return float(np.median(np.diff(known))) if len(known) > 1 else 0.0


def _signal(table: Table, column: str, meanings: Sequence[Meaning], axis: Axis, ratio: float | None, role: str = "actual") -> Guess:
    """The best of the columns that have the quantity."""
    usable = [m for m in meanings if not m.load and (m.role == "setpoint") == (role == "setpoint")]
    ordered = sorted(usable, key=lambda m: (m.role != role, not m.by_name, not m.suffix))
    scaled = [(m, *by_unit(table, column, m, axis, ratio)) for m in ordered]
    scaled.sort(key=lambda item: (item[0].role != role, item[2] != "sure"))
    if not scaled:
        return Guess(column, (), "unsure", "no column of the file is called so")
    first, choices, confidence, why = scaled[0]
    # "Torque" beside "actual torque" is another one as often as the same: a word that one of them bears makes none sure
    rivals = [m for m, *_ in scaled[1:] if m.by_name >= first.by_name]
    others = tuple(item[1][0] for item in scaled[1:4] if item[1])
    if rivals:
        words = f"{why}; {', '.join(_with_place(table, m.name) for m in (first, *rivals[:3]))} could be meant"
        return Guess(column, (*choices, *others), "likely" if confidence == "sure" else confidence, words)
    return Guess(column, (*choices, *others), confidence, why)


def _second_sensors(meanings: Sequence[Meaning], sources: Mapping[str, Source], taken: set[str]) -> list[Guess]:
    found = []
    for column, quantity, suffix, load in (
        ("cart_position_m", "position", "m", True),
        ("load_position_rad", "position", "rad", True),
        ("temperature_c", "temperature", "c", False),
    ):
        fits = [m for m in meanings if (m.quantity, m.suffix) == (quantity, suffix) and (m.load or not load)]
        one = [m for m in fits if m.role != "setpoint" and m.name not in taken]
        if len(one) == 1 and column not in sources:
            mapping = spelled(column, one[0].name, "" if one[0].suffix == "c" else one[0].unit)
            found.append(Guess(column, (mapping,), "sure", f"its name, and its unit {one[0].unit} by the file"))
    return found


def _open_words(table: Table, guesses: Sequence[Guess]) -> str:
    open_ones = [guess for guess in guesses if guess.needed and guess.confidence != "sure"]
    words = [f"{guess.column}: {guess.why}" + (f" ({' or '.join(guess.choices[:3])})" if guess.choices else "") for guess in open_ones]
    names = ", ".join(list(table.columns)[:30])
    return f"{table.file}: not sure which column is which, and nobody can be asked. {'; '.join(words)}. Its columns are {names}"


def _template(table: Table, written: Sequence[str], guesses: Sequence[Guess]) -> str:
    """A file of mappings for ``--map FILE``: sure ones stand, each other one has its choices as comments to be opened."""
    lines = [
        f"# How the columns of {table.file} become a recording: ours = theirs * scale + offset.",
        "# Take away the '#' before the line that holds, one per column of ours; correct names, units and factors.",
        "",
        *written,
    ]
    for guess in guesses:
        lines += ["", f"# {guess.column}: {guess.confidence}; {guess.why}"]
        if guess.confidence == "sure":
            lines.append(guess.choices[0])
        else:
            lines += [f"# {choice}" for choice in guess.choices] or [f"# {guess.column}=NAME*SCALE"]
    lines += ["", "# Columns of the file, with their units and their smallest and largest values:"]
    for name, values in table.columns.items():
        finite = values[np.isfinite(values)] if values.dtype.kind == "f" else values[:0]
        span = f", {finite.min():.6g} to {finite.max():.6g}" if len(finite) else ""
        lines.append(f"#   {name}{f' [{table.unit(name)}]' if table.unit(name) and table.unit(name) not in name else ''}{span}")
    return "\n".join(lines) + "\n"


def mappings_in(text: str) -> list[str]:
    """The mappings in a file that :func:`_template` made and a person edited.

    Parameters
    ----------
    text : str
        Content of the file.

    Returns
    -------
    list of str
        ``CHANNEL=NAME*FACTOR``, without comments.
    """
    lines = (line.strip() for line in text.splitlines())
    return [line.split("  #")[0].strip() for line in lines if line and not line.startswith("#")]
