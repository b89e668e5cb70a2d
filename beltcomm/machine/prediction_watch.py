"""Largest motion expected of an excitation, watched row by row: the first row beyond it ends the rise of the amplitude."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from beltcomm.drive import Capabilities, Row
from beltcomm.errors import SafetyStop
from beltcomm.identify.amplitude import Prediction

#: A prediction is the worst case of a whole family of models: a machine that goes this many times further is not of the family.
#: Less than predicted is no fault: the family holds carriages a hundred times apart in mass.
SURPRISE = 3.0
#: m added, for what no model knows before the first record: slow drift, a belt that creeps back.
TRAVEL_SLACK_M = 1e-3
#: Moving rows without which nothing is said of the inertia, and the factor from which it is called wrong.
FEWEST_ROWS = 6
WRONG_INERTIA = 2.0

#: The belt's force as the rows show it may exceed the axis' limit by this factor, beside friction, over so many
#: rows: torque noise and encoder steps are no force.
BELT_BEYOND = 1.25
BELT_ROWS = 4


class BeltWatch:
    """Call it with every row of any motion: the force in the belt as the motor shows it,  F = (τ - Θ_e φ̈)/i_t, friction in it.

    Parameters
    ----------
    ratio : float
        m/rad.
    inertia_kg_m2 : float
        Motor side, as axis.yaml says.
    limit_n : float
        Of the axis.
    friction : tuple[float, float]
        Coulomb, N m, and viscous, N m s/rad, of motor and carriage at the motor: what limits of belts leave out.

    Raises
    ------
    SafetyStop
        When the mean of ``BELT_ROWS`` rows is beyond 1.25 F_max + (τ_c + d |φ̇|)/i_t.
    """

    def __init__(self, ratio: float, inertia_kg_m2: float, limit_n: float, friction: tuple[float, float]) -> None:
        self.ratio, self.inertia_kg_m2, self.limit_n = ratio, inertia_kg_m2, limit_n
        self.friction = friction
        self._rows: list[tuple[float, float, float]] = []
        self._forces: list[float] = []

    def __call__(self, row: Row) -> None:
        """One row as the drive gives it.   Raises SafetyStop."""
        rows = self._rows
        rows.append((row[0], row[1], row[3]))
        if len(rows) < 3:
            return
        (t0, torque0, at0), (t1, torque1, at1), (t2, _, at2) = rows
        del rows[0]
        if t2 - t1 > 1.5 * (t1 - t0) or t1 - t0 > 1.5 * (t2 - t1):  # a row was lost
            self._forces.clear()
            return
        acceleration = (at2 - 2.0 * at1 + at0) / ((t2 - t1) * (t1 - t0))
        forces = self._forces
        forces.append((0.5 * (torque0 + torque1) - self.inertia_kg_m2 * acceleration) / self.ratio)
        if len(forces) < BELT_ROWS:
            return
        force = abs(sum(forces) / BELT_ROWS)
        del forces[0]
        coulomb, viscous = self.friction
        if force > BELT_BEYOND * self.limit_n + (coulomb + viscous * abs(row[4])) / self.ratio:
            raise SafetyStop(
                f"the belt carries about {force:.0f} N, the limit of axis.yaml is {self.limit_n:.0f} N; the axis was stopped; if the "
                "carriage hit something, clear its way; if the encoder's position jumped, check its cable; if the loop rings, look at its "
                "gains; else look at motor.inertia_kg_m2 and the pulley's radius in axis.yaml",
                "belt force",
            )


class PredictionWatch:
    """Call it with every row of a record.

    Parameters
    ----------
    predicted : Prediction
        Of the record.
    ratio : float
        m/rad at the motor.
    inertia_kg_m2 : float
        Of the motor side, as axis.yaml says.
    units : DriveUnits or None
        Of the drive.
    rigid : bool
        The load moves with the motor.

    Raises
    ------
    SafetyStop
        When speed or travel leave the prediction, naming what is probably wrong in axis.yaml or in the units.
    """

    def __init__(
        self, predicted: Prediction, ratio: float, inertia_kg_m2: float, units: DriveUnits | None = None, *, rigid: bool = False
    ) -> None:
        self.predicted, self.ratio, self.inertia_kg_m2, self.units, self.rigid = predicted, ratio, inertia_kg_m2, units, rigid
        self.farthest_m = SURPRISE * predicted.travel_m + TRAVEL_SLACK_M
        self._rows: list[tuple[float, float, float]] = []

    def __call__(self, row: Row) -> None:
        """One row as the drive gives it.   Raises SafetyStop."""
        self._rows.append((row[0], row[1], row[3]))
        speed, travel = abs(self.ratio * row[4]), abs(self.ratio * (row[3] - self._rows[0][2]))
        if speed > self.predicted.watched_m_s:
            self._stop("speed", "speed", speed, self.predicted.watched_m_s, "m/s")
        if travel > self.farthest_m:
            self._stop("position", "way", 1e3 * travel, 1e3 * self.farthest_m, "mm")

    def _stop(self, reason: str, what: str, value: float, limit: float, unit: str) -> None:
        seen, most = _told_apart(value, limit)
        raise SafetyStop(
            f"the {what} of {seen} {unit} is more than the {most} {unit} that were to be expected at most; "
            f"the axis was stopped and the amplitude is not raised further; {self.cause()}",
            reason,
        )

    def cause(self) -> str:
        """Probable fault by the rows so far, in words."""
        return _suspects(self.inertia_kg_m2, _measured_inertia(np.array(self._rows)), self.units, rigid=self.rigid)


def _told_apart(value: float, limit: float) -> tuple[str, str]:
    """Both numbers with three digits, or as many more as it takes to see that they differ."""
    for digits in range(3, 9):
        shown = f"{value:.{digits}g}", f"{limit:.{digits}g}"
        if shown[0] != shown[1]:
            break
    return shown


def _measured_inertia(rows: np.ndarray) -> tuple[float, float] | None:
    """Motor-side inertia and its standard deviation, kg m², by  φ̈ = (τ - c sign φ̇ - d)/J  from rows (t, τ, φ); None when it cannot tell.

    The belt is soft against the steps of an excitation, so the carriage hardly counts.   rows : (n, 3), s, N m, rad, motor shaft.
    """
    if len(rows) < 3:
        return None
    period = float(np.median(np.diff(rows[:, 0])))
    turned = rows[2:, 2] - rows[:-2, 2]
    moving = turned != 0.0
    if moving.sum() < FEWEST_ROWS:
        return None
    acceleration = (np.diff(rows[:, 2], 2) / period**2)[moving]
    # the torque of a row acts until the next one, so a second difference sees the mean of two
    torque = (0.5 * (rows[:-2, 1] + rows[1:-1, 1]))[moving]
    regressor = np.stack([torque, np.sign(turned[moving]), np.ones(len(torque))], axis=1)
    found, *_ = np.linalg.lstsq(regressor, acceleration, rcond=None)
    rest = acceleration - regressor @ found
    deviation = float(np.sqrt(rest @ rest / (len(rest) - 3) * np.linalg.pinv(regressor.T @ regressor)[0, 0]))
    if not found[0] > 3.0 * deviation:  # also a torque of nothing
        return None
    return 1.0 / float(found[0]), deviation / float(found[0]) ** 2


class DriveUnits(NamedTuple):
    """Meaning of a drive's raw numbers.

    Attributes
    ----------
    thousand_nm : float
        A thousand units of torque, N m.
    per_turn : int
        Position units of a turn.
    """

    thousand_nm: float
    per_turn: int


def units_of(capabilities: Capabilities) -> DriveUnits:
    """The units that a drive's torques and positions are taken for.

    Parameters
    ----------
    capabilities : Capabilities
    """
    return DriveUnits(1e3 * (capabilities.torque_step_nm or math.nan), capabilities.counts_per_rev)


def other_units(share: float, units: DriveUnits) -> str:
    """Units that would make an inertia of so many times that of the data sheets right, in words.

    Parameters
    ----------
    share : float
        Inertia found over that of the data sheets.
    units : DriveUnits
        As the drive's are taken now.
    """
    return (
        f"a thousand units of torque would be {units.thousand_nm / share:.3g} N m instead of {units.thousand_nm:.3g} N m (thousandths of "
        f"the drive's peak?), or a turn {units.per_turn / share:.3g} position units instead of {units.per_turn} (turn the motor once by "
        "hand): torque_scale or position_unit of a profile says so (beltcomm drives --new FILE, then --profile FILE)"
    )


def _suspects(stated_kg_m2: float, measured: tuple[float, float] | None, units: DriveUnits | None = None, *, rigid: bool = False) -> str:
    """In words, which entries of axis.yaml to look at, with the measured inertia where there is one.

    ``rigid``: the load moves with the motor, and what is measured is the inertia of both.
    """
    others = "the feed constant (pulley.effective_radius_m, gearbox.ratio), the payload, whether the encoder jumped or something moves it"
    if measured is None:
        return f"look at motor.inertia_kg_m2 in axis.yaml, {others}"
    value, deviation = measured
    if rigid and value > stated_kg_m2:
        return (
            f"motor and load together show an inertia of about {value:.2g} ± {2.0 * deviation:.1g} kg m², of which the motor has "
            f"{stated_kg_m2:.3g} kg m² by axis.yaml: if that can be the load, there is less friction than the excitation before it showed, "
            f"so begin again, or check {others}"
        )
    seen = (
        f"the motor side shows an inertia of about {value:.2g} ± {2.0 * deviation:.1g} kg m², axis.yaml makes it {stated_kg_m2:.3g} kg m²"
    )
    if max(value / stated_kg_m2, stated_kg_m2 / value) > WRONG_INERTIA:
        unit = f"; where those are right, {other_units(value / stated_kg_m2, units)}" if units else ""
        return (
            f"{seen}: check the unit of motor.inertia_kg_m2 (and of coupling and pulley){unit}; then {others}. A gap looks like this too: "
            "hold the motor and move the carriage by hand; if there is free play, mend clamp, key or coupling first; `beltcomm diagnose "
            "RUN` looks for it in what was recorded"
        )
    return f"{seen}, so rather check {others}"
