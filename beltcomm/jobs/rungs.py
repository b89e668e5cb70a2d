"""Rungs of the ladder as the laboratory makes them: what they leave over, and whether the held-out records confirm them."""

from __future__ import annotations

from collections.abc import Sequence

from beltcomm.fit.band_error import band_of, shared_band
from beltcomm.fit.base import in_groups_of
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.records import Data
from beltcomm.fit.uncertainty.intervals import with_intervals
from beltcomm.laboratory.acceptance import is_confirmed
from beltcomm.laboratory.compare import in_bands, of_run
from beltcomm.laboratory.diagnosis import Diagnosis
from beltcomm.laboratory.figures import Plain, PlainError
from beltcomm.rundata.kept import keep_fit
from beltcomm.rundata.revisions import Revision, band_of_rungs, current_revision, new_revision, not_contradicted, revisions
from beltcomm.runfolder import RunFolder


def base_revision(folder: RunFolder, data: Data, fitted: Fitted, command: str, when: str) -> Revision:
    """The first revision of a run: its base model.

    Parameters
    ----------
    folder : RunFolder
    data : Data
        Records of the fit.
    fitted : Fitted
        Model, fitted to the records.
    command : str
        Command line, kept as provenance.
    when : str
        Date and time, kept as provenance.
    """
    bands, model = in_bands(data, fitted, band_of(data, fitted.model)), with_intervals(fitted)
    held = fitted.held_out_ratio
    rung = new_revision(folder, model, "base", ratio=fitted.ratio, held_out=held, confirmed=None, command=command, when=when, bands=bands)
    keep_fit(folder, data, fitted, model)
    return rung


def revision_of(folder: RunFolder, new: tuple[Data, Fitted], old: tuple[Data, Fitted], change: str, command: str, when: str) -> Revision:
    """A rung for a refitted model.

    Parameters
    ----------
    folder : RunFolder
    new, old : tuple[Data, Fitted]
        Models, each with the records as it sees them.
    change : str
        As of :func:`change_of`.
    command : str
        Command line, kept as provenance.
    when : str
        Date and time, kept as provenance.
    """
    data, after = new
    fell = None if change.startswith("-") else confirms(folder, new, old)  # who takes one out has decided
    model = with_intervals(after)
    rung = new_revision(
        folder,
        model,
        change,
        ratio=after.ratio,
        held_out=after.held_out_ratio,
        confirmed=fell,
        command=command,
        when=when,
        bands=in_bands(data, after, band_of(data, after.model)),
    )
    keep_fit(folder, data, after, model)
    return rung


def confirms(folder: RunFolder, new: tuple[Data, Fitted], old: tuple[Data, Fitted]) -> bool | None:
    """True if the held-out records confirm a refitted model; None without any.

    What stands on a rung that is not confirmed must be better than the last one that is, too.

    Parameters
    ----------
    folder : RunFolder
    new, old : tuple[Data, Fitted]
        Models, each with the records as it sees them.
    """
    (data, after), (seen, before) = new, in_groups_of(*old, new[0])
    fell, parent = is_confirmed(seen, before, after, data), current_revision(folder)
    if not fell or parent is None or after.held_out_ratio is None:
        return fell
    trusted = not_contradicted(parent, revisions(folder))
    if trusted is parent:
        return fell
    edge = min((band_of(data, after.model), *(one.band_hz for one in trusted.bands[:1])))
    then, now = trusted.up_to(edge)[1], of_run(data, after, edge)[1]
    fell = trusted.held_out is None or after.held_out_ratio < trusted.held_out
    return fell and (then is None or now is None or _beside_noise(now) <= _beside_noise(then))


def _beside_noise(told: PlainError) -> float:
    """Mean square of an error without the noise that is predicted of it: another model passes on another."""
    return told.error**2 - told.noise**2


def plain_of(found: Diagnosis, rungs: Sequence[Revision]) -> tuple[Plain, Plain]:
    """Errors of the first and of the last model of a search in plain units, in the band of both, all between and the run's rungs.

    Parameters
    ----------
    found : Diagnosis
    rungs : sequence of Revision
        Of the run.
    """
    base, first = found.published_base
    models = [(base, first.model), *((step.data or found.data, step.after.model) for step in found.steps)]
    band = min(shared_band(*models), band_of_rungs(rungs))
    before = of_run(*found.published_base, band)
    return before, before if found.final_fit is found.base else of_run(found.data, found.final_fit, band)


def change_of(new: Sequence[str], removed: Sequence[str] = ()) -> str:
    """Changes of a revision: effects with + and -, ``with its form`` or ``form of EFFECT`` where one became free.

    Parameters
    ----------
    new : sequence of str
        Effects, and forms as ``EFFECT.FORM``.
    removed : sequence of str
        Effects.
    """
    effects = [f"+{name}" for name in new if "." not in name and name not in removed]
    effects += [f"-{name}" for name in removed if name not in new]
    owners = dict.fromkeys(name.split(".")[0] for name in new if "." in name)
    return " ".join(effects + ["with its form" if owner in new else f"form of {owner}" for owner in owners])
