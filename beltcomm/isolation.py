"""Nothing of the working directory is code or configuration: here alone processes are started, and libraries loaded that look there.

A stranger's folder may hold a ``numpy.py``, a ``matplotlibrc`` or a program called ``ip``.  What this user has put into the environment
(``PATH``, ``PYTHONPATH``) holds, as far as it names a place and not "wherever I stand".
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess

_PACKAGES = str(Path(__file__).resolve().parents[1])
#: What a child is given before its module: the places of this process, not those that Python would find for it.
_BEGIN = (
    "import json, runpy, sys; sys.path[:] = json.loads(sys.argv.pop(1)); "
    "runpy.run_module(sys.argv.pop(1), run_name='__main__', alter_sys=True)"
)
_LISTS = ("PATH", "PYTHONPATH")


def start(command: Sequence[str], stdout: int = subprocess.DEVNULL, **variables: str) -> subprocess.Popen[bytes]:
    """A process beside this one that reads nothing.

    Parameters
    ----------
    command : sequence of str
        Program and words.
    stdout : int
        ``subprocess.PIPE`` for one that writes what it finds into a pipe; else it says nothing.
    **variables : str
        Of its environment.

    Raises
    ------
    OSError
        When it cannot be started.
    """
    quiet = subprocess.DEVNULL
    return subprocess.Popen(command, stdin=quiet, stdout=stdout, stderr=quiet, env={**_environment(), **variables})


def session(command: Sequence[str]) -> subprocess.Popen[bytes]:
    """A process whose words come through one pipe as they are said; a Ctrl-C here does not reach it.

    Parameters
    ----------
    command : sequence of str
        Program and words.

    Raises
    ------
    OSError
        When it cannot be started.
    """
    return subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**_environment(), "PYTHONUNBUFFERED": "1"},
        start_new_session=True,
    )


def run(command: Sequence[str], limit_s: float) -> subprocess.CompletedProcess[bytes]:
    """A process and what it says.

    Parameters
    ----------
    command : sequence of str
        Program and words.
    limit_s : float, s
        In which it ends.

    Returns
    -------
    CompletedProcess of bytes
        With its exit code, whatever that is.

    Raises
    ------
    OSError
        When it cannot be started.
    subprocess.TimeoutExpired
        When it does not end in time.
    """
    quiet = subprocess.DEVNULL
    return subprocess.run(command, stdin=quiet, capture_output=True, timeout=limit_s, env=_environment(), check=False)


def beside(target: Callable[..., None], *given: object) -> tuple[BaseProcess, Connection]:
    """A process of this program that runs ``target(*given, pipe)``, and the other end of the pipe; it ends with this one.

    Parameters
    ----------
    target : callable
        Importable by its name; gets the pipe last.
    *given : object
        Values that can be pickled.
    """
    import multiprocessing

    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=target, args=(*given, there), daemon=True)
    with children_apart():
        process.start()
    there.close()
    return process, here


def python(module: str, *words: str) -> list[str]:
    """The command that runs a module of this program in a process of its own, with the packages that are found here.

    Parameters
    ----------
    module : str
        Full name.
    *words : str
        Of its command line.
    """
    return [sys.executable, "-P", "-c", _BEGIN, json.dumps(_search_path()), module, *words]


def _environment() -> dict[str, str]:
    """That of every child: Python adds no working directory to where it looks, and nobody else looks there for programs."""
    lists = {name: os.pathsep.join(filter(os.path.isabs, os.environ[name].split(os.pathsep))) for name in _LISTS if name in os.environ}
    return {**os.environ, **lists, "PYTHONSAFEPATH": "1"}


@contextmanager
def children_apart() -> Iterator[None]:
    """Isolate processes that a library starts meanwhile."""
    before = {name: os.environ.get(name) for name in (*_LISTS, "PYTHONSAFEPATH")}
    os.environ.update(_environment())
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


@contextmanager
def apart(folder: Path, *without: str) -> Iterator[None]:
    """Be in a folder of an installed package meanwhile: for the import of a library that reads settings from the working directory.

    Parameters
    ----------
    folder : Path
        Of the package.
    without : str
        Variables of the environment that are not there meanwhile.
    """
    with _without(without), _inside(folder):
        yield


@contextmanager
def _without(names: Sequence[str]) -> Iterator[None]:
    before = {name: os.environ.pop(name) for name in names if name in os.environ}
    try:
        yield
    finally:
        os.environ.update(before)


@contextmanager
def _inside(folder: Path) -> Iterator[None]:
    with ExitStack() as back:
        try:
            if hasattr(os, "fchdir"):
                here = os.open(".", getattr(os, "O_PATH", os.O_RDONLY))
                back.callback(os.close, here)
                back.callback(os.fchdir, here)
            else:
                back.callback(os.chdir, os.getcwd())
        except OSError:  # no way back, which is also the case in a folder that is no more
            yield
            return
        os.chdir(folder)
        yield


def _search_path() -> list[str]:
    """Path on which this process finds packages, without the working directory, unless this package stands there."""
    try:
        here = os.getcwd()
    except OSError:
        here = ""
    return [entry for entry in sys.path if os.path.isabs(entry) and (entry != here or entry == _PACKAGES)]
