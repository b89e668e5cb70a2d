"""The exported controller, run: C compiled, structured text and YAML translated, each against the drive's compiled cascade."""

from __future__ import annotations

import ast
import ctypes
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltcomm.configfiles import read_yaml
from beltcomm.control import Cascade, Feedforward, discrete_coefficients
from beltcomm.control.cascade_kernel import _velocity_loop, new_state
from beltcomm.errors import UsageError
from beltcomm.export.program import (
    COEFFICIENTS,
    INPUTS,
    LOCALS,
    OUTPUT,
    POSITION_LOOP,
    RESET,
    RESET_INPUTS,
    STATES,
    STEP,
    VELOCITY_LOOP,
    TargetLanguage,
    controller_of,
    expression,
    flat,
)
from export.drive import CASCADES, LIMIT_NM, PERIOD_S, STEPS, Calls, by_kernel, sequence, text
from export.function_block import RESERVED, FunctionBlock

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="there is no C compiler on this machine (cc, gcc, clang)")


def names_in(text: str) -> set[str]:
    """Names that an expression reads."""
    nodes = list(ast.walk(ast.parse(text, mode="eval")))
    functions = {id(node.func) for node in nodes if isinstance(node, ast.Call)}
    return {node.id for node in nodes if isinstance(node, ast.Name) and id(node) not in functions}


def test_the_sequence_saturates_and_does_not_both_ways() -> None:
    torque = by_kernel(CASCADES["butterworth"], sequence())
    for side in (-LIMIT_NM, LIMIT_NM):
        assert 0.02 < np.mean(torque == side) < 0.6
    assert np.mean(np.abs(torque) < LIMIT_NM) > 0.2


# C


