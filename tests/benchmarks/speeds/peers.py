"""The same records with the tools that people have today: errors of antiresonance, resonance and carriage mass, and processor time.

Records: the rig g_b, 7 s of PRBS, as in `estimation`, no period of it quite as the one before, from seeds that no limit was set on;
every tool is told period, ratio and sampling, and the motor's inertia where it cannot find it itself.
The others get what a careful user would do with them: H1 from velocity over torque by ``scipy.signal``
(Welch, Hann, 1024 samples, half overlapping), its extremes and its low-frequency slope; the two-mass response fitted to it by
``scipy.optimize``; an ARX model of order 4 by least squares, on the record as it is and filtered to the band of interest; python-control's
Markov parameters with the eigensystem realization.  Errors are rms over the seeds, in percent.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp
from scipy.optimize import least_squares

from beltcomm.model import Model
from beltcomm.model.linear import modes, operating_point
from beltcomm.recording import Recording
from beltcomm.thesis.excitations import PERIOD_S, PLACE_M, _make_recording
from benchmarks.speeds.estimation import axis, by_complex, by_inverse, by_thesis, given, rms, signal_of
from benchmarks.speeds.measure import Figure, spread

Array = NDArray[np.float64]
#: Hz; where a user looks for the two extremes, and where the axis still moves as one.
LOOK_HZ, RIGID_HZ = (40.0, 250.0), (8.0, 30.0)
#: Seed of the first record.
FIRST = 501


class Found(dict[str, float]):
    """``antiresonance``, ``resonance`` in Hz and ``mass`` in kg, nan where a tool gives none."""


def marks(mass: float, stiffness: float, inertia: float, ratio: float) -> Found:
    """Both frequencies of two masses from their values."""
    low = math.sqrt(stiffness / mass)
    high = math.sqrt(stiffness * (1.0 / mass + ratio**2 / inertia))
    return Found(antiresonance=low / (2.0 * math.pi), resonance=high / (2.0 * math.pi), mass=mass)


def true_marks(model: Model) -> Found:
    """Those of the plant."""
    at = operating_point(model, PLACE_M, 1.0)
    low, high = (min(m.freq_hz for m in modes(model, at, held=held)) for held in (("motor",), ()))
    return Found(antiresonance=low, resonance=high, mass=model["cart.mass"])


def _velocity_response(record: Recording) -> tuple[Array, NDArray[np.complex128], Array]:
    """H1 from torque to motor speed and its coherence; the speed is the difference of two angles, half a period late, like the hold."""
    speed = np.diff(record.position) / PERIOD_S
    torque = record.torque[:-1]
    freq, cross = dsp.csd(torque, speed, 1.0 / PERIOD_S, nperseg=1024)
    _, power = dsp.welch(torque, 1.0 / PERIOD_S, nperseg=1024)
    _, coherence = dsp.coherence(torque, speed, 1.0 / PERIOD_S, nperseg=1024)
    return freq, cross / power, coherence


def welch(record: Recording, model: Model) -> Found:
    """Extremes of |H1|, the mass from its slope where the axis moves as one, the motor's inertia from the data sheet."""
    freq, h, _ = _velocity_response(record)
    look = (freq > LOOK_HZ[0]) & (freq < LOOK_HZ[1])
    magnitude, f = np.abs(h[look]), freq[look]
    low = int(np.argmin(magnitude[f < 160.0]))
    high = low + int(np.argmax(magnitude[low:]))
    rigid = (freq > RIGID_HZ[0]) & (freq < RIGID_HZ[1])
    total = float(np.median(np.imag(1.0 / h[rigid]) / (2.0 * np.pi * freq[rigid])))
    return Found(
        antiresonance=float(f[low]), resonance=float(f[high]), mass=(total - model["motor.inertia"]) / model["transmission.ratio"] ** 2
    )


def fitted(record: Recording, model: Model) -> Found:
    """Two masses with damping fitted to H1, weighted with the coherence."""
    freq, h, coherence = _velocity_response(record)
    lines = (freq > 3.0) & (freq < 300.0)
    s, measured = 2j * np.pi * freq[lines], h[lines]
    weight = np.sqrt(coherence[lines] / np.maximum(1.0 - coherence[lines], 1e-6)) / np.abs(measured)
    ratio = model["transmission.ratio"]

    def answer(x: Array) -> NDArray[np.complex128]:
        mass, stiffness, inertia, damping, viscous = np.exp(x)
        belt = damping * s + stiffness
        load = ratio**2 * belt * mass * s**2 / (mass * s**2 + belt)
        hold = (1.0 - np.exp(-s * PERIOD_S)) / (s * PERIOD_S)  # of the torque; the difference of two angles averages once more
        late = hold * hold * np.exp(s * PERIOD_S)
        return np.asarray(s / (inertia * s**2 + viscous * s + load) * late)

    def residual(x: Array) -> Array:
        left = weight * (measured - answer(x))
        return np.concatenate([left.real, left.imag])

    begin = np.log([1.2 * model["cart.mass"], 0.85 * model["belt_stiffness.stiffness"], model["motor.inertia"], 30.0, 3e-3])
    mass, stiffness, inertia, _, _ = np.exp(least_squares(residual, begin, x_scale=0.1, bounds=(begin - 3.0, begin + 3.0)).x)
    return marks(float(mass), float(stiffness), float(inertia), ratio)


