"""Seconds simulated per second on one core, at equal accuracy, against general solvers on the same plants.

Plants: the rig g_b, once without set-valued friction (linear), once with, kept sliding (between stick events), and with every effect of
the catalogue that goes together.  Torque is held for 1 ms, 5 to 150 Hz on a mean that balances the friction at 1 m/s.

Error: the largest of motor speed and belt stretch over all samples, each in parts of its own largest deviation from its mean, against
DOP853 with relative tolerance 1e-12, started anew at each step of the torque.  Each solver runs with several steps or tolerances; the
cheapest that keeps 1e-4 counts.  The times at which a coasting axis first sticks are compared apart.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from beltcomm.compiled import compiled
from beltcomm.control import Cascade
from beltcomm.model import Model, load_plant
from beltcomm.simulate.forward import BodyStates, Simulated, at_rest, integrate_torque, simulate_torque
from beltcomm.simulate.loop import LoopDrive, close_loop
from beltcomm.simulate.plant import SimulatedPlant
from benchmarks.speeds import all_effects
from benchmarks.speeds.compared import ACCURACY, LONGER, PERIOD_S, SAMPLES, SPEED_M_S, error
from benchmarks.speeds.measure import Figure, in_turn, ratio, spread

Array = NDArray[np.float64]
SUBSTEPS = (5, 10, 20, 40, 80, 160, 320)
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)


@dataclass(frozen=True)
class Case:
    """A model, the torque on it and where it starts, absolute; p : inertia, mass, ratio, stiffness, damping, viscous, levels."""

    model: Model
    torque_nm: Array
    start: BodyStates
    p: Array


def case(frictionless: bool) -> Case:
    """The rig at 1 m/s under a multisine about the torque that keeps it there."""
    model = load_plant("g_b").model
    if frictionless:
        for name in ("coulomb", "cart_friction"):
            model = model.without_effect(name)
    ratio_m = model["transmission.ratio"]
    speed = SPEED_M_S / ratio_m
    mean = model.get("coulomb.level") + ratio_m * model.get("cart_friction.level") + model["viscous.damping"] * speed
    t = PERIOD_S * np.arange(SAMPLES)
    rng = np.random.default_rng(7)
    tones = sum(np.cos(2.0 * np.pi * f * t + rng.uniform(0.0, 2.0 * np.pi)) for f in range(5, 151, 5))
    at = at_rest(model, 0.25).positions
    p = np.array(
        [model[n] for n in ("motor.inertia", "cart.mass", "transmission.ratio", "belt_stiffness.stiffness", "belt_damping.damping")]
        + [model["viscous.damping"], model.get("coulomb.level"), model.get("cart_friction.level")]
    )
    return Case(model, np.asarray(mean + 0.08 * tones), BodyStates(at, np.array([speed, SPEED_M_S])), p)


@compiled
def slope(x: Array, torque: float, p: Array, out: Array) -> None:
    """x' of the two masses while both slide forwards; x : motor angle, carriage, and their speeds."""
    force = p[3] * (p[2] * x[0] - x[1]) + p[4] * (p[2] * x[2] - x[3])
    out[0], out[1] = x[2], x[3]
    out[2] = (torque - p[5] * x[2] - p[6] - p[2] * force) / p[0]
    out[3] = (force - p[7]) / p[1]


def start_of(c: Case) -> Array:
    """The state as one row."""
    return np.concatenate([c.start.positions, c.start.speeds])


