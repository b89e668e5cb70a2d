"""The API reference is made without importing the package: what api.__all__ names must be bound where a reader of the source sees it."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

import beltcomm
from beltcomm import api

CHECKOUT = Path(beltcomm.__file__).parent.parent
TOPS = ("beltcomm", "adapters/beltcomm_adapters")
PAGES = [page for page in (Path(__file__).parents[2] / "docs" / "reference").glob("*.md") if ":::" in page.read_text(encoding="utf-8")]
SHOWN = re.compile(r"^::: (\S+)\n((?: {4}.*\n)*)", re.MULTILINE)


def own(name: str, thing: Any) -> bool:
    return not name.startswith("_") and (inspect.isclass(thing) or inspect.isfunction(thing)) and thing.__module__.startswith("beltcomm")


def shown_on(page: Path) -> Iterator[Any]:
    """Classes and functions of a page of the reference, as mkdocstrings chooses them: what a module defines, and its ``__all__``."""
    for path, block in SHOWN.findall(page.read_text(encoding="utf-8")):
        parent, _, last = path.rpartition(".")
        try:
            module = importlib.import_module(path)
        except ModuleNotFoundError:
            yield getattr(importlib.import_module(parent), last)
            continue
        chosen = (yaml.safe_load(block) or {}).get("options", {}).get("members")
        chosen = chosen if isinstance(chosen, list) else None
        for name, thing in vars(module).items():
            public = (
                name in chosen
                if chosen
                else thing.__module__ == path or name in getattr(module, "__all__", ())
                if own(name, thing)
                else False
            )
            if public:
                yield thing


def public_functions() -> dict[str, Callable[..., Any]]:
    """Every function and method of the reference and of what its packages export, by its full name."""
    exported = [
        thing
        for path in sorted((CHECKOUT / "beltcomm").glob("*/__init__.py"))
        for module in [importlib.import_module(f"beltcomm.{path.parent.name}")]
        for name in getattr(module, "__all__", ())
        if own(name, thing := getattr(module, name))
    ]
    found = {}
    for thing in [*exported, *(thing for page in PAGES for thing in shown_on(page))]:
        thing = inspect.unwrap(thing)
        members = [(thing.__name__, thing)] if inspect.isfunction(thing) else vars(thing).items()
        for name, member in members:
            function = inspect.unwrap(getattr(member, "__func__", member))
            if (
                inspect.isfunction(function)
                and not name.startswith("_")
                and "<" not in function.__qualname__
                and set(inspect.signature(function).parameters) - {"self", "cls"}
            ):
                found[f"{function.__module__}.{function.__qualname__}"] = function
    return found


FUNCTIONS = public_functions()


def sections(text: str) -> dict[str, str]:
    parts = re.split(r"^(\w+)\n-+\n", inspect.cleandoc(text), flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def listed_parameters(text: str) -> set[str]:
    return {
        part.strip().lstrip("*")
        for line in sections(text).get("Parameters", "").splitlines()
        if line[:1].strip()
        for part in line.split(" : ")[0].split(",")
    }


def module_of(path: Path) -> str:
    parts = path.relative_to(CHECKOUT).with_suffix("").parts
    return ".".join(part for part in parts if part not in ("adapters", "__init__"))


def used_by_others() -> dict[str, ast.FunctionDef]:
    """Functions that another module imports, by their full name: the source is read, nothing is imported for it."""
    trees = {module_of(path): ast.parse(path.read_text(encoding="utf-8")) for top in TOPS for path in (CHECKOUT / top).rglob("*.py")}
    defined = {(module, node.name): node for module, tree in trees.items() for node in tree.body if isinstance(node, ast.FunctionDef)}
    imported = {
        module: {
            alias.asname or alias.name: (node.module or "", alias.name)
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }
        for module, tree in trees.items()
    }

    def origin(module: str, name: str) -> tuple[str, str]:
        """Place where a name is defined, through packages that only pass it on."""
        passed = set()
        while (module, name) not in defined and name in imported.get(module, ()) and (module, name) not in passed:
            passed.add((module, name))
            module, name = imported[module][name]
        return module, name

    found = {}
    for user, tree in trees.items():
        names = list(imported[user].values())
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in imported[user]:
                names.append((".".join(imported[user][node.value.id]), node.attr))
        for module, name in (origin(*one) for one in names):
            function = defined.get((module, name))
            if function is not None and module != user and not name.startswith("_"):
                found[f"{module}.{name}"] = function
    return found


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


def test_the_reference_shows_functions_of_all_its_pages() -> None:
    assert len(PAGES) >= 6
    assert len(FUNCTIONS) > 100


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_a_public_function_names_its_parameters_and_what_it_returns(name: str) -> None:
    """In numpydoc form; that no parameter is left out of the section, and the form itself, are ruff's D4 rules."""
    function = FUNCTIONS[name]
    found = sections(function.__doc__ or "")
    signature = inspect.signature(function)
    parameters = {p.name for p in signature.parameters.values()} - {"self", "cls"}
    assert listed_parameters(function.__doc__ or "") == parameters
    assert ("Returns" in found or "Yields" in found) == (signature.return_annotation not in (None, "None"))


def test_a_function_that_another_module_uses_names_its_parameters() -> None:
    """In numpydoc form, every one of them and no other; which functions these are follows from the imports."""
    functions = used_by_others()
    assert len(functions) > 1500
    wrong = {}
    for name, node in functions.items():
        given = node.args
        every = [*given.posonlyargs, *given.args, *given.kwonlyargs, *(one for one in (given.vararg, given.kwarg) if one is not None)]
        differs = {one.arg for one in every} ^ listed_parameters(ast.get_docstring(node) or "")
        if differs:
            wrong[name] = differs
    assert wrong == {}
