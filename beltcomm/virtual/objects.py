"""Objects that both profiles have: CiA 301 communication and CiA 402 drive, one row each.

Ranges and defaults are docs/reference-drive.md's; where that page is silent, those of the comment beside the row.
"""

from __future__ import annotations

from typing import Literal

from beltcomm.virtual.dictionary import ObjectRow
from beltcomm.virtual.stage import Nameplate

PDO_COUNT = 4
PDO_INVALID = 1 << 31
PDO_NO_RTR = 1 << 30  # reads as 1 always: these drives answer no remote request for a PDO

_I32_MIN, _I32_MAX = -(1 << 31), (1 << 31) - 1

_QUICK_STOP = "quick stop: 0 off; 1, 2 ramp 6084h, 6085h, 3 at the limit, then off; 5, 6, 7 likewise, then hold"

# Mapping after power-on (index, subindex, bits), PDO 1 to 4: those of the CMMP-AS (drive-protocols.md, 1).
_RECEIVE_MAPS = ((0x60400010,), (0x60400010, 0x60600008), (0x60400010, 0x607A0020), (0x60400010, 0x60FF0020))
_TRANSMIT_MAPS = ((0x60410010,), (0x60410010, 0x60610008), (0x60410010, 0x60640020), (0x60410010, 0x606C0020))


def parameter(
    index: int,
    subindex: int,
    kind: Literal["u8", "i8", "u16", "i16", "u32", "i32", "f32"],
    default: float,
    meaning: str,
    low: float | None = None,
    high: float | None = None,
    pdo: Literal["", "r", "t", "rt"] = "rt",
    when: Literal["any", "still", "off"] = "any",
    unit: Literal["", "position", "velocity", "acceleration"] = "",
) -> ObjectRow:
    """A row that is written by the host and kept by 1010h.

    Parameters
    ----------
    index, subindex : int
    kind : str
        Data type.
    default : float
        Raw.
    meaning : str
        In words.
    low, high : float or None
        Raw; None leaves it to the data type.
    pdo : str
        Directions in which it may be mapped.
    when : str
        States of the drive in which it may be written.
    unit : str
        Quantity that it counts in; "" for none.
    """
    return ObjectRow(index, subindex, kind, "rw", default, meaning, low, high, pdo, when, stored=True, unit=unit)


def communication_rows(node_id: int, name: str, vendor: int, product: int) -> list[ObjectRow]:
    """CiA 301 objects of a node, without PDOs and without the heartbeat consumer.

    Parameters
    ----------
    node_id : int
        1 to 126.
    name : str
        Of the device.
    vendor, product : int
        Of 1018h.
    """
    rows = [
        ObjectRow(0x1000, 0, "u32", "ro", 0x00020192, "device type: servo drive, CiA 402"),
        ObjectRow(0x1001, 0, "u8", "ro", 0, "error register", pdo="t"),
        ObjectRow(0x1003, 0, "u8", "rw", 0, "number of errors; writing 0 clears the list"),
        ObjectRow(0x1005, 0, "u32", "rw", 0x80, "COB-ID SYNC", stored=True),
        ObjectRow(0x1008, 0, "str", "const", name, "device name"),
        ObjectRow(0x1009, 0, "str", "const", "virtual", "hardware version"),
        ObjectRow(0x100A, 0, "str", "const", "1.0", "software version"),
        ObjectRow(0x100C, 0, "u16", "rw", 0, "guard time, ms", stored=True),
        ObjectRow(0x100D, 0, "u8", "rw", 0, "life time factor", stored=True),
        ObjectRow(0x1010, 1, "u32", "rw", 1, "save all parameters: write 'save'"),
        ObjectRow(0x1011, 1, "u32", "rw", 1, "restore all defaults: write 'load'"),
        ObjectRow(0x1014, 0, "u32", "ro", 0x80 + node_id, "COB-ID EMCY"),
        ObjectRow(0x1017, 0, "u16", "rw", 0, "heartbeat producer time, ms", stored=True),
        ObjectRow(0x1018, 1, "u32", "ro", vendor, "vendor ID"),
        ObjectRow(0x1018, 2, "u32", "ro", product, "product code"),
        ObjectRow(0x1018, 3, "u32", "ro", 1, "revision"),
        ObjectRow(0x1018, 4, "u32", "ro", 1, "serial number"),
        ObjectRow(0x1200, 1, "u32", "ro", 0x600 + node_id, "COB-ID, client to server"),
        ObjectRow(0x1200, 2, "u32", "ro", 0x580 + node_id, "COB-ID, server to client"),
    ]
    return rows + [ObjectRow(0x1003, sub, "u32", "ro", 0, "error, youngest first") for sub in range(1, 5)]


