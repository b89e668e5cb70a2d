"""``--simulate-first``: the whole job on a twin of the axis, record by record against the limits, before the axis itself moves.

The twin is the virtual drive with the run's model behind it, or with what the data sheets say where there is no model yet.  It begins where
the carriage stands.  What it has not: the real drive's gains as they were found, and whatever the model does not know.
"""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from beltcomm.axis import Axis
from beltcomm.configfiles import read_yaml, to_yaml, write_text
from beltcomm.drive import Capabilities
from beltcomm.errors import BeltcommError, Refused
from beltcomm.experiments.detectability import sheet_model
from beltcomm.experiments.options import Options
from beltcomm.machine import gravity
from beltcomm.machine.machine import Machine
from beltcomm.machine.prediction_watch import BELT_BEYOND, BELT_ROWS
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.result import plain, table
from beltcomm.rundata import offline
from beltcomm.runfolder import RunFolder
from beltcomm.simulate.plant import SimulatedPlant
from beltcomm.simulate.stopping import total_friction
from beltcomm.talk import Talk

#: Profiles that the virtual drive plays, with a torque along its reference and without.
WITH_FEEDFORWARD, WITHOUT_FEEDFORWARD = "reference", "cmmp-as"
#: A torque may exceed its limit by this share: ripple and noise of a measured torque.
TORQUE_SHARE = 1.1


class Job(Protocol):
    """A command of :mod:`beltcomm.api` with all that was asked for but the drive, the run folder and the options."""

    def __call__(self, *, drive: str, run: Path, options: Options) -> object:
        """Do it there."""
        ...


@dataclass(frozen=True)
class RehearsedRecord:
    """One record on the twin.

    Attributes
    ----------
    low_m, high_m : float, of the carriage
        By the encoder.
    torque_nm : float
        Motor.
    belt_force_n : float
        With friction.
    """

    record: str
    low_m: float
    high_m: float
    speed_m_s: float
    torque_nm: float
    belt_force_n: float


@dataclass(frozen=True)
class Bounds:
    """Limits of a record: as :class:`RehearsedRecord`."""

    low_m: float
    high_m: float
    speed_m_s: float
    torque_nm: float
    belt_force_n: float

    def broken(self, played: RehearsedRecord) -> list[str]:
        """The limits that a record leaves, in words."""
        pairs = (
            ("speed", played.speed_m_s, self.speed_m_s, "m/s"),
            ("torque", played.torque_nm, self.torque_nm, "N m"),
            ("belt force", played.belt_force_n, self.belt_force_n, "N"),
        )
        found = [f"{what} {value:.3g} {unit}, limit {limit:.3g} {unit}" for what, value, limit, unit in pairs if value > limit]
        if played.low_m < self.low_m or played.high_m > self.high_m:
            way = f"{1e3 * played.low_m:.1f} to {1e3 * played.high_m:.1f} mm"
            found.append(f"the carriage goes from {way}, travel is {1e3 * self.low_m:g} to {1e3 * self.high_m:g} mm")
        return [f"{played.record}: {text}" for text in found]


@dataclass(frozen=True)
class Rehearsal:
    """Motion of the twin.

    Attributes
    ----------
    twin : str
        In words.
    whole : RehearsedRecord
        Of everything, moves between the records included, by the twin's own state.
    """

    twin: str
    records: tuple[RehearsedRecord, ...]
    whole: RehearsedRecord
    bounds: Bounds

    def broken(self) -> list[str]:
        """Limits that the twin left."""
        return [text for played in (*self.records, self.whole) for text in self.bounds.broken(played)]

    def lines(self) -> list[str]:
        """Rehearsal as a table."""
        named: list[tuple[str, RehearsedRecord | Bounds]] = [
            *((one.record, one) for one in (*self.records, self.whole)),
            ("limit", self.bounds),
        ]
        rows = [
            [
                name,
                f"{1e3 * one.low_m:.1f} mm",
                f"{1e3 * one.high_m:.1f} mm",
                f"{one.speed_m_s:.2f} m/s",
                f"{one.torque_nm:.2f} N m",
                f"{one.belt_force_n:.0f} N",
            ]
            for name, one in named
        ]
        columns = ["on the twin", ">carriage from", ">to", ">speed", ">torque", ">belt"]
        return [f"Played on a twin first: {self.twin}.", "", *table(columns, rows)]


