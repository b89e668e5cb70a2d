"""Motion of the hidden machines: energy, rest, closed forms, step size."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from truth.hidden import draw, kernel, laws, recorder
from truth.hidden import layout as at
from truth.hidden.catalogue import EFFECTS
from truth.hidden.energy import Energy
from truth.hidden.layout import Array
from truth.hidden.machines import PEAK_TORQUE_NM, Machine
from truth.hidden.outside import OUTSIDE
from truth.hidden.plant import HiddenPlant
from truth.hidden.session import Session, Task, amplitudes
from truth.hidden.signals import multisine
from truth.hidden.visibility import PER_SAMPLE, spectra_of, unexplained

NO_BURSTS = np.zeros((0, 3))
#: Effects that bring energy from outside the mechanics, or act on the torque only.
ACTIVE = {"cogging", "tooth_ripple", "supply_ripple", "load_bursts", "friction_drift"}
PASSIVE = ["", *(name for name in (*EFFECTS, *OUTSIDE) if name not in ACTIVE)]


def one(name: str, seed: int = 3, strength: float = 1.0, family: str = "sheet") -> Machine:
    return draw(seed, (name,) if name else (), strength, family)


def moving(machine: Machine, place: float = 0.5, speed: float = 0.0, stretch: float = 0.0) -> Array:
    """A state: carriage at a place, everything at one speed, belt stretched."""
    s = np.zeros(at.STATES)
    angle = place / machine.base.radius_m
    u, lever = laws.pulley(angle, machine.p)
    s[at.ANGLE], s[at.SPEED] = angle, speed / lever
    s[[at.CART, at.PAYLOAD]] = u - stretch
    s[at.IDLER] = u - 0.5 * stretch
    s[[at.CART_SPEED, at.IDLER_SPEED, at.PAYLOAD_SPEED]] = speed
    return s


#: Pairs that meet in one law, where a slip would be a mistake of the whole.
PAIRS = ["end_pulley+backlash", "stiffness_position+backlash", "backlash+belt_slack", "presliding+cart_friction", "stribeck+tilt"]


@pytest.mark.parametrize("name", [*PASSIVE, *PAIRS])
def test_a_machine_left_alone_only_loses_energy(name: str) -> None:
    machine = draw(3, tuple(name.split("+")) if name else ())
    energy, s = Energy(machine), moving(machine, speed=0.3, stretch=2e-4)
    levels = [energy(s)]
    for _ in range(600):
        kernel.advance(s, machine.p, NO_BURSTS, 0.0, 0.0, 0.2e-3, 40e-6)
        levels.append(energy(s))
    scale = 0.5 * machine.base.mass_kg * 0.3**2
    assert np.diff(levels).max() < 2e-6 * scale
    assert levels[0] - levels[-1] > 0.2 * scale


@pytest.mark.parametrize("name", [n for n in PASSIVE if n not in {"tilt", "cable_chain", "cable_hysteresis"}])
def test_at_rest_it_stays_at_rest(name: str) -> None:
    plant = HiddenPlant(one(name), 0.4)
    plant.step(0.0, 0.5)
    assert (plant.position_rad, plant.cart_position_m) == (0.0, 0.0)


def test_friction_holds_a_tilted_axis() -> None:
    machine = one("tilt")
    plant = HiddenPlant(machine, 0.4)
    plant.step(0.0, 3.0)
    held_at = plant.position_rad
    plant.step(0.0, 1.0)
    assert plant.position_rad == pytest.approx(held_at, abs=1e-9)
    assert 0.0 < abs(held_at) < 3.0 * machine.base.micro_slip_m / machine.base.radius_m
    weight = machine.hidden["tilt"]["offset_nm"] / machine.base.radius_m
    assert plant.belt_force_n == pytest.approx(weight, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "family"),
    [(n, "sheet") for n in ("", "end_pulley", "creeping_belt", "dead_time", "current_lag", "tilt")] + [("", "rig"), ("end_pulley", "rig")],
)
def test_multisine_obeys_the_closed_form(name: str, family: str) -> None:
    # The spectrum of the motion times the dynamic stiffness, plus the bristle along the path, is the torque: over all lines
    # the error adds up to less than a hundredth of what the noise of a real record does. The axis swings out at the end.
    machine = one(name, seed=7, family=family)
    session = Session(machine, fine=PER_SAMPLE)
    session.place(0.5 * machine.base.stroke_m)
    level = amplitudes(machine)
    signal = level.steps_nm[2] * np.tile(multisine(np.random.default_rng(1), level.weights)[0], 2)
    task = Task("frf", "frf", 0.5 * machine.base.stroke_m, excitation=np.concatenate((np.zeros(500), signal, np.zeros(2500))))
    spectra = spectra_of([session.record(task)], machine)
    p, s, torque = machine.p, 2j * math.pi * spectra.freq_hz, spectra.torque
    torque = torque * np.exp(-s * p[at.DEAD_TIME]) / ((1.0 + s * p[at.LAG]) * (1.0 + s * p[at.LAG_SECOND]))
    torque += spectra.constant * p[at.M] * p[at.GRAVITY] * p[at.LEVER]
    rest = unexplained(p, torque, spectra, 0.5 * machine.base.stroke_m)
    torque_over_noise = np.abs(spectra.torque * spectra.weight)
    assert rest @ rest < 0.01 * len(rest) < 1e-3 * (torque_over_noise @ torque_over_noise)


@pytest.mark.parametrize(("name", "at_speed"), [("", 0.0), ("stribeck", 1.0), ("coulomb_asymmetry", 0.0), ("quadratic_drag", 0.0)])
def test_torque_at_constant_speed_is_the_friction(name: str, at_speed: float) -> None:
    machine = one(name, seed=5)
    base, hidden = machine.base, machine.hidden.get(name, {})
    target = (at_speed * hidden.get("speed_m_s", 0.0) or 0.4) / base.radius_m
    plant, gain = HiddenPlant(machine, 0.1), 0.02
    torques, speeds, integral = [], [], 0.0
    for _ in range(1500):
        error = target - plant.velocity_rad_s
        integral += gain * 20.0 * error * 1e-3
        torques.append(gain * error + integral)
        speeds.append(plant.velocity_rad_s)
        plant.step(torques[-1], 1e-3)
    speed = float(np.mean(speeds[-300:])) * base.radius_m
    assert speed == pytest.approx(target * base.radius_m, rel=0.01)
    expected = base.coulomb_nm + (base.viscous_nm_s_rad / base.radius_m + base.drag_n_s_m * base.radius_m) * speed
    if name == "stribeck":
        expected += hidden["rise_nm"] * {"exp": math.exp(-1.0), "rational": 0.5, "sech": 1.0 / math.cosh(1.0)}[hidden["shape"]]
    expected += hidden.get("offset_nm", 0.0)
    expected += hidden.get("drag_n_at_1_m_s", 0.0) * speed ** hidden.get("exponent", 1.0) * base.radius_m
    gaining = base.rigid_inertia_kg_m2 * (speeds[-1] - speeds[-300]) / 0.299
    assert float(np.mean(torques[-300:])) - gaining == pytest.approx(expected, rel=0.003)


def test_laws_have_the_values_they_promise() -> None:
    angles = np.linspace(0.0, 7.0, 50)
    run_out = one("pulley_eccentricity").p
    slopes = [(laws.pulley(a + 1e-5, run_out)[0] - laws.pulley(a - 1e-5, run_out)[0]) / 2e-5 for a in angles]
    assert slopes == pytest.approx([laws.pulley(a, run_out)[1] for a in angles], rel=1e-8)
    for seed in range(6):
        saturated = one("torque_saturation", seed)
        lost = 1.0 - laws.shaft_torque(PEAK_TORQUE_NM, 0.0, 0.0, saturated.p) / PEAK_TORQUE_NM
        assert lost == pytest.approx(saturated.hidden["torque_saturation"]["loss_at_peak"], rel=1e-6)
        spot = one("friction_position", seed)
        place, half = (spot.hidden["friction_position"][key] for key in ("place_m", "half_width_m"))
        assert laws.tight_spot(place, spot.p) == pytest.approx(spot.hidden["friction_position"]["rise_nm"])
        assert laws.tight_spot(place + half, spot.p) == 0.0
        warm = one("warmup", seed)
        assert laws.warm_factor(0.0, warm.p) == pytest.approx(1.0 + warm.hidden["warmup"]["rise"])
    loose = one("backlash")
    gap, k = loose.hidden["backlash"]["gap_m"], loose.base.stiffness_n_m
    assert laws.belt((gap, 0.0), (0.0, 0.0), (0.0, 0.0), loose.p)[0] == pytest.approx(0.5 * k * gap, rel=1e-3)
    assert abs(laws.belt((0.1 * gap, 0.0), (0.0, 0.0), (0.0, 0.0), loose.p)[0]) < 1e-4 * k * gap
    slack = one("belt_slack")
    far = [laws.belt((y, 0.0), (0.0, 0.0), (0.0, 0.0), slack.p)[0] for y in (3e-3, 3.001e-3, -3e-3, -3.001e-3)]
    assert (far[1] - far[0] + far[2] - far[3]) / 1e-6 == pytest.approx(slack.base.stiffness_n_m, rel=1e-3)


@pytest.mark.parametrize("corner", [laws.contact, laws.sagging])
def test_corners_lead_from_nothing_to_a_straight_line(corner: Callable[[float], tuple[float, float]]) -> None:
    x = np.linspace(-9.0, 9.0, 181)
    height, slope = np.array([corner(float(v)) for v in x]).T
    assert height[[0, 90, -1]] == pytest.approx([0.0, math.log(2.0), 9.0], abs=0.06)
    assert np.gradient(height, x)[1:-1] == pytest.approx(slope[1:-1], abs=0.01)


def test_lag_is_the_exact_response_of_two_lags() -> None:
    machine = one("current_lag")
    slow, fast = machine.p[at.LAG], machine.p[at.LAG_SECOND]
    t = 0.7e-3
    step = 1.0 - (slow * math.exp(-t / slow) - fast * math.exp(-t / fast)) / (slow - fast)
    assert kernel.lagged(1.0, t, np.zeros(at.STATES), machine.p)[1] == pytest.approx(step, rel=1e-12)


@pytest.mark.parametrize("name", ["", "stribeck", "backlash", "end_pulley", "presliding", "cart_friction", "iwan_belt"])
def test_halving_the_step_changes_far_less_than_a_count(name: str) -> None:
    machine = one(name, seed=11)
    t = np.arange(300) * 1e-3
    torque = 1.2 * np.sin(2.0 * math.pi * (4.0 + 150.0 * t) * t) + 0.6 * np.sin(2.0 * math.pi * 9.0 * t)

    def angles(substep: float) -> Array:
        plant = HiddenPlant(machine, 0.5, substep)
        rows = []
        for value in torque:
            plant.step(float(value), 1e-3)
            rows.append(plant.position_rad)
        return np.array(rows)

    assert np.abs(angles(40e-6) - angles(20e-6)).max() < 0.25 * machine.base.quantum_rad


def test_plant_and_recorder_are_the_same_machine() -> None:
    machine = draw(9, ("dead_time", "encoder_eccentricity", "current_lag"), 0.9)
    plant, session = HiddenPlant(machine, 0.5), Session(machine)
    session.state[:] = plant._state
    n = 400
    fine, still = np.zeros(n), np.column_stack((np.full(n, plant._state[at.ANGLE]), np.zeros(n)))
    drive, unsteady, forward = machine.instruments.vector(1.0), np.zeros((n, 3)), 1.5 * np.sin(np.arange(n) * 0.11)
    system = session.state, machine.p, NO_BURSTS, session._centring, session.memory, drive
    torque = recorder.run(*system, still, forward, unsteady, fine, np.zeros(n), 40e-6)[2]
    shown = []
    for value in torque:
        shown.append(plant.position_rad)
        plant.step(float(value), 1e-3)
    assert np.array(shown) == pytest.approx(fine - fine[0], abs=1e-6)
    assert np.ptp(fine) > 1.0
