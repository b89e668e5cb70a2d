"""What records borrow from a drive beside its parameters is known before the first of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from beltcomm.drive import Motion
from beltcomm_adapters.sdo import Lending
from contract.conftest import open_virtual
from contract.test_drive import stroke


@pytest.mark.parametrize("profile", ["reference", "cmmp-as"])
@pytest.mark.parametrize("name", ["virtual", "serial:virtual"])
def test_whatever_a_record_borrows_was_read_before(profile, name, monkeypatch):
    """Then the backup and the note of a killed session hold it."""
    machine = open_virtual(profile, name=name)
    with machine.drive as drive:
        before = {item.place for item in drive.objects()}
        borrowed: set[tuple[int, int]] = set()
        give_back = Lending.give_back

        def noted(lending: Lending) -> list[str]:
            borrowed.update((index, subindex) for index, subindex, *_ in lending.lent())
            return give_back(lending)

        monkeypatch.setattr(Lending, "give_back", noted)
        at_rest = np.zeros(100)
        here = np.full(100, drive.read(["position_rad"])["position_rad"])
        limits = replace(machine.limits, deceleration_rad_s2=500.0, lag_rad=5.0)
        for kind in sorted(drive.capabilities.kinds):
            motion = stroke(machine, 1.0, 0.5) if kind == "profile" else Motion(kind, machine.period_s, here, at_rest, at_rest)
            drive.record(motion, limits, lambda row: None)
    assert {(0x6085, 0), (0x607D, 1)} <= borrowed
    # which objects its PDOs carry is not among them: it is volatile, and comes back with the next reset of the communication
    assert {place for place in borrowed if not 0x1400 <= place[0] < 0x1C00} <= before
