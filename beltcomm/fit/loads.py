"""Loads that differ by record: stated with the records, or named there and found by the fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from beltcomm.axis.kinds import ARC_M
from beltcomm.effects.other_load import COUNT, other_load
from beltcomm.errors import DataError
from beltcomm.model import Model
from beltcomm.model.mounted import MASS, Mounted, carrying, of_load
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import Sidecar


@dataclass(frozen=True)
class LoadName:
    """Key of the load of a record, as far as its sidecar tells: its name, and what is stated in a unit that this axis cannot use."""

    name: str
    unused: tuple[float | None, ...] = ()

    def __str__(self) -> str:
        said = [f"{value:g} {unit}" for value, unit in zip(self.unused, ("kg", "kg m²"), strict=False) if value is not None]
        return " with ".join([repr(self.name)] * bool(self.name) + said) or "no stated load"


def _stated(sidecar: Sidecar, model: Model) -> tuple[LoadName, float]:
    """Load of a record as its sidecar has it, and how much of its mass is stated there, kg or, without a carriage, kg m² at the motor.

    A load that turns is carried along its arc.
    """
    mass, inertia = sidecar.payload_kg, sidecar.payload_inertia_kg_m2
    if MASS in model.parameters:
        return LoadName(sidecar.load), (mass or 0.0) + (inertia or 0.0) / ARC_M**2
    if model.side == "load":
        return LoadName(sidecar.load, (None, inertia)), mass or 0.0
    if model.side == "motor":
        return LoadName(sidecar.load, (mass,)), inertia or 0.0
    return LoadName(sidecar.load, (mass, inertia)), 0.0


def _loads_of(recordings: Sequence[Recording], model: Model) -> list[LoadName]:
    """The loads that the fit tells apart, by their numbers; those of records held out and of static maps do not count.

    Raises DataError for more than a model can have.
    """
    found = list(dict.fromkeys(_stated(r.sidecar, model)[0] for r in recordings if not (r.sidecar.held_out or r.is_static_map)))
    if len(found) > COUNT + 1:
        raise DataError(
            f"the records name {len(found)} loads ({', '.join(map(str, found))}); a run may have {COUNT + 1}. State what was mounted "
            "(`beltcomm import --payload`), or keep some of them in a run of their own"
        )
    return found


def mounted_by(recordings: Sequence[Recording], model: Model) -> dict[str, Mounted | None]:
    """Load of each record that is another one than the model's, by its name.

    Parameters
    ----------
    recordings : sequence of Recording
    model : Model
        For the side to which loads refer.

    Returns
    -------
    dict of str to Mounted or None
        By record; None for the load of the model itself.

    Raises
    ------
    DataError
        When a record that is held out carries a load that no fitted one has.
    """
    loads, first = _loads_of(recordings, model), dict[LoadName, float]()
    if not loads:  # nothing is fitted, which is refused where that is asked
        return {}
    timed = [r for r in recordings if not r.is_static_map]
    for r in sorted(timed, key=lambda r: r.sidecar.held_out):
        first.setdefault(*_stated(r.sidecar, model))
    strange = [r for r in timed if _stated(r.sidecar, model)[0] not in loads]
    if strange:
        raise DataError(
            f"{strange[0].name} is held out and carries {_stated(strange[0].sidecar, model)[0]}; the fitted records carry "
            f"{', '.join(map(str, loads))}, so nothing tells what it weighs. Take a record with that load among the fitted ones "
            "(held_out: false), or state its payload"
        )
    found = {}
    for r in timed:
        name, mass = _stated(r.sidecar, model)
        mounted = Mounted(loads.index(name), mass - first[name])
        found[r.name] = mounted if mounted != Mounted() else None
    return found


def with_loads(model: Model, recordings: Sequence[Recording]) -> Model:
    """The model with the loads that these records name, and no other; each begins as the first one.

    Parameters
    ----------
    model : Model
    recordings : sequence of Recording

    Returns
    -------
    Model
        With one mass for each load.
    """
    at_motor, number = carrying(model) != MASS, len(_loads_of(recordings, model)) - 1
    for k in range(1, COUNT + 1):
        name = other_load(k, at_motor=at_motor).name
        if k > number and name in model.effects:
            model = model.without_effect(name)
        elif k <= number and name not in model.effects:
            item = model.parameters[of_load(model, 0)]
            model = model.with_effect(name)
            own = of_load(model, k)
            bounds = (item.low, item.high) if item.low < item.high else (model.parameters[own].low, model.parameters[own].high)
            placed = replace(model.parameters[own], value=item.value, low=bounds[0], high=bounds[1])
            model = replace(model, parameters={**model.parameters, own: placed})
    return model


def load_remarks(recordings: Sequence[Recording], model: Model) -> list[str]:
    """Remarks on the mass of each load by a model with its intervals, and in which records, where these carry different ones.

    Parameters
    ----------
    recordings : sequence of Recording
    model : Model
        As fitted.

    Returns
    -------
    list of str
        One sentence, or none where all carry one load.
    """
    mounted = mounted_by(recordings, model)
    if not any(mounted.values()):
        return []
    unit, words = model.parameters[carrying(model)].unit.replace("2", "²"), []
    for number, load in enumerate(_loads_of(recordings, model)):
        own = [(name, one or Mounted()) for name, one in mounted.items() if (one or Mounted()).number == number]
        named = ", ".join(f"{name} (and {one.more:+.6g} {unit}, stated)" if one.more else name for name, one in own)
        said = f" with {load}" if load.name or any(load.unused) else ""
        words.append(f"{str(model.parameters[of_load(model, number)]).replace('m2', 'm²')} in {named}{said}")
    return [f"The records carry different loads; what moves with them is {'; '.join(words)}."]
