"""What only a virtual drive can be made to do: known physics, faults at will, a host that dies, the same run twice."""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from beltcomm.drive import Drive, Limits, Motion, Row, open_drive
from beltcomm.errors import BusError, DriveError, DriveFault, SafetyStop, UsageError
from beltcomm.virtual.faults import Faults
from contract.conftest import Machine, RigidPlant, open_virtual
from frames import FrameHash

T = 1e-3
PROFILES = ("reference", "cmmp-as")


@pytest.fixture(params=PROFILES)
def profile(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def opened() -> Iterator[list[Machine]]:
    """Machines put in here are closed after the test."""
    machines: list[Machine] = []
    yield machines
    for machine in machines:
        machine.drive.close()


def binary(n: int, amplitude_nm: float, seed: int = 3) -> Motion:
    """Random binary torque, every value held for 2 ms, every second one the reverse of the first so that the axis stays."""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], n // 8 + 1)
    values = amplitude_nm * np.repeat(np.stack([signs, -signs, -signs, signs], axis=1).ravel(), 2)[:n]
    return Motion("torque", T, np.zeros(n), np.zeros(n), values)


def test_torque_and_motion_are_aligned_to_less_than_50_us(profile, opened):
    """Torque held from t[n] to t[n+1] moves an inertia by  p[n+1] - (1 + a) p[n] + a p[n-1] = T²/2J (τ[n] + τ[n-1]).

    a = exp(-d T / J); terms of the order (d T / J)² are left out on the right.  So the weights of τ[n-2] to τ[n+1], found by
    least squares, have their centroid at n - 1/2.
    """
    plant = RigidPlant(2e-4)  # light, so that the motion is many encoder counts
    machine = open_virtual(profile, plant)
    opened.append(machine)
    rows: list[Row] = []
    machine.drive.record(binary(3000, 1.0), machine.limits, rows.append)
    torque, position = np.array(rows)[:, 1], np.array(rows)[:, 3]
    n = np.arange(2, len(position) - 1)
    lags = np.array([2, 1, 0, -1])
    a = math.exp(-plant.viscous_nm_s_rad * T / plant.inertia_kg_m2)
    moved = position[n + 1] - (1 + a) * position[n] + a * position[n - 1]
    weights, *_ = np.linalg.lstsq(np.stack([torque[n - lag] for lag in lags], axis=1), moved, rcond=None)
    assert weights.sum() == pytest.approx(T**2 / plant.inertia_kg_m2, rel=0.01)
    assert abs(float(weights @ lags / weights.sum() - 0.5) * T) < 50e-6


def test_the_setpoint_acts_one_period_after_it_became_active(profile, opened):
    machine = open_virtual(profile)
    opened.append(machine)
    rows: list[Row] = []
    machine.drive.record(binary(1000, 0.3), machine.limits, rows.append)
    table = np.array(rows)
    noise = [float(np.std(table[10:, 1] - table[10 - lag : len(table) - lag, 2])) for lag in (0, 1, 2)]
    assert noise[1] < 0.010  # 6 mN m of torque noise and half a step of 1.43 mN m
    assert min(noise[0], noise[2]) > 0.1


@pytest.mark.parametrize("kind", ["position", "velocity"])
def test_the_demand_inside_a_closed_loop_is_reported_with_the_same_alignment(profile, kind, opened):
    machine = open_virtual(profile)
    opened.append(machine)
    t = np.arange(800) * T
    speed = 20 * np.sin(2 * math.pi * t / 0.8) ** 2 * np.sin(2 * math.pi * t / 0.4)
    path = np.concatenate([[0.0], np.cumsum(speed)[:-1] * T])
    motion = Motion(kind, T, path if kind == "position" else 0 * t, speed, 0 * t)  # type: ignore[arg-type]
    rows: list[Row] = []
    machine.drive.record(motion, machine.limits, rows.append)
    table = np.array(rows)
    noise = [float(np.std(table[10:, 1] - table[10 - lag : len(table) - lag, 2])) for lag in (0, 1, 2)]
    assert np.argmin(noise) == 1
    assert noise[1] < 0.010
    assert table[:, 6] == pytest.approx(speed, abs=1e-3)
    if kind == "velocity":
        assert np.corrcoef(table[:, 4], speed)[0, 1] > 0.9


def test_feedforward_torque_is_added_or_refused(profile, opened):
    machine = open_virtual(profile)
    opened.append(machine)
    n = 100
    motion = Motion("position", T, np.zeros(n), np.zeros(n), np.full(n, 0.05))
    rows: list[Row] = []
    if profile == "cmmp-as":
        with pytest.raises(UsageError, match="takes no feedforward torque"):
            machine.drive.record(motion, machine.limits, rows.append)
        return
    machine.drive.record(motion, machine.limits, rows.append)
    assert rows[0][2] == pytest.approx(0.05, abs=0.002)


