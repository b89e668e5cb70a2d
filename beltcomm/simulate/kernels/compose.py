"""Composes the effects of a model into one compiled kernel (see docs/slots.md for the slots and the cost).

Numerics.  Positions and velocities are staggered (position Verlet):  q += h v/2;  v += h F(q, v̄)/m;  q += h v/2,  with v̄ the
mean of old and new velocity from one predictor pass, so smooth forces are integrated to second order.  Set-valued friction
is decided once per body and sub-step and solved exactly for the push of that step (``stick_or_slide``): it never chatters, holds
a resting body exactly and places a reversal inside the step.  Where friction turns round over a distance (presliding) its state
stands behind the positions in ``q``.

Forward kernels are compiled per combination of effects.  The inverse kernel is masked: one compilation serves every
combination, so that a diagnosis can try any effect at once.
"""

from __future__ import annotations

import hashlib
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby, pairwise
from pathlib import Path
from types import ModuleType

from beltcomm import atomic
from beltcomm.caches import tell
from beltcomm.effects import EFFECTS
from beltcomm.model import Model, body_list
from beltcomm.simulate.imperfect import LEAST_STEEP, ROUNDS
from beltcomm.simulate.kernels.ahead import VERSION, after_waiting, folder
from beltcomm.simulate.kernels.belt_lanes import PLAIN
from beltcomm.simulate.kernels.observer import ObserverState
from beltcomm.simulate.kernels.switch_groups import indent, needed_lines
from beltcomm.simulate.kernels.writer import LOOK_AHEAD, MOVING_RAD_S, Writer, acts_on_motor

#: A thread must not meet a module that another one is still executing.
_IMPORTING = threading.RLock()


@dataclass(frozen=True)
class Kernel:
    """The compiled functions of one combination of effects; arrays are float64, ``p`` is ``Model.vector()``.

    Attributes
    ----------
    states : int
        Length of ``q``: the positions of the bodies, then the state of elastic friction where there is any. advance(q, v, p, torque, t, h,
        n) -> belt force N: n sub-steps of h seconds with held motor torque, q and v in place. run(q, v, p, torque, t, sample, n, theta,
        omega, cart, belt): whole record, state at the start of each sample and the largest belt force in it. follow(q, v, p, t, first,
        carriage, follows_position, coefficients, state, references, sensing, waiting, timing, past, kept, out): a drive's loop closed on
        the model, see :meth:`beltcomm.simulate.plant.SimulatedPlant.follow`. forces(q, v, p, t, out): smooth forces on all bodies.
        levels(q, v, p, t, out): friction levels of all bodies.
    """

    bodies: tuple[str, ...]
    states: int
    advance: Callable[..., float]
    run: Callable[..., None]
    follow: Callable[..., None]
    forces: Callable[..., None]
    levels: Callable[..., None]


def kernel_for(model: Model) -> Kernel:
    """The kernel of a model's combination of effects; compiled once per machine.

    Parameters
    ----------
    model : Model
        With any effects.
    """
    return _kernel(model.base_bodies, model.effects)


def states_of(model: Model) -> int:
    """Length of ``q``: see :class:`Kernel`; compiles nothing.

    Parameters
    ----------
    model : Model
        With any effects.
    """
    return _states(model.base_bodies, model.effects)


@lru_cache(maxsize=64)
def _states(base_bodies: tuple[str, ...], effects: tuple[str, ...]) -> int:
    writer = Writer(base_bodies, effects)
    return len(writer.bodies) + len(writer.onsets())


@lru_cache(maxsize=64)
def _kernel(base_bodies: tuple[str, ...], effects: tuple[str, ...]) -> Kernel:
    module = import_stable(_kernel_source(base_bodies, effects))
    bodies = tuple(body.name for _, body in body_list(effects, base_bodies))
    return Kernel(bodies, _states(base_bodies, effects), module.advance, module.run, module.follow, module.forces, module.levels)