def reference(c: Case) -> Array:
    """(samples, 2): motor speed, rad/s, and belt stretch, m; see the head of this module."""
    x, out, rows = start_of(c), np.empty(4), []
    for torque in c.torque_nm:
        rows.append(x)

        def f(t: float, x: Array, torque: float = torque) -> Array:
            slope(x, torque, c.p, out)
            return out.copy()

        x = solve_ivp(f, (0.0, PERIOD_S), x, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    return seen(np.array(rows), c)


def seen(rows: Array, c: Case) -> Array:
    """What is compared, from rows of states."""
    return np.column_stack([rows[:, 2], c.p[2] * rows[:, 0] - rows[:, 1]])


# -- solvers: each a function of its step or tolerance that returns what is compared ---------------------------------------------


def ours(c: Case, _: float) -> Array:
    """``simulate_torque``, which solves these plants exactly: it has no setting."""
    return _seen_of(simulate_torque(c.model, c.torque_nm, PERIOD_S, 0.25, state=c.start), c)


def steps(c: Case, substeps: int) -> Array:
    """``integrate_torque``: the steps that every other model of ours takes."""
    return _seen_of(integrate_torque(c.model, c.torque_nm, PERIOD_S, 0.25, substeps, state=c.start), c)


def _seen_of(found: Simulated, c: Case) -> Array:
    return np.column_stack([found.velocity_rad_s, c.p[2] * found.position_rad - found.cart_position_m])


def general(method: str, c: Case, tolerance: float) -> Array:
    """``scipy.integrate.solve_ivp`` in one call, the right-hand side compiled."""
    times, out = PERIOD_S * np.arange(SAMPLES), np.empty(4)
    torque = c.torque_nm

    def f(t: float, x: Array) -> Array:
        slope(x, torque[min(int(t / PERIOD_S + 1e-9), SAMPLES - 1)], c.p, out)
        return out.copy()

    scale = np.array([1.0, c.p[2], 100.0, 100.0 * c.p[2]])
    found = solve_ivp(
        f, (0.0, times[-1]), start_of(c), method=method, t_eval=times, rtol=tolerance, atol=1e-3 * tolerance * scale, max_step=PERIOD_S
    )
    return seen(found.y.T, c) if found.y.shape[1] == SAMPLES else np.full((SAMPLES, 2), np.inf)


def held(method: str, c: Case, tolerance: float) -> Array:
    """The same, started anew at each step of the torque, so that no step goes across one."""
    x, out, rows = start_of(c), np.empty(4), np.empty((SAMPLES, 4))
    scale = np.array([1.0, c.p[2], 100.0, 100.0 * c.p[2]])
    for k, torque in enumerate(c.torque_nm):
        rows[k] = x

        def f(t: float, x: Array, torque: float = torque) -> Array:
            slope(x, torque, c.p, out)
            return out.copy()

        x = solve_ivp(f, (0.0, PERIOD_S), x, method=method, rtol=tolerance, atol=1e-3 * tolerance * scale, first_step=1e-4).y[:, -1]
    return seen(rows, c)


def exact(c: Case, _: float) -> Array:
    """python-control: exact discretisation and ``forced_response``; linear plants only."""
    import control

    J, m, i, k, d, b = c.p[:6]
    A = np.array(
        [[0, 0, 1, 0], [0, 0, 0, 1], [-i * i * k / J, i * k / J, -(i * i * d + b) / J, i * d / J], [i * k / m, -k / m, i * d / m, -d / m]]
    )
    system = control.c2d(control.ss(A, [[0], [0], [1 / J], [0]], np.eye(4), np.zeros((4, 1))), PERIOD_S, "zoh")
    found = control.forced_response(system, PERIOD_S * np.arange(SAMPLES), c.torque_nm, start_of(c))
    return seen(np.asarray(found.outputs).T, c)


@functools.lru_cache(maxsize=4)
def _bodies(J: float, m: float, i: float, k: float, d: float, b: float, grip: float, cart_grip: float, integrator: str) -> Any:
    import mujoco

    text = f"""<mujoco><option integrator="{integrator}" gravity="0 0 0"><flag contact="disable"/></option><worldbody>
      <body><joint name="motor" type="hinge" axis="1 0 0" armature="{J:.17g}" damping="{b:.17g}"
          frictionloss="{grip:.17g}" solreffriction="1e-4 1"/>
        <inertial pos="0 0 0" mass="1e-9" diaginertia="1e-14 1e-14 1e-14"/></body>
      <body><joint name="cart" type="slide" axis="1 0 0" frictionloss="{cart_grip:.17g}" solreffriction="1e-4 1"/>
        <inertial pos="0 0 0" mass="{m:.17g}" diaginertia="1 1 1"/></body></worldbody>
      <tendon><fixed name="belt" stiffness="{k:.17g}" damping="{d:.17g}" springlength="0">
        <joint joint="motor" coef="{i:.17g}"/><joint joint="cart" coef="-1"/></fixed></tendon>
      <actuator><motor joint="motor"/></actuator></mujoco>"""
    return mujoco.MjModel.from_xml_string(text)


def bodies(integrator: str, c: Case, substeps: int) -> Array:
    """MuJoCo: a hinge and a slide, joined by a tendon with stiffness and damping; by its own ``rollout``.

    Friction is its ``frictionloss``, as stiff as it lets it be.
    """
    import mujoco
    from mujoco import rollout

    model = _bodies(*c.p.tolist(), integrator)
    model.opt.timestep = PERIOD_S / substeps
    start = np.concatenate([[0.0], start_of(c)])
    control = np.repeat(c.torque_nm, substeps)[None, :, None]
    states, _ = rollout.rollout(model, mujoco.MjData(model), start, control)
    rows = np.vstack([start, states[0][substeps - 1 :: substeps][:-1]])
    return seen(rows[:, 1:5], c)


Solver = tuple[str, Callable[[Case, float], Array], tuple[float, ...]]


def solvers(frictionless: bool) -> list[Solver]:
    """Name, function and its settings, ours first; those that are not installed are left out."""
    found: list[Solver] = [("beltcomm", ours, (0.0,)), ("beltcomm by steps", steps, SUBSTEPS)]  # type: ignore[list-item]
    for method in ("RK45", "LSODA", "DOP853"):
        found.append((f"scipy {method}", functools.partial(general, method), TOLERANCES))
    found.append(("scipy RK45, anew at each step of the torque", functools.partial(held, "RK45"), TOLERANCES[:4]))
    if frictionless and _there("control"):
        found.append(("python-control forced_response", exact, (0.0,)))
    if _there("mujoco"):
        for integrator in ("RK4", "implicitfast"):
            found.append((f"MuJoCo {integrator}", functools.partial(bodies, integrator), SUBSTEPS))  # type: ignore[arg-type]
    return found


def _there(name: str) -> bool:
    from importlib.util import find_spec

    return find_spec(name) is not None


# -- figures -----------------------------------------------------------------------------------------------------------------------


def equal_accuracy(title: str, frictionless: bool, rounds: int, aim: float | None) -> Iterator[Figure]:
    """Every solver at its cheapest setting that keeps the accuracy, and how many times as fast ours is."""
    c = case(frictionless)
    true = reference(c)
    long = replace(c, torque_nm=np.tile(c.torque_nm, LONGER))
    chosen: list[tuple[str, Callable[[], object]]] = []
    for name, solve, settings in solvers(frictionless):
        tried = []
        for setting in settings:
            tried.append(error(solve(c, setting), true))
            if tried[-1] <= ACCURACY:  # finer ones cost more
                break
        best = len(tried) - 1 if tried[-1] <= ACCURACY else None
        if best is None:
            yield Figure("simulation", f"{title}: {name}", float("nan"), "x real time", note=f"never below an error of {min(tried):.1e}")
            continue
        record = long if name.startswith("beltcomm") else c
        chosen.append((f"{name}|{settings[best]:g}|{tried[best]:.1e}", functools.partial(solve, record, settings[best])))
    taken = in_turn([action for _, action in chosen], rounds)
    for (label, _), values in zip(chosen, taken, strict=True):
        name, setting, wrong = label.split("|")
        s = spread([PERIOD_S * SAMPLES * (LONGER if name.startswith("beltcomm") else 1) / v for v in values])
        wanted = aim if name == "beltcomm" else None
        yield Figure(
            "simulation", f"{title}: {name}", s.median, "x real time", wanted, True, s.low, s.high, f"setting {setting}, error {wrong}"
        )
    if chosen[0][0].startswith("beltcomm|") and len(taken) > 2:
        rivals = [i for i in range(2, len(chosen)) if chosen[i][0].startswith(("scipy", "MuJoCo"))]
        best_rival = min(rivals, key=lambda i: spread(taken[i]).median)
        s = ratio([LONGER * v for v in taken[best_rival]], taken[0])
        name = chosen[best_rival][0].split("|")[0]
        yield Figure("simulation", f"{title}: times the best general solver", s.median, "x", 500.0, True, s.low, s.high, name)


def loops(rounds: int) -> Iterator[Figure]:
    """Stepping from Python as the virtual drive does, and a cascade closed on the plant in compiled code."""
    model = load_plant("g_b").model
    plant = SimulatedPlant(model, 0.25)
    n = 10 * SAMPLES
    t = PERIOD_S * np.arange(n)
    path = 4.0 * (1.0 - np.cos(2.0 * np.pi * t))
    rate = np.gradient(path, PERIOD_S)

    def stepped() -> None:
        for k in range(n):
            plant.step(0.3 if k // 20 % 2 == 0 else -0.3, PERIOD_S)

    drive = LoopDrive(PERIOD_S, 1e-3, 4.0, 65536)
    cascade = Cascade(kp_nm_s_rad=0.03, ki_nm_rad=0.2, kpp_1_s=15.0, velocity_filter_s=1e-3)

    def closed() -> None:
        close_loop(SimulatedPlant(model, 0.25), cascade, drive, "position", path, rate, np.zeros(n))

    for name, values in zip(("plant stepped from Python", "closed loop"), in_turn([stepped, closed], rounds), strict=True):
        s = spread([PERIOD_S * n / v for v in values])
        yield Figure(
            "simulation", f"two masses with friction: {name}", s.median, "x real time", None, True, s.low, s.high, "20 steps per ms"
        )


def _batch(runs: int) -> float:
    c = case(False)
    long = replace(c, torque_nm=np.tile(c.torque_nm, LONGER))
    for _ in range(runs):
        ours(long, 0.0)
    return 0.0


def batched(rounds: int) -> Iterator[Figure]:
    """Runs per second of as many processes as there are cores, over those of one."""
    cores, runs = os.cpu_count() or 1, 200
    with ProcessPoolExecutor(cores) as pool:
        list(pool.map(_batch, [1] * cores))
        found = []
        for _ in range(rounds):
            begin = perf_counter()
            list(pool.map(_batch, [runs]))
            alone = perf_counter() - begin
            begin = perf_counter()
            list(pool.map(_batch, [runs] * cores))
            found.append(cores * alone / (perf_counter() - begin))
    s = spread(found)
    yield Figure(
        "simulation", f"batched on {cores} cores", s.median, "x one core", None, True, s.low, s.high, "others took part of the cores"
    )


def events() -> Iterator[Figure]:
    """When a coasting axis first sticks, against DOP853 with its event location."""
    c = case(False)
    out = np.empty(4)

    def f(t: float, x: Array) -> Array:
        slope(x, 0.0, c.p, out)
        return out.copy()

    def stops(t: float, x: Array) -> float:
        return min(float(x[2]) * c.p[2], float(x[3]))

    stops.terminal = True  # type: ignore[attr-defined]
    true = solve_ivp(f, (0.0, 2.0), start_of(c), method="DOP853", rtol=1e-12, atol=1e-14, events=stops).t_events[0][0]
    for name, simulate in (("exact", simulate_torque), ("20 steps per ms", integrate_torque)):

        def slowest(t: float, simulate: Any = simulate) -> float:
            whole = int(t / PERIOD_S)
            end = simulate(c.model, np.zeros(whole), PERIOD_S, 0.25, state=c.start).end
            end = simulate(c.model, np.zeros(1), t - whole * PERIOD_S, 0.25, state=end).end
            return float(np.min(end.speeds * [c.p[2], 1.0]))

        before, after = true - 1e-4, true + 1e-4
        for _ in range(40):
            middle = 0.5 * (before + after)
            before, after = (middle, after) if slowest(middle) > 0.0 else (before, middle)
        yield Figure("simulation", f"time of the first sticking, {name}", 1e6 * abs(before - true), "us off", note=f"at {true:.4f} s")


def run(rounds: int) -> Iterator[Figure]:
    """All figures of the topic."""
    yield from equal_accuracy("linear", True, rounds, None)
    yield from equal_accuracy("two masses with friction, sliding", False, rounds, 3000.0)
    yield from all_effects.figures(rounds)
    yield from loops(rounds)
    yield from events()
    yield from batched(min(rounds, 5))
