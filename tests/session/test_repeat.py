"""The same run twice; a run that goes on where it was broken off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from beltcomm import api
from beltcomm import pages as reporting
from beltcomm.axis import load_axis
from beltcomm.drive.parameters import GAIN_NAMES
from beltcomm.errors import Refused, UsageError
from beltcomm.result import Result as Answer
from beltcomm.runfolder import RunFolder
from frames import FrameHash
from session.bench import Bench, Listener
from session.conftest import SEED, Complete
from session.test_commands import DRIVE, call, json_of

MakeBench = Callable[..., Bench]
Copy = Callable[..., Path]


def contents(run: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted((run / "recordings").iterdir())}


@pytest.mark.usefixtures("fitted")
def test_one_seed_gives_one_run_to_the_byte(make_bench: MakeBench, tmp_path: Path) -> None:
    def identify(run: str, seed: int) -> tuple[str, dict[str, bytes]]:
        bench, frames = make_bench(), FrameHash()
        bench.log = frames
        api.identify(bench.name, "egc-70-600", tmp_path / run, options=api.Options(yes=True, seed=seed))
        return frames.hexdigest(), contents(tmp_path / run)

    first, again = identify("first", 7), identify("again", 7)
    assert first[1].keys() >= {"amplitude_1.csv", "amplitude_1.yaml", "frf_1.csv", "frf_1.yaml"}
    assert first == again


@pytest.mark.usefixtures("fitted")
def test_a_run_broken_off_goes_on_without_repeating_what_is_finished(make_bench: MakeBench, tmp_path: Path) -> None:
    run, bench = tmp_path / "run", make_bench()
    seen: list[str] = []

    def stop_in_the_second_record(_phase: int, _fraction: float) -> None:
        seen[:] = [path.name for path in (run / "recordings").glob("*.csv")]
        if seen:
            raise KeyboardInterrupt

    options = api.Options(yes=True, seed=3)
    with pytest.raises(KeyboardInterrupt):
        api.identify(bench.name, "egc-70-600", run, options=options, talk=Listener(at_progress=stop_in_the_second_record))
    assert seen == ["amplitude_1.csv"]
    assert RunFolder.open(run).unfinished() == ["amplitude_2"]
    kept = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in (run / "recordings").glob("amplitude_1.*")}
    broken_off = (run / "recordings" / "amplitude_2.csv.part").read_bytes()
    assert broken_off.count(b"\n") >= 200

    talk = Listener()
    result = api.identify(bench.name, "egc-70-600", run, options=replace(options, resume=True), talk=talk)
    assert result.exit_code == 0, "\n".join(result.lines())
    assert {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in kept} == kept
    assert "amplitude_1: kept from the earlier run" in talk.said
    # rows once measured are not thrown away
    assert (run / "recordings" / "amplitude_2.unfinished1.csv.part").read_bytes() == broken_off
    folder = RunFolder.open(run)
    assert folder.unfinished() == []
    assert {"amplitude_1", "amplitude_2", "frf_1"} <= set(folder.finished_names())
    assert len(folder.recordings()) == len(folder.finished_names())
    assert bench.parameters() == bench.initial


@pytest.mark.usefixtures("fitted")
def test_a_finished_run_repeats_nothing_and_is_told_in_one_json_object(
    make_bench: MakeBench, copy_of_complete: Copy, complete: Complete, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = {"data_sheet_words": [], "data_sheet": []}
    monkeypatch.setattr(reporting, "report", lambda run: Answer({"page": str(run / "report.html"), **known}, []))
    run, bench = copy_of_complete(), make_bench()
    before = contents(run)
    outcome = call("commission", *DRIVE, "--yes", "--run", run, "--resume", "--json")
    data = json_of(outcome)
    assert contents(run) == before
    assert data["verdict"]["passed"] is True
    assert data["verdict"]["measured"] == complete.result.to_json()["verdict"]["measured"]
    assert data["model"]["parameters"]["cart.mass"]["value"] == pytest.approx(13.44, rel=0.03)
    assert {"run", "machine_seconds", "remarks", "model", "fit", "friction", "design", "verdict"} <= set(data)
    assert data["page"].endswith("report.html")
    assert "[8/9] verification move" in outcome.stderr
    assert bench.now_s < 10.0  # the sign check and the way to the start of the move at most


@pytest.mark.examination
@pytest.mark.parametrize("changed", ["payload", "gains"])
@pytest.mark.usefixtures("fitted")
def test_a_move_driven_with_another_design_is_no_proof(make_bench: MakeBench, copy_of_complete: Copy, changed: str) -> None:
    """It is driven again; and the new gains stay when that is asked for."""
    run, bench = copy_of_complete(), make_bench()
    options = api.Options(yes=True, seed=SEED, resume=True, payload_kg=30.0 if changed == "payload" else None)
    if changed == "gains":  # the record was driven with another K_P
        options = replace(options, apply="save")
        note = run / "recordings" / "move_1.yaml"
        data = yaml.safe_load(note.read_text(encoding="utf-8"))
        data["controller"]["gains"]["kp_nm_s_rad"] *= 1.01
        note.write_text(yaml.safe_dump(data), encoding="utf-8")
    before = contents(run)
    result = api.commission(bench.name, "egc-70-600", run, options=options)
    folder = RunFolder.open(run)
    assert {"move_1", "move_2"} <= set(folder.finished_names())
    assert before.items() <= contents(run).items()
    designed = folder.load("designs", "final")["parameters"]
    assert folder.recording("move_2").sidecar.controller["gains"] == pytest.approx(designed)
    assert folder.load("results", "verify_move_2")["proof"]["further_payloads_kg"] == ([30.0] if changed == "payload" else [])
    if changed == "gains":
        assert result.exit_code == 0, "\n".join(result.lines())
        check_saved(bench, run, designed)


def check_saved(bench: Bench, run: Path, designed: dict[str, float]) -> None:
    """The designed gains and nothing else are in the drive, beyond power-off, until the backup of the run folder is written back."""
    now = bench.parameters()
    for name, value in designed.items():
        assert now[name] == pytest.approx(value, rel=1e-6)  # REAL32
    assert {n: v for n, v in now.items() if n not in GAIN_NAMES} == {n: v for n, v in bench.initial.items() if n not in GAIN_NAMES}
    assert bench.stands_disabled()
    bench.power_cycle()
    assert bench.parameters() == now
    api.rollback(bench.name, run, options=api.Options(yes=True, apply="save"))
    assert bench.parameters() == bench.initial
    bench.power_cycle()
    assert bench.parameters() == bench.initial


@pytest.mark.examination
def test_another_axis_is_not_the_run_that_was_begun(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench()
    axis = load_axis("egc-70-600")
    faster = replace(axis, limits=replace(axis.limits, speed_m_s=4.0))
    with pytest.raises(UsageError, match=r"the axis has changed .*limits\.speed_m_s 5\.0 -> 4\.0.*begin a new run"):
        api.commission(bench.name, faster, run, options=api.Options(yes=True, resume=True))
    assert bench.parameters() == bench.initial


def test_another_drive_is_not_that_of_the_run(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run = copy_of_complete()
    bench = make_bench(profile="cmmp-as")
    with pytest.raises(UsageError, match=r"made on another drive .*beltcomm reference drive -> CMMP-AS"):
        api.commission(bench.name, "egc-70-600", run, options=api.Options(yes=True, resume=True))
    assert bench.parameters() == bench.initial


@pytest.mark.examination
def test_another_plant_is_not_the_machine_of_the_run(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench("g_b")
    with pytest.raises(UsageError, match=r"made on another drive .*plant g_a -> g_b.*begin a new run"):
        api.commission(bench.name, "egc-70-600", run, options=api.Options(yes=True, resume=True))
    assert bench.parameters() == bench.initial


@pytest.mark.parametrize("seen", ["motion", "breakaway"])
@pytest.mark.usefixtures("fitted")
def test_a_payload_taken_off_since_is_seen_before_a_loop_is_closed(make_bench: MakeBench, copy_of_complete: Copy, seen: str) -> None:
    """The same drive with another load; or, told by the record of the first session alone, with other friction."""
    run, bench = copy_of_complete("frf_2"), make_bench("g_b", name="virtual:g_a") if seen == "motion" else make_bench()
    if seen == "breakaway":
        RunFolder.open(run).save("results", "breakaway", {"coulomb_nm": 0.05})
    what = "the motor" if seen == "motion" else "the breakaway torque is .* before it was 0.05 N m"
    talk = Listener()
    with pytest.raises(Refused, match=f"cannot be resumed: {what}.*begin a new run"):
        api.commission(bench.name, "egc-70-600", run, options=api.Options(yes=True, resume=True), talk=talk)
    assert talk.phases[-1][0] == 2
    assert bench.parameters() == bench.initial
    assert bench.stands_disabled()


@pytest.mark.usefixtures("fitted")
def test_the_first_excitation_is_not_repeated_where_a_run_on_would_leave_the_travel(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    """10 mm from an end, where a carriage would pass it under the torque of then if the computer died."""
    run, bench = copy_of_complete("frf_2"), make_bench(start_m=0.0)
    before = contents(run)
    with pytest.raises(Refused, match=r"cannot be resumed from here: .*if the computer dies allows .*to 0\.2500 m, where the run"):
        api.commission(bench.name, "egc-70-600", run, options=api.Options(yes=True, resume=True))
    assert contents(run) == before
    assert abs(bench.plant.cart_m(0, round(bench.now_s / 1e-3))).max() < 8e-3  # it crept only
    assert bench.parameters() == bench.initial


def test_there_is_nothing_to_go_on_with(make_bench: MakeBench, tmp_path: Path) -> None:
    bench = make_bench()
    with pytest.raises(UsageError, match="does not exist; check --run or leave --resume out"):
        api.commission(bench.name, "egc-70-600", tmp_path / "none", options=api.Options(yes=True, resume=True))
    assert not (tmp_path / "none").exists()
