"""Gains in the drive of a run as its moves with a led reference have shown them: ``results/led_gains.yaml``."""

from __future__ import annotations

from beltcomm.control import Cascade
from beltcomm.identify.led_gains import GainFactors
from beltcomm.runfolder import RunFolder

RESULT = "led_gains"


def known(folder: RunFolder) -> GainFactors | None:
    """The factors that a run knows; None where it knows none.   Raises DataError for a damaged file."""
    data = folder.load_result(RESULT)
    return None if data is None else GainFactors(*(data[name] for name in ("kp", "kpp", "kp_interval", "kpp_interval")))


def keep(folder: RunFolder, found: GainFactors) -> None:
    """Keep what a move has shown, unless an earlier one knows it better."""
    before = known(folder)
    if before is None or found.kpp_interval <= before.kpp_interval:
        folder.save("results", RESULT, found.to_dict())
        folder.journal(
            f"by its move with a led reference the drive's K_P is {found.kp:.4f} ± {found.kp_interval:.4f} times what it is taken for, "
            f"K_PP {found.kpp:.4f} ± {found.kpp_interval:.4f} times"
        )


def as_in_drive(folder: RunFolder, cascade: Cascade) -> Cascade:
    """A controller as the run knows that it really runs in the drive."""
    factors = known(folder)
    return cascade if factors is None else factors.of(cascade)
