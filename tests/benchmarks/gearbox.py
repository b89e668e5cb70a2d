"""Gearboxes: rigs of the thesis behind 1:1, 3:1 and 5:1, commissioned through the CAN bus on the independent truth simulator.

For each the identified numbers against the truth, the largest belt force and motor torque that the machine really saw, and the
errors of the verification move at the motor, at the carriage (by the simulator) and as predicted.  Run it with

    python tests/benchmarks/gearbox.py [g_a g_b] [1 3 5]
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from beltcomm import api
from beltcomm.runfolder import RunFolder
from beltcomm.verify import tracking_error
from session.bench import geared_bench

#: (words, name in the model, name in the truth)
COMPARED = (
    ("inertia", "motor.inertia", "inertia_kg_m2"),
    ("mass", "cart.mass", "mass_kg"),
    ("stiffness", "belt_stiffness.stiffness", "stiffness_n_m"),
    ("belt damping", "belt_damping.damping", "belt_damping_n_s_m"),
    ("viscous", "viscous.damping", "viscous_nm_s_rad"),
    ("Coulomb motor", "coulomb.level", "coulomb_motor_nm"),
    ("Coulomb cart", "cart_friction.level", "coulomb_cart_n"),
)
DERIVED = (
    ("resonance", "resonance", "resonance_hz"),
    ("antiresonance", "antiresonance", "antiresonance_hz"),
    ("Coulomb, all", "coulomb_total", "coulomb_total_nm"),
)


def examine(rig: str, ratio: float, folder: Path) -> None:
    """Commission one and print what was found."""
    bench, axis = geared_bench(folder, rig, ratio)
    opened, api.open_drive = api.open_drive, bench.open  # type: ignore[assignment]
    run = folder / f"run_{rig}_{ratio:g}"
    try:
        result = api.commission(bench.name, axis, run, options=api.Options(yes=True, seed=1))
    finally:
        api.open_drive = opened
        bench.close()
    truth, plant = bench.plant.truth, bench.plant
    print(f"{rig} behind {ratio:g}:1, exit code {result.exit_code}, {result.data['machine_seconds']:.0f} s on the machine")
    parameters, derived = result.data["model"]["parameters"], result.data["fit"]["characteristics"]
    found = [(words, parameters[name], true) for words, name, true in COMPARED]
    found += [(words, derived[name], true) for words, name, true in DERIVED]
    for words, item, true in found:
        value, half, right = item["value"], item["interval"], truth[true]
        print(
            f"  {words:14} {value:11.5g} ± {half:8.2g}   truth {right:11.5g}   {100 * (value / right - 1):+6.2f} %   "
            f"{1.96 * (value - right) / half:+5.2f} deviations"
        )
    record = RunFolder.open(run)
    move = record.recording("move_1")
    assert move.reference_position is not None
    first = plant.first_tick_of(move, bench.start_m)
    cart = bench.start_m + plant.cart_m(first, len(move.t_s))
    seen = tracking_error(move.t_s, plant.ratio * move.reference_position, cart)
    force, torque = np.abs(plant.belt_force_n), np.abs(plant.torque_nm)
    print(
        f"  belt at most {force[:first].max():.1f} N before the move, {force[first:].max():.1f} N in it, "
        f"limit 1.05 x ({axis.belt_force_limit_n:.1f} N + {truth['coulomb_cart_n']:.1f} N of friction); "
        f"motor at most {torque.max():.3f} N m of {axis.motor.peak_torque_nm:g} N m"
    )
    gains = record.load("designs", "final")["parameters"]
    print(
        f"  K_P {gains['kp_nm_s_rad']:.4g}, K_I {gains['ki_nm_rad']:.4g}, K_PP {gains['kpp_1_s']:.3g}, "
        f"T_R {1e3 * gains['velocity_filter_s']:.3g} ms, prefilter {('none', 'notch', 'Butterworth')[int(gains['prefilter_kind'])]}"
    )
    verdict = result.data["verdict"]
    for what, name, factor in (("dynamic, mm", "dynamic_m", 1e3), ("static, um", "static_m", 1e6)):
        numbers = [factor * getattr(e, name) for e in (verdict.measured, verdict.predicted, seen, verdict.predicted_cart)]
        low, high = (factor * getattr(e, name) for e in verdict.predicted_range)
        measured, expected, cart_seen, cart_expected = (f"{number:8.3f}" for number in numbers)
        print(
            f"  {what:12} motor {measured} predicted {expected} ({low:.3f} to {high:.3f})   cart {cart_seen} predicted {cart_expected}",
            flush=True,
        )


def main() -> None:
    """Command line."""
    rigs = [word for word in sys.argv[1:] if not word.replace(".", "").isdigit()] or ["g_a", "g_b"]
    ratios = [float(word) for word in sys.argv[1:] if word.replace(".", "").isdigit()] or [1.0, 3.0, 5.0]
    with tempfile.TemporaryDirectory() as folder:
        for rig in rigs:
            for ratio in ratios:
                examine(rig, ratio, Path(folder))


if __name__ == "__main__":
    main()
