"""From setpoint to torque and reading: each filter against its response on a fine grid, and a reading whose filter is put back."""

from __future__ import annotations

import json
import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import lfilter

from beltcomm.fit.torque.lag import Lag
from beltcomm.fit.torque.laws import DriveLaw, ReadingLaw, torque_at
from beltcomm.fit.torque.path import FAITHFUL, TorquePath, path_from_dict, path_to_dict
from beltcomm.simulate.imperfect import CELLS
from fit.drives import FINE, behind, first_order, held, second_order, smoothed

SAMPLE_S = 1e-3


@pytest.fixture(scope="module")
def setpoint() -> np.ndarray:
    """Steps of every size, from another value than zero."""
    return 0.1 + np.random.default_rng(1).choice([-0.3, -0.1, 0.0, 0.2], 80)


def means(course: np.ndarray, cells: int) -> np.ndarray:
    """Mean of each cell of a course on the fine grid."""
    return np.asarray(course.reshape(len(course), cells, -1).mean(axis=2))


@pytest.mark.parametrize("delay", [0.0, 1.0, 2.0, 1.57, 0.08, 3.5])
def test_a_delay_holds_each_setpoint_so_much_later(setpoint: np.ndarray, delay: float) -> None:
    found = DriveLaw(delay, (), 0.8).cells(setpoint, SAMPLE_S)
    np.testing.assert_allclose(found, 0.8 * means(held(setpoint, delay), CELLS), atol=1e-12)


@pytest.mark.parametrize("time_s", [1e-4, 4e-4, 2e-3, 2e-2])
def test_a_filter_of_first_order_answers_as_its_differential_equation(setpoint: np.ndarray, time_s: float) -> None:
    found = DriveLaw(1.0, (Lag("first order", (time_s,)),)).cells(setpoint, SAMPLE_S)
    wanted = means(behind(held(setpoint, 1.0), SAMPLE_S, *first_order(time_s)), CELLS)
    # The trapezoid of the fine grid: (h/T)²/12 of a step.
    np.testing.assert_allclose(found, wanted, atol=0.5 * (SAMPLE_S / FINE / time_s) ** 2 / 12.0 + 1e-12)


@pytest.mark.parametrize(("frequency_hz", "damping_ratio"), [(300.0, 0.5), (300.0, 1.0), (500.0, 2.0), (800.0, 0.7)])
def test_a_filter_of_second_order_answers_as_its_differential_equation(
    setpoint: np.ndarray, frequency_hz: float, damping_ratio: float
) -> None:
    """Between the ends of its cells it is taken as straight: off by h² y''/12 at most, h a cell."""
    found = DriveLaw(1.0, (Lag("second order", (frequency_hz, damping_ratio)),)).cells(setpoint, SAMPLE_S)
    course = behind(held(setpoint, 1.0), SAMPLE_S, *second_order(frequency_hz, damping_ratio))
    wanted, bend = means(course, CELLS), float(np.abs(np.diff(course.reshape(-1), 2)).max())
    off = bend * (FINE / CELLS) ** 2 / 12.0
    np.testing.assert_allclose(found, wanted, atol=1.05 * off)
    assert np.abs(found - means(held(setpoint, 1.0), CELLS)).max() > 100.0 * off, "there is something to see"


def test_a_filter_of_the_samples_answers_sample_by_sample(setpoint: np.ndarray) -> None:
    found = DriveLaw(1.0, (Lag("sampled", (0.4,)),)).cells(setpoint, SAMPLE_S)
    wanted = means(held(smoothed(setpoint, 0.4), 1.0), CELLS)
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_filters_behind_one_another(setpoint: np.ndarray) -> None:
    law = DriveLaw(1.25, (Lag("sampled", (0.6,)), Lag("first order", (5e-4,)), Lag("second order", (400.0, 0.8))))
    course = behind(held(smoothed(setpoint, 0.6), 1.25), SAMPLE_S, *first_order(5e-4))
    wanted = means(behind(course, SAMPLE_S, *second_order(400.0, 0.8)), CELLS)
    np.testing.assert_allclose(law.cells(setpoint, SAMPLE_S), wanted, atol=1e-3 * float(np.ptp(setpoint)))


