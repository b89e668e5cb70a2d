"""Linearisation of a model: matrices of the bodies, state space, modes, sampled response, static equilibrium.

Everything comes from the effects' ``slope``s, for any number of bodies.  The thesis's closed forms for the two-mass model
(2.38) to (2.49) are in :mod:`beltcomm.model.transfer`.  Set-valued friction has slope zero while it slides and none at standstill.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm

from beltcomm.arrays import Array, ComplexArray
from beltcomm.effects import BELT_DAMPING, BELT_STIFFNESS, DRIVING_BODY, DRIVING_END, Effect, Element, Point, is_plain_belt
from beltcomm.errors import Refused, UsageError
from beltcomm.model import Model

#: Nodes of the quadrature of :func:`_equivalent_damping`; exact for a constant level, and for polynomials up to degree 31.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)

#: Eigenvalues below this fraction of the largest one are the free motion of the whole axis: rounding leaves a double zero
#: eigenvalue at the square root of the machine precision, 1.5e-8.
_FREE = 1e-6
#: s on the session clock: a law that changes with it is linearised as it is at the start.
_BEGUN_S = 0.0


@dataclass(frozen=True)
class Oscillation:
    """Sinusoidal motion around standstill for which friction is replaced by its describing function.

    Attributes
    ----------
    amplitude_rad : float, rad
        Motor angle; the other bodies are taken to follow it rigidly.
    omega_rad_s : float, rad/s
    """

    amplitude_rad: float
    omega_rad_s: float

    def __post_init__(self) -> None:
        if not (self.amplitude_rad > 0.0 and self.omega_rad_s > 0.0):
            raise UsageError(
                f"the describing function needs amplitude and frequency above zero, "
                f"not {self.amplitude_rad:g} rad at {self.omega_rad_s:g} rad/s"
            )


#: What set-valued friction at standstill is to be: an error, a body that cannot move, or its describing function.
Standstill = Literal["refuse", "stuck"] | Oscillation


@dataclass(frozen=True)
class Matrices:
    """Linear equations of motion of the free bodies:  M q'' + D q' + K q = input · torque.

    Attributes
    ----------
    bodies : tuple of str
        Names, the driven one first. q : (n,), rad at the motor shaft for rotary bodies, else m along the belt.
    M, D, K : ndarray (n, n)
        SI.
    input : ndarray (n,)
    outputs : ndarray (2, n)
        Coordinate of the driven body (motor angle), carriage in m.
    """

    bodies: tuple[str, ...]
    M: Array
    D: Array
    K: Array
    input: Array
    outputs: Array

    def hold(self, names: Sequence[str]) -> Matrices:
        """Axis with those bodies held; held at the motor, it oscillates at the motor's antiresonances."""
        free = [i for i, body in enumerate(self.bodies) if body not in names]
        square = np.ix_(free, free)
        bodies = tuple(self.bodies[i] for i in free)
        return Matrices(bodies, self.M[square], self.D[square], self.K[square], self.input[free], self.outputs[:, free])


