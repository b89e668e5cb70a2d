"""Checks of the node that answers: identity and profile, NMT state, and how fast questions are answered."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from statistics import median
from typing import Final

import can

from beltcomm.drive.finding import Finding, Values
from beltcomm_adapters.examination.patient import Check, Patient
from beltcomm_adapters.examination.wire import listen, state_name

AREA: Final = "node"
_SERVO_PROFILE: Final = 402
_GUARD_WAIT_S: Final = 0.1
_READS: Final = 50
#: s: a drive that needs longer slows every write and read; one that takes a whole time-out has lost a frame.
_SLOW_S, _LOST_S = 0.05, 0.3


def _identity(patient: Patient) -> Iterator[Finding]:
    """1000h, 1008h, 1018h, and the profile they lead to."""
    one, profile = patient.identity, patient.profile
    kind = int(one["device_type"].rstrip("h"), 16) & 0xFFFF
    name = one.get("device_name", "a drive without a name")
    who = f"node {patient.link.node} is {name} (vendor {one.get('vendor_id', '?')}, firmware {one.get('firmware', '?')})"
    if kind != _SERVO_PROFILE:
        text = f"{who}, but its device type 1000h = {one['device_type']} names the device profile {kind}, not {_SERVO_PROFILE} (CiA 402)"
        yield Finding(
            AREA, "identity", "wrong", text, "choose the drive's node with --node, or set the drive to its CiA 402 data profile", one
        )
    else:
        yield Finding(AREA, "identity", "ok", who, "", one)
    sure = Counter(entry["confidence"] for entry in profile.sources.values())
    known = ", ".join(f"{sure[word]} {word}" for word in ("read", "simulated", "inferred", "recalled", "unknown") if sure[word])
    values: Values = {"profile": profile.name, **{f"facts_{word}": count for word, count in sure.items()}}
    text = f"profile {profile.name} ({profile.title}); its facts: {known}"
    if profile.match is None:
        yield Finding(AREA, "profile", "ok", f"{text}; asked for by name, not recognised", "", values)
    elif not profile.match:
        remedy = (
            "records and moves are possible, gains are typed in by hand; --profile NAME chooses one (`beltcomm drives` lists them), "
            "`beltcomm drives --new my.yaml --drive D ` begins one"
        )
        yield Finding(AREA, "profile", "warning", f"no profile of its own fits this drive, so {text}", remedy, values)
    else:
        yield Finding(AREA, "profile", "ok", text, "", values)
    if patient.others:
        found = ", ".join(map(str, patient.others))
        text = f"further nodes answer on this bus: {found}"
        yield Finding(
            AREA, "others", "warning", text, "SYNC reaches them too: nothing they drive may be enabled meanwhile", {"nodes": found}
        )


def _nmt(patient: Patient) -> Iterator[Finding]:
    """NMT state: from heartbeats, else from node guarding where asking arms nothing."""
    objects, link = patient.objects, patient.link
    heartbeat_ms = objects.read_if_there(0x1017, 0, "uint16") or 0
    life_ms = (objects.read_if_there(0x100C, 0, "uint16") or 0) * (objects.read_if_there(0x100D, 0, "uint8") or 0)
    if patient.nmt is None and heartbeat_ms:
        patient.nmt = listen(link.bus, link.clock, 2e-3 * heartbeat_ms).nmt.get(link.node)
    if patient.rtr and not heartbeat_ms and not life_ms:
        link.send(can.Message(arbitration_id=0x700 + link.node, is_remote_frame=True, dlc=1, is_extended_id=False))
        told = listen(link.bus, link.clock, _GUARD_WAIT_S).nmt.get(link.node)
        patient.guarded = told is not None
        patient.nmt = patient.nmt if told is None else told
    if patient.nmt is None:
        yield Finding(AREA, "nmt", "unknown", "the node tells its NMT state neither by heartbeat nor by node guarding")
    else:
        values = {"state": patient.nmt, "heartbeat_ms": heartbeat_ms}
        yield Finding(AREA, "nmt", "ok", f"NMT state {state_name(patient.nmt)}", "", values)


def _answering(patient: Patient) -> Iterator[Finding]:
    """Round trip of 50 reads of 6041h."""
    clock = patient.link.clock
    times = []
    for _ in range(_READS):
        begun_s = clock.now()
        patient.objects.read_bytes(0x6041)
        times.append(clock.now() - begun_s)
    typical, longest = median(times), max(times)
    lost = sum(time >= _LOST_S for time in times)
    values = {"median_s": typical, "longest_s": longest, "lost": lost, "reads": _READS}
    text = f"{_READS} reads were answered in {1e3 * typical:.1f} ms (median), {1e3 * longest:.1f} ms at most"
    if lost:
        remedy = "check cable and terminators; another program must not talk to the same drive"
        yield Finding(AREA, "answers", "warning", f"{text}; {lost} only after the question was repeated", remedy, values)
    elif typical > _SLOW_S:
        yield Finding(AREA, "answers", "warning", text, "a slow adapter or a busy drive; records at short periods may lose cycles", values)
    else:
        yield Finding(AREA, "answers", "ok", text, "", values)


CHECKS: Final = (Check(AREA, "identity", _identity), Check(AREA, "nmt", _nmt), Check(AREA, "answers", _answering))
