"""A model of a belt axis fitted to records, with its intervals, its error on records held out, and what is to be said of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import stdtrit

from beltcomm.arrays import Array
from beltcomm.errors import DataError
from beltcomm.fit.base import fit_base
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.loads import with_loads
from beltcomm.fit.noise.angle import apparent_step
from beltcomm.fit.noise.level import noise_colour, torque_noise
from beltcomm.fit.records import Data, prepare_records
from beltcomm.fit.torque.path import FAITHFUL, TorquePath
from beltcomm.fit.uncertainty.intervals import unbounded_estimates, with_intervals
from beltcomm.fit.uncertainty.nuisance import held_remarks
from beltcomm.fit.uncertainty.remarks import remark_on, remarks_on_pairs
from beltcomm.model import Model
from beltcomm.model.covariance import Covariance
from beltcomm.recording import Recording

#: s in which the axis moves and samples of them, for each parameter, and s of records for each beside some more, without which nothing is
#: fitted.  Seconds, since half the rate has half the samples of the same motion.
FEWEST_S, FEWEST_SAMPLES, GROUP_S, MORE = 0.05, 12, 0.2, 12
#: Mean square of the whitened residual above which a fit is called suspect; healthy virtual axes lie between 0.9 and 1.1.
SUSPECT_MISFIT = 1.5


@dataclass(frozen=True, eq=False)
class ModelFit:
    """A fitted model with the records that it was fitted to.

    Attributes
    ----------
    data : Data
        Records as the model sees them.
    fitted : Fitted
        The minimum.
    model : Model
        With 95 % intervals, None for a parameter at a bound.
    """

    data: Data
    fitted: Fitted
    model: Model

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the fitted parameters."""
        return self.fitted.problem.free

    @property
    def misfit(self) -> float:
        """Mean square of the whitened residual on fitted records, 1 at the noise."""
        return self.fitted.ratio**2

    @property
    def held_out_misfit(self) -> float | None:
        """Mean square of the whitened residual on held-out records, 1 at the noise; None without any."""
        return None if self.fitted.held_out_ratio is None else self.fitted.held_out_ratio**2

    @property
    def objective(self) -> float:
        """Minus twice the log likelihood, block-robust: what models of the same samples are compared by."""
        return self.fitted.objective

    @property
    def samples(self) -> int:
        """Number of values that counted."""
        return self.fitted.problem.samples

    @property
    def noise_nm(self) -> float:
        """Noise of the torque, N m rms."""
        return self.data.noise_nm

    @property
    def path(self) -> TorquePath:
        """From setpoint and reading to the torque that acts."""
        return self.data.path

    @property
    def suspect(self) -> bool:
        """True if so much is left unexplained that the numbers should not be trusted."""
        return not self.misfit <= SUSPECT_MISFIT  # nan, too, where no sample counts

    @property
    def judged(self) -> bool:
        """True if the misfit tells whether something is missing."""
        return True

    @property
    def covariance(self) -> Covariance:
        """Of the fitted parameters."""
        assert self.model.covariance is not None
        return self.model.covariance

    @property
    def quantile(self) -> float:
        """Half width of a 95 % interval in standard deviations."""
        return float(stdtrit(self.covariance.freedom, 0.975))

    @cached_property
    def record_misfit(self) -> Mapping[str, float]:
        """Mean square by record, held-out ones too."""
        squares: dict[str, list[Array]] = {}
        problem = self.fitted.problem
        for piece, white in zip(problem.pieces, np.split(self.fitted.residual, problem.ends[1:-1]), strict=True):
            squares.setdefault(piece.record, []).append(white**2)
        for piece, white in zip(self.data.held_out, self.fitted.held_out_residuals, strict=True):
            squares.setdefault(piece.record, []).append(white**2)
        return {name: float(np.mean(np.concatenate(parts))) for name, parts in squares.items() if sum(map(len, parts))}

    @cached_property
    def remarks(self) -> tuple[str, ...]:
        """Sentences: bounds, what is known badly and why."""
        parameters = self.model.parameters
        wanted = {n: (parameters[n].value, (parameters[n].interval or 0.0) / self.quantile) for n in self.free}
        wanted |= {n: told for n, told in unbounded_estimates(self.fitted).items() if parameters[n].interval is None}
        told = [remark_on(n, parameters[n], *wanted[n]) for n in self.free]
        if self.suspect:
            told.append(
                f"the model leaves {math.sqrt(self.misfit):.1f} times the noise unexplained: something it does not know acts on this axis, "
                "or a record is disturbed; its numbers may be off by more than their intervals"
            )
        told += held_remarks(self.model)
        told += remarks_on_pairs(self.free, [parameters[name] for name in self.free], self.covariance.correlation(self.free))
        return tuple(remark for remark in told if remark)


