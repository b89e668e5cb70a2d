"""The bus before any drive is asked: does the interface open, is somebody there, and at which bit rate.

Error frames of a CAN interface are put in words: what its controller saw go wrong on the wire.

Bits as in the Linux header ``linux/can/error.h``; other interfaces say only that there was an error.
"""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final, Literal

import can

from beltcomm.drive import Clock
from beltcomm.drive.finding import Finding, Values
from beltcomm.errors import BusError, UsageError
from beltcomm_adapters.buses import Address
from beltcomm_adapters.examination.host import Host, Interface
from beltcomm_adapters.examination.surroundings import bring_up, restart
from beltcomm_adapters.link import HOST_NODE, INTERFACE_ERRORS, find_nodes

Trouble = Literal["no_ack", "bus_off", "passive", "bit_errors", "other"]

_TX_TIMEOUT, _CONTROLLER, _PROTOCOL, _NO_ACK, _BUS_OFF, _BUS_ERROR = 0x001, 0x004, 0x008, 0x020, 0x040, 0x080
_PASSIVE_BITS: Final = 0x10 | 0x20  # of data byte 1: receiver, transmitter error passive

#: From the worst to the mildest; the first that was seen is what a person is told.
ORDER: Final[tuple[Trouble, ...]] = ("bus_off", "no_ack", "bit_errors", "passive", "other")

#: What was seen, and what to do about it.
WORDS: Final[dict[Trouble, tuple[str, str]]] = {
    "bus_off": (
        "the CAN controller went bus-off: it saw so many errors that it left the bus",
        "check bit rate, cable (CAN high and low swapped, short circuit) and both 120 ohm terminators, then take the interface down and up",
    ),
    "no_ack": (
        "what is sent is acknowledged by nobody (ACK error): no other node is on the bus, or its bit rate is another one",
        "switch the drive on, check the cable and the drive's bit rate; `--try-bitrates` looks for it",
    ),
    "bit_errors": (
        "frames on the bus are damaged (bit, stuff or form errors): wrong bit rate, missing terminator or a bad cable",
        "check the drive's bit rate (`--try-bitrates` looks for it), both terminators of 120 ohm and the cable",
    ),
    "passive": (
        "the CAN controller is error-passive: many frames were damaged lately",
        "check both terminators of 120 ohm, the cable and the bit rate",
    ),
    "other": ("the CAN interface reports errors on the bus", "check both terminators of 120 ohm, the cable and the bit rate"),
}


def _trouble_of(frame: can.Message) -> Trouble:
    """Trouble that an error frame tells."""
    bits = frame.arbitration_id
    if bits & _BUS_OFF:
        return "bus_off"
    if bits & (_NO_ACK | _TX_TIMEOUT):
        return "no_ack"
    if bits & _CONTROLLER and len(frame.data) > 1 and frame.data[1] & _PASSIVE_BITS:
        return "passive"
    return "bit_errors" if bits & (_PROTOCOL | _BUS_ERROR) else "other"


def _worst(frames: Iterable[can.Message]) -> Trouble | None:
    """The worst of what these error frames tell, None when there are none."""
    seen = {_trouble_of(frame) for frame in frames}
    return next((trouble for trouble in ORDER if trouble in seen), None)


AREA: Final = "bus"
#: s: long enough for heartbeats and cyclic frames of whoever is at work on the bus.
LISTEN_S: Final = 0.3
_TROUBLE_S: Final = 0.2
_BITRATES: Final = (1_000_000, 500_000, 250_000, 125_000, 800_000, 100_000, 50_000, 20_000)
_STATES: Final = {0x00: "booting", 0x04: "stopped", 0x05: "operational", 0x7F: "pre-operational"}
_READ_DEVICE_TYPE: Final = b"\x40\x00\x10\x00\x00\x00\x00\x00"

#: Opens the bus: (bit rate, listen only) -> bus.   Raises BusError, UsageError.
Opener = Callable[[int, bool], can.BusABC]


