"""A drive before it is used: whether it can do what is asked, and a simulated one for other processes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from beltcomm.drive import Drive, Listening, MotionKind, Service, adapter_for, find_adapters
from beltcomm.drive.finding import Finding
from beltcomm.errors import DriveError, Refused, UsageError
from beltcomm.given import word


def able(drive: Drive, kind: MotionKind) -> Drive:
    """Drive itself, if it offers this kind of motion and takes what a record sets; nothing has moved yet.

    An adapter may offer ``trial() -> list[Finding]``, which tries that and puts it back: what is wrong closes the drive, what it refuses
    goes into ``Capabilities.cautions``.

    Parameters
    ----------
    drive : Drive
        Connected; closed where it is refused.
    kind : MotionKind
        Of the motions that are wanted.

    Returns
    -------
    Drive
        The same, its capabilities with what it does not take.

    Raises
    ------
    Refused
        When it offers no such motion, with the reason.
    DriveError
        With what it does not take.
    """
    has = drive.capabilities
    if kind in has.kinds:
        try:
            found: list[Finding] = getattr(drive, "trial", list)()
        except BaseException:
            drive.close()
            raise
        if wrong := [f"{one.text}; {one.remedy}" for one in found if one.state == "wrong"]:
            drive.close()
            raise DriveError(f"{has.name} cannot be recorded: {wrong[0]}; nothing was moved")
        cautions = (*has.cautions, *(one.text for one in found if one.state == "warning"))
        refused = frozenset(int(one.values["limit_object"]) for one in found if "limit_object" in one.values)
        drive.capabilities = replace(has, cautions=cautions, not_taken=refused)
        return drive
    drive.close()
    why = has.refused.get(kind) or f"it offers motions of kind {', '.join(sorted(has.kinds)) or 'none'}, not {kind}"
    raise Refused(
        f"{has.name} cannot do this: {why}; nothing was moved. `beltcomm doctor` shows its modes, a profile can name others (--profile)"
    )


def serve_drive(name: str, on: str, options: Mapping[str, object] | None = None) -> Service:
    """Simulated drive for other processes.

    Parameters
    ----------
    name : str
        Of the drive, ``virtual:g_a``.
    on : str
        Interface on which it is met.
    options : dict of str to object or None
        For the adapter, by name.

    Raises
    ------
    UsageError
        When no adapter serves a drive of this name, and what the adapter raises.
    """
    scheme, _, address = word(name, "drive").partition(":")
    for item in find_adapters():
        if item.adapter and item.adapter.serve and scheme in item.adapter.schemes:
            return item.adapter.serve(address, on, options or {})
    raise UsageError(f"{name!r} is no simulated drive, so it cannot be served; give virtual or virtual:PLANT")


def listen_to(name: str, options: Mapping[str, object] | None = None) -> Listening:
    """Bus of a drive, listened to.

    Parameters
    ----------
    name : str
        As for ``--drive``.
    options : dict of str to object or None
        For the adapter, by name.

    Raises
    ------
    UsageError
        When no adapter listens to a drive of this name, and what the adapter raises.
    """
    adapter, address = adapter_for(name, find_adapters())
    if adapter.listen is None:
        raise UsageError(f"{name!r} has no bus that can be listened to; record what it does into a log, and watch that (--log FILE)")
    return adapter.listen(address, options or {})
