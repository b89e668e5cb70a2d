"""Responses side by side: places, amplitudes and directions that a simulated axis has, and the frequencies it was made with."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from beltcomm.effects.belt_spans import stiffness as stiffness_at
from beltcomm.errors import DataError
from beltcomm.excitation import prbs
from beltcomm.identify.landmarks import Pair, find_landmarks, shape_of
from beltcomm.jobs import laboratory
from beltcomm.model import Model, load_plant
from beltcomm.model.linear import modes, operating_point, sampled_response, state_space
from beltcomm.recording import ExcitationNote, Recording, Sidecar
from beltcomm.report.responses import responses_figure
from beltcomm.report.style import Caption, save
from beltcomm.response import FrequencyResponse
from beltcomm.sentences.response_table import Difference, ResponseTable, table_lines, table_of
from beltcomm.simulate.forward import simulate_torque

SPANS = {"specific_stiffness": 60e3, "pulley_distance": 0.79, "offset": 0.05}


@lru_cache
def by_place() -> Model:
    """Rig G_B with the belt of (2.26)."""
    return load_plant("g_b").model.without_effect("belt_stiffness").with_effect("belt_spans", SPANS)


def recorded(
    name: str, model: Model, place_m: float, amplitude_nm: float, push_nm: float = 0.0, seed: int = 0, periods: int = 4
) -> Recording:
    """PRBS of some measured periods on top of a torque that keeps the carriage moving, counted angle, noise on the torque."""
    signal = prbs(9, 2, 2.0 * amplitude_nm, 1e-3, periods)
    pushed = signal.torque + push_nm
    moved = simulate_torque(model, pushed, 1e-3, place_m)
    step = 2.0 * math.pi / 65536
    angle = np.floor((moved.position_rad - moved.position_rad[0]) / step + 0.5) * step
    note = ExcitationNote("prbs", amplitude_nm, signal.period_samples, signal.first_sample)
    noise = 6e-3 * np.random.default_rng(seed).standard_normal(len(pushed))
    return Recording(name, moved.t_s, pushed + noise, angle, sidecar=Sidecar("frf", place_m, excitation=note))


def marks(model: Model, place_m: float) -> tuple[float, float]:
    """Antiresonance and resonance of the model there, Hz."""
    at = operating_point(model, place_m, 1.0)
    return modes(model, at, held=("motor",))[-1].freq_hz, modes(model, at)[-1].freq_hz


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_landmarks_of_a_linear_axis_are_its_own(noise: float) -> None:
    """From 20 % beside: exact without noise, and within twice their interval with 10 %; and the interval is that of 10 %."""
    model = load_plant("g_a").model
    freq = 0.978 * np.arange(1, 500)
    h = sampled_response(model, operating_point(model, 0.25, 1.0), freq, 1e-3)
    random = np.random.default_rng(1).standard_normal((2, len(freq)))
    noisy = h * (1.0 + noise * (random[0] + 1j * random[1]) / math.sqrt(2.0))
    found = find_landmarks(
        FrequencyResponse(freq, noisy, noise * np.abs(h), np.ones(len(freq)), 4, 1e-3), Pair(1.2 * 19.6, 0.85 * 107.2, (0.05, 0.05))
    )
    for mark, true in zip((found.antiresonance, found.resonance), marks(model, 0.25), strict=True):
        assert mark is not None
        # (2.42) with n free is not the sampled response with its belt damper: 0.5 % without any noise.
        assert abs(mark.freq_hz / true - 1.0) < 0.005 + 2.0 * mark.interval_hz / true
        assert mark.interval_hz / true < 0.02
    assert found.scatter == pytest.approx(noise / math.sqrt(2.0), abs=0.02)


def payload(mass_kg: float, freq_hz: float) -> Model:
    swing = {"payload.mass": mass_kg, "stiffness": mass_kg * (math.tau * freq_hz) ** 2, "damping": 2.0, "hardening": 0.0}
    rig = load_plant("g_a").model
    return rig.with_values({"cart.mass": rig["cart.mass"] - mass_kg}).with_effect("payload_mode", swing)


def rig(effect: str, **values: float) -> Model:
    return load_plant("g_a").model.with_effect(effect, values)


#: Models, and antiresonance and resonance of their belt, Hz, by hand: √(c/m)/2π of what swings on it; the resonance of the motor, or of
#: what turns with it, against the belt.
SHAPES = {
    "plain": (load_plant("g_a").model, 19.6, 107.2),
    "payload at 8 Hz": (payload(5.0, 8.0), math.sqrt(203740 / 8.44) / math.tau, 107.2),
    "small payload at 60 Hz": (payload(1.0, 60.0), 19.6, 107.2),
    "cogging that holds the motor": (rig("cogging", sine=-0.25, order=12.0), 19.6, 110.0),
    "end pulley heavier than the motor": (rig("end_pulley", **{"end_pulley.mass": 1.5}), 19.6, 120.0),
    "coupling": (
        rig("coupling", **{"stiffness": 2000.0, "driving_pulley.inertia": 2e-5}),
        19.6,
        19.6 * math.sqrt(1.0 + 13.44 * 0.01242**2 / 9.173e-5),
    ),
    "the rig's data sheets": (load_plant("egc_70").model, 26.0, 142.0),
}


@pytest.mark.parametrize("name", SHAPES)
def test_the_pair_of_the_belt_is_known_by_its_shape(name: str) -> None:
    """Among modes of a payload, a pulley, a coupling, and of the axis as a whole on its cogging."""
    model, antiresonance, resonance = SHAPES[name]
    shape = shape_of(model, 0.25)
    assert shape is not None
    assert shape.belt.antiresonance_hz == pytest.approx(antiresonance, rel=0.06)
    assert shape.belt.resonance_hz == pytest.approx(resonance, rel=0.06)
    assert len(shape.beside) == len(model.bodies()) - 2
    at = operating_point(model, 0.25, 1.0)
    found = sorted(p.antiresonance_hz for p in (shape.belt, *shape.beside))
    assert found == pytest.approx([m.freq_hz for m in modes(model, at, held=("motor",))], rel=2e-3)


def test_the_pairs_make_up_the_response() -> None:
    """Rigid axis times all pairs is the response of the whole model."""
    model = payload(5.0, 8.0)
    shape = shape_of(model, 0.25)
    assert shape is not None
    freq = np.geomspace(2.0, 400.0, 300)
    at = operating_point(model, 0.25, 1.0)
    whole = state_space(model, at).response(freq)[:, 0]
    inertia = model["motor.inertia"] + model["transmission.ratio"] ** 2 * 13.44
    made = shape.belt.response(freq) * shape.beside[0].response(freq)
    gain = math.prod((p.resonance_hz / p.antiresonance_hz) ** 2 for p in (shape.belt, *shape.beside))
    made = -made * gain / (inertia * (math.tau * freq) ** 2)
    np.testing.assert_allclose(np.abs(made), np.abs(whole), rtol=0.05)


@pytest.mark.parametrize("name", ["payload at 8 Hz", "cogging that holds the motor", "end pulley heavier than the motor"])
def test_landmarks_beside_other_modes(name: str) -> None:
    """From 15 % beside, with 3 % of noise: the belt's pair, not the other one and not "no resonance"."""
    model, _, _ = SHAPES[name]
    shape = shape_of(model, 0.25)
    assert shape is not None
    freq = 0.5 * np.arange(4, 700)
    h = sampled_response(model, operating_point(model, 0.25, 1.0), freq, 1e-3)
    random = np.random.default_rng(2).standard_normal((2, len(freq)))
    noisy = h * (1.0 + 0.03 * (random[0] + 1j * random[1]) / math.sqrt(2.0))
    response = FrequencyResponse(freq, noisy, 0.03 * np.abs(h), np.ones(len(freq)), 4, 1e-3)
    expected = Pair(1.15 * shape.belt.antiresonance_hz, 0.87 * shape.belt.resonance_hz, shape.belt.damping)
    found = find_landmarks(response, expected, shape.beside)
    for mark, true in ((found.antiresonance, shape.belt.antiresonance_hz), (found.resonance, shape.belt.resonance_hz)):
        assert mark is not None
        assert mark.freq_hz == pytest.approx(true, rel=0.01)


