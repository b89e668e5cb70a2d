"""Prepares the documentation site: ``python docs/site.py``, then ``mkdocs build --strict -f dist/site/mkdocs.yml``.

README, CONTRIBUTING, CHANGELOG and SECURITY stay where people look for them, and pages link to files of the checkout as a forge shows
them.  A site knows only its own folder, so this copies all pages into one, with their links turned, and the navigation's folders
written out.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path, PurePosixPath
from typing import Any

import yaml

ROOT = Path(__file__).parent.parent
SITE = ROOT / "dist" / "site"
#: Files of the checkout that are pages of the site, where they exist.
OUTSIDE = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "SECURITY.md": "security.md",
    "examples/README.md": "examples.md",
}
#: What of docs/ belongs to the site beside pages and pictures.
ALSO = ("site.css", "example_drive.py")
LINK = re.compile(r"\[([^\]]+)\]\(([^)#\s]+)(#[^)\s]*)?\)")


def sources() -> dict[str, Path]:
    """Every file of the site and where it comes from."""
    docs = ROOT / "docs"
    own = {
        path.relative_to(docs).as_posix(): path
        for path in sorted(docs.rglob("*"))
        if path.suffix in (".md", ".svg", ".png") or path.relative_to(docs).as_posix() in ALSO
    }
    return own | {page: ROOT / file for file, page in OUTSIDE.items() if (ROOT / file).exists()}


def turned(text: str, at: str, source: Path, places: dict[Path, str]) -> str:
    """A page with links that lead to pages of the site; a file of the checkout that is none becomes its path, a wrong link stays wrong."""

    def link(match: re.Match[str]) -> str:
        words, target, anchor = match[1], match[2], match[3] or ""
        if "://" in target:
            return match[0]
        path = (source.parent / target).resolve()
        if path in places:
            return f"[{words}]({'../' * at.count('/')}{places[path]}{anchor})"
        if not path.exists() or not path.is_relative_to(ROOT):
            return match[0]
        inside = path.relative_to(ROOT).as_posix()
        return f"`{inside}`" if PurePosixPath(inside).name in words else f"{words} (`{inside}`)"

    return LINK.sub(link, text)


def expanded(entry: Any, files: dict[str, Path]) -> Any:
    """An entry of the navigation: every folder as its pages, pages that do not exist left out."""
    if isinstance(entry, str):
        return entry
    ((title, content),) = entry.items()
    if isinstance(content, list):
        known = [
            one
            for one in content
            if isinstance(one, str) or isinstance(*one.values(), list) or next(iter(one.values())) not in absent(files)
        ]
        return {title: [expanded(one, files) for one in known]}
    if not content.endswith("/"):
        return entry
    index = f"{content}README.md" if f"{content}README.md" in files else f"{content.rstrip('/')}.md"
    return {title: [index, *(name for name in files if re.fullmatch(rf"{content}[^/]+\.md", name) and name != index)]}


def absent(files: dict[str, Path]) -> set[str]:
    """Pages from outside docs/ that this checkout does not have."""
    return set(OUTSIDE.values()) - set(files)


def prepare() -> None:
    """Write the folder that the site is built from."""
    files = sources()
    places = {path.resolve(): name for name, path in files.items()}
    shutil.rmtree(SITE, ignore_errors=True)
    for name, path in files.items():
        target = SITE / "docs" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".md":
            target.write_text(turned(path.read_text(encoding="utf-8"), name, path, places), encoding="utf-8")
        else:
            shutil.copyfile(path, target)
    settings = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    settings["nav"] = [expanded(entry, files) for entry in settings["nav"]]
    (SITE / "mkdocs.yml").write_text(yaml.safe_dump(settings, sort_keys=False, allow_unicode=True), encoding="utf-8")


if __name__ == "__main__":
    prepare()