@dataclass(frozen=True)
class StateSpace:
    """x' = A x + B u,  y = C x + D u  with u the motor torque, N m, and y = (motor angle rad, carriage position m).

    Attributes
    ----------
    A : ndarray (2n, 2n)
    B : ndarray (2n, 1)
    C : ndarray (2, 2n)
    D : ndarray (2, 1)
    states : tuple of str
        Position, velocity of each body, as (2.28).
    """

    A: Array
    B: Array
    C: Array
    D: Array
    states: tuple[str, ...]

    def response(self, freq_hz: ArrayLike) -> ComplexArray:
        """C (jω - A)⁻¹ B + D.

        Parameters
        ----------
        freq_hz : ArrayLike, (m,)
            > 0.

        Returns
        -------
        ComplexArray, (m, 2)
            Motor angle rad/(N m), carriage m/(N m).
        """
        freq = _checked_frequencies(freq_hz, math.inf)
        return _resolvent(np.asarray(2j * np.pi * freq), self.A, self.B, self.C)

    def sampled(self, freq_hz: ArrayLike, sample_period_s: float, delay_s: float = 0.0) -> ComplexArray:
        """Exact response at the sampling instants to a torque that is held from one instant to the next and acts later.

        x[k+1] = Φ x[k] + Γ_1 u[k-m] + Γ_2 u[k-m-1],   delay = m T + δ,   Φ = e^{AT},
        Γ_1 = ∫_0^{T-δ} e^{As} ds B,   Γ_2 = e^{A(T-δ)} ∫_0^δ e^{As} ds B;   H(z) = C (z - Φ)⁻¹ (Γ_1 + Γ_2/z) z^{-m}

        Parameters
        ----------
        freq_hz : ArrayLike, (m,)
            Above 0 and below the sampling frequency.
        sample_period_s : float
        delay_s : float
            From setpoint to acting torque; any number of periods.

        Returns
        -------
        ComplexArray
            (m, 2) as :meth:`response`.

        Raises
        ------
        UsageError

        References
        ----------
        Åström, Wittenmark, Computer-Controlled Systems, 3rd ed., section 2.3.
        """
        if not (sample_period_s > 0.0 and delay_s >= 0.0):
            raise UsageError(f"sampling period {sample_period_s:g} s must be above zero and delay {delay_s:g} s must not be below")
        freq = _checked_frequencies(freq_hz, 1.0 / sample_period_s)
        periods, rest = divmod(delay_s, sample_period_s)
        late, held_late = _hold(self.A, self.B, sample_period_s - rest)
        early, held_early = _hold(self.A, self.B, rest)
        z = np.exp(2j * np.pi * freq * sample_period_s)
        recent = _resolvent(z, late @ early, held_late, self.C)
        former = _resolvent(z, late @ early, late @ held_early, self.C)
        return cast(ComplexArray, (recent + former / z[:, None]) * z[:, None] ** -periods)


@dataclass(frozen=True)
class Mode:
    """One oscillating mode: undamped natural frequency and damping ratio."""

    freq_hz: float
    damping_ratio: float


def operating_point(model: Model, position_m: float, motor_speed_rad_s: float = 0.0) -> Point:
    """Point of a model.

    Parameters
    ----------
    model : Model
    position_m : float, m
        Carriage on the axis.
    motor_speed_rad_s : float
        0 means standstill.
    """
    return Point(position_m, motor_speed_rad_s, model["transmission.ratio"])


