"""A virtual drive that stays on while commands connect and leave, with the independent truth simulator as its machine."""

from __future__ import annotations

import re
import signal
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import numpy as np
from numpy.typing import NDArray

from beltcomm.axis import Axis, Gearbox, load_axis
from beltcomm.configfiles import find_config
from beltcomm.drive import Drive, open_drive
from beltcomm.experiments.phases import SIGN_REACH_M, SIGN_TRAVEL_M
from beltcomm.recording import Recording
from beltcomm.simulate.stopping import Braking
from beltcomm.talk import CarriagePosition
from beltcomm.virtual.bus import Frame
from beltcomm_adapters.canopen import connect
from truth.rigs import GEARBOX_KG_M2, geared, nominal

Array = NDArray[np.float64]

#: m/rad, table A.2: 78 mm feed per revolution.
RATIO = 0.01242
COUNT_RAD = 2.0 * np.pi / 65536
#: s: a braked axis must stand within this time: its ramp, and what its speed controller overshoots.
STOP_S = 1.0


def way_counted_with(run: Path, speed_m_s: float, acceleration_m_s2: float) -> float:
    """Way of a stop, m, by the last word of a run's journal on it; before a loop was designed, what the creeping is planned with."""
    said = re.findall(r"a stop brakes with ([\d.e+-]+) m/s² after ([\d.]+) ms", (run / "journal.txt").read_text(encoding="utf-8"))
    if not said:
        return SIGN_REACH_M - SIGN_TRAVEL_M
    # the journal's digits are rounded; five periods of reaction
    return Braking(0.999 * float(said[-1][0]), 1e-3 * (float(said[-1][1]) + 0.05), 5e-3).way_m(speed_m_s, acceleration_m_s2)


class LoggedPlant:
    """A plant that remembers every tick: torque[k] acts from t_k to t_k+1; position_rad[k] and cart_m[k] are those at t_k."""

    def __init__(self, plant: Any) -> None:
        self.plant = plant
        self.ratio = plant.axis.transmission_m_rad if hasattr(plant, "axis") else RATIO
        self._torque: list[float] = []
        self._angle: list[float] = [plant.position_rad]
        self._cart: list[float] = [plant.cart_position_m]
        self._belt: list[float] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self.plant, name)

    def brake(self, torque_nm: float) -> None:
        self.plant.brake(torque_nm)

    def step(self, torque_nm: float, duration_s: float) -> None:
        plant = self.plant
        plant.step(torque_nm, duration_s)
        self._torque.append(torque_nm)
        self._angle.append(plant.position_rad)
        self._cart.append(plant.cart_position_m)
        self._belt.append(plant.belt_force_n)

    @property
    def torque_nm(self) -> Array:
        return np.array(self._torque)

    @property
    def belt_force_n(self) -> Array:
        """At the end of each tick."""
        return np.array(self._belt)

    @property
    def position_rad(self) -> float:
        return float(self.plant.position_rad)

    def first_tick_of(self, recording: Recording, start_m: float) -> int:
        """The tick of a recording's first row: where the encoder of the plant reads exactly what was recorded, row by row."""
        counts = np.round((np.array(self._angle) + start_m / self.ratio) / COUNT_RAD)
        recorded = np.round(recording.position / COUNT_RAD)
        ticks = np.round((recording.t_s - recording.t_s[0]) / 1e-3).astype(int)
        probe = np.argsort(-np.abs(np.diff(recorded)))[:40] + 1  # rows in fast motion: they fit nowhere else
        last = len(counts) - int(ticks[-1])
        fits = np.ones(last, dtype=bool)
        for row in probe:
            fits &= np.abs(counts[ticks[row] : ticks[row] + last] - recorded[row]) <= 1
        found = [k for k in np.flatnonzero(fits) if np.all(np.abs(counts[k + ticks] - recorded) <= 1)]
        assert len(found) == 1, f"{recording.name} matches the plant's motion at {len(found)} places"
        return int(found[0])

    def cart_m(self, first: int, rows: int) -> Array:
        """Carriage from where it began, m, at the rows of a recording without gaps."""
        return np.array(self._cart[first : first + rows])


