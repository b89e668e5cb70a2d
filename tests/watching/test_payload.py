"""Moves with a payload that the run did not have: what they tell of the belt is what moves without it tell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from beltcomm.errors import DataError
from beltcomm.recording import Sidecar, recording_from_columns
from beltcomm.rundata.fitted_run import open_fitted
from beltcomm.talk import Silence
from beltcomm.watching.judge import Judge
from truth.hidden import draw
from truth.hidden import layout as at
from truth.hidden.folder import write_session
from truth.hidden.session import Session
from truth.hidden.signals import Path as Motion

#: Ways, m, speeds and accelerations of a cycle, every other move with a quarter more load; cycles.
CYCLE = (
    (0.377, 0.96, 10.9),
    (0.382, 1.1, 6.6),
    (0.311, 0.92, 4.3),
    (0.19, 1.4, 4.7),
    (0.109, 1.23, 10.4),
    (0.158, 0.63, 4.9),
    (0.481, 0.72, 5.9),
    (0.122, 1.45, 10.1),
)
HEAVIER, CYCLES = 1.21, 12


@pytest.mark.examination
def test_a_payload_on_some_moves_is_no_other_belt(tmp_path: Path) -> None:
    """A fit that finds the load took the belt for as much stiffer: as many rings in a move, a fifth off, with 1 % of interval."""
    machine = draw(301, (), 1.0, "rig")
    write_session(machine, tmp_path / "run", "default")
    judge = Judge(open_fitted(tmp_path / "run", Silence()))
    session, bare = Session(machine), machine.p[at.M]
    session.place(CYCLE[-1][0])
    found: dict[bool, list[tuple[float, float]]] = {False: [], True: []}
    for number in range(CYCLES * len(CYCLE)):
        way, speed, acceleration = CYCLE[number % len(CYCLE)]
        loaded = bool(number % len(CYCLE) % 2)
        machine.p[at.M] = bare * (HEAVIER if loaded else 1.0)
        path = Motion(float(session.state[at.ANGLE] * machine.base.radius_m), machine.instruments.period_s)
        position, setpoint, torque, *_ = session.follow(
            path.rest(0.1).move(way, speed, acceleration).rest(0.25).reference(), session._tracking
        )
        columns = {"t_s": 1e-3 * np.arange(len(torque)), "torque_nm": torque, "torque_setpoint_nm": setpoint, "position_rad": position}
        start = Sidecar(experiment="trajectory", closed_loop=True, start_position_m=float(position[0]) * machine.base.radius_m)
        try:
            told = judge.judge(recording_from_columns(f"move_{number}", columns, start, judge.axis)).quantities
        except DataError:
            continue
        if "belt_stiffness.stiffness" in told and number >= len(CYCLE):  # by then each move was driven before
            belt = told["belt_stiffness.stiffness"]
            found[loaded].append((belt.value / machine.base.stiffness_n_m, belt.interval / machine.base.stiffness_n_m))
    for pairs in found.values():
        shares, intervals = np.array(pairs).T
        assert len(shares) >= 10
        assert np.sum(shares / intervals**2) / np.sum(1.0 / intervals**2) == pytest.approx(1.0, abs=0.03)  # as a watch takes them together
