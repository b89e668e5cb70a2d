"""Feedforward terms by kind (4.15) to (4.17) and by what the drive has."""

from __future__ import annotations

from dataclasses import replace

import pytest

from beltcomm.control import CascadeStructure, Feedforward
from beltcomm.design.feedforward import feedforward_from
from beltcomm.errors import UsageError

FULL = CascadeStructure("reference", 1e-3, ("none",), velocity_feedforward=True, torque_feedforward=True)
#: G_A: errata 6, table A.10, and the 40 mN m s/rad that its frequency response shows (errata 7).
G_A = {"inertia_kg_m2": 0.002145, "viscous_nm_s_rad": 2.53e-3, "coulomb_nm": 0.125, "apparent_viscous_nm_s_rad": 0.040}


def test_nonlinear_takes_the_friction_of_the_sweep() -> None:
    assert feedforward_from(FULL, "nonlinear", **G_A, offset_nm=0.1, dead_time_s=1e-3) == Feedforward(
        0.002145, 2.53e-3, 0.125, 0.1, 1.0, 1.5e-3
    )


def test_linear_takes_the_apparent_damping_and_no_coulomb_friction() -> None:
    assert feedforward_from(FULL, "linear", **G_A) == Feedforward(0.002145, 0.040, 0.0, 0.0, 1.0, 0.5e-3)


def test_none_still_holds_a_tilted_axis() -> None:
    assert feedforward_from(FULL, "none", **G_A, offset_nm=-0.2) == Feedforward(offset_nm=-0.2, velocity=0.0)


@pytest.mark.parametrize("kind", ["nonlinear", "linear", "none"])
def test_a_drive_gets_only_the_terms_it_has(kind: str) -> None:
    bare = replace(FULL, velocity_feedforward=False, torque_feedforward=False)
    assert feedforward_from(bare, kind, **G_A, offset_nm=0.1) == Feedforward(velocity=0.0)  # type: ignore[arg-type]
    velocity_only = replace(FULL, torque_feedforward=False)
    assert feedforward_from(velocity_only, "nonlinear", **G_A) == Feedforward(velocity=1.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"kind": "linear", "apparent_viscous_nm_s_rad": None}, "apparent damping"),
        ({"kind": "cubic"}, "cubic"),
        ({"inertia_kg_m2": -1.0}, "inertia of the feedforward is -1"),
        ({"coulomb_nm": float("nan")}, "Coulomb friction of the feedforward is nan"),
        ({"offset_nm": float("inf")}, "offset"),
    ],
)
def test_what_cannot_be_fed_forward_is_refused_by_name(change: dict[str, object], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        feedforward_from(FULL, **{**G_A, **change})  # type: ignore[arg-type]
