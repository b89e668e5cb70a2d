"""Pictures: values to figures.  Absolute scales, so that two runs compare; colours that everybody can tell apart.

matplotlib is loaded here, with its own settings: a ``matplotlibrc`` of the working directory or of the user changes no report.
"""

import os
from importlib.util import find_spec
from pathlib import Path

from platformdirs import user_cache_path

from beltcomm import isolation

os.environ.setdefault("MPLCONFIGDIR", str(user_cache_path("beltcomm") / "matplotlib"))
_found = find_spec("matplotlib")
with isolation.apart(Path(str(_found and _found.origin)).parent / "mpl-data", "MPLBACKEND"):  # its shipped settings; pictures are files
    import matplotlib  # noqa: F401
