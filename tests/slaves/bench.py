"""A drive of another maker with its machine, commands on it, and what came of them, looked at behind the bus."""

from __future__ import annotations

import re
import signal
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from beltcomm.axis import load_axis
from beltcomm.drive import Drive
from beltcomm.model import load_plant
from beltcomm.simulate.plant import SimulatedPlant
from beltcomm.virtual.bus import LockstepBus, TimedLine
from beltcomm.virtual.faults import BusFaults, Faults
from beltcomm_adapters.canopen import connect
from beltcomm_adapters.virtual_node import attached, ticks_per_second
from campaign.judge import REMEDY, TRAVEL_M, UNMOVED_M
from campaign.rig import BUFFERS_M, PLANT, STANDING_M_S, START_M, Examiner, Outcome, Rig

AXIS = "egc-70-600"
_MACHINE = load_plant(PLANT).model
#: N: what a move may load the belt with by the plan: the feed force of the sheet, which leaves the guide's friction out, and 5 % as it
#: swings.  A number of its own: a plan that allowed more would be seen here.
BELT_N = 1.05 * (load_axis(AXIS).belt_force_limit_n + _MACHINE.get("cart_friction.level"))
#: m: what the first motions take by the plan, which no doctor can do without; a number of its own as well.
CREEP_M = 1e-2
#: What a technician writes into a profile of a drive after its first motions have shown that a unit is another one, and looked at it.
TOLD = {
    "akd": {
        "position_unit": "9.5367431640625e-07 rev",
        "velocity_unit": "0.001 rpm",
        "acceleration_unit": "1 rpm/s",
        "torque_scale": {"of": "drive_peak", "nm": 3.1, "check": "the inertia found"},
    },
    "lexium32": {"position_unit": "6.103515625e-05 rev", "velocity_unit": "1 rpm", "acceleration_unit": "1 rpm/s"},
    "asda-a2": {"position_unit": "1e-05 rev", "velocity_unit": "0.1 rpm", "acceleration_unit": "ms to 3000 rpm"},
}
#: What a technician adds to a profile when the maker's manual has told where the gains stand and in which unit.
DOCUMENTED: dict[str, dict[str, Any]] = {
    "epos4": {
        "gain_meaning": "documented",
        "parameters": {
            "kp_nm_s_rad": {"index": 0x30A2, "subindex": 1, "type": "uint32", "scale": 6.5e-7},
            "ki_nm_rad": {"index": 0x30A2, "subindex": 2, "type": "uint32", "scale": 6.5e-7},
            "kpp_1_s": {"index": 0x30A1, "subindex": 1, "type": "uint32", "scale": 1.0e-3},
        },
    },
    "pd4-e": {
        "gain_meaning": "documented",
        "parameters": {
            "kp_nm_s_rad": {"index": 0x3210, "subindex": 3, "type": "uint32", "scale": 1.0e-7},
            "ki_nm_rad": {"index": 0x3210, "subindex": 4, "type": "uint32", "scale": 1.0e-6},
            "kpp_1_s": {"index": 0x3210, "subindex": 1, "type": "uint32", "scale": 1.0e-3},
        },
    },
}
VERBS = ("doctor", "identify", "commission", "friction", "verify", "apply", "Ctrl-C", "host lost")
#: s of virtual time for one command, at most.
LONGEST_S = 600.0


@dataclass
class Watch(Examiner):
    """Looks at the belt too, and does something at an instant.   belt_n : of each tick.   happen : at ``at_tick``.   look : each tick."""

    tick_s: float = 1e-3
    belt_n: list[float] = field(default_factory=list)
    at_tick: int | None = None
    happen: Callable[[], None] = lambda: None
    look: Callable[[int], None] = lambda _tick: None

    def begin_tick(self, tick: int) -> None:
        self.belt_n.append(abs(self.plant.belt_force_n))
        here = START_M + self.plant.cart_position_m
        self.speed_m_s.append((here - self.place_m[-1]) / self.tick_s if self.place_m else 0.0)
        self.place_m.append(here)
        self.powered.append(self.device.powered)
        if self.at_tick is not None and tick >= self.at_tick:
            self.at_tick = None
            self.happen()
        self.look(tick)


