"""RS-232: from the address of a serial port to a drive."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import serial

from beltcomm.drive import Adapter, Drive
from beltcomm.errors import BusError, UsageError
from beltcomm_adapters.buses import MonotonicClock
from beltcomm_adapters.examination.line import examine_line
from beltcomm_adapters.options import profile_name
from beltcomm_adapters.serial_drive import SerialDrive
from beltcomm_adapters.serial_line import BITRATES, DEFAULT_BITRATE

_OPTIONS: Final = ("bitrate", "profile", "rtscts")
_HANDSHAKE: Final = ",rtscts"
_SIMULATED: Final = "virtual"
_for_url: Callable[..., Any] = serial.serial_for_url


class SerialPort:
    """A port of this computer, or what pyserial reaches by an address (``socket://host:port``).  8 data bits, no parity, 1 stop bit.

    Parameters
    ----------
    rtscts : bool
        The drive and the cable have hardware handshake; a driver in the wild uses it (G1), the makers' manuals do not (F6).

    Raises
    ------
    BusError
        When the port cannot be opened.
    """

    def __init__(self, name: str, rtscts: bool) -> None:
        self.name = name
        try:
            self._port: Any = _for_url(name, baudrate=BITRATES[0], timeout=0.0, rtscts=rtscts, write_timeout=1.0)
        except (OSError, ValueError) as error:  # pyserial's own errors are OSErrors
            raise BusError(
                f"the serial port {name} cannot be opened: {error}; check its name, that it is plugged in, that no other program has it, "
                "and that you may use it (on Linux: group dialout)"
            ) from error

    @property
    def bitrate(self) -> int:
        """Of this end."""
        return int(self._port.baudrate)

    @bitrate.setter
    def bitrate(self, value: int) -> None:
        self._port.baudrate = value

    def write(self, data: bytes) -> None:
        """Send.  Raises OSError."""
        self._port.write(data)
        self._port.flush()

    def read(self, timeout_s: float) -> bytes:
        """Bytes that have come, waiting at most ``timeout_s`` for the first byte of it.  Raises OSError."""
        self._port.timeout = timeout_s
        return bytes(self._port.read(max(1, self._port.in_waiting)))

    def close(self) -> None:
        """Let the port go."""
        self._port.close()


def _connect(name: str, bitrate: int, profile: str | None, rtscts: bool) -> SerialDrive:
    """The drive on a port of this computer.  On failure the port is closed.  Raises as :class:`SerialPort`, :class:`SerialDrive`."""
    port = SerialPort(name, rtscts)
    try:
        return SerialDrive(port, MonotonicClock(), bitrate, profile, port.close)
    except BaseException:
        port.close()
        raise


def _bitrate_of(options: Mapping[str, object]) -> int:
    """The option ``bitrate``.  Raises UsageError for one that these drives do not have."""
    value = options.get("bitrate")
    if value is None:
        return DEFAULT_BITRATE
    if str(value) not in map(str, BITRATES):
        raise UsageError(f"a drive's RS-232 port has {', '.join(map(str, BITRATES))} bit/s, not {value}")
    return int(str(value))


def _open(address: str, options: Mapping[str, object]) -> Drive:
    """``address``: the port's name, ``,rtscts`` behind it for hardware handshake; ``virtual``, ``virtual:PLANT`` for a simulated drive.

    Options: bitrate (115200), profile, rtscts; of a simulated one those of the adapter ``virtual`` beside bitrate and profile.
    """
    scheme, _, plant = address.partition(":")
    if scheme == _SIMULATED:
        from beltcomm_adapters.virtual_serial import open_serial

        return open_serial(plant, options, _bitrate_of(options))
    if unknown := sorted(set(options) - set(_OPTIONS)):
        raise UsageError(f"a drive on RS-232 has no option {', '.join(unknown)}; it has {', '.join(_OPTIONS)}")
    name = address.removesuffix(_HANDSHAKE)
    if not name:
        raise UsageError("say which port: serial:/dev/ttyUSB0, serial:COM3, or serial:virtual for a simulated drive")
    rtscts = name != address or str(options.get("rtscts", "")).lower() in ("1", "true", "yes", "on")
    return _connect(name, _bitrate_of(options), profile_name(options), rtscts)


ADAPTER = Adapter(
    name="serial",
    summary="drive on RS-232, for parameters, strokes and friction: serial:/dev/ttyUSB0 (append ,rtscts for handshake), serial:virtual",
    schemes=("serial",),
    open=_open,
    examine=examine_line,
)
