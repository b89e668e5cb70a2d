"""Work on one member of a study, wherever that is done: values that can be sent to another process, and their results; among them the
tracking error of a move and the margins of one design on one axis.

The laboratory is imported when a member needs it: a worker that predicts moves starts in half the time without.
"""

from __future__ import annotations

import errno
import math
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from beltcomm.arrays import Array
from beltcomm.axis import Axis
from beltcomm.caches import source_hash
from beltcomm.configfiles import to_yaml, write_text
from beltcomm.control import Cascade
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.loops import sample_plants
from beltcomm.design.margins import margins_on
from beltcomm.errors import BeltcommError, DataError, Refused
from beltcomm.model import Model, PlantFile
from beltcomm.result import Result, jsonable
from beltcomm.study.population import HIDDEN, NOTHING, DrawnAxis, Population, Values, drawn_axis
from beltcomm.trajectory import Trajectory
from beltcomm.verify import Loop, predict_move, tracking_error

#: Grid points per plant: a margin is off by less than 0.1 deg or 0.2 dB.
POINTS = 500


@dataclass(frozen=True)
class Targets:
    """Targets of the move at the motor, m."""

    dynamic_m: float
    static_m: float


@dataclass(frozen=True)
class SharedInput:
    """Input that all members share.

    Attributes
    ----------
    model : Model
        Of the base.
    cascade : Cascade
        The design on trial.
    loop : Loop
        What the drive adds, with the base's delay.
    move : Trajectory
        With its rest.
    along_nm : ndarray or None
        Torque sent along with the move, (n,), or None.
    plants : callable
        Of model, places, carriage masses, delay and the apparent damping, every variant that margins are asked for.
    travel_m : tuple of float, of the carriage
    """

    model: Model
    cascade: Cascade
    loop: Loop
    move: Trajectory
    along_nm: Array | None
    apparent_damping_nm_s_rad: float
    plants: Callable[[Model, Sequence[float], Sequence[float], float, float], list[DesignPlant]]
    targets: Targets
    travel_m: tuple[float, float] = (-math.inf, math.inf)

    @property
    def start_m(self) -> float:
        """Start of the base's move, m."""
        return float(self.move.position_m[0])


def track(ground: SharedInput, axis: DrawnAxis) -> dict[str, Any]:
    """Predicted errors, forces and worst margins of the design on this axis.

    Keys end in their unit; ``*_cart`` at the carriage; margins are the worst of both ends of the move and every damping down to none.
    passed : both targets kept, and every loop stable.

    Parameters
    ----------
    ground : SharedInput
        What all members share.
    axis : DrawnAxis
        Of the member.

    Raises
    ------
    Refused
        Where the move leaves the travel, or the carriage what the model describes.
    """
    moved = _replace_start(ground.move, axis.start_m)
    first, last = float(moved.position_m.min()), float(moved.position_m.max())
    if first < ground.travel_m[0] or last > ground.travel_m[1]:
        raise Refused(
            f"the move would go from {first:.4g} m to {last:.4g} m, the travel is {ground.travel_m[0]:g}..{ground.travel_m[1]:g} m; "
            "let move.from end earlier, or give a shorter move"
        )
    period = ground.loop.structure.period_s
    variants = ground.plants(
        axis.model,
        sorted({axis.start_m, axis.start_m + float(ground.move.position_m[-1]) - ground.start_m}),
        [axis.model["cart.mass"]],
        axis.delay_s,
        ground.apparent_damping_nm_s_rad,
    )
    plants = list({replace(plant, name=""): plant for plant in variants}.values())
    margins = margins_on(ground.cascade, sample_plants(plants, period, POINTS))
    stable = all(one.stable and one.velocity_stable for one in margins)
    found: dict[str, Any] = {
        "stable": stable,
        "phase_margin_deg": min(one.phase_margin_deg for one in margins),
        "position_phase_margin_deg": min(one.position_phase_margin_deg for one in margins),
        "gain_margin_db": min(one.least_gain_margin_db for one in margins),
        "sensitivity_db": max(one.most_sensitivity_db for one in margins),
    }
    path = predict_move(axis.model, ground.cascade, moved, replace(ground.loop, delay_s=axis.delay_s), extra_torque_nm=ground.along_nm)
    motor = path.error
    cart = tracking_error(path.t_s, moved.position_m, path.cart_m)
    kept = motor.dynamic_m <= ground.targets.dynamic_m and motor.static_m <= ground.targets.static_m
    return {
        "passed": bool(kept and stable),
        "dynamic_m": motor.dynamic_m,
        "static_m": motor.static_m,
        "dynamic_cart_m": cart.dynamic_m,
        "static_cart_m": cart.static_m,
        "torque_nm": float(np.abs(path.torque_nm).max()),
        "belt_force_n": path.belt_force_n,
        "saturated": list(path.saturated),
        **found,
    }


