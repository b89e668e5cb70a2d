"""Commission a virtual axis from Python: look at the plan, agree to it, read the verdict and the model.

``python examples/commission_virtual_axis.py`` takes some 10 s and writes the run folder ``runs/example-commission``.  On a real axis it
is the same with ``can0`` for the drive and an axis file of your own; leave ``yes=True`` out then, so that a person is asked.
"""

from pathlib import Path

import beltcomm
from beltcomm import api

DRIVE, AXIS, RUN = "virtual:g_b", "egc-70-600", Path("runs/example-commission")


def main() -> int:
    """Commission, print, and return the exit code of the commissioning."""
    plan = api.commission(DRIVE, AXIS, RUN, options=api.Options(quick=True, dry_run=True))
    print(f"The plan takes {plan.data['seconds']:.0f} s on the machine.")

    result = api.commission(DRIVE, AXIS, RUN, options=api.Options(quick=True, yes=True, seed=1))
    headline, measured = result.to_json()["headline"], result.to_json()["verdict"]["measured"]
    print(headline["word"], headline["sentence"])
    print(f"Largest error while moving {1e3 * measured['dynamic_m']:.3f} mm, at rest {1e6 * measured['static_m']:.1f} µm.")

    for name, value in beltcomm.open(RUN).model.items():
        if value.interval is not None:
            print(f"{name:28} {value}")
    return result.exit_code


if __name__ == "__main__":
    raise SystemExit(main())
