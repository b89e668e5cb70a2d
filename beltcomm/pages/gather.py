"""Contents of a run folder, read once for all sections of its report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from beltcomm.errors import BeltcommError
from beltcomm.fit.torque.acting_torque import acting_recordings
from beltcomm.given import pasted
from beltcomm.laboratory.compare import Comparison, compare, landmarks
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.rundata.fitted_run import Opened, explainable, open_fitted
from beltcomm.rundata.revisions import Revision, current_model, revisions
from beltcomm.rundata.store import saved_design
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Talk


@dataclass(frozen=True)
class Gathered:
    """A run.

    verifications : results of moves by name, in the order driven.

    Attributes
    ----------
    laboratory, comparison
        Model against records, None where they cannot be compared, with the reason in ``remarks``.
    command : str
        Of the report.
    """

    folder: RunFolder
    recordings: Sequence[Recording]
    model: Model | None
    laboratory: Opened | None
    comparison: Comparison | None
    rungs: Sequence[Revision]
    results: Mapping[str, Mapping[str, Any]]
    design: Mapping[str, Any]
    command: str
    remarks: Sequence[str] = field(default=())

    @property
    def name(self) -> str:
        """The folder's own name: pages name no path of the machine they were made on."""
        return self.folder.path.resolve().name

    @property
    def place(self) -> str:
        """The folder as a command takes it: its path where that is relative, else its name."""
        return str(self.folder.path) if not self.folder.path.is_absolute() else self.name

    @property
    def acting(self) -> Sequence[Recording]:
        """The recordings with the torque that acts, where the reading is not that."""
        return acting_recordings(self.recordings, self.laboratory.data.path if self.laboratory is not None else None)

    @property
    def landmarks(self) -> Mapping[str, float]:
        """Frequencies to mark, Hz; none without a model."""
        return landmarks(self.model, self.folder.axis.travel.middle_m) if self.model is not None else {}

    @property
    def verifications(self) -> dict[str, Mapping[str, Any]]:
        """Results of moves."""
        return {name.removeprefix("verify_"): result for name, result in self.results.items() if name.startswith("verify_")}


def gathered(run: Path, talk: Talk, against: Path | None = None, *, compared: bool = True) -> Gathered:
    """Everything of a run.

    Parameters
    ----------
    run : Path
    talk : Talk
    against : Path or None
        Another run that the command names.
    compared : bool
        The model with the records.

    Raises
    ------
    DataError
        For a folder that is none.
    """
    folder = RunFolder.open(run)
    remarks = []
    laboratory = comparison = None
    try:
        if compared:
            laboratory = open_fitted(run, talk)
            against_records = compare(laboratory.data, laboratory.fitted, laboratory.band_hz)
            explainable(against_records.ratio, run)
            comparison = against_records
    except BeltcommError as problem:
        remarks.append(f"model and measurement were not compared: {problem}")
    return Gathered(
        folder,
        laboratory.records.recordings if laboratory is not None else folder.recordings(),
        current_model(folder),
        laboratory,
        comparison,
        revisions(folder),
        results_of(folder),
        saved_design(folder) if "final" in folder.names("designs") else {},
        f"beltcomm report {pasted(folder.path.resolve().name)}"
        + (f" --against {pasted(against.resolve().name)}" if against is not None else ""),
        tuple(remarks),
    )


def results_of(folder: RunFolder) -> dict[str, dict[str, Any]]:
    """All results of a run by name, in the order they were written.

    Parameters
    ----------
    folder : RunFolder

    Raises
    ------
    DataError
        For a damaged one, with its file.
    """
    return {name: folder.load("results", name) for name in folder.names("results")}
