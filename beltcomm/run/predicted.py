"""A move of a run's model under the run's gains: no machine is needed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from beltcomm.app.design import ground_of, move_between
from beltcomm.axis.entries import AxisTargets
from beltcomm.axis.terms import PLAIN, Terms
from beltcomm.jobs.design import basis_of
from beltcomm.quantities import mm
from beltcomm.result import Described, table
from beltcomm.run.record import Drawing, import_pandas
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
        The run folder.
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
