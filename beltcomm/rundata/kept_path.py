"""The torque path of a run's drive, as its last fit has left it: ``torque_path`` of ``results/fit.yaml``."""

from __future__ import annotations

from beltcomm.errors import DataError
from beltcomm.fit.torque_path import TorquePath, path_from_dict
from beltcomm.runfolder import RunFolder

#: Its key, in files and in ``--json``.
KEY = "torque_path"


def kept_path(folder: RunFolder) -> TorquePath | None:
    """The path from torque setpoint and reading to the torque that acts.

    Parameters
    ----------
    folder : RunFolder
        Of a run.

    Returns
    -------
    TorquePath or None
        None before a first fit.

    Raises
    ------
    DataError
        The entry is damaged.
    """
    found = (folder.load_result("fit") or {}).get(KEY)
    if found is None:
        return None
    try:
        return path_from_dict(found)
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"results/fit.yaml has a damaged {KEY} ({error}); run `beltcomm fit` again") from error
