"""The virtual drive's RS-232 port on a pseudo-terminal: any program that opens serial ports can talk to it."""

from __future__ import annotations

import os
import select
from collections.abc import Callable
from types import TracebackType

from beltcomm.errors import UsageError
from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.service_port import ServicePort


class PseudoTerminal:
    """A pair of terminals; ``path`` is what the other program opens.  Use as a context manager.

    The other program's bit rate is that of the terminal, so that a wrong one garbles here as on a wire.
    bus : with a wall clock, which paces it.     Raises UsageError on a system without pseudo-terminals.
    """

    def __init__(self, bus: LockstepBus, port: ServicePort) -> None:
        try:
            import termios
            import tty
        except ImportError as error:
            raise UsageError("this system has no pseudo-terminals; use serial:virtual inside one program instead") from error
        self._bus, self._port = bus, port
        self._termios = termios
        self._rates = {getattr(termios, name): int(name[1:]) for name in dir(termios) if name[0] == "B" and name[1:].isdigit()}
        self._master, self._slave = os.openpty()  # the other end stays open, or the first program to leave would end it
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)

    def serve(self, goes_on: Callable[[], bool]) -> None:
        """Carry characters and let time pass while ``goes_on()``."""
        while goes_on():
            self.step()

    def step(self) -> None:
        """One tick of the drive."""
        bitrate = self._rates.get(self._termios.tcgetattr(self._slave)[5], 0) or self._port.bitrate
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
