"""The page of ``beltcomm open``: weight, and time from a click to the drawing:  ``python tests/benchmarks/page.py [RUN]``.

RUN is copied, and must have a design; without one a tight spot is measured on the virtual axis.  Chromium draws; ms by the page's clock.
"""

from __future__ import annotations

import shutil
import statistics
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from beltcomm import api
from beltcomm.model import load_plant
from beltcomm.simulate.plant import SimulatedPlant
from beltcomm.web.server import PAGE
from session.browser import Browser, browser_on


def measured(run: Path) -> None:
    """A run with a hidden fault and a design."""
    machine = load_plant("g_b").model.with_effect("friction_position", {"amount": 0.05, "place": 0.3, "width": 0.06})
    options = api.Options(yes=True, seed=1, drive={"plant": SimulatedPlant(machine, 0.25), "start_position": 0.25})
    api.identify("virtual:g_b", "egc-70-600", run, options=options)
    api.friction("virtual:g_b", run, options=options)
    api.design(run)


def told(name: str, values: list[float]) -> None:
    """Median and worst."""
    print(f"{name:44s} median {statistics.median(values):7.0f} ms   worst {max(values):7.0f} ms   of {len(values)}")


def choose(browser: Browser, along: str, low: float, high: float) -> None:
    """Mark a segment as by hand."""
    count = browser.says("timings.segment.length")
    browser.says(f"document.querySelector('#along option[value={along}]').selected = true")
    browser.type("low", low)
    browser.type("high", high)
    browser.driver.find_element("css selector", "#choose button").click()
    browser.until("it is marked", lambda: browser.says("timings.segment.length") > count)


def main() -> None:
    """Print the figures."""
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        if len(sys.argv) > 1:
            shutil.copytree(sys.argv[1], run)
        else:
            measured(run)
        weight = sum(len(PAGE.text(name).encode()) for name in ("", *PAGE.beside))
        print(f"page: {weight / 1e3:.0f} kB in {1 + len(PAGE.beside)} files, uncompressed")
        with browser_on(run, Path(folder) / "profile") as browser:
            browser.until("read", lambda: browser.says("document.body.dataset.version"))
            browser.until("weighed", lambda: not browser.text("doing"))
            drawn = browser.says("performance.getEntriesByName(location.href.split('#')[0] + 'laboratory-residual')[0].encodedBodySize")
            print(f"residual of the run: {drawn / 1e3:.0f} kB")
            for along in ("position", "time", "speed", "angle", "torque", "frequency"):
                for low in (0.0, 0.1, 0.2):
                    choose(browser, along, low, low + 0.2)
            told("choosing a segment, click to drawing", browser.says("timings.segment"))
            for _ in range(2):
                for selector in (".card[data-effect=friction_position] .main-action", "#effects button"):
                    browser.until("free", lambda: not browser.text("doing"))
                    count = browser.says("timings.add.length")
                    browser.until("there", lambda s=selector: browser.driver.find_elements("css selector", s))
                    browser.driver.find_element("css selector", selector).click()
                    browser.until("fitted again", lambda count=count: browser.says("timings.add.length") > count)
            told("adding or taking out, click to drawing", browser.says("timings.add"))
            browser.until("free", lambda: not browser.text("doing"))
            browser.tab("design")
            browser.settled()
            browser.until("presets", lambda: browser.says("document.body.dataset.presets"))
            browser.says("timings.update.length = timings.track.length = 0")
            for step in range(12):
                browser.type("box-suppression_db", -12.0 - 0.5 * step)
                browser.settled()
            told("slider to curves", browser.says("timings.update"))
            told("slider to predicted tracking error", browser.says("timings.track"))


if __name__ == "__main__":
    main()
