"""Recordings as residuals of one equation: what torque is left over when the measured motion goes backwards through a model.

The residual e[n] of ``beltcomm.simulate.inverse`` is divided by its own noise (``beltcomm.fit.noise.whitening``).

Left out are samples near standstill: a sticking motor carries any torque up to its friction, so the equation says nothing there.
Samples with a reversal through which the motor surely went are kept where asked for (``beltcomm.fit.residual.reversals``); a motor without
Coulomb friction cannot stick.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Array, BoolArray
from beltcomm.compiled import compiled
from beltcomm.fit.noise.colour import WHITE_NOISE, NoiseColour
from beltcomm.fit.noise.decimation import decimate, decimate_torque, decimated_noise, decimation, smallest_step
from beltcomm.fit.noise.process_torque import Unread
from beltcomm.fit.noise.whitening import Whitener
from beltcomm.fit.residual.observer import Observation, Observer
from beltcomm.fit.residual.reversals import motion_through_reversals, turns_at_once
from beltcomm.fit.residual.smoother import smooth_motion
from beltcomm.fit.residual.usable_samples import (
    creep_motion,
    creeping_samples,
    resting_samples,
    run_in_samples,
    samples_between_counts,
    shaken_samples,
    sparse_creep,
)
from beltcomm.fit.torque.path import FAITHFUL, TorquePath
from beltcomm.model import Model
from beltcomm.model.linear import matrices, operating_point
from beltcomm.model.mounted import Mounted, loaded_model
from beltcomm.recording import Recording
from beltcomm.simulate.inverse import (
    FineMotion,
    acting_cells,
    begins_in_motion,
    coarse,
    fine_load,
    reconstruct,
    true_motion,
)
from beltcomm.simulate.kernels.pieces import ABSURD_NM

#: rad/s at the motor: below this speed anywhere within a sample the motor may be sticking.  Three encoder steps of a 65536-count
#: encoder per millisecond; on simulated axes 0.1 still lets sticking samples through and 0.2 to 0.8 give equal residuals.
STICK_SPEED_RAD_S = 0.3
#: The same in steps of the encoder per sample, where a reversal is looked for: below that its instant is the rounding's.
STICK_STEPS = 3.0
#: The same of a motor alone in steps of the encoder per sample: below it rounding turns the sign of the speed, and the friction's with it.
SURE_STEPS = 1.0
#: rad/s that a step of the encoder in a sample makes, from which on friction acts against the smoothed speed behind a belt.
COARSE_RAD_S = 5.0
#: The stick speed in deviations of a smoothed speed.
SURE = 3.0
#: Share of an angle by which a start position may differ from it and still be the same, with the radius as it was known then.
SAME_ANGLE = 1e-4
#: The same in steps of the encoder per sample: below it rounding follows the motion for many samples, and is no white noise.
WHITE_STEPS = 0.15
#: m/s, the same for an axis known at its load side.
STICK_SPEED_M_S = 4e-3
#: Fine steps per sample: the carriage's antiresonance is reproduced to (2 pi f h)²/24, 5e-5 at 90 Hz and 1 kHz.
SUBSTEPS = 16
#: The same while start values are refined and nothing is reported yet.
COARSE_SUBSTEPS = 4
#: m; largest stretch of the belt at the start of a segment that begins in motion: 10 m/s² on 10 kg and 200 kN/m.
MOVING_STRETCH_M = 5e-4
#: By how much more than the model's friction at the carriage the belt may be stretched where the axis begins at rest.
HELD_SPREAD = 1.2


@dataclass(frozen=True)
class Segment:
    """A gapless piece of one recording, ready for evaluation.

    Attributes
    ----------
    position, torque : ndarray (n,), rad and N m at the motor shaft
    motion : FineMotion
        The same on a fine grid.
    keep : ndarray (n,) of bool
        Samples that count.
    noise_nm : float
        Torque noise, N m rms.
    step_rad : float
        Encoder step, rad.
    offset_m : float, m
        The belt may be stretched by up to this at the start.
    whitener : Whitener or None
        Gains worked out beforehand for the reference, a model near the right one; without it every evaluation works out its own.
    group : int
        See :func:`_group_starts`.
    rounding : tuple of float
        Shares for ``whitener``.
    process_noise, freedom_m : float
        For ``observer``, that of a carriage which is free at times, see :func:`with_observer`.
    turns : ndarray or None
        What the kernel's Coulomb friction of level 1 lacks at the reversals that count, (n,); None where none of those count, or the motor
        has no such friction.
    colour : NoiseColour
        Of the noise of the torque that acts.
    noise_factor : float
        Factor on the noise of a segment that was decimated.
    own_noise : bool
        Whether every model is judged in the noise that it passes on itself, for rounding is most of it; else in the reference's.
    unread : Unread or None
        Torque that acts and is not all in ``torque``.
    """

    record: str
    held_out: bool
    position: Array
    torque: Array
    motion: FineMotion
    keep: BoolArray
    noise_nm: float
    step_rad: float
    offset_m: float
    whitener: Whitener | None = None
    reference: Model | None = None
    rounding: tuple[float, float] = (1.0, 0.0)
    process_noise: float = 0.0
    freedom_m: float = 0.0
    group: int = 1
    observer: Observer | None = None
    turns: Array | None = None
    colour: NoiseColour = WHITE_NOISE
    noise_factor: float = 1.0
    own_noise: bool = False
    unread: Unread | None = None
    #: Whiteners of the models that were judged last, each in its own noise.
    known: dict[tuple[tuple[str, ...], bytes], Whitener] = field(init=False, repr=False, compare=False, default_factory=dict)

    @cached_property
    def firsts(self) -> NDArray[np.intp]:
        """Places, among the kept samples, of the first of each group."""
        return _group_starts(self.keep, self.group)

    @property
    def value_samples(self) -> NDArray[np.intp]:
        """Sample at which each value of the whitened residual stands."""
        return np.flatnonzero(self.keep)[self.firsts]

    @property
    def observations(self) -> list[Observation]:
        """The segment behind its observer; nothing without one."""
        return [] if self.observer is None else [Observation(self.observer, self.motion, self.torque)]

    def middle_m(self, model: Model) -> float:
        """Middle of the travel of the carriage.

        Parameters
        ----------
        model : Model
            Gives the transmission.

        Returns
        -------
        float, m
            In the zero of the motor.
        """
        return 0.5 * float(self.motion.theta.min() + self.motion.theta.max()) * model["transmission.ratio"]

    def white(self, torque: Array) -> Array:
        """Whiten a torque by the whitener worked out beforehand; linear in the torque.

        Parameters
        ----------
        torque : ndarray
            ndarray (n,) or (n, k), N m, motor shaft.

        Returns
        -------
        ndarray
            In units of the noise.
        """
        if self.observer is not None:
            return self.group_sums(self.observer.white(torque, self.keep))
        assert self.whitener is not None
        return self.group_sums(self.whitener(torque, self.keep))

    def group_sums(self, single: Array) -> Array:
        """Sums of the kept samples, group by group.

        Parameters
        ----------
        single : ndarray
            ndarray (kept,) or (kept, k).

        Returns
        -------
        ndarray
            (groups,) or (groups, k).
        """
        if self.group == 1 or len(single) == 0:  # of a record in which the axis never slid nothing counts
            return single
        rows = single.reshape(len(single), -1)
        out = np.empty((len(self.firsts), rows.shape[1]))
        _sum_groups(rows, self.firsts, self.group, out)
        return out.reshape(-1, *single.shape[1:])


def segments(
    recording: Recording,
    model: Model,
    step_rad: float,
    noise_nm: float,
    *,
    fitted: bool = False,
    substeps: int = SUBSTEPS,
    reversals: bool = False,
    path: TorquePath = FAITHFUL,
    colour: float = 0.0,
    mounted: Mounted | None = None,
    noise_known: bool = True,
) -> list[Segment]:
    """The gapless pieces of a recording that hold at least 50 samples.

    Parameters
    ----------
    recording : Recording
        Motor side.
    model : Model
        Gives inertia and transmission.
    step_rad : float, rad
        Encoder step at the motor shaft.
    noise_nm : float
        N m rms, of the torque reading.
    fitted : bool
        The model's load is good enough to say how the motor moves between the samples.
    substeps : int
        Fine steps then.
    reversals : bool
        Samples in which the motor passes through a reversal count too, for a model with :func:`turns_at_once`, and fitted.
    path : TorquePath
        From the reading to the torque that acts.
    colour : float
        Pole of the noise of the torque reading.
    mounted : Mounted or None
        Load of the record, where that is another one than the model's.
    noise_known : bool
        Whether ``noise_nm`` is no first guess, so that torque which acts unread may be counted with it.

    Returns
    -------
    list of Segment
        In the order of time.

    Raises
    ------
    ValueError
        For a path that cannot be undone.
    """
    own, model = recording.sample_period_s, loaded_model(model, mounted)
    counted = min(step_rad, smallest_step(recording.position)) if fitted else step_rad  # without the angle's own noise, which is white
    every = decimation(own, counted, "cart" in model.base_bodies) if fitted else 1
    sample, noise_factor = every * own, decimated_noise(every)
    pieces = []
    for first, last in recording.pieces:
        if last - first < 50:
            continue
        part = slice(first, last)
        ratio = model["transmission.ratio"]
        position, torque = recording.position[part], recording.torque[part]
        setpoint = None if recording.torque_setpoint is None else recording.torque_setpoint[part]
        torque, within = path.acting_torque(torque, setpoint, own)
        push = path.likeliest(torque, setpoint, own)
        if every > 1:
            position, push = position[::every][: len(position) // every], decimate(push, every)
            torque, within = decimate_torque(torque, within, every)
        place = _absolute_angle(recording, ratio) + float(recording.position[first] - recording.position[0])
        time = (recording.sidecar.session_time_s or 0.0) + recording.t_s[first] - recording.t_s[0]
        inertia = model.driven_inertia()
        motion = reconstruct(
            position,
            push,
            sample,
            inertia,
            start_rad=place,
            substeps=substeps if fitted else COARSE_SUBSTEPS,
            time_s=time,
            within=within,
        )
        stick_speed, turns = STICK_SPEED_M_S if recording.side == "load" else STICK_SPEED_RAD_S, None
        hidden = fitted and step_rad / sample > COARSE_RAD_S
        smooth = smooth_motion(model, motion, push, step_rad, noise_nm) if hidden else None
        if fitted:
            likely = motion if smooth is None else replace(motion, theta=smooth.theta, omega=smooth.omega)
            motion = _rebuild_motion(likely, model, position, push, place)
        if smooth is not None:
            motion = replace(motion, creep=(smooth.theta, smooth.omega))
            keep = ~resting_samples(motion, max(stick_speed + SURE * smooth.off_rad_s, WHITE_STEPS * counted / sample))
            keep &= ~samples_between_counts(smooth.theta[:: motion.substeps] - smooth.theta[0], position - position[0], counted)
        elif fitted and reversals and turns_at_once(model):
            slow = max(stick_speed, STICK_STEPS * step_rad / sample)
            motion, keep, turns = motion_through_reversals(
                motion, model, slow, partial(_rebuild_motion, model=model, position=position, torque=push, start_rad=place)
            )
        else:
            sure = 0.0 if "cart" in model.base_bodies else SURE_STEPS * step_rad / sample
            keep = ~resting_samples(motion, max(stick_speed, sure))
        rigid, coarse = "cart" not in model.base_bodies, fitted and step_rad / sample > stick_speed
        if smooth is None and (rigid or coarse):
            creeps, even = creeping_samples(position, sample, step_rad)
        if smooth is None and coarse:
            keep &= ~sparse_creep(even, keep, sample)
        if "cart" in model.base_bodies:
            keep &= run_in_samples(motion, ratio)
        else:
            # Nothing rings behind the motor: what creeps on counts as well, and friction that turns within a step of the encoder is noise.
            if smooth is None:
                if setpoint is not None:
                    known = ~shaken_samples(position, setpoint[::every][: len(position)], inertia, sample)
                    creeps, even = creeps & known, even & known
                creep = creep_motion(motion, position, even)
                motion = replace(motion, bristle_m=max(motion.bristle_m, ratio * step_rad), creep=creep)
                keep |= even | (creeps & ~resting_samples(motion, 0.0))
        pieces.append(
            Segment(
                recording.name,
                recording.sidecar.held_out,
                position,
                torque,
                replace(motion, mounted=mounted),
                keep,
                noise_factor * noise_nm,
                step_rad,
                _start_offset(model, motion),
                turns=turns,
                colour=acting_noise(path, colour, own, every),
                noise_factor=noise_factor,
                unread=path.unread(colour, own) if noise_known and (every == 1 or path.commanded) else None,
            )
        )
    return pieces


def _absolute_angle(recording: Recording, ratio_m_rad: float) -> float:
    """Angle of the motor at the first sample, rad: one for all records of a run, as phases of cogging and lines of an encoder have it.

    The recorded angle is, where no start position says otherwise; that is a length, and knows the angle no better than the radius.
    """
    recorded, start = float(recording.position[0]), recording.sidecar.start_position_m
    told = recorded if start is None else start / ratio_m_rad
    return recorded if abs(told - recorded) <= SAME_ANGLE * max(abs(recorded), 1.0) else told


def acting_noise(path: TorquePath, pole: float, sample_s: float, every: int) -> NoiseColour:
    """Colour of the noise of the torque that acts.

    Parameters
    ----------
    path : TorquePath
        From the reading to the torque that acts.
    pole : float
        Of the reading's noise.
    sample_s : float, s
        Sampling period of the recording.
    every : int
        Every which sample is taken: of the mean of several the slow part is left, and no path changes that.

    Returns
    -------
    NoiseColour

    Raises
    ------
    ValueError
        For a path that cannot be undone.
    """
    return NoiseColour(pole) if every > 1 else path.acting_noise(pole, sample_s)


def _rebuild_motion(
    motion: FineMotion, model: Model, position: Array, torque: Array, start_rad: float, *, lacking: Array | float = 0.0
) -> FineMotion:
    """The motion between the samples with the load that it gives rise to, and one that is lacking there, N m, mean over each fine step.

    The load is worked out from ``motion``; behind a coarse encoder the likeliest one, for a stiff belt would take the steps for a load.
    """
    true = true_motion(model, motion)
    load, _ = fine_load(model, true)
    if not np.all(np.abs(load) < ABSURD_NM):  # the model lets its bodies fly off and says nothing of the motor
        return motion
    acting = acting_cells(model, true, torque)
    push = coarse(acting, len(acting) // (len(motion.theta) - 1)) - lacking
    found = reconstruct(position, push, motion.sample_s, model.driven_inertia(), start_rad=start_rad, substeps=motion.substeps, load=load)
    return replace(found, time_s=motion.time_s, within=motion.within)


def _start_offset(model: Model, motion: FineMotion) -> float:
    """Largest stretch of the belt at the start, m: at rest no more than the friction of the carriage holds; 0 without a carriage.

    Without this bound a stretch of half a millimetre lets the carriage ring before anything counts, and where it then sticks is chance.
    """
    if "cart" not in model.base_bodies:
        return 0.0
    if begins_in_motion(motion):
        return MOVING_STRETCH_M
    at = operating_point(model, float(motion.theta[0]) * model["transmission.ratio"], 1.0)
    held = matrices(model, at).hold(("motor",))
    compliance = float(np.linalg.inv(held.K)[held.bodies.index("cart"), held.bodies.index("cart")])
    return min(HELD_SPREAD * model.get("cart_friction.level") * compliance, MOVING_STRETCH_M)


def _group_starts(keep: BoolArray, size: int) -> NDArray[np.intp]:
    """Places, among the kept samples, of the first of every so many neighbours in time; a group that is not complete is left out.

    The sum of neighbouring values of the whitened residual over √size is white again and holds the lower 1/size of the frequencies: above
    that a slow motion shows nothing but the encoder's rounding (Haar's low-pass).
    """
    kept = np.flatnonzero(keep)
    begins = np.flatnonzero(np.diff(kept, prepend=-2) > 1)
    lengths = np.diff(begins, append=len(kept))
    place, left = np.arange(len(kept)) - np.repeat(begins, lengths), np.repeat(begins + lengths, lengths) - np.arange(len(kept))
    return np.flatnonzero((place % size == 0) & (left >= size))


@compiled
def _sum_groups(single: Array, firsts: NDArray[np.intp], size: int, out: Array) -> None:
    """Sums of so many rows from each of the places on, over √size; (n, k) -> (groups, k)."""
    scale = 1.0 / math.sqrt(size)
    for g in range(firsts.shape[0]):
        for c in range(single.shape[1]):
            total = single[firsts[g], c]
            for i in range(1, size):
                total += single[firsts[g] + i, c]
            out[g, c] = scale * total
