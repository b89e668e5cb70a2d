"""Records of a run that its model was not fitted to."""

from __future__ import annotations

from pathlib import Path

from beltcomm.recording.sidecar import load_sidecar
from beltcomm.rundata.revisions import current_revision
from beltcomm.runfolder import RunFolder

#: Of ``results/fit.yaml``: the records that there were.
RECORDS = "records"


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
