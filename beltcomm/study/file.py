"""A study from its file: the base, what differs, what is done with each member."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from beltcomm.axis import Axis, load_axis
from beltcomm.axis.entries import NO_TARGETS
from beltcomm.axis.terms import PLAIN, Terms, terms_of
from beltcomm.configfiles import did_you_mean, digest_of, find_config, read_yaml
from beltcomm.control import Cascade
from beltcomm.design.feedforward import compensation
from beltcomm.drive.parameters import cascade_to_parameters, parameters_to_cascade
from beltcomm.errors import DataError, UsageError
from beltcomm.model import PlantFile, load_plant
from beltcomm.outside import read_text
from beltcomm.quantities import parse_quantity
from beltcomm.result import jsonable, plain
from beltcomm.rundata import analyse, offline
from beltcomm.rundata.cost import offline_move
from beltcomm.rundata.proof import move_of
from beltcomm.rundata.store import saved_design
from beltcomm.runfolder import RunFolder
from beltcomm.study.members import Commissioned, Doing, Fleet, MemberTracking, SharedInput, Targets, Work
from beltcomm.study.population import Population, Values, nominal_of, population_from, units_of
from beltcomm.trajectory import load_move, with_dwell
from beltcomm.verify import REST_S, Loop

ENTRIES = ("name", "about", "each", "base", "members", "seed", "population", "ageing", "hidden", "move", "targets")
BASE_ENTRIES = ("run", "plant", "axis", "gains", "runs")
EACH = ("track", "commission", "diagnose", "compare")
#: Members of a study that does not say how many.
MEMBERS = 1000


@dataclass(frozen=True)
class Study:
    """Request of a study file.

    Attributes
    ----------
    count : int
        Of members.
    work : Work
        What finds a member's result from its values.
    population, nominal
        Where the values come from; None for a fleet, whose ``runs`` are the members.
    targets : dict of str to float
        By result, what it is to stay below.
    base : str
        In words.
    gains : dict of str to float or None
        On trial.
    units : dict of str to str
        Of the values.
    fingerprint : str
        Of everything that all members share; with the values it makes the key of a member.
    terms : Terms
        Words and units of the axis.
    """

    name: str
    each: str
    count: int
    work: Work
    population: Population | None
    nominal: Mapping[str, float]
    runs: tuple[str, ...]
    targets: Mapping[str, float]
    base: str
    gains: Mapping[str, float] | None
    fingerprint: str
    units: Mapping[str, str]
    terms: Terms = PLAIN

    def values(self, number: int) -> Values:
        """Values of a member."""
        return {"run": self.runs[number]} if self.population is None else self.population.member(number, self.nominal)

    def key(self, number: int) -> str:
        """Key of a member's definition: the same program finds the same result for the same key."""
        values = dict(self.values(number))
        content = _run_fingerprint(Path(self.runs[number])) if self.population is None else ""
        return _digest([self.fingerprint, values, content])


def load_study(name: str | Path, doing: Doing | None = None) -> Study:
    """The study of a file, or of a shipped one by its name.

    Parameters
    ----------
    name : str or Path
        Of a shipped study, or a path.
    doing : Doing or None
        The commands for studies that need one.

    Raises
    ------
    UsageError
        That names file and entry.
    DataError
        For a run that cannot be the base.
    """
    path = find_config("studies", str(name))
    data = read_yaml(path)
    try:
        return _study_in(path, data, doing or Doing(None))
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from error


