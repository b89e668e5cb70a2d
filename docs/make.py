"""Makes docs/effects from the catalogue: ``python docs/make.py`` writes pages, index and pictures; with names of effects only their
pictures, with ``--pages`` none.

A page is what the effect's own declaration says, and nothing else: what is wrong in a page is put right in ``beltcomm/effects``.
"""

from __future__ import annotations

import inspect
import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

sys.path.insert(0, str(Path(__file__).parent))
from experiments import Panel, Symptom
from symptoms import SYMPTOMS

from beltcomm.effects import BELT_DAMPING, BELT_SPRING, BELT_STIFFNESS, EFFECTS, Effect, Parameter, stands_for
from beltcomm.quantities import span_words
from beltcomm.report.style import MEASURED, SEVERE, styled
from beltcomm.simulate.kernels.writer import USUAL

FOLDER = Path(__file__).parent / "effects"
INDEX = Path(__file__).parent / "effects.md"
BEGIN, END = "<!-- made by docs/make.py: begin -->", "<!-- made by docs/make.py: end -->"
#: An SVG whose words stay words is small, and equal runs give equal bytes.
STYLE: Mapping[str, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "beltcomm",
    "font.family": "DejaVu Sans",
    "path.simplify_threshold": 0.3,
}
#: Letters of a line of a page; of a line of a docstring that has no room for another word.
WIDTH, FULL = 110, 100
#: Sides of the gearbox in words.
SIDES = {"motor": "motor shaft", "cart": "carriage", "belt": "belt line", "drive": "drive"}
#: How a state begins in a record, and how it gets into the next one.
BEGINS = {
    "rest": "at rest, or with the motor where that is in motion",
    "unloaded": "unloaded",
    "first value": "as if the first value had always been there",
    "estimated": "anywhere; an observer finds it by the torque",
    "swings": "at rest; a fit counts with the swing that the motion before may have left",
    "clock": "by the session's time in the sidecar",
}
CARRIED = {"end": "a simulation goes on from the end; a fit begins anew", "clock": "by the session's clock", "no": "nothing"}


def pages() -> tuple[Effect, ...]:
    """The effects with a page of their own: numbered ones that share everything with the first stand on its page."""
    first: dict[object, Effect] = {}
    for effect in EFFECTS:
        first.setdefault(
            (effect.law, effect.parameters, effect.name.rpartition("_")[0] if effect.name[-1].isdigit() else effect.name), effect
        )
    return tuple(e for e in first.values() if page_of(e) == e.name)


def page_of(effect: Effect) -> str:
    """The name of the page that an effect stands on."""
    stem, _, number = effect.name.rpartition("_")
    same = [e for e in EFFECTS if e.name == stem and e.law is effect.law]
    return stem if number.isdigit() and same else effect.name


def named_pages(names: Mapping[str, str] | tuple[str, ...]) -> str:
    """Effects as links to their pages; a name that is no effect as it stands."""
    known = {e.name: page_of(e) for e in EFFECTS}
    return ", ".join(f"[{n}]({known[n]}.md)" if n in known else n.replace("_", " ") for n in names)


def laws(effect: Effect) -> list[str]:
    """What its functions say of themselves, once each: equation, symbols, units, source."""
    functions: list[Callable[..., object]] = [effect.law] if effect.law else []
    functions += [element.law for element in effect.elements]
    texts = [(inspect.getdoc(function) or "").replace("``", "") for function in functions]
    return [readable(text) for text in dict.fromkeys(texts)]


def readable(text: str) -> str:
    """A docstring at the width of a page: a line that was full goes on in the next one."""
    whole: list[str] = []
    for line, before in zip(text.splitlines(), ["", *text.splitlines()], strict=False):
        if len(before) > FULL and line:
            whole[-1] += " " + line
        else:
            whole.append(line)
    return "\n".join(fill(line, WIDTH, break_on_hyphens=False, break_long_words=False) for line in whole)


def used(name: str) -> str:
    """In words, what an effect takes from others."""
    return {BELT_STIFFNESS: "the stiffness of the belt", BELT_DAMPING: "the damping of the belt"}.get(name, f"`{name}`")


def row(parameter: Parameter, owner: str) -> str:
    """A line of the table of parameters."""
    bounds = span_words(parameter.low, parameter.high, parameter.unit)
    how = "fitted" if parameter.fitted else "its form: fitted once the effect is named" if parameter.form else "given, not fitted"
    return f"| `{owner}.{parameter.name}` | {parameter.meaning} | {parameter.unit} | {SIDES[parameter.side]} | {bounds} | {how} |"


