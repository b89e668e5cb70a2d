"""Source files of the laws of a kernel: a changed one must not meet machine code of the old one."""

from __future__ import annotations

import hashlib
import inspect
import sys
from collections.abc import Callable, Iterable


def fingerprint(laws: Iterable[Callable[..., object]], modules: Iterable[str]) -> str:
    """A hash of everything that these laws, and modules besides, are made of."""
    used = set(modules).union(*(modules_of(law) for law in laws))
    text = "".join(inspect.getsource(sys.modules[module]) for module in sorted(used))
    return hashlib.sha256(text.encode()).hexdigest()


def modules_of(law: Callable[..., object]) -> set[str]:
    """Modules of a law and of the compiled functions that it calls."""
    plain = getattr(law, "py_func", law)
    called = [plain.__globals__[name] for name in plain.__code__.co_names if name in plain.__globals__]
    written = {definition.__module__ for other in called if (definition := getattr(other, "_defn", None))}  # of intrinsics
    return ({plain.__module__} | written).union(*(modules_of(other) for other in called if hasattr(other, "py_func")))
