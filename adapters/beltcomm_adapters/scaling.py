"""Raw numbers of a drive and SI at the motor shaft, decoded once: read from the drive, told by its profile, or by axis.yaml; never guessed.

What is not the drive's own word is said (:attr:`Scaling.said`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

from beltcomm.drive import KnownMotor
from beltcomm.errors import DriveError
from beltcomm_adapters.profiles import Profile
from beltcomm_adapters.sdo import Lending, Objects
from beltcomm_adapters.units import RPM, TURN, RawUnit, UnitSizes, coded, named

#: Internal units of the Metronix family, per revolution, per min⁻¹ and per min⁻¹/s (F1 p80-87).
_INTERNAL_POSITION, _INTERNAL_SPEED, _INTERNAL_ACCELERATION = 65536, 4096, 256
#: N m in one unit of 6076h, what CiA 402 says first, then what makers do.  Not 0.1 mN m: a motor entered with ten times its torque reads
#: alike, and would get ten times what is asked for.
_TORQUE_UNITS: Final[Mapping[float, str]] = {1e-3: "mN m", 1e-6: "µN m", 1.0: "N m", 1e-2: "cN m"}
#: A in one unit of 6075h, likewise.
_CURRENT_UNITS: Final[Mapping[float, str]] = {1e-3: "mA", 1e-2: "0.01 A", 0.1: "0.1 A", 1.0: "A"}
#: Share of a rating above which a whole unit is too coarse to tell it.
_COARSE: Final = 0.02
#: How near a rated torque must be to that of axis.yaml for its unit to be told by it.
_SAME_RATING: Final = 1.6
_LARGEST: Final = 2**32 - 1


@dataclass(frozen=True)
class Scaling:
    """SI value of one raw unit, motor shaft, and the drive's ratings.

    Attributes
    ----------
    position_rad, speed_rad_s, acceleration_rad_s2, torque_nm : float
        Per raw unit.
    reading_nm : float
        Per raw unit of the actual torque, where that is another one.
    counts_per_rev : int
        Encoder counts.
    rated_torque_nm : float
        N m (6076h).
    rated_current_a : float
        A rms (6075h).
    ramp : bool
        An acceleration is the time of a ramp, in s⁻¹ of its unit.
    said : tuple of str
        Sentences on what does not come from the drive.
    position_told, speed_told, acceleration_told : bool
        Whether drive or profile tell these units.
    stop_unit : str
        As of :class:`beltcomm.drive.Capabilities`.
    rated_unit_nm : float
        N m in one unit of 6076h; 0 where the drive does not tell its rated torque.
    """

    position_rad: float
    speed_rad_s: float
    acceleration_rad_s2: float
    torque_nm: float
    counts_per_rev: int
    rated_torque_nm: float
    rated_current_a: float
    ramp: bool = False
    said: tuple[str, ...] = ()
    speed_told: bool = True
    acceleration_told: bool = True
    position_told: bool = True
    reading_nm: float = 0.0
    stop_unit: str = ""
    rated_unit_nm: float = 0.0

    def __post_init__(self) -> None:
        if not self.reading_nm:
            object.__setattr__(self, "reading_nm", self.torque_nm)

    def told_units(self) -> dict[str, float]:
        """One raw unit of each quantity, where drive or profile tell it."""
        found = {"torque": self.torque_nm} | ({"rated_torque": self.rated_unit_nm} if self.rated_unit_nm else {})
        for name, unit, told in (
            ("position", self.position_rad, self.position_told),
            ("speed", self.speed_rad_s, self.speed_told),
            ("acceleration", self.acceleration_rad_s2, self.acceleration_told),
        ):
            if told:
                found[name] = unit
        return found

    def with_speed(self, speed_rad_s: float) -> Scaling:
        """Scaling with another unit of speed, and of acceleration where nobody tells that: the one of speed per second.

        Parameters
        ----------
        speed_rad_s : float, motor shaft
            Of one raw number.
        """
        share = 1.0 if self.acceleration_told else speed_rad_s / self.speed_rad_s
        return replace(self, speed_rad_s=speed_rad_s, acceleration_rad_s2=share * self.acceleration_rad_s2, speed_told=True)

    def acceleration(self, raw: float) -> float:
        """An acceleration of the drive, rad/s², motor shaft: of a time where it states ramps as times."""
        if self.ramp:
            return self.acceleration_rad_s2 / raw if raw else math.inf
        return raw * self.acceleration_rad_s2

    def raw_acceleration(self, value_rad_s2: float, *, at_most: bool = True) -> int:
        """An acceleration in the drive's unit, rather too little, without ``at_most`` rather too much."""
        exact = (
            (self.acceleration_rad_s2 / value_rad_s2 if value_rad_s2 > 0.0 else math.inf)
            if self.ramp
            else value_rad_s2 / self.acceleration_rad_s2
        )
        down = at_most is not self.ramp
        return (
            int(min(max(math.floor(exact + 1e-9) if down else math.ceil(exact - 1e-9), 1), _LARGEST)) if math.isfinite(exact) else _LARGEST
        )


