"""The proof of a design in plain sentences."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from beltcomm.design.measured import MeasuredMargins
from beltcomm.design.specification import Specification
from beltcomm.model import Model
from beltcomm.rundata.delays import LOUD_SHARE
from beltcomm.rundata.design_proof import Contradiction, DesignProof, Grounds

#: What a response around standstill shows of the friction, and what the model counts.
STANDING = (
    "around standstill friction shows as damping, which the moving axis does not have: the margins by calculation count every damping down "
    "to none"
)


def proof_lines(proof: DesignProof, grounds: Grounds, asked: Specification) -> list[str]:
    """Margins examined beyond the model's own, the worst of all, and what contradicts.

    Parameters
    ----------
    proof : DesignProof
        Of a design.
    grounds : Grounds
        With the model.
    asked : Specification
        Margins that were asked for.
    """
    lines = ["Proof:", *(f"  {line}" for line in _measured_lines(proof, asked))]
    drawn, values = proof.spread, proof.spread.worst_values
    lines.append(
        f"  parameters: {drawn.draws} draws from {proof.source}, {drawn.plants} plants each, "
        f"{drawn.unstable or 'none'} of {drawn.draws * drawn.plants} loops unstable; all but the worst 2.5 % keep velocity phase margin "
        f"{values['phase_margin_deg']:.1f} deg, position {values['position_phase_margin_deg']:.1f} deg, gain margin "
        f"{values['gain_margin_db']:.1f} dB, sensitivity {values['sensitivity_db']:.1f} dB"
    )
    lines += [f"  {line}" for line in _contradictions(proof.contradictions, grounds.model)]
    lines.append(f"  worst of all, sensitivity {_db(proof.worst.sensitivity_db)}: {proof.worst.text}")
    return lines + [f"  {note}" for note in proof.notes]


def _measured_lines(proof: DesignProof, asked: Specification) -> list[str]:
    measured = proof.measured
    left = [f"left out: {', '.join(proof.left_out)}"] if proof.left_out else []
    if not measured:
        return ["no measured response to prove it on; record one with `beltcomm identify`", *left]
    velocity = min(measured, key=lambda m: m.velocity.least_phase_margin_deg)
    position = min(measured, key=lambda m: m.position.least_phase_margin_deg)
    nearest = max(measured, key=lambda m: max(m.velocity.most_sensitivity_db, m.position.most_sensitivity_db))
    gain = min(min(m.velocity.least_gain_margin_db, m.position.least_gain_margin_db) for m in measured)
    most = max(nearest.velocity.most_sensitivity_db, nearest.position.most_sensitivity_db)
    lines = [
        f"measured responses, no model between ({len(measured)}, with 95 %): velocity phase margin at least "
        f"{_margin(velocity.velocity.least_phase_margin_deg, velocity)}, "
        f"position {_margin(position.position.least_phase_margin_deg, position)}, "
        f"gain margin {_db(gain)}, sensitivity at most {_db(most)} ({nearest.record}); {_stability(measured)}"
    ]
    if below := _below(proof, asked):
        lines.append(f"less than the design was asked for: {below}")
    if any(c.direction == "standing" for c in proof.conditions):
        lines.append(STANDING)
    scatter, noise = max(m.scatter for m in measured), max(m.noise for m in measured)
    if scatter > 2.0 * noise:
        lines.append(
            f"neighbouring lines differ by up to {100.0 * scatter:.0f} % where noise explains {100.0 * noise:.1f} %: friction answers with "
            "wrong lines that repeat; they count as they stand and no interval holds them"
        )
    hidden = [
        f"{m.record} {m.hidden_lines} within {_spans(m.hidden_hz)} (loop below {_db(m.hidden_gain_db)})" for m in measured if m.hidden_hz
    ]
    if hidden:
        lines.append(f"lines that noise hides: {'; '.join(hidden)}")
    gaps = [f"{m.record} {_spans(m.gaps_hz)}" for m in measured if m.gaps_hz]
    if gaps:
        lines.append(f"no lines at all, so nothing is shown there: {'; '.join(gaps)}")
    return lines + left


def _below(proof: DesignProof, asked: Specification) -> str:
    """Responses whose margins are below what was asked of the model's, and why that may be."""
    loudest = max(c.amplitude_nm for c in proof.conditions)
    found = []
    for one, condition in zip(proof.measured, proof.conditions, strict=True):
        parts = [
            f"{words} {value:.0f} deg (asked {least:.0f})"
            for words, value, least in (
                ("velocity phase margin", one.velocity.phase_margin_deg, asked.phase_margin_deg),
                ("position phase margin", one.position.phase_margin_deg, asked.position_phase_margin_deg),
            )
            if value < least
        ]
        sensitivity = max(one.velocity.sensitivity_db, one.position.sensitivity_db)
        parts += [f"sensitivity {sensitivity:.1f} dB (asked {asked.sensitivity_db:.1f})"] if sensitivity > asked.sensitivity_db else []
        if parts:
            quiet = condition.amplitude_nm < LOUD_SHARE * loudest
            why = ", so quiet that friction holds it most of the time and shows as more damping than the design counts" if quiet else ""
            found.append(f"{one.record} (±{condition.amplitude_nm:.3f} N m{why}) {', '.join(parts)}")
    return "; ".join(found)


def _stability(measured: Sequence[MeasuredMargins]) -> str:
    """Verdicts of the turns around -1."""
    unstable = [m.record for m in measured if m.stable is False]
    unknown = [m.record for m in measured if m.stable is None]
    if not unstable and not unknown:
        return "stable on each"
    said = [f"UNSTABLE on {', '.join(unstable)}"] if unstable else []
    return "; ".join([*said, *([f"cannot be told on {', '.join(unknown)}"] if unknown else [])])


def _contradictions(found: Sequence[Contradiction], model: Model) -> list[str]:
    """Records that want another load, one by one, and those that none explains, together."""
    lines = []
    for one in found:
        if one.own is None:
            continue
        margin = min(m.phase_margin_deg for m in one.margins)
        stable = all(m.stable and m.velocity_stable for m in one.margins)
        lines.append(
            f"{one.condition.record} ({one.condition.words()}) contradicts the model, which leaves {math.sqrt(one.misfit):.1f} times the "
            f"noise: it wants {one.own['cart.mass']:.2f} kg at the carriage instead of {model['cart.mass']:.2f} kg; on that load "
            + (f"the velocity phase margin is {margin:.0f} deg, " if stable else "the loop is UNSTABLE, ")
            + ("enough" if one.holds else "not enough")
        )
    rest = [f"{one.condition.record} {math.sqrt(one.misfit):.1f}" for one in found if one.own is None]
    if rest:
        lines.append(
            f"where no other load explains it either, the model leaves, times the noise: {', '.join(rest)}; something else acts there"
        )
    return lines


def _margin(value: float, one: MeasuredMargins) -> str:
    return f"without a crossover in the band ({one.record})" if math.isinf(value) else f"{value:.0f} deg ({one.record})"


def _db(value: float) -> str:
    return f"{value:.1f} dB" if math.isfinite(value) else "not known" if value > 0.0 else "any level"


def _spans(ranges: Iterable[tuple[float, float]]) -> str:
    return ", ".join(f"{low:.0f} to {high:.0f} Hz" if high - low >= 1.0 else f"{low:.0f} Hz" for low, high in ranges)
