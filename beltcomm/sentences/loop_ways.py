"""Frequency responses of one axis by several ways, beside each other: numbers, words, and what friction and a doubtful controller do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from beltcomm.errors import DataError, Refused
from beltcomm.identify.loop_response import (
    DOUBT,
    NO_BIAS_DB,
    Biased,
    Way,
    bias_of,
    controller_of,
    difference_db,
    plant_response,
    rigid_damping,
    ways_of,
)
from beltcomm.identify.magnitude_fit import LARGEST_NOISE, MagnitudeFit
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.response import FrequencyResponse
from beltcomm.result import table
from beltcomm.rundata import analyse
from beltcomm.rundata.analyse import Characteristic
from beltcomm.sentences.words import number

#: Share of a band's lines that must stand above the noise for it to be seen.
SEEN_SHARE = 0.5
FORM = (
    "Resonance and antiresonance are those of (2.42), which knows neither the hold of a sample nor the belt's damping: at a tenth of the "
    "sampling rate it reads 0.1 % low. `beltcomm fit` counts both."
)
#: Lines of one band when it is asked how far a response reaches.
BAND_LINES = 12


@dataclass(frozen=True, eq=False)
class LoopReading:
    """A record read by one way.

    Attributes
    ----------
    speed_m_s : float
        Base speed, 0 at rest.
    resonance, antiresonance, mass, stiffness : Characteristic or None
        Of the log-magnitude fit (2.42), which has no belt damping; None where it could not be made.
    damping : Characteristic or None
        Rigid axis, below the antiresonance; None where too few lines lie there.
    noise_share : float
        Median of noise over |h| up to ``highest_hz``, as far as the response stands above its noise.
    """

    record: str
    way: Way
    speed_m_s: float
    response: FrequencyResponse
    resonance: Characteristic | None
    antiresonance: Characteristic | None
    mass: Characteristic | None
    stiffness: Characteristic | None
    damping: Characteristic | None
    noise_share: float
    highest_hz: float
    remarks: tuple[str, ...]

    @property
    def name(self) -> str:
        """In a few words."""
        moving = f"{1e3 * self.speed_m_s:.3g} mm/s" if self.speed_m_s else "standing"
        return f"{'open loop' if self.way == 'open' else self.way}, {moving}"


def _shown(recording: Recording, way: Way, model: Model) -> LoopReading:
    """A record read by one way.   Raises DataError when the response itself cannot be had."""
    response = plant_response(recording, way)
    note = recording.sidecar.excitation
    resonance = antiresonance = mass = stiffness = damping = None
    remarks = list(response.remarks)
    highest = _reaches_hz(response)
    try:
        fit = analyse.thesis_fit(response.lines(response.freq_hz <= highest), model)
        resonance, antiresonance, mass, stiffness = _numbers(fit)
    except (DataError, Refused) as problem:
        remarks.append(f"no log-magnitude fit ({problem})")
    try:
        value, half = rigid_damping(response, antiresonance.value if antiresonance else math.inf)
        damping = Characteristic(value, half, "N m s/rad")
    except DataError as problem:
        remarks.append(str(problem))
    within = response.freq_hz <= highest
    share = float(np.median((response.noise / np.abs(response.h))[within]))
    speed = (note.base_speed_m_s or 0.0) if note is not None else 0.0
    fitted = (resonance, antiresonance, mass, stiffness)
    return LoopReading(recording.name, way, speed, response, *fitted, damping, share, highest, tuple(remarks))


def _reaches_hz(response: FrequencyResponse) -> float:
    """Frequency up to which, from the bottom on, most lines of every band stand above their noise, Hz."""
    clear = response.noise < LARGEST_NOISE * np.abs(response.h)
    bands = [slice(i, i + BAND_LINES) for i in range(0, len(clear), BAND_LINES)]
    seen = [bool(np.mean(clear[b]) >= SEEN_SHARE) for b in bands]
    count = seen.index(False) if False in seen else len(seen)
    return float(response.freq_hz[bands[max(count, 1) - 1]][-1])


def _numbers(fit: MagnitudeFit) -> tuple[Characteristic, Characteristic, Characteristic, Characteristic]:
    """Resonance, antiresonance, mass and stiffness with 95 % half widths, linear propagation."""
    two, names = fit.two_mass, list(fit.names)
    m, c = names.index("mass_kg"), names.index("stiffness_n_m")
    half = np.array([fit.parameters[name].interval or 0.0 for name in ("mass_kg", "stiffness_n_m")])
    covariance = np.outer(half, half) * fit.correlation[np.ix_([m, c], [m, c])]
    mass, stiffness = two.mass_kg, two.stiffness_n_m
    per_mass = 1.0 / mass + two.transmission_m_rad**2 / two.inertia_kg_m2
    # f_r = √(c (1/m + i²/Θ))/2π and f_z = √(c/m)/2π
    slopes = {
        "resonance": 0.5 * two.resonance_hz * np.array([-1.0 / (mass**2 * per_mass), 1.0 / stiffness]),
        "antiresonance": 0.5 * two.antiresonance_hz * np.array([-1.0 / mass, 1.0 / stiffness]),
    }
    widths = {name: math.sqrt(max(float(slope @ covariance @ slope), 0.0)) for name, slope in slopes.items()}
    return (
        Characteristic(two.resonance_hz, widths["resonance"], "Hz"),
        Characteristic(two.antiresonance_hz, widths["antiresonance"], "Hz"),
        Characteristic(mass, float(half[0]), "kg"),
        Characteristic(stiffness, float(half[1]), "N/m"),
    )


def friction_nm(recording: Recording) -> float | None:
    """Torque that the steady parts need against friction at base speed, N m at the motor; None where the carriage stood or went one way.

    Half the difference of both ways, so that gravity falls out.

    Parameters
    ----------
    recording : Recording
        At constant speed, both ways, with excited periods.
    """
    note = recording.sidecar.excitation
    if note is None or not note.base_speed_m_s or not note.period_starts or not note.period_samples:
        return None
    means: dict[bool, list[float]] = {True: [], False: []}
    for start in note.period_starts:
        part = slice(start, start + note.period_samples)
        means[bool(recording.position[part][-1] > recording.position[part][0])].append(float(np.mean(recording.torque[part])))
    return 0.5 * (float(np.mean(means[True])) - float(np.mean(means[False]))) if means[True] and means[False] else None


def all_ways(recordings: Sequence[Recording], model: Model, first: str) -> list[LoopReading]:
    """Every way of the record named first, the loudest open-loop record, then other closed-loop ones; what cannot be read is left out.

    Parameters
    ----------
    recordings : sequence of Recording
        Of the run.
    model : Model
        For what bounds the band.
    first : str
        Name of a record.
    """
    excited = [r for r in recordings if r.sidecar.experiment == "frf" and not r.sidecar.held_out]
    opened = [r for r in excited if not r.sidecar.closed_loop and len(analyse.responses([r]))]
    loudest = sorted(opened, key=lambda r: (len(r.t_s), float(np.std(r.torque))))[-1:]
    closed = [r for r in excited if r.sidecar.closed_loop and r.name != first]
    found = []
    for recording in [*(r for r in excited if r.name == first), *loudest, *closed]:
        own = recording.name.split("_")[0]
        for way in ways_of(recording):
            if recording.sidecar.closed_loop and recording.name != first and own in ways_of(recording) and way != own:
                continue  # of the others only as they were meant
            try:
                found.append(_shown(recording, way, model))
            except DataError:
                continue  # a rising record has one period: it serves the fit
    return found


def bias_by(recording: Recording, ways: Sequence[LoopReading]) -> Biased | None:
    """Bias of the indirect reading of a record under a wrong controller; None where it has none.

    Parameters
    ----------
    recording : Recording
        In closed loop.
    ways : sequence of LoopReading
        Readings, of this and other records.
    """
    own = next((s for s in ways if s.record == recording.name and s.way in ("indirect", "setpoint")), None)
    if own is None:
        return None
    clear = (own.response.noise < LARGEST_NOISE * np.abs(own.response.h)) & (own.response.freq_hz <= own.highest_hz)
    return bias_of(own.response.lines(clear), controller_of(recording.sidecar.controller, recording.name))


def lines(recording: Recording, ways: Sequence[LoopReading], slowest: float) -> list[str]:
    """Table of all ways and what it says.

    Parameters
    ----------
    recording : Recording
    ways : sequence of LoopReading
        Readings, of this and other records.
    slowest : float
        Least motor speed over base speed in the record.
    """
    rows = [
        [
            s.name,
            s.record,
            _cell(s.resonance, "Hz", 1.0),
            _cell(s.antiresonance, "Hz", 1.0),
            _cell(s.damping, "mN m s/rad", 1e3),
            f"{100.0 * s.noise_share:.1f} %",
            f"{s.highest_hz:.0f} Hz",
        ]
        for s in ways
    ]
    shown = table(["way", "record", ">resonance", ">antiresonance", ">damping, rigid axis", ">noise", ">up to"], rows)
    form = [FORM] if any(s.resonance is not None for s in ways) else []
    return [*shown, *form, *_friction_words(recording, ways, slowest), *_bias_words(recording, ways)]


def _cell(item: Characteristic | None, unit: str, factor: float) -> str:
    return "cannot tell" if item is None or not math.isfinite(item.interval) else number(factor * item.value, factor * item.interval, unit)


def _friction_words(recording: Recording, ways: Sequence[LoopReading], slowest: float) -> list[str]:
    """Effect of friction on the record, with numbers."""
    own = next(s for s in ways if s.record == recording.name)
    standing = next((s for s in ways if not s.speed_m_s and s.record != recording.name and s.damping is not None), None)
    said = []
    if not own.speed_m_s:
        said.append("The carriage stood: Coulomb friction turned round with it and poses as damping; --base-speed takes that away.")
    elif slowest > 0.0:
        said.append(f"The motor never turned round: it kept {100.0 * slowest:.0f} % of its speed or more, so friction was constant.")
    else:
        said.append("The motor turned round within the excited parts: some friction still poses as damping; travel faster or excite less.")
    moving = next((s for s in ways if s.record == recording.name and s.way in ("indirect", "setpoint") and s.damping is not None), own)
    if own.speed_m_s and standing is not None and standing.damping is not None and moving.damping is not None:
        said.append(
            f"Apparent damping of the rigid axis: {_cell(standing.damping, 'mN m s/rad', 1e3)} {standing.name}, "
            f"{_cell(moving.damping, 'mN m s/rad', 1e3)} {moving.name}; the difference is Coulomb friction that reverses."
        )
    level = friction_nm(recording)
    if level is not None:
        at = f"{1e3 * own.speed_m_s:.3g} mm/s"
        said.append(f"Travelling takes {1e3 * level:.1f} mN m against friction at {at} (half the difference of both ways).")
    return said


def _bias_words(recording: Recording, ways: Sequence[LoopReading]) -> list[str]:
    """The indirect reading against the direct one of the same record, and what a controller not exactly known would do (3.4)."""
    bias = bias_by(recording, ways)
    if bias is None:
        return []
    readings = {s.way: s for s in ways if s.record == recording.name}
    indirect = readings.get("indirect") or readings["setpoint"]
    middle, top = max(bias.crossover_hz, 3.0 * bias.lowest_hz), min(indirect.highest_hz, readings["direct"].highest_hz)
    (below, half), (above, half_above) = (
        difference_db(indirect.response, readings["direct"].response, low, high) for low, high in ((0.0, middle), (middle, top))
    )
    said = []
    if math.isfinite(below) and math.isfinite(above):
        said.append(
            f"{indirect.way} against direct, same record: {below:+.2f} ± {half:.2f} dB up to {middle:.3g} Hz, "
            f"{above:+.2f} ± {half_above:.2f} dB from there to {top:.3g} Hz (noise of both, 95 %)."
        )
    return [
        *said,
        f"A controller gain {100.0 * DOUBT:.0f} % larger than believed would shift it by {bias.shift_db:+.2f} dB at {bias.lowest_hz:.2g} Hz"
        + (
            f" and by less than {NO_BIAS_DB:g} dB from {bias.harmless_hz:.3g} Hz on: below, the direct way is the safer one."
            if abs(bias.shift_db) > NO_BIAS_DB
            else ": this loop is so weak that it hardly matters."
        ),
    ]
