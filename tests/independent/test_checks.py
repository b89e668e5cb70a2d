"""The virtual drive before a master that shares no code with either end: a small sample of the rounds."""

from __future__ import annotations

import numpy as np
import pytest

from beltcomm.configfiles import config_names
from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.device import VirtualDrive
from beltcomm.virtual.faults import Faults
from independent import checks
from independent.checks import CHECKS
from independent.master import Master, crc_ccitt
from independent.rounds import LISTED, rounds
from virtual.host import RigidPlant

SLAVES = config_names("slaves")


def drawn(seed: int) -> list[str]:
    return [str(name) for name in np.random.default_rng(seed).choice(SLAVES, 3, replace=False)]


@pytest.mark.parametrize("name", ["reference", "cmmp-as", *drawn(38)])
def test_nothing_deviates_but_what_is_listed(name: str) -> None:
    assert set(rounds(name, seed=38)) <= LISTED.get(name, set())


def test_the_check_sum_is_that_of_the_standard() -> None:
    assert crc_ccitt(b"123456789") == 0x31C3


@pytest.mark.parametrize(
    ("faults", "check", "finds"),
    [
        (Faults(ignore_sync=frozenset(range(1, 20))), "mappings", "PDOs with SYNC"),
        (Faults(sdo_silent=frozenset({3})), "addresses", "Silence"),
        (Faults(misread={(0x1000, 0): 0x12}, sdo_abort={2: 0x06010000}), "addresses", "Refusal"),
        (Faults(local_control=True), "machine", "not ready"),
        (Faults(refused_modes=frozenset({3})), "modes", "mode 3 is offered"),
    ],
)
def test_a_drive_that_deviates_is_found(faults: Faults, check: str, finds: str) -> None:
    bus = LockstepBus()
    VirtualDrive(bus, RigidPlant(), "reference", faults=faults)
    master = Master(bus)
    master.wait(0.1)
    try:
        found = CHECKS[check](master, np.random.default_rng(1))
    except Exception as error:
        found = [repr(error)]
    assert any(finds in text for text in found), found


def test_an_abort_for_another_object_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = LockstepBus()
    drive = VirtualDrive(bus, RigidPlant(), "reference")
    master = Master(bus)
    master.wait(0.1)
    answer = drive._sdo.answer
    monkeypatch.setattr(drive._sdo, "answer", lambda request: [a[:1] + bytes(3) + a[4:] if a[0] == 0x80 else a for a in answer(request)])
    assert any("the abort names 0000h" in text for text in checks.addresses(master, np.random.default_rng(1)))