class SlaveRig(Rig):
    """The drive of that name, switched on at once; it stays on from command to command.

    options : of the virtual adapter, further ones.   period_s : SYNC period asked for.   plant : None takes the product's own.
    """

    def __init__(self, slave: str, seed: int = 1, period_s: float | None = None, plant: Any = None, **options: Any) -> None:
        file = load_plant(PLANT)
        self.plant = plant or SimulatedPlant(file.model, START_M, end_stops_m=BUFFERS_M)
        self.faults = Faults()
        self.period_s = period_s
        given = {"plant": self.plant, "start_position": START_M, "as": slave, "seed": seed, "faults": self.faults, **options}
        if slave in ("reference", "cmmp-as"):
            given["profile"] = given.pop("as")
        if period_s is not None:
            given["sample_period"] = period_s
        self.bus = LockstepBus(ticks_per_second=ticks_per_second(given))
        self.device, self._plant_name = attached(self.bus, PLANT, given)
        self.settings = self.dictionary()
        self.examiner: Watch = Watch(self.plant, self.device, file.model["transmission.ratio"], tick_s=self.bus.tick_s)
        self.bus.attach(self.examiner)
        self.opened, self.known_gains = 0, False

    def open(self, _name: str, options: Any = None) -> Drive:
        """In place of :func:`beltcomm.drive.open_drive`: this drive, not a new one."""
        self.opened += 1
        given = options or {}
        profile, plate = given.get("profile"), given.get("nameplate")
        drive: Any = connect(self.bus, self.bus.clock, 1, profile, None, lambda: None, self.period_s, plate)
        self.known_gains = drive.capabilities.gains != "unknown"
        drive.capabilities = replace(drive.capabilities, identity={**drive.capabilities.identity, "plant": self._plant_name})
        return drive  # type: ignore[no-any-return]

    def run_on(self, seconds: float) -> None:
        for _ in range(round(seconds / self.bus.tick_s)):
            self.bus.advance()

    def end(self, what: str) -> None:
        """``Ctrl-C``, ``host lost`` or a fault that brakes, now."""
        if what == "Ctrl-C":
            signal.raise_signal(signal.SIGINT)
        elif what == "host lost":
            self.bus.line = TimedLine(BusFaults(host_dies_at_s=self.bus.clock.now()), self.bus.ticks_per_second)
        else:
            self.faults.emergency_at_s, self.faults.emergency_code, self.faults.emergency_effect = self.bus.clock.now(), 0x8611, "brake"

    @contextmanager
    def at(self, after_s: float, what: str) -> Iterator[None]:
        """``Ctrl-C`` or ``host lost`` so long after now."""
        watch = self.examiner
        if what == "Ctrl-C":
            watch.happen = lambda: signal.raise_signal(signal.SIGINT)
            watch.at_tick = self.bus.tick + round(after_s / self.bus.tick_s)
        else:
            dies = BusFaults(host_dies_at_s=self.bus.clock.now() + after_s)
            self.bus.line = TimedLine(dies, self.bus.ticks_per_second)
        try:
            yield
        finally:
            watch.at_tick, self.bus.line = None, None


@dataclass(frozen=True)
class Cell:
    """One verb on one drive.   state : "done", "refused" (before any motion; of the doctor: something is WRONG), "found" or "RED".

    why : in words.   moved_s : how long the carriage moved.   powered : the stage was on."""

    slave: str
    verb: str
    state: str
    code: int | None
    why: str
    belt_n: float
    moved_s: float
    powered: bool = False


def sentence(text: str) -> str:
    """The last that was said as a failure."""
    said = [line for line in text.splitlines() if line.startswith("beltcomm: ")]
    return said[-1].removeprefix("beltcomm: ") if said else ""


def headline(text: str) -> str:
    """Of the last result that was shown."""
    shown = re.findall(r"(?m)^ *((?:PASS|FAIL|NOT TRUSTED|OUT OF DATE|NOT PROVEN) +.*)$", text)
    return str(re.sub(r"\s+", " ", shown[-1])).strip() if shown else ""


def judged(rig: SlaveRig, verb: str, slave: str, outcome: Outcome, first: int, allow_changes: bool = False) -> Cell:
    """What a command that began at row ``first`` of the watch came to."""
    watch = rig.examiner
    place, speed = np.array(watch.place_m[first:]), np.array(watch.speed_m_s[first:])
    belt_n = float(max(watch.belt_n[first:], default=0.0))
    moved = float(np.ptp(place)) > UNMOVED_M if len(place) else False
    moved_s = float((np.abs(speed) > STANDING_M_S).sum() * rig.bus.tick_s)
    said = sentence(outcome.text)
    wrong = []
    if outcome.code is None and not (verb == "host lost" and outcome.error == "HostDied"):
        wrong.append(outcome.error)
    if re.search(r"Traceback|unexpected error", outcome.text):
        wrong.append("an error that nobody thought of")
    rig.run_on(1.0)
    if float(np.abs(watch.speed_m_s[-50:]).max()) >= STANDING_M_S:
        wrong.append("the carriage moves in the end")
    if watch.powered[-1]:
        wrong.append("the stage is on in the end")
    if belt_n > BELT_N:
        wrong.append(f"{belt_n:.0f} N in the belt")
    if len(place) and (place.min() < TRAVEL_M[0] or place.max() > TRAVEL_M[1]):
        wrong.append("outside its travel")
    if verb != "host lost" and not allow_changes and (changed := rig.changed()):
        wrong.append(f"not restored: {changed}")
    right = {"Ctrl-C": (0, 1, 4), "host lost": (None, 0, 1)}.get(verb, (0, 1))
    if not moved and (outcome.code not in right or (said and verb not in ("apply", "Ctrl-C"))):
        state = "refused"
        if not said or not re.search(REMEDY, said):
            wrong.append("no sentence that says what to do")
    elif outcome.code not in right and float(np.ptp(place)) < CREEP_M and re.search(REMEDY, said):
        state = "found"
    else:
        state = "done"
        if outcome.code not in right:
            wrong.append(f"ended with {outcome.code} after {moved_s:.0f} s of motion")
    return Cell(
        slave,
        verb,
        "RED" if wrong else state,
        outcome.code,
        "; ".join((*wrong, *filter(None, [said or headline(outcome.text)]))),
        belt_n,
        moved_s,
        any(watch.powered[first:]),
    )


