"""The run folder of a session, written straight from the file contract, without the answer."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

import yaml

from truth.hidden.instruments import Instruments
from truth.hidden.machines import Machine
from truth.hidden.session import Record, run_session


def sidecar(record: Record, machine: Machine) -> dict[str, Any]:
    """What the recorder knows of a record; without a belt no place of a carriage."""
    task, base = record.task, machine.base
    place = {} if base.rigid else {"start_position_m": round(float(record.position_rad[0]) * base.radius_m, 7)}
    data: dict[str, Any] = {
        "experiment": task.experiment,
        **place,
        "session_time_s": round(record.session_time_s, 6),
        "closed_loop": task.reference is not None,
        "held_out": task.held_out,
    }
    if task.note:
        data["excitation"] = dict(task.note)
    return data


def csv_text(record: Record, instruments: Instruments | None = None) -> str:
    """The signals, 1 ms, 1 uN m and 0.1 urad fine; with instruments that are not ideal 0.1 us, 0.01 uN m and 1 nrad."""
    instruments = instruments or Instruments.ideal()
    time, torque, angle = (".3f", ".6f", ".7f") if instruments == Instruments.ideal() else (".7f", ".8f", ".9f")
    columns = [(record.t_s, time), (record.torque_nm, torque), (record.setpoint_nm, torque), (record.position_rad, angle)]
    names = ["t_s", "torque_nm", "torque_setpoint_nm", "position_rad"]
    if not instruments.setpoint_column:
        del columns[2], names[2]
    texts = [[format(value, form) for value in column.tolist()] for column, form in columns]
    return "\n".join([",".join(names), *map(",".join, zip(*texts, strict=True)), ""])


def write_session(machine: Machine, folder: Path | str, plan: str = "thorough", only: Collection[str] = ()) -> list[str]:
    """Write ``axis.yaml`` and all recordings of a plan, nothing else; returns the names of the records.

    only : names of those that are wanted, none for all; what would be recorded behind the last of them is left out.
    Raises FileExistsError when the folder holds recordings, ValueError for an unknown plan.
    """
    return write_records(machine, run_session(machine, plan), folder, only)


def write_records(machine: Machine, records: Iterable[Record], folder: Path | str, only: Collection[str] = ()) -> list[str]:
    """The same with records that were made before."""
    folder = Path(folder)
    recordings = folder / "recordings"
    recordings.mkdir(parents=True, exist_ok=False)
    (folder / "axis.yaml").write_text(yaml.safe_dump(dict(machine.sheet), sort_keys=False), encoding="utf-8")
    names: list[str] = []
    for number, record in enumerate(records, 1):
        name = f"{number:02d}_{record.task.name}"
        if only and name not in only:
            continue
        (recordings / f"{name}.csv").write_text(csv_text(record, machine.instruments), encoding="utf-8")
        text = yaml.safe_dump(sidecar(record, machine), sort_keys=False, default_flow_style=None)
        (recordings / f"{name}.yaml").write_text(text, encoding="utf-8")
        names.append(name)
        if only and len(names) == len(only):
            break
    return names
