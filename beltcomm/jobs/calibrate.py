"""``beltcomm calibrate``: what the gains of a connected drive mean, measured on the axis that it drives."""

from __future__ import annotations

from collections.abc import Callable

from beltcomm.axis import Axis
from beltcomm.drive import Capabilities, Drive
from beltcomm.errors import Refused
from beltcomm.experiments import gain_steps, phases, referencing
from beltcomm.experiments.bounds import CREEP_SECONDS, Experiment
from beltcomm.experiments.plan import Plan
from beltcomm.given import pasted
from beltcomm.machine.creep import BREAKAWAY_SHARE
from beltcomm.machine.machine import Machine
from beltcomm.result import Result
from beltcomm.rundata.calibration import keep_for_kind
from beltcomm.rundata.findings import Settings
from beltcomm.runfolder import RunFolder
from beltcomm.sentences.words import remarks_lines
from beltcomm.talk import Talk


def plan_of(axis: Axis, capabilities: Capabilities) -> Plan:
    """Plan of a calibration: creep both ways, for sign and breakaway; then the steps.

    Parameters
    ----------
    axis : Axis
        Data sheets.
    capabilities : Capabilities
        Of the drive.

    Raises
    ------
    UsageError
        For an axis file that does not say enough.
    """
    axis.require("calibrate", "pulley.effective_radius_m", "motor.inertia_kg_m2", "travel.min_m", "travel.max_m", "limits.speed_m_s")
    torque = BREAKAWAY_SHARE * min(axis.torque_limit_nm, capabilities.peak_torque_nm)
    creeping = Experiment(
        "direction + breakaway",
        phases.SIGN_TRAVEL_M,
        phases.SIGN_REACH_M,
        phases.EXCITATION_SPEED_M_S,
        torque,
        min(axis.belt_force_limit_n, torque / axis.transmission_m_rad),
        CREEP_SECONDS,
    )
    return Plan(
        f"The carriage of {axis.name or 'the axis'} will creep some millimetres both ways; then the drive's own loops get small steps "
        f"while friction holds it: half the torque that moves it. Its gains are set to the smallest ones for that and put back.",
        (creeping, gain_steps.experiment(axis, capabilities)),
        verb="calibrate",
    )


def calibrate_on(drive: Drive, name: str, folder: RunFolder, settings: Settings, agree: Callable[[Machine], None], talk: Talk) -> Result:
    """Measure, hold it against what is known, keep it in the run, and of a real drive for its kind.

    Parameters
    ----------
    drive : Drive
        Connected.
    name : str
        Of the drive.
    folder : RunFolder
    settings : Settings
        Place of the carriage that was asked for.
    agree : callable
        Shows what will move and raises Refused for a no.
    talk : Talk

    Raises
    ------
    Refused
        Where it contradicts what is known by more than a factor of two, or cannot be told.
    """
    folder.claim_drive(drive.capabilities.identity)
    with Machine(drive, folder.axis, folder, talk) as machine:
        if machine.axis.mounting.tilted:
            raise Refused("what the drive's gains mean is measured on a level axis only: nothing would hold a tilted one between the steps")
        machine.check_scaling()
        referencing.reference(machine, settings, needed=False)
        agree(machine)
        machine.titles = ("direction + breakaway", "small steps")
        machine.begin(machine.titles[0])
        breakaway = phases.sign_and_scale(machine)
        machine.begin(machine.titles[1])
        found = gain_steps.measure(machine, breakaway.coulomb_nm)
        remarks = gain_steps.adopt(machine, found)
    text = [f"What the gains of {drive.capabilities.name} mean (95 % intervals):", *found.lines(), *remarks_lines(remarks)]
    if name.partition(":")[0] != "virtual":  # a simulated drive tells nothing of a real one
        text.append(f"  {keep_for_kind(found)}")
    text.append(f"Next: beltcomm apply --drive {pasted(name)} --run {pasted(folder.path)}   (once this run has a design)")
    return Result({"run": str(folder.path), **found.to_dict(), "remarks": remarks}, text)
