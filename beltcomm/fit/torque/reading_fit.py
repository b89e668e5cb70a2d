"""Fit of the chain from torque setpoint to reading: the chain of drive and reading together, by least squares; nobody asks the motion here.

reading[n] = g R(setpoint)[n] + offset + noise,   R : a delay and up to three filters, mean over a period or value at its end
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from beltcomm.arrays import Array, row_means
from beltcomm.fit.noise.level import COLOURED, LEAST_COLOUR, MOST_COLOUR, correlation, robust_rms
from beltcomm.fit.torque.lag import Kind, Lag
from beltcomm.fit.torque.laws import DriveLaw, torque_at
from beltcomm.fit.torque.path import TorquePath
from beltcomm.model.value import NORMAL_95
from beltcomm.recording import Recording

#: Setpoint and reading, (n,) each, N m.
Pair = tuple[Array, Array]

#: Samples that are looked at, the liveliest pieces first, and samples that a piece must hold.
MOST, SHORTEST = 6000, 200
#: Of those, the first samples that a search begins with; deviations from a whole delay from which on it is none.
FEW, FAR = 1500, 20.0
#: Chains of filters that are tried beside a delay alone.
CHAINS: tuple[tuple[Kind, ...], ...] = (
    ("sampled",),
    ("first order",),
    ("second order",),
    ("slew rate",),
    ("sampled", "sampled"),
    ("first order", "sampled"),
    ("first order", "first order"),
    ("second order", "sampled"),
    ("slew rate", "first order"),
    ("slew rate", "sampled"),
    ("sampled", "slew rate"),
    ("sampled", "slew rate", "first order"),
    ("sampled", "slew rate", "second order"),
    ("sampled", "first order", "first order"),
)
#: The same where the reading is the torque at the end of the period.
AT_END: tuple[tuple[Kind, ...], ...] = (
    ("first order",),
    ("second order",),
    ("slew rate",),
    ("sampled", "first order"),
    ("first order", "first order"),
    ("second order", "first order"),
    ("slew rate", "first order"),
    ("sampled", "slew rate", "first order"),
    ("sampled", "slew rate", "second order"),
    ("sampled", "first order", "first order"),
)
#: Cells of a period here.
COARSE = 8
#: Periods of delay at most; taps of the free response that a chain is held against.
LONGEST_DELAY, TAPS = 8.0, 12
#: Step of a difference and evaluations of a search; step of the difference that the intervals rest on, and deviations in half of one.
STEP, LONGEST = np.array(1e-4), 40
DIFFERENCE = 1e-3
#: Gain of -2 ln L beyond ln N for each further value that makes a chain the better one.
CLEAR = 10.0
#: -2 ln L above the best up to which the motion is asked; periods below which a delay beside whole ones is none.
NEARLY, WHOLE = 60.0, 0.004
#: Least pole of a filter, and least that it differs from 1 by, in a search.
LEAST_POLE = 1e-3
#: A reading that follows its setpoint to this share of it is a command that comes back.
COMMAND = 1e-4


def clear_gain(samples: int) -> float:
    """Fall of -2 ln L from which on one more value, or another path, is clearly better, nats.

    Parameters
    ----------
    samples : int
        Values that the likelihood is of.
    """
    return math.log(max(samples, 2)) + CLEAR


@dataclass(frozen=True)
class ReadingFit:
    """The chain from torque setpoint to reading that explains the readings best.

    Attributes
    ----------
    law : DriveLaw
        Of drive and reading together, with intervals.
    rest_nm : float
        Rms it leaves, white, N m.
    cost : float
        -2 ln L with ln N for each value.
    samples : int
        How many were looked at.
    values : int
        How many were found.
    at_end : bool
        Whether the reading is the torque at the end of the period.
    crest_factor : float
        Largest of what is left over its rms.
    rivals : tuple of ReadingFit
        Others that explain the reading nearly as well.
    noise_nm : float
        Rms it leaves, of whatever colour, N m.
    delayed : bool
        Whether some whole delay goes with the reading; a slow filter hides that, and a setpoint of another loop has none.
    """

    law: DriveLaw
    rest_nm: float
    cost: float
    samples: int
    values: int
    at_end: bool = False
    crest_factor: float = math.inf
    rivals: tuple[ReadingFit, ...] = ()
    noise_nm: float = math.inf
    delayed: bool = True


def fit_reading(recordings: Sequence[Recording]) -> ReadingFit | None:
    """Fit the chain from torque setpoint to reading.

    Parameters
    ----------
    recordings : sequence of Recording
        With setpoint and reading.

    Returns
    -------
    ReadingFit or None
        The chain that explains the readings best; None where no setpoint changes.
    """
    pairs, sample_s = lively_pairs(recordings)
    if not pairs:
        return None
    free, colour = _free_rest(pairs)
    best = _best_chain(pairs, sample_s, free, colour)
    if best is not None:  # no response, however free, knows a slew rate: what it leaves of one is no noise
        limited, beside = _limits_slew(best), _colour_beside(best, pairs, sample_s)
        if limited or beside > COLOURED:
            other = _best_chain(pairs, sample_s, 0.0, beside, limited=True)
            if other is not None and (limited or (_limits_slew(other) and other.cost < best.cost - CLEAR)):
                best = other
    return best and replace(best, noise_nm=robust_rms(_left(best.law, pairs, sample_s, 0.0, best.at_end)[0]))


def _limits_slew(chain: ReadingFit) -> bool:
    return any(lag.kind == "slew rate" for lag in chain.law.lags)


def _best_chain(pairs: Sequence[Pair], sample_s: float, free: float, colour: float, *, limited: bool = False) -> ReadingFit | None:
    """The chain that explains pairs best; ``free`` is what a free response leaves, N m rms, ``limited`` tries a limit of the slew rate."""
    samples = sum(len(setpoint) for setpoint, _ in pairs)
    best = _fit_chain(pairs, sample_s, (), colour)
    delayed = best is not None
    every = [] if best is None else [best]  # behind a slow filter no whole delay goes with the reading at all
    enough = free * math.exp(0.5 * (TAPS * math.log(samples) + CLEAR) / samples)
    if best is not None:
        comes_back = best.rest_nm <= COMMAND * float(np.std(np.concatenate([setpoint for setpoint, _ in pairs])))
        if (comes_back or free <= best.rest_nm <= enough) and abs(best.law.delay - round(best.law.delay)) <= WHOLE:
            return best
    for number in (1, 2, 3):  # one more filter must be clearly better than none, but not one than another
        chains = [(chain, at_end) for at_end, some in ((False, CHAINS), (True, AT_END)) for chain in some if len(chain) == number]
        chains = [(chain, at_end) for chain, at_end in chains if not limited or "slew rate" in chain]
        found = [one for chain, at_end in chains if (one := _fit_chain(pairs, sample_s, chain, colour, at_end)) is not None]
        every += found
        # What more values do must be clear, and a held torque behind a filter is at the end what one of the samples is in the mean.
        better = min(found, key=lambda one: one.cost + CLEAR * (one.values + one.at_end), default=best)
        if best is None or (better is not None and better.cost < best.cost - CLEAR):
            best = better
        if best is not None and free <= best.rest_nm <= enough:  # less than a response of finite length leaves is a slower filter's
            break
    if best is None:
        return None
    return replace(best, rivals=tuple(one for one in every if one is not best and one.cost < best.cost + NEARLY), delayed=delayed)


def hidden_chains(recordings: Sequence[Recording], chain: ReadingFit) -> list[ReadingFit]:
    """Chains that explain the readings about as well as the one found, the best first: the noise of a reading may hide a filter.

    Of one filter more, and those with the poles of two filters exchanged.

    Parameters
    ----------
    recordings : sequence of Recording
        Those that the chain was fitted to.
    chain : ReadingFit
        The chain with the fewest filters.
    """
    pairs, sample_s = lively_pairs(recordings)
    colour, number = _free_rest(pairs)[1], len(chain.law.lags) + 1
    longer = [(some, at_end) for at_end, every in ((False, CHAINS), (True, AT_END)) for some in every if len(some) == number]
    usual = [(some, at_end) for some, at_end in longer if "slew rate" not in some]
    found = [one for some, at_end in usual if (one := _fit_chain(pairs, sample_s, some, colour, at_end)) is not None]
    for one in (chain, *chain.rivals, *found):
        kinds = tuple(lag.kind for lag in one.law.lags)
        if sorted(kinds) == ["first order", "sampled"]:
            other = _fit_chain(pairs, sample_s, kinds, colour, one.at_end, _poles_exchanged(one.law, sample_s))
            found += [] if other is None else [other]
    return sorted((one for one in found if one.cost < chain.cost + NEARLY), key=lambda one: one.cost)


def _poles_exchanged(law: DriveLaw, sample_s: float) -> list[float]:
    """Unknowns of a filter of the samples and one of first order with their poles exchanged: at the samples nearly the same chain."""
    values = []
    for own, other in zip(law.lags, reversed(law.lags), strict=True):
        pole = math.exp(-sample_s / other.values[0]) if other.kind == "first order" else 1.0 - other.values[0]
        pole = min(max(pole, LEAST_POLE), 1.0 - LEAST_POLE)
        values.append(math.log((1.0 - pole) / pole) if own.kind == "sampled" else -math.log(-math.log(pole)))
    return values


def lively_pairs(recordings: Sequence[Recording]) -> tuple[list[Pair], float]:
    """Gapless pieces of setpoint and reading, the liveliest first.

    Parameters
    ----------
    recordings : sequence of Recording
        Those without a setpoint do not count.

    Returns
    -------
    tuple of list of Pair and float
        Pieces, N m, and their one sampling period, s; none and 0 without a setpoint.
    """
    found: list[tuple[float, float, Array, Array]] = []
    for recording in recordings:
        if recording.torque_setpoint is None:
            continue
        for first, last in recording.pieces:
            setpoint, reading = recording.torque_setpoint[first:last], recording.torque[first:last]
            liveliness = float(np.mean(np.diff(setpoint) ** 2)) if last - first >= SHORTEST else 0.0
            if liveliness > 0.0:
                found.append((liveliness, recording.sample_period_s, setpoint, reading))
    if not found:
        return [], 0.0
    found.sort(key=lambda item: -item[0])
    sample_s, pairs, left = found[0][1], list[Pair](), MOST
    for _, period, setpoint, reading in found:
        if abs(period / sample_s - 1.0) < 1e-3 and left >= SHORTEST:
            pairs.append((setpoint[:left], reading[:left]))
            left -= len(setpoint)
    return pairs, sample_s


def _law(chain: tuple[Kind, ...], x: Array, sample_s: float) -> DriveLaw:
    lags, place = [], 1
    for kind in chain:
        if kind == "sampled":
            lags.append(Lag(kind, (float(1.0 / (1.0 + math.exp(-x[place]))),)))
            place += 1
        elif kind == "first order":
            lags.append(Lag(kind, (sample_s * math.exp(x[place]),)))
            place += 1
        elif kind == "slew rate":
            lags.append(Lag(kind, (math.exp(x[place]) / sample_s,)))
            place += 1
        else:
            lags.append(Lag(kind, (math.exp(x[place]) / sample_s, math.exp(x[place + 1]))))
            place += 2
    return DriveLaw(float(x[0]), tuple(lags))


def _start(chain: tuple[Kind, ...], pairs: Sequence[Pair]) -> list[tuple[float, float, float]]:
    """Value to begin with and bounds, of each value of a chain."""
    steepest = max(float(np.abs(np.diff(reading)).max()) for _, reading in pairs)
    bounds: list[tuple[float, float, float]] = []
    for number, kind in enumerate(chain):
        if kind == "sampled":
            bounds.append(((0.5, -0.5)[number], -5.0, 7.0))
        elif kind == "first order":
            bounds.append(((-0.7, 0.2, 0.7)[number], -4.0, 4.0))
        elif kind == "slew rate":  # the steepest reading is that limit, with noise
            bounds.append((math.log(0.9 * steepest), math.log(0.2 * steepest), math.log(2.0 * steepest)))
        else:
            bounds += [(-0.7, -4.0, 1.5), (-0.4, -2.3, 1.1)]
    return bounds


def _predicted_reading(law: DriveLaw, setpoint: Array, sample_s: float, at_end: bool) -> Array:
    """Reading without noise, (n,), N m, of gain 1."""
    cells = law.cells(setpoint, sample_s, COARSE)
    return torque_at(cells, 1.0) if at_end else row_means(cells)


def _fit_chain(
    pairs: Sequence[Pair],
    sample_s: float,
    chain: tuple[Kind, ...],
    colour: float = 0.0,
    at_end: bool = False,
    values: Sequence[float] | None = None,
) -> ReadingFit | None:
    """The best values of a chain, from every whole delay and from ``values``; all is whitened by the noise's ``colour``."""
    begin = _start(chain, pairs)
    if values is not None:
        begin = [(min(max(value, low), high), low, high) for value, (_, low, high) in zip(values, begin, strict=True)]
    samples = sum(len(setpoint) for setpoint, _ in pairs)

    few = [(setpoint[:FEW], reading[:FEW]) for setpoint, reading in pairs[:1]]

    def left(x: Array) -> tuple[Array, float]:
        return _left(_law(chain, x, sample_s), pairs, sample_s, colour, at_end)

    def rest_at(x: Array) -> Array:
        return left(x)[0]

    def few_at(x: Array) -> Array:
        return _left(_law(chain, x, sample_s), few, sample_s, colour, at_end)[0]

    def searched(rest: Callable[[Array], Array], x: Array) -> OptimizeResult:
        return least_squares(rest, x, bounds=(low, high), x_scale=0.1, diff_step=STEP, max_nfev=LONGEST)

    def with_delay(x: Array, delay: float) -> Array:
        """The best values beside a delay."""
        if len(x) == 1:
            return np.array([delay])

        def others_at(others: Array) -> Array:
            return rest_at(np.array([delay, *others]))

        again = least_squares(others_at, x[1:], bounds=(low[1:], high[1:]), x_scale=0.1, max_nfev=LONGEST)
        return np.array([delay, *again.x])

    best: tuple[float, Array, int] | None = None
    tried = []
    for delay in range(5):
        x = np.array([delay + 0.01, *(item[0] for item in begin)])
        tried.append((float(np.sum(few_at(x) ** 2)), x))
    low, high = np.array([0.0, *(item[1] for item in begin)]), np.array([LONGEST_DELAY, *(item[2] for item in begin)])
    begun = [searched(few_at, np.clip(x, low, high)) for _, x in sorted(tried, key=lambda item: item[0])[:2]]
    found = searched(rest_at, min(begun, key=lambda one: one.cost).x)
    ends = [(found.x, len(begin) + 1)]
    whole = round(found.x[0])  # the usual delay
    deviation = math.sqrt(2.0 * found.cost / samples * np.linalg.pinv(found.jac.T @ found.jac)[0, 0])
    if abs(found.x[0] - whole) < max(WHOLE, FAR * deviation):
        ends.append((with_delay(found.x, whole), len(begin)))
    for y, number in ends:
        cost = samples * math.log(max(float(np.mean(rest_at(y) ** 2)), 1e-300)) + number * math.log(samples)
        if best is None or cost < best[0]:
            best = (cost, y, number)
    if best is None:  # no start was finite
        return None
    rest, gain = left(best[1])
    if gain <= 0.0:
        return None
    law = _with_intervals(_law(chain, best[1], sample_s), _deviations(rest_at, best[1], rest))
    rms = float(np.sqrt(np.mean(rest**2)))
    crest_factor = float(np.abs(rest).max()) / max(rms, 1e-300)
    return ReadingFit(replace(law, gain=gain), rms, best[0], samples, best[2], at_end, crest_factor)


