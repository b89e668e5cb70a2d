"""The whole chain on the three real data sets: every step of the diagnosis from the base model, judged on what was never fitted.

python tests/benchmarks/real_data.py [emps] [bench] [cogging]      some minutes; needs ../shared/data beside the checkout
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from beltcomm.fit.start.model import start_model
from beltcomm.laboratory.cross_checks import map_checks, resonances
from beltcomm.laboratory.diagnosis import diagnose, fit_base_of
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.runfolder import RunFolder
from foreign.judged import BENCH, COGGING, EMPS, banded_of, imported, least_squares, record_error, response_error

#: Encoder step and band by data set.
BANDS = {"emps": EMPS, "bench": BENCH, "cogging": COGGING}


def judged(name: str, model: Model, record: Recording) -> float:
    """Error of a model on a record, per cent."""
    return 100.0 * record_error(model, record, *BANDS[name])


def main(names: list[str]) -> None:
    """Print the staircase of every data set."""
    for name in names or ["emps", "bench", "cogging"]:
        with tempfile.TemporaryDirectory() as place:
            folder = RunFolder.open(imported(name, Path(place)))
            recordings = folder.recordings()
            timed = [r for r in recordings if not r.is_static_map]
            begin = time.process_time()
            found = diagnose(recordings, folder.axis, start_model(folder.axis, recordings))
            used = time.process_time() - begin
            print(
                f"\n{name}: {found.verdict}, {used:.0f} s of CPU; "
                + ", ".join(f"{r.name}{' (held out)' * r.sidecar.held_out}" for r in timed)
            )
            rungs = [
                ("base", fit_base_of(recordings, folder.axis, start_model(folder.axis, recordings))[1]),
                *((f"+{step.added}" + "".join(f" -{r}" for r in step.removed), step.after) for step in found.steps),
                ("in the end", found.final_fit),
            ]
            for change, fitted in rungs:
                if change != "+":
                    errors = "  ".join(f"{judged(name, fitted.model, r):6.2f} %" for r in timed)
                    print(f"  {change:24} {errors}   {fitted.ratio:7.2f} {fitted.held_out_ratio or 0.0:7.2f} times the noise")
            base = {r.name: banded_of(found.base.model, r, *BANDS[name]) for r in timed}
            plain = least_squares([base[r.name] for r in timed if not r.sidecar.held_out], [base[r.name] for r in timed], BANDS[name][1])
            print(f"  {'least squares, base':24} {'  '.join(f'{100.0 * error:6.2f} %' for error in plain)}")
            if name == "bench" and len(found.final_fit.model.bodies()) > 1:
                print("  response, angle:", ", ".join(f"{100.0 * response_error(found.final_fit.model, r):.2f} %" for r in timed))
            for step in found.steps:
                refused = [c for c in step.candidates if c.fitted is not None and not c.accepted]
                print(
                    "  refused:",
                    ", ".join(f"{c.effect.name} ({c.evidence:.0f}, held out {c.held_out_gain:.0f}; {c.against})" for c in refused),
                )
            model = found.final_fit.model
            print("  " + ", ".join(f"{key} {value.value:.4g} {value.unit}" for key, value in model.parameters.items()))
            print(f"  twins {found.twins}; {resonances(model, 0.0)}")
            for check in map_checks(recordings, model):
                print(f"  {check.record}: correlation {check.correlation:.3f}, zero {check.zero_rad:.2f} rad, {len(check.orders)} orders")


if __name__ == "__main__":
    main(sys.argv[1:])
