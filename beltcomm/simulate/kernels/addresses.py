"""Arrays of different lengths in one compiled loop: each by the address of its memory, without a copy.

A loop in lock step over many arrays can neither take them as one array, which would copy them all, nor as a tuple, whose members are
counted as used at every access.  Whoever hands addresses over keeps the arrays alive, contiguous and long enough: nothing is checked.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import beltcomm.compiled  # noqa: F401  # numba is loaded there, apart from the working directory

# isort: split
from llvmlite import ir  # type: ignore[import-untyped]  # it has no types
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray


def address(array: NDArray[Any]) -> int:
    """Address of the first value.

    Raises
    ------
    ValueError
        For an array whose values do not stand one behind the other.
    """
    if not array.flags.c_contiguous:
        raise ValueError("only the address of a contiguous array says where its values are")
    return array.ctypes.data


def _place(builder: Any, kind: ir.Type, first: Any, number: Any) -> Any:
    return builder.gep(builder.inttoptr(first, kind.as_pointer()), [number])


def _number_at(_context: Any, first: Any, number: Any) -> Any:
    """Value ``number`` of the float64 array at an address."""

    def written(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.load(_place(builder, ir.DoubleType(), *arguments))

    return types.float64(types.intp, types.intp), written


def _set_number(_context: Any, first: Any, number: Any, value: Any) -> Any:
    """Set it."""

    def written(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        builder.store(arguments[2], _place(builder, ir.DoubleType(), *arguments[:2]))
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, types.float64), written


def _flag_at(_context: Any, first: Any, number: Any) -> Any:
    """Value ``number`` of the bool array at an address, 0 or 1."""

    def written(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.zext(builder.load(_place(builder, ir.IntType(8), *arguments)), ir.IntType(64))

    return types.intp(types.intp, types.intp), written


def _set_flag(_context: Any, first: Any, number: Any, value: Any) -> Any:
    """Set it."""

    def written(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        builder.store(builder.trunc(arguments[2], ir.IntType(8)), _place(builder, ir.IntType(8), *arguments[:2]))
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, types.intp), written


#: As compiled code calls them, with an address first.
number_at = cast("Callable[[int, int], float]", intrinsic(_number_at))
set_number = cast("Callable[[int, int, float], None]", intrinsic(_set_number))
flag_at = cast("Callable[[int, int], int]", intrinsic(_flag_at))
set_flag = cast("Callable[[int, int, int], None]", intrinsic(_set_flag))
