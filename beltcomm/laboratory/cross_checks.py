"""Cross-checks of a fitted model: data sheets, resonances, its cogging against a static map, the bound of friction.

A second sensor at the load is a witness of the compliance before it, which no fit uses:

    motor angle = i (load + (J / k) load acceleration + (d / k) load speed + friction / k) + zero,      each behind one low-pass

i : gear ratio, whatever the two sensors count in.   J / k : 1 / (2 pi f)² of the load on a held motor, the antiresonance of the motor's
response.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Array, ComplexArray
from beltcomm.axis import Axis
from beltcomm.effects import EFFECTS, AxisSummary
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.noise.decimation import smallest_step
from beltcomm.fit.start.low_pass import REACH, legible, smooth
from beltcomm.fit.start.model import knows_stiffness
from beltcomm.fit.uncertainty.intervals import with_intervals
from beltcomm.laboratory.score import Scorer
from beltcomm.model import Model
from beltcomm.model.linear import modes, operating_point, values_of
from beltcomm.recording import Recording
from beltcomm.recording.sampling import encoder_grid

#: rad/s: speed of the linearisation, anything at which friction slides.
SLIDING_RAD_S = 1.0
#: Angles tried for the zero of a map, per turn.
ZEROS = 2000
#: Correlation from which a map confirms the orders.
CONFIRMED = 0.9
#: Ratio of the loudness of two excited records from which they show an amplitude dependence.
LOUDER = 1.5
#: Error over noise up to which a fitted number is worth comparing with a data sheet, and its relative half interval.
COMPARABLE, KNOWN_TO = 1.5, 0.1
#: Relative difference that data sheets may have: of the inertia on the motor's side, of the belt's stiffness (by its strands and the
#: clamps); and of the inertia where no record is excited.
INERTIA_SHEET, STIFFNESS_SHEET, UNEXCITED = 0.2, 0.3, 0.5
#: ln of the quotient of two factors that are one, and of a factor and a known one.
ONE_FACTOR, KNOWN_FACTOR = 0.3, 0.15
#: Quotient of two numbers of counts that are one.
SAME_COUNTS = 1.01


@dataclass(frozen=True)
class SheetDoubt:
    """A number of axis.yaml that the records contradict.

    Attributes
    ----------
    entry : str
        Its key.
    sheet, found, interval
        In ``unit``; interval None where it is not known.
    factor : float
        Found over sheet.
    common : str
        What may be wrong where inertia and stiffness are off alike, else "".
    """

    entry: str
    unit: str
    sheet: float
    found: float
    interval: float | None
    factor: float
    common: str = ""


def sheet_doubts(model: Model, ratio: float, axis: Axis, recordings: Sequence[Recording]) -> tuple[SheetDoubt, ...]:
    """Contradictions between the fitted model and the data sheets.

    Inertia and stiffness are known to the motor only times the scale of the torque and over that of the angle: where both are off by one
    factor, the scale is wrong.  A wrong radius shows in the stiffness alone, k ~ 1/r², and so does a wrong belt.

    Parameters
    ----------
    model : Model
        With intervals.
    ratio : float
        Its error over the noise.
    axis : Axis
    recordings : sequence of Recording
    """
    if "cart" not in model.base_bodies:
        return _rigid_doubts(axis, recordings)
    if model.side != "motor" or ratio > COMPARABLE:
        return ()
    excited = any(r.sidecar.experiment == "frf" and not r.sidecar.held_out for r in recordings)
    inertia = stiffness = None
    if axis.get("motor.inertia_kg_m2") is not None and "coupling" not in model.effects:
        sheet = axis.motor_side_inertia_kg_m2
        inertia = _doubt(model, "motor.inertia", "motor.inertia_kg_m2", sheet, INERTIA_SHEET if excited else UNEXCITED)
    places = [r.sidecar.start_position_m for r in recordings if r.sidecar.experiment == "frf" and r.sidecar.start_position_m is not None]
    known = knows_stiffness(axis)
    if excited and known and places and "belt_stiffness" in model.effects:
        # one stiffness was fitted to all places: it stands for those in the middle, and is doubted where it suits none of them
        first, usual, last = (axis.belt_stiffness_n_m(float(place)) for place in np.percentile(places, [25.0, 50.0, 75.0]))
        ends = min(first, last), max(first, last)
        stiffness = _doubt(model, "belt_stiffness.stiffness", "belt.specific_stiffness_n", usual, STIFFNESS_SHEET, ends)
    if inertia and stiffness and abs(math.log(inertia.factor / stiffness.factor)) < ONE_FACTOR:
        factor = math.sqrt(inertia.factor * stiffness.factor)
        common = _scale_words(factor, axis)
        inertia, stiffness = replace(inertia, common=common), replace(stiffness, common=common)
    return tuple(doubt for doubt in (inertia, stiffness) if doubt is not None)


def _rigid_doubts(axis: Axis, recordings: Sequence[Recording]) -> tuple[SheetDoubt, ...]:
    """Of an axis without a belt: the angle comes in the steps of its encoder.

    Its inertia has the load in it, which no data sheet knows; one below the motor's own is refused before anything is fitted.
    """
    counts = axis.get("motor.encoder_counts_per_rev")
    steps = [step for r in recordings if r.side != "load" and (step := encoder_grid(r.position)) is not None]
    if counts is None or not steps:
        return ()
    sheet, seen = float(counts), math.tau / min(steps)
    quotient = max(seen, sheet) / min(seen, sheet)
    # a coarser reading of the same encoder is none other
    if seen < SAME_COUNTS * sheet and abs(quotient - round(quotient)) < SAME_COUNTS - 1.0:
        return ()
    return (SheetDoubt("motor.encoder_counts_per_rev", "per turn", sheet, seen, None, seen / sheet),)


def doubts_of(fitted: Fitted, axis: Axis, recordings: Sequence[Recording]) -> tuple[SheetDoubt, ...]:
    """Data-sheet values that a fitted model contradicts.

    Parameters
    ----------
    fitted : Fitted
    axis : Axis
    recordings : sequence of Recording
        Of the fit.
    """
    return sheet_doubts(with_intervals(fitted), fitted.ratio, axis, recordings)


def _doubt(
    model: Model, name: str, entry: str, sheet: float, tolerance: float, ends: tuple[float, float] | None = None
) -> SheetDoubt | None:
    """A number beside its sheet where that and a tolerance contradict it; of a sheet with two ends, where both do."""
    item, (low, high) = model.parameters.get(name), ends or (sheet, sheet)
    if item is None or item.interval is None or item.interval > KNOWN_TO * item.value or low <= 0.0:
        return None
    near = min(max(item.value, low), high)
    if near / (1.0 + tolerance) <= item.value + item.interval and item.value - item.interval <= near * (1.0 + tolerance):
        return None
    return SheetDoubt(entry, item.unit, sheet, item.value, item.interval, item.value / sheet)


def _scale_words(factor: float, axis: Axis) -> str:
    """Explanation, in words, of a common factor of inertia and stiffness."""
    constant, rated = axis.get("motor.torque_constant_nm_a"), axis.get("motor.rated_torque_nm")
    known = {math.tau: "the angle in revolutions instead of rad", math.pi / 180.0: "the angle in degrees instead of rad"}
    known |= {1e3: "the torque in mN m", 1e-3: "the torque in kN m"}
    if constant:
        known |= {1.0 / float(constant): "the current in A instead of the torque", float(constant): "the torque constant counted twice"}
    if rated:
        known |= {1.0 / float(rated): "the torque as a share of the rated torque", float(rated): "the rated torque counted twice"}
    words = " or ".join(text for other, text in known.items() if abs(math.log(factor / other)) < KNOWN_FACTOR)
    return words or "the scale of the torque or of the angle"


@dataclass(frozen=True)
class Resonances:
    """Hz, of the motor's response, ascending."""

    antiresonance_hz: tuple[float, ...]
    resonance_hz: tuple[float, ...]


