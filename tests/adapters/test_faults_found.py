"""What the fault campaign found in the adapter, one by one."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from beltcomm.drive import Limits, Motion, open_drive
from beltcomm.errors import BusError, DriveError, DriveFault, UsageError
from beltcomm.runfolder import RunFolder
from beltcomm.virtual.faults import BusFaults, Faults, FrameFault
from beltcomm_adapters.consistency import Odometer

LIMITS = Limits(-40.0, 60.0, 60.0, 0.9, 500.0)
N = 300
PUSH = Motion("torque", 1e-3, np.zeros(N), np.zeros(N), 0.4 * np.sin(2.0 * np.pi * 5.0 * np.arange(N) * 1e-3))


def opened(profile: str = "reference", bus_faults: BusFaults | None = None, **faults: Any) -> Any:
    return open_drive("virtual:g_a", {"profile": profile, "faults": Faults(**faults), "bus_faults": bus_faults})


@pytest.mark.parametrize("profile", ["reference", "cmmp-as"])
def test_doubled_frames_do_not_shift_the_rows(profile: str) -> None:
    """A doubled SYNC has two answers; the second must not pass for the answer to the next SYNC, or all rows are a period late."""
    plain: list[tuple[float, ...]] = []
    with opened(profile) as drive:
        drive.record(PUSH, LIMITS, plain.append)
    rows: list[tuple[float, ...]] = []
    doubled = FrameFault("doubled", kinds=frozenset({"tpdo"}), rate=0.05)
    with opened(profile, BusFaults(frames=(doubled,), seed=1)) as drive:
        drive.record(PUSH, LIMITS, rows.append)
    assert [row[0] for row in rows] == pytest.approx([row[0] for row in plain])
    assert [row[3] for row in rows] == [row[3] for row in plain]


def test_doubled_answers_to_sdo_are_not_answers_to_the_next_request() -> None:
    with opened(bus_faults=BusFaults(frames=(FrameFault("doubled", kinds=frozenset({"sdo answer"}), rate=1.0),))) as drive:
        backup = drive.backup()
        assert drive.write({"kp_nm_s_rad": 0.25})["kp_nm_s_rad"] == 0.25
        assert drive.backup() == {**backup, "kp_nm_s_rad": 0.25}


def test_a_restart_is_called_a_restart_and_stays_known() -> None:
    drive = opened(reset_at_s=0.1)
    with pytest.raises(DriveFault, match=r"the drive restarted while .*check its supply"):
        drive.record(PUSH, LIMITS, lambda _row: None)
    with pytest.raises(DriveFault, match="restarted"):  # what was written to it is gone: nothing moves any more in this connection
        drive.record(PUSH, LIMITS, lambda _row: None)
    drive.close()
    drive._link.bus.shutdown()


def test_a_fault_between_two_motions_is_not_acknowledged_on_the_way() -> None:
    faults = Faults(emergency_code=0x4210)
    drive: Any = open_drive("virtual:g_a", {"faults": faults})
    drive.record(PUSH, LIMITS, lambda _row: None)
    faults.emergency_at_s = drive.clock.now()
    drive.clock.sleep_until(drive.clock.now() + 0.1)
    with pytest.raises(DriveFault, match="standing between two motions: error 4210h"):
        drive.record(PUSH, LIMITS, lambda _row: None)
    drive.close()


def test_a_bus_that_was_off_for_a_while_gets_its_settings_back() -> None:
    drive = opened(bus_faults=BusFaults(off_from_s=0.1, off_until_s=2.1))
    before = {index: drive._objects.read_bytes(*index) for index in ((0x6080, 0), (0x6085, 0), (0x1400, 1), (0x1A00, 1), (0x1016, 1))}
    with pytest.raises(BusError, match="does not send or receive"):
        drive.record(PUSH, LIMITS, lambda _row: None)
    assert {index: drive._objects.read_bytes(*index) for index in before} == before
    drive.close()


@pytest.mark.parametrize("by_s", [-3.0, 3.0])
def test_a_clock_that_is_set_is_named(by_s: float) -> None:
    drive = opened(bus_faults=BusFaults(clock_jump_at_s=0.1, clock_jump_s=by_s, stamps_only=True))
    with pytest.raises(BusError, match=r"the clock that stamps the CAN frames was set by [+-]3\.0 s.*NTP"):
        drive.record(PUSH, LIMITS, lambda _row: None)
    drive.close()


def test_position_and_speed_of_different_factors_are_noticed() -> None:
    """cmmp-as has a factor for each: 6093h reads 2/1 while a count is a count."""
    drive = opened("cmmp-as", misread={(0x6093, 1): 2})
    far = Motion("torque", 1e-3, np.zeros(N), np.zeros(N), np.full(N, 0.4))
    with pytest.raises(DriveError, match=r"position changes 2\.0\d times as fast as its speed says.*6093h"):
        drive.record(far, LIMITS, lambda _row: None)
    drive.close()


def metered(speed_rad_s: NDArray[np.float64], factor: float, share: float) -> None:
    """A motion past an odometer, its position scaled.   speed_rad_s : every ms.   share : of a step that its filter takes at once."""
    unit_rad, unit_rad_s = 1e-4, 1e-3
    position = np.rint(factor * np.cumsum(speed_rad_s * 1e-3) / unit_rad).astype(int)
    filtered = lfilter([share], [1.0, share - 1.0], speed_rad_s)
    meter = Odometer(unit_rad, unit_rad_s)
    for travel, speed in zip(np.diff(position, prepend=0), filtered, strict=True):
        meter(int(travel), round(speed / unit_rad_s), 1e-3)


def test_an_odometer_forgets_what_it_has_refused() -> None:
    """One jump of the encoder is refused once; the way after it is judged by itself."""
    meter = Odometer(1e-4, 1e-3)

    def drive(travel: int, samples: int) -> None:
        for _ in range(samples):
            meter(travel, 20_000, 1e-3)  # 20 rad/s, 200 counts in a ms

    drive(200, 150)
    meter(10**6, 20_000, 1e-3)
    with pytest.raises(DriveError, match="times as fast"):
        drive(200, 5)
    meter.begin()
    drive(200, 3000)
    with pytest.raises(DriveError, match="times as fast"):
        drive(500, 3000)


T_S = np.arange(4000) * 1e-3
STEPS = {f"steps at {f:g} Hz": 60.0 * np.sign(np.sin(2.0 * np.pi * f * T_S)) + 10.0 for f in (2.0, 10.0, 40.0)}
#: A sampled filter takes more from the speed near the sampling rate than its lag gives back: by itself this looks like a factor of 1.8.
RINGING = {"a belt that rings": 40.0 * np.sin(2.0 * np.pi * 150.0 * T_S) + 8.0 * np.sin(2.0 * np.pi * 5.0 * T_S)}


@pytest.mark.parametrize("lag_s", [0.0, 2.5e-3, 8e-3])
@pytest.mark.parametrize("motion", [*STEPS, *RINGING])
def test_a_filtered_speed_is_no_wrong_factor(motion: str, lag_s: float) -> None:
    """First-order lags of up to 8 ms: the ratio stays within its bounds, twice and half the factor do not."""
    speed, share = {**STEPS, **RINGING}[motion], -math.expm1(-1e-3 / lag_s) if lag_s else 1.0
    metered(speed, 1.0, share)
    for factor in (2.0, 0.5):
        with pytest.raises(DriveError, match="times as fast"):
            metered(speed, factor, share)


def test_a_run_is_not_gone_on_with_when_the_drives_units_have_changed(tmp_path: Any) -> None:
    from beltcomm.axis import load_axis

    folder = RunFolder.create(tmp_path / "run", load_axis("egc-70-600"))
    with opened() as drive:
        folder.claim_drive(drive.capabilities.identity)
    with opened(misread={(0x6092, 1): 131072}) as drive, pytest.raises(UsageError, match="units_per_turn 65536 -> 131072"):
        folder.claim_drive(drive.capabilities.identity)
    with opened(rated_torque_nm=2.86) as drive, pytest.raises(UsageError, match=r"rated_torque_nm 1\.43 -> 2\.86"):
        folder.claim_drive(drive.capabilities.identity)
