"""Filters, noise, steps and lags of a real drive: what CAN frames and the motion show, against solutions of their own."""

from __future__ import annotations

import hashlib
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.signal import lsim

from beltcomm.configfiles import find_config, read_yaml, to_yaml, write_text
from beltcomm.drive import open_drive
from beltcomm.errors import UsageError
from beltcomm.model import load_plant
from beltcomm.plant import DRIVE_KEYS, IDEAL, Instruments
from beltcomm.virtual.stage import TorqueDelivery
from virtual.host import INERTIA, UNIT_NM, CyclicTorque, prepared

T = 1e-3
Array = NDArray[np.float64]
#: Units of 6077h, one per tick.
SETPOINTS = (1000, 1000, 1000, -400, 250, 250, 0, 900, 900, 900, 900, 0, 0, 0, 0, 0)


def with_instruments(delay_s: float = 0.0, **options: Any) -> CyclicTorque:
    """A host whose drive has these instruments; other options are the drive's own."""
    own = {key: options.pop(key) for key in ("torque_noise_nm", "seed", "counts_per_rev") if key in options}
    return prepared(setpoint_delay_s=delay_s, instruments=Instruments(**options), **own)


def played(one: CyclicTorque, setpoints: tuple[int, ...] = SETPOINTS) -> tuple[Array, Array, Array]:
    """6077h in units, true angle and true speed at each SYNC."""
    rows = []
    for setpoint in setpoints:
        before = one.plant.position_rad, one.plant.velocity_rad_s
        rows.append((one.cycle(setpoint)[1], *before))
    one.close()
    return tuple(np.array(rows, dtype=float).T)  # type: ignore[return-value]


def asked(delay_s: float, slew_nm_s: float) -> tuple[Array, Array]:
    """Corners (s, N m) of the slope-limited setpoint: what is sent after SYNC k acts from t_k+1 + delay on."""
    times, values = [0.0], [0.0]
    for k, setpoint in enumerate(SETPOINTS):
        begin, end, target = (k + 1) * T + delay_s, (k + 2) * T + delay_s, setpoint * UNIT_NM
        now = values[-1]
        ramp = min(abs(target - now) / slew_nm_s, T) if slew_nm_s else 0.0
        reached = now + math.copysign(ramp * slew_nm_s, target - now) if slew_nm_s else target
        times += [begin, begin + ramp, end]
        values += [now, reached, reached]
    return np.array(times), np.array(values)


def solved(delay_s: float, has: Instruments) -> tuple[Array, Array, Array]:
    """Mean torque of the tick before each SYNC, N m, angle and speed of the rigid machine: a Runge-Kutta solution in y and y'."""
    times, values = asked(delay_s, has.torque_slew_nm_s)
    w, d = math.tau * has.current_loop_hz, has.current_loop_damping

    def slope(t: float, x: Array, left: float, right: float, first: float, last: float) -> list[float]:
        filtered, loop, loop_slope, _impulse, _angle = x
        u = first + (last - first) * (t - left) / (right - left)
        into = filtered if has.setpoint_filter_s else u
        out = loop if w or has.current_loop_s else into
        own = (u - filtered) / has.setpoint_filter_s if has.setpoint_filter_s else 0.0
        if w:
            second = w * w * (into - loop) - 2.0 * d * w * loop_slope
            return [own, loop_slope, second, out, x[3] / INERTIA]
        return [own, (into - loop) / has.current_loop_s if has.current_loop_s else 0.0, 0.0, out, x[3] / INERTIA]

    state, found = np.zeros(5), {0.0: np.zeros(5)}
    edges = np.unique(np.round(np.concatenate([times, T * np.arange(len(SETPOINTS) + 1)]), 12))
    for left, right in pairwise(edges):
        inside = 0.5 * (left + right)
        i = int(np.flatnonzero((times[:-1] <= inside) & (inside < times[1:]))[-1]) if inside < times[-1] else len(times) - 2
        rate = (values[i + 1] - values[i]) / (times[i + 1] - times[i])
        ends = (values[i] + rate * (left - times[i]), values[i] + rate * (right - times[i]))
        state = solve_ivp(slope, (left, right), state, args=(left, right, *ends), rtol=1e-10, atol=1e-13).y[:, -1]
        found[round(right / T, 6)] = state
    at = np.array([found[float(k)] for k in range(len(SETPOINTS))])
    return np.diff(at[:, 3], prepend=0.0) / T, at[:, 4], at[:, 3] / INERTIA


