"""Links between the documents lead somewhere, and no document stands alone."""

from __future__ import annotations

import re
from pathlib import Path

CHECKOUT = Path(__file__).parents[2]
ROOT = [CHECKOUT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "examples/README.md")]
PAGES = [*ROOT, *sorted((CHECKOUT / "docs").rglob("*.md"))]


def targets(page: Path) -> list[Path]:
    """Files that a page links to."""
    links = re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
    return [(page.parent / link).resolve() for link in links if "://" not in link]


def test_links_lead_to_files() -> None:
    dead = {(page.relative_to(CHECKOUT).as_posix(), str(target)) for page in PAGES for target in targets(page) if not target.exists()}
    assert dead == set()


def test_every_document_is_reached_from_the_readme() -> None:
    reached, waiting = set[Path](), [PAGES[0].resolve()]
    while waiting:
        page = waiting.pop()
        page = page / "README.md" if page.is_dir() else page
        if page in reached or page.suffix != ".md":
            continue
        reached.add(page)
        waiting += targets(page)
    assert {page.resolve() for page in PAGES} - reached == set()
