"""No effect makes energy: the law of every effect on closed motions with numbers drawn within its bounds, and a model that has it, let go.

A new effect stands in one of the lists below, or is tried as what its slot makes it.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm.effects import BELT_DAMPING, BELT_STIFFNESS, DRIVING_END, EFFECTS, Effect, Element, Parameter, effect_named
from beltcomm.model import Model, build_model, effect_parameters
from beltcomm.model.linear import acts_on, describes, fastest_rate, operating_point, stretch_of, values_of
from beltcomm.simulate.kernels.compose import kernel_for, states_of

#: Why an effect has no energy of its own to be held to.
WITHOUT_A_FORCE = {
    "torque_ripple": "part of the motor's torque, which brings energy from outside",
    "torque_saturation": "part of the motor's torque, which brings energy from outside",
    "dead_time": "the motor's torque at another time, which brings energy from outside",
    "current_lag": "the motor's torque at another time, which brings energy from outside",
    "measurement_lag": "what is read of a torque; moves nothing",
    "encoder_eccentricity": "what is read of an angle; moves nothing",
    "encoder_eccentricity_2": "what is read of an angle; moves nothing",
    "encoder_interpolation": "what is read of an angle; moves nothing",
}
#: Forces of the place alone: what they give on the way out they take on the way back.
OF_PLACE = {"tilt", "constant_offset", "cable_chain", "unbalance", "tooth_ripple", "travel_ripple"} | {
    e.name for e in EFFECTS if e.name.startswith("cogging")
}
#: Levels that may stand below those of others; the sum of a body's levels is never below nothing, which the simulation shows.
BELOW_OTHERS = {"friction_position", "friction_position_cart", "friction_freeform"}
#: Springs whose stiffness follows the carriage: the thesis's (2.25), (2.26) leave out the force c'(x) stretch²/2 on it, see below.
BY_PLACE = {"belt_spans", "belt_sections", "stiffness_position"}
BY_SLOT = {slot: [e for e in EFFECTS if e.slot == slot] for slot in {e.slot for e in EFFECTS}}
#: Draws of the parameters; points of a closed motion.
DRAWS, POINTS = 40, 2048
#: What every model of the second half has.  The stiffness makes modes of some 700 rad/s.
RATIO, AT_M = 0.0125, 0.4
VALUES = {"motor.inertia": 7e-5, "cart.mass": 4.0, "transmission.ratio": RATIO, "belt_stiffness.stiffness": 2e5, "viscous.damping": 2e-3}
#: Fastest rate times step.   A Verlet step lets the energy of a spring swing by (ω h)²/4 of itself, which is what is allowed.
STEP = 0.03
ALLOWED = STEP**2 / 4.0

Array = NDArray[np.float64]


def named(*slots: str) -> pytest.MarkDecorator:
    """Every effect of these slots that has a force of its own."""
    found = [e for slot in slots for e in BY_SLOT[slot] if e.name not in WITHOUT_A_FORCE]
    return pytest.mark.parametrize("effect", found, ids=lambda e: e.name)


def between(random: np.random.Generator, low: float, high: float) -> float:
    """Evenly, or by powers of ten where zero is no bound; one in eight at the end of the range."""
    if random.random() < 0.125:
        return float(random.choice([low, high]))
    return float(np.exp(random.uniform(np.log(low), np.log(high)))) if low > 0.0 else float(random.uniform(low, high))


def of_parameter(random: np.random.Generator, parameter: Parameter) -> float:
    return between(random, parameter.low, parameter.high)


def drawn(random: np.random.Generator, effect: Effect) -> dict[str, float]:
    """Own parameters, then those that it uses, by full name."""
    values = dict(zip(effect.full_names(), (of_parameter(random, p) for p in effect.parameters), strict=True))
    for name in effect.uses:
        if name == BELT_STIFFNESS:
            values[name] = between(random, 1e3, 1e8)
        elif name == BELT_DAMPING:
            values[name] = between(random, 0.0, 2000.0)
        elif name.startswith(("transmission", "cart.")):
            values[name] = between(random, 1e-3, 10.0)
        else:
            values[name] = of_parameter(random, effect_parameters(effect_named(name.split(".")[0]))[name])
    return values


def closed_motion(random: np.random.Generator, size: float) -> tuple[Array, Array]:
    """Places and speeds over one period of 1 s of three harmonics, m (or rad) and per s; the first place is once more the last."""
    t = np.linspace(0.0, 1.0, POINTS + 1)
    place, speed = np.zeros_like(t), np.zeros_like(t)
    for order in (1, 2, 3):
        a, phase, rate = size * random.uniform(0.2, 1.0) / order, random.uniform(0.0, 6.3), 2.0 * np.pi * order
        place += a * np.sin(rate * t + phase)
        speed += a * rate * np.cos(rate * t + phase)
    return place + size * random.uniform(-1.0, 1.0), speed


@named("friction_level")
def test_a_level_takes_energy(effect: Effect) -> None:
    """The force is -level sign(speed): a level below nothing would push."""
    random = np.random.default_rng(1)
    taken = 0.0
    for _ in range(DRAWS):
        values = drawn(random, effect)
        place, speed = closed_motion(random, between(random, 1e-4, 1.0))
        levels = np.array([effect.law(v, x, 3.0, *values.values()) for v, x in zip(speed.tolist(), place.tolist(), strict=True)])
        assert np.all(np.isfinite(levels))
        if effect.name in BELOW_OTHERS:
            taken = max(taken, float(-np.min(levels)))  # it is one of those
        else:
            assert np.min(levels) >= -1e-15 * max(map(abs, values.values()))
            taken += float(np.sum(levels * np.abs(speed)))
    assert taken > 0.0


@named("load_friction")
def test_friction_of_the_load_takes_energy(effect: Effect) -> None:
    random = np.random.default_rng(2)
    levels = [effect.law(float(load), *drawn(random, effect).values()) for load in random.uniform(-100.0, 100.0, 500)]
    assert min(levels) >= 0.0
    assert max(levels) > 0.0


@named("friction_onset")
def test_elastic_friction_gives_back_no_more_than_it_holds(effect: Effect) -> None:
    """At a level that stays, its force z level holds level length z²/2 at most: no motion, closed or not, brings out more."""
    random = np.random.default_rng(3)
    for _ in range(DRAWS):
        values = drawn(random, effect)
        length = values[effect.full_names()[0]]
        place, _ = closed_motion(random, length * between(random, 0.01, 100.0))
        z, held, lost = 0.0, 0.0, 0.0
        for step in np.diff(place):
            before = z
            z = effect.law(float(step), z, *values.values())
            # ∫ z dx of  z' = (s - z)/length  by the way,  s = ±1
            work = abs(float(step)) + length * float(np.sign(step)) * (before - z)
            stored = 0.5 * length * z * z
            assert abs(z) <= 1.0
            assert work >= stored - held - 1e-12 * length
            lost, held = lost + work - (stored - held), stored
        assert lost > 0.0


@named("force")
def test_a_force_drags_or_is_of_the_place(effect: Effect) -> None:
    """Its power is never positive, with what it ``uses`` beside it; or neither speed nor time changes it."""
    random, effort = np.random.default_rng(4), 0.0
    for _ in range(20 * DRAWS):
        values = drawn(random, effect)
        place, speed, t = random.uniform(-2.0, 2.0), random.uniform(-50.0, 50.0), random.uniform(0.0, 3000.0)
        force = effect.law(place, speed, t, *values.values())
        if effect.name in OF_PLACE:
            assert force == effect.law(place, random.uniform(-50.0, 50.0), random.uniform(0.0, 3000.0), *values.values())
            effort += abs(force)
            continue
        for name in effect.uses:  # friction by direction is a share of the mean, which is there as well
            used = effect_named(name.split(".")[0])
            force += used.law(place, speed, t, values[name])
        assert force * speed <= 0.0
        effort -= force * speed
    assert effort > 0.0


@pytest.mark.parametrize("effect", [e for e in EFFECTS if e.elements], ids=lambda e: e.name)
def test_springs_give_back_and_dampers_take(effect: Effect) -> None:
    """All elements of an effect, with the plain belt beside what only changes it; the carriage stays at its place."""
    random, swung = np.random.default_rng(5), False
    for _ in range(DRAWS):
        values = drawn(random, effect)
        x = random.uniform(0.0, 1.0)
        if effect.name in ("belt_spans", "belt_sections"):  # the carriage is between the pulleys
            values[f"{effect.name}.offset"] += 0.01
            values[f"{effect.name}.pulley_distance"] = values[f"{effect.name}.offset"] + 1.1
        ends = sorted({end for element in effect.elements for end in element.ends})
        motions = {end: closed_motion(random, between(random, 1e-6, 1e-4)) for end in ends}
        given, erring, most, power = 0.0, 0.0, 0.0, np.zeros(POINTS + 1)
        laws = [(element, element.law, tuple(values.values())) for element in effect.elements]
        if BELT_STIFFNESS in effect.uses:
            for name, value in (("belt_stiffness", values[BELT_STIFFNESS]), ("belt_damping", values[BELT_DAMPING])):
                (plain,) = effect_named(name).elements
                laws.append((plain, plain.law, (value,)))
        for element, law, numbers in laws:
            (a, va), (b, vb) = (motions[end] for end in element.ends)
            stretch, rate = a - b, va - vb
            spring = np.array([law(s, 0.0, x, *numbers) for s in stretch.tolist()])
            whole = np.array([law(s, r, x, *numbers) for s, r in zip(stretch.tolist(), rate.tolist(), strict=True)])
            given += float(np.sum(0.5 * (spring[1:] + spring[:-1]) * np.diff(stretch)))
            power += (whole - spring) * rate
            # A trapezium errs by slope ds²/8 at most where a force rises with its stretch.
            slope = np.max(np.abs(np.diff(spring)) / np.maximum(np.abs(np.diff(stretch)), 1e-300), initial=0.0)
            erring += float(slope * np.sum(np.diff(stretch) ** 2)) / 8.0
            most = max(most, float(np.max(np.abs((whole - spring) * rate))))
        assert abs(given) <= erring
        assert np.min(power) >= -1e-12 * most
        swung = swung or erring > 0.0 or most > 0.0
    assert swung


@named("belt_law")
def test_gap_and_slack_bend_the_belt_and_give_nothing(effect: Effect) -> None:
    """What loads the belt rises with its stretch, so a spring behind it gives back what it took and a damper behind it takes."""
    random, bent = np.random.default_rng(6), False
    for _ in range(DRAWS):
        values = drawn(random, effect)
        stretch, rate = closed_motion(random, max(values[effect.full_names()[0]], 1e-6) * between(random, 0.1, 10.0))
        loads = np.array([effect.law(s, *values.values()) for s in stretch.tolist()])
        shares = np.array([effect.slope(s, *values.values()) for s in stretch.tolist()])
        given = float(np.sum(0.5 * (loads[1:] + loads[:-1]) * np.diff(stretch)))
        assert np.min(shares) >= 0.0
        assert np.max(shares) <= 1.0 + 1e-12
        assert abs(given) <= float(np.sum(np.diff(stretch) ** 2)) / 8.0  # a trapezium where the slope is 0 to 1
        assert np.min(shares * rate**2) >= 0.0
        bent = bent or float(np.ptp(stretch - loads)) > 0.01 * float(np.ptp(stretch))
    assert bent


# -- whole models, let go ---------------------------------------------------------------------------------------------------------------

LET_GO = [e for e in EFFECTS if e.name not in WITHOUT_A_FORCE and not e.name.startswith("cogging_")]
STANDS_ON = {
    "presliding": ("coulomb",), "presliding_cart": ("cart_friction",), "viscous_asymmetry": ("viscous",), "warmup": ("viscous",),
    "coulomb_end_pulley": ("end_pulley",), "viscous_end_pulley": ("end_pulley",),
    "coulomb_load": ("elastic_shaft",), "viscous_load": ("elastic_shaft",), "belt_damping": (), "elastic_shaft": (),
    "stribeck_cart": ("stribeck",), "friction_position_cart": ("friction_position",),
}  # fmt: skip
WITHOUT_BELT = {"rigid_load", "elastic_shaft", "coulomb_load", "viscous_load"}
STEPS, SEEDS = 1500, (1, 2)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(48)
#: The same where a step is short against what the force does on it.
FEW, OF_FEW = np.polynomial.legendre.leggauss(3)


def around_usual(random: np.random.Generator, parameter: Parameter) -> float:
    """Up to three times more or less than at the start, of either sign where it may have one."""
    size = (parameter.start or 0.05 * min(parameter.high, 1.0)) * 10.0 ** random.uniform(-0.5, 0.5)
    size *= random.choice([-1.0, 1.0]) if parameter.low < 0.0 else 1.0
    return min(max(size, parameter.low), parameter.high)


def model_with(effect: Effect, random: np.random.Generator) -> Model:
    """An axis without any loss but the effect's own, or with no belt where it has none."""
    belt = effect.name not in WITHOUT_BELT
    spring = ("belt_stiffness",) if belt and (effect.group != "belt spring") else ()
    effects = tuple(dict.fromkeys((*spring, *STANDS_ON.get(effect.name, ()), effect.name)))
    bodies = ("motor", "cart") if belt else ("motor",)
    owners = (*effects, *bodies, "transmission")
    values = {name: value for name, value in VALUES.items() if name.split(".")[0] in owners}
    for one in (effect_named(name) for name in effects if name not in ("belt_stiffness", "viscous")):
        values |= {name: around_usual(random, p) for name, p in effect_parameters(one).items() if p.fitted and not p.form}
    places = {"friction_position.place": AT_M, "stiffness_position.offset": 0.1, "stiffness_position.share": 1.0}
    places |= {f"{name}.{p}": v for name in ("belt_spans", "belt_sections") for p, v in (("offset", 0.1), ("pulley_distance", 1.0))}
    return build_model(
        "let go", effects, values | {name: v for name, v in places.items() if name.split(".")[0] in effects}, base_bodies=bodies
    )


