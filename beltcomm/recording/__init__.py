"""One experiment: signals that were checked once and never change, and what was done.

Formats: ``run-folder.md``.  Torque and motion are at the motor shaft (side "motor"), or on the load side where only that is
known (side "load"), or the torque is in ampere where no torque constant is known (side "ampere"), or only the motor's voltage is
known (side "volt").
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from beltcomm import atomic
from beltcomm.arrays import Array, Column
from beltcomm.axis import Axis
from beltcomm.configfiles import to_yaml, write_text
from beltcomm.errors import DataError, NoMotion, UsageError
from beltcomm.quantities import unit_of
from beltcomm.recording.checks import CLIPPED_SHARE, clipped_share, gaps, jitter, reference_unit_fault, usual_step, velocity_unit_fault
from beltcomm.recording.columns import CHANNELS, COMMON, INERTIA_UNIT, KNOWN_COLUMNS, Side, side_of
from beltcomm.recording.sidecar import ExcitationNote, Sidecar, load_sidecar
from beltcomm.recording.signalfile import read_columns, write_columns
from beltcomm.recording.writer import RecordingWriter

__all__ = [
    "ExcitationNote",
    "Recording",
    "RecordingWriter",
    "Sidecar",
    "common_side",
    "load_recording",
    "recording_from_columns",
    "save_recording",
]

#: What was asked of a signal.
_REFERENCES: Final = {"position": "reference_position", "velocity": "reference_velocity", "torque": "torque_setpoint"}
_OPTIONAL = ("torque_setpoint", "velocity", "reference_position", "reference_velocity", "torque_offset", *COMMON)
#: Fewer samples are no measurement of a motion (a static map: of a position dependence).
FEWEST_SAMPLES = {"static_map": 3}
FEWEST_SAMPLES_IN_TIME = 10
#: Steps in time above this, s, are milliseconds or sample numbers: no drive is commissioned at 4 Hz.
LONGEST_STEP_S = 0.25


@dataclass(frozen=True, eq=False)
class Recording:
    """The signals of one experiment, arrays of one length n, checked and read-only; copied where anybody could write into them.

    Attributes
    ----------
    t_s : ndarray (n,), s
        Strictly rising; of a static map ndarray (0,): it has no time.
    torque : ndarray (n,)
        N m at the motor shaft (side "load": N; "ampere": A; "volt": V); torque[n] acts from t[n] to t[n+1].
    position : ndarray (n,), rad
        Motor shaft (side "load": m), sampled at t[n].
    torque_setpoint, velocity, reference_position, reference_velocity : ndarray or None
        ndarray (n,) in the same units, None where absent.
    torque_offset : ndarray (n,) or None
        What was added to a controller's torque; None where absent.
    temperature_c, cart_position_m, load_position_rad : ndarray (n,) or None
        None where absent.
    side : Side
        Which of the three.
    sidecar : Sidecar
        What was done.
    notes : tuple of str
        Sentences on what was ignored or looks odd.
    extra : dict of str to ndarray
        Further columns by name, kept and not used.
    file : str
        Where it came from, for messages.

    Raises
    ------
    DataError
        Naming file, column and row, for signals that no method can use.
    """

    name: str
    t_s: Array
    torque: Array
    position: Array
    torque_setpoint: Array | None = None
    velocity: Array | None = None
    reference_position: Array | None = None
    reference_velocity: Array | None = None
    torque_offset: Array | None = None
    temperature_c: Array | None = None
    cart_position_m: Array | None = None
    load_position_rad: Array | None = None
    side: Side = "motor"
    sidecar: Sidecar = field(default_factory=Sidecar)
    notes: tuple[str, ...] = ()
    extra: Mapping[str, Column] = field(default_factory=dict)
    file: str = ""

    def __post_init__(self) -> None:
        self._freeze()
        self._check_size()
        self._check_signals()
        object.__setattr__(self, "notes", (*self.notes, *self._remarks()))

    @cached_property
    def is_static_map(self) -> bool:
        """True if this is position against holding torque, without time."""
        return self.sidecar.experiment == "static_map"

    @cached_property
    def sample_period_s(self) -> float:
        """Time step between samples none of which was lost, s.

        Raises
        ------
        DataError
            For a static map.
        """
        if self.is_static_map:
            raise self._fault("it is a static map and has no time; use a record with t_s")
        return usual_step(self.t_s)

    @property
    def duration_s(self) -> float:
        """From the first to the last sample, s."""
        return float(self.t_s[-1] - self.t_s[0])

    @property
    def torque_unit(self) -> str:
        """Unit of torque and torque_setpoint: "N m", "N", "A" or "V"."""
        return unit_of(CHANNELS[self.side]["torque"])

    @property
    def position_unit(self) -> str:
        """Unit of position and reference_position: "rad" or "m"."""
        return unit_of(CHANNELS[self.side]["position"])

    @property
    def inertia_unit(self) -> str:
        """Unit of torque over acceleration: "kg m²", "kg" or "A s²/rad" (inertia over the unknown torque constant)."""
        return INERTIA_UNIT[self.side]

    @cached_property
    def gaps(self) -> NDArray[np.intp]:
        """Indices of the samples after which samples were lost."""
        return gaps(self.t_s)

    @property
    def gap_remark(self) -> str:
        """Where samples were lost, in words; empty where none were."""
        lost, steps = self.gaps, np.diff(self.t_s)
        if not len(lost):
            return ""
        worst = lost[int(np.argmax(steps[lost]))]
        return f"samples were lost at {len(lost)} places, the longest gap is {steps[worst]:.4g} s at t = {self.t_s[worst]:.6g} s"

    @cached_property
    def pieces(self) -> tuple[tuple[int, int], ...]:
        """Gapless pieces in time: first sample, and the one behind the last, of each."""
        return tuple(pairwise([0, *(int(i) + 1 for i in self.gaps), len(self.t_s)]))

    def columns(self) -> dict[str, Column]:
        """The columns of its file by name, in the file's order."""
        channels = CHANNELS[self.side]
        named = {} if self.is_static_map else {"t_s": self.t_s}
        named |= {channels[signal]: getattr(self, signal) for signal in channels if getattr(self, signal) is not None}
        named |= {signal: getattr(self, signal) for signal in COMMON if getattr(self, signal) is not None}
        return named | {name: column for name, column in self.extra.items() if name not in named}

    def check_against(self, axis: Axis) -> None:
        """Check the record against the axis: travel, carriage sensor, unit of torque.

        Only what the axis states is checked; 5 % are left for mounting and data-sheet tolerances.

        Parameters
        ----------
        axis : Axis
            That was recorded.

        Raises
        ------
        DataError
            When the record contradicts the axis.
        """
        if self.side == "load":
            ratio: float | None = 1.0
        else:
            ratio = axis.known_transmission_m_rad
        low, high = axis.travel.min_m, axis.travel.max_m
        moved = float(np.ptp(self.position))
        column = CHANNELS[self.side]["position"]
        if ratio is not None and low is not None and high is not None and moved * ratio > 1.05 * (high - low):
            raise self._fault(
                f"{column} covers {moved:.6g} {self.position_unit}, which is {moved * ratio:.6g} m of travel, more than the "
                f"{high - low:.6g} m of {axis}; look at the column's unit (degrees? counts? mm?) and at the pulley radius"
            )
        start = self.sidecar.start_position_m
        if ratio is not None and start is not None and low is not None and high is not None:
            reached = start + ratio * (self.position - self.position[0])
            if reached.min() < low - 0.05 * (high - low) or reached.max() > high + 0.05 * (high - low):
                raise self._fault(
                    f"from start_position_m {start:.6g} m the carriage goes from {reached.min():.6g} to {reached.max():.6g} m, "
                    f"outside the travel {low:g}..{high:g} m of {axis}; correct start_position_m or the axis file, "
                    "or the sign of the angle"
                )
        if ratio is not None and self.cart_position_m is not None and moved > 0.0:
            quotient = float(np.ptp(self.cart_position_m)) / (moved * ratio)
            if abs(quotient / 1000.0 - 1.0) < 0.2:
                raise self._fault("cart_position_m is in mm: it moves 1000 times as far as the motor says; divide it by 1000")
        if self.side in ("ampere", "volt"):
            return
        entry = "motor.peak_torque_nm" if self.side == "motor" else "limits.feed_force_n"
        limit, largest = axis.get(entry), float(np.abs(self.torque).max())
        if limit is not None and largest > 1.5 * limit:
            unit = self.torque_unit
            raise self._fault(
                f"{CHANNELS[self.side]['torque']} reaches {largest:.4g} {unit}, {axis} gives at most {limit:g} {unit}; "
                f"look at the column's unit (thousandths? per cent of rated?) and at {entry}"
            )

    def _label(self) -> str:
        return self.file or f"recording {self.name!r}"

    def _fault(self, text: str) -> DataError:
        return DataError(f"{self._label()}: {text}")

    def _freeze(self) -> None:
        """Own, read-only float arrays of one dimension."""
        for signal in ("t_s", "torque", "position", *_OPTIONAL):
            values = getattr(self, signal)
            if values is not None:
                if not _unchanging(values):
                    values = np.array(values, dtype=np.float64)
                if values.ndim != 1:
                    raise self._fault(f"{signal} has {values.ndim} dimensions; give one value per sample")
                values.setflags(write=False)
                object.__setattr__(self, signal, values)
        if self.side not in CHANNELS:
            raise self._fault(f"side is {self.side!r}; it is one of {', '.join(CHANNELS)}")

    def _check_size(self) -> None:
        if self.is_static_map:
            object.__setattr__(self, "t_s", np.zeros(0))
            self.t_s.setflags(write=False)
        samples = len(self.torque)
        for signal in ("position", *(() if self.is_static_map else ("t_s",)), *_OPTIONAL):
            values = getattr(self, signal)
            if values is not None and len(values) != samples:
                raise self._fault(f"{signal} has {len(values)} samples, torque has {samples}; they must be equally long")
        fewest = FEWEST_SAMPLES.get(self.sidecar.experiment, FEWEST_SAMPLES_IN_TIME)
        if samples < fewest:
            raise self._fault(f"it has {samples} samples, at least {fewest} are needed; record longer")

    def _check_signals(self) -> None:
        channels = CHANNELS[self.side]
        for signal in ("t_s", "torque", "position", *_OPTIONAL):
            values = getattr(self, signal)
            if values is not None and not np.all(np.isfinite(values)):
                row = int(np.flatnonzero(~np.isfinite(values))[0])
                column = channels.get(signal, signal)
                raise self._fault(f"{column} in row {row + 1} is {values[row]}; leave out the rows without a value")
        if not self.is_static_map:
            self._check_time()
        for signal in ("torque", "position"):
            values = getattr(self, signal)
            if np.ptp(values) == 0.0:
                constant = f"{channels[signal]} is {values[0]:.6g} {unit_of(channels[signal])} in every row"
                if signal == "torque" or self.is_static_map:
                    raise self._fault(f"{constant}: the column is wrong; record it again")
                most, lasts = float(np.abs(self.torque).max()), self.duration_s
                raise NoMotion(
                    f"{self._label()}: {constant}: the axis did not move, {most:.3g} {self.torque_unit} at most in {lasts:.3g} s did not "
                    "break it away: friction, a brake or a clamp holds more. Record it again with more torque, or longer; if it did move, "
                    "the column or the encoder is wrong",
                    self._excited_nm() or most,
                )
        clipped = self._clipped()
        if clipped and not self.sidecar.accepted:
            raise self._fault(f"{clipped}; record again with a smaller amplitude or a larger range, or say why it holds: --accept REASON")
        if self.velocity is not None and not self.is_static_map:
            fault = velocity_unit_fault(self.t_s, self.position, self.velocity)
            if fault:
                names = f"{channels['position']} and {channels['velocity']}"
                raise self._fault(f"{names} contradict each other: {fault}; convert the column")
        for signal, reference in _REFERENCES.items():
            values, asked = getattr(self, signal), getattr(self, reference)
            fault = reference_unit_fault(values, asked) if values is not None and asked is not None else ""
            if fault:
                raise self._fault(f"{channels[signal]} and {channels[reference]} contradict each other: {fault}; convert the column")

    def _clipped(self) -> str:
        """That the torque is clipped, in words; "" when it is not."""
        share = 0.0 if self.is_static_map else clipped_share(self.torque, self.torque_setpoint, self._excited_nm())
        if share < CLIPPED_SHARE:
            return ""
        return (
            f"{CHANNELS[self.side]['torque']} is clipped at {np.abs(self.torque).max():.4g} {self.torque_unit} in {100.0 * share:.0f} % of "
            f"the rows (allowed: {100.0 * CLIPPED_SHARE:.0f} %)"
        )

    def _excited_nm(self) -> float | None:
        """Amplitude of the torque that excited the axis, N m, in open loop; None where there was none."""
        note = self.sidecar.excitation
        return note.amplitude_nm if note is not None and not self.sidecar.closed_loop else None

    def _check_time(self) -> None:
        steps = np.diff(self.t_s)
        if np.any(steps <= 0.0):
            row = int(np.flatnonzero(steps <= 0.0)[0]) + 1
            before, after = float(self.t_s[row - 1]), float(self.t_s[row])
            raise self._fault(f"t_s in row {row + 1} is {after!r} s, not above {before!r} s in the row before; time must rise")
        if np.median(steps) > LONGEST_STEP_S:
            raise self._fault(
                f"t_s rises by {np.median(steps):.4g} s per row, above {LONGEST_STEP_S:g} s: "
                "it looks like milliseconds or sample numbers; give it in seconds"
            )

    def _remarks(self) -> list[str]:
        """Sentences on what is odd but usable."""
        remarks = []
        if not self.sidecar.finished:
            remarks.append("the record was broken off")
        if self.sidecar.accepted and (clipped := self._clipped()):
            remarks.append(f"{clipped}: accepted, {self.sidecar.accepted}")
        for signal in ("velocity", *COMMON):
            values = getattr(self, signal)
            if values is not None and np.ptp(values) == 0.0:
                remarks.append(f"{CHANNELS[self.side].get(signal, signal)} never changes")
        if self.side == "ampere":
            remarks.append("no torque constant is known: torque is in ampere, and so is everything identified from it")
        if self.side == "volt":
            remarks.append(
                "only the motor's voltage is known, so everything is identified in volt: viscous friction has the back-EMF in it, and the "
                "torque per volt is the inertia over the one that is found"
            )
        if self.is_static_map:
            return remarks
        remarks += filter(None, [self.gap_remark])
        spread = jitter(self.t_s, self.gaps)
        if spread > 0.05:
            remarks.append(f"the time steps deviate by up to {100.0 * spread:.0f} % from {self.sample_period_s:.4g} s")
        return remarks


