"""What a diagnosis is checked against, besides its error: resonances, static maps, the bound of friction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from beltcomm.axis import Axis
from beltcomm.laboratory.cross_checks import MapCheck, Resonances, amplitudes_fitted, friction_bound, map_checks, resonances
from beltcomm.laboratory.diagnosis import Diagnosis
from beltcomm.laboratory.score import ground_of
from beltcomm.recording import Recording

#: Share of the squares below which no law of friction is worth looking for, and from which the bound is worth a line.
WORTH = 0.05
#: Orders of a map that are shown, at most.
SHOWN = 6


@dataclass(frozen=True)
class Checks:
    """resonances : None for one rigid body.   amplitudes : whether the records show a dependence on amplitude.   maps : static maps.
    friction_bound : share of the squares that any further law of friction could explain; None where nothing is missing."""

    resonances: Resonances | None
    amplitudes: bool
    maps: tuple[MapCheck, ...]
    friction_bound: float | None


def cross_checked(found: Diagnosis, recordings: Sequence[Recording], axis: Axis) -> Checks:
    """All checks of a diagnosis."""
    model = found.after.model
    places = np.concatenate([piece.motion.theta for piece in found.data.fitted]) * model["transmission.ratio"]
    excited = any(r.sidecar.experiment == "frf" for r in recordings)
    open_question = found.verdict in ("partly explained", "none of the known effects explains this")
    return Checks(
        resonances(model, float(np.median(places))) if excited else None,
        amplitudes_fitted(recordings),
        map_checks(recordings, model),
        friction_bound(found.after, ground_of(found.after, found.data.fitted, axis)) if open_question else None,
    )


def as_data(checks: Checks) -> dict[str, Any]:
    """For ``--json``."""
    return {
        "resonances": None if checks.resonances is None else asdict(checks.resonances),
        "static_maps": [{**asdict(check), "confirmed": check.confirmed} for check in checks.maps],
        "friction_bound": checks.friction_bound,
    }


def check_lines(checks: Checks) -> list[str]:
    """As sentences."""
    lines = []
    if checks.resonances is not None:
        low, high = (", ".join(f"{f:.1f}" for f in row) or "none" for row in asdict(checks.resonances).values())
        lines.append(f"The motor's response has its antiresonance at {low} Hz and its resonance at {high} Hz.")
        if not checks.amplitudes:
            lines.append(
                "Whether they depend on the amplitude: cannot tell, the fitted records hold one amplitude. "
                "Record the same excitation at half and at twice the torque."
            )
    for check in checks.maps:
        orders = sorted(check.orders, key=lambda order: -order.model)[:SHOWN]
        seen = ", ".join(f"{order.order:g}: {order.map:.3g} for {order.model:.3g}" for order in orders)
        word = "confirms" if check.confirmed else "does not confirm"
        lines.append(f"The static map {check.record} {word} the orders (correlation {check.correlation:.2f}; map for model {seen}).")
        if abs(np.angle(np.exp(1j * check.zero_rad))) > 0.05:
            lines.append(f"  The zero of its angle stands {np.degrees(check.zero_rad):.0f}° from that of the records.")
    if checks.friction_bound is not None:
        share = f"{'at most' if checks.friction_bound > WORTH else 'no more than'} {100.0 * checks.friction_bound:.0f} %"
        lines.append(f"Any further law of friction over speed and direction would explain {share} of the rest.")
    return ["", *lines] if lines else []
