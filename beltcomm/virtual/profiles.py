"""The two drives that beltcomm knows best: rows of their own, scaling, and what they do differently.  Others are data: ``foreign``."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from beltcomm.control import Cascade, Feedforward, Prefilter, PrefilterKind
from beltcomm.plant import IDEAL, Instruments
from beltcomm.virtual.dictionary import ObjectDictionary, ObjectRow
from beltcomm.virtual.objects import communication_rows, drive_rows, motion_rows, parameter, pdo_rows, standard_rows
from beltcomm.virtual.pdo import EVERY_TYPE, PdoRules
from beltcomm.virtual.stage import Nameplate

_RPM_PER_RAD_S = 30.0 / math.pi
_NYQUIST_RAD_S = 3141.0  # just below π/T of the 1 ms loops
_ALL_PDO_RULES = PdoRules(EVERY_TYPE, dummies=True, remote=True)
_PREFILTERS: tuple[PrefilterKind, ...] = ("none", "notch", "butterworth")


@dataclass(frozen=True)
class UserUnits:
    """User units per SI unit at the motor shaft; negative where 607Eh turns the sign.

    Attributes
    ----------
    position : float
        Per rad.
    velocity : float
        Per rad/s.
    acceleration : float
        Per rad/s², always positive.
    ramp_to_rad_s : float
        Where it is not 0, accelerations are told as the time to this speed, ms.
    """

    position: float
    velocity: float
    acceleration: float
    ramp_to_rad_s: float = 0.0

    def acceleration_of(self, value: float) -> float:
        """An acceleration object's value in rad/s²: a time where the drive states ramps as times."""
        if self.ramp_to_rad_s:
            return 1e3 * self.ramp_to_rad_s / max(value, 1.0)
        return value / self.acceleration


@dataclass(frozen=True)
class VirtualProfile:
    """Differences between kinds of drives.

    Attributes
    ----------
    rows : callable
        Objects by (node ID, motor, encoder counts per revolution).
    scaling, cascade, output_limit : callable
        From the dictionary; output_limit gives bound and dead zone of the position controller, rad/s and rad.
    pdos : PdoRules
        What can be done with its PDOs.
    homing : frozenset[int]
        Methods of 6098h.
    quick_stops : frozenset[int]
        Values of 605Ah.
    following_error_faults : bool
        6065h leads to a fault; else only to bit 13, and 6510h:22h switches the stage off.
    i2t_faults : bool
        The motor's I²t leads to a fault; else the current falls to the rated one.
    period_at_reset : bool
        60C2h becomes active at the next reset; else at once.
    enable_inputs : int
        Their bits in 60FDh, stage and controller.
    peak_torque_units : float
        Torques are told so that the motor's peak torque is this many; 0: in 0.1 % of the rated one.
    cycle_s : float
        Of its loops; the bus ticks with it.
    after_loss : int
        As 1029h:1, of a drive without it.
    sdo_delay_ms : float
        Before an answer.
    enable_ms : float
        Until the stage is on.
    instruments : Instruments
        Of its torque path, where the plant file has none.
    aliases : tuple[tuple[tuple[int, int], tuple[int, int]], ...]
        A quantity's second number.
    tells_zero : bool
        In bit 15 of the statusword, which CiA 402 leaves to the maker.
    """

    name: str
    rows: Callable[[int, Nameplate, int], list[ObjectRow]]
    scaling: Callable[[ObjectDictionary, int], UserUnits]
    cascade: Callable[[ObjectDictionary, Nameplate], Cascade]
    output_limit: Callable[[ObjectDictionary, UserUnits], tuple[float, float]]
    gain_objects: tuple[int, ...]
    modes: frozenset[int]
    pdos: PdoRules = _ALL_PDO_RULES
    homing: frozenset[int] = frozenset({1, 2, 17, 18, 33, 34, 35, 37})
    quick_stops: frozenset[int] = frozenset({0, 1, 2, 3, 5, 6, 7})
    following_error_faults: bool = True
    i2t_faults: bool = True
    period_at_reset: bool = False
    vendor_bits: bool = False
    tells_zero: bool = True
    enable_inputs: int = 0
    peak_torque_units: float = 0.0
    cycle_s: float = 1e-3
    sdo_delay_ms: float = 0.0
    after_loss: int = 0
    enable_ms: float = 0.0
    instruments: Instruments = IDEAL
    aliases: tuple[tuple[tuple[int, int], tuple[int, int]], ...] = ()