@dataclass
class Heard:
    """Traffic on the bus while nobody was asked.

    Attributes
    ----------
    frames : dict[int, int]
        Data frames by identifier.
    nmt : dict[int, int]
        State byte by node, from heartbeats.
    errors : list[can.Message]
        Error frames.
    """

    frames: dict[int, int] = field(default_factory=dict)
    nmt: dict[int, int] = field(default_factory=dict)
    errors: list[can.Message] = field(default_factory=list)

    @property
    def trouble(self) -> Trouble | None:
        """The worst that error frames told."""
        return _worst(self.errors)

    @property
    def commanded(self) -> bool:
        """True if somebody commands or asks nodes; a SYNC alone may come from a drive."""
        return self.master not in ("", "SYNC")

    @property
    def master(self) -> str:
        """In words, what only a master sends and this computer did not; "" when nothing."""
        sent = [word for identifier, word in ((0x000, "NMT commands"), (0x080, "SYNC")) if self.frames.get(identifier)]
        if any(0x601 <= identifier <= 0x67F for identifier in self.frames):
            sent.append("SDO requests")
        if any(0x200 <= identifier <= 0x57F and identifier & 0x80 == 0 for identifier in self.frames):
            sent.append("setpoints (PDOs)")
        return ", ".join(sent)


def listen(bus: can.BusABC, clock: Clock, seconds: float) -> Heard:
    """Frames and errors that come in for some time.

    Parameters
    ----------
    bus : BusABC
        Open.
    clock : Clock
    seconds : float, s
        How long.

    Raises
    ------
    BusError
        When the interface fails.
    """
    heard, end_s = Heard(), clock.now() + seconds
    while True:
        left_s = end_s - clock.now()
        try:
            message = bus.recv(max(left_s, 0.0))
        except INTERFACE_ERRORS as error:
            raise BusError(f"the CAN interface {bus.channel_info} does not receive ({error})") from error
        if message is None:
            if left_s <= 0.0:
                return heard
            clock.sleep_until(end_s)  # an interface may give up early
            continue
        if message.is_error_frame:
            heard.errors.append(message)
        elif not message.is_extended_id and not message.is_remote_frame:
            identifier = message.arbitration_id
            heard.frames[identifier] = heard.frames.get(identifier, 0) + 1
            if 0x700 < identifier < 0x780 and len(message.data) == 1:
                heard.nmt[identifier - 0x700] = message.data[0] & 0x7F


def state_name(state: int) -> str:
    """An NMT state in words.

    Parameters
    ----------
    state : int
        As a heartbeat has it.
    """
    return _STATES.get(state & 0x7F, f"unknown state {state:02X}h")


def unreachable(name: str, text: str, remedy: str) -> Finding:
    """A finding after which nothing more can be asked.

    Parameters
    ----------
    name : str
        Of the check.
    text, remedy : str
        Of the finding.
    """
    return Finding(AREA, name, "wrong", text, remedy, unreachable=True)


def socketcan(host: Host, name: str, asked_bitrate: int | None) -> Iterator[Finding]:
    """A SocketCAN interface as the kernel shows it, before it is opened.

    Parameters
    ----------
    host : Host
        This machine.
    name : str
        Of the interface.
    asked_bitrate : int or None, bit/s
        None where none is asked for.
    """
    interfaces = {one.name: one for one in host.interfaces()}
    one = interfaces.get(name)
    if one is None:
        if not host.has_can() and not interfaces:
            yield unreachable(
                "interface", f"there is no CAN interface {name}, and the kernel of this machine opens no CAN sockets",
                "on Linux: `sudo modprobe can can_raw`; containers mostly have none; a serial CAN adapter (slcan:) works without",
            )  # fmt: skip
            return
        others = f"there are {', '.join(interfaces)}" if interfaces else "there is none at all"
        yield unreachable(
            "interface", f"there is no CAN interface {name} on this machine; {others}",
            "plug the adapter in, or name another one; `beltcomm doctor` without --drive lists what is there",
        )  # fmt: skip
    elif not one.up:
        yield unreachable("interface", f"the CAN interface {name} is down", f"`{bring_up(one)}`, with the bit rate of the drive")
    elif one.state == "BUS-OFF":
        yield unreachable("interface", f"the CAN interface {name} is bus-off: it saw too many errors and left the bus", restart(name))
    else:
        yield _up(one, asked_bitrate)


