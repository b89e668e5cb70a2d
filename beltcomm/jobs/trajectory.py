"""A jerk-limited motion into a file: ``beltcomm trajectory``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path

import numpy as np

from beltcomm.design.led_reference import led_reference
from beltcomm.errors import UsageError
from beltcomm.experiments.options import Options
from beltcomm.given import Place, may_write, number, pasted, place
from beltcomm.recording.signalfile import write_columns
from beltcomm.result import Result, plain
from beltcomm.rundata import offline
from beltcomm.rundata.store import as_in_drive, saved_design, structure_from_dict
from beltcomm.runfolder import RunFolder
from beltcomm.sentences.own_words import own_words
from beltcomm.talk import Silence, Talk
from beltcomm.trajectory import Trajectory, with_dwell
from beltcomm.trajectory.seven_phases import MotionBounds, MotionState, SevenPhases, bounds_reached, fastest_motion, on_grid

#: Bounds of a motion upwards -> what they are called along the way, whichever way it leads; as the options of the command line.
ALONG: Mapping[str, str] = {
    "velocity_max_m_s": "speed",
    "velocity_min_m_s": "speed back",
    "acceleration_max_m_s2": "acceleration",
    "acceleration_min_m_s2": "deceleration",
    "jerk_max_m_s3": "jerk",
    "jerk_min_m_s3": "jerk down",
}
_UNITS = {"velocity": "m/s", "acceleration": "m/s²", "jerk": "m/s³"}

#: s: rest after a motion with a led reference.
LED_REST_S = 0.5
#: Rows of a motion: three hours at 1 kHz, 1 GB.
MOST_ROWS = 10_000_000
#: A smallest value this much smaller than the largest is zero, with the rounding of a sum.
ROUNDING = 1e-12


@own_words
def trajectory(
    file: Place,
    start_m: float,
    end_m: float,
    *,
    speed_m_s: float,
    acceleration_m_s2: float,
    jerk_m_s3: float,
    speed_back_m_s: float | None = None,
    deceleration_m_s2: float | None = None,
    jerk_down_m_s3: float | None = None,
    start_velocity_m_s: float = 0.0,
    start_acceleration_m_s2: float = 0.0,
    end_velocity_m_s: float = 0.0,
    end_acceleration_m_s2: float = 0.0,
    period_s: float = 1e-3,
    led: Place | None = None,
    options: Options | None = None,
    talk: Talk | None = None,
) -> Result:
    """The fastest motion between two states into a CSV file: t_s, position_m, velocity_m_s, acceleration_m_s2, jerk_m_s3.

    Limits hold along the way from start to end, all positive: speed and speed back, acceleration and deceleration, jerk (rate at which the
    acceleration may rise) and jerk down (at which it may fall); what is left out is as its counterpart.  States are the axis's, signed.
    The jerk of a row is that from its moment on; that of the last row, the one before.

    Parameters
    ----------
    file : Place
        To be written, CSV.
    start_m : float, m
        First position.
    end_m : float, m
        Last position.
    speed_m_s : float, m/s
        Limit from start to end.
    acceleration_m_s2 : float, m/s²
        Limit from start to end.
    jerk_m_s3 : float, m/s³
        Rate at which the acceleration may rise.
    speed_back_m_s : float or None, m/s
        Limit the other way; None for ``speed_m_s``.
    deceleration_m_s2 : float or None, m/s²
        None for ``acceleration_m_s2``.
    jerk_down_m_s3 : float or None, m/s³
        Rate at which the acceleration may fall; None for ``jerk_m_s3``.
    start_velocity_m_s : float, m/s
        signed.
    start_acceleration_m_s2 : float, m/s²
        signed.
    end_velocity_m_s : float, m/s
        signed.
    end_acceleration_m_s2 : float, m/s²
        signed.
    period_s : float, s
        Of the rows.
    led : Place or None
        Run folder of a drive without feedforward: the file holds the reference that leads its axis along the motion, with the rest that it
        takes before and after.
    options : Options or None
        Settings beside the main arguments; None for the safe defaults.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        Duration and what was reached.

    Raises
    ------
    UsageError
    Refused
        No such motion; the file exists and ``options.yes`` was not given.
    """
    file, options, talk = place(file, "file"), options or Options(), talk or Silence()
    along = _along(speed_m_s, speed_back_m_s, acceleration_m_s2, deceleration_m_s2, jerk_m_s3, jerk_down_m_s3)
    start_m, end_m = number(start_m, "start_m", "m"), number(end_m, "end_m", "m")
    start = MotionState(start_m, start_velocity_m_s, start_acceleration_m_s2)
    end = MotionState(end_m, end_velocity_m_s, end_acceleration_m_s2)
    down = end_m < start_m
    bounds = along.mirrored() if down else along
    fastest = fastest_motion(start, end, bounds)
    _check_rows(fastest.duration_s, number(period_s, "period_s", "s"), along)
    motion = on_grid(start, end, bounds, period_s)
    sampled = motion.sampled(period_s)
    may_write(file, options.yes, talk)
    if led is not None:
        return _led(file, sampled, RunFolder.open(place(led, "led")))
    columns = {name: getattr(sampled, name) for name in ("t_s", "position_m", "velocity_m_s", "acceleration_m_s2")}
    write_columns(file, {**columns, "jerk_m_s3": motion.at(sampled.t_s)[3]})
    touched = bounds_reached(fastest.mirrored() if down else fastest, along)
    binding = [words for name, words in ALONG.items() if name in touched]
    data = {
        "file": str(file),
        "samples": len(sampled.t_s),
        "sample_period_s": period_s,
        "duration_s": motion.duration_s,
        "fastest_s": fastest.duration_s,
        "start": plain(start),
        "end": plain(end),
        "bounds": plain(bounds),
        "extremes": plain(motion.extremes()),
        "binding": binding,
        "phases": {"durations_s": plain(motion.durations_s), "jerks_m_s3": plain(motion.jerks_m_s3)},
    }
    return Result(data, _lines(file, motion, fastest, bounds, period_s, binding))


def _led(file: Path, sampled: Trajectory, folder: RunFolder) -> Result:
    """The reference that a run's drive has to be sent for a motion of the carriage, in metres, rad and units of the drive."""
    saved, drive = saved_design(folder), folder.load_result("drive")
    if drive is None:
        raise UsageError(f"{folder.path} knows no drive whose loops a reference could be led by; commission the axis first")
    model = offline.design_model(folder, saved)
    structure = structure_from_dict(drive)
    cascade, delay_s = offline.cascade_of(saved, model, structure, None)
    found = led_reference(model, with_dwell(sampled, LED_REST_S), as_in_drive(folder, cascade), structure, delay_s)
    reference_rad = found.sent.position_m / model["transmission.ratio"]
    units = float(folder.drive.get("units_per_turn") or 0.0) / math.tau
    columns = {"t_s": found.motor.t_s, "reference_m": found.sent.position_m, "reference_rad": reference_rad}
    if units:
        columns["reference_units"] = np.rint(units * reference_rad)
    write_columns(file, {**columns, "motor_m": found.motor.position_m, "carriage_m": found.carriage.position_m})
    lead = float(np.max(np.abs(found.lead_m)))
    data = {"file": str(file), "samples": len(found.motor.t_s), "lead_m": lead, "duration_s": found.motor.duration_s}
    return Result(
        data,
        [
            f"{file} is written: {len(found.motor.t_s)} rows, reference_m is what the drive is to be sent, one row each period",
            f"  lead of the reference   up to {1e3 * lead:.0f} mm: its following error window (6065h) and software limits (607Dh) must be",
            f"                          wider by that, and its position controller may ask for {lead * cascade.kpp_1_s:.3g} m/s",
            "  positions count from the zero of the axis; the gains of the run's design must stand in the drive",
        ],
    )


