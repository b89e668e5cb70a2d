"""What a long job says to the person beside the machine, and the questions it asks."""

from __future__ import annotations

from typing import Protocol


class Talk(Protocol):
    """The other end of a conversation: a terminal, a log, a test.  Never carries results."""

    def phase(self, index: int, count: int, title: str) -> None:
        """Phase ``index`` (from 1) of ``count`` begins."""
        ...

    def progress(self, fraction: float, seconds_left: float | None) -> None:
        """The present phase is done to ``fraction``, 0 to 1.   seconds_left : s on the machine, None when not known."""
        ...

    def say(self, text: str) -> None:
        """One or more plain sentences."""
        ...

    def confirm(self, text: str) -> bool:
        """Ask a question that states what will happen; True only for an explicit yes.

        Raises UsageError when nobody can answer."""
        ...

    def attended(self) -> bool:
        """Whether a person sits at the other end who sees the machine: a terminal, not a pipe."""
        ...


class Hold(Protocol):
    """A key that is held as long as the axis may move; letting go stops it."""

    def begin(self) -> bool:
        """Before a motion: wait until it is held.  False when it never will be."""
        ...

    def held(self) -> bool:
        """Whether it is held now; asked every few rows of a motion, so it must answer at once."""
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

    def say(self, text: str) -> None:
        """Ignored."""

    def confirm(self, text: str) -> bool:
        """No."""
        return False

    def attended(self) -> bool:
        """No."""
        return False
