"""Frequency responses: model over measurement, with the noise of the measurement and its resonances named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from beltcomm.errors import DataError
from beltcomm.laboratory.samples import Judged, Units
from beltcomm.recording import ExcitationNote, Recording
from beltcomm.report import style
from beltcomm.response import estimate_response

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: A line counts as excited from this share of the strongest on; the lowest ones hold the drift of the carriage.
LEAST_EXCITATION, FIRST_LINE = 0.05, 3
#: Colours of the records, and the most that one picture shows.
LINES, MOST = ("#000000", "#0072B2", "#D55E00", "#009E73"), 4


@dataclass(frozen=True)
class ResponsePair:
    """One excited record.   measured : torque to angle, rad/(N m), (k,) at freq_hz.   model : the same angle over the torque that the model
    says it needed, so friction is in both as the record has it.   radius : 95 % of the measured one's noise.   coherence : of its periods;
    both None for a single period.

    cart_m : carriage at the start, m.   amplitude_nm : largest torque of the excitation, as noted.   units : of the axis.
    """

    record: str
    held_out: bool
    cart_m: float
    amplitude_nm: float
    freq_hz: Array
    measured: ComplexArray
    model: ComplexArray
    radius: Array | None
    coherence: Array | None
    units: Units


def response_pairs(recordings: Sequence[Recording], judged: Sequence[Judged]) -> list[ResponsePair]:
    """The periodically excited records that have no gap, fitted ones first."""
    found = []
    for recording in recordings:
        note = recording.sidecar.excitation
        parts = [j for j in judged if j.piece.record == recording.name]
        if note is None or not note.period_samples or len(parts) != 1 or len(parts[0].piece.torque) != len(recording.t_s):
            continue
        piece, period, first = parts[0].piece, note.period_samples, note.first_sample
        begins = note.period_starts or range(first, len(piece.torque) - period + 1, period)
        whole = np.array([start for start in begins if start + period <= len(piece.torque)], dtype=np.intp)
        if len(whole) < 1 or first < 1:
            continue
        each = whole[:, np.newaxis] + np.arange(period)
        torque, needed = _lines(piece.torque[each]), _lines((piece.torque + parts[0].whole)[each])
        turned = _lines(piece.position[each] - piece.position[each - 1])
        freq = np.asarray(np.fft.rfftfreq(period, recording.sample_period_s), dtype=np.float64)
        strong = np.abs(torque) > LEAST_EXCITATION * np.abs(torque[FIRST_LINE:]).max()
        lines = np.flatnonzero(strong & (np.arange(len(freq)) >= FIRST_LINE))
        z = np.exp(2j * np.pi * freq[lines] * recording.sample_period_s)
        angle = z / (z - 1.0) * turned[lines]
        found.append(
            ResponsePair(
                recording.name,
                recording.sidecar.held_out,
                recording.sidecar.start_position_m or 0.0,
                float(np.max(np.abs(piece.torque))) if note.amplitude_nm is None else note.amplitude_nm,
                freq[lines],
                angle / torque[lines],
                angle / needed[lines],
                *_noise(piece.torque, piece.position, recording.sample_period_s, note, freq[lines]),
                parts[0].units,
            )
        )
    return sorted(found, key=lambda pair: pair.held_out)


def _lines(periods: Array) -> ComplexArray:
    """Spectrum of the mean period."""
    return np.asarray(np.fft.rfft(periods.mean(axis=0)))


def _noise(torque: Array, position: Array, sample_s: float, note: ExcitationNote, freq_hz: Array) -> tuple[Array | None, Array | None]:
    """Noise and coherence of the measured response at these lines, nan where they are not known; None for a single period."""
    try:
        response = estimate_response(torque, position, sample_s, note.period_samples or 0, note.first_sample, starts=note.period_starts)
    except DataError:
        return None, None
    radius, coherence = np.full((2, len(freq_hz)), np.nan)
    _, here, there = np.intersect1d(freq_hz, response.freq_hz, return_indices=True)
    radius[here], coherence[here] = response.error_radius()[there], response.coherence[there]
    return radius, coherence


def apart(pairs: Sequence[ResponsePair]) -> list[ResponsePair]:
    """Up to ``MOST`` responses that differ in place or amplitude, those with several periods first."""
    chosen: dict[tuple[float, float], ResponsePair] = {}
    for pair in sorted(pairs, key=lambda p: p.radius is None):
        chosen.setdefault((round(pair.cart_m, 1), float(f"{pair.amplitude_nm:.1g}")), pair)
    return list(chosen.values())[:MOST]


def below(response: ComplexArray) -> Array:
    """Phase in degrees, every one between -360 and 0: single lines that friction turns by half a turn must not shift all that follow."""
    return np.asarray(np.degrees(np.angle(-response)) - 180.0, dtype=np.float64)


def bode_figure(pairs: Sequence[ResponsePair], landmarks: Mapping[str, float], caption: style.Caption) -> Figure:
    """Magnitude, phase, model over measurement and coherence, of up to four records that differ."""
    shown = apart(pairs)
    with style.styled():
        made = style.figure("Frequency response: model over measurement", 9.6, caption)
        upper, middle, lower, strip = made.subplots(4, 1, sharex=True, height_ratios=[1.7, 1.0, 1.0, 0.5])
        for pair, colour in zip(shown, LINES, strict=False):
            label = f"{pair.record}, {pair.cart_m:.2f} m, ±{pair.amplitude_nm:.3f} {pair.units.force}" + (
                " (held out)" if pair.held_out else ""
            )
            size = 20.0 * np.log10(np.abs(pair.measured))
            upper.plot(pair.freq_hz, size, ".", markersize=3.5, color=colour, label=f"measured: {label}")
            upper.plot(pair.freq_hz, 20.0 * np.log10(np.abs(pair.model)), color=colour, linewidth=1.2, alpha=0.8)
            middle.plot(pair.freq_hz, below(pair.measured), ".", markersize=3.5, color=colour)
            phase = below(pair.model)
            broken = np.where(np.abs(np.diff(phase, prepend=phase[0])) > 180.0, np.nan, phase)
            middle.plot(pair.freq_hz, broken, color=colour, linewidth=1.2, alpha=0.8)
            level = np.abs(pair.measured)
            lower.plot(pair.freq_hz, 100.0 * np.abs(pair.model - pair.measured) / level, color=colour, linewidth=1.0)
            if pair.radius is not None:
                lower.plot(pair.freq_hz, 100.0 * pair.radius / level, color=colour, linewidth=0.9, linestyle=":")
            if pair.coherence is not None:
                strip.plot(pair.freq_hz, pair.coherence, ".", markersize=2.5, color=colour)
        upper.plot([], [], color="#777777", label="line: model, for the measured motion")
        lower.plot([], [], color="#777777", label="difference of model and measurement")
        lower.plot([], [], color="#777777", linestyle=":", label="what noise alone makes (95 %)")
        low, high = upper.get_ylim()
        for name, hz in landmarks.items():
            for axes in (upper, middle, lower, strip):
                axes.axvline(hz, color=style.FAINT, linewidth=1.2, zorder=0.5)
            upper.annotate(f" {name} {hz:.1f} Hz", (hz, low + 0.02 * (high - low)), rotation=90, va="bottom", ha="right", fontsize=8)
        upper.set_xscale("log")
        units = shown[0].units
        turned = ("position", "m") if units.force == "N" else ("angle", "rad")
        upper.set_ylabel(f"|{turned[0]}/{units.word}| in dB re 1 {turned[1]}/({units.force})")
        upper.legend(loc="upper right", fontsize=8)
        middle.set_ylabel("phase in degrees")
        lower.set_yscale("log")
        lower.set_ylim(0.1, 1500.0)
        style.numbers_at(lower.yaxis, [0.1, 1.0, 10.0, 100.0, 1000.0])
        lower.set_ylabel("difference in %")
        lower.legend(loc="upper right", fontsize=8, ncols=2)
        middle.set_ylim(-370.0, 10.0)
        style.numbers_at(middle.yaxis, style.DEGREES)
        strip.set(xlabel="frequency in Hz", ylabel="coherence", ylim=(0.0, 1.05))
        style.hertz(strip.xaxis)
    return made
