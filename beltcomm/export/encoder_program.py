"""Velocity from the edges of an incremental encoder as data: state machine, high-pass, event counter, gate and combination of section 6.1.

The statements are those of :mod:`beltcomm.encoder.kernel`, with the two channels' levels handed in together, as a logic or an interrupt
sees them: :data:`EDGE` is run once for every tick in which a level has changed, :data:`PERIOD` at every sampling instant.
All angles at the motor shaft.

Sources: (6.1), (6.2), (6.4), (6.14), (6.17), (6.20), (6.21), as mended in :mod:`beltcomm.encoder.estimators`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from beltcomm.encoder.estimators import EstimatorSettings, checked
from beltcomm.encoder.formulas import crossing_speed_m_s
from beltcomm.errors import UsageError
from beltcomm.export.program import Controller, Let, NamedValue, Statement, statements

COEFFICIENTS = (
    NamedValue("increment_rad", "rad", "angle of one count, all four edges of a line counted"),
    NamedValue("tick_s", "s", "unit of the ticks in which edges are timed"),
    NamedValue("period_s", "s", "sampling period T_s"),
    NamedValue("lag_pole", "", "pole of the high-pass, T_R/(T_R + T_s)"),
    NamedValue("low_pass_pole", "", "pole of the low-pass behind gate and event counter in the combination; 0: none"),
    NamedValue("timeout_ticks", "ticks", "time-out: without a count for so long, or beyond it, the velocity is 0", True),
    NamedValue("crossing_rad_s", "rad/s", "speed at which gate and event counter are equally exact (6.19)"),
)
STATES = (
    NamedValue("state", "", "S1 to S4 forward, S5 to S8 in reverse (6.2)", True),
    NamedValue("turned", "", "1: a level went back, and no count has been made of it yet", True),
    NamedValue("last_a", "", "level of channel A", True),
    NamedValue("last_b", "", "level of channel B", True),
    NamedValue("count", "", "position in counts", True),
    NamedValue("invalid", "", "changes that no motion makes; above 0 the position is not to be trusted", True),
    NamedValue("last_tick", "ticks", "time of the last count", True),
    NamedValue("last_sense", "", "its direction, 0: none is known", True),
    NamedValue("gap", "ticks", "between the last two counts, 0: not known", True),
    NamedValue("increments", "", "counts in this period", True),
    NamedValue("first_tick", "ticks", "time of the first of them", True),
    NamedValue("travelled", "", "signed counts after the first of them", True),
    NamedValue("edge_tick", "ticks", "time of the last change", True),
    NamedValue("count_before", "", "count before it", True),
    NamedValue("invalid_before", "", "invalid changes before it", True),
    NamedValue("state_before", "", "state before it", True),
    NamedValue("sampled_count", "", "count at the last sampling instant", True),
    NamedValue("filtered_rad_s", "rad/s", "high-pass at the last sampling instant"),
    NamedValue("gate_lagged_rad_s", "rad/s", "gate behind the low-pass"),
    NamedValue("events_lagged_rad_s", "rad/s", "event counter behind the low-pass"),
)
EDGE_INPUTS = (
    NamedValue("tick", "ticks", "time at which the levels were first seen, from 0, rising", True),
    NamedValue("level_a", "", "level of channel A, 0 or 1", True),
    NamedValue("level_b", "", "level of channel B, 0 or 1", True),
)
PERIOD_INPUTS = (NamedValue("now_tick", "ticks", "sampling instant; all changes up to it have been handed in", True),)
RESET_INPUTS = (*EDGE_INPUTS[1:], NamedValue("reset_velocity_rad_s", "rad/s", "velocity that the lags begin with"))
OUTPUTS = (
    NamedValue("position_rad", "rad", "angle at the sampling instant, in whole counts"),
    NamedValue("high_pass_rad_s", "rad/s", "high-pass (6.1)"),
    NamedValue("event_counter_rad_s", "rad/s", "event counter (6.4), 0 below two counts in the period"),
    NamedValue("gate_rad_s", "rad/s", "gate measurement (6.14), falling while no count comes, 0 from the time-out on"),
    NamedValue("combined_rad_s", "rad/s", "combination (6.21): gate at low speed, event counter at high speed"),
)
EDGE_LOCALS = (
    NamedValue("forward", "", "state of these levels going forward", True),
    NamedValue("sense", "", "direction so far", True),
    NamedValue("here", "", "state of these levels in that direction", True),
    NamedValue("following", "", "state that comes next", True),
    NamedValue("changed", "", "levels that have changed", True),
    NamedValue("fault", "", "1: no motion makes this change", True),
    NamedValue("made", "", "count that this change makes, 1, -1 or 0", True),
)
PERIOD_LOCALS = (
    NamedValue("difference_rad_s", "rad/s", "difference of the counted angle over the period"),
    NamedValue("waited", "ticks", "since the last count", True),
    NamedValue("lasted", "ticks", "time that one count stands for", True),
    NamedValue("events_rad_s", "rad/s", "event counter, or the gate where it has no value"),
    NamedValue("speed_rad_s", "rad/s", "speed that chooses"),
    NamedValue("weight", "", "share of the event counter (6.20)"),
)

_FORWARD = """
# Levels (0, 0), (1, 0), (1, 1), (0, 1) are S1 to S4 going forward, S8 to S5 going in reverse.
if level_a == level_b:
    forward = 1 + 2 * level_a
else:
    forward = 2 + 2 * level_b
