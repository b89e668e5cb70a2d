"""``beltcomm drives``: which adapters there are."""

from __future__ import annotations

from pathlib import Path

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation


@click.command("drives")
@click.option(
    "--eds", type=click.Path(path_type=Path), metavar="FILE", help="Show an EDS or DCF in place: its objects, and what it had wrong."
)
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, eds: Path | None) -> int:
    """List the drive adapters that are installed; of a broken one, why.  With --eds, what a drive's data sheet holds."""
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