@pytest.mark.parametrize(
    "law",
    [
        DriveLaw(1.3),
        DriveLaw(1.0, (Lag("sampled", (0.3,)),)),
        DriveLaw(0.0, (Lag("first order", (2e-3,)),)),
        DriveLaw(2.0, (Lag("second order", (300.0, 0.7)), Lag("first order", (3e-4,)))),
    ],
)
def test_the_delay_of_a_slow_torque_is_that_of_a_ramp(law: DriveLaw) -> None:
    """Behind a ramp everything settles to the same ramp, later."""
    ramp = np.arange(400.0)
    late = ramp - law.cells(ramp, SAMPLE_S).mean(axis=1)
    assert late[300:] * SAMPLE_S == pytest.approx(law.delay_s(SAMPLE_S), abs=1e-7)


@pytest.mark.parametrize("late", [0.0, 1.0, 0.3, 2.6])
def test_a_reading_that_is_late_is_the_mean_of_a_period_that_ended_before(setpoint: np.ndarray, late: float) -> None:
    """Of a torque that is held from sample to sample."""
    found = ReadingLaw(late).read(means(held(setpoint, 0.0), CELLS), SAMPLE_S)
    assert found == pytest.approx(held(setpoint, late).mean(axis=1), abs=1e-12)


def test_a_faithful_reading_is_the_torque_whatever_the_setpoint_says(setpoint: np.ndarray) -> None:
    """Also of what the drive makes beside its setpoint; how the mean is spread inside follows from the setpoint."""
    cells = means(held(setpoint, 1.4), CELLS)
    reading = cells.mean(axis=1) + np.random.default_rng(2).normal(0.0, 0.05, len(setpoint))
    torque, inside = TorquePath(DriveLaw(1.4)).acting_torque(reading, setpoint, SAMPLE_S)
    np.testing.assert_array_equal(torque, reading)
    assert inside is not None
    np.testing.assert_allclose(inside.above, cells - cells.mean(axis=1)[:, None], atol=1e-12)
    assert TorquePath(DriveLaw(1.0)).acting_torque(reading, setpoint, SAMPLE_S)[1] is None, "held from sample to sample"
    torque, inside = FAITHFUL.acting_torque(reading, None, SAMPLE_S)
    np.testing.assert_array_equal(torque, reading)
    assert inside is None


LAGGING: list[tuple[ReadingLaw, Callable[[np.ndarray], np.ndarray]]] = [
    (ReadingLaw(1.0), lambda u: np.append(u[0], u[:-1])),
    (ReadingLaw(0.0, (Lag("sampled", (0.3,)),)), lambda u: smoothed(u, 0.3)),
    (ReadingLaw(0.0, (Lag("first order", (2e-3,)),)), lambda u: behind(held(u, 0.0), SAMPLE_S, *first_order(2e-3)).mean(axis=1)),
]


@pytest.mark.parametrize(("law", "read"), LAGGING, ids=["late", "sampled", "first order"])
def test_what_the_readings_filter_took_from_the_setpoints_part_is_put_back(
    setpoint: np.ndarray, law: ReadingLaw, read: Callable[[np.ndarray], np.ndarray]
) -> None:
    """The noise of the sensor, behind the filter, is passed on as it is."""
    acts = held(setpoint, 1.0).mean(axis=1)
    noise = np.random.default_rng(3).normal(0.0, 0.01, len(acts))
    torque, _ = TorquePath(DriveLaw(1.0), law).acting_torque(read(acts) + noise, setpoint, SAMPLE_S)
    np.testing.assert_allclose(torque, acts + noise, atol=1e-5)


def test_a_reading_that_is_the_command_says_nothing_beside_the_setpoint(setpoint: np.ndarray) -> None:
    path = TorquePath(DriveLaw(1.0, (Lag("first order", (1e-3,)),)), commanded=True)
    torque, inside = path.acting_torque(np.full(len(setpoint), np.nan), setpoint, SAMPLE_S)
    course = behind(held(setpoint, 1.0), SAMPLE_S, *first_order(1e-3))
    np.testing.assert_allclose(torque, course.mean(axis=1), atol=1e-5)
    assert inside is not None
    np.testing.assert_allclose(inside.cells(torque, 4), means(course, 4).reshape(-1), atol=1e-5)


