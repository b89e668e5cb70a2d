"""Tilted axes through the virtual CAN bus: gravity torque by both ways against the truth, mass and stiffness, refusals, faults.

    python tests/benchmarks/tilted.py [found] [refused] [faults]      (some minutes; tables on stdout)

The machine is the independent simulator's; truth is its i_t m_c g sin(α), the commands see axis.yaml and frames only.
"""

from __future__ import annotations

import math
import signal
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from beltcomm import api
from beltcomm.axis import Axis, Mounting, load_axis
from beltcomm.errors import BeltcommError
from beltcomm.virtual.faults import Faults
from truth.plant import TruthPlant
from truth.rigs import nominal

START_M = 0.25
PAYLOADS_KG = {"g_a": 11.2, "g_b": 0.0}


class Watched:
    """The independent simulator's rig, which remembers its lowest and highest place, and may call back when it is fast."""

    def __init__(self, rig: str, tilt_deg: float) -> None:
        level = nominal(rig)
        self.plant = TruthPlant(replace(level.axis, tilt_rad=math.radians(tilt_deg)), truth=level.truth)
        self.now_s, self.span_m, self.fast_m_s, self.after_s, self.then = 0.0, [0.0, 0.0], math.inf, 0.0, lambda: None

    def __getattr__(self, name: str) -> Any:
        return getattr(self.plant, name)

    def brake(self, torque_nm: float) -> None:
        self.plant.brake(torque_nm)

    def step(self, torque_nm: float, duration_s: float) -> None:
        self.plant.step(torque_nm, duration_s)
        self.now_s += duration_s
        self.span_m = [min(self.span_m[0], self.plant.cart_position_m), max(self.span_m[1], self.plant.cart_position_m)]
        if self.now_s > self.after_s and abs(self.plant.velocity_rad_s) * self.plant.axis.transmission_m_rad > self.fast_m_s:
            self.fast_m_s = math.inf
            self.then()


def case(
    rig: str, tilt_deg: float, stated_deg: float | None = None, payload_kg: float | None = None, brake: bool = True
) -> tuple[Watched, Axis]:
    """A rig at a tilt, and the axis file as its owner wrote it."""
    base = load_axis("egc-70-600-25deg")
    motor = base.motor if brake else replace(base.motor, brake_torque_nm=None)
    payload = replace(base.payload, mass_kg=PAYLOADS_KG[rig] if payload_kg is None else payload_kg)
    axis = replace(base, motor=motor, payload=payload, mounting=Mounting(tilt_deg if stated_deg is None else stated_deg))
    return Watched(rig, tilt_deg), axis


def run(rig: str, plant: Watched, axis: Axis, command: Any = api.identify, **options: Any) -> Any:
    """A command on a virtual drive with this plant behind it."""
    shipped = {"g_a": "g_a_25deg", "g_b": "g_b_vertical"}[rig]
    with tempfile.TemporaryDirectory() as folder:
        place = options.pop("position_m", None)
        given = api.Options(yes=True, position_m=place, drive={"plant": plant, "start_position": START_M, **options})
        return command(f"virtual:{shipped}", axis, Path(folder) / "run", options=given)


def found() -> None:
    print("rig  tilt |  truth mN m | (a) below  above (band ±) | (b) breakaway    creep     fit | mass %      stiffness %   (± 95 %)")
    for rig, tilt in (("g_b", 30.0), ("g_b", 60.0), ("g_b", 90.0), ("g_a", 10.0), ("g_a", 25.0)):
        plant, axis = case(rig, tilt)
        truth = plant.plant.axis.transmission_m_rad * plant.truth["mass_kg"] * 9.80665 * math.sin(math.radians(tilt))
        data = run(rig, plant, axis).to_json()
        way, p = data["gravity"], data["model"]["parameters"]
        errors = []
        for name, real in (("cart.mass", plant.truth["mass_kg"]), ("belt_stiffness.stiffness", plant.truth["stiffness_n_m"])):
            errors.append(f"{100 * (p[name]['value'] / real - 1):+.2f} ± {100 * p[name]['interval'] / real:.2f}")
        a = " ".join(f"{1e3 * s['torque_nm']:7.1f}" for s in way["integrators"])
        band = 1e3 * (way["integrators"][0]["high_nm"] - way["integrators"][0]["torque_nm"]) if way["integrators"] else 0.0
        b = " ".join(f"{1e3 * w['torque_nm']:7.1f} ± {1e3 * w['interval_nm']:.1f}" for w in (way["breakaway"], way["creep"]))
        fit = f"{1e3 * p['constant_offset.torque']['value']:.1f} ± {1e3 * p['constant_offset.torque']['interval']:.1f}"
        print(f"{rig} {tilt:5.0f} | {1e3 * truth:8.1f} | {a} ({band:.0f}) | {b} {fit} | {'  '.join(errors)}", flush=True)


