"""The constant-speed sweeps of a run one by one, what friction does over the session's clock, and how it depends on the load.

One sweep is one or more records; its sidecar says which: ``sweep: {measurement, order, repetition}``.  Records of one measurement
have one clock.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import stdtrit

from beltcomm.errors import DataError
from beltcomm.fit.start.undersampled import SteadyPasses
from beltcomm.identify.friction import FrictionFit, Plateau, find_plateaus, fit_friction, slowest_fitted_rad_s
from beltcomm.model import Model
from beltcomm.model.value import NORMAL_95, Value
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import Sidecar
from beltcomm.simulate.stopping import total_inertia

#: Key of a sidecar that says which sweep a record belongs to.
KEY = "sweep"
#: Key of a sidecar for the beginning of each plateau that is left out, s, where it is not the usual one.
RUN_IN_KEY = "run_in_s"
RUN_IN_S = 0.2
#: Fewest speeds, either way, from which a sweep gets a law of its own.
FEWEST_SPEEDS = 3
#: Speeds that differ by less than this share are one: a stroke ends on a whole sample period.
SAME_SPEED = 2e-3
#: Residual degrees of freedom that a drift needs.
FEWEST_LEFT = 4


@dataclass(frozen=True)
class SweepNote:
    """A sidecar's note on its sweep.

    Attributes
    ----------
    measurement : int
        counts the calls that recorded, 0 where none is noted: a clock of its own.
    """

    measurement: int
    order: str
    repetition: int

    def to_dict(self) -> dict[str, Any]:
        """Entries of the sidecar."""
        return {KEY: {"measurement": self.measurement, "order": self.order, "repetition": self.repetition}}


@dataclass(frozen=True)
class Sweep:
    """One sweep.

    Attributes
    ----------
    records : tuple of str
        Names.
    plateaus : tuple of Plateau
        Passes, ``start_s`` on the session's clock.
    payload_kg : float or None
        Stated, None when not.
    from_s, to_s : float or None
        Of its passes on that clock; None when the records do not know it.
    fit : FrictionFit or None
        (3.36) from ``slowest_rad_s`` on, None with too few speeds, or too few passes that show friction.
    """

    note: SweepNote
    records: tuple[str, ...]
    plateaus: tuple[Plateau, ...]
    payload_kg: float | None
    from_s: float | None
    to_s: float | None
    fit: FrictionFit | None
    slowest_rad_s: float = 0.0

    @property
    def name(self) -> str:
        """For tables: the order and which repetition, or the record's name."""
        return f"{self.note.order}, {self.note.repetition}." if self.note.measurement else self.records[0]


@dataclass(frozen=True)
class Drift:
    """Drift of friction per minute of the session's clock; every interval is a half width at 95 %.

    Attributes
    ----------
    viscous : Value
        N m s/rad per minute.
    coulomb : Value
        N m per minute.
    minutes : float
        Between the first pass and the last.
    rms_nm : float
        What is left of passes at one speed, N m.
    speeds : int
        Driven at least twice, either way counted alone.
    """

    viscous: Value
    coulomb: Value
    minutes: float
    rms_nm: float
    speeds: int


@dataclass(frozen=True)
class Loaded:
    """The sweeps with one load.

    Attributes
    ----------
    load_kg : float
        Mounted, or the moving mass.
    sweeps : int
        How many.
    viscous, coulomb : Value
        Their mean.
    """

    name: str
    load_kg: float
    sweeps: int
    viscous: Value
    coulomb: Value


@dataclass(frozen=True)
class LoadDependence:
    """Friction against load, by a straight line.

    Attributes
    ----------
    viscous : Value
        N m s/rad per kg.
    coulomb : Value
        N m per kg; half widths at 95 %.
    repeats : int
        Degrees of freedom of the scatter between sweeps of one load; 0 where none was repeated, so that the intervals know the scatter
        within a sweep only.
    """

    groups: tuple[Loaded, ...]
    viscous: Value
    coulomb: Value
    repeats: int


