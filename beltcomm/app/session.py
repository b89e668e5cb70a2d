"""A virtual session that the page starts: a commissioning or a record on a simulated drive, in a process and a run of its own.

Nothing on a page moves a machine: what is typed here is the command line, its drive is named here and must be a virtual one.
"""

from __future__ import annotations

import shlex
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from subprocess import Popen, TimeoutExpired
from typing import Any

from beltcomm import isolation, posix
from beltcomm.borders import for_file_name, for_terminal
from beltcomm.drive import simulated
from beltcomm.errors import BeltcommError, UsageError
from beltcomm.rundata.headline import drive_of
from beltcomm.rundata.revisions import CURRENT
from beltcomm.runfolder import RunFolder

#: What may be started -> its words, and the command.
KINDS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "commission": ("a whole commissioning", ("commission",)),
    "quick": ("a quick commissioning", ("commission", "--quick")),
    "identify": ("frequency responses at one place", ("identify",)),
}
#: Options of a run's virtual drive that are taken over; nothing else that its folder says reaches a command line.
TAKEN = ("as", "profile")
#: Lines of its output that are kept, and s that it has to stop the axis when the page ends.
KEPT_LINES, STOPPING_S = 60, 10.0


class VirtualSession:
    """The one session of a page.   when : date and time as ISO 8601, for the name of its run.   Ends with :meth:`close`."""

    def __init__(self, when: Callable[[], str] = str) -> None:
        self._when, self._lock = when, threading.Lock()
        self._process: Popen[bytes] | None = None
        self._said: deque[str] = deque(maxlen=KEPT_LINES)
        self._command, self._stopping = "", False
        self.run: Path | None = None

    @property
    def running(self) -> bool:
        """True from its start to the end of its process."""
        return self._process is not None and self._process.poll() is None

    def state(self) -> dict[str, Any]:
        """Run, command, last lines that it said, exit code when it is over.   made : the run is there."""
        return {
            "name": "" if self.run is None else self.run.name,
            "made": self.run is not None and (self.run / "journal.txt").is_file(),
            "running": self.running,
            "stopping": self._stopping and self.running,
            "command": self._command,
            "code": None if self._process is None else self._process.poll(),
            "lines": list(self._said),
        }

    def offers(self, run: Path) -> dict[str, Any]:
        """Commands that can be started with the axis of a run, and on which virtual drives.

        Parameters
        ----------
        run : Path
            Folder of the run.

        Returns
        -------
        dict of str to Any
            ``kinds`` and ``drives``: key to words.
        """
        return {
            "kinds": {key: words for key, (words, _) in KINDS.items()},
            "drives": {key: words for key, (words, _) in _drives(run).items()},
        }

    def start(self, run: Path, asked: Any) -> dict[str, Any]:
        """Start one on the axis of a run, in a new folder beside it.

        Parameters
        ----------
        run : Path
            Folder of the run whose axis.yaml counts.
        asked : Any
            ``kind`` and ``drive`` as offered, ``realtime``: bool.

        Raises
        ------
        UsageError
            While one runs, and for what is not offered.
        """
        if not isinstance(asked, dict) or set(asked) != {"kind", "drive", "realtime"} or not isinstance(asked["realtime"], bool):
            raise UsageError("a session is started by kind, drive and realtime")
        if asked["kind"] not in list(KINDS):
            raise UsageError(f"there is no session {asked['kind']!r}; there are {', '.join(KINDS)}")
        with self._lock:
            if self.running:
                raise UsageError("one virtual session at a time: wait for its end, or stop it")
            drives = _drives(run)
            if asked["drive"] not in list(drives):
                raise UsageError(f"only a virtual drive is started from a page: one of {', '.join(drives)}, not {asked['drive']!r}")
            drive, *options = drives[asked["drive"]][1]
            if not simulated(drive) or drive.partition(":")[0] != "virtual":
                raise UsageError(f"{drive} is no virtual drive; a page moves none but these")
            folder = self._folder(run)
            words = [*KINDS[asked["kind"]][1], "--drive", drive, *options, "--axis", str(run / "axis.yaml"), "--run", str(folder), "--yes"]
            words += ["--realtime"] if asked["realtime"] else []
            self._said.clear()
            self.run, self._stopping, self._command = folder, False, shlex.join(["beltcomm", *words])
            try:
                self._process = isolation.session(isolation.python("beltcomm", *words))
            except OSError as problem:
                raise UsageError(f"no process could be started: {problem.strerror or problem}") from problem
            self._listener = threading.Thread(target=self._hear, args=(self._process,), daemon=True)
            self._listener.start()
        return self.state()

    def stop(self) -> dict[str, Any]:
        """Stop it as Ctrl-C does: the virtual axis comes to rest, what was recorded is kept."""
        with self._lock:
            if self._process is not None and self.running and not self._stopping:
                self._stopping = True
                posix.interrupt(self._process)
        return self.state()

    def close(self) -> None:
        """Stop it, and wait until it has ended."""
        self.stop()
        if self._process is not None and self.running:
            try:
                self._process.wait(STOPPING_S)
            except TimeoutExpired:
                self._process.kill()
                self._process.wait()

    def _folder(self, run: Path) -> Path:
        """A new one beside a run, named as the command line would name it."""
        beside = run.parent if run.name not in ("", "..") else run.resolve().parent
        stamp = self._when()[:19].replace("-", "").replace(":", "").replace("T", "-")
        name = for_file_name(RunFolder.open(run).axis.name.lower(), "axis") + (f"-{stamp}" if stamp else "")
        return next(folder for folder in _numbered(beside, name) if not folder.exists())

    def _hear(self, process: Popen[bytes]) -> None:
        assert process.stdout is not None
        with process.stdout as told:
            for line in told:
                if process is self._process:
                    self._said.append(for_terminal(line.decode("utf-8", "replace").rstrip()))


def _numbered(folder: Path, name: str) -> Iterator[Path]:
    yield folder / name
    number = 2
    while True:
        yield folder / f"{name}-{number}"
        number += 1


def _drives(run: Path) -> dict[str, tuple[str, list[str]]]:
    """Virtual drives for the axis of a run: by key their words, and the drive with its options."""
    folder, found = RunFolder.open(run), {}
    named = drive_of(folder)
    if simulated(named) and named.partition(":")[0] == "virtual":
        found["own"] = (f"{named}, that of this run", [str(named), *_options(getattr(named, "options", ""))])
    with suppress(BeltcommError):
        if CURRENT in folder.names("models"):
            found["model"] = ("a machine that is the model of this run", [f"virtual:{folder.file('models', CURRENT)}"])
    if "own" not in found or str(named) != "virtual":
        found["shipped"] = ("virtual, the axis that is shipped", ["virtual"])
    return found


def _options(words: str) -> list[str]:
    """Those of a virtual drive that are taken over from a folder, which may be a stranger's."""
    try:
        pairs = shlex.split(words)
    except ValueError:
        return []
    return [f"{name}={value}" for name, value in zip(pairs[::2], pairs[1::2], strict=False) if name in [f"--{one}" for one in TAKEN]]