def test_a_lost_answer_is_a_gap_and_four_are_a_bus_error(profile, opened):
    faults = Faults()
    machine = open_virtual(profile, faults=faults)
    opened.append(machine)
    whole: list[Row] = []
    machine.drive.record(binary(200, 0.1), machine.limits, whole.append)
    faults.drop_tpdo = frozenset({machine_pdos(machine) + 100})
    rows: list[Row] = []
    report = machine.drive.record(binary(200, 0.1), machine.limits, rows.append)
    assert (report.lost_cycles, report.rows) == (1, 198)
    assert np.diff([row[0] for row in rows]).max() == pytest.approx(3 * T)
    sent = machine_pdos(machine)
    faults.drop_tpdo = frozenset(range(sent + 100, sent + 108))
    with pytest.raises(BusError, match="4 SYNCs in a row"):
        machine.drive.record(binary(200, 0.1), machine.limits, rows.append)
    assert machine.drive.read(["state"])["state"] < 4


def machine_pdos(machine: Machine) -> int:
    """PDOs the virtual drive has sent so far: the knob counts them."""
    (node,) = machine.drive._link.bus._nodes  # type: ignore[attr-defined]
    return int(node._sent_pdos)


def test_a_late_answer_does_not_pass_for_the_next_one(opened):
    # SYNC 100 is acted upon one tick late: its sample would carry the next one's time
    machine = open_virtual("reference", faults=Faults(late_sync=frozenset({100})))
    opened.append(machine)
    rows: list[Row] = []
    report = machine.drive.record(binary(300, 0.1), machine.limits, rows.append)
    assert report.lost_cycles == 1
    assert np.unique(np.round(np.diff([row[0] for row in rows]) / T)).tolist() == [1.0, 3.0]


def test_an_emergency_in_motion_is_a_fault_and_the_next_record_may_go_on(profile, opened):
    faults = Faults(emergency_at_s=0.2, emergency_code=0x4210)
    machine = open_virtual(profile, faults=faults)
    opened.append(machine)
    with pytest.raises(DriveFault, match=r"4210h, .*temperature") as caught:
        machine.drive.record(binary(500, 0.1), machine.limits, lambda row: None)
    assert caught.value.code == 0x4210
    assert machine.drive.read(["state"])["state"] == 7
    faults.emergency_at_s = None
    machine.drive.record(binary(50, 0.1), machine.limits, lambda row: None)


def test_a_host_that_hangs_is_noticed_by_the_drive_within_its_guard_time(profile, opened):
    machine = open_virtual(profile)
    opened.append(machine)
    plant = machine.plant
    assert plant is not None
    rows: list[Row] = []
    speeds: list[float] = []

    def hang(row: Row) -> None:
        rows.append(row)
        if len(rows) == 100:
            for _ in range(200):
                machine.drive.clock.sleep_until(machine.drive.clock.now() + T)
                speeds.append(plant.velocity_rad_s)

    motion = Motion("torque", T, np.zeros(300), np.zeros(300), np.full(300, 0.05))
    with pytest.raises(DriveFault, match=r"8130h.*host fell silent"):
        machine.drive.record(motion, machine.limits, hang)
    # the host's last sign of life is up to 15 ms old when it hangs; then the drive brakes by itself
    assert 0.030 <= float(np.argmax(speeds)) * T <= 0.055
    assert abs(speeds[-1]) < 0.2 * max(speeds)


def test_how_a_drive_takes_the_silence_is_seen(profile, opened):
    """The reference ramps down before its fault; with the knobs it lets the axis coast, or does not mind, and gets no torque."""
    for faults, brakes in ((Faults(), True), (Faults(guarding_coasts=True), False)):
        machine = open_virtual(profile, faults=faults)
        opened.append(machine)
        found = machine.drive.prove_guarding(machine.limits)
        assert found.brakes is brakes
        assert found.reaction_s == pytest.approx(0.05, abs=1.5 * T)  # CiA 301: the guard time, to a tick of the drive
    machine = open_virtual(profile, faults=Faults(guarding_ignored=True))
    opened.append(machine)
    with pytest.raises(DriveError, match="did not react within 100 ms"):
        machine.drive.record(binary(50, 0.1), machine.limits, lambda row: None)
    assert machine.plant is not None
    assert machine.plant.position_rad == 0.0


