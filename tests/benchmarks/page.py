"""The page of ``beltcomm open``: weight, and time from a click to the drawing:  ``python tests/benchmarks/page.py [RUN ...]``.

Each RUN is copied; `beltcomm demo` makes one.  Without one a tight spot is measured on the virtual axis.  Chromium draws; ms by its clock.
A stage is a click on the effect that explains most until everything is fitted again and drawn, or on the × that takes it out.
"""

from __future__ import annotations

import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from beltcomm import api
from beltcomm.model import load_plant
from beltcomm.simulate.plant import SimulatedPlant
from beltcomm.web.server import PAGE
from session.browser import Browser, browser_on

#: Times that an effect is added and taken out.
STAGES = 3


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


def click(browser: Browser, selector: str, kind: str) -> None:
    """A click that fits everything again, as soon as the page offers it and has weighed all."""
    browser.until("all is weighed", lambda: not browser.text("doing") and "still weighing" not in browser.text("candidates"))
    count = browser.says("timings.add.length")
    browser.driver.find_element("css selector", selector).click()
    browser.until(f"{kind} is drawn", lambda: browser.says("timings.add.length") > count)


def staged(browser: Browser) -> dict[str, list[float]]:
    """The first effect taken out and added, by turns; what is there to begin with counts."""
    found: dict[str, list[float]] = {"adding": [], "taking out": []}
    while min(map(len, found.values())) < STAGES:
        out = browser.driver.find_elements("css selector", "#effects button")
        kind, selector = ("taking out", "#effects button") if out else ("adding", ".card.first .main-action")
        click(browser, selector, kind)
        found[kind].append(browser.says("timings.add.at(-1)"))
    return found


def asked(browser: Browser) -> float:
    """The sceptic's button, where the model lacks something."""
    if browser.driver.find_elements("css selector", "#effects button"):
        click(browser, "#effects button", "taking out")
    browser.until("all is weighed", lambda: not browser.text("doing") and "still weighing" not in browser.text("candidates"))
    begun = time.monotonic()
    browser.driver.find_element("css selector", ".card.first .buttons button:last-child").click()
    browser.until("evidence", lambda: browser.at("evidence").is_displayed())
    return 1e3 * (time.monotonic() - begun)


def page_of(run: Path, folder: Path) -> dict[str, list[float]]:
    """Figures of one run, ms, told as they come."""
    found: dict[str, list[float]] = {}
    with browser_on(run, folder / "profile") as browser:
        browser.until("read", lambda: browser.says("document.body.dataset.version"))
        browser.until("weighed", lambda: not browser.text("doing"))
        drawn = browser.says("performance.getEntriesByName(location.href.split('#')[0] + 'laboratory-residual')[0].encodedBodySize")
        print(f"residual of the run: {drawn / 1e3:.0f} kB")
        for along in ("position", "time", "speed", "angle", "torque", "frequency"):
            for low in (0.0, 0.1, 0.2):
                choose(browser, along, low, low + 0.2)
        found["choosing a segment, click to drawing"] = browser.says("timings.segment")
        found |= {f"{kind} an effect, click to drawing": values for kind, values in staged(browser).items()}
        found["is it that?, click to evidence"] = [asked(browser)]
        browser.until("free", lambda: not browser.text("doing"))
        browser.tab("design")
        browser.settled()
        browser.until("presets", lambda: browser.says("document.body.dataset.presets"))
        browser.says("timings.update.length = timings.track.length = 0")
        for step in range(12):
            browser.type("box-suppression_db", -12.0 - 0.5 * step)
            browser.settled()
        found["slider to curves"] = browser.says("timings.update")
        found["slider to predicted tracking error"] = browser.says("timings.track")
    for name, values in found.items():
        told(name, values)
    return found


def main() -> None:
    """Print the figures of each run, and of all."""
    weight = sum(len(PAGE.text(name).encode()) for name in ("", *PAGE.beside))
    print(f"page: {weight / 1e3:.0f} kB in {1 + len(PAGE.beside)} files, uncompressed")
    every: dict[str, list[float]] = {}
    for name in sys.argv[1:] or [""]:
        with tempfile.TemporaryDirectory() as folder:
            run = Path(folder) / "run"
            if name:
                shutil.copytree(name, run)
                api.design(run)
            else:
                measured(run)
            print(f"\n{name or 'a tight spot'}")
            for kind, values in page_of(run, Path(folder)).items():
                every.setdefault(kind, []).extend(values)
    if len(sys.argv) > 2:
        print("\nall of them")
        for name, values in every.items():
            told(name, values)


if __name__ == "__main__":
    main()
