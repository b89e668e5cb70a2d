"""Each instrument does what it says, held against an independent form; ideal ones are those of before, bit by bit."""

from __future__ import annotations

import hashlib
import math
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy import signal
from scipy.integrate import solve_ivp

from beltcomm.axis import load_axis
from beltcomm.recording import load_recording
from marks import quick
from truth.hidden import draw, drive, readings, recorder, write_session
from truth.hidden import layout as at
from truth.hidden.folder import csv_text
from truth.hidden.instruments import Instruments, draw_instruments
from truth.hidden.layout import Array
from truth.hidden.machines import Machine
from truth.hidden.session import Record, Session, Task
from truth.hidden.signals import multisine

RATED_NM = 1.43
#: Records of draw 33 with dead_time and stribeck, strength 0.7, as the simulator made them before it had instruments.
BEFORE = "3c1609d50ee2a5be"


def excited(machine: Machine, samples: int = 900, fine: int = 0) -> Record:
    """A record under a multisine."""
    session = Session(machine, fine=fine)
    session.place(0.5 * machine.base.stroke_m)
    shape = multisine(np.random.default_rng(1))[0][:samples]
    return session.record(Task("frf", "frf", 0.5 * machine.base.stroke_m, excitation=1.5 * shape))


def driven(
    instruments: Instruments, setpoints: Array, process: Array | None = None, machine: Machine | None = None
) -> tuple[Array, Array, Array, Array]:
    """Reported and acting torque, acting torque every 40 us, and angle under setpoints; of a motor too heavy to move when none is given."""
    p = (machine or draw(3)).p.copy()
    if machine is None:
        p[at.J] = 1e6
    n, m = len(setpoints), round(instruments.period_s / 40e-6)
    gains = np.zeros(recorder.GAINS)
    gains[recorder.LIMIT], gains[recorder.QUANTUM], gains[recorder.PERIOD] = 100.0, 1e-9, instruments.period_s
    extra = np.zeros((n, 3))
    extra[:, 0] = instruments.period_s
    if process is not None:
        extra[:, 1] = process
    fine, fine_torque, state = np.zeros(n * m), np.zeros(n * m), np.zeros(at.STATES)
    angle, _, reported, acting = recorder.run(
        state, p, np.zeros((0, 3)), gains, np.zeros(recorder.MEMORY), instruments.vector(RATED_NM), np.zeros((n, 2)), setpoints,
        extra, fine, fine_torque, 40e-6,
    )  # fmt: skip
    return reported, acting, fine_torque, angle


def test_ideal_instruments_are_those_of_before() -> None:
    plain, ideal = draw(33, ("dead_time", "stribeck"), 0.7), draw(33, ("dead_time", "stribeck"), 0.7, instruments=Instruments.ideal())
    assert hashlib.sha256(csv_text(excited(plain)).encode()).hexdigest()[:16] == BEFORE
    one, other = excited(plain, fine=25), excited(ideal, fine=25)
    for item in fields(Record)[1:]:
        assert np.array_equal(getattr(one, item.name), getattr(other, item.name)), item.name
    assert np.array_equal(one.fine_torque, np.repeat(one.acting_nm, 25))


def test_the_shaped_path_without_a_shape_moves_the_machine_alike() -> None:
    setpoints = 1.5 * multisine(np.random.default_rng(1))[0][:400]
    for effects in ((), ("current_lag",), ("dead_time",)):
        machine = slippery(draw(12, effects, 0.9))
        one, other = (driven(Instruments(latched=shaped), setpoints, machine=machine) for shaped in (False, True))
        assert np.ptp(one[3]) > 0.1
        assert other[3] == pytest.approx(one[3], abs=1e-8)
        assert other[0] == pytest.approx(one[0], abs=1e-9)


def test_a_draw_is_its_seed_s_and_leaves_the_machine_alone() -> None:
    plain, one, other = draw(8, ("cogging",), 0.5), *(draw(8, ("cogging",), 0.5, drawn_instruments=True) for _ in range(2))
    assert one.instruments == other.instruments
    assert one.instruments != draw(9, drawn_instruments=True).instruments
    assert np.array_equal(plain.p, one.p)
    assert replace(one.base, counts_per_rev=None) == plain.base
    assert one.hidden == plain.hidden
    told = {name: dict(part) if isinstance(part, dict) else part for name, part in one.sheet.items()}
    told["motor"]["encoder_counts_per_rev"] = plain.sheet["motor"]["encoder_counts_per_rev"]
    assert told == plain.sheet
    assert one.sheet["motor"]["encoder_counts_per_rev"] == one.instruments.counts_per_rev
    first, second = excited(one), excited(other)
    assert first.torque_nm.tobytes() == second.torque_nm.tobytes()
    assert first.position_rad.tobytes() == second.position_rad.tobytes()
    assert first.t_s.tobytes() == second.t_s.tobytes()


