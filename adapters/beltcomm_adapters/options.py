"""Options of an address as a user gives them: numbers, and the name of a profile."""

from __future__ import annotations

from collections.abc import Mapping

from beltcomm.errors import UsageError
from beltcomm_adapters.profiles import load_profile


def whole_number(options: Mapping[str, object], name: str, default: int | None, least: int, most: int) -> int | None:
    """An option as a whole number.

    Parameters
    ----------
    options : mapping of str to object
        Of the adapter.
    name : str
        Of the option.
    default : int or None
        Where it is not given.
    least, most : int
        Between which it lies.

    Raises
    ------
    UsageError
        For anything else.
    """
    value = options.get(name)
    if value is None:
        return default
    try:
        number = int(str(value), 0)
    except ValueError:
        number = least - 1
    if not least <= number <= most:
        raise UsageError(f"the option {name} must be a whole number from {least} to {most}, not {value}")
    return number


def number(options: Mapping[str, object], name: str, default: float | None) -> float | None:
    """An option as a number.

    Parameters
    ----------
    options : mapping of str to object
        Of the adapter.
    name : str
        Of the option.
    default : float or None
        Where it is not given.

    Raises
    ------
    UsageError
        For anything else.
    """
    value = options.get(name)
    if value is None:
        return default
    try:
        return float(str(value))
    except ValueError:
        raise UsageError(f"the option {name} must be a number, not {value}") from None


def profile_name(options: Mapping[str, object]) -> str | None:
    """The option ``profile``, a name or the path of a file, None to choose by identity.

    Parameters
    ----------
    options : mapping of str to object
        Of the adapter.

    Raises
    ------
    UsageError
        When there is none such.
    """
    value = options.get("profile")
    if value is None:
        return None
    load_profile(str(value))
    return str(value)
