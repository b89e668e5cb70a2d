"""RS-232: the scheme ``serial`` is known, so that it can say what to use instead."""

from __future__ import annotations

from collections.abc import Mapping

from beltcomm.drive import Adapter, Drive
from beltcomm.errors import UsageError
from beltcomm_adapters.examination.line import examine_line


def _open(address: str, _options: Mapping[str, object]) -> Drive:
    raise UsageError(
        f"RS-232 drives are not built yet, so serial:{address} cannot be opened; connect the drive's CAN port and use can0, or "
        "slcan:/dev/ttyACM0 for a serial CAN adapter"
    )


ADAPTER = Adapter(
    name="serial",
    summary="drive on RS-232 (not built yet; use its CAN port)",
    schemes=("serial",),
    open=_open,
    examine=examine_line,
)
