"""A run folder with its model fitted to its records, and the records that show another load although nobody said so."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from beltcomm.errors import DataError
from beltcomm.fit.band_error import band_of
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.loads import load_remarks
from beltcomm.fit.records import Data
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.fit.uncertainty.intervals import information_of, with_intervals
from beltcomm.given import pasted
from beltcomm.laboratory.cross_checks import SheetDoubt, doubts_of
from beltcomm.laboratory.extracts import EXTRACT_ROWS
from beltcomm.laboratory.run_checks import Checked, check_run
from beltcomm.model.mounted import carrying
from beltcomm.outside import in_words
from beltcomm.rundata.kept import fit_base
from beltcomm.rundata.revisions import band_of_rungs, current_model, revisions
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Talk

#: Error over noise from which on nothing is said of a model: whole torques are some hundred times the noise of a drive.
FARTHEST = 1e4

#: Bytes of recordings above which it is told, of one row, and s: to read and check a byte, and to fit a row.
LONG_BYTES, ROW_BYTES, READ_S, FIT_S = 20_000_000, 30, 9e-8, 4e-4


@dataclass(frozen=True)
class Opened:
    """A run folder with its model fitted to its records."""

    folder: RunFolder
    data: Data
    fitted: Fitted
    records: Checked

    @cached_property
    def band_hz(self) -> float:
        """Up to which the run's models are told in plain units, Hz: the narrowest of theirs, so that one has one error."""
        return min(band_of(self.data, self.fitted.model), band_of_rungs(revisions(self.folder)))

    @cached_property
    def sheets(self) -> tuple[SheetDoubt, ...]:
        """Data-sheet values that the model contradicts."""
        return doubts_of(self.fitted, self.folder.axis, self.records.recordings)


def records_of(folder: RunFolder) -> Checked:
    """The records of a run, checked together.

    Parameters
    ----------
    folder : RunFolder

    Raises
    ------
    DataError
        For records that no model can be judged on.
    """
    return with_remarks_on_rest(folder, check_run(folder.recordings(), folder.axis, foreign=not folder.drive))


def with_remarks_on_rest(folder: RunFolder, records: Checked) -> Checked:
    """The records of a run with what was left out of them among the remarks.

    Parameters
    ----------
    folder : RunFolder
    records : Checked
    """
    return replace(records, remarks=(*folder.remarks, *records.remarks))


def open_fitted(run: Path, talk: Talk) -> Opened:
    """The current model of a run, or the base model where there is none yet, fitted to all records.

    Parameters
    ----------
    run : Path
    talk : Talk
        Hears how long it takes.

    Raises
    ------
    DataError
        For records that cannot be fitted.
    """
    folder = RunFolder.open(run)
    foretell(folder, talk)
    records = records_of(folder)
    talk.phase(1, 1, "fit of the present model")
    _, data, fitted = fit_base(folder, records.recordings, current_model(folder))
    return Opened(folder, data, fitted, with_remarks_on_loads(folder, records, fitted))


def with_remarks_on_loads(folder: RunFolder, records: Checked, fitted: Fitted) -> Checked:
    """The records with what different loads weigh among the remarks, or which of them shows one that nobody mentioned.

    In a session at a drive nothing is mounted between two records.

    Parameters
    ----------
    folder : RunFolder
    records : Checked
        Checked, with their remarks.
    fitted : Fitted
        To these records.
    """
    if not any(piece.motion.mounted for piece in fitted.problem.pieces):
        return records if folder.drive else replace(records, remarks=(*records.remarks, *_clearest(fitted)))
    return replace(records, remarks=(*records.remarks, *load_remarks(records.recordings, with_intervals(fitted))))


def explainable(ratio: float, run: Path) -> None:
    """Refuse a model that is too far off for its error to mean anything.

    Parameters
    ----------
    ratio : float
        Error over the noise.
    run : Path
        Of the run folder, for the sentence.

    Raises
    ------
    DataError
        Where a model is so far off that its error is no number of this axis, as of a run that failed early.
    """
    if not ratio < FARTHEST:
        raise DataError(
            f"the records of {run} cannot be explained by any model of an axis (its error would be more than {FARTHEST:.0f} times the "
            "noise): they are of a session that failed, or hold another quantity than they say. Make them again with `beltcomm "
            f"commission`, or take the wrong ones out of {run / 'recordings'}; `beltcomm bundle {pasted(run)}` packs all for whoever helps"
        )


def foretell(folder: RunFolder, talk: Talk) -> None:
    """Say how long reading and fitting take, where that is long.

    Parameters
    ----------
    folder : RunFolder
    talk : Talk
    """
    size = sum(path.stat().st_size for path in folder.recordings_folder.glob("*.csv"))
    if size > LONG_BYTES:
        rows = min(size / ROW_BYTES, EXTRACT_ROWS)
        talk.say(
            f"The recordings have {in_words(size)}: about {READ_S * size:.0f} s to read them, then about {FIT_S * rows:.0f} s for a fit."
        )


#: Fall of O beyond which a mass of its own is no chance, as for an effect; least change of all that moves; error over the noise up to which
#: the model is near enough to say so.
EVIDENCE, LEAST, NEAR = 120.0, 0.03, 3.0


@dataclass(frozen=True)
class OwnLoad:
    """A record and the mass, kg or kg m², that it shows beside that of the others."""

    record: str
    mass: float
    others: float
    unit: str

    def words(self) -> str:
        """Remedy in words."""
        return (
            f"{self.record} shows {self.mass:.4g} {self.unit}, the model {self.others:.4g}: if another load was mounted there, say so "
            "(--payload or --load at import, `load: NAME` in its sidecar), and it gets a mass of its own."
        )


def _own_loads(fitted: Fitted) -> list[OwnLoad]:
    """Records that clearly ask for a load of their own, the clearest first (Rao's score test, the other parameters taken out).

    With gradient g and information A of one record r, W of all, for its mass j:  Δ = -g_j/S,  fall of O = g_j²/S,
    S = A_jj - A_j W⁻¹ A_j.   None of a model that is far off, or with an observer.
    """
    problem, name = fitted.problem, carrying(fitted.model)
    records = list(dict.fromkeys(piece.record for piece in problem.pieces))
    if len(records) < 2 or not fitted.ratio < NEAR or needs_observer(fitted.model):
        return []
    told = information_of(fitted)
    if name not in told.names or len(told.pulls) != len(records):
        return []
    j, found = told.names.index(name), []
    whole = fitted.model.driven_inertia() / fitted.model["transmission.ratio"] ** 2 if name == "cart.mass" else fitted.model[name]
    for r, record in enumerate(records):
        slope, beside = float(told.pulls[r, j]), told.parts[r][j]
        left = float(told.parts[r][j, j] - beside @ told.inverse @ beside)
        if left <= 0.0 or slope**2 / left < EVIDENCE * max(told.level, 1.0):
            continue
        change = -slope / left * float(told.scale[j])
        if abs(change) > LEAST * whole and math.isfinite(change):
            found.append((slope**2 / left, OwnLoad(record, fitted.model[name] + change, fitted.model[name], _unit(fitted, name))))
    return [load for _, load in sorted(found, key=lambda pair: -pair[0])]


def _unit(fitted: Fitted, name: str) -> str:
    return fitted.model.parameters[name].unit.replace("2", "²")


def _clearest(fitted: Fitted) -> list[str]:
    """Remark on the record that asks most clearly for a load of its own; at most one, for it shifts what the others show."""
    return [load.words() for load in _own_loads(fitted)[:1]]
