"""Are ways and torques what the drive and axis.yaml say?  What the first second of excitation tells of it, and a ruler tells the rest.

Torque over acceleration of the motor is its inertia, which data sheets know well.  Wrong by a factor k it shows that torques (6076h) or
angles (608Fh, 6092h, 6093h) are wrong by k; which of the two it does not show.  A feed constant that is wrong in axis.yaml by k leaves
torques and angles as they are: mass and belt stiffness are then wrong by 1/k², and only the stiffness has a data sheet.  Which way is
plus, and how far one turn leads, no sensor of the motor knows: that takes a ruler.
"""

from __future__ import annotations

import math

import numpy as np

from beltcomm.axis import Axis
from beltcomm.errors import Refused, UsageError
from beltcomm.given import pasted
from beltcomm.machine.machine import Machine
from beltcomm.machine.prediction_watch import other_units, units_of
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.result import Result
from beltcomm.simulate.stopping import unknown_loads_kg

#: The inertia may differ from the data sheets' by this factor in a first estimate from a second of excitation, and in a fit.
FIRST_FACTOR, FITTED_FACTOR = 1.6, 1.35
#: Inertia that steps of the torque may show, in parts of the data sheets': barely broken away 1.2 to 1.6, louder 0.99 to 1.1.
STEPS_SHOW = (0.9, 1.6)
#: Share of the motor's own inertia by its data sheet that motor and load together have at least; the sheet is right to 10 %.
RIGID_LEAST = 0.75
#: Where a first estimate's inertia is from when it is that of the data sheets.
OF_THE_SHEETS = "first estimate, inertia of the data sheets"
#: Share of the torque that must accelerate the motor in the record of a first estimate: barely broken away it is 0.46 to 0.65.
LEAST_SHARE = 0.5
#: The belt's stiffness as a share of its data sheet's, between which the feed constant is not suspected: real ones show 0.5 to 1.
SOFTEST, STIFFEST = 0.3, 2.0
#: m: a ruler is read to this; share of a way that may be missing beside that; the shortest way that is worth it.
RULER_M, RULER_SHARE, SHORTEST_M = 1e-3, 0.01, 0.02
STIFFNESS = "belt_stiffness.stiffness"
#: How play is felt, and what follows.
PLAY = (
    "Hold the motor and push the carriage both ways against a dial gauge: where there is play, mend clamp, key or coupling first; beltcomm "
    "diagnose RUN looks for a gap in what was recorded"
)
#: Of the lightest load that is counted with: none is lighter than that; a fit that ends there has found none.
LIGHTEST_SHARE = 0.1


def _accelerating_share(recording: Recording, inertia_kg_m2: float) -> float:
    """Share of a record's torque that went into the acceleration of the motor:  rms(J θ'')/rms(τ), where the torque is large."""
    acceleration = np.diff(recording.position, 2) / recording.sample_period_s**2
    torque = 0.5 * (recording.torque[1:-1] + recording.torque[:-2])
    large = np.abs(torque) > 0.5 * np.max(np.abs(torque))
    return float(inertia_kg_m2 * np.sqrt(np.mean(acceleration[large] ** 2) / np.mean(torque[large] ** 2)))


def _jumping_inertia(recording: Recording) -> float:
    """Inertia that the steps of a torque show, kg m² at the motor; nan for a torque without any.

    J (a[n+1] - a[n]) = (τ[n+1] - τ[n-1])/2 - what the load changes by from one sample to the next,   a[n] = (θ[n+1] - 2 θ[n] + θ[n-1])/T²

    Least squares over the changes that are larger than half of the largest.  A belt, and a gap before it, answer later than the motor: the
    load counts by some percent only.
    """
    change = np.diff(recording.position, 3)[1:] / recording.sample_period_s**2
    torque = 0.5 * (recording.torque[3:-1] - recording.torque[1:-3])
    large = np.abs(torque) > 0.5 * np.max(np.abs(torque))
    moved = float(torque[large] @ change[large])
    return float(torque[large] @ torque[large]) / moved if moved > 0.0 else math.nan


def _inertia_share(axis: Axis, model: Model) -> float:
    """Inertia of a fit over that of the data sheets."""
    return model["motor.inertia"] / axis.motor_side_inertia_kg_m2


