"""The commands on a drive that is reached over RS-232 only: what it can do works, what it cannot is refused before anything moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from beltcomm.drive import open_drive
from beltcomm.errors import Refused
from beltcomm.experiments import own_strokes
from beltcomm.runfolder import RunFolder
from session.conftest import Complete
from session.test_commands import call, json_of

SERIAL = ("--drive", "serial:virtual", "--seed", "1")
Copy = Callable[..., Path]


@pytest.mark.parametrize(
    ("verb", "rest"),
    [("commission", ()), ("commission", ("--dry-run",)), ("identify", ()), ("identify", ("--window", "20mm"))],
)
def test_what_needs_torque_in_step_is_refused_with_the_reason(tmp_path: Path, verb: str, rest: tuple[str, ...]) -> None:
    outcome = call(verb, *SERIAL, "--yes", "--run", tmp_path / "run", *rest)
    assert outcome.exit_code == 1
    assert "RS-232 carries at most 13 setpoints a second at 9600 bit/s and 160 at 115200" in outcome.stderr
    assert "can0" in outcome.stderr
    assert "nothing was moved" in outcome.stderr
    assert not (tmp_path / "run").exists()


def test_a_move_is_not_verified_over_it(copy_of_complete: Copy) -> None:
    outcome = call("verify", *SERIAL, "--yes", "--run", copy_of_complete())
    assert outcome.exit_code == 1
    assert "To follow a path, connect the drive's CAN port" in outcome.stderr


def test_friction_of_a_run_that_was_made_over_can(copy_of_complete: Copy, complete: Complete) -> None:
    """The same drive at its other port: strokes of its own, polled; the plant's friction comes out as over CAN."""
    run = copy_of_complete("sweep*")
    planned = json_of(call("friction", *SERIAL, "--dry-run", "--run", run, "--json"))
    assert "when the cable is pulled it ends the one it has" in planned["plan"]["text"]
    data = json_of(call("friction", *SERIAL, "--yes", "--run", run, "--json"))
    truth = complete.bench.plant.truth
    assert data["friction"]["coulomb"]["value"] == pytest.approx(truth["coulomb_total_nm"], rel=0.05)
    assert data["friction"]["viscous"]["value"] == pytest.approx(truth["viscous_nm_s_rad"], rel=0.05)
    recording = RunFolder.open(run).recording("sweep")
    assert recording.sample_period_s == pytest.approx(0.014, abs=0.004)
    assert recording.sidecar.closed_loop
    assert float(np.ptp(recording.t_s)) < planned["seconds"]
    orders = call("friction", *SERIAL, "--order", "I", "--dry-run", "--run", run)
    assert orders.exit_code == 1
    assert "too seldom for the short plateaus of the orders" in orders.stderr


def test_gains_are_applied_and_rolled_back_over_it(copy_of_complete: Copy) -> None:
    run = copy_of_complete()
    wanted = RunFolder.open(run).load("designs", "final")["parameters"]
    outcome = call("apply", *SERIAL, "--yes", "--save", "--run", run)
    assert outcome.exit_code == 0, outcome.output
    assert "read back, and saved" in outcome.stdout
    assert wanted
    assert call("rollback", *SERIAL, "--yes", "--run", run).exit_code == 0
    stranger = call("apply", *SERIAL, "--profile", "cmmp-as", "--yes", "--run", run)
    assert stranger.exit_code == 2
    assert "was made on another drive" in stranger.stderr


def test_a_short_move_is_a_stroke_of_the_drive(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a loop that can move the axis it arrives; with the factory's, which cannot, the command says so and stops."""
    from beltcomm import api

    weak = call("move", *SERIAL, "--yes", "--by", "5mm")
    assert weak.exit_code == 4
    assert "its gains are too weak" in weak.stderr or "the gains in the drive are too weak" in weak.stderr
    assert "Nothing guards a drive over RS-232" in weak.stderr

    def tuned(name: str, options: Any) -> Any:
        drive = open_drive(name, options)
        drive.write({"kp_nm_s_rad": 0.05, "ki_nm_rad": 0.5, "kpp_1_s": 10.0})
        return drive

    monkeypatch.setattr(api, "open_drive", tuned)
    data = json_of(call("move", *SERIAL, "--yes", "--by", "-12mm", "--json"))
    assert data["moved_m"] == pytest.approx(-0.012, abs=5e-4)


@dataclass
class Slow:
    """A stand-in for a machine: a drive that makes its strokes by itself with this K_PP, 1/s."""

    kpp: float
    feedforward: bool = False

    @property
    def drive(self) -> Any:
        structure = SimpleNamespace(velocity_feedforward=self.feedforward)
        capabilities = SimpleNamespace(kinds={"profile"}, structure=structure)
        return SimpleNamespace(capabilities=capabilities, backup=lambda: {"kpp_1_s": self.kpp})


def test_strokes_that_lag_are_given_time_or_refused() -> None:
    """A first-order lag  1 - e^(-K_PP t)  has reached 98.2 % after four time constants."""
    settle_s = own_strokes.settle_s(Slow(2.0))  # type: ignore[arg-type]
    assert 1.0 - np.exp(-2.0 * settle_s) == pytest.approx(0.982, abs=1e-3)
    assert own_strokes.note(Slow(2.0)) == {"run_in_s": 0.2 + settle_s}  # type: ignore[arg-type]
    assert own_strokes.settle_s(Slow(0.1, feedforward=True)) == 0.0  # type: ignore[arg-type]
    assert own_strokes.note(Slow(0.1, feedforward=True)) == {}  # type: ignore[arg-type]
    with pytest.raises(Refused, match=r"Kv = 0.9 1/s.*CAN port"):
        own_strokes.settle_s(Slow(0.9))  # type: ignore[arg-type]