def _check_rows(duration_s: float, period_s: float, along: MotionBounds) -> None:
    """Raise UsageError for more rows than anybody can use, with the numbers that ask for them."""
    if not period_s > 0.0:
        raise UsageError(f"the period is {period_s:g} s; it must be positive")
    if duration_s / period_s > MOST_ROWS:
        raise UsageError(
            f"the motion takes {duration_s:.4g} s at a speed of {along.velocity_max_m_s:g} m/s, {duration_s / period_s:.3g} rows of "
            f"{period_s:g} s; at most {MOST_ROWS} are written: give a larger speed, acceleration or jerk, or a longer period"
        )


def _along(speed: float, back: float | None, up: float, down: float | None, rise: float, fall: float | None) -> MotionBounds:
    """Bounds of a motion upwards; raises UsageError for a limit that is not positive; no speed back is possible."""
    given = {"speed": speed, "acceleration": up, "deceleration": down, "jerk": rise, "jerk down": fall}
    for name, value in given.items():
        if value is not None and not value > 0.0:
            raise UsageError(f"the {name} is {value:g}; give a positive number, which holds along the way from start to end")
    if back is not None and not back >= 0.0:
        raise UsageError(f"the speed back is {back:g}; give 0, which forbids to move back, or a positive number")
    return MotionBounds(-(speed if back is None else back), speed, -(down or up), up, -(fall or rise), rise)


def _lines(file: Path, motion: SevenPhases, fastest: SevenPhases, bounds: MotionBounds, period_s: float, binding: list[str]) -> list[str]:
    start, end, extremes = motion.start, motion.end, motion.extremes()
    rows = round(motion.duration_s / period_s) + 1
    lines = [f"{file} is written: {start.position_m:g} to {end.position_m:g} m in {motion.duration_s:.6g} s, {rows} rows"]
    longer = motion.duration_s - fastest.duration_s
    ends = f"; {1e3 * longer:.3g} ms more let it end on a sample of {1e3 * period_s:g} ms" if longer > 1e-9 * motion.duration_s else ""
    lines.append(f"  fastest possible   {fastest.duration_s:.6g} s{ends}")
    for name, unit in _UNITS.items():
        low, high = getattr(extremes, next(f.name for f in fields(extremes) if f.name.startswith(name)))
        low, high = (0.0 if abs(value) < ROUNDING * max(abs(low), abs(high)) else value for value in (low, high))
        bound = [getattr(bounds, key) for key in ALONG if key.startswith(name)]
        word = "speed" if name == "velocity" else name
        lines.append(f"  {word:18} {low:.4g} to {high:.4g} {unit}, allowed {min(bound):g} to {max(bound):g}")
    lines.append(f"  limited by         {', '.join(binding)}")
    lines.append(f"  phases 1 to 7      {', '.join(f'{1e3 * t:.4g}' for t in motion.durations_s)} ms")
    low, high = extremes.position_m
    if min(start.position_m, end.position_m) - low > 1e-9 or high - max(start.position_m, end.position_m) > 1e-9:
        lines.append(f"Note: it goes beyond its ends, from {low:.6g} to {high:.6g} m")
    resting = np.all(np.array([start.velocity_m_s, start.acceleration_m_s2, end.velocity_m_s, end.acceleration_m_s2]) == 0.0)
    drive = f"Next: beltcomm verify --drive DRIVE --run RUN --move {pasted(file)}"
    lines.append(drive if resting else "Note: it does not begin and end at rest, so that `beltcomm verify --move` cannot drive it alone")
    return lines
