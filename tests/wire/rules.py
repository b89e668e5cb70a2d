"""What CiA 301, CiA 402 and the safety of an axis ask of a host and a drive, held against everything that went over the wire.

By hand:  cd tests && python -m wire.rules candump.log --sync     (0: nothing is wrong, 1: what is wrong, line by line)

Time is the stamps', or with ``--sync`` the count of SYNCs: one is the period 60C2h while the node is operational, else 1 ms.
Nothing here comes from beltcomm.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from wire.decoder import OPERATIONAL, Decoder, Event, Frame, Object, candump

#: State by statusword & mask (CiA 402), and by name which bits mean that the motor may carry torque.
STATES = (
    (0x4F, 0x00, "not ready"),
    (0x4F, 0x40, "switch on disabled"),
    (0x6F, 0x21, "ready"),
    (0x6F, 0x23, "switched on"),
    (0x6F, 0x27, "enabled"),
    (0x6F, 0x07, "quick stop"),
    (0x4F, 0x0F, "fault reaction"),
    (0x4F, 0x08, "fault"),
)
POWERED = {"enabled", "quick stop", "fault reaction"}
#: Command -> states in which CiA 402 gives it a transition, or the drive is already where it leads.
LEGAL = {
    "shutdown": {"switch on disabled", "ready", "switched on", "enabled"},
    "switch on": {"ready", "switched on", "enabled"},
    "enable": {"switched on", "enabled"},
    "fault reset": {"fault"},
}
#: Transitions: state -> command -> state.
LEADS = {
    ("switch on disabled", "shutdown"): "ready",
    ("ready", "switch on"): "switched on",
    ("ready", "disable voltage"): "switch on disabled",
    ("ready", "quick stop"): "switch on disabled",
    ("switched on", "enable"): "enabled",
    ("switched on", "shutdown"): "ready",
    ("switched on", "disable voltage"): "switch on disabled",
    ("switched on", "quick stop"): "switch on disabled",
    ("enabled", "switch on"): "switched on",
    ("enabled", "shutdown"): "ready",
    ("enabled", "disable voltage"): "switch on disabled",
    ("enabled", "quick stop"): "quick stop",
    ("quick stop", "disable voltage"): "switch on disabled",
    ("fault", "fault reset"): "switch on disabled",
}
#: What a drive does of itself: the end of a ramp, or a fault at any time.
BY_ITSELF = {"quick stop": "switch on disabled", "fault reaction": "fault", "not ready": "switch on disabled"}
CONTROLWORD, STATUSWORD, TORQUE, TARGET, POSITION, MODE = ((i, 0) for i in (0x6040, 0x6041, 0x6071, 0x607A, 0x6064, 0x6060))
#: Setpoints and commands, which are no settings.
NO_SETTINGS = {0x1003, 0x1010, 0x1011, 0x6040, 0x6071, 0x607A, 0x60B0, 0x60B1, 0x60B2, 0x60C1, 0x60FF}
#: Modes of operation in which the setpoint is a torque, and in which it is a position.
TORQUE_MODES, POSITION_MODES = {4, 10}, {7, 8}
#: Counts between target and place at which an axis may be enabled: 0.01 revolutions of 65536.
NEAR_COUNTS = 655
#: EMCY of a host that has fallen silent; where that is tried: s beyond the guard time in which it must come, counts that are standstill.
LIFE_GUARD, TOLERANCE_S, STILL_COUNTS = 0x8130, 0.05, 20


@dataclass
class Report:
    """findings : (rule, number of the frame, text).   counts : of everything that was said.   states : of the drive, in order."""

    findings: list[tuple[str, int, str]] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    states: list[str] = field(default_factory=list)
    longest_silence_s: float = 0.0
    seconds: float = 0.0

    @property
    def rules(self) -> set[str]:
        return {rule for rule, _, _ in self.findings}

    def lines(self) -> list[str]:
        """What was seen, and the first of what is wrong."""
        counts = ", ".join(f"{number} {what}" for what, number in self.counts.items())
        return [
            f"{sum(self.counts.values())} events, {self.seconds:.1f} s: {counts}",
            f"longest silence of the host with the stage on: {1e3 * self.longest_silence_s:.0f} ms",
            f"states: {' > '.join(self.states[:8])} ... ({self.states.count('enabled')} x enabled, at the end {self.states[-1:]})",
            *(f"{rule}: frame {number}: {text}" for rule, number, text in self.findings[:50]),
            f"{len(self.findings)} findings",
        ]


def state_of(statusword: int) -> str:
    return next((name for mask, pattern, name in STATES if statusword & mask == pattern), "unknown")


def command_of(controlword: int) -> str:
    if controlword & 0x80:
        return "fault reset"
    if not controlword & 0x02:
        return "disable voltage"
    if not controlword & 0x04:
        return "quick stop"
    if not controlword & 0x01:
        return "shutdown"
    return "enable" if controlword & 0x08 else "switch on"


class Judge:
    """One look at a log from its beginning to its end.   Names of the rules are the first argument of every ``_wrong``.

    holding : torques in the drive's unit that may be asked for before the stage is on, beside none.
    kept : objects whose last value may differ from the first.   faults : the log is one of a fault, and emergencies are right.
    """

    def __init__(
        self, node: int = 1, by_sync: bool = False, holding: Iterable[int] = (), kept: Iterable[Object] = (), faults: bool = False
    ) -> None:
        self.report = Report()
        self._decoder = Decoder(node)
        self._by_sync, self._holding, self._kept, self._faults = by_sync, {0, *holding}, set(kept), faults
        self._now_s = 0.0
        self._first: dict[Object, bytes] = {}
        self._written: dict[Object, int] = {}
        self._state = ""
        self._command = ""
        self._commands: set[str] = set()
        self._asked: dict[Object, int] = {}
        self._position: int | None = None
        self._due: dict[int, int] = {}  # TPDO -> frames owed since the last SYNC
        self._syncs: Counter[int] = Counter()
        self._life_s: float | None = None
        self._toggle: int | None = None
        self._stood: int | None = None  # where the axis was when its stage went on
        self._proven = self._proving = False

    def of(self, frames: Iterable[Frame]) -> Report:
        """Everything that is wrong with these frames."""
        event = None
        for event in self._decoder.events(frames):
            self.report.counts[event.what] += 1
            self._time(event)
            getattr(self, f"_on_{event.what}", lambda _event: None)(event)
        if event is not None:
            self._at_the_end(event)
        self.report.seconds = self._now_s
        return self.report

    def _wrong(self, rule: str, event: Event, text: str) -> None:
        self.report.findings.append((rule, event.number, text))

    def _time(self, event: Event) -> None:
        if not self._by_sync:
            self._now_s = event.stamp_s
        elif event.what == "sync":
            operational = self._decoder.state == OPERATIONAL
            self._now_s += (self._decoder.number(0x60C2, 1) or 1) * 1e-3 if operational else 1e-3
        if self._state in POWERED:
            guard_s = self._guard_time_s()
            silence_s = self._now_s - (self._now_s if self._life_s is None else self._life_s)
            if not (self._proving or self._may_prove()):
                self.report.longest_silence_s = max(self.report.longest_silence_s, silence_s)
            allowed_s = guard_s + (TOLERANCE_S if self._may_prove() else 0.0)
            if guard_s and silence_s > allowed_s + 1e-9 and not self._proving:
                self._wrong(
                    "guarding", event, f"no sign of life for {1e3 * silence_s:.0f} ms with the stage on, allowed are {1e3 * guard_s:.0f}"
                )
                self._life_s = self._now_s

    def _may_prove(self) -> bool:
        """Once in a log the host may fall silent to see what the drive does: at standstill, with no more torque than holds the axis."""
        still = self._stood is not None and self._position is not None and abs(self._position - self._stood) <= STILL_COUNTS
        torque = self._decoder.number(*MODE) in TORQUE_MODES and self._asked.get(TORQUE, 0) in self._holding
        return not self._proven and still and torque

    def _guard_time_s(self) -> float:
        """What the drive was told to watch its host with; 0 for nothing."""
        number = self._decoder.number
        return ((number(0x1016, 1) or 0) & 0xFFFF or (number(0x100C, 0) or 0) * (number(0x100D, 0) or 0)) * 1e-3

    def _on_broken(self, event: Event) -> None:
        self._wrong(event.data.decode(), event, event.text)

    def _on_emergency(self, event: Event) -> None:
        silence_s = self._now_s - (self._life_s or 0.0)
        if event.value == LIFE_GUARD and self._may_prove() and silence_s >= self._guard_time_s() - 2e-3:
            self._proven = self._proving = True
            self.report.counts["proof of guarding"] += 1
            return
        if event.value and not self._faults:
            self._wrong("emergency", event, f"the drive reports {event.value:04X}h")

    # -- settings ---------------------------------------------------------------------------------------------------------

    def _on_read(self, event: Event) -> None:
        self._first.setdefault(event.object, event.data)
        if event.object == STATUSWORD:
            self._drive_is(event, int.from_bytes(event.data, "little"))

    def _on_written(self, event: Event) -> None:
        key, before = event.object, bytes.fromhex(event.text)
        if key == CONTROLWORD:
            self._host_asks(event, int.from_bytes(event.data, "little"))
        elif key[0] not in NO_SETTINGS:
            self._first.setdefault(key, b"")  # nobody knows what stood there
            self._written[key] = event.number
        if key in (TORQUE, TARGET):
            self._asked[key] = int.from_bytes(event.data, "little", signed=True)
        self._check_pdo_setting(event, before)

    def _check_pdo_setting(self, event: Event, before: bytes) -> None:
        index, part = event.object
        family, pdo = index & ~3, index & 3
        if family not in (0x1400, 0x1600, 0x1800, 0x1A00):
            return
        communication = {0x1400: 0x1400, 0x1600: 0x1400, 0x1800: 0x1800, 0x1A00: 0x1800}[family] + pdo
        direction, name = ("r", "RPDO") if communication < 0x1800 else ("t", "TPDO")
        name += str(pdo + 1)
        if index != communication or part != 1:
            cob_id = self._decoder.number(communication, 1)
            if cob_id is None or not cob_id >> 31:
                self._wrong("pdo valid", event, f"{name} was changed ({index:04X}h:{part}) while bit 31 of its COB-ID was not set")
            if index != communication and part and self._decoder.number(index, 0):
                self._wrong("pdo mapping", event, f"an entry of {name} was written while its number of entries was not 0")
            return
        if direction == "t":
            self._due.pop(pdo, None)
        cob_id = int.from_bytes(event.data, "little")
        if cob_id >> 31:
            return
        if before and not before[3] >> 7 and int.from_bytes(before, "little") & 0x7FF != cob_id & 0x7FF:
            self._wrong("pdo valid", event, f"the identifier of {name} was changed while it was valid")
        mapping = self._decoder.mapping(direction, pdo)
        if not mapping or sum(length for _, length in mapping) > 8:
            self._wrong("pdo mapping", event, f"{name} was made valid before it was mapped")

    # -- exchange ---------------------------------------------------------------------------------------------------------

    def _on_nmt(self, event: Event) -> None:
        self._owed(event)
        self._syncs.clear()

    def _on_boot(self, event: Event) -> None:
        self._due.clear()
        self._toggle, self._life_s = None, None

    def _on_sync(self, event: Event) -> None:
        self._owed(event)
        if self._decoder.state != OPERATIONAL:
            return
        for direction, pdo in self._decoder.pdos().values():
            kind = self._decoder.number(0x1800 + pdo, 2) if direction == "t" else None
            if kind is not None and 1 <= kind <= 240:
                self._syncs[pdo] += 1
                if self._syncs[pdo] % kind == 0:
                    self._due[pdo] = 1

    def _owed(self, event: Event) -> None:
        for pdo, frames in self._due.items():
            if frames:
                self._wrong("tpdo", event, f"TPDO{pdo + 1} did not follow the SYNC before")
        self._due.clear()

    def _on_sent(self, event: Event) -> None:
        if 1 <= (self._decoder.number(0x1800 + event.index, 2) or 255) <= 240:
            if self._due.get(event.index, 0) == 0:
                self._wrong("tpdo", event, f"TPDO{event.index + 1} without a SYNC")
            self._due[event.index] = 0
        values = dict(event.values)
        self._position = values.get(POSITION, self._position)
        if STATUSWORD in values:
            self._drive_is(event, values[STATUSWORD])

    def _on_received(self, event: Event) -> None:
        values = dict(event.values)
        self._asked.update({key: values[key] for key in (TORQUE, TARGET) if key in values})
        if CONTROLWORD in values:
            self._host_asks(event, values[CONTROLWORD])

    # -- states -------------------------------------------------------------------------------------------------------------

    def _host_asks(self, event: Event, controlword: int) -> None:
        command = command_of(controlword)
        if command != self._command:
            if command in LEGAL and self._state not in LEGAL[command]:
                self._wrong(
                    "controlword", event, f"{command} ({controlword:04X}h) while the drive had last shown {self._state or 'nothing'}"
                )
            if command == "enable" and self._state == "switched on":
                self._before_enabling(event)
        elif command == "enable" and self._state == "switched on":
            self._before_enabling(event)
        self._command = command
        self._commands.add(command)

    def _before_enabling(self, event: Event) -> None:
        """The stage is about to go on: nothing may make the axis jump, and the drive must watch its host."""
        mode = self._decoder.number(*MODE)
        if mode in TORQUE_MODES and self._asked.get(TORQUE, 0) not in self._holding:
            self._wrong("setpoint", event, f"a torque of {self._asked[TORQUE]} is asked for before the stage is on")
        if mode in POSITION_MODES and TARGET in self._asked and self._position is not None:
            off = self._asked[TARGET] - self._position
            if abs(off) > NEAR_COUNTS:
                self._wrong("setpoint", event, f"the target is {off} counts off the place where the stage goes on")
        if not self._guard_time_s() or self._life_s is None:
            self._wrong("guarding", event, "the stage goes on although the drive does not watch its host")

    def _drive_is(self, event: Event, statusword: int) -> None:
        state = state_of(statusword)
        if state == self._state:
            return
        self.report.states.append(state)
        if self._state and state not in self._reachable():
            self._wrong("statusword", event, f"the drive went from {self._state} to {state}, which nobody asked for")
        self._state = state
        if state == "enabled":
            self._stood = self._position
        self._commands = {self._command} if self._command else set()

    def _reachable(self) -> set[str]:
        found, new = {self._state}, {self._state}
        while new:
            here = new.pop()
            there = {LEADS[here, command] for command in self._commands if (here, command) in LEADS} | {"fault reaction", "fault"}
            there |= {BY_ITSELF[here]} if here in BY_ITSELF else set()
            new |= there - found
            found |= there
        return found

    # -- signs of life ------------------------------------------------------------------------------------------------------

    def _on_guard(self, event: Event) -> None:
        self._life_s, self._proving = self._now_s, False

    def _on_heartbeat(self, event: Event) -> None:
        watched = (self._decoder.number(0x1016, 1) or 0) >> 16 & 0x7F
        if event.index == watched:
            self._life_s, self._proving = self._now_s, False

    def _on_guarded(self, event: Event) -> None:
        toggle = event.value >> 7
        if self._toggle is not None and toggle == self._toggle:
            self._wrong("toggle", event, "the answer to guarding does not alternate its toggle bit")
        if event.value & 0x7F != self._decoder.state:
            self._wrong("nmt state", event, f"the node says {event.value & 0x7F:02X}h, commanded was {self._decoder.state:02X}h")
        self._toggle = toggle

    # -- the end --------------------------------------------------------------------------------------------------------------

    def _at_the_end(self, event: Event) -> None:
        self._owed(event)
        if self._state in POWERED or self._state == "switched on":
            self._wrong("off at the end", event, f"the log ends with the drive {self._state}")
        for key, first in self._first.items():
            last = self._decoder.known.get(key, first)
            if key not in self._written or key in self._kept or last == first or (key == MODE and first == b"\0"):
                continue
            if key[0] in range(0x1400, 0x1C00) and key[1] == 1:  # bit 30 reads as 1 whatever is written
                first, last = (bytes([*value[:3], value[3] & ~0x40]) if len(value) == 4 else value for value in (first, last))
            if first == b"":
                self._wrong("restored", event, f"{key[0]:04X}h:{key[1]:X} was written before anybody knew what stood there")
            elif last != first:
                self._wrong("restored", event, f"{key[0]:04X}h:{key[1]:X} was {first.hex()} and is {last.hex()}")


def main() -> int:
    """Judge a log of candump -L, and say what was seen."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("log", type=Path)
    parser.add_argument("--node", type=int, default=1)
    parser.add_argument("--sync", action="store_true", help="time is the count of SYNCs")
    parser.add_argument("--complete", type=int, metavar="SYNCS", help="how many there were: a recorder that was too slow has lost some")
    given = parser.parse_args()
    with open(given.log, encoding="ascii") as lines:
        report = Judge(given.node, given.sync).of(candump(lines))
    if given.complete is not None and report.counts["sync"] != given.complete:
        text = f"{report.counts['sync']} of {given.complete} SYNCs are in the log: it is not complete, and nothing is proven by it"
        report.findings.insert(0, ("complete", 0, text))
    sys.stdout.write("".join(f"{line}\n" for line in report.lines()))
    return 1 if report.findings or not report.counts["sync"] else 0


if __name__ == "__main__":
    sys.exit(main())