def _up(one: Interface, asked_bitrate: int | None) -> Finding:
    values: Values = {"controller": one.state}
    rate = ""
    if one.bitrate:
        values["bitrate"] = one.bitrate
        rate = f" at {one.bitrate // 1000} kbit/s"
    if one.bitrate and asked_bitrate and one.bitrate != asked_bitrate:
        return Finding(
            AREA, "interface", "wrong", f"{one.name} runs{rate}, --bitrate says {asked_bitrate // 1000} kbit/s",
            f"leave --bitrate out, or `sudo ip link set {one.name} down`, then "
            f"`sudo ip link set {one.name} up type can bitrate {asked_bitrate} restart-ms 100`",
            values,
        )  # fmt: skip
    if one.state in ("ERROR-PASSIVE", "ERROR-WARNING"):
        return Finding(AREA, "interface", "warning", f"{one.name} is up{rate}, {one.state.lower()}", WORDS["passive"][1], values)
    return Finding(AREA, "interface", "ok", f"{one.name} is up{rate}" + (f", {one.state.lower()}" if one.state else ""), "", values)


def heard_finding(heard: Heard) -> Iterator[Finding]:
    """Finding from listening: error frames, and another master at work.

    Parameters
    ----------
    heard : Heard
        As :func:`listen` returned it.
    """
    if heard.trouble:
        text, remedy = WORDS[heard.trouble]
        yield Finding(AREA, "errors", "wrong", f"{text} ({len(heard.errors)} error frames in {LISTEN_S:g} s)", remedy)
    if heard.master:
        yield Finding(
            AREA, "other master", "wrong", f"somebody else works on this bus: {heard.master} were heard",
            "stop the controller or tool that works here, then look again: two masters must not move one axis, nor be asked at once",
        )  # fmt: skip
    elif not heard.trouble:
        count = sum(heard.frames.values())
        yield Finding(
            AREA, "traffic", "ok", f"no other master and no error frame in {LISTEN_S:g} s ({count} frame{'s' * (count != 1)} heard)"
        )


def first_word(bus: can.BusABC, clock: Clock, node: int) -> Trouble | None:
    """Send one frame (a read of 1000h) and see whether it got out.

    Parameters
    ----------
    bus : BusABC
        Open.
    clock : Clock
    node : int

    Returns
    -------
    Trouble or None
        None when it did.

    Raises
    ------
    BusError
        When the interface fails.
    """
    request = can.Message(arbitration_id=0x600 + node, data=_READ_DEVICE_TYPE, is_extended_id=False)
    try:
        bus.send(request)
    except INTERFACE_ERRORS as error:
        if _full(error):
            return "no_ack"
        raise BusError(f"the CAN interface {bus.channel_info} does not send ({error})") from error
    heard = listen(bus, clock, _TROUBLE_S)
    # Without berr-reporting a SocketCAN driver shows missing acknowledgement only as error-passive.
    return "no_ack" if heard.trouble == "passive" and not heard.frames else heard.trouble


def answering(bus: can.BusABC, clock: Clock) -> list[int]:
    """Numbers of the nodes that answer; none also when no frame leaves the send queue.

    Parameters
    ----------
    bus : BusABC
        Open.
    clock : Clock

    Raises
    ------
    BusError
        When the interface fails.
    """
    try:
        return find_nodes(bus, clock)
    except BusError as error:
        if _full(error.__cause__ or error):
            return []
        raise


def _full(error: BaseException) -> bool:
    """The send queue is full: frames before this one never got out."""
    number = getattr(error, "error_code", None) or getattr(error, "errno", None)
    return number == errno.ENOBUFS or "buffer full" in str(error).lower()


