"""Effects: one physical law each, the slot it fills, its parameters, and what a technician should know of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Slot = Literal[
    "torque_delay",
    "torque_path",
    "torque_reading",
    "friction_level",
    "load_friction",
    "friction_onset",
    "force",
    "belt_law",
    "element",
    "kinematics",
    "sensor",
    "body",
    "rigid",
    "load_of_record",
]
Side = Literal["motor", "cart", "belt", "drive"]
Law = Callable[..., float]

#: Body that the belt's driven end is fixed to: ``DRIVING_BODY`` where a coupling splits it off, else the first body.
DRIVING_END = "driving_end"
DRIVING_BODY = "driving_pulley"
#: Name that an effect writes among its ``uses`` for the stiffness of the belt at the carriage's place, N/m, whatever law gives it.
BELT_STIFFNESS = "belt.stiffness"
#: The same for the damping of the belt, N s/m; 0 in a model without any.
BELT_DAMPING = "belt.damping"
#: Body that a load without compliance is a part of: its mass has the same name as that of one that swings.
RIGID_OWNER = "cart"
#: Group of the laws of the belt as a spring: a model has one of them at most.
BELT_SPRING = "belt spring"
#: Group of the first-order lags between torque and report: two of them would only smooth the whole equation.
TORQUE_LAG = "lag between torque and report"


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect or body.

    Attributes
    ----------
    unit : str
        SI.
    side : Side
        Where it is meant: "motor" (motor shaft), "cart" (carriage), "belt" (at the belt line), "drive".
    start : float
        Value used when an effect is added without knowledge.
    low, high : float
        Physical bounds.
    fitted : bool
        False for what is known beforehand or chosen from a list (a number of teeth, an order): a fit leaves it alone.
    form : bool
        Gives the law another form than the usual one, which is at ``start``: held there, without room between its bounds, until the effect
        is named, and fitted from then on where that pays; ``fitted`` is False, too.
    """

    name: str
    unit: str
    side: Side
    start: float
    low: float
    high: float
    meaning: str
    fitted: bool = True
    form: bool = False


@dataclass(frozen=True)
class AxisSummary:
    """Summary of an axis for effects that are put on trial: the base model around a record and the data sheets.

    inertia kg m², motor side; mass kg; stiffness N/m; damping N s/m; coulomb N m, motor side; ratio m/rad; low_m, high_m : m, where
    the records went; antiresonance_hz : Hz; teeth : of the driving pulley that pass per turn of the motor, 0 when not known; peak_nm : N m,
    largest torque in the records; peak_force_n : N, largest belt force in them; offset_m, pulley_distance_m : m, geometry of the belt, 0
    when not known; stiffness_at : (place m, amplitude N m, stiffness N/m) of every record that stays at one place, everything else as in
    the base model; fastest : rad/s, of the motor in them; side : of the records, "motor", "load" or "ampere"; belt : whether the axis has
    one; gear : turns of the motor per turn of the pulley; counts : of the encoder per turn of the motor, by its data sheet, 0 when not
    known; step_rad : of the angle in the records, 0 when not known;

    Attributes
    ----------
    explained_m : tuple of float
        Stretch of the belt to the negative and to the positive side up to which the base model explains the records, 0 when not known.
    toothed : bool
        A belt moves the load, or nobody says what does.
    rough_m : tuple of float
        Places of the load around which the base model leaves far more than elsewhere, the worst first.
    """

    inertia: float
    mass: float
    stiffness: float
    damping: float
    coulomb: float
    ratio: float
    low_m: float
    high_m: float
    antiresonance_hz: float
    teeth: float
    peak_nm: float
    peak_force_n: float
    offset_m: float = 0.0
    pulley_distance_m: float = 0.0
    stiffness_at: tuple[tuple[float, float, float], ...] = ()
    fastest: float = 40.0
    side: str = "motor"
    belt: bool = True
    gear: float = 1.0
    counts: float = 0.0
    step_rad: float = 0.0
    explained_m: tuple[float, float] = (0.0, 0.0)
    toothed: bool = True
    rough_m: tuple[float, ...] = ()

    def may_have(self, effect: Effect) -> bool:
        """True if such a machine can have an effect: what is a belt's is not looked for on another axis.

        Parameters
        ----------
        effect : Effect
            Of the catalogue.

        Returns
        -------
        bool
        """
        return self.toothed or not effect.of_belt


@dataclass(frozen=True)
class Trial:
    """One way to switch an effect on, at a size typical of machines.

    Attributes
    ----------
    values : dict of str to float
        Own parameters by bare name (those of bodies as ``body.name``); the rest stands at its start.
    amplitudes : tuple of str
        Parameters that scale the effect each on its own (sine and cosine): every one is a column of its own in a score test; () makes one
        column of the whole.
    signed : bool
        The effect may as well act the other way round.
    base : dict of str to float
        Parameters of the base model, by full name, that change with it: a base fitted without the effect may be far off.
    swallowed : bool
        The base explains all of it but what a fit from here finds; no score test can see it.
    """

    values: Mapping[str, float]
    amplitudes: tuple[str, ...] = ()
    signed: bool = False
    base: Mapping[str, float] = field(default_factory=dict)
    swallowed: bool = False


