"""``beltcomm demo``: a virtual axis with a fault that nobody knows, found by the commands that one would type.

Each step is the public function behind a command; the fault is drawn by the seed, put into the virtual plant, and told at the end.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm import api
from beltcomm.configfiles import to_yaml, write_text
from beltcomm.effects import effect_named
from beltcomm.errors import Refused
from beltcomm.given import pasted
from beltcomm.language import told, tr
from beltcomm.model import Model, load_plant
from beltcomm.result import with_unit
from beltcomm.rundata.revisions import current_model
from beltcomm.runfolder import RunFolder
from beltcomm.simulate.plant import SimulatedPlant
from beltcomm.talk import Silence, Talk

#: The axis of the demonstration, a shipped one, and where its carriage stands, m.
PLANT, AXIS, START_M = "g_a", "egc-70-600", 0.25
#: Faults that a machine gets or is built with: values that are drawn to within a quarter, and pairs that have a phase of their own.
FAULTS: dict[str, dict[str, float]] = {
    "cogging": {"order": 12.0, "sine": 0.03, "cosine": 0.0},
    "tooth_ripple": {"sine": 0.03, "cosine": 0.0},
    "pulley_eccentricity": {"sine": 0.02, "cosine": 0.0},
    "friction_position": {"amount": 0.05, "place": 0.3, "width": 0.06},
    "stribeck": {"amount": 0.06, "speed_scale": 2.5},
    "cable_chain": {"rate": 12.0, "offset": -3.0},
    "quadratic_drag": {"factor": 6.0},
}
#: Values that are drawn as they are: orders are whole.
FIXED = ("order",)
SPREAD = 0.25


@dataclass(frozen=True)
class DemoStep:
    """A step of the demonstration.

    Attributes
    ----------
    command : str
        As one would type it.
    why : str
        What it is for, one line.
    lines, data
        What it said.
    """

    command: str
    why: str
    lines: Sequence[str]
    data: dict[str, Any] = field(default_factory=dict)


class _Progress:
    """Phases and progress of a talk; what a command says in between would bury the steps."""

    def __init__(self, talk: Talk) -> None:
        self.phase, self.progress, self.moving = talk.phase, talk.progress, talk.moving
        self.confirm, self.attended = talk.confirm, talk.attended

    def say(self, *lines: str) -> None:
        """Left out."""


def _hidden(seed: int) -> tuple[str, Model]:
    """The fault of a seed, and the shipped plant's model with it."""
    random = np.random.default_rng(seed)
    name = str(random.choice(sorted(FAULTS)))
    values = {key: value if key in FIXED else value * random.uniform(1.0 - SPREAD, 1.0 + SPREAD) for key, value in FAULTS[name].items()}
    if "cosine" in values:
        size, phase = values["sine"], random.uniform(0.0, 2.0 * np.pi)
        values |= {"sine": size * np.cos(phase), "cosine": size * np.sin(phase)}
    return name, load_plant(PLANT).model.with_effect(name, values)


