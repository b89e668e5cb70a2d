"""A virtual axis that is looked at behind the bus, and commands of the command line run on it, healthy or with a fault."""

from __future__ import annotations

import contextlib
import io
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from beltcomm import api
from beltcomm.axis import load_axis
from beltcomm.cli.main import cli
from beltcomm.drive import Drive, open_drive
from beltcomm.machine.ratings import nameplate_of
from beltcomm.model import load_plant
from beltcomm.simulate.plant import SimulatedPlant
from beltcomm.virtual.bus import LockstepBus, TimedLine
from beltcomm.virtual.device import VirtualDrive
from beltcomm.virtual.faults import BusFaults, Faults, HostDied
from beltcomm.virtual.sdo import begun_transfer
from beltcomm_adapters.canopen import connect
from campaign.disk import Disk

PLANT, AXIS = "g_a", "egc-70-600"
START_M = 0.25
TICK_S = 1e-3
#: Rubber buffers behind the travel of -0.01 to 0.57 m.
BUFFERS_M = (-0.03, 0.59)
#: s: no command of the campaign takes so long on the machine.
LONGEST_S = 150.0
#: Torque paths of a drive, by name: a setpoint filter and a current loop; a reading that is filtered, late and in steps.
PATHS: Mapping[str, Mapping[str, float]] = {
    "lag": {"setpoint_filter_s": 5e-4, "current_loop_hz": 800.0},
    "filter": {"reading_filter_s": 2e-3, "reading_late_ticks": 1.0, "reading_step_nm": 7e-3},
}
#: m/s: what counts as standing.
STANDING_M_S = 1e-3
#: Objects that hold commands or samples, not settings: the session leaves them as it finds fit.
COMMANDS = frozenset({0x6040, 0x6041, 0x6060, 0x6061, 0x6071, 0x607A, 0x60FF, 0x60B0, 0x60B1, 0x60B2, 0x60C1, 0x1003})


class Hung(BaseException):
    """A command took longer on the machine than any can."""


@dataclass
class Examiner:
    """A node that never answers and looks at the machine itself, once per tick.

    place_m, speed_m_s, powered : of each tick.   transfers : begun by SDO until that tick.   asked : index and subindex of each.
    """

    plant: SimulatedPlant
    device: VirtualDrive
    ratio: float
    place_m: list[float] = field(default_factory=list)
    speed_m_s: list[float] = field(default_factory=list)
    powered: list[bool] = field(default_factory=list)
    transfers: list[int] = field(default_factory=list)
    asked: list[tuple[int, int]] = field(default_factory=list)
    limit: int = round(LONGEST_S / TICK_S)

    def receive(self, identifier: int, data: bytes, _remote: bool) -> None:
        if 0x600 < identifier < 0x680 and (begun := begun_transfer(data)) is not None:
            self.asked.append(begun[:2])

    @property
    def begun(self) -> int:
        """Transfers so far."""
        return len(self.asked)

    def begin_tick(self, tick: int) -> None:
        here = START_M + self.plant.cart_position_m
        self.speed_m_s.append((here - self.place_m[-1]) / TICK_S if self.place_m else 0.0)
        self.place_m.append(here)
        self.powered.append(self.device.state.name in ("OPERATION_ENABLED", "QUICK_STOP_ACTIVE", "FAULT_REACTION_ACTIVE"))
        self.transfers.append(self.begun)
        if tick > self.limit:
            raise Hung

    def finish_tick(self) -> None:
        return


@dataclass
class Outcome:
    """What a command said and did.   code : None when its host died or it hung.   error : what nobody caught."""

    code: int | None
    text: str
    error: str = ""


def variant_of(profile: str) -> tuple[dict[str, Any], float | None]:
    """Options of a virtual drive, and its SYNC period asked for, s, by words such as ``epos4 2ms lag``: drive, period, torque path."""
    name, *further = profile.split()
    options: dict[str, Any] = {"profile" if name in ("reference", "cmmp-as") else "as": name}
    periods = [1e-3 * float(word.removesuffix("ms")) for word in further if word.endswith("ms")]
    for word in further:
        options |= PATHS.get(word, {})
    return options | ({"sample_period": periods[0]} if periods else {}), periods[0] if periods else None


