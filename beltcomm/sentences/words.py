"""Results in plain sentences and small tables, for people.  No printing here."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from beltcomm.control import Cascade
from beltcomm.design.cascade import DesignResult
from beltcomm.design.structure import late_s, neglected_effects
from beltcomm.drive import simulated
from beltcomm.fit.model_fit import ModelFit
from beltcomm.fit.noise.level import error_floor_words
from beltcomm.identify.friction import FrictionFit
from beltcomm.identify.magnitude_fit import MagnitudeFit
from beltcomm.model import Model
from beltcomm.model.value import Value
from beltcomm.quantities import in_mm, mm, read_in
from beltcomm.rundata.analyse import Characteristic, Nonlinearity
from beltcomm.verify import Demand, Verdict

_TORQUE, _DAMPING = (read_in(unit)[::-1] for unit in ("N m", "N m s/rad"))
#: Name in the model -> words, unit shown, factor.
SHOWN = {
    "motor.inertia": ("motor-side inertia", "kg cm²", 1e4),
    "cart.mass": ("carriage mass", "kg", 1.0),
    "belt_stiffness.stiffness": ("belt stiffness", "kN/m", 1e-3),
    "belt_spans.specific_stiffness": ("belt specific stiffness EA", "kN", 1e-3),
    "belt_spans.offset": ("free belt at position 0", "mm", 1e3),
    "belt_damping.damping": ("belt damping", "N s/m", 1.0),
    "viscous.damping": ("viscous friction, motor", *_DAMPING),
    "viscous_cart.damping": ("viscous friction, carriage", "N s/m", 1.0),
    "coulomb.level": ("Coulomb friction, motor", *_TORQUE),
    "cart_friction.level": ("Coulomb friction, carriage", "N", 1.0),
    "dead_time.time": ("dead time, reported torque to motion", "ms", 1e3),
    "constant_offset.torque": ("constant torque: tilt, friction by direction, current offset", *_TORQUE),
}
#: The same of what follows from a model.
DERIVED = {
    "resonance": ("resonance", "Hz", 1.0),
    "antiresonance": ("antiresonance", "Hz", 1.0),
    "coulomb_total": ("Coulomb friction, all, at the motor", *_TORQUE),
    "viscous_total": ("viscous friction, all, at the motor", *_DAMPING),
}


#: Share of a value below which its interval says nothing of it.
LEAST_SHARE = 1e-7


def number(value: float, interval: float | None, unit: str) -> str:
    """Value with its 95 % interval, rounded to the interval's second digit.

    Parameters
    ----------
    value : float
        In ``unit``.
    interval : float or None
        Half width in ``unit``; None where it is not known.
    unit : str
        As it is printed.
    """
    unknown = interval is None or not math.isfinite(interval) or interval <= 0.0
    if interval is None or unknown or interval < LEAST_SHARE * abs(value):  # that the search met and never left: not known that well
        return f"{value:.0f} {unit}" if 1e4 <= abs(value) < 1e7 else f"{value:.4g} {unit}"
    digits = max(0, 1 - math.floor(math.log10(interval)))
    return f"{value:.{digits}f} ± {interval:.{digits}f} {unit}"


def thousandths(value: Value, unit: str) -> str:
    """A value in thousandths of its unit with its interval, see :func:`number`.

    Parameters
    ----------
    value : Value
    unit : str
        A thousandth of its own, as it is printed; "" where the head of a table says it.
    """
    return number(1e3 * value.value, None if value.interval is None else 1e3 * value.interval, unit).rstrip()


def model_lines(fit: ModelFit, characteristics: Mapping[str, Characteristic], error: float | None) -> list[str]:
    """The fitted model with 95 % intervals, its misfit and what to know of it.

    Parameters
    ----------
    fit : ModelFit
        With intervals.
    characteristics : mapping of str to Characteristic
        By name.
    error : float or None
        Over the noise, in place of the misfit.
    """
    lines = ["Model (95 % intervals):"]
    for name, (words, unit, factor) in SHOWN.items():
        item = fit.model.parameters.get(name)
        if item is not None:
            half = None if item.interval is None else item.interval * factor
            lines.append(f"  {words:36} {number(item.value * factor, half, unit)}")
    for name, (words, unit, factor) in DERIVED.items():
        if name in characteristics:
            item2 = characteristics[name]
            lines.append(f"  {words:36} {number(item2.value * factor, item2.interval * factor, unit)}")
    level = math.sqrt(fit.misfit) if error is None else error
    doubt = error_floor_words(level)
    meaning = "" if doubt else "; 1.00: nothing is missing" if fit.judged else "; between the rows nothing is judged"
    lines.append(f"  unexplained torque is {level:.2f} x the noise ({1e3 * fit.noise_nm:.1f} mN m){meaning}")
    lines += [f"  {doubt}"] if doubt else []
    if level > 1.3:
        lines.append("  the model does not explain everything that was measured: look at the recordings before trusting it")
    return lines + [f"  {_named(remark)}" for remark in fit.remarks]


def _named(remark: str) -> str:
    """A remark with the parameters' names as in the table above it."""
    for name, (words, *_) in SHOWN.items():
        remark = remark.replace(name, words)
    return remark


