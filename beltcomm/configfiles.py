"""Settings files: finding them by name, reading YAML without surprises, writing whole files or none.

Shipped files stand in ``beltcomm/configs`` inside a wheel and in ``configs`` beside the package in a checkout.
"""

from __future__ import annotations

import difflib
import errno
import hashlib
import json
import math
import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from beltcomm import atomic
from beltcomm.errors import BeltcommError, UsageError
from beltcomm.outside import read_text

_HALVES = re.compile("[\ud800-\udfff]")
_PACKAGE = Path(__file__).resolve().parent
#: Where shipped files are looked for, first hit wins: the wheel's place, then the checkout's.
CONFIG_FOLDERS = (_PACKAGE / "configs", _PACKAGE.parent / "configs")
#: Characters of a whole number: 64 bits, with sign or 0x.
LONGEST_INT = 20
#: Values in a settings file, and how deep they nest.
MOST_NODES, MOST_DEPTH = 200_000, 60
#: Key of the checksum in files that the tool writes for itself.
CHECKSUM = "checksum"
_WORD_FOR = {"axes": "axis", "plants": "plant", "drives": "drive profile", "studies": "study", "slaves": "drive that can be played"}


def find_config(kind: str, name: str) -> Path:
    """The file that ``name`` means.

    Parameters
    ----------
    kind : str
        "axes", "plants", "drives", "studies" or "slaves".
    name : str
        The name of a shipped file, or a path (anything with a slash or ending in ``.yaml``).

    Raises
    ------
    UsageError
        When there is no such file, with the names that exist.
    """
    word = _WORD_FOR.get(kind, kind)
    if named_file(name):
        path = Path(name).expanduser()
        if path.is_file():
            return path
        shipped = path.stem if path.stem in config_names(kind) else ""
        hint = f"; the shipped {word} of that name is called {shipped}" if shipped else "; check the path"
        raise UsageError(f"the {word} file {name} does not exist{hint}")
    for folder in CONFIG_FOLDERS:
        path = folder / kind / f"{name}.yaml"
        if path.is_file():
            return path
    known = config_names(kind)
    raise UsageError(
        f"no {word} is called {name!r}{did_you_mean(name, known)}; known are {', '.join(known) or 'none'}, or give the path of a .yaml file"
    )


def named_file(name: str) -> bool:
    """True if a name means a file of the user's and no shipped one.

    Parameters
    ----------
    name : str
        As the user gave it.

    Returns
    -------
    bool
        By a separator or the ending of a YAML file.
    """
    return "/" in name or os.sep in name or name.endswith((".yaml", ".yml"))


def config_names(kind: str) -> list[str]:
    """Names of the shipped files of one kind, sorted.

    Parameters
    ----------
    kind : str
        Folder of ``configs``: "axes", "drives", "plants" and so on.
    """
    return sorted({path.stem for folder in CONFIG_FOLDERS for path in (folder / kind).glob("*.yaml")})


#: Letters from which on a part of a word is no chance.
_PART = 3
#: Likeness of a word that was meant, where nothing says that words of their own are usual.
_USUAL = 0.6


def did_you_mean(word: str, known: Iterable[str], likeness: float = _USUAL) -> str:
    """The words ``, did you mean X?`` for the known word that resembles ``word`` most, or alone holds it; "" when none does.

    Parameters
    ----------
    word : str
        That was given.
    known : iterable of str
        All that it could be.
    likeness : float
        0 to 1, share of matching letters from which on a word counts (``difflib.SequenceMatcher.ratio``).
    """
    by_lower = {item.lower(): item for item in known}
    part = str(word).lower()
    close = difflib.get_close_matches(part, by_lower, n=1, cutoff=likeness)
    if not close and likeness <= _USUAL and len(part) >= _PART:
        close = [item for item in by_lower if part in item]
        close = close if len(close) == 1 else []  # of two that hold it neither is likelier
    return f", did you mean {by_lower[close[0]]}?" if close else ""


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]  # the C parser where libyaml is there
    """YAML with the numbers of YAML 1.2: ``1e-6`` is a number, ``010`` is ten, ``1:30`` and dates stay text."""


def _mapping_without_repeats(loader: Any, node: yaml.MappingNode) -> dict[Any, Any]:
    seen = set()
    for key, _ in node.value:
        if isinstance(key, yaml.ScalarNode):
            if key.value in seen:
                line = key.start_mark.line + 1
                raise yaml.constructor.ConstructorError(None, None, f"{key.value} stands twice, again in line {line}")
            seen.add(key.value)
    loader.flatten_mapping(node)
    mapping: dict[Any, Any] = yaml.SafeLoader.construct_mapping(loader, node, deep=True)
    return mapping


