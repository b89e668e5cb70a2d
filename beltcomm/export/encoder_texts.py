"""Velocity from encoder edges as text in three formats, all made from :mod:`beltcomm.export.encoder_program`."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from beltcomm.configfiles import to_yaml
from beltcomm.export.encoder_program import (
    COEFFICIENTS,
    EDGE,
    EDGE_INPUTS,
    EDGE_LOCALS,
    OUTPUTS,
    PERIOD,
    PERIOD_INPUTS,
    PERIOD_LOCALS,
    RESET,
    RESET_INPUTS,
    STATES,
)
from beltcomm.export.notation import (
    c_declared,
    c_design,
    c_functions,
    c_head,
    c_statements,
    c_variable,
    c_words,
    declared,
    described,
    equations,
    heading,
    signature,
    st_statements,
)
from beltcomm.export.program import Controller, Let

_TITLE = "Position and velocity from the edges of an incremental encoder: state machine, high-pass, event counter, gate, combination."
_PREFIX = "beltcomm_encoder"


def _as_yaml(controller: Controller) -> str:
    """Coefficients with units, states, inputs, and the equations in words and symbols."""
    return to_yaml(
        {
            "what": _TITLE,
            "provenance": dict(controller.provenance),
            "notes": list(controller.notes),
            "coefficients": described(COEFFICIENTS, controller.values),
            "inputs_of_a_change": described(EDGE_INPUTS),
            "inputs_of_a_period": described(PERIOD_INPUTS),
            "outputs": described(OUTPUTS),
            "states": described(STATES),
            "intermediate": described((*EDGE_LOCALS, *PERIOD_LOCALS)),
            "reset": equations(RESET),
            "every_change": equations(EDGE),
            "every_period": equations(PERIOD),
        }
    )


def _as_c(controller: Controller) -> str:
    """One self-contained C99 file: double, or float with ``-DBELTCOMM_REAL=float``, times and counts in 64 bits; no memory of its own."""
    state, design = f"{_PREFIX}_state *s", f"const {_PREFIX}_coefficients *c"
    reset = signature(f"void {_PREFIX}_reset", [state, *(c_variable(_PREFIX, q) for q in RESET_INPUTS)])
    edge = signature(f"void {_PREFIX}_edge", [state, *(c_variable(_PREFIX, q) for q in EDGE_INPUTS)])
    period = signature(f"void {_PREFIX}_period", [design, state, *(c_variable(_PREFIX, q) for q in PERIOD_INPUTS), f"{_PREFIX}_outputs *o"])
    said = heading(
        controller,
        _TITLE,
        (*EDGE, *PERIOD),
        [
            f"Use: {_PREFIX}_reset with the present levels; {_PREFIX}_edge for every tick in which a level has changed, with both levels "
            f"and the time; every period {_PREFIX}_period with &{_PREFIX}_design, not interrupted by the former. Extend a shorter "
            "counter of ticks to 64 bits. Compile with -DBELTCOMM_REAL=float for single precision.",
        ],
    )
    lines = ["/*", *(f" * {line}".rstrip() for line in said), " */", "", *c_head(_PREFIX, whole=True)]
    for name, quantities in (("coefficients", COEFFICIENTS), ("state", STATES), ("outputs", OUTPUTS)):
        lines += ["typedef struct {", *c_declared(_PREFIX, quantities), f"}} {_PREFIX}_{name};", ""]
    lines += [f"extern const {_PREFIX}_coefficients {_PREFIX}_design;", *(f"{each};" for each in (reset, edge, period)), ""]
    lines += [*c_design(_PREFIX, COEFFICIENTS, controller.values), *c_functions(_PREFIX, "max", "sin"), ""]
    words = c_words(_PREFIX, COEFFICIENTS, STATES)
    lines += [reset, "{", *c_declared(_PREFIX, EDGE_LOCALS[:1]), *c_statements(RESET, words), "}", ""]
    lines += [edge, "{", *c_declared(_PREFIX, EDGE_LOCALS), *c_statements(EDGE, words), "}", ""]
    given = [f"    o->{q.name} = {q.name};" for q in OUTPUTS]
    lines += [period, "{", *c_declared(_PREFIX, (*PERIOD_LOCALS, *OUTPUTS)), *c_statements(PERIOD, words), *given, "}"]
    return "\n".join(lines) + "\n"


def _as_structured_text(controller: Controller) -> str:
    """A function block in structured text (IEC 61131-3), LREAL and LINT."""
    said = heading(
        controller,
        _TITLE,
        (*EDGE, *PERIOD),
        [
            "Use: call the block with RESET TRUE and the present levels once; with EDGE TRUE, both levels and the time for every tick in "
            "which a level has changed, as terminals with time stamps give it; with both FALSE at every sampling instant. The outputs are "
            "those of the last sampling instant.",
        ],
    )
    switches = [
        "    reset : BOOL := FALSE; (* begin anew with the present levels *)",
        "    edge : BOOL := FALSE; (* TRUE: a level has changed; FALSE: a sampling instant *)",
    ]
    inputs = declared("VAR_INPUT", (*EDGE_INPUTS, *PERIOD_INPUTS, RESET_INPUTS[-1]))
    lines = ["(*", *(f"  {line}".rstrip() for line in said), "*)", "FUNCTION_BLOCK BELTCOMM_ENCODER"]
    lines += [inputs[0], *switches, *inputs[1:]]
    lines += declared("VAR_OUTPUT", OUTPUTS)
    lines += declared("VAR CONSTANT", COEFFICIENTS, controller.values)
    lines += declared("VAR", STATES)
    lines += declared("VAR_TEMP", (*EDGE_LOCALS, *PERIOD_LOCALS))
    still = [Let(q.name, "0.0") for q in OUTPUTS]
    lines += ["", "IF reset THEN", *st_statements((*RESET, *still), 1), "ELSIF edge THEN", *st_statements(EDGE, 1)]
    lines += ["ELSE", *st_statements(PERIOD, 1), "END_IF;"]
    return "\n".join([*lines, "", "END_FUNCTION_BLOCK"]) + "\n"


#: Format -> what makes it.
FORMATS: Mapping[str, Callable[[Controller], str]] = {"yaml": _as_yaml, "c": _as_c, "st": _as_structured_text}
