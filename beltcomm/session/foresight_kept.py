"""What records could show, kept in the user's cache folder: the same axis, drive and program ask for it once."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from platformdirs import user_cache_path

from beltcomm.axis import Axis
from beltcomm.configfiles import write_text
from beltcomm.drive import Capabilities
from beltcomm.errors import BeltcommError
from beltcomm.outside import read_json
from beltcomm.programs import source_hash
from beltcomm.session.programme import Extent


def kept(axis: Axis, capabilities: Capabilities, extent: Extent, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """The last answer of this extent where everything is as it was, else a new one.   Raises what ``make`` raises."""
    path, key = user_cache_path("beltcomm") / f"foresight_{extent}.json", key_of(axis, capabilities, extent)
    try:
        found = read_json(path)
        if found["key"] == key:
            return dict(found["visible"])
    except (OSError, ValueError, KeyError, TypeError, BeltcommError):
        pass  # nothing there, or nothing that can be used: it is made again
    visible = make()
    keep(path, {"key": key, "visible": visible})
    return visible


def keep(path: Path, found: dict[str, Any]) -> None:
    """Write an answer where that is possible."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps(found) + "\n")
    except (OSError, BeltcommError):
        pass  # a cache that cannot be written costs the time only


def key_of(axis: Axis, capabilities: Capabilities, extent: Extent) -> str:
    """Changes with everything that the answer rests on."""
    drive = {name: sorted(map(str, v)) if isinstance(v, set | frozenset) else str(v) for name, v in asdict(capabilities).items()}
    return hashlib.sha256(json.dumps([axis.to_dict(), drive, extent, source_hash()], default=str, sort_keys=True).encode()).hexdigest()