LIMITS: dict[str, tuple[float, float]] = {
    "stamp_jitter": (0.02, 0.2), "sampling_jitter": (0.001, 0.01), "setpoint_step": (1e-3, 1e-2), "setpoint_alpha": (0.4, 1.0),
    "inner_phase": (0.05, 0.95), "setpoint_filter_s": (0.1e-3, 1e-3), "process_share": (0.001, 0.01), "process_colour": (0.5, 0.98),
    "reading_filter_s": (0.2e-3, 5e-3), "reading_late": (0.05, 1.0), "reading_step": (1e-3, 1e-2), "noise_colour": (0.3, 0.95),
    "counts_per_rev": (500, 2**20), "once_rad": (1e-5, 2e-4), "twice_rad": (1e-6, 2e-4), "lines_per_rev": (128, 2048),
}  # fmt: skip


def test_draws_keep_their_ranges_and_meet_everything() -> None:
    machines = [draw(seed, family=("sheet", "wide", "rigid")[seed % 3]) for seed in range(600)]
    drawn = [draw_instruments(machine.seed, machine.base) for machine in machines]
    ideal = Instruments.ideal()
    for name, (low, high) in LIMITS.items():
        values = [getattr(one, name) for one in drawn if getattr(one, name) != getattr(ideal, name)]
        assert len(values) > 10, name
        assert low * (1 - 1e-12) <= min(values) <= max(values) <= high, name
    for machine, one in zip(machines, drawn, strict=True):
        if not machine.base.rigid:
            assert one.period_s in (0.5e-3, 1e-3, 2e-3, 4e-3)
            assert one.period_s * machine.base.resonance_hz <= 0.3
        if one.command_only:
            assert one.process_share > 0.0
            assert one.reading_filter_s == one.reading_late == 0.0
        if one.loop_order == 2:
            assert 300.0 <= 1.0 / (math.tau * one.loop_s) <= 2000.0
        if one.loop_order == 1:
            assert 0.05e-3 <= one.loop_s <= 0.5e-3
    assert {one.period_s for one in drawn} == {0.5e-3, 1e-3, 2e-3, 4e-3, 5e-3, 10e-3}
    assert np.mean([one.setpoint_column for one in drawn]) == pytest.approx(0.75, abs=0.06)
    assert np.mean([len(one.describe()) > 12 for one in drawn]) == pytest.approx(0.06, abs=0.03)


def slippery(machine: Machine) -> Machine:
    """The machine without Coulomb friction, which makes of a difference of a microradian one of a count."""
    p = machine.p.copy()
    p[at.COULOMB], p[at.BRISTLE], p[at.MICRO] = 1e-12, 1e-12, 0.0
    return replace(machine, p=p)


STEPS = np.repeat([0.0, 1.0, -0.4, 0.7, 0.0], 8)


@pytest.mark.parametrize("period", [0.5e-3, 1e-3, 4e-3])
@pytest.mark.parametrize(
    ("path", "num", "den"),
    [
        ({"setpoint_filter_s": 0.4e-3}, [1.0], [0.4e-3, 1.0]),
        ({"loop_order": 1, "loop_s": 0.07e-3}, [1.0], [0.07e-3, 1.0]),
        ({"loop_order": 2, "loop_s": 1 / 6000.0, "loop_damping": 0.6}, [1.0], [1 / 6000.0**2, 2 * 0.6 / 6000.0, 1.0]),
        ({"setpoint_filter_s": 0.3e-3, "loop_order": 2, "loop_s": 1 / 2000.0, "loop_damping": 0.9},
         [1.0], np.polymul([0.3e-3, 1.0], [1 / 2000.0**2, 2 * 0.9 / 2000.0, 1.0])),
    ],
)  # fmt: skip
def test_filter_and_current_loop_have_their_step_response(path: dict[str, Any], num: Any, den: Any, period: float) -> None:
    _, acting, fine, _ = driven(Instruments(period_s=period, **path), STEPS)
    h = 1e-6
    held = np.repeat(np.concatenate(([0.0], STEPS[:-1])), round(period / h))  # one sample late
    system = signal.cont2discrete((num, den), h, "zoh")
    exact = signal.lfilter(system[0][0], system[1], np.concatenate((held, [0.0])))[1:]
    exact_at = np.concatenate(([0.0], exact))
    means = (0.5 * (exact_at[1:] + exact_at[:-1])).reshape(len(STEPS), -1).mean(axis=1)
    assert acting == pytest.approx(means, abs=2e-4)
    assert fine.reshape(len(STEPS), -1).mean(axis=1) == pytest.approx(acting, abs=1e-12)


