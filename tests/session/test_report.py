"""The page on a run: holds everything it shows, names where each figure comes from, and says what is missing and how to get it."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
import shutil
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import pytest

from beltcomm import api
from beltcomm.configfiles import read_yaml, to_yaml
from beltcomm.errors import DataError, UsageError
from beltcomm.laboratory import diagnosis
from beltcomm.laboratory.diagnosis import fit_base_of
from beltcomm.pages import at_the_end
from beltcomm.quantities import mm
from beltcomm.rundata.fitted_run import records_of
from beltcomm.rundata.headline import headline_of
from beltcomm.rundata.kept import FILE, fit_base
from beltcomm.rundata.revisions import current_model
from beltcomm.runfolder import RunFolder
from session.conftest import Complete

#: What the page may weigh, bytes.
LARGEST = 5_000_000


class Seen(HTMLParser):
    """Text by tag, addresses that are asked for, and tags that were not closed."""

    VOID = ("meta", "br", "link", "path", "use", "image", "img", "rect", "circle", "line", "clipPath")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text: dict[str, list[str]] = {}
        self.asked: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.asked += [value or "" for name, value in attrs if name in ("src", "href", "xlink:href", "data")]
        if tag not in self.VOID:
            self.open.append(tag)
            self.text.setdefault(tag, []).append("")

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open:
            self.text[self.open[-1]][-1] += data


@pytest.fixture(scope="module")
def page(complete: Complete, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The report of a run against one that had a softer belt."""
    before = tmp_path_factory.mktemp("before") / "last_year"
    shutil.copytree(complete.path, before)
    model = read_yaml(before / "models" / "final.yaml", DataError)
    model["parameters"]["belt_stiffness.stiffness"]["value"] *= 0.88
    (before / "models" / "final.yaml").write_text(to_yaml(model), encoding="utf-8")
    api.report(complete.path, against=before)
    return (complete.path / "report.html").read_text(encoding="utf-8")


def test_it_needs_nothing_from_outside(page: str, complete: Complete) -> None:
    assert len(page.encode()) < LARGEST
    seen = Seen(page)
    assert not seen.open
    assert all(address.startswith(("#", "data:image/png;base64,")) for address in seen.asked)
    scripts = re.findall(r"<script([^>]*)>(.*?)</script>", page, re.DOTALL)
    (run,) = [text for attributes, text in scripts if not attributes]
    assert {attributes.split(" id=")[0] for attributes, text in scripts if text is not run} == {' type="application/json"'}
    assert f"script-src 'sha256-{base64.b64encode(hashlib.sha256(run.encode()).digest()).decode()}'" in page
    assert "default-src 'none'" in page
    assert not re.search(r"url\((?!#)|@import", page)
    assert str(complete.path) not in page


def test_every_figure_names_its_command_and_data(page: str) -> None:
    captions = Seen(page).text["figcaption"]
    assert len(captions) == page.count("<figure>") == 13
    for caption in captions:
        assert re.match(r"beltcomm \w+ .* · data: (run/|last_year and run: )", caption)


def test_what_stands_on_a_map_keeps_its_ink_where_the_page_is_dark(page: str) -> None:
    (figure,) = [part for part in page.split("<figure>") if "By speed and direction" in part]
    cells = re.findall(r"<text ([^>]*)>(?:\d\.\d|[+-]\d+|[^<]*resonance [\d.]+ Hz\s*)</text>", figure)
    inked = [cell for cell in cells if "fill: #010101" in cell]
    assert len(inked) > 10, "error and mean of each cell, and the landmarks"
    assert not [cell for cell in cells if "#000000" in cell]


def test_a_number_of_the_screen_is_found_on_the_page(page: str, complete: Complete) -> None:
    assert "worst of all, as on the screen" in page
    numbers = json.loads((complete.path / "report.json").read_text(encoding="utf-8"))
    (model,) = [part for part in page.split("<section") if part.startswith(' id="model">')]
    for doubt in numbers["data_sheet"]:
        assert f"{doubt['factor']:.2f}</td>" in model


def test_the_first_screen_has_the_numbers_of_the_run(page: str, complete: Complete) -> None:
    numbers = json.loads((complete.path / "report.json").read_text(encoding="utf-8"), parse_constant=lambda word: pytest.fail(word))
    verdict = complete.result.to_json()["verdict"]
    headline = headline_of(RunFolder.open(complete.path))
    assert headline.good
    assert numbers["verdict"] == headline.text
    assert numbers["headline"] == complete.result.to_json()["headline"]
    assert numbers["verdict"] in re.sub("<[^>]*>", "", page)
    told = [line.strip() for line in (complete.path / "verdict.txt").read_text(encoding="utf-8").splitlines() if line.startswith("   ! ")]
    assert told
    assert [f"! {line}" for line in numbers["warnings"]] == told, "below the headline as on the terminal"
    head = page.split('<div class="facts">')[0]
    assert [html.unescape(line) for line in re.findall(r"<li>(! .*)</li>", head)] == told
    tracking, model, margin = numbers["facts"]
    assert tracking["value"] == mm(verdict["measured"]["dynamic_m"])
    assert f"is within {tracking['value']} (motor)" in numbers["verdict"], "one number has one unit"
    assert "µm" not in page
    assert model["value"] == f"{numbers['ratio']['overall']:.2f} × noise"
    screen = "\n".join(complete.result.lines())
    assert f"its error is {numbers['ratio']['overall']:.2f} x the noise" in screen, "one number, there too"
    assert 40.0 < float(margin["value"].rstrip("°")) < 60.0
    assert any("beltcomm open" in step for step in numbers["next"])
    assert numbers["sections"] == [
        "changes", "diagnosed", "tracking", "gains", "model", "model-error", "cost", "responses", "friction", "loops", "safety", "journal",
    ]  # fmt: skip


