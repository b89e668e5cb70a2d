"""Plan in words for a technician who is to agree: labelled lines on what moves, how far, how fast, how hard, how long, what stops it."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import wrap

from beltcomm.axis import Axis
from beltcomm.drive import Capabilities
from beltcomm.experiments import holding, phases
from beltcomm.language import told
from beltcomm.machine import creep, gravity
from beltcomm.machine.host_loss import guard_times_s
from beltcomm.machine.machine import UNKNOWN_BRAKE_S
from beltcomm.result import Row
from beltcomm.simulate.stopping import first_deceleration

#: A label and what is said under it.
Point = tuple[str, str]
#: Letters of a line where nobody draws a table.
LINE = 104


def point_rows(points: Sequence[Point]) -> list[Row]:
    """The lines, labels in a column of their own; long ones are broken.

    Parameters
    ----------
    points : sequence of Point
        Label and sentence.
    """
    points = [(told(label), told(sentence)) for label, sentence in points]
    wide = max(len(label) for label, _ in points)
    rows = [Row("", ("", ""), (False, False), True)]
    for label, sentence in points:
        broken = wrap(sentence, LINE - wide - 4, break_on_hyphens=False)
        text = f"\n{' ' * (wide + 4)}".join(broken)
        rows.append(Row(f"  {label:{wide}}  {text}", (label, sentence), (False, False)))
    return rows


def commission_points(axis: Axis, capabilities: Capabilities, lightest_kg: float, heaviest: tuple[float, float]) -> tuple[Point, ...]:
    """The whole job: what moves and how far first, then how it stops and what is written.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    lightest_kg : float
        Carriage of the plan's speeds.
    heaviest : tuple of float
        Carriage that is thought of, kg, and how fast it is driven, m/s.
    """
    lightest = f"{lightest_kg:g} kg, the stated payload alone" if axis.payload.mass_kg else f"{lightest_kg:g} kg (worst case for speed)"
    return (
        (
            "what moves",
            "the carriage jogs a few mm in each direction, is excited in place with rising torque, then travels in closed loop: slow "
            "and fast strokes, small triangles, fast moves; and is excited at other places",
        ),
        ("how far", f"between {axis.travel.min_m:g} m and {axis.travel.max_m:g} m, with every stop: keep people, tools and cables out"),
        (
            "how heavy",
            f"the load is measured first; the plan assumes {lightest}. The heavier, the slower: with "
            f"{heaviest[0]:g} kg its strokes and fast moves reach {heaviest[1]:.2g} m/s",
        ),
        *_stops(axis, capabilities),
        *_gain_points(capabilities),
    )


def identify_points(axis: Axis, capabilities: Capabilities, window_m: tuple[float, float] | None) -> tuple[Point, ...]:
    """Sign check, rising excitation and one frequency response.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    window_m : tuple of float or None
        To be kept, from where it stands.
    """
    far = "see 'incl. stop' below, from where it stands: keep people and tools out of its travel"
    if window_m is not None:
        far = (
            f"between {1e3 * window_m[0]:+.0f} mm and {1e3 * window_m[1]:+.0f} mm of where it stands now (plus is where the drive's "
            "position counts up): keep people and tools out of its travel"
        )
    tried = (
        ", and to go some cm slowly, where a stop shows what it counts in"
        if capabilities.stop_unit and capabilities.gains != "unknown"
        else ""
    )
    return (
        (
            "what moves",
            "the carriage jogs a few mm in each direction, then is excited in place with rising torque; no loop is closed but to stop it"
            + tried,
        ),
        ("how far", far),
        *_stops(axis, capabilities),
        ("what is written", "nothing that stays: at the end the drive is left as it was found"),
    )


def host_loss(axis: Axis, capabilities: Capabilities) -> tuple[float, float]:
    """Guard time, s, and how far a light carriage that just breaks away then coasts at most, m.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    """
    top = (creep.HELD_SHARE if axis.mounting.tilted else creep.BREAKAWAY_SHARE) * min(axis.torque_limit_nm, capabilities.peak_torque_nm)
    guard_s = guard_times_s(capabilities)[0]
    return guard_s, creep.run_on_m(axis, top, guard_s + capabilities.sample_period_s)


def _gain_points(capabilities: Capabilities) -> tuple[Point, ...]:
    """Parameters written in the whole job, by what can be done with the gains of this drive."""
    if capabilities.gains == "unknown":
        return (
            (
                "its own loop",
                "this drive's gains cannot be written (nobody knows where they are, or what they mean): strokes and moves are made with "
                "those "
                "that stand in it, slow ones first; look in the maker's tool that they are cautious. At the end stand model, gains and "
                "what "
                "to type in",
            ),
            ("what is written", "limits and modes, while it works; no gain. At the end the drive is left as it was found"),
        )
    written = "gains, while it works; at the end the drive is left as it was found, unless you keep the new gains"
    if capabilities.gains == "to_calibrate":
        written += ". What its gains mean is measured first, by small steps at standstill"
    return (("what is written", written),)


def _stops(axis: Axis, capabilities: Capabilities) -> tuple[Point, ...]:
    """Means that stop it, and the stopping distance."""
    first = first_deceleration(axis, capabilities.peak_torque_nm)
    guard_s, crept_m = host_loss(axis, capabilities)
    held = (
        (
            (
                "gravity",
                f"is held with {gravity.expected(axis).torque_nm:.2f} N m or so from before the brake opens until it is closed; while that "
                f"is felt for, the carriage may slip: the stage goes off after {1e3 * holding.SLIP_M:g} mm, and it rolls on until brake or "
                f"friction stop it; all tries together stay within {1e3 * phases.SIGN_REACH_M:g} mm"
                + ("" if axis.motor.brake_torque_nm else ". No brake is stated: only friction holds it without torque"),
            ),
        )
        if axis.mounting.tilted
        else ()
    )
    brake_nm, closes_s = axis.motor.brake_torque_nm or 0.0, axis.motor.brake_time_s or UNKNOWN_BRAKE_S
    bite_n = brake_nm / axis.transmission_m_rad
    bites = (
        (
            (
                "brake",
                "a stop takes the torque away when the brake has closed. Where the stage is cut off (STO, power, a fault) the carriage "
                f"goes on until it closes, {1e3 * closes_s:.0f} ms, and its {brake_nm:g} N m may pull the belt with {bite_n:.0f} N, which "
                f"bears {axis.belt_force_limit_n:.0f} N: look at the belt after that",
            ),
        )
        if bite_n > axis.belt_force_limit_n
        else ()
    )
    return (
        *held,
        *bites,
        (
            "what stops it",
            "Ctrl-C, at any time; a limit that is passed; the end of the job. It stands within the way 'incl. stop', in closed loop within "
            "the travel",
        ),
        (
            "how it brakes",
            f"until the load is measured, friction and the velocity loop found in the drive brake it, with {first.value_m_s2:.2g} m/s² "
            f"at most ({first.binds}, the belt's swing counted twice); then "
            + (
                "that loop alone, counted with the lag it shows"
                if capabilities.gains == "unknown"
                else "a loop designed for it, as hard as its feed force allows"
            ),
        ),
        *(("limits", caution) for caution in capabilities.cautions),
        (
            "PC or bus lost",
            f"the drive notices by itself (watchdog {1e3 * guard_s:.0f} ms); that is tried once at standstill, before any torque. A light "
            f"carriage that just breaks away then coasts by {1e3 * crept_m:.0f} mm at most, less nearer to an end; an excitation is no "
            "stronger than lets it stop before the end",
        ),
    )
