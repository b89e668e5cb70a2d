"""Instruments: how the drive makes, and how it reports, torque, angle and time; drawn from random numbers of their own."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from truth.hidden import drive
from truth.hidden.layout import Array

if TYPE_CHECKING:
    from truth.hidden.machines import Base

#: s: a belt axis is recorded at the first four, an axis without a belt at any.
PERIODS_S: Final = (0.5e-3, 1e-3, 2e-3, 4e-3, 5e-3, 10e-3)
#: Largest number of samples in which the belt may swing once to be recorded: nobody records a resonance above the half rate.
RESONANCE_PERIODS: Final = 0.3
#: What a drive may have beside sample period, encoder and columns, and how often each is drawn beside the others.
ITEMS: Final = {
    "setpoint_filter": 3.0,
    "current_loop": 3.0,
    "process_torque": 3.0,
    "reading_filter": 3.0,
    "reading_late": 2.0,
    "reading_steps": 2.0,
    "inner_cycle": 1.0,
    "slew": 1.0,
    "torque_steps": 1.0,
    "second_delay": 0.5,
    "command_only": 1.0,
    "noise_colour": 1.5,
    "interpolation": 1.5,
    "angle_noise": 1.0,
    "stamp_jitter": 1.0,
    "sampling_jitter": 0.5,
}


@dataclass(frozen=True)
class Instruments:
    """Drive, torque reading, encoder and clock.   The defaults are the ideal ones.

    period_s : sample period of controller and recording.   stamp_jitter : time stamps off by up to this share of the period, samples
    even.   sampling_jitter : samples themselves uneven by up to this share, stamps true.

    delay_samples : from setpoint to command, whole samples.   setpoint_step : command in steps, share of rated torque.
    setpoint_alpha : y[n] = y[n-1] + alpha (command[n] - y[n-1]); 1 for none.   inner_phase : the command changes at this share of the
    sample.   slew_nm_s : rate limit, 0 for none.   setpoint_filter_s : continuous first-order filter, 0 for none.
    loop_order, loop_s, loop_damping : current loop, 0 for none, time constant or 1/angular frequency.
    process_share, process_colour : torque that acts beside, rms over rated torque, held over a sample, AR(1) with this pole.

    reading_filter_s : first-order filter on the reported torque.   reading_late : samples by which it is late.   latched : an
    unfiltered reading is the torque of one instant, not the mean over the sample.   reading_step : share of rated torque.
    command_only : the drive reports its command as actual torque.   noise_colour : AR(1) pole of the noise of the reading.
    noise_inside : the noise passes the filter of the reading, too.

    counts_per_rev : None for the ideal encoder of the machine.   lines_per_rev, once_rad, twice_rad, phases_rad : interpolation error.
    angle_noise_rad : rms, before the counts.   setpoint_column : whether torque_setpoint_nm is recorded.
    """

    period_s: float = 1e-3
    stamp_jitter: float = 0.0
    sampling_jitter: float = 0.0
    delay_samples: int = 1
    setpoint_step: float = 0.0
    setpoint_alpha: float = 1.0
    inner_phase: float = 0.0
    slew_nm_s: float = 0.0
    setpoint_filter_s: float = 0.0
    loop_order: int = 0
    loop_s: float = 0.0
    loop_damping: float = 0.0
    process_share: float = 0.0
    process_colour: float = 0.0
    reading_filter_s: float = 0.0
    reading_late: float = 0.0
    latched: bool = False
    reading_step: float = 0.0
    command_only: bool = False
    noise_colour: float = 0.0
    noise_inside: bool = False
    counts_per_rev: int | None = None
    lines_per_rev: int = 0
    once_rad: float = 0.0
    twice_rad: float = 0.0
    phases_rad: tuple[float, float] = (0.0, 0.0)
    angle_noise_rad: float = 0.0
    setpoint_column: bool = True

    @classmethod
    def ideal(cls) -> Instruments:
        """A drive that makes and reports exactly what it is asked, one sample later; white noise on the reading, 1 kHz."""
        return cls()

    @property
    def shaped(self) -> bool:
        """Whether anything but one sample of delay lies between setpoint, shaft and reported torque, or the samples are uneven."""
        plain = (0.0, 0, False)
        path = ("setpoint_step", "inner_phase", "slew_nm_s", "setpoint_filter_s", "loop_order", "process_share", "sampling_jitter")
        reading = ("reading_filter_s", "reading_late", "latched", "command_only")
        return self.delay_samples != 1 or self.setpoint_alpha != 1.0 or any(getattr(self, name) not in plain for name in (*path, *reading))

    def vector(self, rated_torque_nm: float) -> Array:
        """The instruments as the kernel takes them."""
        d = np.zeros(drive.PLACES)
        d[drive.SHAPED], d[drive.DELAY], d[drive.ALPHA] = self.shaped, self.delay_samples, self.setpoint_alpha
        d[drive.FILTER_S], d[drive.LOOP_ORDER], d[drive.LOOP_S] = self.setpoint_filter_s, self.loop_order, self.loop_s
        d[drive.LOOP_DAMPING], d[drive.SLEW], d[drive.PHASE] = self.loop_damping, self.slew_nm_s, self.inner_phase
        d[drive.STEP_NM] = self.setpoint_step * rated_torque_nm
        d[drive.READ_S], d[drive.LATE] = self.reading_filter_s, self.reading_late
        d[drive.LATCHED], d[drive.COMMAND_ONLY] = self.latched, self.command_only
        d[drive.LINES], d[drive.ONCE], d[drive.TWICE] = self.lines_per_rev, self.once_rad, self.twice_rad
        d[drive.ONCE_PHASE], d[drive.TWICE_PHASE] = self.phases_rad
        return d

    @property
    def delay_s(self) -> float:
        """From setpoint to the change of the torque."""
        return self.period_s * (self.delay_samples + self.inner_phase)

    def filtering(self, freq_hz: Array) -> np.ndarray[Any, np.dtype[np.complex128]]:
        """Response of filters and current loop from setpoint to acting torque; for the controller's design."""
        s = 2j * math.pi * freq_hz
        z = np.exp(s * self.period_s)
        path = np.ones_like(s)
        if self.setpoint_alpha < 1.0:
            path = path * self.setpoint_alpha / (1.0 - (1.0 - self.setpoint_alpha) / z)
        path = path / (1.0 + s * self.setpoint_filter_s)
        if self.loop_order == 1:
            path = path / (1.0 + s * self.loop_s)
        if self.loop_order == 2:
            path = path / (1.0 + 2.0 * self.loop_damping * s * self.loop_s + (s * self.loop_s) ** 2)
        return np.asarray(path)

    def describe(self) -> dict[str, Any]:
        """What is not ideal, rounded, and the sample period."""
        ideal = Instruments()
        told: dict[str, Any] = {"period_s": self.period_s}
        for item in fields(self):
            value = getattr(self, item.name)
            if value != getattr(ideal, item.name) and item.name != "phases_rad":
                told[item.name] = float(f"{value:.4g}") if isinstance(value, float) else value
        return told


