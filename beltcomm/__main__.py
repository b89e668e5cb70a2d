"""``python -m beltcomm``: the same as the ``beltcomm`` command."""

from __future__ import annotations

import sys

if __name__ == "__main__":
    if not sys.flags.safe_path:
        del sys.path[0]  # the working directory, where `python -m` looks for modules first
    from beltcomm.cli.main import main

    main()