class FarPlant(RigidPlant):
    """Remembers how far it went in the positive direction."""

    furthest_rad = -math.inf

    def step(self, torque_nm: float, duration_s: float) -> None:
        super().step(torque_nm, duration_s)
        self.furthest_rad = max(self.furthest_rad, self.position_rad)


def stopped(machine: Machine, deceleration_rad_s2: float) -> tuple[float, float]:
    """Way, rad, that a stop out of a motion at 20 rad/s takes, and the speed it began with, rad/s; 6085h is what it was before."""
    drive, plant = machine.drive, machine.plant
    assert isinstance(plant, FarPlant)
    before = drive._objects.read_bytes(0x6085, 0)  # type: ignore[attr-defined]
    here, n = drive.read(["position_rad"])["position_rad"], 400
    speed = np.minimum(np.arange(n) * T / 0.2, 1.0) * 20.0
    at: list[tuple[float, float]] = []

    def sink(row: Row) -> None:
        if len(at) == 0 and row[0] > 0.3:
            at.append((plant.position_rad, plant.velocity_rad_s))
            raise SafetyStop("enough", "enough")

    with pytest.raises(SafetyStop, match="enough"):
        drive.record(
            Motion("velocity", T, np.full(n, here), speed, np.zeros(n)),
            replace(machine.limits, deceleration_rad_s2=deceleration_rad_s2),
            sink,
        )
    assert drive._objects.read_bytes(0x6085, 0) == before  # type: ignore[attr-defined]
    return plant.furthest_rad - at[0][0], at[0][1]


def test_a_stop_brakes_with_the_deceleration_of_the_limits(profile, opened):
    """From 20 rad/s, v²/2a + a lag below 2/100 s of the loop and 5 ms of reaction; the drive's own 1257 rad/s² comes back."""
    ways = []
    for deceleration in (math.inf, 400.0, 100.0):
        machine = open_virtual(profile, FarPlant())
        opened.append(machine)
        way, speed = stopped(machine, deceleration)
        ways.append(way)
        ideal = speed**2 / 2.0 / min(deceleration, 400.0 * math.pi)
        assert ideal < way < ideal + speed * (0.02 + 0.005), (way, speed)
    assert ways[0] < ways[1] < ways[2]


def test_torque_mode_is_left_through_a_loop_where_the_quick_stop_has_none(opened):
    """A quick stop that only takes the torque away lets this axis coast for ω J/d; profile velocity at no speed brakes it like any."""
    ways = {}
    for how in ("quick_stop", "velocity"):
        machine = open_virtual("cmmp-as", FarPlant(), faults=Faults(torque_stop_coasts=True))
        opened.append(machine)
        drive, plant, at = machine.drive, machine.plant, []
        assert isinstance(plant, FarPlant)
        drive._profile = replace(drive._profile, torque_exit=how)  # type: ignore[attr-defined]
        drive.prove_guarding(machine.limits)

        def sink(row: Row, plant: FarPlant = plant, at: list[float] = at) -> None:
            if not at and plant.velocity_rad_s > 20.0:
                at.append(plant.position_rad)
                raise SafetyStop("enough", "enough")

        motion = Motion("torque", T, np.zeros(400), np.zeros(400), np.full(400, 0.4))
        with pytest.raises(SafetyStop, match="enough"):
            drive.record(motion, replace(machine.limits, deceleration_rad_s2=400.0), sink)
        assert drive.read(["state"])["state"] < 4
        ways[how] = plant.furthest_rad - at[0]
    assert ways["quick_stop"] > 0.8 * 20.0 * 0.4
    ideal = 20.0**2 / 2.0 / 400.0
    assert ideal < ways["velocity"] < 1.6 * ideal + 20.0 * 0.03


def test_a_pulled_cable_is_a_bus_error_and_the_axis_comes_to_rest(profile, opened):
    machine = open_virtual(profile, faults=Faults(silent_from_s=0.3))
    opened.append(machine)
    with pytest.raises(BusError) as caught:
        machine.drive.record(binary(2000, 0.2), machine.limits, lambda row: None)
    assert any("guarding stops the axis" in note for note in caught.value.__notes__)
    assert machine.plant is not None
    assert abs(machine.plant.velocity_rad_s) < 0.1


def test_a_mode_that_is_never_shown_is_refused_with_its_number(opened):
    machine = open_virtual("reference", faults=Faults(refused_modes=frozenset({10})))
    opened.append(machine)
    with pytest.raises(DriveError, match="mode of operation 10"):
        machine.drive.record(binary(50, 0.1), machine.limits, lambda row: None)
    assert machine.drive.read(["state"])["state"] < 4


