"""Set-valued friction of one body over one sub-step."""

from __future__ import annotations


def stick_or_slide(speed: float, push: float, grip: float, h: float) -> float:
    """Speed after ``h`` seconds under a constant push and set-valued friction, solved exactly.

    dv/dt = push - grip sign(v),   v = 0 held while |push| <= grip

    Parameters
    ----------
    speed : float
        v before, m/s or rad/s.
    push : float
        Acceleration by everything but this friction.
    grip : float
        Friction level over inertia, >= 0. A reversal within the step is placed where it happens: taking the whole step with one sign would
        shift the friction by half a step at every reversal, which looks like mass (0.3 % of the carriage of rig g_b at 8 kHz).
    """
    direction = 1.0 if (speed if speed != 0.0 else push) > 0.0 else -1.0  # a body at rest starts to where it is pushed
    forward = direction * push
    left = direction * speed + h * (forward - grip)
    if left >= 0.0:
        return direction * left
    if forward >= -grip:
        return 0.0
    stopped = direction * speed / (grip - forward)
    return direction * (h - stopped) * (forward + grip)
