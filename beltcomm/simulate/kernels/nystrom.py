"""Writes the kernel of Nyström's method: steps of high order while no body changes between sticking and sliding, the composer's steps else.

Numerics.  Between two such changes all forces are functions of place, speed and time, so Nyström's method takes steps five times as
long as the Verlet steps of ``compose`` and a tenth of their error.  Set-valued friction has the sign of each body's speed at the start of
the step; a resting body is held.  Elastic friction (``friction_onset``) follows from the way since then, so its short length does not bound
the step.  Every stage checks that each body still goes its way, and that what holds a resting one suffices; else the step is taken anew by
Verlet steps, which place the change (``stick_or_slide``).

Both go through one text of the laws: a second one would take twice as long to compile.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre

from beltcomm.arrays import Array
from beltcomm.effects import Effect
from beltcomm.model import Model
from beltcomm.simulate.kernels import fast_math
from beltcomm.simulate.kernels.compose import import_stable
from beltcomm.simulate.kernels.pieces import stick_or_slide
from beltcomm.simulate.kernels.switch_groups import indent
from beltcomm.simulate.kernels.writer import Writer, fingerprint

#: Nyström's method of four stages: of order 5 for forces by place and time (Hairer, Nørsett, Wanner, Solving ODEs I, table II.14.2); the
#: speeds within a step, which its author leaves open, by  Σ b_i a_ij c_j = 1/6,  Σ b_i c_i a_ij c_j = 1/8,  Σ b_i a_ij c_j² = 1/12:  of
#: order 4 for forces by speed.
NODES = np.array([0.0, 1 / 5, 2 / 3, 1.0])
PLACES = np.array([[0.0, 0.0, 0.0], [1 / 50, 0.0, 0.0], [-1 / 27, 7 / 27, 0.0], [3 / 10, -2 / 35, 9 / 35]])
SPEEDS = np.array([[0.0, 0.0, 0.0], [1 / 5, 0.0, 0.0], [-17 / 27, 35 / 27, 0.0], [13 / 5, -22 / 7, 54 / 35]])
PLACE_END = np.array([14, 100, 54, 0]) / 336
SPEED_END = np.array([14, 125, 162, 35]) / 336
STAGES = len(NODES)
#: Largest (step x fastest eigenvalue): a mode of that rate swings up where its damping ratio is below 2.5e-4, at half of it nowhere.
LONGEST_STEP = 1.0
#: Verlet steps that one step replaces.
STRIDE = 5
#: Parts of a step in which a torque that acts late is known, by its mean; with 5 a jump inside a step costs 2e-4 of the peak.
CELLS = 10


def torque_at_stages(cells: Array, parts: int) -> Array:
    """Torque at the stages of each step from its means over equal parts of it; (samples, steps parts) -> (samples, steps stages), N m.

    The cubic whose means over the parts are nearest in the squares; a torque that keeps its value is that value.

    Parameters
    ----------
    cells : ndarray (samples, steps parts), N m
        Means.
    parts : int
        Of a step.
    """
    return np.asarray(cells.reshape(-1, parts) @ _at_stages(parts)).reshape(len(cells), -1)


@lru_cache(maxsize=2)
def _at_stages(cells: int) -> Array:
    """Torque at the stages over means of the parts, (cells, stages)."""
    edges, powers = np.linspace(-1.0, 1.0, cells + 1), np.eye(min(4, cells))
    means = np.array([0.5 * cells * np.diff(legendre.legval(edges, legendre.legint(power))) for power in powers])
    return np.ascontiguousarray((legendre.legval(2.0 * NODES - 1.0, powers.T).T @ np.linalg.pinv(means.T)).T)


def nystrom_kernel(model: Model) -> Callable[..., None]:
    """The kernel of a model's combination of effects; compiled once per machine.

    nystrom(q, v, p, cells, acting, t, sample, n, m, theta, omega, cart, belt): a whole record, as ``Kernel.run``, with n steps in a
    sample or m Verlet steps in place of each.   cells : (samples, n parts), N m.   acting : of them at the stages, (samples, n stages).

    Parameters
    ----------
    model : Model
        With any effects.
    """
    return _kernel(model.base_bodies, model.effects)


@lru_cache(maxsize=64)
def _kernel(base_bodies: tuple[str, ...], effects: tuple[str, ...]) -> Callable[..., None]:
    nystrom: Callable[..., None] = import_stable(_nystrom_source(base_bodies, effects)).nystrom
    return nystrom


def _nystrom_source(base_bodies: tuple[str, ...], effects: tuple[str, ...]) -> str:
    """Python source of the kernel of one combination."""
    writer = Writer(base_bodies, effects)
    everyone, count = range(len(writer.bodies)), len(writer.bodies)
    elastic = writer.onsets()
    rubbing = [i for i in everyone if writer.has_level(i)]
    onset = [(place, i) for place, i in enumerate(elastic, start=count)]
    swinging = _Waves(writer)
    body = [*_evaluated(writer, swinging), "if left == 0:", *indent(_stage(writer), 1), "else:", *indent(_verlet(writer), 1)]
    taken = [
        *[f"z{i} = {_turned(writer, i)}" for i in elastic],
        f"for i in range({2 * count}): state[i] = now[i]",
        "peak = max(peak, high)",
        "break",
    ]  # fmt: skip
    step = [
        *[f"d{i} = 1.0 if state[{count + i}] > 0.0 else -1.0 if state[{count + i}] < 0.0 else 0.0" for i in rubbing],
        "stage, left, again, good, high = 0, 0, False, True, 0.0",
        "while True:",
        *indent([
            "if left == 0:",
            "    t, torque = clock + NODES[stage] * h, acting[k, j * STAGES + stage]",
            *indent(_state(count, "stage", "NODES[stage] * h", "PLACES[stage, r]", "SPEEDS[stage, r]"), 1),
            "else:",
            "    t, torque = clock + (m - left) * short, cells[k, j * parts + ((2 * (m - left) + 1) * parts) // (2 * m)]",
            f"    for i in range({count}): now[{count} + i] = 0.5 * (state[{count} + i] + new[i])",
            *body,
        ], 1),
        *indent([
            "if left == 0:",
            *indent([
                "stage += 1",
                "if good and stage < STAGES: continue",
                *_state(count, "STAGES", "h", "PLACE_END[r]", "SPEED_END[r]"),
                *[f"good = good and (now[{count + i}] * d{i} > 0.0 or d{i} == 0.0)" for i in rubbing],
                "if good:", *indent(taken, 1),
                "left = m",
            ], 1),
            "else:",
            *indent([
                "again = not again",
                "if again: continue",
                f"for i in range({count}):", f"    state[{count} + i] = new[i]", "    state[i] = now[i] + 0.5 * short * new[i]",
                *[f"v{i} = new[{i}]" for i in elastic],
                *[writer.turn(i, f"short * {writer.coordinate(i, 'v', False)}") for i in elastic],
                "peak = max(peak, abs(strand))",
                "left -= 1",
                "if left == 0: break",
            ], 1),
            f"for i in range({count}):", f"    new[i] = state[{count} + i]", "    now[i] = state[i] + 0.5 * short * new[i]",
        ], 1),
        "clock += h",
    ]  # fmt: skip
    cart = f"{'ratio * ' if writer.bodies[writer.cart][1].rotary else ''}state[{writer.cart}]"
    loop = [
        "for k in range(cells.shape[0]):",
        f"    theta[k], omega[k], cart[k], peak = state[0], state[{count}], {cart}, 0.0",
        "    for j in range(n):",
        *indent(step, 2),
        "    belt[k] = peak",
    ]  # fmt: skip
    lines = [
        *writer.constants(),
        *[f"n{i} = 1.0 / m{i}" for i in everyone],
        *swinging.prepared(),
        *[f"z{i} = q[{place}]" for place, i in onset],
        # Made here: the compiler knows that nothing else stands at their place.
        f"state, now, new = np.empty({2 * count}), np.empty({2 * count}), np.empty({count})",
        f"rise = np.zeros((STAGES, {count}))",
        f"for i in range({count}): state[i], state[{count} + i] = q[i], v[i]",
        "h, short, parts, clock = sample / n, sample / (n * m), cells.shape[1] // n, t",
        *loop,
        f"for i in range({count}): q[i], v[i] = state[i], state[{count} + i]",
        *[f"q[{place}] = z{i}" for place, i in onset],
    ]  # fmt: skip
    return _module(writer, _read_first(lines))


def _state(count: int, stages: str, way: str, places: str, speeds: str) -> list[str]:
    """``now``: places and speeds after a part of the step."""
    return [
        f"c = {way}",
        f"for i in range({count}): now[i] = state[i] + c * state[{count} + i]",
        f"for i in range({count}): now[{count} + i] = state[{count} + i]",
        f"for r in range({stages}):",
        f"    c, e = h * h * {places}, h * {speeds}",
        f"    for i in range({count}): now[i] += c * rise[r, i]",
        f"    for i in range({count}): now[{count} + i] += e * rise[r, i]",
    ]


def _evaluated(writer: Writer, swinging: _Waves) -> list[str]:
    """f_i, l_i, strand and push from places and speeds ``now``."""
    everyone = range(len(writer.bodies))
    lines = [f"q{i}, w{i} = now[{i}], now[{len(writer.bodies) + i}]" for i in everyone]
    lines.append("push = torque")
    for effect in writer.effects_of_slot("torque_path"):
        assert effect.law is not None
        lines.append(swinging.gain(effect) or f"push = {writer.law(effect.law)}(push, q0, t{writer.arguments(effect)})")
    given, writer.effects = writer.effects, [e for e in writer.effects if e not in swinging.loads]
    lines += [*writer.forces("w"), *swinging.added()]
    writer.effects = given
    return [*lines, "f0 += push", *writer.levels("w", everyone)]


def _stage(writer: Writer) -> list[str]:
    """Accelerations of a stage, and whether all bodies go on as they did."""
    lines, elastic = ["high = max(high, abs(strand))"], writer.onsets()
    for i in range(len(writer.bodies)):
        if not writer.has_level(i):
            lines.append(f"rise[stage, {i}] = f{i} * n{i}")
        elif i in elastic:
            lines += [f"rise[stage, {i}] = (f{i} - l{i} * {_turned(writer, i)}) * n{i}", f"good = good and w{i} * d{i} > 0.0"]
        else:
            lines += [
                f"rise[stage, {i}] = (f{i} - l{i} * d{i}) * n{i} if d{i} != 0.0 else 0.0",
                f"good = good and (w{i} * d{i} > 0.0 if d{i} != 0.0 else abs(f{i}) <= l{i})",
            ]
    return lines


def _turned(writer: Writer, i: int) -> str:
    """Share of elastic friction of body i after the way of a stage."""
    effect = writer.onsets()[i]
    assert effect.law is not None
    lever = "ratio * " if writer.bodies[i][1].rotary else ""
    return f"{writer.law(effect.law)}({lever}(now[{i}] - state[{i}]), z{i}{writer.arguments(effect)})"


def _verlet(writer: Writer) -> list[str]:
    """New speeds of a pass, as ``Writer.kick``."""
    lines, elastic, count = [], writer.onsets(), len(writer.bodies)
    for i in range(count):
        if writer.has_level(i) and i not in elastic:
            lines.append(f"new[{i}] = {writer.law(stick_or_slide)}(state[{count + i}], f{i} * n{i}, l{i} * n{i}, short)")
        else:
            grip = f" - l{i} * z{i}" if writer.has_level(i) else ""
            lines.append(f"new[{i}] = state[{count + i}] + short * (f{i}{grip}) * n{i}")
    return lines


class _Waves:
    """Effects that are a sine and a cosine of the motor angle (``Effect.harmonic``): one sine for each, those of the load side by side.

    s sin + c cos = hypot(s, c) sin(· + atan2(c, s))
    """

    def __init__(self, writer: Writer) -> None:
        first = writer.bodies[0][1].name
        self.loads = [e for e in writer.effects if e.harmonic == "load" and e.slot == "force" and e.body == first]
        self.gains = [e for e in writer.effects if e.harmonic == "gain" and e.slot == "torque_path"]
        self.place = writer.place

    def _wave(self, effect: Effect) -> str:
        """Order, size and phase."""
        order, sine, cosine = (f"p[{self.place[name]}]" for name in effect.full_names())
        return f"{order}, math.hypot({sine}, {cosine}), math.atan2({cosine}, {sine})"

    def prepared(self) -> list[str]:
        """Lines that compute order, size and phase of each; those of the load filled up to whole registers."""
        length = -4 * (-len(self.loads) // 4)
        lines = [f"orders, sizes, phases = np.zeros({length}), np.zeros({length}), np.zeros({length})"] if self.loads else []
        lines += [f"orders[{k}], sizes[{k}], phases[{k}] = {self._wave(effect)}" for k, effect in enumerate(self.loads)]
        return lines + [f"order{k}, size{k}, phase{k} = {self._wave(effect)}" for k, effect in enumerate(self.gains)]

    def added(self) -> list[str]:
        """Line that adds them to the load."""
        return ["f0 -= waves(q0, orders, sizes, phases)"] if self.loads else []

    def gain(self, effect: Effect) -> str:
        """Line that changes the torque; empty for an effect that is none of them."""
        if effect not in self.gains:
            return ""
        k = self.gains.index(effect)
        return f"push *= 1.0 + size{k} * sin(order{k} * q0 + phase{k})"


def _read_first(lines: list[str]) -> list[str]:
    """Parameters as local names: the compiler cannot know that writing the results leaves them alone, and would compute all anew."""
    text = "\n".join(lines)
    used = sorted({int(place) for place in re.findall(r"\bp\[(\d+)\]", text)})
    return [*(f"p{place} = p[{place}]" for place in used), *re.sub(r"\bp\[(\d+)\]", r"p\1", text).split("\n")]


def _module(writer: Writer, lines: list[str]) -> str:
    laws = sorted(writer.laws.items())
    tables = "NODES, PLACES, PLACE_END, SPEEDS, SPEED_END, STAGES"
    head = [
        "import math", "", "import numpy as np", "", "from beltcomm.compiled import in_lanes",
        "from beltcomm.simulate.kernels.fast_math import fast, sin, waves",
        f"from beltcomm.simulate.kernels.nystrom import {tables}",
        *[f"from {law.__module__} import {law.__name__} as _{name}" for name, law in laws],
        "", *[f"{name} = fast(_{name})" for name, _ in laws], "", "",
        "@in_lanes",
        "def nystrom(q, v, p, cells, acting, t, sample, n, m, theta, omega, cart, belt):",
    ]  # fmt: skip
    return "\n".join([*head, *indent(lines, 1)]) + f"\n# {fingerprint(writer.laws.values(), (fast_math.__name__, __name__))}\n"
