"""The error of a model in plain units: N m (N, A) and per cent of the torque, with its noise beside it; see ``fit.band_error``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from beltcomm.fit.band_error import QUIET_SHARE, Banded, band_limited_errors, band_of
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.records import Data
from beltcomm.laboratory.figures import PlainError
from beltcomm.laboratory.samples import units_of
from beltcomm.model import Model

#: Error in the band over its noise from which on it is none.
ABOVE = 2.0


def plain_error(parts: Sequence[Banded], model: Model, band_hz: float) -> PlainError | None:
    """Over all samples of some segments that count; None without any."""
    count = sum(int(np.count_nonzero(part.keep)) for part in parts)
    if not count:
        return None
    error = math.sqrt(sum(float(np.sum(part.error[part.keep] ** 2)) for part in parts) / count)
    torque = math.sqrt(sum(float(np.sum(part.torque[part.keep] ** 2)) for part in parts) / count)
    noise = math.sqrt(sum(part.noise**2 * np.count_nonzero(part.keep) for part in parts) / count)
    return PlainError(error, noise, torque, 100.0 * error / torque if torque > 0.0 else math.inf, units_of(model).force, band_hz)


def unexplained_words(errors: Mapping[str, PlainError | None]) -> str:
    """Slow part of a record, by its name, that cannot be noise whatever it was taken for, in words; "" where there is none."""
    seen = {
        name: one for name, one in errors.items() if one is not None and one.error > ABOVE * one.noise and one.percent > 100.0 * QUIET_SHARE
    }
    if not seen:
        return ""
    name, worst = max(seen.items(), key=lambda item: item[1].percent)
    return (
        f"Below {worst.band_hz:g} Hz {worst.percent:.0f} % of the torque of {name} is not explained, {worst.error / worst.noise:.1f} times "
        "what such noise leaves there: that is no noise, something is missing in the model."
    )


def of_run(data: Data, fitted: Fitted, band_hz: float | None = None) -> tuple[PlainError | None, PlainError | None]:
    """Over the fitted records and over those held out; None where there are none.

    Parameters
    ----------
    band_hz : float or None
        :func:`band_of` without one.
    """
    band = band_of(data, fitted.model) if band_hz is None else band_hz
    parts = band_limited_errors(data, fitted, band)
    fitted_parts, held = ([part for part in parts if part.held_out is out] for out in (False, True))
    return plain_error(fitted_parts, fitted.model, band), plain_error(held, fitted.model, band)
