"""What the API reference makes of docstrings that are not in numpydoc form yet: ``name : text.   other : text.`` becomes a table."""

from __future__ import annotations

import re
from typing import Any

import griffe

ROLE = re.compile(r":\w+:`~?([^`]+)`")
#: Where the text of an entry ends before its paragraph does.
END = re.compile(r"\s{2,}(?=(?:Raises|Returns|Source|Not )\b)")
NUMPYDOC = re.compile(r"^(Parameters|Attributes|Returns|Raises)\n-{3,}", re.MULTILINE)


class Docstrings(griffe.Extension):
    """Sphinx roles as code, and entries for known names as a section of numpydoc."""

    def on_object(self, *, obj: griffe.Object, loader: griffe.GriffeLoader, **kwargs: Any) -> None:
        """Rewrite the docstring of a class or function where it stands."""
        if obj.docstring is None:
            return
        text = ROLE.sub(r"`\1`", obj.docstring.value)
        if isinstance(obj, griffe.Function):
            text = sectioned(text, "Parameters", [p.name for p in obj.parameters])
        elif isinstance(obj, griffe.Class):
            text = sectioned(text, "Attributes", [name for name, member in obj.members.items() if member.is_attribute])
        obj.docstring.value = text


def sectioned(text: str, title: str, names: list[str]) -> str:
    """A docstring whose entries for ``names`` stand in a section of their own; the rest before it, as it was."""
    if not names or NUMPYDOC.search(text):
        return text
    known = "|".join(map(re.escape, names))
    entry = re.compile(rf"(?:^|(?<=\s\s)|(?<=\n))[ ]*((?:{known})(?:, (?:{known}))*) : ")
    rest, entries = [], []
    for paragraph in text.split("\n\n"):
        parts = entry.split(paragraph)
        said = [parts[0].rstrip()] if parts[0].strip() else []
        for name, told in zip(parts[1::2], parts[2::2], strict=True):
            meaning, *after = END.split(told, maxsplit=1)
            entries += [f"{one}\n    {' '.join(meaning.split())}" for one in name.split(", ")]
            said += after
        rest.append("\n\n".join(said))
    if not entries:
        return text
    return "\n\n".join([*(part for part in rest if part), "\n".join([title, "-" * len(title), *entries])])
