"""What keeps a session honest and a machine whole: limits watched in a loop, the operator's word, one session per folder."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from beltcomm import api
from beltcomm.axis import load_axis
from beltcomm.errors import Refused, SafetyStop, UsageError
from beltcomm.experiments import commission as sequence
from beltcomm.experiments import phases, proving, referencing, stops_out_of_move, verification
from beltcomm.experiments.stops_out_of_move import StopsOutOfMove
from beltcomm.machine import creep
from beltcomm.machine.machine import Machine
from beltcomm.machine.prediction_watch import BELT_BEYOND, BeltWatch
from beltcomm.rundata.findings import Findings, Settings
from beltcomm.rundata.proof import doubts
from beltcomm.runfolder import RunFolder
from beltcomm.schedule.sequences import EXCITATION_TRAVEL_M
from beltcomm.simulate.stopping import OFF_THE_MODEL, Braking, StopOutOfMove
from beltcomm.talk import Silence
from beltcomm.trajectory import Trajectory, plan_trajectory
from identify.records import true_model
from session.bench import Bench, Listener
from session.conftest import Complete
from truth.rigs import nominal

MakeBench = Callable[..., Bench]
Copy = Callable[..., Path]
AXIS = "egc-70-600"
FEED_N = load_axis(AXIS).belt_force_limit_n
YES = api.Options(yes=True, seed=1)
RATIO, INERTIA, LIMIT_N = 0.01242, 7.17e-5, 100.0


def force_rows(force_n: float, speed_rad_s: float = 50.0) -> list[tuple[float, ...]]:
    """Rows of a motor that a belt force brakes while its torque keeps up with that and accelerates it."""
    t = 1e-3 * np.arange(40)
    position = speed_rad_s * t + 0.5 * 600.0 * t**2
    torque = RATIO * force_n + INERTIA * 600.0
    return [(float(a), torque, torque, float(b), speed_rad_s, math.nan, math.nan) for a, b in zip(t, position, strict=True)]


@pytest.mark.parametrize(("share", "stops"), [(0.97, False), (1.03, True)])
def test_the_belts_force_is_told_from_torque_and_motion(share: float, stops: bool) -> None:
    """1.25 F_max beside friction, whatever the motor itself needs to accelerate."""
    coulomb, viscous = 0.1, 2e-3
    highest = BELT_BEYOND * LIMIT_N + (coulomb + viscous * 50.0) / RATIO
    watch = BeltWatch(RATIO, INERTIA, LIMIT_N, (coulomb, viscous))

    def run() -> None:
        for row in force_rows(share * highest):
            watch(row)

    if stops:
        with pytest.raises(SafetyStop, match=r"carries about 1\d\d N, the limit of axis.yaml is 100 N") as stop:
            run()
        assert stop.value.exit_code == 4
    else:
        run()


def test_a_lost_row_is_no_force() -> None:
    watch, rows = BeltWatch(RATIO, INERTIA, LIMIT_N, (0.0, 0.0)), force_rows(50.0)
    for row in rows[:10] + rows[13:]:
        watch(row)


def test_an_axis_that_is_not_the_predicted_one_is_stopped(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    """The run's gains on a carriage of 1 kg instead of 13: off its reference by far more than predicted, it does not finish the move."""
    run, bench = copy_of_complete(), make_bench("g_b", name="virtual:g_a")
    with pytest.raises(SafetyStop, match=r"mm off its reference, [0-9.]+ mm are allowed|the belt carries about|the motor torque swings"):
        api.verify(bench.name, run, options=YES)
    assert RunFolder.open(run).finished("move_2") is None
    assert bench.stands_disabled()
    assert bench.parameters() == bench.initial


