"""The examples of docs/python.md do what they say."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltcomm.model import load_plant

PAGE = Path(__file__).parents[2] / "docs" / "python.md"


def blocks(language: str) -> list[str]:
    found: list[str] = re.findall(rf"```{language}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert found
    return found


@pytest.mark.examination
def test_the_examples_run_from_top_to_bottom(copy_of_complete: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    run = copy_of_complete(name="my-run")
    (run.parent / "runs").mkdir()
    run.rename(run.parent / "runs" / "my-run")
    monkeypatch.chdir(run.parent)
    names: dict[str, Any] = {}
    for block in blocks("python"):
        exec(compile(block, str(PAGE), "exec"), names)
    assert names["found"].exit_code == 0
    assert names["diagnosed"].data["named"] == []
    assert list(names["frame"].columns[:1]) == ["torque_nm"]
    assert names["frame"].index[-1] == names["record"].t_s[-1]
    assert names["picture"]._repr_png_().startswith(b"\x89PNG")
    assert names["system"].poles() == pytest.approx(np.linalg.eigvals(names["run"].model.linear(0.25).A))
    assert names["designed"].exit_code == 0
    assert Path(names["page"]).is_file()
    assert abs(names["h"][0]) > abs(names["h"][-1])
    assert names["motion"].belt_force_n.max() > 1.0


def test_the_plant_file_is_one(tmp_path: Path) -> None:
    (block,) = blocks("yaml")
    path = tmp_path / "light.yaml"
    path.write_text(block, encoding="utf-8")
    assert load_plant(path).model["cart.mass"] == 4.0
