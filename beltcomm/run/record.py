"""The recordings of a run, and the frequency response of one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from beltcomm.arrays import Array
from beltcomm.errors import DataError, UsageError
from beltcomm.given import Place, pasted, place
from beltcomm.identify.loop_response import response_to_signal
from beltcomm.recording import Recording, Sidecar
from beltcomm.result import Described, table
from beltcomm.rundata.conditions import condition_of
from beltcomm.runfolder import RunFolder

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from beltcomm.response import FrequencyResponse


def import_pandas() -> Any:
    """The package pandas.

    Raises
    ------
    UsageError
        It is not installed.
    """
    try:
        import pandas as found
    except ImportError:
        raise UsageError("pandas is not installed, and a DataFrame is one of its objects: pip install pandas") from None
    return found


class RunRecords(Described, Mapping[str, "RunRecord"]):
    """The complete recordings of a run by name."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder

    def __getitem__(self, name: str) -> RunRecord:
        """One recording; raises DataError naming those that there are."""
        return RunRecord(self._folder, name, self._folder.recording(str(name)))

    def __contains__(self, name: object) -> bool:
        return name in self._folder.finished_names()

    def __iter__(self) -> Iterator[str]:
        return iter(self._folder.finished_names())

    def __len__(self) -> int:
        return len(self._folder.finished_names())

    def _lines(self) -> list[str]:
        rows = []
        for name in self:
            one = self._folder.recording(name)
            seconds = "" if one.is_static_map else f"{one.duration_s:.1f}"
            rows.append([name, one.sidecar.experiment, seconds, f"{len(one.torque)}", "yes" if one.sidecar.held_out else ""])
        return list(table(["record", "experiment", ">s", ">samples", "held out"], rows)) or ["no recordings"]


class RunRecord(Described):
    """One recording: signals that never change.

    Parameters
    ----------
    folder : RunFolder
        It belongs to.
    name : str
        Of its file.
    recording : Recording
        Its signals, checked.
    """

    def __init__(self, folder: RunFolder, name: str, recording: Recording) -> None:
        self._folder, self.name, self.recording = folder, name, recording

    @property
    def t_s(self) -> Array:
        """Time, s."""
        return self.recording.t_s

    @property
    def torque(self) -> Array:
        """Torque at the motor shaft, N m (or what :attr:`Recording.torque_unit` says)."""
        return self.recording.torque

    @property
    def position(self) -> Array:
        """Angle of the motor shaft, rad (or what :attr:`Recording.position_unit` says)."""
        return self.recording.position

    @property
    def sidecar(self) -> Sidecar:
        """Circumstances of the record."""
        return self.recording.sidecar

    def to_dataframe(self) -> pandas.DataFrame:
        """All columns as a pandas DataFrame, time as its index.

        Returns
        -------
        pandas.DataFrame
            Columns as in the file, with the unit in the name.

        Raises
        ------
        UsageError
            pandas is not installed.
        """
        made = import_pandas()
        columns = {name: np.array(values) for name, values in self.recording.columns().items()}
        return made.DataFrame(columns, index=made.Index(columns.pop("t_s"), name="t_s") if "t_s" in columns else None)

    def frf(self) -> RecordResponse:
        """Its frequency response from torque to motor angle.

        Raises
        ------
        DataError
            For a record that has none.
        """
        note = self.sidecar.excitation
        if note is None or not note.period_samples:
            excited = [n for n in RunRecords(self._folder) if (e := self._folder.recording(n).sidecar.excitation) and e.period_samples]
            raise DataError(
                f"{self.name} was not excited with periods, so that it has no frequency response; those that have one: "
                f"{', '.join(excited) or 'none'}"
            )
        return RecordResponse(self, response_to_signal(self.recording, self.torque))

    def plot(self) -> Drawing:
        """Its signals over time."""
        from beltcomm.report import style

        shown = {name: values for name, values in self.recording.columns().items() if name != "t_s" and values.dtype.kind == "f"}
        with style.styled():
            made = style.figure(self.name, 0.6 + 1.5 * len(shown), self._caption("plot"))
            for axes, (name, values) in zip(np.atleast_1d(made.subplots(len(shown), 1, sharex=True)), shown.items(), strict=True):
                axes.plot(self.t_s if len(self.t_s) else np.arange(len(values)), values, color=style.RESIDUAL, linewidth=0.8)
                axes.set_ylabel(name, fontsize=8)
            axes.set_xlabel("time in s" if len(self.t_s) else "sample")
        return Drawing(made)

    def _caption(self, what: str) -> Any:
        from beltcomm.report.style import Caption

        return Caption(f"beltcomm.open({str(self._folder.path)!r})[{self.name!r}].{what}()", f"{pasted(self._folder.path)}/recordings")

    def _lines(self) -> list[str]:
        one = self.recording
        lines: list[str] = [f"Record {self.name}: {one.sidecar.experiment or 'unknown experiment'}, {len(one.torque)} samples"]
        rows = [[name, f"{v.min():.4g}", f"{v.max():.4g}"] for name, v in one.columns().items() if v.dtype.kind == "f" and len(v)]
        return [*lines, *table(["column", ">least", ">largest"], rows), *one.notes]