def test_the_operators_word_against_a_drive_that_knows_its_zero(make_bench: MakeBench, tmp_path: Path) -> None:
    bench, folder = make_bench(), RunFolder.create(tmp_path / "run", load_axis(AXIS))
    for answer, ask in ((False, True), (True, False), (True, True)):
        talk = Listener(answer=answer)
        with bench.open(bench.name) as drive, Machine(drive, load_axis(AXIS), folder, talk) as machine:
            settings = Settings(position_m=0.3, ask=ask)
            if answer and ask:
                referencing.reference(machine, settings)
                assert machine.position_m == pytest.approx(0.3)
            else:
                with pytest.raises(Refused, match=r"at 0\.2500 m, --position says 0\.3000 m; leave --position out"):
                    referencing.reference(machine, settings)
                referencing.reference(machine, Settings(position_m=0.252))  # what both say needs no question
            assert len(talk.asked) == ask
    assert bench.plant.cart_position_m == 0.0


def test_homing_ends_where_an_excitation_has_room(make_bench: MakeBench, tmp_path: Path) -> None:
    """The virtual drive homes where it stands: near an end of the travel the carriage then creeps further in."""
    bench, folder = make_bench(start_m=0.0, referenced=False), RunFolder.create(tmp_path / "run", load_axis(AXIS))
    talk = Listener()
    with bench.open(bench.name) as drive, Machine(drive, load_axis(AXIS), folder, talk) as machine:
        referencing.home(machine)
        assert phases.motion_limits(machine, machine.position_m).travel_m == pytest.approx(EXCITATION_TRAVEL_M, abs=2e-3)
        assert machine.machine_seconds > 0.0
    assert "The drive found its zero; the carriage at 0 mm creeps" in "".join(talk.said)


def test_homing_stands_in_the_plan_before_it_is_done(make_bench: MakeBench, tmp_path: Path) -> None:
    bench, talk = make_bench(referenced=False), Listener(answer=False)
    with pytest.raises(Refused, match="nothing was moved, as you said"):
        api.identify(bench.name, AXIS, tmp_path / "run", options=api.Options(home=True), talk=talk)
    assert "First the drive searches its zero, along the whole axis if need be" in talk.said[0]
    assert "  homing " in talk.said[0]
    assert not np.any(bench.plant.torque_nm)


def test_a_tilted_axis_of_unknown_load_is_refused_before_the_drive_is_touched(make_bench: MakeBench, tmp_path: Path) -> None:
    bench, axis = make_bench(), load_axis(AXIS)
    tilted = replace(axis, mounting=replace(axis.mounting, tilt_deg=90.0))
    with pytest.raises(UsageError, match=r"holding a tilted axis needs payload\.mass_kg"):
        api.commission(bench.name, tilted, tmp_path / "run", options=YES)
    assert bench.opened == 0


def test_a_carriage_that_moves_by_itself_is_no_wrong_polarity() -> None:
    by_itself, reversed_ = creep._backwards(1.0, 0.001, 0.7), creep._backwards(-1.0, 0.15, 0.7)
    assert "by itself" in by_itself
    assert "Do not change any polarity" in by_itself
    assert "moves to positive under 0.150 N m of negative torque" in reversed_
    assert "607Eh" in reversed_


def test_one_session_at_a_time_and_a_no_leaves_the_folder_free(make_bench: MakeBench, tmp_path: Path) -> None:
    bench, path = make_bench(), tmp_path / "run"
    for _ in range(2):  # the second time the folder of the first no is no obstacle
        with pytest.raises(Refused, match="nothing was moved"):
            api.commission(bench.name, AXIS, path, options=api.Options(), talk=Listener(answer=False))
    folder = RunFolder.open(path)
    with (
        bench.open(bench.name) as drive,
        Machine(drive, load_axis(AXIS), folder, Silence()),
        pytest.raises(UsageError, match="another session is at work in"),
    ):
        Machine(drive, load_axis(AXIS), folder, Silence())
    Machine(bench.open(bench.name), load_axis(AXIS), folder, Silence()).__exit__(None, None, None)
    folder.journal("breakaway 0.1 N m")
    with pytest.raises(UsageError, match="exists; choose another folder"):
        RunFolder.create(path, load_axis(AXIS))


