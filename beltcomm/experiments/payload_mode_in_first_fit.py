"""A payload that swings in the first response: without it the fit makes too light a carriage, and more viscous friction than there is.

A first loop that computes torque ahead from such numbers drifts off its reference.  Where a payload on a spring explains the response to
the noise, the first loop and its motions count with the mass and the friction found beside it, the payload as a part of the carriage.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from beltcomm.axis import Axis
from beltcomm.control import Cascade, CascadeStructure
from beltcomm.design.margins import margins
from beltcomm.effects.payload_mode import implausible
from beltcomm.errors import DataError, Refused
from beltcomm.fit.residual.segment import segments
from beltcomm.fit.residual.whitened import OUTLIER, whitened_residual
from beltcomm.identify.final import FinalModel, evidence, final_model
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.rundata import analyse

SWING = "payload_mode"
#: Where a swing is looked for: from this, Hz, to this many times the antiresonance; its mass and damping at first, of the carriage.
LOWEST_HZ, ABOVE, TRIALS = 4.0, 1.5, 18
MASS_SHARE, DAMPING_RATIO = 0.3, 0.04
#: N s/m: a belt damper that the swing drove to nothing begins with this.
LEAST_DAMPING_NS_M = 1.0
#: kg: nothing lighter is looked for, as on a carriage that a fit made a feather because its belt is slack.
LEAST_MASS_KG = 0.01
#: Starts that are fitted, the likeliest first; evidence that a payload must have.
STARTS, CLEAR_EVIDENCE = 2, 150.0


def with_swing(found: FinalModel, recordings: Sequence[Recording], axis: Axis, counts_per_rev: int) -> Model | None:
    """The model with a payload that swings, where it explains the records to the noise and clearly better than ``found``; else None.

    Parameters
    ----------
    found : FinalModel
        Fit without it.
    recordings : sequence of Recording
        Of the fit.
    axis : Axis
    counts_per_rev : int
    """
    step, noise_nm, path = 2.0 * math.pi / counts_per_rev, found.fit.noise_nm, found.fit.path

    def left(start: Model) -> float:
        pieces = [p for r in recordings for p in segments(r, start, step, noise_nm, fitted=True, path=path)]
        return float(sum(np.sum(np.minimum(whitened_residual(p, start, start.vector()) ** 2, OUTLIER)) for p in pieces))

    for start in sorted(_starts(found.fit.model), key=left)[:STARTS]:
        try:
            other = final_model(recordings, axis, counts_per_rev, start=start).fit
        except DataError:
            continue
        values = {name.removeprefix(f"{SWING}."): item.value for name, item in other.model.parameters.items()}
        if not other.suspect and evidence(other, found.fit) > CLEAR_EVIDENCE and not implausible(values):
            return other.model
    return None


def _starts(model: Model) -> Iterator[Model]:
    mass = MASS_SHARE * model["cart.mass"]
    if mass < LEAST_MASS_KG:
        return
    belt = {"belt_damping.damping": max(model["belt_damping.damping"], LEAST_DAMPING_NS_M)}
    for freq_hz in np.geomspace(LOWEST_HZ, ABOVE * analyse.characteristic_hz(model, 0.0)[0], TRIALS):
        omega = 2.0 * math.pi * float(freq_hz)
        swing = {"payload.mass": mass, "stiffness": mass * omega**2, "damping": 2.0 * DAMPING_RATIO * mass * omega, "hardening": 0.0}
        yield model.with_effect(SWING, swing, "first estimate").with_values(belt)


def as_one(model: Model) -> Model:
    """Model with the payload fixed to the carriage.

    Parameters
    ----------
    model : Model
        With the payload mode.
    """
    return model.without_effect(SWING).with_values({"cart.mass": model["cart.mass"] + model["payload.mass"]})


def swing_words(model: Model) -> str:
    """The payload mode that is counted with, in words.

    Parameters
    ----------
    model : Model
        With the payload mode.
    """
    freq_hz = math.sqrt(model["payload_mode.stiffness"] / model["payload.mass"]) / (2.0 * math.pi)
    return (
        f"a payload of {model['payload.mass']:.2g} kg seems to swing on the carriage at {freq_hz:.3g} Hz; the first loop counts with it as "
        "a part of the carriage"
    )


def proven_margin_deg(
    swing: Model, cascade: Cascade, structure: CascadeStructure, at_m: float, dead_time_s: float, apparent_damping_nm_s_rad: float
) -> float:
    """Smallest phase margin of a loop on the axis whose payload swings, deg.

    Parameters
    ----------
    swing : Model
        With the payload mode.
    cascade : Cascade
    structure : CascadeStructure
    at_m : float, m
        Carriage on the axis.
    dead_time_s : float, s
        Of the torque path.
    apparent_damping_nm_s_rad : float, N m s/rad, motor shaft
        Viscous friction around standstill.

    Raises
    ------
    Refused
        Where that is not stable with some margin.
    """
    plants = analyse.design_plants(swing, [at_m], [swing["cart.mass"]], dead_time_s, apparent_damping_nm_s_rad)
    found = margins(cascade, plants, structure.period_s)
    least = min(m.phase_margin_deg for m in found)
    if not all(m.stable and m.velocity_stable for m in found) or least < analyse.LEAST_PHASE_MARGIN_DEG:
        raise Refused(
            f"{swing_words(swing)}, and with it swinging that loop would not hold: fix the payload or take it off, then identify again"
        )
    return least