def read_scaling(objects: Objects, profile: Profile, lending: Lending | None, nameplate: KnownMotor | None = None) -> Scaling:
    """Ask the drive for its units.

    Factor group: internal = user * numerator / divisor; the speed factor is set to 1/1, 1/4096 min⁻¹, for the session, because whole
    min⁻¹ are useless as feedback; without ``lending`` nothing is written. CiA 402: user units per motor revolution = feed constant /
    gear ratio.

    Parameters
    ----------
    objects : Objects
    profile : Profile
    lending : Lending or None
        Keeps what is put back; None writes nothing.
    nameplate : KnownMotor or None
        What axis.yaml knows of the motor, for what the drive does not tell.

    Raises
    ------
    DriveError
        When a divisor is zero, a unit is not known or nobody tells a rating.
    ObjectRefused
    BusError
    """
    plate, said = nameplate or KnownMotor(), list[str]()
    torque_nm, rated_unit_nm = _rated_torque_nm(objects, profile, plate, said)
    unit_nm = 1e-3 * (profile.torque_scale.nm or torque_nm)
    reading_nm = profile.actual_torque.nm or unit_nm
    current_a = _rated_current_a(objects, plate, torque_nm, said)
    if profile.units == "factor_group":
        position, speed, acceleration, internal = _factor_group(objects, lending)
        return Scaling(
            position, speed, acceleration, unit_nm, internal, torque_nm, current_a, said=tuple(said), reading_nm=reading_nm,
            rated_unit_nm=rated_unit_nm,
        )  # fmt: skip
    counts = _counts(objects, profile, plate, said)
    position, metres, position_told = _position(objects, profile, counts)
    sizes = UnitSizes(position, TURN / counts if counts else None, metres)
    speed_unit, speed_told = _told(objects, 0x60A9, profile.velocity_unit, 1, RawUnit(1.0, "unit", 1), said)
    speed = sizes.si(speed_unit, "speed (60A9h)")
    same = RawUnit(speed_unit.value, speed_unit.of, 2)  # what most makers mean who tell nothing: the unit of speed, per second
    acceleration_unit, acceleration_told = _told(objects, 0x60AA, profile.acceleration_unit, 2, same, said)
    if not acceleration_told and speed_told and speed_unit.of == "rad":
        said.append(
            "the drive does not tell its unit of acceleration (60AAh): its unit of speed per second is taken, until a slow stop shows it "
            "once a loop is closed"
        )
    acceleration = sizes.si(acceleration_unit, "acceleration (60AAh)")
    stop_unit = ""
    if not acceleration_told and profile.sources["units"]["confidence"] != "simulated":
        stop_unit = "nobody tells what accelerations count in (60AAh), and the unit of speed per second is taken"
    elif acceleration_told and profile.acceleration_unit is not None and not _tells_acceleration(objects):
        stop_unit = f"accelerations count in {profile.acceleration_unit} by acceleration_unit of the profile alone"
        said += _quick_stop(objects, profile.acceleration_unit, acceleration, acceleration_unit.ramp)
    whole = counts or round(TURN / abs(position))
    return Scaling(
        position, speed, acceleration, unit_nm, whole, torque_nm, current_a, acceleration_unit.ramp, tuple(said), speed_told,
        acceleration_told, position_told, reading_nm, stop_unit, rated_unit_nm,
    )  # fmt: skip


