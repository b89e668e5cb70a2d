"""An excitation as a person asks for it: made as asked, or refused with the limit before anything moves."""

from __future__ import annotations

import pytest

from beltcomm.errors import BeltcommError, Refused, UsageError
from beltcomm.excitation import AskedExcitation, PrbsChoice, choose

PERIOD_S, STEP_NM, MOST_NM = 1e-3, 1.4e-3, 1.2


def test_the_source_s_sequence_is_made_as_asked() -> None:
    """PRBS of order 7, 8 ms a bit (clock 128 at 62.5 µs), ± 0.3 N m, four periods."""
    asked = AskedExcitation(7, 8e-3, 0.3, 4)
    asked.check("prbs", PERIOD_S, STEP_NM, MOST_NM)
    choice = asked.of(choose("prbs", PERIOD_S, 20.0, 110.0, 7.0), PERIOD_S)
    assert isinstance(choice, PrbsChoice)
    made = choice.excitation(0.3, PERIOD_S)
    assert made.period_samples == 127 * 8
    assert made.repeats == 4
    assert made.amplitude_nm == pytest.approx(0.3, rel=0.01)
    assert asked.seconds() == pytest.approx(made.duration_s, abs=3e-3)


def test_what_is_not_asked_for_is_chosen() -> None:
    chosen = choose("prbs", PERIOD_S, 20.0, 110.0, 7.0)
    assert AskedExcitation().of(chosen, PERIOD_S) == chosen
    only = AskedExcitation(periods=5).of(chosen, PERIOD_S)
    assert isinstance(only, PrbsChoice)
    assert isinstance(chosen, PrbsChoice)
    assert (only.order, only.clock, only.repeats) == (chosen.order, chosen.clock, 5)
    assert AskedExcitation(periods=5).of(choose("multisine", PERIOD_S, 20.0, 110.0, 9.0), PERIOD_S).repeats == 5


@pytest.mark.parametrize(
    ("asked", "kind", "error", "words"),
    [
        (AskedExcitation(order=2), "prbs", UsageError, "from 3 to 16"),
        (AskedExcitation(order=7), "chirp", UsageError, "those of a PRBS"),
        (AskedExcitation(bit_s=0.4e-3), "prbs", UsageError, "ask for 1 ms"),
        (AskedExcitation(bit_s=2.5e-3), "prbs", UsageError, "no whole number"),
        (AskedExcitation(periods=1), "prbs", UsageError, "ask for 3 or more"),
        (AskedExcitation(periods=2000), "chirp", UsageError, "1000 or fewer"),
        (AskedExcitation(order=16, bit_s=1.0), "prbs", UsageError, "72.8 h, at most 2.78 h"),
        (AskedExcitation(amplitude_nm=1e-3), "prbs", UsageError, "two steps of the drive's torque"),
        (AskedExcitation(amplitude_nm=-0.3), "prbs", UsageError, "two steps of the drive's torque"),
        (AskedExcitation(amplitude_nm=1.3), "prbs", Refused, "1.2 N m; ask for less"),
    ],
)
def test_what_cannot_be_is_refused_with_the_value(asked: AskedExcitation, kind: str, error: type[BeltcommError], words: str) -> None:
    with pytest.raises(error, match=words):
        asked.check(kind, PERIOD_S, STEP_NM, MOST_NM)  # type: ignore[arg-type]


def test_less_than_asked_for_is_not_driven() -> None:
    asked = AskedExcitation(amplitude_nm=0.3)
    asked.amplitude_of(0.2999, "step")
    with pytest.raises(Refused, match=r"the limit on travel allows only ±0.12 N m"):
        asked.amplitude_of(0.12, "travel")


def test_a_record_longer_than_any_is_not_begun() -> None:
    """Of a bit alone the length shows with the order that is chosen: before it is made, for it would not fit into a computer."""
    asked = AskedExcitation(bit_s=900.0)
    asked.check("prbs", PERIOD_S, STEP_NM, MOST_NM)
    with pytest.raises(UsageError, match=r"at most 2\.78 h"):
        asked.of(choose("prbs", PERIOD_S, 20.0, 110.0, 7.0), PERIOD_S)
