"""Identity of this program: what was computed by another one is not mixed with what is computed now."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable


@cache
def source_hash() -> str:
    """SHA-256 of all source text of this package, its first 16 digits; a version number says less between two releases."""
    found = hashlib.sha256()
    for item in _sources(files("beltcomm")):
        found.update(item.read_bytes())
    return found.hexdigest()[:16]


def _sources(package: Traversable) -> list[Traversable]:
    found = []
    for item in sorted(package.iterdir(), key=lambda item: item.name):
        if item.is_dir():
            found += _sources(item)
        elif item.name.endswith(".py"):
            found.append(item)
    return found