def matrices(model: Model, point: Point, standstill: Standstill = "refuse", closed: float = 1.0) -> Matrices:
    """Mass, damping and stiffness matrices at an operating point.

    K = Σ k g gᵀ,  D = Σ d g gᵀ  over the elements, with stretch = gᵀ q;  forces add -∂f/∂q to K and -∂f/∂q' to D, friction
    the slope of its level.  Left out: an element's change of stiffness with position times its static stretch.

    Parameters
    ----------
    model : Model
    point : Point
    standstill : Standstill
        What a body with set-valued friction is at speed zero: "refuse" raises Refused; "stuck" holds it (it is then not among the bodies of
        the result); an :class:`Oscillation` gives it the damping of :func:`_equivalent_damping`.
    closed : float
        Share of the time in which driving end and carriage touch: 0 in the middle of a gap.

    Raises
    ------
    Refused
        At a standstill that is to be refused.
    """
    bodies = model.bodies()
    names = tuple(body.name for _, body in bodies)
    ratio = point.transmission_m_rad
    mass = np.diag([model.driven_inertia(), *(model[name] for name, _ in bodies[1:])])
    damping, stiffness = np.zeros_like(mass), np.zeros_like(mass)
    stuck: list[str] = []
    for effect in model.effect_list():
        values = values_of(model, effect, point.position_m)
        for element in effect.elements:
            stretch = stretch_of(model, element)
            k, d = element.slope(point.position_m, *values)
            if element.ends == (DRIVING_END, "cart"):
                k, d = closed * k, closed * d
            stiffness += k * np.outer(stretch, stretch)
            damping += d * np.outer(stretch, stretch)
        if effect.slot not in ("force", "friction_level") or effect.slope is None or effect.law is None:
            continue
        i, lever = acts_on(model, effect)
        rotary = bodies[i][1].rotary and lever == 1.0
        speed = point.speed(rotary)
        if effect.slot == "force":
            position = point.position_m / ratio if rotary else point.position_m
            by_position, by_speed = cast(tuple[float, float], effect.slope(position, speed, _BEGUN_S, *values))
            stiffness[i, i] -= lever**2 * by_position
            damping[i, i] -= lever**2 * by_speed
        elif speed != 0.0:
            by_speed = cast(float, effect.slope(speed, point.position_m, _BEGUN_S, *values))
            damping[i, i] += by_speed if speed > 0.0 else -by_speed
        elif isinstance(standstill, Oscillation):
            amplitude = standstill.amplitude_rad * (1.0 if rotary else ratio)
            arguments = (point.position_m, _BEGUN_S, *values)
            damping[i, i] += _equivalent_damping(effect.law, amplitude, standstill.omega_rad_s, *arguments)
        elif effect.law(0.0, point.position_m, _BEGUN_S, *values) > 0.0:
            if standstill == "refuse":
                raise Refused(
                    f"{effect.name} has no linearisation at standstill; linearise at a speed, or ask for the body stuck, "
                    f"or for its describing function at an amplitude"
                )
            stuck.append(effect.body)
    torque = np.zeros(len(names))
    torque[0] = 1.0
    carriage = np.zeros(len(names))
    carriage[carriage_of(names)] = ratio if bodies[carriage_of(names)][1].rotary else 1.0
    return Matrices(names, mass, damping, stiffness, torque, np.vstack([torque, carriage])).hold(stuck)


def _equivalent_damping(level: Callable[..., float], amplitude: float, omega_rad_s: float, *arguments: float) -> float:
    """Damping, N m s/rad or N s/m, that dissipates as much as friction of that level in a sinusoidal motion (describing function).

    d = 4/(π A ω) ∫_0^1 level(A ω √(1 - s²)) ds,   for Coulomb friction F:  d = 4 F/(π A ω),   A the amplitude of the body, rad or m
    (Gelb, Vander Velde, Multiple-Input Describing Functions, 1968, chapter 2; s is the sine of the phase).
    """
    peak = amplitude * omega_rad_s
    speeds = peak * np.sqrt(1.0 - (0.5 * (_NODES + 1.0)) ** 2)
    mean = sum(0.5 * weight * level(speed, *arguments) for weight, speed in zip(_WEIGHTS.tolist(), speeds.tolist(), strict=True))
    return 4.0 * mean / (math.pi * peak)


def state_space(model: Model, point: Point, standstill: Standstill = "refuse") -> StateSpace:
    """State space of (2.33) to (2.37) for any number of bodies.

    Parameters
    ----------
    model : Model
        With any number of bodies.
    point : Point
    standstill : Standstill
        Set-valued friction at speed zero, see :func:`matrices`.

    Returns
    -------
    StateSpace
        Torque at the motor shaft, N m, to motor angle, rad, and carriage position, m.

    Raises
    ------
    Refused
        See :func:`matrices`.
    """
    m = matrices(model, point, standstill)
    n = len(m.bodies)
    inverse_mass = np.diag(1.0 / np.diag(m.M))
    A, B, C = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 1)), np.zeros((2, 2 * n))
    A[0::2, 1::2] = np.eye(n)
    A[1::2, 0::2] = -inverse_mass @ m.K
    A[1::2, 1::2] = -inverse_mass @ m.D
    B[1::2, 0] = inverse_mass @ m.input
    C[:, 0::2] = m.outputs
    states = tuple(f"{body}.{kind}" for body in m.bodies for kind in ("position", "velocity"))
    return StateSpace(A, B, C, np.zeros((2, 1)), states)


