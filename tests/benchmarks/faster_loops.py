"""Traces of healthy axes whose loops are faster than the record: is anything named that is not there, do the intervals hold the truth?

    python tests/benchmarks/faster_loops.py FIRST COUNT        seeds FIRST ..., one line each, and the shares with their 95 % intervals

Motor, belt and carriage, a speed loop under a position loop and a current loop are written out here; setpoint, torque and counted angle
are taken every so many loops, the torque up to a fifth of a sample earlier: three records of 6 s, the last one held out.  Drawn are the
machine, the rates of loop and record, the current loop, the encoder, noise and steps of the torque, and how late it is.
"""

from __future__ import annotations

import math
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numba
import numpy as np
import yaml
from hidden_table import share
from numpy.typing import NDArray

from beltcomm.errors import BeltcommError
from beltcomm.fit.start.model import start_model
from beltcomm.fit.uncertainty.intervals import with_intervals
from beltcomm.laboratory.diagnosis import diagnose, fit_base_of
from beltcomm.laboratory.run_checks import check_run
from beltcomm.laboratory.scope import restrict_to_scope
from beltcomm.runfolder import RunFolder

Array = NDArray[np.float64]

#: s, length of a record; steps of the integration in a loop.
RECORD_S, STEPS = 6.0, 4
TOLD = ("motor.inertia", "cart.mass", "belt_stiffness.stiffness", "belt_damping.damping", "coulomb.level")


@dataclass(frozen=True)
class Trace:
    """What a drive and its recorder are.   sample_s, loop_s, current_s : s.   counts : a turn.   noise_nm, step_nm : of the torque.
    late : share of a sample.
    """

    sample_s: float
    loops: int
    current_s: float
    counts: int
    noise_nm: float
    step_nm: float
    late: float

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Trace:
        """One drive."""
        sample_s, rate_hz = float(rng.choice([5e-4, 1e-3, 2e-3])), float(rng.choice([4e3, 8e3, 16e3]))
        counts, step_nm = round(2.0 ** rng.uniform(12.0, 18.0)), float(rng.choice([0.0, 3e-3]))
        return cls(
            sample_s,
            max(round(sample_s * rate_hz), 4),
            rng.uniform(1e-4, 8e-4),
            counts,
            rng.uniform(3e-3, 2e-2),
            step_nm,
            rng.uniform(0.0, 0.2),
        )


