"""Traces of a drive whose loops are faster than the record: the torque changes between the samples, and its reading is one of an instant.

The axis is the independent simulator's; its speed loop at 8 kHz behind a current loop of first order is written out here, and every
eighth period of it is recorded.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.signal import lfilter

from beltcomm.fit.model_fit import fit_model
from beltcomm.fit.torque.laws import DriveLaw, ReadingLaw
from beltcomm.fit.torque.path import TorquePath, _spline_cells, _spline_noise, path_from_dict, path_to_dict
from beltcomm.fit.torque.reading_fit import unlikely_readings
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import ExcitationNote, Sidecar
from beltcomm.rundata.delays import measure_delay_and_damping
from beltcomm.rundata.findings import Findings
from beltcomm.sentences.torque_path import path_lines
from identify.records import COUNTS, NOISE_NM, PERIOD_S, STEP_RAD, true_model
from truth.rigs import draw

Array = NDArray[np.float64]

#: Loops in a period of the record; s, time constant of the current loop; s, length of a record.
INNER, CURRENT_S, RECORD_S = 8, 4e-4, 4.0
TOLD = ("motor.inertia", "cart.mass", "belt_stiffness.stiffness")


def traced(seed: int, name: str, *, with_setpoint: bool = True) -> Recording:
    """A trace under a speed loop on a sum of sines: setpoint, torque and counted angle at the beginning of each period of the record."""
    plant, rng = draw("g_b", np.random.default_rng(3)), np.random.default_rng(seed)
    h, zero = PERIOD_S / INNER, plant.position_rad
    moved = plant.axis.inertia_kg_m2 + plant.axis.transmission_m_rad**2 * plant.axis.mass_kg
    gain = 2.0 * math.pi * 8.0 * moved
    sines = [(rng.uniform(4.0, 12.0), 2.0 * math.pi * rng.uniform(0.3, 60.0), rng.uniform(0.0, 6.3)) for _ in range(14)]
    torque = before = speed = whole = 0.0
    rows = []
    for n in range(round(RECORD_S / h)):
        angle = math.floor((plant.position_rad - zero) / STEP_RAD + 0.5) * STEP_RAD
        speed, before = speed + 0.3 * ((angle - before) / h - speed), angle
        asked = sum(size * math.sin(rate * n * h + phase) for size, rate, phase in sines) - 2.0 * angle
        whole += 20.0 * h * (asked - speed)
        setpoint = gain * (asked - speed + whole)
        if n % INNER == 0:
            rows.append((setpoint, torque, angle))
        left = (torque - setpoint) * math.exp(-h / CURRENT_S)
        plant.step(setpoint + (torque - setpoint - left) * CURRENT_S / h, h)
        torque = setpoint + left
    asked_nm, acting_nm, position = np.array(rows).T
    return Recording(
        name=name,
        t_s=PERIOD_S * np.arange(len(position)),
        torque=acting_nm + rng.normal(0.0, NOISE_NM, len(position)),
        torque_setpoint=asked_nm if with_setpoint else None,
        position=position,
        cart_position_m=None,
        sidecar=Sidecar("trajectory", start_position_m=0.0),
    )


@pytest.mark.parametrize("with_setpoint", [True, False])
def test_the_torque_of_a_faster_loop_changes_between_the_samples(with_setpoint: bool) -> None:
    records = [traced(seed, f"trace_{seed}", with_setpoint=with_setpoint) for seed in (1, 2)]
    truth = true_model(draw("g_b", np.random.default_rng(3)))
    start = truth.with_values({name: factor * truth[name] for name, factor in zip(TOLD, (1.1, 0.9, 1.15), strict=True)})
    found = fit_model(records, start, counts_per_rev=COUNTS)
    assert found.path.instantaneous
    assert abs(found.path.reading.late) < 0.1
    assert path_lines(found.path, PERIOD_S)[0].startswith("the torque changes between the samples")
    assert 0.95 < found.misfit < 1.1
    for name in TOLD:
        item = found.model.parameters[name]
        assert item.interval is not None
        assert abs(item.value - truth[name]) < 1.5 * item.interval, name


def test_the_cells_are_means_of_the_spline_through_the_readings() -> None:
    torque, late = np.random.default_rng(4).normal(size=40), 0.3
    spline = make_interp_spline(np.arange(40), torque, bc_type="not-a-knot")
    cells = _spline_cells(torque, late, 8)
    for period, cell in ((0, 0), (17, 3), (30, 7)):
        inside = period + (cell + (np.arange(400) + 0.5) / 400) / 8 + late
        assert cells[period, cell] == pytest.approx(float(np.mean(spline(inside))), abs=1e-6)
    np.testing.assert_allclose(_spline_cells(torque, -1.5, 4)[0, :2], torque[0])
    np.testing.assert_allclose(_spline_cells(torque, 1.5, 4)[-1], torque[-1])
    np.testing.assert_array_equal(_spline_cells(torque[:1], 0.1, 4), np.full((1, 4), torque[0]))  # a sample between two gaps


@pytest.mark.parametrize("pole", [0.0, 0.6])
def test_the_noise_has_the_spectrum_that_the_residual_makes_of_it(pole: float) -> None:
    colour = _spline_noise(pole)
    impulse = np.zeros(512)
    impulse[256] = 1.0
    cells = _spline_cells(impulse, 0.0, 64)
    rising = (np.arange(64) + 0.5) / 64**2
    answer = cells @ rising[::-1] + np.concatenate(([0.0], cells[:-1] @ rising))
    own = lfilter([math.sqrt(1.0 - pole**2)], [1.0, -pole], np.r_[1.0, np.zeros(511)])
    found = lfilter(colour.numerator, colour.denominator, np.r_[1.0, np.zeros(511)])
    np.testing.assert_allclose(np.abs(np.fft.rfft(found)), np.abs(np.fft.rfft(answer) * np.fft.rfft(own)), rtol=2e-3)


def test_readings_say_nothing_of_a_path_that_takes_them_as_they_are() -> None:
    held = [TorquePath(DriveLaw(delay)) for delay in (0.0, 1.0)]
    records = [traced(1, "trace")]
    both = unlikely_readings(held, records)
    assert unlikely_readings([held[0], TorquePath(instantaneous=True), held[1]], records) == [both[0], 0.0, both[1]]
    assert unlikely_readings([TorquePath(instantaneous=True)], records) == [0.0]


def test_the_delay_to_the_torque_is_that_between_instants() -> None:
    """The torque that acts is a mean over the period behind its sample, the setpoint beside it an instant: half a period was lost."""
    rng, time = np.random.default_rng(6), PERIOD_S / INNER * np.arange(6000 * INNER)
    sines = np.array([np.sin(math.tau * hz * time + phase) for hz, phase in zip(range(1, 61), rng.uniform(0.0, 6.3, 60), strict=True)])
    setpoint, keeps = 0.05 * sines.sum(axis=0), math.exp(-PERIOD_S / INNER / CURRENT_S)
    acting = lfilter([1.0 - keeps], [1.0, -keeps], np.r_[0.0, setpoint[:-1]])
    note = ExcitationNote("multisine", 1.0, 1000, 1000)
    record = Recording(
        name="trace",
        t_s=PERIOD_S * np.arange(6000),
        torque=acting[::INNER],
        torque_setpoint=setpoint[::INNER],
        position=1e-3 * np.cumsum(acting[::INNER]),
        cart_position_m=None,
        sidecar=Sidecar("frf", excitation=note),
    )
    model = true_model(draw("g_b", np.random.default_rng(3)))
    findings = Findings(kept_path=TorquePath(instantaneous=True))
    measure_delay_and_damping(findings, [record], model)
    assert findings.dead_time is not None
    assert findings.dead_time.value_s == pytest.approx(CURRENT_S, abs=1e-4)


def test_the_path_is_kept_with_the_model() -> None:
    path = TorquePath(None, ReadingLaw(-0.04), instantaneous=True)
    assert path_from_dict(path_to_dict(path)) == path
    assert not path.read_as_acts
    assert path_lines(path, PERIOD_S) == [
        "the torque changes between the samples, as under a loop that is faster than the record, read 0.04 samples early"
    ]
