"""The discrete cascade as data: its coefficients, states, inputs and statements, from which every exported text is made.

The statements are those of :mod:`beltcomm.control.cascade_kernel`, one by one and in its order of operations, in a language of assignments
and cases with Python's expressions: names, numbers, ``+ - * /``, comparisons, ``and``, ``min``, ``max``, and where whole numbers count
(:mod:`beltcomm.export.encoder_program`) ``==``, ``!=``, ``real`` of one, ``sin``.
All quantities at the motor shaft.

Sources: figure 4.1, (4.1), (4.3), (4.6), (4.16), (4.17), (6.1), (6.25), (6.26).
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import takewhile

from beltcomm.control import Cascade, discrete_coefficients
from beltcomm.errors import UsageError


@dataclass(frozen=True)
class NamedValue:
    """One named number.

    Attributes
    ----------
    unit : str
        In ASCII, "" for none.
    meaning : str
        In words.
    whole : bool
        A whole number of 64 bits.
    """

    name: str
    unit: str
    meaning: str
    whole: bool = False

    def __str__(self) -> str:
        return f"{self.meaning} [{self.unit}]" if self.unit else self.meaning


@dataclass(frozen=True)
class Let:
    """``target = value``.

    Attributes
    ----------
    why : str
        The equation in words, "" where the one before it says it.
    """

    target: str
    value: str
    why: str = ""


@dataclass(frozen=True)
class Case:
    """The statements of the first condition that holds, else ``otherwise``.

    Attributes
    ----------
    why : str
        In words.
    """

    branches: tuple[tuple[str, tuple[Let, ...]], ...]
    otherwise: tuple[Let, ...] = ()
    why: str = ""


Statement = Let | Case


def statements(text: str) -> tuple[Statement, ...]:
    """Statements from their text in Python's form; a comment above one is its ``why``.

    Parameters
    ----------
    text : str
        Assignments and cases.
    """
    lines = [line.strip() for line in text.splitlines()]

    def said(node: ast.AST) -> str:
        return " ".join((ast.get_source_segment(text, node) or "").split())

    def why(node: ast.stmt) -> str:
        above = takewhile(lambda line: line.startswith("# "), reversed(lines[: node.lineno - 1]))
        return " ".join(line[2:] for line in reversed([*above]))

    def lets(body: Sequence[ast.stmt]) -> tuple[Let, ...]:
        return tuple(Let(said(node.targets[0]), said(node.value), why(node)) for node in body if isinstance(node, ast.Assign))

    def case(node: ast.If) -> Case:
        branches, rest = [(said(node.test), lets(node.body))], node.orelse
        while rest and isinstance(rest[0], ast.If):
            branches.append((said(rest[0].test), lets(rest[0].body)))
            rest = rest[0].orelse
        return Case(tuple(branches), lets(rest), why(node))

    return tuple(one for node in ast.parse(text).body for one in ([case(node)] if isinstance(node, ast.If) else lets([node])))


#: In the order of :func:`beltcomm.control.discrete_coefficients`.
COEFFICIENTS = (
    NamedValue("period_s", "s", "sampling period T of the loop"),
    NamedValue("kp_nm_s_rad", "N m s/rad", "velocity controller K_P"),
    NamedValue("ki_nm_rad", "N m/rad", "velocity controller K_I"),
    NamedValue("kpp_1_s", "1/s", "position controller K_PP"),
    NamedValue("velocity_filter_s", "s", "time constant T_R of the velocity measurement"),
    NamedValue("filter_reference", "", "1: the reference velocity is filtered as the measured one, 0: not"),
    NamedValue("prefilter_b0", "", "prefilter (b0 + b1/z + b2/z^2)/(1 + a1/z + a2/z^2)"),
    NamedValue("prefilter_b1", "", "prefilter"),
    NamedValue("prefilter_b2", "", "prefilter"),
    NamedValue("prefilter_a1", "", "prefilter"),
    NamedValue("prefilter_a2", "", "prefilter"),
    NamedValue("ff_inertia_kg_m2", "kg m2", "feedforward: inertia, motor and carriage"),
    NamedValue("ff_viscous_nm_s_rad", "N m s/rad", "feedforward: viscous friction"),
    NamedValue("ff_coulomb_nm", "N m", "feedforward: Coulomb friction"),
    NamedValue("ff_offset_nm", "N m", "feedforward: constant torque"),
    NamedValue("ff_velocity", "", "share K_v of the reference velocity that the position loop hands on"),
    NamedValue("torque_limit_nm", "N m", "largest torque, either way"),
    NamedValue("ff_advance_s", "s", "how far ahead the feedforward is computed"),
    NamedValue("low_pass_b0", "", "additional low-pass against further resonances, as the prefilter; 1, 0, 0, 0, 0 for none"),
    NamedValue("low_pass_b1", "", "additional low-pass"),
    NamedValue("low_pass_b2", "", "additional low-pass"),
    NamedValue("low_pass_a1", "", "additional low-pass"),
    NamedValue("low_pass_a2", "", "additional low-pass"),
)
#: In the order of the state of :mod:`beltcomm.control.cascade_kernel`.
STATES = (
    NamedValue("last_position_rad", "rad", "motor angle of the step before"),
    NamedValue("measured_velocity_rad_s", "rad/s", "measured velocity"),
    NamedValue("last_compared_rad_s", "rad/s", "reference velocity of the step before"),
    NamedValue("filtered_reference_rad_s", "rad/s", "filtered reference velocity"),
    NamedValue("prefilter_1", "rad/s", "first state of the prefilter, transposed direct form II"),
    NamedValue("prefilter_2", "rad/s", "second state of the prefilter"),
    NamedValue("integral_rad", "rad", "integrator of the velocity error"),
    NamedValue("last_acceleration_rad_s2", "rad/s2", "reference acceleration of the step before"),
    NamedValue("low_pass_1", "rad/s", "first state of the additional low-pass, transposed direct form II"),
    NamedValue("low_pass_2", "rad/s", "second state of the additional low-pass"),
)
INPUTS = (
    NamedValue("reference_position_rad", "rad", "reference of the motor angle"),
    NamedValue("reference_velocity_rad_s", "rad/s", "reference of the velocity"),
    NamedValue(
        "reference_acceleration_rad_s2", "rad/s2", "reference of the acceleration: difference of the reference velocity over one period"
    ),
    NamedValue("position_rad", "rad", "measured motor angle"),
    NamedValue("extra_torque_nm", "N m", "torque that is added to the feedforward"),
)
RESET_INPUTS = (INPUTS[3], NamedValue("reset_velocity_rad_s", "rad/s", "velocity at the moment of the reset"))
OUTPUT = NamedValue("torque_nm", "N m", "torque setpoint")
LOCALS = (
    NamedValue("position_term_rad_s", "rad/s", "part of the velocity error that comes from the position error"),
    NamedValue("compared_rad_s", "rad/s", "reference velocity that is compared with the measured one"),
    NamedValue("pole", "", "pole of the velocity filter"),
    NamedValue("raw_error_rad_s", "rad/s", "velocity error"),
    NamedValue("filtered_error_rad_s", "rad/s", "velocity error behind the prefilter"),
    NamedValue("error_rad_s", "rad/s", "velocity error behind the additional low-pass"),
    NamedValue("ahead", "", "advance of the feedforward in periods"),
    NamedValue("change_rad_s2", "rad/s2", "change of the reference acceleration over one period"),
    NamedValue("ff_velocity_rad_s", "rad/s", "reference velocity when the torque acts"),
    NamedValue("ff_acceleration_rad_s2", "rad/s2", "reference acceleration when the torque acts"),
    NamedValue("direction", "", "sign of that velocity"),
    NamedValue("feedforward_nm", "N m", "feedforward torque"),
    NamedValue("demand_nm", "N m", "torque before the limit"),
    NamedValue("next_integral_rad", "rad", "integrator after this step"),
    NamedValue("next_demand_nm", "N m", "torque that this error leads to with the integrator moved on"),
)

#: What comes first in a position loop, and in a velocity loop alone.
POSITION_LOOP = statements("""
# Position controller: K_PP times the position error; the reference velocity is handed on times K_v.
position_term_rad_s = kpp_1_s * (reference_position_rad - position_rad)
compared_rad_s = ff_velocity * reference_velocity_rad_s
""")
VELOCITY_LOOP = statements("""
# Velocity loop alone: no position error, the whole reference velocity.
position_term_rad_s = 0.0
compared_rad_s = reference_velocity_rad_s
""")
RESET = statements("""
# Only the position and the measured velocity are remembered.
last_position_rad = position_rad
measured_velocity_rad_s = reset_velocity_rad_s
last_compared_rad_s = reset_velocity_rad_s
filtered_reference_rad_s = reset_velocity_rad_s
prefilter_1 = 0.0
prefilter_2 = 0.0
integral_rad = 0.0
last_acceleration_rad_s2 = 0.0
low_pass_1 = 0.0
low_pass_2 = 0.0
""")
#: One period of the velocity loop.
STEP = statements("""
# Measured velocity (6.1): backward difference of the angle behind a first-order lag.
pole = velocity_filter_s / (velocity_filter_s + period_s)
measured_velocity_rad_s = pole * measured_velocity_rad_s + (1.0 - pole) * (position_rad - last_position_rad) / period_s
last_position_rad = position_rad
# Reference velocity: mean over the period behind the same lag, so that both lag alike; or as it is.
if filter_reference > 0.0:
    filtered_reference_rad_s = pole * filtered_reference_rad_s + (1.0 - pole) * (0.5 * (compared_rad_s + last_compared_rad_s))