def demo(run: Path, *, seed: int, talk: Talk | None = None) -> Iterator[DemoStep]:
    """Measure, compare, diagnose, add, look, in less than a minute, one :class:`DemoStep` after the other; the last tells what was hidden.

    Parameters
    ----------
    run : Path
        Of the run folder, which is made.
    seed : int
        Of the fault.
    talk : Talk or None
        Hears progress; None says nothing.

    Raises
    ------
    Refused
        When the search does not find it; else as the commands.
    """
    talk = _Progress(talk or Silence())
    name, model = _hidden(seed)
    machine = _plant_of(run, model)
    drive = f"virtual:{machine}"
    api.identify(drive, AXIS, run, options=_options(model, seed), talk=talk)
    yield DemoStep(
        f"beltcomm identify --drive {pasted(drive)} --run {pasted(run)}",
        tr("Measure: the axis jogs a few mm in each direction, then is excited in place."),
        [tr("A first model: masses, stiffness of the belt, friction.")],
    )
    swept = api.friction(drive, run, options=_options(model, seed), talk=talk)
    yield DemoStep(
        f"beltcomm friction --drive {pasted(drive)} --run {pasted(run)}",
        tr("Measure where it travels: strokes over the whole axis, slow to fast."),
        swept.details[1:4],
    )
    api.friction(drive, run, options=_options(model, seed), talk=talk)
    yield DemoStep(
        f"beltcomm friction --drive {pasted(drive)} --run {pasted(run)}",
        tr("Once more, as a witness: this record is held out, nothing is fitted to it."),
        [tr("A second sweep, which can contradict what is found in the others.")],
    )
    compared = api.compare(run, pictures=False, talk=talk)
    error = compared.to_json()
    worst = [f"  {place['text']}" for place in error["worst"][:3]]
    yield DemoStep(
        f"beltcomm compare {pasted(run)}",
        tr("Is the model right? 1.00 would mean that nothing is missing."),
        [tr("The error is {ratio:.2f} times the noise. Where:", ratio=error["ratio"]["overall"]), *worst],
        {"ratio": error["ratio"]},
    )
    diagnosed = api.diagnose(run, cost=False, talk=talk)
    found = diagnosed.to_json()
    yield DemoStep(
        f"beltcomm diagnose {pasted(run)}",
        tr("What is missing?"),
        diagnosed.text,
        {"verdict": found["verdict"], "ranking": found["ranking"][:3]},
    )
    added = [step["added"] for step in found["steps"] if step["added"]]
    if not added:
        raise Refused(f"the search of this demonstration ended with '{found['verdict']}'; hidden was {name}. Try another --seed")
    for effect in added:
        data = api.add(effect, run, cost=False, talk=talk).to_json()
        before, now = data["before"], data["after"]
        errors = {"old": before["ratio"], "new": now["ratio"], "was": before["held_out"], "now": now["held_out"]}
        said = tr("error over noise {old:.2f} -> {new:.2f}, of the record held out {was:.2f} -> {now:.2f}", **errors)
        yield DemoStep(
            f"beltcomm add {effect} {pasted(run)}",
            tr("Put it into the model and fit everything again."),
            [said, *_pictures(data["pictures"], run)],
            {"before": before, "after": now, "pictures": data["pictures"]},
        )
    ladder = api.ladder(run)
    yield DemoStep(f"beltcomm ladder {pasted(run)}", tr("All of it as a staircase down to the noise."), ladder.text)
    yield DemoStep(
        "", tr("What was hidden"), _answer(name, model, added, run), {"hidden": name, "named": list(added), "right": name in added}
    )


def _plant_of(run: Path, model: Model) -> Path:
    """The machine with the fault, as a plant file beside its run: what is recorded or verified later is recorded on it, too.

    Raises UsageError where it cannot be written.   That of a run that is there already stays as it is.
    """
    path = run.with_name(f"{run.name}.plant.yaml")
    if not (run / "run.yaml").exists():
        with suppress(OSError):  # told by what is written there
            path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, to_yaml({**model.to_dict(), "drive": load_plant(PLANT).drive_section()}))
    return path


def _options(model: Model, seed: int) -> api.Options:
    """A new virtual machine with the model inside: each command connects anew, and finds the carriage where it began."""
    return api.Options(yes=True, seed=seed, drive={"plant": SimulatedPlant(model, START_M), "start_position": START_M})


def _pictures(made: Sequence[str], run: Path) -> list[str]:
    """Pictures of before and after."""
    return [tr("Before and after, as a picture: {file}", file=run / name) for name in made]


def _answer(name: str, model: Model, added: Sequence[str], run: Path) -> list[str]:
    """Fault that was built into the axis, and what was found of it."""
    effect = effect_named(name)
    amounts = (with_unit(f"{key.partition('.')[2]} {model[key]:.3g}", model.parameters[key].unit) for key in effect.full_names())
    right = tr("not found: {names} was named", names=", ".join(added))
    if name in added and (known := current_model(RunFolder.open(run))) is not None:
        halves = {key: known.parameters[key].interval for key in effect.full_names()}
        right = f"{tr('found')}: " + ", ".join(
            f"{key.partition('.')[2]} {known[key]:.3g}" + ("" if half is None else f" ± {half:.2g}") for key, half in halves.items()
        )
    return [
        tr(
            "Hidden was {name} ({title}): {amounts}; {right}.", name=name, title=told(effect.title), amounts=", ".join(amounts), right=right
        ),
        tr("What a technician sees: {seen}.", seen=told(effect.seen)),
        tr("What to check on the machine: {check}.", check=told(effect.check)),
    ]
