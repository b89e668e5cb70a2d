"""``beltcomm init``: axis.yaml from the data sheets."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from beltcomm.cli import completion
from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation
from beltcomm.cli.interview import asked_all
from beltcomm.cli.questions import NONE, Back, Done, otherwise, reply, tell, toothed, with_key
from beltcomm.errors import Refused, UsageError
from beltcomm.given import pasted
from beltcomm.language import told, tr
from beltcomm.quantities import mm, unit_of

if TYPE_CHECKING:
    from beltcomm.axis import Axis
    from beltcomm.axis.answers import Kind

_INTRODUCTION = (
    "I ask for the data sheets' values of motor, coupling, pulley, belt and limits. Write a unit if it is not the one in "
    "brackets (0.449 kg cm2, 78 mm, 3000 rpm). Enter means: not known, or keeps the value shown; 'none' means: there is none; 'back' "
    "goes back to the question before, 'done' leaves out the rest. What commissioning cannot do without is asked all the same.\n"
)
#: Behind the name of the file: what was answered when the questions were broken off.
UNFINISHED = ".unfinished"
#: Words that may be written for a kind of axis.  An axis that is none of them is taken as one rigid mass, for imported records.
_KINDS = {
    "b": "belt", "riemen": "belt", "zahnriemen": "belt",
    "ball screw": "screw", "ballscrew": "screw", "spindle": "screw", "spindel": "screw", "kugelgewindetrieb": "screw",
    "pinion": "rack", "zahnstange": "rack",
    "table": "rotary", "drehachse": "rotary", "drehtisch": "rotary",
    "linearmotor": "linear", "linear motor": "linear",
    "none": "other",
}  # fmt: skip


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
@click.option("--ask-all", is_flag=True, help="With --from: ask for what it holds, too.")
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
    ask_all: bool,
    catalogue: bool,
    schema: str | None,
) -> int:
    """Write FILE (axis.yaml): what is known of an axis beforehand, by questions from its data sheets.

    Example: beltcomm init --from parker-osp-e25bhd --motor yaskawa-sgmsh-10a
    """
    from beltcomm.axis import axis_from_dict
    from beltcomm.axis.doubtful import doubts
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
    asked, settled = not (entries or yes), not ask_all
    kind = _stated_kind(entries)
    while True:
        with suppress(Back):  # out of the catalogue, to the kind
            kind = _ask_kind(template, settled=settled) if asked and not begun else kind
            start = axis_from_dict(read_yaml(unfinished), unfinished) if begun else _start(template, motor, kind, asked=asked)
            break
    data = start.to_dict()
    # an axis that is begun with values asks no more than whether a file may be overwritten
    if entries or yes:
        for text in entries:
            _set(data, text)
    else:
        if begun:
            tell(tr("{file} holds the answers of a start that was broken off; Enter keeps them.\n", file=unfinished))
        data = asked_all(start, unfinished, kind or start.kind or "other", of=template or motor or "" if settled else "")
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
    lines += [told(f"Note: {terms_of(axis).said(doubt)}") for doubt in doubts(axis)]
    lines += [tr("Still needed: {entries}.", entries=", ".join(missing))] if missing else []
    zero = "A drive without an absolute zero is commissioned with --home (it searches its zero) or --position (where the carriage stands)."
    lines.append(terms_of(axis).said(told(zero)))
    if missing:
        why = tr("asks for what is missing; commissioning refuses to begin before")
        lines.append(f"Next: beltcomm init {pasted(file)} --from {pasted(file)}   ({why})")
    else:
        why = tr("compares it with the drive, yours for can0; moves nothing")
        lines.append(f"Next: beltcomm doctor --drive can0 --axis {pasted(file)}   ({why})")
    frame.print({"file": str(file), "axis": axis.to_dict(), "missing": missing}, lines)
    return 0


def _ask_kind(template: str | None, *, settled: bool) -> str:
    """The kind of axis, asked first: everything after it depends on that.   template : whose kind Enter takes, or is taken if settled."""
    from beltcomm.axis import load_axis
    from beltcomm.axis.answers import parts
    from beltcomm.axis.kinds import BELT, KINDS
    from beltcomm.configfiles import did_you_mean, named_file

    told = BELT
    if template is not None and (named_file(template) or template not in parts("axes")):
        told = load_axis(template).kind or "other"
    known = {BELT: tr("toothed belt"), **{name: tr(kind.title) for name, kind in KINDS.items()}, "other": tr("none of these")}
    if template is not None and settled and told in known:
        tell(f"{tr('Kind of the axis')}: {known[told]}")
        return told
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
    question = tr("{word} from the catalogue (Enter: none of these)", word=word)
    with suppress(Done):
        while (answer := reply(question, "", back=True)).lower() not in ("", *NONE):
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
    frame.print(
        found, [*table([tr("name"), tr("axis or motor"), tr("source")], rows), f"Next: beltcomm init --from {first} --motor {second}"]
    )
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
