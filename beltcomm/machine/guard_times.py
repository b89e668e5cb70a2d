"""In which time a drive may be made to notice that its host is gone."""

from __future__ import annotations

from beltcomm.drive import GUARD_S, Capabilities

#: Guard times that are tried, s, longest first: a short one makes a fault of every hiccup of the computer.
GUARD_TIMES_S = (GUARD_S, 0.035, 0.025, 0.02)


def guard_times_s(capabilities: Capabilities) -> tuple[float, ...]:
    """Guard times that drive and bus allow, longest first; the shortest one always."""
    shortest = capabilities.shortest_guard_s or GUARD_S
    return (*(time for time in GUARD_TIMES_S if time > shortest), shortest)