@numba.njit(cache=False)
def traced(
    axis: Array, gains: Array, wanted: Array, samples: int, loops: int, loop_s: float, current_s: float, step: float, early: int
) -> Array:
    """Setpoint, torque and counted angle, (samples, 3).   axis : J, m, k, d, viscous motor and carriage, Coulomb motor, r; SI.
    gains : speed N m s/rad, integral time s, position 1/s.   wanted : (loops + 1,) rad.   step : rad.   early : steps before a sample.
    """
    inertia, mass, stiffness, damping, motor, carriage, coulomb, radius = axis
    out, h, whole_sample = np.zeros((samples, 3)), loop_s / STEPS, loops * STEPS
    theta = omega = x = v = torque = whole = setpoint = before = speed = read = 0.0
    for n in range(samples * whole_sample):
        if n % STEPS == 0:
            loop = n // STEPS
            angle = np.floor(theta / step + 0.5) * step
            speed, before = speed + min(2400.0 * loop_s, 1.0) * ((angle - before) / loop_s - speed), angle
            error = gains[2] * (wanted[loop] - angle) + (wanted[loop + 1] - wanted[loop]) / loop_s - speed
            whole += error * loop_s * gains[0] / gains[1]
            setpoint = gains[0] * error + whole
        if (n + early) % whole_sample == 0:
            read = torque
        if n % whole_sample == 0:
            out[n // whole_sample] = setpoint, read, np.floor(theta / step + 0.5) * step
        torque += h / current_s * (setpoint - torque)
        force = stiffness * (radius * theta - x) + damping * (radius * omega - v)
        omega += h * (torque - radius * force - motor * omega) / inertia
        rubbed = h * coulomb / inertia  # it stops within the step where that is more than its speed
        omega = 0.0 if abs(omega) <= rubbed else omega - np.copysign(rubbed, omega)
        v += h * (force - carriage * v) / mass
        theta, x = theta + h * omega, x + h * v
    return out


def drawn(seed: int, run: Path) -> tuple[dict[str, float], Trace]:
    """A run folder of one machine; the truth about it and its drive."""
    rng = np.random.default_rng(seed)
    inertia, radius, mass = 10 ** rng.uniform(-4.0, -3.2), rng.uniform(0.01, 0.02), rng.uniform(1.0, 8.0)
    stiffness = (math.tau * rng.uniform(25.0, 80.0)) ** 2 * mass
    damping, viscous = 0.04 * math.sqrt(stiffness * mass), rng.uniform((0.5, 0.3), (3.0, 2.0)) * (inertia, mass)
    axis = np.array([inertia, mass, stiffness, damping, *viscous, rng.uniform(0.015, 0.06), radius])
    trace = Trace.drawn(rng)
    samples, loop_s = round(RECORD_S / trace.sample_s), trace.sample_s / trace.loops
    gains = np.array([math.tau * 5.0 * (inertia + mass * radius**2), 0.05, math.tau * 3.0])
    time = loop_s * np.arange(samples * trace.loops + 1)
    (run / "recordings").mkdir(parents=True)
    for number, name in enumerate(("a", "b", "held")):
        sines = [(rng.uniform(0.5, 3.0), math.tau * rng.uniform(0.3, 30.0), rng.uniform(0.0, 6.3)) for _ in range(14)]
        speed = 8.0 * np.sign(np.sin(math.tau * rng.uniform(0.4, 0.9) * time))
        speed += sum(size * np.sin(rate * time + phase) for size, rate, phase in sines)
        early, path = round(trace.late * trace.loops * STEPS), np.cumsum(speed - speed[0]) * loop_s
        rows = traced(axis, gains, path, samples, trace.loops, loop_s, trace.current_s, math.tau / trace.counts, early)
        rows[:, 1] += rng.normal(0.0, trace.noise_nm, samples)
        rows[:, 1] = np.round(rows[:, 1] / trace.step_nm) * trace.step_nm if trace.step_nm else rows[:, 1]
        rows[:, 2] += 20.0
        table = np.column_stack([trace.sample_s * np.arange(samples), rows])
        header = "t_s,torque_setpoint_nm,torque_nm,position_rad"
        np.savetxt(run / "recordings" / f"{name}.csv", table, "%.8f", ",", header=header, comments="")
        sidecar = {"experiment": "trajectory", "start_position_m": float(20.0 * radius), "session_time_s": 10.0 * number}
        (run / "recordings" / f"{name}.yaml").write_text(yaml.safe_dump(sidecar | {"closed_loop": True, "held_out": name == "held"}))
    sheets = {
        "motor": dict(inertia_kg_m2=float(f"{inertia:.2g}"), rated_torque_nm=3.0, peak_torque_nm=9.0, encoder_counts_per_rev=trace.counts),
        "pulley": {"effective_radius_m": float(radius)},
        "belt": {"specific_stiffness_n": 1e6, "pitch_m": 0.002, "pulley_distance_m": 12.0},
        "travel": {"min_m": -5.0, "max_m": 6.0, "driven_side_offset_m": 5.5},
        "limits": {"speed_m_s": 3.5, "acceleration_m_s2": 65.0, "pulley_torque_nm": 9.0},
    }
    (run / "axis.yaml").write_text(yaml.safe_dump({"name": f"traced {seed}", **sheets}))
    return dict(zip(TOLD, axis[[0, 1, 2, 3, 6]], strict=True)), trace


def main(first: int, count: int) -> None:
    """Examine so many machines."""
    right, held = [], []
    for seed in range(first, first + count):
        with tempfile.TemporaryDirectory() as place:
            truth, trace = drawn(seed, Path(place) / "run")
            run = RunFolder.open(Path(place) / "run")
            try:
                records = check_run(run.recordings(), run.axis, foreign=True).recordings
                start = start_model(run.axis, records)
            except BeltcommError as refusal:
                right.append(False)
                print(f"{seed}  refused: {refusal}  {trace}", flush=True)
                continue
            begun = fit_base_of(records, run.axis, start)
            found, _ = restrict_to_scope(diagnose(records, run.axis, start, begun=begun), records)
            model = with_intervals(begun[1])
        off = {name: (model[name] - truth[name]) / (model.parameters[name].interval or math.nan) for name in TOLD}
        right.append(found.verdict == "nothing missing")
        held += [abs(size) <= 1.0 for size in off.values()]
        path, words = begun[0].path, ", ".join(f"{name} {size:.2f}" for name, size in off.items())
        told = f"{found.verdict}, {begun[1].ratio:.3f} times the noise, read at instants {path.instantaneous}"
        print(f"{seed}  {told}; in intervals: {words}  {trace}", flush=True)
    print(f"nothing missing {share(right)}; truth in the interval {share(held)}")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
