"""The cache of machine code: in places set here, each file held against its own hash, thrown away and made again where it is damaged.

numba takes what stands in its cache as it is: one empty file, as a power cut leaves it, ends every command that needs the kernel, and a
byte that has turned over is executed.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
import tempfile
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

from platformdirs import user_cache_path

from beltcomm import atomic, isolation
from beltcomm.caches import tell

os.environ.pop("NUMBA_NUM_THREADS", None)  # none are used, and a number that cannot be ends every command
with isolation.apart(Path(__file__).parent):
    import numba
    from numba.core import caching, config

config._config_fname = os.devnull  # numba looks for its settings again before each compilation

#: How a file begins that this module has written; behind it the SHA-256 of the rest.
_MAGIC = b"beltcomm machine code 2\n"
_DIGEST = hashlib.sha256().digest_size


def kept(dispatcher: Any) -> None:
    """Have the machine code of a compiled function kept, where there is a place for it.

    Parameters
    ----------
    dispatcher : Any
        Of numba.
    """
    with contextlib.suppress(RuntimeError):  # in memory then, as long as the process lives
        dispatcher._cache = _Cache(dispatcher.py_func)


def _user_folder() -> Path:
    """Folder for machine code that cannot stand beside its source."""
    return user_cache_path("beltcomm") / "machine_code"


class _Place:
    """Of one function: beside its source, as numba does, else in this user's cache; ``NUMBA_CACHE_DIR`` comes before both."""

    def __init__(self, function: Any, source: str, folder: str) -> None:
        self._line, self._source, self._folder = function.__code__.co_firstlineno, source, folder

    @classmethod
    def from_function(cls, function: Any, source: str) -> _Place | None:
        """The first place that can be written; None where there is none, which is said."""
        if not os.path.exists(source):
            return None
        given, beside = os.environ.get("NUMBA_CACHE_DIR"), os.path.dirname(source)
        apart = f"{os.path.basename(beside)}_{hashlib.sha256(beside.encode()).hexdigest()[:20]}"
        for folder in [os.path.join(given, apart)] if given else [os.path.join(beside, "__pycache__"), str(_user_folder() / apart)]:
            found = cls(function, source, folder)
            with contextlib.suppress(OSError):
                found.ensure_cache_path()
                return found
        tell(
            f"Machine code cannot be kept, for {given or _user_folder()} cannot be written: each command compiles anew; "
            "make room there, or set XDG_CACHE_HOME to a folder that can be written."
        )
        return None

    def ensure_cache_path(self) -> None:
        """Make the folder.   Raises OSError where nothing can be written into it."""
        os.makedirs(self._folder, exist_ok=True)
        tempfile.TemporaryFile(dir=self._folder).close()

    def get_cache_path(self) -> str:
        """The folder."""
        return self._folder

    def get_source_stamp(self) -> str:
        """Changes with the text of the source."""
        return _hash_of(self._source)

    def get_disambiguator(self) -> str:
        """Tells functions of one name in one file apart."""
        return str(self._line)


@cache
def _hash_of(source: str) -> str:
    return hashlib.sha256(Path(source).read_bytes()).hexdigest()


class _Result(caching.CompileResultCacheImpl):
    _locator_classes: ClassVar[Any] = [_Place]


class _Cache(caching.FunctionCache):
    _impl_class = _Result
    _cache_file: Any

    def __init__(self, py_func: Any) -> None:
        super().__init__(py_func)
        self._cache_file = _Files(self.cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp())

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super()._load_overload(sig, target_context)
        except Exception:  # whole, and yet not what this numba takes
            self._cache_file.throw_away(self._cache_file.path(self._index_key(sig, target_context.codegen())))
            return None

    def _save_overload(self, sig: Any, data: Any) -> None:
        try:
            super()._save_overload(sig, data)
        except OSError as error:
            tell(f"Machine code cannot be kept in {self.cache_path}: {error.strerror or error}; the next command compiles it again.")


class _Files:
    """A file for each of a function's types, named after them.

    numba counts its files and keeps the numbers in an index: two processes that compile the same function for other types, or with
    another length known, take the same number, and each then executes what the other has compiled.
    """

    def __init__(self, folder: str, function: str, stamp: str) -> None:
        self._beginning, self._of = str(Path(folder, function)), (numba.__version__, stamp)

    def save(self, key: Any, data: Any) -> None:
        content = self._origin(key) + caching.dumps(data)
        atomic.write(self.path(key), _MAGIC + hashlib.sha256(content).digest() + content)

    def path(self, key: Any) -> Path:
        """Where the machine code for these types stands."""
        name = hashlib.sha256(repr(key).encode()).hexdigest()[:20]
        return Path(f"{self._beginning}.{name}.nbc")

    def _origin(self, key: Any) -> bytes:
        return hashlib.sha256(repr((*self._of, key)).encode()).digest()

    def load(self, key: Any) -> Any:
        """Machine code kept for these types; None where there is nothing, or nothing that can be used."""
        path = self.path(key)
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            tell(f"{path} cannot be read: {error.strerror or error}; its machine code is compiled again by each command.")
            return None
        digest, data = content[len(_MAGIC) : len(_MAGIC) + _DIGEST], content[len(_MAGIC) + _DIGEST :]
        if not content.startswith(_MAGIC) or hashlib.sha256(data).digest() != digest:
            self.throw_away(path)
            return None
        return pickle.loads(data[_DIGEST:]) if data[:_DIGEST] == self._origin(key) else None

    def throw_away(self, path: Path) -> None:
        """Take a damaged file away, so that it is made again."""
        with contextlib.suppress(OSError):
            path.unlink()
        tell(f"Damaged files of compiled code in {path.parent} are thrown away and made again.")
