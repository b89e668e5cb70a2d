"""Fits of a run: a model's from ``RUN/kept/fit.json`` where that is still valid, else anew and kept there; the torque path of the last."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from beltcomm import caches
from beltcomm.errors import BeltcommError, DataError
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.loads import with_loads
from beltcomm.fit.records import Data
from beltcomm.fit.start.model import start_model
from beltcomm.fit.stored import key_of, key_of_model, restore_fit, store_fit
from beltcomm.fit.torque.path import TorquePath, path_from_dict
from beltcomm.model import Model, model_from_dict
from beltcomm.outside import sha256_of
from beltcomm.recording import Recording
from beltcomm.runfolder import RunFolder

#: Where it stands in a run folder: nothing that anybody must keep.
FILE = ("kept", "fit.json")
#: Models whose fit is kept, those fitted last: one that comes back reads the number that it had.
MOST = 12

#: Its key, in files and in ``--json``.
KEY = "torque_path"


def fit_base(folder: RunFolder, recordings: Sequence[Recording], model: Model | None) -> tuple[Model, Data, Fitted]:
    """The model that the fit began with and :func:`beltcomm.laboratory.diagnosis.fit_base_of`; kept, it costs one evaluation.

    Parameters
    ----------
    model : Model or None
        One of the run's; None begins with what the axis file and the records tell.
    """
    path, fits = folder.path.joinpath(*FILE), _kept(folder, recordings)
    if (found := fits.get(key_of_model(model))) is not None:
        try:
            start = model_from_dict(found["start"]) if model is None else model
            return start, *restore_fit(recordings, found["fit"])
        except (BeltcommError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError):
            caches.damaged(path)
    from beltcomm.laboratory.diagnosis import fit_base_of  # the report mostly finds its fit, and imports no search

    start = start_model(folder.axis, recordings) if model is None else with_loads(model, recordings)
    data, fitted = fit_base_of(recordings, folder.axis, start)
    _write(folder, recordings, model, start, data, fitted)
    return start, data, fitted


def keep_fit(folder: RunFolder, data: Data, fitted: Fitted, model: Model) -> None:
    """Keep a fit as that of a model of the run, so that every command that follows reads it.

    Parameters
    ----------
    model : Model
        As the run folder has it.
    """
    model = model_from_dict(model.to_dict())
    _write(folder, data.recordings, model, model, data, fitted)


def _write(folder: RunFolder, recordings: Sequence[Recording], model: Model | None, start: Model, data: Data, fitted: Fitted) -> None:
    if (fit := store_fit(data, fitted)) is None:
        return
    own = key_of_model(model)
    others = [(key, kept) for key, kept in _kept(folder, recordings).items() if key != own]
    fits = dict([*others[1 - MOST :], (own, {"start": start.to_dict(), "fit": fit})])
    caches.keep(folder.path.joinpath(*FILE), _key(folder, recordings), {"fits": fits})


def _kept(folder: RunFolder, recordings: Sequence[Recording]) -> dict[str, Any]:
    """Fits of these records by the model's key, those found last behind."""
    found = caches.found(folder.path.joinpath(*FILE), _key(folder, recordings))
    fits = found.get("fits") if found else None
    return fits if isinstance(fits, dict) else {}


def _key(folder: RunFolder, recordings: Sequence[Recording]) -> str:
    return key_of(_hashes_of_fitted(folder, recordings), folder.axis)


def _hashes_of_fitted(folder: RunFolder, recordings: Sequence[Recording]) -> dict[str, str]:
    """Of the records that are fitted alone: those held out, as a move that verifies, change no fit."""
    return hashes(folder, {Path(r.file).stem if r.file else r.name for r in recordings if not (r.sidecar.held_out or r.is_static_map)})


def hashes(folder: RunFolder, names: Collection[str] | None = None) -> dict[str, str]:
    """SHA-256 of every file of every complete recording, or of some of them."""
    stems = set(folder.finished_names()) if names is None else set(names)
    files = (path for path in folder.recordings_folder.iterdir() if path.stem in stems and path.suffix in (".csv", ".yaml"))
    return {path.name: sha256_of(path) for path in files}


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
