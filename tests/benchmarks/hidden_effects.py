"""Known-truth examination of the laboratory: is a hidden effect named, is a healthy machine left alone?

Every draw is a machine of its own of the independent simulator ``tests/truth/hidden``.  Its session is written into a run folder without
the answer, and the diagnosis gets that folder only.

    python tests/benchmarks/hidden_effects.py run FILE SET FIRST COUNT    draws of a set with seeds FIRST …, one line of JSON each
    python tests/benchmarks/hidden_effects.py table FILE …                confusion matrix, shares with their 95 % intervals

Sets: effects (each of the 23 in turn, strength 0.4 to 1.0), weak (0.1 and 0.2), healthy, outside (not in the catalogue), pairs,
backlash (pairs with it).  With drawn instruments (drive, readings, encoder, clock; see ``truth.hidden.instruments``): instruments
(healthy, families sheet and wide by turns), rigid (healthy, without a belt), effects_instruments, outside_instruments; process and
effects_process: as instruments and effects_instruments, with coloured process torque in all of them.

Draws whose session the simulator cannot make (a machine that leaves its travel) are left out, and noted.

It goes on where it was stopped; several may run side by side with files of their own.  Draws that the motor cannot see are marked
before the diagnosis, by ``truth.hidden.visibility``.  Thresholds must be set on other seeds than are reported.
"""

from __future__ import annotations

import itertools
import json
import resource
import sys
import tempfile
import time
import traceback
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from hidden_table import FAMILY, table

from beltcomm.effects import effect_named
from beltcomm.errors import BeltcommError
from beltcomm.fit.estimate import Fitted, fit
from beltcomm.fit.start.model import start_model
from beltcomm.fit.uncertainty.intervals import parameter_spread
from beltcomm.laboratory.diagnosis import Diagnosis, diagnose, fit_base_of
from beltcomm.laboratory.run_checks import check_run
from beltcomm.laboratory.scope import restrict_to_scope
from beltcomm.laboratory.score import ground_of
from beltcomm.laboratory.selection import with_effect
from beltcomm.runfolder import RunFolder
from truth.hidden import Machine, draw
from truth.hidden.catalogue import EFFECTS
from truth.hidden.draw import EXCLUSIVE
from truth.hidden.folder import write_records
from truth.hidden.instruments import with_coloured_process
from truth.hidden.outside import OUTSIDE
from truth.hidden.quantities import DELAYS, covered, true_base, true_values
from truth.hidden.session import run_session
from truth.hidden.visibility import LEAST_INFORMATION, information_in, instants, spectra_of

#: Strengths of the sets.
STRENGTHS = {"weak": (0.2, 0.1)}
USUAL = (0.4, 1.0, 0.7)
#: Families that the draws of a set with instruments take in turn.
FAMILIES = {
    "instruments": ("sheet", "wide"),
    "rigid": ("rigid",),
    "effects_instruments": ("sheet", "wide"),
    "outside_instruments": ("sheet",),
    "process": ("sheet", "wide"),
    "effects_process": ("sheet", "wide"),
}
#: Sets all of whose machines have coloured process torque.
COLOURED = ("process", "effects_process")
#: The catalogue describes these for a motor on the pulley's shaft; no machine of the family wide with a gearbox is asked for them.
WITHOUT_GEAR = {"pulley_eccentricity"}
#: Iterations of the reference fit that begins at the truth.
ITERATIONS = 25

Draw = tuple[int, tuple[str, ...], float]


def draws(name: str, first: int, count: int) -> list[Draw]:
    """Seed, hidden effects and strength; the same list for the same arguments."""
    known = [e for e in EFFECTS if e != "belt_damping"]
    pairs = [p for p in itertools.combinations(known, 2) if possible(p)]
    hidden: list[tuple[str, ...]] = {
        "effects": [(e,) for e in EFFECTS],
        "weak": [(e,) for e in known],
        "healthy": [()],
        "outside": [(e,) for e in OUTSIDE],
        "pairs": [p for p in pairs if "backlash" not in p][::3],  # every third: all effects in fewer draws
        "backlash": [p for p in pairs if "backlash" in p],
        "instruments": [()],
        "rigid": [()],
        "effects_instruments": [(e,) for e in EFFECTS],
        "outside_instruments": [(e,) for e in OUTSIDE],
        "process": [()],
        "effects_process": [(e,) for e in EFFECTS],
    }[name]
    strengths = STRENGTHS.get(name, USUAL)
    rounds = [divmod(i, len(hidden)) for i in range(count)]  # in every round another strength of each
    return [(first + i, hidden[k], strengths[(turn + k) % len(strengths)]) for i, (turn, k) in enumerate(rounds)]


