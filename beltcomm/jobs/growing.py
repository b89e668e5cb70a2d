"""A run's model with an effect that somebody asked for, fitted from wherever that leaves least, or without one."""

from __future__ import annotations

from collections.abc import Mapping

from beltcomm.effects import effect_named
from beltcomm.errors import BeltcommError
from beltcomm.fit.base import NEXT_ITERATIONS, refit_with_rebuilt_motion
from beltcomm.fit.estimate import Fitted, fit
from beltcomm.fit.records import Data
from beltcomm.fit.touches import free_parameters
from beltcomm.laboratory.acceptance import drop_by
from beltcomm.laboratory.coupled_bodies import COUPLING, with_coupling
from beltcomm.laboratory.diagnosis import final_refit
from beltcomm.laboratory.forward_selection import MISSING, with_effect
from beltcomm.laboratory.law_shape import fixed_forms
from beltcomm.laboratory.score import ground_of
from beltcomm.model import Model
from beltcomm.rundata.fitted_run import Opened
from beltcomm.rundata.kept_fit import fit_base
from beltcomm.rundata.revisions import model_named, recording_hashes, revisions
from beltcomm.runfolder import RunFolder


def fit_with(here: Opened, effect: str, start: Mapping[str, float] | None) -> tuple[Data, Fitted]:
    """Records and model with an effect, whatever speaks for it.

    Parameters
    ----------
    start : mapping of str to float, or None
        Own parameters of the effect by bare name, from which the fit begins; None lets it search.
    """
    if effect == COUPLING.name and not start and (found := with_coupling(here.data, here.fitted, here.folder.axis)) is not None:
        return found
    ground = ground_of(here.fitted, here.data.fitted, here.folder.axis)
    grown = with_effect(here.data, here.fitted, ground, effect_named(effect), start)
    return refit_with_rebuilt_motion(here.data, better(here.folder, here.data, here.fitted, grown, effect), NEXT_ITERATIONS)


def fit_without(here: Opened, effect: str) -> tuple[Data, Fitted]:
    """Records and model without an effect; as they were where the run had this model before, for the same records.

    What was learnt with the effect, noise and rounding above all, would let the same model read another error.
    """
    smaller, now = here.fitted.model.without_effect(effect), recording_hashes(here.folder)
    for rung in reversed(revisions(here.folder)):
        if set(rung.effects) == set(smaller.effects) and rung.data == now:
            model = model_named(here.folder, rung.name)
            if set(free_parameters(model)) == set(free_parameters(smaller)):
                return fit_base(here.folder, here.records.recordings, model)[1:]
    first = fit(here.data, smaller, NEXT_ITERATIONS, offsets=here.fitted.offsets)
    return final_refit(*refit_with_rebuilt_motion(here.data, first, NEXT_ITERATIONS))


def diagnosis_start(folder: RunFolder, model: Model, effect: str) -> Model | None:
    """The model with the effect and the values that ``results/diagnosis.yaml`` ended with; None where it says nothing of it."""
    after = (folder.load_result("diagnosis") or {}).get("after")
    if after is None or effect not in after["effects"]:
        return None
    grown = model.with_effect(effect)
    fixed = fixed_forms(grown, effect_named(effect))  # these stay the usual ones: they are found after the effect
    told = {name: said["value"] for name, said in after["parameters"].items() if name in grown.parameters and name not in fixed}
    try:
        return grown.with_values(told, "diagnosis")
    except BeltcommError:  # out of their bounds
        return None


def better(folder: RunFolder, data: Data, base: Fitted, grown: Fitted, effect: str) -> Fitted:
    """The model grown from a base, or the same begun at what the diagnosis found where that leaves less: it may have come another way."""
    if grown.objective < MISSING * grown.problem.samples:
        return grown
    told = diagnosis_start(folder, base.model, effect)
    if told is None:
        return grown
    again = fit(data, told, NEXT_ITERATIONS, offsets=grown.offsets)
    return again if drop_by(grown, again) > 0.0 else grown
