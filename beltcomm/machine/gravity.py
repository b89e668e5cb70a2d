"""A tilted axis before it moves: the torque that should hold it, what holds it without torque, and how far that reaches.

All torques at the motor shaft, positive in positive direction of travel; the torque that holds is  + i_t m_c g sin(α)  with (2.22).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from beltcomm.axis import Axis
from beltcomm.effects.tilt import GRAVITY_M_S2
from beltcomm.errors import Refused, UsageError
from beltcomm.machine.machine import Machine

#: kg: a carriage with nothing on it, as a rule and between which bounds; so far a stated payload and tilt (deg) may be wrong.
CARRIAGE_KG, LIGHTEST_KG, HEAVIEST_CARRIAGE_KG = 1.0, 0.3, 3.0
PAYLOAD_ERROR, TILT_ERROR_DEG = 0.1, 5.0
#: A holding brake must bear the largest torque thought of this many times.
BRAKE_RESERVE = 1.5
#: deg: an axis as steep as this counts as vertical; without a brake it is not moved, whatever friction does.
UPRIGHT_DEG = 75.0
#: Share of friction up to which it alone holds a carriage that nobody holds.
FRICTION_HOLDS = 0.8
#: Share of the torque limit that may be used, and how often friction must fit into it beside gravity: once to move upwards, and again
#: for an excitation that is to move the carriage whatever friction does.
TORQUE_SHARE, FRICTIONS = 0.9, 2.0
#: Friction thought of before it is measured, as a share of the torque limit.
FRICTION_SHARE = 0.1
#: s and m: how long an axis without torque is looked at, and what counts as moving.
LOOK_S, STANDS_M = 0.3, 2e-5


@dataclass(frozen=True)
class Expected:
    """Holding torque by axis.yaml: the value and its bounds for wrong entries, N m, with sign.

    Attributes
    ----------
    mass_kg : float
        Moved.
    """

    torque_nm: float
    bounds_nm: tuple[float, float]
    mass_kg: float


def holding_torque_nm(axis: Axis, mass_kg: float, tilt_deg: float) -> float:
    """Torque that holds a carriage on a tilted axis: i_t m_c g sin(α), N m at the motor shaft (errata 11).

    Parameters
    ----------
    axis : Axis
        With its transmission.
    mass_kg : float, kg
        m_c with payload.
    tilt_deg : float, deg
        α.
    """
    return axis.transmission_m_rad * mass_kg * GRAVITY_M_S2 * math.sin(math.radians(tilt_deg))


def expected(axis: Axis) -> Expected:
    """Holding torque by the tilt and payload that are stated, with its bounds.

    Parameters
    ----------
    axis : Axis

    Returns
    -------
    Expected
        N m at the motor shaft, and the mass, kg.

    Raises
    ------
    UsageError
        Without a payload or a pulley.
    """
    axis.require("holding a tilted axis", "payload.mass_kg", "pulley.effective_radius_m")
    payload, tilt = float(axis.payload.mass_kg or 0.0), axis.mounting.tilt_deg
    sign, steep = math.copysign(1.0, tilt), abs(tilt)
    mass = payload + CARRIAGE_KG
    least = holding_torque_nm(axis, (1.0 - PAYLOAD_ERROR) * payload + LIGHTEST_KG, max(steep - TILT_ERROR_DEG, 0.0))
    most = holding_torque_nm(axis, (1.0 + PAYLOAD_ERROR) * payload + HEAVIEST_CARRIAGE_KG, min(steep + TILT_ERROR_DEG, 90.0))
    low, high = sorted((sign * least, sign * most))
    return Expected(holding_torque_nm(axis, mass, tilt), (low, high), mass)


def refuse_too_steep(axis: Axis, holding_nm: float, friction_nm: float, mass_kg: float, known: str) -> None:
    """Check that gravity and friction leave room within the torque limit.

    |τ_g| + 2 τ_C ≤ 0.9 τ_max.

    Parameters
    ----------
    axis : Axis
    holding_nm : float, N m, motor shaft
        τ_g.
    friction_nm : float, N m, motor shaft
        τ_C.
    mass_kg : float, kg
        Carriage with payload.
    known : str
        Where the numbers are from, in words.

    Raises
    ------
    Refused
        With the torque, the limit, and what would work.
    """
    limit = axis.torque_limit()
    needed, most = abs(holding_nm) + FRICTIONS * friction_nm, TORQUE_SHARE * limit.torque_nm
    if needed <= most:
        return
    left = (most - FRICTIONS * friction_nm) / holding_torque_nm(axis, mass_kg, 90.0)
    works = f"up to {math.degrees(math.asin(left)):.0f} deg" if left > 0.0 else "at no tilt"
    raise Refused(
        f"the axis is tilted too much for its load: {abs(holding_nm):.3g} N m hold the carriage ({known}) and with friction of "
        f"{friction_nm:.2g} N m it takes {needed:.3g} N m to move it surely, but {100 * TORQUE_SHARE:.0f} % of {limit.binds} are "
        f"{most:.3g} N m at the motor; with {mass_kg:.3g} kg {works} would work, or a lighter payload"
    )


def suitable(axis: Axis) -> None:
    """Refuse a tilted axis that axis.yaml alone rules out; nothing for a level one.

    Parameters
    ----------
    axis : Axis

    Raises
    ------
    UsageError
        Without a payload or a pulley.
    Refused
        For an axis too steep for its torque, an upright one without a brake, or a weak brake.
    """
    if not axis.mounting.tilted:
        return
    guess = expected(axis)
    friction = FRICTION_SHARE * axis.torque_limit_nm
    words = f"{guess.mass_kg:.3g} kg at {axis.mounting.tilt_deg:g} deg by axis.yaml, the carriage counted as {CARRIAGE_KG:g} kg"
    refuse_too_steep(axis, guess.torque_nm, friction, guess.mass_kg, words)
    brake, most = axis.motor.brake_torque_nm, max(map(abs, guess.bounds_nm))
    if brake is None and abs(axis.mounting.tilt_deg) >= UPRIGHT_DEG:
        raise Refused(
            f"the axis stands upright ({axis.mounting.tilt_deg:g} deg) and no brake is stated (motor.brake_torque_nm): whatever friction "
            "holds today, without torque the carriage may fall. Fit a holding brake that the drive closes, and state it in axis.yaml"
        )
    if brake is not None and brake < BRAKE_RESERVE * most:
        raise Refused(
            f"the brake of {brake:g} N m (motor.brake_torque_nm) is too weak: up to {most:.3g} N m are to be held, "
            f"{BRAKE_RESERVE:g} times that are asked for; check payload, tilt and brake in axis.yaml"
        )


def admit(machine: Machine) -> None:
    """Refuse a tilted axis unless it is held without torque and by a stop of the drive.   Nothing moves, unless gravity moves it.

    The stage is off whenever nothing is recorded: between the records a brake or friction holds the carriage, or it falls.

    Parameters
    ----------
    machine : Machine

    Raises
    ------
    Refused
        With what is missing.
    UsageError
        Without a payload or a pulley.
    """
    axis = machine.axis
    if not axis.mounting.tilted:
        return
    suitable(axis)
    if machine.drive.capabilities.kinds == {"profile"}:
        raise Refused(
            f"{machine.drive.capabilities.name} takes no torque beforehand, so that the carriage of a tilted axis would sag before each "
            "stroke until the drive's integrator holds it; connect the drive's CAN port"
        )
    before = machine.position_m
    machine.drive.clock.sleep_until(machine.drive.clock.now() + LOOK_S)
    fallen = machine.position_m - before
    brake = axis.motor.brake_torque_nm
    if abs(fallen) > STANDS_M:
        what = "although axis.yaml states a brake" if brake else "which has no brake by axis.yaml (motor.brake_torque_nm)"
        raise Refused(
            f"the carriage moves by itself, {1e3 * fallen:+.2f} mm in {LOOK_S:g} s, with the stage off, {what}: nothing holds it when a "
            "record ends. Secure it; fit a holding brake that the drive closes, or a counterweight; such an axis is not moved"
        )
    if brake and not machine.holds_in_loops:
        raise Refused(
            f"{machine.drive.capabilities.name} takes no constant torque for its own loops: a quick stop would begin without what "
            "holds the carriage and let it fall until its integrator has found it; use a drive with a torque offset, or level the axis. "
            "Records of another tool can be read with `beltcomm import`"
        )


def held_by(machine: Machine, holding_nm: float, friction_nm: float) -> str:
    """Part that holds the carriage without torque, in words.

    Parameters
    ----------
    machine : Machine
    holding_nm : float, N m, motor shaft
        Holding torque.
    friction_nm : float, N m, motor shaft
        Coulomb friction.

    Raises
    ------
    Refused
        When that is friction and it does not surely do so.
    """
    brake = machine.axis.motor.brake_torque_nm
    if brake:
        return f"the brake ({brake:g} N m)"
    if abs(holding_nm) <= FRICTION_HOLDS * friction_nm:
        return f"friction ({friction_nm:.3g} N m) alone"
    raise Refused(
        f"{abs(holding_nm):.3g} N m of gravity against {friction_nm:.3g} N m of friction: no brake is stated (motor.brake_torque_nm) and "
        f"friction does not surely hold the carriage (up to {FRICTION_HOLDS * friction_nm:.3g} N m would); it stands, its excitation is "
        "not begun. Fit a holding brake that the drive closes, or a counterweight"
    )


def less_steep(machine: Machine, limit_n: float, needed_n: float) -> str:
    """Advice where the carriage's weight leaves the belt too little, in words.

    Parameters
    ----------
    machine : Machine
    limit_n : float
        It may carry.
    needed_n : float
        To excite.
    """
    weight, tilt = machine.weight_n, machine.axis.mounting.tilt_deg
    share = (limit_n - needed_n) / weight * math.sin(math.radians(abs(tilt)))
    works = f"up to {math.degrees(math.asin(share)):.0f} deg would work" if 0.0 < share < 1.0 else "no tilt would work"
    return (
        f"lighten the carriage: at {abs(tilt):g} deg its weight takes {weight:.0f} of the {limit_n:.0f} N that the belt may carry, "
        f"the excitation needs {needed_n:.0f} N; with this load {works}"
    )


def not_on_tilted(axis: Axis, what: str) -> None:
    """Refuse what is not done on a tilted axis.

    Parameters
    ----------
    axis : Axis
        With its tilt.
    what : str
        Behind the colon of the sentence.

    Raises
    ------
    UsageError
        On a tilted axis.
    """
    if axis.mounting.tilted:
        raise UsageError(f"axis.yaml states a tilt of {axis.mounting.tilt_deg:g} deg: {what}")