def commands(effect: Effect) -> tuple[list[str], str]:
    """What to type, and what is to be said of it."""
    name = effect.name
    if effect.bound:
        return [f"beltcomm effects {name}", "beltcomm diagnose RUN"], "`diagnose` shows it as a bound and never adds it."
    if name in USUAL or effect.slot == "rigid":
        return [f"beltcomm effects {name}", "beltcomm fit RUN"], "It belongs to the base model: every fit gives its value with an interval."
    if effect.slot == "load_of_record":
        typed = ["beltcomm import FILE --run RUN --load NAME", "beltcomm compare RUN"]
        return [f"beltcomm effects {name}", *typed], "It comes with the records that name a load, and goes with them."
    if effect.group == BELT_SPRING and effect.bodies:
        return [
            f"beltcomm effects {name}",
            "beltcomm fit RUN --model three-mass",
        ], "It takes the place of `belt_stiffness` in a fit of its own."
    if effect.group == BELT_SPRING:
        return [f"beltcomm effects {name}", "beltcomm fit RUN"], "The fit takes it in place of `belt_stiffness` where the places disagree."
    brought = [e.name for e in EFFECTS if e.group != BELT_SPRING and effect.body in {body.name for body in e.bodies}]
    words = [f"beltcomm effects {name}"]
    words += ["beltcomm diagnose RUN", "beltcomm diagnose RUN --next"] if effect.trials else []
    words += [f"beltcomm add {one} RUN" for one in (*brought, name)] + [f"beltcomm remove {name} RUN"]
    said = "" if effect.trials else "`diagnose` does not put it on trial; `add` fits it."
    if effect.behind_gap:
        where = "behind a gap or a slack strand only"
        said = f"`diagnose` puts it on trial, and `add` fits it, {where}; elsewhere it is one with `{stands_for(effect.name)}`."
    if effect.sought:
        said = f"`diagnose` puts it on trial {effect.sought}; `add` fits it the same way."
    return words, f"{said} It acts on a body that `{brought[0]}` brings." if brought else said


def page(effect: Effect, experiment: str) -> str:
    """The page of an effect.   experiment : what its picture shows."""
    family = [e.name for e in EFFECTS if page_of(e) == effect.name and e is not effect]
    lines = [f"# {effect.title[0].upper()}{effect.title[1:]} (`{effect.name}`)", ""]
    lines += [f"**What you see:** {effect.seen}.", ""]
    lines += [f"![{effect.title}: {experiment}](pictures/{effect.name}.svg)", ""]
    lines += [f"Simulated ([how](../effects.md)): {experiment}; grey without the effect, coloured with it.", ""]
    lines += [
        "## On the machine",
        "",
        f"- **Usual causes:** {effect.causes}.",
        f"- **Check:** {effect.check}.",
        f"- **Remedy:** {effect.remedy}.",
    ]
    lines += ["", "## What looks like it", ""]
    if effect.twins:
        lines += [f"These records often cannot tell it from {named_pages(effect.twins)}. To tell them apart: {effect.separate}.", ""]
    for name, apart in effect.apart.items():
        lines += [f"- {named_pages((name,))}: {apart.shows}.", *(f"  - By hand: {hand.words()}." for hand in apart.hands)]
    lines += [f"- {named_pages((name,))}: {how}." for name, how in effect.alike.items()]
    lines += [""] if effect.alike or effect.apart else []
    if not effect.twins and not effect.alike:
        lines += ["Nothing else in the catalogue.", ""]
    about = inspect.getdoc(inspect.getmodule(effect.law or effect.elements[0].law)) or ""
    lines += ["## Physics", "", about.replace("``", "`"), "", "```text"]
    lines += ["\n\n".join(laws(effect)), "```", ""]
    lines += [f"Slot `{effect.slot}` ([what that means](../effects.md)), source {effect.source}."]
    lines += [f"It uses {', '.join(map(used, effect.uses))}."] if effect.uses else []
    lines += [f"A model has one of the group *{effect.group}* only."] if effect.group else []
    lines += [f"The same law for further orders: {', '.join(f'`{name}`' for name in family)}."] if family else []
    lines += ["", "| parameter | meaning | unit in files | side | bounds | in a fit |", "|---|---|---|---|---|---|"]
    lines += [row(body.inertia, body.name) for body in effect.bodies] + [row(p, effect.owner or effect.name) for p in effect.parameters]
    lines += ["", "## State", ""]
    lines += ["| remembers | unit | at the start of a record | from record to record |", "|---|---|---|---|"] if effect.states else []
    lines += [f"| {s.name} | {s.unit} | {BEGINS[s.start]} | {CARRIED[s.carried]} |" for s in effect.states]
    lines += [] if effect.states else ["None: it depends on the instant only, and no record on the one before by it."]
    typed, said = commands(effect)
    lines += ["", "## Commands", "", "```sh", *typed, "```", "", *([said.strip(), ""] if said else [])]
    lines += ["*Made from the effect's declaration by docs/make.py; see [all effects](../effects.md).*", ""]
    return "\n".join(lines)


