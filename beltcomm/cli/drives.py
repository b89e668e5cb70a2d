"""``beltcomm drives``: which adapters there are."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation, api, options_of
from beltcomm.cli.help import option


@click.command("drives")
@partial(shared.drive_options, needed=False)
@option(
    "--new",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write a commented profile, from --drive, --eds or both.",
    brief="Write a profile, from --drive, --eds or both.",
)
@option(
    "--eds",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Show an EDS or DCF: its objects, what it had wrong; or for --new.",
    brief="Show an EDS or DCF; or for --new.",
)
@click.option("--yes", is_flag=True, help="Overwrite the file of --new without asking.")
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, new: Path | None, drive: str | None, eds: Path | None, yes: bool, **given: Any) -> int:
    """List the drive adapters that are installed; of a broken one, why.  With --eds, what a drive's data sheet holds.

    With --profile what a profile says of a kind of drive, field by field; with --new a profile of one's own is begun.

    Example: beltcomm drives
    """
    if new is not None:
        return frame.show(api().new_profile(new, drive, eds, options_of(yes=yes, **given), frame.talk()))
    if given.get("profile") is not None:
        return _show_profile(frame, str(given["profile"]))
    if eds is not None:
        return _show_file(frame, eds)
    from beltcomm.configfiles import config_names
    from beltcomm.drive import find_adapters
    from beltcomm.result import table

    found = find_adapters()
    profiles, slaves = config_names("drives"), config_names("slaves")
    data = {
        "drives": [
            {
                "entry_point": item.entry_point,
                "name": item.adapter.name if item.adapter else None,
                "summary": item.adapter.summary if item.adapter else None,
                "schemes": list(item.adapter.schemes) if item.adapter else [],
                "works": item.adapter is not None,
                "reason": item.reason,
            }
            for item in found
        ],
        "profiles": profiles,
        "slaves": slaves,
    }
    rows = [
        (item.adapter.name, ", ".join(item.adapter.schemes), item.adapter.summary)
        if item.adapter
        else (item.entry_point, "", f"is broken: {item.reason}")
        for item in found
    ]
    lines: list[str] = [*table(["adapter", "--drive", "what it reaches"], rows)]
    if not found:
        lines = ["no adapters installed; run `pip install -e .` in the beltcomm folder"]
    frame.print(
        data,
        [
            *lines,
            "",
            f"drive profiles (--profile): {', '.join(profiles)}; virtual drives have reference and cmmp-as",
            f"a virtual drive plays (--as): {', '.join(slaves)}",
        ],
    )
    return 0


def _show_file(frame: Invocation, path: Path) -> int:
    """Print an EDS or DCF."""
    from beltcomm.foreign.eds import load_object_file

    found = load_object_file(path)
    values = {one.title: one.value for one in found.objects if one.value is not None}
    data = {"file": str(path), "device": dict(found.device), "objects": len(found.objects), "values": values, "repairs": found.repairs}
    shown = [f"  {title:9} = {value:g}" for title, value in values.items()]
    frame.print(data, [*found.lines(), *(["Values to be written:", *shown] if shown else [])])
    return 0


def _show_profile(frame: Invocation, name: str) -> int:
    """Print what a profile says, and where each field is from; what cannot be used is refused as ``doctor`` and ``commission`` do."""
    from beltcomm.configfiles import find_config, named_file, read_yaml
    from beltcomm.drive import find_adapters
    from beltcomm.result import table

    path = find_config("drives", name)
    raw = read_yaml(path)
    for item in find_adapters():
        if item.adapter is not None and item.adapter.check_profile is not None:
            item.adapter.check_profile(name)
    sources = raw.pop("sources", None) or {}
    if named_file(name):
        said = {key: {"source": "this file", "confidence": "read"} for key in raw if key not in ("name", "title", "like")}
        sources = {**said, **sources}
    rows = [
        [key, _short(value), *_told(sources.get(key))]
        for key, value in raw.items()
        if key not in ("never_write", "known_gains", "emergency")
    ]
    rows += [
        ["gain", f"{one.get('place')}, {one.get('what')}: not known is {one.get('missing') or 'nothing'}", *_told(one)]
        for one in raw.get("known_gains") or ()
    ]
    rows += [["locked", f"{one.get('what')}", *_told(one)] for one in raw.get("never_write") or ()]
    frame.print({"file": str(path), **raw, "sources": sources}, [*table(["field", "value", "is", "source"], rows)])
    return 0


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _told(source: Any) -> list[str]:
    return [str(source.get("confidence", "")), str(source.get("source", ""))] if isinstance(source, dict) else ["", ""]