def words(verb: str, run: Path, profile: Sequence[str] = ()) -> list[str]:
    """A command line.   profile : words that name one."""
    common = ["--drive", "virtual", "--axis", AXIS, "--yes", *profile]
    if verb in ("friction", "verify", "apply"):
        return [verb, "--drive", "virtual", "--run", str(run), "--yes", *profile, *(["--force"] if verb == "apply" else [])]
    if verb == "doctor":
        return ["doctor", "--drive", "virtual", "--axis", AXIS, *profile]
    quick = ["--quick", "--no-report"] if verb == "commission" else []
    return [verb, *common, *quick, "--run", str(run)]


def told_profile(slave: str, folder: Path) -> list[str]:
    """Words that name the profile of a drive with ``+``, which is written into a folder; none for any other."""
    if not slave.endswith("+"):
        return []
    file = folder / "told.yaml"
    file.write_text(yaml.safe_dump({"name": "told", "title": f"{slave[:-1]} as found", **TOLD[slave[:-1]]}))
    return ["--profile", str(file)]


def run_row(slave: str, verbs: tuple[str, ...] = VERBS, seed: int = 1, period_s: float | None = None, **options: Any) -> list[Cell]:
    """A row of the table: each verb on a drive that has just been switched on, verify and apply on the finished run.

    slave : a name; with ``+``, with a profile that says what ``TOLD`` holds.
    """
    draw = np.random.default_rng(seed)
    cells: list[Cell] = []
    with tempfile.TemporaryDirectory(prefix="slaves-") as folder:
        whole, profile = Path(folder) / "commission", told_profile(slave, Path(folder))
        healthy, moving = None, ""
        for verb in verbs:
            rig = SlaveRig(slave.removesuffix("+"), seed, period_s, **options)
            place = ["--position", f"{1e3 * START_M:g}mm"] if verb not in ("doctor", "apply") else []
            run = whole if verb in ("friction", "verify", "apply") else Path(folder) / verb.replace(" ", "-")
            if verb == "doctor":
                cells.append(_doctor(rig, slave, words(verb, run, profile)))
            elif verb in ("Ctrl-C", "host lost") and healthy is not None:
                speed = np.abs(healthy.speed_m_s)
                instants = np.flatnonzero(speed > 5 * STANDING_M_S)
                after = float(draw.choice(instants)) * rig.bus.tick_s if len(instants) else 0.5
                with rig.at(after, verb):
                    outcome = rig.call(*words(moving, run, profile), *place)
                if verb == "host lost":
                    rig.run_on(3.0)
                cells.append(judged(rig, verb, slave, outcome, 0))
            elif verb not in ("Ctrl-C", "host lost"):
                outcome = rig.call(*words(verb, run, profile), *place)
                cells.append(judged(rig, verb, slave, outcome, 0, allow_changes=verb == "apply" and outcome.code == 0))
                if verb in ("identify", "commission"):
                    healthy, moving = rig.examiner, verb
            rig.close()
    return _consistent(cells)


def _consistent(cells: list[Cell]) -> list[Cell]:
    """Doctor and commission ask the same questions: what the one refuses before any motion the other finds WRONG."""
    states = {cell.verb: cell for cell in cells}
    doctor, commission = states.get("doctor"), states.get("commission")
    if doctor is None or commission is None or doctor.state == "RED" or commission.state == "RED":
        return cells
    if (doctor.state == "refused") == (commission.state == "refused") or (commission.state == "refused" and commission.powered):
        return cells  # what only a torque shows no doctor knows
    says = "nothing is wrong" if doctor.state == "done" else "something is wrong"
    why = f"it says that {says}, commission is {commission.state}; {doctor.why}"
    return [replace(cell, state="RED", why=why) if cell is doctor else cell for cell in cells]


def _doctor(rig: SlaveRig, slave: str, line: list[str]) -> Cell:
    """On a drive of its own, through the adapter."""
    outcome = rig.call(*line, "--as", slave.removesuffix("+")) if slave not in ("reference", "cmmp-as") else rig.call(*line)
    wrong = [] if outcome.code in (0, 1) else [f"exit code {outcome.code}"]
    if re.search(r"Traceback|unexpected error", outcome.text):
        wrong.append("an error that nobody thought of")
    found = [re.sub(r"\s+", " ", found) for found in re.findall(r"(?m)^ *WRONG +(.*)$", outcome.text)]
    state = "RED" if wrong else "done" if outcome.code == 0 else "refused"
    return Cell(slave, "doctor", state, outcome.code, "; ".join((*wrong, *found)), 0.0, 0.0)
