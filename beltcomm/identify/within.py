"""Where inside the sampling period a drive lets its torque change, from its setpoint.

A drive whose cycle and the bus are not in step switches the torque between two samples, a share φ of the period after the first:

    torque[n] = g ((1 - φ) setpoint[n-m] + φ setpoint[n-m-1]) + noise

Held over the period instead, a switching excitation makes the inertia some 5 % wrong and leaves more than twice the noise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from beltcomm.recording import Recording
from beltcomm.simulate.change import Change

Array = NDArray[np.float64]

#: Periods by which a torque may follow its setpoint.
LAGS = 7
#: Standard deviations from which on a share is one; largest deviation of a share that is known; what the other periods may hold.
CLEAR, KNOWN, REST = 4.0, 0.02, 0.03
#: Gains from setpoint to torque of a drive that delivers what it is asked for, whatever its scale.
GAINS = (0.5, 2.0)


def change_of(recording: Recording) -> Change | None:
    """How the torque changes inside the periods of a record; None where it does not, or nobody can tell."""
    setpoint = recording.torque_setpoint
    if setpoint is None or len(recording.gaps()) or len(setpoint) < 20 * LAGS:
        return None
    found = taps(setpoint, recording.torque)
    if found is None:
        return None
    first, gain, share = found
    step = np.zeros(len(setpoint))
    step[first + 1 :] = -gain * np.diff(setpoint)[: len(setpoint) - first - 1]
    return Change(share, step)


def taps(setpoint: Array, torque: Array) -> tuple[int, float, float] | None:
    """m, g and φ of the module's equation by least squares; None where other periods count as well, or one alone does."""
    columns = [setpoint[LAGS - k : len(setpoint) - k] for k in range(LAGS + 1)]
    rows, seen = np.stack([*columns, np.ones(len(columns[0]))], axis=1), torque[LAGS:]
    information = rows.T @ rows
    if np.linalg.cond(information) > 1e12:
        return None
    inverse = np.linalg.inv(information)
    shares = inverse @ (rows.T @ seen)
    left = seen - rows @ shares
    deviation = np.sqrt(np.diag(inverse) * float(left @ left) / len(left))[: LAGS + 1]
    shares = shares[: LAGS + 1]
    pairs = shares[:-1] + shares[1:]
    m = int(np.argmax(pairs))
    gain, own = float(pairs[m]), np.arange(LAGS + 1)
    others, clear = (own != m) & (own != m + 1), CLEAR * deviation
    if not GAINS[0] <= gain <= GAINS[1] or float(deviation.max()) > KNOWN * gain or np.any((shares < clear)[[m, m + 1]]):
        return None
    if np.any(np.abs(shares[others]) > np.maximum(REST * gain, clear[others])):
        return None
    return m, gain, float(shares[m + 1]) / gain
