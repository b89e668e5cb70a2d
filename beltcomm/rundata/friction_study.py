"""Friction study of the constant-speed sweeps of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from beltcomm.axis import Axis
from beltcomm.errors import DataError
from beltcomm.identify.friction import FrictionFit, slowest_fitted_rad_s
from beltcomm.identify.magnitude_fit import MagnitudeFit
from beltcomm.identify.standstill import Standstill, largest
from beltcomm.identify.sweeps import Drift, Sweep, drift_of, measurements, sweeps_of
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.result import plain
from beltcomm.rundata import analyse


@dataclass(frozen=True)
class FrictionStudy:
    """Friction by the sweeps of a run.

    Attributes
    ----------
    friction : FrictionFit
        (3.36) over all of them.
    drifts : dict of int to Drift | str
        By measurement, or why it cannot be told.
    standstill : Standstill or None
        The record whose apparent damping is the largest, None without a model, a response or a sweep.
    """

    friction: FrictionFit
    sweeps: tuple[Sweep, ...]
    drifts: Mapping[int, Drift | str]
    standstill: Standstill | None


def study_of(recordings: Sequence[Recording], axis: Axis, model: Model | None, fits: Mapping[str, MagnitudeFit]) -> FrictionStudy:
    """Friction study of a run.

    Parameters
    ----------
    recordings : sequence of Recording
    axis : Axis
    model : Model or None
        Of the axis; None while none is known.
    fits : dict of str to MagnitudeFit
        Log-magnitude fits of its responses.

    Raises
    ------
    DataError
        Without a usable sweep.
    """
    slowest = slowest_fitted_rad_s(axis.transmission_m_rad)
    inertia = analyse.moved_inertia(model) if model is not None else 0.0
    sweeps = sweeps_of(recordings, slowest, inertia)
    friction = analyse.friction_of(recordings, slowest, inertia)
    drifts: dict[int, Drift | str] = {}
    for number, group in measurements(sweeps).items():
        try:
            drifts[number] = drift_of([p for s in group for p in s.plateaus])
        except DataError as problem:
            drifts[number] = str(problem)
    return FrictionStudy(friction, sweeps, drifts, largest(recordings, fits, model, friction) if model is not None else None)


def data_of(study: FrictionStudy) -> dict[str, Any]:
    """A friction study for programs and for ``results/friction_sweeps.yaml``; the passes stand in the recordings.

    Parameters
    ----------
    study : FrictionStudy
        Of the run.
    """
    sweeps = [{**plain(replace(s, plateaus=())), "name": s.name} for s in study.sweeps]
    return {"sweeps": sweeps, "drift": plain(dict(study.drifts)), "standstill": plain(study.standstill)}
