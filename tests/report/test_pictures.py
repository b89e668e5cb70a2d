"""Pictures: complete, in absolute scales, the same bytes for the same values, legends where no curve runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.textpath import text_to_path

from beltcomm.laboratory.samples import Units
from beltcomm.report import page, style
from beltcomm.report.overlay import overlay_figure
from beltcomm.report.page import _svg_of
from beltcomm.report.staircase import RecordChange, Stair, change_figure, staircase_figure
from beltcomm.residuals.responses import Trace, compared

CAPTION = style.Caption("beltcomm compare RUN", "RUN/recordings, 3 records")


def ladder(*ratios: float) -> Figure:
    rungs = [
        Stair(f"revision_{k}", "base" if k == 0 else f"+effect_{k}", r, 1.1 * r, None if k == 0 else k != 2) for k, r in enumerate(ratios)
    ]
    return staircase_figure(rungs, CAPTION)


def texts(picture: Figure) -> str:
    marks = [label for axes in picture.get_axes() for label in (*axes.get_xticklabels(), *axes.get_yticklabels())]
    return " ".join(str(item.get_text()) for item in [*marks, *picture.findobj(lambda artist: hasattr(artist, "get_text"))])


def axes_of(picture: Figure) -> Axes:
    return picture.get_axes()[0]


def test_every_picture_names_command_and_data() -> None:
    for picture in (ladder(3.0, 1.0), change_figure("+cogging", [RecordChange("frf", False, 2.0, 1.0)], 2.0, 1.0, CAPTION)):
        assert "beltcomm compare RUN" in texts(picture)
        assert "RUN/recordings, 3 records" in texts(picture)


def test_two_ladders_compare() -> None:
    assert axes_of(ladder(3.1, 1.0)).get_ylim() == axes_of(ladder(8.0, 2.0, 1.0)).get_ylim() == (0.8, 10.0)
    assert "not confirmed" in texts(ladder(8.0, 2.0, 1.0))
    assert "noise: no model can go lower" in texts(ladder(8.0, 1.0))


def test_a_record_that_got_worse_is_marked() -> None:
    records = [RecordChange("a", False, 2.0, 1.0), RecordChange("b", True, 1.2, 1.6)]
    picture = change_figure("+backlash", records, 1.7, 1.3, CAPTION)
    markers = [line.get_marker() for line in axes_of(picture).get_lines()]
    assert markers.count("X") == 2, "one for the record, one in the legend"
    assert "b (held out)" in texts(picture)


def test_the_same_values_give_the_same_bytes(tmp_path: Path) -> None:
    paths = [style.save(ladder(3.0, 1.0), tmp_path / name / "ladder.png") for name in ("a", "b")]
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert not list(tmp_path.rglob("*.part"))


def test_a_word_of_many_figures_is_measured_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the second figure nothing new is measured; both are the same SVG."""
    measured: list[str] = []
    real = text_to_path.get_text_width_height_descent

    def watched(text: str, *rest: object) -> tuple[float, float, float]:
        measured.append(text)
        return real(text, *rest)

    monkeypatch.setattr(text_to_path, "get_text_width_height_descent", watched)
    page._measured.cache_clear()
    first = _svg_of(ladder(3.0, 1.0))
    count = len(measured)
    assert count == len(set(measured)) > 5
    assert _svg_of(ladder(3.0, 1.0)) == first
    assert len(measured) == count


@pytest.mark.parametrize("excited", [False, True])
def test_the_overlay_shows_the_worst_stretch(excited: bool) -> None:
    time = 1e-3 * np.arange(6000)
    white = np.random.default_rng(1).standard_normal(6000)
    white[4000:4600] += 8.0
    white[:200] = np.nan
    trace = Trace("slow", True, time, np.sin(time), np.sin(time) + 0.01 * white, white, excited, Units())
    picture = overlay_figure(trace, CAPTION)
    low, high = picture.get_axes()[1].get_xlim()
    assert low <= 4.6
    assert high >= 4.0
    assert "held out" in texts(picture)
    assert "torque in N m" in texts(picture)


def test_a_model_is_drawn_where_it_counts() -> None:
    """Of an excited record also between its samples that count; of another the means of both, over the same samples."""
    time = np.arange(2000) * 1e-3
    white = np.where((time > 0.5) & (time < 1.0), 0.3, np.nan)
    white[1::4] = np.nan
    torque = np.sin(2.0 * np.pi * time)
    for excited in (True, False):
        measured, model = compared(Trace("r", False, time, torque + 0.1, torque, white, excited, Units()))
        shown = np.flatnonzero(np.isfinite(model))
        reach = 1 if excited else 20
        assert abs(shown[0] - 501) <= reach
        assert abs(shown[-1] - 999) <= reach
        assert len(shown) == shown[-1] - shown[0] + 1
        assert measured[shown] - model[shown] == pytest.approx(0.1)


def test_a_model_is_not_drawn_at_a_reversal_which_does_not_count() -> None:
    time = np.arange(2000) * 1e-3
    white = np.full(len(time), 0.3)
    model = np.zeros(len(time))
    for at in range(200, 2000, 200):
        white[at - 2 : at + 2], model[at - 1 : at + 1] = np.nan, 0.1
    _, shown = compared(Trace("r", False, time, np.zeros(len(time)), model, white, True, Units()))
    assert np.nanmax(np.abs(shown)) == 0.0
    assert np.isfinite(shown).sum() > 1900


@pytest.mark.parametrize("scale", ["linear", "log"])
@pytest.mark.parametrize("curve", [lambda x: x, lambda x: 1.1 - x, lambda x: 0.5 + 0.5 * np.cos(40.0 * x), lambda x: 0.0 * x + 0.3])
def test_no_curve_runs_through_a_legend(curve: object, scale: str) -> None:
    x = np.linspace(0.01, 1.0, 400)
    with style.styled():
        made = style.figure("a", 3.0, style.Caption("", ""))
        axes, _ = made.subplots(2, 1)
        axes.plot(x, 1.01 + 10.0 * curve(x), label="measured: sweep, 0.25 m")
        axes.plot(x, 1.0 + 9.0 * curve(x), label="model")
        axes.set_yscale(scale)
        style.legend(axes)
        style._laid_out(made).draw_without_rendering()
        box = axes.get_legend().get_window_extent()
        for line in axes.get_lines():
            assert not box.count_contains(axes.transData.transform(line.get_xydata()))
