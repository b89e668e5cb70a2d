"""Real measurements: run folders by the recipe of docs/import.md, and errors that do not depend on the laboratory's noise.

record_error : the product's own, ``laboratory.compare``; EMPS up to 40 Hz, where its authors decimate by 10 forward and backward.
response_error : of the motor's angle at the excited lines, mean over the periods behind the transient, rms over rms.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from click.testing import CliRunner
from numpy.typing import NDArray

from beltcomm.cli.main import cli
from beltcomm.fit.band_error import Banded, _low_passed, in_band
from beltcomm.fit.residual.segment import Segment, segments
from beltcomm.laboratory.compare import _plain_error
from beltcomm.model import Model
from beltcomm.model.linear import operating_point, state_space
from beltcomm.recording import Recording

CHECKOUT = Path(__file__).parents[2]
DATA = CHECKOUT.parent / "shared" / "data"
#: Step of the encoder, rad or m, and band of the judgement, Hz.
EMPS, COGGING, BENCH = (2.5e-8, 40.0), (2.0 * np.pi / 8192, 240.0), (5e-6, 240.0)
CASES = CHECKOUT.parent / "shared" / "cases"
Array = NDArray[np.float64]
#: The stretches of a record, each with what a model leaves of it in a band.
Parts = list[tuple[Segment, Banded]]


def path_response(model: Model, freq_hz: Array) -> NDArray[np.complex128]:
    """Factor that the torque path puts before the axis, (m,): acting over reported torque."""
    factor = np.ones(len(freq_hz), dtype=np.complex128)
    for effect in model.effect_list():
        if effect.slot in ("torque_delay", "torque_reading") and effect.slope is not None:
            shown = np.asarray(effect.slope(2.0 * math.pi * freq_hz, *[model[name] for name in effect.full_names()]))
            factor = factor * shown if effect.slot == "torque_delay" else factor / shown
    return factor


def imported(name: str, folder: Path, data: Path = DATA) -> Path:
    """The run folder ``name`` of the recipe below ``folder``."""
    page = (CHECKOUT / "docs" / "import.md").read_text(encoding="utf-8")
    for command in page.splitlines():
        if command.startswith("beltcomm import $DATA") and f"runs/{name} " in command:
            words = [word.replace("$DATA", str(data)).replace("runs/", f"{folder}/") for word in shlex.split(command)]
            outcome = CliRunner().invoke(cli, words[1:])
            assert outcome.exit_code == 0, outcome.output
    return folder / name


def as_run(files: Mapping[str, Path], folder: Path, inertia_kg_m2: float, counts: int = 0, more: Sequence[str] = ()) -> Path:
    """The run folder of CSV files of a rigid motor; the one called held is held out."""
    first = ["--set", "name=motor", "--set", f"motor.inertia_kg_m2={inertia_kg_m2}"]
    first += ["--set", f"motor.encoder_counts_per_rev={counts}"] if counts else []
    for name, file in files.items():
        words = ["import", str(file), "--run", str(folder), *first, *more, *(["--held-out"] if name == "held" else [])]
        outcome, first = CliRunner().invoke(cli, words), []
        assert outcome.exit_code == 0, outcome.output
    return folder


def banded_of(model: Model, record: Recording, step: float, band_hz: float) -> Parts:
    """Every stretch of a record, and what a model leaves of it in a band."""
    pieces = segments(record, model, step, 1.0, fitted=True, substeps=4)
    return [(piece, in_band(piece, model, model.vector(), band_hz)) for piece in pieces]


def record_error(model: Model, record: Recording, step: float, band_hz: float) -> float:
    """Share of the torque or force in a band, as ``plain_error`` defines it."""
    found = _plain_error([part for _, part in banded_of(model, record, step, band_hz)], model, band_hz)
    assert found is not None
    return found.percent / 100.0


def least_squares(
    fitted: Sequence[list[tuple[Segment, Banded]]], judged: Sequence[list[tuple[Segment, Banded]]], band_hz: float
) -> list[float]:
    """Share that inertia, viscous and Coulomb friction leave by least squares on filtered signals, of each judged record.

    The samples, the filter and the torque are those of ``plain_error``; angles are differenced, torques averaged over the two periods.
    """

    def regressors(parts: Parts) -> tuple[Array, Array]:
        rows, torques = [], []
        for piece, part in parts:
            q, sample = piece.position, part.sample_s
            speed, acceleration = np.gradient(q, sample), np.pad(np.diff(q, 2) / sample**2, 1)
            direction = np.sign(_low_passed(speed, piece.keep, band_hz, sample)[0])
            mean = np.concatenate(([0.0], 0.5 * (piece.torque[1:] + piece.torque[:-1])))
            columns = [_low_passed(signal, piece.keep, band_hz, sample)[0][part.keep] for signal in (acceleration, speed, direction, mean)]
            rows.append(np.column_stack(columns[:3]))
            torques.append(columns[3])
        return np.concatenate(rows), np.concatenate(torques)

    given = [regressors(parts) for parts in fitted]
    values = np.linalg.lstsq(np.concatenate([r for r, _ in given]), np.concatenate([t for _, t in given]), rcond=None)[0]
    return [float(np.linalg.norm(t - r @ values) / np.linalg.norm(t)) for r, t in map(regressors, judged)]


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
