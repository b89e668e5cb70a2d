"""The recordings of a run made ready for comparison: gapless segments with their noise."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.optimize import minimize_scalar

from beltcomm.arrays import Array, robust_deviation
from beltcomm.axis import Axis
from beltcomm.errors import DataError
from beltcomm.fit.loads import mounted_by
from beltcomm.fit.noise.angle import apparent_step, white_step
from beltcomm.fit.noise.decimation import is_counted, smallest_step
from beltcomm.fit.noise.level import noise_colour, torque_noise
from beltcomm.fit.noise.whitening import whitener
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.fit.residual.segment import Segment, acting_noise, segments
from beltcomm.fit.residual.usable_samples import creeping_samples
from beltcomm.fit.residual.whitened import evaluate, noise_paths_of, whitener_of, with_observers
from beltcomm.fit.torque.path import FAITHFUL, TorquePath
from beltcomm.model import Model
from beltcomm.recording import Recording

#: Fine steps per sample while effects are searched: the carriage's antiresonance is off by (2 pi f h)²/24, 8e-4 at 90 Hz, which the
#: fit takes up in the stiffness.
SUBSTEPS = 4
#: The same, sample by sample, for the fit whose numbers are published: stiffness 0.003 % off, and the fastest motion counts.
PUBLISHED_SUBSTEPS = 16
#: The same for strokes at constant speed, in which the carriage hardly swings, and where contacts open and close.
STROKE_SUBSTEPS, RATTLING_STROKE_SUBSTEPS, RATTLING_SUBSTEPS = 2, 4, 16
#: s, the longest step behind a coupling: its pulley swings at some hundred hertz, and longer ones fly off.
COUPLED_STEP_S = 2.5e-4
#: Noise below this share of the torque itself is not believed.
QUIETEST_SHARE = 1e-4
#: ln of the factor by which noise may be less than it was taken for.
QUIETER = 7.0
#: ln of the factor by which a noisy angle may be rougher than it looks where it rests, for there it hangs on the encoder's steps.
ROUGHER = 0.5
#: Samples and relative difference of speed for records that repeat each other.
FEWEST, SAME_SPEED = 400, 0.05
#: Shares of the rounding's variance that are tried: white and slow.
SHARES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.15, 0.08, 0.03)
SLOW_SHARES = (0.0, 0.03, 0.08, 0.15, 0.25, 0.35, 0.5)
#: Agitations of a carriage in its gap that are tried, the third first, and deviations beyond which an innovation says no more of them.
AGITATIONS, USUAL, STRAY = (0.0, 0.003, 0.01, 0.03, 0.1, 0.3), 2, 5.0
#: Neighbouring values that make one: where the axis is excited, and elsewhere; Hz that are left at least.
EXCITED_GROUP, STEADY_GROUP, BAND_HZ = 2, 4, 120.0
#: Variance of a belt axis's innovations over that by the torque's noise alone from which on every model is judged in its own noise.
OWN_NOISE_FROM = 200.0
#: Hz up to which steady and excited motion counts there: above, rounding follows a steady motion for many samples, is not white and tells
#: a false inertia.
CALM_BAND_HZ, EXCITED_BAND_HZ = 20.0, 250.0
#: Torque of the acceleration's rounding over the torque's noise from which on rounding is most of it.
ROUNDED = 3.0


@dataclass(frozen=True)
class Data:
    """Segments of the records to fit and of those held out.

    Attributes
    ----------
    recordings : tuple of Recording
        All of them.
    noise_nm : float
        rms of the noise of the torque reading, N m.
    step_rad : float
        Step of the encoder, rad.
    path : TorquePath
        From setpoint and reading to the torque that acts.
    substeps : int
        Usual fine steps a sample.
    reversals : bool
        Whether samples count in which the motor passes through a reversal.
    colour : float
        Pole of the noise of the torque reading.
    single : bool
        Whether each value is one by itself, see :func:`is_mostly_rounding`.
    """

    recordings: tuple[Recording, ...]
    fitted: tuple[Segment, ...]
    held_out: tuple[Segment, ...]
    noise_nm: float
    step_rad: float
    path: TorquePath = FAITHFUL
    substeps: int = SUBSTEPS
    reversals: bool = False
    colour: float = 0.0
    single: bool = False


def prepare(recordings: Sequence[Recording], axis: Axis, model: Model) -> Data:
    """Segments of all records for a model that is near enough to say how the motor moves between the samples.

    Parameters
    ----------
    recordings : sequence of Recording
        Of a run; static maps are left out.
    axis : Axis
        For the encoder's counts.
    model : Model
        A first estimate.

    Returns
    -------
    Data
        With a first estimate of torque noise and encoder step.

    Raises
    ------
    DataError
        When nothing is left to fit.
    """
    timed = tuple(r for r in recordings if not r.is_static_map)
    to_fit = [r for r in timed if not r.sidecar.held_out]
    if not to_fit:
        raise DataError("all recordings are held out or static maps; nothing is left to fit: set held_out: false in one sidecar")
    noise = torque_noise(to_fit, QUIETEST_SHARE * float(np.std(to_fit[0].torque)))
    step = apparent_step(to_fit, _encoder_step(axis, timed), noise)
    if not any(is_counted(r.position) for r in to_fit):  # no rounding, but noise: at first no less of it than the angle is rough
        step = max(step, min(white_step(r.position) for r in to_fit))
    if "cart" not in model.base_bodies:
        step = min(step, max(white_step(r.position) for r in to_fit))
        noise = max(noise, _repeat_noise(to_fit, step))
    return prepare_records(timed, model, noise, step, {}, colour=noise_colour(to_fit))


def prepare_records(
    recordings: Sequence[Recording],
    model: Model,
    noise_nm: float,
    step_rad: float,
    shares: Mapping[str, tuple[float, float]],
    usual: int = SUBSTEPS,
    path: TorquePath = FAITHFUL,
    reversals: bool = False,
    colour: float = 0.0,
    single: bool = False,
    coupled: bool = False,
) -> Data:
    """Segments of the records, with known noise and encoder step.

    Parameters
    ----------
    recordings : sequence of Recording
    model : Model
    noise_nm : float, N m rms
        Of the torque.
    step_rad : float, rad
    shares : dict of str to tuple of float
        By record, :func:`_rounding_shares`; all of it white where it is missing.
    usual : int
        Fine steps a sample.
    path : TorquePath
    reversals : bool
        As of :class:`Data`.
    colour : float
        As of :class:`Data`.
    single : bool
        As of :class:`Data`.
    coupled : bool
        With steps of time for a coupling, whatever the model.
    """
    pieces = []
    rattles, coupled = any(effect.rattles for effect in model.effect_list()), coupled or _is_coupled(model)
    mounted = mounted_by(recordings, model)
    for recording in recordings:
        shown = shares.get(recording.name, (1.0, 0.0))
        # What swings behind a coupling is faster than samples show: they tell nothing of it near half their rate.
        group = 1 if (usual == PUBLISHED_SUBSTEPS and not coupled) or single else group_of(recording)
        stroke = recording.sidecar.experiment == "friction_sweep"
        substeps = (RATTLING_STROKE_SUBSTEPS if rattles else STROKE_SUBSTEPS) if stroke else (RATTLING_SUBSTEPS if rattles else usual)
        if coupled:
            substeps = max(substeps, 2 * math.ceil(0.5 * recording.sample_period_s / COUPLED_STEP_S - 1e-9))
        own = mounted.get(recording.name)
        for piece in segments(
            recording,
            model,
            step_rad,
            noise_nm,
            fitted=True,
            substeps=substeps,
            path=path,
            reversals=reversals,
            colour=colour,
            mounted=own,
            # Of a command it begins far above what it is, and behind a belt any inertia and mass would do with that.
            noise_known=not path.commanded or usual == PUBLISHED_SUBSTEPS or "cart" not in model.base_bodies,
        ):
            known = with_whitener(replace(piece, rounding=shown, group=group), model)
            pieces.append(_band_limited(known, EXCITED_BAND_HZ if recording.sidecar.experiment == "frf" else CALM_BAND_HZ))
    return Data(
        tuple(recordings),
        tuple(p for p in pieces if not p.held_out),
        tuple(p for p in pieces if p.held_out),
        noise_nm,
        step_rad,
        path,
        usual,
        reversals,
        colour,
        single,
    )


def _is_coupled(model: Model) -> bool:
    """True if a body beside the motor turns with it: a pulley behind a coupling."""
    return any(body.rotary for _, body in model.bodies() if body.name not in model.base_bodies)


def for_coupling(data: Data, model: Model) -> Data:
    """Records with steps of time that a pulley behind a coupling takes, the motion between the samples by a model; as they are if so.

    Parameters
    ----------
    data : Data
    model : Model
        By which the motion between the samples is made.

    Returns
    -------
    Data
        ``data`` itself where the steps are short enough already.
    """
    pieces = (*data.fitted, *data.held_out)
    if all(piece.motion.sample_s / piece.motion.substeps <= 1.001 * COUPLED_STEP_S for piece in pieces):
        return data
    shares = {piece.record: piece.rounding for piece in pieces}
    known = (data.noise_nm, data.step_rad, shares, data.substeps, data.path, data.reversals, data.colour, data.single)
    return prepare_records(data.recordings, model, *known, coupled=True)


def is_mostly_rounding(data: Data, model: Model) -> bool:
    """True where rounding is most of the noise: at a steady speed it goes with the motion, and over several samples it is not white.

    Parameters
    ----------
    data : Data
    model : Model
        For the driven inertia.

    Returns
    -------
    bool
        By the shortest sample period among the records.
    """
    sample_s = min(recording.sample_period_s for recording in data.recordings)
    return rounding_torque(model.driven_inertia(), data.step_rad, sample_s) > ROUNDED * data.noise_nm


def rounding_torque(inertia: float, step_rad: float, sample_s: float) -> float:
    """Torque of acceleration that white rounding feigns, J (q √6/√12)/T².

    A second difference of rounding, variance q²/12 each, has the variance 6 q²/12.

    Parameters
    ----------
    inertia : float, kg m²
        Of the motor and what turns with it.
    step_rad : float, rad
        q, step of the encoder.
    sample_s : float, s
        T.

    Returns
    -------
    float
        N m rms, motor shaft.
    """
    return inertia * step_rad * math.sqrt(0.5) / sample_s**2


def group_of(recording: Recording) -> int:
    """Neighbouring values of the whitened residual that make one.

    Parameters
    ----------
    recording : Recording
        With its experiment and sample period.

    Returns
    -------
    int
        Samples.
    """
    if recording.sidecar.experiment == "frf":
        return EXCITED_GROUP
    return min(STEADY_GROUP, max(EXCITED_GROUP, int(0.5 / (BAND_HZ * recording.sample_period_s))))


def _band_limited(piece: Segment, band_hz: float) -> Segment:
    """A segment with as many neighbours in each value as leave a band up to ``band_hz``; the same segment where rounding is not most of its
    noise.
    """
    if not piece.own_noise:
        return piece
    return replace(piece, group=max(piece.group, round(0.5 / (band_hz * piece.motion.sample_s))))


def grouped_like(data: Data, like: Data) -> Data:
    """Records with as many neighbours in each value as other records have: else the two see other frequencies.

    Parameters
    ----------
    data : Data
    like : Data
        The same, as a model or a path sees them that is held against this one.

    Returns
    -------
    Data
        ``data`` itself where they are grouped so already.
    """
    groups: dict[str, int] = {}
    for piece in (*like.fitted, *like.held_out):
        groups[piece.record] = max(piece.group, groups.get(piece.record, 1))
    if all(piece.group == groups.get(piece.record, piece.group) for piece in (*data.fitted, *data.held_out)):
        return data
    fitted, held_out = (
        tuple(replace(piece, group=groups.get(piece.record, piece.group)) for piece in pieces) for pieces in (data.fitted, data.held_out)
    )
    return replace(data, fitted=fitted, held_out=held_out)


def with_noise(data: Data, noise_nm: float, model: Model) -> Data:
    """Segments of the records with another noise of the torque, as a model passes it on.

    Parameters
    ----------
    data : Data
    noise_nm : float
        rms, N m at the motor shaft.
    model : Model
        By which it is passed on to the residual.

    Returns
    -------
    Data
        Motion and samples as they were.
    """
    fitted, held_out = (
        tuple(with_whitener(replace(piece, noise_nm=piece.noise_factor * noise_nm), model) for piece in pieces)
        for pieces in (data.fitted, data.held_out)
    )
    return replace(data, noise_nm=noise_nm, fitted=fitted, held_out=held_out)


def with_whitener(piece: Segment, model: Model) -> Segment:
    """A segment with the noise as a model passes it on.

    Parameters
    ----------
    piece : Segment
        With its noise.
    model : Model
        By which the noise is passed on to the residual.
    """
    worked_out = whitener_of(piece, model)
    kept = worked_out.deviations[piece.keep]
    torque = piece.colour.new * piece.noise_nm**2  # of the innovations of its mean with the triangular weight
    own = "cart" in model.base_bodies and len(kept) > 0 and float(np.median(kept)) ** 2 > OWN_NOISE_FROM * torque
    return replace(piece, whitener=worked_out, reference=model, own_noise=own)


def remade(data: Data, model: Model, offsets_m: Array, substeps: int = SUBSTEPS, *, reversals: bool = False) -> Data:
    """Records with the motion between the samples rebuilt, and the noise calibrated, by a better model.

    Parameters
    ----------
    data : Data
    model : Model
    offsets_m : ndarray
        Start offsets of the fitted segments, m.
    substeps : int
        Fine steps a sample, where nothing rattles and nothing creeps.
    reversals : bool
        As of :class:`Data`.
    """
    data = for_coupling(data, model) if _is_coupled(model) else data
    pieces = (*data.fitted, *data.held_out)
    if needs_observer(model):  # what an observer leaves says nothing of the rounding; the shares found before stay
        shares = {piece.record: piece.rounding for piece in pieces}
    else:
        left: dict[str, list[tuple[Segment, Array]]] = {}
        sample_of = {recording.name: recording.sample_period_s for recording in data.recordings}
        for piece, offset in zip(pieces, [*offsets_m, *np.zeros(len(data.held_out))], strict=True):
            # By now the noise is maybe known better than when the segment was made.
            own = sample_of[piece.record]
            colour = acting_noise(data.path, data.colour, own, round(piece.motion.sample_s / own))
            known = replace(piece, noise_nm=piece.noise_factor * data.noise_nm, colour=colour)
            left.setdefault(piece.record, []).append((known, evaluate(piece, model, model.vector(), float(offset))))
        # Where rounding is most of the noise, a share of it found from few samples would make them count for all others.
        calm = {name: parts for name, parts in left.items() if not any(piece.own_noise for piece, _ in parts)}
        shares = {name: _rounding_shares(parts, model) for name, parts in calm.items()}
    ahead = prepare_records(
        data.recordings, model, data.noise_nm, data.step_rad, shares, substeps, data.path, reversals, data.colour, data.single
    )
    return with_process_noise(ahead, model) if needs_observer(model) else ahead


def with_process_noise(data: Data, model: Model) -> Data:
    """The records with what no model tells of a carriage in its gap, the likeliest of :data:`AGITATIONS` (``untuned_observer``).

    Without it an observer knows too well where the carriage is, and takes the next stroke for an error of the model.

    Parameters
    ----------
    data : Data
    model : Model
        With a gap.

    Returns
    -------
    Data
        All segments with one process noise.
    """

    @cache
    def unlikely(number: int) -> float:
        return negative_log_likelihood([replace(piece, process_noise=AGITATIONS[number]) for piece in data.fitted], model)

    best, here = -1, AGITATIONS.index(data.fitted[0].process_noise) or USUAL
    while best != here:
        best, here = here, min((n for n in (here, here - 1, here + 1) if 0 <= n < len(AGITATIONS)), key=unlikely)
    fitted, held_out = (
        tuple(replace(piece, process_noise=AGITATIONS[best]) for piece in pieces) for pieces in (data.fitted, data.held_out)
    )
    return replace(data, fitted=fitted, held_out=held_out)


def negative_log_likelihood(pieces: Sequence[Segment], model: Model) -> float:
    """-2 ln likelihood of the innovations of a model whose carriage is followed, strays left aside; inf where it flies off.

    Parameters
    ----------
    pieces : sequence of Segment
        Each with its process noise.
    model : Model
        With a gap.

    Returns
    -------
    float
        But for a constant.
    """
    total = 0.0
    for piece in with_observers(pieces, [model] * len(pieces)):
        assert piece.observer is not None
        squares = np.minimum(piece.observer.watch.white[piece.keep] ** 2, STRAY**2)
        total += float(np.sum(squares + 2.0 * np.log(piece.observer.watch.deviations[piece.keep])))
    return total if math.isfinite(total) else math.inf


def _rounding_shares(parts: Sequence[tuple[Segment, Array]], model: Model) -> tuple[float, float]:
    """Shares of the rounding's variance that a record shows, white and slow: the likeliest of :data:`SHARES` and :data:`SLOW_SHARES`.

    An axis that moves slowly and steadily rounds in step with its motion: then the error is less, and no white noise.  What a model
    cannot explain raises the shares up to 1, never beyond: an effect is not taken for rounding.

    ``parts``: segments of one record, each with its residual as it is, (n,), N m.
    """
    passed = [noise_paths_of(piece, model) for piece, _ in parts]

    @cache
    def unlikely(white: int, slow: int) -> float:
        shares = (SHARES[white], SLOW_SHARES[slow])
        if sum(shares) > 1.0:
            return math.inf
        total = 0.0
        for (piece, torque), along in zip(parts, passed, strict=True):
            trial = whitener(piece.keep, along, piece.step_rad, piece.noise_nm, shares, piece.colour)
            total += float(np.sum(trial(torque, piece.keep) ** 2) + 2.0 * np.sum(np.log(trial.deviations[piece.keep])))
        return total

    here = (0, 0)
    while True:
        ways = [(here[0] + i, here[1] + j) for i, j in ((0, 0), (1, 0), (1, 1), (2, 1), (0, 1), (-1, 0), (0, -1))]
        best = min((w for w in ways if 0 <= w[0] < len(SHARES) and 0 <= w[1] < len(SLOW_SHARES)), key=lambda way: unlikely(*way))
        if best == here:
            return SHARES[here[0]], SLOW_SHARES[here[1]]
        here = best


def likeliest_noise(data: Data, model: Model, residuals: Sequence[Array], most_nm: float) -> float:
    """Noise of the torque that the residuals of the fitted segments tell, up to a largest one.

    Least of Σ ν²/S + ln S over the noise, the model as it is.

    Parameters
    ----------
    data : Data
    model : Model
        By which the noise is passed on to the residual.
    residuals : sequence of ndarray, (n,), N m
        As they are, of each fitted segment.
    most_nm : float
        Upper bound, N m rms.

    Returns
    -------
    float
        N m rms, motor shaft.

    References
    ----------
    Method sheet, section 3, second equation.
    """
    high = math.log(most_nm)
    return math.exp(
        _likeliest(data, model, residuals, (high - QUIETER, high), lambda piece, x: (piece.step_rad, piece.noise_factor * math.exp(x)))
    )


def likeliest_step(data: Data, model: Model, residuals: Sequence[Array], least_rad: float) -> float:
    """Step whose rounding is as much as the noise of the angle that the residuals tell.

    Where the torque is calm the motion may be rough by what the drive makes beside its setpoint.

    Parameters
    ----------
    data : Data
    model : Model
        By which the noise is passed on to the residual.
    residuals : sequence of ndarray, (n,), N m
        As they are, of each fitted segment.
    least_rad : float, rad
        Lower bound; the upper one is somewhat above the step so far.

    Returns
    -------
    float, rad
        At the motor shaft.
    """
    bounds = (math.log(least_rad / data.step_rad), ROUGHER)
    more = _likeliest(data, model, residuals, bounds, lambda piece, x: (piece.step_rad * math.exp(x), piece.noise_nm))
    return data.step_rad * math.exp(more)


def _likeliest(
    data: Data,
    model: Model,
    residuals: Sequence[Array],
    bounds: tuple[float, float],
    noises: Callable[[Segment, float], tuple[float, float]],
) -> float:
    """x of the likeliest noises.   noises : step, rad, and noise of the torque, N m, of a segment by x."""
    passed = [noise_paths_of(piece, model) for piece in data.fitted]

    def unlikely(x: float) -> float:
        total = 0.0
        for piece, torque, along in zip(data.fitted, residuals, passed, strict=True):
            trial = whitener(piece.keep, along, *noises(piece, x), piece.rounding, piece.colour)
            squares = np.minimum(trial(torque, piece.keep) ** 2, STRAY**2)
            total += float(np.sum(squares) + 2.0 * np.sum(np.log(trial.deviations[piece.keep])))
        return total

    found = minimize_scalar(unlikely, bounds=bounds, method="bounded", options={"xatol": 0.01, "maxiter": 20})
    return float(found.x)


def _encoder_step(axis: Axis, recordings: Sequence[Recording]) -> float:
    """Step of the encoder, rad: from the axis file, else the smallest step that the angles show; not below what the records show."""
    counts = axis.get("motor.encoder_counts_per_rev")
    shown = min(smallest_step(r.position) for r in recordings)
    if counts:
        # An angle may be recorded coarser than the encoder is; never finer.
        return max(2.0 * np.pi / float(counts), shown) if shown < 0.1 else 2.0 * np.pi / float(counts)
    return shown


def _repeat_noise(recordings: Sequence[Recording], step_rad: float) -> float:
    """Torque that no model can explain, N m rms: how it differs at a place in records of the same slow motion; 0 without two such."""
    found = []
    creeps = [(r, creeping_samples(r.position, r.sample_period_s, step_rad)[0]) for r in recordings]
    for (one, first), (two, second) in itertools.combinations(creeps, 2):
        if min(first.sum(), second.sum()) < FEWEST:
            continue
        speeds = [float(np.median(np.gradient(r.position, r.t_s)[c])) for r, c in ((one, first), (two, second))]
        low, high = max(one.position[first].min(), two.position[second].min()), min(one.position[first].max(), two.position[second].max())
        if speeds[0] * speeds[1] <= 0.0 or abs(np.log(speeds[0] / speeds[1])) > SAME_SPEED or high <= low:
            continue
        places = np.linspace(low, high, FEWEST)
        rows = [np.interp(places, *_by_place(r.position[c], r.torque[c])) for r, c in ((one, first), (two, second))]
        left = (rows[0] - rows[1]) / np.sqrt(2.0)
        found.append(robust_deviation(left - np.median(left)))
    return float(min(found, default=0.0))


def _by_place(position: Array, torque: Array) -> tuple[Array, Array]:
    """Positions and torque, (n,) each, in the order of the positions."""
    order = np.argsort(position)
    return position[order], torque[order]
