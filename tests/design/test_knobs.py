"""The three knobs: there and back to 1e-6, gains read exactly, and what each of them moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from beltcomm.control import Cascade, Prefilter, PrefilterKind
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.knobs import Knobs, _gains_for, designs_along_knob, knobs_of
from beltcomm.design.thesis import thesis_margins
from beltcomm.errors import Refused
from beltcomm.thesis.designs import _published_gains, thesis_plants

G_A, G_B, S_A, S_B, S_C = thesis_plants()


@pytest.mark.parametrize("kind", ["none", "notch", "butterworth"])
@pytest.mark.parametrize("plant", [G_A, G_B, S_B], ids=lambda plant: plant.name)
def test_knobs_to_gains_to_knobs_to_one_in_a_million(plant: DesignPlant, kind: PrefilterKind) -> None:
    rng = np.random.default_rng(2)
    solved = 0
    for _ in range(12):
        knobs = Knobs(float(rng.uniform(30.0, 75.0)), float(rng.uniform(50.0, 86.0)), float(rng.uniform(-20.0, -6.0)))
        try:
            design = _gains_for(plant, kind, knobs)
        except Refused:
            continue
        solved += 1
        achieved = knobs_of(plant, design.cascade)
        assert achieved.knobs.phase_margin_deg == pytest.approx(knobs.phase_margin_deg, abs=1e-6)
        assert achieved.knobs.position_phase_margin_deg == pytest.approx(knobs.position_phase_margin_deg, abs=1e-6)
        assert achieved.knobs.suppression_db == pytest.approx(knobs.suppression_db, abs=1e-6)
        assert achieved.same
    assert solved >= 4


def test_knobs_are_what_an_independent_formula_says() -> None:
    """C_B on G_A: the loop written out from table A.4 and the printed filters, read on a grid of 2 million frequencies."""
    cascade = _published_gains(G_A)["C_B (Butterworth)"]
    s = 1j * np.linspace(1.0, 120.0, 2_000_000)
    i, theta, m, c, dm, dc = 0.01242, 71.73e-6, 13.44, 203.74e3, 33.17, 226.42

    def loops(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        total = theta + i**2 * m
        rigid = s * (s * total + i**2 * (dm + dc))
        belt = (m * s**2 + dc * s + c) / (theta * m / total * s**2 + (i**2 * m * dm + theta * dc) / total * s + c)
        forward = (0.12 + 1.39 / s) / ((s / 123.24) ** 2 + np.sqrt(2.0) * s / 123.24 + 1.0) * belt / rigid * np.exp(-0.001 * s)
        velocity = forward * s / (0.002 * s + 1.0)
        return velocity, 6.29 * forward / (1.0 + velocity)

    velocity, position = loops(s)
    margins = [np.degrees(np.angle(-loop[np.flatnonzero(np.abs(loop) < 1.0)[0]])) for loop in (velocity, position)]
    omega_r = np.sqrt(c * (theta + i**2 * m) / (theta * m))
    level = 20.0 * np.log10(abs(loops(np.array([1j * omega_r]))[0][0]))
    found = knobs_of(G_A, cascade).knobs
    # A step of the grid is 6e-5 rad/s; the phase turns by 2 degrees per rad/s at most.
    assert (found.phase_margin_deg, found.position_phase_margin_deg) == pytest.approx(margins, abs=2e-4)
    assert found.suppression_db == pytest.approx(level, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "knobs"), [("C_A (notch)", (60.2, 75.2, -9.3)), ("C_B (Butterworth)", (61.7, 81.5, -8.7))], ids=["C_A", "C_B"]
)
def test_the_published_gains_come_back_from_their_knobs(name: str, knobs: tuple[float, float, float]) -> None:
    """Tables A.6, A.7 and the margins in the thesis sheet; the notch stands at its printed d_n of 4.60."""
    cascade = _published_gains(G_A)[name]
    setting = knobs_of(G_A, cascade)
    stands = (setting.knobs.phase_margin_deg, setting.knobs.position_phase_margin_deg, setting.knobs.suppression_db)
    assert stands == pytest.approx(knobs, abs=0.05)
    assert setting.same
    assert setting.again is not None
    again = setting.again.cascade
    gains = (again.kp_nm_s_rad, again.ki_nm_rad, again.kpp_1_s)
    assert gains == pytest.approx((cascade.kp_nm_s_rad, cascade.ki_nm_rad, cascade.kpp_1_s), rel=1e-9)


@pytest.mark.parametrize("kind", ["notch", "butterworth"])
def test_the_position_margin_moves_the_position_gain_alone(kind: PrefilterKind) -> None:
    turns = designs_along_knob(G_A, kind, "position_phase_margin_deg", np.linspace(45.0, 88.0, 12))
    cascades = [turn.design.cascade for turn in turns if turn.design is not None]
    assert len(cascades) == 12
    assert {(c.kp_nm_s_rad, c.ki_nm_rad) for c in cascades} == {(cascades[0].kp_nm_s_rad, cascades[0].ki_nm_rad)}
    assert np.all(np.diff([c.kpp_1_s for c in cascades]) < 0.0)


@pytest.mark.parametrize("kind", ["notch", "butterworth"])
def test_more_velocity_margin_costs_integral_and_position_gain(kind: PrefilterKind) -> None:
    designs = [turn.design for turn in designs_along_knob(G_A, kind, "phase_margin_deg", np.linspace(30.0, 78.0, 12))]
    assert all(design is not None for design in designs)
    for read in (lambda d: d.cascade.ki_nm_rad, lambda d: d.cascade.kpp_1_s, lambda d: d.crossover_rad_s):
        assert np.all(np.diff([read(design) for design in designs]) < 0.0)
    kp = [design.cascade.kp_nm_s_rad for design in designs if design is not None]
    assert max(kp) / min(kp) < 1.01


@pytest.mark.parametrize(("kind", "peak_db"), [("notch", -5.0), ("butterworth", -11.0)])
def test_more_suppression_costs_crossover_and_the_integral_gain_has_a_maximum(kind: PrefilterKind, peak_db: float) -> None:
    values = np.arange(-3.0, -25.0, -1.0)
    found = [(turn.value, turn.design) for turn in designs_along_knob(G_A, kind, "suppression_db", values) if turn.design is not None]
    assert np.all(np.diff([design.cascade.kp_nm_s_rad for _, design in found]) < 0.0)
    assert np.all(np.diff([design.crossover_rad_s for _, design in found]) < 0.0)
    ki = [design.cascade.ki_nm_rad for _, design in found]
    at = int(np.argmax(ki))
    assert 0 < at < len(ki) - 1
    assert found[at][0] == peak_db
    assert np.all(np.diff(ki[: at + 1]) > 0.0)
    assert np.all(np.diff(ki[at:]) < 0.0)


def test_a_knob_that_cannot_stand_there_says_why() -> None:
    (turn,) = designs_along_knob(S_A, "butterworth", "suppression_db", [-10.0])
    assert turn.design is None
    assert "-18.8 dB" in turn.refusal


def test_gains_beyond_the_antiresonance_have_knobs_that_lead_elsewhere() -> None:
    """K_P five times table A.7: the first crossover still has a margin, but the equations do not give these gains back."""
    gains = replace(_published_gains(G_A)["C_B (Butterworth)"], kp_nm_s_rad=0.6)
    setting = knobs_of(G_A, gains)
    assert not setting.same
    assert setting.knobs.suppression_db == pytest.approx(thesis_margins(G_A, gains).suppression_db)


def test_gains_without_a_crossover_have_no_knobs() -> None:
    with pytest.raises(Refused, match="does not fall through 1"):
        knobs_of(G_A, Cascade(0.0, 0.0, 5.0, 0.002, Prefilter()))
