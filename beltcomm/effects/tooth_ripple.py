"""Ripple of the belt's teeth running into the pulley."""

from __future__ import annotations

from beltcomm.effects._effect import AxisSummary, DiscriminatingExperiment, Effect, ManualCheck, Parameter, Trial
from beltcomm.effects._records import AGAIN, belt_off
from beltcomm.effects.cogging import force, slope


def _trials(ground: AxisSummary) -> list[Trial]:
    """The order is the number of teeth over the gear ratio; none without it."""
    if ground.teeth <= 0:
        return []
    return [Trial({"teeth": ground.teeth, "sine": 0.02, "cosine": 0.02}, amplitudes=("sine", "cosine"), signed=True)]


EFFECT = Effect(
    name="tooth_ripple",
    slot="force",
    of_belt=True,
    title="ripple of the belt teeth",
    parameters=(
        Parameter(
            "teeth", "1", "motor", 26.0, 0.01, 500.0, "periods per turn of the motor: teeth of the pulley over the gear ratio", fitted=False
        ),
        Parameter("sine", "N m", "motor", 0.0, -5.0, 5.0, "amplitude of the sine"),
        Parameter("cosine", "N m", "motor", 0.0, -5.0, 5.0, "amplitude of the cosine"),
    ),
    law=force,
    slope=slope,
    body="motor",
    trials=_trials,
    harmonic="load",
    twins=("cogging",),
    separate="take the belt off and turn the motor slowly: the ripple of the teeth goes, cogging stays",
    apart={
        "cogging": DiscriminatingExperiment(
            "nothing that moves by the motor: at one order both are the same law",
            hands=(
                belt_off("cogging", "the mesh of the teeth"),
                ManualCheck(
                    "loosen the driving pulley, turn it on its shaft by a quarter of the ripple's period, clamp it again",
                    AGAIN,
                    "the phase of cogging at the motor angle stays, that of the teeth moves by a quarter",
                ),
            ),
        ),
    },
    seen="torque ripples with the pitch of the belt",
    causes="mesh of belt and pulley",
    check="belt tension, wear of the pulley, dirt in its grooves",
    remedy="pretension by the data sheet, clean the grooves, replace worn belt and pulley; else it is sent along",
    alike={
        "pulley_eccentricity": "count the periods per turn: one is run-out, as many as the pulley has teeth is the mesh",
    },
    source="data sheet of the belt",
)