def _mode_bits(modes: frozenset[int]) -> int:
    return sum(1 << (mode - 1) for mode in modes)


def signs(dictionary: ObjectDictionary) -> tuple[int, int]:
    """Signs of position and velocity by 607Eh.

    Parameters
    ----------
    dictionary : ObjectDictionary
        Of the drive.
    """
    polarity = dictionary.entry(0x607E).value
    return (-1 if polarity & 0x80 else 1), (-1 if polarity & 0x40 else 1)


_REFERENCE_MODES = frozenset({1, 3, 4, 6, 7, 8, 9, 10})


def generic_rows(
    node_id: int,
    motor: Nameplate,
    counts: int,
    name: str,
    vendor: int,
    product: int,
    modes: frozenset[int],
    quick_stops: frozenset[int],
    rev_per_s: float,
    rev_per_s2: float,
    longest_map: int = 8,
) -> list[ObjectRow]:
    """All that CiA 301 and CiA 402 say of a servo drive.

    Parameters
    ----------
    node_id : int
        1 to 126.
    motor : Nameplate
        Ratings.
    counts : int
        Encoder counts per turn.
    name : str
        Of the device.
    vendor, product : int
        Of 1018h.
    modes : frozenset of int
        Of operation.
    quick_stops : frozenset of int
        Values that 605Ah takes.
    rev_per_s, rev_per_s2 : float
        Its units in one.
    longest_map : int
        Objects in one PDO.
    """
    return [
        *communication_rows(node_id, name, vendor, product),
        *standard_rows(),
        *pdo_rows(node_id, longest_map, event_timer=True),
        *drive_rows(motor, _mode_bits(modes), quick_stops),
        *motion_rows(rev_per_s, rev_per_s2),
        ObjectRow(0x6075, 0, "u32", "ro", round(1000 * motor.rated_current_a), "rated current, mA", pdo="t"),
        ObjectRow(0x6076, 0, "u32", "ro", round(1000 * motor.rated_torque_nm), "rated torque, mN m", pdo="t"),
        parameter(0x6072, 0, "u16", motor.peak_permille, "max torque, 0.1 % of rated"),
        parameter(0x6080, 0, "u32", round(motor.max_speed_rpm), "max motor speed, 1/min"),
        ObjectRow(0x608F, 1, "u32", "ro", counts, "encoder increments"),
        ObjectRow(0x608F, 2, "u32", "ro", 1, "motor revolutions"),
        ObjectRow(0x6091, 1, "u32", "ro", 1, "motor shaft revolutions"),
        ObjectRow(0x6091, 2, "u32", "ro", 1, "driving shaft revolutions"),
        ObjectRow(0x6092, 1, "u32", "ro", counts, "feed, counts"),
        ObjectRow(0x6092, 2, "u32", "ro", 1, "driving shaft revolutions"),
        ObjectRow(0x60B0, 0, "i32", "rw", 0, "position offset", pdo="rt"),
        ObjectRow(0x60B1, 0, "i32", "rw", 0, "velocity offset", pdo="rt"),
        ObjectRow(0x60B2, 0, "i16", "rw", 0, "torque offset, 0.1 % of rated", pdo="rt"),
        parameter(0x60C2, 1, "u8", 1, "interpolation period", 1, 255, pdo=""),
        parameter(0x60C2, 2, "i8", -3, "power of ten of the period", -5, -2, pdo=""),
    ]


