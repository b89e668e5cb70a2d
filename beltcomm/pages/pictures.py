"""Pictures of a run folder: made after the numbers, written to ``RUN/pictures``; a picture that cannot be written hurts no result.

What a command calls returns the paths in the run folder, and remarks on what could not be written.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from beltcomm.axis.terms import pictures_in
from beltcomm.control import Cascade
from beltcomm.design.cascade import DesignResult
from beltcomm.design.measured import measured_loop
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.records import Data
from beltcomm.given import pasted
from beltcomm.identify.sweeps import LoadDependence
from beltcomm.laboratory.compare import Comparison, landmarks, worst
from beltcomm.laboratory.place_words import in_words
from beltcomm.recording import Recording
from beltcomm.residuals.responses import response_pairs, trace_of
from beltcomm.rundata.design_proof import DesignProof, plant_responses
from beltcomm.rundata.friction_study import FrictionStudy
from beltcomm.rundata.revisions import Revision
from beltcomm.runfolder import RunFolder
from beltcomm.sentences.loop_ways import LoopReading
from beltcomm.sentences.response_table import ResponseTable

if TYPE_CHECKING:  # matplotlib takes longer to import than a command without pictures may last
    from matplotlib.figure import Figure

    from beltcomm.report.style import Caption

FOLDER = "pictures"
#: Sentences above the error maps.
SENTENCES = 3


def comparison_pictures(folder: RunFolder, data: Data, fitted: Fitted, found: Comparison, command: str) -> tuple[list[str], list[str]]:
    """Overlay of the worst record, error maps, frequency responses.

    Parameters
    ----------
    folder : RunFolder
    data : Data
    fitted : Fitted
        Model, fitted to the records.
    found : Comparison
        Of these records and this model.
    command : str
        Command line, for the caption.
    """
    return _written(folder, lambda: _comparison_figures(folder, data, fitted, found, command))


def _comparison_figures(folder: RunFolder, data: Data, fitted: Fitted, found: Comparison, command: str) -> dict[str, Figure]:
    """Figures of a comparison, by name."""
    from beltcomm.report import responses

    figures = error_figures(folder, data, fitted, found, command)
    pairs = response_pairs(data.recordings, found.judged)
    if pairs:
        named = landmarks(fitted.model, folder.axis.travel.middle_m)
        figures["compare_response"] = responses.bode_figure(pairs, named, _compared(folder, found, command))
    return figures


def error_figures(folder: RunFolder, data: Data, fitted: Fitted, found: Comparison, command: str) -> dict[str, Figure]:
    """The error maps and the worst record, by name.

    Parameters
    ----------
    folder : RunFolder
    data : Data
    fitted : Fitted
        Model, fitted to the records.
    found : Comparison
        Of these records and this model.
    command : str
        Command line, for the caption.
    """
    from beltcomm.report import maps, overlay

    caption = _compared(folder, found, command)
    named = landmarks(fitted.model, folder.axis.travel.middle_m)
    sentences = [in_words(place, named) for place in worst(found)[:SENTENCES]]
    excess = {r.name: (r.ratio**2 - 1.0) * r.samples for r in found.records}
    name = max(excess, key=lambda record: excess[record])
    excited = any(r.name == name and r.sidecar.experiment == "frf" for r in data.recordings)
    return {
        "compare_maps": maps.maps_figure(found.judged, found.ratio, found.held_out, named, sentences, caption),
        "compare_overlay": overlay.overlay_figure(trace_of(found.judged, name, excited), caption),
    }


def _compared(folder: RunFolder, found: Comparison, command: str) -> Caption:
    from beltcomm.report.style import Caption

    shown = f"{folder.path.resolve().name}/recordings, {len(found.records)} records"
    return Caption(command or f"beltcomm compare {pasted(folder.path)}", shown)


def change_picture(folder: RunFolder, rung: Revision, before: Comparison, after: Comparison, command: str) -> tuple[list[str], list[str]]:
    """Every record before and after a change of the model.

    Parameters
    ----------
    folder : RunFolder
    rung : Revision
        Revision of the model.
    before, after : Comparison
        Records without and with the change.
    command : str
        Command line, for the caption.
    """

    def draw() -> dict[str, Figure]:
        from beltcomm.report import staircase, style

        caption = style.Caption(command or "beltcomm add", f"{folder.path.resolve().name}/recordings, models/{rung.name}.yaml")
        then = {r.name: r for r in after.records}
        changes = [staircase.RecordChange(r.name, r.held_out, r.ratio, then[r.name].ratio) for r in before.records if r.name in then]
        return {f"{rung.name}_change": staircase.change_figure(rung.change, changes, before.ratio, after.ratio, caption)}

    return _written(folder, draw)


def ladder_picture(folder: RunFolder, rungs: Sequence[Revision], command: str) -> tuple[list[str], list[str]]:
    """Error of every revision of the model as a staircase.

    Parameters
    ----------
    folder : RunFolder
    rungs : sequence of Revision
        Revisions, in their order.
    command : str
        Command line, for the caption.
    """
    return _written(folder, lambda: ladder_figures(folder, rungs, command))


def ladder_figures(folder: RunFolder, rungs: Sequence[Revision], command: str) -> dict[str, Figure]:
    """Figure of the revisions of a model, by name.

    Parameters
    ----------
    folder : RunFolder
    rungs : sequence of Revision
        In their order.
    command : str
        Command line, for the caption.
    """
    from beltcomm.report import staircase, style

    caption = style.Caption(command or f"beltcomm ladder {pasted(folder.path)}", f"{folder.path.resolve().name}/results/ladder.yaml")
    steps = [staircase.Stair(r.name, r.change, r.ratio, r.held_out, r.confirmed) for r in rungs]
    return {"ladder": staircase.staircase_figure(steps, caption)}


def responses_picture(folder: RunFolder, table: ResponseTable, command: str) -> tuple[list[str], list[str]]:
    """All frequency responses of a run; nothing without any.

    Parameters
    ----------
    folder : RunFolder
    table : ResponseTable
        Responses with the conditions they were measured in.
    command : str
        Command line, for the caption.
    """
    if not table.rows:
        return [], []

    def draw() -> dict[str, Figure]:
        from beltcomm.report import responses, style

        caption = style.Caption(command or f"beltcomm compare {pasted(folder.path)}", f"{folder.path.resolve().name}/recordings")
        shown = [(f"{row.condition.record}, {row.condition.words()}", row.response, row.landmarks) for row in table.rows]
        sentences = [f"by {d.cause}: {d.text}" for d in table.differences]
        return {"responses": responses.responses_figure(shown, sentences, caption)}

    return _written(folder, draw)


def proof_picture(
    folder: RunFolder,
    design: DesignResult,
    cascade: Cascade,
    proof: DesignProof,
    recordings: Sequence[Recording],
    delay_s: float,
    command: str,
) -> tuple[list[str], list[str]]:
    """Open loops of a design by model and as measured.

    Parameters
    ----------
    folder : RunFolder
    design : DesignResult
        Result with its plants.
    cascade : Cascade
        That was designed.
    proof : DesignProof
        On the measured responses.
    recordings : sequence of Recording
        Of the responses.
    delay_s : float, s
        Dead time of the torque path.
    command : str
        Command line, for the caption.
    """

    def draw() -> dict[str, Figure]:
        from beltcomm.report import proof as drawn
        from beltcomm.report import style

        conditions = {c.record: c for c in proof.conditions}
        period_s = design.structure.period_s
        shown = []
        for name, response, late_s in plant_responses([r for r in recordings if r.name in conditions], delay_s):
            loop = measured_loop(response, cascade, period_s, late_s)
            shown.append(drawn.ProvenResponse(f"{name}, {conditions[name].words()}", loop))
        caption = style.Caption(
            command or f"beltcomm design {pasted(folder.path)}", f"{folder.path.resolve().name}/recordings, designs/final.yaml"
        )
        sentences = [f"nearest to -1 of all, sensitivity {proof.worst.sensitivity_db:.1f} dB: {proof.worst.text}"]
        return {"design_proof": drawn.proof_figure(design, shown, sentences, caption)}

    return _written(folder, draw)


def friction_pictures(folder: RunFolder, found: FrictionStudy, command: str) -> tuple[list[str], list[str]]:
    """Friction by order, over the session's clock, and beside the damping of a response.

    Parameters
    ----------
    folder : RunFolder
    found : FrictionStudy
        Sweeps, drifts and standstill.
    command : str
        Command line, for the caption.
    """

    def draw() -> dict[str, Figure]:
        from beltcomm.report import friction as report
        from beltcomm.report import style

        shown = f"{folder.path.resolve().name}/recordings, {len(found.sweeps)} sweeps"
        caption = style.Caption(command or f"beltcomm friction --compare {pasted(folder.path)}", shown)
        return report.figures(found.friction, found.sweeps, found.drifts, found.standstill, caption)

    return _written(folder, draw)


def load_picture(folder: RunFolder, found: LoadDependence, by: str, command: str) -> tuple[list[str], list[str]]:
    """Friction against load, into the first of the runs.

    Parameters
    ----------
    folder : RunFolder
        The first of the runs.
    found : LoadDependence
        Friction of each load.
    by : str
        Name of the load's axis.
    command : str
        Command line, for the caption.
    """

    def draw() -> dict[str, Figure]:
        from beltcomm.report import friction as report
        from beltcomm.report import style

        shown = "; ".join(g.name for g in found.groups)
        return {"friction_load": report.load_figure(found, by, style.Caption(command or "beltcomm friction --compare", shown))}

    return _written(folder, draw)


def ways_picture(folder: RunFolder, name: str, ways: Sequence[LoopReading], command: str) -> tuple[list[str], list[str]]:
    """Frequency responses of one axis by several ways.

    Parameters
    ----------
    folder : RunFolder
    name : str
        Of the picture.
    ways : sequence of LoopReading
        One response for each way of measuring.
    command : str
        Command line, for the caption.
    """

    def draw() -> dict[str, Figure]:
        from beltcomm.report import style
        from beltcomm.report.responses import ResponseLine, ways_figure

        caption = style.Caption(
            f"{command} --run {pasted(folder.path)}", f"{folder.path.resolve().name}/results/{name}_*.csv and recordings"
        )
        shown = [ResponseLine(f"{one.name} ({one.record})", one.response, one.highest_hz, one.way == "open") for one in ways]
        return {name: ways_figure(shown, caption)}

    return _written(folder, draw)


def _written(folder: RunFolder, draw: Callable[[], dict[str, Figure]]) -> tuple[list[str], list[str]]:
    """Paths of what was written, relative to the run folder, and remarks on what could not be."""
    from beltcomm.report.style import save

    where = folder.path / FOLDER
    try:
        with pictures_in(folder.terms):
            made = [save(picture, where / f"{name}.png") for name, picture in draw().items()]
    except OSError as error:
        return [], [f"no pictures: {where} cannot be written ({error.strerror or error})"]
    return [str(Path(FOLDER) / path.name) for path in made], []


def lines(folder: RunFolder, made: Sequence[str], remarks: Sequence[str]) -> list[str]:
    """Sentences of a command on its pictures.

    Parameters
    ----------
    folder : RunFolder
    made : sequence of str
        Paths in the run folder.
    remarks : sequence of str
        On pictures that could not be made.
    """
    return [*([f"Pictures in {folder.path}: {', '.join(made)}"] if made else []), *(f"Note: {remark}" for remark in remarks)]
