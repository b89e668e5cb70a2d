"""Composes the effects of a model into one compiled kernel (see docs/effects.md for the slots and the cost).

Numerics.  Positions and velocities are staggered (position Verlet):  q += h v/2;  v += h F(q, v̄)/m;  q += h v/2,  with v̄ the
mean of old and new velocity from one predictor pass, so smooth forces are integrated to second order.  Set-valued friction
is decided once per body and sub-step and solved exactly for the push of that step (``stick_or_slide``): it never chatters, holds
a resting body exactly and places a reversal inside the step.
"""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import os
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import ModuleType

from platformdirs import user_cache_path

from beltcomm.effects import DRIVING_BODY, DRIVING_END, Effect, effect_named
from beltcomm.model import Model, body_list, expected_parameters
from beltcomm.simulate.stick import stick_or_slide

#: rad/s: a stretch that begins faster than this begins in motion, all bodies with the motor (a gap in the middle of a stroke);
#: more than the first milliseconds of an excitation from rest.
MOVING_RAD_S = 3.0
#: Fine steps over which that first speed is taken, free of a constant acceleration: single ones carry the encoder's rounding and
#: the end of the interpolation.
LOOK_AHEAD = 32
#: Changes whenever the generated source changes shape, so that an old cache is never met.
_VERSION = 8


@dataclass(frozen=True)
class Kernel:
    """The compiled functions of one combination of effects; arrays are float64, ``p`` is ``Model.vector()``.

    advance(q, v, p, torque, t, h, n) -> belt force N: n sub-steps of h seconds with held motor torque, q and v in place.
    run(q, v, p, torque, t, sample, n, theta, omega, cart, belt): whole record, state at the start of each sample and the
        largest belt force in it.
    inverse(theta, omega, p, t, h, bristle, offset, load, cart): load torque at the motor shaft, N m, that the given motor motion
        needs besides the motor's own inertia; cart position, m.  ``bristle`` : rad, in which motor friction turns round.
    forces(q, v, p, t, out): smooth forces on all bodies.      levels(q, v, p, t, out): friction levels of all bodies.
    """

    bodies: tuple[str, ...]
    advance: Callable[..., float]
    run: Callable[..., None]
    inverse: Callable[..., None]
    forces: Callable[..., None]
    levels: Callable[..., None]


def kernel_for(model: Model) -> Kernel:
    """The kernel of a model's combination of effects; compiled once per machine."""
    return _kernel(model.base_bodies, model.effects)


@lru_cache(maxsize=64)
def _kernel(base_bodies: tuple[str, ...], effects: tuple[str, ...]) -> Kernel:
    source = kernel_source(base_bodies, effects)
    module = _import_stable(source)
    bodies = tuple(body.name for _, body in body_list(effects, base_bodies))
    return Kernel(bodies, module.advance, module.run, module.inverse, module.forces, module.levels)


def kernel_source(base_bodies: tuple[str, ...], effects: tuple[str, ...]) -> str:
    """Python source of the kernel of one combination."""
    return _Writer(base_bodies, effects).source()


