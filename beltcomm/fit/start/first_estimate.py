"""First estimate of an axis from a short record, and the torque path with which it leaves least."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_erosion
from scipy.optimize import minimize, nnls

from beltcomm.arrays import Array
from beltcomm.axis import Axis
from beltcomm.errors import DataError
from beltcomm.fit.noise.level import torque_noise
from beltcomm.fit.path_fit.choice import EXPLAINED, reads_command
from beltcomm.fit.path_fit.trial_paths import times_tried, ways_of
from beltcomm.fit.residual.encoder_jumps import CERTAIN, Jump, largest_step, refuse
from beltcomm.fit.residual.segment import Segment, segments
from beltcomm.fit.residual.whitened import evaluate_each
from beltcomm.fit.start.low_pass import fine, legible, smooth
from beltcomm.fit.start.rigid import rigid_estimate
from beltcomm.fit.start.undersampled import clearly_moves, comes_seldom, first_of_seldom
from beltcomm.fit.torque.lag import Lag
from beltcomm.fit.torque.laws import DriveLaw
from beltcomm.fit.torque.path import FAITHFUL, TorquePath
from beltcomm.fit.torque.reading_fit import clear_gain, fit_reading
from beltcomm.model import BASE_BODIES, Model, build_model, expected_parameters
from beltcomm.model.value import Value
from beltcomm.recording import Recording
from beltcomm.simulate.stopping import unknown_loads_kg, usual_load_kg

#: The effects that every belt axis gets; what else is needed is found by comparing with measurements.  Viscous friction of the
#: carriage is not among them: seen from the motor it differs from that of the motor only next to the antiresonance.
BASE_EFFECTS = ("belt_stiffness", "belt_damping", "viscous", "viscous_cart", "coulomb", "cart_friction")
#: Those of an axis without compliance.
RIGID_EFFECTS = ("rigid_load", "viscous", "coulomb")
#: kg: carriages between these are tried.  N/m: belts between these shares of the data sheet's stiffness are tried.
MASSES_KG = np.geomspace(0.1, 100.0, 25)
STIFFNESS_SHARES = np.geomspace(0.3, 4.0, 16)
#: Around how many of every second point of the grid its neighbours are tried.
NEARER = 6
#: How many points of the grid are refined; moving samples without which nothing is tried; how far the inertia may leave the sheet's.
REFINED = 3
SHORT_REFINEMENT, LONGEST_REFINEMENT = 60, 160
#: Trials that are evaluated at once: as many as the belt's kernel takes in one step.
SIDE_BY_SIDE = 16
FEWEST_SAMPLES = 100
#: rad: a motor that turned by this has moved, whatever few samples show it.
CLEARLY_MOVED_RAD = 0.05
#: Between which inertia is looked for, over the data sheet's, and how near to a bound is at it.
INERTIA_SHARES = (0.5, 2.0)
#: N m: no torque of a belt axis; a trial whose motion runs away reaches it.
RUNAWAY_NM = 1e6
#: Share of the acceleration that its rounding may be: a belt's resonance needs a wide band, and a start may be off by the square of this.
ROUNDING = 0.3
#: rad that the motor swings on a held carriage, by the data sheet, between two rows: more, and the rows do not show it.
SWINGING = 1.2
#: By what share the squares may rise for a stiffness one factor e nearer the data sheet's: it decides where a record does not show any.
SHEET_WEIGHT = 1e-3
#: Widths of a low-pass over which it smears the friction of a reversal, and less where too few samples are left.
SMEARED = (2.0, 1.0, 0.0)
#: N at the carriage, from where its friction is looked for when none is expected.
LEAST_FRICTION_N = 0.1
#: What the data sheets must tell of any axis.
NEEDED = ("motor.inertia_kg_m2", "pulley.effective_radius_m", "belt.specific_stiffness_n", "belt.pulley_distance_m")
#: m/rad, travel of the belt axes that the bounds of the effects were made for; how far beyond the loads counted with a fit may go; damping
#: ratio of a screw, rack or coupling.
USUAL_RATIO, LOADS_BEYOND, USUAL_DAMPING = 0.0125, 10.0, 0.02
#: Parameters that the torque equation is linear in, beside the inertia; and those it is not.
_LINEAR = ("coulomb.level", "viscous.damping")
_NONLINEAR = ("cart.mass", "belt_stiffness.stiffness", "cart_friction.level")


def stiffness_range(axis: Axis, window_m: tuple[float, float]) -> tuple[float, float]:
    """Smallest and largest belt stiffness at a place that nobody knows, by the data sheet, as shares of that at ``position_m`` None.

    Parameters
    ----------
    axis : Axis
        As its file states it.
    window_m : tuple of float
        (low < 0, high > 0), m, how far the carriage is free to move from there: so far it is from the ends of its travel.
    """
    places = float(axis.travel.min_m or 0.0) - window_m[0], float(axis.travel.max_m or 0.0) - window_m[1]
    found = [axis.belt_stiffness_n_m(place) / _usual_stiffness(axis) for place in places]
    return min(found), max(found)


def _usual_stiffness(axis: Axis) -> float:
    """Geometric mean of the belt stiffness at both ends of the travel, N/m."""
    ends = (float(axis.travel.min_m or 0.0), float(axis.travel.max_m or 0.0))
    return math.sqrt(axis.belt_stiffness_n_m(ends[0]) * axis.belt_stiffness_n_m(ends[1]))


def data_sheet_model(axis: Axis, position_m: float | None, coulomb_nm: float) -> Model:
    """The model before anything was measured: inertia, transmission and belt from data sheets, friction from a breakaway test.

    Parameters
    ----------
    axis : Axis
        Its data sheets.
    position_m : float or None, m
        Where the stiffness is taken; None takes the geometric mean of both ends of the travel.
    coulomb_nm : float, N m at the motor
        Of motor and carriage together; the split is not known and set to 70 % at the motor.

    Returns
    -------
    Model
        All parameters at their data-sheet values.

    Raises
    ------
    UsageError
        When the axis file lacks what the job needs.
    """
    axis.require("identify", *NEEDED)
    ratio = axis.transmission_m_rad
    stiffness = _usual_stiffness(axis) if position_m is None else axis.belt_stiffness_n_m(position_m)
    values = {
        "motor.inertia": axis.motor_side_inertia_kg_m2,
        "cart.mass": usual_load_kg(axis, 2.0),
        "transmission.ratio": ratio,
        "belt_stiffness.stiffness": stiffness,
        "coulomb.level": 0.7 * coulomb_nm,
        "cart_friction.level": 0.3 * coulomb_nm / ratio,
        "viscous_cart.damping": 0.0,  # unknown: a prediction of the belt force must not count on it
    }
    effects: tuple[str, ...] = BASE_EFFECTS
    if axis.rigid:
        effects, values = RIGID_EFFECTS, {**values, "coulomb.level": coulomb_nm}
    return build_for(axis, effects, values)


def build_for(axis: Axis, effects: Sequence[str], values: Mapping[str, float]) -> Model:
    """A model of an axis by its data sheets.

    The bounds of the effects are those of belts; of another kind they have room for its sizes, by its travel per radian.  Of a rigid axis
    a motion shows the sum of motor and load: what the data sheet knows of the motor stands.

    Parameters
    ----------
    axis : Axis
        Of any kind.
    effects : sequence of str
        Names.
    values : mapping of str to float
        By full parameter name.

    Returns
    -------
    Model
        With bounds that suit the axis.
    """
    if axis.transmission is None:
        return build_model(axis.name, effects, values, origin="data sheet")
    base = ("motor",) if axis.rigid else ("motor", "cart")
    expected, share = expected_parameters(effects, base), USUAL_RATIO / axis.transmission_m_rad
    narrow, wide = min(share, share**2, 1.0), max(share, share**2, 1.0)
    loads, own = unknown_loads_kg(axis), axis.motor_side_inertia_kg_m2
    if "belt_damping.damping" in expected and "belt_stiffness.stiffness" in values:  # those of a belt are hundreds of times less
        swung_kg = 1.0 / (1.0 / values["cart.mass"] + axis.transmission_m_rad**2 / own)
        values = {"belt_damping.damping": 2.0 * USUAL_DAMPING * math.sqrt(values["belt_stiffness.stiffness"] * swung_kg), **values}
    placed = {}
    for name, p in expected.items():
        low, high, origin = p.low, p.high, "data sheet"
        if name == "cart.mass":
            low, high = loads[0] / LOADS_BEYOND, loads[-1] * LOADS_BEYOND
        elif name == "motor.inertia" and axis.rigid:
            low, high, origin = own, own, "data sheet, held"
        elif p.form:
            low, high = p.start, p.start
        elif p.side in ("cart", "belt") and p.unit.startswith("N"):
            low, high = p.low * narrow, p.high * wide
        placed[name] = Value(float(values.get(name, p.start)), p.unit, p.side, low, high, None, origin)
    return Model(axis.name, tuple(effects), placed, base)


@dataclass(frozen=True)
class FirstEstimate:
    """A model from a short record, and how well it explains it.

    Attributes
    ----------
    model : Model
        Without intervals.
    rest : float, (N m)²
        Mean square of the torque that the model leaves.
    samples : int
        How many counted.
    """

    model: Model
    rest: float
    samples: int


def first_estimate(
    recordings: Sequence[Recording],
    start: Model,
    counts_per_rev: int,
    path: TorquePath | None = None,
    inertia_shares: tuple[float, float] = INERTIA_SHARES,
) -> FirstEstimate:
    """Inertia, mass, stiffness and friction from a short excited record, found on a grid, so no start value can mislead it.

    For every mass and stiffness the torque equation is linear in the motor's inertia, Coulomb and viscous friction; the smallest
    rest wins, and is refined between the points of the grid.

    Parameters
    ----------
    recordings : sequence of Recording
        Short, open loop, excited.
    start : Model
        The model by the data sheets.
    counts_per_rev : int
        Of the encoder.
    path : TorquePath or None
        To the torque that acts; None takes the reading.
    inertia_shares : tuple of float
        Of the data sheet's inertia, between which the motor's is looked for.

    Returns
    -------
    FirstEstimate
        The model, and how well it explains the records.

    Raises
    ------
    DataError
        When the axis hardly moved.
    DamagedRecord
        When the motor angle jumps.
    """
    step = 2.0 * np.pi / counts_per_rev
    for recording in recordings:
        striking = largest_step(recording, start["motor.inertia"], step, CERTAIN)
        if striking is not None:
            first, size = striking
            refuse([Jump(recording.name, float(recording.t_s[first]), size)], step)
    noise = torque_noise(recordings)
    pieces = [p for r in recordings for p in _legible_segments(r, start, step, noise, path)]
    if _moving(pieces) < FEWEST_SAMPLES:
        raise DataError(_no_motion_words(recordings, pieces, step))
    search = _Search(pieces, start, inertia_shares)
    friction = max(start["cart_friction.level"], LEAST_FRICTION_N)
    stiffnesses = STIFFNESS_SHARES * start["belt_stiffness.stiffness"]
    masses = _masses_tried(start)
    rests = np.full((len(masses), len(stiffnesses)), np.inf)

    def tried(places: Iterable[tuple[int, int]]) -> None:
        new = [(i, j) for i, j in dict.fromkeys(places) if i < len(masses) and j < len(stiffnesses) and np.isinf(rests[i, j])]
        for place, rest in zip(new, search.rests([(masses[i], stiffnesses[j], friction) for i, j in new]), strict=True):
            rests[place] = rest

    tried(itertools.product(range(0, len(masses), 2), range(0, len(stiffnesses), 2)))
    beside = (itertools.product(range(max(i - 1, 0), i + 2), range(max(j - 1, 0), j + 2)) for i, j in _lowest(rests, NEARER))
    tried(itertools.chain.from_iterable(beside))
    # How the friction is split between motor and carriage is only a guess so far; a wrong split puts mass and stiffness 15 % off.
    # (Where the carriage stuck before is neglected: 1 % of the mass at usual friction, 6 % where friction is all at the carriage.)
    starts = [np.log([masses[i], stiffnesses[j], friction]) for i, j in _lowest(rests, REFINED)]

    def cost(logarithms: Array) -> float:
        return search.rests([np.exp(logarithms)])[0]

    tries = [minimize(cost, y, method="Nelder-Mead", options={"xatol": 1e-2, "maxfev": SHORT_REFINEMENT}) for y in starts]
    nearest = min(tries, key=lambda found: float(found.fun)).x
    best = minimize(cost, nearest, method="Nelder-Mead", options={"xatol": 1e-3, "maxfev": LONGEST_REFINEMENT})
    return FirstEstimate(search.model(np.exp(best.x)), float(best.fun), _moving(pieces))


def _masses_tried(start: Model) -> Array:
    """Loads of the grid, kg, rising: those of belt axes, or between the bounds that a data sheet of another kind gives."""
    item, usual = start.parameters["cart.mass"], BASE_BODIES["cart"].inertia
    return MASSES_KG if (item.low, item.high) == (usual.low, usual.high) else np.geomspace(item.low, item.high, len(MASSES_KG))


def _no_motion_words(recordings: Sequence[Recording], pieces: Sequence[Segment], step_rad: float) -> str:
    """Reason in words why too few samples count: the axis hardly moved, or its encoder is too coarse to show how."""
    total, way = sum(len(p.keep) for p in pieces), max(float(np.ptp(r.position)) for r in recordings)
    counted = f"{_moving(pieces)} of {total} samples"
    if way < CLEARLY_MOVED_RAD:
        return f"the axis moved in only {counted}; raise the excitation or look for a brake"
    counts, period_ms = round(2.0 * math.pi / step_rad), 1e3 * recordings[0].sample_period_s
    return (
        f"the motor moved by {way / step_rad:.0f} steps of its encoder, but clearly in only {counted}: {counts} counts per turn are too "
        f"coarse for {period_ms:g} ms between samples. Use an encoder with more counts, or let the drive interpolate between them"
    )


def _lowest(rests: Array, number: int) -> list[tuple[int, int]]:
    """Places of the smallest values of a grid, the smallest first."""
    order = np.argsort(rests, axis=None, kind="stable")[:number]
    return [(int(i), int(j)) for i, j in zip(*np.unravel_index(order, rests.shape), strict=True)]


def moves_enough(recording: Recording, model: Model, counts_per_rev: int) -> bool:
    """True if a record has enough moving samples for a first estimate.

    Parameters
    ----------
    recording : Recording
        Short, excited.
    model : Model
        By the data sheets.
    counts_per_rev : int

    Returns
    -------
    bool
        By the rows alone where these come seldom.
    """
    if comes_seldom(recording, model):
        return clearly_moves(recording, counts_per_rev)
    noise = torque_noise([recording])
    return _moving(_legible_segments(recording, model, 2.0 * np.pi / counts_per_rev, noise)) >= FEWEST_SAMPLES


def _legible_segments(
    recording: Recording, model: Model, step_rad: float, noise_nm: float, path: TorquePath | None = None
) -> list[Segment]:
    """The pieces of a record, torque and angle smoothed alike where its rows alone do not show the motion.

    That is so where the encoder is too coarse to show the acceleration from row to row, or the motor swings on a held carriage between
    two rows.  Then samples count that are away from a reversal by the reach of the filter, over which it smears the friction.

    ``noise_nm`` is that of the torque, N m rms; without a ``path`` the torque that acts is the reading.
    """
    sample = recording.sample_period_s
    swings = 0.0 if model.rigid else model["transmission.ratio"] * math.sqrt(model["belt_stiffness.stiffness"] / model["motor.inertia"])
    if fine(recording.position, step_rad) and swings * sample < SWINGING:
        return segments(recording, model, step_rad, noise_nm, path=path or FAITHFUL)
    width, _ = legible(recording.position, sample, step_rad, ROUNDING)
    torque, angle = recording.torque.copy(), recording.position.copy()
    for first, last in recording.pieces:
        piece = slice(first, last)
        setpoint = None if recording.torque_setpoint is None else recording.torque_setpoint[piece]
        acting = torque[piece] if path is None else path.acting_torque(torque[piece], setpoint, sample)[0]
        torque[piece], angle[piece] = smooth(acting, width), smooth(angle[piece], width)
    calm = replace(recording, position=angle, torque=torque, torque_setpoint=None, velocity=None)
    # a smooth torque does not bend a smooth angle between two rows, whatever the motor's inertia
    rigid = model.with_values({"motor.inertia": model.parameters["motor.inertia"].high})
    whole = segments(calm, rigid, step_rad, noise_nm)
    kept: list[Segment] = []
    for smeared in SMEARED:
        reach = np.ones(2 * round(smeared * width) + 1, dtype=bool)
        kept = [replace(piece, keep=binary_erosion(piece.keep, reach, border_value=0)) for piece in whole]
        if _moving(kept) >= FEWEST_SAMPLES:
            break
    return kept


def _moving(pieces: Sequence[Segment]) -> int:
    return sum(int(piece.keep.sum()) for piece in pieces)


class _Search:
    """Torque equation of some segments as a function of mass, stiffness and carriage friction, the other parameters solved for."""

    def __init__(self, pieces: Sequence[Segment], start: Model, inertia_shares: tuple[float, float]) -> None:
        self.pieces, self.start = pieces, start
        self.low, self.high = (share * start["motor.inertia"] for share in inertia_shares)
        omega = [p.motion.omega[:: p.motion.substeps][p.keep] for p in pieces]
        acceleration = [np.diff(p.position, 2, prepend=0.0, append=0.0)[p.keep] / p.motion.sample_s**2 for p in pieces]
        speed = np.concatenate(omega)
        self.regressor = np.stack([np.concatenate(acceleration), np.sign(speed), speed], axis=1)
        self.across, self.triangle = np.linalg.qr(self.regressor)

    def solved(self, trials: Sequence[Sequence[float] | Array]) -> list[tuple[Array, float]]:
        """Inertia kg m² near the data sheet's, Coulomb N m and viscous N m s/rad >= 0 at the motor; the mean square left, (N m)²."""
        without = self.start.with_values(dict.fromkeys(_LINEAR, 0.0))
        vectors = []
        for trial in trials:
            vectors.append(without.with_values(dict(zip(_NONLINEAR, map(float, trial), strict=True))).vector())
            vectors[-1][without.index("motor.inertia")] = 0.0
        found: list[tuple[Array, float]] = []
        for first in range(0, len(vectors), SIDE_BY_SIDE):
            some = vectors[first : first + SIDE_BY_SIDE]
            left = [[e[p.keep] for e in evaluate_each(p, without, some, [0.0] * len(some))] for p in self.pieces]
            found += [self._solved(np.concatenate(base)) for base in zip(*left, strict=True)]
        return found

    def _solved(self, base: Array) -> tuple[Array, float]:
        """Of one trial, by the torque that is left without what is solved for."""
        if not np.all(np.abs(base) < RUNAWAY_NM):  # a load so soft that its motion runs away
            return np.zeros(3), np.inf
        # the same least squares as that over all rows, over three
        seen = -(self.across.T @ base)
        unseen = max(float(base @ base - seen @ seen), 0.0)
        found, norm = nnls(self.triangle, seen)
        inertia = min(max(float(found[0]), self.low), self.high)
        if inertia != found[0]:  # a feather on a rod explains much of a record, with an inertia that no motor of this size has
            rest, norm = nnls(self.triangle[:, 1:], seen - inertia * self.triangle[:, 0])
            found = np.array([inertia, *rest])
        return found, (unseen + float(norm**2)) / len(base)

    def rests(self, trials: Sequence[Sequence[float] | Array]) -> list[float]:
        """Mean square of what is left, (N m)², the data sheet's word weighed in; infinite outside the bounds of the parameters."""
        found = [math.inf] * len(trials)
        inside = [k for k, trial in enumerate(trials) if self._allows(trial)]
        for k, (_, left) in zip(inside, self.solved([trials[k] for k in inside]), strict=True):
            found[k] = left * (1.0 + SHEET_WEIGHT * math.log(self._share(trials[k])) ** 2)
        return found

    def _share(self, trial: Sequence[float] | Array) -> float:
        return float(trial[1] / self.start["belt_stiffness.stiffness"])

    def _allows(self, trial: Sequence[float] | Array) -> bool:
        bounds = (self.start.parameters[name] for name in _NONLINEAR)
        share = self._share(trial)
        return (
            all(item.low <= value <= item.high for item, value in zip(bounds, trial, strict=True))
            and STIFFNESS_SHARES[0] <= share * (1.0 + 1e-9)
            and share <= STIFFNESS_SHARES[-1] * (1.0 + 1e-9)
        )

    def model(self, trial: Sequence[float] | Array) -> Model:
        """The model with everything solved for; the data sheet's inertia where the data want none."""
        (((inertia, coulomb, viscous), _),) = self.solved([trial])
        found = {"motor.inertia": float(inertia), "coulomb.level": coulomb, "viscous.damping": viscous}
        return self.start.with_values({**dict(zip(_NONLINEAR, map(float, trial), strict=True)), **found}, "first estimate")


