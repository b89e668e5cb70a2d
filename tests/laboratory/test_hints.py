"""How far the belt was stretched where the model explains the records, against the carriage of the independent simulator."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from beltcomm.fit.estimate import BLOCK_S, Fitted
from beltcomm.fit.likelihood.free_parameters import free_parameters
from beltcomm.fit.likelihood.problem import Problem, time_blocks
from beltcomm.fit.residual.segment import segments
from beltcomm.laboratory.single_record import BY_CHANCE, _likeliest, explained_elongation
from identify.records import NOISE_NM, STEP_RAD, Recorder, true_model
from truth.rigs import draw


@pytest.mark.parametrize("share", [1.0, 0.5, 0.0])
def test_only_explained_moments_count(share: float) -> None:
    """All but this share of the blocks, those with the largest stretch, are called unexplained; what is left says how far."""
    plant = draw("g_b", np.random.default_rng(10))
    model = true_model(plant)
    record = Recorder().shaken(plant, 0.3, 2)
    assert record.cart_position_m is not None
    stretch = model["transmission.ratio"] * (record.position - record.position[0]) - (record.cart_position_m - record.cart_position_m[0])
    (piece,) = segments(record, model, STEP_RAD, NOISE_NM, fitted=True)
    assert len(piece.position) == len(stretch)
    blocks = time_blocks([piece], BLOCK_S)
    ends = {}
    for block in np.unique(blocks):
        rows = piece.value_samples[blocks == block]
        reached = stretch[rows.min() : rows.max() + 1]
        ends[block] = (-reached.min(), reached.max())
    explained = sorted(ends, key=lambda block: max(ends[block]))[: round(share * len(ends))]
    residual = np.where(np.isin(blocks, explained), 1.0, 2.0)
    problem = Problem([piece], model, free_parameters(model, ("transmission.ratio",)), BLOCK_S)
    fitted = SimpleNamespace(model=model, problem=problem, residual=residual, offsets=np.zeros(1))
    expected = np.quantile([ends[block] for block in explained], 1.0 - BY_CHANCE, axis=0) if explained else np.zeros(2)
    # the encoder's step is 1.5 um at the belt, the recorder's torque is 1 ms late: the carriage is known to some micrometres
    np.testing.assert_allclose(explained_elongation(cast("Fitted", fitted)), expected, atol=1e-5)


@pytest.mark.parametrize(("factor", "samples", "seen"), [(1.5, 1500, True), (1.5, 700, True), (4.0, 1500, False)])
def test_a_record_at_one_place_says_how_stiff_the_belt_is_there(factor: float, samples: int, seen: bool) -> None:
    """Also a short one, against a model whose belt is too soft; nothing is said beyond three times its stiffness."""
    plant = draw("g_b", np.random.default_rng(10))
    model = true_model(plant)
    record = Recorder().shaken(plant, 0.3, 2)
    part = replace(
        record,
        **{
            name: getattr(record, name)[600 : 600 + samples] for name in ("t_s", "torque", "torque_setpoint", "position", "cart_position_m")
        },
    )
    soft = model.with_values({"belt_stiffness.stiffness": model["belt_stiffness.stiffness"] / factor})
    pieces = segments(part, soft, STEP_RAD, NOISE_NM, fitted=True)
    found = _likeliest(cast("Fitted", SimpleNamespace(model=soft)), pieces[0])
    if not seen:
        assert found is None
    else:
        assert found == pytest.approx(model["belt_stiffness.stiffness"], rel=0.03)
