"""A population of axes: what differs between its members, and the numbers of member k, the same whoever computes them."""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from beltcomm.configfiles import did_you_mean
from beltcomm.effects import EFFECTS, effect_named
from beltcomm.errors import UsageError
from beltcomm.model import Model
from beltcomm.quantities import UNITS, parse_quantity

Kind = Literal["uniform", "normal", "choice", "tolerance"]
KINDS: tuple[Kind, ...] = ("uniform", "normal", "choice", "tolerance")
#: What differs beside the parameters of the model, and its unit.
BESIDE = {"payload": "kg", "drive.delay": "s", "move.from": "m"}
#: Names of values that are no parameters: how old an axis is, 0 new to 1 old, and the effect hidden in it.
AGE, HIDDEN, NOTHING = "age", "hidden", "none"

Values = Mapping[str, float | str]


@dataclass(frozen=True)
class Distribution:
    """Of one number.

    Attributes
    ----------
    kind, numbers
        "uniform" (low, high); "normal" (mean, standard deviation); "choice" any, each as likely; "tolerance" (share,), uniform within ±
        share of the nominal value.
    """

    kind: Kind
    numbers: tuple[float, ...]

    def draw(self, random: np.random.Generator, nominal: float) -> float:
        """One number; ``nominal`` is what the base has."""
        if self.kind == "uniform":
            return float(random.uniform(self.numbers[0], self.numbers[1]))
        if self.kind == "normal":
            return float(random.normal(self.numbers[0], self.numbers[1]))
        if self.kind == "choice":
            return float(self.numbers[int(random.integers(len(self.numbers)))])
        return float(nominal * random.uniform(1.0 - self.numbers[0], 1.0 + self.numbers[0]))


@dataclass(frozen=True)
class Population:
    """Quantities that differ.

    Attributes
    ----------
    drawn : dict of str to Distribution
        By parameter of the model or name of :data:`BESIDE`.
    seed : int
        Of all draws.
    age : Distribution or None
        Of one number per axis, 0 new to 1 old, None where nobody ages; old : by parameter, the share by which it is larger at age 1, in
        between in proportion.
    hidden : dict of str to dict of str to Distribution
        By effect, "none" for a healthy axis, distributions of its parameters; members take them in turn.
    """

    drawn: Mapping[str, Distribution]
    seed: int = 0
    age: Distribution | None = None
    old: Mapping[str, float] = field(default_factory=dict)
    hidden: Mapping[str, Mapping[str, Distribution]] = field(default_factory=dict)

    def member(self, number: int, nominal: Mapping[str, float]) -> dict[str, float | str]:
        """Values of a member, of everything that differs, SI.

        Each name has a stream of its own, so another name in the study or more members change no value.

        Parameters
        ----------
        number : int
            From 0.
        nominal : dict of str to float
            What the base has, by the same names.
        """
        values: dict[str, float | str] = {name: one.draw(self._random(number, name), nominal[name]) for name, one in self.drawn.items()}
        if self.age is not None:
            values[AGE] = self.age.draw(self._random(number, AGE), 0.0)
        if self.hidden:
            effect = list(self.hidden)[number % len(self.hidden)]
            values[HIDDEN] = effect
            for name, one in self.hidden[effect].items():
                values[name] = one.draw(self._random(number, name), 0.0)
        return values

    def _random(self, number: int, name: str) -> np.random.Generator:
        return np.random.default_rng((self.seed, number, zlib.crc32(name.encode())))


@dataclass(frozen=True)
class DrawnAxis:
    """One member.

    Attributes
    ----------
    delay_s : float
        Torque setpoint to acting torque.
    start_m : float
        Where its move begins.
    """

    model: Model
    delay_s: float
    start_m: float


def nominal_of(model: Model, delay_s: float, start_m: float) -> dict[str, float]:
    """Nominal values of all that a population can draw.

    Parameters
    ----------
    model : Model
    delay_s : float, s
        Of the drive.
    start_m : float, m
        Begin of the move.

    Returns
    -------
    dict of str to float
        By the names that a study uses.
    """
    return {**{name: one.value for name, one in model.parameters.items()}, "payload": 0.0, "drive.delay": delay_s, "move.from": start_m}


