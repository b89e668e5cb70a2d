"""A drive that does not know where its carriage stands: a record at that place, inside the window that the operator states."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from beltcomm import api
from beltcomm.cli.main import cli
from beltcomm.configfiles import read_yaml
from beltcomm.errors import Refused, UsageError
from beltcomm.experiments import commission
from beltcomm.identify.final import FinalModel, final_model
from beltcomm.rundata import offline
from beltcomm.runfolder import RunFolder
from beltcomm.virtual.faults import Faults
from session.bench import Bench, Listener
from session.test_bad_drive import AXIS, YES, MakeBench, fails

LOW_M, HIGH_M = -0.02, 0.03


@dataclass
class Here:
    """An identification of rig g_b inside a window, and what was seen of it.   final : its fit."""

    bench: Bench
    path: Path
    result: api.Result
    talk: Listener
    final: FinalModel


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Here]:
    bench, talk = Bench("g_b", start_m=0.31, referenced=False), Listener()
    path = tmp_path_factory.mktemp("here") / "run"
    fits: list[FinalModel] = []

    def fit(*args: Any, **kwargs: Any) -> FinalModel:
        fits.append(final_model(*args, **kwargs))
        return fits[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(api, "open_drive", bench.open)
        patch.setattr(commission, "final_model", fit)
        result = api.identify(bench.name, AXIS, path, options=replace(YES, window_m=(LOW_M, HIGH_M)), talk=talk)
    yield Here(bench, path, result, talk, fits[-1])
    bench.close()


def test_the_carriage_never_leaves_the_window(here: Here) -> None:
    places = here.bench.plant.cart_m(0, len(here.bench.plant.torque_nm))
    assert LOW_M < places.min() < -3e-3
    assert 2e-3 < places.max() < HIGH_M
    assert here.bench.stands_disabled()
    assert here.bench.parameters() == here.bench.initial


def test_the_plan_states_the_window(here: Here) -> None:
    assert "-20 ... +30 mm from where it stands" in here.talk.said[0]
    plan = here.talk.said[1]
    assert "between -20 mm and +30 mm of where it stands now" in plan
    ways = [line for line in plan.splitlines() if " mm " in line and " m/s " in line]
    assert len(ways) == 3
    for line in ways:  # title, travel, with stop, ...: in mm
        travel, reach = (float(words.split()[-1]) for words in line.split(" mm")[:2])
        assert travel <= reach <= 30.0


def test_no_recording_claims_to_know_its_place(here: Here) -> None:
    folder = RunFolder.open(here.path)
    assert {"amplitude_1", "frf_1"} <= set(folder.finished_names())
    for name in folder.finished_names():
        note = read_yaml(here.path / "recordings" / f"{name}.yaml")
        assert note["start_position_m"] is None
        assert folder.recording(name).sidecar.start_position_m is None


def test_what_one_place_can_tell_is_right(here: Here) -> None:
    """Mass, stiffness at this place, inertia: within 3 % and twice their intervals; the stiffness is no law along the travel."""
    found, truth = here.result.data["model"]["parameters"], here.bench.plant.truth
    assert here.result.exit_code == 0
    for name, true in (("cart.mass", "mass_kg"), ("belt_stiffness.stiffness", "stiffness_n_m"), ("motor.inertia", "inertia_kg_m2")):
        assert found[name]["value"] == pytest.approx(truth[true], rel=0.03)
        assert abs(found[name]["value"] - truth[true]) < 2.0 * found[name]["interval"]


def test_it_says_what_is_not_possible_and_how_to_get_there(here: Here) -> None:
    text = "\n".join([*here.result.lines(), *here.result.details])
    for words in ("the stiffness holds for that place alone", "Not possible", "friction sweep", "--position METRES", "--home"):
        assert words in text


def test_fit_and_design_cope_with_it_and_what_needs_a_reference_says_so(here: Here, monkeypatch: pytest.MonkeyPatch) -> None:
    """The fit says what it holds for, the design too, in its file as well; what moves along the travel is refused."""
    monkeypatch.setattr(offline, "final_model", lambda *_args, **_kwargs: here.final)  # of the same records
    fitted = CliRunner().invoke(cli, ["fit", str(here.path), "--details"])
    assert fitted.exit_code == 0
    assert "the stiffness holds for that place alone" in fitted.stdout
    designed = CliRunner().invoke(cli, ["design", str(here.path), "--details"])
    assert designed.exit_code == 0
    assert "proven for the belt stiffness of that place alone" in designed.stdout
    saved = RunFolder.open(here.path).load("designs", "final")
    assert any("of that place alone" in remark for remark in saved["remarks"])
    monkeypatch.setattr(api, "open_drive", here.bench.open)
    moved = len(here.bench.plant.torque_nm)
    for verb in (api.friction, api.verify):
        with pytest.raises(Refused, match=r"does not know where the carriage stands; give --position METRES, or --home"):
            verb(here.bench.name, here.path, options=YES)
    assert not here.bench.plant.torque_nm[moved:].any()
    # who writes such gains is told
    outcome = CliRunner().invoke(cli, ["apply", "--drive", here.bench.name, "--run", str(here.path), "--dry-run"])
    assert outcome.exit_code == 0
    assert "proven for the belt stiffness of that place alone" in outcome.stderr


@pytest.mark.examination
def test_commission_without_any_reference(make_bench: MakeBench, tmp_path: Path) -> None:
    """Refused with every way out; inside a window it records here, and does not call that success; a known place has no window."""
    bench = make_bench(referenced=False)
    with pytest.raises(Refused, match=r"--position METRES, or --home .* --window LOW\.\.HIGH"):
        api.commission(bench.name, AXIS, tmp_path / "run", options=YES)
    stuck = make_bench(referenced=False, faults=Faults(stuck_from_s=0.0))
    with pytest.raises(Refused, match="does not move"):
        api.commission(stuck.name, AXIS, tmp_path / "here", options=replace(YES, window_m=(LOW_M, HIGH_M)))
    known = make_bench()
    with pytest.raises(UsageError, match=r"the place is known .* `beltcomm identify --window`"):
        api.commission(known.name, AXIS, tmp_path / "known", options=replace(YES, window_m=(LOW_M, HIGH_M)))
    for each in (bench, known):
        assert each.plant.cart_position_m == 0.0


def test_without_a_window_the_operator_is_asked_for_one(make_bench: MakeBench, tmp_path: Path) -> None:
    """First whether the carriage is free, then whether it may move; a no to either moves nothing."""
    bench, talk = make_bench(referenced=False), Listener(answer=False)
    words = fails(Refused, bench, tmp_path / "no", options=api.Options(seed=1), talk=talk)
    assert "--window LOW..HIGH" in words
    assert talk.asked == ["The drive does not know where the carriage stands. Is it free to move by 35 mm to either side from here?"]
    assert bench.plant.cart_position_m == 0.0

    bench, talk = make_bench(referenced=False, faults=Faults(stuck_from_s=0.0)), Listener(answer=True)
    fails(Refused, bench, tmp_path / "yes", options=api.Options(seed=1), talk=talk)  # it does not move
    assert talk.asked[1:] == ["May the axis move like this?"]
    assert "-35 ... +35 mm from where it stands" in talk.said[0]


@pytest.mark.parametrize(
    ("window_m", "kind", "words"),
    [
        ((-0.3, 0.3), UsageError, "the window of 600 mm is longer than the travel of 580 mm"),
        ((-0.003, 0.03), UsageError, "within 4 mm of an end of its window; give a wider --window"),
        ((-0.0065, 0.03), Refused, "mm of window are left beside the 5 mm kept to the end; give a wider --window"),
        ((-0.012, 0.012), Refused, "the limit on travel if the computer dies allows only .* give a wider --window"),
    ],
)
def test_a_window_that_cannot_be(
    make_bench: MakeBench, tmp_path: Path, window_m: tuple[float, float], kind: type[UsageError | Refused], words: str
) -> None:
    bench = make_bench(referenced=False)
    with pytest.raises(kind, match=words):
        api.identify(bench.name, AXIS, tmp_path / "run", options=replace(YES, window_m=window_m))
    places = bench.plant.cart_m(0, len(bench.plant.torque_nm) + 1)
    assert window_m[0] < places.min()
    assert places.max() < window_m[1]
    assert bench.parameters() == bench.initial


def test_a_window_holds_for_a_referenced_axis_too(make_bench: MakeBench, tmp_path: Path) -> None:
    bench = make_bench(start_m=0.555)  # 15 mm before the end of the travel: what is stated wider does not count
    with pytest.raises(Refused, match=r"the limit on travel .*allows only .* give a wider --window or move the carriage further in"):
        api.identify(bench.name, AXIS, tmp_path / "run", options=replace(YES, window_m=(-0.011, 0.1)))
