"""The page of ``beltcomm open`` in a real browser, as a user has it."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from beltcomm.app.serve import RunPage, RunPages
from beltcomm.runfolder import RunFolder
from beltcomm.web.server import PAGE, serve

BROWSER, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
MISSING = "needs chromium and chromedriver: sudo apt-get install chromium chromium-driver (.ci/run does)"
ARGUMENTS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-3d-apis",  # no page needs WebGL
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-extensions",
    "--window-size=1400,1500",
)
#: s until the page must have come so far on a computer that is busy with other tests.
PATIENCE_S = 120.0


@dataclass
class Browser:
    """A window on one run."""

    driver: Any
    page: RunPage
    folder: RunFolder
    address: str

    def at(self, name: str) -> Any:
        return self.driver.find_element("id", name)

    def text(self, name: str) -> str:
        return str(self.at(name).text)

    def value(self, name: str) -> float:
        return float(self.at(name).get_attribute("value"))

    def says(self, script: str) -> Any:
        return self.driver.execute_script(f"return {script}")

    def until(self, words: str, condition: Callable[[], Any]) -> Any:
        from selenium.common.exceptions import StaleElementReferenceException
        from selenium.webdriver.support.ui import WebDriverWait

        waiting = WebDriverWait(self.driver, PATIENCE_S, 0.05, ignored_exceptions=[StaleElementReferenceException])
        return waiting.until(lambda _: condition(), f"{words}; the page says: {self.complaints()}")

    def complaints(self) -> list[str]:
        return [entry["message"] for entry in self.driver.get_log("browser") if entry["level"] in ("SEVERE", "WARNING")]

    def tab(self, name: str) -> None:
        self.at(f"tab-{name}").click()

    def settled(self) -> None:
        """The design is drawn for the newest setting, its possible ranges too."""
        self.until("the design settles", lambda: self.says("document.body.dataset.design === 'settled'"))

    def type(self, name: str, value: float) -> None:
        """A number into a box, as by keyboard."""
        from selenium.webdriver.common.keys import Keys

        box = self.at(name)
        box.send_keys(Keys.CONTROL, "a")
        box.send_keys(f"{value}", Keys.TAB)

    def picture(self, name: str) -> None:
        """A screenshot for whoever wants to look (BELTCOMM_PICTURES=FOLDER)."""
        if folder := os.environ.get("BELTCOMM_PICTURES"):
            self.driver.save_screenshot(f"{folder}/{name}.png")


@contextmanager
def browser_on(run: Path, profile: Path) -> Iterator[Browser]:
    """The page of a run in a window of its own.   profile : folder for the browser."""
    from selenium import webdriver
    from selenium.webdriver.chrome.options import Options
    from selenium.webdriver.chrome.service import Service

    options = Options()
    options.binary_location = BROWSER
    for argument in (*ARGUMENTS, f"--user-data-dir={profile}"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    pages = RunPages(run)
    with serve(PAGE, pages.answers(), "secret") as served:
        answering = threading.Thread(target=served.run, daemon=True)
        answering.start()
        driver = webdriver.Chrome(options=options, service=Service(DRIVER))
        try:
            driver.get(served.address)
            yield Browser(driver, pages.first, RunFolder.open(run), served.address)
        finally:
            driver.quit()
            served.end()
            answering.join(10.0)
            pages.close()
