"""Interface of a servo drive, and the search for its adapter.

An adapter is a guest: a package registers a value of type :class:`Adapter` under the entry-point group
``beltcomm.adapters``; nothing here imports one.  Everything crossing this border is SI at the **motor shaft**
(rad, rad/s, N m), because a drive knows no carriage.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from typing import Literal, Protocol

import numpy as np

from beltcomm.arrays import Array as Array
from beltcomm.configfiles import did_you_mean
from beltcomm.control import CascadeStructure
from beltcomm.drive.finding import Finding
from beltcomm.drive.objects import DictionaryEntry, ObjectValue, ParameterObject
from beltcomm.drive.parameters import GainAccess, GainTerm
from beltcomm.errors import UsageError
from beltcomm.given import word
from beltcomm.recording.columns import MOTOR_COLUMNS

#: Columns of every recorded row, in this order; NaN where the drive does not report a quantity.
COLUMNS = MOTOR_COLUMNS

#: See :class:`Motion`; and those in which the drive closes a loop.
MotionKind = Literal["torque", "position", "velocity", "profile"]
LoopKind = Literal["position", "velocity", "profile"]
#: s: a drive must notice within this time that its host is gone, where nothing asks for less.
GUARD_S = 0.05
#: s that a following error beyond its window may last in the drive, or one setpoint period where that is longer.
FOLLOWING_ERROR_S = 3e-3

Row = tuple[float, ...]
Sink = Callable[[Row], None]


class Clock(Protocol):
    """Time as an argument: the wall clock of a real bus, or the virtual time of a simulated one."""

    def now(self) -> float:
        """Seconds on a clock that never goes back."""

    def sleep_until(self, t_s: float) -> None:
        """Wait until ``now() >= t_s``; virtual time moves on, real time waits.

        Parameters
        ----------
        t_s : float, s
            On this clock.
        """
        ...


@dataclass(frozen=True)
class Limits:
    """Limits of a motion; watched in the drive and row by row on the host.

    Attributes
    ----------
    position_min_rad, position_max_rad : float, rad, motor shaft
        In the drive's own zero.
    speed_rad_s : float, rad/s, motor shaft
    torque_nm : float, N m, motor shaft
    deceleration_rad_s2 : float, rad/s², motor shaft
        Along which a quick stop brakes; inf leaves it to the drive.
    lag_rad : float or None, rad
        Largest distance from the reference in a motion of kind "position"; None leaves it to the drive's own setting.
    release : bool
        What breaks a motion off takes the stage off at once, for the brake or friction to stop the axis: nobody knows yet whether the
        drive's own loop would (unless the break says that the axis ``answered``).
    brake_s : float, s
        Which a holding brake needs to open after the stage is on: so long the axis is held before it is moved.
    guard_s : float, s
        Within which the drive is to notice that its host is gone.
    stop_s : float or None, s
        For which a stop is watched at most until the drive ends it by itself, then its stage is taken off; None leaves it as soon as the
        axis stands.
    ratio_m_rad, zero_rad : float
        Carriage = ratio (angle - zero), m, only for messages; 0 when there is no carriage to speak of.
    """

    position_min_rad: float
    position_max_rad: float
    speed_rad_s: float
    torque_nm: float
    deceleration_rad_s2: float = math.inf
    lag_rad: float | None = None
    ratio_m_rad: float = 0.0
    zero_rad: float = 0.0
    release: bool = False
    brake_s: float = 0.0
    guard_s: float = GUARD_S
    stop_s: float | None = None

    def where(self, angle_rad: float) -> str:
        """An angle of the motor in words.

        Parameters
        ----------
        angle_rad : float, rad, motor shaft
            In the drive's zero.

        Returns
        -------
        str
            Where the carriage is, in mm, when its ratio is known; else the angle.
        """
        return f"{1e3 * self.ratio_m_rad * (angle_rad - self.zero_rad):.1f} mm" if self.ratio_m_rad else f"{angle_rad:.4g} rad"


@dataclass(frozen=True)
class Motion:
    """Motion asked of the axis, one entry per sample period; starts and ends at rest.

    "torque" is a torque setpoint, all loops open (cyclic synchronous or profile torque).  In "position" the drive closes its cascade on
    ``position_rad`` (cyclic synchronous or interpolated position), ``velocity_rad_s`` is its velocity feedforward and ``torque_nm`` is
    added to its torque.  In "velocity" it closes its velocity loop on ``velocity_rad_s``; ``torque_nm`` is added to its torque.
    "profile" are strokes from rest to rest: each is handed to the drive as end, speed and acceleration (profile position), which drives a
    trapezoid of the same way, time and top speed by itself, and ends it by itself.  What a drive cannot add
    (:attr:`Capabilities.torque_along`) must be zero, and so are the arrays that a kind does not use.

    Attributes
    ----------
    kind : MotionKind
        See above.
    period_s : float, s
        A whole multiple of ``Capabilities.sample_period_s``.
    position_rad : ndarray (n,), rad, motor shaft
        Absolute in the drive's zero.
    velocity_rad_s : ndarray (n,), rad/s, motor shaft
    torque_nm : ndarray (n,), N m, motor shaft
    rest_nm : float, N m
        Of kind "torque": what holds the axis while the drive is being enabled, after the last entry and until it is stopped.
    lead_rad : ndarray (n,) or None, rad, motor shaft
        Of kind "position": what the drive's reference is ahead of ``position_rad``, along which the axis is to go and is watched; 0 at both
        ends.
    """

    kind: MotionKind
    period_s: float
    position_rad: Array
    velocity_rad_s: Array
    torque_nm: Array
    rest_nm: float = 0.0
    lead_rad: Array | None = None

    def __post_init__(self) -> None:
        n = len(self.torque_nm)
        if self.lead_rad is not None and len(self.lead_rad) != n:
            raise ValueError("the lead of a motion must have as many entries as the motion")
        if not (len(self.position_rad) == len(self.velocity_rad_s) == n) or n == 0:
            raise ValueError("the three arrays of a motion must have one equal, positive length")

    @property
    def ahead_rad(self) -> float:
        """Largest lead of the reference, rad."""
        return 0.0 if self.lead_rad is None else float(np.max(np.abs(self.lead_rad)))

    @property
    def reach_rad(self) -> tuple[float, float] | None:
        """Lowest and highest reference of one that leads, rad; None of one that does not."""
        if self.lead_rad is None:
            return None
        sent = self.position_rad + self.lead_rad
        return float(sent.min()), float(sent.max())


@dataclass(frozen=True)
class Guarding:
    """Reaction of a drive to the silence of its host, seen once at standstill (:meth:`Drive.prove_guarding`).

    Attributes
    ----------
    guard_s : float
        What it was set to, s.
    reaction_s : float
        From the last sign of life to its reaction, s.
    brakes : bool
        It was seen to brake before its stage went off; else only friction, or a brake, stops the axis.
    """

    guard_s: float
    reaction_s: float
    brakes: bool

    def held_s(self, guard_s: float) -> float:
        """Longest time for which the last torque is held.

        Parameters
        ----------
        guard_s : float, s
            That the guarding is set to.

        Returns
        -------
        float, s
        """
        return guard_s + max(self.reaction_s - self.guard_s, 0.0)


@dataclass(frozen=True)
class ObservedStop:
    """Course of a quick stop, from when it was asked for.

    Attributes
    ----------
    t_s, position_rad : tuple of float, s and rad at the motor shaft
        The samples, the last one before it first.
    ended_s : float or None, s
        When the drive took its stage off by itself, which it does at the end of its ramp; None where the host did.
    """

    t_s: tuple[float, ...]
    position_rad: tuple[float, ...]
    ended_s: float | None


@dataclass(frozen=True)
class KnownMotor:
    """Motor as known beforehand, for what a drive does not tell; None where nobody knows it.

    Attributes
    ----------
    rated_torque_nm, peak_torque_nm : float or None, N m
    torque_constant_nm_a : float or None, N m per A rms
    max_speed_rad_s : float or None, rad/s
        That it is driven with at most.
    counts_per_rev : int or None
        Increments of its encoder.
    """

    rated_torque_nm: float | None = None
    peak_torque_nm: float | None = None
    torque_constant_nm_a: float | None = None
    max_speed_rad_s: float | None = None
    counts_per_rev: int | None = None


@dataclass(frozen=True)
class StatedReading:
    """Statement about the torque that a drive reports, None where there is none: a hypothesis that its records are held against.

    Attributes
    ----------
    late_s : float or None, s
        By which it is older than the position beside it, beside ``torque_sampling``.
    filter_s : float or None, s
        Time constant of its filter.
    command : bool or None
        It is only the command.
    """

    late_s: float | None = None
    filter_s: float | None = None
    command: bool | None = None


@dataclass(frozen=True)
class Capabilities:
    """Capabilities of a connected drive, as read from it or from its profile (never assumed).

    Attributes
    ----------
    kinds : frozenset of str
        The kinds of :class:`Motion` it can run.
    sample_period_s : float, s
        Shortest period of the synchronous exchange.
    counts_per_rev : int
        Steps of the position that it tells, per motor revolution.
    torque_step_nm : float, N m
        Resolution of a torque setpoint.
    torque_sampling : {'over', 'after'}
        When the reported torque was acting, relative to the position of the same frame: "over" the period that follows, "after": the period
        just ended. The adapter has already shifted its rows so that ``torque_nm[n]`` acts from ``t[n]`` to ``t[n+1]``; the word is kept in
        the run folder as provenance.
    structure : CascadeStructure
        The cascade inside the drive.
    rated_torque_nm, peak_torque_nm : float, N m
    rated_current_a : float, A rms
    max_speed_rad_s : float, rad/s
    referenced : bool
        The drive knows its zero.
    torque_along : frozenset of str
        The kinds of closed-loop motion to whose torque it adds the motion's.
    identity : dict of str to str
        Name, maker, serial number, firmware ... as text, to recognise the same drive on ``--resume``; "" where the port that it is
        connected by cannot tell.
    refused : dict of str to str
        Why kinds of motion that the drive itself may have are not offered, by kind: a sentence with the remedy.
    parameters : dict of str to ParameterObject
        The objects that hold the names of :meth:`Drive.backup`.
    uncalibrated : frozenset of str
        Those of them whose meaning nobody knows yet: :meth:`Drive.write` refuses to change them until :meth:`Drive.calibrate` has told.
    cautions : tuple of str
        What of its units and ratings is not its own word, what of the limits that a record sets it does not take, and what stops the axis
        instead, in sentences.
    not_taken : frozenset of int
        The objects that hold these limits.
    gains
        What can be done with the gains of its loops.
    gain_terms
        What is known of those that only a person sets.
    exchange, torque_scale : str
        In words, the period of the exchange and what it costs the bus; why the unit of torque is in doubt, "" when it is not.
    shortest_guard_s : float or None, s
        Shortest time in which it can be made to notice that its host is gone; None when nothing in it watches the host.
    feel_rad : float, rad, motor shaft
        No further goes the first motion, which shows whether the units that nobody tells are those that are taken; 0 where they are told.
    torque_reading : StatedReading or None
        What its profile states of the reported torque.
    overload_time_s : float or None, s
        For which the drive lets the motor have its peak torque from cold; None when it does not tell.
    encoder_counts_per_rev : int or None
        Of the encoder, where the positions are coarser than that.
    stop_unit : str
        In words, what the deceleration of its quick stop counts in and who says so, where the drive itself does not; "" where it does.
    following_error_stops : bool
        A following error beyond its window is known to be a fault that stops it; where it is not, a host that is lost in a move is
        predicted without it as well.
    units : Mapping of str to float, SI at the motor shaft
        One raw unit of position, speed, acceleration, torque and rated torque, by these names: those that drive or profile tell.
    """

    name: str
    kinds: frozenset[str]
    sample_period_s: float
    counts_per_rev: int
    torque_step_nm: float
    torque_sampling: Literal["over", "after"]
    structure: CascadeStructure
    rated_torque_nm: float
    peak_torque_nm: float
    rated_current_a: float
    max_speed_rad_s: float
    can_home: bool
    referenced: bool
    identity: Mapping[str, str] = field(default_factory=dict)
    torque_along: frozenset[str] = frozenset()
    refused: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, ParameterObject] = field(default_factory=dict)
    uncalibrated: frozenset[str] = frozenset()
    gains: GainAccess = "writable"
    gain_terms: tuple[GainTerm, ...] = ()
    cautions: tuple[str, ...] = ()
    not_taken: frozenset[int] = frozenset()
    exchange: str = ""
    torque_scale: str = ""
    shortest_guard_s: float | None = None
    encoder_counts_per_rev: int | None = None
    overload_time_s: float | None = None
    feel_rad: float = 0.0
    torque_reading: StatedReading | None = None
    stop_unit: str = ""
    following_error_stops: bool = False
    units: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class ExchangeReport:
    """Quality of one recording: rows delivered, cycles lost on the bus, and the largest deviation of a period, s.

    Attributes
    ----------
    irregular : int
        Rows whose period deviated by more than a quarter; their stamps say by how much.
    remarks : tuple of str
        What else the drive said of itself, in words.
    limited_cycles : int
        Samples in which the drive said that a limit of its own was active (statusword bit 11).
    """

    rows: int
    lost_cycles: int
    worst_jitter_s: float
    irregular: int = 0
    remarks: tuple[str, ...] = ()
    limited_cycles: int = 0


class Drive(Protocol):
    """One connected drive.  Methods move machines; assignments never do.  Not thread-safe.

    Use as a context manager: leaving it always stops the axis, restores what the adapter changed for its own purposes
    (operation mode, PDO mapping, guarding, limits) and closes the port.
    """

    capabilities: Capabilities
    clock: Clock

    def read(self, names: Sequence[str]) -> dict[str, float]:
        """Values of named quantities.

        Names are ``position_rad``, ``velocity_rad_s``, ``torque_nm``, ``state`` (CiA 402 state number), ``referenced``, and every writable
        name of :meth:`backup`.

        Parameters
        ----------
        names : sequence of str
            Of the quantities.

        Returns
        -------
        dict of str to float
            SI values by name, motor shaft.

        Raises
        ------
        UsageError
            For an unknown name.
        """
        ...

    def write(self, values: Mapping[str, float]) -> dict[str, float]:
        """Write named parameters (stage off when the drive demands it) and read them back.

        Parameters
        ----------
        values : dict of str to float
            SI values by name, motor shaft.

        Returns
        -------
        dict of str to float
            What is stored.

        Raises
        ------
        Refused
            For another value of an uncalibrated gain.
        ObjectLocked
            For an object that is never written.
        ObjectRefused
            When the drive refuses.
        DriveError
            When the value read back is not the quantised one asked for; then everything written by this call has been put back.
        """
        ...

    def calibrate(self, units: Mapping[str, float]) -> None:
        """Declare what one raw unit of uncalibrated gains means.

        Nothing is written; :attr:`capabilities` and all values of these names follow.

        Parameters
        ----------
        units : dict of str to float
            By name: N m s/rad, 1/s, or s where an object holds an integral time.

        Raises
        ------
        UsageError
        """
        ...

    def backup(self) -> dict[str, float]:
        """All parameters beltcomm may ever write (gains, filters, feedforward, limits), as they stand now."""
        ...

    def objects(self) -> tuple[ObjectValue, ...]:
        """The objects behind :meth:`backup`, and those lent to this session, with the raw values that the drive had before it."""
        ...

    def read_objects(self, places: Sequence[tuple[int, int, str]]) -> list[float | None]:
        """Raw values of objects.

        Parameters
        ----------
        places : sequence of tuple[int, int, str]
            Index, subindex and data type of each.

        Returns
        -------
        list of float | None
            None where the drive has none or does not tell.
        """
        ...

    def write_objects(self, values: Sequence[ObjectValue]) -> None:
        """Write raw values with the stage off, read them back; all or none.

        Parameters
        ----------
        values : sequence of ObjectValue
            The objects and their values.

        Raises
        ------
        ObjectLocked
            Before anything is written.
        ObjectRefused
            When the drive refuses.
        DriveError
            When another value came back.
        """
        ...

    def save(self) -> None:
        """Make the present parameters permanent (object 1010h).  Only on the user's word."""
        ...

    def home(self, limits: Limits) -> None:
        """Run the drive's own homing.

        Parameters
        ----------
        limits : Limits
            What the motion must stay within.

        Raises
        ------
        Refused
            Where there is none.
        SafetyStop
            A limit was met.
        DriveFault
            The drive reports a fault.
        """
        ...

    def record(self, motion: Motion, limits: Limits, sink: Sink) -> ExchangeReport:
        """Enable, run ``motion``, pass each row to ``sink`` while the axis moves, then bring it to rest and disable.

        Before the first motion of kind "torque" :meth:`prove_guarding` is done.
        Rows follow :data:`COLUMNS`; ``t_s`` is the time stamp of the sample, not a grid.  Any exception out of this
        call (also one raised by ``sink``, also KeyboardInterrupt) leaves a stopped, disabled axis.

        Parameters
        ----------
        motion : Motion
            What to run.
        limits : Limits
            What the motion must stay within.
        sink : Sink
            Takes each row.

        Returns
        -------
        ExchangeReport
            What the exchange was like.

        Raises
        ------
        SafetyStop
            A limit was exceeded; it says which, with the value.
        DriveFault
            The drive reports a fault.
        BusError
            Frames were lost.
        """
        ...

    def prove_guarding(self, limits: Limits, rest_nm: float = 0.0) -> Guarding:
        """Once per connection: enable the axis at standstill, fall silent, see how the drive takes that, and acknowledge its fault.

        Later calls return what was seen.

        Parameters
        ----------
        limits : Limits
            ``guard_s`` is the time to prove.
        rest_nm : float, N m
            What holds the axis.

        Returns
        -------
        Guarding
            What was seen.

        Raises
        ------
        DriveError
            When the drive does not react within ``limits.guard_s`` and a tolerance, or nothing in it watches its host: then it gets no
            motion of kind "torque".
        """
        ...

    def stop(self) -> None:
        """Quick stop, then disable.  Never raises; safe to call at any time."""
        ...

    def close(self) -> None:
        """Stop, restore, release the port.  Never raises; idempotent."""
        ...

    def __enter__(self) -> Drive: ...

    def __exit__(self, *exc: object) -> None: ...


