"""From the torque setpoint to the torque that acts, and from there to the reading: what a drive does in between.

    setpoint --[delay, filter]--> acting torque --[filter, late]--> reading + sensor noise

Setpoint and reading alone tell only both together.  How much of it lies before the acting torque and how much behind it is told by
the motion (``path_fit.choice``).  The acting torque is taken as the reading, with what the reading's filter took away of the part that
the setpoint explains put back:

    u = r + y - L y,     y : setpoint through the drive,   L : the reading's filter,   r : reading

A faithful reading (L = 1) is taken as it is, so the torque of disturbances inside the drive counts as acting, and the noise of u is the
sensor's, whatever L.

Where no setpoint was recorded the reading tells it, by the inverse of both laws, and the noise of u is the sensor's behind that inverse.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from beltcomm.arrays import Array, later, row_means
from beltcomm.compiled import compiled
from beltcomm.fit.noise.colour import NoiseColour, deconvolve, undone_noise
from beltcomm.fit.noise.process_torque import ProcessTorque, Unread, process_from_dict, process_to_dict, with_unread
from beltcomm.fit.torque.instantaneous import spline_cells, spline_noise
from beltcomm.simulate.imperfect import CELLS, Intersample

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
#: Periods between an angle and the torque of its row, where that changes all the time.
APART = 0.25
#: Samples before a pulse and behind the end of its answer, share of it that has died away, and slowest pole until then.
BEFORE, BEHIND, FADED, SLOWEST = 4, 8, 1e-9, 0.97


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
        if self.kind == "sampled":
            return _follow_samples(cells, self.values[0])
        u, h = np.ascontiguousarray(cells).reshape(-1), sample_s / cells.shape[1]
        if self.kind == "slew rate":
            means = _limit_slew(u, self.values[0] * h)
        elif self.kind == "first order":
            keeps = math.exp(-h / self.values[0])
            means = _follow_first_order(u, keeps, self.values[0] / h * (1.0 - keeps))
        else:
            means = _follow_second_order(u, *_held_second_order(self._roots(), h))
        return means.reshape(cells.shape)

    def poles(self, sample_s: float) -> tuple[complex, ...]:
        """Poles in the clock of the samples.

        Parameters
        ----------
        sample_s : float, s
            Sampling period.

        Returns
        -------
        tuple of complex
            None of a slew rate, which is not linear.
        """
        if self.kind == "sampled":
            return (1.0 - self.values[0],)
        if self.kind == "slew rate":
            return ()
        return tuple(complex(np.exp(root * sample_s)) for root in self._roots())

    def _roots(self) -> tuple[complex, ...]:
        """Poles in continuous time, 1/s."""
        if self.kind == "first order":
            return (-1.0 / self.values[0],)
        omega, ratio = math.tau * self.values[0], self.values[1]
        root = np.sqrt(complex(ratio**2 - 1.0))
        return -omega * (ratio + root), -omega * (ratio - root)

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
        # A limited slew rate does not see where within a cell its command changes; it may as well act ahead of the delay.
        ahead = any(lag.kind == "slew rate" for lag in self.lags)
        old = np.clip((0.0 if ahead else self.delay - whole) * number - np.arange(number), 0.0, 1.0)
        cells = _held(setpoint, whole, old, self.gain)
        for lag in self.lags:
            cells = lag.answer(cells, sample_s)
        if ahead:
            cells = _late(cells, self.delay - whole)
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
        Sampling periods, 0 and more; of an instantaneous one also a part of one before the angle.
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
            return later(torque_at(cells, 1.0 - (self.late - whole)), whole)
        return row_means(_late(cells, self.late))

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
        None where no setpoint was recorded and the torque is held over each period, or where the reading is an instantaneous value.
    commanded : bool
        Whether the reading is only the command.
    acts : float
        Share of what the reading differs from the setpoint's part by that acts and is no noise of the sensor; 1 where nobody knows.
    without_setpoint : bool
        Whether no setpoint was recorded: then the delay is known to whole periods only, and all else is told by the motion.
    rivals : tuple of TorquePath
        Other paths that the records do not tell from this one.
    process : ProcessTorque or None
        What acts beside the setpoint's part, where reading and motion tell how long it lasts, or how much of it is not read.
    instantaneous : bool
        Whether the reading is the torque at an instant and changes all the time between: a loop is faster than the record.
    """

    drive: DriveLaw | None = None
    reading: ReadingLaw = field(default_factory=ReadingLaw)
    commanded: bool = False
    acts: float = 1.0
    without_setpoint: bool = False
    rivals: tuple[TorquePath, ...] = field(default=(), compare=False)
    process: ProcessTorque | None = None
    instantaneous: bool = False

    @property
    def read_as_acts(self) -> bool:
        """True if the reading is the torque that acts."""
        return self.reading.faithful and not self.commanded and not self.instantaneous

    @property
    def chain(self) -> DriveLaw | None:
        """Drive and reading as one law; None without a setpoint."""
        if self.drive is None:
            return None
        return replace(self.drive, delay=self.drive.delay + self.reading.late, lags=(*self.drive.lags, *self.reading.lags))

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
        means = row_means(self.drive.cells(setpoint, sample_s))
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
        if self.instantaneous:
            cells = spline_cells(torque, self.reading.late, CELLS)
            means = row_means(cells)
            return means, Intersample.of(cells - means[:, None])
        if self.drive is None or setpoint is None:
            if self.drive is None and self.reading.faithful:
                return torque, None
            law, setpoint = self._law, torque if self.commanded else deconvolve(torque, *self._answers(sample_s)[::2])
        else:
            law = self.drive
        cells = law.cells(setpoint, sample_s)
        means = row_means(cells)
        if self.commanded:
            torque = means
        elif not self.reading.faithful:
            torque = torque + means - self.reading.read(cells, sample_s)
        above = cells - means[:, None]
        held = float(np.abs(above).max()) <= HELD * max(float(np.abs(means).max()), 1e-300)
        return torque, None if held else Intersample.of(above)

    def acting_noise(self, pole: float, sample_s: float) -> NoiseColour:
        """Colour of the noise of the torque that acts, as the reading tells it.

        Parameters
        ----------
        pole : float
            Of the reading's noise.
        sample_s : float, s
            Sampling period.

        Returns
        -------
        NoiseColour
            Of reading noise with variance 1.

        Raises
        ------
        ValueError
            For a path that cannot be undone.
        """
        if self.instantaneous:
            return spline_noise(pole)
        if self.commanded or (self.reading.faithful and self.drive is None) or not (self.without_setpoint or self.drive is None):
            return self._beside_setpoint(pole, sample_s)
        shown, cells, poles = self._answers(sample_s)
        rising = (np.arange(CELLS) + 0.5) / CELLS**2  # the residual has the triangular mean of the torque over two periods
        falling = rising[::-1]
        acts = cells @ falling + np.concatenate(([0.0], cells[:-1] @ rising))
        return undone_noise(shown, acts, poles, pole)

    def _beside_setpoint(self, pole: float, sample_s: float) -> NoiseColour:
        """Colour of the noise of a reading that is taken as it is, with what it misses of a process torque."""
        unread = self.unread(pole, sample_s)
        if unread is None or self.commanded:
            return NoiseColour(pole)
        return with_unread(np.array(unread.answer), self._reading_poles(sample_s), pole, unread.pole, unread.share)

    def unread(self, pole: float, sample_s: float) -> Unread | None:
        """What acts and is not all read; None where it is, or where nothing tells of any.

        Parameters
        ----------
        pole : float
            Of the reading's noise; of a command it is that of what acts.
        sample_s : float, s
            Sampling period.

        Returns
        -------
        Unread or None
        """
        if self.commanded:
            return Unread(1.0, pole)
        if self.process is None or self.drive is None or self.reading.faithful or not 0.0 < self.acts < 1.0:
            return None
        return Unread(self.acts / (1.0 - self.acts), self.process.pole(sample_s), tuple(map(float, self.read_pulse(sample_s))))

    def read_pulse(self, sample_s: float) -> Array:
        """Answer of the reading to a torque that acts over one sample, until it has died away.

        Parameters
        ----------
        sample_s : float, s
            Sampling period.

        Returns
        -------
        ndarray (k,)
        """
        pulse = np.zeros(_length(self._reading_poles(sample_s)) + math.ceil(self.reading.late))
        pulse[BEFORE] = 1.0
        return self.reading.read(np.repeat(pulse[:, None], CELLS, axis=1), sample_s)[BEFORE:]

    def _reading_poles(self, sample_s: float) -> tuple[complex, ...]:
        return tuple(pole for lag in self.reading.lags for pole in lag.poles(sample_s))

    def can_be_undone(self, sample_s: float) -> bool:
        """True if the reading and what was recorded of the setpoint tell the torque that acts.

        Parameters
        ----------
        sample_s : float, s
            Sampling period.

        Returns
        -------
        bool
            Not of one read at instants that are far from those of the angle: then the torque is held, or stands in another row.
        """
        if self.instantaneous and abs(self.reading.late) > APART:
            return False
        try:
            self.acting_noise(0.0, sample_s)
        except ValueError:
            return False
        return True

    @property
    def _law(self) -> DriveLaw:
        """Law from a setpoint that was not recorded, whose delay is less than a period, or from the command that is read."""
        law = self.drive or DriveLaw(0.0)
        if self.commanded:
            return law
        return replace(
            law, delay=law.delay - math.floor(law.delay), lags=tuple(lag for lag in law.lags if lag.kind != "slew rate"), gain=1.0
        )

    def _answers(self, sample_s: float) -> tuple[Array, Array, tuple[complex, ...]]:
        """Answers of reading and torque in each cell to a setpoint, not recorded, that is 1 for a period; their poles."""
        law = self._law
        poles = tuple(pole for lag in (*law.lags, *self.reading.lags) for pole in lag.poles(sample_s))
        pulse = np.zeros(_length(poles))
        pulse[BEFORE] = 1.0
        cells = law.cells(pulse, sample_s)
        return self.reading.read(cells, sample_s)[BEFORE:], cells[BEFORE:], poles


