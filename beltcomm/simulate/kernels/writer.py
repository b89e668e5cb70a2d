"""Writes the Python source of a kernel: the laws of a combination of effects on constant places of one parameter vector.

Every body has scalar variables q_i, v_i; ``u``, ``du`` are the belt travel and speed of the driving end.  A *masked* kernel holds the
whole catalogue and reads from a row of switches which effects are on: one compilation serves every combination.

Each kernel is named by the source files of its laws: a changed one must not meet machine code of the old one.
"""

from __future__ import annotations

import hashlib
import inspect
import sys
from collections.abc import Callable, Iterable, Sequence

from beltcomm.control import cascade_kernel
from beltcomm.effects import (
    BELT_DAMPING,
    BELT_SPRING,
    BELT_STIFFNESS,
    DRIVING_BODY,
    DRIVING_END,
    EFFECTS,
    Body,
    Effect,
    effect_named,
    is_plain_belt,
)
from beltcomm.model import BASE_BODIES, body_list, effect_parameters, expected_parameters
from beltcomm.simulate.kernels import branchless, fast_math, pieces
from beltcomm.simulate.kernels.learning import learn
from beltcomm.simulate.kernels.observer import (
    EXPECTED,
    LEARNED,
    OBSERVED,
    TAKEN,
    TOUCHED,
    contact,
    expected_innovation,
    observe,
    take_correction,
)
from beltcomm.simulate.kernels.observer_lanes import advance_sample, brought
from beltcomm.simulate.kernels.pieces import stick_or_slide, weighted_mean
from beltcomm.simulate.kernels.switch_groups import group, indent


def fingerprint(laws: Iterable[Callable[..., object]], modules: Iterable[str]) -> str:
    """A hash of everything that these laws, and modules besides, are made of.

    Parameters
    ----------
    laws : iterable of callable
        Of effects.
    modules : iterable of str
        By full name.
    """
    used = set(modules).union(*(_modules_of(law) for law in laws))
    text = "".join(inspect.getsource(sys.modules[module]) for module in sorted(used))
    return hashlib.sha256(text.encode()).hexdigest()


def _modules_of(law: Callable[..., object]) -> set[str]:
    """Modules of a law and of the compiled functions that it calls."""
    plain = getattr(law, "py_func", law)
    called = [plain.__globals__[name] for name in plain.__code__.co_names if name in plain.__globals__]
    written = {definition.__module__ for other in called if (definition := getattr(other, "_defn", None))}  # of intrinsics
    return ({plain.__module__} | written).union(*(_modules_of(other) for other in called if hasattr(other, "py_func")))


#: rad/s: a stretch that begins faster than this begins in motion, all bodies with the motor (a gap in the middle of a stroke);
#: more than the first milliseconds of an excitation from rest.
MOVING_RAD_S = 3.0
#: Fine steps over which that first speed is taken, free of a constant acceleration: single ones carry the encoder's rounding and
#: the end of the interpolation.
LOOK_AHEAD = 32
#: Effects that nearly every model has.
USUAL = ("belt_stiffness", "belt_damping", "viscous", "viscous_cart", "coulomb", "cart_friction")


def catalogue_parameters() -> dict[str, int]:
    """Place of every parameter of the whole catalogue in the vector of the masked kernel."""
    names = [f"{name}.{body.inertia.name}" for name, body in BASE_BODIES.items()] + ["transmission.ratio"]
    for effect in EFFECTS:
        names += effect_parameters(effect)
    return {name: i for i, name in enumerate(dict.fromkeys(names))}


def catalogue_bodies(effects: Sequence[Effect] = EFFECTS) -> tuple[tuple[str, Body], ...]:
    """All bodies of these effects of the catalogue, the base bodies first.

    Parameters
    ----------
    effects : sequence of Effect
        Of the catalogue.

    Returns
    -------
    tuple of tuple of str and Body
        Full name of the inertia, and the body.
    """
    found = {f"{name}.{body.inertia.name}": body for name, body in BASE_BODIES.items()}
    for effect in effects:
        found |= {f"{body.name}.{body.inertia.name}": body for body in effect.bodies}
    return tuple(found.items())


