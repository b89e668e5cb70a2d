"""``beltcomm drives``: which adapters there are."""

from __future__ import annotations

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Frame


@click.command("drives")
@shared.output_options
@click.pass_obj
def command(frame: Frame, /) -> int:
    """List the drive adapters that are installed; of a broken one, why."""
    from beltcomm.configfiles import config_names
    from beltcomm.drive import find_adapters

    found = find_adapters()
    profiles = config_names("drives")
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
    }
    lines = [
        f"{item.adapter.name:10} {item.adapter.summary}  (--drive {', '.join(item.adapter.schemes)})"
        if item.adapter
        else f"{item.entry_point:10} is broken: {item.reason}"
        for item in found
    ]
    if not found:
        lines = ["no adapters installed; run `pip install -e .` in the beltcomm folder"]
    frame.print(data, [*lines, f"drive profiles (--profile): {', '.join(profiles)}; virtual drives have reference and cmmp-as"])
    return 0
