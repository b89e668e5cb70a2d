"""The delay from torque setpoint to torque, and the apparent damping: what a loop is designed with beside the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from beltcomm.control import CascadeStructure
from beltcomm.errors import DataError, Refused
from beltcomm.fit.torque.acting_torque import acting_recordings
from beltcomm.fit.torque.reading_fit import WHOLE
from beltcomm.fit.undersampled_fit import SeldomFit
from beltcomm.identify.dead_time import DeadTime
from beltcomm.identify.magnitude_fit import Solver
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.rundata import analyse
from beltcomm.rundata.findings import Findings

#: Periods of the drive's loop that an unmeasured delay is counted with: one to pass the setpoint on, one for the current loop.
ASSUMED_DELAY_PERIODS = 2
#: Share of the loudest response's torque from which on another one counts as loud.
LOUD_SHARE = 0.7


def measure_delay_and_damping(findings: Findings, recordings: Sequence[Recording], model: Model, solver: Solver = "lm") -> None:
    """The thesis's fit of every loud response, and the delay from setpoint to acting torque; a failure is a remark.

    Both take the torque that acts by the path in the findings, not a reading that follows it late.

    In quiet ones at rest friction poses as so much damping that a loop robust from none up to it would be slow for nothing.

    Parameters
    ----------
    findings : Findings
        Filled; with the torque path.
    recordings : sequence of Recording
        Excited; held-out ones do not count.
    model : Model
        For the places of the resonances.
    solver : Solver
        Of the log-magnitude fit.
    """
    recordings = acting_recordings([r for r in recordings if not r.sidecar.held_out], findings.path)
    loudest = max((float(np.std(r.torque)) for r in recordings if not r.sidecar.moving), default=0.0)
    loud = [r for r in recordings if r.sidecar.moving or np.std(r.torque) > LOUD_SHARE * loudest]
    for name, response in ({} if model.rigid else analyse.responses(loud)).items():
        try:
            findings.thesis[name] = analyse.thesis_fit(response, model, solver)
        except (DataError, Refused) as problem:
            findings.remarks.append(f"{name}: no log-magnitude fit ({problem})")
    if not recordings:
        return
    if findings.final is not None and isinstance(findings.final.fit, SeldomFit):  # a reading of the last millisecond of a row shows none
        found = findings.final.fit.simulated
        findings.dead_time = DeadTime(found.late_s, found.late_half_s, found.late_s / recordings[0].sample_period_s, np.empty(0))
        return
    _, resonance = analyse.characteristic_hz(model, recordings[0].sidecar.start_position_m or 0.0)
    try:
        measured = _at_instants(analyse.dead_time_of(recordings, resonance), findings, recordings[0].sample_period_s)
        findings.dead_time = _behind_slew_rate(measured, findings, recordings[0].sample_period_s)
    except DataError as problem:
        findings.remarks.append(str(problem))


def _at_instants(measured: DeadTime, findings: Findings, sample_s: float) -> DeadTime:
    """The delay where setpoint and torque were both read at instants: the torque that acts is then its mean, half a period ahead of it."""
    if findings.path is None or not findings.path.instantaneous:
        return measured
    return replace(measured, value_s=measured.value_s + 0.5 * sample_s, samples=measured.samples + 0.5)


def _behind_slew_rate(measured: DeadTime, findings: Findings, sample_s: float) -> DeadTime:
    """The delay of a drive that limits the slew rate: an excitation that jumps is late by the limit, and a loop's torque hardly jumps."""
    drive = findings.path.drive if findings.path is not None else None
    if drive is None or not any(lag.kind == "slew rate" for lag in drive.lags):
        return measured
    delay_s = drive.delay_s(sample_s)
    return replace(measured, value_s=delay_s, interval_s=max(drive.delay_interval, WHOLE) * sample_s, samples=delay_s / sample_s)


def delay(findings: Findings) -> float:
    """Identified delay from torque setpoint to acting torque, s; before it is known, the assumed one.

    Parameters
    ----------
    findings : Findings
        With or without a measured delay.

    Returns
    -------
    float, s
        Not below 0.
    """
    return max(findings.dead_time.value_s, 0.0) if findings.dead_time else findings.assumed_delay_s


def assume_delay(findings: Findings, structure: CascadeStructure) -> None:
    """Count, where no delay was measured, with ``ASSUMED_DELAY_PERIODS`` of the drive's loop, and say so.

    Parameters
    ----------
    findings : Findings
        Changed where no delay was measured.
    structure : CascadeStructure
        Of the drive's loops, for their period.
    """
    if findings.dead_time is not None or findings.assumed_delay_s:
        return
    findings.assumed_delay_s = ASSUMED_DELAY_PERIODS * structure.period_s
    findings.remarks.append(
        f"the delay of the torque is not known: counted with {1e3 * findings.assumed_delay_s:g} ms, "
        f"{ASSUMED_DELAY_PERIODS} periods of the drive's loop; record torque_setpoint_nm beside torque_nm to measure it"
    )
