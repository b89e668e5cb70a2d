"""Seeded cases: a command, a profile of the drive, a fault, and the instant at which it comes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from beltcomm.virtual.faults import FrameFault
from campaign.disk import Disk
from campaign.rig import Outcome, Rig

#: Words of each command; RUN stands for its run folder.  The long one goes on with a run that lacks its sweep and its last move.
COMMANDS: Mapping[str, tuple[str, ...]] = {
    "move": ("move", "--drive", "virtual", "--by", "5mm", "--yes"),
    "identify": ("identify", "--drive", "virtual", "--run", "RUN", "--yes"),
    "friction": ("friction", "--drive", "virtual", "--run", "RUN", "--yes"),
    "verify": ("verify", "--drive", "virtual", "--run", "RUN", "--yes"),
    "apply": ("apply", "--drive", "virtual", "--run", "RUN", "--yes", "--force"),
    "rollback": ("rollback", "--drive", "virtual", "--run", "RUN", "--yes"),
    "commission": ("commission", "--drive", "virtual", "--run", "RUN", "--yes", "--quick", "--resume", "--no-report"),
}
#: How often each is drawn: what it takes on the machine makes it seldom.
SHARES: Mapping[str, int] = {"move": 4, "identify": 5, "friction": 2, "verify": 5, "apply": 2, "rollback": 2, "commission": 1}
#: Commands that move the axis, and those that write files.
MOVING = ("move", "identify", "friction", "verify", "commission")
RECORDING = ("identify", "friction", "verify", "commission")
#: Error codes of CiA 301, table 26: one of each class.
EMERGENCIES = (
    *(0x1000, 0x2000, 0x2100, 0x2200, 0x2300, 0x2310, 0x3000, 0x3100, 0x3200, 0x3210, 0x3300, 0x4000, 0x4100, 0x4200, 0x4210, 0x4310),
    *(0x5000, 0x5410, 0x6000, 0x6100, 0x6180, 0x6200, 0x6300, 0x7000, 0x7380, 0x8000, 0x8100, 0x8110, 0x8120, 0x8130, 0x8140, 0x8150),
    *(0x8200, 0x8210, 0x8220, 0x8230, 0x8240, 0x8611, 0x8612, 0x9000, 0xF000, 0xFF00, 0xFF42),
)
#: Abort codes of CiA 301, table 22.
ABORTS = (
    *(0x05030000, 0x05040000, 0x05040001, 0x05040005, 0x06010000, 0x06010001, 0x06010002, 0x06020000, 0x06040041, 0x06040042, 0x06040043),
    *(0x06040047, 0x06060000, 0x06070010, 0x06070012, 0x06070013, 0x06090011, 0x06090030, 0x06090031, 0x06090032, 0x06090036, 0x08000000),
    *(0x08000020, 0x08000021, 0x08000022, 0x08000023, 0x08000024, 0xDEADBEEF),
)


@dataclass(frozen=True)
class Healthy:
    """What a command does when nothing is wrong: per tick since it began place, speed, whether the stage is on, transfers begun."""

    code: int
    place_m: Any
    speed_m_s: Any
    powered: Any
    transfers: int
    writes: int
    changes: int
    machine_s: float

    def instant_s(self, draw: np.random.Generator, moving: bool = False) -> float:
        """A time, uniform over the phases: a phase is a stretch with the stage on or off, but for those that are over in a tick.

        moving : one in which the carriage moves.
        """
        powered = np.asarray(self.powered, dtype=np.int8)
        if moving and bool((np.abs(self.speed_m_s) > 5e-3).any()):
            return float(draw.choice(np.flatnonzero(np.abs(self.speed_m_s) > 5e-3))) * 1e-3
        edges = [0, *(np.flatnonzero(np.diff(powered)) + 1).tolist(), len(powered)]
        phases = [(a, b) for a, b in pairwise(edges) if b > a]
        if not phases:
            return 0.0
        first, last = phases[int(draw.integers(len(phases)))]
        return float(draw.uniform(first, last)) * 1e-3


@dataclass(frozen=True)
class Case:
    """One of them.   at_s : since the command began.   dead : nothing reaches the drive any more from then on.   about : in words.

    normal : exit code of the command when nothing is wrong.
    """

    seed: int
    kind: str
    profile: str
    command: str
    about: str
    at_s: float
    faults: Mapping[str, Any] = field(default_factory=dict)
    bus_faults: Mapping[str, Any] = field(default_factory=dict)
    disk: tuple[bool, int] | None = None
    dead: bool = False
    normal: int = 0


@dataclass(frozen=True)
class Fault:
    """about, faults, bus_faults, disk, dead : as in :class:`Case`."""

    about: str
    faults: Mapping[str, Any] = field(default_factory=dict)
    bus_faults: Mapping[str, Any] = field(default_factory=dict)
    disk: tuple[bool, int] | None = None
    dead: bool = False


#: Kinds of frames with the way that they go.
_WAYS: tuple[tuple[tuple[str, ...], str], ...] = (
    *((("tpdo",), "to host"), (("rpdo",), "to node"), (("sync",), "to node"), (("sdo answer",), "to host"), (("sdo request",), "to node")),
    *((("life",), "to node"), (("life",), "to host"), (("nmt",), "to node"), ((), "to node"), ((), "to host"), ((), "both")),
)
Maker = Callable[[np.random.Generator, Healthy, float], Fault]


def _frames(what: Any) -> Maker:
    """A share of all frames or of one kind either way, or a few in a row."""

    def make(draw: np.random.Generator, _healthy: Healthy, at_s: float) -> Fault:
        kinds, direction = _WAYS[int(draw.integers(len(_WAYS)))]
        delay_s = float(draw.choice([0.001, 0.003, 0.01, 0.05]))
        named: dict[str, Any] = {"direction": direction, "delay_s": delay_s} | ({"kinds": frozenset(kinds)} if kinds else {})
        if draw.random() < 0.5:
            rate = float(draw.choice([0.001, 0.01, 0.1]))
            fault = FrameFault(what, rate=rate, **named)
            how = f"{100 * rate:g} % of"
        else:
            count = int(draw.choice([1, 2, 3, 10]))
            fault = FrameFault(what, numbers=frozenset(range(1, count + 1)), from_s=at_s, **named)
            how = f"{count} of"
        words = f"{how} {kinds[0] if kinds else 'all'} frames {direction}" + (f" by {1e3 * delay_s:g} ms" if what == "late" else "")
        return Fault(f"{what}: {words}", bus_faults={"frames": (fault,), "seed": int(draw.integers(2**31))})

    return make


def _bus_off(draw: np.random.Generator, _healthy: Healthy, at_s: float) -> Fault:
    if draw.random() < 0.5:
        return Fault("bus-off for good", bus_faults={"off_from_s": at_s}, dead=True)
    for_s = float(draw.choice([0.002, 0.02, 0.1, 0.5, 2.0]))
    return Fault(f"bus-off for {1e3 * for_s:g} ms", bus_faults={"off_from_s": at_s, "off_until_s": at_s + for_s})


def _cable(draw: np.random.Generator, _healthy: Healthy, at_s: float) -> Fault:
    way = int(draw.integers(3))
    if way == 0:
        return Fault("cable pulled at the drive", {"silent_from_s": at_s}, dead=True)
    if way == 1:
        return Fault("cable pulled at the host", bus_faults={"silent_from_s": at_s}, dead=True)
    for_s = float(draw.choice([0.002, 0.01, 0.1, 0.5, 2.0]))
    return Fault(f"cable loose for {1e3 * for_s:g} ms", bus_faults={"silent_from_s": at_s, "silent_until_s": at_s + for_s})


def _clock(draw: np.random.Generator, _healthy: Healthy, at_s: float) -> Fault:
    by_s = float(draw.choice([-10.0, -1.0, -0.02, 0.02, 1.0, 10.0]))
    stamps = bool(draw.random() < 0.5)
    what = "clock that stamps frames" if stamps else "host's clock"
    return Fault(f"{what} jumps by {by_s:+g} s", bus_faults={"clock_jump_at_s": at_s, "clock_jump_s": by_s, "stamps_only": stamps})


def _emergency(draw: np.random.Generator, _healthy: Healthy, at_s: float) -> Fault:
    code, effect = int(draw.choice(EMERGENCIES)), str(draw.choice(["off", "brake", "report"]))
    words = {"off": "fault, stage off", "brake": "fault, brakes", "report": "message only"}[effect]
    return Fault(f"EMCY {code:04X}h, {words}", {"emergency_at_s": at_s, "emergency_code": code, "emergency_effect": effect})


def _abort(draw: np.random.Generator, healthy: Healthy, _at_s: float) -> Fault:
    number, code = 1 + int(draw.integers(max(healthy.transfers, 1))), int(draw.choice(ABORTS))
    return Fault(f"SDO transfer {number} aborted, {code:08X}h", {"sdo_abort": {number: code}})


def _timeout(draw: np.random.Generator, healthy: Healthy, _at_s: float) -> Fault:
    number, times = 1 + int(draw.integers(max(healthy.transfers, 1))), int(draw.choice([1, 2, 3, 12, 60]))
    silent = frozenset(range(number, number + times))
    return Fault(f"SDO transfers {number} to {number + times - 1} not answered", {"sdo_silent": silent}, dead=times > 12)


def _scaling(draw: np.random.Generator, _healthy: Healthy, _at_s: float) -> Fault:
    factor = float(draw.choice([0.1, 0.5, 0.9, 1.1, 2.0, 10.0]))
    return Fault(f"6076h reads {factor:g} times the rated torque", {"rated_torque_nm": 1.43 * factor})


def _feed(_draw: np.random.Generator, _healthy: Healthy, _at_s: float) -> Fault:
    return Fault("the feed constant reads twice its value", {"misread": {(0x6092, 1): 2 * 65536, (0x6093, 1): 2}})


def _step(draw: np.random.Generator, _healthy: Healthy, at_s: float) -> Fault:
    counts = int(draw.choice([-20000, -3000, -300, -30, 30, 300, 3000, 20000]))
    return Fault(f"encoder jumps by {counts} counts", {"encoder_step_at_s": at_s, "encoder_step_counts": counts})


def _switch(draw: np.random.Generator, _healthy: Healthy, at_s: float) -> Fault:
    which = int(draw.integers(2))
    return Fault(f"{('lower', 'upper')[which]} end switch", {"end_switch_from_s": at_s, "end_switch": which})


def _weak(draw: np.random.Generator, _healthy: Healthy, at_s: float) -> Fault:
    share = float(draw.choice([0.0, 0.1, 0.5]))
    return Fault(f"only {100 * share:.0f} % of the torque acts", {"weak_from_s": at_s, "weak_share": share})


#: What somebody at a panel writes while the drive runs: objects, each with factor and summand, in words.
_REWRITTEN: tuple[tuple[str, dict[tuple[int, int], tuple[float, float]]], ...] = (
    ("mode 3", {(0x6060, 0): (0.0, 3.0)}),
    ("mode 1", {(0x6060, 0): (0.0, 1.0)}),
    ("no mode", {(0x6060, 0): (0.0, 0.0)}),
    ("half the torque limit", {(0x6072, 0): (0.5, 0.0)}),
    ("a tenth of the torque limit", {(0x6072, 0): (0.1, 0.0)}),
    ("a quick stop ten times as hard", {(0x6085, 0): (10.0, 0.0)}),
    ("a quick stop ten times as soft", {(0x6085, 0): (0.1, 0.0)}),
    ("no position limits", {(0x607D, 1): (0.0, 0.0), (0x607D, 2): (0.0, 0.0)}),
    ("twice the feed constant", {(0x6092, 1): (2.0, 0.0), (0x6093, 1): (2.0, 0.0)}),
    ("no following error", {(0x6065, 0): (0.0, float(0xFFFFFFFF))}),
    ("a following error of nothing", {(0x6065, 0): (0.0, 1.0), (0x6066, 0): (0.0, 0.0)}),
    ("gains a quarter", {(0x2100, 1): (0.25, 0.0), (0x60F9, 1): (0.25, 0.0)}),
    ("gains four times", {(0x2100, 1): (4.0, 0.0), (0x60F9, 1): (4.0, 0.0)}),
    ("no velocity feedforward", {(0x2100, 13): (0.0, 0.0)}),
    ("position gain four times", {(0x2100, 3): (4.0, 0.0), (0x60FB, 1): (4.0, 0.0)}),
)


def _rewritten(draw: np.random.Generator, _healthy: Healthy, at_s: float) -> Fault:
    words, objects = _REWRITTEN[int(draw.integers(len(_REWRITTEN)))]
    return Fault(f"somebody sets {words}", {"rewritten_at_s": at_s, "rewritten": objects})


def _full(draw: np.random.Generator, healthy: Healthy, _at_s: float) -> Fault:
    number = 1 + int(draw.integers(max(healthy.writes, 1)))
    return Fault(f"disk full at write {number}", disk=(True, number))


def _read_only(draw: np.random.Generator, healthy: Healthy, _at_s: float) -> Fault:
    number = 1 + int(draw.integers(max(healthy.changes, 1))) if draw.random() < 0.75 else 1
    return Fault(f"run folder read-only from change {number} on", disk=(False, number))


KINDS: Mapping[str, tuple[Maker, tuple[str, ...]]] = {
    "frames lost": (_frames("lost"), tuple(COMMANDS)),
    "frames late": (_frames("late"), tuple(COMMANDS)),
    "frames doubled": (_frames("doubled"), tuple(COMMANDS)),
    "frames reordered": (_frames("swapped"), tuple(COMMANDS)),
    "bus-off": (_bus_off, MOVING),
    "cable pulled": (_cable, MOVING),
    "node reset": (lambda _d, _h, at: Fault("node restarts", {"reset_at_s": at}), MOVING),
    "EMCY": (_emergency, MOVING),
    "SDO abort": (_abort, tuple(COMMANDS)),
    "SDO time-out": (_timeout, tuple(COMMANDS)),
    "wrong scaling": (_scaling, ("identify", "friction", "verify", "apply", "rollback", "commission")),
    # a creep of millimetres cannot tell it: there is no second sensor
    "feed constant doubled": (_feed, ("identify", "friction", "verify", "commission")),
    "sign inverted": (lambda _d, _h, _a: Fault("encoder counts backwards", {"encoder_sign": -1}), MOVING),
    "encoder step": (_step, MOVING),
    "axis stuck": (lambda _d, _h, at: Fault("axis blocked", {"stuck_from_s": at}), MOVING),
    "following error": (_weak, MOVING),
    "end switch": (_switch, MOVING),
    "over-temperature": (lambda _d, _h, at: Fault("motor gets too warm", {"warm_from_s": at}), MOVING),
    "host killed": (lambda _d, _h, at: Fault("host dies", bus_faults={"host_dies_at_s": at}, dead=True), MOVING),
    "clock jump": (_clock, MOVING),
    "disk full": (_full, RECORDING),
    "folder read-only": (_read_only, RECORDING),
}
#: Seeds of a drive that somebody else writes to while it runs begin here.
FIRST_REWRITTEN, REWRITTEN = 2_000_000, "drive rewritten"


def healthy_run(rig: Rig, words: tuple[str, ...], run: Any) -> tuple[Healthy, Outcome]:
    """A command with nothing wrong, counted."""
    first = rig.bus.tick
    disk = Disk(run, full=True)
    outcome = rig.call(*words, disk=disk)
    look = rig.examiner
    ticks = slice(1, None)
    return (
        Healthy(
            outcome.code if outcome.code is not None else -1,
            np.array(look.place_m)[ticks],
            np.array(look.speed_m_s)[ticks],
            np.array(look.powered)[ticks],
            look.begun,
            disk.writes,
            disk.changes,
            (rig.bus.tick - first) * 1e-3,
        ),
        outcome,
    )


def make_case(
    seed: int,
    healthy: Callable[[str, str], Healthy],
    kind: str | None = None,
    commands: tuple[str, ...] = tuple(COMMANDS),
    profiles: tuple[str, ...] = ("reference", "cmmp-as"),
) -> Case:
    """The case of a seed.   healthy : run of a command on a profile.   kind : None takes the seed's turn."""
    draw = np.random.default_rng(seed)
    kind = kind or (REWRITTEN if seed >= FIRST_REWRITTEN else list(KINDS)[seed % len(KINDS)])
    maker, possible = (_rewritten, MOVING) if kind == REWRITTEN else KINDS[kind]
    among = [name for name in possible if name in commands]
    shares = np.array([SHARES[name] for name in among], dtype=float)
    command = str(draw.choice(among, p=shares / shares.sum()))
    # on a drive without velocity feedforward a healthy sweep drifts off and is refused as unfit: there is nothing to disturb
    sweeping = next((name for name in profiles if name.startswith("reference")), profiles[0])
    profile = str(draw.choice(profiles)) if command != "friction" else sweeping
    normal = healthy(command, profile)
    at_s = normal.instant_s(draw, moving=bool(draw.random() < 0.5))
    fault = maker(draw, normal, at_s)
    return Case(seed, kind, profile, command, fault.about, at_s, fault.faults, fault.bus_faults, fault.disk, fault.dead, normal.code)


