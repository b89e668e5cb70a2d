"""python-can is loaded without pandas, by whichever side asks for it first."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize("first", ["beltcomm_adapters.canopen", "beltcomm.virtual.bus"])
def test_a_drive_is_reached_without_loading_pandas(first: str) -> None:
    told = f"import sys, {first}; print('can' in sys.modules, 'pandas' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "False"]
