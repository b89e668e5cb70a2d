"""A CiA 402 drive whose gains nobody can write: its own loop carries the job, which ends with what a person types in."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import can
import pytest

from beltcomm import api
from beltcomm.configfiles import find_config
from beltcomm.drive.parameters import GAIN_NAMES
from beltcomm.errors import Refused
from beltcomm.rundata.proof import doubts
from beltcomm.runfolder import RunFolder
from session.bench import Bench, Listener
from session.conftest import Complete

YES = {"yes": True, "position_m": 0.25, "report": False}


def typed_in(bench: Bench, gains: dict[str, float]) -> None:
    """What a person does with the maker's tool: into 2100h, whose subindices are in the order of GAIN_NAMES (docs/reference-drive.md)."""
    with bench.open(bench.name):
        pass
    for subindex, name in enumerate(GAIN_NAMES, start=1):
        whole = name in ("prefilter_kind", "filter_reference")
        value = struct.pack("<B3x", int(gains[name])) if whole else struct.pack("<f", gains[name])
        data = (b"\x2f" if whole else b"\x23") + struct.pack("<HB", 0x2100, subindex) + value
        bench._bus.send(can.Message(arbitration_id=0x601, data=data, is_extended_id=False))


def whole(result: api.Result) -> str:
    """All that a command says."""
    return "\n".join(map(str, (*result.text, *result.details)))


@pytest.fixture
def profile(tmp_path: Path) -> str:
    """A profile of one's own: the shipped one of any CiA 402 drive, and that this one has a notch."""
    file = tmp_path / "acme.yaml"
    shipped = find_config("drives", "cia402").read_text(encoding="utf-8")
    file.write_text(shipped.replace("prefilters: [none]", "prefilters: [none, notch]"), encoding="utf-8")
    return str(file)


def test_the_plan_says_beforehand_that_gains_are_not_written(make_bench: Callable[..., Bench], tmp_path: Path) -> None:
    bench = make_bench("g_a", profile="cia402")
    result = api.commission(bench.name, "egc-70-600", tmp_path / "run", options=api.Options(dry_run=True, quick=True))
    said = " ".join(whole(result).split())
    assert "gains cannot be written" in said


@pytest.mark.examination
def test_the_job_ends_with_model_design_move_and_what_to_type(
    make_bench: Callable[..., Bench], tmp_path: Path, profile: str, complete: Complete
) -> None:
    bench = make_bench("g_a", profile=profile)
    tuned = complete.folder.load("designs", "final")["parameters"]
    typed_in(bench, tuned)
    run = tmp_path / "run"
    result = api.commission(bench.name, "egc-70-600", run, options=api.Options(quick=True, **YES), talk=Listener())
    text = whole(result)
    assert "To be typed into the maker's tool" in text
    folder = RunFolder.open(run)
    assert {"own_move", "sweep"} <= set(folder.finished_names())
    assert result.data["verdict"].passed
    assert result.data["model"]["parameters"]["cart.mass"]["value"] == pytest.approx(13.44, rel=0.02)
    assert "no verification move was driven with these gains" in doubts(folder)  # those of the design were not
    with pytest.raises(Refused, match=r"typed into the maker's tool"):
        api.apply(bench.name, run, options=api.Options(yes=True, force=True))
    # with other gains than those of the design the move tells, and with those of the design, typed in, too
    other = api.verify(bench.name, run, options=api.Options(**YES), talk=Listener())
    assert "not what stands in it" in whole(other)
    assert "no verification move was driven with these gains" in doubts(folder)
    typed_in(bench, folder.load("designs", "final")["parameters"])
    verified = api.verify(bench.name, run, options=api.Options(**YES), talk=Listener())
    assert "did as predicted" in whole(verified)
    bench.profile = None
    assert bench.parameters()["kp_nm_s_rad"] == pytest.approx(folder.load("designs", "final")["parameters"]["kp_nm_s_rad"])


@pytest.mark.examination
def test_a_loop_that_does_not_follow_ends_with_model_and_design_too(make_bench: Callable[..., Bench], tmp_path: Path) -> None:
    bench = make_bench("g_a", profile="cia402")
    run = tmp_path / "run"
    result = api.commission(bench.name, "egc-70-600", run, options=api.Options(quick=True, **YES), talk=Listener())
    assert result.exit_code == 1
    text = whole(result)
    assert "own loop was not used" in text
    assert "To be typed into the maker's tool" in text
    assert bench.stands_disabled()


@pytest.mark.examination
def test_a_p_pi_drive_of_unknown_units_travels_by_what_the_host_sends_along(make_bench: Callable[..., Bench], tmp_path: Path) -> None:
    """Gains of unknown unit, 60B1h and 60B2h, no filter against the resonance: a loop so weak moves the carriage only because friction and
    inertia are sent along with its reference."""
    file = tmp_path / "ppi.yaml"
    gains = "".join(
        f"  {name}: {{index: 0x2100, subindex: {number}, type: real32, scale: {scale}}}\n"
        for number, name, scale in ((1, "kp_nm_s_rad", 0.5), (2, "ki_nm_rad", 3.0), (3, "kpp_1_s", 2.0), (13, "ff_velocity", 1.0))
    )
    file.write_text(f"name: ppi\ntitle: P-PI\ngain_meaning: unconfirmed\nparameters:\n{gains}", encoding="utf-8")
    bench = make_bench("g_a", profile=str(file))
    run = tmp_path / "run"
    result = api.commission(bench.name, "egc-70-600", run, options=api.Options(quick=True, **YES), talk=Listener())
    design = RunFolder.open(run).load("designs", "final")["parameters"]
    assert design["kp_nm_s_rad"] < 0.01
    verdict = result.data["verdict"]
    low, high = verdict.predicted_range
    assert low.dynamic_m <= verdict.measured.dynamic_m <= high.dynamic_m
    assert verdict.measured.dynamic_m < 1e-3
    sweep = RunFolder.open(run).recording("sweep")
    assert sweep.torque_offset is not None
    assert max(abs(sweep.torque_offset)) > 0.1  # the friction of the axis at least
    assert bench.stands_disabled()
