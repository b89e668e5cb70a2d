"""Bias by rounding of the mean square of a whitened residual: taken off, so that it pulls at no parameter.

The whitening filter W of a segment is worked out once, for a model near the right one.  With the noises' path T(x) of the model at x,

    E |W e(x)|²/n  =  what the model leaves  +  v(x),    v(x) = Σ_m σ_m² Σ_k h_m[k]²,    h_m = W T(x) δ_m,

σ_m the noises' deviations.  v(x) falls where the model needs less torque for the rounding, so the squares alone would be least at too
small an inertia and a too soft belt: regression on noisy regressors.  |W e|²/n - (v(x) - v(x₀)) has its minimum, in the mean, at the
truth, whatever the torque was; it is the whitened form of least squares corrected for noise in the regressors.

Torque p that acts and is not read, or a part L of it only, moves the machine, and is in the angle: with the plant's own T(x₀)

    h_p(x) = W (T(x)/T(x₀) - L) c,   c : its colour,    over all frequencies,

is a row of v like those of the rounding.  Without it the squares are least where the residual has less of p: at too light a machine.

That holds near x₀.  Where rounding is most of the noise every model is judged by the filter W(x) for its own noise instead: v = 1
whatever x, so nothing is taken off.  Either way the squares of ∂(W T)/∂x δ_m are no information, and are taken off that.
Source: Fuller, Measurement Error Models, 1987, section 3.1; for p, whose slope is that of ln det T where W whitens it, Whittle (1953).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from beltcomm.arrays import Array, ComplexArray
from beltcomm.compiled import compiled
from beltcomm.fit.noise.process_torque import Unread
from beltcomm.fit.noise.propagation import AROUND, POINTS, NoisePath, at_roots, noise_path, stiffness_levels
from beltcomm.fit.noise.whitening import gains_of, noises
from beltcomm.fit.residual.segment import Segment
from beltcomm.model import Model
from beltcomm.model.mounted import Mounted, loaded_model

#: Place, m, sampling period, s, and load of a record.
Where = tuple[float, float, Mounted | None]

#: Samples in which the gains settle; longest response that is followed; share of the response's squares that ends it over a block.
SETTLING, LONGEST, BLOCK, NEGLIGIBLE = 600, 6000, 100, 1e-7
#: Variance that rounding adds, that of the residual being 1, beyond which a model does not hold its bodies; near the right one it is
#: less than 1.
ABSURD = 1e6
#: v(x) - v(x₀) that is taken off at most: with a carriage that hardly anything damps it would be more than all that is left.
MOST = 1.0


class RoundingBias:
    """v(x) - v(x₀) of segments, x₀ the model for which they were whitened; segments behind an observer have none.

    However a search began: so two models fitted to the same segments are compared by the same objective.
    """

    def __init__(self, segments: Sequence[Segment], model: Model) -> None:
        self.model = model
        self.kinds: list[_Kind] = []
        self.of_segment = np.full(len(segments), -1)
        known: dict[tuple[object, ...], int] = {}
        references = [segment.reference or model for segment in segments]
        middles = [segment.middle_m(reference) for segment, reference in zip(segments, references, strict=True)]
        models = {id(one): one for one in (model, *references)}.values()
        # where the belt is as stiff everywhere, one place stands for all
        even = bool(segments) and all(len(stiffness_levels(one, min(middles), max(middles))[1]) == 1 for one in models)
        for i, segment in enumerate(segments):
            if segment.observer is not None:
                continue
            place = float(np.mean(middles)) if even else middles[i]
            key = (
                round(place, 3),
                segment.motion.sample_s,
                segment.motion.mounted,
                segment.rounding,
                segment.step_rad,
                segment.noise_nm,
                segment.group,
                segment.colour,
                segment.own_noise,
                segment.unread,
                id(references[i]),
            )
            if key not in known:
                known[key] = len(self.kinds)
                self.kinds.append(_Kind(segment, references[i], place))
            self.of_segment[i] = known[key]
        self._start = np.array([kind.start for kind in self.kinds])
        self.of_segment[~np.append(np.isfinite(self._start), True)[self.of_segment]] = -1  # a model to begin with that tells nothing of it
        self._last: tuple[bytes, Array] = (b"", np.zeros(0))

    def __call__(self, vector: Array) -> Array:
        """v(x) - v(x₀) of each segment, at most :data:`MOST`, (segments,); in units of the whitened residual's variance, inf where a body
        flies off.
        """
        key = vector.tobytes()
        if self._last[0] != key:
            excess = np.append(self._values(self.model.with_vector(vector)) - np.where(np.isfinite(self._start), self._start, 0.0), 0.0)
            self._last = (key, np.where(np.isfinite(excess), np.minimum(excess, MOST), excess)[self.of_segment])
        return self._last[1]

    def _paths(self, model: Model) -> dict[Where, NoisePath]:
        """Noise paths by place, sampling period and load."""
        return {where: _path_at(model, where) for where in {kind.where for kind in self.kinds}}

    def _values(self, model: Model) -> Array:
        paths = self._paths(model)
        return np.array([kind.power(paths[kind.where]) for kind in self.kinds])

    def responses(self, vector: Array, others: Sequence[Array], steps: Array) -> tuple[Array, Array]:
        """Slope and curvature of v at x.

        Parameters
        ----------
        vector : ndarray, SI
            Parameters at x.
        others : sequence of ndarray
            Neighbours of x, each ``steps`` away along one unknown.
        steps : ndarray, (k,)
            Scaled.

        Returns
        -------
        tuple[ndarray, ndarray]
            (segments, k) and (segments, k, k), the latter ½ ∂²v to first order in the response.
        """
        k = len(others)
        slope, curvature = np.zeros((len(self.kinds) + 1, k)), np.zeros((len(self.kinds) + 1, k, k))
        every = [self._paths(self.model.with_vector(v)) for v in (vector, *others)]
        for number, kind in enumerate(self.kinds):
            own = [paths[kind.where] for paths in every]
            powers = [kind.power(path) for path in own]
            if not all(map(math.isfinite, powers)) or (math.isfinite(kind.start) and powers[0] - kind.start > MOST):
                continue
            here, *beside = (kind.response(path) for path in own)
            long = max(r.shape[1] for r in (here, *beside))
            base, ahead = _pad(here, long).reshape(-1), np.zeros((k, len(here) * long))
            for i, (response, step) in enumerate(zip(beside, steps, strict=True)):
                ahead[i] = (_pad(response, long).reshape(-1) - base) / step
            slope[number], curvature[number] = (0.0 if kind.segment.own_noise else 2.0 * ahead @ base), ahead @ ahead.T
        return slope[self.of_segment], curvature[self.of_segment]


class _Kind:
    """Segments whose noises reach the residual alike."""

    def __init__(self, segment: Segment, model: Model, place_m: float) -> None:
        self.segment, self.where = segment, (place_m, segment.motion.sample_s, segment.motion.mounted)
        self._known: dict[int, tuple[NoisePath, Array]] = {}
        here = _path_at(model, self.where)
        self.filter = self._filter(here)
        self.unread = None if segment.own_noise or segment.unread is None else (self._weight(segment.unread), here.transfer)
        self.start = self.power(here)

    def _filter(self, plain: NoisePath) -> tuple[NoisePath, Array, float]:
        segment = self.segment
        path, variances, start = noises(plain, segment.step_rad, segment.noise_nm, segment.rounding, segment.colour)
        keep = np.ones(SETTLING, dtype=np.bool_)
        gains, deviations = gains_of(keep, [path], np.zeros(SETTLING, dtype=np.int64), variances, start)
        return path, gains[-1].copy(), float(deviations[-1])

    def response(self, plain: NoisePath) -> Array:
        """σ_m h_m of each noise, grouped as the residual is, (noises, k)."""
        segment = self.segment
        found = self._known.get(id(plain))
        if found is None or found[0] is not plain:
            path, variances, _ = noises(plain, segment.step_rad, segment.noise_nm, segment.rounding, segment.colour)
            known, gains, deviation = self._filter(plain) if segment.own_noise else self.filter
            parts = []
            for m, variance in enumerate(variances):
                out = np.zeros(LONGEST)
                length = _impulse_response(path.F, path.G[:, m].copy(), path.H, float(path.D[m]), known.F, known.H, gains, out)
                size = np.sqrt(variance) / (deviation * np.sqrt(segment.group))
                parts.append(np.convolve(out[:length], np.ones(segment.group)) * size)
            if self.unread is not None and segment.unread is not None:
                weight, own = self.unread
                shown = weight * (plain.transfer / own - np.polyval(np.array(segment.unread.answer)[::-1], 1.0 / AROUND))
                parts += [shown.real, shown.imag]
            used = max(len(part) for part in parts)
            found = plain, np.stack([np.concatenate((part, np.zeros(used - len(part)))) for part in parts])
            self._known = {id(plain): found} if len(self._known) > 40 else {**self._known, id(plain): found}
        return found[1]

    def _weight(self, unread: Unread) -> ComplexArray:
        """W c of the module, grouped as the residual is, at :data:`AROUND`."""
        segment = self.segment
        path, gains, deviation = self.filter
        plain = np.linalg.eigvals(path.F), np.linalg.eigvals(path.F - np.outer(gains, path.H))
        white = at_roots(plain[0]) / at_roots(plain[1]) / deviation
        grouped = np.polyval(np.ones(segment.group), AROUND) / math.sqrt(segment.group)
        mean = 0.5 * (1.0 + 1.0 / AROUND)  # the residual has that of two periods
        own = segment.noise_nm * math.sqrt(unread.share * (1.0 - unread.pole**2)) / (1.0 - unread.pole / AROUND)
        return np.asarray(white * grouped * mean * own * math.sqrt(2.0 / POINTS))

    def power(self, path: NoisePath) -> float:
        """v of the module; inf where the model does not hold its bodies."""
        if self.segment.own_noise:
            return 1.0
        with np.errstate(over="ignore", invalid="ignore"):
            response = self.response(path)
            found = float(np.sum(response * response))
        return found if found < ABSURD else math.inf


def _path_at(model: Model, where: Where) -> NoisePath:
    """Noise path at a place, m, with a sampling period, s, and the load of a record."""
    place_m, sample_s, mounted = where
    return noise_path(loaded_model(model, mounted), place_m, sample_s)


def _pad(rows: Array, length: int) -> Array:
    return rows if rows.shape[1] == length else np.pad(rows, ((0, 0), (0, length - rows.shape[1])))


@compiled
def _impulse_response(f: Array, g: Array, h: Array, d: float, f0: Array, h0: Array, gains: Array, out: Array) -> int:
    """Innovations of a filter (f0, h0, gains) to which a path (f, g, h, d) passes a unit impulse; how many are worth counting."""
    size, own = h.shape[0], h0.shape[0]
    s, moved, z, next_z = np.zeros(size), np.zeros(size), np.zeros(own), np.zeros(own)
    total, block = 0.0, 0.0
    for n in range(out.shape[0]):
        e = d if n == 0 else 0.0
        for i in range(size):
            e += h[i] * s[i]
        for i in range(own):
            e -= h0[i] * z[i]
        out[n] = e
        for i in range(size):
            value = g[i] if n == 0 else 0.0
            for j in range(size):
                value += f[i, j] * s[j]
            moved[i] = value
        for i in range(own):
            value = gains[i] * e
            for j in range(own):
                value += f0[i, j] * z[j]
            next_z[i] = value
        for i in range(size):
            s[i] = moved[i]
        for i in range(own):
            z[i] = next_z[i]
        block += e * e
        if (n + 1) % BLOCK == 0:
            total += block
            if block <= NEGLIGIBLE * total:
                return n + 1
            block = 0.0
    return int(out.shape[0])
