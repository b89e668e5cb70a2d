"""Starting points: by how the axis is built (which prefilter), from robust to fast; each computed from the measured model."""

from __future__ import annotations

from dataclasses import dataclass

from beltcomm.control import PrefilterKind
from beltcomm.design.knobs import Knobs, OutOfReach
from beltcomm.design.specification import Specification
from beltcomm.tuning.bench import Bench
from beltcomm.tuning.ground import SliderSetting

#: T_R that presets choose from, s.
_VELOCITY_FILTERS_S = (0.002, 0.004, 0.008)


@dataclass(frozen=True)
class Kind:
    """A way to build an axis.

    Attributes
    ----------
    words : str
        What its prefilter does.
    """

    key: str
    title: str
    prefilter: PrefilterKind
    words: str


@dataclass(frozen=True)
class LoopDemand:
    """Demand on a loop; gain margin and sensitivity are 6 dB always."""

    key: str
    title: str
    asked: Knobs


KINDS: tuple[Kind, ...] = (
    Kind("stiff", "Stiff axis", "none", "no filter: the resonance lies far above what the loop needs"),
    Kind("short", "High resonance", "notch", "a notch at the resonance"),
    Kind("long", "Low resonance", "butterworth", "a low-pass below the antiresonance"),
)
PACES: tuple[LoopDemand, ...] = (
    LoopDemand("robust", "robust", Knobs(60.0, 80.0, -12.0)),
    LoopDemand("balanced", "balanced", Knobs(45.0, 70.0, -10.0)),
    LoopDemand("fast", "fast", Knobs(35.0, 60.0, -8.0)),
)


@dataclass(frozen=True)
class Preset:
    """setting : where it puts the controls; None with the reason where the axis or the drive does not allow it.

    position_crossover_hz : up to which the position loop acts on every variant.   stiffness : K_I K_PP, N m/(rad s).   dynamic_m :
    predicted error of the move.
    """

    kind: str
    pace: str
    setting: SliderSetting | None
    refusal: str = ""
    position_crossover_hz: float = 0.0
    stiffness: float = 0.0
    dynamic_m: float = 0.0


def preset(bench: Bench, setting: SliderSetting, kind: str, pace: str) -> Preset:
    """One starting point for the payload of a setting; none that would be no faster than the pace before it on this axis.

    Parameters
    ----------
    bench : Bench
        On which it is designed.
    setting : SliderSetting
        For its payload.
    kind : str
        Key of the kinds of design.
    pace : str
        Key of :data:`PACES`.

    Raises
    ------
    KeyError
        For a kind or pace that there is not.
    """
    found, order = _alone(bench, setting, kind, pace), [one.key for one in PACES]
    for slower in order[: order.index(pace)]:
        before = _alone(bench, setting, kind, slower)
        if found.setting and before.setting and found.position_crossover_hz <= before.position_crossover_hz:
            return Preset(kind, pace, None, f"with less margin this axis gets no faster than {slower}: its resonance is what holds it back")
    return found


def _alone(bench: Bench, setting: SliderSetting, kind: str, pace: str) -> Preset:
    place = (setting.payload_kg, setting.shown_kg, setting.position_m)
    return bench.once(("preset", kind, pace, *place), lambda: _made(bench, setting, kind, pace))


def _made(bench: Bench, setting: SliderSetting, kind: str, pace: str) -> Preset:
    built = {one.key: one for one in KINDS}[kind]
    asked = {one.key: one for one in PACES}[pace].asked
    if built.prefilter not in bench.ground.structure.prefilters:
        return Preset(kind, pace, None, f"{bench.ground.structure.name} has no {built.prefilter} prefilter")
    wanted = Specification(
        phase_margin_deg=asked.phase_margin_deg,
        position_phase_margin_deg=asked.position_phase_margin_deg,
        suppression_db=asked.suppression_db,
        prefilters=(built.prefilter,),
        velocity_filters_s=_VELOCITY_FILTERS_S,
    )
    found = bench.best(setting, wanted)
    if found is None:
        return Preset(kind, pace, None, "no gains leave these margins on all variants of this axis")
    try:
        design, shown, _ = bench.shown(found)
    except OutOfReach as problem:  # by a hair: sliders stand on what the search left, and ask for it again
        return Preset(kind, pace, None, str(problem))
    error = bench.tracked(design.cascade, setting.shown_kg).error.dynamic_m
    return Preset(kind, pace, found, "", shown.worst.position_bandwidth_at_rest_hz, design.stiffness, error)
