"""Writes the run folder of a hidden machine, and the answer beside it:  FOLDER and FOLDER.answer.yaml.

    python -m truth.hidden.write SEED EFFECT[+EFFECT...] STRENGTH FOLDER [--family rig] [--plan default] [--instruments]

with ``tests`` on the path (PYTHONPATH=tests).  EFFECT is ``healthy``, a name of the catalogue or one from outside it.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from truth.hidden.draw import ALL, draw
from truth.hidden.families import FAMILIES
from truth.hidden.folder import write_session
from truth.hidden.machines import Machine
from truth.hidden.session import PLANS
from truth.hidden.visibility import visibility


def answer(machine: Machine, plan: str) -> dict[str, Any]:
    """What is hidden in a machine, and for each effect alone whether the motor can see it in a plan."""
    base, instruments = machine.base, machine.instruments
    alone = {name: draw(machine.seed, (name,), machine.strength, base.family, instruments=instruments) for name in machine.effects}
    return {
        "seed": machine.seed,
        "effects": list(machine.effects),
        "strength": machine.strength,
        "hidden": {name: dict(values) for name, values in machine.hidden.items()},
        "visible": {name: asdict(visibility(single, plan)) for name, single in alone.items()},
        "base": asdict(machine.base),
        "instruments": machine.instruments.describe(),
    }


def plain(value: Any) -> Any:
    """The value without numpy types, for YAML."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("seed", type=int)
    parser.add_argument("effects", help=f"healthy, or of {', '.join(ALL)}; several with +")
    parser.add_argument("strength", type=float)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--family", choices=FAMILIES, default="sheet")
    parser.add_argument("--plan", choices=PLANS, default="thorough")
    parser.add_argument("--instruments", action="store_true", help="draw drive, readings, encoder and clock, too")
    args = parser.parse_args()
    names = () if args.effects == "healthy" else tuple(args.effects.split("+"))
    machine = draw(args.seed, names, args.strength, args.family, drawn_instruments=args.instruments)
    write_session(machine, args.folder, args.plan)
    answered = yaml.safe_dump(plain(answer(machine, args.plan)), sort_keys=False)
    args.folder.with_name(f"{args.folder.name}.answer.yaml").write_text(answered, encoding="utf-8")


if __name__ == "__main__":
    main()
