"""Controller value objects and their discrete form, shared by design, verification and the virtual drive.

All quantities at the motor shaft.  The loop is the thesis's cascade (figure 4.1): position gain, velocity PI behind a
prefilter, velocity from position by a first-order high-pass (6.1), feedforward (4.16), conditional integration (6.26).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True)
class Prefilter:
    """Filter of the velocity control error, in front of the PI controller.

    kind "none"; "notch" (4.1): centre ``omega_rad_s``, width ``d_n``; "butterworth" (4.3): cutoff ``omega_rad_s``.
    """

    kind: Literal["none", "notch", "butterworth"] = "none"
    omega_rad_s: float = 0.0
    d_n: float = 0.0


@dataclass(frozen=True)
class Feedforward:
    """Feedforward torque (4.16):  inertia dω_d/dt + viscous ω_d + coulomb sign(ω_d) + offset.

    inertia_kg_m2 : motor inertia and carriage mass together, kg m².  viscous_nm_s_rad.  coulomb_nm.  offset_nm : gravity.
    ``velocity`` K_v of (4.17): 1 passes the reference velocity to the velocity loop, 0 leaves all to the position gain.
    """

    inertia_kg_m2: float = 0.0
    viscous_nm_s_rad: float = 0.0
    coulomb_nm: float = 0.0
    offset_nm: float = 0.0
    velocity: float = 1.0


@dataclass(frozen=True)
class Cascade:
    """One set of controller gains.

    kp_nm_s_rad : K_P.   ki_nm_rad : K_I.   kpp_1_s : K_PP.   velocity_filter_s : T_R of (6.1).
    filter_reference : the reference velocity passes the same filter as the measured one.
    """

    kp_nm_s_rad: float
    ki_nm_rad: float
    kpp_1_s: float
    velocity_filter_s: float
    prefilter: Prefilter = field(default_factory=Prefilter)
    feedforward: Feedforward = field(default_factory=Feedforward)
    filter_reference: bool = True


@dataclass(frozen=True)
class CascadeStructure:
    """What a drive's built-in cascade can do, and how its gains are quantised: the design uses exactly this.

    period_s : s, sampling period of its loops.    prefilters : the kinds available.    steps : smallest step
    of each gain in SI by name (``kp_nm_s_rad`` ...), 0 when continuous for our purpose.  lowest, highest : SI bounds.
    """

    name: str
    period_s: float
    prefilters: tuple[str, ...] = ("none",)
    velocity_feedforward: bool = False
    torque_feedforward: bool = False
    reference_filter: bool = False
    anti_windup: bool = True
    steps: dict[str, float] = field(default_factory=dict)
    lowest: dict[str, float] = field(default_factory=dict)
    highest: dict[str, float] = field(default_factory=dict)