def _tells_acceleration(objects: Objects) -> bool:
    """True if the drive tells its unit of acceleration, as either version of CiA 402 has it."""
    code = objects.read_if_there(0x60AA, 0, "uint32")
    unit = coded(code) if code else _dimension(objects, 2)
    return unit is not None and unit.per == 2


def _quick_stop(objects: Objects, unit: str, rad_s2: float, ramp: bool) -> list[str]:
    """Quick stop of the drive in a unit of acceleration that only a profile states: nothing else shows that unit before a stop."""
    own = objects.read_if_there(0x6085, 0, "uint32")
    if not own:
        return []
    stands = rad_s2 / own if ramp else own * rad_s2
    return [
        f"accelerations count in {unit} by the profile alone: the quick stop that stands in the drive, 6085h = {own}, is then "
        f"{stands:.4g} rad/s² ({stands / RPM:.0f} rpm/s); compare that with the maker's tool: every stop is planned "
        "with it, and a slow one shows it only once a loop is closed that follows"
    ]


def _rated_torque_nm(objects: Objects, profile: Profile, plate: KnownMotor, said: list[str]) -> tuple[float, float]:
    """6076h, in the unit of the profile, or that which agrees with axis.yaml, N m, and that unit; 0 where the drive does not tell it."""
    raw, expected = objects.read_if_there(0x6076, 0, "uint32"), plate.rated_torque_nm
    if not raw:
        if expected is None:
            raise DriveError(
                f"the drive tells no rated torque (6076h {'is 0' if raw == 0 else 'is missing'}), in thousandths of which it counts "
                "torques; state motor.rated_torque_nm in axis.yaml and give --axis, or enter the motor's data with the maker's tool"
            )
        said.append(f"the drive tells no rated torque (6076h): {expected:.4g} N m from axis.yaml are taken")
        return expected, 0.0
    if profile.rated_torque_unit_nm is not None:
        return raw * profile.rated_torque_unit_nm, profile.rated_torque_unit_nm
    return _rating(0x6076, raw, expected, _TORQUE_UNITS, "N m", said)


def _rating(index: int, raw: int, expected: float | None, units: Mapping[float, str], of: str, said: list[str]) -> tuple[float, float]:
    """A rating in the first of the units, or that in which it agrees with axis.yaml, and that unit; axis.yaml's rating where the drive
    counts too coarsely."""
    usual = unit = next(iter(units))
    if expected is not None and not _alike(raw * unit, expected):
        unit = next((one for one in units if _alike(raw * one, expected)), usual)
        if unit != usual:
            said.append(
                f"{index:04X}h = {raw} is {raw * unit:.4g} {of} if it counts in {units[unit]}, which agrees with axis.yaml "
                f"({expected:.4g} {of}), and not in {units[usual]} as CiA 402 says; if it is meant in {units[usual]}, correct the motor's "
                "data with the maker's tool"
            )
            if unit > _COARSE * expected and abs(raw * unit - expected) < unit:
                said.append(f"{index:04X}h is too coarse in {units[unit]}: {expected:.4g} {of} from axis.yaml are taken")
                return expected, unit
    return raw * unit, unit


def _alike(one: float, other: float) -> bool:
    return 1.0 / _SAME_RATING < one / other < _SAME_RATING


def _rated_current_a(objects: Objects, plate: KnownMotor, torque_nm: float, said: list[str]) -> float:
    """6075h, A, as 6076h; where the drive does not tell it, by the torque constant, and without that so many ampere as newton metres."""
    raw = objects.read_if_there(0x6075, 0, "uint32")
    if raw:
        by_torque = (plate.rated_torque_nm or torque_nm) / plate.torque_constant_nm_a if plate.torque_constant_nm_a else None
        return _rating(0x6075, raw, by_torque, _CURRENT_UNITS, "A", said)[0]
    if plate.torque_constant_nm_a:
        found = torque_nm / plate.torque_constant_nm_a
        said.append(f"the drive tells no rated current (6075h): {found:.4g} A by the torque constant in axis.yaml are taken")
        return found
    return torque_nm


def _factor_group(objects: Objects, lending: Lending | None) -> tuple[float, float, float, int]:
    if lending is not None:
        for subindex in (1, 2):
            lending.set(0x6094, subindex, "uint32", 1, keep=True)
    position = _ratio(objects, 0x6093) * TURN / _INTERNAL_POSITION
    speed = _ratio(objects, 0x6094) * RPM / _INTERNAL_SPEED
    acceleration = _ratio(objects, 0x6097) * RPM / _INTERNAL_ACCELERATION
    return position, speed, acceleration, _INTERNAL_POSITION