def _kernel_source(base_bodies: tuple[str, ...], effects: tuple[str, ...]) -> str:
    """Python source of the forward kernel of one combination."""
    writer = Writer(base_bodies, effects)
    everyone = range(len(writer.bodies))
    constants = writer.constants()
    load = [line for i in everyone for line in (f"q{i} = q[{i}]", f"v{i} = v[{i}]")]
    store = [line for i in everyone for line in (f"q[{i}] = q{i}", f"v[{i}] = v{i}")]
    for place, i in enumerate(writer.onsets(), start=len(writer.bodies)):
        load.append(f"z{i} = q[{place}]")
        store.append(f"q[{place}] = z{i}")
    path = ["push = torque"]
    for effect in writer.effects_of_slot("torque_path"):
        assert effect.law is not None
        path.append(f"push = {writer.law(effect.law)}(push, q0, t{writer.arguments(effect)})")
    half = [f"q{i} += 0.5 * h * v{i}" for i in everyone]
    substep = [*half, *path, *writer.kick("push"), *half, "t += h"]
    substep += [writer.turn(i, f"h * {writer.coordinate(i, 'v', False)}") for i in writer.onsets()]
    advance = [
        "@compiled",
        "def advance(q, v, p, torque, t, h, n):",
        *indent([*constants, *load, "strand = 0.0", "for _ in range(n):"], 1), *indent(substep, 2),
        *indent([*store, "return strand"], 1),
    ]  # fmt: skip
    run = [
        "@compiled",
        "def run(q, v, p, torques, t, sample, n, theta, omega, cart, belt):",
        *indent([*constants, *load, "strand = 0.0", "h = sample / n", "for k in range(torques.shape[0]):"], 1),
        *indent(["torque = torques[k]", "theta[k] = q0", "omega[k] = v0", f"cart[k] = {writer.carriage()}", "peak = 0.0"], 2),
        *indent(["for _ in range(n):", *indent([*substep, "peak = max(peak, abs(strand))"], 1), "belt[k] = peak"], 2),
        *indent(store, 1),
    ]  # fmt: skip
    given = "q, v, p, t, first, carriage, follows_position, coefficients, state, references, sensing, waiting, timing, past, kept, out"
    follow = [
        "@compiled",
        f"def follow({given}):",
        "    for k in range(references.shape[1]):",
        *indent([
            *_shown_angle_lines(writer),
            "out[0, k], out[1, k], out[2, k] = shown - first, v[0], q[carriage]",
            "asked = setpoint(follows_position, coefficients, state, references, k, shown - first, sensing)",
            "before = waiting[0]",
            "for i in range(1, waiting.shape[0]):",
            "    waiting[i - 1] = waiting[i]",
            "waiting[-1] = asked",
            "peak = 0.0",
            "if timing[0] > 0.0:",
            "    peak = abs(acted(q, v, p, before, t, timing[1], int(timing[2]), timing[6], past, kept))",
            "    t += timing[0]",
            "peak = max(peak, abs(acted(q, v, p, waiting[0], t, timing[4], int(timing[5]), timing[6], past, kept)))",
            "t += timing[3]",
            "out[3, k], out[4, k], out[5, k] = asked, before, peak",
        ], 2),
    ]  # fmt: skip
    forces = [
        "@compiled",
        "def forces(q, v, p, t, out):",
        *indent([*constants, *load, *writer.forces("v"), *[f"out[{i}] = f{i}" for i in everyone]], 1),
    ]
    levels = [
        "@compiled",
        "def levels(q, v, p, t, out):",
        *indent([*constants, *load, *[f"l{i} = 0.0" for i in everyone], *writer.forces("v"), *writer.levels("v", everyone)], 1),
        *indent([f"out[{i}] = l{i}" for i in everyone], 1),
    ]
    return writer.assemble([advance, run, _acting_torque_lines(writer), follow, forces, levels])


