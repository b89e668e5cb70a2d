"""A run folder as an object, for notebooks and programs; whatever it does is done by the functions of :mod:`beltcomm.api`."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from beltcomm.axis import Axis
from beltcomm.control import Cascade
from beltcomm.errors import BeltcommError, UsageError
from beltcomm.given import Place, number, place, word
from beltcomm.result import Described, Result, table
from beltcomm.run.model import RunModel
from beltcomm.run.record import RunRecord, RunRecords
from beltcomm.rundata.revisions import CURRENT, model_named
from beltcomm.rundata.store import cascade_from_dict, saved_design
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Talk

if TYPE_CHECKING:
    from beltcomm.api import Options
    from beltcomm.run.model import MovePrediction
    from beltcomm.rundata.headline import Headline
import shutil

from beltcomm.locks import NAME, at_work, occupied
from beltcomm.talk import Silence


class OpenedRun(Described):
    """One run folder; :func:`beltcomm.open` makes it.

    Nothing is kept here that the folder holds: a run that another program changes is seen as it is now.

    Parameters
    ----------
    path : str or path
        The run folder.
    talk : Talk, optional
        Hears of the progress of what takes long.
    """

    def __init__(self, path: Place, talk: Talk | None = None) -> None:
        self._folder = RunFolder.open(place(path))
        self._talk = talk

    @property
    def path(self) -> Path:
        """Folder of the run."""
        return self._folder.path

    @property
    def axis(self) -> Axis:
        """Axis as known beforehand."""
        return self._folder.axis

    @property
    def records(self) -> RunRecords:
        """The recordings by name."""
        return RunRecords(self._folder)

    def __getitem__(self, name: str) -> RunRecord:
        """One recording."""
        return self.records[name]

    @property
    def model(self) -> RunModel:
        """The present model.

        Raises
        ------
        DataError
            Where nothing was fitted yet.
        """
        return self.model_named(CURRENT)

    def model_named(self, name: str) -> RunModel:
        """A model of the run: an earlier revision, or the present one, ``final``.

        Parameters
        ----------
        name : str
            As the run shows it under ``models``.

        Returns
        -------
        RunModel
            Its parameters with intervals.

        Raises
        ------
        DataError
            Naming the nearest, and what makes one.
        """
        model = model_named(self._folder, word(name, "model"))
        travel = self.axis.travel if self._folder.has_axis else None
        if travel is None or travel.min_m is None or travel.max_m is None:
            return RunModel(model)
        return RunModel(model, (travel.min_m, travel.max_m))

    @property
    def headline(self) -> Headline:
        """The first sentence on the run, as every screen and the report have it: state, errors and the targets that count.

        Raises
        ------
        DataError
            For a damaged result.
        """
        from beltcomm.rundata.headline import headline_of

        return headline_of(self._folder)

    @property
    def gains(self) -> Cascade:
        """The controller of the present design.

        Raises
        ------
        DataError
            Where there is none.
        """
        return cascade_from_dict(saved_design(self._folder))

    def fit(self) -> Result:
        """Model of motor, belt and carriage from all records, see :func:`beltcomm.api.fit`.

        Returns
        -------
        Result
            Model and its intervals.
        """
        result: Result = _api().fit(self.path, talk=self._talk)
        return result

    def copy(self, path: Place) -> OpenedRun:
        """Copy the run under a new name, to try out on the copy what the run shall not keep.

        Parameters
        ----------
        path : str or path
            Folder to be made; it must not exist.

        Returns
        -------
        OpenedRun
            The copy.

        Raises
        ------
        UsageError
            The folder exists or cannot be written, or a session is at work in the run.
        """
        return OpenedRun(_copy_run(self._folder, place(path)), self._talk)

    def compare(self, *, pictures: bool = False) -> Result:
        """Compare model and measurement; see :func:`beltcomm.api.compare`.

        Parameters
        ----------
        pictures : bool
            Pictures into ``RUN/pictures``.

        Returns
        -------
        Result
            Ratios and places.
        """
        result: Result = _api().compare(self.path, pictures=pictures, talk=self._talk)
        return result

    def diagnose(self, *, cost: bool = False, following: bool = False) -> Result:
        """Find which effect is missing; see :func:`beltcomm.api.diagnose`; the model stays as it is.

        Parameters
        ----------
        cost : bool
            Say what it costs, in tracking error.
        following : bool
            Write the plan of what to record next.

        Returns
        -------
        Result
            The evidence for each effect.
        """
        result: Result = _api().diagnose(self.path, cost=cost, following=following, talk=self._talk)
        return result

    def add(self, effect: str, *, cost: bool = False, pictures: bool = False) -> Result:
        """Fit everything again with one more effect, as a new revision; see :func:`beltcomm.api.add`.

        Parameters
        ----------
        effect : str
        cost : bool
            Say what not knowing it costs, in tracking error.
        pictures : bool
            Pictures into ``RUN/pictures``.

        Returns
        -------
        Result
            Values before and after.
        """
        result: Result = _api().add(effect, self.path, cost=cost, pictures=pictures, talk=self._talk)
        return result

    def remove(self, effect: str, *, pictures: bool = False) -> Result:
        """Fit everything again without an effect, as a new revision; see :func:`beltcomm.api.remove`.

        Parameters
        ----------
        effect : str
        pictures : bool
            Pictures into ``RUN/pictures``.

        Returns
        -------
        Result
            Values before and after.
        """
        result: Result = _api().remove(effect, self.path, pictures=pictures, talk=self._talk)
        return result

    def ladder(self, *, pictures: bool = False) -> Result:
        """Show all revisions of the model; see :func:`beltcomm.api.ladder`.

        Parameters
        ----------
        pictures : bool
            Pictures into ``RUN/pictures``.

        Returns
        -------
        Result
            The steps, with their gain.
        """
        result: Result = _api().ladder(self.path, pictures=pictures)
        return result

    def design(self, *, payload_kg: float | None = None, **options: Any) -> Result:
        """Gains from the present model, see :func:`beltcomm.api.design`; nothing is written to a drive.

        Parameters
        ----------
        payload_kg : float, optional
            Heaviest load beyond what is mounted.
        **options : Any
            Of :class:`beltcomm.api.Options`: ``prefilter``, ``feedforward``, ``seed``.

        Returns
        -------
        Result
            Gains, margins, and what binds them.
        """
        given = {"payload_kg": None if payload_kg is None else number(payload_kg, "payload_kg", "kg"), **options}
        result: Result = _api().design(self.path, options=_options_of(given), talk=self._talk)
        return result

    def predict_move(
        self,
        start_m: float | None = None,
        end_m: float | None = None,
        *,
        speed_m_s: float | None = None,
        acceleration_m_s2: float | None = None,
        jerk_m_s3: float | None = None,
        payload_kg: float = 0.0,
    ) -> MovePrediction:
        """Simulate a move with the run's model and gains; no machine is needed, nothing moves.

        The drive follows the move itself: a reference that leads a drive without feedforward, as :meth:`verify` sends it, is left out.

        Parameters
        ----------
        start_m, end_m : float or None, m, carriage
            Its ends; with its limits all five, or none for the axis's own move.
        speed_m_s, acceleration_m_s2, jerk_m_s3 : float or None, m/s, m/s², m/s³, carriage
            Its limits.
        payload_kg : float, kg
            On the carriage beyond what was mounted while the run was recorded.

        Returns
        -------
        MovePrediction
            Tracking errors at motor and carriage, torque, ``to_dataframe()`` and ``plot()``.

        Raises
        ------
        DataError
            The run has no model or no design.
        UsageError
            The move leaves the travel, or lacks an end or a limit.
        """
        from beltcomm.run.model import predict

        loaded_kg = number(payload_kg, "payload_kg", "kg")
        if loaded_kg < 0.0:
            raise UsageError(f"payload_kg is {loaded_kg:g}; give what is carried further, 0 or more")
        given = {
            "start_m": start_m,
            "end_m": end_m,
            "speed_m_s": speed_m_s,
            "acceleration_m_s2": acceleration_m_s2,
            "jerk_m_s3": jerk_m_s3,
        }
        return predict(self._folder, loaded_kg, {name: value for name, value in given.items() if value is not None})

    def verify(self, drive: str, **options: Any) -> Result:
        """Drive a move with the run's design, see :func:`beltcomm.api.verify`; it moves the axis, and only with ``yes=True``.

        Parameters
        ----------
        drive : str
            Name of the drive, as for ``--drive``.
        **options : Any
            Of :class:`beltcomm.api.Options`: ``yes``, ``dry_run``, ``feedforward``, ``targets`` and the others.

        Returns
        -------
        Result
            Tracking error, measured and predicted.
        """
        result: Result = _api().verify(drive, self.path, options=_options_of(options), talk=self._talk)
        return result

    def report(self, out: Place | None = None) -> Result:
        """Write the page on the run; see :func:`beltcomm.api.report`.

        Parameters
        ----------
        out : Place or None
            Of the page, a name that ends in ``.html``; None for ``report.html`` in the run.  The numbers stand beside it in JSON.

        Returns
        -------
        Result
            Path and numbers of the page.

        Raises
        ------
        UsageError
            The place holds something that is no page.
        """
        result: Result = _api().report(self.path, out=out)
        return result

    def _lines(self) -> list[str]:
        """Contents for people."""
        folder = self._folder
        axis = folder.axis.name if folder.has_axis else "no axis.yaml"
        parts = {"records": folder.finished_names(), "models": folder.names("models"), "designs": folder.names("designs")}
        being_made = f"; {', '.join(unmade)} not complete" if (unmade := folder.unfinished()) else ""
        lines: list[str] = [f"Run {folder.path}, axis {axis}{being_made}"]
        with suppress(BeltcommError):  # a damaged result hides nothing else
            lines.append(self.headline.text)
        return lines + table(["has", "names"], [[kind, ", ".join(names) or "none"] for kind, names in parts.items()])


def _api() -> Any:
    """The functions of the commands; they take two seconds to import, which nobody waits for who only looks."""
    from beltcomm import api

    return api


def _options_of(given: dict[str, Any]) -> Options:
    """The options by name; raises UsageError for one that there is not."""
    from beltcomm.api import Options

    return Options(**given)


def _copy_run(folder: RunFolder, to: Path) -> Path:
    """Copy a run, whole or not at all; raises UsageError where the new folder exists or cannot be, or a session is at work in the run."""
    run = folder.path
    if to.exists() or to.is_symlink():
        raise UsageError(f"{to} exists; give another name for the copy of {run}")
    if to.resolve().is_relative_to(run.resolve()):
        raise UsageError(f"{to} is inside {run}; a run cannot hold a copy of itself, give a folder beside it")
    draft = to.with_name(f".{to.name}.part")
    with occupied(run, Silence(), refusal=lambda holder: at_work(run, holder)):
        try:
            to.parent.mkdir(parents=True, exist_ok=True)
            shutil.copytree(run, draft, symlinks=True, ignore=shutil.ignore_patterns(NAME))
            draft.rename(to)
        except (OSError, shutil.Error) as error:
            shutil.rmtree(draft, ignore_errors=True)
            words = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            raise UsageError(f"{to} cannot be written: {words}; choose another place") from error
    return to