def note_of(sidecar: Sidecar, name: str) -> SweepNote:
    """The sweep that a record is part of.

    Parameters
    ----------
    sidecar : Sidecar
        Of the record.
    name : str
        Of the record.

    Raises
    ------
    DataError
        For a sidecar that says it wrongly.
    """
    found = sidecar.extra.get(KEY)
    if found is None:
        return SweepNote(0, "", 1)
    try:
        note = SweepNote(int(found["measurement"]), str(found["order"]), int(found["repetition"]))
    except (TypeError, KeyError, ValueError) as error:
        raise DataError(f"the sidecar of {name} has a damaged entry {KEY} ({error}); it holds measurement, order and repetition") from error
    if note.measurement < 1 or note.repetition < 1:
        raise DataError(f"the sidecar of {name} has {KEY} {found}; measurement and repetition count from 1")
    return note


def sweeps_of(recordings: Sequence[Recording], slowest_rad_s: float = 0.0, inertia_kg_m2: float = 0.0) -> tuple[Sweep, ...]:
    """All constant-speed sweeps, in the order of measurement and clock.

    Parameters
    ----------
    recordings : sequence of Recording
    slowest_rad_s : float
        As in :func:`fit_friction`.
    inertia_kg_m2 : float
        As in :func:`find_plateaus`.

    Raises
    ------
    DataError
        For a damaged sidecar, or records of one sweep that state different payloads.
    """
    parts: dict[tuple[Any, ...], list[Recording]] = {}
    for recording in recordings:
        if recording.sidecar.experiment == "friction_sweep" and recording.reference_velocity is not None:
            note = note_of(recording.sidecar, recording.name)
            key = (note.measurement, note.order, note.repetition) if note.measurement else (0, recording.name)
            parts.setdefault(key, []).append(recording)
    found = [_sweep(records, slowest_rad_s, inertia_kg_m2) for records in parts.values()]
    return tuple(sorted((s for s in found if s.plateaus), key=lambda s: (s.note.measurement, s.from_s or 0.0, s.records)))


def steady_passes(recordings: Sequence[Recording], model: Model) -> SteadyPasses:
    """Passes of all sweeps that are fitted, fast enough for viscous and Coulomb friction.

    Parameters
    ----------
    recordings : sequence of Recording
    model : Model
        Whose inertia is taken off passes that miss their speed.
    """
    inertia, slowest = total_inertia(model), slowest_fitted_rad_s(model["transmission.ratio"])
    sweeps = (r for r in recordings if r.sidecar.experiment == "friction_sweep" and not r.sidecar.held_out)
    passes = [p for r in sweeps if r.reference_velocity is not None for p in plateaus_of(r, inertia)]
    rows = [(p.speed_rad_s, p.torque_nm, p.error_nm) for p in passes if abs(p.speed_rad_s) > slowest]
    return SteadyPasses(*np.array(rows).reshape(-1, 3).T)


def plateaus_of(recording: Recording, inertia_kg_m2: float) -> tuple[Plateau, ...]:
    """Passes of a record with reference velocity, see :func:`find_plateaus`, without the run-in that its sidecar names.

    Parameters
    ----------
    recording : Recording
        With a reference velocity.
    inertia_kg_m2 : float, kg m²
        See :func:`find_plateaus`.
    """
    assert recording.reference_velocity is not None
    noted = recording.sidecar.extra.get(RUN_IN_KEY)
    run_in_s = max(float(noted), RUN_IN_S) if isinstance(noted, (int, float)) else RUN_IN_S
    arrays = (recording.t_s, recording.torque, recording.position, recording.reference_velocity)
    return find_plateaus(*arrays, run_in_s=run_in_s, inertia_kg_m2=inertia_kg_m2)