def standard_rows() -> list[ObjectRow]:
    """Objects of CiA 301 and CiA 402 that not every drive has: SYNC, error behaviour, reactions."""
    return [
        parameter(0x1006, 0, "u32", 0, "communication cycle period, us", pdo=""),
        parameter(0x1007, 0, "u32", 0, "synchronous window length, us", pdo=""),
        ObjectRow(0x1016, 1, "u32", "rw", 0, "heartbeat consumer: node ID << 16 | time, ms", stored=True),
        parameter(0x1019, 0, "u8", 0, "SYNC counter overflow", high=240, pdo=""),
        parameter(0x1029, 1, "u8", 1, "NMT state after a loss: 0 pre-operational, 1 as it is, 2 stopped", high=2, pdo=""),
        parameter(0x6007, 0, "i16", 1, "loss of the master: 0 nothing, 1 fault, 2 off, 3 quick stop", 0, 3, pdo=""),
        parameter(0x605B, 0, "i16", 0, "shutdown: 0 off, 1 ramp first", 0, 1, pdo=""),
        parameter(0x605C, 0, "i16", 0, "disable operation: 0 off, 1 ramp first", 0, 1, pdo=""),
        parameter(0x605D, 0, "i16", 1, "halt: 1 along 6084h, 2 along 6085h", 1, 2, pdo=""),
        parameter(0x605E, 0, "i16", 2, "fault: 0 off, 1 along 6084h, 2 along 6085h, 3 at the current limit", 0, 3, pdo=""),
    ]


def pdo_rows(node_id: int, longest_map: int, event_timer: bool) -> list[ObjectRow]:
    """Communication and mapping of four receive and four transmit PDOs.

    Parameters
    ----------
    node_id : int
        1 to 126.
    longest_map : int
        Objects in one PDO.
    event_timer : bool
        Transmit PDOs have subindex 5.
    """
    rows = []
    for number in range(PDO_COUNT):
        for communication, mapping, identifier, maps in (
            (0x1400 + number, 0x1600 + number, 0x200, _RECEIVE_MAPS[number]),
            (0x1800 + number, 0x1A00 + number, 0x180, _TRANSMIT_MAPS[number]),
        ):
            cob_id = PDO_INVALID | PDO_NO_RTR | (identifier + 0x100 * number + node_id)
            rows += [
                parameter(communication, 1, "u32", cob_id, "COB-ID", pdo=""),
                parameter(communication, 2, "u8", 255, "transmission type", pdo=""),
                parameter(communication, 3, "u16", 0, "inhibit time, 100 us", pdo=""),
                parameter(mapping, 0, "u8", len(maps), "mapped objects", high=longest_map, pdo=""),
            ]
            if event_timer:
                rows.append(parameter(communication, 5, "u16", 0, "event timer, ms", pdo=""))
            padded = (*maps, *(0,) * (longest_map - len(maps)))
            rows += [parameter(mapping, i + 1, "u32", entry, "mapped object", pdo="") for i, entry in enumerate(padded)]
    return rows


