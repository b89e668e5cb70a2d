"""A watch over production moves of the independent simulator: when a growing fault is noticed, and false alarms of healthy axes.

    python tests/benchmarks/watch.py run FOLDER SEED MOVES [FAULT ...]   one axis: what each move told, a file for each fault
    python tests/benchmarks/watch.py table FOLDER ...                    what a watch makes of that, with 95 % intervals

An axis is drawn, its session recorded and fitted; then it drives a cycle of four to ten moves over and over, drawn too: empty, with a
constant gripper that the run did not have, or with a payload on every other move of the cycle.  Healthy is what goes on by itself: friction
that breathes with the temperature by up to 8 % in all.  A fault begins at a move drawn from the second tenth to the fourth, and grows
evenly, faster and faster, or within a twentieth of the moves, to a size drawn for it: Coulomb friction, viscous friction, stiffness of the
belt, load, or a tight spot whose length is drawn and whose place on the way of the moves.  All by seed and fault.  Thresholds were set on
seeds below 100 and 401 to 403.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
import time
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from scipy.special import stdtrit
from scipy.stats import beta

from beltcomm.errors import DataError
from beltcomm.recording import Sidecar, recording_from_columns
from beltcomm.rundata.fitted_run import Opened, open_fitted
from beltcomm.sentences.watch import untold_sentence
from beltcomm.talk import Silence
from beltcomm.watching.drift import AxisDrift
from beltcomm.watching.estimates import ERROR, MoveEstimate
from beltcomm.watching.judge import Judge
from beltcomm.watching.limits import LIMITS
from beltcomm.watching.places import PLACE, untold_by
from truth.hidden import Machine, draw, readings
from truth.hidden import layout as at
from truth.hidden.folder import write_session
from truth.hidden.session import Session, abilities
from truth.hidden.signals import Path as Motion

#: Share by which each fault has grown by the last move, lowest and highest; of a tight spot in shares of the Coulomb friction.
GROWTH = {
    "healthy": (0.0, 0.0),
    "coulomb": (0.6, 1.2),
    "viscous": (1.2, 2.5),
    "tight": (0.8, 2.5),
    "belt": (-0.25, -0.4),
    "load": (0.12, 0.25),
}
#: m, half the length of a tight spot; shares of the carriage that a payload weighs; courses of the growth.
HALF_LENGTH_M, GRIPPER, PAYLOAD = (0.015, 0.05), (0.02, 0.08), (0.08, 0.3)
COURSES = ("even", "faster", "step")
BREATHES = 0.04


class Production:
    """Moves of a machine, each from rest to rest, with what has grown by then."""

    def __init__(self, machine: Machine, fault: str, moves: int) -> None:
        self.machine, self.fault, self.moves = machine, fault, moves
        self.session, self.healthy = Session(machine), machine.p.copy()
        rng = np.random.default_rng((machine.seed, 99, zlib.crc32(fault.encode())))
        self.breath = rng.uniform(0.0, math.tau, 2), rng.uniform(120.0, 400.0)
        stroke = machine.base.stroke_m
        ways = rng.uniform(0.1 * stroke, 0.9 * stroke, rng.integers(4, 11))
        able = abilities(machine)
        self.cycle = [(float(way), able.gentle_m_s * rng.uniform(0.4, 1.0), able.full_m_s2 * rng.uniform(0.2, 1.0)) for way in ways]
        self.begins, self.course = moves * rng.uniform(0.1, 0.4), str(rng.choice(COURSES))
        self.most = float(rng.uniform(*sorted(GROWTH[fault])))
        self.place_m, self.half_m = float(rng.uniform(ways.min(), ways.max())), float(rng.uniform(*HALF_LENGTH_M))
        self.carries = str(rng.choice(("nothing", "gripper", "payload")))
        self.payload = float(rng.uniform(*(PAYLOAD if self.carries == "payload" else GRIPPER))) * (self.carries != "nothing")
        self.session.place(self.cycle[-1][0])
        self.noise = machine.rng(98)

    def grown(self, number: int) -> float:
        """Of the fault by move ``number``."""
        share = float(np.clip((number - self.begins) / (self.moves - self.begins), 0.0, 1.0))
        return self.most * {"even": share, "faster": share**2, "step": min(1.0, 20.0 * share)}[self.course]

    def move(self, number: int) -> dict[str, np.ndarray]:
        """Columns of move ``number``."""
        p, base, grown = self.machine.p, self.machine.base, self.grown(number)
        p[:] = self.healthy
        for place, phase in zip((at.COULOMB, at.VISCOUS), self.breath[0], strict=True):
            p[place] *= 1.0 + BREATHES * math.sin(math.tau * number / self.breath[1] + phase) - BREATHES * math.sin(phase)
        if self.carries == "gripper" or (number % len(self.cycle)) % 2:
            p[at.M] += self.payload * self.healthy[at.M]
        if self.fault == "coulomb":
            p[at.COULOMB] *= 1.0 + grown
        elif self.fault == "viscous":
            p[[at.VISCOUS, at.DRAG]] *= 1.0 + grown
        elif self.fault == "belt":
            p[[at.K1, at.K2, at.K3]] *= 1.0 + grown
        elif self.fault == "load":
            p[at.M] += grown * self.healthy[at.M]
        elif self.fault == "tight" and grown > 0.0:
            p[at.TIGHT], p[at.TIGHT_FLANK] = grown * base.coulomb_nm, 0.01
            p[at.TIGHT_PLACE], p[at.TIGHT_WIDTH] = self.place_m, self.half_m
        way, speed, acceleration = self.cycle[number % len(self.cycle)]
        path = Motion(float(self.session.state[at.ANGLE] * base.radius_m), self.machine.instruments.period_s)
        made = self.session.follow(path.rest(0.1).move(way, speed, acceleration).rest(0.25).reference(), self.session._tracking)
        position, setpoint, torque = made[0], made[1], made[2]
        instruments = self.machine.instruments
        noise = readings.coloured(self.noise, len(torque), base.torque_noise_nm, instruments.noise_colour)
        read = readings.torque_reading(torque, noise, instruments, base.rated_torque_nm)
        t_s = instruments.period_s * np.arange(len(torque))
        return {"t_s": t_s, "torque_nm": read, "torque_setpoint_nm": setpoint, "position_rad": position}


def drawn(seed: int) -> Machine:
    """Axis of a seed, of one of three families."""
    return draw(seed, (), 1.0, ("sheet", "rig", "wide")[seed % 3])


def pairs(told: Mapping[Any, MoveEstimate]) -> dict[str, tuple[float, float]]:
    """Estimates for a file."""
    return {str(key): (one.value, one.interval) for key, one in told.items()}


def estimates(told: Mapping[str, Sequence[float]]) -> dict[str, MoveEstimate]:
    """Estimates of a file."""
    return {key: MoveEstimate(*one) for key, one in told.items()}


def one(opened: Opened, fault: str, seed: int, moves: int) -> dict[str, Any]:
    """What one production told."""
    machine, began = drawn(seed), time.process_time()
    judge, production = Judge(opened), Production(machine, fault, moves)
    told = []
    for number in range(moves):
        columns = production.move(number)
        position = columns["position_rad"] * machine.base.radius_m
        sidecar = Sidecar(experiment="trajectory", closed_loop=True, start_position_m=float(position[0]))
        try:
            judged = judge.judge(recording_from_columns(f"move_{number}", columns, sidecar, judge.axis))
        except DataError:  # as a watch does with a move that tells nothing
            continue
        error = {ERROR: MoveEstimate(judged.ratio, judged.ratio_interval)}
        told.append([number, production.grown(number), pairs(judged.quantities | error), pairs(judged.places)])
    return {
        "fault": fault,
        "seed": seed,
        "family": machine.base.family,
        "moves": moves,
        "begins": round(production.begins),
        "course": production.course,
        "most": production.most,
        "carries": production.carries,
        "payload": production.payload,
        "spot_m": [production.place_m, production.half_m],
        "way_m": [min(way for way, *_ in production.cycle), max(way for way, *_ in production.cycle)],
        "reference": pairs({**judge.reference, ERROR: MoveEstimate(judge.ratio, 0.0)}),
        "width_m": judge.width_m,
        "cpu_s": round(time.process_time() - began, 1),
        "told": told,
    }


def run(folder: Path, seed: int, moves: int, faults: list[str]) -> None:
    """All productions of one axis."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        write_session(drawn(seed), Path(place) / "run", "default")
        opened = open_fitted(Path(place) / "run", Silence())
        for fault in faults or list(GROWTH):
            (folder / f"{fault}-{seed}.json").write_text(json.dumps(one(opened, fault, seed, moves)), encoding="utf-8")