#: Seeds of :func:`access_cases` begin here.
FIRST_ACCESS = 1_000_000


def access_cases(healthy: Callable[[str, str], Healthy]) -> list[Case]:
    """Every single SDO transfer of a move and of writing gains, on both profiles: aborted once, and not answered three times."""
    cases = []
    for command in ("move", "apply"):
        for profile in ("reference", "cmmp-as"):
            normal = healthy(command, profile)
            for number in range(1, normal.transfers + 1):
                code = ABORTS[number % len(ABORTS)]
                for kind, about, faults in (
                    ("SDO abort", f"SDO transfer {number} aborted, {code:08X}h", {"sdo_abort": {number: code}}),
                    ("SDO time-out", f"SDO transfers from {number} not answered", {"sdo_silent": frozenset(range(number, number + 3))}),
                ):
                    seed = FIRST_ACCESS + len(cases)
                    cases.append(Case(seed, kind, profile, command, about, 0.0, faults, normal=normal.code))
    return cases


def standing_s(speed_m_s: Any, first: int, limit_m_s: float, for_ticks: int = 100) -> float:
    """s from a tick until the speed stays below a limit for so many ticks; inf when it does not."""
    slow = np.abs(np.asarray(speed_m_s)[first:]) < limit_m_s
    run = 0
    for n, standing in enumerate(slow):
        run = run + 1 if standing else 0
        if run == for_ticks:
            return (n - for_ticks + 1) * 1e-3
    return math.inf
