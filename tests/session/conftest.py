"""One complete commissioning of rig g_a, shared by all tests here, and a fresh virtual drive for each test."""

from __future__ import annotations

import contextlib
import hashlib
import pickle
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from functools import wraps
from io import BytesIO
from pathlib import Path
from typing import Any, ClassVar

import pytest
from filelock import FileLock

from beltcomm import api
from beltcomm.axis import Axis
from beltcomm.experiments import commission as sequence
from beltcomm.experiments import phases, raising, sameness
from beltcomm.identify import final
from beltcomm.identify.final import FinalModel, final_model
from beltcomm.machine import stops
from beltcomm.recording import Recording
from beltcomm.rundata import analyse, offline
from beltcomm.runfolder import RunFolder
from session.bench import Bench, Listener

SEED = 1
#: Long calculations whose result depends on their arguments alone.
PURE = (
    (raising, "first_path"),
    (phases, "largest_amplitude"),
    (raising, "largest_amplitude"),
    (sameness, "largest_amplitude"),
    (analyse, "design_cascade"),
    (analyse, "cautious_cascade"),
    (analyse, "feasible_cascade"),
    (stops, "braked_by_loop"),
)


@dataclass
class Complete:
    """A finished commissioning, by the public function.   final : its final fit, for tests in which the fit does not matter."""

    bench: Bench
    path: Path
    result: api.Result
    talk: Listener
    final: FinalModel

    @property
    def folder(self) -> RunFolder:
        return RunFolder.open(self.path)


@pytest.fixture(scope="session")
def complete(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Complete]:
    bench, talk = Bench("g_a"), Listener()
    path = tmp_path_factory.mktemp("complete") / "run"
    fits: list[FinalModel] = []

    fit_once = remembering(final_model)

    def fit(*args: Any, **kwargs: Any) -> FinalModel:
        fits.append(fit_once(*args, **kwargs))
        return fits[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(api, "open_drive", bench.open)
        for module in (sequence, final):  # where a commissioning calls it, and where it is begun once more elsewhere
            patch.setattr(module, "final_model", fit)
        remember_pure(patch)
        result = api.commission(bench.name, "egc-70-600", path, options=api.Options(yes=True, seed=SEED), talk=talk)
    yield Complete(bench, path, result, talk, fits[-1])
    bench.close()


@pytest.fixture
def copy_of_complete(complete: Complete, tmp_path: Path) -> Callable[..., Path]:
    """A copy of the complete run, without the recordings named; ``frf*`` names all that begin so."""

    def copy(*without: str, name: str = "copy") -> Path:
        path = tmp_path / name
        shutil.copytree(complete.path, path)
        for recording in without:
            found = [file for suffix in (".csv", ".yaml") for file in (path / "recordings").glob(f"{recording}{suffix}")]
            assert found, recording
            for file in found:
                file.unlink()
        return path

    return copy


@pytest.fixture
def fitted(complete: Complete, monkeypatch: pytest.MonkeyPatch) -> None:
    """A calculation that these tests do not look at: the final fit is that of the complete run."""
    for module in (sequence, offline, final):
        monkeypatch.setattr(module, "final_model", lambda *_args, **_kwargs: complete.final)


@pytest.fixture(autouse=True)
def remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing in ``PURE`` is computed twice with the same arguments, by whichever test."""
    remember_pure(monkeypatch)


def remember_pure(patch: pytest.MonkeyPatch) -> None:
    """The same, as long as the patch lasts."""
    for place, name in PURE:
        patch.setattr(place, name, remembering(getattr(place, name)))


class Key(pickle.Pickler):
    """Arguments without the names of the files that they came from, which are for messages only."""

    NAMES: ClassVar[dict[type, str]] = {Recording: "file", Axis: "source"}

    def reducer_override(self, item: Any) -> Any:
        if type(item) not in self.NAMES:
            return NotImplemented
        name = self.NAMES[type(item)]
        return dict, ({field.name: getattr(item, field.name) for field in fields(item) if field.name != name},)

    @classmethod
    def of(cls, *arguments: Any) -> bytes:
        file = BytesIO()
        pickler = cls(file)
        pickler.fast = True  # equal values have equal bytes, whether or not an object stands in two places
        pickler.dump(arguments)
        return file.getvalue()


_known: dict[bytes, Any] = {}


@pytest.fixture(scope="session", autouse=True)
def remembered_by_all(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Iterator[None]:
    """What one worker has computed is there for the others of this run."""
    base = tmp_path_factory.getbasetemp()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Shared, "folder", (base if worker_id == "master" else base.parent) / "remembered")
        yield


class Shared:
    """Values of pure functions on the disk, computed by whichever process asks first; the others wait for it."""

    folder: ClassVar[Path | None] = None

    @classmethod
    def value(cls, key: bytes, compute: Callable[[], Any]) -> Any:
        if cls.folder is None:
            return compute()
        cls.folder.mkdir(exist_ok=True)
        file = cls.folder / hashlib.sha256(key).hexdigest()
        with FileLock(f"{file}.lock"):
            if file.exists():
                return pickle.loads(file.read_bytes())
            value = compute()
            with contextlib.suppress(pickle.PicklingError, AttributeError, TypeError):
                file.write_bytes(pickle.dumps(value))
            return value


def remembering(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same pure function, which computes nothing twice; arguments that have no bytes, as a test's stand-ins, are not remembered."""

    @wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        try:
            key = Key.of(function.__qualname__, args, kwargs)
        except (pickle.PicklingError, AttributeError, TypeError, ValueError):
            return function(*args, **kwargs)
        if key not in _known:
            _known[key] = Shared.value(key, lambda: function(*args, **kwargs))
        return _known[key]

    return call


@pytest.fixture
def connect(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[Bench], Bench]]:
    """The commands find this bench's drive in place of their own; it is switched off after the test."""
    connected: list[Bench] = []

    def on(bench: Bench) -> Bench:
        connected.append(bench)
        monkeypatch.setattr(api, "open_drive", bench.open)
        return bench

    yield on
    for bench in connected:
        bench.close()


@pytest.fixture
def make_bench(connect: Callable[[Bench], Bench]) -> Callable[..., Bench]:
    """Makes the virtual drive that the commands will find."""
    return lambda *args, **options: connect(Bench(*args, **options))
