"""``--help``, one screen of what a technician needs; ``--help-all``, every option.  What stands where is said beside the option."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from enum import StrEnum
from typing import Any, TypeVar

import click

from beltcomm.language import tr

#: Lines of a screen of 24 above the shell's next prompt.
LINES = 23
#: Columns that an explanation begins behind at the latest; a longer option stands alone on its line, or without its choices.
COLUMN = 24
Command = TypeVar("Command", bound=Callable[..., Any])


class About(StrEnum):
    """Titles of ``--help-all``, in their order, for the options that ``--help`` leaves out."""

    BUS = "Drive and bus"
    MOTION = "Before it moves"
    MOVE = "Move"
    CONTROLLER = "Controller"
    EXCITATION = "Excitation"
    ROWS = "Rows of a file"
    RECORD = "Of the record"
    OUTPUT = "Output"


class Option(click.Option):
    """An option that says where its help stands.

    Parameters
    ----------
    topic : About or None
        Section of ``--help-all``; None for an option that ``--help`` shows, too.
    brief : str
        Its line in ``--help`` where ``help`` is longer.
    """

    def __init__(self, *args: Any, topic: About | None = None, brief: str = "", **known: Any) -> None:
        super().__init__(*args, **known)
        self.topic, self.brief = topic, brief


def option(*names: str, topic: About | None = None, brief: str = "", **known: Any) -> Callable[[Command], Command]:
    """``click.option`` of an :class:`Option`.

    Parameters
    ----------
    *names : str
        As of ``click.option``.
    topic, brief : str
        As of :class:`Option`.
    **known : Any
        As of ``click.option``.
    """
    return click.option(*names, cls=Option, topic=topic, brief=brief, **known)


def help_options(command: Command) -> Command:
    """``--help`` and ``--help-all``.

    Parameters
    ----------
    command : Command
        A verb, or the group of all.
    """
    known: dict[str, Any] = {"is_flag": True, "is_eager": True, "expose_value": False, "callback": _show, "topic": About.OUTPUT}
    whole = option("--help-all", help="Every option.", **known)
    return option("-h", "--help", help="One screen: the options needed most.", **known)(whole(command))


def _show(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    """Print the help that an option asks for, and leave."""
    if value and not ctx.resilient_parsing:
        click.echo(_screen(ctx) if param.opts[-1] == "--help" else _text(ctx, everything=True), color=ctx.color)
        ctx.exit()


def _screen(ctx: click.Context) -> str:
    """All of a help that is no longer than a screen; else its options without a topic, and how to see the others."""
    if overview := getattr(ctx.command, "overview", None):
        return str(overview())
    whole = _text(ctx, everything=True)
    if len(whole.splitlines()) <= LINES:
        return whole
    return f"{_text(ctx, everything=False)}\n\n{tr('more')}: {ctx.command_path} --help-all"


def _text(ctx: click.Context, *, everything: bool) -> str:
    """Help of the command of a context.   everything : all paragraphs and options, each in full."""
    command, formatter = ctx.command, ctx.make_formatter()
    formatter.write_usage(ctx.command_path, " ".join(command.collect_usage_pieces(ctx)), prefix=f"{tr('Usage')}: ")
    told = paragraphs(command)
    for paragraph in told if everything else (told[0], *(one for one in told[1:] if _is_example(one))):
        formatter.write_paragraph()
        with formatter.indentation():
            example = f"{tr('Example')}:{paragraph.partition(':')[2]}"
            formatter.write_text(example if _is_example(paragraph) else tr(paragraph))
    sections: dict[About | None, list[tuple[str, str]]] = {topic: [] for topic in (None, *About)}
    for param in command.params:
        if (record := param.get_help_record(ctx)) and record[1]:
            sections[getattr(param, "topic", None)].append(_row(param, *record, everything=everything))
    for topic, rows in sections.items():
        if rows and (everything or topic is None):
            with formatter.section(tr("Options" if topic is None else topic)):
                formatter.write_dl(rows, col_max=COLUMN)
    if everything and isinstance(command, click.Group):
        command.format_commands(ctx, formatter)
    return formatter.getvalue().rstrip("\n")


def paragraphs(command: click.Command) -> list[str]:
    """Paragraphs of a command's help, each in one line."""
    return [" ".join(part.split()) for part in inspect.cleandoc(command.help or "").split("\n\n")]


def _is_example(paragraph: str) -> bool:
    return paragraph.startswith("Example: ")


def _row(param: click.Parameter, names: str, text: str, *, everything: bool) -> tuple[str, str]:
    """Left and right of an option's lines.   names, text : as click has them, with limits and default behind the help."""
    told, brief = getattr(param, "help", None) or "", getattr(param, "brief", "")
    if everything or not brief:
        extra = text.removeprefix(told).replace("required", tr("required")).replace("default:", f"{tr('default')}:")
        return names, tr(told) + extra
    return (names if len(names) <= COLUMN else max(param.opts, key=len)), tr(brief) + f"  [{tr('required')}]" * param.required
