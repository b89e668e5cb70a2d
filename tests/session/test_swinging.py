"""A payload that swings in the first response: what the first loop counts with, and when it does not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from beltcomm.axis import load_axis
from beltcomm.control import Cascade
from beltcomm.errors import Refused
from beltcomm.experiments import payload_mode_in_first_fit
from beltcomm.identify.final import FinalModel, final_model
from beltcomm.recording import Recording
from beltcomm.rundata.analyse import moved_inertia
from beltcomm.rundata.offline import THESIS_STRUCTURE
from identify.records import COUNTS, Recorder
from truth.hidden import draw
from truth.hidden.machines import Machine
from truth.hidden.plant import HiddenPlant

RIG = load_axis("egc-70-600")
AT_M = 0.25


def first_fit(machine: Machine) -> tuple[FinalModel, Recording]:
    """What a first response of a machine is fitted with."""
    plant: Any = HiddenPlant(machine, AT_M)
    record = Recorder().shaken(plant, 0.2, 5, "frf_1", at_m=AT_M)
    return final_model([record], RIG, COUNTS), record


@pytest.mark.examination
def test_a_swinging_payload_is_found_behind_a_fit_too_light_and_counts_as_a_part_of_the_carriage() -> None:
    """882005: the first loop drifted 50 mm off, because a third of the inertia was missing in what it sent ahead."""
    machine = draw(882005, ("payload_mode",), 0.7, "rig")
    found, record = first_fit(machine)
    hidden, base = machine.hidden["payload_mode"], machine.base
    whole = base.inertia_kg_m2 + base.radius_m**2 * (base.mass_kg + hidden["mass_kg"])
    assert found.fit.suspect
    assert moved_inertia(found.fit.model) < 0.8 * whole

    swing = payload_mode_in_first_fit.with_swing(found, [record], RIG, COUNTS)
    assert swing is not None
    assert swing["payload.mass"] == pytest.approx(hidden["mass_kg"], rel=0.05)
    one = payload_mode_in_first_fit.as_one(swing)
    assert set(one.effects) == set(found.fit.model.effects)
    assert moved_inertia(one) == pytest.approx(moved_inertia(swing))
    assert moved_inertia(one) == pytest.approx(whole, rel=0.02)
    friction = base.viscous_nm_s_rad + base.radius_m**2 * base.drag_n_s_m
    assert one["viscous.damping"] + base.radius_m**2 * one["viscous_cart.damping"] == pytest.approx(friction, rel=0.1)
    assert "0.3 kg" in payload_mode_in_first_fit.swing_words(swing)
    assert "36" in payload_mode_in_first_fit.swing_words(swing)

    gentle = Cascade(0.0094, 0.156, 3.77, 2e-3)
    assert payload_mode_in_first_fit.proven_margin_deg(swing, gentle, THESIS_STRUCTURE, AT_M, 1e-3, 0.034) > 30.0
    with pytest.raises(Refused, match=r"36.* Hz.*would not hold: fix the payload"):
        payload_mode_in_first_fit.proven_margin_deg(swing, replace(gentle, kp_nm_s_rad=0.2), THESIS_STRUCTURE, AT_M, 1e-3, 0.034)


@pytest.mark.examination
def test_no_payload_is_made_of_a_machine_whose_response_something_else_bends() -> None:
    found, record = first_fit(draw(883006, ("cogging",), 0.7, "rig"))
    assert payload_mode_in_first_fit.with_swing(found, [record], RIG, COUNTS) is None
