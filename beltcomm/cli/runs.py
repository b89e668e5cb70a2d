"""``beltcomm runs``: the runs here, the newest first."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import click

from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation
from beltcomm.cli.newest import RUNS, runs_here, written
from beltcomm.language import tr


@click.command("runs")
@click.argument("folder", type=click.Path(path_type=Path), default=RUNS)
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, folder: Path) -> int:
    """The runs in FOLDER (runs/ when left out), the newest first: axis, drive, and what is said of each.

    Example: beltcomm runs
    """
    from beltcomm.result import table

    found = [_told(path) for path in reversed(runs_here(folder))]
    if not found:
        none = tr("There is no run in {folder}.", folder=folder)
        frame.print({"runs": []}, [none, "Next: beltcomm commission --drive virtual   (makes one)"])
        return 0
    words = [str(one["headline"]["word"]) for one in found]
    rows = [
        [str(one["run"]), str(one["date"])[5:], str(one["axis"]), _short(str(one["drive"])), tr(word)]
        for one, word in zip(found, words, strict=True)
    ]
    frame.print(
        {"runs": found},
        [
            *table([tr("run"), tr("last change"), tr("axis"), tr("drive"), tr("result")], rows),
            f"Next: beltcomm open {found[0]['run']}   ({tr('all of a run on a page')})",
        ],
    )
    return 0


def _short(drive: str) -> str:
    """A drive as it fits into a row: a virtual one without the file of its machine."""
    scheme, _, behind = drive.partition(":")
    return scheme if scheme == "virtual" and behind.endswith(".yaml") else drive


def _told(path: Path) -> dict[str, Any]:
    """A run in a line; what is wrong with it, where it cannot be read."""
    from beltcomm.cli.aftermath import OF_VALUES, edited_files
    from beltcomm.errors import BeltcommError
    from beltcomm.given import pasted
    from beltcomm.rundata.headline import drive_called, headline_of
    from beltcomm.runfolder import RunFolder

    told = {"run": str(path), "date": f"{datetime.fromtimestamp(written(path)):%Y-%m-%d %H:%M}", "axis": "", "drive": ""}
    try:
        folder = RunFolder.open(path)
        called = drive_called(folder)
        return {
            **told,
            "axis": folder.axis.name if folder.has_axis else "",
            "drive": pasted(called) if called is not None else str((folder.load_result("drive") or {}).get("name") or ""),
            "headline": headline_of(folder).to_dict(),
        }
    except (BeltcommError, *OF_VALUES) as problem:  # one that somebody has edited hides none of the others
        edited = "" if isinstance(problem, BeltcommError) else edited_files([path])
        sentence = f"{edited} is not as beltcomm wrote it ({problem})" if edited else str(problem)
        return {**told, "headline": {"state": "damaged", "word": "DAMAGED", "sentence": sentence}}