#: Quantity that a fault shows in.
SHOWS = {
    "healthy": "",
    "coulomb": "coulomb_total",
    "viscous": "viscous_total",
    "belt": "belt_stiffness.stiffness",
    "load": "cart.mass",
    "tight": "friction_at_place",
}


class Said(NamedTuple):
    """What a watch says of a production.

    Attributes
    ----------
    first : dict
        State -> quantity -> number of the move and what had grown by then.
    turns : int
        Changes of a state.
    place_m : float or None
        Where a tight spot was named first.
    untold : str
        What the moves do not show.
    """

    first: dict[str, dict[str, tuple[int, float]]]
    turns: int
    place_m: float | None
    untold: str


def said_of(made: Mapping[str, Any]) -> Said:
    """A watch over what the moves told."""
    drift = AxisDrift(estimates(made["reference"]), LIMITS, made["width_m"])
    first: dict[str, dict[str, tuple[int, float]]] = {"changed": {}, "alarm": {}}
    states: dict[str, str] = {}
    turns, place_m, standings = 0, None, []
    for number, grown, told, places in made["told"]:
        standings = drift.add_told(estimates(told), {int(key): one for key, one in estimates(places).items()})
        for it in standings:
            if it.state in first:
                if it.key == PLACE and place_m is None:
                    place_m = it.place_m
                first[it.state].setdefault(it.key, (number, grown))
                turns += states.get(it.key) != it.state
            states[it.key] = it.state
    return Said(first, turns, place_m, untold_sentence(untold_by(standings, tuple(made["way_m"]))))