def _reference_rows(node_id: int, motor: Nameplate, counts: int) -> list[ObjectRow]:
    def gain(subindex: int, default: float, meaning: str, high: float, low: float = 0.0) -> ObjectRow:
        return parameter(0x2100, subindex, "f32", default, meaning, low, high, pdo="", when="still")

    return [
        *generic_rows(
            *(node_id, motor, counts, "beltcomm reference drive"),
            vendor=0,
            product=1,
            modes=_REFERENCE_MODES,
            quick_stops=frozenset({0, 7}),
            rev_per_s=counts,
            rev_per_s2=counts,
        ),
        gain(1, 0.002, "K_P, N m s/rad", high=100.0),
        gain(2, 0.02, "K_I, N m/rad", high=10000.0),
        gain(3, 1.0, "K_PP, 1/s", high=10000.0),
        gain(4, 0.002, "velocity filter T_R, s", high=1.0),
        parameter(0x2100, 5, "u8", 0, "prefilter: 0 none, 1 notch, 2 Butterworth", 0, 2, pdo="", when="still"),
        gain(6, 0.0, "prefilter centre or cutoff, rad/s", high=_NYQUIST_RAD_S),
        gain(7, 0.0, "notch width d_n", high=1000.0),
        parameter(0x2100, 8, "u8", 0, "reference velocity passes the velocity filter", 0, 1, pdo="", when="still"),
        gain(9, 0.0, "feedforward inertia, kg m²", high=10.0),
        gain(10, 0.0, "feedforward viscous, N m s/rad", high=10.0),
        gain(11, 0.0, "feedforward Coulomb, N m", high=100.0),
        gain(12, 0.0, "feedforward offset, N m", high=100.0, low=-100.0),
        gain(13, 0.0, "feedforward velocity K_v", high=2.0),
        gain(14, 0.0, "feedforward advance, s", high=0.02),
        gain(15, 0.0, "additional low-pass behind the prefilter, cutoff, rad/s; 0 is none", high=_NYQUIST_RAD_S),
        ObjectRow(0x2101, 1, "u32", "ro", 1000, "loop period, us"),
        ObjectRow(0x2101, 2, "u8", "ro", 1, "torque sampling: 1 = mean of the period just ended"),
    ]


def _reference_scaling(dictionary: ObjectDictionary, counts: int) -> UserUnits:
    position, velocity = signs(dictionary)
    per_rad = counts / math.tau
    return UserUnits(position * per_rad, velocity * per_rad, per_rad)


def _reference_cascade(dictionary: ObjectDictionary, _motor: Nameplate) -> Cascade:
    value = [dictionary.entry(0x2100, subindex).value for subindex in range(16)]
    kind, centre, width, low_pass = _PREFILTERS[value[5]], value[6], value[7], value[15]
    # The parts of a prefilter arrive one by one; until it is complete there is none.
    complete = centre > 0.0 and (kind != "notch" or width > 0.0)
    return Cascade(
        kp_nm_s_rad=value[1],
        ki_nm_rad=value[2],
        kpp_1_s=value[3],
        velocity_filter_s=value[4],
        prefilter=Prefilter(kind, centre, width, low_pass) if complete else Prefilter(roll_off_rad_s=low_pass),
        feedforward=Feedforward(*value[9:15]),
        filter_reference=bool(value[8]),
    )


def _no_output_limit(dictionary: ObjectDictionary, scaling: UserUnits) -> tuple[float, float]:
    return math.inf, 0.0


REFERENCE = VirtualProfile(
    name="reference",
    rows=_reference_rows,
    scaling=_reference_scaling,
    cascade=_reference_cascade,
    output_limit=_no_output_limit,
    gain_objects=(0x2100,),
    modes=_REFERENCE_MODES,
)

_CMMP_MODES = frozenset({1, 3, 4, 6, 7})


