"""The scripts and the notebook of examples/ run as they stand, from another folder."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltcomm.model import load_plant

EXAMPLES = Path(__file__).parents[2] / "examples"
#: What must be said on the screen, beside an exit code of 0.
SAID = {
    "commission_virtual_axis.py": "The axis meets its targets.",
    "find_hidden_effect.py": "friction_position",
    "own_measurements.py": "error 1.0",
}


def test_every_example_is_run_and_listed() -> None:
    files = {path.name for path in EXAMPLES.iterdir() if path.suffix in (".py", ".ipynb")}
    page = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    assert files == {*SAID, "from_response_to_gains.ipynb"}
    assert all(f"({name})" in page for name in files)


@pytest.mark.parametrize("name", SAID)
def test_a_script_runs(name: str, tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-W", "error", EXAMPLES / name], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert SAID[name] in done.stdout
    assert {path.name for path in tmp_path.iterdir()} == {"runs"}


def test_the_notebook_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    notebook = json.loads((EXAMPLES / "from_response_to_gains.ipynb").read_text(encoding="utf-8"))
    names: dict[str, Any] = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert not cell["outputs"], "the notebook is kept without outputs"
            exec(compile("".join(cell["source"]), cell["id"], "exec"), names)
    assert names["model"]["cart.mass"] == pytest.approx(load_plant("g_b").model["cart.mass"], rel=0.02)
    assert (np.abs(names["h"][:5]) > 3.0 * np.abs(names["measured"].h[:5])).all(), "friction poses as damping"
    assert capsys.readouterr().out.count("K_PP") == 2
