"""Seconds left and places, in words."""

from __future__ import annotations

from collections.abc import Callable

from beltcomm.language import tr
from beltcomm.talk import CarriagePosition

#: s and share of a calculation after which its pace tells how long it will still take.
PACE_S, PACE_SHARE = 1.0, 0.05

#: What a place says of a load that is no carriage.
_AT = {"load": "load at", "table": "table at"}


class Pace:
    """Seconds left in a phase: on the machine they are known, in a calculation its pace so far tells them.

    Parameters
    ----------
    clock : callable
        Wall clock, s.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self.begin()

    def begin(self) -> None:
        """A phase begins now."""
        self._begun_s = self._clock()

    def left(self, fraction: float, seconds_left: float | None) -> str:
        """In words; nothing while it cannot be told.

        Parameters
        ----------
        fraction : float, 0 to 1
        seconds_left : float or None
            On the machine; None for a calculation, whose pace is measured.
        """
        if seconds_left is not None:
            return tr(", {s:.0f} s left", s=seconds_left) if seconds_left >= 1.0 else ""
        passed_s = self._clock() - self._begun_s
        if not PACE_SHARE <= fraction < 1.0 or passed_s < PACE_S:
            return ""
        return tr(", about {s:.0f} s left", s=passed_s * (1.0 - fraction) / fraction)


def machine_left(place: CarriagePosition) -> str:
    """Time that the whole job still takes on the machine; nothing where it is not known.

    Parameters
    ----------
    place : CarriagePosition
        Of the carriage.
    """
    return "" if place.left_s is None else tr("{s:.0f} s left on the machine", s=place.left_s)


def clock_words(seconds: float) -> str:
    """A time as ``00:41``, minutes and seconds.

    Parameters
    ----------
    seconds : float, s
        Rounded down.
    """
    return f"{int(seconds) // 60:02d}:{int(seconds) % 60:02d}"


def millimetres(position_m: float, place: CarriagePosition) -> str:
    """A position on the axis, or from where the carriage stood, then with its sign.

    Parameters
    ----------
    position_m : float, m
        Carriage on the axis.
    place : CarriagePosition
        Of the carriage.
    """
    value = round(1e3 * position_m)
    unit = place.unit if place.unit == "°" else f" {place.unit}"
    return f"{value:d}{unit}" if place.known else f"{value:+d}{unit}"


def load_at(place: CarriagePosition) -> str:
    """``carriage at 250 mm``, and what else moves.

    Parameters
    ----------
    place : CarriagePosition
        Of the carriage.
    """
    return f"{tr(_AT.get(place.load, 'carriage at'))} {millimetres(place.position_m, place)}"
