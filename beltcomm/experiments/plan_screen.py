"""The plan on one screen: what moves how far, how fast and how hard against its limits, what stops it; the rest is in its details."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from textwrap import wrap

from beltcomm.axis import Axis
from beltcomm.drive import Capabilities
from beltcomm.experiments import phases, sampling_limits
from beltcomm.experiments.bounds import peak_torque_nm
from beltcomm.experiments.plan import Plan
from beltcomm.language import tr
from beltcomm.machine import gravity
from beltcomm.quantities import three_digits
from beltcomm.result import Line, bar

#: Columns and lines of a screen; lines that what is said of a plan takes at most; rows of its table of records.
WIDE, HIGH, TEXT_LINES, ROWS = 80, 22, 4, 5
#: Share of a limit from which its bar is marked.
NEAR = 0.98
#: Share of the travel from which all of it counts as used.
WHOLE = 0.98


def plan_screen(plan: Plan, axis: Axis, capabilities: Capabilities) -> list[Line]:
    """The plan as a screen: up to 22 lines of 80 columns.

    Parameters
    ----------
    plan : Plan
        To be agreed to.
    axis : Axis
    capabilities : Capabilities

    Returns
    -------
    list of Line
        A plan of more lines loses the empty one below the title.
    """
    name = axis.name or tr("axis without a name")
    title = Line(" ", (f"beltcomm {plan.verb}".rstrip(), "title"), "   ", (name, "title"), f"   {tr('drive')}: {capabilities.name}"[:WIDE])
    warning = Line("  ", (tr("THE AXIS WILL MOVE BY ITSELF.  Keep people, tools and cables out."), "bad"))
    said = plan.said()
    text = wrap(said, WIDE - 4, max_lines=TEXT_LINES, placeholder=" ... [d]") if said else []
    lines = [
        title,
        Line(""),
        warning,
        *(Line("  " + line) for line in text),
        Line(""),
        *_bounds(plan, axis, capabilities),
        *_gravity(plan, axis),
        Line(""),
        *_records(plan),
        Line(""),
        *_stops(plan),
        *(Line("  ", (f"! {line}", "note")) for line in _doubts(plan, axis, capabilities)),
    ]
    return lines if len(lines) <= HIGH else [title, *lines[2:]]


def _bounds(plan: Plan, axis: Axis, capabilities: Capabilities) -> list[Line]:
    """Range, speed, torque, belt force, heat and duration."""
    keys = ("reach_m", "speed_m_s", "torque_nm", "belt_force_n")
    most = {key: max((getattr(e, key) for e in plan.experiments), default=0.0) for key in keys}
    peak = peak_torque_nm(axis, capabilities)
    # two limits may bound a belt's force: the data sheet's feed force, and what its pulley's torque makes of it
    by_pulley = axis.limits.pulley_torque_nm is not None and axis.belt_force_limit_n != axis.limits.feed_force_n
    rows = [Line("   ", (f"{tr('range'):<13}", "title"), _range(plan, axis, most["reach_m"]))]
    for label, value, limit, unit, of in (
        (tr("speed"), most["speed_m_s"], axis.limits.speed_m_s or math.nan, "m/s", tr("axis limit")),
        (tr("motor torque"), most["torque_nm"], peak, "N m", tr("peak")),
        (tr("belt force"), most["belt_force_n"], axis.belt_force_limit_n, "N", tr("pulley limit") if by_pulley else tr("axis limit")),
    ):
        share = value / limit if limit > 0.0 else math.nan
        told = f"{of} {three_digits(limit)} {unit}" if math.isfinite(limit) else tr("limit not known")
        style = "note" if share >= NEAR else "bar"
        upto = f"{tr('up to')} {three_digits(value)} {unit}"
        rows.append(Line("   ", (f"{label:<13}", "title"), upto.ljust(20), told.ljust(24), (bar(share), style)))
    rows.append(_heat(plan))
    whole = sum(round(one.seconds) for one in plan.experiments)  # what the entries below add up to
    pause = tr("of {whole:.0f} s below; the rest is left out", whole=whole) if plan.over_budget else tr("at most")
    rows.append(Line("   ", (f"{tr('duration'):<13}", "title"), f"{plan.seconds:.0f} s {tr('in motion')}".ljust(20), pause))
    return rows


def _heat(plan: Plan) -> Line:
    heat = plan.heat
    label = ("   ", ""), (f"{tr('motor heat'):<13}", "title")
    if heat is None:
        return Line(*label, tr("not known: no rated torque"))
    hottest = f"{100.0 * heat.hottest:.0f} % {tr('of S1 at most')}".ljust(20)
    style = "note" if heat.hottest >= NEAR else "bar"
    return Line(*label, hottest, f"{100.0 * heat.continuous:.0f} % {tr('on average')} (I²t)".ljust(24), (bar(heat.hottest), style))


def _range(plan: Plan, axis: Axis, reach_m: float) -> str:
    """Range of the carriage, stopping distance included."""
    if plan.span_m is not None:
        first, last = (1e3 * end for end in plan.span_m)
        return tr("{low:.0f} ... {high:.0f} mm on the axis, stopping distance included", low=first, high=last)
    low, high = axis.travel.min_m, axis.travel.max_m
    if plan.window_m is not None:
        return tr(
            "{low:+.0f} ... {high:+.0f} mm from where it stands, stopping distance included",
            low=1e3 * plan.window_m[0],
            high=1e3 * plan.window_m[1],
        )
    if low is None or high is None or reach_m < WHOLE * (high - low):
        return tr("±{reach:.0f} mm about where it stands, stopping distance included", reach=1e3 * reach_m)
    return tr("{low:.0f} ... {high:.0f} mm  (whole travel, stopping distance included)", low=1e3 * low, high=1e3 * high)


def _gravity(plan: Plan, axis: Axis) -> list[Line]:
    """Of a tilted axis what is held, and how far it may slip while that is found."""
    if not axis.mounting.tilted:
        return []
    held = tr("held with about {torque:.2g} N m", torque=abs(gravity.expected(axis).torque_nm))
    slip = tr("may slip {slip:.0f} mm while that is found", slip=1e3 * phases.SIGN_REACH_M) if plan.host_loss else ""
    brake = "" if axis.motor.brake_torque_nm else tr("NO BRAKE STATED: only friction holds it without torque")
    rows = [Line("   ", (f"{tr('gravity'):<13}", "title"), ", ".join(filter(None, [held, slip])))]
    return [*rows, Line("   ", " " * 13, (brake, "bad"))] if brake else rows


def _records(plan: Plan) -> list[Line]:
    """The records, alike ones together, in two columns."""
    groups: dict[str, list[float]] = {}
    for one in plan.experiments:
        title = re.split(r" at |, |:", one.title)[0]
        kind = "frequency response" if "response" in title else title
        count, travel_m, seconds = groups.get(kind, [0, 0.0, 0.0])
        groups[kind] = [count + 1, max(travel_m, one.travel_m), seconds + one.seconds]
    cells = [
        f"  {(tr(title) + (f' x{count:.0f}' if count > 1 else ''))[:23]:<23} {1e3 * travel_m:4.0f} mm{seconds:3.0f} s"
        for title, (count, travel_m, seconds) in groups.items()
    ]
    rows = math.ceil(len(cells) / 2)
    shown = min(rows, ROWS)
    lines = [Line(" ", cells[k], "  ", cells[k + rows] if k + rows < len(cells) else "") for k in range(shown)]
    return lines if shown == rows else [*lines, Line("  ", (f"   ... {tr('all of them')}: [d]", "soft"))]


def _stops(plan: Plan) -> list[Line]:
    rows = [Line("  ", ("STOP", "title"), "  ", tr("Ctrl-C: controlled stop; twice: leaves at once.  E-stop in your hand"))]
    if plan.host_loss is not None:
        reaction_s, coast_m = plan.host_loss
        rows.append(
            Line(
                "  ",
                tr(
                    "bus or PC lost: drive stops by itself after {ms:.0f} ms, coasts {coast:.0f} mm at most",
                    ms=1e3 * reaction_s,
                    coast=1e3 * coast_m,
                ),
            )
        )
    if plan.host_loss_n is not None and math.isfinite(plan.host_loss_n):
        lost, stop = plan.host_loss_n, plan.stop_n
        told = (
            tr("bus or PC lost in a move: up to {force:.0f} N for milliseconds, until it stands", force=lost)
            if stop is None
            else tr("belt, for milliseconds: stop {stop:.0f} N + friction, bus or PC lost {force:.0f} N", stop=stop, force=lost)
        )
        rows.append(Line("  ", told))
    return [*rows, Line("  ", plan.written())]


def _doubts(plan: Plan, axis: Axis, capabilities: Capabilities) -> Sequence[str]:
    """Doubts about the plan's records, a line each as far as it goes."""
    doubts = [*capabilities.cautions, *(doubt for doubt in sampling_limits.doubts_before(axis, capabilities) if doubt in plan.notes)]
    return [f"{note[: WIDE - 12]} ... [d]" if len(note) > WIDE - 6 else note for note in doubts[:2]]
