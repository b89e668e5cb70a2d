"""Limits of records at a drive's sampling period, and whether its unit of torque is right: before and after the identification."""

from __future__ import annotations

import math

from beltcomm.axis import Axis
from beltcomm.drive import Capabilities
from beltcomm.errors import BeltcommError
from beltcomm.excitation.record import SELDOM_S
from beltcomm.fit.start.first_estimate import data_sheet_model
from beltcomm.model import Model
from beltcomm.rundata import analyse
from beltcomm.schedule.sequences import excitation_travel_m
from beltcomm.simulate.stopping import REACTION_PERIODS, unknown_loads_kg

#: Share of the sampling rate up to which a resonance can be seen: beyond it the hold between samples and the alias beside it take over.
CLAIMED_SHARE = 0.35
#: A motor-side inertia that differs from the data sheets by more than this factor is not theirs, or the unit of torque is not.
WRONG_SCALE = 1.25
#: Share of a stiffness within which it is known well.
WELL_KNOWN = 0.1
#: How the remarks begin.
_ELSE = "it comes from rows below it and from the data sheets, with wider intervals"
_RESONANCE, _INERTIA = "the resonance at", "the motor side shows"


def _claimed_hz(period_s: float) -> float:
    """Highest frequency that records with this sampling period can claim."""
    return CLAIMED_SHARE / period_s


def _expected_hz(axis: Axis) -> tuple[float, float] | None:
    """Lowest and highest resonance by the data sheets, over travel and payloads; None where they do not say enough."""
    if axis.rigid:
        return None
    stated = axis.payload.mass_kg
    masses = (stated,) if stated else (unknown_loads_kg(axis)[0], unknown_loads_kg(axis)[-1])
    found = []
    try:
        for at in axis.travel.ends_m:
            for mass in masses:
                model = data_sheet_model(axis, at, 0.0).with_values({"cart.mass": max(mass, unknown_loads_kg(axis)[0])})
                found.append(analyse.characteristic_hz(model, at)[1])
    except (BeltcommError, ValueError):
        return None
    return min(found), max(found)


def _hidden_resonance(axis: Axis, capabilities: Capabilities) -> str:
    """Sentence on a resonance that by the data sheets no response shows; "" for none."""
    top, expected = _claimed_hz(capabilities.sample_period_s), _expected_hz(axis)
    if expected is None or expected[1] <= top:
        return ""
    low, high = expected
    if low > top:
        return f"By the data sheets the resonance is at {low:.0f} Hz at least: no response shows it. {_remedy(capabilities)}"
    return (
        f"By the data sheets the resonance is between {low:.0f} and {high:.0f} Hz, by payload and place: no response shows a light "
        f"carriage's. {_remedy(capabilities)}"
    )


def doubts_before(axis: Axis, capabilities: Capabilities) -> tuple[str, ...]:
    """Doubts before anything is measured, sentences: a resonance that nothing shows, the unit of torque.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    """
    scale = f"{capabilities.torque_scale}." if capabilities.torque_scale else ""
    return tuple(doubt for doubt in (_hidden_resonance(axis, capabilities), scale) if doubt)


def notes_before(axis: Axis, capabilities: Capabilities) -> tuple[str, ...]:
    """Lines under a plan: the exchange, what its records can claim, and what is in doubt.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    """
    how = capabilities.exchange or f"A SYNC every {1e3 * capabilities.sample_period_s:g} ms"
    notes = [f"{how}: resonances up to {_claimed_hz(capabilities.sample_period_s):.0f} Hz can be measured."]
    if capabilities.sample_period_s > SELDOM_S:
        notes.append(
            f"So seldom, the carriage is shaken slowly, by up to {1e3 * excitation_travel_m(capabilities.sample_period_s):.0f} mm "
            f"either way, and a stop begins {1e3 * REACTION_PERIODS * capabilities.sample_period_s:.0f} ms after its reason."
        )
    return (*notes, *doubts_before(axis, capabilities))


def _remark_after(resonance_hz: float, capabilities: Capabilities, *, told: bool = False) -> str | None:
    """In words, that the resonance found is beyond what the records can claim; None when it is not.   ``told``: it is known well."""
    top = _claimed_hz(capabilities.sample_period_s)
    if not (math.isfinite(resonance_hz) and resonance_hz > top):
        return None
    if told:
        return (
            f"{_RESONANCE} {resonance_hz:.0f} Hz is above {top:.0f} Hz, the most that a response at this rate shows: it is told by how "
            "the axis goes from row to row under the torque asked for, and a lag in the drive's torque would pass for it"
        )
    return (
        f"{_RESONANCE} {resonance_hz:.0f} Hz is above {top:.0f} Hz, the most that this rate of sampling can measure: its frequency and "
        f"damping, and every margin near it, are guesses. {_remedy(capabilities)}"
    )


def _remedy(capabilities: Capabilities) -> str:
    if "% of the bus" in capabilities.exchange:
        return f"Sample faster with a higher bit rate, or on a drive with a shorter SYNC; else {_ELSE}"
    return f"Sample faster with --sample-period, or on a drive with a shorter SYNC; else {_ELSE}"


def _torque_remark(model: Model, axis: Axis, capabilities: Capabilities) -> str | None:
    """In words, whether the unit of torque is right: the inertia of the motor side, as identified, over that of the data sheets.

    J_found / J_sheet  is the factor by which the drive reports every torque too large.   None where nothing is in doubt or to be seen.
    """
    found = model.parameters.get("motor.inertia")
    if found is None or not found.interval:
        return None
    sheet = axis.motor_side_inertia_kg_m2
    factor, half = found.value / sheet, found.interval / sheet
    agrees = 1.0 / WRONG_SCALE < factor < WRONG_SCALE
    if agrees and not capabilities.torque_scale:
        return None
    said = f"{_INERTIA} {factor:.2f} ± {half:.2g} times the inertia of the data sheets"
    if agrees:
        return f"{said}: the drive's unit of torque is right to that"
    return (
        f"{said}: either these are wrong, or the drive counts torque in another unit and every torque, mass and friction found is "
        f"{factor:.2f} times too large; check motor.inertia_kg_m2 and the rated torque in the drive"
    )


def note_after(remarks: list[str], model: Model, axis: Axis, capabilities: Capabilities, at_m: float) -> None:
    """Put both remarks on a fitted model into ``remarks``, in place of those on an earlier one.

    Parameters
    ----------
    remarks : list of str
        Gets further ones.
    model : Model
    axis : Axis
    capabilities : Capabilities
    at_m : float
        Where the carriage is.
    """
    remarks[:] = [one for one in remarks if not one.startswith((_RESONANCE, _INERTIA))]
    stiffness = model.parameters.get("belt_stiffness.stiffness")
    told = stiffness is not None and stiffness.interval is not None and stiffness.interval < WELL_KNOWN * stiffness.value
    resonance = None if model.rigid else _remark_after(analyse.characteristic_hz(model, at_m)[1], capabilities, told=told)
    remarks += [one for one in (resonance, _torque_remark(model, axis, capabilities)) if one is not None]
