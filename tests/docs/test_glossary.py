"""docs/glossary.md: what it names in the code is there, and no term stands twice."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

CHECKOUT = Path(__file__).parents[2]
TABLES = (CHECKOUT / "docs" / "glossary.md").read_text(encoding="utf-8").split("## Words of CANopen")[0]
#: term, symbol and name in the code, unit, meaning, defined in
ROWS = [[cell.strip() for cell in line.split("|")[1:-1]] for line in TABLES.splitlines() if re.match(r"\| (?!term|-)", line)]


def test_a_term_has_one_meaning() -> None:
    terms = [term.strip() for row in ROWS for term in row[0].split(",")]
    assert len(ROWS) > 60
    assert {len(row) for row in ROWS} == {5}
    assert sorted(set(terms)) == sorted(terms)


def test_what_is_named_in_the_code_is_there() -> None:
    sources = [*(CHECKOUT / "beltcomm").rglob("*.py"), *(CHECKOUT / "configs").rglob("*.yaml")]
    words = set(re.findall(r"\w+", "\n".join(path.read_text(encoding="utf-8") for path in sources)))
    named = {name for row in ROWS for name in re.findall(r"`([\w.]+)`", row[1])}
    assert {name for name in named if not set(name.split(".")) <= words} == set()


def test_modules_that_define_a_term_exist() -> None:
    modules = {name for row in ROWS for name in re.findall(r"`([\w.]+)`", row[4])}
    assert modules
    assert {name for name in modules if importlib.util.find_spec(f"beltcomm.{name}") is None} == set()