def acts_on_motor(effect: Effect) -> bool:
    """True if an effect adds to the load of the motor whatever the carriage does.

    Parameters
    ----------
    effect : Effect
    """
    return effect.slot in ("force", "friction_level", "friction_onset") and effect.body == "motor"


class Writer:
    """The parts of a kernel as lines of source."""

    def __init__(self, base_bodies: tuple[str, ...], effects: tuple[str, ...]) -> None:
        self.masked = self.in_vectors = False
        self.effects = [effect_named(name) for name in effects]
        self.place = {name: i for i, name in enumerate(expected_parameters(effects, base_bodies))}
        self.bodies = body_list(effects, base_bodies)
        self._prepare()

    @classmethod
    def masked_kernel(cls, effects: Iterable[Effect], *, in_vectors: bool = False) -> Writer:
        """A masked kernel that knows these effects, on the parameter vector and the switches of the whole catalogue.

        With ``in_vectors`` its variables are those of eight models, and its laws such of ``branchless``.
        """
        writer = cls.__new__(cls)
        writer.masked, writer.in_vectors = True, in_vectors
        writer.effects = list(effects)
        writer.place = catalogue_parameters()
        writer.bodies = catalogue_bodies(writer.effects)
        writer._prepare()
        return writer

    def _prepare(self) -> None:
        self.number = {body.name: i for i, (_, body) in enumerate(self.bodies)}
        self.switch = {effect.name: i for i, effect in enumerate(EFFECTS)}
        self.laws: dict[str, Callable[..., object]] = {}
        self.in_lanes: set[str] = set()
        self.cart = self.number.get("cart", 0)
        self.driven = self.number.get(DRIVING_BODY)
        self.carries = {body.name: [e for e in self.effects if body in e.bodies] for _, body in self.bodies}

    # -- switches ---------------------------------------------------------------------------------------------------------------

    def when(self, effect: Effect, lines: list[str]) -> list[str]:
        """Lines that count only when the effect is on."""
        if not self.masked or not lines:
            return lines
        return [f"if s{self.switch[effect.name]}:", *("    " + line for line in lines)]

    def group_effects(self, lines: list[str]) -> tuple[list[str], list[str]]:
        """Lines that set switches for several effects that are seldom on, and the lines behind them; see ``switch_groups``."""
        return group(lines, {f"s{self.switch[name]}" for name in USUAL})

    def with_body(self, i: int, lines: list[str]) -> list[str]:
        """Lines that count only when body i, 0 for the motor, is there."""
        name = self.bodies[i][1].name
        if not self.masked or i == 0:
            return lines
        owners = self.carries[name]
        test = " or ".join(f"s{self.switch[e.name]}" for e in owners) if owners else "belt"
        return [f"if {test}:", *("    " + line for line in lines)]

    def effects_of_slot(self, slot: str) -> list[Effect]:
        """Effects of a slot that have a law."""
        return [e for e in self.effects if e.slot == slot and e.law is not None]

    # -- names ------------------------------------------------------------------------------------------------------------------

    def law(self, function: Callable[..., object], in_lanes: bool = False) -> str:
        """Name of a law, of an effect or of the kernels' pieces, in the module.

        ``in_lanes``: for a loop over samples that do not know each other, on ``fast_math``.
        """
        name = f"{function.__module__.rsplit('.', 1)[1]}__{function.__name__}"
        self.laws[name] = function
        if in_lanes:
            self.in_lanes.add(name)
        return name

    def arguments(self, effect: Effect) -> str:
        """Arguments of a law behind those of its slot, beginning with a comma; "" for none."""
        names = [*effect.full_names(), *effect.uses]
        local = {BELT_STIFFNESS: ", k_belt", BELT_DAMPING: ", d_belt"}
        value = "p{}" if self.masked else "p[{}]"
        return "".join(local.get(name) or f", {value.format(self.place[name])}" for name in names)

    def coordinate(self, i: int, variable: str, angular: bool) -> str:
        """Coordinate or speed of body i, in m along the belt.

        Parameters
        ----------
        i : int
            Number of the body.
        variable : str
            First letter of the kernel's variable: q for places, v, w or g for speeds.
        angular : bool
            As the body has it: rad for a rotary one.
        """
        rotary = self.bodies[i][1].rotary
        return f"ratio * {variable}{i}" if rotary and not angular else f"{variable}{i}"

    def carriage(self) -> str:
        """Position of the carriage, m."""
        return self.coordinate(self.cart, "q", False)

    def constants(self) -> list[str]:
        """Lines that read what does not change within a call."""
        lines = [f"ratio = p[{self.place['transmission.ratio']}]"]
        lines += [f"m{i} = p[{self.place[name]}]" for i, (name, _) in enumerate(self.bodies)]
        if not self.masked and any(effect.slot == "rigid" for effect in self.effects):
            lines.append(f"m0 += ratio * ratio * p[{self.place['cart.mass']}]")
        if self.masked:
            lines += [f"n{i} = 1.0 / m{i} if m{i} > 0.0 else 0.0" for i in range(len(self.bodies))]
            springs = [e for e in self.effects if e.group == BELT_SPRING]
            # Local values and switches: the compiler cannot know that writing the results leaves ``p`` and ``on`` alone.
            lines += [f"p{place} = p[{place}]" for place in self.place.values()]
            lines += [f"s{self.switch[e.name]} = on[{self.switch[e.name]}]" for e in self.effects]
            lines.append("belt = " + " or ".join(f"s{self.switch[e.name]}" for e in springs))
        return lines

    # -- forces -----------------------------------------------------------------------------------------------------------------

    def driving_end(self, speed: str) -> list[str]:
        """Lines that set u, du and the lever of the end that drives the belt."""
        angle, rate = "q0", f"{speed}0"
        lines = []
        if self.driven is not None and not self.masked:
            angle, rate = f"q{self.driven}", f"{speed}{self.driven}"
        elif self.driven is not None:
            (owner,) = self.carries[DRIVING_BODY]
            lines = [
                "qd = q0", f"vd = {speed}0",
                *self.when(owner, [f"qd = q{self.driven}", f"vd = {speed}{self.driven}"]),
            ]  # fmt: skip
            angle, rate = "qd", "vd"
        lines += ["gain = 1.0", "ahead = 0.0"]
        for effect in self.effects_of_slot("kinematics"):
            assert effect.slope is not None
            assert effect.law is not None
            lines += self.when(
                effect,
                [
                    f"gain += {self.law(effect.slope)}({angle}{self.arguments(effect)})",
                    f"ahead += {self.law(effect.law)}({angle}{self.arguments(effect)})",
                ],
            )
        if not self.bodies[0][1].rotary:
            return [*lines, "lever = gain", f"u = {angle} + ahead", f"du = lever * {rate}"]
        return [*lines, "lever = ratio * gain", f"u = ratio * ({angle} + ahead)", f"du = lever * {rate}"]

    def forces(self, speed: str) -> list[str]:
        """f_i from positions q_i and speeds ``speed``_i; ``strand`` is the belt force between driven end and carriage."""
        count = range(len(self.bodies))
        lines = [f"f{i} = 0.0" for i in count] + ["strand = 0.0", "pull = 0.0", f"x = {self.carriage()}"]
        lines += self.driving_end(speed)
        if any(DRIVING_END in element.ends for e in self.effects for element in e.elements):
            lines += [f"stretch = u - {self.coordinate(self.cart, 'q', False)}", f"rate = du - {self.coordinate(self.cart, speed, False)}"]
        lines += self.belt_laws()
        for effect in self.effects:
            if effect.slot == "force" and effect.law is not None:
                lines += self.when(effect, self.force(effect, speed))
            for element in effect.elements:
                ends = (*element.ends, element.angular)
                lines += self.when(effect, self._element(ends, speed, self.law(element.law), self.arguments(effect)))
        return [*lines, *self.to_driving_end()]

    def force(self, effect: Effect, speed: str) -> list[str]:
        """Force of one effect on its body; what acts on the carriage acts on the driven body of an axis without a belt."""
        assert effect.law is not None
        law, rest = self.law(effect.law), f"t{self.arguments(effect)}"
        lever, angle, rate = ("ratio * ", "ratio * q0", f"ratio * {speed}0") if self.bodies[0][1].rotary else ("", "q0", f"{speed}0")
        rigid = [f"f0 += {lever}{law}({angle}, {rate}, {rest})"]
        if effect.body not in self.number:
            return rigid
        i = self.number[effect.body]
        own = [f"f{i} += {law}(q{i}, {speed}{i}, {rest})"]
        if self.masked and effect.body == "cart":
            return ["if belt:", "    " + own[0], "else:", "    " + rigid[0]]
        return own

    def belt_laws(self) -> list[str]:
        """Gap and slack act on the stretch of everything between driving end and carriage; then the stiffness others ask for."""
        lines = ["closed = 1.0"] if self.masked else []
        for effect in self.effects_of_slot("belt_law"):
            assert effect.slope is not None
            assert effect.law is not None
            share = [f"share = {self.law(effect.slope)}(stretch{self.arguments(effect)})", "rate *= share"]
            closed = ["closed *= share"] if self.masked else []
            lines += self.when(effect, [*share, *closed, f"stretch = {self.law(effect.law)}(stretch{self.arguments(effect)})"])
        if any(BELT_STIFFNESS in e.uses for e in self.effects):
            lines += ["k_belt = 0.0", "d_belt = 0.0"]
            for effect in self.effects:
                if is_plain_belt(effect):
                    slope = f"{self.law(effect.elements[0].slope)}(x{self.arguments(effect)})"
                    lines += self.when(effect, [f"slopes = {slope}", "k_belt += slopes[0]", "d_belt += slopes[1]"])
        return lines

    def _element(self, ends: tuple[str, str, bool], speed: str, law: str, arguments: str) -> list[str]:
        """Force of one element on its two ends."""
        a, b, angular = ends
        if (a, b) == (DRIVING_END, "cart"):
            return [
                f"force = {law}(stretch, rate, x{arguments})",
                "pull += force", "strand += force", f"f{self.cart} += {'ratio * ' if self.bodies[self.cart][1].rotary else ''}force",
            ]  # fmt: skip

        def at(end: str, variable: str) -> str:
            if end == DRIVING_END:
                return "u" if variable == "q" else "du"
            return self.coordinate(self.number[end], variable, angular)

        lines = [f"force = {law}({at(a, 'q')} - ({at(b, 'q')}), {at(a, speed)} - ({at(b, speed)}), x{arguments})"]
        for end, sign in ((a, "-"), (b, "+")):
            if end == DRIVING_END:
                lines.append(f"pull {'+' if sign == '-' else '-'}= force")
            else:
                i = self.number[end]
                lines.append(f"f{i} {sign}= {'ratio * ' if self.bodies[i][1].rotary and not angular else ''}force")
        return lines

    def to_driving_end(self) -> list[str]:
        """The belt's pull on the body that drives it."""
        if self.driven is None:
            return ["f0 -= lever * pull"]
        if not self.masked:
            return [f"f{self.driven} -= lever * pull"]
        (owner,) = self.carries[DRIVING_BODY]
        return [f"if s{self.switch[owner.name]}:", f"    f{self.driven} -= lever * pull", "else:", "    f0 -= lever * pull"]

    # -- friction ---------------------------------------------------------------------------------------------------------------

    def levels(self, speed: str, wanted: range) -> list[str]:
        """l_i for every wanted body that has set-valued friction; after ``forces``."""
        lines = []
        for i in wanted:
            if not self.has_level(i):
                continue
            lines.append(f"l{i} = 0.0")
            place = self.coordinate(i, "q", False)
            for effect in self.with_level(i):
                assert effect.law is not None
                given = f"{speed}{i}, {place}, t" if effect.slot == "friction_level" else "lever * pull"
                lines += self.when(effect, [f"l{i} += {self.law(effect.law)}({given}{self.arguments(effect)})"])
            lines.append(f"l{i} = max(l{i}, 0.0)")
        return lines

    def has_level(self, i: int) -> bool:
        """True if body i has set-valued friction."""
        return bool(self.with_level(i))

    def with_level(self, i: int) -> list[Effect]:
        """Effects that give body i set-valued friction."""
        return [e for e in self.effects if e.slot in ("friction_level", "load_friction") and self.number.get(e.body) == i]

    def onsets(self) -> dict[int, Effect]:
        """By body: the law by which its friction turns round, where there is one besides the jump.  Its state is ``z`` and the number."""
        return {self.number[e.body]: e for e in self.effects_of_slot("friction_onset") if e.body in self.number}

    def turn(self, i: int, step: str) -> str:
        """Line that turns the friction of body i round over a step, an expression in m at the belt."""
        effect = self.onsets()[i]
        assert effect.law is not None
        return f"z{i} = {self.law(effect.law)}({step}, z{i}{self.arguments(effect)})"

    def kick(self, torque: str) -> list[str]:
        """Lines for new velocities of all bodies of a forward kernel under a torque, N m; leaves f_i, strand and l_i of the second pass.

        One text for both passes, in the first of which the mean of old and new is the old velocity: half as much to compile.
        """
        everyone = range(len(self.bodies))
        step = [f"w{i} = 0.5 * (v{i} + g{i})" for i in everyone] + self.forces("w") + self.levels("w", everyone)
        elastic = self.onsets()
        for i in everyone:
            free = f"(f{i}{f' + {torque}' if i == 0 else ''}) / m{i}"
            if i in elastic and self.has_level(i):
                step.append(f"g{i} = v{i} + h * ({free} - l{i} * z{i} / m{i})")
            elif self.has_level(i):
                step.append(f"g{i} = {self.law(stick_or_slide)}(v{i}, {free}, l{i} / m{i}, h)")
            else:
                step.append(f"g{i} = v{i} + h * {free}")
        return [*[f"g{i} = v{i}" for i in everyone], "for _ in range(2):", *indent(step, 1), *[f"v{i} = g{i}" for i in everyone]]

    def follow_up(self) -> list[str]:
        """New velocities of all bodies but the first, whose motion is given; leaves f_0, l_0 and strand.

        Speeds stand half a step before the positions; at the positions' instant they are taken as v + (v - o)/2, o one step before.
        """
        others, elastic = range(1, len(self.bodies)), self.onsets()
        lines = ["w0 = v0"]
        for i in others:
            lines += self.with_body(i, [f"w{i} = 1.5 * v{i} - 0.5 * o{i}", f"o{i} = v{i}"])
        lines += self.forces("w") + self.levels("w", range(len(self.bodies)))
        for i in others:
            if self.has_level(i):
                jump = [f"v{i} = {self.law(stick_or_slide)}(v{i}, f{i} * n{i}, l{i} * n{i}, h)"]
                if i in elastic:
                    slide = [f"v{i} += h * (f{i} - l{i} * z{i}) * n{i}", self.turn(i, f"h * {self.coordinate(i, 'v', False)}")]
                    jump = [f"if s{self.switch[elastic[i].name]}:", *indent(slide, 1), "else:", *indent(jump, 1)]
                lines += self.with_body(i, jump)
            else:
                lines += self.with_body(i, [f"v{i} += h * f{i} * n{i}"])
        return lines

    def observer_lines(self) -> list[str]:
        """Corrects the bodies behind the motor at the end of every sample, by what the torque says of them; ``observer``."""
        correct = []
        for i in range(1, len(self.bodies)):
            at = f"see_places[{i}], {_kernel_arguments(TAKEN)}"
            correct += [f"place, speed = {self.law(take_correction)}({at})", f"q{i} -= place", f"v{i} -= speed", f"o{i} -= speed"]
        sample = [
            "before = k // see_substeps - 1",
            "left = 0.0",
            "if before > 0:",
            f"    left = {self.law(weighted_mean)}(load, before * see_substeps, see_substeps) - see_wanted[before]",
            "see_left[before] = left",
            "if see_learning:",
            "    see_shares[before] = see_held[before] * (shut / inside)",
            f"innovation = {self.law(expected_innovation)}(before, left, {_kernel_arguments(EXPECTED)})",
            "if see_learning:",
            f"    {self.law(learn)}(before, innovation, {_kernel_arguments(LEARNED)})",
            f"{self.law(observe)}(before, innovation, {_kernel_arguments(OBSERVED)})",
            *correct,
            f"q{self.cart} -= {self.law(contact)}(before, lever, u - q{self.cart}, {_kernel_arguments(TOUCHED)})",
            "inside, shut = 0, 0.0",
        ]
        return ["if watched and k > 0:", "    inside += 1", "    shut += closed", "    if inside == see_substeps:", *indent(sample, 2)]

    # -- how a stretch begins ---------------------------------------------------------------------------------------------------

    def start(self, i: int) -> str:
        """Position of body i when the belt is not stretched and the motor is at ``q0``."""
        rotary = self.bodies[i][1].rotary
        return "q0" if rotary == self.bodies[0][1].rotary else "u"

    def follow(self, i: int) -> str:
        """Speed of body i when it goes with the motor."""
        return "first" if self.bodies[i][1].rotary == self.bodies[0][1].rotary else "lever * first"

    def assemble(self, functions: list[list[str]]) -> str:
        """The module: imports, compiled laws, functions, and a hash of all laws (a changed law must not meet old machine code)."""
        body = "\n\n\n".join("\n".join(part) for part in functions)
        imports = [f"from {law.__module__} import {law.__name__} as _{name}" for name, law in sorted(self.laws.items())]
        single = "in_vectors(_{0})" if self.in_vectors else "within_kernels(getattr(_{0}, 'py_func', _{0}))"
        several = "fast(_{0})"
        laws = [f"{name} = {(several if name in self.in_lanes else single).format(name)}" for name in sorted(self.laws)]
        if "setpoint(" in body:
            imports.append("from beltcomm.simulate.kernels.pieces import setpoint")
        if self.in_lanes:
            imports.append("from beltcomm.simulate.kernels.fast_math import fast")
        if self.in_vectors:
            imports.append("from beltcomm.simulate.kernels.branchless import in_vectors")
            imports.append("from beltcomm.simulate.kernels.observer_lanes import brought, advance_sample")
            imports.append("from beltcomm.simulate.kernels.vectors import at, eight, either, least, most, put")
        ours = "from beltcomm.compiled import compiled, in_lanes, within_kernels"
        head = ["import math", "", "import numpy as np", "", ours, *imports, "", *laws]
        made_of, modules = [*self.laws.values()], [pieces.__name__, cascade_kernel.__name__, fast_math.__name__]
        if self.in_vectors:
            made_of, modules = [*made_of, brought, advance_sample], [*modules, branchless.__name__]
        return "\n".join(head) + "\n\n\n" + body + f"\n# {fingerprint(made_of, modules)}\n"


def _kernel_arguments(fields: Sequence[str]) -> str:
    """Arguments of a call, as the generated kernel names the fields of its ``ObserverState``."""
    return ", ".join(f"see_{field}" for field in fields)
