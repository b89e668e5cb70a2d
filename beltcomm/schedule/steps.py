"""One record of a plan: what a commissioning, ``identify --plan`` and ``diagnose --next`` have in common."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from beltcomm.errors import UsageError

Kind = Literal["response", "strokes", "sweep", "reversals", "moves"]

#: What a step of a kind may say beside its kind.
KEYS: Mapping[str, tuple[str, ...]] = {
    "response": ("place", "share", "seconds", "up_to_hz", "held_out"),
    "strokes": ("place", "speeds_m_s", "held_out"),
    "sweep": ("speeds_m_s", "again", "held_out"),
    "reversals": ("place", "amplitudes_m", "held_out"),
    "moves": ("share", "seconds", "seed", "held_out"),
}
#: Where along the travel, as shares of it.
PLACES = (0.12, 0.5, 0.88)
#: s: a short response.
SHORT_S = 5.0
#: Shares of what the limits allow: as much as possible, and little enough that gaps and elastic friction show.
LOUD, QUIET = 1.0, 0.1
#: m/s of the slowest strokes: grease lubricates otherwise there.
SLOW_M_S = (0.01, 0.03, 0.06)
#: m: triangles around one place, large to small; the smallest are turned round within elastic friction.
TRIANGLES_M = (2e-3, 1e-3, 4e-4, 2e-4)
#: m, longest triangle: more is a stroke.
LONGEST_TRIANGLE_M = 2e-2
#: s, longest record of a step.
LONGEST_S = 60.0
#: m/s: fastest stroke that a plan may name, as fast as an axis file may; numbers of one step; the largest seed.
FASTEST_M_S, MOST_VALUES, LARGEST_SEED = 100.0, 50, 2**32 - 1
#: Hz, highest band that a response may be asked for; a drive that is sampled too slowly for it refuses by itself.
HIGHEST_HZ = 1000.0


@dataclass(frozen=True)
class Step:
    """One record.

    Attributes
    ----------
    place : float
        Share of the travel.
    share : float
        Of what the limits allow, of the excitation's torque or of the belt's force.
    speeds_m_s : tuple of float
        Of strokes; of a sweep, where none means the usual seven.
    again : bool
        Two of the seven only, to compare with.
    amplitudes_m : tuple of float
        Of triangles.
    seconds : float
        Of a response, 0 for the usual length; of random moves, 0 for fast moves between fixed places.
    seed : int
        Of random moves.
    up_to_hz : float
        Of a response, up to where it has power at least, 0 for what the belt's resonance asks for.
    """

    kind: Kind
    place: float = 0.5
    share: float = LOUD
    speeds_m_s: tuple[float, ...] = ()
    amplitudes_m: tuple[float, ...] = ()
    seconds: float = 0.0
    seed: int = 0
    up_to_hz: float = 0.0
    again: bool = False
    held_out: bool = False

    @property
    def here(self) -> bool:
        """True if it happens around one place."""
        return "place" in KEYS[self.kind]

    def at_m(self, window_m: tuple[float, float]) -> float:
        """Position of the step, m."""
        low, high = window_m
        return low + self.place * (high - low)

    def words(self) -> str:
        """For people."""
        held = ", held out" if self.held_out else ""
        where = f"at {100.0 * self.place:.0f} % of the travel{held}"
        speeds = f"{', '.join(f'{v:g}' for v in self.speeds_m_s)} m/s"
        if self.kind == "sweep":
            which = f"at {speeds}" if self.speeds_m_s else "two speeds once more" if self.again else "slow to fast"
            return f"constant-speed strokes over the whole travel, both ways, {which}{held}"
        if self.kind == "strokes":
            return f"slow strokes {where}: {speeds}"
        if self.kind == "reversals":
            return f"small triangles {where}: ±{', ±'.join(f'{1e3 * a:g}' for a in self.amplitudes_m)} mm"
        if self.kind == "moves":
            what = f"moves to random places for {self.seconds:.0f} s" if self.seconds else "fast moves from end to end"
            return f"{what}, with up to {100.0 * self.share:.0f} % of the belt's force{held}"
        most = "" if self.share >= LOUD else " above friction"
        long = f", for {self.seconds:.0f} s" if self.seconds else ""
        wide = f", up to {self.up_to_hz:.0f} Hz" if self.up_to_hz else ""
        return f"excitation {where}, with {100.0 * self.share:.0f} % of what the limits allow{most}{wide}{long}"

    def title(self, place_m: float) -> str:
        """In a few words."""
        what = {
            "response": "frequency response",
            "strokes": "slow strokes",
            "sweep": "constant-speed sweep",
            "reversals": "reversals",
            "moves": "moves" if self.seconds else "fast moves",
        }[self.kind]
        held = ", held out" if self.held_out else ""
        if self.kind == "response" and self.share < LOUD and not self.held_out:
            what = "small-amplitude response"
        return f"{what}{f' at {place_m:.2f} m' if self.here else ''}{held}"

    def to_dict(self) -> dict[str, Any]:
        """Entries of a plan file."""
        said = {key: getattr(self, key) for key in KEYS[self.kind]}
        return {"kind": self.kind, **{key: list(value) if isinstance(value, tuple) else value for key, value in said.items()}}


def checked_step(entry: Any, where: str) -> Step:
    """A step from a plan file.

    Parameters
    ----------
    entry : Any
        As read from the file.
    where : str
        Its place in the file, for the sentence.

    Raises
    ------
    UsageError
        Naming the place in the file.
    """
    if not isinstance(entry, Mapping) or entry.get("kind") not in (*KEYS,):
        raise UsageError(f"{where}: kind must be one of {', '.join(KEYS)}")
    kind = entry["kind"]
    unknown = sorted(str(key) for key in set(entry) - {"kind", *KEYS[kind]})
    if unknown:
        raise UsageError(f"{where}: there is no {', '.join(unknown)}; a step of kind {kind} has {', '.join(KEYS[kind])}")

    def one(key: str, usual: float, least: float, most: float) -> float:
        return _number(entry.get(key, usual), f"{where}: {key}", least, most)

    def several(key: str, most: float) -> tuple[float, ...]:
        values = entry.get(key) or ()
        if not isinstance(values, (list, tuple)) or len(values) > MOST_VALUES:
            raise UsageError(f"{where}: {key} must be a list of at most {MOST_VALUES} numbers")
        return tuple(_number(value, f"{where}: {key}", 0.0, most) for value in values)

    place, share = one("place", 0.5, 0.0, 1.0), one("share", LOUD, 0.0, 1.0)
    seconds, seed, up_to_hz = one("seconds", 0.0, 0.0, LONGEST_S), one("seed", 0, 0, LARGEST_SEED), one("up_to_hz", 0.0, 0.0, HIGHEST_HZ)
    speeds, amplitudes = several("speeds_m_s", FASTEST_M_S), several("amplitudes_m", LONGEST_TRIANGLE_M)
    if not share > 0.0:
        raise UsageError(f"{where}: share must be above 0")
    if seed != int(seed):
        raise UsageError(f"{where}: seed is {seed:g}; it must be a whole number")
    for key in ("again", "held_out"):
        if not isinstance(entry.get(key, False), bool):
            raise UsageError(f"{where}: {key} is {entry[key]!r}; write true or false")
    if (kind == "strokes" and not speeds) or (speeds and not min(speeds) > 0.0):
        raise UsageError(f"{where}: strokes need speeds_m_s, all above 0")
    if kind == "reversals" and not (amplitudes and min(amplitudes) > 0.0):
        raise UsageError(f"{where}: reversals need amplitudes_m, all above 0 and at most {LONGEST_TRIANGLE_M:g}")
    again, held_out = entry.get("again", False), entry.get("held_out", False)
    return Step(kind, place, share, speeds, amplitudes, seconds, int(seed), up_to_hz, again, held_out)


def step_schema() -> dict[str, Any]:
    """JSON schema of a step."""

    def number(meaning: str, most: float, low: str = "minimum", kind: str = "number") -> dict[str, Any]:
        return {"type": kind, low: 0, "maximum": most, "description": meaning}

    def several(meaning: str, most: float) -> dict[str, Any]:
        one = {"type": "number", "exclusiveMinimum": 0, "maximum": most}
        return {"type": "array", "maxItems": MOST_VALUES, "items": one, "description": meaning}

    entries = {
        "place": number("where along the travel, as a share of it", 1),
        "share": number("of what the limits allow", 1, "exclusiveMinimum"),
        "seconds": number("length, s; 0 for the usual one", LONGEST_S),
        "up_to_hz": number("band that has power at least, Hz", HIGHEST_HZ),
        "seed": number("of random moves", LARGEST_SEED, kind="integer"),
        "speeds_m_s": several("of strokes, m/s", FASTEST_M_S),
        "amplitudes_m": several("of triangles, m", LONGEST_TRIANGLE_M),
        "again": {"type": "boolean", "description": "two of the seven speeds only"},
        "held_out": {"type": "boolean", "description": "nothing is fitted to it: it judges"},
    }
    kinds = [{"kind": {"const": kind}, **{key: entries[key] for key in keys}} for kind, keys in KEYS.items()]
    return {"oneOf": [{"type": "object", "additionalProperties": False, "required": ["kind"], "properties": kind} for kind in kinds]}


def _number(value: Any, what: str, least: float, most: float) -> float:
    """A number within bounds.   Raises UsageError."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not least <= value <= most:
        raise UsageError(f"{what} is {str(value)[:40]}; give a number between {least:g} and {most:g}")
    return float(value)
