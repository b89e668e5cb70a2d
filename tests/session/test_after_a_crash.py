"""What the next commands find after a session that was killed, on each kind of drive: all goes back, nothing owed is forgotten."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest

from beltcomm import api, journal
from beltcomm.axis import load_axis
from beltcomm.errors import BeltcommError, Refused, SafetyStop, UsageError
from beltcomm.experiments.options import claim, new_folder
from beltcomm.experiments.supervised import supervise
from beltcomm.machine.machine import Machine
from beltcomm.rundata import backups
from beltcomm.rundata.calibration import RESULT
from beltcomm.virtual.faults import Faults
from session.bench import Bench, Listener
from session.hardware import HardwareBench, Script

Connect = Callable[[Bench], Bench]
AXIS = "egc-70-600"
YES = api.Options(yes=True, seed=1, first_motion="4711")


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state" / "beltcomm" / "unrestored"


def killed(bench: Bench, run: Path, options: api.Options) -> None:
    """A session of a run whose limits were lowered, and of which nothing runs any more: the drive's loans stay as they are."""
    session = supervise(bench.open(bench.name), bench.name, run, options, Listener())
    session.__enter__()
    machine = Machine(session, load_axis(AXIS), new_folder(run, load_axis(AXIS), session, options, Listener()), Listener())
    before = session.backup()
    session.write({name: 0.8 * before[name] for name in ("torque_limit_nm", "speed_limit_rad_s")})
    assert session._note is not None
    session._note.release()
    machine._occupied.close()


@pytest.mark.parametrize("profile", ["reference", "cmmp-as"])
@pytest.mark.parametrize("command", ["move", "rollback"])
def test_all_that_was_lent_goes_back(connect: Connect, tmp_path: Path, state: Path, profile: str, command: str) -> None:
    """Enable logic and speed unit of a CMMP-AS are as the killed session left them, and so look as if nobody had changed them."""
    bench = connect(HardwareBench(profile=profile))
    options, run = replace(YES, profile=profile, force=True), tmp_path / "run"
    before = bench.settings()
    killed(bench, run, options)
    assert bench.settings() != before
    if command == "move":
        assert api.move(bench.name, AXIS, 5e-3, options=options, talk=Script()).exit_code == 0
    else:
        assert api.rollback(bench.name, run, options=options, talk=Script()).exit_code == 0
    found = bench.settings()
    assert {name: found.get(name) for name in before} == before
    assert not list(state.glob("*.yaml"))


def test_a_mode_that_the_drive_has_no_more_goes_back_all_the_same(connect: Connect, tmp_path: Path, state: Path) -> None:
    modes: dict[tuple[int, int], float] = {(0x6060, 0): 8}
    bench = connect(HardwareBench(faults=Faults(readings=modes)))
    bench.settings()
    session = supervise(bench.open(bench.name), bench.name, tmp_path / "run", YES, Listener())
    session.__enter__()
    session.write({"kp_nm_s_rad": 0.5})
    assert session._note is not None
    session._note.release()
    modes[0x6060, 0] = 0
    bench.power_cycle()
    bench.run_on(0.5)
    with suppress(BeltcommError):  # what this drive, which tells a mode that it has not, makes of it
        api.move(bench.name, AXIS, 5e-3, options=YES, talk=Script())
    assert not list(state.glob("*.yaml")), "what is owed was put back, and no command is held up by it"


@pytest.mark.parametrize("way", ["dry run", "no", "edited"])
def test_a_rollback_that_wrote_nothing_forgets_nothing(connect: Connect, tmp_path: Path, state: Path, way: str) -> None:
    bench = connect(HardwareBench())
    bench.settings()
    run = tmp_path / "run"
    folder = api.RunFolder.create(run, load_axis(AXIS))
    with bench.open(bench.name) as drive:
        backups.keep_first(folder, drive)
    session = supervise(bench.open(bench.name), bench.name, run, YES, Listener())
    session.__enter__()
    session.write({"kp_nm_s_rad": 0.5})
    assert session._note is not None
    session._note.release()
    if way == "edited":
        file = run / "results" / "backup.yaml"
        file.write_text(file.read_text(encoding="utf-8") + "extra: 1\n", encoding="utf-8")
    options = {"dry run": replace(YES, dry_run=True), "no": replace(YES, yes=False), "edited": YES}[way]
    if way == "dry run":
        api.rollback(bench.name, run, options=options, talk=Script())
    else:
        with pytest.raises(Refused):
            api.rollback(bench.name, run, options=options, talk=Script(answer=False))
    assert bench.parameters()["kp_nm_s_rad"] == pytest.approx(0.5)
    assert len(list(state.glob("*.yaml"))) == 1


def test_a_full_disk_at_the_end_hides_neither_the_stop_nor_the_run(
    connect: Connect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = connect(HardwareBench())
    before, run, axis = bench.parameters(), tmp_path / "run", load_axis(AXIS)

    def full(path: Path, _line: str) -> None:
        raise UsageError(f"{path} cannot be written: No space left on device")

    def session_that_stops() -> None:
        with (
            bench.open(bench.name) as drive,
            supervise(drive, bench.name, run, YES, Listener()) as session,
            Machine(session, axis, new_folder(run, axis, session, YES, Listener()), Listener()),
        ):
            session.write({"kp_nm_s_rad": 0.5})
            monkeypatch.setattr(journal, "_append", full)
            raise SafetyStop("too far", "position")

    with pytest.raises(SafetyStop, match="too far"):
        session_that_stops()
    monkeypatch.undo()
    assert bench.parameters() == before
    with api.RunFolder.open(run).occupy(Listener()):
        pass  # nobody holds it any more


def test_an_edited_calibration_is_asked_for_before_any_gain_is_meant_by_it(connect: Connect, tmp_path: Path) -> None:
    bench = connect(HardwareBench(profile="cmmp-as"))
    bench.settings()
    options = replace(YES, profile="cmmp-as")
    folder = api.RunFolder.create(tmp_path / "run", load_axis(AXIS))
    folder.save("results", RESULT, {"kind": "cmmp-as", "rated_torque_nm": 1.43, "rated_current_a": 2.0, "units": {}})
    file = folder.file("results", RESULT)
    with bench.open(bench.name) as drive:
        claim(folder, drive.capabilities, options, Listener())
        file.write_text(file.read_text(encoding="utf-8").replace("1.43", "1.44"), encoding="utf-8")
        with pytest.raises(Refused, match=r"calibration\.yaml is not as beltcomm wrote it"):
            claim(folder, drive.capabilities, options, Listener())
        claim(folder, drive.capabilities, replace(options, force=True), Listener())
