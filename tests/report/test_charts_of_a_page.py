"""A page in a browser: charts with values and zoom where scripts may run, the picture where they may not, folded parts open in print."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltcomm.report import style
from beltcomm.report.page import MOST, Page, Paragraphs, Section, curves_of, picture_of, render
from session.browser import ARGUMENTS, BROWSER, DRIVER, MISSING

CAPTION = style.Caption("beltcomm compare RUN", "RUN/recordings, 3 records")
HZ, DB = np.geomspace(1.0, 500.0, 4000), np.linspace(10.0, -70.0, 4000)


def figure() -> Any:
    with style.styled():
        made = style.figure("Response", 4.0, CAPTION)
        axes = made.subplots()
        axes.plot(HZ, DB, color=style.MEASURED, label="measured </script> & more")
        axes.plot([1.0, 500.0], [0.0, 0.0], label="a mark of two points")
        axes.set_xscale("log")
        axes.set_xlabel("frequency in Hz")
        axes.set_ylabel("dB")
    return made


def test_curves_are_thinned_and_marks_are_left_out() -> None:
    (panel,) = json.loads(curves_of(figure()))
    (curve,) = panel["curves"]
    assert panel["log"] == [True, False]
    assert (curve["colour"], len(curve["xy"][0])) == (style.MEASURED, MOST)
    assert curve["xy"][1][0] == 10.0
    assert "</" not in curves_of(figure())
    with style.styled():
        assert curves_of(style.figure("empty", 2.0, CAPTION)) == ""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folded = Section("more", "More", [Paragraphs(["what is folded"])], folded=True)
    made = Page("report", "", "PASS", "good", [], [], [Section("first", "First", [picture_of(figure())]), folded])
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(render(made), encoding="utf-8")
    return path


@pytest.fixture
def window(request: pytest.FixtureRequest, tmp_path: Path, page: Path) -> Iterator[Any]:
    if not BROWSER or not DRIVER:
        pytest.skip(MISSING)
    from selenium import webdriver
    from selenium.webdriver.chrome.options import Options
    from selenium.webdriver.chrome.service import Service

    options = Options()
    options.binary_location = BROWSER
    for argument in (*ARGUMENTS, f"--user-data-dir={tmp_path}"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    if not getattr(request, "param", True):
        options.add_experimental_option("prefs", {"profile.managed_default_content_settings.javascript": 2})
    driver = webdriver.Chrome(options=options, service=Service(DRIVER))
    try:
        driver.get(page.as_uri())
        yield driver
    finally:
        driver.quit()


def test_a_click_shows_values_under_the_pointer_a_drag_zooms_and_the_picture_comes_back(window: Any) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    button, picture = (window.find_element("css selector", one) for one in ("h3 button", "figure .scroll"))
    assert picture.is_displayed()
    button.click()
    assert not picture.is_displayed()
    over = window.find_element("css selector", ".charts .u-over")
    ActionChains(window).move_to_element_with_offset(over, 0, 0).perform()
    hz, level = (float(cell.text.replace("\N{MINUS SIGN}", "-")) for cell in window.find_elements("css selector", ".u-legend .u-value"))
    assert level == pytest.approx(float(np.interp(hz, HZ, DB)), abs=0.2)
    before = window.find_element("css selector", ".charts canvas").screenshot_as_base64
    ActionChains(window).move_to_element_with_offset(over, -100, 0).click_and_hold().move_by_offset(150, 5).release().perform()
    assert window.find_element("css selector", ".charts canvas").screenshot_as_base64 != before
    button.click()
    assert picture.is_displayed()
    assert [entry["message"] for entry in window.get_log("browser") if entry["level"] == "SEVERE"] == []


@pytest.mark.parametrize("window", [False], indirect=True)
def test_without_scripts_the_picture_is_seen_and_parts_unfold(window: Any) -> None:
    assert window.find_element("css selector", "figure svg").is_displayed()
    assert window.find_elements("css selector", "h3 button, .charts") == []
    window.find_element("css selector", "summary").click()
    assert window.find_element("css selector", "details p").is_displayed()


def test_a_link_opens_a_folded_part_and_print_opens_all(window: Any) -> None:
    (part,) = window.find_elements("css selector", "details")
    assert part.get_attribute("open") is None
    window.execute_script("dispatchEvent(new Event('beforeprint'))")
    assert part.get_attribute("open") is not None
    window.execute_script("dispatchEvent(new Event('afterprint'))")
    assert part.get_attribute("open") is None
    for _ in range(2):
        window.find_element("css selector", "nav a[href='#more']").click()
        assert part.get_attribute("open") is not None
        window.execute_script("arguments[0].open = false", part)
