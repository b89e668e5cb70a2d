"""Compilation of numeric loops, on every machine: cached where a folder can be written, in memory where none can."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numba

_P = ParamSpec("_P")
_R = TypeVar("_R")


def compiled(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """numba's ``njit`` with the types of the function kept.

    The machine code is kept beside the source, or in the user's cache where the package is read-only.  Where neither can be
    written (``njit(cache=True)`` raises there, at import) it lives as long as the process.
    """
    try:
        return cast("Callable[_P, _R]", numba.njit(cache=True)(function))
    except RuntimeError:  # "no locator available": numba has found no place for its cache
        return cast("Callable[_P, _R]", numba.njit(function))
