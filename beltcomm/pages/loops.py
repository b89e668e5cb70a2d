"""The designed loops: margins of all variants, Nyquist with the disc that must stay free, measured responses in it, sensitivity."""

from __future__ import annotations

from typing import Any

from beltcomm.design.cascade import DesignResult
from beltcomm.design.measured import measured_loop
from beltcomm.design.specification import Specification
from beltcomm.errors import BeltcommError
from beltcomm.given import pasted
from beltcomm.pages.gather import Gathered
from beltcomm.report import proof
from beltcomm.report.page import PageTable, Paragraphs, Picture, Section, picture_of
from beltcomm.report.sensitivity import sensitivity_figure
from beltcomm.report.style import Caption
from beltcomm.rundata.analyse import design_plants
from beltcomm.rundata.conditions import condition_of
from beltcomm.rundata.design_proof import plant_responses
from beltcomm.rundata.store import cascade_from_dict, delay_from_dict, structure_from_dict

TITLE = "Loops and margins"


def section(run: Gathered) -> Section:
    """Table of margins, Nyquist plots and gains with the measured responses, sensitivity."""
    if not run.design or run.model is None:
        return Section("loops", TITLE, missing=f"No loop was designed; beltcomm design {pasted(run.place)} does.")
    rows = [
        (
            str(m["plant"]),
            f"{m['phase_margin_deg']:.1f}",
            f"{m['gain_margin_db']:.1f}",
            f"{m['suppression_db']:.1f}",
            f"{m['sensitivity_db']:.1f}",
            f"{m['position_phase_margin_deg']:.1f}",
            f"{m['position_sensitivity_db']:.1f}",
        )
        for m in run.design["margins"]
    ]
    head = ("variant of the model", "phase °", "gain dB", "resonance dB", "sensitivity dB", "position: phase °", "sensitivity dB")
    parts: list[Paragraphs | PageTable | Picture] = [PageTable(head, rows, "Velocity loop, and the position loop around it.")]
    try:
        parts += _pictures(run)
    except BeltcommError as problem:
        parts.append(Paragraphs([f"The loops cannot be drawn: {problem}"]))
    return Section("loops", TITLE, parts)


def _pictures(run: Gathered) -> list[Picture]:
    assert run.model is not None
    saved, model, travel = run.design, run.model, run.folder.axis.travel
    delay_s, structure = delay_from_dict(saved), structure_from_dict(saved)
    cascade = cascade_from_dict(saved)
    ends = (float(travel.min_m or 0.0), float(travel.max_m or 0.0))
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
