"""``beltcomm fit RUN``: the model from the recordings of a run."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Literal

from beltcomm.errors import DataError
from beltcomm.experiments.options import Options
from beltcomm.fit.model_fit import ModelFit
from beltcomm.fit.torque.acting_torque import acting_recordings
from beltcomm.given import Place, pasted, place
from beltcomm.identify.magnitude_fit import Solver, ThreeMassMagnitude, fit_magnitudes
from beltcomm.identify.three_mass import ThreeMass, compare_masses, resonances_hz, sheet_mass_kg
from beltcomm.language import tr
from beltcomm.model import Model
from beltcomm.result import Line, Result, plain, table
from beltcomm.rundata import analyse, offline
from beltcomm.rundata.kept import kept_path
from beltcomm.rundata.revisions import new_revision
from beltcomm.rundata.store import fit_to_dict
from beltcomm.runfolder import RunFolder
from beltcomm.sentences import friction as friction_words
from beltcomm.sentences import outcome, words
from beltcomm.sentences.cross_checks import sheet_lines
from beltcomm.sentences.own_words import about_run
from beltcomm.talk import Silence, Talk

#: (name in the model, words, unit shown, factor)
_SHOWN = (
    ("motor.inertia", "motor-side inertia", "kg cm²", 1e4),
    ("cart.mass", "carriage mass", "kg", 1.0),
    ("end_pulley.mass", "end pulley, inertia over r²", "kg", 1.0),
    ("belt_sections.specific_stiffness", "belt specific stiffness EA", "kN", 1e-3),
    ("belt_sections.offset", "free belt at position 0", "mm", 1e3),
    ("belt_sections.specific_damping", "belt specific damping", "N s", 1.0),
    *((name, *words.SHOWN[name]) for name in ("viscous.damping", "coulomb.level", "cart_friction.level")),
)


def _fit_three_masses(run: Path, *, command: str, when: str, talk: Talk | None) -> Result:
    """Two and three masses fitted to all records of a run.   Exit code 1 and nothing written where they do not hold a third mass.

    Raises UsageError without the belt's data, DataError.
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
        *_model_lines(three, folder, middle),
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


def _model_lines(fit: ModelFit, folder: RunFolder, position_m: float) -> list[str]:
    """The three-mass model with 95 % intervals and its modes."""
    lines = []
    for name, title, unit, factor in _SHOWN:
        item = fit.model.parameters[name]
        half = None if item.interval is None else factor * item.interval
        lines.append(f"  {title:36} {words.number(factor * item.value, half, unit)}")
    sheet = sheet_mass_kg(folder.axis)
    if sheet is not None:
        lines.append(f"  {'end pulley by the data sheet':36} {sheet:.3f} kg, were it made like the driving one")
    for at_m in sorted({float(folder.axis.travel.min_m or 0.0), position_m, float(folder.axis.travel.max_m or 0.0)}):
        free, held = resonances_hz(fit.model, at_m), resonances_hz(fit.model, at_m, ("motor",))
        lines.append(
            f"  carriage at {1e3 * at_m:4.0f} mm: resonances {' and '.join(f'{f:.1f}' for f in free)} Hz, "
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


#: How a fit ends that leaves many times the noise.
SUSPECT = (
    "The model does not explain what was measured: it is kept to look at, and nothing should be designed with it. Add the effect that "
    "`beltcomm diagnose` names, or mend the records."
)


@about_run()
def fit(
    run: Place,
    *,
    solver: Solver | None = None,
    model: Literal["two-mass", "three-mass"] = "two-mass",
    command: str = "",
    when: str = "",
    options: Options | None = None,
    talk: Talk | None = None,
) -> Result:
    """Fit the model to all recordings of a run; no machine needed.

    Parameters
    ----------
    run : Place
        Run folder.
    solver : Solver or None
        How the fit is minimised; None for the usual one.
    model : {'two-mass', 'three-mass'}
        "three-mass" fits the end pulley too, and saves it as a revision (noted with command, when) where the records hold it.
    command : str
        Command line, kept as provenance.
    when : str
        Date and time, kept as provenance.
    options : Options or None
        Settings beside the main arguments; None for the safe defaults.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        Values with 95 % intervals; exit code 1 for a model that does not explain the records.

    Raises
    ------
    DataError
        Without usable recordings.
    """
    del options
    run, talk = place(run), talk or Silence()
    if model == "three-mass":
        return _fit_three_masses(run, command=command, when=when, talk=talk)
    folder = RunFolder.open(run)
    talk.phase(1, 1, "fit")
    findings = offline.fit_run(folder, solver or "lm", talk)
    outcome.save(folder, findings)
    friction = words.friction_lines(findings.friction) if findings.friction else []
    friction += friction_words.standstill_lines(findings.standstill)
    suspect = findings.final is None or findings.final.fit.suspect
    sheets = sheet_lines(findings.sheets)
    state = (tr("DOES NOT EXPLAIN"), "bad") if suspect else (tr("FITTED"), "good")
    said = tr("what was measured: nothing should be designed with this model") if suspect else tr("a model of all records of this run")
    text = [
        Line(""),
        Line("  ", state, "   ", (said, "title")),
        Line(""),
        *outcome.model_screen(folder, findings),
        f"Next: beltcomm improve {pasted(run)}   (names what the model lacks, adds it, designs again)"
        if suspect
        else f"Next: beltcomm design {pasted(run)}   (gains with margins)",
    ]
    details = [
        *outcome.model_text(findings),
        *sheets,
        *friction,
        *words.remarks_lines(findings.remarks),
        *([SUSPECT] if suspect else []),
    ]
    return Result({**outcome.data(folder, findings), "data_sheet": plain(findings.sheets)}, text, 1 if suspect else 0, details=details)
