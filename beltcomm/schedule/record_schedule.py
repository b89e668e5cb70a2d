"""Records of a commissioning beside the first response: the steps, what fits into the time, and the names of the records."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from typing import Literal, NamedTuple

from beltcomm.schedule.steps import PLACES, QUIET, SHORT_S, SLOW_M_S, TRIANGLES_M, Step

Extent = Literal["quick", "standard", "thorough"]
#: Names of the phases of a commissioning, as shown to the user.
TITLES = (
    "connect and check",
    "direction + breakaway",
    "excitation in place, rising",
    "frequency response here",
    "first safe loop",
    "strokes, responses, moves",
    "fit and design",
    "verification move",
    "verdict and report",
)


class Item(NamedTuple):
    """A step and its rank: 0 is always made, the others in the order of their ranks as far as the time goes."""

    step: Step
    rank: int = 0


#: Where and how loud the held-out response is: a place and an amplitude that no fitted record has.
HELD_PLACE, HELD_SHARE = 0.65, 0.7
#: Share of an excitation between loud and quiet.
MIDDLING = 0.5

#: m/s of a short sweep, where the travel allows the fastest of them: three speeds tell Coulomb and viscous friction and leave one to judge.
QUICK_M_S = (0.05, 0.3, 1.5)
#: s that a plateau of it counts at most: half as long as usual, its mean torque is then known to 0.3 % of the rig's friction.
QUICK_PLATEAU_S = 0.3
#: s that a ramp of it may take: of a heavy carriage they took more of the sweep than what counts in it.
QUICK_RAMP_S = 0.3

QUICK = (Item(Step("sweep", speeds_m_s=QUICK_M_S)),)
#: In the order in which they are made; a sweep first and one last, for whatever warms up.
STANDARD = (
    Item(Step("sweep")),
    Item(Step("response", PLACES[0], seconds=SHORT_S)),
    Item(Step("response", PLACES[1], seconds=SHORT_S)),
    Item(Step("response", PLACES[1], QUIET, seconds=SHORT_S), 1),
    Item(Step("strokes", PLACES[1], speeds_m_s=SLOW_M_S[:2]), 7),
    Item(Step("response", HELD_PLACE, HELD_SHARE, seconds=SHORT_S, held_out=True), 3),
    Item(Step("reversals", HELD_PLACE, amplitudes_m=TRIANGLES_M[1:]), 4),
    Item(Step("response", PLACES[2], seconds=SHORT_S)),
    Item(Step("strokes", PLACES[2], speeds_m_s=SLOW_M_S[:1]), 8),
    Item(Step("moves", share=0.8), 5),
    Item(Step("moves", share=0.5, seconds=4.0, seed=1, held_out=True), 6),
    Item(Step("sweep", again=True), 2),
)
THOROUGH = (
    Item(Step("sweep", speeds_m_s=(1.5, 1.0, 0.6))),
    Item(Step("response", PLACES[0])),
    Item(Step("response", PLACES[0], QUIET, seconds=SHORT_S), 2),
    Item(Step("response", PLACES[0], MIDDLING, seconds=SHORT_S), 11),
    Item(Step("response", PLACES[1])),
    Item(Step("response", PLACES[1], QUIET, seconds=SHORT_S), 1),
    Item(Step("response", PLACES[1], MIDDLING, seconds=SHORT_S), 10),
    Item(Step("response", HELD_PLACE, HELD_SHARE, seconds=SHORT_S, held_out=True), 3),
    Item(Step("response", PLACES[2])),
    Item(Step("response", PLACES[2], QUIET, seconds=SHORT_S), 2),
    Item(Step("response", PLACES[2], MIDDLING, seconds=SHORT_S), 11),
    Item(Step("sweep")),
    *(Item(Step("strokes", place, speeds_m_s=SLOW_M_S), 7 + i) for i, place in enumerate(PLACES)),
    Item(Step("reversals", PLACES[1], amplitudes_m=TRIANGLES_M), 4),
    Item(Step("moves", share=0.9), 5),
    Item(Step("moves", share=0.5, seconds=11.0, seed=1, held_out=True), 6),
    Item(Step("sweep", speeds_m_s=(1.5, 0.8, 0.4))),
)
BY_EXTENT = {"quick": QUICK, "standard": STANDARD, "thorough": THOROUGH}
#: s of machine time in all.
BUDGET_S = {"quick": 75.0, "standard": 75.0, "thorough": 180.0}

#: Names of records by kind of step.
NAMES = {"response": "frf", "sweep": "sweep", "strokes": "strokes", "reversals": "reversals", "moves": "moves"}


def quick_speeds_m_s(acceleration_m_s2: float) -> list[float]:
    """Speeds of the short sweep, m/s; all slower in proportion where ramps to the fastest would take too long.

    Parameters
    ----------
    acceleration_m_s2 : float, m/s²
        Of the carriage.
    """
    share = min(1.0, QUICK_RAMP_S * acceleration_m_s2 / max(QUICK_M_S))
    return [share * speed for speed in QUICK_M_S]


def fitting_records(items: Sequence[Item], seconds_of: Callable[[Step], float], budget_s: float) -> tuple[list[Step], list[Step]]:
    """The steps that fit into a time, in the order in which they are made, and those for which there is none.

    Parameters
    ----------
    items : sequence of Item
        Steps with their ranks; rank 0 is always made.
    seconds_of : callable
        Duration of a step, s.
    budget_s : float, s
        For all.
    """
    left = budget_s - sum(seconds_of(item.step) for item in items if item.rank == 0)
    chosen = {i for i, item in enumerate(items) if item.rank == 0}
    for i, item in sorted(enumerate(items), key=lambda pair: pair[1].rank):
        if i in chosen:
            continue
        seconds = seconds_of(item.step)
        if seconds <= left:
            chosen.add(i)
            left -= seconds
    return [item.step for i, item in enumerate(items) if i in chosen], [item.step for i, item in enumerate(items) if i not in chosen]


def named_steps(steps: Sequence[Step], taken: Collection[str] = ()) -> Iterator[tuple[str, Step]]:
    """Names that say the kind and count: ``frf_2``, ``sweep``, ``sweep_2``, ``strokes_1`` ...

    Parameters
    ----------
    steps : sequence of Step
        In their order.
    taken : collection of str
        Names that others have.
    """
    count: dict[str, int] = {}
    for step in steps:
        kind = NAMES[step.kind]
        while True:
            count[kind] = number = count.get(kind, 0) + 1
            name = kind if kind == "sweep" and number == 1 else f"{kind}_{number}"
            if name not in taken:
                break
        yield name, step
