"""The border between a virtual drive and the machine behind it: an object with a step method.

The product's default is :class:`beltcomm.simulate.plant.SimulatedPlant`; the accuracy figures of the tests use an
independent simulator that implements the same protocol.  What a plant file adds of the drive stands here as well:
filters, noise, steps and lags.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from numbers import Real
from typing import Any, Protocol, runtime_checkable

from beltcomm.axis.entries import AxisEntry
from beltcomm.errors import UsageError


def _number(default: float, meaning: str, **bounds: Any) -> Any:
    return field(default=default, metadata={"entry": AxisEntry(meaning, **bounds)})


def _checked_number(name: str, value: object, entry: AxisEntry) -> float | int:
    """A number within the bounds of its entry; whole ones as int.   Raises UsageError."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise UsageError(f"{name} is {value!r}; give a plain number, without its unit")
    if fault := entry.fault(float(value)):
        raise UsageError(f"{name} is {float(value):g} ({entry.meaning}); {fault}")
    return int(float(value)) if entry.whole else float(value)


@dataclass(frozen=True)
class Instruments:
    """Deviations of a real drive's torque and angle from a pure delay, white noise and whole counts, at the motor shaft.

    The torque goes: setpoint, ``setpoint_delay_s``, slope limit, setpoint filter, low-pass, notch, current loop, + process torque = acting
    torque; acting torque (or the command in front of the current loop), mean of a tick, late, filter and noise, steps = 6077h.

    Parameters
    ----------
    torque_slew_nm_s : float
        Slope limit of the setpoint, N m/s; 0: none.
    setpoint_filter_s : float
        Time constant of the setpoint's first-order filter, s.
    setpoint_low_pass_hz : float
        Cut-off of a second-order Butterworth low-pass behind it, Hz; 0: none.
    setpoint_notch_hz, setpoint_notch_width_hz, setpoint_notch_db : float
        Middle of a notch behind them against a resonance, Hz, 0: none; its width at -3 dB, were it of no bottom, Hz; its depth, dB.
    current_loop_s : float
        Time constant of a current loop of first order, s.
    current_loop_hz, current_loop_damping : float
        Natural frequency, Hz, and damping ratio of a current loop of second order; 0 Hz: none.
    process_torque_nm, process_torque_time_s : float
        Torque that acts without being asked for while the stage is on, N m rms, and its correlation time, s; 0 s: white, held over a tick.
    torque_noise_time_s : float
        Correlation time of the sensor noise ``torque_noise_nm``, s; 0: white.
    reading_filter_s, reading_filters_noise : float, bool
        Time constant of the reading's first-order filter, s, and whether the sensor noise passes through it as well.
    reading_late_ticks : float
        Age of the reading beyond that of the angle beside it, in ticks of 1 ms.
    reading_step_nm : float
        Resolution of the reading, N m; 0: that of 6077h.
    reading_is_command : bool
        6077h is the torque asked of the current loop, without sensor noise.
    lines_per_rev, interpolation_error_rad, interpolation_error_twice_rad : int, float, float
        Lines of a sin/cos encoder per motor turn, and the amplitudes of its error once and twice per line, rad.

    Raises
    ------
    UsageError
        For a value out of bounds and for two that exclude each other.
    """

    torque_slew_nm_s: float = _number(0.0, "slope limit of the torque setpoint", at_least=0.0)
    setpoint_filter_s: float = _number(0.0, "filter of the torque setpoint", at_least=0.0, at_most=0.1)
    setpoint_low_pass_hz: float = _number(0.0, "cut-off of the torque setpoint's low-pass", at_least=0.0, at_most=2e4)
    setpoint_notch_hz: float = _number(0.0, "middle of the torque setpoint's notch", at_least=0.0, at_most=2e4)
    setpoint_notch_width_hz: float = _number(50.0, "width of the torque setpoint's notch", above=0.0, at_most=2e4)
    setpoint_notch_db: float = _number(20.0, "depth of the torque setpoint's notch", at_least=0.0, at_most=100.0)
    current_loop_s: float = _number(0.0, "time constant of the current loop", at_least=0.0, at_most=0.1)
    current_loop_hz: float = _number(0.0, "natural frequency of the current loop", at_least=0.0, at_most=2e4)
    current_loop_damping: float = _number(0.7, "damping ratio of the current loop", above=0.0, at_most=10.0)
    process_torque_nm: float = _number(0.0, "rms of the process torque", at_least=0.0)
    process_torque_time_s: float = _number(0.0, "correlation time of the process torque", at_least=0.0)
    torque_noise_time_s: float = _number(0.0, "correlation time of the sensor noise", at_least=0.0)
    reading_filter_s: float = _number(0.0, "filter of the torque reading", at_least=0.0, at_most=1.0)
    reading_filters_noise: bool = False
    reading_late_ticks: float = _number(0.0, "age of the torque reading in ticks", at_least=0.0, at_most=100.0)
    reading_step_nm: float = _number(0.0, "resolution of the torque reading", at_least=0.0)
    reading_is_command: bool = False
    lines_per_rev: int = _number(0, "lines of the encoder per turn", at_least=0.0, at_most=1e6, whole=True)
    interpolation_error_rad: float = _number(0.0, "interpolation error once per line", at_least=0.0, at_most=0.1)
    interpolation_error_twice_rad: float = _number(0.0, "interpolation error twice per line", at_least=0.0, at_most=0.1)

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if "entry" not in each.metadata:
                if not isinstance(value, bool):
                    raise UsageError(f"{each.name} is {value!r}; write true or false")
                continue
            object.__setattr__(self, each.name, _checked_number(each.name, value, each.metadata["entry"]))
        if self.current_loop_s and self.current_loop_hz:
            raise UsageError(
                "current_loop_s and current_loop_hz are both given; a current loop is of first or of second order, leave one out"
            )
        if self.reading_filters_noise and not self.reading_filter_s:
            raise UsageError("reading_filters_noise is true without a filter; give reading_filter_s too, or leave it out")
        steepest = self.lines_per_rev * (self.interpolation_error_rad + 2.0 * self.interpolation_error_twice_rad)
        if (self.interpolation_error_rad or self.interpolation_error_twice_rad) and not self.lines_per_rev:
            raise UsageError("an interpolation error repeats with the encoder's lines; give lines_per_rev too")
        if steepest >= 1.0:
            raise UsageError(
                f"the interpolation error of {self.lines_per_rev} lines moves {steepest:.3g} times as fast as the shaft, which none "
                "does; keep lines_per_rev · (interpolation_error_rad + 2 interpolation_error_twice_rad) below 1"
            )