class _Twin(SimulatedPlant):
    """A simulated axis that keeps its extremes; carriage in m on the axis."""

    def __init__(self, model: Model, position_m: float) -> None:
        super().__init__(model, position_m)
        self.begun_m, self.ratio = position_m, model["transmission.ratio"]
        self.low_m = self.high_m = position_m
        self.fastest_m_s = self.strongest_nm = self.belt_n = 0.0

    def step(self, torque_nm: float, duration_s: float) -> None:
        """Turn the plant on by one step."""
        super().step(torque_nm, duration_s)
        at = self.begun_m + self.cart_position_m
        self.low_m, self.high_m = min(self.low_m, at), max(self.high_m, at)
        self.fastest_m_s = max(self.fastest_m_s, abs(self.ratio * self.velocity_rad_s))
        self.strongest_nm = max(self.strongest_nm, abs(torque_nm))
        self.belt_n = max(self.belt_n, abs(self.belt_force_n))


def rehearse(machine: Machine, options: Options, talk: Talk, job: Job, goes_on: bool) -> Rehearsal:
    """Play a job on a twin of the connected axis and show what it did; nothing real moves.

    Parameters
    ----------
    machine : Machine
    options : Options
    talk : Talk
    job : Job
        As it will run on the drive.
    goes_on : bool
        The job needs what is in its run folder; else it begins a new one.

    Raises
    ------
    Refused
        When the twin leaves a limit, or when the job ends badly on it, with the reason.
    """
    talk.say("The plan is played on a twin first; nothing moves yet.")
    axis, folder = machine.axis, machine.folder
    model, what = _twin_of(axis, folder)
    place = machine.position_m if machine.place_known else axis.travel.middle_m
    with tempfile.TemporaryDirectory(prefix="beltcomm-twin-") as made:
        file, run = Path(made) / "twin.yaml", Path(made) / "run"
        write_text(file, to_yaml({**model.to_dict(), "drive": _drive_of(axis, machine.drive.capabilities)}))
        before = _copied(folder, run) if goes_on else set()
        twin = _Twin(model, place)
        try:
            job(drive=f"virtual:{file}", run=run, options=_options_for(options, machine, twin, place))
        except BeltcommError as problem:
            raise Refused(
                f"on the twin ({what}) the job ends so: {problem}. Nothing was moved; look at axis.yaml and the model"
            ) from problem
        played = RunFolder.open(run)
        names = [name for name in played.finished_names() if name not in before]
        records = tuple(_play_record(played.recording(name), axis, place) for name in sorted(names, key=lambda n: _clock(played, n)))
    whole = RehearsedRecord("everything, ways included", twin.low_m, twin.high_m, twin.fastest_m_s, twin.strongest_nm, twin.belt_n)
    found = Rehearsal(what, records, whole, _bounds_of(machine, model))
    talk.say(*found.lines())
    folder.save("results", "rehearsal", {"twin": what, "records": plain(records), "whole": plain(whole), "limits": plain(found.bounds)})
    folder.journal(f"played on a twin: {len(records)} records, {len(found.broken())} limits left", "rehearsed")
    if broken := found.broken():
        raise Refused(f"on the twin a limit is left ({'; '.join(broken[:3])}); nothing was moved. Look at the model and at axis.yaml")
    return found


def _twin_of(axis: Axis, folder: RunFolder) -> tuple[Model, str]:
    """The model behind the twin, and what it is in words."""
    if "final" in folder.names("models"):
        return offline.trusted_revision(folder)[0], "the run's model"
    model, assumed = sheet_twin(axis)
    return model, f"a guess from the data sheets, {assumed}"


def sheet_twin(axis: Axis) -> tuple[Model, str]:
    """A machine by its data sheets alone, and in words what they do not tell.

    Parameters
    ----------
    axis : Axis

    Returns
    -------
    tuple of Model and str
        Model, and words for the plan.
    """
    model = sheet_model(axis)
    if axis.mounting.tilted:
        guess = gravity.expected(axis)
        values = {"tilt.angle": math.radians(axis.mounting.tilt_deg), "cart.mass": guess.mass_kg}
        model = model.with_effect("tilt").with_values(values, "axis.yaml")
    return model, f"a carriage of {model['cart.mass']:.3g} kg, {1e3 * total_friction(model):.0f} mN m of friction"


