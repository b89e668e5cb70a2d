"""What a run keeps is read into types at one door: drawn contents pass, and any value of another type is named."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from beltcomm.axis import load_axis
from beltcomm.contents import COUNT, GAIN, LARGEST, POSITIVE, SIZE, TYPES, Size, check_content, faults
from beltcomm.errors import DataError
from beltcomm.runfolder import RunFolder

SIMPLE: dict[Any, st.SearchStrategy[Any]] = {
    float: st.floats(-LARGEST, LARGEST) | st.integers(-(10**9), 10**9) | st.just(float("inf")) | st.just(float("nan")),
    int: st.integers(-(10**9), 10**9),
    str: st.text(max_size=5),
    bool: st.booleans(),
    SIZE: st.floats(0.0, LARGEST) | st.integers(0, 10**9) | st.just(float("inf")),
    POSITIVE: st.floats(1e-300, LARGEST) | st.integers(1, 10**9),
    COUNT: st.integers(1, 10**9),
    GAIN: st.floats(1e-3, 1e3) | st.integers(1, 1000),
}
NAMES = st.text("abc_0", min_size=1, max_size=4)
#: Of these no type takes more than one.
OTHERS: list[Any] = [None, 1.5, 2 * LARGEST, "another word", True, [None], {"a": None}]


def contents(kind: Any, depth: int = 0) -> st.SearchStrategy[Any]:
    """Whatever is of a type; a type that holds itself ends."""
    if isinstance(kind, list) and depth > 4:
        return st.just([])
    if isinstance(kind, list):
        return st.lists(contents(kind[0], depth + 1), max_size=2)
    if isinstance(kind, tuple):
        return st.tuples(*(contents(one, depth + 1) for one in kind)).map(list)
    if isinstance(kind, frozenset):
        return st.sampled_from(sorted(kind))
    if not isinstance(kind, Mapping):
        return SIMPLE[kind]
    if str in kind:
        return st.dictionaries(NAMES, contents(kind[str], depth + 1), max_size=2)
    inside = {key: contents(one, depth + 1) for key, one in kind.items() if key}
    inside |= {key: one | st.none() for key, one in inside.items() if key.endswith("?")}
    must = {key: one for key, one in inside.items() if not key.endswith(("?", "*"))}
    may = {key.rstrip("?*"): one for key, one in inside.items() if key not in must}
    return st.fixed_dictionaries(must, optional=may)


def places(value: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Of every value inside one."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [place for key, inside in items for place in ((*at, key), *places(inside, (*at, key)))]


@settings(deadline=None, max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(st.data())
def test_a_value_of_another_type_is_named(tmp_path: Path, data: st.DataObject) -> None:
    what = data.draw(st.sampled_from(sorted(TYPES)))
    content = data.draw(contents(TYPES[what]).filter(bool))
    check_content(what, content, tmp_path)
    place = data.draw(st.sampled_from(places(content)))
    part = content
    for key in place[:-1]:
        part = part[key]
    named = "".join(f"[{key + 1}]" if isinstance(key, int) else f".{key}" for key in place).removeprefix(".")
    taken = []
    for other in OTHERS:
        part[place[-1]] = other
        wrong = next(faults(content, TYPES[what], ""), "")
        if wrong:
            assert wrong.startswith(named), (named, wrong)
            with pytest.raises(DataError, match="file is damaged: "):
                check_content(what, content, tmp_path / "file")
        elif other is not None:
            taken.append(other)
    assert len(taken) <= 1, (place, taken)


@pytest.mark.parametrize(("kind", "below", "must"), [(SIZE, -5.0, "0 or more"), (POSITIVE, 0.0, "above 0"), (COUNT, -1, "above 0")])
def test_a_size_below_zero_is_named(kind: Size, below: float, must: str) -> None:
    assert list(faults({"a": [below]}, {"a": [kind]}, "")) == [f"a[1] is '{below}'; it must be {must}"]
    assert not list(faults({"a": [1]}, {"a": [kind]}, ""))


@pytest.mark.parametrize("what", sorted(set(TYPES) - {"designs", "run.yaml", "fit", "diagnosis"}))
def test_what_must_be_there_is_named(tmp_path: Path, what: str) -> None:
    run = RunFolder.create(tmp_path / "R", load_axis("egc-70-600"))
    run.save("results", what, {"more": 1})
    with pytest.raises(DataError, match=rf"{what}.yaml is damaged: [a-z_]+ is missing; bring it back, or delete it"):
        run.load_result(what)


def test_a_result_that_no_command_reads_holds_anything(tmp_path: Path) -> None:
    run = RunFolder.create(tmp_path / "R", load_axis("egc-70-600"))
    run.save("results", "mine", {"a": [1, {"b": None}]})
    assert run.load_result("mine") == {"a": [1, {"b": None}]}
