"""Records that tell twins apart, as steps of a plan file (``beltcomm.schedule.steps``), and what is done by hand for them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from beltcomm.effects._effect import ManualCheck

Record = Mapping[str, Any]

#: After a change by hand the axis is another one: its records stand in a run of their own.
AGAIN = "`beltcomm commission --drive DRIVE --run RUN_AFTER` (a run of its own) and `beltcomm diagnose RUN_AFTER`"
#: Hz up to which lags and dead times are told apart by magnitude; s of such a record: three times the usual.
WIDE_HZ, LONG_S = 250.0, 20.0
#: Shares of the excitation between friction and the limits at which a carriage hardly leaves its place.
TINY = (0.01, 0.05)
#: Shares of the travel.
MIDDLE, ENDS = 0.5, (0.12, 0.88)


def wide(*places: float) -> tuple[Record, ...]:
    """Loud, long excitations up to ``WIDE_HZ``.

    Parameters
    ----------
    places : float
        Shares of the travel.
    """
    return tuple({"kind": "response", "place": place, "seconds": LONG_S, "up_to_hz": WIDE_HZ} for place in places)


def tiny() -> tuple[Record, ...]:
    """Excitations hardly above friction."""
    return tuple({"kind": "response", "place": MIDDLE, "share": share, "seconds": LONG_S} for share in TINY)


def slow(*places: float) -> tuple[Record, ...]:
    """Strokes below the speed at which grease carries, and far below.

    Parameters
    ----------
    places : float
        Shares of the travel.
    """
    return tuple({"kind": "strokes", "place": place, "speeds_m_s": [0.003, 0.006, 0.015, 0.04]} for place in places)


def sweep(*speeds_m_s: float) -> tuple[Record, ...]:
    """Strokes over the whole travel.

    Parameters
    ----------
    speeds_m_s : float, m/s
        Of the carriage.
    """
    return ({"kind": "sweep", "speeds_m_s": list(speeds_m_s)},)


def reversals() -> tuple[Record, ...]:
    """Triangles, the smallest within elastic friction."""
    return ({"kind": "reversals", "place": MIDDLE, "amplitudes_m": [1e-3, 4e-4, 2e-4, 1e-4]},)


def moves() -> tuple[Record, ...]:
    """Fast moves at two forces, and random ones to judge with."""
    return (
        {"kind": "moves", "share": 0.9},
        {"kind": "moves", "share": 0.45},
        {"kind": "moves", "share": 0.6, "seconds": 10.0, "seed": 3, "held_out": True},
    )


def belt_off(stays: str, goes: str) -> ManualCheck:
    """Manual check: the motor alone.

    Parameters
    ----------
    stays, goes : str
        What each outcome means.

    Returns
    -------
    ManualCheck
        Deed, how it is recorded, and what it tells.
    """
    return ManualCheck(
        "take the belt off and let the drive turn the motor slowly",
        "log torque and angle with the drive's own scope over some turns and `beltcomm import` them",
        f"what stays is {stays}, what is gone was {goes}",
    )
