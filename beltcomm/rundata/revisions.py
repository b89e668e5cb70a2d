"""Revisions of a run's model: each one a file in ``models/``, all of them in ``results/ladder.yaml`` with where they came from."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from beltcomm.errors import DataError, UsageError
from beltcomm.given import pasted
from beltcomm.laboratory.figures import Plain, PlainError
from beltcomm.model import Model, load_model
from beltcomm.outside import sha256_of
from beltcomm.recording.sidecar import load_sidecar
from beltcomm.result import plain as as_plain
from beltcomm.runfolder import RunFolder, next_free

#: Name under which every command finds the model that counts.
CURRENT = "final"
LADDER = "ladder"

#: Of ``results/fit.yaml``: the records that there were.
RECORDS = "records"


@dataclass(frozen=True)
class Revision:
    """One rung.

    Attributes
    ----------
    name : str
        Of the file in ``models/``.
    change : str
        "base", "+effect" or "-effect".
    ratio, held_out
        Error over noise.
    plain, plain_held_out : PlainError or None
        The same in plain units, in the band of all rungs; None where an earlier version made the rung.
    confirmed : bool or None
        The error on held-out records fell (None: there are none, or an effect was taken out).
    command : str
        That made it.
    data : dict of str to str
        SHA-256 of every recording.
    bands, bands_held_out : tuple of PlainError
        ``plain`` and ``plain_held_out`` in the band that this model bears and in narrower ones; empty as before.
    cost : dict of str to Any or None
        ``of``, the effects not known, and a ``rundata.cost.Cost``; None where nobody asked for it or it cannot be said.
    """

    name: str
    parent: str
    change: str
    effects: tuple[str, ...]
    ratio: float
    held_out: float | None
    confirmed: bool | None
    command: str
    when: str
    data: Mapping[str, str]
    cost: Mapping[str, Any] | None = None
    plain: PlainError | None = None
    plain_held_out: PlainError | None = None
    bands: tuple[PlainError, ...] = ()
    bands_held_out: tuple[PlainError, ...] = ()

    def up_to(self, band_hz: float) -> Plain:
        """The error in plain units up to a band's edge, on fitted and on held-out records; None where nobody noted it."""
        fitted, held = (next((one for one in bands if one.band_hz == band_hz), None) for bands in (self.bands, self.bands_held_out))
        return fitted, held

    @property
    def data_hash(self) -> str:
        """Of all recordings together, short: the same where the same data were fitted."""
        return hashlib.sha256("".join(f"{name} {digest}\n" for name, digest in sorted(self.data.items())).encode()).hexdigest()[:10]


def revisions(folder: RunFolder) -> list[Revision]:
    """All revisions of a run's model in the order they were made.

    Parameters
    ----------
    folder : RunFolder

    Raises
    ------
    DataError
        For a damaged file.
    """
    saved = folder.load_result(LADDER) or {"revisions": []}
    unknown = {"held_out": None, "confirmed": None}
    rungs = saved["revisions"]
    return _in_one_band([Revision(**{**unknown, **rung, "effects": tuple(rung["effects"]), **_plain_of(rung)}) for rung in rungs])


def _plain_of(rung: Mapping[str, Any]) -> dict[str, Any]:
    own = {name: None if (said := rung.get(name)) is None else PlainError(**said) for name in ("plain", "plain_held_out")}
    return own | {name: tuple(PlainError(**said) for said in rung.get(name) or ()) for name in ("bands", "bands_held_out")}


def band_of_rungs(rungs: Sequence[Revision]) -> float:
    """The band in which all rungs can be told, Hz: the widest of the one that bears least; inf where none of them was noted.

    Parameters
    ----------
    rungs : sequence of Revision
        Of one run.
    """
    return min((rung.bands[0].band_hz for rung in rungs if rung.bands), default=math.inf)


def _in_one_band(rungs: Sequence[Revision]) -> list[Revision]:
    """Rungs whose errors in plain units are all up to one frequency, so that they can be held against each other."""
    band = band_of_rungs(rungs)
    told = [rung.up_to(band) for rung in rungs]
    return [
        rung if plain is None else replace(rung, plain=plain, plain_held_out=held) for rung, (plain, held) in zip(rungs, told, strict=True)
    ]


def current_model(folder: RunFolder) -> Model | None:
    """The model that counts; None when nothing was fitted yet.

    Parameters
    ----------
    folder : RunFolder

    Raises
    ------
    DataError
        For a damaged file.
    """
    if CURRENT not in folder.names("models"):
        return None
    return model_named(folder, CURRENT)


def model_named(folder: RunFolder, name: str) -> Model:
    """A model of the run.

    Parameters
    ----------
    folder : RunFolder
    name : str
        Of its file in ``models/``.

    Raises
    ------
    DataError
        With its file, when it is missing or damaged.
    """
    path = folder.file("models", name)
    try:
        return load_model(path)
    except UsageError as error:
        remedy = f"make it again with `beltcomm fit {pasted(folder.path)}`" if name == CURRENT else "bring it back"
        raise DataError(f"the run's model is damaged: {error}; {remedy}") from error


def current_revision(folder: RunFolder) -> Revision | None:
    """The rung that the current model stands on; None where it was made by another command since.

    Parameters
    ----------
    folder : RunFolder
    """
    model = current_model(folder)
    rungs = revisions(folder)
    for rung in reversed(rungs):
        if model is not None and folder.load("models", rung.name) == folder.load("models", CURRENT):
            return rung
    return None


def not_contradicted(rung: Revision, every: Sequence[Revision]) -> Revision:
    """The revision, or the last before it that held-out records did not contradict.

    Parameters
    ----------
    rung : Revision
        From which the search goes back.
    every : sequence of Revision
        Revisions of the run.
    """
    rungs = {r.name: r for r in every}
    while rung.confirmed is False and rung.parent in rungs:
        rung = rungs[rung.parent]
    return rung