@pytest.mark.parametrize("delay_s", [0.0, 0.4e-3, 1.7e-3])
@pytest.mark.parametrize(
    "has",
    [
        {"setpoint_filter_s": 0.5e-3},
        {"current_loop_s": 0.16e-3},
        {"current_loop_hz": 1000.0},
        {"current_loop_hz": 300.0, "current_loop_damping": 0.3},
        {"current_loop_hz": 400.0, "current_loop_damping": 1.0},
        {"torque_slew_nm_s": 700.0},
        {"torque_slew_nm_s": 700.0, "setpoint_filter_s": 0.3e-3, "current_loop_s": 0.2e-3},
        {"setpoint_filter_s": 1e-3, "current_loop_hz": 600.0, "current_loop_damping": 2.0},
    ],
)
def test_the_torque_is_delivered_as_the_differential_equations_say(delay_s: float, has: dict[str, float]) -> None:
    read, angle, speed = played(with_instruments(delay_s, **has))
    torque, true_angle, true_speed = solved(delay_s, Instruments(**has))
    assert np.max(np.abs(read - torque / UNIT_NM)) < 0.5 + 1e-3  # rounded to whole units
    assert np.max(np.abs(speed - true_speed)) < 1e-7 * np.max(np.abs(true_speed))  # mean torques are exact
    # Held over h = 0.1 ms, the torque's part inside a piece is lost: at most sum |du| h^2 / 12 J.
    change = UNIT_NM * np.sum(np.abs(np.diff(SETPOINTS, prepend=0))) * 2.0  # a weakly damped loop swings, by less than as much again
    assert np.max(np.abs(angle - true_angle)) < change * 1e-8 / 12.0 / INERTIA


def test_a_step_through_a_first_order_filter_is_the_exponential() -> None:
    """Mean of 1 - exp(-t/τ) over tick k, in the frames."""
    tau = 0.5e-3
    read, _, _ = played(with_instruments(setpoint_filter_s=tau), (1000,) * 8)
    # Sent after SYNC 0, acts from t_1 on, first read at SYNC 2.
    means = [1000.0 * (1.0 - tau / T * (math.exp(-k * T / tau) - math.exp(-(k + 1) * T / tau))) for k in range(6)]
    assert read == pytest.approx([0, 0, *means], abs=0.5 + 1e-9)


@pytest.mark.parametrize(
    ("has", "over", "under"),
    [
        (
            {"setpoint_low_pass_hz": 150.0},
            [(2 * math.pi * 150.0) ** 2],
            [1.0, math.sqrt(2.0) * 2 * math.pi * 150.0, (2 * math.pi * 150.0) ** 2],
        ),
        (
            {"setpoint_notch_hz": 107.0, "setpoint_notch_width_hz": 60.0, "setpoint_notch_db": 20.0},
            [1.0, 0.1 * 2 * math.pi * 60.0, (2 * math.pi * 107.0) ** 2],
            [1.0, 2 * math.pi * 60.0, (2 * math.pi * 107.0) ** 2],
        ),
    ],
)
def test_filters_against_a_resonance_are_their_transfer_functions(has: dict[str, float], over: list[float], under: list[float]) -> None:
    """Mean torques of ticks behind steps, against scipy's own solution of the transfer function on a grid of 1/200 tick."""
    levels, fine = [1.0, -0.5, 0.25, 0.25, 0.0, 0.8, 0.8, 0.8, 0.8], 200
    delivery = TorqueDelivery(Instruments(**has), T)
    shaped = [delivery.shape([(level, 1.0)]) for level in levels]
    held = np.append(np.repeat(levels, fine), levels[-1])
    time_s = T / fine * np.arange(len(held))
    out = lsim((over, under), held, time_s, interp=False)[1]
    expected = [np.trapezoid(out[k * fine : (k + 1) * fine + 1], dx=1.0 / fine) for k in range(len(levels))]
    at_once = over[0] if len(over) == len(under) else 0.0  # a tick's last point is on the next one's side of the step
    expected = np.array(expected) - 0.5 / fine * at_once * np.diff([*levels, levels[-1]])
    assert np.array([sum(torque * share for torque, share in pieces) for pieces in shaped]) == pytest.approx(
        expected, abs=1e-5
    )  # the trapezoids of the grid


