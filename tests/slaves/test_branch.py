"""A process that forks at instants of a command: what a child does is told, and nothing of it stays."""

from __future__ import annotations

from pathlib import Path

from slaves.branch import Branches


def test_a_child_has_its_own_files_and_tells_what_it_found(tmp_path: Path) -> None:
    world = tmp_path / "world"
    world.mkdir()
    branches = Branches(world)
    (world / "kept.txt").write_text("before", encoding="utf-8")
    with (world / "rows.csv").open("w", encoding="utf-8", buffering=1) as rows:
        rows.write("1\n")
        for number in (2, 3):
            if branches.fork():
                rows.write(f"child {number}\n")
                (world / "kept.txt").unlink()
                branches.tell(
                    lambda: {"rows": (world / "rows.csv").read_text(encoding="utf-8"), "left": sorted(p.name for p in world.iterdir())}
                )
            rows.write(f"{number}\n")
    assert (world / "rows.csv").read_text(encoding="utf-8") == "1\n2\n3\n"
    assert (world / "kept.txt").read_text(encoding="utf-8") == "before"
    assert branches.told == [
        {"rows": "1\nchild 2\n", "left": ["rows.csv"]},
        {"rows": "1\n2\nchild 3\n", "left": ["rows.csv"]},
    ]
    assert [path.name for path in tmp_path.iterdir()] == ["world"]


def test_a_child_that_says_nothing_is_told_as_broken(tmp_path: Path) -> None:
    (tmp_path / "world").mkdir()
    branches = Branches(tmp_path / "world")
    if branches.fork():
        branches.tell(lambda: {"raised": 1 / 0})
    assert branches.told == [{"broken": True}]
