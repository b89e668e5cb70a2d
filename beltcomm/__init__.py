"""beltcomm commissions toothed-belt linear axes: identify, fit, friction, design, verify.

:func:`open` gives a run folder as an object; the functions behind the commands are collected in :mod:`beltcomm.api`.  Importing this
package loads nothing else.
"""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING

from beltcomm.version import __version__ as __version__

if TYPE_CHECKING:
    from beltcomm.run import OpenedRun


def open(run: str | PathLike[str]) -> OpenedRun:
    """A run folder as an object: records, model, gains, and what the commands do.

    Parameters
    ----------
    run : str or path
        The run folder.

    Returns
    -------
    beltcomm.run.OpenedRun
        Nothing is read before it is asked for.

    Raises
    ------
    beltcomm.errors.DataError
        The folder does not exist or is no run.
    """
    from beltcomm.run import OpenedRun

    return OpenedRun(run)