def _sweep(records: Sequence[Recording], slowest_rad_s: float, inertia_kg_m2: float) -> Sweep:
    payloads = {r.sidecar.payload_kg for r in records}
    if len(payloads) > 1:
        raise DataError(f"the records {', '.join(r.name for r in records)} of one sweep state different payloads; correct payload_kg")
    clock = all(r.sidecar.session_time_s is not None for r in records)
    passes: list[Plateau] = []
    for r in records:
        shift = (r.sidecar.session_time_s or 0.0) - float(r.t_s[0])
        found = plateaus_of(r, inertia_kg_m2)
        passes += [replace(p, start_s=p.start_s + shift) for p in found]
    passes.sort(key=lambda p: p.start_s)
    speeds = {round(abs(p.reference_rad_s), 6) for p in passes if abs(p.reference_rad_s) >= slowest_rad_s}
    fit = None
    if len(speeds) >= FEWEST_SPEEDS:
        with suppress(DataError):  # a weak loop has missed most of its speeds: the passes that are left count in the fit over all sweeps
            fit = fit_friction(passes, slowest_rad_s=slowest_rad_s)
    timed = clock and bool(passes)
    return Sweep(
        note_of(records[0].sidecar, records[0].name),
        tuple(r.name for r in records),
        tuple(passes),
        payloads.pop(),
        passes[0].start_s if timed else None,
        passes[-1].start_s + passes[-1].duration_s if timed else None,
        fit,
        slowest_rad_s,
    )


def measurements(sweeps: Sequence[Sweep]) -> Mapping[int, tuple[Sweep, ...]]:
    """Sweeps of one clock each; those without a note have no common one and are left out.

    Parameters
    ----------
    sweeps : sequence of Sweep
        Of any measurement.
    """
    numbers = sorted({s.note.measurement for s in sweeps if s.note.measurement and s.from_s is not None})
    return {number: tuple(s for s in sweeps if s.note.measurement == number) for number in numbers}


def drift_of(plateaus: Sequence[Plateau]) -> Drift:
    """Drift of friction over time, from speeds that were driven more than once; no law of friction over speed is assumed.

    τ = f(ω_k) + (ċ sign ω + ḋ ω + ȯ) (t - t̄),   f : one free number for each speed and direction

    So neither a Stribeck effect nor the order of the speeds poses as drift.  ȯ, of an offset, is only taken out.  Intervals from what
    is left over; a change that slows down (warming up) is the mean over the time measured, and widens them.

    Parameters
    ----------
    plateaus : sequence of Plateau
        On one clock.

    Raises
    ------
    DataError
        Where too few speeds were repeated.
    """
    groups = [g for g in _same_speed([p for p in plateaus if p.reached_speed]) if len(g) > 1]
    passes = [p for group in groups for p in group]
    left = len(passes) - len(groups) - 3
    if left < FEWEST_LEFT or len({p.reference_rad_s > 0.0 for p in passes}) < 2:
        raise DataError(
            f"{len(passes)} passes at {len(groups)} speeds were driven more than once, too few to tell drift from scatter; repeat "
            "the sweep (--repeat 3)"
        )
    middle = [p.start_s + 0.5 * p.duration_s for p in passes]
    minutes = (np.array(middle) - np.mean(middle)) / 60.0
    speed = np.array([p.speed_rad_s for p in passes])
    torque = np.array([p.torque_nm for p in passes])
    own = np.array([p.error_nm for p in passes]) ** 2
    free = np.repeat(np.eye(len(groups)), [len(g) for g in groups], axis=0)
    regressor = np.column_stack([free, np.sign(speed) * minutes, speed * minutes, minutes])
    weight = np.ones(len(passes))
    for _ in range(2):  # at first all alike; then by each pass's own error beside the scatter that is left
        root = np.sqrt(weight)[:, None]
        estimate = np.linalg.lstsq(regressor * root, torque * root[:, 0], rcond=None)[0]
        rest = torque - regressor @ estimate
        beyond = max(float(np.sum(rest**2) - np.sum(own) * left / len(passes)) / left, 0.0)
        used, weight = weight, 1.0 / np.maximum(own + beyond, max(1e-6 * float(own.max()), 1e-30))
    spread = float(np.sum(used * rest**2)) / left
    covariance = spread * np.linalg.pinv(regressor.T @ (regressor * used[:, None]))
    half = stdtrit(left, 0.975) * np.sqrt(np.diag(covariance))

    def value(place: int, unit: str) -> Value:
        return Value(float(estimate[place]), unit, "motor", -np.inf, np.inf, float(half[place]), "repeated speeds")

    k = len(groups)
    return Drift(
        value(k + 1, "N m s/rad per min"),
        value(k, "N m per min"),
        float(np.ptp(minutes)),
        float(np.sqrt(np.sum(rest**2) / left)),
        k,
    )


