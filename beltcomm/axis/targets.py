"""Targets that a command asks for in place of those of ``axis.yaml``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace

from beltcomm.axis import Axis, axis_from_dict
from beltcomm.axis.entries import AT
from beltcomm.axis.kinds import KINDS


def with_targets(axis: Axis, asked: Mapping[str, object] | None) -> Axis:
    """Axis of any kind with other targets than its file's.

    Parameters
    ----------
    axis : Axis
        With the targets that stay where nothing else is asked for.
    asked : mapping of str to object, or None
        Entries of :class:`beltcomm.axis.entries.AxisTargets`, m and s along the line of the load; ``at`` also in the word of the kind.

    Returns
    -------
    Axis
        The same one for nothing asked.

    Raises
    ------
    UsageError
        For entries that there are not, values out of their bounds, and such that contradict the axis.
    """
    if not asked:
        return axis
    own = KINDS.get(axis.kind)
    at = {"at": AT[1]} if own is not None and asked.get("at") == own.load else {}
    stated = {name: value for name, value in asdict(axis.targets).items() if value not in (None, "")}
    motions = {name: asdict(limits) for name, limits in axis.trajectories.items()}
    read = axis_from_dict({"targets": {**stated, **asked, **at}, "trajectories": motions})
    return replace(axis, targets=read.targets)
