"""Motor, carriage and end pulley fitted to the records that the two-mass model is fitted to, and whether they show the third mass.

The bodies hang on the three belt sections (2.11) to (2.20), stiffness EA/l and damping DA/l of each by its length, the distance l3
of the pulleys from the data sheet.  Sections that were free of each other could not be told from one place: two resonances, two
antiresonances and the motor's inertia are five numbers, three masses and three springs are six.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from beltcomm.axis import Axis
from beltcomm.effects.belt_spans import stiffness as stiffness_at
from beltcomm.errors import DataError, Refused
from beltcomm.fit.model_fit import SUSPECT_MISFIT, ModelFit, fit_model
from beltcomm.fit.residual.segment import segments
from beltcomm.fit.residual.whitened import whitened_residual
from beltcomm.identify.final import FinalModel, PlaceStiffness, by_position, evidence, final_model
from beltcomm.model import Model, build_model
from beltcomm.model.linear import modes, operating_point
from beltcomm.recording import Recording
from beltcomm.response import FrequencyResponse

#: Parameter that is asked for, and the data sheet's entry that the sections rest on.
MASS, EA, OFFSET = "end_pulley.mass", "belt_sections.specific_stiffness", "belt_sections.offset"
GEOMETRY = "belt_sections.pulley_distance"
EFFECTS = ("belt_sections", "viscous", "viscous_cart", "coulomb", "cart_friction")
#: kg: end pulleys that are tried.  Shares of the two-mass model's carriage that are: the rest may be end pulley.
MASSES_KG = tuple(float(m) for m in np.geomspace(0.03, 4.0, 8))
CARRIAGES = (1.0, 0.7, 0.4)
#: Start values that are fitted until one explains the records; records by which they are ranked, and how fine the motion is then, s.
MOST_STARTS, RANKING_RECORDS, RANKING_STEP_S = 3, 3, 2.5e-4
#: Evidence, nats, that a third mass must have: what the laboratory asks of any effect, healthy machines reach up to 109 by chance.
CLEAR_EVIDENCE = 120.0
#: Share of itself that the mass, or a span, must be known to.
WELL_KNOWN = 0.25
#: A line shows the axis when its response is this many times its noise; neighbouring lines that are looked at together.
SHOWN, TOGETHER = 3.0, 9
#: Share of half the sampling frequency up to which a mode can be recorded.
UP_TO_NYQUIST = 0.9
#: A belt is at most this many times as stiff, or as soft, as its data sheet says; shortest section thought of, as a share of l3.
BELT_FACTOR, SHORTEST_SPAN = 4.0, 0.1
#: Where nothing else is known, a belt section's damping times its length, N s.
USUAL_DAMPING_N_S = 8.0


@dataclass(frozen=True)
class ResponseBand:
    """Response and band of one excited record.

    Attributes
    ----------
    place_m : float or None
        Carriage, None where nobody knows.
    highest_hz : float
        Last frequency with a response above the noise.
    nyquist_hz : float
        Half the sampling frequency.
    mode_hz, noise_ratio : float
        Of the end pulley's mode there, Hz, and response over noise around it; 0 beyond the lines.
    """

    record: str
    place_m: float | None
    highest_hz: float
    nyquist_hz: float
    mode_hz: float
    noise_ratio: float

    @property
    def shows(self) -> bool:
        """True if the mode lies among what it shows."""
        return self.mode_hz < self.highest_hz and self.noise_ratio >= SHOWN


@dataclass(frozen=True)
class ThreeMass:
    """Two masses and three on the same records.

    Attributes
    ----------
    evidence : float
        Nats, for three.
    reach : tuple of ResponseBand
        By excited record.
    against : tuple of str
        In words, why the third mass is not identified; () when it is.
    heavier_kg : float
        End pulley whose mode these records would show, 0 where this one's is.
    """

    two: FinalModel
    three: ModelFit
    evidence: float
    reach: tuple[ResponseBand, ...]
    against: tuple[str, ...]
    heavier_kg: float = 0.0

    @property
    def identified(self) -> bool:
        """True if the records hold a third mass."""
        return not self.against

    @property
    def confirmed(self) -> bool | None:
        """True if the error on the held-out records fell; None without any."""
        two, three = self.two.fit.held_out_misfit, self.three.held_out_misfit
        return None if two is None or three is None else three < two


def compare_masses(
    recordings: Sequence[Recording],
    axis: Axis,
    counts_per_rev: int,
    responses: Mapping[str, FrequencyResponse],
    *,
    progress: Callable[[float], None] = lambda _fraction: None,
) -> ThreeMass:
    """Both models fitted to all recordings, and the judgement.

    Parameters
    ----------
    recordings : sequence of Recording
    axis : Axis
    counts_per_rev : int
    responses : dict of str to FrequencyResponse
        Of the excited records with repeated periods, by name.
    progress : callable
        Hears the share that is done, 0 to 1.

    Raises
    ------
    UsageError
        When the axis file lacks the belt's data.
    DataError
        As :func:`beltcomm.identify.final.final_model`.
    """
    axis.require("the three-mass model", "belt.specific_stiffness_n", "belt.pulley_distance_m")
    two = final_model(recordings, axis, counts_per_rev, progress=lambda f: progress(0.4 * f))
    three = _fit_three_mass(recordings, axis, two.fit, counts_per_rev, progress=lambda f: progress(0.4 + 0.5 * f))
    if "belt_stiffness" in two.fit.model.effects and evidence(three, two.fit) > 0.0:
        two = _with_spans(two, axis, recordings, counts_per_rev)
    progress(1.0)
    return _judge_third_mass(two, three, axis, recordings, responses)


def _with_spans(two: FinalModel, axis: Axis, recordings: Sequence[Recording], counts_per_rev: int) -> FinalModel:
    """The two-mass model on the same spans with a massless end pulley, where that is the better one.

    A belt that gets softer along the few millimetres of an excitation must not be taken for a third mass.
    """
    stiffness = PlaceStiffness(two.fit.model["belt_stiffness.stiffness"], 0.0)
    places = {r.name: stiffness for r in recordings if r.sidecar.experiment == "frf" and not r.sidecar.held_out}
    start = by_position(two.fit.model, axis, recordings, places)
    spans = fit_model(recordings, start, counts_per_rev=counts_per_rev, noise_nm=two.fit.noise_nm)
    gain = evidence(spans, two.fit)
    return (
        FinalModel(spans, two.fit, f"spans with a massless end pulley: evidence {gain:+.3g} against one stiffness") if gain > 0.0 else two
    )


def _fit_three_mass(
    recordings: Sequence[Recording],
    axis: Axis,
    two: ModelFit,
    counts_per_rev: int,
    *,
    progress: Callable[[float], None] = lambda _fraction: None,
) -> ModelFit:
    """The three-mass model fitted to the excited records from the start values that rank best, until it explains them, then to all.

    Raises DataError when no start value is possible, Refused when no fit stays finite.
    """
    excited = [r for r in recordings if r.sidecar.experiment == "frf" and not r.sidecar.held_out]
    ranked = _ranked(list(_starts(axis, two.model, recordings, two.suspect)), excited, counts_per_rev, two.noise_nm)
    if not ranked:
        raise DataError("no start value of the three-mass model is possible; look at belt, pulley and travel in axis.yaml")
    best: ModelFit | None = None
    for number, start in enumerate(ranked[: MOST_STARTS if two.suspect else 1]):
        try:
            found = fit_model(excited, start, counts_per_rev=counts_per_rev, noise_nm=two.noise_nm)
        except DataError:
            continue
        if best is None or found.objective / found.samples < best.objective / best.samples:
            best = found
        progress(0.5 * (number + 1) / MOST_STARTS)
        if not best.suspect:
            break
    if best is not None and len(excited) == len(recordings):
        return best
    start = ranked[0] if best is None else best.model
    try:
        return fit_model(
            recordings,
            start,
            counts_per_rev=counts_per_rev,
            noise_nm=two.noise_nm,
            progress=lambda f: progress(0.5 + 0.5 * f),
        )
    except DataError as problem:
        raise Refused(
            "no third mass is identified, nothing was changed: no three-mass model with the belt of axis.yaml follows all of these records "
            f"({problem}); two masses leave {math.sqrt(two.misfit):.2f} times the noise"
        ) from problem


def _starts(axis: Axis, two: Model, recordings: Sequence[Recording], suspect: bool) -> Iterator[Model]:
    """Three-mass models around a two-mass one: end pulleys, what of them it took for carriage, the belt of data sheet and fit.

    suspect : the two-mass model does not explain the records; then its inertia is worth less than the data sheet's.
    """
    inertia = axis.motor_side_inertia_kg_m2 if suspect else two["motor.inertia"]
    sheet = sheet_mass_kg(axis)
    distance, offset = float(axis.get("belt.pulley_distance_m")), axis.travel.driven_side_offset_m
    bounds = _bounds(axis, recordings)
    belts = [(float(axis.get("belt.specific_stiffness_n")), offset)]
    if "belt_spans" in two.effects:
        belts.append((two["belt_spans.specific_stiffness"], two["belt_spans.offset"]))
    else:
        places = [r.sidecar.start_position_m or 0.0 for r in recordings if r.sidecar.experiment == "frf"]
        belts.append((two["belt_stiffness.stiffness"] / stiffness_at(float(np.median(places)), 1.0, distance, offset), offset))
    for mass in (*([sheet] if sheet else []), *MASSES_KG):
        for share in CARRIAGES:
            for ea, free in belts:
                values = {
                    "motor.inertia": inertia,
                    "cart.mass": share * two["cart.mass"],
                    "transmission.ratio": two["transmission.ratio"],
                    MASS: mass,
                    EA: ea,
                    GEOMETRY: distance,
                    OFFSET: free,
                    "belt_sections.specific_damping": USUAL_DAMPING_N_S,
                    **{name: two.get(name) for name in ("viscous.damping", "coulomb.level", "cart_friction.level")},
                    "viscous_cart.damping": 0.0,
                }
                model = build_model(two.name, EFFECTS, values, origin="three-mass fit").with_fixed(GEOMETRY)
                if all(low < model[name] < high for name, (low, high) in bounds.items()):
                    found = {n: replace(model.parameters[n], low=low, high=high) for n, (low, high) in bounds.items()}
                    yield replace(model, parameters={**model.parameters, **found})


def _ranked(starts: Sequence[Model], excited: Sequence[Recording], counts_per_rev: int, noise_nm: float) -> list[Model]:
    """The best start of every end pulley, best first, by what some excited records leave:  Σ ln(1 + e²), which forgives what is far off."""
    excited = sorted(excited, key=lambda r: r.sidecar.start_position_m or 0.0)
    few = [excited[i] for i in sorted({round(k) for k in np.linspace(0, len(excited) - 1, RANKING_RECORDS)})]
    costs: dict[float, tuple[float, Model]] = {}
    for start in starts:
        cost = 0.0
        for record in few:
            substeps = 2 * math.ceil(record.sample_period_s / (2.0 * RANKING_STEP_S))  # even, for Simpson's rule
            for piece in segments(record, start, math.tau / counts_per_rev, noise_nm, fitted=True, substeps=substeps):
                cost += float(np.sum(np.log1p(whitened_residual(piece, start, start.vector()) ** 2)))
        if math.isfinite(cost) and (start[MASS] not in costs or cost < costs[start[MASS]][0]):
            costs[start[MASS]] = (cost, start)
    return [model for _, model in sorted(costs.values(), key=lambda entry: entry[0])]


def _bounds(axis: Axis, recordings: Sequence[Recording]) -> dict[str, tuple[float, float]]:
    """Bounds of belt and end pulley: EA by the data sheet, no section shorter than ``SHORTEST_SPAN`` of l3 in the records, or
    half of what the data sheet says, where that is less, and no end pulley whose mode lies above the sampling frequency, which would
    show as compliance alone:

    m > EA (1/l2 + 1/l3)/(2π f_s)²,   l2 : the shortest allowed
    """
    distance, ea = float(axis.get("belt.pulley_distance_m")), float(axis.get("belt.specific_stiffness_n"))
    ratio, offset = axis.transmission_m_rad, axis.travel.driven_side_offset_m
    where = [(r.sidecar.start_position_m or 0.0) + ratio * (r.position - r.position[0]) for r in recordings]
    low, high = min(float(x.min()) for x in where), max(float(x.max()) for x in where)
    slowest = max(r.sample_period_s for r in recordings)
    first, second = (min(SHORTEST_SPAN * distance, 0.5 * max(span, 0.0)) for span in (offset + low, distance - offset - high))
    return {
        MASS: (ea * (1.0 / max(second, 1e-6) + 1.0 / distance) * (slowest / math.tau) ** 2, 100.0),
        EA: (ea / BELT_FACTOR, ea * BELT_FACTOR),
        OFFSET: (max(0.0, first - low), distance - second - high),
    }


def sheet_mass_kg(axis: Axis) -> float | None:
    """The end pulley at the belt by the data sheet, of the same make as the driving pulley:  Θ_r/r².

    Parameters
    ----------
    axis : Axis
        With inertia and radius of the pulley.

    Returns
    -------
    float or None
        kg; None when it is not known.
    """
    inertia, radius = axis.get("pulley.inertia_kg_m2"), axis.get("pulley.effective_radius_m")
    return float(inertia) / float(radius) ** 2 if inertia and radius else None


def resonances_hz(model: Model, position_m: float, held: Sequence[str] = ()) -> tuple[float, ...]:
    """Modes of the sliding axis.

    Parameters
    ----------
    model : Model
        With any number of bodies.
    position_m : float, m
        Carriage on the axis.
    held : sequence of str
        Bodies that cannot move; ("motor",) gives the antiresonances of the motor.

    Returns
    -------
    tuple of float
        Hz, rising.
    """
    return tuple(mode.freq_hz for mode in modes(model, operating_point(model, position_m, 1.0), held=held))


def _signal_up_to(response: FrequencyResponse) -> float:
    """Highest frequency, Hz, at which a response stands above its noise, median over neighbouring lines at least ``SHOWN``; 0 where it
    nowhere does.
    """
    ratio = np.abs(response.h) / np.maximum(response.noise, 1e-300)
    width = min(TOGETHER, len(ratio))
    shown = np.median(np.lib.stride_tricks.sliding_window_view(ratio, width), axis=1) >= SHOWN
    last = np.flatnonzero(shown)
    return float(response.freq_hz[last[-1] + width // 2]) if len(last) else 0.0


def _reach(name: str, place_m: float | None, response: FrequencyResponse, model: Model) -> ResponseBand:
    mode = resonances_hz(model, place_m or 0.0)[-1]
    around = np.argsort(np.abs(response.freq_hz - mode))[:TOGETHER]
    within = response.freq_hz[0] <= mode <= response.freq_hz[-1]
    ratio = float(np.median(np.abs(response.h[around]) / np.maximum(response.noise[around], 1e-300))) if within else 0.0
    return ResponseBand(name, place_m, _signal_up_to(response), 0.5 / response.sample_period_s, mode, ratio)


def _judge_third_mass(
    two: FinalModel, three: ModelFit, axis: Axis, recordings: Sequence[Recording], responses: Mapping[str, FrequencyResponse]
) -> ThreeMass:
    """The third mass, judged by evidence, intervals, held-out records, what is left over, and its mode within the records."""
    gain = evidence(three, two.fit)
    item = three.model.parameters[MASS]
    known = item.interval is not None and item.interval <= WELL_KNOWN * item.value
    sheet = sheet_mass_kg(axis)
    # A mass that the records do not tell has no mode worth naming: then that of the data sheet counts.
    told = known and gain > CLEAR_EVIDENCE
    meant = three.model if told or sheet is None else three.model.with_values({MASS: max(sheet, item.low)})
    places = {r.name: r.sidecar.start_position_m for r in recordings if not r.sidecar.held_out}
    reach = tuple(_reach(name, places[name], response, meant) for name, response in responses.items() if name in places)
    against: list[str] = []
    heavier = 0.0
    if gain <= CLEAR_EVIDENCE:
        against.append(
            f"the evidence for a third mass is {gain:+.3g}, {CLEAR_EVIDENCE:g} are needed: two masses explain these records as well"
        )
    if not known:
        against.append(_badly_known(three))
    against += [
        f"{name} = {three.model[name]:.3g} {three.model.parameters[name].unit} is not known to {100 * WELL_KNOWN:.0f} %"
        for name in (EA,)
        if (three.model.parameters[name].interval or math.inf) > WELL_KNOWN * three.model[name]
    ]
    if three.misfit > SUSPECT_MISFIT:
        cause = (
            "something else acts on this axis, a compliant coupling for instance, and would be taken for part of the end pulley"
            if two.fit.misfit > SUSPECT_MISFIT
            else "the stiffness of this belt does not go with the place as sections between pulleys would make it (2.10)"
        )
        against.append(
            f"with three masses {math.sqrt(three.misfit):.2f} times the noise is left over (two: {math.sqrt(two.fit.misfit):.2f}): {cause}"
        )
    if three.held_out_misfit is not None and two.fit.held_out_misfit is not None and three.held_out_misfit >= two.fit.held_out_misfit:
        against.append(
            f"on the records that were not fitted the error does not fall: {math.sqrt(two.fit.held_out_misfit):.2f} times the noise with "
            f"two masses, {math.sqrt(three.held_out_misfit):.2f} with three"
        )
    if not any(one.shows for one in reach):
        middle_m = float(np.median([r.sidecar.start_position_m or 0.0 for r in recordings]))
        text, heavier = _out_of_reach(meant[MASS], reach, resonances_hz(meant, middle_m)[-1], recordings)
        against.append(text)
    return ThreeMass(two, three, gain, reach, tuple(against), heavier)


def _badly_known(three: ModelFit) -> str:
    """Remark on a mass that the records do not determine."""
    item = three.model.parameters[MASS]
    if item.interval is None:
        return (
            f"the mass of the end pulley went to its bound, {item.value:.2g} kg, below which it could not be seen: these records hold none"
        )
    return (
        f"the mass of the end pulley is {item.value:.3g} ± {item.interval:.2g} kg: these records say no more than that it is below "
        f"{item.value + item.interval:.2g} kg"
    )


def _out_of_reach(mass_kg: float, reach: Sequence[ResponseBand], mode_hz: float, recordings: Sequence[Recording]) -> tuple[str, float]:
    """Reason why no record shows the mode, with what would, and the end pulley whose mode they would show, kg."""
    nearest = min(reach, key=lambda one: one.mode_hz / max(one.highest_hz, 1e-3), default=None)
    if nearest is None:
        nyquist = 0.5 / min(r.sample_period_s for r in recordings)
        return (
            f"the mode of an end pulley of {mass_kg:.3g} kg lies near {mode_hz:.0f} Hz, the sampling ends at {nyquist:.0f} Hz, and no "
            "record repeats its excitation, which would tell signal from noise up there: record two periods or more of it",
            0.0,
        )
    mode_hz, nyquist = nearest.mode_hz, nearest.nyquist_hz
    heavier = mass_kg * (mode_hz / (0.7 * nearest.highest_hz)) ** 2 if nearest.highest_hz else 0.0
    where = f"the mode of an end pulley of {mass_kg:.3g} kg lies near {mode_hz:.0f} Hz"
    idler = f", or a heavier end pulley, from {heavier:.2g} kg on" if heavier > mass_kg else ""
    if mode_hz > UP_TO_NYQUIST * nyquist:
        return (
            f"{where}, the sampling of {nearest.record} ends at {nyquist:.0f} Hz; record with a sample every "
            f"{500.0 * UP_TO_NYQUIST / mode_hz:.2g} ms or less{idler}",
            heavier,
        )
    if mode_hz > nearest.highest_hz:
        clock = max(1, math.floor(2.0 * nyquist / (1.5 * mode_hz)))
        return (
            f"{where}, {nearest.record} holds no signal above {nearest.highest_hz:.0f} Hz; record with a PRBS of {clock} "
            f"sample{'s' if clock > 1 else ''} per bit, whose first zero lies at {2.0 * nyquist / clock:.0f} Hz, or a multisine up to "
            f"{min(1.3 * mode_hz, UP_TO_NYQUIST * nyquist):.0f} Hz{idler}",
            heavier,
        )
    periods = math.ceil((SHOWN / max(nearest.noise_ratio, 0.1)) ** 2)
    return (
        f"{where}, where the response of {nearest.record} is {nearest.noise_ratio:.2g} times its noise, {SHOWN:g} are needed: record "
        f"{periods} times as many periods, or with more torque{idler}",
        heavier,
    )
