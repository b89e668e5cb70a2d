"""Wrong scales of angle, torque and way: what is caught before anything faster, and what only a ruler tells."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from click.testing import CliRunner

from beltcomm import api
from beltcomm.axis import Axis, load_axis
from beltcomm.cli.main import cli
from beltcomm.drive import Capabilities, Drive, Limits, Motion, open_drive
from beltcomm.errors import Refused, UsageError
from beltcomm.experiments.detectability import sheet_model
from beltcomm.fit.start.first_estimate import data_sheet_model
from beltcomm.identify import final
from beltcomm.machine.machine import Machine
from beltcomm.machine.ratings import check_ratings
from beltcomm.machine.scale import OF_THE_SHEETS, STIFFNESS, _feed_constant_in_doubt, _jumping_inertia, check_first, check_fitted, ruler
from beltcomm.recording import Recording
from session.bench import Bench, Listener
from truth.hidden import draw
from truth.hidden.plant import HiddenPlant
from truth.rigs import nominal

Connect = Callable[[Bench], Bench]
AXIS = "egc-70-600"
RIG = load_axis(AXIS)
YES = api.Options(yes=True, seed=1)
DRIVE = SimpleNamespace(capabilities=SimpleNamespace(torque_step_nm=1.43e-3, counts_per_rev=65536))


class OtherUnits:
    """A machine whose shaft is shown to turn ``angle`` times as far and whose motor has ``torque`` times the torque that it should."""

    def __init__(self, angle: float = 1.0, torque: float = 1.0) -> None:
        self.plant, self.angle, self.torque = nominal("g_a"), angle, torque

    def __getattr__(self, name: str) -> Any:
        return getattr(self.plant, name)

    @property
    def position_rad(self) -> float:
        return self.angle * float(self.plant.position_rad)

    @property
    def velocity_rad_s(self) -> float:
        return self.angle * float(self.plant.velocity_rad_s)

    def step(self, torque_nm: float, duration_s: float) -> None:
        self.plant.step(self.torque * torque_nm, duration_s)


@pytest.mark.parametrize(("angle", "torque", "words"), [(1.0, 2.0, "2 times less")])
def test_a_doubled_torque_or_angle_ends_before_anything_faster(
    connect: Connect, tmp_path: Path, angle: float, torque: float, words: str
) -> None:
    """Either shows as another inertia, by the same factor: the sentence says that it cannot be told apart."""
    bench = connect(Bench(plant=OtherUnits(angle, torque)))
    with pytest.raises(Refused, match="torque over acceleration of the motor shows an inertia") as refused:
        api.identify(bench.name, AXIS, tmp_path / "run", options=YES)
    assert words in str(refused.value)
    assert "6076h" in str(refused.value)
    assert "608Fh" in str(refused.value)
    assert bench.stands_disabled()
    assert bench.parameters() == bench.initial
    made = sorted(path.stem for path in (tmp_path / "run" / "recordings").glob("*.csv"))
    assert made == ["amplitude_1"]  # the quietest record, and nothing after it
    assert np.abs(bench.plant.cart_m(0, len(bench.plant.torque_nm))).max() < 0.03


class Weakened(Bench):
    """A drive whose reported torque is a share of the torque that it was asked for, and that acts."""

    def __init__(self, share: float) -> None:
        super().__init__("g_a")
        self.share = share

    def open(self, name: str, options: Mapping[str, object] | None = None) -> Drive:
        drive = super().open(name, options)
        record = drive.record

        def weakened(motion: Motion, limits: Limits, sink: Any) -> Any:
            return record(motion, limits, lambda row: sink((row[0], self.share * row[1], *row[2:])))

        drive.record = weakened  # type: ignore[method-assign]
        return drive


def test_less_excitation_than_asked_for_is_said(connect: Connect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench, kept = connect(Weakened(0.8)), list[Machine]()

    class Kept(Machine):
        def __init__(self, *args: Any) -> None:
            super().__init__(*args)
            kept.append(self)

    def end(phase: int) -> None:
        if phase == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(api, "Machine", Kept)
    with pytest.raises(KeyboardInterrupt):
        api.identify(bench.name, AXIS, tmp_path / "run", options=YES, talk=Listener(at_phase=end))
    (words, *_) = kept[0].remarks
    assert words.startswith("amplitude_1: the drive delivered 80 % of the torque asked for")
    assert words in (tmp_path / "run" / "journal.txt").read_text(encoding="utf-8")


@pytest.mark.parametrize(("share", "turn_mm"), [(4.0, "156"), (0.25, "39")])
def test_a_feed_constant_that_is_wrong_by_two_shows_in_the_stiffness(share: float, turn_mm: str) -> None:
    """c ~ 1/k² of the feed constant; the sheet's belt at 0.25 m, seen four times as stiff, or as soft."""
    model = sheet_model(RIG)
    true = RIG.belt_stiffness_n_m(0.25)
    words = _feed_constant_in_doubt(RIG, model.with_values({STIFFNESS: share * true}), 0.25)
    assert f"with {turn_mm} mm per turn of the motor instead of 78 mm it would fit" in words
    assert _feed_constant_in_doubt(RIG, model.with_values({STIFFNESS: 0.65 * true}), 0.25) == ""  # the thesis's own belt
    assert _feed_constant_in_doubt(RIG, model.with_values({STIFFNESS: share * true}), None) == ""


