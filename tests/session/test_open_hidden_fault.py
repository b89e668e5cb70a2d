"""A hidden fault on the page, with clicks alone: where the model fails, what explains it, adding it, a slider; numbers as in JSON."""

from __future__ import annotations

import base64
import json
import os
import time
from collections.abc import Iterator

import numpy as np
import pytest
from click.testing import CliRunner

from beltcomm import api
from beltcomm.cli.main import cli
from beltcomm.errors import UsageError
from beltcomm.model import load_plant
from beltcomm.simulate.plant import SimulatedPlant
from session.browser import BROWSER, DRIVER, MISSING, Browser, browser_on

pytestmark = [pytest.mark.examination, pytest.mark.skipif(not (BROWSER and DRIVER), reason=MISSING)]
PLACE_M = 0.3


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """A run of an axis with a tight spot, measured over the virtual bus; nothing that follows knows of it."""
    run = tmp_path_factory.mktemp("hidden") / "run"
    machine = load_plant("g_b").model.with_effect("friction_position", {"amount": 0.05, "place": PLACE_M, "width": 0.06})
    options = api.Options(yes=True, seed=1, drive={"plant": SimulatedPlant(machine, 0.25), "start_position": 0.25})
    api.identify("virtual:g_b", "egc-70-600", run, options=options)
    api.friction("virtual:g_b", run, options=options)
    api.design(run)
    with browser_on(run, tmp_path_factory.mktemp("profile")) as opened:
        yield opened


def ratios(browser: Browser) -> dict[str, str]:
    """Error over noise of every record, as the page has it."""
    rows = browser.driver.find_elements("css selector", "#records tbody tr")
    return {row.get_attribute("data-record"): row.find_elements("css selector", "td")[3].text for row in rows}


def told(browser: Browser) -> dict[str, float]:
    """The same from the command line."""
    found = json.loads(CliRunner().invoke(cli, ["compare", str(browser.folder.path), "--no-pictures", "--json"]).stdout)
    return {one["name"]: one["ratio"] for one in found["records"]}


def test_one_sees_where_it_fails(browser: Browser) -> None:
    """The numbers are those of ``compare --json``, and a place stands out that a click marks."""
    browser.until("the records are read", lambda: browser.says("document.body.dataset.version"))
    assert ratios(browser) == {name: f"{ratio:.2f}" for name, ratio in told(browser).items()}
    button = browser.driver.find_element("css selector", "#places button[data-along=position]")
    button.click()
    browser.until("the place is marked", lambda: "position" in browser.text("explain-title"))
    assert browser.value("low") < PLACE_M < browser.value("high")
    assert "times the noise there" in browser.text("explain-words")
    browser.until("all is weighed", lambda: "still weighing" not in browser.text("candidates"))
    first = browser.driver.find_element("css selector", "#candidates .card.first")
    assert first.get_attribute("data-effect") == "friction_position"
    assert int(first.text.partition("explains ")[2].partition(" %")[0]) > 80
    assert first.find_elements("css selector", "canvas"), "its law is drawn"
    browser.picture("marked")
    assert browser.complaints() == []


def test_another_choice_is_answered_at_once(browser: Browser) -> None:
    """Along any coordinate, by keyboard; what is no range is refused in a sentence."""
    for along in ("time", "speed", "angle", "torque", "frequency"):
        browser.says(f"document.querySelector('#along option[value={along}]').selected = true")
        browser.type("low", 0.0)
        browser.type("high", 5.0)
        browser.driver.find_element("css selector", "#choose button").click()
        browser.until(
            f"{along} is marked",
            lambda along=along: {"angle": "motor angle", "torque": "motor torque"}.get(along, along) in browser.text("explain-title"),
        )
    browser.type("low", 9.0)
    browser.driver.find_element("css selector", "#choose button").click()
    browser.until("the refusal is said", lambda: "must be numbers, the first not above the second" in browser.text("explain-words"))
    browser.at("clear").click()
    browser.until("everything again", lambda: browser.text("explain-title") == "What could explain what is left?")


def test_a_record_is_a_choice(browser: Browser) -> None:
    """A click marks it and draws it beside its model, as far apart as the table says; a band is told by what lies in it."""
    button = next(one for one in browser.driver.find_elements("css selector", "#records button") if one.text == "frf_1")
    button.click()
    browser.until("the record is marked", lambda: browser.text("explain-title").endswith("in frf_1?"))
    assert [browser.at(name).get_attribute("value") for name in ("within", "record-name")] == ["frf_1", "frf_1"]
    browser.until("it is drawn", lambda: browser.text("record-words").startswith(ratios(browser)["frf_1"]))
    assert browser.says("[...document.querySelectorAll('#record-charts canvas')].map((one) => one.width > 100)") == [True] * 3
    browser.picture("record")
    browser.at("clear").click()
    browser.until("everything again", lambda: browser.at("within").get_attribute("value") == "")
    tab = browser.page.laboratory
    found = tab.residual()
    told_of = {name: tab.record({"record": name}) for name in found["names"]}
    for one in found["records"]:
        measured, model = (np.frombuffer(base64.b64decode(told_of[one["name"]][key]), "<f4") for key in ("measured", "model"))
        assert np.nanmean(measured * model) / np.nanmean(model**2) == pytest.approx(1.0, abs=0.1), one["name"]
    edges, spectrum = found["edges"], found["spectrum"]
    for k in (10, 30):
        band = tab.segment({"along": "frequency", "low": edges[k], "high": edges[k + 4]})
        assert band["ratio"] == pytest.approx(np.sqrt(np.mean(np.square(spectrum[k : k + 4]))), rel=0.02)
    with pytest.raises(UsageError, match="there is no record 'frf_77'"):
        tab.record({"record": "frf_77"})


