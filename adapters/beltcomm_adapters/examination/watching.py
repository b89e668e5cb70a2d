"""Watches of the drive itself: whether its host lives, how far the axis lags behind; and what an earlier run left behind."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from beltcomm.drive import GUARD_S
from beltcomm.drive.finding import Finding
from beltcomm.drive.objects import name_of
from beltcomm_adapters import host_reaction
from beltcomm_adapters.examination.patient import Check, Patient
from beltcomm_adapters.link import HOST_NODE
from beltcomm_adapters.sdo import Objects

#: ms, of a host that is gone, as beltcomm sets it.
_GUARD_MS: Final = round(1e3 * GUARD_S)
AREA: Final = "watching"
_WINDOW_OFF: Final = 0xFFFFFFFF
_INVALID: Final = 1 << 31


def _host(patient: Patient) -> Iterator[Finding]:
    """Would the drive stop the axis when this computer dies?"""
    objects = patient.objects
    consumer = patient.profile.guarding == "heartbeat" and objects.read_if_there(0x1016, 1, "uint32") is not None
    guarding = objects.read_if_there(0x100C, 0, "uint16") is not None
    if consumer:
        yield Finding(AREA, "host", "ok", f"the drive can watch this computer's heartbeat (1016h): it stops when that ends{_then(objects)}")
    elif not guarding:
        yield Finding(
            AREA, "host", "wrong", "the drive watches neither heartbeat (1016h) nor node guarding (100Ch): it would outlive this computer",
            "beltcomm does not move such a drive",
        )  # fmt: skip
    elif not patient.rtr:
        yield Finding(
            AREA, "host", "wrong", "the drive watches its host by node guarding (100Ch), and this interface cannot send remote frames",
            "use a SocketCAN or slcan adapter",
        )  # fmt: skip
    elif patient.guarded is False:
        yield Finding(
            AREA, "host", "wrong", "the drive does not answer node guarding (700h + node): it would not notice that this computer dies",
            "use an adapter that sends remote frames (SocketCAN, slcan), and let no gateway block them; heartbeat 1017h must be 0",
        )  # fmt: skip
    elif patient.guarded is None:
        heartbeat_ms = objects.read_if_there(0x1017, 0, "uint16") or 0
        why = (
            f"it sends a heartbeat every {heartbeat_ms} ms (1017h)"
            if heartbeat_ms
            else "its life guarding is set (100Ch, 100Dh), and asking would arm it"
        )
        yield Finding(
            AREA, "host", "unknown", f"node guarding was not tried: {why}", "beltcomm sets both for each record and proves it then"
        )
    else:
        yield Finding(AREA, "host", "ok", f"the drive answers node guarding (100Ch): it can notice that this computer dies{_then(objects)}")


def _then(objects: Objects) -> str:
    """Reaction that is set, as a sentence's end."""
    said = host_reaction.words(objects)
    lent = ", which a record changes while it lasts" if host_reaction.needs_lending(objects) else ""
    return f"; {said}{lent}" if said else ""


def _following_error(patient: Patient) -> Iterator[Finding]:
    """6065h, and the place the profile names for a drive that only reports it: does a jammed axis stop by itself?"""
    window = patient.objects.read_if_there(0x6065, 0, "uint32")
    place = patient.signal("following_error_switch_off")
    if place is not None:
        limit = patient.objects.read_int(*place, "uint32")
        name = name_of(*place)
        if limit == 0:
            yield Finding(
                AREA, "following error", "warning", f"the drive never stops because of a following error ({name} is 0)",
                f"the host watches it; set {name} with the maker's tool for the time after commissioning", {"window_units": limit},
            )  # fmt: skip
        else:
            yield Finding(
                AREA,
                "following error",
                "ok",
                f"a following error above {limit} units stops the drive ({name})",
                "",
                {"window_units": limit},
            )
    elif window is None:
        yield Finding(AREA, "following error", "unknown", "the drive has no following error window (6065h)")
    elif window == _WINDOW_OFF:
        yield Finding(
            AREA, "following error", "warning", "the following error window is off (6065h = FFFFFFFFh): it never stops the drive",
            "beltcomm sets it for its own moves; set one with the maker's tool for the time after commissioning", {"window_units": window},
        )  # fmt: skip
    elif patient.profile.following_error == "stops":
        yield Finding(
            AREA, "following error", "ok", f"a following error above {window} units stops the drive (6065h)", "", {"window_units": window}
        )
    else:
        told = "only shows in bit 13 of 6041h" if patient.profile.following_error == "reported" else "stops this drive (8611h) is not known"
        yield Finding(
            AREA, "following error", "unknown",
            f"{'' if patient.profile.following_error == 'reported' else 'whether '}a following error above {window} units (6065h) {told}: "
            "should this computer die in a move, the guard time alone is counted with, and moves are slower for that",
            "look in its manual; where it says a fault, state following_error: stops in a profile (--profile)", {"window_units": window},
        )  # fmt: skip


def _leftovers(patient: Patient) -> Iterator[Finding]:
    """Settings that beltcomm makes for a record and takes back: found now, a run was cut off."""
    objects = patient.objects
    left = []
    if objects.read_if_there(0x1016, 1, "uint32") == HOST_NODE << 16 | _GUARD_MS:
        left.append("heartbeat watch 1016h")
    if objects.read_if_there(0x100C, 0, "uint16") == _GUARD_MS and objects.read_if_there(0x100D, 0, "uint8") == 1:
        left.append("node guarding 100Ch")
    first = objects.read_if_there(0x1A00, 1, "uint32")
    cob_id = objects.read_if_there(0x1800, 1, "uint32")
    if first == 0x60640020 and cob_id is not None and not cob_id & _INVALID and objects.read_if_there(0x1800, 2, "uint8") == 1:
        left.append("transmit PDO 1 of a record")
    if left:
        yield Finding(
            AREA, "leftovers", "warning", f"settings of a run that was cut off are still in the drive: {', '.join(left)}",
            "`beltcomm rollback --drive D --run RUN` writes its gains back; switching the drive off and on clears the rest",
        )  # fmt: skip
    else:
        yield Finding(AREA, "leftovers", "ok", "no settings of a run that was cut off")


CHECKS: Final = (Check(AREA, "host", _host), Check(AREA, "following error", _following_error), Check(AREA, "leftovers", _leftovers))