def _length(poles: tuple[complex, ...]) -> int:
    """Samples of a pulse and of its answer until it has died away."""
    slowest = max((abs(pole) for pole in poles), default=0.0)
    return BEFORE + BEHIND + math.ceil(math.log(FADED) / math.log(max(min(slowest, SLOWEST), FADED)))


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
        "unseen": path.without_setpoint,
        "instantaneous": path.instantaneous,
        "rivals": [path_to_dict(rival) for rival in path.rivals],
        **process_to_dict(path.process),
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
    process = process_from_dict(data.get("process"))
    unseen, instantaneous = (bool(data.get(key, False)) for key in ("unseen", "instantaneous"))
    return TorquePath(law, reading, bool(data["commanded"]), float(data["acts"]), unseen, rivals, process, instantaneous)


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


def _late(cells: Array, periods: float) -> Array:
    """Cells of a torque so many periods later, (n, cells); it was held before the first one."""
    row, steps = cells.reshape(-1), periods * cells.shape[1]
    whole = math.floor(steps)
    now, before = later(row, whole), later(row, whole + 1)
    return np.asarray((now + (steps - whole) * (before - now)).reshape(cells.shape))


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


@compiled
def _held(setpoint: Array, late: int, old: Array, gain: float) -> Array:
    """Cells of a setpoint that is held for a period, so many later; old : share of each cell in which the one before acts."""
    out = np.empty((len(setpoint), len(old)))
    for i in range(len(setpoint)):
        now, before = setpoint[max(i - late, 0)], setpoint[max(i - late - 1, 0)]
        for j in range(len(old)):
            out[i, j] = gain * (now + (before - now) * old[j])
    return out


