"""Ways in which a real record is spoilt, and what is said of each:  ``python tests/benchmarks/negative_controls.py RUN RECORD OTHER``.

RECORD and OTHER are records of the run folder RUN; OTHER lends its torque.  Nothing may be named but by what a spoilt record still tells.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from click.testing import CliRunner
from numpy.typing import NDArray

from beltcomm.cli.main import cli
from beltcomm.recording import Recording
from beltcomm.recording.signalfile import write_columns
from beltcomm.runfolder import RunFolder

Array = NDArray[np.float64]
#: Names of torque and position by the side at which a record was taken.
COLUMNS = {"load": ("force_n", "position_m"), "ampere": ("current_a", "position_rad"), "volt": ("motor_voltage_v", "position_rad")}
#: Share of the rows by which a torque is of another time, and of its values between which it is clipped.
LATER, WITHIN = 0.4, (0.1, 0.9)


def spoilt(record: Recording, other: Recording) -> dict[str, tuple[Array, Array]]:
    """Torque and position by the way in which they were spoilt, the good ones first."""
    torque, position, rng = record.torque, record.position, np.random.default_rng(3)
    still, ratio = np.full(len(torque), position[0]), float(np.ptp(torque)) / max(float(np.ptp(position)), 1e-9)
    return {
        "good": (torque, position),
        "torque shuffled": (rng.permutation(torque), position),
        "another record's torque": (np.resize(other.torque, len(torque)), position),
        "torque of another time": (np.roll(torque, int(LATER * len(torque))), position),
        "noise for a torque": (rng.normal(0.0, torque.std(), len(torque)), position),
        "torque and position swapped": (ratio * position, torque / ratio),
        "torque times 1000": (1e3 * torque, position),
        "time backwards": (torque[::-1], position[::-1]),
        "sign of the torque": (-torque, position),
        "a magnitude for a torque": (np.abs(torque), position),
        "torque that never changes": (np.full(len(torque), torque.mean() + 0.1), position),
        "position that never changes": (torque, still),
        "torque clipped": (np.clip(torque, *np.quantile(torque, WITHIN)), position),
    }


def said_of(record: Recording, torque: Array, position: Array, place: Path) -> str:
    """Refusal at the import or before the analysis, or the verdict and what is named."""
    file, run = place / f"{record.name}.csv", str(place / "run")
    names = COLUMNS.get(record.side, ("torque_nm", "position_rad"))
    write_columns(file, {"t_s": record.t_s, names[0]: torque, names[1]: position})
    closed = ["--closed-loop"] * record.sidecar.closed_loop
    for words in (["import", str(file), "--run", run, "--set", "name=spoilt", *closed], ["diagnose", run, "--json"]):
        outcome = CliRunner().invoke(cli, words)
        if outcome.exit_code:
            return f"{words[0]} refused: {outcome.stderr.strip().splitlines()[-1].replace(str(place), '')[:150]}"
    found = json.loads(outcome.stdout)
    return f"{found['verdict']} named: {', '.join(found['named']) or 'nothing'}"


def main(run: str, name: str, other: str) -> None:
    """Print the table."""
    folder = RunFolder.open(Path(run))
    record = folder.recording(name)
    for way, (torque, position) in spoilt(record, folder.recording(other)).items():
        with tempfile.TemporaryDirectory() as place:
            print(f"{way:28} {said_of(record, torque, position, Path(place))}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