def share(part: int, whole: int) -> str:
    """Share with its 95 % interval (Clopper and Pearson)."""
    low, high = (
        (0.0 if part == 0 else beta.ppf(0.025, part, whole - part + 1)),
        (1.0 if part == whole else beta.ppf(0.975, part + 1, whole - part)),
    )
    return f"{part} of {whole} ({100.0 * low:.0f} to {100.0 * high:.0f} %)"


def mean(values: Sequence[float]) -> str:
    """Mean with its 95 % interval (Student)."""
    if len(values) < 2:
        return " ".join(f"{value:+.0f}" for value in values)
    half = stdtrit(len(values) - 1, 0.975) * np.std(values, ddof=1) / math.sqrt(len(values))
    return f"{np.mean(values):+.0f} ± {half:.0f}"


def cell(which: Mapping[str, tuple[int, float]], key: str) -> str:
    """Move and growth by which a quantity was named."""
    return f"{which[key][0]} ({100.0 * which[key][1]:+.0f} %)" if key in which else "-"


def table(folders: list[str]) -> None:
    """Each production, and all of a fault together."""
    all_made = [json.loads(path.read_text(encoding="utf-8")) for folder in folders for path in sorted(Path(folder).glob("*.json"))]
    for fault, key in SHOWS.items():
        print(f"{fault}: seed, family, carries, course from move to size; noticed, alarm at move (grown %); else noticed *, alarmed !")
        found: dict[str, list[float]] = {"noticed": [], "alarm": []}
        others, here = 0, [one for one in all_made if one["fault"] == fault]
        for made in here:
            said = said_of(made)
            alarm, noticed = said.first["alarm"], {**said.first["alarm"], **said.first["changed"]}
            for name, which in (("noticed", noticed), ("alarm", alarm)):
                found[name] += [100.0 * which[key][1]] if key in which else []
            beside = [*(("*", *one) for one in said.first["changed"].items()), *(("!", *one) for one in alarm.items())]
            beside = [one for one in beside if one[1] != key]
            others += any(one[1] != "cart.mass" or made["carries"] == "nothing" for one in beside)
            spot = f" spot {made['spot_m'][0]:.2f} ± {made['spot_m'][1]:.2f} m, named {said.place_m}" if fault == "tight" else ""
            print(
                f"  {made['seed']} {made['family']:5} {made['carries']:7} {100.0 * made['payload']:3.0f} %, {made['course']:6} "
                f"{made['begins']:4d} {100.0 * made['most']:+5.0f} %{spot}: {cell(noticed, key)}, {cell(alarm, key)}; "
                f"{' '.join(f'{mark}{name} {at[0]}' for mark, name, at in beside)}; {len(made['told'])} told; {said.untold}"
            )
        if here and key:
            parts = [f"{name} {share(len(values), len(here))} at {mean(values)} %" for name, values in found.items()]
            print(f"  {', '.join(parts)}")
        if here:
            print(f"  something else noticed or alarmed, the load of a payload apart: {share(others, len(here))}")


if __name__ == "__main__":
    if sys.argv[1] == "run":
        run(Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]), sys.argv[5:])
    else:
        table(sys.argv[2:])
