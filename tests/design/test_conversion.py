"""P-PI and PID: the printed polynomials, block diagrams solved as equations, a simulation of both, the way back, refusals.

The bounds are rounding: 1e-9 relative for sums of a few products, 1e-7 near a double root, where √(1e-16) is what a root keeps.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray
from scipy import signal

from beltcomm import api
from beltcomm.cli.main import cli
from beltcomm.control import Cascade, Feedforward, Prefilter, cascade_step, discrete_coefficients, new_state, prefilter_coefficients
from beltcomm.design.conversion import Pid, _least_proportional, to_cascades, to_pid
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.thesis import thesis_margins
from beltcomm.errors import DataError, Refused, UsageError

RATIO = 0.01242
G_A = DesignPlant(71.73e-6, RATIO, 13.44, 203.74e3, 33.17 * RATIO**2, 226.42, 20.0, dead_time_s=1e-3)
TABLE_A7 = Cascade(0.12, 1.39, 6.29, 0.002, Prefilter("butterworth", 123.24))
PERIOD = 1e-3
S = 1j * np.geomspace(0.1, 2900.0, 60)


def drawn(count: int, *, filtered: bool) -> list[Cascade]:
    """Gains over decades, T_R from none to 8 ms, K_v from none to more than all."""
    rng = np.random.default_rng(11)
    cascades = []
    for _ in range(count):
        kp, ki, kpp = np.exp(rng.uniform(-3.0, 3.0, 3)) * np.array([0.1, 1.5, 8.0])
        lag = float(rng.choice([0.0, 0.002, 0.008])) if filtered else 0.0
        forward = Feedforward(velocity=float(rng.choice([0.0, 0.5, 1.0, 1.2])))
        reference = bool(rng.integers(2)) if filtered else True
        cascades.append(Cascade(float(kp), float(ki), float(kpp), lag, feedforward=forward, filter_reference=reference))
    return cascades


def test_the_gains_of_table_a7_by_the_printed_equations() -> None:
    """(B.6e) to (B.6g) by hand: P = 1.39 + 0.12·6.29, I = 1.39·6.29, D = 0.12; b = 1 and no K_v of the PID (B.7), (B.8)."""
    pid = to_pid(replace(TABLE_A7, velocity_filter_s=0.0))
    assert (pid.kp_nm_rad, pid.ki_nm_rad_s, pid.kd_nm_s_rad) == pytest.approx((2.1448, 8.7431, 0.12), rel=1e-12)
    assert (pid.setpoint_weight, pid.velocity_feedforward_nm_s_rad) == (1.0, 0.0)
    assert (pid.prefilter, pid.feedforward) == (TABLE_A7.prefilter, TABLE_A7.feedforward)


def test_printed_closed_loops_are_the_same() -> None:
    """(B.4) and (B.5) as polynomials, with K_a and a plant G that is any number at any frequency; K_v = 1."""
    rng = np.random.default_rng(3)
    G = rng.normal(size=len(S)) + 1j * rng.normal(size=len(S))
    for one in drawn(50, filtered=False):
        c = replace(one, feedforward=Feedforward(velocity=1.0))
        pid, Ka = to_pid(c), 0.002
        kp, ki, kpp = c.kp_nm_s_rad, c.ki_nm_rad, c.kpp_1_s
        kv = pid.velocity_feedforward_nm_s_rad
        b4 = np.polyval([Ka, kv + pid.kd_nm_s_rad, pid.kp_nm_rad, pid.ki_nm_rad_s], S) / (
            pid.kd_nm_s_rad * S**2 + (1.0 / G + pid.kp_nm_rad) * S + pid.ki_nm_rad_s
        )
        b5 = np.polyval([Ka, kp, ki + kp * kpp, ki * kpp], S) / (kp * S**2 + (ki + kp * kpp + 1.0 / G) * S + ki * kpp)
        np.testing.assert_allclose(b4, b5, rtol=1e-9)


@pytest.mark.parametrize("period_s", [0.0, PERIOD])
def test_block_diagrams_with_filter_and_weights_are_the_same_from_reference_and_disturbance(period_s: float) -> None:
    """Both diagrams solved for the angle, s = jω or z = exp(jωT); the reference's velocity is s φ_d, or its discrete counterpart."""
    omega = S.imag
    z = np.exp(1j * omega * period_s)
    rng = np.random.default_rng(5)
    plant = rng.normal(size=len(omega)) + 1j * rng.normal(size=len(omega))
    for c in drawn(100, filtered=True):
        lag, kv = c.velocity_filter_s, c.feedforward.velocity
        if period_s:
            integrator = period_s / (z - 1.0)
            speed = (1.0 - 1.0 / z) / (lag + period_s - lag / z)
            # Filtered: the mean of two velocities spans the way between them.  Unfiltered: a velocity is the way to the next position.
            reference_speed = speed if c.filter_reference else 1.0 / integrator
        else:
            integrator, speed = 1.0 / S, S / (1.0 + lag * S)
            reference_speed = speed if c.filter_reference else S
        pi = c.kp_nm_s_rad + c.ki_nm_rad * integrator
        cascade = np.array([pi * (c.kpp_1_s + kv * reference_speed), -pi * (c.kpp_1_s + speed)])
        pid = to_pid(c, period_s)
        p, i, d = pid.kp_nm_rad, pid.ki_nm_rad_s, pid.kd_nm_s_rad
        other = np.array(
            [
                p * pid.setpoint_weight + i * integrator + pid.reference_gain_nm_s_rad * reference_speed,
                -(p + i * integrator + d * speed),
            ]
        )
        np.testing.assert_allclose(other, cascade, rtol=1e-9)
        # φ = plant (forward φ_d + back φ + disturbance)
        (one, two), (three, four) = ((plant * forward, plant * back) for forward, back in (cascade, other))
        np.testing.assert_allclose(three / (1.0 - four), one / (1.0 - two), rtol=1e-9)
        np.testing.assert_allclose(plant / (1.0 - four), plant / (1.0 - two), rtol=1e-9)


