"""python-can without its reader of MDF4 files, which would load pandas: half a second of every command that talks to a drive.

Imported before ``can`` by whoever uses it first.  Our own reader of MDF4 files does not go through python-can.
"""

from __future__ import annotations

import sys

if "can" not in sys.modules and "asammdf" not in sys.modules:
    sys.modules["asammdf"] = None  # type: ignore[assignment]  # python-can takes it for not installed
    try:
        import can  # noqa: F401
    finally:
        del sys.modules["asammdf"]
