"""A command that runs once and is ended at many instants: at each the process is forked, and the child's folder is a copy."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

#: Flags of a file that was opened already: it is there, with what is in it.
_MAKING = os.O_CREAT | os.O_EXCL | os.O_TRUNC


@dataclass
class Branches:
    """Copies of a running command.

    world : folder with all that the command writes, its run and the user's state; a child has a copy under this name.   told : what the
    children said.   inside : True in a child.
    """

    world: Path
    told: list[dict[str, Any]] = field(default_factory=list)
    inside: bool = False
    _pipe: int = -1

    def fork(self) -> bool:
        """True in the child, which ends in :meth:`tell`; False in this process, when it has ended.   Not in a child."""
        kept = self.world.with_name(self.world.name + ".kept")
        self.world.rename(kept)
        try:
            shutil.copytree(kept, self.world, symlinks=True)
            reading, writing = os.pipe()
            sys.stdout.flush()
            sys.stderr.flush()
            child = os.fork()
            if child == 0:
                os.close(reading)
                self.inside, self._pipe = True, writing
                _reopen(kept, self.world)
                return True
            os.close(writing)
            with os.fdopen(reading, "rb") as pipe:
                said = pipe.read()
            os.waitpid(child, 0)
            self.told.append(json.loads(said) if said else {"broken": True})
        finally:
            if not self.inside:
                shutil.rmtree(self.world)
                kept.rename(self.world)
        return False

    def tell(self, work: Callable[[], dict[str, Any]]) -> None:
        """End the child with what it found; in the parent nothing."""
        if not self.inside:
            return
        try:
            with os.fdopen(self._pipe, "wb") as pipe:
                pipe.write(json.dumps(work()).encode())
        finally:
            os._exit(0)


def _reopen(old: Path, new: Path) -> None:
    """Files that are open under ``old`` become those under ``new``, at the same place in them: parent and child would share one."""
    for name in os.listdir("/proc/self/fd"):
        descriptor = int(name)
        try:
            path = os.readlink(f"/proc/self/fd/{name}")
        except OSError:  # the folder's own
            continue
        if not path.startswith(f"{old}/") or not Path(path).is_file():
            continue
        with open(f"/proc/self/fdinfo/{name}", encoding="ascii") as info:
            told = dict(line.split(":", 1) for line in info if ":" in line)
        opened = os.open(f"{new}{path.removeprefix(str(old))}", int(told["flags"], 8) & ~_MAKING)
        os.lseek(opened, int(told["pos"]), os.SEEK_SET)
        os.dup2(opened, descriptor)
        os.close(opened)
