"""The scripts and the notebook of examples/ run as they stand, from another folder."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltcomm.model import load_plant

EXAMPLES = Path(__file__).parents[2] / "examples"
#: What must be said on the screen, beside an exit code of 0.
SAID = {
    "commission_virtual_axis.py": "PASS",
    "own_measurements.py": "error 1.0",
}


def test_every_example_is_run_and_listed() -> None:
    files = {path.name for path in EXAMPLES.iterdir() if path.suffix in (".py", ".ipynb")}
    page = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    assert files == {*SAID, "find_hidden_effect.ipynb", "from_response_to_gains.ipynb"}
    assert all(f"({name})" in page for name in files)


@pytest.mark.examination
@pytest.mark.parametrize("name", SAID)
def test_a_script_runs(name: str, tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-W", "error", EXAMPLES / name], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert SAID[name] in done.stdout
    assert {path.name for path in tmp_path.iterdir()} == {"runs"}


@pytest.fixture
def run_notebook(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], dict[str, Any]]:
    """Runs a notebook from top to bottom, and shows the last value of each cell as a notebook does; gives back its names."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")

    def run(name: str) -> dict[str, Any]:
        names: dict[str, Any] = {}
        for cell in json.loads((EXAMPLES / name).read_text(encoding="utf-8"))["cells"]:
            if cell["cell_type"] != "code":
                continue
            assert not cell["outputs"], "the notebook is kept without outputs"
            tree = ast.parse("".join(cell["source"]), cell["id"])
            last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
            exec(compile(tree, cell["id"], "exec"), names)
            if isinstance(last, ast.Expr):
                shown = eval(compile(ast.Expression(last.value), cell["id"], "eval"), names)
                ways = [way for way in ("_repr_html_", "_repr_png_") if hasattr(shown, way)]
                names.setdefault("shown", []).extend(getattr(shown, way)() for way in ways)
        return names

    return run


@pytest.mark.examination
def test_the_notebook_on_a_response_runs(run_notebook: Callable[[str], dict[str, Any]], capsys: pytest.CaptureFixture[str]) -> None:
    names = run_notebook("from_response_to_gains.ipynb")
    assert names["model"]["cart.mass"] == pytest.approx(load_plant("g_b").model["cart.mass"], rel=0.02)
    assert (np.abs(names["h"][:5]) > 3.0 * np.abs(names["measured"].h[:5])).all(), "friction poses as damping"
    assert capsys.readouterr().out.count(" N m s/rad, Ki ") == 2


@pytest.mark.examination
def test_the_notebook_on_a_hidden_fault_tells_it(run_notebook: Callable[[str], dict[str, Any]]) -> None:
    """The fault is named, the error falls, mass is the plant's, and what a notebook shows is a table or a picture."""
    names = run_notebook("find_hidden_effect.ipynb")
    assert names["diagnosed"].data["named"] == ["friction_position"]
    assert names["compared"].data["ratio"]["overall"] > 1.5
    assert names["run"].compare().data["ratio"]["overall"] < 1.05
    true = load_plant("g_b").model["cart.mass"]
    assert names["run"].model.mass.value == pytest.approx(true, abs=3.0 * names["mass"].interval)
    assert names["run"].model["friction_position.place"].value == pytest.approx(0.3, abs=0.01)
    assert next(kind for kind in names["shown"] if isinstance(kind, bytes)).startswith(b"\x89PNG")
    assert any("<table>" in text and "frf_1" in text for text in names["shown"] if isinstance(text, str))