def test_motions_are_slowed_down_until_their_stops_end_inside(make_bench: MakeBench, tmp_path: Path) -> None:
    """With a fifth of the usual braking the sweep is slower, and no stop out of it leaves the travel."""
    bench, folder = make_bench(), RunFolder.create(tmp_path / "run", load_axis(AXIS))
    model = true_model(nominal("g_a"))
    with bench.open(bench.name) as drive, Machine(drive, load_axis(AXIS), folder, Silence()) as machine:
        usual = phases.sweep(machine, model).trajectory
        machine.brake_with(Braking(0.8, 0.05, 5e-3))
        assert machine.stops_badly(usual.position_m, usual.velocity_m_s)
        slow = phases.sweep(machine, model).trajectory
        assert not machine.stops_badly(slow.position_m, slow.velocity_m_s)
        assert 0.2 * np.abs(usual.velocity_m_s).max() < np.abs(slow.velocity_m_s).max() < np.abs(usual.velocity_m_s).max()


def test_the_standard_move_can_be_driven_from_a_little_beside_its_start(make_bench: MakeBench, tmp_path: Path) -> None:
    """Positioning never ends exactly where the move was planned to begin: what was promised in the plan is not refused then."""
    bench, folder = make_bench(), RunFolder.create(tmp_path / "run", load_axis(AXIS))
    model = true_model(nominal("g_a"))
    with bench.open(bench.name) as drive, Machine(drive, load_axis(AXIS), folder, Silence()) as machine:
        machine.brake_with(Braking(1.46, 0.05, 5e-3))
        path = verification.standard_move(machine, model).at(1.0, drive.capabilities.sample_period_s)
        for beside_m in (-1e-3, 1e-3):
            assert not machine.stops_badly(path.position_m + beside_m, path.velocity_m_s)


def lost_with(force_n: float, high_m: float = 0.5) -> StopOutOfMove:
    return StopOutOfMove(0.1, 0.0, high_m, force_n)


