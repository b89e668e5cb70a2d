"""Single numbers that stand beside the columns of a file, offered as entries of axis.yaml: nobody else knows what they mean."""

from __future__ import annotations

import re
from collections.abc import Mapping

from beltcomm.axis import Axis

_ENTRIES = (
    ("motor.inertia_kg_m2", r"j|jm|j_?(m|mot|motor|rotor)|(motor|rotor)?_?inertia|traegheit(smoment)?"),
    ("motor.torque_constant_nm_a", r"kt|k_t|km|k_m|torque_?const(ant)?|kphi"),
    ("gearbox.ratio", r"gear(box)?(_?ratio)?|gr|ratio|i_?(gear|getriebe)|n_?gear|uebersetzung"),
    ("motor.encoder_counts_per_rev", r"cpr|ppr|counts?(_?per_?rev)?|enc(oder)?_?(counts|resolution|res)"),
    ("pulley.effective_radius_m", r"(pulley_?)?radius|r_?pulley"),
    ("motor.rated_torque_nm", r"(m|t|tau|torque)_?(n|nom|nenn|rated)|rated_?torque"),
)


def offered(scalars: Mapping[str, float], axis: Axis) -> list[str]:
    """A line for the numbers that look like entries of axis.yaml which are not known; [] when there are none."""
    found = []
    for entry, pattern in _ENTRIES:
        names = [name for name in scalars if re.fullmatch(pattern, name.rpartition(".")[2], re.I) and scalars[name] > 0.0]
        if len(names) == 1 and not _known(axis, entry):
            found.append(f"{names[0]} = {scalars[names[0]]:.6g} (--set {entry}={scalars[names[0]]:.6g} if that is it, in SI)")
    return [f"Beside the columns stand {'; '.join(found)}."] if found else []


def _known(axis: Axis, entry: str) -> bool:
    value = axis.get(entry)
    return value is not None and not (entry == "gearbox.ratio" and value == 1.0)
