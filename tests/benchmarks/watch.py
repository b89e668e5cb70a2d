"""A watch over production moves of the independent simulator: when a growing fault is noticed, and false alarms of healthy axes.

    python tests/benchmarks/watch.py run FILE FAULT SEED MOVES     one axis, a line of JSON: healthy, coulomb, belt, load, tight
    python tests/benchmarks/watch.py table FILE ...                all lines as a table

An axis is drawn, its session recorded and fitted; then it drives a cycle of moves over and over, drawn too.  Healthy is what goes on by
itself: friction that breathes with the temperature by up to 8 % in all.  A fault grows evenly from the hundredth move to the last one:
Coulomb friction by 70 %, stiffness of the belt by -30 %, load by 15 %, or a tight spot, 60 mm long, by 150 % of the
Coulomb friction.  Thresholds were set on seeds below 100.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from beltcomm.errors import DataError
from beltcomm.recording import Sidecar, recording_from_columns
from beltcomm.rundata.fitted_run import open_fitted
from beltcomm.talk import Silence
from beltcomm.watching.drift import AxisDrift
from beltcomm.watching.estimates import ERROR, MoveEstimate
from beltcomm.watching.judge import Judge
from beltcomm.watching.limits import LIMITS
from truth.hidden import Machine, draw, readings
from truth.hidden import layout as at
from truth.hidden.folder import write_session
from truth.hidden.session import Session, abilities
from truth.hidden.signals import Path as Motion

#: Growth from the first to the last move, moves before it begins, and moves of one cycle.
GROWTH = {"healthy": 0.0, "coulomb": 0.7, "belt": -0.3, "load": 0.15, "tight": 1.5}
BEGINS, CYCLE = 100, 6
BREATHES = 0.04


class Production:
    """Moves of a machine, each from rest to rest, with what has grown by then."""

    def __init__(self, machine: Machine, fault: str, moves: int) -> None:
        self.machine, self.fault, self.moves = machine, fault, moves
        self.session, self.healthy = Session(machine), machine.p.copy()
        rng = machine.rng(99)
        self.breath = rng.uniform(0.0, math.tau, 2), rng.uniform(120.0, 400.0)
        low, high = 0.1 * machine.base.stroke_m, 0.9 * machine.base.stroke_m
        ways = rng.uniform(low, high, CYCLE)
        able = abilities(machine)
        self.cycle = [(float(way), able.gentle_m_s * rng.uniform(0.5, 1.0), able.full_m_s2 * rng.uniform(0.3, 1.0)) for way in ways]
        self.session.place(self.cycle[-1][0])
        self.noise = machine.rng(98)

    def share(self, number: int) -> float:
        """Of the fault, 0 to 1."""
        return float(np.clip((number - BEGINS) / (self.moves - BEGINS), 0.0, 1.0))

    def move(self, number: int) -> dict[str, np.ndarray]:
        """Columns of move ``number``."""
        p, grown = self.machine.p, GROWTH[self.fault] * self.share(number)
        p[:] = self.healthy
        for place, phase in zip((at.COULOMB, at.VISCOUS), self.breath[0], strict=True):
            p[place] *= 1.0 + BREATHES * math.sin(math.tau * number / self.breath[1] + phase) - BREATHES * math.sin(phase)
        if self.fault == "coulomb":
            p[at.COULOMB] *= 1.0 + grown
        elif self.fault == "belt":
            p[[at.K1, at.K2, at.K3]] *= 1.0 + grown
        elif self.fault == "load":
            p[at.M] *= 1.0 + grown
        elif self.fault == "tight":
            p[at.TIGHT], p[at.TIGHT_FLANK] = grown * self.machine.base.coulomb_nm, 0.01
            p[at.TIGHT_PLACE], p[at.TIGHT_WIDTH] = 0.5 * self.machine.base.stroke_m, 0.03
        way, speed, acceleration = self.cycle[number % CYCLE]
        path = Motion(float(self.session.state[at.ANGLE] * self.machine.base.radius_m), self.machine.instruments.period_s)
        made = self.session.follow(path.rest(0.1).move(way, speed, acceleration).rest(0.25).reference(), self.session._tracking)
        position, setpoint, torque = made[0], made[1], made[2]
        instruments, base = self.machine.instruments, self.machine.base
        noise = readings.coloured(self.noise, len(torque), base.torque_noise_nm, instruments.noise_colour)
        read = readings.torque_reading(torque, noise, instruments, base.rated_torque_nm)
        t_s = instruments.period_s * np.arange(len(torque))
        return {"t_s": t_s, "torque_nm": read, "torque_setpoint_nm": setpoint, "position_rad": position}


def one(fault: str, seed: int, moves: int) -> dict[str, Any]:
    """One axis."""
    machine = draw(seed, (), 1.0, "rig" if seed % 2 else "sheet")
    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        write_session(machine, run, "default")
        judge = Judge(open_fitted(run, Silence()))
        fitted_s = time.process_time() - began
        drift = AxisDrift({**judge.reference, ERROR: MoveEstimate(judge.ratio, 0.0)}, LIMITS, judge.width_m)
        production = Production(machine, fault, moves)
        first: dict[str, dict[str, int]] = {"changed": {}, "alarm": {}}
        worst: dict[str, float] = {}
        states: dict[str, str] = {}
        turns = left_out = 0
        for number in range(moves):
            columns = production.move(number)
            start = float(columns["position_rad"][0]) * machine.base.radius_m
            sidecar = Sidecar(experiment="trajectory", closed_loop=True, start_position_m=start)
            try:
                judged = judge.judge(recording_from_columns(f"move_{number}", columns, sidecar, judge.axis))
            except DataError:  # as a watch does with a move that tells nothing
                left_out += 1
                continue
            standings = drift.add(judged)
            for it in standings:
                if it.state in first:
                    first[it.state].setdefault(it.key, number)
                    turns += states.get(it.key) != it.state
                states[it.key] = it.state
                if math.isfinite(it.value):
                    sure = abs(it.value - it.against.value) / (math.hypot(it.interval, it.against.interval) / 1.96)
                    worst[it.key] = max(worst.get(it.key, 0.0), sure)
                    worst[f"{it.key} %"] = max(worst.get(f"{it.key} %", 0.0), 100.0 * abs(it.change))
        last = {it.key: round(100.0 * it.change, 2) for it in standings}
    return {
        "fault": fault,
        "seed": seed,
        "family": machine.base.family,
        "moves": moves,
        "noticed": first["changed"],
        "alarm": first["alarm"],
        "turns": turns,
        "left_out": left_out,
        "furthest": {key: round(value, 2) for key, value in worst.items()},
        "last": last,
        "ratio": round(judge.ratio, 3),
        "fit_s": round(fitted_s, 1),
        "cpu_s": round(time.process_time() - began, 1),
    }


def grown(line: dict[str, Any], number: int | None) -> str:
    """A move and what had grown by then."""
    if number is None:
        return "-"
    share = np.clip((number - BEGINS) / (line["moves"] - BEGINS), 0.0, 1.0)
    return f"{number} ({100.0 * GROWTH[line['fault']] * share:+.1f} %)"


#: Quantity that a fault shows in.
SHOWS = {"coulomb": "coulomb_total", "belt": "belt_stiffness.stiffness", "load": "cart.mass", "tight": "friction_at_place"}


def table(files: list[str]) -> None:
    """All lines."""
    print(f"{'fault':8} {'seed':>5} {'family':7} {'moves':>6} {'noticed at':>16} {'alarm at':>16}   else noticed, else alarmed")
    for file in files:
        for text in Path(file).read_text(encoding="utf-8").splitlines():
            line = json.loads(text)
            own = SHOWS.get(line["fault"], "")
            noticed, alarm = {**line["alarm"], **line["noticed"]}, line["alarm"]
            rest = ({k: v for k, v in which.items() if k != own} for which in (line["noticed"], alarm))
            print(
                f"{line['fault']:8} {line['seed']:5d} {line['family']:7} {line['moves']:6d} {grown(line, noticed.get(own)):>16} "
                f"{grown(line, alarm.get(own)):>16}   {' '.join(map(str, rest))}"
            )


if __name__ == "__main__":
    if sys.argv[1] == "run":
        with open(sys.argv[2], "a", encoding="utf-8") as file:
            file.write(json.dumps(one(sys.argv[3], int(sys.argv[4]), int(sys.argv[5]))) + "\n")
    else:
        table(sys.argv[2:])
