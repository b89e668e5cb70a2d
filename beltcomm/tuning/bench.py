"""From settings to designs, curves of a loop and predictions; what is expensive is computed once per payload, prefilter and T_R."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from beltcomm.arrays import Array, BoolArray, ComplexArray, decibels, runs_of
from beltcomm.control import Cascade, Prefilter
from beltcomm.design.cascade import DesignResult, best_cascade, candidate_prefilters
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.knobs import KnobPlants, Knobs, gains_of_knobs, highest_position_margin, specification_of, suppression_range
from beltcomm.design.loops import closed_loop_inputs, frequencies, loop_shape, open_loops, sample_plants
from beltcomm.design.margins import Margins, WorstMargins, margins_on, worst_of
from beltcomm.design.specification import Specification
from beltcomm.errors import Refused, UsageError
from beltcomm.sending import Sent, grid_of, predict_sent, reference_for
from beltcomm.trajectory import Trajectory
from beltcomm.tuning.ground import RANGES, TITLES, UNITS, DesignInput, SliderSetting, key_of
from beltcomm.verify import PredictedMove, TrackingError, tracking_error

#: Points of the open loops before refinement, of the responses over time; N m of the torque step at the motor.
_LINES, _MOMENTS = 160, 240
DISTURBANCE_NM = 0.1
#: s, spans to choose from, and how many time constants of position loop and integrator they show.
SPANS_S = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
_TIME_CONSTANTS = 6.0


@dataclass(frozen=True)
class OpenLoops:
    """Gain, dB, and phase, deg, unwrapped from 0, of the open velocity and position loop over freq_hz; ndarray (n,)."""

    freq_hz: Array
    velocity_db: Array
    velocity_deg: Array
    position_db: Array
    position_deg: Array


@dataclass(frozen=True)
class Responses:
    """Over t_s, ndarray (n,).

    Attributes
    ----------
    position : ndarray
        Motor angle on a step of its reference, without feedforward, as a share of it.
    velocity : ndarray
        The same of the velocity loop alone, the step not filtered.
    disturbance_m : ndarray
        Motor, at the carriage, on ``DISTURBANCE_NM`` at the motor, m.
    """

    t_s: Array
    position: Array
    velocity: Array
    disturbance_m: Array


def open_loop_curves(plant: DesignPlant, cascade: Cascade, period_s: float) -> OpenLoops:
    """Both open loops on a grid that is fine around resonance and antiresonance, up to π/T."""
    omega = frequencies([plant], period_s, _LINES)[0]
    omega = np.unique(omega[omega >= 1.0])
    velocity, position = open_loops(plant, cascade, period_s, omega)
    return OpenLoops(omega / (2.0 * math.pi), *_bode(velocity), *_bode(position))


def span_s(cascade: Cascade) -> float:
    """Time within which the loop has settled, from ``SPANS_S``."""
    slowest = max(1.0 / cascade.kpp_1_s, cascade.kp_nm_s_rad / cascade.ki_nm_rad / 3.0)
    return next((span for span in SPANS_S if span >= _TIME_CONSTANTS * slowest), SPANS_S[-1])


def responses(plant: DesignPlant, cascade: Cascade, period_s: float, span: float) -> Responses:
    """Steps at t = 0 of the linear loop over ``span`` s, exactly sampled, every so many periods that some 240 are left."""
    stride = max(round(span / period_s / _MOMENTS), 1)
    count = round(span / period_s / stride) + 1
    matrix, reference, torque = closed_loop_inputs(plant, cascade, period_s)
    position = _stepped(matrix, cascade.kpp_1_s * reference, stride, count)[:, 0]
    disturbance = _stepped(matrix, DISTURBANCE_NM * torque, stride, count)[:, 0]
    alone, reference, _ = closed_loop_inputs(plant, replace(cascade, kpp_1_s=0.0), period_s)
    velocity = _stepped(alone, reference, stride, count)[:, _speed(plant)]
    return Responses(period_s * stride * np.arange(count, dtype=np.float64), position, velocity, plant.transmission_m_rad * disturbance)


def _stepped(matrix: Array, column: Array, stride: int, count: int) -> Array:
    """States (count, N) of x[k+1] = M x[k] + column from rest, every ``stride`` steps."""
    n = len(column)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n], block[n, n] = matrix, column, 1.0
    leap = np.linalg.matrix_power(block, stride)
    states, state = np.zeros((count, n + 1)), np.eye(1, n + 1, n)[0]
    for k in range(count):
        states[k] = state
        state = leap @ state
    return states[:, :n]


def _speed(plant: DesignPlant) -> int:
    """Place of the motor's speed in the plant's state."""
    return 1 if plant.bodies is None else len(plant.state_space()[1]) // 2


def _bode(loop: ComplexArray) -> tuple[Array, Array]:
    """Gain, dB, and phase, deg, the first within 0 .. −360."""
    phase = np.degrees(np.unwrap(np.angle(loop)))
    return decibels(loop), phase - 360.0 * math.ceil(phase[0] / 360.0 - 0.125)


#: Grid points per plant of the search and of the margins shown; a design that is saved is proven on more.
_SEARCH_POINTS, _SHOWN_POINTS = 220, 500

#: deg and dB by which knobs stand below what gains have, tried in turn: a corner of what is possible is no place for a slider.
_INSIDE = (0.0, 0.3, 1.0, 3.0)

#: Points of a tracking error that is drawn.
_DRAWN = 400
T = TypeVar("T")

#: deg and dB between points of the table.
_MARGIN_STEP, _SUPPRESSION_STEP = 2.0, 0.5


@dataclass(frozen=True)
class CascadeView:
    """One cascade: gains, worst margins, curves on the plant that is looked at."""

    cascade: Cascade
    worst: WorstMargins
    open_loops: OpenLoops
    responses: Responses


@dataclass(frozen=True)
class TrackingPrediction:
    """Predicted errors of the move, and how they run, mm over s, at motor and carriage.

    Attributes
    ----------
    saturated : tuple of str
        Bounds of the drive reached.
    """

    error: TrackingError
    cart_error: TrackingError
    t_s: np.ndarray
    motor_mm: np.ndarray
    cart_mm: np.ndarray
    speed_m_s: np.ndarray
    saturated: tuple[str, ...]


class Bench:
    """One run on the bench.   Safe to use from several threads."""

    def __init__(self, ground: DesignInput) -> None:
        self.ground = ground
        self._kept: dict[tuple[Any, ...], Any] = {}
        self._locks: dict[tuple[Any, ...], threading.Lock] = {}
        self._lock = threading.Lock()
        self._last: tuple[SliderSetting, DesignResult] | None = None
        #: Where the sliders stood first: there they mean the present design, to the last digit.
        self._untouched: SliderSetting | None = None

    def prefilters(self, payload_kg: float) -> dict[str, Prefilter]:
        """The prefilters of the drive, laid out for this payload, by key."""
        plants = self._plants(payload_kg).proof.plants
        centre = min(plant.resonance_rad_s for plant in plants)
        return {key_of(p, centre): p for p in candidate_prefilters(plants, self.ground.structure, Specification())}

    def design(self, setting: SliderSetting) -> DesignResult:
        """The gains of the knobs on all variants.

        Raises
        ------
        OutOfReach
            With the limit that the knobs meet.
        UsageError
            For a prefilter that the drive lacks.
        """
        key = replace(setting, loaded=False, position_m=0.0)
        last = self._last
        if last is None or last[0] != key:
            plants = self._plants(setting.payload_kg)
            found = gains_of_knobs(plants, self._prefilter(setting), setting.velocity_filter_s, setting.knobs)
            if key == self._untouched:
                found = replace(found, cascade=self.ground.present, margins=margins_on(self.ground.present, plants.proof))
            self._last = last = (key, found)
        return last[1]

    def shown(self, setting: SliderSetting) -> tuple[DesignResult, CascadeView, CascadeView]:
        """The design of a setting, its curves and those of the run's present design, over the same times.

        Raises
        ------
        OutOfReach, UsageError
            As :meth:`design`.
        """
        design = self.design(setting)
        present = self.ground.present
        span = max(span_s(design.cascade), span_s(present))
        return design, self._shown(design.cascade, design.margins, setting, span), self.present(setting, span)

    def present(self, setting: SliderSetting, span: float | None = None) -> CascadeView:
        """The run's present design where the setting looks, with step responses of ``span`` s; None for what the design itself needs."""
        cascade, place = self.ground.present, (setting.payload_kg, setting.shown_kg, setting.position_m)
        span = span or span_s(cascade)
        margins = self.once(("margins", setting.payload_kg), lambda: margins_on(cascade, self._plants(setting.payload_kg).proof))
        return self.once(("present", *place, span), lambda: self._shown(cascade, margins, setting, span))

    def path(self, cascade: Cascade, shown_kg: float) -> tuple[Sent, PredictedMove]:
        """The move with the gains of a cascade and the feedforward of the mass mounted, as ``verify`` sends and predicts it."""
        ground = self.ground
        model = ground.model.with_values({"cart.mass": ground.model["cart.mass"] + shown_kg}) if shown_kg else ground.model
        known = cascade == ground.present and ground.driven is not None
        running = ground.driven if known and ground.driven is not None else ground.with_feedforward(cascade)
        sent = reference_for(ground.model, running, ground.move, ground.loop, ground.sending, ground.time_s)
        return sent, predict_sent(model, running, sent, ground.loop, time_s=ground.time_s)

    def tracked(self, cascade: Cascade, shown_kg: float) -> TrackingPrediction:
        """The tracking error of :meth:`path`."""
        ground = self.ground
        sent, path = self.path(cascade, shown_kg)
        wanted, carriage = path.reference_m, grid_of(sent.motor, ground.loop).in_loop(sent.carriage.position_m)
        every = max(len(wanted) // _DRAWN, 1)
        return TrackingPrediction(
            path.error_for(ground.targets),
            tracking_error(path.t_s, carriage, path.cart_m, ground.targets),
            path.t_s[::every],
            1e3 * (wanted - path.read_m)[::every],
            1e3 * (carriage - path.cart_m)[::every],
            sent.carriage.velocity_m_s[::every],
            path.saturated,
        )

    def drive(self, move: Trajectory) -> None:
        """Another move whose error is predicted from now on."""
        with self._lock:
            self.ground = replace(self.ground, move=move)
            self._kept = {key: kept for key, kept in self._kept.items() if key[0] != "tracked"}

    def present_tracked(self, shown_kg: float) -> TrackingPrediction:
        """:meth:`tracked` of the run's present design."""
        return self.once(("tracked", shown_kg), lambda: self.tracked(self.ground.present, shown_kg))

    def reach(self, setting: SliderSetting) -> Reach:
        """Range of each slider while the others stay, and advice where the setting has no design."""
        prefilter, lag, plants = self._prefilter(setting), setting.velocity_filter_s, self._plants(setting.payload_kg)
        table = self.once(("table", setting.payload_kg, prefilter, lag), lambda: _table_of(plants, prefilter, lag))
        return _reach_of(table, setting, plants, prefilter)

    def start(self, payload_kg: float, position_m: float) -> SliderSetting:
        """The setting at which the sliders give the run's present design, as nearly as they can.

        ``payload_kg`` is the largest that the design must take; the curves are looked at with the carriage at ``position_m``.
        """
        cascade = self.ground.present
        centre = min(plant.resonance_rad_s for plant in self._plants(payload_kg).proof.plants)
        named = key_of(cascade.prefilter, centre)
        found = SliderSetting(60.0, 80.0, -10.0, named, cascade.velocity_filter_s, payload_kg, payload_kg > 0.0, position_m)
        if named not in self.prefilters(payload_kg):
            found = replace(found, prefilter=next(iter(self.prefilters(payload_kg))))
        placed = self.standing(found, margins_on(cascade, self._plants(payload_kg).proof))
        if named == placed.prefilter:
            self._untouched, self._last = replace(placed, loaded=False, position_m=0.0), None
        return placed

    def standing(self, setting: SliderSetting, margins: tuple[Margins, ...]) -> SliderSetting:
        """The setting with the knobs where they give gains of these margins back, a little inside what is possible where they must be."""
        worst = worst_of(margins)
        for inside in _INSIDE:
            wanted = Knobs(worst.phase_margin_deg - inside, worst.position_phase_margin_deg - inside, worst.suppression_db - 0.3 * inside)
            placed = setting.turned(_placed(wanted))
            try:
                self.design(placed)
            except Refused:
                continue
            return placed
        return placed

    def best(self, setting: SliderSetting, asked: Specification) -> SliderSetting | None:
        """The setting of the stiffest loop that meets a specification with one of its prefilters; None where there is none."""
        plants = self._plants(setting.payload_kg)
        found = best_cascade(plants.search, plants.proof, self.ground.structure, asked)
        if found is None:
            return None
        cascade, margins = found
        centre = min(plant.resonance_rad_s for plant in plants.proof.plants)
        named = replace(setting, prefilter=key_of(cascade.prefilter, centre), velocity_filter_s=cascade.velocity_filter_s)
        return self.standing(named, margins)

    def _shown(self, cascade: Cascade, margins: tuple[Margins, ...], setting: SliderSetting, span: float) -> CascadeView:
        plant, period = self._looked_at(setting), self.ground.structure.period_s
        return CascadeView(cascade, worst_of(margins), open_loop_curves(plant, cascade, period), responses(plant, cascade, period, span))

    def _looked_at(self, setting: SliderSetting) -> DesignPlant:
        """The plant at the place and with the load that is looked at, with the friction of the moving axis."""
        place = (setting.position_m, setting.shown_kg)
        plants = self.once(("place", *place), lambda: self.ground.plants([place[0]], [place[1]]))
        return plants[1] if len(plants) > 2 else plants[0]

    def _plants(self, payload_kg: float) -> KnobPlants:
        """All variants, those that are the same but for their name once."""

        def sampled() -> KnobPlants:
            extra = [0.0, payload_kg] if payload_kg else [0.0]
            single = {replace(plant, name=""): plant for plant in self.ground.plants(self.ground.ends_m, extra)}
            plants, period = list(single.values()), self.ground.structure.period_s
            shown = sample_plants(plants, period, _SHOWN_POINTS)
            return KnobPlants(sample_plants(plants, period, _SEARCH_POINTS), shown, self.ground.structure)

        return self.once(("plants", payload_kg), sampled)

    def _prefilter(self, setting: SliderSetting) -> Prefilter:
        known = self.prefilters(setting.payload_kg)
        if setting.prefilter not in known:
            raise UsageError(f"there is no prefilter {setting.prefilter!r} here; choose {' or '.join(known)}")
        return known[setting.prefilter]

    def once(self, key: tuple[Any, ...], make: Callable[[], T]) -> T:
        """Value of ``make``, made once; whoever comes meanwhile waits.   A new move may drop a kind, the first entry of ``key``."""
        with self._lock:
            lock = self._locks.setdefault(key, threading.Lock())
        with lock:
            if key not in self._kept:
                self._kept[key] = make()
        kept: T = self._kept[key]
        return kept


def _placed(knobs: Knobs) -> Knobs:
    """On the sliders' steps of 0.1, on the safe side, within their ranges."""
    values = {name: float(np.clip(math.floor(10.0 * getattr(knobs, name)) / 10.0, *limits)) for name, limits in RANGES.items()}
    return Knobs(**values)


@dataclass(frozen=True)
class FeasibilityTable:
    """possible[i, j] : whether the velocity loop can have margins_deg[i] at suppressions_db[j]."""

    margins_deg: Array
    suppressions_db: Array
    possible: BoolArray


@dataclass(frozen=True)
class Reach:
    """Pieces (low, high) of each knob's range that have a design.

    Attributes
    ----------
    advice : str
        Where the nearest ones are, "" where all is well.
    """

    pieces: dict[str, list[tuple[float, float]]]
    advice: str


def _table_of(plants: KnobPlants, prefilter: Prefilter, velocity_filter_s: float) -> FeasibilityTable:
    """Velocity loops possible with one prefilter and T_R, on all plants; about a second."""
    shape = loop_shape(plants.search, prefilter, velocity_filter_s)
    (low, high), (least, most) = RANGES["phase_margin_deg"], RANGES["suppression_db"]
    margins, suppressions = np.arange(low, high + 1e-9, _MARGIN_STEP), np.arange(least, most + 1e-9, _SUPPRESSION_STEP)
    asked = specification_of(Knobs(), prefilter, velocity_filter_s)
    rows = [suppression_range(shape, plants.structure, replace(asked, phase_margin_deg=float(m)), suppressions) for m in margins]
    return FeasibilityTable(margins, suppressions, np.array(rows))


def _reach_of(table: FeasibilityTable, setting: SliderSetting, plants: KnobPlants, prefilter: Prefilter) -> Reach:
    """Reach of the knobs of a setting."""
    column = table.possible[:, int(np.argmin(np.abs(table.suppressions_db - setting.suppression_db)))]
    row = table.possible[int(np.argmin(np.abs(table.margins_deg - setting.phase_margin_deg)))]
    pieces = {
        "phase_margin_deg": _pieces(table.margins_deg, column),
        "suppression_db": _pieces(table.suppressions_db, row),
    }
    asked = specification_of(setting.knobs, prefilter, setting.velocity_filter_s)
    shape = loop_shape(plants.search, prefilter, setting.velocity_filter_s)
    low, high = RANGES["position_phase_margin_deg"]
    most = min(highest_position_margin(shape, plants.structure, asked), high)
    pieces["position_phase_margin_deg"] = [(low, most)] if most > low else []
    return Reach(pieces, _advice(setting, pieces, most == 0.0))


def _advice(setting: SliderSetting, pieces: dict[str, list[tuple[float, float]]], no_velocity_loop: bool) -> str:
    names = ("phase_margin_deg", "suppression_db") if no_velocity_loop else ("position_phase_margin_deg",)
    if not no_velocity_loop and any(low <= setting.position_phase_margin_deg <= high for low, high in pieces[names[0]]):
        return ""
    ways = [way for name in names if (way := _way(name, getattr(setting, name), pieces[name]))]
    if ways:
        return f"Possible with the other sliders as they are: {', or '.join(ways)}."
    return "Nothing is possible with the other sliders as they are: lower both phase margins, or choose another prefilter or filter time."


def _way(name: str, value: float, pieces: list[tuple[float, float]]) -> str:
    """Way that one slider would have to go."""
    if not pieces:
        return ""
    low, high = min(pieces, key=lambda piece: max(piece[0] - value, value - piece[1]))
    unit = UNITS[name]
    return f"{TITLES[name]} {'at most' if value > high else 'at least'} {high if value > high else low:.1f} {unit}"


def _pieces(values: Array, possible: BoolArray) -> list[tuple[float, float]]:
    """Runs of neighbours that are possible."""
    return [(float(values[start]), float(values[end - 1])) for start, end in runs_of(possible)]
