"""What of a run is behind the rest: records that its model was not fitted to, and a design that was made from an earlier model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from beltcomm.given import pasted
from beltcomm.outside import sha256_of
from beltcomm.recording.sidecar import load_sidecar
from beltcomm.rundata.revisions import CURRENT, current_revision
from beltcomm.runfolder import RunFolder

#: Of ``results/fit.yaml``: the records there were. Of ``designs/final.yaml``: hash of the file of its model.
RECORDS, MODEL = "records", "model_sha256"


def unfitted(folder: RunFolder) -> list[str]:
    """Records made since the current model was fitted that a fit would take in; none where nobody noted what there was."""
    rung = current_revision(folder)
    noted = (folder.load_result("fit") or {}).get(RECORDS) if rung is None else [Path(name).stem for name in rung.data]
    if not isinstance(noted, list):
        return []
    return [name for name in folder.finished_names() if name not in noted and _teaches(folder, name)]


def _teaches(folder: RunFolder, name: str) -> bool:
    path = folder.recordings_folder / f"{name}.yaml"
    sidecar = load_sidecar(path)[0] if path.is_file() else None
    return sidecar is not None and not sidecar.held_out and sidecar.experiment != "static_map"


def mark_of(folder: RunFolder, revision: str = "") -> dict[str, Any]:
    """Entry of a design: which model it was made from.   revision : "" is the current one."""
    name = revision or CURRENT
    return {MODEL: sha256_of(folder.file("models", name))} if name in folder.names("models") else {}


def behind(folder: RunFolder) -> list[str]:
    """In sentences, what should be made anew before the run's design is driven."""
    found, again = [], f"`beltcomm design {pasted(folder.path)}` makes it anew"
    if names := unfitted(folder):
        found.append(f"the run's model was not fitted to {', '.join(names)}, recorded since; {again}, with these records")
    design = folder.load("designs", "final") if "final" in folder.names("designs") else {}
    if MODEL in design and mark_of(folder, str(design.get("revision") or "")) not in ({}, {MODEL: design[MODEL]}):
        found.append(f"the run's design was made from an earlier model of it; {again}")
    return found