@compiled
def _follow_samples(cells: Array, share: float) -> Array:
    """Cells of a torque that takes a share of the way to its command in every period."""
    out = cells.copy()
    for i in range(1, cells.shape[0]):
        for j in range(cells.shape[1]):
            out[i, j] = share * cells[i, j] + (1.0 - share) * out[i - 1, j]
    return out


@compiled
def _follow_first_order(u: Array, keeps: float, lags: float) -> Array:
    """Mean over each cell behind a first-order lag that keeps so much of a difference over one, and lags by so much of it in the mean."""
    out, y = np.empty_like(u), u[0]
    for i in range(len(u)):
        out[i] = u[i] + (y - u[i]) * lags
        y = keeps * y + (1.0 - keeps) * u[i]
    return out


@compiled
def _follow_second_order(u: Array, b: Array, a: Array) -> Array:
    """Mean over each cell behind a second-order lag, of :func:`_held_second_order`, taken as linear in it."""
    out, first = np.empty_like(u), u[0]
    x1, y1, y2 = 0.0, 0.0, 0.0
    for i in range(len(u)):
        x = u[i] - first
        y = b[0] * x + b[1] * x1 - a[1] * y1 - a[2] * y2
        out[i] = first + 0.5 * (y1 + y)
        x1, y1, y2 = x, y, y1
    return out


def _held_second_order(poles: tuple[complex, ...], h: float) -> tuple[Array, Array]:
    """Numerator and denominator in z⁻¹ of p1 p2/((s - p1)(s - p2)) behind a hold over h seconds, at the ends of the holds."""
    p1, p2 = poles  # slow and fast
    if abs(p1 - p2) < 1e-6 * abs(p1):
        p2 = p1 * (1.0 + 1e-6)
    e1, e2 = np.exp(p1 * h), np.exp(p2 * h)
    r1, r2 = p2 / (p1 - p2), -p1 / (p1 - p2)
    first, second = 1.0 + r1 * e1 + r2 * e2, 1.0 + r1 * e1**2 + r2 * e2**2  # the step's answer after one and two holds
    a = np.real(np.array([1.0, -(e1 + e2), e1 * e2]))
    return np.array([float(np.real(first)), float(np.real(second)) - float(np.real(first)) * (1.0 - a[1])]), a