def test_no_lines_no_landmarks() -> None:
    freq = np.array([1.0, 2.0, 3.0])
    with pytest.raises(DataError, match=r"0 clear lines lie between 9\.8 and 161 Hz, 16 are needed"):
        find_landmarks(FrequencyResponse(freq, freq + 0j, 0.0 * freq, 0.0 * freq, 2, 1e-3), Pair(19.6, 107.2, (0.05, 0.05)))


@pytest.fixture(scope="module")
def table() -> ResponseTable:
    model = by_place()
    records = [
        recorded("near", model, 0.10, 0.25),
        recorded("far", model, 0.50, 0.25, seed=1),
        recorded("quiet", model, 0.50, 0.15, seed=2),
        recorded("forth", model, 0.15, 0.08, 0.13, seed=3, periods=2),
        recorded("back", model, 0.45, 0.08, -0.13, seed=4, periods=2),
    ]
    return table_of(records, model)


def test_the_belt_is_stiffer_near_the_pulley_by_what_the_law_says(table: ResponseTable) -> None:
    """Ratio of the resonances squared is that of the stiffnesses (2.26), 2.64; both intervals are 1 % of a frequency, so 5 %."""
    rows = {row.condition.record: row for row in table.rows}
    near, far = (rows[name].landmarks.resonance for name in ("near", "far"))  # type: ignore[union-attr]
    assert near is not None
    assert far is not None
    stiffness = [stiffness_at(place, SPANS["specific_stiffness"], SPANS["pulley_distance"], SPANS["offset"]) for place in (0.10, 0.50)]
    assert (near.freq_hz / far.freq_hz) ** 2 == pytest.approx(stiffness[0] / stiffness[1], rel=0.05)
    (told,) = [d for d in table.differences if d.cause == "place"]
    assert (told.first, told.second) == ("near", "far")
    assert "stiffer nearer the driven pulley, as (2.26) has it" in told.text


