"""Values of added effects that speak against them: a bound that was met, numbers that nothing is known of, values that no machine has."""

from __future__ import annotations

from typing import Final

from beltcomm.model import Model, effect_parameters

#: An effect counts as found when at least one of its numbers is known to this share of itself: a belt that creeps was imitated by an end
#: pulley and a payload on a spring whose stiffness was 26 ± 40 kN/m.
KNOWN: Final = 0.5


def parameters_at_bounds(model: Model, base: Model) -> list[str]:
    """Parameters of added effects that grew until they met a bound: no size of the effect is right."""
    sizes = {name for e in model.effect_list() for name, p in effect_parameters(e).items() if not p.form} - set(base.parameters)
    added = {name: v for name, v in model.parameters.items() if name in sizes and v.low < v.high}
    near = {name: 1e-6 * (v.high - v.low) for name, v in added.items()}
    return [n for n, v in added.items() if v.value >= v.high - near[n] or (v.low < 0.0 and v.value <= v.low + near[n])]


def undetermined_effects(model: Model, base: Model) -> list[str]:
    """Added effects of which no number is known better than to ``KNOWN``: they stand for something else.

    Parameters
    ----------
    model : Model
        With intervals.
    """
    found = []
    for effect in (e for e in model.effect_list() if e.name not in base.effects):
        own = [model.parameters[name] for name, p in effect_parameters(effect).items() if name not in base.parameters and not p.form]
        free = [p for p in own if p.low < p.high]
        if free and not any(p.interval is not None and p.interval <= KNOWN * abs(p.value) for p in free):
            found.append(effect.name)
    return found


def implausible_effects(model: Model, base: Model) -> list[str]:
    """Of added effects whose values no machine has: the effect, and in words why."""
    found = []
    for effect in (e for e in model.effect_list() if e.name not in base.effects and e.unlikely is not None):
        assert effect.unlikely is not None
        values = {name.removeprefix(f"{effect.name}."): model[name] for name in effect_parameters(effect)}
        if why := effect.unlikely(values):
            found.append(f"{effect.name} as {why}")
    return found
