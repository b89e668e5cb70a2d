"""Results in plain sentences."""

from __future__ import annotations

from dataclasses import replace

from beltcomm.sentences.words import verdict_lines
from beltcomm.verify import TrackingError, Verdict


def test_what_nobody_measured_has_no_unit() -> None:
    motor, cart = TrackingError(0.13e-3, 25e-6), TrackingError(0.55e-3, 13e-6)
    verdict = Verdict(True, motor, motor, None, cart, ())
    _, at_motor, at_carriage = verdict_lines(verdict, None)
    assert at_motor.split("at the motor")[1].strip() == "following error 0.13 mm (predicted 0.13 mm), settled 25 µm (predicted 25 µm)"
    assert at_carriage.split("at the carriage")[1].strip() == "following error 0.55 mm, settled 13 µm (predicted; nothing measures there)"
    (*_, seen) = verdict_lines(replace(verdict, measured_cart=cart), None)
    assert seen.split("at the carriage")[1].strip() == "following error 0.55 mm (predicted 0.55 mm), settled 13 µm (predicted 13 µm)"