def fit_model(
    recordings: Sequence[Recording],
    start: Model,
    *,
    counts_per_rev: int,
    fixed: Sequence[str] = (),
    noise_nm: float | None = None,
    path: TorquePath | None = None,
    sheet: Model | None = None,
    progress: Callable[[float], None] = lambda _fraction: None,
) -> ModelFit:
    """Fit all parameters of ``start`` but the ``fixed`` ones to the recordings that are not held out.

    Parameters
    ----------
    recordings : sequence of Recording
        Of one axis; those with ``held_out`` judge the fit and take no part in it.
    start : Model
        Start values, effects and bounds.
    counts_per_rev : int
        Of the encoder.
    fixed : sequence of str
        Parameters that keep their start value, by full name.
    noise_nm : float or None
        N m rms, of the torque reading; None estimates it.
    path : TorquePath or None
        From setpoint and reading to the torque that acts, where it is known.
    sheet : Model or None
        The data sheets, for what the records do not tell.
    progress : callable
        Hears the share that is done, 0 to 1.

    Returns
    -------
    ModelFit
        Values with 95 % intervals, and what is left unexplained.

    Raises
    ------
    DataError
        When too few samples are left or the fit does not stay finite.
    """
    to_fit, start = [r for r in recordings if not r.sidecar.held_out], with_loads(start, recordings)
    noise = torque_noise(to_fit) if noise_nm is None else noise_nm
    step = apparent_step(to_fit, 2.0 * np.pi / counts_per_rev, noise)
    data = prepare_records(recordings, start, noise, step, {}, path=path or FAITHFUL, colour=noise_colour(to_fit))
    _check_enough(data, len(start.parameters) - len(fixed) - 1)
    data, fitted = fit_base(data, start, fixed=fixed, path=path, sheet=sheet, progress=progress)
    if not math.isfinite(fitted.objective):
        raise DataError("the fit did not converge; compare the recordings with the axis file (units, signs, feed constant)")
    return ModelFit(data, fitted, _of_fit(with_intervals(fitted)))


def _of_fit(model: Model) -> Model:
    """The model, its fitted values told as such."""
    parameters = {n: replace(v, origin="final fit") if v.origin == "laboratory" else v for n, v in model.parameters.items()}
    return replace(model, parameters=parameters)


def _check_enough(data: Data, free: int) -> None:
    """Raise DataError when too few samples move, with the seconds that are needed."""
    samples = sum(int(piece.keep.sum()) for piece in data.fitted)
    moving_s = sum(int(piece.keep.sum()) * piece.motion.sample_s for piece in data.fitted)
    span = sum(piece.motion.samples * piece.motion.sample_s for piece in data.fitted)
    least_s = GROUP_S * (free + MORE)
    if moving_s < FEWEST_S * free or samples < FEWEST_SAMPLES * free or span < least_s:
        raise DataError(
            f"only {samples} moving samples in {span:.1f} s are usable for {free} parameters; record at least {least_s:.0f} s in which "
            "the axis keeps moving"
        )