def _left(law: DriveLaw, pairs: Sequence[Pair], sample_s: float, colour: float, at_end: bool) -> tuple[Array, float]:
    """Rest that a law leaves of the readings, white, (n,) N m, with the likeliest gain and offset; and that gain."""
    skip = math.ceil(LONGEST_DELAY)
    read = np.concatenate([whitened_row(reading, colour)[skip:] for _, reading in pairs])
    shown = np.concatenate([whitened_row(_predicted_reading(law, setpoint, sample_s, at_end), colour)[skip:] for setpoint, _ in pairs])
    shown_0, read_0 = shown - shown.mean(), read - read.mean()
    gain = float(shown_0 @ read_0) / max(float(shown_0 @ shown_0), 1e-300)
    return read_0 - gain * shown_0, gain


def unlikely_readings(paths: Sequence[TorquePath], recordings: Sequence[Recording]) -> list[float]:
    """-2 ln L of the readings by each of some paths, above that by the likeliest; 0 for all where no setpoint changes.

    Parameters
    ----------
    paths : sequence of TorquePath
        Of a drive whose setpoint was recorded; one that takes the readings as they are says nothing of them, and gets 0.
    recordings : sequence of Recording
        With setpoint and reading.
    """
    pairs, sample_s = lively_pairs(recordings)
    chains = {place: (path.chain, path.reading.at_end) for place, path in enumerate(paths) if path.chain is not None}
    if not pairs or not chains:
        return [0.0] * len(paths)

    def squares(colour: float) -> dict[int, float]:
        rests = {place: _left(law, pairs, sample_s, colour, at_end)[0] for place, (law, at_end) in chains.items()}
        return {place: max(float(np.mean(rest**2)), 1e-300) for place, rest in rests.items()}

    plain = squares(0.0)
    law, at_end = chains[min(plain, key=plain.__getitem__)]
    found = squares(colour_of([_left(law, pairs, sample_s, 0.0, at_end)[0]]))
    number, least = sum(len(setpoint) for setpoint, _ in pairs), min(found.values())
    return [number * math.log(found[place] / least) if place in found else 0.0 for place in range(len(paths))]