def index() -> str:
    """The table of all effects."""
    lines = [BEGIN, "| effect | what it is | slot | what you see |", "|---|---|---|---|"]
    for effect in pages():
        many = len([e for e in EFFECTS if page_of(e) == effect.name])
        name = f"[{effect.name}](effects/{effect.name}.md)" + (f" to {effect.name}_{many}" if many > 1 else "")
        lines.append(f"| {name} | {effect.title} | `{effect.slot}` | {effect.seen} |")
    return "\n".join([*lines, END])


def with_index(text: str) -> str:
    """The page of all effects with a new table."""
    return text[: text.index(BEGIN)] + index() + text[text.index(END) + len(END) :]


def digest(symptom: Symptom) -> list[list[float]]:
    """The numbers behind a picture in short, by line: points, ends, extremes and mean, six digits of each."""
    return [
        [float(f"{v:.6g}") for a in (line.x, line.y) for v in (len(a), a[0], a[-1], np.min(a), np.max(a), np.mean(a))]
        for panel in symptom.panels
        for line in panel.lines
    ]


def draw(symptom: Symptom) -> Figure:
    """The picture of a symptom: grey without the effect, coloured with it."""
    figure = Figure(figsize=(7.6, 3.0 if len(symptom.panels) == 1 else 3.2), layout="constrained")
    all_axes = np.atleast_1d(figure.subplots(1, len(symptom.panels)))
    for axes, panel in zip(all_axes, symptom.panels, strict=True):
        draw_panel(axes, panel)
    all_axes[0].legend(fontsize=8)
    return figure


def draw_panel(axes: Any, panel: Panel) -> None:
    """One diagram."""
    for line in panel.lines:
        style = {
            "color": SEVERE if line.effect else MEASURED,
            "linewidth": 1.5 if line.effect else 1.0,
            "alpha": 1.0 if line.effect else 0.55,
        }
        axes.plot(line.x, line.y, label=line.label or None, linestyle="--" if line.second else "-", **style)
    if panel.logarithmic:
        axes.set_xscale("log")
        ticks = [f for f in (1, 2, 5, 10, 20, 50, 100, 200, 500) if panel.lines[0].x[0] <= f <= panel.lines[0].x[-1]]
        axes.set_xticks(ticks, labels=[str(f) for f in ticks], minor=False)
        axes.set_xticks([], minor=True)
    axes.set(xlabel=panel.x, ylabel=panel.y)


def write_picture(name: str, symptom: Symptom) -> None:
    """As SVG, with the numbers behind it in its description."""
    path = FOLDER / "pictures" / f"{name}.svg"
    path.parent.mkdir(parents=True, exist_ok=True)
    with styled(), rc_context(STYLE):
        words = {"Date": None, "Creator": "beltcomm", "Title": name, "Description": json.dumps(digest(symptom))}
        draw(symptom).savefig(path, format="svg", metadata=words)


def experiments() -> dict[str, str]:
    """What the pictures show, as it stands in them; known without simulating anything."""
    stored = FOLDER / "pictures" / "experiments.json"
    return dict(json.loads(stored.read_text(encoding="utf-8")))


def main(words: list[str]) -> None:
    """Write all pages, and the pictures of the effects in ``words``, or of all.   Raises SystemExit for a name without a page."""
    FOLDER.mkdir(exist_ok=True)
    names = [effect.name for effect in pages()]
    if unknown := set(words) - {"--pages", *names}:
        raise SystemExit(f"no page for {', '.join(sorted(unknown))}; effects with a page are {', '.join(names)}")
    if "--pages" not in words:
        shown = {} if not words else experiments()
        for name in words or names:
            symptom = SYMPTOMS[name]()
            shown[name] = symptom.experiment
            write_picture(name, symptom)
        ordered = {name: shown[name] for name in names if name in shown}
        (FOLDER / "pictures" / "experiments.json").write_text(json.dumps(ordered, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    experiment = experiments()
    for effect in pages():
        (FOLDER / f"{effect.name}.md").write_text(page(effect, experiment[effect.name]), encoding="utf-8")
    INDEX.write_text(with_index(INDEX.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
