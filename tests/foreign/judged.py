"""Real measurements: run folders by the recipe of docs/import.md, and errors that do not depend on the laboratory's noise.

force_error : as the authors of EMPS judge: force over all samples, decimated by 10 forward and backward, rms of the error over rms.
response_error : of the motor's angle at the excited lines, mean over the periods behind the transient, rms over rms.
torque_error : over all samples, rms of the error over rms.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from click.testing import CliRunner
from numpy.typing import NDArray
from scipy.signal import decimate

from beltcomm.cli.main import cli
from beltcomm.identify.residual import Stretch, evaluate, stretches
from beltcomm.linear import operating_point, state_space
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.simulate.imperfect import path_response

CHECKOUT = Path(__file__).parents[2]
DATA = CHECKOUT.parent / "shared" / "data"
CASES = CHECKOUT.parent / "shared" / "cases"
Array = NDArray[np.float64]


def imported(name: str, folder: Path, data: Path = DATA) -> Path:
    """The run folder ``name`` of the recipe below ``folder``."""
    page = (CHECKOUT / "docs" / "import.md").read_text(encoding="utf-8")
    for command in page.splitlines():
        if command.startswith("beltcomm import $DATA") and f"runs/{name} " in command:
            words = [word.replace("$DATA", str(data)).replace("runs/", f"{folder}/") for word in shlex.split(command)]
            outcome = CliRunner().invoke(cli, words[1:])
            assert outcome.exit_code == 0, outcome.output
    return folder / name


def as_run(files: Mapping[str, Path], folder: Path, inertia_kg_m2: float, counts: int = 0) -> Path:
    """The run folder of CSV files of a rigid motor; the one called held is held out."""
    first = ["--set", "name=motor", "--set", f"motor.inertia_kg_m2={inertia_kg_m2}"]
    first += ["--set", f"motor.encoder_counts_per_rev={counts}"] if counts else []
    for name, file in files.items():
        words = ["import", str(file), "--run", str(folder), *first, *(["--held-out"] if name == "held" else [])]
        outcome, first = CliRunner().invoke(cli, words), []
        assert outcome.exit_code == 0, outcome.output
    return folder


def reconstructed(model: Model, record: Recording, step: float) -> list[tuple[Stretch, Array, Array]]:
    """(stretch, error of the torque, torque), all samples of each stretch without its ends."""
    found = []
    for piece in stretches(record, model, step, 1.0, fitted=True, substeps=4):
        mean = 0.5 * (piece.torque[:-2] + piece.torque[1:-1])
        found.append((piece, evaluate(piece, model, model.vector())[1:-1], mean))
    return found


def torque_error(model: Model, record: Recording, step: float) -> float:
    """Share, all samples."""
    parts = reconstructed(model, record, step)
    return float(np.sqrt(sum(np.sum(e**2) for _, e, _ in parts) / sum(np.sum(t**2) for _, _, t in parts)))


def force_error(model: Model, record: Recording) -> float:
    """Share, as EMPS is judged."""
    ((_, error, force),) = reconstructed(model, record, 2.5e-8)
    left, asked = (decimate(signal[48:-48], 10, 8, "iir", zero_phase=True) for signal in (error, force))
    return float(np.linalg.norm(left) / np.linalg.norm(asked))


def response_error(model: Model, record: Recording) -> float:
    """Share of the angle at the excited lines."""
    note = record.sidecar.excitation
    assert note is not None
    assert note.period_samples is not None
    drift = np.polynomial.Polynomial.fit(record.t_s, record.position, 1)(record.t_s)
    torque, angle = (
        np.fft.rfft(signal[note.first_sample :].reshape(-1, note.period_samples).mean(axis=0))
        for signal in (record.torque, record.position - drift)
    )
    lines = np.flatnonzero(np.abs(torque) > 0.05 * np.abs(torque).max())
    freq = lines / (note.period_samples * record.sample_period_s)
    lines, freq = lines[(freq > 10.0) & (freq < 251.0)], freq[(freq > 10.0) & (freq < 251.0)]
    linear = state_space(model, operating_point(model, 0.0, 1.0)).sampled(freq, record.sample_period_s)[:, 0] * path_response(model, freq)
    return float(np.linalg.norm(linear * torque[lines] - angle[lines]) / np.linalg.norm(angle[lines]))
