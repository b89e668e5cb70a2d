"""How checks ask, and how they tell what deviates."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from independent.master import Master, Refusal

Draw = np.random.Generator
Check = Callable[[Master, Draw], list[str]]


def refusal_of(call: Callable[[], object]) -> Refusal | None:
    """What a call is refused with."""
    try:
        call()
    except Refusal as refusal:
        return refusal
    return None


def wrong_code(what: str, call: Callable[[], object], *codes: int, at: tuple[int, int] | None = None) -> list[str]:
    """Deviations of a refusal that must come."""
    refusal = refusal_of(call)
    if refusal is None:
        return [f"{what} is not refused"]
    wrong = [] if refusal.code in codes else [f"{what} is refused with {refusal.code:08X}h, not {' or '.join(f'{c:08X}h' for c in codes)}"]
    if at is not None and (refusal.index, refusal.subindex) != at:
        wrong.append(f"{what}: the abort names {refusal.index:04X}h:{refusal.subindex}")
    return wrong