def _study_in(path: Path, data: Mapping[str, Any], doing: Doing) -> Study:
    _known(data, ENTRIES, "the study")
    each = str(data.get("each", "track"))
    if each not in EACH:
        raise UsageError(f"each is {each!r}{did_you_mean(each, EACH)}; it is one of {', '.join(EACH)}")
    base = data.get("base")
    if not isinstance(base, dict):
        raise UsageError(
            "base is missing; name a run (run: FOLDER), a plant and its axis (plant: g_a, axis: egc-70-600), or many runs (runs)"
        )
    _known(base, BASE_ENTRIES, "base")
    ways = [key for key in ("run", "plant", "runs") if key in base]
    if len(ways) != 1:
        raise UsageError(f"base names {' and '.join(ways) or 'none'} of run, plant and runs; name one of them")
    title = str(data.get("name", path.stem))
    if ways == ["runs"]:
        return _fleet(path, data, title, each)
    count, seed = _whole(data, "members", MEMBERS, 1), _whole(data, "seed", 0, 0)
    told = data.get("targets") or {}
    _known(told, ("dynamic", "static"), "targets")
    targets = Targets(_target(told, "dynamic", NO_TARGETS.following_m), _target(told, "static", NO_TARGETS.settled_m))
    if each == "track":
        ground, words = _ground(path, data, base, targets)
        model, delay_s, start_m = ground.model, ground.loop.delay_s, ground.start_m
    else:
        axis, plant, words = _machine(base, each)
        model, delay_s, start_m = plant.model, plant.setpoint_delay_s, 0.0
    population = population_from(data, model, seed)
    nominal = nominal_of(model, delay_s, start_m)
    for name, one in population.drawn.items():
        if one.kind == "tolerance" and nominal[name] == 0.0:
            raise UsageError(
                f"population.{name} has a tolerance, and its nominal value here is 0, of which every share is 0; write uniform"
            )
    if not (population.drawn or population.old or population.hidden):
        raise UsageError("nothing differs between the members; give population, ageing or hidden")
    if each == "track":
        work: Work = MemberTracking(ground, population)
        shared = [plain(replace(ground, plants=None)), plain(population)]  # type: ignore[arg-type]
        gains = cascade_to_parameters(ground.cascade)
    else:
        if "move.from" in population.drawn or "move" in data or "gains" in base:
            raise UsageError("move, move.from and gains are for each: track; a commissioning makes its own")
        work, gains = Commissioned(plant, axis, population, seed, each, doing), None
        shared = [plain(plant), axis.fingerprint(), plain(population)]
    return Study(
        title,
        each,
        count,
        work,
        population,
        nominal,
        (),
        _noise(each) or {"dynamic_m": targets.dynamic_m, "static_m": targets.static_m},
        words,
        gains,
        _digest([each, plain(targets), *shared]),
        units_of(model),
        terms_of(RunFolder.open(path.parent / str(base["run"])).axis if "run" in base else load_axis(str(base["axis"]))),
    )


def _fleet(path: Path, data: Mapping[str, Any], title: str, each: str) -> Study:
    """A study whose members are run folders."""
    if each not in ("diagnose", "compare"):
        raise UsageError(f"each is {each!r}; with many runs it is diagnose or compare")
    for key in ("population", "ageing", "hidden", "members", "move", "targets"):
        if key in data:
            raise UsageError(f"{key} has no meaning for a fleet of runs; leave it out")
    told = data["base"]["runs"]
    patterns = [str(one) for one in (told if isinstance(told, list) else [told])]
    found = {
        str(run.resolve())  # a worker may stand elsewhere
        for pattern in patterns
        for run in (sorted(path.parent.glob(pattern)) if not Path(pattern).is_absolute() else sorted(Path("/").glob(pattern[1:])))
        if (run / "axis.yaml").is_file()
    }
    if not found:
        raise UsageError(f"base.runs: no run folder is {' or '.join(patterns)}, seen from {path.parent.resolve()}")
    runs = tuple(sorted(found))
    return Study(title, each, len(runs), Fleet(each), None, {}, runs, _noise(each), f"{len(runs)} runs", None, _digest([each]), {})


def _noise(each: str) -> dict[str, float]:
    """Reference of a comparison: an error as large as the noise."""
    return {"ratio": 1.0} if each == "compare" else {}


def _ground(path: Path, data: Mapping[str, Any], base: Mapping[str, Any], targets: Targets) -> tuple[SharedInput, str]:
    """The design on trial, and where it comes from."""
    file = path.parent / str(data["move"]) if "move" in data else None
    if "run" in base:
        return _ground_of_run(path.parent / str(base["run"]), file, base, targets)
    axis, plant, words = _machine(base, "track")
    model, structure, delay_s = plant.model, offline.THESIS_STRUCTURE, plant.setpoint_delay_s
    move = load_move(file, structure.period_s, axis) if file else offline_move(axis, model, structure.period_s)
    if "gains" in base:
        cascade = _gains(base["gains"])
        words += ", the gains of the file"
    else:
        ends = axis.travel.ends_m
        _, cascade = analyse.design(
            model, structure, positions_m=ends, masses_kg=[model["cart.mass"]], dead_time_s=delay_s, apparent_damping_nm_s_rad=0.0
        )
        words += ", a design for its nominal values"
    peak = float(plant.motor.get("peak_torque_nm") or axis.motor.peak_torque_nm or axis.torque_limit_nm)  # as of the drive of a run
    loop = Loop(structure, delay_s, peak, plant.counts_per_rev)
    return _ground_with(SharedInput(model, cascade, loop, move, None, 0.0, analyse.design_plants, targets, _travel_m(axis))), words