def possible(pair: tuple[str, str]) -> bool:
    """Whether one machine can have both, under names of their own."""
    return FAMILY.get(pair[0], pair[0]) != FAMILY.get(pair[1], pair[1]) and not any(len(group & set(pair)) > 1 for group in EXCLUSIVE)


def family_of(name: str, seed: int, hidden: tuple[str, ...]) -> str:
    """Family of a draw; in every round of a set the other one for each effect, whose number is odd."""
    families = FAMILIES.get(name, ("sheet",))
    return families[0] if WITHOUT_GEAR & set(hidden) else families[seed % len(families)]


def examined(name: str, seed: int, names: tuple[str, ...], strength: float) -> dict[str, Any]:
    """One draw of a set: what was hidden, and what the laboratory said."""
    machine = draw(seed, names, strength, family_of(name, seed, names), drawn_instruments=name in FAMILIES)
    if name in COLOURED:
        coloured = with_coloured_process(seed, machine.instruments)
        machine = draw(seed, names, strength, machine.base.family, instruments=coloured)
    made = list(run_session(machine, "thorough", fine=instants(machine)))
    line: dict[str, Any] = {"seed": seed, "hidden": list(names), "strength": strength, "visible": seen(machine, made)}
    if name in FAMILIES:
        line |= {"family": machine.base.family, "instruments": machine.instruments.describe()}
    with tempfile.TemporaryDirectory() as folder:
        write_records(machine, made, folder + "/run")
        run = RunFolder.open(Path(folder) / "run")
        begin = time.process_time()
        try:
            records = check_run(run.recordings(), run.axis, foreign=True)
            recordings, line["remarks"] = records.recordings, list(records.remarks)
            start = start_model(run.axis, recordings)
            if "belt_damping" in names:
                start = start.without_effect("belt_damping")
            begun = fit_base_of(recordings, run.axis, start)  # the fit that is published, as a user's diagnosis begins with
            found = diagnose(recordings, run.axis, start, begun=begun)
            if name in FAMILIES:  # as a user hears it
                found, line["doubts"] = restrict_to_scope(found, recordings)
            line["cpu_s"] = time.process_time() - begin
            line |= judged(machine, found, run)
            return line | ({"base": base_of(machine, found.published_model)} if name in FAMILIES else {})
        except BeltcommError as error:
            said = str(error).replace(f"{folder}/run/recordings/", "")
            return line | {"verdict": f"{type(error).__name__}: {said}", "cpu_s": time.process_time() - begin}
        except Exception as error:  # a traceback is a failure of this draw and must not hide the others
            line["traceback"] = traceback.format_exc().strip().splitlines()[-7:]
            return line | {"verdict": f"crashed, {type(error).__name__}: {error}", "cpu_s": time.process_time() - begin}


def seen(machine: Machine, records: list[Any]) -> list[str]:
    """Which of the hidden effects the motor can see; a pair by each effect alone."""
    visible = []
    for name in machine.effects:
        if name in OUTSIDE or name == "belt_damping":
            visible.append(name)
            continue
        alone, own = machine, records
        if len(machine.effects) > 1 or machine.instruments.sampling_jitter > 0.0:  # spectra need even samples
            even = replace(machine.instruments, sampling_jitter=0.0)
            alone = draw(machine.seed, (name,), machine.strength, machine.base.family, instruments=even)
            own = list(run_session(alone, "thorough", fine=instants(alone)))
        if information_in(spectra_of(own, alone), alone)[0] >= LEAST_INFORMATION:
            visible.append(name)
    return visible


def judged(machine: Machine, found: Diagnosis, run: RunFolder) -> dict[str, Any]:
    """The diagnosis beside the truth."""
    first, after = found.steps[0], found.final_fit
    line: dict[str, Any] = {"verdict": found.verdict, "added": [s.added for s in found.steps if s.added], "twins": list(found.twins)}
    line["kept"] = [e for e in after.model.effects if e not in found.base.model.effects]
    line["ranking"] = [(c.effect.name, round(c.evidence), c.fitted is not None) for c in first.candidates[:3]]
    line["ratio"] = [found.base.ratio, after.ratio]
    line["held"] = [found.base.held_out_ratio, after.held_out_ratio]
    line["records"] = records_of(found)
    line["level"] = [f.objective / f.problem.samples for f in (found.base, after)]
    hidden = [e for e in machine.effects if e not in OUTSIDE]
    wanted = [e if e in line["kept"] else FAMILY.get(e, e) for e in hidden]  # behind a gap tilt has its own name
    if wanted and not set(machine.effects) & set(OUTSIDE):
        line["best_held"] = reference(machine, found, run, wanted)
    if set(wanted) <= set(line["kept"]):
        model, spread = after.model, parameter_spread(after)
        line["covered"] = {}
        for names, truth in true_values(machine).items():
            if not set(names) <= {*model.parameters, *DELAYS}:
                continue
            factors = {n: 1.0 for n in DELAYS if n in model.parameters} if set(names) <= set(DELAYS) else {}
            if len(factors) > 1:  # two delays in a row: the machine's is told by their sum
                value = sum(model[n] for n in factors)
                inside = covered(truth, (value,), (spread.half_width(factors),))
                line["covered"]["+".join(names)] = [truth, value, inside]
                continue
            values = tuple(model[n] for n in names)
            inside = covered(truth, values, tuple(spread.half_width({n: 1.0}) for n in names))
            line["covered"]["+".join(names)] = [truth, *values, inside]
    return line


