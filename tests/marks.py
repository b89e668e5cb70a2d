"""Which values of a parametrized test the quick suite takes; the examinations take the others."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def quick(values: Iterable[Any], first: int) -> list[Any]:
    """The first ones as they are, the others marked as examinations."""
    return [
        value if place < first else pytest.param(*(value if isinstance(value, tuple) else (value,)), marks=pytest.mark.examination)
        for place, value in enumerate(values)
    ]
