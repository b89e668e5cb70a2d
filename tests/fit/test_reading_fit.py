"""What drive and reading make of a setpoint together, found from both; the torque is made on a grid far finer than the product's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from beltcomm.fit.torque import reading_fit
from beltcomm.fit.torque.laws import ReadingLaw
from beltcomm.fit.torque.reading_fit import ReadingFit, fit_reading
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import Sidecar
from fit.drives import FINE, behind, first_order, held, second_order, smoothed
from marks import quick

SAMPLE_S, NOISE_NM = 1e-3, 6e-3


@pytest.fixture(scope="module")
def setpoint() -> np.ndarray:
    return np.repeat(np.random.default_rng(1).choice([-0.2, 0.2], 2000), 2)


def recorded(setpoint: np.ndarray, torque: np.ndarray, noise_nm: float = NOISE_NM) -> Recording:
    noise = np.random.default_rng(2).normal(0.0, noise_nm, len(setpoint))
    times = SAMPLE_S * np.arange(len(setpoint))
    return Recording(
        name="driven", t_s=times, torque=torque + noise, torque_setpoint=setpoint, position=np.sin(5.0 * times), sidecar=Sidecar("frf")
    )


def found_of(setpoint: np.ndarray, torque: np.ndarray) -> ReadingFit:
    found = fit_reading([recorded(setpoint, torque)])
    assert found is not None
    # It leaves the noise, which is known to √(1/2n).
    assert found.rest_nm == pytest.approx(NOISE_NM, rel=4.0 * np.sqrt(0.5 / len(setpoint)))
    return found


@pytest.mark.parametrize(("delay", "gain"), quick([(1.57, 1.0), (0.3, 0.8), (1.0, 1.0), (2.0, 1.0), (2.08, 1.0), (1.95, 1.0)], 2))
def test_a_delay_is_found_whether_whole_or_not(setpoint: np.ndarray, delay: float, gain: float) -> None:
    found = found_of(setpoint, gain * held(setpoint, delay).mean(axis=1))
    assert found.law.lags == ()
    assert found.law.delay == pytest.approx(delay, abs=0.005)
    assert found.law.gain == pytest.approx(gain, rel=0.01)
    assert found.law.delay == delay or delay not in (1.0, 2.0), "a whole one is told as whole"


def test_a_command_that_comes_back_has_no_filter_to_look_for(setpoint: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without noise every chain explains as much: fitting them all took seconds for each record."""
    tried, one = list[tuple[str, ...]](), reading_fit._fit_chain
    monkeypatch.setattr(reading_fit, "_fit_chain", lambda pairs, s, chain, *more: tried.append(chain) or one(pairs, s, chain, *more))
    found = fit_reading([recorded(setpoint, np.concatenate((setpoint[:1], setpoint[:-1])), noise_nm=0.0)])
    assert found is not None
    assert (found.law.delay, found.law.lags, tried) == (1.0, (), [()])


@pytest.mark.parametrize("share", quick([0.35, 0.5, 0.875], 1))
def test_a_filter_of_the_samples_is_found(setpoint: np.ndarray, share: float) -> None:
    found = found_of(setpoint, held(smoothed(setpoint, share), 1.0).mean(axis=1))
    (lag,) = found.law.lags
    assert lag.kind == "sampled"
    assert lag.values[0] == pytest.approx(share, abs=0.005)
    assert found.law.delay == 1.0


@pytest.mark.parametrize("time_s", quick([4e-4, 2e-3], 1))
def test_a_filter_of_first_order_is_found_by_what_it_does_to_the_readings(setpoint: np.ndarray, time_s: float) -> None:
    """Means over the periods of one of time are those of one of the samples behind a share of a period, so its kind is not asked for."""
    course = behind(held(setpoint, 1.0), SAMPLE_S, *first_order(time_s)).mean(axis=1)
    law = found_of(setpoint, course).law
    assert len(law.lags) == 1
    np.testing.assert_allclose(law.cells(setpoint, SAMPLE_S).mean(axis=1), course, atol=0.1 * NOISE_NM)
    assert law.delay_s(SAMPLE_S) == pytest.approx(SAMPLE_S + time_s, rel=0.01)


