"""Cycles per second of the virtual drive: host, CANopen on both sides, drive and machine in one process; and its periods in real time."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from beltcomm.drive import Drive, Limits, Motion, open_drive
from benchmarks.speeds.measure import Figure, in_turn, spread

PERIOD_S = 1e-3
CYCLES, REALTIME_CYCLES = 2000, 5000
AIM = 25.0


def shaken(cycles: int) -> Motion:
    """A torque that turns round every 20 ms."""
    t = np.arange(cycles) * PERIOD_S
    zero = np.zeros(cycles)
    return Motion("torque", PERIOD_S, zero, zero, 0.3 * np.where((t / 0.02).astype(int) % 2 == 0, 1.0, -1.0))


def followed(cycles: int, here_rad: float) -> Motion:
    """To and fro by 2 rad twice a second."""
    t = np.arange(cycles) * PERIOD_S
    path = here_rad + 1.0 - np.cos(4.0 * np.pi * t)
    return Motion("position", PERIOD_S, path, 4.0 * np.pi * np.sin(4.0 * np.pi * t), np.zeros(cycles))


def opened(plant: str, **options: object) -> tuple[Drive, Limits]:
    """A virtual drive with gains that follow, limits around where it stands."""
    drive = open_drive(f"virtual:{plant}", {"seed": 1, **options})
    drive.calibrate({name: drive.capabilities.parameters[name].scale for name in drive.capabilities.uncalibrated})
    drive.write({"kp_nm_s_rad": 0.02, "ki_nm_rad": 0.1, "kpp_1_s": 15.0})
    here = drive.read(["position_rad"])["position_rad"]
    return drive, Limits(here - 20.0, here + 20.0, 200.0, 2.0)


def virtual_time(rounds: int) -> Iterator[Figure]:
    """How many times as fast as the clock; enabling, guarding and stopping belong to each record, as in a commissioning."""
    drive, limits = opened("g_b")
    with drive:
        ticks: list[float] = []

        def record(kind: str) -> None:
            now = drive.read(["position_rad"])["position_rad"]  # where the record before has left it
            start = drive.clock.now()  # type: ignore[attr-defined]
            drive.record(shaken(CYCLES) if kind == "torque" else followed(CYCLES, now), limits, lambda _row: None)
            ticks.append(drive.clock.now() - start)  # type: ignore[attr-defined]

        for name in ("torque", "position"):
            (values,) = in_turn([lambda name=name: record(name)], rounds)  # type: ignore[misc]
            s = spread([ticks[-1] / value for value in values])
            note = f"{s.median / PERIOD_S:.0f} SYNC cycles per second"
            yield Figure("drive", f"both sides and the plant, {name}", s.median, "x real time", AIM, True, s.low, s.high, note)


def real_time() -> Iterator[Figure]:
    """At the wall clock, 1 kHz: when the SYNCs went out, and how many ticks were missed."""
    sent: list[float] = []

    def log(frame: tuple[float, int, bytes, str]) -> None:
        if frame[1] == 0x80 and frame[3] == "host":
            sent.append(time.perf_counter())

    drive, limits = opened("g_b", realtime=True, log=log)
    with drive:
        bus = drive._link.bus  # type: ignore[attr-defined]
        sent.clear()
        before = bus.missed_cycles
        report = drive.record(shaken(REALTIME_CYCLES), limits, lambda _row: None)
        missed = bus.missed_cycles - before
    periods_us = 1e6 * np.diff(sent)
    percent = np.percentile(periods_us, [1, 50, 99, 99.9])
    note = f"1 % {percent[0]:.0f}, 99 % {percent[2]:.0f}, 99.9 % {percent[3]:.0f}, largest {periods_us.max():.0f} us of {len(periods_us)}"
    yield Figure("drive", "period at the wall clock, median", float(percent[1]), "us", note=note)
    yield Figure(
        "drive",
        "ticks of 1 ms that the wall clock had left",
        float(missed),
        f"beside {len(sent)}",
        note=f"{report.lost_cycles} answers lost",
    )


def run(rounds: int) -> Iterator[Figure]:
    """All figures of the topic."""
    yield from virtual_time(rounds)
    yield from real_time()
