"""One switch for neighbouring effects that are seldom on: a step that asks one switch instead of forty is nearly twice as fast."""

from __future__ import annotations

import re

#: Neighbours that get a switch of their own.
FEWEST = 2
_NAME = re.compile(r"[A-Za-z_]\w*")


def group(lines: list[str], usual: set[str]) -> tuple[list[str], list[str]]:
    """Lines that set the switches, and the lines behind them.

    Parameters
    ----------
    lines : list of str
        Source in which a block that counts only when an effect is on begins with ``if s1:`` or ``if s1 or s2:``.
    usual : set of str
        Switches that are nearly always on; they stay outside.
    """
    switches: list[str] = []
    out: list[str] = []
    run: list[list[str]] = []

    def close() -> None:
        inner = [line for block in run for line in block]
        if len(run) >= FEWEST:
            tests = dict.fromkeys(test for block in run for test in _switches_of(block))
            out.append(f"if some{len(switches)}:")
            switches.append(f"some{len(switches)} = {' or '.join(tests)}")
            inner = indent(inner, 1)
        out.extend(inner)
        run.clear()

    for block in blocks(lines):
        if _switches_of(block) and not usual & set(_switches_of(block)):
            run.append(block)
        else:
            close()
            out.extend(block)
    close()
    return switches, out


def blocks(lines: list[str]) -> list[list[str]]:
    """Lines at the margin, each with those that belong to it.

    Parameters
    ----------
    lines : list of str
        Of a source text.
    """
    found: list[list[str]] = []
    for line in lines:
        if found and (line.startswith(" ") or line == "else:"):
            found[-1].append(line)
        else:
            found.append([line])
    return found


def _switches_of(block: list[str]) -> list[str]:
    """Switches that a block asks; none where it is more than that."""
    head = block[0]
    return head[3:-1].split(" or ") if head.startswith("if s") and head[4:5].isdigit() and "else:" not in block else []


def needed_lines(lines: list[str], behind: list[str]) -> list[str]:
    """Those of the lines ``name = ...`` whose name is asked for by the lines behind them, or by others that are.

    Parameters
    ----------
    lines : list of str
        Assignments, in their order.
    behind : list of str
        Lines that ask for names.
    """
    names, kept = set(_NAME.findall("\n".join(behind))), []
    for line in reversed(lines):
        if line.split(" = ", 1)[0] in names:
            names.update(_NAME.findall(line))
            kept.append(line)
    return kept[::-1]


def indent(lines: list[str], depth: int) -> list[str]:
    """Lines moved in by so many steps.

    Parameters
    ----------
    lines : list of str
        Of a source text.
    depth : int
        Steps of four blanks.
    """
    return ["    " * depth + line for line in lines]
