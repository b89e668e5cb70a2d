"""One experiment on an axis whose model is known: what ``beltcomm simulate`` records."""

from __future__ import annotations

from beltcomm.experiments import phases, verification
from beltcomm.experiments.commission import close_first_loop, design_for
from beltcomm.experiments.execute_step import RESPONSE_S
from beltcomm.experiments.proving import verify_move
from beltcomm.experiments.recording_steps import measure_friction
from beltcomm.machine import stops
from beltcomm.machine.machine import Machine
from beltcomm.model import Model
from beltcomm.rundata import analyse
from beltcomm.rundata.findings import Findings, Settings


def run_experiment(machine: Machine, model: Model, experiment: str) -> str:
    """Run one experiment with everything known.

    Parameters
    ----------
    machine : Machine
        A simulated one.
    model : Model
        The plant's own.
    experiment : str
        "frf", "friction_sweep"; any other is the move.

    Returns
    -------
    str
        Name of its recording.
    """
    machine.hold_with(analyse.holding_nm(model))
    if experiment == "frf":
        phases.frequency_response(machine, "frf_1", model, machine.axis.torque_limit_nm, RESPONSE_S)
        return "frf_1"
    findings = Findings()
    close_first_loop(machine, findings, model)
    if experiment == "friction_sweep":
        measure_friction(machine, model)
        return "sweep"
    structure = machine.drive.capabilities.structure
    _, cascade = design_for(machine.axis, model, structure, findings, Settings(), machine.folder)
    stops.count_on_loop(machine, [model], cascade, 0.0)
    standard = verification.slowed_move(machine, model, cascade, 0.0)
    path = standard.at(1.0, machine.drive.capabilities.sample_period_s)
    verify_move(machine, model, cascade, 0.0, path)
    return "move_1"
