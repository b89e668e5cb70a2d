"""What is compiled beside: waited for once, told as compiling, ended with this process; what a plain axis does not compile."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from beltcomm.compiled import when_compiling
from beltcomm.effects.current_lag import _lag_torque
from beltcomm.effects.dead_time import _delay_torque
from beltcomm.effects.measurement_lag import _read
from beltcomm.jobs.effect_search import _last_compiled
from beltcomm.laboratory.score import _gain_means, _load_means, _powers_of, gain_kernel, load_kernel
from beltcomm.model import build_model, expected_parameters
from beltcomm.simulate.inverse import FineMotion, torque_residuals
from beltcomm.simulate.kernels import ahead, compile_largest
from beltcomm.simulate.kernels.compose import _load_source, _motor_side_source, _plain_source, inverse_kernel
from beltcomm.simulate.kernels.switch_groups import needed_lines

SLEEP = "import time; time.sleep(0.3)"


def test_a_kernel_waits_for_what_was_begun_and_only_once() -> None:
    heard: list[str] = []
    when_compiling(lambda: heard.append("begun"), lambda: heard.append("ended"))
    call = ahead.after_waiting(lambda x: x + 1)
    ahead.start([sys.executable, "-S", "-c", SLEEP])
    begun = time.monotonic()
    assert call(1) == 2
    assert time.monotonic() - begun > 0.25
    assert heard == ["begun", "ended"]
    assert call(2) == 3
    assert heard == ["begun", "ended"]


def test_a_process_that_cannot_be_started_or_fails_stops_nothing(tmp_path: Path) -> None:
    call = ahead.after_waiting(lambda x: x + 1)
    ahead.start([str(tmp_path / "nothing")])
    assert call(1) == 2
    ahead.start([sys.executable, "-S", "-c", "raise SystemExit(3)"])
    assert call(2) == 3


def test_it_ends_with_the_process_that_began_it(tmp_path: Path) -> None:
    late = tmp_path / "late"
    child = f"import time; time.sleep(1); open({str(late)!r}, 'w')"
    text = f"import sys; from beltcomm.simulate.kernels import ahead; ahead.start([sys.executable, '-S', '-c', {child!r}])"
    subprocess.run([sys.executable, "-c", text], check=True)
    time.sleep(1.2)
    assert not late.exists()


def test_nothing_is_begun_where_it_was_done_before(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    started: list[object] = []
    monkeypatch.setattr(ahead, "start", started.append)
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1})
    note = tmp_path / "note"
    monkeypatch.setattr(ahead, "note_file", lambda: note)
    ahead.begin()
    assert len(started) == 1
    note.touch()
    ahead.begin()
    monkeypatch.setattr(ahead, "note_file", lambda: None)
    ahead.begin()
    monkeypatch.setattr(ahead, "note_file", lambda: tmp_path / "other")
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0})
    ahead.begin()
    assert len(started) == 1


def test_lines_that_nothing_asks_for_are_left_out() -> None:
    lines = ["a = p[0]", "b = 1.0 / a", "c = p[2]", "d = c"]
    assert needed_lines(lines, ["x = b * q"]) == ["a = p[0]", "b = 1.0 / a"]
    assert needed_lines(lines, ["x = bb"]) == []


def test_the_load_knows_nothing_of_what_acts_on_the_motor_alone_and_a_plain_one_no_observer() -> None:
    assert "cogging" not in _load_source()
    assert "cogging" in _motor_side_source()
    assert "see_" not in _plain_source()
    assert "def load(theta, omega, p, on, t, h, offset, load, cart):" in _plain_source()


def test_what_is_compiled_ahead_is_called_and_noted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The large load apart, which takes too long here; of a process beside nobody would hear that it failed."""
    module = SimpleNamespace(load=lambda *_given: None)
    monkeypatch.setattr(ahead, "note_file", lambda: tmp_path / "note")
    monkeypatch.setattr("beltcomm.simulate.kernels.compose.load_module", lambda: module)
    compile_largest.main()
    assert [path.name for path in tmp_path.iterdir()] == ["note"]


def test_the_note_is_another_one_for_another_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    note = ahead.note_file()
    assert note is not None
    assert note.parent == tmp_path / "beltcomm" / "kernels"
    assert note == ahead.note_file()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "other"))
    assert note != ahead.note_file()
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert ahead.note_file() is None


def test_what_is_needed_later_is_called_while_there_is_nothing_else_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    called: list[str] = []
    monkeypatch.setattr(ahead, "note_file", lambda: None)
    ahead.begin([lambda: called.append("first"), lambda: called.append("second")])
    ahead.wait()
    assert called == []
    ahead.start([sys.executable, "-S", "-c", SLEEP])
    ahead.wait()
    assert called == ["first", "second"]


def test_what_a_search_compiles_last_is_called_with_the_types_of_its_own_calls() -> None:
    inverse = inverse_kernel()
    kernels: list[Any] = [load_kernel, gain_kernel, inverse.torque, inverse.angle, _delay_torque, _lag_torque, _read]
    for call in _last_compiled():
        call()
    known = [set(kernel.signatures) for kernel in kernels]
    motion, torque = FineMotion(np.linspace(0.0, 1.0, 9), np.ones(9), 5, 1e-3, 2, 0.0), np.zeros(5)
    torque.flags.writeable = False  # as recorded
    piece: Any = SimpleNamespace(motion=motion, torque=torque)
    next(_load_means(piece, _powers_of(9), 1))
    next(_gain_means(piece, _powers_of(8), 1))
    for lag in ("current_lag", "measurement_lag"):  # a model has one of them
        late = ("dead_time", lag, "torque_ripple", "encoder_eccentricity")
        values = {name: 1.0 if name.endswith("order") else 1e-3 for name in expected_parameters(late, ("motor",))}
        model = build_model(lag, late, values, base_bodies=("motor",))
        torque_residuals(model, motion, torque, [model.vector()], [0.0])[0]
    assert [set(kernel.signatures) for kernel in kernels] == known
    assert all(known)