def _play_record(recording: Recording, axis: Axis, otherwise_m: float) -> RehearsedRecord:
    """Largest values of a record of the twin; the belt's force as the motor shows it,  F = (τ - Θ_e φ̈)/i_t,  mean of ``BELT_ROWS`` rows."""
    ratio, inertia = axis.transmission_m_rad, axis.motor_side_inertia_kg_m2
    begun = otherwise_m if recording.sidecar.start_position_m is None else recording.sidecar.start_position_m
    places = begun + ratio * (recording.position - recording.position[0])
    period = recording.sample_period_s
    speed = ratio * np.diff(recording.position) / np.diff(recording.t_s)
    acceleration = np.diff(recording.position, 2) / period**2
    force = (0.5 * (recording.torque[:-2] + recording.torque[1:-1]) - inertia * acceleration) / ratio
    smooth = np.convolve(force, np.full(BELT_ROWS, 1.0 / BELT_ROWS), mode="valid")
    return RehearsedRecord(
        recording.name,
        float(places.min()),
        float(places.max()),
        float(np.max(np.abs(speed))),
        float(np.max(np.abs(recording.torque))),
        float(np.max(np.abs(smooth))),
    )


def _bounds_of(machine: Machine, model: Model) -> Bounds:
    """Limits at which the real axis is stopped."""
    envelope, axis = machine.envelope(), machine.axis
    low, high = envelope.window_m if machine.place_known else (-math.inf, math.inf)
    belt = math.inf if machine.over_belt else BELT_BEYOND * axis.belt_force_limit_n + total_friction(model) / axis.transmission_m_rad
    return Bounds(low, high, envelope.speed_m_s, TORQUE_SHARE * envelope.torque_nm, belt)


def _clock(folder: RunFolder, name: str) -> float:
    return float(folder.recording(name).sidecar.session_time_s or 0.0)


def _drive_of(axis: Axis, capabilities: Capabilities) -> Mapping[str, Any]:
    """The twin's drive: no noise, so that what it shows is motion."""
    motor = axis.motor
    brake = {"brake_torque_nm": motor.brake_torque_nm, "brake_time_s": motor.brake_time_s or 0.0} if motor.brake_torque_nm else {}
    return {"torque_noise_nm": 0.0, "counts_per_rev": capabilities.counts_per_rev, **brake}


def _copied(folder: RunFolder, run: Path) -> set[str]:
    """A copy of what a job goes on with, as if made on the twin; returns the names of its records."""
    shutil.copytree(folder.path, run, ignore=_linked_folders)
    about = read_yaml(run / "run.yaml") if (run / "run.yaml").is_file() else {}
    write_text(run / "run.yaml", to_yaml({**about, "drive": {}, "began_s": None}))
    return set(folder.finished_names())


#: s: a twin moves nothing, however long.
UNBOUNDED_S = 1e9


def _linked_folders(at: str, names: list[str]) -> list[str]:
    """Links may lead anywhere, and to as much."""
    return [name for name in names if (Path(at) / name).is_symlink() and (Path(at) / name).is_dir()]


def _options_for(options: Options, machine: Machine, twin: _Twin, place_m: float) -> Options:
    """Options of the job on the twin, with nobody to ask."""
    with_feedforward = machine.drive.capabilities.structure.torque_feedforward
    return replace(
        options,
        yes=True,
        force=True,
        longest_s=UNBOUNDED_S,
        seed=0,
        resume=False,
        apply="restore",
        simulate_first=False,
        search=False,
        position_m=None,
        home=False,
        hold=None,
        first_motion=None,
        wall_clock=None,
        visible=False,
        pictures=False,
        profile=WITH_FEEDFORWARD if with_feedforward else WITHOUT_FEEDFORWARD,
        node=None,
        bitrate=None,
        realtime=False,
        drive={"start_position": place_m, "referenced": machine.place_known, "plant": twin},
    )
