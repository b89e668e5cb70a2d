"""Tracks of a sin/cos encoder that are not alike: within every line the interpolated angle errs once and twice."""

from __future__ import annotations

import math
from collections.abc import Mapping

from beltcomm.compiled import compiled
from beltcomm.effects._effect import AxisSummary, Effect, Parameter, Trial

#: Lines per turn that encoders are sold with.
LINES = (16, 32, 64, 100, 128, 180, 200, 250, 256, 360, 400, 500, 512, 600, 720, 900, 1000, 1024, 1250, 1500, 1800, 2000, 2048, 2500,
         3000, 3600, 4000, 4096, 5000, 8192, 9000)  # fmt: skip
#: Steps into which a drive divides a line: its counts over one of these are a number of lines as well.
FACTORS = tuple(2**k for k in range(3, 17))
#: Steps of the angle per line below which the rounding hides where in its line the encoder stands: both orders need four.
COUNTS_PER_LINE = 8.0
#: Amplitude on trial, rad, and share of a radian of the line that it is at most.
TYPICAL_RAD, TYPICAL_SHARE = 1e-4, 0.1
#: Rounds in which the true angle is found, to 1e-8 of an amplitude of 0.4 of a radian of the line.
ROUNDS = 4
#: Least rise of the angle shown over the true one that a round counts on: no encoder's falls.
LEAST_RISE = 0.25


@compiled
def _true_angle(theta: float, lines: float, sine: float, cosine: float, sine_2: float, cosine_2: float) -> float:
    """The angle α at which the encoder shows θ:  α + sine sin nα + cosine cos nα + sine_2 sin 2nα + cosine_2 cos 2nα = θ, by Newton."""
    true = theta
    for _ in range(ROUNDS):
        s, c = math.sin(lines * true), math.cos(lines * true)
        error = sine * s + cosine * c + 2.0 * sine_2 * s * c + cosine_2 * (c - s) * (c + s)
        rise = lines * (sine * c - cosine * s + 2.0 * (sine_2 * (c - s) * (c + s) - 2.0 * cosine_2 * s * c))
        true -= (true + error - theta) / max(LEAST_RISE, 1.0 + rise)
    return true


def _correction(theta: float, lines: float, sine: float, cosine: float, sine_2: float, cosine_2: float) -> float:
    """True minus shown angle:  -(sine sin nα + cosine cos nα + sine_2 sin 2nα + cosine_2 cos 2nα), rad.

    θ : rad, shown.   α : rad, true.   n : lines per turn.
    """
    return _true_angle(theta, lines, sine, cosine, sine_2, cosine_2) - theta


def _slope(theta: float, lines: float, sine: float, cosine: float, sine_2: float, cosine_2: float) -> float:
    """d/dθ of the correction."""
    place = lines * _true_angle(theta, lines, sine, cosine, sine_2, cosine_2)
    s, c = math.sin(place), math.cos(place)
    rise = lines * (sine * c - cosine * s + 2.0 * (sine_2 * (c - s) * (c + s) - 2.0 * cosine_2 * s * c))
    return -rise / max(LEAST_RISE, 1.0 + rise)


def _trials(ground: AxisSummary) -> list[Trial]:
    """Every number of lines that the angle in the records resolves, both orders of sine and cosine as columns of their own."""
    divided = {int(ground.counts) // factor for factor in FACTORS if ground.counts and ground.counts % factor == 0.0}
    most = 2.0 * math.pi / (COUNTS_PER_LINE * ground.step_rad) if ground.step_rad else math.inf
    names = ("sine", "cosine", "sine_2", "cosine_2")
    return [
        Trial({"lines": float(n), **dict.fromkeys(names, min(TYPICAL_RAD, TYPICAL_SHARE / n))}, amplitudes=names, signed=True)
        for n in sorted({*LINES, *divided})
        if LINES[0] <= n <= min(most, EFFECT.parameters[0].high)
    ]


def _implausible(values: Mapping[str, float]) -> str:
    """An angle that runs back while the shaft turns on is no interpolation error."""
    steepest = values["lines"] * (math.hypot(values["sine"], values["cosine"]) + 2.0 * math.hypot(values["sine_2"], values["cosine_2"]))
    return "" if steepest < 1.0 else f"an error that moves {steepest:.2g} times as fast as the shaft"


EFFECT = Effect(
    name="encoder_interpolation",
    slot="sensor",
    title="interpolation error of the encoder",
    parameters=(
        Parameter("lines", "1", "motor", 2048.0, 1.0, 20000.0, "lines of the encoder per turn", fitted=False),
        Parameter("sine", "rad", "motor", 0.0, -2e-3, 2e-3, "error once per line, part in phase with the line"),
        Parameter("cosine", "rad", "motor", 0.0, -2e-3, 2e-3, "error once per line, part in quadrature"),
        Parameter("sine_2", "rad", "motor", 0.0, -2e-3, 2e-3, "error twice per line, part in phase with the line"),
        Parameter("cosine_2", "rad", "motor", 0.0, -2e-3, 2e-3, "error twice per line, part in quadrature"),
    ),
    law=_correction,
    slope=_slope,
    trials=_trials,
    harmonic="angle",
    seen="noise of the speed and of the torque command as soon as the axis moves, gone at rest; the error tends to change sign from one "
    "sample to the next; at one speed it is a tone at lines times turns per second, or its alias",
    causes="offset of the sine or cosine track (once per line), unequal amplitudes or a phase that is not 90° (twice per line); "
    "dirt on the disc, a scanning gap out of tolerance, a broken shield of the encoder cable",
    check="look at both tracks with an oscilloscope in X-Y while the motor turns slowly: the figure must be a circle around zero; compare "
    "the number of lines with the encoder's data sheet; check the shield of the encoder cable",
    remedy="calibrate offset, gain and phase of the sin/cos tracks in the drive (many drives do it by themselves while the motor turns), "
    "clean or replace the encoder; until then less gain of the velocity controller or a longer filter of the speed",
    alike={
        "cogging": "repeat at half the speed: cogging asks for the same torque; what an error of the angle asks for falls to a quarter, "
        "or to any other value where the lines pass faster than samples are taken",
        "encoder_eccentricity": "look at the order: an encoder off centre errs once or twice per turn, its interpolation once or "
        "twice per line",
    },
    unlikely=_implausible,
    source="data sheet of the encoder (position error within one signal period)",
)