def _replace_start(move: Trajectory, start_m: float) -> Trajectory:
    """Motion shifted to another place."""
    shift = start_m - float(move.position_m[0])
    return replace(move, position_m=move.position_m + shift) if shift else move


class Work(Protocol):
    """Work that finds the result of a member."""

    def found(self, number: int, values: Values, folder: Path | None = None) -> dict[str, Any]:
        """Results of a member as plain values.

        Parameters
        ----------
        number : int
            From 0.
        values : Values
            What differs, SI; ``run`` for a real axis.
        folder : Path or None
            Where what it makes stays; None keeps nothing.

        Raises
        ------
        BeltcommError
        """
        ...

    def described(self, values: Values) -> Mapping[str, Any] | None:
        """The member as a plant file, None for one that is no virtual axis."""
        ...


@dataclass(frozen=True)
class Doing:
    """Commands that a member may need, handed down by whoever knows them.

    Attributes
    ----------
    commission : callable or None
        As in :mod:`beltcomm.api`.
    """

    commission: Callable[..., Result] | None


@dataclass(frozen=True)
class MemberTracking:
    """The design of the base on the member's axis."""

    ground: SharedInput
    population: Population

    def found(self, number: int, values: Values, folder: Path | None = None) -> dict[str, Any]:
        """Tracking of the member, by :func:`track`."""
        return track(self.ground, self._axis(values))

    def described(self, values: Values) -> Mapping[str, Any]:
        """The member as a plant file."""
        axis = self._axis(values)
        return {**axis.model.to_dict(), "drive": {"setpoint_delay_s": axis.delay_s, "counts_per_rev": self.ground.loop.counts_per_rev}}

    def _axis(self, values: Values) -> DrawnAxis:
        return drawn_axis(self.population, values, self.ground.model, self.ground.loop.delay_s, self.ground.start_m)


@dataclass(frozen=True)
class Commissioned:
    """A virtual drive on the member's axis, commissioned; then compared or diagnosed where ``each`` says so."""

    plant: PlantFile
    axis: Axis
    population: Population
    seed: int
    each: str
    doing: Doing

    def found(self, number: int, values: Values, folder: Path | None = None) -> dict[str, Any]:
        """Results of the commands, beside the truth."""
        if folder is not None:
            return self._in(folder, number, values)
        with tempfile.TemporaryDirectory(prefix="beltcomm-study-") as kept:
            return self._in(Path(kept), number, values)

    def described(self, values: Values) -> Mapping[str, Any]:
        """The member as a plant file."""
        drawn = drawn_axis(self.population, values, self.plant.model, self.plant.setpoint_delay_s, 0.0)
        drive = {**self.plant.drive_section(), "setpoint_delay_s": drawn.delay_s}
        return {**drawn.model.to_dict(), "drive": drive}

    def _in(self, folder: Path, number: int, values: Values) -> dict[str, Any]:
        from beltcomm.experiments.options import Options
        from beltcomm.jobs.laboratory import compare_run, diagnose_run

        truth = drawn_axis(self.population, values, self.plant.model, self.plant.setpoint_delay_s, 0.0).model
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / "plant.yaml", to_yaml(self.described(values)))
        run = folder / "run"
        place = {"start_position": self.axis.travel.middle_m}
        options = Options(yes=True, seed=self.seed + number, thorough=self.each == "diagnose", drive=place)
        assert self.doing.commission is not None
        try:
            made = self.doing.commission(f"virtual:{folder / 'plant.yaml'}", self.axis, run, options=options).to_json()
            if self.each == "commission":
                return _commission_quantities(made, truth)
            if self.each == "compare":
                return _compare_quantities(compare_run(run, pictures=False).to_json())
            return _diagnosis_quantities(diagnose_run(run, cost=False).to_json(), str(values.get(HIDDEN, NOTHING)))
        except BeltcommError as error:  # the folder is another one every time
            error.args = (str(error).replace(str(folder), "MEMBER"), *error.args[1:])
            raise


