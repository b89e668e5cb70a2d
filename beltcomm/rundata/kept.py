"""Fits and results kept in ``RUN/kept`` for as long as nothing that they rest on has changed; the torque path of the last fit."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm import caches
from beltcomm.arrays import Array
from beltcomm.axis import Axis
from beltcomm.caches import source_hash
from beltcomm.configfiles import digest_of
from beltcomm.errors import BeltcommError, DataError
from beltcomm.fit.estimate import Fitted, evaluate_at, problem_of
from beltcomm.fit.likelihood.problem import Problem
from beltcomm.fit.loads import with_loads
from beltcomm.fit.records import Data, prepare_records
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.fit.start.model import start_model
from beltcomm.fit.torque.path import TorquePath, path_from_dict, path_to_dict
from beltcomm.fit.uncertainty.nuisance import with_nuisance
from beltcomm.journal import EVENTS, TEXT
from beltcomm.model import Model, model_from_dict
from beltcomm.outside import sha256_of
from beltcomm.recording import Recording
from beltcomm.result import Line, Result, Row, plain
from beltcomm.runfolder import RunFolder

#: Fine steps of a sample, at most: a file may ask for a day of computing.
_MOST_SUBSTEPS = 1000


def _key_of(records: Mapping[str, str], axis: Axis) -> str:
    """Equal only where the same programs would fit a model to the same records, given as name -> SHA-256, sidecars too."""
    return digest_of([dict(sorted(records.items())), axis.fingerprint(), source_hash()])


def _key_of_model(start: Model | None) -> str:
    """Hash, equal only for the same model with which a fit begins; None where it follows from records and axis."""
    return digest_of(start.to_dict() if start is not None else None)


def _store_fit(data: Data, fitted: Fitted) -> dict[str, Any] | None:
    """Mapping for :func:`_restore_fit`; None for a model with an observer, whose gains go with the way of the search."""
    if needs_observer(fitted.model):
        return None
    return {
        "made_by": fitted.problem.model.to_dict(),
        "fixed": [name for name in fitted.model.parameters if name not in fitted.problem.free],
        "path": path_to_dict(data.path),
        "substeps": data.substeps,
        "reversals": data.reversals,
        "colour": float(data.colour),
        "single": data.single,
        "unknowns": [float(x) for x in fitted.x],
        "likeliest": [float(x) for x in fitted.likeliest.x] if fitted.likeliest is not None else None,
        "shares": {piece.record: [float(share) for share in piece.rounding] for piece in (*data.fitted, *data.held_out)},
        "noise_nm": float(data.noise_nm),
        "step_rad": float(data.step_rad),
    }


def _restore_fit(recordings: Sequence[Recording], found: Mapping[str, Any]) -> tuple[Data, Fitted]:
    """The fit at its minimum: one evaluation, no search.  Raises BeltcommError, or what Python says of damaged values."""
    model = model_from_dict(found["made_by"])
    shares = {str(name): (float(white), float(slow)) for name, (white, slow) in found["shares"].items()}
    timed = [r for r in recordings if not r.is_static_map]
    path, substeps = path_from_dict(found["path"]), int(found["substeps"])
    if not 1 <= substeps <= _MOST_SUBSTEPS:
        raise ValueError(f"{substeps} fine steps a sample")
    data = prepare_records(
        timed,
        model,
        float(found["noise_nm"]),
        float(found["step_rad"]),
        shares,
        substeps,
        path,
        bool(found["reversals"]),
        float(found["colour"]),
        bool(found["single"]),
    )
    problem = problem_of(data, model, found["fixed"])
    fitted = evaluate_at(data, problem, _unknowns(found["unknowns"], problem))
    if found["likeliest"] is not None:
        fitted = replace(fitted, likeliest=evaluate_at(data, problem, _unknowns(found["likeliest"], problem)))
    return data, with_nuisance(data, fitted)


def _unknowns(kept: Sequence[float], problem: Problem) -> Array:
    x = np.array(kept, dtype=np.float64)
    if x.shape != problem.scale.shape:
        raise ValueError(f"{len(x)} unknowns kept, {len(problem.scale)} needed")
    return x


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
    folder : RunFolder
    recordings : sequence of Recording
    model : Model or None
        One of the run's; None begins with what the axis file and the records tell.
    """
    path, fits = folder.path.joinpath(*FILE), _kept(folder, recordings)
    if (found := fits.get(_key_of_model(model))) is not None:
        try:
            start = model_from_dict(found["start"]) if model is None else model
            return start, *_restore_fit(recordings, found["fit"])
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
    folder : RunFolder
    data : Data
    fitted : Fitted
    model : Model
        As the run folder has it.
    """
    model = model_from_dict(model.to_dict())
    _write(folder, data.recordings, model, model, data, fitted)


def _write(folder: RunFolder, recordings: Sequence[Recording], model: Model | None, start: Model, data: Data, fitted: Fitted) -> None:
    if (fit := _store_fit(data, fitted)) is None:
        return
    own = _key_of_model(model)
    others = [(key, kept) for key, kept in _kept(folder, recordings).items() if key != own]
    fits = dict([*others[1 - MOST :], (own, {"start": start.to_dict(), "fit": fit})])
    caches.keep(folder.path.joinpath(*FILE), _key(folder, recordings), {"fits": fits})


def _kept(folder: RunFolder, recordings: Sequence[Recording]) -> dict[str, Any]:
    """Fits of these records by the model's key, those found last behind."""
    found = caches.found(folder.path.joinpath(*FILE), _key(folder, recordings))
    fits = found.get("fits") if found else None
    return fits if isinstance(fits, dict) else {}


