"""The model of a run as an object: each parameter with its interval, and the linear system that other tools take."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from beltcomm.configfiles import did_you_mean
from beltcomm.errors import UsageError
from beltcomm.given import number
from beltcomm.model import Model
from beltcomm.model.linear import StateSpace, operating_point, state_space
from beltcomm.model.value import Value
from beltcomm.result import Described, table, with_unit
from beltcomm.run.record import import_pandas

if TYPE_CHECKING:
    import control
    import pandas

#: Speed at the motor, rad/s, at which a model is linearised: friction slides.
SLIDING_RAD_S = 20.0


class RunModel(Described, Mapping[str, Value]):
    """A model's parameters: by full name as of a mapping, by a short one as attributes (``mass``, ``stiffness``).

    Parameters
    ----------
    model : Model
        What simulation and fit work with.
    travel_m : tuple of float or None
        Lowest and highest place of the carriage, m; None where the axis names none.
    """

    def __init__(self, model: Model, travel_m: tuple[float, float] | None = None) -> None:
        self.model, self._travel_m = model, travel_m

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects in it."""
        return self.model.effects

    def __getitem__(self, name: str) -> Value:
        """A parameter by its full name.

        Raises
        ------
        UsageError
            Naming the nearest.
        """
        if name not in self.model.parameters:
            known = list(self.model.parameters)
            raise UsageError(f"the model has no parameter {name!r}{did_you_mean(name, known)}; it has {', '.join(known)}")
        return self.model.parameters[name]

    def __contains__(self, name: object) -> bool:
        return name in self.model.parameters

    def __iter__(self) -> Iterator[str]:
        return iter(self.model.parameters)

    def __len__(self) -> int:
        return len(self.model.parameters)

    def __getattr__(self, name: str) -> Value:
        if name.startswith("_") or name == "model":
            raise AttributeError(name)
        found = self._short().get(name, [])
        if len(found) == 1:
            return self.model.parameters[found[0]]
        if found:
            raise AttributeError(f"{name} is several parameters of this model: {', '.join(found)}; write model[{found[0]!r}]")
        known = sorted(short for short, full in self._short().items() if len(full) == 1)
        raise AttributeError(f"the model has no {name}{did_you_mean(name, known)}; it has {', '.join(known)}")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *(short for short, full in self._short().items() if len(full) == 1)]

    def _short(self) -> dict[str, list[str]]:
        """Full names by what stands behind the dot, and by the whole with an underscore."""
        found: dict[str, list[str]] = {}
        for full in self.model.parameters:
            found.setdefault(full.rpartition(".")[2], []).append(full)
            found.setdefault(full.replace(".", "_"), []).append(full)
        return found

    def to_control(self, position: float, *, speed: float = SLIDING_RAD_S) -> control.StateSpace:
        """The linear system around a position, for the package ``control``.

        Parameters
        ----------
        position : float, m
            Carriage on the axis, within its travel.
        speed : float, rad/s, motor shaft
            At which friction slides.

        Returns
        -------
        control.StateSpace
            From motor torque, N m, to motor angle, rad, and carriage position, m.  The drive's dead time is not in it.

        Raises
        ------
        UsageError
            The package is not installed, nothing moves at that speed, or the axis has no such place.
        """
        found = self.linear(position, speed=speed)
        try:
            from control import ss
        except ImportError:
            raise UsageError("the package control is not installed: pip install control; .linear(position) needs none") from None
        return ss(found.A, found.B, found.C, found.D, states=list(found.states), inputs=["torque"], outputs=["motor_angle", "carriage"])

    def linear(self, position: float, *, speed: float = SLIDING_RAD_S) -> StateSpace:
        """The model as matrices, linearised at a place.

        Parameters
        ----------
        position : float, m
            Carriage on the axis, within its travel.
        speed : float, rad/s, motor shaft
            At which friction slides.

        Returns
        -------
        StateSpace
            State space from motor torque to motor angle and carriage.

        Raises
        ------
        UsageError
            Nothing moves at that speed, or the axis has no such place.
        """
        at, sliding = number(position, "position", "m"), number(speed, "speed", "rad/s")
        if not sliding:
            raise UsageError("speed is 0: friction that sticks has no linear law; give the speed at which the axis moves, in rad/s")
        if self._travel_m is not None and not self._travel_m[0] <= at <= self._travel_m[1]:
            low, high = self._travel_m
            raise UsageError(f"position is {at:g} m, outside the travel {low:g} to {high:g} m; give the carriage's place in m")
        return state_space(self.model, operating_point(self.model, at, sliding))

    def to_dataframe(self) -> pandas.DataFrame:
        """All parameters as a pandas DataFrame, one a row.

        Returns
        -------
        pandas.DataFrame
            By full name: ``value``, ``low_95`` and ``high_95`` (the ends of its 95 % interval, NaN for what was not estimated), ``unit``,
            ``side`` and ``origin``.

        Raises
        ------
        UsageError
            pandas is not installed.
        """
        rows = {}
        for name, one in self.model.parameters.items():
            low, high = one.interval_95 or (math.nan, math.nan)
            rows[name] = {"value": one.value, "low_95": low, "high_95": high, "unit": one.unit, "side": one.side, "origin": one.origin}
        frame = import_pandas().DataFrame.from_dict(rows, orient="index")
        return frame.rename_axis("parameter")

    def _lines(self) -> list[str]:
        rows = []
        for name, one in self.model.parameters.items():
            half = "" if one.interval_95 is None else f"± {one.interval:.2g}"
            rows.append([name, f"{one.value:.5g}", half, with_unit("", one.unit).strip(), one.origin])
        return [f"Model {self.model.name}: {', '.join(self.effects)}", *table(["parameter", ">value", "95 %", "unit", "origin"], rows)]