class _Writer:
    """Writes the source: every body has scalar variables q_i, v_i; every law stands on constant places of ``p``."""

    def __init__(self, base_bodies: tuple[str, ...], effects: tuple[str, ...]) -> None:
        self.effects = [effect_named(name) for name in effects]
        self.place = {name: i for i, name in enumerate(expected_parameters(effects, base_bodies))}
        self.bodies = body_list(effects, base_bodies)
        self.number = {body.name: i for i, (_, body) in enumerate(self.bodies)}
        self.laws: dict[str, Callable[..., float]] = {}

    def law(self, function: Callable[..., float]) -> str:
        name = f"{function.__module__.rsplit('.', 1)[1]}__{function.__name__}"
        self.laws[name] = function
        return name

    def arguments(self, effect: Effect) -> str:
        names = [*effect.full_names(), *effect.uses]
        return "".join(f", p[{self.place[name]}]" for name in names)

    def end(self, name: str) -> int:
        if name == DRIVING_END:
            return self.number.get(DRIVING_BODY, 0)
        return self.number[name]

    def coordinate(self, i: int, variable: str, angular: bool) -> str:
        rotary = self.bodies[i][1].rotary
        return f"ratio * {variable}{i}" if rotary and not angular else f"{variable}{i}"

    def carriage(self) -> str:
        i = self.number.get("cart", 0)
        return self.coordinate(i, "q", False)

    def forces(self, speed: str, indent: str) -> list[str]:
        """f_i from positions q_i and speeds ``speed``_i; ``strand`` is the belt force between driven end and carriage."""
        lines = [f"f{i} = 0.0" for i in range(len(self.bodies))] + ["strand = 0.0", f"x = {self.carriage()}"]
        for effect in self.effects:
            if effect.slot == "force" and effect.law is not None:
                i = self.number[effect.body]
                lines.append(f"f{i} += {self.law(effect.law)}(q{i}, {speed}{i}, t{self.arguments(effect)})")
            for element in effect.elements:
                a, b = (self.end(name) for name in element.ends)
                stretch = f"{self.coordinate(a, 'q', element.angular)} - {self.coordinate(b, 'q', element.angular)}"
                rate = f"{self.coordinate(a, speed, element.angular)} - {self.coordinate(b, speed, element.angular)}"
                lines.append(f"force = {self.law(element.law)}({stretch}, {rate}, x{self.arguments(effect)})")
                for i, sign in ((a, "-"), (b, "+")):
                    lever = "ratio * " if self.bodies[i][1].rotary and not element.angular else ""
                    lines.append(f"f{i} {sign}= {lever}force")
                if element.ends == (DRIVING_END, "cart"):
                    lines.append("strand += force")
        return [indent + line for line in lines]

    def levels(self, speed: str, indent: str) -> list[str]:
        """l_i for every body that has set-valued friction."""
        lines = []
        for i in range(len(self.bodies)):
            terms = [
                f"{self.law(e.law)}({speed}{i}, {self.coordinate(i, 'q', False)}, t{self.arguments(e)})"
                for e in self.effects
                if e.slot == "friction_level" and e.law is not None and self.number[e.body] == i
            ]
            if terms:
                lines.append(f"{indent}l{i} = {' + '.join(terms)}")
        return lines

    def has_level(self, i: int) -> bool:
        return any(e.slot == "friction_level" and self.number[e.body] == i for e in self.effects)

    def kick(self, moving: range, torque: str, indent: str) -> list[str]:
        """New velocities of the ``moving`` bodies; leaves f_i, strand and l_i of the second pass."""
        lines = []
        for guess, result in (("v", "g"), ("w", "v")):
            if guess == "w":
                lines += [f"{indent}w{i} = 0.5 * (v{i} + g{i})" for i in moving]
                if 0 not in moving:
                    lines.append(f"{indent}w0 = v0")
            lines += self.forces(guess, indent) + self.levels(guess, indent)
            for i in moving:
                push = f" + {torque}" if i == 0 else ""
                free = f"(f{i}{push}) / m{i}"
                if self.has_level(i):
                    lines.append(f"{indent}{result}{i} = {self.law(stick_or_slide)}(v{i}, {free}, l{i} / m{i}, h)")
                else:
                    lines.append(f"{indent}{result}{i} = v{i} + h * {free}")
        return lines

    def source(self) -> str:
        count = len(self.bodies)
        everyone, others = range(count), range(1, count)
        constants = [f"    ratio = p[{self.place['transmission.ratio']}]"]
        constants += [f"    m{i} = p[{self.place[name]}]" for i, (name, _) in enumerate(self.bodies)]
        load = [f"    q{i} = q[{i}]\n    v{i} = v[{i}]" for i in everyone]
        store = [f"    q[{i}] = q{i}\n    v[{i}] = v{i}" for i in everyone]
        cart = self.carriage()

        def substeps(indent: str) -> list[str]:
            half = [f"{indent}q{i} += 0.5 * h * v{i}" for i in everyone]
            return [*half, *self.kick(everyone, "torque", indent), *half, f"{indent}t += h"]

        advance = [
            "@compiled",
            "def advance(q, v, p, torque, t, h, n):",
            *constants, *load, "    strand = 0.0",
            "    for _ in range(n):", *substeps("        "),
            *store, "    return strand",
        ]  # fmt: skip
        run = [
            "@compiled",
            "def run(q, v, p, torques, t, sample, n, theta, omega, cart, belt):",
            *constants, *load, "    strand = 0.0", "    h = sample / n",
            "    for k in range(torques.shape[0]):",
            "        torque = torques[k]",
            "        theta[k] = q0", "        omega[k] = v0", f"        cart[k] = {cart}", "        peak = 0.0",
            "        for _ in range(n):", *substeps("            "),
            "            peak = max(peak, abs(strand))",
            "        belt[k] = peak",
            *store,
        ]  # fmt: skip
        cart_number = self.number.get("cart")
        start = [f"    q{i} = {self.start(i)}{' + offset' if i == cart_number else ''}\n    v{i} = {self.follow(i)}" for i in others]
        friction = "l0 * z" if self.has_level(0) else "0.0"
        inverse = [
            "@compiled",
            "def inverse(theta, omega, p, t, h, bristle, offset, load, cart):",
            *constants, "    z = 0.0", "    q0 = theta[0]",
            f"    half = max(1, min({LOOK_AHEAD}, theta.shape[0] - 1) // 2)",
            "    first = (4.0 * theta[half] - theta[2 * half] - 3.0 * theta[0]) / (2.0 * h * half) if theta.shape[0] > 2 else 0.0",
            f"    if abs(first) < {MOVING_RAD_S}:", "        first = 0.0", *start,
            "    for k in range(theta.shape[0]):",
            "        step = theta[k] - q0",
            "        q0 = theta[k]", "        v0 = omega[k]",
            "        z = min(1.0, max(-1.0, z + step / bristle))",
            *self.kick(others, "", "        "),
            f"        load[k] = {friction} - f0",
            f"        cart[k] = {cart}",
            *[f"        q{i} += h * v{i}" for i in others],
            "        t += h",
        ]  # fmt: skip
        forces = [
            "@compiled",
            "def forces(q, v, p, t, out):",
            *constants, *load, *self.forces("v", "    "), *[f"    out[{i}] = f{i}" for i in everyone],
        ]  # fmt: skip
        levels = [
            "@compiled",
            "def levels(q, v, p, t, out):",
            *constants, *load, *[f"    l{i} = 0.0" for i in everyone],
            *self.levels("v", "    "), *[f"    out[{i}] = l{i}" for i in everyone],
        ]  # fmt: skip
        body = "\n\n\n".join("\n".join(part) for part in (advance, run, inverse, forces, levels))
        imports = [f"from {law.__module__} import {law.__name__} as _{name}" for name, law in sorted(self.laws.items())]
        laws = [f"{name} = njit(_{name})" for name in sorted(self.laws)]
        head = ["import math", "", "from numba import njit", "", "from beltcomm.compiled import compiled", *imports, "", *laws]
        return "\n".join(head) + "\n\n\n" + body + "\n# " + self.fingerprint() + "\n"

    def start(self, i: int) -> str:
        """Where body i stands when the belt is not stretched and the motor is at ``q0``."""
        rotary = self.bodies[i][1].rotary
        return "q0" if rotary == self.bodies[0][1].rotary else "ratio * q0"

    def follow(self, i: int) -> str:
        """Speed of body i when it goes with the motor."""
        return "first" if self.bodies[i][1].rotary == self.bodies[0][1].rotary else "ratio * first"

    def fingerprint(self) -> str:
        """Hash of the modules of all laws (constants included): a changed law must not meet machine code of the old one."""
        modules = sorted({law.__module__ for law in self.laws.values()})
        text = "".join(inspect.getsource(sys.modules[module]) for module in modules)
        return hashlib.sha256(text.encode()).hexdigest()


def _import_stable(source: str) -> ModuleType:
    """Import generated source from a file whose name is its hash; numba caches machine code beside that file."""
    name = f"kernel_{_VERSION}_{hashlib.sha256(source.encode()).hexdigest()[:20]}"
    if name in sys.modules:
        return sys.modules[name]
    path = _source_file(name, source)
    if path is None:
        module = ModuleType(name)
        exec(compile(source, f"<{name}>", "exec"), module.__dict__)
        sys.modules[name] = module
        return module
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"cannot import the generated kernel {path}")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def _source_file(name: str, source: str) -> Path | None:
    """The file with ``source`` in the user's cache, where it outlives the process; None when none can be read or written there."""
    path = user_cache_path("beltcomm") / "kernels" / f"{name}.py"
    if os.access(path, os.R_OK):
        return path
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, draft = tempfile.mkstemp(dir=path.parent, prefix=name, suffix=".draft")
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(source)
        os.replace(draft, path)  # atomic: another process sees all of it or nothing
    except OSError:
        return None
    return path
