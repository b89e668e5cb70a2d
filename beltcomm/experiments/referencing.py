"""Before the first motion: is the axis file enough, and where does the carriage stand?"""

from __future__ import annotations

import math

from beltcomm.axis import Axis
from beltcomm.axis.entries import LEVEL_DEG
from beltcomm.drive import Capabilities
from beltcomm.errors import Refused, UsageError
from beltcomm.experiments import phases
from beltcomm.machine import gravity
from beltcomm.machine.creep import small_move
from beltcomm.machine.machine import Machine
from beltcomm.model import Model
from beltcomm.rundata.findings import Settings
from beltcomm.schedule.sequences import excitation_travel_m

#: m: nearer than this the drive and the operator mean the same place.
SAME_POSITION_M = 5e-3
#: m/s²: an axis that gets no faster than this within its belt's limit carries too much.
SLOW_M_S2 = 1.0


def reference(machine: Machine, settings: Settings, *, needed: bool = True) -> tuple[float, float] | None:
    """Make the zero of the axis known: the drive knows it, or the operator's word, or later :func:`home`.

    Nothing moves.

    Parameters
    ----------
    machine : Machine
    settings : Settings
        Place, window and homing that were asked for.
    needed : bool
        False when a record at the present place will do, inside a window that the operator states or confirms.

    Returns
    -------
    tuple of float or None
        The window kept, if any.

    Raises
    ------
    Refused
        Without any.
    UsageError
        For a window that cannot be, or for a drive that contradicts axis.yaml.
    """
    machine.check_scaling()
    window = settings.window_m
    if settings.home:
        gravity.not_on_tilted(
            machine.axis, "the drive's own homing is no motion that anybody has held or predicted; give --position METRES"
        )
    gravity.admit(machine)
    if settings.position_m is not None:
        _believe(machine, settings, settings.position_m)
    elif settings.home:
        if not machine.drive.capabilities.can_home:
            raise Refused("this drive cannot home by itself; measure where the carriage stands and give --position")
    elif not machine.drive.capabilities.referenced:
        window = _stand_anywhere(machine, settings, needed)
    if window is not None:
        machine.keep_to(window)
    return window


def _believe(machine: Machine, settings: Settings, position_m: float) -> None:
    """The operator's word against that of a drive that knows its zero: only when asked it overrules the drive.   Raises Refused."""
    if machine.drive.capabilities.referenced and abs(machine.position_m - position_m) > SAME_POSITION_M:
        differ = f"the drive knows its zero and has the carriage at {machine.position_m:.4f} m, --position says {position_m:.4f} m"
        if not settings.ask or not machine.talk.confirm(f"{differ[0].upper()}{differ[1:]}. Is --position right?"):
            raise Refused(f"{differ}; leave --position out, or call without --yes and say that it is right")
    machine.reference_at(position_m)


def home(machine: Machine) -> None:
    """Let the drive find its zero, then creep off the end where it found it, so far that an excitation has room.

    Parameters
    ----------
    machine : Machine
    """
    begun = machine.drive.clock.now()
    machine.drive.home(machine.drive_limits(machine.envelope()))
    machine.origin_rad = 0.0
    low, high = machine.envelope().window_m
    room = excitation_travel_m(machine.drive.capabilities.sample_period_s) + 2.0 * phases.END_MARGIN_M
    at = machine.position_m
    inside = min(max(at, low + room), high - room)
    if abs(inside - at) > phases.ARRIVED_M:
        machine.talk.say(f"The drive found its zero; the carriage at {1e3 * at:.0f} mm creeps {1e3 * (inside - at):+.0f} mm further in.")
        small_move(machine.drive, machine.axis, inside - at, at)
    machine.machine_seconds += machine.drive.clock.now() - begun


def _stand_anywhere(machine: Machine, settings: Settings, needed: bool) -> tuple[float, float]:
    """The window around a place that nobody knows."""
    unknown = "the drive does not know where the carriage stands"
    how = "give --position METRES, or --home to let the drive find its zero"
    if needed:
        raise Refused(f"{unknown}; {how}; without either, --window LOW..HIGH (of `beltcomm identify` too) records at this place alone")
    half = excitation_travel_m(machine.drive.capabilities.sample_period_s) + phases.END_MARGIN_M
    window = settings.window_m
    if window is None:
        question = f"{unknown[0].upper()}{unknown[1:]}. Is it free to move by {1e3 * half:.0f} mm to either side from here?"
        if not settings.ask or not machine.talk.confirm(question):
            raise Refused(
                f"{unknown}; {how}, or say with --window LOW..HIGH how far it may move from here (-20mm..30mm, or 25mm either way)"
            )
        window = (-half, half)
    machine.stand_anywhere()
    return window


def slow_payload(axis: Axis, mass_kg: float, payload_kg: float | None) -> str | None:
    """In words, that the belt can hardly accelerate a further payload; None when it can.

    Parameters
    ----------
    axis : Axis
    mass_kg : float
        Of the carriage as it is.
    payload_kg : float or None, kg
        The further one; None for none.
    """
    allowed = axis.belt_force_limit_n / (mass_kg + (payload_kg or 0.0))
    if not payload_kg or allowed >= SLOW_M_S2:
        return None
    return (
        f"with {payload_kg:g} kg further the belt's {axis.belt_force_limit_n:.0f} N allow {allowed:.2g} m/s² only; check the payload, or "
        "whether the axis is meant for it"
    )


def refuse_window(capabilities: Capabilities, position_m: float | None, *, home: bool) -> None:
    """Refuse a window where the whole travel will be used.

    Parameters
    ----------
    capabilities : Capabilities
        Of the drive; one that is referenced knows its place.
    position_m : float or None, m
        Where the carriage stands, as the operator says.
    home : bool
        True if the drive searches its zero first.

    Raises
    ------
    UsageError
        Where the place is or will be known.
    """
    if position_m is not None or home or capabilities.referenced:
        raise UsageError(
            "--window keeps the carriage near where it stands, but the place is known and commissioning uses the whole travel; leave "
            "--window out, or use `beltcomm identify --window`"
        )


def suitable(axis: Axis) -> None:
    """Refuse an axis that the whole job cannot do.

    Parameters
    ----------
    axis : Axis

    Raises
    ------
    UsageError
        For entries that the job needs and the file does not have.
    Refused
        For an axis tilted too much for its load.
    """
    axis.require("commission", *axis.needs)
    gravity.suitable(axis)


def same_tilt(axis: Axis, model: Model) -> None:
    """Refuse an axis file that stands otherwise than the plant that it is to be simulated with.

    Parameters
    ----------
    axis : Axis
    model : Model
        The plant.

    Raises
    ------
    UsageError
        When the tilts differ by more than ``LEVEL_DEG``.
    """
    tilt_deg = math.degrees(model.get("tilt.angle"))
    if abs(tilt_deg - axis.mounting.tilt_deg) > LEVEL_DEG:
        raise UsageError(
            f"plant {model.name} is tilted by {tilt_deg:.3g} deg, {axis} by {axis.mounting.tilt_deg:g} deg; give the axis that belongs to "
            "it with --axis"
        )
