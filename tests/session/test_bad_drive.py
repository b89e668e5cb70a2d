"""Drives and machines with faults: a sentence with the remedy, the right exit code, a stopped and restored drive."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from beltcomm import api
from beltcomm.axis import Axis, load_axis
from beltcomm.drive import open_drive
from beltcomm.errors import BeltcommError, BusError, Declined, DriveError, DriveFault, Refused, SafetyStop, UsageError
from beltcomm.runfolder import RunFolder
from beltcomm.virtual.faults import Faults
from session.bench import Bench, Listener

MakeBench = Callable[..., Bench]
Copy = Callable[..., Path]
AXIS = "egc-70-600"
YES = api.Options(yes=True, seed=1)


def fails(
    kind: type[BeltcommError],
    bench: Bench,
    run: Path,
    axis: Axis | str = AXIS,
    options: api.Options = YES,
    talk: Listener | None = None,
) -> str:
    """Identify, which must fail with this kind of error; the drive is stopped and as it was.   Returns the sentence."""
    with pytest.raises(kind) as caught:
        api.identify(bench.name, axis, run, options=options, talk=talk)
    assert type(caught.value) is kind
    assert bench.stands_disabled()
    return str(caught.value)


def test_a_rated_torque_that_disagrees_is_refused_before_anything_moves(make_bench: MakeBench, tmp_path: Path) -> None:
    bench = make_bench(faults=Faults(rated_torque_nm=2.0))
    words = fails(UsageError, bench, tmp_path / "run")
    assert "rated torque is 2 N m, axis.yaml says 1.43 N m" in words
    assert "1.40" in words  # by how much every torque would be wrong
    assert "correct motor.rated_torque_nm or the drive's motor data" in words
    assert bench.plant.cart_position_m == 0.0
    assert bench.parameters() == bench.initial


def test_no_drive_on_the_bus() -> None:
    with pytest.raises(BusError, match=r"no drive answers on .*; check that it is on, its node number and bit rate, the cable") as caught:
        open_drive("virtual:g_a", {"faults": Faults(silent_from_s=0.0)})
    assert caught.value.exit_code == 5


def test_a_drive_that_refuses_the_torque_mode(make_bench: MakeBench, tmp_path: Path) -> None:
    bench = make_bench(faults=Faults(refused_modes=frozenset({10})))
    assert "mode of operation 10" in fails(DriveError, bench, tmp_path / "run")
    assert bench.plant.cart_position_m == 0.0
    assert bench.parameters() == bench.initial


def test_a_fault_of_the_drive_in_motion(make_bench: MakeBench, tmp_path: Path) -> None:
    """During the first excitation: EMCY 4210h, overtemperature (CiA 402)."""
    faults = Faults(emergency_code=0x4210)
    bench = make_bench(faults=faults)

    def overheat(_phase: int, fraction: float) -> None:
        if fraction > 0.5:
            faults.emergency_at_s = bench.now_s

    words = fails(DriveFault, bench, tmp_path / "run", talk=Listener(at_progress=overheat))
    assert "4210h" in words
    assert "temperature" in words
    assert RunFolder.open(tmp_path / "run").unfinished() == ["amplitude_1"]
    assert bench.parameters() == bench.initial


def test_lost_frames(make_bench: MakeBench, tmp_path: Path) -> None:
    faults = Faults()
    bench = make_bench(faults=faults)

    def lose(_phase: int, fraction: float) -> None:
        if fraction > 0.5:
            faults.drop_tpdo = frozenset(range(40_000))

    words = fails(BusError, bench, tmp_path / "run", talk=Listener(at_progress=lose))
    assert "did not answer 4 SYNCs in a row" in words
    assert "check the cabling" in words
    assert RunFolder.open(tmp_path / "run").unfinished() == ["amplitude_1"]
    faults.drop_tpdo = frozenset()
    assert bench.parameters() == bench.initial


def test_a_single_lost_frame_is_a_gap_and_no_reason_to_stop(make_bench: MakeBench, tmp_path: Path) -> None:
    """The record is complete but for it, and the next phase begins, where this test ends it."""
    # about 5000 of the drive's PDOs pass before the first excitation ends, two in each period
    bench = make_bench(faults=Faults(drop_tpdo=frozenset({5000})))

    def end(phase: int) -> None:
        if phase == 3:  # of identify: the response
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        api.identify(bench.name, AXIS, tmp_path / "run", options=YES, talk=Listener(at_phase=end))
    assert "amplitude_1" in RunFolder.open(tmp_path / "run").finished_names()
    journal = (tmp_path / "run" / "journal.txt").read_text(encoding="utf-8")
    assert "1 lost cycles" in journal
    gaps = np.diff(RunFolder.open(tmp_path / "run").recording("amplitude_1").t_s)
    assert gaps.max() == pytest.approx(3e-3)  # its own row and the one before
    assert np.median(gaps) == pytest.approx(1e-3)


def test_a_pulled_cable(make_bench: MakeBench, tmp_path: Path) -> None:
    """Nobody can restore a drive that does not hear; it must stop by itself and the user must be told what is to be done."""
    faults = Faults()
    bench, talk = make_bench(faults=faults), Listener()

    def pull(_phase: int, fraction: float) -> None:
        if fraction > 0.5:
            faults.silent_from_s = bench.now_s

    talk.at_progress = pull
    with pytest.raises(BusError):
        api.identify(bench.name, AXIS, tmp_path / "run", options=YES, talk=talk)
    assert bench.stands_disabled()
    assert any("could not be restored" in line and "beltcomm rollback" in line for line in talk.said)
    faults.silent_from_s = None
    api.rollback(bench.name, tmp_path / "run", options=YES)
    assert bench.parameters() == bench.initial


def test_an_encoder_that_jumps_far_stops_the_axis(make_bench: MakeBench, tmp_path: Path) -> None:
    faults = Faults(encoder_step_counts=10_000)  # 12 mm
    bench = make_bench(faults=faults)

    def jump(_phase: int, fraction: float) -> None:
        if fraction > 0.5 and faults.encoder_step_at_s is None:
            faults.encoder_step_at_s = bench.now_s

    words = fails(SafetyStop, bench, tmp_path / "run", talk=Listener(at_progress=jump))
    assert re.search("speed|position", words)
    assert "the axis was stopped" in words
    assert bench.parameters() == bench.initial


def outcome_of(command: Callable[[], api.Result]) -> tuple[int, str]:
    """Exit code and text of a command that may well fail."""
    try:
        result = command()
    except BeltcommError as error:
        return error.exit_code, str(error)
    return result.exit_code, "\n".join(result.lines())


def test_an_encoder_that_counts_the_wrong_way_round(make_bench: MakeBench, tmp_path: Path) -> None:
    bench = make_bench(faults=Faults(encoder_sign=-1), referenced=False)
    words = fails(DriveError, bench, tmp_path / "run", options=replace(YES, position_m=0.25))
    assert "moves to negative under 0.1" in words
    assert "607Eh" in words
    assert abs(bench.plant.cart_position_m) < 5e-3
    assert bench.parameters() == bench.initial


@pytest.mark.parametrize("command", [api.verify, api.friction])
@pytest.mark.usefixtures("fitted")
def test_the_sign_is_checked_before_any_loop_is_closed(
    make_bench: MakeBench, copy_of_complete: Copy, command: Callable[..., object]
) -> None:
    """On the wrong sign a loop runs away, the quick stop's too: without the check this carriage ran 45 mm beyond its travel."""
    bench = make_bench(faults=Faults(encoder_sign=-1), referenced=False)
    with pytest.raises(DriveError, match=r"moves to \w+ under .* 607Eh|set the drive's polarity"):
        command(bench.name, copy_of_complete(), options=replace(YES, position_m=0.25))
    assert bench.stands_disabled()
    assert abs(bench.plant.cart_position_m) < 5e-3
    assert bench.parameters() == bench.initial


