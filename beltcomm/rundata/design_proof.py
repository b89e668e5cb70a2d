"""Proof of a design beyond its model: on every measured response, on draws of the uncertain parameters, on records that contradict it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from beltcomm.control import Cascade
from beltcomm.design.cascade import DesignResult
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.margins import Margins, margins
from beltcomm.design.measured import MeasuredMargins, measured_margins
from beltcomm.design.spread import MarginSpread, margin_spread
from beltcomm.errors import DataError, Refused, UsageError
from beltcomm.fit.model_fit import SUSPECT_MISFIT, fit_model
from beltcomm.fit.noise.level import torque_noise
from beltcomm.fit.residual.segment import segments
from beltcomm.fit.residual.whitened import squares_left, whitened_residual, with_observer
from beltcomm.fit.torque.path import FAITHFUL, TorquePath
from beltcomm.fit.uncertainty.draws import machines_like
from beltcomm.identify.dead_time import DeadTime
from beltcomm.model import Model
from beltcomm.model.linear import describes
from beltcomm.model.value import NORMAL_95
from beltcomm.recording import Recording
from beltcomm.response import FrequencyResponse
from beltcomm.result import plain
from beltcomm.rundata import analyse
from beltcomm.rundata.conditions import Condition, condition_of
from beltcomm.rundata.delays import delay
from beltcomm.rundata.findings import Findings
from beltcomm.rundata.offline import counts_of
from beltcomm.rundata.proof import SURE_MARGIN_DEG
from beltcomm.runfolder import RunFolder
from beltcomm.verify import LEAST_DRAWN

#: Draws of the parameters, and the most closed loops that are judged: half a second.
DRAWS, MOST_LOOPS = 160, 1600
#: Parameters whose place the design's own dampings take.
DAMPINGS = ("viscous.damping", "viscous_cart.damping")
#: What a single record may change of the model to be explained: the load and how it hangs on the motor, friction with it.
LOAD = ("cart.", "belt_stiffness.", "belt_spans.specific_stiffness", "belt_damping.", "viscous.", "coulomb.", "cart_friction.")


@dataclass(frozen=True)
class Contradiction:
    """A record that the design's model does not explain.

    Attributes
    ----------
    misfit : float
        Mean square of its whitened residual, 1 at the noise.
    own : Model or None
        The model with the load that this record wants for itself, None where none explains it; own_misfit.
    margins : tuple of Margins
        Of the design on that load, as it counts its own.
    holds : bool
        They are what was asked for.
    """

    condition: Condition
    misfit: float
    own: Model | None
    own_misfit: float | None
    margins: tuple[Margins, ...]
    holds: bool


@dataclass(frozen=True)
class WorstLoop:
    """The loop nearest to -1 of all.

    Attributes
    ----------
    kind : str
        Where it was found.
    position_m, mass_kg, damping_nm_s_rad : float or None
        Of the plant; for a measured one place and record.
    sensitivity_db : float
        Max |1/(1 + L)| of both loops.
    text : str
        In words.
    """

    kind: str
    text: str
    sensitivity_db: float
    position_m: float | None
    mass_kg: float | None
    damping_nm_s_rad: float | None
    record: str | None


@dataclass(frozen=True)
class DesignProof:
    """Everything that was examined.

    Attributes
    ----------
    conditions : tuple of Condition
        Of the measured responses.
    left_out : tuple of str
        Records without a response, and why.
    source : str
        Where the draws come from, by ``seed``.
    doubts : tuple of str
        What speaks against the design, in words; notes : what else to know.
    """

    measured: tuple[MeasuredMargins, ...]
    conditions: tuple[Condition, ...]
    left_out: tuple[str, ...]
    spread: MarginSpread
    source: str
    seed: int
    contradictions: tuple[Contradiction, ...]
    worst: WorstLoop
    doubts: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def has_failed(self) -> bool:
        """True if some loop is unstable, or a load that was recorded is not borne: the gains are not to be used as they are."""
        unstable = self.spread.unstable > 0 or any(one.stable is False for one in self.measured)
        return unstable or any(_not_borne(one) for one in self.contradictions)

    def to_dict(self) -> dict[str, Any]:
        """``proof`` of ``designs/final.yaml`` and ``--json``."""
        conditions = {c.record: c for c in self.conditions}
        return {
            "measured": [
                {**plain(one), "place_m": c.place_m, "amplitude_nm": c.amplitude_nm, "direction": c.direction}
                for one in self.measured
                for c in (conditions[one.record],)
            ],
            "left_out": list(self.left_out),
            "draws": {
                "count": self.spread.draws,
                "plants": self.spread.plants,
                "loops": self.spread.draws * self.spread.plants,
                "unstable": self.spread.unstable,
                "seed": self.seed,
                "source": self.source,
                "worst_2_5_percent": dict(self.spread.worst_values),
            },
            "contradictions": [
                {
                    "record": one.condition.record,
                    "misfit": one.misfit,
                    "own_mass_kg": one.own["cart.mass"] if one.own else None,
                    "own_misfit": one.own_misfit,
                    "phase_margin_deg": min((m.phase_margin_deg for m in one.margins), default=None),
                    "stable": all(m.stable and m.velocity_stable for m in one.margins) if one.margins else None,
                    "holds": one.holds,
                }
                for one in self.contradictions
            ],
            "worst": plain(self.worst),
            "doubts": list(self.doubts),
            "notes": list(self.notes),
        }


@dataclass(frozen=True)
class Grounds:
    """Grounds that a design rests on.

    model; positions_m and extra_kg (payloads beyond what is mounted, 0 first) : of its plants.

    Attributes
    ----------
    delay_s : float
        From setpoint to torque, with ``dead_time`` where it was measured.
    apparent_nm_s_rad : float
        Largest damping it counts.
    counts_per_rev : int or None
    path : TorquePath or None
        To the torque that acts.
    """

    model: Model
    positions_m: Sequence[float]
    extra_kg: Sequence[float]
    delay_s: float
    dead_time: DeadTime | None
    apparent_nm_s_rad: float
    counts_per_rev: int | None
    path: TorquePath | None = None


def grounds_of(folder: RunFolder, model: Model, findings: Findings, payloads_kg: Sequence[float]) -> Grounds:
    """Grounds that the design of a run rests on.

    Parameters
    ----------
    folder : RunFolder
    model : Model
    findings : Findings
        With delay, damping and torque path.
    payloads_kg : sequence of float, kg
        Further ones.
    """
    try:
        counts: int | None = counts_of(folder)
    except (DataError, UsageError):
        counts = None
    return Grounds(
        model,
        folder.axis.travel.ends_m,
        (0.0, *payloads_kg),
        delay(findings),
        findings.dead_time,
        analyse.apparent_damping(findings.thesis),
        counts,
        findings.path,
    )


def prove(grounds: Grounds, design: DesignResult, cascade: Cascade, recordings: Sequence[Recording], *, seed: int = 0) -> DesignProof:
    """The cascade of a design on every measured response, every draw, and every load that a record wants for itself.

    Parameters
    ----------
    grounds : Grounds
        Model, delay and spread that the design rests on.
    design : DesignResult
        Result with its specification.
    cascade : Cascade
        That was designed.
    recordings : sequence of Recording
        Of the run; excited ones are taken.
    seed : int

    Returns
    -------
    DesignProof
        Margins in deg and dB, with doubts in words.
    """
    excited = [r for r in recordings if r.sidecar.experiment == "frf"]
    measured, left_out = _on_responses(excited, cascade, design.structure.period_s, grounds.delay_s)
    conditions = tuple(condition_of(r, grounds.model["transmission.ratio"]) for r in excited if r.name in {m.record for m in measured})
    spread, source = _on_draws(grounds, cascade, design.structure.period_s, seed)
    contradictions, notes = _contradicting(grounds, design, cascade, excited)
    return DesignProof(
        measured,
        conditions,
        left_out,
        spread,
        source,
        seed,
        contradictions,
        _worst(grounds, design, measured, conditions, spread, contradictions),
        _doubts(measured, spread, contradictions, design.specification.sensitivity_db),
        notes,
    )


def _on_responses(
    recordings: Sequence[Recording], cascade: Cascade, period_s: float, delay_s: float
) -> tuple[tuple[MeasuredMargins, ...], tuple[str, ...]]:
    """Margins on every response: from the torque setpoint where it was recorded, the delay then in it; and what could not be used."""
    found, left_out = [], []
    usable = {name: (response, late_s) for name, response, late_s in plant_responses(recordings, delay_s)}
    for recording in recordings:
        name = recording.name
        if recording.side != "motor":
            left_out.append(f"{name} (recorded in {recording.torque_unit}, the gains are in N m)")
        elif name not in usable:
            left_out.append(f"{name} (fewer than two whole periods)")
        else:
            response, late_s = usable[name]
            try:
                found.append(measured_margins(response, cascade, period_s, late_s, name))
            except DataError as problem:
                left_out.append(f"{name} ({problem})")
    return tuple(found), tuple(left_out)


def plant_responses(recordings: Sequence[Recording], delay_s: float) -> list[tuple[str, FrequencyResponse, float]]:
    """Name, response and the delay that is not in it, s: from the torque setpoint where it was recorded, else from the acting torque.

    Parameters
    ----------
    recordings : sequence of Recording
        Excited.
    delay_s : float, s
        From torque setpoint to acting torque.

    Returns
    -------
    list of tuple of str, FrequencyResponse and float
        rad/(N m) at the motor shaft, by record.
    """
    by_torque, by_setpoint = analyse.responses(recordings), analyse.responses(recordings, setpoint=True)
    return [(name, by_setpoint.get(name, response), 0.0 if name in by_setpoint else delay_s) for name, response in by_torque.items()]


def _on_draws(grounds: Grounds, cascade: Cascade, period_s: float, seed: int) -> tuple[MarginSpread, str]:
    """The spread of margins over joint draws of the model's parameters and the delay, and where their uncertainty comes from."""
    model, late = grounds.model, grounds.dead_time
    source = "the fit's covariance" if model.covariance else "the model's intervals, taken as independent"
    variants = len(_plants(grounds, model, grounds.delay_s))
    count = min(DRAWS, max(MOST_LOOPS // variants, 1))
    spread_s = late.interval_s / NORMAL_95 if late else 0.0
    delays = np.maximum(grounds.delay_s + spread_s * np.random.default_rng((seed, 1)).standard_normal(count), 0.0)
    draws = []
    # Every damping between none and the apparent one is a plant of its own anyway, so the drawn one would only change which.
    for machine, d in zip(machines_like(model, count, seed=seed, held=DAMPINGS), delays, strict=True):
        with suppress(UsageError):  # a law that hardly anything is known of may leave no stiffness at an end of the travel
            if all(describes(machine, x) for x in grounds.positions_m):  # nor length to a section of the belt
                draws.append(_plants(grounds, machine, float(d)))
    if len(draws) < LEAST_DRAWN * count:
        raise Refused(
            f"{len(draws)} of {count} draws of the model make a machine at {' and '.join(f'{x:.2f} m' for x in grounds.positions_m)}, "
            f"{LEAST_DRAWN:.0%} are needed to prove a design: record more "
            "(beltcomm diagnose RUN --next), or design without the effect that is known worst (beltcomm remove EFFECT RUN)"
        )
    none = f", of which {count - len(draws)} of {count} draws make no machine and were left out" if len(draws) < count else ""
    return margin_spread(draws, cascade, period_s), source + none + (" and the delay's interval" if late else "; the delay is assumed")


def _plants(grounds: Grounds, model: Model, delay_s: float) -> list[DesignPlant]:
    masses = [model["cart.mass"] + extra for extra in grounds.extra_kg]
    return analyse.design_plants(model, grounds.positions_m, masses, delay_s, grounds.apparent_nm_s_rad)


def _contradicting(
    grounds: Grounds, design: DesignResult, cascade: Cascade, recordings: Sequence[Recording]
) -> tuple[tuple[Contradiction, ...], tuple[str, ...]]:
    """Records whose torque the model does not explain, friction in it, and the design's margins on the load that each wants for itself."""
    model, counts = grounds.model, grounds.counts_per_rev
    if counts is None or not recordings:
        return (), (
            "whether a record contradicts the model was not examined: the steps of the encoder are not known",
        ) if recordings else ()
    noise, step = torque_noise(recordings), 2.0 * np.pi / counts
    fixed = [n for n in model.parameters if not n.startswith(LOAD)]
    found = []
    for recording in recordings:
        pieces = [with_observer(p, model) for p in segments(recording, model, step, noise, fitted=True, path=grounds.path or FAITHFUL)]
        pieces = [p for p in pieces if p.keep.any()]
        if not pieces or np.mean(np.concatenate([whitened_residual(p, model, model.vector()) for p in pieces]) ** 2) <= SUSPECT_MISFIT:
            continue
        # Where its carriage stuck before is nobody's fault.
        misfit = float(np.mean(np.concatenate([squares_left(p, model, model.vector()) for p in pieces])))
        if misfit <= SUSPECT_MISFIT:
            continue
        condition = condition_of(recording, model["transmission.ratio"])
        try:
            alone = fit_model(
                [_to_fit(recording)], model, counts_per_rev=counts, fixed=fixed, noise_nm=noise, path=grounds.path or FAITHFUL
            )
            reached = margins(cascade, _plants(grounds, alone.model, grounds.delay_s), design.structure.period_s)
        except (DataError, Refused, UsageError):
            found.append(Contradiction(condition, misfit, None, None, (), holds=False))
            continue
        explained = not alone.suspect
        holds = explained and _sound(reached, design.specification.sensitivity_db)
        found.append(Contradiction(condition, misfit, alone.model if explained else None, alone.misfit, reached, holds=holds))
    return tuple(found), ()


def _sound(reached: Sequence[Margins], sensitivity_db: float) -> bool:
    """True if a loop that was not designed for these plants still has what a sound one needs; the design's own margins may be passed."""
    return all(
        one.stable and one.velocity_stable and one.phase_margin_deg >= SURE_MARGIN_DEG and one.most_sensitivity_db <= sensitivity_db
        for one in reached
    )


def _to_fit(recording: Recording) -> Recording:
    """Recording that is not held out."""
    return replace(recording, sidecar=replace(recording.sidecar, held_out=False)) if recording.sidecar.held_out else recording


def _worst(
    grounds: Grounds,
    design: DesignResult,
    measured: Sequence[MeasuredMargins],
    conditions: Sequence[Condition],
    spread: MarginSpread,
    contradictions: Sequence[Contradiction],
) -> WorstLoop:
    """The loop nearest to -1 over variants of the model, draws, measured responses and loads that records want."""

    def loads(kind: str, plants: Sequence[DesignPlant], reached: Sequence[Margins]) -> list[WorstLoop]:
        sizes = [one.most_sensitivity_db for one in reached]
        return [_of_plant(grounds, kind, i / len(plants), p, size) for i, (p, size) in enumerate(zip(plants, sizes, strict=True))]

    found = loads("model", design.plants, design.margins)
    at = spread.worst_at / spread.plants
    drawn = _of_plant(grounds, "draws", at, spread.worst, spread.worst_values["sensitivity_db"])
    found.append(replace(drawn, text=f"{drawn.text}, not exceeded by 97.5 % of the draws of the uncertain parameters"))
    for one, condition in zip(measured, conditions, strict=True):
        most = max(one.velocity.most_sensitivity_db, one.position.most_sensitivity_db)
        text = f"{one.record}, measured at {condition.words()}, the load that was mounted, friction as damping, with 95 %"
        found.append(WorstLoop("measured", text, most, condition.place_m, None, None, one.record))
    for other in contradictions:
        if other.own is not None:
            name, plants = other.condition.record, _plants(grounds, other.own, grounds.delay_s)
            own = loads("record's own load", plants, other.margins)
            found += [replace(one, record=name, text=f"{one.text}, the load that {name} wants for itself") for one in own]
    return max(found, key=lambda one: one.sensitivity_db)


def _of_plant(grounds: Grounds, kind: str, share: float, plant: DesignPlant, sensitivity_db: float) -> WorstLoop:
    """A plant of the model.   share : its number over all of ``analyse.design_plants``, which runs through places first."""
    place = float(grounds.positions_m[int(share * len(grounds.positions_m) + 1e-9)])
    damping = plant.friction_damping_nm_s_rad
    friction = f"{1e3 * damping:.1f} mN m s/rad of friction as damping" if damping else "no damping by friction"
    text = f"{place:.2f} m, {plant.mass_kg:.2f} kg, {friction}"
    return WorstLoop(kind, text, sensitivity_db, place, plant.mass_kg, damping, None)


def _doubts(
    measured: Sequence[MeasuredMargins], spread: MarginSpread, contradictions: Sequence[Contradiction], asked_db: float
) -> tuple[str, ...]:
    """Doubts against writing these gains to a drive."""
    found = [f"on the response measured in {one.record} the loop is unstable" for one in measured if one.stable is False]
    if spread.unstable:
        loops = spread.draws * spread.plants
        found.append(f"{spread.unstable} of {loops} loops drawn from the parameters' uncertainty are unstable: identify the axis better")
    elif spread.worst_values["sensitivity_db"] > asked_db:
        found.append(
            f"with 2.5 % of the draws of the parameters the sensitivity exceeds {spread.worst_values['sensitivity_db']:.1f} dB, asked are "
            f"{asked_db:.1f}: identify the axis better"
        )
    unexplained = [one.condition.record for one in contradictions if one.own is None]
    if unexplained:
        found.append(f"the model does not explain {', '.join(unexplained)}, and no other load does: run `beltcomm diagnose`")
    return (*found, *(_excess_words(one) for one in contradictions if _not_borne(one)))


def _not_borne(one: Contradiction) -> bool:
    return one.own is not None and not one.holds


def _excess_words(one: Contradiction) -> str:
    assert one.own is not None
    return (
        f"{one.condition.record} was made with another load ({one.own['cart.mass']:.2f} kg at the carriage), for which these gains leave "
        "too little margin: take the record away, or design for that load"
    )
