"""Values of a session as plain mappings, for the run folder and for ``--json``, and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from beltcomm.control import Cascade, CascadeStructure
from beltcomm.design.cascade import DesignResult
from beltcomm.drive import Capabilities
from beltcomm.errors import DataError, UsageError
from beltcomm.fit.model_fit import ModelFit
from beltcomm.objects import ParameterObject
from beltcomm.parameters import cascade_to_parameters, parameters_to_cascade
from beltcomm.result import plain
from beltcomm.verify import Verdict

#: Title of the plan that was agreed to, among the results of its run.
PLAN = "plan"


def drive_to_dict(capabilities: Capabilities) -> dict[str, Any]:
    """What the later steps need of a drive: ``results/drive.yaml``."""
    return {**plain(capabilities), "kinds": sorted(capabilities.kinds), "torque_along": sorted(capabilities.torque_along)}


def structure_from_dict(data: Mapping[str, Any]) -> CascadeStructure:
    """The cascade structure from :func:`drive_to_dict`.   Raises DataError when it is damaged."""
    try:
        fields = dict(data["structure"])
        return CascadeStructure(**{**fields, "prefilters": tuple(fields["prefilters"])})
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"results/drive.yaml is damaged ({error}); connect to the drive again with a new run") from error


def parameters_from_dict(data: Mapping[str, Any]) -> dict[str, ParameterObject]:
    """The objects of the drive's parameters from :func:`drive_to_dict`.   Raises DataError when they are missing or damaged."""
    try:
        found = {str(name): ParameterObject(**entry) for name, entry in data["parameters"].items()}
    except (KeyError, TypeError, AttributeError) as error:
        raise DataError(
            f"results/drive.yaml does not tell the objects of the drive's parameters ({error}); it is damaged, or of an older run: begin a "
            "new run with this drive"
        ) from error
    if not found:
        raise DataError("the run's drive has no parameter that beltcomm could write")
    return found


def fit_to_dict(fit: ModelFit) -> dict[str, Any]:
    """Everything of a fit but the model's own numbers, which stand in ``models/``."""
    return {
        "model": fit.model.name,
        "free": list(fit.free),
        "correlation": plain(fit.correlation),
        "covariance": plain(fit.covariance),
        "misfit": fit.misfit,
        "suspect": bool(fit.suspect),
        "held_out_misfit": fit.held_out_misfit,
        "record_misfit": plain(fit.record_misfit),
        "samples": fit.samples,
        "noise_nm": fit.noise_nm,
        "freedom": fit.freedom,
        "remarks": list(fit.remarks),
    }


def design_to_dict(design: DesignResult, cascade: Cascade, dead_time_s: float, apparent_damping_nm_s_rad: float) -> dict[str, Any]:
    """A design with its proof: ``designs/final.yaml``."""
    return {
        "parameters": cascade_to_parameters(cascade),
        "revision": "",
        "compensated": [],
        "structure": plain(design.structure),
        "specification": plain(design.specification),
        "dead_time_s": dead_time_s,
        "apparent_damping_nm_s_rad": apparent_damping_nm_s_rad,
        "margins": plain(design.margins),
        "binding": list(design.binding),
        "remarks": list(design.remarks),
    }


def cascade_from_dict(data: Mapping[str, Any]) -> Cascade:
    """The controller of a saved design.   Raises DataError when it is damaged."""
    try:
        return parameters_to_cascade({str(k): float(v) for k, v in data["parameters"].items()})
    except (KeyError, TypeError, ValueError, AttributeError, UsageError) as error:
        raise DataError(f"the design in this run folder is damaged ({error}); run `beltcomm design` again") from error


def delay_from_dict(data: Mapping[str, Any]) -> float:
    """Delay from torque setpoint to torque that a saved design was proven with, s.   Raises DataError when it is damaged."""
    try:
        return float(data["dead_time_s"])
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"the design in this run folder is damaged ({error}); run `beltcomm design` again") from error


def verdict_to_dict(verdict: Verdict) -> dict[str, Any]:
    """``results/verify.yaml``."""
    return dict(plain(verdict))
