"""The virtual drive for other processes, until it is ended."""

from __future__ import annotations

from beltcomm.drive.access import serve_drive
from beltcomm.experiments.options import Options
from beltcomm.result import Result
from beltcomm.talk import Silence, Talk


def serve(drive: str, on: str, *, options: Options | None = None, talk: Talk | None = None) -> Result:
    """Serve the simulated ``drive`` on an interface until KeyboardInterrupt; ``talk`` hears first where it is found.

    Parameters
    ----------
    drive : str
        Name of a simulated drive.
    on : str
        ``slcan`` (a pseudo-terminal), ``socket:PORT`` (TCP on this computer), ``can0`` and whatever else an adapter opens; ``rs232`` (the
        other port of the drive, on a pseudo-terminal).
    options : Options or None
        Settings beside the main arguments; None for the safe defaults.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        After the interruption.

    Raises
    ------
    UsageError
        For a drive that is not simulated or an interface that is none.
    BusError
        For one that cannot be used.
    """
    options, talk = options or Options(), talk or Silence()
    with serve_drive(drive, on, options.for_drive()) as service:
        talk.say(f"{service.title}: in another terminal, --drive {service.reached_as}; Ctrl-C ends it here")
        counted = service.run()
    words = ", ".join(f"{number} {name.replace('_', ' ')}" for name, number in counted.items())
    return Result({"reached_as": service.reached_as, "served": service.title, **counted}, [f"Served {service.title}: {words}."])
