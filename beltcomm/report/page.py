"""A page of HTML that holds everything it shows: sections of words, numbers, tables and figures as SVG, and a script that draws the
curves of a figure with values and zoom; it reads the same without scripts, and asks nothing from outside."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_mixed import MixedModeRenderer
from matplotlib.backends.backend_svg import RendererSVG
from matplotlib.font_manager import FontProperties
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.textpath import text_to_path

from beltcomm.arrays import Array
from beltcomm.borders import for_html
from beltcomm.report import style
from beltcomm.report.placing import POINTS_PER_INCH, place

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

#: Colours of figures that follow the page, light or dark: ink, faint ink, grid, bars of what is missing.
FOLLOWING = {
    style.MEASURED: "--ink",
    "#555555": "--soft",
    "#777777": "--soft",
    style.FAINT: "--faint",
    "#E4E4E4": "--grid",
    "#CCCCCC": "--faint",
    style.NO_DATA: "--nothing",
    style.RESIDUAL: "--blue",
}

#: What draws the charts of a page: the library of all charts, then the page's own.
SCRIPTS = (("beltcomm.web", "vendor/uPlot.iife.min.js"), ("beltcomm.report", "page.js"))

#: Dots per inch of what is too dense for lines, as maps are.
DENSE_DPI = 110

#: Points that a line may be off, and within which points cover each other; the number of points from which that is looked at.
LINE_PT, POINT_PT, MANY = 0.3, 1.0, 200

#: Diameter of a "." over its marker size, without its edge.
DOT_SHARE = 0.5

#: Neither date nor program: the same figure gives the same text.
UNDATED = {"Date": None, "Creator": None}
State = Literal["good", "bad", "note", ""]

#: Texts that are remembered; a page has some 200.
TEXTS = 4096


@dataclass(frozen=True)
class Fact:
    """One of the large numbers on the first screen.

    Attributes
    ----------
    value : str
        With its unit.
    state : State
        What it means for the axis.
    """

    name: str
    value: str
    words: str = ""
    state: State = ""


@dataclass(frozen=True)
class Paragraphs:
    """Paragraphs; a list where ``listed``; typed text where ``typed``."""

    lines: Sequence[str]
    listed: bool = False
    typed: bool = False


@dataclass(frozen=True)
class PageTable:
    """Rows under a head; cells are text, those that begin with a number stand right."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: str = ""


@dataclass(frozen=True)
class Picture:
    """A figure.

    Attributes
    ----------
    svg : str
        Without prologue.
    caption : str
        Command and data.
    curves : str
        JSON of its curves, for a chart; "" for a picture of none.
    """

    title: str
    sentences: Sequence[str]
    svg: str
    caption: str
    curves: str = ""


@dataclass(frozen=True)
class Section:
    """A heading with its parts.

    Attributes
    ----------
    key : str
        Stable, for links and programs.
    folded : bool
        Opened by whoever wants it, and in print.
    """

    key: str
    title: str
    parts: Sequence[Paragraphs | PageTable | Picture] = ()
    missing: str = ""
    folded: bool = False


@dataclass(frozen=True)
class Page:
    """Contents of a page.

    Attributes
    ----------
    verdict : str
        The first sentence.
    next_steps : sequence of str
        Commands, in the order in which they help.
    changes : sequence of str
        Since another run, in words.
    warnings : sequence of str
        Below the first sentence.
    """

    title: str
    subtitle: str
    verdict: str
    state: State
    facts: Sequence[Fact]
    next_steps: Sequence[str]
    sections: Sequence[Section] = ()
    notes: Sequence[str] = field(default=())
    changes: Sequence[str] = field(default=())
    warnings: Sequence[str] = field(default=())


