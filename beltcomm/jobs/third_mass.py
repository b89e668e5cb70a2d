"""``beltcomm fit RUN --model three-mass``: both models on the same records; the three masses become a revision, or are refused."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from beltcomm.errors import DataError
from beltcomm.fit.model_fit import ModelFit
from beltcomm.fit.torque.acting_torque import acting_recordings
from beltcomm.given import pasted
from beltcomm.identify.three_mass import ThreeMass, compare_masses, resonances_hz, sheet_mass_kg
from beltcomm.identify.three_mass_magnitude import ThreeMassMagnitude, fit_magnitudes
from beltcomm.model import Model
from beltcomm.result import Result, plain, table
from beltcomm.rundata import analyse, offline
from beltcomm.rundata.kept import kept_path
from beltcomm.rundata.revisions import new_revision
from beltcomm.rundata.store import fit_to_dict
from beltcomm.runfolder import RunFolder
from beltcomm.sentences import words
from beltcomm.talk import Silence, Talk

#: (name in the model, words, unit shown, factor)
_SHOWN = (
    ("motor.inertia", "motor-side inertia", "kg cm²", 1e4),
    ("cart.mass", "carriage mass", "kg", 1.0),
    ("end_pulley.mass", "end pulley, inertia over r²", "kg", 1.0),
    ("belt_sections.specific_stiffness", "belt specific stiffness EA", "kN", 1e-3),
    ("belt_sections.offset", "free belt at position 0", "mm", 1e3),
    ("belt_sections.specific_damping", "belt specific damping", "N s", 1.0),
    ("viscous.damping", "viscous friction, motor", "mN m s/rad", 1e3),
    ("coulomb.level", "Coulomb friction, motor", "mN m", 1e3),
    ("cart_friction.level", "Coulomb friction, carriage", "N", 1.0),
)


def fit_three_masses(run: Path, *, command: str = "", when: str = "", talk: Talk | None = None) -> Result:
    """Two and three masses fitted to all records of a run.   Exit code 1 and nothing written where they do not hold a third mass.

    Parameters
    ----------
    run : Path
        Of the run folder.
    command, when : str
        Noted with the revision.
    talk : Talk or None
        Hears progress; None says nothing.

    Raises
    ------
    UsageError
        Without the belt's data.
    DataError
    """
    talk = talk or Silence()
    folder = RunFolder.open(run)
    talk.phase(1, 1, "two masses against three")
    recordings = offline.fit_for_belt_model(folder).recordings
    responses = analyse.responses(acting_recordings([r for r in recordings if not r.sidecar.held_out], kept_path(folder)))
    counts = offline.counts_of(folder)
    found = compare_masses(recordings, folder.axis, counts, responses, progress=lambda f: talk.progress(f, None))
    places = {r.name: r.sidecar.start_position_m or 0.0 for r in recordings}
    beside = None
    try:
        beside = fit_magnitudes(responses, places, found.three.model, folder.axis)
    except DataError as problem:
        talk.say(f"no log-magnitude fit with three masses: {problem}")
    middle = folder.axis.travel.middle_m
    data: dict[str, Any] = {
        "run": str(run),
        "identified": found.identified,
        "against": list(found.against),
        "evidence": found.evidence,
        "two_mass": {**fit_to_dict(found.two.fit), "parameters": plain(found.two.fit.model.parameters)},
        "three_mass": {**fit_to_dict(found.three), "parameters": plain(found.three.model.parameters)},
        "reach": [plain(one) for one in found.reach],
        "modes": _modes_dict(found.three.model, middle),
        "data_sheet_kg": sheet_mass_kg(folder.axis),
        "heavier_kg": found.heavier_kg or None,
        "log_magnitude": plain(beside),
    }
    lines = [*_comparison_lines(found), *_magnitude_lines(beside)]
    if not found.identified:
        told = ["No third mass is identified; nothing was changed:", *(f"  {reason}" for reason in found.against)]
        return Result(data, [*told, "", *lines], 1)
    two, three = found.two.fit, found.three
    base = new_revision(
        folder,
        two.model,
        "base",
        ratio=math.sqrt(two.misfit),
        held_out=_root(two.held_out_misfit),
        confirmed=None,
        command=command,
        when=when,
    )
    gone = [e for e in two.model.effects if e not in three.model.effects]
    change = " ".join(["+belt_sections", *(f"-{name}" for name in gone)])
    rung = new_revision(
        folder,
        three.model,
        change,
        ratio=math.sqrt(three.misfit),
        held_out=_root(three.held_out_misfit),
        confirmed=found.confirmed,
        command=command,
        when=when,
    )
    folder.save("results", "three_mass", plain({**data, "revision": rung.name}))
    lines = [
        "A third mass is identified:",
        *model_lines(three, folder, middle),
        "",
        *lines,
        f"Saved as {rung.name} ({rung.change}) on {base.name}, the two-mass model.",
        f"Next: beltcomm design {pasted(run)}",
    ]
    return Result({**data, "revision": rung.name}, lines)


def _root(square: float | None) -> float | None:
    return None if square is None else math.sqrt(square)


def _modes_dict(model: Model, position_m: float) -> dict[str, Any]:
    """Resonances and antiresonances with the carriage at a place."""
    return {
        "position_m": position_m,
        "resonances_hz": list(resonances_hz(model, position_m)),
        "antiresonances_hz": list(resonances_hz(model, position_m, ("motor",))),
    }


def model_lines(fit: ModelFit, folder: RunFolder, position_m: float) -> list[str]:
    """The three-mass model with 95 % intervals and its modes."""
    lines = []
    for name, title, unit, factor in _SHOWN:
        item = fit.model.parameters[name]
        half = None if item.interval is None else factor * item.interval
        lines.append(f"  {title:36} {words.number(factor * item.value, half, unit)}")
    sheet = sheet_mass_kg(folder.axis)
    if sheet is not None:
        lines.append(f"  {'end pulley by the data sheet':36} {sheet:.3f} kg, were it made like the driving one")
    for place in sorted({float(folder.axis.travel.min_m or 0.0), position_m, float(folder.axis.travel.max_m or 0.0)}):
        free, held = resonances_hz(fit.model, place), resonances_hz(fit.model, place, ("motor",))
        lines.append(
            f"  carriage at {1e3 * place:4.0f} mm: resonances {' and '.join(f'{f:.1f}' for f in free)} Hz, "
            f"antiresonances {' and '.join(f'{f:.1f}' for f in held)} Hz"
        )
    return lines


def _comparison_lines(found: ThreeMass) -> list[str]:
    """Both models on the same records, and what each record shows of the mode."""
    rows = [
        [
            title,
            f"{math.sqrt(fit.misfit):.2f}",
            "" if fit.held_out_misfit is None else f"{math.sqrt(fit.held_out_misfit):.2f}",
            f"{len(fit.free)}",
        ]
        for title, fit in (("two masses", found.two.fit), ("three masses", found.three))
    ]
    lines: list[str] = [*table(["", ">error/noise", ">held out", ">parameters"], rows)]
    lines.append(f"evidence for the third mass {found.evidence:+.4g} nats, over {found.three.samples} samples")
    for one in found.reach:
        where = "" if one.place_m is None else f" at {1e3 * one.place_m:.0f} mm"
        shown = f"{one.noise_ratio:.3g} times the noise there" if one.noise_ratio else "beyond its lines"
        lines.append(
            f"  {one.record}{where}: signal up to {one.highest_hz:.0f} Hz, sampling ends at {one.nyquist_hz:.0f} Hz; mode of the end "
            f"pulley {one.mode_hz:.0f} Hz, {shown}"
        )
    return lines


def _magnitude_lines(fit: ThreeMassMagnitude | None) -> list[str]:
    """The log-magnitude fit beside, where there is one."""
    if fit is None:
        return []
    item = {name: words.number(v.value, v.interval, v.unit) for name, v in fit.parameters.items()}
    how = "the data sheet's coupling as a spring" if fit.coupled else "a rigid coupling"
    return [
        f"For comparison, the thesis's log-magnitude fit with three masses, {how} and friction as damping (biased by it): end pulley "
        f"{item['end_pulley.mass']}, carriage {item['cart.mass']}, EA {item['belt_sections.specific_stiffness']}, rest {fit.rms_db:.1f} dB"
    ]
