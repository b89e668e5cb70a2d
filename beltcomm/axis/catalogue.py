"""Axes and motors of public data sheets: what ``beltcomm init`` can begin with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from beltcomm.configfiles import did_you_mean, find_config, read_yaml
from beltcomm.errors import UsageError

Kind = Literal["axes", "motors"]


def parts(kind: Kind) -> dict[str, dict[str, Any]]:
    """All of a kind by name, each with its title and source."""
    found: Mapping[str, Any] = read_yaml(find_config("catalogue", "parts"))[kind]
    return {str(name): dict(entry) for name, entry in found.items()}


def with_part(data: Mapping[str, Any], kind: Kind, name: str) -> dict[str, Any]:
    """``data``, in the shape of axis.yaml, with an axis or a motor of the catalogue.

    Raises
    ------
    UsageError
        For a name that is not there.
    """
    known = parts(kind)
    if name not in known:
        word = "motor" if kind == "motors" else "axis"
        raise UsageError(f"no {word} of the catalogue is called {name!r}{did_you_mean(name, known)}; there are {', '.join(known)}")
    entry = {key: value for key, value in known[name].items() if key not in ("title", "source")}
    title = str(known[name]["title"])
    if kind == "motors":
        return {**data, "motor": {**data.get("motor", {}), "name": title, **entry}}
    merged = {section: {**data.get(section, {}), **values} for section, values in entry.items()}
    return {**data, **merged, "name": data.get("name") or title.partition(" (")[0]}
