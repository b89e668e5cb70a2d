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
    from numba.core import caching, config

config._config_fname = os.devnull  # numba looks for its settings again before each compilation

#: How a file begins that this module has written; behind it the SHA-256 of the rest.
_MAGIC = b"beltcomm machine code 1\n"
#: How one begins that numba has written: from an earlier version.
_EARLIER = b"\x80"
_DIGEST = hashlib.sha256().digest_size


def kept(dispatcher: Any) -> None:
    """Have the machine code of a compiled function kept, where there is a place for it."""
    with contextlib.suppress(RuntimeError):  # in memory then, as long as the process lives
        dispatcher._cache = _Cache(dispatcher.py_func)


def user_folder() -> Path:
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
        for folder in [os.path.join(given, apart)] if given else [os.path.join(beside, "__pycache__"), str(user_folder() / apart)]:
            found = cls(function, source, folder)
            with contextlib.suppress(OSError):
                found.ensure_cache_path()
                return found
        tell(
            f"Machine code cannot be kept, for {given or user_folder()} cannot be written: each command compiles anew; "
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

    def __init__(self, py_func: Any) -> None:
        super().__init__(py_func)
        own = self._cache_file
        self._cache_file = _Files(self.cache_path, self._impl.filename_base, own._source_stamp)

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super()._load_overload(sig, target_context)
        except Exception:  # whole, and yet not what this numba takes
            self._cache_file.throw_away(self._cache_file._index_path)
            return None

    def _save_overload(self, sig: Any, data: Any) -> None:
        try:
            super()._save_overload(sig, data)
        except OSError as error:
            tell(f"Machine code cannot be kept in {self.cache_path}: {error.strerror or error}; the next command compiles it again.")


class _Files(caching.IndexDataCacheFile):
    """The index of a function, and a file for each of its types."""

    def load(self, key: Any) -> Any:
        name = self._load_index().get(key)
        return None if name is None else self._read(self._data_path(name))

    def _load_index(self) -> dict[Any, str]:
        found = self._read(self._index_path)
        version, stamp, overloads = found or (None, None, {})
        return overloads if (version, stamp) == (self._version, self._source_stamp) else {}

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write(self._index_path, (self._version, self._source_stamp, overloads))

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), data)

    def _write(self, path: str, content: Any) -> None:
        data = self._dump(content)
        atomic.write(Path(path), _MAGIC + hashlib.sha256(data).digest() + data)

    def _read(self, path: str) -> Any:
        """Content of a file; None where there is none, or none that can be used."""
        try:
            content = Path(path).read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            tell(f"{path} cannot be read: {error.strerror or error}; its machine code is compiled again by each command.")
            return None
        if content.startswith(_EARLIER):
            return None
        digest, data = content[len(_MAGIC) : len(_MAGIC) + _DIGEST], content[len(_MAGIC) + _DIGEST :]
        if content.startswith(_MAGIC) and hashlib.sha256(data).digest() == digest:
            return pickle.loads(data)
        self.throw_away(path)
        return None

    def throw_away(self, path: str) -> None:
        """Take a damaged file away, so that it is made again."""
        with contextlib.suppress(OSError):
            os.unlink(path)
        tell(f"Damaged files of compiled code in {os.path.dirname(path)} are thrown away and made again.")
