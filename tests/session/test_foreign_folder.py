"""Folders and files of strangers: nothing moves by them, nothing is written but what this drive's adapter keeps and this axis bears."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from beltcomm import api
from beltcomm.configfiles import read_yaml, sealed, to_yaml, unsealed
from beltcomm.errors import Declined, Refused, UsageError
from beltcomm.rundata.proof import doubts
from beltcomm.runfolder import RunFolder
from session.bench import Bench, Listener
from session.test_commands import DRIVE, call

MakeBench = Callable[..., Bench]
Copy = Callable[..., Path]
YES = api.Options(yes=True, seed=3)
FORCED = replace(YES, force=True)
#: What brings a drive into velocity mode and on.
DRIVES_OFF = (
    ("6060h", "int8", 3),
    ("60FFh", "int32", 100000),
    ("6040h", "uint16", 6),
    ("6040h", "uint16", 7),
    ("6040h", "uint16", 15),
)


def with_objects(run: Path, added: Sequence[tuple[str, str, float]], *, seal: bool = True) -> Path:
    """A backup that asks for other values or further objects, as a stranger who knows the checksum makes it."""
    path = run / "results" / "backup.yaml"
    saved, _ = unsealed(read_yaml(path))
    new = [{"object": title, "type": kind, "raw": raw} for title, kind, raw in added]
    kept = [entry for entry in saved["objects"] if entry["object"] not in {title for title, *_ in added}]
    saved["objects"] = kept + new
    path.write_text(to_yaml(sealed(saved) if seal else saved), encoding="utf-8")
    return path


@pytest.mark.parametrize("force", [False, True])
def test_a_rollback_moves_nothing(make_bench: MakeBench, copy_of_complete: Copy, force: bool) -> None:
    run, bench = copy_of_complete(), make_bench()
    before = bench.settings()
    with_objects(run, DRIVES_OFF)
    with pytest.raises(Refused, match=r"60FFh, 6040h are never written, for 60FFh is a command or a setpoint"):
        api.rollback(bench.name, run, options=replace(YES, force=force))
    assert bench.settings() == before
    assert bench.stands_disabled()
    assert bench.plant.cart_position_m == 0.0


@pytest.mark.parametrize(
    ("limit", "words"),
    [
        (("6080h", "uint32", 1e9), r"speed_limit_rad_s \(6080h\) would be 1.047e\+08.*motor.max_speed_rad_s"),
        (("6072h", "uint16", 65535), r"torque_limit_nm \(6072h\).*motor.peak_torque_nm"),
        (("6072h", "uint16", 0), "is possible above 0"),
        (("2100h:1", "real32", 1e30), r"kp_nm_s_rad \(2100h:1\) would be 1e\+30.*up to 1000"),
        (("2100h:3", "real32", -5.0), r"kpp_1_s \(2100h:3\) would be -5"),
        (("2100h:1", "uint16", 7), "2100h:1 holds one real32 in this drive, not 7 as uint16"),
        (("607Fh", "uint32", 7), "the drive has no"),
    ],
)
def test_a_rollback_keeps_the_ratings(make_bench: MakeBench, copy_of_complete: Copy, limit: tuple[str, str, float], words: str) -> None:
    run, bench = copy_of_complete(), make_bench()
    before = bench.settings()
    with_objects(run, [limit])
    try:
        result = api.rollback(bench.name, run, options=replace(YES, dry_run=True))
        assert words in "\n".join(result.text)
    except Refused:
        with pytest.raises(Refused, match=words):
            api.rollback(bench.name, run, options=FORCED)
    assert bench.settings() == before


def test_an_object_stands_once(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench()
    before = bench.settings()
    with_objects(run, [("2100h:1", "real32", 0.5), ("2100h:1", "real32", 0.25)])
    with pytest.raises(Refused, match="2100h:1 stands more than once"):
        api.rollback(bench.name, run, options=FORCED)
    assert bench.settings() == before


def test_without_ratings_a_limit_may_not_rise(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench()
    path = run / "axis.yaml"
    path.write_text("\n".join(line for line in path.read_text().splitlines() if "max_speed_rad_s" not in line), encoding="utf-8")
    (now,) = [raw for title, raw in bench.settings().items() if title == "6080h"]
    with_objects(run, [("6080h", "uint32", 2 * now)])
    with pytest.raises(Refused, match=r"axis.yaml does not state motor.max_speed_rad_s"):
        api.rollback(bench.name, run, options=YES)
    with_objects(run, [("6080h", "uint32", now // 2)])
    api.rollback(bench.name, run, options=YES)
    assert bench.settings()["6080h"] == now // 2


def test_an_edited_backup_is_shown_and_asked_for(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench()
    gain = bench.initial["kp_nm_s_rad"] if hasattr(bench, "initial") else bench.parameters()["kp_nm_s_rad"]
    with_objects(run, [("2100h:1", "real32", 0.5)], seal=False)
    with pytest.raises(Refused, match=r"backup.yaml is not as beltcomm wrote it; look through it, then use it with --force"):
        api.rollback(bench.name, run, options=YES)
    person = Listener(answer=False)
    with pytest.raises(Declined):
        api.rollback(bench.name, run, options=replace(YES, yes=False), talk=person)
    assert person.asked == ["Have you looked through it, and do you want it used?"]
    assert bench.parameters()["kp_nm_s_rad"] == gain
    willing = Listener(answer=True)
    api.rollback(bench.name, run, options=replace(YES, yes=False), talk=willing)
    assert len(willing.asked) == 2
    assert bench.parameters()["kp_nm_s_rad"] == 0.5


def test_an_edited_design_is_in_doubt(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench()
    path = run / "designs" / "final.yaml"
    path.write_text(path.read_text(encoding="utf-8").replace("ff_velocity: 1.0", "ff_velocity: 0.9"), encoding="utf-8")
    assert RunFolder.open(run).edited("designs", "final")
    with pytest.raises(Refused, match=r"final\.yaml was edited since"):
        api.apply(bench.name, run, options=YES)
    with pytest.raises(Refused, match=r"final.yaml of the run is not as beltcomm wrote it.*--force"):
        api.verify(bench.name, run, options=YES)
    assert bench.plant.cart_position_m == 0.0
    outcome = call("apply", *DRIVE, "--run", run, "--yes", "--force")
    assert outcome.exit_code == 0, outcome.stderr


def test_a_plan_by_hand_is_asked_for(make_bench: MakeBench, copy_of_complete: Copy, tmp_path: Path) -> None:
    run, bench, plan = copy_of_complete(), make_bench(), tmp_path / "plan.yaml"
    step = {"kind": "moves", "share": 1.0, "seconds": 60.0}
    plan.write_text(to_yaml({"reasons": {"belt": "because"}, "steps": [step]}), encoding="utf-8")
    with pytest.raises(Refused, match=r"plan.yaml is not as beltcomm wrote it.*--force"):
        api.follow(bench.name, run, plan, options=YES)
    plan.write_text(to_yaml(sealed({"reasons": {"belt": "because"}, "steps": [step] * 60})), encoding="utf-8")
    with pytest.raises(Refused, match=r"up to \d{4} s, and --yes answers for 900 s at most.*--longest \d{4}s"):
        api.follow(bench.name, run, plan, options=YES)
    asked = Listener(answer=False)
    with pytest.raises(Declined):
        api.follow(bench.name, run, plan, options=replace(YES, yes=False), talk=asked)
    assert asked.asked == ["May the axis move like this?"]
    plan.write_text(to_yaml(sealed({"reasons": {"belt": "because"}, "steps": [step] * 101})), encoding="utf-8")
    with pytest.raises(UsageError, match="has 101 steps; a plan has at most 100"):
        api.follow(bench.name, run, plan, options=YES)
    assert bench.plant.cart_position_m == 0.0


def test_what_the_tool_wrote_is_whole(copy_of_complete: Copy) -> None:
    folder = RunFolder.open(copy_of_complete())
    names = [(kind, name) for kind in ("designs", "results") for name in folder.names(kind)]
    assert {("designs", "final"), ("results", "backup"), ("results", "plan")} <= set(names)
    assert not [(kind, name) for kind, name in names if folder.edited(kind, name)]
    assert not [name for name in folder.names("results") if "checksum" in folder.load("results", name)]


def test_what_the_gains_mean_is_summed_too(copy_of_complete: Copy) -> None:
    folder = RunFolder.open(copy_of_complete())
    before = doubts(folder)
    folder.save("results", "calibration", {"kind": "x"})
    assert doubts(folder) == before
    (folder.path / "results" / "calibration.yaml").write_text("kind: y\n", encoding="utf-8")
    assert doubts(folder) == [*before, "calibration.yaml was edited since, or is of a version that kept no checksum"]
