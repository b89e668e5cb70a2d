"""Named drive parameters and the controller values they stand for.

The names are what :meth:`beltcomm.drive.Drive.write`, ``backup`` and ``read`` speak; all values are SI at the motor shaft.
A drive offers the names its structure has; a name it does not offer has, inside that drive, the value of a plain cascade.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Final, Literal

from beltcomm.control import Cascade, Feedforward, Prefilter, PrefilterKind
from beltcomm.errors import UsageError

#: ``prefilter_kind`` as a number, by its position in this tuple.
PREFILTER_KINDS: Final[tuple[PrefilterKind, ...]] = ("none", "notch", "butterworth")

#: Every name of a controller gain, in the order of :class:`beltcomm.control.Cascade`.
GAIN_NAMES: Final = (
    "kp_nm_s_rad",
    "ki_nm_rad",
    "kpp_1_s",
    "velocity_filter_s",
    "prefilter_kind",
    "prefilter_omega_rad_s",
    "prefilter_d_n",
    "filter_reference",
    "ff_inertia_kg_m2",
    "ff_viscous_nm_s_rad",
    "ff_coulomb_nm",
    "ff_offset_nm",
    "ff_velocity",
    "ff_advance_s",
    "prefilter_roll_off_rad_s",
)

#: Without these there is no cascade that could be set; a drive without an object for the filter of the speed has none.
LOOP_GAINS: Final = GAIN_NAMES[:3]
#: What can be done with the gains of a drive: they are written, or once small steps have told what they mean, or only a person sets them.
GainAccess = Literal["writable", "to_calibrate", "unknown"]


@dataclass(frozen=True)
class GainTerm:
    """Gain that beltcomm does not write: how a person calls it in the maker's tool.

    Attributes
    ----------
    place : str
        Object, parameter number or name there.
    what : str
        It does, in words.
    missing : str
        What is not known of it; "" for nothing.
    parameter : str
        Which of :data:`GAIN_NAMES` it holds, or ``integral_time_s``; "" where that is not known.
    unit : str
        As the tool shows it.
    scale : float
        SI at the motor shaft of one such unit, 0 where not known.
    current : bool
        It counts in A rms of the motor in place of N m.
    """

    place: str
    what: str
    missing: str = ""
    parameter: str = ""
    unit: str = ""
    scale: float = 0.0
    current: bool = False


#: Limits inside the drive: largest torque, N m, and largest speed, rad/s, motor shaft.
LIMIT_NAMES: Final = ("torque_limit_nm", "speed_limit_rad_s")


def gain_access(names: Collection[str], uncalibrated: Collection[str]) -> GainAccess:
    """Access to the gains of a drive's loops.

    Parameters
    ----------
    names : collection of str
        Parameters that the drive offers.
    uncalibrated : collection of str
        Those of them whose meaning in SI nobody knows yet.

    Returns
    -------
    GainAccess
        "unknown" where a loop gain is missing.
    """
    if not set(LOOP_GAINS) <= set(names):
        return "unknown"
    return "to_calibrate" if uncalibrated else "writable"


def cascade_to_parameters(cascade: Cascade) -> dict[str, float]:
    """The named parameters of a controller.

    Parameters
    ----------
    cascade : Cascade
        At the motor shaft.

    Returns
    -------
    dict of str to float
        All of :data:`GAIN_NAMES`, SI at the motor shaft; ``prefilter_kind`` is the position in :data:`PREFILTER_KINDS`,
        ``filter_reference`` 1 or 0.
    """
    prefilter, feedforward = cascade.prefilter, cascade.feedforward
    return {
        "kp_nm_s_rad": cascade.kp_nm_s_rad,
        "ki_nm_rad": cascade.ki_nm_rad,
        "kpp_1_s": cascade.kpp_1_s,
        "velocity_filter_s": cascade.velocity_filter_s,
        "prefilter_kind": float(PREFILTER_KINDS.index(prefilter.kind)),
        "prefilter_omega_rad_s": prefilter.omega_rad_s,
        "prefilter_d_n": prefilter.d_n,
        "filter_reference": float(cascade.filter_reference),
        "ff_inertia_kg_m2": feedforward.inertia_kg_m2,
        "ff_viscous_nm_s_rad": feedforward.viscous_nm_s_rad,
        "ff_coulomb_nm": feedforward.coulomb_nm,
        "ff_offset_nm": feedforward.offset_nm,
        "ff_velocity": feedforward.velocity,
        "ff_advance_s": feedforward.advance_s,
        "prefilter_roll_off_rad_s": prefilter.roll_off_rad_s,
    }


def parameters_to_cascade(parameters: Mapping[str, float]) -> Cascade:
    """The controller that a drive with these parameters runs; the inverse of :func:`cascade_to_parameters`.

    Parameters
    ----------
    parameters : Mapping[str, float]
        The four gains at least; further names of :data:`GAIN_NAMES` that are missing are not in the drive, so no prefilter, no
        feedforward torque, no velocity feedforward, reference unfiltered. Other names (limits) are ignored.

    Raises
    ------
    UsageError
        For a missing gain or an unknown prefilter kind.
    """
    missing = [name for name in GAIN_NAMES[:4] if name not in parameters]
    if missing:
        raise UsageError(f"the controller gains {', '.join(missing)} are missing; a controller needs {', '.join(GAIN_NAMES[:4])}")

    def value(name: str) -> float:
        return float(parameters.get(name, 0.0))

    kind = value("prefilter_kind")
    if kind not in range(len(PREFILTER_KINDS)):
        raise UsageError(f"prefilter_kind {kind:g} is none of 0 (none), 1 (notch), 2 (butterworth)")
    return Cascade(
        kp_nm_s_rad=value("kp_nm_s_rad"),
        ki_nm_rad=value("ki_nm_rad"),
        kpp_1_s=value("kpp_1_s"),
        velocity_filter_s=value("velocity_filter_s"),
        prefilter=Prefilter(
            PREFILTER_KINDS[int(kind)], value("prefilter_omega_rad_s"), value("prefilter_d_n"), value("prefilter_roll_off_rad_s")
        ),
        feedforward=Feedforward(
            inertia_kg_m2=value("ff_inertia_kg_m2"),
            viscous_nm_s_rad=value("ff_viscous_nm_s_rad"),
            coulomb_nm=value("ff_coulomb_nm"),
            offset_nm=value("ff_offset_nm"),
            velocity=value("ff_velocity"),
            advance_s=value("ff_advance_s"),
        ),
        filter_reference=bool(value("filter_reference")),
    )