def at_share(course: np.ndarray, share: float) -> np.ndarray:
    """A course on the fine grid at a share of every period: the mean of the steps before and behind that instant."""
    row, at = course.reshape(-1), np.arange(len(course)) * FINE + round(share * FINE)
    return 0.5 * (row[at - 1] + np.append(row, row[-1])[at])


def later(course: np.ndarray, periods: float) -> np.ndarray:
    """A course on the fine grid so many periods later, its first value before."""
    row, steps = course.reshape(-1), round(periods * FINE)
    return np.append(np.full(steps, row[0]), row[: len(row) - steps]).reshape(course.shape)


def in_order(u: np.ndarray) -> np.ndarray:
    """The torque that acts where a drive holds each setpoint from the beginning of its period."""
    return held(u, 0.0)


#: A path, and by formulas that are not the product's: the torque that acts, from the setpoint, and its reading, from that torque.
UNSEEN: list[tuple[TorquePath, Callable[[np.ndarray], np.ndarray], Callable[[np.ndarray], np.ndarray]]] = [
    (TorquePath(None, ReadingLaw(0.0, (Lag("sampled", (0.25,)),))), in_order, lambda y: smoothed(y.mean(axis=1), 0.25)),
    (
        TorquePath(None, ReadingLaw(0.0, (Lag("first order", (2e-3,)),), at_end=True)),
        in_order,
        lambda y: at_share(behind(y, SAMPLE_S, *first_order(2e-3)), 1.0),
    ),
    (TorquePath(None, ReadingLaw(1.0)), in_order, lambda y: later(y, 1.0).mean(axis=1)),
    (
        TorquePath(DriveLaw(0.0, (Lag("first order", (0.4e-3,)),)), without_setpoint=True),
        lambda u: behind(held(u, 0.0), SAMPLE_S, *first_order(0.4e-3)),
        lambda y: y.mean(axis=1),
    ),
    (TorquePath(DriveLaw(0.35), without_setpoint=True), lambda u: held(u, 0.35), lambda y: y.mean(axis=1)),
    (
        TorquePath(DriveLaw(0.0, (Lag("second order", (700.0, 0.6)),)), ReadingLaw(0.25, at_end=True), without_setpoint=True),
        lambda u: behind(held(u, 0.0), SAMPLE_S, *second_order(700.0, 0.6)),
        lambda y: at_share(y, 0.75),
    ),
    (
        TorquePath(DriveLaw(0.4, (Lag("first order", (0.3e-3,)),)), ReadingLaw(0.2, (Lag("sampled", (0.4,)),)), without_setpoint=True),
        lambda u: behind(held(u, 0.4), SAMPLE_S, *first_order(0.3e-3)),
        lambda y: smoothed(later(y, 0.2).mean(axis=1), 0.4),
    ),
    (TorquePath(DriveLaw(0.0), ReadingLaw(0.7), without_setpoint=True), in_order, lambda y: later(y, 0.7).mean(axis=1)),
]


@pytest.mark.parametrize(("path", "acts", "read"), UNSEEN)
def test_without_a_setpoint_the_reading_tells_it(
    path: TorquePath, acts: Callable[[np.ndarray], np.ndarray], read: Callable[[np.ndarray], np.ndarray]
) -> None:
    """Means to a thousandth of the setpoint's span, inside a period to a hundredth: between its cells a filter is taken as straight, and
    undoing one makes that up to 90 times as large."""
    setpoint = 0.1 + np.random.default_rng(1).choice([-0.3, -0.1, 0.0, 0.2], 400)
    course, middle, span = acts(setpoint), slice(60, -60), 0.5
    torque, inside = path.acting_torque(read(course), None, SAMPLE_S)
    wanted = means(course, CELLS)
    assert len(torque[middle]) == 280
    np.testing.assert_allclose(torque[middle], wanted.mean(axis=1)[middle], atol=1e-3 * span)
    found = torque[:, None] + (np.zeros((1, CELLS)) if inside is None else inside.above)
    np.testing.assert_allclose(found[middle], wanted[middle], atol=1e-2 * span)