#: Share of its inertia that a data sheet may be wrong by.
SHEET_RIGHT_TO = (0.9, 1.1)


@dataclass(frozen=True)
class FirstPath:
    """A first estimate, and the path to the torque that acts with which it was made."""

    path: TorquePath
    model: Model


def first_path(recording: Recording, start: Model, counts_per_rev: int) -> FirstPath:
    """The path with which the first estimate of a record leaves clearly less torque than with the reading; else the reading's.

    Parameters
    ----------
    recording : Recording
        Short, open loop, excited.
    start : Model
        By the data sheets.
    counts_per_rev : int

    Returns
    -------
    FirstPath
        Path and first estimate.

    Raises
    ------
    DataError
        The axis hardly moved.
    DamagedRecord
        The motor angle jumps.
    """
    if start.rigid:
        return FirstPath(FAITHFUL, rigid_estimate(start, [recording]))
    if comes_seldom(recording, start):
        return FirstPath(FAITHFUL, first_of_seldom([recording], start))
    chain = fit_reading([recording])
    faithful = TorquePath(chain.law) if chain is not None else FAITHFUL
    first = first_estimate([recording], start, counts_per_rev, faithful)

    def told(path: TorquePath, found: FirstEstimate) -> FirstPath:
        return FirstPath(path, _by_the_sheet(recording, start, counts_per_rev, path, found))

    step = 2.0 * math.pi / counts_per_rev
    by_sheet = SHEET_RIGHT_TO[0] <= first.model["motor.inertia"] / start["motor.inertia"] <= SHEET_RIGHT_TO[1]
    if chain is None or (by_sheet and _least(recording, start["motor.inertia"], step) >= (1.0 - EXPLAINED) * first.rest):
        return told(faithful, first)
    sample_s = recording.sample_period_s
    ways = _by_motion(chain.law, sample_s) if reads_command(chain, [recording]) else ways_of([(chain.law, chain.at_end)], sample_s)
    others = [path for path in ways if path != faithful]

    def best_of(shares: tuple[float, float] = INERTIA_SHARES) -> tuple[TorquePath, FirstEstimate]:
        trials = [(path, first_estimate([recording], start, counts_per_rev, path, shares)) for path in others]
        return min(trials, key=lambda trial: trial[1].rest, default=(faithful, first))

    if not by_sheet:
        path, held = best_of(SHEET_RIGHT_TO)
        if not _is_certainly_better(held, first):  # another path needs no other inertia than that of the data sheets
            return FirstPath(path, held.model)
    path, best = best_of()
    return told(path, best) if _is_clearly_better(first, best) else told(faithful, first)


