"""Motor that the virtual drive is parametrised for."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Nameplate:
    """Nameplate of a servo motor.

    Attributes
    ----------
    rated_torque_nm, peak_torque_nm : float, N m
    rated_current_a : float
        A rms.
    max_speed_rpm : float
        1/min.
    """

    rated_torque_nm: float
    peak_torque_nm: float
    rated_current_a: float
    max_speed_rpm: float

    @property
    def torque_constant_nm_a(self) -> float:
        """Torque per current, N m/A."""
        return self.rated_torque_nm / self.rated_current_a

    @property
    def peak_permille(self) -> int:
        """Peak torque in 0.1 % of the rated torque; equally the peak current."""
        return round(1000.0 * self.peak_torque_nm / self.rated_torque_nm)


#: EMMS-AS-70-S-LS-RMB of the thesis's rig (table A.1).
EMMS_AS_70 = Nameplate(rated_torque_nm=1.43, peak_torque_nm=3.10, rated_current_a=2.2, max_speed_rpm=6300.0)
