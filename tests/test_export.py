"""The exported controller, run: C compiled, structured text and YAML translated, each against the drive's compiled cascade."""

from __future__ import annotations

import ctypes
import json
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from beltcomm import api
from beltcomm.axis import load_axis
from beltcomm.cascade_kernel import _velocity_loop, cascade_step, new_state, reset_state, velocity_step
from beltcomm.cli.main import cli
from beltcomm.configfiles import read_yaml
from beltcomm.control import Cascade, CascadeStructure, Feedforward, Prefilter, discrete_coefficients
from beltcomm.errors import DataError, Refused, UsageError
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
    Words,
    controller_of,
    expression,
    flat,
    names_in,
)
from beltcomm.export.texts import text_of
from beltcomm.model import load_plant
from beltcomm.parameters import cascade_to_parameters
from beltcomm.result import plain
from beltcomm.runfolder import RunFolder

STEPS, PERIOD_S, LIMIT_NM = 10_000, 1e-3, 1.24
COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="there is no C compiler on this machine (cc, gcc, clang)")

FEEDFORWARD = Feedforward(2.145e-3, 2.53e-3, 0.125, 0.01, 1.0, 1.5e-3)
CASCADES = {
    "butterworth": Cascade(0.104, 1.67, 8.2, 2e-3, Prefilter("butterworth", 123.27), FEEDFORWARD),
    "notch, no advance": Cascade(0.073, 1.63, 7.3, 2e-3, Prefilter("notch", 123.1, 4.6), Feedforward(2e-3, 2e-3, 0.1, 0.0, 0.8)),
    "plain, no integrator": Cascade(0.05, 0.0, 5.0, 0.0, filter_reference=False),
}


def sequence(seed: int = 7) -> list[tuple[str, tuple[float, ...]]]:
    """Random references and positions: strokes with noise that drive the torque in and out of its limits, resets, both loops."""
    rng = np.random.default_rng(seed)
    t = PERIOD_S * np.arange(STEPS)
    acceleration = 60.0 * np.sin(2 * np.pi * 1.3 * t) + rng.normal(0.0, 20.0, STEPS)
    acceleration[3000:3400] = 0.0
    velocity = np.cumsum(acceleration) * PERIOD_S
    velocity[3100:3300] = 0.0  # where the sign of the friction is zero
    reference = np.cumsum(velocity) * PERIOD_S
    reference -= reference.mean()
    position = reference + 1.5 * np.sin(2 * np.pi * 0.7 * t + 1.0) + np.cumsum(rng.normal(0.0, 2e-4, STEPS))
    extra = np.where(rng.random(STEPS) < 0.05, rng.normal(0.0, 1.5, STEPS), 0.0)
    calls: list[tuple[str, tuple[float, ...]]] = []
    for k in range(STEPS):
        if k % 2500 == 2400:
            calls.append(("reset", (position[k], velocity[k])))
        inputs = (reference[k], velocity[k], acceleration[k], position[k], extra[k])
        calls.append(("velocity", inputs) if 5000 <= k < 6000 else ("position", inputs))
    return [(kind, tuple(map(float, values))) for kind, values in calls]


def by_kernel(cascade: Cascade, calls: list[tuple[str, tuple[float, ...]]]) -> np.ndarray:
    """What the drive's own compiled step gives."""
    coefficients, state, torque = discrete_coefficients(cascade, PERIOD_S, LIMIT_NM), new_state(), []
    for kind, values in calls:
        if kind == "reset":
            reset_state(state, *values)
        elif kind == "position":
            torque.append(cascade_step(coefficients, state, *values))
        else:
            torque.append(velocity_step(coefficients, state, *values[1:]))
    return np.array(torque)


def text(cascade: Cascade, format_: str) -> str:
    return text_of(controller_of(cascade, PERIOD_S, LIMIT_NM, {"model": "g_a"}, ["Größe: 5 µm */ (* ??/ \\"]), format_)


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


def by_c(library: ctypes.CDLL, real: Any, calls: list[tuple[str, tuple[float, ...]]]) -> np.ndarray:
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