def _float(loader: Any, node: yaml.ScalarNode) -> float:
    text = str(node.value).lower()
    return float(text.replace(".inf", "inf").replace(".nan", "nan"))


def _int(loader: Any, node: yaml.ScalarNode) -> int:
    text = str(node.value)
    if len(text) <= LONGEST_INT:
        return int(text, 16) if "x" in text.lower() else int(text)
    raise yaml.constructor.ConstructorError(None, None, f"a whole number with {len(text)} digits", node.start_mark)


def _bool(loader: Any, node: yaml.ScalarNode) -> bool:
    found = yaml.SafeLoader.bool_values.get(str(node.value).lower())
    if found is None:
        raise yaml.constructor.ConstructorError(None, None, f"{str(node.value)[:20]!r} is neither true nor false", node.start_mark)
    return found


_Loader.yaml_implicit_resolvers = {
    first: [item for item in items if item[0].rsplit(":", 1)[1] not in {"int", "float", "timestamp"}]
    for first, items in _Loader.yaml_implicit_resolvers.items()
}
_INT = re.compile(r"[-+]?[0-9]+$|0[xX][0-9a-fA-F]+$")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?$|[-+]?\.(inf|Inf|INF)$|\.(nan|NaN|NAN)$")
_Loader.add_implicit_resolver("tag:yaml.org,2002:int", _INT, list("-+0123456789"))
_Loader.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+.0123456789"))
#: The types of JSON and no other: a tag that asks for a set, bytes or a date has no meaning in a settings file.
_Loader.yaml_constructors = {
    tag and f"tag:yaml.org,2002:{tag}": found
    for tag, found in {
        "map": _mapping_without_repeats,
        "float": _float,
        "int": _int,
        "bool": _bool,
        "null": yaml.SafeLoader.construct_yaml_null,
        "str": yaml.SafeLoader.construct_yaml_str,
        "seq": yaml.SafeLoader.construct_yaml_seq,
        None: yaml.SafeLoader.construct_undefined,
    }.items()
}


class _Dumper(yaml.SafeDumper):
    """Quotes every text that :class:`_Loader` would take for a number, and writes line ends of other alphabets as escapes."""


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    """Between double quotes where something in it is not printable: other styles change line ends of other systems."""
    plain = text.replace("\n", "").isprintable()
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=None if plain else '"')


_Dumper.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+.0123456789"))
_Dumper.add_representer(str, _text)


def read_yaml(path: Path, failure: type[BeltcommError] = UsageError) -> dict[str, Any]:
    """The mapping in a YAML file; an empty file is an empty mapping.

    Raises ``failure`` for a file that cannot be read (see :mod:`beltcomm.outside`), is not UTF-8 or not YAML, holds one key twice, more
    than any settings do, or no mapping.

    Parameters
    ----------
    path : Path
    failure : type of BeltcommError
        Raised for what cannot be used.

    Returns
    -------
    dict of str to Any
        Keys as text.
    """
    try:
        text = _text_of(path, failure)
    except OSError as error:
        raise failure(f"{path} cannot be read: {error.strerror or error}") from error
    try:
        loader = _Loader(text)
        try:
            node = loader.get_single_node()
            _check_size(node)
            data = None if node is None else loader.construct_document(node)
        finally:
            loader.dispose()
    except (yaml.YAMLError, ValueError, RecursionError, LookupError, TypeError, AttributeError, OverflowError) as error:
        raise failure(f"{path} is not valid YAML: {_first_words(error)}") from error
    if data is None:
        return {}
    if not isinstance(data, dict):
        raise failure(f"{path} holds a {type(data).__name__}; it must hold a mapping of names to values")
    return {str(key): value for key, value in data.items()}


def _text_of(path: Path, failure: type[BeltcommError]) -> str:
    """The text of a settings file; installers may make links of shipped ones."""
    if any(path.is_relative_to(folder) for folder in CONFIG_FOLDERS):
        return path.read_text(encoding="utf-8-sig")
    return read_text(path, failure=failure)


def _check_size(node: yaml.Node | None) -> None:
    """Raise ValueError for more values, or deeper ones, than any settings hold; what is referred to counts each time."""
    sizes: dict[int, int] = {}

    def size(part: yaml.Node, depth: int) -> int:
        if depth > MOST_DEPTH:
            raise ValueError(f"its values nest deeper than {MOST_DEPTH}, or refer to themselves")
        if isinstance(part, yaml.ScalarNode):
            return 1
        if id(part) not in sizes:
            inside = part.value if isinstance(part, yaml.SequenceNode) else [one for pair in part.value for one in pair]
            sizes[id(part)] = 1 + sum(size(one, depth + 1) for one in inside)
            if sizes[id(part)] > MOST_NODES:
                raise ValueError(f"it holds more than {MOST_NODES} values; settings and results hold far fewer")
        return sizes[id(part)]

    if node is not None:
        size(node, 0)