def test_a_ruler_tells_the_feed_constant() -> None:
    right = ruler(RIG, 0.05, 0.0505)
    assert right.exit_code == 0
    wrong = ruler(RIG, 0.05, 0.1)
    assert wrong.exit_code == 1
    assert "pulley.effective_radius_m is 24.84 mm instead of 12.42 mm, or gearbox.ratio 0.5 instead of 1" in wrong.text[0]
    assert wrong.data["effective_radius_m"] == pytest.approx(0.02484)
    other_way = ruler(RIG, 0.05, -0.05)
    assert other_way.exit_code == 1
    assert "the other way" in other_way.text[0]
    with pytest.raises(UsageError, match="too short for a ruler"):
        ruler(RIG, 0.005, 0.005)


def test_the_ruler_on_the_command_line_moves_nothing() -> None:
    outcome = CliRunner().invoke(cli, ["move", "--drive", "virtual", "--by", "50mm", "--measured-travel", "49.2mm"])
    assert outcome.exit_code == 0
    assert "the feed constant of axis.yaml is right, within 3.0 %" in outcome.stdout


@pytest.fixture(scope="module")
def drive() -> Capabilities:
    with open_drive("virtual:g_a", {"seed": 1}) as opened:
        return opened.capabilities


def with_motor(**entries: Any) -> Axis:
    return replace(RIG, motor=replace(RIG.motor, **entries))


