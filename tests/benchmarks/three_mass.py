"""Two masses against three: end pulleys of several sizes on the independent simulator, what was found and what was refused.

For each the verdict, the end pulley with its 95 % interval, its deviation in standard deviations, the two resonances, the CPU seconds, and
the log-magnitude fit beside.  Run it with

    python tests/benchmarks/three_mass.py [heavy] [own] [fast] [healthy] [constant]
"""

from __future__ import annotations

import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from beltcomm.axis import load_axis
from beltcomm.excitation import prbs
from beltcomm.identify.magnitude_fit import fit_magnitudes
from beltcomm.identify.three_mass import MASS, compare_masses, resonances_hz
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import ExcitationNote, Sidecar
from beltcomm.rundata import analyse
from truth import Axis, ConstantBelt, ThreeSectionBelt, TruthPlant, TwoStrandBelt

EA_N, L3_M, OFFSET_M, DA_N_S, OWN_KG = 106250.0, 0.79, 0.05, 7.17, 0.153187
COUNTS, NOISE_NM, AMPLITUDE_NM = 65536, 6e-3, 0.3


@dataclass(frozen=True)
class Case:
    """end_pulley_kg : 0 without mass, None with one stiffness for all places.   clock : samples per bit of a PRBS of order 9."""

    end_pulley_kg: float | None
    carriage_kg: float
    places_m: tuple[float, ...]
    period_s: float = 1e-3
    clock: int = 2
    periods: int = 3


CASES = {
    "heavy": Case(10.0 * OWN_KG, 0.96, (0.1, 0.3, 0.5)),
    "own": Case(OWN_KG, 0.96, (0.1, 0.3, 0.5)),
    "loaded": Case(OWN_KG, 13.44, (0.1, 0.3, 0.5)),
    "fast": Case(OWN_KG, 0.96, (0.3,), 62.5e-6, 16, 7),
    "healthy": Case(0.0, 0.96, (0.1, 0.3, 0.5)),
    "constant": Case(None, 0.96, (0.1, 0.3, 0.5)),
}


def machine(case: Case, place_m: float) -> TruthPlant:
    """The rig with this end pulley, the carriage at a place."""
    belt: ConstantBelt | TwoStrandBelt | ThreeSectionBelt
    if case.end_pulley_kg is None:
        belt = ConstantBelt(222.39e3, 20.0)
    elif case.end_pulley_kg == 0.0:
        belt = TwoStrandBelt(EA_N, L3_M, OFFSET_M, 20.0)
    else:
        belt = ThreeSectionBelt(EA_N, L3_M, OFFSET_M, case.end_pulley_kg, DA_N_S)
    return TruthPlant(Axis(71.73e-6, case.carriage_kg, 0.01242, belt, 2.23e-3, 0.0805, 0.0, 2.7778), start_position_m=place_m)


def recorded(case: Case, place_m: float, seed: int) -> Recording:
    """An open-loop record with rounded angle and noisy torque."""
    plant, step = machine(case, place_m), math.tau / COUNTS
    signal = prbs(9, case.clock, 2.0 * AMPLITUDE_NM, case.period_s, case.periods)
    angle = np.empty(len(signal.torque))
    for n, torque in enumerate(signal.torque):
        angle[n] = math.floor(plant.position_rad / step) * step
        plant.step(float(torque), case.period_s)
    noise = np.random.default_rng(seed).normal(0.0, NOISE_NM, len(angle))
    note = ExcitationNote("prbs", signal.amplitude_nm, signal.period_samples, signal.first_sample)
    return Recording(
        name=f"frf_{seed + 1}",
        t_s=case.period_s * np.arange(len(angle), dtype=np.float64),
        torque=signal.torque + noise,
        torque_setpoint=signal.torque,
        position=angle,
        sidecar=Sidecar("frf", start_position_m=place_m, excitation=note),
    )


def examine(name: str, case: Case) -> None:
    """Print what was found."""
    records = [recorded(case, place, seed) for seed, place in enumerate(case.places_m)]
    axis, responses, begun = load_axis("egc-70-600"), analyse.responses(records), time.process_time()
    found = compare_masses(records, axis, COUNTS, responses)
    seconds, item = time.process_time() - begun, found.three.model.parameters[MASS]
    truth = "none" if not case.end_pulley_kg else f"{case.end_pulley_kg:.4f} kg"
    print(f"{name}: {'identified' if found.identified else 'refused'}, truth {truth}, {seconds:.0f} s of CPU")
    if item.interval is not None and case.end_pulley_kg:
        off = 1.96 * (item.value - case.end_pulley_kg) / item.interval
        print(f"  end pulley {item.value:.4f} ± {item.interval:.4f} kg, {off:+.2f} deviations")
    at = case.places_m[len(case.places_m) // 2]
    print(f"  resonances at {at} m: {', '.join(f'{f:.1f}' for f in resonances_hz(found.three.model, at))} Hz")
    print(f"  evidence {found.evidence:+.0f}, misfit {found.two.fit.misfit:.3g} with two and {found.three.misfit:.3g} with three")
    beside = fit_magnitudes(responses, {r.name: p for r, p in zip(records, case.places_m, strict=True)}, found.three.model, axis)
    if beside is not None:
        beside_item = beside.parameters[MASS]
        print(f"  log-magnitude fit {beside_item.value:.4f} ± {beside_item.interval:.4f} kg, rest {beside.rms_db:.2f} dB")
    for reason in found.against:
        print(f"  {reason}")
    sys.stdout.flush()


def main() -> None:
    """Command line."""
    for name in sys.argv[1:] or CASES:
        examine(name, CASES[name])


if __name__ == "__main__":
    main()
