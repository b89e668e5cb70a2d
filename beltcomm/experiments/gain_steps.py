"""Small steps of a drive's setpoints, from which the meaning of its gains is seen: on the axis, at standstill, held by friction.

The gain is the smallest that the drive takes, the integral part the slowest; the steps begin so small that a gain a hundred times what
the profile guesses would not break the axis loose, and grow with the torque that answers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from beltcomm.arrays import Array
from beltcomm.axis import Axis
from beltcomm.drive import Capabilities, Motion, Row
from beltcomm.drive.objects import GAIN, ObjectValue, ParameterObject, name_of
from beltcomm.errors import DataError, Refused, SafetyStop
from beltcomm.experiments.bounds import Experiment
from beltcomm.identify.loop_gain import RISE, Gain, Steps, VelocityLaw, position_gain, velocity_law
from beltcomm.machine.machine import Envelope, Machine
from beltcomm.rundata.backups import renew
from beltcomm.rundata.calibration import RESULT, Calibration, GainUnit, calibration_of, check
from beltcomm.rundata.store import drive_to_dict

#: s, of a step either way; samples of one at least; rows of rest before, from which the noise is known; repeats of the final record.
PULSE_S, FEWEST_SAMPLES, REST_ROWS, REPEATS = 0.016, 8, 50, 16
#: Share of the breakaway torque that the steps are to ask for; share of the torque limit that they may; steps of torque resolution that
#: they need at least.
HELD_SHARE, TORQUE_SHARE, RESOLUTION_STEPS = 0.5, 0.2, 20.0
#: The first step is so many times smaller than the profile's guess of the gain would need.
CAUTION = 100.0
#: Tries until the torque is large enough; the largest growth from one to the next; share of the torque asked for that is enough.
TRIES, GROWTH, ENOUGH = 16, 10.0, 0.5
#: A response counts from so many standard deviations of its mean on.
SEEN = 4.0
#: m: the carriage may move so far; from there friction stops it within the reach, were it only a third of what was counted with.  A watched
#: torque may be so many times the one asked for, and so much of the rated one.
TRAVEL_M, REACH_M, WATCHED, WATCHED_OF_RATED = 2e-3, 1e-2, 3.0, 0.05
#: m/s: and it, or the motor that drives it, gets no faster.
SPEED_M_S = 0.2
#: 1/s: bandwidth of the velocity loop with the motor alone, of the first record and of the one under the position loop; position gain.
BANDWIDTH, POSITION_BANDWIDTH, POSITION_GAIN = 20.0, 100.0, 5.0
#: m: largest step of the position setpoint.   Share of the speed limit that a step may ask for.
LARGEST_STEP_M, SPEED_SHARE = 3e-3, 0.5
#: A documented integral time is kept when the steps differ by less than this share, or by less than they are sure of.
SAME_TIME = 0.1
#: s of machine time, at most.
SECONDS = 8.0
_TOLD = "ki_nm_rad"


def line(axis: Axis, capabilities: Capabilities) -> tuple[Experiment, ...]:
    """The plan's line, where this drive's gains have no known meaning yet.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    """
    return (experiment(axis, capabilities),) if capabilities.uncalibrated else ()


def experiment(axis: Axis, capabilities: Capabilities) -> Experiment:
    """Line of the plan for the steps that tell what the drive's gains mean.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    """
    torque = WATCHED * TORQUE_SHARE * min(axis.torque_limit_nm, capabilities.peak_torque_nm)
    force = min(torque / axis.transmission_m_rad, axis.belt_force_limit_n)
    return Experiment("small steps: what its gains mean", TRAVEL_M, REACH_M, SPEED_M_S, torque, force, SECONDS)


def ensure(machine: Machine, breakaway_nm: float) -> float:
    """Before a gain is written for the first time: find out what they mean, unless it is known.

    Parameters
    ----------
    machine : Machine
    breakaway_nm : float, N m, motor shaft
        Breakaway torque.

    Returns
    -------
    float
        The s that it took.

    Raises
    ------
    Refused
    DataError
    SafetyStop
    """
    if not machine.drive.capabilities.uncalibrated:
        return 0.0
    begun = machine.drive.clock.now()
    found = measure(machine, breakaway_nm)
    remarks = adopt(machine, found)
    machine.talk.say("What the drive's gains mean, by small steps of its setpoints:", *found.lines(), *remarks)
    return machine.drive.clock.now() - begun