#: How a state begins in a record: bodies rest, or go with a motor that is in motion; friction is not loaded; a late torque was always the
#: first one; an observer finds a free carriage; a payload may swing by so much; the sidecar says the session's time.
Start = Literal["rest", "unloaded", "first value", "estimated", "swings", "clock"]
#: How a state gets into the next simulated record: by the end of the one before (``simulate.forward.State``), by the session's clock, or
#: not.  A fit knows no end of a record before: there every record begins by ``Start``, and only the clock is carried.
Carried = Literal["end", "clock", "no"]


@dataclass(frozen=True)
class EffectState:
    """State of an effect.

    Attributes
    ----------
    unit : str
        SI.
    start : Start
        In a record.
    carried : Carried
        From one record to the next.
    """

    name: str
    unit: str
    start: Start
    carried: Carried


#: What the effects of a slot remember; all others, friction that sticks among them, decide anew at every instant.
OF_SLOT: Mapping[str, tuple[EffectState, ...]] = {
    "friction_onset": (EffectState("share of the friction that has turned round", "1", "unloaded", "end"),),
    "torque_delay": (EffectState("torque under way", "N m", "first value", "no"),),
    "torque_reading": (EffectState("torque shown last", "N m", "first value", "no"),),
}


@dataclass(frozen=True)
class Body:
    """A moving mass with its inertia parameter; ``rotary`` bodies move in rad at the motor shaft, others in m.

    Attributes
    ----------
    swings : float
        m or rad, rms by which it may still swing when a record begins, from the motion before it.
    """

    name: str
    inertia: Parameter
    rotary: bool = False
    swings: float = 0.0


@dataclass(frozen=True)
class Element:
    """A massless connection of two bodies: ``force = law(stretch, rate, x, *own parameters)``.

    stretch = coordinate of ``ends[0]`` minus that of ``ends[1]``; a positive force pulls the first body back and the second
    one on.  Coordinates are m along the belt, or rad at the motor shaft when ``angular``; x is the carriage
    on the axis, m.

    Attributes
    ----------
    slope : callable
        ``(x, *own parameters) -> (stiffness, damping)``, N/m and N s/m (N m/rad and N m s/rad when angular).
    """

    ends: tuple[str, str]
    law: Law
    slope: Callable[..., tuple[float, float]]
    angular: bool = False


@dataclass(frozen=True)
class Point:
    """Operating point of a linearisation.  ``speed`` of the named bodies, in rad/s or m/s; 0 means standstill.

    Attributes
    ----------
    position_m : float, m
        Carriage on the axis.
    """

    position_m: float
    motor_speed_rad_s: float
    transmission_m_rad: float

    def speed(self, rotary: bool) -> float:
        """Speed in the coordinate of a body.

        Parameters
        ----------
        rotary : bool
            The body turns with the motor.

        Returns
        -------
        float, rad/s at the motor shaft
            Or m/s along the belt.
        """
        return self.motor_speed_rad_s if rotary else self.motor_speed_rad_s * self.transmission_m_rad


@dataclass(frozen=True)
class ManualCheck:
    """Check by hand, where no motion of the axis tells two effects apart.

    Attributes
    ----------
    change : str
        On the machine.
    record : str
        What is recorded, or read, after it.
    tells : str
        Which of the two it was.
    """

    change: str
    record: str
    tells: str

    def words(self) -> str:
        """A sentence."""
        return f"{self.change}; then {self.record}: {self.tells}"


@dataclass(frozen=True)
class DiscriminatingExperiment:
    """The experiment between an effect and one of its twins.

    Attributes
    ----------
    shows : str
        Where the two differ.
    records : tuple of dict of str to Any
        As steps of a plan file.
    """

    shows: str
    records: tuple[Mapping[str, Any], ...] = ()
    hands: tuple[ManualCheck, ...] = ()