def _contradiction(axis: Axis, model: Model) -> str:
    share, stated = _inertia_share(axis, model), axis.motor_side_inertia_kg_m2
    times = f"{max(share, 1.0 / share):.2g} times {'more' if share > 1.0 else 'less'}"
    return (
        f"torque over acceleration of the motor shows an inertia of {model['motor.inertia']:.3g} kg m², by axis.yaml it is {stated:.3g} "
        f"kg m²: {times}"
    )


def _not_told_apart(axis: Axis, model: Model, first: Model, response: Recording, more_room: str) -> str:
    """In words, that a fit takes the carriage for a part of the motor, whose inertia an excitation before it has shown rightly.

    ``model`` is the fit to ``response``, ``first`` the estimate before it, ``more_room`` what gives more of it.
    """
    ratio = axis.transmission_m_rad
    together = axis.motor_side_inertia_kg_m2 + first["cart.mass"] * ratio**2
    friction_nm = first["coulomb.level"] + first["cart_friction.level"] * ratio
    peak_nm = float(np.abs(response.torque).max())
    shown = f"showed {_inertia_share(axis, first):.2f} times that of axis.yaml"
    if first.parameters["motor.inertia"].origin == OF_THE_SHEETS:
        shown = "showed about that of axis.yaml at the steps of its torque"
    return (
        f"{_contradiction(axis, model)}. The excitation before it {shown}, so "
        f"torques and angles are scaled rightly, and it is likelier that {response.name} does not tell motor and carriage apart: together "
        f"they are {together:.3g} kg m². The carriage moved by {1e3 * ratio * float(np.ptp(response.position)):.1f} mm at most, and "
        f"friction takes {100.0 * min(friction_nm / peak_nm, 1.0):.0f} % of the ±{peak_nm:.3g} N m. It needs more way or more torque: "
        f"{more_room}; look whether limits.feed_force_n and pulley_torque_nm allow more by the data sheets; and compare "
        "belt.specific_stiffness_n and coupling.stiffness_nm_rad with theirs: an excitation planned by wrong ones misses the resonance"
    )


def check_first(machine: Machine, model: Model, recording: Recording) -> Model:
    """Check the scaling by the first estimate, which is returned; nothing is said where friction took most of the torque.

    What it does not know makes the estimate wrong: behind a gap the motor moves as if the carriage pushed it, a torque that acts late looks
    like one that moves more.  Friction makes the steps of the torque show more than there is, nothing makes them show less.  Where they
    show about the data sheets' inertia, or more while the estimate is less, that of the sheets stands and the next, louder record decides.

    Parameters
    ----------
    machine : Machine
    model : Model
    recording : Recording

    Raises
    ------
    Refused
    """
    if model.rigid:
        _check_rigid(machine, recording)
        return model
    stated = machine.axis.motor_side_inertia_kg_m2
    share = _accelerating_share(recording, stated)
    if share < LEAST_SHARE:
        machine.folder.journal(f"scale: {100 * share:.0f} % of the torque of {recording.name} accelerated the motor, too little to tell")
        return model
    shown, estimated = _jumping_inertia(recording) / stated, _inertia_share(machine.axis, model)
    told = f"scale: the steps of {recording.name} show {shown:.2f} times the inertia of axis.yaml, the estimate {estimated:.2f} times"
    off = not 1.0 / FIRST_FACTOR < estimated < FIRST_FACTOR
    if off and (STEPS_SHOW[0] < shown < STEPS_SHOW[1] or estimated < 1.0 < shown):
        machine.folder.journal(told)
        return model.with_values({"motor.inertia": stated}, OF_THE_SHEETS)
    _check_scale(machine, model, FIRST_FACTOR)
    return model


