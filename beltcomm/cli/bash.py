"""Completion in bash of words with a colon, such as ``virtual:g_a``: bash takes them apart, and wants back what comes after the colon."""

from __future__ import annotations

import os
import shlex
from typing import Any

from click.shell_completion import BashComplete, CompletionItem, add_completion_class


def words_of_line() -> list[str]:
    """The words of the whole line, those behind the cursor too, without their quotes; bash gives one in each line."""
    return [unquoted(word) for word in os.environ.get("COMP_WORDS", "").split("\n")]


def unquoted(word: str) -> str:
    """A word as a command gets it; one whose quote is still open as far as it goes."""
    try:
        return "".join(shlex.split(word))
    except ValueError:
        return word.lstrip("\"'")


@add_completion_class
class Bash(BashComplete):
    """click's own, which knows no colons, and no empty word before others."""

    _cut = 0

    def get_completion_args(self) -> tuple[list[str], str]:
        """Complete words, and the one at the cursor, both as they were typed."""
        words, at = words_of_line(), int(os.environ["COMP_CWORD"])
        joined: list[str] = []
        for word in words[: at + 1]:
            if joined and (word.startswith(":") or joined[-1].endswith(":")):
                joined[-1] += word
            else:
                joined.append(word)
        incomplete = joined.pop() if at < len(words) else ""
        if at < len(words) and words[at] != incomplete:  # bash took it apart: it completes the part after the last colon
            self._cut = incomplete.rindex(":") + 1
        return joined[1:], incomplete

    def format_completion(self, item: CompletionItem[Any]) -> str:
        """``type,value`` of what comes after the colon."""
        return f"{item.type},{item.value[self._cut :]}"
