"""Compilation of numeric loops, on every machine: cached where a folder can be written, in memory where none can; linear
algebra in one thread."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache, wraps
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar, cast

from beltcomm import machine_code  # before numba, which reads settings where it is loaded first

# isort: split
import numba
from numba.core import event

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

_P = ParamSpec("_P")
_R = TypeVar("_R")

#: Options of numba that its types do not know.
_NO_WAY_IN: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
_FROM_PYTHON: dict[str, Any] = {"no_cfunc_wrapper": True}  # nothing here is called from C
_LANES: dict[str, Any] = _FROM_PYTHON | {"error_model": "numpy", "fastmath": {"contract"}}


def compiled(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """numba's ``njit`` with the types of the function kept.

    The machine code is kept beside the source, or in the user's cache where the package is read-only.  Where neither can be
    written it lives as long as the process.

    Parameters
    ----------
    function : callable
        Of numbers and arrays.

    Returns
    -------
    callable
        The same call, compiled when it is first called.
    """
    return cast("Callable[_P, _R]", _kept(numba.njit(**_FROM_PYTHON)(function)))


def within_kernels(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile what compiled functions alone call: nothing of it is cached but inside them, and Python must not call it.

    Without the two ways in for others a short law takes half the time to compile.
    """
    return cast("Callable[_P, _R]", numba.njit(**_NO_WAY_IN)(function))


def inlined(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile what is written out wherever it is called: with sizes that are known there, every step of its loops is laid out.

    Parameters
    ----------
    function : callable
        For compiled callers only.

    Returns
    -------
    callable
        It has no way in from Python.
    """
    return cast("Callable[_P, _R]", numba.njit(**_NO_WAY_IN, error_model="numpy", fastmath={"contract"}, forceinline=True)(function))


def in_lanes(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile loops over neighbours that do not know each other: no test for a division by zero, multiply and add in one.

    With the test the compiler cannot put the neighbours into one register.

    Parameters
    ----------
    function : callable
        Of numbers and arrays.
    """
    return cast("Callable[_P, _R]", _kept(numba.njit(**_LANES)(function)))


def within_lanes(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile what loops in lanes alone call, see :func:`within_kernels`.

    Parameters
    ----------
    function : callable
        For compiled callers only.

    Returns
    -------
    callable
        It has no way in from Python.
    """
    return cast("Callable[_P, _R]", numba.njit(**_NO_WAY_IN, error_model="numpy", fastmath={"contract"})(function))


def _kept(dispatcher: Any) -> Any:
    machine_code.kept(dispatcher)
    return dispatcher


def when_compiling(begun: Callable[[], None], ended: Callable[[], None]) -> None:
    """Call these before and after everything that is really compiled; what is found in the cache, and what another kernel needs, is not.

    Parameters
    ----------
    begun, ended : callable
        Of the outermost one. Nothing is collected meanwhile: a compiler makes much and drops little of it.
    """
    depth, collects = 0, False

    class Listener(event.Listener):
        def on_start(self, event: object) -> None:
            nonlocal depth, collects
            depth += 1
            if depth == 1:
                collects = gc.isenabled()
                gc.disable()
                begun()

        def on_end(self, event: object) -> None:
            nonlocal depth
            depth -= 1
            if depth == 0:
                ended()
                if collects:
                    gc.enable()

    event.register("numba:compile", Listener())  # type: ignore[no-untyped-call]  # numba has no types


@contextmanager
def told_as_compiling() -> Iterator[None]:
    """Count a block for :func:`when_compiling` as one more kernel that is compiled."""
    with event.trigger_event("numba:compile", data={}):
        yield


def in_one_thread(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """A function whose linear algebra stays in its thread.

    Its matrices are small: threads that wait for each other took as much time as all the rest of a diagnosis, and the last digits of
    a sum depended on how many there were.

    Parameters
    ----------
    function : callable
        Of any signature.
    """

    @wraps(function)
    def alone(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        with _pools().limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return alone


@lru_cache(maxsize=1)
def _pools() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401  numpy's and scipy's libraries are two; what is not loaded yet is not found
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()  # type: ignore[no-untyped-call]