def thesis_lines(fits: Mapping[str, MagnitudeFit]) -> list[str]:
    """The log-magnitude fits beside the final one.

    Parameters
    ----------
    fits : mapping of str to MagnitudeFit
        By record.
    """
    if not fits:
        return []
    lines = [
        "For comparison, the usual fit to the frequency responses. Friction biases it by some per cent (mass, stiffness) and poses as "
        "damping; the model above holds:"
    ]
    for name, fit in fits.items():
        two = fit.two_mass
        apparent = 1e3 * two.transmission_m_rad**2 * (two.motor_damping_n_s_m + two.cart_damping_n_s_m)
        lines.append(
            f"  {name:12} {two.mass_kg:.2f} kg, {two.stiffness_n_m / 1e3:.1f} kN/m, resonance {two.resonance_hz:.1f} Hz, antiresonance "
            f"{two.antiresonance_hz:.1f} Hz, apparent damping {apparent:.0f} mN m s/rad at the motor, rest {fit.rms_db:.1f} dB"
        )
    return lines


def friction_lines(friction: FrictionFit) -> list[str]:
    """Coulomb and viscous friction of the sweep, per direction too.

    Parameters
    ----------
    friction : FrictionFit, N m, N m s/rad, motor shaft
        Of the sweep.
    """
    lines = [
        "Friction from the sweep (motor and carriage together, at the motor):",
        f"  Coulomb  {thousandths(friction.coulomb, 'mN m')}",
        f"  viscous  {thousandths(friction.viscous, 'mN m s/rad')}",
    ]
    for words, pair in (("forward", friction.forward), ("backward", friction.backward)):
        if pair is not None:
            viscous, coulomb = pair
            lines.append(f"  {words:8} {1e3 * coulomb.value:.1f} mN m, {1e3 * viscous.value:.3f} mN m s/rad")
    if friction.repeat_scatter_nm is not None:
        scatter = f"{1e3 * friction.repeat_scatter_nm:.2g} mN m rms beyond" if friction.repeat_scatter_nm > 0.0 else "no more than"
        lines.append(f"  strokes repeated at the same speed differ by {scatter} their noise")
    return lines + [f"  {remark}" for remark in friction.remarks]


def design_lines(design: DesignResult, cascade: Cascade) -> list[str]:
    """Gains and the worst margins over all plants.

    Parameters
    ----------
    design : DesignResult
        Result with its margins.
    cascade : Cascade
        That was designed.
    """
    worst = min(design.margins, key=lambda m: m.phase_margin_deg)
    slowest = min(design.margins, key=lambda m: m.position_phase_margin_deg)
    sensitivity = max(m.most_sensitivity_db for m in design.margins)
    prefilter = cascade.prefilter
    shown = {
        "none": "none",
        "notch": f"notch at {prefilter.omega_rad_s / 2 / math.pi:.1f} Hz, d_n {prefilter.d_n:.2f}",
        "butterworth": f"Butterworth at {prefilter.omega_rad_s / 2 / math.pi:.1f} Hz",
    }[prefilter.kind]
    shown += f", low-pass at {prefilter.roll_off_rad_s / 2 / math.pi:.1f} Hz" if prefilter.roll_off_rad_s else ""
    feedforward = cascade.feedforward
    lines = [
        "Controller:",
        f"  position gain Kv {cascade.kpp_1_s:.3g} 1/s, velocity gain Kp {cascade.kp_nm_s_rad:.4g} N m s/rad, integral gain Ki "
        f"{cascade.ki_nm_rad:.4g} N m/rad, velocity feedback filter (T_R) {1e3 * cascade.velocity_filter_s:.2g} ms, prefilter {shown}",
        f"  feedforward at the motor: inertia {1e4 * feedforward.inertia_kg_m2:.2f} kg cm², viscous "
        f"{1e3 * feedforward.viscous_nm_s_rad:.2f} mN m s/rad, Coulomb {1e3 * feedforward.coulomb_nm:.1f} mN m, "
        f"velocity {100 * feedforward.velocity:.0f} %, preview {1e3 * feedforward.advance_s:.2f} ms"
        if feedforward.inertia_kg_m2 or feedforward.coulomb_nm or feedforward.viscous_nm_s_rad or feedforward.velocity
        else "  feedforward: none" + ("" if design.structure.velocity_feedforward else ", this drive has none"),
        f"  stable by calculation on {len(design.plants)} variants of the model (both ends, payloads, damping down to none)",
        f"    stability margins, worst of them: phase margin {worst.phase_margin_deg:.0f}° in the velocity loop and "
        f"{slowest.position_phase_margin_deg:.0f}° in the position loop, resonance at "
        f"{max(m.suppression_db for m in design.margins):.1f} dB; peak sensitivity Ms {sensitivity:.1f} dB",
    ]
    lines += [f"  limited by: {reason}" for reason in design.binding]
    return lines + [f"  {remark}" for remark in design.remarks]


