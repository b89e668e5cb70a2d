"""Into the drive and back: raw and SI differences, backups by name and date, a small move before saving, files, and what is refused."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from beltcomm import api
from beltcomm.configfiles import read_yaml, to_yaml
from beltcomm.drive.objects import ObjectValue
from beltcomm.errors import DataError, ObjectLocked, Refused, UsageError
from beltcomm.export.dcf import dcf_text
from beltcomm.foreign.eds import _parse
from beltcomm.runfolder import RunFolder
from session.bench import Bench
from session.conftest import Complete
from session.test_commands import DRIVE, call, json_of

MakeBench = Callable[..., Bench]
Copy = Callable[..., Path]
YES = api.Options(yes=True, seed=3)


def test_the_table_tells_object_raw_and_si(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench()
    designed = RunFolder.open(run).load("designs", "final")["parameters"]
    dry = json_of(call("apply", *DRIVE, "--run", run, "--dry-run", "--json"))
    (gain,) = [one for one in dry["changes"] if one["name"] == "kp_nm_s_rad"]
    assert (gain["object"], gain["type"], gain["unit"], gain["raw_before"]) == ("2100h:1", "real32", "N m s/rad", pytest.approx(0.002))
    assert gain["value"] == pytest.approx(designed["kp_nm_s_rad"])
    shown = " ".join(call("apply", *DRIVE, "--run", run, "--dry-run").stdout.split())
    assert "raw, now -> then" in shown
    assert f"2100h:1 0.002 -> {gain['raw']:.6g}" in shown, "as the drive's real32 holds it"
    assert bench.parameters() == bench.initial


def test_rollback_to_any_backup(make_bench: MakeBench, copy_of_complete: Copy, tmp_path: Path) -> None:
    run, bench = copy_of_complete(), make_bench()
    api.apply(bench.name, run, options=YES)
    applied = bench.parameters()
    with bench.open(bench.name, {}) as drive:
        drive.write({"kp_nm_s_rad": 0.0123})
    by_hand = bench.parameters()
    api.rollback(bench.name, run, options=YES)
    assert bench.parameters() == bench.initial
    listed = call("rollback", "--run", run, "--backup", "list")
    assert listed.exit_code == 0
    rows = listed.stdout.splitlines()
    assert [row.split()[0] for row in rows[2:5]] == ["backup", "backup_1", "backup_2"]
    assert all(row.split()[1].startswith("20") and row.split()[2].count(":") == 2 for row in rows[2:5])
    assert "rollback to backup" in rows[4]
    api.rollback(bench.name, run, backup="backup_2", options=YES)
    assert bench.parameters() == by_hand
    elsewhere = tmp_path / "kept.yaml"
    shutil.copy(run / "results" / "backup_2.yaml", elsewhere)
    api.rollback(bench.name, run, options=YES)
    back = call("rollback", *DRIVE, "--run", run, "--backup", elsewhere, "--yes")
    assert back.exit_code == 0
    assert "rolled back to kept of 20" in back.stdout
    assert bench.parameters() == by_hand
    assert applied != by_hand
    with pytest.raises(UsageError, match=r"no backup backup_77, did you mean backup_\d"):
        api.rollback(bench.name, run, backup="backup_77", options=YES)
    assert bench.plant.cart_position_m == 0.0


@pytest.mark.parametrize("damaged", ["peak_torque_nm: nothing\n", "\0", "counts_per_rev: -5\n"])
def test_values_come_back_where_the_note_of_the_drive_is_damaged(make_bench: MakeBench, copy_of_complete: Copy, damaged: str) -> None:
    run, bench = copy_of_complete(), make_bench()
    api.apply(bench.name, run, options=YES)
    (run / "results" / "drive.yaml").write_text(damaged, encoding="utf-8")
    back = call("rollback", *DRIVE, "--run", run, "--yes")
    assert back.exit_code == 0, back.output
    assert bench.parameters() == bench.initial
    told = " ".join(back.output.split())
    assert "what the drive had when the run began is not known" in told
    assert "drive.yaml" in told


def test_a_backup_of_another_drive_is_refused(make_bench: MakeBench, copy_of_complete: Copy, tmp_path: Path) -> None:
    run, bench = copy_of_complete(), make_bench()
    other = read_yaml(run / "results" / "backup.yaml")
    other["drive"]["serial_number"] = "77"
    (tmp_path / "other.yaml").write_text(to_yaml(other), encoding="utf-8")
    with pytest.raises(UsageError, match=r"backup of another drive .*serial_number 77 ->"):
        api.rollback(bench.name, run, backup=str(tmp_path / "other.yaml"), options=YES)
    assert bench.parameters() == bench.initial


def test_rollback_of_an_old_run_unsets_what_it_did_not_know(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    """Backups of old runs have named values alone, and no low-pass (2100h:15): it was not there, so it is none again."""
    run, bench = copy_of_complete(), make_bench()
    with bench.open(bench.name, {}) as drive:
        before = drive.backup()
        drive.write({"prefilter_roll_off_rad_s": 900.0, "ff_advance_s": 0.001, "kp_nm_s_rad": 0.05})
    assert bench.parameters()["prefilter_roll_off_rad_s"] == 900.0
    old = read_yaml(run / "results" / "backup.yaml")
    parameters = {n: v for n, v in old["parameters"].items() if n not in ("prefilter_roll_off_rad_s", "ff_advance_s")}
    (run / "results" / "backup.yaml").write_text(to_yaml({"drive": old["drive"], "parameters": parameters}), encoding="utf-8")
    with pytest.raises(Refused, match=r"not as beltcomm wrote it.*--force"):
        api.rollback(bench.name, run, options=YES)
    api.rollback(bench.name, run, options=replace(YES, force=True))
    assert bench.parameters() == before


@pytest.mark.parametrize("damage", ["raw: 1e99", "type: uint99", "object: zzz"])
def test_a_damaged_object_in_a_backup_is_named(make_bench: MakeBench, copy_of_complete: Copy, damage: str) -> None:
    run, bench = copy_of_complete(), make_bench()
    path = run / "results" / "backup.yaml"
    saved = read_yaml(path)
    key, value = damage.split(": ")
    saved["objects"][0][key] = float(value) if key == "raw" else value
    path.write_text(to_yaml(saved), encoding="utf-8")
    with pytest.raises(DataError, match="is damaged"):
        api.rollback(bench.name, run, options=YES)
    assert bench.opened == 0


def test_a_backup_that_asks_for_a_locked_object_is_refused_whole(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench()
    path = run / "results" / "backup.yaml"
    saved = read_yaml(path)
    rated = [{"object": "6075h", "type": "uint32", "raw": 1.0}]
    path.write_text(to_yaml({**saved, "objects": saved["objects"] + rated}), encoding="utf-8")
    with bench.open(bench.name, {}) as drive:
        drive.write({"kp_nm_s_rad": 0.05})
    changed = bench.parameters()
    with pytest.raises(ObjectLocked, match=r"6075h is never written.*none of the settings that beltcomm backs up"):
        api.rollback(bench.name, run, options=YES)
    assert bench.parameters() == changed  # none of the others either


def file_of(tmp_path: Path, values: list[ObjectValue]) -> Path:
    path = tmp_path / "drive.dcf"
    path.write_text(dcf_text(values, {}), encoding="utf-8")
    return path


def test_the_design_goes_out_as_a_dcf_and_in_again(make_bench: MakeBench, copy_of_complete: Copy, tmp_path: Path) -> None:
    run, bench, path = copy_of_complete(), make_bench(), tmp_path / "design.dcf"
    assert call("export", run, "--format", "dcf", "--out", path).exit_code == 0
    assert _parse(path.read_bytes(), path).repairs == ()
    api.apply(bench.name, run, options=YES)
    applied = bench.parameters()
    api.rollback(bench.name, run, options=YES)
    done = call("apply", *DRIVE, "--run", run, "--dcf", path, "--yes")
    assert done.exit_code == 0, done.stderr
    assert "nothing had to be repaired" in done.stderr
    assert bench.parameters() == applied
    api.rollback(bench.name, run, options=YES)
    assert bench.parameters() == bench.initial


def test_a_file_writes_settings_only(make_bench: MakeBench, copy_of_complete: Copy, tmp_path: Path) -> None:
    run, bench = copy_of_complete(), make_bench()
    kept = [ObjectValue(0x6040, 0, "uint16", 15), ObjectValue(0x6071, 0, "int16", 500), ObjectValue(0x1010, 1, "uint32", 0x65766173)]
    kept += [ObjectValue(0x1800, 1, "uint32", 0x181), ObjectValue(0x5123, 0, "uint16", 1), ObjectValue(0x6072, 0, "uint16", 1500)]
    result = api.apply(bench.name, run, dcf=file_of(tmp_path, kept), options=replace(YES, dry_run=True))
    text = "\n".join(result.text)
    assert [one["object"] for one in result.data["changes"]] == ["6072h"]
    for words in ("left alone, for they are commands", "1010h:1, 6040h, 6071h", "beltcomm does not back them up: 1800h:1, 5123h"):
        assert words in text
    locked = file_of(tmp_path, [ObjectValue(0x6075, 0, "uint32", 1), *kept[:-1]])
    assert "6075h" in "\n".join(api.apply(bench.name, run, dcf=locked, options=replace(YES, dry_run=True)).text)
    assert api.apply(bench.name, run, dcf=locked, options=YES).data["changes"] == []
    assert bench.parameters() == bench.initial
    high = file_of(tmp_path, [ObjectValue(0x6072, 0, "uint16", 65535)])
    with pytest.raises(Refused, match=r"torque_limit_nm \(6072h\) would be 93.7.*motor.peak_torque_nm"):
        api.apply(bench.name, run, dcf=high, options=YES)
    assert bench.parameters() == bench.initial
    assert bench.state == "SWITCH_ON_DISABLED"
    same = file_of(tmp_path, [ObjectValue(0x6076, 0, "uint32", 1430), ObjectValue(0x6072, 0, "uint16", 1500)])
    assert api.apply(bench.name, run, dcf=same, options=YES).exit_code == 0  # what is locked stands there already
    with pytest.raises(UsageError, match="without --verify"):
        api.apply(bench.name, run, dcf=same, shown=True, options=YES)
    (tmp_path / "drive.dcf").write_bytes(b"\0nonsense")
    with pytest.raises(DataError, match="holds no object"):
        api.apply(bench.name, run, dcf=tmp_path / "drive.dcf", options=YES)


def test_a_small_move_shows_the_gains_before_they_are_saved(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench()
    data = json_of(call("apply", *DRIVE, "--run", run, "--yes", "--verify", "--save", "--json"))
    assert data["saved"]
    assert data["verdict"]["measured"]["dynamic_m"] < 1.5 * data["verdict"]["predicted"]["dynamic_m"] + 2e-4
    places = bench.plant.cart_m(0, len(bench.plant.torque_nm))
    assert np.ptp(places) == pytest.approx(0.05, abs=2e-3)
    designed = RunFolder.open(run).load("designs", "final")["parameters"]["kp_nm_s_rad"]
    assert bench.parameters()["kp_nm_s_rad"] == pytest.approx(designed, rel=1e-6)
    bench.power_cycle()
    assert bench.parameters()["kp_nm_s_rad"] == pytest.approx(designed, rel=1e-6)


def test_a_move_that_is_not_as_predicted_puts_everything_back(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    """The same raw gains mean a fifth in this drive: the lag is not the one predicted, and nothing is saved."""
    run, bench = copy_of_complete(), make_bench(gain_units=(1.0, 0.2, 1.0))
    path = run / "designs" / "final.yaml"
    design = read_yaml(path)
    design["parameters"] |= {"ff_velocity": 0.0}  # the position gain alone follows
    path.write_text(to_yaml(design), encoding="utf-8")
    with pytest.raises((Refused, Exception)) as caught:
        api.apply(bench.name, run, shown=True, options=replace(YES, force=True, apply="save"))
    assert "predicted" in str(caught.value) or "off its reference" in str(caught.value)
    assert bench.parameters() == bench.initial
    bench.power_cycle()
    assert bench.parameters() == bench.initial
    assert bench.stands_disabled()


def test_an_uncalibrated_drive_gets_no_gain(
    make_bench: MakeBench, complete: Complete, copy_of_complete: Copy, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, bench = copy_of_complete(), make_bench(profile="cmmp-as")
    monkeypatch.setattr(RunFolder, "claim_drive", lambda *_: None)
    path = run / "designs" / "final.yaml"
    design = read_yaml(path)
    design["parameters"]["ki_nm_rad"] = design["parameters"]["kp_nm_s_rad"] / 0.03
    path.write_text(to_yaml(design), encoding="utf-8")
    for options in (replace(YES, force=True), replace(YES, force=True, dry_run=True)):
        with pytest.raises(Refused, match=r"kp_nm_s_rad, kpp_1_s means in this kind of drive is not known.*`beltcomm calibrate"):
            api.apply(bench.name, run, options=options)
    assert bench.parameters() == bench.initial
    known = read_yaml(run / "results" / "drive.yaml")
    (run / "results" / "drive.yaml").write_text(to_yaml({**known, "uncalibrated": ["kp_nm_s_rad"]}), encoding="utf-8")
    with pytest.raises(Refused, match="no raw value can be given"):
        api.export(run, "dcf")
    (run / "results" / "drive.yaml").write_text(to_yaml({n: v for n, v in known.items() if n != "parameters"}), encoding="utf-8")
    with pytest.raises(DataError, match="of an older run"):
        api.export(run, "dcf")
