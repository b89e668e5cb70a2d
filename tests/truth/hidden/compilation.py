"""The compiler of the kernels; its cache knows that a kernel changes with the modules that it calls."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba

P = ParamSpec("P")
R = TypeVar("R")

_SOURCES = ("layout.py", "laws.py", "kernel.py", "drive.py", "recorder.py", "visibility.py", "compilation.py")
_STAMP = hashlib.sha256(b"".join((Path(__file__).parent / name).read_bytes() for name in _SOURCES)).hexdigest()


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """``numba.njit`` with its type kept; a division by zero gives inf, found by the check for finite numbers.

    numba's cache looks at the file of the function alone, so that a caller in another file would go on with the old callee:
    a truth that silently is yesterday's. Here the cache is valid for one content of all kernels.
    """
    decorate: Any = numba.njit(cache=True, error_model="numpy")
    result = decorate(function)
    result._cache._cache_file._source_stamp = _STAMP
    typed: Callable[P, R] = result
    return typed
