"""Errors of estimated parameters over the Cramér-Rao bound, for each excitation and estimator, at equal time on the machine.

Axis: the rig g_b, once without set-valued friction (``linear``), once with it.  Each excitation is as loud as the same limits allow and
takes the same time (`beltcomm.thesis.excitations`).  The record: counted angle, measured torque with noise; nobody is told the
acting torque.

No torque is given twice alike (``given``): periods that repeat exactly are rounded alike, which no axis does and the bound does not mean.

The bound is that of ``bound``.   Seeds begin at FIRST_SEED: the limits of the final fit were set on seeds 1 to 8.  The default path
gets MANY times as many, for two digits.

Estimators: ``thesis`` unweighted log magnitude (3.32), ``complex`` response weighted with its own scatter, ``inverse`` the torque that the
motion needs, which is what a commissioning takes.  Errors are rms over the seeds, bias included.
"""

from __future__ import annotations

import functools
import hashlib
import json
import math
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from platformdirs import user_cache_path
from scipy.optimize import least_squares
from scipy.stats import chi2

import beltcomm
from beltcomm.errors import BeltcommError
from beltcomm.excitation import Excitation, choose
from beltcomm.fit.model_fit import fit_model
from beltcomm.given import EXCITATION_KINDS
from beltcomm.identify.amplitude import largest_amplitude
from beltcomm.identify.magnitude_fit import fit_magnitude
from beltcomm.model import Model, load_plant
from beltcomm.model.linear import modes, operating_point, sampled_response
from beltcomm.recording import Recording
from beltcomm.response import FrequencyResponse, estimate_response
from beltcomm.thesis import excitations
from beltcomm.thesis.excitations import BEGIN, COUNTS, LIMITS, NOISE_NM, PERIOD_S, PLACE_M, SECONDS, _make_recording
from benchmarks.speeds.bound import bound
from benchmarks.speeds.measure import Figure

Array = NDArray[np.float64]
Errors = Mapping[str, float]
Estimator = Callable[[Recording, Model], Errors]
#: Parameters that are compared, and their name in the thesis's fit.
MEANT = {"cart.mass": "mass_kg", "belt_stiffness.stiffness": "stiffness_n_m", "motor.inertia": "inertia_kg_m2"}
DEFAULT = ("prbs", "inverse")
OF_THE_THESIS = ("prbs", "thesis")
AIM, GAIN = 1.2, 2.0
FIRST_SEED, MANY = 1001, 25
#: Share of the torque's noise by which the acting torque differs from period to period; the reading shows it.  A thousandth moves the rig
#: without friction by 0.8 counts in a period, this by 8, and by 1 with friction under a multisine: no period is rounded like another.
UNLIKE = 0.01
DRAWS = user_cache_path("beltcomm") / "benchmark-draws.json"


def axis(condition: str) -> Model:
    """The rig, ``linear`` or with ``friction``."""
    model = load_plant("g_b").model
    for name in ("coulomb", "cart_friction") if condition == "linear" else ():
        model = model.without_effect(name)
    return model


def signal_of(model: Model, kind: str) -> Excitation:
    """The excitation, as loud as travel, speed and belt allow."""
    at = operating_point(model, PLACE_M, 1.0)
    low, high = (min(m.freq_hz for m in modes(model, at, held=held)) for held in (("motor",), ()))
    choice = choose(kind, PERIOD_S, low, high, SECONDS)  # type: ignore[arg-type]
    shape = choice.excitation(1.0, PERIOD_S)
    step = largest_amplitude([model], shape.torque / shape.amplitude_nm, PERIOD_S, PLACE_M, LIMITS, LIMITS.torque_nm)
    return choice.excitation(step.amplitude_nm**2 / choice.excitation(step.amplitude_nm, PERIOD_S).amplitude_nm, PERIOD_S)


def given(signal: Excitation, seed: int) -> Excitation:
    """The signal as a drive gives it, the torque of no period quite that of another."""
    differs = UNLIKE * NOISE_NM * np.random.default_rng((seed, 1)).normal(size=len(signal.torque))
    return replace(signal, torque=signal.torque + differs)


def free(model: Model) -> tuple[str, ...]:
    """Parameters that are estimated."""
    return tuple(name for name in model.parameters if name != "transmission.ratio")


def response_of(record: Recording) -> FrequencyResponse:
    """The response of a record."""
    note = record.sidecar.excitation
    assert note is not None
    return estimate_response(record.torque, record.position, PERIOD_S, note.period_samples, note.first_sample)


def by_thesis(record: Recording, true: Model) -> Errors:
    """Log magnitude, every line alike, inertia fitted too."""
    fit = fit_magnitude(response_of(record), true["transmission.ratio"], None)
    return {name: fit.parameters[own].value / true[name] - 1.0 for name, own in MEANT.items()}