def _unchanging(values: Any) -> bool:
    """True if nobody can write into an array of numbers, nor into what it is a part of: then it needs no copy."""
    if not isinstance(values, np.ndarray) or values.dtype != np.float64:
        return False
    part: Any = values
    while isinstance(part, np.ndarray):
        if part.flags.writeable:
            return False
        part = part.base
    return part is None


def load_recording(path: Path | str, axis: Axis | None = None) -> Recording:
    """Load ``NAME.csv`` with its sidecar ``NAME.yaml``; without one the record is ``free``.

    Parameters
    ----------
    path : Path or str
        Also ``NAME.csv.part``, what was written before a record was broken off.
    axis : Axis or None
        Scales current_a by its torque constant, and the record is checked against it.

    Returns
    -------
    Recording
        Checked, in SI units.

    Raises
    ------
    DataError
        Naming file, column and row.
    """
    path = Path(path)
    name = path.name.removesuffix(".part").removesuffix(".csv")
    note_path = path.with_name(f"{name}.yaml")
    sidecar, notes = load_sidecar(note_path) if note_path.is_file() else (Sidecar(), ())
    columns = read_columns(path, KNOWN_COLUMNS, torn=path.name.endswith(".part"))
    return recording_from_columns(name, columns, sidecar, axis, notes=notes, file=str(path))


