"""The same work on several things at once, in threads: compiled loops let go of the interpreter, results come in the order of the things.

As many threads as numba uses (``NUMBA_NUM_THREADS``), which those who start many processes set to 1.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import TypeVar

import numba

_T = TypeVar("_T")
_R = TypeVar("_R")
THREADS: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
_inside = threading.local()


def side_by_side(function: Callable[[_T], _R], things: Iterable[_T]) -> list[_R]:
    """``[function(thing) for thing in things]``; in one thread where there is one core or one thing, or within such work."""
    listed = list(things)
    if len(listed) < 2 or THREADS < 2 or getattr(_inside, "work", False):
        return [function(thing) for thing in listed]
    return list(_pool().map(function, listed))


@lru_cache(maxsize=1)
def _pool() -> ThreadPoolExecutor:
    def begin() -> None:
        _inside.work = True

    return ThreadPoolExecutor(THREADS, "side-by-side", begin)


os.register_at_fork(after_in_child=_pool.cache_clear)  # threads do not come along
