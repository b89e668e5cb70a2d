"""Options of a command line beside its main arguments."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from inspect import signature
from pathlib import Path
from typing import get_args

from beltcomm.axis import Axis, load_axis
from beltcomm.configfiles import did_you_mean
from beltcomm.control import PrefilterKind
from beltcomm.design.feedforward import SentFeedforward
from beltcomm.drive import Capabilities, Drive
from beltcomm.errors import Declined, Refused, UsageError
from beltcomm.excitation import AskedExcitation
from beltcomm.given import EXCITATION_KINDS, REACHED_BY, ExcitationKind, Place, Reached, choice, number, pasted, place, whole, word
from beltcomm.identify.loop_response import CLOSED_WAYS, Way
from beltcomm.machine.hardware import Hardware
from beltcomm.machine.ratings import check_units, nameplate_of
from beltcomm.rundata.calibration import RESULT
from beltcomm.rundata.findings import Apply, Settings
from beltcomm.rundata.proof import EDITED
from beltcomm.rundata.store import drive_to_dict
from beltcomm.runfolder import RunFolder
from beltcomm.schedule.orders import Order
from beltcomm.schedule.record_schedule import Extent
from beltcomm.talk import Hold, Talk

#: What may stand in an option with names; of one with a number its unit and the most that anybody can mean.
CHOICES = {
    "apply": get_args(Apply),
    "excitation": EXCITATION_KINDS,
    "loop": get_args(Way),
    "prefilter": get_args(PrefilterKind),
    "feedforward": get_args(SentFeedforward),
    "order": get_args(Order),
}
NUMBERS = {
    "position_m": ("m", 100.0),
    "payload_kg": ("kg", 1e5),
    "base_speed_m_s": ("m/s", 100.0),
    "mounted_kg": ("kg", 1e5),
    "sample_period_s": ("s", 1.0),
    "longest_s": ("s", 1e9),
    "amplitude_nm": ("N m", 1e5),
    "bit_s": ("s", 1e3),
}
#: Ratings of a drive that a session lowers while it works.
RATINGS = ("peak_torque_nm", "max_speed_rad_s")
COUNTS = ("seed", "repeat", "node", "bitrate", "prbs_order", "periods")
NAMES = ("profile", "slave", "first_motion")
#: s: longest plan that ``yes`` answers for; a person beside the machine looks at it once in a quarter of an hour.
LONGEST_S = 900.0


@dataclass(frozen=True)
class Options:
    """Options beside the main arguments of a command; every default is the safe choice.

    Attributes
    ----------
    yes : bool
        No questions.
    seed : int or None
        Of everything random in a virtual drive.
    dry_run : bool
        Plan only.
    resume : bool
        Go on with a run.
    position_m : float or None
        Where the carriage stands.
    window_m : tuple of float or None
        How far it may move from there, (low, high).
    home : bool
        Find the zero first.
    payload_kg : float or None
        Heaviest further load.
    apply : Apply or None
        "keep", "restore" or "save" the new gains; None asks, with ``yes`` it restores.
    quick : bool
        One place only.
    thorough : bool
        What every effect needs.
    visible : bool
        Of a quick session, too, say what it could show.
    excitation : ExcitationKind
        Of the long frequency response; the rising ones before it stay binary.
    prbs_order, bit_s, amplitude_nm, periods
        Of it, in place of what would be chosen: order and s of a bit of a PRBS, ± N m at the motor shaft, measured periods.
    force : bool
        Gains in doubt, files edited.
    longest_s : float
        How long the axis may move without a question, with ``yes``.
    prefilter, feedforward
        None is the best one; "compliant" is for ``verify``.
    profile, node, bitrate, realtime
        Of the drive.
    slave : str or None
        Which drive a virtual one plays.
    order, repeat, mounted_kg
        Of friction sweeps (thesis 3.6), how often, and the payload that is mounted while they are driven.
    loop : Way
        Way of identification.
    base_speed_m_s : float or None
        Of the carriage in a closed one; None chooses it, 0 stands.
    pictures : bool
        Made of it.
    first_motion : str or None
        Serial number (or what it has instead) of a drive whose first motion is confirmed beforehand; ``yes`` does not do that.
    hold : Hold or None
        A key that must stay held while the axis moves.
    simulate_first : bool
        The plan is played on a twin before anything moves.
    wall_clock : callable or None
        Date and time in s, to know how much later a run goes on; the core has no clock of its own.
    report : bool
        A page on the run at the end of ``commission``; the command line asks for it.
    search : bool
        Records of a session that cannot go on are searched for what is wrong with the axis; the command line asks for it.
    targets : dict of str to object or None
        Of one verification, in place of axis.yaml's, by the names there.
    sample_period_s : float or None
        Of records; None is the shortest that drive and bus allow.
    drive : dict of str to object
        Further options for the adapter, by name.
    """

    yes: bool = False
    seed: int | None = None
    dry_run: bool = False
    resume: bool = False
    position_m: float | None = None
    window_m: tuple[float, float] | None = None
    home: bool = False
    payload_kg: float | None = None
    apply: Apply | None = None
    quick: bool = False
    thorough: bool = False
    visible: bool = False
    excitation: ExcitationKind = "prbs"
    prbs_order: int | None = None
    bit_s: float | None = None
    amplitude_nm: float | None = None
    periods: int | None = None
    loop: Way = "open"
    base_speed_m_s: float | None = None
    pictures: bool = True
    report: bool = False
    search: bool = False
    force: bool = False
    longest_s: float = LONGEST_S
    prefilter: PrefilterKind | None = None
    feedforward: SentFeedforward | None = None
    order: Order | None = None
    repeat: int | None = None
    mounted_kg: float | None = None
    profile: str | None = None
    slave: str | None = None
    node: int | None = None
    bitrate: int | None = None
    realtime: bool = False
    sample_period_s: float | None = None
    targets: Mapping[str, object] | None = field(default=None, compare=False)
    first_motion: str | None = None
    hold: Hold | None = field(default=None, compare=False)
    simulate_first: bool = False
    wall_clock: Callable[[], float] | None = field(default=None, compare=False)
    drive: Mapping[str, object] = field(default_factory=dict)

    def __new__(cls, *_given: object, **named: object) -> Options:
        """Raise UsageError for a name that no option has, with the nearest."""
        known = [one.name for one in fields(cls)]
        if unknown := [f"{name}{did_you_mean(name, known)}" for name in named if name not in known]:
            raise UsageError(f"there is no option {', '.join(unknown)}; there are {', '.join(known)}")
        return super().__new__(cls)

    def __post_init__(self) -> None:
        """Raise UsageError for a value that no option has: found out now, and not after the axis has moved."""
        for one in fields(self):
            value = getattr(self, one.name)
            if isinstance(one.default, bool):
                if not isinstance(value, bool):  # the text "no" would count as a yes
                    raise UsageError(f"{one.name} is {value!r}; give True or False")
            elif value is None:
                continue
            elif one.name in CHOICES:
                choice(value, one.name, CHOICES[one.name])
            elif one.name in NUMBERS:
                unit, most = NUMBERS[one.name]
                if not abs(number(value, one.name, unit)) <= most:
                    raise UsageError(f"{one.name} is {value:g} {unit}; at most {most:g} {unit} is possible, so look at the unit")
            elif one.name in COUNTS:
                whole(value, one.name)
            elif one.name in NAMES:
                word(value, one.name)
        if not isinstance(self.drive, Mapping):
            raise UsageError(f"drive is {self.drive!r}; give the adapter's options as a mapping of names to values")
        if self.window_m is not None:
            if not isinstance(self.window_m, (tuple, list)) or len(self.window_m) != 2:
                raise UsageError(f"window_m is {self.window_m!r}; give two numbers in m, how far back and how far forth: (-0.01, 0.01)")
            for end in self.window_m:
                number(end, "window_m", "m")
        if (self.payload_kg or 0.0) < 0.0:
            raise UsageError(f"the payload is {self.payload_kg:g} kg; give what is to be carried further, 0 or more")

    @property
    def extent(self) -> Extent:
        """Extent of a commissioning's records.

        Raises
        ------
        UsageError
            For both at once.
        """
        if self.quick and self.thorough:
            raise UsageError("quick and thorough are two things: choose one")
        return "quick" if self.quick else "thorough" if self.thorough else "standard"

    @property
    def in_loop(self) -> bool:
        """True if the identification closes a loop.

        Raises
        ------
        UsageError
            For options that do not go with it.
        """
        if self.loop == "open":
            if self.base_speed_m_s is not None:
                raise UsageError("a base speed needs a closed loop: add --loop direct, indirect or setpoint")
            return False
        if self.loop not in CLOSED_WAYS:
            raise UsageError(f"there is no way {self.loop!r}; choose open, {', '.join(CLOSED_WAYS)}")
        if self.resume or self.window_m is not None:
            raise UsageError(f"--loop {self.loop} travels, and makes a new record each time: leave --window and --resume out")
        if self.base_speed_m_s is not None and not self.base_speed_m_s >= 0.0:
            raise UsageError(f"the base speed is {self.base_speed_m_s:g} m/s; give a positive one, or 0 to stand")
        return True

    @property
    def asked(self) -> AskedExcitation:
        """Excitation that is asked for."""
        return AskedExcitation(self.prbs_order, self.bit_s, self.amplitude_nm, self.periods)

    def reached(self, drive: str) -> Reached:
        """The drive's name for the next command, with the options that it is reached by.

        Parameters
        ----------
        drive : str
            Name of the drive, as for ``--drive``.

        Returns
        -------
        Reached
            Name and options, for the next command in words.
        """
        given = dict(zip(REACHED_BY, (self.slave, self.profile, self.node, self.bitrate), strict=True))
        found = Reached(drive)
        found.options = " ".join(f"--{name} {pasted(value)}" for name, value in given.items() if value is not None)
        return found

    def for_drive(self, axis: Axis | None = None) -> dict[str, object]:
        """The adapter's options: those that were given, and what the axis file knows of the motor.

        Parameters
        ----------
        axis : Axis or None
            The axis, its ``axis.yaml``, or the name of a shipped one.

        Returns
        -------
        dict of str to object
            By the names that adapters know.
        """
        given = {
            "seed": self.seed,
            "profile": self.profile,
            "as": self.slave,
            "node": self.node,
            "bitrate": self.bitrate,
            "sample_period": self.sample_period_s,
        }
        found: dict[str, object] = {name: value for name, value in given.items() if value is not None}
        if self.realtime:
            found["realtime"] = True
        if axis is not None:
            found["nameplate"] = nameplate_of(axis)
        return {**found, **self.drive}


#: Names and defaults as ever, for help and notebooks: ``__new__`` only looks at the names.
setattr(Options, "__signature__", signature(Options.__init__).replace(parameters=list(signature(Options.__init__).parameters.values())[1:]))  # noqa: B010


def settings_of(options: Options) -> Settings:
    """Settings that the sequence on the machine needs.

    Parameters
    ----------
    options : Options

    Raises
    ------
    UsageError
        For a compliant or led feedforward.
    """
    feedforward = options.feedforward or "nonlinear"
    if feedforward == "compliant" or feedforward == "led":
        raise UsageError(
            f"{feedforward} is what the host does with a move's reference; choose it in `beltcomm verify --feedforward {feedforward}`"
        )
    payload = options.payload_kg or 0.0
    return Settings(
        apply=options.apply,
        position_m=options.position_m,
        home=options.home,
        window_m=options.window_m,
        ask=not options.yes,
        payloads_kg=(payload,) if payload else (),
        extent=options.extent,
        prefilter=options.prefilter,
        feedforward=feedforward,
    )


def claim(folder: RunFolder, capabilities: Capabilities, options: Options, talk: Talk) -> None:
    """Note which drive a run is made on and when; one that begins anew with every command is as cold as at the first.

    A calibration that was edited since is asked for, where the drive's gains mean nothing without it.

    Parameters
    ----------
    folder : RunFolder
    capabilities : Capabilities
    options : Options
    talk : Talk

    Raises
    ------
    UsageError
        When the run was made on another drive, or in other units.
    Refused
        For a no.
    """
    forgets, wall_clock = Hardware.of("", capabilities).forgetful, options.wall_clock
    check_units(folder, capabilities)
    folder.claim_drive(capabilities.identity, wall_clock() if wall_clock is not None and not forgets else None)
    if capabilities.uncalibrated and RESULT in folder.names("results") and not options.dry_run:
        admit_edited(str(folder.file("results", RESULT)), folder.edited("results", RESULT), options, talk)


def admit_edited(file: str, edited: bool, options: Options, talk: Talk) -> None:
    """Say of a file that goes to a machine that beltcomm did not write it so, and ask; ``yes`` alone is no answer.

    Parameters
    ----------
    file : str
        Its name, for the sentence.
    edited : bool
        True if it is not as beltcomm wrote it.
    options : Options
    talk : Talk

    Raises
    ------
    Refused
    """
    if not edited:
        return
    talk.say(f"{file} is not as beltcomm wrote it: it {EDITED}.")
    if options.force:
        return
    if options.yes:
        raise Refused(f"nothing was written or moved: {file} is not as beltcomm wrote it; look through it, then use it with --force")
    if not talk.confirm("Have you looked through it, and do you want it used?"):
        raise Declined("nothing was written or moved, as you said")


def given(options: Options | None) -> Options:
    """The options, all safe where there are none.

    Parameters
    ----------
    options : Options or None
        As they were given.

    Raises
    ------
    UsageError
        For anything else.
    """
    if options is None or isinstance(options, Options):
        return options or Options()
    raise UsageError(f"options is {options!r}; give beltcomm.api.Options(...)")


def axis_of(axis: Axis | Place) -> Axis:
    """An axis, or the one of a file or a shipped name.

    Parameters
    ----------
    axis : Axis or Place
        Path or name of an axis file.

    Raises
    ------
    UsageError
    """
    return axis if isinstance(axis, Axis) else load_axis(str(place(axis, "axis")))


def new_folder(run: Path, axis: Axis, drive: Drive, options: Options, talk: Talk, reached_as: str = "") -> RunFolder:
    """The folder of a run that begins, or goes on with ``resume``, on this drive.

    Parameters
    ----------
    run : Path
    axis : Axis
    drive : Drive
    options : Options
    talk : Talk
    reached_as : str
        What the drive is called on the command line.

    Raises
    ------
    UsageError
    """
    folder = RunFolder.create(run, axis, resume=options.resume)
    claim(folder, drive.capabilities, options, talk)
    now, before = drive_to_dict(drive.capabilities), folder.load_result("drive") or {}
    begun = before.get("begun_with") or {name: (before or now)[name] for name in RATINGS if name in (before or now)}
    by = options.reached(reached_as).options if reached_as else before.get("reached_by") or ""
    called = {"reached_as": reached_as or before.get("reached_as") or "", "reached_by": by}
    folder.save("results", "drive", {**now, "begun_with": begun, **called})  # a session that was cut off leaves them lower
    return folder