def test_filter_in_the_samples_clock_delay_and_steps() -> None:
    setpoints = np.random.default_rng(2).normal(0.0, 1.0, 60)
    reported, acting, _, _ = driven(Instruments(setpoint_alpha=0.6, delay_samples=2, setpoint_step=0.01), setpoints)
    late = np.concatenate(([0.0, 0.0], setpoints[:-2]))
    stepped = 0.0143 * np.round(late / 0.0143)
    assert acting == pytest.approx(signal.lfilter([0.6], [1.0, -0.4], stepped), abs=1e-9)
    assert reported == pytest.approx(acting, abs=1e-9)


def test_slew_limit_and_inner_cycle() -> None:
    _, _, fine, _ = driven(Instruments(slew_nm_s=250.0), STEPS)
    slope = np.diff(fine) / 40e-6
    assert np.abs(slope).max() == pytest.approx(250.0, rel=1e-6)
    assert fine[11 * 25] == pytest.approx(250.0 * 2.02e-3, rel=1e-6)
    assert fine[(9 + 4) * 25 + 1] == pytest.approx(1.0)  # 1 N m takes 4 ms
    reported, acting, fine, _ = driven(Instruments(inner_phase=0.3), STEPS)
    before = np.concatenate(([0.0, 0.0], STEPS[:-2]))
    now = np.concatenate(([0.0], STEPS[:-1]))
    assert acting == pytest.approx(0.3 * before + 0.7 * now, abs=1e-9)
    assert reported == pytest.approx(acting, abs=1e-9)
    assert fine[9 * 25 + np.array([0, 6, 8, 24])] == pytest.approx([0.0, 0.0, 1.0, 1.0], abs=1e-9)


def test_the_torque_that_acts_moves_the_motor() -> None:
    # the motor alone, a current loop of 0.3 ms, torque switching at 0.4 of the sample: against an integrator of its own
    loop = Instruments(inner_phase=0.4, loop_order=1, loop_s=0.3e-3, process_share=0.01)
    process = np.random.default_rng(3).normal(0.0, 0.02, len(STEPS))
    machine = draw(3)
    base, p = machine.base, slippery(machine).p
    p[[at.K1, at.K2, at.K3, at.D1, at.D2, at.D3]] = 1e-12
    found = driven(loop, STEPS, process, replace(machine, p=p))[3]
    x = np.zeros(3)
    angles = [0.0]
    now, before = np.concatenate(([0.0], STEPS[:-1])), np.concatenate(([0.0, 0.0], STEPS[:-2]))
    for i in range(len(STEPS) - 1):
        for asked, length in ((before[i], 0.4e-3), (now[i], 0.6e-3)):

            def rates(_: float, x: Array, asked: float = asked, extra: float = process[i]) -> list[float]:
                return [x[1], (x[2] + extra - base.viscous_nm_s_rad * x[1]) / base.inertia_kg_m2, (asked - x[2]) / 0.3e-3]

            x = solve_ivp(rates, (0.0, length), x, rtol=1e-10, atol=1e-12).y[:, -1]
        angles.append(float(x[0]))
    assert np.ptp(angles) > 0.5
    assert found == pytest.approx(np.array(angles), abs=1e-7)


def test_dead_time_of_the_machine_delays_a_shaped_torque_too() -> None:
    loop, plain = Instruments(loop_order=1, loop_s=0.2e-3), slippery(draw(12))
    p = plain.p.copy()
    p[at.DEAD_TIME] = 0.5e-3  # half a sample, or the drive half a sample later: the same motion
    setpoints = 1.5 * multisine(np.random.default_rng(1))[0][:400]
    one = driven(loop, setpoints, machine=replace(plain, p=p))[3]
    other = driven(replace(loop, inner_phase=0.5), setpoints, machine=plain)[3]
    assert one == pytest.approx(other, abs=1e-7)
    assert np.ptp(one) > 0.1