def test_the_torque_path_forgets_when_the_stage_goes_off() -> None:
    one = with_instruments(current_loop_s=2e-3, torque_slew_nm_s=500.0)
    for _ in range(5):
        one.cycle(1000)
    one.control(0x00)
    one.plant.steps.clear()
    one.run(0.005)
    assert {torque for torque, _ in one.plant.steps} == {0.0}
    one.close()


def correlation(values: Array) -> float:
    """Of neighbours."""
    return float(np.corrcoef(values[:-1], values[1:])[0, 1])


@pytest.mark.parametrize("time_s", [0.0, 3e-3])
def test_process_torque_acts_and_is_read_while_the_stage_is_on(time_s: float) -> None:
    one = with_instruments(process_torque_nm=0.05, process_torque_time_s=time_s, seed=5)
    one.plant.steps.clear()
    read = np.array([one.cycle(0)[1] for _ in range(1000)]) * UNIT_NM
    steps = np.array(one.plant.steps)
    assert {duration for _, duration in one.plant.steps} == {T}
    # The reading at SYNC k is what acted in the tick before it, rounded.
    assert np.max(np.abs(read[1:] - steps[:-1, 0])) <= 0.5 * UNIT_NM + 1e-12
    one.run(7.0)
    acted = np.array(one.plant.steps)[:, 0]
    pole = math.exp(-T / time_s) if time_s else 0.0
    independent = len(acted) * (1.0 - pole**2) / (1.0 + pole**2)
    assert np.std(acted) == pytest.approx(0.05, rel=4.0 / math.sqrt(2.0 * independent))
    assert correlation(acted) == pytest.approx(pole, abs=4.0 * math.sqrt((1.0 - pole**2) / len(acted)) + 2.0 / len(acted))
    one.control(0x00)
    one.plant.steps.clear()
    one.run(0.01)
    assert {torque for torque, _ in one.plant.steps} == {0.0}
    one.close()


def test_the_reading_filter_lags_and_the_motion_does_not() -> None:
    tau = 2e-3
    read, _, speed = played(with_instruments(reading_filter_s=tau), (1000,) * 10)
    assert read == pytest.approx([0, 0, *(1000.0 * (1.0 - math.exp(-k * T / tau)) for k in range(1, 9))], abs=0.5 + 1e-9)
    assert speed == pytest.approx([0, 0, *(1000 * UNIT_NM / INERTIA * k * T for k in range(1, 9))])


@pytest.mark.parametrize(
    ("has", "deviation", "pole"),
    [
        ({}, 1.0, 0.0),
        ({"reading_filter_s": 2e-3}, 1.0, 0.0),
        ({"reading_filter_s": 2e-3, "reading_filters_noise": True}, math.sqrt(math.tanh(0.25)), math.exp(-0.5)),  # (1 - a) / (1 + a)
        ({"torque_noise_time_s": 4e-3}, 1.0, math.exp(-0.25)),
    ],
)
def test_sensor_noise_has_its_colour(has: dict[str, Any], deviation: float, pole: float) -> None:
    one = with_instruments(torque_noise_nm=0.2, seed=8, **has)
    one.run(0.02)
    count = 3000
    read = np.array([one.cycle(0)[1] for _ in range(count)]) * UNIT_NM
    independent = count * (1.0 - pole**2) / (1.0 + pole**2)
    assert np.std(read) == pytest.approx(0.2 * deviation, rel=4.0 / math.sqrt(2.0 * independent))
    assert correlation(read) == pytest.approx(pole, abs=4.0 * math.sqrt((1.0 - pole**2) / count) + 2.0 / count)
    assert one.plant.position_rad == 0.0
    one.close()


