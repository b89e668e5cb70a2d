"""The exported controller as text in three formats, all made from :mod:`beltcomm.export.program`.

No date and no random number: the same controller gives the same text, byte by byte.  C and structured text are ASCII.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from beltcomm.configfiles import to_yaml
from beltcomm.errors import UsageError
from beltcomm.export.notation import (
    c_declared,
    c_design,
    c_functions,
    c_head,
    c_statements,
    c_words,
    declared,
    described,
    equations,
    heading,
    signature,
    st_statements,
)
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
    flat,
)

_TITLE = "Cascade of position, velocity and torque for a servo drive, discrete, all at the motor shaft."


def text_of(controller: Controller, format_: str) -> str:
    """The controller in one of :data:`FORMATS`.

    Parameters
    ----------
    controller : Controller
        Coefficients and statements.
    format_ : str
        Key of :data:`FORMATS`.

    Raises
    ------
    UsageError
        For another format.
    """
    if format_ not in FORMATS:
        raise UsageError(f"there is no format {format_!r}; there are {', '.join(FORMATS)}")
    return FORMATS[format_](controller)


def _as_yaml(controller: Controller) -> str:
    """Coefficients with units, states, inputs, and the difference equations in words and symbols."""
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
            "reset": equations(RESET),
            "position_loop_first": equations(POSITION_LOOP),
            "velocity_loop_first": equations(VELOCITY_LOOP),
            "every_period": equations(STEP),
        }
    )


# C99


def _as_c(controller: Controller) -> str:
    """One self-contained C99 file: double, or float with ``-DBELTCOMM_REAL=float``; no library, no memory of its own."""
    one, state, design = "beltcomm_real", "beltcomm_state *s", "const beltcomm_coefficients *c"
    inputs = [f"{one} {q.name}" for q in INPUTS]
    position = signature(f"{one} beltcomm_position_step", [design, state, *inputs])
    velocity = signature(f"{one} beltcomm_velocity_step", [design, state, *inputs[1:]])
    reset = signature("void beltcomm_reset", [state, *(f"{one} {q.name}" for q in RESET_INPUTS)])
    init = signature("void beltcomm_init", [state])
    early = LOCALS[:2]  # set before the velocity loop, and handed to it
    arguments = [q.name for q in (*early, *INPUTS[1:])]
    loop = signature(f"static {one} beltcomm_loop", [design, state, *(f"{one} {name}" for name in arguments)])
    call = f"    return beltcomm_loop(c, s, {', '.join(arguments)});"
    said = heading(
        controller,
        _TITLE,
        (*POSITION_LOOP, *STEP),
        [
            "Use: beltcomm_init once; beltcomm_reset when the loop is closed; then every period beltcomm_position_step, or "
            "beltcomm_velocity_step for a velocity loop alone, with &beltcomm_design. Compile with -DBELTCOMM_REAL=float for single "
            "precision. It allocates nothing and has no state but what it is given.",
        ],
    )
    lines = ["/*", *(f" * {line}".rstrip() for line in said), " */", ""]
    lines += c_head("beltcomm")
    for name, quantities in (("beltcomm_coefficients", COEFFICIENTS), ("beltcomm_state", STATES)):
        lines += ["typedef struct {", *c_declared("beltcomm", quantities), f"}} {name};", ""]
    lines += ["extern const beltcomm_coefficients beltcomm_design;", *(f"{each};" for each in (init, reset, position, velocity)), ""]
    lines += [*c_design("beltcomm", COEFFICIENTS, controller.values), *c_functions("beltcomm", "min", "max"), ""]
    words = c_words("beltcomm", COEFFICIENTS, STATES)
    lines += [init, "{", *c_statements([Let(q.name, "0.0") for q in STATES], words), "}", ""]
    lines += [reset, "{", *c_statements(RESET, words), "}", ""]
    lines += [loop, "{", *c_declared("beltcomm", (*LOCALS[2:], OUTPUT)), *c_statements(STEP, words), f"    return {OUTPUT.name};", "}"]
    for head, first in ((position, POSITION_LOOP), (velocity, VELOCITY_LOOP)):
        lines += ["", head, "{", *c_declared("beltcomm", early), *c_statements(first, words), call, "}"]
    return "\n".join(lines) + "\n"


# IEC 61131-3


def _as_structured_text(controller: Controller) -> str:
    """A function block in structured text (IEC 61131-3), LREAL."""
    said = heading(
        controller,
        _TITLE,
        (*POSITION_LOOP, *STEP),
        [
            "Use: call the block once every period. RESET TRUE brings it to the present angle and to RESET_VELOCITY_RAD_S, with no torque, "
            "as when the loop is closed; then FALSE. POSITION_LOOP FALSE is the velocity loop alone. A controller without LREAL may "
            "take REAL throughout.",
        ],
    )
    switches = [
        "    reset : BOOL := FALSE; (* begin anew at the present angle *)",
        "    position_loop : BOOL := TRUE; (* FALSE: velocity loop alone *)",
    ]
    inputs = declared("VAR_INPUT", (*INPUTS, RESET_INPUTS[1]))
    choice = Case((("position_loop", (*flat(POSITION_LOOP),)),), (*flat(VELOCITY_LOOP),))
    lines = ["(*", *(f"  {line}".rstrip() for line in said), "*)", "FUNCTION_BLOCK BELTCOMM_CASCADE"]
    lines += [inputs[0], *switches, *inputs[1:]]
    lines += declared("VAR_OUTPUT", [OUTPUT])
    lines += declared("VAR CONSTANT", COEFFICIENTS, controller.values)
    lines += declared("VAR", STATES)
    lines += declared("VAR_TEMP", LOCALS)
    lines += ["", "IF reset THEN", *st_statements((*RESET, Let(OUTPUT.name, "0.0")), 1)]
    lines += ["ELSE", *st_statements((choice, *STEP), 1), "END_IF;"]
    return "\n".join([*lines, "", "END_FUNCTION_BLOCK"]) + "\n"


#: Format -> what makes it.
FORMATS: Mapping[str, Callable[[Controller], str]] = {"yaml": _as_yaml, "c": _as_c, "st": _as_structured_text}
