"""Eight neighbours in one register, inside compiled code, where a loop over neighbours would ask each time whether they overlap.

    total = eight(0.0)
    for m in range(n):
        total = total + at(f, 8 * m) * at(p, 8 * m)
    put(out, 0, total)

A processor whose registers hold fewer takes two or four of them.  Arrays are taken as one row of values, whatever their shape, and a place
in it is not checked.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any, Protocol, cast

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]  # it has no types
from numba import types
from numba.core.datamodel.models import PrimitiveModel
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import ConcreteTemplate, infer_global
from numba.extending import intrinsic, register_model
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Neighbours in one vector.
LANES = 8


class Vector(Protocol):
    """Eight float64, as compiled code has them."""

    def __add__(self, other: Vector) -> Vector: ...
    def __sub__(self, other: Vector) -> Vector: ...
    def __mul__(self, other: Vector | float) -> Vector: ...
    def __rmul__(self, other: float) -> Vector: ...
    def __truediv__(self, other: Vector) -> Vector: ...


class _VectorType(types.Type):
    def __init__(self) -> None:
        super().__init__(name=f"Vector{LANES}")


_vector = _VectorType()
_REGISTER = ir.VectorType(ir.DoubleType(), LANES)


@register_model(_VectorType)
class _VectorModel(PrimitiveModel):
    def __init__(self, manager: Any, kind: _VectorType) -> None:
        super().__init__(manager, kind, _REGISTER)  # type: ignore[no-untyped-call]  # numba has no types, here and below


def _spread(builder: Any, value: Any) -> Any:
    one = builder.insert_element(ir.Constant(_REGISTER, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(one, ir.Constant(_REGISTER, ir.Undefined), ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES))


def _place(context: Any, builder: Any, kind: Any, array: Any, place: Any) -> Any:
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [place]), _REGISTER.as_pointer())


def _eight(_context: Any, value: Any) -> Any:
    """The same value eight times."""

    def written(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return _spread(builder, arguments[0])

    return _vector(types.float64), written


def _at(_context: Any, array: Any, place: Any) -> Any:
    """Eight values of an array from a place on."""

    def written(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(_place(context, builder, signature.args[0], *arguments), align=8)

    return _vector(array, types.intp), written


def _put(_context: Any, array: Any, place: Any, vector: Any) -> Any:
    """Set them."""

    def written(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.store(arguments[2], _place(context, builder, signature.args[0], *arguments[:2]), align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, _vector), written


def _teach(symbol: object, name: str) -> None:
    """An operator between two vectors, and between a vector and a number; multiply and add may become one."""

    class Operator(ConcreteTemplate):
        cases = (_vector(_vector, _vector), _vector(_vector, types.float64), _vector(types.float64, _vector))

    infer_global(symbol)(Operator)  # type: ignore[no-untyped-call]

    def written(_context: Any, builder: Any, sig: Any, arguments: Sequence[Any]) -> Any:
        sides = [value if kind is _vector else _spread(builder, value) for kind, value in zip(sig.args, arguments, strict=True)]
        return getattr(builder, name)(*sides, flags=("contract",))

    for one, other in ((_VectorType, _VectorType), (_VectorType, types.Float), (types.Float, _VectorType)):
        lower_builtin(symbol, one, other)(written)  # type: ignore[no-untyped-call]


for _symbol, _name in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul"), (operator.truediv, "fdiv")):
    _teach(_symbol, _name)


def aligned(rows: int, lanes: int) -> Array:
    """Zeros, (rows, lanes), that begin where a line of memory does: a vector that crosses from one line to the next takes longer."""
    line = 8 * LANES
    memory = np.zeros(rows * lanes + LANES)
    first = -memory.ctypes.data % line // 8
    return memory[first : first + rows * lanes].reshape(rows, lanes)


#: As compiled code calls them.
eight = cast("Callable[[float], Vector]", intrinsic(_eight))
at = cast("Callable[[NDArray[Any], int], Vector]", intrinsic(_at))
put = cast("Callable[[NDArray[Any], int, Vector], None]", intrinsic(_put))