@pytest.mark.parametrize("filter_reference", [True, False])
def test_both_forms_move_the_two_mass_plant_alike(filter_reference: bool) -> None:
    """The compiled cascade and a PID written here, each on its own plant: reference, disturbance, notch, dead time, K_v = 0.7."""
    forward = Feedforward(inertia_kg_m2=2e-3, viscous_nm_s_rad=1e-3, velocity=0.7)
    cascade = Cascade(0.10, 1.2, 8.0, 0.002, Prefilter("notch", 673.0, 4.6), forward, filter_reference)
    pid = to_pid(cascade, PERIOD)
    n = 1200
    t = PERIOD * np.arange(n)
    speed = 40.0 * np.sin(3.0 * t) ** 2
    position = np.concatenate([[0.0], np.cumsum(0.5 * PERIOD * (speed[1:] + speed[:-1]))])
    if not filter_reference:
        position = np.concatenate([[0.0], np.cumsum(PERIOD * speed[:-1])])
    acceleration = np.gradient(speed, PERIOD)
    coefficients, state = discrete_coefficients(cascade, PERIOD, 1e9), new_state()

    def by_cascade(k: int, angle: float) -> float:
        return float(cascade_step(coefficients, state, position[k], speed[k], acceleration[k], angle, 0.0))

    by_pid = discrete_pid(pid, position, speed, acceleration)
    one, other = (moved(controller, n) for controller in (by_cascade, by_pid))
    assert np.ptp(one) > 10.0
    np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-9 * np.ptp(one))
    # The test would see a wrong D: the one of appendix B, without T_R and T.
    wrong = discrete_pid(replace(pid, kd_nm_s_rad=cascade.kp_nm_s_rad), position, speed, acceleration)
    assert np.max(np.abs(moved(wrong, n) - one)) > 1e-3 * np.ptp(one)


