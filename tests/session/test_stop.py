"""Quick stops on the truth: the way that was counted with, and the force in the belt."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltcomm import api
from beltcomm.axis import load_axis
from beltcomm.control import Cascade, CascadeStructure
from beltcomm.errors import BeltcommError, Refused
from beltcomm.experiments import proving, verification
from beltcomm.experiments.stops_out_of_move import STOP_SWING, StopsOutOfMove, worst_stops
from beltcomm.experiments.verification import BELT_SWING
from beltcomm.machine.machine import Machine
from beltcomm.model import Model
from beltcomm.rundata import analyse
from beltcomm.rundata.store import design_to_dict, structure_from_dict
from beltcomm.runfolder import RunFolder
from beltcomm.virtual.loops import Loops
from identify.records import true_model
from marks import quick
from session.bench import Bench, Listener, way_counted_with
from session.drawn_stops import out_of_acceleration
from truth.rigs import RIGS, nominal

MakeBench = Callable[..., Bench]
Copy = Callable[..., Path]
Connect = Callable[[Bench], Bench]
YES = api.Options(yes=True, seed=1)
LIMIT_N = load_axis("egc-70-600").limits.feed_force_n or 0.0
#: m, m/s²: where the standard move of either rig is fastest, speeds up and slows down hardest, and how hard that is at least.
MOMENTS = {"fastest": (0.25, 0.0), "speeding up": (0.02, 3.5), "slowing down": (0.45, 3.5)}
#: s over which an acceleration is a mean.
OVER_S = 0.02


def run_of(rig: str, complete: Path) -> Path:
    """The complete run of rig g_a, or the same as if it had been made on g_b: with its true model and a design for that."""
    if rig == "g_b":
        folder, model = RunFolder.open(complete), true_model(nominal(rig))
        folder.save("models", "final", model.to_dict())
        folder.save("designs", "final", designed(model, structure_from_dict(folder.load("results", "drive"))))
    return complete


def designed(model: Model, structure: CascadeStructure, known: dict[str, dict[str, Any]] = {}) -> dict[str, Any]:  # noqa: B006
    """A design for a model known exactly; calculated once."""
    if model.name not in known:
        apparent, masses = 0.03, (model["cart.mass"],)
        result, cascade = analyse.design(
            model, structure, positions_m=(0.25,), masses_kg=masses, dead_time_s=1e-3, apparent_damping_nm_s_rad=apparent
        )
        known[model.name] = design_to_dict(result, cascade, 1e-3, apparent)
    return known[model.name]


def stopped_in_the_move(bench: Bench, run: Path, at_m: float) -> tuple[int, float]:
    """Ctrl-C in the verification move at a place; returns the tick and the speed there."""
    bench.interrupt_when(lambda _frame: bench.carriage_m > at_m)
    with pytest.raises(KeyboardInterrupt):
        api.verify(bench.name, run, options=YES)
    assert bench.signals == 1
    assert bench.stands_disabled()
    assert bench.parameters() == bench.initial
    places = bench.plant.cart_m(0, len(bench.plant.torque_nm))
    return bench.signal_tick, float(places[bench.signal_tick] - places[bench.signal_tick - 1]) / 1e-3


@pytest.mark.parametrize("moment", MOMENTS)
@pytest.mark.parametrize("rig", quick(RIGS, 1))
def test_a_stop_out_of_the_fastest_move_keeps_to_the_belts_limit(
    make_bench: MakeBench, copy_of_complete: Copy, rig: str, moment: str
) -> None:
    """Out of every moment, full acceleration too: the feed force, which was told beforehand, and what a move may swing beyond it."""
    run, bench = run_of(rig, copy_of_complete()), make_bench(rig, start_m=0.0, name="virtual:g_a")
    at_m, least = MOMENTS[moment]
    tick, speed = stopped_in_the_move(bench, run, at_m)
    force = bench.plant.belt_force_n
    before = tick - round(OVER_S / 1e-3)
    way = np.diff(bench.plant.cart_m(before - 1, tick - before + 2))
    acceleration = float(way[-1] - way[0]) / 1e-3 / OVER_S
    assert abs(acceleration) >= least
    pulled_n = RIGS[rig].mass_kg * abs(acceleration)
    assert pulled_n - 20.0 < abs(force[tick]) < pulled_n + 10.0
    (told,) = re.findall(r"a stop brakes .* (\d+) N in the belt", (run / "journal.txt").read_text(encoding="utf-8"))[-1:]
    places = bench.start_m + bench.plant.cart_m(0, len(bench.plant.torque_nm))
    braking = tick + int(np.argmax(np.diff(places[tick:])))
    assert float(told) <= LIMIT_N
    (foretold,) = re.findall(r"a stop out of the move: (\d+) N", (run / "journal.txt").read_text(encoding="utf-8"))[-1:]
    assert np.abs(force[braking:]).max() < float(foretold) + 0.5
    true = true_model(nominal(rig))  # a data sheet's feed force leaves friction of the guide out, as the limit of a move does
    assert float(foretold) <= STOP_SWING * (LIMIT_N + true["cart_friction.level"]) + 0.5
    if moment == "fastest":
        assert np.abs(force[braking:]).max() > 0.5 * float(told)
        assert speed == pytest.approx(1.30, abs=0.07)  # slower where a lost host would load the belt harder
    assert places.max() <= 0.57
    assert places.max() - places[tick] <= way_counted_with(run, speed, acceleration)


def test_the_drives_own_quick_stop_would_be_too_hard(
    make_bench: MakeBench, copy_of_complete: Copy, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the test above would show if nothing were lent: 200 rev/s², 15.6 m/s², are 210 N on 13.4 kg before the belt swings."""
    monkeypatch.setattr(Machine, "brake_with", lambda machine, braking: vars(machine).update(braking=braking, deceleration_m_s2=np.inf))
    for module in (verification, proving):  # which would slow the move down, or refuse it
        monkeypatch.setattr(module, "worst_stops", lambda *_: StopsOutOfMove())
    run, bench = copy_of_complete(), make_bench("g_a", start_m=0.0)
    tick, _ = stopped_in_the_move(bench, run, MOMENTS["fastest"][0])
    assert np.abs(bench.plant.belt_force_n[tick:]).max() > 2.0 * LIMIT_N