def _same_speed(plateaus: Sequence[Plateau]) -> list[list[Plateau]]:
    """Passes by reference velocity, rising; velocities that differ by less than ``SAME_SPEED`` are one."""
    groups: list[list[Plateau]] = []
    for plateau in sorted(plateaus, key=lambda p: p.reference_rad_s):
        last = groups[-1][0].reference_rad_s if groups else math.inf
        if groups and abs(plateau.reference_rad_s - last) <= SAME_SPEED * abs(last):
            groups[-1].append(plateau)
        else:
            groups.append([plateau])
    return groups


def load_dependence(groups: Mapping[str, tuple[float, Sequence[FrictionFit]]]) -> LoadDependence:
    """Friction against load over sweeps with different loads.

    θ = a + b load;   variance of a load's mean: the pooled scatter between sweeps of one load over their number, at least what each
    sweep says of its own.  With more than two loads the intervals also know how far the means are off the line.

    Parameters
    ----------
    groups : dict of str to tuple[float, Sequence[FrictionFit]]
        Load in kg and the fits of its sweeps, by name.

    Raises
    ------
    DataError
        With fewer than two loads.
    """
    loads = np.array([load for load, _ in groups.values()])
    if len(groups) < 2 or float(np.ptp(loads)) <= 0.0:
        named = ", ".join(f"{name} {load:g} kg" for name, (load, _) in groups.items())
        raise DataError(
            f"friction against load needs sweeps with two loads at least, here are {named}; mount another payload and sweep again"
        )
    counts = np.array([len(fits) for _, fits in groups.values()])
    repeats = int(np.sum(counts - 1))
    slopes, means = {}, {}
    for name in ("viscous", "coulomb"):
        values = [np.array([getattr(fit, name).value for fit in fits]) for _, fits in groups.values()]
        within = [np.mean([(getattr(fit, name).interval / NORMAL_95) ** 2 for fit in fits]) for _, fits in groups.values()]
        between = sum(float(np.sum((v - v.mean()) ** 2)) for v in values) / repeats if repeats else 0.0
        variance = np.maximum(np.array(within), between) / counts
        mean = np.array([v.mean() for v in values])
        quantile = float(stdtrit(repeats, 0.975)) if repeats else NORMAL_95
        regressor = np.column_stack([np.ones(len(loads)), loads])
        covariance = np.linalg.inv(regressor.T @ (regressor / variance[:, None]))
        estimate = covariance @ (regressor.T @ (mean / variance))
        off, beyond = float(np.sum((mean - regressor @ estimate) ** 2 / variance)), len(loads) - 2
        spread = max(1.0, off / beyond) if beyond else 1.0
        unit = getattr(next(iter(groups.values()))[1][0], name).unit
        half = quantile * math.sqrt(spread * covariance[1, 1])
        slopes[name] = Value(float(estimate[1]), f"{unit} per kg", "motor", -np.inf, np.inf, half, "sweeps")
        means[name] = [
            Value(float(m), unit, "motor", 0.0, np.inf, float(quantile * math.sqrt(v)), "sweeps")
            for m, v in zip(mean, variance, strict=True)
        ]
    told = zip(groups.items(), counts, means["viscous"], means["coulomb"], strict=True)
    shown = tuple(Loaded(name, load, int(n), viscous, coulomb) for (name, (load, _)), n, viscous, coulomb in told)
    return LoadDependence(shown, slopes["viscous"], slopes["coulomb"], repeats)


def clear(value: Value) -> bool:
    """True if a value is above its scatter: its 95 % interval leaves out zero.

    Parameters
    ----------
    value : Value
        With or without an interval.

    Returns
    -------
    bool
        False without an interval.
    """
    return value.interval is not None and abs(value.value) > value.interval
