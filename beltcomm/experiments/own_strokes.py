"""Strokes that the drive makes by itself: what is said of them beforehand, and what a position loop without feedforward makes of them.

Such a loop lags by  v/K_PP  and settles with  e^(-K_PP t); the drive is as fast as its reference only after a while.
"""

from __future__ import annotations

import math
from typing import Any

from beltcomm.axis import Axis
from beltcomm.drive import Capabilities
from beltcomm.errors import Refused
from beltcomm.identify.sweeps import RUN_IN_KEY
from beltcomm.machine.machine import Machine, stroking
from beltcomm.schedule.orders import PLATEAU_ROWS, SWEEP_LONGEST_S, SWEEP_RUN_IN_S

#: Time constants after which the speed is that of the reference to 2 %.
CONSTANTS = 4.0
#: s: a loop that takes longer is too slow for a sweep.
LONGEST_S = 4.0
#: m: a stroke is so slow that its lag is no larger.
LAG_M = 0.05
#: Strokes of a sweep of seven speeds, three of them twice; s and time constants until one has arrived, at most.
STROKES, ARRIVAL_S, ARRIVING = 20, 2.0, 10.0
#: Polls while a stroke is handed over; m/s of the slowest way to where a sweep begins.
HANDING_OVER, SLOW_M_S = 12, 0.05


def unguarded_words(capabilities: Capabilities) -> str:
    """Sentence for a plan on the loss of the host; nothing where the drive is guarded.

    Parameters
    ----------
    capabilities : Capabilities
    """
    if stroking(capabilities) != "profile":
        return ""
    return (
        " Nothing guards a drive over RS-232: it makes each stroke by itself, and when the cable is pulled it ends the one it has inside "
        "the travel and holds the axis there."
    )


def _lags(capabilities: Capabilities) -> bool:
    """True if strokes are followed late."""
    return stroking(capabilities) == "profile" and not capabilities.structure.velocity_feedforward


def kpp_1_s(machine: Machine) -> float:
    """The gain that a lag depends on, 1/s; infinite where nothing lags.

    Parameters
    ----------
    machine : Machine
    """
    return machine.drive.backup().get("kpp_1_s", 0.0) if _lags(machine.drive.capabilities) else math.inf


def settle_s(machine: Machine) -> float:
    """Time after which a stroke is as fast as its reference, s.

    Parameters
    ----------
    machine : Machine

    Raises
    ------
    Refused
        For a loop that is too slow.
    """
    kpp = kpp_1_s(machine)
    if kpp * LONGEST_S < CONSTANTS:
        raise Refused(
            f"the position loop follows with Kv = {kpp:.3g} 1/s and no velocity feedforward, so a stroke would take more than "
            f"{LONGEST_S:g} s until its speed is constant; this drive needs its CAN port for a friction sweep"
        )
    return CONSTANTS / kpp


def note(machine: Machine) -> dict[str, Any]:
    """For the sidecar of a sweep: the run-in of its plateaus, where it is not the usual one.

    Parameters
    ----------
    machine : Machine
    """
    return {RUN_IN_KEY: SWEEP_RUN_IN_S + settle_s(machine)} if _lags(machine.drive.capabilities) else {}


def longest_sweep_s(axis: Axis, capabilities: Capabilities) -> float:
    """Time that a sweep may take beyond one in step with the host, s: longer plateaus, handing over, arriving, and settling.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    """
    if stroking(capabilities) != "profile":
        return 0.0
    period_s = capabilities.sample_period_s
    plateau_s = max(0.0, 1.5 * PLATEAU_ROWS * period_s - SWEEP_LONGEST_S)
    each_s = plateau_s + HANDING_OVER * period_s + ARRIVAL_S
    way = axis.travel.length_m
    if not _lags(capabilities):
        return STROKES * each_s + way / SLOW_M_S
    slowest = CONSTANTS / LONGEST_S
    return STROKES * (each_s + LONGEST_S + ARRIVING / slowest) + way / min(SLOW_M_S, LAG_M * slowest)