def _check_rigid(machine: Machine, recording: Recording) -> None:
    """Check the scaling where motor and load are one inertia, of which the data sheets know a part: the motor, and the loads counted with.

    A load that gives way after all leaves the motor to the steps of the torque; friction makes them show more.   Raises Refused.
    """
    axis, shown = machine.axis, _jumping_inertia(recording)
    alone = axis.motor_side_inertia_kg_m2
    most = alone + axis.transmission_m_rad**2 * max(unknown_loads_kg(axis)[-1], axis.payload.mass_kg or 0.0)
    if not math.isfinite(shown):
        return
    machine.folder.journal(
        f"scale: the steps of {recording.name} show {shown:.3g} kg m² of motor and load together; axis.yaml has {alone:.3g} kg m² of the "
        f"motor alone, {most:.3g} kg m² with the heaviest load counted with"
    )
    if shown < RIGID_LEAST * alone:
        found = f"less than the {alone:.3g} kg m² that the motor side alone has by axis.yaml, {alone / shown:.2g} times or more"
    elif shown > FIRST_FACTOR * most and _accelerating_share(recording, shown) > LEAST_SHARE:
        found = f"more than the {most:.3g} kg m² that it would have with the heaviest load counted with, {shown / most:.2g} times or more"
    else:
        return
    raise Refused(
        f"torque over acceleration in {recording.name} shows {shown:.3g} kg m² of motor and load together: {found}. Nothing faster is "
        "tried. Either the drive's torque or its angle is scaled wrongly (6076h; 608Fh, 6091h, 6092h, 6093h), or the motor's inertia, the "
        "gearbox or the payload in axis.yaml. A ruler tells of the angle: beltcomm move --drive DRIVE --axis AXIS --by 50mm"
    )


def _check_scale(machine: Machine, model: Model, factor: float) -> None:
    """Compare the inertia that torque and acceleration show with the data sheets, before anything faster; they may differ by ``factor``.

    Raises Refused with both values and what to look at.
    """
    share = _inertia_share(machine.axis, model)
    machine.folder.journal(
        f"scale: torque over acceleration shows {model['motor.inertia']:.3g} kg m² at the motor, axis.yaml "
        f"{machine.axis.motor_side_inertia_kg_m2:.3g}, {share:.2f} times that"
    )
    if 1.0 / factor <= share <= factor:
        return
    raise Refused(
        f"{_contradiction(machine.axis, model)}, and nothing faster is tried. Either the drive's torque or its angle is scaled wrongly "
        f"(6076h; 608Fh, 6091h, 6092h, 6093h): {other_units(share, units_of(machine.drive.capabilities))}. Or gearbox.ratio or an inertia "
        "of motor, gearbox, coupling or pulley in axis.yaml is wrong. A ruler tells: beltcomm move --drive DRIVE --axis AXIS --by 50mm. A "
        "gap spoils this estimate too: hold the motor and move the carriage by hand; if there is free play, mend clamp, key or coupling "
        "first"
    )


def check_fitted(machine: Machine, model: Model, first: Model, response: Recording) -> None:
    """Check the scaling by the model of a frequency response, before a loop is closed; a feed constant in doubt is a remark.

    Parameters
    ----------
    machine : Machine
    model : Model
    first : Model
        What the excitation before it showed; where that agrees with the data sheets, it is not the scale that is wrong. Nor is it where the
        steps of the torque show about the data sheets' inertia and a fit, of a machine with more bodies, say, somewhat less.
    response : Recording
        The record that it was fitted to.

    Raises
    ------
    Refused
    """
    if model.rigid:
        _check_rigid(machine, response)
    if model["cart.mass"] < LIGHTEST_SHARE * unknown_loads_kg(machine.axis)[0]:
        raise Refused(
            f"by {response.name} the carriage weighs {1e3 * model['cart.mass']:.2g} g: the motor turns as if nothing hung on it, and no "
            "loop is closed on such a model. Look whether the belt is slack or off, and whether clamp, key or coupling are loose; where "
            f"the carriage hardly moved: {machine.more_room}, or allow more torque"
        )
    if model.rigid:
        return
    if _inertia_share(machine.axis, model) > FITTED_FACTOR and 1.0 / FIRST_FACTOR <= _inertia_share(machine.axis, first) <= FIRST_FACTOR:
        raise Refused(_not_told_apart(machine.axis, model, first, response, machine.more_room))
    share, shown = _inertia_share(machine.axis, model), _jumping_inertia(response) / machine.axis.motor_side_inertia_kg_m2
    scaled_rightly = share < 1.0 / FITTED_FACTOR and STEPS_SHOW[0] < shown < STEPS_SHOW[1]
    if scaled_rightly and share < 1.0 / FIRST_FACTOR:
        raise Refused(
            f"{_contradiction(machine.axis, model)}. The steps of its torque in {response.name} show {shown:.2f} times that, so "
            "torques and angles are scaled rightly: the motor moves as if the carriage pushed it, as it does in a gap (backlash) or behind "
            f"a loose clamp, key or coupling, and no loop is closed on such a model. {PLAY}"
        )
    if scaled_rightly:
        machine.remark(  # gains follow the inertia: with too little of it the loop is slower than it might be
            f"the fit of {response.name} makes {share:.2f} times the inertia of axis.yaml, the steps of its torque show {shown:.2f} times: "
            "torques and angles are scaled rightly, and something acts that the model does not have; beltcomm diagnose looks for it"
        )
    else:
        _check_scale(machine, model, FITTED_FACTOR)
    doubt = _feed_constant_in_doubt(machine.axis, model, machine.place_m(machine.position_m))
    if doubt:
        machine.remark(doubt)


