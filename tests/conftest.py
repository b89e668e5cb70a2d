"""Options for running the contract tests on a real drive, and which tests go to one worker.

``pytest tests/contract --drive can0 --drive-window-rad -20 20 --drive-speed-rad-s 60 --drive-torque-nm 0.2`` moves the machine:
the carriage must be free to travel the whole window, in the drive's own zero.
"""

from __future__ import annotations

import compileall
import gc
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from beltcomm import language

# As the console command, and before numpy is loaded: two workers whose matrices wait for two threads each take several times as long.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@pytest.fixture(autouse=True)
def english_after() -> Iterator[None]:
    """A command sets the language of its environment for the whole process."""
    yield
    language.use("en")


def pytest_configure(config: pytest.Config) -> None:
    """Ctrl-C counts, also in a run that a shell has put into the background: its processes are born deaf to it.

    Python that may keep no bytecode would compile the package anew in each of the hundreds of processes that tests start: it is made once,
    where that of installed packages stands, too.
    """
    if sys.dont_write_bytecode and not hasattr(config, "workerinput"):
        for package in ("beltcomm", "adapters"):
            compileall.compile_dir(Path(__file__).parents[1] / package, quiet=2)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_finish() -> None:
    """Thousands of tests that stay are not looked through again each time something is compiled, which makes much and drops little."""
    gc.freeze()
    gc.set_threshold(20_000, 10, 10)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--regenerate", action="store_true", help="write the golden files (tests/golden) anew")
    group = parser.getgroup("drive", "contract tests on a real drive (they move it)")
    group.addoption("--drive", metavar="NAME", help="a drive beside the virtual one: can0, slcan:/dev/ttyACM0")
    group.addoption("--drive-option", metavar="KEY=VALUE", action="append", default=[], help="option of the adapter, e.g. node=1")
    group.addoption("--drive-window-rad", nargs=2, type=float, metavar=("MIN", "MAX"), help="free travel, motor shaft, rad")
    group.addoption("--drive-speed-rad-s", type=float, help="largest speed, motor shaft, rad/s")
    group.addoption("--drive-torque-nm", type=float, help="largest torque, motor shaft, N m")


#: Of tests/session: as one it would end last, by minutes.
HALVES = ("tests/session to j", "tests/session from k")
#: The longest, begun first, so that no worker waits for another at the end.  On a fresh clone the first fills the cache of compiled
#: code with what most tests need, while the second compiles for a home of its own: nothing is compiled twice.
FIRST = (
    *HALVES,
    "tests/test_packaging.py",
    "tests/session/test_machines.py",
    "tests/laboratory/test_hidden_effect.py",
    "tests/laboratory/test_draws.py",
    "tests/laboratory/test_demo.py",
    "tests/fit/test_model_fit.py",
    "tests/study/test_commissioned.py",
    "tests/study/test_workers.py",
    "tests/simulate/test_round_trip.py",
    "tests/test_energy.py",
    "tests/wire/test_processes.py",
)


def work_unit(nodeid: str) -> str:
    """What one worker takes: a whole file, and half of tests/session, whose tests share one commissioning."""
    file = nodeid.partition("::")[0]
    if not file.startswith("tests/session/") or file.endswith("test_machines.py"):
        return file
    return HALVES[file > "tests/session/test_k"]


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if hasattr(config, "workerinput"):
        places = {unit: place for place, unit in enumerate(FIRST)}
        items.sort(key=lambda item: places.get(work_unit(item.nodeid), len(FIRST)))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """One process for a real drive, whose tests take turns, and for what one worker would take; else one more than there are cores.

    Many tests wait, for another process, a disk or a real clock: two workers on two cores leave a fifth of them idle.
    """
    units = {work_unit(argument) for argument in config.args}
    alone = len(units) == 1 and "".join(units).endswith(".py")
    return 0 if config.getoption("--drive") or alone else len(os.sched_getaffinity(0)) + 1


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> object:
    """Workers (``-n 2``) take whole work units: no fixture is built twice."""
    from xdist.scheduler import LoadScopeScheduling

    class ByFixture(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return work_unit(nodeid)

    config.option.loadscopereorder = False  # the order is that of the collection, not that of the number of tests
    return ByFixture(config, log)
