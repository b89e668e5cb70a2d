"""Reach of the sliders: the parts of their ranges that have a design while the other knobs stay."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from beltcomm.control import Prefilter
from beltcomm.design.held_knobs import KnobPlants, highest_position_margin, specification_of, suppression_range
from beltcomm.design.knobs import Knobs
from beltcomm.design.loops import loop_shape
from beltcomm.tuning.ground import RANGES, TITLES, UNITS, SliderSetting

Array = NDArray[np.float64]
#: deg and dB between points of the table.
_MARGIN_STEP, _SUPPRESSION_STEP = 2.0, 0.5


@dataclass(frozen=True)
class FeasibilityTable:
    """possible[i, j] : whether the velocity loop can have margins_deg[i] at suppressions_db[j]."""

    margins_deg: Array
    suppressions_db: Array
    possible: NDArray[np.bool_]


@dataclass(frozen=True)
class Reach:
    """Pieces (low, high) of each knob's range that have a design.

    Attributes
    ----------
    advice : str
        Where the nearest ones are, "" where all is well.
    """

    pieces: dict[str, list[tuple[float, float]]]
    advice: str


def table_of(plants: KnobPlants, prefilter: Prefilter, velocity_filter_s: float) -> FeasibilityTable:
    """Velocity loops possible with one prefilter and T_R, on all plants; about a second."""
    shape = loop_shape(plants.search, prefilter, velocity_filter_s)
    (low, high), (least, most) = RANGES["phase_margin_deg"], RANGES["suppression_db"]
    margins, suppressions = np.arange(low, high + 1e-9, _MARGIN_STEP), np.arange(least, most + 1e-9, _SUPPRESSION_STEP)
    asked = specification_of(Knobs(), prefilter, velocity_filter_s)
    rows = [suppression_range(shape, plants.structure, replace(asked, phase_margin_deg=float(m)), suppressions) for m in margins]
    return FeasibilityTable(margins, suppressions, np.array(rows))


def reach_of(table: FeasibilityTable, setting: SliderSetting, plants: KnobPlants, prefilter: Prefilter) -> Reach:
    """Reach of the knobs of a setting.

    Parameters
    ----------
    table : FeasibilityTable
        Of its prefilter and T_R.
    """
    column = table.possible[:, int(np.argmin(np.abs(table.suppressions_db - setting.suppression_db)))]
    row = table.possible[int(np.argmin(np.abs(table.margins_deg - setting.phase_margin_deg)))]
    pieces = {
        "phase_margin_deg": _pieces(table.margins_deg, column),
        "suppression_db": _pieces(table.suppressions_db, row),
    }
    asked = specification_of(setting.knobs, prefilter, setting.velocity_filter_s)
    shape = loop_shape(plants.search, prefilter, setting.velocity_filter_s)
    low, high = RANGES["position_phase_margin_deg"]
    most = min(highest_position_margin(shape, plants.structure, asked), high)
    pieces["position_phase_margin_deg"] = [(low, most)] if most > low else []
    return Reach(pieces, _advice(setting, pieces, most == 0.0))


def _advice(setting: SliderSetting, pieces: dict[str, list[tuple[float, float]]], no_velocity_loop: bool) -> str:
    names = ("phase_margin_deg", "suppression_db") if no_velocity_loop else ("position_phase_margin_deg",)
    if not no_velocity_loop and any(low <= setting.position_phase_margin_deg <= high for low, high in pieces[names[0]]):
        return ""
    ways = [way for name in names if (way := _way(name, getattr(setting, name), pieces[name]))]
    if ways:
        return f"Possible with the other sliders as they are: {', or '.join(ways)}."
    return "Nothing is possible with the other sliders as they are: lower both phase margins, or choose another prefilter or filter time."


def _way(name: str, value: float, pieces: list[tuple[float, float]]) -> str:
    """Way that one slider would have to go."""
    if not pieces:
        return ""
    low, high = min(pieces, key=lambda piece: max(piece[0] - value, value - piece[1]))
    unit = UNITS[name]
    return f"{TITLES[name]} {'at most' if value > high else 'at least'} {high if value > high else low:.1f} {unit}"


def _pieces(values: Array, possible: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Runs of neighbours that are possible."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], possible, [False]])))
    return [(float(values[start]), float(values[end - 1])) for start, end in edges.reshape(-1, 2)]
