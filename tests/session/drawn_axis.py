"""A belt axis drawn at random, commissioned whole on the independent plant, and what came of it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import yaml

from beltcomm import api
from beltcomm.configfiles import find_config
from beltcomm.errors import BeltcommError
from session.bench import Bench
from truth import TruthPlant
from truth.drawn_axes import DrawnAxis, draw_axis

NAMES = {"cart.mass": "mass_kg", "motor.inertia": "inertia_kg_m2"}


def in_its_middle(drawn: DrawnAxis, folder: Path) -> tuple[Path, Bench]:
    """axis.yaml of a drawn axis, and its drive, the carriage in the middle of the travel."""
    file, plant, start = folder / "axis.yaml", folder / "plant.yaml", 0.5 * drawn.travel_m
    file.write_text(yaml.safe_dump(drawn.sheet), encoding="utf-8")
    shown = yaml.safe_load(find_config("plants", "g_a").read_text(encoding="utf-8"))  # the drive's zero; the machine is the truth
    shown["parameters"]["transmission.ratio"]["value"], shown["drive"] = drawn.axis.transmission_m_rad, drawn.drive
    plant.write_text(yaml.safe_dump(shown), encoding="utf-8")
    return file, Bench(name=f"virtual:{plant}", plant=TruthPlant(drawn.axis, start_position_m=start), start_m=start)


def commissioned(seed: int, folder: Path, highest_hz: float) -> dict[str, Any]:
    """What came of one axis.

    It is right when it is judged by its move, with a model that is trusted and within two of its intervals of the truth, the belt never
    carried more than its limit and the guide's friction, and the carriage stayed on its travel.
    """
    drawn = draw_axis(seed, highest_hz)
    file, bench = in_its_middle(drawn, folder)
    start = 0.5 * drawn.travel_m
    row: dict[str, Any] = {"seed": seed, "resonance_hz": round(drawn.resonance_hz), "counts": drawn.drive["counts_per_rev"]}
    began = time.process_time()
    try:
        with patch.object(api, "open_drive", bench.open):
            result = api.commission(bench.name, str(file), folder / "run", options=api.Options(yes=True, seed=1))
        row |= {"exit": result.exit_code, "said": result.text[1].strip()}
        found = result.data["model"]["parameters"]
        for name, true in NAMES.items():
            value, half, truth = found[name]["value"], found[name]["interval"], getattr(drawn.axis, true)
            row[name] = (
                round(value / truth - 1.0, 5),
                round((value - truth) / half, 2) if half else None,
            )
    except BeltcommError as problem:
        row |= {"exit": problem.exit_code, "said": f"{type(problem).__name__}: {problem}"}
    finally:
        bench.close()
    friction = drawn.axis.coulomb_cart_n
    force, places = bench.plant.belt_force_n, start + bench.plant.cart_m(0, len(bench.plant.torque_nm))
    row |= {"belt": round(float(np.abs(force).max(initial=0.0))), "bears": round(drawn.sheet["limits"]["feed_force_n"] + friction)}
    row |= {"inside": bool(len(places) == 0 or (places.min() >= 0.0 and places.max() <= drawn.travel_m))}
    row |= {"machine_s": round(bench.now_s), "cpu_s": round(time.process_time() - began)}
    told = [row[name][1] for name in NAMES if name in row]
    row["right"] = (
        len(told) == len(NAMES)
        and all(off is not None and abs(off) < 2.0 for off in told)
        and "NOT TRUSTED" not in row["said"]
        and row["belt"] <= row["bears"]
        and row["inside"]
    )
    return row