def test_readings_are_filtered_late_latched_or_the_command() -> None:
    setpoints = np.random.default_rng(5).normal(0.0, 1.0, 80)
    acting = np.concatenate(([0.0], setpoints[:-1]))
    before = np.concatenate(([0.0], acting[:-1]))
    keep = math.exp(-1.0 / 2.0)
    filtered = signal.lfilter([1 - keep], [1, -keep], acting)
    assert driven(Instruments(reading_filter_s=2e-3), setpoints)[0] == pytest.approx(filtered, abs=1e-9)
    assert driven(Instruments(reading_late=0.3), setpoints)[0] == pytest.approx(0.7 * acting + 0.3 * before, abs=1e-9)
    assert driven(Instruments(reading_late=1.0), setpoints)[0] == pytest.approx(before, abs=1e-9)
    assert driven(Instruments(reading_late=0.9, latched=True), setpoints)[0] == pytest.approx(acting, abs=1e-9)
    assert driven(Instruments(reading_late=0.9, latched=True, inner_phase=0.5), setpoints)[0] == pytest.approx(before, abs=1e-9)
    half, start = math.exp(-0.25), np.concatenate(([0.0], filtered[:-1]))
    late = driven(Instruments(reading_filter_s=2e-3, reading_late=0.5), setpoints)[0]
    assert late == pytest.approx(acting + (start - acting) * half, abs=1e-9)
    told, moved, _, _ = driven(Instruments(command_only=True, loop_order=1, loop_s=0.5e-3), setpoints, 0.1 * setpoints)
    assert told == pytest.approx(acting, abs=1e-9)
    assert np.std(moved - acting) > 0.1
    whole = driven(Instruments(process_share=0.01), setpoints, 0.1 * setpoints)
    assert whole[0] == pytest.approx(acting + 0.1 * setpoints, abs=1e-9)
    assert whole[1] == pytest.approx(whole[0], abs=1e-9)


@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_process_torque_and_noise_have_their_size_and_colour(pole: float) -> None:
    n, share = 50_000, 0.006
    made = readings.unsteady(np.random.default_rng(1), n, Instruments(process_share=share, process_colour=pole), RATED_NM)
    assert np.std(made[:, 1]) == pytest.approx(share * RATED_NM, rel=0.03)
    freq, power = signal.welch(made[:, 1], 1000.0, nperseg=1024)
    exact = 2e-3 * (share * RATED_NM) ** 2 * (1.0 - pole**2) / np.abs(1.0 - pole * np.exp(-2j * math.pi * freq * 1e-3)) ** 2
    assert power[2:-2] == pytest.approx(exact[2:-2], rel=0.6)
    assert np.mean(power[2:-2] / exact[2:-2]) == pytest.approx(1.0, abs=0.02)
    inside = Instruments(reading_filter_s=3e-3, noise_inside=True)
    noise = readings.coloured(np.random.default_rng(2), n, 0.01, pole)
    keep = math.exp(-1.0 / 3.0)
    read = readings.torque_reading(np.zeros(n), noise, inside, RATED_NM)
    assert read[1:] - keep * read[:-1] == pytest.approx((1.0 - keep) * noise[1:], abs=1e-12)
    assert readings.torque_reading(np.ones(n), noise, replace(inside, noise_inside=False), RATED_NM) == pytest.approx(1.0 + noise)


def test_torque_reading_stands_in_steps() -> None:
    read = readings.torque_reading(np.linspace(-1.0, 1.0, 5000), np.zeros(5000), Instruments(reading_step=0.005), RATED_NM)
    assert np.diff(np.unique(read)) == pytest.approx(0.005 * RATED_NM)
    assert np.abs(read - np.linspace(-1.0, 1.0, 5000)).max() <= 0.5001 * 0.005 * RATED_NM


