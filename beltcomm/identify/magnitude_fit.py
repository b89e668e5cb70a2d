"""The thesis's parameter fit: log-magnitude least squares of the two-mass response (2.42), and with three masses over all responses
at once, friction as damping (3.32) to (3.34).

For the picture, the start values and chapter 3's figures.  Its parameters are **biased by friction**: the response of an
axis around standstill takes Coulomb friction for damping and moves mass and stiffness too (thesis.md, errata 7 and 14).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.optimize import least_squares, minimize
from scipy.special import stdtrit

from beltcomm.arrays import Array, BoolArray, ComplexArray, decibels, rms
from beltcomm.axis import Axis
from beltcomm.errors import DataError, UsageError
from beltcomm.model import Model, build_model
from beltcomm.model.linear import operating_point, sampled_response
from beltcomm.model.transfer import TwoMass
from beltcomm.model.value import Value
from beltcomm.response import FrequencyResponse, log_spaced_lines

Solver = Literal["lm", "trf", "nelder-mead"]

#: Said with every result.
FRICTION_BIAS = (
    "biased by friction: around standstill Coulomb friction poses as damping and moves mass and stiffness; "
    "use these values as a start and for the picture, not for the design"
)
#: (unit, side, low, high) of each parameter.  0.01 N s/m is the thesis's own lower bound of damping (table A.5).
PARAMETERS: Mapping[str, tuple[str, str, float, float]] = {
    "mass_kg": ("kg", "cart", 1e-3, 1e4),
    "stiffness_n_m": ("N/m", "belt", 1e3, 1e8),
    "motor_damping_n_s_m": ("N s/m", "belt", 0.01, 1e5),
    "cart_damping_n_s_m": ("N s/m", "belt", 0.01, 1e5),
    "inertia_kg_m2": ("kg m2", "motor", 1e-8, 10.0),
}
#: Highest frequency over sampling frequency.  There the hold, which a continuous model lacks, has taken 0.7 dB ...
HIGHEST_CONTINUOUS = 0.2
#: ... and here the first image of the spectrum is nearly as strong as what is measured.
HIGHEST_SAMPLED = 0.45
#: A line whose noise is above this part of |h| says little about log |h|.
LARGEST_NOISE = 0.5
#: Lines that are fitted at most.
MOST_LINES = 100
#: Grid points that are refined, and lines by which they are chosen: figure 3.9 shows the thesis's own 30.
N_STARTS = 3
N_START_LINES = 30


@dataclass(frozen=True, eq=False)
class MagnitudeFit:
    """Parameters of (2.42) that explain a measured magnitude.

    Attributes
    ----------
    parameters : dict of str to Value
        By field name of :class:`TwoMass`; ``interval`` is the half width at 95 %, inflated by the misfit, infinite when the record does not
        determine it, None when it was given.
    names : tuple of str
        Those that were fitted, in order.
    correlation : ndarray (p, p)
        In that order.
    freq_hz : ndarray (n,), Hz
        The lines used.
    residual_db : ndarray (n,), dB
        Measured minus model.
    noise_db : float, dB
        rms that noise alone would leave.
    transmission_m_rad : float
        i_t.
    remarks : tuple of str
        Sentences on bias, bounds, and what this record cannot determine.
    """

    parameters: Mapping[str, Value]
    names: tuple[str, ...]
    correlation: Array
    freq_hz: Array
    residual_db: Array
    noise_db: float
    transmission_m_rad: float
    solver: Solver
    remarks: tuple[str, ...]

    @property
    def rms_db(self) -> float:
        """Root mean square of the residual, dB."""
        return rms(self.residual_db)

    @property
    def two_mass(self) -> TwoMass:
        """The fitted two-mass model, belt damping zero."""
        values = {name: item.value for name, item in self.parameters.items()}
        return TwoMass(**values, belt_damping_n_s_m=0.0, transmission_m_rad=self.transmission_m_rad)


def _product_form(freq_hz: Array, theta: Mapping[str, Array | float], transmission_m_rad: float) -> ComplexArray:
    """Torque to motor angle (2.42), errata 1 and 2, rad/(N m), for any number of parameter sets at once.

    G = 1/(s² (Θ_e + i_t² m_c) + s i_t² (d_m + d_c)) · (m_c s² + d_c s + c)/(μ s² + δ s + c)
    μ = Θ_e m_c/(Θ_e + i_t² m_c),   δ = (i_t² m_c d_m + Θ_e d_c)/(Θ_e + i_t² m_c)

    ``theta`` by the names of :data:`PARAMETERS`, in shapes that broadcast with the frequencies, (n,); d_m and d_c in N s/m at the belt.
    """
    s = 2j * np.pi * freq_hz
    total, rigid_damping, mu, delta = _combined_coefficients(theta, transmission_m_rad)
    c, d_c, m_c = theta["stiffness_n_m"], theta["cart_damping_n_s_m"], theta["mass_kg"]
    rigid = s * (s * total + rigid_damping)
    return np.asarray((m_c * s**2 + d_c * s + c) / (rigid * (mu * s**2 + delta * s + c)), dtype=np.complex128)


def fit_magnitude(
    response: FrequencyResponse,
    transmission_m_rad: float,
    inertia_kg_m2: float | None,
    *,
    solver: Solver = "lm",
) -> MagnitudeFit:
    """Fit p = [m_c, c, d_m, d_c] of (2.42), and Θ_e where it is not known, to the magnitude of a response.

    J(p) = Σ (20 lg |Ĝ(f_i)| - 20 lg |G(f_i; p)|)²  →  min      over a nearly log-spaced subset of lines up to 0.2/T_s

    Start values come from a grid over antiresonance, resonance and damping; the best three are refined.  Intervals are
    those of the linearised problem with the variance J*/(n - p), so a misfit widens them.

    Parameters
    ----------
    response : FrequencyResponse, rad/(N m), motor shaft
        Torque to motor angle.
    transmission_m_rad : float
        i_t = r/i_g, m/rad.
    inertia_kg_m2 : float or None
        Θ_e at the motor shaft, kg m²; None fits it too.
    solver : Solver
        "lm" Levenberg-Marquardt (bounds by a sine transform), "trf" trust region reflective, "nelder-mead".

    Raises
    ------
    DataError
        When too few lines are left.
    UsageError
        For numbers that cannot be meant.

    References
    ----------
    Thesis (3.32) to (3.34), figure 3.9.
    """
    if not transmission_m_rad > 0 or (inertia_kg_m2 is not None and not inertia_kg_m2 > 0):
        raise UsageError(f"i_t = {transmission_m_rad} m/rad and Θ_e = {inertia_kg_m2} kg m² must be positive")
    if solver not in ("lm", "trf", "nelder-mead"):
        raise UsageError(f"solver {solver!r} is not known; choose lm, trf or nelder-mead")
    chosen = _chosen_lines(response, MOST_LINES, HIGHEST_CONTINUOUS)
    measured_db = decibels(chosen.h)
    few = log_spaced_lines(chosen.freq_hz, N_START_LINES, 0.0, HIGHEST_CONTINUOUS / response.sample_period_s)
    starts = _start_values(chosen.freq_hz[few], measured_db[few], transmission_m_rad, inertia_kg_m2)

    names = tuple(name for name in PARAMETERS if name != "inertia_kg_m2" or inertia_kg_m2 is None)
    given = {} if inertia_kg_m2 is None else {"inertia_kg_m2": inertia_kg_m2}

    def residual_db(theta: Mapping[str, float]) -> Array:
        return measured_db - decibels(_product_form(chosen.freq_hz, {**given, **theta}, transmission_m_rad))

    problems = [_Problem(names, start, residual_db) for start in starts]
    fits = [problem.solve(solver) for problem in problems]
    best = int(np.argmin([np.sum(p.residual(x) ** 2) for p, (x, _) in zip(problems, fits, strict=True)]))
    problem, (x, converged) = problems[best], fits[best]
    residual = problem.residual(x)
    theta = problem.theta(x)
    half, at_bound, correlation = problem.uncertainty(x, residual)
    width = dict(zip(names, half.tolist(), strict=True))
    parameters = {
        name: Value({**given, **theta}[name], *description, width.get(name), "magnitude fit" if name in theta else "given")
        for name, description in PARAMETERS.items()
    }
    noise_db = float(np.sqrt(np.mean((20 / np.log(10) * chosen.noise / np.abs(chosen.h)) ** 2 / 2)))
    fit = MagnitudeFit(parameters, names, correlation, chosen.freq_hz, residual, noise_db, transmission_m_rad, solver, ())
    return replace(fit, remarks=_remarks(fit, at_bound, converged))


class _Problem:
    """The least squares problem in coordinates of order one: ln m_c, ln c, ln Θ_e, and damping over its natural scale."""

    def __init__(self, names: tuple[str, ...], start: Mapping[str, float], residual_db: Callable[[Mapping[str, float]], Array]) -> None:
        self.names = names
        self._residual_db = residual_db
        self._is_log = np.array(["damping" not in name for name in names])
        self._scale = 0.1 * float(np.sqrt(start["mass_kg"] * start["stiffness_n_m"]))  # damping ratio 0.05
        self.low = self._coordinates([PARAMETERS[name][2] for name in names])
        self.high = self._coordinates([PARAMETERS[name][3] for name in names])
        self.start = np.clip(self._coordinates([start[name] for name in names]), self.low + 1e-6, self.high - 1e-6)

    def _coordinates(self, values: list[float]) -> Array:
        return np.where(self._is_log, np.log(values), np.array(values) / self._scale)

    def values(self, x: Array) -> Array:
        """Parameters in SI."""
        return np.where(self._is_log, np.exp(np.where(self._is_log, x, 0.0)), x * self._scale)

    def theta(self, x: Array) -> dict[str, float]:
        """Parameters in SI by name."""
        return {name: float(v) for name, v in zip(self.names, self.values(x), strict=True)}

    def residual(self, x: Array) -> Array:
        return self._residual_db(self.theta(x))

    def solve(self, solver: Solver) -> tuple[Array, bool]:
        """Minimum within the bounds, and whether the solver says that it got there."""
        if solver == "trf":
            found = least_squares(self.residual, self.start, bounds=(self.low, self.high), method="trf", xtol=1e-12, ftol=1e-12, gtol=1e-12)
            return np.asarray(found.x, dtype=np.float64), bool(found.success)
        # x = low + (high - low)(1 + sin q)/2 keeps a solver without bounds inside them.
        q = np.arcsin(2.0 * (self.start - self.low) / (self.high - self.low) - 1.0)
        if solver == "lm":
            found = least_squares(self._residual_inside, q, method="lm", xtol=1e-12, ftol=1e-12, gtol=1e-12)
            return self._inside(found.x), bool(found.success)
        success = False
        for _ in range(3):  # a simplex that has collapsed early gets going again when it is spread anew
            simplex = minimize(self._cost_inside, q, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12, "maxfev": 4000})
            q, success = np.asarray(simplex.x, dtype=np.float64), bool(simplex.success)
        return self._inside(q), success

    def _residual_inside(self, q: Array) -> Array:
        return self.residual(self._inside(q))

    def _cost_inside(self, q: Array) -> float:
        return float(np.sum(self._residual_inside(q) ** 2))

    def _inside(self, q: Array) -> Array:
        return np.asarray(self.low + (self.high - self.low) * 0.5 * (1.0 + np.sin(q)), dtype=np.float64)

    def uncertainty(self, x: Array, residual: Array) -> tuple[Array, BoolArray, Array]:
        """Half widths of the 95 % intervals in SI, which parameters are at a bound, and correlations.

        The others' intervals hold with those at a bound kept there.
        """
        step = 1e-5
        columns = []
        for k in range(len(x)):
            shift = np.zeros(len(x))
            shift[k] = step
            columns.append((self.residual(x + shift) - self.residual(x - shift)) / (2 * step))
        jacobian = np.array(columns).T
        freedom = len(residual) - len(x)
        spread = float(np.sqrt(np.sum(residual**2) / freedom)) * float(stdtrit(freedom, 0.975))
        all_free, correlation = _inverse(jacobian)
        half = spread * all_free
        gap = np.minimum(x - self.low, self.high - x)
        at_bound = gap <= np.maximum(1e-2 * np.where(np.isfinite(half), half, 0.0), 1e-6)
        if at_bound.any() and not at_bound.all():
            half[~at_bound] = spread * _inverse(jacobian[:, ~at_bound])[0]
        to_si = np.where(self._is_log, self.values(x), self._scale)
        return half * to_si, at_bound, correlation


def _inverse(jacobian: Array) -> tuple[Array, Array]:
    """√diag and correlation of (JᵀJ)^-1; infinite along directions that the data do not see."""
    norm = np.linalg.norm(jacobian, axis=0)
    seen = norm > 0
    deviation, correlation = np.full(len(norm), np.inf), np.eye(len(norm))
    _, singular, vt = np.linalg.svd(jacobian[:, seen] / norm[seen], full_matrices=False)
    # A direction weaker than this is rounding of the difference quotients.
    weak = singular < 1e-8 * singular[0]
    covariance = (vt[~weak].T / singular[~weak] ** 2) @ vt[~weak]
    part = np.sqrt(np.diag(covariance))
    correlation[np.ix_(seen, seen)] = covariance / np.outer(part, part)
    touched = np.abs(vt[weak]).max(axis=0, initial=0.0) > 1e-3
    deviation[seen] = np.where(touched, np.inf, part / norm[seen])
    return deviation, correlation


def _combined_coefficients(theta: Mapping[str, Array | float], transmission_m_rad: float) -> tuple[Array | float, ...]:
    """Θ_e + i_t² m_c, i_t² (d_m + d_c), μ and δ of (2.42)."""
    i2, inertia, m_c = transmission_m_rad**2, theta["inertia_kg_m2"], theta["mass_kg"]
    d_m, d_c = theta["motor_damping_n_s_m"], theta["cart_damping_n_s_m"]
    total = inertia + i2 * m_c
    return total, i2 * (d_m + d_c), inertia * m_c / total, (i2 * m_c * d_m + inertia * d_c) / total


def _chosen_lines(response: FrequencyResponse, n_lines: int, highest_share: float) -> FrequencyResponse:
    """Lines up to a share of the sampling frequency that are not noise, thinned to a nearly log-spaced subset of at most ``n_lines``.

    Raises DataError when too few are left.
    """
    highest_hz = highest_share / response.sample_period_s
    clear = np.flatnonzero((np.abs(response.h) > 0) & (response.noise <= LARGEST_NOISE * np.abs(response.h)))
    clear = clear[response.freq_hz[clear] <= highest_hz]
    fewest = 2 * len(PARAMETERS)
    if len(clear) < fewest:
        raise DataError(
            f"{len(clear)} lines with noise below {LARGEST_NOISE:.0%} of the response lie between 0 and "
            f"{highest_hz:.4g} Hz, {fewest} are needed; raise the amplitude, repeat more periods or lengthen the period"
        )
    return response.lines(clear[log_spaced_lines(response.freq_hz[clear], n_lines, 0.0, highest_hz)])


def _start_values(freq_hz: Array, measured_db: Array, transmission_m_rad: float, inertia_kg_m2: float | None) -> list[dict[str, float]]:
    """The best few points of a grid over f_z, f_r/f_z and both dampings, by the cost (3.33).

    Source: (2.45), (2.47): m_c = κ Θ_e/i_t², c = m_c ω_z², κ = (f_r/f_z)² - 1; a free Θ_e follows from the mean level.
    """
    # Up to ten times the highest line: an axis that shows no antiresonance looks rigid, not soft.
    f_z = np.geomspace(freq_hz[0], 10.0 * freq_hz[-1], 36).reshape(-1, 1, 1, 1, 1)
    ratio = np.geomspace(1.05, 15.0, 20).reshape(-1, 1, 1, 1)
    damping_ratio = np.array([0.01, 0.05, 0.2]).reshape(-1, 1, 1)
    motor_share = np.array([0.01, 0.2, 2.0]).reshape(-1, 1)
    inertia = 1e-4 if inertia_kg_m2 is None else inertia_kg_m2
    kappa = ratio**2 - 1.0
    mass = kappa * inertia / transmission_m_rad**2 + 0.0 * f_z
    stiffness = mass * (2 * np.pi * f_z) ** 2
    d_c = 2.0 * damping_ratio * np.sqrt(mass * stiffness)
    grid = {
        "mass_kg": mass,
        "stiffness_n_m": stiffness,
        "motor_damping_n_s_m": motor_share * d_c,
        "cart_damping_n_s_m": d_c + 0.0 * motor_share,
        "inertia_kg_m2": np.full_like(mass, inertia),
    }
    difference = measured_db - decibels(_product_form(freq_hz, grid, transmission_m_rad))
    level_db = difference.mean(axis=-1, keepdims=True) if inertia_kg_m2 is None else np.zeros((*difference.shape[:-1], 1))
    cost = np.sum((difference - level_db) ** 2, axis=-1)
    starts: list[dict[str, float]] = []
    taken: list[tuple[int, ...]] = []
    for flat in np.argsort(cost, axis=None):
        at = tuple(int(i) for i in np.unravel_index(flat, cost.shape))
        # Neighbours of a start already taken would end where it ends.
        if any(abs(at[0] - other[0]) <= 2 and abs(at[1] - other[1]) <= 2 for other in taken):
            continue
        taken.append(at)
        # All of Θ_e, m_c, c, d_m, d_c scale together with the level of the response and leave its shape.
        scale = 10.0 ** (-float(level_db[at][0]) / 20.0)
        starts.append({name: scale * float(np.broadcast_to(v, (*cost.shape, 1))[at][0]) for name, v in grid.items()})
        if len(starts) == N_STARTS:
            break
    return starts


def _remarks(fit: MagnitudeFit, at_bound: BoolArray, converged: bool) -> tuple[str, ...]:
    """Bias, convergence, misfit, bounds and what cannot be determined, in words."""
    remarks = [FRICTION_BIAS]
    lowest_hz, highest_hz = float(fit.freq_hz[0]), float(fit.freq_hz[-1])
    if not converged:
        remarks.append(f"the solver {fit.solver} stopped before it converged; try another one")
    if fit.rms_db > 2.0 * fit.noise_db:
        remarks.append(
            f"the model misses the response by {fit.rms_db:.2g} dB, noise explains {fit.noise_db:.2g} dB: friction, another "
            "effect, or damping too strong for the approximation (2.42); the intervals are wider for it but do not contain the bias"
        )
    for name, bound in zip(fit.names, at_bound, strict=True):
        item = fit.parameters[name]
        width = item.interval if item.interval is not None else np.inf
        if bound:
            edge = item.low if item.value - item.low < item.high - item.value else item.high
            remarks.append(f"{name} lies at its bound {edge:g} {item.unit} and is not determined by this record (95 %: ± {width:.2g})")
        elif width >= item.value:
            remarks.append(f"{name} is not determined by this record: {item.value:.3g} ± {width:.2g} {item.unit}")
    model = fit.two_mass
    at_resonance = "motor_damping_n_s_m" if "inertia_kg_m2" not in fit.names else "inertia_kg_m2"
    for word, at_hz, name in (
        ("antiresonance", model.antiresonance_hz, "stiffness_n_m"),
        ("resonance", model.resonance_hz, at_resonance),
    ):
        if not lowest_hz < at_hz < highest_hz:
            remarks.append(
                f"the {word} of the fit, {at_hz:.4g} Hz, lies outside the lines used ({lowest_hz:.3g} to {highest_hz:.4g} Hz): "
                f"{name} is a guess whatever its interval says; measure up to there"
            )
    return tuple(remarks)


#: Fitted in logarithms, which keeps them positive.
FREE = (
    "cart.mass",
    "end_pulley.mass",
    "belt_sections.specific_stiffness",
    "belt_sections.specific_damping",
    "viscous.damping",
    "viscous_cart.damping",
)
#: What stands for Coulomb friction around standstill at first, N m s/rad and N s/m.
START_DAMPING = {"viscous.damping": 0.02, "viscous_cart.damping": 10.0}
#: Lowest value of a logarithm's argument, over its start; lines of one response; N m s/rad, losses of a coupling.
FLOOR, LINES, COUPLING_DAMPING = 1e-4, 60, 1e-3
#: Relative change of the cost, or of the logarithms, that is not worth another step; decibels are known to some hundredths.
ENOUGH = 1e-5


@dataclass(frozen=True)
class ThreeMassMagnitude:
    """Log-magnitude fit of three masses.

    Attributes
    ----------
    parameters : dict of str to Value
        By name, with 95 % intervals of the linearised problem, as wide as the misfit asks.
    rms_db : float
        Of what is left, dB.
    coupled : bool
        The coupling counts as a spring, from the data sheet.
    """

    parameters: Mapping[str, Value]
    rms_db: float
    coupled: bool


def fit_magnitudes(
    responses: Mapping[str, FrequencyResponse], places_m: Mapping[str, float], start: Model, axis: Axis
) -> ThreeMassMagnitude | None:
    """The better of the three-mass model with a rigid coupling and, where the data sheet knows its stiffness, with that one; None
    without a response.

    J = Σ (20 lg |Ĝ(f_i)| - 20 lg |G(f_i)|)²   with G sampled exactly at each place, Θ_e and the belt's geometry given

    Parameters
    ----------
    responses : mapping of str to FrequencyResponse, rad/(N m), motor shaft
        By record.
    places_m : dict of str to float
        Of the responses, m.
    start : Model
        Three-mass model; its Coulomb friction is left out.
    axis : Axis
    """
    chosen = {name: _chosen_lines(r, LINES, HIGHEST_SAMPLED) for name, r in responses.items()}
    if not chosen:
        return None
    models = [_linear_model(start, axis)]
    if axis.coupling.stiffness_nm_rad is not None:
        models.append(_with_coupling(models[0], axis))
    return min((_fitted(chosen, places_m, model) for model in models), key=lambda fit: fit.rms_db)


def _linear_model(model: Model, axis: Axis) -> Model:
    """The model with viscous friction alone, at values that Coulomb friction poses as around standstill."""
    values = {name: model[name] for name in model.parameters if name.partition(".")[0] not in ("coulomb", "cart_friction")}
    values |= {"belt_sections.offset": axis.travel.driven_side_offset_m, **START_DAMPING}
    effects = [e for e in model.effects if e not in ("coulomb", "cart_friction")]
    return build_model(model.name, effects, values, origin="log-magnitude fit")


def _with_coupling(model: Model, axis: Axis) -> Model:
    """The model with the data sheet's coupling as a spring at the motor shaft: half of it turns with the motor, half with the pulley.

    Inertias of coupling, pulley and gearbox are the axis's; that of motor and pulley together stays.
    """
    behind = ((axis.get("pulley.inertia_kg_m2") or 0.0) + axis.gearbox.inertia_kg_m2) / axis.gearbox.ratio**2
    behind += 0.5 * axis.coupling.inertia_kg_m2
    values = {"stiffness": float(axis.coupling.stiffness_nm_rad or 0.0), "damping": COUPLING_DAMPING, "driving_pulley.inertia": behind}
    coupled = model.with_effect("coupling", {**values, "inertia": behind}, "data sheet")
    return coupled.with_values({"motor.inertia": axis.motor_side_inertia_kg_m2 - behind}, "data sheet")


def _fitted(chosen: Mapping[str, FrequencyResponse], places_m: Mapping[str, float], start: Model) -> ThreeMassMagnitude:
    points = {name: operating_point(start, places_m[name], 1.0) for name in chosen}
    measured = {name: decibels(r.h) for name, r in chosen.items()}
    begin = np.array([start[name] for name in FREE])
    limits = [start.parameters[name] for name in FREE]
    low = np.log([max(v.low, FLOOR * b) for v, b in zip(limits, begin, strict=True)])
    high = np.log([v.high for v in limits])

    def residual(logarithms: Array) -> Array:
        model = start.with_values(dict(zip(FREE, np.exp(logarithms).tolist(), strict=True)))
        parts = []
        for name, response in chosen.items():
            h = sampled_response(model, points[name], response.freq_hz, response.sample_period_s)
            parts.append(measured[name] - decibels(h))
        return np.concatenate(parts)

    edge = 1e-9 * (high - low)
    found = least_squares(
        residual, np.clip(np.log(begin), low + edge, high - edge), bounds=(low + edge, high - edge), x_scale="jac", ftol=ENOUGH, xtol=ENOUGH
    )
    freedom = len(found.fun) - len(FREE)
    variance = float(np.sum(found.fun**2)) / freedom
    jacobian = np.asarray(found.jac, dtype=np.float64)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * variance
    values = np.exp(found.x)
    half = float(stdtrit(freedom, 0.975)) * np.sqrt(np.diag(covariance)) * values
    parameters = {
        name: Value(float(value), item.unit, item.side, item.low, item.high, float(width), "log-magnitude fit")
        for name, value, width, item in zip(FREE, values, half, limits, strict=True)
    }
    return ThreeMassMagnitude(parameters, rms(found.fun), "coupling" in start.effects)
