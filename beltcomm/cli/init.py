"""``beltcomm init``: axis.yaml from the data sheets."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from beltcomm.axis.entries import AT, COMMISSION_NEEDS
from beltcomm.cli import completion
from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation
from beltcomm.cli.questions import Back, Done, ask_number, ask_word, otherwise, reply, tell, toothed, with_key
from beltcomm.errors import Refused, UsageError
from beltcomm.given import pasted
from beltcomm.language import told, tr
from beltcomm.quantities import mm, unit_of

if TYPE_CHECKING:
    from beltcomm.axis import Axis
    from beltcomm.axis.answers import Kind
    from beltcomm.axis.entries import AxisEntry

_INTRODUCTION = (
    "I ask for the data sheets' values of motor, coupling, pulley, belt and limits. Write a unit if it is not the one in "
    "brackets (0.449 kg cm2, 78 mm, 3000 rpm). Enter means: not known, or keeps the value shown; 'none' means: there is none; 'back' "
    "goes back to the question before, 'done' leaves out the rest. What commissioning cannot do without is asked all the same.\n"
)
_TITLES = {
    "motor": "Motor",
    "gearbox": "Gearbox (ratio 1 when there is none)",
    "coupling": "Coupling between motor and axis",
    "pulley": "Driving pulley",
    "belt": "Toothed belt",
    "travel": "Travel of the carriage",
    "limits": "Limits of the mechanics",
    "mounting": "Mounting",
    "payload": "Payload",
    "targets": "Targets of the axis (Enter: the default, 1 mm while it moves and 0.1 mm from 0.5 s on, at the motor)",
}
#: Asked only where another entry of the section has a value.
_ONLY_WITH = {"brake_time_s": "brake_torque_nm"}
#: Behind the name of the file: what was answered when the questions were broken off.
UNFINISHED = ".unfinished"
#: Words that may be written for a kind of axis.  An axis that is none of them is taken as one rigid mass, for imported records.
_KINDS = {
    "b": "belt",
    "ball screw": "screw",
    "ballscrew": "screw",
    "spindle": "screw",
    "pinion": "rack",
    "table": "rotary",
    "none": "other",
}
_BELT_SECTIONS = ("gearbox", "coupling", "pulley", "belt")


@click.command("init")
@click.argument("file", type=click.Path(path_type=Path), default=Path("axis.yaml"))
@click.option(
    "--from",
    "template",
    metavar="AXIS",
    shell_complete=completion.axes,
    help="Begin with this axis: a file or a name.",
)
@click.option("--motor", metavar="NAME", help="Begin with this motor of the catalogue.")
@click.option("--catalogue", is_flag=True, help="List axes and motors of public data sheets, and write nothing.")
@click.option("--schema", type=click.Choice(["axis", "plan", "profile"]), help="Print the JSON schema of such a file, for an editor.")
@click.option("--set", "entries", multiple=True, metavar="KEY=VALUE", help="motor.inertia_kg_m2=0.449kgcm2; then nothing is asked.")
@click.option("--yes", is_flag=True, help="Ask nothing; overwrite an existing file.")
@shared.output_options
@click.pass_obj
def command(
    frame: Invocation,
    /,
    file: Path,
    template: str | None,
    motor: str | None,
    entries: tuple[str, ...],
    yes: bool,
    catalogue: bool,
    schema: str | None,
) -> int:
    """Write FILE (axis.yaml): what is known of an axis beforehand, by questions from its data sheets.

    Example: beltcomm init --from parker-osp-e25bhd --motor yaskawa-sgmsh-10a
    """
    from beltcomm.axis import axis_from_dict
    from beltcomm.axis.terms import terms_of
    from beltcomm.axis.written import commented
    from beltcomm.configfiles import read_yaml, write_text

    if schema is not None:
        click.echo(json.dumps(_schema(schema), indent=1, ensure_ascii=False))
        return 0
    if catalogue:
        return _catalogue(frame)
    if file.is_dir():
        raise UsageError(f"{file} is a folder; give the name of the file to write, such as {file / 'axis.yaml'}")
    unfinished = file.with_name(f"{file.name}{UNFINISHED}")
    begun = unfinished.is_file() and not (template or motor or entries or yes)
    asked = not (entries or yes)
    kind = _ask_kind(template) if asked and not begun else _stated_kind(entries)
    start = axis_from_dict(read_yaml(unfinished), unfinished) if begun else _start(template, motor, kind, asked=asked)
    data = start.to_dict()
    # an axis that is begun with values asks no more than whether a file may be overwritten
    if entries or yes:
        for text in entries:
            _set(data, text)
    else:
        if begun:
            tell(tr("{file} holds the answers of a start that was broken off; Enter keeps them.\n", file=unfinished))
        data = _ask_all(start, unfinished, kind or start.kind or "other")
    axis = axis_from_dict(data)
    if file.exists() and not yes and not frame.talk().confirm(f"{file} exists. Overwrite it?"):
        raise Refused(f"{file} was left as it is; give another file name")
    write_text(file, commented(axis))
    unfinished.unlink(missing_ok=True)
    missing = _missing(axis)
    lines = [tr("{file} is written: {name}.", file=file, name=axis.name or tr("axis without a name"))]
    wanted = axis.targets
    targets = "your targets" if wanted.stated else "default targets, state your own under targets"
    judged = f"Judged by: {mm(wanted.following_m)} while it moves, {mm(wanted.settled_m)} after {wanted.after_s:g} s ({targets})."
    lines.append(told(terms_of(axis).said(judged)))
    if axis.transmission is not None and axis.rigid:
        lines.append(tr("No stiffness between motor and load is stated: the axis counts as rigid."))
    lines += [tr("Still needed: {entries}.", entries=", ".join(missing))] if missing else []
    zero = "A drive without an absolute zero is commissioned with --home (it searches its zero) or --position (where the carriage stands)."
    lines.append(terms_of(axis).said(told(zero)))
    if missing:
        why = tr("asks for what is missing, Enter keeps the rest; commissioning refuses to begin before")
        lines.append(f"Next: beltcomm init {pasted(file)} --from {pasted(file)}   ({why})")
    else:
        why = tr("compares it with the drive, yours for can0; moves nothing")
        lines.append(f"Next: beltcomm doctor --drive can0 --axis {pasted(file)}   ({why})")
    frame.print({"file": str(file), "axis": axis.to_dict(), "missing": missing}, lines)
    return 0


def _ask_kind(template: str | None) -> str:
    """The kind of axis, asked first: everything after it depends on that.   template : whose kind Enter takes."""
    from beltcomm.axis import load_axis
    from beltcomm.axis.answers import parts
    from beltcomm.axis.kinds import BELT, KINDS
    from beltcomm.configfiles import did_you_mean, named_file

    told = BELT
    if template is not None and (named_file(template) or template not in parts("axes")):
        told = load_axis(template).kind or "other"
    known = {BELT: tr("toothed belt"), **{name: tr(kind.title) for name, kind in KINDS.items()}, "other": tr("none of these")}
    tell("\n".join([tr("Kinds of axes:"), *(f"  {name:<8}{title}" for name, title in known.items())]))
    while True:
        answer = reply(tr("Kind of the axis"), told).lower()
        answer = _KINDS.get(answer, answer)
        if answer in known:
            return answer
        tell(f"    {answer!r}: {', '.join(known)}{did_you_mean(answer, known)}")


def _start(template: str | None, motor: str | None, kind: str, *, asked: bool) -> Axis:
    """Start of the questions: an axis by file or name, a motor of the catalogue; asked for where a person answers."""
    from beltcomm.axis import axis_from_dict, load_axis
    from beltcomm.axis.answers import parts, with_part
    from beltcomm.configfiles import named_file

    data: dict[str, Any] = {}
    if template is None and motor is None and asked:
        tell(_introduction(kind))
        template = _known_part("axes", tr("Axis")) if kind == "belt" else None
        motor = _known_part("motors", tr("Motor")) if kind != "linear" else None
    if template is not None:
        catalogue = not named_file(template) and template in parts("axes")
        data = with_part({}, "axes", template) if catalogue else load_axis(template).to_dict()
    if motor is not None:
        data = with_part(data, "motors", motor)
    return axis_from_dict(_of_kind(data, kind))


def _stated_kind(entries: tuple[str, ...]) -> str:
    """The kind of axis that --set states; "" where it states none."""
    stated = (text.partition("=") for text in entries)
    return next((value.strip() for key, _, value in stated if key.strip() == "transmission.kind"), "")


def _of_kind(data: dict[str, Any], kind: str) -> dict[str, Any]:
    """An axis as one of this kind: of another kind it keeps name and motor, whose entries mean the same.   kind : "" leaves it."""
    from beltcomm.axis.kinds import KINDS

    if kind not in KINDS or dict(data.get("transmission") or {}).get("kind") == kind:
        return data
    return {**{key: data[key] for key in ("name", "motor") if key in data}, "transmission": {"kind": kind}}


def _introduction(kind: str) -> str:
    """Introduction to the questions, and how to answer."""
    text = tr(_INTRODUCTION)
    return text if kind in ("belt", "other", "") else text.replace("pulley, belt", "transmission").replace("Scheibe, Riemen", "Übertragung")


def _known_part(kind: Kind, word: str) -> str | None:
    """A name of the catalogue, asked for until it is one; None for an empty answer."""
    from beltcomm.axis.answers import parts

    known = parts(kind)
    tell(f"{tr('Catalogue')}: {', '.join(known)}")
    while answer := reply(tr("{word} from the catalogue (Enter: none of these)", word=word), ""):
        if answer.lower() in known:
            return answer.lower()
        from beltcomm.configfiles import did_you_mean

        tell(f"    {answer!r}: not in the catalogue{did_you_mean(answer, known)}")
    return None


def _schema(file: str) -> Mapping[str, Any]:
    """JSON schema of a kind of file.   Raises UsageError without an adapter that has profiles."""
    if file == "axis":
        from beltcomm.axis.written import axis_schema

        return axis_schema()
    if file == "plan":
        from beltcomm.schedule.next_plan import plan_schema

        return plan_schema()
    from beltcomm.drive import find_adapters

    for found in find_adapters():
        if found.adapter is not None and found.adapter.profile_schema is not None:
            return found.adapter.profile_schema()
    raise UsageError("no installed adapter has profiles; `beltcomm drives` lists them")


def _catalogue(frame: Invocation) -> int:
    """Axes and motors with where their numbers are from."""
    from beltcomm.axis.answers import parts
    from beltcomm.result import table

    found: dict[str, Any] = {"axes": parts("axes"), "motors": parts("motors")}
    rows = [[name, str(entry["title"]), str(entry["source"])] for kind in found.values() for name, entry in kind.items()]
    first, second = next(iter(found["axes"])), next(iter(found["motors"]))
    frame.print(found, [*table(["name", "axis or motor", "source"], rows), f"Next: beltcomm init --from {first} --motor {second}"])
    return 0


def axis_with(axis: str | None, entries: tuple[str, ...], run: Path) -> Axis:
    """An axis by name or file, else that of a run, else an empty one, with entries from --set.

    Parameters
    ----------
    axis : str or None
        Name or path; None without one.
    entries : tuple of str
        ``KEY=VALUE``.
    run : Path
        Of the run folder.

    Raises
    ------
    UsageError
        For an entry or a file that is wrong.
    """
    from beltcomm.axis import Axis, axis_from_dict, load_axis

    in_run = run / "axis.yaml"
    start = load_axis(axis or str(in_run)) if axis or in_run.is_file() else Axis(name=run.resolve().name)
    data = axis_from_dict(_of_kind(start.to_dict(), _stated_kind(entries))).to_dict()
    for text in entries:
        _set(data, text)
    return axis_from_dict(data)


def _missing(axis: Axis) -> dict[str, str]:
    """Entries that commissioning will ask for, with their purpose."""
    from beltcomm.axis.kinds import KINDS

    own = KINDS.get(axis.kind)
    return {entry if own is None else own.in_file(entry): purpose for entry, purpose in axis.needs.items() if axis.get(entry) is None}


def _set(data: dict[str, Any], text: str) -> None:
    """Put one ``section.key=value`` into the mapping; unknown keys are found when it becomes an axis."""
    key, equals, value = text.partition("=")
    if not equals:
        raise UsageError(f"--set {text} has no value; write it as KEY=VALUE, such as motor.inertia_kg_m2=44.9e-6")
    *sections, last = key.strip().split(".")
    place = data
    for section in sections:
        inner = place.setdefault(section, {})
        if not isinstance(inner, dict):
            raise UsageError(f"--set {text}: {section} is a value, not a section; the keys are those of axis.yaml")
        place = inner
    place[last] = _value(key.strip(), last, value.strip())
    if last == "effective_radius_m":
        for (section, name), known in toothed(value.strip()).items():
            data.setdefault(section, {}).setdefault(name, known)


def _value(key: str, name: str, text: str) -> str | float | None:
    if text.lower() in {"", "null", "none"}:
        return None
    numeric = bool(unit_of(name)) or name in {"ratio", "teeth", "encoder_counts_per_rev", "counts_per_pole_pair"}
    if not numeric:
        return text
    value = otherwise(name, text)
    return with_key(key, name, text) if value is None else value


def _ask_all(start: Axis, unfinished: Path, kind: str) -> dict[str, Any]:
    """All entries by questions; a wrong answer is explained and asked again.   unfinished : what is known when they are broken off."""
    from beltcomm.axis.entries import SECTIONS, entries_of
    from beltcomm.axis.kinds import KINDS

    data: dict[str, Any] = start.to_dict()
    own = KINDS.get(kind)
    data["name"] = reply(tr("Name of the axis"), start.name)
    while not data["name"]:
        data["name"] = reply(tr("  Plans and reports need its name"), "")
    if own is not None:
        entries = own.sections()
    else:
        sections = {name: each for name, each in SECTIONS.items() if kind == "belt" or name not in _BELT_SECTIONS}
        entries = {section: entries_of(each) for section, each in sections.items()}
        for section in SECTIONS.keys() - sections.keys():
            data.pop(section, None)
    words = {"motor": ["name"], "targets": ["at"]}
    questions = [(section, name) for section in entries for name in (*words.get(section, []), *entries[section])]
    answers = _Answers(data["name"], kind if own is not None else "")
    try:
        _ask_each(questions, entries, data, answers)
    except (KeyboardInterrupt, UsageError):
        _keep(answers.known, unfinished)
        raise
    return {**data, **{section: answers.known.get(section, {}) for section in entries}}


def _keep(known: dict[str, Any], unfinished: Path) -> None:
    from beltcomm.configfiles import to_yaml, write_text

    if known.keys() - {"name", "transmission"}:
        write_text(unfinished, to_yaml(known))
        tell(f"\nWhat was answered is kept in {unfinished}; the same command goes on with it.")


class _Answers:
    """Answers given.   told : by section and name, in the order asked.   implied : what one of them says of others, not asked then."""

    def __init__(self, name: str, kind: str = "") -> None:
        self.name, self.kind = name, kind
        self.told: dict[tuple[str, str], Any] = {}
        self.implied: dict[tuple[str, str], float] = {}

    @property
    def known(self) -> dict[str, Any]:
        """As axis.yaml has it."""
        found: dict[str, Any] = {"name": self.name}
        if self.kind:
            found["transmission"] = {"kind": self.kind}
        for (section, name), value in {**self.told, **self.implied}.items():
            if value not in (None, ""):
                found.setdefault(section, {})[name] = value
        return found

    def fault(self, section: str, name: str, value: float) -> str:
        """Contradiction between a further answer and those before, "" for none."""
        from beltcomm.axis import axis_from_dict

        known = self.known
        try:
            axis_from_dict({**known, section: {**known.get(section, {}), name: value}})
        except UsageError as error:
            return str(error)
        return ""


def _ask_each(
    questions: Sequence[tuple[str, str]], entries: Mapping[str, Mapping[str, AxisEntry]], start: Mapping[str, Any], answers: _Answers
) -> None:
    """The questions one after the other, and back."""
    from beltcomm.axis.kinds import KINDS

    before: dict[tuple[str, str], Any] = {}  # answered before somebody went back
    asked, at, done = list[int](), 0, False
    needs = KINDS[answers.kind].needs if answers.kind in KINDS else COMMISSION_NEEDS
    while at < len(questions):
        section, name = key = questions[at]
        if key in answers.implied or (name in _ONLY_WITH and answers.told.get((section, _ONLY_WITH[name])) is None):
            at += 1
            continue
        known = before.get(key, (start.get(section) or {}).get(name))
        if done and (known is not None or f"{section}.{name}" not in needs):
            answers.told[key] = known
            at += 1
            continue
        if not asked or questions[asked[-1]][0] != section:
            tell(f"\n{tr(_title(section, answers.kind))}")
        try:
            where = f"[{at + 1}/{len(questions)}] "
            if name == "name":
                answers.told[key] = reply(where + tr("Type"), known or "", back=True)
            elif name == "at":
                load = KINDS[answers.kind].load if answers.kind else AT[1]
                question = tr("Where targets count: motor, carriage or both").replace("carriage", load)
                answers.told[key] = ask_word(where + question, (AT[0], load, AT[2]), known or "")
            else:
                fault = partial(answers.fault, section, name)
                value, text = ask_number(f"{section}.{name}", name, entries[section][name], known, fault, where, answers.kind)
                answers.told[key] = value
                if name == "effective_radius_m":
                    answers.implied = toothed(text)
        except Done:
            if done:  # said again, of one that is needed
                answers.told[key] = None
                at += 1
            done = True
            continue
        except Back:
            at = asked.pop() if asked else 0
            before[questions[at]] = answers.told.pop(questions[at], None)
            continue
        asked.append(at)
        at += 1


def _title(section: str, kind: str) -> str:
    """Of a section, as the kind of axis calls it."""
    from beltcomm.axis.kinds import KINDS
    from beltcomm.axis.terms import terms

    own = KINDS.get(kind)
    return _TITLES[section] if own is None else own.titles.get(section) or terms(kind).said(_TITLES[section])
