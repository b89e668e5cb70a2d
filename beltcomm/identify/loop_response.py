"""The plant's frequency response from a record of a closed loop, by each way that the record allows (3.20) to (3.24)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np
from scipy.special import stdtrit

from beltcomm.arrays import Array, ComplexArray, decibels
from beltcomm.control import Cascade
from beltcomm.drive.parameters import cascade_to_parameters, parameters_to_cascade
from beltcomm.errors import DataError, UsageError
from beltcomm.model.value import NORMAL_95
from beltcomm.recording import Recording
from beltcomm.response import FrequencyResponse, estimate_response
from beltcomm.response.closed_loop import Loop, feedback, from_setpoint_excitation, from_torque_excitation, setpoint_path

Way = Literal["open", "direct", "indirect", "setpoint"]
CLOSED_WAYS: Final[tuple[Way, ...]] = ("direct", "indirect", "setpoint")

#: A controller that is not what one believes: by so much is its gain wrong in what is said of the bias.
DOUBT = 0.1
#: dB: a bias below this is none.
NO_BIAS_DB = 0.1
#: Neighbouring lines over which the noise is averaged for their weights.
SMOOTHED = 5
#: Lines below this share of the antiresonance show the rigid axis and its damping; there the belt damper adds a 40th of its own, by
#: i² b (m ω²/c)².
RIGID_SHARE = 0.4


@dataclass(frozen=True)
class KnownController:
    """The controller as the sidecar's ``controller`` states it.

    Attributes
    ----------
    loop : Loop
        Which is closed.
    period_s : float
        Of the drive's loops.
    delay_s : float
        Torque setpoint to acting torque.
    """

    cascade: Cascade
    loop: Loop
    period_s: float
    delay_s: float

    def to_dict(self) -> dict[str, Any]:
        """For the sidecar."""
        return {"loop": self.loop, "loop_period_s": self.period_s, "delay_s": self.delay_s, **cascade_to_parameters(self.cascade)}

    def feedback(self, freq_hz: Array) -> ComplexArray:
        """C of (3.21), see :func:`beltcomm.response.closed_loop.feedback`.

        Parameters
        ----------
        freq_hz : ndarray, (k,)
            Above 0.

        Returns
        -------
        ndarray, (k,) complex
            N m/rad, motor shaft.
        """
        return feedback(self.cascade, freq_hz, self.period_s, self.loop)


def controller_of(entry: Mapping[str, Any], record: str) -> KnownController:
    """The controller of a record.

    Parameters
    ----------
    entry : mapping
        ``controller`` of the sidecar.
    record : str
        Its name.

    Returns
    -------
    KnownController
        With the loop that was closed.

    Raises
    ------
    DataError
        Naming the record, when its sidecar does not state one.
    """
    try:
        numbers = {str(k): float(v) for k, v in entry.items() if k != "loop"}
        loop: Loop = entry["loop"]
        if loop not in ("velocity", "position"):
            raise ValueError(f"loop is {loop!r}")
        return KnownController(parameters_to_cascade(numbers), loop, numbers["loop_period_s"], numbers["delay_s"])
    except (KeyError, TypeError, ValueError, UsageError) as error:
        raise DataError(
            f"the sidecar of {record} states no controller that could be taken off again ({error}); the direct way does without"
        ) from error


@dataclass(frozen=True)
class Biased:
    """Bias of an indirect result by a gain that is wrong by ``DOUBT``.

    Attributes
    ----------
    lowest_hz, shift_db : float
        At the lowest line.
    crossover_hz : float
        Where |G C| falls below 1, 0 where it never reaches it.
    harmless_hz : float
        From there on less than ``NO_BIAS_DB``, below the antiresonance, at which the loop gain is smallest.
    """

    lowest_hz: float
    shift_db: float
    crossover_hz: float
    harmless_hz: float


def ways_of(recording: Recording) -> tuple[Way, ...]:
    """The ways by which a record can be read, the best known first; open-loop records by one.

    Parameters
    ----------
    recording : Recording
        In open or closed loop.

    Returns
    -------
    tuple of Way
        One at least.
    """
    if not recording.sidecar.closed_loop:
        return ("open",)
    if recording.torque_offset is not None:
        return ("direct", "indirect")
    note = recording.sidecar.excitation
    if note is not None and note.amplitude_rad_s is not None and recording.reference_velocity is not None:
        return ("direct", "setpoint")
    return ("direct",)


def plant_response(recording: Recording, way: Way) -> FrequencyResponse:
    """Response of the motor angle to the acting torque, by one way; whole periods in the steady parts only.

    Parameters
    ----------
    recording : Recording
        With periodic excitation.
    way : Way
        One of :func:`ways_of`.

    Returns
    -------
    FrequencyResponse
        rad/(N m), motor shaft.

    Raises
    ------
    DataError
        When the record has no periodic excitation, fewer than two whole periods, or cannot be read that way.
    """
    if way not in ways_of(recording):
        raise DataError(f"{recording.name} cannot be read by the way {way}: it has {', '.join(ways_of(recording))}")
    if way in ("open", "direct"):
        return response_to_signal(recording, recording.torque)
    known = controller_of(recording.sidecar.controller, recording.name)
    signal = recording.torque_offset if way == "indirect" else recording.reference_velocity
    assert signal is not None  # ways_of has looked
    through = response_to_signal(recording, signal)
    controller = known.feedback(through.freq_hz)
    if way == "indirect":
        found = from_torque_excitation(through, controller)
    else:
        found = from_setpoint_excitation(through, controller, setpoint_path(known.cascade, through.freq_hz, known.period_s))
    # what was found is from torque setpoint to angle: the delay is taken into the prefilter V_1 (3.4)
    return replace(found, h=found.h * np.exp(2j * np.pi * found.freq_hz * known.delay_s), remarks=found.remarks + _slower(known, recording))


def response_to_signal(recording: Recording, signal: Array) -> FrequencyResponse:
    """Response of the motor angle to one of a record's signals.

    Parameters
    ----------
    recording : Recording
        With periodic excitation.
    signal : ndarray, (n,)
        Torque, or a setpoint of the record.

    Returns
    -------
    FrequencyResponse
        rad per unit of the signal.

    Raises
    ------
    DataError
    """
    note = recording.sidecar.excitation
    if note is None or not note.period_samples:
        raise DataError(f"{recording.name} has no periodic excitation; its sidecar must say excitation.period_samples")
    return estimate_response(
        signal,
        recording.position,
        recording.sample_period_s,
        note.period_samples,
        note.first_sample,
        t_s=recording.t_s,
        starts=note.period_starts,
    )


def _slower(known: KnownController, recording: Recording) -> tuple[str, ...]:
    """Said where the drive's loop does not run in step with the record."""
    if math.isclose(known.period_s, recording.sample_period_s, rel_tol=1e-3):
        return ()
    return (
        f"the drive's loop runs every {1e3 * known.period_s:g} ms and was recorded every {1e3 * recording.sample_period_s:g} ms: the "
        "controller is taken off as if both were one, which shifts the phase near half the recording rate",
    )