def resonances(model: Model, position_m: float) -> Resonances | None:
    """Resonances of a model with the motor held and free, Hz; None for one rigid body.

    Parameters
    ----------
    model : Model
        With any bodies.
    position_m : float, m
        Carriage on the axis.

    Returns
    -------
    Resonances or None
        Forces that depend on the place (cogging, a cable) are left out: they shift no resonance of the belt.
    """
    if len(model.bodies()) < 2:
        return None
    for effect in model.effect_list():
        if effect.slot == "force" and effect.slope is not None:
            by_position, _ = cast("tuple[float, float]", effect.slope(0.1, 1.0, 0.0, *values_of(model, effect, position_m)))
            if by_position != 0.0:
                model = model.without_effect(effect.name)
    point = operating_point(model, position_m, SLIDING_RAD_S)
    held, free = (tuple(mode.freq_hz for mode in modes(model, point, held=bodies)) for bodies in (("motor",), ()))
    return Resonances(held, free)


def amplitudes_fitted(recordings: Sequence[Recording]) -> bool:
    """True if the excited records to fit were made at amplitudes that differ: else no dependence on amplitude can be told.

    Parameters
    ----------
    recordings : sequence of Recording
        Held-out ones do not count.
    """
    loud = [float(np.std(r.torque)) for r in recordings if r.sidecar.experiment == "frf" and not r.sidecar.held_out]
    return len(loud) > 1 and max(loud) > LOUDER * min(loud)


