"""Units at the border: what the suffix of a column, key or option means, and which other units people write instead.

Inside everything is SI; a name that crosses the border ends in its unit (``torque_nm``, ``travel_m``).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from beltcomm.errors import UsageError


@dataclass(frozen=True)
class Unit:
    """One SI unit.

    Attributes
    ----------
    symbol : str
        As printed.
    spellings : Mapping[str, float]
        Units of the quantity as they are written -> factor to SI.
    """

    symbol: str
    spellings: Mapping[str, float]

    @cached_property
    def others(self) -> Mapping[str, float]:
        """The units in small letters without blanks -> factor to SI."""
        return {plain_spelling(unit).lower(): factor for unit, factor in self.spellings.items()}


#: Decimals of an error in mm.
FINEST = 4

_INERTIA = {"kg m²": 1.0, "kg cm²": 1e-4, "kg mm²": 1e-6, "g cm²": 1e-7}
_ANGLE = {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180.0, "°": math.pi / 180.0, "rev": math.tau}
_LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "µm": 1e-6}
_POUND_N, _KILOGRAM_N = 4.4482216152605, 9.80665
_TORQUE = {
    **{"N m": 1.0, "N cm": 1e-2, "mN m": 1e-3, "kN m": 1e3, "daN m": 10.0, "kgf m": _KILOGRAM_N, "kgf cm": 1e-2 * _KILOGRAM_N},
    **{"lb in": 0.0254 * _POUND_N, "lb ft": 0.3048 * _POUND_N, "oz in": 0.0254 * _POUND_N / 16.0},
}
_TURNS = ("rpm", "1/min", "min-1", "r/min", "U/min")

#: Suffix of a name -> its unit.
UNITS: Mapping[str, Unit] = {
    "s": Unit("s", {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86400.0}),
    "m": Unit("m", _LENGTH),
    "m_s": Unit("m/s", {f"{name}/s": factor for name, factor in _LENGTH.items()} | {"m/min": 1.0 / 60.0}),
    "m_s2": Unit("m/s²", {f"{name}/s²": factor for name, factor in _LENGTH.items()}),
    "m_s3": Unit("m/s³", {f"{name}/s³": factor for name, factor in _LENGTH.items()}),
    "rad": Unit("rad", _ANGLE),
    "rad_s": Unit("rad/s", {f"{name}/s": factor for name, factor in _ANGLE.items()} | dict.fromkeys(_TURNS, math.tau / 60.0)),
    "deg": Unit("°", {"deg": 1.0, "°": 1.0, "rad": 180.0 / math.pi, "rev": 360.0}),
    "deg_s": Unit("°/s", {"deg/s": 1.0, "°/s": 1.0, "rad/s": 180.0 / math.pi} | dict.fromkeys(_TURNS, 6.0)),
    "deg_s2": Unit("°/s²", {"deg/s²": 1.0, "°/s²": 1.0, "rad/s²": 180.0 / math.pi}),
    "deg_s3": Unit("°/s³", {"deg/s³": 1.0, "°/s³": 1.0, "rad/s³": 180.0 / math.pi}),
    "nm": Unit("N m", _TORQUE),
    "nm_a": Unit("N m/A", {f"{name}/A": factor for name, factor in _TORQUE.items()}),
    "nm_rad": Unit("N m/rad", {f"{name}/rad": factor for name, factor in _TORQUE.items()}),
    "nm_s_rad": Unit("N m s/rad", {f"{name} s/rad": factor for name, factor in _TORQUE.items()}),
    "n": Unit("N", {"N": 1.0, "kN": 1e3, "mN": 1e-3, "daN": 10.0, "kgf": _KILOGRAM_N}),
    "n_m": Unit("N/m", {"N/m": 1.0, "N/mm": 1e3, "kN/m": 1e3, "N/µm": 1e6, "kN/mm": 1e6}),
    "n_a": Unit("N/A", {"N/A": 1.0, "kN/A": 1e3}),
    "a": Unit("A", {"A": 1.0, "mA": 1e-3}),
    "v": Unit("V", {"V": 1.0, "mV": 1e-3}),
    "kg": Unit("kg", {"kg": 1.0, "g": 1e-3, "t": 1e3}),
    "kg_m2": Unit("kg m²", _INERTIA),
    "hz": Unit("Hz", {"Hz": 1.0, "kHz": 1e3}),
    "c": Unit("°C", {"C": 1.0, "°C": 1.0}),
}
_RAISED = str.maketrans("²³¹⁻µμ", "231-uu")
_BY_LENGTH = sorted(UNITS, key=len, reverse=True)


def suffix_of(name: str) -> str:
    """The unit suffix of a name.

    Parameters
    ----------
    name : str
        ``stiffness_nm_rad``.

    Returns
    -------
    str
        ``"nm_rad"``; "" when it has none.
    """
    return next((suffix for suffix in _BY_LENGTH if name.endswith(f"_{suffix}")), "")


def unit_of(name: str) -> str:
    """The unit of a named quantity as printed.

    Parameters
    ----------
    name : str
        ``stiffness_nm_rad``.

    Returns
    -------
    str
        ``"N m/rad"``; "" when the name has none.
    """
    suffix = suffix_of(name)
    return UNITS[suffix].symbol if suffix else ""


def in_other_unit(name: str, wanted: str) -> float | None:
    """Factor between two names of one quantity.

    Parameters
    ----------
    name : str
        In another unit, ``t_ms``.
    wanted : str
        In SI, ``t_s``.

    Returns
    -------
    float or None
        From the former to the latter; None when they name two quantities.
    """
    suffix = suffix_of(wanted)
    stem = wanted.removesuffix(suffix)
    found = name.lower().removeprefix(stem)
    if not suffix or found == name.lower() or found == suffix:
        return None
    spelled = {other.replace("/", "_"): factor for other, factor in UNITS[suffix].others.items()}
    return spelled.get(found, spelled.get(found.replace("_", "", 1)))


def in_mm(value_m: float) -> str:
    """Error of a position in mm as every screen, page and file has it, without the unit.

    Three digits, none finer than a tenth of a micrometre (0.0025 for a screw's 2.48 µm); below a micrometre two; - for none.

    Parameters
    ----------
    value_m : float, m
        Of an error.
    """
    if not math.isfinite(value_m):
        return "-"
    value = float(f"{1e3 * value_m:.3g}")
    fine = round(value, FINEST) if abs(value) >= 1e-3 else float(f"{value:.2g}")
    return f"{fine:.6f}".rstrip("0").rstrip(".")


def mm(value_m: float) -> str:
    """Error of a position in mm as :func:`in_mm` has it, with its unit where there is a number.

    Parameters
    ----------
    value_m : float, m
        Of an error.
    """
    return f"{in_mm(value_m)} mm".removeprefix("- mm") or "-"


def plain_spelling(text: str) -> str:
    """A unit without blanks, dots, raised digits and the rms of amperes: ``kgcm2`` of ``kg·cm²``.

    Parameters
    ----------
    text : str
        As it was typed.
    """
    return re.sub(r"(?<=/A)_?rms$", "", re.sub(r"[\s·*^]", "", text), flags=re.IGNORECASE).translate(_RAISED)


def parse_quantity(text: str, name: str) -> float:
    """The SI value of a text such as ``0.3``, ``300mm`` or ``0.449 kg cm²``.

    Parameters
    ----------
    text : str
        As it was typed.
    name : str
        Whose suffix says which quantity is meant.

    Raises
    ------
    UsageError
        For text that is no such number, or a unit of another quantity, with the units that are understood.
    """
    pointed = re.sub(r"^(\s*[-+]?\d+),(\d+)(?!\d*[.,])", _decimal_comma, text)
    match = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", pointed)
    unit = UNITS.get(suffix_of(name))
    symbol = f" in {unit.symbol}" if unit else ""
    if re.match(r"\s*[-+]?\d*,\d", pointed):
        raise UsageError(f"{name} is {text!r}; a comma before three digits may stand for thousands: write the decimal point as '.'")
    if match is None:
        raise UsageError(f"{name} is {text!r}; give a number{symbol}")
    value = float(match[1])
    if not math.isfinite(value):
        raise UsageError(f"{name} is {text[:20]!r}, more than a number can be; give a number{symbol}")
    spelled = plain_spelling(match[2])
    if not spelled:
        return value
    factor = unit.others.get(spelled.lower()) if unit else None
    # any case is read, but M is mega and S siemens: 5 MN are not 5 mN
    if unit is None or factor is None or spelled[0] in "MS":
        small = [one for one in unit.spellings if plain_spelling(one).lower() == spelled.lower()] if unit else []
        known = f"; is it {small[0]}?" if small else f"; understood are {', '.join(unit.spellings)}" if unit else ""
        raise UsageError(f"{name} is {text!r}; {match[2]!r} is not a unit of it{known}")
    # 15 digits are all that a decimal text determines: 570 mm is 0.57 m, not 0.5700000000000001 m
    return float(f"{value * factor:.15g}")


def _decimal_comma(found: re.Match[str]) -> str:
    """``0,449`` with a point; three digits behind a number that is not 0 may be thousands and stay as they are."""
    whole, rest = found[1], found[2]
    return found[0] if len(rest) == 3 and whole.strip().lstrip("+-") not in ("0", "00") else f"{whole}.{rest}"


#: Bound of a torque or damping of a model, N m or N m s/rad, above which it is no friction and no ripple.
_SMALL = 50.0
#: SI unit -> largest bound of a parameter, the trade's multiple up to it, and its factor; beyond the last one SI stays.
_TRADE: Mapping[str, tuple[tuple[float, str, float], ...]] = {
    "N m": ((_SMALL, "mN m", 1e3),),
    "N m s/rad": ((_SMALL, "mN m s/rad", 1e3),),
    "m": ((2e-3, "µm", 1e6), (math.inf, "mm", 1e3)),
    "rad": ((0.5, "mrad", 1e3), (math.inf, "°", 180.0 / math.pi)),
    "s": ((1.0, "ms", 1e3),),
    **dict.fromkeys(("kg m²", "kg m2"), ((math.inf, "kg cm²", 1e4),)),
}
#: Of stiffness: the smallest bound from which it is the trade's multiple, as a cable's spring is none of a belt.
_STIFF: Mapping[str, tuple[float, str, float]] = {"N": (1e5, "kN", 1e-3), "N/m": (1e5, "kN/m", 1e-3)}


def read_in(unit: str, bound: float = 0.0) -> tuple[float, str]:
    """Factor and unit in which every screen and page has a parameter of a model: mN m for friction and ripple, mm, kg cm², kN/m.

    Gains (Kp in N m s/rad) and ratings are no such torques and stay in N m; files and ``--json`` are in SI.

    Parameters
    ----------
    unit : str
        SI, as of a parameter of a model.
    bound : float
        Highest possible value; a torque that may be as large as a rating stays in N m.  0 for an unknown one.

    Returns
    -------
    factor : float
    unit : str
    """
    if unit in _STIFF and bound >= _STIFF[unit][0]:
        return _STIFF[unit][2], _STIFF[unit][1]
    smallest = bound if bound or unit in ("N m", "N m s/rad") else math.inf
    return next(((factor, said) for most, said, factor in _TRADE.get(unit, ()) if smallest <= most), (1.0, unit))


def span_words(low: float, high: float, unit: str) -> str:
    """Bounds of a parameter as screens and pages have its value: ``0 ... 5000 mN m``, ``1 ... 100 000 kN/m``; without powers of ten.

    Parameters
    ----------
    low, high : float, SI
    unit : str
        SI, as of a parameter of a model; "1" or "" for none.
    """
    from beltcomm.result import with_unit  # with NumPy, which a help does without

    factor, said = read_in(unit, high)
    return with_unit(f"{short(factor * low)} ... {short(factor * high)}", said)


def short(value: float) -> str:
    """Four digits, thousands apart, without powers of ten.

    Parameters
    ----------
    value : float
        Of any unit.
    """
    if abs(value) >= 1e4:
        return f"{value:,.0f}".replace(",", " ")
    text = f"{value:.4g}"
    return f"{value:.10f}".rstrip("0").rstrip(".") if "e" in text else text


def three_digits(value: float) -> str:
    """Three digits, without powers of ten, as a screen shows a number; "-" for none.

    Parameters
    ----------
    value : float
        Of any unit.
    """
    if not math.isfinite(value):
        return "-"
    if value and abs(value) < 1e-3:
        return f"{value:.1g}" if abs(value) >= 1e-4 else "0"
    return f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.0f}"
