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
from typing import TYPE_CHECKING

import numpy as np

from beltcomm.app.design import ground_of, move_between
from beltcomm.axis.entries import AxisTargets
from beltcomm.axis.terms import PLAIN, Terms
from beltcomm.jobs.design import basis_of
from beltcomm.quantities import mm
from beltcomm.run.record import Drawing
from beltcomm.rundata.store import saved_design
from beltcomm.runfolder import RunFolder
from beltcomm.sentences.own_words import lines_in
from beltcomm.talk import Silence
from beltcomm.tuning.bench import Bench
from beltcomm.verify import PredictedMove, TrackingError, tracking_error

if TYPE_CHECKING:
    import pandas


class MovePrediction(Described):
    """Simulated move in closed loop.

    Parameters
    ----------
    path : PredictedMove
        Its signals.
    targets : AxisTargets
        By which it counts as settled.
    torque_limit_nm : float, N m, motor shaft
        Of the drive.
    words : str
        The move and the run, for titles.
    terms : Terms
        Words and units of the kind of axis, for people.
    """

    def __init__(self, path: PredictedMove, targets: AxisTargets, torque_limit_nm: float, words: str, terms: Terms = PLAIN) -> None:
        self.path, self._targets, self._limit_nm, self._words, self._terms = path, targets, torque_limit_nm, words, terms

    @property
    def error(self) -> TrackingError:
        """At the motor, as travel of the carriage, m."""
        return self.path.error_for(self._targets)

    @property
    def cart_error(self) -> TrackingError:
        """At the carriage, m."""
        return tracking_error(self.path.t_s, self.path.reference_m, self.path.cart_m, self._targets)

    def to_dataframe(self) -> pandas.DataFrame:
        """Its signals as a pandas DataFrame, time as the index.

        Returns
        -------
        pandas.DataFrame
            ``reference_m``, ``motor_m`` (angle times transmission ratio), ``cart_m`` and ``torque_nm`` at the motor shaft.

        Raises
        ------
        UsageError
            pandas is not installed.
        """
        path, made = self.path, import_pandas()
        columns = {"reference_m": path.reference_m, "motor_m": path.motor_m, "cart_m": path.cart_m, "torque_nm": path.torque_nm}
        return made.DataFrame(columns, index=made.Index(path.t_s, name="t_s"))

    def plot(self) -> Drawing:
        """Tracking error at motor and carriage, and the torque, over time."""
        from beltcomm.report import style

        path, said = self.path, self._terms.said
        with style.styled():
            caption = style.Caption("run.predict_move().plot()", "model and gains of the run")
            made = style.figure(said(f"Predicted move: {self._words}"), 4.6, caption)
            upper, lower = made.subplots(2, 1, sharex=True)
            upper.plot(path.t_s, 1e3 * (path.reference_m - path.cart_m), color=style.RESIDUAL, linewidth=0.9, label=said("carriage"))
            upper.plot(path.t_s, 1e3 * (path.reference_m - path.motor_m), color=style.MEASURED, linewidth=0.9, label="motor")
            upper.set_ylabel(said("tracking error in mm"))
            upper.legend(loc="upper right", fontsize=8)
            lower.plot(path.t_s, path.torque_nm, color=style.MEASURED, linewidth=0.9)
            lower.set_ylabel(said("torque in N m"))
            lower.set_xlabel("time in s")
        return Drawing(made)

    def _lines(self) -> list[str]:
        motor, cart, path = self.error, self.cart_error, self.path
        rows = [
            ["following error", mm(motor.dynamic_m), mm(cart.dynamic_m)],
            ["settled error", mm(motor.static_m), mm(cart.static_m)],
            ["overshoot", mm(motor.overshoot_m), mm(cart.overshoot_m)],
        ]
        lines: list[str] = [f"Predicted move: {self._words}", *table(["", ">motor", ">carriage"], rows)]
        lines.append(
            f"torque up to {np.max(np.abs(path.torque_nm)):.3g} of {self._limit_nm:.3g} N m, belt force up to {path.belt_force_n:.3g} N"
        )
        return lines_in(self._terms, [*lines, *(f"The move reaches {bound}." for bound in path.saturated)])


def predict(folder: RunFolder, payload_kg: float, asked: dict[str, float]) -> MovePrediction:
    """The move that was asked for, or the axis's own, predicted with the run's model and gains.

    Parameters
    ----------
    folder : RunFolder
    payload_kg : float, kg
        Mounted beyond that of the records.
    asked : dict of str to float
        Entries of :func:`beltcomm.app.design.move_between`; empty for the axis's own.

    Raises
    ------
    UsageError
        For a move that cannot be.
    DataError
        Without a model or a design.
    """
    ground = ground_of(basis_of(folder.path, Silence()), saved_design(folder))
    bench = Bench(ground)
    if asked:
        bench.drive(move_between(asked, ground))
    (_, path), move = bench.path(ground.present, payload_kg), bench.ground.move
    start, end = 1e3 * move.position_m[0], 1e3 * move.position_m[-1]
    loaded = f", {payload_kg:g} kg more" if payload_kg else ""
    words = f"{start:.0f} to {end:.0f} mm, up to {np.max(np.abs(move.velocity_m_s)):.3g} m/s{loaded}"
    return MovePrediction(path, folder.axis.targets, ground.loop.torque_limit_nm, words, folder.terms)


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
        """A parameter by its full name; raises UsageError naming the nearest."""
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