def knowledge_lines(model: Model, along: Sequence[str], which: str) -> list[str]:
    """Effects of a model that the controller uses, and how.

    Parameters
    ----------
    model : Model
    along : sequence of str
        Effects whose torque is sent along.
    which : str
        Sentence on the model, "" for none.
    """
    lines = [f"  {which}"] if which else []
    if model.get("constant_offset.torque") or model.get("tilt.angle"):
        lines.append("  the feedforward holds the constant torque of the axis")
    if along:
        lines.append(f"  sent along with the reference by `beltcomm verify`, beyond the drive's own feedforward: {', '.join(along)}")
    late = late_s(model)
    if late > 0.0:
        lines.append(f"  the margins count {1e3 * late:.2f} ms of late torque that the model has")
    if blind := neglected_effects(model):
        lines.append(f"  the margins do not know {', '.join(blind)}: the belt counts as it is under load")
    return lines


#: What the two errors are.
_ERRORS = "following error: the largest while it moves; settled error: the largest from the settling time to 1.5 s after its end"


def verdict_lines(verdict: Verdict, demand: Demand | None, feedforward: str | None = None) -> list[str]:
    """Predicted and measured tracking error.

    Parameters
    ----------
    verdict : Verdict, m
        Of a move.
    demand : Demand or None
        Asked of the axis by the move; None where it is not known.
    feedforward : str or None
        What took the place of the design's, if anything.
    """
    lines = [f"Verification move{f', with feedforward {feedforward} for this move only' if feedforward else ''} ({_ERRORS}):"]
    if demand is not None:
        lines.append(
            f"  planned: up to {demand.speed_m_s:.3g} m/s, {demand.acceleration_m_s2:.3g} m/s², {demand.feed_force_n:.3g} N feed force, "
            f"{demand.torque_nm:.2f} N m at the motor"
        )
    for words, measured, expected, spread in (
        ("at the motor", verdict.measured, verdict.predicted, verdict.predicted_range),
        ("at the carriage", verdict.measured_cart, verdict.predicted_cart, None),
    ):
        parts = []
        for what, name in (("following error", "dynamic_m"), ("settled", "static_m")):
            between = f", range {' to '.join(in_mm(getattr(end, name)) for end in spread)}" if spread else ""
            guess = mm(getattr(expected, name))
            if measured is None:
                parts.append(f"{what} {guess}")
            else:
                parts.append(f"{what} {mm(getattr(measured, name))} (predicted {guess}{between})")
        lines.append(f"  {words:16} {', '.join(parts)}{' (predicted; nothing measures there)' if measured is None else ''}")
    return lines + [f"  {reason}" for reason in verdict.reasons]


def remarks_lines(remarks: Sequence[str]) -> list[str]:
    """Remarks as lines of a screen.

    Parameters
    ----------
    remarks : sequence of str
        Sentences.
    """
    return [f"Note: {remark}" for remark in remarks]


def lasting(drive: str) -> str:
    """Values that a virtual drive keeps of those written to it; nothing is said of a real one.

    Parameters
    ----------
    drive : str
        As for ``--drive``.
    """
    return ". A virtual drive begins anew with every command and forgets what was written" if simulated(drive) else ""


def nonlinearity_lines(found: Mapping[str, Nonlinearity]) -> list[str]:
    """Findings of the silent lines of multisines, one line each.

    Parameters
    ----------
    found : mapping of str to Nonlinearity
        By record; shares of the linear answer.
    """
    return [
        f"{name}: on lines that were not excited, {n.low_hz:.3g} to {n.high_hz:.3g} Hz, the axis answers with {100 * n.odd:.1f} % of the "
        f"linear answer on odd and {100 * n.even:.1f} % on even ones (noise {100 * n.noise:.2f} %): "
        + (
            "odd is friction or a stiffness that depends on its load"
            if n.odd > max(n.even, 2.0 * n.noise)
            else "even is something that differs by direction"
            if n.even > 2.0 * n.noise
            else "nothing above the noise"
        )
        for name, n in found.items()
    ]
