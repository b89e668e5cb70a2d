"""Talk of a long job with the person beside the machine, and the questions it asks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True)
class Gauge:
    """A quantity against its limit.

    Attributes
    ----------
    value : float
        The largest of the last moments. torque has a sign, the others have none.
    """

    name: str
    value: float
    limit: float
    unit: str

    @property
    def share(self) -> float:
        """Of the limit."""
        return abs(self.value) / self.limit if self.limit > 0.0 else 0.0


@dataclass(frozen=True)
class CarriagePosition:
    """Position of the carriage while a record is made.

    Attributes
    ----------
    record : str
        Its name.
    position_m, window_m
        On the axis, m; from where it stood when it is not ``known``.
    left_s : float or None
        s on the machine that the whole job takes from now on at most; None when not known.
    gauges : tuple of Gauge
        Torque, belt force and speed against their limits.
    load, unit : str
        What moves is called, and mm, or what a mm of it is.
    """

    record: str
    position_m: float
    window_m: tuple[float, float]
    known: bool = True
    left_s: float | None = None
    gauges: tuple[Gauge, ...] = ()
    load: str = "carriage"
    unit: str = "mm"


class Talk(Protocol):
    """The other end of a conversation: a terminal, a log, a test.  Never carries results."""

    def phase(self, index: int, count: int, title: str) -> None:
        """Phase ``index`` of ``count`` begins.

        Parameters
        ----------
        index : int
            From 1.
        count : int
            0 where nobody knows how many there will be.
        title : str
        """
        ...

    def progress(self, fraction: float, seconds_left: float | None) -> None:
        """The present phase is done to ``fraction``.

        Parameters
        ----------
        fraction : float, 0 to 1
        seconds_left : float or None
            s on the machine, None when not known.
        """
        ...

    def moving(self, place: CarriagePosition) -> None:
        """The carriage moves and is there now; told several times a second while a record is made."""
        ...

    def say(self, *lines: str) -> None:
        """Text for who sits at the other end.

        Parameters
        ----------
        *lines : str, one or more plain sentences each
            A :class:`beltcomm.result.Row` of a table is one, too.
        """
        ...

    def confirm(self, text: str) -> bool:
        """Ask a question that states what will happen; True only for an explicit yes.

        Parameters
        ----------
        text : str
            What will happen.

        Raises
        ------
        UsageError
            When nobody can answer.
        """
        ...

    def attended(self) -> bool:
        """True if a person sits at the other end who sees the machine: a terminal, not a pipe."""
        ...


def choose(talk: Talk, question: str, choices: Mapping[str, str]) -> str:
    """Key that was chosen, the first for a yes, the last for a no; a talk that can only ask yes or no is asked that.

    Parameters
    ----------
    talk : Talk
    question : str
        A sentence.
    choices : dict of str to str
        Key -> word, in the order shown.
    """
    keys = list(choices)
    if ask := getattr(talk, "choose", None):
        return str(ask(question, choices))
    return keys[0] if talk.confirm(question) else keys[-1]


def detail(talk: Talk, *lines: str) -> None:
    """Tell a detail: a terminal shows it where details were asked for, and the journal has it.

    Parameters
    ----------
    talk : Talk
        With or without a place for details.
    *lines : str
        Sentences.
    """
    (getattr(talk, "detail", None) or talk.say)(*lines)


def found(talk: Talk, name: str, value: str) -> None:
    """A number that was found on the way, kept in sight by a talk that can.

    Parameters
    ----------
    talk : Talk
    name : str
        One word; said again it takes the place of the old.
    value : str
        With its unit.
    """
    if tell := getattr(talk, "found", None):
        tell(name, value)


class Hold(Protocol):
    """A key that is held as long as the axis may move; letting go stops it."""

    def begin(self) -> bool:
        """Before a motion: wait until it is held.  False when it never will be."""
        ...

    def pressed(self) -> bool:
        """True if it is held now; asked every few rows of a motion, so it must answer at once."""
        ...

    def end(self) -> None:
        """The motion is over."""
        ...


class Silence:
    """A Talk that says nothing and agrees to nothing: the default of the public functions."""

    def phase(self, index: int, count: int, title: str) -> None:
        """Ignored."""

    def progress(self, fraction: float, seconds_left: float | None) -> None:
        """Ignored."""

    def moving(self, place: CarriagePosition) -> None:
        """Ignored."""

    def say(self, *lines: str) -> None:
        """Ignored."""

    def confirm(self, text: str) -> bool:
        """No."""
        return False

    def attended(self) -> bool:
        """No."""
        return False
