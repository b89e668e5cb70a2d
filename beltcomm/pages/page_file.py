"""The file of a page and that of its numbers beside it: nothing that is no such page is replaced."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from beltcomm.configfiles import write_text
from beltcomm.errors import DataError, UsageError
from beltcomm.outside import read_json
from beltcomm.result import jsonable


def admit_page(page: Path) -> None:
    """Refuse a name that is no page's, and one where the page or its numbers would replace a file of another kind.

    Parameters
    ----------
    page : Path
        Of the file.

    Raises
    ------
    UsageError
        For either.
    """
    if page.suffix.lower() not in (".html", ".htm"):
        raise UsageError(f"the page would be {page}, and it is HTML; give a name that ends in .html")
    numbers = page.with_suffix(".json")
    there = [file for file in (page, numbers) if file.exists()]
    if there and not _is_of_page(numbers):
        raise UsageError(f"{there[0]} exists and is no page with its numbers; give the page another name, or delete that file first")


def write_page(page: Path, html: str, numbers: Mapping[str, Any]) -> None:
    """Write a page, and its numbers beside it.

    Parameters
    ----------
    page : Path
        Of the file, ending in .html.
    html : str
        The page.
    numbers : mapping of str to Any
        For the JSON file.

    Raises
    ------
    UsageError
        Where they cannot be written.
    """
    write_text(page, html)
    write_text(page.with_suffix(".json"), json.dumps(jsonable(numbers), indent=1) + "\n")


def _is_of_page(numbers: Path) -> bool:
    try:
        found = read_json(numbers)
    except (OSError, DataError, ValueError):
        return False
    return isinstance(found, Mapping) and "verdict" in found and ("sections" in found or "quantities" in found)