def test_a_click_adds_it_and_the_error_falls(browser: Browser) -> None:
    before, version = ratios(browser), browser.says("document.body.dataset.version")
    browser.driver.find_element("css selector", ".card[data-effect=friction_position] .main-action").click()
    browser.until("something is said to run", lambda: "adding friction_position" in browser.text("doing"))
    browser.picture("adding")
    browser.until("it is added", lambda: browser.says("document.body.dataset.version") != version)
    after = told(browser)
    assert ratios(browser) == {name: f"{before[name]} → {ratio:.2f}" for name, ratio in after.items()}
    assert all(ratio < 1.1 for ratio in after.values())
    assert "friction_position" in browser.folder.load("models", "final")["effects"]
    stairs = [step.text.splitlines()[0] for step in browser.driver.find_elements("css selector", "#stairs li")]
    assert stairs == [f"{rung['ratio']:.2f}" for rung in browser.folder.load("results", "ladder")["revisions"]]
    browser.until("the run is judged anew", lambda: browser.text("headline").startswith("NOT PROVEN"))
    assert browser.text("headline").endswith("the design is of an earlier model")
    browser.picture("added")


def test_a_slider_changes_the_design(browser: Browser) -> None:
    browser.tab("design")
    browser.settled()
    before = browser.text("changes")
    browser.type("box-suppression_db", browser.value("box-suppression_db") - 3.0)
    browser.settled()
    assert browser.text("changes") != before
    assert browser.complaints() == []


def test_a_run_that_changes_under_the_page_is_read_anew(browser: Browser) -> None:
    """By another program, which takes the effect out; and by a second page on the same run, which adds it."""
    browser.tab("laboratory")
    browser.until("nothing runs", lambda: not browser.text("doing"))
    version = browser.says("document.body.dataset.version")
    api.remove("friction_position", browser.folder.path, pictures=False)
    browser.until("it is read anew", lambda: browser.says("document.body.dataset.version") != version)
    assert ratios(browser) == {name: f"{ratio:.2f}" for name, ratio in told(browser).items()}
    assert browser.text("failed") == ""
    os.utime(browser.folder.file("models", "final"), (time.time() + 5.0,) * 2)
    version = browser.says("document.body.dataset.version")
    browser.until("a touched file is looked at", lambda: browser.says("document.body.dataset.version") != version)


def test_a_virtual_session_is_watched_and_its_run_opened(browser: Browser) -> None:
    """On the machine that is the model of this run: phase, carriage and load while it lasts, its answer, and a link that opens it."""
    browser.tab("live")
    browser.until("something is offered", lambda: browser.text("session-drive"))
    for name, value in (("session-kind", "identify"), ("session-drive", "model")):
        browser.says(f"document.querySelector('#{name} option[value={value}]').selected = true")
    browser.at("session-realtime").click()
    browser.at("session-start").click()
    browser.until("a phase is shown", lambda: "excitation in place" in browser.text("phase-words"))
    browser.until("the load is shown", lambda: " of 3.1 N m" in browser.text("value-torque"))
    assert not browser.at("session-start").is_enabled()
    browser.until("a response builds up", lambda: "periods so far" in browser.text("live-charts"))
    browser.picture("live")
    browser.at("session-stop").click()
    browser.until("it has ended", lambda: browser.at("session-end").is_displayed())
    assert "The session was stopped" in browser.text("session-end")
    browser.at("session-realtime").click()
    browser.at("session-start").click()
    browser.until("the next one has its answer", lambda: "MEASURED" in browser.text("session-lines"))
    name = browser.says("document.querySelector('#session-open a').textContent.split(' ')[1]")
    browser.says("document.querySelector('#session-open a').click()")  # it is drawn anew every half second
    browser.until("it is the run of the page", lambda: browser.text("run").endswith(name))
    browser.tab("runs")
    browser.until("it stands among the runs", lambda: browser.driver.find_elements("css selector", f"#beside tr.own[data-run='{name}']"))
    browser.until("its response is drawn", lambda: browser.says("document.querySelectorAll('#overlay canvas').length"))
    assert browser.complaints() == []
