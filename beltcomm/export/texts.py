"""The exported controller as text in three formats, all made from :mod:`beltcomm.export.program`.

No date and no random number: the same controller gives the same text, byte by byte.  C and structured text are ASCII.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence

from beltcomm.borders import for_comment
from beltcomm.configfiles import to_yaml
from beltcomm.errors import UsageError
from beltcomm.export.program import (
    COEFFICIENTS,
    INPUTS,
    LOCALS,
    OUTPUT,
    POSITION_LOOP,
    RESET,
    RESET_INPUTS,
    STATES,
    STEP,
    VELOCITY_LOOP,
    Case,
    Controller,
    Let,
    NamedValue,
    Statement,
    TargetLanguage,
    expression,
)

_WIDTH = 110
_TITLE = "Cascade of position, velocity and torque for a servo drive, discrete, all at the motor shaft."


def text_of(controller: Controller, format_: str) -> str:
    """The controller in one of :data:`FORMATS`.   Raises UsageError for another format."""
    if format_ not in FORMATS:
        raise UsageError(f"there is no format {format_!r}; there are {', '.join(FORMATS)}")
    return FORMATS[format_](controller)


def as_yaml(controller: Controller) -> str:
    """Coefficients with units, states, inputs, and the difference equations in words and symbols."""

    def described(quantities: Iterable[NamedValue], values: Mapping[str, float] | None = None) -> dict[str, dict[str, object]]:
        return {q.name: {**({"value": values[q.name]} if values else {}), "unit": q.unit or "1", "meaning": q.meaning} for q in quantities}

    return to_yaml(
        {
            "what": _TITLE,
            "provenance": dict(controller.provenance),
            "notes": list(controller.notes),
            "coefficients": described(COEFFICIENTS, controller.values),
            "inputs": described(INPUTS),
            "output": described([OUTPUT]),
            "states": described(STATES),
            "intermediate": described(LOCALS),
            "reset": _equations(RESET),
            "position_loop_first": _equations(POSITION_LOOP),
            "velocity_loop_first": _equations(VELOCITY_LOOP),
            "every_period": _equations(STEP),
        }
    )


def _equations(statements: Sequence[Statement]) -> list[dict[str, object]]:
    """Words and the assignments that they stand for; a word without an equation of its own goes on with the one before."""
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
        return [f"{statement.target} = {statement.value}"]
    lines = []
    for number, (condition, inner) in enumerate(statement.branches):
        lines += [f"{'else if' if number else 'if'} {condition}: {let.target} = {let.value}" for let in inner]
    return lines + [f"else: {let.target} = {let.value}" for let in statement.otherwise]


def _heading(controller: Controller, more: Sequence[str]) -> list[str]:
    """Comment above the code: where it comes from, what it computes, what else to know."""
    lines = [_TITLE, ""]
    lines += [f"{word + ':':10} {text}" for word, text in controller.provenance.items()]
    lines += [f"{'period:':10} {controller.values['period_s']!r} s: call it so often, neither more nor less", ""]
    lines += ["What one period computes, in this order:"]
    words = [s.why for s in (*POSITION_LOOP, *STEP) if s.why]
    lines += [f"{number}. {why}" for number, why in enumerate(words, 1)]
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


# C99


def as_c(controller: Controller) -> str:
    """One self-contained C99 file: double, or float with ``-DBELTCOMM_REAL=float``; no library, no memory of its own."""
    one, state, design = "beltcomm_real", "beltcomm_state *s", "const beltcomm_coefficients *c"
    inputs = [f"{one} {q.name}" for q in INPUTS]
    position = _signature(f"{one} beltcomm_position_step", [design, state, *inputs])
    velocity = _signature(f"{one} beltcomm_velocity_step", [design, state, *inputs[1:]])
    reset = _signature("void beltcomm_reset", [state, *(f"{one} {q.name}" for q in RESET_INPUTS)])
    init = _signature("void beltcomm_init", [state])
    early = LOCALS[:2]  # set before the velocity loop, and handed to it
    arguments = [q.name for q in (*early, *INPUTS[1:])]
    loop = _signature(f"static {one} beltcomm_loop", [design, state, *(f"{one} {name}" for name in arguments)])
    call = f"    return beltcomm_loop(c, s, {', '.join(arguments)});"
    heading = _heading(
        controller,
        [
            "Use: beltcomm_init once; beltcomm_reset when the loop is closed; then every period beltcomm_position_step, or "
            "beltcomm_velocity_step for a velocity loop alone, with &beltcomm_design. Compile with -DBELTCOMM_REAL=float for single "
            "precision. It allocates nothing and has no state but what it is given.",
        ],
    )
    lines = ["/*", *(f" * {line}".rstrip() for line in heading), " */", ""]
    lines += ["#ifndef BELTCOMM_REAL", "#define BELTCOMM_REAL double", "#endif", f"typedef BELTCOMM_REAL {one};"]
    lines += ["#define BELTCOMM_C(number) ((beltcomm_real)(number))", ""]
    for name, quantities in (("beltcomm_coefficients", COEFFICIENTS), ("beltcomm_state", STATES)):
        lines += ["typedef struct {", *(f"    {one} {q.name}; /* {for_comment(str(q))} */" for q in quantities), f"}} {name};", ""]
    lines += ["extern const beltcomm_coefficients beltcomm_design;", *(f"{each};" for each in (init, reset, position, velocity)), ""]
    values = [f"    BELTCOMM_C({_number(controller.values[q.name])}), /* {q.name} */" for q in COEFFICIENTS]
    lines += ["const beltcomm_coefficients beltcomm_design = {", *values, "};", ""]
    lines += [f"static {one} beltcomm_min({one} a, {one} b) {{ return b < a ? b : a; }}"]
    lines += [f"static {one} beltcomm_max({one} a, {one} b) {{ return b > a ? b : a; }}", ""]
    lines += [init, "{", *_c([Let(q.name, "0.0") for q in STATES]), "}", "", reset, "{", *_c(RESET), "}", ""]
    lines += [loop, "{", *(f"    {one} {q.name}; /* {for_comment(str(q))} */" for q in (*LOCALS[2:], OUTPUT))]
    lines += [*_c(STEP), f"    return {OUTPUT.name};", "}"]
    for signature, first in ((position, POSITION_LOOP), (velocity, VELOCITY_LOOP)):
        lines += ["", signature, "{", *(f"    {one} {q.name}; /* {for_comment(str(q))} */" for q in early), *_c(first), call, "}"]
    return "\n".join(lines) + "\n"


def _signature(head: str, parameters: Sequence[str]) -> str:
    line = f"{head}({', '.join(parameters)})"
    return line if len(line) <= _WIDTH else f"{head}(\n    " + ",\n    ".join(parameters) + ")"


def _comment(text: str, opening: str, closing: str, pad: str) -> list[str]:
    """A comment on as many lines as it needs."""
    inner = " " * (len(pad) + len(opening) + 1)
    return textwrap.wrap(
        f"{pad}{opening} {for_comment(text)} {closing}", _WIDTH, subsequent_indent=inner, break_long_words=False, break_on_hyphens=False
    )


_KEPT_IN = {**{q.name: f"c->{q.name}" for q in COEFFICIENTS}, **{q.name: f"s->{q.name}" for q in STATES}}
_C_WORDS = TargetLanguage(
    lambda name: _KEPT_IN.get(name, name), lambda x: f"BELTCOMM_C({_number(x)})", "&&", "beltcomm_min", "beltcomm_max"
)


def _c(statements: Sequence[Statement]) -> list[str]:
    lines = []
    for statement in statements:
        if statement.why:
            lines += _comment(statement.why, "/*", "*/", "    ")
        if isinstance(statement, Let):
            lines.append("    " + _c_let(statement))
            continue
        for number, (condition, inner) in enumerate(statement.branches):
            lines.append(f"    {'} else if' if number else 'if'} ({expression(condition, _C_WORDS)}) {{")
            lines += [f"        {_c_let(let)}" for let in inner]
        if statement.otherwise:
            lines += ["    } else {", *(f"        {_c_let(let)}" for let in statement.otherwise)]
        lines.append("    }")
    return lines


def _c_let(let: Let) -> str:
    return f"{_C_WORDS.name(let.target)} = {expression(let.value, _C_WORDS)};"


# IEC 61131-3


def as_structured_text(controller: Controller) -> str:
    """A function block in structured text (IEC 61131-3), LREAL."""
    heading = _heading(
        controller,
        [
            "Use: call the block once every period. RESET TRUE brings it to the present angle and to RESET_VELOCITY_RAD_S, with no torque, "
            "as when the loop is closed; then FALSE. POSITION_LOOP FALSE is the velocity loop alone. A controller without LREAL may "
            "take REAL throughout.",
        ],
    )

    def declared(title: str, quantities: Iterable[NamedValue], values: Mapping[str, float] | None = None) -> list[str]:
        found = [f"    {q.name} : LREAL := {_number((values or {}).get(q.name, 0.0))}; (* {for_comment(str(q))} *)" for q in quantities]
        return [title, *found, "END_VAR"]

    switches = [
        "    reset : BOOL := FALSE; (* begin anew at the present angle *)",
        "    position_loop : BOOL := TRUE; (* FALSE: velocity loop alone *)",
    ]
    inputs = declared("VAR_INPUT", (*INPUTS, RESET_INPUTS[1]))
    choice = Case((("position_loop", POSITION_LOOP),), VELOCITY_LOOP)
    lines = ["(*", *(f"  {line}".rstrip() for line in heading), "*)", "FUNCTION_BLOCK BELTCOMM_CASCADE"]
    lines += [inputs[0], *switches, *inputs[1:]]
    lines += declared("VAR_OUTPUT", [OUTPUT])
    lines += declared("VAR CONSTANT", COEFFICIENTS, controller.values)
    lines += declared("VAR", STATES)
    lines += declared("VAR_TEMP", LOCALS)
    lines += ["", "IF reset THEN", *_st((*RESET, Let(OUTPUT.name, "0.0")), 1), "ELSE", *_st((choice, *STEP), 1), "END_IF;"]
    return "\n".join([*lines, "", "END_FUNCTION_BLOCK"]) + "\n"


def _st(statements: Sequence[Statement], depth: int) -> list[str]:
    lines = []
    pad = "    " * depth
    for statement in statements:
        if statement.why:
            lines += _comment(statement.why, "(*", "*)", pad)
        if isinstance(statement, Let):
            lines.append(f"{pad}{statement.target} := {expression(statement.value, _ST_WORDS)};")
            continue
        for number, (condition, inner) in enumerate(statement.branches):
            lines.append(f"{pad}{'ELSIF' if number else 'IF'} {expression(condition, _ST_WORDS)} THEN")
            lines += _st(inner, depth + 1)
        if statement.otherwise:
            lines += [f"{pad}ELSE", *_st(statement.otherwise, depth + 1)]
        lines.append(f"{pad}END_IF;")
    return lines


def _number(value: float) -> str:
    """A number that comes back exactly, with the decimal point that both languages want."""
    mantissa, e, exponent = repr(float(value)).partition("e")
    return f"{mantissa if '.' in mantissa else f'{mantissa}.0'}{'E' if e else ''}{exponent}"


_ST_WORDS = TargetLanguage(lambda name: name, _number, "AND", "MIN", "MAX")

#: Format -> what makes it.
FORMATS: Mapping[str, Callable[[Controller], str]] = {"yaml": as_yaml, "c": as_c, "st": as_structured_text}