def discrete_pid(pid: Pid, position: NDArray, speed: NDArray, acceleration: NDArray):  # type: ignore[no-untyped-def, type-arg]
    """A PID step by step: integral by forward Euler, velocity filter (6.1) by differences, prefilter as a direct form I."""
    lag, forward = pid.derivative_filter_s, pid.feedforward
    b0, b1, b2, a1, a2 = prefilter_coefficients(pid.prefilter, PERIOD)
    memory = {"integral": 0.0, "angle": 0.0, "omega": 0.0, "omega_d": 0.0, "last": 0.0, "in": [0.0, 0.0], "out": [0.0, 0.0]}

    def step(k: int, angle: float) -> float:
        m = memory
        m["omega"] = (lag * m["omega"] + angle - m["angle"]) / (lag + PERIOD)
        m["angle"] = angle
        if pid.filter_reference:
            m["omega_d"] = (lag * m["omega_d"] + PERIOD * 0.5 * (speed[k] + m["last"])) / (lag + PERIOD)
        else:
            m["omega_d"] = speed[k]
        m["last"] = speed[k]
        raw = (
            pid.kp_nm_rad * (pid.setpoint_weight * position[k] - angle)
            + pid.ki_nm_rad_s * m["integral"]
            + pid.reference_gain_nm_s_rad * m["omega_d"]
            - pid.kd_nm_s_rad * m["omega"]
        )
        m["integral"] += PERIOD * (position[k] - angle)
        out = b0 * raw + b1 * m["in"][0] + b2 * m["in"][1] - a1 * m["out"][0] - a2 * m["out"][1]
        m["in"], m["out"] = [raw, m["in"][0]], [out, m["out"][0]]
        return float(out + forward.inertia_kg_m2 * acceleration[k] + forward.viscous_nm_s_rad * speed[k])

    return step