@pytest.mark.parametrize(
    ("late_ticks", "delay_s", "expected"),
    [
        (0.25, 0.0, [0, 0, 750, 250, 0, 0, 0]),
        (1.0, 0.0, [0, 0, 0, 1000, 0, 0, 0]),
        (1.5, 0.0, [0, 0, 0, 500, 500, 0, 0]),
        (0.3, 0.4e-3, [0, 0, 300, 700, 0, 0, 0]),  # acts from 0.4 to 1.4 ms, read over -0.3 to 0.7 and 0.7 to 1.7 ms
        (0.8, 0.4e-3, [0, 0, 0, 800, 200, 0, 0]),
    ],
)
def test_a_late_reading_is_the_mean_of_an_earlier_window(late_ticks: float, delay_s: float, expected: list[int]) -> None:
    read, _, _ = played(with_instruments(delay_s, reading_late_ticks=late_ticks), (1000, 0, 0, 0, 0, 0, 0))
    assert read.tolist() == expected


def test_a_reading_that_is_the_command_knows_no_current_loop_and_no_noise() -> None:
    has = {"current_loop_s": 0.5e-3, "process_torque_nm": 0.1, "reading_is_command": True}
    read, _, speed = played(with_instruments(1e-3, torque_noise_nm=6e-3, **has))
    assert read.tolist() == [0, 0, 0, *SETPOINTS[:-3]]
    ideal = np.concatenate([[0.0] * 3, np.cumsum(SETPOINTS[:-3])]) * UNIT_NM * T / INERTIA
    assert np.max(np.abs(speed - ideal)) > 0.1
    filtered, _, _ = played(with_instruments(setpoint_filter_s=0.5e-3, **has))
    alone, _, _ = played(with_instruments(setpoint_filter_s=0.5e-3))
    assert filtered.tolist() == alone.tolist()  # a filter of the setpoint lies in front of the command


@pytest.mark.parametrize(("setpoint", "read"), [(124, 120), (126, 130), (-124, -120), (4, 0), (1000, 1000)])
def test_the_reading_has_steps(setpoint: int, read: int) -> None:
    one = with_instruments(reading_step_nm=10 * UNIT_NM)
    assert [one.cycle(setpoint)[1] for _ in range(4)][-1] == read
    one.close()


@pytest.mark.parametrize("counts", [500, 1_000_000])
def test_coarse_and_fine_encoders_count_to_the_nearest(counts: int) -> None:
    one = with_instruments(counts_per_rev=counts)
    one.plant.velocity_rad_s = 7.3
    got, true = [], []
    for _ in range(50):
        true.append(one.plant.position_rad)
        got.append(one.cycle(0)[0])
    assert np.max(np.abs(np.array(got[1:]) - np.array(true[1:]) * counts / math.tau)) <= 0.5 + 1e-9
    one.close()


def test_the_encoder_errs_once_and_twice_per_line() -> None:
    counts, lines, once, twice = 1_000_000, 100, 4e-4, 1.5e-4
    has = {"lines_per_rev": lines, "interpolation_error_rad": once, "interpolation_error_twice_rad": twice}
    one = with_instruments(counts_per_rev=counts, **has)
    angles, got = math.tau / lines * np.linspace(0.0, 3.0, 61), []
    for angle in angles:
        one.plant.position_rad = float(angle)
        one.run(T)
        got.append(one.read(0x6064, code="i"))
    error = np.array(got) * math.tau / counts - angles
    expected = once * np.sin(lines * angles) + twice * np.sin(2 * lines * angles)
    assert np.max(np.abs(error - expected)) <= 0.5 * math.tau / counts + 1e-12
    one.close()


ALL = {
    "torque_slew_nm_s": 500.0, "setpoint_filter_s": 0.2e-3, "current_loop_hz": 700.0, "process_torque_nm": 0.01,
    "process_torque_time_s": 2e-3,
    "torque_noise_time_s": 1e-3, "reading_filter_s": 1e-3, "reading_late_ticks": 0.4, "reading_step_nm": 5e-3, "lines_per_rev": 1024,
    "interpolation_error_rad": 1e-4,
}  # fmt: skip


def digest(one: CyclicTorque) -> str:
    """Of the exchanged samples and the true motion of a short session."""
    random, found = np.random.default_rng(4), hashlib.sha256()
    for setpoint in random.integers(-600, 600, 300).tolist():
        found.update(repr(one.cycle(setpoint)).encode())
    found.update(repr(one.plant.position_rad).encode())
    one.close()
    return found.hexdigest()[:16]


