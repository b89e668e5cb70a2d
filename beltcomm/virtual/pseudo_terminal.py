"""The virtual drive's RS-232 port on a pseudo-terminal: any program that opens serial ports can talk to it."""

from __future__ import annotations

import os
import select
from collections.abc import Callable
from types import TracebackType

from beltcomm.errors import UsageError
from beltcomm.posix import terminal_pair
from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.service_port import ServicePort


class PseudoTerminal:
    """A pair of terminals; ``path`` is what the other program opens.  Use as a context manager.

    The other program's bit rate is that of the terminal, so that a wrong one garbles here as on a wire.

    Parameters
    ----------
    bus : LockstepBus
        With a wall clock, which paces it.

    Raises
    ------
    UsageError
        On a system without pseudo-terminals.
    """

    def __init__(self, bus: LockstepBus, port: ServicePort) -> None:
        pair = terminal_pair()
        if pair is None:
            raise UsageError("this system has no pseudo-terminals; use serial:virtual inside one program instead")
        self._bus, self._port, self._pair = bus, port, pair
        self._master, self._slave = pair.here, pair.there  # the other end stays open, or the first program to leave would end it
        self.path = pair.path

    def serve(self, goes_on: Callable[[], bool]) -> None:
        """Carry characters and let time pass while ``goes_on()``."""
        while goes_on():
            self.step()

    def step(self) -> None:
        """One tick of the drive."""
        bitrate = self._pair.bitrate() or self._port.bitrate
        if select.select([self._master], [], [], 0.0)[0]:
            self._port.send(os.read(self._master, 4096), bitrate)
        self._bus.advance()
        if answer := self._port.take(bitrate):
            os.write(self._master, answer)

    def close(self) -> None:
        """Let both ends go."""
        os.close(self._master)
        os.close(self._slave)

    def __enter__(self) -> PseudoTerminal:
        return self

    def __exit__(self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None) -> None:
        self.close()
