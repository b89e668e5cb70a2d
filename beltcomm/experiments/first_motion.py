"""The first motion of a drive on this computer, and every later one that is larger: a person answers for it, whatever ``--yes`` says.

What was confirmed belongs to the drive, to what axis.yaml says of the machine behind it, and to what the plan asks for.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from beltcomm.axis import Axis
from beltcomm.configfiles import find_config, named_file
from beltcomm.errors import Declined, Refused, UsageError
from beltcomm.experiments.options import Options
from beltcomm.experiments.plan import Plan
from beltcomm.machine.hardware import Hardware
from beltcomm.machine.ratings import other_units_than
from beltcomm.quantities import unit_of
from beltcomm.talk import Talk

#: Entries of axis.yaml that say which machine it is: another value is another machine.
MACHINE = ("pulley.effective_radius_m", "gearbox.ratio", "mounting.tilt_deg", "motor.encoder_counts_per_rev", "motor.rated_torque_nm")
#: Entries that bound what it may do: a higher one, or one that is not stated any more, was not confirmed.  Of ``travel.min_m`` a lower one.
BOUNDS = (
    "travel.max_m",
    "limits.speed_m_s",
    "limits.acceleration_m_s2",
    "limits.feed_force_n",
    "limits.pulley_torque_nm",
    "motor.peak_torque_nm",
    "motor.max_speed_rad_s",
)
#: Before the name of an entry that bounds from below: its negative is kept.
LOWER = "-"
#: What a plan asks for at most, and in words.
ASKED = {"reach_m": "way with a stop", "speed_m_s": "speed", "torque_nm": "torque", "belt_force_n": "belt force"}
#: A plan is computed from a model, which a new fit moves a little: by less than this share it is the same plan.
SAME_PLAN = 0.05


@dataclass(frozen=True)
class ConfirmedBounds:
    """Upper bounds of motion: of one plan on one axis, or of all that were confirmed.

    Attributes
    ----------
    machine : dict of str to str
        What tells the machine.
    most : dict of str to float
        The upper bounds, by entry of axis.yaml or quantity of a plan; inf where there is none.
    """

    machine: Mapping[str, str]
    most: Mapping[str, float]

    @classmethod
    def of(cls, axis: Axis, plan: Plan, profile: str | None) -> ConfirmedBounds:
        """Of a plan; a profile that is not shipped is part of the machine."""
        machine = {entry: _word(axis.get(entry)) for entry in MACHINE} | {"profile": _profile(profile)}
        low = axis.travel.min_m
        most = {f"{LOWER}travel.min_m": math.inf if low is None else -low}
        most |= {entry: math.inf if axis.get(entry) is None else float(axis.get(entry)) for entry in BOUNDS}
        return cls(machine, most | {name: max(getattr(e, name) for e in plan.experiments) for name in ASKED})

    @classmethod
    def from_dict(cls, entry: Any) -> ConfirmedBounds:
        """As :meth:`to_dict` has it; nothing at all for what cannot be read."""
        try:
            return cls(dict(entry["machine"]), {str(name): float(value) for name, value in entry["most"].items()})
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
            return cls({}, {})

    def to_dict(self) -> dict[str, Any]:
        """For a file."""
        return {"machine": dict(self.machine), "most": dict(self.most)}

    def unconfirmed_entries(self, confirmed: ConfirmedBounds) -> list[str]:
        """Entries that were not confirmed on the drive before, in words."""
        found = []
        for name, here in self.machine.items():
            if (before := confirmed.machine.get(name)) != here:
                found.append(f"{name} {here or 'not stated'}, was {before or 'not stated'}")
        for name, most in self.most.items():
            before_most = confirmed.most.get(name, -math.inf)
            share = SAME_PLAN if name in ASKED else 1e-9
            if not most <= before_most + share * abs(before_most):
                now, then = (_confirmation_words(name, value) for value in (most, before_most))
                found.append(f"{ASKED.get(name, name.removeprefix(LOWER))} {now}, was {then}")
        return found

    def with_(self, confirmed: ConfirmedBounds) -> ConfirmedBounds:
        """This and what was confirmed on the same machine before; of another machine it counts for nothing."""
        if confirmed.machine != self.machine:
            return self
        return ConfirmedBounds(self.machine, {name: max(most, confirmed.most.get(name, most)) for name, most in self.most.items()})


def confirm_first_motion(
    hardware: Hardware, axis: Axis, plan: Plan, options: Options, talk: Talk, units: Mapping[str, float] | None
) -> None:
    """Ask a person, or take ``options.first_motion``, where this computer has not moved this drive on this axis as far as ``plan`` does.

    A virtual drive moves nothing.  A drive without a serial number is never known: another one of its kind may hang there today.

    Parameters
    ----------
    hardware : Hardware
        Drive, and what this computer knows of it.
    axis : Axis
    plan : Plan
        What is planned.
    options : Options
    talk : Talk
    units : Mapping of str to float
        Of its capabilities: with others than it was moved with it is asked for anew.

    Raises
    ------
    Refused
        For a no, for another drive than the one confirmed, and where there is nobody to ask.
    """
    if hardware.virtual:
        return
    if options.first_motion is not None and not hardware.named_by(options.first_motion):
        raise Refused(
            f"--first-motion-confirmed names {options.first_motion}, but this is {hardware.words}; nothing was moved. Look at the cabling, "
            f"or confirm this drive with --first-motion-confirmed {hardware.confirmation!r}"
        )
    known = hardware.remembered() if hardware.unique else {}
    before = bool(known.get("moved")) and known.get("axis") == axis.name
    extent, confirmed = (
        ConfirmedBounds.of(axis, plan, options.profile),
        ConfirmedBounds.from_dict(known.get("confirmed") if before else None),
    )
    beyond = extent.unconfirmed_entries(confirmed)
    rescaled = other_units_than(known.get("units") or {}, units or {}) if before else []
    if before and not beyond and not rescaled:
        if units and not known.get("units"):
            hardware.remember(units=dict(units))
        return
    what = f"{hardware.words} (on {hardware.name}) was never moved by beltcomm on this computer"
    if rescaled:
        what = f"{hardware.words} was moved on this axis before, but in other units: {'; '.join(rescaled)}"
    elif before:
        what = f"{hardware.words} was moved on this axis before, but what was confirmed then was less: {'; '.join(beyond)}"
    elif known.get("moved"):
        what = f"{hardware.words} was moved on the axis {known.get('axis') or 'without a name'} before, not on {axis.name or 'this one'}"
    elif not hardware.unique:
        what = f"{hardware.words} (on {hardware.name}) tells no serial number, so nobody knows whether beltcomm has moved it before"
    if options.first_motion is not None:
        talk.say(f"{what}; its first motion was confirmed by --first-motion-confirmed.")
    elif not talk.attended():
        raise Refused(
            f"{what}, and --yes does not answer for its first motion: somebody must stand beside it. Call this in a terminal and answer, "
            f"or add --first-motion-confirmed {hardware.confirmation!r} when a person has made sure of it; nothing was moved"
        )
    else:
        travel = f" of {axis.travel.min_m:g} to {axis.travel.max_m:g} m" if axis.travel.min_m is not None else ""
        talk.say(
            f"{what}. Before it moves {'further' if before else 'for the first time'}: the emergency stop is in your hand and was tried; "
            f"nobody and nothing is in the travel{travel}; the carriage stands where the plan says; "
            "end switches or stops are fitted. Which way is plus, and how far the carriage goes for one turn, no sensor tells: watch its "
            "first creep."
        )
        if not talk.confirm(f"Is all of this so, and may it move {'so far' if before else 'for the first time'}?"):
            raise Declined("nothing was moved, as you said")
    if hardware.unique:
        hardware.remember(axis=axis.name, moved=False, confirmed=extent.with_(confirmed).to_dict(), units=dict(units or {}))


def _word(value: Any) -> str:
    return "" if value is None else f"{value:.9g}"


def _confirmation_words(name: str, value: float) -> str:
    value = -value if name.startswith(LOWER) else value
    return f"{value:.4g} {unit_of(name)}".rstrip() if math.isfinite(value) else "not stated" if value > 0 else "not confirmed"


def _profile(name: str | None) -> str:
    """Name of a shipped profile, hash of another one's text; "" for the one that the drive's identity chooses."""
    if name is None or not named_file(name):
        return name or ""
    try:
        return hashlib.sha256(find_config("drives", name).read_bytes()).hexdigest()[:16]
    except (OSError, UsageError):
        return str(Path(name))