def _by_the_sheet(recording: Recording, start: Model, counts_per_rev: int, path: TorquePath, found: FirstEstimate) -> Model:
    """Model of a first estimate, with an inertia that the data sheet may have unless the one found leaves clearly less torque.

    A short record behind a coarse encoder, or of a motor that swings faster than its rows show, fits nearly as well with half of it.
    """
    low, high = SHEET_RIGHT_TO
    if low <= found.model["motor.inertia"] / start["motor.inertia"] <= high:
        return found.model
    held = first_estimate([recording], start, counts_per_rev, path, SHEET_RIGHT_TO)
    return (found if _is_clearly_better(held, found) else held).model


def _least(recording: Recording, inertia_kg_m2: float, step_rad: float) -> float:
    """Least mean square that the right path leaves, (N m)² at the motor: noise of two neighbouring samples, rounded acceleration."""
    return 0.5 * (torque_noise([recording], 0.0) ** 2 + (inertia_kg_m2 * step_rad / recording.sample_period_s**2) ** 2)


def _is_clearly_better(first: FirstEstimate, other: FirstEstimate) -> bool:
    """True if another estimate leaves so much less torque that it is no chance, and no small part of what is left."""
    return other.rest < (1.0 - EXPLAINED) * first.rest and _is_certainly_better(first, other)


def _is_certainly_better(first: FirstEstimate, other: FirstEstimate) -> bool:
    """True if it is no chance that another estimate leaves less torque."""
    return other.rest > 0.0 and first.samples * math.log(first.rest / other.rest) > clear_gain(first.samples)


def _by_motion(law: DriveLaw, sample_s: float) -> Iterator[TorquePath]:
    """Of a reading that is the command: the command that acts, and what a current loop of some time constants makes of it."""
    yield TorquePath(law, commanded=True)
    for time_s in times_tried(sample_s):
        yield TorquePath(replace(law, lags=(*law.lags, Lag("first order", (time_s,)))), commanded=True)
