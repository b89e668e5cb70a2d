"""A whole adapter in one file: copy it, and put your maker's calls where ``Amplifier`` stands.  The contract tests run on it.

``Amplifier`` is what a maker's library is like, simulated: a servo amplifier with its motor, 1 ms per cycle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from beltcomm.control import Cascade, CascadeStructure, cascade_step, discrete_coefficients, new_state, reset_state
from beltcomm.drive import Adapter, Capabilities, Clock, Drive, ExchangeReport, Guarding, Limits, Motion, Row, Sink
from beltcomm.drive.objects import ObjectValue
from beltcomm.drive.parameters import cascade_to_parameters, parameters_to_cascade
from beltcomm.errors import DriveError, DriveFault, Refused, SafetyStop, UsageError
from beltcomm.plant import Plant

PERIOD_S, COUNTS, STEP_NM, RATED_NM, PEAK_NM, TOP_RAD_S = 1e-3, 65536, 1e-3, 1.43, 3.1, 400.0
DISABLED, ENABLED, FAULT = 1.0, 4.0, 8.0  # numbers of CiA 402: Switch On Disabled, Operation Enabled, Fault
#: Its gains under the names of beltcomm.drive.parameters, and its two limits.  Translate here where your drive has other units.
FACTORY = cascade_to_parameters(Cascade(0.1, 0.5, 10.0, 1e-3)) | {"torque_limit_nm": PEAK_NM, "speed_limit_rad_s": TOP_RAD_S}
NO_VELOCITY = "this amplifier closes its speed loop only inside the position loop; use a motion of kind 'position'."


class Motor:
    """J dω/dt = τ - d ω, for ``example`` without a machine behind it."""

    position_rad = velocity_rad_s = cart_position_m = belt_force_n = 0.0

    def step(self, torque_nm: float, duration_s: float) -> None:
        """See :class:`beltcomm.plant.Plant`."""
        self.velocity_rad_s += (torque_nm - 5e-3 * self.velocity_rad_s) / 2e-3 * duration_s
        self.position_rad += self.velocity_rad_s * duration_s


class Amplifier:
    """The maker's side.  All of this is in your hardware; your adapter calls it through the maker's library."""

    def __init__(self, machine: Plant) -> None:
        self.machine, self.stored, self.state = machine, dict(FACTORY), DISABLED
        self.cycles, self.silent, self.watchdog_s, self.torque_nm = 0, 0, math.inf, 0.0
        self._loop = new_state()

    def position_rad(self) -> float:
        """As the encoder has it."""
        count = 2.0 * math.pi / COUNTS
        return count * round(self.machine.position_rad / count)

    def enable(self) -> None:
        """Stage on, loops at rest where the axis is."""
        self.state, self.silent = ENABLED, 0
        reset_state(self._loop, self.position_rad())

    def cycle(self, torque_nm: float, loop: tuple[float, float, float] | None = None, *, alive: bool = True) -> None:
        """One millisecond.   loop : reference position, speed and acceleration of the position loop, to which the torque is added."""
        self.silent = 0 if alive else self.silent + 1
        if self.state == ENABLED and self.silent * PERIOD_S >= self.watchdog_s:
            self.state = FAULT
        applied = 0.0
        if self.state == ENABLED:
            if loop is not None:
                numbers = discrete_coefficients(parameters_to_cascade(self.stored), PERIOD_S, self.stored["torque_limit_nm"])
                torque_nm = cascade_step(numbers, self._loop, *loop, self.position_rad(), torque_nm)
            applied = STEP_NM * round(float(np.clip(torque_nm, -self.stored["torque_limit_nm"], self.stored["torque_limit_nm"])) / STEP_NM)
        elif abs(self.machine.velocity_rad_s) > 1e-3:  # its brake chopper
            applied = -min(RATED_NM, 0.1 * abs(self.machine.velocity_rad_s)) * math.copysign(1.0, self.machine.velocity_rad_s)
        self.torque_nm = applied
        self.machine.step(applied, PERIOD_S)
        self.cycles += 1


class ExampleClock:
    """Time of the amplifier: it goes on with its cycles.  With hardware: ``time.monotonic`` and ``time.sleep``."""

    def __init__(self, amplifier: Amplifier) -> None:
        self._amplifier = amplifier

    def now(self) -> float:
        """See :class:`beltcomm.drive.Clock`."""
        return self._amplifier.cycles * PERIOD_S

    def sleep_until(self, t_s: float) -> None:
        """See :class:`beltcomm.drive.Clock`."""
        while self.now() < t_s - 1e-9:
            self._amplifier.cycle(0.0, alive=False)


class ExampleDrive:
    """A :class:`beltcomm.drive.Drive`."""

    def __init__(self, amplifier: Amplifier) -> None:
        self._amplifier = amplifier
        self._seen: Guarding | None = None
        self.clock: Clock = ExampleClock(amplifier)
        self.capabilities = Capabilities(
            name="example",
            kinds=frozenset({"torque", "position"}),
            sample_period_s=PERIOD_S,
            counts_per_rev=COUNTS,
            torque_step_nm=STEP_NM,
            torque_sampling="over",
            structure=CascadeStructure(
                "example",
                PERIOD_S,
                prefilters=("none", "notch", "butterworth"),
                velocity_feedforward=True,
                torque_feedforward=True,
                reference_filter=True,
            ),
            rated_torque_nm=RATED_NM,
            peak_torque_nm=PEAK_NM,
            rated_current_a=2.2,
            max_speed_rad_s=TOP_RAD_S,
            can_home=False,
            referenced=False,
            identity={"maker": "example", "serial_number": "1", "device_type": "00020192h"},
            torque_along=frozenset({"position"}),
            refused={"velocity": NO_VELOCITY},
            shortest_guard_s=0.01,
        )

    # What it is and holds

    def read(self, names: Sequence[str]) -> dict[str, float]:
        """See :class:`beltcomm.drive.Drive`."""
        amplifier = self._amplifier
        now = {
            "position_rad": amplifier.position_rad(),
            "velocity_rad_s": amplifier.machine.velocity_rad_s,
            "torque_nm": amplifier.torque_nm,
            "state": amplifier.state,
            "referenced": 0.0,
            **amplifier.stored,
        }
        if unknown := [name for name in names if name not in now]:
            raise UsageError(f"this drive has no quantity {', '.join(unknown)}; it has {', '.join(now)}")
        return {name: now[name] for name in names}

    def backup(self) -> dict[str, float]:
        """See :class:`beltcomm.drive.Drive`."""
        return dict(self._amplifier.stored)

    def write(self, values: Mapping[str, float]) -> dict[str, float]:
        """See :class:`beltcomm.drive.Drive`: everything or nothing, with the stage off, read back."""
        if unknown := [name for name in values if name not in FACTORY]:
            raise UsageError(f"this drive has no parameter {', '.join(unknown)}; it has {', '.join(FACTORY)}")
        if wrong := [name for name, value in values.items() if not (math.isfinite(value) and value >= 0.0)]:
            raise UsageError(f"{wrong[0]} is {values[wrong[0]]:g}; give a number that is not negative")
        self.stop()
        self._amplifier.stored.update(values)
        return self.read(list(values))

    def calibrate(self, units: Mapping[str, float]) -> None:
        """Nothing of it is uncalibrated: its gains are in SI."""
        if units:
            raise UsageError(f"the gains of this drive are documented; {', '.join(units)} cannot be calibrated")

    def objects(self) -> tuple[ObjectValue, ...]:
        """It has no dictionary of objects."""
        return ()

    def read_objects(self, places: Sequence[tuple[int, int, str]]) -> list[float | None]:
        """None for each: see :meth:`objects`."""
        return [None] * len(places)

    def write_objects(self, values: Sequence[ObjectValue]) -> None:
        """Refused: see :meth:`objects`."""
        if values:
            raise UsageError("this drive has no objects to write; its parameters have names")

    def save(self) -> None:
        """Refused where a drive cannot: say what to do instead."""
        raise UsageError("this drive keeps its parameters only until it is switched off; write them at each start")

    def home(self, limits: Limits) -> None:
        """Refused where a drive cannot."""
        raise Refused("this drive has no homing of its own; say where the carriage stands with --position")

    # Motion

    def record(self, motion: Motion, limits: Limits, sink: Sink) -> ExchangeReport:
        """See :class:`beltcomm.drive.Drive`."""
        self._refuse(motion, limits)
        if motion.kind == "torque":
            self.prove_guarding(limits, motion.rest_nm)
        amplifier, begun, rows = self._amplifier, self.clock.now(), 0
        acceleration = np.gradient(motion.velocity_rad_s, motion.period_s) if len(motion.velocity_rad_s) > 1 else np.zeros(1)
        try:
            amplifier.watchdog_s = limits.guard_s
            amplifier.enable()
            for k, torque in enumerate(motion.torque_nm.tolist()):
                t, position, velocity = self.clock.now() - begun, amplifier.position_rad(), amplifier.machine.velocity_rad_s
                reference = (float(motion.position_rad[k]), float(motion.velocity_rad_s[k]), float(acceleration[k]))
                amplifier.cycle(torque, reference if motion.kind == "position" else None)
                if amplifier.state == FAULT:
                    raise DriveFault("the amplifier went into fault in a motion; look at its display", 0x1000)
                self._watch(position, velocity, limits)
                closed = (*reference[:2], torque) if motion.kind == "position" else (math.nan,) * 3
                row: Row = (t, amplifier.torque_nm, torque if motion.kind == "torque" else amplifier.torque_nm, position, velocity, *closed)
                sink(row)  # may raise anything: the axis is stopped then, and the exception goes on
                rows += 1
        finally:
            self.stop()
        return ExchangeReport(rows, lost_cycles=0, worst_jitter_s=0.0)

    def _refuse(self, motion: Motion, limits: Limits) -> None:
        """Everything that can be refused is, before anything moves."""
        if motion.kind not in self.capabilities.kinds:
            raise UsageError(f"example cannot do this: {self.capabilities.refused.get(motion.kind, 'it offers torque and position only.')}")
        if abs(motion.period_s - PERIOD_S) > 1e-9:
            raise UsageError(f"the motion has {1e3 * motion.period_s:g} ms per sample, this drive {1e3 * PERIOD_S:g} ms; sample it anew")
        peak = float(np.max(np.abs(motion.torque_nm)))
        if peak > limits.torque_nm:
            raise UsageError(f"the motion asks for {peak:.4g} N m, the limit is {limits.torque_nm:.4g} N m; reduce the amplitude")
        low, high = float(np.min(motion.position_rad)), float(np.max(motion.position_rad))
        if motion.kind == "position" and not (limits.position_min_rad <= low and high <= limits.position_max_rad):
            raise UsageError(f"the motion goes from {limits.where(low)} to {limits.where(high)}, which is outside the window; shorten it")

    def _watch(self, position: float, velocity: float, limits: Limits) -> None:
        """The limits, row by row."""
        if not limits.position_min_rad <= position <= limits.position_max_rad:
            raise SafetyStop(f"the position reached {limits.where(position)}, outside the window; shorten the motion", "position")
        if abs(velocity) > limits.speed_rad_s:
            raise SafetyStop(f"{velocity:.4g} rad/s, the limit is {limits.speed_rad_s:.4g} rad/s; reduce the amplitude", "speed")

    def prove_guarding(self, limits: Limits, rest_nm: float = 0.0) -> Guarding:
        """See :class:`beltcomm.drive.Drive`: fall silent at standstill, see what happens, acknowledge the fault."""
        if self._seen is not None:
            return self._seen
        amplifier, begun = self._amplifier, self.clock.now()
        amplifier.watchdog_s = limits.guard_s
        try:
            amplifier.enable()
            while amplifier.state == ENABLED:
                amplifier.cycle(rest_nm, alive=False)
                if self.clock.now() - begun > limits.guard_s + 0.05:
                    raise DriveError(f"the drive did not react within {1e3 * limits.guard_s + 50:.0f} ms; it gets no torque")
        finally:
            self.stop()
        self._seen = Guarding(limits.guard_s, self.clock.now() - begun, brakes=True)
        return self._seen

    def stop(self) -> None:
        """See :class:`beltcomm.drive.Drive`: to rest, stage off, fault acknowledged; never raises."""
        amplifier = self._amplifier
        amplifier.state = DISABLED
        for _ in range(5000):
            if abs(amplifier.machine.velocity_rad_s) < 1e-2:
                break
            amplifier.cycle(0.0)

    def close(self) -> None:
        """See :class:`beltcomm.drive.Drive`: what was changed for this session goes back; twice does no harm."""
        self.stop()
        self._amplifier.watchdog_s = math.inf

    def __enter__(self) -> Drive:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def open_example(address: str, options: Mapping[str, object]) -> Drive:
    """The drive at ``address``.   plant : the machine behind the simulated amplifier."""
    if unknown := sorted(set(options) - {"plant"}):
        raise UsageError(f"the example drive has no option {', '.join(unknown)}; leave it out")
    machine: Any = options.get("plant") or Motor()
    return ExampleDrive(Amplifier(machine))


ADAPTER = Adapter(name="example", summary="example: the adapter of docs/adapter-guide.md", schemes=("example",), open=open_example)