def _cmmp_rows(node_id: int, motor: Nameplate, counts: int) -> list[ObjectRow]:
    """Objects of drive-protocols.md, 1 and 2.

    Ranges and defaults are the sheet's, except: rated values, 6072h, 6073h are those of the motor, as set up by the
    maker's tool; 60F9h and 60FBh start at cautious values, since the sheet's (gain 1.0, 2 ms) shake a belt axis.
    """
    peak = motor.peak_permille
    rated_current_ma, rated_torque_mnm = round(1000 * motor.rated_current_a), round(1000 * motor.rated_torque_nm)
    never_write = [
        ObjectRow(0x60F6, 1, "u16", "ro", 768, "current controller gain"),
        ObjectRow(0x60F6, 2, "u16", "ro", 1020, "current controller time, us"),
        ObjectRow(0x6410, 3, "u16", "ro", 2000, "I²t time of the motor, ms"),
        ObjectRow(0x6410, 0x10, "i16", "ro", 0, "phase order"),
        ObjectRow(0x6410, 0x11, "i16", "ro", 0, "encoder offset angle"),
        ObjectRow(0x604D, 0, "u8", "ro", 8, "pole number"),
        *(ObjectRow(index, 0, "u32", "ro", 0, "encoder selection and data") for index in range(0x2021, 0x2027)),
    ]
    cycle_times = [ObjectRow(0x6510, sub, "u32", "ro", 1000, "cycle time of a loop, us") for sub in range(0xB0, 0xB4)]
    return [
        *communication_rows(node_id, "CMMP-AS", vendor=0x1D, product=0),
        ObjectRow(0x1016, 1, "u32", "ro", 0, "no heartbeat consumer"),
        *pdo_rows(node_id, longest_map=4, event_timer=False),
        *drive_rows(motor, _mode_bits(_CMMP_MODES), frozenset({2}), homing_method=35),
        *motion_rows(rev_per_s=60.0, rev_per_s2=60.0),
        *never_write,
        *cycle_times,
        ObjectRow(0x2000, 1, "u32", "ro", 0, "bit 0 referenced, 1 commutation valid, 2 ready for enable", pdo="t"),
        parameter(0x6072, 0, "u16", peak, "max torque, 0.1 % of rated", low=1000),
        parameter(0x6075, 0, "u32", rated_current_ma, "rated current, mA rms", low=1, high=rated_current_ma),
        parameter(0x6076, 0, "u32", rated_torque_mnm, "rated torque, mN m"),
        parameter(0x6080, 0, "u16", 32768, "max motor speed, 1/min", high=32768),
        parameter(0x6093, 1, "u32", 1, "position factor, numerator", low=1, when="off"),
        parameter(0x6093, 2, "u32", 1, "position factor, divisor", low=1, when="off"),
        parameter(0x6094, 1, "u32", 0x1000, "velocity factor, numerator", low=1, high=1 << 24, when="off"),
        parameter(0x6094, 2, "u32", 1, "velocity factor, divisor", low=1, when="off"),
        parameter(0x6097, 1, "u32", 0x100, "acceleration factor, numerator", low=1, when="off"),
        parameter(0x6097, 2, "u32", 1, "acceleration factor, divisor", low=1, when="off"),
        parameter(0x60C0, 0, "i16", -2, "interpolation: linear, no buffer", -2, -2),
        ObjectRow(0x60C1, 2, "u8", "rw", 0, "0: absolute", 0, 0, pdo="rt"),
        parameter(0x60C2, 1, "u8", 1, "interpolation period, ms, from the next reset on", 1, 10, pdo=""),
        parameter(0x60C2, 2, "i8", -3, "power of ten of the period", -3, -3, pdo=""),
        parameter(0x60F9, 1, "u16", 26, "velocity gain, 1/256", 20, 64 * 256, pdo="", when="still"),
        parameter(0x60F9, 2, "u16", 32000, "velocity integral time, us", 1, 32000, pdo="", when="still"),
        parameter(0x60F9, 4, "u16", 400, "velocity filter time, us", 1, 32000, pdo="", when="still"),
        ObjectRow(0x60FA, 0, "i32", "ro", 0, "output of the position controller", pdo="t"),
        parameter(0x60FB, 1, "u16", 26, "position gain, 1/256", 0, 64 * 256, pdo="", when="still"),
        parameter(0x60FB, 2, "u16", 0, "position integral time", 0, 0, pdo=""),
        parameter(0x60FB, 4, "u32", 500, "bound of the position controller's output", pdo="", when="still", unit="velocity"),
        parameter(0x60FB, 5, "u32", 2, "dead zone of the position controller", pdo="", when="still", unit="position"),
        ObjectRow(0x6510, 0x10, "u16", "rw", 0, "enable logic: 2 gives the bus control", 0, 2),
        parameter(0x6510, 0x22, "u32", 0, "following error that switches the stage off; 0 is never", pdo="", unit="position"),
        ObjectRow(0x6510, 0x40, "u32", "ro", rated_current_ma, "nominal current, mA"),
        ObjectRow(0x6510, 0x41, "u32", "ro", round(rated_current_ma * peak / 1000), "peak current, mA"),
    ]