def draw_instruments(seed: int, base: Base) -> Instruments:
    """Random instruments for a healthy machine, from random numbers of their own: the machine of the seed stays the same.

    Always drawn: the sample period (1 ms in half of the draws, else 0.5, 2, 4 ms; without a belt 5 and 10 ms too, all alike; at least
    ``1/RESONANCE_PERIODS`` samples in a period of the resonance); counts per turn, uniform in the logarithm from 500 to 1 048 576 (65 536
    without a belt); the column of the setpoint is there in three of four.

    Of ``ITEMS`` then one (45 % of the draws), two (35 %), three or four (14 %) or all (6 %; ``command_only``, which has no filter, no
    lateness and no noise, then left out); those of a kind more often found with more weight.
    * setpoint_filter: in the samples' clock, alpha 0.4 to 1, or continuous, 0.1 to 1 ms.   * current_loop: first order, 0.05 to 0.5 ms,
      or second, 300 Hz to 2 kHz, damping ratio 0.5 to 1.   * process_torque: up to 1 % of rated, white, or a pole of 0.5 to 0.98.
    * reading_filter: 0.2 to 5 ms, the noise inside it in half of them.   * reading_late: 0.05 to 1 sample, one of four latched.
    * reading_steps, torque_steps: 0.1 to 1 % of rated.   * inner_cycle: at 0.05 to 0.95 of the sample.   * slew: peak torque in 3 to 20 ms.
    * second_delay: two samples.   * command_only: in steps of 0.1 %, beside it process torque.   * noise_colour: a pole of 0.3 to 0.95.
    * interpolation: once 1e-5 to 2e-4 rad per line, twice 0.1 to 1 times that; 128 to 2048 lines and 64 to 1024 counts to
      a line (within the range of the counts), in place of the counts drawn before.
    * angle_noise: 0.3 to 3 counts.   * stamp_jitter: 0.02 to 0.2, sampling_jitter: 0.001 to 0.01 of the period.
    """
    rng = np.random.default_rng((seed, 20))
    values: dict[str, Any] = {}
    if base.rigid:
        periods, shares = list(PERIODS_S), [1.0] * len(PERIODS_S)
    else:
        periods = [t for t in PERIODS_S[:4] if t * base.resonance_hz <= RESONANCE_PERIODS]
        shares = [3.0 if t == 1e-3 else 1.0 for t in periods]
    values["period_s"] = float(rng.choice(periods, p=np.array(shares) / sum(shares)))
    values["counts_per_rev"] = round(_log(rng, 500.0, 65536.0 if base.rigid else 2.0**20))
    values["setpoint_column"] = bool(rng.random() < 0.75)
    count = int(rng.choice([1, 2, 3, 4, len(ITEMS)], p=[0.45, 0.35, 0.08, 0.06, 0.06]))
    weights = np.array(list(ITEMS.values()))
    items = set(map(str, rng.choice(list(ITEMS), count, replace=False, p=weights / weights.sum())))
    if count == len(ITEMS):
        items.discard("command_only")
    if "command_only" in items:
        items -= {"reading_filter", "reading_late", "noise_colour"}
        items.add("process_torque")
    for item in [name for name in ITEMS if name in items]:
        values |= _drawn(item, rng, base, values["counts_per_rev"])
    return Instruments(**values)


