"""What every drive behind :class:`beltcomm.drive.Drive` must do, whoever made it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from beltcomm.drive import COLUMNS, GUARD_S, Limits, Motion, Row
from beltcomm.errors import DriveError, SafetyStop, UsageError

STATE_DISABLED = (1, 2, 3)  # CiA 402: Switch On Disabled, Ready To Switch On, Switched On


def square_torque(machine, share: float, seconds: float, half_period_s: float) -> Motion:
    """A torque that accelerates and brakes in turn, so that the axis stays near where it is."""
    n = round(seconds / machine.period_s)
    phase = np.floor((np.arange(n) * machine.period_s + half_period_s / 2) / half_period_s)
    values = share * machine.limits.torque_nm * np.where(phase % 2 == 0, 1.0, -1.0)
    return Motion("torque", machine.period_s, np.zeros(n), np.zeros(n), values)


def smooth_path(machine, travel_rad: float, seconds: float) -> Motion:
    """Half a cosine from here to ``travel_rad`` further."""
    t = np.arange(round(seconds / machine.period_s)) * machine.period_s
    here = machine.drive.read(["position_rad"])["position_rad"]
    share = np.clip(t / (0.7 * seconds), 0.0, 1.0)
    path = here + travel_rad * 0.5 * (1 - np.cos(np.pi * share))
    return Motion("position", machine.period_s, path, np.gradient(path, machine.period_s), np.zeros(len(t)))


def stroke(machine, travel_rad: float, seconds: float) -> Motion:
    """One stroke at constant speed with ramps of a quarter of its time, with rests before and after."""
    t = np.arange(round((seconds + 0.2) / machine.period_s) + 1) * machine.period_s
    top = travel_rad / (0.75 * seconds)
    speed = top * np.clip(np.minimum(t - 0.1, seconds + 0.1 - t) / (0.25 * seconds), 0.0, 1.0)
    here = machine.drive.read(["position_rad"])["position_rad"]
    path = here + np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))]) * machine.period_s
    return Motion("profile", machine.period_s, path, speed, np.zeros(len(t)))


def shaken(machine, share: float, seconds: float, half_period_s: float) -> Motion:
    """Some motion that this drive can make: a torque to and fro, or a stroke of the way that this torque would make of an axis."""
    if "torque" in machine.drive.capabilities.kinds:
        return square_torque(machine, share, seconds, half_period_s)
    return stroke(machine, 10.0 * share, max(seconds, 0.5))


def needs(machine, kind: str) -> None:
    """Skip what this drive cannot do, by its own word and for a reason that it gives."""
    has = machine.drive.capabilities
    if kind not in has.kinds:
        assert kind == "profile" or has.refused[kind].endswith((".", ")"))
        pytest.skip(f"{has.name} offers no motions of kind {kind!r}")


def state(machine) -> float:
    return machine.drive.read(["state"])["state"]


def test_capabilities_are_plausible(machine):
    has = machine.drive.capabilities
    assert has.kinds
    assert has.kinds <= {"torque", "position", "velocity", "profile"}
    assert {"torque", "position"} <= has.kinds | set(has.refused)
    assert 0.0002 <= has.sample_period_s <= (0.02 if "torque" in has.kinds else 0.25)
    assert has.counts_per_rev >= 256
    assert 0 < has.torque_step_nm < has.rated_torque_nm / 100
    assert has.rated_torque_nm <= has.peak_torque_nm < 20 * has.rated_torque_nm
    assert 0 < has.structure.period_s <= has.sample_period_s
    assert has.max_speed_rad_s > 0
    assert has.identity["device_type"] == "00020192h"


def test_everything_in_the_backup_can_be_read_and_written_back(machine):
    drive = machine.drive
    backup = drive.backup()
    assert {"kp_nm_s_rad", "ki_nm_rad", "kpp_1_s", "torque_limit_nm", "speed_limit_rad_s"} <= set(backup)
    assert drive.read(list(backup)) == backup
    # K_P and K_I together: some drives hold their quotient, and its range is small
    changed = {name: 1.25 * backup[name] for name in ("kp_nm_s_rad", "ki_nm_rad")} | {"kpp_1_s": 0.5 * backup["kpp_1_s"]}
    try:
        stored = drive.write(changed)
        assert stored == pytest.approx(changed, rel=0.05)  # fixed point
        assert drive.backup() == pytest.approx({**backup, **stored}, rel=0.01)
    finally:
        drive.write(backup)
    assert drive.backup() == backup


def test_a_parameter_it_does_not_have_is_refused_and_nothing_is_written(machine):
    backup = machine.drive.backup()
    with pytest.raises(UsageError, match="no parameter warp_factor"):
        machine.drive.write({"kp_nm_s_rad": 2 * backup["kp_nm_s_rad"], "warp_factor": 9.0})
    assert machine.drive.backup() == backup


def test_a_torque_record_has_one_row_per_sample_with_stamps_and_setpoints(machine):
    needs(machine, "torque")
    rows: list[Row] = []
    motion = square_torque(machine, 0.2, 0.3, 0.05)
    report = machine.drive.record(motion, machine.limits, rows.append)
    table = np.array(rows)
    assert table.shape == (report.rows, len(COLUMNS))
    assert report.rows + 2 * report.lost_cycles >= len(motion.torque_nm)
    steps = np.diff(table[:, 0])
    assert (steps > 0).all()
    assert np.median(steps) == pytest.approx(machine.period_s, rel=0.01)
    if report.lost_cycles == 0:
        step_nm = machine.drive.capabilities.torque_step_nm
        assert table[:, 2] == pytest.approx(motion.torque_nm, abs=0.5001 * step_nm)
    assert np.isfinite(table[:, :5]).all()
    assert np.isnan(table[:, 5:]).all()
    # the motor must answer: acting torque follows the setpoint
    assert np.corrcoef(table[2:, 1], table[:-2, 2])[0, 1] > 0.8
    assert state(machine) in STATE_DISABLED


def test_a_position_record_moves_the_axis_to_where_the_reference_ends(machine):
    needs(machine, "position")
    travel_rad = 0.1 * (machine.limits.position_max_rad - machine.limits.position_min_rad)
    rows: list[Row] = []
    motion = smooth_path(machine, travel_rad, 1.5)
    report = machine.drive.record(motion, machine.limits, rows.append)
    table = np.array(rows)
    count_rad = 2 * math.pi / machine.drive.capabilities.counts_per_rev
    if report.lost_cycles == 0:
        assert table[:, 5] == pytest.approx(motion.position_rad, abs=0.51 * count_rad)
    assert table[-1, 3] - table[0, 3] == pytest.approx(travel_rad, rel=0.02)
    assert np.abs(table[:, 3] - table[:, 5]).max() < 0.3 * abs(travel_rad)
    assert state(machine) in STATE_DISABLED


def test_a_stroke_moves_the_axis_to_its_end_at_the_speed_asked(machine):
    needs(machine, "profile")
    travel_rad, seconds = 0.1 * (machine.limits.position_max_rad - machine.limits.position_min_rad), 2.0
    rows: list[Row] = []
    motion = stroke(machine, travel_rad, seconds)
    report = machine.drive.record(motion, machine.limits, rows.append)
    table = np.array(rows)
    assert table.shape == (report.rows, len(COLUMNS))
    assert np.isfinite(table[:, [0, 1, 3, 4, 5, 6]]).all()
    steps = np.diff(table[:, 0])
    assert (steps > 0).all()
    assert np.median(steps) == pytest.approx(machine.period_s, rel=0.3)
    assert table[-1, 3] - table[0, 3] == pytest.approx(travel_rad, rel=0.01)
    top = travel_rad / (0.75 * seconds)
    on_plateau = np.abs(table[:, 6] - top) < 0.01 * top  # the reference is as fast as asked for about as long as asked
    assert on_plateau.sum() * machine.period_s == pytest.approx(0.5 * seconds, rel=0.1)
    settled = np.flatnonzero(on_plateau)[on_plateau.sum() // 2 :]
    slope = np.polyfit(table[settled, 0], table[settled, 3], 1)[0]  # the stamps are true: position over time is the speed
    assert slope == pytest.approx(top, rel=0.02)
    assert np.abs(table[:, 3] - table[:, 5]).max() < 0.3 * travel_rad
    assert state(machine) in STATE_DISABLED


def test_a_breached_window_stops_the_axis(machine):
    needs(machine, "torque")
    here = machine.drive.read(["position_rad"])["position_rad"]
    tight = Limits(here - 0.2, here + 0.2, machine.limits.speed_rad_s, machine.limits.torque_nm)
    motion = square_torque(machine, 0.5, 1.0, 0.5)
    rows: list[Row] = []
    with pytest.raises(SafetyStop, match="position") as caught:
        machine.drive.record(motion, tight, rows.append)
    assert caught.value.reason == "position"
    assert len(rows) < len(motion.torque_nm)
    assert state(machine) in STATE_DISABLED
    assert abs(machine.drive.read(["velocity_rad_s"])["velocity_rad_s"]) < 0.5


@pytest.mark.parametrize("error", [OSError("disk full"), KeyboardInterrupt()])
def test_an_exception_from_the_sink_stops_the_axis_and_comes_out(machine, error):
    def sink(_row: Row) -> None:
        raise error

    with pytest.raises(type(error)) as caught:
        machine.drive.record(shaken(machine, 0.2, 0.5, 0.05), machine.limits, sink)
    assert caught.value is error
    assert state(machine) in STATE_DISABLED
    rows: list[Row] = []
    machine.drive.record(shaken(machine, 0.1, 0.1, 0.05), machine.limits, rows.append)  # and it can go on
    assert len(rows) * machine.period_s > 0.05


def test_a_kind_that_is_not_offered_is_refused_with_the_reason(machine):
    here = machine.drive.read(["position_rad"])["position_rad"]
    for kind, why in machine.drive.capabilities.refused.items():
        motion = Motion(kind, machine.period_s, np.full(20, here), np.zeros(20), np.zeros(20))
        with pytest.raises(UsageError) as caught:
            machine.drive.record(motion, machine.limits, lambda row: None)
        assert why in str(caught.value)
    assert state(machine) in STATE_DISABLED


def test_a_motion_beyond_the_limits_is_refused_without_moving(machine):
    here = machine.drive.read(["position_rad"])["position_rad"]
    too_much = 1.5 if "torque" in machine.drive.capabilities.kinds else 10.0  # 100 rad in a window of ± 30
    with pytest.raises(UsageError, match=r"reduce the amplitude|shorten it"):
        machine.drive.record(shaken(machine, too_much, 0.1, 0.05), machine.limits, lambda row: None)
    assert machine.drive.read(["position_rad"])["position_rad"] == pytest.approx(here, abs=1e-3)


def test_a_record_leaves_the_parameters_alone(machine):
    before = machine.drive.backup()
    tighter = Limits(
        machine.limits.position_min_rad,
        machine.limits.position_max_rad,
        0.9 * machine.limits.speed_rad_s,
        0.9 * machine.limits.torque_nm,
    )
    machine.drive.record(shaken(machine, 0.1, 0.1, 0.05), tighter, lambda row: None)
    assert machine.drive.backup() == before


def test_guarding_is_proven_once_at_standstill(machine):
    """The host falls silent while the axis is enabled without torque: the drive reacts in time, and the axis can be enabled again."""
    drive = machine.drive
    if drive.capabilities.shortest_guard_s is None:
        with pytest.raises(DriveError):
            drive.prove_guarding(machine.limits)
        return
    here, begun = drive.read(["position_rad"])["position_rad"], drive.clock.now()
    limits = replace(machine.limits, guard_s=max(GUARD_S, drive.capabilities.shortest_guard_s))
    found = drive.prove_guarding(limits)
    taken = drive.clock.now() - begun
    assert found.guard_s == limits.guard_s
    assert 0.5 * limits.guard_s < found.reaction_s <= limits.guard_s + 0.05
    if machine.plant is not None:
        assert taken < 0.5
    assert state(machine) in STATE_DISABLED
    assert drive.read(["position_rad"])["position_rad"] == pytest.approx(here, abs=1e-3)
    again = drive.clock.now()
    assert drive.prove_guarding(limits) == found
    assert drive.clock.now() == again
    drive.record(square_torque(machine, 0.1, 0.1, 0.05), limits, lambda row: None)


def test_stop_and_close_can_be_called_at_any_time(machine):
    machine.drive.stop()
    assert state(machine) in STATE_DISABLED
    machine.drive.close()
    for at_any_time in (machine.drive.close, machine.drive.stop):
        assert at_any_time() is None  # and nothing is raised on a bus that was let go


def test_a_torque_sent_along_a_speed_is_added_and_recorded_or_refused(machine):
    """60B2h in the speed loop: an inertia at rest, asked for no speed, moves by what is added, and the loop works against it."""
    needs(machine, "velocity")
    n = round(0.4 / machine.period_s)
    step = machine.drive.capabilities.torque_step_nm
    added = np.zeros(n)
    added[n // 4 :] = step * round(0.2 * machine.limits.torque_nm / step)
    motion = Motion("velocity", machine.period_s, np.zeros(n), np.zeros(n), added)
    rows: list[Row] = []
    if "velocity" not in machine.drive.capabilities.torque_along:
        with pytest.raises(UsageError, match="no feedforward torque in a motion of kind 'velocity'"):
            machine.drive.record(motion, machine.limits, rows.append)
        assert rows == []
        return
    report = machine.drive.record(motion, machine.limits, rows.append)
    table = np.array(rows)
    if report.lost_cycles == 0:
        assert table[:, COLUMNS.index("torque_offset_nm")] == pytest.approx(added, abs=1e-9)
    before, after = table[: n // 4 - 2], table[n // 4 + 2 : n // 4 + 12]
    assert after[:, 4].mean() > max(0.1, 3.0 * np.abs(before[:, 4]).max())  # it turned the way it was pushed
    assert 0.0 < table[-10:, 1].mean() < 0.5 * added[-1]  # and the loop holds against it
    assert state(machine) in STATE_DISABLED
