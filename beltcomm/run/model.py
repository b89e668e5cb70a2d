"""The model of a run as an object: each parameter with its interval, and the linear system that other tools take."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from beltcomm.configfiles import did_you_mean
from beltcomm.errors import UsageError
from beltcomm.given import number
from beltcomm.model import Model, Value
from beltcomm.model.linear import StateSpace, operating_point, state_space
from beltcomm.result import html_of, table, with_unit

#: Speed at the motor, rad/s, at which a model is linearised: friction slides.
SLIDING_RAD_S = 20.0


class RunModel(Mapping[str, Value]):
    """A model's parameters: by full name as of a mapping, by a short one as attributes (``mass``, ``stiffness``).

    Parameters
    ----------
    model : Model
        What simulation and fit work with.
    """

    def __init__(self, model: Model) -> None:
        self.model = model

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

    def __getattr__(self, name: str) -> Any:
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

    def to_control(self, position: float, *, speed: float = SLIDING_RAD_S) -> Any:
        """The linear system around a position, for the package ``control``.

        Parameters
        ----------
        position : float
            Of the carriage, m.
        speed : float
            Of the motor, rad/s; friction slides.

        Returns
        -------
        control.StateSpace
            From motor torque, N m, to motor angle, rad, and carriage position, m.  The drive's dead time is not in it.

        Raises
        ------
        UsageError
            The package is not installed, or nothing moves at that speed.
        """
        found = self.linear(position, speed=speed)
        try:
            import control
        except ImportError:
            raise UsageError("the package control is not installed: pip install control; .linear(position) needs none") from None
        return control.ss(
            found.A, found.B, found.C, found.D, states=list(found.states), inputs=["torque"], outputs=["motor_angle", "carriage"]
        )

    def linear(self, position: float, *, speed: float = SLIDING_RAD_S) -> StateSpace:
        """The model as matrices, linearised at a place.

        Parameters
        ----------
        position : float, m
            Carriage on the axis.
        speed : float, rad/s, motor shaft

        Returns
        -------
        StateSpace
            State space from motor torque to motor angle and carriage.
        """
        at, sliding = number(position, "position", "m"), number(speed, "speed", "rad/s")
        if not sliding:
            raise UsageError("speed is 0: friction that sticks has no linear law; give the speed at which the axis moves, in rad/s")
        return state_space(self.model, operating_point(self.model, at, sliding))

    def __repr__(self) -> str:
        return "\n".join(self._lines())

    def _repr_html_(self) -> str:
        return html_of(self._lines())

    def _lines(self) -> list[str]:
        rows = []
        for name, one in self.model.parameters.items():
            half = "" if one.interval is None or not math.isfinite(one.interval) else f"± {one.interval:.2g}"
            rows.append([name, f"{one.value:.5g}", half, with_unit("", one.unit).strip(), one.origin])
        return [f"Model {self.model.name}: {', '.join(self.effects)}", *table(["parameter", ">value", "95 %", "unit", "origin"], rows)]
