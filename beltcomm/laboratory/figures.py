"""Figures of a model that results quote and run folders keep."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PlainError:
    """Error of a model in plain units.

    Attributes
    ----------
    error, noise, torque : float
        rms in the band, in ``unit`` at the motor shaft (N at the load side).
    percent : float
        Error of the torque.
    band_hz : float, Hz
        Up to which all of them are.
    """

    error: float
    noise: float
    torque: float
    percent: float
    unit: str
    band_hz: float


#: Of the fitted records and of those held out; None where there are none.
Plain = tuple[PlainError | None, PlainError | None]