def base_of(machine: Machine, after: Fitted) -> dict[str, tuple[float, float, float | None]]:
    """Truth, value and half width of the interval of the healthy machine's parameters; without a belt of inertia and friction."""
    spread, model = parameter_spread(after), after.model
    known = {n: v for n, v in true_base(machine).items() if n in model.parameters and v != 0.0}
    return {n: (v, float(model[n]), spread.half_width({n: 1.0})) for n, v in known.items()}


def records_of(found: Diagnosis) -> list[tuple[str, bool, float, float]]:
    """Name, held out, and ratio before and after of every record."""
    before, after = (white_of(found, fitted) for fitted in (found.base, found.final_fit))
    return [(*key, rms(before[key]), rms(white)) for key, white in after.items() if len(white) and len(before[key])]


def white_of(found: Diagnosis, fitted: Fitted) -> dict[tuple[str, bool], np.ndarray]:
    """The whitened residual of every record; a stretch counts other samples before than after where friction turns in it."""
    parts: dict[tuple[str, bool], list[np.ndarray]] = {}
    for piece, white in zip(fitted.problem.pieces, np.split(fitted.residual, fitted.problem.ends[1:-1]), strict=True):
        parts.setdefault((piece.record, False), []).append(white)
    for piece, white in zip(found.data.held_out, fitted.held_out_residuals, strict=True):
        parts.setdefault((piece.record, True), []).append(white)
    return {key: np.concatenate(whites) for key, whites in parts.items()}


def rms(white: np.ndarray) -> float:
    return float(np.sqrt(np.mean(white**2)))


def reference(machine: Machine, found: Diagnosis, run: RunFolder, wanted: list[str]) -> float | None:
    """Held-out ratio of the true model class, fitted from the truth: base values, and those of the effects that mean the same."""
    fitted = found.final_fit
    for extra in [e for e in fitted.model.effects if e not in (*found.base.model.effects, *wanted)]:
        if extra in fitted.model.effects:
            fitted = fit(found.data, fitted.model.without_effect(extra), ITERATIONS, offsets=fitted.offsets)
    for name in wanted:
        if name not in fitted.model.effects:
            fitted = with_effect(found.data, fitted, ground_of(fitted, found.data.fitted, run.axis), effect_named(name))
    truth = {n: v for n, v in true_base(machine).items() if n in fitted.model.parameters}
    truth |= {names[0]: v for names, v in true_values(machine).items() if len(names) == 1 and names[0] in fitted.model.parameters}
    begun = fit(found.data, fitted.model.with_values(truth, "truth"), ITERATIONS, offsets=fitted.offsets)
    return min((begun, fitted), key=lambda f: f.objective).held_out_ratio


def run_all(file: Path, name: str, first: int, count: int) -> None:
    """All draws of a set that the file does not have yet."""
    lines = read(file)
    done = {(line["seed"], line["set"]) for line in lines}
    for seed, hidden, strength in draws(name, first, count):
        if (seed, name) in done:
            continue
        try:
            line = {"set": name} | examined(name, seed, hidden, strength)
        except RuntimeError as error:  # the simulator cannot make this machine's session: no draw
            line = {"set": name, "seed": seed, "left_out": str(error)}
        line["peak_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        with open(file, "a", encoding="utf-8") as out:
            out.write(json.dumps(line, default=float) + "\n")


def read(file: Path) -> list[dict[str, Any]]:
    """The lines of a file; none where it is missing."""
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()] if file.is_file() else []


if __name__ == "__main__":
    verb, *rest = sys.argv[1:]
    if verb == "run":
        run_all(Path(rest[0]), rest[1], int(rest[2]), int(rest[3]))
    else:
        table([line for file in rest for line in read(Path(file)) if "left_out" not in line])