class Service(Protocol):
    """A simulated drive that other processes find on an interface.   Use as a context manager."""

    #: What another process gives as ``--drive``, and in words what is served there.
    reached_as: str
    title: str

    def run(self) -> Mapping[str, int]:
        """Serve until KeyboardInterrupt, which is the ordinary end; returns what was counted.

        Raises
        ------
        BusError
        """
        ...

    def __enter__(self) -> Service: ...

    def __exit__(self, *exc: object) -> None: ...


Heard = tuple[float, int, bytes, bool]
"""A frame that was heard: time in s, identifier, data, whether it is a remote frame."""


class Listening(Protocol):
    """A bus that is listened to: nothing is written to a drive, nothing moves.   Use as a context manager.

    Attributes
    ----------
    title : str
        Where, in words.
    """

    title: str

    def frames(self, wait_s: float) -> list[Heard]:
        """Frames since the last call.

        Parameters
        ----------
        wait_s : float, s
            How long they are waited for, in the bus's own time.

        Returns
        -------
        list of Heard

        Raises
        ------
        BusError
            When the bus is lost.
        """
        ...

    def __enter__(self) -> Listening: ...

    def __exit__(self, *exc: object) -> None: ...


@dataclass(frozen=True)
class Adapter:
    """Entry that an adapter package registers.

    Attributes
    ----------
    name : str
        Word for messages.
    summary : str
        One line for ``beltcomm drives``.
    schemes : tuple of str
        What may stand before the colon of ``--drive`` (``virtual``, ``can``, ``slcan``, ``serial``).
    open : callable
        ``open(address, options) -> Drive``; ``address`` is what follows the colon ("" when nothing does); ``options``: str ->
        value, e.g. ``seed``, ``profile``, ``node``, ``bitrate``, ``realtime``; unknown ones are a UsageError.
    claims : callable
        Whether this adapter understands an address without a scheme of its own (``can0``, ``pcan:PCAN_USBBUS1``).
    examine : callable or None
        ``examine(address, options)`` looks at a drive step by step, moves nothing and leaves it as it was found; the options are those of
        ``open`` and ``try_bitrates``, ``sync_test`` (bool). An unreachable drive is a finding, no exception.
    surroundings : callable or None
        What on this machine the adapter could be used with, or why nothing.
    serve : callable or None
        ``serve(address, on, options) -> Service``, of a drive that is simulated: for other processes, on the interface ``on``.
    logs : bool
        ``open`` takes the option ``log``, which is called with every frame of its bus.
    nameplates : bool
        ``open`` and ``examine`` take the option ``nameplate``, a :class:`KnownMotor`, for what the drive does not tell.
    new_profile : callable or None
        ``new_profile(address, options, device, entries) -> text`` of a profile, from the drive at an address, None for none, and from what
        an EDS says: its device section and its objects.
    check_profile : callable or None
        ``check_profile(name)`` raises UsageError for a profile, shipped or a file, that cannot be used.
    profile_schema : callable or None
        JSON schema of a profile, for editors.
    listen : callable or None
        ``listen(address, options) -> Listening`` to the bus of a drive that somebody else moves.
    """

    name: str
    summary: str
    schemes: tuple[str, ...]
    open: Callable[[str, Mapping[str, object]], Drive]
    claims: Callable[[str], bool] = lambda _address: False
    examine: Callable[[str, Mapping[str, object]], Iterable[Finding]] | None = None
    surroundings: Callable[[], Iterable[Finding]] | None = None
    serve: Callable[[str, str, Mapping[str, object]], Service] | None = None
    logs: bool = False
    nameplates: bool = False
    new_profile: Callable[[str | None, Mapping[str, object], Mapping[str, str], Sequence[DictionaryEntry]], str] | None = None
    check_profile: Callable[[str], object] | None = None
    profile_schema: Callable[[], Mapping[str, object]] | None = None
    listen: Callable[[str, Mapping[str, object]], Listening] | None = None

    def taken(self, options: Mapping[str, object]) -> dict[str, object]:
        """Options that this adapter takes, of those that programs add for every adapter.

        Parameters
        ----------
        options : dict of str to object
            By name.

        Returns
        -------
        dict of str to object
            Without logs or name plates where it takes none.
        """
        refused = {name for name, takes in (("log", self.logs), ("nameplate", self.nameplates)) if not takes}
        return {name: value for name, value in options.items() if name not in refused}