def test_homing_makes_the_drive_referenced(profile, opened):
    machine = open_virtual(profile)
    opened.append(machine)
    assert not machine.drive.capabilities.referenced
    machine.drive.home(machine.limits)
    assert machine.drive.capabilities.referenced
    assert machine.drive.read(["referenced"])["referenced"] == 1.0
    assert machine.drive.read(["state"])["state"] < 4


def test_a_referenced_encoder_knows_where_the_carriage_is():
    with open_drive("virtual:g_a", {"profile": "cmmp-as", "referenced": True, "start_position": 0.1}) as drive:
        assert drive.capabilities.referenced
        # thesis, table A.3: 12.42 mm effective pulley radius, no gearbox
        assert drive.read(["position_rad"])["position_rad"] == pytest.approx(0.1 / 0.01242, rel=1e-3)


def test_saved_parameters_are_those_of_the_drive_and_not_of_the_session(profile, opened):
    machine = open_virtual(profile)
    opened.append(machine)
    before = machine.drive.backup()
    machine.drive.save()
    assert machine.drive.backup() == before
    machine.drive.record(binary(50, 0.1), machine.limits, lambda row: None)


def test_closing_restores_every_object(profile):
    """All objects the adapter has written are back, those that stand for live values aside."""
    written: dict[tuple[int, int], None] = {}

    def log(frame: tuple[float, int, bytes, str]) -> None:
        _, identifier, data, source = frame
        if source == "host" and identifier == 0x601 and data[0] & 0xE0 == 0x20:
            written[int.from_bytes(data[1:3], "little"), data[3]] = None

    def contents(drive: Drive) -> dict[tuple[int, int], bytes]:
        live = (0x6040, 0x6060, 0x6071)
        return {key: drive._objects.read_bytes(*key) for key in written if key[0] not in live}

    machine = open_virtual(profile, log=log)
    drive = machine.drive
    gains = drive.backup()
    machine.drive.record(binary(50, 0.1), machine.limits, lambda row: None)
    here = np.full(50, drive.read(["position_rad"])["position_rad"])
    machine.drive.record(Motion("position", T, here, 0 * here, 0 * here), machine.limits, lambda row: None)
    drive.write(gains)
    drive._release = lambda: None  # keep the bus, to look at the drive afterwards
    drive.close()
    after = contents(drive)
    assert len(after) > 20
    fresh = open_virtual(profile)
    fresh.drive._session.give_back()
    assert after == {key: fresh.drive._objects.read_bytes(*key) for key in after}
    fresh.drive.close()
    drive._link.bus.shutdown()


def test_two_runs_with_one_seed_are_the_same_frames(profile):
    def run(seed: int) -> str:
        frames = FrameHash()
        machine = open_virtual(profile, seed=seed, log=frames)
        with machine.drive:
            machine.drive.record(binary(200, 0.2), machine.limits, lambda row: None)
        return frames.hexdigest()

    assert run(5) == run(5)
    assert run(5) != run(6)


def test_realtime_takes_real_time(opened):
    machine = open_virtual("reference", realtime=True)
    opened.append(machine)
    rows: list[Row] = []
    began_s = time.monotonic()
    machine.drive.record(binary(300, 0.1), machine.limits, rows.append)
    assert time.monotonic() - began_s > 0.3
    assert len(rows) + 2 * machine.drive.record(binary(10, 0.1), machine.limits, rows.append).lost_cycles >= 290


@pytest.mark.parametrize("plant", ["", ":g_b", ":egc_70"])
def test_shipped_plants_run_behind_the_drive(plant):
    rows: list[Row] = []
    with open_drive(f"virtual{plant}") as drive:
        here = drive.read(["position_rad"])["position_rad"]
        drive.record(binary(200, 0.3), Limits(here - 10, here + 10, 100, 1.0), rows.append)
    assert len(rows) == 200


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("virtual:no_such_plant", {}, "no_such_plant"),
        ("virtual", {"colour": "red"}, "no option colour; leave it out"),
        ("virtual", {"seed": "x"}, "seed must be a whole number"),
        ("virtual", {"start_position": "left"}, "start_position must be a number"),
        ("virtual", {"profile": "abb"}, "abb"),
    ],
)
def test_wrong_names_and_options_are_refused(name, options, words, caplog):
    gc.collect()  # what other tests left open
    caplog.clear()
    with pytest.raises(UsageError, match=words):
        open_drive(name, options)
    gc.collect()  # the exception's frames held the bus, if one was left open
    assert caplog.messages == []  # python-can warns of a bus that is destroyed before it is shut down