class Energy:
    """Energy of a model's state in J, from the laws alone; forces of the place count from where it was asked last."""

    def __init__(self, model: Model) -> None:
        self.model, self.names = model, [body.name for _, body in model.bodies()]
        self.masses = np.array([model[name] for name, _ in model.bodies()])
        self.effects = model.effect_list()
        self.belt_laws = [(e.law, values_of(model, e, 0.0)) for e in self.effects if e.slot == "belt_law"]
        self.of_place, self.left_out = 0.0, 0.0
        self.before: Array | None = None

    def __call__(self, q: Array, v: Array) -> float:
        count = len(self.masses)
        self._go(q[:count])
        bristles = 0.0
        for place, name in enumerate(("presliding", "presliding_cart")):
            if name in self.model.effects:
                level = self.model["coulomb.level"] / RATIO if place == 0 else self.model["cart_friction.level"]
                bristles += 0.5 * level * self.model[f"{name}.length"] * q[count] ** 2
        return float(0.5 * self.masses @ v**2 + self.elastic(q[:count], self.at(q)) + bristles + self.of_place - self.left_out)

    def at(self, q: Array) -> float:
        return float(q[1]) if "cart" in self.names else RATIO * float(q[0])

    def elastic(self, q: Array, x: float) -> float:
        """Of all elements with the carriage at ``x``:  ∫ law ds."""
        total = 0.0
        for effect in self.effects:
            numbers = values_of(self.model, effect, x)
            for element in effect.elements:
                stretch = self.stretch(element, q)
                bent = self.bent if element.ends == (DRIVING_END, "cart") else float
                loads = [element.law(bent(0.5 * stretch * (1.0 + node)), 0.0, x, *numbers) for node in NODES.tolist()]
                total += 0.5 * stretch * float(WEIGHTS @ loads)
        return total

    def stretch(self, element: Element, q: Array) -> float:
        stretch = float(stretch_of(self.model, element) @ q)
        driven = self.names.index("driving_pulley") if "driving_pulley" in self.names else 0
        for effect in self.effects:
            if effect.slot == "kinematics" and element.ends[0] == DRIVING_END:
                stretch += RATIO * effect.law(float(q[driven]), *values_of(self.model, effect, 0.0))
        return stretch

    def bent(self, stretch: float) -> float:
        for law, numbers in self.belt_laws:
            stretch = law(stretch, *numbers)
        return stretch

    def _go(self, q: Array) -> None:
        """Work against the forces of the place on the way here, and what the springs that follow the carriage leave out on it."""
        before, self.before = self.before, q.copy()
        if before is None:
            return
        for effect in self.effects:
            if effect.name in OF_PLACE:
                i, lever = acts_on(self.model, effect)
                numbers = values_of(self.model, effect, 0.0)
                low, high = lever * float(before[i]), lever * float(q[i])
                forces = [effect.law(0.5 * (low + high + node * (high - low)), 0.0, 0.0, *numbers) for node in FEW.tolist()]
                self.of_place -= 0.5 * (high - low) * float(OF_FEW @ forces)
            if effect.name in BY_PLACE:
                middle = 0.5 * (before + q)
                self.left_out += self.elastic(middle, self.at(q)) - self.elastic(middle, self.at(before))