def _key(folder: RunFolder, recordings: Sequence[Recording]) -> str:
    return _key_of(_hashes_of_fitted(folder, recordings), folder.axis)


def _hashes_of_fitted(folder: RunFolder, recordings: Sequence[Recording]) -> dict[str, str]:
    """Of the records that are fitted alone: those held out, as a move that verifies, change no fit."""
    return hashes(folder, {Path(r.file).stem if r.file else r.name for r in recordings if not (r.sidecar.held_out or r.is_static_map)})


def hashes(folder: RunFolder, names: Collection[str] | None = None) -> dict[str, str]:
    """SHA-256 of every file of every complete recording, or of some of them.

    Parameters
    ----------
    folder : RunFolder
    names : collection of str or None
        Of recordings; None for all.

    Returns
    -------
    dict of str to str
        By file name.
    """
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


#: Parts of a run folder that no result rests on, beside hidden files: foreign files before they became records, what is kept, drawn, told
#: or written down.
BESIDE = ("originals", "kept", "pictures", "report.html", "report.json", TEXT, EVENTS, "verdict.txt")


def kept_or_new(folder: RunFolder, name: str, question: Sequence[object], make: Callable[[], Result], drawn: bool = False) -> Result:
    """The answer of before where the same programs would give it again from the same files, else a new one, kept.

    Parameters
    ----------
    folder : RunFolder
    name : str
        Of the answer, and of its own file among the results.
    question : sequence of object
        Everything else that the answer depends on.
    make : callable
        Makes a new one.
    drawn : bool
        Pictures belong to it, and must be there.
    """
    path, key = folder.path / "kept" / f"{name}.json", _key_of_question(folder, name, question)
    found = caches.found(path, key) if key else None
    try:
        pictures = found["data"]["pictures"] if found and drawn else []
        if found and bool(pictures) is drawn and all((folder.path / picture).is_file() for picture in pictures):
            shown = [_line_of(kept) for kept in found["text"]]
            return Result(found["data"], shown, int(found["exit_code"]), details=[_line_of(kept) for kept in found["details"]])
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError):
        caches.damaged(path)
    made = make()
    result = Result(plain(made.data), made.text, made.exit_code, details=made.details)
    if not key:
        return result
    caches.keep(
        path,
        key,
        {
            "data": result.data,
            "text": [*map(_kept_line, result.text)],
            "details": [*map(_kept_line, result.details)],
            "exit_code": result.exit_code,
        },
    )
    return result


def _key_of_question(folder: RunFolder, name: str, question: Sequence[object]) -> str:
    """Changes with everything that the answer rests on; empty where a file cannot be read: then nothing is kept."""
    own = folder.path / "results" / f"{name}.yaml"
    there = (
        path
        for path in sorted(folder.path.rglob("*"))
        if path.is_file() and path != own and path.relative_to(folder.path).parts[0] not in BESIDE and path.name[0] != "."
    )
    try:
        found = [(str(p.relative_to(folder.path)), sha256_of(p)) for p in there]
    except (OSError, BeltcommError):
        return ""
    text = json.dumps([found, source_hash(), str(folder.path), *question])
    return hashlib.sha256(text.encode()).hexdigest()


def _kept_line(line: str) -> str | list[object]:
    if isinstance(line, Line):
        return [list(part) for part in line.parts]
    return [str(line), line.cells, line.right, line.head] if isinstance(line, Row) else line


def _line_of(kept: str | list[Any]) -> str:
    if isinstance(kept, str):
        return kept
    return Line(*((str(text), str(style)) for text, style in kept)) if isinstance(kept[0], list) else Row(*kept)