def by_single_precision(cascade: Cascade, calls: list[tuple[str, tuple[float, ...]]]) -> np.ndarray:
    """The kernel's own statements, not compiled, on float32 numbers."""
    step = _velocity_loop.py_func  # type: ignore[attr-defined]
    c, torque = discrete_coefficients(cascade, PERIOD_S, LIMIT_NM).astype(np.float32), []
    state = np.zeros(8, dtype=np.float32)
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


# Structured text

_DECLARATION = re.compile(r"    ([a-z][a-z0-9_]*) : (LREAL|BOOL) := (TRUE|FALSE|-?\d+\.\d+(?:E[+-]?\d+)?);$")
_TOKEN = re.compile(
    r"\s*(?:(?P<name>[a-z][a-z0-9_]*)|(?P<number>\d+\.\d+(?:E[+-]?\d+)?)|(?P<word>AND|MIN|MAX)|(?P<sign><=|>=|[-+*/<>(),]))"
)
#: Keywords and standard functions of IEC 61131-3 that no variable may be called, whatever its case.
_RESERVED_WORDS = """
abs acos action add and any array asin at atan bool by byte case configuration constant cos ctd ctu date delete div do dt else
elsif end eq exit exp expt f_edge false find for from function function_block ge gt if in initial_step insert int interval le left
len limit ln log lreal lt max mid min mod move mul mux ne not of on or priority program r_edge read_only real repeat replace
resource retain return right rol ror rs sel shl shr sin sint sqrt sr step string struct sub tan task then time to tof ton tp
transition true trunc type until var while with word write xor
"""
_RESERVED = frozenset(_RESERVED_WORDS.split())


class FunctionBlock:
    """A function block run by translating its text to Python, refusing whatever the small part of the language used here does not hold."""

    def __init__(self, source: str) -> None:
        assert source.isascii()
        assert not re.search(r"\(\*(?:(?!\*\)).)*\(\*", source, re.DOTALL), "comments stand in one another"
        code = [line.rstrip() for line in re.sub(r"\(\*.*?\*\)", "", source, flags=re.DOTALL).splitlines() if line.strip()]
        assert (code[0], code[-1]) == ("FUNCTION_BLOCK BELTCOMM_CASCADE", "END_FUNCTION_BLOCK")
        self.values: dict[str, float | bool] = {}
        self.kinds: dict[str, str] = {}
        place = 1
        while code[place].startswith("VAR"):
            kind, place = code[place], place + 1
            while code[place] != "END_VAR":
                match = _DECLARATION.match(code[place])
                assert match, code[place]
                name, type_, value = match.groups()
                assert name not in self.values
                assert name not in _RESERVED
                assert (type_ == "BOOL") == (value in ("TRUE", "FALSE"))
                self.values[name], self.kinds[name] = value == "TRUE" if type_ == "BOOL" else float(value), kind
                place += 1
            place += 1
        body, depth = [], 0
        for line in (each.strip() for each in code[place:-1]):
            if match := re.fullmatch(r"(IF|ELSIF) (.*) THEN", line):
                depth -= match[1] == "ELSIF"
                body.append("    " * depth + ("if " if match[1] == "IF" else "elif ") + self._expression(match[2]) + ":")
                depth += 1
            elif line == "ELSE":
                body.append("    " * (depth - 1) + "else:")
            elif line == "END_IF;":
                depth -= 1
            else:
                match = re.fullmatch(r"([a-z][a-z0-9_]*) := (.*);", line)
                assert match, line
                assert self.kinds[match[1]] in ("VAR", "VAR_TEMP", "VAR_OUTPUT"), f"{match[1]} must not be written"
                body.append("    " * depth + f"v['{match[1]}'] = {self._expression(match[2])}")
        assert depth == 0
        self._program = compile("\n".join(body), "function block", "exec")

    def _expression(self, source: str) -> str:
        """Python's form: its precedence is that of structured text for the signs allowed here."""
        words, place = [], 0
        while place < len(source):
            match = _TOKEN.match(source, place)
            assert match, f"not understood: {source[place:]}"
            place = match.end()
            if match["name"]:
                assert match["name"] in self.kinds, f"{match['name']} is not declared"
                words.append(f"v['{match['name']}']")
            else:
                words.append({"AND": "and", "MIN": "min", "MAX": "max"}.get(match[0].strip(), match[0].strip()))
        return " ".join(words)

    def call(self, **inputs: float | bool) -> float:
        assert all(self.kinds[name] == "VAR_INPUT" for name in inputs)
        # temporary variables begin anew at every call: an old value must not be read
        for name in [name for name, kind in self.kinds.items() if kind == "VAR_TEMP"]:
            self.values[name] = float("nan")
        self.values.update(inputs)
        exec(self._program, {"v": self.values, "min": min, "max": max, "__builtins__": {}})
        return float(self.values["torque_nm"])


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