def adopt(machine: Machine, found: Calibration) -> list[str]:
    """Believe a measurement: tell the drive, keep it in the run.

    Parameters
    ----------
    machine : Machine
    found : Calibration
        Constants of this drive.

    Returns
    -------
    list of str
        Remarks.

    Raises
    ------
    Refused
        When it contradicts what is known.
    """
    drive = machine.drive
    remarks = check(found, not drive.capabilities.uncalibrated, calibration_of(found.kind))
    drive.calibrate({name: one.value for name, one in found.units.items() if name in drive.capabilities.uncalibrated})
    machine.folder.save("results", RESULT, {"drive": dict(drive.capabilities.identity), **found.to_dict()})
    machine.folder.save("results", "drive", drive_to_dict(drive.capabilities))
    machine.meaning_changed()
    renew(machine.folder, drive)
    told = ", ".join(f"{name} {one.value:.4g} for each unit of {one.place}" for name, one in found.units.items())
    machine.folder.journal(f"gains calibrated: {told}")
    return remarks


def measure(machine: Machine, breakaway_nm: float) -> Calibration:
    """Velocity and position gain of the drive by steps; the gains that stood there are back afterwards.

    Parameters
    ----------
    machine : Machine
    breakaway_nm : float
        Friction at standstill.

    Raises
    ------
    Refused
        No such gains, a tilted axis, nothing to be seen.
    DataError
    SafetyStop
    """
    capabilities, axis = machine.drive.capabilities, machine.axis
    if not {GAIN, _TOLD} <= set(capabilities.parameters) or "velocity" not in capabilities.kinds:
        raise Refused(f"{capabilities.name} has no velocity gain that beltcomm could write, so there is nothing to calibrate")
    if axis.mounting.tilted:
        raise Refused(
            "what this drive's gains mean is measured at standstill without a holding torque; the axis is tilted and would fall. Calibrate "
            "it level, or the drive on another axis, and copy results/calibration.yaml of that run into this one"
        )
    low, high = machine.envelope().window_m
    if min(machine.position_m - low, high - machine.position_m) < REACH_M:
        raise Refused(f"the steps need {1e3 * REACH_M:g} mm to both ends; the carriage stands at {machine.where(machine.position_m)}")
    limit = min(axis.torque_limit_nm, capabilities.peak_torque_nm)
    floor = RESOLUTION_STEPS * capabilities.torque_step_nm
    torque = min(max(HELD_SHARE * breakaway_nm, floor), TORQUE_SHARE * limit)
    probe = _Probe(machine, torque)
    found = [item for item in machine.drive.objects() if item.name in capabilities.parameters]
    begun = machine.drive.clock.now()
    try:
        law, raws = probe.velocity()
        units = _velocity_units(capabilities.parameters, law, raws)
        if {"kpp_1_s"} <= set(capabilities.parameters) and "position" in capabilities.kinds:
            gain, raw = probe.position(units)
            units["kpp_1_s"] = _unit(capabilities.parameters["kpp_1_s"], gain.value / raw, gain.interval / raw)
    finally:
        machine.drive.write_objects([item for item in found if item.name in probe.written])
        machine.folder.journal(f"steps for calibration: {machine.drive.clock.now() - begun:.1f} s on the machine, gains put back")
    return Calibration(capabilities.structure.name, capabilities.rated_torque_nm, capabilities.rated_current_a, units)


