"""Figures of a model that results quote and run folders keep."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PlainError:
    """error, noise, torque : rms in the band, in ``unit`` at the motor shaft (N at the load side).   percent : error of the torque.
    band_hz : Hz, up to which all of them are."""

    error: float
    noise: float
    torque: float
    percent: float
    unit: str
    band_hz: float
