"""Answers of ``beltcomm init``: parts of public data sheets to begin with, values in the units of sheets, and their usual ranges."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

from beltcomm.axis.kinds import KINDS
from beltcomm.configfiles import did_you_mean, find_config, read_yaml
from beltcomm.errors import UsageError
from beltcomm.quantities import short, suffix_of, unit_of

#: Entry -> range, SI, outside which a number is asked for again: what most belt axes have, not what is possible.
USUAL: Mapping[str, tuple[float, float]] = {
    "motor.inertia_kg_m2": (1e-6, 2e-2),
    "motor.torque_constant_nm_a": (0.02, 10.0),
    "motor.rated_torque_nm": (0.05, 200.0),
    "motor.peak_torque_nm": (0.1, 600.0),
    "motor.encoder_counts_per_rev": (500.0, 2.0**25),
    "motor.max_speed_rad_s": (50.0, 1300.0),
    "motor.overload_time_s": (0.1, 30.0),
    "gearbox.ratio": (1.0, 100.0),
    "gearbox.inertia_kg_m2": (0.0, 0.02),
    "coupling.inertia_kg_m2": (0.0, 0.02),
    "coupling.stiffness_nm_rad": (5.0, 1e6),
    "pulley.effective_radius_m": (5e-3, 0.15),
    "pulley.inertia_kg_m2": (1e-7, 0.1),
    "belt.specific_stiffness_n": (1e4, 1e7),
    "belt.pitch_m": (1.9e-3, 0.021),
    "belt.pulley_distance_m": (0.1, 20.0),
    "travel.min_m": (-3.0, 3.0),
    "travel.max_m": (0.02, 20.0),
    "travel.driven_side_offset_m": (0.0, 5.0),
    "limits.speed_m_s": (0.05, 15.0),
    "limits.acceleration_m_s2": (0.5, 200.0),
    "limits.feed_force_n": (10.0, 2e4),
    "limits.pulley_torque_nm": (0.1, 1e3),
    "payload.mass_kg": (0.0, 1e3),
    "targets.following_error_m": (1e-5, 0.02),
    "targets.settled_error_m": (1e-6, 5e-3),
    "targets.distance_m": (0.01, 20.0),
}
Kind = Literal["axes", "motors"]


def _usual_range(entry: str, kind: str) -> tuple[float, float]:
    """Range that most axes of a kind have, SI or degrees, for an entry as their files name it."""
    own = KINDS.get(kind)
    if own is not None and entry in own.renamed:
        return own.renamed[entry].usual or (-math.inf, math.inf)
    return USUAL.get(entry, (-math.inf, math.inf))


def usual(entry: str, value: float, kind: str = "") -> bool:
    """True if a value of an entry is in the range that most axes have.

    Parameters
    ----------
    entry : str
        ``SECTION.NAME`` of axis.yaml.
    value : float
        In the unit of the entry's name.
    kind : str
        Kind of axis; "" for a belt.
    """
    low, high = _usual_range(entry, kind)
    return low <= value <= high


def usual_words(entry: str, kind: str) -> str:
    """The usual range, in the units that people think in.

    Parameters
    ----------
    entry : str
        ``SECTION.NAME`` of axis.yaml.
    kind : str
        Kind of axis; "" for a belt.

    Returns
    -------
    str
        Both ends with their units.
    """
    name = entry.partition(".")[2]
    return " ... ".join(in_words(name, value) for value in _usual_range(entry, kind))


def in_words(name: str, value: float) -> str:
    """A value in the units that people think in: ``64 000 rpm``, ``0.449 kg cm²``, ``12.4 mm (78 mm/rev)``.

    Parameters
    ----------
    name : str
        Of the entry, with its unit as suffix.
    value : float, SI
        Of the entry.
    """
    if name == "encoder_counts_per_rev":
        bits = math.log2(value) if value > 0.0 else 0.0
        return f"{value:.0f}" + (f" ({bits:.0f} bit)" if bits == round(bits) else "")
    if name == "effective_radius_m":
        return f"{short(1e3 * value)} mm ({short(1e3 * math.tau * value)} mm/rev)"
    suffix = suffix_of(name)
    shown, factor = {
        "rad_s": ("rpm", 60.0 / math.tau),
        "kg_m2": ("kg cm²", 1e4),
        "m": ("mm", 1e3),
        "n_m": ("N/µm", 1e-6) if abs(value) >= 1e5 else ("N/m", 1.0),
        "s": ("ms", 1e3) if abs(value) < 0.1 else ("s", 1.0),
        "n": ("kN", 1e-3) if abs(value) >= 1e4 else ("N", 1.0),
    }.get(suffix, (unit_of(name), 1.0))
    return f"{short(value * factor)} {shown}".rstrip()


def parts(kind: Kind) -> dict[str, dict[str, Any]]:
    """All of a kind by name, each with its title and source.

    Parameters
    ----------
    kind : Kind
        Key of the catalogue of parts.

    Returns
    -------
    dict of str to dict of str to Any
        Of the shipped file ``catalogue/parts``.
    """
    found: Mapping[str, Any] = read_yaml(find_config("catalogue", "parts"))[kind]
    return {str(name): dict(entry) for name, entry in found.items()}


def with_part(data: Mapping[str, Any], kind: Kind, name: str) -> dict[str, Any]:
    """``data``, in the shape of axis.yaml, with an axis or a motor of the catalogue.

    Parameters
    ----------
    data : mapping of str to Any
        Is left as it is.
    kind : Kind
        Key of the catalogue of parts.
    name : str
        Of the part.

    Raises
    ------
    UsageError
        For a name that is not there.
    """
    known = parts(kind)
    if name not in known:
        word = "motor" if kind == "motors" else "axis"
        raise UsageError(f"no {word} of the catalogue is called {name!r}{did_you_mean(name, known)}; there are {', '.join(known)}")
    entry = {key: value for key, value in known[name].items() if key not in ("title", "source")}
    title = str(known[name]["title"])
    if kind == "motors":
        return {**data, "motor": {**data.get("motor", {}), "name": title, **entry}}
    merged = {section: {**data.get(section, {}), **values} for section, values in entry.items()}
    return {**data, **merged, "name": data.get("name") or title.partition(" (")[0]}