def units_of(model: Model) -> dict[str, str]:
    """Units of all that a population can draw, by name.

    Parameters
    ----------
    model : Model
    """
    return {**{name: one.unit for name, one in model.parameters.items()}, **BESIDE}


def drawn_axis(population: Population, values: Values, model: Model, delay_s: float, start_m: float) -> DrawnAxis:
    """The axis that has these values where it differs from the base.

    Age acts on the drawn value, the payload is added to the carriage; what is beyond the bounds of a parameter stands on the bound.

    Parameters
    ----------
    population : Population
        Of which the values were drawn.
    values : Values
        Of the member.
    model : Model
    delay_s : float, s
        Of the drive of the base.
    start_m : float, m
        Begin of the move of the base.

    Raises
    ------
    UsageError
        For a hidden effect that cannot be in this model.
    """
    effect = str(values.get(HIDDEN, NOTHING))
    if effect != NOTHING:
        own = {name: float(values[name]) for name in population.hidden[effect]}
        model = model.with_effect(effect, own, origin="drawn")
    changed = {name: float(value) for name, value in values.items() if name in population.drawn and name not in BESIDE}
    age = float(values.get(AGE, 0.0))
    for name, share in population.old.items():
        changed[name] = changed.get(name, model[name]) * (1.0 + share * age)
    payload = float(values.get("payload", 0.0))
    if payload:
        changed["cart.mass"] = changed.get("cart.mass", model["cart.mass"]) + payload
    bounds = {name: model.parameters[name] for name in changed}
    kept = {name: min(max(value, bounds[name].low), bounds[name].high) for name, value in changed.items()}
    return DrawnAxis(
        model.with_values(kept, origin="drawn"),
        max(float(values.get("drive.delay", delay_s)), 0.0),
        float(values.get("move.from", start_m)),
    )


def population_from(data: Mapping[str, Any], model: Model, seed: int) -> Population:
    """The population of a study file: its entries ``population``, ``ageing`` and ``hidden``.

    Parameters
    ----------
    data : mapping of str to Any
        Content of the file.
    model : Model
    seed : int

    Raises
    ------
    UsageError
        That names the entry.
    """
    units = units_of(model)
    drawn = {}
    for name, told in _mapping(data.get("population"), "population").items():
        if name not in units:
            raise UsageError(f"population.{name} is nothing that this axis has{did_you_mean(name, units)}; it has {', '.join(units)}")
        drawn[name] = _distribution_from(told, f"population.{name}", units[name])
        if drawn[name].kind == "tolerance" and name == "payload":
            raise UsageError("population.payload has no nominal value that a tolerance could be a share of; write uniform or choice")
    ageing = _mapping(data.get("ageing"), "ageing")
    _only(ageing, ("age", "when_old"), "ageing")
    if bool(ageing.get("age")) != bool(ageing.get("when_old")):
        raise UsageError("ageing needs both, age (a distribution, 0 new to 1 old) and when_old (parameters with their change in per cent)")
    old = {}
    for name, told in _mapping(ageing.get("when_old"), "ageing.when_old").items():
        if name not in model.parameters:
            known = ", ".join(model.parameters)
            raise UsageError(f"ageing.when_old.{name} is no parameter of this axis{did_you_mean(name, model.parameters)}; it has {known}")
        old[name] = _per_cent(told, f"ageing.when_old.{name}")
    age = _distribution_from(ageing["age"], "ageing.age", "1") if ageing else None
    hidden = {str(name): _hidden(str(name), told, model) for name, told in _mapping(data.get("hidden"), "hidden").items()}
    return Population(drawn, seed, age, old, hidden)


