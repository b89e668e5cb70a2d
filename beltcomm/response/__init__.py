"""Frequency response with its noise level, estimated from repeated periods of an excitation.

Torque at the motor shaft in N m, angle of the motor shaft in rad, so h is in rad/(N m).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from beltcomm import atomic
from beltcomm.arrays import Array, BoolArray, ComplexArray
from beltcomm.errors import DataError
from beltcomm.outside import KEPT_BYTES, in_words, opened

#: A line counts as excited when its torque is at least this part of the strongest line's ...
LEAST_EXCITATION = 0.05
#: ... and its mean over the periods at least this many standard deviations of that mean.  At 5 the bias that torque
#: noise leaves in a ratio of means is below exp(-25) of h, at 2 already 2 %.
LEAST_SIGNIFICANCE = 5.0


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Response from torque to motor angle at single frequencies, with what is known of its error.

    Arrays are read-only.

    Attributes
    ----------
    freq_hz : ndarray (k,), Hz
        Rising.
    h : ComplexArray, (k,)
        Complex, rad/(N m), response to torque held over each sample.
    noise : ndarray (k,), rad/(N m)
        Standard deviation of h, √E|Δh|², from the scatter between periods.
    coherence : ndarray (k,)
        0 to 1, of the single periods.
    n_periods : int
        How many were averaged.
    sample_period_s : float, s
    remarks : tuple of str
        Sentences on what was left out.

    Raises
    ------
    DataError
        When lengths differ or frequencies do not rise.
    """

    freq_hz: Array
    h: ComplexArray
    noise: Array
    coherence: Array
    n_periods: int
    sample_period_s: float
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, dtype in (("freq_hz", float), ("h", complex), ("noise", float), ("coherence", float)):
            values = np.array(getattr(self, name), dtype=dtype)
            if values.ndim != 1 or len(values) != len(self.freq_hz) or len(values) == 0:
                raise DataError(f"frequency response: {name} has the shape {values.shape}, freq_hz has {len(self.freq_hz)} lines")
            if not np.all(np.isfinite(values)):
                raise DataError(f"frequency response: {name} holds values that are not finite; estimate it anew")
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        if self.freq_hz[0] <= 0 or np.any(np.diff(self.freq_hz) <= 0):
            raise DataError("frequency response: freq_hz must be positive and rise")
        if self.n_periods < 2:
            raise DataError(f"frequency response: {self.n_periods} period(s), at least 2 are needed for its noise level")

    def error_radius(self, level: float = 0.95) -> Array:
        """Radius around h in the complex plane that holds the true response with a given probability.

        ρ² = noise² F_level(2, 2 m) = noise² m ((1 - level)^(-1/m) - 1),   m = n_periods - 1

        because |Δh|² and the scatter are sums of 2 and of 2 m normal squares; m → ∞ gives -ln(1 - level).

        Parameters
        ----------
        level : float
            The probability.

        Returns
        -------
        ndarray (k,), rad/(N m)

        References
        ----------
        Pintelon, Schoukens, System Identification (2012), section 2.4.
        """
        m = self.n_periods - 1
        return np.asarray(self.noise * np.sqrt(m * ((1.0 - level) ** (-1.0 / m) - 1.0)), dtype=np.float64)

    def lines(self, index: NDArray[np.intp] | BoolArray) -> FrequencyResponse:
        """The response at some of its lines.

        Parameters
        ----------
        index : ndarray of int or ndarray of bool, (k,)
            Lines to keep.

        Returns
        -------
        FrequencyResponse
            A new response.

        Raises
        ------
        DataError
            When no line is left.
        """
        return FrequencyResponse(
            self.freq_hz[index],
            self.h[index],
            self.noise[index],
            self.coherence[index],
            self.n_periods,
            self.sample_period_s,
            self.remarks,
        )

    def save(self, path: Path) -> None:
        """Write everything to one ``.npz`` file.

        Parameters
        ----------
        path : Path
            Of the file.

        Raises
        ------
        OSError
            When it cannot be written.
        """
        with atomic.replacing(path) as file:
            np.savez(
                file,
                freq_hz=self.freq_hz,
                h=self.h,
                noise=self.noise,
                coherence=self.coherence,
                n_periods=np.array(self.n_periods),
                sample_period_s=np.array(self.sample_period_s),
                remarks=np.array(self.remarks, dtype=np.str_),
            )

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read what :meth:`save` wrote.

        Parameters
        ----------
        path : Path
            Of the ``.npz`` file.

        Returns
        -------
        Self
            Equal to the one written.

        Raises
        ------
        DataError
            When the file is missing, damaged or of another kind.
        """
        try:
            with opened(path, KEPT_BYTES) as stream, np.load(stream, allow_pickle=False) as file:
                if sum(item.file_size for item in file.zip.infolist()) > KEPT_BYTES:
                    raise ValueError(f"it unpacks to more than {in_words(KEPT_BYTES)}")
                return cls(
                    file["freq_hz"],
                    file["h"],
                    file["noise"],
                    file["coherence"],
                    int(file["n_periods"]),
                    float(file["sample_period_s"]),
                    tuple(str(remark) for remark in file["remarks"]),
                )
        except Exception as error:  # on damaged bytes this reader raises whatever it stumbles over
            raise DataError(f"{path} is no frequency response that can be read ({error}); estimate it anew") from error


def estimate_response(
    torque: Array,
    position: Array,
    sample_period_s: float,
    period_samples: int,
    first_sample: int,
    *,
    t_s: Array | None = None,
    starts: Sequence[int] | None = None,
) -> FrequencyResponse:
    """Empirical transfer function estimate with Clary's method II, averaged over the periods in the frequency domain.

    y(z) = z/(z - 1) G_i(z) u(z):   ŵ_p = F{y[n] - y[n-1]},   û_p = F{u[n]},   Ĝ_i = mean ŵ_p / mean û_p,   Ĝ = z/(z-1) Ĝ_i

    with z = exp(+Iω T_s) and F{x} = Σ x[n] z^(-n) over one period.  The prefilters V_1 = 1 and V_2 = (z - 1)/z act in
    time, so that an angle that does not return to its start, or drifts at constant speed, leaves no leakage.  (The last
    equality of (3.15) holds for Ĝ_τω; dividing by V_2 gives the angle, as (3.8) says.)  The noise level is that of the
    mean of e_p = ŵ_p - Ĝ_i û_p, in which both signals' noise is.  û is a held torque: Ĝ is the exact sampled response.

    Parameters
    ----------
    torque : ndarray (n,), N m, motor shaft
        torque[n] acts from sample n to n + 1.
    position : ndarray (n,), rad
        Motor angle.
    sample_period_s : float
        T_s, s.
    period_samples : int
        Samples of one period.
    first_sample : int
        Where the first measured period begins; what is before is run-in.
    t_s : ndarray (n,) or None, s
        Time stamps. A gap in them, or a value that is not finite, is a lost sample: its period is left out, and the later periods keep
        their places.
    starts : sequence of int or None
        First samples of the periods that count, where not every one behind ``first_sample`` does.

    Returns
    -------
    FrequencyResponse
        Lines 1/(period) apart, without those the torque does not excite.

    Raises
    ------
    DataError
        When arrays do not match, fewer than two whole periods are left or no line is excited.

    References
    ----------
    Thesis (3.7) to (3.15), 3.4; Pintelon, Schoukens, System Identification (2012), section 2.4.
    """
    freq_hz, u, w, remarks = period_spectra(torque, position, sample_period_s, period_samples, first_sample, t_s=t_s, starts=starts)
    n_used = len(u)
    u_mean, w_mean = u.mean(axis=0), w.mean(axis=0)
    u_std = np.sqrt(np.sum(np.abs(u - u_mean) ** 2, axis=0) / (n_used - 1) / n_used)
    strength = np.abs(u_mean)
    excited = (strength >= LEAST_EXCITATION * strength.max()) & (strength > LEAST_SIGNIFICANCE * u_std)
    if not excited.any():
        raise DataError(
            f"no frequency is excited: the largest torque line is {strength.max() / period_samples:.3g} N m, not "
            f"{LEAST_SIGNIFICANCE:.0f} times its scatter between periods; raise the amplitude or check that period_samples "
            "is the period of the excitation"
        )
    if n_left_out := int(np.sum(~excited)):
        remarks.append(f"{n_left_out} of {len(excited)} lines left out because the torque does not excite them")

    freq_hz, u, w, u_mean = freq_hz[excited], u[:, excited], w[:, excited], u_mean[excited]
    inner = w_mean[excited] / u_mean
    scatter = np.sum(np.abs(w - inner * u) ** 2, axis=0) / (n_used - 1)
    z = np.exp(2j * np.pi * freq_hz * sample_period_s)
    integrator = z / (z - 1.0)
    power = np.sum(np.abs(u) ** 2, axis=0) * np.sum(np.abs(w) ** 2, axis=0)
    cross = np.abs(np.sum(w * np.conj(u), axis=0)) ** 2
    return FrequencyResponse(
        freq_hz=freq_hz,
        h=integrator * inner,
        noise=np.abs(integrator) * np.sqrt(scatter / n_used) / np.abs(u_mean),
        coherence=np.divide(cross, power, out=np.zeros_like(cross), where=power > 0),
        n_periods=n_used,
        sample_period_s=sample_period_s,
        remarks=tuple(remarks),
    )


def period_spectra(
    torque: Array,
    position: Array,
    sample_period_s: float,
    period_samples: int,
    first_sample: int,
    *,
    t_s: Array | None,
    starts: Sequence[int] | None = None,
) -> tuple[Array, ComplexArray, ComplexArray, list[str]]:
    """Spectra of torque and speed of every whole period; arguments and errors as for :func:`estimate_response`.

    Parameters
    ----------
    torque, position : ndarray, (n,)
        N m at the motor shaft and rad.
    sample_period_s : float, s
    period_samples, first_sample : int
        Samples of a period, and where the first begins.
    t_s : ndarray (n,) or None, s
        Time stamps, where samples are missing.
    starts : sequence of int or None
        First samples of the periods that count, where not every one does.

    Returns
    -------
    tuple of ndarray (k,), ndarray (periods, k), ndarray (periods, k), list of str
        Frequencies, Hz; spectra û_p of the torque and ŵ_p of the speed; what was left out, in words.

    Raises
    ------
    DataError
        For fewer than two whole periods, and as :func:`estimate_response`.
    """
    angle, drive = _on_grid(torque, position, sample_period_s, t_s)
    if period_samples < 4 or first_sample < 0:
        raise DataError(f"a period of {period_samples} samples from sample {first_sample} on is no periodic excitation")
    speed = np.concatenate(([np.nan], np.diff(angle)))
    begins = range(first_sample, len(drive) - period_samples + 1, period_samples) if starts is None else starts
    whole_ones = [start for start in begins if start + period_samples <= len(drive)]
    n_whole = len(whole_ones)
    each = np.array(whole_ones, dtype=np.intp)[:, np.newaxis] + np.arange(period_samples)
    torque_periods, speed_periods = drive[each], speed[each]
    whole = np.isfinite(torque_periods).all(axis=1) & np.isfinite(speed_periods).all(axis=1)
    n_used = int(whole.sum())
    if n_used < 2:
        raise DataError(
            f"{n_used} whole period(s) of {period_samples} samples after sample {first_sample} ({n_whole - n_used} with "
            f"lost samples), at least 2 are needed for a noise level; repeat the record with {2 - n_used} more"
        )
    remarks = []
    if n_used < n_whole:
        remarks.append(f"{n_whole - n_used} of {n_whole} periods left out because samples were lost in them")

    freq_hz = np.asarray(np.fft.rfftfreq(period_samples, sample_period_s)[1:], dtype=np.float64)
    return freq_hz, np.fft.rfft(torque_periods[whole], axis=1)[:, 1:], np.fft.rfft(speed_periods[whole], axis=1)[:, 1:], remarks


def log_spaced_lines(freq_hz: Array, n_lines: int, lowest_hz: float, highest_hz: float) -> NDArray[np.intp]:
    """Choose ``n_lines`` of the given frequencies, nearly logarithmically spaced: every one an existing line, none twice.

    From each line the next target divides the ratio still to go evenly; where lines are too far apart, the next one
    follows.

    Parameters
    ----------
    freq_hz : ndarray (k,), Hz
        Rising.
    n_lines : int
        At least 1.
    lowest_hz, highest_hz : float, Hz
        Only lines within.

    Returns
    -------
    ndarray of int
        Indices into ``freq_hz``, rising, all lines within when there are no more than ``n_lines``.

    Raises
    ------
    DataError
        When no line lies within.

    References
    ----------
    Thesis 3.5, figure 3.9 (F_o, a subset of F).
    """
    within = np.flatnonzero((freq_hz >= lowest_hz) & (freq_hz <= highest_hz))
    if n_lines < 1 or len(within) == 0:
        raise DataError(
            f"no line of the response lies between {lowest_hz:.4g} and {highest_hz:.4g} Hz; it has {len(freq_hz)} lines "
            f"from {freq_hz[0]:.4g} to {freq_hz[-1]:.4g} Hz"
        )
    if len(within) <= n_lines:
        return within
    freq = freq_hz[within]
    chosen = [0]
    for left in range(n_lines - 1, 0, -1):
        target_hz = freq[chosen[-1]] * (freq[-1] / freq[chosen[-1]]) ** (1.0 / left)
        nearest = int(np.argmin(np.abs(freq - target_hz)))
        # Leave as many lines above as are still to be chosen.
        chosen.append(min(max(nearest, chosen[-1] + 1), len(freq) - left))
    return np.asarray(within[np.array(chosen)], dtype=np.intp)


def _on_grid(torque: Array, position: Array, sample_period_s: float, t_s: Array | None) -> tuple[Array, Array]:
    """Position and torque by sample number, NaN where a sample was lost."""
    if torque.ndim != 1 or torque.shape != position.shape or len(torque) < 2:
        raise DataError(f"torque {torque.shape} and position {position.shape} must have one equal length of at least 2")
    if not sample_period_s > 0:
        raise DataError(f"sample period {sample_period_s} s must be positive")
    if t_s is None:
        return position, torque
    if t_s.shape != torque.shape:
        raise DataError(f"t_s {t_s.shape} and torque {torque.shape} must have one equal length")
    # Step by step, so that a clock that runs a little fast or slow does not count as lost samples after a while.
    steps = np.rint(np.diff(t_s) / sample_period_s)
    if not np.all(steps >= 1):
        late = int(np.argmin(steps >= 1))
        raise DataError(
            f"t_s goes from {t_s[late]:.6g} to {t_s[late + 1]:.6g} s at row {late + 1}, less than half a sample period of "
            f"{1e3 * sample_period_s:.4g} ms; check the time stamps or the sample period"
        )
    sample = np.concatenate(([0], np.cumsum(steps))).astype(np.intp)
    grid = np.full((2, int(sample[-1]) + 1), np.nan)
    grid[:, sample] = position, torque
    return grid[0], grid[1]
