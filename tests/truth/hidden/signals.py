"""What the drive is asked to do: multisines, moves at constant speed, triangles, random moves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from truth.hidden.layout import Array
from truth.hidden.recorder import PERIOD_S

#: Samples of one period of a multisine at 1 kHz, and its highest frequency.
PERIOD_SAMPLES = 2048
HIGHEST_HZ = 250.0
LOWEST_HZ = 2.0
#: Share of the sample rate that no excitation exceeds.
HIGHEST_SHARE = 0.4


def samples_per_period(period_s: float) -> int:
    """Samples of one period of a multisine: 2.048 s."""
    return round(PERIOD_SAMPLES * PERIOD_S / period_s)


def multisine(rng: np.random.Generator, weights: Array | None = None, period_s: float = PERIOD_S) -> tuple[Array, list[int], list[int]]:
    """One period of an odd random-phase multisine with largest value 1, its excited lines and its detection lines.

    Lines are multiples of 1/2.048 s between 2 and 250 Hz; even ones stay empty, of every four odd ones one at random.
    weights : (samples//2 + 1,), relative size of the lines, all equal when None.   period_s : of the samples; below 2.5 kHz / 250 Hz
    the highest frequency is 0.4 of the rate.
    """
    samples = samples_per_period(period_s)
    highest = min(HIGHEST_HZ, HIGHEST_SHARE / period_s)
    first, last = math.ceil(LOWEST_HZ * samples * period_s), math.floor(highest * samples * period_s)
    odd = [k for k in range(first, last + 1) if k % 2 == 1]
    excited, empty = [], []
    for group in range(0, len(odd), 4):
        four = odd[group : group + 4]
        left_out = int(rng.integers(0, 4))
        empty += four[left_out : left_out + 1]
        excited += [k for i, k in enumerate(four) if i != left_out]
    spectrum = np.zeros(samples // 2 + 1, dtype=complex)
    spectrum[excited] = np.exp(1j * rng.uniform(0.0, math.tau, len(excited)))
    period = np.fft.irfft(spectrum if weights is None else spectrum * weights, samples)
    return period / np.abs(period).max(), excited, empty


@dataclass(frozen=True)
class Reference:
    """Position (m), speed (m/s) and acceleration (m/s2) asked for, each (n,)."""

    position_m: Array
    speed_m_s: Array
    acceleration_m_s2: Array


class Path:
    """Builds a reference piece by piece at the sample rate; every ramp of the speed is a smoothstep of third order."""

    def __init__(self, start_m: float, period_s: float = PERIOD_S) -> None:
        self.now_m, self.period_s = start_m, period_s
        self._pieces: list[Reference] = []

    @property
    def duration_s(self) -> float:
        """Of everything so far."""
        return sum(len(piece.position_m) for piece in self._pieces) * self.period_s

    def rest(self, seconds: float) -> Path:
        """Stand still."""
        n = round(seconds / self.period_s)
        self._pieces.append(Reference(np.full(n, self.now_m), np.zeros(n), np.zeros(n)))
        return self

    def move(self, to_m: float, speed: float, acceleration: float) -> Path:
        """Go to a position with at most a speed, m/s, and a peak acceleration, m/s2."""
        way = abs(to_m - self.now_m)
        if way == 0.0:
            return self
        speed = min(speed, math.sqrt(way * acceleration / 1.5))  # a smoothstep ramp lasts 1.5 speed/acceleration
        ramp = max(round(1.5 * speed / acceleration / self.period_s), 4) * self.period_s
        whole = max(round((way / speed + ramp) / self.period_s), round(2 * ramp / self.period_s)) * self.period_s
        top = way / (whole - ramp) * math.copysign(1.0, to_m - self.now_m)
        t = np.arange(round(whole / self.period_s)) * self.period_s
        up, down = np.clip(t / ramp, 0.0, 1.0), np.clip((whole - t) / ramp, 0.0, 1.0)
        shape = (3 * up**2 - 2 * up**3) * (3 * down**2 - 2 * down**3)
        slope = 6 * (up - up**2) / ramp - 6 * (down - down**2) / ramp
        travelled = ramp * (up**3 - 0.5 * up**4) + np.clip(t - ramp, 0.0, whole - 2 * ramp)
        travelled += ramp * (0.5 - (down**3 - 0.5 * down**4))
        self._pieces.append(Reference(self.now_m + top * travelled, top * shape, top * slope))
        self.now_m = to_m
        return self

    def triangle(self, amplitude: float, speed: float, cycles: int) -> Path:
        """Back and forth around the position at constant speed, corners without ramp."""
        n = max(round(4.0 * amplitude / speed / self.period_s), 4)
        t = np.arange(cycles * n) / n % 1.0
        wave = np.where(t < 0.25, 4 * t, np.where(t < 0.75, 2 - 4 * t, 4 * t - 4))
        sign = np.where((t < 0.25) | (t >= 0.75), 1.0, -1.0)
        true_speed = 4.0 * amplitude / (n * self.period_s)
        self._pieces.append(Reference(self.now_m + amplitude * wave, true_speed * sign, np.zeros(len(t))))
        return self

    def reference(self) -> Reference:
        """Everything so far in one piece."""
        parts = zip(*((r.position_m, r.speed_m_s, r.acceleration_m_s2) for r in self._pieces), strict=True)
        return Reference(*(np.concatenate(part) for part in parts))


def sweep(start: float, low: float, high: float, speeds: Sequence[float], acceleration: float, period_s: float = PERIOD_S) -> Path:
    """Full strokes both ways at each speed."""
    path = Path(start, period_s).rest(0.25)
    for speed in speeds:
        path.move(high, speed, acceleration).rest(0.1).move(low, speed, acceleration).rest(0.1)
    return path.rest(0.35)