def drive_rows(motor: Nameplate, supported_modes: int, quick_stop_codes: frozenset[int], homing_method: int = 37) -> list[ObjectRow]:
    """CiA 402 objects, except those whose unit or range is the profile's own.

    Parameters
    ----------
    motor : Nameplate
        Ratings.
    supported_modes : int
        Bits of 6502h.
    quick_stop_codes : frozenset of int
        Values that 605Ah takes.
    homing_method : int
        Of 6098h.
    """
    peak = motor.peak_permille
    return [
        ObjectRow(0x603F, 0, "u16", "ro", 0, "error code", pdo="t"),
        ObjectRow(0x6040, 0, "u16", "rw", 0, "controlword", pdo="r"),
        ObjectRow(0x6041, 0, "u16", "ro", 0, "statusword", pdo="t"),
        parameter(0x605A, 0, "i16", 2, _QUICK_STOP, min(quick_stop_codes), max(quick_stop_codes), pdo=""),
        ObjectRow(0x6060, 0, "i8", "rw", 1, "mode of operation", pdo="r", stored=True),
        ObjectRow(0x6061, 0, "i8", "ro", 1, "mode of operation display", pdo="t"),
        ObjectRow(0x6062, 0, "i32", "ro", 0, "position demand", pdo="t"),
        ObjectRow(0x6064, 0, "i32", "ro", 0, "position actual value", pdo="t"),
        # One revision in 100 ms: supervision is on unless it is set otherwise.
        parameter(0x6065, 0, "u32", 65536, "following error window; FFFFFFFFh is off", unit="position"),
        parameter(0x6066, 0, "u16", 100, "following error time, ms"),
        parameter(0x6067, 0, "u32", 100, "position window", unit="position"),
        parameter(0x6068, 0, "u16", 10, "position window time, ms"),
        ObjectRow(0x606C, 0, "i32", "ro", 0, "velocity actual value", pdo="t"),
        ObjectRow(0x6071, 0, "i16", "rw", 0, "target torque, 0.1 % of rated", pdo="rt"),
        parameter(0x6073, 0, "u16", peak, "max current, 0.1 % of rated"),
        ObjectRow(0x6074, 0, "i16", "ro", 0, "torque demand, 0.1 % of rated", pdo="t"),
        ObjectRow(0x6077, 0, "i16", "ro", 0, "torque actual value, 0.1 % of rated: mean of the period just ended", pdo="t"),
        ObjectRow(0x6078, 0, "i16", "ro", 0, "current actual value, 0.1 % of rated", pdo="t"),
        ObjectRow(0x6079, 0, "u32", "ro", 325000, "DC link voltage, mV: a rectified 230 V mains", pdo="t"),
        ObjectRow(0x607A, 0, "i32", "rw", 0, "target position", pdo="rt", unit="position"),
        parameter(0x607C, 0, "i32", 0, "home offset: the zero lies this far from the home position", unit="position"),
        parameter(0x607D, 1, "i32", _I32_MIN, "software limit, lower; off while not below the upper", unit="position"),
        parameter(0x607D, 2, "i32", _I32_MAX, "software limit, upper", unit="position"),
        parameter(0x607E, 0, "u8", 0, "polarity: bit 7 position, bit 6 velocity", when="off"),
        parameter(0x6086, 0, "i16", 0, "motion profile: trapezoid", 0, 0),
        parameter(0x6087, 0, "u32", 0x0E310F94, "torque slope, 0.1 %/s", low=1),
        parameter(0x6088, 0, "i16", 0, "torque profile: linear", 0, 0),
        parameter(0x6098, 0, "i8", homing_method, "homing method"),
        ObjectRow(0x60C1, 1, "i32", "rw", 0, "interpolation position", pdo="rt", unit="position"),
        ObjectRow(0x60F4, 0, "i32", "ro", 0, "following error", pdo="t"),
        ObjectRow(0x60FD, 0, "u32", "ro", 0, "digital inputs: bit 0 lower, bit 1 upper end switch", pdo="t"),
        ObjectRow(0x60FF, 0, "i32", "rw", 0, "target velocity", pdo="rt", unit="velocity"),
        ObjectRow(0x6502, 0, "u32", "ro", supported_modes, "supported modes"),
    ]


def motion_rows(rev_per_s: float, rev_per_s2: float) -> list[ObjectRow]:
    """Objects of speeds and accelerations, in the profile's units.

    Defaults: 10 rev/s and 100 rev/s² (0.78 m/s and 7.8 m/s² on the thesis's rig), quick stop 200 rev/s², homing slow.

    Parameters
    ----------
    rev_per_s, rev_per_s2 : float
        Raw units per 1 rev/s and 1 rev/s².
    """
    return [
        parameter(0x6081, 0, "u32", round(10 * rev_per_s), "profile velocity", unit="velocity"),
        parameter(0x6083, 0, "u32", round(100 * rev_per_s2), "profile acceleration", low=1, unit="acceleration"),
        parameter(0x6084, 0, "u32", round(100 * rev_per_s2), "profile deceleration", low=1, unit="acceleration"),
        parameter(0x6085, 0, "u32", round(200 * rev_per_s2), "quick stop deceleration", low=1, unit="acceleration"),
        parameter(0x6099, 1, "u32", round(rev_per_s), "homing speed towards the switch", low=1, unit="velocity"),
        parameter(0x6099, 2, "u32", max(1, round(0.2 * rev_per_s)), "homing speed off the switch", low=1, unit="velocity"),
        parameter(0x609A, 0, "u32", round(20 * rev_per_s2), "homing acceleration", low=1, unit="acceleration"),
    ]