def test_a_current_loop_of_second_order_is_found(setpoint: np.ndarray) -> None:
    found = found_of(setpoint, behind(held(setpoint, 1.0), SAMPLE_S, *second_order(150.0, 0.6)).mean(axis=1))
    (lag,) = found.law.lags
    assert lag.kind == "second order"
    assert lag.values == (pytest.approx(150.0, rel=0.02), pytest.approx(0.6, rel=0.03))
    assert found.law.delay == pytest.approx(1.0, abs=0.02)


@pytest.mark.examination
def test_two_filters_behind_one_another_are_found_by_what_they_do(setpoint: np.ndarray) -> None:
    course = behind(held(smoothed(setpoint, 0.5), 1.0), SAMPLE_S, *first_order(2e-3)).mean(axis=1)
    found = found_of(setpoint, course)
    off = ReadingLaw(at_end=found.at_end).read(found.law.cells(setpoint, SAMPLE_S), SAMPLE_S) - course
    assert float(np.std(off)) < 0.15 * NOISE_NM
    earlier_s = 0.5 * SAMPLE_S if found.at_end else 0.0  # than the mean of the period
    assert found.law.delay_s(SAMPLE_S) - earlier_s == pytest.approx(SAMPLE_S * (1.0 + 1.0) + 2e-3, rel=0.01)


def limited(wanted: np.ndarray, limit_nm_s: float) -> np.ndarray:
    most, y, course = limit_nm_s * SAMPLE_S / wanted.shape[1], wanted[0, 0], np.empty(wanted.size)
    for i, target in enumerate(wanted.reshape(-1)):
        y += min(max(target - y, -most), most)
        course[i] = y
    return course.reshape(wanted.shape)


@pytest.mark.examination
def test_a_filter_before_a_limited_slew_rate_is_found_there(setpoint: np.ndarray) -> None:
    """Behind it, it would round the ends of every ramp; what that leaves was taken for torque of a process."""
    first, second = found_of(setpoint, limited(held(smoothed(setpoint, 0.7), 1.0), 150.0).mean(axis=1)).law.lags
    assert (first.kind, second.kind) == ("sampled", "slew rate")
    assert first.values[0] == pytest.approx(0.7, abs=0.02)
    assert second.values[0] == pytest.approx(150.0, rel=0.01)


@pytest.mark.examination
@pytest.mark.parametrize("limit_nm_s", [60.0, 150.0])
def test_a_limited_slew_rate_is_found(setpoint: np.ndarray, limit_nm_s: float) -> None:
    """Steps of 0.4 N m take 6.7 and 2.7 samples; the course is made step by step on the fine grid."""
    found = found_of(setpoint, limited(held(setpoint, 1.0), limit_nm_s).mean(axis=1))
    (lag,) = found.law.lags
    assert lag.kind == "slew rate"
    assert lag.values[0] == pytest.approx(limit_nm_s, rel=0.005)
    assert found.law.delay == 1.0


def test_a_reading_of_the_end_of_the_period_is_told_from_its_mean(setpoint: np.ndarray) -> None:
    """A current loop of 0.4 ms, its torque read at the end of each sample: little of it is seen, and the loop is found by that."""
    fine = behind(held(setpoint, 1.0), SAMPLE_S, *first_order(4e-4))
    found = fit_reading([recorded(setpoint, fine[:, -1])])
    assert found is not None
    ends = [one for one in (found, *found.rivals) if one.at_end and [lag.kind for lag in one.law.lags] == ["first order"]]
    assert ends
    assert ends[0].law.lags[0].values[0] == pytest.approx(4e-4, rel=0.02)


def test_the_liveliest_record_tells(setpoint: np.ndarray) -> None:
    """Beside one that hardly changes and one without setpoint."""
    lively = recorded(setpoint, held(setpoint, 1.57).mean(axis=1))
    calm = recorded(0.01 * setpoint, 0.01 * held(setpoint, 1.57).mean(axis=1))
    untold = replace(lively, torque_setpoint=None)
    found = fit_reading([calm, untold, lively])
    assert found is not None
    assert found.law.delay == pytest.approx(1.57, abs=0.005)