@pytest.mark.examination
def test_a_fit_that_was_kept_is_the_one_that_was_found(
    page: str, copy_of_complete: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = copy_of_complete(name="again")
    folder = RunFolder.open(run)
    records, model = records_of(folder).recordings, current_model(folder)
    assert page
    assert model is not None
    assert run.joinpath(*FILE).is_file()
    _, data, again = fit_base(folder, records, model)
    for name, value in model.parameters.items():
        assert again.model[name] == pytest.approx(value.value, rel=1e-9), "that of the commissioning"
    fresh_data, fresh = fit_base_of(records, folder.axis, model)
    assert len(again.residual) == len(fresh.residual)
    assert again.objective == pytest.approx(fresh.objective, abs=1.0), "a search that begins there gains less than a nat"
    assert [p.rounding for p in data.fitted] == [p.rounding for p in fresh_data.fitted]
    sidecar = run / "recordings" / "frf_1.yaml"
    sidecar.write_text(sidecar.read_text(encoding="utf-8").replace("held_out: false", "held_out: true"), encoding="utf-8")
    monkeypatch.setattr(diagnosis, "fit_base_of", lambda *_: pytest.fail("searched anew"))
    with pytest.raises(pytest.fail.Exception, match="searched anew"):
        fit_base(folder, records, model)


def test_what_changed_since_another_run_stands_on_the_first_screen(page: str, complete: Complete) -> None:
    numbers = json.loads((complete.path / "report.json").read_text(encoding="utf-8"))
    changed = {c["now"]["key"]: c for c in numbers["against"]["changes"]}
    assert numbers["against"]["run"] == "last_year"
    assert changed["belt_stiffness.stiffness"]["share"] == pytest.approx(1.0 / 0.88 - 1.0)
    assert {key for key, change in changed.items() if change["state"] == "changed"} == {"belt_stiffness.stiffness"}
    assert re.search(r"belt stiffer by 13\.\d+ ± 0\.\d+ %", page[: page.index("What to do next")])
    with pytest.raises(UsageError, match="with itself"):
        api.report(complete.path, against=complete.path)


def test_a_page_that_cannot_be_made_costs_no_commissioning_its_verdict(tmp_path: Path) -> None:
    ended = at_the_end(tmp_path / "nothing")
    assert ended.page is None
    assert "there is no report" in ended.line
    assert "does not exist" in ended.line


def test_gains_stand_beside_the_numbers_of_the_drive(page: str, complete: Complete) -> None:
    designed = complete.folder.load("designs", "final")["parameters"]
    row = next(line for line in page.split("<tr>") if "velocity gain Kp" in line)
    cells = re.findall(r"<td[^>]*>(.*?)</td>", row)
    assert float(cells[2]) == pytest.approx(designed["kp_nm_s_rad"], rel=1e-5)
    assert cells[4] == "2100h:1"
    assert float(cells[-1]) == pytest.approx(designed["kp_nm_s_rad"], rel=1e-6)


@pytest.mark.examination
def test_what_is_missing_names_the_command_that_makes_it(copy_of_complete: Callable[..., Path]) -> None:
    run = copy_of_complete("frf_2", "frf_3", "sweep_2", "moves_1", name="bare")
    for kind in ("models", "designs", "results"):
        for file in (run / kind).glob("*.yaml"):
            file.unlink()
    numbers = api.report(run).to_json()
    text = (run / "report.html").read_text(encoding="utf-8")
    assert numbers["state"] == "note"
    assert any("beltcomm fit bare" in step for step in numbers["next"])
    for command in ("verify", "design", "fit"):
        assert f"beltcomm {command}" in text


@pytest.mark.examination
def test_a_folder_that_cannot_be_written_shows_its_result_all_the_same(
    copy_of_complete: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """And says that it was not kept; only the page itself is what ``report`` was asked for."""
    from beltcomm.jobs import laboratory
    from beltcomm.pages import job, page_file

    run = copy_of_complete()

    def full(*_: object) -> None:
        raise UsageError("the folder cannot be written: read-only")

    monkeypatch.setattr(laboratory.RunFolder, "save", full)
    assert any(line.startswith("Not kept: ") for line in laboratory._unkept(RunFolder.open(run), {}))
    monkeypatch.setattr(page_file, "write_text", full)
    found = job.report(run)
    assert found.exit_code == 2
    assert found.data["page"] is None
    assert found.text[-1].startswith("There is no page: the folder cannot be written")
