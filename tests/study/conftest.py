"""A small study of the rig with gains of a commissioning, and its results computed by this process alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from beltcomm import api
from beltcomm.configfiles import to_yaml

MEMBERS = 20
#: Environment of a process whose linear algebra does not stay in one thread, as it does here: no result depends on it.
MORE_THREADS = {"OPENBLAS_NUM_THREADS": "2"}
STUDY: dict[str, Any] = {
    "name": "small",
    "base": {
        "plant": "g_a",
        "axis": "egc-70-600",
        "gains": {
            "kp_nm_s_rad": 0.0878, "ki_nm_rad": 0.417, "kpp_1_s": 14.6, "velocity_filter_s": 0.004, "prefilter_kind": 2,
            "prefilter_omega_rad_s": 123.2, "filter_reference": 1, "ff_inertia_kg_m2": 0.002145, "ff_viscous_nm_s_rad": 0.00253,
            "ff_coulomb_nm": 0.125, "ff_velocity": 1, "ff_advance_s": 0.0015,
        },
    },
    "members": MEMBERS,
    "seed": 3,
    "population": {
        "cart.mass": {"tolerance": "2 %"},
        "belt_stiffness.stiffness": {"uniform": ["180 kN/m", "220 kN/m"]},
        "payload": {"choice": ["0 kg", "2 kg"]},
        "drive.delay": {"uniform": ["0.5 ms", "1.5 ms"]},
    },
    "ageing": {"age": {"uniform": [0, 1]}, "when_old": {"coulomb.level": "+40 %"}},
}  # fmt: skip


@pytest.fixture(scope="session")
def written(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """A study file: the small study with other entries."""

    def write(**other: Any) -> Path:
        path = tmp_path_factory.mktemp("study") / "small.yaml"
        path.write_text(to_yaml({key: value for key, value in {**STUDY, **other}.items() if value is not None}), encoding="utf-8")
        return path

    return write


@pytest.fixture(scope="session")
def small(written: Callable[..., Path]) -> Path:
    return written()


@pytest.fixture(scope="session")
def alone(small: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the small study, computed by one process."""
    out = tmp_path_factory.mktemp("alone")
    api.study(small, out, workers=1)
    return out
