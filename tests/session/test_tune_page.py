"""The tuning page in a real browser, on a copy of the complete run: sliders, presets, refusals, saving, and how long a change takes."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from beltcomm.runfolder import RunFolder
from beltcomm.session.tune_job import Tuning
from beltcomm.web.server import Page, serve

BROWSER, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
pytestmark = pytest.mark.skipif(
    not (BROWSER and DRIVER), reason="needs chromium and chromedriver: sudo apt-get install chromium chromium-driver (.ci/run does)"
)
ARGUMENTS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-extensions",
    "--window-size=1280,1500",
)
#: s until the page must have come so far on a computer that is busy with other tests.
PATIENCE_S = 120.0
KNOB = "phase_margin_deg"


@dataclass
class Browser:
    """The page as a user has it."""

    driver: Any
    tuning: Tuning
    folder: RunFolder

    def at(self, name: str) -> Any:
        return self.driver.find_element("id", name)

    def text(self, name: str) -> str:
        return str(self.at(name).text)

    def value(self, name: str) -> float:
        return float(self.at(name).get_attribute("value"))

    def until(self, words: str, condition: Callable[[], Any]) -> Any:
        from selenium.webdriver.support.ui import WebDriverWait

        return WebDriverWait(self.driver, PATIENCE_S, 0.05).until(lambda _: condition(), f"{words}; the page says: {self.complaints()}")

    def complaints(self) -> list[str]:
        return [entry["message"] for entry in self.driver.get_log("browser") if entry["level"] in ("SEVERE", "WARNING")]

    def settled(self) -> None:
        """All is drawn for the newest setting, its possible ranges too."""
        self.until("the page settles", lambda: self.driver.execute_script("return version > 0 && drawn === version && !busy"))

    def type(self, name: str, value: float) -> None:
        """A number into a box, as by keyboard."""
        from selenium.webdriver.common.keys import Keys

        box = self.at(name)
        box.send_keys(Keys.CONTROL, "a")
        box.send_keys(f"{value}", Keys.TAB)
        self.settled()

    def curve(self, name: str) -> str:
        return str(self.driver.find_element("css selector", f"#{name} polyline").get_attribute("points"))

    def picture(self, name: str) -> None:
        """A screenshot for whoever wants to look (BELTCOMM_PICTURES=FOLDER)."""
        if folder := os.environ.get("BELTCOMM_PICTURES"):
            self.driver.save_screenshot(f"{folder}/{name}.png")


@pytest.fixture(scope="module")
def browser(complete: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """One browser for all tests of this file.   The run keeps three recordings: what else a proof looks at is not this page's matter."""
    from selenium import webdriver
    from selenium.webdriver.chrome.options import Options
    from selenium.webdriver.chrome.service import Service

    run = tmp_path_factory.mktemp("tuned") / "run"
    shutil.copytree(complete.path, run)
    for file in (run / "recordings").iterdir():
        if file.name.partition(".")[0] not in ("frf_1", "move_1"):
            file.unlink()
    tuning = Tuning(run)
    options = Options()
    options.binary_location = BROWSER
    for argument in (*ARGUMENTS, f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    with serve(Page("tune"), tuning.answers(), "secret") as served:
        answering = threading.Thread(target=served.run, daemon=True)
        answering.start()
        driver = webdriver.Chrome(options=options, service=Service(DRIVER))
        try:
            driver.get(served.address)
            yield Browser(driver, tuning, RunFolder.open(run))
        finally:
            driver.quit()
            served.close()
            answering.join(10.0)


def test_page_opens_at_the_present_design(browser: Browser) -> None:
    browser.settled()
    browser.picture("begin")
    assert browser.text("summary") == "Nothing changed against the present design."
    assert browser.value(KNOB) == pytest.approx(
        min(m["phase_margin_deg"] for m in browser.folder.load("designs", "final")["margins"]), abs=0.5
    )
    for plot in ("gain", "phase", "step", "disturbance", "tracking"):
        assert len(browser.curve(plot).split()) > 100, plot
    assert browser.complaints() == []