def _deviations(rest_at: Callable[[Array], Array], x: Array, rest: Array) -> Array:
    """Standard deviations of the values of a chain by s² (JᵀJ)⁻¹, (k,); 0 for a whole delay, and where the rest does not tell a value."""
    free = [i for i in range(len(x)) if i or x[0] != round(x[0])]
    if not free:
        return np.zeros(len(x))
    ahead = [rest_at(x + DIFFERENCE * np.eye(len(x))[i]) for i in free]
    jacobian = np.column_stack([(moved - rest) / DIFFERENCE for moved in ahead])
    covariance = float(rest @ rest) / max(len(rest) - len(free), 1) * np.linalg.pinv(jacobian.T @ jacobian)
    found = np.zeros(len(x))
    found[free] = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return found


def _with_intervals(law: DriveLaw, deviations: Array) -> DriveLaw:
    """The law with the half widths at 95 % of its values, by the deviations of the unknowns of :func:`_law`, (k,)."""
    lags, place = [], 1
    for lag in law.lags:
        slopes = [share * (1.0 - share) for share in lag.values] if lag.kind == "sampled" else lag.values  # logistic and logarithms
        here = deviations[place : place + len(lag.values)]
        lags.append(replace(lag, intervals=tuple(float(NORMAL_95 * s * d) for s, d in zip(slopes, here, strict=True))))
        place += len(lag.values)
    return replace(law, lags=tuple(lags), delay_interval=float(NORMAL_95 * deviations[0]))