else:
    filtered_reference_rad_s = compared_rad_s
last_compared_rad_s = compared_rad_s
# Velocity error, and the prefilter (4.1), (4.3) as a biquad in transposed direct form II.
raw_error_rad_s = position_term_rad_s + filtered_reference_rad_s - measured_velocity_rad_s
filtered_error_rad_s = prefilter_b0 * raw_error_rad_s + prefilter_1
prefilter_1 = prefilter_b1 * raw_error_rad_s - prefilter_a1 * filtered_error_rad_s + prefilter_2
prefilter_2 = prefilter_b2 * raw_error_rad_s - prefilter_a2 * filtered_error_rad_s
# Additional low-pass behind it, of the same form.
error_rad_s = low_pass_b0 * filtered_error_rad_s + low_pass_1
low_pass_1 = low_pass_b1 * filtered_error_rad_s - low_pass_a1 * error_rad_s + low_pass_2
low_pass_2 = low_pass_b2 * filtered_error_rad_s - low_pass_a2 * error_rad_s
# Reference as it will be when the torque acts: extrapolated along constant jerk. The acceleration comes as a difference over one period,
# so it is half a period old.
ahead = ff_advance_s / period_s
change_rad_s2 = reference_acceleration_rad_s2 - last_acceleration_rad_s2
last_acceleration_rad_s2 = reference_acceleration_rad_s2
ff_velocity_rad_s = reference_velocity_rad_s
ff_acceleration_rad_s2 = reference_acceleration_rad_s2
if ahead > 0.0:
    ff_velocity_rad_s = reference_velocity_rad_s + ff_advance_s * (reference_acceleration_rad_s2 + 0.5 * (1.0 + ahead) * change_rad_s2)
    ff_acceleration_rad_s2 = reference_acceleration_rad_s2 + (0.5 + ahead) * change_rad_s2
