"""A rotary table, rigid, from its axis file to the verdict: numbers against the truth, and what a technician reads."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from beltcomm import api
from beltcomm.axis.kinds import ARC_M
from beltcomm.model import load_model, load_plant
from beltcomm.talk import CarriagePosition

#: What nobody may read on an axis whose load turns; units of length are told from degrees by the figure before them.
FOREIGN = re.compile(r"(?i)\b(belts?|carriages?|carts?|pulleys?)\b|\d ?(mm|µm|kg|N|m/s)(?![\w²³])(?! (m|cm|rad|s))")


class Listener:
    """Hears everything and agrees to nothing."""

    def __init__(self) -> None:
        self.heard: list[str] = []
        self.places: list[CarriagePosition] = []

    def phase(self, index: int, count: int, title: str) -> None:
        self.heard.append(title)

    def progress(self, fraction: float, seconds_left: float | None) -> None:
        pass

    def moving(self, place: CarriagePosition) -> None:
        self.places.append(place)

    def say(self, *lines: str) -> None:
        self.heard += lines

    def confirm(self, text: str) -> bool:
        self.heard.append(text)
        return False

    def attended(self) -> bool:
        return False


def words_of_page(page: Path) -> str:
    text = re.sub(r"<(style|script).*?</\1>", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    return re.sub(r"\bbeltcomm\b", "", re.sub(r"<[^>]+>", "\n", text))


@pytest.mark.examination
def test_a_rotary_table_is_commissioned_whole_and_reads_as_one(tmp_path: Path) -> None:
    run, talk = tmp_path / "run", Listener()
    result = api.commission(
        "virtual:torque_table", "torque-table", run, options=api.Options(yes=True, seed=3, quick=True, report=True), talk=talk
    )
    assert result.exit_code == 0, "\n".join(result.text)
    truth, model = load_plant("torque_table").model, load_model(run / "models" / "final.yaml")
    assert model.driven_inertia() == pytest.approx(truth["motor.inertia"], rel=5e-3)
    load = model.parameters["cart.mass"]
    assert abs(load.value - 0.013 / ARC_M**2) < load.interval < 0.2 * load.value
    assert model["coulomb.level"] == pytest.approx(truth["coulomb.level"], rel=0.02)
    assert {place.unit for place in talk.places} == {"°"}
    files = [(run / name).read_text(encoding="utf-8") for name in ("verdict.txt", "journal.txt")]
    for text in (*talk.heard, *result.text, *result.details, *files, words_of_page(run / "report.html")):
        found = FOREIGN.search(str(text))
        assert found is None, f"{found[0]!r} in {text[max(found.start() - 60, 0) : found.end() + 40]!r}"