class RecordResponse:
    """Frequency response of a record; ``freq_hz``, ``h`` (complex, rad/(N m)), ``noise``, ``coherence`` are arrays.

    Parameters
    ----------
    record : RunRecord
        It is of.
    response : FrequencyResponse
        The estimate.
    """

    def __init__(self, record: RunRecord, response: FrequencyResponse) -> None:
        self._record, self.response = record, response
        self.freq_hz, self.h, self.noise, self.coherence = response.freq_hz, response.h, response.noise, response.coherence

    def to_dataframe(self) -> pandas.DataFrame:
        """Its lines as a pandas DataFrame, frequency as the index.

        Returns
        -------
        pandas.DataFrame
            ``magnitude`` in rad/(N m), ``phase_deg``, ``noise`` (standard deviation of the response) and ``coherence``.

        Raises
        ------
        UsageError
            pandas is not installed.
        """
        columns = {"magnitude": np.abs(self.h), "phase_deg": np.degrees(np.angle(self.h)), "noise": self.noise, "coherence": self.coherence}
        made = import_pandas()
        return made.DataFrame(columns, index=made.Index(self.freq_hz, name="freq_hz"))

    def plot(self) -> Drawing:
        """Magnitude and phase with the 95 % band of the noise."""
        from beltcomm.report.responses import responses_figure

        ratio = self._ratio
        words = self._record.name if ratio is None else f"{self._record.name}, {condition_of(self._record.recording, ratio).words()}"
        return Drawing(responses_figure([(words, self.response, None)], [], self._record._caption("frf().plot")))

    @cached_property
    def _ratio(self) -> float | None:
        folder = self._record._folder
        return folder.axis.transmission_m_rad if folder.has_axis and folder.axis.get("pulley.effective_radius_m") is not None else None

    def __repr__(self) -> str:
        f = self.freq_hz
        periods = self.response.n_periods
        return f"Frequency response of {self._record.name}: {len(f)} lines from {f[0]:.3g} to {f[-1]:.4g} Hz, {periods} periods"


@dataclass(frozen=True)
class Drawing:
    """A matplotlib figure that a notebook shows.

    Attributes
    ----------
    figure : Figure
        To go on with.
    """

    figure: Figure

    def save(self, path: Place) -> None:
        """Write the drawing as PNG.

        Parameters
        ----------
        path : Place
            Of the file.

        Raises
        ------
        UsageError
            For a file that exists: delete it, or give another name.
        """
        from beltcomm.report import style

        file = place(path, "picture")
        if file.exists():
            raise UsageError(f"{file} exists; give another file name, or delete it first")
        style.save(self.figure, file)

    def _repr_png_(self) -> bytes:
        stream = BytesIO()
        self.figure.savefig(stream, format="png", dpi=110)
        return stream.getvalue()
