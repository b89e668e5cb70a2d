"""Folders and files of strangers: nothing moves by them, nothing is written but what this drive's adapter keeps and this axis bears."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import pytest

from beltcomm import api
from beltcomm.configfiles import read_yaml, to_yaml
from beltcomm.errors import Refused
from beltcomm.objects import ObjectValue
from session.bench import Bench

MakeBench = Callable[..., Bench]
Copy = Callable[..., Path]
YES = api.Options(yes=True, seed=3)
#: What brings a drive into velocity mode and on.
DRIVES_OFF = (
    ("6060h", "int8", 3),
    ("60FFh", "int32", 100000),
    ("6040h", "uint16", 6),
    ("6040h", "uint16", 7),
    ("6040h", "uint16", 15),
)


def with_objects(run: Path, added: Sequence[tuple[str, str, float]]) -> Path:
    """A backup that asks for further objects."""
    path = run / "results" / "backup.yaml"
    saved = read_yaml(path)
    saved["objects"] += [{"object": title, "type": kind, "raw": raw} for title, kind, raw in added]
    path.write_text(to_yaml(saved), encoding="utf-8")
    return path


def test_a_rollback_moves_nothing(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench()
    before = bench.settings()
    with_objects(run, DRIVES_OFF)
    with pytest.raises(Refused, match=r"60FFh"):
        api.rollback(bench.name, run, options=YES)
    assert bench.settings() == before
    assert bench.stands_disabled()
    assert bench.plant.cart_position_m == 0.0


@pytest.mark.parametrize("limit", [("6080h", "uint32", 1e9), ("6072h", "uint16", 65535)])
def test_a_rollback_raises_no_limit_beyond_the_ratings(make_bench: MakeBench, copy_of_complete: Copy, limit: tuple[str, str, float]) -> None:
    run, bench = copy_of_complete(), make_bench()
    before = bench.settings()
    path = run / "results" / "backup.yaml"
    saved = read_yaml(path)
    for entry in saved["objects"]:
        if entry["object"] == limit[0]:
            entry["raw"] = limit[2]
    path.write_text(to_yaml(saved), encoding="utf-8")
    with pytest.raises(Refused, match=limit[0]):
        api.rollback(bench.name, run, options=YES)
    assert bench.settings() == before
