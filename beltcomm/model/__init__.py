"""A model of an axis: bodies, effects and their parameters.  Values only; simulation and fitting live elsewhere.

The same shape serves a plant file (the truth behind a virtual axis) and every model revision inside a run folder.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.arrays import Array
from beltcomm.configfiles import find_config, read_yaml
from beltcomm.effects import BELT_DAMPING, BELT_SPRING, BELT_STIFFNESS, DRIVING_END, Body, Effect, Parameter, effect_named
from beltcomm.effects.rigid_load import driven
from beltcomm.errors import UsageError
from beltcomm.model.covariance import Covariance, covariance_from_dict
from beltcomm.model.value import Value
from beltcomm.plant import IDEAL, Instruments, drive_section, drive_values
from beltcomm.recording.columns import Side

#: Bodies that need no effect.  The first body of a model is the driven one.
BASE_BODIES = {
    "motor": Body(
        "motor",
        Parameter("inertia", "kg m2", "motor", 5e-5, 1e-8, 10.0, "motor, coupling, gearbox and driving pulley at the shaft"),
        rotary=True,
    ),
    "cart": Body("cart", Parameter("mass", "kg", "cart", 1.0, 1e-3, 1e4, "carriage with payload"), swings=2e-4),
}
TRANSMISSION = Parameter("ratio", "m/rad", "motor", 0.0125, 1e-5, 10.0, "i_t = r/i_g: travel per radian of the motor (2.16)")

#: Stiffness of the belt by each law that it may have.
BELT_STIFFNESSES = ("belt_stiffness.stiffness", "belt_spans.specific_stiffness", "belt_sections.specific_stiffness")
#: N m/A, N m/V and m/rad, usual values: they only carry bounds and start values over to another side.
_USUAL_CONSTANT, _USUAL_GAIN, _USUAL_RATIO = 0.1, 0.05, 0.0125
#: Unit on the motor side -> (unit, factor of usual numbers) on another one.
_OTHER_SIDE: Mapping[str, Mapping[str, tuple[str, float]]] = {
    "load": {
        "N m": ("N", 1.0 / _USUAL_RATIO),
        "N m s/rad": ("N s/m", 1.0 / _USUAL_RATIO**2),
        "N m/rad": ("N/m", 1.0 / _USUAL_RATIO**2),
        "kg m2": ("kg", 1.0 / _USUAL_RATIO**2),
        "rad": ("m", _USUAL_RATIO),
        "rad/s": ("m/s", _USUAL_RATIO),
        "m/rad": ("1", 1.0 / _USUAL_RATIO),
    },
    "ampere": {
        "N m": ("A", 1.0 / _USUAL_CONSTANT),
        "N m s/rad": ("A s/rad", 1.0 / _USUAL_CONSTANT),
        "N m/rad": ("A/rad", 1.0 / _USUAL_CONSTANT),
        "kg m2": ("A s2/rad", 1.0 / _USUAL_CONSTANT),
    },
    "volt": {
        "N m": ("V", 1.0 / _USUAL_GAIN),
        "N m s/rad": ("V s/rad", 1.0 / _USUAL_GAIN),
        "N m/rad": ("V/rad", 1.0 / _USUAL_GAIN),
        "kg m2": ("V s2/rad", 1.0 / _USUAL_GAIN),
    },
}


@dataclass(frozen=True)
class Model:
    """Bodies, effects in listed order, and a value for each of their parameters (``owner.parameter``).

    Attributes
    ----------
    covariance : Covariance or None
        Of the parameters that a fit found together; None where their intervals are all that is known.

    Raises
    ------
    UsageError
        For an unknown effect, two effects of one group, a missing or unknown parameter, a value out of bounds.
    """

    name: str
    effects: tuple[str, ...]
    parameters: Mapping[str, Value]
    base_bodies: tuple[str, ...] = ("motor", "cart")
    source: str = ""
    side: Side = "motor"
    covariance: Covariance | None = field(default=None, compare=False, repr=False)
    _index: Mapping[str, int] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        expected = expected_parameters(self.effects, self.base_bodies, self.side)
        missing = [name for name in expected if name not in self.parameters]
        unknown = [name for name in self.parameters if name not in expected]
        if missing or unknown:
            parts = [f"is missing {', '.join(missing)}"] if missing else []
            parts += [f"has unknown parameters {', '.join(unknown)}"] if unknown else []
            raise UsageError(f"model {self.name!r} {' and '.join(parts)}; its effects are {', '.join(self.effects)}")
        for name, item in self.parameters.items():
            if not item.low <= item.value <= item.high:
                bounds = f"{item.low:g}..{item.high:g} {item.unit}"
                raise UsageError(f"{name} of model {self.name!r} is {item.value:g} {item.unit}, outside {bounds}")
        if self.covariance is not None and (gone := set(self.covariance.names).difference(expected)):
            object.__setattr__(self, "covariance", self.covariance.without(gone))
        ordered = {name: self.parameters[name] for name in expected}
        object.__setattr__(self, "parameters", ordered)
        object.__setattr__(self, "_index", {name: i for i, name in enumerate(ordered)})

    def __getitem__(self, name: str) -> float:
        """Value of one parameter, SI."""
        return self.parameters[name].value

    def get(self, name: str, default: float = 0.0) -> float:
        """Value of a parameter.

        Parameters
        ----------
        name : str
            Full name, ``effect.parameter``.
        default : float
            Taken when the model has no such effect.

        Returns
        -------
        float
            In the parameter's unit and side.
        """
        return self.parameters[name].value if name in self.parameters else default

    def index(self, name: str) -> int:
        """Position of a parameter in :meth:`vector`.

        Parameters
        ----------
        name : str
            Full name.

        Returns
        -------
        int
            From 0.
        """
        return self._index[name]

    @property
    def rigid(self) -> bool:
        """True if its load moves with the motor without compliance."""
        return "rigid_load" in self.effects

    def driven_inertia(self, vector: Array | None = None) -> float:
        """Inertia of the driven body, with a load that moves with it rigidly:  J + i_t² m, kg m² (kg, A s²/rad).

        Parameters
        ----------
        vector : ndarray (k,) or None
            Values in place of the model's, in the order of :meth:`vector`.

        Returns
        -------
        float
            At the motor shaft.
        """
        own = self._index[self.bodies()[0][0]]
        values = [item.value for item in self.parameters.values()] if vector is None else vector
        if not self.rigid:
            return float(values[own])
        ratio = float(values[self._index["transmission.ratio"]])
        return driven(float(values[own]), ratio, float(values[self._index["cart.mass"]]))

    def vector(self) -> Array:
        """All values in their fixed order, float64."""
        return np.array([item.value for item in self.parameters.values()])

    def effect_list(self) -> tuple[Effect, ...]:
        """The effects themselves, in order."""
        return tuple(effect_named(name) for name in self.effects)

    def bodies(self) -> tuple[tuple[str, Body], ...]:
        """(full name of the inertia parameter, body) of all bodies; the driven one first."""
        return body_list(self.effects, self.base_bodies)

    def with_values(self, values: Mapping[str, float], origin: str = "") -> Model:
        """Model with other numbers; intervals and covariance of the changed ones are dropped.

        Parameters
        ----------
        values : dict of str to float
            By full name.
        origin : str
            Where the values come from, in words; "" keeps what stood there.

        Returns
        -------
        Model
            A new model.

        Raises
        ------
        UsageError
            For a name that is no parameter.
        """
        changed = {}
        for name, value in values.items():
            if name not in self.parameters:
                raise UsageError(f"model {self.name!r} has no parameter {name}; it has {', '.join(self.parameters)}")
            old = self.parameters[name]
            low, high = (float(value), float(value)) if old.low == old.high else (old.low, old.high)  # what is held is held there
            changed[name] = replace(old, value=float(value), low=low, high=high, interval=None, origin=origin or old.origin)
        covariance = self.covariance and self.covariance.without(changed)
        return replace(self, parameters={**self.parameters, **changed}, covariance=covariance)

    def with_vector(self, vector: Array) -> Model:
        """Model with the values of :meth:`vector`, kept within their bounds.

        Parameters
        ----------
        vector : ndarray (k,)
            In the order of ``names``.

        Returns
        -------
        Model
            A new model.
        """
        items = zip(self.parameters.items(), vector, strict=True)
        values = {name: replace(item, value=float(min(max(value, item.low), item.high))) for (name, item), value in items}
        return replace(self, parameters=values)

    def with_effect(self, name: str, values: Mapping[str, float] | None = None, origin: str = "start value") -> Model:
        """The model with one more effect.

        Parameters
        ----------
        name : str
            Of the effect.
        values : dict of str to float or None
            By own parameter name; None for the start values.
        origin : str
            Where the values come from, in words.

        Returns
        -------
        Model
            A new model.
        """
        effect = effect_named(name)
        parameters = self.parameters_of(effect)
        added = _default_values(parameters, values or {}, origin)
        return replace(self, effects=(*self.effects, name), parameters={**self.parameters, **added})

    def parameters_of(self, effect: Effect) -> dict[str, Parameter]:
        """Parameters that an effect brings or has brought.

        Parameters
        ----------
        effect : Effect
            The effect.

        Returns
        -------
        dict of str to Parameter
            By full name, in the units of this model's side.
        """
        return {key: on_side(item, self.side) for key, item in effect_parameters(effect).items()}

    def with_fixed(self, name: str) -> Model:
        """The model with a parameter that no fit moves: without room between its bounds.

        Parameters
        ----------
        name : str
            Full name.

        Returns
        -------
        Model
            A new model.
        """
        known = replace(self.parameters[name], low=self[name], high=self[name])
        return replace(self, parameters={**self.parameters, name: known})

    def with_forms(self, name: str) -> Model:
        """The model with the forms of one effect's law free to be fitted: see ``Parameter.form``.

        Parameters
        ----------
        name : str
            Of the effect.

        Returns
        -------
        Model
            A new model.
        """
        forms = {key: p for key, p in self.parameters_of(effect_named(name)).items() if p.form}
        freed = {key: replace(self.parameters[key], low=p.low, high=p.high) for key, p in forms.items()}
        return replace(self, parameters={**self.parameters, **freed})

    def without_effect(self, name: str) -> Model:
        """The model without that effect and those that complete it.

        Parameters
        ----------
        name : str
            Of the effect.

        Returns
        -------
        Model
            A new model.
        """
        gone = {name, *effect_named(name).completed_by}
        dropped = {key for e in gone for key in effect_parameters(effect_named(e))}
        kept = {key: item for key, item in self.parameters.items() if key not in dropped}
        for effect in (e for e in self.effect_list() if name in e.completed_by and e.name not in gone):
            size = effect.full_names()[0]
            if kept[size].low == kept[size].high:  # all of it acted where that part did; now it has to be able to act itself
                kept[size] = _default_values({size: self.parameters_of(effect)[size]}, {}, "start value")[size]
        return replace(self, effects=tuple(e for e in self.effects if e not in gone), parameters=kept)

    def to_dict(self) -> dict[str, Any]:
        """Plain dictionary for YAML."""
        return {
            "name": self.name,
            "source": self.source,
            **({} if self.side == "motor" else {"side": self.side}),
            "bodies": list(self.base_bodies),
            "effects": list(self.effects),
            "parameters": {
                name: {
                    "value": item.value,
                    "unit": item.unit,
                    "side": item.side,
                    "low": item.low,
                    "high": item.high,
                    "interval": item.interval,
                    "origin": item.origin,
                }
                for name, item in self.parameters.items()
            },
            **({} if self.covariance is None else {"covariance": self.covariance.to_dict()}),
        }


def body_list(effects: Iterable[str], base_bodies: Iterable[str]) -> tuple[tuple[str, Body], ...]:
    """Bodies of a combination of effects.

    Parameters
    ----------
    effects : iterable of str
        Names.
    base_bodies : iterable of str
        Bodies that are there without an effect, the driven one first.

    Returns
    -------
    tuple of (str, Body)
        Full name of the inertia parameter and body: the base bodies, then those that effects bring.
    """
    return _body_list(tuple(effects), tuple(base_bodies))


@lru_cache(maxsize=256)
def _body_list(effects: tuple[str, ...], base_bodies: tuple[str, ...]) -> tuple[tuple[str, Body], ...]:
    bodies = [(f"{name}.{BASE_BODIES[name].inertia.name}", BASE_BODIES[name]) for name in base_bodies]
    for effect in map(effect_named, effects):
        bodies += [(f"{body.name}.{body.inertia.name}", body) for body in effect.bodies]
    return tuple(bodies)


def effect_parameters(effect: Effect) -> dict[str, Parameter]:
    """Parameters that an effect brings into a model.

    Parameters
    ----------
    effect : Effect

    Returns
    -------
    dict of str to Parameter
        By full name, in units of the motor side: inertias of its bodies, then its own.
    """
    own = {f"{body.name}.{body.inertia.name}": body.inertia for body in effect.bodies}
    own |= dict(zip(effect.full_names(), effect.parameters, strict=True))
    return own


def on_side(parameter: Parameter, side: Side) -> Parameter:
    """The parameter of a motor-side law in the units of another side: the laws only know coordinates and forces.

    Start and bounds are carried over with a usual transmission, for ampere with a usual torque constant.

    Parameters
    ----------
    parameter : Parameter
        In units of the motor side.
    side : Side
        To which the torque of the model's records refers.

    Returns
    -------
    Parameter
        As it is where its unit is that of both sides.
    """
    if side == "motor" or parameter.unit not in _OTHER_SIDE[side]:
        return parameter
    unit, scale = _OTHER_SIDE[side][parameter.unit]
    return replace(parameter, unit=unit, start=parameter.start * scale, low=parameter.low * scale, high=parameter.high * scale)


def expected_parameters(effects: Iterable[str], base_bodies: Iterable[str], side: Side = "motor") -> dict[str, Parameter]:
    """Parameters of a combination of effects.

    Parameters
    ----------
    effects, base_bodies : iterable of str
        Names.
    side : Side
        Whose units they have.

    Returns
    -------
    dict of str to Parameter
        By full name, in their fixed order.

    Raises
    ------
    UsageError
        On a clash.
    """
    return {name: on_side(parameter, side) for name, parameter in _motor_parameters(effects, base_bodies).items()}


def _motor_parameters(effects: Iterable[str], base_bodies: Iterable[str]) -> dict[str, Parameter]:
    effects = tuple(effects)
    expected = {f"{name}.{BASE_BODIES[name].inertia.name}": BASE_BODIES[name].inertia for name in base_bodies}
    expected["transmission.ratio"] = TRANSMISSION
    taken: dict[str, str] = {}
    for effect in map(effect_named, effects):
        if effect.group and effect.group in taken:
            raise UsageError(f"{taken[effect.group]} and {effect.name} are both a {effect.group}: a model can have only one")
        taken[effect.group] = effect.name
        for name, parameter in effect_parameters(effect).items():
            if name in expected:
                raise UsageError(f"{effect.name} brings {name} a second time: each effect can be in a model once")
            expected[name] = parameter
    bodies = {body.name for _, body in body_list(effects, base_bodies)}
    for effect in map(effect_named, effects):
        # Without a belt the carriage is the driven body itself.
        body = "" if effect.slot == "force" and effect.body == "cart" and "cart" not in bodies else effect.body
        touched = {body, *(end for element in effect.elements for end in element.ends)} - {"", DRIVING_END}
        if not touched <= bodies:
            lacking = ", ".join(sorted(touched - bodies))
            raise UsageError(f"{effect.name} acts on {lacking}, which this model does not have; it has {', '.join(sorted(bodies))}")
        if effect.slot in ("belt_law", "kinematics") and BELT_SPRING not in taken:
            raise UsageError(f"{effect.name} needs a belt, which this model does not have; add belt_stiffness first")
        for used in effect.uses:
            if used not in expected and used != BELT_DAMPING and not (used == BELT_STIFFNESS and BELT_SPRING in taken):
                raise UsageError(f"{effect.name} needs {used}, which this model does not have; add {used.split('.')[0]} first")
    return expected


def _default_values(parameters: Mapping[str, Parameter], values: Mapping[str, float], origin: str) -> dict[str, Value]:
    """Values at their start, or as given by full name or by bare parameter name, without intervals; a form is held there."""
    found = {}
    for name, p in parameters.items():
        value = float(values.get(name, values.get(p.name, p.start)))
        low, high = (value, value) if p.form else (p.low, p.high)
        found[name] = Value(value, p.unit, p.side, low, high, None, origin)
    return found


def build_model(
    name: str,
    effects: Iterable[str],
    values: Mapping[str, float],
    *,
    base_bodies: tuple[str, ...] = ("motor", "cart"),
    origin: str = "",
    side: Side = "motor",
) -> Model:
    """A model from plain numbers.

    Parameters
    ----------
    name : str
        Of the model.
    effects : iterable of str
        Names.
    values : mapping of str to float
        By full parameter name, in the units of ``side``; parameters that are left out stand at their start value.
    base_bodies : tuple of str
        The driven body first.
    origin : str
        Where the numbers are from.
    side : Side
        To which the torque of the model's records refers.

    Returns
    -------
    Model
        Without intervals.

    Raises
    ------
    UsageError
        For a value of a parameter that the effects do not have.
    """
    effects = tuple(effects)
    expected = expected_parameters(effects, base_bodies, side)
    unknown = [key for key in values if key not in expected]
    if unknown:
        raise UsageError(f"model {name!r} has no parameter {', '.join(unknown)}; it has {', '.join(expected)}")
    return Model(name, effects, _default_values(expected, values, origin), base_bodies, side=side)


def model_from_dict(data: Mapping[str, Any]) -> Model:
    """Inverse of :meth:`Model.to_dict`.  Bounds and units that are left out come from the effect.

    Parameters
    ----------
    data : mapping
        As read from YAML or JSON.

    Returns
    -------
    Model
        With the usual form of a law that had no other when the file was written.

    Raises
    ------
    UsageError
    """
    try:
        effects = tuple(data["effects"])
        base_bodies = tuple(data.get("bodies", ("motor", "cart")))
        side = data.get("side", "motor")
        if side != "motor" and side not in _OTHER_SIDE:
            raise UsageError(f"side is {side!r}; it is one of motor, {', '.join(_OTHER_SIDE)}")
        expected = expected_parameters(effects, base_bodies, side)
        # A model from before a law had other forms has the usual one.
        usual = {name: p for name, p in expected.items() if p.form and name not in data["parameters"]}
        parameters = _default_values(usual, {}, "usual form")
        for name, item in data["parameters"].items():
            if name not in expected:
                raise UsageError(f"model {data.get('name')!r} has an unknown parameter {name}; it needs {', '.join(expected)}")
            known = expected[name]
            if not isinstance(item, Mapping):
                raise UsageError(f"{name} is {item!r}; give a mapping with its value: {{value: 1.0}}, in {known.unit}")
            for key in ("value", "low", "high", "interval"):
                _plain_number(f"{name}.{key}", item.get(key), known.unit)
            interval = item.get("interval")
            parameters[name] = Value(
                float(item["value"]),
                str(item.get("unit", known.unit)),
                str(item.get("side", known.side)),
                float(item.get("low", known.low)),
                float(item.get("high", known.high)),
                None if interval is None else float(interval),
                str(item.get("origin", "")),
            )
            if parameters[name].unit != known.unit:
                raise UsageError(f"{name} is given in {parameters[name].unit!r}; it must be in {known.unit!r}")
        covariance = covariance_from_dict(data.get("covariance"))
        if covariance is not None and (unknown := set(covariance.names).difference(expected)):
            raise UsageError(f"model {data.get('name')!r} has a covariance of {', '.join(sorted(unknown))}, which it does not have")
        return Model(str(data["name"]), effects, parameters, base_bodies, str(data.get("source", "")), side, covariance)
    except KeyError as error:
        raise UsageError(f"not a model file (it has no entry {error.args[0]!r}); it holds name, effects and parameters") from error
    except (AttributeError, TypeError, ValueError) as error:
        raise UsageError(f"not a model file ({error}); it holds name, effects and parameters") from error


def _plain_number(key: str, value: object, unit: str) -> None:
    """Raise UsageError for a value with its unit behind it and the like; a number that is left out is found by who needs it."""
    try:
        float(value) if value is not None else 0.0  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise UsageError(f"{key} is {value!r}; give a plain number in {unit}, without the unit") from None


@dataclass(frozen=True)
class PlantFile:
    """The truth behind a virtual axis: a model and the drive's imperfections.

    Attributes
    ----------
    setpoint_delay_s : float, s
        Torque setpoint to acting torque.
    torque_noise_nm : float
        N m rms on the reported torque.
    start_position_m : float, m
        Place of the carriage when the drive is switched on.
    brake_torque_nm : float, N m
        Of the motor's holding brake, 0 for none.
    brake_time_s : float, s
        In which it opens or closes.
    motor : dict of str to float
        Of its nameplate rated_torque_nm, peak_torque_nm, rated_current_a, max_speed_rpm; what is missing is that of the thesis's motor.
    instruments : Instruments
        What else lies between setpoint, torque, reading and angle.
    """

    model: Model
    setpoint_delay_s: float
    torque_noise_nm: float
    counts_per_rev: int
    start_position_m: float = 0.25
    brake_torque_nm: float = 0.0
    brake_time_s: float = 0.0
    motor: Mapping[str, float] = field(default_factory=dict)
    instruments: Instruments = IDEAL

    def drive_section(self) -> dict[str, Any]:
        """The ``drive`` section of its file."""
        return drive_section(vars(self))


def load_plant(name: str | Path, drive: Mapping[str, object] | None = None) -> PlantFile:
    """Load ``configs/plants/NAME.yaml`` or a path.

    Parameters
    ----------
    name : str or Path
        Of a shipped plant, or a path.
    drive : dict of str to object or None
        Entries that stand in for those of its drive section.

    Raises
    ------
    UsageError
    """
    path = find_config("plants", str(name))
    data = read_yaml(path)
    model = _model_in(path, data)
    try:
        return PlantFile(model, **drive_values({**(data.get("drive") or {}), **(drive or {})}))
    except UsageError as error:
        raise UsageError(f"the drive section of {path}{', as given,' if drive else ''} cannot be: {error}") from error
    except (AttributeError, TypeError, ValueError) as error:
        raise UsageError(f"the drive section of {path} is unreadable: {error}") from error


def load_model(path: Path | str) -> Model:
    """Load a model or plant file.

    Parameters
    ----------
    path : Path or str
        YAML file.

    Returns
    -------
    Model
        Of a plant file, the model in it.

    Raises
    ------
    UsageError
        That names the file.
    """
    return _model_in(Path(path), read_yaml(Path(path)))


def _model_in(path: Path, data: Mapping[str, Any]) -> Model:
    try:
        return model_from_dict(data)
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from error