def sampled_response(
    model: Model,
    point: Point,
    freq_hz: ArrayLike,
    sample_period_s: float,
    standstill: Standstill = "refuse",
) -> ComplexArray:
    """Exact response of the sampled motor angle to the held torque, see :meth:`StateSpace.sampled`.

    Parameters
    ----------
    model : Model
        With any number of bodies.
    point : Point
    freq_hz : ArrayLike, (m,)
        Above 0 and below the sampling frequency.
    sample_period_s : float, s
        For which the torque is held.
    standstill : Standstill
        Set-valued friction at speed zero, see :func:`matrices`.

    Returns
    -------
    ndarray, (m,) complex
        rad/(N m), motor shaft.
    """
    return state_space(model, point, standstill).sampled(freq_hz, sample_period_s)[:, 0]


def modes(model: Model, point: Point, standstill: Standstill = "refuse", held: Sequence[str] = ()) -> tuple[Mode, ...]:
    """Oscillating modes in ascending frequency:  λ = -ζ ω ± jω √(1 - ζ²).  Overdamped and rigid-body motion is left out.

    Parameters
    ----------
    model : Model
    point : Point
    standstill : Standstill
        As of :func:`matrices`.
    held : sequence of str
        Bodies that are held; ("motor",) gives the antiresonances of the motor's response.
    """
    roots = _eigenvalues(matrices(model, point, standstill).hold(held))
    oscillating = roots[(roots.imag > 0.0) & (np.abs(roots) > _FREE * np.max(np.abs(roots), initial=0.0))]
    oscillating = oscillating[np.argsort(np.abs(oscillating))]
    return tuple(Mode(float(abs(root)) / (2.0 * math.pi), float(-root.real / abs(root))) for root in oscillating)


def fastest_rate(model: Model, point: Point) -> float:
    """Fastest rate of a model with sliding friction: what a step of integration must resolve.

    Parameters
    ----------
    model : Model
        With any number of bodies.
    point : Point
        Operating point; a standstill counts as 1 rad/s.

    Returns
    -------
    float, rad/s
        Largest |eigenvalue|.
    """
    sliding = Point(point.position_m, point.motor_speed_rad_s or 1.0, point.transmission_m_rad)
    return float(np.max(np.abs(_eigenvalues(matrices(model, sliding))), initial=0.0))


def describes(model: Model, position_m: float) -> bool:
    """True if the model means anything with the carriage there: beyond the pulleys a belt section has negative length.

    Parameters
    ----------
    model : Model
        With any number of bodies.
    position_m : float, m
        Carriage on the axis.

    Returns
    -------
    bool
        False, too, for a position that is no number.
    """
    if not math.isfinite(position_m):
        return False
    total: dict[tuple[str, str], float] = {}
    for effect in model.effect_list():
        for element in effect.elements:
            stiffness = element.slope(position_m, *values_of(model, effect, position_m))[0]
            total[element.ends] = total.get(element.ends, 0.0) + stiffness
    return all(stiffness >= 0.0 for stiffness in total.values())


def acts_on(model: Model, effect: Effect) -> tuple[int, float]:
    """Body that an effect acts on, and the lever of its law there: without a belt the carriage is the driven body itself.

    Parameters
    ----------
    model : Model
        That has the effect, or may get it.
    effect : Effect
        A force or friction.

    Returns
    -------
    tuple of int and float
        Index among the model's bodies, and lever in m/rad; 1 for the body that the effect names.
    """
    bodies = [body for _, body in model.bodies()]
    names = [body.name for body in bodies]
    if effect.body in names:
        return names.index(effect.body), 1.0
    return 0, model["transmission.ratio"] if bodies[0].rotary else 1.0