"""
RESET: tuple[Statement, ...] = (
    *statements(_FORWARD),
    *(Let(q.name, "0" if q.whole else "reset_velocity_rad_s") for q in STATES if q.name not in ("state", "last_a", "last_b", "edge_tick")),
    Let("state", "forward", "It begins in a forward state of the present levels."),
    Let("last_a", "level_a"),
    Let("last_b", "level_b"),
    Let("edge_tick", "-1"),
)
#: One tick in which a level has changed.
EDGE = statements(f"""
# A second change in the same tick takes back what the first one made.
if tick > edge_tick:
    count_before = count
    invalid_before = invalid
    state_before = state
    edge_tick = tick
    fault = 0
else:
    count = count_before
    invalid = invalid_before
    state = state_before
    fault = 1
{_FORWARD}
sense = 1
here = forward
if state > 4:
    sense = -1
    here = 9 - forward
following = state + 1
if state == 4:
    following = 1
elif state == 8:
    following = 5
changed = 0
if level_a != last_a:
    changed = changed + 1
if level_b != last_b:
    changed = changed + 1
# Both at once, or none: a change was missed.
if changed != 1:
    fault = 1
made = 0
# State machine (6.2): on in its cycle is a count; back is none, until it goes on in reverse, so a bounce counts nothing. After an invalid
# change it goes on from these levels, and nothing before is measured from.
if fault == 1:
    state = here
    turned = 0
    invalid = invalid + 1
    last_tick = 0
    last_sense = 0
    gap = 0
    increments = 0
    first_tick = 0
    travelled = 0
elif turned == 1 and here == state:
    turned = 0
elif turned == 1:
    turned = 0
    state = 9 - here
    made = -sense
elif here == following:
    state = here
    made = sense
else:
    turned = 1
last_a = level_a
last_b = level_b
# A count: its time, the time since the one before, what the period holds.
if made != 0 and last_sense != 0:
    gap = tick - last_tick
elif made != 0:
    gap = 0
if made != 0 and increments == 0:
    first_tick = tick
elif made != 0:
    travelled = travelled + made
if made != 0:
    count = count + made
    last_tick = tick
    last_sense = made
    increments = increments + 1
""")
#: One sampling instant.
PERIOD = statements(f"""
position_rad = real(count) * increment_rad
# High-pass (6.1) by backward differences.
difference_rad_s = real(count - sampled_count) * increment_rad / period_s
sampled_count = count
filtered_rad_s = lag_pole * filtered_rad_s + (1.0 - lag_pole) * difference_rad_s
high_pass_rad_s = filtered_rad_s
# Event counter (6.4): counts after the first one over the time from the first to the last.
event_counter_rad_s = 0.0
if increments > 1:
    event_counter_rad_s = real(travelled) * increment_rad / (real(last_tick - first_tick) * tick_s)
# Gate (6.14): one count over the time between the last two, or over the time since the last one once that is longer (6.17).
waited = now_tick - last_tick
lasted = gap
if waited > gap:
    lasted = waited
gate_rad_s = 0.0
if gap > 0 and gap < timeout_ticks and waited < timeout_ticks:
    gate_rad_s = real(last_sense) * increment_rad / (real(lasted) * tick_s)
# Combination (6.21); where the event counter has no value the gate stands in for it.
events_rad_s = event_counter_rad_s
if increments < 2:
    events_rad_s = gate_rad_s
gate_lagged_rad_s = low_pass_pole * gate_lagged_rad_s + (1.0 - low_pass_pole) * gate_rad_s
events_lagged_rad_s = low_pass_pole * events_lagged_rad_s + (1.0 - low_pass_pole) * events_rad_s
speed_rad_s = max(gate_lagged_rad_s, -gate_lagged_rad_s)
# Share of the event counter (6.20).
weight = 0.5 * (1.0 - sin({math.pi!r} * speed_rad_s / crossing_rad_s))
if speed_rad_s <= 0.5 * crossing_rad_s:
    weight = 0.0
elif speed_rad_s >= 1.5 * crossing_rad_s:
    weight = 1.0
combined_rad_s = (1.0 - weight) * gate_lagged_rad_s + weight * events_lagged_rad_s
# The next period begins.
increments = 0
first_tick = 0
travelled = 0
""")


def encoder_of(settings: EstimatorSettings, provenance: Mapping[str, str], notes: Sequence[str]) -> Controller:
    """The exported form of the velocity estimators.

    Parameters
    ----------
    settings : EstimatorSettings
        Increment, m, tick, period and lags, s.
    provenance : mapping of str to str
        Where the numbers are from.
    notes : sequence of str
        Sentences for the head of the file.

    Returns
    -------
    Controller
        Coefficients by name.

    Raises
    ------
    UsageError
        For a setting out of its range, and for a time-out without an end.
    """
    s = checked(settings)
    if not math.isfinite(s.timeout_s):
        raise UsageError("an exported time-out needs an end; give one")
    numbers = (
        s.increment_m,
        s.tick_s,
        s.period_s,
        s.lag_s / (s.lag_s + s.period_s),
        s.low_pass_s / (s.low_pass_s + s.period_s),
        float(math.ceil(s.timeout_s / s.tick_s)),
        crossing_speed_m_s(s.increment_m, s.tick_s, s.period_s),
    )
    return Controller({q.name: value for q, value in zip(COEFFICIENTS, numbers, strict=True)}, provenance, notes)
