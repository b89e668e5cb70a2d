"""A session that was killed: found at the next connect, rolled back; by a real SIGKILL while the drive lives on in another process."""

from __future__ import annotations

import multiprocessing
import os
import signal
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from beltcomm import api
from beltcomm.axis import load_axis
from beltcomm.errors import UsageError
from beltcomm.experiments.supervised import supervise
from beltcomm.virtual.faults import Faults
from session.bench import Bench, Listener
from session.hardware import HardwareBench, Script

Connect = Callable[[Bench], Bench]
AXIS = "egc-70-600"
YES = api.Options(yes=True, seed=1, first_motion="4711")
LEFT = {"kp_nm_s_rad": 0.5, "ki_nm_rad": 7.0}


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state" / "beltcomm" / "unrestored"


def notes(state: Path) -> list[Path]:
    return list(state.glob("*.yaml"))


def cut_off(bench: Bench, run: Path) -> None:
    """A session that wrote gains and then was gone: nothing of it runs any more but what the system does for it."""
    with bench.open(bench.name) as drive:
        session = supervise(drive, bench.name, run, YES, Listener())
        session.__enter__()
        session.write(LEFT)
        assert session._note is not None
        session._note.release()  # as the system closes the files of a killed process
    assert {name: bench.parameters()[name] for name in LEFT} == pytest.approx(LEFT)


def creep(options: api.Options, talk: Listener) -> api.Result:
    return api.move("virtual:g_a", AXIS, 5e-3, options=options, talk=talk)


@pytest.mark.examination
def test_a_killed_session_is_found_and_rolled_back(connect: Connect, tmp_path: Path, state: Path) -> None:
    """SIGKILL in the second excitation, when new gains are in the drive: guarding stops the axis, the next command restores it."""
    bench = connect(HardwareBench())
    run = tmp_path / "run"
    before = bench.settings()  # switches the drive on
    here, there = multiprocessing.Pipe()

    def job() -> None:
        here.close()
        api.open_drive = bench.remote(there)
        api.identify(bench.name, AXIS, run, options=YES)

    process = multiprocessing.get_context("fork").Process(target=job)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of a fork beside threads; this child starts none
        process.start()
    there.close()

    def due() -> bool:
        return abs(bench.plant.velocity_rad_s) > 5.0 and (run / "recordings" / "amplitude_2.csv.part").exists()

    def kill() -> None:
        os.kill(process.pid or 0, signal.SIGKILL)
        process.join()

    assert bench.serve(here, due, kill)
    assert process.exitcode == -signal.SIGKILL
    assert bench.state == "OPERATION_ENABLED"
    bench.run_on(0.5)
    assert bench.state == "FAULT"
    assert bench.stands_disabled()
    assert bench.parameters()["kp_nm_s_rad"] != bench.initial["kp_nm_s_rad"]
    left = bench.settings()
    assert {name for name in before if left[name] != before[name]} >= {"6085h", "1016h:1"}  # borrowed by the record that was cut off
    (note,) = notes(state)
    assert str(run) in note.read_text(encoding="utf-8")

    talk = Script()
    assert creep(YES, talk).exit_code == 0
    said = "\n".join(talk.said)
    assert f"The run {run} ended without restoring this drive" in said
    assert "were rolled back and read back (--yes)" in said
    assert bench.parameters() == bench.initial  # limits that were lent to the record among them
    after = bench.settings()
    assert {name: after[name] for name in before} == before
    assert notes(state) == []
    assert "rolled back at a later connect" in (run / "journal.txt").read_text(encoding="utf-8")


def test_without_yes_it_is_offered_and_a_no_keeps_what_is_there(connect: Connect, tmp_path: Path, state: Path) -> None:
    bench = connect(HardwareBench())
    cut_off(bench, tmp_path / "run")
    talk = Script(answer=False)
    with pytest.raises(api.BeltcommError, match="nothing was moved, as you said"):
        creep(replace(YES, yes=False), talk)
    assert talk.asked == ["Roll them back now? Nothing moves.", "May the axis move like this?"]
    assert any("count as this drive's own from now on" in line for line in talk.said)
    assert bench.parameters()["kp_nm_s_rad"] == pytest.approx(0.5)
    assert notes(state) == []


def test_a_rollback_needs_no_offer_and_pays_the_debt(connect: Connect, tmp_path: Path, state: Path) -> None:
    bench = connect(HardwareBench())
    run = tmp_path / "run"
    folder = api.RunFolder.create(run, load_axis(AXIS))
    folder.save("results", "backup", {"drive": {}, "parameters": bench.parameters()})
    cut_off(bench, run)
    talk = Script()
    assert api.rollback("virtual:g_a", run, options=YES, talk=talk).exit_code == 0
    assert not any("ended without restoring" in line for line in talk.said)
    assert bench.parameters() == bench.initial
    assert notes(state) == []


def test_a_plan_that_is_only_shown_leaves_the_debt(connect: Connect, tmp_path: Path, state: Path) -> None:
    bench = connect(HardwareBench())
    cut_off(bench, tmp_path / "run")
    talk = Script()
    api.identify("virtual:g_a", AXIS, tmp_path / "other", options=replace(YES, dry_run=True), talk=talk)
    assert any("They stay as they are (--dry-run)" in line for line in talk.said)
    assert bench.parameters()["kp_nm_s_rad"] == pytest.approx(0.5)
    assert len(notes(state)) == 1


def test_a_drive_switched_off_since_then_owes_nothing(connect: Connect, tmp_path: Path, state: Path) -> None:
    bench = connect(HardwareBench())
    cut_off(bench, tmp_path / "run")
    bench.power_cycle()
    talk = Script()
    assert creep(YES, talk).exit_code == 0
    assert any("its settings are those from before all the same" in line for line in talk.said)
    assert notes(state) == []


def test_a_session_that_lives_is_not_rolled_back(connect: Connect, tmp_path: Path, state: Path) -> None:
    bench = connect(HardwareBench())
    with bench.open(bench.name) as drive, supervise(drive, bench.name, tmp_path / "run", YES, Listener()) as session:
        session.write(LEFT)
        with pytest.raises(UsageError, match="another session is at work on CMMP-AS"):
            creep(YES, Script())
    assert notes(state) == []


def test_a_state_folder_that_cannot_be_written_stops_before_the_drive_is_changed(
    connect: Connect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = connect(HardwareBench())
    (tmp_path / "file").write_text("", encoding="utf-8")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    with pytest.raises(UsageError, match="cannot be written"):
        creep(YES, Script())
    assert bench.plant.cart_position_m == 0.0


@pytest.mark.parametrize("mode", [0, 1])  # 0: where a drive starts, to which no command goes back
@pytest.mark.parametrize("restored", [True, False])
def test_a_command_that_fails_leaves_a_note_unless_it_restores(
    connect: Connect, tmp_path: Path, state: Path, mode: int, restored: bool
) -> None:
    bench = connect(HardwareBench(faults=Faults(readings={(0x6060, 0): mode})))
    assert ("6060h" in bench.settings()) == (mode != 0)

    def fails() -> None:
        with bench.open(bench.name) as drive, supervise(drive, bench.name, tmp_path / "run", YES, Listener()) as session:
            session.write(LEFT)
            assert len(notes(state)) == 1
            drive._objects.write(0x6060, 0, "int8", mode or 3)  # type: ignore[attr-defined]  # as a record in that mode does
            if restored:
                session.write({name: bench.initial[name] for name in LEFT})
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fails()
    assert len(notes(state)) == (not restored)
