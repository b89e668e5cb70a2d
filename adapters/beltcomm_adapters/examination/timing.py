"""SYNC and its answers for a second, with the stage off: cycles lost, jitter.  Only when it is asked for: it maps two transmit PDOs."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Final

from beltcomm.drive.finding import Finding
from beltcomm_adapters.busload import shortest_period_s
from beltcomm_adapters.examination.patient import OFF, Check, Patient
from beltcomm_adapters.exchange import Exchange
from beltcomm_adapters.identification import supported_modes, sync_period_s, sync_steps
from beltcomm_adapters.link import NMT_START

AREA: Final = "timing"
_TEST_S: Final = 1.0
_OPERATIONAL, _PRE_OPERATIONAL = 0x05, 0x7F
#: Share of lost cycles from which records suffer; four in a row end one.
_MANY: Final = 0.01
_JITTER_SHARE: Final = 0.25  # of a period: beyond it the regression drops the sample


def _sync(patient: Patient) -> Iterator[Finding]:
    """Every SYNC must be answered once, in its own period."""
    if reason := _why_not(patient):
        yield Finding(AREA, "sync", "unknown", f"SYNC was not tried: {reason}")
        return
    if not patient.sync_test:
        yield Finding(
            AREA, "sync", "unknown", "SYNC was not tried, because that maps two transmit PDOs for a second",
            "`--sync-test` does it, with the stage off, and puts everything back",
        )  # fmt: skip
        return
    objects, link = patient.objects, patient.link
    stored_s = sync_period_s(objects) if patient.profile.sync_change == "after_reset" else None
    period_s = stored_s or shortest_period_s(
        patient.profile, supported_modes(objects, patient.profile), patient.bitrate, sync_steps(objects, patient.profile)
    )
    stamps: list[float | None] = []
    with objects.lend() as lending:
        exchange = Exchange(link, objects, lending, period_s, (), torque=patient.profile.mapped_torque)
        exchange.start()
        try:
            for _ in range(round(_TEST_S / period_s)):
                sample = exchange.cycle(())
                stamps.append(None if sample is None else sample.stamp_s)
        finally:
            exchange.end()
            if patient.nmt == _OPERATIONAL:
                link.send_nmt(NMT_START)
    gaps = [later - earlier for earlier, later in pairwise(stamps) if earlier is not None and later is not None]
    jitter_s = max((abs(gap - period_s) for gap in gaps), default=0.0)
    count, lost = len(stamps), exchange.lost
    values = {"period_s": period_s, "cycles": count, "lost": lost, "worst_jitter_s": jitter_s}
    text = f"{count} SYNCs at {1e3 * period_s:g} ms: {lost} not answered in time, worst period error {1e6 * jitter_s:.0f} us"
    if lost == count:
        remedy = "look at the drive's PDO settings with the maker's tool; is CiA 402 the data profile?"
        yield Finding(AREA, "sync", "wrong", f"{text}: the drive does not answer SYNC", remedy, values)
    elif lost > _MANY * count:
        remedy = "close other programs, use a SocketCAN adapter in place of a serial one, or a longer period"
        yield Finding(AREA, "sync", "wrong", f"{text}: too many for a record", remedy, values)
    elif lost or jitter_s > _JITTER_SHARE * period_s:
        yield Finding(AREA, "sync", "warning", text, "records drop such samples; close other programs", values)
    else:
        yield Finding(AREA, "sync", "ok", text, "", values)


def _why_not(patient: Patient) -> str:
    """Reason that forbids SYNC here, in words."""
    if patient.state not in OFF:
        return "the power stage is not off"
    if patient.others:
        return "other nodes on the bus would hear it too"
    if patient.nmt not in (_OPERATIONAL, _PRE_OPERATIONAL):
        return "the node's NMT state is not known, so it could not be put back"
    return ""


CHECKS: Final = (Check(AREA, "sync", _sync),)
