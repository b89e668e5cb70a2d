"""Forty-four cases of the fault campaign, two of each kind (tests/benchmarks/fault_campaign.py runs them by the hundred), and its judge."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltcomm.drive import Guarding
from beltcomm.machine.hardware import Hardware
from beltcomm.runfolder import RunFolder
from beltcomm.virtual.nmt import Nmt
from beltcomm_adapters.canopen import CanopenDrive
from beltcomm_adapters.sdo import Lending
from campaign import sharing
from campaign.cases import FIRST_REWRITTEN, KINDS, Case, Healthy, healthy_run, make_case
from campaign.judge import TELLS_VIRTUAL, lay_out, run_case, words_of
from campaign.killed import damages, killed_folder
from campaign.rig import Rig
from marks import quick
from session.conftest import Complete

MakeCase = Callable[..., Case]


@pytest.fixture(scope="module")
def make(complete: Complete, tmp_path_factory: pytest.TempPathFactory) -> Iterator[MakeCase]:
    """Cases on the run that all these tests share; each command runs healthily once."""
    known: dict[tuple[str, str], Healthy] = {}

    def healthy(command: str, profile: str) -> Healthy:
        if (command, profile) not in known:
            run = tmp_path_factory.mktemp("healthy") / "run"
            lay_out(command, complete.path, run)
            rig = Rig(profile)
            found, outcome = healthy_run(rig, words_of(command, run), run)
            rig.close()
            assert found.code == 0, outcome.text
            known[command, profile] = found
        return known[command, profile]

    with sharing.shared():
        yield lambda seed, **chosen: make_case(seed, healthy, **chosen)


# a host that dies, or cannot write, closes no files
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("seed", quick([*range(22), FIRST_REWRITTEN, *range(22, 44), *range(FIRST_REWRITTEN + 1, FIRST_REWRITTEN + 4)], 5))
def test_a_fault_is_survived(make: MakeCase, complete: Complete, seed: int) -> None:
    """At rest, settings back, records readable, right exit code, true sentence, inside the travel; the short commands only."""
    kind = list(KINDS)[seed % len(KINDS)]
    other = seed >= len(KINDS) and seed < FIRST_REWRITTEN and "move" in KINDS[kind][1]  # the second of a kind on the other drive
    chosen: dict[str, Any] = {"commands": ("move",), "profiles": ("cmmp-as",)} if other else {"commands": SHORT, "profiles": ("reference",)}
    if kind == "feed constant doubled":  # of a run that knows the drive's units; a first record has nothing to compare with
        chosen["commands"] = ("verify",)
    verdict = run_case(make(seed, **chosen), complete.path, gains=1.0)
    assert verdict.failures == (), f"{verdict.case}\n{verdict.text}"


SHORT = ("move", "verify", "apply", "rollback")


def test_an_instant_falls_into_every_phase(make: MakeCase) -> None:
    """1000 draws over a command with the stage on for 2 of 10 ticks: half of them there, not a fifth."""
    powered = [False] * 8 + [True] * 2
    healthy = Healthy(0, np.zeros(10), np.zeros(10), powered, 1, 1, 1, 0.01)
    draw = np.random.default_rng(0)
    instants = np.array([healthy.instant_s(draw) for _ in range(1000)])
    assert 400 < (instants >= 0.008).sum() < 600
    assert instants.max() < 0.010


# -- the judge sees what is wrong ------------------------------------------------------------------------------------------------


def failures_of(case: Case) -> str:
    return "; ".join(run_case(case, None).failures)


def test_the_judge_sees_settings_that_are_not_restored(make: MakeCase, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Lending, "give_back", lambda _self: [])
    assert "not restored" in failures_of(make(0, kind="EMCY", commands=("move",), profiles=("reference",)))


def test_the_judge_sees_an_error_that_nobody_thought_of(make: MakeCase, monkeypatch: pytest.MonkeyPatch) -> None:
    def breaks(_self: object, *_rest: object) -> None:
        raise RuntimeError("nobody thought of this")

    monkeypatch.setattr("beltcomm_adapters.exchange.Exchange.start", breaks)
    said = failures_of(make(0, kind="frames late", commands=("move",), profiles=("reference",)))
    assert "an error that nobody thought of" in said


def test_the_judge_sees_an_axis_that_outlives_its_host(make: MakeCase, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without guarding in the drive the torque stays, the stage too, and the carriage runs against its buffers.

    The host refuses such a drive, for it proves the guarding first: here it is made to believe.
    """
    monkeypatch.setattr(Nmt, "heard", lambda _self, _node: None)
    monkeypatch.setattr(CanopenDrive, "prove_guarding", lambda _self, limits, _rest=0.0: Guarding(limits.guard_s, limits.guard_s, True))
    case = next(
        found
        for seed in range(400)
        if 0.3 < (found := make(seed, kind="host killed", commands=("move",), profiles=("reference",))).at_s < 0.45
    )
    said = failures_of(case)
    assert "the stage is on in the end" in said


def refused_transfer(place: tuple[int, int]) -> Case:
    """A creep on the reference drive in which the first transfer of an object is refused."""
    rig = Rig("reference")
    rig.open("virtual").close()
    number = 1 + rig.examiner.asked.index(place)
    rig.close()
    return Case(0, "SDO abort", "reference", "move", f"{place} refused", 0.0, {"sdo_abort": {number: 0x06020000}})


def test_a_drive_that_does_not_say_that_it_is_virtual_is_asked_for_its_first_motion() -> None:
    assert failures_of(refused_transfer(TELLS_VIRTUAL)) == ""


def test_the_judge_sees_a_first_motion_asked_for_without_need(monkeypatch: pytest.MonkeyPatch) -> None:
    """The software version is refused, the drive does say that it is virtual."""
    monkeypatch.setattr(Hardware, "virtual", False)
    assert failures_of(refused_transfer((0x100A, 0))) == "the sentence does not name the cause"


def test_the_judge_sees_a_motion_that_is_denied(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("campaign.judge.UNMOVED_M", -1.0)  # as if the carriage had moved
    assert failures_of(refused_transfer(TELLS_VIRTUAL)) == "the sentence says that nothing was moved, and it was"


# -- a real SIGKILL: the files ---------------------------------------------------------------------------------------------------


def test_a_killed_process_leaves_records_that_can_be_read_and_gone_on_with(tmp_path: Path) -> None:
    assert killed_folder(3, tmp_path) == []  # killed 1.0 s after its first record began
    folder = RunFolder.open(tmp_path / "killed-3")
    assert folder.unfinished() == ["amplitude_1"]
    (part,) = folder.recordings_folder.glob("*.part")
    rows = part.read_text(encoding="utf-8").splitlines()
    part.write_text("\n".join([rows[0], rows[1][:10], *rows[2:]]), encoding="utf-8")
    assert damages(folder.path) == ["amplitude_1.csv.part is torn inside"]  # it would be seen
