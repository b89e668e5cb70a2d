"""What was done: the journal of the session, the gains before and after, the friction of the sweep."""

from __future__ import annotations

from beltcomm.parameters import GAIN_NAMES
from beltcomm.report.page import Section, Table, Words
from beltcomm.session.reporting.gather import Gathered

#: What a gain's name ends with, and its unit.
UNITS = {"nm_s_rad": "N m s/rad", "nm_rad": "N m/rad", "1_s": "1/s", "rad_s": "rad/s", "kg_m2": "kg m²", "nm": "N m", "s": "s"}


def journal(run: Gathered) -> Section:
    """The session's journal: what was planned, measured, written, stopped."""
    path = run.folder.path / "journal.txt"
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    if not lines:
        return Section("journal", "Journal", missing="No machine was moved for this run.")
    return Section("journal", "Journal: what was done, and what limits acted", [Words(lines, typed=True)])


def gains(run: Gathered) -> Section:
    """Gains in the drive before the session, and those of the design."""
    designed = run.design.get("parameters")
    if not designed:
        return Section("gains", "Gains", missing=f"No gains were designed; beltcomm design {run.name} does.")
    before = (run.results.get("backup") or {}).get("parameters") or {}
    rows = [
        (name, unit_of(name), f"{before[name]:.6g}" if name in before else "unknown", f"{designed[name]:.6g}")
        for name in GAIN_NAMES
        if name in designed
    ]
    bound = [f"bound by: {line}" for line in run.design.get("binding") or ()]
    table = Table(("parameter", "unit", "before", "designed"), rows)
    return Section("gains", "Gains", [table, Words(bound, listed=True)])


def unit_of(name: str) -> str:
    """The unit that a parameter's name ends with, "" for a number."""
    return next((unit for end, unit in UNITS.items() if name.endswith(f"_{end}")), "")
