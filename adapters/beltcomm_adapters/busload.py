"""Cost of a synchronous exchange on a CAN bus, and the period that fits the bit rate."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from beltcomm.drive import GUARD_S
from beltcomm.errors import UsageError
from beltcomm_adapters.exchange import arrangements
from beltcomm_adapters.link import SIGNS_PER_GUARD_TIME
from beltcomm_adapters.profiles import Profile
from beltcomm_adapters.setpoints import layout_of

#: Above this load frames wait for each other longer than a cycle can afford.
LARGEST_LOAD: Final = 0.6
#: Rounding of a period in floating point.
_SAME_S: Final = 1e-9


def _frame_bits(data_bytes: int) -> int:
    """Bits of a frame with an 11-bit identifier on the bus, worst-case stuffing and the space behind it included.

    44 + 8 n bits, of which 34 + 8 n can be stuffed by one bit in four, and 3 of intermission.
    """
    return 47 + 8 * data_bytes + (33 + 8 * data_bytes) // 4


#: A sign of life (remote frame or heartbeat) and the answer to it, in every period of guarding.
_LIFE_BITS: Final = _frame_bits(0) + _frame_bits(1)


def _cycle_s(bitrate: int, frames: Iterable[int]) -> float:
    """Time on the bus, s, of a SYNC and of frames with so many data bytes each."""
    return (_frame_bits(0) + sum(map(_frame_bits, frames))) / bitrate


def fullest(profile: Profile, modes: Iterable[int]) -> tuple[int, ...]:
    """Data bytes of each frame beside SYNC in the fullest exchange that a drive of this kind can be asked for.

    Parameters
    ----------
    profile : Profile
    modes : iterable of int
        Modes of operation that count.
    """
    sent = [sum(bits for *_, bits in entries) // 8 for entries in arrangements(profile.mapped_torque)[0]]
    layouts = [layout_of(mode, profile.offsets) for mode in profile.modes.values() if mode in set(modes)]
    received = [[sum(bits for *_, bits in entries) // 8 for entries in layout.received] for layout in layouts] or [[]]
    return (*max(received, key=lambda frames: sum(map(_frame_bits, frames))), *sent)


@dataclass(frozen=True)
class BusPlan:
    """The period of the exchange, s; its load of the bus, None when that carries any; the choice in words."""

    period_s: float
    load: float | None
    words: str


def plan_exchange(bitrate: int | None, frames: tuple[int, ...], shortest_s: float, step_s: float, wanted_s: float | None = None) -> BusPlan:
    """The shortest period that fits, or the one wanted where it does.

    Parameters
    ----------
    bitrate : int or None
        None when the bus carries any load.
    frames : tuple of int
        As :func:`fullest`.
    shortest_s, step_s : float
        Of the drive.
    wanted_s : float or None
        As asked for.

    Raises
    ------
    UsageError
        For one that is no positive time, or shorter than the drive has.
    """
    if wanted_s is not None:
        if not (math.isfinite(wanted_s) and wanted_s > 0.0):
            raise UsageError(f"a sample period of {wanted_s:g} s cannot be; give a positive time")
        if wanted_s < shortest_s - _SAME_S:
            raise UsageError(
                f"a sample period of {1e3 * wanted_s:g} ms is asked for, this drive has none below {1e3 * shortest_s:g} ms; "
                f"give --sample-period {1e3 * shortest_s:g}ms or more, or leave it out"
            )
    least = max(shortest_s, wanted_s or 0.0)
    busy_s = life = 0.0
    if bitrate is not None:
        busy_s, life = _cycle_s(bitrate, frames), _LIFE_BITS / bitrate * SIGNS_PER_GUARD_TIME / GUARD_S
        if life >= LARGEST_LOAD:
            raise UsageError(f"{bitrate / 1000:g} kbit/s do not even carry the signs of life that guard the axis; set a higher bit rate")
        least = max(least, busy_s / (LARGEST_LOAD - life))
    period_s = shortest_s + math.ceil((least - shortest_s) / step_s - 1e-6) * step_s
    if bitrate is None:
        return BusPlan(period_s, None, f"A SYNC every {1e3 * period_s:g} ms")
    load = busy_s / period_s + life
    words = (
        f"A SYNC every {1e3 * period_s:g} ms: with its frames it takes {1e3 * busy_s:.2f} ms of {bitrate / 1000:g} kbit/s, "
        f"{100 * load:.0f} % of the bus with the signs of life ({100 * LARGEST_LOAD:.0f} % at most)"
    )
    asked_s = wanted_s or shortest_s
    if period_s > asked_s + _SAME_S and busy_s / asked_s + life > LARGEST_LOAD:
        words += f"; {1e3 * asked_s:g} ms would load it with {100 * (busy_s / asked_s + life):.0f} %, a higher bit rate allows more"
    return BusPlan(period_s, load, words)


def shortest_period_s(profile: Profile, modes: Iterable[int], bitrate: int | None, steps_s: tuple[float, float]) -> float:
    """The shortest period of the fullest exchange, s, that a drive of this kind and its bus allow.

    Parameters
    ----------
    profile : Profile
    modes, bitrate, steps_s
        As above.
    """
    return plan_exchange(bitrate, fullest(profile, modes), *steps_s).period_s