def by_yaml(data: dict[str, Any], calls: list[tuple[str, tuple[float, ...]]]) -> np.ndarray:
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
    assert not _RESERVED & set(names)
    written = {q.name for q in LOCALS} | {q.name for q in STATES} | {OUTPUT.name}
    for first in (POSITION_LOOP, VELOCITY_LOOP):
        known = set(names) - {q.name for q in LOCALS} - {OUTPUT.name}
        for let in flat((*first, *STEP)):
            assert names_in(let.value) <= known, let
            assert let.target in written
            known.add(let.target)
    assert {let.target for let in flat(RESET)} == {q.name for q in STATES}


@pytest.mark.parametrize("bad", ["a ** b", "abs(a)", "1", "a if b else c", "min(a, b, c)", "a < b < c", "a or b"])
def test_an_equation_that_other_languages_do_not_have_cannot_be_exported(bad: str) -> None:
    with pytest.raises(ValueError, match="cannot hold"):
        expression(bad, Words(str, repr, "and", "min", "max"))


@pytest.mark.parametrize(
    ("source", "said"),
    [("a - (b - c)", "a - (b - c)"), ("a / (b * c)", "a / (b * c)"), ("-(a + b) * c", "-(a + b) * c"), ("(a - b) - c", "a - b - c")],
)
def test_parentheses_stay_where_they_matter(source: str, said: str) -> None:
    assert expression(source, Words(str, repr, "and", "min", "max")) == said


def test_the_same_design_gives_the_same_text_and_another_one_another() -> None:
    for format_ in ("yaml", "c", "st"):
        assert text(CASCADES["butterworth"], format_) == text(CASCADES["butterworth"], format_)
        assert text(CASCADES["butterworth"], format_) != text(CASCADES["notch, no advance"], format_)


def test_a_number_that_no_text_can_hold_is_refused() -> None:
    with pytest.raises(UsageError, match="constant torque is nan"):
        controller_of(Cascade(0.1, 1.0, 5.0, 0.0, feedforward=Feedforward(offset_nm=float("nan"))), PERIOD_S, LIMIT_NM, {}, ())


# The command

THESIS = CascadeStructure("thesis", PERIOD_S, ("none", "notch", "butterworth"), True, True, True)


@pytest.fixture
def make_run(tmp_path: Path) -> Callable[..., Path]:
    """A run folder with a model and a design."""

    def make(cascade: Cascade = CASCADES["butterworth"], structure: CascadeStructure = THESIS, **more: Any) -> Path:
        folder = RunFolder.create(tmp_path / "run", load_axis("egc-70-600"))
        folder.save_model("final", load_plant("g_a").model.to_dict())
        design = {"parameters": cascade_to_parameters(cascade), "revision": "", "compensated": [], "structure": plain(structure)}
        folder.save_design("final", {**design, "dead_time_s": 1e-3, "margins": [], "binding": [], "remarks": [], **more})
        return folder.path

    return make


def call(*words: str, answer: str | None = None) -> Any:
    return CliRunner().invoke(cli, list(words), input=answer)