class Bench:
    """A virtual drive and its machine; :meth:`open` stands in for :func:`beltcomm.drive.open_drive` in :mod:`beltcomm.api`.

    name : of the drive.   start_m : where the carriage stands.   options : further ones of the virtual adapter.
    """

    def __init__(self, rig: str = "g_a", name: str | None = None, start_m: float = 0.25, **options: Any) -> None:
        self.plant = LoggedPlant(options.pop("plant", None) or nominal(rig))
        self.name = name or f"virtual:{rig}"
        self.start_m = start_m
        self.options: dict[str, Any] = {"plant": self.plant, "start_position": start_m, "log": self._on_frame, **options}
        self.profile = options.get("profile") if options.get("profile") not in ("reference", "cmmp-as") else None  # the host's
        self.log: Any = None
        self.opened = 0
        self._bus: Any = None
        self._due: Callable[[Frame], bool] | None = None
        self.signals = 0
        self.signal_tick = 0

    def open(self, name: str, options: Mapping[str, object] | None = None) -> Drive:
        """Connect as the command would, to this drive instead of a new one."""
        self.opened += 1
        if self._bus is None:
            drive = open_drive(name, {**(options or {}), **self.options})
            self._bus = drive._link.bus  # type: ignore[attr-defined]
            self.initial = drive.backup()
            self._identity = drive.capabilities.identity
        else:
            drive = connect(self._bus, self._bus.clock, 1, self.profile, None, lambda: None)
            drive.capabilities = replace(drive.capabilities, identity=self._identity)
        drive._release = lambda: None  # type: ignore[attr-defined]  # the drive stays on when the command has left
        return drive

    def parameters(self) -> dict[str, float]:
        """All parameters of the drive, read by a new connection."""
        with self.open(self.name) as drive:
            return drive.backup()

    def settings(self) -> dict[str, float]:
        """What a backup would hold: raw values by object, read by a new connection."""
        with self.open(self.name) as drive:
            return {item.title: item.raw for item in drive.objects()}

    @property
    def now_s(self) -> float:
        return float(self._bus.clock.now()) if self._bus is not None else 0.0

    @property
    def state(self) -> str:
        """CiA 402 state of the drive, looked at inside."""
        return str(self._bus._nodes[0].state.name)

    @property
    def carriage_m(self) -> float:
        return float(self.start_m + self.plant.cart_position_m)

    def power_cycle(self) -> None:
        """Reset of the node: what was not saved is gone."""
        self._bus.send(can.Message(arbitration_id=0, data=[0x81, 1], is_extended_id=False))

    def run_on(self, seconds: float) -> None:
        """Let virtual time pass with nobody connected."""
        for _ in range(round(1000 * seconds)):
            self._bus.advance()

    def stands_disabled(self) -> bool:
        """Whether the stage is off and the machine comes to rest within ``STOP_S`` and stays there."""
        off = self.state in ("SWITCH_ON_DISABLED", "READY_TO_SWITCH_ON", "SWITCHED_ON", "FAULT")
        self.run_on(STOP_S)
        before = self.carriage_m
        self.run_on(0.2)
        torque = self.plant.torque_nm
        return off and abs(self.carriage_m - before) < 1e-6 and not np.any(torque[-200:])

    def interrupt_when(self, due: Callable[[Frame], bool]) -> None:
        """Send this process a Ctrl-C with the first frame of the host for which ``due`` is true."""
        self._due = due

    def faster_than(self, speed_rad_s: float) -> Callable[[Frame], bool]:
        """For :meth:`interrupt_when`: whether the motor turns faster than this."""
        return lambda _frame: abs(self.plant.velocity_rad_s) > speed_rad_s

    def check_stop(self, run: Path) -> None:
        """From the Ctrl-C on the carriage brakes to rest within ``STOP_S``: it goes on in its direction, not further than the session
        counts with (its journal), and it does not come back by more than the belt gives."""
        places = self.plant.cart_m(0, len(self.plant.torque_nm))
        tick = self.signal_tick
        speed, before = (places[tick] - places[tick - 5]) / 5e-3, (places[tick - 40] - places[tick - 45]) / 5e-3
        way = (places[tick:] - places[tick]) * (1.0 if speed > 0.0 else -1.0)
        assert way.max() <= way_counted_with(run, speed, (speed - before) / 40e-3)
        assert way.min() >= -1e-3
        rest = way[round(STOP_S / 1e-3) :]
        assert len(rest) == 0 or np.ptp(rest) < 50e-6

    def close(self) -> None:
        if self._bus is not None:
            self._bus.shutdown()

    def _on_frame(self, frame: Frame) -> None:
        if self.log is not None:
            self.log(frame)
        if self._due is not None and frame[3] == "host" and self._due(frame):
            self._due = None
            self.signals += 1
            self.signal_tick = len(self.plant.torque_nm)
            signal.raise_signal(signal.SIGINT)


def geared_bench(folder: Path, rig: str, ratio: float, **options: Any) -> tuple[Bench, Axis]:
    """A rig behind a gearbox, and its axis file's content; ``folder`` keeps the plant file that tells the drive where its zero is."""
    plant = geared(rig, ratio)
    shipped = find_config("plants", rig).read_text(encoding="utf-8")
    file = folder / f"{rig}_{ratio:g}.yaml"
    file.write_text(shipped.replace("value: 0.01242,", f"value: {plant.axis.transmission_m_rad!r},"), encoding="utf-8")
    axis = replace(load_axis("egc-70-600"), name=f"EGC-70-600, {ratio:g}:1", gearbox=Gearbox(ratio, GEARBOX_KG_M2))
    return Bench(name=f"virtual:{file}", plant=plant, **options), axis


class Listener:
    """A Talk that remembers what it hears, answers as it is told, and may be made to act at a phase.

    at_phase : called with the phase's number when it begins.   at_progress : called with phase number and fraction.
    """

    def __init__(self, answer: bool = False, at_phase: Any = None, at_progress: Any = None) -> None:
        self.answer = answer
        self.at_phase, self.at_progress = at_phase, at_progress
        self.phases: list[tuple[int, str]] = []
        self.said: list[str] = []
        self.asked: list[str] = []
        self.fractions: list[float] = []
        self.places: list[CarriagePosition] = []

    def phase(self, index: int, count: int, title: str) -> None:
        assert 1 <= index <= count
        self.phases.append((index, title))
        if self.at_phase is not None:
            self.at_phase(index)

    def progress(self, fraction: float, seconds_left: float | None) -> None:
        self.fractions.append(fraction)
        if self.at_progress is not None:
            self.at_progress(self.phases[-1][0] if self.phases else 0, fraction)

    def moving(self, place: CarriagePosition) -> None:
        self.places.append(place)

    def say(self, *lines: str) -> None:
        self.said.append("\n".join(lines))

    def confirm(self, text: str) -> bool:
        self.asked.append(text)
        return self.answer

    def close(self, done: bool = False) -> None:
        """As the talk of the command line has it."""
