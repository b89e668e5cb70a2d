"""A fit of records whose rows come seldom: its numbers by simulation of those in open loop, see :mod:`beltcomm.fit.start.undersampled`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from beltcomm.fit.model_fit import ModelFit, fit_model
from beltcomm.fit.start.undersampled import LATE_S, NO_PASSES, SWING_SAMPLED, SeldomEstimate, SteadyPasses, comes_seldom, estimate
from beltcomm.fit.uncertainty.nuisance import released
from beltcomm.model import Model
from beltcomm.model.value import NORMAL_95
from beltcomm.recording import Recording

#: Rounding of the encoder in a second difference of its angle, in its steps.
SECOND_DIFFERENCE = math.sqrt(0.5)
#: What the records in closed loop are left to tell of a model that the others have told.
LEFT = "coulomb.level"
#: m: records nearer to each other are of one place.
ONE_PLACE_M = 0.05


@dataclass(frozen=True, eq=False)
class SeldomFit(ModelFit):
    """A fit whose numbers are those of the simulated rows; ``fitted`` has what the records in closed loop add.

    Attributes
    ----------
    count_rad : float
        Of the encoder.
    """

    simulated: SeldomEstimate
    count_rad: float

    @property
    def free(self) -> tuple[str, ...]:
        """Names of what was fitted."""
        return self.simulated.names

    @property
    def misfit(self) -> float:
        """Mean square of the torque that is left, and of the noise of a reading that is not used here, over noise and rounding."""
        inertia = self.model["motor.inertia"] + self.model["transmission.ratio"] ** 2 * self.model["cart.mass"]
        sample_s = max(r.sample_period_s for r in self.data.recordings)
        rounding = SECOND_DIFFERENCE * self.count_rad * inertia / sample_s**2
        return (self.simulated.left_nm**2 + self.noise_nm**2) / (self.noise_nm**2 + rounding**2)

    @property
    def samples(self) -> int:
        """Number of rows that counted."""
        return self.simulated.samples

    @property
    def quantile(self) -> float:
        """Half width of a 95 % interval in standard deviations."""
        return NORMAL_95

    @property
    def judged(self) -> bool:
        """False: what acts between the rows no torque is worked out from."""
        return False

    @cached_property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on how these numbers were found."""
        period_ms = 1e3 * max(r.sample_period_s for r in self.data.recordings)
        return (
            f"rows every {period_ms:g} ms do not show how the motor swings between them: these numbers are those with which a simulation "
            "under the torque asked for goes from row to row as the axis did, near the data sheets where the rows say little",
        )


def fit_seldom(recordings: Sequence[Recording], start: Model, *, counts_per_rev: int, passes: SteadyPasses = NO_PASSES) -> SeldomFit | None:
    """The model by the open-loop records of the place where most was measured first.

    Parameters
    ----------
    recordings : sequence of Recording
    start : Model
        By the data sheets.
    counts_per_rev : int
    passes : SteadyPasses
        Of its strokes at constant speed.

    Returns
    -------
    SeldomFit or None
        None where no record's rows come seldom.

    Raises
    ------
    DataError
        When nothing moves.
    """
    told = [r for r in recordings if comes_seldom(r, start, SWING_SAMPLED) and not r.sidecar.held_out and not len(r.gaps)]
    if not told:
        return None
    here = told[0].sidecar.start_position_m or 0.0
    told = [r for r in told if abs((r.sidecar.start_position_m or 0.0) - here) < ONE_PLACE_M]
    found = estimate(told, released(start), LATE_S, passes=passes)  # which keeps near the data sheets what the rows do not tell
    fixed = [name for name in found.model.parameters if name not in (LEFT, "transmission.ratio")]
    rest = fit_model(recordings, found.model, counts_per_rev=counts_per_rev, fixed=fixed)
    return SeldomFit(rest.data, rest.fitted, found.model, found, 2.0 * math.pi / counts_per_rev)
