"""Spectra against closed forms, drift against a free inertia, and a static nonlinearity on the silent lines of a multisine."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm.errors import Refused, UsageError
from beltcomm.excitation import Excitation, chirp, choose, gprbs, multisine
from beltcomm.excitation.record import RecordTooShort
from beltcomm.given import EXCITATION_KINDS, ExcitationKind

Array = NDArray[np.float64]
T_S = 1e-3


def lines_of(excitation: Excitation) -> Array:
    return np.asarray(np.abs(np.fft.rfft(excitation.period)) / excitation.period_samples)


MAKERS: dict[str, Callable[[int], Excitation]] = {
    "gprbs": lambda seed: gprbs(1000, 3.0, 0.3, T_S, 3, seed=seed),
    "chirp": lambda _seed: chirp(1000, 2.0, 300.0, 0.3, T_S, 3),
    "multisine": lambda seed: multisine(1000, 2.0, 300.0, 0.3, T_S, 3, seed=seed),
}


@pytest.mark.parametrize("kind", MAKERS)
def test_a_free_axis_ends_where_it_was(kind: str) -> None:
    """A frictionless inertia: no mean speed over a period, none at the end; another seed is another record, the same seed the same."""
    excitation = MAKERS[kind](1)
    speed = np.concatenate(([0.0], np.cumsum(excitation.torque)))
    first, n = excitation.first_sample, excitation.period_samples
    assert abs(speed[-1]) < 1e-12
    for k in range(excitation.repeats):
        assert abs(np.mean(speed[first + k * n : first + (k + 1) * n])) < 1e-12
    assert np.array_equal(excitation.torque, MAKERS[kind](1).torque)
    if kind != "chirp":
        assert not np.array_equal(excitation.torque, MAKERS[kind](2).torque)


def test_the_spectrum_of_a_generalised_prbs_has_no_zero() -> None:
    """Mean power of many sequences against that of a sign that changes with probability 1/h; relative scatter of a mean over 400: 5 %."""
    hold, n, runs = 4.0, 512, 400
    power = np.mean([lines_of(gprbs(n, hold, 1.0, T_S, 1, seed=s))[1:] ** 2 * n for s in range(runs)], axis=0)
    omega_t = 2.0 * np.pi * np.arange(1, n // 2 + 1) / n
    rho = 1.0 - 2.0 / hold
    expected = (1.0 - rho**2) / (1.0 - 2.0 * rho * np.cos(omega_t) + rho**2)
    bands = [slice(i, i + 16) for i in range(0, n // 2, 16)]
    for band in bands:  # 16 lines each: 1.25 % scatter, five times that
        assert np.mean(power[band]) == pytest.approx(np.mean(expected[band]), rel=0.0625)


def test_a_chirp_is_what_the_instantaneous_frequency_says() -> None:
    """Logarithmic: f rises by the same factor in the same time, so the power of a line falls with 1/f; nothing above the band."""
    excitation = chirp(4000, 2.0, 200.0, 0.5, T_S, 1, fade=0.02)
    assert excitation.amplitude_nm <= 0.5 + 1e-3
    power = lines_of(excitation) ** 2
    freq = np.arange(len(power)) / (4000 * T_S)
    octaves = [float(np.sum(power[(freq >= f) & (freq < 2.0 * f)])) for f in (5.0, 10.0, 20.0, 40.0, 80.0)]
    assert np.ptp(octaves) < 0.05 * np.mean(octaves)
    assert np.sum(power[freq > 230.0]) < 1e-4 * np.sum(power)
    flat = lines_of(chirp(4000, 2.0, 200.0, 0.5, T_S, 1, spacing="linear", fade=0.02)) ** 2
    halves = [float(np.sum(flat[(freq >= low) & (freq < high)])) for low, high in ((20.0, 100.0), (100.0, 180.0))]
    assert halves[0] == pytest.approx(halves[1], rel=0.03)


def detection_lines(excitation: Excitation) -> tuple[list[int], list[int]]:
    """Odd and even lines between the excited ones, which are not excited themselves; both empty where all are."""
    if not excitation.lines or any(k % 2 == 0 for k in excitation.lines):
        return [], []
    silent = sorted(set(range(excitation.lines[0], excitation.lines[-1] + 1)) - set(excitation.lines))
    return [k for k in silent if k % 2 == 1], [k for k in silent if k % 2 == 0]


def test_the_lines_of_a_multisine_are_those_asked_for() -> None:
    excitation = multisine(1000, 5.0, 300.0, 0.3, T_S, 2, seed=3)
    shown = lines_of(excitation)
    excited = np.array(excitation.lines)
    odd, even = detection_lines(excitation)
    assert np.all(excited % 2 == 1)
    assert len(odd) == pytest.approx(len(excited) / 3, abs=2)
    assert np.ptp(shown[excited]) < 1e-9 * shown[excited].mean()
    assert np.max(shown[np.concatenate((odd, even))]) < 1e-12
    assert excitation.amplitude_nm == pytest.approx(0.3, rel=1e-9)
    # The best of 64 sets of phases; one set of many sines is nearly normal, its crest factor about √(2 ln N) = 3.7.
    assert excitation.crest_factor < 3.0
    whole = multisine(1000, 5.0, 300.0, 0.3, T_S, 2, seed=3, detection=False)
    assert [len(lines) for lines in detection_lines(whole)] == [0, 0]


@pytest.mark.parametrize(("power", "shows", "silent"), [(2, 1, 0), (3, 0, 1)])
def test_even_and_odd_nonlinearity_show_on_their_own_silent_lines(power: int, shows: int, silent: int) -> None:
    excitation = multisine(1000, 5.0, 200.0, 1.0, T_S, 2, seed=4)
    answer = np.abs(np.fft.rfft(excitation.period + 0.1 * excitation.period**power))
    levels = [float(np.sqrt(np.mean(answer[lines] ** 2))) for lines in detection_lines(excitation)]
    assert levels[shows] > 1e6 * levels[silent]


def test_torque_in_whole_steps_of_the_drive() -> None:
    for kind in MAKERS:
        step = 1e-3
        made = choose(kind_of(kind), T_S, 20.0, 130.0, 8.0).excitation(0.3, T_S, torque_step_nm=step)
        np.testing.assert_allclose(made.torque / step, np.rint(made.torque / step), atol=1e-9)
        assert made.torque.sum() == pytest.approx(0.0, abs=1e-9)


def kind_of(name: str) -> ExcitationKind:
    return next(kind for kind in EXCITATION_KINDS if kind == name)


@pytest.mark.parametrize("kind", EXCITATION_KINDS)
def test_a_chosen_signal_fits_its_time_and_shows_its_band(kind: ExcitationKind) -> None:
    choice = choose(kind, T_S, 20.0, 130.0, 8.0)
    excitation = choice.excitation(0.3, T_S)
    assert excitation.duration_s <= 8.0
    assert excitation.kind == kind
    assert excitation.repeats == choice.repeats >= 3
    assert excitation.amplitude_nm == pytest.approx(0.3, rel=0.02)
    shown = lines_of(excitation)
    freq = np.arange(len(shown)) / (excitation.period_samples * T_S)
    strong = shown > 0.05 * shown.max()
    for low, high in ((18.0, 22.0), (125.0, 135.0)):
        assert np.any(strong[(freq > low) & (freq < high)])
    assert choice.reason


@pytest.mark.parametrize("kind", ["gprbs", "chirp", "multisine"])
def test_what_cannot_be_is_said(kind: ExcitationKind) -> None:
    with pytest.raises(Refused, match="sample at least every"):
        choose(kind, T_S, 20.0, 600.0, 8.0)
    with pytest.raises(Refused, match="too short"):
        choose(kind, T_S, 2.0, 100.0, 8.0)
    with pytest.raises(UsageError, match="must be positive"):
        choose(kind, T_S, -1.0, 100.0, 8.0)
    with pytest.raises(UsageError, match=r"needs more than|does not fit|above 1"):
        {
            "gprbs": lambda: gprbs(100, 1.0, 0.3, T_S, 1, seed=1),
            "chirp": lambda: chirp(100, 2.0, 300.0, 0.3, T_S, 1),
            "multisine": lambda: multisine(100, 2.0, 50.0, 0.3, T_S, 1, seed=1),
        }[kind]()


def test_an_unknown_kind_is_said() -> None:
    with pytest.raises(UsageError, match="choose prbs, gprbs, chirp, multisine"):
        choose("noise", T_S, 20.0, 130.0, 8.0)  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", EXCITATION_KINDS)
def test_a_record_too_short_says_how_long_is_enough(kind: ExcitationKind) -> None:
    """An antiresonance of 2 Hz has periods of some 5 s and more; what is answered does, a hundredth less does not."""
    with pytest.raises(RecordTooShort, match="allow") as short:
        choose(kind, T_S, 2.0, 60.0, 7.0)
    choose(kind, T_S, 2.0, 60.0, short.value.needed_s + 1e-3)
    with pytest.raises(RecordTooShort):
        choose(kind, T_S, 2.0, 60.0, 0.99 * short.value.needed_s)
