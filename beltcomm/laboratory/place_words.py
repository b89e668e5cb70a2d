"""A place where the model fails, as a sentence."""

from __future__ import annotations

from collections.abc import Mapping

from beltcomm.laboratory.places import SPEEDS_M_S, Place

#: Means that differ by less than this share count as equal; N m, below which a mean is not worth a word.
ALIKE, LEAST_NM = 0.5, 5e-5


def in_words(place: Place, landmarks: Mapping[str, float] | None = None) -> str:
    """A place as a sentence.   landmarks : frequencies with a name, Hz, such as the antiresonance."""
    if place.dimension == "angle":
        return (
            f"{place.low:.0f} times per turn of the motor: the torque swings by {milli(place.swing_nm)} with the angle; "
            f"without it {place.elsewhere:.2f} in place of {place.ratio:.2f} times the noise"
        )
    if place.dimension == "direction":
        means = torque_words(place) or "no torque is missing on average"
        return f"{means}; without that {place.elsewhere:.2f} in place of {place.ratio:.2f} times the noise"
    torque = torque_words(place)
    rest = "" if place.elsewhere >= place.ratio else f", elsewhere {place.elsewhere:.2f}"
    record = f", most of it in {place.record}" if place.record else ""
    where = span_words(place) + landmark_words(place, landmarks or {})
    return f"{where}: {place.ratio:.2f} times the noise{rest}{'; ' if torque else ''}{torque}{record}"


def span_words(place: Place) -> str:
    """The range."""
    low, high = place.low, place.high
    if place.dimension == "speed":
        if low <= 0.0:
            return f"speeds below {high:g} m/s"
        return f"speeds above {low:g} m/s" if high >= SPEEDS_M_S[-1] else f"speeds of {low:g} to {high:g} m/s"
    return {
        "position": f"carriage between {low:.2f} and {high:.2f} m",
        "time": f"{low:.0f} to {high:.0f} s on the session's clock",
        "amplitude": f"torques below {high:.2g} N m" if low <= 0.0 else f"torques of {low:.2g} to {high:.2g} N m",
        "frequency": f"{low:.0f} to {high:.0f} Hz",
    }[place.dimension]


def landmark_words(place: Place, landmarks: Mapping[str, float]) -> str:
    """Which known frequencies lie within a band."""
    if place.dimension != "frequency":
        return ""
    inside = [f"{name} {hz:.0f} Hz" for name, hz in landmarks.items() if place.low <= hz < place.high]
    return f" ({', '.join(inside)})" if inside else ""


def torque_words(place: Place) -> str:
    """How the measured torque differs on average; "" where it does not."""
    forward, backward = place.forward_nm, place.backward_nm
    by_load = place.dimension == "amplitude"
    plus, minus = ("at positive torque", "at negative torque") if by_load else ("in positive direction", "in negative direction")
    both = "both signs" if by_load else "both directions"
    if forward is None and backward is None:
        return ""
    if forward is None or backward is None:
        value, where, sign = (forward, plus, 1.0) if forward is not None else (backward, minus, -1.0)
        assert value is not None
        return f"{where}: measured torque {milli(value)} {more(sign * value)}" if abs(value) > LEAST_NM else ""
    along, across = 0.5 * (forward - backward), 0.5 * (forward + backward)
    if max(abs(along), abs(across)) < LEAST_NM:
        return ""
    if abs(across) < ALIKE * abs(along):
        return f"{both}: measured torque {milli(along)} {more(along)}"
    if abs(along) < ALIKE * abs(across):
        side = "positive" if across > 0.0 else "negative"
        return f"{both}: measured torque {milli(across)} to the {side} side"
    if forward * backward > 0.0:  # the same side both ways, by different amounts
        side = "positive" if across > 0.0 else "negative"
        also = "for the torque's own sign" if by_load else "along the motion"
        return f"{both}: measured torque {milli(across)} to the {side} side, beside {milli(along)} {more(along)} {also}"
    return f"{plus} measured torque {milli(forward)} {more(forward)}, {minus} {milli(backward)} {more(-backward)}"


def more(value: float) -> str:
    """Higher or lower than the model's, in the direction of motion."""
    return "higher" if value > 0.0 else "lower"


def milli(torque_nm: float) -> str:
    """A torque without its sign."""
    return f"{1e3 * abs(torque_nm):.2g} mN m" if abs(torque_nm) < 0.0995 else f"{abs(torque_nm):.2g} N m"
