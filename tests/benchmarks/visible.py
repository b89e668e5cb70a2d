"""Does the predicted weakest strength of an effect hold?  Hidden machines of growing strength against the prediction on a healthy one.

For each seed the healthy machine of the independent simulator says from which size each effect could be named; then the same machine is
drawn with the effect at several strengths, and the score test's drop is compared with the threshold.  Run it with

    python tests/benchmarks/visible.py FIRST LAST      seeds FIRST..LAST-1; one line per draw, then the counts
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from beltcomm.effects import AxisSummary, effect_named
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.start.model import start_model
from beltcomm.laboratory.acceptance import EVIDENCE
from beltcomm.laboratory.diagnosis import fit_base_of
from beltcomm.laboratory.score import Scorer, ground_of
from beltcomm.laboratory.selection import bic_penalty
from beltcomm.laboratory.visible import detection_limits
from beltcomm.runfolder import RunFolder
from truth.hidden import draw, write_session

#: Hidden effect -> its size in the generator's words, and the name it has in the catalogue.
SIZES = {
    "stribeck": "rise_nm",
    "quadratic_drag": "drag_n_at_1_m_s",
    "friction_position": "rise_nm",
    "cogging": "amplitude_nm",
    "cable_chain": "stiffness_n_m",
    "torque_saturation": "loss_at_peak",
    "warmup": "rise",
    "encoder_eccentricity": "amplitude_rad",
    "dead_time": "time_s",
    "tilt": "offset_nm",
    "torque_ripple": "share",
}
NAMES = {"tilt": "constant_offset"}
STRENGTHS = (0.02, 0.05, 0.1, 0.2)


def fitted(seed: int, effects: tuple[str, ...], strength: float) -> tuple[Fitted, AxisSummary, dict[str, dict[str, float]]]:
    """The base model on the default session of a draw, and what is hidden in it."""
    machine = draw(seed, effects, strength, "sheet")
    with tempfile.TemporaryDirectory() as folder:
        write_session(machine, folder, plan="default")
        run = RunFolder.open(Path(folder))
        recordings = run.recordings()
        data, found = fit_base_of(recordings, run.axis, start_model(run.axis, recordings))
        return found, ground_of(found, data.fitted, run.axis), machine.hidden


def main(first: int, last: int) -> None:
    """All draws."""
    above, below = [0, 0], [0, 0]
    for seed in range(first, last):
        healthy, ground, _ = fitted(seed, (), 0.0)
        sights = {sight.effect.name: sight for sight in detection_limits(Scorer(healthy), ground)}
        for effect, key in SIZES.items():
            sight = sights[NAMES.get(effect, effect)]
            for strength in STRENGTHS:
                found, here, hidden = fitted(seed, (effect,), strength)
                ways = Scorer(found).score(effect_named(sight.effect.name), here)
                needed = EVIDENCE + bic_penalty(sight.effect, found, len(sight.effect.trials(here) if sight.effect.trials else ()))
                drop = ways[0].drop if ways else 0.0
                size = abs(float(hidden[effect][key])) / (sight.hardest * sight.size)
                print(f"{seed} {effect:22} {size:6.2f} x the predicted weakest: drop {drop:7.0f}, needed {needed:.0f}")
                for count, counts in ((above, size >= 2.0), (below, size <= 0.5)):
                    if counts:
                        count[0] += 1
                        count[1] += drop > needed
    print(f"from twice the prediction on: {above[1]} of {above[0]} would be named; up to half of it: {below[1]} of {below[0]}")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
