"""The API reference is made without importing the package: what api.__all__ names must be bound where a reader of the source sees it."""

from __future__ import annotations

import ast
from pathlib import Path

from beltcomm import api


def test_every_public_name_is_defined_or_imported_by_a_statement_of_its_own() -> None:
    tree = ast.parse(Path(api.__file__).read_text(encoding="utf-8"))
    bound: set[str] = set()
    for statement in tree.body:
        if isinstance(statement, ast.ImportFrom):
            bound |= {alias.asname or alias.name for alias in statement.names}
        elif isinstance(statement, ast.FunctionDef | ast.ClassDef):
            bound.add(statement.name)
    assert set(api.__all__) - bound == set()


def test_every_public_name_says_what_it_is() -> None:
    assert {name for name in api.__all__ if not getattr(api, name).__doc__} == set()