# Feedforward (4.16): inertia, viscous and Coulomb friction, constant torque.
direction = 0.0
if ff_velocity_rad_s > 0.0:
    direction = 1.0
elif ff_velocity_rad_s < 0.0:
    direction = -1.0
feedforward_nm = (
    ff_inertia_kg_m2 * ff_acceleration_rad_s2 + ff_viscous_nm_s_rad * ff_velocity_rad_s + ff_coulomb_nm * direction + ff_offset_nm +
    extra_torque_nm
)
# PI velocity controller (4.6).
demand_nm = kp_nm_s_rad * error_rad_s + ki_nm_rad * integral_rad + feedforward_nm
# Integrator (6.25) with conditional integration (6.26): where the torque would pass its limit, the integrator is set so that the limit is
# just met, and only ever discharged.
next_integral_rad = integral_rad + period_s * error_rad_s
next_demand_nm = kp_nm_s_rad * error_rad_s + ki_nm_rad * next_integral_rad + feedforward_nm
if ki_nm_rad > 0.0 and next_demand_nm >= torque_limit_nm and error_rad_s > 0.0:
    next_integral_rad = (
        min(next_integral_rad, max((torque_limit_nm - kp_nm_s_rad * error_rad_s - feedforward_nm) / ki_nm_rad, min(integral_rad, 0.0)))
    )
elif ki_nm_rad > 0.0 and next_demand_nm <= -torque_limit_nm and error_rad_s < 0.0:
    next_integral_rad = (
        max(next_integral_rad, min((-torque_limit_nm - kp_nm_s_rad * error_rad_s - feedforward_nm) / ki_nm_rad, max(integral_rad, 0.0)))
    )