def _shown_angle_lines(writer: Writer) -> list[str]:
    """Lines that say what the motor's encoder shows; the laws give the error at the angle shown, see ``imperfect.angle_sensor``."""
    chosen = [(e.law, e.slope, writer.arguments(e)) for e in writer.effects_of_slot("sensor") if e.law is not None and e.slope is not None]
    if not chosen:
        return ["shown = q[0]"]
    error, steep = (" + ".join(f"{writer.law(f)}(shown{given})" for f, given in some) for some in
                    ([(law, given) for law, _, given in chosen], [(slope, given) for _, slope, given in chosen]))  # fmt: skip
    return [
        "shown = q[0]",
        f"for _ in range({ROUNDS}):",
        f"    shown -= (shown + {error} - q[0]) / max({LEAST_STEEP}, 1.0 + {steep})",
    ]


def _acting_torque_lines(writer: Writer) -> list[str]:
    """Sub-steps with a held torque setpoint, through what lets torque act late.   memory : s, how long that remembers.

    past : the torque of the cells before, N m, with room for as many again.   kept : (1,), how many of them there are.
    """
    head = ["@compiled", "def acted(q, v, p, torque, t, h, n, memory, past, kept):"]
    delays = [
        f"cells = {writer.law(e.law)}(cells, h{writer.arguments(e)})" for e in writer.effects_of_slot("torque_delay") if e.law is not None
    ]
    if not delays:
        return [*head, "    return advance(q, v, p, torque, t, h, n)"]
    body = [
        "old = min(kept[0], math.ceil(memory / h))",
        "for i in range(old):",
        "    past[i] = past[kept[0] - old + i]",
        "for i in range(old, old + n):",
        "    past[i] = torque",
        "kept[0] = old + n",
        "cells = past[: old + n]",
        *delays,
        "strand = 0.0",
        "for i in range(n):",
        "    strand = max(strand, abs(advance(q, v, p, cells[old + i], t + i * h, h, 1)))",
        "return strand",
    ]
    return [*head, *indent(body, 1)]


@dataclass(frozen=True)
class Inverse:
    """The masked functions over the whole catalogue.

    p, on : as :class:`beltcomm.simulate.kernels.switchboard.Switchboard` gives them.

    load(theta, omega, p, on, t, h, bristle, offset, load, cart, watch): load torque at the motor shaft, N m, of everything but the effects
        that act on the motor alone, for a given motor motion; cart position, m.  ``bristle`` : m, in which motor friction turns round.
        ``watch`` : see ``observer``.
    plain(theta, omega, p, on, t, h, offset, load, cart): the same where nothing is on but ``PLAIN``: a tenth as much to compile.
    motor(theta, omega, p, on, t, h, bristle, load, level): the same for effects that act on the motor alone, one after the other over
        the whole motion; ``level`` is memory, as long as ``load``.
    torque(cells, theta, p, on, t, h, out): acting torque of each cell between two points of ``theta``.
    angle(shown, correction, p, on): true minus shown angle, rad, at every angle shown.
    """

    load: Callable[..., None]
    plain: Callable[..., None]
    motor: Callable[..., None]
    torque: Callable[..., None]
    angle: Callable[..., None]


@lru_cache(maxsize=1)
def inverse_kernel() -> Inverse:
    """The masked inverse of the whole catalogue; each of its functions is compiled once per machine, when it is first called."""
    others, plain = import_stable(_motor_side_source()), import_stable(_plain_source())
    return Inverse(after_waiting(load_module().load), plain.load, others.motor, others.torque, others.angle)


def load_module() -> ModuleType:
    """The module with the masked load."""
    return import_stable(_load_source())


def _load_source() -> str:
    """Python source of the masked load beyond the motor; the motor's own onset of friction turns what the belt's load adds to it."""
    writer = Writer.masked_kernel(e for e in EFFECTS if not acts_on_motor(e) or e.slot == "friction_onset")
    onset = writer.onsets()[0]
    turn = [
        "step = ratio * (theta[k] - q0)",
        f"if s{writer.switch[onset.name]}:", "    " + writer.turn(0, "step"), "else:", "    z0 = min(1.0, max(-1.0, z0 + step / bristle))",
    ]  # fmt: skip
    begin = [f"see_{field} = watch.{field}" for field in ObserverState._fields]
    begin.append("inside, shut, watched = 0, 0.0, see_wanted.shape[0] > 0")
    return writer.assemble([_load(writer, "bristle, offset, load, cart, watch", begin, turn, "l0 * z0 - f0", writer.observer_lines())])