@dataclass(frozen=True)
class MapOrder:
    """Amplitudes of one order, N m.

    Attributes
    ----------
    turned_rad : float
        Angle by which the map's wave runs ahead of the model's, of the order's own period.
    """

    order: float
    model: float
    map: float
    turned_rad: float


@dataclass(frozen=True)
class MapCheck:
    """A map of the holding torque against the model's cogging.

    Attributes
    ----------
    correlation : float
        Of both as waves over one turn.
    zero_rad : float
        Angle by which the map's zero had to be turned for it.
    """

    record: str
    correlation: float
    zero_rad: float
    orders: tuple[MapOrder, ...]

    @property
    def is_confirmed(self) -> bool:
        """True if the map shows what the model says."""
        return self.correlation > CONFIRMED


def map_checks(recordings: Sequence[Recording], model: Model) -> tuple[MapCheck, ...]:
    """Every static map against the cogging of the model, which was fitted to motion only; () without either.

    The holding torque is that of the cogging with the sign turned, Σ sine sin(N θ) + cosine cos(N θ); the zero of the map's angle need
    not be that of the records (another index), so it is found first: one number for all orders.

    Parameters
    ----------
    recordings : sequence of Recording
        Of a run; static maps are taken.
    model : Model
        With its cogging.

    Returns
    -------
    tuple of MapCheck
        One for each map.
    """
    present = [e.name for e in model.effect_list() if e.harmonic == "load"]
    orders = np.array([model[f"{name}.order"] for name in present if f"{name}.order" in model.parameters])
    waves = np.array([complex(model[f"{n}.cosine"], -model[f"{n}.sine"]) for n in present if f"{n}.order" in model.parameters])
    if not len(orders):
        return ()
    return tuple(_map_check(r, orders, waves) for r in recordings if r.is_static_map)


def _map_check(record: Recording, orders: Array, waves: ComplexArray) -> MapCheck:
    """One map; waves: w of the torque Re Σ w exp(j N θ)."""
    angle = record.position
    columns = np.concatenate([np.cos(np.outer(angle, orders)), -np.sin(np.outer(angle, orders)), np.ones((len(angle), 1))], axis=1)
    found = np.linalg.lstsq(columns, record.torque, rcond=None)[0]
    seen = found[: len(orders)] + 1j * found[len(orders) : -1]
    zeros = np.linspace(0.0, 2.0 * math.pi, ZEROS, endpoint=False)
    alike = np.real(np.exp(1j * np.outer(zeros, orders)) @ (np.conj(seen) * waves))
    best = int(np.argmax(alike))
    turned = waves * np.exp(1j * zeros[best] * orders)
    rest = float(np.linalg.norm(record.torque - np.mean(record.torque)) * math.sqrt(2.0 / len(angle)))
    listed = tuple(
        MapOrder(float(n), float(abs(w)), float(abs(s)), float(np.angle(s / w))) for n, w, s in zip(orders, turned, seen, strict=True)
    )
    return MapCheck(record.name, float(alike[best] / (np.linalg.norm(waves) * rest)), float(zeros[best]), listed)


def friction_bound(fitted: Fitted, ground: AxisSummary) -> float:
    """Share of the squares that any further law of friction over speed and direction could explain, to first order; 0 to 1.

    Parameters
    ----------
    fitted : Fitted
    ground : AxisSummary
        Of the axis, for the trials.
    """
    bounds = [effect for effect in EFFECTS if effect.bound and effect.name not in fitted.model.effects]
    scorer = Scorer(fitted)
    drops = [way.drop for effect in bounds for way in scorer.score(effect, ground)]
    return 1.0 - math.exp(-max(drops, default=0.0) / fitted.problem.samples)