def test_a_quieter_excitation_shows_more_friction(table: ResponseTable) -> None:
    (told,) = [d for d in table.differences if d.cause == "amplitude"]
    assert (told.first, told.second) == ("far", "quiet")
    assert "more motion below the antiresonance" in told.text
    assert "friction takes more of the quieter excitation" in told.text
    quiet = next(row for row in table.rows if row.condition.record == "quiet")
    assert quiet.gain_db < -quiet.gain_interval_db < 0.0


def test_moving_records_have_their_direction(table: ResponseTable) -> None:
    """Pushed each way: the place is the middle of the way, and the moving axis has no friction to pose as damping."""
    rows = {row.condition.record: row for row in table.rows}
    assert {name: row.condition.direction for name, row in rows.items()} == {
        "near": "standing", "far": "standing", "quiet": "standing", "forth": "forward", "back": "backward",
    }  # fmt: skip
    for name in ("forth", "back"):
        condition = rows[name].condition
        assert abs(condition.base_speed_m_s) > 0.01
        assert condition.place_m is not None
    assert rows["forth"].condition.place_m > 0.15  # type: ignore[operator]
    assert rows["back"].condition.place_m < 0.45  # type: ignore[operator]
    assert rows["forth"].gain_db > rows["quiet"].gain_db


def test_the_same_record_twice_differs_by_nothing() -> None:
    model = load_plant("g_b").model
    twice = table_of([recorded("one", model, 0.1, 0.4), recorded("two", model, 0.5, 0.4, seed=7)], model)
    assert twice.differences == ()
    assert twice.remarks == ("by place: no difference beyond the noise (1 pairs of records)",)


def test_words_numbers_and_picture(table: ResponseTable, tmp_path: Path) -> None:
    text = table_lines(table)
    assert sum(line.startswith(("near", "far", "quiet", "forth", "back")) for line in text) == 5
    assert any("reference" in line for line in text)
    data = table.to_dict()
    assert [one["record"] for one in data["records"]] == ["near", "far", "quiet", "forth", "back"]
    assert {"antiresonance", "resonance", "direction", "place_m", "amplitude_nm"} <= set(data["records"][0])
    shown = [(f"{row.condition.record}, {row.condition.words()}", row.response, row.landmarks) for row in table.rows]
    picture = responses_figure(shown, [d.text for d in table.differences], Caption("test", "none"))
    assert save(picture, tmp_path / "responses.png").stat().st_size > 50_000
    assert table_lines(table_of([], by_place())) == []


@pytest.mark.examination
def test_what_the_model_explains_is_no_warning(copy_of_complete: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """Friction makes responses of a sound axis differ; the screen tells it only beside a model that lacks something, the details always."""

    def told(missing: str | None) -> list[bool]:
        monkeypatch.setattr(laboratory, "compare", lambda *given: replace(compared(*given), missing=missing))
        done = laboratory.compare_run(copy_of_complete(name=str(missing)), pictures=False)
        return ["responses differ by place: a, b" in "\n".join(done.text), "a differs from b" in "\n".join(done.details)]

    made, compared = laboratory.table_of, laboratory.compare
    difference = Difference("place", "a", "b", "a differs from b")
    monkeypatch.setattr(laboratory, "table_of", lambda *given: replace(made(*given), differences=(difference,)))
    assert told(None) == [False, True]
    assert told("structure") == [True, True]