def picture_of(figure: Figure) -> Picture:
    """A figure of this package as a part of a page: title, sentences and caption become text of the page.

    Parameters
    ----------
    figure : Figure
        Loses its title and caption.

    Returns
    -------
    Picture
        SVG, sentences, and the curves for the browser.

    Raises
    ------
    ValueError
        For a figure that was not made by :func:`beltcomm.report.style.figure`.
    """
    title, _, rest = figure.get_suptitle().partition("\n")
    caption = figure.get_supxlabel()
    if not caption:
        raise ValueError("a picture names its command and data")
    sentences = [line.removeprefix("• ").strip() for line in re.sub(r"\n {3}", " ", rest).splitlines()] if "• " in rest else []
    if rest and not sentences:
        title = f"{title} {rest}"
    figure.suptitle("")
    figure.supxlabel("")
    curves = curves_of(figure)  # before it is drawn, which thins them
    return Picture(title, sentences, _svg_of(figure), re.sub(r"\s{2,}", " · ", caption), curves)


def _svg_of(figure: Figure) -> str:
    """A figure as SVG that scales with the page and takes its colours where they mean nothing; the same figure gives the same text."""
    figure.patch.set_alpha(0.0)
    for axes in figure.get_axes():
        if axes.get_facecolor()[:3] == (1.0, 1.0, 1.0):
            axes.patch.set_alpha(0.0)
    stream = io.StringIO()
    style.in_own_words(figure).set_dpi(POINTS_PER_INCH)
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "beltcomm", "path.simplify_threshold": LINE_PT}):
        wide, high = figure.get_size_inches()
        size = (wide * POINTS_PER_INCH, high * POINTS_PER_INCH)
        vectors = Vectors(*size, stream, image_dpi=DENSE_DPI, metadata=UNDATED)  # type: ignore[no-untyped-call]
        layout = figure.get_layout_engine()
        if not place(figure, vectors) and layout is not None:
            layout.execute(figure)
        figure.set_layout_engine("none")
        for axes in figure.get_axes():
            for line in list(axes.get_lines()):
                _thin(axes, line)
        # savefig would draw everything twice
        renderer: Any = MixedModeRenderer(figure, wide, high, DENSE_DPI, vectors)  # type: ignore[no-untyped-call]
        figure.draw(renderer)
        renderer.finalize()
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r'width="[\d.]+pt" height="[\d.]+pt" ', "", text, count=1)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"font: ([\d.]+)px [^;\"]*", r"font: \1px var(--font)", text)
    text = re.sub(r'="[^"]*"', _hundredths, text)
    text = re.sub(r"(fill|stroke): (#[0-9a-fA-F]{6})", _following, text)
    # text without a colour of its own is black
    return text.replace("<text ", '<text fill="var(--ink)" ').replace("\n", " ")


def _hundredths(found: re.Match[str]) -> str:
    """An attribute with its numbers cut to two digits, a hundredth of a point: more than a printer shows."""
    return re.sub(r"(?<=\.\d\d)\d+", "", found[0])


def _following(found: re.Match[str]) -> str:
    """A colour, or the name under which the page holds it."""
    name = FOLLOWING.get(found[2].upper())
    return found[0] if name is None else f"{found[1]}: var({name})"


def _thin(axes: Axes, line: Line2D) -> None:
    """Of points that cover each other keep one, and draw all as one path of round dots: thousands of marks would make the page heavy."""
    points = line.get_transform().transform(np.column_stack([line.get_xdata(), line.get_ydata()]).astype(float))
    if line.get_linestyle() != "None" or len(points) < MANY:
        return
    box = axes.bbox.extents
    with np.errstate(invalid="ignore"):
        inside = ((points >= box[:2]) & (points <= box[2:])).all(axis=1)
    known = np.flatnonzero(inside)
    _, first = np.unique(np.round(points[known] / POINT_PT).astype(int), axis=0, return_index=True)
    kept = known[np.sort(first)]
    if line.get_marker() != ".":
        line.set_data(np.asarray(line.get_xdata())[kept], np.asarray(line.get_ydata())[kept])
        return
    line.set_data([], [])  # stays for the legend
    dots = Path(np.repeat(axes.transAxes.inverted().transform(points[kept]), 2, axis=0), [Path.MOVETO, Path.LINETO] * len(kept))
    dots.should_simplify = False  # strokes of no length are what shows
    wide = DOT_SHARE * line.get_markersize() + line.get_markeredgewidth()
    axes.add_artist(
        PathPatch(dots, transform=axes.transAxes, fill=False, edgecolor=line.get_color(), linewidth=wide, capstyle="round",
                  alpha=line.get_alpha(), zorder=line.get_zorder())
    )  # fmt: skip


