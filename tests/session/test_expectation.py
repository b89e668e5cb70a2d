"""What is said when an excitation goes further than any machine of the family would."""

from __future__ import annotations

import numpy as np

from beltcomm.machine.prediction_watch import _measured_inertia, _suspects, _told_apart


def test_two_numbers_are_told_with_digits_enough_to_differ() -> None:
    assert _told_apart(5.1213, 5.1191) == ("5.121", "5.119")
    assert _told_apart(7.0, 2.0) == ("7", "2")


def test_an_inertia_far_off_may_be_a_gap() -> None:
    words = _suspects(7.17e-5, (1.7e-4, 4.5e-6))
    assert "check the unit of motor.inertia_kg_m2" in words
    assert "A gap looks like this too" in words
    assert "`beltcomm diagnose RUN`" in words
    assert "gap" not in _suspects(7.17e-5, (8e-5, 4.5e-6))


def test_the_inertia_of_motor_and_load_is_no_contradiction_of_the_motor_s() -> None:
    """Of a rigid axis both are measured together."""
    words = _suspects(9e-5, (3.2e-4, 4e-6), rigid=True)
    assert "motor and load together show an inertia of about 0.00032" in words
    assert "check the unit" not in words
    assert "check the unit" in _suspects(9e-5, (2e-5, 4e-6), rigid=True)  # less than the motor alone


def test_a_torque_that_is_reported_as_nothing_shows_no_inertia() -> None:
    """An axis runs away, and its drive reports no torque all the while: it is stopped with words all the same."""
    t_s = 1e-3 * np.arange(200)
    assert _measured_inertia(np.stack([t_s, np.zeros(200), 50.0 * t_s**2], axis=1)) is None
