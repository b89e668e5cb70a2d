"""Any effects beyond the motor, eight stretches or models in lock step, each followed by an observer of its own, which may learn.

The masked kernel of ``compose`` with its ``observer``, written out of the same laws for eight values in a register (``vectors``): a step of
one model waits for the step before it, a step of eight takes hardly longer.  The stretches may have any length: a lane that is through
lets the others go on.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from beltcomm.arrays import Array, BoolArray
from beltcomm.effects import EFFECTS
from beltcomm.simulate.kernels.compose import import_stable
from beltcomm.simulate.kernels.observer import ObserverState
from beltcomm.simulate.kernels.observer_lanes import (
    AIM,
    ASTRAY,
    HALF,
    HURRY,
    LEVER,
    NEW,
    OWN,
    SHUT,
    STIFFNESS,
    WANDER,
    observed_rows,
    observers,
)
from beltcomm.simulate.kernels.switch_groups import blocks, indent, needed_lines
from beltcomm.simulate.kernels.vectors import LANES, address, aligned_zeros
from beltcomm.simulate.kernels.writer import Writer, acts_on_motor

#: Fine steps of each motion that are brought beside the others' at a time: enough to read memory in rows.
AHEAD = 64


class Lane(NamedTuple):
    """The model of one lane.

    Attributes
    ----------
    theta, omega : ndarray (fine,)
        True motion.
    first : float, rad/s
        Speed at which all begins.
    time_s : float, s
        Session clock there.
    bristle_m : float, m
        In which motor friction turns round.
    p : ndarray
        Of the masked kernel, see ``switchboard``.
    watch : ObserverState
        The results stand in it.
    """

    theta: Array
    omega: Array
    first: float
    time_s: float
    bristle_m: float
    p: Array
    watch: ObserverState


def lock_step(lanes: Sequence[Lane], on: BoolArray, step_s: float) -> None:
    """Eight lanes at most, the longest first, with one number of fine steps a sample, one transmission and the same effects.

    Whether the observers learn is the same in all.

    Parameters
    ----------
    lanes : sequence of Lane
        With motion, parameters and observer.
    on : ndarray of bool
        Effects of the catalogue that are on beyond the motor.
    step_s : float, s
        Fine step.
    """
    padded = [*lanes, *(lanes[-1],) * (LANES - len(lanes))]
    watch = lanes[0].watch
    lengths = np.array([len(lane.theta) for lane in lanes])
    known: dict[int, int] = {}
    where = np.array([_addresses(lane, known) for lane in padded], dtype=np.int64).T.copy()
    memory = aligned_zeros(OWN, LANES)
    for row, numbers in zip(
        (HALF, STIFFNESS, WANDER, HURRY), zip(*(observed_rows(lane.watch) for lane in padded), strict=True), strict=True
    ):
        memory[row // LANES] = numbers
    masses, ratio = _places()
    p = np.array([lane.p for lane in padded]).T
    light = np.divide(1.0, p[masses], out=np.zeros((len(masses), LANES)), where=p[masses] > 0.0)
    begins = np.array([(lane.first, lane.time_s, lane.bristle_m) for lane in padded]).T
    values = aligned_zeros(len(p) + len(light) + len(begins), LANES)
    values[:] = np.concatenate((p, light, begins))
    bodies, cart = np.asarray(watch.places), (watch.cart, watch.cart + watch.behind)
    following, course = observers([lane.watch for lane in padded]), aligned_zeros(2 * AHEAD, LANES).reshape(2, AHEAD, LANES)
    at_once = (where, lengths, values.ravel(), on, step_s, float(p[ratio, 0]), watch.substeps, bodies, watch.behind, cart, watch.learning)
    _kernel()(*at_once, *following, course, memory.ravel())


def _addresses(lane: Lane, known: dict[int, int]) -> list[int]:
    """Of everything that a lane has for each step or sample.   Raises ValueError where one of them is too short: nothing else would.

    known : addresses by identity; lanes share many.
    """
    w = lane.watch
    samples = (w.wanted, w.keep, w.held, w.lost, w.forgets, w.gains, w.deviations, w.shares, w.left, w.white)
    if len(lane.omega) != len(lane.theta) or any(len(array) <= (len(lane.theta) - 1) // w.substeps for array in samples):
        raise ValueError("a motion and its observer must have one length")
    arrays = (lane.theta, lane.omega, *samples)
    for array in arrays:
        if id(array) not in known:
            known[id(array)] = address(array)
    return [known[id(array)] for array in arrays]


def _writer() -> Writer:
    return Writer.masked_kernel((e for e in EFFECTS if not acts_on_motor(e) or e.slot == "friction_onset"), in_vectors=True)


@lru_cache(maxsize=1)
def _places() -> tuple[list[int], int]:
    """Places of all masses and of the transmission in the vector of parameters."""
    writer = _writer()
    return [writer.place[name] for name, _ in writer.bodies], writer.place["transmission.ratio"]


@lru_cache(maxsize=1)
def _kernel() -> Callable[..., None]:
    kernel: Callable[..., None] = import_stable(_lock_step_source()).together
    return kernel


def _lock_step_source() -> str:
    """Python source of the kernel."""
    writer = _writer()
    others, driven, onset = range(1, len(writer.bodies)), writer.driven, writer.onsets()[0]
    groups, follow_up = writer.group_effects(_drop_switch(writer.follow_up(), "belt"))
    correct = []
    for i in others:
        moved = [f"{name}{i} = {name}{i} - at(memory, {place}{i})" for name, place in (("q", "at"), ("v", "to"), ("o", "to"))]
        correct += [f"if see{i}:", *indent([*moved, f"put(memory, at{i}, nothing)", f"put(memory, to{i}, nothing)"], 1)]
    cart = writer.cart
    turn = [
        "step = ratio * (at(course, there) - q0)",
        f"if s{writer.switch[onset.name]}:", "    " + writer.turn(0, "step"),
        "else:", "    z0 = least(1.0, most(-1.0, z0 + step / bristle))",
    ]  # fmt: skip
    loaded = " or ".join(f"s{writer.switch[e.name]}" for e in writer.with_level(0))
    body = [
        "active, block = lengths.shape[0], course.shape[1]",
        "brought(0, active, where, lengths, course)",
        "q0 = at(course, 0)",
        *([] if driven is None else [f"q{driven} = {writer.start(driven)}", f"v{driven} = {writer.follow(driven)}"]),
        *writer.driving_end("v"),
        *[f"q{i} = {writer.start(i)}" for i in others],
        *[line for i in others for line in (f"v{i} = {writer.follow(i)}", f"o{i} = v{i}")],
        "now = later = new = shut = nothing",
        "j, here = 0, block - 1",
        "for i in range(lengths[0]):",
        *indent([
            "while i >= lengths[active - 1]:",
            "    active -= 1",
            "simpson = (4.0 if j % 2 else 2.0) / (3.0 * substeps * substeps)",
            "falling, rising = simpson * (substeps - j), simpson * j",
            "here += 1",
            "if here == block:",
            "    here = 0",
            "    brought(i, active, where, lengths, course)",
            f"there = {LANES} * here",
            f"if {loaded}:",
            *indent(turn, 1),
            "q0 = at(course, there)", f"v0 = at(course, there + {LANES} * block)",
            *follow_up,
            "load = l0 * z0 - f0",
            "now = now + falling * load", "later = later + rising * load",
            "if i > 0:",
            "    shut = shut + closed",
            "if j == 0 and i > 0:",
            *indent([
                f"put(s, {NEW}, new)", f"put(s, {SHUT}, shut)", f"put(s, {LEVER}, lever)",
                "shut = nothing",
                "advance_sample(i // substeps - 1, active, substeps, learning, where, s, rows, memory, passes, reaches, cart)",
                *correct,
                f"q{cart} = either(at(s, {ASTRAY}) > 0.0, u - at(s, {AIM}), q{cart})",
            ], 1),
            *_drop_switch([line for i in others for line in writer.with_body(i, [f"q{i} += h * v{i}"])], "belt"),
            "t += h",
            "j += 1",
            "if j == substeps:",
            "    j = 0",
            "    new = now",
            "    now = later",
            "    later = nothing",
        ], 1),
    ]  # fmt: skip
    given = "where, lengths, values, on, h, ratio, substeps, bodies, behind, cart, learning, rows, memory, passes, reaches, course, s"
    text = _broadcast_constants([*needed_lines([*_model_lines(writer), *groups, *_body_lines(others)], body), *body])
    return writer.assemble([["@in_lanes", f"def together({given}):", *indent(["nothing = eight(0.0)", *text], 1)]])


def _model_lines(writer: Writer) -> list[str]:
    """Lines that bring what the models know and how all begins."""
    bodies, size = range(len(writer.bodies)), max(writer.place.values()) + 1
    names = [*(f"n{i}" for i in bodies), "first", "t", "bristle"]
    lines = [f"p{place} = at(values, {LANES * place})" for place in writer.place.values()]
    lines += [f"{name} = at(values, {LANES * place})" for place, name in enumerate(names, start=size)]
    lines += [f"s{writer.switch[e.name]} = on[{writer.switch[e.name]}]" for e in writer.effects]
    lines += [f"{name}{i} = nothing" for i in bodies for name in ("q", "v", "w", "o")]
    return lines + [f"z{i} = nothing" for i in writer.onsets()]


def _body_lines(others: Iterable[int]) -> list[str]:
    """Lines that say which bodies the observers know, and where their position and speed stand in the memory."""
    lines = []
    for i in others:
        lines += [f"see{i} = bodies[{i}] >= 0", f"at{i} = {LANES} * (rows.states + bodies[{i}])", f"to{i} = at{i} + {LANES} * behind"]
    return lines


def _broadcast_constants(lines: Sequence[str]) -> list[str]:
    """Lines in which a name that is set to a number is set to eight of them."""
    return [re.sub(r"^(\s*\w+ = )(-?\d+\.\d+)$", r"\1eight(\2)", line).replace("max(", "most(").replace("min(", "least(") for line in lines]


def _drop_switch(lines: Sequence[str], switch: str) -> list[str]:
    """Lines without the question for a switch that is always on."""
    out: list[str] = []
    for block in blocks(list(lines)):
        end = block.index("else:") if "else:" in block else len(block)
        yes, no = ([line[4:] for line in part] for part in (block[1:end], block[end + 1 :]))
        if block[0] == f"if {switch}:":
            out += _drop_switch(yes, switch)
        elif yes:
            out += [block[0], *indent(_drop_switch(yes, switch), 1)]
            out += ["else:", *indent(_drop_switch(no, switch), 1)] if no else []
        else:
            out += block
    return out