def recording_from_columns(
    name: str,
    columns: Mapping[str, Column],
    sidecar: Sidecar,
    axis: Axis | None = None,
    *,
    notes: tuple[str, ...] = (),
    file: str = "",
) -> Recording:
    """Make a recording of named columns, as :func:`load_recording` does; unknown columns are kept and not used.

    Parameters
    ----------
    name : str
        Of the recording.
    columns : dict of str to ndarray
        By name with the unit as suffix, (n,) each.
    sidecar : Sidecar
        What was done.
    axis : Axis or None
        Scales current_a by its torque constant, and the record is checked against it.
    notes : tuple of str
        Remarks to be kept.
    file : str
        For messages.

    Returns
    -------
    Recording
        Checked, in SI units.

    Raises
    ------
    DataError
        When the columns of every side are incomplete, and as :class:`Recording`.
    """
    rest = dict(columns)
    side = side_of(file or f"recording {name!r}", rest, timed=sidecar.experiment != "static_map")
    channels = {"t_s": "t_s", **CHANNELS[side], **{signal: signal for signal in COMMON}}
    signals = {signal: rest.pop(column) for signal, column in channels.items() if column in rest}
    if rest:
        notes = (*notes, f"columns kept and ignored: {', '.join(rest) or 'one without a name'}")
    constant = axis.motor.torque_constant_nm_a if axis is not None else None
    if side == "ampere" and constant is not None:
        side = "motor"
        signals |= {signal: signals[signal] * constant for signal in ("torque", "torque_setpoint") if signal in signals}
        notes = (*notes, f"torque is current_a times the torque constant of {constant:g} N m/A")
    signals.setdefault("t_s", np.zeros(0))
    recording = Recording(name=name, side=side, sidecar=sidecar, notes=notes, extra=rest, file=file, **signals)
    if axis is not None:
        recording.check_against(axis)
    return recording