def compiled(folder: Path, source: str, real: str) -> ctypes.CDLL:
    """The file as a library, with every warning an error."""
    (folder / "controller.c").write_text(source, encoding="ascii")
    library = folder / f"controller_{real}.so"
    warnings = ["-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Wfloat-equal", "-Wshadow", "-Werror"]
    command = [str(COMPILER), "-std=c99", "-pedantic", *warnings, f"-DBELTCOMM_REAL={real}", "-O2", "-ffp-contract=off", "-shared", "-fPIC"]
    done = subprocess.run([*command, "-o", str(library), str(folder / "controller.c")], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return ctypes.CDLL(str(library))


def by_c(library: ctypes.CDLL, real: Any, calls: Calls) -> np.ndarray:
    state, torque = (real * len(STATES))(), []
    design = ctypes.byref((real * len(COEFFICIENTS)).in_dll(library, "beltcomm_design"))
    library.beltcomm_init(state)
    for name, count in (("position", 5), ("velocity", 4)):
        step = getattr(library, f"beltcomm_{name}_step")
        step.restype, step.argtypes = real, [ctypes.c_void_p, ctypes.c_void_p, *[real] * count]
    library.beltcomm_reset.argtypes = [ctypes.c_void_p, real, real]
    for kind, values in calls:
        if kind == "reset":
            library.beltcomm_reset(state, *values)
        elif kind == "position":
            torque.append(library.beltcomm_position_step(design, state, *values))
        else:
            torque.append(library.beltcomm_velocity_step(design, state, *values[1:]))
    return np.array(torque)


@needs_compiler
@pytest.mark.parametrize("name", CASCADES)
def test_the_c_file_computes_what_the_drive_does(tmp_path: Path, name: str) -> None:
    """Double: the same operations in the same order, so equal to rounding, 1e-12 of the limit over 10 000 steps."""
    calls = sequence()
    library = compiled(tmp_path, text(CASCADES[name], "c"), "double")
    np.testing.assert_allclose(by_c(library, ctypes.c_double, calls), by_kernel(CASCADES[name], calls), rtol=0.0, atol=1e-12 * LIMIT_NM)


@needs_compiler
@pytest.mark.parametrize("name", CASCADES)
def test_in_single_precision_it_computes_what_single_precision_can(tmp_path: Path, name: str) -> None:
    """Float: as the drive's step in float32, operation by operation, to 1e-6 of the limit; and as near the one in double as floats allow.

    A speed is the difference of two angles of up to P, each rounded by P/2²⁴, over T; lag and prefilter amplify by 1.1 at most, so the
    torque is off by 2.2 K_P P/(2²⁴ T).  In the integrator those differences telescope; its own rounding, N times at most 3 limits/2²⁴,
    is added.  10 % and 1e-5 of the limit are left for all else.
    """
    calls, cascade = sequence(), CASCADES[name]
    single = by_c(compiled(tmp_path, text(cascade, "c"), "float"), ctypes.c_float, calls)
    np.testing.assert_allclose(single, by_single_precision(cascade, calls), rtol=0.0, atol=1e-6 * LIMIT_NM)
    largest = max(abs(values[-2]) for kind, values in calls if kind != "reset")
    bound = 2.2 * cascade.kp_nm_s_rad * largest / (2**24 * PERIOD_S) + (3.0 * STEPS * LIMIT_NM / 2**24 if cascade.ki_nm_rad else 0.0)
    assert np.abs(single - by_kernel(cascade, calls)).max() < 1.1 * bound + 1e-5 * LIMIT_NM < 0.005 * LIMIT_NM


def by_single_precision(cascade: Cascade, calls: Calls) -> np.ndarray:
    """The kernel's own statements, not compiled, on float32 numbers."""
    step = _velocity_loop.py_func  # type: ignore[attr-defined]
    c, torque = discrete_coefficients(cascade, PERIOD_S, LIMIT_NM).astype(np.float32), []
    state = new_state().astype(np.float32)
    for kind, values in calls:
        reference, velocity, acceleration, position, extra = np.float32(values) if kind != "reset" else np.zeros(5, dtype=np.float32)
        if kind == "reset":
            state[:] = 0.0
            state[0], state[1], state[2], state[3] = values[0], values[1], values[1], values[1]
        elif kind == "position":
            torque.append(step(c, state, c[3] * (reference - position), c[15] * velocity, velocity, acceleration, position, extra))
        else:
            torque.append(step(c, state, np.float32(0.0), velocity, velocity, acceleration, position, extra))
    return np.array(torque)


@pytest.mark.parametrize("name", CASCADES)
def test_the_function_block_computes_what_the_drive_does(name: str) -> None:
    calls, block, torque = sequence(), FunctionBlock(text(CASCADES[name], "st")), []
    for kind, values in calls:
        if kind == "reset":
            assert block.call(reset=True, position_rad=values[0], reset_velocity_rad_s=values[1]) == 0.0
            continue
        inputs = dict(zip((q.name for q in INPUTS), values, strict=True))
        torque.append(block.call(reset=False, position_loop=kind == "position", **inputs))
    np.testing.assert_allclose(torque, by_kernel(CASCADES[name], calls), rtol=0.0, atol=1e-12 * LIMIT_NM)


@pytest.mark.parametrize(
    ("old", "new"),
    [("MIN(MAX(", "LIMIT(MAX("), ("pole :=", "poles :="), ("direction := 1.0", "direction := 1"), ("position_rad;", "position_rad"),
     ("torque_limit_nm : LREAL", "limit : LREAL"), ("last_position_rad := position_rad", "position_rad := last_position_rad")],
)  # fmt: skip
def test_the_translator_refuses_what_is_no_such_text(old: str, new: str) -> None:
    source = text(CASCADES["butterworth"], "st")
    assert old in source
    with pytest.raises((AssertionError, KeyError)):
        FunctionBlock(source.replace(old, new))


# YAML


def by_yaml(data: dict[str, Any], calls: Calls) -> np.ndarray:
    """The equations of the file, executed."""

    def program(*parts: str) -> Any:
        lines = [line for part in parts for equation in data[part] for line in equation["equations"]]
        return compile("\n".join(line.replace("else if ", "elif ") for line in lines), "equations", "exec")

    whole = {"position": program("position_loop_first", "every_period"), "velocity": program("velocity_loop_first", "every_period")}
    values = {"__builtins__": {}, "min": min, "max": max, **{name: item["value"] for name, item in data["coefficients"].items()}}
    values |= dict.fromkeys(data["states"], 0.0)
    torque = []
    for kind, given in calls:
        if kind == "reset":
            values |= dict(zip(("position_rad", "reset_velocity_rad_s"), given, strict=True))
            exec(program("reset"), values)
            continue
        values |= dict(zip(data["inputs"], given, strict=True))
        exec(whole[kind], values)
        torque.append(values["torque_nm"])
    return np.array(torque)


@pytest.mark.parametrize("name", CASCADES)
def test_the_equations_of_the_yaml_file_are_those_of_the_drive(tmp_path: Path, name: str) -> None:
    (tmp_path / "controller.yaml").write_text(text(CASCADES[name], "yaml"), encoding="utf-8")
    data = read_yaml(tmp_path / "controller.yaml")
    numbers = [item["value"] for item in data["coefficients"].values()]
    assert numbers == discrete_coefficients(CASCADES[name], PERIOD_S, LIMIT_NM).tolist()
    assert all(item["unit"] and item["meaning"] for part in ("coefficients", "inputs", "states", "output") for item in data[part].values())
    calls = sequence()
    np.testing.assert_allclose(by_yaml(data, calls), by_kernel(CASCADES[name], calls), rtol=0.0, atol=1e-12 * LIMIT_NM)


# The one list that all come from


def test_every_name_is_declared_and_written_before_it_is_read() -> None:
    quantities = (*COEFFICIENTS, *STATES, *INPUTS, RESET_INPUTS[1], OUTPUT, *LOCALS)
    names = [q.name for q in quantities]
    assert len(set(names)) == len(names)
    assert not RESERVED & set(names)
    written = {q.name for q in LOCALS} | {q.name for q in STATES} | {OUTPUT.name}
    for first in (POSITION_LOOP, VELOCITY_LOOP):
        known = set(names) - {q.name for q in LOCALS} - {OUTPUT.name}
        for let in flat((*first, *STEP)):
            assert names_in(let.value) <= known, let
            assert let.target in written
            known.add(let.target)
    assert {let.target for let in flat(RESET)} == {q.name for q in STATES}


@pytest.mark.parametrize("bad", ["a ** b", "abs(a)", "True", "sin(a)", "a if b else c", "min(a, b, c)", "a < b < c", "a or b"])
def test_an_equation_that_other_languages_do_not_have_cannot_be_exported(bad: str) -> None:
    with pytest.raises(ValueError, match="cannot hold"):
        expression(bad, TargetLanguage(str, repr, "and", "min", "max"))


@pytest.mark.parametrize(
    ("source", "said"),
    [("a - (b - c)", "a - (b - c)"), ("a / (b * c)", "a / (b * c)"), ("-(a + b) * c", "-(a + b) * c"), ("(a - b) - c", "a - b - c")],
)
def test_parentheses_stay_where_they_matter(source: str, said: str) -> None:
    assert expression(source, TargetLanguage(str, repr, "and", "min", "max")) == said


def test_the_same_design_gives_the_same_text_and_another_one_another() -> None:
    for format_ in ("yaml", "c", "st"):
        assert text(CASCADES["butterworth"], format_) == text(CASCADES["butterworth"], format_)
        assert text(CASCADES["butterworth"], format_) != text(CASCADES["notch, no advance"], format_)


def test_a_number_that_no_text_can_hold_is_refused() -> None:
    with pytest.raises(UsageError, match="constant torque is nan"):
        controller_of(Cascade(0.1, 1.0, 5.0, 0.0, feedforward=Feedforward(offset_nm=float("nan"))), PERIOD_S, LIMIT_NM, {}, ())