def test_encoder_counts_interpolates_and_trembles() -> None:
    kind = Instruments(counts_per_rev=65536, lines_per_rev=128, once_rad=2e-4, twice_rad=1e-4, phases_rad=(0.4, 1.1))
    ideal, read = (excited(draw(12, instruments=one), fine=25) for one in (Instruments(counts_per_rev=65536), kind))
    assert np.ptp(ideal.position_rad) > 10 * math.tau / 128
    for record in (ideal, read):
        counts = record.position_rad * 65536 / math.tau
        assert counts == pytest.approx(np.round(counts), abs=1e-6)
    shown = read.fine[::25]
    error = 2e-4 * np.sin(128 * shown + 0.4) + 1e-4 * np.sin(256 * shown + 1.1)
    assert np.abs(read.position_rad - shown - error).max() <= 0.5001 * math.tau / 65536
    assert np.abs(ideal.position_rad - ideal.fine[::25]).max() <= 0.5001 * math.tau / 65536
    noisy = excited(draw(12, instruments=Instruments(counts_per_rev=2**20, angle_noise_rad=5e-5)), fine=25)
    assert np.std(noisy.position_rad - noisy.fine[::25]) == pytest.approx(5e-5, rel=0.1)


def test_time_stamps_jitter_without_the_samples_and_samples_with_true_stamps() -> None:
    stamped = excited(draw(12, instruments=Instruments(stamp_jitter=0.1)))
    plain = excited(draw(12))
    assert np.array_equal(stamped.position_rad, plain.position_rad)
    off = stamped.t_s - plain.t_s
    assert 0.9e-4 < np.abs(off).max() <= 1e-4
    assert np.diff(stamped.t_s).min() > 0.0
    uneven = excited(draw(12, instruments=Instruments(sampling_jitter=0.01)), fine=25)
    lengths = np.diff(uneven.t_s)
    assert np.std(lengths) == pytest.approx(1e-5 * math.sqrt(2.0 / 3.0), rel=0.1)
    assert not np.array_equal(uneven.position_rad, plain.position_rad)
    assert uneven.t_s[-1] == pytest.approx(plain.t_s[-1], abs=1.1e-5)


def test_history_of_the_torque_looks_back_over_two_of_the_longest_samples() -> None:
    d, memory = Instruments(period_s=10e-3, reading_late=1.0).vector(RATED_NM), np.zeros(drive.MEMORY)
    for i in range(2000):
        drive.remember(float(i), 0.0, 20e-6, memory, d)
    end = memory[drive.CLOCK]
    wanted = [float(np.sum(np.arange(2000 - k)) * 20e-6) for k in (0, 1, 500, 1000)]
    assert [drive.at_instant(end - k * 20e-6, memory, d)[0] for k in (0, 1, 500, 1000)] == pytest.approx(wanted, rel=1e-9)
    assert drive.at_instant(-1.0, np.zeros(drive.MEMORY), d) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("family", quick(["rigid", "wide", "sheet"], 1))
def test_folder_obeys_the_contract_and_tells_no_truth(tmp_path: Path, family: str) -> None:
    seed = next(s for s in range(40, 200) if not draw(s, family=family, drawn_instruments=True).instruments.setpoint_column)
    machine = draw(seed, family=family, drawn_instruments=True)
    names = write_session(machine, tmp_path / "run", "default")
    axis = load_axis(tmp_path / "run" / "axis.yaml")
    assert axis.has_transmission == (family != "rigid")
    if family == "wide":
        assert axis.transmission_m_rad == pytest.approx(machine.base.radius_m, rel=1e-4)
        assert axis.motor_side_inertia_kg_m2 == pytest.approx(machine.base.inertia_kg_m2, rel=0.11)
        middle = 0.5 * machine.base.stroke_m
        assert axis.belt_stiffness_n_m(middle) == pytest.approx(machine.base.stiffness_n_m, rel=0.16)
    for name in names:
        recording = load_recording(tmp_path / "run" / "recordings" / f"{name}.csv", axis)
        assert recording.notes == ()
        assert recording.torque_setpoint is None
        assert np.all(np.diff(recording.t_s) > 0.0)
        assert recording.sample_period_s == pytest.approx(machine.instruments.period_s, rel=0.05)
        counts = recording.position * machine.instruments.counts_per_rev / math.tau
        assert counts == pytest.approx(np.round(counts), abs=1e-3)
    texts = [path.read_text(encoding="utf-8") for path in (tmp_path / "run").rglob("*.yaml")]
    words = {key for text in texts for key in _keys(yaml.safe_load(text))}
    assert not words & {item.name for item in fields(Instruments)} - {"period_s"}


def _keys(data: Any) -> set[str]:
    if not isinstance(data, dict):
        return set()
    return set(data).union(*(_keys(value) for value in data.values()))