def test_the_command_writes_a_file_and_overwrites_only_with_a_yes(make_run: Callable[..., Path], tmp_path: Path) -> None:
    run, out = make_run(), tmp_path / "controller.c"
    words = ("export", str(run), "--format", "c", "--out", str(out))
    outcome = call(*words, "--torque-limit", "1240 mNm", "--json")
    assert outcome.exit_code == 0, outcome.stderr
    data, source = json.loads(outcome.stdout), out.read_text(encoding="ascii")
    assert data["coefficients"]["torque_limit_nm"] == 1.24
    assert list(data["coefficients"].values()) == discrete_coefficients(CASCADES["butterworth"], PERIOD_S, 1.24).tolist()
    for line in (" * model:     g_a", " * run:       run", f" * command:   beltcomm export {run}"):
        assert line in source
    assert call(*words, answer="n\n").exit_code == 1
    assert "command:   beltcomm export" in out.read_text(encoding="ascii")
    assert call(*words, answer="").exit_code == 2
    assert out.read_text(encoding="ascii") == source
    assert call(*words, "--yes").exit_code == 0
    assert "BELTCOMM_C(3.1), /* torque_limit_nm */" in out.read_text(encoding="ascii")  # the motor's peak torque


def test_without_a_file_the_text_goes_to_stdout(make_run: Callable[..., Path]) -> None:
    outcome = call("export", str(make_run()), "--format", "st")
    assert outcome.exit_code == 0
    FunctionBlock(outcome.stdout)


def test_the_torque_limit_is_that_of_the_drive_when_the_run_knows_one(make_run: Callable[..., Path]) -> None:
    run = make_run()
    RunFolder.open(run).save_result("drive", {"peak_torque_nm": 2.5})
    assert api.export(run, "yaml").to_json()["coefficients"]["torque_limit_nm"] == 2.5


def test_what_the_drive_lacks_and_what_the_text_lacks_is_said(make_run: Callable[..., Path]) -> None:
    poor = CascadeStructure("cmmp-as", PERIOD_S, output_limit_rad_s=400.0, dead_zone_rad=1e-3)
    run = make_run(Cascade(0.1, 0.0, 8.0, 2e-3, filter_reference=True), poor, compensated=["cogging"], remarks=["it is slow"])
    text_ = " ".join(api.export(run, "c").to_json()["text"].replace("\n *", " ").split())
    for sentence in (
        "the drive cmmp-as has no torque feedforward: its coefficients are 0 here",
        "the drive cmmp-as has no filter of the reference velocity, which this text has: it behaves differently from that drive",
        "the drive cmmp-as has no prefilter: the one here passes the error on as it is",
        "there is no integrator (K_I is 0)",
        "bounds the output of its position controller to 400 rad/s; the text does not",
        "does not see position errors below 0.001 rad; the text does",
        "torque against cogging depends on place and speed and is not in this text",
        "it is slow",
        "the design is in doubt: no verification move was driven with these gains",
    ):
        assert sentence in text_


def test_faults_are_named(make_run: Callable[..., Path], tmp_path: Path) -> None:
    empty = RunFolder.create(tmp_path / "empty", load_axis("egc-70-600")).path
    with pytest.raises(DataError, match=r"the design final is not in .*; make it with `beltcomm design"):
        api.export(empty, "c")
    with pytest.raises(DataError, match="does not exist"):
        api.export(tmp_path / "nowhere", "c")
    run = make_run()
    with pytest.raises(UsageError, match="no format 'pascal'; there are yaml, c, st"):
        api.export(run, "pascal")
    with pytest.raises(UsageError, match="torque limit is -1 N m"):
        api.export(run, "c", torque_limit_nm=-1.0)
    with pytest.raises(UsageError, match="is a folder"):
        api.export(run, "c", out=tmp_path)
    with pytest.raises(Refused, match="was left as it is"):
        api.export(run, "c", out=run / "axis.yaml")
    RunFolder.open(run).save_design("final", {"parameters": {"kp_nm_s_rad": 0.1}})
    with pytest.raises(DataError, match="damaged"):
        api.export(run, "c")
    outcome = call("export", str(run), "--format", "pascal")
    assert (outcome.exit_code, "'pascal' is not one of" in outcome.stderr) == (2, True)