class Rig:
    """A drive that is switched on at once and stays on.

    profile : see :func:`variant_of`.   gains : its gains before a command over those that it has saved.
    """

    def __init__(self, profile: str, seed: int = 1, gains: float = 1.25) -> None:
        file = load_plant(PLANT)
        self.plant = SimulatedPlant(file.model, START_M, end_stops_m=BUFFERS_M)
        self.faults = Faults()
        variant, self.period_s = variant_of(profile)
        options = {"plant": self.plant, "start_position": START_M, "seed": seed, "faults": self.faults, **variant}
        if "as" in variant:  # one that tells no ratings has those of the axis file
            options["nameplate"] = nameplate_of(load_axis(AXIS))
        first: Any = open_drive(f"virtual:{PLANT}", options)
        self.bus: LockstepBus = first._link.bus
        first._release = lambda: None
        self._plant_name = file.model.name
        found, has = first.backup(), first.capabilities
        first.calibrate({name: has.parameters[name].scale for name in has.uncalibrated})  # as the profile says
        first.write({name: gains * found[name] for name in ("kp_nm_s_rad", "ki_nm_rad", "kpp_1_s") if name in found})
        self.gains = first.backup()
        first.close()
        (self.device,) = self.bus._nodes  # type: ignore[assignment]
        self.settings = self.dictionary()
        self.examiner = Examiner(self.plant, self.device, file.model["transmission.ratio"])
        self.bus.attach(self.examiner)
        self.begun_tick = self.bus.tick
        self.opened = 0

    def dictionary(self) -> dict[tuple[int, int], Any]:
        """All that can be set in the drive, looked at inside."""
        entries = self.device._dictionary._entries
        return {key: entry.value for key, entry in entries.items() if entry.row.access == "rw" and key[0] not in COMMANDS}

    def changed(self) -> dict[str, tuple[Any, Any]]:
        """Settings that are not as they were: before, now."""
        now = self.dictionary()
        return {
            f"{i:04X}h:{s:X}": (old, now[i, s])
            for (i, s), old in self.settings.items()
            if not math.isclose(now[i, s], old, rel_tol=1e-6)  # single precision on the wire
        }

    @property
    def now_s(self) -> float:
        return self.bus.tick * TICK_S

    def spoil(self, faults: Mapping[str, Any], bus_faults: Mapping[str, Any]) -> None:
        """From now on these are in force; times count from here."""
        self.device._transfers = 0
        for name, value in _from_now(faults, self.now_s).items():
            setattr(self.faults, name, value)
        if self.faults.rated_torque_nm is not None:  # what it reads is decided at power-on
            self.device._dictionary.entry(0x6076).value = round(1e3 * self.faults.rated_torque_nm)
            self.settings = self.dictionary()
        if self.faults.encoder_sign < 0:  # it counts the other way from where it is
            encoder = self.device._servo._encoder
            encoder._zero_rad = self.plant.position_rad + encoder.angle_rad
        if bus_faults:
            frames = tuple(replace(f, from_s=f.from_s + self.now_s, until_s=f.until_s + self.now_s) for f in bus_faults.get("frames", ()))
            given = {**_from_now(bus_faults, self.now_s), "frames": frames}
            self.bus.line = TimedLine(BusFaults(**given), 1000)

    def repair(self) -> None:
        """The wire is good again; what the drive suffers from is over."""
        self.bus.line = None
        for name, value in vars(Faults()).items():
            setattr(self.faults, name, value)

    def open(self, _name: str, options: Mapping[str, Any] | None = None) -> Drive:
        """In place of :func:`beltcomm.drive.open_drive`: this drive, not a new one."""
        self.opened += 1
        plate = (options or {}).get("nameplate")
        drive: Any = connect(self.bus, self.bus.clock, 1, None, None, lambda: None, self.period_s, plate)
        drive.capabilities = replace(drive.capabilities, identity={**drive.capabilities.identity, "plant": self._plant_name})
        return drive  # type: ignore[no-any-return]

    def call(self, *words: object, disk: Disk | None = None) -> Outcome:
        """One command of the command line on this drive."""
        out = io.StringIO()
        code, error = None, ""
        mounted = disk.mounted() if disk is not None else contextlib.nullcontext()
        with self.connected(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(out), mounted:
            try:
                code = cli.main([str(word) for word in words], standalone_mode=False)
            except (HostDied, Hung) as end:
                error = type(end).__name__
            except BaseException as escaped:  # what the command line let through
                error = f"{type(escaped).__name__}: {escaped}"
        return Outcome(code, out.getvalue(), error)

    @contextlib.contextmanager
    def connected(self) -> Iterator[None]:
        """The commands find this drive in place of their own."""
        before = api.open_drive
        api.open_drive = self.open
        try:
            yield
        finally:
            api.open_drive = before

    def run_on(self, seconds: float) -> None:
        """Nobody is at the bus any more."""
        for _ in range(round(seconds / TICK_S)):
            self.bus.advance()

    def close(self) -> None:
        self.bus.line = None
        self.bus.shutdown()


def _from_now(values: Mapping[str, Any], now_s: float) -> dict[str, Any]:
    """Instants on the bus's time."""
    return {
        name: value + now_s if name.endswith(("at_s", "from_s", "until_s")) and value is not None and math.isfinite(value) else value
        for name, value in values.items()
    }
