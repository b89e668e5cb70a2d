"""From measured motion to the torque that a model needs for it: every instant is judged on its own merits.

For a held torque the second difference of the motor angle is an exact average of the acceleration,

    theta[n+1] - 2 theta[n] + theta[n-1] = T² ∫ tri(s) theta''(t_n + s T) ds,    s = -1 .. 1,

with the triangular weight tri(s) = 1 - |s|.  So the equation of motion, averaged with the same weight, needs no differentiation
and no hold model:

    e[n] = J (theta[n+1] - 2 theta[n] + theta[n-1])/T² + <load>[n] - (torque[n-1] + torque[n])/2

where the load (friction, belt) is computed on a fine grid by driving the unmeasured bodies with the measured motor angle.  Written
in frequency this is the exact sampled response of an inertia to a held torque, -0.5 (w T)² (z + 1)/(z - 1)²; plain
differentiation with a sinc would leave a bias of 0.3 to 0.5 % in J.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import CubicSpline

from beltcomm.arrays import Array, row_means
from beltcomm.effects import EFFECTS
from beltcomm.model import Model
from beltcomm.model.mounted import Mounted, loaded
from beltcomm.simulate.imperfect import Intersample
from beltcomm.simulate.kernels.belt_lanes import belt_loads_in_lanes, lane_values
from beltcomm.simulate.kernels.compose import inverse_kernel
from beltcomm.simulate.kernels.learning import with_memory
from beltcomm.simulate.kernels.observer import NOTHING, ObserverState, reset
from beltcomm.simulate.kernels.pieces import triangular_mean
from beltcomm.simulate.kernels.switchboard import switchboard
from beltcomm.simulate.kernels.vectors import LANES
from beltcomm.simulate.kernels.writer import LOOK_AHEAD, MOVING_RAD_S
from beltcomm.simulate.lock_step import Lane, lock_step

#: Laws with their values.
Lags = tuple[tuple[Callable[..., Array], tuple[float, ...]], ...]

#: m at the belt: distance in which the motor's friction turns round after a reversal.  Small against what a moving motor covers
#: in a fine step; samples in which it rests or reverses are left out by the caller, so chatter there does no harm.  (1.3 um would
#: reach into the samples after a reversal: 1 % of the viscous and 0.3 % of the Coulomb friction of rig g_b.)
BRISTLE_M = 2e-8
#: Cells per sample in which a torque that comes late is worked out: a step within a cell counts as spread over it, which shifts it in time
#: by up to T/(8 cells²), 8 us of 1 ms with four cells and 0.1 us with these.
DELAY_CELLS = 32
#: Loads of the motor's own friction that are kept with a motion.
REMEMBERED = 2
#: Stretches from which on it is quicker to follow them in lock step, and share of the longest that the next one must be long for that.
ENOUGH_LANES, LIKE = 3, 2.0 / 3.0


@dataclass(frozen=True)
class FineMotion:
    """Motor motion of one gapless stretch on a fine grid.

    Attributes
    ----------
    theta, omega : ndarray (n*substeps - substeps + 1,), rad and rad/s at the motor shaft
        Absolute: theta = position / i_t.
    samples : int
        Number of samples n.
    sample_s : float, s
        Sampling period.
    substeps : int
        Fine steps per sample.
    time_s : float, s
        Session clock at the first sample.
    bristle_m : float, m at the belt
        In which the motor's friction turns round.
    within : Intersample or None
        Of the torque inside the sampling periods; None: it is held.
    creep : tuple of ndarray or None
        Angle and speed as the motor's friction sees them, where the encoder's steps hide that a slow motion goes on in one direction; None:
        as they are.
    mounted : Mounted or None
        Load of its record, where that is another one than the model's.
    """

    theta: Array
    omega: Array
    samples: int
    sample_s: float
    substeps: int
    time_s: float
    bristle_m: float = BRISTLE_M
    within: Intersample | None = None
    creep: tuple[Array, Array] | None = None
    mounted: Mounted | None = None
    #: What :func:`true_motion` last made of it, by the values of the sensor's errors: most of a fit does not change them.
    made_true: dict[tuple[object, ...], FineMotion] = field(init=False, repr=False, compare=False, default_factory=dict)
    #: What :func:`motor_load` last said of it, by effects and values: most of what is tried leaves the motor's own friction alone.
    rubbed: dict[tuple[object, ...], Array] = field(init=False, repr=False, compare=False, default_factory=dict)

    def forget(self) -> None:
        """Give back what was kept with it."""
        self.made_true.clear()
        self.rubbed.clear()

    def coarser(self, substeps: int) -> FineMotion:
        """Motion with fewer fine steps per sample, of which today's are a multiple; itself where it has no more."""
        skip = self.substeps // substeps
        if skip <= 1:
            return self
        creep = None if self.creep is None else (self.creep[0][::skip].copy(), self.creep[1][::skip].copy())
        return replace(self, theta=self.theta[::skip].copy(), omega=self.omega[::skip].copy(), substeps=substeps, creep=creep)


