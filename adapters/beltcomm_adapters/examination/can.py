"""A CAN drive step by step, from the interface to the answers to SYNC."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from itertools import chain
from typing import Any, Final

import can

from beltcomm.drive import Clock
from beltcomm.drive.finding import Finding
from beltcomm.errors import BusError, DriveError, UsageError
from beltcomm_adapters.buses import DEFAULT_BITRATE, Address, MonotonicClock, open_bus
from beltcomm_adapters.examination import condition, enabling, node, opening, place, timing, units, watching, wire
from beltcomm_adapters.examination.host import Host, group_of
from beltcomm_adapters.examination.line import not_opened
from beltcomm_adapters.examination.patient import Patient, examine
from beltcomm_adapters.examination.wire import WORDS
from beltcomm_adapters.identification import as_the_drive_is, read_identity
from beltcomm_adapters.link import HOST_NODE, Link
from beltcomm_adapters.profiles import choose_profile
from beltcomm_adapters.sdo import SdoObjects

#: Interfaces that turn a remote frame into something else: python-can's socketcand has none.
_NO_RTR: Final = frozenset({"socketcand"})
CHECKS: Final = tuple(
    chain(
        *(part.CHECKS for part in (node, condition, enabling, units, place, watching, opening, timing)),
    )
)


def examine_can(
    text: str,
    asked_node: int | None,
    bitrate: int | None,
    profile: str | None,
    options: Mapping[str, object],
    *,
    host: Host | None = None,
    opener: wire.Opener | None = None,
    clock: Clock | None = None,
) -> Iterator[Finding]:
    """Examine the drive at a CAN address.

    Parameters
    ----------
    text : str
        Address, as for ``--drive``.
    asked_node : int or None
        Its number; None for any.
    bitrate : int or None
        As asked for, None when it was not.
    profile : str or None
        Name or path; None chooses by identity.
    options : Mapping[str, object]
        ``try_bitrates``, ``sync_test``.
    host, opener, clock
        Stand in for this machine in tests.

    Raises
    ------
    UsageError
        For an address or a profile that cannot be.
    """
    address = Address.parse(text)
    host, clock = host or Host(), clock or MonotonicClock()
    opener = opener or partial(_open, address)
    rate = bitrate or DEFAULT_BITRATE
    if address.interface == "socketcan":
        interface = list(wire.socketcan(host, address.channel, bitrate))
        yield from interface
        if any(finding.unreachable for finding in interface):
            return
        rate = int(next((finding.values["bitrate"] for finding in interface if "bitrate" in finding.values), rate))
    try:
        bus = opener(rate, False)
    except (BusError, UsageError) as error:
        if address.interface == "slcan" and isinstance(error.__cause__, Exception):
            yield not_opened(wire.AREA, address.channel, error.__cause__, group_of(address.channel))
            return
        yield wire.unreachable("interface", *error.fault_and_remedy)
        return
    reached = True
    try:
        if address.interface != "socketcan":
            yield Finding(wire.AREA, "interface", "ok", f"{bus.channel_info} opens at {rate // 1000} kbit/s")
        for finding in examine_bus(bus, clock, asked_node, rate, profile, options, address.interface not in _NO_RTR):
            reached = reached and not finding.unreachable
            yield finding
    finally:
        bus.shutdown()
    if not reached and options.get("try_bitrates"):
        yield from wire.bit_rates(address, opener, clock)


def _open(address: Address, bitrate: int, listen_only: bool) -> can.BusABC:
    if not listen_only:
        return open_bus(address, bitrate)
    if address.interface != "slcan":
        raise UsageError(f"{address.interface} is not opened for listening only")
    return open_bus(address, bitrate, listen_only=True)


def examine_bus(
    bus: can.BusABC,
    clock: Clock,
    asked_node: int | None,
    bitrate: int | None,
    profile: str | None,
    options: Mapping[str, Any],
    rtr: bool = True,
) -> Iterator[Finding]:
    """Examine the drive on an open bus; never raises a BusError.

    Parameters
    ----------
    bus : BusABC
        Open.
    clock : Clock
    asked_node : int or None
        Its number; None for any.
    bitrate : int or None
        None when the bus carries any load.
    profile : str or None
        Name or path; None chooses by identity.
    options : mapping of str to Any
        As of :func:`examine_can`.
    rtr : bool
        True if nodes may be asked by remote frames.
    """
    rate = f" at {bitrate // 1000} kbit/s" if bitrate else ""
    try:
        heard = wire.listen(bus, clock, wire.LISTEN_S)
        yield from wire.heard_finding(heard)
        if heard.commanded:  # its transfers and ours would break each other
            return
        trouble = wire.first_word(bus, clock, asked_node or 1)
        nodes = [] if trouble in ("no_ack", "bus_off") else wire.answering(bus, clock)
        if trouble and not nodes:
            words, remedy = WORDS[trouble]
            yield wire.unreachable("errors", words, remedy)
            return
        if not nodes or (asked_node and asked_node not in nodes):
            yield wire.silence(bus, clock, heard, asked_node, rate, rtr)
            return
        if asked_node is None and len(nodes) > 1:
            yield wire.several(nodes, bus.channel_info)
            return
        number = asked_node or nodes[0]
        others = tuple(other for other in nodes if other not in (number, HOST_NODE))
        yield Finding(wire.AREA, "nodes", "ok", f"node {number} answers on {bus.channel_info}{rate}", "", {"node": number})
        link = Link(bus, clock, number)
        objects = SdoObjects(link)
        identity = read_identity(objects, f"{bus.channel_info}, node {number}")
        chosen = as_the_drive_is(objects, choose_profile(identity, profile))
        objects.locks.add(chosen.never_write)
    except BusError as error:
        yield wire.unreachable("interface", *error.fault_and_remedy)
        return
    except DriveError as error:  # it answers, but not as CANopen demands
        problem, remedy = error.fault_and_remedy
        yield Finding(node.AREA, "identity", "wrong", problem, remedy or "is node --node a CANopen drive, and nobody else on its number?")
        return
    patient = Patient(link, objects, identity, chosen, others, bitrate, rtr, bool(options.get("sync_test")), heard.nmt.get(number))
    patient.nameplate = options.get("nameplate")
    yield from examine(patient, CHECKS)
    if link.emergency is not None:
        text = f"the drive sent an emergency message meanwhile: error {link.emergency.code:04X}h"
        yield Finding(condition.AREA, "emergency", "warning", text, "the drive's state above tells whether it still holds")
