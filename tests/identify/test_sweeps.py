"""Drift over the clock and dependence on load: what is built into passes comes out, and the intervals hold as often as they say."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from beltcomm.errors import DataError
from beltcomm.identify.friction import FrictionFit, Plateau, fit_friction
from beltcomm.identify.sweeps import KEY, clear, drift_of, load_dependence, note_of, sweeps_of
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import Sidecar
from beltcomm.sentences.friction import study_lines

VISCOUS, COULOMB = 2.530e-3, 0.125  # table A.10, G_A
#: rad/s: slow ones in the Stribeck effect, fast ones.
SPEEDS = (0.2, 0.4, 0.8, 2.0, 4.0, 8.0, 20.0, 40.0, 56.0)
SCATTER_NM = 0.4e-3


def swept(
    rng: np.random.Generator, speeds: Sequence[float], begin_s: float, d_per_min: float = 0.0, c_per_min: float = 0.0
) -> list[Plateau]:
    """Passes forth and back, 2 s each, with a Stribeck effect and drifts that are counted from the clock's zero."""
    passes, t = [], begin_s
    for speed in speeds:
        for sign in (1.0, -1.0):
            minutes = (t + 0.5) / 60.0
            stribeck = 12e-3 * math.exp(-((speed / 2.5) ** 2))
            torque = (VISCOUS + d_per_min * minutes) * speed + COULOMB + c_per_min * minutes + stribeck
            passes.append(Plateau(sign * speed, sign * speed, sign * torque + SCATTER_NM * rng.normal(), SCATTER_NM, t, 1.0))
            t += 2.0
    return passes


@pytest.mark.parametrize("orders", [(1, 1, 1), (1, -1), (-1, 1, -1, 1)])
def test_drift_is_found_whatever_order_and_law(orders: tuple[int, ...]) -> None:
    """-6 % of the viscous and +2 % of the Coulomb friction a minute, in rising and falling orders, under a Stribeck effect."""
    rng = np.random.default_rng(3)
    passes = [p for i, step in enumerate(orders) for p in swept(rng, SPEEDS[::step], 40.0 * i, -0.15e-3, 2.5e-3)]
    drift = drift_of(passes)
    for value, true in ((drift.viscous, -0.15e-3), (drift.coulomb, 2.5e-3)):
        assert value.interval is not None
        assert abs(value.value - true) < 1.5 * value.interval
        assert clear(value)
    assert drift.speeds == 18
    assert drift.minutes == pytest.approx((40.0 * (len(orders) - 1) + 2.0 * 17) / 60.0)


def test_intervals_hold_as_often_as_they_say() -> None:
    """Of 300 measurements without drift, one sweep rising and one falling, 95 % ± 3.8 % (3 sigma of the count) leave zero inside."""
    inside = 0
    for seed in range(300):
        rng = np.random.default_rng(seed)
        drift = drift_of(swept(rng, SPEEDS, 0.0) + swept(rng, SPEEDS[::-1], 40.0))
        inside += not clear(drift.viscous)
    assert abs(inside / 300 - 0.95) < 0.038


def test_a_law_fitted_to_a_rising_order_would_call_curvature_drift() -> None:
    """Why speeds must be repeated: time rises with speed, so a Stribeck effect alone bends the law; the repeated speeds show none."""
    rng = np.random.default_rng(1)
    rising = swept(rng, SPEEDS, 0.0)
    minutes = np.array([p.start_s for p in rising]) / 60.0
    speed = np.array([p.speed_rad_s for p in rising])
    regressor = np.column_stack([speed, np.sign(speed), speed * minutes, np.sign(speed) * minutes])
    by_law = np.linalg.lstsq(regressor, np.array([p.torque_nm for p in rising]), rcond=None)[0][3]
    repeated = drift_of(rising + swept(rng, SPEEDS, 40.0))
    assert abs(by_law) > 20e-3
    assert not clear(repeated.coulomb)
    assert abs(repeated.coulomb.value) < 1e-3


@pytest.mark.parametrize("what", ["once", "one way", "sticking"])
def test_no_drift_from_passes_that_cannot_tell(what: str) -> None:
    rng = np.random.default_rng(0)
    passes = swept(rng, SPEEDS, 0.0) + ([] if what == "once" else swept(rng, SPEEDS, 40.0))
    if what == "one way":
        passes = [p for p in passes if p.reference_rad_s > 0.0]
    if what == "sticking":
        passes = [Plateau(p.reference_rad_s, 0.0, p.torque_nm, p.error_nm, p.start_s, p.duration_s) for p in passes]
    with pytest.raises(DataError, match="--repeat"):
        drift_of(passes)


def fits(rng: np.random.Generator, coulomb: float, viscous: float, sweeps: int, day: float) -> list[FrictionFit]:
    """Sweeps that come out again to ``day`` (standard deviation, share) of their friction."""
    found = []
    for _ in range(sweeps):
        c, d = coulomb * (1.0 + day * rng.normal()), viscous * (1.0 + day * rng.normal())
        found.append(fit_friction([Plateau(s * v, s * v, s * (c + d * v), 1e-4, 0.0, 1.0) for v in SPEEDS[3:] for s in (1.0, -1.0)]))
    return found