@dataclass(frozen=True)
class Effect:
    """One physical effect.

    Attributes
    ----------
    name : str
        Unique.
    slot : Slot
        See docs/slots.md.
    law : callable or None
        The law of the slot as a function of plain floats that numba can compile; own parameters follow the slot's arguments, then the
        values of ``uses`` (full names of other parameters).
    body : str
        The body a force or a friction level acts on.
    elements, bodies
        What an element or body effect brings.
    slope : callable or None
        Linearisation; for ``force``: (position, speed, t, *p) -> (d force/d position, d force/d speed); for ``friction_level``: (speed,
        position, t, *p) -> d level/d speed.
    group : str
        Effects of one group exclude each other.
    seen, causes, check, remedy : str
        For the technician.
    source : str
        Origin of the law: an equation or a table of the thesis, a data sheet, or author and year.
    trials : callable or None
        How a diagnosis switches it on, from what is known of the axis; None: it is not put on trial (base effects and laws that need data
        of their own).
    twins : tuple of str
        Effects that no motion of this axis can tell from it, or hardly.
    separate : str
        The experiment that tells the twins apart.
    apart : dict of str to DiscriminatingExperiment
        The same by twin, as records and as changes by hand.
    alike : dict of str to str
        What else looks like it to a person, by name, each with the experiment that tells them apart; no diagnosis uses these.
    harmonic : {'', 'load', 'gain', 'angle'}
        Sines and cosines of the motor angle times the first parameter, added to the load or to the gain of the torque (so that all orders
        can be searched in one pass), or to the angle shown.
    state : tuple of EffectState
        What it remembers beside what its slot and its bodies do.
    bound : bool
        It only says how much any law of its kind could explain; a diagnosis never adds it.
    linear : bool
        Its law is affine in positions and speeds (a friction level: constant), the same at every place and time, for any values of its
        parameters: it is simulated without an integrator.
    least : float
        Of its first parameter; up to this it is nothing to be named, because every axis has as much or no sensor shows it.
    completed_by : tuple of str
        Effects that belong to it and mean nothing without it; put on trial once it is named.
    record_sets : tuple of str
        Sets of records that show it (:data:`beltcomm.schedule.next_plan.SETS`), where they are others than its slot's.
    behind_gap : bool
        Put on trial only where the carriage may move free of the motor; without that it is the same as one of its twins.
    sought : str
        Where and how a diagnosis looks for it, where that is not by the score test of ``trials``; "" elsewhere.
    unlikely : callable or None
        Of its own values and its bodies' by their names here, in words why no machine has them; empty where one may.
    owner : str
        What stands before the dot in the names of its parameters; "" for its own name.
    of_belt : bool
        Only a toothed belt and its pulleys have it.
    """

    name: str
    slot: Slot
    title: str
    parameters: tuple[Parameter, ...]
    seen: str
    check: str
    source: str
    law: Callable[..., Any] | None = None
    slope: Callable[..., object] | None = None
    body: str = ""
    uses: tuple[str, ...] = ()
    elements: tuple[Element, ...] = ()
    bodies: tuple[Body, ...] = ()
    group: str = ""
    trials: Callable[[AxisSummary], list[Trial]] | None = None
    harmonic: Literal["", "load", "gain", "angle"] = ""
    state: tuple[EffectState, ...] = ()
    twins: tuple[str, ...] = ()
    separate: str = ""
    apart: Mapping[str, DiscriminatingExperiment] = field(default_factory=dict)
    causes: str = ""
    remedy: str = ""
    alike: Mapping[str, str] = field(default_factory=dict)
    bound: bool = False
    linear: bool = False
    least: float = 0.0
    completed_by: tuple[str, ...] = ()
    record_sets: tuple[str, ...] = ()
    behind_gap: bool = False
    sought: str = ""
    unlikely: Callable[[Mapping[str, float]], str] | None = None
    owner: str = ""
    of_belt: bool = False

    def full_names(self) -> tuple[str, ...]:
        """Names of its own parameters as they stand in a model: ``effect.parameter``."""
        return tuple(f"{self.owner or self.name}.{p.name}" for p in self.parameters)

    @property
    def states(self) -> tuple[EffectState, ...]:
        """Everything that it remembers: of its slot, of its bodies, and its own."""
        bodies = [
            EffectState(
                f"place and speed of the {b.name.replace('_', ' ')}", "rad" if b.rotary else "m", "swings" if b.swings else "rest", "end"
            )
            for b in self.bodies
        ]
        return (*OF_SLOT.get(self.slot, ()), *bodies, *self.state)

    @property
    def rattles(self) -> bool:
        """True if the carriage is free at times, within a gap that is the first parameter, m: only the torque says where it is then."""
        return any(state.start == "estimated" for state in self.states)

    @property
    def needs_observer(self) -> bool:
        """True if only an observer of its own shows what it does: it frees the carriage, or pushes it to one side where it is free."""
        return self.rattles or self.behind_gap


def body_units(body: str) -> tuple[str, str, Side]:
    """Units of force and of viscous friction on a body, and its side.

    Parameters
    ----------
    body : str
        Name of the body.

    Returns
    -------
    tuple[str, str, Side], N m, N m s/rad
        "motor" where it turns with the motor; N, N s/m and its side elsewhere.
    """
    return ("N m", "N m s/rad", "motor") if body in ("motor", "load") else ("N", "N s/m", "cart" if body == "cart" else "belt")


def is_plain_belt(effect: Effect) -> bool:
    """True if an effect is nothing but a spring or damper between driving end and carriage, which others may share.

    Parameters
    ----------
    effect : Effect
        The effect to look at.

    Returns
    -------
    bool
        False for one with a law of its own.
    """
    return len(effect.elements) == 1 and effect.elements[0].ends == (DRIVING_END, "cart") and BELT_STIFFNESS not in effect.uses
