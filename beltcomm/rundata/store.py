"""Values of a session as plain mappings, for the run folder and for ``--json``, and back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from beltcomm.control import Cascade, CascadeStructure
from beltcomm.design.cascade import DesignResult
from beltcomm.drive import Capabilities, StatedReading
from beltcomm.drive.objects import ParameterObject
from beltcomm.drive.parameters import cascade_to_parameters, parameters_to_cascade
from beltcomm.errors import DataError, UsageError
from beltcomm.fit.model_fit import ModelFit
from beltcomm.identify.led_gains import GainFactors
from beltcomm.result import plain
from beltcomm.runfolder import RunFolder

#: The most that a saved design may ask of a drive, SI at the motor shaft: no servo of a belt axis comes near it.
MOST: Mapping[str, float] = {
    "kp_nm_s_rad": 1e3,
    "ki_nm_rad": 1e6,
    "kpp_1_s": 1e4,
    "velocity_filter_s": 1.0,
    "prefilter_omega_rad_s": 1e6,
    "prefilter_d_n": 1e3,
    "ff_inertia_kg_m2": 10.0,
    "ff_viscous_nm_s_rad": 1e3,
    "ff_coulomb_nm": 1e4,
    "ff_offset_nm": 1e4,
    "ff_velocity": 10.0,
    "ff_advance_s": 1.0,
    "prefilter_roll_off_rad_s": 1e6,
}
#: s: longest delay that a design was made with.
LONGEST_DELAY_S = 1.0
#: Title of the plan that was agreed to, among the results of its run.
PLAN = "plan"


def drive_to_dict(capabilities: Capabilities) -> dict[str, Any]:
    """Data of a drive for the later steps: ``results/drive.yaml``.

    Parameters
    ----------
    capabilities : Capabilities
    """
    return {**plain(capabilities), "kinds": sorted(capabilities.kinds), "torque_along": sorted(capabilities.torque_along)}


def stated_reading(folder: RunFolder) -> StatedReading | None:
    """Statement of a run's drive profile about the torque that it reports; None where it states nothing.

    Parameters
    ----------
    folder : RunFolder

    Raises
    ------
    DataError
        For a damaged result.
    """
    found = (folder.load_result("drive") or {}).get("torque_reading")
    return None if found is None else StatedReading(found.get("late_s"), found.get("filter_s"), found.get("command"))


def structure_from_dict(data: Mapping[str, Any]) -> CascadeStructure:
    """The cascade structure from :func:`drive_to_dict`.

    Parameters
    ----------
    data : mapping of str to Any
        Content of ``results/drive.yaml``.

    Raises
    ------
    DataError
        When it is damaged.
    """
    try:
        structure = CascadeStructure(**{**data["structure"], "prefilters": tuple(data["structure"]["prefilters"])})
        _check_structure(structure)
        return structure
    except ValueError as error:
        raise DataError(f"results/drive.yaml is damaged ({error}); connect to the drive again with a new run") from error


def _check_structure(structure: CascadeStructure) -> None:
    """Raise ValueError for what no drive tells of itself."""
    if not 0.0 < structure.period_s <= LONGEST_DELAY_S:
        raise ValueError(f"a period of {structure.period_s} s")
    if any(math.isnan(value) for one in (structure.steps, structure.lowest, structure.highest) for value in one.values()):
        raise ValueError("a bound of a gain is no number")
    if not (structure.output_limit_rad_s > 0.0 and structure.dead_zone_rad >= 0.0):
        raise ValueError(f"an output limit of {structure.output_limit_rad_s}, or a dead zone of {structure.dead_zone_rad}")


def parameters_from_dict(data: Mapping[str, Any]) -> dict[str, ParameterObject]:
    """The objects of the drive's parameters from :func:`drive_to_dict`.

    Parameters
    ----------
    data : mapping of str to Any
        Content of ``results/drive.yaml``.

    Raises
    ------
    DataError
        When there are none.
    """
    found = {name: ParameterObject(**entry) for name, entry in (data.get("parameters") or {}).items()}
    if not found:
        raise DataError("results/drive.yaml tells no object of the drive's parameters; it is of an older run: begin a new run")
    return found


def fit_to_dict(fit: ModelFit) -> dict[str, Any]:
    """Everything of a fit but the model's own numbers and their covariance, which stand in ``models/``.

    Parameters
    ----------
    fit : ModelFit
        At its minimum.
    """
    return {
        "model": fit.model.name,
        "free": list(fit.free),
        "misfit": fit.misfit,
        "suspect": bool(fit.suspect),
        "held_out_misfit": fit.held_out_misfit,
        "record_misfit": plain(fit.record_misfit),
        "samples": fit.samples,
        "noise_nm": fit.noise_nm,
        "remarks": list(fit.remarks),
    }


def design_to_dict(design: DesignResult, cascade: Cascade, dead_time_s: float, apparent_damping_nm_s_rad: float) -> dict[str, Any]:
    """A design with its proof: ``designs/final.yaml``.

    Parameters
    ----------
    design : DesignResult
        Result with margins and specification.
    cascade : Cascade
        That was designed.
    dead_time_s : float, s
        That was counted with.
    apparent_damping_nm_s_rad : float, N m s/rad, motor shaft
        Largest that was counted with.
    """
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
    """The controller of a saved design.

    Parameters
    ----------
    data : mapping of str to Any
        Content of ``designs/final.yaml``.

    Raises
    ------
    DataError
        When it is damaged.
    """
    try:
        values = {str(k): float(v) for k, v in data["parameters"].items()}
        if wrong := [f"{name} {value:g}" for name, value in values.items() if not abs(value) <= MOST.get(name, math.inf)]:
            raise ValueError(f"{', '.join(wrong)} is more than any drive has")
        return parameters_to_cascade(values)
    except (OverflowError, KeyError, TypeError, ValueError, AttributeError, UsageError) as error:
        raise DataError(f"the design in this run folder is damaged ({error}); run `beltcomm design` again") from error


def saved_design(folder: RunFolder) -> dict[str, Any]:
    """``designs/final.yaml``, what is read of it checked.

    Parameters
    ----------
    folder : RunFolder

    Raises
    ------
    DataError
        When it is missing or damaged.
    """
    saved = folder.load("designs", "final")
    cascade_from_dict(saved)
    try:
        _check_design(saved)
    except ValueError as error:
        raise DataError(f"{folder.file('designs', 'final')} is damaged ({error}); run `beltcomm design` again") from error
    return saved


def _check_design(saved: Mapping[str, Any]) -> None:
    """Raise ValueError for an entry of another size."""
    for name, most in (("dead_time_s", LONGEST_DELAY_S), ("apparent_damping_nm_s_rad", MOST["kp_nm_s_rad"])):
        if not abs(saved.get(name) or 0.0) <= most:
            raise ValueError(f"{name} is {saved[name]}, at most {most:g} is possible")
    if any(math.isnan(one["phase_margin_deg"]) for one in saved["margins"]):
        raise ValueError("a phase margin is no number")


_LED_GAINS = "led_gains"


def led_gains_of(folder: RunFolder) -> GainFactors | None:
    """Factors between the gains of a run's drive and what they are taken for; None where it knows none.

    Parameters
    ----------
    folder : RunFolder

    Raises
    ------
    DataError
        For a damaged file.
    """
    data = folder.load_result(_LED_GAINS)
    return None if data is None else GainFactors(*(data[name] for name in ("kp", "kpp", "kp_interval", "kpp_interval")))


def keep_led_gains(folder: RunFolder, found: GainFactors) -> None:
    """Keep the factors of the drive's gains that a move has shown, unless an earlier one knows them better.

    Parameters
    ----------
    folder : RunFolder
    found : GainFactors
        With their 95 % half widths.
    """
    before = led_gains_of(folder)
    if before is None or found.kpp_interval <= before.kpp_interval:
        folder.save("results", _LED_GAINS, found.to_dict())
        folder.journal(
            f"by its move with a led reference the drive's K_P is {found.kp:.4f} ± {found.kp_interval:.4f} times what it is taken for, "
            f"K_PP {found.kpp:.4f} ± {found.kpp_interval:.4f} times"
        )


def as_in_drive(folder: RunFolder, cascade: Cascade) -> Cascade:
    """A controller as the run knows that it really runs in the drive.

    Parameters
    ----------
    folder : RunFolder
    cascade : Cascade
        As it was written.
    """
    factors = led_gains_of(folder)
    return cascade if factors is None else factors.of(cascade)