def test_a_stop_is_planned_for_gains_at_the_ends_of_their_intervals(
    make_bench: MakeBench, copy_of_complete: Copy, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Steps tell a drive's gains to some per cent; 103 N were in a belt where 100 N were said by gains that were 10 % too small."""
    found: dict[str, Any] = {}

    def of_all(machine: Machine, model: Model, running: Cascade, *given: Any, **more: Any) -> StopsOutOfMove:
        at = [(one, other) for one in (0.9, 1.1) for other in (0.9, 1.1)]
        others = [
            replace(running, kp_nm_s_rad=one * running.kp_nm_s_rad, ki_nm_rad=one * running.ki_nm_rad, kpp_1_s=other * running.kpp_1_s)
            for one, other in at
        ]
        found["alone"] = worst_stops(machine, model, running, *given, **more)
        found["ends"] = [worst_stops(machine, model, other, *given, **more) for other in others]
        unit = {"unit": 1.0, "interval": 0.1, "assumed": 1.0, "object": "2010h:1"}
        measured = {"kind": "x", "rated_torque_nm": 1.4, "rated_current_a": 2.2, "units": {"kp_nm_s_rad": unit, "kpp_1_s": unit}}
        machine.folder.save("results", "calibration", measured)
        found["known"] = worst_stops(machine, model, running, *given, **more)
        raise Refused("that is enough")

    monkeypatch.setattr(verification, "worst_stops", of_all)
    run, bench = copy_of_complete(), make_bench("g_a", start_m=0.0)
    with pytest.raises(Refused, match="enough"):
        api.verify(bench.name, run, options=YES)
    for kind in ("asked_for", "host_lost"):
        alone, known, *ends = (getattr(one, kind).belt_force_n for one in (found["alone"], found["known"], *found["ends"]))
        assert known > alone + 0.1, "gains that are not exact make a harder stop possible"
        assert known > max(ends) - 0.5, "the journal's numbers are whole"


def test_a_drive_that_only_reports_its_following_error_pulls_harder_at_a_lost_host(
    make_bench: MakeBench, copy_of_complete: Copy, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its position loop pulls until the guard time is over: a third more force on this axis, and nothing else changes."""
    found: list[StopsOutOfMove] = []

    def of_both(machine: Machine, *given: Any, **more: Any) -> StopsOutOfMove:
        for stops in (True, False):
            machine.drive.capabilities = replace(machine.drive.capabilities, following_error_stops=stops)
            found.append(worst_stops(machine, *given, **more))
        raise Refused("that is enough")

    monkeypatch.setattr(verification, "worst_stops", of_both)
    run, bench = copy_of_complete(), make_bench("g_a", start_m=0.0)
    with pytest.raises(Refused, match="enough"):
        api.verify(bench.name, run, options=YES)
    stops, reports = found
    assert reports.host_lost.belt_force_n > 1.3 * stops.host_lost.belt_force_n
    assert (reports.asked_for, reports.completed) == (stops.asked_for, stops.completed)


def test_a_move_that_cannot_be_stopped_within_the_travel_is_refused(make_bench: MakeBench, copy_of_complete: Copy, tmp_path: Path) -> None:
    """It ends 5 mm before the end of the travel and brakes as hard as the axis may: harder than a stop."""
    run, bench = copy_of_complete(), make_bench(start_m=0.265)
    t = np.linspace(0.0, 0.62, 621)
    x = 0.265 + 0.3 * (t / 0.62 - np.sin(2.0 * np.pi * t / 0.62) / (2.0 * np.pi))  # up to 4.9 m/s²
    own = tmp_path / "own.csv"
    own.write_text("t_s,position_m\n" + "\n".join(f"{a:.6f},{b:.9f}" for a, b in zip(t, x, strict=True)), encoding="utf-8")
    with pytest.raises(Refused, match=r"a stop with [\d.]+ m/s², which the belt bears, would end at 0.\d+ m, the travel is -0.01..0.57 m"):
        api.verify(bench.name, run, move=own, options=YES)
    assert bench.plant.cart_position_m == 0.0


def smooth(rig: str, share: float) -> Bench:
    """A rig with little of its Coulomb friction."""
    return Bench(rig, plant=replace(RIGS[rig], coulomb_total_nm=share * RIGS[rig].coulomb_total_nm).plant())


def test_an_open_loop_record_is_stopped_on_the_way_that_was_told(connect: Connect, tmp_path: Path) -> None:
    """3 % of the friction: coasting takes several times as long, with the factory's gains twice; the lent loop brakes as was told."""
    rig, speed = "g_b", 0.05
    bench = connect(smooth(rig, 0.03))
    run = tmp_path / "run"
    part, talk = run / "recordings" / "amplitude_2.csv.part", Listener()
    # the carriage's speed, not that of the motor, which rings
    bench.interrupt_when(lambda _frame: part.exists() and abs(bench.plant.speeds[1]) > speed)
    with pytest.raises(KeyboardInterrupt):
        api.identify(bench.name, "egc-70-600", run, options=YES, talk=talk)
    assert bench.signals == 1
    assert bench.stands_disabled()
    assert bench.parameters() == bench.initial
    places = bench.plant.cart_m(0, len(bench.plant.torque_nm))
    tick = bench.signal_tick
    way = float(np.abs(places[tick:] - places[tick]).max())
    told = re.findall(r"stopping distance at most ([\d.]+) mm", "\n".join(talk.said))
    assert way <= 1e-3 * float(told[-1])
    truth = RIGS[rig].truth()
    inertia = truth["inertia_kg_m2"] + 0.01242**2 * truth["mass_kg"]
    coasting = speed**2 * inertia / (2.0 * 0.01242 * 0.03 * truth["coulomb_total_nm"])
    assert way < 0.25 * coasting


def test_a_carriage_that_coasts_is_noticed(connect: Connect, tmp_path: Path) -> None:
    """Next to no friction and the factory's gains: the first creep does not come to rest where it was counted to."""
    bench = connect(smooth("g_a", 0.003))
    with pytest.raises(BeltcommError, match=r"does not stand still|hardly brake it"):
        api.identify(bench.name, "egc-70-600", tmp_path / "run", options=YES)
    assert bench.parameters() == bench.initial


@pytest.mark.parametrize("seed", quick(range(12), 4))
def test_a_stop_out_of_acceleration_keeps_to_what_was_planned_on_drawn_axes(seed: int) -> None:
    case, force, told = out_of_acceleration(seed)
    assert told <= LIMIT_N
    assert force <= BELT_SWING * case.bears_n


def test_a_drive_that_leads_the_end_of_an_acceleration_in_its_stop_would_load_the_belt_too_much(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same where the lead of the feedforward takes the stop for a change of acceleration: one period of reversed torque."""
    monkeypatch.setattr(Loops, "begin_ramp", lambda _loops, _speed: None)
    assert any(force > BELT_SWING * case.bears_n for case, force, _ in map(out_of_acceleration, range(12)))
