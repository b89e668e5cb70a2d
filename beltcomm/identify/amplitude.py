"""Largest excitation that the limits allow: predicted before every step from what is known of the axis so far.

The amplitude rises step by step (thesis 3.4).  Before each step the record is simulated for a family of models that
stands for what is not known yet; travel, speed, motor torque and belt force, the resonance included, must stay inside
their limits for every member.  A torque limit alone does not protect the belt.  The way that a stop takes is part of the travel:
even from half as fast again as predicted it must end inside the window.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array
from beltcomm.axis import Axis
from beltcomm.errors import Refused
from beltcomm.model import BELT_STIFFNESSES, Model
from beltcomm.model.linear import fastest_rate, operating_point
from beltcomm.recording import Recording
from beltcomm.simulate.forward import integrate_torque
from beltcomm.simulate.stopping import (
    UNKNOWN_MASSES_KG,
    Braking,
    HostLoss,
    run_on_distance,
    total_friction,
    total_inertia,
    unknown_loads_kg,
)

#: A carriage has at least this share of the mass that somebody states.
LIGHTER_SHARE = 0.5
#: Spread of mass, stiffness and friction around a first estimate.
FIRST_ESTIMATE_SPREAD = 0.15
#: Share of a damping that nobody measured yet which counts: a short record tells it badly, and with less of it the belt swings more and the
#: carriage goes further.
UNMEASURED_DAMPING = 0.5
#: A stop is counted from this share of the predicted carriage speed, and a record is stopped at this share of the predicted motor
#: speed and what coarse encoders add, m/s.
SPEED_RESERVE, ENCODER_SLACK_M_S = 1.5, 0.01
#: Where friction takes most of the torque a carriage wanders further than any of the family: share of the predicted travel that a stop
#: at the edge of the window is counted from.
DRIFT_RESERVE = 1.25
#: A run-on is counted from this share of the predicted speed; a machine that is still faster is stopped by the watch of its run-on.
DIED_RESERVE = 1.2
#: The limit that a carriage reaches when its host dies, in words.
DIES = "travel if the computer dies"
#: A carriage that went less far than this share of what one of the family would have gone is not that one.
RULED_OUT = 2.0
#: Steps of the search: the amplitude is found to 1 part in 2^12.
_BISECTIONS = 12


@dataclass(frozen=True)
class MotionLimits:
    """Limits of a record.

    Attributes
    ----------
    travel_m : float
        m either way from the start. speed_m_s, torque_nm (motor shaft), belt_force_n.
    window_m : float
        m either way from the start, which a stop must not leave.
    ends_m : float
        m to the nearest end, beyond which nothing may go even when the host dies.
    """

    travel_m: float
    speed_m_s: float
    torque_nm: float
    belt_force_n: float
    window_m: float = np.inf
    ends_m: float = np.inf


@dataclass(frozen=True)
class Prediction:
    """Largest travel from the start, carriage speed, motor torque and belt force of a record, over a family of models.

    Attributes
    ----------
    stop_m : float
        Way of a stop from ``SPEED_RESERVE`` times the carriage's speed.
    motor_m_s : float
        Motor speed times i_t; it rings more.
    run_on_m, died_m : tuple of float
        When the host dies at the worst instant, one entry for each way in which the drive may take that (least demanding last): how far the
        carriage runs on, and how far from the start it comes.
    """

    travel_m: float
    speed_m_s: float
    torque_nm: float
    belt_force_n: float
    stop_m: float = 0.0
    motor_m_s: float = 0.0
    run_on_m: tuple[float, ...] = ()
    died_m: tuple[float, ...] = ()

    @property
    def watched_m_s(self) -> float:
        """Speed at which the record is stopped, m/s, as the motor shows it."""
        return SPEED_RESERVE * self.motor_m_s + ENCODER_SLACK_M_S

    def use_of(self, limits: MotionLimits) -> dict[str, float]:
        """Share of each limit that is used.

        Parameters
        ----------
        limits : MotionLimits
            Of the axis.

        Returns
        -------
        dict of str to float
            1 at the limit; 0 where there is none.
        """
        return {
            "travel": self.travel_m / limits.travel_m,
            "speed": self.speed_m_s / limits.speed_m_s,
            "motor torque": self.torque_nm / limits.torque_nm,
            "belt force": self.belt_force_n / limits.belt_force_n,
            "travel with a stop": (DRIFT_RESERVE * self.travel_m + self.stop_m) / limits.window_m if np.isfinite(limits.window_m) else 0.0,
            DIES: self.died_m[-1] / limits.ends_m if self.died_m and np.isfinite(limits.ends_m) else 0.0,
        }


@dataclass(frozen=True)
class AmplitudeStep:
    """The amplitude chosen for one record.

    Attributes
    ----------
    binds : str
        The limit that it reaches, or "step" when it is only the next step.
    """

    amplitude_nm: float
    prediction: Prediction
    binds: str


def _no_stop(_model: Model) -> Braking:
    """A stop that takes no way: where it is of no interest."""
    return Braking(np.inf, 0.0)


def _no_loss(_model: Model) -> tuple[HostLoss, ...]:
    """A host that does not die: where it is of no interest."""
    return ()


def unknown_masses_kg(axis: Axis) -> tuple[float, ...]:
    """Carriages to count with until it is weighed; none below ``LIGHTER_SHARE`` of what is stated.

    One that is lighter still is faster than predicted, and the watch of the record stops it.

    Parameters
    ----------
    axis : Axis
        With the range of its load.

    Returns
    -------
    tuple of float
        kg, rising.
    """
    lightest = LIGHTER_SHARE * (axis.payload.mass_kg or 0.0)
    return tuple(sorted({max(mass, lightest) for mass in unknown_loads_kg(axis)}))


def unknown_payload(
    model: Model, stiffness_shares: tuple[float, float] = (1.0, 1.0), masses_kg: Sequence[float] = UNKNOWN_MASSES_KG
) -> list[Model]:
    """Family for an axis of which only the data sheets are known: light and heavy carriages, belt 25 % softer and stiffer.

    Friction is taken at half its breakaway value: it takes energy from the resonance and holds the carriage back.

    Parameters
    ----------
    model : Model
    stiffness_shares : tuple of float
        The softest and the stiffest belt thought of, as shares of the model's.
    masses_kg : sequence of float, kg
        Of the carriage with payload.
    """
    family = []
    for mass in masses_kg:
        for factor in (0.75 * stiffness_shares[0], 1.25 * stiffness_shares[1]):
            family.append(half_friction(model.with_values({"cart.mass": mass, **_scale_values(model, _stiffness_names(model), factor)})))
    return family


def family_around(model: Model) -> list[Model]:
    """Family around an estimate: mass and stiffness apart by ``FIRST_ESTIMATE_SPREAD``, friction and belt damping lowered by it.

    Dampings that nobody measured yet count with ``UNMEASURED_DAMPING`` of them; of a rigid axis not at all: where it hardly breaks away
    friction poses as damping, by which nothing would ever be fast.

    Parameters
    ----------
    model : Model
        An estimate.

    Returns
    -------
    list of Model
        The estimate itself first.
    """
    known, apart = model.parameters, FIRST_ESTIMATE_SPREAD
    levels = [n for n in known if n.endswith((".damping", ".level")) and not n.startswith("coupling")]
    untold = {n for n in levels if n.endswith(".damping") and known[n].interval is None}
    share = 0.0 if model.rigid else UNMEASURED_DAMPING
    calmer = model.with_values({n: model[n] * (share if n in untold else 1.0 - apart) for n in levels})
    stiff, family = _stiffness_names(model), [model]
    for a, b in itertools.product((-1, 1), repeat=2):
        values = {"cart.mass": model["cart.mass"] * (1 + a * apart), **_scale_values(model, stiff, 1 + b * apart)}
        # a first estimate may stand beside its bound
        family.append(calmer.with_values({n: min(max(v, known[n].low), known[n].high) for n, v in values.items()}))
    return family


def not_ruled_out(family: Sequence[Model], recording: Recording, ratio: float, position_m: float) -> Sequence[Model]:
    """The members of a family of light and heavy carriages that a record may be of, or the heaviest ones.

    Ruled out is one that the recorded torque would have moved ``RULED_OUT`` times as far as the motor went, even if friction were all that
    the carriage broke away at (the family counts with half of that).

    Parameters
    ----------
    family : sequence of Model
        Of carriages of one axis.
    recording : Recording
    ratio : float
        i_t, m/rad.
    position_m : float, m
        Carriage on the axis.
    """
    sample_s, torque = recording.sample_period_s, recording.torque if recording.torque_setpoint is None else recording.torque_setpoint
    went_m = ratio * float(np.ptp(recording.position))

    def way_m(model: Model) -> float:
        held = model.with_values(_scale_values(model, _friction_names(model), 2.0))
        gone = integrate_torque(held, torque, sample_s, position_m, substeps=_substeps(held, sample_s, position_m))
        return float(np.ptp(gone.cart_position_m))

    heaviest = max(model["cart.mass"] for model in family)
    return [model for model in family if model["cart.mass"] == heaviest or way_m(model) <= RULED_OUT * went_m]


def _predict(
    family: Sequence[Model],
    torque: Array,
    sample_s: float,
    position_m: float,
    braking: Callable[[Model], Braking] = _no_stop,
    losses: Callable[[Model], Sequence[HostLoss]] = _no_loss,
) -> Prediction:
    """Worst case of one record over a family of models, starting at rest at ``position_m``, each torque held for ``sample_s``.

    ``braking`` is what stops each of the models, ``losses`` what the death of the host means for each in the ways the drive may take it.
    """
    peak = float(np.max(np.abs(torque)))
    ways: list[tuple[float, ...]] = []
    places: list[tuple[float, ...]] = []
    travel = speed = force = stop = motor = 0.0
    for model in family:
        result = integrate_torque(model, torque, sample_s, position_m, substeps=_substeps(model, sample_s, position_m))
        travel = max(travel, float(np.max(np.abs(result.cart_position_m - result.cart_position_m[0]))))
        speeds = np.diff(result.cart_position_m) / sample_s
        fastest = float(np.max(np.abs(speeds)))
        died = [_run_on_of_record(model, result.cart_position_m, DIED_RESERVE * speeds, peak, loss) for loss in losses(model)]
        ways.append(tuple(way for way, _ in died))
        places.append(tuple(place for _, place in died))
        speed, stop = max(speed, fastest), max(stop, braking(model).way_m(SPEED_RESERVE * fastest))
        motor = max(motor, model["transmission.ratio"] * float(np.max(np.abs(result.velocity_rad_s))))
        force = max(force, float(np.max(result.belt_force_n)))
    farthest = [tuple(max(one) for one in zip(*found, strict=True)) for found in (ways, places)]
    return Prediction(travel, speed, peak, force, stop, motor, *farthest)


def _run_on_of_record(model: Model, place_m: Array, speed_m_s: Array, torque_nm: float, loss: HostLoss) -> tuple[float, float]:
    """Longest run-on at any instant of a record, m, and the farthest place from its start.   place_m : (n,).   speed_m_s : (n - 1,)."""
    axis = (torque_nm, total_friction(model), total_inertia(model), model["transmission.ratio"], loss)
    gone = place_m[1:] - place_m[0]
    up, down = run_on_distance(speed_m_s, *axis), run_on_distance(-speed_m_s, *axis)
    return float(np.max([up, down])), float(np.max([gone + up, down - gone]))


def largest_amplitude(
    family: Sequence[Model],
    shape: Array,
    sample_s: float,
    position_m: float,
    limits: MotionLimits,
    at_most_nm: float,
    braking: Callable[[Model], Braking] = _no_stop,
    losses: Callable[[Model], Sequence[HostLoss]] = _no_loss,
) -> AmplitudeStep:
    """The largest amplitude, up to ``at_most_nm``, for which every member of the family stays inside all limits.

    Parameters
    ----------
    family : sequence of Model
        Models that the axis may be.
    shape : ndarray (n,)
        The record with unit amplitude.
    sample_s : float, s
    position_m : float, m
        Carriage on the axis.
    limits : MotionLimits
        Of the axis.
    at_most_nm : float, N m, motor shaft
        What motor and drive allow.
    braking, losses : callable
        As :func:`_predict`.

    Raises
    ------
    Refused
        When even a fiftieth of ``at_most_nm`` is too much.
    """
    full = _predict(family, at_most_nm * shape, sample_s, position_m, braking, losses)
    if max(full.use_of(limits).values()) <= 1.0:
        return AmplitudeStep(at_most_nm, full, "motor torque" if full.torque_nm >= 0.999 * limits.torque_nm else "step")
    low, high, binds = 0.0, at_most_nm, _first(full, limits)
    best: Prediction | None = None
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        trial = _predict(family, middle * shape, sample_s, position_m, braking, losses)
        if max(trial.use_of(limits).values()) <= 1.0:
            low, best = middle, trial
        else:
            high, binds = middle, _first(trial, limits)
    if best is None or low < at_most_nm / 50.0:
        if binds == DIES:
            raise Refused(
                f"no excitation fits: if the computer died in one of ±{high:.3g} N m, the carriage could run on by "
                f"{1e3 * trial.run_on_m[-1]:.0f} mm before the drive has noticed and stopped it, and {1e3 * limits.ends_m:.0f} mm are left "
                "to the nearest end; start nearer to the middle of the travel"
            )
        raise Refused(
            f"no excitation fits the limits: already ±{high:.3g} N m would break the limit on {binds} "
            f"(travel {limits.travel_m:.3g} m, speed {limits.speed_m_s:.3g} m/s, belt force {limits.belt_force_n:.3g} N); "
            "start nearer to the middle of the travel or check the limits in axis.yaml"
        )
    return AmplitudeStep(low, best, binds)


def _first(prediction: Prediction, limits: MotionLimits) -> str:
    use = prediction.use_of(limits)
    return max(use, key=lambda name: use[name])


def _stiffness_names(model: Model) -> list[str]:
    return [n for n in BELT_STIFFNESSES if n in model.parameters]


def _scale_values(model: Model, names: Sequence[str], factor: float) -> dict[str, float]:
    return {name: model[name] * factor for name in names}


def half_friction(model: Model) -> Model:
    """The model with half of its friction: with less of it a carriage goes further.

    Parameters
    ----------
    model : Model
        With friction.
    """
    return model.with_values(_scale_values(model, _friction_names(model), 0.5))


def _friction_names(model: Model) -> list[str]:
    return [n for n in model.parameters if n.endswith(".level") or n.startswith("viscous")]


def _substeps(model: Model, sample_s: float, position_m: float) -> int:
    """Of a period: eigenvalue times sub-step below 0.3, so that the fastest mode has a phase error below 0.4 %."""
    return max(5, int(np.ceil(sample_s * fastest_rate(model, operating_point(model, position_m)) / 0.3)))
