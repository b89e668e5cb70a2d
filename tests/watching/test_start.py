"""A move tells of the belt what it tells from wherever its fit began."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from beltcomm.recording import Sidecar, recording_from_columns
from beltcomm.rundata.fitted_run import open_fitted
from beltcomm.talk import Silence
from beltcomm.watching.judge import Judge
from truth.hidden import draw
from truth.hidden import layout as at
from truth.hidden.folder import write_session
from truth.hidden.session import Session
from truth.hidden.signals import Path as Motion

BELT = "belt_stiffness.stiffness"
#: Ways, m, speeds and accelerations: the last move is looked at.
CYCLE = ((0.184008, 1.325368, 3.035989), (0.565588, 0.69816, 10.712891), (0.705791, 1.02495, 11.200778), (0.125101, 0.767883, 7.135324))


@pytest.mark.examination
def test_the_belt_that_a_move_tells_is_not_the_one_its_fit_began_from(tmp_path: Path) -> None:
    """In the noise of the belt that it began from it told that one to a tenth of the way."""
    machine = draw(501, (), 1.0, "sheet")
    write_session(machine, tmp_path / "run", "default")
    judge = Judge(open_fitted(tmp_path / "run", Silence()))
    session = Session(machine)
    session.place(0.1251)
    for way, speed, acceleration in CYCLE:
        path = Motion(float(session.state[at.ANGLE] * machine.base.radius_m), machine.instruments.period_s)
        made = session.follow(path.rest(0.1).move(way, speed, acceleration).rest(0.25).reference(), session._tracking)
    position, setpoint, torque = made[:3]
    columns = {"t_s": 1e-3 * np.arange(len(torque)), "torque_nm": torque, "torque_setpoint_nm": setpoint, "position_rad": position}
    start = Sidecar(experiment="trajectory", closed_loop=True, start_position_m=float(position[0]) * machine.base.radius_m)
    move = recording_from_columns("move", columns, start, judge.axis)
    begun = [judge.model.with_values({BELT: share * judge.model[BELT]}) for share in (0.97, 1.04, 1.08)]
    found = [judge._fit([move], model).model[BELT] / machine.base.stiffness_n_m for model in begun]
    assert np.ptp(found) < 0.02
    assert found == pytest.approx([1.0] * 3, abs=0.03)