def line_of(path: Path, keys: tuple[str, ...]) -> int:
    """The line where a key stands, counted from 1, for messages; 0 when it is not found.

    Parameters
    ----------
    path : Path
    keys : tuple of str
        From the outermost.
    """
    try:
        node = yaml.compose(_text_of(path, UsageError), Loader=_Loader)
    except (OSError, ValueError, yaml.YAMLError, UsageError):
        return 0
    line = 0
    for wanted in keys:
        if not isinstance(node, yaml.MappingNode):
            return line
        for key, value in node.value:
            if key.value == wanted:
                line, node = key.start_mark.line + 1, value
                break
        else:
            return line
    return line


def to_yaml(mapping: Mapping[str, Any]) -> str:
    """YAML text of plain values (text, numbers, lists, mappings, numpy scalars and arrays); floats come back exactly.

    Raises TypeError for a value that is none of these.

    Parameters
    ----------
    mapping : mapping of str to Any
        Plain values.
    """
    return yaml.dump(_plain(mapping), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120)


def sealed(mapping: Mapping[str, Any]) -> dict[str, Any]:
    """The mapping with a checksum, by which an edit made since shows.  It is no signature: whoever wants to can compute it anew.

    Parameters
    ----------
    mapping : mapping of str to Any
        Plain values.

    Returns
    -------
    dict of str to Any
        With an entry more.
    """
    content = _plain(mapping)
    return {**content, CHECKSUM: _checksum(content)}


def unsealed(mapping: Mapping[str, Any]) -> tuple[dict[str, Any], bool]:
    """The mapping without its checksum, and whether it is as :func:`sealed` left it; one without a checksum is not.

    Parameters
    ----------
    mapping : mapping of str to Any
        As read.

    Returns
    -------
    tuple of dict of str to Any and bool
        Its content, and True where it matches its checksum.
    """
    content = {key: value for key, value in mapping.items() if key != CHECKSUM}
    try:
        return content, mapping.get(CHECKSUM) == _checksum(_plain(content))
    except (TypeError, ValueError, RecursionError):  # nothing that to_yaml writes
        return content, False


def _checksum(content: Mapping[str, Any]) -> str:
    return digest_of(content)[:32]


def digest_of(value: Any) -> str:
    """SHA-256 of plain values, whatever the order of their keys.

    Parameters
    ----------
    value : Any
        That JSON can say.
    """
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def write_text(path: Path, text: str | Iterable[str]) -> None:
    """Write a text, see :mod:`beltcomm.atomic`.

    Parameters
    ----------
    path : Path
    text : str or Iterable[str]
        Or pieces of it, of which only one is in memory.

    Raises
    ------
    UsageError
        When the folder is missing, read-only or full.
    """
    try:
        with atomic.replacing(path) as file:
            for piece in [text] if isinstance(text, str) else text:
                file.write(piece.encode(errors="backslashreplace"))
    except OSError as error:
        room = "make room or " if error.errno in (errno.ENOSPC, errno.EDQUOT) else ""
        raise UsageError(f"{path} cannot be written: {error.strerror or error}; {room}choose another place") from error


def _plain(value: Any) -> Any:
    """Value in the types YAML knows."""
    if isinstance(value, Mapping):
        return {without_halves(str(key)): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, (set, frozenset)):
        return sorted(_plain(item) for item in value)
    if isinstance(value, (str, Path)):
        return without_halves(str(value))
    if hasattr(value, "tolist"):  # numpy array or scalar; numpy itself is not needed here
        return _plain(value.tolist())
    if value is None or isinstance(value, (bool, int, float)):
        return value
    raise TypeError(f"{type(value).__name__} cannot be written to YAML")


def is_number(value: object) -> bool:
    """True for a finite number that is no bool.

    Parameters
    ----------
    value : object
        Of a settings file, of any type.
    """
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def without_halves(text: str) -> str:
    """The text with what no file can hold, halves of characters out of names that are no UTF-8, shown as replaced.

    Parameters
    ----------
    text : str
        Of any origin.
    """
    return _HALVES.sub("\N{REPLACEMENT CHARACTER}", text)


def _first_words(error: Exception) -> str:
    """Finding of the parser and its place, on one line."""
    mark = getattr(error, "problem_mark", None)
    problem = getattr(error, "problem", None) or str(error).splitlines()[0]
    return f"{problem} (line {mark.line + 1}, column {mark.column + 1})" if mark else str(problem)