def _plain_source() -> str:
    """Source of the inverse kernel of the commonest belt alone."""
    writer = Writer.masked_kernel(e for e in EFFECTS if e.name in PLAIN)
    return writer.assemble([_load(writer, "offset, load, cart", [], [], "-f0", [])])


def _load(writer: Writer, given: str, begin: list[str], turn: list[str], load: str, watching: list[str]) -> list[str]:
    others, driven = range(1, len(writer.bodies)), writer.driven
    zeros = [f"{name}{i} = 0.0" for i in range(len(writer.bodies)) for name in ("q", "v", "w", "o")]
    zeros += [f"z{i} = 0.0" for i in writer.onsets()]
    at_first = [f"q{i} = {writer.start(i)}{' + offset' if i == writer.cart else ''}" for i in others]
    at_first += [f"v{i} = o{i} = {writer.follow(i)}" for i in others]
    groups, follow_up = writer.group_effects(writer.follow_up())
    body = [
        f"half = max(1, min({LOOK_AHEAD}, theta.shape[0] - 1) // 2)",
        "first = (4.0 * theta[half] - theta[2 * half] - 3.0 * theta[0]) / (2.0 * h * half) if theta.shape[0] > 2 else 0.0",
        f"if abs(first) < {MOVING_RAD_S}:",
        "    first = 0.0",
        # What drives the belt is where the motor is before anything is placed by it.
        *([] if driven is None else [f"q{driven} = {writer.start(driven)}", f"v{driven} = {writer.follow(driven)}"]),
        *writer.driving_end("v"), *at_first,
        "for k in range(theta.shape[0]):",
        *indent([
            *turn, "q0 = theta[k]", "v0 = omega[k]",
            *follow_up,
            f"load[k] = {load}",
            "cart[k] = u",
            *watching,
            "if belt:", f"    cart[k] = {writer.carriage()}",
            *[line for i in others for line in writer.with_body(i, [f"q{i} += h * v{i}"])],
            "t += h",
        ], 1),
    ]  # fmt: skip
    begin = [*begin, "q0 = theta[0]"]
    return _function(f"load(theta, omega, p, on, t, h, {given})", [*writer.constants(), *groups, *zeros], [*begin, *body])


def _function(head: str, constants: list[str], body: list[str], how: str = "compiled") -> list[str]:
    """A compiled function with those of its constants that it needs."""
    return [f"@{how}", f"def {head}:", *indent([*needed_lines(constants, body), *body], 1)]


def _motor_side_source() -> str:
    """Python source of the masked functions of the motor's side."""
    writer = Writer.masked_kernel(EFFECTS)
    rubbing = [f"s{writer.switch[e.name]}" for e in writer.with_level(0) if e.slot == "friction_level"]
    motor = [
        "load[:] = 0.0", "level[:] = 0.0",
        *_motor_alone(writer),
        f"if {' or '.join(rubbing)}:",
        "    z0, q0, turning = 0.0, theta[0], 1.0 / bristle",
        "    for k in range(theta.shape[0]):",
        *indent([
            "step = ratio * (theta[k] - q0)", "q0 = theta[k]",
            f"if s{writer.switch[writer.onsets()[0].name]}:", "    " + writer.turn(0, "step"),
            "else:", "    z0 = min(1.0, max(-1.0, z0 + step * turning))",
            "load[k] += max(level[k], 0.0) * z0",
        ], 2),
    ]  # fmt: skip
    path = []
    for effect in writer.effects_of_slot("torque_path"):
        assert effect.law is not None
        path += writer.when(
            effect, [f"push = {writer.law(effect.law)}(push, 0.5 * (theta[k] + theta[k + 1]), t{writer.arguments(effect)})"]
        )
    torque = ["for k in range(cells.shape[0]):", *indent(["push = cells[k]", *path, "out[k] = push", "t += h"], 1)]
    fix = ["correction[:] = 0.0"]
    for effect in writer.effects_of_slot("sensor"):
        assert effect.law is not None
        law = f"{writer.law(effect.law, in_lanes=True)}(shown[k]{writer.arguments(effect)})"
        fix += writer.when(effect, ["for k in range(shown.shape[0]):", *indent([f"correction[k] += {law}"], 1)])
    constants = writer.constants()
    return writer.assemble([
        _function("motor(theta, omega, p, on, t, h, bristle, load, level)", constants, motor),
        _function("torque(cells, theta, p, on, t, h, out)", constants, torque),
        _function("angle(shown, correction, p, on)", constants, fix, "in_lanes"),
    ])  # fmt: skip


