"""One parameter value with its unit, interval, bounds and origin."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from beltcomm.result import with_unit

#: Half width of a 95 % interval over the standard deviation of a normal estimate.
NORMAL_95 = 1.96


@dataclass(frozen=True)
class Value:
    """One parameter value; as text it reads ``0.9608 ± 0.0037 kg``, with its 95 % interval. ``float(value)``, ``f"{value:.3f}"`` and
    arithmetic take it as its number.

    Attributes
    ----------
    low, high : float
        Bounds of the parameter, same unit: what can be, not what was found.
    interval : float or None
        Half width of its 95 % interval, same unit; None when it is not an estimate.
    """

    value: float
    unit: str
    side: str
    low: float
    high: float
    interval: float | None = None
    origin: str = ""

    @property
    def interval_95(self) -> tuple[float, float] | None:
        """Both ends of its 95 % interval, same unit; None when it is not an estimate."""
        if self.interval is None or not math.isfinite(self.interval):
            return None
        return self.value - self.interval, self.value + self.interval

    def __float__(self) -> float:
        return self.value

    def __format__(self, spec: str) -> str:
        return format(self.value, spec) if spec else str(self)

    def __add__(self, other: Any) -> Any:
        return self.value + other

    def __radd__(self, other: Any) -> Any:
        return other + self.value

    def __sub__(self, other: Any) -> Any:
        return self.value - other

    def __rsub__(self, other: Any) -> Any:
        return other - self.value

    def __mul__(self, other: Any) -> Any:
        return self.value * other

    def __rmul__(self, other: Any) -> Any:
        return other * self.value

    def __truediv__(self, other: Any) -> Any:
        return self.value / other

    def __rtruediv__(self, other: Any) -> Any:
        return other / self.value

    def __pow__(self, other: Any) -> Any:
        return self.value**other

    def __neg__(self) -> float:
        return -self.value

    def __abs__(self) -> float:
        return abs(self.value)

    def __str__(self) -> str:
        half = "" if self.interval_95 is None else f" ± {self.interval:.2g}"
        return with_unit(f"{self.value:.4g}{half}", self.unit)