def by_complex(record: Recording, true: Model) -> Errors:
    """Complex response of the linear model, each line weighted with the scatter of its periods."""
    linear = true
    for name in ("coulomb", "cart_friction"):
        linear = linear.without_effect(name) if name in linear.effects else linear
    answer = response_of(record)
    lines = (answer.freq_hz > 2.0) & (answer.freq_hz < 0.4 / PERIOD_S) & (answer.noise < 0.5 * np.abs(answer.h))
    freq, measured, noise = answer.freq_hz[lines], answer.h[lines], answer.noise[lines]
    names = free(linear)
    at = operating_point(linear, PLACE_M, 1.0)

    def residual(x: Array) -> Array:
        model = linear.with_vector(linear.with_values({n: linear[n] * math.exp(v) for n, v in zip(names, x, strict=True)}).vector())
        left = (measured - sampled_response(model, at, freq, PERIOD_S)) / noise
        return np.concatenate([left.real, left.imag])

    begin = np.log([BEGIN.get(n, 1.0) for n in names])
    found = least_squares(residual, begin, x_scale=0.1, bounds=(begin - 2.0, begin + 2.0), max_nfev=60)
    return {n: math.exp(v) - 1.0 for n, v in zip(names, found.x, strict=True)}


def by_inverse(record: Recording, true: Model) -> Errors:
    """The final fit, begun with what data sheets are wrong by."""
    start = true.with_values({n: f * true[n] for n, f in BEGIN.items() if n in true.parameters}, "start")
    fit = fit_model([record], start, counts_per_rev=COUNTS)
    return {name: fit.model[name] / true[name] - 1.0 for name in free(true)}


ESTIMATORS: Mapping[str, Estimator] = {"thesis": by_thesis, "complex": by_complex, "inverse": by_inverse}


def drawn(estimate: Estimator, model: Model, signal: Excitation, seed: int) -> Errors:
    """Errors of one estimator on the record of one seed."""
    return estimate(_make_recording(model, given(signal, seed), seed), model)


class Draws:
    """Errors by condition, excitation, estimator and seed; kept in a file as long as the code that makes them is the same."""

    def __init__(self, path: Path) -> None:
        self._path = path
        digest = hashlib.sha256()
        for folder in ("identify", "simulate", "excitation", "effects"):
            for file in sorted((Path(beltcomm.__file__).parent / folder).glob("*.py")):
                digest.update(file.read_bytes())
        for file in (Path(__file__), Path(excitations.__file__)):
            digest.update(file.read_bytes())
        self._of = digest.hexdigest()[:16]
        found = json.loads(path.read_text()) if path.exists() else {}
        self._kept: dict[str, Errors] = found.get("draws", {}) if found.get("of") == self._of else {}

    def get(self, key: str, make: Callable[[], Errors]) -> Errors:
        """A draw, made when it is not there; empty where the estimator gives up."""
        if key not in self._kept:
            try:
                self._kept[key] = make()
            except BeltcommError:
                self._kept[key] = {}
            self._path.parent.mkdir(parents=True, exist_ok=True)
            draft = self._path.with_suffix(".draft")
            draft.write_text(json.dumps({"of": self._of, "draws": self._kept}))
            os.replace(draft, self._path)
        return self._kept[key]


def rms(values: list[float]) -> float:
    """Root mean square; nan without a value."""
    return math.sqrt(sum(v * v for v in values) / len(values)) if values else math.nan


def open_factor(count: int) -> tuple[float, float]:
    """Factors between which ``count`` draws leave a standard deviation with 80 %."""
    return math.sqrt(count / chi2.ppf(0.9, count)), math.sqrt(count / chi2.ppf(0.1, count))


def run(draws: int) -> Iterator[Figure]:
    """All figures of the topic."""
    kept = Draws(DRAWS)
    found: dict[tuple[str, str, str], dict[str, float]] = {}
    for condition in ("linear", "friction"):
        model = axis(condition)
        for kind in EXCITATION_KINDS:
            signal = signal_of(model, kind)
            least = bound(model, signal, free(model))
            for estimator, estimate in ESTIMATORS.items():
                default = (kind, estimator) == DEFAULT
                count = draws * MANY if default else draws
                errors = [
                    kept.get(f"{condition} {kind} {estimator} {seed}", functools.partial(drawn, estimate, model, signal, seed))
                    for seed in range(FIRST_SEED, FIRST_SEED + count)
                ]
                good = [e for e in errors if e]
                over = {n: rms([e[n] for e in good]) / least[n] for n in (good[0] if good else MEANT)}
                found[condition, kind, estimator] = {n: rms([e[n] for e in good]) for n in MEANT}
                note = f"{len(good)} of {count} draws"
                low, high = open_factor(max(len(good), 1))
                if default:
                    for name, value in over.items():
                        title = f"{condition}, {kind}, {estimator}: {name} over its bound"
                        yield Figure(
                            "estimation",
                            title,
                            value,
                            "x",
                            AIM,
                            False,
                            low * value,
                            high * value,
                            f"{note}, bound {100 * least[name]:.3g} %",
                        )
                else:
                    middle = math.exp(float(np.mean([math.log(over[n]) for n in MEANT]))) if good else math.nan
                    each = ", ".join(f"{n.split('.')[1]} {100 * found[condition, kind, estimator][n]:.2g} %" for n in MEANT)
                    yield Figure("estimation", f"{condition}, {kind}, {estimator}: over the bound", middle, "x", note=f"{each}; {note}")
        ratios = [found[condition, *OF_THE_THESIS][n] / found[condition, *DEFAULT][n] for n in MEANT]
        gain = math.exp(2.0 * float(np.mean(np.log(ratios))))
        yield Figure("estimation", f"{condition}: machine time that the default saves", gain, "x", GAIN, note="squared ratio of the errors")
