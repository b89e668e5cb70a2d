"""A small sample of the table drive x verb; the whole is tests/benchmarks/foreign_drives.py."""

from __future__ import annotations

import numpy as np
import pytest

from slaves.bench import run_row

#: Those whose commissioning is refused before it costs time.
REFUSED = ("bare", "elmo-gold", "elmo-simpliq", "epos2", "faulhaber-mcbl")


def drawn(seed: int, among: tuple[str, ...], count: int) -> list[str]:
    return [str(name) for name in np.random.default_rng(seed).choice(among, count, replace=False)]


@pytest.mark.parametrize("slave", drawn(38, REFUSED, 3))
def test_what_cannot_be_commissioned_is_refused_before_motion_and_found_by_the_doctor(slave: str) -> None:
    doctor, commission = run_row(slave, ("doctor", "commission"))
    assert (doctor.state, commission.state) == ("refused", "refused"), (doctor.why, commission.why)
    assert commission.moved_s == 0.0
    assert not commission.powered


@pytest.mark.examination
@pytest.mark.parametrize("slave", drawn(38, ("epos4", "accelnet", "pd4-e"), 1))
def test_a_drive_whose_gains_nobody_knows_is_identified_and_survives_ctrl_c_and_a_dead_host(slave: str) -> None:
    cells = {cell.verb: cell for cell in run_row(slave, ("doctor", "identify", "Ctrl-C", "host lost"))}
    assert {verb: cell.state for verb, cell in cells.items() if cell.state == "RED"} == {}, cells
    assert cells["doctor"].state == cells["identify"].state == "done"
