"""The drive on RS-232, in virtual time: strokes, friction, everything that can go wrong with the cable, and once a real pseudo-terminal."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from beltcomm.drive import Drive, Limits, Motion, Row, open_drive
from beltcomm.drive.access import able, serve_drive
from beltcomm.errors import BeltcommError, BusError, DriveError, DriveFault, Refused, SafetyStop, UsageError
from beltcomm.identify.friction import find_plateaus, fit_friction
from beltcomm.virtual.faults import Faults
from beltcomm.virtual.service_port import LineFaults
from beltcomm_adapters.serial import _connect
from beltcomm_adapters.serial_strokes import Trapezoid
from beltcomm_adapters.virtual_serial import ServedSerial
from contract.conftest import Machine, RigidPlant, open_virtual
from contract.test_drive import STATE_DISABLED, stroke

WINDOW_RAD = 30.0


@pytest.fixture
def opened() -> Iterator[Callable[..., Machine]]:
    """``opened(profile, **options)``: the virtual drive at its serial port; closed after the test."""
    machines: list[Machine] = []

    def open_one(profile: str = "cmmp-as", plant: RigidPlant | None = None, **options: Any) -> Machine:
        machines.append(open_virtual(profile, plant, "serial:virtual", **options))
        return machines[-1]

    yield open_one
    for machine in machines:
        machine.drive.close()


class RubbingPlant(RigidPlant):
    """The same with Coulomb friction of 0.2 N m, stepped explicitly: at these speeds the signs are clear."""

    coulomb_nm = 0.2

    def step(self, torque_nm: float, duration_s: float) -> None:
        for _ in range(4):
            super().step(torque_nm - self.coulomb_nm * math.tanh(self.velocity_rad_s / 0.05), duration_s / 4)


def rest_and_strokes(machine: Machine, legs: list[tuple[float, float]]) -> Motion:
    """Strokes of (way, seconds) one after the other."""
    parts = [stroke(machine, way, seconds) for way, seconds in legs]
    shift, paths = 0.0, []
    for part in parts:
        paths.append(part.position_rad + shift)
        shift += part.position_rad[-1] - part.position_rad[0]
    path, speed = np.concatenate(paths), np.concatenate([part.velocity_rad_s for part in parts])
    return Motion("profile", machine.period_s, path, speed, np.zeros(len(path)))


# -- what it is for -----------------------------------------------------------------------------------------------------


def test_a_friction_sweep_finds_the_friction_of_the_plant(opened):
    """At constant speed the motor's torque is  d ω + c sign(ω)  (3.36); the plant's d and c are known, and its speeds are measured."""
    plant = RubbingPlant()
    machine = opened(plant=plant)
    rows: list[Row] = []
    legs = [(sign * speed * 0.75 * 1.6, 1.6) for speed in (4.0, 8.0, 14.0) for sign in (1.0, -1.0)]
    machine.drive.record(rest_and_strokes(machine, legs), machine.limits, rows.append)
    t, torque, _, angle, _, _, reference, _ = np.array(rows).T
    fit = fit_friction(find_plateaus(t, torque, angle, reference, inertia_kg_m2=plant.inertia_kg_m2))
    assert fit.coulomb.value == pytest.approx(plant.coulomb_nm, abs=0.003)  # 6 mN m of noise over 20 rows and more
    assert fit.viscous.value == pytest.approx(plant.viscous_nm_s_rad, rel=0.06)
    assert len(fit.points) == 6


def test_every_stroke_is_a_trapezoid_of_the_same_way_time_and_speed(opened):
    machine = opened()
    motion = stroke(machine, 6.0, 1.0)
    rows: list[Row] = []
    machine.drive.record(motion, machine.limits, rows.append)
    table = np.array(rows)
    path = Trapezoid(0.0, 6.0, 8.0, 32.0)  # 6 rad in 1 s with ramps of a quarter: 8 rad/s, 32 rad/s²
    begun = np.interp(1e-3, table[:, 5] - table[0, 5], table[:, 0])
    for row in table:
        assert row[5] - table[0, 5] == pytest.approx(path.at(row[0] - begun)[0], abs=0.3)  # begun is known to a poll of 15 ms
    assert path.duration_s == pytest.approx(1.0)
    assert path.at(0.5) == (pytest.approx(3.0), 8.0)
    short = Trapezoid(0.0, -1.0, 8.0, 4.0)  # too short for its speed: a triangle with √(1·4) = 2 rad/s at its top
    assert (short.top_rad_s, short.duration_s) == (2.0, 1.0)
    assert short.at(0.5)[0] == pytest.approx(-0.5)


def test_paths_that_are_no_strokes_are_refused(opened):
    machine = opened()
    here = machine.drive.read(["position_rad"])["position_rad"]
    t = np.arange(200) * machine.period_s
    two_speeds = np.concatenate([np.full(100, 1.0), np.full(98, 5.0), [0.0, 0.0]])
    two_speeds[0] = 0.0
    for speed, why in (
        (two_speeds, "no sequence of strokes"),
        (np.zeros(200), "goes nowhere"),
        (np.full(200, 2.0), "does not begin and end at rest"),
    ):
        path = here + np.cumsum(speed) * machine.period_s
        path -= path[0] - here
        with pytest.raises(UsageError, match=why):
            machine.drive.record(Motion("profile", machine.period_s, path, speed, np.zeros(len(t))), machine.limits, lambda _row: None)
    assert machine.drive.read(["position_rad"])["position_rad"] == here


def test_everything_lent_is_given_back_and_the_line_as_well(opened):
    plant = RigidPlant()
    machine = opened("reference", plant)
    drive: Any = machine.drive
    names = ((0x6060, "int8"), (0x6081, "uint32"), (0x6083, "uint32"), (0x6084, "uint32"), (0x6085, "uint32"), (0x6065, "uint32"))
    before = [drive._serial.read(index, 0, kind) for index, kind in names]
    limits = Limits(-WINDOW_RAD, WINDOW_RAD, 50.0, 1.0, 500.0, 3.0)
    drive.record(rest_and_strokes(machine, [(3.0, 0.5), (-2.0, 0.8)]), limits, lambda _row: None)
    assert [drive._serial.read(index, 0, kind) for index, kind in names] == before
    port = drive._line.port._port
    assert port.bitrate == 115200
    drive.close()
    assert port.bitrate == 9600


def test_at_9600_it_is_slower_and_says_so(opened):
    machine = opened(line_faults=LineFaults(bitrate_locked=True))
    assert machine.period_s == pytest.approx(0.12, abs=0.03)  # 92 characters of 10 bits are 96 ms
    rows: list[Row] = []
    machine.drive.record(stroke(machine, 4.0, 2.0), machine.limits, rows.append)
    assert rows[-1][3] == pytest.approx(4.0, abs=0.02)


def test_without_the_profile_s_name_the_numbers_must_decide():
    with pytest.raises(UsageError, match="a drive's RS-232 port has 9600, 19200"):
        open_drive("serial:virtual", {"bitrate": 250_000})
    with pytest.raises(UsageError, match="has no option node"):
        open_drive("serial:/dev/nowhere", {"node": 1})
    with pytest.raises(BusError, match="serial port /dev/nowhere cannot be opened"):
        open_drive("serial:/dev/nowhere")
    with pytest.raises(UsageError, match="say which port"):
        open_drive("serial:")


@pytest.mark.parametrize("kind", ["torque", "position", "velocity"])
def test_what_needs_a_bus_is_refused_before_anything_moves(kind):
    plant = RigidPlant()
    with pytest.raises(Refused, match=r"13 setpoints a second at 9600 bit/s and 160 at 115200.*nothing was moved") as caught:
        able(open_drive("serial:virtual", {"plant": plant}), kind)
    assert caught.value.exit_code == 1
    assert plant.position_rad == plant.velocity_rad_s == 0.0


def test_homing_is_refused(opened):
    machine = opened()
    assert not machine.drive.capabilities.can_home
    with pytest.raises(Refused, match="no homing is started over RS-232"):
        machine.drive.home(machine.limits)


# -- the cable ----------------------------------------------------------------------------------------------------------


def ticks(machine: Machine, seconds: float) -> None:
    machine.drive.clock.sleep_until(machine.drive.clock.now() + seconds)


@pytest.mark.parametrize("at_s", [0.15, 0.4, 0.7])
def test_a_pulled_cable_leaves_an_axis_that_ends_its_stroke_inside_the_window(opened, at_s):
    plant, faults = RigidPlant(), LineFaults()
    machine = opened(plant=plant, line_faults=faults)
    motion = stroke(machine, 8.0, 1.0)
    rows: list[Row] = []

    def pull(row: Row) -> None:
        rows.append(row)
        if row[0] > at_s:
            faults.silent_from_s = 0.0

    begun = machine.drive.clock.now()
    with pytest.raises(BusError, match=r"has not answered 4 times in a row while moving") as caught:
        machine.drive.record(motion, machine.limits, pull)
    assert any("if it runs on, it ends the stroke it has by itself at" in note for note in caught.value.__notes__)
    assert machine.drive.clock.now() - begun < 8.0  # it gives up and says so, and does not hang
    ticks(machine, 2.0)
    assert plant.position_rad == pytest.approx(8.0, abs=0.01)
    assert abs(plant.velocity_rad_s) < 1e-3
    lost_s = rows[-1][0]
    assert lost_s < at_s + 0.05


def test_lost_answers_are_survived_and_leave_gaps(opened):
    machine = opened(line_faults=LineFaults(seed=3))
    faults = machine.drive._line.port._port.faults  # type: ignore[attr-defined]
    faults.lost = 0.03
    rows: list[Row] = []
    report = machine.drive.record(stroke(machine, 6.0, 1.5), machine.limits, rows.append)
    table = np.array(rows)
    assert report.lost_cycles > 3
    assert np.diff(table[:, 0]).max() > 1.5 * machine.period_s
    assert table[-1, 3] == pytest.approx(6.0, abs=0.01)
    assert np.abs(table[:, 3] - table[:, 5]).max() < 2.0  # every row is of its own time: a row of another's would be off by rad


@pytest.mark.parametrize("seed", range(12))
def test_a_disturbed_line_ends_well_or_in_words_with_the_axis_at_rest(seed):
    """Noise, cuts, doubled, late and lost answers, no echo, wrong widths, at a rate that a bad cable has, from the opening on."""
    rng = np.random.default_rng(seed)
    shares = 0.02 * rng.random(6)
    faults = LineFaults(seed, 0.5e-3, 0.1 * shares[0], shares[1], shares[2], shares[3], shares[4], float(rng.choice([0.05, 0.4])))
    faults.wrong_width, faults.echo, faults.boots = shares[5], bool(seed % 4), seed % 3 == 0
    plant = RigidPlant()
    ended = "well"
    machine = None
    try:
        machine = open_virtual("cmmp-as", plant, "serial:virtual", line_faults=faults)
        machine.drive.record(rest_and_strokes(machine, [(5.0, 0.8), (-5.0, 0.8)]), machine.limits, lambda _row: None)
    except BeltcommError as error:
        ended = str(error)
    assert ended
    if machine is not None:
        ticks(machine, 3.0)  # whatever was begun is over then
        assert abs(plant.velocity_rad_s) < 0.01
        assert -1.0 < plant.position_rad < 6.0  # where it was asked to go, not where a spoilt digit would have sent it
        machine.drive.close()


def test_a_backup_that_noise_touches_is_none():
    truth = open_virtual("cmmp-as", None, "serial:virtual").drive
    expected = truth.backup()
    truth.close()
    taken = refused = 0
    for seed in range(12):
        machine = open_virtual("cmmp-as", None, "serial:virtual", line_faults=LineFaults(seed))
        machine.drive._line.port._port.faults.noise = 0.004  # type: ignore[attr-defined]
        try:
            assert machine.drive.backup() == expected
            taken += 1
        except BeltcommError:
            refused += 1
        machine.drive._line.port._port.faults.noise = 0.0  # type: ignore[attr-defined]
        machine.drive.close()
    assert taken > 3
    assert refused > 0


def test_a_drive_that_restarts_in_a_stroke_is_told(opened):
    plant, faults = RigidPlant(), LineFaults()
    machine = opened(plant=plant, line_faults=faults)

    def restart(row: Row) -> None:
        if row[0] > 0.5:
            faults.restart_at_s = 0.0

    with pytest.raises(BusError, match=r"has not answered 4 times in a row"):
        machine.drive.record(stroke(machine, 8.0, 1.0), machine.limits, restart)


def test_a_host_that_died_at_115200_is_found_again():
    """The drive keeps its bit rate and its stage when the host is gone; the next one finds it, disables it, and goes back at the end."""
    served = LineFaults()
    machine = open_virtual("cmmp-as", None, "serial:virtual", line_faults=served)
    port = machine.drive._line.port  # type: ignore[attr-defined]
    clock = machine.drive.clock
    from beltcomm_adapters.serial_drive import SerialDrive

    port.bitrate = 9600  # a new program opens the port as it always is
    again = SerialDrive(port, clock, 115200, "cmmp-as", lambda: None)
    assert again.backup() == machine.drive.backup()
    again.close()
    assert port._port.bitrate == 9600
    machine.drive._line.set_bitrate(9600)  # type: ignore[attr-defined]
    machine.drive.close()


# -- the machine --------------------------------------------------------------------------------------------------------


def test_an_encoder_that_jumps_is_the_drive_s_own_fault_and_told(opened):
    faults = Faults()
    machine = opened(faults=faults)
    faults.encoder_step_at_s, faults.encoder_step_counts = machine.drive.clock.now() + 0.8, 20_000
    with pytest.raises(DriveFault, match=r"8400h, speed control"):
        machine.drive.record(stroke(machine, 6.0, 1.0), machine.limits, lambda _row: None)
    assert machine.drive.read(["state"])["state"] in (*STATE_DISABLED, 7)


@pytest.mark.parametrize(("spoilt", "place"), [(1, 0x6064), (1, 0x6041), (1, 0x606C), (1, 0x6077), (2, 0x6064), (2, 0x6041), (2, 0x606C)])
def test_one_spoilt_digit_stops_nothing_and_two_alike_do(opened, monkeypatch, spoilt, place):
    """There is no checksum: what a sample says that would stop the axis must be said twice."""
    machine = opened()
    serial = machine.drive._serial
    poll, left = serial.poll, [spoilt]

    def spoil(index: int, kind: str) -> tuple[int, float] | None:
        answer = poll(index, kind)
        if index == place and answer is not None and left[0] and rows and rows[-1][0] > 0.5:
            left[0] -= 1
            return 0x0237 | 0x08 if index == 0x6041 else answer[0] + (20_000 if index == 0x6077 else 0x10000000), answer[1]
        return answer

    monkeypatch.setattr(serial, "poll", spoil)
    rows: list[Row] = []
    if spoilt == 1:
        report = machine.drive.record(stroke(machine, 6.0, 1.0), machine.limits, rows.append)
        assert report.lost_cycles == 1
        assert rows[-1][3] == pytest.approx(6.0, abs=0.01)
    else:
        with pytest.raises((SafetyStop, DriveFault)):
            machine.drive.record(stroke(machine, 6.0, 1.0), machine.limits, rows.append)


def test_a_stuck_axis_is_stopped_for_its_lag(opened):
    faults = Faults()
    machine = opened(faults=faults)
    faults.stuck_from_s = machine.drive.clock.now()
    limits = Limits(-WINDOW_RAD, WINDOW_RAD, 100.0, 1.5, 2000.0, 0.5)
    with pytest.raises(SafetyStop, match="lag") as caught:
        machine.drive.record(stroke(machine, 6.0, 1.0), limits, lambda _row: None)
    assert caught.value.reason == "lag"


def test_a_fault_of_the_drive_comes_with_its_code(opened):
    faults = Faults()
    machine = opened(faults=faults)
    faults.emergency_at_s = machine.drive.clock.now() + 0.8
    with pytest.raises(DriveFault, match=r"3220h.*DC-link undervoltage") as caught:
        machine.drive.record(stroke(machine, 6.0, 1.0), machine.limits, lambda _row: None)
    assert caught.value.code == 0x3220


def test_a_speed_above_the_limit_is_refused_and_mode_1_must_be_there(opened):
    machine = opened()
    slow = Limits(-WINDOW_RAD, WINDOW_RAD, 5.0, 1.5)
    with pytest.raises(UsageError, match="reaches 8 rad/s, the limit is 5 rad/s"):
        machine.drive.record(stroke(machine, 6.0, 1.0), slow, lambda _row: None)
    refused = opened(faults=Faults(refused_modes=frozenset({1})))
    refused.drive._serial.write(0x6060, 0, "int8", 3)  # type: ignore[attr-defined]
    with pytest.raises(DriveError, match="does not take mode of operation 1"):
        refused.drive.record(stroke(refused, 6.0, 1.0), refused.limits, lambda _row: None)


# -- a real port --------------------------------------------------------------------------------------------------------


#: Tries of what runs at the wall clock.
BUSY = 5


def test_over_a_pseudo_terminal_with_pyserial() -> None:
    """The same drive at the wall clock behind a real terminal: opened, read, moved, and back at 9600 bit/s.

    A computer that is busy may leave the drive's thread without time for longer than a moving axis may go unseen: then once more.
    """
    for left in reversed(range(BUSY)):
        try:
            plant, rows, bitrate = over_a_pseudo_terminal()
            break
        except BusError:
            if not left:
                raise
    assert plant.position_rad == pytest.approx(3.0, abs=0.02)
    assert (np.diff(np.array(rows)[:, 0]) > 0).all()
    assert bitrate == 9600


def over_a_pseudo_terminal() -> tuple[RigidPlant, list[Row], int]:
    """Machine, rows and the port's bit/s after a stroke of 3 rad."""
    plant = RigidPlant()
    with serve_drive("virtual", "rs232", {"profile": "cmmp-as", "plant": plant, "referenced": False}) as served:
        assert isinstance(served, ServedSerial)
        over = threading.Event()
        server = threading.Thread(target=served._terminal.serve, args=(lambda: not over.is_set(),))
        server.start()
        try:
            with _connect(served.reached_as.removeprefix("serial:"), 115200, "cmmp-as", False) as drive:
                assert isinstance(drive.version, str)
                stored = _with_gains(drive, plant)
                assert drive.backup() == stored
                machine = Machine(drive, Limits(-WINDOW_RAD, WINDOW_RAD, 100.0, 1.5), plant)
                rows: list[Row] = []
                drive.record(stroke(machine, 3.0, 1.0), machine.limits, rows.append)
            return plant, rows, served._terminal._port.bitrate
        finally:
            over.set()
            server.join()


def _with_gains(drive: Drive, plant: RigidPlant) -> dict[str, float]:
    drive.calibrate({name: drive.capabilities.parameters[name].scale for name in drive.capabilities.uncalibrated})  # as the profile says
    kp = 100.0 * plant.inertia_kg_m2
    return {**drive.backup(), **drive.write({"kp_nm_s_rad": kp, "ki_nm_rad": 32.0 * kp, "kpp_1_s": 20.0})}
