"""The exported velocity estimators, run: C compiled, structured text and YAML translated, each against the compiled estimators on edges."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from beltcomm.configfiles import read_yaml
from beltcomm.encoder.edges import Edges, Flaws, edges_of
from beltcomm.encoder.estimators import EstimatorSettings, velocities
from beltcomm.errors import UsageError
from beltcomm.export.encoder_program import COEFFICIENTS, EDGE_LOCALS, OUTPUTS, PERIOD_LOCALS, STATES, encoder_of
from beltcomm.export.encoder_texts import FORMATS
from export.function_block import RESERVED, FunctionBlock
from export.test_formats import compiled, needs_compiler

DURATION_S = 0.6
SETTINGS = EstimatorSettings(math.tau / 4096, 1e-7, 1e-3, 2e-3, 0.7e-3, 0.03)
NAMES = [q.name for q in OUTPUTS]
#: One call: (tick, a, b) of a change, or (tick,) of a sampling instant.
Call = tuple[int, ...]


def record(seed: int) -> Edges:
    """Creep, a stop, a reversal and a rush, with bounces and lines out of place, and in the middle a missed edge and a doubled tick."""
    rng = np.random.default_rng(seed)
    slow, fast, way = rng.uniform(0.02, 0.1), rng.uniform(3.0, 8.0), rng.uniform(0.3, 0.9)
    phase = rng.uniform(0.0, 1.0)

    def motion(t: np.ndarray) -> np.ndarray:
        return np.asarray(phase + slow * np.minimum(t, 0.15) + way * np.sin(fast * np.maximum(t - 0.25, 0.0)) ** 2 * (t - 0.25))

    flaws = Flaws(line_rms=0.05, bounces=2, bounce_s=2e-5, seed=seed)
    found = edges_of(motion, DURATION_S, increment_m=SETTINGS.increment_m, tick_s=SETTINGS.tick_s, flaws=flaws)
    middle = len(found.tick) // 2
    keep = np.arange(len(found.tick)) != middle
    tick = found.tick.copy()
    tick[middle + 40] = tick[middle + 39]
    return Edges(tick[keep], found.channel[keep], found.level[keep], found.level_a, found.level_b, found.increment_m, found.tick_s)


def calls_of(edges: Edges) -> Iterator[Call]:
    """Changes and sampling instants in order."""
    levels, i = [edges.level_a, edges.level_b], 0
    for now in SETTINGS.period_ticks * np.arange(1, round(DURATION_S / SETTINGS.period_s) + 1):
        while i < len(edges.tick) and edges.tick[i] <= now:
            levels[int(edges.channel[i])] = int(edges.level[i])
            yield int(edges.tick[i]), levels[0], levels[1]
            i += 1
        yield (int(now),)


def expected(edges: Edges, start: float) -> np.ndarray:
    """What the compiled estimators give."""
    found = velocities(edges, SETTINGS, DURATION_S, start_velocity_m_s=start)
    assert found.invalid > 0
    return np.column_stack([found.position_m, found.high_pass, found.event_counter, found.gate, found.combined])


def by_c(library: ctypes.CDLL, real: type, edges: Edges, start: float) -> np.ndarray:
    class State(ctypes.Structure):
        _fields_ = [(q.name, ctypes.c_int64 if q.whole else real) for q in STATES]

    class Design(ctypes.Structure):
        _fields_ = [(q.name, ctypes.c_int64 if q.whole else real) for q in COEFFICIENTS]

    whole = ctypes.c_int64
    state, outputs, design = State(), (real * len(OUTPUTS))(), Design.in_dll(library, "beltcomm_encoder_design")
    library.beltcomm_encoder_reset.argtypes = [ctypes.c_void_p, whole, whole, real]
    library.beltcomm_encoder_edge.argtypes = [ctypes.c_void_p, whole, whole, whole]
    library.beltcomm_encoder_period.argtypes = [ctypes.c_void_p, ctypes.c_void_p, whole, ctypes.c_void_p]
    library.beltcomm_encoder_reset(ctypes.byref(state), edges.level_a, edges.level_b, start)
    rows = []
    for call in calls_of(edges):
        if len(call) == 3:
            library.beltcomm_encoder_edge(ctypes.byref(state), *call)
        else:
            library.beltcomm_encoder_period(ctypes.byref(design), ctypes.byref(state), *call, outputs)
            rows.append(list(outputs))
    return np.array(rows)


@needs_compiler
@pytest.mark.parametrize(("real", "rtol"), [("double", 1e-14), ("float", 2e-5)])
def test_the_c_file_gives_the_estimators_own_numbers(tmp_path: Path, real: str, rtol: float) -> None:
    """Float: each number is right to a few 2⁻²⁴ of its size, and the weight with its sine to some more; counts and times are whole."""
    edges = record(3)
    library = compiled(tmp_path, FORMATS["c"](encoder_of(SETTINGS, {"run": "a */ b"}, ["(* é"])), real)
    found = by_c(library, ctypes.c_double if real == "double" else ctypes.c_float, edges, 0.25)
    wanted = expected(edges, 0.25)
    np.testing.assert_allclose(found, wanted, rtol=rtol, atol=rtol * float(np.abs(wanted).max()))


@pytest.mark.parametrize("seed", [1, 2])
def test_the_function_block_gives_the_estimators_own_numbers(seed: int) -> None:
    edges, rows = record(seed), []
    block = FunctionBlock(FORMATS["st"](encoder_of(SETTINGS, {"run": "a *) b"}, ["(* é"])), "BELTCOMM_ENCODER")
    block.run(reset=True, level_a=edges.level_a, level_b=edges.level_b, reset_velocity_rad_s=0.25)
    for call in calls_of(edges):
        if len(call) == 3:
            block.run(reset=False, edge=True, tick=call[0], level_a=call[1], level_b=call[2])
        else:
            block.run(reset=False, edge=False, now_tick=call[0])
            rows.append([block.values[name] for name in NAMES])
    np.testing.assert_allclose(rows, expected(edges, 0.25), rtol=1e-14, atol=1e-12)


def test_the_equations_of_the_yaml_file_are_those_of_the_estimators(tmp_path: Path) -> None:
    (tmp_path / "encoder.yaml").write_text(FORMATS["yaml"](encoder_of(SETTINGS, {}, [])), encoding="utf-8")
    data, edges = read_yaml(tmp_path / "encoder.yaml"), record(4)

    values: dict[str, object] = {"__builtins__": {}, "max": max, "sin": math.sin, "real": float}
    values |= {name: item["value"] for name, item in data["coefficients"].items()}
    rows: list[list[object]] = []
    codes = {
        part: compile("\n".join(line.replace("else if ", "elif ") for e in data[part] for line in e["equations"]), part, "exec")
        for part in ("reset", "every_change", "every_period")
    }
    values |= {"level_a": edges.level_a, "level_b": edges.level_b, "reset_velocity_rad_s": 0.25}
    exec(codes["reset"], values)
    for call in calls_of(edges):
        values |= dict(zip(("tick", "level_a", "level_b") if len(call) == 3 else ("now_tick",), call, strict=True))
        exec(codes["every_change" if len(call) == 3 else "every_period"], values)
        if len(call) == 1:
            rows.append([values[name] for name in NAMES])
    np.testing.assert_allclose(np.array(rows, dtype=float), expected(edges, 0.25), rtol=1e-14, atol=1e-12)


def test_no_name_is_taken_by_a_language() -> None:
    names = [q.name for q in (*COEFFICIENTS, *STATES, *OUTPUTS, *EDGE_LOCALS, *PERIOD_LOCALS)]
    assert len(set(names)) == len(names)
    assert not RESERVED & set(names)


def test_a_time_out_without_an_end_is_refused() -> None:
    with pytest.raises(UsageError, match="needs an end"):
        encoder_of(EstimatorSettings(timeout_s=math.inf), {}, ())