def silence(bus: can.BusABC, clock: Clock, heard: Heard, node: int | None, rate: str, rtr: bool) -> Finding:
    """Finding on why nobody answers: a node that is stopped, or nobody at this bit rate.

    Parameters
    ----------
    bus : BusABC
        Open.
    clock : Clock
    heard : Heard
        Before anybody was asked.
    node : int or None
        That was asked for; None for any.
    rate : str
        In words, for the sentence.
    rtr : bool
        True if nodes may be asked by remote frames.
    """
    seen = dict(heard.nmt)
    if rtr and not seen:
        seen = _guarded(bus, clock, [node] if node else list(range(1, HOST_NODE)))
    stopped = sorted(number for number, state in seen.items() if state & 0x7F == 0x04 and node in (None, number))
    if stopped:
        number = stopped[0]
        return unreachable(
            "nodes", f"node {number} is there, but in the NMT state stopped: it answers no question (SDO)",
            f"switch the drive off and on, or send it to pre-operational: on SocketCAN `cansend can0 000#80{number:02X}` (can-utils)",
        )  # fmt: skip
    where = f"node {node} does not answer" if node else "no node answers"
    return unreachable(
        "nodes", f"{where} on {bus.channel_info}{rate}",
        "check that the drive is on, that CANopen (CiA 402) is selected in it, its node number and bit rate (`--try-bitrates` looks for "
        "it), the cable and both terminators",
    )  # fmt: skip


def _guarded(bus: can.BusABC, clock: Clock, nodes: list[int]) -> dict[int, int]:
    """NMT states by node guarding, which a stopped node answers too.  Only where nobody answers questions: it arms life guarding."""
    try:
        for node in nodes:
            bus.send(can.Message(arbitration_id=0x700 + node, is_remote_frame=True, dlc=1, is_extended_id=False))
            if node % 4 == 0:
                clock.sleep_until(clock.now() + 0.005)
        return listen(bus, clock, _TROUBLE_S).nmt
    except (BusError, *INTERFACE_ERRORS):
        return {}


def several(nodes: list[int], channel: object) -> Finding:
    """Finding on more than one node, where nobody said which is the drive.

    Parameters
    ----------
    nodes : list of int
        Their numbers.
    channel : object
        Of the bus.
    """
    found = ", ".join(map(str, nodes))
    return Finding(
        AREA, "nodes", "wrong", f"{len(nodes)} nodes answer on {channel}: {found}", f"say which one is the drive: --node {nodes[0]}",
        {"nodes": found},
    )  # fmt: skip


def bit_rates(address: Address, opener: Opener, clock: Clock) -> Iterator[Finding]:
    """Look for the bus's bit rate: first listening only, then, where the bus is silent at every rate, by asking.

    A rate at which frames come in undamaged is right.  Asking on a silent bus disturbs nobody.

    Parameters
    ----------
    address : Address
        Interface and channel.
    opener : Opener
        Opens the bus at a bit rate.
    clock : Clock
    """
    if address.interface == "socketcan":
        rates = " ".join(str(rate) for rate in _BITRATES)
        yield Finding(
            AREA, "bit rate", "unknown", f"the bit rate of {address.channel} is set by the administrator, so it cannot be tried from here",
            f"for each of {rates}: `sudo ip link set {address.channel} down`, `sudo ip link set {address.channel} up type can bitrate RATE "
            f"restart-ms 100`, `beltcomm doctor --drive {address.channel}`",
        )  # fmt: skip
        return
    tried = []
    for asking in (False, True):
        for rate in _BITRATES:
            try:
                found = _answers(opener, clock, rate, asking)
            except (BusError, UsageError):
                continue  # not every interface has every rate, or a mode that only listens
            tried.append(rate)
            if found:
                how = "a node answers" if asking else "frames are heard"
                text = f"{how} at {rate // 1000} kbit/s"
                yield Finding(AREA, "bit rate", "warning", text, f"add --bitrate {rate}", {"found_bitrate": rate})
                return
    names = ", ".join(f"{rate // 1000}" for rate in dict.fromkeys(tried))
    yield Finding(
        AREA, "bit rate", "unknown", f"nothing was heard and nobody answers at {names or 'any'} kbit/s",
        "check that the drive is on, the cable and both terminators",
    )  # fmt: skip


def _answers(opener: Opener, clock: Clock, rate: int, asking: bool) -> bool:
    bus = opener(rate, not asking)
    try:
        if asking:
            return bool(find_nodes(bus, clock))
        heard = listen(bus, clock, 2.0 * LISTEN_S)
        return bool(heard.frames) and not heard.errors
    finally:
        bus.shutdown()
