"""Proof by a verification move, the move itself, and whether a run's design is proven at all."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.control import Cascade
from beltcomm.design.margins import Margins
from beltcomm.drive.parameters import cascade_to_parameters
from beltcomm.errors import Declined, Refused
from beltcomm.fit.model_fit import SUSPECT_MISFIT
from beltcomm.rundata.calibration import RESULT
from beltcomm.rundata.revisions import current_revision, revisions
from beltcomm.rundata.store import saved_design
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Talk
from beltcomm.trajectory import Trajectory, load_move, plan_trajectory

#: Gains that differ by less are the same: a resumed fit begins elsewhere and ends within its own tolerance.
SAME_GAIN = 1e-3
#: Phase margin of the velocity loop, degrees, below which a controller is no success: |1/(1 + L)| is then above 6 dB.
SURE_MARGIN_DEG = 30.0
#: m: ends of a path that differ by less are the same.
SAME_PLACE_M = 1e-4
#: How the host led a move whose feedforward its repetitions have taught.
LEARNT = "learnt"
#: Of a file whose checksum is missing or another one.
EDITED = "was edited since, or is of a version that kept no checksum"
#: Files that say what gains a drive gets, and what its raw numbers mean.
BEHIND_GAINS = (("designs", "final"), ("results", RESULT))
#: Of a design whose model leaves too much.
SUSPECT = "the model does not explain what was measured"


def thin_margins(margins: Sequence[Margins]) -> list[str]:
    """Sentence on a velocity loop that has too little phase margin; empty where it has enough.

    Parameters
    ----------
    margins : sequence of Margins
        Of all plants.
    """
    return _thin(min(one.phase_margin_deg for one in margins))


def _thin(margin_deg: float) -> list[str]:
    if margin_deg >= SURE_MARGIN_DEG:
        return []
    return [f"the velocity loop is left with {margin_deg:.0f} deg of phase margin, a sound one has {SURE_MARGIN_DEG:.0f} or more"]


def proof(cascade: Cascade, trajectory: Trajectory, payloads_kg: Sequence[float], led_by: str = "") -> dict[str, Any]:
    """Controller that a move is driven with, for the sidecar of its recording (``controller``) and for its verdict.

    Parameters
    ----------
    cascade : Cascade
    trajectory : Trajectory
        The move, at the carriage.
    payloads_kg : sequence of float, kg
        Further ones that the design holds for.
    led_by : str
        How the host led the motor ahead of the carriage, or its reference ("led"); "" where the gains stood for themselves.
    """
    return ({"led_by": led_by} if led_by else {}) | {
        "gains": {name: float(value) for name, value in cascade_to_parameters(cascade).items()},
        "further_payloads_kg": [float(mass) for mass in payloads_kg],
        "path": [float(trajectory.position_m[0]), float(trajectory.position_m[-1]), float(trajectory.duration_s)],
        **({"limits": {name: float(value) for name, value in asdict(limits).items()}} if (limits := trajectory.limits) else {}),
    }


def same_gains(one: Any, other: Any) -> bool:
    """True if two mappings name → value are one controller.

    Parameters
    ----------
    one, other : Any, SI
        Anything else is no controller.
    """
    if not isinstance(one, Mapping) or not isinstance(other, Mapping) or one.keys() != other.keys():
        return False
    try:
        return all(math.isclose(float(one[name]), float(other[name]), rel_tol=SAME_GAIN, abs_tol=1e-12) for name in one)
    except (TypeError, ValueError, OverflowError):  # no numbers
        return False


def _proves(recorded: Mapping[str, Any], wanted: Mapping[str, Any]) -> bool:
    """True if a move recorded with one :func:`proof` stands for another; one recorded without any proves nothing."""
    path, payloads = recorded.get("path"), recorded.get("further_payloads_kg")
    return (
        isinstance(path, Sequence)
        and recorded.get("led_by") == wanted.get("led_by")
        and all(math.isclose(a, b, rel_tol=SAME_GAIN, abs_tol=SAME_PLACE_M) for a, b in zip(path, wanted["path"], strict=True))
        and payloads == wanted["further_payloads_kg"]
        and same_gains(recorded.get("gains"), wanted["gains"])
    )


def move_name(folder: RunFolder, wanted: Mapping[str, Any]) -> str:
    """``move_N``: the recorded move that proves what is wanted, else the first name that is free.

    Parameters
    ----------
    folder : RunFolder
    wanted : mapping of str to Any
        Gains, path, loads and way of sending that a proof needs.
    """
    number = 1
    while folder.finished(f"move_{number}") is not None:
        if _proves(folder.recording(f"move_{number}").sidecar.controller, wanted):
            break
        number += 1
    return f"move_{number}"


def doubts(folder: RunFolder) -> list[str]:
    """Doubts about the gains of ``designs/final.yaml``, in words; empty when nothing speaks against writing them.

    Parameters
    ----------
    folder : RunFolder

    Raises
    ------
    DataError
        Without a design.
    """
    behind = [(kind, name) for kind, name in BEHIND_GAINS if name in folder.names(kind)]
    found = [f"{name}.yaml {EDITED}" for kind, name in behind if folder.edited(kind, name)]
    if suspect(folder):
        found.append(SUSPECT)
    designed = saved_design(folder)
    gains = designed.get("parameters")
    found += _thin(min((one["phase_margin_deg"] for one in designed["margins"]), default=math.inf))
    found += (designed.get("proof") or {}).get("doubts") or ()
    results = [folder.load("results", name) for name in folder.names("results") if name.startswith("verify_")]
    proofs = [(result, shown) for result in results if (shown := result.get("proof")) is not None]
    driven = [result for result, shown in proofs if same_gains(shown.get("gains"), gains) and shown.get("led_by", "led") == "led"]
    if not driven:
        found.append("no verification move was driven with these gains")
    elif not driven[-1].get("passed"):
        found.append("the verification move with these gains missed its target")
    else:
        found += [one for one in driven[-1].get("reservations") or () if one not in found]
    return found


def admit(folder: RunFolder, talk: Talk, *, yes: bool, force: bool) -> None:
    """Warn of every doubt about the design and ask; ``yes`` alone is no answer to that.

    Parameters
    ----------
    folder : RunFolder
    talk : Talk
    yes : bool
        True for a consent given before.
    force : bool
        True if no doubt counts.

    Raises
    ------
    Refused
    """
    found = "; ".join(doubts(folder))
    if not found:
        return
    talk.say(f"These gains are in doubt: {found}.")
    if force:
        return
    if yes:
        raise Refused(f"nothing was written: {found}; verify the design first, or write it all the same with --force")
    if not talk.confirm("Write them all the same?"):
        raise Declined("nothing was written, as you said")


def suspect(folder: RunFolder, *, designed: bool = True) -> bool:
    """True if a model leaves too much unexplained: its own revision's word where it has one, else the fit's.

    Parameters
    ----------
    folder : RunFolder
    designed : bool
        The model that the design is of, where there is a design; else the present one.
    """
    if designed and "final" in folder.names("designs"):
        revision = saved_design(folder).get("revision")
        rung = next((one for one in revisions(folder) if one.name == revision), None)
    else:
        rung = current_revision(folder)
    if rung is not None:
        return rung.confirmed is False or rung.ratio**2 > SUSPECT_MISFIT
    return bool((folder.load_result("fit") or {}).get("suspect"))


def error_of(folder: RunFolder, revision: str) -> float:
    """Error over noise of a revision, or of the fit; infinite where nobody noted it.

    Parameters
    ----------
    folder : RunFolder
    revision : str
        Name; another one than those kept for the fit.

    Returns
    -------
    float
        1 at the noise.
    """
    for rung in revisions(folder):
        if rung.name == revision:
            return rung.ratio
    return math.sqrt(float((folder.load_result("fit") or {}).get("misfit", math.inf)))


#: m/s, m/s²; of an axis that states no reference motion.
GENTLE = (0.5, 2.0)


def move_of(folder: RunFolder, period_s: float, file: Path | None) -> Trajectory:
    """The user's own move from a file, the one that verified the run, or the standard one of its axis.

    Parameters
    ----------
    folder : RunFolder
    period_s : float, s
        Of the drive.
    file : Path or None
        Of the user's own move; None for the other two.
    """
    axis = folder.axis
    if file is not None:
        return load_move(file, period_s, axis)
    limits, path = limits_of(folder, period_s), _proof(folder).get("path")
    if path:
        return plan_trajectory(path[0], path[1], limits, period_s)
    low, high = axis.travel.ends_m
    start = max(low + 0.05 * (high - low), min(0.0, high))
    return plan_trajectory(start, min(start + axis.targets.way_m, high - 0.05 * (high - low)), limits, period_s)


def limits_of(folder: RunFolder, period_s: float) -> TrajectoryLimits:
    """Limits of the standard move, as slow as the one that verified the run; gentle ones where the axis states none.

    Parameters
    ----------
    folder : RunFolder
    period_s : float, s
        Of the drive.
    """
    axis, proven = folder.axis, _proof(folder)
    if kept := proven.get("limits"):
        return TrajectoryLimits(**kept)
    top, fastest = axis.limits.speed_m_s or GENTLE[0], axis.limits.acceleration_m_s2 or GENTLE[1]
    gentle = TrajectoryLimits(speed_m_s=min(top, GENTLE[0]), acceleration_m_s2=min(fastest, GENTLE[1]), jerk_m_s3=20.0 * GENTLE[1])
    limits = axis.trajectories.get(axis.targets.limits) or gentle
    if not (path := proven.get("path")):
        return limits
    start, end, duration = path  # of a run from before limits were kept with it
    return limits.slower(plan_trajectory(start, end, limits, period_s).duration_s / duration)


def verified(folder: RunFolder) -> Mapping[str, Any]:
    """Verdict of the move that verified the run last, as it was kept; empty without one.

    Parameters
    ----------
    folder : RunFolder
    """
    names = [name for name in folder.names("results") if name.startswith("verify_")]
    return folder.load("results", names[-1]) if names else {}


def _proof(folder: RunFolder) -> Mapping[str, Any]:
    """Path of that move, start and end, m, and seconds, and its limits."""
    return verified(folder).get("proof") or {}
