"""``python -m beltcomm``: the same as the ``beltcomm`` command."""

from __future__ import annotations

from beltcomm.cli.main import main

if __name__ == "__main__":
    main()