@dataclass
class _Probe:
    """Steps on the machine.   torque_nm : that they are to ask for.   written : names whose objects hold test values."""

    machine: Machine
    torque_nm: float

    def __post_init__(self) -> None:
        self.parameters = self.machine.drive.capabilities.parameters
        self.period_s = self.machine.drive.capabilities.sample_period_s
        self.samples = max(FEWEST_SAMPLES, round(PULSE_S / self.period_s))
        self.written: set[str] = set()

    def velocity(self) -> tuple[VelocityLaw, dict[str, float]]:
        """The law of the velocity loop and the raw values that it stood for."""
        inertia = self.machine.axis.motor_side_inertia_kg_m2
        entry = self.parameters[GAIN]
        raw = self._gains(BANDWIDTH * inertia / entry.scale)
        most = SPEED_SHARE * self.machine.envelope().speed_m_s / self.machine.ratio
        first = self.torque_nm / (entry.scale * raw[GAIN] * CAUTION)

        def raise_gain(factor: float) -> bool:
            before = raw[GAIN]
            raw.update(self._gains(before * min(factor, 4.0)))
            return raw[GAIN] > before

        amplitude = self._grow("velocity", min(first, most), most, raise_gain)
        return velocity_law(self._steps("velocity", amplitude, REPEATS)), raw

    def position(self, units: Mapping[str, GainUnit]) -> tuple[Gain, float]:
        """The position gain, 1/s, and the raw value that it stood for.

        Parameters
        ----------
        units : dict of str to GainUnit
            Of the velocity loop, just found.
        """
        inertia, entry = self.machine.axis.motor_side_inertia_kg_m2, self.parameters["kpp_1_s"]
        raw = self._gains(POSITION_BANDWIDTH * inertia / units[GAIN].value)
        kp = units[GAIN].value * raw[GAIN]
        tn = units[_TOLD].value * raw[_TOLD] if self.parameters[_TOLD].law == "integral_time" else kp / (units[_TOLD].value * raw[_TOLD])
        law = VelocityLaw(Gain(kp, units[GAIN].interval * raw[GAIN]), Gain(tn, 0.0))
        position = [_check_within(entry, POSITION_GAIN / entry.scale)]
        self._write({"kpp_1_s": position[0]})
        envelope = self.machine.envelope()
        most = min(LARGEST_STEP_M, SPEED_SHARE * envelope.speed_m_s * self.period_s) / self.machine.ratio
        first = self.torque_nm / (kp * entry.scale * position[0] * CAUTION)

        def raise_gain(factor: float) -> bool:
            before, position[0] = position[0], _check_within(entry, position[0] * min(factor, 4.0))
            self._write({"kpp_1_s": position[0]})
            return position[0] > before

        amplitude = self._grow("position", min(first, most), most, raise_gain)
        return position_gain(self._steps("position", amplitude, REPEATS), law), position[0]

    def _gains(self, gain: float) -> dict[str, float]:
        """Raw gain nearest to ``gain`` with the slowest integral part, nothing fed forward, nothing filtered; written."""
        kp, ki = self.parameters[GAIN], self.parameters[_TOLD]
        raw = {GAIN: _check_within(kp, gain)}
        if ki.law == "integral_time":
            raw[_TOLD] = float(ki.range[1])
        else:  # as slow as the pulses let it be seen
            raw[_TOLD] = _check_within(ki, raw[GAIN] * kp.scale / (2.0 * self.samples * self.period_s * ki.scale))
        idle = {n: 0.0 for n in self.parameters if n.startswith(("ff_", "prefilter_")) or n == "filter_reference"}
        self._write({**idle, **raw})
        return raw

    def _write(self, raws: Mapping[str, float]) -> None:
        self.written |= set(raws)
        entries = {name: self.parameters[name] for name in raws}
        self.machine.drive.write_objects([ObjectValue(e.index, e.subindex, e.type, raws[name], name) for name, e in entries.items()])

    def _grow(self, kind: Literal["velocity", "position"], first: float, most: float, raise_gain: Callable[[float], bool]) -> float:
        """The amplitude that asks for the torque wanted, reached step by step.   raise_gain : where the largest one does not."""
        amplitude = first
        for _ in range(TRIES):
            steps = self._steps(kind, amplitude, 2)
            answer, least = _answer(steps, self.machine.drive.capabilities.torque_step_nm)
            if answer >= ENOUGH * self.torque_nm:
                return amplitude
            factor = self.torque_nm / answer if answer > least else max(1.5, 0.5 * self.torque_nm / least)
            factor = min(factor, GROWTH)
            if amplitude < most:
                amplitude = min(factor * amplitude, most)
            elif not raise_gain(factor):
                break
        unit = "rad/s" if kind == "velocity" else "rad"
        raise Refused(
            f"what the drive's gains mean cannot be told: steps of its {kind} setpoint up to {most:.3g} {unit} are answered with less than "
            f"{1e3 * ENOUGH * self.torque_nm:.2g} mN m; look for filters, ramps and limits in the drive"
        )

    def _steps(self, kind: Literal["velocity", "position"], amplitude: float, repeats: int) -> Steps:
        """One record of alternating steps.   Raises DataError when samples were lost again and again."""
        one = np.repeat([1.0, 0.0, -1.0, 0.0], self.samples)
        shape = amplitude * np.concatenate([np.zeros(REST_ROWS), np.tile(one, repeats)])
        for _ in range(3):
            rows = self._run(kind, shape)
            table = np.array(rows)
            if len(rows) == len(shape) and float(np.max(np.abs(np.diff(table[:, 0]) - self.period_s))) < 0.25 * self.period_s:
                break
        else:
            raise DataError("samples were lost in every try to record the steps; check the bus, or choose a longer --sample-period")
        noise = float(np.std(table[RISE:REST_ROWS, 1]))
        used = table[REST_ROWS:]
        setpoint = used[:, 6] if kind == "velocity" else used[:, 5] - table[0, 5]
        return Steps(self.period_s, setpoint, used[:, 3] - table[0, 3], used[:, 4], used[:, 1], len(one), noise)

    def _run(self, kind: Literal["velocity", "position"], shape: Array) -> list[Row]:
        machine, zero = self.machine, np.zeros(len(shape))
        at, full = machine.position_m, machine.envelope()
        start = machine.drive.read(["position_rad"])["position_rad"]
        limit = WATCHED * self.torque_nm + WATCHED_OF_RATED * machine.drive.capabilities.rated_torque_nm
        rows: list[Row] = []

        def watch(row: Row) -> None:
            rows.append(row)
            if abs(row[3] - start) * machine.ratio > TRAVEL_M or abs(row[4]) * machine.ratio > SPEED_M_S:
                raise SafetyStop(
                    f"the carriage moved by {1e3 * machine.ratio * abs(row[3] - start):.1f} mm under small steps of the {kind} setpoint "
                    "that were not to break it loose; the axis was stopped; check what drives it, and the breakaway torque",
                    "position",
                )
            if abs(row[1]) > limit:
                raise SafetyStop(
                    f"{abs(row[1]):.3g} N m answered small steps of the {kind} setpoint, {limit:.3g} N m were the most to be expected; the "
                    "axis was stopped; a gain of this drive means far more than its profile guesses: look at its feedforward and filters",
                    "torque",
                )

        if kind == "velocity":
            motion = Motion("velocity", self.period_s, zero, shape, zero)
            speed = max(SPEED_M_S, 1.2 * float(np.max(np.abs(shape))) * machine.ratio)
        else:
            motion = Motion("position", self.period_s, start + shape, zero, zero)
            speed = full.speed_m_s
        envelope = Envelope((at - REACH_M, at + REACH_M), min(speed, full.speed_m_s), full.torque_nm)
        machine.run(motion, envelope, watch)
        return rows


