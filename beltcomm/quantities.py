"""Units at the border: what the suffix of a column, key or option means, and which other units people write instead.

Inside everything is SI; a name that crosses the border ends in its unit (``torque_nm``, ``travel_m``).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from beltcomm.errors import UsageError


@dataclass(frozen=True)
class Unit:
    """One SI unit.

    Attributes
    ----------
    symbol : str
        As printed.
    others : Mapping[str, float]
        Other spellings and units of the quantity -> factor to SI.
    """

    symbol: str
    others: Mapping[str, float]


#: Decimals of an error in mm.
FINEST = 4

_INERTIA = {"kgm2": 1.0, "kgcm2": 1e-4, "kgmm2": 1e-6, "gcm2": 1e-7}
_ANGLE = {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180.0, "°": math.pi / 180.0, "rev": math.tau}
_LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
_TORQUE = {"nm": 1.0, "ncm": 1e-2, "mnm": 1e-3, "knm": 1e3, "lbin": 0.112984829, "lbft": 1.355817948, "ozin": 0.00706155181}

#: Suffix of a name -> its unit.
UNITS: Mapping[str, Unit] = {
    "s": Unit("s", {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}),
    "m": Unit("m", _LENGTH),
    "m_s": Unit("m/s", {f"{name}/s": factor for name, factor in _LENGTH.items()} | {"m/min": 1.0 / 60.0}),
    "m_s2": Unit("m/s²", {f"{name}/s2": factor for name, factor in _LENGTH.items()}),
    "m_s3": Unit("m/s³", {f"{name}/s3": factor for name, factor in _LENGTH.items()}),
    "rad": Unit("rad", _ANGLE),
    "rad_s": Unit(
        "rad/s",
        {f"{name}/s": factor for name, factor in _ANGLE.items()}
        | {"rpm": math.tau / 60.0, "1/min": math.tau / 60.0, "r/min": math.tau / 60.0, "u/min": math.tau / 60.0},
    ),
    "deg": Unit("°", {"deg": 1.0, "°": 1.0, "rad": 180.0 / math.pi, "rev": 360.0}),
    "deg_s": Unit("°/s", {"deg/s": 1.0, "°/s": 1.0, "rad/s": 180.0 / math.pi} | dict.fromkeys(("rpm", "1/min", "r/min", "u/min"), 6.0)),
    "deg_s2": Unit("°/s²", {"deg/s2": 1.0, "°/s2": 1.0, "rad/s2": 180.0 / math.pi}),
    "deg_s3": Unit("°/s³", {"deg/s3": 1.0, "°/s3": 1.0, "rad/s3": 180.0 / math.pi}),
    "nm": Unit("N m", _TORQUE),
    "nm_a": Unit("N m/A", {f"{name}/a": factor for name, factor in _TORQUE.items()}),
    "nm_rad": Unit("N m/rad", {f"{name}/rad": factor for name, factor in _TORQUE.items()}),
    "nm_s_rad": Unit("N m s/rad", {f"{name}s/rad": factor for name, factor in _TORQUE.items()}),
    "n": Unit("N", {"n": 1.0, "kn": 1e3, "mn": 1e-3}),
    "n_m": Unit("N/m", {"n/m": 1.0, "n/mm": 1e3, "kn/m": 1e3, "n/um": 1e6, "kn/mm": 1e6}),
    "n_a": Unit("N/A", {"n/a": 1.0, "kn/a": 1e3}),
    "a": Unit("A", {"a": 1.0, "ma": 1e-3}),
    "v": Unit("V", {"v": 1.0, "mv": 1e-3}),
    "kg": Unit("kg", {"kg": 1.0, "g": 1e-3, "t": 1e3}),
    "kg_m2": Unit("kg m²", _INERTIA),
    "hz": Unit("Hz", {"hz": 1.0, "khz": 1e3}),
    "c": Unit("°C", {"c": 1.0, "°c": 1.0}),
}
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
    text = re.sub(r"^(\s*[-+]?\d+),(\d+)(?!\d*[.,])", _decimal_comma, text)
    match = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", text)
    unit = UNITS.get(suffix_of(name))
    symbol = f" in {unit.symbol}" if unit else ""
    if re.match(r"\s*[-+]?\d*,\d", text):
        raise UsageError(f"{name} is {text!r}; a comma before three digits may stand for thousands: write the decimal point as '.'")
    if match is None:
        raise UsageError(f"{name} is {text!r}; give a number{symbol}")
    value = float(match[1])
    if not math.isfinite(value):
        raise UsageError(f"{name} is {text[:20]!r}, more than a number can be; give a number{symbol}")
    spelled = re.sub(r"[\s·*]", "", match[2]).replace("²", "2").replace("³", "3").replace("µ", "u").replace("μ", "u").lower()
    if not spelled:
        return value
    if unit is None or spelled not in unit.others:
        known = f"; understood are {', '.join(unit.others)}" if unit else ""
        raise UsageError(f"{name} is {text!r}; {match[2]!r} is not a unit of it{known}")
    # 15 digits are all that a decimal text determines: 570 mm is 0.57 m, not 0.5700000000000001 m
    return float(f"{value * unit.others[spelled]:.15g}")


def _decimal_comma(found: re.Match[str]) -> str:
    """``0,449`` with a point; three digits behind a number that is not 0 may be thousands and stay as they are."""
    whole, rest = found[1], found[2]
    return found[0] if len(rest) == 3 and whole.strip().lstrip("+-") not in ("0", "00") else f"{whole}.{rest}"