def with_coloured_process(seed: int, instruments: Instruments) -> Instruments:
    """The same instruments with process torque of up to 1 % of rated and a pole of 0.5 to 0.98, from random numbers of their own."""
    rng = np.random.default_rng((seed, 21))
    return replace(instruments, process_share=float(rng.uniform(0.001, 0.01)), process_colour=float(rng.uniform(0.5, 0.98)))


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    """Uniform in the logarithm."""
    return float(low * (high / low) ** rng.uniform(0.0, 1.0))


def _drawn(item: str, rng: np.random.Generator, base: Base, counts: int) -> dict[str, Any]:
    """The fields of one item."""
    u = rng.uniform
    if item == "setpoint_filter":
        return {"setpoint_alpha": u(0.4, 1.0)} if rng.random() < 0.5 else {"setpoint_filter_s": _log(rng, 0.1e-3, 1e-3)}
    if item == "current_loop" and rng.random() < 0.5:
        return {"loop_order": 1, "loop_s": _log(rng, 0.05e-3, 0.5e-3)}
    if item == "current_loop":
        return {"loop_order": 2, "loop_s": 1.0 / (math.tau * _log(rng, 300.0, 2000.0)), "loop_damping": u(0.5, 1.0)}
    if item == "process_torque":
        return {"process_share": u(0.001, 0.01), "process_colour": u(0.5, 0.98) if rng.random() < 0.5 else 0.0}
    if item == "reading_filter":
        return {"reading_filter_s": _log(rng, 0.2e-3, 5e-3), "noise_inside": bool(rng.random() < 0.5)}
    if item == "reading_late":
        return {"reading_late": u(0.05, 1.0), "latched": bool(rng.random() < 0.25)}
    if item == "interpolation":
        size, power, finest = _log(rng, 1e-5, 2e-4), int(rng.integers(7, 12)), 16 if base.rigid else 20
        values = {"lines_per_rev": 2**power, "counts_per_rev": 2 ** min(power + int(rng.integers(6, 11)), finest)}
        phases = (float(u(0.0, math.tau)), float(u(0.0, math.tau)))
        return values | {"once_rad": size, "twice_rad": size * u(0.1, 1.0), "phases_rad": phases}
    if item == "slew":
        return {"slew_nm_s": base.peak_torque_nm / u(0.003, 0.020)}
    if item == "angle_noise":
        return {"angle_noise_rad": _log(rng, 0.3, 3.0) * math.tau / counts}
    if item == "command_only":
        return {"command_only": True, "reading_step": 1e-3}
    return {
        "reading_steps": {"reading_step": _log(rng, 1e-3, 1e-2)},
        "torque_steps": {"setpoint_step": _log(rng, 1e-3, 1e-2)},
        "inner_cycle": {"inner_phase": u(0.05, 0.95)},
        "second_delay": {"delay_samples": 2},
        "noise_colour": {"noise_colour": u(0.3, 0.95)},
        "stamp_jitter": {"stamp_jitter": u(0.02, 0.2)},
        "sampling_jitter": {"sampling_jitter": _log(rng, 0.001, 0.01)},
    }[item]