def test_an_axis_that_does_not_move(make_bench: MakeBench, tmp_path: Path) -> None:
    bench = make_bench(faults=Faults(stuck_from_s=0.0))
    words = fails(Refused, bench, tmp_path / "run")
    assert "does not move" in words
    assert "0.74 N m" in words  # 60 % of the 1.24 N m that are allowed
    assert "check brake, clamp and enable inputs" in words
    assert bench.parameters() == bench.initial


def test_a_wrong_inertia_in_the_axis_file_ends_the_rise_in_the_first_step(make_bench: MakeBench, tmp_path: Path) -> None:
    """A hundred times too large: the first record leaves its prediction, is stopped there, and the reason is measured and named."""
    axis, talk = load_axis(AXIS), Listener()
    bench = make_bench()
    wrong = replace(axis, motor=replace(axis.motor, inertia_kg_m2=100.0 * float(axis.motor.inertia_kg_m2 or 0.0)))
    with pytest.raises(SafetyStop, match=r"to be expected at most.*check the unit of motor\.inertia_kg_m2") as stop:
        api.identify(bench.name, wrong, tmp_path / "run", options=YES, talk=talk)
    seen = re.search(r"inertia of about ([\d.e-]+) ±", str(stop.value))
    assert seen is not None
    assert float(seen[1]) == pytest.approx(bench.plant.truth["inertia_kg_m2"], rel=0.5)
    assert sum(text.startswith("excitation ±") for text in talk.said) == 1
    assert np.abs(bench.plant.cart_m(0, len(bench.plant.torque_nm))).max() < 10e-3
    assert bench.parameters() == bench.initial