@dataclass(frozen=True)
class Fleet:
    """A run folder that is there already."""

    each: str

    def found(self, number: int, values: Values, folder: Path | None = None) -> dict[str, Any]:
        """Result of ``diagnose`` or ``compare``."""
        from beltcomm.jobs.laboratory import compare_run, diagnose_run

        run = Path(str(values["run"]))
        if self.each == "compare":
            return _compare_quantities(compare_run(run, pictures=False).to_json())
        return _diagnosis_quantities(diagnose_run(run, cost=False).to_json(), None)

    def described(self, values: Values) -> None:
        """A real axis has no plant file."""
        return None


def _commission_quantities(made: Mapping[str, Any], truth: Model) -> dict[str, Any]:
    """Of a commissioning: the verdict, the errors, and for each parameter how far it is off, and whether its interval covers the truth."""
    verdict = made.get("verdict") or {}
    measured, predicted = verdict.get("measured") or {}, verdict.get("predicted") or {}
    found: dict[str, Any] = {"passed": bool(verdict.get("passed")) and not made.get("reservations")}
    found |= {
        "dynamic_m": measured.get("dynamic_m"),
        "static_m": measured.get("static_m"),
        "predicted_dynamic_m": predicted.get("dynamic_m"),
    }
    if made.get("fit"):
        found |= {"trusted": not made["fit"]["suspect"], "misfit": made["fit"]["misfit"]}
    for name, one in (made.get("model") or {}).get("parameters", {}).items():
        if one["interval"] is not None and name in truth.parameters:
            off = abs(one["value"] - truth[name])
            found |= {f"covers {name}": bool(off <= one["interval"]), f"off {name}": off}
    return found


def _compare_quantities(made: Mapping[str, Any]) -> dict[str, Any]:
    """Of a comparison: error over noise, and where it is worst."""
    return {"ratio": made["ratio"]["overall"], "held_out": made["ratio"]["held_out"], "worst": [one["text"] for one in made["worst"][:1]]}


def _diagnosis_quantities(made: Mapping[str, Any], hidden: str | None) -> dict[str, Any]:
    """Of a diagnosis: what it says, and whether that is the truth: ``hidden``, "none" of a healthy axis, None where not known."""
    added = [step["added"] for step in made["steps"] if step["added"]]
    found: dict[str, Any] = {"verdict": made["verdict"], "named": added}
    if hidden == NOTHING:
        found["healthy left alone"] = not added
    elif hidden is not None:
        found["hidden effect named"] = hidden in added
        found["hidden effect named, nothing else"] = added == [hidden]
    return found


def lines_of(work: Work, members: Sequence[tuple[int, str, Values]]) -> list[dict[str, Any]]:
    """A line of ``members.jsonl`` for each (number, key, values); a member that fails has its exit code and sentence for a result.

    Parameters
    ----------
    work : Work
        That is done for each member.
    members : sequence of tuple of int, str and Values
        Number, key and drawn values.
    """
    return [line_of(work, *member) for member in members]


def _of_the_member(error: OSError | MemoryError, values: Values) -> bool:
    """True if a file of the run that is the member is in the way, and not this computer."""
    run, file = values.get("run"), getattr(error, "filename", None)
    full = getattr(error, "errno", None) in (errno.ENOSPC, errno.EDQUOT)
    return run is not None and file is not None and not full and Path(os.fsdecode(file)).is_relative_to(str(run))


def line_of(work: Work, number: int, key: str, values: Values, folder: Path | None = None) -> dict[str, Any]:
    """One line.

    Parameters
    ----------
    work : Work
        That is done for each member.
    number : int
        Of the member.
    key : str
        Of the member's values.
    values : Values
        Drawn for the member.
    folder : Path or None
        Of its files; None keeps none.

    Raises
    ------
    Refused
        Where this computer is in the way, not the member: a full disk, no memory.
    """
    line: dict[str, Any] = {"member": number, "key": key, "program": source_hash(), "values": dict(values)}
    try:
        found = work.found(number, values, folder)
    except BeltcommError as error:
        return {**line, "exit_code": error.exit_code, "error": str(error)}
    except (OSError, MemoryError) as error:
        if _of_the_member(error, values):
            return {**line, "exit_code": DataError.exit_code, "error": f"its files cannot be read: {error}"}
        told = f"{type(error).__name__}: {error}".rstrip(": ")
        raise Refused(f"member {number} cannot be computed here ({told}); what is done is kept, the same command goes on") from error
    except Exception as error:  # an axis nobody thought of is a finding, not the end of the study
        return {**line, "exit_code": 1, "error": f"an unexpected {type(error).__name__}: {error}"}
    return {**line, "exit_code": int(found.get("passed") is False), "found": jsonable(found)}
