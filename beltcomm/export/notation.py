"""Notation of the exported texts: statements and named values with comments in YAML, C99 and IEC 61131-3, the latter two in ASCII."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence

from beltcomm.borders import for_comment
from beltcomm.export.program import Controller, Let, NamedValue, Statement, TargetLanguage, expression

_WIDTH = 110


def described(quantities: Iterable[NamedValue], values: Mapping[str, float] | None = None) -> dict[str, dict[str, object]]:
    """Named values with unit and meaning, for YAML.

    Parameters
    ----------
    quantities : iterable of NamedValue
        With unit and meaning.
    values : mapping of str to float or None
        By name; None leaves them out.
    """
    return {q.name: {**({"value": values[q.name]} if values else {}), "unit": q.unit or "1", "meaning": q.meaning} for q in quantities}


def equations(statements: Sequence[Statement]) -> list[dict[str, object]]:
    """Words and the assignments that they stand for; a word without an equation of its own goes on with the one before.

    Parameters
    ----------
    statements : sequence of Statement
        In their order.
    """
    found: list[dict[str, object]] = []
    lines: list[str] = []
    for statement in statements:
        if statement.why or not found:
            lines = []
            found.append({"what": statement.why, "equations": lines})
        lines += _plainly(statement)
    return found


def _plainly(statement: Statement) -> list[str]:
    if isinstance(statement, Let):
        return [_together([statement])]
    lines = [
        f"{'else if' if place else 'if'} {condition}: {_together(inner)}" for place, (condition, inner) in enumerate(statement.branches)
    ]
    return [*lines, f"else: {_together(statement.otherwise)}"] if statement.otherwise else lines


def _together(lets: Sequence[Let]) -> str:
    return "; ".join(f"{let.target} = {let.value}" for let in lets)


def heading(controller: Controller, title: str, computed: Sequence[Statement], more: Sequence[str]) -> list[str]:
    """Comment above the code: where it comes from, what it computes, what else to know.

    Parameters
    ----------
    controller : Controller
        With provenance and notes.
    title : str
        First line.
    computed : sequence of Statement
        Statements of one period.
    more : sequence of str
        Lines behind them.
    """
    lines = [title, ""]
    lines += [f"{word + ':':10} {text}" for word, text in controller.provenance.items()]
    lines += [f"{'period:':10} {controller.values['period_s']!r} s: call it so often, neither more nor less", ""]
    lines += ["What one period computes, in this order:"]
    lines += [f"{number}. {why}" for number, why in enumerate((s.why for s in computed if s.why), 1)]
    lines += ["", *more]
    if controller.notes:
        lines += ["", "To know:", *(f"- {note}" for note in controller.notes)]
    wrapped: list[str] = []
    for line in map(_aligned, lines):
        indent = "  " if line[:2] == "- " else "   " if line[:1].isdigit() else ""
        wrapped += textwrap.wrap(line, _WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False) or [""]
    return wrapped


def _aligned(line: str) -> str:
    """As :func:`beltcomm.borders.for_comment`, with the alignment of a word and its text."""
    word, colon, rest = line.partition(": ")
    return f"{for_comment(word)}: {' ' * (len(rest) - len(rest.lstrip()))}{for_comment(rest)}" if colon else for_comment(line)


def _number(value: float) -> str:
    """A number that comes back exactly, with the decimal point that both languages want."""
    mantissa, e, exponent = repr(float(value)).partition("e")
    return f"{mantissa if '.' in mantissa else f'{mantissa}.0'}{'E' if e else ''}{exponent}"


# C99


def c_words(prefix: str, coefficients: Iterable[NamedValue], states: Iterable[NamedValue]) -> TargetLanguage:
    """Notation of a C file whose names begin with ``prefix``; coefficients are kept in ``c``, states in ``s``.

    Parameters
    ----------
    prefix : str
        Of the names in the C file.
    coefficients : iterable of NamedValue
        Kept in ``c``.
    states : iterable of NamedValue
        Kept in ``s``.
    """
    kept = {**{q.name: f"c->{q.name}" for q in coefficients}, **{q.name: f"s->{q.name}" for q in states}}
    constant = f"{prefix.upper()}_C"
    return TargetLanguage(
        lambda name: kept.get(name, name),
        lambda x: f"{constant}({_number(x)})",
        "&&",
        f"{prefix}_min",
        f"{prefix}_max",
        functions={"real": f"({prefix}_real)", "sin": f"{prefix}_sin"},
    )


def c_head(prefix: str, whole: bool = False) -> list[str]:
    """Types and constants of a C file.

    Parameters
    ----------
    prefix : str
        Of the names in the C file.
    whole : bool
        True with whole numbers and the sine.
    """
    one = f"{prefix}_real"
    lines = ["#include <math.h>", "#include <stdint.h>", ""] if whole else []
    lines += ["#ifndef BELTCOMM_REAL", "#define BELTCOMM_REAL double", "#endif", f"typedef BELTCOMM_REAL {one};"]
    return [*lines, f"#define {prefix.upper()}_C(number) (({one})(number))", ""]


def c_functions(prefix: str, *names: str) -> list[str]:
    """Those named of min, max and sin.

    Parameters
    ----------
    prefix : str
        Of the names in the C file.
    *names : str
        "min", "max" or "sin".
    """
    one = f"{prefix}_real"
    found = {
        "min": f"static {one} {prefix}_min({one} a, {one} b) {{ return b < a ? b : a; }}",
        "max": f"static {one} {prefix}_max({one} a, {one} b) {{ return b > a ? b : a; }}",
        "sin": f"static {one} {prefix}_sin({one} a) {{ return ({one})sin((double)a); }}",
    }
    return [found[name] for name in names]


def c_variable(prefix: str, q: NamedValue) -> str:
    """A variable's type and name.

    Parameters
    ----------
    prefix : str
        Of the names in the C file.
    q : NamedValue
        With its name.
    """
    return f"{'int64_t' if q.whole else f'{prefix}_real'} {q.name}"


def c_declared(prefix: str, quantities: Iterable[NamedValue]) -> list[str]:
    """Variables with what they mean, one a line.

    Parameters
    ----------
    prefix : str
        Of the names in the C file.
    quantities : iterable of NamedValue
        With unit and meaning.
    """
    return [f"    {c_variable(prefix, q)}; /* {for_comment(str(q))} */" for q in quantities]


def c_design(prefix: str, coefficients: Sequence[NamedValue], values: Mapping[str, float]) -> list[str]:
    """The coefficients' numbers.

    Parameters
    ----------
    prefix : str
        Of the names in the C file.
    coefficients : sequence of NamedValue
        In their order.
    values : mapping of str to float
        By name.
    """

    def line(q: NamedValue) -> str:
        text = str(int(values[q.name])) if q.whole else f"{prefix.upper()}_C({_number(values[q.name])})"
        return f"    {text}, /* {q.name} */"

    return [f"const {prefix}_coefficients {prefix}_design = {{", *map(line, coefficients), "};", ""]


def signature(head: str, parameters: Sequence[str]) -> str:
    """The head of a C function, on one line or one for each parameter.

    Parameters
    ----------
    head : str
        Up to the parenthesis.
    parameters : sequence of str
        Each with its type.
    """
    line = f"{head}({', '.join(parameters)})"
    return line if len(line) <= _WIDTH else f"{head}(\n    " + ",\n    ".join(parameters) + ")"


def _comment(text: str, opening: str, closing: str, pad: str) -> list[str]:
    """A comment on as many lines as it needs."""
    inner = " " * (len(pad) + len(opening) + 1)
    return textwrap.wrap(
        f"{pad}{opening} {for_comment(text)} {closing}", _WIDTH, subsequent_indent=inner, break_long_words=False, break_on_hyphens=False
    )


def c_statements(statements: Sequence[Statement], words: TargetLanguage) -> list[str]:
    """The body of a C function.

    Parameters
    ----------
    statements : sequence of Statement
        In their order.
    words : TargetLanguage
        Its notation.
    """

    def assigned(let: Let) -> str:
        return f"{words.name(let.target)} = {expression(let.value, words)};"

    lines = []
    for statement in statements:
        if statement.why:
            lines += _comment(statement.why, "/*", "*/", "    ")
        if isinstance(statement, Let):
            lines.append("    " + assigned(statement))
            continue
        for place, (condition, inner) in enumerate(statement.branches):
            lines.append(f"    {'} else if' if place else 'if'} ({expression(condition, words)}) {{")
            lines += [f"        {assigned(let)}" for let in inner]
        if statement.otherwise:
            lines += ["    } else {", *(f"        {assigned(let)}" for let in statement.otherwise)]
        lines.append("    }")
    return lines


# IEC 61131-3

ST_WORDS = TargetLanguage(lambda name: name, _number, "AND", "MIN", "MAX", "=", "<>", {"real": "LINT_TO_LREAL", "sin": "SIN"})


def declared(title: str, quantities: Iterable[NamedValue], values: Mapping[str, float] | None = None) -> list[str]:
    """A section of variables in structured text.

    Parameters
    ----------
    title : str
        First line of the section.
    quantities : iterable of NamedValue
        With unit and meaning.
    values : mapping of str to float or None
        By name, 0 where there is none; None for 0 everywhere.
    """

    def line(q: NamedValue) -> str:
        value = (values or {}).get(q.name, 0.0)
        kind, text = ("LINT", str(int(value))) if q.whole else ("LREAL", _number(value))
        return f"    {q.name} : {kind} := {text}; (* {for_comment(str(q))} *)"

    return [title, *map(line, quantities), "END_VAR"]


def st_statements(statements: Sequence[Statement], depth: int) -> list[str]:
    """The body of a function block in structured text.

    Parameters
    ----------
    statements : sequence of Statement
        In their order.
    depth : int
        Of indentation.
    """
    lines = []
    pad = "    " * depth
    for statement in statements:
        if statement.why:
            lines += _comment(statement.why, "(*", "*)", pad)
        if isinstance(statement, Let):
            lines.append(f"{pad}{statement.target} := {expression(statement.value, ST_WORDS)};")
            continue
        for place, (condition, inner) in enumerate(statement.branches):
            lines.append(f"{pad}{'ELSIF' if place else 'IF'} {expression(condition, ST_WORDS)} THEN")
            lines += st_statements(inner, depth + 1)
        if statement.otherwise:
            lines += [f"{pad}ELSE", *st_statements(statement.otherwise, depth + 1)]
        lines.append(f"{pad}END_IF;")
    return lines