#: Deviations beyond which J / k is known; s, length of a block whose sums are independent, fewest of them; share to be explained.
CERTAIN, BLOCK_S, FEWEST_BLOCKS, EXPLAINED = 4.0, 0.2, 10, 0.5
#: Share by which the model's antiresonance may be another one.
SAME = 0.05


@dataclass(frozen=True)
class SecondSensor:
    """The load's own oscillation by its sensor.

    Attributes
    ----------
    column : str
        Of the sensor.
    antiresonance_hz : float, Hz
        Of the load on a held motor.
    interval_hz : float, Hz
        Half its 95 % interval.
    explained : float
        Share of what no rigid gear explains of the motor angle, 0 to 1.
    model_hz : float or None, Hz
        The model's, nearest to it; None of one rigid body.
    """

    column: str
    antiresonance_hz: float
    interval_hz: float
    explained: float
    model_hz: float | None = None

    @property
    def confirms(self) -> bool:
        """True if the model has it, too."""
        room = max(SAME * self.antiresonance_hz, self.interval_hz)
        return self.model_hz is not None and abs(self.model_hz - self.antiresonance_hz) < room


def second_sensor(recordings: Sequence[Recording], model_hz: Sequence[float] = ()) -> SecondSensor | None:
    """By all records with one; None where it shows no compliance, or hardly any.

    Parameters
    ----------
    recordings : sequence of Recording
        Those without a sensor at the load tell nothing.
    model_hz : sequence of float, Hz
        Antiresonances of the model.

    Returns
    -------
    SecondSensor or None
    """
    for column in ("load_position_rad", "cart_position_m"):
        parts = [part for r in recordings if (part := _rows(r, getattr(r, column))) is not None]
        if not parts:
            continue
        rows, motor, blocks = (np.concatenate([part[k] for part in parts]) for k in (0, 1, 2))
        first = np.cumsum([0, *(int(part[2][-1]) + 1 for part in parts)])
        blocks += np.repeat(first[:-1], [len(part[2]) for part in parts])
        found = np.linalg.lstsq(rows, motor, rcond=None)[0]
        left, rigid = motor - rows @ found, motor - rows[:, 1:] @ np.linalg.lstsq(rows[:, 1:], motor, rcond=None)[0]
        explained = 1.0 - float(left @ left) / float(rigid @ rigid)
        # of neighbouring rows only the sums over a block are independent
        scores = np.column_stack([np.bincount(blocks, weights=row * left) for row in rows.T])
        inverse = np.linalg.pinv(rows.T @ rows)
        error = math.sqrt(max(float((inverse @ (scores.T @ scores) @ inverse)[0, 0]), 0.0)) / abs(float(found[1]))
        own = float(found[0] / found[1])
        if len(scores) < FEWEST_BLOCKS or explained < EXPLAINED or not own > CERTAIN * error:
            continue
        hertz = 1.0 / (math.tau * math.sqrt(own))
        near = min(model_hz, key=lambda one: abs(math.log(one / hertz)), default=None)
        return SecondSensor(column, hertz, hertz * error / own, explained, near)
    return None


def _rows(record: Recording, sensor: Array | None) -> tuple[Array, Array, NDArray[np.intp]] | None:
    """Regressors (n, 4), motor angle (n,) and numbers of the blocks (n,) of a record, all of mean 0; None where it moves too little."""
    if sensor is None or record.is_static_map or len(record.gaps) or np.ptp(sensor) == 0.0 or record.side == "load":
        return None
    sample = record.sample_period_s
    width = max(legible(values, sample, smallest_step(values))[0] for values in (record.position, sensor))
    motor, load = smooth(record.position, width), smooth(sensor, width)
    speed = np.gradient(load, sample)
    inside = slice(round(REACH * width), len(load) - round(REACH * width))
    columns = np.column_stack([np.gradient(speed, sample), load, speed, smooth(np.sign(speed), width)])[inside]
    motor = motor[inside]
    if len(motor) * sample < FEWEST_BLOCKS * BLOCK_S:
        return None
    blocks = (np.arange(len(motor)) * sample / BLOCK_S).astype(np.intp)
    return columns - columns.mean(axis=0), motor - motor.mean(), blocks
