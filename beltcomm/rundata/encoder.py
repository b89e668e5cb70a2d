"""The velocity estimators at a run's encoder and sampling."""

from __future__ import annotations

import math

from beltcomm.control import CascadeStructure
from beltcomm.encoder.estimators import EstimatorSettings
from beltcomm.rundata import offline
from beltcomm.rundata.store import saved_design, structure_from_dict
from beltcomm.runfolder import RunFolder


def structure_of(folder: RunFolder) -> CascadeStructure:
    """The cascade of the run's drive, else the design source's."""
    known = folder.load_result("drive")
    return structure_from_dict(known) if known is not None else offline.THESIS_STRUCTURE


def estimator_settings(folder: RunFolder, tick_s: float) -> EstimatorSettings:
    """At the motor shaft: an increment in rad in the place of metres; T_R of the design, else 2 ms."""
    lag_s = EstimatorSettings.lag_s
    if "final" in folder.names("designs"):
        lag_s = float((saved_design(folder).get("parameters") or {}).get("velocity_filter_s") or 0.0)
    return EstimatorSettings(math.tau / offline.counts_of(folder), tick_s, structure_of(folder).period_s, lag_s)
