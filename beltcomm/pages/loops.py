"""Gains before and designed, in SI and as the drive's objects hold them; margins of all variants, Nyquist plots, sensitivity."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from beltcomm.design.cascade import GAINS, DesignResult
from beltcomm.design.measured import measured_loop
from beltcomm.design.specification import Specification
from beltcomm.drive.objects import ParameterObject, name_of, object_values
from beltcomm.drive.parameters import GAIN_NAMES
from beltcomm.errors import BeltcommError
from beltcomm.given import pasted
from beltcomm.machine.gains import read_as, unit_of
from beltcomm.pages.gather import Gathered
from beltcomm.report import proof
from beltcomm.report.page import PageTable, Paragraphs, Picture, Section, picture_of
from beltcomm.report.proof import sensitivity_figure
from beltcomm.report.style import Caption
from beltcomm.rundata import backups
from beltcomm.rundata.analyse import design_plants
from beltcomm.rundata.conditions import condition_of
from beltcomm.rundata.design_proof import plant_responses
from beltcomm.rundata.store import cascade_from_dict, parameters_from_dict, structure_from_dict

TITLE = "Loops and margins"

#: Columns of the table of margins.
COLUMNS = {
    "phase_margin_deg": "velocity: phase °",
    "gain_margin_db": "gain dB",
    "suppression_db": "resonance dB",
    "sensitivity_db": "sensitivity dB",
    "position_phase_margin_deg": "position: phase °",
    "position_gain_margin_db": "gain dB",
    "position_sensitivity_db": "sensitivity dB",
}

#: Gains in words.
NAMES = {
    **GAINS,
    "velocity_filter_s": "T_R, velocity filter",
    "prefilter_kind": "prefilter",
    "prefilter_omega_rad_s": "prefilter frequency",
    "prefilter_d_n": "prefilter damping",
    "filter_reference": "reference filtered too",
    "ff_inertia_kg_m2": "feedforward: inertia",
    "ff_viscous_nm_s_rad": "feedforward: viscous",
    "ff_coulomb_nm": "feedforward: Coulomb",
    "ff_offset_nm": "feedforward: constant",
    "ff_velocity": "feedforward: velocity",
    "ff_advance_s": "feedforward: ahead by",
    "prefilter_roll_off_rad_s": "prefilter roll-off",
}


def section(run: Gathered) -> Section:
    """Section on the loops: table of margins, Nyquist plots and gains with the measured responses, sensitivity.

    Parameters
    ----------
    run : Gathered
    """
    if not run.design or run.model is None:
        return Section("loops", TITLE, missing=f"No loop was designed; beltcomm design {pasted(run.place)} does.")
    rows = [(str(m["plant"]), *(f"{m[key]:.1f}" for key in COLUMNS)) for m in run.design["margins"]]
    worst = [(max if "suppression" in key or "sensitivity" in key else min)(m[key] for m in run.design["margins"]) for key in COLUMNS]
    rows.append(("worst of all, as on the screen", *(f"{value:.1f}" for value in worst)))
    words = "The screen tells the smaller gain margin and the larger sensitivity of both loops."
    parts: list[Paragraphs | PageTable | Picture] = [PageTable(("variant of the model", *COLUMNS.values()), rows, words)]
    try:
        parts += _pictures(run)
    except BeltcommError as problem:
        parts.append(Paragraphs([f"The loops cannot be drawn: {problem}"]))
    return Section("loops", TITLE, parts)


def _pictures(run: Gathered) -> list[Picture]:
    assert run.model is not None
    saved, model, travel = run.design, run.model, run.folder.axis.travel
    delay_s, structure = float(saved["dead_time_s"]), structure_from_dict(saved)
    cascade = cascade_from_dict(saved)
    ends = travel.ends_m
    plants = design_plants(model, ends, [model["cart.mass"]], delay_s, float(saved.get("apparent_damping_nm_s_rad") or 0.0))
    wanted: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in saved["specification"].items()}
    design = DesignResult(cascade, structure, Specification(**wanted), tuple(plants), (), (), ())
    ratio = run.folder.axis.transmission_m_rad
    fitted = [r for r in run.recordings if r.sidecar.experiment == "frf" and not r.sidecar.held_out]
    conditions = {r.name: condition_of(r, ratio).words() for r in fitted}
    shown = []
    for name, response, late_s in plant_responses(fitted, delay_s):
        shown.append(proof.ProvenResponse(f"{name}, {conditions[name]}", measured_loop(response, cascade, structure.period_s, late_s)))
    caption = Caption(run.command, f"{run.name}/designs/final.yaml, models, recordings")
    return [picture_of(proof.proof_figure(design, shown, [], caption)), picture_of(sensitivity_figure(design, caption))]


def gains_section(run: Gathered) -> Section:
    """Section on the gains: SI before and designed, and the objects of the drive with their raw numbers.

    Parameters
    ----------
    run : Gathered
    """
    designed = run.design.get("parameters")
    if not designed:
        return Section("gains", "Gains", missing=f"No gains were designed; beltcomm design {pasted(run.place)} does.")
    before = backups.read(run.folder.file("results", backups.FIRST)).parameters if backups.FIRST in run.results else {}
    places = _places(run)
    wanted, stood = _raw(places, designed), _raw(places, before)
    rows: list[tuple[str, ...]] = []
    for name in GAIN_NAMES:
        if name not in designed:
            continue
        place = places.get(name)
        shown = (NAMES[name], _shown(name, before.get(name)), _shown(name, designed[name]), unit_of(name))
        held = ("not in this drive", "", "") if place is None else (name_of(place.index, place.subindex), place.type, _step(place))
        rows.append((*shown, *held, stood.get(name, ""), wanted.get(name, "")))
    head: tuple[str, ...] = (
        "gain",
        "before",
        "designed",
        "unit",
        "object",
        "type",
        "one unit of the drive is",
        "raw before",
        "raw designed",
    )
    words = "Values act at the motor shaft. The raw numbers are what stands in the drive's objects, in the drive maker's own units."
    if not places:
        words = "The drive's objects are not known for this run; beltcomm apply shows them when it is connected."
        head, rows = head[:4], [row[:4] for row in rows]
    bound = [f"limited by {line}" for line in run.design.get("binding") or ()]
    return Section("gains", "Gains, as they are written to the drive", [PageTable(head, rows, words), Paragraphs(bound, listed=True)])


def _places(run: Gathered) -> Mapping[str, ParameterObject]:
    try:
        return parameters_from_dict(run.results.get("drive") or {})
    except BeltcommError:
        return {}


def _raw(places: Mapping[str, ParameterObject], values: Mapping[str, float]) -> dict[str, str]:
    """Raw numbers by name; a value that its object cannot hold says so."""
    found = {}
    for name, place in places.items():
        if name not in values:
            continue
        needed = {name: values[name]} if place.law == "linear" else {key: values[key] for key in (name, "kp_nm_s_rad") if key in values}
        try:
            raw = next(one.raw for one in object_values(places, needed) if one.name == name)
        except BeltcommError:
            found[name] = "out of its range"
            continue
        found[name] = f"{raw:.7g}" if place.type == "real32" else f"{raw:.0f}"
    return found


def _step(place: ParameterObject) -> str:
    """Meaning of one unit of an object."""
    if place.law != "linear":
        return f"{1e6 * place.scale:g} µs of T_n = Kp/Ki"
    return "1 SI unit" if place.scale == 1.0 else f"{place.scale:g} SI units"


def _shown(name: str, value: float | None) -> str:
    if value is None:
        return "unknown"
    if name == "filter_reference":
        return "yes" if value else "no"
    return read_as(name, value)
