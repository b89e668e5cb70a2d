"""Rungs of the ladder as the laboratory makes them: what they leave over, and whether the held-out records confirm them."""

from __future__ import annotations

from collections.abc import Sequence

from beltcomm.fit.band_error import shared_band
from beltcomm.fit.base import in_groups_of
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.records import Data
from beltcomm.fit.uncertainty.intervals import with_intervals
from beltcomm.laboratory.acceptance import is_confirmed
from beltcomm.laboratory.compare import of_run
from beltcomm.laboratory.diagnosis import Diagnosis
from beltcomm.laboratory.figures import PlainError
from beltcomm.rundata.kept import keep_fit
from beltcomm.rundata.revisions import Revision, current_revision, new_revision, not_contradicted, revisions
from beltcomm.runfolder import RunFolder
from beltcomm.sentences.diagnosis_data import Plain


def base_revision(folder: RunFolder, data: Data, fitted: Fitted, command: str, when: str) -> Revision:
    """The first revision of a run: its base model.

    Parameters
    ----------
    folder : RunFolder
        The run folder.
    data : Data
        Records of the fit.
    fitted : Fitted
        Model, fitted to the records.
    command : str
        Command line, kept as provenance.
    when : str
        Date and time, kept as provenance.
    """
    plain, model = of_run(data, fitted), with_intervals(fitted)
    held = fitted.held_out_ratio
    rung = new_revision(folder, model, "base", ratio=fitted.ratio, held_out=held, confirmed=None, command=command, when=when, plain=plain)
    keep_fit(folder, data, fitted, model)
    return rung


def revision_of(folder: RunFolder, new: tuple[Data, Fitted], old: tuple[Data, Fitted], change: str, command: str, when: str) -> Revision:
    """A rung for a refitted model.

    What stands on a rung that is not confirmed must be better than the last one that is, too.

    Parameters
    ----------
    folder : RunFolder
        The run folder.
    new, old : tuple[Data, Fitted]
        Models, each with the records as it sees them.
    change : str
        As of :func:`change_of`.
    command : str
        Command line, kept as provenance.
    when : str
        Date and time, kept as provenance.
    """
    (data, after), (seen, before) = new, in_groups_of(*old, new[0])
    fell = None if change.startswith("-") else is_confirmed(seen, before, after, data)  # who takes one out has decided
    plain = of_run(data, after, shared_band((seen, before.model), (data, after.model)))
    parent = current_revision(folder)
    if fell and parent is not None and after.held_out_ratio is not None:
        trusted = not_contradicted(parent, revisions(folder))
        fell = trusted.held_out is None or (after.held_out_ratio < trusted.held_out and less(plain[1], trusted.plain_held_out))
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
        plain=plain,
    )
    keep_fit(folder, data, after, model)
    return rung


def plain_of(found: Diagnosis) -> tuple[Plain, Plain]:
    """Errors of the first and of the last model of a search in plain units, in the band of both.

    Parameters
    ----------
    found : Diagnosis
        The diagnosis.
    """
    band = shared_band((found.published_base[0], found.base.model), (found.data, found.final_fit.model))
    before = of_run(*found.published_base, band)
    return before, before if found.final_fit is found.base else of_run(found.data, found.final_fit, band)


def less(after: PlainError | None, trusted: PlainError | None) -> bool:
    """True if a plain error is not larger than that of a rung below; also where that was not written down, or in another band."""
    return after is None or trusted is None or after.band_hz != trusted.band_hz or after.error <= trusted.error


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