def _cmmp_scaling(dictionary: ObjectDictionary, counts: int) -> UserUnits:
    """Internal units are 1/65536 rev, 1/4096 min⁻¹, 1/256 min⁻¹/s; user = internal × divisor/numerator (F1 p80)."""

    def factor(index: int) -> float:
        return float(dictionary.entry(index, 2).value / dictionary.entry(index, 1).value)

    position, velocity = signs(dictionary)
    return UserUnits(
        position * 65536.0 / math.tau * factor(0x6093),
        velocity * 4096.0 * _RPM_PER_RAD_S * factor(0x6094),
        256.0 * _RPM_PER_RAD_S * factor(0x6097),
    )


def _cmmp_cascade(dictionary: ObjectDictionary, _motor: Nameplate) -> Cascade:
    kp = 0.02 * dictionary.entry(0x60F9, 1).value / 256.0
    return Cascade(
        kp_nm_s_rad=kp,
        ki_nm_rad=kp / (1e-6 * dictionary.entry(0x60F9, 2).value),
        kpp_1_s=10.0 * dictionary.entry(0x60FB, 1).value / 256.0,
        velocity_filter_s=1e-6 * dictionary.entry(0x60F9, 4).value,
        feedforward=Feedforward(velocity=0.0),
        filter_reference=False,
    )


def _cmmp_output_limit(dictionary: ObjectDictionary, scaling: UserUnits) -> tuple[float, float]:
    bound = dictionary.entry(0x60FB, 4).value / abs(scaling.velocity)
    dead_zone = dictionary.entry(0x60FB, 5).value / abs(scaling.position)
    return bound, dead_zone


CMMP_AS = VirtualProfile(
    name="cmmp-as",
    rows=_cmmp_rows,
    scaling=_cmmp_scaling,
    cascade=_cmmp_cascade,
    output_limit=_cmmp_output_limit,
    gain_objects=(0x60F9, 0x60FB),
    modes=_CMMP_MODES,
    pdos=PdoRules(type_254_is_cyclic=True),
    homing=frozenset({1, 2, 17, 18, 33, 34, 35}),
    quick_stops=frozenset({2}),
    following_error_faults=False,
    i2t_faults=False,
    after_loss=1,  # whether a CMMP-AS leaves Operational then is not published
    period_at_reset=True,
    vendor_bits=True,
    enable_inputs=1 << 20 | 1 << 21,
)


def with_gain_units(profile: VirtualProfile, velocity: float, position: float, integral_time: float = 1.0) -> VirtualProfile:
    """Profile whose gains of 1.0 mean so many times what docs/reference-drive.md says of them.

    Parameters
    ----------
    profile : VirtualProfile
        Whose gains are taken.
    velocity, position : float
        Factors of the gains.
    integral_time : float
        Factor of the integral time.
    """

    def cascade(dictionary: ObjectDictionary, motor: Nameplate) -> Cascade:
        said = profile.cascade(dictionary, motor)
        ki = said.ki_nm_rad * velocity / integral_time
        return replace(said, kp_nm_s_rad=said.kp_nm_s_rad * velocity, ki_nm_rad=ki, kpp_1_s=said.kpp_1_s * position)

    return profile if velocity == position == integral_time == 1.0 else replace(profile, cascade=cascade)


PROFILES = {profile.name: profile for profile in (REFERENCE, CMMP_AS)}
