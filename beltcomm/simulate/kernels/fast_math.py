"""Sine, cosine, exponential and power for kernels: no calls, no branches, so that several stand in one register; 1e-15 from those of
``math``, a power 1e-16 times its logarithm.

A law compiled with :func:`fast` sees them in the place of ``math``'s.  A division by zero gives inf or nan there, it does not raise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from types import FunctionType, ModuleType
from typing import Any

import beltcomm.compiled  # noqa: F401  # numba is loaded there, apart from the working directory

# isort: split
import numba
import numpy as np

from beltcomm.arrays import Array

#: 1.5 · 2⁵²: added and taken away again, it rounds to a whole number.
_ROUND = 6755399441055744.0
_PI = Fraction(314159265358979323846264338327950288419716939937510582097494459, 10**62)
_LN2 = Fraction(69314718055994530941723212145817656807550013436025525412068, 10**59)


def _split(value: Fraction, bits: int) -> tuple[float, Fraction]:
    """The leading bits, whose product with a whole number of few digits is exact, and what is left."""
    scale = Fraction(2) ** (bits - math.frexp(float(value))[1])
    leading = Fraction(int(value * scale)) / scale
    return float(leading), value - leading


_PI_1, _rest = _split(_PI, 30)
_PI_2, _rest = _split(_rest, 30)
_PI_3 = float(_rest)
_LN2_1, _rest = _split(_LN2, 32)
_LN2_2 = float(_rest)
_PER_PI, _PER_LN2 = 1.0 / math.pi, 1.0 / math.log(2.0)
_S1, _S2, _S3, _S4, _S5, _S6, _S7, _S8, _S9 = ((-1.0) ** k / math.factorial(2 * k + 1) for k in range(1, 10))
_C1, _C2, _C3, _C4, _C5, _C6, _C7, _C8, _C9, _C10 = ((-1.0) ** k / math.factorial(2 * k) for k in range(1, 11))
_L3, _L5, _L7, _L9, _L11, _L13, _L15, _L17, _L19, _L21 = (2.0 / k for k in range(3, 22, 2))
_ROOT_HALF = int(np.float64(math.sqrt(0.5)).view(np.int64))
_E2, _E3, _E4, _E5, _E6, _E7, _E8, _E9, _E10, _E11, _E12 = (1.0 / math.factorial(k) for k in range(2, 13))

_inlined: Callable[[Any], Any] = numba.njit(error_model="numpy", fastmath={"contract"})


@_inlined
def _half_turns(x: float) -> tuple[float, float]:
    """Remainder of x, rad, beside whole half turns, within ±π/2; and the sign that these give, 1 or -1."""
    n = (x * _PER_PI + _ROUND) - _ROUND
    odd = n - 2.0 * ((n * 0.5 + _ROUND) - _ROUND)
    return ((x - n * _PI_1) - n * _PI_2) - n * _PI_3, 1.0 - 2.0 * odd * odd


@_inlined
def sin(x: float) -> float:
    """sin x by its series within ±π/2; x up to 1e8.

    Parameters
    ----------
    x : float, rad
        Up to 1e8.
    """
    r, sign = _half_turns(x)
    z = r * r
    z2 = z * z
    z4 = z2 * z2
    low, middle = (_S1 + z * _S2) + z2 * (_S3 + z * _S4), (_S5 + z * _S6) + z2 * (_S7 + z * _S8)
    value: float = (r + r * z * (low + z4 * (middle + z4 * _S9))) * sign
    return value


@_inlined
def cos(x: float) -> float:
    """cos x by its series within ±π/2; x up to 1e8.

    Parameters
    ----------
    x : float, rad
        Up to 1e8.
    """
    r, sign = _half_turns(x)
    z = r * r
    z2 = z * z
    z4 = z2 * z2
    low, middle = (_C1 + z * _C2) + z2 * (_C3 + z * _C4), (_C5 + z * _C6) + z2 * (_C7 + z * _C8)
    value: float = (1.0 + z * (low + z4 * (middle + z4 * (_C9 + z * _C10)))) * sign
    return value


@_inlined
def exp(x: float) -> float:
    """exp x by its series within ±ln 2/2; 3e-308 where it would be less, and no more than at 709."""
    x = min(max(x, -708.0), 709.0)
    n = (x * _PER_LN2 + _ROUND) - _ROUND
    r = (x - n * _LN2_1) - n * _LN2_2
    z = r * r
    z2 = z * z
    low, middle = (_E2 + r * _E3) + z * (_E4 + r * _E5), (_E6 + r * _E7) + z * (_E8 + r * _E9)
    power = np.int64((np.int64(n) + 1023) << 52).view(np.float64)
    return (1.0 + (r + z * (low + z2 * (middle + z2 * ((_E10 + r * _E11) + z * _E12))))) * power


@_inlined
def power(x: float, y: float) -> float:
    """x^y = exp(y ln x) for x ≥ 0, y > 0;  ln x = e ln 2 + 2 artanh((m - 1)/(m + 1)),  x = m 2^e,  m within √½ and √2.

    A square, the usual form of the laws that have a power, is one product: this branch never changes within a record.
    """
    if y == 2.0:
        return x * x
    bits = np.float64(x).view(np.int64)
    e = (bits - _ROOT_HALF) >> 52
    m = np.int64(bits - (e << 52)).view(np.float64)
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    z2 = z * z
    low, middle = (_L3 + z * _L5) + z2 * (_L7 + z * _L9), (_L11 + z * _L13) + z2 * (_L15 + z * _L17)
    value: float = exp(y * (e * _LN2_1 + (e * _LN2_2 + (2.0 * s + s * z * (low + z2 * z2 * (middle + z2 * z2 * (_L19 + z * _L21)))))))
    return value


@numba.njit(error_model="numpy", fastmath={"contract", "reassoc"})  # the sum in as many parts as stand in a register
def waves(angle: float, orders: Array, sizes: Array, phases: Array) -> float:
    """Σ size_k sin(order_k angle + phase_k); fastest for m a multiple of 4."""
    total = 0.0
    for k in range(orders.shape[0]):
        total += sizes[k] * sin(orders[k] * angle + phases[k])
    return total


_math = ModuleType("math")
_math.__dict__.update(vars(math))
_math.__dict__.update(sin=sin, cos=cos, exp=exp, pow=power)


def fast(law: Callable[..., Any]) -> Callable[..., Any]:
    """The law, and every compiled function that it calls, on the functions of this module."""
    plain = getattr(law, "py_func", law)
    seen = {name: plain.__globals__[name] for name in plain.__code__.co_names if name in plain.__globals__}
    for name, value in seen.items():
        if value is math:
            seen[name] = _math
        elif hasattr(value, "py_func"):
            seen[name] = fast(value)
    found = FunctionType(plain.__code__, plain.__globals__ | seen, plain.__name__, plain.__defaults__, plain.__closure__)
    return _inlined(found)  # type: ignore[no-any-return]