#: The drive without any of them.
IDEAL = Instruments()
#: Keys of a drive section that are instruments.
_INSTRUMENTS = tuple(each.name for each in fields(Instruments))
#: What every drive has, its default and its bounds.
_ENTRIES: Mapping[str, tuple[float, AxisEntry]] = {
    "setpoint_delay_s": (1e-3, AxisEntry("time from torque setpoint to torque", at_least=0.0, at_most=1.0)),
    "torque_noise_nm": (6e-3, AxisEntry("rms of the noise on the torque reading", at_least=0.0)),
    "counts_per_rev": (65536, AxisEntry("encoder counts per motor revolution", at_least=1.0, at_most=2.0**32 - 1.0, whole=True)),
    "start_position_m": (0.25, AxisEntry("place of the carriage when the drive is switched on")),
    "brake_torque_nm": (0.0, AxisEntry("torque of the holding brake", at_least=0.0)),
    "brake_time_s": (0.0, AxisEntry("time in which the holding brake opens or closes", at_least=0.0)),
}
#: Of the motor's nameplate: N m, N m, A rms, 1/min.
_NAMEPLATE = {
    "rated_torque_nm": AxisEntry("rated torque of the motor", above=0.0),
    "peak_torque_nm": AxisEntry("peak torque of the motor", above=0.0),
    "rated_current_a": AxisEntry("rated current of the motor", above=0.0),
    "max_speed_rpm": AxisEntry("largest speed of the motor", above=0.0),
}
#: What a drive section may hold.
DRIVE_KEYS = (*_ENTRIES, *_NAMEPLATE, *_INSTRUMENTS)


def drive_values(section: Mapping[str, Any]) -> dict[str, Any]:
    """The drive that a section describes.

    Parameters
    ----------
    section : mapping
        Numbers by key of ``DRIVE_KEYS``; what is left out is an ideal drive with the thesis's encoder, delay and noise.

    Returns
    -------
    dict
        The numbers that every drive has by name, ``motor`` (of the nameplate what is given) and ``instruments``.

    Raises
    ------
    UsageError
        For an unknown key and a value that cannot be.
    """
    if unknown := [str(key) for key in section if key not in DRIVE_KEYS]:
        raise UsageError(f"{', '.join(unknown)} is not known; known are {', '.join(DRIVE_KEYS)}")
    values: dict[str, Any] = {key: _checked_number(key, section.get(key, default), entry) for key, (default, entry) in _ENTRIES.items()}
    values["motor"] = {key: _checked_number(key, section[key], entry) for key, entry in _NAMEPLATE.items() if key in section}
    values["instruments"] = Instruments(**{key: section[key] for key in _INSTRUMENTS if key in section})
    return values


def drive_section(values: Mapping[str, Any]) -> dict[str, Any]:
    """Inverse of :func:`drive_values`; instruments at their defaults are left out.

    Parameters
    ----------
    values : mapping
        What :func:`drive_values` returns.

    Returns
    -------
    dict
        Plain numbers by key of ``DRIVE_KEYS``.
    """
    own = values["instruments"]
    told = {key: getattr(own, key) for key in _INSTRUMENTS if getattr(own, key) != getattr(IDEAL, key)}
    return {**{key: values[key] for key in _ENTRIES}, **values["motor"], **told}


class Plant(Protocol):
    """A machine seen from the motor shaft.

    Attributes
    ----------
    position_rad : float, rad
        True motor angle.
    velocity_rad_s : float, rad/s
    cart_position_m : float, m
        True carriage position relative to where the run began (for judging only).
    belt_force_n : float, N
        Force in the driving belt strand (for judging only).
    """

    position_rad: float
    velocity_rad_s: float
    cart_position_m: float
    belt_force_n: float

    def step(self, torque_nm: float, duration_s: float) -> None:
        """Let a torque act; deterministic.

        Parameters
        ----------
        torque_nm : float, N m, motor shaft
            Held all the time.
        duration_s : float, s
            How long.
        """
        ...


@runtime_checkable
class BrakedPlant(Protocol):
    """A machine whose motor has a holding brake, beside :class:`Plant`."""

    def brake(self, torque_nm: float) -> None:
        """Close or open the holding brake from now on.

        Parameters
        ----------
        torque_nm : float, N m, motor shaft
            With up to which it holds; 0: it is open.
        """
        ...
