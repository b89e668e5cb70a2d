"""Laws about one model turned into laws about eight: without branches, on the functions of ``vectors``.

    if x >= half:               becomes    return either(x >= half, x, either(x <= -half, 0.0, ...))
        return x
    if x <= -half:
        return 0.0
    ...

All branches are worked out and one of them is taken, so a division by zero in the others does no harm.
"""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any

from beltcomm.compiled import within_lanes
from beltcomm.simulate.kernels import fast_math, vectors

_math = ModuleType("math")
_math.__dict__.update(vars(math))
_math.__dict__.update(sin=fast_math.sin, cos=fast_math.cos, exp=vectors.exp, pow=vectors.power)
#: What stands for Python's own.
_INSTEAD = {"abs": vectors.size, "min": vectors.least, "max": vectors.most, "either": vectors.either}


def in_vectors(law: Callable[..., Any]) -> Callable[..., Any]:
    """The law, and every compiled function that it calls, for eight values in a register.

    Parameters
    ----------
    law : callable
        Of plain floats, compiled or not.

    Raises
    ------
    ValueError
        For a law with a loop, or with a branch that does not end with a value or sets what another one asks for.
    """
    plain = getattr(law, "py_func", law)
    seen = plain.__globals__ | _INSTEAD
    for name in plain.__code__.co_names:
        if seen.get(name) is math:
            seen[name] = _math
        elif hasattr(seen.get(name), "py_func"):
            seen[name] = in_vectors(seen[name])
    (definition,) = ast.parse(textwrap.dedent(inspect.getsource(plain))).body
    assert isinstance(definition, ast.FunctionDef)
    definition.decorator_list, definition.returns = [], None
    for argument in definition.args.args:
        argument.annotation = None
    definition.body = _straight(plain.__name__, definition.body)
    tree = ast.fix_missing_locations(_Chosen().visit(ast.Module([definition], [])))
    exec(compile(tree, f"<{plain.__name__} in vectors>", "exec"), seen)
    found: Callable[..., Any] = within_lanes(seen[plain.__name__])
    return found


def _straight(name: str, body: Sequence[ast.stmt]) -> list[ast.stmt]:
    """Statements without a branch, the last of which returns."""
    out: list[ast.stmt] = []
    for number, statement in enumerate(body):
        if isinstance(statement, ast.Return):
            return [*out, statement]
        if isinstance(statement, ast.If):
            yes = _straight(name, statement.body)
            no = _straight(name, [*statement.orelse, *body[number + 1 :]])
            here, there = yes[-1], no[-1]
            assert isinstance(here, ast.Return)
            assert isinstance(there, ast.Return)
            assert here.value is not None
            assert there.value is not None
            if _names(yes[:-1], ast.Store) & _names(no, ast.Load):
                raise ValueError(f"{name} cannot be written without branches: one branch sets what another one asks for")
            return [*out, *yes[:-1], *no[:-1], ast.Return(ast.IfExp(statement.test, here.value, there.value))]
        if isinstance(statement, ast.Assign) or (isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)):
            out.append(statement)
            continue
        break
    raise ValueError(f"{name} cannot be written without branches: every branch must end with a value, and there may be no loop")


def _names(statements: Sequence[ast.stmt], use: type[ast.expr_context]) -> set[str]:
    found = (node for statement in statements for node in ast.walk(statement))
    return {node.id for node in found if isinstance(node, ast.Name) and isinstance(node.ctx, use)}


class _Chosen(ast.NodeTransformer):
    """Choices and alternatives as calls and operators."""

    def visit_IfExp(self, node: ast.IfExp) -> ast.expr:
        self.generic_visit(node)
        return ast.Call(ast.Name("either", ast.Load()), [node.test, node.body, node.orelse], [])

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.expr:
        self.generic_visit(node)
        if not isinstance(node.op, ast.Or):
            raise ValueError("vectors know of no other alternative than `or`")
        first, *others = node.values
        for other in others:
            first = ast.BinOp(first, ast.BitOr(), other)
        return first
