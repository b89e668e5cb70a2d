"""The model a diagnosis begins with: seven parameters of a belt axis, or one rigid inertia with friction where there is no belt."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from beltcomm.axis import Axis
from beltcomm.errors import DataError, UsageError
from beltcomm.fit.loads import with_loads
from beltcomm.fit.start.first_estimate import INERTIA_SHARES, RIGID_EFFECTS, build_for, first_estimate, first_path
from beltcomm.fit.start.rigid import least_squares, rigid_estimate
from beltcomm.model import Model, build_model
from beltcomm.recording import Recording
from beltcomm.recording.checks import rigid_inertia
from beltcomm.simulate.stopping import usual_load_kg

#: J, m, c, d, d_m, d_c and the Coulomb friction of the motor: what every belt axis has.
BELT_BASE = ("belt_stiffness", "belt_damping", "viscous", "viscous_cart", "coulomb")
#: Without a belt: one inertia with friction.
RIGID_BASE = ("viscous", "coulomb")
#: Values where the axis file says nothing.
USUAL = {"belt_stiffness.stiffness": 2e5, "cart.mass": 4.0, "motor.inertia": 7e-5}
#: Share of the motor in the friction of both, before anything tells.
MOTOR_SHARE = 0.7
#: From where on the inertia of everything that moves, by its slow motion, corrects the first estimate; its relative error at most, and
#: torque of acceleration over friction at least; and from where on nothing is left of the first estimate.
ANCHOR_OFF, ANCHOR_ERROR, ANCHOR_DYNAMIC, ANCHOR_LOST = 1.2, 0.1, 0.5, 2.0
#: Factor between stated and found inertia within which no unit is another one; by which viscous friction may be above its usual bound where
#: none is stated (torque in another unit shows in the Coulomb friction); room of the frictions above those found, for the fit.
SAME_UNITS, MORE_VISCOUS, ROOM = 5.0, 100.0, 20.0


def start_model(axis: Axis, recordings: Sequence[Recording]) -> Model:
    """The base model with start values found from the records to be fitted, and with the loads that they name.

    Parameters
    ----------
    axis : Axis
    recordings : sequence of Recording

    Raises
    ------
    DataError
        When none can be used.
    """
    return with_loads(_base_start(axis, recordings), recordings)


def _base_start(axis: Axis, recordings: Sequence[Recording]) -> Model:
    usable = [r for r in recordings if not (r.is_static_map or r.sidecar.held_out)]
    if not usable:
        raise DataError("no recording is left to fit: all are held out or static maps")
    if not _is_belt_axis(axis, usable):
        return _rigid_start(axis, usable)
    excited = [r for r in usable if r.sidecar.experiment == "frf"] or usable
    counts = int(axis.get("motor.encoder_counts_per_rev") or 65536)
    sheet = data_sheet(axis, usable)
    assert sheet is not None
    if sheet.rigid:
        return rigid_estimate(sheet, usable)
    found = correct_by_slow_motion(belt_start(axis, excited, counts), sheet, usable)
    friction = found["coulomb.level"] + axis.transmission_m_rad * found["cart_friction.level"]
    return found.without_effect("cart_friction").with_values({"coulomb.level": friction}, "first estimate")


def data_sheet(axis: Axis, recordings: Sequence[Recording]) -> Model | None:
    """The data sheets in the middle of where records were made; None for an axis without a belt, whose inertia no data sheet knows.

    Parameters
    ----------
    axis : Axis
    recordings : sequence of Recording

    Returns
    -------
    Model or None
        Without friction.
    """
    usable = [r for r in recordings if not (r.is_static_map or r.sidecar.held_out)]
    if not _is_belt_axis(axis, usable):
        return None
    excited = [r for r in usable if r.sidecar.experiment == "frf"] or usable
    places = [place for r in excited if (place := r.sidecar.start_position_m) is not None]
    return _sheet_model(axis, float(np.median(places)) if places else 0.0)  # one stiffness is fitted to all places


def knows_stiffness(axis: Axis) -> bool:
    """True if the data sheets say how stiff it is between motor and load.

    Parameters
    ----------
    axis : Axis
        Of any kind.

    Returns
    -------
    bool
        False for a rigid axis.
    """
    if axis.transmission is not None:
        return not axis.rigid
    return axis.get("belt.specific_stiffness_n") is not None and axis.get("belt.pulley_distance_m") is not None


def _sheet_model(axis: Axis, place_m: float) -> Model:
    """The data sheets at a place of the carriage, with what the axis file leaves open as it usually is; no friction."""
    known_belt = knows_stiffness(axis)
    values = {
        "motor.inertia": axis.motor_side_inertia_kg_m2 if axis.get("motor.inertia_kg_m2") else USUAL["motor.inertia"],
        "cart.mass": usual_load_kg(axis, USUAL["cart.mass"]),
        "belt_stiffness.stiffness": axis.belt_stiffness_n_m(place_m) if known_belt else USUAL["belt_stiffness.stiffness"],
        "transmission.ratio": axis.transmission_m_rad,
        "coulomb.level": 0.0,
        "cart_friction.level": 0.0,
        "viscous_cart.damping": 0.0,
    }
    known = {"motor.inertia": bool(axis.get("motor.inertia_kg_m2")), "belt_stiffness.stiffness": known_belt}
    guessed = {name: values[name] for name, told in known.items() if not told}
    if axis.rigid:
        return build_for(axis, RIGID_EFFECTS, values)
    return build_for(axis, (*BELT_BASE, "cart_friction"), values).with_values(guessed, "usual value")


def belt_start(axis: Axis, excited: Sequence[Recording], counts_per_rev: int) -> Model:
    """A belt axis with friction at both ends, found from the loudest record.

    Parameters
    ----------
    axis : Axis
    excited : sequence of Recording
        One at least.
    counts_per_rev : int
    """
    record = max(excited, key=lambda r: float(np.std(r.torque)) * np.sqrt(len(r.t_s)))
    if axis.rigid:
        return rigid_estimate(_sheet_model(axis, 0.0), [record])
    sheet, ratio = _sheet_model(axis, record.sidecar.start_position_m or 0.0), axis.transmission_m_rad
    # Twice, because the share of the carriage in the friction is assumed and not found: first its level must be known.
    first = first_path(record, sheet, counts_per_rev)
    level = first.model["coulomb.level"]
    shared = {"coulomb.level": MOTOR_SHARE * level, "cart_friction.level": (1.0 - MOTOR_SHARE) * level / ratio}
    return first_estimate([record], sheet.with_values(shared, "data sheet"), counts_per_rev, first.path).model


def correct_by_slow_motion(found: Model, sheet: Model, recordings: Sequence[Recording]) -> Model:
    """The first estimate, put right where slow motion shows clearly another inertia of everything that moves.

    A filter of the reading weakens the fast torque that a first estimate lives on, and so inertia, mass and stiffness by one factor; slow
    torque passes.  An encoder too coarse for the antiresonance makes any of them: then inertia and stiffness are the data sheet's.

    Parameters
    ----------
    found, sheet : Model
        First estimate, and data sheets.
    recordings : sequence of Recording

    Returns
    -------
    Model
        ``found`` itself where slow motion shows nothing else.
    """
    told = [one for r in recordings if (one := rigid_inertia(r.t_s, r.torque, r.position)) is not None and one.inertia > 0.0]
    sure = [one for one in told if one.error < ANCHOR_ERROR * one.inertia and one.dynamic > ANCHOR_DYNAMIC]
    if not sure:
        return found
    slow, ratio = min(sure, key=lambda one: one.error / one.inertia).inertia, found["transmission.ratio"]
    factor = slow / (found["motor.inertia"] + found["cart.mass"] * ratio**2)
    if 1.0 / ANCHOR_OFF < factor < ANCHOR_OFF:
        return found
    if 1.0 / ANCHOR_LOST < factor < ANCHOR_LOST:
        low, high = (share * sheet["motor.inertia"] for share in INERTIA_SHARES)
        inertia, stiffness = min(max(factor * found["motor.inertia"], low), high), factor * found["belt_stiffness.stiffness"]
    else:
        inertia, stiffness = sheet["motor.inertia"], sheet["belt_stiffness.stiffness"]
    values = {"motor.inertia": inertia, "cart.mass": (slow - inertia) / ratio**2, "belt_stiffness.stiffness": stiffness}
    fits = all(found.parameters[name].low <= value <= found.parameters[name].high for name, value in values.items())
    return found.with_values(values, "first estimate") if fits else found


def _is_belt_axis(axis: Axis, recordings: Sequence[Recording]) -> bool:
    """True if the records are taken at a motor that drives a belt, by the data sheet's pulley."""
    return axis.get("pulley.effective_radius_m") is not None and all(r.side == "motor" for r in recordings)