def moved(controller, n: int) -> NDArray:  # type: ignore[no-untyped-def, type-arg]
    """Motor angle of G_A under a controller, one period of dead time, 0.3 N m at the motor from half-time on."""
    plant = replace(G_A, dead_time_s=0.0)
    A, B = plant.state_space()
    Phi, Gamma, *_ = signal.cont2discrete((A, B[:, None], np.eye(4), np.zeros((4, 1))), PERIOD)
    x, under_way, out = np.zeros(4), 0.0, np.zeros(n)
    for k in range(n):
        out[k] = x[0]
        torque = controller(k, float(x[0]))
        x = Phi @ x + Gamma[:, 0] * (under_way + (0.3 if k > n // 2 else 0.0))
        under_way = torque
    return out


@pytest.mark.parametrize("period_s", [0.0, PERIOD])
def test_the_way_back_finds_the_cascade_among_its_two(period_s: float) -> None:
    found = 0
    for cascade in drawn(300, filtered=True):
        pid = to_pid(cascade, period_s)
        lag = cascade.velocity_filter_s + period_s
        total = pid.kp_nm_rad - lag * pid.ki_nm_rad_s
        roots = to_cascades(pid, period_s)
        both = [c for c in (roots.slow, roots.fast) if c is not None]
        assert [c.kpp_1_s for c in both] == sorted(c.kpp_1_s for c in both)
        near = min(both, key=lambda c: abs(c.ki_nm_rad - cascade.ki_nm_rad))
        tolerance = 1e-11 * max(1.0, total**2 / max(roots.discriminant, 1e-8 * total**2))
        gains = (near.kp_nm_s_rad, near.ki_nm_rad, near.kpp_1_s, near.feedforward.velocity)
        expected = (cascade.kp_nm_s_rad, cascade.ki_nm_rad, cascade.kpp_1_s, cascade.feedforward.velocity)
        # A K_P that is small beside K_I (T_R + T) is a difference of two larger numbers.
        assert gains == pytest.approx(expected, rel=10.0 * tolerance, abs=tolerance * (1.0 + lag * cascade.ki_nm_rad))
        for one in both:
            again = to_pid(one, period_s)
            assert (again.kp_nm_rad, again.ki_nm_rad_s) == pytest.approx((pid.kp_nm_rad, pid.ki_nm_rad_s), rel=1e-9)
            assert again.kd_nm_s_rad == pytest.approx(pid.kd_nm_s_rad, rel=1e-9, abs=1e-9 * one.kp_nm_s_rad)
            found += 1
    assert found > 300


def test_the_two_roots_exchange_the_zeros_of_the_pid() -> None:
    """(K_P s + K_I)(s + K_PP) has the same product either way (T_R = 0)."""
    roots = to_cascades(to_pid(replace(TABLE_A7, velocity_filter_s=0.0)))
    assert roots.slow.kpp_1_s == pytest.approx(6.29)
    assert roots.fast is not None
    assert roots.fast.kpp_1_s == pytest.approx(1.39 / 0.12)
    assert roots.fast.ki_nm_rad / roots.fast.kp_nm_s_rad == pytest.approx(6.29)


def test_what_is_said_about_the_two_roots_holds_for_the_thesis_gains() -> None:
    """The slow one: less phase margin in the velocity loop alone, less overshoot without velocity feedforward."""
    roots = to_cascades(to_pid(TABLE_A7))
    assert roots.fast is not None
    assert thesis_margins(G_A, roots.fast).phase_margin_deg > thesis_margins(G_A, roots.slow).phase_margin_deg
    peaks = []
    for cascade in (roots.slow, roots.fast):
        numbers = discrete_coefficients(replace(cascade, feedforward=Feedforward(velocity=0.0)), PERIOD, 1e9)
        state = new_state()
        peaks.append(moved_without_load(numbers, state))
    assert peaks[0] < peaks[1]


def moved_without_load(numbers: NDArray, state: NDArray) -> float:  # type: ignore[type-arg]
    """Largest angle after a step of the reference to 1 rad."""
    A, B = replace(G_A, dead_time_s=0.0).state_space()
    Phi, Gamma, *_ = signal.cont2discrete((A, B[:, None], np.eye(4), np.zeros((4, 1))), PERIOD)
    x, highest = np.zeros(4), 0.0
    for _ in range(1500):
        highest = max(highest, float(x[0]))
        x = Phi @ x + Gamma[:, 0] * cascade_step(numbers, state, 1.0, 0.0, 0.0, float(x[0]), 0.0)
    return highest


def test_the_condition_is_sharp_and_says_its_number() -> None:
    pid = Pid(1.0, 8.0, 0.12, derivative_filter_s=0.002)
    least = _least_proportional(pid, PERIOD)
    assert least == pytest.approx(0.003 * 8.0 + 2.0 * math.sqrt(0.96))
    with pytest.raises(Refused, match=r"negative, its zeros are complex .* raise P to 1\.98359 N m/rad") as caught:
        to_cascades(pid, PERIOD)
    assert caught.value.exit_code == 1
    with pytest.raises(Refused):
        to_cascades(replace(pid, kp_nm_rad=least * (1.0 - 1e-6)), PERIOD)
    assert to_cascades(replace(pid, kp_nm_rad=least * (1.0 + 1e-6)), PERIOD).fast is not None


def test_a_double_root_is_one_cascade_on_both_sides_of_rounding() -> None:
    """K_P K_PP = K_I: (P)² = 4 D I exactly; what is found lies within √ε of it."""
    for scale in np.linspace(0.9, 1.1, 41):
        cascade = Cascade(0.1 * scale, 0.7 / scale, 0.7 / (0.1 * scale**2), 0.0)
        found = to_cascades(to_pid(cascade)).slow
        assert (found.kp_nm_s_rad, found.ki_nm_rad, found.kpp_1_s) == pytest.approx(
            (cascade.kp_nm_s_rad, cascade.ki_nm_rad, cascade.kpp_1_s), rel=1e-6
        )


@pytest.mark.parametrize(
    ("pid", "error", "words"),
    [
        (Pid(1.0, 2.0, -1.0), Refused, "K_I would not be above 0"),
        (Pid(0.01, 8.0, -0.01, derivative_filter_s=0.01), Refused, "K_I would not be above 0"),
        (Pid(2.1448, 8.7431, 0.12, 0.5), Refused, "b = 0.5 needs K_v = 0.228"),
        (Pid(2.1448, 8.7431, 0.12, velocity_nm_s_rad=0.0), Refused, "reference velocity K_v = 0 "),
        (Pid(0.0, 0.0, 1.0), UsageError, "P = 0 has no cascade"),
        (Pid(-1.0, 1.0, 1.0), UsageError, "P is -1"),
        (Pid(1.0, math.nan, 1.0), UsageError, "I is nan"),
        (Pid(1.0, 1.0, math.inf), UsageError, "D is inf"),
    ],
)
def test_what_is_no_cascade_is_refused(pid: Pid, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        to_cascades(pid)


@pytest.mark.parametrize(
    "cascade", [Cascade(0.1, 1.0, 0.0, 0.0), Cascade(0.0, 0.0, 5.0, 0.0), Cascade(-0.1, 1.0, 5.0, 0.0), Cascade(0.1, math.inf, 5.0, 0.0)]
)
def test_what_holds_no_position_has_no_pid(cascade: Cascade) -> None:
    with pytest.raises(UsageError):
        to_pid(cascade)


def test_without_integral_the_cascade_is_a_pd_controller() -> None:
    pid = to_pid(Cascade(0.1, 0.0, 5.0, 0.002), PERIOD)
    assert (pid.kp_nm_rad, pid.ki_nm_rad_s, pid.kd_nm_s_rad) == pytest.approx((0.5, 0.0, 0.1))
    back = to_cascades(pid, PERIOD)
    assert (back.slow.ki_nm_rad, back.slow.kpp_1_s, back.fast) == (0.0, pytest.approx(5.0), None)


def call(*words: str) -> tuple[int, str, str]:
    outcome = CliRunner().invoke(cli, ["convert", *words])
    return outcome.exit_code, outcome.stdout, outcome.stderr


def test_the_command_converts_there_and_back() -> None:
    code, out, _ = call("--kp", "0.12", "--ki", "1.39", "--kpp", "6.29", "--velocity-filter", "2ms", "--period", "1 ms", "--json")
    assert code == 0
    pid = json.loads(out)["pid"]
    assert pid["kd_nm_s_rad"] == pytest.approx(0.12 - 1.39 * 0.003)
    numbers = [repr(pid[name]) for name in ("kp_nm_rad", "ki_nm_rad_s", "kd_nm_s_rad")]
    code, out, _ = call("--pid", *numbers, "--velocity-filter", "2ms", "--period", "1ms", "--json")
    assert code == 0
    slow = json.loads(out)["slow"]
    assert (slow["kp_nm_s_rad"], slow["ki_nm_rad"], slow["kpp_1_s"]) == pytest.approx((0.12, 1.39, 6.29), rel=1e-9)
    assert slow["velocity_feedforward"] == pytest.approx(1.0)
    code, out, _ = call("--pid", *numbers)
    assert code == 0
    assert "take this one" in out
    assert "appendix B (B.3)" in out


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        ((), 2, "give what is to be converted"),
        (("--kp", "1"), 2, "--ki, --kpp is missing"),
        (("--pid", "1", "1", "1", "--kp", "1", "--ki", "1", "--kpp", "1"), 2, "give what is to be converted"),
        (("--kp", "1", "--ki", "1", "--kpp", "1", "--weight", "1"), 2, "--weight is for --pid"),
        (("nowhere", "--period", "1ms"), 2, "--period is for gains"),
        (("--pid", "1", "8", "0.12"), 1, "raise P to"),
        (("nowhere",), 3, "nowhere"),
    ],
)
def test_the_command_refuses_what_it_cannot_convert(words: tuple[str, ...], code: int, says: str) -> None:
    ended, _, err = call(*words)
    assert (ended, says in err) == (code, True), err


def test_the_design_of_a_run_is_converted_in_its_drives_form(tmp_path: Path) -> None:
    from beltcomm.axis import load_axis
    from beltcomm.drive.parameters import cascade_to_parameters
    from beltcomm.runfolder import RunFolder

    folder = RunFolder.create(tmp_path / "run", load_axis("egc-70-600"))
    with pytest.raises(DataError):
        api.convert(folder.path)
    design = {
        "parameters": cascade_to_parameters(TABLE_A7),
        "dead_time_s": 1e-3,
        "specification": {"phase_margin_deg": 45.0},
        "margins": [],
    }
    folder.save("designs", "final", {**design, "structure": {"name": "x", "period_s": PERIOD, "prefilters": []}})
    result = api.convert(folder.path)
    assert result.to_json()["pid"]["kd_nm_s_rad"] == pytest.approx(0.12 - 1.39 * 0.003)
    assert any("stays: butterworth prefilter" in line for line in result.lines())
    folder.save("designs", "final", design)
    with pytest.raises(DataError, match="damaged"):
        api.convert(folder.path)
