"""A profile of one's own, begun: what a drive answers and what its EDS says, as a commented YAML file that can be used as it is."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import can

from beltcomm.configfiles import to_yaml
from beltcomm.drive import Clock
from beltcomm.drive.objects import TYPES, DictionaryEntry, name_of
from beltcomm.errors import BusError, ObjectRefused, UsageError
from beltcomm_adapters.identification import read_identity
from beltcomm_adapters.link import Link, find_nodes
from beltcomm_adapters.profile_schema import MODES
from beltcomm_adapters.profiles import CONTROLLERS
from beltcomm_adapters.sdo import SdoObjects

#: Asked of a drive, with their type.
ASKED: Final[tuple[tuple[int, int, str], ...]] = (
    (0x100C, 0, "uint16"), (0x1010, 1, "uint32"), (0x1016, 1, "uint32"), (0x1029, 1, "uint8"), (0x6007, 0, "int16"), (0x6065, 0, "uint32"),
    (0x6071, 0, "int16"), (0x6072, 0, "uint16"), (0x6073, 0, "uint16"), (0x6074, 0, "int16"), (0x6075, 0, "uint32"),
    (0x6076, 0, "uint32"), (0x6077, 0, "int16"), (0x6080, 0, "uint32"), (0x6085, 0, "uint32"), (0x6087, 0, "uint32"),
    (0x608F, 1, "uint32"), (0x6091, 1, "uint32"), (0x6092, 1, "uint32"), (0x6093, 1, "uint32"), (0x6098, 0, "int8"),
    (0x60A8, 0, "uint32"), (0x60A9, 0, "uint32"), (0x60AA, 0, "uint32"), (0x60B1, 0, "int32"), (0x60B2, 0, "int16"),
    (0x60C2, 1, "uint8"), (0x6502, 0, "uint32"),
)  # fmt: skip
#: Names in an EDS that speak of a gain, and of those that are none of the loops', or the current controller's, which nobody writes.
_GAIN: Final = re.compile(r"gain|\bk[pivd]{1,2}\b|proportional|integral|reset time|\bt[ni]\b|stiffness|loop p\b", re.IGNORECASE)
_NO_GAIN: Final = re.compile(r"current|torque c|analog|encoder|gear|homing|brake|temperature|flux|field", re.IGNORECASE)
#: Candidates that are listed.
LISTED: Final = 24
_BITS: Final = {1: 0, 3: 2, 4: 3, 6: 5, 7: 6, 8: 7, 9: 8, 10: 9}  # 6502h


@dataclass(frozen=True)
class Facts:
    """Facts known of a drive.

    Attributes
    ----------
    values : Mapping[tuple[int, int], float or None]
        Of objects that are there, None where the value is not known.
    absent : frozenset[tuple[int, int]]
        Objects that are not.
    names : sequence of DictionaryEntry
        Of manufacturer objects, from an EDS.
    source : str
        Where all this is from.
    """

    identity: Mapping[str, str]
    values: Mapping[tuple[int, int], float | None]
    absent: frozenset[tuple[int, int]]
    names: Sequence[DictionaryEntry]
    source: str

    def there(self, index: int, subindex: int = 0) -> bool | None:
        """True if the drive has an object; None where nobody says."""
        place = index, subindex
        return True if place in self.values else False if place in self.absent else None

    def value(self, index: int, subindex: int = 0) -> int | None:
        """Its value as a whole number, None where it is not known."""
        found = self.values.get((index, subindex))
        return None if found is None else int(found)


def facts_of_bus(bus: can.BusABC, clock: Clock, node: int | None, entries: Sequence[DictionaryEntry]) -> Facts:
    """Facts that the drive on a bus answers; nothing is written.

    Parameters
    ----------
    bus : BusABC
        Open.
    clock : Clock
    node : int or None
        Its number; None for the only one.
    entries : sequence of DictionaryEntry
        Of its EDS, if there is one.

    Raises
    ------
    BusError, UsageError
    """
    if node is None:
        nodes = find_nodes(bus, clock)
        if len(nodes) != 1:
            raise UsageError(f"{len(nodes)} nodes answer on {bus.channel_info}; say which one is the drive with --node")
        node = nodes[0]
    objects = SdoObjects(Link(bus, clock, node))
    identity = read_identity(objects, f"{bus.channel_info}, node {node}")
    values: dict[tuple[int, int], float | None] = {}
    absent = set()
    for index, subindex, kind in ASKED:
        try:
            raw = objects.read_bytes(index, subindex)
            values[index, subindex] = int.from_bytes(raw, "little", signed=kind.startswith("int"))
        except BusError:
            raise
        except ObjectRefused:
            absent.add((index, subindex))
    return Facts(identity, values, frozenset(absent), _vendors(entries), "read from the drive" + (" and its EDS" if entries else ""))


def facts_of_file(device: Mapping[str, str], entries: Sequence[DictionaryEntry]) -> Facts:
    """Facts that an EDS or DCF says.

    Parameters
    ----------
    device : Mapping[str, str]
        Its [DeviceInfo].
    entries : sequence of DictionaryEntry
        Of the file.
    """
    values: dict[tuple[int, int], float | None] = {(e.index, e.subindex): e.value for e in entries}
    asked = {(index, subindex) for index, subindex, _ in ASKED}
    known = {str(key).lower(): str(value) for key, value in device.items()}
    identity = {"device_name": known.get("productname", ""), "maker": known.get("vendorname", "")}
    for key, name in (("vendor_id", "vendornumber"), ("product_code", "productnumber")):
        try:
            identity[key] = str(int(known.get(name, ""), 0))
        except ValueError:
            continue
    return Facts(identity, values, frozenset(asked - set(values)), _vendors(entries), "read in its EDS")


def _vendors(entries: Iterable[DictionaryEntry]) -> list[DictionaryEntry]:
    return [entry for entry in entries if any(entry.index in known for known in CONTROLLERS)]


def text_of(facts: Facts) -> str:
    """Text of a profile made of what was read.

    Parameters
    ----------
    facts : Facts
        Of drive and dictionary.
    """
    maker, product = facts.identity.get("maker", ""), facts.identity.get("device_name", "")
    title = f"{maker} {product}".strip() or "a CiA 402 drive"
    name = re.sub(r"[^a-z0-9]+", "-", (product or title).lower()).strip("-") or "my-drive"
    lines = [
        f"# Drive profile of {_plain(title)}, {facts.source}.  Use it with  --profile ./THIS_FILE ; `beltcomm doctor` tries it.",
        "# What is not stated here is as in the shipped profile named under `like`.  A line that begins with # is off: fill it in and "
        "take the #",
        "# away.  What was not read is said; the drive itself has the last word.",
        *to_yaml({"name": name, "title": title}).splitlines(),
        "like: cia402",
        "",
        *_modes(facts),
        *_abilities(facts),
        *_units(facts),
        *_host(facts),
        *_gains(facts),
    ]
    return "\n".join(lines) + "\n"


def _plain(text: str) -> str:
    return "".join(letter for letter in text if letter.isprintable())


def _modes(facts: Facts) -> list[str]:
    bits = facts.value(0x6502)
    if bits is None:
        why = "6502h is missing" if facts.there(0x6502) is False else "no value of 6502h is known"
        return [
            f"# Modes of operation: {why}, so the manual must say.",
            "# modes: {torque: [10, 4], position: [8, 7], velocity: [9, 3]}",
            "# supported_modes: [1, 3, 4, 6]",
            "",
        ]
    has = [mode for mode, bit in _BITS.items() if bits >> bit & 1]
    shown = {
        kind: best for kind, modes in MODES.items() if kind != "profile" and (best := [m for m in sorted(modes, reverse=True) if m in has])
    }
    lines = [f"# Modes of operation: 6502h = {bits:X}h."]
    lines.append(
        f"modes: {{{', '.join(f'{kind}: {best}' for kind, best in shown.items())}}}" if shown else "# modes: none that serves here"
    )
    if lacking := [kind for kind in ("torque", "position") if kind not in shown]:
        lines.append(f"#   no mode for {' and '.join(lacking)}: such a drive cannot be identified; another firmware may have it")
    return [*lines, f"supported_modes: {has}", ""]


def _abilities(facts: Facts) -> list[str]:
    both = facts.there(0x60B1) and facts.there(0x60B2)
    lines = []
    if facts.there(0x60B1) is not None:
        lines += [f"offsets: {str(bool(both)).lower()}            # 60B1h and 60B2h {'are there' if both else 'are not both there'}"]
        if not both:
            lines.append("structure: {velocity_feedforward: false, torque_feedforward: false}")
    lines += [
        "# Which filters its velocity loop has, for the design: none, notch, butterworth.",
        "# structure: {prefilters: [none, notch]}",
        "# What a following error beyond 6065h does: stops (a fault, 8611h) or reported (bit 13 of 6041h); unknown makes moves slower.",
        "# following_error: stops",
        "# When the reported torque acted: after (the period before its frame) or over (the one that follows).",
        "# torque_sampling: after",
        "# Where the acting torque stands, if not in 6077h or in other units; what is known of it is held against what the motion shows.",
        "# actual_torque: {index: 0x6077, subindex: 0, type: int16, nm: 1.0e-3, late_ms: 0, filter_ms: 1, command: false}",
    ]
    if facts.there(0x60C2, 1) is False:
        lines.append("# 60C2h is missing: the shortest SYNC period stands in the manual.")
    return [*lines, "# sync: {shortest_ms: 1, step_ms: 1, change: at_once}", ""]


def _units(facts: Facts) -> list[str]:
    lines = ["# Units.  Those that the drive tells (608Fh, 6091h, 6092h, 60A8h to 60AAh) are read from it."]
    if facts.there(0x6093, 1) and not facts.there(0x6092, 1):
        lines.append("# units: factor_group       # 6093h, 6094h, 6097h of the Metronix family")
    for index, key, example in ((0x60A9, "velocity_unit", "rpm"), (0x60AA, "acceleration_unit", "rpm/s")):
        if not facts.value(index):
            lines.append(f"# {key}: {example:<10}        # {name_of(index)} does not tell it: counts/s where nothing is said")
    rated = facts.value(0x6076)
    if rated:
        lines.append(
            f"# rated_torque_unit_nm: 1.0e-3  # 6076h = {rated}: {rated * 1e-3:g} N m if it counts in mN m; compare with the motor's plate"
        )
    missing = [
        name_of(index, sub)
        for index, sub, _ in ASKED
        if index in (0x6072, 0x6073, 0x6075, 0x6076, 0x6080, 0x608F) and facts.there(index, sub) is False
    ]
    if missing:
        lines.append(f"#   {', '.join(missing)} are missing: state motor.* in axis.yaml, which is then taken")
    lines += [
        "# What its torques (6071h, 6077h) are thousandths of: rated_torque, rated_current, drive_peak, unknown.",
        "# torque_scale: {of: rated_torque, check: compare the inertia found with the data sheet}",
    ]
    return [*lines, ""]


def _host(facts: Facts) -> list[str]:
    lines = ["# How it notices that its host is gone, and what it does then; both are tried before any torque."]
    if facts.there(0x1016, 1):
        lines.append("guarding: heartbeat         # 1016h is there")
    elif facts.there(0x100C):
        lines.append("guarding: node_guarding     # 100Ch is there, 1016h is not")
    else:
        lines.append(
            "# guarding: heartbeat       # neither 1016h nor 100Ch is known to be there: beltcomm moves no such drive under torque"
        )
    for index, sub, words in (
        (0x1029, 1, "0: the node leaves Operational; 1: it stays; 2: it stops"),
        (0x6007, 0, "0: nothing, 1: fault, 2: voltage off, 3: quick stop"),
    ):
        value = facts.value(index, sub)
        lines.append(
            f"#   {name_of(index, sub)} = {value} ({words})" if value is not None else f"#   {name_of(index, sub)} is not told ({words})"
        )
    lines.append("# error_behaviour: {node: 1, axis: 3}      # what is set there while beltcomm works, and put back")
    return [*lines, "", *_upkeep(facts), ""]


def _upkeep(facts: Facts) -> list[str]:
    """Homing, and how parameters are kept."""
    method = facts.value(0x6098)
    lines = ["# How --home finds the zero: the method that stands in 6098h, unless one is stated."]
    stands = "is not told" if method is None else f"is {method}" + (", which is none" if method == 0 else "")
    lines.append(f"# homing: {{method: 37}}                    # 6098h {stands}; 37: the place where it stands is the zero")
    keeps = {True: "is there", False: "is missing: state the maker's object", None: "is not known to be there"}[facts.there(0x1010, 1)]
    lines.append(f"# save: {{index: 0x1010, subindex: 1, type: uint32, value: 0x65766173, seconds: 15}}    # 1010h:1 {keeps}")
    return lines


def _gains(facts: Facts) -> list[str]:
    lines = [
        "# Gains.  As long as none stands under `parameters`, nothing of them is written: the job then ends with what to type into the "
        "maker's",
        "# tool.  To have them written, give object, type and SI value of one raw unit at the motor shaft (N m s/rad, N m/rad, 1/s, s):",
        "# gain_meaning: unconfirmed # small steps measure it before a gain is written; documented: your word is taken for it",
        "# parameters:",
        "#   kp_nm_s_rad: {index: 0x2000, subindex: 1, type: uint16, scale: 1.0e-4}",
        "#   ki_nm_rad: {index: 0x2000, subindex: 2, type: uint16, scale: 1.0e-3, law: integral_time}   # a time in units of scale seconds",
        "#   kpp_1_s: {index: 0x2000, subindex: 3, type: uint16, scale: 0.1}",
    ]
    found = [e for e in facts.names if e.kind in TYPES and _GAIN.search(e.name) and not _NO_GAIN.search(e.name) and e.access != "ro"]
    if not found:
        said = "its EDS names none" if facts.names else "give its EDS with --eds, whose names are searched for them"
        return [*lines, f"# Which objects hold gains is not known: {said}."]
    lines.append("known_gains:                # by their names in the EDS: strike out what is none")
    for entry in found[:LISTED]:
        row = {
            "place": name_of(entry.index, entry.subindex),
            "what": _plain(entry.name) or "?",
            "missing": "unit",
            "source": "EDS",
            "confidence": "read",
        }
        shown = to_yaml({"a": [row]}).partition("\n")[2]
        first, *others = shown.rstrip().splitlines()
        lines += [f"  {first.strip()}", *(f"    {line.strip()}" for line in others)]
    if len(found) > LISTED:
        lines.append(f"#   and {len(found) - LISTED} more")
    return lines