@dataclass(frozen=True)
class FoundAdapter:
    """One entry point: the adapter, or in words why it cannot be loaded."""

    entry_point: str
    adapter: Adapter | None
    reason: str = ""


def find_adapters() -> list[FoundAdapter]:
    """All registered adapters, broken ones with their reason.  A broken adapter never hurts the others."""
    found = []
    for point in sorted(entry_points(group="beltcomm.adapters"), key=lambda p: p.name):
        try:
            adapter = point.load()
        except Exception as error:  # a guest may fail in any way; its reason is shown by `beltcomm drives`
            found.append(FoundAdapter(point.value, None, f"{type(error).__name__}: {error}"))
            continue
        if isinstance(adapter, Adapter):
            found.append(FoundAdapter(point.value, adapter))
        else:
            found.append(FoundAdapter(point.value, None, f"it provides a {type(adapter).__name__}, not an Adapter"))
    return found


def simulated(name: str) -> bool:
    """True if a drive's name is that of a virtual one: ``virtual:g_a``, ``serial:virtual``.

    Parameters
    ----------
    name : str
        As for ``--drive``.

    Returns
    -------
    bool
        False for a name that may be a machine's.
    """
    return "virtual" in name.split(":")[:2]


def open_drive(name: str, options: Mapping[str, object] | None = None) -> Drive:
    """Open the drive called ``name``.

    Parameters
    ----------
    name : str
        ``virtual:g_a``, ``can0``, ``slcan:PORT`` ...
    options : dict of str to object or None
        For the adapter, by name.

    Returns
    -------
    Drive
        Connected; it is closed by leaving its context.

    Raises
    ------
    UsageError
        When no adapter understands the name or an option.
    DriveError
        What the adapter raises.
    BusError
        What the adapter raises.
    """
    adapter, address = adapter_for(name, find_adapters())
    return adapter.open(address, adapter.taken(options or {}))


def adapter_for(name: str, found: Sequence[FoundAdapter]) -> tuple[Adapter, str]:
    """Find the adapter that understands a drive's name.

    Parameters
    ----------
    name : str
        As for ``--drive``.
    found : sequence of FoundAdapter
        The adapters installed.

    Returns
    -------
    tuple[Adapter, str]
        The adapter, and the address it is to open.

    Raises
    ------
    UsageError
        When none does.
    """
    scheme, _, address = word(name, "drive").partition(":")
    if not found:
        raise UsageError("no drive adapters are installed; run `pip install -e .` in the beltcomm folder")
    for item in found:
        if item.adapter and scheme in item.adapter.schemes:
            return item.adapter, address
    for item in found:
        if item.adapter and item.adapter.claims(name):
            return item.adapter, name
    schemes = sorted(s for item in found if item.adapter for s in item.adapter.schemes)
    broken = "".join(f" ({item.entry_point} is broken: {item.reason})" for item in found if not item.adapter)
    near = did_you_mean(scheme, [*schemes, "can0"])
    raise UsageError(f"no adapter understands the drive {name!r}{near}; known are {', '.join(schemes)} and CAN interfaces (can0){broken}")