def render(page: Page) -> str:
    """The page as one file of HTML.

    Parameters
    ----------
    page : Page
        Its parts, in their order.
    """
    from jinja2 import Environment, StrictUndefined

    source = _shipped("beltcomm.report", "page.html.j2")
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.tests["number"] = lambda cell: re.fullmatch(r"[-+±−]?[\d.,]+(e[-+]\d+)?( (±|to) [\d.,]+)?", cell) is not None
    environment.filters["part"] = lambda part: type(part).__name__
    script = for_html("\n".join(_shipped(*file) for file in SCRIPTS))
    allowed = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    style_of_charts = _shipped("beltcomm.web", "vendor/uPlot.min.css")
    return for_html(
        environment.from_string(source).render(
            page=page, script=script, allowed=allowed, style_of_charts=style_of_charts, colours=json.dumps(FOLLOWING)
        )
    )


def _shipped(package: str, name: str) -> str:
    from importlib.resources import files

    return files(package).joinpath(name).read_text(encoding="utf-8")


class Vectors(RendererSVG):
    """Matplotlib's SVG, with one memory for all figures where it has one for each use of each."""

    def get_text_width_height_descent(self, s: str, prop: FontProperties, ismath: Any) -> tuple[float, float, float]:
        """Of a text without its line breaks, points."""
        return _measured(s, prop, ismath)


@lru_cache(maxsize=TEXTS)
def _measured(text: str, font: FontProperties, ismath: Any) -> tuple[float, float, float]:
    """Width, height and descent, points."""
    found: tuple[float, float, float] = text_to_path.get_text_width_height_descent(text, font, ismath)
    return found


#: Points of a curve that are kept, and digits of each.
MOST, DIGITS = 1500, 5
#: Points from which a line is a curve and no mark.
LEAST = 3


def curves_of(figure: Figure) -> str:
    """JSON of the panels of a figure that hold curves, before it is drawn; "" for a figure without any."""
    panels = [panel for axes in figure.get_axes() if (panel := _panel(axes))["curves"]]
    return json.dumps(panels, separators=(",", ":")).replace("<", "\\u003c") if panels else ""


def _panel(axes: Axes) -> dict[str, Any]:
    shared = [one for one in axes.figure.get_axes() if one.get_xlabel()]  # panels above each other name it once
    return {
        "title": axes.get_title() or axes.get_title(loc="left"),
        "x": axes.get_xlabel() or (shared[-1].get_xlabel() if shared else ""),
        "y": axes.get_ylabel(),
        "log": [axes.get_xscale() == "log", axes.get_yscale() == "log"],
        "xlim": [_cut(v) for v in axes.get_xlim()],
        "ylim": [_cut(v) for v in sorted(axes.get_ylim())],
        "curves": [curve for line in axes.get_lines() if _of_data(line, axes) and (curve := _curve(line))],
    }


def _of_data(line: Line2D, axes: Axes) -> bool:
    return line.get_transform() == axes.transData


def _curve(line: Line2D) -> dict[str, Any]:
    """One line; {} for one that is a mark, or holds no number."""
    x: Array
    y: Array
    x, y = (np.ma.filled(np.ma.asarray(values, dtype=float), np.nan) for values in line.get_data())
    if len(x) < LEAST or not np.isfinite(x).any() or not np.isfinite(y).any():
        return {}
    kept = np.unique(np.linspace(0, len(x) - 1, min(len(x), MOST)).round().astype(int))
    known = kept[np.isfinite(x[kept])]
    order = known[np.argsort(x[known], kind="stable")]
    label = str(line.get_label())
    return {
        "label": "" if label.startswith("_") else label,
        "colour": _hex(line.get_color()),
        "dots": line.get_linestyle() == "None",
        "xy": [[_cut(v) for v in x[order]], [_cut(v) for v in y[order]]],
    }


def _cut(value: float) -> float | None:
    return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None


def _hex(colour: Any) -> str:
    from matplotlib.colors import to_hex

    return to_hex(colour).upper()