def reconstruct(
    position: Array,
    torque: Array,
    sample_s: float,
    inertia: float,
    *,
    start_rad: float,
    substeps: int,
    time_s: float = 0.0,
    load: Array | None = None,
    within: Intersample | None = None,
) -> FineMotion:
    """Motor angle between the samples.

    The held torque bends the angle into parabolas, theta'' = (torque - load)/inertia + rest: the known part is integrated on the
    fine grid and taken out, the rest is interpolated by a cubic spline, then the known part is put back.  Without the load a
    reversal of the friction inside a sample would ring through the spline into its neighbours.

    Parameters
    ----------
    position : ndarray (n,), rad, motor shaft
    torque : ndarray, N m
        ndarray (n,) acting from sample n to n+1, or (fine - 1,), mean over each fine step.
    sample_s : float, s
    inertia : float, kg m², motor side
    start_rad : float, rad
        Absolute motor angle (carriage position over i_t) of the first sample.
    substeps : int
        Fine steps per sample.
    time_s : float, s
        Session's clock at the first sample.
    load : ndarray (fine,) or None, N m
        As :func:`fine_load` gives it for a first reconstruction; None: taken as smooth.
    within : Intersample or None
        Of a torque (n,) inside the periods.
    """
    n, h = len(position), sample_s / substeps
    push = _cells(torque, substeps, within) if len(torque) == n else torque
    if load is not None:
        push = push - 0.5 * (load[:-1] + load[1:])
    faster = push / inertia * h
    speed = np.concatenate(([0.0], np.cumsum(faster)))
    known = np.concatenate(([0.0], np.cumsum((speed[:-1] + 0.5 * faster) * h)))
    rest, rate = _interpolate(position - known[::substeps], substeps)
    theta = rest + known
    omega = rate / sample_s + speed
    return FineMotion(theta - position[0] + start_rad, omega, n, sample_s, substeps, time_s, within=within)


def _interpolate(values: Array, substeps: int) -> tuple[Array, Array]:
    """Samples, (n,), and their rate per sample on the fine grid, (fine,) each, by a cubic spline."""
    spline = CubicSpline(np.arange(len(values)), values)  # not-a-knot: at rest the load that friction carries bends the rest at its ends
    place = np.arange((len(values) - 1) * substeps + 1) / substeps
    return spline(place), spline(place, 1)


def _cells(torque: Array, per_sample: int, within: Intersample | None) -> Array:
    """A reported torque, (n,), N m, over so many cells of each period, ((n - 1)*per_sample,)."""
    spread = np.repeat(torque, per_sample) if within is None else within.cells(torque, per_sample)
    return spread[: (len(torque) - 1) * per_sample]


def begins_in_motion(motion: FineMotion) -> bool:
    """True if the kernel lets all bodies begin at the motor's speed; else they begin at rest.

    Parameters
    ----------
    motion : FineMotion
    """
    return _first_speed(motion) != 0.0


