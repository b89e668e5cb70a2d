"""Build a machine with a fault, measure it, and let the laboratory name the fault.

``python examples/find_hidden_effect.py`` takes some 15 s.  The machine is the shipped rig ``g_b`` with a tight spot on its
rail, written as a plant file; the commands that follow see its frames only, as they would those of a real drive.
"""

from pathlib import Path

from beltcomm import api
from beltcomm.configfiles import to_yaml, write_text
from beltcomm.model import load_plant

AXIS, RUN, PLANT = "egc-70-600", Path("runs/example-effect"), Path("runs/tight-spot.yaml")


def main() -> int:
    """Measure, compare, diagnose; 0 when the tight spot was named first."""
    rig = load_plant("g_b")
    machine = rig.model.with_effect("friction_position", {"amount": 0.05, "place": 0.3, "width": 0.06})  # N m, m, m
    PLANT.parent.mkdir(exist_ok=True)
    write_text(PLANT, to_yaml({**machine.to_dict(), "drive": rig.drive_section()}))

    options = api.Options(yes=True, seed=1)
    api.identify(f"virtual:{PLANT}", AXIS, RUN, options=options)
    api.friction(f"virtual:{PLANT}", RUN, options=options)

    compared = api.compare(RUN, pictures=False)
    print(f"Without a word of the fault the error is {compared.data['ratio']['overall']:.2f} times the noise. Where:")
    for place in compared.data["worst"][:3]:
        print(f"  {place['text']}")

    diagnosed = api.diagnose(RUN, cost=False)
    print("\n".join(diagnosed.lines()[:6]))
    return 0 if diagnosed.data["named"][:1] == ["friction_position"] else 1


if __name__ == "__main__":
    raise SystemExit(main())
