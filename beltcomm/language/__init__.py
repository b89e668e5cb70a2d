"""The language of screens: English as written, or another by its catalogue beside this file."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files

#: Languages there is a catalogue for, beside English.
OFFERED = ("de",)
_catalogue: dict[str, str] = {}


def of_environment(environment: Mapping[str, str]) -> str:
    """The language that a shell asks for, two letters; "" for none.   BELTCOMM_LANG comes before LC_ALL, LC_MESSAGES and LANG."""
    for name in ("BELTCOMM_LANG", "LC_ALL", "LC_MESSAGES", "LANG"):
        if value := environment.get(name, ""):
            return value[:2].lower()
    return ""


def use(language: str) -> None:
    """From now on screens speak this language; one that is not offered leaves English."""
    _catalogue.clear()
    if language in OFFERED:
        _catalogue.update(catalogue(language))


def catalogue(language: str) -> Mapping[str, str]:
    """English -> the language's words, as shipped."""
    import yaml

    text = files("beltcomm.language").joinpath(f"{language}.yaml").read_text(encoding="utf-8")
    return {str(key): str(value) for key, value in yaml.safe_load(text).items()}


def tr(english: str, **values: object) -> str:
    """A text in the language of the screens, its ``{names}`` filled in."""
    text = _catalogue.get(english, english)
    return text.format(**values) if values else text
