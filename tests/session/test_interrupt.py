"""Ctrl-C in every phase: a stopped and restored drive, exit code 4, nothing lost."""

from __future__ import annotations

import re
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from beltcomm.cli import talk
from beltcomm.cli.main import cli, twice_leaves
from beltcomm.errors import LeaveNow
from beltcomm.model import load_model
from beltcomm.runfolder import RunFolder
from beltcomm.virtual.bus import Frame
from beltcomm_adapters.interrupts import deferred_interrupt
from session.bench import Bench, Listener
from session.conftest import Complete

MakeBench = Callable[..., Bench]
Copy = Callable[..., Path]


def commission(run: Path, listener: Listener, monkeypatch: pytest.MonkeyPatch, *words: str) -> Result:
    monkeypatch.setattr(talk, "terminal_talk", lambda *_options: listener)
    return CliRunner().invoke(
        cli, ["commission", "--drive", "virtual:g_a", "--run", str(run), "--resume", "--yes", "--no-report", "--seed", "1", *words]
    )


def writes_gain(frame: Frame) -> bool:
    """Whether the host writes K_I (2100h:2) just now; K_P is new already, the rest is not."""
    return frame[2][:4] == b"\x23\x00\x21\x02"


def state_after(bench: Bench, run: Path) -> dict[str, bytes]:
    """What the drive must be and what the folder holds after an interruption."""
    assert bench.stands_disabled()
    assert bench.parameters() == bench.initial
    return {path.name: path.read_bytes() for path in (run / "recordings").glob("*.csv")}


@pytest.mark.parametrize(
    ("phase", "missing", "begun", "speed_rad_s"),
    [
        (2, "amplitude_1", "", 0.5),  # creeping
        (3, "amplitude_2", "amplitude_2", 5.0),
        (6, "sweep", "sweep", 60.0),
        (8, "move_1", "move_1", 95.0),
    ],
)
@pytest.mark.usefixtures("fitted")
def test_ctrl_c_while_the_axis_moves(
    make_bench: MakeBench,
    copy_of_complete: Copy,
    complete: Complete,
    monkeypatch: pytest.MonkeyPatch,
    phase: int,
    missing: str,
    begun: str,
    speed_rad_s: float,
) -> None:
    """In the last move, model and design are there, for `beltcomm verify` or `apply`."""
    run, bench = copy_of_complete(missing), make_bench(start_m=0.2)
    model, design = run / "models" / "final.yaml", run / "designs" / "final.yaml"
    if phase == 8:
        model.unlink()
        design.unlink()
    before = {name: (run / "recordings" / f"{name}.csv").read_bytes() for name in complete.folder.finished_names() if name != missing}

    def arm(index: int) -> None:
        if index == phase:
            bench.interrupt_when(bench.faster_than(speed_rad_s))

    outcome = commission(run, Listener(at_phase=arm), monkeypatch)
    assert bench.signals == 1
    assert outcome.exit_code == 4
    said, *_, again = outcome.stderr.strip().splitlines()
    assert said == (
        f"beltcomm: interrupted; the axis is stopped and the drive's own gains are restored; what was recorded is kept in {run}"
    )
    assert again.startswith("    beltcomm commission ")
    assert again.endswith(f" --run {run} --resume")
    assert outcome.stdout == ""
    bench.check_stop(run)
    assert state_after(bench, run) == {f"{name}.csv": data for name, data in before.items()}
    assert RunFolder.open(run).unfinished() == ([begun] if begun else [])
    if phase == 3:
        assert rows_kept(run, begun)[0]
    assert load_model(model)["cart.mass"] == complete.final.fit.model["cart.mass"]
    assert RunFolder.open(run).load("designs", "final")["parameters"]["kp_nm_s_rad"] > 0.0


def rows_kept(run: Path, name: str) -> tuple[list[str], int]:
    """Rows of a record that was broken off, as many as the journal tells, and how many were planned."""
    header, *rows = (run / "recordings" / f"{name}.csv.part").read_text(encoding="utf-8").splitlines()
    assert all(len(row.split(",")) == len(header.split(",")) for row in rows)
    assert "finished: false" in (run / "recordings" / f"{name}.yaml").read_text(encoding="utf-8")
    found = re.search(rf"{name}: interrupted after (\d+) of (\d+) samples", (run / "journal.txt").read_text(encoding="utf-8"))
    assert found is not None
    assert len(rows) == int(found[1])
    return rows, int(found[2])


@pytest.mark.usefixtures("fitted")
def test_ctrl_c_in_a_record_keeps_its_rows(make_bench: MakeBench, copy_of_complete: Copy, monkeypatch: pytest.MonkeyPatch) -> None:
    run, bench = copy_of_complete("amplitude_1"), make_bench(start_m=0.2)

    def interrupt(index: int, fraction: float) -> None:
        if index == 3 and fraction > 0.2 and (run / "recordings" / "amplitude_1.csv.part").exists():
            raise KeyboardInterrupt

    listener = Listener(at_progress=interrupt)
    assert commission(run, listener, monkeypatch).exit_code == 4
    assert "amplitude_1.csv" not in state_after(bench, run)
    rows, planned = rows_kept(run, "amplitude_1")
    assert len(rows) == round(listener.fractions[-1] * planned)


