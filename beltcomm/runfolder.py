"""The run folder: everything about one commissioning of one axis, in plain files.

::

    RUN/
      axis.yaml                what is known beforehand
      run.yaml                 the drive's identity and the tool's version
      recordings/NAME.csv      signals        recordings/NAME.yaml   what was done
      models/NAME.yaml  designs/NAME.yaml  results/NAME.yaml         the tool's own; designs and results with a checksum
      originals/               foreign files as they were, for recordings made by `beltcomm import`
      journal.txt              what the session did, one line each; events.jsonl: what each line means to a program
      bus/NAME.log.gz          frames of the CAN bus (candump -L)
      kept/                    what took long to find and is found again when it is missing

A folder made by hand needs ``axis.yaml`` and ``recordings`` only.  Files are written whole or not at all.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from difflib import get_close_matches
from itertools import count
from pathlib import Path
from typing import Any

from beltcomm import journal
from beltcomm.atomic import is_draft
from beltcomm.axis import Axis, load_axis, save_axis
from beltcomm.axis.terms import PLAIN, Terms, terms_of
from beltcomm.configfiles import did_you_mean, read_yaml, sealed, to_yaml, unsealed, write_text
from beltcomm.contents import check_content
from beltcomm.errors import DataError, NoMotion, UsageError
from beltcomm.given import pasted
from beltcomm.journal import Event
from beltcomm.locks import NAME as LOCK
from beltcomm.locks import at_work, link_refused, occupied
from beltcomm.recording import Recording, RecordingWriter, Sidecar, common_side, load_recording, save_recording
from beltcomm.recording.columns import MOTOR_COLUMNS
from beltcomm.recording.sidecar import load_sidecar
from beltcomm.talk import Talk
from beltcomm.version import __version__

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
#: Letters of a name: file systems take 255 bytes, and ends such as .csv.part stand behind it.
LONGEST_NAME = 100
#: How an unfinished record is called after a second attempt was begun.
_MOVED_ASIDE = re.compile(r"\.unfinished\d+$")
#: Events of a run that was left before anything moved.
_HARMLESS = {"connected", "restored", "rehearsed"}
_KINDS = {"models": "model", "designs": "design", "results": "result"}


def next_free(stem: str, taken: Collection[str], first: int = 1) -> str:
    """First name that is not taken: of what somebody took away, a count would name what stays.

    Parameters
    ----------
    stem : str
        To which a number is added.
    taken : collection of str
        Names that stand.
    first : int
        Number to begin with.

    Returns
    -------
    str
        ``STEM1``, ``STEM2`` and so on.
    """
    return next(name for number in count(first) if (name := f"{stem}{number}") not in taken)


class RunFolder:
    """One run folder.  Make one with :meth:`create`, use an existing one with :meth:`open`.

    Parameters
    ----------
    path : Path
        The folder.
    axis : Axis or None
        As read from its ``axis.yaml``; None when the folder has none.

    Attributes
    ----------
    elapsed_s : float or None, s
        Date and time since the run began on its drive, as far as :meth:`claim_drive` knows it.
    stamp : callable
        What a line of the journal begins with, its time.
    remarks : list of str
        What :meth:`recordings` left out last, and why, as sentences.
    """

    def __init__(self, path: Path, axis: Axis | None) -> None:
        self.path = path
        self._axis = axis
        self.elapsed_s = 0.0
        self.stamp: Callable[[], str] = str
        self.remarks: tuple[str, ...] = ()

    @classmethod
    def create(cls, path: Path, axis: Axis, *, resume: bool = False) -> RunFolder:
        """Make a new run folder, or with ``resume`` open the existing one, when its axis has not changed.

        An empty folder counts as new, and one whose run ended before anything moved.

        Parameters
        ----------
        path : Path
            Of the folder.
        axis : Axis
            Written as ``axis.yaml``.
        resume : bool
            Go on with an existing run.

        Returns
        -------
        RunFolder
            Open for writing.

        Raises
        ------
        UsageError
            When the folder exists and ``resume`` is not asked for, when it does not exist and ``resume`` is, when the axis has changed
            (with the entries), or when it cannot be written.
        """
        if resume:
            return cls._resumed(path, axis)
        if path.exists() and not is_new(path):
            raise UsageError(f"{path} exists; choose another folder, or go on with that run (--resume of commission and identify)")
        for item in _content(path):
            item.unlink()
        run = cls(path, axis)
        _make_folder(path, inside=False)
        run._write_about({})  # first: whoever is killed behind it has left the tool's own folder, which counts as new
        save_axis(axis, path / "axis.yaml")
        _make_folder(run.recordings_folder)
        return run

    @classmethod
    def open(cls, path: Path | str) -> RunFolder:
        """Open an existing folder, the tool's own or one made by hand.

        Parameters
        ----------
        path : Path or str
            Of the folder.

        Returns
        -------
        RunFolder
            Open for reading and writing.

        Raises
        ------
        DataError
            When there is no folder or it holds neither axis nor recordings.
        UsageError
            For a wrong ``axis.yaml``.
        """
        path = Path(path)
        if not path.is_dir():
            what = "is a file, not a folder" if path.exists() else f"does not exist{_like(path)}"
            raise DataError(f"the run folder {path} {what}; give the folder that holds axis.yaml and recordings/")
        _check_links(path)
        axis_path = path / "axis.yaml"
        if not axis_path.is_file() and not (path / "recordings").is_dir():
            raise DataError(f"{path} is no run folder: it has neither axis.yaml nor recordings/; check the path")
        return cls(path, load_axis(axis_path) if axis_path.is_file() else None)

    @classmethod
    def broken_off(cls, path: Path) -> bool:
        """True if a run stands here whose first record was begun and never finished.

        Parameters
        ----------
        path : Path
            Of the folder.

        Returns
        -------
        bool
            False for any other run, and for no run.
        """
        return path.is_dir() and any(path.glob("recordings/*.csv.part")) and not any(path.glob("recordings/*.csv"))

    @classmethod
    def _resumed(cls, path: Path, axis: Axis) -> RunFolder:
        if not path.is_dir():
            raise UsageError(f"--resume: the run folder {path} does not exist{_like(path)}; check --run or leave --resume out")
        if not (path / "axis.yaml").is_file() and is_new(path):  # killed, or without room, before it had one
            return cls.create(path, axis)
        run = cls.open(path)
        begun_with = run._about().get("axis_fingerprint", run.axis.fingerprint())
        if not axis.fingerprint() == run.axis.fingerprint() == begun_with:
            changes = "; ".join(run.axis.changes(axis)[:3]) or "its axis.yaml was edited"
            raise UsageError(f"--resume: the axis has changed since {path} was begun ({changes}); begin a new run")
        _make_folder(run.recordings_folder)
        return run

    @property
    def axis(self) -> Axis:
        """The axis.

        Raises
        ------
        DataError
            When the folder has no ``axis.yaml``.
        """
        if self._axis is None:
            raise DataError(
                f"{self.path / 'axis.yaml'} is missing; copy the axis file there or write one with "
                f"`beltcomm init {pasted(self.path / 'axis.yaml')}`"
            )
        return self._axis

    @property
    def has_axis(self) -> bool:
        """True if it has an ``axis.yaml``."""
        return self._axis is not None

    @property
    def terms(self) -> Terms:
        """Words and units of its axis; those of a belt axis where it has none."""
        return PLAIN if self._axis is None else terms_of(self._axis)

    @property
    def recordings_folder(self) -> Path:
        """Folder of the recordings."""
        return self.path / "recordings"

    @property
    def drive(self) -> Mapping[str, str]:
        """Identity of the drive that the run was made on; empty when there was none."""
        return dict(self._about().get("drive") or {})

    @property
    def made_by(self) -> str:
        """Version of the tool that began the run; "" where nobody knows it."""
        return str(self._about().get("beltcomm") or "")

    @property
    def began_s(self) -> float | None:
        """Date and time at which the run began on its drive, s since 1970; None where nobody knows it."""
        return self._about().get("began_s")

    def claim_drive(self, identity: Mapping[str, str], wall_s: float | None = None) -> None:
        """Note which drive this run is made on, and when; on a later call, that it still is, and how much later.

        Parameters
        ----------
        identity : dict of str to str
            :attr:`beltcomm.drive.Capabilities.identity`; what was not told, then or now, is not compared.
        wall_s : float or None
            Date and time now, s; None where nobody knows it, or where the drive begins anew with every session.

        Raises
        ------
        UsageError
            When the run was made on another drive, with what differs.
        """
        about = self._about()
        known, began_s = about.get("drive") or {}, about.get("began_s")
        if wall_s is not None and began_s is not None:
            self.elapsed_s = max(wall_s - float(began_s), 0.0)  # a clock that was set back tells nothing
        if not known:
            self._write_about(identity, wall_s)
            return
        changed = [
            f"{key} {known[key]} -> {identity[key]}"
            for key in sorted({*known} & {*identity})
            if known[key] and identity[key] and known[key] != identity[key]
        ]
        if changed:
            raise UsageError(f"{self.path} was made on another drive ({'; '.join(changed)}); begin a new run")

    def finished(self, name: str) -> Path | None:
        """Path of a complete recording: what ``--resume`` need not repeat.

        Parameters
        ----------
        name : str
            Of the recording.

        Returns
        -------
        Path or None
            None when there is none of that name.
        """
        return self.recordings_folder / f"{name}.csv" if name in self.finished_names() else None

    def finished_names(self) -> list[str]:
        """Names of the recordings that are complete, sorted.

        Raises
        ------
        DataError
            When a sidecar stands without its recording.
        """
        broken_off = {path.name.removesuffix(".csv.part") for path in self.recordings_folder.glob("*.csv.part")}
        for note in sorted(self.recordings_folder.glob("*.yaml")):
            # One that says that it is unfinished was left alone where the folder could not be written any more: no row is lost.
            if not note.with_suffix(".csv").is_file() and note.stem not in broken_off and load_sidecar(note)[0].finished:
                raise DataError(f"{note} describes a recording, but {note.stem}.csv is missing; bring it back or delete the sidecar")
        return sorted(path.stem for path in self.recordings_folder.glob("*.csv"))

    def unfinished(self) -> list[str]:
        """Names of the recordings still to be made, sorted; the rows that they had stand in ``NAME.csv.part``."""
        parts = (path.name.removesuffix(".csv.part") for path in self.recordings_folder.glob("*.csv.part"))
        return sorted(name for name in parts if not _MOVED_ASIDE.search(name))

    def recordings(self, experiment: str | None = None) -> list[Recording]:
        """Load the complete recordings, checked, sorted by name.

        One in which the axis did not move is left out beside others (``remarks``).

        Parameters
        ----------
        experiment : str or None
            Kind of experiment; None for all.

        Returns
        -------
        list of Recording
            At least one.

        Raises
        ------
        DataError
            When there is none, one of them cannot be used (with file, column and row), or they are of two axes.
        """
        if not self.recordings_folder.is_dir():
            raise DataError(f"{self.recordings_folder} is missing; record with `beltcomm identify`, or put CSV files there")
        names = self.finished_names()
        self._check_sidecars(names)
        loaded = self._moved(names)
        chosen = [item for item in loaded if experiment in (None, item.sidecar.experiment)]
        if not chosen:
            kind = f" of the kind {experiment}" if experiment else ""
            rest = f"; broken off were {', '.join(self.unfinished())}: finish them with --resume" if self.unfinished() else ""
            raise DataError(f"{self.recordings_folder} holds no complete recording{kind}{rest}")
        try:
            common_side(loaded)
        except DataError as error:
            raise DataError(f"{self.recordings_folder}: {error}") from error
        return chosen

    def _moved(self, names: Sequence[str]) -> list[Recording]:
        """The recordings of these names without those in which nothing moved, where others did."""
        loaded: list[Recording] = []
        still: list[NoMotion] = []
        for name in names:
            try:
                loaded.append(self.recording(name))
            except NoMotion as problem:
                still.append(problem)
        if still and all(recording.is_static_map for recording in loaded):
            raise still[0]
        self.remarks = tuple(f"left out: {problem}" for problem in still)
        return loaded

    def _check_sidecars(self, names: list[str]) -> None:
        """Raise DataError when a recording that a drive made has lost its sidecar; those made by hand may have none."""
        for name in names if self.drive else []:
            sidecar = self.recordings_folder / f"{name}.yaml"
            if not sidecar.is_file():
                raise DataError(
                    f"{sidecar} is missing: without it nobody knows what {name}.csv shows; bring it back, or take {name}.csv out of the "
                    "folder and record it again with --resume"
                )

    def recording(self, name: str) -> Recording:
        """Load one recording, checked against the axis.

        Parameters
        ----------
        name : str
            Of the recording.

        Returns
        -------
        Recording
            Checked, in SI units.

        Raises
        ------
        DataError
            When it is missing or cannot be used.
        """
        path = self.recordings_folder / f"{name}.csv"
        if not path.is_file():
            if path.with_name(f"{name}.csv.part").is_file():
                raise DataError(f"the recording {name} in {self.path} was broken off; finish it with --resume")
            names = self.finished_names()
            raise DataError(f"{path} does not exist{did_you_mean(name, names)}; there are {', '.join(names) or 'no recordings'}")
        return load_recording(path, self._axis)

    def new_recording(self, name: str, sidecar: Sidecar, columns: tuple[str, ...] = MOTOR_COLUMNS) -> RecordingWriter:
        """Begin a new recording; an earlier unfinished one of that name is moved aside.

        Parameters
        ----------
        name : str
            Of the recording.
        sidecar : Sidecar
            What is being done.
        columns : tuple of str
            Names of a row's values, with the unit as suffix.

        Returns
        -------
        RecordingWriter
            Takes the rows; close it.

        Raises
        ------
        DataError
            When a complete one exists.
        UsageError
            For a name that is no file name.
        """
        _make_folder(self.recordings_folder)
        return RecordingWriter(self.recordings_folder / f"{checked_name(name)}.csv", sidecar, columns)

    def withdraw(self, name: str) -> None:
        """Take back a recording that turned out to be unusable.

        It becomes ``NAME.csv.part``, to be made again; nothing is deleted.

        Parameters
        ----------
        name : str
            Of the recording.
        """
        path = self.recordings_folder / f"{checked_name(name)}.csv"
        os.replace(path, path.with_name(f"{name}.csv.part"))

    def set_aside(self, kind: str, name: str, other: str) -> None:
        """Give a file another name, whatever is in it.

        Parameters
        ----------
        kind : str
            "models", "designs" or "results".
        name, other : str
            Without suffix; nothing is called as the other.
        """
        os.replace(self.file(kind, name), self.path / kind / f"{checked_name(other)}.yaml")

    def add_recording(self, recording: Recording) -> Path:
        """Write a recording made elsewhere (simulated, imported).

        Parameters
        ----------
        recording : Recording
            To be written.

        Returns
        -------
        Path
            Path of its rows.

        Raises
        ------
        DataError
            When a complete one of that name exists.
        UsageError
            For a name that is no file name.
        """
        _make_folder(self.recordings_folder)
        checked_name(recording.name)
        return save_recording(recording, self.recordings_folder)

    def save(self, kind: str, name: str, mapping: Mapping[str, Any]) -> Path:
        """Write ``KIND/NAME.yaml``.

        Parameters
        ----------
        kind : str
            "models", "designs" or "results".
        name : str
            Without suffix.
        mapping : dict of str to Any
            Numbers, words, lists and mappings.

        Returns
        -------
        Path
            Path of the file.

        Raises
        ------
        UsageError
            When it cannot be written.
        """
        _make_folder(self.path / kind)
        path = self.path / kind / f"{checked_name(name)}.yaml"
        write_text(path, to_yaml(mapping if kind == "models" else sealed(mapping)))  # a model is a file that people write, too
        return path

    def names(self, kind: str) -> list[str]:
        """Names of the files of a kind.

        Parameters
        ----------
        kind : str
            "models", "designs" or "results".

        Returns
        -------
        list of str
            In the order they were written.
        """
        files = (self.path / kind).glob("*.yaml")
        return [path.stem for path in sorted(files, key=lambda path: (path.stat().st_mtime_ns, path.stem))]

    def file(self, kind: str, name: str) -> Path:
        """Path of ``KIND/NAME.yaml``.

        Parameters
        ----------
        kind : str
            "models", "designs" or "results".
        name : str
            Without suffix.

        Returns
        -------
        Path
            It exists.

        Raises
        ------
        DataError
            When it is missing, naming what makes it.
        """
        path = self.path / kind / f"{checked_name(name)}.yaml"
        if not path.is_file():
            maker = {"models": "fit", "designs": "design"}.get(kind)
            remedy = f"make it with `beltcomm {maker} {self.path}`" if maker else "run the command that makes it first"
            raise DataError(f"the {_KINDS[kind]} {name} is not in {self.path}{did_you_mean(name, self.names(kind))}; {remedy}")
        return path

    def load(self, kind: str, name: str) -> dict[str, Any]:
        """The mapping in ``KIND/NAME.yaml``.

        Parameters
        ----------
        kind : str
            "models", "designs" or "results".
        name : str
            Without suffix.

        Returns
        -------
        dict of str to Any
            As it stands in the file.

        Raises
        ------
        DataError
            When it is missing, unreadable or empty.
        """
        content = self._unsealed(kind, name)[0]
        check_content(name if kind == "results" else kind, content, self.file(kind, name))
        return content

    def edited(self, kind: str, name: str) -> bool:
        """True if ``KIND/NAME.yaml`` was edited since this tool wrote it.

        Parameters
        ----------
        kind : str
            "models", "designs" or "results".
        name : str
            Without suffix.

        Returns
        -------
        bool
            False for a file as this tool wrote it.

        Raises
        ------
        DataError
            As :meth:`load`.
        """
        return not self._unsealed(kind, name)[1]

    def edited_files(self) -> list[Path]:
        """Designs and results that are not as this tool wrote them.

        Returns
        -------
        list of Path
            Unreadable ones, too.
        """
        kept = [(kind, name) for kind in ("designs", "results") for name in self.names(kind)]
        return [self.path / kind / f"{name}.yaml" for kind, name in kept if self._doubtful(kind, name)]

    def _doubtful(self, kind: str, name: str) -> bool:
        try:
            return self.edited(kind, name)
        except DataError:
            return True

    def _unsealed(self, kind: str, name: str) -> tuple[dict[str, Any], bool]:
        path = self.file(kind, name)
        if not path.stat().st_size:  # nothing here is ever written empty: a full disk or a copy broken off
            raise DataError(f"{path} is empty; bring it back, or delete it and make it again")
        return unsealed(read_yaml(path, DataError))

    def load_result(self, name: str) -> dict[str, Any] | None:
        """The mapping in ``results/NAME.yaml``.

        Parameters
        ----------
        name : str
            Without suffix.

        Returns
        -------
        dict of str to Any or None
            None when there is none.

        Raises
        ------
        DataError
            When it is unreadable.
        """
        return self.load("results", name) if (self.path / "results" / f"{checked_name(name)}.yaml").is_file() else None

    def occupy(self, talk: Talk) -> ExitStack:
        """Keep other commands out of this folder.

        Parameters
        ----------
        talk : Talk
            Hears when somebody else has to be waited for.

        Returns
        -------
        ExitStack
            Closing it lets others in.

        Raises
        ------
        UsageError
            When one is in it already.
        """
        with ExitStack() as held:
            held.enter_context(
                occupied(
                    self.path,
                    talk,
                    refusal=lambda holder: at_work(self.path, holder),
                    session=True,
                    unwritable="choose another --run folder",
                )
            )
            return held.pop_all()

    def journal(self, line: str, event: Event = "note") -> None:
        """Append one line to the session's journal.

        Parameters
        ----------
        line : str
            One line of text.
        event : Event
            What it means to a program.

        Raises
        ------
        UsageError
            When it cannot be written.
        """
        journal.append(self.path, self.terms.said(line), event, self.stamp())

    def _about(self) -> dict[str, Any]:
        path = self.path / "run.yaml"
        about = read_yaml(path, DataError) if path.is_file() else {}
        check_content(path.name, about, path)
        return about

    def _write_about(self, drive: Mapping[str, str], began_s: float | None = None) -> None:
        about = {"beltcomm": __version__, "axis_fingerprint": self.axis.fingerprint(), "drive": dict(drive)}
        write_text(self.path / "run.yaml", to_yaml(about if began_s is None else {**about, "began_s": began_s}))


def is_new(path: Path) -> bool:
    """True if nothing is lost when a run begins in a folder.

    Parameters
    ----------
    path : Path
        Need not exist.

    Returns
    -------
    bool
        True for an empty one, or where the run in it ended before anything was recorded or written to a drive, as after a no.
    """
    if not path.is_dir():
        return not path.exists()
    results = [path / "results" / f"{name}.yaml" for name in ("backup", "drive", "rehearsal")]
    own = {path / "axis.yaml", path / "run.yaml", path / journal.TEXT, path / journal.EVENTS, path / "bundle.zip", *results}
    found = _content(path)
    if not found:
        return not any(item.is_dir() for item in path.iterdir())
    events = journal.events_of(path)
    return found <= own and path / "run.yaml" in found and set(events) <= _HARMLESS and len(events) == len(journal.lines_of(path))


def _check_links(path: Path) -> None:
    """Raise DataError for a folder of a run that is a link to elsewhere: a stranger's run could read and write any place through it."""
    home = os.path.realpath(path)
    try:
        inside = list(path.iterdir())
    except OSError as error:
        raise DataError(f"the run folder {path} cannot be read: {error.strerror or error}; look at its permissions") from error
    for item in inside:
        if item.is_symlink() and not Path(named := os.path.realpath(item)).is_relative_to(home):  # a circle of links leads nowhere
            raise DataError(f"{item} is a link out of the run folder, to {named}; copy what it names into the run, or take it out")