def trusted_model(folder: RunFolder) -> tuple[Model | None, str, str]:
    """The model a design may rest on: the current one, or the last before it that held-out records did not contradict.

    Returns the model (None when nothing was fitted yet), the name of its revision ("" where it is none), and a sentence ("" likewise).

    Parameters
    ----------
    folder : RunFolder
    """
    rung = current_revision(folder)
    if rung is None:
        return current_model(folder), "", ""
    newest, rung = rung, not_contradicted(rung, revisions(folder))
    sentence = f"the model is {rung.name} ({rung.change}; error {rung.ratio:.2f} times the noise)"
    if rung is not newest:
        sentence += f", because {newest.name} ({newest.change}) is not confirmed"
    return model_named(folder, rung.name), rung.name, sentence


def new_revision(
    folder: RunFolder,
    model: Model,
    change: str,
    *,
    ratio: float,
    held_out: float | None,
    confirmed: bool | None,
    command: str,
    when: str,
    bands: Sequence[Plain] = (),
) -> Revision:
    """Save a model as a new rung and make it the one that counts.

    Parameters
    ----------
    folder : RunFolder
    model : Model
    change : str
        "+EFFECT" or "-EFFECT", or in words.
    ratio : float
        Error over the noise.
    held_out : float or None
        That of the records held out; None without any.
    confirmed : bool or None
        True if these confirm it; None without any.
    command : str
        Command line, kept as provenance.
    when : str
        Date and time, kept as provenance.
    bands : sequence of Plain
        Errors in plain units, from the widest band to the narrowest.
    """
    rungs = revisions(folder)
    parent = current_revision(folder)
    above, data = parent.name if parent else "", recording_hashes(folder)
    if rungs and (rungs[-1].parent, rungs[-1].change, rungs[-1].data, rungs[-1].command) == (above, change, data, command):
        rungs.pop()  # of this very command, cut off before its model counted
    name = _name(folder, rungs, model)
    rung = Revision(name, above, change, model.effects, ratio, held_out, confirmed, command, when, data)
    own, held = (tuple(one for one in side if one is not None) for side in (zip(*bands, strict=True) if bands else ((), ())))
    rung = replace(rung, bands=own, bands_held_out=held)
    rungs = _in_one_band([*rungs, rung])
    folder.save("models", name, model.to_dict())
    folder.save("results", LADDER, {"revisions": [as_plain(r) for r in rungs]})
    folder.save("models", CURRENT, model.to_dict())  # last: until then the model is the one before, and the same command goes on
    return rungs[-1]


def _name(folder: RunFolder, rungs: Sequence[Revision], model: Model) -> str:
    """The next rung's: behind those there are, and no other model's, as where somebody has deleted the ladder."""
    taken = {rung.name for rung in rungs}
    while (name := next_free("revision_", taken, len(rungs) + 1)) in folder.names("models") and not _is_kept(folder, name, model):
        taken.add(name)
    return name


def _is_kept(folder: RunFolder, name: str, model: Model) -> bool:
    """True if this very model stands under a name: a command was cut off before its rung was noted."""
    try:
        return bool(folder.load("models", name) == as_plain(model.to_dict()))
    except DataError:
        return False


def keep_cost(folder: RunFolder, name: str, cost: Mapping[str, Any] | None) -> None:
    """Write down with a revision what not knowing its effects costs.

    Parameters
    ----------
    folder : RunFolder
    name : str
        Of the revision.
    cost : mapping of str to Any or None, m
        None for none.
    """
    rungs = [replace(rung, cost=cost) if rung.name == name else rung for rung in revisions(folder)]
    folder.save("results", LADDER, {"revisions": [as_plain(r) for r in rungs]})


def recording_hashes(folder: RunFolder) -> dict[str, str]:
    """SHA-256 of every complete recording.

    Parameters
    ----------
    folder : RunFolder

    Returns
    -------
    dict of str to str
        By name of the recording.
    """
    return {name: sha256_of(folder.recordings_folder / f"{name}.csv") for name in folder.finished_names()}


def changed_recordings(folder: RunFolder, rung: Revision) -> list[str]:
    """Recordings that were added, removed or changed since a rung was made.

    Parameters
    ----------
    folder : RunFolder
    rung : Revision
        With the hashes of its records.

    Returns
    -------
    list of str
        Names, sorted.
    """
    now = recording_hashes(folder)
    return sorted(name for name in now.keys() | rung.data.keys() if now.get(name) != rung.data.get(name))


def as_mapping(rung: Revision) -> dict[str, Any]:
    """A revision for ``--json``.

    Parameters
    ----------
    rung : Revision
        Of the run.
    """
    return {**{key: said for key, said in as_plain(rung).items() if not key.startswith("bands")}, "data_hash": rung.data_hash}


def unfitted(folder: RunFolder) -> list[str]:
    """Records made since the current model was fitted that a fit would take in; none where nobody noted what there was.

    Parameters
    ----------
    folder : RunFolder
    """
    rung = current_revision(folder)
    noted = (folder.load_result("fit") or {}).get(RECORDS) if rung is None else [Path(name).stem for name in rung.data]
    if not isinstance(noted, list):
        return []
    return [name for name in folder.finished_names() if name not in noted and _teaches(folder, name)]


def _teaches(folder: RunFolder, name: str) -> bool:
    path = folder.recordings_folder / f"{name}.yaml"
    sidecar = load_sidecar(path)[0] if path.is_file() else None
    return sidecar is not None and not sidecar.held_out and sidecar.experiment != "static_map"