@pytest.mark.usefixtures("fitted")
def test_ctrl_c_before_the_first_motion(make_bench: MakeBench, copy_of_complete: Copy, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the calculation before the last moves: ``test_going_on``."""
    run, bench = copy_of_complete(), make_bench()

    def interrupt(index: int) -> None:
        if index == 1:
            raise KeyboardInterrupt

    listener = Listener(at_phase=interrupt)
    assert commission(run, listener, monkeypatch).exit_code == 4
    assert len(listener.phases) == 1
    assert len(state_after(bench, run)) == 12


@pytest.mark.examination
@pytest.mark.usefixtures("fitted")
def test_ctrl_c_between_two_gains_leaves_the_old_ones(
    make_bench: MakeBench, copy_of_complete: Copy, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, bench = copy_of_complete(), make_bench()
    listener = Listener(at_phase=lambda index: bench.interrupt_when(writes_gain) if index == 5 else None)
    assert commission(run, listener, monkeypatch, "--apply", "keep").exit_code == 4
    assert bench.signals == 1
    state_after(bench, run)


@pytest.mark.usefixtures("fitted")
def test_a_second_ctrl_c_does_not_keep_the_drive_from_being_restored(
    make_bench: MakeBench, copy_of_complete: Copy, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An impatient user: the second one comes while the gains are written back."""
    run, bench = copy_of_complete("move_1"), make_bench()

    def interrupt(index: int, _fraction: float) -> None:
        if index == 8:
            bench.interrupt_when(writes_gain)
            raise KeyboardInterrupt

    assert commission(run, Listener(at_progress=interrupt), monkeypatch).exit_code == 4
    assert bench.signals == 1
    state_after(bench, run)


@pytest.mark.usefixtures("fitted")
def test_ctrl_c_while_a_question_is_asked(make_bench: MakeBench, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    bench, listener = make_bench(), Listener()

    def confirm(_text: str) -> bool:
        raise KeyboardInterrupt

    monkeypatch.setattr(listener, "confirm", confirm)
    monkeypatch.setattr(talk, "terminal_talk", lambda *_options: listener)
    outcome = CliRunner().invoke(cli, ["commission", "--drive", "virtual:g_a", "--run", str(tmp_path / "run")])
    assert outcome.exit_code == 4
    assert state_after(bench, tmp_path / "run") == {}
    assert bench.plant.cart_position_m == 0.0


def quick_stop(frame: Frame) -> bool:
    """Whether the host commands a quick stop in its setpoint frame."""
    return frame[1] == 0x201 and frame[2][:2] == b"\x02\x00"


@pytest.mark.usefixtures("fitted")
def test_two_ctrl_c_within_two_seconds_leave_at_once_with_the_axis_stopped(
    make_bench: MakeBench, copy_of_complete: Copy, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second one comes in the quick stop of the first: nothing is restored, and the backup that is named works."""
    run, bench = copy_of_complete("move_1"), make_bench(start_m=0.2)
    fast = bench.faster_than(60.0)

    def first(frame: Frame) -> bool:
        if not fast(frame):
            return False
        bench.interrupt_when(quick_stop)  # re-armed for the second one
        signal.raise_signal(signal.SIGINT)
        return False

    def arm(index: int) -> None:
        if index == 8:
            bench.interrupt_when(first)

    outcome = commission(run, Listener(at_phase=arm), monkeypatch)
    assert outcome.exit_code == 4
    assert outcome.stderr.strip().splitlines()[0] == (
        "beltcomm: interrupted; left at once, with the axis stopped: the drive's own gains are NOT restored, they are in "
        f"{run / 'results' / 'backup.yaml'}; `beltcomm rollback` writes them again; what was recorded is kept in {run}"
    )
    assert bench.signals == 1
    assert bench.stands_disabled()
    assert bench.parameters() != bench.initial
    words = ["rollback", "--drive", "virtual:g_a", "--run", str(run), "--yes", "--seed", "1"]
    assert CliRunner().invoke(cli, words).exit_code == 0
    assert bench.parameters() == bench.initial


def twice_while_stopping(now: list[float]) -> None:
    """Two Ctrl-C one second apart, both heard while an axis is being stopped, and answered after it."""
    with deferred_interrupt():
        signal.raise_signal(signal.SIGINT)
        now[0] += 1.0
        signal.raise_signal(signal.SIGINT)


def test_a_second_ctrl_c_counts_only_within_two_seconds() -> None:
    now = [0.0]

    def press(at_s: float) -> type[BaseException]:
        now[0] = at_s
        with pytest.raises(KeyboardInterrupt) as caught:
            signal.raise_signal(signal.SIGINT)
        return caught.type

    before = signal.getsignal(signal.SIGINT)
    with twice_leaves(lambda: now[0]):
        assert [press(at_s) for at_s in (10.0, 12.1, 14.0, 15.9, 18.0)] == [
            KeyboardInterrupt,
            KeyboardInterrupt,
            LeaveNow,
            LeaveNow,
            KeyboardInterrupt,
        ]
        now[0] = 30.0
        with pytest.raises(LeaveNow):
            twice_while_stopping(now)
    assert signal.getsignal(signal.SIGINT) is before
    with twice_leaves(lambda: 0.0), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a script's job in the background: nobody else stops its axis
    try:
        with twice_leaves(lambda: 0.0), pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