def _content(path: Path) -> set[Path]:
    """The files of a run, but what was said on the bus, its lock and what is on its way."""
    found = (item for item in path.rglob("*") if not item.is_dir() and item.parent.name != "bus")
    return {item for item in found if item.name != LOCK and not is_draft(item.name)}


def _make_folder(path: Path, *, inside: bool = True) -> None:
    """Make a folder; ``inside`` a run nothing is written through links."""
    if inside and path.is_symlink():
        raise link_refused(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"the folder {path} cannot be made: {error.strerror or error}; choose another --run folder") from error


def checked_name(name: str) -> str:
    """The name, when it can be a file name everywhere.

    Parameters
    ----------
    name : str
        Of a record, model, design or result.

    Raises
    ------
    UsageError
    """
    if not _NAME.fullmatch(name) or len(name) > LONGEST_NAME:
        shown = name if len(name) <= LONGEST_NAME else f"{name[:LONGEST_NAME]}..."
        raise UsageError(f"{shown!r} cannot be a name; use up to {LONGEST_NAME} letters, digits, '_', '-' and '.', a letter or digit first")
    return name


def _like(path: Path) -> str:
    """The words ``, did you mean X?`` for the run beside it, or under ``runs``, whose name resembles a path's most."""
    known = {near.name: near for folder in (Path("runs"), path.parent) for near in _folders(folder)}
    close = get_close_matches(path.name, known, n=1)
    return f", did you mean {known[close[0]]}?" if close else ""


def _folders(path: Path) -> list[Path]:
    try:
        return sorted(item for item in path.iterdir() if (item / "recordings").is_dir())
    except OSError:
        return []