def bias_of(response: FrequencyResponse, known: KnownController) -> Biased:
    """Ĝ/G = 1/(1 + δ G C e^(-sT_t)) for a controller gain that is believed too small by the share δ: exact, from (3.22).

    Parameters
    ----------
    response : FrequencyResponse
        Of the plant, rad/(N m).
    known : KnownController
        The controller that is believed.

    Returns
    -------
    Biased
        dB and Hz.
    """
    late = np.exp(-2j * np.pi * response.freq_hz * known.delay_s)
    product = response.h * late * known.feedback(response.freq_hz)
    shift = -decibels(1.0 + DOUBT * product)
    strong = np.flatnonzero(np.abs(product) > 1.0)
    harmful = np.flatnonzero(np.abs(shift) > NO_BIAS_DB)
    freq = response.freq_hz
    return Biased(
        float(freq[0]),
        float(shift[0]),
        float(freq[strong[-1]]) if len(strong) else 0.0,
        float(freq[min(harmful[-1] + 1, len(freq) - 1)]) if len(harmful) else float(freq[0]),
    )


def rigid_damping(response: FrequencyResponse, antiresonance_hz: float) -> tuple[float, float]:
    """Damping that the axis shows below its antiresonance.

    Re{e^(-jωT/2)/(jω Ĝ)} = d,  Ĝ the response to a held torque, which lags by half a sample; weighted mean over the lines below
    ``RIGID_SHARE`` of the antiresonance, the width by their own scatter where that is more than the noise.

    Parameters
    ----------
    response : FrequencyResponse
        Of the plant, rad/(N m).
    antiresonance_hz : float, Hz
        Of the belt.

    Returns
    -------
    tuple of float
        N m s/rad at the motor shaft, and its 95 % half width.

    Raises
    ------
    DataError
        When fewer than three lines lie there.
    """
    low = response.freq_hz < RIGID_SHARE * antiresonance_hz
    if low.sum() < 3:
        raise DataError(f"fewer than three lines lie below {RIGID_SHARE * antiresonance_hz:.3g} Hz: the damping of the axis is not seen")
    omega = 2.0 * np.pi * response.freq_hz[low]
    held = np.exp(-0.5j * omega * response.sample_period_s)
    each = np.real(held / (1j * omega * response.h[low]))
    variance = 0.5 * (response.noise[low] / (omega * np.abs(response.h[low]) ** 2)) ** 2
    # of a few periods the noise of a single line is hardly known: a line that seems quiet by chance must not outweigh the rest
    width = min(SMOOTHED, len(variance))
    weight = 1.0 / (np.convolve(variance, np.ones(width), "same") / np.convolve(np.ones(len(variance)), np.ones(width), "same"))
    mean = float(np.sum(weight * each) / np.sum(weight))
    inflated = max(1.0, math.sqrt(float(np.sum(weight * (each - mean) ** 2)) / (len(each) - 1)))
    return mean, float(stdtrit(len(each) - 1, 0.975)) * inflated / math.sqrt(float(np.sum(weight)))


def difference_db(one: FrequencyResponse, other: FrequencyResponse, low_hz: float, high_hz: float) -> tuple[float, float]:
    """Mean of 20 lg |Ĝ_1/Ĝ_2| over the common lines within a band.

    Parameters
    ----------
    one, other : FrequencyResponse
        In one unit.
    low_hz, high_hz : float, Hz
        The band; its upper edge does not count.

    Returns
    -------
    tuple of float
        dB, and its 95 % half width by the noise of both; nan without common lines.
    """
    _, here, there = np.intersect1d(one.freq_hz, other.freq_hz, return_indices=True)
    freq = one.freq_hz[here]
    band = (freq >= low_hz) & (freq < high_hz)
    if not band.any():
        return math.nan, math.nan
    off = decibels(one.h[here][band] / other.h[there][band])
    shares = [(found.noise[at] / np.abs(found.h[at]))[band] for found, at in ((one, here), (other, there))]
    variance = np.sum((20.0 / math.log(10.0)) ** 2 * (shares[0] ** 2 + shares[1] ** 2) / 2.0)
    return float(np.mean(off)), NORMAL_95 * math.sqrt(float(variance)) / int(band.sum())