def test_load_comes_out_with_an_interval_of_the_scatter_between_sweeps() -> None:
    """Table A.10: 115 to 125 mN m with 11.2 kg.  Sweeps that repeat to 1 % tell it; slope 0.893 mN m/kg, within 1.5 half widths."""
    rng = np.random.default_rng(2)
    found = load_dependence({"bare": (0.0, fits(rng, 0.115, 2.23e-3, 4, 0.01)), "loaded": (11.2, fits(rng, 0.125, 2.53e-3, 4, 0.01))})
    assert found.repeats == 6
    assert clear(found.coulomb)
    assert found.coulomb.interval is not None
    assert abs(found.coulomb.value - 10e-3 / 11.2) < 1.5 * found.coulomb.interval
    # Two means of four with 1 % of 120 mN m each, over 11.2 kg, t of six degrees: 0.18 mN m/kg; the scatter drawn varies it by half.
    expected = 2.447 * 0.01 * 0.120 * math.sqrt(2.0 / 4.0) / 11.2
    assert 0.5 * expected < found.coulomb.interval < 1.7 * expected


def test_sweeps_that_scatter_as_much_as_the_loads_differ_cannot_tell() -> None:
    found = load_dependence({n: (kg, fits(np.random.default_rng(7), 0.115, 2.23e-3, 3, 0.2)) for n, kg in (("a", 0.0), ("b", 11.2))})
    assert not clear(found.coulomb)


def test_without_repeats_nothing_is_known_of_the_scatter_between_sweeps() -> None:
    rng = np.random.default_rng(2)
    one = load_dependence({"bare": (0.0, fits(rng, 0.115, 2.23e-3, 1, 0.0)), "loaded": (11.2, fits(rng, 0.125, 2.53e-3, 1, 0.0))})
    assert one.repeats == 0


def test_loads_off_a_straight_line_widen_the_interval() -> None:
    rng = np.random.default_rng(4)
    loads = ((0.0, 0.100), (5.0, 0.130), (10.0, 0.110))
    bent = load_dependence({f"{kg:g}": (kg, fits(rng, level, 2.23e-3, 3, 1e-3)) for kg, level in loads})
    straight = load_dependence({f"{kg:g}": (kg, fits(rng, 0.1 + 1e-3 * kg, 2.23e-3, 3, 1e-3)) for kg, _ in loads})
    assert bent.coulomb.interval is not None
    assert straight.coulomb.interval is not None
    assert bent.coulomb.interval > 5.0 * straight.coulomb.interval
    assert not clear(bent.coulomb)
    assert clear(straight.coulomb)


@pytest.mark.parametrize("loads", [(3.0,), (3.0, 3.0)])
def test_one_load_is_no_comparison(loads: tuple[float, ...]) -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(DataError, match="two loads"):
        load_dependence({str(i): (kg, fits(rng, 0.1, 2e-3, 2, 0.01)) for i, kg in enumerate(loads)})


def record(name: str, **sidecar: object) -> Recording:
    """Three speeds both ways, 0.4 s each, 0.2 N m of noise-free law."""
    speed = np.concatenate([np.full(400, s * v) for v in (5.0, 10.0, 20.0) for s in (1.0, -1.0)])
    t = 7.0 + 1e-3 * np.arange(len(speed))
    position = np.concatenate(([0.0], np.cumsum(speed[:-1]) * 1e-3))
    extra = {key: sidecar.pop(key) for key in list(sidecar) if key == KEY}
    note = Sidecar("friction_sweep", 0.1, closed_loop=True, extra=extra, **sidecar)  # type: ignore[arg-type]
    torque = COULOMB * np.sign(speed) + VISCOUS * speed + 1e-4 * np.random.default_rng(1).normal(size=len(speed))
    return Recording(name, t, torque, position, reference_velocity=speed, sidecar=note)


def test_records_of_one_sweep_are_put_together_on_the_clock() -> None:
    note = {"measurement": 1, "order": "III", "repetition": 2}
    parts = [record("sweep_3", session_time_s=100.0, sweep=note), record("sweep_2", session_time_s=50.0, sweep=note)]
    (one,) = sweeps_of([*parts])
    assert one.name == "III, 2."
    assert one.fit is not None
    assert one.fit.viscous.value == pytest.approx(VISCOUS, rel=0.01)
    assert len(one.plateaus) == 12
    assert (one.from_s, one.to_s) == (pytest.approx(50.2, abs=2e-3), pytest.approx(102.4, abs=2e-3))
    assert [s.name for s in sweeps_of([*parts, record("sweep")])] == ["sweep", "III, 2."]


@pytest.mark.parametrize("entry", ["III", {"order": "III"}, {"measurement": 0, "order": "I", "repetition": 1}])
def test_a_damaged_note_is_named(entry: object) -> None:
    with pytest.raises(DataError, match=r"sidecar of sweep_9.*sweep"):
        note_of(Sidecar("friction_sweep", extra={KEY: entry}), "sweep_9")


def test_one_sweep_has_one_payload() -> None:
    note = {"measurement": 1, "order": "I", "repetition": 1}
    with pytest.raises(DataError, match="different payloads"):
        sweeps_of([record("a", sweep=note, payload_kg=0.0), record("b", sweep=note, payload_kg=5.0)])


def test_a_sweep_that_stuck_leaves_that_of_another_record_alone() -> None:
    """A weak loop moved at one of three speeds only: no friction of its own, and the sweep beside it has its law all the same."""
    good = record("sweep_2")
    assert good.reference_velocity is not None
    stuck = np.where(np.abs(good.reference_velocity) > 6.0, 0.0, good.reference_velocity)
    still = Recording(
        "sweep",
        good.t_s,
        good.torque,
        np.concatenate(([0.0], np.cumsum(stuck[:-1]) * 1e-3)),
        reference_velocity=good.reference_velocity,
        sidecar=Sidecar("friction_sweep", 0.1, closed_loop=True),
    )
    poor, whole = sweeps_of([still, good])
    assert (poor.name, poor.fit) == ("sweep", None)
    assert whole.fit is not None
    assert whole.fit.viscous.value == pytest.approx(VISCOUS, rel=0.01)
    assert "sweep: too few of its 6 passes" in " ".join(study_lines((poor, whole), {}, ()))