def _check_within(entry: ParameterObject, raw: float) -> float:
    """A raw value that the object takes."""
    if entry.type == "real32":
        return float(np.float32(raw))
    least, most = entry.range
    return float(min(max(round(raw), least, 1), most))


def _answer(steps: Steps, resolution_nm: float) -> tuple[float, float]:
    """Torque that answers a step either way, N m, and the least that counts as seen."""
    sign = np.sign(np.roll(steps.setpoint, RISE))
    settled = (sign != 0.0) & (sign == np.sign(np.roll(steps.setpoint, 2 * RISE)))
    if not settled.any():
        return 0.0, resolution_nm
    deviation = max(steps.noise_nm, resolution_nm) / math.sqrt(float(settled.sum()))
    return float(np.mean((sign * steps.torque_nm)[settled])), SEEN * deviation


def _unit(entry: ParameterObject, value: float, interval: float) -> GainUnit:
    return GainUnit(value, interval, entry.scale, name_of(entry.index, entry.subindex))


def _velocity_units(parameters: Mapping[str, ParameterObject], law: VelocityLaw, raw: Mapping[str, float]) -> dict[str, GainUnit]:
    """Units of velocity gain and integral part."""
    kp, ki = parameters[GAIN], parameters[_TOLD]
    gain, time = law.gain, law.integral_time_s
    if ki.law == "integral_time":
        value, interval = time.value / raw[_TOLD], time.interval / raw[_TOLD]
    else:
        value, interval = gain.value / time.value / raw[_TOLD], gain.value / time.value / raw[_TOLD] * math.hypot(gain.share, time.share)
    told = _unit(ki, value, interval)
    if not told.interval < told.value or abs(told.factor - 1.0) < max(SAME_TIME, told.interval / told.assumed):
        told = replace(told, value=told.assumed, interval=0.0)
        if ki.law == "integral_time":
            gain = law.gain_at(told.value * raw[_TOLD])
    return {GAIN: _unit(kp, gain.value / raw[GAIN], gain.interval / raw[GAIN]), _TOLD: told}