def start_of(model: Model, random: np.random.Generator) -> tuple[Array, Array]:
    """In motion, and every connection stretched."""
    bodies = [body for _, body in model.bodies()]
    q = np.array([AT_M / RATIO if body.rotary else AT_M for body in bodies])
    v = np.full(len(bodies), 6.0 * random.choice([-1.0, 1.0])) * [1.0 if body.rotary else RATIO for body in bodies]
    scale = np.array([1.0 / RATIO if body.rotary else 1.0 for body in bodies])
    q[1:] += 2e-4 * random.uniform(-1.0, 1.0, len(q) - 1) * scale[1:]
    v[1:] += 0.05 * random.uniform(-1.0, 1.0, len(q) - 1) * scale[1:]
    return np.concatenate([q, np.zeros(states_of(model) - len(q))]), v


@pytest.mark.parametrize("effect", LET_GO, ids=lambda e: e.name)
def test_a_machine_let_go_gains_nothing(effect: Effect) -> None:
    """No torque, random numbers and a random start: at no instant more energy than at any before, but for what a Verlet step may err by."""
    taken = 0.0
    for seed in SEEDS:
        random = np.random.default_rng(seed)
        model = model_with(effect, random)
        assert describes(model, AT_M)
        q, v = start_of(model, random)
        h = STEP / max(fastest_rate(model, operating_point(model, AT_M)), 100.0)
        kernel, p, energy = kernel_for(model), model.vector(), Energy(model)
        found = [energy(q, v)]
        for k in range(STEPS):
            kernel.advance(q, v, p, 0.0, 10.0 + k * h, h, 1)
            found.append(energy(q, v))
        least = np.minimum.accumulate(found)
        assert np.max(found - least) <= ALLOWED * found[0]
        taken = max(taken, 1.0 - found[-1] / found[0])
    if effect.slot in ("friction_level", "load_friction", "friction_onset") or effect.name in ("belt_damping", "quadratic_drag"):
        assert taken > ALLOWED