def save_recording(recording: Recording, folder: Path) -> Path:
    """Write ``NAME.csv`` and ``NAME.yaml``; floats come back exactly.

    Parameters
    ----------
    recording : Recording
        To be written.
    folder : Path
        Where.

    Returns
    -------
    Path
        Path of the CSV.

    Raises
    ------
    DataError
        When a recording of that name exists: raw recordings never change.
    UsageError
        When writing fails.
    """
    path = folder / f"{recording.name}.csv"
    if path.exists():
        raise DataError(f"{path} exists and raw recordings are never changed; choose another name")
    part = path.with_name(f"{path.name}.part")
    write_columns(part, recording.columns())
    write_text(path.with_suffix(".yaml"), to_yaml(recording.sidecar.to_dict()))
    try:
        os.replace(part, path)  # last, as a RecordingWriter does: whenever the process dies, a record without NAME.csv is unfinished
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror or error}; choose another place") from error
    atomic.sync(folder)
    return path


def common_side(recordings: Iterable[Recording]) -> Side:
    """The side of the gearbox that all recordings of one axis are from.

    Parameters
    ----------
    recordings : iterable of Recording
        Of one axis.

    Returns
    -------
    Side
        "motor", "load", "ampere" or "volt".

    Raises
    ------
    DataError
        When they differ: then they are of two axes.
    """
    sides: dict[Side, str] = {}
    for recording in recordings:
        sides.setdefault(recording.side, recording.name)
    if len(sides) > 1:
        units = {side: [unit_of(CHANNELS[side][signal]) for signal in ("torque", "position")] for side in sides}
        listed = ", ".join(f"{name} in {' and '.join(units[side])}" for side, name in sides.items())
        constant = "; or state motor.torque_constant_nm_a" if set(sides) == {"motor", "ampere"} else ""
        raise DataError(f"the recordings are not of one axis ({listed}); keep those of each axis in a run of its own{constant}")
    return next(iter(sides), "motor")