def _ground_of_run(run: Path, file: Path | None, base: Mapping[str, Any], targets: Targets) -> tuple[SharedInput, str]:
    for key in ("axis", "gains"):
        if key in base:
            raise UsageError(f"base.{key} stands beside base.run, which has its own; leave it out")
    folder = RunFolder.open(run)
    saved = saved_design(folder)
    model = offline.design_model(folder, saved)
    if model.side != "motor" or not folder.axis.has_transmission:
        raise UsageError(f"base.run {run} is an axis without a belt, or one in ampere; a move cannot be predicted on it")
    structure = offline.structure_of(folder)
    cascade, delay_s = offline.cascade_of(saved, model, structure)
    move = move_of(folder, structure.period_s, file)
    along = None
    if saved.get("compensated") and structure.torque_feedforward:
        along = compensation(model, cascade.feedforward, with_dwell(move, REST_S), structure.period_s)
    peak = float((folder.load_result("drive") or {}).get("peak_torque_nm") or folder.axis.torque_limit_nm)
    apparent = float(saved.get("apparent_damping_nm_s_rad") or 0.0)
    loop = Loop(structure, delay_s, peak, offline.counts_of(folder))
    ground = SharedInput(model, cascade, loop, move, along, apparent, analyse.design_plants, targets, _travel_m(folder.axis))
    return _ground_with(ground), f"model and design of {run}"


def _ground_with(ground: SharedInput) -> SharedInput:
    """With the rest at the end of the move in which the static error is read."""
    return replace(ground, move=with_dwell(ground.move, REST_S))


def _travel_m(axis: Axis) -> tuple[float, float]:
    low, high = axis.travel.min_m, axis.travel.max_m
    return -math.inf if low is None else low, math.inf if high is None else high


def _machine(base: Mapping[str, Any], each: str) -> tuple[Axis, PlantFile, str]:
    if "run" in base:
        raise UsageError(
            f"each: {each} needs a virtual machine; give base.plant and base.axis in place of base.run, or base.runs for a fleet"
        )
    if "axis" not in base:
        raise UsageError("base.axis is missing; name the axis file that belongs to the plant, such as egc-70-600")
    return load_axis(str(base["axis"])), load_plant(str(base["plant"])), f"plant {base['plant']}, axis {base['axis']}"


def _gains(told: Any) -> Cascade:
    if not isinstance(told, dict):
        raise UsageError(f"base.gains is {told!r}; write the names of designs/final.yaml with their values, such as kpp_1_s: 15")
    try:
        return parameters_to_cascade({str(key): float(value) for key, value in told.items()})
    except (TypeError, ValueError) as error:
        raise UsageError(f"base.gains: {error}; every gain is a number") from error


def _run_fingerprint(run: Path) -> str:
    """Of what a run holds that a diagnosis rests on: its axis, models, and which records of which size."""
    try:
        texts = [(p.name, read_text(p)) for p in [run / "axis.yaml", *sorted(run.glob("models/*.yaml"))] if p.is_file()]
        sizes = [(p.name, p.stat().st_size) for p in sorted(run.glob("recordings/*"))]
    except (OSError, DataError):
        return ""  # the member itself says what is wrong with it
    return _digest([texts, sizes])


def _digest(value: Any) -> str:
    return digest_of(jsonable(value))[:16]


def _known(given: Any, known: tuple[str, ...], where: str) -> None:
    if not isinstance(given, Mapping):
        raise UsageError(f"{where} is {given!r}; it must be a mapping of names to values")
    for name in given:
        if name not in known:
            raise UsageError(f"{where} has no entry {name}{did_you_mean(str(name), known)}; it has {', '.join(known)}")


def _whole(data: Mapping[str, Any], name: str, usual: int, least: int) -> int:
    value = data.get(name, usual)
    if not isinstance(value, int) or isinstance(value, bool) or value < least:
        raise UsageError(f"{name} is {value!r}; give a whole number from {least} on")
    return value


def _target(told: Mapping[str, Any], name: str, usual: float) -> float:
    value = parse_quantity(str(told[name]), f"{name}_m") if name in told else usual
    if not value > 0.0:
        raise UsageError(f"targets.{name} is {told[name]!r}; it must be above 0")
    return value