def _counts(objects: Objects, profile: Profile, plate: KnownMotor, said: list[str]) -> int | None:
    """Increments of the encoder per revolution: 608Fh, unless it stands as from the factory; else axis.yaml's; None where nobody tells."""
    found = None if objects.read_if_there(0x608F, 1, "uint32") is None else _ratio(objects, 0x608F)
    if found is not None and found > 1.0:
        return round(found)
    if plate.counts_per_rev is None:
        return None
    why = "has no 608Fh" if found is None else "has 1 increment per revolution in 608Fh, as from the factory"
    said.append(f"the drive {why}: {plate.counts_per_rev} encoder counts per revolution from axis.yaml are taken")
    return plate.counts_per_rev


def _position(objects: Objects, profile: Profile, counts: int | None) -> tuple[float, float | None, bool]:
    """One position unit in rad of the motor; one rad of the motor in m of the load, where the units are of length; whether it is told."""
    gear = 1.0 if objects.read_if_there(0x6091, 1, "uint32") is None else _ratio(objects, 0x6091)
    code = objects.read_if_there(0x60A8, 0, "uint32")
    unit = coded(code) if code else None
    feed = None if objects.read_if_there(0x6092, 1, "uint32") is None else _ratio(objects, 0x6092)
    if feed == 1.0 and not (unit and unit.of == "rad"):  # as from the factory: no such unit is of any use
        feed = None
    if feed is not None:
        position = TURN * gear / feed
        return position, unit.value / position if unit and unit.of == "m" and unit.per == 0 else None, True
    if unit is not None and unit.of == "rad" and unit.per == 0:
        return unit.value * gear, None, True
    if profile.position_unit is not None:
        return UnitSizes(None, TURN / counts if counts else None).si(named(profile.position_unit, 0), "position"), None, True
    if counts is None:
        raise DriveError(
            "the drive tells neither its encoder (608Fh) nor its feed (6092h), or its factor group stands at 1/1 as from the factory, so "
            "that nobody knows what a position unit is; state motor.encoder_counts_per_rev in axis.yaml and give --axis, or set the factor "
            "group (608Fh, 6091h, 6092h) with the maker's tool"
        )
    encoder = objects.read_if_there(0x608F, 1, "uint32")
    return TURN * gear / counts, None, encoder is not None and encoder > 1


def _told(objects: Objects, index: int, by_profile: str | None, per: int, otherwise: RawUnit, said: list[str]) -> tuple[RawUnit, bool]:
    """The unit that the drive tells in an object, or its profile; else ``otherwise``, and whether somebody tells it."""
    code = objects.read_if_there(index, 0, "uint32")
    unit = coded(code) if code else _dimension(objects, per)
    if unit is not None and unit.per == per:
        return unit, True
    if by_profile is not None:
        return named(by_profile, per), True
    if code:
        what = "velocity" if per == 1 else "acceleration"
        raise DriveError(
            f"the drive's {what} unit {index:04X}h = {code:08X}h is not known; set it to rpm{'' if per == 1 else '/s'} or position units "
            f"with the maker's tool, or state {what}_unit in a drive profile (--profile)"
        )
    return otherwise, False


def _dimension(objects: Objects, per: int) -> RawUnit | None:
    """As drives of CiA 402 version 2 tell it: notation 608Bh or 608Dh, dimension 608Ch or 608Eh; None where they do not tell a unit."""
    notation, dimension = (0x608B, 0x608C) if per == 1 else (0x608D, 0x608E)
    what = objects.read_if_there(dimension, 0, "uint8")
    if not what:
        return None
    power = objects.read_if_there(notation, 0, "int8") or 0
    return coded((power & 0xFF) << 24 | what << 16 | (0x0300 if per == 2 else 0))


def _ratio(objects: Objects, index: int) -> float:
    numerator, divisor = (objects.read_int(index, subindex, "uint32") for subindex in (1, 2))
    if numerator == 0 or divisor == 0:
        raise DriveError(f"object {index:04X}h is {numerator}/{divisor}; set the drive's units with the maker's tool first")
    return numerator / divisor
