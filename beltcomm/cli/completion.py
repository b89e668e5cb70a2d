"""Shell completion of drives, axes, plants, effects and run folders.  Verbs, options and choices click knows by itself.

Installed by ``eval "$(_BELTCOMM_COMPLETE=bash_source beltcomm)"`` in ``~/.bashrc``; ``zsh_source`` and ``fish_source`` likewise.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from click import Context, Parameter
from click.shell_completion import BashComplete, CompletionItem, add_completion_class

from beltcomm.borders import for_terminal

Completion = Callable[[Context, Parameter, str], list[CompletionItem]]
#: What makes a folder a run, where its present model is, and what the kernel calls a CAN interface.
RECORDS, MODEL_FILE, CAN_TYPE = "recordings", "models/final.yaml", "280"


def drives(_ctx: Context, _param: Parameter, incomplete: str) -> list[str]:
    """Virtual drives with every shipped plant, and the interfaces and ports of this machine.

    Parameters
    ----------
    _ctx, _param : Context
    incomplete : str
        Word on the line so far.
    """
    known = ["virtual", *(f"virtual:{name}" for name in _names("plants")), "serial:virtual"]
    return _beginning([*known, *_can_interfaces(), *_serial_ports()], incomplete)


def _names(kind: str) -> list[str]:
    from beltcomm.configfiles import config_names  # YAML takes longer to import than --help may last

    return config_names(kind)


def _shipped(kind: str, *, or_files: bool = False) -> Completion:
    """Names of the shipped files of a kind; with the YAML files of the folder where a path does as well."""

    def complete(_ctx: Context, _param: Parameter, incomplete: str) -> list[CompletionItem]:
        names = _beginning(_names(kind), incomplete)
        # with names offered, a shell looks for files only where none begins so: the YAML files here are offered like names
        files = _beginning(_yaml_files(incomplete), incomplete) if or_files else []
        return [*([CompletionItem(incomplete, type="file")] if or_files else []), *map(CompletionItem, [*names, *files])]

    return complete


profiles, slaves = _shipped("drives"), _shipped("slaves")
axes, plants = _shipped("axes", or_files=True), _shipped("plants", or_files=True)


def effects(_ctx: Context, _param: Parameter, incomplete: str) -> list[str]:
    """Effects of the whole catalogue.

    Parameters
    ----------
    _ctx, _param : Context
    incomplete : str
        Word on the line so far.
    """
    from beltcomm.effects import EFFECTS

    return _beginning((effect.name for effect in EFFECTS), incomplete)


def effects_to_add(ctx: Context, param: Parameter, incomplete: str) -> list[str]:
    """Effects that the model of the run named on the line does not have yet.

    Parameters
    ----------
    ctx, param : Context
    incomplete : str
        Word on the line so far.
    """
    has = _effects_of_line()
    return [name for name in effects(ctx, param, incomplete) if name not in has]


def effects_to_remove(ctx: Context, param: Parameter, incomplete: str) -> list[str]:
    """Effects that the model of the run named on the line has; the whole catalogue before a run is named.

    Parameters
    ----------
    ctx, param : Context
    incomplete : str
        Word on the line so far.
    """
    return _beginning(has, incomplete) if (has := _effects_of_line()) else effects(ctx, param, incomplete)


def runs(_ctx: Context, _param: Parameter, incomplete: str) -> list[CompletionItem]:
    """Run folders here and one level below; any folder where there is none.

    Parameters
    ----------
    _ctx, _param : Context
    incomplete : str
        Word on the line so far.
    """
    folder, slash, name = incomplete.rpartition("/")
    here = Path(folder + slash or ".")
    found = {path.parent for pattern in (f"{name}*", f"{name}*/*") for path in here.glob(f"{pattern}/{RECORDS}")}
    return [CompletionItem(incomplete, type="dir"), *map(CompletionItem, _beginning(map(str, sorted(found)), ""))]


def _yaml_files(incomplete: str) -> list[str]:
    """YAML files in the folder of a word that is being typed, as it would go on."""
    folder = incomplete.rpartition("/")[0] + "/" if "/" in incomplete else ""
    try:
        return sorted(folder + path.name for path in Path(folder or ".").iterdir() if path.suffix == ".yaml")
    except OSError:
        return []


def _beginning(names: Iterable[str], incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete) and name == for_terminal(name)]


def _can_interfaces() -> list[str]:
    try:
        return sorted(path.parent.name for path in Path("/sys/class/net").glob("*/type") if path.read_text().strip() == CAN_TYPE)
    except OSError:
        return []


def _serial_ports() -> list[str]:
    ports = sorted(str(path) for pattern in ("ttyACM*", "ttyUSB*") for path in Path("/dev").glob(pattern))
    return [f"{scheme}:{port}" for scheme in ("slcan", "serial") for port in ports]


def _effects_of_line() -> list[str]:
    """Effects of the model of the first run on the whole line, also behind the cursor; none where no run is named."""
    from beltcomm.configfiles import read_yaml
    from beltcomm.errors import BeltcommError, DataError

    for word in _words_of_line():
        file = Path(word) / MODEL_FILE
        if file.is_file():
            try:
                return [str(name) for name in read_yaml(file, DataError).get("effects") or ()]
            except BeltcommError:
                return []
    return []


def _words_of_line() -> list[str]:
    """The words of the whole line, those behind the cursor too, without their quotes; bash gives one in each line."""
    return [_unquoted(word) for word in os.environ.get("COMP_WORDS", "").split("\n")]


def _unquoted(word: str) -> str:
    """A word as a command gets it; one whose quote is still open as far as it goes."""
    try:
        return "".join(shlex.split(word))
    except ValueError:
        return word.lstrip("\"'")


@add_completion_class
class Bash(BashComplete):
    """click's own, which knows no colons, and no empty word before others."""

    _cut = 0

    def get_completion_args(self) -> tuple[list[str], str]:
        """Complete words, and the one at the cursor, both as they were typed."""
        words, at = _words_of_line(), int(os.environ["COMP_CWORD"])
        joined: list[str] = []
        for word in words[: at + 1]:
            if joined and (word.startswith(":") or joined[-1].endswith(":")):
                joined[-1] += word
            else:
                joined.append(word)
        incomplete = joined.pop() if at < len(words) else ""
        if at < len(words) and words[at] != incomplete:  # bash took it apart: it completes the part after the last colon
            self._cut = incomplete.rindex(":") + 1
        return joined[1:], incomplete

    def format_completion(self, item: CompletionItem[Any]) -> str:
        """``type,value`` of what comes after the colon."""
        return f"{item.type},{item.value[self._cut :]}"
