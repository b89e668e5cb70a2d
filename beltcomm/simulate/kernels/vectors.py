"""Eight neighbours in one register, inside compiled code, where a loop over neighbours would ask each time whether they overlap.

    total = eight(0.0)
    for m in range(n):
        total = total + at(f, 8 * m) * at(p, 8 * m)
    put(out, 0, total)

A processor whose registers hold fewer takes two or four of them.  Arrays are taken as one row of values, whatever their shape, and a place
in it is not checked.

Arrays of different lengths in one compiled loop are taken by the address of their memory, without a copy.

A loop in lock step over many arrays can neither take them as one array, which would copy them all, nor as a tuple, whose members are
counted as used at every access.  Whoever hands addresses over keeps the arrays alive, contiguous and long enough: nothing is checked.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any, Protocol, cast

import beltcomm.compiled  # noqa: F401  # numba is loaded there, apart from the working directory

# isort: split
import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]  # it has no types
from numba import types
from numba.core.datamodel.models import PrimitiveModel
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import ConcreteTemplate, infer_global
from numba.extending import intrinsic, register_model
from numpy.typing import NDArray

from beltcomm.arrays import Array

# isort: split


#: Neighbours in one vector.
LANES = 8


class Mask(Protocol):
    """Eight answers to one question."""

    def __or__(self, other: Mask) -> Mask: ...


class Vector(Protocol):
    """Eight float64, as compiled code has them."""

    def __neg__(self) -> Vector: ...
    def __add__(self, other: Vector) -> Vector: ...
    def __sub__(self, other: Vector) -> Vector: ...
    def __gt__(self, other: Vector | float) -> Mask: ...
    def __mul__(self, other: Vector | float) -> Vector: ...
    def __rmul__(self, other: float) -> Vector: ...
    def __truediv__(self, other: Vector) -> Vector: ...


class _VectorType(types.Type):
    def __init__(self) -> None:
        super().__init__(name=f"Vector{LANES}")


class _MaskType(types.Type):
    def __init__(self) -> None:
        super().__init__(name=f"Mask{LANES}")


_vector, _mask = _VectorType(), _MaskType()
_REGISTER, _ANSWERS = ir.VectorType(ir.DoubleType(), LANES), ir.VectorType(ir.IntType(1), LANES)


@register_model(_VectorType)
class _VectorModel(PrimitiveModel):
    def __init__(self, manager: Any, kind: _VectorType) -> None:
        super().__init__(manager, kind, _REGISTER)  # type: ignore[no-untyped-call]  # numba has no types, here and below


@register_model(_MaskType)
class _MaskModel(PrimitiveModel):
    def __init__(self, manager: Any, kind: _MaskType) -> None:
        super().__init__(manager, kind, _ANSWERS)  # type: ignore[no-untyped-call]


def _broadcast_value(builder: Any, value: Any) -> Any:
    one = builder.insert_element(ir.Constant(_REGISTER, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(one, ir.Constant(_REGISTER, ir.Undefined), ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES))


def _place(context: Any, builder: Any, kind: Any, array: Any, place: Any) -> Any:
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [place]), _REGISTER.as_pointer())


def _eight(_context: Any, value: Any) -> Any:
    """One value in all eight lanes."""

    def written(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return _broadcast_value(builder, arguments[0])

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


def _either(_context: Any, mask: Any, one: Any, other: Any) -> Any:
    """Select of two vectors by a mask."""

    def written(_context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        sides = (_as_vector(builder, kind, value) for kind, value in zip(signature.args[1:], arguments[1:], strict=True))
        return builder.select(arguments[0], *sides)

    return _vector(mask, one, other), written


def _of_two(_context: Any, one: Any, other: Any, larger: bool) -> Any:
    def written(_context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        a, b = (_as_vector(builder, kind, value) for kind, value in zip(signature.args, arguments, strict=True))
        return builder.select(builder.fcmp_ordered("<" if larger else ">", a, b), b, a)

    return _vector(one, other), written


def _most(context: Any, one: Any, other: Any) -> Any:
    """The larger of two."""
    return _of_two(context, one, other, larger=True)


def _least(context: Any, one: Any, other: Any) -> Any:
    """The smaller of two."""
    return _of_two(context, one, other, larger=False)


def _known_function(name: str, arguments: int) -> Callable[..., Any]:
    """A function that the compiler knows itself, of so many vectors."""

    def typed(_context: Any, *given: Any) -> Any:
        def written(_context: Any, builder: Any, signature: Any, values: Any) -> Any:
            kind, known = ir.FunctionType(_REGISTER, [_REGISTER] * arguments), f"llvm.{name}.v{LANES}f64"
            function = builder.module.globals.get(known) or ir.Function(builder.module, kind, known)
            return builder.call(function, [_as_vector(builder, k, value) for k, value in zip(signature.args, values, strict=True)])

        return _vector(*given), written

    if arguments == 1:
        return lambda context, x: typed(context, x)
    return lambda context, x, y: typed(context, x, y)


def _as_vector(builder: Any, kind: Any, value: Any) -> Any:
    return value if kind is _vector else _broadcast_value(builder, value)


def _teach(symbols: Sequence[object], result: types.Type, write: Callable[[Any, Sequence[Any]], Any]) -> None:
    """An operator between two vectors, and between a vector and a number."""
    for symbol in symbols:

        class Operator(ConcreteTemplate):
            cases = (result(_vector, _vector), result(_vector, types.float64), result(types.float64, _vector))

        infer_global(symbol)(Operator)  # type: ignore[no-untyped-call]

        def written(_context: Any, builder: Any, sig: Any, arguments: Sequence[Any]) -> Any:
            return write(builder, [_as_vector(builder, kind, value) for kind, value in zip(sig.args, arguments, strict=True)])

        for one, other in ((_VectorType, _VectorType), (_VectorType, types.Float), (types.Float, _VectorType)):
            lower_builtin(symbol, one, other)(written)  # type: ignore[no-untyped-call]


def _teach_all() -> None:
    for name in ("add", "sub", "mul", "truediv"):
        operation = "f" + name.removeprefix("true")
        both = (getattr(operator, name), getattr(operator, "i" + name))
        # Multiply and add may become one.
        _teach(both, _vector, lambda builder, sides, o=operation: getattr(builder, o)(*sides, flags=("contract", "arcp")))  # type: ignore[misc]
    for name, sign in (("lt", "<"), ("le", "<="), ("gt", ">"), ("ge", ">="), ("eq", "=="), ("ne", "!=")):
        _teach((getattr(operator, name),), _mask, lambda builder, sides, s=sign: builder.fcmp_ordered(s, *sides))  # type: ignore[misc]

    class Negative(ConcreteTemplate):
        cases = (_vector(_vector),)

    class Or(ConcreteTemplate):
        cases = (_mask(_mask, _mask),)

    infer_global(operator.neg)(Negative)  # type: ignore[no-untyped-call]
    infer_global(operator.or_)(Or)  # type: ignore[no-untyped-call]
    lower_builtin(operator.neg, _VectorType)(lambda _c, builder, _s, given: builder.fneg(given[0]))  # type: ignore[no-untyped-call]
    lower_builtin(operator.or_, _MaskType, _MaskType)(lambda _c, builder, _s, given: builder.or_(*given))  # type: ignore[no-untyped-call]


_teach_all()


def aligned_zeros(rows: int, lanes: int) -> Array:
    """Zeros, (rows, lanes), that begin where a line of memory does: a vector that crosses from one line to the next takes longer.

    Parameters
    ----------
    rows, lanes : int
        Of the result.
    """
    line = 8 * LANES
    memory = np.zeros(rows * lanes + LANES)
    first = -memory.ctypes.data % line // 8
    return memory[first : first + rows * lanes].reshape(rows, lanes)


#: As compiled code calls them.
eight = cast("Callable[[float], Vector]", intrinsic(_eight))
at = cast("Callable[[NDArray[Any], int], Vector]", intrinsic(_at))
put = cast("Callable[[NDArray[Any], int, Vector], None]", intrinsic(_put))
either = cast("Callable[[Mask, Vector | float, Vector | float], Vector]", intrinsic(_either))
most = cast("Callable[[Vector, Vector | float], Vector]", intrinsic(_most))
least = cast("Callable[[Vector, Vector | float], Vector]", intrinsic(_least))
size = cast("Callable[[Vector], Vector]", intrinsic(_known_function("fabs", 1)))
exp = cast("Callable[[Vector], Vector]", intrinsic(_known_function("exp", 1)))
power = cast("Callable[[Vector, Vector | float], Vector]", intrinsic(_known_function("pow", 2)))


def address(array: NDArray[Any]) -> int:
    """Address of the first value.

    Parameters
    ----------
    array : ndarray
        Contiguous.

    Raises
    ------
    ValueError
        For an array whose values do not stand one behind the other.
    """
    if not array.flags.c_contiguous:
        raise ValueError("only the address of a contiguous array says where its values are")
    return array.ctypes.data


def _element(builder: Any, kind: ir.Type, first: Any, number: Any) -> Any:
    return builder.gep(builder.inttoptr(first, kind.as_pointer()), [number])


def _number_at(_context: Any, first: Any, number: Any) -> Any:
    """Value ``number`` of the float64 array at an address."""

    def written(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.load(_element(builder, ir.DoubleType(), *arguments))

    return types.float64(types.intp, types.intp), written


def _set_number(_context: Any, first: Any, number: Any, value: Any) -> Any:
    """Set it."""

    def written(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        builder.store(arguments[2], _element(builder, ir.DoubleType(), *arguments[:2]))
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, types.float64), written


def _flag_at(_context: Any, first: Any, number: Any) -> Any:
    """Value ``number`` of the bool array at an address, 0 or 1."""

    def written(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.zext(builder.load(_element(builder, ir.IntType(8), *arguments)), ir.IntType(64))

    return types.intp(types.intp, types.intp), written


def _set_flag(_context: Any, first: Any, number: Any, value: Any) -> Any:
    """Set it."""

    def written(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        builder.store(builder.trunc(arguments[2], ir.IntType(8)), _element(builder, ir.IntType(8), *arguments[:2]))
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, types.intp), written


#: As compiled code calls them, with an address first.
number_at = cast("Callable[[int, int], float]", intrinsic(_number_at))
set_number = cast("Callable[[int, int, float], None]", intrinsic(_set_number))
flag_at = cast("Callable[[int, int], int]", intrinsic(_flag_at))
set_flag = cast("Callable[[int, int, int], None]", intrinsic(_set_flag))