@pytest.mark.examination
def test_too_much_torque_noise_never_passes_for_a_good_fit(make_bench: MakeBench, tmp_path: Path) -> None:
    """100 mN m instead of 6: the intervals say how little is known, and hold; a refusal would be right too."""
    text = (Path(__file__).parents[2] / "configs" / "plants" / "g_a.yaml").read_text(encoding="utf-8")
    plant = tmp_path / "noisy.yaml"
    plant.write_text(text.replace("torque_noise_nm: 0.006", "torque_noise_nm: 0.1"), encoding="utf-8")
    bench = make_bench(name=f"virtual:{plant}")
    result = api.identify(bench.name, AXIS, tmp_path / "run", options=YES)
    assert bench.stands_disabled()
    assert bench.parameters() == bench.initial
    found, truth = result.data["model"]["parameters"], bench.plant.truth
    # all records were made at one place: they cannot tell a law of the stiffness along the travel
    assert "belt_stiffness.stiffness" in found
    for name, true in (("cart.mass", "mass_kg"), ("belt_stiffness.stiffness", "stiffness_n_m"), ("motor.inertia", "inertia_kg_m2")):
        assert abs(found[name]["value"] - truth[true]) < 2.0 * found[name]["interval"], name
    # 17 times the noise: intervals that are not several times wider than at 6 mN m (0.03 kg there) would be a lie
    assert found["cart.mass"]["interval"] > 0.1


def test_an_axis_nobody_has_referenced(make_bench: MakeBench, tmp_path: Path) -> None:
    bench = make_bench(referenced=False)
    words = fails(Refused, bench, tmp_path / "run")
    assert "--position METRES" in words
    assert "--home" in words
    assert bench.plant.cart_position_m == 0.0


def test_a_position_that_is_outside_the_travel(make_bench: MakeBench, tmp_path: Path) -> None:
    bench = make_bench(referenced=False)
    words = fails(UsageError, bench, tmp_path / "run", options=replace(YES, position_m=2.5))
    assert "position 2.5 m is outside the travel -0.01..0.57 m" in words
    assert bench.plant.cart_position_m == 0.0