def _feed_constant_in_doubt(axis: Axis, model: Model, position_m: float | None) -> str:
    """In words, that the belt is so much softer or stiffer than its data sheet that the feed constant may be wrong; "" when it is not.

    Nothing is said where nobody knows the carriage's position.
    """
    if position_m is None or STIFFNESS not in model.parameters:
        return ""
    share = model[STIFFNESS] / axis.belt_stiffness_n_m(position_m)
    if SOFTEST <= share <= STIFFEST:
        return ""
    now = axis.transmission_m_rad
    times = f"{max(share, 1.0 / share):.2g} times {'stiffer' if share > 1.0 else 'softer'}"
    return (
        f"the belt is {times} than its data sheet says. A feed constant that is wrong in axis.yaml looks like this: with "
        f"{1e3 * math.tau * now * math.sqrt(share):.3g} mm per turn of the motor instead of {1e3 * math.tau * now:.3g} mm it would fit. "
        "A loose belt does too: measure a creep with a ruler, beltcomm move --drive DRIVE --axis AXIS --by 50mm"
    )


def ruler(axis: Axis, crept_m: float, measured_m: float) -> Result:
    """Compare a creep by the encoder with what a ruler says: the feed constant.

    Parameters
    ----------
    axis : Axis
        With the feed constant.
    crept_m : float, m
        By the encoder, signed.
    measured_m : float, m
        By the ruler, negative for the other way.

    Returns
    -------
    Result
        The feed constant that the ruler says; exit code 1 when they differ by more than the ruler's reading.

    Raises
    ------
    UsageError
        For a way too short to tell.
    """
    axis.require("the feed constant", "pulley.effective_radius_m")
    if abs(crept_m) < SHORTEST_M:
        raise UsageError(f"{1e3 * crept_m:g} mm are too short for a ruler; creep {1e3 * SHORTEST_M:.0f} mm or more")
    share = measured_m / crept_m
    error = RULER_M / abs(crept_m)
    radius = float(axis.get("pulley.effective_radius_m"))
    data = {"crept_m": crept_m, "measured_m": measured_m, "share": share, "error": error, "effective_radius_m": radius * abs(share)}
    told = f"By the encoder the carriage crept {1e3 * crept_m:+.2f} mm, by the ruler {1e3 * measured_m:+.2f} ± {1e3 * RULER_M:g} mm"
    if share < 0.0:
        text = [f"{told}: the other way. Plus of the drive is not plus of axis.yaml: turn the drive's polarity (607Eh), both bits."]
    elif abs(share - 1.0) <= error + RULER_SHARE:
        return Result(data, [f"{told}: the feed constant of axis.yaml is right, within {100.0 * (error + RULER_SHARE):.1f} %."])
    else:
        text = [
            f"{told}: a factor of {share:.3f} ± {error:.3f}. If the drive counts rightly (one turn of the motor by hand shows it), "
            f"pulley.effective_radius_m is {1e3 * radius * share:.4g} mm instead of {1e3 * radius:.4g} mm, or gearbox.ratio "
            f"{axis.gearbox.ratio / share:.4g} instead of {axis.gearbox.ratio:g}. Correct axis.yaml before anything moves by it."
        ]
    return Result(data, text, 1)


def ruler_line(drive: str, axis: Axis, crept_m: float) -> str:
    """Line behind a creep that says how to check it with a ruler.

    Parameters
    ----------
    drive : str
        As for ``--drive``.
    axis : Axis
        With its transmission.
    crept_m : float, m
        Way of the carriage by the encoder.
    """
    turn = 1e3 * math.tau * axis.transmission_m_rad
    return (
        f"That is by the encoder and {turn:.4g} mm per turn of the motor, as axis.yaml says. With a ruler: "
        f"beltcomm move --drive {pasted(drive)} --by {1e3 * crept_m:.2f}mm --measured-travel WHAT_YOU_READ (nothing moves)"
    )
