"""Drives of other makers as data."""

from beltcomm.errors import UsageError
from beltcomm.virtual.profiles import PROFILES, VirtualProfile


def profile_named(name: str) -> VirtualProfile:
    if name not in PROFILES:
        raise UsageError(f"there is no virtual drive with the profile {name!r}; there are {', '.join(PROFILES)}")
    return PROFILES[name]