def _first_speed(motion: FineMotion) -> float:
    """Speed of the motor at which the kernel lets all bodies begin, rad/s."""
    if len(motion.theta) < 3:
        return 0.0
    half = max(1, min(LOOK_AHEAD, len(motion.theta) - 1) // 2)
    first, middle, last = (float(motion.theta[i]) for i in (0, half, 2 * half))
    speed = (4.0 * middle - last - 3.0 * first) * motion.substeps / (2.0 * half * motion.sample_s)
    return speed if abs(speed) >= MOVING_RAD_S else 0.0


class _Scratch(threading.local):
    """Memory for what a triangular mean is taken of, each thread its own: fetching it from the system anew costs as much as the kernel."""

    def __init__(self) -> None:
        self.memory = np.empty((2, 0))

    def rows(self, length: int) -> Array:
        """Two rows, (2, length); what they hold is lost with the next call."""
        if self.memory.shape[1] < length:
            self.memory = np.empty((2, 2 * length))
        return self.memory[:, :length]


_SCRATCH = _Scratch()


def true_motion(model: Model, motion: FineMotion, vector: Array | None = None) -> FineMotion:
    """The motion with the errors of the angle sensor taken out; the same object where the model knows of none.

    An error is one of the angle shown, at the samples, and between them runs as the spline of :func:`reconstruct` does: one that goes
    faster than the samples, as that of an encoder with many lines, is not there between them.

    Parameters
    ----------
    model : Model
        With any effects.
    motion : FineMotion
        As the sensor shows it.
    vector : ndarray or None
        Values of the parameters; None for the model's own.
    """
    board = switchboard(model.base_bodies, model.effects)
    if not board.sensor:
        return motion
    values = model.vector() if vector is None else vector
    key = (model.effects, *(float(values[i]) for i in board.sensor))
    if key not in motion.made_true:
        shown = np.ascontiguousarray(motion.theta[:: motion.substeps])
        correction = np.empty_like(shown)
        inverse_kernel().angle(shown, correction, board.masked_vector(values), board.on)
        way, rate = _interpolate(correction, motion.substeps)
        motion.made_true.clear()
        motion.made_true[key] = replace(motion, theta=motion.theta + way, omega=motion.omega + rate / motion.sample_s)
    return motion.made_true[key]


def fine_load(model: Model, motion: FineMotion, vector: Array | None = None, offset_m: float = 0.0) -> tuple[Array, Array]:
    """Load at the motor shaft, N m, and carriage position, m, on the fine grid of a true motion; (fine,), (fine,).

    Parameters
    ----------
    model : Model
    motion : FineMotion
        True, of a segment.
    vector : ndarray or None
        Replaces ``model.vector()``.
    offset_m : float, m
        A resting carriage is held by its friction up to level/stiffness away from where the belt is unstretched.
    """
    board = switchboard(model.base_bodies, model.effects)
    p = board.masked_vector(loaded(model, model.vector() if vector is None else vector, motion.mounted))
    load, cart = np.empty_like(motion.theta), np.empty_like(motion.theta)
    h, kernel = motion.sample_s / motion.substeps, inverse_kernel()
    given = (motion.theta, motion.omega, p, board.on, motion.time_s, h)
    if board.bare:
        kernel.plain(*given, offset_m, load, cart)
    else:
        kernel.load(*given, motion.bristle_m, offset_m, load, cart, NOTHING)
    if board.motor.any():
        own, level = _SCRATCH.rows(len(load))
        theta, omega = motion.creep or (motion.theta, motion.omega)
        kernel.motor(theta, omega, *given[2:], motion.bristle_m, own, level)
        load += own
    return load, cart


def motor_load(model: Model, motion: FineMotion, vector: Array, effect: str | None = None) -> Array:
    """Load by the effects that act on the motor alone, or one of them; triangular mean, (n,), N m, ends 0; read only.

    Parameters
    ----------
    model : Model
        With any effects.
    motion : FineMotion
    vector : ndarray (k,)
        Values of the parameters.
    effect : str or None
        Name of the only one that counts; None for all.

    Returns
    -------
    ndarray (n,), N m, motor shaft
        Read only; ends 0.
    """
    board = switchboard(model.base_bodies, model.effects)
    on, vector = board.motor, loaded(model, vector, motion.mounted)
    if effect is not None:
        on = np.zeros_like(board.on)
        on[[e.name for e in EFFECTS].index(effect)] = True
    key = (on.tobytes(), *(float(vector[place]) for place in board.rubs))
    if key not in motion.rubbed:
        mean = np.zeros(motion.samples)
        if on.any():
            load, level = _SCRATCH.rows(len(motion.theta))
            h = motion.sample_s / motion.substeps
            theta, omega = motion.creep or (motion.theta, motion.omega)
            inverse_kernel().motor(theta, omega, board.masked_vector(vector), on, motion.time_s, h, motion.bristle_m, load, level)
            mean = triangular_mean(load, motion.substeps)
        mean.setflags(write=False)
        if len(motion.rubbed) >= REMEMBERED:
            del motion.rubbed[next(iter(motion.rubbed))]
        motion.rubbed[key] = mean
    return motion.rubbed[key]


def belt_load(model: Model, motion: FineMotion, vector: Array, offset_m: float) -> Array:
    """Load by everything beyond the motor; triangular mean, (n,), N m, ends 0.

    Parameters
    ----------
    model : Model
        With any effects.
    motion : FineMotion
    vector : ndarray (k,)
        Values of the parameters.
    offset_m : float, m
        Of the carriage at the start.

    Returns
    -------
    ndarray (n,), N m, motor shaft
        Ends 0.
    """
    return belt_loads(model, motion, [vector], [offset_m])[:, 0]


def belt_loads(model: Model, motion: FineMotion, vectors: Sequence[Array], offsets_m: Sequence[float]) -> Array:
    """Load by everything beyond the motor for several vectors of parameters, all with one transmission, and offsets; (n, k).

    Parameters
    ----------
    model : Model
        With any effects.
    motion : FineMotion
    vectors : sequence of ndarray (p,) each
        Values of the parameters, k times.
    offsets_m : sequence of float, m
        Of the carriage at the start, k times.

    Returns
    -------
    ndarray (n, k), N m, motor shaft
        Ends 0.
    """
    board = switchboard(model.base_bodies, model.effects)
    if not board.belt.any():
        return np.zeros((motion.samples, len(vectors)))
    vectors = [loaded(model, vector, motion.mounted) for vector in vectors]
    h = motion.sample_s / motion.substeps
    if board.in_lanes:
        by_name = dict(zip(model.parameters, np.array(vectors).T, strict=True))
        values = lane_values(len(vectors), lambda name: by_name.get(name, 0.0), np.asarray(offsets_m))
        ratio = float(by_name["transmission.ratio"][0])
        return belt_loads_in_lanes(motion.theta, motion.omega, h, motion.substeps, ratio, _first_speed(motion), values)
    means = np.empty((len(vectors), motion.samples))
    load, cart = _SCRATCH.rows(len(motion.theta))
    for mean, vector, offset in zip(means, vectors, offsets_m, strict=True):
        p = board.masked_vector(vector)
        inverse_kernel().load(motion.theta, motion.omega, p, board.belt, motion.time_s, h, motion.bristle_m, offset, load, cart, NOTHING)
        mean[:] = triangular_mean(load, motion.substeps)
    return means.T


def follow_bodies(model: Model, motions: Sequence[FineMotion], vectors: Sequence[Array], watches: Sequence[ObserverState]) -> None:
    """Everything beyond the motor followed by the torque, of several stretches or models; the results stand in the watches.

    In lock step where there are enough of one kind, the others one by one.

    Parameters
    ----------
    model : Model
    motions : sequence of FineMotion
        One for each vector.
    vectors : sequence of ndarray
        With one transmission.
    watches : sequence of ObserverState
        One for each vector; filled.
    """
    board = switchboard(model.base_bodies, model.effects)
    vectors = [loaded(model, vector, motion.mounted) for motion, vector in zip(motions, vectors, strict=True)]
    alike: dict[tuple[float, ...], list[int]] = {}
    for i, (motion, watch) in enumerate(zip(motions, watches, strict=True)):
        alike.setdefault((motion.substeps, motion.sample_s, len(watch.s), watch.cart), []).append(i)
    for group in alike.values():
        h = motions[group[0]].sample_s / motions[group[0]].substeps
        for some in _lock_step_groups(group, [len(motion.theta) for motion in motions]):
            if len(some) >= ENOUGH_LANES:
                lock_step([_lane(motions[i], board.masked_vector(vectors[i]), watches[i]) for i in some], board.belt, h)
                continue
            for i in some:
                motion, p = motions[i], board.masked_vector(vectors[i])
                watch = with_memory(watches[i]) if watches[i].learning else watches[i]
                load, cart = _SCRATCH.rows(len(motion.theta))
                inverse_kernel().load(motion.theta, motion.omega, p, board.belt, motion.time_s, h, motion.bristle_m, 0.0, load, cart, watch)


def _lock_step_groups(group: Sequence[int], lengths: Sequence[int]) -> list[list[int]]:
    """The members of a group, the longest first, by as many as run in lock step; one by itself where the others would end long before."""
    order, found = sorted(group, key=lambda i: -lengths[i]), list[list[int]]()
    while order:
        alone = len(order) > 1 and lengths[order[1]] < LIKE * lengths[order[0]]
        count = 1 if alone else LANES
        found.append(order[:count])
        order = order[count:]
    return found


def _lane(motion: FineMotion, p: Array, watch: ObserverState) -> Lane:
    return Lane(motion.theta, motion.omega, _first_speed(motion), motion.time_s, motion.bristle_m, p, watch)


def linear_innovations(model: Model, motion: FineMotion, vectors: Sequence[Array], watch: ObserverState) -> Array:
    """Innovations over their deviation, (n, k), of several vectors by one observer that does not learn.

    One load is ``wanted`` and one transmission is theirs.

    Parameters
    ----------
    model : Model
        With an observer.
    motion : FineMotion
    vectors : sequence of ndarray (p,) each
        Values of the parameters, k times.
    watch : ObserverState
        Observer whose gains are known.

    Returns
    -------
    ndarray (n, k), 1
        Column by column.
    """
    watches = [reset(watch, watch.wanted) for _ in vectors]
    follow_bodies(model, [motion] * len(vectors), vectors, watches)
    return np.stack([one.white for one in watches], axis=1)


def acting_torque(model: Model, motion: FineMotion, torque: Array, vector: Array | None = None) -> Array:
    """Torque that acts on the motor, averaged with the triangular weight, (n,), N m, ends 0.

    Parameters
    ----------
    model : Model
    motion : FineMotion
    torque : ndarray (n,), N m
        As reported, held from sample n to n+1.
    vector : ndarray or None
        Replaces ``model.vector()``.
    """
    mean = np.zeros(motion.samples)
    board = switchboard(model.base_bodies, model.effects)
    if not (board.delays or board.bent):
        mean[1:-1] = 0.5 * (torque[:-2] + torque[1:-1])
        return mean if motion.within is None else mean + motion.within.triangular()
    rows = acting_cells(model, motion, torque, vector).reshape(motion.samples - 1, -1)
    m = rows.shape[1]
    ramp = (np.arange(m) + 0.5) / m**2  # the middle of a cell weighs it exactly: the weight is linear within it
    mean[1:-1] = rows[:-1] @ ramp + rows[1:] @ ramp[::-1]
    return mean


def acting_cells(model: Model, motion: FineMotion, torque: Array, vector: Array | None = None) -> Array:
    """Acting torque, mean over each cell of time; a whole number of cells per fine step.

    Parameters
    ----------
    model : Model
        With any effects.
    motion : FineMotion
    torque : ndarray (n,), N m, motor shaft
        As it was read.
    vector : ndarray or None
        Values of the parameters; None for the model's own.

    Returns
    -------
    ndarray ((n - 1)*cells per sample,), N m
        Motor shaft.
    """
    board = switchboard(model.base_bodies, model.effects)
    values = model.vector() if vector is None else vector
    finer = max(1, DELAY_CELLS // motion.substeps) if board.delays else 1
    h, cells = motion.sample_s / motion.substeps, _cells(torque, motion.substeps * finer, motion.within)
    for law, places in board.delays:
        cells = law(cells, h / finer, *(float(values[i]) for i in places))
    if not board.bent:
        return cells
    cells = coarse(cells, finer)
    out = np.empty_like(cells)
    inverse_kernel().torque(cells, motion.theta, board.masked_vector(values), board.on, motion.time_s, h, out)
    return out


def coarse(cells: Array, together: int) -> Array:
    """Means of so many cells each.

    Parameters
    ----------
    cells : ndarray (n,)
        Of any unit.
    together : int
        Cells for each mean; n is a multiple of it.

    Returns
    -------
    ndarray (n/together,)
        In their unit.
    """
    return cells if together == 1 else row_means(cells.reshape(-1, together))


def reading_lags(model: Model, vector: Array) -> Lags:
    """The laws by which a model's torque reading lags, with their values; () where it does not.

    Parameters
    ----------
    model : Model
        With any effects.
    vector : ndarray (k,)
        Values of the parameters.
    """
    return tuple((law, tuple(float(vector[i]) for i in places)) for law, places in switchboard(model.base_bodies, model.effects).readings)


def as_read(torque: Array, start_nm: float, sample_s: float, lags: Lags) -> Array:
    """A torque that the motor needs, (n,), N m, as the drive would report it; the same array where its reading does not lag.

    The ends stay as they are.

    Parameters
    ----------
    torque : ndarray (n,), N m
        Motor shaft.
    start_nm : float, N m
        The reading at the first sample that counts, the second: the lag's whole state.
    sample_s : float, s
    lags : Lags
        Laws of the reading with their values.
    """
    if not lags:
        return torque
    shown = torque.copy()
    for law, values in lags:
        shown[1:-1] = law(shown[1:-1], start_nm, sample_s, *values)
    return shown


def _load_torque(model: Model, motion: FineMotion, vector: Array | None = None, offset_m: float = 0.0) -> tuple[Array, Array]:
    """Load at the motor shaft averaged with the triangular weight, (n,), N m, ends 0; and the carriage position, (fine,), m.

    ``vector``, ``offset_m`` : see :func:`fine_load`.
    """
    load, cart = fine_load(model, motion, vector, offset_m)
    return triangular_mean(load, motion.substeps), cart


def torque_residuals(model: Model, motion: FineMotion, torque: Array, vectors: Sequence[Array], offsets_m: Sequence[float]) -> list[Array]:
    """e[n] of the module's equation, N m at the motor shaft, (n,) each, ends 0, of several vectors of parameters and offsets side by side.

    Parameters
    ----------
    model : Model
    motion : FineMotion
        As it was read.
    torque : ndarray (n,), N m
        As reported.
    vectors : sequence of ndarray (p,) each
        Values of the parameters.
    offsets_m : sequence of float, m
        Of the carriage at the start, one for each vector.
    """
    board, ratio = switchboard(model.base_bodies, model.effects), model.index("transmission.ratio")
    beside = board.in_lanes and not board.sensor and all(p[ratio] == vectors[0][ratio] for p in vectors)
    loads = belt_loads(model, motion, vectors, offsets_m).T if beside else [None] * len(vectors)
    left = []
    for p, offset, load in zip(vectors, offsets_m, loads, strict=True):
        true = true_motion(model, motion, p)
        if load is not None:
            needed = motor_load(model, true, p) + load
        elif board.in_lanes:
            needed = motor_load(model, true, p) + belt_load(model, true, p, offset)
        else:
            needed, _ = _load_torque(model, true, p, offset)
        needed[1:-1] += model.driven_inertia(loaded(model, p, motion.mounted)) * np.diff(true.theta[:: true.substeps], 2) / true.sample_s**2
        acting = acting_torque(model, true, torque, p)
        left.append(as_read(needed, float(acting[1]), true.sample_s, reading_lags(model, p)) - acting)
    return left
