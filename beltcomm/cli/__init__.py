"""The command line: one file per verb; prints, asks, exit codes."""

import os
import sys


def _leave_working_directory() -> None:
    """No entry of PYTHONPATH that means "wherever I stand", as an empty one behind a last colon does; before anything is imported."""
    entries = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    own = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
    try:
        relative = {os.path.realpath(entry or ".") for entry in entries if not os.path.isabs(entry)} - {os.path.realpath(own)}
    except OSError:  # the working directory has gone
        return
    if os.environ.get("PYTHONPATH"):
        sys.path[:] = [entry for entry in sys.path if os.path.realpath(entry) not in relative]


_leave_working_directory()