def _colour_beside(found: ReadingFit, pairs: Sequence[Pair], sample_s: float) -> float:
    """Colour of what a law leaves."""
    rests = [reading - _predicted_reading(found.law, setpoint, sample_s, found.at_end) for setpoint, reading in pairs]
    return colour_of([rest - rest.mean() for rest in rests])


def colour_of(rests: Sequence[Array]) -> float:
    """Correlation of neighbours; 0 where it is hardly any.

    Parameters
    ----------
    rests : sequence of ndarray
        One for each record, of any unit.
    """
    found = correlation(rests)
    return min(found, MOST_COLOUR) if found > LEAST_COLOUR else 0.0


def whitened_row(row: Array, colour: float) -> Array:
    """A row whose noise has a colour, its noise white: x[n] - ρ x[n-1].

    Parameters
    ----------
    row : ndarray (n,)
        Of any unit.
    colour : float
        ρ.
    """
    return row if colour == 0.0 else row - colour * np.concatenate((row[:1], row[:-1]))


def _free_rest(pairs: Sequence[Pair]) -> tuple[float, float]:
    """rms of what a response with :data:`TAPS` free values leaves, white, N m, and its colour."""
    colour = 0.0
    for _ in range(2):
        white = [whitened_row(setpoint, colour) for setpoint, _ in pairs]
        rows = [np.stack([row[TAPS - k : len(row) - k] for k in range(TAPS + 1)], axis=1) for row in white]
        read = np.concatenate([whitened_row(reading, colour)[TAPS:] for _, reading in pairs])
        regressor = np.column_stack((np.concatenate(rows), np.ones(len(read))))
        rest = read - regressor @ np.linalg.lstsq(regressor, read, rcond=None)[0]
        if colour > 0.0 or (colour := colour_of([rest])) == 0.0:
            break
    return float(np.sqrt(np.mean(rest**2))), colour