@pytest.mark.parametrize("time_s", [None, 2e-3])
def test_a_record_that_begins_at_rest_tells_as_much(setpoint: np.ndarray, time_s: float | None) -> None:
    """Two seconds of standstill before the excitation, as most loggers have them."""
    late_to_begin = np.concatenate((np.zeros(2000), setpoint[:3000]))
    torque = held(late_to_begin, 3.57)
    found = fit_reading(
        [recorded(late_to_begin, (torque if time_s is None else behind(torque, SAMPLE_S, *first_order(time_s))).mean(axis=1))]
    )
    assert found is not None
    assert found.law.delay_s(SAMPLE_S) == pytest.approx(3.57e-3 + (time_s or 0.0), abs=3e-5)
    assert found.rest_nm == pytest.approx(NOISE_NM, rel=0.05)


def test_a_piece_between_gaps_is_looked_at_by_itself(setpoint: np.ndarray) -> None:
    """The clock stands still for 50 ms where 300 rows were lost: nothing is read across the gap."""
    whole = recorded(setpoint, held(setpoint, 1.57).mean(axis=1))
    kept = np.r_[0:1500, 1800:4000]
    torn = replace(whole, t_s=whole.t_s[kept], torque=whole.torque[kept], torque_setpoint=setpoint[kept], position=whole.position[kept])
    found = fit_reading([torn])
    assert found is not None
    assert found.law.delay == pytest.approx(1.57, abs=0.005)
    assert found.rest_nm == pytest.approx(NOISE_NM, rel=0.05)


def test_where_no_setpoint_changes_nothing_is_told(setpoint: np.ndarray) -> None:
    times = np.zeros(len(setpoint))
    assert fit_reading([recorded(times, times)]) is None
    assert fit_reading([replace(recorded(setpoint, setpoint), torque_setpoint=None)]) is None
    assert fit_reading([]) is None


def test_a_reading_that_goes_against_its_setpoint_is_none(setpoint: np.ndarray) -> None:
    assert fit_reading([recorded(setpoint, -held(setpoint, 2.0).mean(axis=1))]) is None


@pytest.mark.parametrize("share", [None, 0.55])
@pytest.mark.parametrize("seed", quick(range(6), 2))
def test_a_limited_slew_rate_between_filters_is_found_wherever_in_the_period_the_command_changes(seed: int, share: float | None) -> None:
    """Behind one or two limits that leave a command no time to arrive, its instant does not show within a cell of the product's grid.

    A limit and a filter of the samples have a mean over the period that is level with it: the motion is asked.
    """
    rng = np.random.default_rng([20261128, seed])
    setpoint = np.repeat(rng.choice([-0.3, 0.3], 1500), 2)
    delay, limit, time_s = rng.uniform(1.05, 2.95), rng.uniform(80.0, 250.0), 1e-3 * np.exp(rng.uniform(np.log(0.6), np.log(3.0)))
    delay = round(delay * FINE) / FINE  # within a step of the truth's grid a limiter would follow the step's mean
    asked = held(setpoint if share is None else smoothed(setpoint, share), delay)
    read = behind(limited(asked, limit), SAMPLE_S, *first_order(time_s))[:, -1]  # the torque at the end of the period
    found = fit_reading([recorded(setpoint, read, noise_nm=1e-3)])
    assert found is not None
    kinds = ["slew rate", "first order"] if share is None else ["sampled", "slew rate", "first order"]
    assert len(found.law.lags) == len(kinds)
    at_end = next(one for one in (found, *found.rivals) if one.at_end and [lag.kind for lag in one.law.lags] == kinds)
    lags = [*at_end.law.lags]
    if share is not None:
        assert lags.pop(0).values[0] == pytest.approx(share, abs=0.01)
    assert at_end.law.delay == pytest.approx(delay, abs=0.03)
    assert lags[0].values[0] == pytest.approx(limit, rel=0.01)
    assert lags[1].values[0] == pytest.approx(time_s, rel=0.03)
    assert found.noise_nm == pytest.approx(1e-3, rel=0.2)