@pytest.mark.parametrize("pole", [0.0, 0.6])
@pytest.mark.parametrize("path", [path for path, *_ in UNSEEN])
def test_noise_of_an_undone_reading_is_as_large_and_coloured_as_is_said(path: TorquePath, pole: float) -> None:
    """In the triangular mean over two periods, as in the residual."""
    new = np.random.default_rng(10).normal(0.0, 1.0, 100_000)
    noise = lfilter([math.sqrt(1.0 - pole**2)], [1.0, -pole], new)
    torque, inside = path.acting_torque(noise, None, SAMPLE_S)
    cells = torque[:, None] + (np.zeros((1, CELLS)) if inside is None else inside.above)
    rising = (np.arange(CELLS) + 0.5) / CELLS**2
    left = cells[:-1] @ rising + cells[1:] @ rising[::-1]
    colour = path.acting_noise(pole, SAMPLE_S)
    told = lfilter(colour.numerator, colour.denominator, np.eye(1, 400)[0])
    assert abs(np.roots(colour.numerator)).max(initial=0.0) < 1.0 + 1e-9
    for lag in range(4):
        shown = float(np.mean(left[lag:] * left[: len(left) - lag]))
        assert shown == pytest.approx(float(told[lag:] @ told[: 400 - lag]), abs=0.02 * float(np.var(left)))


def test_a_law_that_lets_a_frequency_vanish_cannot_be_undone() -> None:
    """Half of each of two neighbours is read: at half the sampling frequency nothing."""
    path = TorquePath(DriveLaw(0.0), ReadingLaw(0.5), without_setpoint=True)
    assert not path.can_be_undone(SAMPLE_S)
    with pytest.raises(ValueError, match=r"at a frequency; at least 0\.02 is needed"):
        path.acting_noise(0.0, SAMPLE_S)


PATHS = [
    FAITHFUL,
    TorquePath(DriveLaw(1.57, (Lag("second order", (800.0, 0.7)), Lag("sampled", (0.4,))), 0.98)),
    TorquePath(DriveLaw(1.0), ReadingLaw(0.3, (Lag("first order", (2e-3,)),))),
    TorquePath(DriveLaw(2.0, (Lag("first order", (1e-3,)),)), commanded=True),
]


@pytest.mark.parametrize("path", PATHS)
def test_a_path_is_read_back_as_it_was_written(path: TorquePath) -> None:
    assert path_from_dict(json.loads(json.dumps(path_to_dict(path)))) == path


@pytest.mark.parametrize(
    "damage", [{"drive": {"delay": 1.0}}, {"reading": None}, {"commanded": False, "reading": {"late": "soon", "lags": []}}]
)
def test_a_damaged_path_is_refused(damage: dict[str, object]) -> None:
    with pytest.raises((KeyError, TypeError, ValueError)):
        path_from_dict(path_to_dict(PATHS[1]) | damage)
    strange = path_to_dict(PATHS[1])
    strange["drive"]["lags"][0]["kind"] = "notch"
    with pytest.raises(ValueError, match="notch"):
        path_from_dict(strange)


def test_a_limited_slew_rate_is_exact_between_cells() -> None:
    """From 0 to 1 N m at 500 N m/s: 2 ms; from then on at rest.  Means over each sample of 1 ms."""
    setpoint = np.array([0.0, 1.0, 1.0, 1.0, 1.0])
    law = DriveLaw(0.0, (Lag("slew rate", (500.0,)),))
    np.testing.assert_allclose(means(law.cells(setpoint, 1e-3), 1).reshape(-1), [0.0, 0.25, 0.75, 1.0, 1.0], atol=1e-12)
    assert law.delay_s(1e-3) == 0.0


def test_the_torque_at_an_instant_moves_with_it_and_never_jumps() -> None:
    """Of t² between the cells' beginnings too, where a straight line in a cell is off by a quarter of its curvature."""
    number = 32
    edges = np.arange(6 * number + 1) / number
    cells = (np.diff(edges**3) / 3.0 * number).reshape(6, number)
    shares = np.linspace(0.0, 1.0, 301)
    found = np.array([torque_at(cells, float(share))[3] for share in shares])
    np.testing.assert_allclose(found, (3.0 + shares) ** 2, atol=0.3 / number**2)
    assert np.all(np.diff(found) > 0.0)
