"""The design tab in a real browser, on a copy of the complete run: sliders, presets, refusals, saving, and how long a change takes."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

from beltcomm.rundata.headline import headline_of
from beltcomm.rundata.proof import doubts
from session.browser import BROWSER, DRIVER, MISSING, Browser, browser_on

pytestmark = pytest.mark.skipif(not (BROWSER and DRIVER), reason=MISSING)
KNOB = "phase_margin_deg"


@pytest.fixture(scope="module")
def browser(complete: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """One browser for all tests of this file.   The run keeps three recordings: what else a proof looks at is not this page's matter."""
    run = tmp_path_factory.mktemp("tuned") / "run"
    shutil.copytree(complete.path, run)
    for file in (run / "recordings").iterdir():
        if file.name.partition(".")[0] not in ("frf_1", "move_1"):
            file.unlink()
    with browser_on(run, tmp_path_factory.mktemp("profile")) as opened:
        opened.tab("design")
        yield opened


def test_page_opens_at_the_present_design(browser: Browser) -> None:
    browser.settled()
    browser.picture("begin")
    assert browser.text("summary") == "Nothing changed against the present design."
    assert browser.value(KNOB) == pytest.approx(
        min(m["phase_margin_deg"] for m in browser.folder.load("designs", "final")["margins"]), abs=0.5
    )
    browser.until("the run's first sentence", lambda: browser.text("headline"))
    assert browser.text("headline") == " ".join(headline_of(browser.folder).text.split())
    noted = browser.folder.load("results", headline_of(browser.folder).move)["noted"]
    assert f"! {noted[-1]}" in browser.text("warnings").splitlines(), "as the verdict has it"
    drawn = browser.says("[...document.querySelectorAll('#design canvas')].map((one) => one.width > 100 && one.height > 100)")
    assert drawn == [True] * 5
    assert browser.complaints() == []
    loaded = browser.says("performance.getEntriesByType('resource').map((one) => one.name)")
    assert all(one.startswith((browser.address, "data:")) for one in loaded), loaded


def test_a_slider_by_keyboard_moves_the_curves(browser: Browser) -> None:
    """The page shows the gains that the same knobs have in Python."""
    from selenium.webdriver.common.keys import Keys

    browser.settled()
    before, name = browser.value("suppression_db"), "suppression_db"
    browser.at(name).send_keys(Keys.ARROW_LEFT * 30)
    browser.settled()
    assert browser.value(name) == pytest.approx(before - 3.0)
    assert browser.value(f"box-{name}") == browser.value(name)
    told = browser.text("summary").partition("open loop at the resonance ")[2].split(" ")
    own = max(margin["suppression_db"] for margin in browser.folder.load("designs", "final")["margins"])
    assert own - 0.1 < before <= own, "on a step of the slider, on the safe side"
    assert float(told[0]) == pytest.approx(own, abs=0.0501), "the design's own number, to three digits"
    setting = replace(browser.page.design.present().bench.start(0.0, browser.value("position") / 1e3), suppression_db=browser.value(name))
    found = browser.page.design.present().bench.design(setting)
    cascade, suppressed = found.cascade, max(margin.suppression_db for margin in found.margins)
    assert float(told[2]) == pytest.approx(suppressed, abs=0.0501), "what the gains make of the knob"
    assert suppressed <= before - 3.0 + 1e-6, "at least what was asked"
    shown = {row.split(" ")[2]: float(row.split(" ")[4]) for row in browser.text("changes").splitlines() if " gain K" in row}
    assert shown["Kv"] == pytest.approx(cascade.kpp_1_s, rel=0.01)
    assert shown["Ki"] == pytest.approx(cascade.ki_nm_rad, rel=0.01)
    spent = browser.says("timings")
    print(f"ms from event to drawing: curves {spent['update']}, predicted error {spent['track']}")  # noqa: T201


def test_what_is_not_possible_is_said_and_shown(browser: Browser) -> None:
    browser.type("box-suppression_db", -3.0)
    browser.settled()
    assert browser.at("refusal").is_displayed()
    assert "no integral time leaves the velocity loop" in browser.text("refusal")
    assert not browser.at("save").is_enabled()
    browser.picture("impossible")
    low, high = (
        float(number) for number in browser.text("range-suppression_db").removeprefix("possible: ").removesuffix(" dB").split(" to ")
    )
    assert f"the suppression at most {high:.1f} dB" in browser.text("refusal")
    track, piece = browser.at("track-suppression_db"), browser.driver.find_element("css selector", "#track-suppression_db i")
    assert piece.size["width"] / track.size["width"] == pytest.approx((high - low) / 39.0, abs=0.03)
    browser.type("box-suppression_db", high - 0.5)
    browser.settled()
    assert not browser.at("refusal").is_displayed()
    assert browser.at("save").is_enabled()