def test_equal_seeds_give_equal_frames_with_all_instruments() -> None:
    def seen(seed: int) -> str:
        return digest(with_instruments(0.4e-3, torque_noise_nm=6e-3, seed=seed, **ALL))

    assert seen(1) == seen(1)
    assert seen(1) != seen(2)


@pytest.mark.parametrize(("delay_s", "frames"), [(1e-3, "387553838089c81a"), (0.4e-3, "55e51449560a3540")])
def test_without_instruments_every_frame_is_what_it_was_before_there_were_any(delay_s: float, frames: str) -> None:
    assert digest(prepared(setpoint_delay_s=delay_s, torque_noise_nm=6e-3, seed=3)) == frames


@pytest.mark.parametrize(
    ("entries", "text"),
    [
        ({"setpoint_filter_s": -1e-3}, r"setpoint_filter_s is -0.001 \(filter of the torque setpoint\); it must be at least 0"),
        ({"setpoint_filter_s": 0.5}, r"it must be at most 0.1, so look at the unit"),
        ({"setpoint_filter_s": "0.5 ms"}, r"setpoint_filter_s is '0.5 ms'; give a plain number, without its unit"),
        ({"current_loop_s": 1e-4, "current_loop_hz": 500.0}, r"of first or of second order, leave one out"),
        ({"current_loop_damping": 0.0}, r"current_loop_damping is 0 .*; it must be above 0"),
        ({"reading_filters_noise": True}, r"give reading_filter_s too"),
        ({"reading_is_command": 1}, r"reading_is_command is 1; write true or false"),
        ({"interpolation_error_rad": 1e-4}, r"give lines_per_rev too"),
        ({"interpolation_error_rad": 1e-2, "lines_per_rev": 1024}, r"moves 10.2 times as fast as the shaft"),
        ({"lines_per_rev": 10.5}, r"lines_per_rev is 10.5 .*; it must be a whole number"),
        ({"counts_per_rev": 0}, r"counts_per_rev is 0 .*; it must be at least 1"),
        ({"torque_noise_nm": float("nan")}, r"it must be a finite number"),
        ({"setpoint_fliter_s": 1e-3}, r"setpoint_fliter_s is not known; known are setpoint_delay_s, "),
    ],
)
def test_what_cannot_be_is_refused_in_a_file_and_as_an_option(tmp_path: Path, entries: dict[str, Any], text: str) -> None:
    path = tmp_path / "drive.yaml"
    write_text(path, to_yaml({**read_yaml(find_config("plants", "g_a")), "drive": entries}))
    with pytest.raises(UsageError, match=f"the drive section of .*drive.yaml cannot be: .*{text}"):
        load_plant(path)
    known = text if set(entries) <= set(DRIVE_KEYS) else "the virtual drive has no option setpoint_fliter_s"
    with pytest.raises(UsageError, match=known):
        open_drive("virtual:g_a", entries)


def test_a_plant_file_or_options_give_the_drive_its_instruments(tmp_path: Path) -> None:
    path = tmp_path / "drive.yaml"
    write_text(path, to_yaml({**read_yaml(find_config("plants", "g_a")), "drive": {**ALL, "counts_per_rev": 2000}}))
    file = load_plant(path)
    assert (file.instruments, file.counts_per_rev) == (Instruments(**ALL), 2000)
    write_text(path, to_yaml({**file.model.to_dict(), "drive": file.drive_section()}))
    assert load_plant(path) == file
    assert load_plant("g_a").instruments == IDEAL
    assert load_plant("g_a", {**ALL, "counts_per_rev": 2000}) == load_plant(path)
    with open_drive("virtual:g_a", {**ALL, "counts_per_rev": 2000}) as drive:
        assert drive.capabilities.counts_per_rev == 2000


def test_the_page_tells_every_key() -> None:
    page = (Path(__file__).parents[2] / "docs" / "simulated.md").read_text(encoding="utf-8")
    assert [key for key in DRIVE_KEYS if f"`{key}`" not in page] == []
