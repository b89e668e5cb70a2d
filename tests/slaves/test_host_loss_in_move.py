"""The host dies in a verification move: the axis stands inside its travel, and the belt carries no more than was planned for that.

The machine is the independent simulator's: prediction and truth share no plant.
"""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltcomm.drive import Drive
from campaign.judge import TRAVEL_M
from campaign.rig import STANDING_M_S, START_M
from slaves.bench import AXIS, SlaveRig
from truth.plant import TruthPlant
from truth.rigs import nominal

#: Shares of the move: out of its acceleration, at its top speed, in its braking.
SHARES = (0.05, 0.5, 0.9)
#: Ticks between positioning, for which the plan's limit of any move counts, and the move.
PAUSE = 200
#: The prediction is no guess far above what happens, either.
SHARPEST = 0.7


class Reporting(SlaveRig):
    """A drive whose following error only shows in its statusword, and whose profile does not say what it does."""

    def __init__(self, slave: str, **options: Any) -> None:
        super().__init__(slave, **options)
        loops = self.device._servo._loops
        loops.profile = replace(loops.profile, following_error_faults=False)

    def open(self, _name: str, options: Any = None) -> Drive:
        drive = super().open(_name, options)
        drive.capabilities = replace(drive.capabilities, following_error_stops=False)
        return drive


def rig_of_truth(kind: type[SlaveRig]) -> SlaveRig:
    return kind("reference", plant=TruthPlant(nominal("g_a").axis, truth=nominal("g_a").truth))


def verify(rig: SlaveRig, run: Path) -> int | None:
    place = f"{1e3 * START_M:.0f}mm"
    return rig.call("verify", "--drive", "virtual", "--run", str(run), "--yes", "--position", place).code


@pytest.mark.examination
@pytest.mark.parametrize("kind", [SlaveRig, Reporting])
def test_a_dead_host_loads_the_belt_no_more_than_planned(tmp_path: Path, kind: type[SlaveRig]) -> None:
    whole, rig = tmp_path / "run", rig_of_truth(kind)
    assert rig.call("commission", "--drive", "virtual", "--axis", AXIS, "--run", str(whole), "--yes", "--quick", "--no-report").code == 0
    rig.close()

    def driven(number: int, at: int | None) -> tuple[SlaveRig, Path]:
        run, rig = tmp_path / str(number), rig_of_truth(kind)
        shutil.copytree(whole, run)
        if at is None:
            assert verify(rig, run) == 0
        else:
            with rig.at(at * rig.bus.tick_s, "host lost"):
                verify(rig, run)
        rig.run_on(3.0)
        rig.close()
        return rig, run

    whole_move, _ = driven(0, None)
    speed = np.abs(np.array(whole_move.examiner.speed_m_s))
    fast = np.flatnonzero(speed > 0.3 * speed.max())
    begun = [fast[0], *fast[1:][np.diff(fast) > PAUSE]]
    assert len(begun) == 2, "positioning, and the move"
    found = []
    for number, share in enumerate((None, *SHARES), 1):
        at = int(begun[0] + PAUSE // 4 if share is None else begun[1] + share * (fast[-1] - begun[1]))
        rig, run = driven(number, at)
        place, watch = np.array(rig.examiner.place_m), rig.examiner
        place_of = "lost in it" if share is None else "lost in the move:"
        planned = [float(n) for n in re.findall(rf"{place_of} (\d+) N", (run / "journal.txt").read_text(encoding="utf-8"))]
        found.append((max(watch.belt_n[at:]), planned[-1]))
        assert np.abs(watch.speed_m_s[-50:]).max() < STANDING_M_S
        assert not watch.powered[-1]
        assert TRAVEL_M[0] <= place.min()
        assert place.max() <= TRAVEL_M[1]
    forces, planned_n = np.array(found).T
    assert np.all(forces <= planned_n)
    assert forces[1:].max() >= SHARPEST * planned_n[1:].max()