def _motor_alone(writer: Writer) -> list[str]:
    """``load`` and ``level`` by the effects that need to know no more than the motor's motion, each in a loop of its own.

    Effects of one law whose switches and parameters stand one behind the other share the text of theirs.
    """
    name, ratio = writer.bodies[0][1].name, "ratio * " if writer.bodies[0][1].rotary else ""
    chosen = [e for e in writer.effects if e.body == name and e.slot in ("force", "friction_level") and e.law is not None]
    lines = []
    for (law, slot), same in groupby(chosen, lambda e: (e.law, e.slot)):
        assert law is not None
        family = list(same)
        rows = [[writer.switch[e.name], *(writer.place[n] for n in (*e.full_names(), *e.uses))] for e in family]
        steps = {tuple(b - a for a, b in zip(one, other, strict=True)) for one, other in pairwise(rows)}
        given = "theta[k], omega[k]" if slot == "force" else f"omega[k], {ratio}theta[k]"
        into = "load[k] -=" if slot == "force" else "level[k] +="
        if len(steps) == 1:
            (step,) = steps
            switch, *places = (f"{at} + {by} * e" for at, by in zip(rows[0], step, strict=True))
            values = [f"a{i} = p[{place}]" for i, place in enumerate(places)]
            sum_up = f"    {into} {writer.law(law)}({given}, t + k * h, {', '.join(f'a{i}' for i in range(len(places)))})"
            loop = [*values, "for k in range(theta.shape[0]):", sum_up]
            lines += [f"for e in range({len(family)}):", f"    if on[{switch}]:", *indent(loop, 2)]
            continue
        for effect in family:
            sum_up = f"    {into} {writer.law(law)}({given}, t + k * h{writer.arguments(effect)})"
            lines += writer.when(effect, ["for k in range(theta.shape[0]):", sum_up])
    return lines


def import_stable(source: str) -> ModuleType:
    """Import generated source from a file whose name is its hash; numba caches machine code beside that file.

    Parameters
    ----------
    source : str
        Python.
    """
    name = f"kernel_{VERSION}_{hashlib.sha256(source.encode()).hexdigest()[:20]}"
    with _IMPORTING:
        return sys.modules[name] if name in sys.modules else _import_source(name, source)


def _import_source(name: str, source: str) -> ModuleType:
    path = _source_file(name, source)
    module = ModuleType(name)
    sys.modules[name] = module
    try:
        # what is executed is the text made here: of the file, numba needs the name and the hash
        exec(compile(source, f"<{name}>" if path is None else str(path), "exec"), module.__dict__)
    except BaseException:  # also Ctrl-C: the next call must not be given half of it
        sys.modules.pop(name, None)
        raise
    return module


def _source_file(name: str, source: str) -> Path | None:
    """The file with ``source`` in the user's cache, where it outlives the process; None when it can neither be read nor written there."""
    path = folder() / f"{name}.py"
    wanted = source.encode()
    try:
        if path.read_bytes() == wanted:
            return path
        tell(f"Damaged files of compiled code in {path.parent} are thrown away and made again.")
    except OSError:
        pass
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        atomic.write(path, wanted)
    except OSError as error:
        tell(f"Compiled code cannot be kept in {path.parent}: {error.strerror or error}; each command makes it anew.")
        return None
    return path
