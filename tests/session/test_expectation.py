"""What is said when an excitation goes further than any machine of the family would."""

from __future__ import annotations

from beltcomm.machine.prediction_watch import suspects, told_apart


def test_two_numbers_are_told_with_digits_enough_to_differ() -> None:
    assert told_apart(5.1213, 5.1191) == ("5.121", "5.119")
    assert told_apart(7.0, 2.0) == ("7", "2")


def test_an_inertia_far_off_may_be_a_gap() -> None:
    words = suspects(7.17e-5, (1.7e-4, 4.5e-6))
    assert "check the unit of motor.inertia_kg_m2" in words
    assert "A gap looks like this too" in words
    assert "`beltcomm diagnose RUN`" in words
    assert "gap" not in suspects(7.17e-5, (8e-5, 4.5e-6))