def test_positioning_is_slowed_down_for_a_stop_out_of_it(
    make_bench: MakeBench, complete: Complete, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench, folder = make_bench(), RunFolder.create(tmp_path / "run", load_axis(AXIS))
    model, cascade = complete.final.fit.model, sequence.Cascade(0.08, 0.2, 14.0, 4e-3)

    def top_of(sent: Trajectory) -> float:
        return float(np.abs(sent.velocity_m_s).max())

    with bench.open(bench.name) as drive, Machine(drive, load_axis(AXIS), folder, Silence()) as machine:
        limits, period = phases.gentle_limits(machine, model, 0.5), drive.capabilities.sample_period_s

        def plan(share: float) -> Trajectory:
            return plan_trajectory(0.05, 0.4, limits.slower(share), period)

        monkeypatch.setattr(
            stops_out_of_move, "worst_stops", lambda *args, **_: StopsOutOfMove(host_lost=lost_with(400.0 * top_of(args[4])))
        )
        whole = top_of(plan(1.0))
        assert 400.0 * whole > stops_out_of_move.HOST_LOSS_SWING * FEED_N
        assert top_of(stops_out_of_move.positioning(machine, plan, phases._positioning_envelope)[0]) == whole  # nobody knows the loop
        machine.closed, machine.cascade = (model, 1e-3), cascade
        slowed = top_of(stops_out_of_move.positioning(machine, plan, phases._positioning_envelope)[0])
        assert slowed < whole
        assert 400.0 * slowed <= stops_out_of_move.HOST_LOSS_SWING * FEED_N
        monkeypatch.setattr(  # as far over its end as it is fast
            stops_out_of_move,
            "worst_stops",
            lambda *args, **_: StopsOutOfMove(completed=lost_with(0.0, high_m=0.4 + 0.2 * top_of(args[4]))),
        )
        sent, envelope = stops_out_of_move.positioning(machine, plan, phases._positioning_envelope)
        free_m = machine.envelope().window_m[1] - 0.4
        assert envelope.window_m[1] == pytest.approx(0.4 + 0.5 * free_m)
        assert 0.2 * top_of(sent) <= 0.5 * free_m < 0.2 * whole
    said = (folder.path / "journal.txt").read_text(encoding="utf-8")
    assert f"PC or bus lost in it {400.0 * slowed:.0f} N; at 0." in said


def test_a_move_is_slowed_down_or_refused_for_a_belt_that_swings(
    make_bench: MakeBench, complete: Complete, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench, folder = make_bench(), RunFolder.create(tmp_path / "run", load_axis(AXIS))
    model, cascade = complete.final.fit.model, sequence.Cascade(0.08, 0.2, 14.0, 4e-3)
    true = verification.predict_move
    with bench.open(bench.name) as drive, Machine(drive, load_axis(AXIS), folder, Silence()) as machine:
        standard = verification.standard_move(machine, model)
        monkeypatch.setattr(
            verification,
            "predict_move",
            lambda *args, **more: replace(true(*args, **more), belt_force_n=80.0 * float(np.max(np.abs(args[2].velocity_m_s)) / 1.0) ** 2),
        )
        monkeypatch.setattr(
            verification,
            "worst_stops",
            lambda *args: StopsOutOfMove(host_lost=lost_with(120.0 * float(np.max(np.abs(args[4].velocity_m_s))) ** 2)),
        )
        lost = verification._kept_inside(machine, model, cascade, 1e-3)
        fastest = 120.0 * float(np.abs(lost.at(1.0, 1e-3).velocity_m_s).max()) ** 2
        assert 0.9 * 1.4 * 1.24 / 0.01242 < fastest <= 1.4 * 1.24 / 0.01242
        assert "a lost PC loads the belt to nearly 150 N" in lost.remark, "the number that the plan has told"
        monkeypatch.setattr(
            verification,
            "worst_stops",
            lambda *args: StopsOutOfMove(asked_for=lost_with(100.0 * float(np.max(np.abs(args[4].velocity_m_s))) ** 2)),
        )
        assert "a stop loads the belt to nearly 1" in verification._kept_inside(machine, model, cascade, 1e-3).remark
        monkeypatch.setattr(verification, "worst_stops", lambda *_: StopsOutOfMove())
        kept = verification._kept_inside(machine, model, cascade, 1e-3)
        fast, slow = (move.at(1.0, 1e-3) for move in (standard, kept))
        limit = verification.belt_force_limit_n(machine, model, 1.0, 1.05)
        assert limit == pytest.approx(1.05 * (1.24 / 0.01242 + model["cart_friction.level"] + model["viscous_cart.damping"]))
        assert 80.0 * np.abs(fast.velocity_m_s).max() ** 2 > limit
        assert 0.9 * limit < 80.0 * np.abs(slow.velocity_m_s).max() ** 2 <= limit
        assert "the swinging belt carries more than" in kept.remark
        path = verification.predict_move(model, cascade, fast, verification.in_drive(machine, 1e-3))
        # 1.25 times 99.84 N and 3 to 4.5 N of friction at the carriage
        with pytest.raises(Refused, match=r"the belt is predicted to carry 14\d\.\d N as it swings, limit (128|129|130)\.\d N"):
            proving._check_belt(machine, model, path, fast)
        with pytest.raises(Refused, match=r"should the PC or the bus be lost in it, the belt is predicted to carry 160 N .*limit 150 N"):
            proving._check_stops(machine, StopsOutOfMove(host_lost=lost_with(160.0)), 129.0)
        with pytest.raises(Refused, match=r"the carriage is predicted to go from 0 m to 0\.59 m, the travel is"):
            proving._check_stops(machine, StopsOutOfMove(host_lost=lost_with(90.0, high_m=0.59)), 129.0)
        with pytest.raises(Refused, match=r"from -inf m"):  # a loss that nobody could simulate is none that is harmless
            proving._check_stops(machine, StopsOutOfMove(host_lost=OFF_THE_MODEL), 129.0)
        with pytest.raises(Refused, match=r"the belt is predicted to carry 130 N in a stop out of it, limit 129 N"):
            proving._check_stops(machine, StopsOutOfMove(asked_for=lost_with(130.0)), 129.0)
        proving._check_stops(machine, StopsOutOfMove(asked_for=lost_with(130.0)), 129.0, agreed_n=131.0)
        proving._check_stops(machine, StopsOutOfMove(lost_with(88.0), lost_with(149.0)), 129.0)
        assert "a stop out of the move: 88 N in the belt" in (folder.path / "journal.txt").read_text(encoding="utf-8")
        assert "lost in the move: 149 N in the belt and 100 mm" in (folder.path / "journal.txt").read_text(encoding="utf-8")


def test_success_needs_sound_margins_and_a_whole_move(complete: Complete, copy_of_complete: Copy) -> None:
    design = complete.result.data["design"]
    assert min(one["phase_margin_deg"] for one in design["margins"]) > 30.0
    run = copy_of_complete()
    folder = RunFolder.open(run)
    assert doubts(folder) == []
    saved = folder.load("designs", "final")
    folder.save("designs", "final", {**saved, "margins": [{**saved["margins"][0], "phase_margin_deg": 16.0}]})
    assert doubts(folder) == ["the velocity loop is left with 16 deg of phase margin, a sound one has 30 or more"]
    folder.save("designs", "final", saved)
    verdict = folder.load("results", "verify_move_1")
    folder.save("results", "verify_move_1", {**verdict, "reservations": ["only slower ones"]})
    assert doubts(folder) == ["only slower ones"]


def test_the_gains_are_asked_for_and_thin_ones_never_kept(
    complete: Complete, make_bench: MakeBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not of the virtual drive, which keeps nothing: it stands for one that does."""
    monkeypatch.setattr(sequence.Hardware, "virtual", False)
    bench, folder = make_bench(), RunFolder.create(tmp_path / "run", load_axis(AXIS))
    verdict = complete.result.data["verdict"]
    cascade = sequence.Cascade(0.08, 0.2, 14.0, 4e-3)
    for answer, reservations, applied, asked in ((True, [], "keep", 1), (False, [], "restore", 1), (True, ["thin"], "restore", 0)):
        talk = Listener(answer=answer)
        findings = Findings(final=complete.final, verdict=verdict, reservations=reservations, cascade=cascade)
        with bench.open(bench.name) as drive, Machine(drive, load_axis(AXIS), folder, talk) as machine:
            sequence.dispose(machine, Settings(apply=None, ask=True), findings)
            assert machine.keep_gains is (applied == "keep")
            machine.keep_gains = False
        assert findings.applied == applied
        assert len(talk.asked) == asked
    findings = Findings(final=complete.final, verdict=verdict, cascade=cascade)
    monkeypatch.setattr(sequence, "choose", lambda *_: "s")
    with bench.open(bench.name) as drive, Machine(drive, load_axis(AXIS), folder, Listener()) as machine:
        sequence.dispose(machine, Settings(apply=None, ask=True), findings)
        assert machine.keep_gains
        machine.keep_gains = False
    assert findings.applied == "save"
    findings = Findings(final=complete.final, verdict=verdict, reservations=["thin"])
    with bench.open(bench.name) as drive, Machine(drive, load_axis(AXIS), folder, Silence()) as machine:
        sequence.dispose(machine, Settings(apply="save"), findings)
        assert not machine.keep_gains
    assert findings.remarks == ["the new gains were not kept, because thin; `beltcomm apply --force` writes them all the same"]
