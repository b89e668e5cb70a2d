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
from typing import Any

import numpy as np

from beltcomm.arrays import Array, row_means
from beltcomm.fit.noise.colour import NoiseColour, deconvolve, undone_noise
from beltcomm.fit.noise.process_torque import ProcessTorque, Unread, process_from_dict, process_to_dict, with_unread
from beltcomm.fit.torque.lag import VALUES, Lag
from beltcomm.fit.torque.laws import DriveLaw, ReadingLaw
from beltcomm.simulate.imperfect import CELLS, Intersample

#: Deviation from its mean below which a torque is held, as a share of the largest mean.
HELD = 1e-6
#: Periods between an angle and the torque of its row, where that changes all the time.
APART = 0.25
#: Samples before a pulse and behind the end of its answer, share of it that has died away, and slowest pole until then.
BEFORE, BEHIND, FADED, SLOWEST = 4, 8, 1e-9, 0.97
#: Zeros inside the unit circle of the splines of fifth and third order at the samples, twice in place of those outside.
_FIFTH, _THIRD = 2 * (-0.430575347099973, -0.0430962882032647), 2 * (-0.267949192431123,)


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
            cells = _spline_cells(torque, self.reading.late, CELLS)
            means = row_means(cells)
            return means, Intersample(cells - means[:, None])
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
        return torque, None if held else Intersample(above)

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
            return _spline_noise(pole)
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


def _spline_cells(torque: Array, late: float, cells: int) -> Array:
    """Mean over each cell of every period, N m, (n, cells), of readings at instants that are ``late`` by so many periods, (n,).

    Between the samples the torque is a cubic spline, y(t) = Σ c[k] B₃(t/T - k), as the angle is (``noise.propagation``); before the first
    reading it is that, and behind the last one that.
    """
    from scipy.interpolate import CubicSpline  # takes a second to import, and most torques are held

    n = len(torque)
    if n == 1:
        return np.full((1, cells), torque[0])
    whole = CubicSpline(np.arange(n), torque).antiderivative()
    edges = np.arange(n * cells + 1) / cells + late
    inside = np.clip(edges, 0.0, n - 1.0)
    area = whole(inside) + (edges - inside) * np.where(edges < 0.0, torque[0], torque[-1])
    return np.asarray(np.diff(area).reshape(n, cells) * cells)


def _spline_noise(pole: float) -> NoiseColour:
    """Colour in the residual of the noise of such readings; as of readings that are not late, for less than half a sample changes little.

    The spline reaches the residual with the triangular mean over two periods:

        Σ c[k] B₅(n - k):   b(z)/a(z) = (z² + 26 z + 66 + 26 z⁻¹ + z⁻²)/120 / ((z + 4 + z⁻¹)/6)

    ``pole`` is that of the readings' noise, of variance 1.   Source: Unser, Splines, IEEE Signal Processing Magazine 16 (1999).
    """
    numerator, denominator = np.poly(_FIFTH), np.poly((*_THIRD, *((pole,) if pole else ())))
    gain = np.sum(np.poly(_THIRD)) / np.sum(numerator)  # a steady torque is read as it is
    return NoiseColour(pole, tuple(map(float, numerator * gain * np.sqrt(1.0 - pole**2))), tuple(map(float, denominator)))