def test_presets_set_the_sliders(browser: Browser) -> None:
    browser.until("presets are computed", lambda: browser.says("document.body.dataset.presets"))
    browser.picture("presets")
    bandwidths = []
    for pace in ("robust", "balanced", "fast"):
        browser.at(f"preset-long-{pace}").click()
        browser.settled()
        assert not browser.at("refusal").is_displayed()
        bandwidths.append(
            next(float(row.split(" ")[5]) for row in browser.text("changes").splitlines() if row.startswith("position bandwidth at rest"))
        )
    assert bandwidths == sorted(set(bandwidths))
    assert browser.at("preset-stiff-robust").text == "not possible"
    assert browser.complaints() == []


def test_page_fits_a_narrow_window_in_the_dark(browser: Browser) -> None:
    """Nothing sticks out sideways; colours follow the system's."""
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": "dark"}]})
    browser.driver.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", {"width": 390, "height": 800, "deviceScaleFactor": 1, "mobile": False}
    )
    inside = "return [document.documentElement.scrollWidth, innerWidth, getComputedStyle(document.body).backgroundColor]"
    width, window, paper = browser.until("the page is narrow", lambda: (found := browser.driver.execute_script(inside))[1] == 390 and found)
    browser.picture("narrow")
    browser.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    assert width <= window
    assert paper == "rgb(21, 24, 27)"


def test_charts_that_are_hidden_follow_the_system_s_colours(browser: Browser) -> None:
    """No ink of the light page is left on a dark one when its tab is shown again."""
    black = """(() => { const one = document.querySelector('#loops canvas');
        const data = one.getContext('2d').getImageData(0, 0, one.width, one.height).data;
        return data.reduce((count, v, i) => count + (i % 4 === 3 && v > 200 && data[i - 1] + data[i - 2] + data[i - 3] < 60), 0); })()"""
    browser.until("black labels on the light page", lambda: browser.says(black) > 100)
    browser.tab("laboratory")
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": "dark"}]})
    browser.tab("design")
    browser.until("no black ink on the dark page", lambda: browser.says(black) == 0)
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_saving_makes_it_the_design_of_the_run(browser: Browser) -> None:
    """What is saved is what the sliders stand for, the one before is kept, and nothing reaches a drive without a proof."""
    before, wanted = browser.folder.load("designs", "final"), browser.value(KNOB)
    browser.at("save").click()
    browser.until("the design is saved", lambda: "Saved" in browser.text("saved") or "Not saved" in browser.text("saved"))
    browser.picture("saved")
    assert browser.text("saved").startswith("Saved")
    assert f"beltcomm verify --drive DRIVE --run {browser.folder.path}" in browser.text("saved")
    assert browser.folder.load("designs", "replaced_1") == before
    saved = browser.folder.load("designs", "final")
    assert saved["tuned"]["phase_margin_deg"] == wanted
    assert saved["parameters"]["ff_inertia_kg_m2"] == before["parameters"]["ff_inertia_kg_m2"]
    assert saved["parameters"]["kpp_1_s"] != before["parameters"]["kpp_1_s"]
    assert min(one["phase_margin_deg"] for one in saved["margins"]) >= wanted - 0.1
    browser.until("no move has proven it", lambda: browser.text("headline") == " ".join(headline_of(browser.folder).text.split()))
    assert browser.text("headline").startswith("OUT OF DATE")
    assert browser.text("next").startswith("Next: beltcomm verify --drive ")
    assert doubts(browser.folder) == [*saved["proof"]["doubts"], "no verification move was driven with these gains"]


def test_a_payload_takes_part(browser: Browser) -> None:
    browser.type("box-suppression_db", -20.0)
    browser.type("payload", 5)
    browser.settled()
    assert browser.at("loaded").is_selected()
    assert not browser.at("refusal").is_displayed()
    assert "18.4" in browser.text("binding") or "13.4" in browser.text("binding")


def test_a_second_page_on_the_run_has_settings_of_its_own(browser: Browser) -> None:
    browser.settled()
    mine = browser.value("box-suppression_db")
    first = browser.driver.current_window_handle
    browser.driver.switch_to.new_window("tab")
    try:
        browser.driver.get(browser.address)
        browser.tab("design")
        browser.settled()
        browser.type("box-suppression_db", mine + 1.0)
        browser.settled()
        assert browser.complaints() == []
    finally:
        browser.driver.close()
        browser.driver.switch_to.window(first)
    assert browser.value("box-suppression_db") == mine


@pytest.mark.examination
def test_without_scripts_the_page_says_what_to_type(browser: Browser) -> None:
    browser.driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    browser.driver.get(browser.address)
    page = browser.driver.execute_cdp_cmd("DOMSnapshot.captureSnapshot", {"computedStyles": ["display"]})
    drawn = {page["strings"][text] for text in page["documents"][0]["layout"]["text"] if text >= 0}
    assert "beltcomm compare RUN" in drawn
