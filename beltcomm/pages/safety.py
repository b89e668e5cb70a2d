"""Plan, motions made, limits that acted, and heat of the motor; the journal itself at the end."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import chain, repeat
from typing import Any

import numpy as np

from beltcomm.journal import lines_of
from beltcomm.pages.gather import Gathered
from beltcomm.recording import Recording
from beltcomm.report.page import PageTable, Paragraphs, Section
from beltcomm.rundata.store import PLAN

#: Lines of a journal that tell of nobody's safety: what was recorded, fitted or written.
_WORK = re.compile(r"^( *[0-9.]+ s  )?(\w+: (\d+ samples|order \d|another sequence)|amplitude |scale: |wrote )")


def section(run: Gathered) -> Section:
    """Section on the plan: what was measured of every experiment beside it, heat, and what was agreed, guarded, stopped and restored.

    Parameters
    ----------
    run : Gathered
    """
    title = "Plan and safety log"
    plan, lines = run.results.get(PLAN), [line for line in _journal_of(run) if not _WORK.match(line)]
    if not plan and not lines:
        return Section("safety", title, missing="No machine was moved for this run.")
    parts: list[Paragraphs | PageTable] = []
    if plan:
        parts += _planned(plan)
    parts.append(PageTable(("record", "carriage mm", "m/s", "N m", "samples lost"), [_driven(run, r) for r in run.recordings], _DRIVEN))
    if lines:
        parts += [Paragraphs(["What was agreed, guarded, stopped and restored:"]), Paragraphs(lines, listed=True)]
    return Section("safety", title, parts)


_DRIVEN = "What the records show of it: where the carriage was, largest speed, largest torque at the motor, cycles that the drive left out."


def _planned(plan: Mapping[str, Any]) -> list[Paragraphs | PageTable]:
    pauses = (plan.get("heat") or {}).get("pauses_s") or ()
    rated = (plan.get("thermal") or {}).get("rated_nm")
    rows = []
    for step, pause in zip(plan["experiments"], chain(pauses, repeat(0.0)), strict=False):
        share = f"{100.0 * (step['rms_nm'] / rated) ** 2:.0f}" if rated and step.get("rms_nm") is not None else ""
        rows.append(
            (
                step["title"],
                f"{1e3 * step['travel_m']:.0f}",
                f"{1e3 * step['reach_m']:.0f}",
                f"{step['speed_m_s']:.2f}",
                f"{step['torque_nm']:.2f}",
                f"{step['belt_force_n']:.0f}",
                f"{step['seconds']:.0f}",
                share,
                f"{pause:.0f}" if pause else "",
            )
        )
    head = ("planned, at most", "travel mm", "with stop mm", "m/s", "N m", "belt N", "s", "heat %", "rest s before")
    words = "Bounds that the session was agreed with, and that drive and host watched. Heat: (rms torque / rated torque)²."
    points = [f"{label}: {sentence}" for label, sentence in plan.get("points") or ()]
    return [Paragraphs([str(plan["text"])]), Paragraphs(points, listed=True), PageTable(head, rows, words), *_heat(plan)]


def _heat(plan: Mapping[str, Any]) -> list[Paragraphs | PageTable]:
    heat, thermal = plan.get("heat"), plan.get("thermal")
    if not heat or not thermal:
        return [Paragraphs(["Heat was not planned: the motor's rated torque is not known."])]
    shares = (heat["continuous"], heat["hottest"], heat["fullest"])
    whole, hottest, store = (f"{100.0 * share:.0f} %" for share in shares)
    overload = f"the overload it bears, {thermal['peak_nm']:.3g} N m for {thermal['overload_s']:g} s"
    return [
        Paragraphs(
            [
                f"Thermal load (I²t): {whole} of the continuous rating (S1) over the whole session, {hottest} in its hottest "
                f"experiment, {store} of {overload}; rated {thermal['rated_nm']:.3g} N m ({thermal['source']})."
            ]
        )
    ]


def _driven(run: Gathered, recording: Recording) -> tuple[str, ...]:
    name, ratio = recording.name, run.folder.axis.transmission_m_rad
    if recording.is_static_map or len(recording.t_s) < 2:
        return name, "", "", "", ""
    path = recording.position * (ratio if recording.side == "motor" else 1.0)
    speed = np.abs(np.gradient(path, recording.t_s))
    lost = int(np.sum(np.round(np.diff(recording.t_s) / recording.sample_period_s) - 1))
    return (
        name,
        f"{1e3 * path.min():z.0f} to {1e3 * path.max():.0f}",
        f"{speed.max():.2f}",
        f"{np.abs(recording.torque).max():.2f}",
        f"{lost}",
    )


def _journal_of(run: Gathered) -> list[str]:
    """Lines of the journal; none where no machine was moved."""
    return lines_of(run.folder.path)


def journal(run: Gathered) -> Section:
    """Section with the session's journal: what was planned, measured, written, stopped.

    Parameters
    ----------
    run : Gathered
    """
    lines = _journal_of(run)
    if not lines:
        return Section("journal", "Journal", missing="No machine was moved for this run.")
    return Section("journal", "Journal, whole", [Paragraphs(lines, typed=True)])
