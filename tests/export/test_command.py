"""``beltcomm export``: provenance, files, what is said, faults."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from beltcomm import api
from beltcomm.axis import load_axis
from beltcomm.cli.main import cli
from beltcomm.control import Cascade, CascadeStructure, discrete_coefficients
from beltcomm.drive.parameters import cascade_to_parameters
from beltcomm.errors import DataError, Refused, UsageError
from beltcomm.model import load_plant
from beltcomm.result import plain
from beltcomm.runfolder import RunFolder
from export.drive import CASCADES, PERIOD_S
from export.function_block import FunctionBlock
from fuzz.parsers import DESIGN, STRUCTURE

THESIS = CascadeStructure("thesis", PERIOD_S, ("none", "notch", "butterworth"), True, True, True)


@pytest.fixture
def make_run(tmp_path: Path) -> Callable[..., Path]:
    """A run folder with a model and a design."""

    def make(cascade: Cascade = CASCADES["butterworth"], structure: CascadeStructure = THESIS, **more: Any) -> Path:
        folder = RunFolder.create(tmp_path / "run", load_axis("egc-70-600"))
        folder.save("models", "final", load_plant("g_a").model.to_dict())
        design = {"parameters": cascade_to_parameters(cascade), "revision": "", "compensated": [], "structure": plain(structure)}
        folder.save("designs", "final", {**DESIGN, **design, "binding": [], "remarks": [], **more})
        return folder.path

    return make


def call(*words: str, answer: str | None = None) -> Any:
    return CliRunner().invoke(cli, list(words), input=answer)


def test_the_command_writes_a_file_and_overwrites_only_with_a_yes(make_run: Callable[..., Path], tmp_path: Path) -> None:
    run, out = make_run(), tmp_path / "controller.c"
    words = ("export", str(run), "--format", "c", "--out", str(out))
    outcome = call(*words, "--torque-limit", "1240 mNm", "--json")
    assert outcome.exit_code == 0, outcome.stderr
    data, source = json.loads(outcome.stdout), out.read_text(encoding="ascii")
    assert data["coefficients"]["torque_limit_nm"] == 1.24
    assert list(data["coefficients"].values()) == discrete_coefficients(CASCADES["butterworth"], PERIOD_S, 1.24).tolist()
    for line in (" * model:     g_a", " * run:       run", f" * command:   beltcomm export {run}"):
        assert line in source
    assert call(*words, answer="n\n").exit_code == 1
    assert "command:   beltcomm export" in out.read_text(encoding="ascii")
    assert call(*words, answer="").exit_code == 2
    assert out.read_text(encoding="ascii") == source
    assert call(*words, "--yes").exit_code == 0
    assert "BELTCOMM_C(3.1), /* torque_limit_nm */" in out.read_text(encoding="ascii")  # the motor's peak torque


def test_without_a_file_the_text_goes_to_stdout(make_run: Callable[..., Path]) -> None:
    outcome = call("export", str(make_run()), "--format", "st")
    assert outcome.exit_code == 0
    FunctionBlock(outcome.stdout)


def test_the_torque_limit_is_that_of_the_drive_when_the_run_knows_one(make_run: Callable[..., Path]) -> None:
    run = make_run()
    RunFolder.open(run).save("results", "drive", {"structure": STRUCTURE, "counts_per_rev": 65536, "peak_torque_nm": 2.5})
    assert api.export(run, "yaml").to_json()["coefficients"]["torque_limit_nm"] == 2.5


def test_what_the_drive_lacks_and_what_the_text_lacks_is_said(make_run: Callable[..., Path]) -> None:
    poor = CascadeStructure("cmmp-as", PERIOD_S, output_limit_rad_s=400.0, dead_zone_rad=1e-3)
    run = make_run(Cascade(0.1, 0.0, 8.0, 2e-3, filter_reference=True), poor, compensated=["cogging"], remarks=["it is slow"])
    text_ = " ".join(api.export(run, "c").to_json()["text"].replace("\n *", " ").split())
    for sentence in (
        "the drive cmmp-as has no torque feedforward: its coefficients are 0 here",
        "the drive cmmp-as has no filter of the reference velocity, which this text has: it behaves differently from that drive",
        "the drive cmmp-as has no prefilter: the one here passes the error on as it is",
        "there is no integrator (K_I is 0)",
        "bounds the output of its position controller to 400 rad/s; the text does not",
        "does not see position errors below 0.001 rad; the text does",
        "torque against cogging depends on place and speed and is not in this text",
        "it is slow",
        "the design is in doubt: no verification move was driven with these gains",
    ):
        assert sentence in text_


def test_the_encoder_s_text_is_written_for_the_run_s_encoder_and_sampling(make_run: Callable[..., Path], tmp_path: Path) -> None:
    run, out = make_run(), tmp_path / "encoder.st"
    outcome = call("export", str(run), "--format", "st", "--part", "encoder", "--tick", "11.9 ns", "--out", str(out), "--json")
    assert outcome.exit_code == 0, outcome.stderr
    values = json.loads(outcome.stdout)["coefficients"]
    assert values["increment_rad"] == pytest.approx(math.tau / load_axis("egc-70-600").motor.encoder_counts_per_rev)
    assert (values["period_s"], values["tick_s"]) == (PERIOD_S, 11.9e-9)
    assert values["lag_pole"] == pytest.approx(2.0 / 3.0)  # T_R of the design
    FunctionBlock(out.read_text(encoding="ascii"), "BELTCOMM_ENCODER")
    for words in (("--format", "dcf", "--part", "encoder"), ("--format", "c", "--tick", "1ns"), ("--format", "c", "--torque-limit", "1")):
        more = ("--part", "encoder") if "--torque-limit" in words else ()
        assert call("export", str(run), *words, *more).exit_code == 2, words
    assert call("export", str(run), "--format", "c", "--part", "encoder", "--tick", "2ms").exit_code == 2


def test_faults_are_named(make_run: Callable[..., Path], tmp_path: Path) -> None:
    empty = RunFolder.create(tmp_path / "empty", load_axis("egc-70-600")).path
    with pytest.raises(DataError, match=r"the design final is not in .*; make it with `beltcomm design"):
        api.export(empty, "c")
    with pytest.raises(DataError, match="does not exist"):
        api.export(tmp_path / "nowhere", "c")
    run = make_run()
    with pytest.raises(UsageError, match="no format 'pascal'; there are yaml, c, st"):
        api.export(run, "pascal")
    with pytest.raises(UsageError, match="torque limit is -1 N m"):
        api.export(run, "c", torque_limit_nm=-1.0)
    with pytest.raises(UsageError, match="is a folder"):
        api.export(run, "c", out=tmp_path)
    with pytest.raises(Refused, match="was left as it is"):
        api.export(run, "c", out=run / "axis.yaml")
    RunFolder.open(run).save("designs", "final", {"parameters": {"kp_nm_s_rad": 0.1}})
    with pytest.raises(DataError, match="damaged"):
        api.export(run, "c")
    outcome = call("export", str(run), "--format", "pascal")
    assert (outcome.exit_code, "'pascal' is not one of" in outcome.stderr) == (2, True)
