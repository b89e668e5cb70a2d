"""``beltcomm drives --new``: a commented drive profile from what a drive answers, from its EDS, or from both."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from beltcomm.configfiles import write_text
from beltcomm.drive import Adapter, adapter_for, find_adapters
from beltcomm.drive.objects import DictionaryEntry
from beltcomm.errors import UsageError
from beltcomm.experiments.options import Options
from beltcomm.foreign.eds import load_object_file
from beltcomm.given import may_write, pasted
from beltcomm.result import Result
from beltcomm.talk import Talk


def new_profile(file: Path, drive: str | None, eds: Path | None, options: Options, talk: Talk) -> Result:
    """Write a profile of a drive, by what the drive and its EDS say.

    Parameters
    ----------
    file : Path
        To be written; ends in .yaml or .yml.
    drive : str or None
        Drive that is asked, as for ``--drive``; None asks none.
    eds : Path or None
        EDS or DCF of the drive; None for none.
    options : Options
        Settings of the adapter, and consent.
    talk : Talk

    Raises
    ------
    UsageError
        For neither drive nor EDS, or another ending.
    Refused
        For a no.
    BusError
        When nobody answers.
    """
    if drive is None and eds is None:
        raise UsageError("say what the profile is to be written from: --drive D, --eds FILE, or both")
    if file.suffix not in (".yaml", ".yml"):
        raise UsageError(f"{file} is to be the profile; give a name that ends in .yaml")
    device: Mapping[str, str] = {}
    entries: list[DictionaryEntry] = []
    said: list[str] = []
    if eds is not None:
        found = load_object_file(eds)
        device, said = found.device, found.lines()
        entries = [
            DictionaryEntry(o.index, o.subindex, o.name, o.kind, o.access, o.default if o.value is None else o.value) for o in found.objects
        ]
    adapter, address = _writer(drive)
    assert adapter.new_profile is not None
    text = adapter.new_profile(address, options.for_drive(), device, entries)
    may_write(file, options.yes, talk)
    write_text(file, text)
    where = pasted(file if file.is_absolute() or "/" in str(file) else f"./{file}")
    lines = [
        *said,
        f"{file} is written: read through it, fill in what the manual says.",
        f"Next: beltcomm doctor --drive {pasted(options.reached(drive or 'DRIVE'))} --profile {where}",
    ]
    return Result({"file": str(file), "text": text}, lines)


def _writer(drive: str | None) -> tuple[Adapter, str | None]:
    """The adapter that writes profiles, and the address it is to ask, None for none.   Raises UsageError."""
    installed = find_adapters()
    if drive is not None:
        adapter, address = adapter_for(drive, installed)
        if adapter.new_profile is None:
            raise UsageError(f"the adapter {adapter.name} has no profiles")
        return adapter, address
    for item in installed:
        if item.adapter is not None and item.adapter.new_profile is not None and item.adapter.name != "virtual":
            return item.adapter, None
    raise UsageError("no installed adapter has profiles; `beltcomm drives` lists them")
