"""From the torque setpoint to the torque that acts, and from there to the reading: what a drive does in between.

    setpoint --[delay, filter]--> acting torque --[filter, late]--> reading + sensor noise

Setpoint and reading alone tell only both together.  How much of it lies before the acting torque and how much behind it is told by
the motion (``path_choice``).  The acting torque is taken as the reading, with what the reading's filter took away of the part that
the setpoint explains put back:

    u = r + y - L y,     y : setpoint through the drive,   L : the reading's filter,   r : reading

A faithful reading (L = 1) is taken as it is, so the torque of disturbances inside the drive counts as acting, and the noise of u is the
sensor's, whatever L.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from beltcomm.compiled import compiled
from beltcomm.simulate.intersample import CELLS, Intersample

Array = NDArray[np.float64]
#: A filter: of the drive's samples, or of continuous time and of first or second order, as a current loop is; or a limit of the slew rate.
Kind = Literal["sampled", "first order", "second order", "slew rate"]

#: Values of each kind: share that is new in each sample (0 to 1), time constant s, natural frequency Hz and damping ratio, N m/s at most.
VALUES: Mapping[Kind, tuple[str, ...]] = {
    "sampled": ("share",),
    "first order": ("time_s",),
    "second order": ("frequency_hz", "damping_ratio"),
    "slew rate": ("limit_nm_s",),
}
#: Deviation from its mean below which a torque is held, as a share of the largest mean.
HELD = 1e-6


@dataclass(frozen=True)
class Lag:
    """A filter of the torque, 1 for a slow one, or a limit of its slew rate.

    Attributes
    ----------
    values : tuple of float
        See :data:`VALUES`.
    intervals : tuple of float
        Half widths at 95 %, () where not known.
    """

    kind: Kind
    values: tuple[float, ...]
    intervals: tuple[float, ...] = field(default=(), compare=False)

    def answer(self, cells: Array, sample_s: float) -> Array:
        """The lag's answer to a torque, at rest before.

        Parameters
        ----------
        cells : ndarray (n, cells), N m
            Mean over each cell of every period.
        sample_s : float, s
            Sampling period.

        Returns
        -------
        ndarray
            Shape of ``cells``, N m.
        """
        from scipy.signal import lfilter  # takes a second to import, and most drives have no filter

        if self.kind == "sampled":
            share = self.values[0]
            before = (1.0 - share) * cells[:1]
            return np.asarray(lfilter([share], [1.0, share - 1.0], cells, axis=0, zi=before)[0])
        u, h = cells.reshape(-1), sample_s / cells.shape[1]
        if self.kind == "slew rate":
            return np.asarray(_limit_slew(np.ascontiguousarray(u), self.values[0] * h).reshape(cells.shape))
        if self.kind == "first order":
            keeps = math.exp(-h / self.values[0])
            ends = lfilter([1.0 - keeps], [1.0, -keeps], u, zi=[keeps * u[0]])[0]
            means = u + (np.append(u[0], ends[:-1]) - u) * (self.values[0] / h * (1.0 - keeps))
            return np.asarray(means.reshape(cells.shape))
        omega, ratio = math.tau * self.values[0], self.values[1]
        root = np.sqrt(complex(ratio**2 - 1.0))
        b, a = _held_second_order((-omega * (ratio + root), -omega * (ratio - root)), h)
        ends = lfilter(b, a, u - u[0]) + u[0]
        return np.asarray(0.5 * (np.append(u[0], ends[:-1]) + ends).reshape(cells.shape))

    def delay_s(self, sample_s: float) -> float:
        """Delay of a slow torque.

        Parameters
        ----------
        sample_s : float, s
            Sampling period.

        Returns
        -------
        float, s
        """
        if self.kind == "slew rate":
            return 0.0
        if self.kind == "sampled":
            return sample_s * (1.0 / self.values[0] - 1.0)
        return self.values[0] if self.kind == "first order" else 2.0 * self.values[1] / (math.tau * self.values[0])


@dataclass(frozen=True)
class DriveLaw:
    """Law from torque setpoint to acting torque.

    Attributes
    ----------
    delay : float
        Sampling periods, any number.
    lags : tuple of Lag
        One behind the other.
    gain : float, N m/(N m)
    delay_interval : float
        Half width at 95 %, periods; 0 for a whole delay, and where it is not known.
    """

    delay: float = 1.0
    lags: tuple[Lag, ...] = ()
    gain: float = 1.0
    delay_interval: float = field(default=0.0, compare=False)

    def cells(self, setpoint: Array, sample_s: float, number: int = CELLS) -> Array:
        """Acting torque inside every period; a setpoint is held until the next one.

        Parameters
        ----------
        setpoint : ndarray (n,), N m, motor shaft
        sample_s : float, s
            Sampling period.
        number : int
            Cells per period.

        Returns
        -------
        ndarray
            Mean over each cell, (n, number), N m.
        """
        whole = math.floor(self.delay)
        now, before = _later(setpoint, whole), _later(setpoint, whole + 1)
        old = np.clip((self.delay - whole) * number - np.arange(number), 0.0, 1.0)
        cells = self.gain * (now[:, None] + (before - now)[:, None] * old)
        for lag in self.lags:
            cells = lag.answer(cells, sample_s)
        return np.asarray(cells)

    def delay_s(self, sample_s: float) -> float:
        """Delay of a slow torque.

        Parameters
        ----------
        sample_s : float, s
            Sampling period.

        Returns
        -------
        float, s
        """
        return self.delay * sample_s + sum(lag.delay_s(sample_s) for lag in self.lags)


@dataclass(frozen=True)
class ReadingLaw:
    """Law from acting torque to reading.

    Attributes
    ----------
    late : float
        Sampling periods, 0 and more.
    lags : tuple of Lag
        One behind the other.
    at_end : bool
        Whether it is the torque at the end of the period, else its mean over the period.
    """

    late: float = 0.0
    lags: tuple[Lag, ...] = ()
    at_end: bool = False

    @property
    def faithful(self) -> bool:
        """True if the reading is the mean of the torque that acted from its sample to the next."""
        return self.late == 0.0 and not self.lags and not self.at_end

    def read(self, cells: Array, sample_s: float) -> Array:
        """The reading that a torque gives, without noise.

        Parameters
        ----------
        cells : ndarray (n, cells), N m
            Mean over each cell of every period.
        sample_s : float, s
            Sampling period.

        Returns
        -------
        ndarray (n,), N m
        """
        for lag in self.lags:
            cells = lag.answer(cells, sample_s)
        if self.at_end:
            whole = math.floor(self.late)
            return _later(torque_at(cells, 1.0 - (self.late - whole)), whole)
        n, number = cells.shape
        integral = np.concatenate(([0.0], np.cumsum(cells)))
        edges = (np.arange(n + 1) - self.late) * number
        at = np.where(edges < 0.0, edges * cells[0, 0], np.interp(edges, np.arange(len(integral)), integral))
        return np.asarray(np.diff(at) / number)

    def delay_s(self, sample_s: float) -> float:
        """Delay of a slow torque.

        Parameters
        ----------
        sample_s : float, s
            Sampling period.

        Returns
        -------
        float, s
        """
        return self.late * sample_s + sum(lag.delay_s(sample_s) for lag in self.lags)


@dataclass(frozen=True)
class TorquePath:
    """Both laws.

    Attributes
    ----------
    drive : DriveLaw or None
        None where no setpoint was recorded.
    commanded : bool
        Whether the reading is only the command.
    acts : float
        Share of what the reading differs from the setpoint's part by that acts and is no noise of the sensor; 1 where nobody knows.
    loop_s : float
        Time constant of the current loop where no setpoint was recorded, s, told by the motion alone.
    rivals : tuple of TorquePath
        Other paths that the records do not tell from this one.
    """

    drive: DriveLaw | None = None
    reading: ReadingLaw = field(default_factory=ReadingLaw)
    commanded: bool = False
    acts: float = 1.0
    loop_s: float = 0.0
    rivals: tuple[TorquePath, ...] = field(default=(), compare=False)

    @property
    def read_as_acts(self) -> bool:
        """True if the reading is the torque that acts."""
        return self.reading.faithful and not self.commanded

    def likeliest(self, acting: Array, setpoint: Array | None, sample_s: float) -> Array:
        """The torque that acts without most of the sensor's noise: for what moves between the samples.

        Parameters
        ----------
        acting : ndarray (n,), N m
            Of :meth:`acting_torque`.
        setpoint : ndarray (n,) or None, N m
            None where it was not recorded.
        sample_s : float, s
            Sampling period.

        Returns
        -------
        ndarray
            Mean over each period, (n,), N m.
        """
        if self.drive is None or setpoint is None or self.acts == 1.0:
            return acting
        means = self.drive.cells(setpoint, sample_s).mean(axis=1)
        offset = float(np.median(acting - means))
        return np.asarray(means + offset + self.acts * (acting - means - offset))

    def acting_torque(self, torque: Array, setpoint: Array | None, sample_s: float) -> tuple[Array, Intersample | None]:
        """The torque that acts, from the reading and the setpoint.

        Parameters
        ----------
        torque : ndarray (n,), N m
            Reading at the motor shaft.
        setpoint : ndarray (n,) or None, N m
            None where it was not recorded.
        sample_s : float, s
            Sampling period.

        Returns
        -------
        tuple[ndarray, Intersample | None]
            Mean over each period, (n,), N m, and its spread inside.
        """
        if self.drive is None or setpoint is None:
            torque = self._undo_filter(torque, sample_s)
            return torque, None if self.loop_s == 0.0 else Intersample(_behind_loop(torque, self.loop_s, sample_s))
        cells = self.drive.cells(setpoint, sample_s)
        means = cells.mean(axis=1)
        if self.commanded:
            torque = means
        elif not self.reading.faithful:
            torque = torque + means - self.reading.read(cells, sample_s)
        above = cells - means[:, None]
        held = float(np.abs(above).max()) <= HELD * max(float(np.abs(means).max()), 1e-300)
        return torque, None if held else Intersample(above)

    def noise_undone(self, colour: float) -> tuple[float, float]:
        """Noise of a late reading that is undone without a setpoint.

        x[n] = (w[n] - c x[n-1])/p,   p the larger part of the sample, c = (1 - p)/p:   factor 1/(p √(1 - c²)), colour -c.

        Parameters
        ----------
        colour : float
            Of the reading's noise.

        Returns
        -------
        tuple of float
            Factor on the noise, and its colour then; 1 and as it was for other paths.
        """
        part = self.reading.late - math.floor(self.reading.late)
        if self.drive is not None or part == 0.0:
            return 1.0, colour
        larger = max(part, 1.0 - part)
        c = (1.0 - larger) / larger
        return 1.0 / (larger * math.sqrt(1.0 - c**2)), colour if colour else -c

    def _undo_filter(self, torque: Array, sample_s: float) -> Array:
        """The reading with its filter undone, as one of samples."""
        undone = torque
        for lag in self.reading.lags:
            share = lag.values[0] if lag.kind == "sampled" else 1.0 - math.exp(-sample_s / lag.values[0])
            undone = (undone - (1.0 - share) * _later(undone, 1)) / share
        whole = math.floor(self.reading.late)
        undone = np.append(undone[whole:], np.full(whole, undone[-1])) if whole else undone
        return _undo_mixing(undone, self.reading.late - whole)


#: The reading is the torque that acts.
FAITHFUL = TorquePath()


def path_to_dict(path: TorquePath) -> dict[str, Any]:
    """The path as a plain mapping.

    Parameters
    ----------
    path : TorquePath
        Of the torque.

    Returns
    -------
    dict of str to Any
        Numbers and words only, ready for YAML.
    """

    def lags(law: DriveLaw | ReadingLaw) -> list[dict[str, Any]]:
        return [
            {"kind": lag.kind, "values": list(map(float, lag.values)), "intervals": list(map(float, lag.intervals))} for lag in law.lags
        ]

    drive = path.drive
    return {
        "drive": None
        if drive is None
        else {
            "delay": float(drive.delay),
            "delay_interval": float(drive.delay_interval),
            "lags": lags(drive),
            "gain": float(drive.gain),
        },
        "reading": {"late": float(path.reading.late), "lags": lags(path.reading), "at_end": path.reading.at_end},
        "commanded": path.commanded,
        "acts": float(path.acts),
        "loop_s": float(path.loop_s),
        "rivals": [path_to_dict(rival) for rival in path.rivals],
    }


def path_from_dict(data: Mapping[str, Any]) -> TorquePath:
    """The path that :func:`path_to_dict` wrote.

    Parameters
    ----------
    data : dict of str to Any
        The mapping.

    Returns
    -------
    TorquePath
        Equal to the one written.

    Raises
    ------
    KeyError
        For a damaged one.
    TypeError
        For a damaged one.
    ValueError
        For a damaged one.
    """

    def lags(law: Mapping[str, Any]) -> tuple[Lag, ...]:
        found = []
        for entry in law["lags"]:
            if entry["kind"] not in VALUES:
                raise ValueError(f"no filter of the torque is called {entry['kind']!r}")
            found.append(Lag(entry["kind"], tuple(map(float, entry["values"])), tuple(map(float, entry["intervals"]))))
        return tuple(found)

    drive = data["drive"]
    law = None
    if drive is not None:
        law = DriveLaw(float(drive["delay"]), lags(drive), float(drive["gain"]), float(drive["delay_interval"]))
    reading = ReadingLaw(float(data["reading"]["late"]), lags(data["reading"]), bool(data["reading"].get("at_end", False)))
    rivals = tuple(path_from_dict(rival) for rival in data["rivals"])
    return TorquePath(law, reading, bool(data["commanded"]), float(data["acts"]), float(data["loop_s"]), rivals)


def _behind_loop(means: Array, time_s: float, sample_s: float) -> Array:
    """Torque above its mean in each cell of every period, (n, CELLS), N m, behind a loop of first order whose input is held.

    y' = (u[n] - y)/τ;  from the means over the periods, (n,):  u[n] = (m[n] - μ y[n])/(1 - μ),  y[n+1] = (1 - e) u[n] + e y[n],
    e = exp(-T/τ),  μ = τ (1 - e)/T.
    """
    from scipy.signal import lfilter  # takes a second to import, and most drives have no filter

    keeps = math.exp(-sample_s / time_s)
    share = time_s / sample_s * (1.0 - keeps)
    into, on = (1.0 - keeps) / (1.0 - share), keeps - (1.0 - keeps) * share / (1.0 - share)
    start = means[0]
    begins = np.concatenate(([start], lfilter([into], [1.0, -on], means, zi=[on * start])[0][:-1]))
    held = (means - share * begins) / (1.0 - share)
    edges = np.exp(-np.arange(CELLS + 1) / CELLS * sample_s / time_s)
    falling = (edges[:-1] - edges[1:]) * time_s / sample_s * CELLS
    return np.asarray((begins - held)[:, None] * (falling - share))


def torque_at(cells: Array, share: float) -> Array:
    """Torque at a share of every period, by the parabola through the means of three cells.

    Between two beginnings of a cell it is linear.

    Parameters
    ----------
    cells : ndarray (n, cells), N m
        Mean over each cell.
    share : float
        Of the period, 0 to 1.

    Returns
    -------
    ndarray (n,), N m
    """
    row, number = cells.reshape(-1), cells.shape[1]
    whole = math.floor(share * number)
    part = share * number - whole

    def beginning(cell: int) -> Array:
        last = np.clip(np.arange(len(cells)) * number + cell - 1, 0, len(row) - 1)
        return np.asarray((11.0 * row[last] - 7.0 * row[np.maximum(last - 1, 0)] + 2.0 * row[np.maximum(last - 2, 0)]) / 6.0)

    here = beginning(whole)
    return here if part == 0.0 else here + part * (beginning(whole + 1) - here)


def _undo_mixing(read: Array, part: float) -> Array:
    """Torque m of a reading (1 - part) m[n] + part m[n-1], (n,): solved forwards, or backwards where more of it is of the sample before."""
    from scipy.signal import lfilter  # takes a second to import, and most drives have no filter

    if part == 0.0:
        return read
    if part <= 0.5:
        return np.asarray(lfilter([1.0 / (1.0 - part)], [1.0, part / (1.0 - part)], read, zi=[-part / (1.0 - part) * read[0]])[0])
    back = (1.0 - part) / part
    found = lfilter([1.0 / part], [1.0, back], read[::-1], zi=[-back * read[-1]])[0][::-1]
    return np.append(found[1:], found[-1])


def _later(row: Array, samples: int) -> Array:
    """The row so many samples later, its first value before."""
    return np.concatenate((np.full(samples, row[0]), row[: len(row) - samples])) if samples else row


@compiled
def _limit_slew(u: Array, most: float) -> Array:
    """Mean over each cell of a torque that follows u, (n,), and changes by at most so much a cell."""
    out, y = np.empty_like(u), u[0]
    for i in range(len(u)):
        ahead = u[i] - y
        if abs(ahead) <= most:  # there within the cell, after the share |ahead|/most of it
            out[i] = y + ahead * (1.0 - 0.5 * abs(ahead) / most)
            y = u[i]
        else:
            step = most if ahead > 0.0 else -most
            out[i] = y + 0.5 * step
            y += step
    return out


def _held_second_order(poles: tuple[complex, complex], h: float) -> tuple[Array, Array]:
    """Numerator and denominator in z⁻¹ of p1 p2/((s - p1)(s - p2)) behind a hold over h seconds, at the ends of the holds."""
    p1, p2 = poles
    if abs(p1 - p2) < 1e-6 * abs(p1):
        p2 = p1 * (1.0 + 1e-6)
    e1, e2 = np.exp(p1 * h), np.exp(p2 * h)
    r1, r2 = p2 / (p1 - p2), -p1 / (p1 - p2)
    first, second = 1.0 + r1 * e1 + r2 * e2, 1.0 + r1 * e1**2 + r2 * e2**2  # the step's answer after one and two holds
    a = np.real(np.array([1.0, -(e1 + e2), e1 * e2]))
    return np.array([float(np.real(first)), float(np.real(second)) - float(np.real(first)) * (1.0 - a[1])]), a