def values_of(model: Model, effect: Effect, position_m: float) -> list[float]:
    """Values of an effect's own parameters and of those it uses, as its law wants them.

    Parameters
    ----------
    model : Model
        That has the effect.
    effect : Effect
        Whose law is asked.
    position_m : float, m
        Carriage, for laws that use the belt's stiffness or damping.

    Returns
    -------
    list of float
        In the order of the law's arguments.
    """
    values = []
    for name in (*effect.full_names(), *effect.uses):
        if name in (BELT_STIFFNESS, BELT_DAMPING):
            values.append(belt_at(model, position_m)[0 if name == BELT_STIFFNESS else 1])
        else:
            values.append(model[name])
    return values


def belt_at(model: Model, position_m: float) -> tuple[float, float]:
    """Stiffness and damping of the belt at a place, before other effects change them.

    Parameters
    ----------
    model : Model
        Without a belt both are 0.
    position_m : float, m
        Carriage on the axis.

    Returns
    -------
    tuple of float
        N/m and N s/m.
    """
    plain = [effect for effect in model.effect_list() if is_plain_belt(effect)]
    slopes = [effect.elements[0].slope(position_m, *values_of(model, effect, position_m)) for effect in plain]
    return sum(k for k, _ in slopes), sum(d for _, d in slopes)


def carriage_of(names: Sequence[str]) -> int:
    """Index of the body whose belt coordinate is the carriage position.

    Parameters
    ----------
    names : sequence of str
        Bodies of a model.

    Returns
    -------
    int
        0, the driven body, without a carriage.
    """
    return names.index("cart") if "cart" in names else 0


def stretch_of(model: Model, element: Element) -> Array:
    """Row of an element: its stretch is gᵀ q.

    Parameters
    ----------
    model : Model
        With the bodies at both ends.
    element : Element
        Between two bodies.

    Returns
    -------
    ndarray, (n,)
        g, 1 or m/rad for each body.
    """
    bodies = [body for _, body in model.bodies()]
    names = [body.name for body in bodies]
    result = np.zeros(len(names))
    for end, sign in zip(element.ends, (1.0, -1.0), strict=True):
        driving = DRIVING_BODY if DRIVING_BODY in names else names[0]
        i = names.index(driving if end == DRIVING_END else end)
        result[i] = sign * (model["transmission.ratio"] if bodies[i].rotary and not element.angular else 1.0)
    return result


def _eigenvalues(m: Matrices) -> ComplexArray:
    """Eigenvalues in mass-normalised coordinates, where K and D are symmetric and rounding is smallest."""
    n = len(m.bodies)
    scale = 1.0 / np.sqrt(np.diag(m.M))
    A = np.zeros((2 * n, 2 * n))
    A[:n, n:] = np.eye(n)
    A[n:, :n] = -m.K * np.outer(scale, scale)
    A[n:, n:] = -m.D * np.outer(scale, scale)
    return np.linalg.eigvals(A).astype(np.complex128)


def _hold(A: Array, B: Array, duration_s: float) -> tuple[Array, Array]:
    """e^{At} and ∫_0^t e^{As} ds B from one matrix exponential (Van Loan, IEEE Trans. Autom. Control 23 (1978) 395)."""
    n = A.shape[0]
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n:] = A, B
    exponential = expm(block * duration_s)
    return exponential[:n, :n], exponential[:n, n:]


def _resolvent(z: ComplexArray, A: Array, B: Array, C: Array) -> ComplexArray:
    """C (z - A)⁻¹ B for many z: (m, outputs)."""
    n = A.shape[0]
    states = np.linalg.solve(z[:, None, None] * np.eye(n) - A, np.broadcast_to(B, (z.size, n, 1)))
    return cast(ComplexArray, (C @ states)[:, :, 0])


def _checked_frequencies(freq_hz: ArrayLike, below: float) -> Array:
    freq = np.atleast_1d(np.asarray(freq_hz, dtype=float))
    if freq.ndim != 1 or not np.all((freq > 0.0) & (freq < below)):
        limit = "" if math.isinf(below) else f" and below the sampling frequency of {below:g} Hz"
        raise UsageError(f"frequencies must be above 0 Hz{limit}, not {np.min(freq):g}..{np.max(freq):g} Hz")
    return freq
