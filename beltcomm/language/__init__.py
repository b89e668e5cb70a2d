"""The language of screens: English as written, or another by its catalogue beside this file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files

#: Languages there is a catalogue for, beside English.
OFFERED = ("de",)
_catalogue: dict[str, str] = {}
_spoken = ""


def of_environment(environment: Mapping[str, str]) -> str:
    """The language that a shell asks for, two letters.

    Parameters
    ----------
    environment : mapping of str to str
        BELTCOMM_LANG comes before LC_ALL, LC_MESSAGES and LANG.

    Returns
    -------
    str
        "" for none.
    """
    for name in ("BELTCOMM_LANG", "LC_ALL", "LC_MESSAGES", "LANG"):
        if value := environment.get(name, ""):
            return value[:2].lower()
    return ""


def use(language: str) -> None:
    """From now on screens speak this language; one that is not offered leaves English.

    Parameters
    ----------
    language : str
        Two letters; "" for English.
    """
    global _spoken
    _spoken = language if language in OFFERED else ""
    _catalogue.clear()
    if _spoken:
        _catalogue.update(catalogue(language))


def catalogue(language: str) -> Mapping[str, str]:
    """English -> the language's words, as shipped."""
    return {str(key): str(value) for key, value in _shipped(language).items()}


def _shipped(name: str) -> Mapping[str, str]:
    """A file of this folder; read by libyaml where it is there, for a help takes 0.1 s."""
    import yaml

    text = files("beltcomm.language").joinpath(f"{name}.yaml").read_text(encoding="utf-8")
    found: Mapping[str, str] = yaml.load(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    return found


@cache
def findings(language: str, of: tuple[str, ...] = ("findings", "sentences")) -> list[tuple[re.Pattern[str], str]]:
    """Pattern of a finished English sentence -> the language's, as shipped; the most particular first.

    Parameters
    ----------
    of : tuple of str
        Files: what ``doctor`` and ``init`` find, what the other screens say.
    """
    found = {english: told for name in of for english, told in _shipped(f"{language}.{name}").items()}
    pairs = sorted(found.items(), key=lambda pair: -len(re.sub(r"\{\w+\}", "", pair[0])))
    return [(re.compile(re.sub(r"\\\{(\w+)\\\}", r"(?P<\1>.*)", re.escape(english)), re.DOTALL), told) for english, told in pairs]


def told(sentence: str) -> str:
    """A sentence that was filled in already, in the language of the screens, and what fills it too; as it stands where it is not known.

    Parameters
    ----------
    sentence : str
        English, with its values.
    """
    for pattern, text in findings(_spoken) if _spoken else ():
        if sentence and (found := pattern.fullmatch(sentence)):
            return text.format(**_filled(found))
    return sentence


def _filled(found: re.Match[str]) -> dict[str, str]:
    """Words that fill a sentence, told too; a name that somebody gave (``{a_name}``) stays, though it may be a word of a screen."""
    return {name: value if name.endswith("_name") else told(value) for name, value in found.groupdict().items()}


def spoken() -> str:
    """Language of the screens, "" for English."""
    return _spoken


def line_told(line: str) -> str:
    """A line of a screen in its language: what stands between its indentation, its mark and its end.

    Parameters
    ----------
    line : str
        English, with its values.
    """
    if not _spoken:
        return line
    words = line.lstrip(" !")
    for pattern, text in findings(_spoken, ("sentences",)):
        if words and (found := pattern.fullmatch(words)):
            return line[: len(line) - len(words)] + text.format(**_filled(found))
    return line


def tr(english: str, **values: object) -> str:
    """A text in the language of the screens, its ``{names}`` filled in.

    Parameters
    ----------
    english : str
        Key of the catalogue.
    **values : object
        By the names in the text.

    Returns
    -------
    str
        English where the catalogue does not have it.
    """
    text = _catalogue.get(english, english)
    return text.format(**values) if values else text
