"""A record that shows another load than the others although nobody said so: the first-order score of a mass of its own."""

from __future__ import annotations

import math
from dataclasses import dataclass

from beltcomm.fit.estimate import Fitted
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.fit.uncertainty.intervals import information_of
from beltcomm.model.mounted import carrying

#: Fall of O beyond which a mass of its own is no chance, as for an effect; least change of all that moves; error over the noise up to which
#: the model is near enough to say so.
EVIDENCE, LEAST, NEAR = 120.0, 0.03, 3.0


@dataclass(frozen=True)
class OwnLoad:
    """A record and the mass, kg or kg m², that it shows beside that of the others."""

    record: str
    mass: float
    others: float
    unit: str

    def words(self) -> str:
        """Remedy in words."""
        return (
            f"{self.record} shows {self.mass:.4g} {self.unit}, the model {self.others:.4g}: if another load was mounted there, say so "
            "(--payload or --load at import, `load: NAME` in its sidecar), and it gets a mass of its own."
        )


def own_loads(fitted: Fitted) -> list[OwnLoad]:
    """Records that clearly ask for a load of their own.

    With gradient g and information A of one record r, W of all, for its mass j:  Δ = -g_j/S,  fall of O = g_j²/S,
    S = A_jj - A_j W⁻¹ A_j.

    Parameters
    ----------
    fitted : Fitted
        Of all records.

    Returns
    -------
    list of OwnLoad
        The clearest first; none of a model that is far off, or with an observer.

    References
    ----------
    Rao's score test, the other parameters taken out.
    """
    problem, name = fitted.problem, carrying(fitted.model)
    records = list(dict.fromkeys(piece.record for piece in problem.pieces))
    if len(records) < 2 or not fitted.ratio < NEAR or needs_observer(fitted.model):
        return []
    told = information_of(fitted)
    if name not in told.names or len(told.pulls) != len(records):
        return []
    j, found = told.names.index(name), []
    whole = fitted.model.driven_inertia() / fitted.model["transmission.ratio"] ** 2 if name == "cart.mass" else fitted.model[name]
    for r, record in enumerate(records):
        slope, beside = float(told.pulls[r, j]), told.parts[r][j]
        left = float(told.parts[r][j, j] - beside @ told.inverse @ beside)
        if left <= 0.0 or slope**2 / left < EVIDENCE * max(told.level, 1.0):
            continue
        change = -slope / left * float(told.scale[j])
        if abs(change) > LEAST * whole and math.isfinite(change):
            found.append((slope**2 / left, OwnLoad(record, fitted.model[name] + change, fitted.model[name], _unit(fitted, name))))
    return [load for _, load in sorted(found, key=lambda pair: -pair[0])]


def _unit(fitted: Fitted, name: str) -> str:
    return fitted.model.parameters[name].unit.replace("2", "²")


def clearest(fitted: Fitted) -> list[str]:
    """Remark on the record that asks most clearly for a load of its own; at most one, for it shifts what the others show.

    Parameters
    ----------
    fitted : Fitted
        Of all records.

    Returns
    -------
    list of str
        One sentence or none.
    """
    return [load.words() for load in own_loads(fitted)[:1]]