@pytest.mark.parametrize(
    ("axis", "told", "words"),
    [
        (
            RIG,
            {"rated_torque_nm": 1.43 * 1.06},
            r"rated torque is 1\.52 N m, axis\.yaml says 1\.43 N m: every torque would be scaled by 1\.06",
        ),
        (RIG, {"rated_current_a": 4.4}, r"rated current is 4\.4 A rms, axis\.yaml says 2\.2 A rms.*6075h"),
        (RIG, {"peak_torque_nm": 6.2}, r"largest torque is 6\.2 N m, axis\.yaml says 3\.1 N m.*6072h or 6073h"),
        (RIG, {"counts_per_rev": 131072}, "encoder resolution is 131072 counts/rev, axis.yaml says 65536"),
        (with_motor(max_speed_rad_s=600.0), {}, r"largest speed is 660 rad/s, axis\.yaml says 600 rad/s.*6080h"),
    ],
)
def test_rated_values_that_differ_by_more_than_five_percent_are_refused(
    drive: Capabilities, axis: Axis, told: dict[str, Any], words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        check_ratings(axis, replace(drive, **told))


def test_what_is_smaller_than_that_or_only_lower_is_not(drive: Capabilities) -> None:
    assert check_ratings(RIG, replace(drive, rated_torque_nm=1.43 * 1.04, peak_torque_nm=2.0)) == []
    assert check_ratings(with_motor(max_speed_rad_s=2.0 * drive.max_speed_rad_s), drive) == []
    (said,) = check_ratings(RIG, replace(drive, counts_per_rev=65000))
    assert "the drive's number is used" in said
    assert check_ratings(Axis(), drive) == []
    assert math.isclose(drive.rated_current_a, 1.43 / 0.65)


def test_a_fit_that_takes_the_carriage_for_the_motor_is_not_blamed_on_the_scaling() -> None:
    """The excitation before it showed the motor's own inertia, and scales do not change in between."""
    first = data_sheet_model(RIG, 0.25, 0.1)
    both = first["motor.inertia"] + first["cart.mass"] * RIG.transmission_m_rad**2
    t = np.arange(500) * 1e-3
    shaken = 0.5 * np.sin(40.0 * t)
    response = Recording("frf_1", t, shaken, 0.1 * shaken)
    machine: Any = SimpleNamespace(
        axis=RIG, drive=DRIVE, more_room="give a wider --window", folder=SimpleNamespace(journal=lambda _text: None)
    )
    with pytest.raises(Refused) as refused:
        check_fitted(machine, first.with_values({"motor.inertia": both}), first, response)
    words = str(refused.value)
    assert "showed 1.00 times that of axis.yaml, so torques and angles are scaled rightly" in words
    assert f"moved by {1e3 * RIG.transmission_m_rad * 0.1:.1f} mm at most" in words
    assert "20 % of the ±0.5 N m. It needs more way or more torque: give a wider --window" in words
    sheets = replace(first.parameters["motor.inertia"], origin=OF_THE_SHEETS)
    guessed = replace(first, parameters={**first.parameters, "motor.inertia": sheets})
    with pytest.raises(Refused, match=r"before it showed about that of axis\.yaml at the steps of its torque, so"):
        check_fitted(machine, first.with_values({"motor.inertia": both}), guessed, response)
    with pytest.raises(Refused, match="6076h"):  # the motor alone was too heavy before: then it is the scale
        check_fitted(machine, first.with_values({"motor.inertia": both}), first.with_values({"motor.inertia": both}), response)


def stepped(plant: Any, amplitude_nm: float, torque: float = 1.0, axis: Axis = RIG) -> Recording:
    """A binary torque on a simulated machine, held for 3 ms each; the drive believes it to be ``1/torque`` of what acts."""
    setpoint = amplitude_nm * np.repeat(np.random.default_rng(3).choice([-1.0, 1.0], 300), 3)
    shown = []
    for nm in setpoint:
        shown.append(plant.position_rad)
        plant.step(torque * nm, 1e-3)
    step_rad = math.tau / axis.motor.encoder_counts_per_rev
    return Recording("amplitude_1", np.arange(len(shown)) * 1e-3, setpoint, step_rad * np.round(np.array(shown) / step_rad))


def gapped() -> HiddenPlant:
    return HiddenPlant(draw(881001, ("backlash",), 1.0, "rig"), 0.25)


def test_steps_of_the_torque_show_the_inertia_behind_a_gap_as_well() -> None:
    share = {torque: _jumping_inertia(stepped(gapped(), 0.3, torque)) / RIG.motor_side_inertia_kg_m2 for torque in (1.0, 2.0)}
    assert share[1.0] == pytest.approx(1.0, abs=0.15)
    assert share[2.0] == pytest.approx(0.5, abs=0.08)
    assert _jumping_inertia(stepped(nominal("g_a"), 0.3)) / RIG.motor_side_inertia_kg_m2 == pytest.approx(1.0, abs=0.15)
    assert math.isnan(_jumping_inertia(stepped(nominal("g_a"), 0.3, torque=-1.0)))  # no inertia is negative


def test_an_estimate_that_a_gap_made_light_does_not_end_the_session_and_a_wrong_scale_does() -> None:
    machine: Any = SimpleNamespace(axis=RIG, drive=DRIVE, folder=SimpleNamespace(journal=lambda _text: None))
    light = data_sheet_model(RIG, 0.25, 0.1).with_values({"motor.inertia": 0.5 * RIG.motor_side_inertia_kg_m2})
    assert check_first(machine, light, stepped(gapped(), 0.3))["motor.inertia"] == RIG.motor_side_inertia_kg_m2
    with pytest.raises(Refused, match="2 times less"):
        check_first(machine, light, stepped(nominal("g_a"), 0.3, torque=2.0))


def test_an_estimate_that_a_delay_or_a_ripple_made_wrong_does_not_end_the_session_and_a_wrong_scale_does() -> None:
    """A torque that acts late makes twice the inertia, a ripple half of it; barely broken away, the steps show friction beside it."""
    machine: Any = SimpleNamespace(axis=RIG, drive=DRIVE, folder=SimpleNamespace(journal=lambda _text: None))
    stated = RIG.motor_side_inertia_kg_m2
    heavy, light = (data_sheet_model(RIG, 0.25, 0.1).with_values({"motor.inertia": share * stated}) for share in (2.0, 0.5))
    late, rippled = (HiddenPlant(draw(seed, (e,), 0.7, "rig"), 0.25) for seed, e in ((882011, "dead_time"), (882003, "tooth_ripple")))
    assert check_first(machine, heavy, stepped(late, 0.2))["motor.inertia"] == stated, "the steps show about the sheet's"
    barely = stepped(rippled, 0.17)
    assert check_first(machine, light, barely)["motor.inertia"] == stated, "the steps contradict the estimate"
    with pytest.raises(Refused, match="2 times more"):
        check_first(machine, heavy, barely)  # both show too much
    with pytest.raises(Refused, match="2 times more"):
        check_first(machine, heavy, stepped(nominal("g_a"), 0.6, torque=0.5))


class OneInertia:
    """Motor and load as one inertia with Coulomb friction, stepped finely."""

    def __init__(self, inertia_kg_m2: float, friction_nm: float) -> None:
        self.inertia, self.friction, self.position_rad, self.speed = inertia_kg_m2, friction_nm, 0.0, 0.0

    def step(self, torque_nm: float, duration_s: float) -> None:
        h = duration_s / 20
        for _ in range(20):
            if self.speed == 0.0 and abs(torque_nm) <= self.friction:
                continue
            rubbing = math.copysign(self.friction, self.speed or torque_nm)
            after = self.speed + h * (torque_nm - rubbing) / self.inertia
            self.speed = 0.0 if after * self.speed < 0.0 else after
            self.position_rad += h * self.speed


@pytest.mark.parametrize("seed", range(4))
def test_a_rigid_axis_is_checked_against_the_motor_alone_and_the_heaviest_load(seed: int) -> None:
    """What lies between is a load that nobody has stated; less than the motor, and more than any load, is a wrong scale."""
    random, axis = np.random.default_rng(seed), load_axis("torque-table")
    machine: Any = SimpleNamespace(axis=axis, drive=DRIVE, folder=SimpleNamespace(journal=lambda _text: None))
    model, alone = data_sheet_model(axis, 0.25, 0.1), axis.motor_side_inertia_kg_m2
    assert model.rigid
    inertia, friction = alone * random.uniform(1.3, 9.0), random.uniform(0.05, 0.6)
    amplitude = friction * random.uniform(1.6, 4.0)
    assert check_first(machine, model, stepped(OneInertia(inertia, friction), amplitude, axis=axis)) is model
    too_much, too_little = 2.0 * inertia / alone, 20.0 * alone / inertia  # the torque acts so many times stronger, or weaker
    with pytest.raises(Refused, match=r"less than the .* motor side alone"):
        check_first(machine, model, stepped(OneInertia(inertia, friction), amplitude, too_much, axis))
    weak = OneInertia(inertia, friction / too_little)
    with pytest.raises(Refused, match=r"more than the .* heaviest load"):
        check_first(machine, model, stepped(weak, amplitude, 1.0 / too_little, axis))


def test_a_fit_that_lacks_a_body_is_no_wrong_scale_where_the_steps_of_the_torque_show_the_inertia() -> None:
    """Of an end pulley a fit makes less inertia; a torque that is scaled wrongly shows at its steps as well."""
    remarks: list[str] = []
    folder = SimpleNamespace(journal=lambda _text: None)
    machine: Any = SimpleNamespace(
        axis=RIG, drive=DRIVE, more_room="", folder=folder, remark=remarks.append, place_m=lambda _at: None, position_m=0.0
    )
    first = data_sheet_model(RIG, 0.25, 0.1)
    light = first.with_values({"motor.inertia": 0.72 * RIG.motor_side_inertia_kg_m2})
    check_fitted(machine, light, first, stepped(nominal("g_a"), 0.3))
    (said,) = remarks
    assert "makes 0.72 times the inertia of axis.yaml" in said
    for share, torque, cause in ((0.72, 2.0, "scaled wrongly"), (0.55, 1.0, r"scaled rightly.*gap \(backlash\).*dial gauge")):
        with pytest.raises(Refused, match=f"times less.*{cause}"):
            check_fitted(
                machine,
                first.with_values({"motor.inertia": share * RIG.motor_side_inertia_kg_m2}),
                first,
                stepped(nominal("g_a"), 0.3, torque),
            )


@pytest.mark.parametrize("doubtful", [{"suspect": True, "samples": 900}, {"suspect": False, "samples": 10}], ids=["astray", "few"])
def test_a_doubtful_first_fit_is_begun_anew_from_its_records(doubtful: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """As on an axis whose coupling is twenty times as stiff as its data sheet says: the first estimate is kept near the sheet.

    Or as with 2000 counts, where from the first estimate of a light carriage ten samples counted, for seven parameters.
    """
    free = ("cart.mass", "coulomb.level")
    first = SimpleNamespace(fit=SimpleNamespace(free=free, **doubtful))
    anew = SimpleNamespace(fit=SimpleNamespace(free=free, suspect=False, samples=900))
    begun: list[str] = []

    def final_model(_records: Any, _axis: Any, _counts: int, start: Any = None) -> Any:
        begun.append("without" if start is None else "with a start")
        return anew

    monkeypatch.setattr(final, "final_model", final_model)
    assert final.from_records_alone(cast("Any", first), [], RIG, 65536) is anew
    anew.fit = SimpleNamespace(free=free, **doubtful)
    assert final.from_records_alone(cast("Any", first), [], RIG, 65536) is first
    assert begun == ["without", "without"]
    assert final.from_records_alone(
        cast("Any", SimpleNamespace(fit=SimpleNamespace(free=free, suspect=False, samples=900))), [], RIG, 65536
    )
    assert begun == ["without", "without"]
