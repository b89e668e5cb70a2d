"""What records could show, kept in the user's cache folder: the same axis, drive and program ask for it once."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from platformdirs import user_cache_path

from beltcomm import caches
from beltcomm.axis import Axis
from beltcomm.drive import Capabilities
from beltcomm.programs import source_hash
from beltcomm.session.programme import Extent


def kept(axis: Axis, capabilities: Capabilities, extent: Extent, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """The last answer of this extent where everything is as it was, else a new one.   Raises what ``make`` raises."""
    path, key = user_cache_path("beltcomm") / f"foresight_{extent}.json", key_of(axis, capabilities, extent)
    if found := caches.found(path, key):
        try:
            return dict(found["visible"])
        except (ValueError, KeyError, TypeError):
            caches.damaged(path)
    visible = make()
    caches.keep(path, key, {"visible": visible})
    return visible


def key_of(axis: Axis, capabilities: Capabilities, extent: Extent) -> str:
    """Changes with everything that the answer rests on."""
    drive = {name: sorted(map(str, v)) if isinstance(v, set | frozenset) else str(v) for name, v in asdict(capabilities).items()}
    return hashlib.sha256(json.dumps([axis.to_dict(), drive, extent, source_hash()], default=str, sort_keys=True).encode()).hexdigest()
