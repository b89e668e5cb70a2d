"""A place where the model fails, as a sentence."""

from __future__ import annotations

from collections.abc import Mapping

from beltcomm.laboratory.places import ErrorRegion
from beltcomm.laboratory.samples import Units

#: Means that differ by less than this share count as equal.
ALIKE = 0.5


def in_words(place: ErrorRegion, landmarks: Mapping[str, float] | None = None) -> str:
    """A place as a sentence.

    Parameters
    ----------
    place : ErrorRegion
        Where the error stands out.
    landmarks : dict of str to float or None
        Frequencies with a name, Hz, such as the antiresonance.
    """
    if place.dimension == "angle":
        swing = _amount(place.swing, place.units)
        return (
            f"{place.low:.0f} times per turn of the motor: the {place.units.word} swings by {swing} with the angle; "
            f"without it {place.elsewhere:.2f} in place of {place.ratio:.2f} times the noise"
        )
    if place.dimension == "direction":
        means = _torque_words(place) or f"no {place.units.word} is missing on average"
        return f"{means}; without that {place.elsewhere:.2f} in place of {place.ratio:.2f} times the noise"
    torque = _torque_words(place)
    rest = "" if place.elsewhere >= place.ratio else f", elsewhere {place.elsewhere:.2f}"
    record = f", most of it in {place.record}" if place.record else ""
    where = _span_words(place) + _also_words(place) + _landmark_words(place, landmarks or {})
    return f"{where}: {place.ratio:.2f} times the noise{rest}{'; ' if torque else ''}{torque}{record}"


def _span_words(place: ErrorRegion) -> str:
    """The range."""
    low, high = place.low, place.high
    if place.dimension == "speed":
        if low <= 0.0:
            return f"speeds below {high:g} {place.unit}"
        last = high >= place.units.speeds[-1]
        return f"speeds above {low:g} {place.unit}" if last else f"speeds of {low:g} to {high:g} {place.unit}"
    word, moving = f"{place.units.word}s", "carriage" if place.units.length == "m" else "motor"
    return {
        "position": f"{moving} between {low:.2f} and {high:.2f} {place.unit}",
        "time": f"{low:.0f} to {high:.0f} s on the session's clock",
        "amplitude": f"{word} below {_plain(high)} {place.unit}"
        if low <= 0.0
        else f"{word} of {_plain(low)} to {_plain(high)} {place.unit}",
        "frequency": f"{low:.0f} to {high:.0f} Hz",
    }[place.dimension]


def _plain(value: float) -> str:
    """Two digits, without powers of ten for a large machine."""
    return f"{float(f'{value:.2g}'):.6g}"


def _also_words(place: ErrorRegion) -> str:
    """Other ranges nearly as bad."""
    return "".join(f", also {low:.3g} to {high:.3g} {place.unit}" for low, high in place.also)


def _landmark_words(place: ErrorRegion, landmarks: Mapping[str, float]) -> str:
    """Known frequencies within a band, in words."""
    if place.dimension != "frequency":
        return ""
    inside = [f"{name} {hz:.0f} Hz" for name, hz in landmarks.items() if place.low <= hz < place.high]
    return f" ({', '.join(inside)})" if inside else ""


def _torque_words(place: ErrorRegion) -> str:
    """Average difference of the measured torque (force, current), in words; "" where there is none."""
    forward, backward, units = place.forward, place.backward, place.units
    by_load = place.dimension == "amplitude"
    both = "both signs" if by_load else "both directions"
    plus, minus = (f"at {word} {units.word}" if by_load else f"in {word} direction" for word in ("positive", "negative"))
    measured = f"measured {units.word}"
    if forward is None and backward is None:
        return ""
    if forward is None or backward is None:
        value, where, sign = (forward, plus, 1.0) if forward is not None else (backward, minus, -1.0)
        assert value is not None
        return f"{where}: {measured} {_amount(value, units)} {_more(sign * value)}" if abs(value) > place.least else ""
    along, across = 0.5 * (forward - backward), 0.5 * (forward + backward)
    side = "positive" if across > 0.0 else "negative"
    friction, offset = f"{_amount(along, units)} {_more(along)}", f"{_amount(across, units)} to the {side} side"
    if max(abs(along), abs(across)) < place.least:
        return ""
    if abs(across) < ALIKE * abs(along):
        return f"{both}: {measured} {friction}"
    if abs(along) < ALIKE * abs(across):
        return f"{both}: {measured} {offset}"
    if forward * backward > 0.0:  # the same side both ways, by different amounts
        return f"{both}: {measured} {offset}, beside {friction} {'by its own sign' if by_load else 'along the motion'}"
    return f"{plus} {measured} {_amount(forward, units)} {_more(forward)}, {minus} {_amount(backward, units)} {_more(-backward)}"


def _more(value: float) -> str:
    """Higher or lower than the model's, in the direction of motion."""
    return "higher" if value > 0.0 else "lower"


def _amount(value: float, units: Units) -> str:
    """A torque, force or current without its sign."""
    small = units.factor * abs(value)
    return f"{small:.2g} {units.small}" if small < 99.5 else f"{_plain(abs(value))} {units.force}"
