"""SVG of which a text is measured once for all figures of a page: half of a page's texts are the same few numbers."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from matplotlib.backends.backend_svg import RendererSVG
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path

#: Texts that are remembered; a page has some 200.
TEXTS = 4096


class Vectors(RendererSVG):
    """Matplotlib's SVG, with one memory for all figures where it has one for each use of each."""

    def get_text_width_height_descent(self, s: str, prop: FontProperties, ismath: Any) -> tuple[float, float, float]:
        """Of a text without its line breaks, points."""
        return measured(s, prop, ismath)


@lru_cache(maxsize=TEXTS)
def measured(text: str, font: FontProperties, ismath: Any) -> tuple[float, float, float]:
    """Width, height and descent, points."""
    found: tuple[float, float, float] = text_to_path.get_text_width_height_descent(text, font, ismath)
    return found
