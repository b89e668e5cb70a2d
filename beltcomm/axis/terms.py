"""Texts for people in the words and units of the kind of axis.

Everything inside calls the load a carriage, what moves it a belt, and measures both along a line; sentences, tables and pictures are made
in these words.  Of another kind of axis they are said in its own before they leave: words by words, a unit together with the number or the
list of numbers before it, and a unit that stands alone by one that is right for the number as it is.  Names of parameters and files, which
people type, stay.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

from beltcomm.axis.kinds import ARC_M, BELT, KINDS

if TYPE_CHECKING:
    from beltcomm.axis import Axis


#: A number, and what stands between the numbers of a list with one unit behind it.
_DIGITS_OF = r"\d+(?: \d{3})*(?:\.\d+)?(?:e[-+]?\d+)?"
_NUMBER = rf"(?<![\w.]){_DIGITS_OF}"
_BETWEEN = r"(?:\s*\.\.\.?\s*|\s*±\s*|, | to | and | or |/)[-+−±]?"
#: Squares as files have them.
_SQUARE = re.compile(r"\b(c?m|s)2\b")
#: Digits that a converted number has at least.
_DIGITS, _MOST_DIGITS = 3, 5

#: Other name -> name of the effect.
ALIASES: Mapping[str, str] = {
    "link_stiffness": "belt_stiffness",
    "link_damping": "belt_damping",
    "friction_at_load": "cart_friction",
    "viscous_at_load": "viscous_cart",
    "stribeck_at_load": "stribeck_cart",
    "presliding_at_load": "presliding_cart",
    "friction_by_place_at_load": "friction_position_cart",
}


@dataclass(frozen=True)
class ShownUnit:
    """A unit of another kind of axis.

    Attributes
    ----------
    symbol : str
        Behind a converted number.
    factor : float
        By which the number is multiplied.
    alone : str
        Where no number stands before it: what the number would have to be read in.
    small : tuple of float, str and float, or None
        Up to which value another unit is written, that unit, and its factor.
    """

    symbol: str
    factor: float = 1.0
    alone: str = ""
    small: tuple[float, str, float] | None = None


@dataclass(frozen=True)
class Terms:
    """Words and units of one kind of axis.

    Attributes
    ----------
    words : sequence of tuple of str
        Pattern and what is said instead, the longest first.
    units : dict of str to ShownUnit
        By the unit of a belt axis.
    names : dict of str to str
        Of effects, which may be typed too.
    """

    words: Sequence[tuple[str, str]] = ()
    names: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, ShownUnit] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.words or self.units)

    @cached_property
    def _patterns(self) -> list[tuple[re.Pattern[str], str]]:
        found = [(re.compile(rf"(?<![\w/-]){plain}(?![\w/-])"), said) for plain, said in self.names.items()]
        for plain, said in self.words:
            found.append((re.compile(rf"(?<![\w./-]){plain}(?![\w/-])(?!\.\w)"), said))
            if plain[0].isalpha() and plain[0].islower():
                found.append((re.compile(rf"(?<![\w./-]){plain[0].upper()}{plain[1:]}(?![\w/-])(?!\.\w)"), said[:1].upper() + said[1:]))
        return found

    @cached_property
    def _units(self) -> re.Pattern[str] | None:
        if not self.units:
            return None
        names = "|".join(re.escape(name) for name in sorted(self.units, key=len, reverse=True))
        # no part of a longer unit: N of N m, m of kg m²
        end = r"(?![\w²³/°])(?! (?:m|m²|m2|s²?|rad|cm²|mm²|A)(?![\w]))"
        return re.compile(rf"(?:({_NUMBER}(?:{_BETWEEN}{_DIGITS_OF})*)(\s?)|(?<![\w/²³°.])(?<!N )(?<!kg )(?<!c))({names}){end}")

    def said(self, text: str) -> str:
        """A text as of a belt axis in the words and units of this kind."""
        for pattern, instead in self._patterns:
            text = pattern.sub(instead, text)
        return text if self._units is None else self._units.sub(self._unit, text)

    def label(self, text: str) -> tuple[str, float]:
        """Label of a picture's axis that ends in its unit, and the factor by which the numbers along it are to be multiplied.

        Parameters
        ----------
        text : str
            With the unit of a belt axis at its end.
        """
        for found in () if self._units is None else self._units.finditer(text):
            if found.end() == len(text) and found[1] is None:
                unit = self.units[found[3]]
                return f"{self.said(text[: found.start()])}{unit.symbol}", unit.factor
        return self.said(text), 1.0

    def shown(self, unit: str) -> ShownUnit:
        """Unit that stands for one of a belt axis where its number is multiplied, too; itself, as it is printed, where nothing changes.

        Parameters
        ----------
        unit : str
            Of a belt axis.
        """
        printed = _SQUARE.sub("\\1²", unit)
        return self.units.get(printed, ShownUnit(printed))

    def _unit(self, found: re.Match[str]) -> str:
        numbers, space, name = found.groups()
        unit = self.units[name]
        if numbers is None:
            return unit.alone or unit.symbol
        symbol, factor = unit.symbol, unit.factor
        largest = max(abs(float(one.replace(" ", ""))) for one in re.findall(_DIGITS_OF, numbers)) * factor
        if unit.small is not None and 0.0 < largest <= unit.small[0]:
            symbol, factor = unit.small[1], factor * unit.small[2]
        converted = re.sub(_DIGITS_OF, lambda one: times(one[0], factor), numbers)
        return f"{converted}{'' if symbol == '°' else space}{symbol}"


def times(number: str, factor: float) -> str:
    """A printed number by a factor, with the digits that it had, and no fewer than three.

    Parameters
    ----------
    number : str
        As it is printed; blanks may group its digits.
    factor : float
        From one unit to another.

    Returns
    -------
    str
        The number as it is for a factor of 1.
    """
    if factor == 1.0:
        return number
    plain = number.replace(" ", "")
    mantissa = re.sub(r"e.*", "", plain).replace(".", "").lstrip("0")
    value = float(plain) * factor
    digits = min(max(len(mantissa), _DIGITS), _MOST_DIGITS)
    text = f"{value:.{digits}g}"
    if "e" in text and 1e-6 < abs(value) < 1e9:
        text = f"{value:.{max(digits - 1 - int(text.partition('e')[2]), 0)}f}"
    return text.rstrip("0").rstrip(".") if "." in text and "." not in plain else text


def _file_names(kind: str) -> list[tuple[str, str]]:
    """Entries of axis.yaml that this kind calls otherwise."""
    own = KINDS[kind]
    pairs = [(entry.inside, name) for name, entry in own.renamed.items() if entry.inside != name]
    radius = next((name for inside, name in pairs if inside == "pulley.effective_radius_m"), "gearbox.ratio")
    stiffness = own.in_file("transmission.stiffness_n_m")
    pairs += [("pulley.effective_radius_m", radius), ("belt.specific_stiffness_n", stiffness), ("belt.pulley_distance_m", stiffness)]
    bare = [(inside.partition(".")[2], name.partition(".")[2]) for inside, name in pairs]
    return [(re.escape(inside), name) for inside, name in [*pairs, *bare] if inside]


#: Word for what moves the load and for the driving pulley; both and the load in German.
_NAMES = {
    "screw": ("screw", "screw", "Spindel", "Spindel", "Tisch"),
    "rack": ("rack", "pinion", "Zahnstange", "Ritzel", "Schlitten"),
    "rotary": ("coupling", "output", "Kupplung", "Abtrieb", "Last"),
    "linear": ("motor", "motor", "Motor", "Motor", "Schlitten"),
}


def _words(kind: str) -> list[tuple[str, str]]:
    drive, pulley, antrieb, scheibe, last = _NAMES[kind]
    load = KINDS[kind].load
    force = {"rotary": "load torque", "linear": "thrust"}.get(kind, f"{drive} force")
    own = [
        ("toothed-belt axis", f"{kind} axis"), ("toothed belt", drive),
        ("motor, coupling, gearbox and driving pulley", f"motor, coupling, gearbox and {pulley}"),
        ("the belt force", f"the {force}"), ("belt force", force), ("a belt axis", f"a {kind} axis"), ("belt axis", f"{kind} axis"),
        ("belt's force", force),
        ("belt stiffness", "stiffness between motor and load" if kind in ("rotary", "linear") else f"{drive} stiffness"),
        ("belt damping", "damping between motor and load" if kind in ("rotary", "linear") else f"{drive} damping"),
        ("driving pulley", pulley), ("end pulley", "end bearing"), ("pulleys", f"{pulley}s"), ("pulley", pulley), ("belts", f"{drive}s"),
        ("belt", drive), ("strands", "sides"), ("strand", "side"), ("carriages", f"{load}s"), ("carriage's", f"{load}'s"),
        ("carriage mass", "load inertia" if kind == "rotary" else f"{load} mass"), ("carriage", load), ("cart", load),
        ("Riemenkraft", "Moment an der Last" if kind == "rotary" else f"{antrieb}kraft"), ("Zahnriemen", antrieb), ("Riemen", antrieb),
        ("Antriebsscheibe", scheibe), ("Scheibe", scheibe), ("Schlittens", "Tisches" if kind == "screw" else last), ("Schlitten", last),
    ]  # fmt: skip
    if kind == "rotary":
        other = {
            "feed force": "load torque", "feed constant": "gear ratio", "carriage mass": "load inertia", "mass": "load", "masses": "loads",
            "weighed": "measured", "weighs": "has", "heavier": "larger", "heavy": "large", "lighter": "smaller", "lightest": "smallest",
            "with a ruler": "with a protractor", "a ruler": "a protractor", "the ruler": "the protractor",
        }  # fmt: skip
        own = [*other.items(), *own]
    if kind == "linear":
        other = {
            "motor-side inertia": "mass of the motor", "motor torque": "motor force", "torque": "force", "torques": "forces",
            "inertia": "mass", "turn of the motor": "pole pair", "steps per turn": "steps per pole pair",
        }  # fmt: skip
        own = [*other.items(), *own]
    return own


#: A rigid axis has no resonance: the suppression is asked for where a mode that nobody stated would lie first.
_RIGID = (
    ("open loop at the resonance", "open loop above half the Nyquist frequency"),
    (r"resonance at(?= [-−]?\d[\d.]* dB)", "open loop above half the Nyquist frequency at"),
    ("resonance suppression", "suppression above half the Nyquist frequency"),
    ("resonance dB", "upper half of the band dB"),
    ("the resonance lies far above what the loop needs", "a rigid axis has no resonance"),
    ("its resonance is what holds it back", "its dead time is what holds it back"),
)

_ARC = f"at r {1e3 * ARC_M:.1f} mm"

_TURNED: Mapping[str, ShownUnit] = {
    "mm": ShownUnit("°"),
    "µm": ShownUnit("m°"),
    "um": ShownUnit("m°"),
    "m": ShownUnit("°", 1e3, "1000°"),
    "mm/s": ShownUnit("°/s"),
    "m/s": ShownUnit("°/s", 1e3, "1000°/s"),
    "m/s²": ShownUnit("°/s²", 1e3, "1000°/s²"),
    "m/s³": ShownUnit("°/s³", 1e3, "1000°/s³"),
    "N": ShownUnit("N m", ARC_M, f"N {_ARC}"),
    "mN": ShownUnit("mN m", ARC_M, f"mN {_ARC}"),
    "kN": ShownUnit("N m", 1e3 * ARC_M, f"kN {_ARC}"),
    "N/m": ShownUnit("N m/rad", ARC_M**2, f"N/m {_ARC}"),
    "kN/m": ShownUnit("N m/rad", 1e3 * ARC_M**2, f"kN/m {_ARC}"),
    "N s/m": ShownUnit("N m s/rad", ARC_M**2, f"N s/m {_ARC}"),
    "kg": ShownUnit("kg m²", ARC_M**2, f"kg {_ARC}", (2e-3, "kg cm²", 1e4)),
    "g": ShownUnit("kg cm²", 10.0 * ARC_M**2, f"g {_ARC}"),
}


def _straight(ratio_m: float) -> Mapping[str, ShownUnit]:
    """Units at the motor of a linear axis, whose radian is ``ratio_m`` of its travel."""
    at = "per turn of 2π"
    one, two = 1.0 / ratio_m, 1.0 / ratio_m**2
    return {
        "N m": ShownUnit("N", one, f"N m {at}"),
        "mN m": ShownUnit("N", 1e-3 * one, f"mN m {at}"),
        "N m s/rad": ShownUnit("N s/m", two, f"N m s/rad {at}"),
        "mN m s/rad": ShownUnit("N s/m", 1e-3 * two, f"mN m s/rad {at}"),
        "N m/rad": ShownUnit("N/m", two, f"N m/rad {at}"),
        "kg m²": ShownUnit("kg", two, f"kg m² {at}"),
        "kg cm²": ShownUnit("kg", 1e-4 * two, f"kg cm² {at}"),
        "rad/s": ShownUnit("m/s", ratio_m, f"rad/s {at}"),
    }


PLAIN = Terms()
#: Of the axis whose pictures are being drawn.
_DRAWN: ContextVar[Terms] = ContextVar("drawn", default=PLAIN)


@contextmanager
def pictures_in(own: Terms) -> Iterator[None]:
    """Pictures made within are in these words and units.

    Parameters
    ----------
    own : Terms
        Of the axis that is drawn.
    """
    before = _DRAWN.set(own)
    try:
        yield
    finally:
        _DRAWN.reset(before)


def picture_terms() -> Terms:
    """Words and units of the pictures that are being made."""
    return _DRAWN.get()


@lru_cache(maxsize=32)
def terms(kind: str, ratio_m: float = 0.0, *, rigid: bool = False) -> Terms:
    """Words and units of a kind; those of a belt axis, which are left as they stand, for any other.

    Parameters
    ----------
    kind : str
        As ``Axis.kind``.
    ratio_m : float, m/rad
        Travel per radian of the motor, where the motor itself is linear.
    rigid : bool
        Whether motor and load are one inertia, without a resonance.

    Returns
    -------
    Terms
        False where nothing changes.
    """
    if kind in ("", BELT) or kind not in KINDS:
        return PLAIN
    units: Mapping[str, ShownUnit] = _TURNED if kind == "rotary" else _straight(ratio_m) if kind == "linear" and ratio_m else {}
    names = {name: alias for alias, name in ALIASES.items()} | {r"cart\.mass": "load.mass"}
    return Terms((*(_RIGID if rigid else ()), *_file_names(kind), *_words(kind)), names, units)


def terms_of(axis: Axis) -> Terms:
    """Words and units of an axis.

    Parameters
    ----------
    axis : Axis
        Of any kind.

    Returns
    -------
    Terms
        A linear motor has its transmission in them where its pulley is known.
    """
    known = axis.kind == "linear" and axis.get("pulley.effective_radius_m") is not None
    return terms(axis.kind, axis.transmission_m_rad if known else 0.0, rigid=axis.rigid)