def test_no_is_an_answer(make_bench: MakeBench, tmp_path: Path) -> None:
    bench, talk = make_bench(), Listener(answer=False)
    words = fails(Declined, bench, tmp_path / "run", options=api.Options(seed=1), talk=talk)
    assert "nothing was moved, as you said" in words
    assert len(talk.asked) == 1
    assert bench.plant.cart_position_m == 0.0
    assert not any((tmp_path / "run" / "recordings").glob("*.csv*"))
    assert bench.parameters() == bench.initial


def test_yes_is_an_answer_too(make_bench: MakeBench, tmp_path: Path) -> None:
    """The same question with a yes: the axis begins to move, and only then."""
    bench = make_bench(faults=Faults(stuck_from_s=0.0))
    talk = Listener(answer=True)
    fails(Refused, bench, tmp_path / "run", options=api.Options(seed=1), talk=talk)
    assert talk.asked == ["May the axis move like this?"]
    assert talk.phases[-1][0] == 1


@pytest.mark.parametrize("at_m", [-0.009, 0.5685])
def test_a_carriage_at_the_end_of_its_travel(make_bench: MakeBench, tmp_path: Path, at_m: float) -> None:
    bench = make_bench(start_m=at_m)
    words = fails(UsageError, bench, tmp_path / "run")
    assert f"the carriage stands at {at_m:.4f} m" in words
    assert "move the carriage further in" in words
    assert bench.plant.cart_position_m == 0.0


def test_a_carriage_near_the_end_of_its_travel(make_bench: MakeBench, tmp_path: Path) -> None:
    """Room for the sign check, none for an excitation."""
    bench = make_bench(start_m=-0.004)
    words = fails(Refused, bench, tmp_path / "run")
    assert "mm of travel are left" in words
    assert "move the carriage further in or correct travel in axis.yaml" in words
    assert bench.parameters() == bench.initial


def test_a_travel_that_is_too_small(make_bench: MakeBench, tmp_path: Path) -> None:
    """12 mm in all: 1 mm is left on either side of the 5 mm that are kept to the ends."""
    axis = load_axis(AXIS)
    bench = make_bench()
    narrow = replace(axis, travel=replace(axis.travel, min_m=0.244, max_m=0.256))
    words = fails(Refused, bench, tmp_path / "run", narrow)
    assert "correct travel in axis.yaml" in words
    assert abs(bench.plant.cart_position_m) < 6e-3
    assert bench.parameters() == bench.initial


@pytest.mark.usefixtures("fitted")
def test_a_short_travel_is_never_left(make_bench: MakeBench, tmp_path: Path) -> None:
    """30 mm: enough to excite, hardly enough for strokes.  A refusal is right, or a job within them."""
    axis = load_axis(AXIS)
    bench = make_bench()
    narrow = replace(axis, travel=replace(axis.travel, min_m=0.235, max_m=0.265))
    code, words = outcome_of(lambda: api.commission(bench.name, narrow, tmp_path / "run", options=YES))
    assert code in (0, 1, 2)
    assert re.search("travel|window|FAIL|PASS", words)
    assert bench.stands_disabled()
    assert bench.parameters() == bench.initial
    places = bench.start_m + bench.plant.cart_m(0, len(bench.plant.torque_nm))
    assert places.min() > 0.235
    assert places.max() < 0.265


@pytest.mark.parametrize("force_n", [1.0, 9.0])
def test_a_feed_force_that_cannot_overcome_friction(make_bench: MakeBench, tmp_path: Path, force_n: float) -> None:
    """Breaking away takes 0.125 N m or 10 N at the belt."""
    axis = load_axis(AXIS)
    bench = make_bench()
    weak = replace(axis, limits=replace(axis.limits, feed_force_n=force_n))
    words = fails(Refused, bench, tmp_path / "run", weak)
    assert re.search("friction|does not move", words)
    assert "feed_force_n" in words or "axis.yaml" in words
    assert abs(bench.plant.belt_force_n).max() < 2.0 * force_n + 0.1 / 0.01242
    assert bench.parameters() == bench.initial