def _hidden(name: str, told: Any, model: Model) -> dict[str, Distribution]:
    """Distributions of the parameters of one hidden effect, by full name."""
    given = _mapping(told, f"hidden.{name}")
    if name == NOTHING:
        _only(given, (), f"hidden.{name}")
        return {}
    known = [effect.name for effect in EFFECTS]
    if name not in known:
        raise UsageError(
            f"hidden.{name} is no effect{did_you_mean(name, known)}; `beltcomm effects` lists them, {NOTHING} is a healthy axis"
        )
    model.with_effect(name)  # raises where it cannot be
    own = {one.name: one.unit for one in effect_named(name).parameters}
    _only(given, own, f"hidden.{name}")
    found = {}
    for key, value in given.items():
        fixed = not isinstance(value, Mapping)
        where = f"hidden.{name}.{key}"
        found[f"{name}.{key}"] = (
            Distribution("choice", (_quantity(value, where, own[key]),)) if fixed else _distribution_from(value, where, own[key])
        )
    return found


def _distribution_from(told: Any, where: str, unit: str) -> Distribution:
    """One distribution as a study file tells it, such as ``{uniform: [160 kN/m, 210 kN/m]}``; raises UsageError."""
    given = _mapping(told, where)
    kinds = [kind for kind in KINDS if kind in given]
    if len(kinds) != 1 or len(given) != 1:
        raise UsageError(f"{where} is {dict(given)!r}; give one of {', '.join(KINDS)}, as in {{uniform: [LOW, HIGH]}}")
    kind = kinds[0]
    if kind == "tolerance":
        share = _per_cent(given[kind], where)
        if not 0.0 < share < 1.0:
            raise UsageError(f"{where} has a tolerance of {100.0 * share:g} %; it must lie between 0 and 100 %")
        return Distribution(kind, (share,))
    numbers = given[kind]
    if not isinstance(numbers, list) or not numbers or (kind != "choice" and len(numbers) != 2):
        wanted = {"uniform": "[LOW, HIGH]", "normal": "[MEAN, STANDARD DEVIATION]", "choice": "[VALUE, VALUE, ...]"}[kind]
        raise UsageError(f"{where}.{kind} is {numbers!r}; write {wanted}")
    found = tuple(_quantity(one, where, unit) for one in numbers)
    if kind == "uniform" and not found[0] < found[1]:
        raise UsageError(f"{where} is uniform from {found[0]:g} to {found[1]:g}; the first must be below the second")
    if kind == "normal" and not found[1] > 0.0:
        raise UsageError(f"{where} has a standard deviation of {found[1]:g}; it must be above 0")
    return Distribution(kind, found)


def _quantity(told: Any, where: str, unit: str) -> float:
    """A number in SI, or a text with its unit, such as "N s/m"; raises UsageError."""
    if isinstance(told, (int, float)) and not isinstance(told, bool):
        value = float(told)
    else:
        text = str(told)
        suffix = next((key for key, one in UNITS.items() if _plain(one.symbol) == _plain(unit)), "")
        match = re.fullmatch(r"\s*(\S+)\s+(.*?)\s*", text)
        same = match is not None and _plain(match[2]) == _plain(unit)
        value = parse_quantity(match[1] if match is not None and same else text, f"{where}_{suffix}" if suffix else where)
    if not math.isfinite(value):
        raise UsageError(f"{where} is {told!r}; give a finite number")
    return value


def _per_cent(told: Any, where: str) -> float:
    """A share from a text such as ``+20 %``; raises UsageError."""
    match = re.fullmatch(r"\s*([-+]?\d*\.?\d+)\s*%\s*", str(told))
    if match is None:
        raise UsageError(f"{where} is {told!r}; write a change in per cent, such as -20 %")
    return float(match[1]) / 100.0


def _plain(unit: str) -> str:
    return unit.replace("²", "2").replace("³", "3").replace(" ", "").lower()


def _mapping(told: Any, where: str) -> Mapping[str, Any]:
    if told is None:
        return {}
    if not isinstance(told, Mapping):
        raise UsageError(f"{where} is {told!r}; it must be a mapping of names to values")
    return {str(key): value for key, value in told.items()}


def _only(given: Mapping[str, Any], known: Any, where: str) -> None:
    unknown = [name for name in given if name not in known]
    if unknown:
        raise UsageError(f"{where} has no entry {unknown[0]}{did_you_mean(unknown[0], known)}; it has {', '.join(known) or 'none'}")