def refused() -> None:
    for rig, tilts in (("g_a", (30.0, 33.0, 36.0, 40.0, 60.0)), ("g_b", (90.0,))):
        for tilt in tilts:
            plant, axis = case(rig, tilt)
            try:
                run(rig, plant, axis)
                print(f"{rig} {tilt:g} deg: identified")
            except BeltcommError as problem:
                print(f"{rig} {tilt:g} deg: {type(problem).__name__}: {problem}")
            print(f"      moved {1e3 * plant.span_m[0]:+.2f} to {1e3 * plant.span_m[1]:+.2f} mm", flush=True)


def faults() -> None:
    """What goes wrong, how it ends, and how far the carriage went; then 1 s more, in which it must stand."""
    cases: list[tuple[str, str, Watched, Axis, dict[str, Any]]] = []
    for name, arguments, options in (
        ("tilt stated 15 for 25 deg", {"stated_deg": 15.0}, {}),
        ("tilt stated 35 for 25 deg", {"stated_deg": 35.0}, {}),
        ("tilt stated with the wrong sign", {"stated_deg": -25.0}, {}),
        ("payload stated 5 for 11.2 kg", {"payload_kg": 5.0}, {}),
        ("payload stated 16 for 11.2 kg", {"payload_kg": 16.0}, {}),
        ("encoder counts the other way", {}, {"faults": Faults(encoder_sign=-1), "referenced": False, "position_m": START_M}),
        ("emergency that cuts the stage off, 12 s", {}, {"faults": Faults(emergency_at_s=22.0)}),
        ("cable pulled at 24 s", {}, {"faults": Faults(silent_from_s=24.0)}),
        ("cable pulled at 45 s", {}, {"faults": Faults(silent_from_s=45.0)}),
        ("level by axis.yaml, tilted 25 deg", {"stated_deg": 0.0}, {}),
        ("no brake stated, but there is one", {"brake": False}, {}),
    ):
        plant, axis = case("g_a", 25.0, **arguments)
        cases.append((name, "g_a", plant, axis, options))
    for rig, tilt, fast_m_s, after_s in (
        ("g_a", 25.0, 0.02, 0.0),
        ("g_a", 25.0, 0.05, 20.0),
        ("g_a", 25.0, 0.05, 48.0),
        ("g_b", 90.0, 0.1, 0.0),
    ):
        plant, axis = case(rig, tilt)
        plant.fast_m_s, plant.after_s, plant.then = fast_m_s, after_s, lambda: signal.raise_signal(signal.SIGINT)
        cases.append((f"Ctrl-C above {fast_m_s:g} m/s, {after_s:g} s", rig, plant, axis, {}))
    for name, rig, plant, axis, options in cases:
        try:
            run(rig, plant, axis, **options)
            end = "identified"
        except (BeltcommError, KeyboardInterrupt) as problem:
            end = f"{type(problem).__name__}: {str(problem)[:230]}"
        low, high = plant.span_m
        at = plant.cart_position_m
        for _ in range(1000 if plant.now_s else 0):  # a drive that was never switched on has not closed its brake here
            plant.step(0.0, 1e-3)
        held = abs(plant.cart_position_m - at)
        print(
            f"{rig} {name}: {1e3 * low:+.2f} to {1e3 * high:+.2f} mm, then {1e6 * held:.0f} um in 1 s without torque\n      {end}",
            flush=True,
        )


if __name__ == "__main__":
    for word in sys.argv[1:] or ["found", "refused", "faults"]:
        {"found": found, "refused": refused, "faults": faults}[word]()