def _of_roots(poles: NDArray[np.complex128], zeros: NDArray[np.complex128]) -> Found:
    """Frequencies of the best damped pair of roots in z within the look-out; mass cannot be told without more."""

    def hz(roots: NDArray[np.complex128]) -> float:
        roots = roots[np.abs(roots) > 1e-9]
        s = np.log(roots.astype(complex)) / PERIOD_S
        f = np.abs(s) / (2.0 * np.pi)
        good = (f > LOOK_HZ[0]) & (f < LOOK_HZ[1]) & (s.imag > 0.0)
        return float(f[good][np.argmin(np.abs(s.real[good]))]) if good.any() else math.nan

    return Found(antiresonance=hz(zeros), resonance=hz(poles), mass=math.nan)


def arx(record: Recording, _model: Model, prefilter: bool = False) -> Found:
    """y_k = Σ a_i y_(k-i) + Σ b_i u_(k-i), order 4, speed over torque."""
    y, u = np.diff(record.position) / PERIOD_S, record.torque[:-1]
    if prefilter:
        sections = dsp.butter(2, [10.0, 250.0], "bandpass", fs=1.0 / PERIOD_S, output="sos")
        y, u = dsp.sosfilt(sections, y), dsp.sosfilt(sections, u)
    n = 4
    past = [y[n - i - 1 : len(y) - i - 1] for i in range(n)] + [u[n - i : len(u) - i] for i in range(n + 1)]
    x = np.linalg.lstsq(np.column_stack(past), y[n:], rcond=None)[0]
    return _of_roots(np.roots(np.concatenate([[1.0], -x[:n]])), np.roots(x[n:]))


def realization(record: Recording, _model: Model) -> Found:
    """python-control: Markov parameters by least squares, then the eigensystem realization of order 4."""
    import control

    y, u = np.diff(record.position) / PERIOD_S, record.torque[:-1]
    impulse = control.markov(y[None, :], u[None, :], m=400, dt=PERIOD_S)
    system, _ = control.eigensys_realization(np.asarray(impulse).reshape(1, 1, -1), r=4, dt=PERIOD_S)
    return _of_roots(np.asarray(system.poles()), np.asarray(system.zeros()))


def _from(errors: Mapping[str, float], model: Model) -> Found:
    """What an estimator of this project found, from its relative errors."""
    values = {name: model[name] * (1.0 + errors[name]) for name in ("cart.mass", "belt_stiffness.stiffness", "motor.inertia")}
    return marks(*values.values(), model["transmission.ratio"])


TOOLS: Mapping[str, Callable[[Recording, Model], Found]] = {
    "beltcomm, final fit": lambda record, model: _from(by_inverse(record, model), model),
    "beltcomm, magnitude fit of the thesis": lambda record, model: _from(by_thesis(record, model), model),
    "beltcomm's response, complex fit by scipy": lambda record, model: _from(by_complex(record, model), model),
    "scipy.signal, Welch and its extremes": welch,
    "scipy.signal and scipy.optimize, two masses": fitted,
    "ARX of order 4, least squares": arx,
    "ARX of order 4, 10 to 250 Hz": lambda record, model: arx(record, model, prefilter=True),
    "python-control, markov and ERA": realization,
}


def run(draws: int) -> Iterator[Figure]:
    """All figures of the topic."""
    for condition in ("linear", "friction"):
        model = axis(condition)
        signal, true = signal_of(model, "prbs"), true_marks(model)
        records = [_make_recording(model, given(signal, seed), seed) for seed in range(FIRST, FIRST + draws)]
        for name, tool in TOOLS.items():
            if "python-control" in name and find_spec("control") is None:
                continue
            tool(records[0], model)  # compiled and imported
            errors: list[Found] = []
            taken = []
            for record in records:
                begin = time.process_time()
                found = tool(record, model)
                taken.append(time.process_time() - begin)
                errors.append(Found({key: 100.0 * (found[key] / true[key] - 1.0) for key in true}))
            each = {key: rms([e[key] for e in errors]) for key in true}
            note = f"antiresonance {each['antiresonance']:.2g} %, mass {each['mass']:.2g} %, {1e3 * spread(taken).median:.0f} ms"
            yield Figure("peers", f"{condition}: {name}", each["resonance"], "% off in resonance", note=note)