def _rigid_start(axis: Axis, recordings: Sequence[Recording]) -> Model:
    """Inertia, viscous and Coulomb friction by least squares over all records of one side; N m and rad, or N and m, or A and rad.

    Raises DataError for records of different sides, and for numbers that no axis has.
    """
    if len({record.side for record in recordings}) > 1:
        raise DataError("the recordings of this run are taken on different sides (motor, load, ampere); put them into runs of their own")
    sheet = axis.get("motor.inertia_kg_m2") if recordings[0].side == "motor" else None
    inertia, viscous, coulomb = map(float, least_squares(recordings, sheet))
    values = {"motor.inertia": inertia, "viscous.damping": viscous, "coulomb.level": coulomb, "transmission.ratio": 1.0}
    side = recordings[0].side
    usual = build_model(axis.name, RIGID_BASE, {}, base_bodies=("motor",), side=side).parameters
    large = sheet is not None and sheet / SAME_UNITS < inertia < sheet * SAME_UNITS
    beyond = {"viscous.damping": 1.0 if sheet else MORE_VISCOUS, "coulomb.level": 1.0}  # of the usual bounds
    most = {n: math.inf if large else factor * usual[n].high for n, factor in beyond.items()}
    wide = {n: replace(usual[n], high=min(max(usual[n].high, ROOM * values[n]), high)) for n, high in most.items()}
    try:
        plain = Model(axis.name, RIGID_BASE, {**usual, **wide}, ("motor",), side=side)
        return plain.with_values(values, "data sheet")
    except UsageError as outside:
        state = "; where the units are right, state motor.inertia_kg_m2 of so large a machine in axis.yaml" if side == "motor" else ""
        raise DataError(
            f"by least squares {outside}: no axis is so. Torque (current, voltage), angle or time is in another unit than it says, as "
            f"N mm, mA or ms: correct the mapping and import the file again{state}"
        ) from outside
