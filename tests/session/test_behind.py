"""What was recorded after the model was fitted: the next command takes it in, or says what is still to be done."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from beltcomm import api
from beltcomm.model import load_model
from beltcomm.rundata.headline import behind, headline_of, next_command
from beltcomm.rundata.revisions import CURRENT, RECORDS, new_revision, unfitted
from beltcomm.runfolder import RunFolder

Copy = Callable[..., Path]


def before_its_sweep(run: Path) -> RunFolder:
    """The run as if its sweep had been made after the fit: not noted there, and a friction that no sweep was asked for."""
    folder = RunFolder.open(run)
    fit: dict[str, Any] = folder.load("results", "fit")
    folder.save("results", "fit", {**fit, RECORDS: [name for name in fit[RECORDS] if not name.startswith("sweep")]})
    model = load_model(folder.file("models", CURRENT))
    folder.save("models", CURRENT, model.with_values({"coulomb.level": 0.5 * model["coulomb.level"]}).to_dict())
    return RunFolder.open(run)


def test_a_commissioned_run_is_not_behind(copy_of_complete: Copy) -> None:
    folder = RunFolder.open(copy_of_complete())
    assert unfitted(folder) == []
    assert behind(folder) == []


def test_the_next_step_says_that_the_model_does_not_know_all_records(copy_of_complete: Copy) -> None:
    """Where the page shows an error of those records, "gains with margins" alone reads like gains of the model as it is."""
    folder = before_its_sweep(copy_of_complete())
    step = next_command(folder, headline_of(folder), "virtual")
    assert step.command.startswith("beltcomm design ")
    assert step.why == "gains with margins, by a model of all records"
    for result in (folder.path / "results").glob("verify_*"):
        result.unlink()
    assert f"; its model is of before {', '.join(unfitted(folder))}" in headline_of(folder).sentence


@pytest.mark.examination
def test_a_design_takes_in_what_was_recorded_since(copy_of_complete: Copy) -> None:
    run = copy_of_complete()
    wanted = RunFolder.open(run).load("designs", "final")["parameters"]
    folder = before_its_sweep(run)
    names = unfitted(folder)
    assert names
    assert all(name.startswith("sweep") for name in names)
    assert [line for line in behind(folder) if f"was not fitted to {', '.join(names)}" in line]
    assert [line for line in behind(folder) if "from an earlier model" in line]
    found = api.design(run)
    assert f"the model was fitted anew, for {', '.join(names)} was recorded since" in "\n".join([*found.text, *found.details])
    for name, value in wanted.items():
        gain = name.startswith("k")  # the search for those ends within some percent; what the sweep tells is in the feedforward
        assert found.data["parameters"][name] == pytest.approx(value, rel=0.05 if gain else 1e-3), name
    assert behind(RunFolder.open(run)) == []


def test_a_revision_is_kept_and_that_is_said(copy_of_complete: Copy) -> None:
    run = copy_of_complete()
    folder = RunFolder.open(run)
    model = load_model(folder.file("models", CURRENT))
    new_revision(folder, model, "base", ratio=1.0, held_out=None, confirmed=None, command="x", when="y")
    (sweep,) = [name for name in folder.finished_names() if name == "sweep"]
    for kind in ("csv", "yaml"):
        (folder.recordings_folder / f"later.{kind}").write_bytes((folder.recordings_folder / f"{sweep}.{kind}").read_bytes())
    found = api.design(run)
    assert "later was recorded since the model's last revision" in "\n".join([*found.text, *found.details])
