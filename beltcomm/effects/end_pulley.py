"""The end pulley as a third mass in the returning span, without the geometry of the belt."""

from __future__ import annotations

from beltcomm.effects._effect import (
    BELT_DAMPING,
    BELT_STIFFNESS,
    DRIVING_END,
    AxisSummary,
    Body,
    DiscriminatingExperiment,
    Effect,
    Element,
    Parameter,
    Trial,
)
from beltcomm.effects._records import ENDS, wide


def _far(stretch: float, rate: float, x: float, share: float, split: float, stiffness: float, damping: float) -> float:
    """Return to the driving end:  share/(1-split) (stiffness stretch + damping rate), N.   Both in series carry ``share`` of the belt."""
    return share / (1.0 - split) * (stiffness * stretch + damping * rate)


def _near(stretch: float, rate: float, x: float, share: float, split: float, stiffness: float, damping: float) -> float:
    """Return to the carriage:  share/split (stiffness stretch + damping rate), N."""
    return share / split * (stiffness * stretch + damping * rate)


def _far_slope(x: float, share: float, split: float, stiffness: float, damping: float) -> tuple[float, float]:
    """(stiffness N/m, damping N s/m)."""
    return share / (1.0 - split) * stiffness, share / (1.0 - split) * damping


def _near_slope(x: float, share: float, split: float, stiffness: float, damping: float) -> tuple[float, float]:
    """(stiffness N/m, damping N s/m)."""
    return share / split * stiffness, share / split * damping


def _direct(stretch: float, rate: float, x: float, share: float, split: float, stiffness: float, damping: float) -> float:
    """Force that the direct span does not carry any more:  -share (stiffness stretch + damping rate), N."""
    return -share * (stiffness * stretch + damping * rate)


def _direct_slope(x: float, share: float, split: float, stiffness: float, damping: float) -> tuple[float, float]:
    """(stiffness N/m, damping N s/m)."""
    return -share * stiffness, -share * damping


def _trials(ground: AxisSummary) -> list[Trial]:
    """Three masses, three shares; and what a model without it takes for one carriage: both swing in unison where

    me/m = share/((1 - share)(1 - split));  then the carriage seems to weigh m + me, on 1 - share + share/(1 - split) of the stiffness;
    or on all of it, where the two are only roughly in unison.
    """
    found = [Trial({"end_pulley.mass": mass, "share": share}) for mass in (0.1, 0.3, 0.7) for share in (0.15, 0.27, 0.45)]
    share = 0.27
    for split in (0.4, 0.6):
        carriage = ground.mass / (1.0 + share / ((1.0 - share) * (1.0 - split)))
        base = {"cart.mass": carriage, "belt_stiffness.stiffness": ground.stiffness / (1.0 - share + share / (1.0 - split))}
        found.append(Trial({"end_pulley.mass": ground.mass - carriage, "share": share, "split": split}, base=base, swallowed=True))
    pulley = 0.25 * ground.mass
    found.append(Trial({"end_pulley.mass": pulley, "share": share}, base={"cart.mass": ground.mass - pulley}, swallowed=True))
    return found


EFFECT = Effect(
    name="end_pulley",
    slot="body",
    of_belt=True,
    title="mass of the end pulley",
    parameters=(
        Parameter("share", "1", "belt", 0.27, 0.02, 0.9, "share of the belt's stiffness in the span over the end pulley"),
        Parameter("split", "1", "belt", 0.5, 0.05, 0.95, "share of that span's compliance between end pulley and carriage"),
    ),
    bodies=(Body("end_pulley", Parameter("mass", "kg", "belt", 0.2, 1e-3, 100.0, "inertia of the end pulley over r²")),),
    elements=(
        Element((DRIVING_END, "end_pulley"), _far, _far_slope),
        Element(("end_pulley", "cart"), _near, _near_slope),
        Element((DRIVING_END, "cart"), _direct, _direct_slope),
    ),
    uses=(BELT_STIFFNESS, BELT_DAMPING),
    trials=_trials,
    twins=("dead_time",),
    separate="record an excitation up to 250 Hz at another place of the carriage",
    apart={
        "dead_time": DiscriminatingExperiment(
            "the second resonance at both ends of the travel: it moves with the carriage, a dead time stays", wide(*ENDS)
        ),
    },
    seen="a second resonance above the first one, the same at all amplitudes",
    causes="inertia of the idler and the returning span",
    check="mass and bearing of the idler",
    remedy="none needed; a lighter end pulley moves the second resonance up",
    alike={
        "coupling": "excite near both ends of the travel: the mode of the end pulley moves with the carriage, that of a coupling stays",
        "payload_mode": "take the payload off: its mode goes, that of the end pulley stays",
    },
    linear=True,
    completed_by=("viscous_end_pulley",),
    source="(2.11)-(2.20)",
)
