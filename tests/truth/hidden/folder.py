"""The run folder of a session, written straight from the file contract, without the answer."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml

from truth.hidden.machines import Machine
from truth.hidden.recorder import PERIOD_S
from truth.hidden.session import Record, run_session


def sidecar(record: Record, radius_m: float) -> dict[str, Any]:
    """What the recorder knows of a record."""
    task = record.task
    data: dict[str, Any] = {
        "experiment": task.experiment,
        "start_position_m": round(float(record.position_rad[0]) * radius_m, 7),
        "session_time_s": round(record.session_time_s, 6),
        "closed_loop": task.reference is not None,
        "held_out": task.held_out,
    }
    if task.note:
        data["excitation"] = dict(task.note)
    return data


def csv_text(record: Record) -> str:
    """The signals, 1 uN m and 0.1 urad fine."""
    columns = record.torque_nm.tolist(), record.setpoint_nm.tolist(), record.position_rad.tolist()
    rows = [f"{i * PERIOD_S:.3f},{t:.6f},{s:.6f},{q:.7f}" for i, (t, s, q) in enumerate(zip(*columns, strict=True))]
    return "\n".join(["t_s,torque_nm,torque_setpoint_nm,position_rad", *rows, ""])


def write_session(machine: Machine, folder: Path | str, plan: str = "thorough") -> list[str]:
    """Write ``axis.yaml`` and all recordings of a plan, nothing else; returns the names of the records.

    Raises FileExistsError when the folder holds recordings, ValueError for an unknown plan.
    """
    return write_records(machine, run_session(machine, plan), folder)


def write_records(machine: Machine, records: Iterable[Record], folder: Path | str) -> list[str]:
    """The same with records that were made before."""
    folder = Path(folder)
    recordings = folder / "recordings"
    recordings.mkdir(parents=True, exist_ok=False)
    (folder / "axis.yaml").write_text(yaml.safe_dump(dict(machine.sheet), sort_keys=False), encoding="utf-8")
    names = []
    for record in records:
        name = f"{len(names) + 1:02d}_{record.task.name}"
        (recordings / f"{name}.csv").write_text(csv_text(record), encoding="utf-8")
        text = yaml.safe_dump(sidecar(record, machine.base.radius_m), sort_keys=False, default_flow_style=None)
        (recordings / f"{name}.yaml").write_text(text, encoding="utf-8")
        names.append(name)
    return names