integral_rad = next_integral_rad
# Torque setpoint, limited.
torque_nm = min(max(demand_nm, -torque_limit_nm), torque_limit_nm)
""")


@dataclass(frozen=True)
class Controller:
    """Controller to be exported: the numbers, where they come from, and what else to know.

    Attributes
    ----------
    values : Mapping[str, float]
        Coefficient -> SI value, in the order of :data:`COEFFICIENTS`.
    provenance : Mapping[str, str]
        Word -> text.
    notes : sequence of str
        Sentences.
    """

    values: Mapping[str, float]
    provenance: Mapping[str, str] = field(default_factory=dict)
    notes: Sequence[str] = ()


def controller_of(
    cascade: Cascade, period_s: float, torque_limit_nm: float, provenance: Mapping[str, str], notes: Sequence[str]
) -> Controller:
    """The exported form of a cascade.

    Parameters
    ----------
    cascade : Cascade
    period_s : float, s
    torque_limit_nm : float, N m
        Motor shaft.
    provenance : mapping of str to str
        Where the numbers are from.
    notes : sequence of str
        Sentences for the head of the file.

    Raises
    ------
    UsageError
        As :func:`beltcomm.control.discrete_coefficients`, or for a number that no text can hold.
    """
    numbers = discrete_coefficients(cascade, period_s, torque_limit_nm)
    values = {quantity.name: float(number) for quantity, number in zip(COEFFICIENTS, numbers, strict=True)}
    for quantity in COEFFICIENTS:
        if not abs(values[quantity.name]) < 1e30:  # beyond that a float has no room; nan too
            raise UsageError(f"{quantity.meaning} is {values[quantity.name]}, which cannot be exported; give a finite number")
    return Controller(values, provenance, notes)


def expression(text: str, words: TargetLanguage) -> str:
    """An expression in another language.

    Parameters
    ----------
    text : str
        In Python's form.
    words : TargetLanguage
        Its notation.

    Raises
    ------
    ValueError
        For what the language of this module does not have.
    """
    return _said(ast.parse(text, mode="eval").body, words)[0]


@dataclass(frozen=True)
class TargetLanguage:
    """Notation of a target language for names, numbers, conjunctions, the smaller or larger of two, equality, functions of one number."""

    name: Callable[[str], str]
    number: Callable[[float], str]
    conjunction: str
    least: str
    most: str
    equal: str = "=="
    unequal: str = "!="
    functions: Mapping[str, str] = field(default_factory=dict)


_SIGNS: Mapping[type[ast.AST], tuple[str, int]] = {
    ast.Add: ("+", 3), ast.Sub: ("-", 3), ast.Mult: ("*", 4), ast.Div: ("/", 4),
    ast.Gt: (">", 2), ast.GtE: (">=", 2), ast.Lt: ("<", 2), ast.LtE: ("<=", 2),
}  # fmt: skip
_ATOM = 9


def _said(node: ast.expr, words: TargetLanguage) -> tuple[str, int]:
    """Text and how firmly it holds together; operands of less firmness get parentheses, as do right ones of the same."""
    match node:
        case ast.Name(id=name):
            return words.name(name), _ATOM
        case ast.Constant(value=float(number)):
            return words.number(number), _ATOM
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=float(number))):
            return words.number(-number), _ATOM
        case ast.UnaryOp(op=ast.USub(), operand=inner):
            return f"-{_inside(inner, words, _ATOM)}", 5
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _SIGNS:
            sign, firm = _SIGNS[type(op)]
            return f"{_inside(left, words, firm)} {sign} {_inside(right, words, firm + 1)}", firm
        case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _SIGNS:
            sign, firm = _SIGNS[type(op)]
            return f"{_inside(left, words, firm + 1)} {sign} {_inside(right, words, firm + 1)}", firm
        case ast.Constant(value=int(number)) if not isinstance(number, bool):
            return str(number), _ATOM
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int(number))) if not isinstance(number, bool):
            return str(-number), _ATOM
        case ast.Compare(left=left, ops=[(ast.Eq() | ast.NotEq()) as op], comparators=[right]):
            sign = words.equal if isinstance(op, ast.Eq) else words.unequal
            return f"{_inside(left, words, 3)} {sign} {_inside(right, words, 3)}", 2
        case ast.Call(func=ast.Name(id=name), args=[one]) if name in words.functions:
            return f"{words.functions[name]}({_said(one, words)[0]})", _ATOM
        case ast.BoolOp(op=ast.And(), values=values):
            # each in parentheses, because languages differ in what binds firmer
            return f" {words.conjunction} ".join(f"({_said(value, words)[0]})" for value in values), 1
        case ast.Call(func=ast.Name(id=name), args=[first, second]) if name in ("min", "max"):
            function = words.least if name == "min" else words.most
            return f"{function}({_said(first, words)[0]}, {_said(second, words)[0]})", _ATOM
        case _:
            raise ValueError(f"an exported equation cannot hold {ast.unparse(node)}")


def _inside(node: ast.expr, words: TargetLanguage, least: int) -> str:
    text, firm = _said(node, words)
    return text if firm >= least else f"({text})"


def flat(statements: Sequence[Statement]) -> Iterator[Let]:
    """All assignments, those inside cases too, in order.

    Parameters
    ----------
    statements : sequence of Statement
        In their order.
    """
    for statement in statements:
        if isinstance(statement, Let):
            yield statement
        else:
            for _, inner in statement.branches:
                yield from inner
            yield from statement.otherwise
