"""Bring measurements of another logger into a run folder, fit a model to them, and ask whether something is missing.

``python examples/own_measurements.py`` takes some 5 s.  The file is what a logger may have written of a motor on a belt axis: milliseconds,
ampere and degrees, in columns of its own names.  Here it is simulated, with noise and an encoder's steps.
"""

from pathlib import Path

import numpy as np

import beltcomm
from beltcomm import api
from beltcomm.excitation import prbs
from beltcomm.model import load_plant
from beltcomm.recording.sidecar import ExcitationNote, Sidecar
from beltcomm.simulate.forward import simulate_torque

FILE, RUN, AXIS = Path("runs/logger.csv"), Path("runs/example-import"), "egc-70-600"
SAMPLE_S, CONSTANT_NM_A, COUNTS = 1e-3, 0.65, 65536


def write_log() -> int:
    """Write what the logger recorded: a binary torque of 1023 samples, four times.   Returns the samples of one period."""
    random = np.random.default_rng(1)
    excitation = prbs(10, 1, 0.5, SAMPLE_S, 3)
    motion = simulate_torque(load_plant("g_b").model, excitation.torque, SAMPLE_S, position_m=0.25)
    torque = excitation.torque + 0.006 * random.standard_normal(excitation.torque.size)
    step_deg = 360.0 / COUNTS
    columns = {
        "Time [ms]": 1e3 * motion.t_s,
        "Iq": torque / CONSTANT_NM_A,
        "Encoder": step_deg * np.round(np.degrees(motion.position_rad) / step_deg),
    }
    FILE.parent.mkdir(exist_ok=True)
    rows = np.column_stack(list(columns.values()))
    np.savetxt(FILE, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.8g")
    return excitation.period_samples


def main() -> int:
    """Import, fit, compare; the exit code is that of the comparison."""
    period = write_log()
    mapping = ("t_s=Time [ms]*ms", f"torque_nm=Iq*{CONSTANT_NM_A}", "position_rad=Encoder*deg")
    note = Sidecar("frf", start_position_m=0.25, excitation=ExcitationNote("prbs", period_samples=period, first_sample=period))
    imported = api.import_recordings([FILE], RUN, api.Reading(mapping=mapping), axis=AXIS, sidecar=note)
    print("\n".join(imported.lines()))

    api.fit(RUN)
    model = beltcomm.open(RUN).model
    print(f"carriage mass {model.mass}, belt stiffness {model.stiffness}")

    compared = api.compare(RUN, pictures=False)
    print(f"error {compared.data['ratio']['overall']:.2f} times the noise; 1.00: nothing is missing")
    return compared.exit_code


if __name__ == "__main__":
    raise SystemExit(main())
