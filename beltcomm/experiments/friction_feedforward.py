"""Friction that a sweep has shown, sent ahead instead of that of a first fit which does not explain its records.

Around standstill friction that needs a way, or a gap, poses as viscous: three times what there is, counted up to the speed of fast moves,
drives the axis ahead of its reference until it is stopped.  The sweep measured it at speed.
"""

from __future__ import annotations

from dataclasses import replace

from beltcomm.control import Cascade
from beltcomm.errors import DataError
from beltcomm.experiments import execute_step
from beltcomm.identify.amplitude import family_around
from beltcomm.machine import stops
from beltcomm.machine.machine import Machine
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.rundata import analyse
from beltcomm.rundata.findings import Findings


def with_measured_friction(machine: Machine, findings: Findings, loop: execute_step.Closed) -> execute_step.Closed:
    """The loop, in the drive too, with the friction of the sweep sent ahead, where the first fit leaves its records unexplained."""
    if (
        loop.cascade is None
        or findings.final is None
        or not findings.final.fit.suspect
        or machine.folder.finished(execute_step.SWEEP) is None
    ):
        return loop
    cascade = with_sliding_friction(loop.cascade, loop.model, machine.folder.recording(execute_step.SWEEP))
    if cascade == loop.cascade:
        return loop
    stops.count_on_loop(machine, family_around(loop.model), machine.write_cascade(cascade), loop.delay_s)
    return replace(loop, cascade=cascade)


def with_sliding_friction(cascade: Cascade, model: Model, sweep: Recording) -> Cascade:
    """The cascade with the friction of ``sweep`` in its feedforward, where that tells it; else as it is.

    Gains and inertia stay: no pole moves.

    Parameters
    ----------
    model : Model
        That the cascade was designed for.
    """
    sent = cascade.feedforward
    if not (sent.viscous_nm_s_rad or sent.coulomb_nm):
        return cascade  # the drive sends none
    try:
        friction = analyse.friction_of([sweep], inertia_kg_m2=analyse.moved_inertia(model))
    except DataError:
        return cascade
    viscous, coulomb = friction.viscous, friction.coulomb
    if not all(one.interval is not None and one.value > one.interval for one in (viscous, coulomb)):
        return cascade
    return replace(cascade, feedforward=replace(sent, viscous_nm_s_rad=viscous.value, coulomb_nm=coulomb.value))
