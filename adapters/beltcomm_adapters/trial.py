"""Needs of a record, tried with the stage off and put back: its PDOs, its limits.  Doctor and every command that moves ask it.

The functions that make the settings are those of a record itself, so that nothing can be found out after the first motion was agreed to.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from beltcomm.drive import Limits
from beltcomm.drive.finding import Finding, State
from beltcomm.drive.objects import name_of
from beltcomm.errors import BusError, DriveError, ObjectRefused
from beltcomm_adapters.exchange import FREE_MAPPING, arrangements, map_answers, map_pdo
from beltcomm_adapters.host_reaction import heed
from beltcomm_adapters.preparation import believes_ramp, lend_settings
from beltcomm_adapters.profiles import Profile
from beltcomm_adapters.scaling import Scaling
from beltcomm_adapters.sdo import Objects, abort_text
from beltcomm_adapters.setpoints import layout_of

AREA: Final = "records"
#: Kinds of motion without which there is no commissioning.
NEEDED: Final = ("torque", "position")
#: What of a record's settings is only tried: rad of the motor around where it stands, s⁻¹ of its lag; rad/s² of a stop.
AROUND_RAD, LAG_RAD, STOP_RAD_S2 = 20.0, 1.0, 100.0
#: Share of the drive's own limits that is tried: they are only ever tightened.
SHARE = 0.9
#: By object: what stops the axis, or limits it, when the drive does not take this.
INSTEAD: Final = {
    0x605A: "its quick stop ends as the drive is set to",
    0x6085: "its quick stop brakes as hard as it is set to in the drive, not as the plan says: set it with the maker's tool",
    0x6084: "it leaves torque mode by the ramp that it is set to",
    0x6072: "the host stops the axis when a row shows too much torque; the drive itself allows what it is set to",
    0x6080: "the host stops the axis when a row shows too much speed; the drive itself allows what it is set to",
    0x607D: "the host alone stops the axis at the end of its window",
    0x6065: "the host alone stops the axis when it lags behind its reference",
    0x6066: "the drive lets a following error last as long as it is set to, in which a dead host's axis brakes harder",
    0x6087: "a step of torque rises no faster than it is set to, which the identification sees as a lag",
    0x6007: "what the axis does when its host is gone is tried before any torque",
    0x1029: "what the node does when its host is gone is tried before any torque",
    0x60C2: "its interpolation runs at the period that it is set to",
}


def _refused_words(error: ObjectRefused) -> str:
    """A setting that the drive has and does not take, and what does its work then."""
    instead = INSTEAD.get(error.index, "it stays as it is")
    return f"the drive refuses {name_of(error.index, error.subindex)}, {abort_text(error.abort_code)}: {instead}"


def tried(
    objects: Objects, profile: Profile, scaling: Scaling, modes: frozenset[int], period_s: float, fastest_rad_s: float
) -> Iterator[Finding]:
    """The findings; everything is put back.

    Parameters
    ----------
    objects : Objects
    profile : Profile
    scaling : Scaling
    modes : frozenset[int]
        That the drive has.
    period_s : float, s
        Of SYNC.
    fastest_rad_s : float
        Of any record, from which it stops.

    Raises
    ------
    BusError, DriveError
        (a ramp steeper than written).
    """
    yield from _mapping(objects, profile, modes)
    yield from _settings(objects, profile, scaling, modes, period_s, fastest_rad_s)


def _mapping(objects: Objects, profile: Profile, modes: frozenset[int]) -> Iterator[Finding]:
    """Setpoints of each kind of motion, and the answers."""
    wrong: list[Finding] = []
    states: dict[str, State] = {kind: "wrong" if kind in NEEDED else "warning" for kind in profile.modes}
    mapped: list[str] = []
    for kind, mode in profile.modes.items():
        if mode not in modes:
            continue
        layout = layout_of(mode, profile.offsets)
        try:
            with objects.lend() as lending:
                for number, entries in enumerate(layout.received):
                    map_pdo(objects, lending, "receive", number, entries)
        except BusError:
            raise
        except DriveError as error:
            wrong.append(
                Finding(AREA, f"setpoints, {kind}", states[kind], f"for motions of kind {kind}: {error.fault_and_remedy[0]}", FREE_MAPPING)
            )
            continue
        mapped += [name_of(*entry[:2]) for entries in layout.received for entry in entries]
    try:
        with objects.lend() as lending:
            number, _ = map_answers(objects, lending, torque=profile.mapped_torque)
    except BusError:
        raise
    except DriveError as error:
        wrong.append(Finding(AREA, "answers", "wrong", error.fault_and_remedy[0], FREE_MAPPING))
    else:
        offered = arrangements(profile.mapped_torque)
        sent = [entry for entries in offered[number] for entry in entries]
        mapped += [name_of(*entry[:2]) for entry in sent]
        if lacking := [name_of(*e[:2]) for entries in offered[0] for e in entries if e not in sent]:
            how = " (its speed is then the change of its position)" if "606Ch" in lacking else ""
            text = f"the drive does not let {' and '.join(lacking)} be mapped; records do without{how}"
            wrong.append(Finding(AREA, "answers", "warning", text))
    yield from wrong
    if mapped:
        yield Finding(AREA, "mapping", "ok", f"a record's objects can be mapped: {', '.join(dict.fromkeys(mapped))} (tried, put back)")


def _settings(
    objects: Objects, profile: Profile, scaling: Scaling, modes: frozenset[int], period_s: float, fastest_rad_s: float
) -> Iterator[Finding]:
    """Limits and ramps, a little tighter than they are."""
    here = objects.read(0x6064, 0, "int32") * scaling.position_rad
    torque = SHARE * (objects.read_if_there(0x6072, 0, "uint16") or 1000) * scaling.torque_nm
    limits = Limits(here - AROUND_RAD, here + AROUND_RAD, AROUND_RAD, torque, STOP_RAD_S2, LAG_RAD)
    refused: dict[tuple[int, int], str] = {}
    altered: dict[str, int] = {}
    for kind, mode in profile.modes.items():
        if mode not in modes:
            continue
        try:
            with objects.lend() as lending:
                lend_settings(objects, lending, profile, scaling, mode, period_s, limits)
                if profile.error_behaviour:
                    heed(objects, lending, profile.error_behaviour)
        except ObjectRefused as error:
            text = f"for motions of kind {kind}: {_refused_words(error)}"
            remedy = "set it with the maker's tool, or choose the --profile of this drive"
            yield Finding(AREA, f"settings, {kind}", "wrong" if kind in NEEDED else "warning", text, remedy)
        refused |= {(error.index, error.subindex): _refused_words(error) for error in lending.refused}
        altered |= lending.altered
    with objects.lend() as lending:
        if 0x6085 not in altered.values():
            believes_ramp(objects, lending, scaling, fastest_rad_s)
        altered |= lending.altered
    for place, text in refused.items():
        yield Finding(AREA, f"limit {name_of(*place)}", "warning", text, values={"limit_object": place[0]})
    for text, index in altered.items():
        yield Finding(AREA, "limit", "warning", text, values={"limit_object": index})
    if not refused and not altered:
        yield Finding(AREA, "limits", "ok", "the drive takes the limits and ramps of a record (tried, put back)")
