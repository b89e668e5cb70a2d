"""Sweeps of friction in sentences and small tables.  No printing here."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from beltcomm.identify.friction import FrictionFit
from beltcomm.identify.standstill import Standstill
from beltcomm.identify.sweeps import FEWEST_SPEEDS, Drift, LoadDependence, Sweep, clear
from beltcomm.model.value import Value
from beltcomm.result import table
from beltcomm.schedule.orders import DEFAULT
from beltcomm.sentences.words import number, thousandths

if TYPE_CHECKING:  # the report uses this module too, and drives no stroke
    from beltcomm.schedule.orders import Stroke

#: A prediction within this factor of what was seen explains it.
EXPLAINS = 1.5
#: Share of passes that miss their speed from which on it is said that the loop is to blame.
MISSED_SHARE = 0.1


def stroke_lines(strokes: Sequence[Stroke], left_out_m_s: Sequence[float]) -> list[str]:
    """Strokes and their speeds, neighbours with the same way on one line, after the plan's table.

    Parameters
    ----------
    strokes : sequence of Stroke
        Of all records.
    left_out_m_s : sequence of float, m/s
        Speeds that have no stroke.
    """
    lines = ["Strokes, forth and back at each speed; measured is what stands here, behind 0.2 s of running in:"]
    for unit, group in itertools.groupby(sorted(strokes, key=lambda s: s.speed_m_s), key=lambda s: s.way.split(" ", 1)[1].rstrip("s")):
        some = list(group)
        ways = [s.way.split(" ", 1)[0] for s in some]
        count = ways[0] if len(set(ways)) == 1 else f"{min(ways, key=float)} to {max(ways, key=float)}"
        words = some[-1].way.split(" ", 1)[1] if unit else "mm"
        first, last = some[0].speed_m_s, some[-1].speed_m_s
        times = [s.plateau_s for s in some]
        speeds = f"{first:g} m/s" if first == last else f"{first:g} to {last:g} m/s"
        lines.append(f"  {speeds:20} {count} {words}, {min(times):.2f} to {max(times):.2f} s")
    if left_out_m_s:
        lines.append(f"  {_speeds(left_out_m_s)}: left out, no way for their ramps and a plateau")
    slow = [s for s in strokes if s.way.endswith(("tooth of the belt", "teeth of the belt", "mm"))]
    if slow:
        lines.append("  (a whole turn of the pulley at the slowest speed would take minutes; runout is not averaged away there)")
    return lines


def _speeds(speeds_m_s: Sequence[float]) -> str:
    """Speeds in words, the range where there are many."""
    if len(speeds_m_s) > 3:
        return f"{len(speeds_m_s)} speeds from {min(speeds_m_s):g} to {max(speeds_m_s):g} m/s"
    return ", ".join(f"{v:g}" for v in speeds_m_s) + " m/s"


def study_lines(sweeps: Sequence[Sweep], drifts: Mapping[int, Drift | str], left_out_m_s: Sequence[float]) -> list[str]:
    """The sweeps of a run in one table, what the order changes, and the drift; nothing for the single sweep of before.

    Parameters
    ----------
    sweeps : sequence of Sweep
        With and without a fit of their own.
    drifts : mapping of int to Drift or str
        By measurement; a sentence where there is none.
    left_out_m_s : sequence of float, m/s
        Speeds that have no stroke.
    """
    shown = [s for s in sweeps if s.fit is not None]
    lines = []
    if left_out_m_s:
        lines.append(f"  not driven: {_speeds(left_out_m_s)}; ramps, a plateau and a stop from there do not fit into the travel")
    if len(shown) > 1 or any(s.note.measurement for s in shown):
        lines += _table(shown)
        lines += _order_lines(shown)
    lines += [
        f"  {s.name}: too few of its {len(s.plateaus)} passes moved as asked for friction of its own; they count in that of all"
        for s in sweeps
        if s.fit is None and len({round(abs(p.reference_rad_s), 6) for p in s.plateaus}) >= FEWEST_SPEEDS
    ]
    passes = [p for s in shown for p in s.plateaus]
    missed = sum(not p.reached_speed for p in passes)
    if missed > MISSED_SHARE * len(passes):
        lines.append(
            f"  {missed} of {len(passes)} passes missed their speed: this drive's loop is too weak for them; it may not have "
            "settled in the others either, so that friction is known less well than its interval says"
        )
    for measurement, drift in drifts.items():
        lines.append(_drift_line(drift, measurement if len(drifts) > 1 else 0, shown))
    return lines


def _table(sweeps: Sequence[Sweep]) -> list[str]:
    names = [s.name.replace(f"{DEFAULT},", "sweep,") + ("" if s.payload_kg is None else f" ({s.payload_kg:g} kg)") for s in sweeps]
    rows = []
    for s, name in zip(sweeps, names, strict=True):
        assert s.fit is not None
        clock = "not known" if s.from_s is None or s.to_s is None else f"{s.from_s / 60.0:.2f} to {s.to_s / 60.0:.2f}"
        driven = len({round(abs(p.reference_rad_s), 6) for p in s.plateaus})
        both = [thousandths(s.fit.coulomb, ""), thousandths(s.fit.viscous, "")]
        rows.append([name, f"{driven}", clock, *both, f"{1e3 * s.fit.rms_nm:.2f}", _slow(s)])
    columns = ["order", ">speeds", ">minutes", ">Coulomb, mN m", ">viscous, mN m s/rad", ">left, mN m", "below 10 mm/s"]
    return [
        "Sweeps one by one (95 % intervals; time on the session's clock; speeds below 10 mm/s are shown and not fitted):",
        *table(columns, rows, "  "),
    ]


def _slow(sweep: Sweep) -> str:
    """Mean torque of the slow speeds above the law, mN m, with the 95 % interval of that mean."""
    left = _slow_above(sweep)
    return "" if left is None else f"{1e3 * left[0]:+.1f} ± {1e3 * left[1]:.1f} mN m"


def _slow_above(sweep: Sweep) -> tuple[float, float] | None:
    """Mean and half 95 % interval of what the passes that were not fitted need above the law, N m; None with fewer than four."""
    if sweep.fit is None:
        return None
    slow = [p for p in sweep.plateaus if p.reached_speed and abs(p.reference_rad_s) < sweep.slowest_rad_s]
    if len(slow) < 4:
        return None
    speed = np.array([p.speed_rad_s for p in slow])
    above = np.sign(speed) * (np.array([p.torque_nm for p in slow]) - sweep.fit.torque_nm(speed))
    return float(above.mean()), 2.0 * float(above.std(ddof=1)) / math.sqrt(len(slow))


def _order_lines(sweeps: Sequence[Sweep]) -> list[str]:
    """Each other order against the first of its measurement: what order and time alone change."""
    lines = []
    for _, group in itertools.groupby(sweeps, key=lambda s: s.note.measurement):
        of = list(group)
        first: dict[str, FrictionFit] = {}
        for s in of:
            if s.fit is not None and s.note.measurement:
                first.setdefault(s.note.order, s.fit)
        names = list(first)
        for name in names[1:]:
            changes = [
                f"{words} {_change(getattr(first[name], key), getattr(first[names[0]], key))}"
                for key, words in (("coulomb", "Coulomb"), ("viscous", "viscous"))
            ]
            lines.append(f"  {name} against {names[0]}: {', '.join(changes)}")
    return lines


def _change(value: Value, base: Value) -> str:
    """Relative change with its interval."""
    half = math.hypot(value.interval or 0.0, base.interval or 0.0)
    change = value.value - base.value
    verdict = "" if abs(change) > half else ", within the scatter"
    return f"{100 * change / base.value:+.1f} ± {100 * half / base.value:.1f} %{verdict}"


def drifts(drift: Drift) -> bool:
    """True if friction changes with time beyond its scatter.

    Parameters
    ----------
    drift : Drift
        Of one measurement.
    """
    return clear(drift.viscous) or clear(drift.coulomb)


def _drift_line(drift: Drift | str, measurement: int, sweeps: Sequence[Sweep]) -> str:
    begin = f"Drift in measurement {measurement}" if measurement else "Drift"
    if isinstance(drift, str):
        return f"{begin}: cannot tell, {drift}"
    fits = [s.fit for s in sweeps if s.fit is not None and s.note.measurement and (not measurement or s.note.measurement == measurement)]
    parts = []
    for value, name, words, unit in (
        (drift.coulomb, "coulomb", "Coulomb", "mN m per minute"),
        (drift.viscous, "viscous", "viscous", "mN m s/rad per minute"),
    ):
        level = float(np.mean([getattr(fit, name).value for fit in fits])) if fits else 0.0
        share = f", {100 * value.value * drift.minutes / level:+.1f} % in all" if level > 0.0 and clear(value) else ""
        verdict = "above the scatter" if clear(value) else "within the scatter"
        parts.append(f"{words} {number(1e3 * value.value, 1e3 * (value.interval or 0.0), unit)} ({verdict}{share})")
    following = (
        "; the axis warms up or wears: `beltcomm diagnose` says which, `beltcomm add warmup RUN` puts it into the model"
        if drifts(drift)
        else ""
    )
    return (
        f"{begin} over {drift.minutes:.1f} min, from {drift.speeds} speeds driven more than once, whatever friction does over speed: "
        f"{'; '.join(parts)}{following}"
    )


def standstill_lines(found: Standstill | None) -> list[str]:
    """One paragraph on why a response around standstill shows another damping than the sweep; nothing without both.

    Parameters
    ----------
    found : Standstill or None, N m s/rad, motor shaft
        None where none was measured.
    """
    if found is None:
        return []
    seen, sweep, unit = found.seen, found.sweep, "mN m s/rad"

    def shown(value: Value) -> str:
        return number(1e3 * value.value, None if value.interval is None else 1e3 * value.interval, unit)

    if not found.contradiction:
        return [
            f"Damping: {found.record}, around standstill, shows i_t² (d_m + d_c) = {shown(seen)}, the sweep {shown(sweep)}: no "
            "contradiction beyond their intervals."
        ]
    omega, cart = found.speed_rad_s
    motor_nm, cart_nm = found.coulomb_nm
    of = [f"{1e3 * motor_nm:.1f} mN m at the motor with Ω = {omega:.2g} rad/s give {1e3 * found.predicted_parts[0]:.1f}"]
    if cart_nm > 0.0:
        moves = "less" if cart < omega else "more"
        of.append(
            f"{1e3 * cart_nm:.1f} mN m of the carriage, which moves {moves}, with Ω = {cart:.2g} rad/s {1e3 * found.predicted_parts[1]:.1f}"
        )
    factor = seen.value / found.predicted.value
    verdict = "Coulomb friction explains it"
    if not 1.0 / EXPLAINS <= factor <= EXPLAINS:
        verdict = f"that is {100.0 / factor:.0f} % of it; for the rest look for other damping or elastic friction (`beltcomm diagnose`)"
    model = ""
    if found.modelled is not None:
        without = f", without its Coulomb friction {1e3 * found.without_coulomb:.1f}" if found.without_coulomb is not None else ""
        model = f" The model under this record's torque shows {1e3 * found.modelled:.0f} by the same fit{without}."
    return [
        f"Damping, two answers: {found.record}, around standstill, shows i_t² (d_m + d_c) = {shown(seen)} by the log-magnitude fit, the "
        f"sweep a viscous friction of {shown(sweep)}, {found.ratio:.0f} times less. Around standstill Coulomb friction M_C reverses with "
        f"the motion and poses as a damper, d = 4 M_C/(π Ω), Ω the record's own speed amplitude: {'; '.join(of)}; with the viscous "
        f"friction in all {1e3 * found.predicted.value:.0f} predicted (roughly: one gain for all frequencies), {1e3 * seen.value:.0f} "
        f"seen: {verdict}.{model} The design uses the friction of the moving axis, from the model, in its feedforward (`--feedforward "
        f"linear` takes the apparent one), and proves its margins for every damping from none to {1e3 * seen.value:.0f} {unit}."
    ]


def load_lines(found: LoadDependence, by: str, common_rad_s: float) -> list[str]:
    """Friction against load, group by group, and the verdict.

    Parameters
    ----------
    found : LoadDependence
        N m and N m s/rad at the motor shaft.
    by : str
        Name of the load's axis.
    common_rad_s : float, rad/s, motor shaft
        Highest speed that all groups have.
    """
    lines = [
        f"Friction against load ({by}; 95 % intervals; speeds up to {common_rad_s:.3g} rad/s at the motor, which all have):",
    ]
    rows = [[g.name, f"{g.load_kg:.2f} kg", f"{g.sweeps}", thousandths(g.coulomb, ""), thousandths(g.viscous, "")] for g in found.groups]
    lines += table(["", ">load", ">sweeps", ">Coulomb, mN m", ">viscous, mN m s/rad"], rows, "  ")
    for value, words, unit in ((found.coulomb, "Coulomb", "mN m per kg"), (found.viscous, "viscous", "mN m s/rad per kg")):
        lines.append(
            f"  {words} friction: {number(1e3 * value.value, 1e3 * (value.interval or 0.0), unit)}: {_load_verdict(found, value, unit)}"
        )
    return lines


def _load_verdict(found: LoadDependence, value: Value, unit: str) -> str:
    if found.repeats and clear(value):
        return "depends on load"
    if not found.repeats:
        differs = "it differs between the runs, but " if clear(value) else ""
        return f"cannot tell; {differs}no sweep was repeated, so nobody knows how well it comes out again (--repeat 3 with each load)"
    most = 1e3 * (abs(value.value) + (value.interval or 0.0))
    return f"cannot tell; if it does, by no more than {most:.2g} {unit}"
