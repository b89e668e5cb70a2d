"""Long calculations whose result depends on their arguments alone are done once for all cases."""

from __future__ import annotations

import dataclasses
import hashlib
import pickle
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.experiments import commission as sequence
from beltcomm.experiments import phases, proving, raising, stops_out_of_move, verification
from beltcomm.identify import final
from beltcomm.machine import stops
from beltcomm.rundata import analyse, offline

PURE: tuple[tuple[Any, str], ...] = (
    (raising, "first_path"),
    (phases, "largest_amplitude"),
    (raising, "largest_amplitude"),
    (analyse, "design_cascade"),
    (analyse, "cautious_cascade"),
    (analyse, "thesis_fit"),
    (stops, "braked_by_loop"),
    (sequence, "final_model"),
    (offline, "final_model"),
    (final, "final_model"),
    (proving, "predict_move"),
    (verification, "predict_move"),
    (stops_out_of_move, "predict_stop_out_of_move"),
)

_known: dict[bytes, Any] = {}


@contextmanager
def shared() -> Iterator[None]:
    """Inside, nothing in ``PURE`` is computed twice with equal arguments."""
    before = [(place, name, getattr(place, name)) for place, name in PURE]
    for place, name, function in before:
        setattr(place, name, _remembering(function))
    try:
        yield
    finally:
        for place, name, function in before:
            setattr(place, name, function)


def load(path: Path) -> None:
    """What an earlier :func:`save` kept."""
    _known.update(pickle.loads(path.read_bytes()))


def save(path: Path) -> None:
    """Keep what was computed so far."""
    path.write_bytes(pickle.dumps(_known))


def _remembering(function: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(function)
    def call(*args: Any, **named: Any) -> Any:
        digest = hashlib.sha256(function.__qualname__.encode())
        _feed(digest, (args, named))
        key = digest.digest()
        if key not in _known:
            _known[key] = function(*args, **named)
        return _known[key]

    return call


def _feed(digest: Any, value: Any) -> None:
    """Everything that a value is made of; where it lies on the disk and what it calls do not count."""
    if isinstance(value, np.ndarray):
        digest.update(str((value.dtype, value.shape)).encode() + value.tobytes())
    elif isinstance(value, Mapping):
        for key in sorted(value, key=str):
            digest.update(str(key).encode() + b"=")
            _feed(digest, value[key])
    elif isinstance(value, (list, tuple)):
        digest.update(b"(")
        for item in value:
            _feed(digest, item)
        digest.update(b")")
    elif isinstance(value, (set, frozenset)):
        digest.update(repr(sorted(value, key=str)).encode())
    elif value is None or isinstance(value, (str, bytes, int, float, complex, np.generic)):
        digest.update(repr(value).encode())
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        digest.update(type(value).__name__.encode())
        for field in dataclasses.fields(value):
            _feed(digest, getattr(value, field.name))
    elif isinstance(value, Path) or callable(value):
        digest.update(b"-")
    else:
        digest.update(type(value).__name__.encode())
        _feed(digest, vars(value))
