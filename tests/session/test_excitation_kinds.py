"""``identify --excitation``: every kind through the bus on the independent simulator; what a multisine's silent lines say of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from beltcomm.recording import load_recording
from beltcomm.rundata.analyse import Nonlinearity
from beltcomm.runfolder import RunFolder
from beltcomm.sentences.words import nonlinearity_lines
from session.bench import Bench
from session.test_commands import DRIVE, call, json_of

MakeBench = Callable[..., Bench]


@pytest.mark.parametrize("kind", ["multisine"])
@pytest.mark.examination
def test_another_excitation_finds_the_same_axis(make_bench: MakeBench, tmp_path: Path, kind: str) -> None:
    bench, run = make_bench(), tmp_path / "run"
    data = json_of(call("identify", *DRIVE, "--yes", "--run", run, "--excitation", kind, "--json"))
    truth = bench.plant.truth
    for name, true in (("cart.mass", "mass_kg"), ("belt_stiffness.stiffness", "stiffness_n_m")):
        assert data["model"]["parameters"][name]["value"] == pytest.approx(truth[true], rel=0.03)
    folder = RunFolder.open(run)
    record = load_recording(run / "recordings" / "frf_1.csv", folder.axis)
    assert record.sidecar.excitation is not None
    assert record.sidecar.excitation.kind == kind
    assert load_recording(run / "recordings" / "amplitude_1.csv", folder.axis).sidecar.excitation.kind == "prbs"  # type: ignore[union-attr]
    split = data["nonlinearity"]
    assert list(split) == (["frf_1"] if kind == "multisine" else [])
    if split:  # the simulated axis rubs, and nothing of it differs by direction
        assert split["frf_1"]["odd"] > 10.0 * split["frf_1"]["even"]
        assert split["frf_1"]["odd"] > 5.0 * split["frf_1"]["noise"]


@pytest.mark.parametrize(
    ("odd", "even", "said"),
    [(0.2, 0.01, "odd is friction"), (0.01, 0.2, "differs by direction"), (0.004, 0.003, "nothing above the noise")],
)
def test_people_read_what_it_means(odd: float, even: float, said: str) -> None:
    (line,) = nonlinearity_lines({"frf_1": Nonlinearity(odd, even, 0.003, 5.0, 150.0)})
    assert said in line


def test_an_unknown_kind_is_usage(tmp_path: Path) -> None:
    outcome = call("identify", *DRIVE, "--yes", "--run", tmp_path / "run", "--excitation", "noise")
    assert outcome.exit_code == 2
    assert "multisine" in outcome.stderr
