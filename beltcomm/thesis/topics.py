"""Topics of the design source: each is compared, told in words, and drawn when pictures are asked for."""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from beltcomm import atomic
from beltcomm.errors import UsageError
from beltcomm.given import Place, place
from beltcomm.result import Result, plain

if TYPE_CHECKING:  # matplotlib takes longer to import than a command without pictures may last
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Topic:
    """Contents of a topic, and its place in the source.   The module of its name computes it, that in ``figures`` draws."""

    title: str
    source: str


#: Topics in the order of the source.
TOPICS: Mapping[str, Topic] = {
    "models": Topic("belt springs, parameter sets, approximations, carriage; high frequencies and data reduction", "thesis 2, 3.4, 3.5"),
    "excitations": Topic("PRBS, generalised PRBS, chirp and multisine at equal machine time", "thesis 3.1"),
    "identification": Topic("open loop, direct and indirect closed loop, speed setpoint; dead time; averaging", "thesis 3.3, 3.4"),
    "friction": Topic("six orders of the friction sweep: drift, wear, load, Stribeck effect", "thesis 3.6, (A.1), figure 3.10"),
    "designs": Topic("prefilters, gains, margins and the three knobs, beside the product's own design", "thesis chapter 4, appendix A"),
    "discretisation": Topic("the discrete loops against the continuous design", "thesis chapters 4 and 6, (4.1) to (4.6), (6.1), (6.25)"),
    "closed-loop": Topic(
        "prefilter, feedforward, mass and anti-windup in the 0.5 m move, on the virtual drive", "thesis chapter 5, figure 6.10"
    ),
    "estimators": Topic("velocity from encoder edges: four estimators, their errors, debouncing, time-out", "thesis 6.1, appendix C"),
}


def thesis(topic: str | None = None, *, pictures: Place | None = None, command: str = "") -> Result:
    """Recompute the topics of the design source, or one of them.

    Parameters
    ----------
    topic : str or None
        Its word; None for all.
    pictures : Place or None
        Folder for its figures, None for none.
    command : str
        Command line, kept as provenance.

    Returns
    -------
    Result
        Our figures beside the source's.

    Raises
    ------
    UsageError
        For a word that is no topic.
    """
    if topic is None:
        lines = [f"{name:14} {about.title} ({about.source})" for name, about in TOPICS.items()]
        return Result({"topics": {name: plain(about) for name, about in TOPICS.items()}}, lines)
    if topic not in TOPICS:
        close = difflib.get_close_matches(topic, TOPICS, n=1)
        hint = f"did you mean {close[0]}?" if close else f"the topics are {', '.join(TOPICS)}"
        raise UsageError(f"there is no topic {topic!r}; {hint}")
    module = importlib.import_module(f"beltcomm.thesis.{topic.replace('-', '_')}")
    study: Any = module.compare()
    made = draw_figures(topic, study, place(pictures, "folder"), command) if pictures is not None else []
    data = {"topic": topic, **plain(study), "pictures": made}
    return Result(data, [*module.lines(study), *(f"drawn: {path}" for path in made)])


def draw_figures(topic: str, study: Any, folder: Path, command: str) -> list[str]:
    """The figures of a topic as PNG; their paths.

    Parameters
    ----------
    topic : str
        Key of :data:`TOPICS`.
    study : Any
        Result of the topic.
    folder : Path
        Where they are written.
    command : str
        Command line, for the caption.
    """
    from beltcomm.report.style import Caption

    report = importlib.import_module(f"beltcomm.thesis.figures.{topic.replace('-', '_')}")
    return save_figures(report.figures(study, Caption(command or f"beltcomm thesis {topic}", TOPICS[topic].source)), folder)


def save_figures(figures: Mapping[str, Figure], folder: Path) -> list[str]:
    """Figures as PNG; their paths.

    Parameters
    ----------
    figures : mapping of str to Figure
        By the names of their files.
    folder : Path
        Where they are written; it is made.

    Raises
    ------
    UsageError
        When the folder cannot be written.
    """
    made = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, figure in figures.items():
            path = folder / f"{name}.png"
            with atomic.replacing(path) as file:
                figure.savefig(file, format="png", dpi=110)
            made.append(str(path))
    except OSError as error:
        raise UsageError(f"the pictures cannot be written into {folder}: {error.strerror}") from error
    return made
